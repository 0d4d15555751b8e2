"""A long simulation by an explicit method as one program on one lane: five times the speed of the compiled table."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines import batches, jit, loops
from ..engines.loops import Driven
from ..model import Model
from .methods import Method
from .recorder import Recorder
from .rollouts import METHODS, step_specs
from .system import State
from .torques import Torque

FROM = 5000  # steps from which a program pays, which may take a second to compile once

Slice = Callable[[int, int], bool]


def program(
    recorder: Recorder, method: Method, torque: Torque, fext: NDArray[np.float64] | None, state: State
) -> Slice | None:
    """``(first, count) -> done``: those steps, recorded, the state moved on; False, with nothing done, where the
    program has no answer. None if it would not pay or cannot be.
    """
    model, steps = recorder.model, recorder.steps
    if method.name not in METHODS or torque.user is not None or fext is not None or steps.whole < FROM:
        return None
    kernel = _kernel(model, method.name)
    if kernel is None:
        return None
    dt = Driven(np.full((1, 1, 1), steps.dt))
    q_rows, w_rows, tau_rows = recorder.rows

    def run(first: int, count: int) -> bool:
        every = recorder.every if first % recorder.every == count % recorder.every == 0 else count
        held = torque.held if len(torque.held) == 1 else torque.held[first : first + count]
        records = [np.empty((1, count // every, len(x))) for x in (state.q, state.w)]
        tau = Driven(np.ascontiguousarray(held[None]))
        if len(loops.run(kernel, [state.q[None], state.w[None]], [dt, tau], records, count, every)):
            return False
        (q,), (w,) = records
        state.q[:], state.w[:] = q[-1], w[-1]
        done = first + count
        if done % recorder.every == 0 or done == steps.total:
            row, more = int(recorder.at[1]), len(q)
            after = np.minimum(np.arange(first + every, done + 1, every), len(torque.held) - 1)
            q_rows[row : row + more], w_rows[row : row + more] = q, w
            tau_rows[row : row + more] = torque.held[after]
            recorder.at[1] += more
        recorder.at[0] += count
        return True

    return run


def slice_of(first: int, count: int, every: int) -> int:
    """How many of ``count`` steps to take at once, so that samples fall on the end of one or on all their marks."""
    if first % every == 0 and count >= every:
        return count - count % every
    return min(count, every - first % every)


def _kernel(model: Model, method: str) -> Any:
    specs = step_specs(method, law=False, driven=True)
    if jit.PLAIN or not batches.fits(specs, model.bodies):
        return None
    return batches.kernel(specs, model.bodies, model.key, one=True)
