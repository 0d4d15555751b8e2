"""Reductions of chunks are those of the whole: against NumPy on all samples at once."""

from __future__ import annotations

from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd

RNG = np.random.default_rng(0)
X = RNG.normal(3.0, 1e3, (1000, 2, 3)) * RNG.choice([1e-6, 1.0], (1000, 1, 1))
CUTS = (0, 1, 300, 300 + 512, 1000)


def reduced(reduction: Any, x: Any, **beside: Any) -> Any:
    """Of chunks of unequal lengths."""
    states = []
    for a, b in pairwise(CUTS):
        states.append(reduction.of({"x": x[a:b], **{name: y[a:b] for name, y in beside.items()}}, a))
    return reduction.finish(reduce(reduction.merge, states))


def test_moments_are_those_of_all_samples() -> None:
    found = reduced(sd.Moments("x"), X)
    assert found.samples == 1000
    np.testing.assert_allclose(found.mean, X.mean(0), rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(found.variance, X.var(0), rtol=1e-12)
    np.testing.assert_allclose(found.std, X.std(0), rtol=1e-12)
    np.testing.assert_array_equal(found.least, X.min(0))
    np.testing.assert_array_equal(found.greatest, X.max(0))


def test_a_large_mean_costs_the_variance_no_digits() -> None:
    """Sums of squares would lose all: 1e9² is 2e18 times the variance."""
    x = 1e9 + RNG.normal(0.0, 1.0, 1000)
    np.testing.assert_allclose(reduced(sd.Moments("x"), x).variance, np.var(x - 1e9), rtol=1e-6)


@pytest.mark.parametrize("bits", [1, 10, 20])
def test_quantiles_keep_their_relative_error(bits: int) -> None:
    at = (0.0, 0.013, 0.5, 0.9, 1.0)
    found = reduced(sd.Quantiles("x", at, bits), X)
    exact = np.quantile(X, at, axis=0, method="inverted_cdf")
    assert found.shape == (5, 2, 3)
    worst = np.abs(found / exact - 1.0).max()
    assert worst <= 2.0 ** -(bits + 1)
    assert worst > 2.0 ** -(bits + 5)  # it is no other bound


def test_quantiles_count_zeros_and_signs() -> None:
    x = np.array([-2.0, -0.0, 0.0, 0.0, 1.0])
    r = sd.Quantiles("x", (0.0, 0.2, 0.4, 0.8, 1.0))
    np.testing.assert_allclose(r.finish(r.of({"x": x}, 0)), [-2.0, -2.0, 0.0, 0.0, 1.0], rtol=2.0**-11)


def test_quantiles_do_not_depend_on_the_order_of_chunks() -> None:
    r = sd.Quantiles("x")
    a, b = (r.of({"x": x}, 0) for x in (X[:400], X[400:]))
    one, other = r.merge(a, b), r.merge(b, a)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize("least", [False, True])
def test_the_worst_samples_are_named_with_what_is_beside_them(least: bool) -> None:
    x = RNG.integers(0, 30, 1000).astype(float)  # with ties
    found = reduced(sd.Worst("x", 7, ("q",), least), x, q=X)
    order = np.argsort(x if least else -x, kind="stable")[:7]
    np.testing.assert_array_equal(found.sample, order)
    np.testing.assert_array_equal(found.value, x[order])
    np.testing.assert_array_equal(found.beside["q"], X[order])


def test_a_tall_qr_solves_least_squares() -> None:
    rows = RNG.normal(size=(1000, 2, 5))
    R = reduced(sd.TallQR("x"), rows)
    tall = rows.reshape(-1, 5)
    np.testing.assert_allclose(R.T @ R, tall.T @ tall, rtol=1e-12, atol=1e-10)
    assert (np.tril(R, -1) == 0.0).all()
    assert (np.diag(R) > 0.0).all()
    expected, squares, *_ = np.linalg.lstsq(tall[:, :4], tall[:, 4], rcond=None)
    np.testing.assert_allclose(np.linalg.solve(R[:4, :4], R[:4, 4]), expected, rtol=1e-10)
    np.testing.assert_allclose(R[4, 4] ** 2, squares[0], rtol=1e-12)


@pytest.mark.parametrize("reduction", [sd.Moments("x"), sd.Quantiles("x"), sd.Worst("x"), sd.TallQR("x")])
def test_what_is_not_finite_is_refused_by_sample(reduction: Any) -> None:
    x = np.ones((5, 2)) if isinstance(reduction, sd.TallQR) else np.ones(5)
    x[3] = np.nan
    with pytest.raises(sd.StudyError, match="x is not finite in 1 of 5 samples, the first is 103"):
        reduction.of({"x": x}, 100)
    with pytest.raises(sd.StudyError, match='returns no "x", expected one of y'):
        reduction.of({"y": x}, 0)
    with pytest.raises(sd.StudyError, match="dtype complex128"):
        reduction.of({"x": x + 0j}, 0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sd.Quantiles("x", (0.5, 1.1)), r"at is \(0.5, 1.1\)"),
        (lambda: sd.Quantiles("x", bits=0), "bits is 0, expected 1 to 20"),
        (lambda: sd.Worst("x", 0), "count is 0"),
        (lambda: sd.Worst("x").of({"x": np.ones((3, 2))}, 0), r"expected \(n,\)"),
        (lambda: sd.TallQR("x").of({"x": np.ones(3)}, 0), r"expected \(n, c\)"),
    ],
)
def test_bad_arguments_are_refused(make: Any, message: str) -> None:
    with pytest.raises(sd.StudyError, match=message):
        make()
