"""Dynamics under a table of constraints: J, φ and drift, accelerations and forces, impacts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.scalars import EPS
from ..calls.arguments import as_array, as_flag, as_number, batch_shape, broadcast
from ..errors import ConstraintError, literal
from ..model.model import Model
from ..recursions.constraints import constrained, constraint_rows
from ..recursions.spec import Spec, V
from .calls import CONTRADICTION, call, raise_contradiction, settled
from .table import Constraints

Array = NDArray[np.float64]
FLOOR = 1e-12  # [m/s | rad/s] velocities below this count as rounding


class ConstrainedMotion(NamedTuple):
    """Accelerations a (..., nv), the constraints' forces (..., nc), residual (...) and rank (...)."""

    a: Array
    force: Array
    residual: Any
    rank: Any


class ConstrainedImpact(NamedTuple):
    """Velocities v (..., nv) after an impact, the constraints' impulses (..., nc), residual (...) and rank (...)."""

    v: Array
    impulse: Array
    residual: Any
    rank: Any


def constraint_jacobian(model: Model, constraints: Constraints, q: ArrayLike) -> Array:
    """Jacobian J(q) of constraints: φ̇ = J v; only joints between the two bodies of a constraint have columns.

    model        Model
    constraints  Constraints of this model
    q            (..., nq)  joint positions [rad | m]

    Returns J (..., nc, nv) [m/rad | 1].
    Raises  as ``frame_jacobian``, ConstraintError and ModelError for constraints of another model

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="xz")])
    >>> J = sd.constraint_jacobian(model, held, [0.5, -0.3])
    >>> bool(abs(J - sd.frame_jacobian(model, [0.5, -0.3], "tip", "local_world_aligned")[[0, 2]]).max() < 1e-15)
    True
    """
    return call(constraint_rows.JACOBIAN, model, constraints, q)  # type: ignore[no-any-return]


def constraint_error(model: Model, constraints: Constraints, q: ArrayLike) -> Array:
    """Errors φ(q) of constraints, with φ̇ = J v; 0 for equations of velocities.

    model        Model
    constraints  Constraints of this model
    q            (..., nq)  joint positions [rad | m]

    Returns φ (..., nc) [m | rad].
    Raises  as ``constraint_jacobian``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.CouplerConstraint("joint2", "joint1", ratio=-2.0)])
    >>> sd.constraint_error(model, held, [0.25, -0.25]).tolist()
    [0.25]
    """
    return call(constraint_rows.ERROR, model, constraints, q)  # type: ignore[no-any-return]


def constraint_drift(model: Model, constraints: Constraints, q: ArrayLike, v: ArrayLike) -> Array:
    """J̇ v of constraints: J a + J̇ v is φ̈.

    model        Model
    constraints  Constraints of this model
    q            (..., nq)  joint positions [rad | m]
    v            (..., nv)  joint velocities [rad/s | m/s]

    Returns J̇ v (..., nc) [m/s² | rad/s²].
    Raises  as ``constraint_jacobian``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip")])
    >>> bool((sd.constraint_drift(model, held, [0.5, -0.3], [0.0, 0.0]) == 0.0).all())
    True
    """
    return call(constraint_rows.DRIFT, model, constraints, q, v)  # type: ignore[no-any-return]


def delassus(model: Model, constraints: Constraints, q: ArrayLike) -> Array:
    """Delassus' matrix G = J M⁻¹ Jᵀ: column i is the change of J v by a unit impulse on equation i.

    model        Model
    constraints  Constraints of this model
    q            (..., nq)  joint positions [rad | m]

    Returns G (..., nc, nc) [1/kg | 1/(kg m²)], symmetric, singular if equations depend on others.
    Raises  as ``constraint_jacobian``, and InertiaError naming a joint with zero articulated inertia

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="xz")])
    >>> sd.delassus(model, held, [0.5, -0.3]).shape
    (2, 2)
    """
    return call(constrained.DELASSUS, model, constraints, q)  # type: ignore[no-any-return]


constraint_jacobian.spec = constraint_rows.JACOBIAN  # type: ignore[attr-defined]  # for ``exact``, as are the others
constraint_error.spec = constraint_rows.ERROR  # type: ignore[attr-defined]
constraint_drift.spec = constraint_rows.DRIFT  # type: ignore[attr-defined]
delassus.spec = constrained.DELASSUS  # type: ignore[attr-defined]


def constrained_motion(
    model: Model,
    constraints: Constraints,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    stabilization: Any = None,
    minimum_norm: bool = False,
    fext: ArrayLike | None = None,
) -> ConstrainedMotion:
    """``constrained_dynamics`` with a table of constraints."""
    rate = None if stabilization is None else 1.0 / stabilization_time(stabilization)
    out = call(constrained.MOTION, model, constraints, q, v, tau, fext, rate, None)
    found = ConstrainedMotion(*_parts(constrained.MOTION, model, constraints, out, q, v, tau, fext, rate))
    if minimum_norm is False or not as_flag("minimum_norm", minimum_norm):
        return found
    J = np.broadcast_to(constraint_jacobian(model, constraints, q), (*found.force.shape, model.nv))
    return found._replace(force=_least_force(J, found.force, np.asarray(found.rank)))


def _least_force(J: Array, force: Array, rank: NDArray[np.intp]) -> Array:
    """The least λ (..., nc) with Jᵀ λ = Jᵀ force: the part of ``force`` in the row space of Jᵀ, of this rank."""
    U, _, _ = np.linalg.svd(np.where(np.isfinite(J), J, 0.0), full_matrices=False)
    kept = np.arange(U.shape[-1]) < rank[..., None]
    along = kept * (np.swapaxes(U, -1, -2) @ force[..., None])[..., 0]
    least: Array = (U @ along[..., None])[..., 0]
    return least


def constrained_impact(
    model: Model, constraints: Constraints, q: ArrayLike, v: ArrayLike, restitution: Any = 0.0
) -> ConstrainedImpact:
    """``impact`` with a table of constraints."""
    elastic = as_number(restitution)
    if not 0.0 <= elastic <= 1.0:
        raise ConstraintError(f"restitution is {literal(restitution)}, expected 0 to 1")
    v, rate = constraint_rate(model, constraints, q, v)
    change, impulse, residual, rank = velocity_response(model, constraints, q, v, -(1.0 + elastic) * rate)
    with np.errstate(invalid="ignore"):  # for samples that are not finite
        return ConstrainedImpact(v + change, impulse, residual, rank)


def constraint_rate(model: Model, constraints: Constraints, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    """v (..., nv) as an array, and φ̇ = J v (..., nc)."""
    J, v = constraint_jacobian(model, constraints, q), as_array("v", v)
    broadcast(["q", "v"], [J.shape[:-2], batch_shape(model, V, v)])
    return v, (J @ v[..., None])[..., 0]


def response(
    model: Model, constraints: Constraints, q: ArrayLike, rhs: ArrayLike, check: bool = True
) -> tuple[Any, ...]:
    """(change, impulse, residual, rank): the least change of velocities, in kinetic energy, that changes J v by rhs.

    rhs    (..., nc)  [m/s | rad/s]
    check  whether equations that contradict others are an error
    """
    out = call(constrained.RESPONSE, model, constraints, q, rhs, None)
    return _parts(constrained.RESPONSE, model, constraints, out, q, rhs, check=check)


def velocity_response(model: Model, constraints: Constraints, q: ArrayLike, v: Array, rhs: Array) -> tuple[Any, ...]:
    """``response`` to rhs = -(1 + e) J v, which equations contradict only by rounding of the terms of J v."""
    change, impulse, residual, rank = response(model, constraints, q, rhs, check=False)
    if np.any(np.greater(residual, 0.0)):
        J = constraint_jacobian(model, constraints, q)
        missed = abs((J @ change[..., None])[..., 0] - rhs)
        least = CONTRADICTION * (model.nv + constraints.nc) * EPS
        if np.any(missed > least * (rate_terms(constraints, J, v) + FLOOR)):
            return response(model, constraints, q, rhs)
    return change, impulse, residual, rank


def rate_terms(constraints: Constraints, J: Array, v: Array) -> Array:
    """|J| |v| (..., nc), for each constraint the largest of its equations, because others may be only rounding."""
    terms: Array = (abs(J) @ abs(v)[..., None])[..., 0]
    for first, count in owned(constraints):
        terms[..., first : first + count] = terms[..., first : first + count].max(axis=-1, keepdims=True)
    return terms


def owned(constraints: Constraints) -> Iterator[tuple[int, int]]:
    """For each constraint its first equation and the number of its equations."""
    first = 0
    for _, of_one in groupby(constraints.equations, key=lambda x: id(x.constraint)):
        count = len([*of_one])
        yield first, count
        first += count


def rows_to_keep(model: Model, constraints: Constraints, q: ArrayLike, rank: Any = None) -> tuple[Array, Any]:
    """Independent equations (..., nc), 1 for equations to keep, and their number; see ``independent_rows``."""
    out = call(constrained.ROWS, model, constraints, q, rank)
    return out[..., :-1], out[..., -1]


def by_rows(spec: Spec, model: Model, constraints: Constraints, *values: Any) -> tuple[Array, Array, float, int]:
    """(x, force, residual, rank) of one sample of a Spec with chosen rows, its last input, or None.

    No errors are raised; without chosen rows, rows are taken in order with any pivots.
    """
    n, m = model.nv, constraints.nc
    out = call(spec, model, constraints, *values)
    return out[:n], out[n : n + m], out[n + m], int(out[n + m + 1])


def stabilization_time(value: Any) -> float:
    """T in seconds. Raises ConstraintError."""
    time = as_number(value)
    if not 0.0 < time < math.inf:
        raise ConstraintError(f"stabilization is {literal(value)}, expected a time in seconds above 0, or None")
    return time


def _parts(
    spec: Spec, model: Model, constraints: Constraints, out: Array, *values: Any, check: bool = True
) -> tuple[Any, ...]:
    """The outputs stored side by side in ``out``. Raises ConstraintError if equations contradict others."""
    n, m = model.nv, constraints.nc
    if out.ndim > 1 or out[-2] >= constrained.UNSURE:
        out = settled(spec, constraints, out, *values)
    if out.ndim == 1:
        residual, rank = out[n + m :].tolist()
        if check and residual > 0.0:
            raise_contradiction(spec, constraints, out, *values)
        return out[:n], out[n : n + m], residual, int(rank)
    if check:
        raise_contradiction(spec, constraints, out, *values)
    return out[..., :n], out[..., n : n + m], out[..., n + m], out[..., n + m + 1].astype(np.intp)
