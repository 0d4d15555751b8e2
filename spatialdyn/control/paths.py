"""``Path``: a motion to follow, as a function of time; splines, quintics, trapezoids and Fourier series make one.

A path is q(t) = q_c ∘ exp(u(t)): from its centre q_c by a displacement u, each joint's twist, so that quaternions and
floating bases move as numbers do (``recursions.control.paths``). Without a model coordinates are numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import R1
from ..calls.arguments import as_array, as_finite, as_flag, as_number, as_word, check_model
from ..calls.dynamics import calls, checked_call
from ..errors import ShapeError, SpatialDynError
from ..model.builder import ModelBuilder
from ..model.model import Model
from ..recursions.control.paths import fourier_spec, polynomial_spec, timed_spec
from ..recursions.spec import Spec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
TURN = 3.0  # rad from the centre of a path: beyond π its displacement is not unique
SAMPLES = 1000  # of a segment or period, where extremes have no closed form
ROUNDING = 1e-9  # of a limit that a path may touch


class PathPoint(NamedTuple):
    """A path at some times: q (..., nq), v (..., nv) and a (..., nv)."""

    q: Array
    v: Array
    a: Array


class PathPeaks(NamedTuple):
    """Largest |v| and |a| (nv,) of each freedom, and the least and largest q (nq,)."""

    v: Array
    a: Array
    lowest: Array
    highest: Array


class Path:
    """A motion to follow: ``path(t)`` is q, v and a.

    model     Model whose coordinates the path has; None if each coordinate is a plain number
    spec      Spec of a clock and values (``recursions.control.paths``), which control laws record into their program
    values    {name: array} of its inputs beside the clock
    duration  [s]; a Fourier series repeats with this period. Other paths rest before 0 and after their end

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
            raise SpatialDynError(f"{name} is {wrong!r}, expected a Spec and a mapping of its values")
        values = {str(name): as_finite(f"{name} of a path", x).copy() for name, x in values.items()}
        if unknown := {*values} ^ {x.name for x in spec.present if x.start is None}:
            raise SpatialDynError(
                f"values of a path lack or have {', '.join(sorted(unknown))}, expected those of its Spec"
            )
        for x in values.values():
            x.flags.writeable = False
        self.model, self.spec, self.values = model if model is None else check_model(model), spec, values
        self.duration = _positive("duration", duration)

    def __repr__(self) -> str:
        what = self.spec.name.partition("_")[0]
        robot = "" if self.model is None else f" of {self.model.name}"
        return f"<Path{robot}: {what}, {len(self.values['centre'])} coordinates, {self.duration:g} s>"

    def __call__(self, t: ArrayLike) -> PathPoint:
        """q, v and a at times t (...) [s]."""
        when = as_array("t", t)
        given, spec = dict(self.values), self.spec
        if "times" in given and len(given["times"]) > 2:  # of each time its own segment, as one of its own
            ends = given["times"]
            at = np.clip(np.searchsorted(ends, when, "left") - 1, 0, len(ends) - 2)
            given["times"] = np.stack([ends[at], ends[at + 1]], -1)
            name, make = ("scale", timed_spec) if "scale" in given else ("coefficients", polynomial_spec)
            chosen = given[name][at]
            given[name] = chosen.reshape((*when.shape, 1, *chosen.shape[when.ndim :]))
            spec = make(1, chosen.shape[-1])
        table = self._table
        out = np.asarray(checked_call(spec, table, (when[..., None], *given.values()), (), None))
        parts = np.split(out, [table.nq, table.nq + table.nv], axis=-1)
        return PathPoint(*(np.ascontiguousarray(x) for x in parts))

    @property
    def _table(self) -> Model:
        """A model of these coordinates."""
        return _line(len(self.values["centre"])) if self.model is None else self.model

    def peaks(self) -> PathPeaks:
        """Largest velocities and accelerations, least and largest positions: of polynomials in plain numbers from the
        roots of their derivatives, else from 1000 samples in each segment or period.
        """
        plain = all(x.kind in R1 for x in self._table.bodies[1:])
        if "times" not in self.values or not plain:
            ends = self.values.get("times", np.array([0.0, self.duration]))
            grid = np.concatenate([np.linspace(a, b, SAMPLES) for a, b in pairwise(ends)])
            q, v, a = self(grid)
            return PathPeaks(abs(v).max(0), abs(a).max(0), q.min(0), q.max(0))
        centre, times = self.values["centre"], self.values["times"]
        if "scale" in self.values:
            c = self.values["scale"][:, None, :] * self.values["way"][None, :, None]
        else:
            c = self.values["coefficients"]
        found = np.empty((3, 2, len(centre)))
        for i in range(len(centre)):
            for order in range(3):
                segments = zip(c[:, i], np.diff(times), strict=True)
                spans = [_range(x, h, order) for x, h in segments]
                found[order, :, i] = min(x for x, _ in spans), max(x for _, x in spans)
        widest = abs(found).max(1)
        return PathPeaks(widest[1], widest[2], centre + found[0, 0], centre + found[0, 1])

    def check_limits(self, model: Model | None = None) -> None:
        """Raise SpatialDynError, naming the joint, where the path leaves position limits or is faster than a joint."""
        model = check_model(model if model is not None else self.model)
        self.check_model(model)
        peaks = self.peaks()
        for joint in model.joints[1:]:
            for k in range(joint.idx_q, joint.idx_q + joint.nq):
                low, high = model.lower[k], model.upper[k]
                room = ROUNDING * max(1.0, *(abs(x) for x in (low, high) if math.isfinite(x)), 1.0)
                for x, far in ((peaks.lowest[k], low - peaks.lowest[k]), (peaks.highest[k], peaks.highest[k] - high)):
                    if far > room:
                        raise SpatialDynError(
                            f'path moves joint "{joint.name}" to {x:.6g}, expected its limits, {low:.6g} to {high:.6g}'
                        )
            for k in range(joint.idx_v, joint.idx_v + joint.nv):
                most = model.velocity_limit[k]
                if peaks.v[k] > most * (1.0 + ROUNDING):
                    raise SpatialDynError(
                        f'path moves joint "{joint.name}" at {peaks.v[k]:.6g}, expected at most {most:.6g}, its limit'
                    )

    def check_model(self, model: Model) -> None:
        """Raise SpatialDynError unless the path is of this model's coordinates."""
        check_model(model)
        if self.model is not None:
            if self.model != model:
                raise SpatialDynError(f'path is of robot "{self.model.name}", expected one of "{model.name}"')
            return
        if len(self.values["centre"]) != model.nq or any(x.kind not in R1 for x in _own_rows(model)):
            raise SpatialDynError(
                f"path has {len(self.values['centre'])} coordinates that are numbers, expected the {model.nq} of robot "
                f'"{model.name}": make it with model=model'
            )

    def plot(self, path: str | None = None) -> Figure:
        """Draw q, v and a over time with Matplotlib; path: a file to write too. Returns the Figure."""
        from ..pictures.control_plots import plot_path

        return plot_path(self, path)


def _own_rows(model: Model) -> Any:
    """Rows of the table with coordinates of their own."""
    return (row for row in model.bodies[1:] if not row["leader"])


@lru_cache(maxsize=32)
def _line(n: int) -> Model:
    """A robot of n coordinates that are numbers."""
    builder = ModelBuilder("numbers")
    for k in range(n):
        builder.add_body(f"b{k}", None, "prismatic", (1, 0, 0), None, (1.0, (0, 0, 0), np.zeros((3, 3))))
    return builder.build()


def _range(c: Array, h: float, order: int) -> tuple[float, float]:
    """Least and largest value of a derivative of Σ c_m s^m for s in [0, h]."""
    p = np.polynomial.Polynomial(c).deriv(order) if order else np.polynomial.Polynomial(c)
    roots = p.deriv().roots() if p.degree() > 1 else np.empty(0)
    inside = [float(x.real) for x in np.atleast_1d(roots) if abs(x.imag) < 1e-9 * h and 0.0 < x.real < h]
    values = p(np.array([0.0, h, *inside]))
    return float(values.min()), float(values.max())


# --- paths through configurations -----------------------------------------------------------------------


def spline(
    times: ArrayLike, points: ArrayLike, model: Model | None = None, ends: str = "rest", limits: bool = True
) -> Path:
    """A path through points by cubic splines: q, v and a are continuous.

    times   (N,)  increasing, from 0 or later [s]
    points  (N, nq)  configurations [rad | m]
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
    if q.ndim != 2 or len(q) != len(at):
        raise ShapeError(f"points has shape {q.shape}, expected ({len(at)}, nq)")
    u = _displacements(model, "points", q)
    h, slope = np.diff(at)[:, None], np.diff(u, axis=0) / np.diff(at)[:, None]
    bend = _second_derivatives(h, slope, ends == "rest")
    c = np.stack(
        [u[:-1], slope - h / 6.0 * (2.0 * bend[:-1] + bend[1:]), 0.5 * bend[:-1], np.diff(bend, axis=0) / (6.0 * h)], -1
    )
    return _polynomial(model, q[0], at, c, limits)


def _second_derivatives(h: Array, slope: Array, rest: bool) -> Array:
    """Of a cubic spline at its knots: a tridiagonal system, solved by elimination (Thomas)."""
    n = len(h) + 1
    lower, middle, upper, right = np.zeros(n), np.ones(n), np.zeros(n), np.zeros((n, slope.shape[1]))
    widths = h[:, 0]
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

    q0, q1  (nq,)  configurations [rad | m]
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

    q0, q1        (nq,)  configurations [rad | m]
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
        if x.shape not in ((), way.shape):
            raise ShapeError(f"{name} has shape {x.shape}, expected a number or {way.shape}")
        if not (x > 0.0).all() or np.isnan(x).any():
            raise SpatialDynError(f"{name} is {x.tolist()}, expected numbers above 0")
        with np.errstate(divide="ignore"):
            most.append(float((np.broadcast_to(x, way.shape) / abs(way)).min(initial=np.inf)))
    if not way.any():
        raise SpatialDynError("q1 is q0, expected another configuration")
    if not all(map(math.isfinite, most[1:])):
        raise SpatialDynError(f"a_max is {a_max!r}, expected finite numbers")
    fast, a = most
    rise = min(fast / a, math.sqrt(1.0 / a))  # s goes from 0 to 1 at a rate of a rise at most
    level = max(0.0, 1.0 / (a * rise) - rise)
    bends = [0.0, rise, rise + level, 2.0 * rise + level] if level > 0.0 else [0.0, rise, 2.0 * rise]
    s = [[0.0, 0.0, 0.5 * a], [0.5 * a * rise**2, a * rise, 0.0], [1.0 - 0.5 * a * rise**2, a * rise, -0.5 * a]]
    s = s if level > 0.0 else [s[0], s[2]]
    return _timed(model, start, way, np.array(bends), np.array(s), limits)


def fourier(
    cosines: ArrayLike, sines: ArrayLike, frequency: float, centre: ArrayLike, model: Model | None = None,
    limits: bool = True,
) -> Path:  # fmt: skip
    """A periodic path whose displacement from the centre has the rate Σ_k cosines_k cos(kωt) + sines_k sin(kωt).

    cosines, sines  (H, nv)  of the harmonics k = 1 .. H [rad/s | m/s]
    frequency       of the first [1/s], ω = 2π frequency
    centre          (nq,)  mean configuration [rad | m]
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
        if x.ndim != 2 or not len(x) or x.shape[1] != nv:
            raise ShapeError(f"{name} has shape {x.shape}, expected (harmonics, {nv})")
    if parts["cosines"].shape != parts["sines"].shape:
        raise ShapeError(f"sines has shape {parts['sines'].shape}, expected that of cosines, {parts['cosines'].shape}")
    values = {"centre": base.copy(), "frequency": np.array([step]), **{name: x.copy() for name, x in parts.items()}}
    return _checked(Path(model, fourier_spec(len(parts["sines"])), values, 1.0 / step), limits)


def _polynomial(model: Model | None, centre: Array, times: Array, c: Array, limits: bool) -> Path:
    values = {"centre": centre.copy(), "times": times.copy(), "coefficients": np.ascontiguousarray(c)}
    return _checked(Path(model, polynomial_spec(len(c), c.shape[-1]), values, float(times[-1])), limits)


def _timed(model: Model | None, centre: Array, way: Array, times: Array, scale: Array, limits: bool) -> Path:
    values = {"centre": centre.copy(), "way": way.copy(), "times": times, "scale": scale}
    return _checked(Path(model, timed_spec(*scale.shape), values, float(times[-1])), limits)


def _checked(path: Path, limits: bool) -> Path:
    if as_flag("limits", limits) and path.model is not None:
        path.check_limits()
    return path


def _positive(name: str, value: float) -> float:
    x = as_number(value)
    if not 0.0 < x < math.inf:
        raise SpatialDynError(f"{name} is {value!r}, expected a finite number above 0")
    return x


def _start(model: Model | None, name: str, q: Array) -> int:
    """nv of a path that starts from q (nq,). Raises ShapeError."""
    nq = len(q) if model is None and q.ndim == 1 else 0 if model is None else check_model(model).nq
    if q.shape != (nq,) or not nq:
        raise ShapeError(f"{name} has shape {q.shape}, expected ({nq or 'nq'},)")
    return nq if model is None else model.nv


def _way(model: Model | None, q0: ArrayLike, q1: ArrayLike) -> tuple[Array, Array]:
    """q0, and the displacement to q1."""
    start, end = as_array("q0", q0), as_array("q1", q1)
    _start(model, "q0", start)
    if end.shape != start.shape:
        raise ShapeError(f"q1 has shape {end.shape}, expected that of q0, {start.shape}")
    return start, _displacements(model, "q1", np.stack([start, end]))[1]


def _displacements(model: Model | None, name: str, q: Array) -> Array:
    """From the first of some configurations (N, nq) to each (N, nv). Raises for one that turns too far."""
    _start(model, name, as_finite(name, q)[0])
    if model is None:
        return np.asarray(q - q[0])
    difference: Callable[..., Any] = calls["difference"]
    u = np.asarray(difference(model, q[:1], q))
    for joint in model.joints[1:]:
        if joint.nq != joint.nv or joint.nv > 1:
            w = u[:, joint.idx_v + {"planar": 2, "floating": 3}.get(joint.kind, 0) : joint.idx_v + joint.nv]
            far = np.sqrt((w * w).sum(1))
            if far.max() > TURN:
                k = int(far.argmax())
                raise SpatialDynError(
                    f'{name}[{k}] turns joint "{joint.name}" by {far[k]:.3g} rad from the first, expected at most '
                    f"{TURN:g}: several paths, one after another"
                )
    return u
