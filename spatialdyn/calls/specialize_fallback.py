"""Samples beyond a program's range (large angles, NaN, joints without inertia), recomputed in float64.

In NumPy, or by the table kernel where there is no program.

Raises the errors of the public calls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.table import ANY_NORM
from ..engines import by_table_kernel
from ..engines.failed import ALL_OK, Failed
from ..engines.programs.record import parameters
from ..engines.programs.record.recording import along
from ..errors import SpatialDynError
from ..model.model import Model
from ..recursions.spec import Spec
from .arguments import core_shape
from .failures import raise_early, raise_failures, sample_of
from .specialize_request import Array, SpecializeRequest


def compute(
    request: SpecializeRequest,
    inputs: Sequence[Array],
    rows: list[NDArray[Any]],
    results: list[NDArray[Any]],
    batch: tuple[int, ...],
    samples: NDArray[np.intp],
    seen: bool,
    has_program: bool = True,
) -> None:
    """Recompute the samples in float64; a bound is infinite. Raises the errors of the public calls.

    rows         each input (n, ...), or (1, ...) if all samples share one
    samples      indices of the samples
    results      (n, columns), written in place
    seen         whether the caller reads results after Ctrl-C
    has_program  True: a program computed the other samples; False: the table kernel computes all
    """
    n, count, own = len(results[0]), len(samples), len(request.specs)
    taken = [np.asarray(x[samples] if len(x) == n else x, np.float64) for x in rows]
    if request.derivative:
        _refuse(request, [x.name for x in inputs], samples, taken, batch)
        if along(request.derivative):
            for result in results:
                result[samples] = np.nan
            return
    given = dict(zip((x.name for x in inputs), taken, strict=True))
    full, static = {}, tuple(request.static.values())
    for x in request.arguments:
        core = core_shape(request.model, x, static) or (1,)
        if x.name not in request.constants:
            full[x.name] = given[x.name]
            continue
        constant = request.constants[x.name]
        rest = given.get(x.name, np.empty((1, 0)))
        entries = np.tile(constant, (len(rest), 1))
        entries[:, np.isnan(constant)] = rest.reshape(len(rest), -1)
        full[x.name] = entries.reshape((len(rest), *core))
    for result in results[own:]:
        result[samples] = np.inf if request.bounds else np.nan
    in_numpy = has_program and request.model.bodies[0]["kind"] != ANY_NORM  # ANY_NORM allows q off its unit norm
    varied = [given[name] for name in request.parameter_names]
    together = in_numpy or all(len(x) == 1 for x in varied)
    left = range(count) if together else _on_lanes(request, full, varied, results, samples, seen)
    for group in [slice(0, count)] if together else [slice(k, k + 1) for k in left]:
        model = request.model if in_numpy else _model_of(request, varied, group.start, count)
        part = {name: x[group] if len(x) == count else x for name, x in full.items()}
        done = 0
        try:
            for done, spec in enumerate(request.specs):
                arrays = [part[x.name] for x in spec.present if not x.static]
                values = tuple(request.static[x.name] for x in spec.present if x.static)
                columns = None if request.output_places is None else request.output_places[done].ravel()
                passed = spec, model, arrays, values, results[done], samples[group], columns, seen
                if in_numpy:
                    failed = by_table_kernel.run_in_numpy(*passed, request.parameters, varied)
                else:
                    if not varied:
                        raise_early(spec, model, arrays, values, count, batch)
                    failed = by_table_kernel.run_table_kernel(*passed)
                _raise(request, spec, values, batch, failed, samples, varied)
        except KeyboardInterrupt:
            for k, result in enumerate(results[:own] if seen else ()):
                result[samples[group.stop if k <= done else group.start :]] = np.nan
            raise


def _on_lanes(
    request: SpecializeRequest,
    full: Mapping[str, NDArray[np.float64]],
    varied: Sequence[NDArray[np.float64]],
    results: Sequence[NDArray[Any]],
    samples: NDArray[np.intp],
    seen: bool,
) -> list[int]:
    """Compute samples with parameters of their own together; returns those that are left."""
    left = np.zeros(len(samples), bool)
    try:
        for k, spec in enumerate(request.specs):
            arrays = [full[x.name] for x in spec.present if not x.static]
            static = tuple(request.static[x.name] for x in spec.present if x.static)
            columns = None if request.output_places is None else request.output_places[k].ravel()
            given = request.model, request.parameters, varied, arrays, static, results[k], samples, columns
            left |= by_table_kernel.run_edited(spec, *given)
    except KeyboardInterrupt:
        for result in results[: len(request.specs)] if seen else ():
            result[samples] = np.nan
        raise
    return np.flatnonzero(left).tolist()


def _raise(
    request: SpecializeRequest,
    spec: Spec,
    static: tuple[Any, ...],
    batch: tuple[int, ...],
    failed: Failed,
    samples: NDArray[np.intp],
    varied: Sequence[NDArray[np.float64]],
) -> None:
    """Raise the errors of failed samples, each for the model with the sample's own parameters."""
    if failed is ALL_OK:
        return
    if all(len(x) == 1 for x in varied):
        raise_failures(spec, _model_of(request, varied, 0, len(samples)), batch, static, failed)
        return
    for k, at in enumerate(np.searchsorted(samples, failed.samples).tolist()):
        inputs = [x[k : k + 1] if len(x) == len(failed.samples) else x for x in failed.inputs]
        here = slice(k, k + 1)
        one = Failed(failed.samples[here], failed.status[here], failed.finite[here], inputs)
        raise_failures(spec, _model_of(request, varied, at, len(samples)), batch, static, one)


def _model_of(request: SpecializeRequest, varied: Sequence[NDArray[np.float64]], at: int, count: int) -> Model:
    """The model with the parameters of one sample."""
    if not varied:
        return request.model
    values = [x[at if len(x) == count else 0].ravel().tolist() for x in varied]
    return _with_bodies(request.model, parameters.changed(request.model.bodies, request.parameters, values))


def _refuse(
    request: SpecializeRequest,
    names: Sequence[str],
    samples: NDArray[np.intp],
    taken: Sequence[NDArray[np.float64]],
    batch: tuple[int, ...],
) -> None:
    """Raise SpatialDynError if a sample's inputs are finite; a sample with NaN has the derivative NaN."""
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


def _with_bodies(model: Model, bodies: NDArray[Any]) -> Model:
    """A copy of the model with another table of bodies."""
    changed: Model = object.__new__(Model)
    for slot in Model.__slots__:
        if slot != "__weakref__":
            object.__setattr__(changed, slot, getattr(model, slot))
    object.__setattr__(changed, "bodies", bodies)
    object.__setattr__(changed, "address", bodies.ctypes.data)
    object.__setattr__(changed, "_plans", {})  # a plan holds the address of its table
    return changed
