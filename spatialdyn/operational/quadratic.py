"""Quadratic programs, min ½ xᵀP x + gᵀx with A x = b, G x <= h, least <= x <= most: qpsolvers solves, we verify."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import ConstraintError, SpatialDynError, pip_install

Array = NDArray[np.float64]
VIOLATED = 1e-5  # of the robot's weight, a limit or an acceleration to brake with: what a solution may miss
RELAXED = 1e-6  # of the same: a relaxation below it is none, and the program feasible
STEEP = 1e6  # weight of relaxation over a program that only has to have one answer


class Program(NamedTuple):
    """A program.

    Rows are scaled so that what matters of them is about 1, forces so that the robot's weight is.

    groups, size   of each row of G: its name with a unit, and the number of those units that is 1
    bounds, scale  of each variable: the same of its bounds
    """

    P: Array
    g: Array
    A: Array
    b: Array
    G: Array
    h: Array
    least: Array
    most: Array
    groups: tuple[tuple[str, str], ...]
    size: Array
    bounds: tuple[tuple[str, str], ...]
    scale: Array


class Relaxation(NamedTuple):
    """What has to give way: the name of a limit, by how much, and its unit."""

    name: str
    amount: float
    unit: str

    def __str__(self) -> str:
        return f"{self.name} by {self.amount:.4g} {self.unit}"


def available() -> list[str]:
    """Solvers that are there. Raises SpatialDynError without qpsolvers."""
    try:
        import qpsolvers
    except ImportError:
        raise SpatialDynError(f"qpsolvers is not installed; {pip_install('wbc')}") from None
    return list(qpsolvers.available_solvers)


def raw(solver: str, p: Program) -> Array | None:
    """The solver's answer; None if it has none."""
    import qpsolvers

    empty = not len(p.b)
    try:
        found = qpsolvers.solve_qp(
            p.P, p.g, p.G if len(p.h) else None, p.h if len(p.h) else None, None if empty else p.A,
            None if empty else p.b, p.least, p.most, solver=solver,
        )  # fmt: skip
    except (ValueError, ArithmeticError, qpsolvers.exceptions.QPError):
        return None
    return None if found is None or not np.isfinite(found).all() else np.asarray(found)


def residual(p: Program, x: Array) -> float:
    """By how much x misses the rows and bounds."""
    worst = float(abs(p.A @ x - p.b).max(initial=0.0))
    if len(p.h):
        worst = max(worst, float((p.G @ x - p.h).max()))
    return max(worst, float(np.maximum(p.least - x, x - p.most).max(initial=0.0)))


def solve(solver: str, p: Program) -> tuple[Array | None, float]:
    """The answer, and its residual; None if there is none that the residual bears out."""
    x = raw(solver, p)
    if x is None:
        return None, np.inf
    off = residual(p, x)
    return (x if off <= VIOLATED else None), off


def relax(solver: str, p: Program) -> tuple[Program, list[Relaxation]]:
    """The program with the smallest relaxation of inequalities and bounds, in squares relative to their sizes, and what
    that is, the largest first: an empty list if none was needed.

    Raises ConstraintError if not even then there is an answer: equations hold.
    """
    n, m = len(p.g), len(p.h)
    high, low = np.flatnonzero(np.isfinite(p.most)), np.flatnonzero(np.isfinite(p.least))
    unit = np.eye(n)
    G = np.concatenate([p.G, unit[high], -unit[low]])
    h = np.concatenate([p.h, p.most[high], -p.least[low]])
    size = np.concatenate([p.size, p.scale[high], p.scale[low]])
    groups = [*p.groups, *(p.bounds[k] for k in high), *(p.bounds[k] for k in low)]
    k, free = len(h), np.full(n, np.inf)
    slack = Program(
        np.diag(np.r_[np.full(n, 1.0 / STEEP), np.ones(k)]), np.zeros(n + k), np.hstack([p.A, np.zeros((len(p.b), k))]),
        p.b, np.hstack([G, -np.eye(k)]), h, np.r_[-free, np.zeros(k)], np.r_[free, np.full(k, np.inf)], (), size,
        (), np.ones(n + k),
    )  # fmt: skip
    found, off = solve(solver, slack)
    if found is None:
        raise ConstraintError(
            f"the feet's equations contradict each other, or solver {solver} fails: residual {off:.2g} with all limits "
            "relaxed"
        )
    s = np.where(found[n:] > RELAXED, found[n:], 0.0)
    amounts: dict[tuple[str, str], float] = {}
    for label, x in zip(groups, s * size, strict=True):
        if x > 0.0:
            amounts[label] = max(amounts.get(label, 0.0), float(x))
    listed = [Relaxation(name, x, what) for (name, what), x in amounts.items()]
    s = s * (1.0 + 1e-3)
    most, least = p.most.copy(), p.least.copy()
    most[high] += s[m : m + len(high)]
    least[low] -= s[m + len(high) :]
    return p._replace(h=p.h + s[:m], least=least, most=most), sorted(listed, key=lambda r: -r.amount)
