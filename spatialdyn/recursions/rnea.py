"""Inverse dynamics τ = M(q) q̈ + C(q, q̇) q̇ + g(q) by the recursive Newton-Euler algorithm."""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import (
    Rot,
    Vec,
    cross,
    minus,
    negative,
    plus,
    rate_of_spin,
    rotate,
    spin_matrix,
    times,
    unrotate,
    zero,
)
from ..algebra.records import (
    force_from,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_force,
    put_vec,
    table_dtype,
    vec_of,
)
from ..algebra.scalars import inlined
from ..algebra.spatial import Force, Pose, add_force, force_to_parent, power, sub_force, zero_force
from ..bodies.joints import joint_motion, off_norm, place_joint
from .spec import FEXT, FEXT_OPTIONAL, TAU, A, Q, Spec, V

WORK = table_dtype(X=Pose, w=Vec, dw=Vec, dv=Vec, f=Force, lv=Vec)  # lv: linear velocity, where q is off its norm


@inlined
def rnea(bodies: Any, work: Any, q: Any, v: Any, a: Any, fext: Any, tau: Any) -> None:
    """RBDA table 5.1 in body coordinates and classical accelerations; v, a, fext may be None, for zero.

    Per body ω, ω̇ and the acceleration a of its origin, gravity's taken away. With U = ω̇~ + ω̃² a point at p
    accelerates by a + U p, so the linear velocity is never needed and a fifth of the work of the spatial form is
    saved. A joint's own velocity (w, l) adds ω × w to ω̇ and (2 ω - w) × l to a.

    Where q is taken as it is and off its unit norm, X.R turns no cross product: ``_unturned`` is what the spatial form
    has more there.
    """
    off = v is not None and off_norm(bodies, q)
    if off:
        put_vec(work[0].lv, zero())
    put_vec(work[0].w, zero())
    put_vec(work[0].dw, zero())
    put_vec(work[0].dv, negative(vec_of(bodies[0].gravity)))
    put_force(work[0].f, zero_force())

    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        S, I = motion_of(b.S), inertia_of(b.inertia)
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        if v is None:
            if a is None:
                ai = unrotate(X.R, vec_of(parent.dv))
                f = Force(cross(I.h, ai), times(I.m, ai))
            else:
                dw = vec_of(parent.dw)
                ai = unrotate(X.R, plus(vec_of(parent.dv), cross(dw, X.p)))
                dw = plus(unrotate(X.R, dw), times(a[i - 1], S.w))
                ai = plus(ai, times(a[i - 1], S.v))
                f = _force(I, zero(), dw, ai)
                put_vec(here.dw, dw)
        else:
            w, dw = vec_of(parent.w), vec_of(parent.dw)
            ai = unrotate(X.R, plus(vec_of(parent.dv), rotate(spin_matrix(w, dw), X.p)))
            vJ = joint_motion(bodies, i, v)
            if off:
                l = plus(vec_of(parent.lv), cross(w, X.p))
                ai = plus(ai, _unturned(X.R, w, l))
                put_vec(here.lv, plus(unrotate(X.R, l), vJ.v))
            w = plus(unrotate(X.R, w), vJ.w)
            dw = plus(unrotate(X.R, dw), cross(w, vJ.w))
            ai = plus(ai, cross(plus(w, plus(w, negative(vJ.w))), vJ.v))
            if a is not None:
                dw = plus(dw, times(a[i - 1], S.w))
                ai = plus(ai, times(a[i - 1], S.v))
            f = _force(I, w, dw, ai)
            put_vec(here.w, w)
            put_vec(here.dw, dw)
        if fext is not None and b.joint > 0:
            f = sub_force(f, force_from(fext[b.joint]))
        put_vec(here.dv, ai)
        put_force(here.f, f)

    for i in range(len(bodies) - 1, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        f = force_of(here.f)
        t = power(motion_of(b.S), f)
        if a is not None:
            t = t + b.armature * a[i - 1]
        tau[i - 1] = t
        put_force(parent.f, add_force(force_of(parent.f), force_to_parent(pose_of(here.X), f)))


@inlined
def _unturned(R: Rot, w: Vec, l: Vec) -> Vec:
    """(Rᵀω) × (Rᵀl) - Rᵀ(ω × l), null for a rotation."""
    return minus(cross(unrotate(R, w), unrotate(R, l)), unrotate(R, cross(w, l)))


@inlined
def _force(I: Any, w: Vec, dw: Vec, a: Vec) -> Force:
    """What moves a body so: linear m a + U h, moment about its origin Ī ω̇ + ω × Ī ω + h × a."""
    U = spin_matrix(w, dw)
    return Force(plus(rate_of_spin(I.I, w, dw, U), cross(I.h, a)), plus(times(I.m, a), rotate(U, I.h)))


_SOURCE = "Featherstone, RBDA (2008), table 5.1, in classical accelerations (Luh, Walker, Paul 1980)."
SPECS = (
    Spec(
        "rnea", rnea, WORK, (Q, V, A, FEXT_OPTIONAL), TAU,
        "Inverse dynamics τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext by the recursive Newton-Euler algorithm.", _SOURCE,
        regroup=True,
    ),
    Spec(
        "nonlinear_effects", rnea, WORK, (Q, V, None, None), TAU,
        "Bias torque C(q, v) v + g(q): the torque at zero acceleration.", _SOURCE, regroup=True,
    ),
    Spec(
        "generalized_gravity", rnea, WORK, (Q, None, None, None), TAU,
        "Gravity torque g(q) = ∂V/∂q: the torque that holds the robot still.", _SOURCE, regroup=True,
    ),
    Spec(
        "static_torque", rnea, WORK, (Q, None, None, FEXT), TAU,
        "Torque g(q) - Σ Jᵀ fext that holds the robot still under external forces.", _SOURCE, regroup=True,
    ),
)  # fmt: skip
