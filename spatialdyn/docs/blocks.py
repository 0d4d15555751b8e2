"""Code blocks of a page: found, run, and what they print compared with what the page says.

Python blocks of a page are one program, in its order. A ``text`` block right behind one, or behind a ``bash`` block, is
what that prints; ``...`` stands for what differs from run to run. Of bash, lines that begin with ``spatialdyn`` run.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

PAGES = Path(__file__).parent / "pages"
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$(?:\n+```text\n(.*?)^```$)?", re.MULTILINE | re.DOTALL)
LOOSELY = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
PROGRAM = "spatialdyn "
RUN = ("python", "bash")
Command = Callable[[Sequence[str]], int]


class Block(NamedTuple):
    """A code block: its language, its text, what the page says that it prints or None, and its line on the page."""

    language: str
    text: str
    says: str | None
    line: int


class Difference(NamedTuple):
    """A block that prints something other than the page says."""

    line: int
    says: str
    printed: str


def pages() -> list[str]:
    """Names of the pages that are written by hand, without their ending: ``cookbook/follow_a_path``."""
    return sorted(x.relative_to(PAGES).with_suffix("").as_posix() for x in PAGES.rglob("*.md"))


def read(page: str) -> str:
    """The text of a page."""
    return (PAGES / f"{page}.md").read_text(encoding="utf-8")


def blocks(text: str) -> Iterator[Block]:
    """The code blocks of a page; those of text belong to the one before them."""
    for found in FENCE.finditer(text):
        yield Block(found[1], found[2], found[3], text.count("\n", 0, found.start()) + 1)


def run(page: str, command: Command, names: dict[str, Any] | None = None) -> list[Difference]:
    """Run the blocks of a page in order, in the current folder; the differences, none if the page is right.

    command  the main function of the command line
    names    of the program; what the blocks define is there afterwards
    """
    names = {"__name__": page} if names is None else names
    wrong = []
    for block in blocks(read(page)):
        seen = printed(block, page, command, names)
        if block.language in RUN and not agree(block.says or "", seen):
            wrong.append(Difference(block.line, block.says or "", seen))
    return wrong


def printed(block: Block, page: str, command: Command, names: dict[str, Any]) -> str:
    """Run a block, with the names that those before it defined, and return what it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as stream:
        if block.language == "python":
            source = "\n" * block.line + block.text  # a traceback has the page's lines
            exec(compile(source, f"{page}.md", "exec", dont_inherit=True), names)
        elif block.language == "bash":
            _shell(block.text, command)
    return stream.getvalue()


def agree(says: str, printed: str) -> bool:
    """Whether what is printed is what the page says, up to spaces and ``...``."""
    if not says.strip() or not printed.strip():
        return not says.strip() and not printed.strip()
    return doctest.OutputChecker().check_output(says, printed, LOOSELY)


def _shell(text: str, command: Command) -> None:
    for line in text.splitlines():
        if line.startswith(PROGRAM):
            status = command(shlex.split(line.partition("  #")[0])[1:])
            if status:
                raise RuntimeError(f"{line} ends with status {status}, expected 0")
