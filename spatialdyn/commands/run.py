"""``spatialdyn run SCRIPT.py [ARGUMENT ...]``: ``python SCRIPT.py ARGUMENT ...`` with this library as ``pinocchio``."""

from __future__ import annotations

import argparse
import builtins
import io
import os
import sys
from importlib.machinery import SourceFileLoader
from types import ModuleType

from ..compat.pinocchio.importing import install
from ..engines.interrupt import INTERRUPTED
from ..errors import SpatialDynError


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("script", metavar="SCRIPT", help="a Python file")
    parser.add_argument("arguments", metavar="ARGUMENT", nargs="*", default=[], help="of the script, options too")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    """Run the script: prints the traceback of its error and returns 1, else exits as the script does."""
    script = arguments.script
    path = os.path.abspath(script)
    try:
        with io.open_code(path) as file:
            source = file.read()
    except (OSError, ValueError) as error:  # a null character
        reason = getattr(error, "strerror", None) or error
        raise SpatialDynError(f'script "{script}": {reason}, expected a Python file') from None
    install()
    sys.argv[:] = [script, *arguments.rest]
    if not (sys.flags.isolated or getattr(sys.flags, "safe_path", False)):
        sys.path[0] = os.path.dirname(os.path.realpath(path))
    main = ModuleType("__main__")
    vars(main).update(
        __builtins__=builtins, __file__=path, __loader__=SourceFileLoader("__main__", path), __cached__=None
    )
    if "__annotations__" in vars(sys.modules["__main__"]):  # until Python 3.13
        vars(main)["__annotations__"] = {}
    sys.modules["__main__"] = main
    try:
        exec(compile(source, path, "exec", dont_inherit=True), vars(main))
    except SystemExit:
        raise
    except BaseException as error:
        of_script = error.__traceback__ and error.__traceback__.tb_next  # without this function's frame
        sys.excepthook(type(error), error.with_traceback(of_script), of_script)
        if isinstance(error, KeyboardInterrupt):
            raise SystemExit(INTERRUPTED) from None
        return 1
    return 0
