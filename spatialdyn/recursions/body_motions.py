"""What each joint's body does: its velocity, its acceleration, the force its joint carries; all in its own frame."""

from __future__ import annotations

from typing import Any

from ..algebra.records import (
    force_of,
    motion_of,
    pose_of,
    public_force,
    public_motion,
    put_motion,
    table_dtype,
)
from ..algebra.scalars import inlined
from ..algebra.spatial import (
    Motion,
    Pose,
    add_motion,
    cross_motion,
    motion_to_child,
    scale_motion,
    zero_force,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .rnea import WORK as WORK_RNEA
from .rnea import rnea
from .spec import FEXT_OPTIONAL, A, Argument, Q, Spec, V

WORK_VELOCITY = table_dtype(X=Pose, v=Motion)
WORK_ACCELERATION = table_dtype(X=Pose, v=Motion, a=Motion)


@inlined
def joint_velocities(bodies: Any, work: Any, q: Any, v: Any, V: Any) -> None:
    """v = v_λ + S q̇ outward (RBDA eq. 5.7)."""
    put_motion(work[0].v, zero_motion())
    public_motion(V[0], zero_motion())
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        vi = add_motion(motion_to_child(pose_of(here.X), motion_of(parent.v)), joint_motion(bodies, i, v))
        put_motion(here.v, vi)
        if b.joint > 0:
            public_motion(V[b.joint], vi)


@inlined
def joint_accelerations(bodies: Any, work: Any, q: Any, v: Any, a: Any, out: Any) -> None:
    """a = a_λ + S q̈ + v × S q̇ outward (RBDA eq. 5.8), from rest: gravity is no part of it."""
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].a, zero_motion())
    public_motion(out[0], zero_motion())
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X, vJ = pose_of(here.X), joint_motion(bodies, i, v)
        vi = add_motion(motion_to_child(X, motion_of(parent.v)), vJ)
        aJ = add_motion(scale_motion(a[i - 1], motion_of(b.S)), cross_motion(vi, vJ))
        ai = add_motion(motion_to_child(X, motion_of(parent.a)), aJ)
        put_motion(here.v, vi)
        put_motion(here.a, ai)
        if b.joint > 0:
            public_motion(out[b.joint], ai)


@inlined
def joint_forces(bodies: Any, work: Any, q: Any, v: Any, a: Any, fext: Any, F: Any, tau: Any) -> None:
    """The f that the RNEA projects on S: all that a joint transmits, of which its torque is one component."""
    rnea(bodies, work, q, v, a, fext, tau)
    public_force(F[0], zero_force())
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            public_force(F[bodies[i].joint], force_of(work[i].f))


SPECS = (
    Spec(
        "joint_velocities", joint_velocities, WORK_VELOCITY, (Q, V),
        Argument("V", ("njoints", 6), "m/s | rad/s", "of each joint's body in its own frame, linear first; row 0 is 0"),
        "Spatial velocities of all bodies.", "Featherstone, RBDA (2008), eq. 5.7.",
    ),
    Spec(
        "joint_accelerations", joint_accelerations, WORK_ACCELERATION, (Q, V, A),
        Argument(
            "accelerations", ("njoints", 6), "m/s² | rad/s²",
            "of each joint's body in its own frame, linear first; row 0 is 0",
        ),
        "Spatial accelerations of all bodies; gravity is no part of them.", "Featherstone, RBDA (2008), eq. 5.8.",
    ),
    Spec(
        "joint_forces", joint_forces, WORK_RNEA, (Q, V, A, FEXT_OPTIONAL),
        Argument(
            "F", ("njoints", 6), "N | N m",
            "on each joint's body by its joint, in the body's frame, linear first; row 0 is 0",
        ),
        "Forces that the joints transmit: those of bearings and motors together, rotor inertia left out.",
        "Featherstone, RBDA (2008), table 5.1.", spare=(("nv",),),
    ),
)  # fmt: skip
