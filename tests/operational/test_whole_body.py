"""Whole bodies: weight carried, KKT, other solvers, cones and limits, priorities, what gives way, bad input."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from standing_robots import box, gripper, talos

import spatialdyn as sd
from spatialdyn.operational.quadratic import EQUAL, by_qpsolvers, raw
from spatialdyn.recursions.control.whole_body import viable

pytest.importorskip("qpsolvers")
KKT = 1e-10  # of accelerations and of forces over the weight: a program without active inequalities
SOLVERS = {"quadprog": 1e-9, "clarabel": 1e-5}  # of accelerations: one is direct, the other an interior point's
CARRIED = 1e-6  # of the weight: the small weights of f² and a² move it
MET = 1e-6  # [m/s²] of equations that hold
BRAKED = 1e-6  # [rad] beyond a limit: the last step of braking ends at rest, or on the limit


def standing(model: sd.Model, q: Any) -> list[Any]:
    return [sd.ComTask(sd.center_of_mass(model, q), Kp=20.0, weight=10.0), sd.PostureTask(q, Kp=20.0, weight=0.1)]


def ice(model: sd.Model, scene: sd.Scene) -> sd.Scene:
    """The same feet with little friction."""
    return sd.Scene(model, contacts=sd.Contacts(model, dict.fromkeys(scene.contacts.names, 0.0), friction=0.05))


@pytest.mark.parametrize("robot", [box, talos], ids=["box", "talos"])
def test_the_ground_carries_the_weight(robot: Any) -> None:
    model, scene, q = robot()
    found = sd.WholeBody(scene, standing(model, q)).solve(q, np.zeros(model.nv))
    weight = 9.81 * model.total_mass
    np.testing.assert_allclose(found.forces.sum(0), [0, 0, weight], atol=CARRIED * weight)
    assert (found.forces[:, 2] >= 0).all()
    assert abs(found.a).max() < 1e-3
    assert found.residual < 1e-8
    assert not found.tau[:6].any()
    fext = sum(
        sd.wrench_at(model, q, name, np.r_[sd.frame_placement(model, q, name)[:3, :3].T @ f, 0, 0, 0])
        for name, f in zip(found.points, found.forces, strict=True)
    )
    np.testing.assert_allclose(sd.aba(model, q, np.zeros(model.nv), found.tau, fext), found.a, atol=1e-8)


def kkt(body: sd.WholeBody, q: Any, v: Any) -> Any:
    """The solution of the equations alone."""
    p = body.program(q, v)
    equal = p.sense[len(p.g) :] == EQUAL
    A, b, n = p.rows[equal], p.high[len(p.g) :][equal], len(p.g)
    K = np.block([[p.P, A.T], [A, np.zeros((len(A), len(A)))]])
    return np.linalg.solve(K, np.r_[-p.g, b])[:n]


@pytest.mark.parametrize("robot", [box, talos, gripper], ids=["box", "talos", "gripper"])
def test_without_active_limits_it_is_the_solution_of_the_equations(robot: Any) -> None:
    model, scene, q = robot()
    v = np.r_[np.zeros(6), 0.02 * np.cos(np.arange(model.nv - 6))]
    body = sd.WholeBody(scene, standing(model, q), limits=())
    x, found = kkt(body, q, v), body.solve(q, v)
    np.testing.assert_allclose(found.a, x[: model.nv], atol=KKT * max(1.0, abs(found.a).max()))
    normal = [found.forces[:, 2], found.forces[:, 0], found.forces[:, 1]]
    np.testing.assert_allclose(np.stack(normal, 1).ravel() / body.weight, x[model.nv :], atol=KKT)


def test_joints_that_mimic_move_as_those_of_the_tree_times_G() -> None:
    """Rows of torques, tasks and feet of the tree, reduced; torques that forward dynamics confirm; its limits."""
    (model, scene, q), (free, free_scene, whole) = gripper(), gripper(mimic=False)
    G, rng = np.asarray(model.mimic_matrix), np.random.default_rng(0)
    v = 0.1 * rng.normal(size=model.nv)
    tasks = [sd.FrameTask("ball", axes="xyz rxyz", reference="local", Kd=3.0), sd.ComTask(acceleration=[0.2, 0, 0])]
    found = []
    for s, at, speed in ((scene, q, v), (free_scene, whole, G @ v)):
        body = sd.WholeBody(s, [*tasks, sd.PostureTask(at)], limits=())
        state, _ = body._state(body._goals, at, speed)
        found.append((body, state, at, speed))
    (body, x, _, _), (other, y, _, _) = found
    n, N = model.nv, free.nv
    torques = (x.rows[:n, :n] / body.unit[:, None], y.rows[:N, :N] / other.unit[:, None])
    np.testing.assert_allclose(torques[0], G.T @ torques[1] @ G, atol=1e-12)
    np.testing.assert_allclose(x.bias, G.T @ y.bias, atol=1e-11)
    np.testing.assert_allclose(x.J, y.J @ G, atol=1e-12)
    np.testing.assert_allclose(x.drift, y.drift, atol=1e-12)
    np.testing.assert_allclose(x.rows[n:, :n], y.rows[N:, :N] @ G, atol=1e-12)
    np.testing.assert_allclose(x.low[-len(x.rows) + n :], y.low[-len(y.rows) + N :], atol=1e-10)
    motion = body.solve(q, v)
    fext = sum(
        sd.wrench_at(model, q, name, np.r_[sd.frame_placement(model, q, name)[:3, :3].T @ f, 0, 0, 0])
        for name, f in zip(motion.points, motion.forces, strict=True)
    )
    np.testing.assert_allclose(sd.aba(model, q, v, motion.tau, fext), motion.a, atol=1e-8)
    bounds = sd.WholeBody(scene, tasks)._settings[0]
    k = model.joint("first").idx_v
    np.testing.assert_allclose(bounds[:3, k], [-1.0, 0.4 / 0.8, 2.0 / 0.8])  # its own, then the follower's
    with pytest.raises(sd.ModelError, match='joints "second" of task "posture" mimic others'):
        sd.WholeBody(scene, sd.PostureTask(q, joints=["second"]))


@pytest.mark.parametrize("asked", [0.5, 30.0], ids=["free", "with active limits"])
def test_other_solvers_find_the_same(asked: float) -> None:
    """quadprog and DAQP to rounding, clarabel to its own tolerance; through qpsolvers DAQP has the same bits."""
    model, scene, q = box()
    v = np.r_[np.zeros(6), 0.3, -0.2]
    tasks = [sd.ComTask(acceleration=[asked, asked, 0.0]), sd.PostureTask(q, weight=1e-3)]
    if asked > 1.0:
        scene = ice(model, scene)
    body = sd.WholeBody(scene, tasks)
    p, n = body.program(q, v), model.nv
    x = raw("daqp", p)
    y = np.r_[x, p.rows @ x]
    active = ((y >= p.high - 1e-9) | (y <= p.low + 1e-9)) & (p.sense != EQUAL)
    assert active.any() == (asked > 1.0)
    np.testing.assert_allclose(by_qpsolvers("daqp", p), x, atol=1e-12)
    for solver, tolerance in SOLVERS.items():
        pytest.importorskip(solver)
        other = by_qpsolvers(solver, p)  # without warnings
        np.testing.assert_allclose(other[:n], x[:n], atol=tolerance * max(1.0, abs(x[:n]).max()))
        np.testing.assert_allclose(other[n:], x[n:], atol=1e2 * tolerance)  # forces weigh a ten-thousandth
    np.testing.assert_allclose(sd.WholeBody(scene, tasks, solver="quadprog").solve(q, v).a, x[:n], atol=1e-6)


def test_daqp_alone_needs_no_qpsolvers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which imports JAX and takes a second."""
    model, scene, q = box()
    monkeypatch.setitem(sys.modules, "qpsolvers", None)
    assert sd.WholeBody(scene, standing(model, q)).solver == "daqp"
    monkeypatch.setitem(sys.modules, "daqp", None)
    for missing in ("quadprog", "daqp"):
        with pytest.raises(sd.SpatialDynError, match=r"qpsolvers is not installed; pip install qpsolvers daqp"):
            sd.WholeBody(scene, standing(model, q), solver=missing)


def test_forces_stay_in_their_cones_and_torques_in_their_limits() -> None:
    """A centre of mass that is asked for 30 m/s² aslant: feet on ice hold by all their friction, the task is missed."""
    model, scene, q = box()
    fast = sd.ComTask(acceleration=[30.0, 30.0, 0.0])
    found = sd.WholeBody(ice(model, scene), [fast, sd.PostureTask(q, weight=1e-3)], largest=40.0).solve(
        q, np.zeros(model.nv)
    )
    f = found.forces
    share = np.linalg.norm(f[:, :2], axis=1) / (0.05 * f[:, 2])
    assert (share <= 1.0 + 1e-4).all()
    assert share.max() > 0.99
    assert (f[:, 2] <= 40.0 + 1e-6).all()
    assert (abs(found.tau[6:]) <= 20.0 + 1e-6).all()
    assert abs(found.missed[0][0]) > 20.0
    assert found.relaxed == ()


def test_tasks_of_higher_priority_are_not_disturbed() -> None:
    """The centre of mass first, an arm that wants to swing second; of weights alone both are missed."""
    model, scene, q = box()
    first = sd.ComTask(sd.center_of_mass(model, q), Kp=20.0)
    swing = sd.FrameTask("fore", acceleration=[3.0, 0.0, 0.0], axes="xyz", priority=1)
    v = np.zeros(model.nv)
    strict = sd.WholeBody(scene, [first, swing]).solve(q, v)
    weighted = sd.WholeBody(scene, [first, swing.with_(priority=0)]).solve(q, v)
    assert abs(strict.missed[0]).max() < 1e-4
    assert abs(weighted.missed[0]).max() > 1e-2
    assert strict.residual < 1e-6


def test_what_has_to_give_way_is_named() -> None:
    """An arm that spins so fast that centrifugal forces lift the box, where the ground only pushes."""
    _, scene, q = box()
    bent = q.copy()
    bent[7] = 0.9
    push = sd.PostureTask(acceleration=[0.0, 0.0], Kp=0.0, Kd=0.0)
    still = sd.WholeBody(scene, push)
    v = np.r_[np.zeros(6), 1.0, 0.0]
    assert still.solve(bent, v).relaxed == ()
    fast = np.r_[np.zeros(6), 200.0, 0.0]
    with pytest.raises(sd.ConstraintError, match=r"the least to give way is (push of the ground|torque|friction)"):
        sd.WholeBody(scene, push, limits=("torque",)).solve(bent, fast)
    soft = sd.WholeBody(scene, push, limits=("torque",), infeasible="relax").solve(bent, fast)
    assert soft.relaxed
    assert soft.relaxed[0].amount > 0.0
    assert str(soft.relaxed[0]).startswith(soft.relaxed[0].name)


def test_the_smallest_relaxation_is_that_by_hand() -> None:
    """1 kg m² that runs into its limit with 1 rad/s and has to brake by 20 rad/s², by a motor of 10 N m.

    s₁² + s₂² is least under 20 - s₁ = 10 (1 + s₂): s₁ = 10/101 rad/s², s₂ = 100/101 of 10 N m.
    """
    limits = sd.JointLimits(-1.0, 1.0, 5.0, 10.0)
    b = sd.ModelBuilder("wheel").add_body(
        "wheel", None, "revolute", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.eye(3)), limits=limits
    )
    body = sd.WholeBody(b.build(), sd.PostureTask([0.0]), brake=20.0, infeasible="relax")
    found = body.solve([1.0], [1.0])
    assert [x.name for x in found.relaxed] == [
        'torque limit of joint "wheel_joint"',
        'position or velocity limit of joint "wheel_joint"',
    ]
    assert [x.unit for x in found.relaxed] == ["N m", "rad/s²"]
    np.testing.assert_allclose([x.amount for x in found.relaxed], [1000 / 101, 10 / 101], rtol=1e-3)
    np.testing.assert_allclose(found.tau, -2010 / 101, rtol=2e-3)


def test_braking_ends_before_the_limit() -> None:
    """From any viable state, with the acceleration that the bound allows taken in full, step after step."""
    h, brake, fastest, limit = 1e-2, 5.0, 2.0, 1.0
    for q0, v0 in ((0.0, 0.0), (0.5, 2.0), (0.9, 0.9), (1.0, 0.0)):
        q, v = q0, v0
        for _ in range(400):
            a = min(viable(limit - q, v, fastest, brake, h), 50.0)
            q, v = q + h * v + 0.5 * h * h * a, v + h * a
            assert q <= limit + BRAKED
            assert v <= fastest + 1e-9
    assert q > limit - 1e-2
    assert viable(-0.1, 1.0, fastest, brake, h) == -brake  # beyond: braked, not more


def test_feet_that_slip_are_slowed() -> None:
    model, scene, q = box()
    v = np.zeros(model.nv)
    v[0] = 0.1
    found = sd.WholeBody(scene, standing(model, q), damping=20.0).solve(q, v)
    for name in found.points:
        a = sd.frame_acceleration(model, q, v, found.a, name, "local_world_aligned", classical=True)
        np.testing.assert_allclose(a[:3], [-2.0, 0.0, 0.0], atol=MET)


def test_a_state_that_is_asked_for_again_is_not_solved_again() -> None:
    """As ``simulate`` does where it records; another time, position or velocity is another state."""
    model, scene, q = box()
    body, v = sd.WholeBody(scene, standing(model, q)), np.r_[np.zeros(6), 0.1, 0.2]
    tau = body(0.0, q, v)
    tau[:] = 0.0  # a copy
    solve, asked = body.solve, []
    body.solve = lambda *x: (asked.append(x), solve(*x))[1]  # type: ignore[method-assign]
    np.testing.assert_array_equal(body(0.0, q, v), solve(q, v).tau)
    assert not asked
    np.testing.assert_array_equal(body(0.0, q, 0.5 * v), solve(q, 0.5 * v).tau)
    body(0.1, q, 0.5 * v)
    assert len(asked) == 2
    with pytest.raises(sd.ShapeError, match="q has shape"):
        body(0.1, q[None], 0.5 * v)


def test_a_push_is_survived_in_closed_loop() -> None:
    """The box is pushed for 50 ms and stands again; its forces act as it asked for."""
    model, scene, q = box()
    tasks = [standing(model, q)[0].with_(Kp=80.0, Kd=None), sd.PostureTask(q, Kp=100.0, weight=0.1)]
    body = sd.WholeBody(scene, tasks, dt=4e-3, infeasible="relax")

    def push(t: float, q: Any, v: Any) -> Any:
        force = [40.0 if 0.05 <= t < 0.1 else 0.0, 0, 0, 0, 0, 0]
        return sd.wrench_at(model, q, "fore", force)

    run = sd.simulate(scene, q, np.zeros(model.nv), 0.5, 4e-3, torque=body, fext=push)
    c = sd.center_of_mass(model, run.q)
    far = abs(c - c[0]).max()
    assert far > 1e-3
    assert abs(c[-1] - c[0]).max() < 0.5 * far
    assert abs(run.v[-1]).max() < 0.2 * abs(run.v).max()


BAD: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"tasks": []}, sd.SpatialDynError, "tasks is"),
    ({"tasks": sd.FrameTask("hand")}, sd.ModelError, "hand"),
    ({"solver": "gurobi9"}, sd.SpatialDynError, "solver is 'gurobi9'"),
    ({"limits": "force"}, sd.SpatialDynError, "limits has 'force'"),
    ({"dt": 0.0}, sd.SpatialDynError, "dt is 0.0"),
    ({"standing": "some"}, sd.SpatialDynError, "standing is 'some'"),
    ({"infeasible": "ignore"}, sd.SpatialDynError, "infeasible is"),
    ({"scene": 1}, sd.SpatialDynError, "model is a int"),
    ({"tasks": [sd.ComTask(axes="xy"), sd.ComTask(axes="yz")]}, sd.SpatialDynError, "both move y of the centre"),
    ({"tasks": sd.ComTask(np.zeros((2, 3)))}, sd.ShapeError, "expected that of one state"),
    ({"tasks": sd.PostureTask(np.tile(box()[2], (2, 1)))}, sd.ShapeError, "expected that of one state"),
    ({"tasks": sd.ComTask(np.zeros(3), Kp=np.ones((2, 3)))}, sd.ShapeError, "expected that of one state"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "kind", "message"), BAD)
def test_bad_input_is_named(change: dict[str, Any], kind: type[Exception], message: str) -> None:
    model, scene, q = box()
    with pytest.raises(kind, match=message):
        sd.WholeBody(**({"scene": scene, "tasks": standing(model, q)} | change))


def test_states_that_do_not_fit_and_points_without_inertia_are_refused() -> None:
    model, scene, q = box()
    body = sd.WholeBody(scene, standing(model, q))
    with pytest.raises(sd.ShapeError, match="q has shape"):
        body.solve(q[None], np.zeros(model.nv))
    with pytest.raises(sd.NonFiniteError, match="v has"):
        body.solve(q, np.full(model.nv, np.nan))
    b = sd.ModelBuilder("feather", "world").add_body("a", None, "floating", inertia=(0.0, (0, 0, 0), np.zeros((3, 3))))
    light = b.build()
    with pytest.raises(sd.ConstraintError, match="no inertia behind it"):
        sd.WholeBody(sd.Scene(light, contacts=sd.Contacts(light, {"a": 0.0})), sd.ComTask())
