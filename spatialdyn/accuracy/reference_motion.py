"""The reference of a motion: Gauss collocation of order 32 in double-double, with an error estimate by step halving.

The state is (q, v) with quaternions and (cos, sin) pairs as coordinates, which the exact flow keeps at unit norm. Its
rate is a program recorded from ``aba`` and ``coordinate_rate``, which ``engines.numbers.collocation`` integrates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.numbers.collocation import collocate
from ..engines.numbers.double_double import DoubleDouble, record_double_double
from ..engines.programs.record.mimic_rows import evaluate
from ..errors import SimulationError
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.coordinates.coordinate_rates import coordinate_rate
from ..recursions.spec import Spec

Array = NDArray[np.float64]

GOAL = 1e-13  # relative: if two runs agree to this, the finer one is far more accurate, since the order is 32
HALVINGS = 10


@dataclass(frozen=True)
class ReferenceMotion:
    """Motions of one robot from several states, at the same times.

    t      (N,)         [s], from 0
    q      (N, K, nq)   coordinates, rounded to float64
    v      (N, K, nv)   velocities
    error  (N,)         largest difference to the motion with twice the step, relative to the largest |v| and to the
                        largest change of a coordinate until then
    steps  number of steps of the finer motion
    """

    t: Array
    q: Array
    v: Array
    error: Array
    steps: int


def exact_motion(model: Model, q0: Array, v0: Array, t: Array, goal: float = GOAL, steps: int = 1) -> ReferenceMotion:
    """Free motions from (q0, v0) at the times t, to a relative error ``goal`` if possible.

    q0     (K, nq)  [rad | m]; quaternions and (cos, sin) pairs are normalised
    v0     (K, nv)  [rad/s | m/s]
    t      (N,)     increasing, the first 0 [s]
    steps  first number of steps between two times; doubled until two runs agree to ``goal``, or HALVINGS times

    Returns a ReferenceMotion; its ``error`` grows in a chaotic motion after some time, in any arithmetic.
    Raises  SimulationError if the stages do not converge in the shortest steps.
    """
    before: tuple[Array, Array] | None = None
    finest = steps << HALVINGS
    while True:
        found = _run(model, q0, v0, t, steps)
        if found is not None and before is not None:
            error = _difference(model, before, found)
            if error.max(initial=0.0) <= goal or steps >= finest:
                q, v = np.split(found[0], [model.nq], axis=2)
                return ReferenceMotion(t, q, v, error, steps * (len(t) - 1))
        if found is None and steps >= finest:
            raise SimulationError(f"the motion does not settle in steps of {(t[1] - t[0]) / steps:.3g} s")
        before, steps = found, 2 * steps


def _difference(model: Model, one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Relative difference of two runs at each time, of coordinates and velocities, each over its size until then."""
    off = abs((one[0] - other[0]) + (one[1] - other[1]))
    moved = np.maximum.accumulate(abs(other[0] - other[0][0]).max(axis=1), axis=0)
    fast = np.maximum.accumulate(abs(other[0]).max(axis=1), axis=0)
    size = np.where(np.arange(off.shape[2]) < model.nq, _most(moved, model.nq, True), _most(fast, model.nq, False))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = off / size[:, None, :]
    return np.asarray(np.where(off == 0.0, 0.0, relative).max(axis=(1, 2)))


def _most(sizes: Array, nq: int, of_q: bool) -> Array:
    part = sizes[:, :nq] if of_q else sizes[:, nq:]
    return np.asarray(part.max(axis=1, initial=0.0)[:, None])


# --- the run ------------------------------------------------------------------------------------------------


@lru_cache(maxsize=16)
def field(model: Model) -> DoubleDouble:
    """(q̇, a) of (q, v) without torques."""
    aba, zero = numba_kernels.variant(SPECS["aba"], frozenset()), np.zeros(model.nv)

    def made(rows: Any, x: Any) -> list[Any]:
        q, v = x[: model.nq], x[model.nq :]
        dq = np.zeros(model.nq, dtype=object)
        coordinate_rate(rows, q, v, dq)
        a = evaluate(aba, rows, (model.nv,), {"q": q, "v": v, "tau": zero}, np.empty(model.nv, object))
        return [*dq, *a]

    return record_double_double(model.bodies, model.nq + model.nv, made)


def _normal(model: Model, q: Array) -> tuple[Array, Array]:
    """(nq, K) high and low parts of q normalised in double-double."""
    spec: Spec = SPECS["normalize"]

    def made(rows: Any, x: Any) -> list[Any]:
        return list(evaluate(spec, rows, (model.nq,), {"q": x}, None))

    return record_double_double(model.bodies, model.nq, made)(np.ascontiguousarray(q.T))


def _run(model: Model, q0: Array, v0: Array, t: Array, steps: int) -> tuple[Array, Array] | None:
    """High and low parts (N, K, nq + nv) of the states; None if the stages of a step do not converge."""
    start = np.zeros((2, model.nq + model.nv, len(q0)))
    start[0, : model.nq], start[1, : model.nq] = _normal(model, q0)
    start[0, model.nq :] = v0.T
    return collocate(field(model), start, t, steps)
