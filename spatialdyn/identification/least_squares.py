"""Least squares of many rows by small triangular factors, one for each freedom, weighted by its own noise.

The factor R of [W_b | y] of a freedom replaces its rows in least squares: ||W_b β - y|| = ||R (β, -1)||. Another QR
adds the factors of more rows, so a log need not fit into memory, and weights can change without its rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .equations import Rows

Array = NDArray[np.float64]
NORMAL = 1.959963984540054  # half width of 95 % of a normal distribution
ITERATIONS = 30
SETTLED = 1e-8  # relative change of deviations at which reweighting ends
LAGS = 10  # number of lags in the test for whiteness
WHITE = 0.01  # probability below which a residual is not white
FLOOR = 1e-6  # of a freedom's torque: least noise, so that weights of exact torques are not made of rounding errors
SMALL = 1e-3  # of the largest torque: smaller torques, such as 0, count as this for the floor


def triangle(A: Array) -> Array:
    """The triangular factor of a QR."""
    return np.asarray(np.linalg.qr(A, mode="r"))


@dataclass(frozen=True)
class Factors:
    """A triangular factor (columns + 1, columns + 1) for each freedom, its number of rows, and their Σ τ²."""

    R: tuple[Array, ...]
    n: NDArray[np.int64]
    power: Array

    @property
    def size(self) -> int:
        """Number of columns beside y."""
        return int(self.R[0].shape[1]) - 1

    def part(self, columns: NDArray[np.intp]) -> Factors:
        """The factors of some columns, and y."""
        at = [*columns.tolist(), self.size]
        return Factors(tuple(triangle(R[:, at]) for R in self.R), self.n, self.power)

    def joined(self, sigma: Array) -> Array:
        """R (columns + 1, columns + 1) of all rows, with the rows of each freedom divided by its deviation."""
        return triangle(np.concatenate([R / s for R, s in zip(self.R, sigma, strict=True)]))

    @property
    def floor(self) -> Array:
        """Least deviation (nv,) of each freedom's noise: a share of its torque or, if larger, of the forces' torque."""
        y = np.array([float(np.sum(R[:, -1] ** 2)) for R in self.R])
        rms = np.sqrt(np.maximum(self.power, y) / np.maximum(self.n, 1))
        least = FLOOR * np.maximum(rms, SMALL * rms.max(initial=0.0))
        return np.asarray(np.maximum(least, np.finfo(float).tiny))

    def squares(self, beta: Array) -> Array:
        """Sum of squares (nv,) of each freedom's residuals."""
        x = np.append(beta, -1.0)
        return np.array([float(np.sum((R @ x) ** 2)) for R in self.R])


def factors_of(rows: Iterable[Rows], columns: NDArray[np.intp], more: Callable[[Rows], Array] | None = None) -> Factors:
    """Factors of chunks of rows; ``more`` gives another column (n, nv), put before y."""
    kept: list[Array] = []
    n, power = np.zeros(0, np.int64), np.zeros(0)
    for chunk in rows:
        nv = chunk.y.shape[1]
        if not kept:
            width = len(columns) + 1 + (more is not None)
            kept, n, power = [np.zeros((0, width)) for _ in range(nv)], np.zeros(nv, np.int64), np.zeros(nv)
        W, extra = chunk.W[:, :, columns], None if more is None else more(chunk)
        for i in range(nv):
            use = chunk.keep[:, i]
            parts = [W[use, i], *([] if extra is None else [extra[use, i, None]]), chunk.y[use, i, None]]
            kept[i] = _factor(np.concatenate([kept[i], np.concatenate(parts, 1)]))
            n[i] += int(use.sum())
            power[i] += float(np.sum(chunk.tau[use, i] ** 2))
    return Factors(tuple(kept), n, power)


def _factor(A: Array) -> Array:
    """Square triangular factor of rows with many zero columns, those of bodies that a freedom does not move."""
    used = np.flatnonzero(A.any(0))
    R = np.zeros((A.shape[1], A.shape[1]))
    small = triangle(A[:, used])
    R[: len(small), used] = small
    return R


def added(one: Factors | None, other: Factors) -> Factors:
    """The factors of two sets of rows together."""
    if one is None:
        return other
    R = tuple(_factor(np.concatenate(pair)) for pair in zip(one.R, other.R, strict=True))
    return Factors(R, one.n + other.n, one.power + other.power)


@dataclass(frozen=True)
class Solution:
    """β (p,), its covariance (p, p), deviations (nv,) of the noise, and the weights' R (p + 1, p + 1)."""

    beta: Array
    covariance: Array
    sigma: Array
    R: Array


def solve(factors: Factors, weighted: bool, inflation: Array | None = None) -> Solution:
    """β by least squares; reweighted by each freedom's deviation until that settles if ``weighted``.

    inflation  (nv,)  factor on the variance of a mean of the residuals, if they are not white

    In both cases the covariance allows a different noise for each freedom. No deviation is below the floor.
    """
    nv, p, floor = len(factors.R), factors.size, factors.floor
    sigma, more = np.ones(nv), np.ones(nv) if inflation is None else inflation
    found: tuple[Array, Array, Array] | None = None
    for _ in range(ITERATIONS):
        R = factors.joined(sigma)
        T, z = R[:p, :p], R[:p, p]
        inverse: Array = np.asarray(np.linalg.inv(T))
        beta = inverse @ z
        shares = np.array([np.sum((F[:, :p] @ inverse) ** 2) for F in factors.R]) / sigma**2
        left = np.maximum(factors.n - shares, 1.0)
        noise: Array = np.maximum(np.sqrt(factors.squares(beta) / left), floor)
        found = beta, inverse, noise
        if not weighted or abs(noise / sigma - 1.0).max() < SETTLED:
            break
        sigma = np.where(factors.n > 0, noise, 1.0)
    assert found is not None
    beta, inverse, noise = found
    meat = np.zeros((p, p))
    for F, s, e, f in zip(factors.R, sigma, noise, more, strict=True):
        A = F[:, :p] @ inverse
        meat += (e / s) ** 2 / s**2 * f * (A.T @ A)
    return Solution(beta, inverse @ meat @ inverse.T, noise, R)


def quantile(freedoms: float) -> float:
    """Quantile of Student's t at 97.5 %, from its expansion in 1/freedoms (Abramowitz and Stegun, 26.7.5)."""
    z, n = NORMAL, max(freedoms, 1.0)
    first, second = (z**3 + z) / 4.0, (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    return z + first / n + second / n**2


def whiteness(residuals: Array, apart: int = 1, least: float = 1.0) -> tuple[float, float]:
    """Probability that white noise (n,) is at least as correlated as these residuals (Ljung and Box); their inflation.

    apart  distance of residuals that share no sample: only residuals this far apart are tested
    least  inflation of residuals of white noise

    The inflation is 1 + 2 Σ ρ_k over the first lags with significant correlation: the variance of a mean of neighbours
    over that of white residuals.
    """
    chance, inflation = _whiteness(residuals[::apart])
    if apart > 1 and chance < WHITE:
        inflation = _whiteness(residuals)[1]
    return chance, max(least, inflation)


def _whiteness(residuals: Array) -> tuple[float, float]:
    x = residuals - residuals.mean() if len(residuals) else residuals
    n, power = len(x), float(x @ x)
    if n < 4 * LAGS or power == 0.0:
        return 1.0, 1.0
    most = min(n // 4, 200)
    rho = np.array([x[:-k] @ x[k:] / power for k in range(1, most + 1)])
    Q = n * (n + 2.0) * float(np.sum(rho[:LAGS] ** 2 / (n - np.arange(1, LAGS + 1))))
    z = ((Q / LAGS) ** (1.0 / 3.0) - 1.0 + 2.0 / (9.0 * LAGS)) / math.sqrt(2.0 / (9.0 * LAGS))  # Wilson and Hilferty
    chance = 0.5 * math.erfc(z / math.sqrt(2.0))
    if chance >= WHITE:
        return chance, 1.0
    low = abs(rho) < 2.0 / math.sqrt(n)
    end = int(np.argmax(low)) if low.any() else most
    return chance, max(1.0, 1.0 + 2.0 * float(rho[:end].sum()))
