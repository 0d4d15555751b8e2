"""Steps whose velocities and impulses are found together: contacts, limits, dry joints, constraints, in one.

The step is one source for recorded numbers, which become programs, and for floats, where it calls a kernel: inputs by
name go in, the parts of a Spec by name come out. Contacts and limits alone are a ``contact_step``; with friction that
is solved for, or under constraints, they are an ``impulse_step``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import exceeds, select
from ..calls.dynamics import calls
from ..constraints.dynamics import constraint_jacobian
from ..engines import run
from ..engines.compiled import numba_kernels
from ..engines.programs.mimic_rows import rows_of
from ..engines.programs.tracer import scratch, table
from ..errors import ConstraintError
from ..model.model import Model
from ..recursions.constraint_rows import CONSTRAINTS_ARGUMENT
from ..recursions.contact import CONTACT_STEP, CONTACT_STEP_OVER
from ..recursions.contact_rows import CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION
from ..recursions.friction import BRISTLES
from ..recursions.impulse_step import impulse_step_spec
from ..recursions.spec import Argument, Spec, shape_in, sizes_of
from . import works
from .constrained import Held, Rows, check_rank, motion_under
from .contact_steps import RECORDED, WORST, Touching
from .friction_steps import LUGRE, Rubbing, geared, law_of, rubbed_by, smooth_kernel
from .springs import spring_kernel
from .system import State, System, set_status

Array = NDArray[Any]
Solved = tuple[Any, dict[str, Any], dict[str, Any]]
CONTRADICTS = 1e-4  # of the motion: what no step leaves of equations that agree, whose velocities are h³ off


def spec_of(way: str | None, over: bool, held: bool, steadied: bool, pushed: bool = False) -> Spec:
    """The Spec of a step.

    way       of friction that is solved for, None for none
    over      whether there are heights
    held      whether there are constraints
    steadied  whether those have a time of stabilization
    pushed    whether external forces act
    """
    if way is None and not held:
        return CONTACT_STEP_OVER if over else CONTACT_STEP
    has = {"heights": over, "friction": way, "bristles": way == LUGRE, "constraints": held, "rate": steadied}
    return impulse_step_spec(frozenset(name for name, x in {**has, "fext": pushed}.items() if x))


def solved_step(
    solve: Callable[[dict[str, Any]], dict[str, Any]], own: Argument, way: str | None, given: Mapping[str, Any],
    tau: Any, torques: Mapping[str, Any],
) -> tuple[Any, dict[str, Any], dict[str, Any], dict[str, Any]]:  # fmt: skip
    """The velocities after a step, states after it by name, forces as ``carry_solved`` takes them, all parts by name.

    solve    parts of the step's Spec by name, from its inputs by name
    own      the state that contacts carry
    given    inputs of the run by name
    torques  beside tau, by the names of their states of work: of smooth friction, springs, external forces
    """
    v, forces, law = given["v"], dict(torques), None
    push, lost = tau, None
    if way is not None:
        push, law = geared(dict(given), v, tau, law_of(dict(given)))
        lost = push - tau if push is not tau else None
    for x in torques.values():
        push = push + x
    inputs = {**given, "tau": push}
    if law is not None:
        inputs |= dict(zip(("coulomb", "viscous", "static", "stribeck"), law, strict=True))
    parts = solve(inputs)
    after, residual, before = parts["v"], parts["residual"], given[own.name]
    now, which = (residual[0], 0.0) if len(residual) else (0.0, 0.0)
    for k, x in enumerate(residual[1:], 1):
        more = x - now
        now, which = select(more, x, now), select(more, float(k), which)
    _, worst, at, step, count = before[:WORST]
    more = now - worst
    row = [now, select(more, now, worst), select(more, which, at), select(more, count, step), count + 1.0]
    row += [*parts["impulse"], *parts["stop"]] if own.name == RECORDED.name else []
    states = {own.name: np.array(row, after.dtype)}
    if works.CONTACTS.name in given:
        states[works.CONTACTS.name] = given[works.CONTACTS.name] + parts["energy"]
    if law is not None and way is not None:
        if way == LUGRE:
            states[BRISTLES.name] = parts["bristles"]
        made = rubbed_by(way, dict(given), law, after, parts["bristles" if way == LUGRE else "friction"])
        forces[works.FRICTION.name] = made if lost is None else made + lost
    return after, states, forces, parts


# --- on recorded numbers --------------------------------------------------------------------------------


def traced(
    touch: tuple[Argument, ...], rows: Any, given: dict[str, Any], tau: Any, way: str | None, under: Rows | None,
    torques: Mapping[str, Any],
) -> Solved:  # fmt: skip
    """The velocities after a step, states after it by name, forces that do work; ``given`` inputs by name.

    touch    the state that contacts carry, then their inputs
    way      of friction that is solved for, None for none
    torques  as of ``solved_step``
    """
    over = any(x.name == HEIGHTS_ARGUMENT.name for x in touch)
    spec = spec_of(way, over, under is not None, under is not None and under.rate is not None)
    tables = [(CONTACTS_ARGUMENT, given[CONTACTS_ARGUMENT.name])]
    if under is not None:
        tables.append((CONSTRAINTS_ARGUMENT, under.constraints))
    sizes = sizes_of(rows, tables)

    def solve(inputs: dict[str, Any]) -> dict[str, Any]:
        known = {MU.name: np.zeros(0, object), RESTITUTION.name: np.zeros(0, object), **inputs}
        made = {x.name: np.full(shape_in(x.shape, sizes), 0.0, object) for x in spec.parts}
        more = [np.full(shape, 0.0, object) for shape in spec.extra_outputs(sizes)]
        taken = [None if x is None else known[x.name] for x in spec.inputs]
        spec.recursion(rows, scratch(spec.work, len(rows)), *taken, *made.values(), *more)
        return made

    after, states, forces, parts = solved_step(solve, touch[0], way, given, tau, torques)
    if under is not None:
        force = np.array([x / given["dt"] for x in parts["reaction"]], object)
        forces[works.CONSTRAINTS.name] = lambda way: force * under.rates(given["q"], way)
        residual, rank = parts["missed"]
        off = rank - under.rank
        under.wrong = under.wrong + exceeds(residual, CONTRADICTS) + exceeds(off * off, 0.5)
    return after, states, forces


# --- by kernels -----------------------------------------------------------------------------------------


def external(model: Model, q: Array, fext: Array) -> Array:
    """Jᵀ f (nv) of external forces [N m | N]."""
    q = np.array(q)
    made: Array = calls["generalized_gravity"](model, q) - calls["static_torque"](model, q, fext)
    return made


def solver(
    found: Touching, fext: Array | None, rubs: Rubbing | None, held: Held | None, springs: bool, once: bool = False
) -> Callable[..., Solved]:
    """``(system, t, h, state, own) -> v⁺, states after by name, forces that do work``, as ``traced``.

    own   states at the beginning by name. It raises ConstraintError.
    once  whether it is for one step, which the recursion takes in plain Python rather than compile its kernel
    """
    contacts, model, way = found.contacts, found.contacts.model, found.way
    general = way is not None or held is not None
    rate = None if held is None else held.rate
    spec = spec_of(way, len(found.tables) > 1, held is not None, rate is not None, general and fext is not None)
    once = once or model.mimic_matrix is not None  # whose reduced recursions have no table kernel
    kernel = None if once else numba_kernels.sample_kernel(spec)
    rows = rows_of(table(model.bodies)) if once else None
    tables = {CONTACTS_ARGUMENT.name: found.table, HEIGHTS_ARGUMENT.name: found.tables[-1]}
    sizes: dict[str, int] = {"nv": model.nv, **found.table.sizes}
    if held is not None:
        tables[CONSTRAINTS_ARGUMENT.name] = held.constraints.table
        sizes |= held.constraints.table.sizes
    fixed: dict[str, Any] = {name: x.rows if once else getattr(x, run.STATIC) for name, x in tables.items()}
    fixed |= {MU.name: contacts.friction, RESTITUTION.name: contacts.restitution, "rate": rate, "fext": fext}
    if rubs is not None:
        fixed |= dict(zip(rubs.inputs, rubs.values, strict=True))
    width = shape_in(spec.output.shape, sizes)
    resist = smooth_kernel(rubs) if rubs is not None and way is None else None
    pull = spring_kernel() if springs else None

    def solve(system: System, t: float, h: float, state: State, own: Mapping[str, Any]) -> Solved:
        def answer(inputs: dict[str, Any]) -> dict[str, Any]:
            out = np.empty(width)
            parts = dict(zip((x.name for x in spec.parts), spec.split(out, sizes), strict=True))
            if kernel is not None:
                set_status(system, kernel(system.table, *(inputs[x.name] for x in spec.present), out), t)
            else:
                more = [np.empty(shape) for shape in spec.extra_outputs({"nq": model.nq, **sizes})]
                taken = [None if x is None else inputs[x.name] for x in spec.inputs]
                spec.recursion(rows, scratch(spec.work, model.nv + 1), *taken, *parts.values(), *more)
            return parts

        torques = {}
        if resist is not None:
            torques[works.FRICTION.name] = resist(system.table, state.w)
        if pull is not None:
            torques[works.SPRINGS.name] = pull(system.table, state.q, state.w)
        if fext is not None and not general:
            torques[works.EXTERNAL.name] = external(model, state.q, fext)
        given = {**fixed, **own, "q": state.q, "v": state.w, "dt": h}
        after, states, forces, parts = solved_step(answer, found.own, way, given, system.tau, torques)
        if held is not None:
            _judge(held, parts["missed"], system, state)
            force, J = parts["reaction"] / h, constraint_jacobian(model, held.constraints, np.array(state.q))
            forces[works.CONSTRAINTS.name] = lambda way: force * (J @ way)
        return after, states, forces

    return solve


def _judge(held: Held, missed: Array, system: System, state: State) -> None:
    """Raise ConstraintError where equations contradict others, or their rank changes."""
    residual, rank = missed
    if residual > CONTRADICTS:
        motion_under(held, held.constraints.model)(system, state.q, state.w)  # raises with the equations' names
        raise ConstraintError(
            f"equations of {', '.join(x.label for x in held.constraints)} contradict each other by {residual:.2g} of "
            "the motion, expected fewer constraints, or a state that meets them"
        )
    if np.isfinite(rank):
        check_rank(held, int(rank), int(held.rank[0]))
