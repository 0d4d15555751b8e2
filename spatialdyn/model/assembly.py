"""From a checked robot to a table of bodies, in the steps of ``tables``.

1. ``mimic.resolve_mimics``  the leader of each mimic joint; mimics of fixed joints become fixed
2. ``walk``                  depth first through the tree: the joints that move, their merged inertias, the frames
3. ``tabulate``              a row of the table per freedom, and the joints with their indices in q and v
4. ``mimic.mimic_map``       the map from the model's coordinates to the full tree's

``model.Model`` holds the result; this module does not depend on it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.euclidean import Mat3, Sym, Vec, rotate, scale
from ..algebra.records import put_vec
from ..algebra.spatial import Inertia, Pose, add_inertia, compose, identity_pose, inertia_to_parent
from ..bodies import table
from ..bodies.kinds import kind_of
from ..errors import InertiaError, ModelError, literal
from .joint_rows import Joint, blank, frozen, matrix_from_pose, pose_from_matrix, put_joint, subspace
from .mimic import mimic_map, resolve_mimics
from .physical_inertia import parallel_axis
from .robot import Link, Mimic, Robot, RobotJoint

Array = NDArray[np.float64]
Places = NDArray[np.intp]

GRAVITY = (0.0, 0.0, -9.81)
IDENTITY = tuple(np.eye(4).ravel().tolist())
ROOT_JOINT = "root_joint"
NOTHING = Inertia(0.0, Vec(0.0, 0.0, 0.0), Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


class Frame(NamedTuple):
    """A named frame: kind "link" or "joint", the joint whose body carries it, and its pose (4, 4) there."""

    name: str
    kind: str
    joint: int
    placement: Array


@dataclass(frozen=True)
class Options:
    """Options of a Model: root, gravity [m/s²], continuous, mimic, and the pose ``base`` of a fixed root link.

    ``any_norm`` accepts quaternions and (cos, sin) pairs of any norm; by default only unit norm is accepted.

    Raises ModelError naming the option and its value.
    """

    root: str = "fixed"
    gravity: tuple[float, ...] = GRAVITY
    continuous: str = "angle"
    mimic: bool = False
    base: tuple[float, ...] = IDENTITY
    any_norm: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.root, str) or self.root not in ("fixed", "floating"):
            raise ModelError(f'root is {literal(self.root)}, expected "fixed" or "floating"')
        if not isinstance(self.continuous, str) or self.continuous not in ("angle", "cos_sin"):
            raise ModelError(f'continuous is {literal(self.continuous)}, expected "angle" or "cos_sin"')


class Tables(NamedTuple):
    """The tables of a Model, under its attributes' names; arrays are read-only."""

    robot: Robot
    key: str
    bodies: NDArray[Any]
    nq: int
    nv: int
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    effort_limit: Array
    damping: Array
    friction: Array
    armature: Array
    mimic_matrix: Array | None
    mimic_index: Places
    mimic_ratio: Array
    mimic_offset: Array
    free_q: Places
    free_v: Places


def tables(robot: Robot, options: Options) -> Tables:
    """The tables of a robot.

    Raises ModelError for reserved joint names and mimics without a leader; ModelError, InertiaError naming the joint
    whose placement or inertia overflows.
    """
    _refuse_reserved_names(robot, options)
    leaders: dict[str, Mimic] = {}
    if options.mimic:
        robot, leaders = resolve_mimics(robot)
    moving, inertias, places = walk(robot, pose_from_matrix(options.base), options.root)
    frames = [Frame(name, kind, body, matrix_from_pose(X)) for name, kind, body, X in places]
    bodies, joints = tabulate(moving, inertias, options, leaders)
    refuse_overflow(robot.name, bodies, joints, frames)
    free = [k for k, joint in enumerate(joints) if joint.name not in leaders]
    free_q = [at for k in free for at in range(joints[k].idx_q, joints[k].idx_q + joints[k].nq)]
    free_v = [at for k in free for at in range(joints[k].idx_v, joints[k].idx_v + joints[k].nv)]
    mimics = mimic_map(joints, leaders)

    sources = [(moving[k - 1].joint, joints[k]) for k in free[1:]]
    lower = [x for given, j in sources for x in ([given.lower] if j.nq == 1 else [-math.inf] * j.nq)]
    upper = [x for given, j in sources for x in ([given.upper] if j.nq == 1 else [math.inf] * j.nq)]

    def of_freedoms(label: str) -> Array:
        return frozen([getattr(given, label) for given, j in sources for _ in range(j.nv)])

    return Tables(
        robot=robot,
        key=digest(bodies),
        bodies=bodies,
        nq=len(free_q),
        nv=len(free_v),
        joints=tuple(mimics.joints),
        frames=tuple(frames),
        lower=frozen(lower),
        upper=frozen(upper),
        velocity_limit=of_freedoms("velocity"),
        effort_limit=of_freedoms("effort"),
        damping=of_freedoms("damping"),
        friction=of_freedoms("friction"),
        armature=frozen(bodies["armature"][1:][free_v]),
        mimic_matrix=mimics.matrix,
        mimic_index=mimics.source,
        mimic_ratio=mimics.ratio,
        mimic_offset=mimics.offset,
        free_q=frozen(free_q, np.intp),
        free_v=frozen(free_v, np.intp),
    )


def _refuse_reserved_names(robot: Robot, options: Options) -> None:
    """Raise ModelError if a joint has the name of the world or of a floating root's joint."""
    reserved = ("universe", ROOT_JOINT) if options.root == "floating" else ("universe",)
    for joint in robot.joints:
        if joint.name in reserved:
            raise ModelError(f'robot "{robot.name}" has a joint "{joint.name}", expected another name: it is reserved')


def refuse_overflow(robot: str, bodies: NDArray[Any], joints: Sequence[Joint], frames: Sequence[Frame] = ()) -> None:
    """Raise if sums and products of finite numbers overflow: ModelError, InertiaError naming frame, joint or robot.

    joints, frames  with the poses to check
    """
    placed = [("joint", joint.name, joint.placement) for joint in joints]
    placed += [(frame.kind, frame.name, frame.placement) for frame in frames]
    for kind, name, X in placed:
        if not np.isfinite(X).all():
            at = X[:3, 3].tolist()
            raise ModelError(f'{kind} "{name}" stands at {at} in the body that carries it, expected finite numbers')
    for column in ("inertia", "inertia_bound"):
        lost = np.flatnonzero(~_finite(bodies[column]))
        if len(lost):
            joint = next(joint for joint in joints if lost[-1] <= joint.row)
            raise InertiaError(f'joint "{joint.name}" moves an inertia that is beyond the largest float')
    if not math.isfinite(sum(bodies["inertia"]["m"].tolist())):
        raise InertiaError(f'robot "{robot}" has a total mass that is beyond the largest float')


def _finite(record: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether all numbers of each row of a column are finite."""
    if record.dtype.names:
        return np.asarray(np.logical_and.reduce([_finite(record[name]) for name in record.dtype.names]))
    return np.asarray(np.isfinite(record))


def digest(bodies: NDArray[Any]) -> str:
    """Digest of everything that results depend on, mimic joints included."""
    return hashlib.sha256(bodies.tobytes()).hexdigest()


UPPER = np.triu_indices(3)  # the entries of a symmetric matrix that are kept, in the order of Sym


# --- the walk through the tree ---------------------------------------------------------------------------


class Moving(NamedTuple):
    """A moving joint, the index of the joint whose body carries it, and its pose in that body."""

    joint: RobotJoint
    parent: int
    X: Pose


def walk(robot: Robot, base: Pose, root: str) -> tuple[list[Moving], list[Inertia], list[tuple[str, str, int, Pose]]]:
    """The moving joints, depth first, the inertia of each one's body (index 0: the world), and the frames.

    base    pose of the root link at q = 0
    root    "fixed" or "floating"

    A joint's index is its position in the first list plus one. A fixed joint merges its child into the parent's body. A
    frame is (name, kind, index of the joint whose body carries it, pose in that body). The robot's numbers may be of
    any type with + - *.
    """
    moving: list[Moving] = []
    inertias: list[Inertia] = [NOTHING]
    frames: list[tuple[str, str, int, Pose]] = []
    links, children = {link.name: link for link in robot.links}, robot.children
    # still to visit: a link, its joint, the index of the body that carries that joint, a pose in that body
    stack: list[tuple[str, RobotJoint | None, int, Pose]] = [(robot.root, None, 0, base)]
    if root == "floating":
        joint = RobotJoint(ROOT_JOINT, "floating", "", robot.root, IDENTITY)
        stack = [(robot.root, joint, 0, base)]
    while stack:
        link, hung, body, X = stack.pop()
        if hung is not None:
            X = compose(X, pose_from_matrix(hung.placement))
            if hung.kind != "fixed":
                moving.append(Moving(hung, body, X))
                inertias.append(NOTHING)
                body, X = len(moving), identity_pose()
            frames.append((hung.name, "joint", body, X))
        frames.append((link, "link", body, X))
        inertias[body] = add_inertia(inertias[body], inertia_to_parent(X, about_origin(links[link])))
        stack += [(joint.child, joint, body, X) for joint in reversed(children[link])]
    return moving, inertias, frames


def about_origin(link: Link) -> Inertia:
    """Mass, first moment and rotational inertia about the link's origin. Raises InertiaError if they overflow."""
    c, I = np.array(link.com), np.reshape(link.inertia, (3, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        about, first = parallel_axis(I, link.mass, c), link.mass * c
    if about.dtype.kind == "f" and not (np.isfinite(about).all() and np.isfinite(first).all()):
        if link.mass:
            raise InertiaError(
                f'link "{link.name}" has mass {link.mass:.6g} and com {link.com}, whose inertia about the link\'s '
                "origin is beyond the largest float"
            )
        about = I  # mass 0 times an overflowed square
    return Inertia(link.mass, Vec(*first.tolist()), Sym(*about[UPPER].tolist()))


# --- the table -------------------------------------------------------------------------------------------


def tabulate(
    moving: Sequence[Moving],
    inertias: Sequence[Inertia],
    options: Options,
    leaders: Mapping[str, Mimic] | None = None,
) -> tuple[NDArray[Any], list[Joint]]:
    """The table of bodies, read-only, and the joints with their indices in the full tree's q and v.

    leaders  of the joints that mimic others, by name
    """
    kinds = [kind_of(m.joint.kind, options.continuous) for m in moving]
    bodies = blank(sum(kind.nv for kind in kinds))
    joints = [Joint("universe", "world", 0, 0, 0, 0, 0, 0, matrix_from_pose(identity_pose()), frozen(np.zeros(3)))]
    at, row = 0, 1
    for index, ((joint, parent, X), kind) in enumerate(zip(moving, kinds, strict=True), start=1):
        nq, nv = kind.nq, kind.nv
        put_joint(bodies, row, kind.code, X, subspace(joint.kind, joint.axis, joint.pitch), at)
        bodies["parent"][row] = joints[parent].row
        bodies["armature"][row : row + nv] = joint.armature
        put_rotor(bodies, row, joint, X.R if parent else None)
        last = row + nv - 1
        bodies["joint"][last], bodies["inertia"][last] = index, inertias[index]
        placed, axis = matrix_from_pose(X), frozen(joint.axis)
        made = Joint(joint.name, joint.kind, parent, last, at, nq, row - 1, nv, placed, axis, pitch=joint.pitch)
        joints.append(made)
        at, row = at + nq, row + nv
    _put_couplings(bodies, moving, joints)
    _put_springs(bodies, moving, joints)
    where = {joint.name: joint.row for joint in joints}
    for name, mimic in (leaders or {}).items():
        row = where[name]
        bodies["leader"][row] = where.get(mimic.leader, 0)  # ``mimic_map`` refuses a leader that does not move
        bodies["ratio"][row], bodies["offset"][row] = mimic.multiplier + 0.0, mimic.offset + 0.0
    bodies[0].q_index, bodies[0].dofs = at, len(joints)
    bodies[0].kind = table.ANY_NORM if options.any_norm else 0
    if options.any_norm and bodies["geared"].any():
        raise ModelError("any_norm is True and joints have rotors, whose terms hold at unit norm only")
    put_vec(bodies[0].gravity, Vec(*options.gravity))
    _put_last(bodies)
    return completed(bodies), joints


def put_rotor(bodies: NDArray[Any], row: int, joint: RobotJoint, R: Mat3 | None) -> None:
    """Write the rotor of a joint into its row; R is the joint's rotation in its parent's body, None for the world."""
    rotor, e = joint.rotor, Vec(0.0, 0.0, 0.0)
    bodies["geared"][row] = 0
    if rotor is not None and rotor.axis is not None and R is not None:
        along = turns(joint.kind) and rotor.axis in (joint.axis, tuple(-x for x in joint.axis))
        bodies["geared"][row] = table.ALONG if along else table.ACROSS
        e = scale(rotor.ratio * rotor.inertia, rotate(R, Vec(*rotor.axis)))
    put_vec(bodies[row].rotor, e)


def _put_couplings(bodies: NDArray[Any], moving: Sequence[Moving], joints: Sequence[Joint]) -> None:
    """Write what motors behind a differential have off the diagonal. Raises ModelError naming joints that are apart."""
    for k, m in enumerate(moving, start=1):
        if m.joint.shared is not None:
            name, inertia = m.joint.shared
            row, before = joints[k].row, joints[joints[k].parent]
            if before.name != name or before.nv != 1 or bodies["partner"][before.row]:
                raise ModelError(
                    f'joint "{m.joint.name}" shares motors with "{name}", expected the joint right before it, of one '
                    "freedom, and one alone behind that"
                )
            bodies["coupled"][row], bodies["coupling"][row] = 1, inertia
            bodies["partner"][before.row] = row


def _put_springs(bodies: NDArray[Any], moving: Sequence[Moving], joints: Sequence[Joint]) -> None:
    """Write the springs of rotors. Raises ModelError naming a joint that does not move, or has two coordinates."""
    where = {joint.name: joint for joint in joints}
    for m in moving:
        spring = m.joint.spring
        if spring is not None:
            driven, rotor = where.get(spring.joint), where[m.joint.name]
            if driven is None or driven.nq != 1 or rotor.nq != 1:
                raise ModelError(
                    f'joint "{spring.joint}" is driven by the spring of "{rotor.name}", expected both to move, with '
                    'one coordinate each (continuous="angle")'
                )
            bodies["spring"][rotor.row], bodies["gear"][rotor.row] = driven.row, 1.0 / spring.ratio
            bodies["stiffness"][rotor.row], bodies["spring_damping"][rotor.row] = spring.stiffness, spring.damping


def turns(kind: str) -> bool:
    """Whether a joint of one freedom turns its body."""
    return kind_of(kind).motion in ("turn", "screw")


def completed(bodies: NDArray[Any]) -> NDArray[Any]:
    """A table with its derived columns filled, read-only: a view of bytes, which cannot be made writable."""
    _put_bounds(bodies)
    _drop_signs_of_zeros(bodies)
    return np.frombuffer(bodies.tobytes(), bodies.dtype)


def _put_last(bodies: NDArray[Any]) -> None:
    """Fill the column last_row."""
    last, parents = list(range(len(bodies))), bodies["parent"].tolist()
    for i in range(len(bodies) - 1, 0, -1):
        last[parents[i]] = max(last[parents[i]], last[i])
    bodies["last_row"] = last


def _put_bounds(bodies: NDArray[Any]) -> None:
    """Fill the column inertia_bound: a bound of a row's composite inertia in any configuration of its subtree."""
    mass, first, second = ([0.0] * len(bodies) for _ in range(3))
    columns = (bodies[name].tolist() for name in ("parent", "X", "S", "inertia"))
    for i, (parent, (_, at), (w, v), (m, h, I)) in reversed([*enumerate(zip(*columns, strict=True))][1:]):
        xx, xy, xz, yy, yz, zz = I
        mass[i] += m
        first[i] += math.hypot(*h)
        second[i] += math.hypot(xx, xy, xz, xy, yy, yz, xz, yz, zz)  # no square over- or underflows
        if any(w):
            pitch = math.hypot(*v)
            felt = second[i] + pitch * pitch * mass[i] if pitch and mass[i] else second[i]
            bodies["inertia_bound"][i] = (felt, first[i], mass[i])
        else:
            bodies["inertia_bound"][i] = (mass[i], 0.0, 0.0)
        p = math.hypot(*at)
        mass[parent] += mass[i]
        first[parent] += first[i] + p * mass[i]
        second[parent] += second[i]
        if mass[i]:  # without mass p may be a length whose square overflows
            second[parent] += 2.0 * p * first[i] + p * p * mass[i]


def _drop_signs_of_zeros(record: NDArray[Any]) -> None:
    """Turn -0.0 into 0.0, so that equal tables have equal digests."""
    for name in record.dtype.names or ():
        column = record[name]
        if column.dtype.names:
            _drop_signs_of_zeros(column)
        elif column.dtype.kind == "f":
            column += 0.0
