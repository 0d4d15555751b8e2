"""The Model: a robot as a table of bodies, with its names, limits and frames."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.rotations import NORM_TOLERANCE
from ..bodies.kinds import kind_of
from ..errors import InertiaError, ModelError
from .assembly import GRAVITY, IDENTITY, ROOT_JOINT, Frame, Options, Tables, tables
from .joint_rows import Joint, frozen, joint_transform
from .physical_inertia import inertia_defect, parallel_axis
from .robot import Link, Robot, RobotJoint, Rotor
from .robot_checks import check_tree, floats, make_link, masked, with_rotor
from .transmission import Transmission

Array = NDArray[np.float64]
__all__ = ["Frame", "Joint", "Model", "Options", "assemble"]

DEEP = 40  # levels that a printed tree indents; deeper ones are numbered, or a chain of n links would take n² columns


class Model:
    """A robot ready for computation: immutable, hashable by content, thread-safe.

    key           digest of everything that results depend on: models with one key give the same results
    bodies        (1 + rows,) the table that every recursion walks (see ``spatialdyn.bodies.table``), read-only
    nq, nv        number of coordinates and of velocities
    njoints       number of joints, the world included
    joints        tuple of Joint; joints[0] is the world
    frames        tuple of Frame: every link and joint, in the order of the tree
    names         joint names
    mimic_matrix  None, or G (rows, nv) with v of the full tree = G v; mimic_index, mimic_ratio, mimic_offset give q of
                  the full tree, and free_q, free_v the indices of the model's own coordinates in it
    lower, upper  (nq,) position limits, infinite where there are none
    velocity_limit, effort_limit, damping, friction, armature   (nv,)
    gravity       (3,) [m/s²]
    address       of ``bodies`` in memory, for compiled kernels
    total_mass    of all moving bodies [kg]; links fixed to a fixed root are left out
    robot         the checked robot it was made from; ``robot.notes`` list oddities of the source
    """

    __slots__ = (
        *Tables._fields,
        *(
            "options",
            "name",
            "njoints",
            "names",
            "gravity",
            "address",
            "total_mass",
            "_frame_index",
            "_joint_index",
            "_plans",
            "__weakref__",
        ),
    )

    robot: Robot
    options: Options
    name: str
    key: str
    bodies: NDArray[Any]
    nq: int
    nv: int
    njoints: int
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    effort_limit: Array
    damping: Array
    friction: Array
    armature: Array
    gravity: Array
    address: int
    total_mass: float
    mimic_matrix: Array | None
    mimic_index: NDArray[np.intp]
    mimic_ratio: Array
    mimic_offset: Array
    free_q: NDArray[np.intp]
    free_v: NDArray[np.intp]
    _frame_index: dict[str, int]
    _joint_index: dict[str, int]
    _plans: dict[str, Any]  # what ``calls`` keeps of its programs: no part of the model's content

    def __init__(self, robot: Robot, options: Options) -> None:
        """The Model of a checked robot; ``assemble`` takes the options one by one."""
        if hasattr(self, "key"):
            raise AttributeError("a Model is immutable: it cannot be made again")
        self._hold(tables(robot, options), options)

    def _hold(self, made: Tables, options: Options) -> None:
        robot = made.robot
        slots = {
            **made._asdict(),
            "options": options,
            "name": robot.name,
            "njoints": len(made.joints),
            "names": tuple(j.name for j in made.joints),
            "gravity": frozen(options.gravity),
            "address": made.bodies.ctypes.data,
            "total_mass": float(made.bodies["inertia"]["m"][1:].sum()),
            "_frame_index": {f"{f.kind}:{f.name}": k for k, f in enumerate(made.frames)},
            "_joint_index": {j.name: k for k, j in enumerate(made.joints)},
            "_plans": {},
        }
        for slot, value in slots.items():
            object.__setattr__(self, slot, value)

    def __setattr__(self, name: str, value: Any) -> None:
        how = "model.with_() and model.reduced() make new ones"
        raise AttributeError(f"a Model is immutable: {name} cannot be set; {how}")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Model is immutable: {name} cannot be deleted")

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self.robot, self.options)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and self.robot == other.robot and self.options == other.options

    def __hash__(self) -> int:
        return hash(self.key)

    def joint(self, name: str) -> Joint:
        """The joint of that name. Raises ModelError, with similar names, if there is none."""
        try:
            return self.joints[self._joint_index[name]]
        except (KeyError, TypeError):
            raise ModelError(missing("joint", name, self.name, self._joint_index)) from None

    def frame(self, name: str | Frame) -> Frame:
        """The frame of that name: a link's, else a joint's; ``link:NAME`` and ``joint:NAME`` say which.

        Raises ModelError, with similar names, if there is none.
        """
        if isinstance(name, Frame):  # perhaps of another model: its name alone counts
            name = f"{name.kind}:{name.name}"
        if not isinstance(name, str):
            raise ModelError(f'frame is {name!r}, expected the name of one of robot "{self.name}"')
        for key in (name, f"link:{name}", f"joint:{name}"):
            if key in self._frame_index:
                return self.frames[self._frame_index[key]]
        raise ModelError(missing("frame", str(name), self.name, [f.name for f in self.frames]))

    def reduced(self, lock: Mapping[str, ArrayLike] | Iterable[str]) -> Model:
        """The Model with some joints locked: their bodies merge into their parents', their frames stay.

        lock  joint name -> coordinates at which it is locked: a number, or (nq,) of the joint. Or names of joints:
              locked at neutral, or at the nearest limit if neutral is outside the limits

        Raises ModelError if lock is neither, or naming an unknown joint or a value of the wrong size or norm.
        """
        options, joints = self.options, {j.name: j for j in self.robot.joints}
        lock = lock_values(self, lock)
        for name, value in lock.items():
            joint = self.joint(name)
            X = _locked(joint, options.continuous, value)
            if name == ROOT_JOINT and options.root == "floating":
                options = replace(options, root="fixed", base=_moved(options.base, X))
            else:
                at = _moved(joints[name].placement, X)
                joints[name] = replace(joints[name], kind="fixed", placement=at, mimic=None, rotor=None, shared=None)
        for j in [j for j in joints.values() if j.shared is not None and j.shared[0] in lock]:
            joints[j.name] = replace(j, shared=None)
        for j in joints.values():
            if j.spring is not None and (j.name in lock) != (j.spring.joint in lock):
                raise ModelError(
                    f'joint "{j.spring.joint}" is driven by the spring of "{j.name}"; lock both or neither'
                )
            if options.mimic and j.kind != "fixed" and j.mimic is not None and j.mimic.leader in lock:
                raise ModelError(f'joint "{j.name}" mimics "{j.mimic.leader}", which is to be locked; lock both')
        return Model(replace(self.robot, joints=tuple(joints.values())), options)

    def subtree(self, link: str) -> Model:
        """The Model of a link and its subtree, the link fixed in the world.

        Raises ModelError if there is no such link.
        """
        if link not in {x.name for x in self.robot.links}:
            raise ModelError(missing("link", link, self.name, [x.name for x in self.robot.links]))
        keep, children = {link}, self.robot.children
        queue = [link]
        while queue:
            for joint in children[queue.pop()]:
                keep.add(joint.child)
                queue.append(joint.child)
        links = tuple(x for x in self.robot.links if x.name in keep)
        joints = tuple(j for j in self.robot.joints if j.parent in keep and j.child in keep)
        there = {j.name for j in joints}
        joints = tuple(replace(j, shared=None) if j.shared and j.shared[0] not in there else j for j in joints)
        robot = check_tree(self.robot.name, links, joints, self.robot.notes)
        robot = replace(robot, ordered=self.robot.ordered, source=self.robot.source)
        return Model(robot, replace(self.options, root="fixed", base=IDENTITY))

    def with_(
        self,
        gravity: ArrayLike | None = None,
        armature: Mapping[str, float] | None = None,
        payload: Mapping[str, tuple[float, ArrayLike, ArrayLike]] | None = None,
        rotors: Mapping[str, Rotor | None] | None = None,
        transmissions: Iterable[Transmission] = (),
    ) -> Model:
        """A new Model with other gravity, rotor inertias or loads.

        gravity   (3,) [m/s²]
        armature  joint name -> reflected rotor inertia [kg m² | kg], in place of the present one
        payload   frame -> (mass [kg], com (3,) [m], inertia (3, 3) about it [kg m²]) in that frame, added to its link
        rotors    joint name -> Rotor, or None for none; it takes the place of the joint's armature
        transmissions  whose rotor inertias take the place of their joints' armatures. Off the diagonal of M they may
                  couple a joint of one freedom and the one right before it: what is further apart has no sparse M

        Raises ModelError, InertiaError naming the joint or frame and the value.
        """
        options, robot = self.options, self.robot
        if gravity is not None:
            options = replace(options, gravity=_gravity(gravity))
        joints = {j.name: j for j in robot.joints}
        for name, value in _pairs("armature", armature):
            if name not in joints:
                raise ModelError(missing("joint", name, self.name, joints))
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
                raise ModelError(missing("joint", name, self.name, joints))
            _refuse_shared(joints, name)
            bare = replace(joints[name], armature=0.0, rotor=None)
            joints[name] = bare if rotor is None else with_rotor(bare, rotor)
        for transmission in transmissions:
            joints.update(self._driven(transmission, joints))
        links = {x.name: x for x in robot.links}
        child = {ROOT_JOINT: robot.root, **{j.name: j.child for j in robot.joints}}
        for name, load in _pairs("payload", payload):
            frame = self.frame(name)
            owner = frame.name if frame.kind == "link" else child[frame.name]
            part = make_link(frame.name, load)
            defect = inertia_defect(np.reshape(part.inertia, (3, 3)))
            if defect:
                raise InertiaError(f'payload of frame "{frame.name}" {defect}')
            links[owner] = _loaded(links[owner], part)
        return Model(replace(robot, joints=tuple(joints.values()), links=tuple(links.values())), options)

    def _driven(self, transmission: Transmission, joints: Mapping[str, RobotJoint]) -> dict[str, RobotJoint]:
        """The joints of a transmission with its inertias. Raises ModelError naming those it cannot drive."""
        if not isinstance(transmission, Transmission):
            raise ModelError(f"transmissions has {transmission!r}, expected a Transmission")
        B, names = transmission.reflected_inertia(), transmission.joints
        made: dict[str, RobotJoint] = {}
        for name, own in zip(names, B.diagonal(), strict=True):
            joint = self.joint(name)
            if joint.nv != 1 or joint.mimic is not None:
                raise ModelError(f'joint "{name}" is {joint.kind}, expected an independent one of one freedom to drive')
            if any(j.shared is not None and j.shared[0] == name and j.name not in names for j in joints.values()):
                raise ModelError(f'joint "{name}" is driven by two transmissions, expected one')
            made[name] = replace(joints[name], armature=float(own), rotor=None, shared=None)
        for i, one in enumerate(names):
            for k, other in enumerate(names[:i]):
                if B[i, k]:
                    a, b = self.joint(one), self.joint(other)
                    behind, before = (a, b) if self.joints[a.parent].name == other else (b, a)
                    if self.joints[behind.parent].name != before.name or made[behind.name].shared is not None:
                        raise ModelError(
                            f'joints "{other}" and "{one}" share motors and are apart in the tree, expected one right '
                            "before the other: M would not be sparse"
                        )
                    made[behind.name] = replace(made[behind.name], shared=(before.name, float(B[i, k])))
        return made

    def __repr__(self) -> str:
        return (
            f"<Model {self.name}: nq {self.nq}, nv {self.nv}, {len(self.robot.links)} links, {self.total_mass:.6g} kg>"
        )

    def __str__(self) -> str:
        return "\n".join(self._tree())

    def _repr_html_(self) -> str:
        from ..pictures.notebook import model_html

        return model_html(self)

    def _tree(self) -> Iterator[str]:
        """A readable tree: a line per link, with its joint."""
        options = self.options
        yield f"{self.name}: {self.nv} freedoms, {self.total_mass:.6g} kg moving, {options.root} root"
        mass = {x.name: x.mass for x in self.robot.links}
        children = self.robot.children
        stack: list[tuple[str, int, RobotJoint | None]] = [(self.robot.root, 0, None)]
        while stack:
            link, depth, joint = stack.pop()
            indent = "  " * depth if depth <= DEEP else "  " * DEEP + f"({depth}) "
            how = "" if joint is None else f" <- {joint.name} ({joint.kind})"
            yield f"{indent}{link}{how}  {mass[link]:.6g} kg"
            stack += [(j.child, depth + 1, j) for j in reversed(children[link])]


def assemble(
    robot: Robot,
    root: str = "fixed",
    gravity: ArrayLike = GRAVITY,
    continuous: str = "angle",
    mimic: bool = False,
) -> Model:
    """The Model of a checked robot.

    root        "fixed", or "floating": six freedoms between the world and the root link, joint ``root_joint``
    gravity     (3,) acceleration of gravity [m/s²]
    continuous  "angle": one coordinate; "cos_sin": two, as Pinocchio has it (planar joints too)
    mimic       True makes the coordinates of mimic joints dependent

    Raises ModelError naming the option, or the mimic joint without a leader; or if robot is not a Robot.
    """
    if not isinstance(robot, Robot):
        raise ModelError(
            f"robot is a {type(robot).__name__}, expected a Robot, as read_urdf and ModelBuilder make them"
        )
    return Model(robot, options_of(root, gravity, continuous, mimic))


def options_of(root: str, gravity: ArrayLike, continuous: str, mimic: bool) -> Options:
    """The options of ``assemble``. Raises ModelError naming an invalid one and its value."""
    if not isinstance(mimic, (bool, np.bool_, int)) or mimic not in (0, 1):
        raise ModelError(f"mimic is {mimic!r}, expected True or False")
    return Options(root, _gravity(gravity), continuous, bool(mimic))


def _refuse_shared(joints: Mapping[str, RobotJoint], name: str) -> None:
    """Raise ModelError for a joint whose inertia belongs to a transmission."""
    if joints[name].shared is not None or any(j.shared is not None and j.shared[0] == name for j in joints.values()):
        raise ModelError(f'joint "{name}" shares motors with another, expected its inertia by transmissions')


def _gravity(gravity: ArrayLike) -> tuple[float, ...]:
    g = _numbers(gravity)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise ModelError(f"gravity is {gravity!r}, expected three finite numbers")
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


def lock_values(model: Model, lock: Any) -> dict[str, Any]:
    """{joint: coordinates} of the joints to lock, given as such a mapping or as names. Raises ModelError."""
    if lock is None or isinstance(lock, Mapping):
        return dict(lock or {})
    try:
        names = [lock] if isinstance(lock, str) else list(lock)
    except TypeError:
        expected = "expected names of joints, or a mapping of them to coordinates"
        raise ModelError(f"lock is {lock!r}, {expected}") from None
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


def missing(what: str, name: str, robot: str, names: Iterable[str]) -> str:
    """The message for an unknown name, with similar names."""
    near = difflib.get_close_matches(str(name), dict.fromkeys(names), 3, 0.5)
    hint = f", did you mean {' or '.join(near)}" if near else ""
    return f'{what} "{name}" is not in robot "{robot}"{hint}'


def _locked(joint: Joint, continuous: str, value: ArrayLike) -> Array:
    """X_J (4, 4) of a joint at given coordinates. Raises ModelError unless they are nq finite numbers of unit norm."""
    if joint.kind == "world":
        raise ModelError("the world cannot be locked")
    q = np.atleast_1d(_numbers(value))
    if joint.kind == "continuous" and q.shape == (1,):
        continuous = "angle"
    elif q.shape != (joint.nq,):
        raise ModelError(f'joint "{joint.name}" is locked at {value!r}, expected {joint.nq} finite numbers')
    if not np.isfinite(q).all():
        raise ModelError(f'joint "{joint.name}" is locked at {value!r}, expected {len(q)} finite numbers')
    unit = kind_of(joint.kind, continuous).unit
    if unit is not None and abs(math.hypot(*q[unit]) - 1.0) > NORM_TOLERANCE:
        raise ModelError(f'joint "{joint.name}" is locked at {q.tolist()}, expected a part of unit norm')
    with np.errstate(over="ignore", invalid="ignore"):  # ``assembly`` refuses what is not finite
        return joint_transform(joint.kind, joint.axis, q, continuous, joint.pitch)


def _moved(placement: tuple[float, ...], X: Array) -> tuple[float, ...]:
    """A placement of 16 numbers, followed by the pose X (4, 4)."""
    with np.errstate(over="ignore", invalid="ignore"):  # ``assembly`` refuses what is not finite
        return tuple((np.reshape(placement, (4, 4)) @ X).ravel().tolist())


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
