"""Forces in joints and centres of mass of subtrees: by hand, and the laws that tie them to the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from trees import KINDS, SCREWS, random_state, random_tree

import spatialdyn as sd
from spatialdyn.recursions import SPECS

CLOSE = 2e-12  # of the largest entry: a dozen joints, each a few eps


def close(x: Any, y: Any) -> None:
    assert np.shape(x) == np.shape(y)
    assert np.max(abs(np.subtract(x, y)), initial=0.0) <= CLOSE * np.max(abs(np.asarray(y)), initial=1.0)


TREES = [*((seed, floating) for seed in range(3) for floating in (False, True)), (3, True)]


@pytest.fixture(params=TREES, scope="module")
def case(request: pytest.FixtureRequest) -> Any:
    seed, floating = request.param
    made = random_tree(seed, 9, SCREWS if seed == 3 else KINDS, floating)
    return made.model, random_state(made.tree, np.random.default_rng(seed))


def test_a_swinging_bob_pulls_on_its_hinge_with_its_weight_and_centrifugal_force() -> None:
    builder = sd.ModelBuilder("bob").add_body(
        "bob", None, "revolute", axis=(0, 1, 0), inertia=(2.0, (0, 0, -0.5), np.zeros((3, 3)))
    )
    F = sd.joint_forces(builder.build(), [0.0], [3.0], [0.0])
    close(F, [np.zeros(6), [0, 0, 2.0 * (9.81 + 3.0**2 * 0.5), 0, 0, 0]])


def test_a_torque_is_the_part_of_the_joint_force_along_the_joint(case: Any) -> None:
    model, s = case
    F, tau = sd.joint_forces(model, s.q, s.v, s.a, s.fext), sd.rnea(model, s.q, s.v, s.a, s.fext)
    for joint in model.joints[1:]:
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        S = sd.frame_jacobian(model, s.q, f"joint:{joint.name}")[:, own]
        close(S.T @ F[model.names.index(joint.name)] + model.armature[own] * s.a[own], tau[own])


def test_forces_on_the_world_and_weight_change_the_momentum(case: Any) -> None:
    """All that acts on the robot from outside is the rate of change of its momentum about its centre of mass."""
    model, s = case
    X = sd.forward_kinematics(model, s.q)
    F = sd.joint_forces(model, s.q, s.v, s.a, s.fext)
    weight = np.r_[model.gravity, np.zeros(3)]
    at_root = np.zeros(6)
    for k, joint in enumerate(model.joints[1:], 1):
        if model.bodies[joint.row - joint.nv + 1]["parent"] == 0:
            at_root += _moved(X[k], F[k])
        at_root += _moved(X[k], s.fext[k])
    c, m = sd.center_of_mass(model, s.q), model.total_mass
    about_com = at_root - np.r_[np.zeros(3), np.cross(c, at_root[:3])]
    close(about_com + m * weight, sd.centroidal_momentum_rate(model, s.q, s.v, s.a))


def _moved(X: Any, f: Any) -> Any:
    """A force in a body's frame, in the world's."""
    linear = X[:3, :3] @ f[:3]
    return np.r_[linear, X[:3, :3] @ f[3:] + np.cross(X[:3, 3], linear)]


def test_the_subtree_of_the_world_is_the_robot(case: Any) -> None:
    model, s = case
    close(sd.subtree_centers_of_mass(model, s.q)[0], sd.center_of_mass(model, s.q))
    close(sd.subtree_com_velocities(model, s.q, s.v)[0], sd.center_of_mass_velocity(model, s.q, s.v))
    close(sd.subtree_com_accelerations(model, s.q, s.v, s.a)[0], sd.center_of_mass_acceleration(model, s.q, s.v, s.a))


def test_a_subtree_alone_has_the_same_centre_of_mass(case: Any) -> None:
    """Its velocity is the mean of the velocities of the bodies' centres, weighted by mass."""
    model, s = case
    X = sd.forward_kinematics(model, s.q)
    V, A = sd.joint_velocities(model, s.q, s.v), sd.joint_accelerations(model, s.q, s.v, s.a)
    rows = [joint.row for joint in model.joints]
    m = np.array([model.bodies[r]["inertia"]["m"] for r in rows])
    c = [np.array(model.bodies[r]["inertia"]["h"].tolist()) / max(mk, 1e-300) for r, mk in zip(rows, m, strict=True)]
    points, speeds, rates = [], [], []
    for T, ck, vk, ak in zip(X, c, V, A, strict=True):
        R, speed = T[:3, :3], vk[:3] + np.cross(vk[3:], ck)
        points.append(R @ ck + T[:3, 3])
        speeds.append(R @ speed)
        rates.append(R @ (ak[:3] + np.cross(ak[3:], ck) + np.cross(vk[3:], speed)))
    found = (
        sd.subtree_centers_of_mass(model, s.q),
        sd.subtree_com_velocities(model, s.q, s.v),
        sd.subtree_com_accelerations(model, s.q, s.v, s.a),
    )
    for k, joint in enumerate(model.joints[1:], 1):
        first, last = joint.row - joint.nv + 1, model.bodies[joint.row]["last_row"]
        inside = [i for i, r in enumerate(rows) if first <= r <= last]
        R = X[k][:3, :3]
        for x, each, p in zip(found, (points, speeds, rates), (X[k][:3, 3], 0.0, 0.0), strict=True):
            mean = sum(m[i] * each[i] for i in inside) / m[inside].sum()
            close(x[k], R.T @ (mean - p))


def test_a_subtree_without_mass_rests_where_its_joint_is() -> None:
    builder = sd.ModelBuilder("arm")
    builder.add_body("arm", None, "revolute", axis=(0, 1, 0), inertia=(2.0, (0, 0, -0.5), np.eye(3)))
    builder.add_body(
        "tip", "arm", "revolute", axis=(0, 1, 0), placement=(0, 0, -1), inertia=(0.0, (0, 0, 0), 0 * np.eye(3))
    )
    model = builder.build()
    q, v = [0.3, 0.2], [1.0, 2.0]
    close(sd.subtree_centers_of_mass(model, q)[2], np.zeros(3))
    close(sd.subtree_com_velocities(model, q, v)[2], np.zeros(3))
    close(sd.subtree_com_accelerations(model, q, v, v)[2], np.zeros(3))


@pytest.mark.parametrize("name", ["joint_velocities", "joint_accelerations", "joint_forces"])
def test_the_worlds_row_is_zero(case: Any, name: str) -> None:
    model, s = case
    given = [getattr(s, x.name) for x in SPECS[name].present]
    assert not getattr(sd, name)(model, *given)[0].any()
