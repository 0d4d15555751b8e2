"""What commands print with: tables, folded text, a progress bar.

Tables are drawn by rich if it is installed, as aligned text otherwise.
"""

from __future__ import annotations

import importlib.util
import math
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

WIDE = 400  # columns of a table that is not read in a terminal: nothing is folded


def watched() -> bool:
    """Whether a progress bar would be seen."""
    return sys.stderr.isatty() and importlib.util.find_spec("rich") is not None


class Column(NamedTuple):
    """Head of a column of words, or of numbers."""

    title: str
    number: bool = False


def print_table(columns: Sequence[Column], rows: Sequence[Sequence[str]], bad: Iterable[int] = ()) -> None:
    """An aligned table on stdout: numbers right, words left; the rows ``bad`` stand out where there is colour."""
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
    marked = set(bad)
    for k, row in enumerate(rows):
        table.add_row(*(Text(cell) for cell in row), style="bold red" if k in marked else None)
    console.print(table)


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
def progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar on stderr that is told what comes next; nothing without rich, without a terminal, or for one step."""
    try:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    except ImportError:
        yield lambda what: None
        return
    console = Console(stderr=True)
    parts = (TextColumn("{task.description:<32.32}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*parts, console=console, transient=True, disable=total < 2 or not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        done = -1

        def begin(what: str) -> None:
            nonlocal done
            done += 1
            bar.update(task, completed=done, description=what)

        yield begin


def fold(text: str, first: str = "  ") -> None:
    """Print a text folded to the terminal, later lines under the text of the first."""
    import textwrap

    width = shutil.get_terminal_size((WIDE, 24)).columns if sys.stdout.isatty() else WIDE
    print(textwrap.fill(text, max(40, width), initial_indent=first, subsequent_indent=" " * len(first)))


def finite(x: float | None) -> float | None:
    """A number that JSON can hold."""
    return x if x is not None and math.isfinite(x) else None
