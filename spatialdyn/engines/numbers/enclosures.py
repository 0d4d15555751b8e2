"""A call in double-double with a bound on the error of each result, for the few samples that float64 cannot decide.

Running error analysis in float64 (``programs.transform.error_bound``) finds the bound on the lines that double-double
runs, with another unit roundoff: an operation is off by at most 2⁻¹⁰⁰ in place of 2⁻⁵³. The bound is wide, but still
far below the resolution of float64.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...recursions.spec import Spec
from ..programs.record.operations import ABS, ADD, CONST, DIV, INPUT, MUL, SELECT, SIN, SQRT, SUB, operands
from ..programs.record.program import Program
from ..programs.record.recording import shape_of
from ..programs.record.tracer import Tape, evaluate, table
from ..programs.transform.error_bound import Bounding
from .double_double import allocate_registers

Array = NDArray[np.float64]

FINER = (
    2.0**-46
)  # an operation is off by at most 8 · 2⁻¹⁰⁴ powers of 2, and a sine by twice that, where the analysis assumes 2⁻⁵³


class Enclosure:
    """A call without parameters on one table whose configuration has numbers only."""

    def __init__(self, spec: Spec, bodies: NDArray[Any], static: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Record the call, and its bound. ``static`` are the values of static inputs, no tables among them."""
        program = _unfolded(spec, bodies, static)
        self._pairs = allocate_registers(program)
        made = Bounding(np.float64, program.operations["depth"], fma=False)
        found = made.run(program, made.inputs(program.inputs))
        self._bounds = Program(made.tape, [made.absolute(x.b) for x in found], program.inputs, fuse=False)

    def __call__(self, inputs: Sequence[Array]) -> tuple[Array, Array, Array]:
        """(high, low, bound), each (n, results): the exact result is within the bound of high + low.

        inputs  (n, entries) each
        """
        columns = np.ascontiguousarray(np.concatenate(inputs, axis=1).T)
        high, low = self._pairs(columns)
        bound = [np.broadcast_to(FINER * x, high.shape[1:]) for x in self._bounds.run(columns)]
        return high.T, low.T, np.asarray(bound).T


class Zeros:
    """Which results of a call are exactly 0: sums of zeros and of products with a zero, as for a robot at rest.

    A float64 result of 0 is no proof, since products underflow; a bound is no proof either, since it allows for that.
    """

    def __init__(self, spec: Spec, bodies: NDArray[Any], static: Mapping[str, Any] = MappingProxyType({})) -> None:
        """As an Enclosure."""
        self._program = _unfolded(spec, bodies, static)

    def __call__(self, inputs: Sequence[Array]) -> NDArray[np.bool_]:
        """(n, results): whether each result is 0 if no divisor is 0; False where that is not known.

        inputs  (n, entries) each
        """
        columns = np.concatenate(inputs, axis=1).T == 0.0
        lines: list[Any] = []
        for op in self._program.lines:
            given = [lines[k] for k in operands(op)]
            if op.code == INPUT:
                found = columns[op.a]
            elif op.code == MUL:
                found = given[0] | given[1]
            elif op.code in (ADD, SUB):
                found = given[0] & given[1]
            elif op.code == SELECT:
                found = given[1] & given[2]
            elif op.code in (DIV, SQRT, SIN, ABS):
                found = given[0]
            else:
                found = np.array(op.code == CONST and op.value == 0.0)
            lines.append(found)
        shape = columns.shape[1:]
        return np.array([np.broadcast_to(lines[k], shape) for k, _ in self._program.outputs]).reshape((-1, *shape)).T


def _unfolded(spec: Spec, bodies: NDArray[Any], static: Mapping[str, Any]) -> Program:
    """The program of a call in which all numbers of the tables and placements are exact lines."""
    tape = Tape(errors=True)
    varying = [x for x in spec.present if not x.static]
    shapes = [shape_of(x, bodies) for x in varying]
    ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    inputs = np.empty(ends[-1], object)
    inputs[:] = [tape.input(k) for k in range(len(inputs))]
    parts = {
        x.name: inputs[a:b].reshape(shape) for x, a, b, shape in zip(varying, ends[:-1], ends[1:], shapes, strict=True)
    }
    for name, value in static.items():
        is_array = isinstance(value, np.ndarray)
        parts[name] = np.vectorize(tape.unfolded, otypes=[object])(value) if is_array else value
    pivots = np.empty(len(bodies) - 1, object)
    out = evaluate(spec, table(bodies, tape.unfolded), shape_of(spec.output, bodies), parts, pivots)
    return Program(tape, out.ravel().tolist(), len(inputs), fuse=False)


def rounded(low: Array, bound: Array) -> Array:
    """The bound of pairs after their low part is dropped."""
    return (abs(low) + bound) * (1.0 + 2.0**-50)
