"""The kernels of each family of methods in an arithmetic: recorded, or computed by calls. They compile nothing.

A Spec walks the tree, also with mimic joints, whose momenta in ``variational`` are Gᵀ times those of the whole tree.
Charts are recursions in plain Python, on the rows of independent joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ...algebra.scalars import select
from ...engines.programs.record.mimic_rows import MimicRows
from ...recursions import SPECS
from ...recursions.coordinates.coordinate_rates import DISPLACEMENT_RATE
from ...recursions.coordinates.coordinate_rates import TURN as TURN_STEP
from ...recursions.momenta.canonical_coordinates import chart_rate, from_canonical, recenter, to_canonical
from ...recursions.momenta.discrete_momenta import ENDS, momenta_after, sum_before
from ..arithmetic import Arithmetic
from ..system import OK, TURNED, System
from .explicit import HALF_TURN, ExplicitKernels
from .iteration import LARGEST, SETTLED, Sweeps, end
from .methods import CANONICAL, EXPLICIT, Family
from .symplectic import SymplecticKernels
from .variational import TURN, VariationalKernels


def kernels_of(at: Arithmetic, family: Family, fext: Any = None) -> Any:
    """The kernels of a family, as ``family.kernels`` gives compiled ones; fext (njoints, 6), None without forces."""
    forces = () if fext is None else (fext,)

    def spec(name: str, count: int, checked: bool = True) -> Callable[..., int]:
        return at.call(SPECS[name], count, checked)

    integrate = spec("integrate", 2, checked=False)

    def move(table: Any, q: Any, u: Any, out: Any) -> int:
        return integrate(out, q, u)

    if family is EXPLICIT:
        aba = spec("aba", 3 + len(forces))

        def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
            return aba(a, q, v, system.tau, *forces)

        return ExplicitKernels(accelerate, None, move, *_group_calls(at))
    stop = end if not at.recorded else _end
    if family is CANONICAL:
        hamilton = spec("hamilton_field", 3 + len(forces))

        def field(system: System, q: Any, p: Any, rates: Any) -> int:
            return hamilton(rates, q, p, np.zeros(len(p), p.dtype), *forces)

        to, back, rate, nearer = (_on(at.rows, x) for x in (to_canonical, from_canonical, chart_rate, recenter))
        return SymplecticKernels(field, None, to, back, rate, nearer, stop)
    weight = spec("static_torque" if forces else "generalized_gravity", 1 + len(forces))
    by_momentum = spec("velocity_from_momentum", 2)

    def load(system: System, q: Any, g: Any) -> int:
        return weight(g, q, *forces)

    def velocity(table: Any, q: Any, p: Any, v: Any) -> int:
        return by_momentum(v, q, p)

    return VariationalKernels(load, None, velocity, move, *_ends(at), stop)


def _on(rows: Any, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of rows of the independent joints, as a kernel of a table."""
    return lambda table, *arrays: function(rows, *arrays)


def _end(system: System, t: Any, s: Sweeps, y: Any) -> None:
    """``end`` of recorded numbers: set y to NaN if the iteration has failed."""
    change = s.change[0]
    solved = select(s.left[0], select(change - SETTLED, s.still[0], 1.0), select(LARGEST - change, 1.0, 0.0))
    for i in range(len(y)):
        y[i] = select(solved, y[i], math.nan)


def _group_calls(at: Arithmetic) -> tuple[Callable[..., int], Callable[..., int]]:
    """``displacement_rate`` and ``turn`` of ``explicit``."""
    rate_of, turned_by = at.call(DISPLACEMENT_RATE, 2, checked=False), at.call(TURN_STEP, 3, checked=False)

    def displacement_rate(table: Any, u: Any, v: Any, out: Any) -> int:
        found = np.empty(len(u) + 1, u.dtype)
        code = rate_of(found, u, v)
        out[:] = found[:-1]
        return code if at.recorded or code != OK or found[-1] < HALF_TURN else TURNED

    def turn(table: Any, steps: Any, v: Any, w: Any, u: Any) -> int:
        if not len(w):  # a call takes the time of a step as an array of one number
            return OK
        found = np.empty(2 * len(w), w.dtype)
        code = turned_by(found, v, w, steps[:1])
        w[:], u[:] = found[: len(w)], found[len(w) :]
        return code

    return displacement_rate, turn


def _ends(at: Arithmetic) -> tuple[Callable[..., int], Callable[..., int]]:
    """The kernels of momenta before and after a step; the second refers to the step of the first one's last call."""
    ends, after = at.call(ENDS, 2), [np.empty(0)]

    def before(table: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
        n = len(xi)
        found = np.empty(2 * n + 1, xi.dtype)
        code = ends(found, q, xi)
        out[:], after[0] = found[:n], found[n : 2 * n]
        if at.recorded:
            out[0] = select(found[2 * n] - TURN, out[0], math.nan)
            return OK
        return code if code != OK or found[2 * n] > TURN else TURNED

    def momenta(table: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
        out[:] = after[0]
        return OK

    return before, momenta


# --- of robots with mimic joints ------------------------------------------------------------------------


def _before(bodies: MimicRows, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> Any:
    """``sum_before`` with mimic joints: the twists of the whole tree, more than ``moved`` has rows, are its entry 0."""
    moved[0, 0] = np.full((len(bodies.tree), 6), 0.0, object)
    return _momenta(sum_before, work, bodies, q, xi, moved, out)


def _after(bodies: MimicRows, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> None:
    _momenta(momenta_after, work, bodies, q, xi, moved, out)


def _momenta(sweep: Any, work: Any, rows: MimicRows, q: Any, xi: Any, moved: Any, out: Any) -> Any:
    whole = np.full(len(rows.tree) - 1, 0.0, object)
    found = sweep(rows.tree, work, rows.q_of_tree(q), rows.v_of_tree(xi), moved[0, 0], whole)
    out[:] = rows.times_G(whole)
    return found


_registered: tuple[tuple[Any, Any], ...] = ((sum_before, _before), (momenta_after, _after))
for _sweep, _reduced in _registered:
    _sweep.register(MimicRows)(_reduced)
