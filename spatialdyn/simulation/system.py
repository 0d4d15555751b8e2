"""What every method of integration works on: a robot under torques, and the state it is in.

A method is a function ``advance(system, t, h, state)`` that takes the state from t to t + h. It is written once: the
compiled loop and the one that is driven from Python, for a torque that is a Python function, call the same source with
other members in the System. What goes wrong in a step is noted, not raised, so that both can go on in the same way:
the first trouble stays, and the loop stops after the step.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import inlined
from ..engines.compiled import numba_kernels
from ..engines.compiled.checks import all_finite

OK, UNIT, PIVOT, NONFINITE = numba_kernels.OK, numba_kernels.UNIT, numba_kernels.PIVOT, numba_kernels.NONFINITE
TORQUE, STALLED, TURNED = 5, 6, 7  # further codes of trouble


class System(NamedTuple):
    """A robot, what drives it, and the compiled kernels that a family of methods calls.

    kernels  NamedTuple of the family's own
    torque   ``torque(system, t, q, v)`` writes tau and notes one that is not finite
    user     the function that ``torque`` asks, None for torques held over a step
    table    the model's bodies, as kernels take them
    held     (rows, nv) torques of the steps, the last one held on
    fext     (njoints, 6), or (0, 6) where there is none
    unit     (2 nv,) what one of each freedom, and of its momentum, counts where they are compared: ``units``
    zero     (nv,) zeros
    tau      (nv,) written
    trouble  (3,) written: code, time, how large the thing was
    """

    kernels: Any
    torque: Any
    user: Any
    table: Any
    held: Any
    fext: Any
    unit: Any
    zero: Any
    tau: Any
    trouble: Any


class State(NamedTuple):
    """A state and the scratch of the methods.

    q        (nq,) coordinates
    w        (nv,) velocity or momentum, whichever the family of methods moves
    v        (nv,) velocity, written when the state is observed
    stage    (nq,) scratch
    by_row   (rows + 1, 6) scratch of every body: the centre of its chart, or its displacement
    work     (rows, nv or 2 nv) scratch; what a method keeps from step to step lies here too
    """

    q: Any
    w: Any
    v: Any
    stage: Any
    by_row: Any
    work: Any


def units(bodies: Any) -> NDArray[np.float64]:
    """(2 nv,) one for what turns, one over the robot's length for what travels; of momenta the reciprocals.

    A change that is nothing beside the state, in one number for all freedoms, is then the same in all units of length.
    The length is a power of two, so that nothing is rounded: that of the longest offset, centre of mass or radius of
    gyration.
    """
    inertia, at = bodies["inertia"][1:], bodies["X"]["p"][1:]
    heavy = inertia[inertia["m"] > 0.0]
    lengths = [abs(at[k]) for k in "xyz"] + [abs(heavy["h"][k] / heavy["m"]) for k in "xyz"]
    lengths += [np.sqrt(abs(heavy["I"][k] / heavy["m"])) for k in ("xx", "yy", "zz")]
    longest = max((float(x.max(initial=0.0)) for x in lengths), default=0.0)
    exponent = math.frexp(longest)[1] if longest > 0.0 else 0
    w = bodies["S"]["w"][1:]
    travels = (w["x"] == 0.0) & (w["y"] == 0.0) & (w["z"] == 0.0)
    each = np.where(travels, exponent, 0)
    made: NDArray[np.float64] = np.ldexp(1.0, np.concatenate([-each, each]))
    return made


@inlined
def note(system: System, code: int, t: float, size: float = 0.0) -> None:
    """Keep the first trouble."""
    if code != OK and system.trouble[0] == OK:
        system.trouble[0] = code
        system.trouble[1] = t
        system.trouble[2] = size


@inlined
def hold(system: System, step: int) -> None:
    """Put the torque of a step where methods read it."""
    row = min(step, len(system.held) - 1)
    for i in range(len(system.tau)):
        system.tau[i] = system.held[row, i]


@inlined
def held_torque(system: System, t: float, q: Any, v: Any) -> None:
    """The torque that ``hold`` has put there."""


@inlined
def user_torque(system: System, t: float, q: Any, v: Any) -> None:
    """The torque of a function ``user(t, q, v, tau)``."""
    system.user(t, q, v, system.tau)
    if not all_finite(system.tau):
        note(system, TORQUE if all_finite(q) and all_finite(v) else NONFINITE, t)


@inlined
def along(out: Any, x: Any, c: float, y: Any) -> None:
    """out = x + c y."""
    for i in range(len(out)):
        out[i] = x[i] + c * y[i]


@inlined
def copy(out: Any, x: Any) -> None:
    """out = x."""
    for i in range(len(out)):
        out[i] = x[i]
