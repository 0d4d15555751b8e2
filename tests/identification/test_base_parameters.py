"""Base parameters: ranks by hand and of known robots, torques of the base alone, and where there is no rank."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from example_runs import compiled, robots
from robots import ROBOTS

import spatialdyn as sd
from spatialdyn.identification.base import base_of_columns
from spatialdyn.identification.unknowns import unknowns_of

SAME = 1e-11  # of the largest torque: a solution with a triangle of condition some 100


def loaded(name: str, **options: object) -> sd.Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sd.load_urdf(name, **options)  # type: ignore[arg-type]


def test_a_pendulum_has_three_and_a_planar_arm_six() -> None:
    """m c in the plane and the inertia about the axis; of the second link also its mass, regrouped into the first."""
    pendulum = sd.base_parameters(loaded("pendulum"))
    assert [pendulum.text(k) for k in range(pendulum.rank)] == ["swing.mx", "swing.mz", "swing.Iyy"]
    arm = sd.base_parameters(loaded("two_link"))
    assert [arm.text(k) for k in range(arm.rank)] == [
        "joint1.mx + joint2.m", "joint1.mz", "joint1.Iyy + joint2.m", "joint2.mx", "joint2.mz", "joint2.Iyy",
    ]  # fmt: skip
    assert sd.base_parameters(loaded("two_link"), "friction+offset+armature").rank == 8  # of each joint its own


def test_torques_are_those_of_the_base_alone() -> None:
    model, rng = loaded("three_link"), np.random.default_rng(0)
    base = sd.base_parameters(model)
    q, v, a = rng.normal(size=(3, 50, model.nv))
    W = sd.joint_torque_regressor(model, q, v, a)[:, :, 1:].reshape(150, -1)
    pi = rng.normal(size=W.shape[1])
    assert abs(W[:, base.columns] @ (base.K @ pi) - W @ pi).max() < SAME * abs(W @ pi).max()
    assert base.rank == np.linalg.matrix_rank(W, tol=1e-9 * np.linalg.norm(W, 2)) == 15


@robots
@compiled
@pytest.mark.parametrize(("name", "rank"), [("double_pendulum", 5), ("panda", 43), ("ur5_robot", 36), ("kinova", 36)])
def test_ranks_of_arms(name: str, rank: int) -> None:
    """7 n - 6 of a panda's seven joints: columns that are zero but for a rounded π/2 would add one."""
    model = loaded(name)
    if name == "panda":
        model = model.reduced([x for x in model.names if "finger" in x])
    assert sd.base_parameters(model).rank == rank


@robots
@compiled
def test_what_a_load_shows_at_the_joints_of_an_arm() -> None:
    """All ten to all joints and to the last three, nine to the last two, seven to the last; at rest m and h alone."""
    model, rng = loaded("ur5_robot"), np.random.default_rng(0)
    load = unknowns_of(model, "inertial", "tool0")
    q, v, a = rng.normal(size=(3, 300, 6))

    def rank(speed: float, first: int) -> int:
        Y = sd.joint_torque_regressor(model, q, speed * v, speed * a)
        W = load.stacked(Y, speed * a, speed * v, np.sign(v))[:, first:].reshape(-1, 10)
        return int(np.linalg.matrix_rank(W, tol=1e-9 * np.linalg.norm(W, 2)))

    assert [rank(1.0, first) for first in (0, 3, 4, 5)] == [10, 10, 9, 7]
    assert rank(0.0, 0) == 4
    assert sd.base_parameters(model, payload="tool0").rank == 10


def of_gravity(name: str, gravity: tuple[float, float, float]) -> int:
    return sd.base_parameters(loaded(name, gravity=gravity)).rank


@robots
@compiled
@pytest.mark.slow(quick="test_ranks_of_arms")
def test_ranks_of_larger_robots_and_other_gravity() -> None:
    assert of_gravity("ur5_robot", (3.0, 1.0, -9.0)) == 38
    assert of_gravity("ur5_robot", (0.0, 0.0, 0.0)) == 34
    for name, rank in {"tree": 45, "ur10_robot": 36, "z1": 43, "xarm7": 43, "talos_reduced": 206}.items():
        assert sd.base_parameters(loaded(name)).rank == rank, name
    if "anymal_b_simple_description/anymal" in ROBOTS:
        anymal = loaded("anymal_b_simple_description/anymal", root="floating")
        bases = [sd.base_parameters(anymal, rows=rows) for rows in ("all", "base")]
        assert [base.rank for base in bases] == [94, 94]  # six rows see as much (Ayusawa, Venture, Nakamura)
        assert len(bases[0].names) == 130


def test_fewer_rows_than_columns_are_refused() -> None:
    assert sd.base_parameters(loaded("two_link"), samples=10).rank == 6
    with pytest.raises(sd.IdentificationError, match="samples is 9, expected 0, or 10 or more"):
        sd.base_parameters(loaded("two_link"), samples=9)


def test_pivots_without_a_gap_are_refused() -> None:
    R = np.diag([1.0, 1.0, 1.0])
    R[0, 1], R[1, 1] = 1.0, 5e-9
    R[0, 2], R[2, 2] = 1.0, 5e-11
    with pytest.raises(sd.IdentificationError, match="snap=1e-9"):
        base_of_columns(R, ("a", "b", "c"))
