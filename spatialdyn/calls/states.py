"""Random configurations, one time step, and forces at named frames."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import ANGLE, KINDS, PAIR, QUATERNION, SE2, SE3
from ..errors import NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..model.robot_checks import masked
from ..recursions.coordinates.coordinate_rates import TURN
from ..recursions.spec import FEXT, LOCAL, TAU, WORLD, Argument, Q, V
from ..waiting import watch
from .arguments import as_array, batch_shape, broadcast, check_model, reference_code
from .dynamics import calls, checked_call

Array = NDArray[np.float64]

FORCE = Argument("force", (6,), "N | N m", "force at a frame, linear first")


# --- random configurations -------------------------------------------------------------------------------


@watch.call("random_configuration")
def random_configuration(
    model: Model, rng: np.random.Generator | int | None = None, shape: int | tuple[int, ...] = ()
) -> Array:
    """Random configurations: within the limits, rotations uniform on the sphere of quaternions.

    rng    a NumPy Generator, a seed, or None for different states each time; a sample draws nv numbers, so a batch of
           n equals n single samples
    shape  batch shape

    A coordinate without limits is uniform in [-1, 1] m or [-π, π] rad; one with a single limit, in an interval of the
    same length that ends at the limit. Positions of floating and planar joints count as unlimited. With mimic joints
    the independent coordinates are drawn; the others may leave their limits.

    Returns q (*shape, nq) [rad | m].
    Raises  SpatialDynError if rng is none of these; ShapeError if shape is no batch shape.

    >>> import spatialdyn as sd
    >>> random_configuration(sd.load_urdf("two_link"), 0, (5, 3)).shape
    (5, 3, 2)
    """
    check_model(model)
    rng = generator("rng", rng)
    batch = _shape(shape)
    u = rng.random((*batch, model.nv))
    q = np.empty((*batch, model.nq))
    for joint in model.joints[1:]:
        if joint.mimic is not None:
            continue
        kind = KINDS[model.bodies[joint.row - joint.nv + 1]["kind"]]
        part = u[..., joint.idx_v : joint.idx_v + joint.nv]
        at = joint.idx_q
        if kind.group == "R":
            reach = 1.0 if kind.lengths else math.pi
            q[..., at : at + 1] = _within(float(model.lower[at]), float(model.upper[at]), reach, part)
        else:
            q[..., at : at + kind.lengths] = _place(part[..., : kind.lengths])
            if kind.turn:
                q[..., at + kind.lengths : at + kind.nq] = _TURNED[kind.turn](part[..., kind.lengths :])
    return q


def generator(name: str, rng: Any) -> np.random.Generator:
    """A Generator as it is, or a new one from a seed or from None. Raises SpatialDynError naming the argument."""
    if isinstance(rng, np.random.Generator):
        return rng
    whole = isinstance(rng, (int, np.integer)) and not isinstance(rng, bool)
    if rng is None or (whole and rng >= 0):
        return np.random.default_rng(rng)
    what = repr(rng) if whole else f"a {type(rng).__name__}"
    raise SpatialDynError(f"{name} is {what}, expected a numpy.random.Generator, a seed or None")


def _shape(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    try:
        if masked(shape):
            raise TypeError
        sizes = [shape] if np.ndim(shape) == 0 else list(shape)  # type: ignore[arg-type]
        if any(isinstance(n, (bool, np.bool_)) for n in sizes):
            raise TypeError
        batch = tuple(map(operator.index, sizes))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        batch = (-1,)
    if any(n < 0 for n in batch) or math.prod(batch) >= 1 << 48:  # beyond any memory
        raise ShapeError(f"shape is {literal(shape)}, expected a size or a tuple of sizes")
    return batch


def _within(lower: float, upper: float, reach: float, u: Array) -> Array:
    """u in [0, 1) scaled to the limits, or without limits to an interval of length 2 reach."""
    if math.isinf(lower) and math.isinf(upper):
        lower, upper = -reach, reach
    elif math.isinf(lower):
        lower = upper - 2.0 * reach
    elif math.isinf(upper):
        upper = lower + 2.0 * reach
    return np.clip(lower * (1.0 - u) + upper * u, lower, upper)  # upper - lower may overflow


def _place(u: Array) -> Array:
    """Coordinates in [-1, 1] m."""
    return _within(-math.inf, math.inf, 1.0, u)


def _angle(u: Array) -> Array:
    """Angles in [-π, π]."""
    return _within(-math.inf, math.inf, math.pi, u)


def _pair(u: Array) -> Array:
    """(cos, sin) of uniform angles, u (..., 1)."""
    return np.concatenate([np.cos(_angle(u)), np.sin(_angle(u))], -1)


def _quaternion(u: Array) -> Array:
    """Uniform quaternions x y z w from u (..., 3).

    Hopf coordinates of the sphere: (x, y) and (z, w) have uniform phases, and x² + y² is uniform in [0, 1].
    """
    a, b = np.sqrt(u[..., :1]), np.sqrt(1.0 - u[..., :1])
    return np.concatenate([a * _pair(u[..., 1:2]), b * _pair(u[..., 2:])], -1)


_TURNED: dict[int, Callable[[Array], Array]] = {ANGLE: _angle, PAIR: _pair, QUATERNION: _quaternion}


# --- one time step ---------------------------------------------------------------------------------------


def step(
    model: Model,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    method: str = "semi_implicit_euler",
    fext: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """The state a time dt later under constant torques and forces: ``q, v = step(model, q, v, tau, dt)``.

    q      (..., nq)          joint positions [rad | m]
    v      (..., nv)          joint velocities [rad/s | m/s]
    tau    (..., nv)          joint torques [N m | N]
    dt     (...)              time [s]; negative goes back in time
    fext   (..., njoints, 6)  force on each joint's body, in the joint's frame [N | N m]; zero if left out
    method
        explicit_euler        v + a dt and q moved by v dt; order 1, gains energy
        semi_implicit_euler   v + a dt and q moved by the new v dt; order 1, keeps energy bounded. The linear velocity
                              of a floating or planar joint is updated in the body's axes at the beginning of the step,
                              then turned with the body
        rk4                   the classical Runge-Kutta method in the coordinates u of q ∘ exp(u), with u̇ from v by the
                              inverse of ``dintegrate``; order 4 for all joints, which must turn less than 2π a step

    Returns (q, v), new arrays of the common batch shape.
    Raises  SpatialDynError for another method or a dt that is not finite; NonFiniteError if the new state of a finite
            one is not finite; the errors of aba.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> q, v = step(model, [0.5, -0.3], [0.0, 0.0], [0.0, 0.0], 1e-3)
    >>> bool((abs(q - [0.5, -0.3]) < 1e-4).all())
    True
    """
    check_model(model)
    try:
        advance = _METHODS[method]
    except (KeyError, TypeError):
        raise SpatialDynError(f"method is {literal(method)}, expected one of {', '.join(_METHODS)}") from None
    h = as_array("dt", dt)
    if not np.isfinite(h).all():
        raise SpatialDynError(f"dt is {literal(dt)}, expected finite numbers")
    specs = [Q, V, TAU] if fext is None else [Q, V, TAU, FEXT]
    values = [q, v, tau] if fext is None else [q, v, tau, fext]
    given = [as_array(x.name, value) for x, value in zip(specs, values, strict=True)]
    batch = broadcast(
        [*(x.name for x in specs), "dt"],
        [*(batch_shape(model, x, a) for x, a in zip(specs, given, strict=True)), h.shape],
    )
    q0, v0 = _full_batch(given[0], batch), _full_batch(given[1], batch)
    with np.errstate(over="ignore", invalid="ignore"):
        q1, v1 = advance(model, q0, v0, given[2], h[..., None], None if fext is None else given[3])
    if not (np.isfinite(q1).all() and np.isfinite(v1).all()):
        _raise_if_not_finite(batch, given, (q1, v1))
    return q1, v1


def _full_batch(x: Array, batch: tuple[int, ...]) -> Array:
    """x (..., n) broadcast to the batch shape: itself, or a copy."""
    shape = (*batch, x.shape[-1])
    return x if x.shape == shape else np.array(np.broadcast_to(x, shape))


def _raise_if_not_finite(batch: tuple[int, ...], given: list[Array], after: tuple[Array, Array]) -> None:
    """Raise NonFiniteError if a sample of finite input gave a state that is not finite."""
    finite = np.ones(batch, bool)
    for x, axes in zip(given, (1, 1, 1, 2), strict=False):
        finite &= np.isfinite(x).all(axis=tuple(range(-axes, 0)))
    lost = finite & ~(np.isfinite(after[0]).all(-1) & np.isfinite(after[1]).all(-1))
    if lost.any():
        at = np.argwhere(lost)[0].tolist()
        where = f" in sample {at[0] if len(at) == 1 else tuple(at)}, the first of {lost.sum()}" if batch else ""
        raise NonFiniteError(f"the step from a finite state is not finite{where}, expected a smaller dt")


def _explicit_euler(model: Model, q: Array, v: Array, tau: Array, h: Array, fext: Array | None) -> tuple[Array, Array]:
    a = calls["aba"](model, q, v, tau, fext)
    return calls["integrate"](model, q, v * h), v + a * h


def _semi_implicit_euler(
    model: Model, q: Array, v: Array, tau: Array, h: Array, fext: Array | None
) -> tuple[Array, Array]:
    w = v + calls["aba"](model, q, v, tau, fext) * h
    kinds = {int(x) for x in model.bodies["kind"]}
    if kinds.isdisjoint((*SE2, *SE3)):
        return calls["integrate"](model, q, w * h), w
    found = checked_call(TURN, model, (v, w, h), (), None)
    return calls["integrate"](model, q, found[..., model.nv :]), found[..., : model.nv].copy()


def _rk4(model: Model, q: Array, v: Array, tau: Array, h: Array, fext: Array | None) -> tuple[Array, Array]:
    """Runge-Kutta on (u, v) with q(t) = q ∘ exp(u(t)): D_v integrate(q, u) u̇ = v (after Munthe-Kaas)."""

    def rate(u: Array, w: Array) -> tuple[Array, Array]:
        by_u = calls["dintegrate"](model, q, u)[..., 1, :, :]
        a = calls["aba"](model, calls["integrate"](model, q, u), w, tau, fext)
        return np.linalg.solve(by_u, w[..., None])[..., 0], a

    u1, a1 = v, calls["aba"](model, q, v, tau, fext)
    u2, a2 = rate(u1 * (h / 2), v + a1 * (h / 2))
    u3, a3 = rate(u2 * (h / 2), v + a2 * (h / 2))
    u4, a4 = rate(u3 * h, v + a3 * h)
    moved = (u1 + 2.0 * u2 + 2.0 * u3 + u4) * (h / 6)
    return calls["integrate"](model, q, moved), v + (a1 + 2.0 * a2 + 2.0 * a3 + a4) * (h / 6)


_METHODS: dict[str, Callable[[Model, Array, Array, Array, Array, Array | None], tuple[Array, Array]]] = {
    "explicit_euler": _explicit_euler,
    "semi_implicit_euler": _semi_implicit_euler,
    "rk4": _rk4,
}


# --- forces at frames ------------------------------------------------------------------------------------


def wrench_at(model: Model, q: ArrayLike, frame: str | Frame, force: ArrayLike, reference: str = "local") -> Array:
    """A force at a named frame as ``fext``, the argument of rnea, aba and static_torque.

    q          (..., nq)  joint positions [rad | m]
    frame      name of a link or joint; link:NAME or joint:NAME if both have it
    force      (..., 6)   force and moment, linear first [N | N m]
    reference  local: at the frame's origin in its axes; local_world_aligned: there in the world's axes;
               world: at the world's origin in the world's axes

    A force on a link fixed to the world goes to row 0, which is ignored. Sum the fext of several forces.

    Returns fext (..., njoints, 6): zero except the row of the frame's joint, in that joint's frame.
    Raises  ModelError if there is no such frame; SpatialDynError for another reference; ShapeError.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> wrench_at(model, [0.5, -0.3], model.joints[2].name, [1, 0, 0, 0, 0, 0])[2].tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    check_model(model)
    place, code = model.frame(frame), reference_code(reference)
    q, force = as_array("q", q), as_array("force", force)
    batch = broadcast(["q", "force"], [batch_shape(model, Q, q), batch_shape(model, FORCE, force)])
    f, n = force[..., :3], force[..., 3:]
    if code != LOCAL:
        X = calls["frame_placement"](model, q, place)
        if code == WORLD:
            n = n - np.cross(X[..., :3, 3], f)
        f, n = (np.einsum("...ji,...j->...i", X[..., :3, :3], x) for x in (f, n))
    R, p = place.placement[:3, :3], place.placement[:3, 3]
    f = f @ R.T
    fext = np.zeros((*batch, model.njoints, 6))
    fext[..., place.joint, :3] = f
    fext[..., place.joint, 3:] = n @ R.T + np.cross(p, f)
    return fext
