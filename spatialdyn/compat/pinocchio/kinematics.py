"""Where joints and frames are and how they move, and their Jacobians."""

from __future__ import annotations

import operator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import algebra, dynamics, kept
from ...engines import jit
from ...recursions import SPECS
from ...recursions.spec import LOCAL as IN_FRAME
from ...recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ...recursions.spec import WORLD as IN_WORLD
from .arguments import ArgumentError, RangeError, ValueRuntimeError, described
from .calls import perform, quick, vector
from .compiled import Made, placed
from .data import Run, clock, prepared
from .frame import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, ReferenceFrame
from .motion import Motion
from .se3 import SE3

Array = NDArray[np.float64]
CODES = {LOCAL: IN_FRAME, WORLD: IN_WORLD, LOCAL_WORLD_ALIGNED: ALIGNED}
PLACING = {
    IN_FRAME: "frame_jacobian_local",
    IN_WORLD: "frame_jacobian_world",
    ALIGNED: "frame_jacobian_aligned",
}
IDENTITY = np.eye(4)
F8 = np.dtype(np.float64)
_dynamics: Any = dynamics  # whose stub names the calls only


def joint_index(model: Any, index: Any) -> int:
    """An index of a joint. Raises RangeError if the model has no such joint, ArgumentError for no integer."""
    return _index(index, model.njoints, "joint")


def frame_index(model: Any, index: Any) -> int:
    """An index of a frame. Raises RangeError if the model has no such frame, ArgumentError for no integer."""
    return _index(index, len(model.frames), "frame")


def _index(index: Any, count: int, what: str) -> int:
    try:
        k = operator.index(index)
    except TypeError:
        raise ArgumentError(f"{what} index is {described(index)}, expected an integer") from None
    if not 0 <= k < count:
        raise RangeError(f"{what} index is {k}, expected one from 0 to {count - 1}")
    return k


def code_of(reference_frame: Any) -> int:
    """The library's code of a ReferenceFrame. Raises ArgumentError for anything else."""
    if type(reference_frame) is not ReferenceFrame:
        raise ArgumentError(f"reference frame is {described(reference_frame)}, expected a ReferenceFrame")
    return CODES[reference_frame]


# --- places ----------------------------------------------------------------------------------------------


def forwardKinematics(model: Any, data: Any, q: Any, v: Any = None, a: Any = None) -> None:
    """Place the joints: ``data.oMi``; with v their velocities ``data.v``, with a their accelerations ``data.a``.

    q     (nq,)  joint positions
    v, a  (nv,)  joint velocities and accelerations

    Frames are placed by ``updateFramePlacements``. Raises ArgumentError, a TypeError, for what is no array, ShapeError,
    a ValueError, for wrong sizes.
    """
    if v is None:
        _kinematics0(model, data, q)
    elif a is None:
        _kinematics1(model, data, q, v)
    else:
        _kinematics2(model, data, q, v, a)


def _places(model: Any, data: Any, q: Any) -> None:
    perform(model, data, "kinematics0", q)


def _velocities(model: Any, data: Any, q: Any, v: Any) -> None:
    perform(model, data, "kinematics1", q, v)


def _accelerations(model: Any, data: Any, q: Any, v: Any, a: Any) -> None:
    perform(model, data, "kinematics2", q, v, a)


_kinematics0 = quick(_places, "kinematics0", result=False)
_kinematics1 = quick(_velocities, "kinematics1", result=False)
_kinematics2 = quick(_accelerations, "kinematics2", result=False)


def updateGlobalPlacements(model: Any, data: Any) -> None:
    """Place the joints by their places in their parents: ``data.oMi`` of ``data.liMi``."""
    compiled, X, source = prepared(model, data), data.array("liMi"), data.latest("liMi")
    out = np.empty_like(X)
    out[0] = IDENTITY
    for k in range(1, len(X)):
        algebra.compose(out[model.parents[k]], X[k], out[k])
    if source is None:
        data.put("oMi", out)
        return
    run: Run = data.run_of("global_placements", model, compiled, X.shape)
    run.result[...] = out
    run.keep(source.q)
    data.ran(run)


def updateFramePlacements(model: Any, data: Any) -> None:
    """Place all frames by the joints' places: ``data.oMf``. Raises ShapeError if frames were added since."""
    compiled, frames = prepared(model, data), placed(model)
    data.check_frames(model)
    run: Run = data.run_of("frames", model, compiled, frames.placements.shape)
    kept.compose_all(data.array("oMi"), frames.joints, frames.placements, run.result)
    data.ran(run)


def updateFramePlacement(model: Any, data: Any, frame_id: int) -> SE3:
    """Place one frame by its joint's place; returns ``data.oMf[frame_id]``."""
    prepared(model, data)
    k, frames = frame_index(model, frame_id), placed(model)
    data.check_frames(model)
    found: SE3 = data.oMf[k]
    algebra.compose(data.array("oMi")[frames.joints[k]], frames.placements[k], found._x)
    return found


def framesForwardKinematics(model: Any, data: Any, q: Any) -> None:
    """Place the joints and all frames: ``data.oMi`` and ``data.oMf``."""
    try:
        run, frames, here = data._runs["kinematics0"], data._runs["frames"], model._placed
        compiled = model._made
        if (
            run.made is compiled
            and frames.made is compiled
            and compiled.joints is None
            and q.dtype is F8
            and len(here.joints) == len(frames.result)
            and not kept.placing()(run.table, q, run.result, run.memory, here.joints, here.placements, frames.result)
        ):
            run.stamp, frames.stamp = clock(), clock()
            if data._shown:
                data.refresh(run)
                data.refresh(frames)
            return
    except (AttributeError, KeyError, TypeError, ValueError):  # whatever is not as simple as that
        pass
    _kinematics0(model, data, q)
    updateFramePlacements(model, data)


# --- velocities and accelerations ------------------------------------------------------------------------


def _seen(m: Array, data: Any, joint: int, placement: Array | None, code: int) -> Array:
    """A motion of a joint's body, in the joint's frame, as that of a frame on it, in a reference."""
    out = np.empty(6)
    if code == IN_WORLD:
        algebra.motion_to_parent(data.array("oMi")[joint], m, out)
        return out
    if placement is None:
        out[:] = m
    else:
        algebra.motion_to_child(placement, m, out)
    if code == ALIGNED:
        R = data.array("oMi")[joint][:3, :3]
        if placement is not None:
            R = R @ placement[:3, :3]
        out[:3], out[3:] = R @ out[:3], R @ out[3:]
    return out


def _motion(field: str, data: Any, joint: int, placement: Array | None, reference_frame: Any) -> Motion:
    code = code_of(reference_frame)
    return Motion.over(_seen(data.array(field)[joint], data, joint, placement, code))


def _classical(data: Any, joint: int, placement: Array | None, reference_frame: Any) -> Motion:
    code = code_of(reference_frame)
    v, a = (_seen(data.array(field)[joint], data, joint, placement, code) for field in ("v", "a"))
    x, y, z = v[3:].tolist()
    a[:3] += (y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0])
    return Motion.over(a)


def getVelocity(model: Any, data: Any, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Velocity of a joint's frame, of the last ``data.v``."""
    prepared(model, data)
    return _motion("v", data, joint_index(model, joint_id), None, reference_frame)


def getAcceleration(model: Any, data: Any, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Spatial acceleration of a joint's frame, of the last ``data.a``."""
    prepared(model, data)
    return _motion("a", data, joint_index(model, joint_id), None, reference_frame)


def getClassicalAcceleration(model: Any, data: Any, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Acceleration of the origin of a joint's frame, of the last ``data.v`` and ``data.a``."""
    prepared(model, data)
    return _classical(data, joint_index(model, joint_id), None, reference_frame)


def _frame(model: Any, first: Any, rest: tuple[Any, ...], named: dict[str, Any]) -> tuple[int, Array, Any]:
    """Joint, placement and reference of (frame_id[, reference]) or (joint_id, placement[, reference])."""
    here = model._placed
    if type(first) is int and here is not None and model._made is not None and 0 <= first < len(here.joints):
        if not (rest or named):
            return here.joints[first], here.placements[first], LOCAL
        if len(rest) == 1 and type(rest[0]) is ReferenceFrame:
            return here.joints[first], here.placements[first], rest[0]
    if "placement" in named:
        rest = (named["placement"], *rest)
    if rest and isinstance(rest[0], SE3):
        joint, placement, rest = joint_index(model, first), rest[0]._x, rest[1:]
    else:
        k, frames = frame_index(model, first), placed(model)
        joint, placement = int(frames.joints[k]), frames.placements[k]
    if len(rest) > 1:
        raise ArgumentError(f"{len(rest)} arguments follow the frame, expected a ReferenceFrame")
    return joint, placement, rest[0] if rest else named.get("reference_frame", LOCAL)


def _first(given: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, tuple[Any, ...]]:
    """The index and what follows it."""
    for name in ("frame_id", "joint_id"):
        if name in named:
            return named[name], given
    if not given:
        raise ArgumentError("no index is given, expected that of a frame, or of a joint with a placement")
    return given[0], given[1:]


def getFrameVelocity(model: Any, data: Any, *frame: Any, **named: Any) -> Motion:
    """Velocity of a frame, of the last ``data.v``: ``(model, data, frame_id[, reference_frame])``, or
    ``(model, data, joint_id, placement[, reference_frame])`` for one that is not in the model.
    """
    prepared(model, data)
    return _motion("v", data, *_frame(model, *_first(frame, named), named))


def getFrameAcceleration(model: Any, data: Any, *frame: Any, **named: Any) -> Motion:
    """Spatial acceleration of a frame, of the last ``data.a``; arguments as of getFrameVelocity."""
    prepared(model, data)
    return _motion("a", data, *_frame(model, *_first(frame, named), named))


def getFrameClassicalAcceleration(model: Any, data: Any, *frame: Any, **named: Any) -> Motion:
    """Acceleration of a frame's origin, of the last ``data.v`` and ``data.a``; arguments as of getFrameVelocity."""
    prepared(model, data)
    return _classical(data, *_frame(model, *_first(frame, named), named))


# --- Jacobians -------------------------------------------------------------------------------------------


@cache
def _single(name: str) -> Any:
    return jit.single(jit.variant(SPECS[name], frozenset()))


def of_frame(name: str, compiled: Made, values: tuple[Array, ...], joint: int, placement: Array, code: int) -> Array:
    """A call of the library about a frame on a joint, (6, nv)."""
    model, row = compiled.model, int(compiled.rows[joint])
    out = np.empty((6, model.nv))
    if model.mimic_matrix is None and not _single(name)(getattr(model, jit.TABLE), *values, row, placement, code, out):
        return out
    found: Array = _dynamics.general(SPECS[name], model, values, (row, placement, code), None)
    return found


def computeJointJacobians(model: Any, data: Any, q: Any = None) -> Array:
    """Jacobians of all joints in the world (6, nv), also ``data.J``; without q for the last one given."""
    if q is None:
        q = _filled(model, data, "oMi", "forwardKinematics").q.copy()
    found: Array = _joint_jacobians(model, data, q)
    return found


def _computeJointJacobians(model: Any, data: Any, q: Any) -> Array:
    return perform(model, data, "jacobians", q).result.copy()


def _filled(model: Any, data: Any, field: str, before: str) -> Run:
    """The last call that filled a field. Raises ValueRuntimeError naming the one that has to come before."""
    prepared(model, data)
    run: Run | None = data.latest(field)
    if run is None:
        raise ValueRuntimeError(f"data.{field} was not computed, expected {before} to be called before")
    return run


def _placing(model: Any, data: Any, compiled: Made, q: Array, kind: str) -> Run:
    """Note that a call places what a kind says at q: it is placed when it is read."""
    run: Run | None = data._runs.get(kind)
    if run is None or run.made is not compiled:
        run = data.run_of(kind, model, compiled)
    run.memory[:] = q
    return run


def computeJointJacobian(model: Any, data: Any, q: Any, joint_id: int) -> Array:
    """Jacobian (6, nv) of a joint at q in its own frame; it leaves ``data.liMi``."""
    compiled = prepared(model, data)
    q, k = vector("q", q, model.nq), joint_index(model, joint_id)
    found = of_frame("frame_jacobian", compiled, (q,), k, IDENTITY, IN_FRAME)
    data.ran(_placing(model, data, compiled, q, "frame_jacobian_local"))
    return found


def getJointJacobian(model: Any, data: Any, joint_id: int, reference_frame: Any) -> Array:
    """Jacobian (6, nv) of a joint, where ``data.J`` was computed last."""
    run = _filled(model, data, "J", "computeJointJacobians")
    joint, code = joint_index(model, joint_id), code_of(reference_frame)
    return of_frame("frame_jacobian", run.made, (run.q,), joint, IDENTITY, code)


def computeFrameJacobian(model: Any, data: Any, q: Any, frame_id: int, reference_frame: Any = LOCAL) -> Array:
    """Jacobian (6, nv) of a frame at q.

    It leaves ``data.liMi``; in WORLD and LOCAL_WORLD_ALIGNED ``data.oMi`` too; in the latter ``data.oMf`` as well.
    """
    compiled, frames = prepared(model, data), placed(model)
    q, k, code = vector("q", q, model.nq), frame_index(model, frame_id), code_of(reference_frame)
    found = of_frame("frame_jacobian", compiled, (q,), frames.joints[k], frames.placements[k], code)
    if code == ALIGNED:
        data.check_frames(model)
    run = _placing(model, data, compiled, q, PLACING[code])
    run.frames = frames
    data.ran(run)
    return found


def getFrameJacobian(model: Any, data: Any, *frame: Any, **named: Any) -> Array:
    """Jacobian (6, nv) of a frame, where ``data.J`` was computed last: ``(model, data, frame_id, reference_frame)`` or
    ``(model, data, joint_id, placement, reference_frame)``.
    """
    run = _filled(model, data, "J", "computeJointJacobians")
    joint, placement, reference_frame = _frame(model, *_first(frame, named), {"reference_frame": None, **named})
    return of_frame("frame_jacobian", run.made, (run.q,), joint, placement, code_of(reference_frame))


def _computeJointJacobiansTimeVariation(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Time derivatives of all joints' Jacobians in the world (6, nv), also ``data.dJ``."""
    return perform(model, data, "jacobians_dot", q, v).result.copy()


def getJointJacobianTimeVariation(model: Any, data: Any, joint_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a joint's Jacobian, where ``data.dJ`` was computed last."""
    run = _filled(model, data, "dJ", "computeJointJacobiansTimeVariation")
    joint, code = joint_index(model, joint_id), code_of(reference_frame)
    return of_frame("frame_jacobian_dot", run.made, (run.q, run.v), joint, IDENTITY, code)


def getFrameJacobianTimeVariation(model: Any, data: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian, where ``data.dJ`` was computed last."""
    run, frames = _filled(model, data, "dJ", "computeJointJacobiansTimeVariation"), placed(model)
    k, code = frame_index(model, frame_id), code_of(reference_frame)
    return of_frame("frame_jacobian_dot", run.made, (run.q, run.v), frames.joints[k], frames.placements[k], code)


def frameJacobianTimeVariation(model: Any, data: Any, q: Any, v: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian at q, v."""
    computeJointJacobiansTimeVariation(model, data, q, v)
    updateFramePlacements(model, data)
    return getFrameJacobianTimeVariation(model, data, frame_id, reference_frame)


_joint_jacobians = quick(_computeJointJacobians, "jacobians")
computeJointJacobiansTimeVariation = quick(_computeJointJacobiansTimeVariation, "jacobians_dot")
