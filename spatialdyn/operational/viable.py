"""Position and velocity limits as bounds of acceleration from which braking still ends before the limit.

At a step h, a takes v to v + h a and q to q + h v + ½ h² a. Below the upper limit b with brakes ā,

    v + h a <= v_max,    h v + ½ h² a <= b - q,    (v + h a)² <= 2 ā (b - q - h v - ½ h² a)  or  v + h a <= 0,

and a >= -ā is always allowed: a joint that is beyond what ā stops is braked by ā, and asked for no more.
Source: after Del Prete, Joint position and velocity bounds in discrete-time acceleration/torque control of robot
manipulators (2018).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def upper(gap: Array, v: Array, fastest: Array, brake: float, h: float) -> Array:
    """Largest accelerations (n,) where ``gap`` is left to the limit; infinite gaps and speeds are no limits."""
    room = np.minimum(gap, 1e30)
    inside = brake * h * h * brake - 4.0 * brake * h * v + 8.0 * brake * room
    stop = (np.sqrt(np.maximum(inside, 0.0)) - 2.0 * v - brake * h) / (2.0 * h)
    stop = np.where(inside < 0.0, -np.inf, stop)
    next_one = np.where(gap >= 0.0, 2.0 * (room - h * v) / (h * h), np.inf)  # the step itself ends before the limit
    by_position = np.where(gap < np.inf, np.minimum(np.maximum(stop, -v / h), next_one), np.inf)
    found: Array = np.maximum(np.minimum(by_position, (fastest - v) / h), -brake)
    return found
