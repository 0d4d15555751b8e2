"""The samples that a program does not answer for, by the kernels for any model.

Angles beyond its range, NaN, joints without inertia: what is wrong with them is said here, in the words of the calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels, parameters
from ..errors import NonFiniteError
from ..model.model import Model
from .arguments import full_shape
from .failures import diagnose
from .specialize_request import Input, Task


def compute(
    task: Task,
    inputs: Sequence[Input],
    stepped: list[tuple[NDArray[Any], int]],
    results: list[NDArray[Any]],
    batch: tuple[int, ...],
    samples: NDArray[np.intp],
) -> None:
    """These samples by the kernel for any model, in float64. Raises what went wrong."""
    taken = [(np.asarray(x[samples] if step else x, np.float64), step) for x, step in stepped]
    given = dict(zip((x.name for x in inputs), taken, strict=True))
    full = {}
    for x in task.arguments:
        core = full_shape(task.model, x) or (1,)
        if x.name not in task.constants:
            full[x.name] = given[x.name]
            continue
        constant = task.constants[x.name]
        rest, step = given.get(x.name, (np.empty((1, 0)), 0))
        entries = np.tile(constant, (len(rest), 1))
        entries[:, np.isnan(constant)] = rest.reshape(len(rest), -1)
        full[x.name] = entries.reshape((len(rest), *core)), step
    varied = [given[name] for name in task.names]
    everyone = np.arange(len(samples))
    groups = [everyone] if not any(step for _, step in varied) else list(everyone[:, None])
    for group in groups:
        model = task.model
        if varied:
            values = [x[group[0] * step].ravel().tolist() for x, step in varied]
            model = _with_bodies(model, parameters.changed(model.bodies, task.parameters, values))
        part = full if group is everyone else {k: (x[group] if s else x, s) for k, (x, s) in full.items()}
        _by_kernel(task, model, part, results, batch, samples[group])


def _by_kernel(
    task: Task,
    model: Model,
    full: dict[str, tuple[NDArray[np.float64], int]],
    results: list[NDArray[Any]],
    batch: tuple[int, ...],
    samples: NDArray[np.intp],
) -> None:
    """Samples of one model, whole inputs, by the kernel of each call."""
    n = len(samples)
    for k, (spec, result) in enumerate(zip(task.specs, results, strict=True)):
        inputs = [full[x.name] for x in spec.given if not x.static]
        static = tuple(task.static[x.name] for x in spec.given if x.static)
        out = np.empty((n, *(full_shape(model, spec.output) or (1,))))
        status = np.empty(n, np.int8)
        kernel, bad = numba_kernels.batch(spec), 0
        flat = out.reshape((n, -1))
        a = 0
        try:
            for a, b in batch_kernels.slices(n, len(model.bodies), flat.shape[1]):
                passed = [y for x, step in inputs for y in (x[a:b] if step else x, step)]
                bad += kernel(getattr(model, numba_kernels.TABLE), b - a, *passed, *static, out[a:b], status[a:b])
                chosen = flat[a:b] if task.wanted is None else flat[a:b, task.wanted[k].ravel()]
                with np.errstate(over="ignore"):
                    result[samples[a:b]] = chosen
                a = b
        except KeyboardInterrupt:
            result[samples[a:]] = np.nan  # out holds what was done
            raise
        if bad:
            diagnose(spec, model, inputs, batch, static, out, status, samples)
        flat = flat if task.wanted is None else flat[:, task.wanted[k].ravel()]
        if task.dtype == np.float32 and not np.isfinite(result[samples][np.isfinite(flat)]).all():
            raise NonFiniteError(f"{spec.name} leaves the range of float32, expected dtype=np.float64 for such input")


def _with_bodies(model: Model, bodies: NDArray[Any]) -> Model:
    """The model with another table, to compute and to name joints with."""
    made: Model = object.__new__(Model)
    for slot in Model.__slots__:
        if slot != "__weakref__":
            object.__setattr__(made, slot, getattr(model, slot))
    object.__setattr__(made, "bodies", bodies)
    object.__setattr__(made, "address", bodies.ctypes.data)
    return made
