"""Physically consistent inertias, by Gauss-Newton steps on Cholesky factors of pseudo-inertias.

Each pseudo-inertia is P = U Uᵀ with U upper triangular of positive diagonal. The cost term - log det P keeps P positive
definite. A step is P + U (Θ + Θᵀ) Uᵀ with ten coordinates Θ, the log-Cholesky coordinates at U. Steps are straight in
the parameters, like the directions that torques do not determine; along curves of log-Cholesky coordinates the search
would take hundreds of steps. To order 2 the cost is ½ |A π - z|² + ¼ weight |Θ + Θᵀ + C|², with C from the prior: one
linear least squares per step. The weight of the torques grows from 0 to 1 during the search, so that no step reaches
the border of positive definite matrices.

Source: Rucker and Wensing, Smooth parameterization of rigid-body inertia (2022); the scaling: Nesterov and Nemirovski,
Interior-point polynomial algorithms in convex programming (1994). The prior of a body is
D = ½ (tr(P₀⁻¹ P) - log det(P₀⁻¹ P) - 4), the divergence of two normal distributions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .pseudo_inertia import parameters_of, pseudo_inertia

Array = NDArray[np.float64]
STEPS = 200  # most; some ten are usual
SETTLED = 1e-10  # of the prior's weight: a step that lowers the cost by less ends the search
NEAR = 1.0  # of weight per body: after a step that lowers the cost by less, the torques' weight grows
GROWTH = 1e3  # largest factor of the torques' weight at a time
INSIDE = 0.9  # largest part of the way to the border in one step
HALVINGS = 40
PLACES = [(i, j) for i in range(4) for j in range(i, 4)]
_ROWS, _COLUMNS = np.array(PLACES).T
_SYMMETRIC = np.zeros((10, 4, 4))  # Θ + Θᵀ of each coordinate
for _k, (_i, _j) in enumerate(PLACES):
    _SYMMETRIC[_k, _i, _j] += 1.0
    _SYMMETRIC[_k, _j, _i] += 1.0
_SYMMETRIC.flags.writeable = False


@dataclass(frozen=True)
class Consistent:
    """Parameters (count,) of consistent bodies, the cost, the number of steps, which linear parameters are held at 0,
    and warnings in words.
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
    """π that minimises ½ |A π - z|² + weight Σ D, with its first 10 ``bodies`` entries of consistent bodies.

    start    (count,)  parameters of consistent bodies: where the search begins, and P₀ of the prior
    bounded  which of the other parameters are 0 or more
    """
    ten, tall, root = 10 * bodies, len(A), np.sqrt(0.5 * weight)
    U = upper_factor(pseudo_inertia(start[:ten].reshape(bodies, 10)))
    inverse = np.linalg.inv(U)  # of P₀ = U Uᵀ
    x = np.where(bounded, np.maximum(start[ten:], 0.0), start[ten:])

    def pi_of(U: Array, x: Array) -> Array:
        return np.concatenate([parameters_of(U @ np.swapaxes(U, 1, 2)).ravel(), x])

    def cost_of(off: Array, F: Array, share: float) -> float:
        logs = 2.0 * float(np.log(np.einsum("bii->bi", F)).sum())
        return 0.5 * share * float(off @ off) + 0.5 * weight * (float((F * F).sum()) - logs - 4.0 * bodies)

    pi, F = pi_of(U, x), inverse @ U
    off = A @ pi - z
    share = min(1.0, 2.0 * weight * max(bodies, 1) / max(float(off @ off), np.finfo(float).tiny))
    M = np.zeros((tall + ten, len(pi)))
    M[tall:, :ten] = root * np.kron(np.eye(bodies), _flat(_SYMMETRIC).T)
    held, steps, settled = np.zeros(len(x), bool), 0, False
    while steps < STEPS and not settled:
        steps += 1
        J = parameters_of(U[:, None] @ _SYMMETRIC @ np.swapaxes(U, 1, 2)[:, None])  # (bodies, coordinates, parameters)
        M[:tall, ten:] = np.sqrt(share) * A[:, ten:]
        for k in range(bodies):
            at = slice(10 * k, 10 * k + 10)
            M[:tall, at] = np.sqrt(share) * (A[:, at] @ J[k].T)
        held = bounded & (x <= 0.0) & (off @ A[:, ten:] >= 0.0)
        free = np.concatenate([np.ones(ten, bool), ~held])
        C = np.swapaxes(F, 1, 2) @ F - np.eye(4)
        size = np.sqrt((M * M).sum(0)) + (M == 0.0).all(0)
        goal = -np.concatenate([np.sqrt(share) * off, root * _flat(C).ravel()])
        step = np.zeros(len(pi))
        step[free] = np.linalg.lstsq((M / size)[:, free], goal, rcond=1e-14)[0] / size[free]
        gain = 0.5 * float(np.sum((M @ step) ** 2))
        S = np.einsum("bk,kij->bij", step[:ten].reshape(bodies, 10), _SYMMETRIC)
        least = float(np.linalg.eigvalsh(S).min(initial=0.0))
        length = min(1.0, INSIDE / -least) if least < 0.0 else 1.0
        cost = cost_of(off, F, share)
        for _ in range(HALVINGS):
            y = x + length * step[ten:]
            y = np.where(bounded, np.maximum(y, 0.0), y)
            tried = U @ upper_factor(np.eye(4) + length * S)
            moved, G = pi_of(tried, y), inverse @ tried
            left = A @ moved - z
            if cost_of(left, G, share) <= cost:
                U, x, pi, F, off = tried, y, moved, G, left
                break
            length *= 0.5
        else:
            gain = 0.0  # only rounding remains
        settled = share == 1.0 and gain <= SETTLED * weight
        if gain <= NEAR * weight * max(bodies, 1):
            share = min(1.0, GROWTH * share)
    note = (
        f"the search for consistent inertias stopped after {STEPS} steps, not settled: what the recording does not "
        "tell may be far off"
    )
    return Consistent(pi, cost_of(off, F, 1.0), steps, held, () if settled else (note,))


def _flat(S: Array) -> Array:
    """Numbers (..., 10) of symmetric matrices (..., 4, 4), of the same norm."""
    return np.asarray(S[..., _ROWS, _COLUMNS] * np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(2.0)))
