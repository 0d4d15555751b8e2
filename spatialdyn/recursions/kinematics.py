"""Where the joints and frames are and how they move.

A frame is walked from its body up to the world: the pose of the frame in row i grows by one joint a step, so
only the joints that carry the frame are visited and everything is computed in the frame's own coordinates.
"""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import cross, plus, rotate, zero
from ..algebra.records import (
    motion_of,
    pose_from,
    pose_of,
    public_motion,
    public_pose,
    put_motion,
    put_pose,
    table_dtype,
)
from ..algebra.scalars import inlined
from ..algebra.spatial import (
    Motion,
    Pose,
    add_motion,
    compose,
    cross_motion,
    identity_pose,
    motion_to_child,
    motion_to_parent,
    scale_motion,
    sub_motion,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .spec import CLASSICAL, LOCAL, LOCAL_WORLD_ALIGNED, PLACEMENT, REFERENCE, ROW, WORLD, A, Argument, Q, Spec, V

WORK = table_dtype(X=Pose, v=Motion)
WORK_RATE = table_dtype(X=Pose, v=Motion, dS=Motion)


@inlined
def forward_kinematics(bodies: Any, work: Any, q: Any, X: Any) -> None:
    """Pose of every joint's body in the world, composed outward."""
    put_pose(work[0].X, identity_pose())
    public_pose(X[0], identity_pose())
    for i in range(1, len(bodies)):
        b = bodies[i]
        place_joint(bodies, i, q, work[i].X)
        here = compose(pose_of(work[b.parent].X), pose_of(work[i].X))
        put_pose(work[i].X, here)
        if b.joint > 0:
            public_pose(X[b.joint], here)


@inlined
def joint_jacobians(bodies: Any, work: Any, q: Any, J: Any) -> None:
    """Column i: S of row i in world coordinates."""
    put_pose(work[0].X, identity_pose())
    for i in range(1, len(bodies)):
        b = bodies[i]
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[b.parent].X), pose_of(work[i].X))
        put_pose(work[i].X, X)
        public_motion(J[:, i - 1], motion_to_parent(X, motion_of(b.S)))


@inlined
def joint_jacobians_dot(bodies: Any, work: Any, q: Any, v: Any, dJ: Any) -> None:
    """Column i: d/dt of S in world coordinates, v × S (RBDA eq. 2.45)."""
    put_pose(work[0].X, identity_pose())
    put_motion(work[0].v, zero_motion())
    for i in range(1, len(bodies)):
        b = bodies[i]
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[b.parent].X), pose_of(work[i].X))
        vi = add_motion(motion_of(work[b.parent].v), motion_to_parent(X, joint_motion(bodies, i, v)))
        put_pose(work[i].X, X)
        put_motion(work[i].v, vi)
        public_motion(dJ[:, i - 1], cross_motion(vi, motion_to_parent(X, motion_of(b.S))))


@inlined
def referred(X: Pose, m: Motion, reference: int) -> Motion:
    """A motion in the coordinates of a frame that stands at X in the world, in those of the reference."""
    if reference == LOCAL:
        return m
    if reference == WORLD:
        return motion_to_parent(X, m)
    return Motion(rotate(X.R, m.w), rotate(X.R, m.v))


@inlined
def of_point(a: Motion, v: Motion) -> Motion:
    """The acceleration of the point where the frame is, of its spatial one and its velocity: ω × v is added."""
    return Motion(a.w, plus(a.v, cross(v.w, v.v)))


@inlined
def frame_placement(bodies: Any, work: Any, q: Any, row: int, placement: Any, out: Any) -> None:
    """Pose of the frame in the world."""
    X = pose_from(placement)
    i = row
    while i > 0:
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    public_pose(out, X)


@inlined
def frame_jacobian(bodies: Any, work: Any, q: Any, row: int, placement: Any, reference: int, J: Any) -> None:
    """Column i: S of row i in the frame's coordinates, then in those of the reference."""
    for k in range(6):
        for i in range(1, len(bodies)):
            J[k, i - 1] = 0.0
    X = pose_from(placement)
    i = row
    while i > 0:
        put_motion(work[i].v, motion_to_child(X, motion_of(bodies[i].S)))
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    i = row
    while i > 0:
        public_motion(J[:, i - 1], referred(X, motion_of(work[i].v), reference))
        i = bodies[i].parent


@inlined
def frame_velocity(bodies: Any, work: Any, q: Any, v: Any, row: int, placement: Any, reference: int, out: Any) -> None:
    """Σ S v over the rows that carry the frame."""
    X = pose_from(placement)
    total = zero_motion()
    i = row
    while i > 0:
        total = add_motion(total, motion_to_child(X, joint_motion(bodies, i, v)))
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    public_motion(out, referred(X, total, reference))


@inlined
def carried(bodies: Any, work: Any, q: Any, v: Any, a: Any, row: int, placement: Any) -> tuple[Pose, Motion, Motion]:
    """Pose of the frame in the world, and its velocity and spatial acceleration in its own coordinates.

    The acceleration is Σ S a - u × S v, u the frame's velocity seen from the row. a may be None, for zero.
    """
    X = pose_from(placement)
    seen = zero_motion()
    total = zero_motion()
    i = row
    while i > 0:
        vJ = motion_to_child(X, joint_motion(bodies, i, v))
        total = sub_motion(total, cross_motion(seen, vJ))
        if a is not None:
            total = add_motion(total, motion_to_child(X, scale_motion(a[i - 1], motion_of(bodies[i].S))))
        seen = add_motion(seen, vJ)
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    return X, seen, total


@inlined
def frame_acceleration(
    bodies: Any, work: Any, q: Any, v: Any, a: Any, row: int, placement: Any, reference: int, classical: int, out: Any
) -> None:
    """d/dt of the frame's velocity in its own coordinates.

    A spatial acceleration, unless ``classical``: then ω × v is added to its linear part. a may be None, for zero.
    """
    X, seen, total = carried(bodies, work, q, v, a, row, placement)
    total = referred(X, total, reference)
    if classical == 1:
        total = of_point(total, referred(X, seen, reference))
    public_motion(out, total)


@inlined
def jacobian_dot_times_v(
    bodies: Any, work: Any, q: Any, v: Any, row: int, placement: Any, reference: int, out: Any
) -> None:
    """d/dt of the frame's velocity at zero joint acceleration, in the reference."""
    aligned = 0
    if reference == LOCAL_WORLD_ALIGNED:
        aligned = 1
    frame_acceleration(bodies, work, q, v, None, row, placement, reference, aligned, out)


@inlined
def frame_jacobian_dot(
    bodies: Any, work: Any, q: Any, v: Any, row: int, placement: Any, reference: int, dJ: Any
) -> None:
    """Column i: d/dt of S of row i in the frame's coordinates, -u × S with u the frame's velocity seen from the row.

    In coordinates that do not turn and travel with the frame the frame's own motion is added: V × S in the world's,
    ω × S in those that only travel with it.
    """
    for k in range(6):
        for i in range(1, len(bodies)):
            dJ[k, i - 1] = 0.0
    X = pose_from(placement)
    seen = zero_motion()
    i = row
    while i > 0:
        S = motion_to_child(X, motion_of(bodies[i].S))
        put_motion(work[i].v, S)
        put_motion(work[i].dS, cross_motion(S, seen))
        seen = add_motion(seen, motion_to_child(X, joint_motion(bodies, i, v)))
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    own = zero_motion()
    if reference == WORLD:
        own = seen
    if reference == LOCAL_WORLD_ALIGNED:
        own = Motion(seen.w, zero())
    i = row
    while i > 0:
        dS = add_motion(motion_of(work[i].dS), cross_motion(own, motion_of(work[i].v)))
        public_motion(dJ[:, i - 1], referred(X, dS, reference))
        i = bodies[i].parent


_BODY = "the definition, walked from the frame to the world."
_JACOBIAN = ("m/rad | 1", "linear first, in the reference")
SPECS = (
    Spec(
        "forward_kinematics", forward_kinematics, WORK, (Q,),
        Argument("X", ("njoints", 4, 4), "m", "pose of each joint in the world; row 0 is the world"),
        "Poses of all joints in the world.", "Featherstone, RBDA (2008), section 4.4.",
    ),
    Spec(
        "joint_jacobians", joint_jacobians, WORK, (Q,),
        Argument("J", (6, "nv"), "m/rad | 1", "each joint's motion subspace in world coordinates, linear first"),
        "Jacobian of every joint at once: the columns that carry a body are its Jacobian in the world.",
        "Featherstone, RBDA (2008), section 2.11.",
    ),
    Spec(
        "joint_jacobians_dot", joint_jacobians_dot, WORK, (Q, V),
        Argument("dJ", (6, "nv"), "m/(rad s) | 1/s", "time derivative of each column, linear first"),
        "Time derivative of joint_jacobians along v.", "Featherstone, RBDA (2008), eq. 2.45.",
    ),
    Spec(
        "frame_placement", frame_placement, WORK, (Q, ROW, PLACEMENT),
        Argument("X", (4, 4), "m", "pose of the frame in the world"),
        "Pose of a frame in the world.", _BODY,
    ),
    Spec(
        "frame_jacobian", frame_jacobian, WORK, (Q, ROW, PLACEMENT, REFERENCE),
        Argument("J", (6, "nv"), *_JACOBIAN),
        "Jacobian J of a frame: its velocity is J v.", _BODY,
    ),
    Spec(
        "frame_jacobian_dot", frame_jacobian_dot, WORK_RATE, (Q, V, ROW, PLACEMENT, REFERENCE),
        Argument("dJ", (6, "nv"), "m/(rad s) | 1/s", "time derivative of each column, linear first, in the reference"),
        "Time derivative of frame_jacobian along v.", _BODY,
    ),
    Spec(
        "frame_velocity", frame_velocity, WORK, (Q, V, ROW, PLACEMENT, REFERENCE),
        Argument("V", (6,), "m/s | rad/s", "velocity of the frame, linear first, in the reference"),
        "Velocity of a frame.", _BODY,
    ),
    Spec(
        "frame_acceleration", frame_acceleration, WORK, (Q, V, A, ROW, PLACEMENT, REFERENCE, CLASSICAL),
        Argument("acceleration", (6,), "m/s² | rad/s²", "acceleration of the frame, linear first, in the reference"),
        "Acceleration of a frame, spatial or classical.", _BODY,
    ),
    Spec(
        "jacobian_dot_times_v", jacobian_dot_times_v, WORK, (Q, V, ROW, PLACEMENT, REFERENCE),
        Argument("drift", (6,), "m/s² | rad/s²", "linear first, in the reference"),
        "J̇ v, what a frame accelerates by at zero joint acceleration: J a + J̇ v is the derivative of J v.\n\n"
        "    It is a spatial acceleration in local and world, a classical one in local_world_aligned.", _BODY,
    ),
)  # fmt: skip
