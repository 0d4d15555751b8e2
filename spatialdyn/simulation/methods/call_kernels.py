"""The kernels of each family of methods for steps that run in Python: they compile nothing.

A public call or a program walks the tree, also with mimic joints, whose momenta in ``variational`` are Gᵀ times those
of the whole tree. Charts are recursions in plain Python, on the rows of independent joints.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bodies.kinds import NV
from ...bodies.table import independent
from ...calls.by_program import OneByOne
from ...calls.dynamics import calls
from ...calls.one_sample import of_model
from ...engines.programs.record import tracer
from ...engines.programs.record.mimic_rows import MimicRows, rows_of
from ...model.model import Model
from ...recursions.coordinates.coordinate_rates import DISPLACEMENT_RATE
from ...recursions.coordinates.coordinate_rates import TURN as TURN_STEP
from ...recursions.momenta.canonical_coordinates import chart_rate, from_canonical, recenter, to_canonical
from ...recursions.momenta.discrete_momenta import ENDS, momenta_after, sum_before
from ..arithmetic import answered, finite
from ..system import NONFINITE, OK, TURNED, System
from .explicit import HALF_TURN, ExplicitKernels
from .iteration import end
from .methods import CANONICAL, EXPLICIT, Family
from .symplectic import SymplecticKernels
from .variational import TURN, VariationalKernels

Array = NDArray[np.float64]


def call_kernels(model: Model, family: Family, fext: Array | None) -> Any:
    """The kernels of a family, as ``family.kernels`` gives them."""

    zero, aba, integrate = np.zeros(model.nv), calls["aba"], calls["integrate"]

    def call(name: str, out: Any, *inputs: Any) -> int:
        """Write the result of a public call; returns the status of its error."""
        return finite(answered(calls[name], out, model, *inputs), out)

    def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
        code = answered(aba, a, model, q, v, system.tau, fext)
        return code if a.dot(zero) == 0.0 else code or NONFINITE  # faster than ``finite``

    def move(table: Any, q: Any, u: Any, out: Any) -> int:
        return answered(integrate, out, model, q, u)

    def field(system: System, q: Any, p: Any, rates: Any) -> int:
        return call("hamilton_field", rates, q, p, system.zero, fext)

    def load(system: System, q: Any, g: Any) -> int:
        return call("generalized_gravity", g, q) if fext is None else call("static_torque", g, q, fext)

    def velocity(table: Any, q: Any, p: Any, v: Any) -> int:
        return call("velocity_from_momentum", v, q, p)

    if family is EXPLICIT:
        return ExplicitKernels(accelerate, None, move, *_group_calls(model))
    rows = rows_of(tracer.table(model.bodies))
    if family is CANONICAL:
        to, back, rate, nearer = (_on(rows, x) for x in (to_canonical, from_canonical, chart_rate, recenter))
        return SymplecticKernels(field, None, to, back, rate, nearer, end)
    return VariationalKernels(load, None, velocity, move, *_ends(model), end)


def _on(rows: Any, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of rows of the independent joints, as a kernel of a table."""
    return lambda table, *arrays: function(rows, *arrays)


def _same_rate(table: Any, u: Any, v: Any, out: Any) -> int:
    """``displacement_rate`` of joints of one freedom."""
    out[:] = v
    return OK


def _straight(table: Any, steps: Any, v: Any, w: Any, u: Any) -> int:
    """``turn`` of joints of one freedom."""
    u[:] = steps * w
    return OK


def _group_calls(model: Model) -> tuple[Callable[..., int], Callable[..., int]]:
    """``displacement_rate`` and ``turn`` of ``explicit``, of any table."""
    n, kinds = model.nv, np.unique(independent(model.bodies)["kind"][1:])
    if all(NV[int(kind)] == 1 for kind in kinds):
        return _same_rate, _straight
    rate_of = of_model(DISPLACEMENT_RATE, model, (), (True, True))
    turned_by = of_model(TURN_STEP, model, (), (True, True, True))

    def displacement_rate(table: Any, u: Any, v: Any, out: Any) -> int:
        found = np.empty(n + 1)
        code = answered(rate_of, found, u, v)
        out[:] = found[:n]
        return code if code != OK or found[n] < HALF_TURN else TURNED

    def turn(table: Any, steps: Any, v: Any, w: Any, u: Any) -> int:
        found = np.empty(2 * n)
        code = answered(turned_by, found, v, w, steps[:1])
        w[:], u[:] = found[:n], found[n:]
        return code

    return displacement_rate, turn


def _ends(model: Model) -> tuple[Callable[..., int], Callable[..., int]]:
    """The kernels of momenta before and after a step; the second refers to the step of the first one's last call."""
    n, after, ends = model.nv, np.zeros(model.nv), OneByOne(model, ENDS)

    def before(table: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
        found = ends(q, xi)
        out[:], after[:] = found[:n], found[n : 2 * n]
        return (OK if found[2 * n] > TURN else TURNED) if np.isfinite(found).all() else NONFINITE

    def momenta(table: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
        out[:] = after
        return OK

    return before, momenta


# --- recorded -------------------------------------------------------------------------------------------


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
