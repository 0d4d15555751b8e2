"""Inertias that bodies can have, by Gauss-Newton steps in log-Cholesky coordinates.

Each pseudo-inertia is P = U Uᵀ with U upper triangular of positive diagonal. A step takes U to U T, T upper triangular
with exp of four coordinates on its diagonal and six beside it, so P stays positive definite whatever the step is. The
derivative at T = 1 is dP = U (E + Eᵀ) Uᵀ; of the second one, the part that is positive is added to Gauss and Newton's
matrix. Source: Rucker and Wensing, Smooth parameterization of rigid-body inertia
(2022). The prior of a body is D = ½ (tr(P₀⁻¹ P) - log det(P₀⁻¹ P) - 4), the divergence of two normal distributions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .pseudo_inertia import parameters_of, pseudo_inertia

Array = NDArray[np.float64]
STEPS = 500
SETTLED = 1e-9  # relative decrease of the cost, of three steps one after another
UPPER = [(i, j) for i in range(4) for j in range(i, 4)]
_E = np.zeros((10, 4, 4))
for _k, (_i, _j) in enumerate(UPPER):
    _E[_k, _i, _j] = 1.0
_E.flags.writeable = False
DIAGONAL = np.array([i == j for i, j in UPPER])
FARTHEST = 1.5  # a coordinate of the diagonal in one step: a factor of 4.5
_ROWS, _COLUMNS = np.array(UPPER).T
_OF_P = np.zeros((10, 4, 4))  # π_k = tr(_OF_P[k] P)
_OF_P[0, 3, 3] = 1.0
for _i in range(3):
    _OF_P[1 + _i, _i, 3] = _OF_P[1 + _i, 3, _i] = 0.5
for _k, (_i, _j) in enumerate([(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)], start=4):
    _OF_P[_k, _i, _j] -= 0.5
    _OF_P[_k, _j, _i] -= 0.5
    if _i == _j:
        _OF_P[_k, (0, 1, 2), (0, 1, 2)] += 1.0
_OF_P.flags.writeable = False


@dataclass(frozen=True)
class Consistent:
    """Parameters (count,) of consistent bodies, the cost, the number of steps, which linear ones are held at 0, and
    what is odd, in words.
    """

    pi: Array
    cost: float
    steps: int
    held: NDArray[np.bool_]
    notes: tuple[str, ...] = ()


def upper_factor(P: Array) -> Array:
    """U (..., 4, 4) upper triangular with P = U Uᵀ: the Cholesky factor of P with its indices reversed."""
    L = np.linalg.cholesky(P[..., ::-1, ::-1])
    return np.ascontiguousarray(L[..., ::-1, ::-1])


def fit(A: Array, z: Array, start: Array, bodies: int, bounded: NDArray[np.bool_], weight: float) -> Consistent:
    """π that minimises ½ |A π - z|² + weight Σ D, its first 10 ``bodies`` of bodies that exist.

    start    (count,)  of consistent bodies: where the search begins, and P₀ of the prior
    bounded  which of the other parameters are 0 or more
    """
    G, b = A.T @ A, A.T @ z
    half, ten = 0.5 * float(z @ z), 10 * bodies
    U = upper_factor(pseudo_inertia(start[:ten].reshape(bodies, 10)))
    P0 = np.linalg.inv(U @ np.swapaxes(U, 1, 2))
    x = np.where(bounded, np.maximum(start[ten:], 0.0), start[ten:])
    pi, cost = start.copy(), np.inf
    pi[ten:] = x

    def cost_of(pi: Array, U: Array) -> float:
        value = 0.5 * float(pi @ (G @ pi)) - float(b @ pi) + half
        spread = np.einsum("bij,bik,bjk->", P0, U, U)
        logs = 2.0 * float(np.log(np.einsum("bii->bi", U)).sum()) + float(np.linalg.slogdet(P0)[1].sum())
        return value + 0.5 * weight * float(spread - logs - 4.0 * bodies)

    cost, damping, calm, steps = cost_of(pi, U), 1e-3, 0, 0
    held = np.zeros(len(x), bool)
    while steps < STEPS and calm < 3:
        steps += 1
        pull = G @ pi - b
        held = bounded & (x <= 0.0) & (pull[ten:] > 0.0)
        B = np.zeros((len(pi), len(pi)))
        B[np.arange(ten, len(pi)), np.arange(ten, len(pi))] = ~held
        D = U[:, None] @ _E @ np.swapaxes(U, 1, 2)[:, None]
        J = parameters_of(D + np.swapaxes(D, -1, -2))  # (bodies, 10 coordinates, 10 parameters)
        for k in range(bodies):
            B[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] = J[k].T
        H, slope = B.T @ G @ B, B.T @ pull
        S = np.swapaxes(U, 1, 2) @ (np.einsum("bk,kij->bij", pull[:ten].reshape(bodies, 10), _OF_P)) @ U
        Q = 0.5 * weight * np.swapaxes(U, 1, 2) @ P0 @ U
        slope[:ten] += (2.0 * np.einsum("bij,kji->bk", Q, _E) - weight * DIAGONAL).ravel()
        bend = _positive(S) + Q
        own = 2.0 * np.einsum("kji,bjl,mli->bkm", _E, bend, _E)
        own[:, DIAGONAL, DIAGONAL] += 2.0 * np.einsum("bii->bi", bend)
        for k in range(bodies):
            H[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] += own[k]
        free = np.concatenate([np.ones(ten, bool), ~held])
        scale = np.sqrt(np.maximum(H.diagonal(), 1e-30))
        Hs = H / scale / scale[:, None]
        for _ in range(30):
            step = np.zeros(len(pi))
            damped = Hs + damping * np.eye(len(pi))
            step[free] = -np.linalg.solve(damped[np.ix_(free, free)], (slope / scale)[free]) / scale[free]
            theta = step[:ten].reshape(bodies, 10)
            theta = theta / np.maximum(1.0, abs(theta[:, DIAGONAL]).max(1, initial=0.0) / FARTHEST)[:, None]
            T = np.zeros((bodies, 4, 4))
            T[:, _ROWS, _COLUMNS] = np.where(DIAGONAL, np.exp(np.where(DIAGONAL, theta, 0.0)), theta)
            tried = U @ T
            y = np.where(bounded, np.maximum(x + step[ten:], 0.0), x + step[ten:])
            moved = np.concatenate([parameters_of(tried @ np.swapaxes(tried, 1, 2)).ravel(), y])
            new = cost_of(moved, tried) if np.isfinite(moved).all() else np.inf
            if new <= cost:
                break
            damping *= 4.0
        else:
            break
        calm = calm + 1 if cost - new <= SETTLED * (1.0 + cost) else 0
        U, x, pi, cost, damping = tried, y, moved, new, max(0.2 * damping, 1e-12)
    capped = calm < 3 and steps == STEPS
    note = (
        f"the search for consistent inertias stopped after {STEPS} steps, not settled: what the recording does not "
        "tell may be far off; torques without noise, as computed ones, do this: noise of a sensor's size settles it"
    )
    return Consistent(pi, cost, steps, held, (note,) * capped)


def _positive(S: Array) -> Array:
    """The positive semidefinite part of symmetric matrices (..., 4, 4): a Hessian of it alone leads downhill."""
    values, axes = np.linalg.eigh(0.5 * (S + np.swapaxes(S, -1, -2)))
    return np.asarray((axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))
