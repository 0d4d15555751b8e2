"""The measures by which two libraries are compared."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spatialdyn.validate.measures import BOUND, raised, rounding, scaled_error, singular, sort_key, unit_diagonal
from spatialdyn.validate.rows import Comparison, judged

EPS = float(np.finfo(float).eps)


def test_the_error_of_a_batch_is_that_of_its_worst_sample_over_its_own_largest_entry() -> None:
    truth = np.array([[1.0, 100.0], [0.5, 0.25], [2.0, 3.0]])
    off = np.array([[0.0, 5.0], [0.125, 0.0], [0.0, 0.0]])  # of 100, of less than 1, none
    assert scaled_error(truth + off, truth, 1) == 0.125
    assert scaled_error(truth - off, truth, 1) == 0.125
    assert math.isnan(scaled_error(np.array([[np.nan]]), np.array([[1.0]]), 1))
    assert scaled_error(truth, truth[:2], 1) == math.inf
    assert scaled_error(truth[:0], truth[:0], 1) == 0.0


def test_a_bound_is_raised_to_four_roundings_of_the_result_and_no_less_than_it_was() -> None:
    M, x = np.array([[2.0, -3.0], [5.0, 7.0]]), np.array([1e9, -1e9])
    assert rounding(M, x, np.ones(2)) == EPS * 12e9
    assert rounding(M, x, 2.0 * np.ones(2)) == EPS * 6e9
    assert raised(0.24 * BOUND) == BOUND
    assert raised(BOUND) == 4.0 * BOUND


def test_a_matrix_is_singular_in_any_units() -> None:
    units = np.diag([1e-8, 1.0, 1e8])
    sound = np.array([[2.0, 1.0, 0.5], [1.0, 3.0, 0.25], [0.5, 0.25, 5.0]])
    np.testing.assert_allclose(unit_diagonal(units @ sound @ units), unit_diagonal(sound), rtol=1e-14)
    assert not singular((units @ sound @ units)[None])
    assert singular((units @ np.ones((3, 3)) @ units)[None])
    assert singular(np.stack([sound, np.zeros((3, 3))]))


def test_a_comparison_is_good_if_every_row_is() -> None:
    rows = (judged("a", 1e-12, BOUND), judged("b", 2e-12, BOUND))
    assert Comparison("r", "fixed", 1, 1, 4, rows).ok
    for bad in (judged("c", 1.01 * BOUND, BOUND), judged("c", math.nan, BOUND), judged("c", math.inf, BOUND)):
        found = Comparison("r", "fixed", 1, 1, 4, (rows[0], bad, rows[1]))
        assert not found.ok
        assert found.worst is bad
        assert "disagrees in c" in repr(found)
    assert judged("c", BOUND, BOUND).ok


@pytest.mark.parametrize(("error", "key"), [(None, 0.0), (0.25, 0.25), (math.nan, math.inf), (-math.inf, math.inf)])
def test_what_is_not_finite_sorts_last(error: float | None, key: float) -> None:
    assert sort_key(error) == key
