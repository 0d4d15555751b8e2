"""How a function of this package calls the library: by a builtin where it applies, else with full argument checks."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ....engines.compiled.generated import function_from_text
from ....errors import ShapeError
from ....model.robot_checks import masked
from ....recursions import spec
from ...native.recorded_calls import PARTS
from ..model.library_model import FramePlacements, LibraryModel, frame_placements, joints_as_frames, library_model
from ..model.model import Model
from ..types.arguments import (
    NUMBERS,
    ArgumentError,
    Array,
    RangeError,
    ValueRuntimeError,
    all_expected,
    described,
    documented_rows,
    expected,
    module_of_caller,
)
from ..types.frame import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, ReferenceFrame
from ..types.motion import Force
from ..types.se3 import SE3
from ..types.tracked_list import Rows
from .data import Data, library_of
from .field_recipes import CALL_KINDS
from .run import Run

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
    run: Run = data.run_of(kind, model, library)
    result = _by_builtin(run, given, fext)
    if result is None and entry.call and library.renew(entry.call, fext is not None):
        result = _by_builtin(run, given, fext)
    if result is not None:
        if fext is None:
            run.forces = None
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
    run.forces = fext
    data.note_call(run)
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


def fast_calls(table: str, **scope: Any) -> list[Any]:
    """The functions of a table: rows ``name = kinds; option: text; ...``, each with its docstring below, indented by 4.

    Kinds and options are those of ``fast_call``, whose ``scope`` is the same for all.
    """
    scope, made = {"__name__": module_of_caller(), **scope}, []
    for head, doc in documented_rows(table):
        first, *options = re.split(r";\s+", head)
        name, kinds = first.split(" = ")
        made.append(fast_call(name, kinds, doc, {**scope}, **dict(x.split(": ", 1) for x in options)))
    return made


def fast_call(
    name: str,
    kinds: str,
    doc: str,
    scope: dict[str, Any],
    returns: str = "result",
    forces: str = "",
    options: str = "",
    when: str = "",
    slow: str = "",
    last: str = "",
    optional: str = "",
) -> Callable[..., Any]:
    """The function ``name(model, data, *inputs of a kind)``: the Run's builtin, for float64 arrays of one sample, else
    ``compute``, which checks the arguments.

    kinds    kinds whose inputs begin alike; the inputs that are not None choose one
    scope    names in the texts below, and ``__name__``
    returns  source text of what it returns, from ``result``, a new array, and ``run``
    forces   source text of the parameter for external forces: "fext" or "fext=None"
    options  source text of further parameters
    when     source text of a condition that these have to meet for the builtin
    slow     source text of a statement that comes before ``compute``; it may change the inputs, fext and ``kind``
    last     field of Data: without inputs, those of the last call that filled it are taken
    optional any text: the inputs may be left out, ``slow`` finds them
    """
    choices = {kind: CALL_KINDS[kind].inputs.split() for kind in kinds.split()}
    given = [*choices.values()]
    inputs, least = given[-1], 0 if last or optional else len(given[0])
    parameters = [*inputs[:least], *(f"{x}=None" for x in inputs[least:]), forces, options]
    text = [f"def {name}(model, data, {', '.join(filter(None, parameters))}):"]
    if last:
        text += ["    if q is None:", f"        run = last_call(model, data, {last!r})"]
        text.append(f"        {', '.join(inputs)} = {', '.join(f'run.{x}.copy()' for x in inputs)}")
    text.append("    try:")
    condition = f"run.library is (model._library or library_model(model)){when and f' and {when}'}"
    for (kind, names), more in zip(choices.items(), [*given[1:], None], strict=True):
        call = f"run.call({', '.join(names)})"
        if forces:
            call = f"({call} if fext is None else run.call_with_forces(fext, {', '.join(names)}))"
        branch = f"{'el' * (names is not given[0])}if {more[len(names)]} is None:" if more else "else:"
        lines = [f"run = data._runs[{kind!r}]", f"result = {call} if {condition} else None"]
        lines.append(
            f"if result is None and run.library.follow() and {condition}: result = {call}  # numbers were edited"
        )
        text += [f"        {line}" for line in ([branch, *(f"    {x}" for x in lines)] if len(given) > 1 else lines)]
    chosen = "".join(f"({', '.join(x)},) if {y[len(x)]} is None else " for x, y in pairwise(given))
    text += [
        "        if result is not None:",
        *(f"            data._latest[{x!r}] = run" for x in CALL_KINDS[next(iter(choices))].getters),
        *(["            if fext is None:", "                run.forces = None"] if forces else []),
        "            if run.recompute:",
        "                for recompute in run.recompute:",
        "                    if recompute() is None:",
        "                        data.recompute_held(run)",
        f"            return {returns}",
        "    except (AttributeError, KeyError, TypeError, ValueError):  # the fast path does not apply",
        "        pass",
        f"    kind = {next(iter(choices))!r}",
        *([f"    {slow}"] if slow else []),
        f"    given = {chosen}({', '.join(inputs)},)",
        *([f"    kind = {[*choices]!r}[len(given) - {len(given[0])}]"] if len(given) > 1 else []),
        f"    run, result = compute(model, data, kind, given{', fext' * bool(forces)})",
        f"    return {returns}",
    ]
    scope |= {"compute": compute, "library_model": library_model, "last_call": last_call}
    function = function_from_text(name, text, scope, f"pinocchio {name}")
    function.__doc__ = doc
    return function


def frame_call(
    name: str, of_joints: bool, doc: str, bound: str, slow: Callable[..., Any], reference: Any = None
) -> Callable[..., Any]:
    """The function ``name(model, data, frame_id, reference_frame)``, or of a joint, ``name(model, data, joint_id,
    placement, reference_frame)`` and like calls: a builtin bound for the model's frames as they are, else ``slow``.

    bound      source text of the dict that holds the FramePlacements and the builtin by ``name``, with a placement by
               ``placed_name``: the builtin's frame of each joint, into which that is copied
    slow       ``(model, data, about)``, with the arguments of ``about_frame``; binds the builtin for later calls
    reference  the reference frame by default
    """
    about = "frame_id, reference_frame, last, joint_id, placement"
    placed = [
        "    if type(reference_frame) is SE3:",
        "        try:",
        f"            frames, call = {bound}[{placed_name(name)!r}]",
        "            if frames.joints is model._library.frames.joints:",
        "                frames.places[frame_id][...] = reference_frame._x",
        "                if (found := call(frame_id, LOCAL if last is None else last)) is not None:",
        "                    return found",
        "        except (AttributeError, IndexError, KeyError):  # the fast path does not apply",
        "            pass",
    ]
    text = [
        f"def {name}(model, data, frame_id=None, reference_frame=reference, last=None, joint_id=None, placement=None):",
        "    try:",
        f"        frames, call = {bound}[{name!r}]",
        f"        if frames is {'model._library.frames' if of_joints else 'model._frame_placements'}:",
        "            if (found := call(frame_id, reference_frame)) is not None:",
        "                return found",
        "    except (AttributeError, KeyError):  # the fast path does not apply",
        "        pass",
        *([] if of_joints else placed),
        f"    return slow(model, data, ({about}))",
    ]
    scope = {"slow": slow, "reference": reference, "SE3": SE3, "LOCAL": LOCAL, "__name__": module_of_caller()}
    function = function_from_text(name, text, scope, f"pinocchio {name}")
    function.__doc__ = doc
    return function


def placed_name(name: str) -> str:
    """The key of a builtin about frames that are no frames of the model."""
    return f"{name} at a placement"


def frames_for(model: Model, name: str, of_joints: bool, about: tuple[Any, ...]) -> tuple[str, FramePlacements]:
    """The key of the builtin of a ``frame_call`` for such arguments, and the frames that it takes."""
    if isinstance(about[1], SE3):
        joints = joints_as_frames(model)
        return placed_name(name), FramePlacements.of(joints.joints, joints.rows, joints.placements)
    return name, joints_as_frames(model) if of_joints else frame_placements(model)


# --- arguments about a joint or a frame ------------------------------------------------------------------


IN_FRAME, IN_WORLD, ALIGNED = spec.LOCAL, spec.WORLD, spec.LOCAL_WORLD_ALIGNED  # the library's codes
CODES = {LOCAL: IN_FRAME, WORLD: IN_WORLD, LOCAL_WORLD_ALIGNED: ALIGNED}
REFERENCES = {"in_frame": id(LOCAL), "in_world": id(WORLD), "aligned": id(LOCAL_WORLD_ALIGNED)}
IDENTITY = np.eye(4)


def named(function: Callable[..., Any], name: str, doc: str) -> Callable[..., Any]:
    """A function made from a row of a table, with its name and docstring."""
    function.__name__ = function.__qualname__ = name
    function.__doc__ = doc
    return function


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
