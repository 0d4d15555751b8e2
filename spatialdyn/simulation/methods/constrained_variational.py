"""The variational integrator under constraints: symplectic on the constrained phase space, for joints of every kind.

Constraint impulses act at the two ends of a step, through J(q)ᵀ and J(q⁺)ᵀ; with the terms of ``variational``,

    J(q)ᵀ μ⁻ = p + ½ h f(q) + J_φ(q)ᵀ Λ,   q⁺ = q ∘ exp(ξ),   φ(q⁺) = 0
    p⁺ = J(q⁺)ᵀ μ⁺ + ½ h f(q⁺) + J_φ(q⁺)ᵀ Λ⁺,   J_φ(q⁺) M⁻¹ p⁺ = 0

which is RATTLE (``rattle``) with the discrete Lagrangian of ``variational``: reversible and of order 2. Newton's steps
find Λ; h times Delassus' matrix approximates ∂φ(q⁺)/∂Λ.

Source: after Leyendecker, Marsden, Ortiz, Variational integrators for constrained dynamical systems (2008), with
multipliers instead of their null space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import EPS
from ...calls.dynamics import calls
from ...constraints.dynamics import constraint_jacobian
from ...model.model import Model
from ..effects.constraints import Constrained, closed, momentum_along
from ..system import STALLED, State, System, set_status
from .iteration import SETTLED, SWEEPS, relative

Array = NDArray[np.float64]
NAME = "variational"
ROUNDING = 4.0 * EPS  # of an iterate


def constrained_variational(constrained: Constrained, model: Model) -> Callable[..., None]:
    """The step, which advances (q, p); ξ is written in row 0 of ``state.work``. It raises ConstraintError."""
    n, constraints = model.nv, constrained.constraints
    impulse, xi = np.zeros(constraints.nc), np.zeros(n)  # Λ and ξ of the last step, from which the next starts

    def step(system: System, t: float, h: float, state: State) -> None:
        k, q, p = system.kernels, state.q.copy(), state.w.copy()
        g, left, change = (np.zeros(n) for _ in range(3))
        J = constraint_jacobian(model, constraints, q)
        set_status(system, k.load(system, q, g), t)

        def settle() -> Array:
            """Solve for ξ, and so for q⁺, at the present Λ."""
            before: Any = math.inf
            for _ in range(SWEEPS):
                system.torque(system, t, q, xi / h)
                set_status(system, k.before(system.table, q, xi, state.by_row, left), t)
                rest = left / h - p - 0.5 * h * (system.tau - g) - J.T @ impulse
                set_status(system, k.velocity(system.table, q, rest, change), t)
                xi[:] -= h * change
                moved = float(relative(abs(h * change).max(initial=0.0), abs(xi).max(initial=0.0)))
                if system.status[0] != 0 or moved <= ROUNDING or (moved <= SETTLED and moved >= before):
                    break
                before = moved
            else:
                set_status(system, STALLED, t, before)
            moved_to: Array = calls["integrate"](model, q, xi)
            return moved_to

        def add(more: Array) -> None:
            impulse[:] += more / h

        ahead = closed(constrained, model, system, t, q, settle, add)
        if system.status[0] != 0:
            return
        set_status(system, k.before(system.table, q, xi, state.by_row, left), t)
        set_status(system, k.after(system.table, ahead, xi, state.by_row, left), t + h)
        set_status(system, k.load(system, ahead, g), t + h)
        system.torque(system, t + h, ahead, xi / h)
        state.q[:], state.work[0][:] = ahead, xi
        state.w[:] = momentum_along(constrained, model, ahead, left / h + 0.5 * h * (system.tau - g))

    return step
