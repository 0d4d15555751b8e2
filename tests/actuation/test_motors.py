"""Torque-speed lines of motors: by hand, by the power that a current carries, at the limits, in every engine."""

from __future__ import annotations

import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.numbers.multiprecision import arithmetic, numbers
from spatialdyn.engines.programs.record.tracer import evaluate, table
from spatialdyn.recursions.joints.motors import MOTOR_LIMITS

K, R, V, N = 0.0302, 0.611, 24.0, 50.0  # of a motor of 90 W


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


def motor(**changes: Any) -> sd.Motor:
    return sd.Motor(**{"torque_constant": [K, K], "resistance": R, "voltage": V, "ratio": N, **changes})


def test_the_line_falls_from_the_stall_torque_to_zero_at_no_load(arm: sd.Model) -> None:
    m = motor()
    stall, free = N * K * V / R, V / (K * N)
    np.testing.assert_allclose(m.stall_torque, stall, rtol=1e-15)
    np.testing.assert_allclose(m.no_load_speed, free, rtol=1e-15)
    for part in (0.0, 0.25, 0.5, 1.0, 1.25):
        lower, upper = sd.torque_limits(arm, [part * free, -part * free], m)
        np.testing.assert_allclose(upper, [stall * (1.0 - part), stall * (1.0 + part)], rtol=1e-14, atol=1e-13)
        np.testing.assert_allclose(lower, [-stall * (1.0 + part), -stall * (1.0 - part)], rtol=1e-14, atol=1e-13)


def test_the_slope_of_the_line_is_the_motors_damping(arm: sd.Model) -> None:
    m = motor(back_emf=1.1 * K)
    v = np.random.default_rng(0).normal(size=(7, 2))
    rest, moving = sd.torque_limits(arm, np.zeros(2), m)[1], sd.torque_limits(arm, v, m)[1]
    np.testing.assert_allclose(moving, rest - m.damping * v, rtol=1e-13)
    np.testing.assert_allclose(m.damping, N**2 * K * 1.1 * K / R, rtol=1e-15)


@pytest.mark.parametrize("efficiency", [1.0, 0.7])
def test_power_at_the_limits_is_that_of_the_current_and_the_gears_part(arm: sd.Model, efficiency: float) -> None:
    """V i = R i² + τ_m θ̇; the joint gets η of τ_m θ̇ where the motor drives, and gives 1/η of it where it brakes."""
    m = motor(efficiency=efficiency)
    v = np.linspace(-20.0, 20.0, 41)[:, None] * np.ones(2)
    for torque, voltage in zip(sd.torque_limits(arm, v, m), (-V, V), strict=True):
        current = (voltage - K * N * v) / R
        mechanical = voltage * current - R * current**2
        passed = np.where(mechanical >= 0.0, efficiency, 1.0 / efficiency)
        np.testing.assert_allclose(torque * v, passed * mechanical, rtol=1e-12, atol=1e-11)


def test_current_is_limited_before_the_gear_and_torque_behind_it(arm: sd.Model) -> None:
    v, flat = [[0.0, 0.0], [-10.0, 10.0]], N * K * 5.0
    lower, upper = sd.torque_limits(arm, v, motor(current=5.0, efficiency=0.8))
    np.testing.assert_allclose(upper[:, 0], [0.8 * flat, flat / 0.8], rtol=1e-14)  # drives at rest, brakes
    np.testing.assert_allclose(lower[:, 1], [-0.8 * flat, -flat / 0.8], rtol=1e-14)
    lower, upper = sd.torque_limits(arm, v, motor(current=5.0, efficiency=0.8, torque=7.0))
    np.testing.assert_allclose(upper[:, 0], [0.8 * flat, 7.0], rtol=1e-14)
    np.testing.assert_allclose(motor(current=5.0).stall_torque, flat, rtol=1e-14)
    assert (lower <= upper).all()


def test_beyond_the_no_load_speed_a_motor_can_only_brake(arm: sd.Model) -> None:
    fast = 1.5 * motor().no_load_speed
    assert (sd.torque_limits(arm, fast, motor())[1] < 0.0).all()
    assert (sd.torque_limits(arm, -fast, motor())[0] > 0.0).all()


def test_a_shorted_motor_brakes_as_its_damping_does(arm: sd.Model) -> None:
    """At 0 V both lines are -damping v, the viscous torque of a Friction."""
    m, v = motor(voltage=1e-12), np.array([0.7, -0.3])
    np.testing.assert_allclose(sd.torque_limits(arm, v, m)[1], -m.damping * v, rtol=1e-9)
    np.testing.assert_allclose(sd.friction_torque(arm, v, sd.Friction(0.0, m.damping)), -m.damping * v, rtol=1e-15)


def test_a_freedom_without_a_motor_has_no_torque(arm: sd.Model) -> None:
    m = motor(torque_constant=[0.0, K])
    lower, upper = sd.torque_limits(arm, [3.0, 0.0], m)
    assert lower[0] == upper[0] == 0.0
    assert m.no_load_speed[0] == np.inf
    assert upper[1] == pytest.approx(N * K * V / R)


def test_the_turns_of_the_gear_may_have_either_sign(arm: sd.Model) -> None:
    v = [[1.0, 2.0], [-3.0, 0.5]]
    for one, other in zip(sd.torque_limits(arm, v, motor(ratio=-N)), sd.torque_limits(arm, v, motor()), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_exact_engine_agrees(arm: sd.Model) -> None:
    m, v = motor(current=30.0, efficiency=0.75, torque=40.0), np.array([3.0, -9.0])
    gain, digits = N * K, arithmetic(100)
    ones = np.ones(2)
    given = {
        "v": v, "stall": gain * V / R * ones, "damping": m.damping, "most": gain * 30.0 * ones,
        "efficiency": 0.75 * ones, "limit": 40.0 * ones,
    }  # fmt: skip
    exact = {k: numbers(digits, x) for k, x in given.items()}
    found = evaluate(variant(MOTOR_LIMITS, set()), table(arm.bodies, digits.number), (2, 2), exact, None)
    np.testing.assert_allclose(np.array(found, float), sd.torque_limits(arm, v, m), rtol=1e-14)


def test_motors_are_compared_by_content() -> None:
    assert motor() == motor(torque_constant=K, resistance=[R, R])
    assert hash(motor()) == hash(motor(efficiency=1.0))
    assert motor() != motor(current=1.0)
    assert pickle.loads(pickle.dumps(motor(current=2.0))) == motor(current=2.0)
    assert repr(motor()).startswith("<Motor of 2 freedoms: stall torque [59.31")
    with pytest.raises(ValueError, match="read-only"):
        motor().ratio[0] = 2.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"resistance": [0.0, 1.0]}, "freedom 0: resistance is 0, expected a finite number above 0"),
        ({"voltage": [1.0, -1.0]}, "freedom 1: voltage is -1"),
        ({"ratio": [1.0, 0.0]}, "freedom 1: ratio is 0, expected a finite number other than 0"),
        ({"efficiency": 1.2}, r"freedom 0: efficiency is 1\.2, expected a number above 0, at most 1"),
        ({"current": 0.0}, "freedom 0: current is 0, expected a number above 0"),
        ({"torque_constant": [K, np.nan]}, "freedom 1: torque constant is nan"),
    ],
)
def test_the_refusal_names_freedom_value_and_what_was_expected(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(sd.ModelError, match=words):
        motor(**changes)


@pytest.mark.parametrize(
    ("field", "bad", "good"),
    [
        ("torque_constant", (-1.0, np.inf), (0.0, 1.0)),
        ("resistance", (-1.0, 0.0, np.inf), (1e-3,)),
        ("voltage", (-1.0, 0.0, np.inf), (1e-3,)),
        ("ratio", (0.0, np.inf, -np.inf), (-50.0, 1e-3)),
        ("back_emf", (-1.0, np.inf), (0.0, 1.0)),
        ("current", (-1.0, 0.0), (1e-3, np.inf)),
        ("torque", (-1.0, 0.0), (1e-3, np.inf)),
        ("efficiency", (-1.0, 0.0, 1.001, np.inf), (1e-3, 1.0)),
    ],
)
def test_each_value_has_a_range(field: str, bad: tuple[float, ...], good: tuple[float, ...]) -> None:
    for x in (*bad, np.nan):
        with pytest.raises(sd.ModelError, match=f"freedom 1: {field.replace('_', ' ')} is {x:g}"):
            motor(**{field: [good[0], x]})
    for x in good:
        assert getattr(motor(**{field: x}), field)[0] == x


def test_every_value_of_a_motor_is_here() -> None:
    (mark,) = test_each_value_has_a_range.pytestmark  # type: ignore[attr-defined]
    assert [row[0] for row in mark.args[1]] == [x.name for x in dataclasses.fields(sd.Motor)]


def test_one_motor_is_that_of_every_joint(arm: sd.Model) -> None:
    np.testing.assert_array_equal(
        sd.torque_limits(arm, [1.0, -2.0], sd.Motor(K, R, V)),
        sd.torque_limits(arm, [1.0, -2.0], sd.Motor([K, K], R, V)),
    )
    run = [
        sd.simulate(sd.Scene(arm, motor=sd.Motor(k, R, V)), [0, 0], [0, 0], 0.02, 1e-3, torque=[1, 2]).q
        for k in (K, [K, K])
    ]
    np.testing.assert_array_equal(*run)


def test_what_does_not_fit_is_refused(arm: sd.Model) -> None:
    with pytest.raises(sd.ShapeError, match=r"torque_constant \(2,\), resistance \(3,\)"):
        motor(resistance=[1.0, 1.0, 1.0])
    with pytest.raises(sd.ShapeError, match="motor has 3 freedoms, expected the 2"):
        sd.torque_limits(arm, [0.0, 0.0], sd.Motor([K, K, K], R, V))
    with pytest.raises(sd.ModelError, match="motor is None, expected a Motor"):
        sd.torque_limits(arm, [0.0, 0.0], None)  # type: ignore[arg-type]
    with pytest.raises(sd.ShapeError, match=r"v has shape \(3,\)"):
        sd.torque_limits(arm, [0.0, 0.0, 0.0], motor())
