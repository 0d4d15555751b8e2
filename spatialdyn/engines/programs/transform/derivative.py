"""Derivatives of programs: along a direction (jvp), and of a weighted sum of the results by every input (vjp).

Both walk the lines of a program once, forwards or backwards, and record the derivative of each line: at most about
three times the operations of the program. Where a program selects, the derivative is that of the selected branch.

A sum such as x cos θ + y sin θ has the derivative y cos θ - x sin θ by θ. A program that rotates vectors often has this
sum as a value too; then one product replaces four. The same holds for a turn of a quaternion, along which the
derivative of a column of the rotation matrix is another column (``_Turned``). With this, derivatives of all calls for
arms, legs and floating trees take at most three times the operations.

Source: Griewank and Walther, Evaluating derivatives, 2nd ed. (2008), chapters 3.1 and 3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

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
Slopes = dict[int, Any]  # {source: derivative of a line by it}
Turn = Mapping[int, Any]  # {line of the tape: derivative} by a further input that turns values of a program


def _angle(x: Any, a: Any, b: Any) -> Sequence[Any]:
    inverse = 1.0 / (a * a + b * b)
    return b * inverse, -a * inverse


# The derivatives of each operation's value x by its operands; for SELECT see ``_selected``. The derivative of x = a / b
# is written (a' - x b') / b: near θ = 0 that of sin(θ)/θ is then 0, whereas a'/b - x/b b' would be rounding over θ
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

    tangents  one per input, then one per turn: Numbers or floats; a float of 0 costs nothing. The tangents of the
              inputs that a turn changes include the turn, for values that the turn does not name
    """
    values, (rates,) = jvps(tape, program, inputs, [tangents], turns)
    return values, rates


def jvps(
    tape: Tape, program: Program, inputs: Sequence[Any], directions: Sequence[Sequence[Any]], turns: Sequence[Turn] = ()
) -> tuple[list[Any], list[list[Any]]]:
    """``jvp`` along several directions, each with its own tangents."""
    lines: list[Any] = []
    walked = list(_replayed(tape, program, inputs, lines))
    turned = _Turned(tape, program, walked, turns)
    return _outputs(program, lines), [_rates(program, walked, turned, tangents) for tangents in directions]


def _rates(program: Program, walked: Sequence[Any], turned: _Turned, tangents: Sequence[Any]) -> list[Any]:
    """The derivatives of the outputs along one direction."""
    moved: list[Any] = []
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
    return _outputs(program, moved)


def vjp(
    tape: Tape, program: Program, inputs: Sequence[Any], weights: Sequence[Any], turns: Sequence[Turn] = ()
) -> tuple[list[Any], list[Any]]:
    """The outputs of a program recorded on a tape, and the derivatives of Σ weight · output by each input and turn.

    weights  one per output: Numbers or floats; a float of 0 costs nothing

    Values that a turn names count in the derivative by the turn, and not in the derivatives by the turn's inputs.
    """
    values, (found,) = vjps(tape, program, inputs, [weights], turns)
    return values, found


def vjps(
    tape: Tape, program: Program, inputs: Sequence[Any], sums: Sequence[Sequence[Any]], turns: Sequence[Turn] = ()
) -> tuple[list[Any], list[list[Any]]]:
    """``vjp`` of several sums, each with its own weights."""
    lines: list[Any] = []
    walked = list(_replayed(tape, program, inputs, lines))
    turned = _Turned(tape, program, walked, turns)
    return _outputs(program, lines), [_slopes(program, walked, turned, weights, len(turns)) for weights in sums]


def _slopes(program: Program, walked: Sequence[Any], turned: _Turned, weights: Sequence[Any], turns: int) -> list[Any]:
    """The derivatives of one sum by each input and turn."""
    adjoints: list[Any] = [0.0] * (len(walked) + turns)
    for (at, minus), weight in zip(program.outputs, weights, strict=True):
        adjoints[at] = adjoints[at] + (-weight if minus else weight)
    found: list[Any] = [0.0] * program.inputs
    for at in range(len(walked) - 1, -1, -1):
        code, places, given, x = walked[at]
        weight = adjoints[at]
        if not _counts(weight):  # no weighted output depends on this line
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
    return found + adjoints[len(walked) :]


def jacobian(program: Program) -> Program:
    """The program of the derivatives of each output by each input, row by row.

    They are derivatives along each input (jvp) or of each output (vjp), whichever are fewer.
    """
    tape, n, m = Tape(), program.inputs, len(program.outputs)
    inputs, units = [tape.input(k) for k in range(n)], np.eye(min(n, m)).tolist()
    if n <= m:
        columns = jvps(tape, program, inputs, units)[1]
        return Program(tape, [column[k] for k in range(m) for column in columns], n)
    return Program(tape, [x for row in vjps(tape, program, inputs, units)[1] for x in row], n)


def hessian(weighted: Program, n: int) -> Program:
    """The program of the second derivatives of a sum by its first n inputs, row by row.

    weighted  the program of the first derivatives by these inputs

    Each entry is recorded once for both triangles: it is the derivative along the input that comes first.
    """
    tape = Tape()
    inputs, units = [tape.input(k) for k in range(weighted.inputs)], np.eye(n, weighted.inputs).tolist()
    columns = jvps(tape, weighted, inputs, units)[1]
    entries = [columns[min(i, j)][max(i, j)] for i in range(n) for j in range(n)]
    return Program(tape, entries, weighted.inputs)


def _replayed(tape: Tape, program: Program, inputs: Sequence[Any], lines: list[Any]) -> Any:
    """Record each line again, as (code, operands as places, operands, value); values are appended to ``lines``."""
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
    """A product in a sum, one of whose factors turns.

    place   line of the product, and which operand the turning factor is
    sign    sign of the product in the sum
    slopes  derivatives of the turning factor, by source
    other   the other factor
    """

    place: tuple[int, int]
    sign: int
    slopes: Slopes
    other: Any


# {operation: operands that are added, with their signs}; the other operands are multiplied
SUMMANDS = {MUL: (), ADD: ((0, 1), (1, 1)), SUB: ((0, 1), (1, -1)), FMA: ((2, 1),), FMS: ((2, -1),), FNMA: ((2, 1),)}


class _Turned:
    """Derivatives of sums, where the program already has them as values.

    A source is the line of an angle, or for turn k the number of lines + k.

    slopes  derivatives of some lines, by source
    spared  operands, as (line, which), whose part in derivatives these slopes include
    """

    def __init__(self, tape: Tape, program: Program, walked: Sequence[Any], turns: Sequence[Turn]) -> None:
        """Find such derivatives among a program's lines, which come from ``_replayed``."""
        self._tape, self._walked, self._turns = tape, walked, turns
        self.slopes: dict[int, Slopes] = {}
        self.spared: set[tuple[int, int]] = set()
        self._terms: dict[int, list[_Term]] = {}  # {sum: its terms} of sums that are not merged into their only reader
        self._mixed: set[int] = set()  # sums that depend on more than the sources of their terms
        self._whole: dict[int, Slopes] = {}  # slopes of lines that depend only on the sources of their terms
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
        """Whether a line has derivatives by turns; keeps these derivatives."""
        code, places, _, x = self._walked[at]
        found = {len(self._walked) + k: turn[x.line] for k, turn in enumerate(self._turns) if x.line in turn}
        if found:
            self._whole[at] = {k: -slope if x.minus else slope for k, slope in found.items()}
            if code != INPUT:
                self.slopes[at] = self._whole[at]
                self.spared.update((at, k) for k in range(len(places)))
        return bool(found)

    def _add_terms(self, at: int, uses: Sequence[int]) -> None:
        """Add the terms of a sum, with the terms of sums that only this sum reads."""
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
        """The slopes of a line that depends only on their sources, else None; a sum is searched once."""
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
    """Groups of terms with their sources; different groups share no source."""
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
