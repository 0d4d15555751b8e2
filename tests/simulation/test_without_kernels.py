"""Steps in Python compile no table kernel: beyond a program's range, and beside functions of torque."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scenes
from grounded import box

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.simulation import fixed_steps

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
STEPS, DT = 20, 1e-3
FAR = 2e5 * np.pi  # [rad] beyond the sines of programs, off whole turns by its rounding
ROUNDED = 1e-7  # of velocities: the rounding of FAR, 3e-11, is a depth in the ground that is left in a step
AGREE = 1e-11  # of velocities after a few steps, rounded otherwise


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> sd.Model:
    """An arm, none of whose table kernels may be compiled or read."""

    def refuse(spec: Any, *rest: Any) -> Any:
        raise AssertionError(f"the table kernel of {spec.name} is compiled")

    for name in ("sample_kernel", "batch_kernel"):
        monkeypatch.setattr(numba_kernels, name, refuse)
    return sd.load_urdf("two_link")


def tip(arm: sd.Model) -> str:
    return arm.frames[-1].name


def grounded(arm: sd.Model, q: Any) -> dict[str, Any]:
    """The tip on the ground."""
    height = sd.frame_placement(arm, q, tip(arm))[2, 3]
    return {"contacts": sd.Contacts(arm, {tip(arm): 0.0}, terrain=sd.Plane(height=height)), "friction": False}


def held(arm: sd.Model, q: Any) -> dict[str, Any]:
    """The tip at its height."""
    at = sd.frame_placement(arm, q, tip(arm))[:3, 3]
    return {"constraints": sd.Constraints(arm, [sd.PointConstraint(tip(arm), axes="z", at_b=at)]), "friction": False}


DRY = sd.Friction(0.1, 0.05)
ACTING: dict[str, Callable[[sd.Model, Any], dict[str, Any]]] = {
    "nothing": lambda arm, q: {"method": "semi_implicit_euler"},
    "rk4": lambda arm, q: {"method": "rk4"},
    "friction": lambda arm, q: {"friction": DRY},
    "lugre": lambda arm, q: {
        "friction": sd.Friction(0.1, 0.05, bristle_stiffness=100.0, bristle_damping=1.0), "friction_method": "lugre"
    },
    "smooth": lambda arm, q: {"friction": sd.Friction(0.1, 0.05, smoothing=0.1), "friction_method": "smooth"},
    "motor": lambda arm, q: {"motor": sd.Motor(np.full(2, 0.1), 1.0, 24.0, efficiency=0.8)},
    "contacts": grounded,
    "held": held,
}  # fmt: skip


@COMPILED
@pytest.mark.parametrize("acting", ACTING)
def test_an_angle_beyond_a_programs_range_compiles_none(arm: sd.Model, acting: str) -> None:
    near, far = np.array([0.0, 0.4]), np.array([FAR, 0.4])
    runs = [scenes.simulate(arm, q, np.zeros(2), STEPS * DT, DT, **ACTING[acting](arm, near)) for q in (near, far)]
    assert abs(runs[1].v - runs[0].v).max() <= ROUNDED
    assert abs(runs[0].v[-1]).max() > 1e-3 or acting in ("contacts", "held")


@COMPILED
@pytest.mark.parametrize("acting", ACTING)
def test_a_python_function_of_torque_compiles_none(arm: sd.Model, acting: str) -> None:
    q, tau = np.array([0.1, 0.4]), np.array([1.0, 2.0])
    given = ACTING[acting](arm, q)
    asked = scenes.simulate(arm, q, np.zeros(2), STEPS * DT, DT, torque=lambda t, q, v: tau, **given)
    row = scenes.simulate(arm, q, np.zeros(2), STEPS * DT, DT, torque=tau, **given)
    assert abs(asked.v - row.v).max() <= AGREE * max(1.0, abs(row.v).max())


@COMPILED
@pytest.mark.parametrize("method", ["gauss4", "variational", "dop853"])
def test_neither_do_forces_work_and_momenta(arm: sd.Model, method: str) -> None:
    """``external_torque`` takes two calls."""

    def push(t: float, q: Any, v: Any) -> Any:
        return sd.wrench_at(arm, q, tip(arm), [0.0, 1.0, 0.0, 0.0, 0.0, 0.0])

    run = sd.simulate(arm, [0.1, 0.4], [0.0, 0.0], 5 * DT, DT, method, torque=lambda t, q, v: -v, fext=push)
    other = sd.simulate(arm, [0.1, 0.4], [0.0, 0.0], 5 * DT, DT, "rk4", torque=lambda t, q, v: -v, fext=push)
    assert abs(run.v - other.v).max() <= 1e-4 * abs(other.v).max()  # of order 2, in five steps


@COMPILED
def test_a_long_run_beyond_a_programs_range_compiles_its_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """After as many steps as take some seconds: fewer for longer robots."""
    made: list[int] = []

    def compile_loop(*parts: Any) -> Any:
        def loop(*passed: Any) -> None:
            made.append(passed[-10])
            raise KeyboardInterrupt

        return loop

    monkeypatch.setattr(fixed_steps, "compile_loop", compile_loop)
    monkeypatch.setattr(fixed_steps, "PLAIN_ROWS", 3 * 30)  # of three rows
    model = sd.load_urdf("two_link")
    with pytest.raises(KeyboardInterrupt):
        sd.simulate(model, [FAR, 0.4], [0.0, 0.0], 0.1, DT, "semi_implicit_euler")
    assert made == [30]


def test_a_body_that_turns_too_far_in_a_step_is_named() -> None:
    """In steps of Runge and Kutta, whose displacement has no rate at a whole turn."""
    model, _ = box()
    v = np.zeros(model.nv)
    v[3] = 80.0
    with pytest.raises(sd.SimulationError, match=r"a body turns too far in the step at t = .* for rk4; try dt = 0.025"):
        sd.simulate(model, sd.neutral(model), v, 0.2, 0.1, "rk4", torque=lambda t, q, v: np.zeros(model.nv))


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_steps_below_the_resolution_of_time_end_an_adaptive_run(method: str) -> None:
    pytest.importorskip("scipy")
    with pytest.raises(sd.SimulationError, match=rf"{method} .*"):
        sd.simulate(sd.load_urdf("two_link"), [0.1, 0.2], [1e30, 1e30], 1.0, DT, method)
