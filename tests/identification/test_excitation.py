"""Excitation: within limits, at rest at its ends, better than chance, along a true gradient."""

from __future__ import annotations

import numpy as np
import pytest
from example_runs import compiled, robots

import spatialdyn as sd
from spatialdyn.identification.base import base_parameters
from spatialdyn.identification.excitation import _Search
from spatialdyn.identification.unknowns import unknowns_of


def log_det(model: sd.Model, path: sd.Path) -> float:
    q, v, a = path(np.linspace(0.0, path.duration, 200, endpoint=False))
    W = sd.joint_torque_regressor(model, q, v, a)[:, :, 1:].reshape(200 * model.nv, -1)[
        :, base_parameters(model).columns
    ]
    return float(np.linalg.slogdet(W.T @ W)[1])


def test_a_path_is_at_rest_at_its_ends_and_better_than_chance() -> None:
    model = sd.load_urdf("two_link")
    chance = sd.excitation(model, 4.0, 3, parameters="inertial", starts=1, steps=0)
    best = sd.excitation(model, 4.0, 3, parameters="inertial", starts=4, steps=15)
    assert abs(best(0.0).v).max() < 1e-12
    assert abs(best(0.0).a).max() < 1e-11
    assert log_det(model, best) > log_det(model, chance) + 0.5
    again = sd.excitation(model, 4.0, 3, parameters="inertial", starts=4, steps=15)
    assert np.array_equal(best.values["sines"], again.values["sines"])


@pytest.mark.parametrize("criterion", ["logdet", "cond"])
def test_the_slope_is_that_of_the_criterion(criterion: str) -> None:
    model, rng = sd.load_urdf("two_link"), np.random.default_rng(0)
    search = _Search(unknowns_of(model, "inertial"), base_parameters(model).columns, 4.0, 3, criterion, True)
    search.bound(None, None)
    x, way = search.within(search.random(rng)), rng.normal(size=(4, 2))
    assert x is not None
    expected = (search.value(x + 1e-5 * way) - search.value(x - 1e-5 * way)) / 2e-5
    assert float((search.slope(x) * way).sum()) == pytest.approx(expected, rel=1e-5)


@robots
@compiled
def test_limits_and_the_callers_own_hold() -> None:
    model = sd.load_urdf("ur5")
    path = sd.excitation(model, 8.0, 3, starts=2, steps=2, acceleration=3.0)
    path.check_limits(model)
    q, v, a = path(np.linspace(0.0, 8.0, 500))
    assert abs(a).max() <= 3.0
    assert (abs(sd.rnea(model, q, v, a)) <= model.effort_limit + 1.0).all()
    seen = []
    with pytest.raises(sd.IdentificationError, match="none of 3 random paths"):
        sd.excitation(model, 8.0, 2, starts=3, steps=0, allowed=lambda path: seen.append(path) is not None)
    assert len(seen) == 3


def test_a_centre_beyond_its_limits_and_quaternions_are_refused() -> None:
    builder = sd.ModelBuilder("arm").add_body("b", None, "revolute", (0, 1, 0), limits=(-1.0, 1.0))
    with pytest.raises(sd.IdentificationError, match='centre of joint "b_joint" is 2'):
        sd.excitation(builder.build(), centre=[2.0])
    with pytest.raises(sd.IdentificationError, match="not all numbers"):
        sd.excitation(sd.load_urdf("floating_body", root="floating"))
