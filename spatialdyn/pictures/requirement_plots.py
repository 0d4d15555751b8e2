"""The plot of ``requires``: change against cost, a point for each part in a cheaper form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..accuracy.requirement import Part, Requirement
from .figures import FAINT, by_logarithms, colours, legend, one_axes, place_labels, plain, tidy, written
from .tradeoff_plots import real_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST = 1e-5  # of the tolerance: changes below are drawn there, as a logarithmic axis has no 0
MS = 1e-6  # of a nanosecond
KINDS = {"left out": "left out", "taken": "method and step that are taken", "needed": "needed", "other": "not taken"}
MARKS = {"left out": "o", "taken": "*", "needed": "X", "other": "."}


def plot_requirement(found: Requirement, ax: Any, path: Any) -> Figure:
    """``Requirement.plot``."""
    figure, axes = one_axes(ax, "change against cost", path)
    draw_requirement(axes, found)
    return written(figure, path)


def draw_requirement(axes: Axes, found: Requirement) -> None:
    """Draw into axes."""
    title = f"{found.full.model.name}: what {found.horizon:g} s require within {found.tolerance:g}"
    draw_parts(axes, found.rows, found.path, found.tolerance, title, found.observed)


def draw_parts(
    axes: Axes, rows: Sequence[Part], path: Sequence[Part], tolerance: float, title: str, observed: str
) -> None:
    """Draw parts and the path of a search into axes; ``observed`` is what changes, in words."""
    tidy(axes)
    shades = dict(zip(KINDS, colours(len(KINDS)), strict=True))
    least = LEAST * tolerance
    groups: dict[str, list[Part]] = {}
    for x in rows:
        if math.isfinite(x.change) and math.isfinite(x.ns):
            groups.setdefault(x.verdict if x.verdict in KINDS else "other", []).append(x)
    handles: list[Any] = []
    names: list[str] = []
    for kind, some in groups.items():
        at = [(MS * x.cost, max(x.change, least)) for x in some]
        mark = axes.plot(
            *zip(*at, strict=True), MARKS[kind], color=shades[kind], markersize=11 if kind == "taken" else 7
        )
        handles, names = [*handles, *mark], [*names, KINDS[kind]]
    way = [(MS * x.cost, max(x.change, least)) for x in path]
    handles += axes.plot(*zip(*way, strict=True), ".-", color=shades["left out"], linewidth=1.2, alpha=0.7)
    names.append("from the whole scene\nto the one that is taken")
    handles.append(axes.axhline(tolerance, color=FAINT, linestyle="--", linewidth=1.2))
    names.append("tolerance")
    by_logarithms(axes, "ms of computing for a second of motion", f"largest change of {observed}", x=0.12, y=0.08)
    axes.set_title(plain(f"{title}\n"), fontsize="medium")
    real_time(axes)
    legend(axes, handles, names, f"points at {least:.0e}: that or less")
    words = [(MS * x.cost, max(x.change, least), label(x), shades[kind]) for kind, some in groups.items() for x in some]
    place_labels(axes, [(*way[0], "whole scene", shades["left out"]), *words], 7.5)


def label(x: Part) -> str:
    """A part in few words."""
    if x.part in ("method", "precision"):
        return x.form
    return x.part if x.form in ("left out", "locked") else f"{x.part}: {x.form}"
