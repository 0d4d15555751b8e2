"""Jacobians of joints and frames, and their rates."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ....engines.compiled import numba_kernels
from ....engines.compiled.cpython import refused
from ....recursions import SPECS
from ....recursions.spec import LOCAL as IN_FRAME
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ...native import recorded_calls
from ..data.data import prepared
from ..data.dispatch import perform, quick, vector
from ..data.frame_arguments import (
    CODES,
    IDENTITY,
    REFERENCES,
    code_of,
    frame_given,
    frame_index,
    index_given,
    joint_index,
)
from ..data.last_call import Run
from ..model.library_model import Made, Placed, joints_as_frames, placed
from ..types.arguments import ValueRuntimeError
from ..types.frame import LOCAL
from .kinematics import updateFramePlacements

Array = NDArray[np.float64]
PLACING = {
    IN_FRAME: "frame_jacobian_local",
    IN_WORLD: "frame_jacobian_world",
    ALIGNED: "frame_jacobian_aligned",
}
PLACED_IN = {id(reference): (PLACING[code], code) for reference, code in CODES.items()}
_dynamics: Any = dynamics  # whose stub names the calls only


@cache
def _single(name: str) -> Any:
    return numba_kernels.single(numba_kernels.variant(SPECS[name], frozenset()))


def of_frame(name: str, compiled: Made, values: tuple[Array, ...], joint: int, placement: Array, code: int) -> Array:
    """A call of the library about a frame on a joint, (6, nv)."""
    model, row = compiled.model, int(compiled.rows[joint])
    out = np.empty((6, model.nv))
    if model.mimic_matrix is None and not _single(name)(
        getattr(model, numba_kernels.TABLE), *values, row, placement, code, out
    ):
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
            call = recorded_calls.jacobian(name).bind(compiled, run, frames, **words)
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
            call = recorded_calls.jacobian_at().bind(compiled, run, frames, **words, **frames.words(rows=True))
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
    joint, placement, reference_frame = frame_given(
        model, *index_given(frame, named), {"reference_frame": None, **named}
    )
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
