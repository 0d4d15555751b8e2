"""Motors in simulations: their gears' losses by hand, their own voltage as damping, their limits, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scenes
from slow import slow_but

import spatialdyn as sd

MASS, G = 2.0, 9.81
LOAD = MASS * G
METHOD = "semi_implicit_euler"


@pytest.fixture(scope="module")
def lift() -> sd.Model:
    """A mass on a vertical slide."""
    b = sd.ModelBuilder("lift").add_body("cage", joint="prismatic", inertia=(MASS, (0, 0, 0), np.eye(3)))
    return b.build()


def motor(**changes: Any) -> sd.Motor:
    """No-load speed 0.5 m/s, stall force 1000 N, damping 2000 N s/m."""
    given = {"torque_constant": [0.1], "resistance": 1.0, "voltage": 50.0, "ratio": 200.0}
    return sd.Motor(**{**given, "back_emf": 0.5, **changes})


def step(model: sd.Model, force: float, v0: float = 0.0, h: float = 1e-4, **named: Any) -> float:
    """Mean force at the joint over one step, its weight counted."""
    run = scenes.rollout(model, [0.0], [v0], [force], dt=h, steps=1, **named)
    return float(MASS * (run.v[0, 0] - v0) / h + LOAD)


@pytest.mark.parametrize("efficiency", [0.9, 0.5, 0.2])
def test_a_gear_passes_its_part_of_a_load_that_it_lifts_and_more_of_one_that_it_lowers(
    lift: sd.Model, efficiency: float
) -> None:
    m = motor(efficiency=efficiency)
    up, down = 1.5 * LOAD / efficiency, 0.5 * LOAD * efficiency
    assert step(lift, up, motor=m) == pytest.approx(efficiency * up, rel=1e-9)
    assert step(lift, down, motor=m) == pytest.approx(down / efficiency, rel=1e-9)


def test_a_gear_holds_what_is_between_to_the_bit(lift: sd.Model) -> None:
    m = motor(efficiency=0.5)
    for force in (0.55 * LOAD, LOAD, 1.9 * LOAD):
        run = sd.rollout(sd.Scene(lift, motor=m), [0.0], [0.0], [force], dt=1e-2, steps=50)
        assert (run.v == 0.0).all()
        assert (run.q == 0.0).all()
    assert (sd.rollout(sd.Scene(lift, motor=m), [0.0], [0.0], [2.1 * LOAD], dt=1e-2, steps=2).v > 0.0).all()
    assert (sd.rollout(sd.Scene(lift, motor=m), [0.0], [0.0], [0.45 * LOAD], dt=1e-2, steps=2).v < 0.0).all()


def test_a_voltage_drives_a_load_to_the_speed_where_its_own_voltage_leaves_the_load(lift: sd.Model) -> None:
    """u - k_e n v drives the current of the load: η (push - b v) = load, at any step."""
    m = motor(efficiency=0.8)
    for h in (1e-3, 0.1):  # h b / mass is 1, then 100
        run = sd.rollout(sd.Scene(lift, motor=m, drive="voltage"), [0.0], [0.0], [500.0], dt=h, steps=200)
        assert run.v[-1, 0] == pytest.approx((500.0 - LOAD / 0.8) / 2000.0, rel=1e-9)


def test_without_losses_a_voltage_is_implicit_damping(lift: sd.Model) -> None:
    m, h, push = motor(), 1e-3, 300.0
    run = sd.rollout(sd.Scene(lift, motor=m, drive="voltage"), [0.0], [0.0], [push], dt=h, steps=5)
    v = 0.0
    for k in range(5):
        v = (v + h * (push - LOAD) / MASS) / (1.0 + h * m.damping[0] / MASS)
        assert run.v[k, 0] == pytest.approx(v, rel=1e-12)


@pytest.mark.parametrize("v0", [0.3, -0.3, 0.6, -0.6])
@pytest.mark.parametrize("changes", [{}, {"current": 10.0}, {"torque": 150.0}, {"efficiency": 0.7, "torque": 200.0}])
def test_more_than_a_motor_can_gives_what_torque_limits_says(
    lift: sd.Model, v0: float, changes: dict[str, Any]
) -> None:
    m = motor(**changes)
    lower, upper = sd.torque_limits(lift, [v0], m)
    for force, limit in ((1e5, upper), (-1e5, lower)):
        assert step(lift, force, v0, 1e-9, motor=m) == pytest.approx(limit[0], rel=1e-5)


def test_a_wanted_current_within_the_limits_is_given(lift: sd.Model) -> None:
    for v0 in (0.2, -0.2, 0.0):
        assert step(lift, 35.0, v0, motor=motor()) == pytest.approx(35.0, rel=1e-9)


def test_the_power_that_a_gear_loses_is_its_part_of_what_it_passes(lift: sd.Model) -> None:
    """At steady speed the joint gets η of the motor's power where it lifts; where it lowers, the motor gets η of it."""
    m = motor(efficiency=0.6)
    for force in (500.0, -500.0):
        v = sd.rollout(sd.Scene(lift, motor=m, drive="voltage"), [0.0], [0.0], [force], dt=1e-2, steps=300).v[-1, 0]
        of_motor, of_load = (force - 2000.0 * v) * v, LOAD * v
        assert (v > 0.0) == (force > 0.0)
        given, got = (of_motor, of_load) if v > 0.0 else (-of_load, -of_motor)
        assert got == pytest.approx(0.6 * given, rel=1e-9)


@pytest.mark.parametrize("drive", slow_but(["current"], ["current", "voltage"]))
def test_simulate_and_a_torque_function_take_the_same_steps(drive: str) -> None:
    model = sd.load_urdf("two_link")
    m = sd.Motor([0.03, 0.05], 0.6, 24.0, 30.0, current=20.0, efficiency=0.7)
    q0, v0, tau = np.array([0.4, -0.8]), np.array([1.0, -2.0]), np.array([3.0, -1.0])
    own: dict[str, Any] = {"motor": m, "drive": drive, "friction": sd.Friction([0.1, 0.1], 0.05)}
    run = scenes.simulate(model, q0, v0, 0.05, 1e-3, METHOD, tau, **own)
    again = scenes.simulate(model, q0, v0, 0.05, 1e-3, METHOD, lambda t, q, v: tau, **own)
    many = scenes.rollout(model, [q0, q0], v0, tau, dt=1e-3, steps=50, **own)
    np.testing.assert_allclose(again.v, run.v, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(many.v[1], run.v[1:], rtol=1e-11, atol=1e-12)
    np.testing.assert_array_equal(run.tau[1:], np.broadcast_to(tau, run.tau[1:].shape))


@pytest.mark.parametrize("user", [False, True])
def test_the_ledger_counts_what_gears_and_windings_take(lift: sd.Model, user: bool) -> None:
    """The torque wanted does the work of the command; losses of gear and winding are friction's."""
    m, force = motor(efficiency=0.7), np.array([100.0])
    torque: Any = (lambda t, q, v: force) if user else force
    own: dict[str, Any] = {"motor": m, "drive": "voltage", "record": "work"}
    run = scenes.simulate(lift, [0.0], [0.0], 0.5, 1e-3, METHOD, torque, **own)
    ledger = sd.energy_ledger(run)
    np.testing.assert_allclose(ledger.work["torque"][-1], force * (run.q[-1] - run.q[0]), rtol=0.01)
    assert ledger.work["friction"][-1, 0] < 0.0
    # the weight falls back by ½ h v of semi-implicit Euler: the rest is exact
    assert abs(ledger.error).max() < 2.0 * 1e-3 * LOAD * abs(run.v).max()


def test_a_motor_on_a_rotor_drives_a_joint_through_its_spring() -> None:
    """The gear's loss is between motor and rotor; the passive joint, without a motor, feels the spring alone."""
    b = sd.ModelBuilder("sea").add_body("link", inertia=(1.0, (0, 0, 0), 0.2 * np.eye(3)), joint_name="joint")
    model = b.add_series_elastic("joint", 300.0, 2.0, 1e-4, 50.0).build()
    m = sd.Motor([0.0, 0.03], 0.6, 24.0, efficiency=0.8)
    q, v = sd.rollout(sd.Scene(model, motor=m), [0.1, 0.0], [0.0, 0.0], [0.0, 0.2], dt=1e-4, steps=1)
    pull = sd.spring_torque(model, [0.1, 0.0], [0.0, 0.0])
    np.testing.assert_allclose(v[0], 1e-4 * (pull + np.array([0.0, 0.8 * 0.2])) / [0.2, 1e-4], rtol=1e-10)
    np.testing.assert_allclose(q[0], [0.1, 0.0] + 1e-4 * v[0], rtol=1e-12)


def test_motors_are_refused_where_they_cannot_act(lift: sd.Model) -> None:
    with pytest.raises(sd.SimulationError, match='method is "rk4" and motor acts, expected semi_implicit_euler'):
        sd.simulate(sd.Scene(lift, motor=motor()), [0.0], [0.0], 1.0, 0.1, "rk4")
    with pytest.raises(sd.SimulationError, match='friction_method is "lugre"'):
        sd.rollout(sd.Scene(lift, motor=motor(), friction_method="lugre"), [0.0], [0.0], dt=0.1, steps=1)
    with pytest.raises(sd.SimulationError, match="drive is 'torque', expected one of current, voltage"):
        sd.rollout(sd.Scene(lift, motor=motor(), drive="torque"), [0.0], [0.0], dt=0.1, steps=1)
    with pytest.raises(sd.SimulationError, match='drive is "voltage" and no motor is given, expected motor='):
        sd.simulate(sd.Scene(lift, drive="voltage"), [0.0], [0.0], 1.0, 0.1, "semi_implicit_euler")
    with pytest.raises(sd.ModelError, match="motor is 3, expected a Motor"):
        sd.rollout(sd.Scene(lift, motor=3), [0.0], [0.0], dt=0.1, steps=1)  # type: ignore[arg-type]
    with pytest.raises(sd.ModelError, match="motor: efficiency is 2"):
        sd.rollout(sd.Scene(lift, motor=motor(efficiency=2.0)), [0.0], [0.0], dt=0.1, steps=1)


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_float32_takes_motors_without_limits_on_lanes(drive: str) -> None:
    """Their largest current is a finite number there too: lanes leave no sample to steps in float64."""
    model = sd.load_urdf("two_link")
    motor = sd.Motor(0.05, 1.0, 24.0, 20.0, efficiency=0.8)
    assert all(np.isfinite(x.astype(np.float32)).all() for x in motor.lines)
    scene = sd.Scene(model, motor=motor, drive=drive, friction=sd.Friction(0.1, 0.05))
    q = np.random.default_rng(0).normal(size=(5, 2))
    wanted, found = (sd.rollout(scene, q, [0.1, 0.2], dt=1e-3, steps=20, dtype=x) for x in (np.float64, np.float32))
    assert 0.0 < abs(found.v - wanted.v).max() < 1e-5
