"""Output of commands: tables, folded text, a progress bar.

rich draws tables if it is installed; otherwise they are aligned text.
"""

from __future__ import annotations

import itertools
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

NARROW = 12  # least width of a table's columns of words
NARROWEST = 24  # least width of folded text
LINE_SECONDS = 0.1  # between two writes of a line of progress
WIDE = 400  # columns of a table that is not in a terminal: nothing is folded


class Column(NamedTuple):
    """Head of a column of words, or of numbers."""

    title: str
    number: bool = False


def print_table(columns: Sequence[Column], rows: Sequence[Sequence[str]], bad: Iterable[int] = ()) -> None:
    """An aligned table on stdout: numbers right, words left; the rows ``bad`` are red in a terminal.

    Words longer than NARROW are folded to fit the terminal; lines of a table that is still wider run over.
    """
    try:
        from rich.box import SIMPLE_HEAD
        from rich.console import Console
        from rich.table import Table
        from rich.text import Text
    except ImportError:
        _print_plain(columns, rows)
        return
    console = Console(file=sys.stdout, highlight=False)
    if not console.is_terminal:
        console = Console(file=sys.stdout, highlight=False, width=WIDE, color_system=None)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for column in columns:
        right = column.number
        table.add_column(column.title, justify="right" if right else "left", no_wrap=right, overflow="fold")
    least = [max(map(len, (column.title, *(row[k] for row in rows)))) for k, column in enumerate(columns)]
    least = [n if column.number else min(n, NARROW) for n, column in zip(least, columns, strict=True)]
    for size, part in zip(least, table.columns, strict=True):
        part.min_width = size
    console.width = max(console.width, sum(least) + 2 * len(least))
    marked = set(bad)
    for k, row in enumerate(rows):
        table.add_row(*(Text(cell) for cell in row), style="bold red" if k in marked else None)
    with console.capture() as drawn:  # rich itself ends the process if stdout is closed
        console.print(table)
    text = drawn.get()
    print(text if console.is_terminal else "\n".join(line.rstrip() for line in text.split("\n")), end="")


def _print_plain(columns: Sequence[Column], rows: Sequence[Sequence[str]]) -> None:
    lines = [[column.title for column in columns], *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(columns))]
    lines.insert(1, ["-" * width for width in widths])
    for line in lines:
        cells = [
            cell.rjust(width) if column.number else cell.ljust(width)
            for cell, width, column in zip(line, widths, columns, strict=True)
        ]
        print("  ".join(cells).rstrip())


@contextmanager
def shown(doing: str, things: str, quiet: bool = False) -> Iterator[Callable[[int, int], None]]:
    """A function ``report(done, total)`` that shows the current work on stderr at once: "compiling 12 of 70 calls".

    A bar and the time so far if rich is installed; else a line. Nothing if quiet, or if stderr is no terminal.
    """
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    try:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
    except ImportError:
        with _line(doing, things) as report:
            yield report
        return
    parts = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*parts, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(doing, total=None)
        yield lambda done, total: bar.update(
            task, completed=done, total=total, description=_doing(doing, done, total, things)
        )


@contextmanager
def _line(doing: str, things: str) -> Iterator[Callable[[int, int], None]]:
    """``shown`` as one line, rewritten at each report and erased at the end."""
    last, due = doing, 0.0

    def show(text: str) -> None:
        nonlocal last
        sys.stderr.write("\r" + text.ljust(len(last)))
        sys.stderr.flush()
        last = text

    def report(done: int, total: int) -> None:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + LINE_SECONDS
            show(_doing(doing, done, total, things))

    show(doing)
    try:
        yield report
    finally:
        sys.stderr.write("\r" + " " * len(last) + "\r")
        sys.stderr.flush()


def _doing(doing: str, done: int, total: int, things: str) -> str:
    """The text of the current work: the item after the finished ones."""
    return f"{doing} {min(done + 1, total)} of {total} {things}"


@contextmanager
def progress(total: int, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """A function that moves a bar on stderr to the step it names, a line without rich; as ``shown``."""
    try:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    except ImportError:
        with shown("comparing", "robots", quiet) as report:
            count = itertools.count()
            yield lambda what: report(next(count), total)
        return
    console = Console(stderr=True)
    parts = (TextColumn("{task.description:<32.32}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    hidden = quiet or total < 2 or not console.is_terminal
    with Progress(*parts, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task("", total=total)
        done = -1

        def begin(what: str) -> None:
            nonlocal done
            done += 1
            bar.update(task, completed=done, description=what)

        yield begin


def terminal_width() -> int:
    """Columns of the terminal; WIDE where stdout is not one."""
    return shutil.get_terminal_size((WIDE, 24)).columns if sys.stdout and sys.stdout.isatty() else WIDE


def fold(text: str, first: str = "  ") -> None:
    """Print a text folded to the terminal, later lines under the text of the first."""
    import textwrap

    print(
        textwrap.fill(text, max(NARROWEST, terminal_width()), initial_indent=first, subsequent_indent=" " * len(first))
    )
