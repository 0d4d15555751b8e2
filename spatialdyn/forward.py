"""Forward dynamics by a method of one's choice: what a digit more costs, and where it is missing."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike, NDArray

from .dynamics import calls
from .errors import SpatialDynError
from .model import Model

METHODS = {"aba": "aba", "crba": "crba_solve", "refined": "aba_refined", "square_root": "aba_square_root"}


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

    method  what computes it; each is a call of its own as well. With the cost of one call, and of a sample of a batch,
            in units of ABA's own, and the forward error max|a - a*| / max|a*| of a chain of 7 links whose last is so
            many times heavier, which nine of ten random states are below:

            =============  ===============  ====  =====  =======  =======  =======  =======  =======
            method         call             cost  batch  1        1e3      1e6      1e9      1e12
            =============  ===============  ====  =====  =======  =======  =======  =======  =======
            "aba"          aba              1     1      1e-15    1e-13    1e-10    1e-7     1e-4
            "crba"         crba_solve       1     0.7    1e-15    1e-12    1e-9     1e-6     1e-3
            "refined"      aba_refined      1.5   1.7    1e-15    1e-15    2e-15    3e-15    2e-13
            "square_root"  aba_square_root  3.5   120    1e-15    1e-15    2e-15    3e-15    2e-15
            =============  ===============  ====  =====  =======  =======  =======  =======  =======

            The worst of a hundred lose ten times as much in "aba" and "crba"; the others come to 3e-14, where an ulp of
            q, v and tau moves the exact answer as far ("refined" to 3e-10 at 1e12). ``benchmarks/forward.py`` prints
            these, and the cost. Rarer states lose more: 1e-12 has been seen in one of a thousand.

            Light links cost no digits in any of them; long chains do in "crba" (n = 100: 1e-11, the others 1e-14),
            which works in O(n d²) for trees of depth d, the others in O(n). "square_root" branches on values, so it
            is no program for SIMD lanes, and it needs inertias that are positive semidefinite, body by body. It keeps
            its digits where the axes of joints lie along those of frames or in general position; axes that are
            parallel but oblique to their frames are parallel to rounding only, and then it falls back to ABA's.

            None of them says that digits are missing before a joint moves no inertia at all. iCub at neutral is off by
            0.03 to 3 % in all of them: its head is a mass point, and a joint of its neck moves 1e-11 of its inertia. A
            chain four of whose joints move less than iCub's four keeps seven digits under a tip of 1e10, so articulated
            inertias cannot tell the two apart; ``diagnose`` does, by measuring.

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
    try:
        call = calls[METHODS[method]]
    except (KeyError, TypeError):
        raise SpatialDynError(f"method is {method!r}, expected one of {', '.join(METHODS)}") from None
    a: NDArray[Any] = call(model, q, v, tau, fext, out=out)
    return a
