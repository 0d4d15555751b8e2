"""``Path``: a motion to follow, as a function of time; splines, quintics, trapezoids and Fourier series make one.

A path is q(t) = q_c ∘ exp(u(t)): u is the displacement from its centre q_c, a twist for each joint, so quaternions and
floating bases need no special case (``recursions.control.paths``). Without a model coordinates are numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import R1
from ..calls.arguments import as_array, as_finite, as_flag, as_number, broadcast, check_model
from ..calls.dynamics import checked_call
from ..errors import ShapeError, SpatialDynError, literal
from ..model.builder import ModelBuilder
from ..model.model import Model
from ..recursions.control.paths import polynomial_spec, timed_spec
from ..recursions.spec import Spec
from ..waiting import watch
from .path_ranges import check_limits, extremes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
TIMES = 1e-50, 1e50  # s: beyond, powers of a duration leave the range of float64
SAMPLES = 1000  # of a segment or period, if extremes have no closed form


class PathPoint(NamedTuple):
    """A path at some times: q (..., nq), v (..., nv) and a (..., nv)."""

    q: Array
    v: Array
    a: Array


class PathPeaks(NamedTuple):
    """Largest |v| and |a| (..., nv) of each freedom, and the least and largest q (..., nq)."""

    v: Array
    a: Array
    lowest: Array
    highest: Array


class Path:
    """A motion to follow: ``path(t)`` is q, v and a. Or B motions, one for each sample of a batch.

    model     Model whose coordinates the path has; None if each coordinate is a plain number
    spec      Spec of a clock and values (``recursions.control.paths``), which control laws record into their program
    values    {name: array} of its inputs beside the clock; for B paths centre has an axis (B,) before its own, and
              others may have it
    duration  [s]; a Fourier series repeats with this period, other paths rest before 0 and after their end. For B paths
              the longest
    limits    whether a path beyond the position or velocity limits of a robot that follows it is an error

    ``path[b]`` is one of B paths; ``path.batch`` is (B,), or () for one path. A path serves every robot with the joints
    of ``model``, with any masses, loads and gravity.

    ``spline``, ``quintic``, ``trapezoid`` and ``fourier`` make paths.

    >>> import spatialdyn as sd
    >>> path = sd.quintic([0.0, 0.0], [1.0, 2.0], 2.0)
    >>> path(1.0).q, path.peaks().v
    (array([0.5, 1. ]), array([0.9375, 1.875 ]))
    """

    def __init__(
        self, model: Model | None, spec: Spec, values: dict[str, Array], duration: float, limits: bool = True
    ) -> None:
        """See the class; the functions that make paths check their arguments."""
        if not isinstance(spec, Spec) or not isinstance(values, Mapping):
            name, wrong = ("values", values) if isinstance(spec, Spec) else ("spec", spec)
            raise SpatialDynError(f"{name} is {literal(wrong)}, expected a Spec and a mapping of its values")
        values = {str(name): as_finite(f"{name} of a path", x).copy() for name, x in values.items()}
        if unknown := {*values} ^ {x.name for x in spec.present if x.start is None}:
            raise SpatialDynError(
                f"values of a path lack or have {', '.join(sorted(unknown))}, expected those of its Spec"
            )
        if values["centre"].ndim not in (1, 2):
            raise ShapeError(f"centre of a path has shape {values['centre'].shape}, expected (nq,) or (B, nq)")
        for x in spec.present:
            lead = values[x.name].shape[: -len(x.shape)] if x.start is None else ()
            if lead not in ((), values["centre"].shape[:-1]):
                raise ShapeError(
                    f"{x.name} of a path has the axes {lead} before its own, expected those of centre, "
                    f"{values['centre'].shape[:-1]}"
                )
        for y in values.values():
            y.flags.writeable = False
        self.model, self.spec, self.values = model if model is None else check_model(model), spec, values
        self.duration, self.limits = positive("duration", duration), as_flag("limits", limits)

    def __repr__(self) -> str:
        what = self.spec.name.partition("_")[0]
        robot = "" if self.model is None else f" of {self.model.name}"
        several = "".join(f"{n} x " for n in self.batch)
        return f"<Path{robot}: {several}{what}, {self.values['centre'].shape[-1]} coordinates, {self.duration:g} s>"

    @property
    def batch(self) -> tuple[int, ...]:
        """(B,) for B paths, () for one."""
        return self.values["centre"].shape[:-1]

    def __getitem__(self, b: int | slice) -> Path:
        """Path b of B, or some of them."""
        if not self.batch:
            raise ShapeError(f"path is one alone, expected several to take {literal(b)} of")
        sizes = {x.name: len(x.shape) for x in self.spec.present}
        own = {name: x[b] if x.ndim > sizes[name] else x for name, x in self.values.items()}
        duration = float(own["times"][..., -1].max()) if "times" in own else self.duration
        return Path(self.model, self.spec, own, duration, self.limits)

    @property
    def rows(self) -> dict[str, Array]:
        """The values as a Control takes them: for B paths with axes of samples and steps."""
        sizes = {x.name: len(x.shape) for x in self.spec.present}
        return {name: x[:, None] if x.ndim > sizes[name] else x for name, x in self.values.items()}

    def __call__(self, t: ArrayLike) -> PathPoint:
        """q, v and a at times t (...) [s]; for B paths at times (..., B), one for each path, or (..., 1)."""
        when = as_array("t", t)
        given, spec = dict(self.values), self.spec
        if "times" in given and given["times"].shape[-1] > 2:  # select one segment per time
            when = np.broadcast_to(when, broadcast(["t", "path"], [when.shape, self.batch]))
            ends = given["times"]
            at = (when[..., None] > ends[..., 1:-1]).sum(-1)
            which = tuple(np.broadcast_to(np.arange(n), when.shape) for n in self.batch)

            def chosen(x: Array, own: int, at: Array) -> Array:
                return np.asarray(x[(*which, at)] if x.ndim > own else x[at])

            given["times"] = np.stack([chosen(ends, 1, at), chosen(ends, 1, at + 1)], -1)
            name, own, make = ("scale", 2, timed_spec) if "scale" in given else ("coefficients", 3, polynomial_spec)
            found = chosen(given[name], own, at)
            given[name] = found.reshape((*when.shape, 1, *found.shape[when.ndim :]))
            spec = make(1, found.shape[-1])
        table = self._table
        out = np.asarray(checked_call(spec, table, (when[..., None], *given.values()), (), None))
        parts = np.split(out, [table.nq, table.nq + table.nv], axis=-1)
        return PathPoint(*(np.ascontiguousarray(x) for x in parts))

    @property
    def _table(self) -> Model:
        """A model of these coordinates."""
        return _line(self.values["centre"].shape[-1]) if self.model is None else self.model

    def peaks(self) -> PathPeaks:
        """Largest velocities and accelerations, least and largest positions: for polynomials in plain numbers from the
        roots of their derivatives, otherwise from 1000 samples in each segment or period.
        """
        plain = all(x.kind in R1 for x in self._table.bodies[1:])
        if "times" not in self.values or not plain:
            ends = np.unique(self.values.get("times", np.array([0.0, self.duration])))
            grid = np.concatenate([np.linspace(a, b, SAMPLES) for a, b in pairwise(ends)])
            q, v, a = self(grid.reshape(-1, *([1] * len(self.batch))))
            return PathPeaks(abs(v).max(0), abs(a).max(0), q.min(0), q.max(0))
        centre, times = self.values["centre"], self.values["times"]
        if "scale" in self.values:
            scale, way = self.values["scale"], self.values["way"]
            scale = scale if scale.ndim > way.ndim else np.broadcast_to(scale, (*self.batch, *scale.shape))
            both = extremes(scale, np.diff(times))[..., None] * way
            found = np.stack([both.min(1), both.max(1)], 1)
        else:
            c = np.moveaxis(self.values["coefficients"], -3, -2)  # (..., nv, segments, powers)
            found = extremes(c, np.diff(times)[..., None, :])
        widest = abs(found).max(1)
        return PathPeaks(widest[1], widest[2], centre + found[0, 0], centre + found[0, 1])

    def check_limits(self, model: Model | None = None) -> None:
        """Raise SpatialDynError, naming the joint, if the path exceeds its position or velocity limits."""
        model = check_model(model if model is not None else self.model)
        self._check_coordinates(model)
        check_limits(model, self.peaks())

    def check_model(self, model: Model) -> None:
        """Raise SpatialDynError unless the path has this model's joints and, without ``limits=False``, stays within
        their limits.
        """
        _meet(self, check_model(model))

    def _check_coordinates(self, model: Model) -> None:
        if self.model is not None:
            if model is self.model:
                return
            own, other = _joints(self.model), _joints(model)
            if own != other:
                raise SpatialDynError(
                    f'path is of robot "{self.model.name}", expected one of "{model.name}", which has other joints: '
                    f"{_first_difference(own, other)}"
                )
            return
        n = self.values["centre"].shape[-1]
        if n != model.nq or not _is_plain(model):
            raise SpatialDynError(
                f"path has {n} coordinates that are numbers, expected the {model.nq} of robot "
                f'"{model.name}": make it with model=model'
            )

    @watch.call("Path.plot")
    def plot(self, path: str | None = None) -> Figure:
        """Draw q, v and a over time with Matplotlib; path: a file to write too. Returns the Figure.

        Raises ShapeError for B paths: use ``path[b].plot()``.
        """
        from ..pictures.control_plots import plot_path

        return plot_path(self, path)


@lru_cache(maxsize=32)
def _meet(path: Path, model: Model) -> None:
    """Raise SpatialDynError unless the path fits this model; success is cached."""
    path._check_coordinates(model)
    if path.limits:
        check_limits(model, path.peaks())


@lru_cache(maxsize=32)
def _joints(model: Model) -> tuple[tuple[Any, ...], ...]:
    """The parts of the configuration space: names and kinds of the joints and their places in q and v."""
    return tuple((x.name, x.kind, x.idx_q, x.nq, x.idx_v, x.nv) for x in model.joints[1:])


def _first_difference(own: tuple[tuple[Any, ...], ...], other: tuple[tuple[Any, ...], ...]) -> str:
    for a, b in zip(own, other, strict=False):
        if a != b:
            return f'{a[1]} "{a[0]}" is not {b[1]} "{b[0]}"' if a[:2] != b[:2] else f'"{a[0]}" is elsewhere in q or v'
    return f"{len(own)} are not {len(other)}"


@lru_cache(maxsize=32)
def _is_plain(model: Model) -> bool:
    """Whether all independent coordinates are numbers."""
    return all(row["kind"] in R1 for row in model.bodies[1:] if not row["leader"])


@lru_cache(maxsize=32)
def _line(n: int) -> Model:
    """A robot with n coordinates that are numbers."""
    builder = ModelBuilder("numbers")
    for k in range(n):
        builder.add_body(f"b{k}", None, "prismatic", (1, 0, 0), None, (1.0, (0, 0, 0), np.zeros((3, 3))))
    return builder.build()


def positive(name: str, value: float) -> float:
    x = as_number(value)
    if not TIMES[0] <= x <= TIMES[1]:
        raise SpatialDynError(
            f"{name} is {literal(value)}, expected a finite number above 0, from {TIMES[0]:g} to {TIMES[1]:g}"
        )
    return x
