"""SciPy's DOP853 and Radau, with adaptive steps: the state is (q, v), with quaternions as four coordinates.

Quaternions and (cos, sin) pairs are normalised in the right-hand side and in the recorded samples; in between the
tolerances keep their norm. Held torques jump between steps, so SciPy restarts at each step of the torque.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import EPS
from ...calls.dynamics import calls
from ...calls.one_sample import of_model
from ...errors import ConstraintError, NonFiniteError, SimulationError, SpatialDynError, pip_install
from ...recursions.coordinates.coordinate_rates import COORDINATE_RATE
from ..recorder import Recorder
from ..torques import Torque

Array = NDArray[np.float64]
MOST_SHORT = 24  # steps in a row below the time's resolution: each may be ten times the one before


def run_adaptive(
    recorder: Recorder, q: Array, v: Array, torque: Torque, report: Callable[[int, int], None],
    tolerances: tuple[float, float],
    acts: Callable[[int, float, Array, Array, Array, Array], tuple[Array, Array]], jumps: bool = False,
) -> None:  # fmt: skip
    """Integrate and record; ``acts`` gives the acceleration and the rates of the states carried.

    jumps  whether inputs other than held torques jump between steps

    Raises SimulationError if SciPy's method fails, SpatialDynError if SciPy is missing."""
    try:
        from scipy import integrate
    except ImportError as error:
        raise SpatialDynError(f"SciPy is not installed; {pip_install('simulation')}") from error
    solver = {"dop853": integrate.DOP853, "radau": integrate.Radau}[recorder.method.name]
    model, steps = recorder.model, recorder.steps
    nq, own, y = model.nq, model.nq + model.nv, np.concatenate([q, v, recorder.own])
    rate = of_model(COORDINATE_RATE, model, (), (True, True))

    def slope(step: int) -> Callable[[float, Array], Array]:
        def at(t: float, y: Array) -> Array:
            try:
                q, v = calls["normalize"](model, y[:nq]), y[nq:own].copy()
                a, rates = acts(step, t, q, v, y[own:], torque.at(step, t, q, v))
            except NonFiniteError as error:
                raise SimulationError(f"the state is not finite at t = {t:.9g} s: {error}") from error
            except ConstraintError as error:
                raise SimulationError(f"at t = {t:.9g} s: {error}") from error
            return np.concatenate([rate(q, v), a, rates])

        return at

    ends = range(1, steps.total + 1) if len(torque.held) > 1 or jumps else [steps.total] * (steps.total > 0)
    first, short = 0, 0
    for end in ends:
        run = solver(slope(first), steps.time(first), y, steps.time(end), rtol=tolerances[0], atol=tolerances[1])
        while run.status == "running":
            reached = run.t, run.y.copy()
            try:
                problem = run.step()
            except KeyboardInterrupt:
                at, (q, v) = reached[0], (calls["normalize"](model, reached[1][:nq]), reached[1][nq:own])
                recorder.own[:] = reached[1][own:]
                recorder.end(at, q, v, torque.unasked(min(int(at / steps.dt), end)))
                raise
            if run.status == "failed":
                raise SimulationError(f"{recorder.method.name} fails at t = {run.t:.9g} s: {problem}")
            least = EPS * steps.time(steps.total)
            short = short + 1 if run.t - reached[0] < least else 0
            if short == MOST_SHORT:
                fastest = abs(run.y[nq:own]).max()
                raise SimulationError(
                    f"{recorder.method.name} takes steps of {run.t - reached[0]:.2g} s at t = {run.t:.9g} s, below the "
                    f"resolution of its time, {least:.2g} s: v reaches {fastest:.2g}, expected slower motions"
                )
            _record(recorder, run, torque, end)
            report(int(recorder.at[0]), steps.total)
        y, first = run.y, end


def _record(recorder: Recorder, run: Any, torque: Torque, end: int) -> None:
    """Record the samples within SciPy's last step, from its dense output."""
    steps, model = recorder.steps, recorder.model
    recorder.at[0] = end if run.status == "finished" else min(int(run.t / steps.dt), end)
    last = steps.time(end) if run.status == "finished" else run.t
    within = None
    while recorder.at[1] < len(recorder.t) and (t := recorder.t[recorder.at[1]]) <= last:
        within = within or run.dense_output()
        y = within(t)
        q, v = calls["normalize"](model, y[: model.nq]), y[model.nq : model.nq + model.nv].copy()
        recorder.own[:] = y[model.nq + model.nv :]
        recorder.put(q, v, torque.at(int(recorder.kept[recorder.at[1]]), t, q, v))
