"""Constraints of models with mimic joints: the equations of the whole tree, reduced by v_tree = G v."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plain import mimics_in_plain_python
from slow import slow_but

import spatialdyn as sd
import spatialdyn.compat.pinocchio as face

CLOSE = 1e-10  # relative, of solutions with matrices of condition up to 1e4
KINDS = ("CONTACT_3D", "CONTACT_6D")
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>
<origin xyz="0.1 {4} 0.2" rpy="0.3 0.1 0"/><axis xyz="{5}"/>
<limit lower="-2" upper="2" effort="9" velocity="9"/>{6}</joint>"""
LINK = """<link name="{0}"><inertial><mass value="{1}"/><origin xyz="0.02 0.01 0.1"/>
<inertia ixx="0.04" iyy="0.05" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial></link>"""
URDF = '<robot name="hand">' + "".join(
    [
        '<link name="world"/>', *(LINK.format(name, 0.5 + 0.3 * k) for k, name in enumerate("abcdef")),
        JOINT.format("j1", "revolute", "world", "a", 0, "0 0 1", ""),
        JOINT.format("j2", "revolute", "a", "b", 0, "0 1 0", ""),
        JOINT.format("j3", "prismatic", "b", "c", 0.1, "0 1 0", ""),
        JOINT.format("j4", "revolute", "b", "d", -0.1, "1 0 0", '<mimic joint="j3" multiplier="-1.5" offset="0.2"/>'),
        JOINT.format("j5", "revolute", "d", "e", 0, "0 1 0", ""),
        JOINT.format("j6", "revolute", "e", "f", 0, "0 0 1", '<mimic joint="j2" multiplier="0.5" offset="0"/>'),
    ]
) + "</robot>"  # fmt: skip


class Hand:
    """The model with mimic joints and the one of the whole tree, at one state of both."""

    def __init__(self) -> None:
        self.model, self.tree = (face.buildModelFromXML(URDF, mimic=mimic) for mimic in (True, False))
        self.data, self.tree_data = self.model.createData(), self.tree.createData()
        rng = np.random.default_rng(0)
        names = [self.model.names[k] for k in range(1, self.model.njoints)]
        own = {name: k for k, name in enumerate(["j1", "j2", "j3", "j5"])}
        follow = {"j4": ("j3", -1.5, 0.2), "j6": ("j2", 0.5, 0.0)}
        self.q, self.v, self.tau = 0.4 * rng.normal(size=4), rng.normal(size=4), rng.normal(size=4)
        self.G, self.at = np.zeros((6, 4)), np.zeros(6)
        for i, name in enumerate(names):
            leader, ratio, offset = follow.get(name, (name, 1.0, 0.0))
            self.G[i, own[leader]], self.at[i] = ratio, ratio * self.q[own[leader]] + offset
        self.speed = self.G @ self.v

    def contacts(self, model: Any, reference: str, kind: str) -> tuple[Any, Any]:
        """A frame of the last link held, and a loop between two others."""
        rng = np.random.default_rng(1)
        places = [face.SE3(face.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(3)]
        made, at = getattr(face.ContactType, kind), getattr(face.ReferenceFrame, reference)
        ids = [model.getJointId(name) for name in ("j6", "j3", "j4")]
        models = [face.RigidConstraintModel(made, model, ids[0], places[0], at)]
        if kind == "CONTACT_3D":
            models.append(face.RigidConstraintModel(made, model, ids[1], places[1], ids[2], places[2], at))
        for one in models:
            one.setBaumgarteCorrectorParameters(face.BaumgarteCorrectorParameters(3.0, 7.0))
        return models, [one.createData() for one in models]

    def solution(self, J: Any, gamma: Any, mu: float) -> tuple[Any, Any]:
        """a and λ of the reduced equations, with M and bias of the whole tree."""
        M = self.G.T @ face.crba(self.tree, self.tree_data, self.at) @ self.G
        bias = self.G.T @ face.nonLinearEffects(self.tree, self.tree_data, self.at, self.speed)
        K = np.block([[M, -J.T], [J, mu * np.eye(len(J))]])
        x = np.linalg.solve(K, np.r_[self.tau - bias, -gamma])
        return x[:4], x[4:]


def close(x: Any, y: Any) -> None:
    assert np.shape(x) == np.shape(y)
    assert abs(np.asarray(x) - y).max() <= CLOSE * max(1.0, abs(np.asarray(y)).max())


@pytest.mark.parametrize(
    ("kind", "reference"),
    slow_but([("CONTACT_3D", "LOCAL")], [(k, r) for k in KINDS for r in ("LOCAL", "LOCAL_WORLD_ALIGNED")]),
)  # fmt: skip
def test_dynamics_and_jacobians_are_those_of_the_tree_times_G(
    kind: str, reference: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six rows of four velocities, softened by mu: a and λ, the derivatives against differences of a.

    The slow ones run compiled kernels of the model, the quick one its recursions in plain Python.
    """
    if (kind, reference) == ("CONTACT_3D", "LOCAL"):
        mimics_in_plain_python(monkeypatch)
    hand, mu = Hand(), 1e-2
    models, datas = hand.contacts(hand.model, reference, kind)
    settings = face.ProximalSettings(0.0, mu, 1)

    def dynamics(q: Any, v: Any, tau: Any) -> Any:
        data = hand.model.createData()
        a = face.constraintDynamics(hand.model, data, q, v, tau, models, datas, settings)
        return np.r_[a, data.lambda_c]

    a = face.constraintDynamics(hand.model, hand.data, hand.q, hand.v, hand.tau, models, datas, settings)
    force = np.array(hand.data.lambda_c)
    J = face.getConstraintsJacobian(hand.model, hand.data, models, datas)
    more, more_datas = hand.contacts(hand.tree, reference, kind)
    face.constraintDynamics(
        hand.tree, hand.tree_data, hand.at, hand.speed, np.zeros(6), more, more_datas, face.ProximalSettings(0.0, mu, 1)
    )
    whole = face.getConstraintsJacobian(hand.tree, hand.tree_data, more, more_datas)
    close(J, whole @ hand.G)
    gamma = -(whole @ hand.tree_data.ddq + mu * hand.tree_data.lambda_c)
    for found, wanted in zip((a, force), hand.solution(J, gamma, mu), strict=True):
        close(found, wanted)
    for one, other in zip(datas, more_datas, strict=True):
        close(one.contact_velocity_error.vector, other.contact_velocity_error.vector)
    M = face.crba(hand.model, hand.data, hand.q)
    G = face.computeDelassusMatrix(hand.model, hand.data, hand.q, models, datas)
    close(G, J @ np.linalg.solve(M, J.T))
    face.constraintDynamics(hand.model, hand.data, hand.q, hand.v, hand.tau, models, datas, settings)
    parts = face.computeConstraintDynamicsDerivatives(hand.model, hand.data, models, datas, settings)
    given, h = (hand.q, hand.v, hand.tau), 1e-6
    for k in range(3):
        step = np.eye(4) * h
        ends = [[dynamics(*(x + s * e * (i == k) for i, x in enumerate(given))) for e in step] for s in (1.0, -1.0)]
        slopes = ((np.array(ends[0]) - ends[1]) / (2.0 * h)).T
        for found, wanted in ((parts[k], slopes[:4]), (parts[3 + k], slopes[4:])):
            assert abs(found - wanted).max() <= 1e-6 * max(1.0, abs(wanted).max())


def test_forward_dynamics_impacts_and_factors_are_those_of_the_tree_times_G(monkeypatch: pytest.MonkeyPatch) -> None:
    mimics_in_plain_python(monkeypatch)
    hand = Hand()
    J, gamma = np.random.default_rng(2).normal(size=(2, 4)), np.array([0.3, -0.2])
    a = face.forwardDynamics(hand.model, hand.data, hand.q, hand.v, hand.tau, J, gamma)
    wanted, force = hand.solution(J, gamma, 0.0)
    close(a, wanted)
    close(hand.data.lambda_c, force)
    M = hand.G.T @ face.crba(hand.tree, hand.tree_data, hand.at) @ hand.G
    after = face.impulseDynamics(hand.model, hand.data, hand.q, hand.v, J, 0.3)
    close(J @ after, -0.3 * J @ hand.v)
    close(M @ (after - hand.v), J.T @ hand.data.impulse_c)
    inverse = face.computeKKTContactDynamicMatrixInverse(hand.model, hand.data, hand.q, J)
    close(inverse @ np.block([[M, J.T], [J, np.zeros((2, 2))]]), np.eye(6))
    face.crba(hand.model, hand.data, hand.q)
    U = face.cholesky.decompose(hand.model, hand.data)
    close(U @ np.diag(hand.data.D) @ U.T, M)
    assert (np.tril(U, -1) == 0.0).all()
    close(face.cholesky.solve(hand.model, hand.data, hand.tau), np.linalg.solve(M, hand.tau))
    close(face.cholesky.computeMinv(hand.model, hand.data), np.linalg.inv(M))


def test_subtree_centres_of_mass_move_with_the_joints_that_mimic(monkeypatch: pytest.MonkeyPatch) -> None:
    mimics_in_plain_python(monkeypatch)
    hand = Hand()
    for joint in ("j2", "j4"):
        k, whole = hand.model.getJointId(joint), hand.tree.getJointId(joint)
        J = face.jacobianSubtreeCenterOfMass(hand.model, hand.data, hand.q, k)
        close(J, face.jacobianSubtreeCenterOfMass(hand.tree, hand.tree_data, hand.at, whole) @ hand.G)


def test_dependent_rows_name_their_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    mimics_in_plain_python(monkeypatch)
    hand, row = Hand(), np.ones((1, 4))
    with pytest.raises(sd.ConstraintError, match="J has rank 1, expected its 2 rows to be independent"):
        face.forwardDynamics(hand.model, hand.data, hand.q, hand.v, hand.tau, np.vstack([row, 2 * row]), np.zeros(2))
