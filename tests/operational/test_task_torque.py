"""Tasks in strict order: what is met, what is not disturbed, singular configurations, bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plain import compiled

import spatialdyn as sd
from spatialdyn.operational.turning import turning

MET = 1e-12  # [m/s²] of accelerations of some m/s²: the hierarchy's error on a redundant arm
EXACT = 1e-13


@pytest.fixture(scope="module")
def arm() -> Any:
    model, rng = sd.load_urdf("panda"), np.random.default_rng(0)
    return model, sd.random_configuration(model, rng), rng.normal(size=model.nv)


def two(rng: Any) -> list[sd.FrameTask]:
    """A point, then a rotation of the same frame."""
    return [sd.FrameTask("panda_hand", acceleration=rng.normal(size=3), axes=x, name=x) for x in ("xyz", "rxyz")]


def test_both_tasks_are_met_and_the_posture_disturbs_neither(arm: Any) -> None:
    model, q, v = arm
    rng = np.random.default_rng(2)
    tasks = two(rng)
    found = sd.task_torque(model, q, v, tasks, posture=rng.normal(size=model.nv))
    assert max(abs(x).max() for x in found.missed) < MET
    assert found.rank == (3, 3)
    np.testing.assert_allclose(sd.aba(model, q, v, found.tau), found.a, atol=1e3 * MET)
    for task, missed in zip(tasks, found.missed, strict=True):
        rows = task.rows(model, q, v)
        np.testing.assert_allclose(rows.J @ found.a + rows.drift - rows.wanted, missed, atol=MET)
    free = sd.task_torque(model, q, v, tasks)
    assert abs(found.a - free.a).max() > 1e-2  # the posture does act, on the joint that is left


def test_a_task_gives_way_to_those_before_it(arm: Any) -> None:
    """Two frames on one link ask for what one body cannot do: the first has it, whatever the second."""
    model, q, v = arm
    first = sd.FrameTask("panda_link8", acceleration=[0.4, 0.0, -0.3, 0.0, 0.2, 0.0])
    second = sd.FrameTask("panda_hand", acceleration=[-2.0, 1.0, 0.0, 3.0, 0.0, 0.0])
    found = sd.task_torque(model, q, v, [first, second])
    assert abs(found.missed[0]).max() < MET
    assert found.rank == (6, 0)
    assert abs(found.missed[1]).max() > 1.0
    np.testing.assert_allclose(found.tau, sd.task_torque(model, q, v, first).tau, atol=1e3 * MET)


def test_torque_stays_bounded_at_the_elbow_of_a_ur5() -> None:
    """Stretched out by 0.1 to 1e-7 rad, where inversion gives 18 to 1.6e7 N m."""
    model, task = sd.load_urdf("ur5"), sd.FrameTask("tool0", acceleration=[0.5, 0.0, 0.5, 0.0, 0.0, 0.0])
    q = np.array([[0.1, -1.0, x, 0.3, 0.5, 0.2] for x in (1e-1, 1e-3, 1e-5, 1e-7)])
    found = sd.task_torque(model, q, np.zeros(6), task)
    extra = abs(found.tau - sd.generalized_gravity(model, q)).max(-1)
    assert extra.max() < 2.0
    assert found.rank[0].tolist() == [5, 5, 5, 5]
    e = found.weak[0][-1]
    lost = sd.frame_jacobian(model, q[-1], "tool0", "local_world_aligned").T @ (np.repeat([1.0, 0.3], 3) * e[0])
    assert (abs(lost).max() < 1e-6, e[1:].any()) == (True, False)  # no joint moves the frame that way
    plain = sd.task_torque(model, q[-1], np.zeros(6), task, damping=1e-30)
    assert abs(plain.tau).max() > 1e7


@compiled
def test_tasks_close_a_loop_on_their_targets() -> None:
    """A pose and a posture are reached in closed loop, held for each step."""
    model = sd.load_urdf("ur5")
    q0, there = np.array([0.1, -1.0, 1.2, 0.3, 0.5, 0.2]), np.array([0.4, -1.2, 1.0, 0.1, 0.8, 0.0])
    goal = sd.frame_placement(model, there, "tool0")
    task = sd.FrameTask("tool0", target=goal, Kp=40.0)

    def torque(t: float, q: Any, v: Any) -> Any:
        return sd.task_torque(model, q, v, task).tau

    run = sd.simulate(model, q0, np.zeros(6), 2.0, 5e-3, torque=torque)
    assert abs(sd.frame_placement(model, run.q[-1], "tool0") - goal).max() < 1e-3


def test_rotation_vectors_are_those_of_rotations() -> None:
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(40, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for angle in (0.0, 1e-9, 0.3, 2.0, 3.1, np.pi - 1e-9, np.pi):
        K = np.swapaxes(np.cross(axes[:, None], np.eye(3)), -1, -2)  # K x = u × x
        R = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        found = turning(R)
        right = abs(found - angle * axes).max(1)
        other = abs(found + angle * axes).max(1) if angle > np.pi - 1e-6 else right
        assert np.minimum(right, other).max() < 1e-7 if angle > 3.0 else right.max() < EXACT


def test_posture_tasks_pull_named_joints(arm: Any) -> None:
    model, q, v = arm
    pull = sd.PostureTask(0.0 * q, joints=["panda_joint2"], Kp=9.0)
    rows = pull.rows(model, q, v)
    assert rows.J.shape == (1, model.nv)
    np.testing.assert_allclose(rows.wanted, [-9.0 * q[1] - 6.0 * v[1]])
    found = sd.task_torque(model, q, v, pull, posture=sd.PostureTask(0.0 * q))
    assert abs(found.missed[0]).max() < MET


BAD: list[tuple[Any, type[Exception], str]] = [
    (lambda: sd.FrameTask("hand"), sd.ModelError, "hand"),
    (lambda: [], sd.SpatialDynError, "tasks is"),
    (lambda: [1], sd.SpatialDynError, "tasks has 1"),
    (lambda: [sd.FrameTask("panda_hand", name="a"), sd.FrameTask("panda_hand", axes="x", name="b")],
     sd.SpatialDynError, '"a" and "b" both move x of frame "panda_hand"'),
    (lambda: [sd.FrameTask("panda_joint7", axes="x", name="a"), sd.FrameTask("panda_link7", axes="x", name="b")],
     sd.SpatialDynError, "both move x"),
    (lambda: sd.FrameTask("panda_link0"), sd.ModelError, "does not move"),
    (lambda: sd.PostureTask(joints=["elbow"]), sd.ModelError, "elbow"),
    (lambda: sd.PostureTask([0.0, 1.0]), sd.ShapeError, "target of task"),
]  # fmt: skip


@pytest.mark.parametrize(("tasks", "kind", "message"), BAD)
def test_tasks_that_name_nothing_or_conflict_are_refused(
    arm: Any, tasks: Any, kind: type[Exception], message: str
) -> None:
    model, q, v = arm
    with pytest.raises(kind, match=message):
        sd.task_torque(model, q, v, tasks())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sd.FrameTask("a", target=[0, 0, 1]), "target of task"),
        (lambda: sd.FrameTask("a", target=2 * np.eye(4)), "no rotation"),
        (lambda: sd.FrameTask("a", target=np.eye(4), reference="world"), "expected an acceleration"),
        (lambda: sd.FrameTask("a", Kp=-1.0), "Kp is -1.0"),
        (lambda: sd.FrameTask("a", weight=0.0), "weight is 0.0"),
        (lambda: sd.FrameTask("a", priority=-1), "priority is -1"),
        (lambda: sd.FrameTask("a", acceleration=[1.0]), "acceleration of task"),
        (lambda: sd.FrameTask("a", acceleration=[np.nan] * 6), "expected finite"),
        (lambda: sd.ComTask(axes="rx"), "does not turn"),
        (lambda: sd.ComTask([0.0, 1.0]), "target of task"),
        (lambda: sd.ComTask().with_(frame="a"), "ComTask has no frame"),
    ],
)
def test_tasks_that_make_no_sense_are_refused(make: Any, message: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=message):
        make()


def test_a_robot_that_floats_is_sent_to_whole_body_control() -> None:
    b = sd.ModelBuilder("satellite", "world").add_body(
        "bus", None, "floating", inertia=(1.0, (0, 0, 0), 0.1 * np.eye(3))
    )
    model = b.build()
    with pytest.raises(sd.ModelError, match="WholeBody"):
        sd.task_torque(model, sd.neutral(model), np.zeros(6), sd.ComTask())
