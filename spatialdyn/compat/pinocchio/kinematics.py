"""Where joints and frames are and how they move, and their Jacobians."""

from __future__ import annotations

import operator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import algebra, dynamics, kept
from ...engines import jit
from ...engines.builtin import refused
from ...recursions import SPECS
from ...recursions.spec import LOCAL as IN_FRAME
from ...recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ...recursions.spec import WORLD as IN_WORLD
from .arguments import ArgumentError, RangeError, ValueRuntimeError, described
from .calls import perform, quick, vector
from .compiled import Made, Placed, joints_as_frames, placed
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
REFERENCES = {"in_frame": id(LOCAL), "in_world": id(WORLD), "aligned": id(LOCAL_WORLD_ALIGNED)}
PLACED_IN = {id(reference): (PLACING[code], code) for reference, code in CODES.items()}
IDENTITY = np.eye(4)
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
        try:
            run = data._runs["kinematics0"]
            if run.made is model._made and run.call(q) is not None:
                if run.again:
                    data.redo(run)
                else:
                    run.stamp = clock()
                return
        except (AttributeError, KeyError, ValueError):  # whatever is not as simple as that
            pass
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


_kinematics0 = quick(_places, "kinematics0")
_kinematics1 = quick(_velocities, "kinematics1")
_kinematics2 = quick(_accelerations, "kinematics2")


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
    try:
        frames, run, call = data._bound["frames"]
        if frames is model._placed and run.made is model._made and call() is not None:
            data.redo(run)
            return
    except (AttributeError, KeyError, ValueError):  # whatever is not as simple as that
        pass
    _place_frames(model, data)
    X, run, frames, compiled = data.live("oMi"), data._runs["frames"], model._placed, model._made
    if compiled.whole:
        words = {"poses": X.ctypes.data, "memory": 0, "result": run.result.ctypes.data, **frames.words()}
        call = kept.placing(False).bind(X, run.result, frames, **{**compiled.words, "njoints": len(X)}, **words)
        data._bound["frames"] = frames, run, call


def _place_frames(model: Any, data: Any) -> None:
    compiled, frames = prepared(model, data), placed(model)
    data.check_frames(model)
    run: Run = data.run_of("frames", model, compiled, frames.placements.shape)
    kept.compose_all(data.array("oMi"), frames.joints, frames.placements, run.result)
    data.ran(run)


def updateFramePlacement(model: Any, data: Any, frame_id: int) -> SE3:
    """Place one frame by its joint's place; returns ``data.oMf[frame_id]``."""
    try:
        frames, call, shown = data._bound["frame"]
        if frames is model._placed and model._made is not None and call(frame_id) is not None:
            found: SE3 = shown[frame_id]
            return found
    except (AttributeError, KeyError):  # whatever is not as simple as that
        pass
    compiled = prepared(model, data)
    k, frames = frame_index(model, frame_id), placed(model)
    data.check_frames(model)
    shown, X = data.oMf, data.live("oMi")
    found = shown[k]
    algebra.compose(X[frames.joints[k]], frames.placements[k], found._x)
    if compiled.whole:
        words = {"poses": X.ctypes.data, "result": shown.array.ctypes.data, **frames.words()}
        call = kept.placed_one().bind(X, shown.array, frames, **words)
        data._bound["frame"] = frames, call, shown
    return found


def framesForwardKinematics(model: Any, data: Any, q: Any) -> None:
    """Place the joints and all frames: ``data.oMi`` and ``data.oMf``."""
    try:
        placed_, run, frames, call = data._bound["all frames"]
        if placed_ is model._placed and run.made is model._made and call(q) is not None:
            data.redo(run)
            data.redo(frames)
            return
    except (AttributeError, KeyError, ValueError):  # whatever is not as simple as that
        pass
    _kinematics0(model, data, q)
    _place_frames(model, data)
    run, frames = data._runs["kinematics0"], data._runs["frames"]
    compiled, placed_ = run.made, model._placed
    if compiled.whole and compiled.joints is None:
        words = {"memory": run.memory.ctypes.data, "poses": run.result.ctypes.data, **placed_.words()}
        alive = run.memory, run.result, frames.result, placed_
        call = kept.placing(True).bind(compiled, *alive, **compiled.words, result=frames.result.ctypes.data, **words)
        data._bound["all frames"] = placed_, run, frames, call


# --- velocities and accelerations ------------------------------------------------------------------------


VELOCITY, ACCELERATION, CLASSICAL = "v", "a", "classical a"
_new = Motion.__new__


def _moving(kind: str, model: Any, data: Any, frames: Any, joints: bool) -> None:
    """Bind a builtin for the next call that asks for this kind of motion of these frames."""
    compiled = prepared(model, data)
    if compiled.whole:
        motions = data.live(kind[-1])
        velocities, X = data.live("v") if kind == CLASSICAL else motions, data.live("oMi")
        arrays = {"poses": X, "velocities": velocities, "motions": motions}
        words = {name: array.ctypes.data for name, array in arrays.items()}
        sizes = {"six": 6, **{name: n for name, n in compiled.words.items() if name != "table"}}
        function = kept.moving(kind == CLASSICAL)
        call = function.bind(*arrays.values(), frames, **sizes, **words, **REFERENCES, **frames.words())
        data._bound[kind, joints] = frames, call


def _seen(kind: str, data: Any, joint: int, placement: Array, reference_frame: Any) -> Motion:
    """A motion of a joint's body, in the joint's frame, as that of a frame on it, in a reference."""
    code, out = code_of(reference_frame), np.empty(6)
    motion = data.array(kind[-1])[joint]
    velocity = data.array("v")[joint] if kind == CLASSICAL else motion
    kept.see(data.array("oMi")[joint], placement, velocity, motion, kind == CLASSICAL, code, out)
    return Motion.over(out)


def _of_joint(kind: str, model: Any, data: Any, joint_id: Any, reference_frame: Any) -> Motion:
    try:
        frames, call = data._bound[kind, True]
        if model._made.frames is frames:
            x = call(joint_id, reference_frame)
            if x is not None:
                made = _new(Motion)
                made._x = x
                return made
    except (AttributeError, KeyError):  # whatever is not as simple as that
        pass
    prepared(model, data)
    found = _seen(kind, data, joint_index(model, joint_id), IDENTITY, reference_frame)
    _moving(kind, model, data, joints_as_frames(model), True)
    return found


def _of_frame(kind: str, model: Any, data: Any, given: tuple[Any, ...], named: dict[str, Any]) -> Motion:
    try:
        frames, call = data._bound[kind, False]
        if model._placed is frames and not named:
            x = call(*given)
            if x is not None:
                made = _new(Motion)
                made._x = x
                return made
    except (AttributeError, KeyError):  # whatever is not as simple as that
        pass
    prepared(model, data)
    found = _seen(kind, data, *_frame(model, *_first(given, named), named))
    _moving(kind, model, data, placed(model), False)
    return found


def getVelocity(model: Any, data: Any, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Velocity of a joint's frame, of the last ``data.v``."""
    return _of_joint(VELOCITY, model, data, joint_id, reference_frame)


def getAcceleration(model: Any, data: Any, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Spatial acceleration of a joint's frame, of the last ``data.a``."""
    return _of_joint(ACCELERATION, model, data, joint_id, reference_frame)


def getClassicalAcceleration(model: Any, data: Any, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Acceleration of the origin of a joint's frame, of the last ``data.v`` and ``data.a``."""
    return _of_joint(CLASSICAL, model, data, joint_id, reference_frame)


def _frame(model: Any, first: Any, rest: tuple[Any, ...], named: dict[str, Any]) -> tuple[int, Array, Any]:
    """Joint, placement and reference of (frame_id[, reference]) or (joint_id, placement[, reference])."""
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
    return _of_frame(VELOCITY, model, data, frame, named)


def getFrameAcceleration(model: Any, data: Any, *frame: Any, **named: Any) -> Motion:
    """Spatial acceleration of a frame, of the last ``data.a``; arguments as of getFrameVelocity."""
    return _of_frame(ACCELERATION, model, data, frame, named)


def getFrameClassicalAcceleration(model: Any, data: Any, *frame: Any, **named: Any) -> Motion:
    """Acceleration of a frame's origin, of the last ``data.v`` and ``data.a``; arguments as of getFrameVelocity."""
    return _of_frame(CLASSICAL, model, data, frame, named)


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


def _jacobian(name: str, run: Run, frames: Placed, what: str, index: Any, reference_frame: Any) -> Array | None:
    """A Jacobian at the inputs of a run by a builtin; None if there is none for these arguments."""
    found = run.bound.get((name, what))
    if found is None or found[0] is not frames:
        compiled, call = run.made, refused
        if compiled.whole:
            inputs = {"q_there": run.q} if name == "frame_jacobian" else {"q_there": run.q, "v_there": run.v}
            words = {x: array.ctypes.data for x, array in inputs.items()}
            words |= {"six": 6, **compiled.words, **REFERENCES, **frames.words(rows=True)}
            call = kept.jacobian(name).bind(compiled, run, frames, **words)
        found = run.bound[name, what] = frames, call
    made: Array | None = found[1](index, reference_frame)
    return made


def _jacobian_at(
    model: Any, data: Any, kind: str, what: str, q: Any, index: Any, code: int, frames: Placed
) -> Array | None:
    """The same at a q that is noted in the run of a kind."""
    run = data._runs[kind]
    if run.made is not model._made:
        return None
    found = run.bound.get(what)
    if found is None or found[0] is not frames:
        compiled, call = run.made, refused
        if compiled.whole:
            words = {"six": 6, "memory": run.memory.ctypes.data, "code": code, **compiled.words}
            call = kept.jacobian_at().bind(compiled, run, frames, **words, **frames.words(rows=True))
        found = run.bound[what] = frames, call
    J: Array | None = found[1](q, index)
    if J is not None:
        run.frames = frames
        data.redo(run)
    return J


def computeJointJacobian(model: Any, data: Any, q: Any, joint_id: int) -> Array:
    """Jacobian (6, nv) of a joint at q in its own frame; it leaves ``data.liMi``."""
    try:
        frames = model._made.frames
        J = _jacobian_at(model, data, PLACING[IN_FRAME], "joint", q, joint_id, IN_FRAME, frames)
        if J is not None:
            return J
    except (AttributeError, KeyError, ValueError):  # whatever is not as simple as that
        pass
    compiled = prepared(model, data)
    q, k = vector("q", q, model.nq), joint_index(model, joint_id)
    frames = joints_as_frames(model)
    found = of_frame("frame_jacobian", compiled, (q,), k, frames.placements[k], IN_FRAME)
    data.ran(_placing(model, data, compiled, q, PLACING[IN_FRAME]))
    return found


def getJointJacobian(model: Any, data: Any, joint_id: int, reference_frame: Any) -> Array:
    """Jacobian (6, nv) of a joint, where ``data.J`` was computed last."""
    try:
        run = data.latest("J")
        frames, call = run.bound["frame_jacobian", "joint"]
        if frames is model._made.frames:
            J: Array | None = call(joint_id, reference_frame)
            if J is not None:
                return J
    except (AttributeError, KeyError):  # whatever is not as simple as that
        pass
    run = _filled(model, data, "J", "computeJointJacobians")
    J = _jacobian("frame_jacobian", run, joints_as_frames(model), "joint", joint_id, reference_frame)
    if J is not None:
        return J
    joint, code = joint_index(model, joint_id), code_of(reference_frame)
    return of_frame("frame_jacobian", run.made, (run.q,), joint, IDENTITY, code)


def computeFrameJacobian(model: Any, data: Any, q: Any, frame_id: int, reference_frame: Any = LOCAL) -> Array:
    """Jacobian (6, nv) of a frame at q.

    It leaves ``data.liMi``; in WORLD and LOCAL_WORLD_ALIGNED ``data.oMi`` too; in the latter ``data.oMf`` as well.
    """
    try:
        kind, code = PLACED_IN[id(reference_frame)]
        J = _jacobian_at(model, data, kind, "frame", q, frame_id, code, model._placed)
        if J is not None:
            return J
    except (AttributeError, KeyError, ValueError):  # whatever is not as simple as that
        pass
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
    try:
        run = data.latest("J")
        frames, call = run.bound["frame_jacobian", "frame"]
        if frames is model._placed and model._made is not None and not named:
            J: Array | None = call(*frame)
            if J is not None:
                return J
    except (AttributeError, KeyError):  # whatever is not as simple as that
        pass
    run = _filled(model, data, "J", "computeJointJacobians")
    if len(frame) == 2 and not named:
        J = _jacobian("frame_jacobian", run, placed(model), "frame", *frame)
        if J is not None:
            return J
    joint, placement, reference_frame = _frame(model, *_first(frame, named), {"reference_frame": None, **named})
    return of_frame("frame_jacobian", run.made, (run.q,), joint, placement, code_of(reference_frame))


def _computeJointJacobiansTimeVariation(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Time derivatives of all joints' Jacobians in the world (6, nv), also ``data.dJ``."""
    return perform(model, data, "jacobians_dot", q, v).result.copy()


def getJointJacobianTimeVariation(model: Any, data: Any, joint_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a joint's Jacobian, where ``data.dJ`` was computed last."""
    run = _filled(model, data, "dJ", "computeJointJacobiansTimeVariation")
    dJ = _jacobian("frame_jacobian_dot", run, joints_as_frames(model), "joint", joint_id, reference_frame)
    if dJ is not None:
        return dJ
    joint, code = joint_index(model, joint_id), code_of(reference_frame)
    return of_frame("frame_jacobian_dot", run.made, (run.q, run.v), joint, IDENTITY, code)


def getFrameJacobianTimeVariation(model: Any, data: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian, where ``data.dJ`` was computed last."""
    run, frames = _filled(model, data, "dJ", "computeJointJacobiansTimeVariation"), placed(model)
    dJ = _jacobian("frame_jacobian_dot", run, frames, "frame", frame_id, reference_frame)
    if dJ is not None:
        return dJ
    k, code = frame_index(model, frame_id), code_of(reference_frame)
    return of_frame("frame_jacobian_dot", run.made, (run.q, run.v), frames.joints[k], frames.placements[k], code)


def frameJacobianTimeVariation(model: Any, data: Any, q: Any, v: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian at q, v."""
    computeJointJacobiansTimeVariation(model, data, q, v)
    updateFramePlacements(model, data)
    return getFrameJacobianTimeVariation(model, data, frame_id, reference_frame)


_joint_jacobians = quick(_computeJointJacobians, "jacobians")
computeJointJacobiansTimeVariation = quick(_computeJointJacobiansTimeVariation, "jacobians_dot")
