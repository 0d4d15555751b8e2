"""``EnergyLedger.plot``: the works that change the energy of a motion, and the integrator's error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_word
from ..errors import SpatialDynError
from ..monitors.ledger import EnergyLedger
from .figures import DASHES, FAINT, check_path, dash, legend, plain, tidy, written
from .panels import Panel, fit_legends, least_span, logarithmic, padded, shades, stacked, time_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
ENERGY = "change of T + V"
RESTING = 1e-12  # J: smaller works are rounding errors


def plot_ledger(ledger: EnergyLedger, kind: str | None, ax: Any, path: Any) -> Figure:
    """``EnergyLedger.plot``."""
    check_path(path)
    if not len(ledger.t):
        raise SpatialDynError(f"ledger of {ledger.robot} is empty, expected samples to draw")
    if kind is not None:
        as_word("kind", kind, ledger.work)
    if kind is None:
        lines = {f"work of {name}": x.sum(axis=1) for name, x in ledger.work.items()}
        shown, heading = {ENERGY: ledger.change, **lines}, "energy and work [J]"
    else:
        shown = dict(zip(ledger.labels[kind], ledger.work[kind].T, strict=True))
        heading = f"work of {kind} [J]"

    def works(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel(heading)
        axes.axhline(0.0, color=FAINT, linewidth=0.8)
        handles = _lines(axes, ledger.t, shown, ink)
        values = np.array([*shown.values()])
        axes.set_ylim(*padded(values, max(least_span(None, "J", values), RESTING)))
        legend(axes, handles, list(shown))

    def error(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel("|ε| [J]")
        logarithmic(axes, [(ledger.t, ledger.error, 0, ink[0])])

    panels = [Panel(heading, works, list(shown)), Panel("|ε| [J]", error, ["ε, of the integrator"])]
    figure, rows = stacked(panels, ax)
    if ax is None:
        rows[0].set_title(plain(f"energy ledger of {ledger.robot}: {ledger.method}"), fontsize="medium", loc="left")
    for k, (axes, panel, ink) in enumerate(zip(rows, panels, shades(panels), strict=True)):
        tidy(axes)
        panel.draw(axes, ink)
        time_axis(axes, ledger.t, last=ax is not None or k + 1 == len(panels))
    if ax is None:
        fit_legends(figure, rows)
    return written(figure, path)


def _lines(axes: Axes, t: Array, shown: dict[str, Array], ink: Sequence[Any]) -> list[Any]:
    """A line for each; the energy is thick and under the works, which often lie on it."""
    handles = []
    for k, (name, y) in enumerate(shown.items()):
        energy = name == ENERGY
        style = DASHES[0] if energy else DASHES[1 + (k - 1) % 3] if ENERGY in shown else dash(k, len(shown))
        handles += axes.plot(
            t, y, color=ink[k], linestyle=style, linewidth=2.6 if energy else 1.3, alpha=0.6 if energy else 1.0,
            marker="o" if len(t) == 1 else "",
        )  # fmt: skip
    return handles
