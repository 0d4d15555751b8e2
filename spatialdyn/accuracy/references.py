"""Errors of a task against the truth, and how much worse than the worst of a sample others may be."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import core_shape
from ..calls.dynamics import calls
from ..calls.exact import exact
from ..engines.compiled import numba_kernels
from ..engines.numbers.double_double import Twofold, recorded
from ..engines.programs.tracer import evaluate
from ..model.model import Model
from ..recursions import SPECS

Array = NDArray[np.float64]

CHECKED = 2  # samples of the truth that are held against more digits
BITS = 160
LEAST = 2.0  # margin
FEW = 32  # errors that are too few to say how they scatter
FEW_LEAST = 4.0
MANY = 65536  # errors so many that the worst of a thousand others is beyond theirs in 1.5 % of all cases
MANY_LEAST = 1.25
TOP = 128  # of many: the tail, whose slope can be seen
BEYOND = 4.0  # times as many states
TAIL = 0.95
SMALL = 0.1


@lru_cache(maxsize=4)
def recorded_call(model: Model, name: str) -> tuple[Twofold, tuple[int, ...]]:
    """The program of a call in double-double, of all its inputs in a row, and the shape of its answer."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    inputs = [x for x in spec.given if not x.static]
    places = np.cumsum([0] + [core_shape(model, x)[0] for x in inputs])
    shape = core_shape(model, spec.output)

    def made(rows: Any, x: Any) -> list[Any]:
        parts = {arg.name: x[a:b] for arg, a, b in zip(inputs, places[:-1], places[1:], strict=True)}
        return list(evaluate(spec, rows, shape, parts, np.empty(model.nv, object)).ravel())

    return recorded(model.bodies, int(places[-1]), made), shape


def truths(model: Model, name: str, arrays: list[Array], checked: int = CHECKED) -> tuple[Array, float]:
    """The answers of a call to all samples, rounded to float64, and the largest error of what was rounded.

    arrays   (n, ...) each, in the order of the call
    checked  samples whose error is looked at, in BITS bits: the largest over the largest entry of the sample
    """
    program, shape = recorded_call(model, name)
    high, low = program(np.ascontiguousarray(np.concatenate(arrays, axis=1).T))
    worst = 0.0
    for k in range(min(checked, len(arrays[0]))):
        better = np.ravel(exact(model, calls[name], BITS)(*(a[k] for a in arrays)))
        size = max((abs(x) for x in better), default=0)
        for x, h, l in zip(better, high[:, k], low[:, k], strict=True):
            worst = max(worst, float(abs(x - float(h) - float(l)) / size) if size else 0.0)
    return high.T.reshape((len(arrays[0]), *shape)), worst


def of_calls(name: str, found: NDArray[Any], truth: Array) -> Array:
    """(n,) errors of samples: of M each entry over √(M_ii M_jj), else over the sample's largest entry.

    A sample all of whose entries happen to be next to 0, below SMALL of the median of all samples, is measured by that:
    a bound would have to be that of the rarest such sample.
    """
    off = abs(found.astype(np.float64) - truth)
    with np.errstate(invalid="ignore", divide="ignore"):
        if name == "crba":
            scale = np.sqrt(np.einsum("nii->ni", truth))
            off = off / (scale[:, :, None] * scale[:, None, :])
        else:
            largest = abs(truth).max(axis=1, initial=0.0)
            off = off / np.maximum(largest, SMALL * np.median(largest))[:, None]
    off = np.where(found == truth, 0.0, off).reshape(len(truth), -1)
    return np.asarray(np.nan_to_num(off, nan=np.inf).max(axis=1, initial=0.0))


def bound(errors: Array) -> float:
    """What other states stay below: the largest error times a margin.

    Errors of a nearly singular robot scatter like a power law, whose largest value grows with the number of samples
    the faster the further it is from the rest: the root of that distance is what ten times the samples bring. Of MANY
    errors the exponent shows in the TOP of them, as the mean logarithm of what they are of the least of these (Hill's
    estimator), and the margin is what BEYOND times as many would bring. The worst of 1000 other states is beyond that
    in 0.25 % of the cases that were tried, and beyond the bound of 4096 in 0.43 %.
    """
    worst = float(errors.max(initial=0.0))
    if worst == 0.0 or not math.isfinite(worst):
        return worst
    if len(errors) < FEW:
        middle = float(np.median(errors))
        return worst * max(FEW_LEAST, math.sqrt(worst / middle) if middle else FEW_LEAST)
    if len(errors) >= MANY:
        tail = np.log(np.maximum(np.sort(errors)[-TOP - 1 :], 1e-300))
        return worst * max(MANY_LEAST, math.exp(math.log(BEYOND) * float((tail[1:] - tail[0]).mean())))
    return worst * max(LEAST, math.sqrt(worst / max(float(np.quantile(errors, TAIL)), 1e-300)))
