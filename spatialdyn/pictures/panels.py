"""Panels of a figure over time: how they are laid out, named and scaled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError
from ..simulation.trajectory import Trajectory
from .coordinates import Coordinate
from .figures import dash, given_axes, log_ticks, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Draw = Callable[["Axes"], None]
MOST = 24  # panels of a grid
NEAR = 0.35  # of the height of a panel: limits as near to a motion are in view


class Panel(NamedTuple):
    """One pair of axes: its name, the function that draws it, how many entries its legend has, whether x is time."""

    name: str
    draw: Draw
    entries: int = 0
    over_time: bool = True


def names_of(what: Any, known: Sequence[str]) -> list[str]:
    """The names of quantities in an argument, one or several. Raises SpatialDynError for another."""
    try:
        names = [what] if isinstance(what, str) else list(what)
    except TypeError:
        names = []
    if not names or not all(isinstance(name, str) and name in known for name in names):
        raise SpatialDynError(f"plot of {what!r}, expected some of {', '.join(known)}")
    return names


def stacked(panels: Sequence[Panel], ax: Any) -> tuple[Figure, list[Axes]]:
    """Axes one below the other, as high as their legends need, or those that were given."""
    given = given_axes(ax, [panel.name for panel in panels])
    if given is not None:
        return given
    heights = [max(1.9 if panel.over_time else 3.4, 0.19 * min(panel.entries, 14) + 0.3) for panel in panels]
    figure = new_figure(7.5, sum(heights) + 0.35 * len(panels) + 0.4)
    return figure, list(figure.subplots(len(panels), 1, height_ratios=heights, squeeze=False)[:, 0])


def grid(panels: Sequence[Panel], ax: Any, t: Array) -> Figure:
    """Panels over the times t in up to three columns, none of them empty; in the axes that were given."""
    figure, rows = _cells(panels, ax)
    for axes, panel in zip(rows, panels, strict=True):
        tidy(axes)
        panel.draw(axes)
        time_axis(axes, t, last=True)
    return figure


def _cells(panels: Sequence[Panel], ax: Any) -> tuple[Figure, list[Axes]]:
    given = given_axes(ax, [panel.name for panel in panels])
    if given is not None:
        return given
    if len(panels) > MOST:
        raise SpatialDynError(
            f"plot has {len(panels)} panels, expected at most {MOST}; choose some with joints=[names]"
        )
    across = 1 if len(panels) <= 2 else 2 if len(panels) <= 4 else 3
    down = -(-len(panels) // across)
    figure = new_figure((7.5, 9.0, 11.0)[across - 1], 2.1 * down + 0.9)
    cells = figure.add_gridspec(down, across)
    return figure, [figure.add_subplot(cells[divmod(k, across)]) for k in range(len(panels))]


def time_axis(axes: Axes, t: Array, last: bool) -> None:
    axes.set_xlim(float(t[0]), float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0)
    if last:
        axes.set_xlabel("t [s]")
    else:
        axes.tick_params(labelbottom=False)


def in_view(axes: Axes, values: Array, columns: Sequence[Coordinate]) -> None:
    """The motion fills the panel; limits that lie near it are in view too."""
    y = values[:, [x.column for x in columns]]
    y = y[np.isfinite(y)]
    if not y.size:
        return
    low, high = float(y.min()), float(y.max())
    height = high - low or 2.0 * max(abs(high), 0.5)  # of a flat line: it is drawn in the middle
    low, high = (low, high) if high > low else (low - 0.5 * height, high + 0.5 * height)
    limits = [limit for x in columns for limit in (x.lower, x.upper) if np.isfinite(limit)]
    near = [x for x in limits if low - NEAR * height <= x <= high + NEAR * height]
    low, high = min([low, *near]), max([high, *near])
    pad = 0.06 * (high - low or height)
    axes.set_ylim(low - pad, high + pad)
    if near:
        axes.annotate(
            "dotted: limits", (1.0, 1.0), xycoords="axes fraction", ha="right", va="bottom", fontsize="x-small",
            color="0.35",
        )  # fmt: skip


def drift(axes: Axes, runs: Sequence[Trajectory], shades: Sequence[Any]) -> None:
    """Changes of energy on a logarithmic axis; "exactly 0" where there is none."""
    axes.set_ylabel("|change of T + V| [J]")
    some = False
    for k, (run, colour) in enumerate(zip(runs, shades, strict=True)):
        change = abs(run.energy - run.energy[0])
        change[~((change > 0.0) & np.isfinite(change))] = np.nan  # the logarithm of 0 is a gap
        some |= bool(np.isfinite(change).any())
        style = dash(k, 5) if len(runs) > 1 else "-"
        axes.plot(run.t, change, color=colour, linewidth=1.1, linestyle=style, marker="." if len(run) < 3 else "")
    if some:
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
    else:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "exactly 0 at every sample", transform=axes.transAxes, ha="center", va="center")
