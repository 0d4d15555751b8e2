"""The inverse operational-space inertia: by hand, against J M⁻¹ Jᵀ on any tree, and of two frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dense import REFERENCES
from trees import random_state, random_tree

import spatialdyn as sd

EPS = np.finfo(float).eps
CLOSE = 1e4 * EPS  # of the largest entry: two ways to M⁻¹, of trees whose M has a condition of some hundreds
BY_HAND = 1e-14  # relative, of a closed form
GRIPPER = (
    '<robot name="r"><link name="w"/>{}<joint name="j1" type="revolute"><origin xyz="0 0 0.3"/><parent link="w"/>'
    '<child link="a"/><axis xyz="0 1 0"/><limit effort="1" velocity="1" lower="-1" upper="1"/></joint>'
    '<joint name="j2" type="revolute"><origin xyz="0.1 0 0.3"/><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>'
    '<limit effort="1" velocity="1" lower="-1" upper="1"/><mimic joint="j1" multiplier="-0.5" offset="0.2"/></joint>'
    '<joint name="j3" type="revolute"><origin xyz="0 0 0.2"/><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>'
    '<limit effort="1" velocity="1" lower="-1" upper="1"/></joint></robot>'
)
LINK = (
    '<link name="{}"><inertial><origin xyz="0.1 0.02 0.1"/><mass value="2"/>'
    '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)


def close(x: Any, y: Any) -> None:
    assert abs(x - y).max() <= CLOSE * abs(y).max()


def formed(model: sd.Model, q: Any, frame: Any, other: Any, reference: str) -> Any:
    """J M⁻¹ J₂ᵀ."""
    J, J2 = (sd.frame_jacobian(model, q, x, reference) for x in (frame, other))
    return J @ np.linalg.solve(sd.crba(model, q), J2.T)


def wrist() -> sd.Model:
    """An arm with a rotor on a moving link and a differential between two joints of the wrist."""
    b = sd.ModelBuilder("arm")
    solid = (1.0, (0.1, 0.02, -0.05), np.diag([0.1, 0.2, 0.15]))
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1))):
        rotor = sd.Rotor(0.01, 20.0, (0, 0, 1)) if k == 1 else None
        b.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, (0.1, 0.2, 0.3), solid, f"j{k}", rotor=rotor)
    A = np.array([[0.5, 0.5], [0.5, -0.5]]) / 20.0
    return b.build().with_(transmissions=[sd.Transmission(("j2", "j3"), A, np.array([2e-2, 7e-2]))])


ROBOTS: dict[str, Any] = {
    "arm": lambda: random_tree(1, 6).model, "floating": lambda: random_tree(2, 6, floating=True).model, "wrist": wrist,
    "mimic": lambda: sd.load_urdf(GRIPPER.format("".join(LINK.format(x) for x in "abc")), mimic=True),
}  # fmt: skip


def test_two_point_masses_have_the_closed_form() -> None:
    """Λ = m₂ 1 + m₁ / sin²q₂ u uᵀ in the plane, u along the second link; Kane's form of a planar 2R."""
    m1, m2, l1, l2 = 1.3, 0.7, 0.9, 1.1
    b = sd.ModelBuilder("2R")
    b.add_body("a", None, "revolute", (0, 1, 0), None, (m1, (l1, 0, 0), np.zeros((3, 3))))
    b.add_body("b", "a", "revolute", (0, 1, 0), (l1, 0, 0), (m2, (l2, 0, 0), np.zeros((3, 3))))
    model = b.add_body("tip", "b", "fixed", placement=(l2, 0, 0)).build()
    for q in ([0.3, 1.2], [-1.0, np.pi / 2], [0.2, 0.15]):
        found = sd.operational_space_inertia_inverse(model, q, "tip", "local_world_aligned")[::2, ::2][:2, :2]
        u = np.array([np.cos(q[0] + q[1]), -np.sin(q[0] + q[1])])
        wanted = m2 * np.eye(2) + m1 / np.sin(q[1]) ** 2 * np.outer(u, u)
        np.testing.assert_allclose(found @ wanted, np.eye(2), atol=BY_HAND * np.linalg.cond(wanted))


@pytest.mark.parametrize("kind", ROBOTS)
def test_it_is_j_minv_jt_of_every_frame(kind: str) -> None:
    model = ROBOTS[kind]()
    q = sd.random_configuration(model, np.random.default_rng(3))
    for frame in model.frames[1:]:
        for reference in REFERENCES:
            found = sd.operational_space_inertia_inverse(model, q, frame, reference)
            wanted = formed(model, q, frame, frame, reference)
            if abs(wanted).max() > 0.0:
                close(found, wanted)
            np.testing.assert_array_equal(found, found.T if kind != "mimic" else found)


def test_a_frame_of_the_world_does_not_move() -> None:
    model = random_tree(1, 3).model
    assert not sd.operational_space_inertia_inverse(model, random_state(random_tree(1, 3).tree,
        np.random.default_rng(0)).q, model.frames[0]).any()  # fmt: skip


@pytest.mark.parametrize("kind", ROBOTS)
def test_two_frames_answer_each_others_forces(kind: str) -> None:
    model = ROBOTS[kind]()
    q = sd.random_configuration(model, np.random.default_rng(4))
    one, two = model.frames[-1], model.frames[len(model.frames) // 2]
    for reference in REFERENCES:
        found = sd.operational_space_coupling(model, q, one, two, reference)
        close(found, formed(model, q, one, two, reference))
        close(found.T, sd.operational_space_coupling(model, q, two, one, reference))
