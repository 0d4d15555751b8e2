"""Forward dynamics by the articulated body algorithm and two steps of iterative refinement."""

from __future__ import annotations

from ...algebra.articulated import Articulated
from ...algebra.euclidean import Vec, zero
from ...algebra.records import table_dtype, vec_of
from ...algebra.scalars import inline
from ...algebra.spatial import Force, Motion, Pose
from ..signatures import Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, TURNED_Q, A, Spec, V
from .aba import aba_inward, aba_outward, aba_resolve, acceleration_through_M
from .rnea import rnea

WORK = table_dtype(
    X=Pose,  # of aba, as are the fields to u; each refinement computes X anew, to the same bits
    v=Motion,
    c=Motion,
    a=Motion,  # also of the correction
    IA=Articulated,
    pA=Force,  # also of the correction
    U=Force,
    d=float,
    u=float,  # also of the correction
    w=Vec,  # of rnea, as are the fields to f; written by each refinement
    dw=Vec,
    dv=Vec,
    f=Force,
)


STEPS = 2  # each multiplies the error by ABA's relative error: for a tip of 1e9, 1e-7, then 2e-14, then rounding


@inline
def aba_refined(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    tau: Vector,
    fext: Matrix,
    a: Vector,
    pivots: Vector,
    residual: Vector,
) -> None:
    """ABA, then twice a += M⁻¹ (τ - RNEA(q, v, a)) by the X, U, D of the first pass; fext may be None, for zero.

    residual  (nv), written: the last change of a
    """
    aba_inward(bodies, work, q, v, tau, fext, pivots)
    aba_outward(bodies, work, v, vec_of(bodies[0].gravity), a)
    for _ in range(STEPS):
        rnea(bodies, work, q, v, a, fext, residual)
        for i in range(len(bodies) - 1):
            residual[i] = tau[i] - residual[i]
        aba_resolve(bodies, work, residual)
        aba_outward(bodies, work, None, zero(), residual)
        for i in range(len(bodies) - 1):
            a[i] = a[i] + residual[i]


SPECS = (
    Spec(
        "aba_refined", aba_refined, WORK, (TURNED_Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) by the articulated body algorithm and two "
        "steps of refinement by the RNEA.",
        "Featherstone, RBDA (2008), tables 7.1 and 5.1.", pivots=True, regroup=True, scratch=(("nv",),),
        through_M=acceleration_through_M, residual=("rnea", "minverse"),
    ),
)  # fmt: skip
