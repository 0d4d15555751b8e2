"""The checked robot: trees, joints and links that are none are refused; inertias are judged and repaired."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from spatialdyn.errors import InertiaError, ModelError
from spatialdyn.model.builder import ModelBuilder
from spatialdyn.model.physical_inertia import ROUNDING, inertia_defect, nearest_physical
from spatialdyn.model.robot import Link, RobotJoint
from spatialdyn.model.robot_checks import check_tree, make_joint, make_link, pose_matrix, quoted, rpy_matrix

EYE = tuple(np.eye(4).ravel().tolist())
FLOOR = 1e-12  # of the largest moment: rounding of an eigen decomposition, with room


def joint(name: str = "j", kind: str = "revolute", parent: str = "a", child: str = "b", **fields: Any) -> RobotJoint:
    return RobotJoint(name, kind, parent, child, EYE, **fields)


def clouds(count: int) -> list[tuple[float, np.ndarray]]:
    """Masses and inertias about the com of random clouds of points: bodies by construction."""
    rng = np.random.default_rng(5)
    bodies = []
    for _ in range(count):
        points, masses = rng.normal(size=(4, 3)) * rng.uniform(0.01, 1, 3), rng.uniform(0.1, 2.0, 4)
        points -= masses @ points / masses.sum()
        second = (points.T * masses) @ points
        bodies.append((float(masses.sum()), np.trace(second) * np.eye(3) - second))
    return bodies


# --- inertias ---------------------------------------------------------------------------------------------


def test_clouds_of_points_have_no_defect_at_any_scale() -> None:
    for _, I in clouds(50):
        for scale in (1.0, 1e-20, 1e20):
            assert inertia_defect(scale * I) == ""


def test_rods_plates_and_points_are_bodies() -> None:
    R = rpy_matrix(0.3, 0.4, 0.5)
    for moments in ((1.0, 1.0, 0.0), (1.0, 2.0, 3.0), (0.0, 0.0, 0.0)):
        assert inertia_defect(R @ np.diag(moments) @ R.T) == ""


@pytest.mark.parametrize(
    ("moments", "expected"),
    [
        ((1.0, 1.0, 3.0), "the largest is 1.5 times the sum of the others"),
        ((-1.0, 2.0, 2.0), "expected none negative, and the largest is 2 times the sum"),
        ((0.0, 0.0, 3e-6), "the largest is inf times the sum of the others"),
        ((-5e-20, -5e-20, 0.0), "expected none negative"),
        ((1.0, 1.0, 2.0 + 4 * ROUNDING), "the largest is 1 times"),
    ],
)
def test_defects_are_said_in_words(moments: tuple[float, ...], expected: str) -> None:
    assert expected in inertia_defect(np.diag(moments))


def test_printing_six_digits_of_a_plate_is_no_defect() -> None:
    rng = np.random.default_rng(1)
    for a, b in rng.uniform(0.1, 1, size=(50, 2)):
        assert inertia_defect(np.diag([float(f"{x:.7g}") for x in (a, b, a + b)])) == ""


def test_repair_leaves_a_body_as_it_is_and_makes_one_of_anything() -> None:
    rng = np.random.default_rng(2)
    for _, I in clouds(20):
        np.testing.assert_allclose(nearest_physical(I), I, rtol=0, atol=FLOOR * abs(I).max())
    for _ in range(50):
        A = rng.normal(size=(3, 3))
        repaired = nearest_physical(A + A.T)
        assert inertia_defect(repaired) == ""
        np.testing.assert_allclose(nearest_physical(repaired), repaired, rtol=0, atol=FLOOR * abs(A).max() * 10)


def test_repair_is_nearest_among_bodies_nearby() -> None:
    rng = np.random.default_rng(3)
    bad = np.diag([0.1, 0.2, 1.0])
    second = lambda I: 0.5 * np.trace(I) * np.eye(3) - I  # noqa: E731
    best = np.linalg.norm(second(nearest_physical(bad)) - second(bad))
    for _ in range(200):
        A = np.linalg.cholesky(second(nearest_physical(bad)) + 1e-9 * np.eye(3)) + 0.05 * rng.normal(size=(3, 3))
        assert np.linalg.norm(A @ A.T - second(bad)) >= best


@pytest.mark.parametrize(
    "inertia",
    [
        (-1.0, np.zeros(3), np.eye(3)),
        (math.nan, np.zeros(3), np.eye(3)),
        (1.0, np.zeros(2), np.eye(3)),
        (1.0, (0.0, math.inf, 0.0), np.eye(3)),
        (1.0, np.zeros(3), np.full((3, 3), math.nan)),
        (1.0, np.zeros(3), np.triu(np.ones((3, 3)))),
        (1.0, np.zeros(3)),
        None,
    ],
)
def test_what_is_no_inertia_is_refused_by_name(inertia: Any) -> None:
    with pytest.raises(InertiaError, match='link "hand"'):
        make_link("hand", inertia)


# --- joints -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"kind": "ball"}, "has type 'ball', expected one of fixed"),
        ({"axis": (0.0, 0.0, 0.0)}, "has axis of norm 0, expected a nonzero vector"),
        ({"axis": (0.0, math.nan, 0.0)}, "expected three finite numbers"),
        ({"axis": (1.0, 0.0)}, "expected three finite numbers"),
        ({"lower": 1.0, "upper": -1.0}, "has lower limit 1.0 above upper limit -1.0"),
        ({"damping": math.nan}, "has damping nan"),
        ({"armature": -1.0}, "has armature -1.0, expected a finite number >= 0"),
        ({"armature": (0.1, math.nan)}, "has armature (0.1, nan), expected one number or 1"),
        ({"kind": "spherical", "armature": (0.1, math.nan, 0.0)}, "has armature (0.1, nan, 0.0), expected a finite"),
    ],
)
def test_what_is_no_joint_is_refused_by_name(fields: dict[str, Any], expected: str) -> None:
    with pytest.raises(ModelError, match='joint "j"') as caught:
        make_joint(joint(**fields))
    assert expected in str(caught.value)


def test_unit_axes_keep_their_bits_and_others_become_unit() -> None:
    for axis in ((0.6, 0.8, 0.0), (0.0, 0.0, 1.0)):
        assert make_joint(joint(axis=axis)).axis == axis
    for size in (1e-300, 1e-3, 1e300):
        made = make_joint(joint(axis=(0.0, 3.0 * size, -4.0 * size))).axis
        np.testing.assert_allclose(made, (0.0, 0.6, -0.8), rtol=0, atol=1e-15)


def test_what_is_no_pose_is_refused() -> None:
    for wrong in (np.zeros((4, 4)), np.diag([1.0, 1.0, -1.0, 1.0]), np.full(3, math.nan), np.eye(3)):
        with pytest.raises(ModelError, match="placement"):
            pose_matrix(wrong, "placement")


# --- trees ------------------------------------------------------------------------------------------------

A, B, C = Link("a"), Link("b"), Link("c")


@pytest.mark.parametrize(
    ("links", "joints", "expected"),
    [
        ([], [], 'robot "r" has no links'),
        ([A, A], [], '@link a: robot "r" has two links named "a"'),
        ([A, B, C], [joint(), joint(child="c")], '@joint j: robot "r" has two joints named "j"'),
        ([A], [joint()], '@joint j: joint "j" has child link "b"'),
        ([A, B], [joint(parent="x")], '@joint j: joint "j" has parent link "x"'),
        ([A, B], [joint(), joint("k")], '@joint k: link "b" is the child of joints "j" and "k", expected one parent'),
        ([A, B], [joint(), joint("k", parent="b", child="a")], "no root link: its joints form a cycle"),
        ([A, B, C], [joint("j", parent="b", child="c"), joint("k", parent="c")], '@link b: link "b" hangs on a cycle'),
        ([A, B, C], [joint()], '@link c: robot "r" has 2 root links ("a", "c"), expected one'),
        ([A, B], [joint("j", parent="b"), ], '@link b: link "b" hangs on a cycle'),
    ],
)  # fmt: skip
def test_what_is_no_tree_is_refused_with_its_place(links: list[Link], joints: list[RobotJoint], expected: str) -> None:
    with pytest.raises(ModelError) as caught:
        check_tree("r", links, joints, where=lambda kind, name: f"@{kind} {name}: ")
    assert expected in str(caught.value)


def test_children_are_in_byte_order_of_their_joints() -> None:
    names = ["j10", "j2", "Alpha", "alpha", "é"]
    links = [A, *(Link(f"to {name}") for name in names)]
    robot = check_tree("r", links, [joint(name, child=f"to {name}") for name in names])
    assert [j.name for j in robot.children["a"]] == ["Alpha", "alpha", "j10", "j2", "é"]


def test_the_builder_makes_the_robot_of_its_calls() -> None:
    rod = (1.0, (0.0, 0.0, -0.5), np.diag([1 / 12, 1 / 12, 1e-3]))
    b = ModelBuilder("arm").add_body("upper", axis=(0, 2, 0), inertia=rod)
    robot = b.add_body("lower", "upper", placement=((0, 0, -1), (0, 0, 0.1)), inertia=rod).robot()
    assert [link.name for link in robot.links] == ["base", "upper", "lower"]
    assert robot.joints[0].axis == (0.0, 1.0, 0.0)
    assert np.reshape(robot.joints[1].placement, (4, 4))[2, 3] == -1.0
    with pytest.raises(ModelError, match='two links named "upper"'):
        b.add_body("upper")
    with pytest.raises(ModelError, match='"nowhere"'):
        b.add_body("x", "nowhere")
    with pytest.raises(ModelError, match='link "x" is not in robot "arm"'):
        b.set_inertia("x", rod)


def test_long_lists_of_names_are_cut() -> None:
    assert quoted("abc") == '"a", "b", "c"'
    assert quoted("abcd", most=2) == '"a", "b" and 2 more'
