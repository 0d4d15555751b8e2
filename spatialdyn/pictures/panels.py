"""Panels of a figure over time: layout, names and scales."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..simulation.trajectory import Trajectory
from .coordinates import Coordinate, natural_scale
from .figures import COLOURS, FAINT, LIMIT, colours, dash, given_axes, legend_height, log_ticks, new_figure, plain, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Draw = Callable[["Axes", Sequence[Any]], None]
WIDTH = 7.5  # inches, of a figure of one column with a legend of
BARE = 5.8  # inches less
MOST = 24  # panels of a grid
PAD = 0.06  # of the height of a panel: free space above and below
LEAST = 1e-9  # of a quantity's scale: smaller differences are no motion
NEAR = 0.35  # of the height of a panel: limits as near to a motion are in view


class Panel(NamedTuple):
    """One pair of axes.

    name       the quantity shown
    draw       function of the axes and a colour for each label
    labels     names of its lines
    over_time  whether x is time
    """

    name: str
    draw: Draw
    labels: Sequence[str] = ()
    over_time: bool = True


def names_of(what: Any, known: Sequence[str]) -> list[str]:
    """The names of quantities in an argument, one or several. Raises SpatialDynError for another."""
    try:
        names = [what] if isinstance(what, str) else list(what)
    except TypeError:
        names = []
    if not names or not all(isinstance(name, str) and name in known for name in names):
        file = f"; plot(path={literal(what)}) writes a file" if isinstance(what, str) and "." in what else ""
        raise SpatialDynError(f"plot of {literal(what)}, expected some of {', '.join(known)}{file}")
    return names


def stacked(panels: Sequence[Panel], ax: Any) -> tuple[Figure, list[Axes]]:
    """Axes one below the other, as high as their legends need, or the given ones."""
    given = given_axes(ax, [panel.name for panel in panels])
    if given is not None:
        return given
    heights = [max(1.9 if panel.over_time else 3.4, legend_height(len(panel.labels))) for panel in panels]
    figure = new_figure(WIDTH, sum(heights) + 0.35 * len(panels) + 0.4)
    return figure, list(figure.subplots(len(panels), 1, height_ratios=heights, squeeze=False)[:, 0])


def shades(panels: Sequence[Panel]) -> list[list[Any]]:
    """Colours for the lines of each panel: one for each name in the figure if there are enough, else by panel."""
    names = dict.fromkeys(label for panel in panels for label in panel.labels)
    if len(names) > len(COLOURS):
        return [colours(len(panel.labels)) for panel in panels]
    of = dict(zip(names, COLOURS, strict=False))
    return [[of[label] for label in panel.labels] for panel in panels]


def fit_legends(figure: Figure, rows: Sequence[Axes]) -> None:
    """Widen a figure by what its widest legend, beside the axes, takes beyond its share."""
    legends = [found for axes in rows if (found := axes.get_legend()) is not None]
    widest = max((found.get_window_extent().width / figure.dpi for found in legends), default=0.0)
    figure.set_figwidth(max(WIDTH, BARE + widest))


def grid(panels: Sequence[Panel], ax: Any, t: Array) -> Figure:
    """Panels over the times t in up to three columns, none of them empty; or in the given axes."""
    figure, rows = _cells(panels, ax)
    for axes, panel in zip(rows, panels, strict=True):
        tidy(axes)
        panel.draw(axes, colours(len(panel.labels)))
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
    figure = new_figure((WIDTH, 9.0, 11.0)[across - 1], 2.1 * down + 0.9)
    cells = figure.add_gridspec(down, across)
    return figure, [figure.add_subplot(cells[divmod(k, across)]) for k in range(len(panels))]


def time_axis(axes: Axes, t: Array, last: bool) -> None:
    axes.set_xlim(float(t[0]), float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0)
    if last:
        axes.set_xlabel("t [s]")
    else:
        axes.tick_params(labelbottom=False)


def heading(axes: Axes, text: str) -> None:
    """The title of one of several panels."""
    axes.set_title(plain(text), fontsize="small")


def note(axes: Axes, text: str, color: str = "0.35") -> None:
    """A few words above the right end of the axes."""
    axes.annotate(
        plain(text), (1.0, 1.0), xycoords="axes fraction", ha="right", va="bottom", fontsize="x-small", color=color
    )


def in_view(axes: Axes, values: Array, columns: Sequence[Coordinate], least: float) -> bool:
    """Scale the panel so that the motion fills it, with limits that lie near it; returns whether there are any.

    least  height below which the motion is drawn as none
    """
    y = values[:, [x.column for x in columns]]
    if not np.isfinite(y).any():
        return False
    limits = [limit for x in columns for limit in (x.lower, x.upper) if np.isfinite(limit)]
    low, high = span(y, least)
    height = high - low
    near = [x for x in limits if low - NEAR * height <= x <= high + NEAR * height]
    low, high = min([low, *near]), max([high, *near])
    axes.set_ylim(low - PAD * (high - low), high + PAD * (high - low))
    return bool(near)


def span(y: Array, least: float) -> tuple[float, float]:
    """The ends of an axis that shows finite values among y; a height up to ``least`` is a flat line in its middle."""
    y = y[np.isfinite(y)]
    low, high = float(y.min()), float(y.max())
    if high - low > least:
        return low, high
    half = max(abs(low), abs(high), 0.5)
    return low - half, high + half


def padded(y: Array, least: float) -> tuple[float, float]:
    """``span`` with a margin; 0 to 1 if no value is finite."""
    if not np.isfinite(y).any():
        return 0.0, 1.0
    low, high = span(y, least)
    return low - PAD * (high - low), high + PAD * (high - low)


def least_span(model: Model | None, unit: str, values: Array) -> float:
    """The height of an axis below which values of a unit differ by rounding: a billionth of their scale."""
    return LEAST * max(natural_scale(model, unit), float(abs(values[np.isfinite(values)]).max(initial=0.0)))


def draw_limits(axes: Axes, columns: Sequence[Coordinate], ink: Sequence[Any]) -> None:
    """The limits of columns, dotted in the colour of each, grey where columns share one."""
    limits: dict[float, Any] = {}
    for x, colour in zip(columns, ink, strict=True):
        for limit in (x.lower, x.upper):
            if np.isfinite(limit):
                limits[limit] = FAINT if limit in limits else colour
    for limit, colour in limits.items():
        axes.axhline(limit, color=colour, linestyle=LIMIT, linewidth=0.9, gid="limit")


def drift(axes: Axes, runs: Sequence[Trajectory], ink: Sequence[Any]) -> None:
    """Changes of energy on a logarithmic axis."""
    axes.set_ylabel("|change of T + V| [J]")
    logarithmic(axes, [(run.t, run.energy - run.energy[0], k, ink[k]) for k, run in enumerate(runs)])


def logarithmic(axes: Axes, lines: Sequence[tuple[Array, Array, int, Any]]) -> None:
    """Absolute values on a logarithmic axis, or words where all are 0: (times, values, number of the run, colour)."""
    some = False
    for t, values, k, colour in lines:
        y = np.array(abs(values))
        y[~((y > 0.0) & np.isfinite(y))] = np.nan  # the logarithm of 0 is a gap
        some |= bool(np.isfinite(y).any())
        axes.plot(t, y, color=colour, linewidth=1.2, linestyle=dash_of_run(k), marker="." if len(t) < 3 else "")
    if some:
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
    else:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "exactly 0 at every sample", transform=axes.transAxes, ha="center", va="center")


def dash_of_run(k: int) -> Any:
    """The line style of run k: runs often lie on each other, so that neighbours always differ."""
    return dash(k, len(COLOURS))
