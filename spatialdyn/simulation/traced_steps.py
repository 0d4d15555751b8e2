"""A step of a method of ``explicit`` as Specs, which are recorded: with a law, friction, constraints, contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..engines.programs.tracer import scratch
from ..recursions.aba import WORK, aba
from ..recursions.configuration import integrate
from ..recursions.friction import DT
from ..recursions.spec import TAU, Argument, Q, Spec, V
from . import explicit, solved_steps, works
from .carried import Acting, carry, carry_solved
from .constrained import Rows
from .control_laws import inputs_of, law_on, moved_states, states_of
from .friction_steps import COLUMNS, IMPLICIT, OWN, SMOOTH, smooth_torque, traced_step
from .methods import EXPLICIT_METHODS
from .rollout_result import with_pd
from .springs import traced_springs
from .system import OK, State, System, held_torque

LAW = (
    Argument("kp", ("nv",), "N m/rad | N/m", "gains of position"),
    Argument("kd", ("nv",), "N m s/rad | N s/m", "gains of velocity"),
    Argument("q_ref", ("nq",), "rad | m", "positions to reach"),
    Argument("v_ref", ("nv",), "rad/s | m/s", "velocities to reach"),
)


class _Kernels(NamedTuple):
    """The functions that the methods call: the recursions themselves, on rows of a table."""

    accelerate: Callable[..., int]
    integrate: Callable[..., int]
    displacement_rate: Callable[..., int]


def _accelerate(system: System, q: Any, v: Any, a: Any) -> int:
    n = len(a)
    aba(system.table, scratch(WORK, n + 1), q, v, system.tau, None, a, np.zeros(n, object))
    return OK


def _integrate(rows: Any, q: Any, v: Any, out: Any) -> int:
    integrate(rows, q, v, out)
    return OK


def _displacement_rate(rows: Any, u: Any, v: Any, out: Any) -> int:
    explicit.rate_of_displacement(rows, u, v, out)
    return OK


def carried_by(
    way: str | None, control: Spec | None, work: tuple[Argument, ...], touch: tuple[Argument, ...] = ()
) -> tuple[Argument, ...]:
    """The states that a step carries, in their order: of friction or contacts, of a control law, of work."""
    bends = way in OWN and not (touch and way == IMPLICIT)  # of dry joints the residual has the violation
    first = [*touch[:1], *([OWN[way]] if bends else [])]  # type: ignore[index]
    return (*first, *(() if control is None else states_of(control)), *work)


@lru_cache(maxsize=256)  # laws come and go
def step_specs(
    method: str,
    law: bool,
    forced: bool,
    held: tuple[Argument, ...] = (),
    way: str | None = None,
    coefficients: tuple[str, ...] = (),
    control: Spec | None = None,
    held_law: bool = False,
    work: tuple[Argument, ...] = (),
    touch: tuple[Argument, ...] = (),
) -> tuple[Spec, ...]:
    """Specs of the positions, the velocities and the states carried after a step, by states, dt, tau and the law.

    held  the inputs of constraints, as ``Held`` has them

    way, coefficients  of friction
    control, held_law  the Spec of a ``Control``, and whether its torque is held over the step
    work               the states of the work that is recorded, of ``ledger``
    touch              the state that contacts carry, then their inputs

    The states carried (of friction or contacts, of the control law, of work) come third, in inputs and among the Specs.
    """
    own = carried_by(way, control, work, touch)
    moving = (*(() if control is None else moved_states(control)), *(x.name for x in work if x != works.PROJECTION))

    def after(rows: Any, inputs: dict[str, Any]) -> tuple[Any, ...]:
        q, v = inputs["q"].copy(), inputs["v"].copy()
        tau = inputs["tau"].copy() if forced else np.zeros(len(v), object)
        if law:
            tau = with_pd(rows, q, v, inputs, tau)
        under = Rows(rows, inputs) if held else None

        def free(system: System, q: Any, v: Any, a: Any) -> tuple[int, dict[str, Any]]:
            powers = {works.TORQUE.name: system.tau * v}
            if way == SMOOTH:
                friction = smooth_torque(rows, v, inputs)
                powers[works.FRICTION.name] = friction * v
                system = system._replace(tau=system.tau + friction)
            pull = traced_springs(rows, q, v)
            if pull is not None:
                powers[works.SPRINGS.name] = pull * v
                system = system._replace(tau=system.tau + pull)
            (_accelerate if under is None else under.accelerate)(system, q, v, a)
            if under is not None and works.CONSTRAINTS in work:
                powers[works.CONSTRAINTS.name] = under.force * under.rates(q, v)
            return OK, powers

        def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
            return free(system, q, v, a)[0]

        def project(q: Any, v: Any, carried: dict[str, Any]) -> None:
            """Project onto the constraints, if there are any, and count what that adds."""
            if under is None:
                return
            before = under.energy(q, v) if works.PROJECTION in work else None
            under.project(q, v, not touch)
            if before is not None:
                name = works.PROJECTION.name
                carried[name] = carried[name] + (under.energy(q, v) - before)

        law_now = None if control is None else law_on(control, rows, inputs)
        acting = Acting(free, law_now, held_law, moving)
        carried = {x.name: inputs[x.name] for x in own}
        if way in OWN or touch:

            def solve(tau: Any) -> Any:
                pull = traced_springs(rows, inputs["q"], inputs["v"])
                springs = {} if pull is None else {works.SPRINGS.name: pull}
                if touch:
                    rubbed = {works.FRICTION.name: smooth_torque(rows, v, inputs)} if way == SMOOTH else {}
                    solved_for = way if way in OWN else None
                    return solved_steps.traced(touch, rows, inputs, tau, solved_for, under, {**rubbed, **springs})
                after, changed, forces = traced_step(str(way), rows, inputs, tau, under, pull)
                return after, changed, {**forces, **springs}

            v, carried = carry_solved(solve, inputs["dt"], q, v, tau, carried, acting)
            moved = np.array([inputs["dt"] * x for x in v], object)
            integrate(rows, inputs["q"], moved, q)
            project(q, v, carried)
            return q, v, *(carried[x.name] for x in own)

        kernels = _Kernels(accelerate, _integrate, _displacement_rate)
        system = System(kernels, held_torque, None, rows, None, None, None, None, tau, None)
        state = State(q, v, v, q.copy(), None, np.zeros((10, len(v)), object))
        if control is not None or work:
            carried = carry(EXPLICIT_METHODS[method], system, 0.0, inputs["dt"], state, carried, acting)
        else:
            EXPLICIT_METHODS[method](system, 0.0, inputs["dt"], state)
        project(state.q, state.w, carried)
        return state.q, state.w, *(carried[x.name] for x in own)

    given = (Q, V, *own, DT, *((TAU,) if forced else ()), *(LAW if law else ()), *(COLUMNS[x] for x in coefficients))
    others = () if control is None else inputs_of(control)
    given = (*(replace(x, optional=False) for x in given), *held, *touch[1:], *others)
    names = [x.name for x in given]

    def state_after(k: int) -> Callable[..., None]:
        def recursion(rows: Any, *arrays: Any) -> None:
            arrays[-1][:] = after(rows, dict(zip(names, arrays, strict=False)))[k]

        return recursion

    label = "_".join(["rollout", method, *([way] if way else []), *(x.name for x in touch[:1])])
    return tuple(
        Spec(
            f"{label}_{x.name}", state_after(k), None, given, replace(x, name=f"{x.name}_after", unit_norm=False),
            "A step of a rollout.", "see explicit", regroup=control is None or control.regroup, composed=True,
        )
        for k, x in enumerate((Q, V, *own))
    )  # fmt: skip
