"""A Program as a C99 function for a chip: no allocation, no library, with its own sines and arctangents.

Differences from ``c_code``: numbers are double or float; products that the program fuses are fused if the processor
can, so that results are those of the lanes to the bit; sin, cos, exp and atan2 are the lanes' polynomials; loops and
branches are those of the program; and the function returns whether its results are valid.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..engines.programs.record.operations import (
    ABS,
    AGAIN,
    ATAN2,
    CARRIED,
    CONST,
    COS,
    EXP,
    FMA,
    FMS,
    FNMA,
    FORMS,
    INPUT,
    NEXT,
    REPEAT,
    SELECT,
    SIN,
    SQRT,
    UFP,
    Operation,
    signed,
)  # fmt: skip
from ..engines.programs.record.program import Program
from ..engines.programs.transform.source_code import Shapes, SourceText

ON_CHIP: dict[int, str] = {  # + - * / are as in ``c_code``
    FMA: "SD_FMA({a}, {b}, {c})", FMS: "SD_FMA({a}, {b}, -({c}))", FNMA: "SD_FMA(-({a}), {b}, {c})",
    SQRT: "SD_SQRT({a})", SIN: "sd_sin({a}, &bad)", COS: "sd_cos({a}, &bad)", EXP: "sd_exp({a})",
    ATAN2: "sd_atan2({a}, {b})", SELECT: "{a} > 0 ? {b} : {c}", ABS: "SD_ABS({a})", UFP: "sd_first_place({a})",
}  # fmt: skip
NEEDS = {SIN: "sin", COS: "cos", EXP: "exp", ATAN2: "atan2", UFP: "first_place"}  # functions that a file then contains
LOCAL = re.compile(r"x\d+|bad|k|sd_\w+|SD_\w+")  # names that the text uses itself, not allowed for arrays
TYPES = {8: "double", 4: "float"}  # by size in bytes


def type_of(dtype: np.dtype) -> str:
    """``double`` or ``float``."""
    return TYPES[dtype.itemsize]


def number(value: float, kind: str) -> str:
    """A number of the type ``kind`` in C: the shortest text that reads back to the same bits."""
    x: np.floating = np.float64(value)
    if kind == "float":
        with np.errstate(over="ignore"):
            x = np.float32(value)
    if not np.isfinite(x):
        return "SD_NAN" if np.isnan(x) else "-SD_INFINITY" if x < 0 else "SD_INFINITY"
    text = str(x)
    return (text if "." in text or "e" in text else f"{text}.0") + ("f" if kind == "float" else "")


class ChipText(SourceText):
    """The statements of a program for a chip."""

    def __init__(self, program: Program, inputs: Sequence[str], kind: str) -> None:
        """``inputs`` are texts of its inputs, ``kind`` is double or float."""
        super().__init__(program, inputs, {code: form.c for code, form in FORMS.items()} | ON_CHIP, "SD_INFINITY")
        self._kind = kind

    def _at(self, k: int) -> str:
        op = self._program.lines[k if k >= 0 else -k - 1]
        return number(op.value if k >= 0 else -op.value, self._kind) if op.code == CONST else super()._at(k)

    @cached_property
    def needs(self) -> set[str]:
        """The functions that it calls; "turn" computes sine and cosine together."""
        joined = {k + i for k in range(len(self._program.lines)) if self._are_one(k) for i in (0, 1)}
        single = {NEEDS[op.code] for k, op in enumerate(self._program.lines) if op.code in NEEDS and k not in joined}
        return single | {"turn"} if joined else single

    @cached_property
    def reads(self) -> set[int]:
        """The inputs that it reads."""
        return {op.a for op in self._program.lines if op.code == INPUT}

    def _are_one(self, k: int) -> bool:
        """Whether line k and the next are sine and cosine of one angle."""
        here, after = self._program.lines[k], self._program.lines[k + 1] if k + 1 < len(self._program.lines) else None
        return after is not None and {here.code, after.code} == {SIN, COS} and here.a == after.a

    def statements(self) -> list[str]:
        """The statements of the lines that compute, indented in their loops and branches."""
        made: list[str] = []
        depth, paired, lines, kind = 0, -1, self._program.lines, self._kind
        for k, op in enumerate(lines):
            if op.code in (INPUT, CONST) or k == paired:
                continue
            if op.code == AGAIN:
                depth -= 1
            if self._are_one(k):
                sine, paired = (k, k + 1) if op.code == SIN else (k + 1, k + 1)
                cosine = k + k + 1 - sine
                made.append(f"{'    ' * depth}{kind} x{k}, x{k + 1};")
                text = f"sd_turn({self._at(op.a)}, &x{sine}, &x{cosine}, &bad);"
            else:
                text = self._statement(k, op)
            made.append("    " * depth + text)
            depth += op.code == REPEAT
        return made

    def _statement(self, k: int, op: Operation) -> str:
        if op.code == AGAIN:
            return "}"
        if op.code == REPEAT:
            return f"{'if' if op.a in self._of_branches else 'while'} ({self._at(op.a)} > 0) {{"
        if op.code == NEXT:
            return f"x{op.a} = {self._at(op.b)};"
        if op.code == CARRIED:
            return f"{self._kind} x{k} = {self._at(op.a)};"
        return f"const {self._kind} x{k} = {self._line(op)};"

    @cached_property
    def _of_branches(self) -> set[int]:
        """The conditions, above 0 while a region runs, of regions whose body runs once: 0 after a pass."""
        lines, found = self._program.lines, set()
        for op in lines:
            if op.code == NEXT and lines[op.b].code == SELECT:
                above, after, _ = signed(lines[op.b])
                if above == op.a and after >= 0 and lines[after].code == CONST and lines[after].value == 0.0:
                    found.add(op.a)
        return found

    def results_kept(self, entries: Sequence[str]) -> list[str]:
        """``out[0] = -x12;`` for each output; inputs that are outputs are read before the first output is written."""
        ends, made, kept = self._program.outputs, [], {}
        for line, _ in ends:
            if self._program.lines[line].code == INPUT and line not in kept:
                kept[line] = f"x{line}"
                made.append(f"const {self._kind} x{line} = {self._at(line)};")
        for entry, (line, minus) in zip(entries, ends, strict=True):
            value = kept.get(line)
            text = self._at(-line - 1 if minus else line) if value is None else f"{'-' if minus else ''}{value}"
            made.append(f"{entry} = {text};")
        return made


def entries_of(arrays: Shapes) -> list[str]:
    """The texts of all entries of inputs in C order; a single number has no index."""
    return [
        f"{name}[{k}]" if shape else name for name, shape in arrays.items() for k in range(math.prod(shape))
    ]  # fmt: skip


def parameters_of(inputs: Shapes, outputs: Shapes, kind: str) -> str:
    """The parameters of a function: numbers by value, arrays with their sizes."""
    given = [
        f"const {kind} {name}[{math.prod(shape)}]" if shape else f"{kind} {name}" for name, shape in inputs.items()
    ]  # fmt: skip
    return ", ".join([*given, *(f"{kind} {name}[{math.prod(shape)}]" for name, shape in outputs.items())])


def function_text(name: str, program: Program, inputs: Shapes, outputs: Shapes, kind: str) -> str:
    """``int name(const double q[6], ..., double tau[6])``."""
    text = ChipText(program, entries_of(inputs), kind)
    first, unread = 0, []
    for array, shape in inputs.items():
        count = math.prod(shape)
        if not text.reads & set(range(first, first + count)):
            unread.append(array)
        first += count
    written = {array: shape or (1,) for array, shape in outputs.items()}
    lines = [
        "int bad = 0;",
        *(f"(void){array};" for array in unread),
        *text.statements(),
        *text.results_kept(entries_of(written)),
        *(f"bad |= sd_is_bad({array}, {math.prod(shape)});" for array, shape in written.items()),
        "return bad;",
    ]
    body = "\n".join(f"    {line}" for line in lines)
    return f"int {name}({parameters_of(inputs, outputs, kind)})\n{{\n{body}\n}}\n"
