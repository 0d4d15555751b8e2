"""What makes one Model another: joints locked, a subtree alone, and other gravity, rotors, transmissions or loads."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.rotations import NORM_TOLERANCE
from ..bodies.kinds import kind_of
from ..errors import InertiaError, ModelError, literal
from .assembly import ROOT_JOINT, Options
from .joint_rows import Joint, joint_transform
from .physical_inertia import inertia_defect, parallel_axis
from .robot import Link, Robot, RobotJoint, Rotor
from .robot_checks import check_tree, floats, make_link, masked, missing, with_rotor
from .transmission import Transmission, listed_transmissions

Array = NDArray[np.float64]
Model = Any  # of ``model``, which imports this module


def locked(model: Model, lock: Any) -> tuple[Robot, Options]:
    """The robot and options of ``Model.reduced``."""
    options, joints = model.options, {j.name: j for j in model.robot.joints}
    lock = lock_values(model, lock)
    for name, value in lock.items():
        joint = model.joint(name)
        X = _at(joint, options.continuous, value)
        if name == ROOT_JOINT and options.root == "floating":
            options = replace(options, root="fixed", base=_moved(options.base, X))
        else:
            at = _moved(joints[name].placement, X)
            joints[name] = replace(joints[name], kind="fixed", placement=at, mimic=None, rotor=None, shared=None)
    for j in [j for j in joints.values() if j.shared is not None and j.shared[0] in lock]:
        joints[j.name] = replace(j, shared=None)
    for j in joints.values():
        if j.spring is not None and (j.name in lock) != (j.spring.joint in lock):
            raise ModelError(f'joint "{j.spring.joint}" is driven by the spring of "{j.name}"; lock both or neither')
        if options.mimic and j.kind != "fixed" and j.mimic is not None and j.mimic.leader in lock:
            raise ModelError(f'joint "{j.name}" mimics "{j.mimic.leader}", which is to be locked; lock both')
    return replace(model.robot, joints=tuple(joints.values())), options


def subtree_robot(robot: Robot, link: str) -> Robot:
    """The robot of ``Model.subtree``."""
    if not isinstance(link, str) or link not in {x.name for x in robot.links}:
        raise ModelError(missing("link", link, robot.name, [x.name for x in robot.links]))
    keep, children = {link}, robot.children
    queue = [link]
    while queue:
        for joint in children[queue.pop()]:
            keep.add(joint.child)
            queue.append(joint.child)
    links = tuple(x for x in robot.links if x.name in keep)
    joints = tuple(j for j in robot.joints if j.parent in keep and j.child in keep)
    there = {j.name for j in joints}
    joints = tuple(replace(j, shared=None) if j.shared and j.shared[0] not in there else j for j in joints)
    checked = check_tree(robot.name, links, joints, robot.notes)
    return replace(checked, ordered=robot.ordered, source=robot.source, declared=robot.declared)


def rigid(model: Model, joints: Any) -> tuple[Robot, Options]:
    """The robot and options of ``Model.rigid``."""
    springs = {j.spring.joint: j for j in model.robot.joints if j.spring is not None}
    try:
        names = list(springs) if joints is None else list(joints if not isinstance(joints, str) else ())
    except TypeError:
        names = []
    if isinstance(joints, str) or (joints is not None and not isinstance(joints, Iterable)):
        raise ModelError(f"joints is {literal(joints)}, expected names of joints behind springs")
    made = {j.name: j for j in model.robot.joints}
    for name in names:
        if not isinstance(name, str) or name not in springs:
            raise ModelError(missing("spring of joint", name, model.name, springs))
        turns, joint = springs[name], made[name]
        assert turns.spring is not None
        assert turns.rotor is not None
        own = replace(turns.rotor, ratio=turns.spring.ratio)
        made[name] = with_rotor(replace(joint, rotor=None), own)
        del made[turns.name]
    gone = {springs[name].child for name in names}
    links = tuple(x for x in model.robot.links if x.name not in gone)
    return replace(model.robot, joints=tuple(made.values()), links=links), model.options


def changed(
    model: Model,
    gravity: ArrayLike | None,
    armature: Mapping[str, float] | None,
    payload: Mapping[str, tuple[float, ArrayLike, ArrayLike]] | None,
    rotors: Mapping[str, Rotor | None] | None,
    transmissions: Iterable[Transmission],
    inertial_parameters: ArrayLike | None = None,
) -> tuple[Robot, Options]:
    """The robot and options of ``Model.with_``."""
    options, robot = model.options, model.robot
    if gravity is not None:
        options = replace(options, gravity=gravity_of(gravity))
    joints = {j.name: j for j in robot.joints}
    for name, value in _pairs("armature", armature):
        if name not in joints:
            raise ModelError(missing("joint", name, model.name, joints))
        if joints[name].kind == "fixed":
            raise ModelError(f'joint "{name}" is fixed, expected one that moves for an armature of {value}')
        (reflected,) = floats(value, 1, f'joint "{name}" has armature')
        if not (math.isfinite(reflected) and reflected >= 0.0):
            raise ModelError(f'joint "{name}" has armature {reflected}, expected a finite number >= 0')
        _refuse_shared(joints, name)
        if joints[name].rotor is not None:
            raise ModelError(f'joint "{name}" has a rotor, whose n² J is its armature, expected it among rotors')
        joints[name] = replace(joints[name], armature=reflected)
    for name, rotor in _pairs("rotors", rotors):
        if name not in joints:
            raise ModelError(missing("joint", name, model.name, joints))
        _refuse_shared(joints, name)
        bare = replace(joints[name], armature=0.0, rotor=None)
        joints[name] = bare if rotor is None else with_rotor(bare, rotor)
    for transmission in listed_transmissions(transmissions):
        joints.update(_driven(model, transmission, joints))
    links = {x.name: x for x in robot.links}
    if inertial_parameters is not None:
        links.update(_identified(model, inertial_parameters))
    child = {ROOT_JOINT: robot.root, **{j.name: j.child for j in robot.joints}}
    for name, load in _pairs("payload", payload):
        frame = model.frame(name)
        owner = frame.name if frame.kind == "link" else child[frame.name]
        part = make_link(frame.name, load)
        defect = inertia_defect(np.reshape(part.inertia, (3, 3)))
        if defect:
            raise InertiaError(f'payload of frame "{frame.name}" {defect}')
        links[owner] = _loaded(links[owner], part)
    return replace(robot, joints=tuple(joints.values()), links=tuple(links.values())), options


# --- joints that are locked -----------------------------------------------------------------------------------


def lock_values(model: Model, lock: Any) -> dict[str, Any]:
    """{joint: coordinates} of the joints to lock, given as such a mapping or as names. Raises ModelError."""
    if lock is None or isinstance(lock, Mapping):
        return dict(lock or {})
    try:
        names = [lock] if isinstance(lock, str) else list(lock)
    except TypeError:
        expected = "expected names of joints, or a mapping of them to coordinates"
        raise ModelError(f"lock is {literal(lock)}, {expected}") from None
    return {joint.name: resting(model, joint) for joint in map(model.joint, names)}


def resting(model: Model, joint: Joint) -> Any:
    """A joint's neutral coordinates, clipped to its limits; a float if there is one. A mimic's are those it follows to.

    Raises ModelError for the world.
    """
    if joint.kind == "world":
        raise ModelError("the world cannot be locked")
    if joint.mimic is not None:
        leader, multiplier, offset = joint.mimic
        return multiplier * resting(model, model.joints[leader]) + offset
    q = kind_of(joint.kind, model.options.continuous).undisplaced
    if joint.nq == 1:
        return float(np.clip(q[0], model.lower[joint.idx_q], model.upper[joint.idx_q]))
    return list(q)


def resting_beside(model: Model, joint: Joint, locked: Mapping[str, Any]) -> Any:
    """As ``resting``; a mimic's coordinates are those it follows to if the joint that it mimics is locked."""
    if joint.mimic is not None:
        leader, multiplier, offset = joint.mimic
        if model.joints[leader].name in locked:
            led = _numbers(locked[model.joints[leader].name]).ravel()
            return multiplier * (float(led[0]) if len(led) == 1 else math.nan) + offset
    return resting(model, joint)


def _at(joint: Joint, continuous: str, value: ArrayLike) -> Array:
    """X_J (4, 4) of a joint at given coordinates. Raises ModelError unless they are nq finite numbers of unit norm."""
    if joint.kind == "world":
        raise ModelError("the world cannot be locked")
    q = np.atleast_1d(_numbers(value))
    if joint.kind == "continuous" and q.shape == (1,):
        continuous = "angle"
    elif q.shape != (joint.nq,):
        raise ModelError(f'joint "{joint.name}" is locked at {literal(value)}, expected {joint.nq} finite numbers')
    if not np.isfinite(q).all():
        raise ModelError(f'joint "{joint.name}" is locked at {literal(value)}, expected {len(q)} finite numbers')
    unit = kind_of(joint.kind, continuous).unit
    if unit is not None and abs(math.hypot(*q[unit]) - 1.0) > NORM_TOLERANCE:
        raise ModelError(f'joint "{joint.name}" is locked at {q.tolist()}, expected a part of unit norm')
    with np.errstate(over="ignore", invalid="ignore"):  # ``assembly`` refuses what is not finite
        return joint_transform(joint.kind, joint.axis, q, continuous, joint.pitch)


def _moved(placement: tuple[float, ...], X: Array) -> tuple[float, ...]:
    """A placement of 16 numbers, followed by the pose X (4, 4)."""
    with np.errstate(over="ignore", invalid="ignore"):  # ``assembly`` refuses what is not finite
        return tuple((np.reshape(placement, (4, 4)) @ X).ravel().tolist())


# --- what changes ---------------------------------------------------------------------------------------------


def _driven(model: Model, transmission: Transmission, joints: Mapping[str, RobotJoint]) -> dict[str, RobotJoint]:
    """The joints of a transmission with its inertias. Raises ModelError naming those it cannot drive."""
    B, names = transmission.reflected_inertia(), transmission.joints
    made: dict[str, RobotJoint] = {}
    for name, own in zip(names, B.diagonal(), strict=True):
        joint = model.joint(name)
        if joint.nv != 1 or joint.mimic is not None:
            raise ModelError(f'joint "{name}" is {joint.kind}, expected an independent one of one freedom to drive')
        if any(j.shared is not None and j.shared[0] == name and j.name not in names for j in joints.values()):
            raise ModelError(f'joint "{name}" is driven by two transmissions, expected one')
        made[name] = replace(joints[name], armature=float(own), rotor=None, shared=None)
    for i, one in enumerate(names):
        for k, other in enumerate(names[:i]):
            if B[i, k]:
                a, b = model.joint(one), model.joint(other)
                behind, before = (a, b) if model.joints[a.parent].name == other else (b, a)
                if model.joints[behind.parent].name != before.name or made[behind.name].shared is not None:
                    raise ModelError(
                        f'joints "{other}" and "{one}" share motors and are apart in the tree, expected one right '
                        "before the other: M would not be sparse"
                    )
                made[behind.name] = replace(made[behind.name], shared=(before.name, float(B[i, k])))
    return made


def _identified(model: Model, given: ArrayLike) -> dict[str, Link]:
    """The links of all joints' bodies with inertial parameters: a joint's own link has all, links fixed to it none.

    Raises ModelError for another shape; InertiaError naming the joint for a mass below 0, or first moment without mass.
    """
    pi = _numbers(given)
    if pi.shape != (model.njoints, 10) or not np.isfinite(pi).all():
        what = "numbers that are not finite" if pi.shape == (model.njoints, 10) else f"shape {pi.shape}"
        raise ModelError(f"inertial_parameters have {what}, expected finite ones of shape ({model.njoints}, 10)")
    names = {x.name for x in model.robot.links}
    made: dict[str, Link] = {}
    for frame in model.frames:
        if frame.kind == "link" and frame.name in names and frame.joint:
            made[frame.name] = Link(frame.name)
    own = {ROOT_JOINT: model.robot.root, **{j.name: j.child for j in model.robot.joints}}
    for joint, row in zip(model.joints[1:], pi[1:].tolist(), strict=True):
        mass, h, (xx, xy, yy, xz, yz, zz) = row[0], np.array(row[1:4]), row[4:]
        if mass < 0.0 or (mass == 0.0 and h.any()):
            said = f"mass {mass:.6g} and first moment {h.tolist()}"
            raise InertiaError(f'joint "{joint.name}" has inertial parameters of {said}, expected a mass above 0')
        com = h / mass if mass else h
        about = parallel_axis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -mass, com)
        made[own[joint.name]] = make_link(own[joint.name], (mass, com, about))
    return made


def _refuse_shared(joints: Mapping[str, RobotJoint], name: str) -> None:
    """Raise ModelError for a joint whose inertia belongs to a transmission."""
    if joints[name].shared is not None or any(j.shared is not None and j.shared[0] == name for j in joints.values()):
        raise ModelError(f'joint "{name}" shares motors with another, expected its inertia by transmissions')


def _loaded(link: Link, load: Link) -> Link:
    """A link and a load in its frame as one link."""
    mass = link.mass + load.mass
    c = np.array(link.com)
    inertia = np.zeros((3, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        if mass > 0.0:
            c = (link.mass * c + load.mass * np.array(load.com)) / mass
        for part in (link, load):
            inertia += parallel_axis(np.reshape(part.inertia, (3, 3)), part.mass, np.array(part.com) - c)
    if not (math.isfinite(mass) and np.isfinite(c).all() and np.isfinite(inertia).all()):
        raise InertiaError(
            f'link "{link.name}" of {link.mass:.6g} kg with a payload of {load.mass:.6g} kg has an inertia that is '
            "beyond the largest float"
        )
    return replace(link, mass=mass, com=tuple(c.tolist()), inertia=tuple(inertia.ravel().tolist()))


def gravity_of(gravity: ArrayLike) -> tuple[float, ...]:
    """(3,) of gravity. Raises ModelError unless they are finite numbers."""
    g = _numbers(gravity)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise ModelError(f"gravity is {literal(gravity)}, expected three finite numbers")
    return tuple(g.tolist())


def _numbers(value: ArrayLike) -> Array:
    """A value as an array of floats; NaN if it is not numeric."""
    try:
        x = np.array(np.nan) if masked(value) else np.asarray(value)
    except (TypeError, ValueError):
        x = np.array(np.nan)
    with np.errstate(over="ignore"):
        return x.astype(float) if x.dtype.kind in "fiu" else np.array(np.nan)


def _pairs(argument: str, value: Any) -> Iterable[tuple[str, Any]]:
    """Items of an argument that maps names to values; none for None."""
    if value is None:
        return ()
    if not isinstance(value, Mapping):
        raise ModelError(f"{argument} is a {type(value).__name__}, expected a mapping of names to values")
    return value.items()
