"""Batches of models with mimic joints: the full tree's recursion reduced by G, or through M(q) for calls that solve.

Slices of samples are computed one after another; at Ctrl-C ``out`` holds the finished ones, NaN for the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..engines import run, threads
from ..errors import SpatialDynError
from ..model.model import Model
from ..recursions.spec import Spec
from .arguments import Array, core_shape, empty, from_full_tree, full_shape, to_full_tree
from .failures import raise_if_singular

Calls = Mapping[str, Callable[..., Any]]


class MassMatrix:
    """A ``recursions.spec.MassMatrix``: M(q) of a slice. Raises InertiaError if one is singular."""

    def __init__(self, calls: Calls, model: Model, q: Array) -> None:
        """M by the public crba."""
        self._calls, self._model = calls, model
        self._M: Array = calls["crba"](model, q)
        raise_if_singular(model, self._M)

    @property
    def inverse(self) -> Array:
        """M⁻¹ (samples, nv, nv)."""
        return np.asarray(np.linalg.inv(self._M), np.float64)

    def solve(self, x: Array) -> Array:
        """M⁻¹ x (samples, nv)."""
        return np.asarray(np.linalg.solve(self._M, x[..., None])[..., 0], np.float64)

    def call(self, name: str, *inputs: Any) -> Any:
        """The result of the public call of that name."""
        return self._calls[name](self._model, *inputs)


def mimic_batch(
    calls: Calls,
    spec: Spec,
    model: Model,
    inputs: Sequence[Array],
    static: tuple[Any, ...],
    out: Array,
    seen: bool = True,
) -> run.Failed:
    """As ``run.batch``, for a model with mimic joints; ``calls`` are the public ones. Raises InertiaError."""
    n = len(out)
    failed: list[run.Failed] = []
    first = 0
    try:
        for first, end in threads.slices(n, len(model.bodies), math.prod(full_shape(model, spec.output))):
            given = [x[first:end] if len(x) == n else x for x in inputs]
            if spec.through_M is not None:
                try:
                    _through_M(calls, spec, model, given, static, out[first:end])
                except SpatialDynError:  # recompute the whole batch: its error has the sample's index
                    _through_M(calls, spec, model, inputs, static, out)
                    raise
            else:
                part = _on_full_tree(spec, model, given, static, out[first:end])
                if part is not run.ALL_OK:
                    failed.append(part._replace(samples=part.samples + first))
            first = end
    except KeyboardInterrupt:
        if seen:
            out[first:] = np.nan
        raise
    return run.concatenate_failed(failed)


def _through_M(
    calls: Calls, spec: Spec, model: Model, inputs: Sequence[Array], static: tuple[Any, ...], out: Array
) -> None:
    """A slice by the spec's ``through_M``; ``out`` is written in place."""
    values = dict(zip((x.name for x in spec.present if not x.static), inputs, strict=True))
    values |= dict(zip((x.name for x in spec.present if x.static), static, strict=True))
    M = MassMatrix(calls, model, values["q"])
    assert spec.through_M is not None
    result = spec.through_M(M, *(None if x is None else values[x.name] for x in spec.inputs))
    target = out.reshape((len(out), *core_shape(model, spec.output)))
    if not isinstance(result, tuple):
        target[...] = result
        return
    for k, part in enumerate(result):
        target[:, k] = part


def _on_full_tree(spec: Spec, model: Model, inputs: Sequence[Array], static: tuple[Any, ...], out: Array) -> run.Failed:
    """A slice by the recursion on the full tree; ``out`` is written in place."""
    varying = [x for x in spec.present if not x.static]
    full = [np.ascontiguousarray(to_full_tree(model, x, a)) for x, a in zip(varying, inputs, strict=True)]
    target = empty((len(out), *full_shape(model, spec.output)))
    failed = run.batch(spec, model, full, static, target.reshape((len(out), -1)), seen=False)
    out[...] = from_full_tree(model, spec.output, target).reshape(out.shape)
    return failed
