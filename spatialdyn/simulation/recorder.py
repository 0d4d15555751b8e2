"""The steps of a simulation, its recorded samples, and the check of their energy for divergence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..actuation.springs import spring_energy
from ..calls.arguments import as_number
from ..calls.dynamics import calls
from ..calls.specialized import Specialized, results_of_rows
from ..control.control import Control, law_torques
from ..errors import NonFiniteError, SpatialDynError, literal
from ..model.model import Model
from .plan import Plan
from .states import RunStates
from .trajectory import Trajectory

Array = NDArray[np.float64]
FIT = 1e-9  # relative: a ratio duration / dt this near a whole number counts as whole
ROUNDING = 1e-9  # relative to the largest |V|: the smallest scale of energy, above rounding
EXPLODED = 100.0  # times the scale; explicit Euler gains 32 on a pendulum in 1000 steps of 0.1 s
FAST = np.pi  # rad, or lengths of the robot, per step: a joint that moves farther has diverged


@dataclass(frozen=True)
class Steps:
    """``whole`` steps of dt, then one of ``rest`` [s] unless that is 0."""

    dt: float
    whole: int
    rest: float

    @classmethod
    def of(cls, duration: float, dt: float) -> Steps:
        """The steps of a duration. Raises SpatialDynError for dt <= 0, or a duration negative or not finite."""
        for name, x, sense in (("duration", duration, "of 0 or more"), ("dt", dt, "above 0")):
            number = as_number(x)
            if not 0.0 <= number < math.inf or (name == "dt" and number == 0.0):
                raise SpatialDynError(f"{name} is {literal(x)}, expected a finite number of seconds {sense}")
        ratio = float(duration) / float(dt)
        if not ratio < 2.0**53:
            raise SpatialDynError(
                f"dt is {literal(dt)} for a duration of {literal(duration)} s, expected fewer than 2^53 steps"
            )
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
        """The time at which a step begins [s]."""
        return step * self.dt if step <= self.whole else self.whole * self.dt + self.rest


class Recorder:
    """The arrays of samples, and the Trajectory made of them.

    at     (2,)  steps done, samples written
    t      times of all samples, including those to come [s]
    rows   arrays of q, of v or p, and of tau
    plan   Plan of the run
    states, own, own_rows  the states carried beside q and v, their present row, and their rows of samples
    split  kinetic and potential energy of the samples of the last ``trajectory`` [J]
    """

    def __init__(self, plan: Plan, steps: Steps, every: int, states: RunStates) -> None:
        self.plan, self.method, self.steps, self.every = plan, plan.integrator, steps, every
        self.model = model = plan.model
        kept = np.arange(0, steps.total + 1, every)
        if kept[-1] != steps.total:
            kept = np.append(kept, steps.total)
        self.kept = kept
        self.t: Array = np.asarray(kept * steps.dt, np.float64)
        self.t[-1] = steps.time(steps.total)
        self.rows = tuple(np.empty((len(kept), n)) for n in (model.nq, model.nv, model.nv))
        self.states = states
        self.own = np.concatenate([np.empty(0), *(x[0] for x in states.starts)])
        self.own_rows = np.empty((len(kept), len(self.own)))
        self.at = np.zeros(2, np.int64)
        self.split = (np.empty(0), np.empty(0))

    @property
    def moves_p(self) -> bool:
        """Whether momenta are recorded rather than velocities."""
        return self.method.family is not None and self.method.family.moves == "p"

    def put(self, q: Array, w: Array, tau: Array) -> None:
        """Write one sample."""
        for rows, x in zip(self.rows, (q, w, tau), strict=True):
            rows[self.at[1]] = x
        self.own_rows[self.at[1]] = self.own
        self.at[1] += 1

    def end(self, t: float, q: Array, w: Array, tau: Array) -> None:
        """Write the state at which an interrupted simulation stopped, unless it is the last sample."""
        row = int(self.at[1])
        if row < len(self.t) and t > self.t[row - 1]:
            self.t[row] = t
            self.put(q, w, tau)

    def velocities(self) -> list[Array]:
        """Rows of q, v and each state carried, written so far."""
        n = int(self.at[1])
        q, w, _ = (rows[:n] for rows in self.rows)
        v = np.asarray(calls["velocity_from_momentum"](self.model, q, w)) if self.moves_p else w
        return [q, v, *(self.own_rows[:n, at] for at in self.states.slices)]

    def trajectory(self, control: Control | None = None, interrupted: bool = False) -> Trajectory:
        """The samples so far; computes p from v, or v from p, and a law's torques, for all samples at once."""
        n, model = int(self.at[1]), self.model
        q, w, tau = (rows[:n].copy() for rows in self.rows)
        observed = self.plan.observed
        v = _of_samples(observed["p"], q, w)[0] if self.moves_p else w
        p, T, V = _of_samples(observed["v"], q, v)
        p = w if self.moves_p else p
        self.split = T, V
        states: dict[str, Array] = {}
        if self.states.arguments:
            states = self.states.shown(self.own_rows[:n].copy())
        if control is not None and n:
            tau += law_torques(control, model, q, v, tau, states, self.kept[:n], self.steps.dt, self.steps.total)
        impulses, contact = None, self.plan.contact
        if contact is not None and contact.records:
            at = dict(zip((x.name for x in self.states.arguments), self.states.slices, strict=True))
            impulses = contact.record(q, self.own_rows[:n, at[contact.own.name]])
        sprung = spring_energy(model, q) if "springs" in (x.name for x in self.plan.scene.effects) else None
        energy = T + V if sprung is None else T + V + sprung
        words = (self.method.name, self.steps.dt, model.name, interrupted, model)
        return Trajectory(self.t[:n].copy(), q, v, p, tau, energy, *words, states, impulses, sprung, self.plan.scene)


def _of_samples(calls_of: Specialized, *arrays: Array) -> list[Array]:
    """Results of calls on all samples; NaN where the result for a finite state is not finite."""
    n = len(arrays[0])
    made = results_of_rows(calls_of, arrays)
    if made is not None:
        return made
    try:
        return list(calls_of(*arrays))
    except NonFiniteError:
        if n == 1:
            return [_alone(calls_of.model, name, *arrays) for name in calls_of.calls]
        parts = [_of_samples(calls_of, *(x[at] for x in arrays)) for at in (slice(n // 2), slice(n // 2, None))]
        return [np.concatenate(both) for both in zip(*parts, strict=True)]


def _alone(model: Model, name: str, q: Array, w: Array) -> Array:
    try:
        return np.asarray(calls[name](model, *((q,) if name == "potential_energy" else (q, w))))
    except NonFiniteError:
        return np.full((1, model.nv) if name in ("momentum", "velocity_from_momentum") else 1, np.nan)


# --- energy ---------------------------------------------------------------------------------------------


def scale_of(T: Array, V: Array) -> Array:
    """Scale (N,) of the energy of an undriven motion up to each sample: initial T plus the largest change of V [J].

    T, V  (N,)  kinetic and potential energy [J]
    """
    way = np.maximum.accumulate(abs(V - V[0]))
    scale: Array = T[0] + way + ROUNDING * np.maximum.accumulate(abs(V))
    return scale


def exploded(t: Array, v: Array, T: Array, V: Array, drive: Array, steps: NDArray[np.int64]) -> int | None:
    """The first sample whose energy has risen by EXPLODED times the sum of its scale and the torques' work, or None.

    t, v      times and velocities of the samples
    drive     (nv,)  largest |torque| of each joint
    steps     (N,)   steps before each sample; the first step is not judged, because explicit Euler moves v but not q
    """
    with np.errstate(all="ignore"):
        work = (np.maximum.accumulate(abs(v), axis=0) @ drive) * (t - t[0])
        risen = (T - T[0]) + (V - V[0])
        within = risen <= EXPLODED * (scale_of(T, V) + work)  # false for NaN
    beyond = np.flatnonzero(~within & (steps >= 2))
    return int(beyond[0]) if len(beyond) else None
