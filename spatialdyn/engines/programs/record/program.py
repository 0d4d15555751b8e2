"""Programs: the live operations of a tape for one model, in a straight line except for regions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import SpatialDynError
from . import regions
from .operations import (
    ADD,
    AGAIN,
    CARRIED,
    CONST,
    FMA,
    FMS,
    FNMA,
    FORMS,
    INPUT,
    MUL,
    NEXT,
    REPEAT,
    SUB,
    Operation,
    arities,
    operands,
    signed,
)
from .tracer import Line, Tape


class Program:
    """The operations of one traced run.

    lines    operations in order; operands are lines, or -line - 1 for a negated one where the operation allows it
    outputs  (line, whether negated) of each output
    inputs   number of inputs
    errors   by how much constants may be off, see ``Tape``; a line that is a constant has its index in ``c``
    """

    def __init__(self, tape: Tape, outputs: Sequence[Any], inputs: int, fuse: bool = True) -> None:
        """The lines of a tape that the outputs need."""
        marked = [tape.number(x) for x in outputs]
        self.lines: list[Operation]
        self.lines, roots = _eliminate_dead(tape.lines, [x.line for x in marked], fuse, tape.looped)
        self.outputs: list[tuple[int, bool]] = [(r, x.minus) for r, x in zip(roots, marked, strict=True)]
        self.inputs = inputs
        self.errors = None if tape.errors is None else tuple(tape.errors)

    def only(self, outputs: Iterable[int]) -> Program:
        """The program of some of its outputs, by their indices."""
        chosen = [self.outputs[k] for k in outputs]
        made = Program.__new__(Program)
        made.inputs, made.errors = self.inputs, self.errors
        made.lines, roots = _eliminate_dead(self.lines, [line for line, _ in chosen], False, bool(self.regions))
        made.outputs = [(line, minus) for line, (_, minus) in zip(roots, chosen, strict=True)]
        return made

    @cached_property
    def regions(self) -> list[regions.Region]:
        """The regions; an inner region comes before the one around it."""
        return regions.find(self.lines) if (self.table[:, 0] == REPEAT).any() else []

    def straight(self, what: str) -> None:
        """Raise SpatialDynError if there are regions; ``what`` names the form of code that cannot have them."""
        if self.regions:
            raise SpatialDynError(f"{what} got a program with loops or branches, expected one in a straight line")

    @cached_property
    def table(self) -> NDArray[np.int64]:
        """(lines, 4): the code and the operands of each line."""
        return self._numbers[:, :4].astype(np.int64)

    @cached_property
    def constants(self) -> NDArray[np.float64]:
        """The values of the lines that are constants, in order."""
        values: NDArray[np.float64] = self._numbers[self.table[:, 0] == CONST, 4]
        return values

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        return np.fromiter(chain.from_iterable(self.lines), np.float64, 5 * len(self.lines)).reshape(-1, 5)

    @property
    def operations(self) -> dict[str, int]:
        """Counts of mul, add, div, sqrt, sincos, exp ... (a fused multiply-add is one of each), and the depth."""
        count = dict.fromkeys((what for form in FORMS.values() for what in form.counts), 0)
        depth: list[int] = []
        angles = set()
        for op in self.lines:
            depth.append(max((depth[k] for k in operands(op)), default=-1) + 1)
            form = FORMS.get(op.code)
            if form and not (form.angle and op.a in angles):  # sin and cos of an angle count once
                for what in form.counts:
                    count[what] += 1
                if form.angle:
                    angles.add(op.a)
        return {**count, "depth": max(depth, default=0)}

    def listing(self) -> str:
        """The program as text, one operation per line."""
        text = []
        for k, op in enumerate(self.lines):
            if op.code == INPUT:
                what = f"input[{op.a}]"
            elif op.code == CONST:
                what = repr(op.value)
            elif op.code == CARRIED:
                what = f"carried({'x' if op.a >= 0 else '-x'}{op.a if op.a >= 0 else -op.a - 1})"
            elif op.code not in FORMS:
                a, b = f"x{op.a}", f"x{op.b}"
                text.append({REPEAT: f"x{k}: repeat while {a} > 0", NEXT: f"{a} = {b}", AGAIN: f"again {a}"}[op.code])
                continue
            else:
                form, names = FORMS[op.code], [f"x{i}" if i >= 0 else f"-x{-i - 1}" for i in signed(op)]
                sign = not form.name.isalnum()
                what = f" {form.name} ".join(names) if sign else f"{form.name}({', '.join(names)})"
            text.append(f"x{k} = {what}")
        text += [f"output[{k}] = {'-' if minus else ''}x{line}" for k, (line, minus) in enumerate(self.outputs)]
        return "\n".join(text)

    def run(self, inputs: Sequence[Any] | NDArray[Any]) -> list[Any]:
        """Run the program on NumPy arrays or floats, one per input; the oracle of compiled programs."""
        x: list[Any] = [inputs[op.a] if op.code == INPUT else op.value for op in self.lines]
        ends = {region.head: region.end for region in self.regions}

        def at(k: int) -> Any:
            return x[k] if k >= 0 else -x[-k - 1]

        with np.errstate(all="ignore"):
            k = 0
            while k < len(x):
                op = self.lines[k]
                if op.code in FORMS:
                    x[k] = FORMS[op.code].numpy(*map(at, signed(op)))
                elif op.code == CARRIED:
                    x[k] = at(op.a)
                elif op.code == NEXT:
                    x[op.a] = x[op.b]
                elif op.code == AGAIN:
                    k = op.a - 1
                elif op.code == REPEAT and not np.any(x[op.a] > 0.0):
                    k = ends[k]
                k += 1
            return [-x[k] if minus else x[k] for k, minus in self.outputs]


def _eliminate_dead(
    lines: Sequence[Line], roots: Sequence[int], fuse: bool, looped: bool
) -> tuple[list[Operation], list[int]]:
    """Dead-code elimination: returns the lines that the roots need, renumbered in the same order, and the roots.

    fuse    whether to fuse products that only one sum reads
    looped  whether there are regions
    """
    uses = regions.uses(lines, roots) if looped else _uses(lines, roots)
    fused = _fuse_products(lines, uses) if fuse else {}
    for _, product, _ in fused.values():
        uses[product] = 0
    arity_of, number = arities(), [0] * len(uses)
    kept: list[Operation] = []
    for k, used in enumerate(uses):
        if not used:
            continue
        number[k] = len(kept)
        code, a, b, c, value = lines[k]
        if k in fused:
            code, product, c = fused[k]
            _, a, b, _, _ = lines[product]
        arity = arity_of[code]
        if arity:
            a = number[a] if a >= 0 else -number[-a - 1] - 1
            if arity > 1:
                b = number[b] if b >= 0 else -number[-b - 1] - 1
                if arity > 2:
                    c = number[c] if c >= 0 else -number[-c - 1] - 1
        kept.append(Operation(code, a, b, c, value))
    return kept, [number[k] for k in roots]


def _uses(lines: Sequence[Line], roots: Sequence[int]) -> list[int]:
    """How often each line is read: by lines that the roots need, and as a root."""
    count = max(roots, default=-1) + 1
    arity_of, uses = arities(), [0] * count
    for k in roots:
        uses[k] += 1
    for k in range(count - 1, -1, -1):  # a line reads earlier lines, so its readers come first here
        if uses[k]:
            code, a, b, c, _ = lines[k]
            arity = arity_of[code]
            if arity:
                uses[a if a >= 0 else -a - 1] += 1
                if arity > 1:
                    uses[b if b >= 0 else -b - 1] += 1
                    if arity > 2:
                        uses[c if c >= 0 else -c - 1] += 1
    return uses


def _fuse_products(lines: Sequence[Line], uses: Sequence[int]) -> dict[int, tuple[int, int, int]]:
    """Sums with a product that only they read and that is fused into them, as (fused code, product, other term).

    Fusion is decided here so that every machine rounds alike.
    """
    made: dict[int, tuple[int, int, int]] = {}
    for k, used in enumerate(uses):
        code, a, b, _, _ = lines[k]
        if not used or code not in (ADD, SUB) or a == b:
            continue
        # fuse the later product: the earlier one is ready by then
        for product, other in ((b, a), (a, b)) if a < b else ((a, b), (b, a)):
            if uses[product] == 1 and lines[product][0] == MUL:
                made[k] = (FMA if code == ADD else FMS if product == a else FNMA, product, other)
                break
    return made
