"""How many digits calls keep on a model: single ones, batches on SIMD lanes, and float32, against the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import full_shape
from ..calls.dynamics import calls
from ..calls.forward_dynamics import METHODS
from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels
from ..engines.programs.regroup import regroup
from ..errors import SpatialDynError
from ..model.model import Model
from ..recursions import SPECS
from .references import of_calls, truths

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]

EPS = {"float64": float(np.finfo(np.float64).eps), "float32": float(np.finfo(np.float32).eps)}
COARSER = EPS["float32"] / EPS["float64"]
INPUTS = {"rnea": "qva", "crba": "q", "aba": "qva", "aba_refined": "qva", "minverse": "q"}  # the calls that are judged
SHORT = 32  # freedoms to which all of them are judged; of 100, crba takes 20 s to compile, aba_refined 8
ALWAYS = ("rnea", "aba")  # 2 and 4 s, and show what regrouping costs calls without and with pivots


def predicted_digits(model: Model, states: Sequence[State]) -> dict[str, dict[str, float]]:
    """Digits of the largest acceleration to expect of each method, the worst of some states; see ``method_errors``.

    states  (q, v, tau) each; the model has no mimic joints
    Returns {method: {"float64": digits, "float32": digits}}, -log10 of the error, 0 where none is right.
    """
    arrays = [np.array([s[k] for s in states]) for k in range(3)]
    return {
        method: {dtype: digits_of(errors, EPS[dtype]) for dtype, errors in found.items()}
        for method, found in method_errors(model, arrays).items()
    }


def digits_of(errors: Array, least: float = EPS["float64"]) -> float:
    """Digits that the worst of some errors leaves: at most those of the precision, at least 0."""
    return max(0.0, -math.log10(min(1.0, max(least, float(errors.max(initial=0.0))))))


def method_errors(model: Model, arrays: list[Array]) -> dict[str, dict[str, Array]]:
    """Errors of the largest acceleration by every method of ``forward_dynamics``, against ABA in double-double.

    float64 is what single calls run, measured. float32 follows from it: the same rounding 2²⁹ times as large, for
    "refined" that of its first solution squared, and what the rounding of the model's numbers and of the inputs moves.
    It is of float32 throughout, in its range of exponents too: samples whose pivots it loses, or that leave its range,
    are computed in float64 by ``specialize``.

    arrays  q (n, nq), v (n, nv), tau (n, nv)
    Returns {method: {"float64": (n,), "float32": (n,)}}, infinite where a method gives no numbers.
    """
    with np.errstate(all="ignore"):
        truth, _ = truths(model, "aba", arrays, checked=0)
        measured = {method: of_calls("aba", single(model, name, arrays), truth) for method, name in METHODS.items()}
        bodies = model.bodies.copy()
        regroup(bodies, solved=True)  # as a program has it, whose constants are rounded after that
        _round(bodies)
        rounded = [x.astype(np.float32).astype(np.float64) for x in arrays]
        moved = of_calls("aba", single(model, METHODS["refined"], rounded, bodies), truth)
        first = COARSER * measured["aba"]
        return {
            method: {
                "float64": found,
                "float32": COARSER * found + moved + (first * first if method == "refined" else 0.0),
            }
            for method, found in measured.items()
        }


def program_errors(model: Model, arrays: list[Array]) -> dict[str, tuple[Array, Array]]:
    """Errors of calls, by name: of single ones, and of one batch that runs as a program on SIMD lanes.

    arrays  q (n, nq), v (n, nv), and a or tau (n, nv), n at least ``batches.FROM``
    Returns {} where no program runs: for long models, without mimic joints only, with NUMBA_DISABLE_JIT.
    """
    if numba_kernels.PLAIN or model.mimic_matrix is not None:
        return {}
    found = {}
    for name, letters in INPUTS.items():
        given = [arrays["qva".index(x)] for x in letters]
        spec = SPECS[name]
        if not batch_kernels.fits((spec,), model.bodies) or (model.nv > SHORT and name not in ALWAYS):
            continue
        alone = single(model, name, given)
        sound = np.flatnonzero(np.isfinite(alone.reshape(len(alone), -1)).all(axis=1))
        if not len(sound):
            continue
        chosen = np.resize(sound, max(len(sound), batch_kernels.FROM))  # a batch with a singular sample gives no answer
        given = [x[chosen] for x in given]
        try:
            batch = np.asarray(calls[name](model, *given))
        except SpatialDynError:
            continue
        of = "crba" if name == "minverse" else name  # both are matrices, scaled by their diagonals
        with np.errstate(all="ignore"):
            truth, _ = truths(model, "aba" if name == "aba_refined" else name, given, checked=0)
            found[name] = of_calls(of, alone[chosen], truth), of_calls(of, batch, truth)
    return found


def single(model: Model, name: str, arrays: list[Array], bodies: NDArray[Any] | None = None) -> Array:
    """The answers of the kernel that single calls run, sample by sample; what it gives no number for is not finite.

    bodies  another table than the model's
    """
    spec = numba_kernels.variant(SPECS[name], frozenset())
    table = model.bodies if bodies is None else bodies
    n = len(arrays[0])
    out = np.full((n, *full_shape(model, spec.output)), np.nan)
    passed = [y for x in arrays for y in (np.ascontiguousarray(x), 1)]
    with np.errstate(all="ignore"):
        numba_kernels.batch(spec)(
            table if numba_kernels.PLAIN else table.ctypes.data, n, *passed, out, np.empty(n, np.int8)
        )
    return out


def _round(record: NDArray[Any]) -> None:
    """Every number of a table to the nearest of float32, in place."""
    for name in record.dtype.names or ():
        column = record[name]
        if column.dtype.names:
            _round(column)
        elif column.dtype.kind == "f":
            column[...] = column.astype(np.float32)
