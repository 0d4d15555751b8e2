"""Placements, velocities and accelerations of joints and frames under Pinocchio's names."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...native import operator_kernels, recorded_kinematics
from ..data.data import Data, library_of
from ..data.dispatch import IDENTITY, about_frame, bind_about, compute, frame_index, reference_code
from ..data.face import Face
from ..data.run import Run
from ..model.library_model import frame_placements
from ..model.model import Model
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = ["framesForwardKinematics", "updateFramePlacement", "updateFramePlacements", "updateGlobalPlacements"]


def updateGlobalPlacements(model: Model, data: Data) -> None:
    """Poses of the joints ``data.oMi`` from those in their parents ``data.liMi``."""
    library, X, source = library_of(model, data), data.array("liMi"), data.latest("liMi", of_call=True)
    out = np.empty_like(X)
    out[0] = IDENTITY
    for k in range(1, len(X)):
        operator_kernels.compose(out[model.parents[k]], X[k], out[k])
    if source is None:
        data.put("oMi", out)
        return
    run: Run = data.run_of("global_placements", library, X.shape)
    run.result[...] = out
    run.store_inputs(source.q)
    data.note_call(run)


def updateFramePlacements(model: Model, data: Data) -> None:
    """Poses of all frames ``data.oMf`` from ``data.oMi``. Raises ShapeError if frames were added after the data."""
    try:
        frames, run, call = data._bound["frames"]
        if frames is model._frame_placements and run.library is model._library and call() is not None:
            if run.recompute is not None:
                data.note_builtin_call(run)
            return
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    _place_frames(model, data)
    X, run, frames, library = data.hold("oMi"), data._runs["frames"], model._frame_placements, model._library
    if library.has_builtins:
        words = {"poses": X, "result": run.result, **library.words, **run.stamp_words, **frames.words()}
        words["njoints"] = len(X)
        data._bound["frames"] = frames, run, recorded_kinematics.place_frames.bind(words, run, frames)


def _place_frames(model: Model, data: Data) -> None:
    library, frames = library_of(model, data), frame_placements(model)
    data.check_frames(model)
    run: Run = data.run_of("frames", library, (len(frames.joints), 4, 4))
    operator_kernels.compose_all(data.array("oMi"), frames.joints, frames.placements, run.result)
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
    operator_kernels.compose(X[frames.joints[k]], frames.places[k], found._x)
    if library.has_builtins:
        words = {"poses": X, "result": shown.array, **frames.words()}
        data._bound["frame"] = frames, recorded_kinematics.place_frame.bind(words, frames), shown
    return found


def framesForwardKinematics(model: Model, data: Data, q: Any) -> None:
    """Poses of the joints ``data.oMi`` and of all frames ``data.oMf``."""
    try:
        placements, run, frames, call = data._bound["all frames"]
        if (
            placements is model._frame_placements
            and run.library is model._library
            and (call(q) or (run.library.follow() and call(q)))  # numbers were edited
        ):
            if run.recompute is not None or frames.recompute is not None:
                data.note_builtin_call(run)
                data.note_builtin_call(frames)
            return
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    compute(model, data, "kinematics0", (q,))
    _place_frames(model, data)
    run, frames = data._runs["kinematics0"], data._runs["frames"]
    library, placements = run.library, model._frame_placements
    if library.has_builtins and library.joints is None:
        words: dict[str, Any] = {"poses": run.result, "result": frames.result}
        words |= {**library.words, **frames.stamp_words, **placements.words()}
        held = library, run, frames, placements
        call = recorded_kinematics.place_joints_and_frames.bind(words, *held, record=run.recording(1))
        data._bound["all frames"] = placements, run, frames, call


# --- velocities and accelerations ------------------------------------------------------------------------


def motion_of_frame(face: Face, model: Model, data: Data, *about: Any) -> Motion:
    """The motion of a frame, or of a joint's own frame, from the field of Data that has one for each joint."""
    library, field = library_of(model, data), face.call[0]
    joint, place, reference = about_frame(model, face.of_joints, *about)
    code, out, classical = reference_code(reference), np.empty(6), "Classical" in face.name
    X, motions = data.array("oMi")[joint], data.array(field)
    velocities = data.array("v") if classical else motions
    recorded_kinematics.write_frame_motion(X, place, velocities[joint], motions[joint], classical, code, out)
    if library.has_builtins:
        motions = data.hold(field)  # all fields before one is bound: holding one drops what is bound
        words: dict[str, Any] = {"poses": data.hold("oMi"), "motions": motions, "made": id(Motion)}
        words |= {"velocities": data.hold("v") if classical else motions, "classical": classical}
        data._bound.update(bind_about(face.name, recorded_kinematics.frame_motion, words, model, about, False))
    return Motion.over(out)
