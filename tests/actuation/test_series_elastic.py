"""Series-elastic joints: a rotor and a spring by hand, frequencies, limits of steps, what is refused."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from plain import compiled
from slow import slow_but

import spatialdyn as sd
from spatialdyn.simulation.effects.springs import has_springs

K, D, J, N = 300.0, 0.5, 1e-4, 50.0
INERTIA = 0.2  # of the arm about its joint


def arm(damping: float = 0.0, gravity: bool = False, **changes: Any) -> sd.Model:
    """An arm on a vertical axis, or on a horizontal one where gravity acts."""
    b = sd.ModelBuilder("sea").add_body(
        "arm", None, "revolute", (0, 0, 1), inertia=(1.0, (0, 0, 0), INERTIA * np.eye(3))
    )
    given = {"stiffness": K, "damping": damping, "rotor": J, "ratio": N}
    return b.add_series_elastic("arm_joint", **{**given, **changes}).build()


def frequency() -> float:
    """√(k (1/I + 1/n²J)) of the arm against the rotor, both free."""
    return float(np.sqrt(K * (1.0 / INERTIA + 1.0 / (N * N * J))))


def test_the_spring_pulls_joint_and_rotor_together() -> None:
    model = arm(D)
    assert model.names == ("universe", "arm_joint", "arm_joint_rotor")
    q, v = np.array([0.2, 13.0]), np.array([1.0, 30.0])
    pull = K * (13.0 / N - 0.2) + D * (30.0 / N - 1.0)
    np.testing.assert_allclose(sd.spring_torque(model, q, v), [pull, -pull / N], rtol=1e-14)
    np.testing.assert_allclose(sd.spring_torque(model, q), np.array([1.0, -1.0 / N]) * K * 0.06, rtol=1e-13)
    assert sd.spring_energy(model, q) == pytest.approx(0.5 * K * 0.06**2, rel=1e-13)
    np.testing.assert_allclose(sd.crba(model, q), np.diag([INERTIA, J]), rtol=1e-15)
    assert not sd.spring_torque(sd.load_urdf("two_link"), [1.0, 2.0]).any()


def test_batches_agree_with_samples_and_the_gradient_of_the_energy() -> None:
    model = arm()
    q = np.random.default_rng(0).normal(size=(40, 2)) * [1.0, N]
    tau = sd.spring_torque(model, q)
    np.testing.assert_array_equal(tau[7], sd.spring_torque(model, q[7]))
    h = 1e-3
    for k in range(2):
        e = h * np.eye(2)[k] * [1.0, N][k]
        slope = (sd.spring_energy(model, q + e) - sd.spring_energy(model, q - e)) / (2.0 * e[k])
        np.testing.assert_allclose(-slope, tau[:, k], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("method", slow_but(["rk4"], ["rk4", "gauss4", "velocity_verlet", "dop853", "radau"]))
def test_a_free_arm_swings_against_its_rotor_at_their_common_frequency(method: str) -> None:
    model, w = arm(), frequency()
    period = 2.0 * np.pi / w
    run = sd.simulate(model, [0.1, 0.0], [0.0, 0.0], period, period / 200, method)
    np.testing.assert_allclose(run.q[-1], [0.1, 0.0], atol={"velocity_verlet": 1e-4}.get(method, 2e-6) * N)
    total = run.energy  # of springs too
    np.testing.assert_array_equal(run.spring_energy, sd.spring_energy(model, run.q))
    assert abs(total - total[0]).max() < (1e-6 if method != "velocity_verlet" else 1e-3) * total[0]
    stretch = run.q[:, 1] / N - run.q[:, 0]
    np.testing.assert_allclose(stretch, -0.1 * np.cos(w * run.t), atol=1e-5 if method != "velocity_verlet" else 1e-3)


def test_a_rotor_on_a_moving_link_has_its_momentum() -> None:
    """Spong's model leaves out n J e·α; the rotor here is a body of its own, at any ratio."""
    b = sd.ModelBuilder("two").add_body(
        "upper", None, "revolute", (0, 0, 1), inertia=(1.0, (0.2, 0, 0), 0.1 * np.eye(3))
    )
    b.add_body("lower", "upper", "revolute", (0, 0, 1), (0.4, 0, 0), inertia=(0.5, (0.1, 0, 0), 0.02 * np.eye(3)))
    model = b.add_series_elastic("lower_joint", K, D, J, N).build()
    at = [model.joint(name).idx_v for name in ("upper_joint", "lower_joint_rotor")]
    M = sd.crba(model, np.zeros(3))
    assert M[at[0], at[1]] == pytest.approx(J, rel=1e-12)
    assert M[at[1], at[1]] == pytest.approx(J, rel=1e-12)


def test_the_largest_stable_step_is_that_of_the_common_frequency() -> None:
    """h < 2 / √(k (1/I + 1/n²J))."""
    model, limit = arm(), 2.0 / frequency()
    run = sd.rollout(model, [0.1, 0.0], [0.0, 0.0], dt=0.999 * limit, steps=3000)
    assert abs(run.q[:, 0]).max() < 10.0
    for call in (sd.rollout, sd.simulate):
        rest: dict[str, Any] = (
            {"steps": 1} if call is sd.rollout else {"duration": 1.0, "method": "semi_implicit_euler"}
        )
        with pytest.raises(sd.SimulationError, match=f'at most {limit:.3g} s.*spring of joint "arm_joint"'):
            call(model, [0.1, 0.0], [0.0, 0.0], dt=1.001 * limit, **rest)
    with pytest.raises(sd.SimulationError, match="where explicit_euler is stable with the spring"):
        sd.simulate(model, [0.1, 0.0], [0.0, 0.0], 1.0, 1e-3, "explicit_euler")


@compiled
@pytest.mark.parametrize("method", ["velocity_verlet", "rk4", "semi_implicit_euler", "stormer_verlet"])
def test_the_limit_is_where_steps_begin_to_grow(method: str) -> None:
    model = arm(0.3)
    with pytest.raises(sd.SimulationError, match="expected at most") as error:
        sd.rollout(model, [0.1, 0.0], [0.0, 0.0], dt=1.0, steps=1, method=method)
    limit = float(str(error.value).split("at most ")[1].split(" ")[0])
    last = sd.rollout(model, [0.1, 0.0], [0.0, 0.0], dt=0.98 * limit, steps=2000, method=method).q
    assert abs(last[:, 0]).max() < 0.5


@compiled
def test_springs_act_in_discrete_mechanics() -> None:
    """Kicks at both ends of a step: Störmer's limit, order 2, no drift of the energy."""
    model, start = arm(), ([0.01, 0.0], [0.0, 0.0])  # the rotor turns by less than 120° in a step
    limit = 2.0 / frequency()
    with pytest.raises(sd.SimulationError, match=f"at most {limit:.3g} s, where variational is stable with the spring"):
        sd.simulate(model, *start, 1.0, 1.001 * limit, "variational")
    assert abs(sd.simulate(model, *start, 500 * limit, 0.98 * limit, "variational").q[:, 0]).max() < 0.1
    wanted = sd.simulate(model, *start, 0.5, 1e-4, "rk4").q[-1]
    off = [abs(sd.simulate(model, *start, 0.5, dt, "variational").q[-1] - wanted).max() for dt in (2e-3, 1e-3)]
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)
    run = sd.simulate(model, *start, 20.0, 0.1 * limit, "variational")
    early, late = np.split(abs(run.energy - run.energy[0])[1:-1], [len(run.t) // 2])[::1]
    assert late.max() <= 1.1 * early.max()


def test_programs_kernels_and_friction_take_the_same_steps() -> None:
    model = arm(D)
    q0, v0, tau = [0.1, 2.0], [0.3, -4.0], np.array([0.0, 0.02])
    run = sd.simulate(model, q0, v0, 0.02, 1e-3, "semi_implicit_euler", tau)
    again = sd.simulate(model, q0, v0, 0.02, 1e-3, "semi_implicit_euler", lambda t, q, v: tau)
    many = sd.rollout(model, [q0] * 3, v0, tau, dt=1e-3, steps=20)
    none = sd.rollout(sd.Scene(model, friction=sd.Friction([0.0, 0.0], 0.0)), q0, v0, tau, dt=1e-3, steps=20)
    np.testing.assert_allclose(again.v, run.v, rtol=1e-12)
    np.testing.assert_allclose(many.v[2], run.v[1:], rtol=1e-12)
    np.testing.assert_allclose(none.v, run.v[1:], rtol=1e-10)
    np.testing.assert_array_equal(run.tau, again.tau)
    a = sd.aba(model, q0, v0, tau + sd.spring_torque(model, q0, v0))
    np.testing.assert_allclose(run.v[1], v0 + 1e-3 * a, rtol=1e-12)


def test_a_motor_holds_a_load_through_the_spring() -> None:
    """At rest the spring's torque is n times the motor's, and its stretch that over k."""
    b = sd.ModelBuilder("held").add_body(
        "arm", None, "revolute", (0, 1, 0), inertia=(1.0, (0.2, 0, 0), 0.1 * np.eye(3))
    )
    model = b.add_series_elastic("arm_joint", K, 2.0, J, N).build()
    law = sd.PD(kp=[0.0, 0.5], kd=[0.0, 5e-3], q_ref=[0.0, 0.0])
    q, v = sd.rollout(model, [0.0, 0.0], [0.0, 0.0], dt=5e-4, steps=20000, control=law, record="last")
    assert abs(v).max() < 1e-8
    load = sd.generalized_gravity(model, q)[0]
    np.testing.assert_allclose(sd.spring_torque(model, q), [load, -load / N], rtol=1e-8)
    np.testing.assert_allclose(-0.5 * q[1], load / N, rtol=1e-8)


def test_models_keep_their_springs() -> None:
    model = arm(D)
    assert pickle.loads(pickle.dumps(model)) == model
    assert model.key != arm().key
    assert model.with_(gravity=(0, 0, 0)).bodies["spring"].tolist() == [0, 0, 1]
    both = model.reduced(["arm_joint", "arm_joint_rotor"])
    assert both.nv == 0
    for one in ("arm_joint", "arm_joint_rotor"):
        with pytest.raises(sd.ModelError, match=r'joint "arm_joint" is driven by the spring .*; lock both'):
            model.reduced([one])
    small, _ = sd.simplify(model, merge_lighter_than=0.5)
    assert small.nv == 2


def test_an_unset_spring_costs_nothing() -> None:
    assert not has_springs(sd.load_urdf("two_link"))
    assert sd.Scene(sd.load_urdf("two_link")).effects == ()


@pytest.mark.parametrize("user", [False, True])
@pytest.mark.parametrize("method", ["rk4", "dop853"])
def test_the_ledger_counts_the_work_of_springs(method: str, user: bool) -> None:
    model, tau = arm(), np.array([0.1, 0.02])
    torque: Any = (lambda t, q, v: tau) if user else tau
    run = sd.simulate(model, [0.1, 0.0], [0.0, 0.0], 0.2, 1e-3, method, torque, record="work")
    ledger = sd.energy_ledger(run)
    stored = sd.spring_energy(model, run.q)
    np.testing.assert_allclose(ledger.work["springs"].sum(1), stored[0] - stored, rtol=0.0, atol=1e-6 * stored[0])
    assert abs(ledger.error).max() < 1e-6 * abs(ledger.change).max()


def test_the_ledger_counts_springs_beside_friction() -> None:
    model = arm(D)
    run = sd.simulate(
        sd.Scene(model, friction=sd.Friction([0.1, 1e-3], 0.0)),
        [0.1, 0.0],
        [0.0, 0.0],
        0.2,
        1e-4,
        "semi_implicit_euler",
        record="work",
    )
    ledger = sd.energy_ledger(run)
    assert (ledger.work["friction"][-1] < 0.0).all()
    assert abs(ledger.error).max() < 1e-10 * abs(ledger.change).max()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rotor": 0.0}, r'joint "arm_joint" has a rotor of inertia 0\.0 behind a spring.*armature'),
        ({"stiffness": 0.0}, r'"arm_joint" is driven by a spring of stiffness 0\.0, expected a finite number above 0'),
        ({"stiffness": np.inf}, "stiffness inf"),
        ({"damping": -1.0}, r"damping -1\.0, expected a finite number of 0 or more"),
        ({"ratio": 0.0}, r"ratio 0\.0, expected a finite number other than 0"),
        ({"ratio": "x"}, "has ratio 'x', expected 1 number"),
    ],
)
def test_bad_values_are_named(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(sd.ModelError, match=words):
        arm(**changes)


def test_joints_that_no_spring_can_drive_are_refused() -> None:
    b = sd.ModelBuilder().add_body("ball", joint="spherical")
    with pytest.raises(sd.ModelError, match='joint "nosuch" is not in robot'):
        b.add_series_elastic("nosuch", K, 0.0, J)
    with pytest.raises(sd.ModelError, match='"ball_joint" is spherical, expected one of one coordinate'):
        b.add_series_elastic("ball_joint", K, 0.0, J)
    with pytest.raises(sd.ModelError, match="two links named"):
        sd.ModelBuilder().add_body("a").add_series_elastic("a_joint", K, 0.0, J).add_series_elastic(
            "a_joint", K, 0.0, J
        )
    b = sd.ModelBuilder().add_body("wheel", joint="continuous").add_series_elastic("wheel_joint", K, 0.0, J)
    with pytest.raises(
        sd.ModelError, match='"wheel_joint" is driven by the spring of "wheel_joint_rotor", expected both'
    ):
        b.build(continuous="cos_sin")
