"""The command line: ``spatialdyn info ROBOT``, ``compare [ROBOT ...|--all]``, ``derive ROBOT``, ``simulate ROBOT``,
``view ROBOT``, ``check ROBOT``, ``trade ROBOT``, ``requires ROBOT``, ``identify ROBOT LOG``, ``excite ROBOT``,
``compile ROBOT``, ``export ROBOT``, ``port SCRIPT``, ``run SCRIPT``, ``study FILE``, ``example [NAME]``, ``docs``.

Exit status: 0 success; 1 disagreement with Pinocchio, an error found by ``check``, or a script with missing names; 2
bad input, reported in one line on stderr; 130 Ctrl-C, likewise; 141 a reader that closed stdout early. ``run`` exits
with the status of the script.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from importlib import import_module

from .. import __version__
from ..calls.progress import messages
from ..engines.interrupt import INTERRUPTED
from ..errors import SpatialDynError
from ..waiting import watch

COMMANDS = {
    "info": "links, joints and limits of a robot, and oddities of its file",
    "check": "oddities of inertias, mass ratios, digits and time steps, and remedies",
    "derive": "M, C, g, energies in closed form",
    "compare": "errors and times of every call against Pinocchio",
    "simulate": "motion of a robot without motors, its energy, a plot and a file of it",
    "view": "a robot in the browser, or in one page to keep",
    "trade": "error and cost of the options for a task, and the cheapest within a tolerance",
    "requires": "which parts of a scene a motion needs, and the cheapest scene that keeps it",
    "identify": "inertias and friction of a robot from a log of positions and torques, with intervals",
    "excite": "a path that moves every parameter of a robot, within its limits",
    "compile": "compile a robot's calls ahead, and keep the code on disk",
    "export": "calls, control laws and steps of a robot as C for a controller's chip",
    "port": "which of Pinocchio's names a script uses, and which are supported",
    "run": "a script, unchanged, with this library in the place of Pinocchio",
    "study": "a function on many random samples, in chunks, here or on a cluster",
    "example": "short programs that show what the library does: listed, run, printed",
    "docs": "the pages about this library, as a site in a folder",
}  # {command, a module of this folder: its help}
RUN = "run"  # arguments after its script belong to the script
GOES_ON = ("view", "example", RUN)  # commands of any duration: long work is named only within them
LISTS = ("--q0", "--v0", "--q", "--centre")  # options that take numbers separated by commas
PIPE_CLOSED = 141  # exit status if the reader of stdout, such as head, has closed it


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status; ``argv`` is ``sys.argv[1:]`` by default."""
    words = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr) if words[:1] != [RUN] else ():
        if hasattr(stream, "reconfigure"):  # a pipe may lack characters of the terminal: replace them
            stream.reconfigure(errors="replace")
    try:
        try:
            return _status(words)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        return PIPE_CLOSED


def _status(given: Sequence[str]) -> int:
    known = 2 if given[:1] == [RUN] else len(given)
    words = _joined(given[:known])
    arguments = _parser(words).parse_args(words, argparse.Namespace(rest=given[known:]))
    try:
        quiet = getattr(arguments, "quiet", False)
        goes_on = arguments.command in GOES_ON or getattr(arguments, "view", False)
        with nullcontext() if quiet else messages(say), nullcontext() if goes_on else watch.call(arguments.command):
            status: int = arguments.run(arguments)
    except SpatialDynError as error:
        print(f"spatialdyn: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        print(f"spatialdyn: {str(interrupt) or 'interrupted'}", file=sys.stderr)
        return INTERRUPTED
    return status


def say(text: str) -> None:
    """Print a message on stderr."""
    if sys.stderr is not None:
        print(f"spatialdyn: {text}", file=sys.stderr, flush=True)


def _joined(argv: Sequence[str]) -> list[str]:
    """Arguments with ``--q0 -1,0`` as ``--q0=-1,0``, since argparse takes a leading minus for an option."""
    joined: list[str] = []
    for word in argv:
        if joined and joined[-1] in LISTS and word[:1] == "-" and word[1:2].isdigit() | (word[1:2] == "."):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of these words; only the commands that they name have their arguments."""
    about = "Rigid-body dynamics of robots from URDF, MJCF and xacro files."
    whole = argparse.ArgumentParser(prog="spatialdyn", description=about)
    whole.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = whole.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        parser = commands.add_parser(name, help=text)
        if name in words:  # importing all of them takes longer than many commands run
            import_module(f".{name}", __package__).add(parser)
            parser.set_defaults(command=name)
    return whole
