"""The files that a command is to write, looked at before it computes for a minute."""

from __future__ import annotations

from pathlib import Path

from ..errors import SpatialDynError


def check_plot(path: str | None) -> None:
    """Raise SpatialDynError unless a plot can go to a file of this name; None asks for none."""
    if path is None:
        return
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError as error:
        raise SpatialDynError('matplotlib is not installed; pip install "spatialdyn[plot]"') from error
    kinds = FigureCanvasBase.get_supported_filetypes()
    if Path(path).suffix[1:].lower() not in kinds:
        raise SpatialDynError(f"--plot is {path!r}, expected a name that ends in one of .{', .'.join(sorted(kinds))}")
    check_file("--plot", path)


def check_file(option: str, path: str | None) -> None:
    """Raise SpatialDynError if there is no folder for a file of this name; None asks for none."""
    if path is None:
        return
    if Path(path).is_dir():
        raise SpatialDynError(f"{option} is {path!r}, a directory, expected the name of a file")
    if not Path(path).parent.is_dir():
        raise SpatialDynError(f"{option} is {path!r}, expected a name in a folder that is there")
