"""Explicit methods in (q, v): Euler's, semi-implicit Euler, velocity Verlet, and the Runge-Kutta method of order 4.

q moves on the group of the joints, q ∘ exp(h v) in the body's frame, so quaternions stay of unit norm and no chart is
left. None of them is symplectic as soon as M depends on q: ``symplectic`` and ``variational`` have those that are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..algebra.euclidean import dot, plus, rotate
from ..algebra.lie import log_jacobian
from ..algebra.scalars import inlined, woven
from ..algebra.spatial import Motion
from ..bodies.table import FOLLOW, PRISMATIC, REVOLUTE, REVOLUTE_CS
from ..engines.compiled import numba_kernels
from ..engines.compiled.checks import all_finite
from ..engines.compiled.table_kernels import kernel
from ..recursions import SPECS
from ..recursions.configuration import put_twist, twist
from .system import NONFINITE, OK, TURNED, State, System, along, copy, note

HALF_TURN = 9.8696  # π² [rad²]


class Kernels(NamedTuple):
    """What the methods call: accelerate(system, q, v, a), and compiled kernels that return a status."""

    accelerate: Any
    aba: Any
    integrate: Any
    displacement_rate: Any


def kernels(loaded: bool) -> Kernels:
    """The kernels of these methods, compiled when first asked for; ``loaded`` says that there are external forces."""
    aba = numba_kernels.single(numba_kernels.variant(SPECS["aba"], frozenset({"fext"} if loaded else ())))
    integrate = numba_kernels.single(SPECS["integrate"])
    return Kernels(_loaded if loaded else _free, aba, integrate, kernel(displacement_rate, 1, 1, 1))


@woven
def _free(system: System, q: Any, v: Any, a: Any) -> int:
    return system.kernels.aba(system.table, q, v, system.tau, a)  # type: ignore[no-any-return]


@woven
def _loaded(system: System, q: Any, v: Any, a: Any) -> int:
    return system.kernels.aba(system.table, q, v, system.tau, system.fext, a)  # type: ignore[no-any-return]


@inlined
def displacement_rate(bodies: Any, u: Any, v: Any, out: Any) -> int:
    """``rate_of_displacement``; returns TURNED where a joint has turned by π or more, too near the 2π at which the
    exponential folds.
    """
    rate_of_displacement(bodies, u, v, out)
    status = OK
    for i in range(1, len(bodies)):
        b = bodies[i]
        if not (b.kind == REVOLUTE or b.kind == PRISMATIC or b.kind == REVOLUTE_CS or b.kind == FOLLOW):
            w = twist(b, i - 1, u).w
            if not dot(w, w) < HALF_TURN:
                status = TURNED
    return status


@inlined
def rate_of_displacement(bodies: Any, u: Any, v: Any, out: Any) -> None:
    """u̇ of q(t) = q0 ∘ exp(u(t)) where the joints move with v: the inverse right Jacobian of exp at u, times v."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        if b.kind == REVOLUTE or b.kind == PRISMATIC or b.kind == REVOLUTE_CS:
            out[i - 1] = v[i - 1]
        elif b.kind != FOLLOW:
            m, rate = twist(b, i - 1, u), twist(b, i - 1, v)
            T = log_jacobian(m, 1.0)
            put_twist(b, i - 1, Motion(rotate(T.J, rate.w), plus(rotate(T.J, rate.v), rotate(T.K, rate.w))), out)


@woven
def acceleration(system: System, t: float, q: Any, v: Any, a: Any) -> None:
    """a of the state (q, v) at time t."""
    system.torque(system, t, q, v)
    note(system, system.kernels.accelerate(system, q, v, a), t)


@woven
def move(system: System, t: float, u: Any, state: State) -> None:
    """q ← q ∘ exp(u)."""
    copy(state.stage, state.q)
    note(system, system.kernels.integrate(system.table, state.stage, u, state.q), t)


@woven
def explicit_euler(system: System, t: float, h: float, state: State) -> None:
    """q⁺ = q ∘ exp(h v), v⁺ = v + h a(q, v)."""
    a, u = state.work[0], state.work[1]
    acceleration(system, t, state.q, state.w, a)
    for i in range(len(u)):
        u[i] = h * state.w[i]
    move(system, t, u, state)
    along(state.w, state.w, h, a)


@woven
def semi_implicit_euler(system: System, t: float, h: float, state: State) -> None:
    """v⁺ = v + h a(q, v), q⁺ = q ∘ exp(h v⁺)."""
    a, u = state.work[0], state.work[1]
    acceleration(system, t, state.q, state.w, a)
    along(state.w, state.w, h, a)
    for i in range(len(u)):
        u[i] = h * state.w[i]
    move(system, t, u, state)


@woven
def velocity_verlet(system: System, t: float, h: float, state: State) -> None:
    """q⁺ = q ∘ exp(h v + ½ h² a), v⁺ = v + ½ h (a + a⁺) with a⁺ = a(q⁺, v + h a).

    The velocity in a⁺ has to be predicted, for the Coriolis forces depend on it; Störmer's method has no such forces.
    """
    a, b, u, w = state.work[0], state.work[1], state.work[2], state.work[3]
    acceleration(system, t, state.q, state.w, a)
    along(w, state.w, h, a)
    for i in range(len(u)):
        u[i] = h * (state.w[i] + 0.5 * h * a[i])
    move(system, t, u, state)
    acceleration(system, t + h, state.q, w, b)
    along(state.w, state.w, 0.5 * h, a)
    along(state.w, state.w, 0.5 * h, b)


@woven
def _stage(system: System, t: float, c: float, u1: Any, a1: Any, u2: Any, a2: Any, state: State) -> None:
    """Slopes u2, a2 at time t of the state that the slopes u1, a1 lead to in a time c."""
    u, w = state.work[8], state.work[9]
    for i in range(len(u)):
        u[i] = c * u1[i]
    along(w, state.w, c, a1)
    note(system, system.kernels.displacement_rate(system.table, u, w, u2), t)
    note(system, system.kernels.integrate(system.table, state.q, u, state.stage), t)
    acceleration(system, t, state.stage, w, a2)


@woven
def rk4(system: System, t: float, h: float, state: State) -> None:
    """The classical Runge-Kutta method on (u, v) with q(t) = q ∘ exp(u(t)) (after Munthe-Kaas, u̇ in closed form)."""
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


@woven
def observe(system: System, t: float, state: State) -> None:
    """The velocity of a state is its own."""
    copy(state.v, state.w)
    if not (all_finite(state.q) and all_finite(state.w)):
        note(system, NONFINITE, t)


@woven
def start(system: System, state: State) -> None:
    """Nothing is kept in other coordinates."""
