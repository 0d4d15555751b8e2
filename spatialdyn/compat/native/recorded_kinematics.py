"""Kinematics of joints and frames at what a call recorded: placements, motions, Jacobians.

What is no call of the library is a Routine, which the caller binds to words: the addresses of the table of bodies and
of arrays, and sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ...algebra import spatial
from ...algebra.public_arrays import read_motion, read_pose, write_motion, write_pose
from ...algebra.records import motion_of, pose_of, put_pose
from ...algebra.scalars import inline
from ...algebra.spatial import Motion, Pose, identity_pose
from ...bodies.joints import place_joint
from ...bodies.kinds import CONTINUED
from ...engines.compiled.angles import turned
from ...engines.compiled.checks import all_finite, unit_norm
from ...engines.compiled.memory import array_at, at, memory, places, records, release, table_at, word
from ...engines.compiled.numba_kernels import FLOAT, OK
from ...engines.compiled.tiers import table_kernel
from ...engines.programs.run.routine import Choice, Index, Kind, Owner, Parts, Result, Routine, routine
from ...recursions import SPECS
from ...recursions.spec import LOCAL, LOCAL_WORLD_ALIGNED, WORLD
from ...recursions.steps import placed_in_world
from ...recursions.tree.body_motions import WORK_ACCELERATION, WORK_VELOCITY, joint_accelerations, joint_velocities
from ...recursions.tree.kinematics import (
    WORK,
    classical_acceleration,
    express_in,
    joint_jacobians,
    placed_frame_jacobian,
)
from ...recursions.tree.regressor import body_force
from . import operator_kernels
from .recorded_calls import write_stamp

REFERENCES = ("in_frame", "in_world", "aligned")  # words: ids of the ReferenceFrame objects, in the order of codes
ROW_SIZE, VELOCITY_SIZE, ACCELERATION_SIZE = WORK.itemsize, WORK_VELOCITY.itemsize, WORK_ACCELERATION.itemsize
OF_FRAME: dict[str, Kind] = {"k": Index("frames"), "code": Choice(REFERENCES)}
AT_POSE: dict[str, Kind] = {"k": Index("frames"), "p": Owner((4, 4), "pose", "slot"), "code": Choice(REFERENCES)}
_forward_kinematics, _frame_jacobian = (table_kernel(SPECS[name]) for name in ("forward_kinematics", "frame_jacobian"))


class Frames(NamedTuple):
    """Words of frames: their number, addresses of their joints, and of addresses of their placements."""

    frames: int
    joints: int
    placements: int


@inline
def _place_frame(pose: Any, frames: Frames, k: int, result: int) -> None:
    """Write the pose of frame k from that of its joint to its place in the result."""
    there = read_pose(at(word(frames.placements, k), (4, 4)))
    write_pose(at(result + 128 * k, (4, 4)), spatial.compose(read_pose(pose), there))


@routine()
def place_frames(njoints: int, poses: int, result: int, frames: Frames, clock: int, time: int) -> bool:
    """Write the poses of all frames to ``result``, from the ``poses`` of their joints."""
    X = at(poses, (njoints, 4, 4))
    for k in range(frames.frames):
        _place_frame(X[word(frames.joints, k)], frames, k, result)
    write_stamp(clock, time)
    return True


@routine(q=("nq",))
def place_joints_and_frames(
    q: Any, table: int, njoints: int, poses: int, result: int, frames: Frames, clock: int, time: int
) -> bool:
    """``place_frames`` that computes the poses of the joints too; q is to be recorded."""
    X = at(poses, (njoints, 4, 4))
    if _forward_kinematics(table, q, X) != OK:
        return False
    for k in range(frames.frames):
        _place_frame(X[word(frames.joints, k)], frames, k, result)
    write_stamp(clock, time)
    return True


@routine(k=Index("frames"))
def place_frame(k: int, poses: int, result: int, frames: Frames) -> bool:
    """Write the pose of one frame to its place in ``result``, from that of its joint."""
    _place_frame(at(poses + 128 * word(frames.joints, k), (4, 4)), frames, k, result)
    return True


@inline
def motion_in_reference(X: Pose, placement: Pose, m: Motion, reference: int) -> Motion:
    """Motion m of a body, in its joint's frame at X, expressed in a reference at a frame on the body."""
    if reference == WORLD:
        return spatial.motion_to_parent(X, m)
    here = spatial.motion_to_child(placement, m)
    return here if reference == LOCAL else express_in(spatial.compose(X, placement), here, reference)


@inline
def _write_frame_motion(X: Any, placement: Any, v: Any, a: Any, classical: bool, reference: int, out: Any) -> None:
    """``motion_in_reference`` of a; ``classical``: acceleration of the frame's origin, with its velocity from v."""
    pose, there = read_pose(X), read_pose(placement)
    m = motion_in_reference(pose, there, read_motion(a), reference)
    if classical:
        m = classical_acceleration(m, motion_in_reference(pose, there, read_motion(v), reference))
    write_motion(out, m)


write_frame_motion = operator_kernels.compiled(_write_frame_motion)


class OnFrames(NamedTuple):
    """A call about a frame of the model as a routine, and about one at a pose on a joint."""

    of_frame: Routine
    at_pose: Routine


def _on_frames(name: str, output: Result, words: type, call: Callable[..., bool]) -> OnFrames:
    """Of ``call(joint, placement, code, words, out)``. Words of the second: the class ``pose``, and its ``slot``."""

    def of_frame(k: int, code: int, given: Any, frames: Frames, out: Any) -> bool:
        return call(word(frames.joints, k), at(word(frames.placements, k), (4, 4)), code, given, out)

    def at_pose(k: int, p: Any, code: int, given: Any, frames: Frames, out: Any) -> bool:
        return call(word(frames.joints, k), p, code, given, out)

    of_frame.__annotations__["given"] = at_pose.__annotations__["given"] = words
    of_pose = Routine(inline(at_pose), AT_POSE, output, f"{name}_at_pose")
    return OnFrames(Routine(inline(of_frame), OF_FRAME, output, f"{name}_of_frame"), of_pose)


class Motions(NamedTuple):
    """Words: addresses of fields of all joints; ``motions`` are read, and velocities if ``classical`` is not 0."""

    poses: int
    velocities: int
    motions: int
    classical: int


@inline
def _frame_motion(i: int, p: Any, code: int, given: Motions, out: Any) -> bool:
    """The velocity or acceleration of a frame from that of its joint."""
    X, v = at(given.poses + 128 * i, (4, 4)), at(given.velocities + 48 * i, (6,))
    _write_frame_motion(X, p, v, at(given.motions + 48 * i, (6,)), given.classical != 0, code, out)
    return True


class Recorded(NamedTuple):
    """Words: what a call recorded; ``placed_rows`` are the rows of ``jacobians`` (0: none), ``time`` the stamps, which
    are equal if the rows are those of the call.
    """

    table: int
    nq: int
    nv: int
    q: int
    v: int
    placed_rows: int
    time: int


@inline
def _frame_jacobian_at_recorded(i: int, p: Any, code: int, given: Recorded, out: Any) -> bool:
    """``frame_jacobian`` at the recorded q, of a row of the table; not if joints were moved after that call."""
    table, time = given.table, given.time
    if word(time, 0) < word(table, -1):
        return False
    if given.placed_rows != 0 and word(time, 0) == word(time, 1):
        bodies = table_at(table)
        placed_frame_jacobian(bodies, records(given.placed_rows, (len(bodies),), WORK), i, p, code, out)
        return True
    return bool(_frame_jacobian(table, at(given.q, (given.nq,)), i, p, code, out) == OK)


def _at_recorded(name: str, output: Result, but: int) -> OnFrames:
    """A call about a frame at the recorded q and v, not in the reference ``but``, nor if joints were moved after."""
    kernel = table_kernel(SPECS[name])

    def call(i: int, p: Any, code: int, given: Recorded, out: Any) -> bool:
        if code == but or word(given.time, 0) < word(given.table, -1):
            return False
        q, v = at(given.q, (given.nq,)), at(given.v, (given.nv,))
        return bool(kernel(given.table, q, v, i, p, code, out) == OK)

    return _on_frames(name, output, Recorded, inline(call))


frame_motion = _on_frames("frame_motion", Owner((6,), "made", "slot"), Motions, _frame_motion)  # made: class of Motion
frame_jacobian = _on_frames("frame_jacobian", (6, "nv"), Recorded, _frame_jacobian_at_recorded)


frame_jacobian_dot = _at_recorded("frame_jacobian_dot", (6, "nv"), -1)
frame_velocity_derivatives = _at_recorded("frame_velocity_derivatives", Parts((2, 6, "nv")), LOCAL_WORLD_ALIGNED)


@inline
def _write_poses(bodies: Any, work: Any, X: Any) -> None:
    """Write the poses of the joints from those of the rows in the world."""
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            write_pose(X[bodies[i].joint], pose_of(work[i].X))


@routine((6, "nv"), q=("nq",))
def jacobians(
    q: Any, table: int, nq: int, njoints: int, placed_rows: int, oMi: int, clock: int, time: int, out: Any
) -> bool:
    """``joint_jacobians``, which keeps its rows and writes the field oMi, if its address is not 0; to be recorded."""
    bodies = table_at(table)
    if not unit_norm(bodies, q):
        return False
    angles = memory(24 * nq)
    work = records(placed_rows, (len(bodies),), WORK)
    places(time, (2,))[1] = 0
    joint_jacobians(bodies, work, turned(q, array_at(angles, (3, nq), FLOAT)), out)
    release(angles, 24 * nq)
    if not all_finite(out):
        return False
    if oMi != 0:
        _write_poses(bodies, work, at(oMi, (njoints, 4, 4)))
    places(time, (2,))[1] = word(clock, 0) + 1  # the stamp that is recorded next
    return True


@inline
def _compose_rows(bodies: Any, work: Any, X: Any, V: Any) -> None:
    """Write poses of the joints in the world, and velocities, from the rows of ``joint_velocities``."""
    put_pose(work[0].X, identity_pose())
    write_motion(V[0], motion_of(work[0].v))
    for i in range(1, len(bodies)):
        put_pose(work[i].X, spatial.compose(pose_of(work[bodies[i].parent].X), pose_of(work[i].X)))
        if bodies[i].joint > 0:
            write_motion(V[bodies[i].joint], motion_of(work[i].v))
    _write_poses(bodies, work, X)


@routine(q=("nq",), v=("nv",))
def velocities(q: Any, v: Any, table: int, nq: int, njoints: int, oMi: int, v_out: int) -> bool:
    """``joint_velocities``, and poses in the world."""
    bodies = table_at(table)
    if not unit_norm(bodies, q):
        return False
    X, V, space = at(oMi, (njoints, 4, 4)), at(v_out, (njoints, 6)), len(bodies) * VELOCITY_SIZE
    scratch, angles = memory(space), memory(24 * nq)
    work = array_at(scratch, (len(bodies),), WORK_VELOCITY)
    joint_velocities(bodies, work, turned(q, array_at(angles, (3, nq), FLOAT)), v, V)
    _compose_rows(bodies, work, X, V)
    release(angles, 24 * nq)
    release(scratch, space)
    return bool(all_finite(X) and all_finite(V))


@routine(q=("nq",), v=("nv",), a=("nv",))
def accelerations(q: Any, v: Any, a: Any, table: int, nq: int, njoints: int, oMi: int, v_out: int, a_out: int) -> bool:
    """``joint_accelerations``, and velocities and poses in the world."""
    bodies = table_at(table)
    if not unit_norm(bodies, q):
        return False
    X, A, space = at(oMi, (njoints, 4, 4)), at(a_out, (njoints, 6)), len(bodies) * ACCELERATION_SIZE
    scratch, angles = memory(space), memory(24 * nq)
    work = array_at(scratch, (len(bodies),), WORK_ACCELERATION)
    joint_accelerations(bodies, work, turned(q, array_at(angles, (3, nq), FLOAT)), v, a, A)
    _compose_rows(bodies, work, X, at(v_out, (njoints, 6)))
    release(angles, 24 * nq)
    release(scratch, space)
    return bool(all_finite(X) and all_finite(A))


FIELDS = ("oMi", "liMi", "oMf")  # words: addresses of fields of Data that were read; 0 for the others


@inline
def _place_path(bodies: Any, work: Any, q: Any, row: int, poses: Any, local: Any, world: bool, parents: bool) -> None:
    """Place the rows that carry a row in the world; write the poses of their joints there and in parents, if asked."""
    put_pose(work[0].X, identity_pose())
    for i in range(1, row + 1):
        b = bodies[i]
        if b.last_row >= row:
            if parents and b.kind != CONTINUED:
                place_joint(bodies, i, q, work[i].X)
                write_pose(local[bodies[i + b.dofs - 1].joint], pose_of(work[i].X))
            X = placed_in_world(bodies, work, i, q)
            if world and b.joint > 0:
                write_pose(poses[b.joint], X)


@routine((6, "nv"), q=("nq",), k=Index("frames"))
def frame_jacobian_at(
    q: Any, k: int, table: int, njoints: int, code: int, oMi: int, liMi: int, oMf: int, frames: Frames, out: Any
) -> bool:
    """``frame_jacobian`` in one reference, to be recorded.

    In the ``FIELDS`` it writes the poses of the joints that carry the frame, and that of the frame. The joints of
    frames are rows of the table.
    """
    bodies = table_at(table)
    if not unit_norm(bodies, q):
        return False
    i, p = word(frames.joints, k), at(word(frames.placements, k), (4, 4))
    space = len(bodies) * ROW_SIZE
    scratch = memory(space)
    work = array_at(scratch, (len(bodies),), WORK)
    _place_path(bodies, work, q, i, at(oMi, (njoints, 4, 4)), at(liMi, (njoints, 4, 4)), oMi != 0, liMi != 0)
    placed_frame_jacobian(bodies, work, i, p, code, out)
    if oMf != 0:
        write_pose(at(oMf + 128 * k, (4, 4)), spatial.compose(pose_of(work[i].X), read_pose(p)))
    release(scratch, space)
    return bool(all_finite(out))


@routine((6, 10), k=Index("njoints"))
def joint_body_regressor(k: int, velocities: int, accelerations: int, out: Any) -> bool:
    """The matrix of ``body_force`` of a joint's body, of motions of all joints."""
    v, a = at(velocities + 48 * k, (6,)), at(accelerations + 48 * k, (6,))
    body_force(read_motion(v), read_motion(a), out)
    return True
