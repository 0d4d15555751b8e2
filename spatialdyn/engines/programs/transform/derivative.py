"""Derivatives of programs: along a direction (jvp), and of a weighted sum of the results by every input (vjp).

Both walk the lines of a program once, forwards or backwards, and record the derivative of each beside it: at most some
three times its operations. Where a program selects, the derivative is that of the branch selected.

A sum such as x cos θ + y sin θ has the derivative y cos θ - x sin θ by θ, which a program that turns vectors holds as
well: where it does, one product takes the place of four. So it is with a turn of a quaternion, along which the columns
of its rotation matrix move by each other (``_Turned``): derivatives of all calls of arms, legs and floating trees then
take at most three times the operations.

Source: Griewank and Walther, Evaluating derivatives, 2nd ed. (2008), chapters 3.1 and 3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ....algebra import scalars
from ..record.operations import (
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
from ..record.program import Program
from ..record.replay import constant_of, folded
from ..record.tracer import Number, Tape

Partial = Callable[..., Sequence[Any]]
Slopes = dict[int, Any]  # derivatives of a line, by source
Turn = Mapping[int, Any]  # a further input that turns values of a program: their derivatives, by line of the tape


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


def jvp(
    tape: Tape, program: Program, inputs: Sequence[Any], tangents: Sequence[Any], turns: Sequence[Turn] = ()
) -> tuple[list[Any], list[Any]]:
    """The outputs of a program recorded on a tape, and their derivatives along the tangents of its inputs.

    tangents  one per input, then one per turn: Numbers, or floats, of which 0 costs nothing. The tangents of the inputs
              of a turn hold it too, for values that it does not name
    """
    lines: list[Any] = []
    moved: list[Any] = []
    walked = list(_replayed(tape, program, inputs, lines))
    turned = _Turned(tape, program, walked, turns)
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
                if (at, k) not in turned.spared:
                    total = total + by * rate
        for source, slope in turned.slopes.get(at, {}).items():
            k = source - len(walked)
            total = total + slope * (moved[source] if k < 0 else tangents[program.inputs + k])
        moved.append(total)
    return _outputs(program, lines), _outputs(program, moved)


def vjp(
    tape: Tape, program: Program, inputs: Sequence[Any], weights: Sequence[Any], turns: Sequence[Turn] = ()
) -> tuple[list[Any], list[Any]]:
    """The outputs of a program recorded on a tape, and the derivatives of Σ weight · output by each input and turn.

    weights  one per output: Numbers, or floats, of which 0 costs nothing

    What a turn names counts in the derivative by the turn, and no more in those by its inputs.
    """
    lines: list[Any] = []
    walked = list(_replayed(tape, program, inputs, lines))
    turned = _Turned(tape, program, walked, turns)
    adjoints: list[Any] = [0.0] * (len(lines) + len(turns))
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
        for source, slope in turned.slopes.get(at, {}).items():
            adjoints[source] = adjoints[source] + slope * weight
        for i, (k, share) in enumerate(zip(places, shares, strict=True)):
            if (at, i) in turned.spared:
                continue
            if k >= 0:
                adjoints[k] = adjoints[k] + share
            else:
                adjoints[-k - 1] = adjoints[-k - 1] - share
    return _outputs(program, lines), found + adjoints[len(lines) :]


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
    program.straight("a derivative")
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
    """A product of a sum, one of whose factors turns.

    place   its line, and which operand that factor is
    sign    of it in the sum
    slopes  derivatives of that factor, by source
    other   the other factor
    """

    place: tuple[int, int]
    sign: int
    slopes: Slopes
    other: Any


# of a sum or product, the operands that are added, and their signs; the others are multiplied
SUMMANDS = {MUL: (), ADD: ((0, 1), (1, 1)), SUB: ((0, 1), (1, -1)), FMA: ((2, 1),), FMS: ((2, -1),), FNMA: ((2, 1),)}


class _Turned:
    """Derivatives of sums that the program has as values.

    A source is the line of an angle, or for turn k the number of lines + k.

    slopes  of some lines, by source
    spared  the operands, as (line, which), whose part in derivatives those are
    """

    def __init__(self, tape: Tape, program: Program, walked: Sequence[Any], turns: Sequence[Turn]) -> None:
        """Of a program's lines as ``_replayed`` gives them."""
        self._tape, self._walked, self._turns = tape, walked, turns
        self.slopes: dict[int, Slopes] = {}
        self.spared: set[tuple[int, int]] = set()
        self._terms: dict[int, list[_Term]] = {}  # of each sum that is not part of another one alone
        self._mixed: set[int] = set()  # sums that depend on more than the sources of their terms
        self._whole: dict[int, Slopes] = {}  # of lines that depend on those sources alone
        uses = [0] * len(walked)
        for op in program.lines:
            for k in operands(op):
                uses[k] += 1
        for k, _ in program.outputs:
            uses[k] += 2
        for at, (code, places, given, x) in enumerate(walked):
            if not isinstance(x, Number) or self._turns_itself(at):
                continue
            if code in SUMMANDS:
                self._add_terms(at, uses)
            elif code in (SIN, COS):
                self._whole[at] = {places[0]: scalars.cos(given[0]) if code == SIN else -scalars.sin(given[0])}
        for at in list(self._terms):
            self._find(at)

    def _turns_itself(self, at: int) -> bool:
        """Whether a line has derivatives by turns; they are kept."""
        code, places, _, x = self._walked[at]
        found = {len(self._walked) + k: turn[x.line] for k, turn in enumerate(self._turns) if x.line in turn}
        if found:
            self._whole[at] = {k: -slope if x.minus else slope for k, slope in found.items()}
            if code != INPUT:
                self.slopes[at] = self._whole[at]
                self.spared.update((at, k) for k in range(len(places)))
        return bool(found)

    def _add_terms(self, at: int, uses: Sequence[int]) -> None:
        """The terms of a sum, with those of sums that it alone reads."""
        code, places, given, _ = self._walked[at]
        sign = -1 if code == FNMA else 1
        parts = [] if code in (ADD, SUB) else [(0, sign, given[1]), (1, sign, given[0])]
        terms = self._terms[at] = []
        for k, sign in SUMMANDS[code]:
            if uses[places[k]] == 1 and places[k] in self._terms:
                terms += [x._replace(sign=sign * x.sign) for x in self._terms.pop(places[k])]
                if places[k] in self._mixed:
                    self._mixed.add(at)
            else:
                parts.append((k, sign, 1.0))
        for k, sign, other in parts:
            slopes = self._find(places[k])
            if slopes is not None:
                terms.append(_Term((at, k), sign, slopes, other))
            elif constant_of(given[k]) is None:
                self._mixed.add(at)

    def _find(self, at: int) -> Slopes | None:
        """The slopes of a line that depends on their sources alone, else None; those of a sum are looked for once."""
        if at not in self.slopes and at in self._terms:
            left = self._terms[at]
            found: Slopes = {}
            for sources, those in _groups(left):
                known = {source: _known_slope(self._tape, source, those) for source in sources}
                free = all(x is not None for x in known.values())
                if free and (len(sources) == 1 or len(sources) < len(those)):
                    found |= known
                    self.spared.update(x.place for x in those)
                else:
                    self._mixed.add(at)
            self.slopes[at] = found
            if at not in self._mixed:
                self._whole[at] = found
        return self._whole.get(at)


def _groups(terms: Sequence[_Term]) -> list[tuple[set[int], list[_Term]]]:
    """Terms with their sources, by groups that share none."""
    groups: list[tuple[set[int], list[_Term]]] = []
    for x in terms:
        with_it = [g for g in groups if g[0] & set(x.slopes)]
        groups = [g for g in groups if not g[0] & set(x.slopes)]
        groups.append((set(x.slopes).union(*(g[0] for g in with_it)), [*(y for g in with_it for y in g[1]), x]))
    return groups


def _known_slope(tape: Tape, source: int, terms: Sequence[_Term]) -> Any:
    """The derivative of a sum by a source if the tape has it already, else None."""
    count = len(tape.lines)
    total: Any = 0.0
    for x in terms:
        if source in x.slopes:
            slope = x.slopes[source] * x.other
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
