"""The steps of a simulation, and the samples that are kept of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..border import as_number
from ..dynamics import calls
from ..errors import NonFiniteError, SpatialDynError
from ..model import Model
from .methods import Method
from .trajectory import Trajectory

Array = NDArray[np.float64]
FIT = 1e-9  # a duration is a whole number of steps if it is one to this relative accuracy


@dataclass(frozen=True)
class Steps:
    """``whole`` steps of dt, and one of ``rest`` if that is not 0."""

    dt: float
    whole: int
    rest: float

    @classmethod
    def of(cls, duration: float, dt: float) -> Steps:
        """The steps of a duration. Raises SpatialDynError for one that is negative or not finite, or dt <= 0."""
        for name, x, sense in (("duration", duration, "of 0 or more"), ("dt", dt, "above 0")):
            number = as_number(x)
            if not 0.0 <= number < math.inf or (name == "dt" and number == 0.0):
                raise SpatialDynError(f"{name} is {x!r}, expected a finite number of seconds {sense}")
        ratio = float(duration) / float(dt)
        if not ratio < 2.0**53:
            raise SpatialDynError(f"dt is {dt!r} for a duration of {duration!r} s, expected fewer than 2^53 steps")
        whole = round(ratio)
        if abs(ratio - whole) <= FIT * max(1.0, ratio):
            return cls(float(dt), whole, 0.0)
        whole = math.floor(ratio)
        return cls(float(dt), whole, float(duration) - whole * float(dt))

    @property
    def total(self) -> int:
        """Number of steps."""
        return self.whole + (self.rest > 0.0)

    def time(self, step: int) -> float:
        """When a step begins."""
        return step * self.dt if step <= self.whole else self.whole * self.dt + self.rest


class Recorder:
    """The arrays that samples are written to, and the Trajectory that comes of them.

    at    (2,)  steps done, samples written
    t     times of all samples that are to come
    rows  arrays of q, of v or p, and of tau
    """

    def __init__(self, model: Model, method: Method, steps: Steps, every: int) -> None:
        self.model, self.method, self.steps, self.every = model, method, steps, every
        kept = np.arange(0, steps.total + 1, every)
        if kept[-1] != steps.total:
            kept = np.append(kept, steps.total)
        self.kept = kept
        self.t: Array = np.asarray(kept * steps.dt, np.float64)
        self.t[-1] = steps.time(steps.total)
        self.rows = tuple(np.empty((len(kept), n)) for n in (model.nq, model.nv, model.nv))
        self.at = np.zeros(2, np.int64)

    @property
    def moves_p(self) -> bool:
        """Whether momenta are recorded rather than velocities."""
        return self.method.family is not None and self.method.family.moves == "p"

    def put(self, q: Array, w: Array, tau: Array) -> None:
        """Write one sample."""
        for rows, x in zip(self.rows, (q, w, tau), strict=True):
            rows[self.at[1]] = x
        self.at[1] += 1

    def trajectory(self, interrupted: bool = False) -> Trajectory:
        """What there is so far; of v and p the one that is not recorded is computed here, for all samples at once."""
        n, model = int(self.at[1]), self.model
        q, w, tau = (rows[:n].copy() for rows in self.rows)
        v = _of_samples("velocity_from_momentum", model, q, w) if self.moves_p else w
        p = w if self.moves_p else _of_samples("momentum", model, q, w)
        energy = _of_samples("kinetic_energy", model, q, v) + _of_samples("potential_energy", model, q)
        t = np.array(self.t[:n])
        return Trajectory(t, q, v, p, tau, energy, self.method.name, self.steps.dt, model.name, interrupted, model)


def _of_samples(name: str, model: Model, *arrays: Array) -> Array:
    """A call on all samples; NaN where a state is so large that its answer is no number."""
    try:
        return np.asarray(calls[name](model, *arrays))
    except NonFiniteError:
        if len(arrays[0]) == 1:
            return np.full((1, model.nv) if name in ("momentum", "velocity_from_momentum") else 1, np.nan)
        half = len(arrays[0]) // 2
        parts = [_of_samples(name, model, *(x[at] for x in arrays)) for at in (slice(half), slice(half, None))]
        return np.concatenate(parts)
