"""Control laws as Specs: their inputs and states in a step, their outputs on a table of rows, and their checks."""

from __future__ import annotations

import dis
import math
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..calls.arguments import as_array
from ..engines.compiled.numba_kernels import variant
from ..engines.programs.record.mimic_rows import MimicRows
from ..engines.programs.record.tracer import evaluate, table
from ..errors import ModelError, SimulationError, SpatialDynError, literal
from ..recursions.joints.friction import DT
from ..recursions.spec import TAU, Argument, Q, Spec, V, shape_in, sizes_of

Array = NDArray[Any]
Law = Callable[[Any, Any, Any, Mapping[str, Any]], tuple[Any, dict[str, Any]]]
RATE, AFTER = "_rate", "_after"  # endings of a state's part
BEGUN = "_begun"  # ending of an input that is q, v, tau or a state at the beginning of the step
OWN_INPUT = "control."  # prefix of the names of a law's inputs in a step
OF_STEP = (Q.name, V.name, TAU.name, DT.name)  # inputs that the step gives
NUMBERS = (int, float, complex, list, dict, np.ndarray, np.generic)  # types that a law may read only as inputs
OWN_MODULES = __name__.partition(".")[0] + "."
CODE = (types.FunctionType, types.BuiltinFunctionType, types.ModuleType, type)  # types that a law may close over


def in_step(name: str) -> str:
    """The name in a step of an input or state of a law."""
    return OWN_INPUT + name


def own_name(name: str) -> str:
    """The name in the law, and for the caller, of an input or state of a step."""
    return name.removeprefix(OWN_INPUT)


def begun(x: Argument) -> Argument:
    """q, v, tau or a state at the beginning of the step, as an input of a law: a torque held over the step reads it."""
    return replace(x, name=x.name + BEGUN, start=None, unit_norm=False, optional=False)


def begun_of(spec: Spec) -> dict[str, str]:
    """{name: name without BEGUN} of the inputs of a law that are values at the beginning of the step."""
    known = {x + BEGUN: x for x in (*OF_STEP[:3], *(x.name for x in spec.states))}
    return {x.name: known[x.name] for x in spec.present if x.name in known}


def given_by_step(spec: Spec) -> set[str]:
    """Names of the inputs of a law that the step gives."""
    return {*OF_STEP, *begun_of(spec)}


def static_rows(value: Any) -> Any:
    return table(value.rows) if hasattr(value, "rows") else value


def _of_step(x: Argument) -> Argument:
    """An input of a law as an input of a step."""
    return replace(x, name=OWN_INPUT + x.name, optional=False, unit_norm=False)


@lru_cache(maxsize=256)
def states_of(spec: Spec) -> tuple[Argument, ...]:
    """The states of a law, named as in a step."""
    return tuple(_of_step(x) for x in spec.states)


def moved_states(spec: Spec) -> tuple[str, ...]:
    """Names, in a step, of the states that have rates."""
    ends = (part.name for part in spec.parts[1:])
    return tuple(OWN_INPUT + x.name for x, end in zip(spec.states, ends, strict=True) if end == x.name + RATE)


@lru_cache(maxsize=256)
def inputs_of(spec: Spec) -> tuple[Argument, ...]:
    """The inputs of a law beside q, v, dt and its states, named as in a step, static ones last."""
    found = [x for x in spec.present if x.start is None and x.name not in given_by_step(spec)]
    return tuple(_of_step(x) for x in sorted(found, key=lambda x: x.static))


def law_on(spec: Spec, rows: Sequence[Any], inputs: Mapping[str, Any]) -> Law:
    """``(q, v, tau, states) -> tau, rates or ends of states`` on a table of Rows; ``inputs`` are those of a step.

    The arguments of its first call count as the beginning of the step, unless the inputs contain the beginning.
    """
    parts, early = spec.parts or (spec.output,), begun_of(spec)
    first: dict[str, Any] = {}

    def law(q: Any, v: Any, tau: Any, states: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        given = {Q.name: q, V.name: v, TAU.name: tau}
        for x in spec.present:
            if x.name not in given and x.name not in early:
                name = x.name if x.name in OF_STEP else OWN_INPUT + x.name
                given[x.name] = states[name] if name in states else inputs[name]
        if not first:
            first.update({name: inputs.get(name, given[of]) for name, of in early.items()})
            first.update({name: x.copy() for name, x in first.items()})
        given |= first
        sizes = sizes_of(rows, [(x, given[x.name]) for x in spec.present if x.table is not None])
        widths = [math.prod(shape_in(x.shape, sizes)) for x in parts]
        out = evaluated(spec, rows, (sum(widths),), given)
        wanted, *made = np.split(out, np.cumsum(widths)[:-1])
        return wanted, {OWN_INPUT + x.name: y for x, y in zip(spec.states, made, strict=True)}

    return law


def evaluated(
    spec: Spec, rows: Sequence[Any], shape: tuple[int, ...], inputs: Mapping[str, Any], start: float = 0.0
) -> Any:
    """``tracer.evaluate`` for a caller's Spec, named in errors. ``start`` fills entries that are not written."""
    try:
        return evaluate(spec, rows, shape, inputs, np.zeros(len(rows) - 1, object), start)
    except SpatialDynError:
        raise
    except AttributeError as error:
        if not isinstance(rows, MimicRows):
            raise
        raise ModelError(
            f'spec "{spec.name}" walks the tree of a robot with mimic joints ({error}), expected one of their own '
            "coordinates: rnea, crba and aba may be called"
        ) from None
    except (TypeError, ValueError, IndexError, ZeroDivisionError) as error:
        named = f'spec "{spec.name}": '
        kind = ZeroDivisionError if isinstance(error, ZeroDivisionError) else TypeError
        raise kind(named + str(error).removeprefix(named)) from error


# --- checks ---------------------------------------------------------------------------------------------


def check_recordable(spec: Any) -> None:
    """Raise SimulationError for anything but a Spec, and for a Spec that one program cannot serve for all values."""
    if not isinstance(spec, Spec):
        raise SimulationError(f"spec is {literal(spec)}, expected a Spec")
    if not spec.traceable:
        raise SimulationError(f'spec "{spec.name}" branches on values, expected one that can be recorded')
    _refuse_constants(spec)


def with_values(spec: Spec, given: Mapping[str, Any] | None) -> tuple[Spec, dict[str, Any], tuple[Any, ...]]:
    """A law without the optional inputs that have no value, copies of the other values, and static values last.

    Raises SimulationError for missing or unknown values, or if they are no mapping.
    """
    if given is not None and not isinstance(given, Mapping):
        raise SimulationError(
            f'values of spec "{spec.name}" are {literal(given)}, expected a mapping of names to arrays'
        )
    given = dict(given or {})
    others = {x.name: x for x in spec.present if x.start is None and x.name not in given_by_step(spec)}
    for name in given:
        if name not in others:
            listed = f"some of {', '.join(others)}" if others else "none"
            raise SimulationError(f'values of spec "{spec.name}" have {name}, expected {listed}')
    missing = [name for name, x in others.items() if name not in given and not x.optional]
    if missing:
        raise SimulationError(f'values of spec "{spec.name}" lack {", ".join(missing)}')
    spec = variant(spec, given) if any(x.optional for x in spec.present) else spec
    known = [x for x in spec.present if x.name in given]
    static = tuple(_static(x.name, given[x.name]) for x in known if x.static)
    return spec, {x.name: kept(as_array(x.name, given[x.name])) for x in known if not x.static}, static


def kept(x: Array) -> Array:
    """A read-only copy, or the array itself if it is read-only."""
    if x.flags.writeable or x.base is not None:
        x = x.copy()
        x.flags.writeable = False
    return x


def _static(name: str, value: Any) -> Any:
    """The value of a static input: an int, or the table of Constraints and the like. Raises SimulationError."""
    found = getattr(value, "table", value)
    if isinstance(found, (bool, np.bool_)) or not isinstance(found, (int, np.integer, StaticTable)):
        raise SimulationError(
            f"{name} is {literal(value)}, expected an int, or an object with a table, as static inputs are"
        )
    return found if isinstance(found, StaticTable) else int(found)


def _refuse_constants(spec: Spec) -> None:
    """Raise SimulationError for a recursion that reads numbers other than inputs, because compiled code keeps them.

    Functions that it calls are checked too, except those of this library.
    """
    seen: set[int] = set()
    waiting: list[Any] = [spec.recursion]
    while waiting:
        function = waiting.pop()
        if isinstance(function, types.MethodType):
            raise SimulationError(
                f'recursion of spec "{spec.name}" is or calls a method, {function.__qualname__}, expected functions: '
                "what an object holds is no input"
            )
        if id(function) in seen or not isinstance(function, types.FunctionType):
            continue
        seen.add(id(function))
        for name, held in _read(function):
            if isinstance(held, NUMBERS) or (name in function.__code__.co_freevars and not isinstance(held, CODE)):
                raise SimulationError(
                    f'recursion of spec "{spec.name}" reads {name} = {literal(held)} in {function.__name__}, expected '
                    f'functions only: make {name} an input, Argument("{name}", ...), and give it in values'
                )
            if isinstance(held, (types.FunctionType, types.MethodType)) and not held.__module__.startswith(OWN_MODULES):
                waiting.append(held)


def _read(function: types.FunctionType) -> list[tuple[str, Any]]:
    """The outer names that a function reads: its closure, and the globals that its code names."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    found = [(name, cell.cell_contents) for name, cell in cells]
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        codes += [x for x in code.co_consts if isinstance(x, types.CodeType)]
        found += [(name, function.__globals__[name]) for name in _globals(code) if name in function.__globals__]
    return found


@lru_cache(maxsize=256)
def _globals(code: types.CodeType) -> tuple[str, ...]:
    """The globals that a code names; cached, because a planning controller needs them in its loop."""
    return tuple(sorted({x.argval for x in dis.get_instructions(code) if x.opname == "LOAD_GLOBAL"}))


def check_parts(spec: Spec) -> None:
    """Raise SimulationError unless the output is tau, and a rate or an end of each state."""
    names = [x.name for x in spec.parts] or [spec.output.name]
    states = spec.states
    good = len(names) == 1 + len(states) and names[0] == TAU.name
    good = good and all(name in (x.name + RATE, x.name + AFTER) for name, x in zip(names[1:], states, strict=True))
    if not good:
        wanted = ", ".join([TAU.name, *(f"{x.name}{RATE} or {x.name}{AFTER}" for x in states)])
        raise SimulationError(f'spec "{spec.name}" has the outputs {", ".join(names)}, expected {wanted}')
