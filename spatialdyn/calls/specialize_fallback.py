"""Samples beyond a program's range (large angles, NaN, joints without inertia), recomputed by the table kernel.

Raises the errors of the public calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines import run
from ..engines.programs import parameters
from ..errors import SpatialDynError
from ..model.model import Model
from .arguments import full_shape
from .failures import raise_failures, sample_of
from .specialize_request import Array, SpecializeRequest


def compute(
    request: SpecializeRequest,
    inputs: Sequence[Array],
    rows: list[NDArray[Any]],
    results: list[NDArray[Any]],
    batch: tuple[int, ...],
    samples: NDArray[np.intp],
    seen: bool,
) -> None:
    """Recompute the samples by the table kernel, in float64. Raises the errors of the public calls.

    rows     each input (n, ...), or (1, ...) if all samples share one
    samples  indices of the samples
    results  (n, columns), written in place
    seen     whether the caller reads results after Ctrl-C
    """
    n, count = len(results[0]), len(samples)
    taken = [np.asarray(x[samples] if len(x) == n else x, np.float64) for x in rows]
    if request.derivative:
        _refuse(request, [x.name for x in inputs], samples, taken, batch)
    given = dict(zip((x.name for x in inputs), taken, strict=True))
    full, static = {}, tuple(request.static.values())
    for x in request.arguments:
        core = full_shape(request.model, x, static) or (1,)
        if x.name not in request.constants:
            full[x.name] = given[x.name]
            continue
        constant = request.constants[x.name]
        rest = given.get(x.name, np.empty((1, 0)))
        entries = np.tile(constant, (len(rest), 1))
        entries[:, np.isnan(constant)] = rest.reshape(len(rest), -1)
        full[x.name] = entries.reshape((len(rest), *core))
    varied = [given[name] for name in request.parameter_names]
    together = all(len(x) == 1 for x in varied)
    for group in [slice(0, count)] if together else [slice(k, k + 1) for k in range(count)]:
        model = request.model
        if varied:
            values = [x[group.start if len(x) == count else 0].ravel().tolist() for x in varied]
            model = _with_bodies(model, parameters.changed(model.bodies, request.parameters, values))
        part = {name: x[group] if len(x) == count else x for name, x in full.items()}
        try:
            _by_table(request, model, part, results, batch, samples[group], seen)
        except KeyboardInterrupt:
            for result in results if seen else ():
                result[samples[group.stop :]] = np.nan
            raise


def _refuse(
    request: SpecializeRequest,
    names: Sequence[str],
    samples: NDArray[np.intp],
    taken: Sequence[NDArray[np.float64]],
    batch: tuple[int, ...],
) -> None:
    """Raise SpatialDynError if a sample's inputs are finite: NaN has NaN for a derivative, others should have one."""
    finite = np.ones(len(samples), bool)
    for x in taken:
        finite &= np.isfinite(x.reshape(len(x), -1)).all(axis=1)
    if finite.any():
        at = int(np.flatnonzero(finite)[0])
        where = sample_of(samples[at], int(finite.sum()), batch)
        sizes = [float(abs(x[at if len(x) == len(samples) else 0]).max(initial=0.0)) for x in taken]
        k = int(np.argmax(sizes))
        raise SpatialDynError(
            f"{request.specs[0].name} has no derivative by its program{where}, where the largest input is {names[k]} "
            f"with {sizes[k]:.3g}: expected angles within 1e5, unit norms and joints of some articulated inertia"
        )


def _by_table(
    request: SpecializeRequest,
    model: Model,
    full: dict[str, NDArray[np.float64]],
    results: list[NDArray[Any]],
    batch: tuple[int, ...],
    samples: NDArray[np.intp],
    seen: bool,
) -> None:
    """Samples of one model with full inputs, call by call; a bound is infinite."""
    own = len(request.specs)
    for result in results[own:]:
        result[samples] = np.inf if request.bounds else np.nan
    for k, (spec, result) in enumerate(zip(request.specs, results[:own], strict=True)):
        inputs = [full[x.name] for x in spec.present if not x.static]
        static = tuple(request.static[x.name] for x in spec.present if x.static)
        columns = None if request.output_places is None else request.output_places[k].ravel()
        try:
            failed = run.run_table_kernel(spec, model, inputs, static, result, samples, columns, seen)
        except KeyboardInterrupt:
            for later in results[k + 1 :] if seen else ():
                later[samples] = np.nan
            raise
        if failed is not run.ALL_OK:
            raise_failures(spec, model, batch, static, failed)


def _with_bodies(model: Model, bodies: NDArray[Any]) -> Model:
    """A copy of the model with another table of bodies."""
    changed: Model = object.__new__(Model)
    for slot in Model.__slots__:
        if slot != "__weakref__":
            object.__setattr__(changed, slot, getattr(model, slot))
    object.__setattr__(changed, "bodies", bodies)
    object.__setattr__(changed, "address", bodies.ctypes.data)
    return changed
