"""One time step of a model on which constant torques and forces act."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import SE2, SE3
from ..errors import NonFiniteError, SpatialDynError, literal
from ..model.model import Model
from ..recursions.coordinates.coordinate_rates import TURN
from ..recursions.spec import FEXT, TAU, Q, V
from .arguments import as_array, batch_shape, broadcast, check_model
from .dynamics import calls, checked_call

Array = NDArray[np.float64]


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
