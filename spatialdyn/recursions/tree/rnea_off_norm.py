"""The terms that Pinocchio's RNEA adds for quaternions and (cos, sin) pairs off their unit norm.

R of such a q is no rotation: Rᵀ(ω × l) is not (Rᵀω) × (Rᵀl). In the spatial form, which Pinocchio uses, the linear
acceleration of a body then has a term that the classical form in ``rnea`` lacks:

    (Rᵀω) × (Rᵀl) - Rᵀ(ω × l),    ω and l the angular and linear velocity of the parent's point at the row's origin.

Models of the library refuse such a q; those of the Pinocchio face, whose world row is of kind ANY_NORM, accept it.
"""

from __future__ import annotations

from ...algebra.euclidean import Mat3, Vec, add, cross, scale, sub, unrotate, zero
from ...algebra.records import force_of, inertia_of, pose_of, put_force, put_vec, vec_of
from ...algebra.scalars import inline
from ...algebra.spatial import Force, add_force
from ...bodies.joints import joint_motion, off_norm
from ..signatures import Bodies, Config, Vector, Work


@inline
def add_off_norm_forces(bodies: Bodies, work: Work, q: Config, v: Vector) -> None:
    """Add the force of these terms to the f of rnea's outward sweep, if q is off its unit norm; v may be None.

    The fields dw and dv, which rnea no longer needs, hold the linear velocity and the added acceleration.
    """
    if v is not None and off_norm(bodies, q):
        put_vec(work[0].dw, zero())
        put_vec(work[0].dv, zero())
        for i in range(1, len(bodies)):
            here, parent = work[i], work[bodies[i].parent]
            X, I = pose_of(here.X), inertia_of(bodies[i].inertia)
            w = vec_of(parent.w)
            l = add(vec_of(parent.dw), cross(w, X.p))
            more = add(unrotate(X.R, vec_of(parent.dv)), _unturned(X.R, w, l))
            put_vec(here.dw, add(unrotate(X.R, l), joint_motion(bodies, i, v).v))
            put_vec(here.dv, more)
            put_force(here.f, add_force(force_of(here.f), Force(cross(I.h, more), scale(I.m, more))))


@inline
def _unturned(R: Mat3, w: Vec, l: Vec) -> Vec:
    """(Rᵀω) × (Rᵀl) - Rᵀ(ω × l), zero for a rotation."""
    return sub(cross(unrotate(R, w), unrotate(R, l)), unrotate(R, cross(w, l)))
