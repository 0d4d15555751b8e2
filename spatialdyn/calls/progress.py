"""Progress reports of calls that take long: to a function of the caller's, or to a bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from ..errors import SpatialDynError

Report = Callable[[int, int], None]
Progress = bool | Report


def check_progress(progress: object) -> None:
    """Raise SpatialDynError unless it is True, False or a function."""
    if not (isinstance(progress, bool) or callable(progress)):
        raise SpatialDynError(f"progress is {progress!r}, expected True, False or a function of two numbers")


@contextmanager
def reporting(progress: Progress, doing: str) -> Iterator[Report]:
    """The function ``report(done, total)``: one that does nothing, the caller's, or one that moves a bar.

    doing  what the bar is of, in words

    The bar is on stderr, or in the notebook. Raises SpatialDynError for True in a terminal where rich is not installed.
    """
    if callable(progress):
        yield progress
        return
    if not progress:
        yield lambda done, total: None
        return
    with bar(doing) as report:
        yield report


def bar(what: str) -> AbstractContextManager[Report]:
    """``pictures.progress_bar``."""
    from ..pictures.progress_bar import progress_bar

    return progress_bar(what)


class Steps:
    """Counts finished steps of a known number, and reports each."""

    def __init__(self, report: Report, total: int) -> None:
        """Reports that none of ``total`` is done."""
        self._report, self.total, self.done = report, total, 0
        report(0, total)

    def next(self, count: int = 1) -> None:
        """Report that the next ones are done."""
        self.done = min(self.done + count, self.total)
        self._report(self.done, self.total)
