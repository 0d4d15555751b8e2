"""Symplectic methods in canonical coordinates z = (x, π): symplectic Euler, Störmer-Verlet, Gauss collocation.

H(q, p) = ½ pᵀ M(q)⁻¹ p + V(q) is not separable, so all these methods are implicit. A method is symplectic only if its
equations are solved exactly: they are iterated until the iterates change by rounding only, not to a tolerance. Gauss's
methods sum z with compensation; their energy error grows like √t.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), II.1 and VI.3; for rounding, Hairer, McLachlan,
Razakarivony, Achieving Brouwer's law with implicit Runge-Kutta methods (2008).

Rows of ``work``: 0 z, 1 remainder of the compensated sum, 2 a stage, 3 its slope, 4 and 5 momenta and rates of the
joints, 6 scratch, 7 to 9 increments of the stages, 10 to 12 those of the previous step; in methods without stages, 8 to
12 the memory of ``anderson_step``; from 13 on the numbers of ``Sweeps``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...algebra.regions import repeat, settled, when
from ...algebra.scalars import EPS, inline_unoptimized, select
from ...engines.compiled import numba_kernels
from ...engines.compiled.table_kernels import kernel
from ...recursions import SPECS
from ...recursions.momenta.canonical_coordinates import chart_rate, from_canonical, recenter, to_canonical
from ..system import State, System, copy, set_status
from .iteration import LARGEST, SWEEPS, anderson_step, end, judge, largest, relative, sweeps_of

ROWS = 18
NUMBERS = 13  # first of the rows with a number each
ROUNDING = 16.0 * EPS  # relative to the terms that round when a robot comes to rest: see ``terms``


class SymplecticKernels(NamedTuple):
    """``field(system, q, p, rates)``, which writes v and ṗ without torques, and compiled kernels."""

    field: Any
    hamilton: Any
    to_canonical: Any
    from_canonical: Any
    chart_rate: Any
    recenter: Any
    end: Any


class Tableau(NamedTuple):
    """A Gauss method: nodes c, weights b, mu_ij = a_ij / b_j; ``ahead`` extrapolates increments to the next step.

    mu_ij + mu_ji = 1 to the last bit, which makes the method symplectic in floating point too.
    """

    c: tuple[float, ...]
    b: tuple[float, ...]
    mu: tuple[tuple[float, ...], ...]
    ahead: tuple[tuple[float, ...], ...]


def _tableau(c: tuple[float, ...], b: tuple[float, ...], mu: tuple[tuple[float, ...], ...]) -> Tableau:
    """The Tableau; ``ahead`` extends the polynomial through the slopes k_j of a step to the nodes of the next step."""
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
        end,
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
    """Change to nearer chart centres if due, and clear ``work``: all its rows except z refer to the old charts."""
    moved = system.kernels.recenter(system.table, state.by_row, state.work[0], state.work[6])
    rows = state.work[1:NUMBERS]
    for _ in when(moved, rows):
        for row in range(len(rows)):
            for i in range(rows.shape[1]):
                rows[row, i] = 0.0


# --- equations ------------------------------------------------------------------------------------------


@inline_unoptimized
def terms(system: System, c: Any, first: int, sizes: Any) -> Any:
    """Size of the terms that round in the half of z that starts at ``first``: for positions 1, the robot's length or a
    radian; for momenta their change by the torque over a time c, which forces of the robot may balance.

    sizes  (nv,)  scratch
    """
    if first == 0:
        return 1.0
    for i in range(len(sizes)):
        sizes[i] = system.unit[len(sizes) + i] * abs(c * system.tau[i])
    return largest(sizes)


@inline_unoptimized
def _solve_half(system: System, t: Any, c: Any, first: int, base: Any, state: State, y: Any, dy: Any) -> None:
    """Solve y = base + c ẏ(t, y) for the half of y that starts at ``first``; the other half of y stays.

    dy  a guess of the slope; written: the slope at the solution
    """
    n = len(system.tau)
    off, sizes, F, U = state.work[6][:n], state.work[6][n:], state.work[8:13, :n], state.work[8:13, n:]
    half, start, unit = y[first : first + n], base[first : first + n], system.unit[first : first + n]
    slopes = dy[first : first + n]
    for i in range(n):
        half[i] = start[i] + c * slopes[i]
        sizes[i] = unit[i] * (abs(start[i]) + abs(c * slopes[i]))
    most = largest(sizes)
    inverse = 1.0 / select(most, most, 1.0)
    scale = select(most - 1.0 / LARGEST, select(LARGEST - most, inverse, 1.0), 1.0)  # keeps squares in range
    F[:], U[:] = 0.0, 0.0
    s = sweeps_of(state.work[NUMBERS:])
    for _ in repeat(SWEEPS, s.left, s.change, s.before, s.known, s.still, half, dy, F, U):
        if settled(s.left[0]):
            break
        slope(system, t, y, state, dy)
        still = ROUNDING * terms(system, c, first, sizes) * scale
        moved = state.work[5][:n]
        for i in range(n):
            new = start[i] + c * slopes[i]
            off[i] = unit[i] * (new - half[i]) * scale
            moved[i] = abs(off[i])
            sizes[i] = unit[i] * (abs(start[i]) + abs(c * slopes[i])) * scale
            half[i] = new
        change = largest(moved)
        slow = judge(system, s, relative(change, largest(sizes)), select(change - still, 0.0, 1.0))
        for _ in when(slow, s.known, half, F, U):
            anderson_step(s.known, off, half, F, U)
    system.kernels.end(system, t, s, half)


@inline_unoptimized
def symplectic_euler(system: System, t: Any, h: Any, state: State) -> None:
    """π⁺ = π + h π̇(x, π⁺), x⁺ = x + h ẋ(x, π⁺): implicit in π alone."""
    _change_charts(system, state)
    n = len(system.tau)
    z, y, dy = state.work[0], state.work[2], state.work[3]
    copy(y, z)
    _solve_half(system, t, h, n, z, state, y, dy)
    for i in range(n):
        z[i] = z[i] + h * dy[i]
        z[n + i] = y[n + i]


@inline_unoptimized
def stormer_verlet(system: System, t: Any, h: Any, state: State) -> None:
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
def _gauss(system: System, t: Any, h: Any, state: State, method: Tableau) -> None:
    """L_i = h b_i ż(z + Σ mu_ij L_j), z⁺ = z + Σ L_i, iterated stage by stage until converged."""
    _change_charts(system, state)
    stages, n = len(method.b), len(system.tau)
    z, rest, y, dy, L = state.work[0], state.work[1], state.work[2], state.work[3], state.work[7 : 7 + stages]
    old, moved, sizes = state.work[10:13], state.work[6][:n], state.work[6][n:]
    for a in range(stages):
        copy(old[a], L[a])
    for a in range(stages):
        for i in range(2 * n):
            guess = 0.0
            for b in range(stages):
                guess = guess + method.ahead[a][b] * old[b, i]
            L[a, i] = guess
    s = sweeps_of(state.work[NUMBERS:])
    for _ in repeat(SWEEPS, s.left, s.change, s.before, s.still, L):
        if settled(s.left[0]):
            break
        change, still = 0.0, 1.0
        for a in range(stages):
            for i in range(2 * n):
                y[i] = z[i]
                for b in range(stages):
                    y[i] = y[i] + method.mu[a][b] * L[b, i]
            slope(system, t + method.c[a] * h, y, state, dy)
            for half in range(2):
                first = half * n
                rounding = ROUNDING * terms(system, h * method.b[a], first, sizes)
                for i in range(n):
                    new = h * method.b[a] * dy[first + i]
                    moved[i] = system.unit[first + i] * abs(new - L[a, first + i])
                    sizes[i] = system.unit[first + i] * (abs(z[first + i]) + abs(new))
                    L[a, first + i] = new
                most = largest(moved)
                still = select(most - rounding, 0.0, still)
                ratio = relative(most, largest(sizes))
                change = select(ratio - change, ratio, change)
        judge(system, s, change, still)
    system.kernels.end(system, t, s, z)
    for i in range(2 * n):
        step = rest[i]
        for a in range(stages):
            step = step + L[a, i]
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
