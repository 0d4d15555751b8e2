"""Jacobians of joints and frames, and their time derivatives, under Pinocchio's names."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ....engines.compiled import numba_kernels
from ....engines.compiled.cpython import unavailable
from ....recursions import SPECS
from ....recursions.spec import LOCAL as IN_FRAME
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ...native import recorded_calls
from ..data.data import Data, library_of
from ..data.dispatch import compute, fast_call, vector
from ..data.frame_arguments import (
    CODES,
    IDENTITY,
    REFERENCES,
    frame_argument,
    frame_index,
    index_argument,
    joint_index,
    reference_code,
)
from ..data.last_call import Run
from ..model.library_model import FramePlacements, LibraryModel, frame_placements, joints_as_frames
from ..model.model import Model
from ..types.arguments import ValueRuntimeError
from ..types.frame import LOCAL
from .kinematics import updateFramePlacements

__all__ = [
    "computeFrameJacobian", "computeJointJacobian", "computeJointJacobians", "computeJointJacobiansTimeVariation",
    "frameJacobianTimeVariation", "getFrameJacobian", "getFrameJacobianTimeVariation", "getJointJacobian",
    "getJointJacobianTimeVariation",
]  # fmt: skip

Array = NDArray[np.float64]
KIND_BY_CODE = {
    IN_FRAME: "frame_jacobian_local",
    IN_WORLD: "frame_jacobian_world",
    ALIGNED: "frame_jacobian_aligned",
}
KIND_BY_REFERENCE = {id(reference): (KIND_BY_CODE[code], code) for reference, code in CODES.items()}
_dynamics: Any = dynamics  # Any: its stub names the public calls alone


@cache
def _single(name: str) -> Any:
    return numba_kernels.sample_kernel(numba_kernels.variant(SPECS[name], frozenset()))


def call_about_frame(
    name: str, library: LibraryModel, values: tuple[Array, ...], joint: int, placement: Array, code: int
) -> Array:
    """A call of the library about a frame on a joint, (6, nv): by its table kernel, or in full with mimic joints."""
    model, row = library.model, int(library.rows[joint])
    out = np.empty((6, model.nv))
    if model.mimic_matrix is None and not _single(name)(
        getattr(model, numba_kernels.TABLE), *values, row, placement, code, out
    ):
        return out
    found: Array = _dynamics.checked_call(SPECS[name], model, values, (row, placement, code), None, by_table=True)
    return found


def computeJointJacobians(model: Model, data: Data, q: Any = None) -> Array:
    """Jacobians of all joints in the world (6, nv), also ``data.J``; without q at the last call's."""
    if q is None:
        q = _last_filled(model, data, "oMi", "forwardKinematics").q.copy()
    found: Array = _joint_jacobians(model, data, q)
    return found


def _computeJointJacobians(model: Model, data: Data, q: Any) -> Array:
    return compute(model, data, "jacobians", q).result.copy()


def _last_filled(model: Model, data: Data, field: str, before: str) -> Run:
    """The last call that filled a field. Raises ValueRuntimeError naming the call that has to come before."""
    library_of(model, data)
    run: Run | None = data.latest(field)
    if run is None:
        raise ValueRuntimeError(f"data.{field} was not computed, expected {before} to be called before")
    return run


def _note_placements(model: Model, data: Data, library: LibraryModel, q: Array, kind: str) -> Run:
    """The Run of a kind, with q recorded: the fields that it fills are computed at their first read."""
    run: Run | None = data._runs.get(kind)
    if run is None or run.library is not library:
        run = data.run_of(kind, model, library)
    run.memory[:] = q
    return run


def _bound_jacobian(
    name: str, run: Run, frames: FramePlacements, what: str, index: Any, reference_frame: Any
) -> Array | None:
    """A Jacobian at the inputs of a run by a builtin; returns None if not applicable."""
    found = run.bound.get((name, what))
    if found is None or found[0] is not frames:
        library, call = run.library, unavailable
        if library.has_builtins:
            inputs = {"q_address": run.q} if name == "frame_jacobian" else {"q_address": run.q, "v_address": run.v}
            words = {x: array.ctypes.data for x, array in inputs.items()}
            words |= {"six": 6, **library.words, **REFERENCES, **frames.words(rows=True)}
            call = recorded_calls.frame_jacobian(name).bind(library, run, frames, **words)
        found = run.bound[name, what] = frames, call
    made: Array | None = found[1](index, reference_frame)
    return made


def _bound_jacobian_at(
    model: Model, data: Data, kind: str, what: str, q: Any, index: Any, code: int, frames: FramePlacements
) -> Array | None:
    """A Jacobian at q by a builtin that records q in the Run of a kind; returns None if not applicable."""
    run = data._runs[kind]
    if run.library is not model._library:
        return None
    found = run.bound.get(what)
    if found is None or found[0] is not frames:
        library, call = run.library, unavailable
        if library.has_builtins:
            words = {"six": 6, "memory": run.memory.ctypes.data, "code": code, **library.words}
            call = recorded_calls.frame_jacobian_at().bind(library, run, frames, **words, **frames.words(rows=True))
        found = run.bound[what] = frames, call
    J: Array | None = found[1](q, index)
    if J is not None:
        run.frames = frames
        data.note_builtin_call(run)
    return J


def computeJointJacobian(model: Model, data: Data, q: Any, joint_id: int) -> Array:
    """Jacobian (6, nv) of a joint at q in its own frame; it fills ``data.liMi``."""
    try:
        frames = model._library.frames
        J = _bound_jacobian_at(model, data, KIND_BY_CODE[IN_FRAME], "joint", q, joint_id, IN_FRAME, frames)
        if J is not None:
            return J
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    library = library_of(model, data)
    q, k = vector("q", q, model.nq), joint_index(model, joint_id)
    frames = joints_as_frames(model)
    found = call_about_frame("frame_jacobian", library, (q,), k, frames.placements[k], IN_FRAME)
    data.note_call(_note_placements(model, data, library, q, KIND_BY_CODE[IN_FRAME]))
    return found


def getJointJacobian(model: Model, data: Data, joint_id: int, reference_frame: Any) -> Array:
    """Jacobian (6, nv) of a joint, at the q of ``data.J``."""
    try:
        run: Any = data.latest("J")  # None raises AttributeError
        frames, call = run.bound["frame_jacobian", "joint"]
        if frames is model._library.frames:
            J: Array | None = call(joint_id, reference_frame)
            if J is not None:
                return J
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    run = _last_filled(model, data, "J", "computeJointJacobians")
    J = _bound_jacobian("frame_jacobian", run, joints_as_frames(model), "joint", joint_id, reference_frame)
    if J is not None:
        return J
    joint, code = joint_index(model, joint_id), reference_code(reference_frame)
    return call_about_frame("frame_jacobian", run.library, (run.q,), joint, IDENTITY, code)


def computeFrameJacobian(model: Model, data: Data, q: Any, frame_id: int, reference_frame: Any = LOCAL) -> Array:
    """Jacobian (6, nv) of a frame at q.

    It fills ``data.liMi``, in WORLD also ``data.oMi``, in LOCAL_WORLD_ALIGNED also ``data.oMi`` and ``data.oMf``.
    """
    try:
        kind, code = KIND_BY_REFERENCE[id(reference_frame)]
        J = _bound_jacobian_at(model, data, kind, "frame", q, frame_id, code, model._frame_placements)
        if J is not None:
            return J
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    library, frames = library_of(model, data), frame_placements(model)
    q, k, code = vector("q", q, model.nq), frame_index(model, frame_id), reference_code(reference_frame)
    found = call_about_frame("frame_jacobian", library, (q,), frames.joints[k], frames.placements[k], code)
    if code == ALIGNED:
        data.check_frames(model)
    run = _note_placements(model, data, library, q, KIND_BY_CODE[code])
    run.frames = frames
    data.note_call(run)
    return found


def getFrameJacobian(model: Model, data: Data, *frame: Any, **named: Any) -> Array:
    """Jacobian (6, nv) of a frame, at the q of ``data.J``: ``(model, data, frame_id, reference_frame)`` or
    ``(model, data, joint_id, placement, reference_frame)``.
    """
    try:
        run: Any = data.latest("J")  # None raises AttributeError
        frames, call = run.bound["frame_jacobian", "frame"]
        if frames is model._frame_placements and model._library is not None and not named:
            J: Array | None = call(*frame)
            if J is not None:
                return J
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    run = _last_filled(model, data, "J", "computeJointJacobians")
    if len(frame) == 2 and not named:
        J = _bound_jacobian("frame_jacobian", run, frame_placements(model), "frame", *frame)
        if J is not None:
            return J
    joint, placement, reference_frame = frame_argument(
        model, *index_argument(frame, named), {"reference_frame": None, **named}
    )
    return call_about_frame("frame_jacobian", run.library, (run.q,), joint, placement, reference_code(reference_frame))


def _computeJointJacobiansTimeVariation(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Time derivatives of all joints' Jacobians in the world (6, nv), also ``data.dJ``."""
    return compute(model, data, "jacobians_dot", q, v).result.copy()


def getJointJacobianTimeVariation(model: Model, data: Data, joint_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a joint's Jacobian, at the q, v of ``data.dJ``."""
    run = _last_filled(model, data, "dJ", "computeJointJacobiansTimeVariation")
    dJ = _bound_jacobian("frame_jacobian_dot", run, joints_as_frames(model), "joint", joint_id, reference_frame)
    if dJ is not None:
        return dJ
    joint, code = joint_index(model, joint_id), reference_code(reference_frame)
    return call_about_frame("frame_jacobian_dot", run.library, (run.q, run.v), joint, IDENTITY, code)


def getFrameJacobianTimeVariation(model: Model, data: Data, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian, at the q, v of ``data.dJ``."""
    run, frames = _last_filled(model, data, "dJ", "computeJointJacobiansTimeVariation"), frame_placements(model)
    dJ = _bound_jacobian("frame_jacobian_dot", run, frames, "frame", frame_id, reference_frame)
    if dJ is not None:
        return dJ
    k, code = frame_index(model, frame_id), reference_code(reference_frame)
    return call_about_frame(
        "frame_jacobian_dot", run.library, (run.q, run.v), frames.joints[k], frames.placements[k], code
    )


def frameJacobianTimeVariation(model: Model, data: Data, q: Any, v: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian at q, v."""
    computeJointJacobiansTimeVariation(model, data, q, v)
    updateFramePlacements(model, data)
    return getFrameJacobianTimeVariation(model, data, frame_id, reference_frame)


_joint_jacobians = fast_call(_computeJointJacobians, "jacobians")
computeJointJacobiansTimeVariation = fast_call(_computeJointJacobiansTimeVariation, "jacobians_dot")
