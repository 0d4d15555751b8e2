"""Quadratic programs, min ½ xᵀP x + gᵀx with low <= (x, rows x) <= high: calls of a solver, and checks of its answers.

DAQP, the default, is called directly, because its interface takes this form; other solvers are called through
qpsolvers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_word
from ..errors import ConstraintError, SpatialDynError, pip_install

Array = NDArray[np.float64]
VIOLATED = 1e-5  # relative to the robot's weight, a limit or a braking acceleration: error allowed in a solution
RELAXED = 1e-6  # likewise relative: with a smaller relaxation the program counts as feasible
STEEP = 1e6  # weight of the relaxation relative to the cost, which only makes the answer unique
NONE = 1e29  # a bound this large counts as none
DIRECT = "daqp"
EQUAL = 5  # DAQP's word for an equation


class Program(NamedTuple):
    """A program.

    Rows are scaled to relevant values of about 1, forces so that the robot's weight is 1.

    P, g       of the cost ½ xᵀP x + gᵀx
    rows       (m, n)
    low, high  (n + m,) bounds of x, then of the rows, 1e30 for none; equal where ``sense`` is EQUAL
    names      for each bound: its name and a unit
    size       for each bound: its scale, as a number of these units
    """

    P: Array
    g: Array
    rows: Array
    low: Array
    high: Array
    sense: NDArray[np.int32]
    names: tuple[tuple[str, str], ...]
    size: Array


class Relaxation(NamedTuple):
    """A relaxed limit: its name, by how much it is relaxed, and its unit."""

    name: str
    amount: float
    unit: str

    def __str__(self) -> str:
        return f"{self.name} by {self.amount:.4g} {self.unit}"


def check_solver(solver: Any) -> str:
    """The name of an installed solver. Raises SpatialDynError for any other, and without qpsolvers."""
    if isinstance(solver, str) and solver == DIRECT:
        try:
            import daqp  # noqa: F401
        except ImportError:
            pass
        else:
            return solver  # qpsolvers would import JAX, which takes a second
    try:
        import qpsolvers
    except ImportError:
        raise SpatialDynError(f"qpsolvers is not installed; {pip_install('wbc')}") from None
    return as_word("solver", solver, qpsolvers.available_solvers)


def raw(solver: str, p: Program) -> Array | None:
    """The solver's answer; None if it has none."""
    if solver == DIRECT:
        import daqp

        x, _, flag, _ = daqp.solve(p.P, p.g, p.rows, p.high, p.low, p.sense.copy())  # DAQP writes to sense
        return x if flag > 0 and np.isfinite(x).all() else None
    return by_qpsolvers(solver, p)


def by_qpsolvers(solver: str, p: Program) -> Array | None:
    """As ``raw``, through qpsolvers."""
    import qpsolvers

    n = len(p.g)
    low, high, equal = p.low[n:], p.high[n:], p.sense[n:] == EQUAL
    above, below = ~equal & (high < NONE), ~equal & (low > -NONE)
    G, h = np.concatenate([p.rows[above], -p.rows[below]]), np.concatenate([high[above], -low[below]])
    least = np.where(p.low[:n] > -NONE, p.low[:n], -np.inf)
    most = np.where(p.high[:n] < NONE, p.high[:n], np.inf)
    P, A, b = p.P, p.rows[equal], high[equal]
    if solver not in qpsolvers.dense_solvers:
        from scipy.sparse import csc_matrix

        P, G, A = (csc_matrix(x) for x in (P, G, A))
    try:
        found = qpsolvers.solve_qp(
            P, p.g, G if len(h) else None, h if len(h) else None, A if len(b) else None, b if len(b) else None, least,
            most, solver=solver,
        )  # fmt: skip
    except (ValueError, ArithmeticError, qpsolvers.exceptions.QPError):
        return None
    return None if found is None or not np.isfinite(found).all() else np.asarray(found)


def residual(p: Program, x: Array) -> float:
    """The largest violation of rows and bounds by x."""
    y = np.concatenate([x, p.rows @ x])
    return max(float((p.low - y).max(initial=0.0)), float((y - p.high).max(initial=0.0)))


def solve(solver: str, p: Program) -> tuple[Array | None, float]:
    """The answer, and its residual; None if the solver has none or its residual is too large."""
    x = raw(solver, p)
    if x is None:
        return None, np.inf
    off = residual(p, x)
    return (x if off <= VIOLATED else None), off


def relax(solver: str, p: Program) -> tuple[Program, list[Relaxation]]:
    """The program with the least sum of squared relaxations of inequalities and bounds, relative to their sizes, and
    these relaxations, the largest first; the list is empty if none was needed.

    Raises ConstraintError if there is still no answer, as equations are not relaxed.
    """
    n = len(p.g)
    equal = p.sense == EQUAL
    high, low = np.flatnonzero(~equal & (p.high < NONE)), np.flatnonzero(~equal & (p.low > -NONE))
    all_rows = np.concatenate([np.eye(n), p.rows])
    k, m = len(high) + len(low), int(equal.sum())
    G = np.concatenate([all_rows[high], -all_rows[low]])
    rows = np.block([[all_rows[equal], np.zeros((m, k))], [G, -np.eye(k)]])
    least, most = np.concatenate([p.low[equal], np.full(k, -1e30)]), np.concatenate([p.high[high], -p.low[low]])
    slack = Program(
        np.diag(np.r_[np.full(n, 1.0 / STEEP), np.ones(k)]), np.zeros(n + k), rows,
        np.r_[np.full(n, -1e30), np.zeros(k), least], np.r_[np.full(n + k, 1e30), p.high[equal], most],
        np.r_[np.zeros(n + k), np.full(m, EQUAL), np.zeros(k)].astype(np.int32), (), np.ones(0),
    )  # fmt: skip
    found, off = solve(solver, slack)
    if found is None:
        raise ConstraintError(
            f"the feet's equations contradict each other, or solver {solver} fails: residual {off:.2g} with all limits "
            "relaxed"
        )
    s = np.where(found[n:] > RELAXED, found[n:], 0.0)
    amounts: dict[tuple[str, str], float] = {}
    for at, x in zip([*high.tolist(), *low.tolist()], s.tolist(), strict=True):
        if x > 0.0:
            amounts[p.names[at]] = max(amounts.get(p.names[at], 0.0), x * float(p.size[at]))
    listed = [Relaxation(name, x, what) for (name, what), x in amounts.items()]
    s = s * (1.0 + 1e-3)
    below, above = p.low.copy(), p.high.copy()
    above[high] += s[: len(high)]
    below[low] -= s[len(high) :]
    return p._replace(low=below, high=above), sorted(listed, key=lambda r: -r.amount)
