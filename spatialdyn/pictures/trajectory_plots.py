"""``Trajectory.plot``: states over time, energies, phases and shares of limits of one motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import PAIR, kind_of
from ..calls.dynamics import calls
from ..errors import SpatialDynError
from ..simulation.trajectory import Trajectory
from .contact_plots import contact_panels
from .coordinates import SYMBOLS, UNITS, Coordinate, by_unit, chosen, coordinates, title
from .figures import DASHES, FAINT, check_path, dash, legend, plain, tidy, written
from .panels import (
    Panel,
    draw_limits,
    drift,
    fit_legends,
    in_view,
    least_span,
    names_of,
    note,
    padded,
    shades,
    stacked,
    time_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
WHAT = ("q", "v", "tau", "p", "energy", "phase", "limits", "contacts")
NAMED = 2  # joints that a panel names as beyond their limits
FAR = 5.0  # times a limit: beyond, the axis is logarithmic outside the limits


def plot_trajectory(run: Trajectory, what: Any, joints: Any, ax: Any, path: Any) -> Figure:
    """``Trajectory.plot``."""
    names = names_of(what, WHAT)
    check_path(path)
    if not len(run):
        raise SpatialDynError(f"trajectory of {run.robot} is empty, expected samples to draw")
    make = {"energy": _energy, "phase": _phase, "limits": _limits, "contacts": _touching}
    panels: list[Panel] = []
    for name in names:
        panels += make[name](run, joints) if name in make else _states(run, name, joints)
    figure, rows = stacked(panels, ax)
    heading = f"{run.robot}: {run.method}, dt {run.dt:g} s" + (", interrupted" if run.interrupted else "")
    if ax is None:
        rows[0].set_title(plain(heading), fontsize="medium", loc="left")
    for k, (axes, panel, ink) in enumerate(zip(rows, panels, shades(panels), strict=True)):
        tidy(axes)
        panel.draw(axes, ink)
        if panel.over_time:
            time_axis(axes, run.t, last=ax is not None or k + 1 == len(panels) or not panels[k + 1].over_time)
    if ax is None:
        fit_legends(figure, rows)
    return written(figure, path)


def _states(run: Trajectory, name: str, joints: Any) -> list[Panel]:
    """Panels for angles, for lengths and for coordinates of unit norm, if there are any."""
    values = getattr(run, name)
    columns = chosen(coordinates(run.model, name, values.shape[1]), run.model, joints)
    if not columns:
        raise SpatialDynError(f"{name} of {run.robot} has no columns to draw")

    def panel(unit: str, group: list[Coordinate]) -> Panel:
        def draw(axes: Axes, ink: Sequence[Any]) -> None:
            axes.set_ylabel(title(name, unit))
            _lines(axes, run.t, values, group, ink)
            if in_view(axes, values, group, least_span(run.model, unit, values[:, [x.column for x in group]])):
                note(axes, "dotted: limits")

        return Panel(f"{name} [{unit}]", draw, [x.label for x in group])

    return [panel(unit, group) for unit, group in by_unit(columns).items()]


def _lines(axes: Axes, t: Array, values: Array, columns: Sequence[Coordinate], ink: Sequence[Any]) -> None:
    """A line for each column, its limits, and a legend."""
    lines = []
    for k, (x, colour) in enumerate(zip(columns, ink, strict=True)):
        y = values[:, x.column]
        marker = "o" if len(t) == 1 else ""
        lines += axes.plot(t, y, color=colour, linestyle=dash(k, len(columns)), linewidth=1.3, marker=marker)
    draw_limits(axes, columns, ink)
    legend(axes, lines, [x.label for x in columns])


def _energy(run: Trajectory, joints: Any) -> list[Panel]:
    """T, V and their sum, and the change of the sum on a logarithmic axis."""
    shown = {"T + V": run.energy}
    if run.model is not None:
        T = np.asarray(calls["kinetic_energy"](run.model, run.q, run.v))
        shown = {"T kinetic": T, "V potential": run.energy - T, **shown}
    styles = (DASHES[1], DASHES[2], DASHES[0])[-len(shown) :]

    def parts(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel("energy [J]")
        lines = [
            axes.plot(run.t, y, color=colour, linestyle=style, linewidth=1.3, marker="o" if len(run) == 1 else "")[0]
            for y, colour, style in zip(shown.values(), ink, styles, strict=True)
        ]
        legend(axes, lines, list(shown))
        values = np.array([*shown.values()])
        axes.set_ylim(*padded(values, least_span(run.model, "J", values)))

    def change(axes: Axes, ink: Sequence[Any]) -> None:
        drift(axes, [run], ink[-1:])

    return [Panel("energy [J]", parts, list(shown)), Panel("drift [J]", change, list(shown))]


def _phase(run: Trajectory, joints: Any) -> list[Panel]:
    """The velocity against the position of each joint of one freedom, with a dot at the beginning."""
    if run.model is None:
        raise SpatialDynError("the trajectory was loaded without its model, expected one to draw phases")
    model, found = run.model, []
    single = {j.name: j for j in model.joints[1:] if j.nv == 1 and j.mimic is None}
    columns = chosen(coordinates(model, "v", model.nv), model, joints)
    for x in columns:
        joint = single.get(x.joint)
        if joint is not None:
            q = run.q[:, joint.idx_q]
            if kind_of(joint.kind, model.options.continuous).turn == PAIR:
                q = np.unwrap(np.arctan2(run.q[:, joint.idx_q + 1], q))
            found.append((x, q))
    if not found:
        raise SpatialDynError(
            f"{run.robot} has no joint of one freedom among those asked for, expected one for a phase"
        )

    def panel(unit: str, group: list[Coordinate]) -> Panel:
        angular = unit == UNITS["v"][0]

        def draw(axes: Axes, ink: Sequence[Any]) -> None:
            axes.set(xlabel=title("q", UNITS["q"][not angular]), ylabel=title("v", unit))
            lines = []
            for k, (x, colour) in enumerate(zip(group, ink, strict=True)):
                q = next(q for other, q in found if other.column == x.column)
                style = dash(k, len(group))
                lines += axes.plot(q, run.v[:, x.column], color=colour, linewidth=1.0, linestyle=style)
                axes.plot(q[0], run.v[0, x.column], "o", color=colour, markersize=5)
            legend(axes, lines, [x.label for x in group])
            note(axes, "dots: the beginning")
            across = np.array([q for other, q in found if other in group])
            upward = run.v[:, [x.column for x in group]]
            axes.set_xlim(*padded(across, least_span(model, UNITS["q"][not angular], across)))
            axes.set_ylim(*padded(upward, least_span(model, unit, upward)))

        return Panel(f"phase [{unit}]", draw, [x.label for x in group], over_time=False)

    return [panel(unit, group) for unit, group in by_unit([x for x, _ in found]).items()]


def _limits(run: Trajectory, joints: Any) -> list[Panel]:
    """q, v and τ, if torques act, as fractions of their limits: ±1 are the limits, beyond them the panel is shaded."""
    if run.model is None:
        raise SpatialDynError("the trajectory was loaded without its model, expected one to draw limits")
    panels: list[Panel] = []
    for name, word in (("q", "position"), ("v", "velocity"), ("tau", "effort")):
        values = getattr(run, name)
        columns = chosen(coordinates(run.model, name, values.shape[1]), run.model, joints)
        bounded = [x for x in columns if np.isfinite(x.lower) and np.isfinite(x.upper) and x.upper > x.lower]
        if bounded and (name != "tau" or not panels or np.nan_to_num(values).any()):
            panels.append(_limit_panel(run, values, bounded, SYMBOLS[name], word))
    if not panels:
        raise SpatialDynError(f"{run.robot} has no limits on the joints asked for, expected some to draw")
    return panels


def _touching(run: Trajectory, joints: Any) -> list[Panel]:
    """The panels of contact points, which belong to no joint."""
    return contact_panels(run)


def _limit_panel(run: Trajectory, values: Array, columns: list[Coordinate], symbol: str, word: str) -> Panel:
    middle = np.array([0.5 * (x.lower + x.upper) for x in columns])
    half = np.array([0.5 * (x.upper - x.lower) for x in columns])
    share = (values[:, [x.column for x in columns]] - middle) / half

    def draw(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel(f"{symbol} / {word} limit")
        seen = share[np.isfinite(share)]
        edge = max(1.25, 1.08 * float(abs(seen).max(initial=0.0)))
        axes.axhspan(1.0, edge, color="#d95f02", alpha=0.15, linewidth=0)
        axes.axhspan(-edge, -1.0, color="#d95f02", alpha=0.15, linewidth=0)
        axes.axhline(1.0, color=FAINT, linewidth=0.9)
        axes.axhline(-1.0, color=FAINT, linewidth=0.9)
        shown = [x._replace(column=k, lower=-np.inf, upper=np.inf) for k, x in enumerate(columns)]
        _lines(axes, run.t, share, shown, ink)
        if edge > FAR:
            axes.set_yscale("symlog", linthresh=1.0, linscale=1.0)
            axes.set_yticks([-edge_tick(edge), -1.0, 0.0, 1.0, edge_tick(edge)])
            axes.yaxis.set_major_formatter("{x:g}")
            axes.minorticks_off()
        axes.set_ylim(-edge, edge)
        beyond = [x.label for x, s in zip(columns, share.T, strict=True) if (abs(s) > 1.0).any()]
        if beyond:
            more = f" and {len(beyond) - NAMED} more" if len(beyond) > NAMED else ""
            note(axes, f"beyond: {', '.join(beyond[:NAMED])}{more}", "#a04400")

    return Panel(f"{symbol} / limit", draw, [x.label for x in columns])


def edge_tick(edge: float) -> float:
    """The largest power of ten within the edge."""
    return float(10.0 ** np.floor(np.log10(edge)))
