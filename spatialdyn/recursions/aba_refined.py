"""Forward dynamics by the articulated body algorithm and two steps of iterative refinement."""

from __future__ import annotations

from typing import Any

from ..algebra.articulated import Articulated
from ..algebra.euclidean import Vec, zero
from ..algebra.records import table_dtype, vec_of
from ..algebra.scalars import inlined
from ..algebra.spatial import Force, Motion, Pose
from .aba import articulated_again, articulated_inward, articulated_outward
from .rnea import rnea
from .spec import FEXT_OPTIONAL, TAU, A, Q, Spec, V

WORK = table_dtype(
    X=Pose, v=Motion, c=Motion, a=Motion, IA=Articulated, pA=Force, U=Force, d=float, u=float,
    w=Vec, dw=Vec, dv=Vec, f=Force, lv=Vec,
)  # fmt: skip


STEPS = 2  # each takes of the error what ABA takes of a: with a tip of 1e9 it is 1e-7, then 2e-14, then rounding


@inlined
def aba_refined(
    bodies: Any, work: Any, q: Any, v: Any, tau: Any, fext: Any, a: Any, pivots: Any, residual: Any
) -> None:
    """ABA, then twice a += M⁻¹ (τ - RNEA(q, v, a)) with the factors X, U, D that are there; fext may be None, for zero.

    residual  (nv), written: what the last step has changed
    """
    articulated_inward(bodies, work, q, v, tau, fext, pivots)
    articulated_outward(bodies, work, v, vec_of(bodies[0].gravity), a)
    for _ in range(STEPS):
        rnea(bodies, work, q, v, a, fext, residual)
        for i in range(len(bodies) - 1):
            residual[i] = tau[i] - residual[i]
        articulated_again(bodies, work, residual)
        articulated_outward(bodies, work, None, zero(), residual)
        for i in range(len(bodies) - 1):
            a[i] = a[i] + residual[i]


SPECS = (
    Spec(
        "aba_refined", aba_refined, WORK, (Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) by the articulated body algorithm and two "
        "steps of refinement by the RNEA.",
        "Featherstone, RBDA (2008), tables 7.1 and 5.1.", pivots=True, regroup=True, spare=(("nv",),),
    ),
)  # fmt: skip
