"""Explicit methods in (q, v): Euler's, semi-implicit Euler, velocity Verlet, and the Runge-Kutta method of order 4.

q moves on the joints' group, q ∘ exp(h v) in the body's frame, so quaternions keep their unit norm and no chart is
needed. Semi-implicit steps compute the new linear velocity of a floating or planar joint in the body's axes at the
beginning, move the body along this straight line, then turn the velocity with the body: the explicit rotation
-h ω × v would make it grow by ½ h² ω² a step. None of these methods is symplectic once M depends on q; those of
``symplectic`` and ``variational`` are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...algebra.scalars import inline, inline_unoptimized
from ...engines.compiled import numba_kernels
from ...engines.compiled.checks import all_finite
from ...engines.compiled.table_kernels import kernel
from ...recursions import SPECS
from ...recursions.coordinates.coordinate_rates import largest_turn, rate_of_displacement, turn
from ..system import NONFINITE, OK, TURNED, State, System, add_scaled, copy, set_status

HALF_TURN = 9.8696  # π² [rad²]


class ExplicitKernels(NamedTuple):
    """``accelerate(system, q, v, a)``, and compiled kernels that return a status."""

    accelerate: Any
    aba: Any
    integrate: Any
    displacement_rate: Any
    turn: Any


def kernels(loaded: bool) -> ExplicitKernels:
    """The kernels of these methods, compiled at first use; ``loaded``: with external forces."""
    aba = numba_kernels.sample_kernel(numba_kernels.variant(SPECS["aba"], frozenset({"fext"} if loaded else ())))
    integrate = numba_kernels.sample_kernel(SPECS["integrate"])
    group = kernel(displacement_rate, 1, 1, 1), kernel(turn, 1, 1, 1, 1)
    return ExplicitKernels(_loaded if loaded else _free, aba, integrate, *group)


@inline_unoptimized
def _free(system: System, q: Any, v: Any, a: Any) -> int:
    return system.kernels.aba(system.table, q, v, system.tau, a)  # type: ignore[no-any-return]


@inline_unoptimized
def _loaded(system: System, q: Any, v: Any, a: Any) -> int:
    return system.kernels.aba(system.table, q, v, system.tau, system.fext, a)  # type: ignore[no-any-return]


@inline
def displacement_rate(bodies: Any, u: Any, v: Any, out: Any) -> int:
    """``rate_of_displacement``; returns TURNED if a joint turns by π or more, too near 2π, where exp is singular."""
    rate_of_displacement(bodies, u, v, out)
    return OK if largest_turn(bodies, u) < HALF_TURN else TURNED


@inline_unoptimized
def acceleration(system: System, t: float, q: Any, v: Any, a: Any) -> None:
    """Write the acceleration a of the state (q, v) at time t."""
    system.torque(system, t, q, v)
    set_status(system, system.kernels.accelerate(system, q, v, a), t)


@inline_unoptimized
def move(system: System, t: float, u: Any, state: State) -> None:
    """q ← q ∘ exp(u)."""
    copy(state.stage, state.q)
    set_status(system, system.kernels.integrate(system.table, state.stage, u, state.q), t)


@inline_unoptimized
def explicit_euler(system: System, t: float, h: float, state: State) -> None:
    """q⁺ = q ∘ exp(h v), v⁺ = v + h a(q, v)."""
    a, u = state.work[0], state.work[1]
    acceleration(system, t, state.q, state.w, a)
    for i in range(len(u)):
        u[i] = h * state.w[i]
    move(system, t, u, state)
    add_scaled(state.w, state.w, h, a)


@inline_unoptimized
def semi_implicit_euler(system: System, t: float, h: float, state: State) -> None:
    """v⁺ = v + h a(q, v), q⁺ = q ∘ exp(h v⁺); ``turn`` gives the linear velocity of a joint that also rotates."""
    a, before = state.work[0], state.work[2]
    acceleration(system, t, state.q, state.w, a)
    copy(before, state.w)
    add_scaled(state.w, state.w, h, a)
    move_turned(system, t, h, before, state)


@inline_unoptimized
def move_turned(system: System, t: float, h: float, v: Any, state: State) -> None:
    """Move q by the velocities w of a step, and turn them with the bodies; v as in ``turn``."""
    u, steps = state.work[1], state.work[3]
    for i in range(len(u)):
        steps[i] = h
    set_status(system, system.kernels.turn(system.table, steps, v, state.w, u), t)
    move(system, t, u, state)


@inline_unoptimized
def velocity_verlet(system: System, t: float, h: float, state: State) -> None:
    """q⁺ = q ∘ exp(h v + ½ h² a), v⁺ = v + ½ h (a + a⁺) with a⁺ = a(q⁺, v + h a).

    The velocity in a⁺ is a prediction, as Coriolis forces depend on it; Störmer's method has no such forces.
    """
    a, b, u, w = state.work[0], state.work[1], state.work[2], state.work[3]
    acceleration(system, t, state.q, state.w, a)
    add_scaled(w, state.w, h, a)
    for i in range(len(u)):
        u[i] = h * (state.w[i] + 0.5 * h * a[i])
    move(system, t, u, state)
    acceleration(system, t + h, state.q, w, b)
    add_scaled(state.w, state.w, 0.5 * h, a)
    add_scaled(state.w, state.w, 0.5 * h, b)


@inline_unoptimized
def _stage(system: System, t: float, c: float, u1: Any, a1: Any, u2: Any, a2: Any, state: State) -> None:
    """Slopes u2, a2 at time t of the state that slopes u1, a1 reach after a time c."""
    u, w = state.work[8], state.work[9]
    for i in range(len(u)):
        u[i] = c * u1[i]
    add_scaled(w, state.w, c, a1)
    set_status(system, system.kernels.displacement_rate(system.table, u, w, u2), t)
    set_status(system, system.kernels.integrate(system.table, state.q, u, state.stage), t)
    acceleration(system, t, state.stage, w, a2)


@inline_unoptimized
def rk4(system: System, t: float, h: float, state: State) -> None:
    """The classical Runge-Kutta method in (u, v) with q(t) = q ∘ exp(u(t)) (after Munthe-Kaas, u̇ in closed form)."""
    k = state.work
    copy(k[0], state.w)
    acceleration(system, t, state.q, state.w, k[1])
    _stage(system, t + 0.5 * h, 0.5 * h, k[0], k[1], k[2], k[3], state)
    _stage(system, t + 0.5 * h, 0.5 * h, k[2], k[3], k[4], k[5], state)
    _stage(system, t + h, h, k[4], k[5], k[6], k[7], state)
    u = k[8]
    for i in range(len(u)):
        u[i] = h / 6.0 * (k[0, i] + 2.0 * (k[2, i] + k[4, i]) + k[6, i])
        state.w[i] += h / 6.0 * (k[1, i] + 2.0 * (k[3, i] + k[5, i]) + k[7, i])
    move(system, t, u, state)


@inline_unoptimized
def observe(system: System, t: float, state: State) -> None:
    """v is the state's own."""
    copy(state.v, state.w)
    if not (all_finite(state.q) and all_finite(state.w)):
        set_status(system, NONFINITE, t)
