"""The functions of an export by name, each with named arrays, a program, and answers recorded on this machine.

A function is a public call or several, a result of ``specialize``, a step of a scene, or a control law.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import core_shape
from ..calls.exported import exported
from ..calls.random_configurations import random_configuration
from ..calls.specialize import specialize
from ..calls.specialize_request import SpecializeRequest, dtype_of
from ..calls.specialized import Specialized, check_program, of_request, results_of_rows
from ..control.control import Control
from ..control.law_specs import RATE, begun_of, check_recordable
from ..engines.programs.record.operations import INPUT
from ..engines.programs.record.program import Program
from ..engines.programs.transform.source_code import C_WORDS, Shapes, has_meaning
from ..errors import SimulationError, SpatialDynError, literal
from ..model.model import Model
from ..recursions.control.control_laws import law_spec
from ..recursions.control.paths import CLOCK
from ..recursions.joints.friction import DT
from ..recursions.spec import TAU, Argument, Spec
from ..simulation.scene import Scene
from ..simulation.single_step import step, step_request
from .chip_text import LOCAL

Array = NDArray[Any]
LAWS = ("pd", "pd_gravity", "pd_plus", "computed_torque", "passivity_based", "cosine_shaping")
CASES = 3  # recorded answers per function
DRAWS = 64  # samples from which the recorded ones are chosen
OTHER_WORDS = frozenset(  # reserved words of C++, Rust and Arduino's sketches that C does not have
    """
    and and_eq asm bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield compl concept
    consteval constinit const_cast decltype delete dynamic_cast explicit export friend import module mutable namespace
    new noexcept not not_eq operator or or_eq private protected public reinterpret_cast requires static_cast template
    this throw try typeid typename using virtual wchar_t xor xor_eq std
    abstract as async await become box crate dyn final fn gen impl in let loop macro match mod move override priv pub
    ref self Self super trait type unsafe unsized use where yield setup Serial
    """.split()  # noqa: SIM905 - a list of words
)
MACROS = ("NULL", "EOF", "assert", "errno", "offsetof", "stdin", "stdout", "stderr")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Function(NamedTuple):
    """A function of an export.

    inputs   name -> shape of one sample
    outputs  name -> shape of the results
    units    units of arrays that have one
    given    (CASES, entries of the inputs)  recorded states
    answers  (CASES, entries of the outputs)  results of the compiled program on this machine
    """

    name: str
    inputs: Shapes
    outputs: Shapes
    units: Mapping[str, str]
    program: Program
    given: Array
    answers: Array


def check_name(what: str, name: Any) -> str:
    """A name that is valid in C, C++ and Rust. Raises SpatialDynError."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise SpatialDynError(f"{what} is {literal(name)}, expected letters, digits and _")
    if has_meaning(name, "c") or name in OTHER_WORDS or LOCAL.fullmatch(name):
        raise SpatialDynError(f"{what} is {name!r}, expected a name that C, C++, Rust and the text itself do not use")
    return name


def _check_array(name: str) -> None:
    """Check the name of an array, which may equal that of a C library function. Raises SpatialDynError."""
    words = OTHER_WORDS.union(C_WORDS.split(), MACROS)
    if not NAME.fullmatch(name) or name in words or LOCAL.fullmatch(name):
        raise SpatialDynError(f"an array is named {literal(name)}, expected a name that C, C++ and Rust take")


def functions_of(scene: Model | Scene, wanted: Mapping[str, Any], dtype: Any) -> list[Function]:
    """The functions of an export, by name. Raises SpatialDynError, naming the function."""
    made = []
    for name, what in wanted.items():
        check_name("name of a function", name)
        try:
            k, outputs = _program_of(scene, what, dtype)
            made.append(_function(name, k, outputs))
        except SpatialDynError as error:
            error.args = (f"{name}: {error.args[0]}", *error.args[1:])
            raise
    return made


def _program_of(scene: Model | Scene, what: Any, dtype: Any) -> tuple[Specialized, Shapes | None]:
    """A compiled program, and the shapes of its outputs if they are parts of one."""
    model = scene.model if isinstance(scene, Scene) else scene
    function = what.func if isinstance(what, partial) else what
    if isinstance(what, Specialized):
        if what.dtype != dtype_of(dtype):
            raise SpatialDynError(f"a program in {what.dtype}, expected one in {dtype_of(dtype)}")
        return check_program(what, "C"), None
    if isinstance(what, Control):
        for check in what.checks:
            check(model)
        return _of_law(model, what.spec, what.values, what.static, dtype)
    if isinstance(what, Spec):
        check_recordable(what)
        return _of_law(model, what, {}, (), dtype)
    if isinstance(what, str):
        if what not in LAWS:
            raise SpatialDynError(f'"{what}" is no law, expected one of {", ".join(LAWS)}, or a call')
        return _of_law(model, law_spec(what), {}, (), dtype)
    if function is step:
        return check_program(of_request(step_request(scene, what, dtype, {}, None), specialize, ()), "C"), None
    return check_program(specialize(model, what, dtype=dtype), "C"), None


def _of_law(
    model: Model, spec: Spec, values: Mapping[str, Any], static: Sequence[Any], dtype: Any
) -> tuple[Specialized, Shapes]:
    """The program of a law: its values are constants; inputs without a value, and the law's states, are inputs.

    It is called at the beginning of a step; the argument torque and the time step are inputs if the law reads them.
    """
    spec = _at_the_beginning(spec)
    arguments = tuple(x for x in spec.present if not x.static)
    named = [x.name for x in spec.present if x.static]
    if len(named) != len(static):
        raise SimulationError(f'spec "{spec.name}" has tables, expected a Control that has their values')
    constants = {}
    for x in arguments:
        if x.name in values:
            wanted, value = core_shape(model, x, tuple(static)), np.asarray(values[x.name], float)
            if value.size != math.prod(wanted):
                raise SimulationError(
                    f"{x.name} has shape {value.shape}, expected {wanted}: one value, for all steps and samples; "
                    "the law's spec in its place makes it an input"
                )
            constants[x.name] = value.ravel()
    shapes = {x.name: core_shape(model, x, tuple(static)) for x in spec.parts or (spec.output,)}
    width = sum(map(math.prod, shapes.values()))
    whole = replace(spec, output=Argument("torque", (width,), "", "")) if spec.parts else spec
    made = _requested(model, whole, arguments, dict(zip(named, static, strict=True)), constants, dtype)
    for x in arguments:
        if x.name in (TAU.name, DT.name) and x.name not in constants and not _reads(made, x.name):
            constants[x.name] = np.zeros(math.prod(core_shape(model, x)))
            made = _requested(model, whole, arguments, dict(zip(named, static, strict=True)), constants, dtype)
    return made, shapes


def _requested(
    model: Model, spec: Spec, arguments: tuple[Argument, ...], static: dict[str, Any], constants: dict[str, Array],
    dtype: Any,
) -> Specialized:  # fmt: skip
    """The program of a Spec. Raises SpatialDynError if it has none."""
    request = SpecializeRequest(
        model=model, specs=(spec,), several=True, dtype=dtype_of(dtype), arguments=arguments, static=static,
        constants=dict(constants), parameter_names=(), parameters=(), output_places=None,
    )  # fmt: skip
    return check_program(of_request(request, specialize, ()), "C")


def _reads(k: Specialized, name: str) -> bool:
    """Whether a program reads an input."""
    first = 0
    for x in k._inputs:
        count = math.prod(x.shape)
        if x.name == name:
            return any(op.code == INPUT and first <= op.a < first + count for op in k.program.lines)
        first += count
    return False


def _at_the_beginning(spec: Spec) -> Spec:
    """A law that reads its present inputs instead of "q_begun" and the like, those at the beginning of the step."""
    early = begun_of(spec)
    if not early or tuple(spec.inputs) != spec.present:
        return spec
    kept = tuple(x for x in spec.present if x.name not in early)

    def recursion(rows: Any, *arrays: Any) -> None:
        work = 0 if spec.work is None else 1
        given = dict(zip((x.name for x in kept), arrays[work:], strict=False))
        values = [given[early.get(x.name, x.name)] for x in spec.present]
        spec.recursion(rows, *arrays[:work], *values, *arrays[work + len(kept) :])

    return replace(spec, recursion=recursion, inputs=kept)


def _function(name: str, k: Specialized, parts: Shapes | None) -> Function:
    """The function of a compiled program, with recorded answers."""
    request = k._request
    plain = exported(request, k._recorded, "c", "f_")
    inputs, outputs, program = dict(plain.inputs), dict(plain.outputs), plain.program
    if parts is not None:
        outputs = {f"{x}_next" if x in inputs else x: shape for x, shape in parts.items()}
        if CLOCK.name + RATE in outputs:  # 1: the caller's clock is the time
            program = _without(program, outputs, CLOCK.name + RATE)
    for x in (*inputs, *outputs):
        _check_array(x)
    units = {x.name: x.unit for x in request.arguments} | {spec.output.name: spec.output.unit for spec in request.specs}
    given, answers = _recorded(k)
    if parts is not None and len(answers[0]) != len(program.outputs):
        kept = [at for x, at in _places(parts).items() if x in outputs or f"{x}_next" in outputs]
        answers = np.concatenate([answers[:, at] for at in kept], 1)
    return Function(name, inputs, outputs, units, program, given, answers)


def _places(parts: Shapes) -> dict[str, slice]:
    """The place of each part in an output."""
    found, first = {}, 0
    for name, shape in parts.items():
        found[name] = slice(first, first + math.prod(shape))
        first += math.prod(shape)
    return found


def _without(program: Program, outputs: dict[str, tuple[int, ...]], name: str) -> Program:
    """A program without one of its parts, which is also removed from ``outputs``."""
    at = _places(outputs)[name]
    del outputs[name]
    return program.only(k for k in range(len(program.outputs)) if not at.start <= k < at.stop)


def _recorded(k: Specialized) -> tuple[Array, Array]:
    """States and answers of the compiled program in its own dtype. Raises SpatialDynError."""
    request, rng = k._request, np.random.default_rng(0)
    if not k._inputs:
        raise SpatialDynError("the result is a constant, expected a call of some input")
    given: list[Array] = []
    answers: list[Array] = []
    for _ in range(DRAWS):
        rows = [_drawn(request, x, rng).astype(k.dtype) for x in k._inputs]
        found = results_of_rows(k, rows)
        if found is not None and all(np.isfinite(x).all() for x in found):
            given.append(np.concatenate([x.ravel() for x in rows]))
            answers.append(np.concatenate([x.ravel() for x in found]))
        if len(given) == CASES:
            return np.stack(given), np.stack(answers)
    raise SpatialDynError(f"{DRAWS} random states have {len(given)} answers, expected {CASES} to check")


def _drawn(request: SpecializeRequest, x: Any, rng: np.random.Generator) -> Array:
    """A sample (1, entries) of an input."""
    known = {y.name: y for y in request.arguments}
    argument, count = known.get(x.name), math.prod(x.shape)
    if argument is not None and argument.shape == ("nq",) and count == request.model.nq:
        return np.asarray(random_configuration(request.model, rng, 1))
    if x.name == "dt":
        return np.full((1, 1), 2.0**-10)
    positive = argument is None or not argument.shape or argument.start is not None
    values = rng.uniform(0.25 if positive else -1.0, 1.0, (1, count))
    return np.asarray(values * 0.01 if argument is not None and argument.start is not None else values)


def call_of(name: str) -> Callable[..., Any] | str:
    """The public call or the law of a name. Raises SpatialDynError."""
    from ..calls.dynamics import calls

    if name in LAWS:
        return name
    if name == "step":
        return step
    if name in calls:
        return calls[name]
    raise SpatialDynError(f'calls have "{name}", expected calls such as rnea, "step", or of {", ".join(LAWS)}')
