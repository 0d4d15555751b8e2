"""From a checked robot to a table of bodies, in the steps that ``tables`` takes.

1. ``mimics.resolve_mimics``  which joint each mimic joint follows in the end; followers of fixed ones become fixed
2. ``walk``                   depth first through the tree: the joints that move, their merged inertias, the frames
3. ``tabulate``               a row of the table for each freedom, and the joints with their places in q and v
4. ``mimics.mimic_map``       how the coordinates of the whole tree follow from the model's own

``model.Model`` gives the result a name and methods; nothing here knows of it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.euclidean import Sym, Vec
from ..algebra.records import put_vec
from ..algebra.spatial import Inertia, Pose, add_inertia, compose, identity_pose, inertia_to_parent
from ..bodies import table as table
from ..errors import InertiaError, ModelError
from .joint_rows import Joint, blank, frozen, matrix, pose, put_joint, row_kind, subspace
from .mimic import Mimics, mimic_map, resolve_mimics
from .robot import Joint as RobotJoint
from .robot import Link, Mimic, Robot

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
    """How a robot is made a Model: root, gravity [m/s²], continuous, mimic, and where a fixed root link stands.

    ``any_norm`` takes quaternions and (cos, sin) pairs as they are, where they are refused off their unit norm.

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
            raise ModelError(f'root is {self.root!r}, expected "fixed" or "floating"')
        if not isinstance(self.continuous, str) or self.continuous not in ("angle", "cos_sin"):
            raise ModelError(f'continuous is {self.continuous!r}, expected "angle" or "cos_sin"')


class Tables(NamedTuple):
    """What a Model holds, under the names it has there; arrays are read-only."""

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
    whose placement or inertia is beyond the largest float.
    """
    _refuse_reserved_names(robot, options)
    leaders: dict[str, Mimic] = {}
    if options.mimic:
        robot, leaders = resolve_mimics(robot)
    moving, inertias, places = walk(robot, pose(options.base), options.root)
    frames = [Frame(name, kind, body, matrix(X)) for name, kind, body, X in places]
    bodies, joints = tabulate(moving, inertias, options)
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
        key=digest(bodies, mimics),
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
    """The world and the joint of a floating root have names that no other joint may have."""
    reserved = ("universe", ROOT_JOINT) if options.root == "floating" else ("universe",)
    for joint in robot.joints:
        if joint.name in reserved:
            raise ModelError(f'robot "{robot.name}" has a joint "{joint.name}", expected another name: it is reserved')


def refuse_overflow(robot: str, bodies: NDArray[Any], joints: Sequence[Joint], frames: Sequence[Frame] = ()) -> None:
    """Refuse sums and products of finite numbers that are not finite.

    Raises ModelError, InertiaError naming the frame, the joint or the robot.
    """
    placed = [("joint", joint.name, joint.placement) for joint in joints]
    placed += [(frame.kind, frame.name, frame.placement) for frame in frames]
    for kind, name, X in placed:
        if not np.isfinite(X).all():
            at = X[:3, 3].tolist()
            raise ModelError(f'{kind} "{name}" stands at {at} in the body that carries it, expected finite numbers')
    for column in ("inertia", "bound"):
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


def digest(bodies: NDArray[Any], mimics: Mimics | None = None) -> str:
    """Digest of all that a result depends on."""
    made = hashlib.sha256(bodies.tobytes())
    if mimics is not None and mimics.matrix is not None:
        for part in (mimics.matrix, mimics.source, mimics.ratio, mimics.offset):
            made.update(part.tobytes())
    return made.hexdigest()


# --- the walk through the tree ---------------------------------------------------------------------------


class Moving(NamedTuple):
    """A joint that moves, the index of the joint whose body carries it, and its pose in that body."""

    joint: RobotJoint
    parent: int
    X: Pose


def walk(robot: Robot, base: Pose, root: str) -> tuple[list[Moving], list[Inertia], list[tuple[str, str, int, Pose]]]:
    """The joints that move, depth first, the inertia of each one's body (index 0: the world), and the frames.

    base    where the root link stands at q = 0
    root    "fixed" or "floating"

    A joint's index is its place in the first list plus one. A fixed joint merges what it carries into the body it
    hangs on. A frame is its name, its kind, its joint's index and its pose there. The robot's numbers may be of any
    kind that has + - *.
    """
    moving: list[Moving] = []
    inertias: list[Inertia] = [NOTHING]
    frames: list[tuple[str, str, int, Pose]] = []
    links, children = {link.name: link for link in robot.links}, robot.children
    # what is still to be walked: a link, the joint it hangs on, the body that carries that joint, a pose in that body
    stack: list[tuple[str, RobotJoint | None, int, Pose]] = [(robot.root, None, 0, base)]
    if root == "floating":
        joint = RobotJoint(ROOT_JOINT, "floating", "", robot.root, IDENTITY)
        stack = [(robot.root, joint, 0, base)]
    while stack:
        link, hung, body, X = stack.pop()
        if hung is not None:
            X = compose(X, pose(hung.placement))
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
    """Mass, first moment and inertia about the link's origin. Raises InertiaError if they overflow."""
    c, I = np.array(link.com), np.reshape(link.inertia, (3, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        about, first = I + link.mass * (c @ c * np.eye(3) - np.outer(c, c)), link.mass * c
    if about.dtype.kind == "f" and not (np.isfinite(about).all() and np.isfinite(first).all()):
        if link.mass:
            raise InertiaError(
                f'link "{link.name}" has mass {link.mass:.6g} and com {link.com}, whose inertia about the link\'s '
                "origin is beyond the largest float"
            )
        about = I  # 0 times a square that overflows
    return Inertia(link.mass, Vec(*first.tolist()), Sym(*about[np.triu_indices(3)].tolist()))


# --- the table -------------------------------------------------------------------------------------------


def tabulate(
    moving: Sequence[Moving], inertias: Sequence[Inertia], options: Options
) -> tuple[NDArray[Any], list[Joint]]:
    """The table of bodies, read-only, and the joints with their places in the whole tree's q and v."""
    kinds = [row_kind(m.joint.kind, options.continuous) for m in moving]
    bodies = blank(sum(table.NV[kind] for kind in kinds))
    joints = [Joint("universe", "world", 0, 0, 0, 0, 0, 0, matrix(identity_pose()), frozen(np.zeros(3)))]
    at, row = 0, 1
    for index, ((joint, parent, X), kind) in enumerate(zip(moving, kinds, strict=True), start=1):
        nq, nv = table.NQ[kind], table.NV[kind]
        put_joint(bodies, row, kind, X, subspace(joint.kind, joint.axis), at)
        bodies["parent"][row] = joints[parent].row
        bodies["armature"][row : row + nv] = joint.armature
        last = row + nv - 1
        bodies["joint"][last], bodies["inertia"][last] = index, inertias[index]
        joints.append(Joint(joint.name, joint.kind, parent, last, at, nq, row - 1, nv, matrix(X), frozen(joint.axis)))
        at, row = at + nq, row + nv
    bodies[0].at, bodies[0].dofs = at, len(joints)
    bodies[0].kind = table.ANY_NORM if options.any_norm else 0
    put_vec(bodies[0].gravity, Vec(*options.gravity))
    _put_last(bodies)
    return completed(bodies), joints


def completed(bodies: NDArray[Any]) -> NDArray[Any]:
    """A table with all that follows from its other columns, read-only: over bytes, which nobody can make writable."""
    _put_bounds(bodies)
    _drop_signs_of_zeros(bodies)
    return np.frombuffer(bodies.tobytes(), bodies.dtype)


def _put_last(bodies: NDArray[Any]) -> None:
    """Fill the column last."""
    last, parents = list(range(len(bodies))), bodies["parent"].tolist()
    for i in range(len(bodies) - 1, 0, -1):
        last[parents[i]] = max(last[parents[i]], last[i])
    bodies["last"] = last


def _put_bounds(bodies: NDArray[Any]) -> None:
    """Fill the column bound: how much inertia a row can see at most, with every joint below it stretched."""
    mass, first, second = ([0.0] * len(bodies) for _ in range(3))
    columns = (bodies[name].tolist() for name in ("parent", "X", "S", "inertia"))
    for i, (parent, (_, at), (w, _), (m, h, I)) in reversed([*enumerate(zip(*columns, strict=True))][1:]):
        xx, xy, xz, yy, yz, zz = I
        mass[i] += m
        first[i] += math.hypot(*h)
        second[i] += math.hypot(xx, xy, xz, xy, yy, yz, xz, yz, zz)  # no square over- or underflows
        bodies["bound"][i] = (second[i], first[i], mass[i]) if any(w) else (mass[i], 0.0, 0.0)
        p = math.hypot(*at)
        mass[parent] += mass[i]
        first[parent] += first[i] + p * mass[i]
        second[parent] += second[i]
        if mass[i]:  # else p may be a length whose square overflows
            second[parent] += 2.0 * p * first[i] + p * p * mass[i]


def _drop_signs_of_zeros(record: NDArray[Any]) -> None:
    """Turn -0.0 into 0.0, for tables that are equal must have one digest."""
    for name in record.dtype.names or ():
        column = record[name]
        if column.dtype.names:
            _drop_signs_of_zeros(column)
        elif column.dtype.kind == "f":
            column += 0.0
