"""``Path.plot``, ``PassivityRecord.plot`` and ``LyapunovRecord.plot``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..control.paths import Path
from ..errors import ShapeError
from ..monitors.monitors import LyapunovRecord, PassivityRecord
from .figures import check_path, dash, new_figure, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 400  # of a curve


def plot_path(path: Path, file: Any) -> Figure:
    """``Path.plot``."""
    check_path(file)
    if path.batch:
        raise ShapeError(f"path is {path.batch[0]} paths, expected one to draw: path[0].plot()")
    t = np.linspace(0.0, path.duration, POINTS)
    figure = new_figure(6.4, 6.0)
    rows = figure.subplots(3, 1, sharex=True)
    labels = [x.name for x in path.model.joints[1:]] if path.model is not None else []
    for axes, name, values in zip(rows, ("q [rad | m]", "v [rad/s | m/s]", "a [rad/s² | m/s²]"), path(t), strict=True):
        for k, y in enumerate(values.T):
            label = labels[k] if len(labels) == values.shape[1] else f"{k}"
            axes.plot(t, y, linewidth=1.3, linestyle=dash(k, values.shape[1]), label=label)
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
    rows[-1].set_xlabel("t [s]")
    if values.shape[1] <= 12:
        rows[0].legend(fontsize="small", ncols=4)
    return written(figure, file)


def plot_passivity(found: PassivityRecord, file: Any) -> Figure:
    """``PassivityRecord.plot``."""
    figure, (above, below) = _two_rows(file)
    above.plot(found.t, found.supplied, linewidth=1.3, label="supplied")
    above.plot(found.t, found.stored, linewidth=1.3, linestyle=dash(1, 2), label="stored")
    above.set_ylabel("energy [J]")
    above.legend(fontsize="small")
    below.plot(found.t, found.excess, linewidth=1.3)
    below.axhline(0.0, color="black", linewidth=0.8)
    below.set_ylabel("stored - supplied [J]")
    below.set_xlabel("t [s]")
    return written(figure, file)


def plot_lyapunov(found: LyapunovRecord, file: Any) -> Figure:
    """``LyapunovRecord.plot``."""
    figure, (above, below) = _two_rows(file)
    above.plot(found.t, found.value, linewidth=1.3)
    above.set_ylabel("V")
    if (found.value > 0.0).all():
        above.set_yscale("log")
    below.plot(found.t[1:], np.diff(found.value), linewidth=1.3)
    below.axhline(0.0, color="black", linewidth=0.8)
    below.set_ylabel("change of V in a sample")
    below.set_xlabel("t [s]")
    return written(figure, file)


def _two_rows(file: Any) -> tuple[Figure, Any]:
    check_path(file)
    figure = new_figure(6.4, 4.8)
    rows = figure.subplots(2, 1, sharex=True)
    for axes in rows:
        axes.grid(alpha=0.3)
    return figure, rows
