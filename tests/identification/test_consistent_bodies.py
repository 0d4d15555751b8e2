"""Searches of consistent bodies that fail, are cut short, or end at no body: each says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_identify import NOISE, measured, model, off

import spatialdyn as sd
from spatialdyn.identification import log_cholesky, semidefinite


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
