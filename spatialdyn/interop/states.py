"""States of MuJoCo and Drake: the order of a joint's numbers, and the axes of its velocity.

For each kind of joint two functions convert the joint's part of a state, in either direction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.rotations import NORM_TOLERANCE
from ..bodies import kinds
from ..calls.arguments import as_array, batch_shape, broadcast, check_model
from ..errors import ConfigurationError, SpatialDynError, literal
from ..model.model import Joint, Model
from ..model.robot_checks import quoted
from ..recursions.spec import Argument, Q, V

Array = NDArray[np.float64]


class _Place(NamedTuple):
    """Slices of a joint's numbers: q and v in the model's state, x and w in the other library's state."""

    joint: Joint
    kind: int
    q: slice
    v: slice
    x: slice
    w: slice


Conversion = Callable[[_Place, Array, Array], tuple[Array, Array]]


def _unit(place: _Place, part: Array) -> Array:
    """A normalized quaternion or pair. Raises ConfigurationError if its norm differs from 1 by more than 1e-6."""
    norm = np.sqrt((part * part).sum(-1, keepdims=True))
    off = abs(norm - 1.0)[..., 0] > NORM_TOLERANCE
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
    """R u, or Rᵀ u if ``back``, for the rotation R of a unit quaternion x y z w."""
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
    """v [vx, vy, ω] rotated in the plane, backwards if ``back`` is -1."""
    c, s = pair[..., 0], pair[..., 1] * back
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1], v[..., 2]], -1)


def _planar_to(place: _Place, q: Array, v: Array) -> tuple[Array, Array]:
    if place.kind == kinds.PLANAR_CS:
        q = np.concatenate([q[..., :2], _angle_of(place, q[..., 2:], v)[0]], -1)
    return q, _in_plane(_pair_of(place, q[..., 2:], v)[0], v, 1.0)


def _planar_from(place: _Place, x: Array, w: Array) -> tuple[Array, Array]:
    pair = _pair_of(place, x[..., 2:], w)[0]
    q = np.concatenate([x[..., :2], pair], -1) if place.kind == kinds.PLANAR_CS else x
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


_COMMON: dict[int, tuple[Conversion, Conversion]] = {
    kinds.REVOLUTE: (_same, _same),
    kinds.PRISMATIC: (_same, _same),
    kinds.REVOLUTE_CS: (_angle_of, _pair_of),
    kinds.PLANAR: (_planar_to, _planar_from),
    kinds.PLANAR_CS: (_planar_to, _planar_from),
}
_MUJOCO = {
    **_COMMON,
    kinds.SPHERICAL: (_w_first, _w_last),
    kinds.FLOATING: (_floating_to_mujoco, _floating_from_mujoco),
}
_DRAKE = {
    **_COMMON,
    kinds.FLOATING: (_floating_to_drake, _floating_from_drake),
    kinds.HELICAL: (_same, _same),
}
_THEIR_NQ = {kinds.REVOLUTE_CS: 1, kinds.PLANAR_CS: 3}


def to_mujoco(model: Model, q: ArrayLike, v: ArrayLike, joints: Sequence[str] | None = None) -> tuple[Array, Array]:
    """The state in MuJoCo's conventions: ``qpos, qvel = to_mujoco(model, q, v)``.

    q       (..., nq)  joint positions [rad | m]
    v       (..., nv)  joint velocities [rad/s | m/s]
    joints  all joint names in MuJoCo's order, by default the model's

    floating    free joint: position, quaternion w x y z; velocity of the origin in the world's axes, angular
                velocity in the body's. Its parent must be the world, its placement the identity
    spherical   ball joint: quaternion w x y z, angular velocity in the body's axes
    planar      two slide joints along the plane's axes, then a hinge: x, y, θ and their rates
    continuous  hinge: a (cos, sin) pair becomes its angle in [-π, π]
    helical     refused: MuJoCo has no screw joint
    others      hinge or slide joint: the same number

    Returns qpos (..., number of entries in MuJoCo), qvel (..., nv).
    Raises  SpatialDynError for a floating joint elsewhere, for helical or mimic joints, or unless ``joints`` names each
            joint of the model once; ConfigurationError for a quaternion or pair not of unit norm; ShapeError.
    """
    places = _places(model, joints, "MuJoCo", _MUJOCO)
    return _changed(model, places, _MUJOCO, (q, v), outward=True, names=("q", "v"))


def from_mujoco(
    model: Model, qpos: ArrayLike, qvel: ArrayLike, joints: Sequence[str] | None = None
) -> tuple[Array, Array]:
    """The model's state from MuJoCo's: ``q, v = from_mujoco(model, qpos, qvel)``, the inverse of ``to_mujoco``.

    Returns q (..., nq), v (..., nv).
    Raises  what ``to_mujoco`` raises.
    """
    places = _places(model, joints, "MuJoCo", _MUJOCO)
    return _changed(model, places, _MUJOCO, (qpos, qvel), outward=False, names=("qpos", "qvel"))


def to_drake(model: Model, q: ArrayLike, v: ArrayLike, joints: Sequence[str] | None = None) -> tuple[Array, Array]:
    """The state in the conventions of Drake's MultibodyPlant: ``q, v = to_drake(model, q, v)``.

    q       (..., nq)  joint positions [rad | m]
    v       (..., nv)  joint velocities [rad/s | m/s]
    joints  all joint names in Drake's order, by default the model's

    floating    quaternion floating joint: quaternion w x y z, position; angular, then linear velocity, both in the
                parent frame's axes (the world's for a base)
    spherical   SpatialDynError: Drake's ball joint has roll, pitch and yaw
    planar      planar joint: x, y, θ and their rates, in the parent frame's axes
    continuous  revolute joint: a (cos, sin) pair becomes its angle in [-π, π]
    helical     screw joint: the same angle
    others      the same number

    Returns Drake's q (..., number of entries in Drake), v (..., nv).
    Raises  SpatialDynError for spherical or mimic joints, or unless ``joints`` names each joint of the model once;
            ConfigurationError for a quaternion or pair not of unit norm; ShapeError.
    """
    places = _places(model, joints, "Drake", _DRAKE)
    return _changed(model, places, _DRAKE, (q, v), outward=True, names=("q", "v"))


def from_drake(model: Model, q: ArrayLike, v: ArrayLike, joints: Sequence[str] | None = None) -> tuple[Array, Array]:
    """The model's state from that of a Drake MultibodyPlant, the inverse of ``to_drake``.

    Returns q (..., nq), v (..., nv).
    Raises  what ``to_drake`` raises.
    """
    places = _places(model, joints, "Drake", _DRAKE)
    return _changed(model, places, _DRAKE, (q, v), outward=False, names=("q", "v"))


def _places(
    model: Model, joints: Sequence[str] | None, library: str, changes: Mapping[int, tuple[Conversion, Conversion]]
) -> list[_Place]:
    """The model's joints in the other library's order.

    Raises SpatialDynError for a joint that the other library cannot represent.
    """
    check_model(model)
    if model.mimic_matrix is not None:
        dependent = [j.name for j in model.joints if j.mimic is not None]
        raise SpatialDynError(
            f"joints {quoted(dependent)} have no coordinates, expected a model loaded with mimic=False, for {library} "
            "has coordinates for them"
        )
    try:
        order = model.joints[1:] if joints is None else tuple(model.joint(name) for name in tuple(joints))
    except TypeError:
        raise SpatialDynError(f"joints is {literal(joints)}, expected all of the model's, each once") from None
    if {j.name for j in order} != set(model.names[1:]) or len(order) != len(model.names) - 1:
        raise SpatialDynError(f"joints are {quoted(j.name for j in order)}, expected all of the model's, each once")
    places, x, w = [], 0, 0
    for joint in order:
        kind = int(model.bodies[joint.row - joint.nv + 1]["kind"])
        if kind not in changes:
            raise SpatialDynError(
                f'joint "{joint.name}" is {joint.kind}, expected a kind of joint that {library} has and writes '
                "without a choice of angles"
            )
        if library == "MuJoCo" and kind == kinds.FLOATING and (joint.parent or (joint.placement != np.eye(4)).any()):
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
    changes: Mapping[int, tuple[Conversion, Conversion]],
    state: tuple[ArrayLike, ArrayLike],
    outward: bool,
    names: tuple[str, str],
) -> tuple[Array, Array]:
    """Check and broadcast a state, and convert the numbers of each joint."""
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
