"""How a function of this package calls the library where no builtin is bound yet: with full argument checks."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from ....engines.object_layout import slot_offset
from ....errors import ShapeError
from ....model.robot_checks import masked
from ....recursions import spec
from ...native.recorded_calls import PARTS
from ...native.recorded_kinematics import OnFrames
from ..model.library_model import LibraryModel, frame_placements, joints_as_frames, library_model
from ..model.model import Model
from ..types.arguments import (
    NUMBERS,
    ArgumentError,
    Array,
    RangeError,
    ValueRuntimeError,
    all_expected,
    described,
    expected,
)
from ..types.frame import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, ReferenceFrame
from ..types.motion import Force
from ..types.se3 import SE3
from ..types.tracked_list import Rows
from ..types.value import Value
from .data import Data, library_of
from .field_recipes import CALL_KINDS
from .run import Bound, Run

FLOAT64 = np.dtype(np.float64)


def vector(name: str, value: Any, size: int) -> Array:
    """An argument as a float64 vector; a column (n, 1) is taken too. Raises ArgumentError, ShapeError."""
    if type(value) is np.ndarray and value.dtype is FLOAT64 and value.shape == (size,):  # the usual case first
        return value
    if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
        raise ArgumentError(f"{name} is {described(value)}, expected an array of numbers")
    if masked(value):
        raise ArgumentError(f"{name} is masked, expected an array without a mask, which would be lost")
    value = np.asarray(value)  # a slice of an np.matrix keeps two axes
    if value.ndim == 2 and value.shape[1] == 1:
        value = value[:, 0]
    if value.ndim != 1:
        raise ArgumentError(f"{name} is {described(value)}, expected one of shape ({size},)")
    if len(value) != size:
        raise ShapeError(f"{name} has shape {value.shape}, expected ({size},)")
    return np.asarray(value, np.float64)


def forces(fext: Any, library: LibraryModel, njoints: int) -> Array:
    """External forces on the library's joints (njoints, 6), from a list of one Force for each joint of the model."""
    if not isinstance(fext, (list, Rows)):
        raise ArgumentError(f"fext is {described(fext)}, expected a list of Force")
    all_expected(fext, Force, "fext")
    if len(fext) != njoints:
        raise ShapeError(f"fext has {len(fext)} forces, expected {njoints}, one for each joint")
    given = np.array([force._x for force in fext])
    if library.joints is None:
        return given
    spread = np.zeros((library.model.njoints, 6))
    spread[library.joints[1:]] = given[1:]
    return spread


def compute(model: Model, data: Data, kind: str, given: tuple[Any, ...], fext: Any = None) -> tuple[Run, Any]:
    """Check the inputs of a kind, compute its call; returns its Run, and what the Run's builtin would.

    Raises ArgumentError, ShapeError, and what the library's call raises.
    """
    library = library_of(model, data)
    entry = CALL_KINDS[kind]
    run: Run = data.run_of(kind, library)
    result = _by_builtin(run, given, fext)
    if result is None and entry.call and library.renew(entry.call, fext is not None):
        result = _by_builtin(run, given, fext)
    if result is not None:
        data.note_builtin_call(run)
        return run, result
    arrays = [
        vector(name, value, model.nq if name == "q" else model.nv)
        for name, value in zip(entry.inputs.split(), given, strict=True)
    ]
    passed = arrays[: len(arrays) - entry.unused_inputs]
    if fext is not None:
        fext = forces(fext, library, model.njoints)
        passed.append(fext)
    found = library.compute(entry.call, *passed)
    run.store_inputs(*arrays)  # before the result, which may share memory with an input
    run.result[...] = found
    data.note_call(run, fext)
    copied = None if entry.result_in_data else run.result.copy()
    return run, True if copied is None else tuple(copied) if entry.returns == PARTS else copied


def _by_builtin(run: Run, given: tuple[Any, ...], fext: Any) -> Any:
    return run.call(*given) if fext is None else run.call_with_forces(fext, *given)


def last_call(model: Model, data: Data, *fields: str, before: str = "forwardKinematics") -> Run:
    """The last call that filled the first of these fields that some call filled.

    Raises ValueRuntimeError naming the call that has to come before.
    """
    library_of(model, data)
    for field in fields:
        run: Run | None = data.latest(field, of_call=True)
        if run is not None:
            return run
    raise ValueRuntimeError(f"data.{fields[0]} was not computed, expected {before} to be called before")


# --- arguments about a joint or a frame ------------------------------------------------------------------


IN_FRAME, IN_WORLD, ALIGNED = spec.LOCAL, spec.WORLD, spec.LOCAL_WORLD_ALIGNED  # the library's codes
CODES = {LOCAL: IN_FRAME, WORLD: IN_WORLD, LOCAL_WORLD_ALIGNED: ALIGNED}
REFERENCES = {"in_frame": id(LOCAL), "in_world": id(WORLD), "aligned": id(LOCAL_WORLD_ALIGNED)}
OF_POSES = {"pose": id(SE3), "slot": slot_offset(Value, "_x")}
LOCALLY = np.array([IN_FRAME])
IDENTITY = np.eye(4)


def joint_index(model: Model, index: Any) -> int:
    """Checked index of a joint. Raises RangeError if the model has no such joint, ArgumentError for no integer."""
    return _index(index, model.njoints, "joint")


def frame_index(model: Model, index: Any) -> int:
    """Checked index of a frame. Raises RangeError if the model has no such frame, ArgumentError for no integer."""
    return _index(index, len(model.frames), "frame")


def _index(index: Any, count: int, what: str) -> int:
    try:
        k = operator.index(index)
    except TypeError:
        raise ArgumentError(f"{what} index is {described(index)}, expected an integer") from None
    if not 0 <= k < count:
        raise RangeError(f"{what} index is {k}, expected one from 0 to {count - 1}")
    return k


def reference_code(reference_frame: Any) -> int:
    """The library's code of a ReferenceFrame. Raises ArgumentError for anything else."""
    if type(reference_frame) is not ReferenceFrame:
        raise ArgumentError(f"reference frame is {described(reference_frame)}, expected a ReferenceFrame")
    return CODES[reference_frame]


def about_frame(
    model: Model,
    of_joints: bool,
    frame_id: Any = None,
    reference_frame: Any = None,
    last: Any = None,
    joint_id: Any = None,
    placement: Any = None,
) -> tuple[int, Array, Any]:
    """Joint, placement and reference of (frame_id, reference_frame), or (joint_id, placement[, reference_frame]).

    of_joints  the index is a joint's, without a placement
    last       the reference frame where the second argument is a placement, LOCAL if it is left out
    """
    index = joint_id if frame_id is None else frame_id
    if isinstance(reference_frame, SE3) and not of_joints:
        placement, reference_frame, last = reference_frame, LOCAL if last is None else last, None
    if last is not None:
        raise ArgumentError(f"{described(last)} follows the reference frame, expected nothing")
    if of_joints:
        return joint_index(model, index), IDENTITY, reference_frame
    if placement is not None:
        return joint_index(model, index), expected(placement, SE3, "placement")._x, reference_frame
    k, frames = frame_index(model, index), frame_placements(model)
    return int(frames.joints[k]), frames.places[k], reference_frame


def with_pose(name: str) -> str:
    """The key of a builtin about a frame that is given by a joint and its placement."""
    return f"{name} at a placement"


def by_default(name: str) -> str:
    """The key of a builtin about a frame whose reference is left out."""
    return f"{name} by default"


def bind_about(
    name: str, routines: OnFrames, words: dict[str, Any], model: Model, about: tuple[Any, ...], rows: bool, *alive: Any
) -> dict[str, Bound]:
    """The builtins, by their keys, of a call about a frame for later calls with such arguments.

    rows  whether the joints of frames are rows of the table
    """
    if about[0] is None:
        return {}  # no builtin takes arguments in this order
    of_joints, posed = "Frame" not in name, isinstance(about[1], SE3)
    frames = joints_as_frames(model) if of_joints or posed else frame_placements(model)
    owner = library_model(model) if of_joints else frame_placements(model)
    words = {**words, **REFERENCES, **OF_POSES, **frames.words(rows)}
    if posed:
        return {with_pose(name): Bound(owner, routines.at_pose.bind(words, *alive, frames))}
    of_keys = {name: words, by_default(name): {**words, "code": LOCALLY}}
    return {key: Bound(owner, routines.of_frame.bind(x, *alive, frames)) for key, x in of_keys.items()}
