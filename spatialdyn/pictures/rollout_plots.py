"""``Rollout.plot``: the median and the band of a batch of motions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import SpatialDynError
from ..simulation.rollout_result import Rollout
from .coordinates import Coordinate, chosen, coordinates, title
from .figures import COLOURS, DASHES, FAINT, LIMIT, check_path, plain, written
from .panels import Panel, grid, heading, in_view, names_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND = (5.0, 50.0, 95.0)  # percentiles


def plot_rollout(found: Rollout, what: Any, joints: Any, sample: Any, ax: Any, path: Any) -> Figure:
    """``Rollout.plot``."""
    (name,) = names_of(what, ("q", "v"))
    check_path(path)
    values = np.asarray(getattr(found, name))
    if found.t.ndim == 0:
        raise SpatialDynError('rollout holds the last states only, expected others too: record=1 in place of "last"')
    values = values if values.ndim == 3 else values[None]
    if not values.size:
        raise SpatialDynError(f"rollout has {name} of shape {values.shape}, expected samples to draw")
    if sample is not None and not (isinstance(sample, (int, np.integer)) and 0 <= sample < len(values)):
        raise SpatialDynError(f"sample is {sample!r}, expected a number from 0 to {len(values) - 1}")
    columns = chosen(coordinates(found.model, name, values.shape[2]), found.model, joints)
    whole = np.isfinite(values).all(axis=(1, 2))

    def panel(x: Coordinate) -> Panel:
        def draw(axes: Axes, _: Any) -> None:
            heading(axes, x.label)
            axes.set_ylabel(title(name, x.unit))
            y = shown = values[whole, :, x.column].astype(float)
            if len(y) > 1:
                low, middle, high = shown = np.percentile(y, BAND, axis=0)
                axes.fill_between(found.t, low, high, color=COLOURS[0], alpha=0.22, linewidth=0)
                axes.plot(found.t, low, color=COLOURS[0], linewidth=0.5)
                axes.plot(found.t, high, color=COLOURS[0], linewidth=0.5)
                axes.plot(found.t, middle, color=COLOURS[0], linewidth=1.5)
            elif len(y):
                axes.plot(found.t, y[0], color=COLOURS[0], linewidth=1.5)
            if sample is not None:
                one = values[sample, :, x.column].astype(float)
                axes.plot(found.t, one, color=COLOURS[1], linewidth=1.0, linestyle=DASHES[1])
                shown = np.vstack([shown, one])
            for limit in (x.lower, x.upper):
                if np.isfinite(limit):
                    axes.axhline(limit, color=FAINT, linestyle=LIMIT, linewidth=0.9, gid="limit")
            in_view(axes, shown.reshape(-1, 1), [x._replace(column=0)])

        return Panel(f"{name} of {x.label}", draw)

    figure = grid([panel(x) for x in columns], ax, np.array([0.0, found.t[-1]]))
    if ax is None:
        figure.suptitle(plain(_rollout_title(found, whole)), fontsize="medium")
        _rollout_keys(figure, int(whole.sum()), sample)
    return written(figure, path)


def _rollout_title(found: Rollout, whole: Any) -> str:
    lost = f", {int((~whole).sum())} not finite and left out" if not whole.all() else ""
    count = len(whole)
    return f"{found.model.name}: rollout of {count} sample{'s' if count > 1 else ''}{lost}"


def _rollout_keys(figure: Figure, count: int, sample: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys: list[Any] = []
    if count > 1:
        keys += [
            Line2D([], [], color=COLOURS[0], linewidth=1.5, label="median"),
            Patch(facecolor=COLOURS[0], alpha=0.22, label="5 to 95 % of the samples"),
        ]
    if sample is not None:
        keys.append(Line2D([], [], color=COLOURS[1], linestyle=DASHES[1], label=f"sample {sample}"))
    if any(line.get_gid() == "limit" and _seen(line) for axes in figure.axes for line in axes.lines):
        keys.append(Line2D([], [], color=FAINT, linestyle=LIMIT, linewidth=0.9, label="limits"))
    if keys:
        figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), frameon=False)


def _seen(line: Any) -> bool:
    """Whether a horizontal line is within its axes."""
    low, high = line.axes.get_ylim()
    return bool(low <= line.get_ydata()[0] <= high)
