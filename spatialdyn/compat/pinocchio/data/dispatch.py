"""How a function of this package calls the library: by a builtin where it applies, else with full argument checks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ....engines.compiled.generated import function_from_text
from ....errors import ShapeError
from ....model.robot import masked
from ..model.library_model import LibraryModel
from ..model.model import Model
from ..types.arguments import NUMBERS, ArgumentError, described
from ..types.array_rows import Rows
from ..types.frame import Convention
from ..types.motion import Force
from .data import Data, library_of
from .field_recipes import CALL_KINDS
from .last_call import Run, clock

Array = NDArray[np.float64]


def vector(name: str, value: Any, size: int) -> Array:
    """An argument as a float64 vector; a column (n, 1) is taken too. Raises ArgumentError, ShapeError."""
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
    if not isinstance(fext, (list, Rows)) or not all(isinstance(force, Force) for force in fext):
        raise ArgumentError(f"fext is {described(fext)}, expected a list of Force")
    if len(fext) != njoints:
        raise ShapeError(f"fext has {len(fext)} forces, expected {njoints}, one for each joint")
    given = np.array([force._x for force in fext])
    if library.joints is None:
        return given
    spread = np.zeros((library.model.njoints, 6))
    spread[library.joints[1:]] = given[1:]
    return spread


def compute(model: Model, data: Data, kind: str, *values: Any, fext: Any = None) -> Run:
    """Check the arguments, compute a call of a kind, and return its Run, which holds the result.

    Raises ArgumentError, ShapeError, and what the library's call raises.
    """
    library = library_of(model, data)
    entry = CALL_KINDS[kind]
    run: Run = data.run_of(kind, model, library)
    names = entry.inputs.split()
    arrays = [
        vector(name, value, model.nq if name == "q" else model.nv) for name, value in zip(names, values, strict=True)
    ]
    given = arrays[: len(arrays) - entry.unused_inputs]
    if fext is not None:
        fext = forces(fext, library, model.njoints)
        given.append(fext)
    found = dynamics.table_call(entry.call, library.model, *given)
    run.store_inputs(*arrays)  # before the result, which may share memory with an input
    run.result[...] = found
    run.fext = fext
    data.note_call(run)
    return run


def compute_copy(model: Model, data: Data, kind: str, *values: Any, fext: Any = None) -> Array:
    """``compute``, and a copy of its result."""
    return compute(model, data, kind, *values, fext=fext).result.copy()


def fast_call(slow: Callable[..., Any], kind: str, condition: str = "", parameters: str = "") -> Callable[..., Any]:
    """``slow(model, data, *inputs of a kind)`` with a fast path: the Run's builtin, for float64 arrays of one sample.

    condition   source text that has to hold for the fast path
    parameters  source text of further parameters, such as ", fext=None"

    The function returns the result, or the Run of a kind whose result stays in the data.
    """
    entry, name = CALL_KINDS[kind], slow.__name__.lstrip("_")
    given = ", ".join(entry.inputs.split())
    rest = "".join(f", {x.partition('=')[0].strip()}" for x in parameters.split(",")[1:])
    call = f"run.call({given})"
    if "fext" in parameters:
        call = f"{call} if fext is None else run.call_with_forces(fext, {given})"
    text = [
        f"def {name}(model, data, {given}{parameters}):",
        "    try:",
        f"        run = data._runs[{kind!r}]",
        f"        if run.library is model._library{condition and f' and {condition}'}:",
        f"            result = {call}",
        "            if result is not None:",
        "                run.stamp = clock()",
        *(["                if fext is None:", "                    run.fext = None"] if "fext" in parameters else []),
        "                for recompute in run.recompute:",
        "                    if recompute() is None:",
        "                        data.recompute_held(run)",
        f"                return {'run' if entry.result_in_data else 'result'}",
        "    except (AttributeError, KeyError, TypeError, ValueError, SystemError):  # the fast path does not apply",
        "        pass",
        f"    return slow(model, data, {given}{rest})",
    ]
    scope: dict[str, Any] = {"clock": clock, "slow": slow, "LOCAL": Convention.LOCAL}
    function = function_from_text(name, text, scope, f"pinocchio {name}")
    function.__module__, function.__doc__ = slow.__module__, slow.__doc__
    return function
