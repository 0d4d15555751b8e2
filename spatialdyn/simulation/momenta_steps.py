"""A recorded step of a method in momenta: a region of the program solves its equations, sample by sample.

Beside q and p a run carries the arrays that the method keeps from step to step (``kept``): canonical coordinates and
their charts, the remainder of the compensated sum, and increments from which the next ones are guessed. If equations
are not solved, the state after the step is NaN: kernels then run this sample and find the error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import select
from ..calls.arguments import core_shape
from ..calls.by_program import run
from ..engines.programs.record.tracer import scratch
from ..model.model import Model
from ..recursions.coordinates.configuration import integrate
from ..recursions.joints.friction import DT
from ..recursions.momenta.canonical_coordinates import (
    CENTRES,
    START,
    Z,
    chart_rate,
    from_canonical,
    recenter,
    to_canonical,
)
from ..recursions.momenta.discrete_momenta import WORK, WORK_AFTER, WORK_BEFORE, momenta_after, sum_before
from ..recursions.momenta.hamilton import WORK as HAMILTON
from ..recursions.momenta.hamilton import P, hamilton_rows, momentum_rate
from ..recursions.spec import FEXT, TAU, Argument, Q, Spec
from .effects.effect import Effect
from .methods.iteration import LARGEST, SETTLED, Sweeps
from .methods.methods import CANONICAL, DISCRETE, integrators
from .methods.symplectic import SymplecticKernels
from .methods.variational import TURN, VariationalKernels
from .steps import specs_of
from .system import OK, State, System, held_torque

Array = NDArray[Any]
UNITS = Argument("units", ("nv+nv",), "1", "weights that make freedoms and momenta comparable")
STAGES = {"implicit_midpoint": 1, "gauss4": 2, "gauss6": 3}


@lru_cache(maxsize=16)
def kept(method: str) -> dict[Argument, slice | None]:
    """The arrays that a method keeps from step to step, and their rows of a State's ``work``; None for ``by_row``."""
    if integrators[method].family is DISCRETE:
        return {Argument("displacements", (2, "nv"), "rad | m", "of the last two steps"): slice(0, 2)}
    if method not in STAGES:
        middle = Argument("middle", ("nv+nv",), "", "z where the last equations are solved")
        return {Z: slice(0, 1), CENTRES: None, middle: slice(2, 3)}
    remainder = Argument("remainder", ("nv+nv",), "", "of the compensated sum")
    increments = Argument("increments", (STAGES[method], "nv+nv"), "", "of the stages")
    return {Z: slice(0, 1), CENTRES: None, remainder: slice(1, 2), increments: slice(7, 7 + STAGES[method])}


def places(method: str, state: State) -> list[Any]:
    """Views of a State's arrays that the method keeps, each as one row."""
    centres = state.by_row[: len(state.w) + 1]
    return [(centres if at is None else state.work[at]).reshape(-1) for at in kept(method).values()]


def begun(model: Model, method: str, q: Array, p: Array) -> list[Array]:
    """The arrays (n, columns) that the method keeps, for samples that begin in states q (n, nq) and p (n, nv)."""
    first = [] if integrators[method].family is DISCRETE else run(model, START, "", [q, p], outputs=2)
    others = [*kept(method)][len(first) :]
    return [*first, *(np.zeros((len(q), math.prod(core_shape(model, x)))) for x in others)]


@lru_cache(maxsize=256)
def momenta_specs(method: str, acting: tuple[Effect, ...] = (), forced: bool = True) -> tuple[Spec, ...]:
    """As ``steps.step_specs``: Specs of q, p and what the method keeps; the last input is UNITS."""
    family, own = integrators[method].family, tuple(kept(method))
    advance = integrators[method].advance
    assert family is not None
    assert advance is not None
    beside = (x for effect in acting for x in effect.inputs)
    given = (Q, P, *own, DT, *((TAU,) if forced else ()), *beside, UNITS)

    def after(rows: Any, inputs: dict[str, Any]) -> Sequence[Any]:
        n = len(rows) - 1
        tau = inputs[TAU.name].copy() if forced else np.full(n, 0.0, object)
        fext = inputs.get(FEXT.name)
        kernels = _canonical(n) if family is CANONICAL else _discrete(n, fext)
        system = System(kernels, held_torque, None, rows, None, fext, inputs[UNITS.name], None, tau, np.zeros(3))
        work = np.full((family.rows, n * (1 + family.wide)), 0.0, object)
        q, p, by_row = inputs[Q.name].copy(), inputs[P.name].copy(), np.full((n + 1, 6), 0.0, object)
        state = State(q, p, np.full(n, 0.0, object), q.copy(), by_row, work)
        held = places(method, state)
        for x, place in zip(own, held, strict=True):
            place[:] = inputs[x.name].ravel()
        advance(system, 0.0, inputs[DT.name], state)
        if family is CANONICAL:
            from_canonical(rows, by_row, work[0], q, p)
        return q, p, *(x.reshape(inputs[y.name].shape) for x, y in zip(held, own, strict=True))

    label = "_".join(["step_in_momenta", method, *(x.name for x in acting)])
    return specs_of(label, given, (Q, P, *own), after, acting, family is CANONICAL)


# --- the recursions, as the methods call them -----------------------------------------------------------


def _end(system: System, t: Any, s: Sweeps, y: Any) -> None:
    """Set y to NaN if the iteration has failed."""
    change = s.change[0]
    solved = select(s.left[0], select(change - SETTLED, s.still[0], 1.0), select(LARGEST - change, 1.0, 0.0))
    for i in range(len(y)):
        y[i] = select(solved, y[i], math.nan)


def _field(n: int, system: System, q: Any, p: Any, rates: Any) -> int:
    still = np.full(n, 0.0, object)
    hamilton_rows(system.table, scratch(HAMILTON, system.table), q, p, still, system.fext, rates, still.copy())
    return OK


def _canonical(n: int) -> SymplecticKernels:
    return SymplecticKernels(partial(_field, n), None, to_canonical, from_canonical, chart_rate, recenter, _end)


def _discrete(n: int, fext: Any) -> VariationalKernels:
    still = np.full(n, 0.0, object)

    def load(system: System, q: Any, g: Any) -> int:
        momentum_rate(system.table, scratch(WORK, system.table), q, still, None, fext, g)
        g[:] = [-x for x in g]
        return OK

    def velocity(rows: Any, q: Any, p: Any, v: Any) -> int:
        rates = np.full((2, n), 0.0, object)
        hamilton_rows(rows, scratch(HAMILTON, rows), q, p, still, None, rates, still.copy())
        v[:] = rates[0]
        return OK

    def moved(rows: Any, q: Any, u: Any, out: Any) -> int:
        integrate(rows, q, u, out)
        return OK

    def before(rows: Any, q: Any, xi: Any, by_row: Any, out: Any) -> int:
        least = sum_before(rows, scratch(WORK_BEFORE, rows), q, xi, by_row, out)
        out[0] = select(least - TURN, out[0], math.nan)
        return OK

    def after(rows: Any, q: Any, xi: Any, by_row: Any, out: Any) -> int:
        momenta_after(rows, scratch(WORK_AFTER, rows), q, xi, by_row, out)
        return OK

    return VariationalKernels(load, None, velocity, moved, before, after, _end)
