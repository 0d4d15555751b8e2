"""From a kernel's status to an error that names the cause."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..algebra.rotations import UNIT_TOLERANCE
from ..bodies.kinds import unit_part
from ..bodies.static_table import StaticTable
from ..engines import run
from ..engines.compiled import numba_kernels
from ..engines.failed import ALL_OK, RANGE, Failed
from ..engines.programs.record.mimic_rows import evaluate, rows_of
from ..engines.programs.record.tracer import table
from ..errors import ConfigurationError, InertiaError, NonFiniteError
from ..model.model import Joint, Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .arguments import Array, core_shape


def raise_failures(spec: Spec, model: Model, batch: tuple[int, ...], static: tuple[Any, ...], failed: Failed) -> None:
    """Raise the error of a status, naming the first failed sample and the number of failed samples.

    A sample with an input that is not finite is no error: its result is NaN. A pivot below the kernel's bound is
    compared again, with the composite inertia in place of the bound.
    """
    samples, status = failed.samples, failed.status
    varying = [x for x in spec.present if not x.static]

    def inputs_of(at: int) -> list[Array]:
        return [x[at if len(x) == len(samples) else 0] for x in failed.inputs]

    unfit = np.flatnonzero(status == numba_kernels.UNIT)
    if len(unfit):
        at = int(unfit[0])
        for argument, x in zip(varying, inputs_of(at), strict=True):
            if argument.shape == ("nq",):
                _raise_unit_norm(model, argument.name, x, sample_of(samples[at], len(unfit), batch))
    finite = np.ones(len(status), bool)
    for x in failed.inputs:
        finite &= np.isfinite(x).reshape(len(x), -1).all(axis=1)
    pivots = np.flatnonzero((status == numba_kernels.PIVOT) & finite)
    for at in pivots.tolist():
        if model.mimic_matrix is not None:
            M = _mass_matrix(spec, model, inputs_of(at))
            raise_if_singular(model, M[None], sample_of(samples[at], len(pivots), batch))
            continue
        row = _singular_row(spec, model, inputs_of(at), static)
        if row is not None:
            raise InertiaError(zero_inertia_message(model, row, sample_of(samples[at], len(pivots), batch)))
    lost = np.flatnonzero((status != RANGE) & finite & ~failed.finite)
    if len(lost):
        at = int(lost[0])
        where = sample_of(samples[at], len(lost), batch)
        row = _weightless_row(spec, model, inputs_of(at)) if spec.pivots and model.mimic_matrix is None else None
        if row is not None:
            raise InertiaError(zero_inertia_message(model, row, where))
        raise NonFiniteError(_not_finite_message(spec, where))
    if (status == RANGE).any():
        raise NonFiniteError(f"{spec.name} leaves the range of float32, expected dtype=np.float64 for such input")


def raise_early(
    spec: Spec, model: Model, inputs: Sequence[Array], static: tuple[Any, ...], count: int, batch: tuple[int, ...]
) -> None:
    """As ``raise_failures``, before the computation, for a call that would compile its table kernel first."""
    failed = run.preview(spec, model, inputs, static, count)
    if failed is not ALL_OK:
        raise_failures(spec, model, batch, static, failed)


def _not_finite_message(spec: Spec, where: str) -> str:
    expected = "expected numbers whose products stay in the range of float64"
    return f"{spec.name} of finite input is not finite{where}, {expected}"


def zero_inertia_message(model: Model, row: int, where: str) -> str:
    """The message for a row with zero articulated inertia."""
    return (
        f'joint "{joint_of_row(model, row).name}" has zero articulated inertia{where}: zero to rounding, expected a '
        "body with mass or armature behind it"
    )


def sample_of(at: Any, count: int, batch: tuple[int, ...]) -> str:
    """The place of the first failed sample of a batch, as text: " in sample 3, the first of 2"; "" without a batch."""
    if not batch:
        return ""
    index = tuple(int(k) for k in np.unravel_index(at, batch))
    place = str(index[0]) if len(index) == 1 else str(index)
    return f" in sample {place}, the first of {count}" if count > 1 else f" in sample {place}"


def joint_of_row(model: Model, row: int) -> Joint:
    """The joint of a row of the table."""
    return next(j for j in model.joints[1:] if j.row - j.nv < row <= j.row)


def off_unit_norm(model: Model, q: Array) -> Iterator[tuple[Joint, Array, float]]:
    """The joints whose quaternion or (cos, sin) pair in q is not of unit norm, with that part of q and its norm."""
    for joint in model.joints[1:]:
        first = model.bodies[joint.row - joint.nv + 1]
        part = unit_part(int(first["kind"]), int(first["q_index"]))
        if part is not None:
            norm = math.hypot(*q[part].tolist())  # hypot does not overflow on the way
            if abs(norm * norm - 1.0) > UNIT_TOLERANCE:
                yield joint, q[part], norm


def _raise_unit_norm(model: Model, name: str, q: Array, where: str) -> None:
    for joint, part, norm in off_unit_norm(model, q):
        cure = "; normalize(model, q) is the cure" if 0.0 < norm < math.inf else ""
        what = "quaternion" if len(part) == 4 else "(cos, sin) pair"
        raise ConfigurationError(
            f'{name} holds a {what} of norm {norm:.9g} for joint "{joint.name}"{where}, expected 1 within 1e-6{cure}'
        )


def _singular_row(spec: Spec, model: Model, sample: list[Array], static: tuple[Any, ...]) -> int | None:
    """The outermost row whose articulated inertia is <= n eps of its composite inertia, in one sample."""
    n = len(model.bodies) - 1
    varying = [x for x in spec.present if not x.static]
    values: dict[str, Any] = {x.name: y if x.shape else y.item() for x, y in zip(varying, sample, strict=True)}
    known = (x.rows if isinstance(x, StaticTable) else x for x in static)
    values |= dict(zip((x.name for x in spec.present if x.static), known, strict=True))
    M = np.empty((n, n))
    with np.errstate(all="ignore"):
        out = np.empty(core_shape(model, spec.output, static) or (1,))
        pivots = spec.run(model.bodies, np.zeros(n + 1, spec.work), values, out)[0]
        crba = SPECS["crba"]
        crba.recursion(model.bodies, np.zeros(n + 1, crba.work), values["q"], M)
    singular = np.flatnonzero(~(pivots > n * np.finfo(float).eps * np.diag(M)))
    return int(singular[-1]) + 1 if len(singular) else None


def _weightless_row(spec: Spec, model: Model, sample: list[Array]) -> int | None:
    """The outermost row whose composite inertia is so small that its reciprocal is infinite, in one sample.

    Then a pivot of ABA is NaN; the square-root method has a finite factor, but its solution may not be finite.
    """
    q = dict(zip((x.name for x in spec.present if not x.static), sample, strict=True))["q"]
    n, crba = len(model.bodies) - 1, SPECS["crba"]
    M = np.empty((n, n))
    with np.errstate(all="ignore"):
        crba.recursion(model.bodies, np.zeros(n + 1, crba.work), q, M)
        weightless = np.flatnonzero(~np.isfinite(1.0 / np.diag(M)))
    return int(weightless[-1]) + 1 if len(weightless) else None


def _mass_matrix(spec: Spec, model: Model, sample: list[Array]) -> Array:
    """M (nv, nv) of one sample of a model with mimic joints."""
    q = dict(zip((x.name for x in spec.present if not x.static), sample, strict=True))["q"]
    with np.errstate(all="ignore"):
        M = evaluate(SPECS["crba"], rows_of(table(model.bodies)), (model.nv, model.nv), {"q": q}, None)
    return M.astype(np.float64)


def raise_if_singular(model: Model, M: Array, where: str = "") -> None:
    """Raise InertiaError if a finite M is not positive definite: scaled to unit diagonal, an eigenvalue <= nv eps."""
    M = M[np.isfinite(M).all(axis=(-2, -1))]
    scale = np.sqrt(np.einsum("...ii->...i", M))
    if (scale > 0.0).all():
        smallest = np.linalg.eigvalsh(M / (scale[..., :, None] * scale[..., None, :]))[..., 0]
        if (smallest > model.nv * np.finfo(float).eps).all():
            return
        joint = ""
    else:
        k = int(np.argwhere(scale <= 0.0)[0][-1])
        joint = f'joint "{joint_of_velocity(model, k).name}" has zero articulated inertia: '
    raise InertiaError(
        joint + f'the mass matrix of "{model.name}" is singular{where}, expected inertia behind every joint'
    )


def joint_of_velocity(model: Model, k: int) -> Joint:
    """The joint whose velocity v[k] is."""
    return next(j for j in model.joints[1:] if j.idx_v <= k < j.idx_v + j.nv and j.mimic is None)
