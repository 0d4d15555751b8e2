"""The public calls, one for each Spec of ``recursions.SPECS``: ``rnea(model, q, v, a, fext=None, out=None)``.

A call of one sample of float64 arrays is answered by a builtin (``engines.programs.run.single_call``), which checks
them and runs the model's program, or the compiled table kernel of a model without a program. Everything else (batches,
lists, other dtypes, bad input, a model's first call) goes through ``checked_call``.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..engines import by_table_kernel, object_layout, run
from ..engines.compiled import numba_kernels
from ..engines.compiled.generated import function_from_text
from ..engines.failed import ALL_OK
from ..engines.programs.llvm.call_words import ARRAY, MOST_WORDS, NUMBER, OUT, WORD
from ..engines.programs.run import batch_kernels, single_call
from ..engines.programs.run.single_call import Parameter
from ..engines.tables import hashable
from ..engines.threads import set_num_threads
from ..errors import ModelError, literal
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.spec import Argument, Spec
from .arguments import (
    Array,
    as_array,
    as_flag,
    batch_shape,
    broadcast,
    check_model,
    check_out,
    core_shape,
    empty,
    flatten_batch,
    frame_row_and_placement,
    reference_code,
)
from .failures import raise_early, raise_failures

F8 = np.dtype(np.float64)
BUILTINS = object_layout.READY and not numba_kernels.PLAIN  # whether public calls are builtins
DEFAULTS = {"reference": "local", "classical": False}


class Plan(NamedTuple):
    """How to compute a call with a given choice of inputs.

    spec     the call with those inputs only
    program  None if there is none, or a required input is missing
    shape    shape of one sample of the result
    vectors  whether all inputs are vectors, so that a batch of arrays (B, n) can go straight to the program
    """

    spec: Spec
    program: run.CallProgram | None
    shape: tuple[int, ...]
    vectors: bool


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def plan_of(
    spec: Spec, model: Model, present: tuple[bool, ...], static: tuple[bytes | int, ...], by_table: bool = False
) -> Plan:
    """The plan of a call.

    present   whether each varying input is given, in order
    static    values of the static inputs, as ``hashable`` returns them
    by_table  without a program, for the table kernel
    """
    varying = [x for x in spec.present if not x.static]
    given = [x for x, there in zip(varying, present, strict=True) if there]
    lacks = any(not (there or x.optional) for x, there in zip(varying, present, strict=True))
    spec = numba_kernels.variant(spec, frozenset(x.name for x in given))
    program = None if lacks or by_table else run.program(spec, model, static)
    return Plan(spec, program, core_shape(model, spec.output, static), all(len(x.shape) == 1 for x in given))


# --- the checked call -----------------------------------------------------------------------------------


def checked_call(
    spec: Spec,
    model: Model,
    values: tuple[Any, ...],
    static: tuple[Any, ...],
    out: Any,
    words: tuple[Any, ...] = (),
    by_table: bool = False,
) -> Any:
    """A call with all argument checks.

    values    the spec's varying inputs in order, None for one left out
    words     the arguments from which ``static`` was read, in the order of parameters
    by_table  whether to use the table kernel for any model
    """
    done = None if by_table else _program_call(spec, model, values, static, out)
    if done is not None:
        return done
    check_model(model)
    if any(model.bodies[column].any() for column in spec.lacks):
        raise ModelError(f'model "{model.name}" has motors behind a differential, expected none for {spec.name}')
    asked = [(x, value) for x, value in zip([x for x in spec.present if not x.static], values, strict=True)]
    given = [(x, value) for x, value in asked if value is not None or not x.optional]
    arrays = [as_array(x.name, value) for x, value in given]
    plain = None if by_table or out is not None or SPECS.get(spec.name) is not spec else _plain(given, arrays)
    if plain is not None:
        return calls[spec.name](model, **plain, **dict(zip(_words(spec), words, strict=True)))
    named = {x: array for (x, _), array in zip(given, arrays, strict=True)}
    batch = broadcast([x.name for x in named], [batch_shape(model, x, a, static) for x, a in named.items()])
    shape = batch + core_shape(model, spec.output, static)
    result = empty(shape) if out is None else check_out(out, shape, {x.name: a for x, a in named.items()})
    n, seen = math.prod(batch), out is not None
    if n:
        plan = plan_of(spec, model, tuple(x is not None for x in values), hashable(static), by_table)
        if not batch and not by_table:
            _keep_in_model(plan, model, static, words)
        inputs = [flatten_batch(a, batch, core_shape(model, x, static)) for x, a in named.items()]
        flat = result.reshape((n, -1))
        raise_early(plan.spec, model, inputs, static, n, batch)
        failed = None if plan.program is None else plan.program(inputs, flat, seen)
        if failed is None:
            failed = by_table_kernel.run_table_kernel(plan.spec, model, inputs, static, flat, seen=seen)
        if failed is not ALL_OK:
            raise_failures(plan.spec, model, batch, static, failed)
    return result if out is not None or shape else float(result)


def _plain(given: Sequence[tuple[Argument, Any]], arrays: Sequence[Array]) -> dict[str, Any] | None:
    """The inputs of one sample by name, converted for the builtin. Returns None if not applicable: for a batch, and
    for inputs that need no conversion, which the builtin has already declined.

    arrays  the given values as arrays of float64
    """
    made: dict[str, Any] = {}
    for (x, value), array in zip(given, arrays, strict=True):
        if array.ndim != len(x.shape):
            return None
        if x.shape:
            made[x.name] = np.ascontiguousarray(array)
        else:
            made[x.name] = value if type(value) in (float, np.float64) else float(array)
    return made if any(made[x.name] is not value for x, value in given) else None


def table_call(name: str, model: Model, *values: Any) -> Any:
    """A public call without a frame, by name and by the table kernel; optional inputs last, None if left out."""
    spec = SPECS[name]
    public = sorted(spec.present, key=lambda x: x.optional)
    given = dict(zip([x.name for x in public], values, strict=False))
    return checked_call(spec, model, tuple(given.get(x.name) for x in spec.present), (), None, by_table=True)


def _program_call(spec: Spec, model: Any, values: tuple[Any, ...], static: tuple[Any, ...], out: Any) -> Any:
    """The result of a batch of float64 arrays (B, n) by its program. Returns None if not applicable.

    The program checks sizes and layout itself, faster than ``checked_call``.
    """
    first = values[0] if values else None
    if type(first) is not np.ndarray or first.ndim != 2 or not len(first) or type(model) is not Model:
        return None
    given = [x for x in values if x is not None]
    for x in given:
        if type(x) is not np.ndarray or x.ndim != 2 or not (x.dtype is F8 or x.dtype == F8):
            return None
    n = len(first)
    plan = plan_of(spec, model, tuple(x is not None for x in values), hashable(static))
    if plan.program is None or not plan.vectors:
        return None
    shape, seen = (n, *plan.shape), out is not None
    if out is None:
        out = empty(shape)
    elif (
        type(out) is not np.ndarray
        or not (out.dtype is F8 or out.dtype == F8)
        or out.shape != shape
        or not out.flags.c_contiguous
    ):
        return None
    failed = plan.program(given, out if out.ndim == 2 else out.reshape((n, -1)), seen)
    if failed is None:
        return None
    if failed is not ALL_OK:
        raise_failures(plan.spec, model, (n,), static, failed)
    return out


# --- the calls, one per spec -----------------------------------------------------------------------------


STATIC = {  # static input -> (its parameter with the default, the expression that reads the parameter)
    "row": ("frame", "*frame_of(model, frame)"),  # gives row and placement
    "reference": ('reference="local"', "reference_of(reference)"),
    "classical": ("classical=False", 'int(as_flag("classical", classical))'),
}


def parameters_of(spec: Spec) -> list[str]:
    """Parameters of the public call after ``model``."""
    required = [x.name for x in spec.present if not x.static and not x.optional]
    optional = [f"{x.name}=None" for x in spec.present if x.optional]
    return [*required, *(STATIC[x.name][0] for x in spec.present if x.name in STATIC), *optional, "out=None"]


def _python_function(spec: Spec) -> Callable[..., Any]:
    """The Python function of a spec, for all that the builtin declines."""
    varying = "".join(f"{x.name}, " for x in spec.present if not x.static)
    static = "".join(f"{STATIC[x.name][1]}, " for x in spec.present if x.name in STATIC)
    words = "".join(f"{name}, " for name in _words(spec))
    text = [
        f"def {spec.name}(model, {', '.join(parameters_of(spec))}):",
        f"    return checked_call(spec, model, ({varying}), ({static}), out, ({words}))",
    ]
    scope: dict[str, Any] = {
        "checked_call": checked_call,
        "spec": spec,
        "as_flag": as_flag,
        "frame_of": frame_row_and_placement,
        "reference_of": reference_code,
    }
    function = function_from_text(spec.name, text, scope)
    function.__module__ = __name__
    function.__doc__ = docstring(spec)
    return function


def _public_function(spec: Spec) -> Callable[..., Any]:
    """The public function of a spec: a builtin, or the Python function if there is no builtin."""
    python = python_calls[spec.name]
    if not BUILTINS:
        return python
    parameters = [_parameter(spec, x.partition("=")[0]) for x in parameters_of(spec)]
    return single_call.builtin([*SPECS].index(spec.name), len(SPECS), python, parameters, _keys(spec), Model)


def _words(spec: Spec) -> list[str]:
    """The parameters from which a call's static inputs are read; interned, as the builtin needs keywords."""
    return [sys.intern(STATIC[x.name][0].partition("=")[0]) for x in spec.present if x.name in STATIC]


def _parameter(spec: Spec, name: str) -> Parameter:
    if name == "out":
        return Parameter(name, OUT, optional=True)
    if name in _words(spec):
        return Parameter(name, WORD, optional=name in DEFAULTS)
    given = next(x for x in spec.present if x.name == name)
    return Parameter(name, ARRAY if given.shape else NUMBER, given.optional)


def _keys(spec: Spec) -> list[str]:
    """The keys of a call's plans in a model, one for each choice of optional inputs."""
    optional = [x.name for x in spec.present if x.optional]
    chosen = [[name for k, name in enumerate(optional) if bits >> k & 1] for bits in range(1 << len(optional))]
    return [sys.intern(" ".join([spec.name, *names])) for names in chosen]


def _keep_in_model(plan: Plan, model: Model, static: tuple[Any, ...], words: tuple[Any, ...]) -> None:
    """Store the plan's program, or its table kernel, in the model, where the builtin finds it in later calls of one
    sample.
    """
    spec = plan.spec
    if spec.name not in SPECS or not BUILTINS or not all(type(x) in (str, bool) for x in words):
        return
    public = SPECS[spec.name]
    given = {x.name for x in spec.present}
    bits = sum((x.name in given) << k for k, x in enumerate(x for x in public.present if x.optional))
    key = _keys(public)[bits]
    plans: dict[Any, object_layout.Words] = model._plans.setdefault(key, {}) if words else model._plans
    known = plans.get(key if not words else (*words, None, None)[:MOST_WORDS])
    if known is not None and not single_call.exhausted(known):
        return
    found = run.single(spec, model, static, plan.program)
    if found is None:
        return
    if known is not None:
        single_call.change(known, *found)
        return
    parameters = [x.partition("=")[0] for x in parameters_of(public)]
    shapes = {x.name: core_shape(model, x, static) for x in spec.present if not x.static}
    made = single_call.plan(found.words, [plan.shape], list(map(shapes.get, parameters)), alive=found.alive)
    if not words:
        plans.setdefault(key, made)  # another thread may run a plan
        return
    left_out = [[x, None] if x == DEFAULTS[name] else [x] for name, x in zip(_words(spec)[1:], words[1:], strict=True)]
    for rest in itertools.product(*left_out):
        plans.setdefault((words[0], *rest, None, None)[:MOST_WORDS], made)
        if set(rest) <= {None}:
            plans.setdefault(words[0], made)


def docstring(spec: Spec) -> str:
    """numpydoc text of a call, from its spec."""
    lines = [spec.summary, "", f"    Source: {spec.source}", "", "    model   Model"]
    entries: list[tuple[str, str, str]] = []
    for x in spec.present:
        if not x.static:
            shape = ", ".join(["...", *map(str, x.shape)])
            order = ", quaternions x y z w" if x.unit_norm else ""
            rest = "; zero if left out" if x.optional else ""
            entries.append((x.name, f"({shape})", f"{x.meaning}{order} [{x.unit}]{rest}"))
    static = {x.name for x in spec.present if x.static}
    if "row" in static:
        entries.append(("frame", "str | Frame", "name of a link or joint; link:NAME or joint:NAME if both have it"))
    if "reference" in static:
        entries.append(("reference", "str", "local, world or local_world_aligned"))
    if "classical" in static:
        entries.append(("classical", "bool", "True: classical acceleration of the frame's origin; False: spatial"))
    shape = ", ".join(["...", *map(str, spec.output.shape)]) if spec.output.shape else "..."
    entries.append(("out", f"({shape})", "written in place if given: float64, C order, the shape of the result"))
    lines += [f"    {name:<9} {what:<18} {text}" for name, what, text in entries]
    lines += ["", f"    Returns {spec.output.name} ({shape}): {spec.output.meaning} [{spec.output.unit}]."]
    raises = ["ShapeError for shapes that do not match, or an out that overlaps an input"]
    if any(x.unit_norm for x in spec.present):
        raises.append("ConfigurationError for a quaternion or pair whose norm is not 1")
    if spec.pivots:
        raises.append("InertiaError naming a joint with zero articulated inertia; near one: sd.diagnose")
    if "row" in static:
        raises.append("ModelError for an unknown frame, listing similar names")
    if "reference" in static:
        raises.append("SpatialDynError for another reference")
    if "classical" in static:
        raises.append("SpatialDynError for a classical that is not True or False")
    raises.append("NonFiniteError if finite input gives a result that is not finite")
    raises.append("KeyboardInterrupt at Ctrl-C, also within a batch: out holds the finished samples, NaN for the rest")
    lines += [
        "    Raises",
        *(f"        {r}" for r in raises),
        "    NaN in a sample gives NaN in the results that depend on it, in no other sample.",
        "    ",
    ]
    return "\n".join(lines)


class Calls(dict[str, Callable[..., Any]]):
    """Functions by the names of SPECS, each made at its first use, since making builtins takes LLVM and time."""

    def __init__(self, make: Callable[[Spec], Callable[..., Any]]) -> None:
        """``make`` makes the function of a Spec."""
        super().__init__()
        self._make = make

    def __missing__(self, name: str) -> Callable[..., Any]:
        made = self._make(SPECS[name])
        return self.setdefault(name, made)

    def __iter__(self) -> Iterator[str]:
        return iter(SPECS)

    def __len__(self) -> int:
        return len(SPECS)

    def __contains__(self, name: object) -> bool:
        return name in SPECS

    def keys(self) -> Any:
        """All names."""
        return SPECS.keys()

    def items(self) -> Any:
        """All names and functions."""
        return [(name, self[name]) for name in SPECS]

    def values(self) -> Any:
        """All functions."""
        return [self[name] for name in SPECS]


python_calls = Calls(_python_function)
calls = Calls(_public_function)


def __getattr__(name: str) -> Callable[..., Any]:
    if name in SPECS:
        return calls[name]
    raise AttributeError(f"module {literal(__name__)} has no attribute {literal(name)}")


def total_mass(model: Model) -> float:
    """Mass of all moving bodies [kg]; bodies fixed to the world do not count."""
    return check_model(model).total_mass


__all__ = [*SPECS, "set_num_threads", "total_mass"]
