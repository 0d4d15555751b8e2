"""``from_pinocchio``: a Model with the joints, coordinates, frames and limits of Pinocchio's, entry by entry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..bodies.kinds import kind_of
from ..errors import ModelError
from ..model.assembly import IDENTITY
from ..model.model import Model, assemble
from ..model.robot import Link, RobotJoint
from ..model.robot_checks import check_inertias, check_tree, clear_rounding, make_joint, make_link

PINOCCHIO_KINDS = {
    **{f"JointModelR{a}": "revolute" for a in "XYZ"},
    "JointModelRevoluteUnaligned": "revolute",
    **{f"JointModelRUB{a}": "continuous" for a in "XYZ"},
    "JointModelRevoluteUnboundedUnaligned": "continuous",
    **{f"JointModelP{a}": "prismatic" for a in "XYZ"},
    "JointModelPrismaticUnaligned": "prismatic",
    **{f"JointModelH{a}": "helical" for a in "XYZ"},
    "JointModelHelicalUnaligned": "helical",
    "JointModelSpherical": "spherical",
    "JointModelFreeFlyer": "floating",
    "JointModelPlanar": "planar",
}
LOWER_LIMITS = {
    "velocityLimit": "lowerVelocityLimit",
    "effortLimit": "lowerEffortLimit",
    "friction": "lowerDryFrictionLimit",
}


def from_pinocchio(pin_model: Any, inertia: str = "warn") -> Model:
    """The Model of a ``pinocchio.Model``, with the same joints, q, v, frames, limits and gravity, entry by entry.

    pin_model  a Model of Pinocchio 3 or later; this function does not import Pinocchio
    inertia    policy on inertias that are not physical, as in ``load_urdf``

    The universe becomes the root link, and a free flyer an ordinary floating joint. A joint's body becomes the link
    named after its first body frame at the identity, or else after the joint. Every other frame becomes a link without
    mass on a fixed joint; a fixed-joint frame names that joint. Unbounded and planar joints keep their (cos, sin).
    Limits of joints with several freedoms, and all other parts without a counterpart, are listed in
    ``model.robot.notes``. rotorInertia and rotorGearRatio are left out, since they change no result of Pinocchio;
    armature is kept.

    Raises ModelError naming the joint for a type that is not revolute, prismatic, helical, spherical, planar or
    free flyer and for joints not in depth-first order; InertiaError.
    """
    if not all(hasattr(pin_model, x) for x in ("joints", "inertias", "jointPlacements", "frames", "parents")):
        raise ModelError(f"pin_model is a {type(pin_model).__name__}, expected a pinocchio Model")
    check_depth_first(pin_model)
    notes: list[str] = []
    links, fixed = _links_and_frames(pin_model, notes)
    moving = [_joint(pin_model, i, links, notes) for i in range(1, pin_model.njoints)]
    robot = check_tree(pin_model.name or "robot", [*links, *(Link(j.child) for j in fixed)], [*moving, *fixed], notes)
    robot = check_inertias(replace(robot, ordered=True), inertia)
    if np.any(pin_model.gravity.angular):
        raise ModelError(f"gravity has angular part {pin_model.gravity.angular}, expected zero")
    return assemble(robot, gravity=pin_model.gravity.linear, continuous="cos_sin")


def check_depth_first(pin_model: Any) -> None:
    """Raise ModelError naming the first joint that is out of depth-first order."""
    names, parents = pin_model.names, pin_model.parents
    for i in range(1, pin_model.njoints):
        at = i - 1
        while at != parents[i]:
            if at == 0:
                raise ModelError(
                    f'joint "{names[i]}" hangs on "{names[parents[i]]}" and follows "{names[i - 1]}", '
                    "expected joints in depth-first order"
                )
            at = parents[at]


def _pose(placement: Any) -> tuple[float, ...]:
    """A placement in row-major order; rotation entries below 1e-15 are zero."""
    X = np.array(placement.homogeneous, dtype=float)
    clear_rounding(X[:3, :3])
    return tuple(X.ravel().tolist())


def fresh_name(name: str, taken: set[str]) -> str:
    """The name with underscores appended until it is not in ``taken``; it is added to ``taken``."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _links_and_frames(pin_model: Any, notes: list[str]) -> tuple[list[Link], list[RobotJoint]]:
    """The link of each joint, the universe's link first, and fixed joints for the other frames."""
    frames = [(f, f.type.name, _pose(f.placement)) for f in pin_model.frames][1:]
    names = list(pin_model.names)
    bodies: dict[int, int] = {}  # joint -> the frame of its body
    for k, (f, kind, X) in enumerate(frames):
        if kind == "BODY" and f.parentJoint > 0 and X == IDENTITY:
            bodies.setdefault(f.parentJoint, k)
    link_names, joint_names = {"universe"}, set(names)
    named: dict[int, str] = {}
    for k, (f, kind, _) in enumerate(frames):
        if kind != "JOINT":
            named[k] = fresh_name(f.name, joint_names if kind == "FIXED_JOINT" else link_names)
            if named[k] != f.name:
                notes.append(f'frame "{f.name}" of type {kind} is called "{named[k]}", for its name is taken')
    links = []
    for i, I in enumerate(pin_model.inertias):
        name = "universe" if i == 0 else named[bodies[i]] if i in bodies else fresh_name(names[i], link_names)
        links.append(make_link(name, (I.mass, np.array(I.lever), np.array(I.inertia))))

    fixed: list[RobotJoint] = []
    left = {k for k, (_, kind, _) in enumerate(frames) if kind != "JOINT"} - set(bodies.values())
    for k, (f, kind, X) in enumerate(frames):
        if k in left and kind == "FIXED_JOINT":
            # a body frame after a fixed joint is the child of that joint, as in the URDF
            behind = (
                n
                for n in sorted(left)
                if frames[n][1] == "BODY"
                and (frames[n][0].parentFrame, frames[n][0].parentJoint) == (k + 1, f.parentJoint)
                and frames[n][2] == X
            )
            child = next(behind, None)
            left -= {k, child}
            link = fresh_name(f.name, link_names) if child is None else named[child]
            fixed.append(RobotJoint(named[k], "fixed", links[f.parentJoint].name, link, X))
    for k in sorted(left):
        f, _, X = frames[k]
        name = fresh_name(f"{named[k]}_fixed", joint_names)
        fixed.append(RobotJoint(name, "fixed", links[f.parentJoint].name, named[k], X))
    return links, fixed


def _joint(pin_model: Any, i: int, links: Sequence[Link], notes: list[str]) -> RobotJoint:
    """Joint i of a Pinocchio model."""
    joint, name = pin_model.joints[i], pin_model.names[i]
    kind = PINOCCHIO_KINDS.get(joint.shortname())
    if kind is None:
        raise ModelError(
            f'joint "{name}" is a {joint.shortname()}, expected a revolute, prismatic, helical, spherical, '
            "planar or free-flyer joint"
        )
    axis, pitch = screw_of(pin_model, joint, kind) if kind_of(kind).nv == 1 else ((0.0, 0.0, 1.0), 0.0)
    lower, upper = _position_limits(pin_model, joint, name, kind, notes)
    return make_joint(
        RobotJoint(
            name,
            kind,
            links[pin_model.parents[i]].name,
            links[i].name,
            _pose(pin_model.jointPlacements[i]),
            axis,
            lower,
            upper,
            velocity=_common(pin_model, joint, name, "velocityLimit", notes),
            effort=_common(pin_model, joint, name, "effortLimit", notes),
            damping=_common(pin_model, joint, name, "damping", notes),
            friction=_common(pin_model, joint, name, "friction", notes),
            armature=_armature(pin_model, joint),
            pitch=pitch,
        )
    )


def screw_of(pin_model: Any, joint: Any, kind: str) -> tuple[tuple[float, ...], float]:
    """Axis and pitch of a Pinocchio joint that moves along or about one axis."""
    data = joint.createData()
    joint.calc(data, np.zeros(pin_model.nq))
    S = np.ravel(data.S).tolist()
    axis = tuple(S[:3] if kind == "prismatic" else S[3:])
    if kind != "helical":
        return axis, 0.0
    return axis, sum(v * w for v, w in zip(S[:3], axis, strict=True)) / sum(w * w for w in axis)


def _common(pin_model: Any, joint: Any, name: str, attribute: str, notes: list[str]) -> float:
    """One number for all freedoms of a joint: the largest, with a note if they differ."""
    at = slice(joint.idx_v, joint.idx_v + joint.nv)
    values = np.array(getattr(pin_model, attribute)[at], dtype=float)
    if (values != values[0]).any():
        text = f'joint "{name}" has {attribute} {values.tolist()}, expected one for all its freedoms'
        notes.append(f"{text}; the largest is kept")
    lower = LOWER_LIMITS.get(attribute, "")
    least = getattr(pin_model, lower, None)  # since Pinocchio 4; magnitudes are compared, as addJoint writes +max
    if least is not None and [_unlimited(abs(x)) for x in least[at]] != [_unlimited(x) for x in values]:
        notes.append(f'joint "{name}" has {lower} {least[at].tolist()}, which is left out')
    return _unlimited(float(values.max()))


def _armature(pin_model: Any, joint: Any) -> float | tuple[float, ...]:
    """One number for all freedoms of a joint, or one for each if they differ."""
    values = tuple(np.array(pin_model.armature[joint.idx_v : joint.idx_v + joint.nv], dtype=float).tolist())
    return values[0] if len(set(values)) == 1 else values


def _position_limits(pin_model: Any, joint: Any, name: str, kind: str, notes: list[str]) -> tuple[float, float]:
    """Limits of a joint of one coordinate; other joints have none, with a note if the Pinocchio model has some."""
    at = slice(joint.idx_q, joint.idx_q + joint.nq)
    lower = [_unlimited(float(x)) for x in pin_model.lowerPositionLimit[at]]
    upper = [_unlimited(float(x)) for x in pin_model.upperPositionLimit[at]]
    if joint.nq == 1:
        return lower[0], upper[0]
    places = kind_of(kind).lengths  # the other coordinates have unit norm
    if np.isfinite(lower[:places] + upper[:places]).any():
        notes.append(f'joint "{name}" has position limits {lower[:places]} to {upper[:places]}, which are left out')
    return -math.inf, math.inf


def _unlimited(x: float) -> float:
    """x, or infinity if x is the largest float, which means no limit in Pinocchio."""
    return math.copysign(math.inf, x) if abs(x) >= np.finfo(float).max else x
