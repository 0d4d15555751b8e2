"""The way back from a kernel's status to an error that names its cause."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import table as table
from ..engines.compiled import numba_kernels
from ..errors import ConfigurationError, InertiaError, NonFiniteError
from ..model.model import Joint, Model
from ..recursions import SPECS
from ..recursions.spec import Argument, Spec
from .arguments import Array, full_shape


def diagnose(
    spec: Spec,
    model: Model,
    stepped: list[tuple[Array, int]],
    batch: tuple[int, ...],
    static: tuple[Any, ...],
    out: Array,
    status: NDArray[np.int8],
    samples: NDArray[np.intp],
) -> None:
    """Raise what a status stands for, naming the first such sample and how many there are.

    A sample with an input that is not finite is no error: its answer is NaN. A pivot under the bound is looked at
    again, against the composite inertia itself. ``samples`` are the numbers of these samples in the batch.
    """
    varying = [x for x in spec.given if not x.static]
    unfit = np.flatnonzero(status == numba_kernels.UNIT)
    if len(unfit):
        at = int(unfit[0])
        for argument, (x, step) in zip(varying, stepped, strict=True):
            if argument.shape == ("nq",):
                _raise_unit_norm(model, argument.name, x[at * step], _where(samples[at], len(unfit), batch))
    finite = np.ones(len(status), bool)
    for x, step in stepped:
        ok = np.asarray(np.isfinite(x).reshape(len(x), -1).all(axis=1))
        finite &= ok if step else bool(ok.all())
    pivots = np.flatnonzero((status == numba_kernels.PIVOT) & finite)
    for at in pivots.tolist():
        row = _singular_row(spec, model, [x[at * step] for x, step in stepped], static)
        if row is not None:
            raise InertiaError(no_inertia(model, row, _where(samples[at], len(pivots), batch)))
    lost = np.flatnonzero((status != numba_kernels.OK) & finite & ~np.isfinite(out).reshape(len(out), -1).all(axis=1))
    if len(lost):
        where = _where(samples[lost[0]], len(lost), batch)
        row = _weightless_row(spec, model, [x[lost[0] * step] for x, step in stepped]) if spec.pivots else None
        if row is not None:
            raise InertiaError(no_inertia(model, row, where))
        raise NonFiniteError(_not_finite(spec, where))


def refuse_lost(spec: Spec, given: list[tuple[Argument, Array]], batch: tuple[int, ...], out: Array) -> None:
    """Raise NonFiniteError if a sample of finite inputs has a result that is not finite."""
    lost = ~np.isfinite(out).all(axis=tuple(range(len(batch), out.ndim)))
    for argument, x in given:
        lost = lost & np.isfinite(x).all(axis=tuple(range(-len(argument.shape), 0)))
    if lost.any():
        samples = np.flatnonzero(lost)
        raise NonFiniteError(_not_finite(spec, _where(samples[0], len(samples), batch)))


def _not_finite(spec: Spec, where: str) -> str:
    expected = "expected numbers whose products stay in the range of float64"
    return f"{spec.name} of finite input is not finite{where}, {expected}"


def no_inertia(model: Model, row: int, where: str) -> str:
    """What there is to say of a row that moves none."""
    return (
        f'joint "{joint_of_row(model, row).name}" moves no inertia{where}: articulated inertia next to 0, expected a '
        "body with mass or armature behind it"
    )


def _where(at: Any, count: int, batch: tuple[int, ...]) -> str:
    if not batch:
        return ""
    index = tuple(int(k) for k in np.unravel_index(at, batch))
    place = str(index[0]) if len(index) == 1 else str(index)
    return f" in sample {place}, the first of {count}" if count > 1 else f" in sample {place}"


def joint_of_row(model: Model, row: int) -> Joint:
    """The joint that a row of the table is of."""
    return next(j for j in model.joints[1:] if j.row - j.nv < row <= j.row)


def _raise_unit_norm(model: Model, name: str, q: Array, where: str) -> None:
    for joint in model.joints[1:]:
        first = model.bodies[joint.row - joint.nv + 1]
        part = unit_part(int(first["kind"]), int(first["at"]))
        if part is None:
            continue
        norm = math.hypot(*q[part].tolist())  # which does not overflow on the way
        if abs(norm * norm - 1.0) > 2e-6:
            cure = "; normalize(model, q) is the cure" if 0.0 < norm < math.inf else ""
            what = "quaternion" if len(q[part]) == 4 else "(cos, sin) pair"
            raise ConfigurationError(
                f'{name} holds a {what} of norm {norm:.9g} for joint "{joint.name}"{where}, '
                f"expected 1 within 1e-6{cure}"
            )


def unit_part(kind: int, at: int) -> slice | None:
    """Where in q a joint of that kind has coordinates of unit norm."""
    if kind == table.REVOLUTE_CS:
        return slice(at, at + 2)
    if kind == table.SPHERICAL:
        return slice(at, at + 4)
    if kind == table.FLOATING:
        return slice(at + 3, at + 7)
    if kind == table.PLANAR_CS:
        return slice(at + 2, at + 4)
    return None


def _singular_row(spec: Spec, model: Model, sample: list[Array], static: tuple[Any, ...]) -> int | None:
    """The outermost row whose articulated inertia is <= n eps of its composite inertia, in one sample."""
    n = len(model.bodies) - 1
    values = dict(zip((x.name for x in spec.given if not x.static), sample, strict=True))
    inputs = [None if x is None else values[x.name] for x in spec.inputs]
    pivots, *spare = (np.empty(size) for size in spec.beside(n))
    M = np.empty((n, n))
    with np.errstate(all="ignore"):
        scratch = np.zeros(n + 1, spec.work)
        spec.recursion(model.bodies, scratch, *inputs, np.empty(full_shape(model, spec.output) or (1,)), pivots, *spare)
        crba = SPECS["crba"]
        crba.recursion(model.bodies, np.zeros(n + 1, crba.work), values["q"], M)
    singular = np.flatnonzero(~(pivots > n * np.finfo(float).eps * np.diag(M)))
    return int(singular[-1]) + 1 if len(singular) else None


def _weightless_row(spec: Spec, model: Model, sample: list[Array]) -> int | None:
    """The outermost row whose composite inertia is so small that its reciprocal is infinite, in one sample.

    It is what makes a pivot of ABA no number; a factor of its root is one, and what is solved with it may not be.
    """
    q = dict(zip((x.name for x in spec.given if not x.static), sample, strict=True))["q"]
    n, crba = len(model.bodies) - 1, SPECS["crba"]
    M = np.empty((n, n))
    with np.errstate(all="ignore"):
        crba.recursion(model.bodies, np.zeros(n + 1, crba.work), q, M)
        weightless = np.flatnonzero(~np.isfinite(1.0 / np.diag(M)))
    return int(weightless[-1]) + 1 if len(weightless) else None


def refuse_singular(model: Model, M: Array) -> None:
    """Raise InertiaError if some M is not positive definite: if a pivot of its LᵀL is next to nothing."""
    if not np.isfinite(M).all():
        return
    scale = np.sqrt(np.einsum("...ii->...i", M))
    if (scale > 0.0).all():
        smallest = np.linalg.eigvalsh(M / (scale[..., :, None] * scale[..., None, :]))[..., 0]
        if (smallest > model.nv * np.finfo(float).eps).all():
            return
        joint = ""
    else:
        k = int(np.argwhere(scale <= 0.0)[0][-1])
        joint = f'joint "{joint_of_velocity(model, k).name}" moves no inertia: '
    raise InertiaError(joint + f'the mass matrix of "{model.name}" is singular, expected every joint to move inertia')


def joint_of_velocity(model: Model, k: int) -> Joint:
    """The joint whose velocity v[k] is."""
    return next(j for j in model.joints[1:] if j.idx_v <= k < j.idx_v + j.nv and j.mimic is None)
