"""The results of ``trade`` and ``recommend``: options with their errors and costs, as text, JSON and a plot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..calls.arguments import as_number
from ..calls.json_numbers import finite_or_none, json_text
from ..errors import ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..waiting import watch

UNITS = {"simulate": "ns a simulated second"}
INPUTS = {
    "forward_dynamics": ("q", "v", "tau"),
    "inverse_dynamics": ("q", "v", "a"),
    "mass_matrix": ("q",),
    "simulate": ("q0", "v0", "duration"),
}


FRONT = "* nothing cheaper has a smaller error"
EACH_JOINT = "worst joint: the largest error of a joint relative to its own scale"


@dataclass(frozen=True)
class Option:
    """One option for a task: an engine, dtype and method, or an integrator and step.

    name    the name in tables
    code    the line to write
    error   the largest error in the sampled states, as ``trade`` defines it for the task
    median  the median of the errors in those states
    bound   expected to hold in other states of the same kind: ``error`` times a margin, larger if errors scatter
    ns      cost [ns] of a sample, or of a simulated second
    best    whether it is on the Pareto front: every cheaper option has a larger error
    note    remarks, such as the reason for a missing error
    states  number of states in which these errors were measured, 0 for the table's number
    run     function that computes the call, or a simulation from (q0, v0, duration)
    promised  the largest rounding error bound in the sampled states, by the analysis of ``bounded``: no error in these
            states exceeds it; infinite without an analysis
    each    the largest error of a joint relative to its own scale: each entry relative to itself, or to the median of
            its sizes in the sampled states if that is larger; for simulations, each coordinate relative to its own
            largest change, or to a tenth of the largest of all
    each_bound  as ``bound``, for ``each``
    """

    name: str
    code: str
    error: float
    median: float
    bound: float
    ns: float
    best: bool = False
    note: str = ""
    states: int = 0
    run: Callable[..., Any] | None = field(default=None, repr=False, compare=False)
    promised: float = math.inf
    each: float = math.inf
    each_bound: float = math.inf


Further = Callable[..., Mapping[str, Any] | None]


@dataclass(frozen=True)
class Tradeoff:
    """All options for a task on a model, the cheapest first.

    model      its name
    task       name of the task
    options    tuple of Option
    states     number of sampled states
    batch      samples of a call, 0 for simulations
    duration   of the simulations [s], 0 for calls
    certainty  error of the reference itself: its largest difference from a better reference
    truth      the computation of the reference, in words
    further    function of (options, tolerance) that returns errors in many more states, {name: array} for the options
               within the tolerance, or None if it takes too long or has no reference; None if states were given
    subject    the Model that was measured; None if it is not known
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
    subject: Model | None = field(default=None, repr=False, compare=False)

    @property
    def front(self) -> tuple[Option, ...]:
        """The Pareto front."""
        return tuple(x for x in self.options if x.best)

    def cheapest(self, tolerance: float) -> Option | None:
        """The cheapest option whose bound is within a tolerance, None if there is none.

        Raises  SpatialDynError for a tolerance that is not a number above 0.
        """
        within = checked_tolerance(tolerance)
        return next((x for x in self.options if x.bound <= within), None)

    @property
    def unit(self) -> str:
        """The unit of ``ns`` in words."""
        return UNITS.get(self.task, "ns a sample" if self.batch > 1 else "ns a call")

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON types; numbers that are not finite are None."""
        rows = [{k: finite_or_none(v) for k, v in vars(x).items() if k not in ("run", "states")} for x in self.options]
        whole = {k: finite_or_none(v) for k, v in vars(self).items() if k not in ("further", "subject")}
        return {**whole, "unit": self.unit, "options": rows}

    def to_json(self) -> str:
        """All of it as JSON text."""
        return json_text(self.to_dict())

    def rows(self) -> list[list[str]]:
        """The table's cells as text: mark of the front, name, error, bound, bound of the worst joint, cost, code or
        note."""
        return [
            [
                "*" if x.best else "", x.name, figure(x.error), figure(x.bound), figure(x.each), f"{x.ns:.4g}",
                x.note or x.code,
            ]
            for x in self.options
        ]  # fmt: skip

    @property
    def head(self) -> str:
        """The title of the table."""
        what = f"{self.duration:g} s each" if self.task == "simulate" else f"{self.batch} a call"
        return f"{self.model}: {self.task} of {self.states} states, {what}; truth {self.truth}"

    def __str__(self) -> str:
        rows = [["", "option", "error", "bound", "worst joint", self.unit, "code"], *self.rows()]
        widths = [max(len(row[k]) for row in rows) for k in range(7)]
        lines = [self.head]
        for row in rows:
            cells = [
                c.rjust(w) if 2 <= k <= 5 else c.ljust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([*lines, FRONT, EACH_JOINT])

    def __repr__(self) -> str:
        return f"<Tradeoff {self.task} of {self.model}: {len(self.options)} options, {len(self.front)} on the front>"

    @watch.call("Tradeoff.plot")
    def plot(self, path: Any = None, *, ax: Any = None) -> Any:
        """A Matplotlib Figure of error against cost with the Pareto front, written to the file ``path`` if given.

        ax  Matplotlib axes to draw into

        Simulations are labelled with their steps; their cost is in ms of computing for a second of motion.
        Raises  SpatialDynError if matplotlib is not installed, or the file cannot be written.
        """
        from ..pictures.tradeoff_plots import plot_tradeoff

        return plot_tradeoff(self, ax, path)

    @watch.call("Tradeoff.report")
    def report(self, path: Any) -> None:
        """Write one HTML page of the trade, which needs no network: robot, plot, table, how to reproduce it.

        path  a name that ends in .html, or an open file

        Raises  SpatialDynError for another ending, if the file cannot be written, or where matplotlib is not installed.
        """
        from ..pictures.page import report_tradeoff

        report_tradeoff(self, path)

    def _repr_html_(self) -> str:
        from ..pictures.notebook import tradeoff_html

        return tradeoff_html(self)


@dataclass(frozen=True, repr=False)
class Recommendation:
    """The cheapest option within a tolerance; called with the task's arguments, it computes by that option.

    option     the Option
    why        the reason in words
    tolerance  the tolerance given
    tradeoff   the Tradeoff from which it was chosen
    """

    option: Option
    why: str
    tolerance: float
    tradeoff: Tradeoff

    @property
    def code(self) -> str:
        """The line to write."""
        return self.option.code

    def __call__(self, *arguments: Any) -> Any:
        """The result of the task's call; for a simulation the Trajectory from (q0, v0, duration).

        Raises  ShapeError for another number of inputs; the errors of the call.
        """
        assert self.option.run is not None
        names = INPUTS[self.tradeoff.task]
        if len(arguments) != len(names):
            raise ShapeError(f"{len(arguments)} inputs were given, expected {len(names)}: {', '.join(names)}")
        return self.option.run(*arguments)

    def __repr__(self) -> str:
        of = f"{self.tradeoff.task} of {self.tradeoff.model}"
        return f"<Recommendation for {of} within {self.tolerance:g}: {self.option.name}, {self.code}>"

    def __str__(self) -> str:
        return f"{self.code}\n{self.why}"

    def _repr_html_(self) -> str:
        from ..pictures.notebook import recommendation_html

        return recommendation_html(self)


def checked_tolerance(tolerance: Any) -> float:
    """A tolerance as a float. Raises SpatialDynError unless it is a number above 0."""
    number = as_number(tolerance)
    if not 0.0 < number:
        raise SpatialDynError(f"tolerance is {literal(tolerance)}, expected a number above 0")
    return number


def figure(x: float) -> str:
    """An error in two digits."""
    return f"{x:.1e}" if math.isfinite(x) else "-"


def mark_pareto(options: list[Option]) -> tuple[Option, ...]:
    """Options sorted by cost, ``best`` set on those of the Pareto front."""
    least, made = math.inf, []
    for x in sorted(options, key=lambda x: (x.ns, x.error)):
        best = x.error < least
        least = min(least, x.error) if best else least
        made.append(Option(**{**vars(x), "best": best}))
    return tuple(made)
