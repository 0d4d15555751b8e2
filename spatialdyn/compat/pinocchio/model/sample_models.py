"""The sample models: a manipulator, a humanoid, and a humanoid with random bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..types.frame import BODY, Frame
from ..types.inertia import Inertia
from ..types.random import GENERATOR
from ..types.se3 import SE3
from .joint import JointModel
from .joints import (
    JointModelComposite,
    JointModelFreeFlyer,
    JointModelMimic,
    JointModelRX,
    JointModelRY,
    JointModelRZ,
    JointModelSphericalZYX,
    JointModelTranslation,
)
from .model import Model

__all__ = ["buildSampleModelHumanoid", "buildSampleModelHumanoidRandom", "buildSampleModelManipulator"]

ANGLE, MOST = 3.14, 10.0  # limits of angles, and of torques and velocities
SCALING, OFFSET = 2.5, 0.75  # of the joint that mimics
SMALL = (0.1, 0.0, 0.01)  # mass, height of the centre of mass, moments
LARGE = (1.0, 0.5, 1.0)
UP = (0.0, 0.0, 1.0)


def buildSampleModelManipulator(mimic: bool = False) -> Model:
    """An arm of six joints; with ``mimic`` the last one follows the one before."""
    model = Model()
    _arm(model, 0, SE3.Identity(), "", mimic)
    return model


def buildSampleModelHumanoid(using_free_flyer: bool = True) -> Model:
    """A humanoid of 28 joints and its root, a free flyer or a translation and three angles."""
    model = Model()
    root = _root(model, using_free_flyer)
    model.appendBodyToJoint(root, _body(SMALL), SE3.Identity())
    for side, y in (("rleg", -0.2), ("lleg", 0.2)):
        _arm(model, root, _upside_down(0.0, y, -0.1), f"{side}_")
        foot = model.jointPlacements[model.njoints - 1]
        foot.rotation = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    at = _link(model, root, JointModelRX(), "chest1", SE3.Identity(), SMALL)
    chest = _link(model, at, JointModelRY(), "chest2", SE3.Identity(), LARGE)
    at = _link(model, chest, JointModelRX(), "head1", _at(UP), SMALL)
    _link(model, at, JointModelRY(), "head2", SE3.Identity(), LARGE)
    for side, y in (("rarm", -0.3), ("larm", 0.3)):
        _arm(model, chest, _upside_down(0.0, y, 1.0), f"{side}_")
    return model


def buildSampleModelHumanoidRandom(using_free_flyer: bool = True, mimic: bool = False) -> Model:
    """A humanoid of 26 joints and its root with random placements, bodies and limits; see ``seed``."""
    model = Model()
    root = _root(model, using_free_flyer)
    if using_free_flyer:
        model.lowerPositionLimit[:3], model.upperPositionLimit[:3] = -1.0 - _shares(3), 1.0 + _shares(3)
        model.lowerPositionLimit[3:7], model.upperPositionLimit[3:7] = -1.0, 1.0
    model.appendBodyToJoint(root, Inertia.Random(), SE3.Identity())
    model.addBodyFrame("root_body", root, SE3.Identity())
    leg = (JointModelRX, JointModelRY, JointModelRZ, JointModelRY, JointModelRY, JointModelRX)
    chest = root
    for limb, parent, kinds in (
        ("lleg", 0, leg),
        ("rleg", 0, leg),
        ("torso", 0, (JointModelRY,)),
        ("chest", 1, (JointModelRZ,)),
        ("rarm", 2, leg),
        ("larm", 2, leg),
    ):
        at = (root, model.njoints - 1, chest)[parent]
        for k, kind in enumerate(kinds, start=1):
            joint: JointModel = kind()
            if mimic and limb == "larm" and k == len(kinds):
                joint = JointModelMimic.of(joint, model.joints[at], SCALING, OFFSET)
            name = limb if limb == "chest" else f"{limb}{k}"
            at = _random_link(model, at, joint, name)
        chest = at if limb == "chest" else chest
    return model


# --- pieces ------------------------------------------------------------------------------------------------


def _root(model: Model, free_flyer: bool) -> int:
    joint: JointModel = JointModelFreeFlyer()
    if not free_flyer:
        joint = JointModelComposite(JointModelTranslation()).addJoint(JointModelSphericalZYX())
    index = model.addJoint(0, joint, SE3.Identity(), "root_joint")
    if free_flyer:
        model.lowerPositionLimit[3:7], model.upperPositionLimit[3:7] = -1.0, 1.0
    model.addJointFrame(index)
    return index


def _arm(model: Model, parent: int, placement: SE3, prefix: str, mimic: bool = False) -> None:
    """Add a shoulder of three joints, an elbow, and a wrist of two."""
    at = _link(model, parent, JointModelRX(), f"{prefix}shoulder1", placement, SMALL)
    at = _link(model, at, JointModelRY(), f"{prefix}shoulder2", SE3.Identity(), SMALL)
    at = _link(model, at, JointModelRZ(), f"{prefix}shoulder3", SE3.Identity(), None)
    _bar(model, at, f"{prefix}upperarm")
    at = _link(model, at, JointModelRY(), f"{prefix}elbow", _at(UP), None)
    _bar(model, at, f"{prefix}lowerarm")
    at = _link(model, at, JointModelRX(), f"{prefix}wrist1", _at(UP), SMALL)
    last: JointModel = JointModelRY()
    if mimic:
        last = JointModelMimic.of(last, model.joints[at], SCALING, OFFSET)
    at = _link(model, at, last, f"{prefix}wrist1_mimic" if mimic else f"{prefix}wrist2", SE3.Identity(), None)
    _bar(model, at, f"{prefix}effector")


def _link(
    model: Model, parent: int, joint: JointModel, name: str, placement: SE3, body: tuple[float, float, float] | None
) -> int:
    """Add a joint, its frame, a body frame and, if given, a body; returns the joint."""
    most, angle = np.full(joint.nv, MOST), np.full(joint.nq, ANGLE)
    index = model.addJoint(parent, joint, placement, f"{name}_joint", most, most, -angle, angle)
    model.addJointFrame(index, -1)
    if body is not None:
        model.appendBodyToJoint(index, _body(body), SE3.Identity())
    model.addBodyFrame(f"{name}_body", index, SE3.Identity())
    return index


def _bar(model: Model, joint: int, name: str) -> None:
    """Add a body of 1 kg along a joint's z axis, and its frame."""
    model.appendBodyToJoint(joint, _body(LARGE), SE3.Identity())
    before = model.getFrameId(model.names[joint])
    model.addFrame(Frame(f"{name}_body", joint, before, SE3.Identity(), BODY))


def _random_link(model: Model, parent: int, joint: JointModel, name: str) -> int:
    one = joint.nv
    limits = [_shares(one) + 0.01 for _ in range(2)]
    index = model.addJoint(
        parent, joint, SE3.Random(), f"{name}_joint", *limits, -2.0 * _shares(one), 2.0 * _shares(one)
    )
    model.addJointFrame(index, -1)
    model.appendBodyToJoint(index, Inertia.Random(), SE3.Identity())
    model.addBodyFrame(f"{name}_body", index, SE3.Identity())
    return index


def _body(numbers: tuple[float, float, float]) -> Inertia:
    mass, height, moment = numbers
    return Inertia(mass, np.array([0.0, 0.0, height]), moment * np.eye(3))


def _at(p: tuple[float, float, float]) -> SE3:
    return SE3(np.eye(3), np.array(p))


def _upside_down(x: float, y: float, z: float) -> SE3:
    return SE3(np.diag([1.0, -1.0, -1.0]), np.array([x, y, z]))


def _shares(n: int) -> NDArray[np.float64]:
    """Numbers between 0 and 1."""
    return GENERATOR.random(n)
