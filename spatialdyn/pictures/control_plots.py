"""``Path.plot`` and ``Monitor.plot``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..control.paths import Path
from .figures import check_path, dash, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 400  # of a curve


def plot_path(path: Path, file: Any) -> Figure:
    """``Path.plot``."""
    from matplotlib.figure import Figure

    check_path(file)
    t = np.linspace(0.0, path.duration, POINTS)
    figure = Figure(figsize=(6.4, 6.0), layout="constrained")
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
