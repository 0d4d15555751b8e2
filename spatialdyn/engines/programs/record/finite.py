"""Checks of finite numbers that a program's samples need not have, since others reject the same samples."""

from __future__ import annotations

import numpy as np

from .kernel_layout import KernelLayout
from .operations import ADD, CONST, COS, FMA, FMS, FNMA, FORMS, INPUT, MUL, SIN, SUB, operands
from .program import Program

LARGE = 1e30  # far below the largest number of float32
SINE = 1.0 + 2.0**-20  # most that a sine comes to by rounding
FUSED = (FMA, FMS, FNMA)
PROPAGATING = (ADD, SUB, MUL, *FUSED)  # operations whose result is not finite if an operand is not


def bounded(program: Program) -> bool:
    """Whether all results are below LARGE whatever the inputs: only sines and cosines read these, as of crba on hinges.

    The results are sums and products of sines, cosines and constants, which need no check.
    """
    codes = program.table[:, 0]
    arithmetic = np.isin(codes, PROPAGATING)
    read = program.table[arithmetic, 1:]
    read = np.where(read < 0, -read - 1, read)
    read[~np.isin(codes[arithmetic], FUSED), 2] = read[~np.isin(codes[arithmetic], FUSED), 0]
    results = [line for line, _ in program.outputs]
    known = arithmetic | np.isin(codes, (INPUT, CONST, SIN, COS))
    if not known.all() or (codes[read] == INPUT).any() or (codes[results] == INPUT).any():
        return False
    sizes: list[float] = []
    for op in program.lines:
        of = [sizes[k] for k in operands(op)]
        if op.code in (SIN, COS):
            size = SINE
        elif op.code in FUSED:
            size = of[0] * of[1] + of[2]
        elif op.code == MUL:
            size = of[0] * of[1]
        else:
            size = abs(op.value) if op.code == CONST else sum(of)
        if not size < LARGE:
            return False
        sizes.append(size)
    return True


def implied(program: Program, layout: KernelLayout) -> tuple[frozenset[int], frozenset[int]]:
    """The inputs, and the lines of results, that need no check: where one is not finite, a checked number is not.

    A sum or product is not finite if an operand is not: infinity less infinity and 0 times infinity are NaN. So the
    torque of a joint needs no check if that of the joint before it is the sum of it and more.
    """
    lines = program.lines
    within = {k for region in program.regions for k in range(region.head, region.end + 1)}
    results = {program.outputs[place][0] for places in layout.checked for place in places}
    checked = frozenset() if bounded(program) else results
    read = bytearray(len(lines))  # whether a line is an operand of one that is checked, or of such an operand, ...
    for k in range(len(lines) - 1, -1, -1):
        op = lines[k]
        form = FORMS.get(op.code)
        if k in within or not form:
            continue
        if form.angle or ((read[k] or k in checked) and op.code in PROPAGATING):
            for operand in operands(op):
                read[operand] = 1
    inputs = (k for k, op in enumerate(lines) if op.code == INPUT and (read[k] or k in checked))
    return frozenset(lines[k].a for k in inputs), frozenset(k for k in checked if read[k] and k not in within)
