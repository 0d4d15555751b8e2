"""Plots of error against cost."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from ..accuracy.results import Option, Tradeoff
from .figures import (
    FAINT,
    MARKERS,
    by_logarithms,
    colours,
    legend,
    log_ticks,
    one_axes,
    place_labels,
    plain,
    tidy,
    written,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST = 1e-17  # errors below are drawn there: a logarithmic axis has no 0


def plot_tradeoff(found: Tradeoff, ax: Any, path: Any) -> Figure:
    """``Tradeoff.plot``."""
    figure, axes = one_axes(ax, "error against cost", path)
    moves = found.task == "simulate"
    families: dict[str, list[Option]] = {}
    for x in found.options:
        if math.isfinite(x.error):
            families.setdefault(x.name.split(",")[0] if moves else x.name, []).append(x)
    tidy(axes)
    lines, steps, spans = [], [], None
    scale, unit = cost(found)
    shades = colours(len(families))
    for k, (points, colour) in enumerate(zip(families.values(), shades, strict=True)):
        points.sort(key=lambda x: -(step_of(x) or 0.0))  # from the coarsest to the finest
        at = [(scale * x.ns, max(x.error, LEAST)) for x in points]
        lines += axes.plot(
            *zip(*at, strict=True),
            marker=MARKERS[k % len(MARKERS)],
            color=colour,
            linewidth=0.9,
            markersize=5.5,
            linestyle="-" if len(points) > 1 else "",
        )
        known = [(scale * x.ns, max(x.error, LEAST), x.promised) for x in points if math.isfinite(x.promised)]
        if known:
            spans = axes.vlines(*zip(*known, strict=True), color=colour, linewidth=0.9, alpha=0.6)
            axes.plot([x for x, _, _ in known], [top for _, _, top in known], "_", color=colour, markersize=9)
        if moves:
            steps += [(*spot, short(step_of(x)), colour) for x, spot in zip(points, at, strict=True) if step_of(x)]
    front = [(scale * x.ns, x.error) for x in found.front if math.isfinite(x.error)]
    edge = draw_front(axes, front)
    by_logarithms(axes, unit, f"largest error of {found.states} states, relative", x=0.07)
    heading = axes.set_title(plain(f"{found.model}: {found.task.replace('_', ' ')}"), fontsize="medium")
    if moves:
        real_time(axes)
        heading.set_text(plain(f"{found.model}: simulations of {found.duration:g} s"))
    names = [*families, *["front: nothing is both cheaper\nand more accurate"] * len(edge)]
    promised = [] if spans is None else [spans]
    names += ["from the largest error up to what\nits analysis promises"] * len(promised)
    legend(
        axes, [*lines, *edge, *promised], names, "labels: step dt [s],\nrtol of an adaptive method" if moves else None
    )
    if steps:
        place_labels(axes, outermost_first(steps, len(families)))
    return written(figure, path)


def cost(found: Tradeoff) -> tuple[float, str]:
    """The factor of an option's ``ns`` in a plot, and the unit in words."""
    return (1e-6, "ms of computing for a second of motion") if found.task == "simulate" else (1.0, found.unit)


def step_of(x: Option) -> float | None:
    """The step or tolerance in the name of an integrator's option, "rk4, dt 0.01"; None without one."""
    try:
        return float(x.name.rpartition(" ")[2])
    except ValueError:
        return None


def short(number: float | None) -> str:
    """A number in two digits, with no zeros before its exponent: 1e-06 -> 1e-6."""
    mantissa, e, exponent = ("" if number is None else f"{number:.2g}").partition("e")
    return f"{mantissa}e{int(exponent)}" if e else mantissa


def outermost_first(steps: Sequence[Any], families: int) -> list[Any]:
    """Labels of the coarsest and finest step of each family in turn, then of steps between, as far as there is room."""
    by_colour: dict[Any, list[Any]] = {}
    for x in steps:
        by_colour.setdefault(x[3], []).append(x)
    first = [x for group in by_colour.values() for x in (group[0], *group[-1:])]
    return [*dict.fromkeys(first), *(x for x in steps if x not in first)]


def draw_front(axes: Axes, front: Iterable[tuple[float, float]]) -> list[Any]:
    """The Pareto front as a stair of points (cost, error) sorted by cost; its line, or none without points."""
    points = [(cost, max(error, LEAST)) for cost, error in front]
    if not points:
        return []
    return list(
        axes.step(*zip(*points, strict=True), color=FAINT, linestyle=(0, (1, 1.5)), where="post", zorder=0, linewidth=2)
    )


def real_time(axes: Axes) -> Any:
    """A second axis on top of one in ms for a second of motion: how many times faster than the motion itself."""
    top = axes.secondary_xaxis("top", functions=(_per_ms, _per_ms))
    top.set_xlabel("times faster than real time", fontsize="small")
    log_ticks(top.xaxis, tuple(_per_ms(axes.get_xlim())))
    top.tick_params(labelsize="small")
    top.spines["top"].set_visible(False)
    return top


def _per_ms(x: Any) -> Any:
    """1000 / x, both ways."""
    import numpy as np

    with np.errstate(divide="ignore", invalid="ignore"):
        return 1000.0 / np.asarray(x, float)
