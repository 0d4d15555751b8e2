"""Physically consistent inertias by a semidefinite program: an external solver minimizes the cost of ``log_cholesky``.

The pseudo-inertia is linear in the parameters and must be positive semidefinite. Source: Wensing, Kim, Slotine, Linear
matrix inequalities for physically consistent inertial parameter identification (2018).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError, SpatialDynError, pip_install
from .log_cholesky import Consistent
from .pseudo_inertia import pseudo_inertia

Array = NDArray[np.float64]
AT_BOUND = 1e-7  # relative to the largest linear parameter
OPTIMAL, NEARLY = "optimal", "optimal_inaccurate"  # accepted statuses of cvxpy, the second with a note
INSTEAD = 'method="log_cholesky" minimises the same cost without this solver'


def fit(A: Array, z: Array, start: Array, bodies: int, bounded: NDArray[np.bool_], weight: float) -> Consistent:
    """``log_cholesky.fit`` by cvxpy and Clarabel.

    Raises  SpatialDynError if they are missing, IdentificationError if they find no optimum
    """
    cvxpy = need_cvxpy()
    ten, basis = 10 * bodies, pseudo_inertia(np.eye(10))
    size = np.maximum(abs(start), 1e-3)  # scale of each column: similar magnitudes converge
    free = start + size * np.linalg.lstsq(A * size, z - A @ start, rcond=1e-13)[0]  # whose own cost would hide the rest
    pi = cvxpy.Variable(len(start))
    cost: Any = 0.5 * cvxpy.sum_squares((A * size) @ (pi - free / size))
    limits = [pi[ten + k] >= 0.0 for k in np.flatnonzero(bounded)]
    for k in range(bodies):
        at = slice(10 * k, 10 * k + 10)
        F = np.linalg.cholesky(pseudo_inertia(start[at]))
        inner = np.linalg.inv(F)
        parts = inner @ basis @ inner.T * size[at, None, None]  # of P in units of P₀: well scaled
        P = cvxpy.reshape(parts.reshape(10, 16).T @ pi[at], (4, 4), order="C")
        P = 0.5 * (P + P.T)
        cost += 0.5 * weight * (cvxpy.trace(P) - cvxpy.log_det(P))
    problem = cvxpy.Problem(cvxpy.Minimize(cost), limits)
    try:
        problem.solve(solver="CLARABEL")
    except cvxpy.error.SolverError as error:
        reason = str(error).partition(". ")[0].rstrip(".")  # the rest is advice on cvxpy's options
        raise IdentificationError(f"the semidefinite program is not solved: {reason}; {INSTEAD}") from error
    if pi.value is None or problem.status not in (OPTIMAL, NEARLY):
        raise IdentificationError(
            f'the semidefinite program ended with "{problem.status}", expected "{OPTIMAL}": {INSTEAD}'
        )
    notes = (f'the semidefinite program ended with "{NEARLY}": {INSTEAD}',) if problem.status == NEARLY else ()
    found = np.asarray(pi.value) * size
    found[ten:] = np.where(bounded, np.maximum(found[ten:], 0.0), found[ten:])
    held = bounded & (found[ten:] <= AT_BOUND * max(1.0, abs(found[ten:]).max(initial=0.0)))
    steps = int(problem.solver_stats.num_iters or 0)
    return Consistent(found, float(problem.value), steps, held, notes)


def need_cvxpy() -> Any:
    """The package cvxpy. Raises SpatialDynError if it or its solver is not installed."""
    try:
        import clarabel  # noqa: F401
        import cvxpy
    except ImportError as error:
        raise SpatialDynError(f"cvxpy is not installed; {pip_install('identification')}") from error
    return cvxpy
