"""The impulse of one point: against brute force over directions, its derivative, points that the law cannot move."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spatialdyn.algebra.euclidean import Vec
from spatialdyn.recursions.contact.coulomb_cone import (
    factor_block,
    largest_eigenvalue,
    point_impulse,
    point_slope,
    squared_residual,
)

SOLVED = 1e-9  # [m/s] of velocities of order 1: the root is found to 1e-12, and B is of order 10
NEAR = 1e-8  # of an impulse near jamming, where it is some 1e4 times as sensitive to its direction as to be rounded
STEP, SLOPE = 1e-6, 1e-6  # of central differences, and their error, of the largest entry


def blocks(n: int, kind: str, seed: int = 0) -> list[Any]:
    """B, r and μ of points pushed into the ground: of rods, or of matrices with steep coupling."""
    rng, made = np.random.default_rng(seed), []
    for _ in range(n):
        if kind == "rod":
            x, y, z = 0.3 * rng.standard_normal(3)
            X = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            B = np.eye(3) - X @ np.diag(1.0 / rng.uniform(0.003, 0.05, 3)) @ X
        else:
            A = rng.standard_normal((3, 3))
            A[1:] += {"mild": 0.15, "steep": 1.5}[kind] * rng.standard_normal((2, 1)) * A[0]
            B = A @ A.T + 0.02 * np.eye(3)
        r = rng.standard_normal(3)
        r[0] = -abs(r[0])
        made.append((B, r, float(rng.choice([0.0, 0.3, 0.8, 1.5, 3.0]))))
    return made


def solve(B: Any, r: Any, mu: float, least: float = 0.0, held: bool = False) -> Any:
    """λ, whether it sticks and slides, and what ``point_slope`` takes."""
    C, root, disc = np.full((5, 3), np.nan), np.full(4, np.nan), np.full(5, np.nan)
    factor_block(B, np.trace(B), 6, C)
    made = point_impulse(B, C, Vec(*r), mu, least, root, disc, np.full(5, np.nan), held)
    return made, C, root, disc


def slides_by_angle(B: Any, r: Any, mu: float) -> list[Any]:
    """All λ of sliding in a fine fan of directions, bisected to where u_t is against λ_t."""

    def along(angle: Any) -> Any:
        d = np.array([np.ones_like(angle), mu * np.cos(angle), mu * np.sin(angle)])
        resists = B[0] @ d
        with np.errstate(divide="ignore", invalid="ignore"):
            f = np.where(resists > 0.0, -r[0] / resists, np.nan) * d
        u = r[:, None] + B @ f
        return f, u[1] * d[2] - u[2] * d[1], u[1] * d[1] + u[2] * d[2]

    angle = np.linspace(-np.pi, np.pi, 20001)
    turn = along(angle)[1]
    at = np.flatnonzero(turn[:-1] * turn[1:] <= 0.0)
    low, high, first = angle[at], angle[at + 1], turn[at]
    for _ in range(50):
        middle = 0.5 * (low + high)
        same = along(middle)[1] * first > 0.0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    f, _, speed = along(high)
    return list(f[:, speed < 0.0].T)


@pytest.mark.parametrize("kind", ["mild", "steep", "rod"])
def test_a_point_obeys_the_law_as_brute_force_finds_it(kind: str) -> None:
    slid = 0
    for B, r, mu in blocks(150, kind):
        (f, sticks, slides), *_ = solve(B, r, mu)
        u, found = r + B @ np.array(f), np.array(f)
        square = squared_residual(B[0, 0], largest_eigenvalue(B), Vec(*u), mu, f, 0.0, np.full(1, np.nan))
        assert square <= SOLVED**2
        assert sticks + slides == 1.0
        if slides and mu > 0.0:
            slid += 1
            stuck = -np.linalg.solve(B, r)
            assert not (stuck[0] > 0.0 and np.hypot(*stuck[1:]) < mu * stuck[0])  # sticking goes first
            near = min(abs(x - found).max() for x in slides_by_angle(B, r, mu))
            assert near <= NEAR * abs(found).max()
    assert slid > 20


@pytest.mark.parametrize("least", [0.0, 0.5])
def test_the_slope_is_that_of_differences(least: float) -> None:
    states = set()
    for B, r, mu in blocks(80, "mild", 3):
        r = r * np.array([np.sign(r[1]) if least else 1.0, 1.0, 1.0])
        (f, sticks, slides), C, root, disc = solve(B, r, mu, least)
        T = np.full((3, 3), np.nan)
        point_slope(B, C, Vec(*r), mu, least, f, sticks, slides, root, disc, T)
        ways = STEP * np.eye(3)
        ends = [[np.array(solve(B, r + s * e, mu, least)[0][0]) for e in ways] for s in (1, -1)]
        wanted = (np.array(ends[0]) - np.array(ends[1])).T / (2 * STEP)
        assert abs(T - wanted).max() <= SLOPE * max(abs(wanted).max(), 1.0)
        states.add((sticks, slides, float(disc[4])))
    assert len(states) >= 2 + 2 * (least > 0.0)


def test_a_point_that_leaves_gets_nothing_and_one_without_friction_no_tangent() -> None:
    B = np.diag([1.0, 2.0, 3.0])
    assert solve(B, np.array([0.5, 1.0, 0.0]), 0.8)[0] == (Vec(0.0, 0.0, 0.0), 0.0, 0.0)
    f, sticks, slides = solve(B, np.array([-0.5, 1.0, 0.0]), 0.0)[0]
    assert (tuple(f), sticks, slides) == ((0.5, 0.0, 0.0), 0.0, 1.0)


def test_nan_reaches_no_loop_without_end() -> None:
    (f, *_), *_ = solve(np.eye(3), np.array([np.nan, 1.0, 0.0]), 0.8)
    assert not np.isfinite(f.y) or f.y == 0.0
