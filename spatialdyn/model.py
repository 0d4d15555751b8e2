"""The Model: a robot as a table of bodies, with the names, limits and frames that belong to it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import bodies as table
from .errors import ModelError
from .recursions.joints import joint_pose
from .robot import Joint as RobotJoint
from .robot import Link, Mimic, Robot, check_tree, make_link
from .spatial import Inertia, Pose, Rot, Sym, Vec, add_inertia, compose, inertia_to_parent

Array = NDArray[np.float64]
GRAVITY = (0.0, 0.0, -9.81)
IDENTITY = tuple(np.eye(4).ravel().tolist())
ROOT_JOINT = "root_joint"


class Joint(NamedTuple):
    """A joint of the Model; index 0 is the world.

    kind      world, revolute, continuous, prismatic, spherical, floating or planar
    parent    index of the joint whose body carries it
    row       row of the table on which its body hangs
    idx_q, nq place of its coordinates in q; idx_v, nv of its velocities in v (a mimic's are its leader's)
    placement (4, 4) pose in the parent joint's body at q = 0
    axis      (3,) unit vector in the joint's frame
    mimic     None, or (leader's index, multiplier, offset), chains resolved
    """

    name: str
    kind: str
    parent: int
    row: int
    idx_q: int
    nq: int
    idx_v: int
    nv: int
    placement: Array
    axis: Array
    mimic: tuple[int, float, float] | None = None


class Frame(NamedTuple):
    """A named frame: kind "link" or "joint", the joint whose body carries it, and its pose (4, 4) there."""

    name: str
    kind: str
    joint: int
    placement: Array


@dataclass(frozen=True)
class Options:
    """How a robot is made a Model: root, gravity [m/s²], continuous, mimic, and where a fixed root link stands."""

    root: str = "fixed"
    gravity: tuple[float, ...] = GRAVITY
    continuous: str = "angle"
    mimic: bool = False
    base: tuple[float, ...] = IDENTITY


class Model:
    """A robot ready to be computed with: immutable, hashable by content, safe to share between threads.

    bodies        (1 + rows,) the table every recursion walks (see ``spatialdyn.bodies``), read-only
    nq, nv        number of coordinates and of velocities
    njoints       number of joints, the world counted
    joints        tuple of Joint; joints[0] is the world
    frames        tuple of Frame: every link, every joint, in the order of the tree
    names         joint names
    mimic_matrix  None, or G (rows, nv) with v of the whole tree = G v; mimic_index, mimic_ratio, mimic_offset give q
                  of the whole tree, and free_q, free_v the places of the model's own coordinates in it
    lower, upper  (nq,) position limits, infinite where there are none
    velocity_limit, effort_limit, damping, friction, armature   (nv,)
    gravity       (3,) [m/s²]
    robot         the checked robot it was made from; ``robot.notes`` say what was odd about the source
    """

    __slots__ = (
        "robot", "options", "name", "bodies", "nq", "nv", "njoints", "joints", "frames", "names", "lower", "upper",
        "velocity_limit", "effort_limit", "damping", "friction", "armature", "gravity", "mimic_matrix", "mimic_index",
        "mimic_ratio", "mimic_offset", "free_q", "free_v", "_key", "_frame_index", "_joint_index", "__weakref__",
    )  # fmt: skip

    robot: Robot
    options: Options
    name: str
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
    mimic_matrix: Array | None
    mimic_index: NDArray[np.intp]
    mimic_ratio: Array
    mimic_offset: Array
    free_q: NDArray[np.intp]
    free_v: NDArray[np.intp]

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a Model is immutable: {name} cannot be set; model.with_() and model.reduced() make new ones")

    def __reduce__(self) -> tuple[Any, ...]:
        return _remake, (self.robot, self.options)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and self.robot == other.robot and self.options == other.options

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def key(self) -> str:
        """Digest of the table of bodies: two models with one key compute the same."""
        return self._key

    @property
    def total_mass(self) -> float:
        """Mass of all that moves [kg]; what hangs on a fixed root does not count."""
        return float(self.bodies["inertia"]["m"][1:].sum())

    def joint(self, name: str) -> Joint:
        """The joint of that name. Raises ModelError, with the names there are, if there is none."""
        try:
            return self.joints[self._joint_index[name]]
        except KeyError:
            raise ModelError(_missing("joint", name, self.name, self._joint_index)) from None

    def frame(self, name: str | Frame) -> Frame:
        """The frame of that name: a link's, else a joint's; ``link:NAME`` and ``joint:NAME`` say which.

        Raises ModelError, with names like it, if there is none.
        """
        if isinstance(name, Frame):
            return name
        for key in (name, f"link:{name}", f"joint:{name}"):
            if key in self._frame_index:
                return self.frames[self._frame_index[key]]
        raise ModelError(_missing("frame", str(name), self.name, [f.name for f in self.frames]))

    def reduced(self, lock: Mapping[str, ArrayLike]) -> Model:
        """The Model with some joints frozen: their bodies merge into what carries them, their frames stay.

        lock  joint name -> coordinates at which it is frozen: a number, or (nq,) of the joint

        Raises ModelError naming a joint that is not there or a value of the wrong size or norm.
        """
        base, joints = self.options.base, {j.name: j for j in self.robot.joints}
        root = self.options.root
        for name, value in lock.items():
            joint = self.joint(name)
            X = _frozen(self, joint, value)
            if name == ROOT_JOINT and name not in joints:
                root, base = "fixed", tuple((np.reshape(base, (4, 4)) @ X).ravel().tolist())
                continue
            at = np.reshape(joints[name].placement, (4, 4)) @ X
            joints[name] = replace(joints[name], kind="fixed", placement=tuple(at.ravel().tolist()), mimic=None)
        for j in joints.values():
            if self.options.mimic and j.mimic is not None and j.mimic.leader in lock:
                raise ModelError(f'joint "{j.name}" mimics "{j.mimic.leader}", which is to be locked; lock both')
        robot = replace(self.robot, joints=tuple(joints.values()))
        return _remake(robot, replace(self.options, root=root, base=base))

    def subtree(self, link: str) -> Model:
        """The Model of a link and all it carries, the link fixed in the world.

        Raises ModelError if there is no such link.
        """
        if link not in {x.name for x in self.robot.links}:
            raise ModelError(_missing("link", link, self.name, [x.name for x in self.robot.links]))
        keep, children = {link}, self.robot.children
        queue = [link]
        while queue:
            for joint in children[queue.pop()]:
                keep.add(joint.child)
                queue.append(joint.child)
        links = tuple(x for x in self.robot.links if x.name in keep)
        joints = tuple(j for j in self.robot.joints if j.parent in keep and j.child in keep)
        robot = replace(check_tree(self.robot.name, links, joints, self.robot.notes), ordered=self.robot.ordered)
        return _remake(robot, replace(self.options, root="fixed", base=IDENTITY))

    def with_(
        self,
        gravity: ArrayLike | None = None,
        armature: Mapping[str, float] | None = None,
        payload: Mapping[str, tuple[float, ArrayLike, ArrayLike]] | None = None,
    ) -> Model:
        """A new Model with other gravity, rotor inertias or loads.

        gravity   (3,) [m/s²]
        armature  joint name -> reflected rotor inertia [kg m² | kg], in place of the present one
        payload   frame -> (mass [kg], com (3,) [m], inertia (3, 3) about it [kg m²]) in that frame, added to its link

        Raises ModelError, InertiaError naming the joint or frame and the value.
        """
        options, robot = self.options, self.robot
        if gravity is not None:
            options = replace(options, gravity=_gravity(gravity))
        joints = {j.name: j for j in robot.joints}
        for name, value in (armature or {}).items():
            if name not in joints:
                raise ModelError(_missing("joint", name, self.name, joints))
            if not (math.isfinite(value) and value >= 0.0):
                raise ModelError(f'joint "{name}" has armature {value}, expected a finite number >= 0')
            joints[name] = replace(joints[name], armature=float(value))
        links = {x.name: x for x in robot.links}
        for name, load in (payload or {}).items():
            frame = self.frame(name)
            owner = frame.name if frame.kind == "link" else joints[frame.name].child
            links[owner] = _loaded(links[owner], make_link(name, load))
        return _remake(replace(robot, joints=tuple(joints.values()), links=tuple(links.values())), options)

    def __repr__(self) -> str:
        return f"<Model {self.name}: nq {self.nq}, nv {self.nv}, {len(self.robot.links)} links, {self.total_mass:.6g} kg>"

    def __str__(self) -> str:
        return "\n".join(self._tree())

    def _tree(self) -> Iterator[str]:
        """A readable tree: a line per link, with the joint it hangs on."""
        options = self.options
        yield f"{self.name}: {self.nv} freedoms, {self.total_mass:.6g} kg moving, {options.root} root"
        mass = {x.name: x.mass for x in self.robot.links}
        children = self.robot.children
        stack: list[tuple[str, str, RobotJoint | None]] = [(self.robot.root, "", None)]
        while stack:
            link, indent, joint = stack.pop()
            how = "" if joint is None else f" <- {joint.name} ({joint.kind})"
            yield f"{indent}{link}{how}  {mass[link]:.6g} kg"
            stack += [(j.child, indent + "  ", j) for j in reversed(children[link])]


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

    Raises ModelError naming the option, or the mimic joint without a leader.
    """
    return _remake(robot, Options(root, _gravity(gravity), continuous, bool(mimic)))


def _gravity(gravity: ArrayLike) -> tuple[float, ...]:
    g = np.asarray(gravity, dtype=float)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise ModelError(f"gravity is {gravity!r}, expected three finite numbers")
    return tuple(g.tolist())


def _missing(what: str, name: str, robot: str, names: Any) -> str:
    import difflib

    near = difflib.get_close_matches(name, list(names), 3, 0.5)
    hint = f", did you mean {' or '.join(near)}" if near else ""
    return f'{what} "{name}" is not in robot "{robot}"{hint}'


# --- from links and joints to a table --------------------------------------------------------------------


def _pose(placement: Any) -> Pose:
    X = np.reshape(placement, (4, 4)).tolist()
    return Pose(Rot(*X[0][:3], *X[1][:3], *X[2][:3]), Vec(X[0][3], X[1][3], X[2][3]))


def _matrix(X: Pose) -> Array:
    M = np.eye(4)
    M[:3, :3] = np.reshape(X.R, (3, 3))
    M[:3, 3] = X.p
    return M


def _inertia(link: Link) -> Inertia:
    """Mass, first moment and inertia about the link's origin."""
    c, I = np.array(link.com), np.reshape(link.inertia, (3, 3)) 
    about = I + link.mass * (c @ c * np.eye(3) - np.outer(c, c))
    return Inertia(link.mass, Vec(*(link.mass * c).tolist()), Sym(*about[np.triu_indices(3)].tolist()))


def _loaded(link: Link, load: Link) -> Link:
    """Two bodies in one frame as one link."""
    total = add_inertia(_inertia(link), _inertia(load))
    if total.m == 0.0:
        return link
    c = np.array(total.h) / total.m
    parts = np.zeros((3, 3))
    for part in (link, load):
        d = np.array(part.com) - c
        parts += np.reshape(part.inertia, (3, 3)) + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return replace(link, mass=total.m, com=tuple(c.tolist()), inertia=tuple(parts.ravel().tolist()))


_CODES = {
    ("revolute", "angle"): table.REVOLUTE,
    ("revolute", "cos_sin"): table.REVOLUTE,
    ("continuous", "angle"): table.REVOLUTE,
    ("continuous", "cos_sin"): table.REVOLUTE_CS,
    ("prismatic", "angle"): table.PRISMATIC,
    ("prismatic", "cos_sin"): table.PRISMATIC,
    ("spherical", "angle"): table.SPHERICAL,
    ("spherical", "cos_sin"): table.SPHERICAL,
    ("floating", "angle"): table.FLOATING,
    ("floating", "cos_sin"): table.FLOATING,
    ("planar", "angle"): table.PLANAR,
    ("planar", "cos_sin"): table.PLANAR_CS,
}


def subspace(kind: str, axis: ArrayLike) -> Array:
    """Motion subspaces (freedoms, 6) of a joint's rows, angular first, in its frame.

    A plane's two axes are what the shortest rotation that takes z to its normal makes of x and y.
    """
    u = np.asarray(axis, dtype=float)
    if kind in ("revolute", "continuous"):
        return np.array([[*u, 0.0, 0.0, 0.0]])
    if kind == "prismatic":
        return np.array([[0.0, 0.0, 0.0, *u]])
    linear_first = np.roll(np.eye(6), 3, axis=1)
    if kind == "floating":
        return linear_first
    if kind == "spherical":
        return linear_first[3:]
    S = np.zeros((3, 6))
    if u[2] <= -1.0 + 1e-15:
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    else:
        k = 1.0 / (1.0 + u[2])
        x = np.array([1.0 - k * u[0] * u[0], -k * u[0] * u[1], -u[0]])
        y = np.array([-k * u[0] * u[1], 1.0 - k * u[1] * u[1], -u[1]])
    S[0, 3:], S[1, 3:], S[2, :3] = x, y, u
    return S


class _Row(NamedTuple):
    joint: RobotJoint
    parent: int  # joint index
    X: Pose


def _resolve_mimics(robot: Robot) -> dict[str, Mimic | None]:
    """For each mimic joint the independent joint it follows in the end, or None if that is fixed."""
    joints = {j.name: j for j in robot.joints}
    found: dict[str, Mimic | None] = {}
    for joint in robot.joints:
        if joint.mimic is None or joint.kind == "fixed":
            continue
        ratio, offset, at, seen = 1.0, 0.0, joint, [joint.name]
        while at.mimic is not None and at.kind != "fixed":
            offset += ratio * at.mimic.offset
            ratio *= at.mimic.multiplier
            leader = at.mimic.leader
            if leader not in joints:
                raise ModelError(f'joint "{at.name}" mimics "{leader}", which robot "{robot.name}" does not have')
            if leader in seen:
                raise ModelError(f"joints {' -> '.join([*seen, leader])} mimic each other in a circle")
            seen.append(leader)
            at = joints[leader]
        found[joint.name] = Mimic(at.name, ratio, offset) if at.kind != "fixed" else Mimic("", 0.0, offset)
    return found


def _remake(robot: Robot, options: Options) -> Model:
    if options.root not in ("fixed", "floating"):
        raise ModelError(f'root is {options.root!r}, expected "fixed" or "floating"')
    if options.continuous not in ("angle", "cos_sin"):
        raise ModelError(f'continuous is {options.continuous!r}, expected "angle" or "cos_sin"')
    if options.mimic:
        robot, leaders = _freeze_followers_of_fixed(robot)
    else:
        leaders = {}
    rows, inertias, frames = _walk(robot, options)
    return _tabulate(robot, options, rows, inertias, frames, leaders)


def _freeze_followers_of_fixed(robot: Robot) -> tuple[Robot, dict[str, Mimic]]:
    leaders = {name: m for name, m in _resolve_mimics(robot).items() if m is not None}
    joints = []
    for joint in robot.joints:
        m = leaders.get(joint.name)
        if m is not None and m.leader == "":
            X = np.reshape(joint.placement, (4, 4)) @ _one_freedom(joint.kind, joint.axis, m.offset)
            joint = replace(joint, kind="fixed", placement=tuple(X.ravel().tolist()))
            del leaders[joint.name]
        joints.append(joint)
    return replace(robot, joints=tuple(joints)), leaders


def _walk(robot: Robot, options: Options) -> tuple[list[_Row], list[Inertia], list[Frame]]:
    """Depth first through the tree: the moving joints, their merged inertias, and the frames."""
    none = Inertia(0.0, Vec(0.0, 0.0, 0.0), Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    rows: list[_Row] = []
    inertias, frames = [none], []
    links, children = {x.name: x for x in robot.links}, robot.children
    stack: list[tuple[str, int, Pose]] = [(robot.root, 0, _pose(options.base))]
    if options.root == "floating":
        joint = RobotJoint(ROOT_JOINT, "floating", "", robot.root, IDENTITY)
        rows.append(_Row(joint, 0, _pose(options.base)))
        inertias.append(none)
        frames.append(Frame(ROOT_JOINT, "joint", 1, np.eye(4)))
        stack = [(robot.root, 1, _pose(IDENTITY))]
    pending: dict[str, RobotJoint] = {}
    while stack:
        name, at, X = stack.pop()
        if name in pending:
            joint = pending.pop(name)
            here = compose(X, _pose(joint.placement))
            if joint.kind == "fixed":
                frames.append(Frame(joint.name, "joint", at, _matrix(here)))
                X = here
            else:
                rows.append(_Row(joint, at, here))
                inertias.append(none)
                at, X = len(rows), _pose(IDENTITY)
                frames.append(Frame(joint.name, "joint", at, np.eye(4)))
        frames.append(Frame(name, "link", at, _matrix(X)))
        inertias[at] = add_inertia(inertias[at], inertia_to_parent(X, _inertia(links[name])))
        for joint in reversed(children[name]):
            pending[joint.child] = joint
            stack.append((joint.child, at, X))
    return rows, inertias, frames


def _tabulate(
    robot: Robot,
    options: Options,
    rows: list[_Row],
    inertias: list[Inertia],
    frames: list[Frame],
    leaders: Mapping[str, Mimic],
) -> Model:
    """The table of bodies and everything that is indexed like it."""
    codes = [_CODES[r.joint.kind, options.continuous] for r in rows]
    n = sum(table.NV[c] for c in codes)
    b = np.zeros(n + 1, table.BODIES)
    b["X"]["R"]["xx"] = b["X"]["R"]["yy"] = b["X"]["R"]["zz"] = 1.0
    world = Joint("universe", "world", 0, 0, 0, 0, 0, 0, np.eye(4), np.zeros(3))
    joints, at, iq = [world], 1, 0
    for index, ((joint, parent, X), code) in enumerate(zip(rows, codes, strict=True), start=1):
        nv, nq = table.NV[code], table.NQ[code]
        S = subspace(joint.kind, joint.axis)
        for k in range(nv):
            row = b[at + k]
            row["parent"] = joints[parent].row if k == 0 else at + k - 1
            row["kind"] = code if k == 0 else table.FOLLOW
            row["dofs"] = nv if k == 0 else 0
            row["at"] = iq
            for part, values in zip("wv", (S[k, :3], S[k, 3:]), strict=True):
                for c, value in zip("xyz", values.tolist(), strict=True):
                    row["S"][part][c] = value
            row["armature"] = joint.armature
        put(b[at]["X"], X)
        last = at + nv - 1
        b[last]["joint"] = index
        put(b[last]["inertia"], inertias[index])
        joints.append(
            Joint(joint.name, joint.kind, parent, last, iq, nq, at - 1, nv, _matrix(X), _frozen_array(joint.axis))
        )
        at, iq = at + nv, iq + nq
    for field, value in zip("xyz", options.gravity, strict=True):
        b[0]["gravity"][field] = value
    b[0]["at"], b[0]["dofs"] = iq, len(joints)
    _subtrees_and_bounds(b)
    lower, upper = np.full(iq, -math.inf), np.full(iq, math.inf)
    per_row = {label: np.zeros(n) for label in ("velocity", "effort", "damping", "friction", "armature")}
    for joint, (source, _, _) in zip(joints[1:], rows, strict=True):
        if joint.nq == 1:
            lower[joint.idx_q], upper[joint.idx_q] = source.lower, source.upper
        for label, values in per_row.items():
            values[joint.idx_v : joint.idx_v + joint.nv] = getattr(source, label)

    model = object.__new__(Model)

    def put_slot(name: str, value: Any) -> None:
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        object.__setattr__(model, name, value)

    G, index_q, ratio, offset, joints = _mimic_map(joints, leaders, iq, n)
    free = [j for j in joints[1:] if j.mimic is None]
    first_q = [int(b[j.row - j.nv + 1]["at"]) for j in free]
    free_q = np.array([at + k for at, j in zip(first_q, free, strict=True) for k in range(j.nq)], dtype=np.intp)
    free_v = np.array([j.row - j.nv + k for j in free for k in range(j.nv)], dtype=np.intp)
    lower, upper = lower[free_q], upper[free_q]
    per_row = {label: values[free_v] for label, values in per_row.items()}
    put_slot("robot", robot)
    put_slot("options", options)
    put_slot("name", robot.name)
    put_slot("bodies", b)
    put_slot("nq", len(lower))
    put_slot("nv", n if G is None else G.shape[1])
    put_slot("njoints", len(joints))
    put_slot("joints", tuple(joints))
    put_slot("frames", tuple(frames))
    put_slot("names", tuple(j.name for j in joints))
    put_slot("lower", lower)
    put_slot("upper", upper)
    put_slot("velocity_limit", per_row["velocity"])
    put_slot("effort_limit", per_row["effort"])
    for label in ("damping", "friction", "armature"):
        put_slot(label, per_row[label])
    put_slot("gravity", np.array(options.gravity))
    put_slot("mimic_matrix", G)
    put_slot("mimic_index", index_q)
    put_slot("mimic_ratio", ratio)
    put_slot("mimic_offset", offset)
    put_slot("free_q", free_q)
    put_slot("free_v", free_v)
    digest = hashlib.sha256(b.tobytes())
    if G is not None:
        for part in (G, index_q, ratio, offset):
            digest.update(part.tobytes())
    put_slot("_key", digest.hexdigest())
    put_slot("_frame_index", {f"{f.kind}:{f.name}": k for k, f in enumerate(frames)})
    put_slot("_joint_index", {j.name: k for k, j in enumerate(joints)})
    return model


def put(record: Any, value: Any) -> None:
    """Write a NamedTuple of spatial.py into a record of the same layout."""
    for name, part in zip(value._fields, value, strict=True):
        if isinstance(part, tuple):
            put(record[name], part)
        else:
            record[name] = part


def _frozen_array(values: ArrayLike) -> Array:
    a = np.array(values, dtype=float)
    a.flags.writeable = False
    return a


def _subtrees_and_bounds(b: NDArray[Any]) -> None:
    """Fill the columns last and bound: how much inertia a row can see at most, with every joint below it stretched."""
    n = len(b) - 1
    b["last"] = np.arange(n + 1)
    mass, first, second = (np.zeros(n + 1) for _ in range(3))
    for i in range(n, 0, -1):
        I = b[i]["inertia"] 
        J = I["I"]
        full = np.array([[J["xx"], J["xy"], J["xz"]], [J["xy"], J["yy"], J["yz"]], [J["xz"], J["yz"], J["zz"]]])
        mass[i] += I["m"]
        first[i] += math.hypot(*I["h"].tolist())
        second[i] += np.linalg.norm(full)
        turns = any(b[i]["S"]["w"].tolist())
        _put_vec(b[i]["bound"], (second[i], first[i], mass[i]) if turns else (mass[i], 0.0, 0.0))
        parent, p = b[i]["parent"], math.hypot(*b[i]["X"]["p"].tolist())
        mass[parent] += mass[i]
        first[parent] += first[i] + p * mass[i]
        second[parent] += second[i] + 2.0 * p * first[i] + p * p * mass[i]
        b["last"][parent] = max(b["last"][parent], b["last"][i])


def _put_vec(record: Any, values: tuple[float, float, float]) -> None:
    record["x"], record["y"], record["z"] = values


def _one_freedom(kind: str, axis: ArrayLike, value: float) -> Array:
    """X_J of a revolute, continuous or prismatic joint at a value."""
    b = np.zeros(2, table.BODIES)
    b["X"]["R"]["xx"] = b["X"]["R"]["yy"] = b["X"]["R"]["zz"] = 1.0
    b[1]["kind"] = _CODES[kind, "angle"]
    for part, values in zip("wv", np.split(subspace(kind, axis)[0], 2), strict=True):
        _put_vec(b[1]["S"][part], tuple(values.tolist()))
    return _matrix(joint_pose(b, 1, [float(value)]))


def _frozen(model: Model, joint: Joint, value: ArrayLike) -> Array:
    """X_J of a joint at given coordinates."""
    if joint.kind == "world":
        raise ModelError("the world cannot be locked")
    given = np.atleast_1d(np.asarray(value, dtype=float))
    first = joint.row - joint.nv + 1
    nq = table.NQ[int(model.bodies[first]["kind"])]
    if joint.kind == "continuous" and given.shape == (1,):
        return _one_freedom(joint.kind, joint.axis, float(given[0]))
    if given.shape != (nq,) or not np.isfinite(given).all():
        raise ModelError(f'joint "{joint.name}" is locked at {value!r}, expected {nq} finite numbers')
    units = {"spherical": given[:4], "floating": given[3:], "continuous": given[-2:], "planar": given[2:]}
    unit = units.get(joint.kind)
    if unit is not None and len(unit) in (2, 4) and abs(math.sqrt(unit @ unit) - 1.0) > 1e-6:
        raise ModelError(f'joint "{joint.name}" is locked at {given.tolist()}, expected a part of unit norm')
    q = np.zeros(int(model.bodies[0]["at"]))
    at = int(model.bodies[first]["at"])
    q[at : at + nq] = given
    b = model.bodies.copy()
    put(b[first]["X"], _pose(IDENTITY))
    return _matrix(joint_pose(b, first, q))


def _mimic_map(
    joints: list[Joint], leaders: Mapping[str, Mimic], nq: int, nv: int
) -> tuple[Array | None, NDArray[np.intp], Array, Array, list[Joint]]:
    """G (rows, nv), and for each coordinate of the whole tree its source, ratio and offset."""
    index, ratio, offset = np.arange(nq), np.ones(nq), np.zeros(nq)
    if not leaders:
        return None, index, ratio, offset, joints
    where = {j.name: k for k, j in enumerate(joints)}
    new_q = np.cumsum([0] + [0 if j.name in leaders else j.nq for j in joints])
    new_v = np.cumsum([0] + [0 if j.name in leaders else j.nv for j in joints])
    G = np.zeros((nv, int(new_v[-1])))
    renamed = []
    for k, j in enumerate(joints):
        m = leaders.get(j.name)
        lead = k if m is None else where[m.leader]
        if m is not None and (j.nq != 1 or joints[lead].nq != 1):
            raise ModelError(
                f'joint "{j.name}" mimics "{m.leader}", expected both to have one coordinate (continuous="angle")'
            )
        for c in range(j.nq):
            index[j.idx_q + c] = new_q[lead] + c
        for c in range(j.nv):
            G[j.idx_v + c, new_v[lead] + c] = 1.0 if m is None else m.multiplier
        if m is not None:
            ratio[j.idx_q], offset[j.idx_q] = m.multiplier, m.offset
        mimic = None if m is None else (lead, m.multiplier, m.offset)
        renamed.append(j._replace(idx_q=int(new_q[lead]), idx_v=int(new_v[lead]), mimic=mimic))
    return G, index, ratio, offset, renamed
