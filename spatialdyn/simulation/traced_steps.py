"""A step of a method of ``explicit`` as Specs, which are recorded: with a law, friction, constraints, contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..bodies.kinds import R1
from ..engines.programs.tracer import scratch
from ..recursions.aba import WORK, aba
from ..recursions.configuration import integrate
from ..recursions.friction import DT
from ..recursions.spec import TAU, Argument, Q, Spec, V
from . import contact_steps, explicit
from .constrained import Rows
from .friction_steps import COLUMNS, OWN, SMOOTH, smooth_torque, traced_step
from .system import OK, State, System, held_torque

EXPLICIT_METHODS: dict[str, Callable[..., None]] = {
    "explicit_euler": explicit.explicit_euler,
    "semi_implicit_euler": explicit.semi_implicit_euler,
    "velocity_verlet": explicit.velocity_verlet,
    "rk4": explicit.rk4,
}
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


@cache
def step_specs(
    method: str,
    law: bool,
    forced: bool,
    held: tuple[Argument, ...] = (),
    way: str | None = None,
    coefficients: tuple[str, ...] = (),
    touch: tuple[Argument, ...] = (),
) -> tuple[Spec, ...]:
    """Specs of the positions and of the velocities after a step, as functions of the state, dt, tau and the law.

    held               the inputs of constraints, as ``Held`` has them
    way, coefficients  of friction; its own state comes third, in inputs and among the Specs
    touch              the state that contacts carry, which comes third too, then their inputs
    """

    def after(rows: Any, inputs: dict[str, Any]) -> tuple[Any, ...]:
        q, v = inputs["q"].copy(), inputs["v"].copy()
        tau = inputs["tau"].copy() if forced else np.zeros(len(v), object)
        if law:
            error = np.zeros(len(v), object)
            for i, row in enumerate(rows[1:]):
                if row.kind in R1:
                    error[i] = inputs["q_ref"][row.q_index] - q[row.q_index]
            tau = tau + inputs["kp"] * error + inputs["kd"] * (inputs["v_ref"] - v)
        if way in OWN:
            v, own = traced_step(way, rows, inputs, tau)
            moved = np.array([inputs["dt"] * x for x in v], object)
            integrate(rows, inputs["q"], moved, q)
            return q, v, own

        if touch:
            resisted = tau + smooth_torque(rows, v, inputs) if way == SMOOTH else tau
            v, own = contact_steps.traced_step(touch[0], rows, inputs, resisted)
            moved = np.array([inputs["dt"] * x for x in v], object)
            integrate(rows, inputs["q"], moved, q)
            return q, v, own

        def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
            return _accelerate(system._replace(tau=tau + smooth_torque(rows, v, inputs)), q, v, a)

        under = Rows(rows, inputs) if held else None
        free = accelerate if way == SMOOTH else _accelerate
        system = System(
            _Kernels(free if under is None else under.accelerate, _integrate, _displacement_rate),
            held_torque,
            None,
            rows,
            None,
            None,
            None,
            None,
            tau,
            None,
        )
        state = State(q, v, v, q.copy(), None, np.zeros((10, len(v)), object))
        EXPLICIT_METHODS[method](system, 0.0, inputs["dt"], state)
        if under is not None:
            under.project(state.q, state.w)
        return state.q, state.w

    own = [OWN[way]] if way in OWN else [*touch[:1]]
    given = (Q, V, *own, DT, *((TAU,) if forced else ()), *(LAW if law else ()), *(COLUMNS[x] for x in coefficients))
    given = tuple(replace(x, optional=False) for x in (*given, *held, *touch[1:]))
    names = [x.name for x in given]

    def state_after(k: int) -> Callable[..., None]:
        def recursion(rows: Any, *arrays: Any) -> None:
            arrays[-1][:] = after(rows, dict(zip(names, arrays, strict=False)))[k]

        return recursion

    label = "_".join(["rollout", method, *([way] if way else []), *(x.name for x in touch[:1])])
    return tuple(
        Spec(
            f"{label}_{x.name}", state_after(k), None, given, replace(x, name=f"{x.name}_after", unit_norm=False),
            "A step of a rollout.", "see explicit", regroup=True,
        )
        for k, x in enumerate((Q, V, *own))
    )  # fmt: skip
