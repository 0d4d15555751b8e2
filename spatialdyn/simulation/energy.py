"""Tell by its energy whether a simulation has diverged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDING = 1e-9  # of the largest |V|: the least scale, above rounding
EXPLODED = 100.0  # times the scale; explicit Euler gains 32 on a pendulum in 1000 steps of 0.1 s
FAST = np.pi  # rad, or lengths of the robot, per step: a joint that moves farther has diverged


def scale_of(T: Array, V: Array) -> Array:
    """(N,) scale of the energy of an undriven motion up to each sample: the initial T plus the largest change of V [J].

    T, V  (N,)  kinetic and potential energy [J]
    """
    way = np.maximum.accumulate(abs(V - V[0]))
    scale: Array = T[0] + way + ROUNDING * np.maximum.accumulate(abs(V))
    return scale


def exploded(t: Array, v: Array, T: Array, V: Array, drive: Array, steps: NDArray[np.int64]) -> int | None:
    """The first sample whose energy has risen by EXPLODED times the sum of its scale and the torques' work; None if
    none has.

    t, v      times and velocities of the samples
    drive     (nv,)  largest |torque| of each joint
    steps     (N,)   steps before each sample; the first step is not judged, as explicit Euler moves v in it and not q
    """
    with np.errstate(all="ignore"):
        work = (np.maximum.accumulate(abs(v), axis=0) @ drive) * (t - t[0])
        risen = (T - T[0]) + (V - V[0])
        within = risen <= EXPLODED * (scale_of(T, V) + work)  # false for NaN
    beyond = np.flatnonzero(~within & (steps >= 2))
    return int(beyond[0]) if len(beyond) else None
