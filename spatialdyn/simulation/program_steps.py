"""Steps of many samples side by side by one program; ``fixed_steps`` runs one sample on one lane.

Whether there is a program depends on the robot, the effects, the method and the kind of torque, never on the number of
steps or samples: if there is one, it runs from the first step on, with the same bits for one sample and for many. From
the first step that it rejects (an angle beyond its range, a state that is not finite) the recursions run: a few steps
in plain Python, then table kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..engines.compiled import numba_kernels
from ..engines.programs.record import recording
from ..engines.programs.record.program import Program
from ..engines.programs.run import time_loop
from ..engines.programs.run.time_loop import StepInput
from ..engines.programs.transform import float32_range
from ..errors import SpatialDynError
from ..model.model import Model
from ..recursions.spec import Spec
from .methods.methods import EXPLICIT_METHODS
from .momenta_steps import begun
from .plan import Plan
from .steps import step_specs

Array = NDArray[Any]


def on_lanes(
    plan: Plan, states: Sequence[Array], tau: Array | None, records: Sequence[Array], steps: tuple[float, int, int]
) -> NDArray[np.intp] | None:
    """Run samples side by side through all steps and write records; returns the samples that the program rejects, or
    None if not applicable.

    The arguments are those of ``driver.run_samples``.
    """
    (dt, total, every), model = steps, plan.model
    if not plan.is_program:
        return None
    if plan.method not in EXPLICIT_METHODS:
        return _in_momenta(plan, states, tau, records, steps)
    forced = tau is not None
    given = [np.full((1, 1, 1), dt), *(() if tau is None else (tau,)), *plan.step_values]
    if numba_kernels.PLAIN:
        recorded = _recorded(model, step_specs(plan.method, plan.structure, (), forced), plan.tables)
        return None if recorded is None else time_loop.replay(recorded, states, given, records, total, every)
    dtype = records[0].dtype if in_range(model, states[0][0], records[0].dtype) else np.dtype(np.float64)
    common: tuple[int, ...] = ()
    if plan.feedback is not None:  # gains and paths of hundreds of numbers, shared by all samples
        others = [k for k, x in enumerate(given) if len(x) == 1]
        common = tuple(len(states) + k for k in others)
        if not all(np.isfinite(given[k]).all() for k in others):
            return np.arange(len(states[0]))
    kernel = plan.kernel((), forced, dtype, False, common)
    if kernel is None:
        return None
    made = records if dtype == records[0].dtype else [np.empty(x.shape, dtype) for x in records]
    with np.errstate(over="ignore"):
        start, inputs = [x.astype(dtype, copy=False) for x in states], [x.astype(dtype, copy=False) for x in given]
        left = time_loop.run(kernel, start, [StepInput(x) for x in inputs], made, total, every)
        for x, y in zip(records, made, strict=True):
            if x is not y:
                x[...] = y
    return left


def _in_momenta(
    plan: Plan, states: Sequence[Array], tau: Array | None, records: Sequence[Array], steps: tuple[float, int, int]
) -> NDArray[np.intp] | None:
    """``on_lanes`` for a method in momenta, in float64: its equations are solved to rounding."""
    (dt, total, every), model = steps, plan.model
    kernel = None if numba_kernels.PLAIN else plan.kernel((), tau is not None, np.float64, False)
    if kernel is None or not records[0].size:
        return None
    sound = np.flatnonzero(np.isfinite(states[0]).all(axis=1) & np.isfinite(states[1]).all(axis=1))
    forcing = [np.full((1, 1, 1), dt), *(() if tau is None else (tau,)), *plan.step_values]
    inputs = [StepInput(np.ascontiguousarray(x if len(x) == 1 else x[sound], float)) for x in forcing]
    q, v = (np.ascontiguousarray(x[sound], float) for x in states)
    try:
        p = calls["momentum"](model, q, v)
        made = [np.empty((len(sound), *x.shape[1:])) for x in records]
        left = time_loop.run(kernel, [q, p, *begun(model, plan.method, q, p)], inputs, made, total, every)
        done = np.setdiff1d(np.arange(len(sound)), left)
        made[1][done] = calls["velocity_from_momentum"](model, made[0][done], made[1][done])
    except SpatialDynError:  # of one sample; a run of that sample alone names it
        return None
    with np.errstate(over="ignore"):
        for x, y in zip(records, made, strict=True):
            x[sound[done]] = y[done]
    return np.setdiff1d(np.arange(len(states[0])), sound[done])


@lru_cache(maxsize=32)
def _recorded(model: Model, specs: tuple[Spec, ...], static: tuple[Any, ...]) -> Program | None:
    fits = recording.fits(specs, model.bodies, static=static)
    return recording.record(specs, model.bodies, static).program if fits else None


def in_range(model: Model, q: Array, dtype: np.dtype[Any]) -> bool:
    """Whether the model's numbers, and the diagonal of M at q, are in the range of a dtype."""
    if dtype == np.float64:
        return True
    diagonal = np.diagonal(calls["crba"](model, q))
    return not float32_range.beyond(model.bodies) and bool(
        ((diagonal >= float32_range.LEAST) & (diagonal <= float32_range.MOST)).all()
    )
