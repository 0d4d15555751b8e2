"""The variational integrator under constraints: symplectic on the constrained phase space, for joints of every kind.

Constraint impulses act at the two ends of a step, through J(q)ᵀ and J(q⁺)ᵀ; with the terms of ``variational``,

    J(q)ᵀ μ⁻ = p + ½ h f(q) + J_φ(q)ᵀ Λ,   q⁺ = q ∘ exp(ξ),   φ(q⁺) = 0
    p⁺ = J(q⁺)ᵀ μ⁺ + ½ h f(q⁺) + J_φ(q⁺)ᵀ Λ⁺,   J_φ(q⁺) M⁻¹ p⁺ = 0

which is RATTLE (``rattle``) with the discrete Lagrangian of ``variational``: reversible and of order 2. Λ is found by
Newton's steps, h times Delassus' matrix being nearly the slope of φ(q⁺) by Λ.

Source: after Leyendecker, Marsden, Ortiz, Variational integrators for constrained dynamical systems (2008), with
multipliers in place of their null space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import EPS
from ..calls.dynamics import calls
from ..constraints.dynamics import constraint_error, constraint_jacobian, response
from ..model.model import Model
from .constrained import Held, check_rank
from .symplectic import SETTLED, SWEEPS, relative
from .system import STALLED, State, System, set_status

Array = NDArray[np.float64]
NAME = "variational"
ROUNDING = 4.0 * EPS  # of an iterate


def held_variational(held: Held, model: Model) -> Callable[..., None]:
    """The step, which advances (q, p). It raises ConstraintError."""
    n, constraints, known = model.nv, held.constraints, int(held.rank[0])
    impulse, xi = np.zeros(constraints.nc), np.zeros(n)  # Λ and ξ of the last step, from which the next starts

    def step(system: System, t: float, h: float, state: State) -> None:
        k, q, p = system.kernels, state.q.copy(), state.w.copy()
        rotor, g, left, change = (np.zeros(n) for _ in range(4))
        J = constraint_jacobian(model, constraints, q)
        set_status(system, k.load(system, q, g), t)

        def settle() -> None:
            """Solve for ξ at the Λ so far."""
            before: Any = math.inf
            for _ in range(SWEEPS):
                system.torque(system, t, q, xi / h)
                set_status(system, k.before(system.table, q, xi, state.by_row, rotor, left), t)
                rest = left / h - p - 0.5 * h * (system.tau - g) - J.T @ impulse
                set_status(system, k.velocity(system.table, q, rest, change), t)
                xi[:] -= h * change
                moved = float(relative(abs(h * change).max(initial=0.0), abs(xi).max(initial=0.0)))
                if system.status[0] != 0 or moved <= ROUNDING or (moved <= SETTLED and moved >= before):
                    return
                before = moved
            set_status(system, STALLED, t, before)

        before = math.inf
        for sweep in range(SWEEPS):
            settle()
            ahead = calls["integrate"](model, q, xi)
            phi = constraint_error(model, constraints, ahead)
            size = float(abs(phi).max(initial=0.0))
            if system.status[0] != 0 or size <= EPS or (size <= SETTLED and size >= 0.5 * before):
                break
            if sweep == SWEEPS - 1:
                set_status(system, STALLED, t, size)
            before = size
            _, more, _, rank = response(model, constraints, q, -phi, check=False)
            check_rank(held, rank, known)
            impulse[:] += more / h
        if system.status[0] != 0:
            return
        set_status(system, k.before(system.table, q, xi, state.by_row, rotor, left), t)
        set_status(system, k.after(system.table, ahead, xi, state.by_row, rotor, left), t + h)
        set_status(system, k.load(system, ahead, g), t + h)
        system.torque(system, t + h, ahead, xi / h)
        v = calls["velocity_from_momentum"](model, ahead, left / h + 0.5 * h * (system.tau - g))
        Jv = constraint_jacobian(model, constraints, ahead) @ v
        state.q[:] = ahead
        state.w[:] = calls["momentum"](model, ahead, v + response(model, constraints, ahead, -Jv, check=False)[0])

    return step
