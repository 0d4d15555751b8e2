"""Poses, Jacobians, velocities and accelerations of joints and frames.

Recursions of a frame walk from its body to the world: each step expresses the frame's pose in the next parent, so only
the joints that carry the frame are visited, and all is computed in the frame's own coordinates.
"""

from __future__ import annotations

from ...algebra.euclidean import add, cross, rotate, zero
from ...algebra.public_arrays import read_pose, write_motion, write_pose
from ...algebra.records import motion_of, pose_of, put_motion, put_pose, table_dtype
from ...algebra.scalars import inline, inline_or_by_rows
from ...algebra.spatial import (
    Motion,
    Pose,
    add_motion,
    compose,
    cross_motion,
    identity_pose,
    motion_at_child,
    motion_to_child,
    motion_to_parent,
    scale_motion,
    sub_motion,
    zero_motion,
)
from ...bodies.joints import joint_motion
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import (
    CLASSICAL,
    LOCAL,
    LOCAL_WORLD_ALIGNED,
    PLACEMENT,
    REFERENCE,
    ROW,
    TURNED_Q,
    WORLD,
    A,
    Argument,
    Spec,
    V,
)
from ..steps import placed_in_world, seen_from_parent

WORK = table_dtype(
    X=Pose,  # pose of the row in the world, outward; of frames, in its parent, on the walk
    v=Motion,  # velocity in the world, outward; a column of a frame's Jacobian, on the walk
)
WORK_RATE = table_dtype(
    X=Pose,  # as in WORK
    v=Motion,  # as in WORK
    dS=Motion,  # rate of the Jacobian's column in the frame, on the walk
)


@inline
def forward_kinematics(bodies: Bodies, work: Work, q: Config, X: Array) -> None:
    """Pose of every joint's body in the world, composed outward."""
    put_pose(work[0].X, identity_pose())
    write_pose(X[0], identity_pose())
    for i in range(1, len(bodies)):
        here = placed_in_world(bodies, work, i, q)
        if bodies[i].joint > 0:
            write_pose(X[bodies[i].joint], here)


@inline
def joint_jacobians(bodies: Bodies, work: Work, q: Config, J: Matrix) -> None:
    """Column i: S of row i in world coordinates."""
    put_pose(work[0].X, identity_pose())
    for i in range(1, len(bodies)):
        X = placed_in_world(bodies, work, i, q)
        write_motion(J[:, i - 1], motion_to_parent(X, motion_of(bodies[i].S)))


@inline
def joint_jacobians_dot(bodies: Bodies, work: Work, q: Config, v: Vector, dJ: Matrix) -> None:
    """Column i: d/dt of S in world coordinates, v × S (RBDA eq. 2.45)."""
    put_pose(work[0].X, identity_pose())
    put_motion(work[0].v, zero_motion())
    for i in range(1, len(bodies)):
        b = bodies[i]
        X = placed_in_world(bodies, work, i, q)
        vi = add_motion(motion_of(work[b.parent].v), motion_to_parent(X, joint_motion(bodies, i, v)))
        put_motion(work[i].v, vi)
        write_motion(dJ[:, i - 1], cross_motion(vi, motion_to_parent(X, motion_of(b.S))))


@inline
def express_in(X: Pose, m: Motion, reference: int) -> Motion:
    """A motion from the coordinates of a frame of pose X in the world to those of the reference."""
    if reference == LOCAL:
        return m
    if reference == WORLD:
        return motion_to_parent(X, m)
    return Motion(rotate(X.R, m.w), rotate(X.R, m.v))


@inline
def classical_acceleration(a: Motion, v: Motion) -> Motion:
    """The classical acceleration of the frame's origin: the spatial acceleration plus ω × v."""
    return Motion(a.w, add(a.v, cross(v.w, v.v)))


@inline_or_by_rows
def frame_placement(bodies: Bodies, work: Work, q: Config, row: int, placement: Matrix, out: Array) -> None:
    """Pose of the frame in the world."""
    X = read_pose(placement)
    i = row
    while i > 0:
        X = seen_from_parent(bodies, work, i, q, X)
        i = bodies[i].parent
    write_pose(out, X)


@inline_or_by_rows
def frame_jacobian(
    bodies: Bodies, work: Work, q: Config, row: int, placement: Matrix, reference: int, J: Matrix
) -> None:
    """Column i: S of row i in the frame's coordinates, then expressed in the reference."""
    J[:] = 0.0
    X = read_pose(placement)
    i = row
    while i > 0:
        put_motion(work[i].v, motion_to_child(X, motion_of(bodies[i].S)))
        X = seen_from_parent(bodies, work, i, q, X)
        i = bodies[i].parent
    i = row
    while i > 0:
        write_motion(J[:, i - 1], express_in(X, motion_of(work[i].v), reference))
        i = bodies[i].parent


@inline
def placed_frame_jacobian(bodies: Bodies, work: Work, row: int, placement: Matrix, reference: int, J: Matrix) -> None:
    """``frame_jacobian`` if work already has the world poses of the rows that carry the frame."""
    J[:] = 0.0
    X = compose(pose_of(work[row].X), read_pose(placement))
    i = row
    while i > 0:
        Ji = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        if reference == LOCAL:
            Ji = motion_to_child(X, Ji)
        if reference == LOCAL_WORLD_ALIGNED:
            Ji = motion_at_child(X.p, Ji)
        write_motion(J[:, i - 1], Ji)
        i = bodies[i].parent


@inline_or_by_rows
def frame_motion(
    bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, row: int, placement: Matrix
) -> tuple[Pose, Motion, Motion]:
    """Pose of the frame in the world, and its velocity and spatial acceleration in its own coordinates.

    The acceleration is Σ S a - u × S v, u the frame's velocity seen from the row. a may be None, for zero.
    """
    X = read_pose(placement)
    seen = zero_motion()
    total = zero_motion()
    i = row
    while i > 0:
        vJ = motion_to_child(X, joint_motion(bodies, i, v))
        total = sub_motion(total, cross_motion(seen, vJ))
        if a is not None:
            total = add_motion(total, motion_to_child(X, scale_motion(a[i - 1], motion_of(bodies[i].S))))
        seen = add_motion(seen, vJ)
        X = seen_from_parent(bodies, work, i, q, X)
        i = bodies[i].parent
    return X, seen, total


@inline
def frame_velocity(
    bodies: Bodies, work: Work, q: Config, v: Vector, row: int, placement: Matrix, reference: int, out: Array
) -> None:
    """Σ S v over the rows that carry the frame."""
    X, seen, _ = frame_motion(bodies, work, q, v, None, row, placement)
    write_motion(out, express_in(X, seen, reference))


@inline
def frame_acceleration(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    a: Vector,
    row: int,
    placement: Matrix,
    reference: int,
    classical: int,
    out: Array,
) -> None:
    """d/dt of the frame's velocity in its own coordinates.

    A spatial acceleration, unless ``classical``: then ω × v is added to its linear part. a may be None, for zero.
    """
    X, seen, total = frame_motion(bodies, work, q, v, a, row, placement)
    total = express_in(X, total, reference)
    if classical == 1:
        total = classical_acceleration(total, express_in(X, seen, reference))
    write_motion(out, total)


@inline
def jacobian_dot_times_v(
    bodies: Bodies, work: Work, q: Config, v: Vector, row: int, placement: Matrix, reference: int, out: Array
) -> None:
    """d/dt of the frame's velocity at zero joint acceleration, in the reference."""
    aligned = 0
    if reference == LOCAL_WORLD_ALIGNED:
        aligned = 1
    frame_acceleration(bodies, work, q, v, None, row, placement, reference, aligned, out)


@inline_or_by_rows
def frame_jacobian_dot(
    bodies: Bodies, work: Work, q: Config, v: Vector, row: int, placement: Matrix, reference: int, dJ: Matrix
) -> None:
    """Column i: d/dt of S of row i in the frame's coordinates, -u × S with u the frame's velocity seen from the row.

    In references that do not turn with the frame, the frame's own motion is added: V × S in world, ω × S in
    local_world_aligned, which only translates with the frame.
    """
    dJ[:] = 0.0
    X = read_pose(placement)
    seen = zero_motion()
    i = row
    while i > 0:
        S = motion_to_child(X, motion_of(bodies[i].S))
        put_motion(work[i].v, S)
        put_motion(work[i].dS, cross_motion(S, seen))
        seen = add_motion(seen, motion_to_child(X, joint_motion(bodies, i, v)))
        X = seen_from_parent(bodies, work, i, q, X)
        i = bodies[i].parent
    own = zero_motion()
    if reference == WORLD:
        own = seen
    if reference == LOCAL_WORLD_ALIGNED:
        own = Motion(seen.w, zero())
    i = row
    while i > 0:
        dS = add_motion(motion_of(work[i].dS), cross_motion(own, motion_of(work[i].v)))
        write_motion(dJ[:, i - 1], express_in(X, dS, reference))
        i = bodies[i].parent


_BODY = "the definition, evaluated from the frame to the world."
_JACOBIAN = ("m/rad | 1", "linear first, in the reference")
SPECS = (
    Spec(
        "forward_kinematics", forward_kinematics, WORK, (TURNED_Q,),
        Argument("X", ("njoints", 4, 4), "m", "pose of each joint in the world; row 0 is the world"),
        "Poses of all joints in the world.", "Featherstone, RBDA (2008), section 4.4.",
    ),
    Spec(
        "joint_jacobians", joint_jacobians, WORK, (TURNED_Q,),
        Argument("J", (6, "nv"), "m/rad | 1", "each joint's motion subspace in world coordinates, linear first"),
        "Jacobians of all bodies in one matrix: a body's, in the world, has the columns of the joints that carry it.",
        "Featherstone, RBDA (2008), section 2.11.",
    ),
    Spec(
        "joint_jacobians_dot", joint_jacobians_dot, WORK, (TURNED_Q, V),
        Argument("dJ", (6, "nv"), "m/(rad s) | 1/s", "time derivative of each column, linear first"),
        "Time derivative of joint_jacobians along v.", "Featherstone, RBDA (2008), eq. 2.45.",
    ),
    Spec(
        "frame_placement", frame_placement, WORK, (TURNED_Q, ROW, PLACEMENT),
        Argument("X", (4, 4), "m", "pose of the frame in the world"),
        "Pose of a frame in the world.", _BODY,
    ),
    Spec(
        "frame_jacobian", frame_jacobian, WORK, (TURNED_Q, ROW, PLACEMENT, REFERENCE),
        Argument("J", (6, "nv"), *_JACOBIAN),
        "Jacobian J of a frame: its velocity is J v.", _BODY,
    ),
    Spec(
        "frame_jacobian_dot", frame_jacobian_dot, WORK_RATE, (TURNED_Q, V, ROW, PLACEMENT, REFERENCE),
        Argument("dJ", (6, "nv"), "m/(rad s) | 1/s", "time derivative of each column, linear first, in the reference"),
        "Time derivative of frame_jacobian along v.", _BODY,
    ),
    Spec(
        "frame_velocity", frame_velocity, WORK, (TURNED_Q, V, ROW, PLACEMENT, REFERENCE),
        Argument("V", (6,), "m/s | rad/s", "velocity of the frame, linear first, in the reference"),
        "Velocity of a frame.", _BODY,
    ),
    Spec(
        "frame_acceleration", frame_acceleration, WORK, (TURNED_Q, V, A, ROW, PLACEMENT, REFERENCE, CLASSICAL),
        Argument("acceleration", (6,), "m/s² | rad/s²", "acceleration of the frame, linear first, in the reference"),
        "Acceleration of a frame, spatial or classical.", _BODY,
    ),
    Spec(
        "jacobian_dot_times_v", jacobian_dot_times_v, WORK, (TURNED_Q, V, ROW, PLACEMENT, REFERENCE),
        Argument("drift", (6,), "m/s² | rad/s²", "linear first, in the reference"),
        "J̇ v, the acceleration of a frame at zero joint acceleration: J a + J̇ v is the derivative of J v.\n\n"
        "    It is a spatial acceleration in local and world, a classical one in local_world_aligned.", _BODY,
    ),
)  # fmt: skip
