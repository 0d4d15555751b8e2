"""A recorded step of a method in momenta: a region of the program solves its equations, sample by sample.

Beside q and p a run carries the arrays that the method keeps from step to step (``kept``): canonical coordinates and
their charts, the remainder of the compensated sum, and increments from which the next ones are guessed. If equations
are not solved, the state after the step is NaN: kernels then run this sample and find the error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import core_shape
from ..calls.by_program import run
from ..model.model import Model
from ..recursions.joints.friction import DT
from ..recursions.momenta.canonical_coordinates import CENTRES, START, Z, from_canonical
from ..recursions.momenta.hamilton import P
from ..recursions.spec import FEXT, TAU, Argument, Q, Spec
from .arithmetic import Recorded
from .effects.effect import Effect
from .methods.call_kernels import kernels_of
from .methods.methods import CANONICAL, DISCRETE, integrators
from .steps import specs_of
from .system import State, System, held_torque

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
        kernels = kernels_of(Recorded(rows, inputs), family, fext)
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
