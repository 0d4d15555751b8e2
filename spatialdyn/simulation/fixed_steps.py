"""A run of one sample: the loop of a method with a fixed step, with all effects.

The loop runs in slices: between slices it handles Ctrl-C, reports progress, and turns a failure status into an error.
If there is a program, it takes the steps on one lane, at three to six times the speed of the table kernel.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.progress import Report, reporting
from ..engines.compiled import numba_kernels
from ..engines.programs.run import time_loop
from ..engines.programs.run.time_loop import StepInput
from ..errors import ConstraintError, SimulationError
from ..model.model import Model
from ..recursions.spec import FEXT
from .arithmetic import Computed
from .compiled_loop import compile_loop, drive
from .kernel_steps import KernelSteps, rates_of
from .methods.call_kernels import kernels_of
from .methods.iteration import SETTLED, SWEEPS
from .methods.methods import EXPLICIT, EXPLICIT_METHODS, Family, Method
from .momenta_steps import begun, places
from .plan import Plan
from .recorder import FAST, Recorder
from .system import OK, PIVOT, STALLED, TORQUE, TURNED, State, System, held_torque, units, user_torque
from .torques import Torque, with_force

Array = NDArray[np.float64]
Slice = Callable[[int, int, float], bool]
SLICE = 0.05  # [s] between checks for Ctrl-C and progress reports
PLAIN_ROWS = 8000  # rows of recursions to run in plain Python before compiling a loop, which takes seconds
LEAST_PLAIN = 16  # steps
TOLERANCES = 1e-9, 1e-12  # relative and absolute, of SciPy's methods
STEPS = 100  # in a program's first slice, whose time sets the length of the next


def run_sample(
    plan: Plan, recorder: Recorder, start: tuple[Array, Array, Array], torque: Torque,
    report: Report | None, sample: int = 0, tolerances: tuple[float, float] = TOLERANCES,
) -> None:  # fmt: skip
    """Run one sample from (q, v, p) and record it. With ``report`` None, only long waits are reported.

    Raises SimulationError, and KeyboardInterrupt with the recorded part.
    """
    if recorder.method.family is None:
        from .methods.adaptive import run_adaptive

        jumps = any(x.shape[1] > 1 for x in plan.values.values())
        rates = rates_of(plan, recorder, sample)
        with nullcontext(report) if report else reporting(False, "simulate") as tell:
            run_adaptive(recorder, start[0], start[1], torque, tell, tolerances, rates, jumps)
    else:
        with ExitStack() as told:
            FixedSteps(plan, recorder, start, torque, sample).run(report, told)


class FixedSteps:
    """The steps of one sample: its state, its inputs, and the functions that take a step."""

    def __init__(
        self, plan: Plan, recorder: Recorder, start: tuple[Array, Array, Array], torque: Torque, sample: int = 0
    ) -> None:
        self.plan, self.recorder, self.torque, self.sample = plan, recorder, torque, sample
        (q, v, p), model, family = start, recorder.model, recorder.method.family
        assert family is not None
        self.family: Family = family
        pushed = FEXT.name in plan.values
        self.forces = plan.given(sample, 0)[FEXT.name].copy() if pushed else np.zeros((0, 6))
        varies = pushed and (plan.force is not None or plan.values[FEXT.name].shape[1] > 1)
        self.simple = plan.bare and not varies and model.mimic_matrix is None  # a loop may be compiled as it is
        n, self.status, table = model.nv, np.zeros(3), getattr(plan.table, numba_kernels.TABLE)
        self.data = table, torque.held, self.forces, plan.units, np.zeros(n), np.zeros(n), self.status
        scratch = np.zeros((len(model.bodies), 6)), np.zeros((family.rows, n * (1 + family.wide)))
        self.state = State(q.copy(), (p if recorder.moves_p else v).copy(), np.zeros(n), np.zeros(model.nq), *scratch)
        asks = held_torque if torque.user is None else user_torque
        if plan.force is not None and family is EXPLICIT:  # other methods evaluate forces before torques
            asks = with_force(asks, plan.force)
        self.bare = System(None, asks, torque.user, *self.data)  # all that a program needs to start and to observe
        self.now = (*self.state, recorder.at, recorder.own)
        self.marked = [x.copy() for x in self.now]

    @functools.cached_property
    def _by_kernels(self) -> tuple[System, Callable[..., None]]:
        """A System and a step that use the kernels of the family, which take seconds to compile."""
        step = self.recorder.method.advance
        assert step is not None
        return self.bare._replace(kernels=self.family.kernels(len(self.forces) > 0)), step

    @functools.cached_property
    def _by_calls(self) -> tuple[System, Callable[..., None]]:
        """A System and a step that use calls, which need no compilation."""
        step = self.recorder.method.advance
        if self.simple:
            assert step is not None
            kernels = kernels_of(Computed(self.plan.model, {}), self.family, self.forces if len(self.forces) else None)
            return self.bare._replace(kernels=kernels), step
        steps = KernelSteps(self.plan, self.recorder, self.forces, self.sample)
        return self.bare._replace(kernels=steps.kernels), steps.step

    def _plain_steps(self, rejected: bool) -> int:
        """The number of steps to take by calls: all if no loop may be compiled.

        rejected  whether a program rejects steps: angles beyond the range of its sines, or a motion that may diverge
        """
        if not (self.simple and (self.torque.compiled or numba_kernels.PLAIN)):
            return self.recorder.steps.total + 1
        each = len(self.recorder.model.bodies) * self.recorder.method.evaluations
        return max(LEAST_PLAIN, PLAIN_ROWS // each) if rejected else 0  # fixed, so that no bit depends on a clock

    def _mark(self) -> None:
        """Save the state, because Ctrl-C may come while a step changes it."""
        for kept, x in zip(self.marked, self.now, strict=True):
            kept[...] = x

    def _take(self, first: int, count: int, h: float, plain: bool) -> None:
        """Take steps of h, by calls or by kernels, and record them. Raises SimulationError."""
        recorder, steps = self.recorder, self.recorder.steps
        times: tuple[Any, ...] = (first, count, steps.total, recorder.every, steps.dt, h, recorder.at, *recorder.rows)
        if not plain and self.torque.compiled:
            loop = compile_loop(recorder.method, len(self.forces) > 0, self.torque.user)
            loop(*self.data, *self.state, *times)
        else:
            system, step = self._by_calls if plain else self._by_kernels

            def marking(system: System, t: float, h: float, state: State) -> None:
                self._mark()
                step(system, t, h, state)

            def observing(system: System, t: float, state: State) -> None:
                self.family.observe(system, t, state)
                recorder.own_rows[recorder.at[1]] = recorder.own

            try:
                with np.errstate(all="ignore"):
                    drive(marking, observing, system, self.state, *times)
            except ConstraintError as error:
                raise SimulationError(f"step from t = {recorder.at[0] * steps.dt:.9g} s: {error}") from error
        if self.status[0] != OK:
            raise SimulationError(failure_message(self.status, recorder.method, recorder.model, h, self.state))

    def run(self, report: Report | None, told: ExitStack) -> None:
        """Take all steps, in slices of about SLICE seconds; see ``run_sample``. ``told`` closes a report made here."""
        plan, recorder, steps, start = self.plan, self.recorder, self.recorder.steps, time.perf_counter()
        at_once = program(plan, recorder, self.torque, self.state, self.sample)
        plain = self._plain_steps(at_once is not None)
        if at_once is None and self.family.start is not None:
            self.family.start((self._by_calls if plain else self._by_kernels)[0], self.state)
        try:
            count, odd = 1 if at_once is None else STEPS, 0
            while (first := int(recorder.at[0])) < steps.total:
                began = time.perf_counter()
                h, count = (steps.dt, min(count, steps.whole - first)) if first < steps.whole else (steps.rest, 1)
                if at_once is not None:
                    count = slice_of(first, max(1, (odd - first) // 2) if odd else count, recorder.every)
                    if not at_once(first, count, h):
                        odd = first + count  # the program rejects one of these steps: find it by bisection
                        at_once = at_once if count > 1 else None
                        continue
                else:
                    count = min(count, plain) if plain else count
                    self._take(first, count, h, plain > 0)
                    plain -= min(count, plain)
                self._mark()
                self._judge()
                now = time.perf_counter()
                if report is None and now - start > SLICE:  # it may take long
                    long = plan.contact.too_long if plan.contact else ""
                    doing = f"simulate in plain Python, for {long}" if long else "simulate"
                    report = told.enter_context(reporting(False, doing))
                if report is not None:
                    report(int(recorder.at[0]), steps.total)
                spent = max(now - began, 1e-6)
                count = max(1, int(min(10.0 * count, count * SLICE / spent)))
        except KeyboardInterrupt:
            for x, kept in zip(self.now, self.marked, strict=True):
                x[...] = kept
            done = int(recorder.at[0])
            if at_once is None:  # a program's states are q, and v or p
                with np.errstate(all="ignore"):
                    self.family.observe(self._by_calls[0], steps.time(done), self.state)
            recorder.end(steps.time(done), self.state.q, self.state.w, self.torque.unasked(done))
            raise

    def _judge(self) -> None:
        """Raise SimulationError if an effect finds that its law is violated."""
        if not self.plan.judged:
            return
        recorder = self.recorder
        own = (recorder.own[at] for at in recorder.states.slices)
        after = dict(zip((x.name for x in self.plan.states), own, strict=True))
        if reason := self.plan.failure(after, recorder.steps.dt, recorder.steps.time(int(recorder.at[0]))):
            raise SimulationError(reason)


# --- by a program ---------------------------------------------------------------------------------------


def program(plan: Plan, recorder: Recorder, torque: Torque, state: State, sample: int = 0) -> Slice | None:
    """``(first, count, h) -> done``, which takes and records these steps of h and advances the state; it returns False,
    with nothing changed, if the program rejects one of them. None if not applicable.
    """
    kernel = None if numba_kernels.PLAIN or torque.user is not None else plan.single
    if kernel is None:
        return None
    steps = recorder.steps
    values = [x[min(sample, len(x) - 1)][None] for x in plan.step_values]
    q_rows, w_rows, tau_rows = recorder.rows
    shown = [state.q, state.w, *(recorder.own[at] for at in recorder.states.slices)]
    now = [*shown]
    if plan.method not in EXPLICIT_METHODS:
        now += places(plan.method, state)
        for x, start in zip(now[2:], begun(plan.model, plan.method, state.q[None], state.w[None]), strict=True):
            x[:] = start[0]

    def run(first: int, count: int, h: float) -> bool:
        every = recorder.every if first % recorder.every == count % recorder.every == 0 else count
        torques = torque.held if len(torque.held) == 1 else torque.held[first : first + count]
        records = [np.empty((1, count // every, len(x))) for x in shown]
        ends = [np.empty((1, len(x))) for x in now]
        forcing = [StepInput(np.full((1, 1, 1), h)), StepInput(np.ascontiguousarray(torques[None]))]
        for x in values:
            forcing.append(StepInput(x if x.shape[1] == 1 else np.ascontiguousarray(x[:, first : first + count])))
        if len(time_loop.run(kernel, [x[None] for x in now], forcing, records, count, every, ends)):
            return False
        for x, (end,) in zip(now, ends, strict=True):
            x[:] = end
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
    """The number of steps, of ``count``, to take at once: up to the next sample, or a whole number of samples."""
    if first % every == 0 and count >= every:
        return count - count % every
    return min(count, every - first % every)


# --- failures -------------------------------------------------------------------------------------------


def failure_message(status: Array, method: Method, model: Model, h: float, state: State) -> str:
    """The message of a failure status."""
    code, t, size = int(status[0]), status[1], status[2]
    if code == TORQUE:
        return f"torque is not finite at t = {t:.9g} s, expected finite numbers"
    if code == STALLED:
        return (
            f"{method.name} does not converge at t = {t:.9g} s: the residual is {size:.2g} of the step, expected "
            f"less than {SETTLED:g} within {SWEEPS} sweeps; try dt = {h / 4:g} instead of {h:g}"
        )
    if code == TURNED:
        return (
            f"a body turns too far in the step at t = {t:.9g} s for {method.name}; try dt = {h / 4:g} instead of {h:g}"
        )
    if code == PIVOT and np.isfinite(state.q).all() and np.isfinite(state.w).all():
        v = state.v if method.family is not None and method.family.moves == "p" else state.w
        fastest = float((units(model)[: model.nv] * abs(v)).max() * h)
        if fastest <= FAST:
            return f'a joint of robot "{model.name}" has zero articulated inertia at t = {t:.9g} s, expected some'
        return (
            f"{method.name} diverged at t = {t:.9g} s: joints move by {fastest:.2g} rad, or lengths of the robot, "
            f"in a step; reduce dt, to {h / 4:g} s say instead of {h:g}"
        )
    return (
        f"{method.name} diverged at t = {t:.9g} s: the state is not finite; reduce dt, to {h / 4:g} s say "
        f"instead of {h:g}"
    )
