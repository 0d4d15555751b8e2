"""How far the energy of a motion may go, which tells a simulation that has diverged from one that has not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDING = 1e-9  # of the largest |V|: what is below is no scale
EXPLODED = 100.0  # times its scale: explicit Euler's steady gain of a pendulum, 1000 steps of 0.1 s, is 32
FAST = np.pi  # rad, or lengths of the robot, by which a joint moves in a step where nothing can be trusted any more


def scale_of(T: Array, V: Array) -> Array:
    """(N,) the most that the kinetic energy of a motion that nothing drives can have been up to each of its samples:
    T where it began, and as much as V has gone since [J].

    T, V  (N,)  kinetic and potential energy [J]
    """
    way = np.maximum.accumulate(abs(V - V[0]))
    scale: Array = T[0] + way + ROUNDING * np.maximum.accumulate(abs(V))
    return scale


def exploded(t: Array, v: Array, T: Array, V: Array, drive: Array, steps: NDArray[np.int64]) -> int | None:
    """The first sample whose energy has risen by EXPLODED times its scale, the work of torques counted in; None if
    there is none.

    t, v      times and velocities of the samples
    drive     (nv,)  largest |torque| of each joint
    steps     (N,)   steps before each sample: the first says nothing, for explicit Euler moves v in it and not q
    """
    with np.errstate(all="ignore"):
        work = (np.maximum.accumulate(abs(v), axis=0) @ drive) * (t - t[0])
        risen = (T - T[0]) + (V - V[0])
        within = risen <= EXPLODED * (scale_of(T, V) + work)  # false for what is no number
    beyond = np.flatnonzero(~within & (steps >= 2))
    return int(beyond[0]) if len(beyond) else None
