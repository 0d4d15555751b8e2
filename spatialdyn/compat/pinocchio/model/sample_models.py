"""The sample models: a manipulator, a humanoid, and a humanoid with random bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....errors import ModelError
from ..types.arguments import Array, expected
from ..types.frame import BODY, Frame
from ..types.inertia import Inertia
from ..types.random import GENERATOR
from ..types.se3 import SE3
from . import joints
from .coal_shapes import Described
from .geometry import GeometryModel
from .geometry_object import GeometryObject
from .joint import JointModel
from .model import Model

__all__ = [
    "buildSampleGeometryModelHumanoid", "buildSampleGeometryModelManipulator", "buildSampleModelHumanoid",
    "buildSampleModelHumanoidRandom", "buildSampleModelManipulator",
]  # fmt: skip

ANGLE, MOST = 3.14, 10.0  # limits of angles, and of torques and velocities
SCALING, OFFSET = 2.5, 0.75  # of the joint that mimics
SMALL = Inertia.over(np.array([0.1, 0.0, 0.0, 0.0, 0.01, 0.0, 0.01, 0.0, 0.0, 0.01]))  # 0.1 kg at the joint
LARGE = Inertia.over(np.array([1.0, 0.0, 0.0, 0.5, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0]))  # 1 kg at half a metre
# a metre along z; SE3(...) would look for a compiled operator, and so import Numba with this module
UP = SE3.over(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]]))
SKIN = np.array([1.0, 1.0, 0.78, 1.0])  # colour of their geometry
FLIP = np.diag([1.0, -1.0, -1.0])  # upside down
RX, RY, RZ, _ = joints.BY_AXIS["revolute"]


def buildSampleModelManipulator(mimic: bool = False) -> Model:
    """An arm of six joints; with ``mimic`` the last one follows the one before."""
    model = Model()
    _arm(model, 0, SE3.Identity(), "", mimic)
    return model


def buildSampleModelHumanoid(using_free_flyer: bool = True) -> Model:
    """A humanoid of 28 joints and its root, a free flyer or a translation and three angles."""
    model = Model()
    root = _root(model, using_free_flyer)
    model.appendBodyToJoint(root, SMALL, SE3.Identity())
    for side, y in (("rleg", -0.2), ("lleg", 0.2)):
        _arm(model, root, SE3(FLIP, np.array([0.0, y, -0.1])), f"{side}_")
        foot = model.jointPlacements[model.njoints - 1]
        foot.rotation = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    at = _link(model, root, RX(), "chest1", SE3.Identity(), SMALL)
    chest = _link(model, at, RY(), "chest2", SE3.Identity(), LARGE)
    at = _link(model, chest, RX(), "head1", UP, SMALL)
    _link(model, at, RY(), "head2", SE3.Identity(), LARGE)
    for side, y in (("rarm", -0.3), ("larm", 0.3)):
        _arm(model, chest, SE3(FLIP, np.array([0.0, y, 1.0])), f"{side}_")
    return model


def buildSampleModelHumanoidRandom(using_free_flyer: bool = True, mimic: bool = False) -> Model:
    """A humanoid of 26 joints and its root with random placements, bodies and limits; see ``seed``."""
    model = Model()
    root = _root(model, using_free_flyer)
    if using_free_flyer:
        reach = 1.0 + GENERATOR.random((2, 3))
        model.lowerPositionLimit[:3], model.upperPositionLimit[:3] = -reach[0], reach[1]
        model.lowerPositionLimit[3:7], model.upperPositionLimit[3:7] = -1.0, 1.0
    model.appendBodyToJoint(root, Inertia.Random(), SE3.Identity())
    model.addBodyFrame("root_body", root, SE3.Identity())
    leg = (RX, RY, RZ, RY, RY, RX)
    _random_limb(model, root, "lleg", leg)
    _random_limb(model, root, "rleg", leg)
    torso = _random_limb(model, root, "torso", (RY,))
    chest = _random_link(model, torso, RZ(), "chest")
    _random_limb(model, chest, "rarm", leg)
    _random_limb(model, chest, "larm", leg, mimic)
    return model


def buildSampleGeometryModelManipulator(model: Model) -> GeometryModel:
    """Balls at the joints and capsules along the bars of ``buildSampleModelManipulator``."""
    made = GeometryModel()
    _arm_shapes(made, expected(model, Model, "model"), "")
    return made


def buildSampleGeometryModelHumanoid(model: Model) -> GeometryModel:
    """Balls at the joints and capsules along the bars of ``buildSampleModelHumanoid``."""
    made = GeometryModel()
    for limb in ("rleg", "lleg", "rarm", "larm"):
        _arm_shapes(made, expected(model, Model, "model"), f"{limb}_")
    _add_shape(made, model, "chest", "chest1_body", (0.05,), 0.0)
    _add_shape(made, model, "head", "head2_body", (0.25,), 0.5)
    _add_shape(made, model, "chest2", "chest2_body", (0.05, 0.8), 0.5)
    return made


def _arm_shapes(made: GeometryModel, model: Model, prefix: str) -> None:
    for name, body in (("shoulder", "shoulder1"), ("elbow", "elbow"), ("wrist", "wrist1")):
        _add_shape(made, model, prefix + name, f"{prefix}{body}_body", (0.05,), 0.0)
    for name, length, height in (("upperarm", 0.8, 0.5), ("lowerarm", 0.8, 0.5), ("effector", 0.2, 0.1)):
        _add_shape(made, model, prefix + name, f"{prefix}{name}_body", (0.05, length), height)


def _add_shape(
    made: GeometryModel, model: Model, name: str, body: str, sizes: tuple[float, ...], height: float
) -> None:
    """Add a ball (radius,) or capsule (radius, length) at a height along z of a body."""
    at, kind = model.getFrameId(body), "sphere" if len(sizes) == 1 else "capsule"
    if at >= model.nframes:
        raise ModelError(f'model "{model.name}" has no frame "{body}", expected a sample model')
    place = SE3(np.eye(3), np.array([0.0, 0.0, height]))
    shape = GeometryObject(
        f"{name}_object", model.frames[at].parentJoint, at, place, None, kind.upper(), np.ones(3), False, SKIN
    )
    shape._described = Described(kind, sizes)
    made.addGeometryObject(shape)


def _root(model: Model, free_flyer: bool) -> int:
    joint: JointModel = joints.JointModelFreeFlyer()
    if not free_flyer:
        joint = joints.JointModelComposite(joints.JointModelTranslation()).addJoint(joints.JointModelSphericalZYX())
    index = model.addJoint(0, joint, SE3.Identity(), "root_joint")
    if free_flyer:
        model.lowerPositionLimit[3:7], model.upperPositionLimit[3:7] = -1.0, 1.0
    model.addJointFrame(index)
    return index


def _arm(model: Model, parent: int, placement: SE3, prefix: str, mimic: bool = False) -> None:
    """Add a shoulder of three joints, an elbow, and a wrist of two; three of them carry a bar."""
    at, here = parent, SE3.Identity()
    for kind, name, place, body, bar in (
        (RX, "shoulder1", placement, SMALL, ""),
        (RY, "shoulder2", here, SMALL, ""),
        (RZ, "shoulder3", here, None, "upperarm"),
        (RY, "elbow", UP, None, "lowerarm"),
        (RX, "wrist1", UP, SMALL, ""),
        (RY, "wrist1_mimic" if mimic else "wrist2", here, None, "effector"),
    ):
        joint: JointModel = kind()
        if mimic and bar == "effector":
            joint = joints.JointModelMimic.of(joint, model.joints[at], SCALING, OFFSET)
        at = _link(model, at, joint, prefix + name, place, body)
        if bar:  # a body of 1 kg along the joint's z axis, and its frame
            model.appendBodyToJoint(at, LARGE, here)
            before = model.getFrameId(model.names[at])
            model.addFrame(Frame(f"{prefix}{bar}_body", at, before, here, BODY))


def _link(
    model: Model, parent: int, joint: JointModel, name: str, placement: SE3, body: Inertia | None, *limits: Array
) -> int:
    """Add a joint, its frame, a body frame and, if given, a body; returns the joint."""
    most, angle = np.full(joint.nv, MOST), np.full(joint.nq, ANGLE)
    index = model.addJoint(parent, joint, placement, f"{name}_joint", *(limits or (most, most, -angle, angle)))
    model.addJointFrame(index, -1)
    if body is not None:
        model.appendBodyToJoint(index, body, SE3.Identity())
    model.addBodyFrame(f"{name}_body", index, SE3.Identity())
    return index


def _random_limb(model: Model, parent: int, limb: str, kinds: Sequence[type], mimic: bool = False) -> int:
    """Add joints one after the other, the last one with ``mimic`` following that before; returns the last."""
    at = parent
    for k, kind in enumerate(kinds, start=1):
        joint: JointModel = kind()
        if mimic and k == len(kinds):
            joint = joints.JointModelMimic.of(joint, model.joints[at], SCALING, OFFSET)
        at = _random_link(model, at, joint, f"{limb}{k}")
    return at


def _random_link(model: Model, parent: int, joint: JointModel, name: str) -> int:
    effort, velocity, lower, upper = GENERATOR.random((4, joint.nv))
    limits = effort + 0.01, velocity + 0.01, -2.0 * lower, 2.0 * upper
    return _link(model, parent, joint, name, SE3.Random(), Inertia.Random(), *limits)
