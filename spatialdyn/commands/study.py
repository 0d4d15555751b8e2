"""``spatialdyn study FILE.py``: runs the study that a file makes, here or on the workers of a Dask scheduler."""

from __future__ import annotations

import argparse
import runpy
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import StudyError, pip_install
from ..studies.reductions import Extremes, Statistics
from ..studies.study import Study
from .printing import fold, shown
from .robots import add_quiet


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument(
        "file", metavar="FILE.py", help="defines study(folder), which returns sd.study(...), or a study"
    )
    parser.add_argument("--folder", metavar="F", help="where its parts are: a study that is there is taken up")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of Dask, as tcp://host:8786 (default: run here)")
    parser.add_argument("--threads", type=int, metavar="N", help="of each worker's batches (default: theirs)")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    study = read(arguments.file, arguments.folder)
    began, before = time.perf_counter(), len(study.done)
    with ExitStack() as stack:
        executor = None if arguments.scheduler is None else stack.enter_context(_client(arguments.scheduler))
        report = stack.enter_context(shown("studying", "chunks", arguments.quiet))
        study.run(executor, progress=report, threads=arguments.threads)
    print(f"{study!r}: {len(study.done) - before} now, in {time.perf_counter() - began:.1f} s")
    failed = study.failed
    for text in list(failed.values())[:3]:
        print(f"spatialdyn: {text.splitlines()[0]}", file=sys.stderr)
    if failed:
        print(f"spatialdyn: {len(failed)} chunks failed", file=sys.stderr)
        return 1
    for label, found in study.result().items():
        show(label, found)
    print(f"digest  {study.digest()}")
    return 0


def read(file: str, folder: str | None) -> Study:
    """The study that a file makes. Raises StudyError."""
    if not Path(file).is_file():
        raise StudyError(f"there is no file {file}, expected one that defines study(folder)")
    made = runpy.run_path(file).get("study")  # under a module name that workers lack, so functions pickle by value
    if callable(made) and not isinstance(made, Study):
        if folder is None:
            raise StudyError(f"study of {file} takes a folder, expected --folder")
        made = made(folder)
    elif folder is not None and isinstance(made, Study):
        raise StudyError(f"study of {file} has its folder, expected no --folder, or a function study(folder)")
    if not isinstance(made, Study):
        raise StudyError(f"{file} makes {type(made).__name__}, expected study(folder), which returns sd.study(...)")
    return made


def _client(address: str) -> Any:
    """A client of a Dask scheduler. Raises StudyError."""
    try:
        import distributed
    except ImportError as error:
        raise StudyError(f"--scheduler needs dask: {pip_install('cluster')}") from error
    try:
        make: Any = distributed.Client
        return make(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise StudyError(f"no Dask scheduler answers at {address}: {error}") from error


def show(label: str, found: Any) -> None:
    """Print a result."""
    if isinstance(found, (Statistics, Extremes)):
        for name, x in found._asdict().items():
            if not isinstance(x, dict):
                show(f"{label}.{name}", x)
        return
    text = np.array2string(np.asarray(found), precision=6, threshold=40, separator=", ").replace("\n", "")
    fold(f"{label}  {' '.join(text.split())}", first="")
