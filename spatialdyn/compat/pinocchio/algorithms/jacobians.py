"""Jacobians of joints and frames, and their time derivatives, under Pinocchio's names."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ....calls import dynamics
from ....engines.compiled import numba_kernels
from ....engines.compiled.generated import function_from_text
from ....engines.compiled.tiers import table_kernel
from ....engines.programs.run.single_call import unavailable
from ....recursions import SPECS
from ...native import recorded_calls
from ..data.data import Data, library_of
from ..data.dispatch import (
    ALIGNED,
    IN_FRAME,
    IN_WORLD,
    REFERENCES,
    about_frame,
    fast_calls,
    frame_call,
    frames_for,
    last_call,
    named,
    reference_code,
    vector,
)
from ..data.run import Run
from ..model.library_model import LibraryModel, frame_placements, joints_as_frames
from ..model.model import Model
from ..types.arguments import Array, documented_rows
from ..types.frame import LOCAL
from .kinematics import updateFramePlacements

__all__ = [
    "computeFrameJacobian", "computeJointJacobian", "computeJointJacobians", "computeJointJacobiansTimeVariation",
    "frameJacobianTimeVariation", "getFrameJacobian", "getFrameJacobianTimeVariation", "getJointJacobian",
    "getJointJacobianTimeVariation",
]  # fmt: skip

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

computeJointJacobians, computeJointJacobiansTimeVariation = fast_calls("""
computeJointJacobians = jacobians; last: oMi
    Jacobians of all joints in the world (6, nv), also ``data.J``; without q at the last call's.
computeJointJacobiansTimeVariation = jacobians_dot
    Time derivatives of all joints' Jacobians in the world (6, nv), also ``data.dJ``.
""")


def _at(name: str, doc: str) -> Callable[..., Array]:
    """A Jacobian at a q, which is recorded for the fields that it fills."""
    of_joints = "Frame" not in name

    def slow(model: Model, data: Data, q: Any, index: Any, reference: Any) -> Array:
        library = library_of(model, data)
        q, code = vector("q", q, model.nq), reference_code(reference)
        joint, placement, _ = about_frame(model, of_joints, index, reference)
        frames = joints_as_frames(model) if of_joints else frame_placements(model)
        if code == ALIGNED:
            data.check_frames(model)
            data.hold("oMf")  # the frame is placed at the call, for its placement may be edited after it
        run = data.run_of(KIND_BY_CODE[code], model, library)
        run.store_inputs(q)
        call = unavailable
        found = call_about_frame("frame_jacobian", Inputs(library, library.state, q), joint, placement, code)
        data.note_call(run)
        written = {"oMf": data._held["oMf"]} if code == ALIGNED else {}
        for array in written.values():
            array[index] = data.array("oMi")[joint] @ placement
        if library.has_builtins:
            fields = {x: data._held.get(x) for x in recorded_calls.FIELDS if x in run.kind.fills}
            held = {x: array for x, array in fields.items() if array is not None and library.joints is None} | written
            words = {x: held[x].ctypes.data if x in held else 0 for x in recorded_calls.FIELDS}
            words |= {"code": code, **library.words, **frames.words(rows=True)}
            call = recorded_calls.frame_jacobian_at.bind(words, library, run, frames, held, record=run.recording(1))
        data._bound[name if of_joints else id(reference)] = run, frames, call
        return found

    index = "joint_id" if of_joints else "frame_id"
    text = [
        f"def {name}(model, data, q, {index}{'' if of_joints else ', reference_frame=LOCAL'}):",
        "    try:",
        f"        run, frames, call = data._bound[{repr(name) if of_joints else 'id(reference_frame)'}]",
        f"        if run.library is model._library{'' if of_joints else ' and frames is model._frame_placements'}:",
        f"            found = call(q, {index})",
        "            if found is None and run.library.follow():  # numbers were edited",
        f"                found = call(q, {index})",
        "            if found is not None:",
        "                if run.recompute:",
        "                    data.recompute_held(run)",
        "                return found",
        "    except (AttributeError, KeyError, ValueError):  # the fast path does not apply",
        "        pass",
        f"    return slow(model, data, q, {index}, {'LOCAL' if of_joints else 'reference_frame'})",
    ]
    function = function_from_text(name, text, {"slow": slow, "LOCAL": LOCAL}, f"pinocchio {name}")
    return named(function, name, doc)


computeJointJacobian, computeFrameJacobian = (_at(*row) for row in documented_rows("""
computeJointJacobian
    Jacobian (6, nv) of a joint at q in its own frame; it fills ``data.liMi``.
computeFrameJacobian
    Jacobian (6, nv) of a frame at q: ``(model, data, q, frame_id[, reference_frame])``.

    It fills ``data.liMi``, in WORLD also ``data.oMi``, in LOCAL_WORLD_ALIGNED also ``data.oMi`` and ``data.oMf``.
"""))  # fmt: skip


# --- at the inputs of the last call ------------------------------------------------------------------------


def _recorded(name: str, doc: str) -> Callable[..., Array]:
    """A Jacobian at the inputs of the last call that filled ``data.J``, or its rate at those of ``data.dJ``."""
    of_joints, rate = "Frame" not in name, "TimeVariation" in name
    call_name, field = ("frame_jacobian_dot", "dJ") if rate else ("frame_jacobian", "J")

    def slow(model: Model, data: Data, about: tuple[Any, ...]) -> Array:
        run = last_call(model, data, field, before="computeJointJacobians" + "TimeVariation" * rate)
        joint, place, reference = about_frame(model, of_joints, *about)
        found = call_about_frame(call_name, run, joint, place, reference_code(reference))
        library, call, (key, frames) = run.library, unavailable, frames_for(model, name, of_joints, about)
        if run.state is not library.state:  # of an earlier call than the last edit
            return found
        if library.has_builtins:
            words = {"q_address": run.q.ctypes.data} | ({"v_address": run.v.ctypes.data} if rate else {})
            rows = 0 if rate or run.placed_rows is None else run.placed_rows.ctypes.data
            words |= {"placed_rows": rows, "time": run.stamp_words["time"]}
            words |= {**library.words, **REFERENCES, **frames.words(rows=True)}
            at_inputs = recorded_calls.frame_jacobian_dot if rate else recorded_calls.frame_jacobian
            call = at_inputs.bind(words, library, run, frames)
        run.bound[key] = frames, call
        return found

    return frame_call(name, of_joints, doc, f"data._latest[{field!r}].bound", slow)


getJointJacobian, getFrameJacobian, getJointJacobianTimeVariation, getFrameJacobianTimeVariation = (
    _recorded(*row) for row in documented_rows("""
getJointJacobian
    Jacobian (6, nv) of a joint, ``(model, data, joint_id, reference_frame)``, at the q of data.J.
getFrameJacobian
    Jacobian (6, nv) of a frame, at the q of ``data.J``: ``(model, data, frame_id, reference_frame)`` or
    ``(model, data, joint_id, placement, reference_frame)``.
getJointJacobianTimeVariation
    Time derivative (6, nv) of a joint's Jacobian, arguments as of getJointJacobian, at the q, v of ``data.dJ``.
getFrameJacobianTimeVariation
    Time derivative (6, nv) of a frame's Jacobian, arguments as of getFrameJacobian, at the q, v of ``data.dJ``.
"""))  # fmt: skip


def frameJacobianTimeVariation(model: Model, data: Data, q: Any, v: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian at q, v."""
    computeJointJacobiansTimeVariation(model, data, q, v)
    updateFramePlacements(model, data)
    found: Array = getFrameJacobianTimeVariation(model, data, frame_id, reference_frame)
    return found
