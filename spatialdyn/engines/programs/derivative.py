"""Derivatives of programs: along a direction (jvp), and of a weighted sum of the results by every input (vjp).

Both walk the lines of a program once, forwards or backwards, and record the derivative of each beside it: at most some
three times its operations. Where a program selects, the derivative is that of the branch selected.

A sum such as x cos θ + y sin θ has the derivative y cos θ - x sin θ by θ, which a program that turns vectors holds as
well: where it does, one product takes the place of four (``_turned``).

Source: Griewank and Walther, Evaluating derivatives, 2nd ed. (2008), chapters 3.1 and 3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

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
    operands,
    signed,
)
from .program import Program
from .replay import folded
from .tracer import Number, Tape

Partial = Callable[..., Sequence[Any]]


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
    SIN: lambda x, a: (scalars.cos(a),),
    COS: lambda x, a: (-scalars.sin(a),),
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
    walked = list(_replayed(tape, program, inputs, lines))
    turned, spared = _turned(tape, program, walked)
    for at, (code, places, given, x) in enumerate(walked):
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
            for k, (by, rate) in enumerate(zip(PARTIALS[code](x, *given), rates, strict=True)):
                if (at, k) not in spared:
                    total = total + by * rate
        for angle, slope in turned.get(at, ()):
            total = total + slope * moved[angle]
        moved.append(total)
    return _outputs(program, lines), _outputs(program, moved)


def vjp(tape: Tape, program: Program, inputs: Sequence[Any], weights: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """The outputs of a program recorded on a tape, and the derivatives of Σ weight · output by each input.

    weights  one per output: Numbers, or floats, of which 0 costs nothing
    """
    lines: list[Any] = []
    walked = list(_replayed(tape, program, inputs, lines))
    turned, spared = _turned(tape, program, walked)
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
            shares = [by * weight for by in PARTIALS[code](x, *given)] if places else []
        for angle, slope in turned.get(at, ()):
            adjoints[angle] = adjoints[angle] + slope * weight
        for i, (k, share) in enumerate(zip(places, shares, strict=True)):
            if (at, i) in spared:
                continue
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


class _Term(NamedTuple):
    """A product of a sum that has sin θ or cos θ as a factor.

    place   its line, and which operand that factor is
    angle   the line of θ
    sign    of it in the sum
    factor  the other one
    turn    the code of the factor, and θ
    """

    place: tuple[int, int]
    angle: int
    sign: int
    factor: Any
    turn: tuple[int, Any]


# of a sum or product, the operands that are added, and their signs; the others are multiplied
SUMMANDS = {MUL: (), ADD: ((0, 1), (1, 1)), SUB: ((0, 1), (1, -1)), FMA: ((2, 1),), FMS: ((2, -1),), FNMA: ((2, 1),)}


def _turned(
    tape: Tape, program: Program, walked: Sequence[Any]
) -> tuple[dict[int, list[tuple[int, Any]]], set[tuple[int, int]]]:
    """Derivatives of sums by an angle that the program has as values.

    Returns (turned, spared): for some lines, the line of an angle and the value that is the line's derivative by it;
    and the operands, as (line, which), whose part in derivatives that is.
    """
    uses = [0] * len(walked)
    for op in program.lines:
        for k in operands(op):
            uses[k] += 1
    for k, _ in program.outputs:
        uses[k] += 2
    terms: dict[int, list[_Term]] = {}  # of each sum that is not part of another one alone
    for at, (code, places, given, _) in enumerate(walked):
        if code not in SUMMANDS:
            continue
        terms[at] = []
        for k, sign in SUMMANDS[code]:
            if uses[places[k]] == 1:
                terms[at] += [x._replace(sign=sign * x.sign) for x in terms.pop(places[k], ())]
        for k in (0, 1) if code not in (ADD, SUB) else ():
            turn, angles, angle, _ = walked[places[k]]
            if turn in (SIN, COS):
                term = _Term((at, k), angles[0], -1 if code == FNMA else 1, given[1 - k], (turn, *angle))
                terms[at].append(term)
    turned: dict[int, list[tuple[int, Any]]] = {}
    spared: set[tuple[int, int]] = set()
    for at, found in terms.items():
        for angle in dict.fromkeys(x.angle for x in found):
            those = [x for x in found if x.angle == angle]
            value = _known_slope(tape, those)
            if value is not None:
                turned.setdefault(at, []).append((angle, value))
                spared.update(x.place for x in those)
    return turned, spared


def _known_slope(tape: Tape, terms: Sequence[_Term]) -> Any:
    """The derivative of a sum by its angle if the tape has it already, else None."""
    count = len(tape.lines)
    total: Any = 0.0
    for x in terms:
        code, angle = x.turn
        slope = scalars.cos(angle) * x.factor if code == SIN else -scalars.sin(angle) * x.factor
        total = total + slope if x.sign > 0 else total - slope
    for new in tape.lines[count:]:
        total = None
        del tape.known[new]
    del tape.lines[count:]
    return total


def _selected(condition: Any, a: Any, b: Any) -> Any:
    if not isinstance(condition, Number):
        return a if condition > 0.0 else b
    return scalars.select(condition, a, b) if isinstance(a, Number) or isinstance(b, Number) or a != b else a


def _counts(x: Any) -> bool:
    return isinstance(x, Number) or x != 0.0


def _outputs(program: Program, lines: Sequence[Any]) -> list[Any]:
    return [-lines[k] if minus else lines[k] for k, minus in program.outputs]
