"""Inverse dynamics τ = M(q) q̈ + C(q, q̇) q̇ + g(q) by the recursive Newton-Euler algorithm."""

from __future__ import annotations

from typing import Any

from ..scalars import inlined
from ..spatial import (
    Force,
    Motion,
    Pose,
    add_force,
    add_motion,
    cross_force,
    cross_motion,
    force_from,
    force_of,
    force_to_parent,
    inertia_of,
    momentum,
    motion_of,
    motion_to_child,
    negative,
    pose_of,
    power,
    put_force,
    put_motion,
    scale_motion,
    sub_force,
    table_dtype,
    vec_of,
    zero,
    zero_force,
    zero_motion,
)
from .joints import joint_motion, place_joint
from .spec import FEXT, FEXT_OPTIONAL, TAU, A, Q, Spec, V

WORK = table_dtype(X=Pose, v=Motion, a=Motion, f=Force)


@inlined
def rnea(bodies: Any, work: Any, q: Any, v: Any, a: Any, fext: Any, tau: Any) -> None:
    """RBDA table 5.1 in body coordinates; v, a, fext may be None, for zero."""
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].a, Motion(zero(), negative(vec_of(bodies[0].gravity))))
    put_force(work[0].f, zero_force())

    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        I = inertia_of(b.inertia)
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        ai = motion_to_child(X, motion_of(parent.a))
        if a is not None:
            ai = add_motion(ai, scale_motion(a[i - 1], motion_of(b.S)))
        if v is None:
            f = momentum(I, ai)
        else:
            vJ = joint_motion(bodies, i, v)
            vi = add_motion(motion_to_child(X, motion_of(parent.v)), vJ)
            ai = add_motion(ai, cross_motion(vi, vJ))
            f = add_force(momentum(I, ai), cross_force(vi, momentum(I, vi)))
            put_motion(here.v, vi)
        if fext is not None and b.joint > 0:
            f = sub_force(f, force_from(fext[b.joint]))
        put_motion(here.a, ai)
        put_force(here.f, f)

    for i in range(len(bodies) - 1, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        f = force_of(here.f)
        t = power(motion_of(b.S), f)
        if a is not None:
            t = t + b.armature * a[i - 1]
        tau[i - 1] = t
        put_force(parent.f, add_force(force_of(parent.f), force_to_parent(pose_of(here.X), f)))


_SOURCE = "Featherstone, RBDA (2008), table 5.1."
SPECS = (
    Spec(
        "rnea", rnea, WORK, (Q, V, A, FEXT_OPTIONAL), TAU,
        "Inverse dynamics τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext by the recursive Newton-Euler algorithm.", _SOURCE,
    ),
    Spec(
        "nonlinear_effects", rnea, WORK, (Q, V, None, None), TAU,
        "Bias torque C(q, v) v + g(q): the torque at zero acceleration.", _SOURCE,
    ),
    Spec(
        "generalized_gravity", rnea, WORK, (Q, None, None, None), TAU,
        "Gravity torque g(q) = ∂V/∂q: the torque that holds the robot still.", _SOURCE,
    ),
    Spec(
        "static_torque", rnea, WORK, (Q, None, None, FEXT), TAU,
        "Torque g(q) - Σ Jᵀ fext that holds the robot still under external forces.", _SOURCE,
    ),
)  # fmt: skip
