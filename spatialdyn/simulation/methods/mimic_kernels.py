"""The kernels of each family of methods for models with mimic joints, where steps run in Python.

Kernels on the joints' group run on the rows of independent joints (``system.joint_table``). What walks the tree is a
public call, which is a program; the momenta of ``variational`` are Gᵀ those of the whole tree.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...calls.dynamics import calls
from ...engines.compiled import numba_kernels
from ...engines.compiled.table_kernels import kernel
from ...engines.programs.record.mimic_rows import MimicRows
from ...engines.programs.record.tracer import scratch
from ...errors import ConfigurationError, InertiaError, NonFiniteError
from ...model.model import Model
from ...recursions.momenta.discrete_momenta import WORK_AFTER, WORK_BEFORE, momenta_after, sum_before
from ...recursions.momenta.hamilton import P
from ..system import NONFINITE, OK, PIVOT, UNIT, System
from . import explicit
from .methods import CANONICAL, EXPLICIT, Family
from .symplectic import SymplecticKernels
from .variational import VariationalKernels, momenta_before

Array = NDArray[np.float64]


def mimic_kernels(model: Model, family: Family, fext: Array | None) -> Any:
    """The kernels of a family, as ``family.kernels`` gives them."""

    def call(name: str, out: Any, *inputs: Any) -> int:
        """Write the result of a public call; returns the status of its error."""
        try:
            out[...] = calls[name](model, *(None if x is None else np.array(x) for x in inputs))
        except InertiaError:
            return PIVOT
        except ConfigurationError:
            return UNIT
        except NonFiniteError:
            return NONFINITE
        return OK if np.isfinite(out).all() else NONFINITE

    def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
        return call("aba", a, q, v, system.tau, fext)

    def field(system: System, q: Any, p: Any, rates: Any) -> int:
        return call("hamilton_field", rates, q, p, system.zero, fext)

    def load(system: System, q: Any, g: Any) -> int:
        return call("generalized_gravity", g, q) if fext is None else call("static_torque", g, q, fext)

    def velocity(table: Any, q: Any, p: Any, v: Any) -> int:
        return call("velocity_from_momentum", v, q, p)

    if family is EXPLICIT:
        return explicit.kernels_of(accelerate)
    own = family.kernels(fext is not None)
    if family is CANONICAL:
        assert isinstance(own, SymplecticKernels)
        return own._replace(field=field, hamilton=None)
    assert isinstance(own, VariationalKernels)
    before = _of_tree(model, kernel(momenta_before, 1, 1, 2, 1, work=WORK_BEFORE))
    after = _of_tree(model, kernel(momenta_after, 1, 1, 2, 1, work=WORK_AFTER))
    return own._replace(load=load, static_torque=None, velocity=velocity, before=before, after=after)


def _of_tree(model: Model, momenta: Callable[..., int]) -> Callable[..., int]:
    """A kernel of momenta (table, q, xi, moved, out) on the whole tree, reduced."""
    whole, G = np.empty(len(model.bodies) - 1), np.asarray(model.mimic_matrix)

    def reduced(table: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
        at = q[model.mimic_index] * model.mimic_ratio + model.mimic_offset
        status = momenta(getattr(model, numba_kernels.TABLE), at, G @ xi, moved, whole)
        out[:] = whole @ G
        return int(status)

    return reduced


# --- recorded -------------------------------------------------------------------------------------------


def _before(bodies: MimicRows, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> None:
    """As on a tree; the twists of the whole tree, which are more than ``moved`` has rows, are its first entry."""
    moved[0, 0] = np.full((len(bodies.tree), 6), 0.0, object)
    _momenta(sum_before, WORK_BEFORE, bodies, q, xi, moved, out)


def _after(bodies: MimicRows, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> None:
    _momenta(momenta_after, WORK_AFTER, bodies, q, xi, moved, out)


def _momenta(sweep: Any, work: np.dtype, rows: MimicRows, q: Any, xi: Any, moved: Any, out: Any) -> None:
    whole = np.full(len(rows.tree) - 1, 0.0, object)
    sweep(rows.tree, scratch(work, len(rows.tree)), rows.q_of_tree(q), rows.v_of_tree(xi), moved[0, 0], whole)
    out[:] = rows.output_of_model(P, whole)


_registered: tuple[tuple[Any, Any], ...] = ((sum_before, _before), (momenta_after, _after))
for _sweep, _reduced in _registered:
    _sweep.register(MimicRows)(_reduced)
