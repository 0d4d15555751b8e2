"""Monitors: whether, and by how much, a motion violates the passivity inequality or the fall of a Lyapunov function."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_number
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..simulation.trajectory import Trajectory
from ..waiting import watch
from .ledger import energy_ledger

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
SUPPLIES = ("torque", "external")  # kinds of work that come from outside


@dataclass(frozen=True, eq=False, repr=False)
class PassivityRecord:
    """Energy that a robot stored and work done on it since the first sample; N samples.

    t          (N,)  time [s]
    stored     (N,)  change of the storage function, by default of T + V [J]
    supplied   (N,)  work of torques and external forces [J]
    excess     (N,)  stored - supplied [J]: for a passive robot never above 0, up to the method's error
    worst, at  the largest excess [J], and its time [s]
    error      the largest energy error of the method's steps [J], to compare with the excess
    dt         [s]
    """

    t: Array
    stored: Array
    supplied: Array
    excess: Array
    worst: float
    at: float
    error: float
    dt: float

    def __repr__(self) -> str:
        return f"<PassivityRecord: largest excess {self.worst:.3g} J at t = {self.at:g} s, of steps {self.error:.3g} J>"

    @property
    def dissipated(self) -> Array:
        """(N,) supplied - stored [J]."""
        return -self.excess

    def order(self, other: PassivityRecord) -> float:
        """The order in dt of the largest excess, from the same motion with another dt; NaN if one has no excess.

        Raises SimulationError for anything but a record.
        """
        if not isinstance(other, PassivityRecord):
            raise SimulationError(f"other is {literal(other)}, expected a PassivityRecord of it with another dt")
        if not (self.worst > 0.0 and other.worst > 0.0 and self.dt != other.dt):
            return math.nan
        return math.log(self.worst / other.worst) / math.log(self.dt / other.dt)

    @watch.call("PassivityRecord.plot")
    def plot(self, path: str | None = None) -> Figure:
        """Draw stored and supplied energy, and the excess; path: a file to write too. Returns the Figure."""
        from ..pictures.control_plots import plot_passivity

        return plot_passivity(self, path)


@watch.call("passivity")
def passivity(run: Trajectory, storage: Any = None) -> PassivityRecord:
    """Whether a robot stored no more energy than was supplied: V(t) - V(0) <= ∫ vᵀτ dt + work of external forces.

    run      result of ``simulate(..., record="work")``: the method integrates the work as a state, so that only the
             method's own error remains; the trapezoidal rule on samples would find violations of order 2 in motions by
             rk4
    storage  (N,) another storage function on the samples, or a function of (t, q, v) of all samples [J]

    Raises  SimulationError for a motion without recorded work; ShapeError, NonFiniteError

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> run = sd.simulate(model, [0.5, -0.3], [0, 0], 1.0, 0.01, torque=[1.0, 0.5], record="work")
    >>> bool(sd.passivity(run).worst < 1e-5)
    True
    """
    ledger = energy_ledger(run)
    stored = ledger.change
    if storage is not None:
        value = _samples("storage", storage, run)
        stored = value - value[0]
    given = [ledger.work[kind].sum(1) for kind in SUPPLIES if kind in ledger.work]
    supplied: Array = np.sum(given, axis=0) if given else np.zeros(len(run.t))
    excess = stored - supplied
    k = int(excess.argmax())
    error = float(abs(ledger.error).max())
    return PassivityRecord(run.t, stored, supplied, excess, float(excess[k]), float(run.t[k]), error, run.dt)


@dataclass(frozen=True, eq=False, repr=False)
class LyapunovRecord:
    """A function of the state that should fall; N samples.

    t, value  (N,)  time [s] and its value
    rise      the largest rise from one sample to the next, 0 if it never rises
    first     the time of the first rise above ``rounding`` [s]; None without one
    rounding  rises below it do not count
    """

    t: Array
    value: Array
    rise: float
    first: float | None
    rounding: float

    def __repr__(self) -> str:
        when = "never rises" if self.first is None else f"rises first at t = {self.first:g} s, by up to {self.rise:.3g}"
        return f"<LyapunovRecord: from {self.value[0]:.6g} to {self.value[-1]:.6g}, {when}>"

    @property
    def falls(self) -> bool:
        """Whether it never rises by more than ``rounding``."""
        return self.first is None

    @watch.call("LyapunovRecord.plot")
    def plot(self, path: str | None = None) -> Figure:
        """Draw it over time; path: a file to write too. Returns the Figure."""
        from ..pictures.control_plots import plot_lyapunov

        return plot_lyapunov(self, path)


@watch.call("lyapunov")
def lyapunov(run: Trajectory, V: Any, rounding: float | None = None) -> LyapunovRecord:
    """Whether a function of the state falls along a motion.

    run       a Trajectory
    V         a function of (t (N,), q (N, nq), v (N, nv)) of all samples, or its values (N,)
    rounding  rises below it do not count; by default 1e-12 of the largest value

    Raises  ShapeError, NonFiniteError, SimulationError

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> law = sd.EnergyShaping(20.0, 5.0, [0.5, 0.2])
    >>> run = sd.simulate(model, [0.0, 0.0], [0.0, 0.0], 2.0, 1e-2, control=law)
    >>> sd.lyapunov(run, lambda t, q, v: law.energy(model, q, v)).falls
    True
    """
    if not isinstance(run, Trajectory):
        raise SimulationError(f"run is a {type(run).__name__}, expected a Trajectory of simulate")
    if rounding is not None and not 0.0 <= as_number(rounding) < math.inf:
        raise SimulationError(f"rounding is {literal(rounding)}, expected a finite number of 0 or more")
    value = _samples("V", V, run)
    least = 1e-12 * float(abs(value).max(initial=0.0)) if rounding is None else as_number(rounding)
    change = np.diff(value)
    up = np.flatnonzero(change > least)
    first = float(run.t[up[0] + 1]) if len(up) else None
    return LyapunovRecord(run.t, value, float(change.max(initial=0.0)), first, least)


def _samples(name: str, given: Callable[..., Any] | Any, run: Trajectory) -> Array:
    """Values (N,) of a function of the samples."""
    if not len(run):
        raise SimulationError(f"trajectory of {run.robot} is empty, expected samples")
    value = as_array(name, given(run.t, run.q, run.v) if callable(given) else given)
    if value.shape != run.t.shape:
        raise ShapeError(f"{name} has shape {value.shape}, expected {run.t.shape}")
    if not np.isfinite(value).all():
        raise NonFiniteError(f"{name} has values that are not finite, expected finite ones")
    return value
