"""Principal pivots, row by row, against dense inverses."""

from __future__ import annotations

import numpy as np
import pytest
from dense import Array

from spatialdyn.recursions.tableau import open_rows, turn_row

EPS = float(np.finfo(float).eps)


def positive(n: int) -> Array:
    """A random positive definite matrix."""
    X = np.random.default_rng(n).normal(size=(n, n + 2))
    return X @ X.T


def whole(T: Array) -> Array:
    """A symmetric matrix from its lower triangle."""
    return np.tril(T) + np.tril(T, -1).T


def pivoted(A: Array, held: Array) -> Array:
    """The tableau of A with rows held, as the module has it."""
    h, f = np.flatnonzero(held), np.flatnonzero(held == 0.0)
    inverse = np.linalg.inv(A[np.ix_(h, h)])
    made = np.zeros_like(A)
    made[np.ix_(h, h)] = -inverse
    made[np.ix_(h, f)] = inverse @ A[np.ix_(h, f)]
    made[np.ix_(f, h)] = made[np.ix_(h, f)].T
    made[np.ix_(f, f)] = A[np.ix_(f, f)] - A[np.ix_(f, h)] @ inverse @ A[np.ix_(h, f)]
    return made


def test_rows_turn_one_by_one_and_back() -> None:
    A, held = positive(6), np.zeros(6)
    T, column = A.copy(), np.zeros(6)
    for k in (2, 5, 0, 2, 3, 5):
        turn_row(T, k, 1.0, held[k], column)
        held[k] = 1.0 - held[k]
        np.testing.assert_allclose(whole(T), pivoted(A, held), rtol=0.0, atol=1e3 * EPS * np.linalg.cond(A))
    before = np.tril(T)
    turn_row(T, 1, 0.0, held[1], column)
    np.testing.assert_array_equal(np.tril(T), before)


@pytest.mark.parametrize("held", [(0, 0, 0, 0, 0, 0), (1, 0, 1, 1, 0, 1), (0, 1, 1, 1, 1, 0)])
@pytest.mark.parametrize(("k", "count"), [(1, 3), (4, 1)])
def test_opened_rows_respond_as_if_they_alone_were_free(held: tuple[int, ...], k: int, count: int) -> None:
    A, flags = positive(6), np.array(held, float)
    T, column, B, C = A.copy(), np.zeros(6), np.zeros((5, 3)), np.zeros((6, 3))
    for i in np.flatnonzero(flags):
        turn_row(T, int(i), 1.0, 0.0, column)
    kept = np.tril(T)
    open_rows(T, flags, k, count, B, C)
    np.testing.assert_array_equal(np.tril(T), kept)
    others = flags.copy()
    others[k : k + count] = 0.0
    wanted = pivoted(A, others)
    own = slice(k, k + count)
    np.testing.assert_allclose(B[:count, :count], wanted[own, own], rtol=0.0, atol=1e3 * EPS * np.linalg.cond(A))
    rest = [i for i in range(6) if not k <= i < k + count]
    np.testing.assert_allclose(C[rest, :count], wanted[rest, own], rtol=0.0, atol=1e3 * EPS * np.linalg.cond(A))
    assert (C[own] == 0.0)[:, :count].all()
