"""Shared steps of recursions: a body's pose and velocity from its parent's, and one step from a frame to the world."""

from __future__ import annotations

from ..algebra.records import motion_of, pose_of, put_pose
from ..algebra.scalars import inline
from ..algebra.spatial import Motion, Pose, add_motion, compose, motion_to_child
from ..bodies.joints import joint_motion, place_joint
from ..bodies.kinds import CONTINUED
from .signatures import Bodies, Config, Record, Vector, Work


@inline
def body_velocity(bodies: Bodies, work: Work, i: int, v: Vector) -> Motion:
    """v_i = X v_λ + S q̇ of row i (RBDA eq. 5.7), from X in its scratch row and v in its parent's scratch row."""
    here, parent = work[i], work[bodies[i].parent]
    return add_motion(motion_to_child(pose_of(here.X), motion_of(parent.v)), joint_motion(bodies, i, v))


@inline
def moved_by_joint(here: Record, parent: Record, vJ: Motion) -> Motion:
    """v_i from vJ = S q̇, for recursions that also need vJ, as in v_i × vJ."""
    return add_motion(motion_to_child(pose_of(here.X), motion_of(parent.v)), vJ)


@inline
def placed_in_world(bodies: Bodies, work: Work, i: int, q: Config) -> Pose:
    """Pose of row i in the world, from its parent's; the scratch rows hold both."""
    b, here = bodies[i], work[i]
    if b.kind == CONTINUED:
        put_pose(here.X, pose_of(work[b.parent].X))
    else:
        place_joint(bodies, i, q, here.X)
        put_pose(here.X, compose(pose_of(work[b.parent].X), pose_of(here.X)))
    return pose_of(here.X)


@inline
def seen_from_parent(bodies: Bodies, work: Work, i: int, q: Config, X: Pose) -> Pose:
    """A pose given in row i, expressed in its parent; the pose of row i in its parent is written to the scratch row."""
    place_joint(bodies, i, q, work[i].X)
    return compose(pose_of(work[i].X), X)
