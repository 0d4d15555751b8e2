"""``spatialdyn example [NAME]``: lists the gallery, or runs or prints one of its examples."""

from __future__ import annotations

import argparse
import inspect

from ..examples import gallery
from ..waiting import watch
from .printing import Column, print_table


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="an example; all are listed without it")
    parser.add_argument("--source", action="store_true", help="print the example instead of running it")
    gallery.add_options(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.name is None:
        print_table([Column("example"), Column("")], [[name, gallery.title(name)] for name in gallery.names()])
        print()
        print("spatialdyn example NAME runs one, --source prints it, --save FILE writes its picture")
        print(f"the chapter: {gallery.CHAPTER}, whose two lists of exercises are here by number")
        return 0
    module = gallery.module(arguments.name)
    if arguments.source:
        print(inspect.getsource(module), end="")
        return 0
    given = {"quick": arguments.quick, "long": arguments.long, "save": arguments.save, "robot": arguments.robot}
    options = gallery.checked(arguments.name, module.main, **given)
    print(f"{inspect.getdoc(module)}\n")
    with watch.call("the example"):
        module.main(**options)
    return 0
