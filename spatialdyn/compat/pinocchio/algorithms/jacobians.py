"""Jacobians of joints and frames, and their time derivatives, under Pinocchio's names."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ....calls import dynamics
from ....engines.compiled import numba_kernels
from ....engines.compiled.tiers import table_kernel
from ....engines.programs.run.single_call import unavailable
from ....recursions import SPECS
from ...native import recorded_kinematics
from ...native.recorded_kinematics import OnFrames
from ..data.data import Data, library_of
from ..data.dispatch import (
    ALIGNED,
    IN_FRAME,
    IN_WORLD,
    about_frame,
    bind_about,
    compute,
    last_call,
    reference_code,
    vector,
)
from ..data.face import REFUSED, Face
from ..data.run import Run
from ..model.library_model import LibraryModel, frame_placements, joints_as_frames
from ..model.model import Model
from ..types.arguments import Array
from ..types.frame import LOCAL
from .kinematics import updateFramePlacements

__all__ = ["computeFrameJacobian", "computeJointJacobian", "frameJacobianTimeVariation"]

KIND_BY_CODE = {IN_FRAME: "frame_jacobian_local", IN_WORLD: "frame_jacobian_world", ALIGNED: "frame_jacobian_world"}
_dynamics: Any = dynamics  # Any: its stub names the public calls alone


@cache
def _kernel(name: str, nv: int) -> Any:
    """The table kernel of a call about a frame, the names of its inputs, and the shape of its output."""
    spec = SPECS[name]
    inputs, shape = [x.name for x in spec.present if not x.static], [nv if n == "nv" else n for n in spec.output.shape]
    return table_kernel(numba_kernels.variant(spec, frozenset())), inputs, shape


class Inputs(NamedTuple):
    """Inputs of calls about a frame, and the state of a library at which they are computed, as a Run has them."""

    library: LibraryModel
    state: bytes
    q: Array
    v: Any = None
    a: Any = None


def call_about_frame(name: str, run: Run | Inputs, joint: int, placement: Array, *static: int) -> Array:
    """A call of the library about a frame on a joint, at the inputs of a run: by its table kernel, or with checks."""
    library = run.library
    model, row = library._model, int(library.rows[joint])  # of that model, the sizes alone
    kernel, inputs, shape = _kernel(name, model.nv)
    values = [getattr(run, x) for x in inputs]
    if model.mimic_matrix is None:
        out = np.empty(shape)
        if not kernel(library.table_at(run.state), *values, row, placement, *static, out):
            return out
    found: Array = _dynamics.checked_call(
        SPECS[name], library.model_at(run.state), values, (row, placement, *static), None, by_table=True
    )
    return found


# --- at a configuration ----------------------------------------------------------------------------------


def computeJointJacobian(model: Model, data: Data, q: Any, joint_id: int) -> Array:
    """Jacobian (6, nv) of a joint at q in its own frame; it fills ``data.liMi``."""
    try:
        run, _, call = data._bound["joint"]
        if run.library is model._library and (found := call(q, joint_id)) is not None:
            if run.recompute is not None:
                data.recompute_held(run)
            return found  # type: ignore[no-any-return]
    except REFUSED:
        pass
    return _at(model, data, q, joint_id, LOCAL, "joint")


def computeFrameJacobian(model: Model, data: Data, q: Any, frame_id: int, reference_frame: Any = LOCAL) -> Array:
    """Jacobian (6, nv) of a frame at q.

    It fills ``data.liMi``, in WORLD also ``data.oMi``, in LOCAL_WORLD_ALIGNED also ``data.oMi`` and ``data.oMf``.
    """
    try:
        run, frames, call = data._bound[id(reference_frame)]
        fits = run.library is model._library and frames is model._frame_placements
        if fits and (found := call(q, frame_id)) is not None:
            if run.recompute is not None:
                data.recompute_held(run)
            return found  # type: ignore[no-any-return]
    except REFUSED:
        pass
    return _at(model, data, q, frame_id, reference_frame, id(reference_frame))


def _at(model: Model, data: Data, q: Any, index: Any, reference: Any, key: Any) -> Array:
    """The Jacobian of a frame at a q, which is recorded for the fields that it fills; binds the builtin of ``key``."""
    library, of_joints = library_of(model, data), key == "joint"
    frames = joints_as_frames(model) if of_joints else frame_placements(model)
    run, bound, call = data._bound.get(key, (None, None, unavailable))
    fits = run is not None and run.library is library and bound is frames
    if fits and (found := call(q, index)) is not None:  # numbers were edited
        data.recompute_held(run)
        return found  # type: ignore[no-any-return]
    q, code = vector("q", q, model.nq), reference_code(reference)
    joint, placement, _ = about_frame(model, of_joints, index, reference)
    if code == ALIGNED:
        data.check_frames(model)
        data.hold("oMf")  # the frame is placed at the call, for its placement may be edited after it
    run = data.run_of(KIND_BY_CODE[code], library)
    run.store_inputs(q)
    call = unavailable
    found = call_about_frame("frame_jacobian", Inputs(library, library.state, q), joint, placement, code)
    data.note_call(run)
    written = {"oMf": data._held["oMf"]} if code == ALIGNED else {}
    for array in written.values():
        array[index] = data.array("oMi")[joint] @ placement
    if library.has_builtins:
        fields = {x: data._held.get(x) for x in recorded_kinematics.FIELDS if x in run.kind.fills}
        held = {x: array for x, array in fields.items() if array is not None and library.joints is None} | written
        words: dict[str, Any] = {x: held.get(x) for x in recorded_kinematics.FIELDS}
        words |= {"code": code, **library.words, **frames.words(rows=True)}
        call = recorded_kinematics.frame_jacobian_at.bind(words, library, run, frames, record=run.recording(1))
    data._bound[key] = run, frames, call
    return found


# --- at the inputs of the last call ------------------------------------------------------------------------


def recorded_jacobian(face: Face, model: Model, data: Data, *about: Any) -> Array:
    """A Jacobian at the inputs of the last call that filled ``data.J``, or its rate at those of ``data.dJ``."""
    (name,), rate = face.call, face.last == "dJ"
    run = last_call(model, data, face.last, before="computeJointJacobians" + "TimeVariation" * rate)
    joint, place, reference = about_frame(model, face.of_joints, *about)
    found = call_about_frame(name, run, joint, place, reference_code(reference))
    bind_getter(getattr(recorded_kinematics, name), run, face, model, data, about)
    return found


def bind_getter(at_inputs: OnFrames, run: Run, face: Face, model: Model, data: Data, about: tuple[Any, ...]) -> None:
    """Bind the builtin of a call about a frame at the inputs of a run, for later calls with such arguments."""
    library = run.library
    if library.has_builtins and run.state is library.state:  # not of an earlier call than the last edit
        words = {"q": run.q, "v": run.v, "placed_rows": run.placed_rows, **run.stamp_words, **library.words}
        data.bind_latest(face.last, run, bind_about(face.name, at_inputs, words, model, about, True, library, run))


def frameJacobianTimeVariation(model: Model, data: Data, q: Any, v: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian at q, v."""
    run, _ = compute(model, data, "jacobians_dot", (q, v))
    updateFramePlacements(model, data)
    joint, place, reference = about_frame(model, False, frame_id, reference_frame)
    return call_about_frame("frame_jacobian_dot", run, joint, place, reference_code(reference))
