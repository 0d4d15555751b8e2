"""The structure of a program, which is compiled, and its numbers, which the machine code reads from memory.

Two models that differ only in masses, lengths or payloads mostly have the same structure and share the machine code.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .finite import bounded
from .kernel_layout import KernelLayout
from .operations import CONST
from .program import Program


class Numbers:
    """The numbers of a program and its layout, and their places among ``values``.

    of_line   {line that is a constant: place of its value}
    of_pivot  place of the value that each pivot must exceed
    most, least, squares  if the layout has a range: places of the squares of its norms, and for each output array the
              place of the sum of squares of its constant results
    """

    def __init__(self, program: Program, layout: KernelLayout) -> None:
        """Of a program and its layout."""
        constants = np.flatnonzero(program.table[:, 0] == CONST).tolist()
        self.of_line = {line: place for place, line in enumerate(constants)}
        self.of_pivot = range(len(constants), len(constants) + len(layout.pivots))
        values = [*program.constants.tolist(), *(least for _, least in layout.pivots)]
        self.most, self.least = len(values), len(values) + 1
        self.squares = range(len(values) + 2, len(values) + 2 + len(layout.outputs))
        if layout.range is not None:
            values += [layout.range.most**2, layout.range.least**2]
            for places in layout.outputs:
                ends = [program.lines[program.outputs[place][0]] for place in places]
                values.append(sum(line.value**2 for line in ends if line.code == CONST))
        self._values = np.array(values or [0.0])

    def values(self, dtype: Any) -> NDArray[Any]:
        """All numbers in a dtype, aligned to it.

        A number beyond float32's range becomes infinite; samples that use it are recomputed in float64.
        """
        with np.errstate(over="ignore"):
            return self._values.astype(dtype)


def content(program: Program, layout: KernelLayout) -> str:
    """A digest of a program with its numbers."""
    values = Numbers(program, layout).values(np.float64)
    return hashlib.sha256(digest(program, layout).encode() + values.tobytes()).hexdigest()


def digest(program: Program, layout: KernelLayout) -> str:
    """A digest of all that the machine code of a program depends on, without its numbers."""
    wide = layout.range
    pivots = [place for place, _ in layout.pivots]
    checks = (layout.units, pivots, layout.norms, wide and ("range", wide.driving), layout.bounds, layout.common)
    found = hashlib.sha256(program.table.astype(np.int32).tobytes())
    found.update(repr((program.outputs, layout.inputs, layout.outputs, checks, bounded(program))).encode())
    return found.hexdigest()
