"""How far a simulation is, told to whoever asks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import SpatialDynError

Progress = bool | Callable[[int, int], None]


@contextmanager
def reporting(progress: Progress) -> Iterator[Callable[[int, int], None]]:
    """What is to be called with the steps done and their total: nothing, a function of the user's, or rich's bar.

    Raises SpatialDynError for True where rich is not installed.
    """
    if callable(progress):
        yield progress
        return
    if not progress:
        yield lambda done, total: None
        return
    try:
        from rich.console import Console
        from rich.progress import Progress as Bar
    except ImportError as error:
        raise SpatialDynError('progress=True needs rich; pip install "spatialdyn[rich]" or pass a function') from error
    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("simulate", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
