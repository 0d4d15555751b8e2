"""Searches of consistent bodies that fail, are cut short, or end at no body: each says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_identify import NOISE, measured, model, off, truth

import spatialdyn as sd
from spatialdyn.identification import log_cholesky, semidefinite
from spatialdyn.identification.pseudo_inertia import consistent, positive, pseudo_inertia

FEW = 30  # steps of a search: some ten are usual


def test_the_search_ends_at_the_least_cost() -> None:
    """Of a convex function: no step to bodies that exist, and linear numbers of 0 or more, lowers it."""
    rng, bodies = np.random.default_rng(0), 2
    start = np.append(consistent(rng.uniform(0.5, 2.0, (bodies, 10)), 0.1).ravel(), [0.3, 0.2])
    for size, weight in ((1.0, 1.0), (1e6, 1.0), (1e-3, 1e3)):
        A = size * rng.normal(size=(12, 22))
        z = A @ (start * rng.uniform(0.5, 1.5, 22)) - 3.0 * A[:, -1]  # so that the last number is held
        P0 = pseudo_inertia(start[:20].reshape(bodies, 10))

        def cost(pi: np.ndarray, A: Any = A, z: Any = z, weight: Any = weight, P0: Any = P0) -> float:
            ratio = np.linalg.solve(P0, pseudo_inertia(pi[:20].reshape(bodies, 10)))
            prior = 0.5 * (np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - 4.0)
            return float(0.5 * np.sum((A @ pi - z) ** 2) + weight * prior.sum())

        found = log_cholesky.fit(A, z, start, bodies, np.array([True, True]), weight)
        assert found.steps < FEW
        assert found.held.tolist() == [False, True]
        assert found.cost == pytest.approx(cost(found.pi), rel=1e-6)
        near = np.linalg.svd(A[:, :21])[2][12:]  # of what A does not see, steps are long
        for way in [*near, *(1e-6 * rng.normal(size=(8, 21)))]:
            for sign in (1e-3, -1e-3):
                moved = found.pi + sign * np.append(way, 0.0)
                assert not positive(moved[:20].reshape(bodies, 10)).all() or cost(moved) >= found.cost * (1.0 - 1e-9)


@pytest.mark.parametrize("method", ["ols", "wls", "log_cholesky", "sdp"])
def test_exact_torques_are_fitted_by_every_method(method: str) -> None:
    """As of a first try: computed torques, masses 30 % wrong. Their noise counts as 1e-6 of the torque."""
    if method == "sdp":
        pytest.importorskip("cvxpy")
    for parameters in ("inertial", "inertial+friction"):
        found = sd.identify(measured(model(), 0.0), off(), method, parameters)
        assert abs(found.beta - truth(found, model())).max() < 1e-7
        assert found.half_width.max() < 1e-4
        assert not found.notes
        assert found.steps < FEW
        if method in ("log_cholesky", "sdp"):
            assert found.consistent
            assert found.model().name == model().name
    log = measured(model(), 0.0)
    nothing = sd.Recording(log.t, log.q, np.zeros(log.q.shape))
    still = sd.identify(nothing, model(), "log_cholesky", "friction")  # what gravity and motion would need as friction
    assert np.isfinite(still.parameters).all()


def test_what_the_semidefinite_solver_does_not_reach_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    cvxpy = pytest.importorskip("cvxpy")
    log = measured(model(), NOISE)

    def found() -> sd.Identified:
        return sd.identify(log, off(), "sdp", "inertial")

    assert not [x for x in found().notes if "semidefinite" in x]
    for status, refused in (("optimal_inaccurate", False), ("user_limit", True)):
        monkeypatch.setattr(cvxpy.Problem, "status", status)
        if refused:
            with pytest.raises(sd.IdentificationError, match='"user_limit", expected "optimal": method="log_cholesky"'):
                found()
        else:
            assert [x for x in found().notes if "optimal_inaccurate" in x]

    def fail(*_: Any, **__: Any) -> None:
        raise cvxpy.error.SolverError("Solver 'CLARABEL' failed. Try another.")

    monkeypatch.setattr(cvxpy.Problem, "solve", fail)
    with pytest.raises(sd.IdentificationError, match=r"is not solved: Solver 'CLARABEL' failed.*log_cholesky"):
        found()


def test_a_search_that_is_cut_or_ends_at_no_body_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    log = measured(model(), NOISE)
    whole = sd.identify(log, off(), "log_cholesky", "inertial")
    assert whole.consistent
    assert not [x for x in whole.notes if "settled" in x]
    monkeypatch.setattr(log_cholesky, "STEPS", 2)
    assert [x for x in sd.identify(log, off(), "log_cholesky", "inertial").notes if "after 2 steps, not settled" in x]
    flat = log_cholesky.Consistent(np.tile([1.0, *[0.0] * 9], 2), 0.0, 1, np.zeros(0, bool))  # points: P of rank 1
    monkeypatch.setattr(log_cholesky, "fit", lambda *_: flat)
    found = sd.identify(log, off(), "log_cholesky", "inertial")
    assert found.consistent is False
    assert [x for x in found.notes if "joint1, joint2 are not positive" in x]


def test_a_missing_solver_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(sd.SpatialDynError, match="pip install cvxpy clarabel"):
        semidefinite.need_cvxpy()
