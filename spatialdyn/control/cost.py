"""Costs of motions: a Spec of one number, which a rollout sums in the program of its steps.

The sum is a state of the control law: a law and a cost become one law with the sum as an additional state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from ..errors import SimulationError
from ..recursions.joints.friction import DT
from ..recursions.spec import TAU, Argument, Q, Spec, V
from .control import Control, shown
from .law_specs import (
    AFTER,
    OF_STEP,
    begun_of,
    check_recordable,
    evaluated,
    given_by_step,
    in_step,
    law_on,
    with_values,
)

COST = "cost"
OWN = "cost."  # prefix of the names of a cost's inputs in the law that contains it
UNWRITTEN = float("0")  # a distinct object, which stays if a cost writes nothing


class Cost:
    """A cost of a rollout: a Spec of one number, summed over the steps, and values of its inputs.

    spec    Spec whose output is one number. Its inputs are any of q, v, tau (the argument torque and the control law's)
            at the beginning of a step, dt (the step), and others
    values  {name: array} of the others: of the input's shape, with an axis of steps before it, or with axes of samples
            and steps

    The caller adds the cost of the last state, from ``run.q`` and ``run.v``. Steps with a cost are another program than
    steps without, so motions may differ in their last bits.
    Raises  SimulationError as ``Control``, and for a Spec of several numbers or with states; in ``rollout`` for a
            recursion that writes no number

    >>> import numpy as np, spatialdyn as sd
    >>> from spatialdyn.recursions.spec import TAU, Argument, Q, Spec
    >>> def effort(bodies, q, tau, goal, cost):
    ...     cost[0] = sum((x - y) * (x - y) + 1e-3 * t * t for x, y, t in zip(q, goal, tau))
    >>> inputs = (Q, TAU, Argument("goal", ("nq",), "rad", "where to go"))
    >>> law = Spec("effort", effort, None, inputs, Argument("cost", (1,), "", "of a step"), "", "")
    >>> torques = np.random.default_rng(0).normal(size=(1024, 50, 2))
    >>> goal = sd.Cost(law, {"goal": [0.5, 0.2]})
    >>> run = sd.rollout(sd.load_urdf("two_link"), [0, 0], [0, 0], torques, dt=0.01, cost=goal)
    >>> run.cost.shape, run.q.shape
    ((1024,), (1024, 2))
    """

    def __init__(self, spec: Spec, values: Mapping[str, Any] | None = None) -> None:
        """Check the Spec, and keep copies of the values."""
        check_recordable(spec)
        if spec.parts or spec.states or spec.output.shape not in ((), (1,)):
            states = f" and the states {', '.join(x.name for x in spec.states)}" if spec.states else ""
            what = ", ".join(f"{x.name} {x.shape}" for x in spec.parts or (spec.output,))
            raise SimulationError(
                f'spec "{spec.name}" has the outputs {what}{states}, expected one number and no states'
            )
        self.spec, self.values, self.static = with_values(spec, values)

    def __repr__(self) -> str:
        return f"<Cost: {self.spec.name}>"


def check_cost(cost: Any) -> Cost:
    """The argument ``cost``. Raises SimulationError for anything but a Cost or None."""
    if not isinstance(cost, Cost):
        raise SimulationError(f"cost is {shown(cost)}, expected a Cost or None: sd.Cost(spec, values)")
    return cost


def is_of_cost(name: str) -> bool:
    """Whether an input of a law belongs to a cost in the law."""
    return name.startswith(OWN)


def with_cost(control: Control | None, cost: Cost) -> Control:
    """A control law with the sum of a cost as an additional state; without a law its torque is 0."""
    made: Control = Control.__new__(Control)
    made.spec = _summed(None if control is None else control.spec, cost.spec)
    made.held = control is not None and control.held
    made.values = {**({} if control is None else control.values), **{OWN + x: y for x, y in cost.values.items()}}
    made.static = (*(() if control is None else control.static), *cost.static)
    made.checks = () if control is None else control.checks
    made.smooth, made.periods = (False, ()) if control is None else (control.smooth, control.periods)
    return made


@lru_cache(maxsize=64)
def _summed(law: Spec | None, cost: Spec) -> Spec:
    own = () if law is None else tuple(x for x in law.present if x.name not in given_by_step(law))
    early = () if law is None else tuple(x for x in law.present if x.name in begun_of(law))
    total = Argument(COST, (1,), cost.output.unit, "sum of the cost over the steps", start=0.0)
    further = tuple(replace(x, name=OWN + x.name, unit_norm=False) for x in cost.present if x.name not in OF_STEP)
    inputs = (*(replace(x, unit_norm=False) for x in (Q, V, TAU)), DT, *early, *own, total, *further)
    ends = () if law is None else law.parts[1:]

    def recursion(rows: Any, *arrays: Any) -> None:
        given = dict(zip((x.name for x in inputs), arrays, strict=False))
        tau, *parts, after = arrays[len(inputs) :]
        if law is not None:
            named = given | {in_step(x.name): given[x.name] for x in own}
            tau[:], made = law_on(law, rows, named)(given[Q.name], given[V.name], given[TAU.name], {})
            for part, x in zip(parts, law.states, strict=True):
                part[:] = made[in_step(x.name)]
        known = {x.name: given[x.name if x.name in OF_STEP else OWN + x.name] for x in cost.present}
        if TAU.name in known:
            known[TAU.name] = given[TAU.name] + tau
        (of_step,) = evaluated(cost, rows, (1,), known, UNWRITTEN)
        if of_step is UNWRITTEN:
            what = f"{cost.output.name}[0]"
            raise SimulationError(f'recursion of spec "{cost.name}" does not write {what}, expected the cost of a step')
        after[0] = given[COST][0] + of_step

    parts = (TAU, *ends, Argument(COST + AFTER, (1,), cost.output.unit, total.meaning))
    name = cost.name if law is None else f"{law.name}_{cost.name}"
    regroup = cost.regroup and (law is None or law.regroup)
    return Spec(name, recursion, None, inputs, TAU, "A law and the sum of a cost.", "", parts=parts, regroup=regroup)
