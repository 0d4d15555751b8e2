"""Inverse kinematics: poses and points are reached, within limits, whatever else is in the batch."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn as sd

NEAR = 1e-8  # the default tolerance of a distance or an angle
ROUNDING = 1e-12  # of entries of a pose some metres away


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_reachable_poses_are_reached_within_limits(name: str) -> None:
    model = sd.load_urdf(name)
    frame = {"panda": "panda_link8", "ur5": "tool0"}[name]
    goal = sd.frame_placement(model, sd.random_configuration(model, 1, (1000,)), frame)
    found = sd.solve_ik(model, {frame: goal})
    assert found.converged.mean() > 0.99
    assert (found.why[found.converged] == "converged").all()
    assert (found.q >= model.lower).all()
    assert (found.q <= model.upper).all()
    there = found.converged
    got = sd.frame_placement(model, found.q[there], frame)
    assert np.linalg.norm((got - goal[there])[:, :3, 3], axis=1).max() < NEAR + ROUNDING
    assert abs(got - goal[there])[:, :3, :3].max() < NEAR + ROUNDING
    assert (found.residual[there] <= NEAR).all()
    alone = sd.solve_ik(model, {frame: goal[17]})  # to the bit, whatever is beside it
    assert (alone.q == found.q[17]).all()
    assert (alone.iterations, alone.starts) == (found.iterations[17], found.starts[17])


def test_a_planar_arm_has_the_two_solutions_of_the_cosine_rule() -> None:
    model = sd.load_urdf("two_link")
    tip = sd.frame_placement(model, [0.3, 0.9], "tip")[:3, 3]
    found = sd.solve_ik(model, {"tip": tip}, limits=False, all_solutions=True)
    assert found.solutions is not None
    (solutions,) = found.solutions
    elbows = solutions[:, 1] - 2 * np.pi * np.round(solutions[:, 1] / (2 * np.pi))
    assert sorted(elbows.round(6)) == [-0.9, 0.9]


def test_all_solutions_of_a_wrist_are_distinct_and_right() -> None:
    model = sd.load_urdf("ur5")
    goal = sd.frame_placement(model, [0.1, -1.0, 1.2, 0.3, 0.5, 0.2], "tool0")
    found = sd.solve_ik(model, {"tool0": goal}, restarts=60, all_solutions=True)
    assert found.solutions is not None
    (q,) = found.solutions
    assert len(q) >= 8  # the eight of the wrist, and their whole turns within ±2π
    assert abs(sd.frame_placement(model, q, "tool0") - goal).max() < 1e-7
    assert min(abs(x - y).max() for k, x in enumerate(q) for y in q[:k]) > 1e-4


def test_two_frames_of_a_floating_robot_are_reached_together() -> None:
    with pytest.warns(UserWarning, match="principal moments"):
        model = sd.load_urdf("anymal", "floating")
    q = sd.integrate(model, sd.neutral(model), 0.2 * np.random.default_rng(0).normal(size=(5, model.nv)))
    feet = {x: sd.frame_placement(model, q, x)[..., :3, 3] for x in ("LF_FOOT", "RH_FOOT")}
    base = sd.frame_placement(model, q, "base")
    found = sd.solve_ik(model, {"base": base, **feet}, sd.neutral(model), limits=False)
    assert found.converged.all()
    assert abs(sd.frame_placement(model, found.q, "base") - base).max() < 1e-7
    for name, point in feet.items():
        assert abs(sd.frame_placement(model, found.q, name)[..., :3, 3] - point).max() < NEAR + ROUNDING
    assert abs(np.linalg.norm(found.q[:, 3:7], axis=1) - 1.0).max() < ROUNDING


def test_joints_that_mimic_others_move_with_them() -> None:
    solid = (1.0, (0.2, 0.0, 0.0), 0.01 * np.eye(3))
    builder = sd.ModelBuilder("finger").add_body("a", None, "revolute", (0, 1, 0), inertia=solid)
    builder.add_body(
        "b", "a", "revolute", (0, 1, 0), (0.4, 0, 0), solid, mimic={"leader": "a_joint", "multiplier": 0.5}
    )
    model = builder.add_body("c", "b", "revolute", (0, 1, 0), (0.4, 0, 0), solid).build(mimic=True)
    goal = sd.frame_placement(model, [0.4, -0.2], "c")
    found = sd.solve_ik(model, {"c": goal})
    assert bool(found.converged)
    assert abs(sd.frame_placement(model, found.q, "c") - goal).max() < 1e-7


def test_what_is_out_of_reach_is_approached_and_said() -> None:
    model = sd.load_urdf("panda")
    found = sd.solve_ik(model, {"panda_link8": [3.0, 0.0, 0.3]}, restarts=3)
    assert not found.converged
    assert found.why in ("stuck", "exhausted")
    reach = np.linalg.norm(sd.frame_placement(model, found.q, "panda_link8")[:3, 3] - [3.0, 0.0, 0.3])
    assert abs(reach - found.residual[0]) < 1e-9
    assert 1.9 < reach < 2.3  # stretched: the arm is 0.9 m or so long
    assert found.residual[1] == 0.0  # no rotation was asked for


def test_no_more_steps_are_taken_than_are_allowed() -> None:
    model = sd.load_urdf("ur5")
    goal = sd.frame_placement(model, [0.1, -1.0, 1.2, 0.3, 0.5, 0.2], "tool0")
    whole = sd.solve_ik(model, {"tool0": goal}, restarts=0)
    for most in range(1, int(whole.iterations) + 1):
        found = sd.solve_ik(model, {"tool0": goal}, restarts=0, iterations=most)
        assert found.iterations <= most
        assert found.converged == (most == whole.iterations)


def test_solve_ik_refuses_what_is_no_target() -> None:
    model = sd.load_urdf("ur5")
    with pytest.raises(sd.ModelError, match="nowhere"):
        sd.solve_ik(model, {"nowhere": np.eye(4)})
    for fault, said in (
        (2.0 * np.eye(4), "no rotation"), (np.diag([1.0, 1.0, -1.0, 1.0]), "a reflection"),
        (np.eye(4) + 0.1 * np.eye(4, k=-3), "a last row that is off"),
    ):  # fmt: skip
        for take in (
            lambda X: sd.solve_ik(model, {"tool0": X}), lambda X: sd.Impedance(model, "tool0", X, 100.0, 10.0),
            lambda X: sd.FrameTask("tool0", X),
        ):  # fmt: skip
            with pytest.raises(sd.SpatialDynError, match=said):
                take(fault)
    with pytest.raises(sd.ShapeError, match=r"target of tool0 has shape \(2,\)"):
        sd.solve_ik(model, {"tool0": [1.0, 2.0]})
    with pytest.raises(sd.NonFiniteError, match="target of tool0"):
        sd.solve_ik(model, {"tool0": [np.nan, 0.0, 0.0]})
    with pytest.raises(sd.ShapeError, match="q0 has shape"):
        sd.solve_ik(model, {"tool0": np.eye(4)}, [0.0])
    with pytest.raises(sd.SpatialDynError, match="tolerance is 0"):
        sd.solve_ik(model, {"tool0": np.eye(4)}, tolerance=0)
    with pytest.raises(sd.SpatialDynError, match="expected a mapping"):
        sd.solve_ik(model, np.eye(4))  # type: ignore[arg-type]
