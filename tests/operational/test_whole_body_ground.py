"""Whole bodies: their program against separate calls, on slopes and hills, on some of their feet, beside motors."""

from __future__ import annotations

import pickle
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from standing_robots import box

import spatialdyn as sd

pytest.importorskip("qpsolvers")
SAME = 1e-9  # relative: sums in another order
SOLVED = 1e-6  # of accelerations and of forces over the weight: two programs of one problem
SLOPE = 0.2
DT = 2e-3


@cache
def tripod() -> tuple[sd.Model, Any]:
    """A body on three legs with spheres for feet, and where it stands."""
    b = sd.ModelBuilder("tripod", "world")
    b.add_body("body", None, "floating", inertia=(4.0, (0, 0, 0), 0.05 * np.eye(3)))
    limits = sd.JointLimits(-2.0, 2.0, 10.0, 30.0)
    for k, angle in enumerate((0.0, 2.1, 4.2)):
        at = (0.2 * np.cos(angle), 0.2 * np.sin(angle), 0.0)
        axis = (-np.sin(angle), np.cos(angle), 0.0)
        leg = (0.3, (0, 0, -0.1), 1e-3 * np.eye(3))
        b.add_body(f"thigh{k}", "body", "revolute", axis, at, leg, f"hip{k}", limits=limits)
        b.add_body(f"shin{k}", f"thigh{k}", "revolute", axis, (0, 0, -0.2), leg, f"knee{k}", limits=limits)
        b.add_body(f"foot{k}", f"shin{k}", "fixed", placement=(0, 0, -0.2))
    model = b.build()
    q = sd.neutral(model).copy()
    q[7:] = np.tile([0.4, -0.8], 3)
    contacts = sd.Contacts(model, {f"foot{k}": 0.03 for k in range(3)})
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    return model, q


def standing(model: sd.Model, q: Any) -> list[Any]:
    return [sd.ComTask(sd.center_of_mass(model, q), Kp=20.0, weight=10.0), sd.PostureTask(q, Kp=20.0, weight=0.1)]


@pytest.mark.parametrize("reference", ["local", "world", "local_world_aligned"])
def test_the_program_is_that_of_separate_calls(reference: str) -> None:
    """P and g by the rows that tasks give alone; rows and bounds by M, h, and Jacobians of points."""
    model, scene, q = box()
    rng = np.random.default_rng(0)
    q, v = sd.integrate(model, q, 0.1 * rng.normal(size=model.nv)), 0.3 * rng.normal(size=model.nv)
    target = None if reference == "world" else sd.frame_placement(model, sd.neutral(model), "fore")
    tasks = [
        sd.FrameTask("fore", target, rng.normal(size=6), rng.normal(size=6), reference=reference, weight=2.0),
        sd.ComTask(rng.normal(size=2) @ np.eye(2, 3), rng.normal(size=2), axes="xy", Kp=[3.0, 4.0]),
        sd.PostureTask(sd.neutral(model), [1.0], [0.5], joints=["elbow"], Kp=7.0, weight=0.3),
    ]
    body = sd.WholeBody(scene, tasks)
    p, n = body.program(q, v), model.nv
    P, g = np.diag(np.r_[np.full(n, body.motion_weight), np.full(12, body.force_weight)]), np.zeros(n + 12)
    for task in tasks:
        row = task.rows(model, q, v)
        P[:n, :n] += task.weight * row.J.T @ row.J
        g[:n] -= task.weight * row.J.T @ (row.wanted - row.drift)
    np.testing.assert_allclose(p.P, P, atol=SAME * abs(P).max())
    np.testing.assert_allclose(p.g, g, atol=SAME * abs(g).max())
    unit = 1.0 / np.r_[np.full(6, body.weight), 20.0, 20.0]
    np.testing.assert_allclose(p.rows[:n, :n], unit[:, None] * sd.crba(model, q), atol=SAME)
    h, limit = unit * sd.nonlinear_effects(model, q, v), np.r_[np.zeros(6), 1.0, 1.0]
    np.testing.assert_allclose(p.high[n + 12 : 2 * n + 12], limit - h, atol=SAME)
    np.testing.assert_allclose(p.low[n + 12 : 2 * n + 12], -limit - h, atol=SAME)
    for k, name in enumerate(scene.contacts.names):
        J = sd.frame_jacobian(model, q, name, "local_world_aligned")[[2, 0, 1]]
        np.testing.assert_allclose(p.rows[:n, n + 3 * k : n + 3 * k + 3], -body.weight * unit[:, None] * J.T, atol=SAME)
        row = p.rows[2 * n - 2 + 4 * k, n + 3 * k : n + 3 * k + 3]  # n rows of bodies, 6 of feet
        np.testing.assert_allclose(row, [-0.6 / np.sqrt(2.0), 1.0, 0.0], atol=SAME)
    a = np.linalg.lstsq(p.rows[n : n + 6, :n], p.high[2 * n + 12 : 2 * n + 18], rcond=None)[0]
    for name in scene.contacts.names:  # equations of feet: seen from the body, each point slows by D times its velocity
        found = sd.frame_acceleration(model, q, v, a, name, "local_world_aligned", classical=True)[:3]
        slip, turn = np.split(sd.frame_velocity(model, q, v, name, "local_world_aligned"), 2)
        np.testing.assert_allclose(found, np.cross(turn, slip) - 20.0 * slip, atol=1e-6)


def test_forces_are_those_that_a_step_gives() -> None:
    """Spheres roll: the point where each touches is still, not its centre."""
    model, q = tripod()
    contacts = sd.Contacts(model, {f"foot{k}": 0.03 for k in range(3)}, friction=0.8, tolerance=1e-11)
    up = sd.ComTask(acceleration=[0.4, -0.3, 0.5])
    body = sd.WholeBody(sd.Scene(model, contacts=contacts), [up, sd.PostureTask(q, weight=1e-3)])
    found = body.solve(q, np.zeros(model.nv))
    assert abs(found.a[7:]).max() > 1.0
    step = sd.contact_step(model, contacts, q, np.zeros(model.nv), found.tau, 1e-5)
    np.testing.assert_allclose(step.v / 1e-5, found.a, atol=1e-3 * abs(found.a).max())
    np.testing.assert_allclose(step.impulse / 1e-5, found.forces, atol=1e-3 * body.weight)


def test_a_slope_by_heights_is_that_of_a_plane() -> None:
    """Heights that rise evenly, under a robot of points and under one of spheres."""
    model, q = tripod()
    ends = []
    x = 0.5 * np.arange(-4, 5)
    hill = sd.Heightfield(np.tile(SLOPE * x[:, None], (1, 9)), 0.5, (-2.0, -2.0))
    for terrain in (sd.Plane((-SLOPE, 0.0, 1.0)), hill):
        contacts = sd.Contacts(model, {f"foot{k}": 0.03 for k in range(3)}, terrain=terrain)
        there = q.copy()
        there[3:7] = [0.0, np.sin(-0.5 * np.arctan(SLOPE)), 0.0, np.cos(0.5 * np.arctan(SLOPE))]
        there[:3] = 0.0
        there[2] -= sd.contact_gaps(model, contacts, there).min() * np.hypot(1.0, SLOPE)
        body = sd.WholeBody(sd.Scene(model, contacts=contacts), standing(model, there))
        found = body.solve(there, 0.1 * np.arange(model.nv))
        ends.append((found.a, found.forces / body.weight, found.tau))
        assert found.residual < SOLVED
    for one, other in zip(*ends, strict=True):
        np.testing.assert_allclose(one, other, atol=SOLVED * max(1.0, abs(one).max()))


def test_on_some_of_its_feet_it_is_as_with_those_alone() -> None:
    """Two corners of four, and none."""
    model, scene, q = box()
    tilted = sd.integrate(model, q, np.r_[0.0, 0.0, 0.0, 0.0, 0.1, np.zeros(model.nv - 5)])
    gaps = sd.contact_gaps(model, scene.contacts, tilted)
    tilted[2] -= gaps.min()
    down = [name for name, x in zip(scene.contacts.names, gaps - gaps.min(), strict=True) if x < 1e-3]
    assert len(down) == 2
    tasks, v = standing(model, q), np.zeros(model.nv)
    found = sd.WholeBody(scene, tasks, standing=1e-3).solve(tilted, v)
    alone = sd.Scene(model, contacts=sd.Contacts(model, dict.fromkeys(down, 0.0), friction=0.6))
    wanted = sd.WholeBody(alone, tasks).solve(tilted, v)
    assert found.points == wanted.points == tuple(down)
    np.testing.assert_allclose(found.a, wanted.a, atol=SOLVED * abs(wanted.a).max())
    np.testing.assert_allclose(found.forces, wanted.forces, atol=1e2 * SOLVED * 68.67)
    tilted[2] += 1.0
    flying = sd.WholeBody(scene, tasks[1], standing=1e-3).solve(tilted, v)
    assert flying.points == ()
    np.testing.assert_allclose(sd.aba(model, tilted, v, flying.tau), flying.a, atol=1e-8)


def test_tasks_of_other_classes_count_as_ours() -> None:
    """An object with rows of its own, and a second posture of one joint."""

    class Mine:
        name, weight, priority = "mine", 1.0, 0

        def __init__(self, task: Any) -> None:
            self.check, self.rows = task.check, task.rows

    model, scene, q = box()
    tasks, v = standing(model, q), np.r_[np.zeros(6), 0.2, 0.1]
    other = Mine(tasks[0].with_(weight=1.0))
    other.weight = 10.0
    first, second = sd.WholeBody(scene, tasks).solve(q, v), sd.WholeBody(scene, [other, tasks[1]]).solve(q, v)
    np.testing.assert_allclose(first.a, second.a, atol=SOLVED)
    half = tasks[1].with_(weight=0.05)
    twice = sd.WholeBody(scene, [tasks[0], half, half]).solve(q, v)
    np.testing.assert_allclose(first.a, twice.a, atol=SOLVED)
    other = pickle.loads(pickle.dumps(sd.WholeBody(scene, [sd.ComTask(axes="z")])))
    np.testing.assert_allclose(other.solve(q, v, tasks).a, first.a, atol=SOLVED)


def test_what_other_classes_lack_is_named() -> None:
    """Of the object as it is given, and of the rows that it makes."""
    model, scene, q = box()
    v, good = np.zeros(model.nv), sd.ComTask()

    class Other:
        name, weight, priority = "other", 1.0, 0
        check = staticmethod(lambda model: None)

        def __init__(self, **changes: Any) -> None:
            self.rows = lambda *x: good.rows(*x)._replace(**changes)

    sd.WholeBody(scene, Other()).solve(q, v)
    with pytest.raises(sd.NonFiniteError, match='wanted of task "other"'):
        sd.WholeBody(scene, Other(wanted=np.full(3, np.nan))).solve(q, v)
    for change in ({"J": np.zeros((3, 2))}, {"drift": np.zeros(2)}, {"J": 1.0}):
        with pytest.raises(sd.ShapeError, match='of task "other"'):
            sd.WholeBody(scene, Other(**change)).solve(q, v)
    less = type("Less", (), {"rows": None, "name": "less"})()
    less.rows = good.rows
    with pytest.raises(sd.SpatialDynError, match="without weight"):
        sd.WholeBody(scene, less)


# What is beside a whole body in a scene, all pairs: a row has one of each column.
GROUND = {"flat": None, "slope": sd.Plane((0.1, 0.0, 1.0)), "hills": sd.Heightfield(0.01 * np.eye(3), 1.0, (-1, -1))}
BESIDE = [
    ("flat", False, False, False), ("flat", True, True, True), ("slope", False, True, True),
    ("slope", True, False, False), ("hills", False, True, False), ("hills", True, False, True),
    ("flat", True, False, False), ("slope", False, False, True), ("hills", True, True, False),
]  # fmt: skip


def test_the_rows_beside_it_have_all_pairs() -> None:
    values = [sorted(set(column), key=str) for column in zip(*BESIDE, strict=True)]
    for i in range(len(values)):
        for j in range(i):
            assert {(row[i], row[j]) for row in BESIDE} == set(product(values[i], values[j]))


@pytest.mark.parametrize(("ground", "friction", "motor", "limits"), BESIDE)
def test_it_stands_beside_whatever_a_scene_has(ground: str, friction: bool, motor: bool, limits: bool) -> None:
    model, flat, q = box()
    contacts = sd.Contacts(model, dict.fromkeys(flat.contacts.names, 0.0), friction=0.6, terrain=GROUND[ground])
    motors = sd.Motor(np.r_[np.zeros(6), 0.1, 0.1], 0.5, 24.0, 10.0)
    rub = sd.Friction(np.r_[np.zeros(6), 0.1, 0.1], np.r_[np.zeros(6), 0.2, 0.2])
    scene = sd.Scene(
        model, contacts=contacts, friction=rub if friction else False, motor=motors if motor else None, limits=limits
    )
    there = q.copy()
    there[2] += 1e-6 - sd.contact_gaps(model, contacts, there).min()
    body = sd.WholeBody(scene, standing(model, there), dt=DT)
    run = sd.simulate(scene, there, np.zeros(model.nv), 5 * DT, DT, torque=body)
    found = body.solve(run.q[-1], run.v[-1])
    assert np.isfinite(run.q).all()
    assert found.residual < 1e-5
    assert abs(found.tau[6:]).max() <= min(20.0, *motors.stall_torque[6:]) + 1e-5


def test_what_has_no_motor_has_no_torque() -> None:
    """An elbow that swings freely, and motors weaker than the joint's limit."""
    model, flat, q = box()
    motor = sd.Motor(np.r_[np.zeros(6), 0.001, 0.0], 0.5, 24.0, 10.0)
    scene = sd.Scene(model, contacts=flat.contacts, motor=motor)
    bent = q.copy()
    bent[7:] = [0.8, 0.3]
    found = sd.WholeBody(scene, standing(model, q)).solve(bent, np.zeros(model.nv))
    assert found.tau[7] == 0.0
    assert abs(found.a[7]) > 0.1
    assert abs(found.tau[6]) <= motor.stall_torque[6] * (1.0 + 1e-5)
    assert motor.stall_torque[6] < 1.0
    with pytest.raises(sd.ModelError, match="driven by voltage"):
        sd.WholeBody(scene.with_(drive="voltage"), standing(model, q))
