"""Library calls that record their inputs and result, and operators on rows of arrays.

The caller of ``rnea`` may read the joint forces later, when q has changed in place: so inputs and result are copied to
memory of the Data. A call is a builtin of its program or table kernel; what is no call of the library is a Routine,
which the caller binds to words: the addresses of the table of bodies and of arrays, and sizes.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra import public_arrays, spatial
from ...algebra.records import motion_of, pose_of, put_pose
from ...algebra.scalars import inline
from ...algebra.spatial import Motion, Pose, identity_pose
from ...bodies.joints import place_joint
from ...bodies.kinds import CONTINUED
from ...engines.compiled import entries, numba_kernels
from ...engines.compiled.checks import all_finite, unit_norm
from ...engines.compiled.tiers import Twin, array_of, table_kernel
from ...engines.object_layout import Words
from ...engines.programs.llvm.single_call_text import ARRAY as INPUT
from ...engines.programs.llvm.single_call_text import FIXED, NUMBER
from ...engines.programs.run import single_call
from ...engines.programs.run.call_code import CallCode
from ...engines.programs.run.routine import Choice, Held, Index, Kind, Routine
from ...engines.programs.run.single_call import Parameter, unavailable
from ...recursions import SPECS
from ...recursions.spec import LOCAL, WORLD
from ...recursions.steps import placed_in_world
from ...recursions.tree import kinematics
from ...recursions.tree.kinematics import classical_acceleration, express_in
from . import operator_kernels

SIZES = ("nq", "nv", "njoints")  # words of a plan
ARRAY, PARTS, RESULT = range(3)  # what a recorded call returns
NOT_OWN = 0, 0, 0  # the code of a plan that reads that of a CallCode
Array = NDArray[np.float64]
Builtin = Callable[..., Any]
HEAD = 64  # bytes before a table
REFERENCES = ("in_frame", "in_world", "aligned")  # words: ids of the ReferenceFrame objects, in the order of codes
FRAMES = ("frames", "joints", "placements")  # words: number of frames; addresses, of addresses for placements
OF_FRAME: dict[str, Kind] = {"k": Index("frames"), "code": Choice(REFERENCES)}


class Table:
    """A copy of a table of bodies, and two blocks of numbers: those of a Model, which edits write, and the table's own.

    bytes    of the table, before which stands the time when joints moved; ``address`` theirs
    """

    def __init__(self, bodies: Any, now: Array, then: Array) -> None:
        """Of a table as bytes."""
        memory = np.empty(HEAD + len(bodies), np.uint8)
        self.now, self.then, self.bytes = now, then, memory[HEAD:]
        self.bytes[:] = bodies
        self.address = memory.ctypes.data + HEAD
        self._moved = memory[HEAD - 8 : HEAD].view(np.int64)
        self._moved[0] = 0

    def note_move(self) -> None:
        """Note that joints were moved: places of calls before are no longer computed on this table."""
        self._moved[0] = clock.now[0] + 1


class Clock:
    """Stamps that order calls in time; builtins advance it too."""

    def __init__(self) -> None:
        self.now = array("q", [0])

    def __call__(self) -> int:
        """A new stamp."""
        self.now[0] += 1
        return self.now[0]


clock = Clock()


def address(x: array[int]) -> int:
    """Of the numbers of an array."""
    return x.buffer_info()[0]


STAMP = ["places(clock, (1,))[0] += 1", "places(time, (1,))[0] = word(clock, 0)"]  # write a new stamp to an address


def record(count: int, memory: Array, result: Array | None, stamp: array[int], table: Table) -> Words:
    """The words of a builtin that records its first inputs, this many, in memory, its result, if given, and its stamp.

    stamp  array whose first word is written
    table  the Table of the call: if the numbers of the Model are other than its own, the call is not answered
    """
    places = {"memory": memory.ctypes.data, "result": 0 if result is None else result.ctypes.data}
    places |= {"now": table.now.ctypes.data, "then": table.then.ctypes.data, "bytes": table.now.nbytes}
    made = single_call.record(count=count, clock=address(clock.now), time=address(stamp), **places)
    made.alive = memory, result, stamp, table, clock
    return made


def recorded_call(
    code: CallCode,
    sizes: Mapping[str, int],
    recorded: Words | None = None,
    unused: int = 0,
    returns: int = ARRAY,
    result: Array | None = None,
    otherwise: Builtin = unavailable,
) -> Builtin:
    """``(*inputs, *unused) -> result`` of the code of a public call for one sample, a builtin that may record.

    sizes     nq, nv, njoints
    recorded  words of ``record``
    unused    number of vectors (nv,) that are recorded only
    returns   ARRAY, a new one; PARTS, a tuple of the parts of a result of three axes; RESULT: ``result`` is written in
              place, and True returned
    otherwise  called with the arguments where the builtin does not apply

    External forces are a last argument (6 njoints,).
    """
    given: list[single_call.Described] = []
    for x in code.spec.present:
        shape = tuple(int(sizes.get(str(n), n)) for n in x.shape)
        given.append((math.prod(shape),) if x.name == "fext" else shape)
    given += [(sizes["nv"],)] * unused
    shape = tuple(int(sizes.get(str(n), n)) for n in numba_kernels.kernel_shape(code.spec.output))
    place = np.empty(shape) if returns == PARTS else result if returns == RESULT else None
    output = single_call.array(shape) if place is None else single_call.placed(shape, place.ctypes.data)
    several = single_call.PARTS if returns == PARTS else single_call.ONE
    plan = single_call.plan(NOT_OWN, [output], given, several, (code, place), code.address, recorded)
    kinds = [Parameter(f"x{k}", NUMBER if x == () else INPUT) for k, x in enumerate(given)]
    return single_call.bound(otherwise, kinds, plan)


def rerun(code: CallCode, inputs: Sequence[Array], out: Array) -> Builtin:
    """``() -> True``: a builtin that writes a call's result at the numbers that are in ``inputs`` to ``out``."""
    return _in_place(NOT_OWN, inputs, out, code.address, code)


def copier(x: Array, out: Array) -> Builtin:
    """``() -> True``: a builtin that copies numbers."""
    program = single_call.copy_entry(), x.nbytes, entries.NO_LIMIT.ctypes.data
    return _in_place(program, [x], out, 0, None)


def _in_place(program: tuple[int, int, int], inputs: Sequence[Array], out: Array, shared: int, alive: Any) -> Builtin:
    places = [single_call.placed(x.shape, x.ctypes.data) for x in inputs]
    plan = single_call.plan(
        program, [single_call.placed(out.shape, out.ctypes.data)], places, alive=(inputs, out, alive), shared=shared
    )
    return single_call.bound(unavailable, [Parameter(f"x{k}", FIXED) for k in range(len(places))], plan)


# --- frames ----------------------------------------------------------------------------------------------


@cache
def place_frames(joints_too: bool) -> Routine:
    """``() -> True``: poses of all frames from those of their joints; ``joints_too``: ``(q) -> True`` computes both.

    Words: table, sizes, poses of the joints, result, clock and stamps, frames. q is recorded.
    """
    words = ["table", *SIZES, "poses", "result", "clock", "time", *FRAMES]
    spec, body = SPECS["forward_kinematics"], ["X = at(poses, (njoints, 4, 4))"]
    if joints_too:
        body.append(f"if sample_kernel(table, q, X) != {numba_kernels.OK}: return 0")
    body += [
        "for k in range(frames):",
        "    there = read_pose(at(word(placements, k), (4, 4)))",
        "    there = compose(read_pose(X[word(joints, k)]), there)",
        "    write_pose(at(result + 128 * k, (4, 4)), there)",
    ]
    scope = {**vars(public_arrays), "sample_kernel": table_kernel(spec).twin, "compose": spatial.compose}
    label = "place_joints_and_frames" if joints_too else "place_frames"
    return Routine(label, words, {"q": ("nq",)} if joints_too else {}, [*body, *STAMP, "return 1"], scope)


@cache
def place_frame() -> Routine:
    """``(frame) -> True``: pose of one frame from that of its joint. Words: poses, result, frames."""
    body = [
        "X = at(poses + 128 * word(joints, frame), (4, 4))",
        "there = read_pose(at(word(placements, frame), (4, 4)))",
        "write_pose(at(result + 128 * frame, (4, 4)), compose(read_pose(X), there))",
        "return 1",
    ]
    scope = {**vars(public_arrays), "compose": spatial.compose}
    return Routine("place_frame", ["poses", "result", *FRAMES], {"frame": Index("frames")}, body, scope)


@inline
def motion_in_reference(X: Pose, placement: Pose, m: Motion, reference: int) -> Motion:
    """Motion m of a body, in its joint's frame at X, expressed in a reference at a frame on the body."""
    if reference == WORLD:
        return spatial.motion_to_parent(X, m)
    here = spatial.motion_to_child(placement, m)
    return here if reference == LOCAL else express_in(spatial.compose(X, placement), here, reference)


@inline
def _write_frame_motion(X: Any, placement: Any, v: Any, a: Any, classical: Any, reference: int, out: Any) -> None:
    """``motion_in_reference`` of a; ``classical``: acceleration of the frame's origin, with its velocity from v."""
    pose, there = public_arrays.read_pose(X), public_arrays.read_pose(placement)
    m = motion_in_reference(pose, there, public_arrays.read_motion(a), reference)
    if classical:
        m = classical_acceleration(m, motion_in_reference(pose, there, public_arrays.read_motion(v), reference))
    public_arrays.write_motion(out, m)


write_frame_motion = operator_kernels.compiled(_write_frame_motion)


@cache
def frame_motion(classical: bool) -> Routine:
    """``(frame, reference) -> Motion``: velocity or acceleration of a frame from that of its joint.

    Words: class and slot of the Motion, poses, velocities, motions of the joints, reference ids, frames.
    """
    words = ["made", "slot", "poses", "velocities", "motions", *REFERENCES, *FRAMES]
    body = [
        "i, p = word(joints, k), at(word(placements, k), (4, 4))",
        "X, v, m = at(poses + 128 * i, (4, 4)), at(velocities + 48 * i, (6,)), at(motions + 48 * i, (6,))",
        f"write(X, p, v, m, {int(classical)}, code, out)",
        "return 1",
    ]
    label = "frame_classical_motion" if classical else "frame_motion"
    return Routine(label, words, OF_FRAME, body, {"write": _write_frame_motion}, Held((6,), "made", "slot"))


ON_TABLE = {  # names that bodies of builtins on the table use
    "unit_norm": unit_norm, "all_finite": all_finite, "FLOAT": numba_kernels.FLOAT,
}  # fmt: skip
# q beside its cosines and sines, as a recursion takes ``TURNED_Q``
TURN_Q = ["angles = memory(24 * nq)", "q_turned = turned(q, array_at(angles, (3, nq), FLOAT))"]


def _rows_in_plain_python(bodies: Any, address: int) -> Any:
    return array_of(address, (len(bodies),), kinematics.WORK)


def _compiled_rows() -> Any:
    from numba import carray  # type: ignore[attr-defined]

    from ...engines.compiled.jit import pointer

    @inline
    def rows_at(bodies: Any, address: int) -> Any:
        return carray(pointer(address), (len(bodies),), kinematics.WORK)

    return rows_at


ROWS_AT = Twin(_rows_in_plain_python, _compiled_rows)  # the scratch rows of ``joint_jacobians`` at an address


@cache
def frame_jacobian(name: str) -> Routine:
    """``(frame, reference) -> (6, nv)``: ``frame_jacobian`` or ``frame_jacobian_dot`` at the recorded q, v.

    Returns None also if joints were moved after that call. Words: table, sizes, addresses of the inputs, reference ids,
    the rows of ``jacobians`` (0: none) and the stamps, which are equal if the rows are those of the call, frames, whose
    joints are rows of the table.
    """
    spec = SPECS[name]
    inputs = [x for x in spec.present if not x.static]
    words = ["table", *SIZES, *(f"{x.name}_address" for x in inputs), *REFERENCES, "placed_rows", "time", *FRAMES]
    passed = "".join(f"at({x.name}_address, ({x.shape[0]},)), " for x in inputs)
    body = [
        "if word(time, 0) < word(table, -1): return 0",
        "i, p = word(joints, k), at(word(placements, k), (4, 4))",
        "if placed_rows != 0 and word(time, 0) == word(time, 1):",
        "    bodies = table_at(table)",
        "    placed(bodies, rows_at(bodies, placed_rows), i, p, code, out)",
        "    return 1",
        f"return 1 if sample_kernel(table, {passed}i, p, code, out) == {numba_kernels.OK} else 0",
    ]
    scope = {"sample_kernel": table_kernel(spec).twin, "placed": kinematics.placed_frame_jacobian, "rows_at": ROWS_AT}
    return Routine(name, words, OF_FRAME, body, scope, (6, "nv"))


@inline
def _write_poses(bodies: Any, work: Any, X: Any) -> None:
    """Write the poses of the joints from those of the rows in the world."""
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            public_arrays.write_pose(X[bodies[i].joint], pose_of(work[i].X))


@cache
def jacobians() -> Routine:
    """``(q) -> (6, nv)``: ``joint_jacobians``; it keeps its rows and writes poses of the joints.

    Words: table, sizes, rows, held oMi (0: none), clock, stamps of the call and of the rows. It is to be recorded.
    """
    body = [
        "bodies = table_at(table)",
        "if not unit_norm(bodies, q): return 0",
        *TURN_Q,
        "work = rows_at(bodies, placed_rows)",
        "places(time, (2,))[1] = 0",
        "jacobians(bodies, work, q_turned, out)",
        "release(angles, 24 * nq)",
        "if not all_finite(out): return 0",
        "if oMi != 0: write_poses(bodies, work, at(oMi, (njoints, 4, 4)))",
        "places(time, (2,))[1] = word(clock, 0) + 1",  # the stamp that is recorded next
        "return 1",
    ]
    scope = {**ON_TABLE, "rows_at": ROWS_AT, "jacobians": kinematics.joint_jacobians, "write_poses": _write_poses}
    words = ["table", *SIZES, "placed_rows", "oMi", "clock", "time"]
    return Routine("joint_jacobians_and_rows", words, {"q": ("nq",)}, body, scope, (6, "nv"))


@inline
def _compose_rows(bodies: Any, work: Any, X: Any, V: Any) -> None:
    """Write poses of the joints in the world, and velocities, from the rows of ``joint_velocities``."""
    put_pose(work[0].X, identity_pose())
    public_arrays.write_motion(V[0], motion_of(work[0].v))
    for i in range(1, len(bodies)):
        put_pose(work[i].X, spatial.compose(pose_of(work[bodies[i].parent].X), pose_of(work[i].X)))
        if bodies[i].joint > 0:
            public_arrays.write_motion(V[bodies[i].joint], motion_of(work[i].v))
    _write_poses(bodies, work, X)


@cache
def motions(name: str) -> Routine:
    """``(q, v[, a]) -> True``: ``joint_velocities`` or ``joint_accelerations``, and velocities and poses in the world.

    Words: table, sizes, addresses of poses, velocities and the result.
    """
    spec = SPECS[name]
    inputs: dict[str, Kind] = {x.name: (str(x.shape[0]),) for x in spec.present}
    body = [
        "bodies = table_at(table)",
        "if not unit_norm(bodies, q): return 0",
        "X, found, space = at(oMi, (njoints, 4, 4)), at(found_at, (njoints, 6)), len(bodies) * WORK_SIZE",
        "scratch = memory(space)",
        "work = array_at(scratch, (len(bodies),), WORK)",
        *TURN_Q,
        f"recursion(bodies, work, q_turned, {', '.join([*inputs][1:])}, found)",
        "compose_rows(bodies, work, X, at(v_out, (njoints, 6)))",
        "release(angles, 24 * nq)",
        "release(scratch, space)",
        "return 1 if all_finite(X) and all_finite(found) else 0",
    ]
    work: Any = spec.work
    scope = {**ON_TABLE, "WORK": work, "WORK_SIZE": work.itemsize, "recursion": spec.recursion}
    scope["compose_rows"] = _compose_rows
    return Routine(f"{name}_and_poses", ["table", *SIZES, "oMi", "v_out", "found_at"], inputs, body, scope)


HELD = ("oMi", "liMi", "oMf")  # words: addresses of fields of Data that were read; 0 for the others


@inline
def _place_path(bodies: Any, work: Any, q: Any, row: int, poses: Any, local: Any, held: int) -> None:
    """Place the rows that carry a row in the world; write the poses of their joints there, if held, and in parents."""
    put_pose(work[0].X, identity_pose())
    for i in range(1, row + 1):
        b = bodies[i]
        if b.last_row >= row:
            if held & 2 and b.kind != CONTINUED:
                place_joint(bodies, i, q, work[i].X)
                public_arrays.write_pose(local[bodies[i + b.dofs - 1].joint], pose_of(work[i].X))
            X = placed_in_world(bodies, work, i, q)
            if held & 1 and b.joint > 0:
                public_arrays.write_pose(poses[b.joint], X)


@cache
def frame_jacobian_at() -> Routine:
    """``(q, frame) -> (6, nv)``: ``frame_jacobian`` in one reference, to be recorded.

    In the held fields it writes the poses of the joints that carry the frame, and that of the frame. Words: table,
    sizes, code of the reference, addresses of held fields, frames; joints are rows of the table.
    """
    body = [
        "bodies = table_at(table)",
        "if not unit_norm(bodies, q): return 0",
        "i, p = word(joints, k), at(word(placements, k), (4, 4))",
        "space, held = len(bodies) * WORK_SIZE, (1 if oMi != 0 else 0) + (2 if liMi != 0 else 0)",
        "scratch = memory(space)",
        "work = array_at(scratch, (len(bodies),), WORK)",
        "place_path(bodies, work, q, i, at(oMi, (njoints, 4, 4)), at(liMi, (njoints, 4, 4)), held)",
        "jacobian(bodies, work, i, p, code, out)",
        "if oMf != 0: write_pose(at(oMf + 128 * k, (4, 4)), compose(pose_of(work[i].X), read_pose(p)))",
        "release(scratch, space)",
        "return 1 if all_finite(out) else 0",
    ]
    scope = {
        **vars(public_arrays), **ON_TABLE, "jacobian": kinematics.placed_frame_jacobian, "place_path": _place_path,
        "compose": spatial.compose, "pose_of": pose_of, "WORK": kinematics.WORK, "WORK_SIZE": kinematics.WORK.itemsize,
    }  # fmt: skip
    words = ["table", *SIZES, "code", *HELD, *FRAMES]
    inputs: dict[str, Kind] = {"q": ("nq",), "k": Index("frames")}
    return Routine("frame_jacobian_at", words, inputs, body, scope, (6, "nv"))


# --- rows -----------------------------------------------------------------------------------------------


def on_rows(function: str, a: str, b: str, output: str) -> Callable[..., None]:
    """``(a, places, b, out)``: out[k] = function(a[places[k]], b[k]), a kernel on rows of these kinds."""
    body = [
        "for k in range(len(places)):",
        f"    write_{output}(out[k], {function}(read_{a}(a[places[k]]), read_{b}(b[k])))",
    ]
    return operator_kernels.compiled_text(f"rows_{function}", ["a", "places", "b", "out"], body)


compose_all = on_rows("compose", "pose", "pose", "pose")
relative_all = on_rows("relative_pose", "pose", "pose", "pose")
motions_to_parent = on_rows("motion_to_parent", "pose", "motion", "motion")
motions_to_child = on_rows("motion_to_child", "pose", "motion", "motion")
forces_to_parent = on_rows("force_to_parent", "pose", "force", "force")
bodies_to_parent = on_rows("body_to_parent", "pose", "body", "body")
momenta = on_rows("body_momentum", "body", "motion", "force")
