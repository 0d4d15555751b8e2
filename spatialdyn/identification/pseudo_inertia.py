"""The pseudo-inertia of a body: ten inertial parameters as a symmetric 4x4 matrix of moments of its mass.

P = [[Σ, h], [hᵀ, m]] with Σ = ½ tr(Ī) 1 - Ī, the second moments of mass about the frame's origin. A body with these
parameters exists exactly if P is positive semidefinite. A load with P in a frame placed at X (4, 4) in a body has
X P Xᵀ in the body. Source: Wensing, Kim, Slotine, Linear matrix inequalities for physically consistent inertial
parameter identification (2018).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
ROUNDING = 4.0 * float(np.finfo(float).eps)  # relative to the largest eigenvalue: the sign of a smaller one is unknown
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # places of the last six parameters in Ī


def pseudo_inertia(pi: Array) -> Array:
    """P (..., 4, 4) of inertial parameters (..., 10)."""
    P = np.zeros((*pi.shape[:-1], 4, 4))
    trace = pi[..., 4] + pi[..., 6] + pi[..., 9]
    for k, (i, j) in enumerate(_PLACES, start=4):
        P[..., i, j] = P[..., j, i] = -pi[..., k]
    for i in range(3):
        P[..., i, i] += 0.5 * trace
        P[..., i, 3] = P[..., 3, i] = pi[..., 1 + i]
    P[..., 3, 3] = pi[..., 0]
    return P


def positive(pi: Array) -> NDArray[np.bool_]:
    """Which (...) of the bodies (..., 10) have a P that is positive definite beyond rounding."""
    values = np.linalg.eigvalsh(pseudo_inertia(pi))
    return np.asarray(values[..., 0] > ROUNDING * values[..., -1])


def parameters_of(P: Array) -> Array:
    """Inertial parameters (..., 10) of P (..., 4, 4)."""
    pi = np.empty((*P.shape[:-2], 10))
    trace = P[..., 0, 0] + P[..., 1, 1] + P[..., 2, 2]
    pi[..., 0], pi[..., 1:4] = P[..., 3, 3], P[..., :3, 3]
    for k, (i, j) in enumerate(_PLACES, start=4):
        pi[..., k] = (trace if i == j else 0.0) - P[..., i, j]
    return pi


def in_body(X: Array) -> Array:
    """Matrix (10, 10) that maps parameters in a frame, placed at X (4, 4) in a body, to parameters in the body."""
    return np.asarray(parameters_of(X @ pseudo_inertia(np.eye(10)) @ X.T).T)


def consistent(pi: Array, floor: float) -> Array:
    """The nearest parameters (..., 10) whose P has no eigenvalue below ``floor`` times its largest, or pi unchanged."""
    P = pseudo_inertia(pi)
    values, axes = np.linalg.eigh(P)
    least = floor * np.maximum(values[..., -1:], np.finfo(float).tiny)
    raised = (axes * np.maximum(values, least)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return np.where((values >= least).all(-1)[..., None], pi, parameters_of(raised))
