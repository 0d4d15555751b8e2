"""Derivatives of dynamics under a table of constraints."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.dynamics import calls
from ..model.model import Model
from ..recursions.constraints.constraint_derivatives import DERIVATIVES
from .calls import call
from .dynamics import constrained_motion, constraint_jacobian, response, stabilization_time
from .table import Constraints

Array = NDArray[np.float64]


class ConstrainedDerivatives(NamedTuple):
    """Derivatives of a (..., nv, nv) and of the constraints' forces (..., nc, nv) by q, v and tau."""

    da_dq: Array
    da_dv: Array
    da_dtau: Array
    dforce_dq: Array
    dforce_dv: Array
    dforce_dtau: Array


def constrained_dynamics_derivatives(
    model: Model,
    constraints: Constraints,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    stabilization: Any = None,
    fext: ArrayLike | None = None,
) -> ConstrainedDerivatives:
    """Derivatives of the forward dynamics under constraints, ``a, force = constrained_dynamics(...)[:2]``.

    Source: the derivative of M a + h = tau + Jᵀ force and J a + J̇ v = 0, with ∂h by ``rnea_derivatives`` and the
    derivatives of the rows of J by ``recursions.constraints.constraint_derivatives``; each column solves
    M x - Jᵀ y = r, J x = s.

    model          Model
    constraints    Constraints of this model
    q              (..., nq)  joint positions [rad | m]
    v              (..., nv)  joint velocities [rad/s | m/s]
    tau            (..., nv)  joint torques [N m | N]
    stabilization  T [s], as in ``constrained_dynamics``
    fext           (..., njoints, 6)  force on each joint's body, fixed in the joint's frame [N | N m]

    Returns ConstrainedDerivatives (da_dq, da_dv, da_dtau, dforce_dq, dforce_dv, dforce_dtau), (..., nv, nv) and
    (..., nc, nv), by q along integrate(q, e_k). Equations that depend on others have forces of 0, with derivatives of
    0. If the rank changes, no derivative exists; the derivative for the kept equations is returned.
    Raises  as ``constrained_dynamics``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x")])
    >>> found = sd.constrained_dynamics_derivatives(model, held, [0.5, -0.3], [0.0, 0.0], [0.0, 0.0])
    >>> J = sd.constraint_jacobian(model, held, [0.5, -0.3])
    >>> bool(abs(J @ found.da_dtau).max() < 1e-12)
    True
    """
    rate = None if stabilization is None else 1.0 / stabilization_time(stabilization)
    a, force, _, _ = constrained_motion(model, constraints, q, v, tau, stabilization, fext=fext)
    n, m, batch = model.nv, constraints.nc, a.shape[:-1]
    rows = np.broadcast_to(call(DERIVATIVES, model, constraints, q, v, a, force, rate), (*batch, 2 * m + n, n))
    by = np.broadcast_to(calls["rnea_derivatives"](model, q, v, a, fext), (*batch, 3, n, n))
    J, inverse = constraint_jacobian(model, constraints, q), calls["minverse"](model, q)

    # without constraints x = M⁻¹ r; a column's response takes J x to s
    pulls = np.concatenate([rows[..., 2 * m :, :] - by[..., 0, :, :], -by[..., 1, :, :]], axis=-1)
    free = np.concatenate([inverse @ pulls, np.broadcast_to(inverse, (*batch, n, n))], axis=-1)
    wanted = -(J @ free)
    wanted[..., : 2 * n] -= np.concatenate([rows[..., :m, :], rows[..., m : 2 * m, :]], axis=-1)
    at = np.asarray(q, np.float64)[..., None, :]
    change, impulse = response(model, constraints, at, np.swapaxes(wanted, -1, -2), check=False)[:2]
    x, y = free + np.swapaxes(change, -1, -2), np.swapaxes(impulse, -1, -2)
    parts = [part[..., k * n : (k + 1) * n] for part in (x, y) for k in range(3)]
    return ConstrainedDerivatives(*parts)
