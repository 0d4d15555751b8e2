"""Plots of motions: one trajectory, several beside each other, a batch of rollouts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..accuracy.results import Tradeoff
from ..bodies.kinds import PAIR, kind_of
from ..calls.dynamics import calls
from ..errors import SpatialDynError
from ..simulation.rollouts import Rollout
from ..simulation.trajectory import Trajectory
from .coordinates import SYMBOLS, UNITS, Coordinate, by_unit, chosen, coordinates, title
from .figures import (
    COLOURS,
    DASHES,
    FAINT,
    check_path,
    colours,
    dash,
    given_axes,
    legend,
    log_ticks,
    new_figure,
    plain,
    tidy,
    written,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Draw = Callable[["Axes"], None]
WHAT = ("q", "v", "tau", "p", "energy", "phase", "limits")
COMPARED = ("q", "v", "tau", "p", "energy", "difference")
MOST = 24  # panels of a comparison or a rollout
BAND = (5.0, 50.0, 95.0)  # percentiles of a rollout
NAMED = 2  # joints that a panel names as beyond their limits
FAR = 5.0  # times a limit: beyond, the axis is logarithmic outside the limits
NEAR = 0.35  # of the height of a panel: limits as near to a motion are in view


class Panel(NamedTuple):
    """One pair of axes: its name, the function that draws it, how many entries its legend has, whether x is time."""

    name: str
    draw: Draw
    entries: int = 0
    over_time: bool = True


# --- one trajectory -------------------------------------------------------------------------------------------


def plot_trajectory(run: Trajectory, what: Any, joints: Any, ax: Any, path: Any) -> Figure:
    """``Trajectory.plot``."""
    names = _names(what, WHAT)
    check_path(path)
    if not len(run):
        raise SpatialDynError(f"trajectory of {run.robot} is empty, expected samples to draw")
    make = {"energy": _energy, "phase": _phase, "limits": _limits}
    panels: list[Panel] = []
    for name in names:
        panels += make[name](run, joints) if name in make else _states(run, name, joints)
    figure, rows = _stacked(panels, ax)
    heading = f"{run.robot}: {run.method}, dt {run.dt:g} s" + (", interrupted" if run.interrupted else "")
    if ax is None:
        rows[0].set_title(plain(heading), fontsize="medium", loc="left")
    for k, (axes, panel) in enumerate(zip(rows, panels, strict=True)):
        tidy(axes)
        panel.draw(axes)
        if panel.over_time:
            _time_axis(axes, run.t, last=ax is not None or k + 1 == len(panels) or not panels[k + 1].over_time)
    return written(figure, path)


def _names(what: Any, known: Sequence[str]) -> list[str]:
    """The names of quantities in an argument, one or several. Raises SpatialDynError for another."""
    try:
        names = [what] if isinstance(what, str) else list(what)
    except TypeError:
        names = []
    if not names or not all(isinstance(name, str) and name in known for name in names):
        raise SpatialDynError(f"plot of {what!r}, expected some of {', '.join(known)}")
    return names


def _stacked(panels: Sequence[Panel], ax: Any) -> tuple[Figure, list[Axes]]:
    """Axes one below the other, as high as their legends need, or those that were given."""
    given = given_axes(ax, [panel.name for panel in panels])
    if given is not None:
        return given
    heights = [max(1.9 if panel.over_time else 3.4, 0.19 * min(panel.entries, 14) + 0.3) for panel in panels]
    figure = new_figure(7.5, sum(heights) + 0.35 * len(panels) + 0.4)
    return figure, list(figure.subplots(len(panels), 1, height_ratios=heights, squeeze=False)[:, 0])


def _time_axis(axes: Axes, t: Array, last: bool) -> None:
    axes.set_xlim(float(t[0]), float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0)
    if last:
        axes.set_xlabel("t [s]")
    else:
        axes.tick_params(labelbottom=False)


def _states(run: Trajectory, name: str, joints: Any) -> list[Panel]:
    """A panel for angles, one for lengths, one for coordinates of unit norm, as far as there are any."""
    values = getattr(run, name)
    columns = chosen(coordinates(run.model, name, values.shape[1]), run.model, joints)
    if not columns:
        raise SpatialDynError(f"{name} of {run.robot} has no columns to draw")

    def panel(unit: str, group: list[Coordinate]) -> Panel:
        def draw(axes: Axes) -> None:
            axes.set_ylabel(title(name, unit))
            _lines(axes, run.t, values, group)
            _in_view(axes, values, group)

        return Panel(f"{name} [{unit}]", draw, len(group))

    return [panel(unit, group) for unit, group in by_unit(columns).items()]


def _lines(axes: Axes, t: Array, values: Array, columns: Sequence[Coordinate]) -> None:
    """A line for each column, its limits dashed in the same colour, and a legend."""
    lines = []
    for k, (x, colour) in enumerate(zip(columns, colours(len(columns)), strict=True)):
        y = values[:, x.column]
        marker = "o" if len(t) == 1 else ""
        lines += axes.plot(t, y, color=colour, linestyle=dash(k, len(columns)), linewidth=1.3, marker=marker)
        for limit in (x.lower, x.upper):
            if np.isfinite(limit):
                axes.axhline(limit, color=colour, linestyle=(0, (1, 2)), linewidth=0.9, gid="limit")
    legend(axes, lines, [x.label for x in columns])


def _in_view(axes: Axes, values: Array, columns: Sequence[Coordinate]) -> None:
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


def _energy(run: Trajectory, joints: Any) -> list[Panel]:
    """T, V and their sum, and the change of the sum on a logarithmic axis."""

    def parts(axes: Axes) -> None:
        axes.set_ylabel("energy [J]")
        shown = {"T + V": run.energy}
        if run.model is not None:
            T = np.asarray(calls["kinetic_energy"](run.model, run.q, run.v))
            shown = {"T kinetic": T, "V potential": run.energy - T, **shown}
        lines = [
            axes.plot(run.t, y, color=colour, linestyle=style, linewidth=1.3, marker="o" if len(run) == 1 else "")[0]
            for y, colour, style in zip(shown.values(), COLOURS, (DASHES[1], DASHES[2], DASHES[0]), strict=False)
        ]
        legend(axes, lines, list(shown))

    return [Panel("energy [J]", parts, 3), Panel("drift [J]", lambda axes: _drift(axes, [run], [COLOURS[3]]))]


def _drift(axes: Axes, runs: Sequence[Trajectory], shades: Sequence[Any]) -> None:
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


def _phase(run: Trajectory, joints: Any) -> list[Panel]:
    """The velocity against the position of each joint of one freedom, a dot where it begins."""
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

        def draw(axes: Axes) -> None:
            axes.set(xlabel=title("q", UNITS["q"][not angular]), ylabel=title("v", unit))
            lines = []
            for k, (x, colour) in enumerate(zip(group, colours(len(group)), strict=True)):
                q = next(q for other, q in found if other.column == x.column)
                style = dash(k, len(group))
                lines += axes.plot(q, run.v[:, x.column], color=colour, linewidth=1.0, linestyle=style)
                axes.plot(q[0], run.v[0, x.column], "o", color=colour, markersize=5)
            legend(axes, lines, [x.label for x in group])
            note = "dots: the beginning"
            axes.annotate(
                note, (1.0, 1.0), xycoords="axes fraction", ha="right", va="bottom", fontsize="x-small", color="0.35"
            )

        return Panel(f"phase [{unit}]", draw, len(group), over_time=False)

    return [panel(unit, group) for unit, group in by_unit([x for x, _ in found]).items()]


def _limits(run: Trajectory, joints: Any) -> list[Panel]:
    """q, v and τ as fractions of their limits: ±1 are the limits, beyond them the panel is shaded."""
    if run.model is None:
        raise SpatialDynError("the trajectory was loaded without its model, expected one to draw limits")
    panels = []
    for name, word in (("q", "position"), ("v", "velocity"), ("tau", "effort")):
        values = getattr(run, name)
        columns = chosen(coordinates(run.model, name, values.shape[1]), run.model, joints)
        bounded = [x for x in columns if np.isfinite(x.lower) and np.isfinite(x.upper) and x.upper > x.lower]
        if bounded:
            panels.append(_limit_panel(run, values, bounded, SYMBOLS[name], word))
    if not panels:
        raise SpatialDynError(f"{run.robot} has no limits on the joints asked for, expected some to draw")
    return panels


def _limit_panel(run: Trajectory, values: Array, columns: list[Coordinate], symbol: str, word: str) -> Panel:
    middle = np.array([0.5 * (x.lower + x.upper) for x in columns])
    half = np.array([0.5 * (x.upper - x.lower) for x in columns])
    share = (values[:, [x.column for x in columns]] - middle) / half

    def draw(axes: Axes) -> None:
        axes.set_ylabel(f"{symbol} / {word} limit")
        seen = share[np.isfinite(share)]
        edge = max(1.25, 1.08 * float(abs(seen).max(initial=0.0)))
        axes.axhspan(1.0, edge, color="#d95f02", alpha=0.15, linewidth=0)
        axes.axhspan(-edge, -1.0, color="#d95f02", alpha=0.15, linewidth=0)
        axes.axhline(1.0, color=FAINT, linewidth=0.9)
        axes.axhline(-1.0, color=FAINT, linewidth=0.9)
        shown = [x._replace(column=k, lower=-np.inf, upper=np.inf) for k, x in enumerate(columns)]
        _lines(axes, run.t, share, shown)
        if edge > FAR:
            axes.set_yscale("symlog", linthresh=1.0, linscale=1.0)
            axes.set_yticks([-edge_tick(edge), -1.0, 0.0, 1.0, edge_tick(edge)])
            axes.yaxis.set_major_formatter("{x:g}")
            axes.minorticks_off()
        axes.set_ylim(-edge, edge)
        beyond = [x.label for x, s in zip(columns, share.T, strict=True) if (abs(s) > 1.0).any()]
        if beyond:
            more = f" and {len(beyond) - NAMED} more" if len(beyond) > NAMED else ""
            axes.annotate(
                plain(f"beyond: {', '.join(beyond[:NAMED])}{more}"), (1.0, 1.0), xycoords="axes fraction", ha="right",
                va="bottom", fontsize="x-small", color="#a04400",
            )  # fmt: skip

    return Panel(f"{symbol} / limit", draw, len(columns))


def edge_tick(edge: float) -> float:
    """The largest power of ten within the edge."""
    return float(10.0 ** np.floor(np.log10(edge)))


# --- several --------------------------------------------------------------------------------------------------


def plot(
    runs: Any,
    what: Any = None,
    *,
    labels: Sequence[str] | None = None,
    joints: Any = None,
    ax: Any = None,
    path: Any = None,
) -> Any:
    """A Matplotlib Figure of trajectories beside each other, a panel for each coordinate, a colour for each run.

    runs    sequence of Trajectory of one robot; or one Trajectory, Rollout or Tradeoff, as its method ``plot`` draws it
    what    one or several of "q", "v", "tau", "p", "energy" (T + V, and its drift on a log axis) and "difference": the
            largest distance to the first run's positions at the times that both have, on a log axis. By default q and
            energy
    labels  names of the runs, by default their methods and steps
    joints  names of joints, by default all
    ax      Matplotlib axes to draw into, one for each panel
    path    a file to write

    Raises  SpatialDynError for other runs, names or numbers of labels and axes, for more than 24 panels, and where
            matplotlib is not installed; ModelError for an unknown joint.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> runs = [sd.simulate(model, [0.5, -0.3], [0.0, 0.0], 1.0, 0.01, method) for method in ("rk4", "gauss4")]
    >>> len(sd.plot(runs, "q").axes)  # doctest: +SKIP
    2
    """
    if isinstance(runs, (Trajectory, Rollout, Tradeoff)):
        if labels is not None:
            raise SpatialDynError(f"labels is {labels!r}, expected None for a single {type(runs).__name__}")
        if isinstance(runs, Tradeoff):
            if not (what is None and joints is None):
                raise SpatialDynError("what and joints are of motions, expected None for a Tradeoff")
            return runs.plot(path, ax=ax)
        given = {} if what is None else {"what": what}
        return runs.plot(**given, joints=joints, ax=ax, path=path)
    many = _runs_of(runs)
    names = _names(("q", "energy") if what is None else what, COMPARED)
    words = _labels(many, labels)
    check_path(path)
    panels: list[Panel] = []
    for name in names:
        if name == "energy":
            panels += _energies(many)
        elif name == "difference":
            panels += _differences(many, joints)
        else:
            panels += _side_by_side(many, name, joints)
    figure, grid = _grid(panels, ax)
    for axes, panel in zip(grid, panels, strict=True):
        tidy(axes)
        panel.draw(axes)
        longest = max(many, key=lambda run: float(run.t[-1]))
        _time_axis(axes, longest.t, last=True)
    if ax is None:
        from matplotlib.lines import Line2D

        keys = [
            Line2D([], [], color=colour, linestyle=dash(k, 5), label=plain(word))
            for k, (colour, word) in enumerate(zip(colours(len(many)), words, strict=True))
        ]
        figure.suptitle(plain(many[0].robot), fontsize="medium")
        figure.legend(
            handles=keys, loc="outside lower center", ncols=min(len(keys), 4), frameon=False, handlelength=3.0
        )
    return written(figure, path)


def _runs_of(runs: Any) -> list[Trajectory]:
    """Trajectories of one robot, at least one. Raises SpatialDynError."""
    try:
        many = list(runs)
    except TypeError:
        many = []
    if not many or not all(isinstance(run, Trajectory) for run in many):
        kinds = ", ".join(type(run).__name__ for run in many) or repr(runs)
        raise SpatialDynError(f"runs are {kinds}, expected trajectories, or one Rollout or Tradeoff")
    for run in many:
        if run.q.shape[1:] != many[0].q.shape[1:] or run.v.shape[1:] != many[0].v.shape[1:]:
            raise SpatialDynError(
                f"runs are of {many[0].robot} with {many[0].v.shape[1]} freedoms and of {run.robot} with "
                f"{run.v.shape[1]}, expected one robot"
            )
        if not len(run):
            raise SpatialDynError(f"trajectory of {run.robot} is empty, expected samples to draw")
    return many


def _labels(runs: Sequence[Trajectory], labels: Any) -> list[str]:
    """Names of runs: those given, or as much of method and step as tells them apart."""
    if labels is not None:
        words = [labels] if isinstance(labels, str) else list(labels)
        if len(words) != len(runs):
            raise SpatialDynError(f"labels has {len(words)} names, expected {len(runs)}")
        return [str(word) for word in words]
    words = [f"{run.method}, dt {run.dt:g} s" for run in runs]
    return [f"{word} ({k})" if words.count(word) > 1 else word for k, word in enumerate(words, start=1)]


def _grid(panels: Sequence[Panel], ax: Any) -> tuple[Figure, list[Axes]]:
    """Axes in up to three columns, none of them empty."""
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


def _model_of(runs: Sequence[Trajectory]) -> Any:
    return next((run.model for run in runs if run.model is not None), None)


def _side_by_side(runs: Sequence[Trajectory], name: str, joints: Any) -> list[Panel]:
    """A panel for each column, a line for each run."""
    model, count = _model_of(runs), getattr(runs[0], name).shape[1]

    def panel(x: Coordinate) -> Panel:
        def draw(axes: Axes) -> None:
            axes.set_title(plain(x.label), fontsize="small")
            axes.set_ylabel(title(name, x.unit))
            for k, (run, colour) in enumerate(zip(runs, colours(len(runs)), strict=True)):
                axes.plot(run.t, getattr(run, name)[:, x.column], color=colour, linestyle=dash(k, 5), linewidth=1.2)

        return Panel(f"{name} of {x.label}", draw)

    return [panel(x) for x in chosen(coordinates(model, name, count), model, joints)]


def _energies(runs: Sequence[Trajectory]) -> list[Panel]:
    def total(axes: Axes) -> None:
        axes.set_ylabel("T + V [J]")
        for k, (run, colour) in enumerate(zip(runs, colours(len(runs)), strict=True)):
            axes.plot(run.t, run.energy, color=colour, linestyle=dash(k, 5), linewidth=1.2)

    return [Panel("energy [J]", total), Panel("drift [J]", lambda axes: _drift(axes, runs, colours(len(runs))))]


def _differences(runs: Sequence[Trajectory], joints: Any) -> list[Panel]:
    """The distance of each run from the first, the largest over angles and over lengths."""
    model, first = _model_of(runs), runs[0]
    if model is None or len(runs) < 2:
        raise SpatialDynError("difference is of two runs or more, one of them with its model")
    groups = by_unit(chosen(coordinates(model, "v", model.nv), model, joints))
    found = []
    for run in runs[1:]:
        mine, others = _common(run.t, first.t)
        if len(mine) < 2:
            raise SpatialDynError("runs have fewer than two times in common, expected some for their difference")
        found.append((run.t[mine], abs(np.asarray(calls["difference"](model, first.q[others], run.q[mine])))))

    def panel(unit: str, group: list[Coordinate]) -> Panel:
        def draw(axes: Axes) -> None:
            axes.set_ylabel(f"largest |difference of q|\nto the first run [{UNITS['q'][unit != UNITS['v'][0]]}]")
            some = False
            for k, ((t, apart), colour) in enumerate(zip(found, colours(len(runs))[1:], strict=True), start=1):
                y = apart[:, [x.column for x in group]].max(axis=1)
                y[~((y > 0.0) & np.isfinite(y))] = np.nan
                some |= bool(np.isfinite(y).any())
                axes.plot(t, y, color=colour, linestyle=dash(k, 5), linewidth=1.2)
            if some:
                axes.set_yscale("log")
                log_ticks(axes.yaxis)

        return Panel(f"difference [{unit}]", draw)

    return [panel(unit, group) for unit, group in groups.items()]


def _common(a: Array, b: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the times that two runs share, up to rounding."""
    at = np.clip(np.searchsorted(b, a), 1, len(b) - 1) if len(b) > 1 else np.zeros(len(a), np.intp)
    at = np.where(abs(b[at - 1] - a) < abs(b[at] - a), at - 1, at)
    same = abs(b[at] - a) <= 1e-9 * max(float(abs(b).max()), 1e-300)
    return np.flatnonzero(same), at[same]


# --- a batch --------------------------------------------------------------------------------------------------


def plot_rollout(found: Rollout, what: Any, joints: Any, sample: Any, ax: Any, path: Any) -> Figure:
    """``Rollout.plot``."""
    (name,) = names = _names(what, ("q", "v"))
    check_path(path)
    values = np.asarray(getattr(found, name))
    if found.t.ndim == 0:
        raise SpatialDynError('rollout holds the last states only, expected others too: record=1 in place of "last"')
    values = values if values.ndim == 3 else values[None]
    if not values.size:
        raise SpatialDynError(f"rollout has {name} of shape {values.shape}, expected samples to draw")
    if sample is not None and not (isinstance(sample, (int, np.integer)) and 0 <= sample < len(values)):
        raise SpatialDynError(f"sample is {sample!r}, expected a number from 0 to {len(values) - 1}")
    columns = chosen(coordinates(found.model, names[0], values.shape[2]), found.model, joints)
    whole = np.isfinite(values).all(axis=(1, 2))

    def panel(x: Coordinate) -> Panel:
        def draw(axes: Axes) -> None:
            axes.set_title(plain(x.label), fontsize="small")
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
                    axes.axhline(limit, color=FAINT, linestyle=(0, (1, 2)), linewidth=0.9, gid="limit")
            _in_view(axes, shown.reshape(-1, 1), [x._replace(column=0)])

        return Panel(f"{name} of {x.label}", draw)

    panels = [panel(x) for x in columns]
    figure, grid = _grid(panels, ax)
    for axes, part in zip(grid, panels, strict=True):
        tidy(axes)
        part.draw(axes)
        _time_axis(axes, np.array([0.0, found.t[-1]]), last=True)
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
    if keys:
        figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), frameon=False)
