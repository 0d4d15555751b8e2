"""A step of a run with all effects: one source for recorded numbers and for floats.

The methods of ``explicit`` integrate a state with a rate together with v: they move w = (v, states) by its derivative,
so the state has the order of the method. Other states change at the end of a step. If an effect finds the velocities
after a step (contacts, dry friction), the step is that of ``semi_implicit_euler`` with these velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..recursions import SPECS
from ..recursions.joints.friction import DT
from ..recursions.spec import FEXT, TAU, Argument, Q, Spec, V
from .arithmetic import Arithmetic, Recorded
from .effects import work
from .effects.constraints import Constrained
from .effects.contacts import Contact
from .effects.control import Feedback
from .effects.effect import Effect, find, torques_of
from .effects.external import external_torque
from .methods import explicit
from .methods.call_kernels import kernels_of
from .methods.methods import EXPLICIT, EXPLICIT_METHODS
from .system import OK, State, System, held_torque

Power = Mapping[str, Any]
Works = tuple[Argument, ...]


def advance(
    acting: tuple[Effect, ...], works: Works, at: Any, method: Callable[..., None], system: System, t: Any, h: Any,
    state: State, own: Power,
) -> Power:  # fmt: skip
    """A step of a method of ``explicit``: moves q and w of the state; returns the states carried after it, by name.

    works  the states of work that are recorded
    own    the states carried at the beginning, by name
    """
    feedback, constrained = find(acting, Feedback), find(acting, Constrained)
    free = partial(free_of, acting, works, at, system.kernels)
    law = None if feedback is None else feedback.law(at)
    moving = (*(() if feedback is None else feedback.integrated), *(x.name for x in works if x != work.PROJECTION))
    whole = Acting(free, law, feedback is not None and feedback.held, moving)
    solver = next((x for x in reversed(acting) if x.solves), None)
    after: Power = own
    if constrained is not None:
        constrained.begin(at, state.q)
    if solver is not None:
        system.torque(system, t, state.q, state.w)
        at.given.update(own, q=state.q.copy(), v=state.w.copy(), dt=h)

        def solve(tau: Any) -> Any:
            ahead, changed, forces = solver.solve(at, acting, tau)
            if work.EXTERNAL in works and work.EXTERNAL.name not in forces:
                forces[work.EXTERNAL.name] = external_torque(at, at.given["q"])
            return ahead, changed, forces

        # contacts are solved for in the axes at the beginning, friction of joints alone in those that turn
        turning = np.zeros(len(state.w), state.w.dtype) if find(acting, Contact) is not None else state.w.copy()
        state.w[:], after = carry_solved(solve, h, state.q, state.w, system.tau.copy(), own, whole)
        explicit.move_turned(system, t, h, turning, state)
    elif own or law is not None:
        after = carry(method, system, t, h, state, own, whole)
    else:
        method(system._replace(kernels=system.kernels._replace(accelerate=lambda *x: free(*x)[0])), t, h, state)
    if constrained is not None and constrained.projects:
        before = energy_of(at, state) if work.PROJECTION in works else None
        constrained.project(at, system, t, state.q, state.w, find(acting, Contact) is None)
        if before is not None:
            name = work.PROJECTION.name
            after = {**after, name: after[name] + (energy_of(at, state) - before)}
    if constrained is not None:
        at.end(state.w)
    return after


def free_of(
    acting: tuple[Effect, ...], works: Works, at: Any, kernels: Any, system: System, q: Any, v: Any, a: Any
) -> tuple[int, Power]:
    """Write the acceleration of all effects but the control law; returns a status, and powers by states of work."""
    tau, powers = driven(acting, works, at, q, v, system.tau)
    constrained = find(acting, Constrained)
    if constrained is None:
        return kernels.accelerate(system._replace(tau=tau, kernels=kernels), q, v, a), powers
    force = constrained.accelerate(at, q, v, tau, a)
    if work.CONSTRAINTS in works:
        powers[work.CONSTRAINTS.name] = force * constrained.rates(at, q, v)
    return OK, powers


def driven(acting: tuple[Effect, ...], works: Works, at: Any, q: Any, v: Any, tau: Any) -> tuple[Any, dict[str, Any]]:
    """tau plus the torques of all effects but the control law, and powers by names of states of work."""
    powers = {work.TORQUE.name: tau * v}
    if work.EXTERNAL in works:
        powers[work.EXTERNAL.name] = external_torque(at, q) * v
    for effect, made in torques_of(acting, at, q, v):
        tau = tau + made
        powers |= {} if effect.work is None else {effect.work.name: made * v}
    return tau, powers


def energy_of(at: Arithmetic, state: State) -> Any:
    """T + V [J], up to a constant."""
    (T,) = at.evaluate(SPECS["kinetic_energy"], q=state.q, v=state.w).values()
    (U,) = at.evaluate(SPECS["potential_energy"], q=state.q).values()
    return T + U


# --- states that are carried ----------------------------------------------------------------------------


class Acting(NamedTuple):
    """The functions of a step that carries states.

    free        ``(system, q, v, a) -> status, powers``: writes the acceleration of all effects but the law; powers by
                name of states of work
    law         ``(q, v, tau, states) -> tau, made``: the control law, or None; made has the rates or ends of its states
    held        whether the law's torque at the beginning of the step is held over it
    integrated  names of the states that have rates
    """

    free: Callable[[System, Any, Any, Any], tuple[int, Power]]
    law: Callable[[Any, Any, Any, Power], tuple[Any, Power]] | None
    held: bool
    integrated: tuple[str, ...]


def carry(
    advance: Callable[..., None], system: System, t: Any, h: Any, state: State, own: Power, acting: Acting
) -> dict[str, Any]:
    """A step of a method of ``explicit``: moves q and w of the state, and returns the states after it, by name.

    own  the states at the beginning, by name
    """
    n, kernels, torque = len(state.w), system.kernels, system.torque
    ends, at = {}, {}
    begun = None
    if acting.law is not None:
        torque(system, t, state.q, state.w)
        begun, made = acting.law(state.q, state.w, system.tau, own)
        ends = {name: x for name, x in made.items() if name not in acting.integrated}
    size = n
    for name in acting.integrated:
        at[name] = slice(size, size + own[name].size)
        size = at[name].stop
    w = np.concatenate([state.w, *(own[name].ravel() for name in acting.integrated)])

    def states(w: Any) -> dict[str, Any]:
        return {**own, **{name: w[part].reshape(own[name].shape) for name, part in at.items()}}

    def accelerate(system: System, q: Any, w: Any, a: Any) -> int:
        v, tau = w[:n], system.tau
        rates: Power = {}
        if acting.law is not None:
            wanted, rates = acting.law(q, v, tau, states(w))
            tau = tau + (begun if acting.held else wanted)
        code, powers = acting.free(system._replace(tau=tau, kernels=kernels), q, v, a[:n])
        for name, part in at.items():
            a[part] = powers[name] if name in powers else rates[name]
        return code

    def moved(table: Any, q: Any, u: Any, out: Any) -> int:
        code: int = kernels.integrate(table, q, u[:n], out)
        return code

    def turning(table: Any, u: Any, w: Any, out: Any) -> int:
        code: int = kernels.displacement_rate(table, u[:n], w[:n], out[:n])
        return code

    def turned(table: Any, steps: Any, v: Any, w: Any, u: Any) -> int:
        code: int = kernels.turn(table, steps[:n], v[:n], w[:n], u[:n])
        return code

    def drive(system: System, t: float, q: Any, w: Any) -> None:
        torque(system, t, q, w[:n])

    wide = kernels._replace(accelerate=accelerate, integrate=moved, displacement_rate=turning, turn=turned)
    both = State(state.q, w, w, state.stage, None, np.zeros((10, size), w.dtype))
    advance(system._replace(kernels=wide, torque=drive), t, h, both)
    state.w[:] = w[:n]
    return {**states(w), **{name: x.reshape(own[name].shape) for name, x in ends.items()}}


def times(h: Any, x: Any) -> Any:
    """h x for an array x: a recorded number times an array does not give an array."""
    return np.array([h * y for y in x.flat], x.dtype).reshape(x.shape)


def carry_solved(
    solve: Callable[[Any], tuple[Any, dict[str, Any], Any]], h: Any, q: Any, v: Any, tau: Any, own: Power,
    acting: Acting,
) -> tuple[Any, dict[str, Any]]:  # fmt: skip
    """A step that solves for velocities and friction together: v⁺, and the states after it, by name.

    solve  ``tau -> v⁺, states of friction, forces``; the forces that do work, by the names of their states of work, are
           torques, or functions of the displacement h (v + v⁺)/2 that return the work

    A law acts by its torque at the beginning. An impulse h f that changes v to v⁺ does the work h f (v + v⁺)/2, which
    is exact for a constant mass matrix.
    """
    made: Power = {}
    if acting.law is not None:
        wanted, made = acting.law(q, v, tau, own)
        tau = tau + wanted
    after, solved, forces = solve(tau)
    found = {**own, **solved}
    for name, x in made.items():
        x = x.reshape(own[name].shape)
        found[name] = own[name] + times(h, x) if name in acting.integrated else x
    way = times(0.5 * h, v + after)
    for name, force in {work.TORQUE.name: tau, **forces}.items():
        if name in own:
            found[name] = own[name] + (force(way) if callable(force) else force * way)
    return after, found


# --- recorded -------------------------------------------------------------------------------------------


@lru_cache(maxsize=256)  # bounded, because callers may make new laws in a loop
def step_specs(
    method: str, acting: tuple[Effect, ...] = (), works: Works = (), forced: bool = True, called: bool = False
) -> tuple[Spec, ...]:
    """Specs of the positions, velocities and carried states after a step, with inputs states, dt, tau and of effects.

    forced  whether there is a torque tau
    called  whether inputs are in the order of ``sd.step``: q, v, tau, dt, states carried, those of effects

    The states carried come third, in other inputs and among the Specs.
    """
    own = (*(x for effect in acting for x in effect.states), *works)

    def after(rows: Any, inputs: dict[str, Any]) -> tuple[Any, ...]:
        at = Recorded(rows, dict(inputs))
        q, v = inputs["q"].copy(), inputs["v"].copy()
        tau = inputs["tau"].copy() if forced else np.zeros(len(v), object)
        for effect in acting:
            tau = effect.held_torque(at, q, v, tau)
        kernels, fext = kernels_of(at, EXPLICIT, inputs.get(FEXT.name)), inputs.get(FEXT.name)
        system = System(kernels, held_torque, None, rows, None, fext, None, None, tau, None)
        state = State(q, v, v, q.copy(), None, np.zeros((10, len(v)), object))
        owned: Power = {x.name: inputs[x.name] for x in own}
        owned = advance(acting, works, at, EXPLICIT_METHODS[method], system, 0.0, inputs["dt"], state, owned)
        return state.q, state.w, *(owned[x.name] for x in own)

    beside = (x for effect in acting for x in effect.inputs)
    first = (Q, V, TAU, DT, *own) if called else (Q, V, *own, DT, *((TAU,) if forced else ()))
    given = (*first, *beside)
    feedback = find(acting, Feedback)
    label = "_".join(["step" if called else "rollout", method, *(x.name for x in acting if x.name != "control")])
    return specs_of(label, given, (Q, V, *own), after, acting, feedback is None or feedback.spec.regroup)


def specs_of(
    label: str, given: Sequence[Argument], states: Sequence[Argument],
    after: Callable[[Any, dict[str, Any]], Sequence[Any]], acting: tuple[Effect, ...], regroup: bool,
) -> tuple[Spec, ...]:  # fmt: skip
    """Specs of the states after a step with these effects; ``after(rows, inputs by name)`` computes them all."""
    given = tuple(replace(x, optional=False) for x in given)
    names = [x.name for x in given]
    last: list[Any] = [None]  # rows, inputs and results: Specs are recorded one after another, a loop only once

    def state_after(k: int) -> Callable[..., None]:
        def recursion(rows: Any, *arrays: Any) -> None:
            known = last[0]
            if known is None or known[0] is not rows or any(x is not y for x, y in zip(known[1], arrays, strict=False)):
                known = rows, arrays[:-1], after(rows, dict(zip(names, arrays, strict=False)))
            last[0] = None if k == len(states) - 1 else known
            arrays[-1][:] = known[2][k]

        return recursion

    return tuple(
        Spec(
            f"{label}_{x.name}", state_after(k), None, given, replace(x, name=f"{x.name}_after", unit_norm=False),
            "A step of a rollout.", "see ``simulation.methods``", regroup=regroup, composed=True,
            stamped=all(x.stamped for x in acting),
        )
        for k, x in enumerate(states)
    )  # fmt: skip
