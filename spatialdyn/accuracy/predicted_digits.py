"""Digits that calls keep on a model: in their recursions, in programs and in float32, against double-double."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import core_shape
from ..calls.dynamics import calls
from ..calls.forward_dynamics import EXTENDED, METHODS
from ..engines.compiled import numba_kernels
from ..engines.numbers.samples import Evaluation
from ..engines.programs.record import recording
from ..engines.programs.record.regroup import regroup
from ..errors import SpatialDynError
from ..model.model import Model
from ..recursions import SPECS
from .references import of_calls, truths

Array = NDArray[np.float64]
JointState = tuple[Array, Array, Array]

EPS = {"float64": float(np.finfo(np.float64).eps), "float32": float(np.finfo(np.float32).eps)}
COARSER = EPS["float32"] / EPS["float64"]
INPUTS = {"rnea": "qva", "crba": "q", "aba": "qva", "aba_refined": "qva", "minverse": "q"}  # inputs of judged calls
SHORT = 32  # freedoms up to which all calls are judged: kernels of larger robots take long to compile
IN_NUMPY = 128  # freedoms up to which NumPy takes less time than the table kernels take to compile
BRANCHING = 64  # states for a recursion that branches on values, fewer beyond IN_NUMPY: NumPy takes them one by one
ALWAYS = ("rnea", "aba")  # judged for robots of any size: one call without pivots and one with


def predicted_digits(model: Model, states: Sequence[JointState]) -> dict[str, dict[str, float]]:
    """Expected digits of the largest acceleration for each method, in the worst of some states; see ``method_errors``.

    states  (q, v, tau) each; the model has no mimic joints
    Returns {method: {"float64": digits, "float32": digits}}, -log10 of the error, at least 0; "extended" has
    "float64" alone.
    """
    arrays = [np.array([s[k] for s in states]) for k in range(3)]
    return {
        method: {dtype: digits_of(errors, EPS[dtype]) for dtype, errors in found.items()}
        for method, found in method_errors(model, arrays).items()
    }


def digits_of(errors: Array, least: float = EPS["float64"]) -> float:
    """Digits that the worst error leaves: at most those of the precision, at least 0."""
    return max(0.0, -math.log10(min(1.0, max(least, float(errors.max(initial=0.0))))))


def method_errors(model: Model, arrays: list[Array]) -> dict[str, dict[str, Array]]:
    """Errors of each method of ``forward_dynamics``, over the largest acceleration, against ABA in double-double.

    float64 is measured for each recursion itself, in at most BRANCHING states if it branches on values. float32 is
    derived: the same error times 2²⁹, for "refined" plus the square of the error of its first solution, plus the effect
    of rounding the model's numbers and the inputs. This assumes float32 throughout; ``specialize`` computes samples
    whose pivots are lost, or that leave the range of float32, in float64.

    "extended" is the truth itself, rounded: off by half an ulp of float64, and by ABA's error 2⁵⁰ times smaller.

    arrays  q (n, nq), v (n, nv), tau (n, nv)
    Returns {method: {"float64": (n,), "float32": (n,)}}, infinite where a result is not finite; {"float64": (n,)} of
    "extended".
    """
    with np.errstate(all="ignore"):
        truth, _ = truths(model, "aba", arrays, checked=0)
        measured = {}
        for method, name in METHODS.items():
            few = max(1, BRANCHING * IN_NUMPY // max(IN_NUMPY, model.nv))
            n = len(truth) if SPECS[name].traceable else few
            measured[method] = of_calls("aba", as_written(model, name, [x[:n] for x in arrays]), truth[:n])
        bodies = model.bodies.copy()
        regroup(bodies, solved=True)  # as in a program, whose constants are rounded after regrouping
        _round(bodies)
        rounded = [x.astype(np.float32).astype(np.float64) for x in arrays]
        moved = of_calls("aba", as_written(model, METHODS["refined"], rounded, bodies), truth)
        first = COARSER * measured["aba"]
        return {
            method: {
                "float64": found,
                "float32": COARSER * found + moved[: len(found)] + (first * first if method == "refined" else 0.0),
            }
            for method, found in measured.items()
        } | {EXTENDED: {"float64": EPS["float64"] * (0.5 + 4.0 * measured["aba"])}}


def program_errors(
    model: Model, arrays: list[Array], step: Callable[[], None] = lambda: None
) -> dict[str, tuple[Array, Array]]:
    """{call: (errors of the recursion itself, errors of its program)}.

    arrays  q (n, nq), v (n, nv), and a or tau (n, nv)
    step    called before each call
    Returns {} if no program runs: for models of many freedoms, mimic joints and NUMBA_DISABLE_JIT.
    """
    if numba_kernels.PLAIN or model.mimic_matrix is not None:
        return {}
    found = {}
    for name, letters in INPUTS.items():
        step()
        given = [arrays["qva".index(x)] for x in letters]
        spec = SPECS[name]
        if not recording.fits((spec,), model.bodies) or (model.nv > SHORT and name not in ALWAYS):
            continue
        alone = as_written(model, name, given)
        sound = np.flatnonzero(np.isfinite(alone.reshape(len(alone), -1)).all(axis=1))
        if not len(sound):
            continue
        given = [x[sound] for x in given]  # a batch with a singular sample raises
        try:
            batch = np.asarray(calls[name](model, *given))
        except SpatialDynError:
            continue
        of = "crba" if name == "minverse" else name  # both are matrices, scaled by their diagonals
        with np.errstate(all="ignore"):
            truth, _ = truths(model, "aba" if name == "aba_refined" else name, given, checked=0)
            found[name] = of_calls(of, alone[sound], truth), of_calls(of, batch, truth)
    return found


def as_written(model: Model, name: str, arrays: list[Array], bodies: NDArray[Any] | None = None) -> Array:
    """Results of the recursion itself in float64, sample by sample; not finite where it fails.

    bodies  a table instead of the model's

    Computed in NumPy, which compiles nothing, up to IN_NUMPY freedoms; above that by the table kernel.
    """
    spec = numba_kernels.variant(SPECS[name], frozenset())
    table = model.bodies if bodies is None else bodies
    n = len(arrays[0])
    out, status = np.full((n, *core_shape(model, spec.output)), np.nan), np.empty(n, np.int8)
    with np.errstate(all="ignore"):
        if model.nv <= IN_NUMPY or not spec.traceable:
            Evaluation(spec, table, ())(arrays, out.reshape((n, -1)), status)
            return out
        passed = [y for x in arrays for y in (np.ascontiguousarray(x), 1)]
        numba_kernels.batch_kernel(spec)(table if numba_kernels.PLAIN else table.ctypes.data, n, *passed, out, status)
    return out


def _round(record: NDArray[Any]) -> None:
    """Round every number of a table to float32, written in place."""
    for name in record.dtype.names or ():
        column = record[name]
        if column.dtype.names:
            _round(column)
        elif column.dtype.kind == "f":
            column[...] = column.astype(np.float32)
