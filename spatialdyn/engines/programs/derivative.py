"""Derivatives of programs: along a direction (jvp), and of a weighted sum of the results by every input (vjp).

Both walk the lines of a program once, forwards or backwards, and record the derivative of each beside it: at most some
three times its operations. Where a program selects, the derivative is that of the branch selected.

Source: Griewank and Walther, Evaluating derivatives, 2nd ed. (2008), chapters 3.1 and 3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ...algebra import scalars
from .operations import (
    ABS,
    ADD,
    ATAN2,
    CONST,
    COS,
    DIV,
    EXP,
    FMA,
    FMS,
    FNMA,
    INPUT,
    MUL,
    SELECT,
    SIN,
    SQRT,
    SUB,
    UFP,
    signed,
)
from .program import Program
from .replay import folded
from .tracer import Number, Tape

Partial = Callable[..., Sequence[Any]]


def _turned(x: Any, a: Any, cosine: bool) -> Any:
    """The derivative of cos or sin."""
    return -scalars.sin(a) if cosine else scalars.cos(a)


def _angle(x: Any, a: Any, b: Any) -> Sequence[Any]:
    inverse = 1.0 / (a * a + b * b)
    return b * inverse, -a * inverse


# The derivatives of each operation's value x by its operands; those of SELECT are ``_selected``. Those of x = a / b are
# written (a' - x b') / b: near θ = 0 the derivative of sin(θ)/θ is then 0, where a'/b - x/b b' would be rounding over θ
PARTIALS: dict[int, Partial] = {
    ADD: lambda x, a, b: (1.0, 1.0),
    SUB: lambda x, a, b: (1.0, -1.0),
    MUL: lambda x, a, b: (b, a),
    FMA: lambda x, a, b, c: (b, a, 1.0),
    FMS: lambda x, a, b, c: (b, a, -1.0),
    FNMA: lambda x, a, b, c: (-b, -a, 1.0),
    SQRT: lambda x, a: (0.5 / x,),
    SIN: lambda x, a: (_turned(x, a, cosine=False),),
    COS: lambda x, a: (_turned(x, a, cosine=True),),
    EXP: lambda x, a: (x,),
    ATAN2: _angle,
    ABS: lambda x, a: (scalars.select(a, 1.0, -1.0),),
    UFP: lambda x, a: (0.0,),
}


def jvp(tape: Tape, program: Program, inputs: Sequence[Any], tangents: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """The outputs of a program recorded on a tape, and their derivatives along the tangents of its inputs.

    tangents  one per input: Numbers, or floats, of which 0 costs nothing
    """
    lines: list[Any] = []
    moved: list[Any] = []
    for code, places, given, x in _replayed(tape, program, inputs, lines):
        if code == INPUT:
            moved.append(tangents[places[0]])
            continue
        rates = [moved[k] if k >= 0 else -moved[-k - 1] for k in places]
        if code == SELECT:
            moved.append(_selected(given[0], *rates[1:]))
            continue
        total: Any = 0.0
        if not any(map(_counts, rates)):
            pass
        elif code == DIV:
            total = (rates[0] - x * rates[1]) * (1.0 / given[1])
        else:
            for partial, rate in zip(PARTIALS[code](x, *given), rates, strict=True):
                total = total + partial * rate
        moved.append(total)
    return _outputs(program, lines), _outputs(program, moved)


def vjp(tape: Tape, program: Program, inputs: Sequence[Any], weights: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """The outputs of a program recorded on a tape, and the derivatives of Σ weight · output by each input.

    weights  one per output: Numbers, or floats, of which 0 costs nothing
    """
    lines: list[Any] = []
    walked = list(_replayed(tape, program, inputs, lines))
    adjoints: list[Any] = [0.0] * len(lines)
    for (at, minus), weight in zip(program.outputs, weights, strict=True):
        adjoints[at] = adjoints[at] + (-weight if minus else weight)
    found: list[Any] = [0.0] * len(inputs)
    for at in range(len(lines) - 1, -1, -1):
        code, places, given, x = walked[at]
        weight = adjoints[at]
        if not _counts(weight):  # nothing depends on it
            continue
        if code == INPUT:
            found[places[0]] = found[places[0]] + weight
            continue
        if code == SELECT:
            shares = [0.0, _selected(given[0], weight, 0.0), _selected(given[0], 0.0, weight)]
        elif code == DIV:
            share = weight * (1.0 / given[1])
            shares = [share, -x * share]
        else:
            shares = [partial * weight for partial in PARTIALS[code](x, *given)] if places else []
        for k, share in zip(places, shares, strict=True):
            if k >= 0:
                adjoints[k] = adjoints[k] + share
            else:
                adjoints[-k - 1] = adjoints[-k - 1] - share
    return _outputs(program, lines), found


def jacobian(program: Program) -> Program:
    """The program of the derivatives of each output by each input, row by row: along each input or of each output,
    whichever are fewer.
    """
    tape, n, m = Tape(), program.inputs, len(program.outputs)
    inputs = [tape.input(k) for k in range(n)]
    units = [[float(k == at) for k in range(max(n, m))] for at in range(max(n, m))]
    if n <= m:
        columns = [jvp(tape, program, inputs, units[k][:n])[1] for k in range(n)]
        entries = [column[k] for k in range(m) for column in columns]
    else:
        entries = [x for k in range(m) for x in vjp(tape, program, inputs, units[k][:m])[1]]
    return Program(tape, entries, n)


def _replayed(tape: Tape, program: Program, inputs: Sequence[Any], lines: list[Any]) -> Any:
    """(code, operands as places, operands, value) of each line, recorded again; values are appended to ``lines``."""
    for op in program.lines:
        places: Sequence[int] = signed(op)
        given = [lines[k] if k >= 0 else -lines[-k - 1] for k in places]
        if op.code == INPUT:
            places, x = (op.a,), inputs[op.a]
        elif op.code == CONST:
            x = op.value
        else:
            x = folded(tape, op.code, given)
        lines.append(x)
        yield op.code, places, given, x


def _selected(condition: Any, a: Any, b: Any) -> Any:
    if not isinstance(condition, Number):
        return a if condition > 0.0 else b
    return scalars.select(condition, a, b) if isinstance(a, Number) or isinstance(b, Number) or a != b else a


def _counts(x: Any) -> bool:
    return isinstance(x, Number) or x != 0.0


def _outputs(program: Program, lines: Sequence[Any]) -> list[Any]:
    return [-lines[k] if minus else lines[k] for k, minus in program.outputs]
