"""Placements, velocities and accelerations of joints and frames under Pinocchio's names."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ...native import operator_kernels, recorded_calls
from ..data.data import Data, library_of
from ..data.dispatch import compute, fast_call
from ..data.frame_arguments import (
    IDENTITY,
    REFERENCES,
    frame_argument,
    frame_index,
    index_argument,
    joint_index,
    reference_code,
)
from ..data.last_call import Run, clock
from ..model.library_model import frame_placements, joints_as_frames
from ..model.model import Model
from ..types.frame import LOCAL
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = [
    "forwardKinematics", "framesForwardKinematics", "getAcceleration", "getClassicalAcceleration",
    "getFrameAcceleration", "getFrameClassicalAcceleration", "getFrameVelocity", "getVelocity",
    "updateFramePlacement", "updateFramePlacements", "updateGlobalPlacements",
]  # fmt: skip

Array = NDArray[np.float64]
_dynamics: Any = dynamics  # Any: its stub names the public calls alone

# --- places ----------------------------------------------------------------------------------------------


def forwardKinematics(model: Model, data: Data, q: Any, v: Any = None, a: Any = None) -> None:
    """Poses of the joints ``data.oMi``; with v their velocities ``data.v``, with a their accelerations ``data.a``.

    q     (nq,)  joint positions
    v, a  (nv,)  joint velocities and accelerations

    ``updateFramePlacements`` places the frames. Raises ArgumentError, a TypeError, for a wrong type, ShapeError, a
    ValueError, for a wrong size.
    """
    if v is None:
        try:
            run = data._runs["kinematics0"]
            if run.library is model._library and run.call(q) is not None:
                if run.recompute:
                    data.note_builtin_call(run)
                else:
                    run.stamp = clock()
                return
        except (AttributeError, KeyError, ValueError):  # the fast path does not apply
            pass
        _kinematics0(model, data, q)
    elif a is None:
        _kinematics1(model, data, q, v)
    else:
        _kinematics2(model, data, q, v, a)


def _places(model: Model, data: Data, q: Any) -> None:
    compute(model, data, "kinematics0", q)


def _velocities(model: Model, data: Data, q: Any, v: Any) -> None:
    compute(model, data, "kinematics1", q, v)


def _accelerations(model: Model, data: Data, q: Any, v: Any, a: Any) -> None:
    compute(model, data, "kinematics2", q, v, a)


_kinematics0 = fast_call(_places, "kinematics0")
_kinematics1 = fast_call(_velocities, "kinematics1")
_kinematics2 = fast_call(_accelerations, "kinematics2")


def updateGlobalPlacements(model: Model, data: Data) -> None:
    """Poses of the joints ``data.oMi`` from those in their parents ``data.liMi``."""
    library, X, source = library_of(model, data), data.array("liMi"), data.latest("liMi")
    out = np.empty_like(X)
    out[0] = IDENTITY
    for k in range(1, len(X)):
        operator_kernels.compose(out[model.parents[k]], X[k], out[k])
    if source is None:
        data.put("oMi", out)
        return
    run: Run = data.run_of("global_placements", model, library, X.shape)
    run.result[...] = out
    run.store_inputs(source.q)
    data.note_call(run)


def updateFramePlacements(model: Model, data: Data) -> None:
    """Poses of all frames ``data.oMf`` from ``data.oMi``. Raises ShapeError if frames were added after the data."""
    try:
        frames, run, call = data._bound["frames"]
        if frames is model._frame_placements and run.library is model._library and call() is not None:
            data.note_builtin_call(run)
            return
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    _place_frames(model, data)
    X, run, frames, library = data.hold("oMi"), data._runs["frames"], model._frame_placements, model._library
    if library.has_builtins:
        words = {"poses": X.ctypes.data, "memory": 0, "result": run.result.ctypes.data, **frames.words()}
        call = recorded_calls.place_frames(False).bind(
            X, run.result, frames, **{**library.words, "njoints": len(X)}, **words
        )
        data._bound["frames"] = frames, run, call


def _place_frames(model: Model, data: Data) -> None:
    library, frames = library_of(model, data), frame_placements(model)
    data.check_frames(model)
    run: Run = data.run_of("frames", model, library, frames.placements.shape)
    recorded_calls.compose_all(data.array("oMi"), frames.joints, frames.placements, run.result)
    data.note_call(run)


def updateFramePlacement(model: Model, data: Data, frame_id: int) -> SE3:
    """Pose of one frame from its joint's; returns ``data.oMf[frame_id]``."""
    try:
        frames, call, shown = data._bound["frame"]
        if frames is model._frame_placements and model._library is not None and call(frame_id) is not None:
            found: SE3 = shown[frame_id]
            return found
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    library = library_of(model, data)
    k, frames = frame_index(model, frame_id), frame_placements(model)
    data.check_frames(model)
    shown, X = data.oMf, data.hold("oMi")
    found = shown[k]
    operator_kernels.compose(X[frames.joints[k]], frames.placements[k], found._x)
    if library.has_builtins:
        words = {"poses": X.ctypes.data, "result": shown.array.ctypes.data, **frames.words()}
        call = recorded_calls.place_frame().bind(X, shown.array, frames, **words)
        data._bound["frame"] = frames, call, shown
    return found


def framesForwardKinematics(model: Model, data: Data, q: Any) -> None:
    """Poses of the joints ``data.oMi`` and of all frames ``data.oMf``."""
    try:
        placements, run, frames, call = data._bound["all frames"]
        if placements is model._frame_placements and run.library is model._library and call(q) is not None:
            data.note_builtin_call(run)
            data.note_builtin_call(frames)
            return
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    _kinematics0(model, data, q)
    _place_frames(model, data)
    run, frames = data._runs["kinematics0"], data._runs["frames"]
    library, placements = run.library, model._frame_placements
    if library.has_builtins and library.joints is None:
        words = {"memory": run.memory.ctypes.data, "poses": run.result.ctypes.data, **placements.words()}
        alive = run.memory, run.result, frames.result, placements
        call = recorded_calls.place_frames(True).bind(
            library, *alive, **library.words, result=frames.result.ctypes.data, **words
        )
        data._bound["all frames"] = placements, run, frames, call


# --- velocities and accelerations ------------------------------------------------------------------------


VELOCITY, ACCELERATION, CLASSICAL = "v", "a", "classical a"
_new = Motion.__new__


def _bind_frame_motion(kind: str, model: Model, data: Data, frames: Any, joints: bool) -> None:
    """Bind a builtin to these frames, for later calls of this kind of motion."""
    library = library_of(model, data)
    if library.has_builtins:
        motions = data.hold(kind[-1])
        velocities, X = data.hold("v") if kind == CLASSICAL else motions, data.hold("oMi")
        arrays = {"poses": X, "velocities": velocities, "motions": motions}
        words = {name: array.ctypes.data for name, array in arrays.items()}
        sizes = {"six": 6, **{name: n for name, n in library.words.items() if name != "table"}}
        function = recorded_calls.frame_motion(kind == CLASSICAL)
        call = function.bind(*arrays.values(), frames, **sizes, **words, **REFERENCES, **frames.words())
        data._bound[kind, joints] = frames, call


def _frame_motion_of(kind: str, data: Data, joint: int, placement: Array, reference_frame: Any) -> Motion:
    """Motion of a joint's body as that of a frame on it, expressed in a reference frame."""
    code, out = reference_code(reference_frame), np.empty(6)
    motion = data.array(kind[-1])[joint]
    velocity = data.array("v")[joint] if kind == CLASSICAL else motion
    recorded_calls.write_frame_motion(
        data.array("oMi")[joint], placement, velocity, motion, kind == CLASSICAL, code, out
    )
    return Motion.over(out)


def _joint_motion(kind: str, model: Model, data: Data, joint_id: Any, reference_frame: Any) -> Motion:
    try:
        frames, call = data._bound[kind, True]
        if model._library.frames is frames:
            x = call(joint_id, reference_frame)
            if x is not None:
                made = _new(Motion)
                made._x = x
                return made
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    library_of(model, data)
    found = _frame_motion_of(kind, data, joint_index(model, joint_id), IDENTITY, reference_frame)
    _bind_frame_motion(kind, model, data, joints_as_frames(model), True)
    return found


def _frame_motion(kind: str, model: Model, data: Data, given: tuple[Any, ...], named: dict[str, Any]) -> Motion:
    try:
        frames, call = data._bound[kind, False]
        if model._frame_placements is frames and not named:
            x = call(*given)
            if x is not None:
                made = _new(Motion)
                made._x = x
                return made
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    library_of(model, data)
    found = _frame_motion_of(kind, data, *frame_argument(model, *index_argument(given, named), named))
    _bind_frame_motion(kind, model, data, frame_placements(model), False)
    return found


def getVelocity(model: Model, data: Data, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Velocity of a joint's frame, from ``data.v``."""
    return _joint_motion(VELOCITY, model, data, joint_id, reference_frame)


def getAcceleration(model: Model, data: Data, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Spatial acceleration of a joint's frame, from ``data.a``."""
    return _joint_motion(ACCELERATION, model, data, joint_id, reference_frame)


def getClassicalAcceleration(model: Model, data: Data, joint_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Classical acceleration of a joint's frame, from ``data.v`` and ``data.a``."""
    return _joint_motion(CLASSICAL, model, data, joint_id, reference_frame)


def getFrameVelocity(model: Model, data: Data, *frame: Any, **named: Any) -> Motion:
    """Velocity of a frame, from ``data.v``: ``(model, data, frame_id[, reference_frame])``, or
    ``(model, data, joint_id, placement[, reference_frame])`` for a frame that is not in the model.
    """
    return _frame_motion(VELOCITY, model, data, frame, named)


def getFrameAcceleration(model: Model, data: Data, *frame: Any, **named: Any) -> Motion:
    """Spatial acceleration of a frame, from ``data.a``; arguments as of getFrameVelocity."""
    return _frame_motion(ACCELERATION, model, data, frame, named)


def getFrameClassicalAcceleration(model: Model, data: Data, *frame: Any, **named: Any) -> Motion:
    """Classical acceleration of a frame, from ``data.v`` and ``data.a``; arguments as of getFrameVelocity."""
    return _frame_motion(CLASSICAL, model, data, frame, named)
