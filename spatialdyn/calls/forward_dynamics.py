"""Forward dynamics by a method of choice: error and cost of each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engines import extended
from ..engines.compiled import numba_kernels
from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .arguments import core_shape, flatten_batch
from .dynamics import calls

METHODS = {"aba": "aba", "crba": "crba_solve", "refined": "aba_refined", "square_root": "aba_square_root"}
EXTENDED = "extended"  # the recursion of aba in double-double; has no public call


def forward_dynamics(
    model: Model,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    fext: ArrayLike | None = None,
    method: str = "aba",
    out: Any = None,
) -> NDArray[Any]:
    """Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext).

    Source: Featherstone, RBDA (2008), table 7.1 and chapter 6; the other methods start from there.

    method  the algorithm; each but the last is also a public call. Costs are of one call, and of a sample of a batch,
            relative to ABA's. Errors are max|a - a*| / max|a*| for a chain of 7 links whose last link is 1 to 1e12
            times heavier than the others, the 90 % quantile over random states:

            =============  ===============  ====  =====  =======  =======  =======  =======  =======
            method         call             cost  batch  1        1e3      1e6      1e9      1e12
            =============  ===============  ====  =====  =======  =======  =======  =======  =======
            "aba"          aba              1     1      1e-15    1e-13    1e-10    1e-7     1e-4
            "crba"         crba_solve       1     0.8    1e-15    1e-12    1e-9     1e-6     1e-3
            "refined"      aba_refined      1.2   1.7    1e-15    1e-15    2e-15    3e-15    2e-13
            "square_root"  aba_square_root  60    120    1e-15    1e-15    2e-15    3e-15    2e-15
            "extended"                      400   7      1e-16    1e-16    1e-16    1e-16    1e-16
            =============  ===============  ====  =====  =======  =======  =======  =======  =======

            The same errors for parallel axes oblique to their frames, so that they are parallel to rounding only:

            =============  =======  =======  =======  =======
            method         1e3      1e6      1e9      1e12
            =============  =======  =======  =======  =======
            "aba"          6e-13    6e-10    6e-7     6e-4
            "crba"         3e-12    3e-9     3e-6     3e-3
            "refined"      3e-13    3e-10    3e-7     3e-4
            "square_root"  3e-13    3e-10    3e-7     3e-4
            "extended"     1e-16    1e-16    1e-16    1e-16
            =============  =======  =======  =======  =======

            In the worst of a hundred states the errors of "aba" and "crba" are ten times larger. Those of "refined" and
            "square_root" are 3e-14 in general position ("refined": 3e-10 at 1e12), the change of the exact answer by
            an ulp of q, v and tau; in one state of a thousand, 1e-12. ``benchmarks/forward.py`` prints all errors and
            costs.

            "extended" is ABA in double-double, rounded at the end. Its error is half an ulp; in batches of 512 or more,
            for robots of up to 32 degrees of freedom, it is at most four times the change of the exact answer by an ulp
            of q, v and tau (angles of sines may be off by two ulp). The first batch compiles for seconds. Oblique
            frames, as in the second table, double the cost of "extended" and of "aba". It raises where ABA raises.

            Light links cost no digits in any method. Long chains cost digits in "crba" (n = 100: 1e-11, the others
            1e-14), which is O(n d²) for trees of depth d; the others are O(n). "square_root" branches on values, so it
            has no program for SIMD lanes, and it needs a positive semidefinite inertia for each body.

            No method reports lost digits before a joint has zero articulated inertia. iCub at neutral is off by 0.03
            to 3 % in all methods but "extended": its head is a mass point, and the articulated inertia of a neck joint
            is 1e-11 of its composite inertia. A chain with four smaller ratios keeps seven digits under a tip of
            1e10, so articulated inertias do not predict the loss of digits; ``diagnose`` measures it.

    model   Model
    q       (..., nq)            joint positions [rad | m]
    v       (..., nv)            joint velocities [rad/s | m/s]
    tau     (..., nv)            joint torques [N m | N]
    fext    (..., njoints, 6)    force on each joint's body, in the joint's frame, linear first; zero if left out
    out     (..., nv)            written in place if given: float64, C order, the shape of the result

    Returns a (..., nv): joint accelerations [rad/s² | m/s²]. With mimic joints every method solves with M.
    Raises  SpatialDynError for another method, and the errors of ``aba``.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> q, v, tau = [0.5, -0.3], [1.0, 2.0], [0.1, 0.2]
    >>> a = sd.forward_dynamics(model, q, v, tau, method="square_root")
    >>> bool(abs(a - sd.aba(model, q, v, tau)).max() < 1e-13 * abs(a).max())
    True
    """
    in_double_double = isinstance(method, str) and method == EXTENDED
    try:
        call = calls["aba" if in_double_double else METHODS[method]]
    except (KeyError, TypeError):
        expected = ", ".join((*METHODS, EXTENDED))
        raise SpatialDynError(f"method is {literal(method)}, expected one of {expected}") from None
    if not in_double_double:
        a: NDArray[Any] = call(model, q, v, tau, fext, out=out)
        return a
    given = [q, v, tau] if fext is None else [q, v, tau, fext]
    found = _batch_in_double_double(model, given) if out is None else None
    if found is not None:
        return found
    return _rewrite_in_double_double(model, given, call(model, q, v, tau, fext, out=out), out is not None)


def _batch_in_double_double(model: Model, given: list[Any]) -> NDArray[Any] | None:
    """The result for float64 batches of one size if no sample fails. Returns None if not applicable."""
    if type(model) is not Model:
        return None
    spec = _aba_variant(len(given))
    n = len(given[0]) if isinstance(given[0], np.ndarray) and given[0].ndim == 2 else 0
    for x, value in zip(spec.present, given, strict=True):
        fit = type(value) is np.ndarray and value.dtype == np.float64 and value.flags.c_contiguous
        if not n or not fit or value.shape != (n, *core_shape(model, x)):
            return None
    a = np.empty((n, model.nv))
    return a if extended.compute_on_lanes(spec, model, [x.reshape((n, -1)) for x in given], a) else None


def _aba_variant(inputs: int) -> Spec:
    """The spec of aba with external forces (4 inputs) or without (3)."""
    return numba_kernels.variant(SPECS["aba"], frozenset({"fext"} if inputs > 3 else ()))


def _rewrite_in_double_double(model: Model, given: list[ArrayLike], a: NDArray[Any], seen: bool) -> NDArray[Any]:
    """Overwrite ABA's accelerations a (..., nv) by those of double-double; ABA has checked the inputs.

    seen  whether the caller reads ``a`` after Ctrl-C
    """
    if not a.size:
        return a
    spec = _aba_variant(len(given))
    batch, n = a.shape[:-1], a.size // model.nv
    rows = []
    for x, value in zip(spec.present, given, strict=True):
        whole = flatten_batch(np.asarray(value, np.float64), batch, core_shape(model, x))
        rows.append(whole.reshape((len(whole), -1)))
    extended.rewrite(spec, model, rows, a.reshape((n, model.nv)), seen)
    return a


def extended_runs_on_lanes(model: Model) -> bool:
    """Whether "extended" has a program on SIMD lanes for batches of a model; compiles it."""
    return extended.runs_on_lanes(_aba_variant(3), model)
