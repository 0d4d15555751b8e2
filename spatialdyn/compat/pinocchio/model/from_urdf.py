"""Models from URDF: ``buildModelFromUrdf``, ``buildModelFromXML``, ``buildModelsFromUrdf``.

The library reads and checks the file; here its robot becomes a Model as in Pinocchio: joints depth first in byte order
of their names, each fixed joint a frame whose inertia is added to the joint that carries it.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from ....bodies.kinds import kind_of
from ....errors import ModelError
from ....model.robot import Link, Robot, RobotJoint
from ....urdf.load import read_urdf
from ..types.arguments import ArgumentError, Array, described, expected, path, urdf_text
from ..types.frame import BODY, FIXED_JOINT, Frame
from ..types.inertia import Inertia
from ..types.se3 import SE3
from .joint import JointModel, X, Y, Z
from .joints import BY_AXIS, JointModelFreeFlyer, JointModelMimic, JointModelPlanar, JointModelSpherical
from .model import Model

__all__ = ["buildModelFromUrdf", "buildModelFromXML"]

ROOT_NAME = "root_joint"
UNIT_BOUND = 1.01  # Pinocchio's limits of quaternion and (cos, sin) entries
ALONG = 1e-12  # an axis this close to x, y or z becomes that axis, as in Pinocchio


def buildModelFromUrdf(urdf_filename: Any, *arguments: Any, **named: Any) -> Model:
    """The Model of a URDF file.

    urdf_filename    str or Path
    root_joint       joint model between the universe and the root link; without it the root link is fixed
    root_joint_name  its name, "root_joint" by default
    model            a Model that the robot is appended to and that is returned
    mimic            True: mimic joints have no coordinates

    Raises UrdfError naming file, line, element and value; ModelError.
    """
    return _build(path(urdf_filename, "urdf_filename"), "buildModelFromUrdf", arguments, named)


def buildModelFromXML(urdf_xml_stream: str, *arguments: Any, **named: Any) -> Model:
    """The Model of URDF text; other arguments and errors as of ``buildModelFromUrdf``."""
    return _build(urdf_text(urdf_xml_stream, "urdf_xml_stream"), "buildModelFromXML", arguments, named)


def _build(source: Any, call: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> Model:
    given: dict[str, Any] = {"root_joint": None, "root_joint_name": ROOT_NAME, "model": None, "mimic": False}
    kinds = {"root_joint": JointModel, "root_joint_name": str, "model": Model, "mimic": bool}
    for value in arguments:  # positional arguments are told apart by type, in this order
        name = next((name for name, kind in kinds.items() if isinstance(value, kind)), None)
        if name is None or (name == "root_joint_name" and given["root_joint"] is None):
            raise ArgumentError(f"{call} got {described(value)}, expected joint, name, Model or bool, in this order")
        given[name] = value
        for passed in list(kinds)[: list(kinds).index(name) + 1]:
            del kinds[passed]
    for name, value in named.items():
        if name not in kinds:
            raise ArgumentError(f"{call} got {name}={value!r}, expected it once, of {', '.join(given)}")
        given[name] = expected(value, kinds[name], name)
    model = given["model"] if given["model"] is not None else Model()
    robot = read_urdf(source, skip_leftovers=True)
    append(model, robot, given["root_joint"], given["root_joint_name"], given["mimic"])
    return model


# --- a robot written down ----------------------------------------------------------------------------------


def append(model: Model, robot: Robot, root_joint: JointModel | None, root_name: str, mimic: bool) -> None:
    """Add a robot's joints, bodies and frames to a model.

    Raises ModelError for a mimic joint whose leader is missing or comes later.
    """
    model.name = robot.name
    links, children = {link.name: link for link in robot.links}, robot.children
    root = links[robot.root]
    if root_joint is None:
        at = model.addFrame(Frame(root.name, 0, 0, SE3.Identity(), BODY, inertia_of(root)))
    else:
        index = model.addJoint(0, root_joint, SE3.Identity(), root_name)
        at = _body(model, index, model.addJointFrame(index, 0), root)
    # joints still to visit, each with the frame of its parent link
    stack = [(joint, at) for joint in reversed(children[robot.root])]
    while stack:
        joint, before = stack.pop()
        at = _joint(model, robot.name, joint, before, links[joint.child], mimic)
        stack += [(below, at) for below in reversed(children[joint.child])]


def _joint(model: Model, robot: str, joint: RobotJoint, before: int, link: Link, mimic: bool) -> int:
    """Add a joint and its child link; returns the link's frame."""
    carrier = model.frames[before]
    placement = carrier.placement * placed(joint)
    if joint.kind == "fixed":
        frame = Frame(joint.name, carrier.parentJoint, before, placement, FIXED_JOINT, inertia_of(link))
        at = model.addFrame(frame)
        return model.addFrame(Frame(link.name, carrier.parentJoint, at, placement, BODY))
    made = joint_model(joint)
    if mimic and joint.mimic is not None:
        if joint.mimic.leader not in model.names:
            raise ModelError(
                f'joint "{joint.name}" of robot "{robot}" mimics "{joint.mimic.leader}", expected a joint before it '
                "in the tree"
            )
        leader = model.joints[model.names.index(joint.mimic.leader)]
        made = JointModelMimic.of(made, leader, joint.mimic.multiplier, joint.mimic.offset)
    index = model.addJoint(carrier.parentJoint, made, placement, joint.name, **_limits(joint, made))
    return _body(model, index, model.addJointFrame(index, before), link)


def _body(model: Model, joint: int, frame: int, link: Link) -> int:
    """Add a link to a joint; returns its frame."""
    if link.mass or any(link.inertia):
        model.appendBodyToJoint(joint, inertia_of(link), SE3.Identity())
    return model.addBodyFrame(link.name, joint, SE3.Identity(), frame)


def placed(joint: RobotJoint) -> SE3:
    """The place of a joint on its parent link."""
    return SE3(np.reshape(joint.placement, (4, 4)))


def inertia_of(link: Link) -> Inertia:
    """The inertia of a link."""
    xx, xy, xz, _, yy, yz, _, _, zz = link.inertia
    # not by the constructor, which refuses the impossible inertias of some files
    return Inertia.over(np.array([link.mass, *link.com, xx, xy, yy, xz, yz, zz]))


def one_axis(kind: str, axis: tuple[float, ...]) -> Any:
    """The joint model of a kind along or about an axis."""
    *aligned, unaligned = BY_AXIS[kind]
    for along, made in zip((X, Y, Z), aligned, strict=True):
        if math.dist(along, axis) <= ALONG:
            return made()
    return unaligned(*axis)


def joint_model(joint: RobotJoint) -> Any:
    """The joint model of a robot's joint. A planar joint ignores its axis, with a warning if that is not z."""
    if joint.kind in ("revolute", "continuous", "prismatic"):
        return one_axis(joint.kind, joint.axis)
    if joint.kind in ("floating", "spherical"):
        return (JointModelFreeFlyer if joint.kind == "floating" else JointModelSpherical)()
    if joint.kind == "planar":
        if joint.axis != Z:
            warnings.warn(
                f'planar joint "{joint.name}" has axis {joint.axis}, taken as (0, 0, 1) as Pinocchio does; '
                "spatialdyn.load_urdf reads it",
                stacklevel=5,
            )
        return JointModelPlanar()
    raise ModelError(f'joint "{joint.name}" is {joint.kind}, expected a revolute, prismatic, floating or planar joint')


def position_limits(joint: RobotJoint, made: JointModel) -> tuple[Array, Array]:
    """Least and largest coordinates (nq,) of a joint, as Pinocchio's parser sets them."""
    if joint.kind in ("revolute", "prismatic"):
        return np.full(made.nq, joint.lower), np.full(made.nq, joint.upper)
    free = kind_of(joint.kind).lengths
    upper = np.array([math.inf] * free + [UNIT_BOUND] * (made.nq - free))
    return -upper, upper


def _limits(joint: RobotJoint, made: JointModel) -> dict[str, Any]:
    """The limit arguments of ``addJoint``, as Pinocchio's parser sets them."""
    nv = made.nv
    one = joint.kind not in ("floating", "planar")
    effort, velocity = (np.full(nv, x if one else math.inf) for x in (joint.effort, joint.velocity))
    friction, damping = (np.full(nv, x if one else 0.0) for x in (joint.friction, joint.damping))
    limits = {"effort": (-effort, effort), "velocity": (-velocity, velocity), "config": position_limits(joint, made)}
    limits["friction"] = -friction, friction
    found = {f"{end}_{name}": x for name, pair in limits.items() for end, x in zip(("min", "max"), pair, strict=True)}
    return {**found, "damping": damping}
