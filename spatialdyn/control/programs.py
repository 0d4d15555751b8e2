"""Specs of this package as programs over batches: recorded for a model, with kernels cached by content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs.record import recording
from ..engines.programs.run import batch_kernels, time_loop
from ..engines.programs.run.time_loop import StepInput
from ..engines.tables import hashable
from ..model.model import Model
from ..recursions.spec import Spec

Array = NDArray[np.float64]


def _values(static: tuple[bytes | int, ...]) -> tuple[Any, ...]:
    """Values of static inputs, placements and numbers, from their form by ``hashable``."""
    return tuple(np.frombuffer(x).reshape(4, 4) if isinstance(x, bytes) else x for x in static)


@lru_cache(maxsize=64)
def _recorded(spec: Spec, model: Model, static: tuple[bytes | int, ...]) -> recording.Recording:
    return recording.record((spec,), model.bodies, _values(static))


@lru_cache(maxsize=64)
def _kernel(spec: Spec, model: Model, static: tuple[bytes | int, ...], common: tuple[int, ...]) -> Any:
    """The kernel; its inputs ``common`` have one row. None if not applicable."""
    if numba_kernels.PLAIN or not recording.fits((spec,), model.bodies, static=_values(static)):
        return None
    program, layout = _recorded(spec, model, static)
    made = recording.Recording(program, replace(layout, common=common))
    return batch_kernels.kernel((spec,), model.bodies, model.key, _values(static), recorded=made)


def repeated(
    spec: Spec, model: Model, static: tuple[Any, ...], state: Array, inputs: Sequence[Array], common: Sequence[Array],
    steps: int,
) -> Array:  # fmt: skip
    """The states (samples, steps, columns) of a Spec that takes its own output as first input, step after step.

    inputs  (samples, columns) of the following inputs, the same in all steps
    common  (1, columns) of the last inputs, finite numbers for all samples
    """
    made: Array = np.empty((len(state), steps, state.shape[1]))
    of_all = tuple(1 + len(inputs) + k for k in range(len(common)))
    kernel = _kernel(spec, model, hashable(static), of_all)
    again = np.arange(len(state))
    if kernel is not None and len(state):
        given = [StepInput(x[:, None]) for x in (*inputs, *common)]
        again = time_loop.run(kernel, [state], given, [made], steps, 1)
    if len(again):
        now = np.ascontiguousarray(state[again])
        rest = [*(np.ascontiguousarray(x[again]) for x in inputs), *common]
        program = _recorded(spec, model, hashable(static)).program
        for k in range(steps):
            found = program.run([y for x in (now, *rest) for y in x.T])
            now = np.stack([np.broadcast_to(np.asarray(x, float), len(again)) for x in found], 1)
            made[again, k] = now
    return made
