"""A recorded motion between its samples: positions, velocities and accelerations at any time, filtered if wanted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import R1
from ..calls.dynamics import calls
from ..errors import IdentificationError
from ..model.model import Model
from .recording import Recording

Array = NDArray[np.float64]
ORDER = 4  # of the Butterworth filter, applied forth and back, so that it has no phase
ALONE = 0.01  # a smaller correlation counts as 0
MEANS = (-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0)  # weights of four samples in ``means_of_steps``
NEAR = 4  # steps: further away a jump has no effect
EDGE = 1.0  # in units of 1/cutoff: left out at both ends, where the filter continues the motion by reflection


class States(NamedTuple):
    """q (n, nq), v (n, nv) and a (n, nv); a is None if no equation needs it."""

    q: Array
    v: Array
    a: Array | None


@dataclass(frozen=True)
class Motion:
    """States at even times, from samples ``first``, ``first`` + 1, ... of a recording.

    model, dt   Model, [s]
    first       index of the first sample that has a state
    states      States
    velocities  "measured", "differences" of positions, or "filtered"
    """

    model: Model
    dt: float
    first: int
    states: States
    velocities: str

    def __len__(self) -> int:
        return len(self.states.q)

    def between(self, start: int, stop: int, part: float) -> States:
        """States at ``part`` in [0, 1) of the steps start .. stop - 1; at 0 the samples themselves.

        q and v come from a cubic in the displacement from the earlier sample, with both samples' positions and
        velocities: q has an error of h⁴/384 times its fourth derivative. a comes from the cubic through four samples.
        """
        q, v, a = self.states
        if part == 0.0:
            return States(q[start:stop], v[start:stop], None if a is None else a[start:stop])
        h, s = self.dt, part
        q0, v0, v1 = q[start:stop], v[start:stop], v[start + 1 : stop + 1]
        u = np.asarray(calls["difference"](self.model, q0, q[start + 1 : stop + 1]))
        way = (3.0 - 2.0 * s) * s * s * u + h * s * (1.0 - s) * ((1.0 - s) * v0 - s * v1)
        rate = cubic_rate(u, v0, v1, h, s)
        at = np.asarray(calls["integrate"](self.model, q0, way))
        return States(at, rate, None if a is None else cubic_at(a, start, stop, s))


def cubic_rate(u: Array, v0: Array, v1: Array, h: float, s: float) -> Array:
    """Slope at ``s`` of a step h of the cubic that rises by u, with slopes v0 and v1 at its ends."""
    return 6.0 * s * (1.0 - s) * u / h + (1.0 - s) * (1.0 - 3.0 * s) * v0 - s * (2.0 - 3.0 * s) * v1


def cubic_at(x: Array, start: int, stop: int, s: float) -> Array:
    """x at ``s`` in [0, 1) of the steps start .. stop - 1, through four neighbours (Catmull and Rom); at the ends the
    nearest sample replaces a missing neighbour.
    """
    k = np.arange(start, stop)
    before, one, two, after = (x[np.clip(k + i, 0, len(x) - 1)] for i in (-1, 0, 1, 2))
    slope, end = 0.5 * (two - before), 0.5 * (after - one)
    return np.asarray(
        one * (1.0 + 2.0 * s) * (1.0 - s) ** 2 + two * s * s * (3.0 - 2.0 * s)
        + slope * s * (1.0 - s) ** 2 - end * s * s * (1.0 - s)
    )  # fmt: skip


def shared_by_means(window: int, of: Array) -> tuple[int, float]:
    """Correlation of means over ``window`` neighbouring sums of white noise, with weights ``of``.

    Returns the distance, in means, from which on means share almost no sample, and the ratio of the variance of a mean
    of many of them to that of as many white numbers.
    """
    weights = np.convolve(of, np.full(window, 1.0 / window))
    rho = np.correlate(weights, weights, "full")[len(weights) - 1 :: window]
    rho /= rho[0]
    return int(np.flatnonzero(abs(rho) > ALONE)[-1]) + 1, float(2.0 * rho.sum() - 1.0)


def held_weights(velocities: str, part: float) -> Array:
    """Weights (2 n + 1) of held torques, of steps -n .. n, whose sum is the change of momentum over step 0.

    A held torque jumps at ``part`` of a step, and the acceleration jumps with it. ``differences`` and the cubic of
    ``Motion.between`` are smooth there: velocities near a jump have an error of the jump times the step times a number
    e, and momenta an error of e times the jump of the torque, for any inertia. The weights give the torque that matches
    these momenta. They are [1] if velocities were measured at the jumps.
    """
    if velocities == "filtered" or (velocities == "measured" and part == 0.0):
        return np.ones(1)
    k = np.arange(-2.0 * NEAR, 2.0 * NEAR + 1.0)
    past = np.maximum(k - part, 0.0)  # of a unit of acceleration, step 1, that begins at part
    q, true = 0.5 * past * past, np.maximum(k, 0.0)  # the velocity at k + part
    v = past if velocities == "measured" else _differences(q[:, None], 1.0)[:, 0]
    at = slice(NEAR, 3 * NEAR + 1)
    u, v0, v1 = (np.roll(q, -1) - q)[at], v[at], np.roll(v, -1)[at]
    e = (v0 if part == 0.0 else cubic_rate(u, v0, v1, 1.0, part)) - true[at]  # (2 NEAR + 1,), 0 at both ends
    rise = np.diff(e)  # of a step: a jump i steps before it is in rise[NEAR + i]
    weights = np.zeros(2 * NEAR + 1)
    weights[NEAR] = 1.0
    weights[1:] += rise[::-1]  # the torque of the step after the jump
    weights[:-1] -= rise[::-1]  # and of the step before it
    return weights


def summed(x: Array, weights: Array) -> Array:
    """Weighted sums (n, ...) of neighbours of x (n, ...), ``weights`` (2 k + 1); at the ends the last one repeats."""
    if len(weights) == 1:
        return x
    k, n = len(weights) // 2, np.arange(len(x))
    parts = [w * x[np.clip(n + i, 0, len(x) - 1)] for i, w in enumerate(weights, -k)]
    return np.asarray(np.sum(parts, axis=0))


def means_of_steps(x: Array) -> Array:
    """Means (n - 1, ...) of x (n, ...) between neighbours, from the cubic through four samples, with an error of h⁴.

    With fewer than four samples means are over two, with an error of h².
    """
    if len(x) < 4:
        return np.asarray(0.5 * (x[1:] + x[:-1]))
    inner = (13.0 * (x[1:-2] + x[2:-1]) - x[:-3] - x[3:]) / 24.0
    first, last = (9.0 * y[0] + 19.0 * y[1] - 5.0 * y[2] + y[3] for y in (x, x[::-1]))
    return np.asarray(np.concatenate([first[None] / 24.0, inner, last[None] / 24.0]))


def motion_of(recording: Recording, model: Model, cutoff: float | None, accelerations: bool) -> Motion:
    """The Motion of a recording; velocities and accelerations that were not measured are computed as derivatives.

    cutoff         [Hz] of a low-pass filter without phase for signals to differentiate; None for central differences of
                   order 4
    accelerations  whether a is needed

    Raises IdentificationError if v was not measured and not all positions are numbers, or if too few samples remain.
    """
    q, v, a, h = recording.q, recording.v, recording.a, recording.dt
    if cutoff is not None and cutoff * h >= 0.5:
        raise IdentificationError(f"cutoff is {cutoff:g} Hz, expected one below {0.5 / h:g} Hz, half the sampling rate")
    plain = all(row["kind"] in R1 for row in model.bodies[1:])
    if cutoff is not None and 1.0 / len(q) > cutoff * h / EDGE:  # then no sample remains
        raise IdentificationError(f"cutoff is {cutoff:g} Hz, expected one above {EDGE / (len(q) * h):g} Hz")
    if v is None and not plain:
        raise IdentificationError(
            f'recording has no v, expected it of robot "{model.name}", whose positions are not all numbers'
        )
    trim, velocities = 0, "measured" if v is not None else "differences"
    if cutoff is not None and plain:
        velocities = "filtered"
        filtered = spectral(q, h, cutoff)
        q = filtered[0]
        v = filtered[1] if v is None else spectral(v, h, cutoff)[0]
        a = filtered[2] if a is None and recording.v is None else a
        trim = math.ceil(EDGE / (cutoff * h))
    elif v is None:
        v, trim = _differences(q, h), 2
        if accelerations and a is None:
            a = _second_differences(q, h)
    if accelerations and a is None:
        a = spectral(v, h, cutoff)[1] if cutoff is not None else _differences(v, h)
        trim = max(trim, 2, 0 if cutoff is None else math.ceil(EDGE / (cutoff * h)))
    stop = len(q) - trim
    if stop - trim < 4:
        raise IdentificationError(f"recording has {len(q)} samples, expected at least {2 * trim + 4} for this cutoff")
    kept = [None if x is None else np.ascontiguousarray(x[trim:stop]) for x in (q, v, a if accelerations else None)]
    assert kept[0] is not None
    assert kept[1] is not None
    return Motion(model, h, trim, States(kept[0], kept[1], kept[2]), velocities)


def spectral(x: Array, h: float, cutoff: float) -> tuple[Array, Array, Array]:
    """Columns of x (N, n) through a Butterworth filter forth and back, and their first two derivatives.

    After subtracting the line from end to end, point reflections continue x with period 2 N - 2, so that value and
    slope are continuous at the ends. Its spectrum is multiplied by 1 / (1 + (f / cutoff)^(2 ORDER)) and by powers of
    i 2π f.
    """
    n = len(x)
    ramp = np.arange(n)[:, None] / (n - 1)
    slope = (x[-1] - x[0]) / ((n - 1) * h)
    rest = x - x[0] - ramp * (x[-1] - x[0])
    odd = np.concatenate([rest, -rest[-2:0:-1]])
    f = np.fft.rfftfreq(len(odd), h)
    X = np.fft.rfft(odd, axis=0) / (1.0 + (f / cutoff) ** (2 * ORDER))[:, None]
    turn = (2j * np.pi * f)[:, None]
    found = [np.fft.irfft(X * turn**k, len(odd), axis=0)[:n] for k in range(3)]
    return found[0] + x[0] + ramp * (x[-1] - x[0]), found[1] + slope, found[2]


def _differences(x: Array, h: float) -> Array:
    """First derivative of order 4; the caller discards the first and last two rows, which are NumPy's differences."""
    made = np.gradient(x, h, axis=0)
    made[2:-2] = (x[:-4] - 8.0 * x[1:-3] + 8.0 * x[3:-1] - x[4:]) / (12.0 * h)
    return np.asarray(made)


def _second_differences(x: Array, h: float) -> Array:
    """Second derivative of order 4, likewise."""
    made = np.gradient(np.gradient(x, h, axis=0), h, axis=0)
    made[2:-2] = (-x[:-4] + 16.0 * x[1:-3] - 30.0 * x[2:-2] + 16.0 * x[3:-1] - x[4:]) / (12.0 * h * h)
    return np.asarray(made)
