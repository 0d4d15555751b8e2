"""Forward dynamics by a method of one's choice: what a digit more costs, and where it is missing."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engines.compiled import numba_kernels
from ..engines.numbers.double_double import Twofold, recorded
from ..engines.programs import batch_kernels
from ..engines.programs.tracer import evaluate
from ..errors import SpatialDynError
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .arguments import core_shape
from .dynamics import calls

METHODS = {"aba": "aba", "crba": "crba_solve", "refined": "aba_refined", "square_root": "aba_square_root"}
EXTENDED = "extended"  # no call of its own: aba's recursion on numbers of two floats
MOST_ROWS = 32  # above, its program has 100 000 operations, which take half a minute to compile


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

    method  what computes it; each but the last is a call of its own as well. With the cost of one call, and of a sample
            of a batch, in units of ABA's own, and the forward error max|a - a*| / max|a*| of a chain of 7 links whose
            last is so many times heavier, which nine of ten random states are below:

            =============  ===============  ====  =====  =======  =======  =======  =======  =======
            method         call             cost  batch  1        1e3      1e6      1e9      1e12
            =============  ===============  ====  =====  =======  =======  =======  =======  =======
            "aba"          aba              1     1      1e-15    1e-13    1e-10    1e-7     1e-4
            "crba"         crba_solve       1     0.7    1e-15    1e-12    1e-9     1e-6     1e-3
            "refined"      aba_refined      1.5   1.7    1e-15    1e-15    2e-15    3e-15    2e-13
            "square_root"  aba_square_root  3.5   120    1e-15    1e-15    2e-15    3e-15    2e-15
            "extended"                      120   9      1e-16    1e-16    1e-16    1e-16    1e-16
            =============  ===============  ====  =====  =======  =======  =======  =======  =======

            The same of links about parallel axes that are oblique to their frames, which are parallel to rounding only:

            =============  =======  =======  =======  =======
            method         1e3      1e6      1e9      1e12
            =============  =======  =======  =======  =======
            "aba"          6e-13    6e-10    6e-7     6e-4
            "crba"         3e-12    3e-9     3e-6     3e-3
            "refined"      3e-13    3e-10    3e-7     3e-4
            "square_root"  3e-13    3e-10    3e-7     3e-4
            "extended"     1e-16    1e-16    1e-16    1e-16
            =============  =======  =======  =======  =======

            The worst of a hundred lose ten times as much in "aba" and "crba", in "refined" and "square_root" in
            general position 3e-14, where an ulp of q, v and tau moves the exact answer as far ("refined" to 3e-10 at
            1e12); in one of a thousand 1e-12. ``benchmarks/forward.py`` prints all these, and the cost.

            "extended" is ABA in double-double, rounded at the end: a batch of 512 or more of a robot of up to 32
            freedoms is off by no more than four times what an ulp of q, v and tau moves the exact answer, for the sine
            is that of an angle up to two ulp away; all else by half an ulp. The first batch compiles for 1 to 7 s.
            Frames turned every way, as in the second table, cost 14 in place of 9. What ABA refuses it refuses.

            Light links cost no digits in any of them; long chains do in "crba" (n = 100: 1e-11, the others 1e-14),
            which works in O(n d²) for trees of depth d, the others in O(n). "square_root" branches on values, so it
            is no program for SIMD lanes, and it needs inertias that are positive semidefinite, body by body.

            None of them says that digits are missing before a joint moves no inertia at all. iCub at neutral is off by
            0.03 to 3 % in all but "extended": its head is a mass point, and a joint of its neck moves 1e-11 of its
            inertia. A chain four of whose joints move less than iCub's four keeps seven digits under a tip of 1e10, so
            articulated inertias cannot tell the two apart; ``diagnose`` does, by measuring.

    model   Model
    q       (..., nq)            joint positions [rad | m]
    v       (..., nv)            joint velocities [rad/s | m/s]
    tau     (..., nv)            joint torques [N m | N]
    fext    (..., njoints, 6)    force on each joint's body, in the joint's frame, linear first; zero if left out
    out     (..., nv)            written if given: float64, C order, of the result's very shape

    Returns a (..., nv): joint accelerations [rad/s² | m/s²]. With mimic joints every method goes through M.
    Raises  SpatialDynError for another method, and what ``aba`` raises.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> q, v, tau = [0.5, -0.3], [1.0, 2.0], [0.1, 0.2]
    >>> a = sd.forward_dynamics(model, q, v, tau, method="square_root")
    >>> bool(abs(a - sd.aba(model, q, v, tau)).max() < 1e-13 * abs(a).max())
    True
    """
    extended = isinstance(method, str) and method == EXTENDED
    try:
        call = calls["aba" if extended else METHODS[method]]
    except (KeyError, TypeError):
        expected = ", ".join((*METHODS, EXTENDED))
        raise SpatialDynError(f"method is {method!r}, expected one of {expected}") from None
    if not extended:
        a: NDArray[Any] = call(model, q, v, tau, fext, out=out)
        return a
    given = [q, v, tau] if fext is None else [q, v, tau, fext]
    found = _at_once(model, given) if out is None else None
    return _extended(model, given, call(model, q, v, tau, fext, out=out)) if found is None else found


def _at_once(model: Model, given: list[Any]) -> NDArray[Any] | None:
    """The answer to batches of float64 of one size, all of whose samples are in order; None for anything else."""
    if type(model) is not Model or model.mimic_matrix is not None or numba_kernels.PLAIN:
        return None
    spec = _variant(len(given))
    n = len(given[0]) if isinstance(given[0], np.ndarray) and given[0].ndim == 2 else 0
    for x, value in zip(spec.given, given, strict=True):
        fit = type(value) is np.ndarray and value.dtype == np.float64 and value.flags.c_contiguous
        if n < batch_kernels.FROM or not fit or value.shape != (n, *core_shape(model, x)):
            return None
    kernel, a = _on_lanes(spec, model), np.empty((n, model.nv))
    odd = None if kernel is None else kernel([x.reshape((n, -1)) for x in given], (a,))
    return a if odd is not None and not len(odd) else None


def _variant(inputs: int) -> Spec:
    """aba's, with external forces or without."""
    return numba_kernels.variant(SPECS["aba"], frozenset({"fext"} if inputs > 3 else ()))


def _extended(model: Model, given: list[ArrayLike], a: NDArray[Any]) -> NDArray[Any]:
    """The accelerations a (..., nv) of ABA, which has checked the inputs, written over by those of double-double."""
    if not a.size or model.mimic_matrix is not None:
        return a
    spec = _variant(len(given))
    batch, n = a.shape[:-1], a.size // model.nv
    rows = []
    for x, value in zip(spec.given, given, strict=True):
        core = core_shape(model, x)
        whole = np.broadcast_to(np.asarray(value, np.float64), (*batch, *core))
        rows.append(np.ascontiguousarray(whole.reshape((n, -1))))
    flat, better = a.reshape((n, model.nv)), np.empty((n, model.nv))
    left = np.flatnonzero(np.isfinite(flat).all(axis=1))
    kernel = _on_lanes(spec, model) if n >= batch_kernels.FROM and not numba_kernels.PLAIN else None
    odd = None if kernel is None else kernel(rows, (better,))
    if odd is not None:
        fine = np.ones(n, bool)
        fine[odd] = False
        flat[fine] = better[fine]
        left = left[~fine[left]]
    if len(left):
        program = _recorded(spec, model)
        flat[left] = program(np.ascontiguousarray(np.concatenate([x[left] for x in rows], axis=1).T))[0].T
    return a


@lru_cache(maxsize=batch_kernels.KEPT)
def _on_lanes(spec: Spec, model: Model) -> batch_kernels.Kernel | None:
    """The program of double-double on SIMD lanes, if there can be one."""
    if not 1 < len(model.bodies) <= MOST_ROWS + 1:
        return None
    return batch_kernels.kernel((spec,), model.bodies, model.key, choice=batch_kernels.Choice(doubled=True))


@lru_cache(maxsize=batch_kernels.KEPT)
def _recorded(spec: Spec, model: Model) -> Twofold:
    """The same for a few samples, and for robots of any size."""
    sizes = [int(np.prod(core_shape(model, x))) for x in spec.given]
    places = np.cumsum([0, *sizes])

    def made(rows: Any, x: Any) -> list[Any]:
        parts = {
            arg.name: x[first : first + size].reshape(core_shape(model, arg))
            for arg, first, size in zip(spec.given, places[:-1], sizes, strict=True)
        }
        return list(evaluate(spec, rows, (model.nv,), parts, np.empty(model.nv, object)))

    return recorded(model.bodies, int(places[-1]), made)
