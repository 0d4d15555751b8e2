"""Kinetic and potential energy."""

from __future__ import annotations

from ...algebra.euclidean import Vec, add, dot, rotate, scale
from ...algebra.records import inertia_of, motion_of, pose_of, put_motion, put_vec, table_dtype, vec_of
from ...algebra.scalars import inline
from ...algebra.spatial import Motion, Pose, momentum, power, zero_motion
from ...bodies.joints import place_joint
from ..signatures import Bodies, Config, Vector, Work
from ..spec import TURNED_Q, Argument, Spec, V
from ..steps import body_velocity

WORK_KINETIC = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
)
WORK_MOMENT = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    m=float,  # mass, outward; of the subtree, inward
    h=Vec,  # first moment of mass, outward; of the subtree, inward
)


@inline
def kinetic_energy(bodies: Bodies, work: Work, q: Config, v: Vector, T: Vector) -> None:
    """T = ½ Σ v·I v + ½ Σ armature q̇² (RBDA eq. 2.67) + Σ n J q̇ e·ω of the rotors."""
    put_motion(work[0].v, zero_motion())
    twice = 0.0
    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        vi = body_velocity(bodies, work, i, v)
        put_motion(here.v, vi)
        twice = twice + power(vi, momentum(inertia_of(b.inertia), vi)) + b.armature * v[i - 1] * v[i - 1]
        if b.coupled:
            twice = twice + 2.0 * b.coupling * v[i - 1] * v[b.parent - 1]
        if b.geared:
            twice = twice + 2.0 * v[i - 1] * dot(vec_of(b.rotor), motion_of(work[b.parent].v).w)
    T[0] = 0.5 * twice


@inline
def mass_moment(bodies: Bodies, work: Work, q: Config) -> None:
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
        put_vec(parent.h, add(vec_of(parent.h), add(rotate(X.R, vec_of(here.h)), scale(here.m, X.p))))


@inline
def potential_energy(bodies: Bodies, work: Work, q: Config, V: Vector) -> None:
    """V = -Σ m g·c, with g the acceleration of gravity."""
    mass_moment(bodies, work, q)
    V[0] = -dot(vec_of(bodies[0].gravity), vec_of(work[0].h))


SPECS = (
    Spec(
        "kinetic_energy", kinetic_energy, WORK_KINETIC, (TURNED_Q, V), Argument("T", (), "J", "kinetic energy"),
        "Kinetic energy T = ½ vᵀ M(q) v, reflected rotor inertia included.",
        "Featherstone, RBDA (2008), eq. 2.67.",
    ),
    Spec(
        "potential_energy", potential_energy, WORK_MOMENT, (TURNED_Q,), Argument("V", (), "J", "potential energy"),
        "Potential energy V(q) = -Σ m gᵀ c of gravity; zero where the centre of mass is at the world's origin.",
        "the definition.",
    ),
)  # fmt: skip
