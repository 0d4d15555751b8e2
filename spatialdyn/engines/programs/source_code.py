"""A Program as text that needs nothing of ours: a C99 function of one sample, a NumPy function of any batch.

Lines keep their numbers, so x12 is line 12 of ``Program.listing()``; inputs and constants stand where they are read.
Text is made of numbers, indices and the names that the caller gives, and of nothing that a robot's file says.
"""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Mapping, Sequence

from .tracer import (
    ADD,
    ATAN2,
    CONST,
    COS,
    DIV,
    FMA,
    FMS,
    FNMA,
    INPUT,
    MUL,
    NAMES,
    SELECT,
    SIN,
    SQRT,
    SUB,
    Operation,
    Program,
)

Shapes = Mapping[str, tuple[int, ...]]
TEXT = {
    ADD: "{a} + {b}",
    SUB: "{a} - {b}",
    MUL: "{a} * {b}",
    DIV: "{a} / {b}",
    FMA: "{a} * {b} + {c}",
    FMS: "{a} * {b} - {c}",
    FNMA: "{c} - {a} * {b}",
    SQRT: "sqrt({a})",
    SIN: "sin({a})",
    COS: "cos({a})",
    ATAN2: "atan2({a}, {b})",
}
CHOICE = {"c": "{a} > 0.0 ? {b} : {c}", "python": "where({a} > 0.0, {b}, {c})"}
FUNCTIONS = {SQRT: "sqrt", SIN: "sin", COS: "cos", ATAN2: "arctan2 as atan2", SELECT: "where"}


def c_code(name: str, program: Program, inputs: Shapes, outputs: Shapes) -> str:
    """``void name(const double *q, ..., double *out)``: arrays of one sample in C order, outputs last."""
    text = _Text(program, _entries(inputs, "{}[{}]"), CHOICE["c"])
    sizes = ", ".join(f"{x}{_shown(shape)}" for x, shape in inputs.items())
    made = ", ".join(f"{x}{_shown(shape)}" for x, shape in outputs.items())
    parameters = [*(f"const double *{x}" for x in inputs), *(f"double *{x}" for x in outputs)]
    return "\n".join(
        [
            "#include <math.h>",
            "",
            f"/* {sizes} -> {made} */",
            f"void {name}({', '.join(parameters)})",
            "{",
            *(f"    const double {line};" for line in text.lines()),
            *(f"    {line};" for line in text.results(_entries(outputs, "{}[{}]"))),
            "}",
            "",
        ]
    )


def python_code(name: str, program: Program, inputs: Shapes, outputs: Shapes) -> str:
    """``def name(q, ...)`` with NumPy: arrays of any leading batch shape, broadcast; returns the output or outputs."""
    text = _Text(program, _entries(inputs, "{}[..., {}]"), CHOICE["python"])
    used = {op.code for op in program.lines}
    functions = ", ".join(sorted(FUNCTIONS[code] for code in used & set(FUNCTIONS)))
    lines = ["import numpy as np"] + [f"from numpy import {functions}"] * bool(functions) + ["", ""]
    lines.append(f"def {name}({', '.join(inputs)}):")
    shapes = []
    for x, shape in inputs.items():
        rank = len(shape)
        lead = f"{x}.shape[:-{rank}]" if rank else f"{x}.shape"
        lines += [f"    {x} = np.asarray({x}, dtype=float)", f"    {x} = {x}.reshape({lead} + ({math.prod(shape)},))"]
        shapes.append(f"{x}.shape[:-1]")
    lines.append(f"    batch = np.broadcast_shapes({', '.join(shapes)})")
    lines += [f"    {line}" for line in text.lines()]
    lines += [f"    {x} = np.empty(batch + ({math.prod(shape)},))" for x, shape in outputs.items()]
    lines += [f"    {line}" for line in text.results(_entries(outputs, "{}[..., {}]"))]
    made = ", ".join(f"{x}.reshape(batch + {shape})" for x, shape in outputs.items())
    return "\n".join([*lines, f"    return {made}"]) + "\n"


def _entries(arrays: Shapes, form: str) -> list[str]:
    """Text of the entries of arrays, one array after the other in C order."""
    return [form.format(name, k) for name, shape in arrays.items() for k in range(math.prod(shape))]


def _shown(shape: Sequence[int]) -> str:
    return "".join(f"[{n}]" for n in shape or (1,))


class _Text:
    """The lines of a program in words that C and Python share."""

    def __init__(self, program: Program, inputs: Sequence[str], choice: str) -> None:
        self._program, self._inputs = program, inputs
        self._forms: Mapping[int, str] = TEXT | {SELECT: choice}

    def _at(self, k: int) -> str:
        """An operand: its name, its entry of an input or its value, with its sign."""
        if k < 0:
            return f"-{self._at(-k - 1)}"
        op = self._program.lines[k]
        if op.code == CONST:
            return repr(op.value)
        return self._inputs[op.a] if op.code == INPUT else f"x{k}"

    def _line(self, op: Operation) -> str:
        if op.code not in self._forms:
            raise NotImplementedError(f"operation {NAMES[op.code]} has no text")
        return self._forms[op.code].format(a=self._at(op.a), b=self._at(op.b), c=self._at(op.c))

    def lines(self) -> list[str]:
        """``x12 = x3 * x4`` of each line that computes."""
        computed = ((k, op) for k, op in enumerate(self._program.lines) if op.code not in (INPUT, CONST))
        return [f"x{k} = {self._line(op)}" for k, op in computed]

    def results(self, entries: Sequence[str]) -> list[str]:
        """``out[0] = -x12`` of each output."""
        ends = zip(entries, self._program.outputs, strict=True)
        return [f"{entry} = {'-' if minus else ''}{self._at(k)}" for entry, (k, minus) in ends]


C_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while alignas alignof bool
constexpr false nullptr static_assert thread_local true typeof typeof_unqual asm main double_t float_t
HUGE_VAL HUGE_VALF HUGE_VALL INFINITY NAN FP_FAST_FMA FP_ILOGB0 FP_ILOGBNAN FP_INFINITE FP_NAN FP_NORMAL FP_SUBNORMAL
FP_ZERO MATH_ERRNO MATH_ERREXCEPT math_errhandling fpclassify isfinite isgreater isgreaterequal isinf isless islessequal
islessgreater isnan isnormal isunordered signbit
"""  # keywords up to C23, and what <math.h> declares
C_FUNCTIONS = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim floor fma fmax fmin
fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround modf nan nearbyint nextafter
nexttoward pow remainder remquo rint round scalbln scalbn sin sinh sqrt tan tanh tgamma trunc gamma j0 j1 jn y0 y1 yn
"""  # each also for float and for long double
RESERVED: Mapping[str, frozenset[str]] = {  # names that no function of ours can have
    "c": frozenset([*C_WORDS.split(), *(f + kind for f in C_FUNCTIONS.split() for kind in ("", "f", "l"))]),
    "python": frozenset([*keyword.kwlist, "np", "float", *(f.split()[-1] for f in FUNCTIONS.values())]),
}
Printer = Callable[[str, Program, Shapes, Shapes], str]
PRINTERS: Mapping[str, Printer] = {"c": c_code, "python": python_code}
