"""What ``trade`` has found: every way of doing a task with its error and its cost, as text, JSON and a plot."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..calls.arguments import as_number
from ..errors import ShapeError, SpatialDynError

UNITS = {"simulate": "ns a simulated second"}
INPUTS = {
    "forward_dynamics": ("q", "v", "tau"),
    "inverse_dynamics": ("q", "v", "a"),
    "mass_matrix": ("q",),
    "simulate": ("q0", "v0", "duration"),
}


@dataclass(frozen=True)
class Option:
    """One way of doing a task.

    name    what it is called: engine, dtype and method, or integrator and step
    code    how it is written
    error   the largest of all sampled states, as ``trade`` defines it for the task
    usual   the median of them
    bound   what other states of the same kind stay below: ``error`` times a margin that is larger where errors scatter
    ns      cost [ns] of a sample, or of a simulated second
    best    on the Pareto front: whatever costs less has a larger error
    note    what else there is to say, why it has no error for one
    states  how many states that is of, 0 if those of the table
    run     the way itself: inputs of the call, or (q0, v0, duration), to what the call returns
    """

    name: str
    code: str
    error: float
    usual: float
    bound: float
    ns: float
    best: bool = False
    note: str = ""
    states: int = 0
    run: Callable[..., Any] | None = field(default=None, repr=False, compare=False)


Further = Callable[[Sequence[Option], float], Mapping[str, Any] | None]


@dataclass(frozen=True)
class Tradeoff:
    """Every way of doing a task on a model, the cheapest first.

    model      its name
    task       what is done
    options    tuple of Option
    states     how many states were sampled
    batch      samples of a call, 0 for simulations
    duration   of the simulations [s], 0 for calls
    certainty  how far the truth itself can be trusted: its largest difference to a better one
    truth      what that was, in words
    further    errors of ways in many more states: {name: array} of those that stay within a tolerance, None where that
               takes too long or cannot be told; itself None where states were given
    """

    model: str
    task: str
    options: tuple[Option, ...]
    states: int
    batch: int
    duration: float
    certainty: float
    truth: str
    further: Further | None = field(default=None, repr=False, compare=False)

    @property
    def front(self) -> tuple[Option, ...]:
        """The Pareto front."""
        return tuple(x for x in self.options if x.best)

    def cheapest(self, tolerance: float) -> Option | None:
        """The cheapest way whose bound is within a tolerance, None if there is none.

        Raises  SpatialDynError for a tolerance that is no number above 0.
        """
        within = checked_tolerance(tolerance)
        return next((x for x in self.options if x.bound <= within), None)

    @property
    def unit(self) -> str:
        """What ``ns`` counts."""
        return UNITS.get(self.task, "ns a sample" if self.batch > 1 else "ns a call")

    def to_dict(self) -> dict[str, Any]:
        """All of it as what JSON holds; what is not finite is None."""
        rows = [{k: _json(v) for k, v in vars(x).items() if k not in ("run", "states")} for x in self.options]
        whole = {k: _json(v) for k, v in vars(self).items() if k != "further"}
        return {**whole, "unit": self.unit, "options": rows}

    def to_json(self) -> str:
        """All of it as JSON text."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)

    def rows(self) -> list[list[str]]:
        """Words of a table: mark of the front, name, error, bound, cost, code or note."""
        return [
            [
                "*" if x.best else "", x.name, figure(x.error), figure(x.bound), f"{x.ns:.4g}",
                x.note or x.code,
            ]
            for x in self.options
        ]  # fmt: skip

    @property
    def head(self) -> str:
        """What the table is of, in a line."""
        what = f"{self.duration:g} s each" if self.task == "simulate" else f"{self.batch} a call"
        return f"{self.model}: {self.task} of {self.states} states, {what}; truth {self.truth}"

    def __str__(self) -> str:
        rows = [["", "way", "error", "bound", self.unit, "code"], *self.rows()]
        widths = [max(len(row[k]) for row in rows) for k in range(6)]
        lines = [self.head]
        for row in rows:
            cells = [
                c.rjust(w) if 2 <= k <= 4 else c.ljust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([*lines, "* nothing cheaper has a smaller error"])

    def __repr__(self) -> str:
        return f"<Tradeoff {self.task} of {self.model}: {len(self.options)} ways, {len(self.front)} on the front>"

    def plot(self, path: Any = None) -> Any:
        """A matplotlib Figure of error against cost, the front marked; written to the file ``path`` if that is given.

        Raises  SpatialDynError where matplotlib is not installed, or the file cannot be written.
        """
        if not (path is None or isinstance(path, str) or hasattr(path, "__fspath__") or hasattr(path, "write")):
            raise SpatialDynError(f"path is {path!r}, expected the name of a file")
        try:
            from matplotlib.figure import Figure
        except ImportError as error:
            raise SpatialDynError('matplotlib is not installed; pip install "spatialdyn[plot]"') from error
        figure_ = Figure(figsize=(9.0, 5.0), layout="constrained")
        axes = figure_.subplots()
        families: dict[str, list[Option]] = {}
        for x in self.options:
            if math.isfinite(x.error):
                families.setdefault(x.name.split(",")[0] if self.task == "simulate" else x.name, []).append(x)
        for k, (name, points) in enumerate(families.items()):
            points.sort(key=lambda x: -x.error)  # from the coarsest step to the finest
            marker = "osD^vPX*<>"[(k + k // 10) % 10]  # colours begin again at the tenth
            shown = [max(x.error, 1e-17) for x in points]
            axes.plot([x.ns for x in points], shown, marker=marker, linewidth=0.8, label=name)
        front = [x for x in self.front if math.isfinite(x.error)]
        axes.step(
            [x.ns for x in front], [max(x.error, 1e-17) for x in front], color="0.6", linestyle=":", where="post",
            label="front", zorder=0,
        )  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel=self.unit, ylabel="largest error")
        axes.set_title(f"{self.model}: {self.task.replace('_', ' ')}")
        axes.grid(alpha=0.3)
        figure_.legend(loc="outside right upper", fontsize="small")
        if path is not None:
            try:
                figure_.savefig(path, dpi=130)
            except (OSError, ValueError) as error:
                raise SpatialDynError(f"plot cannot be written to {path}: {error}") from error
        return figure_


@dataclass(frozen=True)
class Recommendation:
    """The cheapest way that meets a tolerance; called like the task's own call, it does it that way.

    option     the way
    why        in words
    tolerance  what was asked for
    tradeoff   all that it was chosen from
    """

    option: Option
    why: str
    tolerance: float
    tradeoff: Tradeoff

    @property
    def code(self) -> str:
        """How it is written."""
        return self.option.code

    def __call__(self, *arguments: Any) -> Any:
        """What the task's call returns of its inputs; a Trajectory of (q0, v0, duration).

        Raises  ShapeError for as many as it does not take, and what the call raises.
        """
        assert self.option.run is not None
        names = INPUTS[self.tradeoff.task]
        if len(arguments) != len(names):
            raise ShapeError(f"{len(arguments)} inputs were given, expected {len(names)}: {', '.join(names)}")
        return self.option.run(*arguments)

    def __str__(self) -> str:
        return f"{self.code}\n{self.why}"


def checked_tolerance(tolerance: Any) -> float:
    """A tolerance as a float. Raises SpatialDynError for what is no number above 0."""
    number = as_number(tolerance)
    if not 0.0 < number:
        raise SpatialDynError(f"tolerance is {tolerance!r}, expected a number above 0")
    return number


def figure(x: float) -> str:
    """An error in two digits."""
    return f"{x:.1e}" if math.isfinite(x) else "-"


def marked(options: list[Option]) -> tuple[Option, ...]:
    """The cheapest first, those on the Pareto front marked."""
    least, made = math.inf, []
    for x in sorted(options, key=lambda x: (x.ns, x.error)):
        best = x.error < least
        least = min(least, x.error) if best else least
        made.append(Option(**{**vars(x), "best": best}))
    return tuple(made)


def _json(x: Any) -> Any:
    return None if isinstance(x, float) and not math.isfinite(x) else x
