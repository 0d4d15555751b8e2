"""``Path``: a motion to follow, as a function of time; splines, quintics, trapezoids and Fourier series make one.

A path is q(t) = q_c ∘ exp(u(t)): from its centre q_c by a displacement u, each joint's twist, so that quaternions and
floating bases move as numbers do (``recursions.control.paths``). Without a model coordinates are numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import R1
from ..calls.arguments import as_array, as_finite, as_flag, as_number, as_word, broadcast, check_model
from ..calls.dynamics import calls, checked_call
from ..errors import ShapeError, SpatialDynError, literal
from ..model.builder import ModelBuilder
from ..model.model import Model
from ..recursions.control.paths import fourier_spec, polynomial_spec, timed_spec
from ..recursions.spec import Spec
from ..waiting import watch
from .path_ranges import check_limits, extremes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
TIMES = 1e-50, 1e50  # s: beyond, powers of a duration leave the range of float64
TURN = 3.0  # rad from the centre of a path: beyond π its displacement is not unique
SAMPLES = 1000  # of a segment or period, where extremes have no closed form


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
    values    {name: array} of its inputs beside the clock; of B paths centre has an axis (B,) before its own, the
              others may
    duration  [s]; a Fourier series repeats with this period, other paths rest before 0 and after their end. Of B paths
              the longest

    ``path[b]`` is one of B paths, ``path.batch`` their shape (B,), () of one alone.

    ``spline``, ``quintic``, ``trapezoid`` and ``fourier`` make paths.

    >>> import spatialdyn as sd
    >>> path = sd.quintic([0.0, 0.0], [1.0, 2.0], 2.0)
    >>> path(1.0).q, path.peaks().v
    (array([0.5, 1. ]), array([0.9375, 1.875 ]))
    """

    def __init__(self, model: Model | None, spec: Spec, values: dict[str, Array], duration: float) -> None:
        """See the class; the functions that make paths check what they are given."""
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
        self.duration = _positive("duration", duration)

    def __repr__(self) -> str:
        what = self.spec.name.partition("_")[0]
        robot = "" if self.model is None else f" of {self.model.name}"
        several = "".join(f"{n} x " for n in self.batch)
        return f"<Path{robot}: {several}{what}, {self.values['centre'].shape[-1]} coordinates, {self.duration:g} s>"

    @property
    def batch(self) -> tuple[int, ...]:
        """(B,) of B paths, () of one."""
        return self.values["centre"].shape[:-1]

    def __getitem__(self, b: int | slice) -> Path:
        """Path b of B, or some of them."""
        if not self.batch:
            raise ShapeError(f"path is one alone, expected several to take {literal(b)} of")
        sizes = {x.name: len(x.shape) for x in self.spec.present}
        own = {name: x[b] if x.ndim > sizes[name] else x for name, x in self.values.items()}
        return Path(self.model, self.spec, own, float(own["times"][..., -1].max()) if "times" in own else self.duration)

    @property
    def rows(self) -> dict[str, Array]:
        """The values as those of a Control: of B paths with axes of samples and steps."""
        sizes = {x.name: len(x.shape) for x in self.spec.present}
        return {name: x[:, None] if x.ndim > sizes[name] else x for name, x in self.values.items()}

    def __call__(self, t: ArrayLike) -> PathPoint:
        """q, v and a at times t (...) [s]; of B paths at times (..., B) or (..., 1), each of its own."""
        when = as_array("t", t)
        given, spec = dict(self.values), self.spec
        if "times" in given and given["times"].shape[-1] > 2:  # of each time its own segment, as one of its own
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
        """Largest velocities and accelerations, least and largest positions: of polynomials in plain numbers from the
        roots of their derivatives, else from 1000 samples in each segment or period.
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
        """Raise SpatialDynError, naming the joint, where the path leaves position limits or is faster than a joint."""
        model = check_model(model if model is not None else self.model)
        self.check_model(model)
        check_limits(model, self.peaks())

    def check_model(self, model: Model) -> None:
        """Raise SpatialDynError unless the path is of this model's coordinates."""
        check_model(model)
        if self.model is not None:
            if self.model != model:
                raise SpatialDynError(f'path is of robot "{self.model.name}", expected one of "{model.name}"')
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

        Raises ShapeError for several paths, of which ``path[b]`` is one.
        """
        from ..pictures.control_plots import plot_path

        return plot_path(self, path)


@lru_cache(maxsize=32)
def _is_plain(model: Model) -> bool:
    """Whether all coordinates of its own are numbers."""
    return all(row["kind"] in R1 for row in model.bodies[1:] if not row["leader"])


@lru_cache(maxsize=32)
def _line(n: int) -> Model:
    """A robot of n coordinates that are numbers."""
    builder = ModelBuilder("numbers")
    for k in range(n):
        builder.add_body(f"b{k}", None, "prismatic", (1, 0, 0), None, (1.0, (0, 0, 0), np.zeros((3, 3))))
    return builder.build()


# --- paths through configurations -----------------------------------------------------------------------


def spline(
    times: ArrayLike, points: ArrayLike, model: Model | None = None, ends: str = "rest", limits: bool = True
) -> Path:
    """A path through points by cubic splines: q, v and a are continuous.

    times   (N,)  increasing, from 0 or later [s]
    points  (N, nq)  configurations [rad | m]; (B, N, nq) for B paths
    model   of whose coordinates they are; left out, they are numbers
    ends    "rest", where v is 0 at both ends, or "natural", where a is
    limits  whether a path beyond the model's position or velocity limits is an error

    Displacements are those from the first point, where rotations may turn by 3 rad.
    Raises  ShapeError, SpatialDynError
    Source  de Boor, A Practical Guide to Splines (2001), ch. IV.

    >>> import spatialdyn as sd
    >>> path = sd.spline([0.0, 1.0, 3.0], [[0.0], [1.0], [0.5]])
    >>> path([1.0, 3.0]).q[:, 0].round(12).tolist()
    [1.0, 0.5]
    """
    at, q = as_array("times", times), as_array("points", points)
    as_word("ends", ends, ("rest", "natural"))
    if at.ndim != 1 or len(at) < 2:
        raise ShapeError(f"times has shape {at.shape}, expected (N,) with N of 2 or more")
    if not (np.isfinite(at).all() and (np.diff(at) > 0.0).all() and at[0] >= 0.0):
        raise SpatialDynError(f"times is {at.tolist()}, expected increasing numbers of 0 or more")
    if q.ndim not in (2, 3) or q.shape[-2] != len(at):
        raise ShapeError(f"points has shape {q.shape}, expected ({len(at)}, nq) or (B, {len(at)}, nq)")
    u = np.moveaxis(_displacements(model, "points", q), -2, 0)  # (N, ..., nv)
    h = np.diff(at).reshape(-1, *([1] * (u.ndim - 1)))
    slope = np.diff(u, axis=0) / h
    bend = _second_derivatives(np.diff(at), slope, ends == "rest")
    c = np.stack(
        [u[:-1], slope - h / 6.0 * (2.0 * bend[:-1] + bend[1:]), 0.5 * bend[:-1], np.diff(bend, axis=0) / (6.0 * h)], -1
    )
    return _polynomial(model, q[..., 0, :], at, np.moveaxis(c, 0, -3), limits)


def _second_derivatives(widths: Array, slope: Array, rest: bool) -> Array:
    """Of a cubic spline at its knots: a tridiagonal system, solved by elimination (Thomas)."""
    n = len(widths) + 1
    lower, middle, upper, right = np.zeros(n), np.ones(n), np.zeros(n), np.zeros((n, *slope.shape[1:]))
    lower[1:-1], middle[1:-1], upper[1:-1] = widths[:-1], 2.0 * (widths[:-1] + widths[1:]), widths[1:]
    right[1:-1] = 6.0 * np.diff(slope, axis=0)
    if rest:
        middle[0], upper[0], right[0] = 2.0 * widths[0], widths[0], 6.0 * slope[0]
        lower[-1], middle[-1], right[-1] = widths[-1], 2.0 * widths[-1], -6.0 * slope[-1]
    for k in range(1, n):
        part = lower[k] / middle[k - 1]
        middle[k] -= part * upper[k - 1]
        right[k] -= part * right[k - 1]
    found = np.empty_like(right)
    found[-1] = right[-1] / middle[-1]
    for k in range(n - 2, -1, -1):
        found[k] = (right[k] - upper[k] * found[k + 1]) / middle[k]
    return found


def quintic(q0: ArrayLike, q1: ArrayLike, T: float, model: Model | None = None, limits: bool = True) -> Path:
    """The minimum-jerk path from rest at q0 to rest at q1 in time T: s(t) = 10 x³ - 15 x⁴ + 6 x⁵, x = t/T.

    q0, q1  (nq,)  configurations [rad | m]; one or both (B, nq) for B paths
    T       [s]
    model, limits  as in ``spline``

    It follows ``interpolate``: rotations turn about a fixed axis.
    Source  Flash and Hogan, The coordination of arm movements (1985).

    >>> import spatialdyn as sd
    >>> sd.quintic([0.0], [1.0], 2.0)(1.0).q
    array([0.5])
    """
    T = _positive("T", T)
    start, way = _way(model, q0, q1)
    s = np.array([[0.0, 0.0, 0.0, 10.0 / T**3, -15.0 / T**4, 6.0 / T**5]])
    return _timed(model, start, way, np.array([0.0, T]), s, limits)


def trapezoid(
    q0: ArrayLike, q1: ArrayLike, v_max: ArrayLike, a_max: ArrayLike, model: Model | None = None, limits: bool = True
) -> Path:
    """The fastest path from rest at q0 to rest at q1 within limits of velocity and acceleration, in step.

    q0, q1        (nq,)  configurations [rad | m]; one or both (B, nq) for B paths, each as fast as it may be
    v_max, a_max  numbers or (nv,)  largest velocities and accelerations, above 0
    model, limits as in ``spline``

    Accelerations jump: in a step with a jump, a method of order 4 has order 1 or 2.

    >>> import spatialdyn as sd
    >>> path = sd.trapezoid([0.0, 0.0], [1.0, 0.2], 0.5, 1.0)
    >>> path.duration, path.peaks().v.round(12).tolist()
    (2.5, [0.5, 0.1])
    """
    start, way = _way(model, q0, q1)
    most = []
    for name, value in (("v_max", v_max), ("a_max", a_max)):
        x = as_array(name, value)
        if x.shape not in ((), way.shape[-1:]):
            raise ShapeError(f"{name} has shape {x.shape}, expected a number or {way.shape[-1:]}")
        if not (x >= TIMES[0]).all():
            raise SpatialDynError(f"{name} is {x.tolist()}, expected numbers above 0, {TIMES[0]:g} at least")
        with np.errstate(divide="ignore"):
            most.append((np.broadcast_to(x, way.shape) / abs(way)).min(-1, initial=np.inf))
    still = ~way.any(-1)
    if still.any():
        which = f" in sample {int(still.argmax())}" if still.ndim else ""
        raise SpatialDynError(f"q1 is q0{which}, expected another configuration")
    if not np.isfinite(most[1]).all():
        raise SpatialDynError(f"a_max is {literal(a_max)}, expected finite numbers")
    fast, a = most
    rise = np.minimum(fast / a, np.sqrt(1.0 / a))  # s goes from 0 to 1 at a rate of a rise at most
    level, none = np.maximum(0.0, 1.0 / (a * rise) - rise), 0.0 * rise
    bends = np.stack([none, rise, rise + level, 2.0 * rise + level], -1)
    s = [none, none, 0.5 * a], [0.5 * a * rise**2, a * rise, none], [1.0 - 0.5 * a * rise**2, a * rise, -0.5 * a]
    scale = np.stack([np.stack(x, -1) for x in s], -2)
    if not level.any():  # never as fast as it may be
        bends, scale = bends[..., [0, 1, 3]], scale[..., [0, 2], :]
    return _timed(model, start, way, bends, scale, limits)


def fourier(
    cosines: ArrayLike, sines: ArrayLike, frequency: float, centre: ArrayLike, model: Model | None = None,
    limits: bool = True,
) -> Path:  # fmt: skip
    """A periodic path whose displacement from the centre has the rate Σ_k cosines_k cos(kωt) + sines_k sin(kωt).

    cosines, sines  (H, nv)  of the harmonics k = 1 .. H [rad/s | m/s]; (B, H, nv) for B paths
    frequency       of the first [1/s], ω = 2π frequency
    centre          (nq,)  mean configuration [rad | m], or (B, nq)
    model, limits   as in ``spline``

    Source  Swevers et al., Optimal robot excitation and identification (1997).

    >>> import numpy as np, spatialdyn as sd
    >>> path = sd.fourier([[1.0]], [[0.0]], 0.5, [0.2])
    >>> bool(np.isclose(path(0.5).q[0], 0.2 + 1.0 / np.pi))
    True
    """
    base, step = as_array("centre", centre), _positive("frequency", frequency)
    parts = {"cosines": as_array("cosines", cosines), "sines": as_array("sines", sines)}
    nv = _start(model, "centre", base)
    for name, x in parts.items():
        if x.ndim not in (2, 3) or not x.shape[-2] or x.shape[-1] != nv:
            raise ShapeError(f"{name} has shape {x.shape}, expected (harmonics, {nv}) or (B, harmonics, {nv})")
    base = np.broadcast_to(
        base, (*broadcast(["cosines", "centre"], [parts["cosines"].shape[:-2], base.shape[:-1]]), base.shape[-1])
    )
    if parts["cosines"].shape != parts["sines"].shape:
        raise ShapeError(f"sines has shape {parts['sines'].shape}, expected that of cosines, {parts['cosines'].shape}")
    values = {"centre": base.copy(), "frequency": np.array([step]), **{name: x.copy() for name, x in parts.items()}}
    return _checked(Path(model, fourier_spec(parts["sines"].shape[-2]), values, 1.0 / step), limits)


def _polynomial(model: Model | None, centre: Array, times: Array, c: Array, limits: bool) -> Path:
    values = {"centre": centre.copy(), "times": times.copy(), "coefficients": np.ascontiguousarray(c)}
    return _checked(Path(model, polynomial_spec(c.shape[-3], c.shape[-1]), values, float(times[-1])), limits)


def _timed(model: Model | None, centre: Array, way: Array, times: Array, scale: Array, limits: bool) -> Path:
    values = {"centre": centre.copy(), "way": way.copy(), "times": times, "scale": scale}
    return _checked(Path(model, timed_spec(*scale.shape[-2:]), values, float(times[..., -1].max())), limits)


def _checked(path: Path, limits: bool) -> Path:
    if as_flag("limits", limits) and path.model is not None:
        path.check_limits()
    return path


def _positive(name: str, value: float) -> float:
    x = as_number(value)
    if not TIMES[0] <= x <= TIMES[1]:
        raise SpatialDynError(
            f"{name} is {literal(value)}, expected a finite number above 0, from {TIMES[0]:g} to {TIMES[1]:g}"
        )
    return x


def _start(model: Model | None, name: str, q: Array) -> int:
    """nv of paths that start from q (nq,) or (B, nq). Raises ShapeError."""
    nq = q.shape[-1] if model is None and q.ndim else 0 if model is None else check_model(model).nq
    if q.ndim not in (1, 2) or q.shape[-1] != nq or not q.size:
        raise ShapeError(f"{name} has shape {q.shape}, expected ({nq or 'nq'},) or (B, {nq or 'nq'})")
    return nq if model is None else model.nv


def _way(model: Model | None, q0: ArrayLike, q1: ArrayLike) -> tuple[Array, Array]:
    """q0, and the displacement to q1."""
    start, end = as_array("q0", q0), as_array("q1", q1)
    _start(model, "q0", start)
    if end.ndim not in (1, 2) or end.shape[-1] != start.shape[-1]:
        raise ShapeError(f"q1 has shape {end.shape}, expected that of q0, {start.shape}")
    broadcast(["q0", "q1"], [start.shape[:-1], end.shape[:-1]])
    start, end = np.broadcast_arrays(start, end)
    return start, _displacements(model, "q1", np.stack([start, end], -2))[..., 1, :]


def _displacements(model: Model | None, name: str, q: Array) -> Array:
    """From the first of some configurations (..., N, nq) to each (..., N, nv). Raises for one that turns too far."""
    _start(model, name, as_finite(name, q)[..., 0, :])
    first = q[..., :1, :]
    if model is None:
        return np.asarray(q - first)
    difference: Callable[..., Any] = calls["difference"]
    u = np.asarray(difference(model, first, q))
    for joint in model.joints[1:]:
        if joint.nq != joint.nv or joint.nv > 1:
            w = u[..., joint.idx_v + {"planar": 2, "floating": 3}.get(joint.kind, 0) : joint.idx_v + joint.nv]
            far = np.sqrt((w * w).sum(-1))
            if far.max() > TURN:
                k = np.unravel_index(int(far.argmax()), far.shape)
                which = ", ".join(map(str, k))
                raise SpatialDynError(
                    f'{name}[{which}] turns joint "{joint.name}" by {far[k]:.3g} rad from the first, expected at most '
                    f"{TURN:g}: several paths, one after another"
                )
    return u
