"""What a robot is made of, converted and checked: numbers, poses, links, joints, the tree, inertias."""

from __future__ import annotations

import difflib
import math
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.rotations import ROTATION_ZERO, UNIT_AXIS
from ..bodies.kinds import CODES, kind_of
from ..errors import InertiaError, ModelError, literal
from .physical_inertia import inertia_defect, nearest_physical, shown_moments, symmetric
from .robot import JOINT_KINDS, WITH_AXIS, Link, Robot, RobotJoint, Rotor, Spring

Array = NDArray[np.float64]
_NUMBER = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf(?:inity)?|nan)", re.IGNORECASE)
GIMBAL = 1e-9  # cosine of the pitch: below it roll and yaw are one rotation


def nowhere(kind: str, name: str) -> str:
    """The place of a link or joint in its source, a prefix of messages: empty for robots made by calls."""
    return ""


def check_tree(
    name: str,
    links: Sequence[Link],
    joints: Sequence[RobotJoint],
    notes: Iterable[str] = (),
    where: Callable[[str, str], str] = nowhere,
) -> Robot:
    """Links and joints as a Robot, checked to be a tree; ``where("link" | "joint", name)`` is a prefix of messages.

    Raises ModelError for duplicate names, unknown links, a link with two parents, a cycle, no root or two roots.
    """
    for what, names in (
        ("link", [x.name for x in links]),
        ("joint", [x.name for x in joints]),
    ):
        seen: set[str] = set()
        for n in names:
            if n in seen:
                raise ModelError(f'{where(what, n)}robot "{name}" has two {what}s named "{n}", expected distinct names')
            seen.add(n)
    known = {link.name for link in links}
    parent_of: dict[str, RobotJoint] = {}
    for joint in joints:
        for role, end in (("parent", joint.parent), ("child", joint.child)):
            if end not in known:
                raise ModelError(
                    f'{where("joint", joint.name)}joint "{joint.name}" has {role} link "{end}", '
                    f'which robot "{name}" does not have'
                )
        if joint.child in parent_of:
            raise ModelError(
                f'{where("joint", joint.name)}link "{joint.child}" is the child of joints '
                f'"{parent_of[joint.child].name}" and "{joint.name}", expected one parent'
            )
        parent_of[joint.child] = joint
    roots = [link.name for link in links if link.name not in parent_of]
    if not links:
        raise ModelError(f'{where("robot", name)}robot "{name}" has no links, expected at least one')
    if not roots:
        raise ModelError(
            f'{where("robot", name)}robot "{name}" has no root link: its joints form a cycle, expected a tree'
        )
    if len(roots) > 1:
        listed = quoted(roots)
        raise ModelError(
            f'{where("link", roots[1])}robot "{name}" has {len(roots)} root links ({listed}), expected one'
        )
    robot = Robot(name, roots[0], tuple(links), tuple(joints), tuple(notes))
    children, reached = robot.children, [roots[0]]
    for at in reached:  # grows during the loop; each link has one parent, so it is reached once
        reached += [joint.child for joint in children[at]]
    if len(reached) < len(links):
        held = set(reached)
        lost = next(link.name for link in links if link.name not in held)
        raise ModelError(f'{where("link", lost)}link "{lost}" hangs on a cycle of joints, expected a tree')
    return robot


def quoted(names: Iterable[str], most: int = 8) -> str:
    """Names between quotes, the first ``most`` of them."""
    listed = [f'"{n}"' for n in names]
    return ", ".join(listed[:most]) + (f" and {len(listed) - most} more" if len(listed) > most else "")


def check_inertias(
    robot: Robot,
    policy: str = "warn",
    where: Callable[[str, str], str] = nowhere,
    stacklevel: int = 3,
) -> Robot:
    """Apply the policy on inertias that are not physical: "warn" keeps them, "strict" raises, "repair" projects.

    One warning lists all of them. ``notes`` list each defect, and under "repair" the new moments.

    Raises InertiaError under "strict", naming the link, its principal moments and the violation.
    """
    if not isinstance(policy, str) or policy not in ("warn", "strict", "repair"):
        raise InertiaError(f'inertia policy is {literal(policy)}, expected "warn", "strict" or "repair"')
    found: list[str] = []
    links: list[Link] = []
    for link in robot.links:
        defect = inertia_defect(np.reshape(link.inertia, (3, 3)))
        if defect:
            found.append(f'link "{link.name}" {defect}')
            if policy == "strict":
                raise InertiaError(where("link", link.name) + found[-1])
            if policy == "repair":
                I = nearest_physical(np.reshape(link.inertia, (3, 3)))
                if not np.isfinite(I).all():
                    raise InertiaError(
                        f"{where('link', link.name)}{found[-1]}; repaired it is beyond the largest float"
                    )
                link = replace(link, inertia=tuple(I.ravel().tolist()))
                found[-1] += "; repaired to " + shown_moments(I)
        links.append(link)
    if not found:
        return robot
    listed = "; ".join(found[:8] + [f"and {len(found) - 8} more links"] * (len(found) > 8))
    end = "" if policy == "repair" else ' (kept as they are; inertia="repair" projects them)'
    warnings.warn(f'robot "{robot.name}": {listed}{end}', stacklevel=stacklevel)
    return replace(robot, links=tuple(links), notes=robot.notes + tuple(found))


def is_number(text: str) -> bool:
    """Whether a text of a file is a number; ``float`` reads more as one, 1_0 and digits of any script."""
    return _NUMBER.fullmatch(text) is not None


def masked(value: Any, depth: int = 32) -> bool:
    """Whether a value is or contains a masked array, whose mask NumPy drops when it makes a plain array of it."""
    ma = sys.modules.get("numpy.ma")
    if ma is None:  # not imported: no masked array exists
        return False
    if not isinstance(value, (list, tuple)):
        return isinstance(value, ma.MaskedArray)
    kinds = set(map(type, value))  # testing each entry would take longer than NumPy's conversion
    if any(issubclass(kind, ma.MaskedArray) for kind in kinds):
        return True
    return (
        depth > 0
        and any(issubclass(kind, (list, tuple)) for kind in kinds)
        and any(masked(x, depth - 1) for x in value)
    )


def floats(value: Any, count: int, what: str) -> tuple[float, ...]:
    """``count`` real numbers as a tuple of floats. Raises ModelError, its message beginning with ``what``."""
    if masked(value):
        raise ModelError(f"{what} a masked array, expected {count} number{'s' * (count > 1)} without a mask")
    try:
        with np.errstate(over="ignore"):
            x = np.asarray(value, dtype=float).ravel() if np.asarray(value).dtype.kind in "fiu" else None
    except (TypeError, ValueError):
        x = None
    if x is None or len(x) != count:
        raise ModelError(f"{what} {literal(value)}, expected {count} number{'s' * (count > 1)}")
    return tuple(x.tolist())


def pose_matrix(placement: Any, what: str) -> Array:
    """A placement given as None, xyz, (xyz, rpy) or a (4, 4) matrix, as a (4, 4) matrix.

    Raises ModelError for another value, one that is not finite, or a rotation not orthonormal within 1e-6.
    """
    X = np.eye(4)
    if placement is None:
        return X
    if isinstance(placement, tuple) and len(placement) == 2 and np.shape(placement[0]) == (3,):
        rpy = floats(placement[1], 3, f"{what} has rpy")
        if not all(map(math.isfinite, rpy)):
            raise ModelError(f"{what} has rpy {literal(placement[1])}, expected finite numbers")
        X[:3, :3] = rpy_matrix(*rpy)
        X[:3, 3] = floats(placement[0], 3, f"{what} has xyz")
    else:
        try:
            given = np.array(np.nan) if masked(placement) else np.asarray(placement)
            if given.dtype.kind not in "fiu" or not given.ndim:
                raise TypeError
            with np.errstate(over="ignore"):
                given = given.astype(float)
        except (TypeError, ValueError):
            raise ModelError(f"{what} is {literal(placement)}, expected (3,), (4, 4) or a pair xyz, rpy") from None
        if given.shape == (3,):
            X[:3, 3] = given
        elif given.shape == (4, 4):
            X[:] = given
        else:
            raise ModelError(f"{what} has shape {given.shape}, expected (3,), (4, 4) or a pair xyz, rpy")
    R = X[:3, :3]
    if not np.isfinite(X).all():
        raise ModelError(f"{what} has an entry that is not finite, expected finite numbers")
    turns = abs(R).max() < 2.0 and abs(R @ R.T - np.eye(3)).max() <= 1e-6  # the first avoids overflow of squares
    if not turns or np.linalg.det(R) < 0 or (X[3] != (0, 0, 0, 1)).any():
        raise ModelError(f"{what} is no pose: its rotation is not orthonormal within 1e-6, or its last row not 0 0 0 1")
    return X


def rpy_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation of URDF's roll, pitch, yaw (fixed axes x, y, z); entries below 1e-15 are zero."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    R = np.array(
        [
            [cy * cp, sp * (sr * cy) - cr * sy, sp * (cr * cy) + sr * sy],
            [sy * cp, sp * (sr * sy) + cr * cy, sp * (cr * sy) - sr * cy],
            [-sp, cp * sr, cp * cr],
        ]
    )
    clear_rounding(R)
    return R


def clear_rounding(R: Array) -> None:
    """Zero the entries of rotations R (..., 3, 3) that are below 1e-15, in place."""
    R[abs(R) < ROTATION_ZERO] = 0.0


def rpy_of(R: Array) -> list[float]:
    """Roll, pitch, yaw of a rotation; at a pitch of ±π/2, where roll and yaw are one rotation, the roll is 0."""
    cos_pitch = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cos_pitch)
    if cos_pitch < GIMBAL:
        return [0.0, pitch, math.atan2(-R[0, 1], R[1, 1])]
    return [math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])]


def make_link(name: str, inertia: tuple[float, ArrayLike, ArrayLike]) -> Link:
    """A Link from (mass, com (3,), rotational inertia (3, 3) about the com).

    Raises InertiaError naming the link for a negative or NaN mass, NaN entries, wrong shapes or an asymmetric matrix.
    """
    try:
        if any(masked(part) or np.asarray(part).dtype.kind not in "fiu" for part in inertia):
            raise TypeError
        mass, com, I = inertia
        mass, com, I = float(mass), np.asarray(com, float), np.asarray(I, float)
    except (TypeError, ValueError) as error:
        raise InertiaError(
            f'link "{name}" has inertia {literal(inertia)}, expected (mass, com (3,), inertia (3, 3))'
        ) from error
    if com.shape != (3,) or I.shape != (3, 3):
        raise InertiaError(
            f'link "{name}" has com of shape {com.shape} and inertia of shape {I.shape}, expected (3,) and (3, 3)'
        )
    if not (mass >= 0.0 and math.isfinite(mass)):
        raise InertiaError(f'link "{name}" has mass {mass}, expected a finite number >= 0')
    if not np.isfinite(com).all() or not np.isfinite(I).all():
        raise InertiaError(f'link "{name}" has a com or inertia entry that is not finite, expected finite numbers')
    if abs(0.5 * I - 0.5 * I.T).max() > 0.5e-12 * abs(I).max():
        raise InertiaError(f'link "{name}" has an inertia that is not symmetric, expected I = Iᵀ')
    reach = math.hypot(*com)
    if mass and not math.isfinite(reach * reach * mass):
        raise InertiaError(
            f'link "{name}" has mass {mass:.6g} at a distance of {reach:.6g}, '
            "whose inertia about the link's origin is beyond the largest float"
        )
    return Link(name, mass, tuple(com.tolist()), tuple(symmetric(I).ravel().tolist()))


def make_joint(joint: RobotJoint) -> RobotJoint:
    """A RobotJoint with its fields checked and its axis of unit length.

    Raises ModelError naming the joint: unknown kind, zero or NaN axis, lower > upper, negative armature, mimic of
    itself.
    """
    what = f'joint "{joint.name}"'
    if joint.kind not in JOINT_KINDS:
        raise ModelError(f"{what} has type {literal(joint.kind)}, expected one of {', '.join(JOINT_KINDS)}")
    axis = np.array(joint.axis)
    if axis.shape != (3,) or not np.isfinite(axis).all():
        raise ModelError(f"{what} has axis {joint.axis}, expected three finite numbers")
    if joint.kind in WITH_AXIS:
        size = float(abs(axis).max())
        if size == 0.0:
            raise ModelError(f"{what} has axis of norm 0, expected a nonzero vector")
        scaled = axis / size
        norm = math.sqrt(scaled @ scaled)
        if abs(norm * size - 1.0) > UNIT_AXIS:
            axis = scaled / norm
    for label in (
        "lower",
        "upper",
        "velocity",
        "effort",
        "damping",
        "friction",
    ):
        if math.isnan(getattr(joint, label)):
            raise ModelError(f"{what} has {label} nan, expected a number")
    if joint.lower > joint.upper:
        raise ModelError(f"{what} has lower limit {joint.lower} above upper limit {joint.upper}")
    freedoms = 1 if joint.kind == "fixed" else kind_of(joint.kind).nv
    rotors = joint.armature if isinstance(joint.armature, tuple) else (joint.armature,)
    if len(rotors) not in (1, freedoms):
        raise ModelError(f"{what} has armature {joint.armature}, expected one number or {freedoms}")
    if not all(rotor >= 0.0 and math.isfinite(rotor) for rotor in rotors):
        raise ModelError(f"{what} has armature {joint.armature}, expected a finite number >= 0")
    if not math.isfinite(joint.pitch):
        raise ModelError(f"{what} has pitch {joint.pitch}, expected a finite number")
    if joint.pitch and joint.kind != "helical":
        raise ModelError(f"{what} is {joint.kind} and has pitch {joint.pitch}, expected a helical joint for a pitch")
    m = joint.mimic
    if m is not None:
        if m.leader == joint.name:
            raise ModelError(f"{what} mimics itself, expected another joint")
        if not (math.isfinite(m.multiplier) and math.isfinite(m.offset)):
            raise ModelError(
                f"{what} mimics with multiplier {m.multiplier} and offset {m.offset}, expected finite numbers"
            )
    joint = replace(joint, axis=tuple(axis.tolist()))
    if joint.spring is not None:
        _check_spring(joint, joint.spring)
    return joint if joint.rotor is None else with_rotor(joint, joint.rotor)


def _check_spring(joint: RobotJoint, spring: Spring) -> None:
    """Raise ModelError naming the joint that a spring drives, for a value out of its range."""
    what = f'joint "{spring.joint}" is driven by a spring'
    if joint.kind not in CODES or kind_of(joint.kind).nq != 1:
        raise ModelError(f'{what} of joint "{joint.name}", which is {joint.kind}, expected one of one coordinate')
    for name, x, valid, expected in (
        ("stiffness", spring.stiffness, spring.stiffness > 0.0, "above 0"),
        ("damping", spring.damping, spring.damping >= 0.0, "of 0 or more"),
        ("ratio", spring.ratio, spring.ratio != 0.0, "other than 0"),
    ):
        if not (math.isfinite(x) and valid):
            raise ModelError(f"{what} of {name} {x}, expected a finite number {expected}")


def with_rotor(joint: RobotJoint, rotor: Rotor) -> RobotJoint:
    """The joint with a checked rotor, whose axis has unit length, and its armature n² J.

    Raises ModelError naming the joint: one not of one freedom, an armature of another value, an inertia or ratio that
    is 0 or not finite, a zero axis.
    """
    what = f'joint "{joint.name}"'
    if not isinstance(rotor, Rotor):
        raise ModelError(f"{what} has rotor {literal(rotor)}, expected a Rotor")
    if joint.kind == "fixed" or kind_of(joint.kind).nv != 1:
        raise ModelError(f"{what} is {joint.kind}, expected a joint of one freedom for a rotor")
    (inertia,) = floats(rotor.inertia, 1, f"{what} has a rotor of inertia")
    if not (math.isfinite(inertia) and inertia > 0.0):
        raise ModelError(f"{what} has a rotor of inertia {inertia}, expected a finite number above 0")
    (ratio,) = floats(rotor.ratio, 1, f"{what} has a rotor of ratio")
    reflected = ratio * ratio * inertia
    if not (math.isfinite(reflected) and reflected > 0.0):
        raise ModelError(f"{what} has a rotor of ratio {ratio}, expected a finite number other than 0")
    if joint.armature not in (0.0, reflected):
        raise ModelError(
            f"{what} has armature {joint.armature} beside a rotor, whose n² J is {reflected:.6g}, expected 0"
        )
    axis = np.array(floats(joint.axis if rotor.axis is None else rotor.axis, 3, f"{what} has a rotor with axis"))
    size = float(abs(axis).max())
    if not (math.isfinite(size) and size > 0.0):
        raise ModelError(f"{what} has a rotor with axis {rotor.axis}, expected three finite numbers, not all 0")
    norm = float(np.linalg.norm(axis / size)) * size
    if abs(norm - 1.0) > UNIT_AXIS:
        axis = axis / norm
    return replace(joint, armature=reflected, rotor=Rotor(inertia, ratio, tuple(axis.tolist())))


def missing(what: str, name: object, robot: str, names: Iterable[str]) -> str:
    """The message for an unknown name, with similar names."""
    name = name if isinstance(name, str) else literal(name)
    near = difflib.get_close_matches(name, dict.fromkeys(names), 3, 0.5)
    hint = f", did you mean {' or '.join(near)}" if near else ""
    return f'{what} "{name}" is not in robot "{robot}"{hint}'
