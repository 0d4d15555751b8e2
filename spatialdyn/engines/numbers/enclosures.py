"""A call in double-double with a bound on the error of each result, for the few samples that float64 leaves open.

The bound is that of running error analysis in float64 (``programs.error_bound``) on the lines that double-double runs,
with another unit: there an operation is off by at most 2⁻¹⁰⁰ where in float64 it is by 2⁻⁵³. It is wide, and still
far below what float64 shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...recursions.spec import Spec
from ..programs.error_bound import Bounding
from ..programs.program import Program
from ..programs.recording import shape_of
from ..programs.tracer import Tape, evaluate, table
from .double_double import allocate_registers

Array = NDArray[np.float64]

FINER = (
    2.0**-46
)  # an operation is off by 8 · 2⁻¹⁰⁴ powers of 2 at most where the analysis has 2⁻⁵³, a sine by twice that


class Enclosure:
    """A call without parameters on one table, whose configuration is numbers alone."""

    def __init__(self, spec: Spec, bodies: NDArray[Any], static: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Record the call, and its bound. ``static`` are the values of static inputs, no tables among them."""
        tape = Tape(errors=True)  # all numbers of the tables and placements are lines, and exact
        varying = [x for x in spec.present if not x.static]
        shapes = [shape_of(x, bodies) for x in varying]
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
        inputs = np.empty(ends[-1], object)
        inputs[:] = [tape.input(k) for k in range(len(inputs))]
        parts = {
            x.name: inputs[a:b].reshape(shape)
            for x, a, b, shape in zip(varying, ends[:-1], ends[1:], shapes, strict=True)
        }
        for name, value in static.items():
            is_array = isinstance(value, np.ndarray)
            parts[name] = np.vectorize(tape.unfolded, otypes=[object])(value) if is_array else value
        pivots = np.empty(len(bodies) - 1, object)
        out = evaluate(spec, table(bodies, tape.unfolded), shape_of(spec.output, bodies), parts, pivots)
        program = Program(tape, out.ravel().tolist(), len(inputs), fuse=False)
        self._pairs = allocate_registers(program)
        made = Bounding(np.float64, program.operations["depth"], fma=False)
        found = made.run(program, made.inputs(len(inputs)))
        self._bounds = Program(made.tape, [made.absolute(x.b) for x in found], len(inputs), fuse=False)

    def __call__(self, inputs: Sequence[Array]) -> tuple[Array, Array, Array]:
        """(high, low, bound), each (n, results): the exact result is within the bound of high + low.

        inputs  (n, entries) each
        """
        columns = np.ascontiguousarray(np.concatenate(inputs, axis=1).T)
        high, low = self._pairs(columns)
        bound = [np.broadcast_to(FINER * x, high.shape[1:]) for x in self._bounds.run(columns)]
        return high.T, low.T, np.asarray(bound).T


def rounded(low: Array, bound: Array) -> Array:
    """The bound of pairs whose low part is left out."""
    return (abs(low) + bound) * (1.0 + 2.0**-50)
