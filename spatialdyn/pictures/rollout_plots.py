"""``Rollout.plot``: the median and the band of a batch of motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, literal
from ..simulation.rollout_result import Rollout
from .coordinates import Coordinate, by_unit, chosen, coordinates, title
from .figures import FAINT, check_path, dash, legend, plain, tidy, written
from .panels import Panel, draw_limits, fit_legends, in_view, least_span, names_of, note, shades, stacked, time_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
BAND = (5.0, 50.0, 95.0)  # percentiles
ALPHA = 0.2  # of a band
VEIL = 1.5  # total opacity of many bands, so that lines are visible through them


def plot_rollout(found: Rollout, what: Any, joints: Any, sample: Any, ax: Any, path: Any) -> Figure:
    """``Rollout.plot``."""
    names = names_of(what, ("q", "v"))
    if len(names) != 1:
        raise SpatialDynError(f"what is {literal(what)}, expected one of q, v, whose bands are drawn")
    (name,) = names
    check_path(path)
    values = np.asarray(getattr(found, name))
    if found.t.ndim == 0:
        raise SpatialDynError('rollout holds the last states only, expected others too: record=1 in place of "last"')
    values = values if values.ndim == 3 else values[None]
    if not values.size:
        raise SpatialDynError(f"rollout has {name} of shape {values.shape}, expected samples to draw")
    whole = isinstance(sample, (int, np.integer)) and not isinstance(sample, bool)
    if sample is not None and not (whole and 0 <= sample < len(values)):
        raise SpatialDynError(f"sample is {literal(sample)}, expected a number from 0 to {len(values) - 1}")
    columns = chosen(coordinates(found.model, name, values.shape[2]), found.model, joints)
    whole = np.isfinite(values).all(axis=(1, 2))
    bands = {x.column: _band(values[whole, :, x.column].astype(float)) for x in columns}
    ones = {x.column: values[sample, :, x.column].astype(float) for x in columns if sample is not None}

    def panel(unit: str, group: list[Coordinate]) -> Panel:
        shown = np.vstack([*(bands[x.column] for x in group), *(ones[x.column] for x in group if ones)])

        def draw(axes: Axes, ink: Sequence[Any]) -> None:
            axes.set_ylabel(title(name, unit))
            middles, alpha = [], min(ALPHA, VEIL / len(group))
            for k, (x, colour) in enumerate(zip(group, ink, strict=True)):
                middles += _draw_band(axes, found.t, bands[x.column], colour, dash(k, len(group)), alpha)
                if ones:
                    axes.plot(found.t, ones[x.column], color=colour, linewidth=0.7, gid="sample")
            draw_limits(axes, group, ink)
            legend(axes, middles, [x.label for x in group])
            limited = [x._replace(column=0) for x in group]
            if in_view(axes, shown.reshape(-1, 1), limited, least_span(found.model, unit, shown)):
                note(axes, "dotted: limits")

        return Panel(f"{name} [{unit}]", draw, [x.label for x in group])

    panels = [panel(unit, group) for unit, group in by_unit(columns).items()]
    figure, rows = stacked(panels, ax)
    for k, (axes, one, ink) in enumerate(zip(rows, panels, shades(panels), strict=True)):
        tidy(axes)
        one.draw(axes, ink)
        time_axis(axes, np.append(0.0, found.t), last=ax is not None or k + 1 == len(panels))
    if ax is None:
        figure.suptitle(plain(_title(found, whole)), fontsize="medium")
        _keys(figure, int(whole.sum()), sample)
        fit_legends(figure, rows)
    return written(figure, path)


def _band(y: Array) -> Array:
    """Percentiles (3, N) of samples (S, N); one or no sample is returned as it is."""
    return np.asarray(np.percentile(y, BAND, axis=0)) if len(y) > 1 else y


def _draw_band(axes: Axes, t: Array, band: Array, colour: Any, style: Any, alpha: float) -> list[Any]:
    """A band and its median, or a single sample; returns that line."""
    if len(band) > 1:
        axes.fill_between(t, band[0], band[2], color=colour, alpha=alpha, linewidth=0)
        for edge in (band[0], band[2]):
            axes.plot(t, edge, color=colour, linewidth=0.4, gid="edge")
        band = band[1:2]
    marker = "o" if len(t) == 1 else ""
    return axes.plot(t, band[0] if len(band) else np.full(len(t), np.nan), color=colour, linestyle=style,
                     linewidth=1.5, marker=marker)  # fmt: skip


def _title(found: Rollout, whole: Any) -> str:
    lost = f", {int((~whole).sum())} not finite and left out" if not whole.all() else ""
    count = len(whole)
    return f"{found.model.name}: rollout of {count} sample{'s' if count > 1 else ''}{lost}"


def _keys(figure: Figure, count: int, sample: Any) -> None:
    """The legend of lines and bands, independent of colour; empty for a single line."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys: list[Any] = []
    if count > 1:
        keys += [
            Line2D([], [], color=FAINT, linewidth=1.5, label="median"),
            Patch(facecolor=FAINT, alpha=2.0 * ALPHA, label="5 to 95 % of the samples"),
        ]
    if sample is not None:
        keys.append(Line2D([], [], color=FAINT, linewidth=0.7, label=f"thin: sample {sample}"))
    if keys:
        figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), frameon=False)
