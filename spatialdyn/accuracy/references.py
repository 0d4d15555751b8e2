"""Reference values of calls, errors against them, and a bound on the errors of other states."""

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
from ..engines.numbers.double_double import DoubleDouble, record_double_double
from ..engines.programs.record.mimic_rows import evaluate
from ..model.model import Model
from ..recursions import SPECS

Array = NDArray[np.float64]

CHECKED = 2  # samples of the reference that are checked against the exact engine
BITS = 160
LEAST = 2.0  # least margin
FEW = 32  # fewer errors do not show their scatter
FEW_LEAST = 4.0
MANY = 65536  # errors from which a smaller margin is enough
MANY_LEAST = 1.25
TOP = 128  # errors in the tail of many, whose slope is estimated
BEYOND = 4.0  # factor of the number of states to which the tail is extrapolated
TAIL = 0.95
SMALL = 0.1
LARGEST, EACH = NORMS = ("largest", "each")  # errors relative to the largest entry, or each to its own scale


@lru_cache(maxsize=4)
def recorded_call(model: Model, name: str) -> tuple[DoubleDouble, tuple[int, ...]]:
    """The program of a call in double-double, a function of its concatenated inputs, and the shape of the result."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    inputs = [x for x in spec.present if not x.static]
    places = np.cumsum([0] + [core_shape(model, x)[0] for x in inputs])
    shape = core_shape(model, spec.output)

    def made(rows: Any, x: Any) -> list[Any]:
        parts = {arg.name: x[a:b] for arg, a, b in zip(inputs, places[:-1], places[1:], strict=True)}
        return list(evaluate(spec, rows, shape, parts, np.empty(model.nv, object)).ravel())

    return record_double_double(model.bodies, int(places[-1]), made), shape


def truths(model: Model, name: str, arrays: list[Array], checked: int = CHECKED) -> tuple[Array, float]:
    """Reference results of a call for all samples, rounded to float64, and their largest error before rounding.

    arrays   (n, ...) each, in the order of the call
    checked  samples compared with the exact engine in BITS bits; errors are over the largest entry of the sample
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


def of_calls(name: str, found: NDArray[Any], truth: Array, norm: str = LARGEST) -> Array:
    """(n,) errors of samples: entries of M relative to √(M_ii M_jj), others to the sample's largest entry.

    norm  "each": each entry relative to itself, or to the median of its sizes in all samples if that is larger; M as
          above

    The scale of a sample is at least SMALL times the median of all: else samples that happen to be near 0 would
    determine the bound.
    """
    return relative(name, np.where(found == truth, 0.0, abs(found.astype(np.float64) - truth)), truth, norm)


def relative(name: str, off: Array, truth: Array, norm: str = LARGEST) -> Array:
    """(n,) errors of samples from the errors of their entries, relative to the scale of ``of_calls``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        if name == "crba":
            scale = np.sqrt(np.einsum("nii->ni", truth))
            of = off / (scale[:, :, None] * scale[:, None, :])
        elif norm == EACH:
            of = off / np.maximum(abs(truth), np.median(abs(truth), axis=0))
        else:
            largest = abs(truth).max(axis=1, initial=0.0)
            of = off / np.maximum(largest, SMALL * np.median(largest))[:, None]
    of = np.where(off == 0.0, 0.0, of).reshape(len(truth), -1)
    return np.asarray(np.nan_to_num(of, nan=np.inf).max(axis=1, initial=0.0))


def error_bound(errors: Array) -> float:
    """A bound expected to hold in other states: the largest error times a margin.

    Errors of a nearly singular robot follow a power law: the largest grows with the number of samples, faster if it is
    farther from the rest; ten times the samples multiply it by the root of its ratio to the TAIL quantile. From MANY
    errors the TOP ones give the exponent, the mean logarithm of their ratio to the least of them (Hill's estimator),
    and the margin extrapolates to BEYOND times as many samples. ``benchmarks/tradeoff.py`` tests bounds on fresh
    states.
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
