"""Jacobians of joints and frames, and their time derivatives, under Pinocchio's names."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ....calls import dynamics
from ....calls.arguments import core_shape
from ....engines.compiled import numba_kernels
from ....engines.compiled.cpython import unavailable
from ....recursions import SPECS
from ....recursions.spec import LOCAL as IN_FRAME
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ...native import recorded_calls
from ..data.data import Data, library_of
from ..data.dispatch import fast_call, last_call, vector
from ..data.frame_arguments import REFERENCES, about_frame, named, reference_code
from ..data.last_call import Run, clock
from ..model.library_model import frame_placements, joints_as_frames
from ..model.model import Model
from ..types.arguments import Array
from ..types.frame import LOCAL
from .kinematics import updateFramePlacements

__all__ = [
    "computeFrameJacobian", "computeJointJacobian", "computeJointJacobians", "computeJointJacobiansTimeVariation",
    "frameJacobianTimeVariation", "getFrameJacobian", "getFrameJacobianTimeVariation", "getJointJacobian",
    "getJointJacobianTimeVariation",
]  # fmt: skip

KIND_BY_CODE = {
    IN_FRAME: "frame_jacobian_local",
    IN_WORLD: "frame_jacobian_world",
    ALIGNED: "frame_jacobian_aligned",
}
_dynamics: Any = dynamics  # Any: its stub names the public calls alone


@cache
def _kernel(name: str) -> Any:
    return numba_kernels.sample_kernel(numba_kernels.variant(SPECS[name], frozenset()))


def call_about_frame(name: str, run: Any, joint: int, placement: Array, *static: int) -> Array:
    """A call of the library about a frame on a joint, at the inputs of a run: by its table kernel, or with checks."""
    spec, library = SPECS[name], run.library
    model, row = library._model, int(library.rows[joint])  # gravity and inertias move no frame
    values = [getattr(run, x.name) for x in spec.present if not x.static]
    if model.mimic_matrix is None:
        out = np.empty(core_shape(model, spec.output))
        if not _kernel(name)(getattr(model, numba_kernels.TABLE), *values, row, placement, *static, out):
            return out
    found: Array = _dynamics.checked_call(spec, model, values, (row, placement, *static), None, by_table=True)
    return found


# --- at a configuration ----------------------------------------------------------------------------------

computeJointJacobians = fast_call(
    "computeJointJacobians",
    "jacobians",
    "Jacobians of all joints in the world (6, nv), also ``data.J``; without q at the last call's.",
    last="oMi",
)
computeJointJacobiansTimeVariation = fast_call(
    "computeJointJacobiansTimeVariation",
    "jacobians_dot",
    "Time derivatives of all joints' Jacobians in the world (6, nv), also ``data.dJ``.",
)


def _jacobian_at(model: Model, data: Data, q: Any, index: Any, reference: Any, of_joints: bool) -> Array:
    """The Jacobian of a frame at q, which is recorded for the fields that it fills, and its builtin for later calls."""
    library = library_of(model, data)
    q, code = vector("q", q, model.nq), reference_code(reference)
    joint, placement, _ = about_frame(model, of_joints, index, reference)
    frames = joints_as_frames(model) if of_joints else frame_placements(model)
    if code == ALIGNED:
        data.check_frames(model)
    run = data.run_of(KIND_BY_CODE[code], model, library)
    run.store_inputs(q)
    run.frames, call = frames, unavailable
    found = call_about_frame("frame_jacobian", run, joint, placement, code)
    data.note_call(run)
    if library.has_builtins:
        words = {"six": 6, "memory": run.memory.ctypes.data, "code": code, **library.words}
        held = {
            name: data._held.get(name)
            for name in recorded_calls.HELD
            if name in run.kind.fills and library.joints is None
        }
        words |= {name: 0 if held.get(name) is None else held[name].ctypes.data for name in recorded_calls.HELD}
        call = recorded_calls.frame_jacobian_at().bind(library, run, frames, held, **words, **frames.words(rows=True))
    data._bound["joint_jacobian" if of_joints else id(reference)] = run, frames, call
    return found


def computeJointJacobian(model: Model, data: Data, q: Any, joint_id: int) -> Array:
    """Jacobian (6, nv) of a joint at q in its own frame; it fills ``data.liMi``."""
    try:
        run, _, call = data._bound["joint_jacobian"]
        if run.library is model._library:
            J: Array | None = call(q, joint_id)
            if J is not None:
                run.stamp = clock()
                if run.recompute:
                    data.recompute_held(run)
                return J
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    return _jacobian_at(model, data, q, joint_id, LOCAL, True)


def computeFrameJacobian(model: Model, data: Data, q: Any, frame_id: int, reference_frame: Any = LOCAL) -> Array:
    """Jacobian (6, nv) of a frame at q.

    It fills ``data.liMi``, in WORLD also ``data.oMi``, in LOCAL_WORLD_ALIGNED also ``data.oMi`` and ``data.oMf``.
    """
    try:
        run, frames, call = data._bound[id(reference_frame)]
        if run.library is model._library and frames is model._frame_placements:
            J: Array | None = call(q, frame_id)
            if J is not None:
                run.stamp = clock()
                if run.recompute:
                    data.recompute_held(run)
                return J
    except (AttributeError, KeyError, ValueError):  # the fast path does not apply
        pass
    return _jacobian_at(model, data, q, frame_id, reference_frame, False)


# --- at the inputs of the last call ------------------------------------------------------------------------


def _recorded(name: str, doc: str, call_name: str, of_joints: bool) -> Callable[..., Array]:
    """A Jacobian at the inputs of the last call that filled a field of Data."""
    field, before = "J", "computeJointJacobians"
    if call_name == "frame_jacobian_dot":
        field, before = "dJ", "computeJointJacobiansTimeVariation"
    key = call_name, of_joints

    def function(
        model: Model,
        data: Data,
        frame_id: Any = None,
        reference_frame: Any = None,
        last: Any = None,
        *,
        joint_id: Any = None,
        placement: Any = None,
    ) -> Array:
        try:
            run: Any = data._last_J[0] if field == "J" else data.latest(field)  # None raises AttributeError
            frames, call = run.bound[key]
            library = model._library
            if frames is (library.frames if of_joints else model._frame_placements) and library:
                J: Array | None = call(frame_id, reference_frame)
                if J is not None:
                    return J
        except (AttributeError, KeyError):  # the fast path does not apply
            pass
        run = last_call(model, data, field, before=before)
        about = frame_id, reference_frame, last, joint_id, placement
        joint, place, reference = about_frame(model, of_joints, *about)
        found = call_about_frame(call_name, run, joint, place, reference_code(reference))
        _bind(run, model, call_name, of_joints)
        return found

    return named(function, name, doc)


def _bind(run: Run, model: Model, call_name: str, of_joints: bool) -> None:
    """Bind the builtin of a Jacobian at the inputs of a run, for later calls."""
    library, call = run.library, unavailable
    frames = joints_as_frames(model) if of_joints else frame_placements(model)
    if library.has_builtins:
        inputs = {"q_address": run.q} if call_name == "frame_jacobian" else {"q_address": run.q, "v_address": run.v}
        words = {x: array.ctypes.data for x, array in inputs.items()}
        words |= {"six": 6, **library.words, **REFERENCES, **frames.words(rows=True)}
        call = recorded_calls.frame_jacobian(call_name).bind(library, run, frames, **words)
    run.bound[call_name, of_joints] = frames, call


getJointJacobian = _recorded(
    "getJointJacobian",
    "Jacobian (6, nv) of a joint, ``(model, data, joint_id, reference_frame)``, at the q of ``data.J``.",
    "frame_jacobian",
    True,
)
getFrameJacobian = _recorded(
    "getFrameJacobian",
    """Jacobian (6, nv) of a frame, at the q of ``data.J``: ``(model, data, frame_id, reference_frame)`` or
    ``(model, data, joint_id, placement, reference_frame)``.
    """,
    "frame_jacobian",
    False,
)
getJointJacobianTimeVariation = _recorded(
    "getJointJacobianTimeVariation",
    "Time derivative (6, nv) of a joint's Jacobian, arguments as of getJointJacobian, at the q, v of ``data.dJ``.",
    "frame_jacobian_dot",
    True,
)
getFrameJacobianTimeVariation = _recorded(
    "getFrameJacobianTimeVariation",
    "Time derivative (6, nv) of a frame's Jacobian, arguments as of getFrameJacobian, at the q, v of ``data.dJ``.",
    "frame_jacobian_dot",
    False,
)


def frameJacobianTimeVariation(model: Model, data: Data, q: Any, v: Any, frame_id: int, reference_frame: Any) -> Array:
    """Time derivative (6, nv) of a frame's Jacobian at q, v."""
    computeJointJacobiansTimeVariation(model, data, q, v)
    updateFramePlacements(model, data)
    return getFrameJacobianTimeVariation(model, data, frame_id, reference_frame)
