"""Where joints and frames are and how they move."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ...native import operator_kernels, recorded_calls
from ..data.data import prepared
from ..data.dispatch import perform, quick
from ..data.frame_arguments import IDENTITY, REFERENCES, code_of, frame_given, frame_index, index_given, joint_index
from ..data.last_call import Run, clock
from ..model.library_model import joints_as_frames, placed
from ..types.frame import LOCAL
from ..types.motion import Motion
from ..types.se3 import SE3

Array = NDArray[np.float64]
_dynamics: Any = dynamics  # whose stub names the calls only

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
        operator_kernels.compose(out[model.parents[k]], X[k], out[k])
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
        call = recorded_calls.placing(False).bind(
            X, run.result, frames, **{**compiled.words, "njoints": len(X)}, **words
        )
        data._bound["frames"] = frames, run, call


def _place_frames(model: Any, data: Any) -> None:
    compiled, frames = prepared(model, data), placed(model)
    data.check_frames(model)
    run: Run = data.run_of("frames", model, compiled, frames.placements.shape)
    recorded_calls.compose_all(data.array("oMi"), frames.joints, frames.placements, run.result)
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
    operator_kernels.compose(X[frames.joints[k]], frames.placements[k], found._x)
    if compiled.whole:
        words = {"poses": X.ctypes.data, "result": shown.array.ctypes.data, **frames.words()}
        call = recorded_calls.placed_one().bind(X, shown.array, frames, **words)
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
        call = recorded_calls.placing(True).bind(
            compiled, *alive, **compiled.words, result=frames.result.ctypes.data, **words
        )
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
        function = recorded_calls.moving(kind == CLASSICAL)
        call = function.bind(*arrays.values(), frames, **sizes, **words, **REFERENCES, **frames.words())
        data._bound[kind, joints] = frames, call


def _seen(kind: str, data: Any, joint: int, placement: Array, reference_frame: Any) -> Motion:
    """A motion of a joint's body, in the joint's frame, as that of a frame on it, in a reference."""
    code, out = code_of(reference_frame), np.empty(6)
    motion = data.array(kind[-1])[joint]
    velocity = data.array("v")[joint] if kind == CLASSICAL else motion
    recorded_calls.see(data.array("oMi")[joint], placement, velocity, motion, kind == CLASSICAL, code, out)
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
    found = _seen(kind, data, *frame_given(model, *index_given(given, named), named))
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
