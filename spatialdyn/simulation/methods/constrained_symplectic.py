"""Symplectic methods under constraints: their maps are symplectic on the constrained phase space.

RATTLE, Störmer-Verlet with constraints, for robots with v = q̇:

    p½ = p + ½ h (ṗ(q, p½) + Jᵀ λ),   q⁺ = q + ½ h (v(q, p½) + v(q⁺, p½)),   φ(q⁺) = 0
    p⁺ = p½ + ½ h (ṗ(q⁺, p½) + J⁺ᵀ μ),   J⁺ v(q⁺, p⁺) = 0

Newton's steps find λ with Delassus' matrix at q; ½ h² times this matrix approximates the slope of φ(q⁺).

The variational integrator, for joints of every kind: constraint impulses act at the two ends of a step, through J(q)ᵀ
and J(q⁺)ᵀ; with the terms of ``variational``,

    J(q)ᵀ μ⁻ = p + ½ h f(q) + J_φ(q)ᵀ Λ,   q⁺ = q ∘ exp(ξ),   φ(q⁺) = 0
    p⁺ = J(q⁺)ᵀ μ⁺ + ½ h f(q⁺) + J_φ(q⁺)ᵀ Λ⁺,   J_φ(q⁺) M⁻¹ p⁺ = 0

which is RATTLE with the discrete Lagrangian of ``variational``: reversible and of order 2. Newton's steps find Λ; h
times Delassus' matrix approximates ∂φ(q⁺)/∂Λ.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), VII.1.4, after Andersen (1983); after
Leyendecker, Marsden, Ortiz, Variational integrators for constrained dynamical systems (2008), with multipliers instead
of their null space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import EPS
from ...bodies.kinds import R1
from ...calls.dynamics import calls
from ...constraints.dynamics import by_rows, constraint_error, constraint_jacobian, delassus
from ...constraints.kinds import RollingConstraint, VelocityConstraint
from ...constraints.table import Constraints
from ...errors import ConstraintError
from ...model.model import Model
from ...recursions.constraints.constrained import RESPONSE
from ..effects.constraints import Constrained
from ..system import OK, STALLED, State, System, set_status
from .iteration import SETTLED, SWEEPS, relative
from .symplectic import joint_rates

Array = NDArray[np.float64]
RATTLE = "stormer_verlet"
ROUNDING, ROUNDING_OF_MOMENTA = 4.0 * EPS, 8.0 * EPS  # of an iterate
BRANCHING = 1e-3  # smallest / largest eigenvalue of Delassus' matrix, some .03 rad from a branch point


def unfit(model: Model, constraints: Constraints, stabilization: float | None, method: str) -> str:
    """Why a symplectic method cannot take the constraints; "" if it can."""
    rates = [x.label for x in constraints if isinstance(x, (RollingConstraint, VelocityConstraint))]
    expected = "expected equations of positions; explicit methods take those of velocities"
    if rates:
        return f"{method} is given {rates[0]}, {expected}"
    if stabilization is not None:
        return f"stabilization is {stabilization:g} s, expected None for {method}: it keeps φ = 0"
    for joint in model.joints[1:] if method == RATTLE else ():
        if int(model.bodies[joint.row]["kind"]) not in R1:
            what = f'joint "{joint.name}" ({joint.kind})'
            return (
                f"{RATTLE} under constraints is given {what}, expected joints whose position is one number; "
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

            def of_momentum(x: Array) -> tuple[Array, float]:
                joint_rates(system, t, q, x, rates)
                return _changed(x, p + 0.5 * h * (rates[1] + J.T @ force))

            half[:] = _fixed_point(of_momentum, half, ROUNDING_OF_MOMENTA, system, t)
            joint_rates(system, t, q, half, rates)
            start = q + 0.5 * h * rates[0]

            def of_position(x: Array) -> tuple[Array, float]:
                joint_rates(system, t + h, x, half, rates)
                return _changed(x, start + 0.5 * h * rates[0])

            ahead[:] = _fixed_point(of_position, ahead, ROUNDING_OF_MOMENTA, system, t)
            return ahead

        def add(impulse: Array) -> None:
            force[:] += 2.0 / h**2 * impulse

        closed(constrained, model, system, t, q, settle, add)
        joint_rates(system, t + h, ahead, half, rates)
        state.work[2][n:] = half
        z[:n], z[n:] = ahead, momentum_along(constrained, model, ahead, half + 0.5 * h * rates[1])

    return step


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

            def of_displacement(xi: Array) -> tuple[Array, float]:
                system.torque(system, t, q, xi / h)
                set_status(system, k.before(system.table, q, xi, state.by_row, left), t)
                rest = left / h - p - 0.5 * h * (system.tau - g) - J.T @ impulse
                set_status(system, k.velocity(system.table, q, rest, change), t)
                xi[:] -= h * change
                return xi, float(relative(abs(h * change).max(initial=0.0), abs(xi).max(initial=0.0)))

            _fixed_point(of_displacement, xi, ROUNDING, system, t)
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


def _changed(x: Array, new: Array) -> tuple[Array, float]:
    """The new iterate, and its change relative to it."""
    return new, float(abs(new - x).max() / max(abs(new).max(), np.finfo(float).tiny))


def _fixed_point(
    step: Callable[[Array], tuple[Array, float]], x: Array, rounding: float, system: System, t: float
) -> Array:
    """Solve x = step(x)[0] to rounding; sets the status STALLED if it does not converge.

    step  returns also the relative change
    """
    before = math.inf
    for _ in range(SWEEPS):
        x, change = step(x)
        if system.status[0] != 0 or change <= rounding or (change <= SETTLED and change >= before):
            return x
        before = change
    set_status(system, STALLED, t, before)
    return x


# --- the ends of a step ------------------------------------------------------------------------------------


def closed(
    effect: Constrained, model: Model, system: System, t: float, q: Array, settle: Callable[[], Array],
    add: Callable[[Array], None],
) -> Array:  # fmt: skip
    """Positions with φ = 0 at the end of a step of a symplectic method, by Newton's steps on the multipliers.

    settle  returns the positions at the end for the present multipliers
    add     adds to the multipliers the impulse over a time of 1 that changes these positions by -φ

    The slope is Delassus' matrix at q. If that does not converge, as in a step over a branch point, the slope is the
    matrix between J at the beginning and J at the end. Writes the status STALLED if φ does not vanish. Raises
    ConstraintError, also for a failure near a branch point.
    """
    constraints, before, chosen, exact = effect.constraints, np.inf, effect.rows(q), False
    for sweep in range(SWEEPS):
        ahead = settle()
        phi = constraint_error(model, constraints, ahead)
        size = float(abs(phi).max(initial=0.0))
        if system.status[0] != OK or size <= EPS or (size <= SETTLED and size >= 0.5 * before):
            break
        if sweep == SWEEPS - 1:
            set_status(system, STALLED, t, size)
        exact, before = exact or size >= 0.5 * before, size
        if not exact:
            add(by_rows(RESPONSE, model, constraints, q, -phi, chosen)[1])
            continue
        J, end = (constraint_jacobian(model, constraints, x)[chosen > 0.0] for x in (q, ahead))
        impulse = np.zeros(constraints.nc)
        impulse[chosen > 0.0] = -np.linalg.lstsq(end @ calls["minverse"](model, q) @ J.T, phi[chosen > 0.0])[0]
        add(impulse)
    if system.status[0] != OK:
        raise_if_branching(effect, model, q, chosen)
    return ahead


def raise_if_branching(effect: Constrained, model: Model, q: Array, chosen: Array) -> None:
    """Raise ConstraintError if the kept equations nearly depend on each other."""
    G = delassus(model, effect.constraints, q)[np.ix_(chosen > 0.0, chosen > 0.0)]
    values = np.linalg.eigvalsh(G)
    if values[0] < BRANCHING * values[-1]:
        raise ConstraintError(
            f"{', '.join(x.label for x in effect.constraints)} nearly lose rank, {int(chosen.sum())} at the beginning: "
            "the step fails near a branch point, from which the mechanism may go several ways"
        )


def momentum_along(effect: Constrained, model: Model, q: Array, p: Array) -> Array:
    """The momenta nearest to p whose velocities keep J v = 0."""
    v = calls["velocity_from_momentum"](model, q, p)
    Jv = constraint_jacobian(model, effect.constraints, q) @ v
    change = by_rows(RESPONSE, model, effect.constraints, q, -Jv, effect.rows(q))[0]
    made: Array = calls["momentum"](model, q, v + change)
    return made


UNDER = {RATTLE: rattle, "variational": constrained_variational}
