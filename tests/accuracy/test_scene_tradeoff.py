"""``trade`` and ``recommend`` of a scene: what acts, acts in every option and in the reference."""

from __future__ import annotations

import math

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.accuracy.integrator_errors import fine_motion
from spatialdyn.engines.compiled import numba_kernels

START = (np.array([[0.5, -0.3]]), np.array([[1.0, 2.0]]))
METHODS = ("semi_implicit_euler", "rk4")


@pytest.fixture
def damped() -> sd.Scene:
    friction = sd.Friction(0.3, 0.2, smoothing=0.1)
    return sd.Scene(sd.load_urdf("two_link"), friction=friction, friction_method="smooth")


def test_the_reference_of_a_scene_is_what_an_adaptive_method_finds(damped: sd.Scene) -> None:
    t = np.linspace(0.0, 0.2, 11)
    truth = fine_motion(damped, *START, t)
    run = sd.simulate(damped, START[0][0], START[1][0], 0.2, 0.02, "dop853", rtol=1e-12, atol=1e-14)
    least = 1e-5 if numba_kernels.PLAIN else 1e-9  # a single refinement without compiled steps
    assert truth.error[-1] < least
    np.testing.assert_allclose(truth.q[:, 0], run.q, rtol=0.0, atol=least)
    np.testing.assert_allclose(truth.v[:, 0], run.v, rtol=0.0, atol=100 * least)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: a single step of each method is measured")
def test_errors_are_of_motions_in_which_the_scene_acts(damped: sd.Scene) -> None:
    found = sd.trade(damped, "simulate", START, duration=0.2, methods=METHODS)
    rk4 = [x.error for x in sorted(found.options, key=lambda x: x.ns) if x.name.startswith("rk4")]
    assert min(rk4) < 1e-9
    assert max(x.error for x in found.options) < 0.1  # friction left out changes the motion by more
    assert all(x.error >= found.certainty for x in found.options if math.isfinite(x.error))
    assert "the scene at a fine step" in str(found)
    assert all(x.code.startswith("sd.simulate(scene, ") for x in found.options)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing to choose between")
def test_what_is_recommended_for_a_scene_runs_and_keeps_its_tolerance(damped: sd.Scene) -> None:
    chosen = sd.recommend(damped, "simulate", 1e-3, START, duration=0.2, methods=METHODS)
    run = eval(chosen.code, {"sd": sd, "scene": damped, "q0": START[0][0], "v0": START[1][0], "duration": 0.2})
    truth = fine_motion(damped, *START, np.linspace(0.0, 0.2, 11))
    assert abs(run.q[-1] - truth.q[-1, 0]).max() <= 1e-3 * abs(truth.q - truth.q[0]).max()


def test_scenes_that_a_method_or_task_cannot_take_are_refused(damped: sd.Scene) -> None:
    stuck = sd.Scene(damped.model, friction=sd.Friction(1.0))
    with pytest.raises(sd.SimulationError, match=r'method is "rk4" and friction acts, expected semi_implicit_euler'):
        sd.trade(stuck, "simulate", START, methods="rk4")
    with pytest.raises(sd.SpatialDynError, match=r'task is "mass_matrix" of a Scene, expected "simulate"'):
        sd.trade(damped, "mass_matrix")
