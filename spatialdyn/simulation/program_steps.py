"""Explicit methods as one program on one lane: three to six times the speed of the table kernel.

The choice between the two depends on the model, the method and the kind of torque, never on the number of steps: the
program runs from the first step on if there is one. From the first step to which it has no answer (an angle beyond its
range, a state that is not finite) the recursions run, a few steps in plain Python, then as table kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels, recording, time_loop
from ..engines.programs.time_loop import StepInput
from ..model.model import Model
from ..recursions.spec import Argument, Spec
from .constrained import Held
from .contact_steps import Touching
from .control_laws import Control, step_kernel
from .friction_steps import Rubbing
from .methods import EXPLICIT_METHODS, Method
from .recorder import Recorder
from .system import State
from .torques import Torque
from .traced_steps import step_specs

# Rows of the table times forward dynamics per step: 85 to 350 operations of the program each, 0.1 ms to compile one.
# At the limit that is 3 s once per model, and the code (600 kB) exceeds the caches: twice the table kernel's speed.
MOST = 128

Slice = Callable[[int, int, float], bool]


def program(
    recorder: Recorder,
    method: Method,
    torque: Torque,
    fext: NDArray[np.float64] | None,
    state: State,
    held: Held | None = None,
    found: Rubbing | None = None,
    control: Control | None = None,
    work: tuple[Argument, ...] = (),
    touch: Touching | None = None,
) -> Slice | None:
    """``(first, count, h) -> done``: takes and records these steps of h and advances the state; returns False, with
    nothing changed, if the program has no answer to one of them. None if not applicable.

    found, control, work, touch  the friction of the run, its control law, the states of its work, its contacts
    """
    model, steps = recorder.model, recorder.steps
    long = touch is not None and touch.is_long
    if method.name not in EXPLICIT_METHODS or torque.user is not None or fext is not None or long:
        return None
    static: tuple[Any, ...]
    equations, static = (held.inputs, (held.constraints.table,)) if held is not None else ((), ())
    way, coefficients = (found.way, found.inputs) if found else (None, ())
    if touch is not None:
        static = (*static, *touch.tables)
    spec, values = None, {}
    if control is not None:
        spec, static = control.spec, (*static, *control.static)
        values = control.rows(model, 1, steps.total)
    kernel = _kernel(
        model, method, equations, static, way, coefficients, spec, control is not None and control.held, work,
        () if touch is None else touch.arguments,
    )  # fmt: skip
    if kernel is None:
        return None
    q_rows, w_rows, tau_rows = recorder.rows
    now = [state.q, state.w, *(recorder.own[at] for at in recorder.carried.slices)]
    constants = [StepInput(x[None, None]) for x in (found.values if found else ())]
    constants += [StepInput(x) for x in (held.values.values() if held is not None else ())]
    constants += [StepInput(x[None, None]) for x in (touch.values if touch is not None else ())]

    def run(first: int, count: int, h: float) -> bool:
        every = recorder.every if first % recorder.every == count % recorder.every == 0 else count
        torques = torque.held if len(torque.held) == 1 else torque.held[first : first + count]
        records = [np.empty((1, count // every, len(x))) for x in now]
        forcing = [StepInput(np.full((1, 1, 1), h)), StepInput(np.ascontiguousarray(torques[None])), *constants]
        for x in values.values():
            forcing.append(StepInput(x if x.shape[1] == 1 else np.ascontiguousarray(x[:, first : first + count])))
        if len(time_loop.run(kernel, [x[None] for x in now], forcing, records, count, every)):
            return False
        for x, (rows,) in zip(now, records, strict=True):
            x[:] = rows[-1]
        (q,), (w,) = records[:2]
        done = first + count
        if done % recorder.every == 0 or done == steps.total:
            row, more = int(recorder.at[1]), len(q)
            after = np.minimum(np.arange(first + every, done + 1, every), len(torque.held) - 1)
            q_rows[row : row + more], w_rows[row : row + more] = q, w
            tau_rows[row : row + more] = torque.held[after]
            recorder.own_rows[row : row + more] = np.concatenate(
                [np.empty((more, 0)), *(x for (x,) in records[2:])], axis=1
            )
            recorder.at[1] += more
        recorder.at[0] += count
        return True

    return run


def slice_of(first: int, count: int, every: int) -> int:
    """How many of ``count`` steps to take at once: up to the next sample, or a whole number of samples."""
    if first % every == 0 and count >= every:
        return count - count % every
    return min(count, every - first % every)


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _kernel(
    model: Model,
    method: Method,
    held: tuple[Argument, ...] = (),
    static: tuple[Any, ...] = (),
    way: str | None = None,
    coefficients: tuple[str, ...] = (),
    control: Spec | None = None,
    held_law: bool = False,
    work: tuple[Argument, ...] = (),
    touch: tuple[Argument, ...] = (),
) -> Any:
    specs = step_specs(method.name, False, True, held, way, coefficients, control, held_law, work, touch)
    rows = (method.evaluations + 2 * len(static)) * (len(model.bodies) - 1)
    if numba_kernels.PLAIN or rows > MOST or not recording.fits(specs, model.bodies, static=static):
        return None
    return step_kernel(specs, model, static, one=True, by_content=control is not None)
