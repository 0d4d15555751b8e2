"""Reports of long work: progress to a bar or to a function of the caller, and messages of the logger.

Work that takes more than ``waiting.LONG`` seconds logs one message while it runs, of level INFO of the logger
"spatialdyn". It is visible only after ``logging.basicConfig(level="INFO")`` or the like.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from .. import waiting
from ..engines import locks
from ..errors import SpatialDynError, literal

Report = Callable[[int, int], None]
Progress = bool | Report

locks.come_first()  # before the lock of logging
LOGGER = logging.getLogger(__name__.partition(".")[0])
LOGGER.addHandler(logging.NullHandler())
waiting.watch.tell = LOGGER.info


class _Lines(logging.Handler):
    """Hands the text of each message to a function."""

    def __init__(self, show: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        self._show(record.getMessage())


@contextmanager
def messages(show: Callable[[str], None]) -> Iterator[None]:
    """A context in which ``show`` also gets each message of the logger: for the command line and examples."""
    handler, level = _Lines(show), LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.setLevel(level)
        LOGGER.removeHandler(handler)


def check_progress(progress: object) -> None:
    """Raise SpatialDynError unless it is True, False or a function."""
    if not (isinstance(progress, bool) or callable(progress)):
        raise SpatialDynError(f"progress is {literal(progress)}, expected True, False or a function of two numbers")


@contextmanager
def reporting(progress: Progress, doing: str) -> Iterator[Report]:
    """The function ``report(done, total)``: it does nothing, is the caller's, or moves a bar.

    doing  name of the work, for the bar and the message

    The bar is on stderr, or in the notebook. If the work takes long, one message names it, and what is compiling or how
    many steps are done. Raises SpatialDynError for True in a terminal if rich is not installed.
    """
    at = (0, 0)

    def counted(report: Report) -> Report:
        def count(done: int, total: int) -> None:
            nonlocal at
            at = done, total
            report(done, total)

        return count

    def far() -> str:
        return f": {at[0]} of {at[1]} steps are done" if at[1] else ""

    with waiting.watch.work(doing, far, parts=True):
        if callable(progress):
            yield counted(progress)
        elif progress:
            with bar(doing) as report:
                yield counted(report)
        else:
            yield counted(lambda done, total: None)


def bar(what: str) -> AbstractContextManager[Report]:
    """``pictures.progress_bar``."""
    from ..pictures.progress_bar import progress_bar

    return progress_bar(what)


class Steps:
    """Counts the finished steps of a known total, and reports each."""

    def __init__(self, report: Report, total: int) -> None:
        """Reports that none of ``total`` is done."""
        self._report, self.total, self.done = report, total, 0
        report(0, total)

    def next(self, count: int = 1) -> None:
        """Report that the next ones are done."""
        self.done = min(self.done + count, self.total)
        self._report(self.done, self.total)
