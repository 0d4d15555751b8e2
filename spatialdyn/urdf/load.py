"""From a URDF to a checked Robot.

The bytes of a source (``sources``) go to the strict reader of XML (``strict_xml``), which raises for what is broken and
returns only what dynamics needs: a description, of the same attributes as yourdfpy's. Either becomes a ``Robot``, whose
``notes`` list what is odd but valid.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InertiaError, ModelError, UrdfError, literal
from ..model.model import Model, options_of
from ..model.physical_inertia import symmetric
from ..model.robot import WITH_AXIS, Link, Mimic, Robot, RobotJoint
from ..model.robot_checks import (
    check_inertias,
    check_tree,
    clear_rounding,
    make_joint,
    make_link,
    nowhere,
    pose_matrix,
    quoted,
    rpy_matrix,
    rpy_of,
)
from ..waiting import watch
from .robot_files import example_robots, find_robot, robot_names
from .sources import bytes_of, file_of, is_yourdfpy
from .strict_xml import (
    LIMITED,
    RIGHT,
    URDF_KINDS,
    Part,
    StrictReader,
    angle_notes,
    off_right,
    snapped,
)

__all__ = ["example_robots", "find_robot", "load_urdf", "read_urdf", "robot_names"]

Array = NDArray[np.float64]
Made = TypeVar("Made")
Where = Callable[[str, str], str]  # ("link" | "joint", name) -> file and line, a prefix of messages

UNTURNED = np.eye(3)
TURNS = 4.0 * math.pi  # rad: few joints turn further between limits, while 45 degrees are a larger number


def load_urdf(
    source: Any,
    root: str = "fixed",
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    continuous: str = "angle",
    mimic: bool = False,
    inertia: str = "warn",
    snap: float | None = None,
) -> Model:
    """The Model of a robot described in URDF.

    source      path; URDF text (str or bytes that start with ``<``); open file; ``yourdfpy.URDF``; or the name of a
                robot in ``urdf/`` or in the installed example-robot-data (``find_robot`` has the rule)
    root        "fixed", or "floating": the root link gets six freedoms
    gravity     (3,) acceleration of gravity in the world [m/s²]
    continuous  "angle": one coordinate; "cos_sin": Pinocchio's pair
    mimic       True makes mimic joints dependent; False treats them as ordinary joints
    inertia     policy on inertias that are not physical: "warn" keeps them, "strict" raises, "repair" projects them
    snap        rounds angles of placements within ``snap`` [rad] of a right angle to it; None rounds none

    Leftovers that cannot hold a link or joint are ignored with a note and one warning: ``<xacro:property>``,
    ``<xacro:arg>``, ``<xacro:macro>``, ``<xacro:if>`` and ``<xacro:unless>`` without a link or joint inside, undeclared
    prefixes in ``<gazebo>`` and other elements that are not read, ``<axis>`` without xyz on a fixed or floating joint.
    Any other element of xacro is an error, and so is a condition around part of a link or joint, ``<inertial>`` say.

    A ``yourdfpy.URDF`` skips the strict reader, and yourdfpy may have repaired it; its values are still checked.

    Raises  UrdfError naming file, line, element, attribute and value; InertiaError under ``inertia="strict"``;
            ModelError for a bad ``root``, ``continuous`` or mimic chain.

    >>> load_urdf("pendulum").nv
    1
    """
    options = options_of(root, gravity, continuous, mimic)
    with watch.call("load_urdf"):
        robot, where = _read(source, inertia, snap, stacklevel=4)
        if options.mimic:
            _check_leaders(robot, where)
        return Model(robot, options)


def read_urdf(source: Any, inertia: str = "warn", snap: float | None = None, skip_leftovers: bool = False) -> Robot:
    """The checked Robot of a URDF, from which ``load_urdf`` makes a Model. Arguments and errors are the same.

    skip_leftovers  True leaves out elements of xacro and of undeclared prefixes that ``load_urdf`` refuses, and warns
    """
    with watch.call("read_urdf"):
        return _read(source, inertia, snap, 4, skip_leftovers)[0]


def _read(
    source: Any, inertia: str, snap: float | None, stacklevel: int, skip_leftovers: bool = False
) -> tuple[Robot, Where]:
    """The robot, and the function that gives the file and line of its links and joints."""
    real = isinstance(snap, (int, float, np.integer, np.floating))
    if snap is not None and not (real and 0.0 <= snap < 0.5 * RIGHT):
        raise UrdfError(f"snap is {literal(snap)}, expected an angle from 0 to pi/4, or None")
    if is_yourdfpy(source):
        robot = _robot(source.robot, nowhere, [], snap)
        return check_inertias(robot, inertia, stacklevel=stacklevel), nowhere
    label, data = bytes_of(source)
    reader = StrictReader(label, snap, skip_leftovers)
    robot = _robot(_description(reader.read(data)), reader.where, reader.notes, None)
    robot = replace(robot, source=file_of(source))
    if reader.doubts:
        warnings.warn(f'robot "{robot.name}": {"; ".join(reader.doubts)}', stacklevel=stacklevel - 1)
    return check_inertias(robot, inertia, reader.where, stacklevel), reader.where


def _check_leaders(robot: Robot, where: Where) -> None:
    """Raise UrdfError for a mimic of a missing joint: an error only with mimic=True."""
    names = {joint.name for joint in robot.joints}
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.leader not in names:
            raise UrdfError(
                f'{where("joint", joint.name)}<mimic joint="{joint.mimic.leader}"> of joint "{joint.name}" '
                f'names no joint of robot "{robot.name}", expected one'
            )


# --- what was read, as yourdfpy describes it ---------------------------------------------------------------


class Origin(NamedTuple):
    """A pose as written."""

    xyz: Sequence[float] = (0.0, 0.0, 0.0)
    rpy: Sequence[float] = (0.0, 0.0, 0.0)


class Inertial(NamedTuple):
    """An <inertial>."""

    mass: float
    inertia: list[list[float]]
    origin: Origin | None


class Body(NamedTuple):
    """A <link>."""

    name: str
    inertial: Inertial | None


class Limit(NamedTuple):
    """A <limit>."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None


class Dynamics(NamedTuple):
    """A <dynamics>."""

    damping: float | None = None
    friction: float | None = None


class Mimicked(NamedTuple):
    """A <mimic>."""

    joint: str
    multiplier: float | None = None
    offset: float | None = None


class Connection(NamedTuple):
    """A <joint>."""

    name: str
    type: str
    parent: str
    child: str
    origin: Origin | None
    axis: Sequence[float] | None
    limit: Limit | None
    dynamics: Dynamics | None
    mimic: Mimicked | None


class Description(NamedTuple):
    """A <robot>."""

    name: str
    links: list[Body]
    joints: list[Connection]


def _description(robot: Part) -> Description:
    """The description of a robot that the strict reader has read."""
    links = [_body(part) for part in robot.children if part.tag == "link"]
    joints = [_connection(part) for part in robot.children if part.tag == "joint"]
    return Description(robot.values["name"], links, joints)


def _body(link: Part) -> Body:
    parts = {part.tag: part for part in link.children}
    if "inertial" not in parts:
        return Body(link.values["name"], None)
    given = {part.tag: part.values for part in parts["inertial"].children}
    I = given["inertia"]
    rows = [[I["ixx"], I["ixy"], I["ixz"]], [I["ixy"], I["iyy"], I["iyz"]], [I["ixz"], I["iyz"], I["izz"]]]
    origin = Origin(**given["origin"]) if "origin" in given else None
    return Body(link.values["name"], Inertial(given["mass"]["value"], rows, origin))


def _connection(joint: Part) -> Connection:
    given = {part.tag: part.values for part in joint.children}
    return Connection(
        joint.values["name"],
        joint.values["type"],
        given["parent"]["link"],
        given["child"]["link"],
        Origin(**given["origin"]) if "origin" in given else None,
        given["axis"]["xyz"] if "axis" in given else None,
        Limit(**given["limit"]) if "limit" in given else None,
        Dynamics(**given["dynamics"]) if "dynamics" in given else None,
        Mimicked(**given["mimic"]) if "mimic" in given else None,
    )


# --- from a description to a Robot ------------------------------------------------------------------------


def _robot(description: Any, where: Where, notes: list[str], snap: float | None) -> Robot:
    """The Robot of a description, its values checked. Raises UrdfError naming the link or joint."""
    for kind, things in (("robot", [description]), ("link", description.links), ("joint", description.joints)):
        for thing in things:
            if not isinstance(thing.name, str) or not thing.name.strip():
                raise UrdfError(f"{where('', '')}a {kind} has name {literal(thing.name)}, expected a name")
    angles: list[float] = []
    links = [_at(where("link", link.name), _link, link, snap, angles) for link in description.links]
    joints = [_at(where("joint", joint.name), _joint, joint, snap, angles) for joint in description.joints]
    notes = notes + _link_notes(description) + _joint_notes(description)
    if where is nowhere:  # else the strict reader has counted the angles as written
        notes += angle_notes(angles, snap)
    return _at("", check_tree, description.name, links, joints, notes, where)


def _at(place: str, make: Callable[..., Made], *arguments: Any) -> Made:
    """``make(*arguments)``, its errors turned into UrdfErrors that begin with ``place``."""
    try:
        return make(*arguments)
    except (InertiaError, ModelError, UrdfError) as error:
        raise UrdfError(f"{place}{error}") from None


def _pose(origin: Any, what: str, snap: float | None, angles: list[float]) -> Array:
    """An origin as a pose (4, 4), rotation entries below 1e-15 zero; appends yourdfpy's angles to ``angles``."""
    if isinstance(origin, Origin):
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = rpy_matrix(*origin.rpy), origin.xyz
        return X + 0.0  # no -0.0
    X = pose_matrix(origin, what)
    R = X[:3, :3]
    rpy = rpy_of(R)
    angles += rpy
    if snap is not None and any(0.0 < off_right(angle) <= snap for angle in rpy):
        R[:] = rpy_matrix(*(snapped(angle, snap) for angle in rpy))
    clear_rounding(R)
    return X


def _link(link: Any, snap: float | None, angles: list[float]) -> Link:
    """A Link in its own frame; without <inertial> it has no mass."""
    given = link.inertial
    if given is None:
        return Link(link.name)
    for part in ("mass", "inertia"):
        if getattr(given, part) is None:
            raise UrdfError(f'<inertial> of link "{link.name}" has no {part}, expected one')
    X = _pose(given.origin, f'<origin> of <inertial> of link "{link.name}"', snap, angles)
    R = X[:3, :3]
    made = make_link(link.name, (given.mass, X[:3, 3], given.inertia))
    if (R == UNTURNED).all():
        return replace(made, inertia=tuple(x + 0.0 for x in made.inertia))  # no -0.0, as in the product below
    with np.errstate(over="ignore", invalid="ignore"):
        I = R @ np.reshape(made.inertia, (3, 3)) @ R.T
    if not np.isfinite(I).all():
        raise InertiaError(f'link "{link.name}" has an inertia that is beyond the largest float in the link\'s frame')
    return make_link(link.name, (given.mass, X[:3, 3], symmetric(I)))


def _joint(joint: Any, snap: float | None, angles: list[float]) -> RobotJoint:
    """A RobotJoint, without what its kind does not use, such as the limits of a continuous joint."""
    if joint.type not in URDF_KINDS:
        raise UrdfError(f'joint "{joint.name}" has type {literal(joint.type)}, expected one of {", ".join(URDF_KINDS)}')
    limit, dynamics, mimic = joint.limit, joint.dynamics, joint.mimic
    lower, upper = -math.inf, math.inf
    if limit is not None and joint.type in LIMITED:
        lower, upper = _or(limit.lower, 0.0), _or(limit.upper, 0.0)
    velocity, effort = (math.inf if limit is None else _or(getattr(limit, k), math.inf) for k in ("velocity", "effort"))
    return make_joint(
        RobotJoint(
            joint.name,
            joint.type,
            joint.parent,
            joint.child,
            tuple(_pose(joint.origin, f'<origin> of joint "{joint.name}"', snap, angles).ravel().tolist()),
            tuple(np.ravel((1.0, 0.0, 0.0) if joint.axis is None else joint.axis).tolist()),
            lower,
            upper,
            math.inf if velocity < 0.0 else velocity,
            math.inf if effort < 0.0 else effort,
            0.0 if dynamics is None else _or(dynamics.damping, 0.0),
            0.0 if dynamics is None else _or(dynamics.friction, 0.0),
            mimic=None if mimic is None else Mimic(mimic.joint, _or(mimic.multiplier, 1.0), _or(mimic.offset, 0.0)),
        )
    )


def _or(value: Any, default: float) -> float:
    """A number that may be missing, or text, as yourdfpy's damping and friction."""
    return default if value is None else float(value)


# --- notes ------------------------------------------------------------------------------------------------


def _note(names: list[str], one: str, many: str) -> list[str]:
    """A note about a link or joint, or about many of them; none if there are no names."""
    return [f"{one if len(names) == 1 else f'{len(names)} {many}'}: {quoted(names)}"] if names else []


def _link_notes(description: Any) -> list[str]:
    moved = {joint.child for joint in description.joints if joint.type != "fixed"}
    bare = [link.name for link in description.links if link.inertial is None and link.name in moved]
    weightless = [link for link in description.links if link.inertial is not None and link.inertial.mass == 0.0]
    empty = [link.name for link in weightless]
    turning = [link.name for link in weightless if np.any(link.inertial.inertia)]
    return [
        *_note(bare, "link that moves has no <inertial>", "links that move have no <inertial>"),
        *_note(empty, "link has mass 0", "links have mass 0"),
        *_note(turning, "link has mass 0 but a rotational inertia", "links have mass 0 but a rotational inertia"),
    ]


def _joint_notes(description: Any) -> list[str]:
    names = {joint.name for joint in description.joints}
    limited = [joint for joint in description.joints if joint.type in LIMITED]
    free = [joint.name for joint in limited if joint.limit is None]
    bounded = [joint for joint in limited if joint.limit is not None]
    partial = [joint.name for joint in bounded if joint.limit.lower is None or joint.limit.upper is None]
    negative = [
        joint.name
        for joint in description.joints
        if joint.limit is not None and min(_or(joint.limit.velocity, 0.0), _or(joint.limit.effort, 0.0)) < 0.0
    ]
    wide = [
        joint.name
        for joint in bounded
        if joint.type == "revolute"
        and any(TURNS < abs(_or(x, 0.0)) < math.inf for x in (joint.limit.lower, joint.limit.upper))
    ]
    skewed = [
        joint.name
        for joint in description.joints
        if joint.type in WITH_AXIS and joint.axis is not None and abs(math.hypot(*joint.axis) - 1.0) > 1e-6
    ]
    lost = [j.name for j in description.joints if j.mimic is not None and j.mimic.joint not in names]
    return [
        *_note(free, "joint has no <limit>, so it is unlimited", "joints have no <limit>, so they are unlimited"),
        *_note(partial, "<limit> lacks lower or upper, taken as 0", "<limit>s lack lower or upper, taken as 0"),
        *_note(
            wide,
            "joint has a limit beyond two turns, of degrees perhaps",
            "joints have limits beyond two turns, of degrees perhaps",
        ),
        *_note(
            negative,
            "velocity or effort limit < 0 counts as none",
            "velocity or effort limits < 0 count as none",
        ),
        *_note(skewed, "axis is not of unit length, normalised", "axes are not of unit length, normalised"),
        *_note(lost, "<mimic> names no joint of the robot", "<mimic>s name no joint of the robot"),
    ]
