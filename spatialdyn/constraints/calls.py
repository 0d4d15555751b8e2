"""Calls with a table of constraints: their checks, their program or kernel, and equations that contradict others."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import EPS
from ..bodies.static_table import StaticTable
from ..calls.arguments import core_shape
from ..calls.one_sample import of_model
from ..engines.programs.record import tracer
from ..engines.programs.record.mimic_rows import rows_of
from ..errors import ConstraintError
from ..model.model import Model
from ..recursions.constraints.constrained import CHOSEN, DEPENDENT, ROWS, UNSURE
from ..recursions.spec import Spec
from .contact_points import Contacts
from .table import Constraints, check_constraints

Array = NDArray[np.float64]
CONTRADICTION = 1e3 * DEPENDENT  # times eps and the number of terms: larger residuals are not rounding
NAMED = 1e-6  # relative to the largest share in a contradiction: a message names equations with larger shares


def call(spec: Spec, model: Model, constraints: Constraints, *values: Any) -> Any:
    """A call of a Spec with a table of constraints; None stands for an optional input left out. Raises its errors."""
    if constraints.__class__ is not Constraints or constraints.model is not model:
        check_constraints(model, constraints)
    return answer(spec, constraints, (constraints.table,), values)


def answer(spec: Spec, owner: Constraints | Contacts, static: tuple[StaticTable, ...], values: tuple[Any, ...]) -> Any:
    """A call of a Spec with the tables of their owner, on the owner's model."""
    key = (spec.name, *(x is None for x in values))
    known = owner._plans.get(key)
    if known is None:
        known = owner._plans.setdefault(key, of_model(spec, owner.model, static, tuple(x is not None for x in values)))
    return known(*(x for x in values if x is not None))


def settled(spec: Spec, constraints: Constraints, out: Array, *values: Any) -> Array:
    """``out``, with samples that need a choice of rows computed again by the chosen rows: see ``respond``.

    out     (..., nv + nc + 2) with residual and rank at the end
    values  the inputs of ``spec`` in order, without the chosen rows
    """
    unsure = out[..., -2] >= UNSURE
    if not unsure.any():
        return out
    model, batch = constraints.model, out.shape[:-1]
    given = [x for x in spec.present if not x.static and x.name != CHOSEN.name]
    cores = [core_shape(model, x, (constraints.table,)) for x in given]
    sample = [None if x is None else _spread(x, batch, core)[unsure] for x, core in zip(values, cores, strict=True)]
    found = call(ROWS, model, constraints, sample[0], None)
    made = out.copy()
    made[unsure] = call(spec, model, constraints, *sample, found[..., :-1])
    return made


def _spread(x: Any, batch: tuple[int, ...], core: tuple[int, ...]) -> Array:
    """An input, broadcast to all samples."""
    return np.broadcast_to(np.asarray(x, np.float64), batch + core)


def raise_contradiction(spec: Spec, constraints: Constraints, out: Array, *values: Any) -> None:
    """Raise ConstraintError if equations of a sample contradict others.

    out     (..., nv + nc + 2) with residual and rank at the end
    values  the inputs of ``spec`` in order, without the chosen rows; None for an input left out
    """
    model, nc = constraints.model, constraints.nc
    least = CONTRADICTION * (model.nv + nc) * EPS
    bad = np.flatnonzero(out[..., -2] > least)
    if not len(bad):
        return
    batch = out.shape[:-1]
    index = np.unravel_index(bad[0], batch)
    given = [x for x in spec.present if not x.static and x.name != CHOSEN.name]
    cores = [core_shape(model, x, (constraints.table,)) for x in given]
    sample = [_sample(x, batch, index, core) for x, core in zip(values, cores, strict=True)]
    where = "" if not batch else f" in sample {', '.join(str(int(k)) for k in index)}"
    kept, left, size = _dropped(spec, constraints, sample)
    share = (1.0 - kept) * left * left / np.where(size > 0.0, size, 1.0)
    named = dict.fromkeys(constraints.equations[k].label for k in np.flatnonzero(share > NAMED * share.max()))
    raise ConstraintError(
        f"{', '.join(named)} contradict{'s' * (len(named) == 1)} the other constraints{where}: {int(kept.sum())} of "
        f"{nc} equations are independent, and these miss what they imply by {out[(*index, -2)]:.2g} of the motion; "
        "expected fewer constraints, or a state that meets them"
    )


def _sample(x: Any, batch: tuple[int, ...], index: Any, core: tuple[int, ...]) -> Any:
    """One sample of an input."""
    return None if x is None else _spread(x, batch, core)[index]


def _dropped(spec: Spec, constraints: Constraints, sample: list[Any]) -> tuple[Array, Array, Array]:
    """(kept, residual, squared size of terms), (nc) each, for one sample."""
    model = constraints.model
    varying = [x.name for x in spec.present if not x.static]
    chosen = call(ROWS, model, constraints, sample[0], None)[:-1]
    values = {"constraints": constraints.table.rows} | dict(zip(varying, [*sample, chosen], strict=True))
    out = np.empty(core_shape(model, spec.output, (constraints.table,)))
    rows = rows_of(tracer.table(model.bodies))
    with np.errstate(all="ignore"):
        _, s = spec.run(rows, np.zeros(len(model.bodies), spec.work), values, out)
    return s.kept, s.gamma, s.size
