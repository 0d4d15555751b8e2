"""Symplectic methods in canonical coordinates z = (x, π): symplectic Euler, Störmer-Verlet, Gauss's collocation.

H(q, p) = ½ pᵀ M(q)⁻¹ p + V(q) is not separable, so all of them are implicit. A method is symplectic only as far as its
equations are solved: they are iterated until the iterates change no longer, which is a matter of rounding, not of a
tolerance. In Gauss's methods z is summed with compensation, which leaves energy errors that grow like √t.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), II.1 and VI.3; for rounding, Hairer, McLachlan,
Razakarivony, Achieving Brouwer's law with implicit Runge-Kutta methods (2008); for slow iterations, Walker, Ni,
Anderson acceleration for fixed-point iterations (2011).

Rows of ``work``: 0 z, 1 what compensation has left over, 2 a stage, 3 its slope, 4 and 5 momenta and rates of the
joints, 6 scratch, 7 to 9 increments of the stages, 10 to 12 those of the step before; without stages, 8 to 12 what
``quicken`` remembers.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..algebra.scalars import called, woven
from ..engines.compiled import numba_kernels
from ..engines.compiled.checks import EPS
from ..engines.compiled.table_kernels import kernel
from ..recursions import SPECS
from .canonical_coordinates import chart_rate, enter, leave, recentre
from .system import NONFINITE, STALLED, TORQUE, State, System, copy, note

ROWS = 13
SWEEPS = 100  # at most; at steps that make sense it takes 5 to 20
LARGEST = 1e300
SLOW = 0.25  # an iteration that shrinks by less in a sweep is quickened
NEW = 0.01  # of the square of a difference at least, beyond what the differences before it span
SETTLED = 1e-10  # relative: changes this small are rounding once they no longer shrink
QUICK_SETTLED = 1e-13  # those of a quickened iteration


class Kernels(NamedTuple):
    """What the methods call: field(system, q, p, rates) with v and ṗ without torques, and compiled kernels."""

    field: Any
    hamilton: Any
    enter: Any
    leave: Any
    chart_rate: Any
    recentre: Any


class Tableau(NamedTuple):
    """A method of Gauss: nodes c, weights b, mu_ij = a_ij / b_j, and how to extrapolate increments to the next step.

    mu_ij + mu_ji = 1 to the last digit, which is what makes it symplectic in floating point too.
    """

    c: tuple[float, ...]
    b: tuple[float, ...]
    mu: tuple[tuple[float, ...], ...]
    ahead: tuple[tuple[float, ...], ...]


def _tableau(c: tuple[float, ...], b: tuple[float, ...], mu: tuple[tuple[float, ...], ...]) -> Tableau:
    """With the increments h b_j k_j of a step, the polynomial through its slopes is taken to the next step's nodes."""
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


def kernels(loaded: bool) -> Kernels:
    """The kernels of these methods, compiled when first asked for; ``loaded`` says that there are external forces."""
    hamilton = numba_kernels.single(
        numba_kernels.variant(SPECS["hamilton_field"], frozenset({"fext"} if loaded else ()))
    )
    return Kernels(
        _loaded if loaded else _free,
        hamilton,
        kernel(enter, 2, 1, 1, 1),
        kernel(leave, 2, 1, 1, 1),
        kernel(chart_rate, 2, 1, 1, 1, 1, 1),
        kernel(recentre, 2, 1, 1),
    )


@woven
def _free(system: System, q: Any, p: Any, rates: Any) -> int:
    return system.kernels.hamilton(system.table, q, p, system.zero, rates)  # type: ignore[no-any-return]


@woven
def _loaded(system: System, q: Any, p: Any, rates: Any) -> int:
    return system.kernels.hamilton(system.table, q, p, system.zero, system.fext, rates)  # type: ignore[no-any-return]


# --- the vector field -----------------------------------------------------------------------------------


@woven
def joint_rates(system: System, t: float, q: Any, p: Any, rates: Any) -> None:
    """v and ṗ as rows of ``rates``; the torque may ask for v, so it comes last."""
    note(system, system.kernels.field(system, q, p, rates), t)
    system.torque(system, t, q, rates[0])
    for i in range(len(system.tau)):
        rates[1, i] += system.tau[i]


@woven
def slope(system: System, t: float, z: Any, state: State, dz: Any) -> None:
    """ż at (t, z)."""
    n = len(system.tau)
    p, rates = state.work[4][:n], state.work[5].reshape((2, n))
    note(system, system.kernels.leave(system.table, state.by_row, z, state.stage, p), t)
    joint_rates(system, t, state.stage, p, rates)
    note(system, system.kernels.chart_rate(system.table, state.by_row, z, p, rates[0], rates[1], dz), t)


@woven
def start(system: System, state: State) -> None:
    """z of the state (q, p)."""
    system.kernels.enter(system.table, state.by_row, state.q, state.w, state.work[0])


@woven
def observe(system: System, t: float, state: State) -> None:
    """q, p and v of z."""
    n = len(system.tau)
    rates = state.work[5].reshape((2, n))
    note(system, system.kernels.leave(system.table, state.by_row, state.work[0], state.q, state.w), t)
    note(system, system.kernels.field(system, state.q, state.w, rates), t)
    copy(state.v, rates[0])


@woven
def _change_charts(system: System, state: State) -> None:
    """New centres where they are due; what was kept from the last step is then of no use."""
    if system.kernels.recentre(system.table, state.by_row, state.work[0], state.work[6]) != 0:
        for row in range(1, len(state.work)):
            for i in range(state.work.shape[1]):
                state.work[row, i] = 0.0


# --- equations ------------------------------------------------------------------------------------------


@woven
def settled(system: System, t: float, change: float, before: float, sweep: int, quick: bool = False) -> bool:
    """Whether an iteration is over: its relative change is rounding and shrinks no more, or it leads nowhere.

    quick  whether it is quickened: its changes may then grow again long before they are rounding
    """
    if not change <= LARGEST:
        note(system, NONFINITE, t)
    if sweep > 0 and system.trouble[0] != 0 and system.trouble[0] != TORQUE:
        system.trouble[0], system.trouble[1], system.trouble[2] = STALLED, t, before  # it is the iterates that run away
    if sweep == SWEEPS - 1 and not change <= SETTLED:
        note(system, STALLED, t, change)
    rounding = change <= (QUICK_SETTLED if quick else SETTLED) and change >= before
    return system.trouble[0] != 0 or change <= 2.0 * EPS or rounding


@woven
def relative(change: float, size: float) -> float:
    """change / size, 0 where nothing changes, infinite for a NaN."""
    if not change <= LARGEST:
        return math.inf
    return change / size if change > 0.0 else 0.0


@called
def quicken(count: int, f: Any, y: Any, F: Any, U: Any) -> None:
    """Take y = x + f(x) of an iteration y = G(x) to where f would vanish, as far as its last sweeps tell (Anderson).

    A fast body couples its turning with its travel by terms of the size h |v|, which the iteration goes round in
    circles about, or outward.

    count  sweeps that are remembered
    y      written: next x
    F, U   (1 + memory, n)  written: differences of f, orthonormal, and those of y that belong to them; f and y last
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
            for j in range(last):  # nothing new: what is old is worth less, and what is left of this is rounding
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


@woven
def _half(system: System, t: float, c: float, first: int, base: Any, state: State, y: Any, dy: Any) -> None:
    """Solve y = base + c ẏ(t, y) for the half of y that starts at ``first``; the other half is as it is in y.

    dy is a guess of the slope, and then the slope at the solution.
    """
    n = len(system.tau)
    off, F, U = state.work[6][:n], state.work[8:13, :n], state.work[8:13, n:]
    for i in range(first, first + n):
        y[i] = base[i] + c * dy[i]
    before, known, largest = math.inf, 0, 0.0
    for i in range(first, first + n):
        largest = max(largest, system.unit[i] * (abs(base[i]) + abs(c * dy[i])))
    scale = 1.0 if not 0.0 < largest <= LARGEST else math.ldexp(1.0, -math.frexp(largest)[1])  # squares stay in range
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
        change = relative(change, size)
        if settled(system, t, change, before, sweep, known > 0):
            break
        if known > 0 or change > SLOW * before:
            quicken(known, off, y[first : first + n], F, U)
            known += 1
        before = change


@woven
def symplectic_euler(system: System, t: float, h: float, state: State) -> None:
    """π⁺ = π + h π̇(x, π⁺), x⁺ = x + h ẋ(x, π⁺): implicit in π alone."""
    _change_charts(system, state)
    n = len(system.tau)
    z, y, dy = state.work[0], state.work[2], state.work[3]
    copy(y, z)
    _half(system, t, h, n, z, state, y, dy)
    for i in range(n):
        z[i] += h * dy[i]
        z[n + i] = y[n + i]


@woven
def stormer_verlet(system: System, t: float, h: float, state: State) -> None:
    """Half a step of symplectic Euler, then half a step of its adjoint (HLW VI.3.1).

    π½ = π + ½ h π̇(x, π½);  x⁺ = x + ½ h (ẋ(x, π½) + ẋ(x⁺, π½));  π⁺ = π½ + ½ h π̇(x⁺, π½)
    """
    _change_charts(system, state)
    n = len(system.tau)
    z, y, dy, base = state.work[0], state.work[2], state.work[3], state.work[7]
    copy(y, z)
    _half(system, t, 0.5 * h, n, z, state, y, dy)
    for i in range(n):
        base[i] = z[i] + 0.5 * h * dy[i]
    _half(system, t + h, 0.5 * h, 0, base, state, y, dy)
    for i in range(n):
        z[i] = y[i]
        z[n + i] = y[n + i] + 0.5 * h * dy[n + i]


@woven
def _gauss(system: System, t: float, h: float, state: State, method: Tableau) -> None:
    """L_i = h b_i ż(z + Σ mu_ij L_j), z⁺ = z + Σ L_i, stage after stage until nothing changes."""
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
        change = 0.0
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
                change = max(change, relative(moved, size))
        if settled(system, t, change, before, sweep):
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


@woven
def implicit_midpoint(system: System, t: float, h: float, state: State) -> None:
    """z⁺ = z + h ż((z + z⁺)/2): Gauss's method of one stage."""
    _gauss(system, t, h, state, GAUSS2)


@woven
def gauss4(system: System, t: float, h: float, state: State) -> None:
    """Gauss's method of two stages."""
    _gauss(system, t, h, state, GAUSS4)


@woven
def gauss6(system: System, t: float, h: float, state: State) -> None:
    """Gauss's method of three stages."""
    _gauss(system, t, h, state, GAUSS6)
