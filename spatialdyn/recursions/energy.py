"""Kinetic and potential energy."""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import Vec, dot, plus, rotate, times
from ..algebra.records import (
    inertia_of,
    motion_of,
    pose_of,
    put_motion,
    put_vec,
    table_dtype,
    vec_of,
)
from ..algebra.scalars import inlined
from ..algebra.spatial import Motion, Pose, add_motion, momentum, motion_to_child, power, zero_motion
from ..bodies.joints import joint_motion, place_joint
from .spec import Argument, Q, Spec, V

WORK_KINETIC = table_dtype(X=Pose, v=Motion)
WORK_MOMENT = table_dtype(X=Pose, m=float, h=Vec)


@inlined
def kinetic_energy(bodies: Any, work: Any, q: Any, v: Any, T: Any) -> None:
    """T = ½ Σ v·I v + ½ Σ armature q̇² (RBDA eq. 2.67)."""
    put_motion(work[0].v, zero_motion())
    twice = 0.0
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        vi = add_motion(motion_to_child(pose_of(here.X), motion_of(parent.v)), joint_motion(bodies, i, v))
        put_motion(here.v, vi)
        twice = twice + power(vi, momentum(inertia_of(b.inertia), vi)) + b.armature * v[i - 1] * v[i - 1]
    T[0] = 0.5 * twice


@inlined
def mass_moment(bodies: Any, work: Any, q: Any) -> None:
    """Mass m and first moment h of every subtree, in its body's frame; row 0: of the robot, in the world."""
    n = len(bodies) - 1
    for i in range(n + 1):
        I = inertia_of(bodies[i].inertia)
        work[i].m = I.m
        put_vec(work[i].h, I.h)
        if i > 0:
            place_joint(bodies, i, q, work[i].X)
    for i in range(n, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        X = pose_of(here.X)
        parent.m = parent.m + here.m
        put_vec(parent.h, plus(vec_of(parent.h), plus(rotate(X.R, vec_of(here.h)), times(here.m, X.p))))


@inlined
def potential_energy(bodies: Any, work: Any, q: Any, V: Any) -> None:
    """V = -Σ m g·c, with g the acceleration of gravity: the body that stands higher has more."""
    mass_moment(bodies, work, q)
    V[0] = -dot(vec_of(bodies[0].gravity), vec_of(work[0].h))


SPECS = (
    Spec(
        "kinetic_energy", kinetic_energy, WORK_KINETIC, (Q, V), Argument("T", (), "J", "kinetic energy"),
        "Kinetic energy T = ½ vᵀ M(q) v, reflected rotor inertia counted.",
        "Featherstone, RBDA (2008), eq. 2.67.",
    ),
    Spec(
        "potential_energy", potential_energy, WORK_MOMENT, (Q,), Argument("V", (), "J", "potential energy"),
        "Potential energy V(q) = -Σ m gᵀ c of gravity; zero where the centre of mass is at the world's origin.",
        "the definition.",
    ),
)  # fmt: skip
