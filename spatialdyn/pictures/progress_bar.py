"""A progress bar: rich's in a terminal, an HTML element in a notebook."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from ..errors import SpatialDynError, pip_install

PAUSE = 0.1  # [s] between two updates of a notebook's bar

Report = Callable[[int, int], None]


@contextmanager
def progress_bar(what: str) -> Iterator[Report]:
    """The function ``report(done, total)`` that moves a bar; the bar disappears at the end.

    Raises SpatialDynError outside a notebook where rich is not installed.
    """
    if in_notebook():
        with _notebook_bar(what) as report:
            yield report
        return
    try:
        from rich.console import Console
        from rich.progress import Progress as Bar
    except ImportError as error:
        raise SpatialDynError(f"progress=True needs rich; {pip_install('rich')} or pass a function") from error
    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def in_notebook() -> bool:
    """Whether this process is a kernel that displays HTML; imports nothing."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and hasattr(shell, "kernel")


def notebook_cell() -> int | None:
    """The number of the cell that runs, None outside a notebook."""
    return sys.modules["IPython"].get_ipython().execution_count if in_notebook() else None


@contextmanager
def _notebook_bar(what: str) -> Iterator[Report]:
    """rich's own bar needs ipywidgets in a notebook; an element that is displayed again needs nothing."""
    from IPython import display as shown

    HTML: Any = shown.HTML
    display: Any = shown.display
    handle = display(HTML(_element(what, 0, 0)), display_id=True)
    last = time.perf_counter()

    def report(done: int, total: int) -> None:
        nonlocal last
        if time.perf_counter() - last > PAUSE:
            last = time.perf_counter()
            handle.update(HTML(_element(what, done, total)))

    try:
        yield report
    finally:
        handle.update(HTML(""))


def _element(what: str, done: int, total: int) -> str:
    share = f' value="{done}" max="{total}"' if total else ""
    words = f"{escape(what)} {done / total:.0%}, {done} of {total} steps" if total else escape(what)
    return f"<div><progress{share}></progress> {words}</div>"
