"""Other libraries: models of Pinocchio, and states as MuJoCo and Drake write them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import bodies as table
from .assembly import IDENTITY
from .border import as_array, batch_shape, broadcast, check_model
from .errors import ConfigurationError, ModelError, SpatialDynError
from .model import Joint, Model, assemble
from .recursions.spec import Argument, Q, V
from .robot import Joint as RobotJoint
from .robot import Link, check_inertias, check_tree, make_joint, make_link, quoted

Array = NDArray[np.float64]

# --- models of Pinocchio ---------------------------------------------------------------------------------

PINOCCHIO_KINDS = {
    **{f"JointModelR{a}": "revolute" for a in "XYZ"},
    "JointModelRevoluteUnaligned": "revolute",
    **{f"JointModelRUB{a}": "continuous" for a in "XYZ"},
    "JointModelRevoluteUnboundedUnaligned": "continuous",
    **{f"JointModelP{a}": "prismatic" for a in "XYZ"},
    "JointModelPrismaticUnaligned": "prismatic",
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
    """The Model of a ``pinocchio.Model``: same joints, q, v, frames, limits and gravity, entry by entry.

    pin_model  a Model of Pinocchio 3 or later; nothing of Pinocchio is imported
    inertia    what to do with an inertia no body can have, as in ``load_urdf``

    Its universe becomes the root link, and a free flyer an ordinary floating joint. A joint's body is the link of
    its first body frame at the identity, else one named like the joint. Every other frame is a link without mass on
    a fixed joint; a fixed-joint frame is that joint. Unbounded and planar joints keep their (cos, sin). Limits of
    joints with several freedoms, and all else that a Model cannot hold, are listed in ``model.robot.notes``.
    Pinocchio's rotorInertia and rotorGearRatio, which enter no result there, are left out; armature is kept.

    Raises ModelError naming the joint for a type that is not revolute, prismatic, spherical, planar or free flyer
    and for joints not in depth-first order; InertiaError.
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
    """Raise ModelError naming the first joint that stands behind one it does not hang on, or its descendants."""
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
    """A placement row by row; rotation entries below 1e-15 are zero."""
    X = np.array(placement.homogeneous, dtype=float)
    X[:3, :3][abs(X[:3, :3]) < 1e-15] = 0.0
    return tuple(X.ravel().tolist())


def fresh_name(name: str, taken: set[str]) -> str:
    """The name, or one made of it that is not taken yet; it is then."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _links_and_frames(pin_model: Any, notes: list[str]) -> tuple[list[Link], list[RobotJoint]]:
    """The link of each joint, the universe's first, and the fixed joints that carry the other frames."""
    frames = [(f, f.type.name, _pose(f.placement)) for f in pin_model.frames][1:]
    names = list(pin_model.names)
    bodies: dict[int, int] = {}  # joint -> the frame that is its body's
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
            # the body behind a fixed joint is its child, as in the URDF both come from
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
            f'joint "{name}" is a {joint.shortname()}, expected a revolute, prismatic, spherical, planar or '
            "free-flyer joint"
        )
    axis = (0.0, 0.0, 1.0)
    if kind in ("revolute", "continuous", "prismatic"):
        data = joint.createData()
        joint.calc(data, np.zeros(pin_model.nq))
        S = np.ravel(data.S).tolist()
        axis = tuple(S[:3] if kind == "prismatic" else S[3:])
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
        )
    )


def _common(pin_model: Any, joint: Any, name: str, attribute: str, notes: list[str]) -> float:
    """One number for all freedoms of a joint: the largest, with a note if they differ."""
    at = slice(joint.idx_v, joint.idx_v + joint.nv)
    values = np.array(getattr(pin_model, attribute)[at], dtype=float)
    if (values != values[0]).any():
        text = f'joint "{name}" has {attribute} {values.tolist()}, expected one for all its freedoms'
        notes.append(f"{text}; the largest is kept")
    lower = LOWER_LIMITS.get(attribute, "")
    least = getattr(pin_model, lower, None)  # since Pinocchio 4; sizes only, for its addJoint writes +max there
    if least is not None and [_unlimited(abs(x)) for x in least[at]] != [_unlimited(x) for x in values]:
        notes.append(f'joint "{name}" has {lower} {least[at].tolist()}, which is left out')
    return _unlimited(float(values.max()))


def _armature(pin_model: Any, joint: Any) -> float | tuple[float, ...]:
    """One number for all freedoms of a joint, or one for each if they differ."""
    values = tuple(np.array(pin_model.armature[joint.idx_v : joint.idx_v + joint.nv], dtype=float).tolist())
    return values[0] if len(set(values)) == 1 else values


def _position_limits(pin_model: Any, joint: Any, name: str, kind: str, notes: list[str]) -> tuple[float, float]:
    """Limits of a joint of one coordinate; none for the others, with a note if the model has some."""
    at = slice(joint.idx_q, joint.idx_q + joint.nq)
    lower = [_unlimited(float(x)) for x in pin_model.lowerPositionLimit[at]]
    upper = [_unlimited(float(x)) for x in pin_model.upperPositionLimit[at]]
    if joint.nq == 1:
        return lower[0], upper[0]
    places = {"floating": 3, "planar": 2}.get(kind, 0)  # the coordinates behind are of unit norm
    if np.isfinite(lower[:places] + upper[:places]).any():
        notes.append(f'joint "{name}" has position limits {lower[:places]} to {upper[:places]}, which are left out')
    return -math.inf, math.inf


def _unlimited(x: float) -> float:
    """The largest float stands for no limit in Pinocchio."""
    return math.copysign(math.inf, x) if abs(x) >= np.finfo(float).max else x


# --- states of MuJoCo and Drake --------------------------------------------------------------------------


class _Place(NamedTuple):
    """Where a joint's numbers stand: q, v in ours, x, w in the other library's."""

    joint: Joint
    kind: int
    q: slice
    v: slice
    x: slice
    w: slice


Change = Callable[[_Place, Array, Array], tuple[Array, Array]]


def _unit(place: _Place, part: Array) -> Array:
    """A quaternion or pair of unit norm to rounding. Raises ConfigurationError if the one given is off by 1e-6."""
    norm = np.sqrt((part * part).sum(-1, keepdims=True))
    off = abs(norm - 1.0)[..., 0] > 1e-6
    if off.any():
        at = np.argwhere(off)[0]
        place_of = at[0] if len(at) == 1 else tuple(at.tolist())
        where = f" in sample {place_of}, the first of {off.sum()}" if len(at) else ""
        what = "quaternion" if part.shape[-1] == 4 else "(cos, sin) pair"
        raise ConfigurationError(
            f'joint "{place.joint.name}" has a {what} of norm {norm[(*at, 0)]:.9g}{where}, expected 1 within 1e-6'
        )
    return np.asarray(part / norm)


def _turned(quaternion: Array, u: Array, back: bool = False) -> Array:
    """R u, or Rᵀ u, for the rotation of a unit quaternion x y z w."""
    axis, w = quaternion[..., :3] * (-1.0 if back else 1.0), quaternion[..., 3:]
    t = 2.0 * np.cross(axis, u)
    return np.asarray(u + w * t + np.cross(axis, t))


def _same(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    return q, v


def _angle_of(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    pair = _unit(place, q)
    return np.arctan2(pair[..., 1:], pair[..., :1]), v


def _pair_of(place: _Place, x: Array, w: Array) -> tuple[Array, Array]:
    return np.concatenate([np.cos(x), np.sin(x)], -1), w


def _in_plane(pair: Array, v: Array, back: float) -> Array:
    """v [vx, vy, ω] turned in the plane, or (back -1) turned back."""
    c, s = pair[..., 0], pair[..., 1] * back
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1], v[..., 2]], -1)


def _planar_to(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    if place.kind == table.PLANAR_CS:
        q = np.concatenate([q[..., :2], _angle_of(place, q[..., 2:], v)[0]], -1)
    return q, _in_plane(_pair_of(place, q[..., 2:], v)[0], v, 1.0)


def _planar_from(place: _Place, x: Array, w: Array) -> tuple[Array, Array]:
    pair = _pair_of(place, x[..., 2:], w)[0]
    q = np.concatenate([x[..., :2], pair], -1) if place.kind == table.PLANAR_CS else x
    return q, _in_plane(pair, w, -1.0)


def _w_first(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    _unit(place, q)
    return np.roll(q, 1, -1), v


def _w_last(place: _Place, x: Array, w: Array) -> tuple[Array, Array]:
    _unit(place, x)
    return np.roll(x, -1, -1), w


def _floating_to_mujoco(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    linear = _turned(_unit(place, q[..., 3:]), v[..., :3])
    return np.concatenate([q[..., :3], np.roll(q[..., 3:], 1, -1)], -1), np.concatenate([linear, v[..., 3:]], -1)


def _floating_from_mujoco(place: _Place, x: Array, w: Array) -> tuple[Array, Array]:
    quaternion = np.roll(x[..., 3:], -1, -1)
    linear = _turned(_unit(place, quaternion), w[..., :3], back=True)
    return np.concatenate([x[..., :3], quaternion], -1), np.concatenate([linear, w[..., 3:]], -1)


def _floating_to_drake(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    unit = _unit(place, q[..., 3:])
    w = np.concatenate([_turned(unit, v[..., 3:]), _turned(unit, v[..., :3])], -1)
    return np.concatenate([np.roll(q[..., 3:], 1, -1), q[..., :3]], -1), w


def _floating_from_drake(place: _Place, x: Array, w: Array) -> tuple[Array, Array]:
    quaternion = np.roll(x[..., :4], -1, -1)
    unit = _unit(place, quaternion)
    v = np.concatenate([_turned(unit, w[..., 3:], back=True), _turned(unit, w[..., :3], back=True)], -1)
    return np.concatenate([x[..., 4:], quaternion], -1), v


_COMMON: dict[int, tuple[Change, Change]] = {
    table.REVOLUTE: (_same, _same),
    table.PRISMATIC: (_same, _same),
    table.REVOLUTE_CS: (_angle_of, _pair_of),
    table.PLANAR: (_planar_to, _planar_from),
    table.PLANAR_CS: (_planar_to, _planar_from),
}
_MUJOCO = {
    **_COMMON,
    table.SPHERICAL: (_w_first, _w_last),
    table.FLOATING: (_floating_to_mujoco, _floating_from_mujoco),
}
_DRAKE = {**_COMMON, table.FLOATING: (_floating_to_drake, _floating_from_drake)}
_THEIR_NQ = {table.REVOLUTE_CS: 1, table.PLANAR_CS: 3}


def to_mujoco(model: Model, q: ArrayLike, v: ArrayLike, joints: Sequence[str] | None = None) -> tuple[Array, Array]:
    """The state as MuJoCo writes it: ``qpos, qvel = to_mujoco(model, q, v)``.

    q       (..., nq)  joint positions [rad | m]
    v       (..., nv)  joint velocities [rad/s | m/s]
    joints  all joint names in MuJoCo's order; by default it is the model's own

    floating    free joint: position, quaternion w x y z; velocity of the origin in the world's axes, angular
                velocity in the body's. It has to hang on the world at the identity
    spherical   ball joint: quaternion w x y z, angular velocity in the body's axes
    planar      two slide joints along the plane's axes, then a hinge: x, y, θ and their rates
    continuous  hinge: a (cos, sin) pair becomes its angle in [-π, π]
    others      hinge or slide joint: the same number

    Returns qpos (..., number of theirs), qvel (..., nv).
    Raises  SpatialDynError for a floating joint elsewhere, mimic joints, or ``joints`` that are not all of the
            model's once; ConfigurationError for a quaternion or pair not of unit norm; ShapeError.
    """
    places = _places(model, joints, "MuJoCo", _MUJOCO)
    return _changed(model, places, _MUJOCO, (q, v), outward=True, names=("q", "v"))


def from_mujoco(
    model: Model, qpos: ArrayLike, qvel: ArrayLike, joints: Sequence[str] | None = None
) -> tuple[Array, Array]:
    """The state of MuJoCo as the model's: ``q, v = from_mujoco(model, qpos, qvel)``, the inverse of ``to_mujoco``.

    Returns q (..., nq), v (..., nv).
    Raises  what ``to_mujoco`` does.
    """
    places = _places(model, joints, "MuJoCo", _MUJOCO)
    return _changed(model, places, _MUJOCO, (qpos, qvel), outward=False, names=("qpos", "qvel"))


def to_drake(model: Model, q: ArrayLike, v: ArrayLike, joints: Sequence[str] | None = None) -> tuple[Array, Array]:
    """The state as Drake's MultibodyPlant writes it: ``q, v = to_drake(model, q, v)``.

    q       (..., nq)  joint positions [rad | m]
    v       (..., nv)  joint velocities [rad/s | m/s]
    joints  all joint names in Drake's order; by default it is the model's own

    floating    quaternion floating joint: quaternion w x y z, position; angular, then linear velocity, both in the
                axes of the frame it hangs on (the world's for a base)
    spherical   refused: Drake's ball joint has roll, pitch and yaw
    planar      planar joint: x, y, θ and their rates, in the axes of the frame it hangs on
    continuous  revolute joint: a (cos, sin) pair becomes its angle in [-π, π]
    others      the same number

    Returns Drake's q (..., number of theirs), v (..., nv).
    Raises  SpatialDynError for spherical or mimic joints, or ``joints`` that are not all of the model's once;
            ConfigurationError for a quaternion or pair not of unit norm; ShapeError.
    """
    places = _places(model, joints, "Drake", _DRAKE)
    return _changed(model, places, _DRAKE, (q, v), outward=True, names=("q", "v"))


def from_drake(model: Model, q: ArrayLike, v: ArrayLike, joints: Sequence[str] | None = None) -> tuple[Array, Array]:
    """The state of a Drake MultibodyPlant as the model's, the inverse of ``to_drake``.

    Returns q (..., nq), v (..., nv).
    Raises  what ``to_drake`` does.
    """
    places = _places(model, joints, "Drake", _DRAKE)
    return _changed(model, places, _DRAKE, (q, v), outward=False, names=("q", "v"))


def _places(
    model: Model, joints: Sequence[str] | None, library: str, changes: Mapping[int, tuple[Change, Change]]
) -> list[_Place]:
    """The model's joints in the other library's order. Raises SpatialDynError for one it does not have."""
    check_model(model)
    if model.mimic_matrix is not None:
        dependent = [j.name for j in model.joints if j.mimic is not None]
        raise SpatialDynError(
            f"joints {quoted(dependent)} have no coordinates, expected a model loaded with mimic=False, for {library} "
            "has coordinates for them"
        )
    order = model.joints[1:] if joints is None else tuple(model.joint(name) for name in joints)
    if {j.name for j in order} != set(model.names[1:]) or len(order) != len(model.names) - 1:
        raise SpatialDynError(f"joints are {quoted(j.name for j in order)}, expected all of the model's, each once")
    places, x, w = [], 0, 0
    for joint in order:
        kind = int(model.bodies[joint.row - joint.nv + 1]["kind"])
        if kind not in changes:
            raise SpatialDynError(
                f'joint "{joint.name}" is {joint.kind}, expected a kind of joint that {library} writes as a rotation '
                "without a choice of angles"
            )
        if library == "MuJoCo" and kind == table.FLOATING and (joint.parent or (joint.placement != np.eye(4)).any()):
            raise SpatialDynError(
                f'floating joint "{joint.name}" hangs on "{model.joints[joint.parent].name}" at '
                f"{joint.placement[:3].tolist()}, expected the world at the identity, as MuJoCo's free joints do"
            )
        nx = _THEIR_NQ.get(kind, joint.nq)
        places.append(
            _Place(
                joint, kind, slice(joint.idx_q, joint.idx_q + joint.nq), slice(joint.idx_v, joint.idx_v + joint.nv),
                slice(x, x + nx), slice(w, w + joint.nv),
            )
        )  # fmt: skip
        x, w = x + nx, w + joint.nv
    return places


def _changed(
    model: Model,
    places: Sequence[_Place],
    changes: Mapping[int, tuple[Change, Change]],
    state: tuple[ArrayLike, ArrayLike],
    outward: bool,
    names: tuple[str, str],
) -> tuple[Array, Array]:
    """A state, checked and broadcast, with each joint's numbers changed and put in their new place."""
    nx = places[-1].x.stop if places else 0
    q_spec = replace(Q, name=names[0], shape=("nq" if outward else nx,))
    specs: list[Argument] = [q_spec, replace(V, name=names[1])]
    a, b = (as_array(x.name, value) for x, value in zip(specs, state, strict=True))
    batch = broadcast(list(names), [batch_shape(model, x, y) for x, y in zip(specs, (a, b), strict=True)])
    a, b = (np.broadcast_to(y, (*batch, y.shape[-1])) for y in (a, b))
    c, d = np.empty((*batch, nx if outward else model.nq)), np.empty((*batch, model.nv))
    for place in places:
        if outward:
            c[..., place.x], d[..., place.w] = changes[place.kind][0](place, a[..., place.q], b[..., place.v])
        else:
            c[..., place.q], d[..., place.v] = changes[place.kind][1](place, a[..., place.x], b[..., place.w])
    return c, d
