"""Control laws with states: closed forms by order, one law however it runs, kernels by content, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record.tracer import scratch
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.joints.friction import DT
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V
from spatialdyn.recursions.tree.regressor import WORK as REGRESSOR_WORK
from spatialdyn.recursions.tree.regressor import joint_torque_regressor
from spatialdyn.recursions.tree.rnea import WORK, rnea
from spatialdyn.simulation import fixed_steps

EPS = float(np.finfo(float).eps)
SAME = 1e3 * EPS  # a few dozen steps of rounding in another order, scaled
METHODS = {"explicit_euler": 1, "semi_implicit_euler": 1, "velocity_verlet": 2, "rk4": 4}
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")

REACH = Argument("reach", ("nv",), "rad", "goal")
GAINS = Argument("gains", (3,), "N m/rad | N m s/rad | N m/(rad s)", "of error, velocity and integral")
PAST = Argument("past", ("nv",), "rad s", "integral of the error", start=0.0)
COUNT = Argument("count", (1,), "1", "steps so far", start=0.0)


def part(name: str, shape: tuple[str | int, ...] = ("nv",)) -> Argument:
    return Argument(name, shape, "", "")


def pid(bodies: Any, q: Any, v: Any, reach: Any, gains: Any, past: Any, tau: Any, past_rate: Any) -> None:
    for i in range(len(tau)):
        tau[i] = gains[0] * (reach[i] - q[i]) - gains[1] * v[i] + gains[2] * past[i]
        past_rate[i] = reach[i] - q[i]


def counted(bodies: Any, v: Any, dt: Any, count: Any, past: Any, tau: Any, count_after: Any, past_after: Any) -> None:
    """A digital law: its torque pulses with the parity of nothing; it sums v dt itself."""
    for i in range(len(tau)):
        tau[i] = -0.5 * past[i] - 0.1 * v[i]
        past_after[i] = past[i] + dt * v[i]
    count_after[0] = count[0] + 1.0


PID = Spec("pid", pid, None, (Q, V, REACH, GAINS, PAST), TAU, "", "", parts=(TAU, part("past_rate")))
COUNTED = Spec(
    "counted", counted, None, (V, DT, COUNT, PAST), TAU, "", "",
    parts=(TAU, part("count_after", (1,)), part("past_after")),
)  # fmt: skip


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("three_link")


def reaching(held: bool = False, **values: Any) -> sd.Control:
    return sd.Control(PID, {"reach": [0.4, -0.2, 0.3], "gains": [30.0, 6.0, 20.0], **values}, held)


def in_python(*arguments: Any, **options: Any) -> sd.Trajectory:
    """``simulate`` whose steps run in Python: a torque function of zeros makes them."""
    return scenes.simulate(*arguments, torque=lambda t, q, v: np.zeros(len(v)), **options)


def toil(bodies: Any, q: Any, v: Any, tau: Any, dt: Any, aim: Any, weight: Any, cost: Any) -> None:
    """A cost of error, speed and torque."""
    for i in range(len(v)):
        error = q[i] - aim[i]
        cost[0] = cost[0] + dt * (weight * error * error + 0.1 * v[i] * v[i] + 1e-3 * tau[i] * tau[i])


TOIL = Spec(
    "toil", toil, None, (Q, V, TAU, DT, Argument("aim", ("nv",), "rad", ""), Argument("weight", (), "", "")),
    Argument("cost", (1,), "", "of a step"), "", "", regroup=True,
)  # fmt: skip


# --- by hand --------------------------------------------------------------------------------------------


def mass() -> sd.Model:
    made = sd.ModelBuilder("mass").add_body("m", None, "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)))
    return made.build(gravity=(0.0, 0.0, 0.0))


def lag(bodies: Any, v: Any, x: Any, tau: Any, x_rate: Any) -> None:
    """ẋ = v - x and τ = -x: with v(0) = 0, x(0) = 1 a damped oscillation of frequency √3/2."""
    tau[0] = -x[0]
    x_rate[0] = v[0] - x[0]


LAG = Spec(
    "lag", lag, None, (V, Argument("x", (1,), "m/s", "", start=1.0)), TAU, "", "", parts=(TAU, part("x_rate", (1,)))
)


def lag_closed(t: float) -> float:
    w = math.sqrt(0.75)
    return math.exp(-0.5 * t) * (math.cos(w * t) - 0.5 / w * math.sin(w * t))


@pytest.mark.parametrize("way", [scenes.simulate, in_python])
@pytest.mark.parametrize(("method", "order"), METHODS.items())
def test_a_state_has_the_order_of_the_method(method: str, order: int, way: Callable[..., sd.Trajectory]) -> None:
    errors = []
    for dt in (0.1, 0.05):
        run = way(mass(), [0.0], [0.0], 2.0, dt, method, control=sd.Control(LAG))
        errors.append(abs(run.states["x"][-1, 0] - lag_closed(2.0)))
    assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.25)


def test_scipys_methods_integrate_states_too() -> None:
    pytest.importorskip("scipy")
    run = sd.simulate(mass(), [0.0], [0.0], 2.0, 0.1, "dop853", control=sd.Control(LAG), rtol=1e-11)
    np.testing.assert_allclose(run.states["x"][:, 0], [lag_closed(t) for t in run.t], atol=1e-10)


def test_states_that_change_at_the_end_of_a_step(arm: sd.Model) -> None:
    for way in (sd.simulate, in_python):
        run = way(arm, [0.1, 0.2, 0.3], [1.0, 0.0, -1.0], 0.1, 0.01, "rk4", control=sd.Control(COUNTED, held=True))
        np.testing.assert_array_equal(run.states["count"][:, 0], np.arange(11))
        np.testing.assert_allclose(run.states["past"][1:], 0.01 * np.cumsum(run.v[:-1], axis=0), atol=SAME)
        np.testing.assert_allclose(run.tau, -0.5 * run.states["past"] - 0.1 * run.v, atol=SAME)


# --- the same however it runs ---------------------------------------------------------------------------


def test_a_law_is_the_torque_function_it_says(arm: sd.Model) -> None:
    args = (arm, [0.1, 0.2, -0.1], [0.5, 0.0, 0.0], 0.2, 0.01)
    wanted = sd.simulate(*args, torque=lambda t, q, v: 30.0 * (np.array([0.4, -0.2, 0.3]) - q) - 6.0 * v)
    found = sd.simulate(*args, control=reaching(gains=[30.0, 6.0, 0.0]))
    np.testing.assert_allclose(found.q, wanted.q, rtol=0.0, atol=SAME)
    np.testing.assert_allclose(found.tau, wanted.tau, rtol=0.0, atol=1e2 * SAME)


def test_a_held_law_is_that_of_the_beginning_of_each_step(arm: sd.Model) -> None:
    q, v, past = np.array([0.1, 0.2, -0.1]), np.array([0.5, 0.0, 0.0]), np.zeros(3)
    found = sd.simulate(arm, q, v, 0.1, 0.01, control=reaching(True))
    for k in range(10):
        tau = 30.0 * (np.array([0.4, -0.2, 0.3]) - q) - 6.0 * v + 20.0 * past
        step = sd.simulate(arm, q, v, 0.01, 0.01, torque=tau)
        q, v, past = step.q[-1], step.v[-1], found.states["past"][k + 1]
        np.testing.assert_allclose(found.tau[k], tau, rtol=0.0, atol=1e2 * SAME)
        np.testing.assert_allclose(found.q[k + 1], q, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("method", ["semi_implicit_euler", "rk4"])
def test_a_rollout_is_so_many_simulations(arm: sd.Model, method: str) -> None:
    rng = np.random.default_rng(0)
    q0, v0, past = rng.normal(size=(3, 3, 3))
    reach = rng.normal(size=(3, 12, 3))
    kept = dict(dt=2e-3, method=method)
    found = scenes.rollout(arm, q0, v0, control=reaching(reach=reach), states={"past": past}, **kept)
    for k in range(3):
        for way in (sd.simulate, in_python):
            run = way(
                arm, q0[k], v0[k], 12 * 2e-3, 2e-3, method, control=reaching(reach=reach[k]), states={"past": past[k]}
            )
            for x, y in ((found.q, run.q), (found.v, run.v), (found.states["past"], run.states["past"])):
                np.testing.assert_allclose(x[k], y[1:], rtol=0.0, atol=SAME * max(1.0, abs(y).max()))
    low = scenes.rollout(arm, q0, v0, control=reaching(reach=reach), states={"past": past}, dtype=np.float32, **kept)
    np.testing.assert_allclose(low.states["past"], found.states["past"], atol=1e-4)


@pytest.mark.parametrize("way", slow_but(["implicit"], ["implicit", "lugre", "smooth"]))
def test_a_law_acts_beside_friction(arm: sd.Model, way: str) -> None:
    friction = sd.Friction([0.5, 0.4, 0.3], [0.1] * 3, [0.7, 0.6, 0.5], 0.05, 1.0, 1e4, 30.0)
    args = (arm, [0.1, 0.2, 0.3], [0.5, 0.0, -0.5], 0.03, 1e-3, "semi_implicit_euler")
    kept = dict(friction=friction, friction_method=way, control=reaching())
    found, python = scenes.simulate(*args, **kept), in_python(*args, **kept)
    for x, y in ((found.q, python.q), (found.states["past"], python.states["past"])):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=SAME)
    past = np.cumsum(1e-3 * (np.array([0.4, -0.2, 0.3]) - found.q[:-1]), axis=0)  # explicit Euler, as q in this method
    np.testing.assert_allclose(found.states["past"][1:], past, rtol=0.0, atol=SAME)
    if way == "lugre":
        assert found.bristles is not None
        assert found.bristles.shape == (31, 3)
        np.testing.assert_allclose(found.bristles, python.bristles, rtol=0.0, atol=SAME)


def test_a_law_acts_under_constraints() -> None:
    model = sd.load_urdf("two_link")
    held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x", at_b=(0.5, 0.0, 0.0))])
    q = sd.close_loops(model, held, [0.3, 0.8])
    law = sd.Control(PID, {"reach": [0.5, 0.2], "gains": [30.0, 6.0, 20.0]})
    args, kept = (model, q, [0.0, 0.0], 0.05, 5e-3, "rk4"), dict(constraints=held, control=law)
    found, python = scenes.simulate(*args, **kept), in_python(*args, **kept)
    np.testing.assert_allclose(found.q, python.q, rtol=0.0, atol=1e2 * SAME)
    np.testing.assert_allclose(found.states["past"], python.states["past"], rtol=0.0, atol=SAME)
    assert abs(sd.constraint_error(model, held, found.q)).max() < 1e-12
    many = scenes.rollout(model, q, [0.0, 0.0], dt=5e-3, steps=10, method="rk4", **kept)
    np.testing.assert_allclose(many.q, found.q[1:], rtol=0.0, atol=1e2 * SAME)


def computed(bodies: Any, work: Any, q: Any, v: Any, reach: Any, tau: Any) -> None:
    """Computed torque: a recursion within a law."""
    wanted = [0.0 * v[i] for i in range(len(tau))]
    for i in range(len(tau)):
        wanted[i] = 25.0 * (reach[i] - q[i]) - 10.0 * v[i]
    rnea(bodies, work, q, v, wanted, None, tau)


@pytest.mark.parametrize("regroup", [True, False])
def test_a_law_may_call_recursions(regroup: bool) -> None:
    """Poles at -5: every joint goes to its goal as 1 - e^-5t (1 + 5 t), whatever the robot."""
    model = random_tree(11, 4, ("revolute", "prismatic")).model
    law = Spec("computed", computed, WORK, (Q, V, REACH), TAU, "", "", regroup=regroup)
    goal = np.linspace(-0.5, 0.5, model.nv)
    run = sd.simulate(
        model, np.zeros(model.nv), np.zeros(model.nv), 0.5, 5e-3, control=sd.Control(law, {"reach": goal})
    )
    way = 1.0 - np.exp(-5.0 * run.t) * (1.0 + 5.0 * run.t)
    np.testing.assert_allclose(run.q, way[:, None] * goal, atol=1e-6)


def test_a_step_without_a_program_carries_states_all_the_same(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    args = (arm, [0.3, 0.2, 0.1], [1.0, -1.0, 0.5], 0.05, 1e-2)
    wanted = sd.simulate(*args, control=reaching())
    monkeypatch.setattr(fixed_steps, "program", lambda *_: None)
    found = sd.simulate(*args, control=reaching())
    np.testing.assert_allclose(found.states["past"], wanted.states["past"], rtol=0.0, atol=SAME)


# --- what later chapters rest on ------------------------------------------------------------------------

ESTIMATE = Argument("estimate", ("njoints", 10), "kg | kg m | kg m²", "inertial parameters of each body", start=0.0)
RATES = Argument("estimate_rate", ("njoints", 10), "", "")


def adapting(bodies: Any, work: Any, q: Any, v: Any, reach: Any, estimate: Any, tau: Any, estimate_rate: Any) -> None:
    """Gravity Y(q) θ by estimated parameters, θ̇ = -Yᵀ s with s = v + (q - q_d), and PD (Slotine and Li, 1987)."""
    n, rest = len(tau), np.zeros(len(tau))
    Y = np.zeros((n, *np.shape(estimate)), object)
    joint_torque_regressor(bodies, work, q, rest, rest, Y)
    off = [q[i] - reach[i] for i in range(n)]
    for i in range(n):
        tau[i] = (Y[i] * estimate).sum() - 20.0 * off[i] - 10.0 * v[i]
    columns = Y.reshape((n, -1))
    for k in range(len(estimate_rate)):
        estimate_rate[k] = -sum(columns[i, k] * (v[i] + off[i]) for i in range(n))


@compiled
def test_an_adaptive_law_learns_the_gravity_that_it_does_not_know() -> None:
    """Its state is a table, a parameter for each body; PD alone rests where its springs and gravity balance."""
    model, goal = sd.load_urdf("two_link"), np.array([0.8, 0.4])
    parts = (TAU, RATES)
    spec = Spec("adapting", adapting, REGRESSOR_WORK, (Q, V, REACH, ESTIMATE), TAU, "", "", parts=parts)
    run = sd.simulate(model, [0.0, 0.0], [0.0, 0.0], 15.0, 5e-3, control=sd.Control(spec, {"reach": goal}))
    assert run.states["estimate"].shape == (3001, 3, 10)
    assert abs(run.q[-1] - goal).max() < 1e-3
    Y = sd.joint_torque_regressor(model, run.q[-1], [0.0, 0.0], [0.0, 0.0])
    learnt = np.einsum("ijk,jk->i", Y, run.states["estimate"][-1])
    np.testing.assert_allclose(learnt, sd.generalized_gravity(model, goal), rtol=5e-3)
    python = in_python(model, [0.0, 0.0], [0.0, 0.0], 0.05, 5e-3, control=sd.Control(spec, {"reach": goal}))
    np.testing.assert_allclose(python.states["estimate"], run.states["estimate"][:11], rtol=0.0, atol=SAME)


MOMENTUM = Argument("momentum", ("nv",), "kg m²/s", "estimated", start=0.0)


def observing(bodies: Any, q: Any, v: Any, tau: Any, momentum: Any, nothing: Any, momentum_rate: Any) -> None:
    """p̂' = Cᵀ v - g + tau + r with r = 20 (M v - p̂), which follows the torque that no motor gave (De Luca, 2006)."""
    n = len(nothing)
    M = np.zeros((n, n), object)
    back, gravity = np.zeros(n, object), np.zeros(n, object)
    crba.recursion(bodies, scratch(crba.work, bodies), q, M)
    transposed.recursion(bodies, scratch(transposed.work, bodies), q, v, back)
    rnea(bodies, scratch(WORK, bodies), q, None, None, None, gravity)
    for i in range(n):
        nothing[i] = 0.0
        residual = 20.0 * (sum(M[i, j] * v[j] for j in range(n)) - momentum[i])
        momentum_rate[i] = back[i] - gravity[i] + tau[i] + residual


crba, transposed = SPECS["crba"], SPECS["coriolis_transpose_times_velocity"]


def test_an_observer_finds_the_torque_that_no_motor_gave(arm: sd.Model) -> None:
    """Its law gives no torque, and knows that of the arguments; r goes to Jᵀ f as 1 - e^-20t."""
    parts = (TAU, part("momentum_rate"))
    spec = Spec("observer", observing, None, (Q, V, TAU, MOMENTUM), TAU, "", "", parts=parts)
    q0, tau, fext = np.array([0.3, 0.5, -0.4]), np.array([2.0, 10.0, 3.0]), np.zeros((arm.njoints, 6))
    kept = dict(control=sd.Control(spec), torque=tau)
    for f in (0.0, 3.0):
        fext[-1, 1] = f
        run = scenes.simulate(arm, q0, [0.0] * 3, 0.4, 5e-3, **kept, fext=fext)
        p = np.einsum("nij,nj->ni", sd.crba(arm, run.q), run.v)
        found = 20.0 * (p - run.states["momentum"])
        push = sd.generalized_gravity(arm, run.q) - sd.static_torque(arm, run.q, fext)
        lag = np.zeros(3)
        for k in range(len(run) - 1):  # the filter by itself: ṙ = 20 (push - r)
            lag += (1.0 - np.exp(-20.0 * 5e-3)) * (0.5 * (push[k] + push[k + 1]) - lag)
        np.testing.assert_allclose(found[-1], lag, atol=2e-3)
        np.testing.assert_allclose(run.tau, np.broadcast_to(tau, run.tau.shape))
    free = scenes.simulate(arm, q0, [0.0] * 3, 0.4, 5e-3, **kept)  # by a program
    assert abs(np.einsum("nij,nj->ni", sd.crba(arm, free.q), free.v) - free.states["momentum"]).max() < 1e-6


# --- starts and continuations ---------------------------------------------------------------------------


@pytest.mark.parametrize("way", [scenes.simulate, in_python])
def test_a_run_goes_on_from_its_end_to_the_bit(arm: sd.Model, way: Callable[..., sd.Trajectory]) -> None:
    friction = sd.Friction([0.5, 0.4, 0.3], [0.1] * 3, [0.7, 0.6, 0.5], 0.05, 1.0, 1e4, 30.0)
    kept = dict(friction=friction, friction_method="lugre", control=reaching(), record="work")
    times = dict(dt=1e-3, method="semi_implicit_euler")
    whole = way(arm, [0.1, 0.2, 0.3], [0.5, 0.0, -0.5], 0.02, **times, **kept)
    first = way(arm, [0.1, 0.2, 0.3], [0.5, 0.0, -0.5], 0.012, **times, **kept)
    then = way(arm, duration=0.008, **first.end, **times, **kept)
    np.testing.assert_array_equal(then.q, whole.q[12:])
    assert set(whole.states) == {"bristles", "past", "work_torque", "work_friction"}
    for name, x in whole.states.items():
        np.testing.assert_array_equal(then.states[name], x[12:])
    fresh = way(arm, first.q[-1], first.v[-1], 0.008, **times, **kept)
    assert abs(fresh.q[-1] - whole.q[-1]).max() > 1e-9  # bristles and integral count


def test_a_rollout_goes_on_from_states(arm: sd.Model) -> None:
    friction = sd.Friction([0.5] * 3, [0.1] * 3, bristle_stiffness=1e4, bristle_damping=30.0)
    kept = dict(dt=1e-3, friction=friction, friction_method="lugre", control=reaching())
    q0 = np.random.default_rng(1).normal(size=(9, 3))
    whole = scenes.rollout(arm, q0, np.zeros(3), steps=20, **kept)
    first = scenes.rollout(arm, q0, np.zeros(3), steps=12, **kept)
    then = scenes.rollout(arm, **first.end, steps=8, **kept)
    np.testing.assert_array_equal(then.q, whole.q[:, 12:])
    np.testing.assert_array_equal(then.states["past"], whole.states["past"][:, 12:])
    last = scenes.rollout(arm, q0, np.zeros(3), steps=12, record="last", **kept)
    one = scenes.rollout(arm, q0[4], np.zeros(3), steps=12, **kept)
    for name, x in first.end["states"].items():
        np.testing.assert_array_equal(last.end["states"][name], x)
        np.testing.assert_array_equal(one.end["states"][name], x[4])
    np.testing.assert_array_equal(scenes.rollout(arm, **last.end, steps=8, **kept).q, then.q)
    np.testing.assert_array_equal(scenes.rollout(arm, **one.end, steps=8, **kept).q, then.q[4])


def test_ctrl_c_keeps_the_states_of_the_last_step(arm: sd.Model) -> None:
    """A run that is stopped goes on from its end as if it had not been."""

    def stopping(t: float, q: Any, v: Any) -> Any:
        if t > 0.031:
            raise KeyboardInterrupt
        return np.zeros(3)

    args, kept = ([0.1, 0.2, 0.3], [0.5, 0.0, -0.5]), dict(dt=0.01, control=reaching())
    with pytest.raises(sd.SimulationInterrupt) as caught:
        scenes.simulate(arm, *args, 1.0, torque=stopping, record=50, **kept)
    run = caught.value.trajectory
    assert len(run) == 2
    whole = in_python(arm, *args, 0.1, **kept)
    done = round(run.t[-1] / 0.01)
    assert done >= 2
    np.testing.assert_array_equal(run.states["past"][-1], whole.states["past"][done])
    then = in_python(arm, duration=0.1 - run.t[-1], **run.end, **kept)
    np.testing.assert_allclose(then.q[-1], whole.q[-1], rtol=0.0, atol=SAME)


def test_states_are_saved_and_tabled(arm: sd.Model, tmp_path: Path) -> None:
    run = sd.simulate(arm, [0.1, 0.2, 0.3], [0.0] * 3, 0.05, 0.01, control=reaching())
    run.save(tmp_path / "run.npz")
    back = sd.Trajectory.load(tmp_path / "run.npz")
    np.testing.assert_array_equal(back.states["past"], run.states["past"])
    pytest.importorskip("pandas")
    assert [x for x in run.to_dataframe().columns if x.startswith("past")] == ["past0", "past1", "past2"]


# --- kernels by content ---------------------------------------------------------------------------------


def pull(strength: str) -> Spec:
    """Laws of one name that differ in a number of their source."""
    scope: dict[str, Any] = {}
    exec(f"def pull(bodies, q, tau):\n    for i in range(len(tau)):\n        tau[i] = -{strength} * q[i]\n", scope)
    return Spec("pull", scope["pull"], None, (Q,), TAU, "", "")


@compiled
def test_laws_of_one_name_never_meet_each_others_kernels() -> None:
    """Kernels are kept on disk by what was recorded: by name, the second law would be answered by the first's."""
    found = []
    for strength in ("1.0", "4.0", "1.0"):
        batch_kernels.forget()
        law = sd.Control(pull(strength))
        one = sd.simulate(mass(), [1.0], [0.0], 1.0, 0.01, control=law).q[-1, 0]
        many = sd.rollout(mass(), np.ones((9, 1)), [0.0], dt=0.01, steps=100, method="rk4", control=law).q[:, -1, 0]
        np.testing.assert_allclose(many, one, rtol=0.0, atol=SAME)
        found.append(one)
    np.testing.assert_allclose(found, [math.cos(1.0), math.cos(2.0), math.cos(1.0)], atol=1e-6)


def test_what_a_law_closes_over_is_named() -> None:
    def closing(gain: float, helper: Callable[[float], float]) -> Callable[..., None]:
        def law(bodies: Any, q: Any, tau: Any) -> None:
            tau[0] = helper(gain * q[0])

        return law

    with pytest.raises(
        sd.SimulationError, match=r'"p" reads gain = 3\.0 in law, expected functions only: make gain an inp'
    ):
        sd.Control(Spec("p", closing(3.0, abs), None, (Q,), TAU, "", ""))


# --- refusals -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sd.Control("pid"), "spec is 'pid', expected a Spec"),
        (lambda: sd.Control(PID, {"reach": [0.0]}), 'values of spec "pid" lack gains'),
        (lambda: reaching(past=[0.0] * 3), 'values of spec "pid" have past, expected some of reach, gains'),
        (lambda: sd.Control(replace(PID, parts=())), r'the outputs tau, expected tau, past_rate or past_after'),
        (lambda: sd.Control(replace(PID, traceable=False)), '"pid" branches on values'),
    ],
)  # fmt: skip
def test_what_is_no_law_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(sd.SimulationError, match=message):
        make()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (dict(control=PID), sd.SimulationError, "control is .*, expected a Control or None"),
        (dict(control=reaching(True), method="dop853"), sd.SimulationError, '"pid" is held over a step, expected a f'),
        (dict(control=sd.Control(COUNTED), method="radau"), sd.SimulationError, "has states that change at the end"),
        (dict(control=reaching(reach=[0.0, 1.0])), sd.ShapeError, r'reach of spec "pid" has shape \(2,\), expected'),
        (dict(control=reaching(), states={"pest": [0.0]}), sd.SimulationError, "states have pest, expected some of p"),
        (dict(states={"past": [0.0]}), sd.SimulationError, "states have past, expected none"),
        (dict(control=reaching(), states={"past": [0.0]}), sd.ShapeError, r"past has shape \(1,\), expected \(3,\)"),
        (dict(control=reaching(), states={"past": [np.nan] * 3}), sd.NonFiniteError, "state past is"),
        (dict(control=reaching(), states=[1.0]), sd.SimulationError, r"states are \[1\.0\], expected a dict"),
    ],
)  # fmt: skip
def test_what_a_run_cannot_take_is_named(arm: sd.Model, options: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        scenes.simulate(arm, [0.1, 0.2, 0.3], [0.0] * 3, 0.02, 0.01, **options)


def test_two_states_of_one_name_are_refused(arm: sd.Model) -> None:
    def law(bodies: Any, q: Any, bristles: Any, tau: Any, bristles_rate: Any) -> None:
        tau[0] = bristles_rate[0] = 0.0

    clash = Argument("bristles", ("nv",), "", "", start=0.0)
    spec = Spec("clash", law, None, (Q, clash), TAU, "", "", parts=(TAU, part("bristles_rate")))
    friction = sd.Friction([0.5] * 3, [0.1] * 3, bristle_stiffness=1e4, bristle_damping=30.0)
    with pytest.raises(sd.SimulationError, match="two states of the run are named bristles"):
        sd.rollout(
            sd.Scene(arm, friction=friction, friction_method="lugre"),
            [0.0] * 3,
            [0.0] * 3,
            dt=1e-3,
            steps=2,
            control=sd.Control(spec),
        )
    hold: dict[str, Any] = {"pd": sd.PD([0.0] * 3, [0.0] * 3, [0.0] * 3)}
    with pytest.raises(
        sd.SimulationError, match=r"pd is given, expected sd\.rollout\(..., control=sd\.PD\(kp, kd, q_ref"
    ):
        sd.rollout(arm, [0.0] * 3, [0.0] * 3, dt=1e-3, steps=2, **hold)


GAIN = 10.0


class Holder:
    gain = 3.0

    def law(self, bodies: Any, q: Any, tau: Any) -> None:
        tau[0] = -self.gain * q[0]


def helped(q: Any) -> Any:
    return -GAIN * q


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda bodies, q, tau: tau.__setitem__(0, -GAIN * q[0]), "reads GAIN = 10.0 in"),
        (lambda bodies, q, tau: tau.__setitem__(0, helped(q[0])), "reads GAIN = 10.0 in helped"),
        (Holder().law, r"is or calls a method, Holder\.law"),
    ],
)
def test_numbers_around_a_law_are_refused_as_what_is_compiled_would_keep_them(law: Any, words: str) -> None:
    with pytest.raises(sd.SimulationError, match=words):
        sd.Control(Spec("law", law, None, (Q,), TAU, "", ""))


# --- costs ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["semi_implicit_euler", "rk4"])
@pytest.mark.parametrize("law", [None, reaching(), reaching(held=True)], ids=["no law", "law", "held"])
def test_a_cost_is_its_sum_along_the_trajectory(arm: sd.Model, law: sd.Control | None, method: str) -> None:
    rng = np.random.default_rng(5)
    B, T, dt = 4, 6, 0.01
    start, tau = rng.normal(size=(2, B, 3)), rng.normal(size=(B, T, 3))
    aim, weight = rng.normal(size=(B, T, 3)), 7.0
    cost = sd.Cost(TOIL, {"aim": aim, "weight": weight})
    given: dict[str, Any] = {"dt": dt, "control": law, "method": method}
    run = scenes.rollout(arm, *start, tau, cost=cost, **given)
    whole = scenes.rollout(arm, *start, tau, **given)
    assert (run.q.shape, run.cost.shape) == ((B, 3), (B,))
    np.testing.assert_array_equal(run.q, whole.q[:, -1])
    q, v = (np.concatenate([x[:, None], y[:, :-1]], 1) for x, y in zip(start, whole, strict=True))
    past = 0.0 * q
    if law is not None:
        past[:, 1:] = whole.states["past"][:, :-1]
        tau = tau + 30.0 * (np.array([0.4, -0.2, 0.3]) - q) - 6.0 * v + 20.0 * past
    each = dt * (weight * (q - aim) ** 2 + 0.1 * v**2 + 1e-3 * tau**2).sum(-1)
    np.testing.assert_allclose(run.cost, each.sum(1), rtol=SAME)
    if law is None:
        sums = scenes.rollout(arm, *start, tau, cost=cost, record=2, **given).cost
        np.testing.assert_allclose(sums, each.cumsum(1)[:, 1::2], rtol=SAME)


def test_what_is_no_cost_is_refused(arm: sd.Model) -> None:
    with pytest.raises(
        sd.SimulationError, match=r'spec "pid" has the outputs tau \(\'nv\',\), past_rate .*states past'
    ):
        sd.Cost(PID, {"reach": np.zeros(3), "gains": np.ones(3)})
    with pytest.raises(sd.SimulationError, match='values of spec "toil" are 3, expected a mapping'):
        sd.Cost(TOIL, 3)  # type: ignore[arg-type]
    with pytest.raises(sd.SimulationError, match='values of spec "toil" lack weight'):
        sd.Cost(TOIL, {"aim": np.zeros(3)})
    for given, words in (
        ({"cost": TOIL}, r'cost is the Spec "toil", expected a Cost or None: sd\.Cost\(spec, values\)'),
        ({"control": PID}, 'control is the Spec "pid", expected a Control or None'),
    ):
        with pytest.raises(sd.SimulationError, match=words):
            scenes.rollout(arm, np.zeros(3), np.zeros(3), dt=0.01, steps=2, **given)  # type: ignore[arg-type]
    with pytest.raises(sd.SimulationError, match="the rollout has no cost"):
        _ = sd.rollout(arm, np.zeros(3), np.zeros(3), dt=0.01, steps=0).cost
    for name, recursion, error, words in (
        ("idle", lambda bodies, q, cost: None, sd.SimulationError, r'spec "idle" does not write cost\[0\], expected'),
        ("zero", lambda bodies, q, cost: cost.fill(0.0), None, ""),
        ("short", lambda bodies, q: None, TypeError, 'spec "short": .* takes 2 positional arguments but 3 were given'),
        ("wide", lambda bodies, q, cost: cost.__setitem__(1, q[0]), TypeError, 'spec "wide": index 1'),
        ("sharp", lambda bodies, q, cost: cost.fill(1.0 if q[0] > 0.0 else 0.0), TypeError, 'spec "sharp": .*no truth'),
    ):
        made = sd.Cost(Spec(name, recursion, None, (Q,), Argument("cost", (1,), "", ""), "", ""))
        with nullcontext() if error is None else pytest.raises(error, match=words):
            assert sd.rollout(arm, np.zeros(3), np.zeros(3), dt=0.01, steps=2, cost=made).cost == 0.0
    wrong = sd.Cost(TOIL, {"aim": np.zeros(2), "weight": 1.0})
    with pytest.raises(sd.ShapeError, match=r'cost.aim of spec "toil" has shape \(2,\), expected'):
        sd.rollout(arm, np.zeros(3), np.zeros(3), dt=0.01, steps=2, cost=wrong)


def test_a_cost_that_is_not_finite_is_named_with_sample_and_time(arm: sd.Model) -> None:
    """Its state is sound. An axis that does not fit is that of the cost's value, too."""
    start, tau, aim = np.zeros((2, 4, 3)), np.zeros((4, 6, 3)), np.zeros((4, 6, 3))
    aim[2, 3, 1] = np.nan

    def run(**values: Any) -> Any:
        return sd.rollout(arm, *start, tau, dt=0.5, cost=sd.Cost(TOIL, {"aim": aim, "weight": 1.0, **values}))

    words = r'sample 2: state "cost" of spec "toil" is not finite in the step from t = 1\.5 s'
    with pytest.raises(sd.SimulationError, match=words):
        run()
    with pytest.raises(sd.ShapeError, match=r'tau \(4,\), cost\.aim of spec "toil" \(5,\)'):
        run(aim=np.zeros((5, 6, 3)))
    with pytest.raises(
        sd.ShapeError, match=r'differ: tau 6, cost\.aim of spec "toil" 4, expected one; an input of sam'
    ):
        run(aim=np.zeros((4, 3)))
