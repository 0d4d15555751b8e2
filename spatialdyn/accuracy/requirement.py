"""The result of ``requires``: the parts of a scene, the cheapest scene that keeps a motion, and its verified error."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_finite
from ..calls.json_numbers import finite_or_none, json_text
from ..simulation.scene import Scene
from ..waiting import watch
from .embedding import Embedding
from .results import figure

Array = NDArray[np.float64]
COLUMNS = ("part", "form", "change", "ns a step", "saved", "verdict", "why")


@dataclass(frozen=True)
class Part:
    """A part of a scene in a cheaper form, or a method with its step.

    part, form  in words
    change      largest change of the observed quantities, in all samples and times; infinite if not measured
    ns          cost of a step of one sample [ns]; NaN if it was not measured
    dt          its step [s]
    saved       share of the cost of a second of motion that it saves alone; for a method and a precision, in addition
                to the parts that are left out
    verdict     "left out" or "taken"; "needed"; "not with the others": within the tolerance alone; "saves nothing";
                "not taken": another is cheaper; "cannot": it does not run
    why         the reason in words
    """

    part: str
    form: str
    change: float
    ns: float
    dt: float
    saved: float
    verdict: str
    why: str

    @property
    def cost(self) -> float:
        """Nanoseconds of a second of motion of one sample."""
        return self.ns / self.dt


@dataclass(frozen=True, repr=False)
class Requirement:
    """The parts of a scene that a motion requires.

    full       the whole Scene
    scene      the cheapest Scene that keeps the motion; ``method``, ``dt`` [s] and ``dtype`` are for its ``rollout``
    code       lines of Python that make and run it from ``scene``, ``q0``, ``v0``, ``torque`` and ``control`` as given,
               with ``numpy`` as ``np``
    observed   what is compared, with its units
    tolerance  the tolerance given
    error      largest change in fresh samples by this scene, method, step and precision
    bound      expected to hold in other samples of the same kind: ``error`` with a margin, plus ``certainty``
    certainty  difference between the whole scene at its step and at half of it
    horizon    [s]  time up to which ``certainty`` holds; later times were not judged
    duration   [s]  the duration given
    samples    number of fresh samples for ``error``; as many others were used for the choice
    fine       (method, dt) of the whole scene
    rows       a Part for every candidate
    path       a Part for the whole scene and for each further scene of the search up to this one, in order
    """

    full: Scene
    scene: Scene
    method: str
    dt: float
    dtype: str
    code: str
    observed: str
    tolerance: float
    error: float
    bound: float
    certainty: float
    horizon: float
    duration: float
    samples: int
    fine: tuple[str, float]
    rows: tuple[Part, ...]
    path: tuple[Part, ...]
    embedding: Embedding = field(repr=False, compare=False)

    def to_full(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """States q (..., nq), v (..., nv) of the whole robot from states of ``scene``. Raises ShapeError,
        NonFiniteError."""
        return self.embedding.to_full(as_finite("q", q), as_finite("v", v), self.full.model.nv)

    def to_reduced(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """States of ``scene`` from states of the whole robot. Raises ShapeError, NonFiniteError."""
        return self.embedding.to_reduced(as_finite("q", q), as_finite("v", v), self.full.model.nv)

    @property
    def needed(self) -> tuple[str, ...]:
        """Names of the parts that cannot be left out, locked, merged or rigid, even alone."""
        first: dict[str, str] = {}
        for x in self.rows:
            first.setdefault(x.part, x.verdict)
        return tuple(part for part, verdict in first.items() if verdict in ("needed", "cannot"))

    @property
    def speedup(self) -> float:
        """Cost of a second of motion of the whole scene at its fine step, over that of ``scene``."""
        return self.path[0].cost / self.path[-1].cost

    @property
    def head(self) -> str:
        """The title of the table."""
        short = "" if self.horizon == self.duration else f", judged to {self.horizon:g} s of {self.duration:g} s"
        return (
            f"{self.full.model.name}: {self.observed} for {self.duration:g} s within {self.tolerance:g}{short}; the "
            f"whole scene at {self.fine[0]}, dt {self.fine[1]:.3g} s, is {figure(self.certainty)} from itself at half "
            "the step"
        )

    @property
    def foot(self) -> str:
        """The result in words."""
        acts = ", ".join(self.scene.acts) or "nothing"
        return (
            f"take {self.method}, dt {self.dt:.3g} s, {self.dtype}, {self.scene.model.nv} of {self.full.model.nv} "
            f"freedoms, on which acts: {acts}; error {figure(self.error)} in {self.samples} fresh samples, expected "
            f"below {figure(self.bound)} in others; {self.speedup:.3g} times as fast"
        )

    def table(self) -> list[list[str]]:
        """The table's cells as text, a row for each of ``rows``, in the order of ``COLUMNS``."""
        return [
            [
                x.part, x.form, figure(x.change), "-" if math.isnan(x.ns) else f"{x.ns:.4g}",
                "-" if math.isnan(x.saved) else f"{100.0 * x.saved:.0f} %", x.verdict, x.why,
            ]
            for x in self.rows
        ]  # fmt: skip

    def __str__(self) -> str:
        rows = [list(COLUMNS), *self.table()]
        widths = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
        lines = [self.head]
        for row in rows:
            cells = [
                c.rjust(w) if k in (2, 3, 4) else c.ljust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([*lines, self.foot])

    def __repr__(self) -> str:
        return (
            f"<Requirement of {self.full!r} within {self.tolerance:g}: {self.scene!r}, {self.method}, dt {self.dt:g}>"
        )

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON types; numbers that are not finite are None."""
        skipped = ("full", "scene", "embedding", "rows", "path")
        whole = {name: _json(x) for name, x in vars(self).items() if name not in skipped}
        rows = {
            name: [{k: _json(y) for k, y in vars(x).items()} for x in getattr(self, name)] for name in ("rows", "path")
        }
        return {"model": self.full.model.name, "acts": list(self.scene.acts), **whole, **rows}

    def to_json(self) -> str:
        """All of it as JSON text."""
        return json_text(self.to_dict())

    @watch.call("Requirement.plot")
    def plot(self, path: Any = None, ax: Any = None) -> Any:
        """A Matplotlib Figure of change against cost, with a point per candidate and the chosen path marked.

        path  a file to write, of the format of its ending: PNG, SVG, PDF, ...
        ax    Matplotlib axes to draw into

        Raises  SpatialDynError if matplotlib is not installed, or the file cannot be written.
        """
        from ..pictures.requirement_plots import plot_requirement

        return plot_requirement(self, ax, path)

    def _repr_html_(self) -> str:
        from ..pictures.notebook import requirement_html

        return requirement_html(self)


def _json(x: Any) -> Any:
    if isinstance(x, tuple):
        return list(x)
    return finite_or_none(x)
