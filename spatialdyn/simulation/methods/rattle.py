"""Störmer-Verlet with constraints: RATTLE, symplectic on the constrained phase space, for robots with v = q̇.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), VII.1.4, after Andersen (1983).

    p½ = p + ½ h (ṗ(q, p½) + Jᵀ λ),   q⁺ = q + ½ h (v(q, p½) + v(q⁺, p½)),   φ(q⁺) = 0
    p⁺ = p½ + ½ h (ṗ(q⁺, p½) + J⁺ᵀ μ),   J⁺ v(q⁺, p⁺) = 0

Newton's steps find λ with Delassus' matrix at q; ½ h² times this matrix approximates the slope of φ(q⁺).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import EPS
from ...bodies.kinds import R1
from ...constraints.dynamics import constraint_jacobian
from ...constraints.kinds import RollingConstraint, VelocityConstraint
from ...constraints.table import Constraints
from ...model.model import Model
from ..effects.constraints import Constrained, closed, momentum_along
from ..system import STALLED, State, System, set_status
from .iteration import SETTLED, SWEEPS
from .symplectic import joint_rates

Array = NDArray[np.float64]
NAME = "stormer_verlet"
ROUNDING = 8.0 * EPS  # of an iterate


def unfit(model: Model, constraints: Constraints, stabilization: float | None, method: str) -> str:
    """Why a symplectic method cannot take the constraints; "" if it can."""
    rates = [x.label for x in constraints if isinstance(x, (RollingConstraint, VelocityConstraint))]
    expected = "expected equations of positions; explicit methods take those of velocities"
    if rates:
        return f"{method} is given {rates[0]}, {expected}"
    if stabilization is not None:
        return f"stabilization is {stabilization:g} s, expected None for {method}: it keeps φ = 0"
    for joint in model.joints[1:] if method == NAME else ():
        if int(model.bodies[joint.row]["kind"]) not in R1:
            what = f'joint "{joint.name}" ({joint.kind})'
            return (
                f"{NAME} under constraints is given {what}, expected joints whose position is one number; "
                "method variational takes all"
            )
    return ""


def rattle(constrained: Constrained, model: Model) -> Callable[..., None]:
    """The step, which advances z = (q, p) in row 0 of ``state.work``, with p½ in row 2. It raises ConstraintError."""
    n, constraints = model.nv, constrained.constraints
    force = np.zeros(constraints.nc)  # λ of the last step, from which the next starts

    def step(system: System, t: float, h: float, state: State) -> None:
        z, rates = state.work[0], np.zeros((2, n))
        q, p = z[:n].copy(), z[n:].copy()
        J, half, ahead = constraint_jacobian(model, constraints, q), p.copy(), q.copy()

        def settle() -> Any:
            """Solve for p½, then for q⁺, at the present λ."""

            def of_momentum(x: Array) -> Array:
                joint_rates(system, t, q, x, rates)
                return np.asarray(p + 0.5 * h * (rates[1] + J.T @ force))

            half[:] = _fixed_point(of_momentum, half, system, t)
            joint_rates(system, t, q, half, rates)
            start = q + 0.5 * h * rates[0]

            def of_position(x: Array) -> Array:
                joint_rates(system, t + h, x, half, rates)
                return np.asarray(start + 0.5 * h * rates[0])

            ahead[:] = _fixed_point(of_position, ahead, system, t)
            return ahead

        def add(impulse: Array) -> None:
            force[:] += 2.0 / h**2 * impulse

        closed(constrained, model, system, t, q, settle, add)
        joint_rates(system, t + h, ahead, half, rates)
        state.work[2][n:] = half
        z[:n], z[n:] = ahead, momentum_along(constrained, model, ahead, half + 0.5 * h * rates[1])

    return step


def _fixed_point(step: Callable[[Array], Array], x: Array, system: System, t: float) -> Array:
    """Solve x = step(x) to rounding; sets the status STALLED if it does not converge."""
    before: Any = np.inf
    for _ in range(SWEEPS):
        new = step(x)
        change = float(abs(new - x).max() / max(abs(new).max(), np.finfo(float).tiny))
        x = new
        if system.status[0] != 0 or change <= ROUNDING or (change <= SETTLED and change >= before):
            return x
        before = change
    set_status(system, STALLED, t, before)
    return x
