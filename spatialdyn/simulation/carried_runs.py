"""Runs that carry states beside q and v where the steps run in Python, by kernels, and by SciPy's methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import core_shape
from ..calls.dynamics import calls
from ..constraints.dynamics import constraint_jacobian
from ..engines.compiled import numba_kernels
from ..engines.programs import tracer
from ..engines.programs.mimic_rows import rows_of
from ..errors import SimulationError
from ..model.model import Model
from ..recursions.friction import DT
from ..recursions.spec import Argument
from . import explicit, solved_steps, works
from .carried import Acting, carry, carry_solved
from .constrained import Held, motion_under, project
from .contact_steps import Touching
from .control_laws import OWN_INPUT, Control, law_on, moved_states
from .friction_steps import OWN, SMOOTH, Rubbing, smooth_kernel, solver
from .methods import EXPLICIT_METHODS
from .recorder import Recorder
from .solved_steps import external
from .springs import has_springs, spring_kernel
from .system import OK, State, System

Array = NDArray[np.float64]
ADAPTIVE = ("dop853", "radau")
Law = Callable[[Any, Any, Any, Mapping[str, Any]], tuple[Array, dict[str, Array]]]


def check_carrying(control: Control | None, work: bool, method: str) -> None:
    """Raise SimulationError where a method takes no control law, or records no work."""
    what = "control" if control is not None else 'record="work"' if work else None
    if what is not None and method not in (*EXPLICIT_METHODS, *ADAPTIVE):
        known = ", ".join((*EXPLICIT_METHODS, *ADAPTIVE))
        cure = "" if control is None else "; a torque function acts with every method"
        raise SimulationError(
            f'{what} is given with method="{method}", expected a method that carries states: {known}{cure}'
        )
    if control is not None and method in ADAPTIVE:
        ends = len(control.spec.states) - len(moved_states(control.spec))
        if control.held or ends:
            which = "is held over a step" if control.held else "has states that change at the end of a step"
            raise SimulationError(
                f'control "{control.spec.name}" {which}, expected a fixed step for it: {", ".join(EXPLICIT_METHODS)}'
            )


def law_in_floats(control: Control, model: Model, total: int) -> Callable[[int, float], Law]:
    """``(step, h) -> law`` of floats, at the values of a step; ``total`` steps in all."""
    rows, spec = rows_of(tracer.table(model.bodies)), control.spec
    values, static = control.rows(model, 1, total), iter(control.static)
    cores = {OWN_INPUT + x.name: core_shape(model, x, control.static) for x in spec.present}
    fixed = {OWN_INPUT + x.name: _static_rows(next(static)) for x in spec.present if x.static}

    def at(step: int, h: float) -> Law:
        given: dict[str, Any] = {DT.name: h, **fixed}
        for name, x in values.items():
            now = x[0, min(step, x.shape[1] - 1)].reshape(cores[name])
            given[name] = now if cores[name] else float(now)
        recorded = law_on(spec, rows, given)

        def law(q: Any, v: Any, tau: Any, states: Mapping[str, Any]) -> tuple[Array, dict[str, Array]]:
            wanted, made = recorded(q, v, tau, states)
            return np.asarray(wanted, float), {name: np.asarray(x, float) for name, x in made.items()}

        return law

    return at


def _static_rows(value: Any) -> Any:
    return tracer.table(value.rows) if hasattr(value, "rows") else value


def carrying(
    recorder: Recorder, kernels: Any, found: Rubbing | None, held: Held | None, control: Control | None,
    work: tuple[Argument, ...], fext: Array | None, springs: bool = False, touch: Touching | None = None,
) -> tuple[Any, Callable[..., None]]:  # fmt: skip
    """The kernels and the step of a method that carries states; ``kernels`` are those of its family."""
    model, carried, advance = recorder.model, recorder.carried, recorder.method.advance
    names = [x.name for x in carried.arguments]
    laws = None if control is None else law_in_floats(control, model, recorder.steps.total)
    moved = () if control is None else moved_states(control.spec)
    moving = (*moved, *(x.name for x in work if x != works.PROJECTION))
    pull = spring_kernel() if springs else None
    solve: Any = None
    if touch is not None:
        solve = solved_steps.solver(touch, fext, found, held, springs)
    elif found is not None and found.way in OWN:
        solve = solver(found, fext, model, held, springs)
    resist = smooth_kernel(found) if found is not None and found.way == SMOOTH else None
    motion = None if held is None else motion_under(held, model, fext)
    own_kernels = kernels if held is None else explicit.kernels_of(None)

    def free(system: System, q: Any, v: Any, a: Any) -> tuple[int, dict[str, Any]]:
        powers = {works.TORQUE.name: system.tau * v}
        if fext is not None and work:
            powers[works.EXTERNAL.name] = external(model, q, fext) * v
        if resist is not None:
            friction = resist(system.table, np.array(v))
            powers[works.FRICTION.name] = friction * v
            system = system._replace(tau=system.tau + friction)
        if pull is not None:
            pulled = pull(system.table, np.array(q), np.array(v))
            powers[works.SPRINGS.name] = pulled * v
            system = system._replace(tau=system.tau + pulled)
        if held is None or motion is None:
            return kernels.accelerate(system, q, v, a), powers
        made = motion(system, q, v)
        a[:] = made.a
        if works.CONSTRAINTS in work:
            powers[works.CONSTRAINTS.name] = made.force * (constraint_jacobian(model, held.constraints, q) @ v)
        return OK, powers

    def step(system: System, t: float, h: float, state: State) -> None:
        law = None if laws is None or control is None else laws(int(recorder.at[0]), h)
        acting = Acting(free, law, control is not None and control.held, moving)
        own = dict(zip(names, [x.copy() for x in carried.views(recorder.own)], strict=True))
        if solve is not None:
            system.torque(system, t, state.q, state.w)

            def solved(tau: Any) -> Any:
                after, changed, forces = solve(system._replace(tau=tau), t, h, state, own)
                if fext is not None and work:
                    forces[works.EXTERNAL.name] = external(model, state.q, fext)
                if pull is not None:
                    forces[works.SPRINGS.name] = pull(system.table, state.q, state.w)
                return after, changed, forces

            state.w[:], after = carry_solved(solved, h, state.q, state.w, system.tau.copy(), own, acting)
            displacement = state.work[1]
            displacement[:] = h * state.w
            explicit.move(system, t, displacement, state)
        else:
            after = carry(advance, system, t, h, state, own, acting)  # type: ignore[arg-type]
        finite = np.isfinite(state.q).all() and np.isfinite(state.w).all()
        if held is not None and system.status[0] == OK and finite:
            before = energy_of(model, state)
            project(held, model, state.q, state.w, touch is None)
            if works.PROJECTION in work:
                after[works.PROJECTION.name] = after[works.PROJECTION.name] + energy_of(model, state) - before
        for name, x in zip(names, carried.views(recorder.own), strict=True):
            x[...] = after[name]

    return own_kernels, step


def energy_of(model: Model, state: State) -> float:
    """T + V [J]."""
    q, v = np.array(state.q), np.array(state.w)
    return float(calls["kinetic_energy"](model, q, v) + calls["potential_energy"](model, q))


def beside(
    recorder: Recorder,
    control: Control | None,
    work: tuple[Argument, ...],
    resist: Callable[..., Array] | None,
    fext: Array | None,
) -> Callable[[int, Array, Array, Array, Array], tuple[Array, Array]]:
    """``(step, q, v, states, tau) -> tau of all that acts, rates of the states``, flat, for SciPy's methods."""
    model, carried = recorder.model, recorder.carried
    laws = None if control is None else law_in_floats(control, model, recorder.steps.total)
    names = [x.name for x in carried.arguments]
    pull = spring_kernel() if has_springs(model) else None

    def rates(step: int, q: Array, v: Array, x: Array, tau: Array) -> tuple[Array, Array]:
        found: dict[str, Array] = {}
        if laws is not None:
            wanted, found = laws(step, recorder.steps.dt)(q, v, tau, dict(zip(names, carried.views(x), strict=True)))
            tau = tau + wanted
        found[works.TORQUE.name] = tau * v
        if fext is not None and work:
            found[works.EXTERNAL.name] = external(model, q, fext) * v
        if resist is not None:
            friction = resist(getattr(model, numba_kernels.TABLE), v)
            found[works.FRICTION.name] = friction * v
            tau = tau + friction
        if pull is not None:
            pulled = pull(getattr(model, numba_kernels.TABLE), q, v)
            found[works.SPRINGS.name] = pulled * v
            tau = tau + pulled
        return tau, np.concatenate([np.empty(0), *(found[name].ravel() for name in names)])

    return rates
