"""Run the programs of Specs without a public call, and derivatives along directions, each direction a batch lane."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs.record.recording import ProgramOptions, fits
from ..engines.programs.run.tiered_program import TieredProgram
from ..model.model import Model
from ..recursions.spec import Spec

Array = NDArray[Any]


@lru_cache(maxsize=32)
def _program(model: Model, specs: tuple[Spec, ...], derivative: str, static: tuple[Any, ...]) -> TieredProgram:
    return TieredProgram(specs, model.bodies, model.key, static, ProgramOptions(derivative=derivative))


def run(
    model: Model, specs: Spec | tuple[Spec, ...], derivative: str, rows: Sequence[Array], static: tuple[Any, ...] = (),
    outputs: int = 1,
) -> Any:  # fmt: skip
    """The last output (n, columns), or the last ``outputs``, of a program for rows (n or 1, columns) of its inputs.

    derivative  "" or "jvp", as of ``ProgramOptions``
    static      values of the static inputs
    """
    specs = specs if isinstance(specs, tuple) else (specs,)
    made, n = _program(model, specs, derivative, static), max(map(len, rows))
    widths = tuple(map(len, made.recording.layout.outputs))
    out = [np.empty((n, width)) for width in widths]
    left: Any = np.arange(n)
    if not numba_kernels.PLAIN and fits(specs, model.bodies, static=static):
        left = made.batch(n)([np.ascontiguousarray(x) for x in rows], out)
        left = np.arange(n) if left is None else left
    if len(left):  # beyond the range of a program's sines, or not finite
        columns = [c for x in rows for c in np.broadcast_to(x, (n, x.shape[1]))[left].T]
        program, layout = made.recording
        found = program.run(columns)
        for k in range(len(widths) - outputs, len(widths)):
            for column, place in enumerate(layout.outputs[k]):
                out[k][left, column] = found[place]
    return out[-1] if outputs == 1 else out[-outputs:]


def along(
    model: Model, specs: Spec | tuple[Spec, ...], inputs: Sequence[Array], tangents: Sequence[Array | int],
    static: tuple[Any, ...] = (), outputs: int = 1,
) -> Any:  # fmt: skip
    """Derivatives (n, columns of the output, m) along m directions; for several outputs, a list of these.

    inputs    (n, columns) each
    tangents  (n, columns, m) each, or the number of columns of a zero tangent
    """
    n, m = len(inputs[0]), next(x.shape[2] for x in tangents if not isinstance(x, int))
    rows = [np.repeat(x, m, axis=0) for x in inputs]
    for x in tangents:
        moving = not isinstance(x, int)
        rows.append(x.transpose(0, 2, 1).reshape((n * m, -1)) if moving else np.zeros((1, x)))  # type: ignore[union-attr]
    found = run(model, specs, "jvp", rows, static, outputs)
    made = [x.reshape((n, m, -1)).transpose(0, 2, 1) for x in (found if outputs > 1 else [found])]
    return made if outputs > 1 else made[0]
