"""The arguments of every integration method: System, a robot under torques, and State.

A method is a function ``advance(system, t, h, state)`` that takes the state from t to t + h. The compiled loop and the
Python loop (for a torque that is a Python function) call the same source with other members in the System. A failure in
a step is not raised but kept as a status, so that both loops handle it in the same way: the first failure stays, and
the loop stops after that step.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import inline
from ..bodies.table import independent
from ..engines.compiled import numba_kernels
from ..engines.compiled.checks import all_finite
from ..model.model import Model

OK, UNIT, PIVOT, NONFINITE = numba_kernels.OK, numba_kernels.UNIT, numba_kernels.PIVOT, numba_kernels.NONFINITE
TORQUE, STALLED, TURNED = 5, 6, 7  # further status codes


class System(NamedTuple):
    """A robot, its torques, and the compiled kernels that a family of methods calls.

    kernels  NamedTuple of the family's kernels
    torque   ``torque(system, t, q, v)`` writes tau, and the status TORQUE if it is not finite
    user     the user's function that ``torque`` calls, None for torques held over a step
    table    the model's ``joint_table``, as kernels take it
    held     (rows, nv) torques of the steps; the last row also holds for all later steps
    fext     (njoints, 6), or (0, 6) without external forces
    unit     (2 nv,) weights that make freedoms, and momenta, comparable: ``units``
    zero     (nv,) zeros
    tau      (nv,) written: the current torque
    status   (3,) written by ``set_status``: code, time [s], the size of what failed
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
    status: Any


class State(NamedTuple):
    """A state and the scratch of the methods.

    q        (nq,) coordinates
    w        (nv,) velocity or momentum, as the family of methods integrates v or p
    v        (nv,) velocity, written by the family's ``observe``
    stage    (nq,) scratch
    by_row   (rows + 1, 6) scratch per body: the centre of its chart, or its displacement
    work     (rows, nv or 2 nv) scratch, and numbers that a method keeps from step to step
    """

    q: Any
    w: Any
    v: Any
    stage: Any
    by_row: Any
    work: Any


@lru_cache(maxsize=64)
def units(model: Model) -> NDArray[np.float64]:
    """(2 nv,) weights: 1 for rotations, 1 / length of the robot for translations; the reciprocals for momenta.

    With these weights one tolerance on changes serves all freedoms in any unit of length. The length is that of the
    longest offset, centre of mass or radius of gyration, as a power of two, so that weighting rounds nothing.
    """
    bodies = model.bodies
    inertia, at = bodies["inertia"][1:], bodies["X"]["p"][1:]
    heavy = inertia[inertia["m"] > 0.0]
    lengths = [abs(at[k]) for k in "xyz"] + [abs(heavy["h"][k] / heavy["m"]) for k in "xyz"]
    lengths += [np.sqrt(abs(heavy["I"][k] / heavy["m"])) for k in ("xx", "yy", "zz")]
    longest = max((float(x.max(initial=0.0)) for x in lengths), default=0.0)
    exponent = math.frexp(longest)[1] if longest > 0.0 else 0
    w = independent(bodies)["S"]["w"][1:]
    travels = (w["x"] == 0.0) & (w["y"] == 0.0) & (w["z"] == 0.0)
    each = np.where(travels, exponent, 0)
    made: NDArray[np.float64] = np.ldexp(1.0, np.concatenate([-each, each]))
    return made


@inline
def set_status(system: System, code: int, t: float, size: float = 0.0) -> None:
    """Write the status unless it holds an earlier failure."""
    if code != OK and system.status[0] == OK:
        system.status[0] = code
        system.status[1] = t
        system.status[2] = size


@inline
def hold_torque(system: System, step: int) -> None:
    """tau = the held torque of a step."""
    row = min(step, len(system.held) - 1)
    for i in range(len(system.tau)):
        system.tau[i] = system.held[row, i]


@inline
def held_torque(system: System, t: float, q: Any, v: Any) -> None:
    """Nothing to do: ``hold_torque`` has written tau."""


@inline
def user_torque(system: System, t: float, q: Any, v: Any) -> None:
    """tau by the user's function ``user(t, q, v, tau)``."""
    system.user(t, q, v, system.tau)
    if not all_finite(system.tau):
        set_status(system, TORQUE if all_finite(q) and all_finite(v) else NONFINITE, t)


@inline
def add_scaled(out: Any, x: Any, c: float, y: Any) -> None:
    """out = x + c y."""
    for i in range(len(out)):
        out[i] = x[i] + c * y[i]


@inline
def copy(out: Any, x: Any) -> None:
    """out = x."""
    for i in range(len(out)):
        out[i] = x[i]
