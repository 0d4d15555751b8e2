"""``sd.plot``: several motions of one robot in the same panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..accuracy.results import Tradeoff
from ..calls.arguments import as_items
from ..calls.dynamics import calls
from ..errors import SpatialDynError, literal
from ..simulation.recorder import scale_of
from ..simulation.rollout_result import Rollout
from ..simulation.trajectory import Trajectory
from ..waiting import watch
from .coordinates import UNITS, Coordinate, by_unit, chosen, coordinates, title
from .figures import check_path, colours, plain, written
from .panels import Panel, dash_of_run, drift, grid, heading, least_span, logarithmic, names_of, padded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
SHARE = 1e-3  # of the energy that a motion exchanges: a smaller change is visible only in the drift
COMPARED = ("q", "v", "tau", "p", "energy", "difference")


@watch.call("plot")
def plot(
    runs: Any,
    what: Any = None,
    *,
    labels: Sequence[str] | None = None,
    joints: Any = None,
    ax: Any = None,
    path: Any = None,
) -> Any:
    """A Matplotlib Figure that compares trajectories, with a panel for each coordinate and a colour for each run.

    runs    sequence of Trajectory of one robot; or one Trajectory, Rollout or Tradeoff, drawn by its method ``plot``
    what    one or several of "q", "v", "tau", "p", "energy" (T + V, and its drift on a log axis) and "difference": the
            largest distance to the first run's positions at the times that both have, on a log axis. By default q and
            energy
    labels  names of the runs, by default their methods and steps
    joints  names of joints, by default all
    ax      Matplotlib axes to draw into, one for each panel
    path    a file to write

    Raises  SpatialDynError for other runs, names or numbers of labels and axes, for more than 24 panels, and if
            matplotlib is not installed; ModelError for an unknown joint.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> runs = [sd.simulate(model, [0.5, -0.3], [0.0, 0.0], 1.0, 0.01, method) for method in ("rk4", "gauss4")]
    >>> len(sd.plot(runs, "q").axes)  # doctest: +SKIP
    2
    """
    if isinstance(runs, (Trajectory, Rollout, Tradeoff)):
        if labels is not None:
            raise SpatialDynError(f"labels is {literal(labels)}, expected None for a single {type(runs).__name__}")
        if isinstance(runs, Tradeoff):
            if not (what is None and joints is None):
                raise SpatialDynError("what and joints apply to motions, expected None for a Tradeoff")
            return runs.plot(path, ax=ax)
        given = {} if what is None else {"what": what}
        return runs.plot(**given, joints=joints, ax=ax, path=path)
    many = _runs_of(runs)
    names = names_of(("q", "energy") if what is None else what, COMPARED)
    words = _labels(many, labels)
    check_path(path)
    panels: list[Panel] = []
    for name in names:
        if name == "energy":
            panels += _energies(many, words)
        elif name == "difference":
            panels += _differences(many, joints, words)
        else:
            panels += _side_by_side(many, name, joints, words)
    figure = grid(panels, ax, max((run.t for run in many), key=lambda t: float(t[-1])))
    if ax is None:
        from matplotlib.lines import Line2D

        keys = [
            Line2D([], [], color=colour, linestyle=dash_of_run(k), label=plain(word))
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
        kinds = ", ".join(type(run).__name__ for run in many) or literal(runs)
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
    """Names of runs: the given ones, or as much of method and step as distinguishes the runs."""
    if labels is not None:
        words = as_items("labels", labels, str, "names of the runs")
        if len(words) != len(runs):
            raise SpatialDynError(f"labels has {len(words)} names, expected {len(runs)}")
        return words
    words = [f"{run.method}, dt {run.dt:g} s" for run in runs]
    return [f"{word} ({k})" if words.count(word) > 1 else word for k, word in enumerate(words, start=1)]


def _model_of(runs: Sequence[Trajectory]) -> Any:
    return next((run.model for run in runs if run.model is not None), None)


def _side_by_side(runs: Sequence[Trajectory], name: str, joints: Any, words: Sequence[str]) -> list[Panel]:
    """A panel for each column, a line for each run."""
    model, count = _model_of(runs), getattr(runs[0], name).shape[1]
    columns = chosen(coordinates(model, name, count), model, joints)
    values = np.concatenate([getattr(run, name) for run in runs])
    least = {
        unit: least_span(model, unit, values[:, [x.column for x in group]]) for unit, group in by_unit(columns).items()
    }

    def panel(x: Coordinate) -> Panel:
        def draw(axes: Axes, ink: Sequence[Any]) -> None:
            heading(axes, x.label)
            axes.set_ylabel(title(name, x.unit))
            for k, (run, colour) in enumerate(zip(runs, ink, strict=True)):
                y = getattr(run, name)[:, x.column]
                axes.plot(run.t, y, color=colour, linestyle=dash_of_run(k), linewidth=1.2)
            axes.set_ylim(*padded(values[:, x.column], least[x.unit]))

        return Panel(f"{name} of {x.label}", draw, words)

    return [panel(x) for x in columns]


def _energies(runs: Sequence[Trajectory], words: Sequence[str]) -> list[Panel]:
    def total(axes: Axes, ink: Sequence[Any]) -> None:
        heading(axes, "energy")
        axes.set_ylabel("T + V [J]")
        for k, (run, colour) in enumerate(zip(runs, ink, strict=True)):
            axes.plot(run.t, run.energy, color=colour, linestyle=dash_of_run(k), linewidth=1.2)
        axes.set_ylim(*padded(np.concatenate([run.energy for run in runs]), SHARE * max(map(_energy_scale, runs))))

    def change(axes: Axes, ink: Sequence[Any]) -> None:
        heading(axes, "drift of energy")
        drift(axes, runs, ink)

    return [Panel("energy [J]", total, words), Panel("drift [J]", change, words)]


def _energy_scale(run: Trajectory) -> float:
    """The energy that a motion exchanges [J], or without its model the energy itself."""
    if run.model is None:
        return float(abs(run.energy).max())
    T = np.asarray(calls["kinetic_energy"](run.model, run.q, run.v))
    return float(scale_of(T, run.energy - T)[-1])


def _differences(runs: Sequence[Trajectory], joints: Any, words: Sequence[str]) -> list[Panel]:
    """The distance of each run from the first, the largest over angles and over lengths."""
    model, first = _model_of(runs), runs[0]
    if model is None or len(runs) < 2:
        raise SpatialDynError("difference needs two runs or more, one of them with its model")
    groups = by_unit(chosen(coordinates(model, "v", model.nv), model, joints))
    found = []
    for run in runs[1:]:
        mine, others = _common(run.t, first.t)
        if len(mine) < 2:
            raise SpatialDynError("runs have fewer than two times in common, expected some for their difference")
        found.append((run.t[mine], abs(np.asarray(calls["difference"](model, first.q[others], run.q[mine])))))

    def panel(unit: str, group: list[Coordinate]) -> Panel:
        columns = [x.column for x in group]
        name = "difference of angles" if unit == UNITS["v"][0] else "difference of lengths"

        def draw(axes: Axes, ink: Sequence[Any]) -> None:
            heading(axes, name)
            axes.set_ylabel(f"largest |difference of q|\nto the first run [{UNITS['q'][unit != UNITS['v'][0]]}]")
            logarithmic(axes, [(t, y[:, columns].max(axis=1), k, ink[k]) for k, (t, y) in enumerate(found, start=1)])

        return Panel(name, draw, words)

    return [panel(unit, group) for unit, group in groups.items()]


def _common(a: Array, b: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the times that two runs share, up to rounding."""
    at = np.clip(np.searchsorted(b, a), 1, len(b) - 1) if len(b) > 1 else np.zeros(len(a), np.intp)
    at = np.where(abs(b[at - 1] - a) < abs(b[at] - a), at - 1, at)
    same = abs(b[at] - a) <= 1e-9 * max(float(abs(b).max()), 1e-300)
    return np.flatnonzero(same), at[same]
