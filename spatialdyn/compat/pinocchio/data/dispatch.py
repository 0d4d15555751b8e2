"""How a function of this face calls the library: straight to a kernel where that is possible, else step by step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ....errors import ShapeError
from ....model.robot import masked
from ..model.library_model import Made
from ..types.arguments import NUMBERS, ArgumentError, described
from ..types.array_rows import Rows
from ..types.frame import Convention
from ..types.motion import Force
from .data import prepared
from .field_recipes import KINDS
from .last_call import Run, clock

Array = NDArray[np.float64]


def vector(name: str, value: Any, size: int) -> Array:
    """A float64 vector of an argument; a column (n, 1) passes. Raises ArgumentError for another type, ShapeError."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
        raise ArgumentError(f"{name} is {described(value)}, expected an array of numbers")
    if masked(value):
        raise ArgumentError(f"{name} is masked, expected an array without a mask, which would be lost")
    value = np.asarray(value)  # an np.matrix keeps two axes whatever is taken of it
    if value.ndim == 2 and value.shape[1] == 1:
        value = value[:, 0]
    if value.ndim != 1:
        raise ArgumentError(f"{name} is {described(value)}, expected one of shape ({size},)")
    if len(value) != size:
        raise ShapeError(f"{name} has shape {value.shape}, expected ({size},)")
    return np.asarray(value, np.float64)


def forces(fext: Any, made: Made, njoints: int) -> Array:
    """External forces on the library's joints (njoints, 6), of a list of a Force for each joint of the model."""
    if not isinstance(fext, (list, Rows)) or not all(isinstance(force, Force) for force in fext):
        raise ArgumentError(f"fext is {described(fext)}, expected a list of Force")
    if len(fext) != njoints:
        raise ShapeError(f"fext has {len(fext)} forces, expected {njoints}, one for each joint")
    given = np.array([force._x for force in fext])
    if made.joints is None:
        return given
    spread = np.zeros((made.model.njoints, 6))
    spread[made.joints[1:]] = given[1:]
    return spread


def perform(model: Any, data: Any, kind: str, *values: Any, fext: Any = None) -> Run:
    """A call of a kind, whatever its arguments are; its Run holds the result. Raises what they are wrong by."""
    compiled = prepared(model, data)
    entry = KINDS[kind]
    run: Run = data.run_of(kind, model, compiled)
    names = entry.inputs.split()
    arrays = [
        vector(name, value, model.nq if name == "q" else model.nv) for name, value in zip(names, values, strict=True)
    ]
    given = arrays[: len(arrays) - entry.more]
    if fext is not None:
        fext = forces(fext, compiled, model.njoints)
        given.append(fext)
    found = dynamics.calls[entry.call](compiled.model, *given)
    run.keep(*arrays)  # before the result, which may be one of them: somebody holds it
    run.result[...] = found
    run.fext = fext
    data.ran(run)
    return run


def returned(model: Any, data: Any, kind: str, *values: Any, fext: Any = None) -> Array:
    """A copy of the result of such a call."""
    return perform(model, data, kind, *values, fext=fext).result.copy()


def quick(slow: Callable[..., Any], kind: str, condition: str = "", more: str = "") -> Callable[..., Any]:
    """The function ``slow`` of (model, data, *inputs of a kind), with a short way for float64 arrays of one sample.

    condition  what has to hold of its further parameters ``more``, a text such as ", fext=None"

    Of a kind whose result stays, the run is returned.
    """
    entry, name = KINDS[kind], slow.__name__.lstrip("_")
    given = ", ".join(entry.inputs.split())
    rest = "".join(f", {x.partition('=')[0].strip()}" for x in more.split(",")[1:])
    call = f"run.call({given})"
    if "fext" in more:
        call = f"{call} if fext is None else run.pushed(fext, {given})"
    text = [
        f"def {name}(model, data, {given}{more}):",
        "    try:",
        f"        run = data._runs[{kind!r}]",
        f"        if run.made is model._made{condition and f' and {condition}'}:",
        f"            result = {call}",
        "            if result is not None:",
        "                run.stamp = clock()",
        *(["                if fext is None:", "                    run.fext = None"] if "fext" in more else []),
        "                for again in run.again:",
        "                    if again() is None:",
        "                        data.refresh(run)",
        f"                return {'run' if entry.stays else 'result'}",
        "    except (AttributeError, KeyError, TypeError, ValueError, SystemError):  # not as simple as that",
        "        pass",
        f"    return slow(model, data, {given}{rest})",
    ]
    scope: dict[str, Any] = {"clock": clock, "slow": slow, "LOCAL": Convention.LOCAL}
    exec(compile("\n".join(text), __file__, "exec"), scope)
    function: Callable[..., Any] = scope[name]
    function.__module__, function.__doc__ = slow.__module__, slow.__doc__
    return function
