"""Monitors of passivity and of Lyapunov functions: what holds holds, what does not is found, and plotted."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn as sd


def motion(dt: float, record: str | None = "work") -> sd.Trajectory:
    """An arm under a torque of time, with viscous friction."""
    scene = sd.Scene(
        sd.load_urdf("two_link"),
        friction=sd.Friction(viscous=[0.5, 0.5], smoothing=[0.1, 0.1]),
        friction_method="smooth",
    )
    return sd.simulate(scene, [0.5, -0.3], [0.0, 0.0], 2.0, dt, "rk4", torque=[1.0, 0.5], record=record)


def test_an_arm_is_passive_and_friction_is_what_it_dissipates() -> None:
    run = motion(0.01)
    found = sd.passivity(run)
    assert found.worst < 1e-8
    friction = sd.energy_ledger(run).work["friction"].sum(1)
    assert abs(found.dissipated + friction).max() <= found.error * (1.0 + 1e-9)  # what the method misses
    assert repr(found).startswith("<PassivityRecord: largest excess")


def test_the_excess_of_a_passive_robot_is_the_methods_error_of_its_order() -> None:
    model = sd.load_urdf("two_link")
    found = []
    for dt in (0.02, 0.01):
        run = sd.simulate(model, [0.5, -0.3], [0.0, 0.0], 2.0, dt, "rk4", torque=[1.0, 0.5], record="work")
        found.append(sd.passivity(run))
        assert found[-1].worst <= found[-1].error + 1e-13
    assert found[0].order(found[1]) > 3.0
    # the trapezoidal rule on samples, which is what one would do by hand, is of order 2 and worse
    run = sd.simulate(model, [0.5, -0.3], [0.0, 0.0], 2.0, 0.02, "rk4", torque=[1.0, 0.5])
    power = run.v @ [1.0, 0.5]
    by_hand = np.concatenate([[0.0], np.cumsum(0.01 * (power[1:] + power[:-1]))])
    assert abs(run.energy - run.energy[0] - by_hand).max() > 10.0 * found[0].error


def test_a_storage_that_grows_by_itself_is_found() -> None:
    run = motion(0.01)
    found = sd.passivity(run, storage=lambda t, q, v: 5.0 * t)
    assert found.worst > 1.0
    assert found.at > 0.5


def test_a_function_that_falls_falls_and_one_that_rises_is_named() -> None:
    model = sd.load_urdf("two_link")
    law = sd.PDGravity(20.0, 5.0, [0.5, 0.2])
    run = sd.simulate(model, [0.0, 0.0], [0.0, 0.0], 2.0, 1e-2, control=law)

    def V(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        e = [0.5, 0.2] - q
        return np.asarray(sd.kinetic_energy(model, q, v) + 10.0 * (e * e).sum(1))

    assert sd.lyapunov(run, V).falls
    kinetic = sd.lyapunov(run, sd.kinetic_energy(model, run.q, run.v))
    assert kinetic.first == run.t[1]
    assert kinetic.rise > 0.0
    assert "rises first at t = 0.01 s" in repr(kinetic)


def test_monitors_are_drawn_and_refuse_what_is_no_motion() -> None:
    run = motion(0.01)
    assert len(sd.passivity(run).plot().axes) == 2
    assert len(sd.lyapunov(run, run.energy - run.energy.min() + 1.0).plot().axes) == 2
    with pytest.raises(sd.SimulationError, match="has no work"):
        sd.passivity(motion(0.01, None))
    with pytest.raises(sd.ShapeError, match=r"V has shape \(3,\)"):
        sd.lyapunov(run, np.zeros(3))
    with pytest.raises(sd.NonFiniteError, match="V has values"):
        sd.lyapunov(run, np.full(len(run.t), np.nan))
    with pytest.raises(sd.SimulationError, match="run is a int"):
        sd.lyapunov(3, 0.0)  # type: ignore[arg-type]


def test_an_order_is_of_another_record() -> None:
    with pytest.raises(sd.SimulationError, match="other is None, expected a PassivityRecord"):
        sd.passivity(motion(0.01)).order(None)  # type: ignore[arg-type]
