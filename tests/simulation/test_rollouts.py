"""rollout: the methods of simulate, traced, many states at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scenes
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.simulation.methods.methods import EXPLICIT_METHODS

EPS = np.finfo(float).eps
SAME = 1e3 * EPS  # a few dozen steps of rounding in another order, scaled
SINGLE = 1e-4  # float32 over thirty steps of a stiff arm


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("three_link")


def states(model: sd.Model, B: int, seed: int = 1) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    return sd.random_configuration(model, rng, (B,)), 0.3 * rng.standard_normal((B, model.nv))


def scaled(x: Any, y: Any) -> float:
    return float(abs(np.asarray(x) - y).max() / max(1.0, abs(np.asarray(y)).max()))


# --- the same as simulate -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "root"),
    slow_but(
        [("semi_implicit_euler", "floating, cos_sin"), ("rk4", "fixed")],
        [(method, root) for method in EXPLICIT_METHODS for root in ("fixed", "floating, cos_sin")],
    ),
)
def test_a_rollout_is_so_many_simulations(method: str, root: str) -> None:
    floating = root != "fixed"
    continuous = "cos_sin" if floating else "angle"
    model = random_tree(108, 6, floating=floating, continuous=continuous).model  # every kind of joint
    q0, v0 = states(model, 3)
    tau = np.random.default_rng(2).standard_normal((3, 12, model.nv))
    found = sd.rollout(model, q0, v0, tau, dt=2e-3, method=method)
    assert found.q.shape == (3, 12, model.nq)
    assert found.v.shape == (3, 12, model.nv)
    for k in range(3):
        wanted = sd.simulate(model, q0[k], v0[k], 12 * 2e-3, 2e-3, method=method, torque=tau[k])
        assert scaled(found.q[k], wanted.q[1:]) <= SAME
        assert scaled(found.v[k], wanted.v[1:]) <= SAME


def test_a_law_is_held_over_the_step_it_begins(arm: sd.Model) -> None:
    q0, v0 = states(arm, 5)
    rng = np.random.default_rng(3)
    kp, kd, extra = np.array([30.0, 20.0, 10.0]), np.array([3.0, 2.0, 1.0]), rng.standard_normal((20, 3))
    q_ref, v_ref = rng.standard_normal((5, 20, 3)), rng.standard_normal((20, 3))
    found = sd.rollout(arm, q0, v0, extra, dt=5e-3, control=sd.PD(kp, kd, q_ref, v_ref))
    q, v = q0, v0
    for k in range(20):
        tau = kp * (q_ref[:, k] - q) + kd * (v_ref[k] - v) + extra[k]
        v = v + 5e-3 * sd.aba(arm, q, v, tau)
        q = q + 5e-3 * v
        assert scaled(found.q[:, k], q) <= SAME
        assert scaled(found.v[:, k], v) <= SAME


def test_gains_of_a_floating_robots_joints_leave_its_base_alone() -> None:
    model = random_tree(5, 3, ["revolute"], floating=True).model.with_(gravity=(0.0, 0.0, 0.0))
    kp = np.r_[np.zeros(6), np.full(model.nv - 6, 20.0)]
    q_ref = sd.neutral(model) + np.r_[np.zeros(7), np.linspace(-0.4, 0.4, model.nv - 6)]
    law = sd.PD(kp, kp / 5.0, q_ref)
    q, v = sd.rollout(model, sd.neutral(model), np.zeros(model.nv), dt=1e-3, steps=400, control=law)
    momentum = sd.centroidal_momentum(model, q[-1], v[-1])
    assert abs(q[-1, 7:]).max() > 0.1
    assert abs(momentum).max() <= 1e-3 * model.total_mass  # internal torques move none, but for Euler's O(dt)


def test_a_joint_without_inertia_is_named() -> None:
    model = sd.load_urdf("three_link", root="floating")
    with pytest.raises(sd.InertiaError, match="has zero articulated inertia"):
        sd.rollout(model, sd.neutral(model), np.zeros(9), dt=1e-3, steps=4)


@pytest.mark.parametrize("record", [1, 3, "last"])
def test_records_are_the_states_after_so_many_steps(arm: sd.Model, record: Any) -> None:
    q0, v0 = states(arm, 9)
    every = sd.rollout(arm, q0, v0, dt=1e-2, steps=10)
    found = sd.rollout(arm, q0, v0, dt=1e-2, steps=10, record=record)
    chosen = every.q[:, -1] if record == "last" else every.q[:, record - 1 :: record]
    np.testing.assert_array_equal(found.q, chosen)


@pytest.mark.parametrize("steps", [4, np.int64(4), np.uint8(4), 4.0, np.array(4)])
def test_a_number_of_steps_is_any_whole_number(arm: sd.Model, steps: Any) -> None:
    assert sd.rollout(arm, np.zeros(3), np.zeros(3), dt=1e-3, steps=steps).q.shape == (4, 3)


@pytest.mark.parametrize("B", [0, 2])
def test_no_steps_leave_the_first_state_as_the_last(arm: sd.Model, B: int) -> None:
    q0, v0 = states(arm, B)
    assert sd.rollout(arm, q0, v0, dt=1e-3, steps=0).q.shape == (B, 0, 3)
    last = sd.rollout(arm, q0, v0, dt=1e-3, steps=0, record="last")
    np.testing.assert_array_equal(last.q, q0)
    np.testing.assert_array_equal(last.v, v0)
    assert not np.shares_memory(last.q, q0)


@pytest.mark.parametrize("B", [0, 1, 2, 7, 8, 9, 16, 17])
def test_every_number_of_samples_gives_each_its_own_bits(arm: sd.Model, B: int) -> None:
    q0, v0 = states(arm, 17)
    tau = np.random.default_rng(4).standard_normal((17, 6, 3))
    wanted = sd.rollout(arm, q0, v0, tau, dt=1e-2)
    found = sd.rollout(arm, q0[:B], v0[:B], tau[:B], dt=1e-2)
    np.testing.assert_array_equal(found.q, wanted.q[:B])
    np.testing.assert_array_equal(found.v, wanted.v[:B])


def test_one_state_may_serve_all_and_one_sample_has_no_axis(arm: sd.Model) -> None:
    tau = np.random.default_rng(5).standard_normal((4, 6, 3))
    q0, v0 = np.array([0.1, 0.2, 0.3]), np.zeros(3)
    many = sd.rollout(arm, q0, v0, tau, dt=1e-2)
    assert many.q.shape == (4, 6, 3)
    one = sd.rollout(arm, q0, v0, tau[2], dt=1e-2)
    assert one.q.shape == (6, 3)
    np.testing.assert_array_equal(one.q, many.q[2])


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no lanes")
def test_threads_do_not_change_a_bit(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    q0, v0 = states(arm, 1001)
    wanted = sd.rollout(arm, q0, v0, dt=1e-3, steps=300, record="last")
    monkeypatch.setattr(batch_kernels, "THREAD_BYTES", 1)
    try:
        sd.set_num_threads(3)
        found = sd.rollout(arm, q0, v0, dt=1e-3, steps=300, record="last")
    finally:
        sd.set_num_threads(1)
    np.testing.assert_array_equal(found.q, wanted.q)


def test_float32_follows_float64(arm: sd.Model) -> None:
    q0, v0 = states(arm, 9)
    wanted = sd.rollout(arm, q0, v0, dt=1e-3, steps=30)
    found = sd.rollout(arm, q0, v0, dt=1e-3, steps=30, dtype=np.float32)
    assert found.q.dtype == np.float32
    assert scaled(found.q, wanted.q) <= SINGLE


def test_a_long_program_runs_all_the_same(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    q0, v0 = states(arm, 3)
    wanted = sd.rollout(arm, q0, v0, dt=1e-3, steps=5)
    monkeypatch.setattr(recording, "most_rows", lambda spec: 1)
    assert scaled(sd.rollout(arm, q0, v0, dt=1e-3, steps=5).q, wanted.q) <= SAME


# --- samples the lanes leave ----------------------------------------------------------------------------


def test_angles_beyond_the_short_sine_are_right_and_disturb_no_other(arm: sd.Model) -> None:
    q0, v0 = states(arm, 11)
    wanted = sd.rollout(arm, q0, v0, dt=1e-3, steps=8)
    far = q0.copy()
    far[4, 0] += 2.0 * np.pi * 2**20
    found = sd.rollout(arm, far, v0, dt=1e-3, steps=8)
    others = np.arange(11) != 4
    np.testing.assert_array_equal(found.q[others], wanted.q[others])
    assert scaled(found.v[4], wanted.v[4]) <= 1e-6  # an angle of 7e6 has lost ten digits


def test_a_state_that_blows_up_is_named_or_nan(arm: sd.Model) -> None:
    q0, v0 = states(arm, 10)
    v0[7] = 1e160
    with pytest.raises(
        sd.SimulationError, match=r"sample 7: semi_implicit_euler diverged at t = 0 s: the state is not finite"
    ):
        sd.rollout(arm, q0, v0, dt=1e-2, steps=5)
    found = sd.rollout(arm, q0, v0, dt=1e-2, steps=5, check=False)
    assert np.isnan(found.v[7]).any()
    others = np.arange(10) != 7
    np.testing.assert_array_equal(found.q[others], sd.rollout(arm, q0[others], v0[others], dt=1e-2, steps=5).q)


# --- refusals -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"dt": 0.0}, sd.SimulationError, "dt is 0.0"),
        ({"dt": float("nan")}, sd.SimulationError, "dt is nan"),
        ({"method": "gauss5"}, sd.SpatialDynError, "method is 'gauss5', expected one of explicit_euler"),
        ({"dtype": np.int32}, sd.SimulationError, "dtype is 'int32'"),
        ({"steps": None}, sd.SimulationError, "steps is None"),
        ({"steps": -1}, sd.SimulationError, "steps is -1"),
        ({"steps": 2.5}, sd.SimulationError, "steps is 2.5"),
        ({"steps": float("nan")}, sd.SimulationError, "steps is nan"),
        ({"steps": float("inf")}, sd.SimulationError, "steps is inf"),
        ({"steps": [5]}, sd.SimulationError, r"steps is \[5\]"),
        ({"dt": "1e-3"}, sd.SimulationError, "dt is '1e-3'"),
        ({"dt": True}, sd.SimulationError, "dt is True"),
        ({"method": ["rk4"]}, sd.SpatialDynError, r"method is \['rk4'\]"),
        ({"dtype": "double precision"}, sd.SimulationError, "dtype is 'double precision'"),
        ({"control": (1.0, 2.0)}, sd.SimulationError, "control is \\(1.0, 2.0\\), expected a Control"),
        ({"record": 0}, sd.SimulationError, "record is 0"),
        ({"tau": np.zeros((7, 3))}, sd.ShapeError, "numbers of steps differ: tau 7, argument steps 5, expected one"),
        ({"tau": np.zeros((4, 5, 3))}, sd.ShapeError, r"q0 \(3,\), v0 \(3,\), tau \(4,\)"),
        ({"tau": np.zeros(2)}, sd.ShapeError, r"tau has shape \(2,\)"),
        ({"q0": np.zeros((3, 2))}, sd.ShapeError, r"q0 has shape \(3, 2\)"),
        ({"v0": np.zeros((2, 3))}, sd.ShapeError, r"q0 \(3,\), v0 \(2,\)"),
    ],
)
def test_bad_input_is_named(arm: sd.Model, changes: dict[str, Any], error: type[Exception], words: str) -> None:
    given: dict[str, Any] = {"q0": np.zeros((3, 3)), "v0": np.zeros((3, 3)), "dt": 1e-3, "steps": 5, **changes}
    with pytest.raises(error, match=words):
        scenes.rollout(arm, given.pop("q0"), given.pop("v0"), given.pop("tau", None), **given)


def test_quaternions_of_every_sample_have_to_be_of_unit_norm() -> None:
    model = sd.load_urdf("floating_body", root="floating")
    q0 = np.tile(sd.neutral(model), (3, 1))
    q0[2, 3:] *= 1.5
    with pytest.raises(sd.ConfigurationError, match=r"norm 1\.5"):
        sd.rollout(model, q0, np.zeros((3, 6)), dt=1e-3, steps=2)


def test_repr_is_one_useful_line(arm: sd.Model) -> None:
    found = sd.rollout(arm, np.zeros((3, arm.nq)), np.zeros(arm.nv), dt=1e-3, steps=0)
    assert repr(found) == f"<Rollout: q (3, 0, {arm.nq}), v (3, 0, {arm.nv}), float64>"


def test_damping_and_friction_that_do_not_act_are_warned_of() -> None:
    model = sd.load_urdf("tree")
    start = (model, sd.neutral(model), np.zeros(model.nv))
    words = 'robot "tree" has joint damping or friction, which rollout ignores unless friction=True'
    with pytest.warns(UserWarning, match=words):
        sd.rollout(*start, dt=1e-3, steps=1)
    for friction in (True, False):
        scenes.rollout(*start, dt=1e-3, steps=1, friction=friction)


@pytest.mark.parametrize("steps", [2**53, 2**64 + 1, 10**5000], ids=["2^53", "2^64 + 1", "10^5000"])
def test_more_steps_than_a_compiled_loop_counts_are_refused(steps: int) -> None:
    """2^64 and more ended the process: of an int a kernel takes the low 64 bits."""
    arm = sd.load_urdf("two_link")
    for record in ("last", 2**40, 1):
        with pytest.raises(sd.SimulationError, match=r"steps is .*, expected (fewer than 2\^53|a whole number)"):
            sd.rollout(arm, np.zeros((2, 2)), np.zeros((2, 2)), dt=1e-3, steps=steps, record=record)
    with pytest.raises(sd.SimulationError, match="2 samples of 1125899906842624 states are more than memory holds"):
        sd.rollout(arm, np.zeros((2, 2)), np.zeros((2, 2)), dt=1e-3, steps=2**50)
