"""``specialize`` of a step of a scene: the step itself, its C code, its derivatives."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from combinations import PARTS, options, robot, start

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

EFFECTS = ("couplers", "contacts", "friction", "lugre", "smooth", "limits", "current", "voltage", "fext")
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="no programs")


def scene_with(name: str, *effects: str) -> sd.Scene:
    """One of the robots and these effects."""
    model = robot(name)
    given: dict[str, Any] = {"friction": False}
    for effect in effects:
        given |= options(model, effect)
    return sd.Scene(model, **given)


@compiled
@pytest.mark.parametrize("effect", EFFECTS)
def test_a_specialized_step_is_the_step(effect: str) -> None:
    scene = scene_with("arm", effect)
    (q, v), tau = start(scene.model), np.array([0.3, -0.2, 0.1])
    k = sd.specialize(scene, sd.step, fixed={"dt": 1e-3})
    own = [np.full(3, 1e-4)] if effect == "lugre" else []
    states = {"states": {"bristles": own[0]}} if own else {}
    for x, y in zip(k(q, v, tau, *own), sd.step(scene, q, v, tau, 1e-3, **states), strict=True):
        np.testing.assert_allclose(x, y["bristles"] if isinstance(y, dict) else y, rtol=0.0, atol=1e-15)
    many = k(np.tile(q, (5, 1)), v, tau, *own)
    np.testing.assert_array_equal(many[1][3], k(q, v, tau, *own)[1])


@compiled
@pytest.mark.parametrize("name", PARTS)
def test_a_whole_robot_is_a_text_of_python_and_of_c(name: str) -> None:
    """Friction, limits and forces of a robot in a function of its own, without this library."""
    scene = scene_with(name, "friction", "limits", "fext")
    (q, v), tau = start(scene.model), 0.1 * np.ones(scene.model.nv)
    k = sd.specialize(scene, sd.step, fixed={"dt": 2e-3})
    scope: dict[str, Any] = {}
    exec(k.python_code("whole"), scope)
    found = scope["whole"](q, v, tau)
    for x, y in zip(found, sd.step(scene, q, v, tau, 2e-3), strict=True):
        np.testing.assert_allclose(np.ravel(x), y, rtol=0.0, atol=1e-13)
    assert "double" in k.c_code("whole")


@compiled
def test_sweeps_of_dry_friction_are_unrolled_for_casadi() -> None:
    """The program loops until the guess of what sticks has settled; CasADi gets its ten corrections in a line."""
    casadi = pytest.importorskip("casadi")
    scene = scene_with("arm", "friction")
    (q, v), tau = start(scene.model), np.array([0.3, -0.2, 0.1])
    k = sd.specialize(scene, sd.step, fixed={"dt": 1e-3})
    assert k.program.regions
    found = k.to_casadi(jacobian=False).call([casadi.DM(x.tolist()) for x in (q, v, tau)])
    for x, y in zip(found, sd.step(scene, q, v, tau, 1e-3), strict=True):
        np.testing.assert_allclose(x.full().ravel(), y, rtol=0.0, atol=1e-13)


@compiled
def test_derivatives_of_a_specialized_step_are_those_of_the_step() -> None:
    scene = scene_with("arm", "smooth", "fext")
    (q, v), tau, rng = start(scene.model), 0.1 * np.ones(3), np.random.default_rng(3)
    A, B = sd.step_derivatives(scene, q, v, tau, 1e-2, "rk4")
    k = sd.specialize(scene, partial(sd.step, method="rk4"), fixed={"dt": 1e-2}, derivative="jvp")
    dq, dv, dtau = rng.normal(size=(3, 3))
    *_, after_q, after_v = k(q, v, tau, dq, dv, dtau)
    wanted = A @ np.concatenate([dq, dv]) + B @ dtau
    np.testing.assert_allclose(np.concatenate([after_q, after_v]), wanted, rtol=0.0, atol=1e-12)


@compiled
def test_a_joint_without_a_motor_has_no_torque_in_derivatives_of_its_program() -> None:
    """At a torque of 0, where it is at both of its limits."""
    model, motor = robot("arm"), sd.Motor([0.05, 0.05, 0.0], 1.0, 24.0, 20.0, efficiency=0.8)
    (q, v), tau, still = start(model), np.array([0.1, 0.2, 0.0]), np.zeros(3)
    scene = sd.Scene(model, motor=motor)
    k = sd.specialize(scene, sd.step, fixed={"dt": 1e-3}, derivative="jvp")
    for i, moves in enumerate([True, True, False]):
        *_, by_q, by_v = k(q, v, tau, still, still, np.eye(3)[i])
        assert by_q.any() == by_v.any() == moves
        np.testing.assert_allclose(by_v, sd.step_derivatives(scene, q, v, tau, 1e-3).B[3:, i], rtol=0.0, atol=1e-12)


@compiled
def test_a_model_is_the_scene_of_nothing_else() -> None:
    model = robot("floating")
    (q, v), tau = start(model), np.zeros(model.nv)
    k = sd.specialize(model, sd.step)
    assert k.signature == "(q (nq,), v (nv,), tau (nv,), dt ()) -> (q_after (nq,), v_after (nv,))"
    for x, y in zip(k(q, v, tau, 1e-3), sd.step(model, q, v, tau, 1e-3), strict=True):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=1e-15)


def test_what_is_no_program_of_a_step_is_named() -> None:
    scene = scene_with("arm", "couplers")
    with pytest.raises(sd.SpatialDynError, match="dtype is float32, expected float64 with constraints"):
        sd.specialize(scene, sd.step, np.float32)
    with pytest.raises(sd.SpatialDynError, match="outputs is given, expected none with a step"):
        sd.specialize(scene, sd.step, outputs=0)
    with pytest.raises(sd.SpatialDynError, match=r'expected functools.partial\(sd.step, method="rk4"\), say'):
        sd.specialize(scene, partial(sd.step, dt=0.1))
    with pytest.raises(sd.SpatialDynError, match="method is 'gauss4', expected one of explicit_euler"):
        sd.specialize(scene, partial(sd.step, method="gauss4"))
    with pytest.raises(sd.SimulationError, match='method is "rk4" and friction acts, expected semi_implicit_euler'):
        sd.specialize(scene_with("arm", "friction"), partial(sd.step, method="rk4"))
    with pytest.raises(sd.ModelError, match="model is a Scene, expected a spatialdyn Model"):
        sd.specialize(scene, sd.rnea)
