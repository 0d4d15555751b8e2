"""Velocity and acceleration of each joint's body and the force that its joint transmits, all in the body's frame."""

from __future__ import annotations

from ...algebra.public_arrays import write_force, write_motion
from ...algebra.records import force_of, motion_of, pose_of, put_motion, table_dtype
from ...algebra.scalars import inline
from ...algebra.spatial import (
    Motion,
    Pose,
    add_motion,
    cross_motion,
    motion_to_child,
    scale_motion,
    zero_force,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT_OPTIONAL, TURNED_Q, A, Argument, Spec, V
from ..steps import body_velocity, moved_by_joint
from .rnea import WORK as WORK_RNEA
from .rnea import rnea

WORK_VELOCITY = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
)
WORK_ACCELERATION = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    a=Motion,  # spatial acceleration, gravity left out; outward
)


@inline
def joint_velocities(bodies: Bodies, work: Work, q: Config, v: Vector, V: Matrix) -> None:
    """v = v_λ + S q̇ outward (RBDA eq. 5.7)."""
    put_motion(work[0].v, zero_motion())
    write_motion(V[0], zero_motion())
    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        vi = body_velocity(bodies, work, i, v)
        put_motion(here.v, vi)
        if b.joint > 0:
            write_motion(V[b.joint], vi)


@inline
def joint_accelerations(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, out: Array) -> None:
    """a = a_λ + S q̈ + v × S q̇ outward (RBDA eq. 5.8), from a world at rest, without gravity."""
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].a, zero_motion())
    write_motion(out[0], zero_motion())
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X, vJ = pose_of(here.X), joint_motion(bodies, i, v)
        vi = moved_by_joint(here, parent, vJ)
        aJ = add_motion(scale_motion(a[i - 1], motion_of(b.S)), cross_motion(vi, vJ))
        ai = add_motion(motion_to_child(X, motion_of(parent.a)), aJ)
        put_motion(here.v, vi)
        put_motion(here.a, ai)
        if b.joint > 0:
            write_motion(out[b.joint], ai)


@inline
def joint_forces(
    bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, fext: Matrix, F: Matrix, tau: Vector
) -> None:
    """f_i of the RNEA, the whole force that a joint transmits; the joint torque S·f is one component of it."""
    rnea(bodies, work, q, v, a, fext, tau)
    write_force(F[0], zero_force())
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            write_force(F[bodies[i].joint], force_of(work[i].f))


SPECS = (
    Spec(
        "joint_velocities", joint_velocities, WORK_VELOCITY, (TURNED_Q, V),
        Argument("V", ("njoints", 6), "m/s | rad/s", "of each joint's body in its own frame, linear first; row 0 is 0"),
        "Spatial velocities of all bodies.", "Featherstone, RBDA (2008), eq. 5.7.",
    ),
    Spec(
        "joint_accelerations", joint_accelerations, WORK_ACCELERATION, (TURNED_Q, V, A),
        Argument(
            "accelerations", ("njoints", 6), "m/s² | rad/s²",
            "of each joint's body in its own frame, linear first; row 0 is 0",
        ),
        "Spatial accelerations of all bodies, without gravity.", "Featherstone, RBDA (2008), eq. 5.8.",
    ),
    Spec(
        "joint_forces", joint_forces, WORK_RNEA, (TURNED_Q, V, A, FEXT_OPTIONAL),
        Argument(
            "F", ("njoints", 6), "N | N m",
            "on each joint's body by its joint, in the body's frame, linear first; row 0 is 0",
        ),
        "Force that each joint transmits, by bearing and motor together, without the armature's.",
        "Featherstone, RBDA (2008), table 5.1.", scratch=(("nv",),),
    ),
)  # fmt: skip
