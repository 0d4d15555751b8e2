"""A variational integrator in O(n), on the joints' group: discrete mechanics of the bodies' average velocities.

With the momenta μ⁻ and μ⁺ of ``discrete_momenta`` at the two ends of a step, and Jᵀ the inward sweep of the RNEA, a
step solves J(q)ᵀ μ⁻ = p + ½ h f(q) for the displacement ξ of the joints, q⁺ = q ∘ exp(ξ), and sets
p⁺ = J(q⁺)ᵀ μ⁺ + ½ h f(q⁺), with f the sum of joint, gravity and external torques. The map is symplectic, is symmetric
without torques, and preserves the momentum of a free robot for any motion of its joints. The iteration changes ξ by
-h M⁻¹ r, with r the residual, until ξ no longer changes; ``anderson_step`` accelerates slow iterations.

Armatures add armature ξ to both momenta, so that the step solves M a + C v + g = τ with armatures on the diagonal of M,
as all methods do. For joints of one freedom, and for balls with one armature for all axes, this is the discrete
mechanics of ½ armature v². For other joints with armatures these equations have no Lagrangian
(``lagrangian.hamiltonian``): the step is of order 2 and symmetric, but preserves neither Ω nor momenta of symmetries.

Source: Lee, Liu, Park, Srinivasa, A linear-time variational integrator for multibody systems (2016), for the use of M⁻¹
in O(n); the form in (q, p) and on joints of several freedoms is derived here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...algebra.regions import repeat, settled, when
from ...algebra.scalars import inline, inline_unoptimized, select
from ...engines.compiled import numba_kernels
from ...engines.compiled.table_kernels import kernel
from ...recursions import SPECS
from ...recursions.momenta.discrete_momenta import WORK_AFTER, WORK_BEFORE, momenta_after, sum_before
from ..system import OK, TURNED, State, System, copy, set_status
from .iteration import SWEEPS, anderson_step, end, judge, largest, relative, sweeps_of

NUMBERS = 17  # first of the rows with a number each, of ``Sweeps``
ROWS = 22
TURN = 0.5  # cosine of half the angle by which a body may turn in one step, 120°


class VariationalKernels(NamedTuple):
    """``load(system, q, g)``, which writes the torques g that balance gravity and ``fext``, and compiled kernels."""

    load: Any
    static_torque: Any
    velocity: Any
    integrate: Any
    before: Any
    after: Any
    end: Any


def kernels(loaded: bool) -> VariationalKernels:
    """The kernels of the method, compiled at first use; ``loaded``: with external forces."""
    return VariationalKernels(
        _loaded if loaded else _free,
        numba_kernels.sample_kernel(SPECS["static_torque" if loaded else "generalized_gravity"]),
        numba_kernels.sample_kernel(SPECS["velocity_from_momentum"]),
        numba_kernels.sample_kernel(SPECS["integrate"]),
        kernel(momenta_before, 1, 1, 2, 1, work=WORK_BEFORE),
        kernel(momenta_after, 1, 1, 2, 1, work=WORK_AFTER),
        end,
    )


@inline_unoptimized
def _free(system: System, q: Any, g: Any) -> int:
    return system.kernels.static_torque(system.table, q, g)  # type: ignore[no-any-return]


@inline_unoptimized
def _loaded(system: System, q: Any, g: Any) -> int:
    return system.kernels.static_torque(system.table, q, system.fext, g)  # type: ignore[no-any-return]


# --- the sweeps -----------------------------------------------------------------------------------------


@inline
def momenta_before(bodies: Any, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
    """``sum_before``; returns TURNED where a body turns by more than 120°, else OK."""
    return OK if sum_before(bodies, work, q, xi, moved, out) > TURN else TURNED


# --- the method -----------------------------------------------------------------------------------------


@inline_unoptimized
def observe(system: System, t: float, state: State) -> None:
    """v = M⁻¹ p."""
    set_status(system, system.kernels.velocity(system.table, state.q, state.w, state.v), t)


@inline_unoptimized
def variational(system: System, t: float, h: float, state: State) -> None:
    """One step; torques at both ends are evaluated at the average velocity ξ/h, which keeps the order at 2."""
    n, k = len(system.tau), system.kernels
    xi, old, older = state.work[0], state.work[1], state.work[2]
    mean, g, left, change = state.work[3], state.work[4], state.work[5], state.work[6]
    F, U = state.work[7:12], state.work[12:17]
    for i in range(n):
        mean[i] = abs(old[i])
    straight = select(largest(mean), 1.0, 0.0)  # 1 once two displacements are known: the guess extrapolates them
    for i in range(n):
        older[i], old[i], xi[i] = old[i], xi[i], xi[i] + straight * (xi[i] - old[i])
    set_status(system, k.load(system, state.q, g), t)
    F[:], U[:] = 0.0, 0.0
    s = sweeps_of(state.work[NUMBERS:])
    for _ in repeat(SWEEPS, s.left, s.change, s.before, s.known, s.still, xi, F, U):
        if settled(s.left[0]):
            break
        for i in range(n):
            mean[i] = xi[i] / h
        system.torque(system, t, state.q, mean)
        set_status(system, k.before(system.table, state.q, xi, state.by_row, left), t)
        for i in range(n):
            left[i] = left[i] / h - state.w[i] - 0.5 * h * (system.tau[i] - g[i])
        set_status(system, k.velocity(system.table, state.q, left, change), t)
        for i in range(n):
            change[i] = -h * change[i]
            xi[i] = xi[i] + change[i]
            change[i] = change[i] * system.unit[i]
            left[i] = abs(change[i])
            mean[i] = system.unit[i] * (abs(xi[i]) + abs(old[i]))
        slow = judge(system, s, relative(largest(left), largest(mean)), 0.0)
        for _ in when(slow, s.known, xi, F, U):
            anderson_step(s.known, change, xi, F, U)
    k.end(system, t, s, xi)
    copy(state.stage, state.q)
    set_status(system, k.integrate(system.table, state.stage, xi, state.q), t + h)
    set_status(system, k.before(system.table, state.stage, xi, state.by_row, left), t)
    set_status(system, k.after(system.table, state.q, xi, state.by_row, left), t + h)
    set_status(system, k.load(system, state.q, g), t + h)
    for i in range(n):
        mean[i] = xi[i] / h
    system.torque(system, t + h, state.q, mean)
    for i in range(n):
        state.w[i] = left[i] / h + 0.5 * h * (system.tau[i] - g[i])
