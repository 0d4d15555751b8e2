"""A simulation by an explicit method as one program on one lane: three to six times the speed of the compiled table.

Which of the two steps a robot depends on the model, the method and the kind of torque, never on the number of steps: it
is the program wherever there is one, from the first step on. Where a step has no answer by the program (an angle beyond
its range, a state that is not finite), that step and all after it are the table's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels, time_loop
from ..engines.programs.time_loop import Driven
from ..model.model import Model
from .methods import Method
from .recorder import Recorder
from .rollouts import METHODS, step_specs
from .system import State
from .torques import Torque

# Rows of the table times forward dynamics a step: 85 to 350 lines of the program each, and 0.1 ms to compile a line of
# them. At the limit that is 3 s once for a model, and the code (600 kB) leaves the caches: twice the table's speed.
MOST = 128

Slice = Callable[[int, int, float], bool]


def program(
    recorder: Recorder, method: Method, torque: Torque, fext: NDArray[np.float64] | None, state: State
) -> Slice | None:
    """``(first, count, h) -> done``: those steps of h, recorded, the state moved on; False, with nothing done, where
    the program has no answer for one of them. None where there is no program.
    """
    model, steps = recorder.model, recorder.steps
    if method.name not in METHODS or torque.user is not None or fext is not None:
        return None
    kernel = _kernel(model, method)
    if kernel is None:
        return None
    q_rows, w_rows, tau_rows = recorder.rows

    def run(first: int, count: int, h: float) -> bool:
        every = recorder.every if first % recorder.every == count % recorder.every == 0 else count
        held = torque.held if len(torque.held) == 1 else torque.held[first : first + count]
        records = [np.empty((1, count // every, len(x))) for x in (state.q, state.w)]
        driving = [Driven(np.full((1, 1, 1), h)), Driven(np.ascontiguousarray(held[None]))]
        if len(time_loop.run(kernel, [state.q[None], state.w[None]], driving, records, count, every)):
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


@lru_cache(maxsize=batch_kernels.KEPT)
def _kernel(model: Model, method: Method) -> Any:
    specs = step_specs(method.name, law=False, driven=True)
    rows = method.evaluations * (len(model.bodies) - 1)
    if numba_kernels.PLAIN or rows > MOST or not batch_kernels.fits(specs, model.bodies):
        return None
    return batch_kernels.kernel(specs, model.bodies, model.key, one=True)
