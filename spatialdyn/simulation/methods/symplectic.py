"""Symplectic methods in canonical coordinates z = (x, π): symplectic Euler, Störmer-Verlet, Gauss collocation.

H(q, p) = ½ pᵀ M(q)⁻¹ p + V(q) is not separable, so all of them are implicit. A method is symplectic only as far as its
equations are solved: they are iterated until the iterates change by rounding only, not to a tolerance. Gauss's methods
sum z with compensation; their energy error grows like √t.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), II.1 and VI.3; for rounding, Hairer, McLachlan,
Razakarivony, Achieving Brouwer's law with implicit Runge-Kutta methods (2008); for slow iterations, Walker, Ni,
Anderson acceleration for fixed-point iterations (2011).

No step branches on a value: sweeps are a region of ``algebra.regions``, so that one source is compiled, and recorded
into a program in which samples run side by side, each until its own equations are solved.

Rows of ``work``: 0 z, 1 remainder of the compensated sum, 2 a stage, 3 its slope, 4 and 5 momenta and rates of the
joints, 6 scratch, 7 to 9 increments of the stages, 10 to 12 those of the previous step; in methods without stages, 8 to
12 the memory of ``anderson_step``; from 13 on the numbers of ``Sweeps``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...algebra.regions import repeat, settled, when
from ...algebra.scalars import EPS, inline_unoptimized, no_inline, select, sqrt
from ...engines.compiled import numba_kernels
from ...engines.compiled.table_kernels import kernel
from ...recursions import SPECS
from ...recursions.momenta.canonical_coordinates import chart_rate, from_canonical, recenter, to_canonical
from ..system import NONFINITE, STALLED, TORQUE, State, System, copy, set_status

ROWS = 18
NUMBERS = 13  # first of the rows with a number each
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
    end: Any


class Sweeps(NamedTuple):
    """The numbers (1,) of an iteration.

    left    above 0 while it goes on
    change  relative, of the last sweep
    before  the same, of the sweep before
    known   sweeps in the memory of ``anderson_step``
    still   1 if the last change is rounding of what a state is made of, though not of a state that vanishes; else 0
    """

    left: Any
    change: Any
    before: Any
    known: Any
    still: Any


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
    """Change to nearer chart centres where due, and clear ``work``: its rows but z refer to the old charts."""
    moved = system.kernels.recenter(system.table, state.by_row, state.work[0], state.work[6])
    for row in range(1, NUMBERS):
        for i in range(state.work.shape[1]):
            state.work[row, i] = select(moved, 0.0, state.work[row, i])


# --- equations ------------------------------------------------------------------------------------------


@inline_unoptimized
def sweeps_of(rows: Any) -> Sweeps:
    """The numbers of an iteration that begins."""
    left, change, before, known, still = rows[0][:1], rows[1][:1], rows[2][:1], rows[3][:1], rows[4][:1]
    left[0], change[0], before[0], known[0], still[0] = 1.0, 0.0, math.inf, 0.0, 0.0
    return Sweeps(left, change, before, known, still)


@inline_unoptimized
def judge(system: System, s: Sweeps, change: Any, still: Any) -> Any:
    """Say whether the iteration goes on: until the relative change is rounding and shrinks no longer, or a failure.

    still  1 if the change is rounding, see ``Sweeps``, else 0

    Returns a number above 0 if it goes on and shrinks so slowly that it is to be accelerated. An accelerated one may
    grow long before its change is rounding.
    """
    rounding = select(change - select(s.known[0], ACCELERATED_SETTLED, SETTLED), still, 1.0)
    ends = select(change - 2.0 * EPS, select(rounding, select(s.before[0] - change, 0.0, 1.0), 0.0), 1.0)
    left = select(ends, 0.0, select(LARGEST - change, 1.0, 0.0))
    if system.status[0] != 0:
        left = 0.0
    slow = select(left, select(s.known[0], 1.0, select(change - SLOW * s.before[0], 1.0, 0.0)), 0.0)
    s.before[0] = select(left, change, s.before[0])
    s.left[0], s.change[0], s.still[0] = left, change, still
    return slow


@inline_unoptimized
def end(system: System, t: float, s: Sweeps, y: Any) -> None:
    """Set the status if an iteration has failed; y, what it solves for, is only for those that record."""
    if not s.change[0] <= LARGEST:
        set_status(system, NONFINITE, t)
    if s.before[0] <= LARGEST and system.status[0] != 0 and system.status[0] != TORQUE:
        system.status[0], system.status[1], system.status[2] = STALLED, t, s.before[0]  # the iterates diverge
    if s.left[0] > 0.0 and not (s.change[0] <= SETTLED or s.still[0] > 0.0):
        set_status(system, STALLED, t, s.change[0])


@inline_unoptimized
def magnitude(x: Any) -> Any:
    """|x|."""
    return select(-x, -x, x)


@inline_unoptimized
def larger(x: Any, y: Any) -> Any:
    """The larger of x and y; x if y is NaN."""
    return select(y - x, y, x)


@inline_unoptimized
def at_most(x: Any, change: Any) -> Any:
    """change, but infinite where x is beyond LARGEST, or NaN."""
    return select(LARGEST - magnitude(x), change, math.inf)


@inline_unoptimized
def terms(system: System, c: Any, first: int) -> Any:
    """Size of what rounds in the half of z that starts at ``first``: of positions 1, the robot's length or a radian,
    and of momenta the change by the torque over a time c, which forces of the robot may balance.
    """
    n, size = len(system.tau), 0.0
    if first == 0:
        return 1.0
    for i in range(n):
        size = larger(size, system.unit[n + i] * magnitude(c * system.tau[i]))
    return size


@inline_unoptimized
def relative(change: Any, size: Any) -> Any:
    """change / size; 0 if nothing changes, infinite for NaN."""
    return select(LARGEST - change, select(change, change / select(size, size, 1.0), 0.0), math.inf)


@no_inline
def anderson_step(known: Any, f: Any, y: Any, F: Any, U: Any) -> None:
    """One step of Anderson acceleration of y = G(x), f = G(x) - x: y moves to where f is least by the last sweeps.

    The terms of size h |v| that couple the rotation of a fast body with its translation make a plain iteration circle
    or diverge.

    known  (1,)  written: sweeps in the memory
    y      written: next x
    F, U   (1 + memory, n)  written: orthonormal differences of f and the matching ones of y, the newest first; f and y
           in the last row
    """
    n, last = len(f), len(F) - 1
    first, several = select(known[0], 0.0, 1.0), select(known[0], 1.0, 0.0)
    for j in range(last - 1, 0, -1):
        for i in range(n):
            F[j, i], U[j, i] = select(first, 0.0, F[j - 1, i]), select(first, 0.0, U[j - 1, i])
    whole = square = 0.0
    for i in range(n):
        F[0, i], U[0, i] = select(several, f[i] - F[last, i], 0.0), select(several, y[i] - U[last, i], 0.0)
        whole = whole + F[0, i] * F[0, i]
        F[last, i], U[last, i] = F[0, i], U[0, i]
    for j in range(1, last):
        part = 0.0
        for i in range(n):
            part = part + F[j, i] * F[0, i]
        for i in range(n):
            F[0, i] = F[0, i] - part * F[j, i]
            U[0, i] = U[0, i] - part * U[j, i]
    for i in range(n):
        square = square + F[0, i] * F[0, i]
    fresh = select(
        NEW * whole - square, 1.0, 0.0
    )  # nearly dependent: drop older differences, the remainder is rounding
    square = select(fresh, whole, square)
    size = select(square, 1.0 / sqrt(select(square, square, 1.0)), 0.0)
    for i in range(n):
        F[0, i] = size * select(fresh, F[last, i], F[0, i])
        U[0, i] = size * select(fresh, U[last, i], U[0, i])
        F[last, i], U[last, i] = f[i], y[i]
        for j in range(1, last):
            F[j, i], U[j, i] = select(fresh, 0.0, F[j, i]), select(fresh, 0.0, U[j, i])
    for j in range(last):
        part = 0.0
        for i in range(n):
            part = part + F[j, i] * f[i]
        for i in range(n):
            y[i] = y[i] - part * U[j, i]
    known[0] = known[0] + 1.0


@inline_unoptimized
def _solve_half(system: System, t: Any, c: Any, first: int, base: Any, state: State, y: Any, dy: Any) -> None:
    """Solve y = base + c ẏ(t, y) for the half of y that starts at ``first``; the other half of y stays.

    dy  a guess of the slope; written: the slope at the solution
    """
    n = len(system.tau)
    off, F, U = state.work[6][:n], state.work[8:13, :n], state.work[8:13, n:]
    half = y[first : first + n]
    for i in range(first, first + n):
        y[i] = base[i] + c * dy[i]
    largest = 0.0
    for i in range(first, first + n):
        largest = larger(largest, system.unit[i] * (magnitude(base[i]) + magnitude(c * dy[i])))
    inverse = 1.0 / select(largest, largest, 1.0)
    scale = select(largest - 1.0 / LARGEST, select(LARGEST - largest, inverse, 1.0), 1.0)  # keeps squares in range
    s = sweeps_of(state.work[NUMBERS:])
    for _ in repeat(SWEEPS, s.left, s.change, s.before, s.known, s.still, half, dy, F, U):
        if settled(s.left[0]):
            break
        slope(system, t, y, state, dy)
        change = size = 0.0
        for i in range(first, first + n):
            new = base[i] + c * dy[i]
            off[i - first] = system.unit[i] * (new - y[i]) * scale
            change = at_most(new, larger(change, magnitude(off[i - first])))
            size = larger(size, system.unit[i] * (magnitude(base[i]) + magnitude(c * dy[i])) * scale)
            y[i] = new
        still = select(change - ROUNDING * terms(system, c, first) * scale, 0.0, 1.0)
        slow = judge(system, s, relative(change, size), still)
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
    old = state.work[10:13]
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
        change, moves = 0.0, 0.0
        for a in range(stages):
            for i in range(2 * n):
                y[i] = z[i]
                for b in range(stages):
                    y[i] = y[i] + method.mu[a][b] * L[b, i]
            slope(system, t + method.c[a] * h, y, state, dy)
            for half in range(2):
                moved = size = 0.0
                for i in range(half * n, half * n + n):
                    new = h * method.b[a] * dy[i]
                    moved = at_most(new, larger(moved, system.unit[i] * magnitude(new - L[a, i])))
                    size = larger(size, system.unit[i] * (magnitude(z[i]) + magnitude(new)))
                    L[a, i] = new
                rounding = ROUNDING * terms(system, h * method.b[a], half * n)
                moves = select(moved - rounding, 1.0, moves)
                change = larger(change, relative(moved, size))
        judge(system, s, change, 1.0 - moves)
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
