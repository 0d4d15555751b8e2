"""Symplectic methods in canonical coordinates z = (x, π): symplectic Euler, Störmer-Verlet, Gauss collocation.

H(q, p) = ½ pᵀ M(q)⁻¹ p + V(q) is not separable, so all of them are implicit. A method is symplectic only as far as its
equations are solved: they are iterated until the iterates change by rounding only, not to a tolerance. Gauss's methods
sum z with compensation; their energy error grows like √t.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), II.1 and VI.3; for rounding, Hairer, McLachlan,
Razakarivony, Achieving Brouwer's law with implicit Runge-Kutta methods (2008); for slow iterations, Walker, Ni,
Anderson acceleration for fixed-point iterations (2011).

Rows of ``work``: 0 z, 1 remainder of the compensated sum, 2 a stage, 3 its slope, 4 and 5 momenta and rates of the
joints, 6 scratch, 7 to 9 increments of the stages, 10 to 12 those of the previous step; in methods without stages, 8 to
12 the memory of ``anderson_step``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...algebra.scalars import EPS, inline_unoptimized, no_inline
from ...engines.compiled import numba_kernels
from ...engines.compiled.table_kernels import kernel
from ...recursions import SPECS
from ...recursions.momenta.canonical_coordinates import chart_rate, from_canonical, recenter, to_canonical
from ..system import NONFINITE, STALLED, TORQUE, State, System, copy, set_status

ROWS = 13
SWEEPS = 100  # at most; reasonable steps take 5 to 20
LARGEST = 1e300
SLOW = 0.25  # a sweep that shrinks the change by less turns acceleration on
NEW = 0.01  # least part of the square of a difference that is outside the span of earlier ones
SETTLED = 1e-10  # relative: a change this small that no longer shrinks is rounding
ACCELERATED_SETTLED = 1e-13  # the same, of an accelerated iteration
ROUNDING = 16.0 * EPS  # of what rounds where a robot comes to rest: see ``terms``


class SymplecticKernels(NamedTuple):
    """field(system, q, p, rates), which writes v and ṗ without torques, and compiled kernels."""

    field: Any
    hamilton: Any
    to_canonical: Any
    from_canonical: Any
    chart_rate: Any
    recenter: Any


class Tableau(NamedTuple):
    """A Gauss method: nodes c, weights b, mu_ij = a_ij / b_j; ``ahead`` extrapolates increments to the next step.

    mu_ij + mu_ji = 1 to the last bit, which makes the method symplectic in floating point too.
    """

    c: tuple[float, ...]
    b: tuple[float, ...]
    mu: tuple[tuple[float, ...], ...]
    ahead: tuple[tuple[float, ...], ...]


def _tableau(c: tuple[float, ...], b: tuple[float, ...], mu: tuple[tuple[float, ...], ...]) -> Tableau:
    """``ahead`` extends the polynomial through a step's slopes, of increments h b_j k_j, to the next step's nodes."""
    s = range(len(c))

    def basis(j: int, t: float) -> float:
        return math.prod((t - c[m]) / (c[j] - c[m]) for m in s if m != j)

    return Tableau(c, b, mu, tuple(tuple(b[i] / b[j] * basis(j, 1.0 + c[i]) for j in s) for i in s))


_R3, _R15 = math.sqrt(3.0), math.sqrt(15.0)
_A, _B, _C = 0.5 + _R3 / 3.0, 0.5 + 3.0 * _R15 / 20.0, 0.5 + 3.0 * _R15 / 25.0
GAUSS2 = _tableau((0.5,), (1.0,), ((0.5,),))
GAUSS4 = _tableau((0.5 - _R3 / 6.0, 0.5 + _R3 / 6.0), (0.5, 0.5), ((0.5, 1.0 - _A), (_A, 0.5)))
GAUSS6 = _tableau(
    (0.5 - _R15 / 10.0, 0.5, 0.5 + _R15 / 10.0),
    (5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0),
    ((0.5, 1.0 - _B, 1.0 - _C), (_B, 0.5, 1.0 - _B), (_C, _B, 0.5)),
)


def kernels(loaded: bool) -> SymplecticKernels:
    """The kernels of these methods, compiled at first use; ``loaded``: with external forces."""
    hamilton = numba_kernels.sample_kernel(
        numba_kernels.variant(SPECS["hamilton_field"], frozenset({"fext"} if loaded else ()))
    )
    return SymplecticKernels(
        _loaded if loaded else _free,
        hamilton,
        kernel(to_canonical, 2, 1, 1, 1),
        kernel(from_canonical, 2, 1, 1, 1),
        kernel(chart_rate, 2, 1, 1, 1, 1, 1),
        kernel(recenter, 2, 1, 1),
    )


@inline_unoptimized
def _free(system: System, q: Any, p: Any, rates: Any) -> int:
    return system.kernels.hamilton(system.table, q, p, system.zero, rates)  # type: ignore[no-any-return]


@inline_unoptimized
def _loaded(system: System, q: Any, p: Any, rates: Any) -> int:
    return system.kernels.hamilton(system.table, q, p, system.zero, system.fext, rates)  # type: ignore[no-any-return]


# --- the vector field -----------------------------------------------------------------------------------


@inline_unoptimized
def joint_rates(system: System, t: float, q: Any, p: Any, rates: Any) -> None:
    """v and ṗ as rows of ``rates``; the torque, a function of v, comes last."""
    set_status(system, system.kernels.field(system, q, p, rates), t)
    system.torque(system, t, q, rates[0])
    for i in range(len(system.tau)):
        rates[1, i] += system.tau[i]


@inline_unoptimized
def slope(system: System, t: float, z: Any, state: State, dz: Any) -> None:
    """ż at (t, z)."""
    n = len(system.tau)
    p, rates = state.work[4][:n], state.work[5].reshape((2, n))
    set_status(system, system.kernels.from_canonical(system.table, state.by_row, z, state.stage, p), t)
    joint_rates(system, t, state.stage, p, rates)
    set_status(system, system.kernels.chart_rate(system.table, state.by_row, z, p, rates[0], rates[1], dz), t)


@inline_unoptimized
def start(system: System, state: State) -> None:
    """z of the state (q, p)."""
    system.kernels.to_canonical(system.table, state.by_row, state.q, state.w, state.work[0])


@inline_unoptimized
def observe(system: System, t: float, state: State) -> None:
    """q, p and v of z."""
    n = len(system.tau)
    rates = state.work[5].reshape((2, n))
    set_status(system, system.kernels.from_canonical(system.table, state.by_row, state.work[0], state.q, state.w), t)
    set_status(system, system.kernels.field(system, state.q, state.w, rates), t)
    copy(state.v, rates[0])


@inline_unoptimized
def _change_charts(system: System, state: State) -> None:
    """Change to nearer chart centres where due, and clear ``work``: its rows but z refer to the old charts."""
    if system.kernels.recenter(system.table, state.by_row, state.work[0], state.work[6]) != 0:
        for row in range(1, len(state.work)):
            for i in range(state.work.shape[1]):
                state.work[row, i] = 0.0


# --- equations ------------------------------------------------------------------------------------------


@inline_unoptimized
def converged(
    system: System, t: float, change: float, before: float, sweep: int, still: bool, quick: bool = False
) -> bool:
    """Whether to stop iterating: the relative change is rounding and shrinks no longer, or the status is a failure.

    still  whether the change is rounding of what a state is made of, though not of a state that vanishes
    quick  whether the iteration is accelerated: its change may then grow long before it is rounding
    """
    if not change <= LARGEST:
        set_status(system, NONFINITE, t)
    if sweep > 0 and system.status[0] != 0 and system.status[0] != TORQUE:
        system.status[0], system.status[1], system.status[2] = STALLED, t, before  # the iterates diverge
    if sweep == SWEEPS - 1 and not (change <= SETTLED or still):
        set_status(system, STALLED, t, change)
    rounding = change <= (ACCELERATED_SETTLED if quick else SETTLED) or still
    return system.status[0] != 0 or change <= 2.0 * EPS or (rounding and change >= before)


@inline_unoptimized
def terms(system: System, c: float, first: int) -> float:
    """Size of what rounds in the half of z that starts at ``first``: of positions 1, the robot's length or a radian,
    and of momenta the change by the torque over a time c, which forces of the robot may balance.
    """
    n, size = len(system.tau), 0.0
    if first == 0:
        return 1.0
    for i in range(n):
        size = max(size, system.unit[n + i] * abs(c * system.tau[i]))
    return size


@inline_unoptimized
def relative(change: float, size: float) -> float:
    """change / size; 0 if nothing changes, infinite for NaN."""
    if not change <= LARGEST:
        return math.inf
    return change / size if change > 0.0 else 0.0


@no_inline
def anderson_step(count: int, f: Any, y: Any, F: Any, U: Any) -> None:
    """One step of Anderson acceleration of y = G(x), f = G(x) - x: y moves to where f is least by the last sweeps.

    The terms of size h |v| that couple the rotation of a fast body with its translation make a plain iteration circle
    or diverge.

    count  sweeps in the memory
    y      written: next x
    F, U   (1 + memory, n)  written: orthonormal differences of f and the matching ones of y; f and y in the last row
    """
    n, last = len(f), len(F) - 1
    if count > 0:
        slot = (count - 1) % last
        for fresh in range(2):
            whole = square = 0.0
            for i in range(n):
                F[slot, i], U[slot, i] = f[i] - F[last, i], y[i] - U[last, i]
                whole += F[slot, i] * F[slot, i]
            for j in range(min(count, last)):
                if j != slot:
                    part = 0.0
                    for i in range(n):
                        part += F[j, i] * F[slot, i]
                    for i in range(n):
                        F[slot, i] -= part * F[j, i]
                        U[slot, i] -= part * U[j, i]
            for i in range(n):
                square += F[slot, i] * F[slot, i]
            if fresh == 0 and square >= NEW * whole:
                break
            for j in range(last):  # nearly dependent: drop older differences, as the remainder is rounding
                if j != slot:
                    for i in range(n):
                        F[j, i] = U[j, i] = 0.0
        scale = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
        for i in range(n):
            F[slot, i] *= scale
            U[slot, i] *= scale
    for i in range(n):
        F[last, i], U[last, i] = f[i], y[i]
    for j in range(min(count, last)):
        part = 0.0
        for i in range(n):
            part += F[j, i] * f[i]
        for i in range(n):
            y[i] -= part * U[j, i]


@inline_unoptimized
def _solve_half(system: System, t: float, c: float, first: int, base: Any, state: State, y: Any, dy: Any) -> None:
    """Solve y = base + c ẏ(t, y) for the half of y that starts at ``first``; the other half of y stays.

    dy  a guess of the slope; written: the slope at the solution
    """
    n = len(system.tau)
    off, F, U = state.work[6][:n], state.work[8:13, :n], state.work[8:13, n:]
    for i in range(first, first + n):
        y[i] = base[i] + c * dy[i]
    before, known, largest = math.inf, 0, 0.0
    for i in range(first, first + n):
        largest = max(largest, system.unit[i] * (abs(base[i]) + abs(c * dy[i])))
    scale = 1.0 if not 0.0 < largest <= LARGEST else math.ldexp(1.0, -math.frexp(largest)[1])  # keeps squares in range
    for sweep in range(SWEEPS):
        slope(system, t, y, state, dy)
        change = size = 0.0
        for i in range(first, first + n):
            new = base[i] + c * dy[i]
            off[i - first] = system.unit[i] * (new - y[i]) * scale
            change = max(change, abs(off[i - first]))
            size = max(size, system.unit[i] * (abs(base[i]) + abs(c * dy[i])) * scale)
            if not abs(new) <= LARGEST:
                change = math.inf
            y[i] = new
        still = change <= ROUNDING * terms(system, c, first) * scale
        change = relative(change, size)
        if converged(system, t, change, before, sweep, still, known > 0):
            break
        if known > 0 or change > SLOW * before:
            anderson_step(known, off, y[first : first + n], F, U)
            known += 1
        before = change


@inline_unoptimized
def symplectic_euler(system: System, t: float, h: float, state: State) -> None:
    """π⁺ = π + h π̇(x, π⁺), x⁺ = x + h ẋ(x, π⁺): implicit in π alone."""
    _change_charts(system, state)
    n = len(system.tau)
    z, y, dy = state.work[0], state.work[2], state.work[3]
    copy(y, z)
    _solve_half(system, t, h, n, z, state, y, dy)
    for i in range(n):
        z[i] += h * dy[i]
        z[n + i] = y[n + i]


@inline_unoptimized
def stormer_verlet(system: System, t: float, h: float, state: State) -> None:
    """Half a step of symplectic Euler, then half a step of its adjoint (HLW VI.3.1).

    π½ = π + ½ h π̇(x, π½);  x⁺ = x + ½ h (ẋ(x, π½) + ẋ(x⁺, π½));  π⁺ = π½ + ½ h π̇(x⁺, π½)
    """
    _change_charts(system, state)
    n = len(system.tau)
    z, y, dy, base = state.work[0], state.work[2], state.work[3], state.work[7]
    copy(y, z)
    _solve_half(system, t, 0.5 * h, n, z, state, y, dy)
    for i in range(n):
        base[i] = z[i] + 0.5 * h * dy[i]
    _solve_half(system, t + h, 0.5 * h, 0, base, state, y, dy)
    for i in range(n):
        z[i] = y[i]
        z[n + i] = y[n + i] + 0.5 * h * dy[n + i]


@inline_unoptimized
def _gauss(system: System, t: float, h: float, state: State, method: Tableau) -> None:
    """L_i = h b_i ż(z + Σ mu_ij L_j), z⁺ = z + Σ L_i, iterated stage by stage until converged."""
    _change_charts(system, state)
    stages, n = len(method.b), len(system.tau)
    z, rest, y, dy, L = state.work[0], state.work[1], state.work[2], state.work[3], state.work[7:10]
    old = state.work[10:13]
    for a in range(stages):
        copy(old[a], L[a])
    for a in range(stages):
        for i in range(2 * n):
            L[a, i] = 0.0
            for b in range(stages):
                L[a, i] += method.ahead[a][b] * old[b, i]
    before = math.inf
    for sweep in range(SWEEPS):
        change, still = 0.0, True
        for a in range(stages):
            for i in range(2 * n):
                y[i] = z[i]
                for b in range(stages):
                    y[i] += method.mu[a][b] * L[b, i]
            slope(system, t + method.c[a] * h, y, state, dy)
            for half in range(2):
                moved = size = 0.0
                for i in range(half * n, half * n + n):
                    new = h * method.b[a] * dy[i]
                    moved = max(moved, system.unit[i] * abs(new - L[a, i]))
                    size = max(size, system.unit[i] * (abs(z[i]) + abs(new)))
                    if not abs(new) <= LARGEST:
                        moved = math.inf
                    L[a, i] = new
                still = still and moved <= ROUNDING * terms(system, h * method.b[a], half * n)
                change = max(change, relative(moved, size))
        if converged(system, t, change, before, sweep, still):
            break
        before = change
    for i in range(2 * n):
        step = rest[i]
        for a in range(stages):
            step += L[a, i]
        new = z[i] + step
        back = new - z[i]
        rest[i] = (z[i] - (new - back)) + (step - back)
        z[i] = new


@inline_unoptimized
def implicit_midpoint(system: System, t: float, h: float, state: State) -> None:
    """z⁺ = z + h ż((z + z⁺)/2): Gauss's method of one stage."""
    _gauss(system, t, h, state, GAUSS2)


@inline_unoptimized
def gauss4(system: System, t: float, h: float, state: State) -> None:
    """Gauss's method of two stages."""
    _gauss(system, t, h, state, GAUSS4)


@inline_unoptimized
def gauss6(system: System, t: float, h: float, state: State) -> None:
    """Gauss's method of three stages."""
    _gauss(system, t, h, state, GAUSS6)
