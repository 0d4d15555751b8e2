"""Checks of output files before a long computation."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from ..calls.files import check_ending
from ..errors import SpatialDynError, literal
from ..pictures.figures import ENDINGS, need_matplotlib
from ..pictures.markup import PAGE_FILES


def check_plot(path: str | None, option: str = "--plot") -> None:
    """Raise SpatialDynError unless a plot can be written to a file of this name; None passes."""
    if path is None:
        return
    Figure = need_matplotlib().figure.Figure
    check_ending(option, path, ENDINGS)
    check_file(option, path)
    figure = Figure()
    figure.subplots()
    try:  # some formats need packages that may be missing
        figure.savefig(io.BytesIO(), format=Path(path).suffix[1:].lower())
    except Exception as error:
        reason = str(error).partition("\n")[0]
        raise SpatialDynError(f"{option} is {literal(path)}, which Matplotlib cannot write: {reason}") from error


def check_report(path: str | None) -> None:
    """Raise SpatialDynError unless a report can be written to a file of this name; None passes."""
    if path is None:
        return
    need_matplotlib()
    check_ending("--report", path, PAGE_FILES)
    check_file("--report", path)


def check_file(option: str, path: str | None, endings: Sequence[str] = ()) -> None:
    """Raise SpatialDynError for a directory, a missing folder, or an ending not among ``endings``; None passes."""
    if path is None:
        return
    if endings:
        check_ending(option, path, endings)
    if Path(path).is_dir():
        raise SpatialDynError(f"{option} is {literal(path)}, a directory, expected the name of a file")
    if not Path(path).parent.is_dir():
        raise SpatialDynError(f"{option} is {literal(path)}, expected a name in a folder that is there")
