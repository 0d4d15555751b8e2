"""Derivatives of steps of symplectic methods under constraints, by the implicit function theorem.

``rattle`` and ``constrained_variational`` solve equations for their unknowns and for the multipliers of the kept
constraint equations. The derivatives solve the same equations, linearized at their solution. At its end each method
replaces its velocity by the nearest velocity with J v = 0:

    M v⁺ = p + Jᵀ μ,    J v⁺ = 0

The multipliers are those that satisfy the other equations. The derivative is that of the step, also at states that
violate the constraints; the step brings the positions of such states onto the constraints.

Source: see ``simulation.methods.constrained_symplectic``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.by_program import along
from ..calls.dynamics import calls
from ..constraints.dynamics import constraint_jacobian, rows_to_keep
from ..constraints.table import Constraints
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.constraints.constraint_rows import JACOBIAN
from ..simulation.effects.constraints import Constrained

Array = NDArray[Any]


class Rows(NamedTuple):
    """Constraint equations of n samples, each at one configuration.

    kept    (n, nc) whether an equation is kept
    J       (n, nc, nv) constraint Jacobian
    turned  (n, nc, nv, nv) ∂J/∂q
    """

    kept: NDArray[np.bool_]
    J: Array
    turned: Array


def rows_of(model: Model, constrained: Constrained, q: Array) -> Rows:
    """The constraint equations at q; a step from q keeps the independent ones."""
    held, (n, nv) = constrained.constraints, (len(q), model.nv)
    kept, _ = rows_to_keep(model, held, q)
    turned = jacobian_slopes(model, held, q)
    return Rows(np.atleast_2d(kept) > 0.0, constraint_jacobian(model, held, q).reshape((n, held.nc, nv)), turned)


def jacobian_slopes(model: Model, held: Constraints, q: Array) -> Array:
    """∂J/∂q (n, nc, nv, nv)."""
    unit = np.broadcast_to(np.eye(model.nv), (len(q), model.nv, model.nv))
    found = along(model, JACOBIAN, [q], [unit], (held.table,))
    made: Array = found.reshape((len(q), held.nc, model.nv, model.nv))
    return made


def variational(
    before: Array, by_state: Array, by_xi: Array, steps: tuple[Array, Array], of_q: Array, here: Rows, there: Rows
) -> Array:  # fmt: skip
    """δξ (n, nv, m) of p⁻(q, ξ) - Jᵀ Λ = p, φ(q ∘ exp(ξ)) = 0.

    before    (n, nv) Jᵀ Λ
    by_state  (n, nv, m) derivatives of p⁻ - p by the state
    by_xi     (n, nv, nv) derivatives of p⁻ by ξ
    steps     derivatives of q⁺ by q and by ξ, each (n, nv, nv)
    of_q      (n, nv, m) derivatives of q by the state
    """
    made, nv = np.empty_like(by_state), len(by_xi[0])
    for k, kept in enumerate(here.kept):
        J, ahead = here.J[k][kept], there.J[k][kept]
        turned = np.einsum("ijk,i->jk", here.turned[k][kept], _multipliers(J, before[k]))
        K = np.block([[by_xi[k], -J.T], [ahead @ steps[1][k], np.zeros((len(J), len(J)))]])
        right = np.vstack([turned @ of_q[k] - by_state[k], -ahead @ steps[0][k] @ of_q[k]])
        made[k] = np.linalg.solve(K, right)[:nv]
    return made


class Slopes(NamedTuple):
    """v and ṗ at (q, p): values (n, 2 nv), derivatives F (n, 2 nv, 2 nv) by (q, p) and G (n, 2 nv, nv) by τ."""

    values: Array
    F: Array
    G: Array


def rattle(
    p: Array, half: Array, start: Slopes, end: Slopes, h: Array, given: tuple[Array, Array, Array], here: Rows,
    there: Rows,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """δq⁺ and δp (n, nv, m), and p, each before the velocities are brought onto the constraints.

    p, half     (n, nv) momenta before the step and in its middle
    start, end  Slopes at (q, half) and at (q⁺, half)
    h           (n, 1, 1) half of the step [s]
    given       δq, δp, δτ, each (n, nv, m), by the state
    """
    of_q, of_p, of_tau = given
    (n, nv), m, one = p.shape, of_q.shape[2], np.eye(p.shape[1])
    moved, changed = np.empty((n, nv, m)), np.empty((n, nv, m))
    pulled = half - p - h[:, 0] * start.values[:, nv:]  # Jᵀ of the multipliers
    first, last = slice(0, nv), slice(nv, 2 * nv)
    for k, kept in enumerate(here.kept):
        J, ahead, c = here.J[k][kept], there.J[k][kept], h[k, 0, 0]
        F0, F1, zero = start.F[k], end.F[k], np.zeros((len(J), len(J)))
        turned = np.einsum("ijk,i->jk", here.turned[k][kept], _multipliers(J, pulled[k]))
        none = np.zeros((len(J), nv))
        K = np.block([
            [one - c * F0[last, last], np.zeros((nv, nv)), -J.T],
            [-c * (F0[first, last] + F1[first, last]), one - c * F1[first, first], none.T],
            [none, ahead, zero],
        ])  # fmt: skip
        right = np.vstack([
            of_p[k] + c * (F0[last, first] @ of_q[k] + start.G[k][last] @ of_tau[k]) + turned @ of_q[k],
            of_q[k] + c * (F0[first, first] @ of_q[k]),
            np.zeros((len(J), m)),
        ])  # fmt: skip
        found = np.linalg.solve(K, right)
        between, moved[k] = found[:nv], found[nv : 2 * nv]
        pushed = F1[last, first] @ moved[k] + F1[last, last] @ between + end.G[k][last] @ of_tau[k]
        changed[k] = between + c * pushed
    return moved, changed, half + h[:, 0] * end.values[:, nv:]


def met(model: Model, q: Array, p: Array, ahead: Array, moved: Array, changed: Array, there: Rows) -> Array:
    """δv⁺ (n, nv, m), where v⁺ is the velocity nearest to M⁻¹ p with J v = 0.

    ahead           (n, nv) momentum of v⁺
    moved, changed  (n, nv, m) δq and δp
    """
    nv = model.nv
    v = calls["velocity_from_momentum"](model, q, ahead)
    by_q = along(model, SPECS["momentum"], [q, v], [moved, np.zeros_like(moved)])
    M, made = np.asarray(calls["crba"](model, q)), np.empty_like(moved)
    for k, kept in enumerate(there.kept):
        J, turned = there.J[k][kept], there.turned[k][kept]
        mu = _multipliers(J, ahead[k] - p[k])
        K = np.block([[M[k], -J.T], [J, np.zeros((len(J), len(J)))]])
        pulled = np.einsum("ijk,i->jk", turned, mu) @ moved[k]
        closing = -np.einsum("ijk,j->ik", turned, v[k]) @ moved[k]
        made[k] = np.linalg.solve(K, np.vstack([changed[k] + pulled - by_q[k], closing]))[:nv]
    return made


def _multipliers(J: Array, pull: Array) -> Array:
    """Least-squares solution λ of Jᵀ λ = pull."""
    made: Array = np.linalg.lstsq(J.T, pull)[0]
    return made
