"""LDLᵀ with dropped pivots: what it solves, what it drops, and that it is scalars without branches."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from spatialdyn.engines.numbers.multiprecision import arithmetic, numbers
from spatialdyn.recursions.constraints.dense import (
    choose_rows,
    factor_dropping,
    quotient,
    solve_backward,
    solve_forward,
)

EPS = np.finfo(float).eps
TOLERANCE = 1e-12


def solved(G: Any, b: Any, size: Any = None) -> tuple[Any, Any, Any]:
    """x, which rows were kept, and what is left of b in the others."""
    G, y, m = G.copy(), b.copy(), len(b)
    x, kept = np.zeros(m, G.dtype), np.zeros(m, object if G.dtype == object else float)
    factor_dropping(G, np.diag(G).copy() if size is None else size, TOLERANCE, kept)
    solve_forward(G, y)
    solve_backward(G, y, x)
    return x, kept, y


def test_by_hand() -> None:
    """[4 2; 2 5] x = [8 14]: x = [3/4, 5/2]."""
    x, kept, _ = solved(np.array([[4.0, np.nan], [2.0, 5.0]]), np.array([8.0, 14.0]))  # the lower triangle is read
    assert x.tolist() == [0.75, 2.5]
    assert kept.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("m", [1, 2, 5, 12])
def test_it_solves_a_positive_definite_system(m: int) -> None:
    rng = np.random.default_rng(m)
    A = rng.normal(size=(m, m + 2))
    G, b = A @ A.T, rng.normal(size=m)
    x, kept, _ = solved(G, b)
    assert kept.all()
    assert abs(G @ x - b).max() <= 1e2 * EPS * np.linalg.cond(G) * abs(b).max()


def test_dependent_rows_drop_out_and_a_consistent_right_side_is_met() -> None:
    """Rows 1 and 3 are combinations of rows before them, row 4 is 0."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 7))
    A[1], A[3], A[4] = 2.0 * A[0], A[0] - A[2], 0.0
    G, b = A @ A.T, A @ rng.normal(size=7)
    x, kept, left = solved(G, b)
    assert kept.tolist() == [1, 0, 1, 0, 0, 1]
    assert (x[kept == 0.0] == 0.0).all()
    assert abs(G @ x - b).max() <= 1e4 * EPS * abs(b).max()
    assert abs(left[kept == 0.0]).max() <= 1e2 * EPS * abs(b).max()


def test_what_contradicts_is_left_over() -> None:
    """x = 1 and x = 3: two are left."""
    _, kept, left = solved(np.ones((2, 2)), np.array([1.0, 3.0]))
    assert kept.tolist() == [1.0, 0.0]
    assert left.tolist() == [1.0, 2.0]


def test_a_row_of_rounding_is_measured_by_its_constraint() -> None:
    """Alone 1e-34 would be a fine pivot; beside the 1 of its own constraint it is nothing."""
    G = np.diag([1.0, 1e-34])
    assert solved(G, np.ones(2))[1].tolist() == [1.0, 1.0]
    assert solved(G, np.ones(2), np.ones(2))[1].tolist() == [1.0, 0.0]


def test_rationals_are_exact() -> None:
    rational = arithmetic(None)
    G = numbers(rational, [[2, 4, 0], [4, 8, 0], [0, 0, Fraction(1, 3)]])
    x, kept, _ = solved(G, numbers(rational, [1, 2, 5]))
    assert [rational.shown(e) for e in x] == [Fraction(1, 2), 0, 15]
    assert [float(e) for e in kept] == [1.0, 0.0, 1.0]


def test_a_quotient_by_zero_is_the_numerator() -> None:
    assert [quotient(3.0, 2.0), quotient(3.0, 0.0), quotient(0.0, 0.0)] == [1.5, 3.0, 0.0]


# --- rows that are chosen -------------------------------------------------------------------------------


def chosen(G: Any, most: int | None = None) -> tuple[list[float], float, float]:
    """Which rows are kept, how many, and the largest relative pivot of the others."""
    m = len(G)
    kept, column, best = (np.zeros(m, G.dtype) for _ in range(3))
    size = np.diag(G).copy()
    count, spare = choose_rows(G.copy(), size, TOLERANCE, float(m if most is None else most), kept, column, best)
    return [float(x) for x in kept], float(count), float(spare)


def test_the_largest_pivot_comes_first() -> None:
    """Rows 0 and 1 nearly agree, and 2 is their sum: of the two near ones the second is not kept, but 2 less."""
    A = np.array([[1.0, 0.0, 0.0], [1.0, 1e-5, 0.0], [2.0, 1e-5, 0.0], [0.0, 0.0, 1.0]])
    kept, count, spare = chosen(A @ A.T)
    assert count == 3
    assert sum(kept) == 3
    assert kept[3] == 1.0
    assert spare <= TOLERANCE
    kept, count, spare = chosen(A @ A.T, 2)
    assert count == 2
    assert kept[3] == 1.0
    assert 1e-12 < spare < 1e-9  # sin² of 1e-5


@pytest.mark.parametrize("seed", range(5))
def test_chosen_rows_solve_beside_a_small_early_pivot(seed: int) -> None:
    """Rows 0 and 1 differ by 1e-5, the last depends on both and on row 2."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 6))
    A[1] = A[0] + 1e-5 * rng.normal(size=6)
    A[3] = A[:3].T @ rng.normal(size=3)
    G, b = A @ A.T, A @ rng.normal(size=6)
    kept, count, _ = chosen(G)
    assert count == 3
    C, x = G.copy(), np.zeros(4)
    factor_dropping(C, None, 0.0, np.array(kept))
    y = b.copy()
    solve_forward(C, y)
    solve_backward(C, y, x)
    assert (x[np.array(kept) == 0.0] == 0.0).all()
    assert abs(G @ x - b).max() <= 1e2 * EPS * abs(G).max() * abs(x).max()


def test_nothing_is_chosen_of_rows_of_zeros() -> None:
    assert chosen(np.zeros((3, 3))) == ([0.0, 0.0, 0.0], 0.0, 0.0)


def test_rationals_are_chosen_exactly() -> None:
    rational = arithmetic(None)
    G = numbers(rational, [[2, 4, 0], [4, 8, 0], [0, 0, Fraction(1, 3)]])
    assert chosen(G)[:2] == ([1.0, 0.0, 1.0], 2.0)
