"""The loop of a method with a fixed step, and what acts in it beside torques.

It runs in slices: between them it handles Ctrl-C, reports progress, and turns a failure status into an error.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..errors import ConstraintError, SimulationError
from ..model.model import Model
from ..recursions.spec import FEXT
from . import explicit
from .compiled_loop import compile_loop, drive
from .energy import FAST
from .kernel_steps import KernelSteps
from .methods import EXPLICIT, Method
from .plan import Plan
from .program_steps import program, slice_of
from .recorder import Recorder
from .symplectic import SETTLED, SWEEPS
from .system import OK, PIVOT, STALLED, TORQUE, TURNED, State, System, held_torque, joint_table, units, user_torque
from .torques import Torque, with_force

Array = NDArray[np.float64]
SLICE = 0.05  # [s] between checks for Ctrl-C and progress reports
PLAIN_STEPS = (
    16  # in plain Python, beyond a program's range: a motion that diverges ends there, and compiles no kernels
)
STEPS = 100  # in a program's first slice: 40 µs for an arm, 3 ms for a humanoid


def run_fixed(
    plan: Plan, recorder: Recorder, start: tuple[Array, Array, Array], torque: Torque,
    report: Callable[[int, int], None], sample: int = 0,
) -> None:  # fmt: skip
    """All steps of one sample by a method with a fixed step, in slices of about SLICE seconds."""
    model, method, steps, own = recorder.model, recorder.method, recorder.steps, recorder.own
    family, advance = method.family, method.advance
    assert family is not None
    assert advance is not None
    (q, v, p), n, rows = start, model.nv, len(model.bodies)
    status, pushed = np.zeros(3), FEXT.name in plan.values
    forces = plan.given(sample, 0)[FEXT.name].copy() if pushed else np.zeros((0, 6))
    varies = pushed and (plan.force is not None or plan.values[FEXT.name].shape[1] > 1)
    simple = plan.bare and not varies and model.mimic_matrix is None  # a loop may be compiled as it is
    table = joint_table(model)
    data = (
        getattr(table, numba_kernels.TABLE),
        torque.held,
        forces,
        units(model.bodies),
        np.zeros(n),
        np.zeros(n),
        status,
    )
    scratch = (np.zeros(n), np.zeros(model.nq), np.zeros((rows, 6)), np.zeros((family.rows, n * (1 + family.wide))))
    state = State(q.copy(), (p if recorder.moves_p else v).copy(), *scratch)
    asks = held_torque if torque.user is None else user_torque
    if plan.force is not None and family is EXPLICIT:  # others evaluate forces before they ask for torques
        asks = with_force(asks, plan.force)
    bare = System(None, asks, torque.user, *data)  # all that methods with a program need to start and to observe

    @functools.cache
    def kernels() -> tuple[Any, Callable[..., None]]:
        """The kernels of the family, which take seconds to compile and a program does not need; a step by them."""
        if simple:
            return family.kernels(pushed), advance
        made = KernelSteps(plan, recorder, forces, sample)
        return made.kernels, made.step

    def system() -> System:
        return bare._replace(kernels=kernels()[0])

    at_once = program(plan, recorder, torque, state, sample)
    if at_once is None:
        family.start(system(), state)
    now = (*state, recorder.at, own)
    marked = [x.copy() for x in now]

    def mark() -> None:
        """Save the state: Ctrl-C may come while a step changes it."""
        for kept, x in zip(marked, now, strict=True):
            kept[...] = x

    def marking(system: System, t: float, h: float, state: State) -> None:
        mark()
        kernels()[1](system, t, h, state)

    def marking_plain(system: System, t: float, h: float, state: State) -> None:
        mark()
        advance(system, t, h, state)

    def observing(system: System, t: float, state: State) -> None:
        family.observe(system, t, state)
        recorder.own_rows[recorder.at[1]] = own

    def run(first: int, count: int, h: float, plain: bool) -> None:
        times: tuple[Any, ...] = (first, count, steps.total, recorder.every, steps.dt, h, recorder.at, *recorder.rows)
        if plain:
            made = bare._replace(kernels=explicit.plain_kernels(pushed), table=model.bodies)
            with np.errstate(all="ignore"):
                drive(marking_plain, observing, made, state, *times)
        elif torque.compiled and simple:
            compile_loop(method, pushed, torque.user)(*data, *state, *times)
        else:
            try:
                with np.errstate(all="ignore"):
                    drive(marking, observing, system(), state, *times)
            except ConstraintError as error:
                raise SimulationError(f"step from t = {recorder.at[0] * steps.dt:.9g} s: {error}") from error
        if status[0] != OK:
            raise SimulationError(failure_message(status, recorder.method, recorder.model, h, state))

    try:
        count, odd = 1 if at_once is None else STEPS, 0
        explicitly = simple and family.kernels is explicit.kernels
        plain = PLAIN_STEPS if at_once is not None and explicitly else 0  # a number, so that no bits depend on a clock
        while (first := int(recorder.at[0])) < steps.total:
            began = time.perf_counter()
            h, count = (steps.dt, min(count, steps.whole - first)) if first < steps.whole else (steps.rest, 1)
            if at_once is not None:
                count = slice_of(first, max(1, (odd - first) // 2) if odd else count, recorder.every)
                if not at_once(first, count, h):
                    odd = first + count  # the program has no answer to one of these steps: bisect for it
                    at_once = at_once if count > 1 else None
                    continue
            else:
                count = min(count, plain) if plain else count
                run(first, count, h, plain > 0)
                plain -= min(count, plain)
            mark()
            after = dict(zip((x.name for x in plan.states), (own[at] for at in recorder.states.slices), strict=True))
            if reason := plan.failure(after, steps.dt, steps.time(int(recorder.at[0]))):
                raise SimulationError(reason)
            report(int(recorder.at[0]), steps.total)
            spent = max(time.perf_counter() - began, 1e-6)
            count = max(1, int(min(10.0 * count, count * SLICE / spent)))
    except KeyboardInterrupt:
        for x, kept in zip(now, marked, strict=True):
            x[...] = kept
        done = int(recorder.at[0])
        with np.errstate(all="ignore"):
            family.observe(system() if at_once is None else bare, steps.time(done), state)
        recorder.end(steps.time(done), state.q, state.w, torque.unasked(done))
        raise


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
        fastest = float((units(model.bodies)[: model.nv] * abs(v)).max() * h)
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
