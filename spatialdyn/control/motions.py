"""Motions between configurations: splines, quintics, trapezoids and Fourier series, each a ``Path``.

A displacement is the twist of each joint from the first configuration. Without a model coordinates are numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_finite, as_word, broadcast, check_model
from ..calls.dynamics import calls
from ..errors import ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..recursions.control.paths import fourier_spec, polynomial_spec, timed_spec
from .paths import TIMES, Path, positive

Array = NDArray[np.float64]
SHORTEST = 1e-50  # s, duration of a quintic; 1 / SHORTEST is the longest: beyond, fifth powers leave the float range
TURN = 3.0  # rad from the centre of a path: beyond π its displacement is not unique


def spline(
    times: ArrayLike, points: ArrayLike, model: Model | None = None, ends: str = "rest", limits: bool = True
) -> Path:
    """A path through points by cubic splines: q, v and a are continuous.

    times   (N,)  increasing, from 0 or later [s]
    points  (N, nq)  configurations [rad | m]; (B, N, nq) for B paths
    model   Model whose coordinates the points have; left out, coordinates are numbers
    ends    "rest": v is 0 at both ends; "natural": a is 0 there
    limits  whether a path beyond the position or velocity limits of the model is an error: here or, without a model, in
            the call or run of a law that follows the path

    Displacements are from the first point, and may rotate by at most 3 rad. At the ends of a path the acceleration
    ("rest") or the velocity ("natural") jumps: runs past these times are of order 1 in dt there, as with ``trapezoid``.
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
    """Second derivatives of a cubic spline at its knots: a tridiagonal system, solved by elimination (Thomas)."""
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
    if not SHORTEST <= (T := positive("T", T)) <= 1.0 / SHORTEST:
        raise SpatialDynError(f"T is {T:g}, expected a time from {SHORTEST:g} to {1.0 / SHORTEST:g} s")
    start, way = _way(model, q0, q1)
    s = np.array([[0.0, 0.0, 0.0, 10.0 / T**3, -15.0 / T**4, 6.0 / T**5]])
    return _timed(model, start, way, np.array([0.0, T]), s, limits)


def trapezoid(
    q0: ArrayLike, q1: ArrayLike, v_max: ArrayLike, a_max: ArrayLike, model: Model | None = None, limits: bool = True
) -> Path:
    """The fastest synchronized path from rest at q0 to rest at q1 within limits of velocity and acceleration.

    q0, q1        (nq,)  configurations [rad | m]; one or both (B, nq) for B paths, each as fast as possible
    v_max, a_max  numbers or (nv,)  largest velocities and accelerations, above 0
    model, limits as in ``spline``

    Accelerations jump at the corners. A law that feeds them forward has order 4 with rk4 in between, but a step with a
    jump inside or at its end leaves an error of order 1 in dt, which decays by the gains; ``quintic`` has no jumps.

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
    rise = np.minimum(fast / a, np.sqrt(1.0 / a))  # s goes from 0 to 1 with a rate of at most a * rise
    level, none = np.maximum(0.0, 1.0 / (a * rise) - rise), 0.0 * rise
    bends = np.stack([none, rise, rise + level, 2.0 * rise + level], -1)
    s = [none, none, 0.5 * a], [0.5 * a * rise**2, a * rise, none], [1.0 - 0.5 * a * rise**2, a * rise, -0.5 * a]
    scale = np.stack([np.stack(x, -1) for x in s], -2)
    if not level.any():  # no path reaches the largest velocity
        bends, scale = bends[..., [0, 1, 3]], scale[..., [0, 2], :]
    return _timed(model, start, way, bends, scale, limits)


def fourier(
    cosines: ArrayLike, sines: ArrayLike, frequency: float, centre: ArrayLike, model: Model | None = None,
    limits: bool = True,
) -> Path:  # fmt: skip
    """A periodic path whose displacement from the centre has the rate Σ_k cosines_k cos(kωt) + sines_k sin(kωt).

    cosines, sines  (H, nv)  of the harmonics k = 1 .. H [rad/s | m/s]; (B, H, nv) for B paths
    frequency       of the first harmonic [1/s], ω = 2π frequency
    centre          (nq,)  mean configuration [rad | m], or (B, nq)
    model, limits   as in ``spline``

    Source  Swevers et al., Optimal robot excitation and identification (1997).

    >>> import numpy as np, spatialdyn as sd
    >>> path = sd.fourier([[1.0]], [[0.0]], 0.5, [0.2])
    >>> bool(np.isclose(path(0.5).q[0], 0.2 + 1.0 / np.pi))
    True
    """
    base, step = as_array("centre", centre), positive("frequency", frequency)
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
    return _checked(Path(model, fourier_spec(parts["sines"].shape[-2]), values, 1.0 / step, limits))


def _polynomial(model: Model | None, centre: Array, times: Array, c: Array, limits: bool) -> Path:
    values = {"centre": centre.copy(), "times": times.copy(), "coefficients": np.ascontiguousarray(c)}
    return _checked(Path(model, polynomial_spec(c.shape[-3], c.shape[-1]), values, float(times[-1]), limits))


def _timed(model: Model | None, centre: Array, way: Array, times: Array, scale: Array, limits: bool) -> Path:
    values = {"centre": centre.copy(), "way": way.copy(), "times": times, "scale": scale}
    return _checked(Path(model, timed_spec(*scale.shape[-2:]), values, float(times[..., -1].max()), limits))


def _checked(path: Path) -> Path:
    if path.model is not None:
        path.check_model(path.model)
    return path


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
    """Displacements (..., N, nv) from the first configuration to each (..., N, nq). Raises if one turns too far."""
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
