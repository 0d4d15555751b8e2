"""Library calls that record their inputs and result, and operators on rows of arrays.

The caller of ``rnea`` may read the joint forces later, when q has changed in place: so inputs and result are copied to
memory of the Data. Each function here returns a builtin (see ``engines.compiled.cpython``), compiled once, that the
caller binds to a plan of words: the addresses of the table of bodies, memory and result, and sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import chain
from typing import Any

import numpy as np

from ...algebra import public_arrays, spatial
from ...algebra.records import pose_of
from ...algebra.scalars import inline
from ...algebra.spatial import Motion, Pose, identity_pose
from ...engines.compiled import jit, numba_kernels
from ...engines.compiled.checks import all_finite, unit_norm
from ...engines.compiled.cpython import Builtin, dims
from ...engines.object_layout import DATA
from ...recursions import SPECS, kinematics
from ...recursions.kinematics import classical_acceleration, express_in
from ...recursions.spec import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, Argument
from . import operator_kernels
from .edited_table import GRAVITY

SIZES = ("nq", "nv", "njoints")  # words of a plan
REFERENCES = ("in_frame", "in_world", "aligned")  # words of a plan: ids of the ReferenceFrame objects


def _shape_text(argument: Argument) -> str:
    """Shape of an array, as source text."""
    return f"({', '.join(map(str, numba_kernels.kernel_shape(argument)))},)"


def _check_arguments(inputs: Sequence[Argument]) -> list[str]:
    """Statements that check the argument objects ``x`` and read them as arrays and numbers ``x_in``."""
    checks = [f"is_vector(plan, {x.name}, {x.shape[0]})" if x.shape else f"is_real(plan, {x.name})" for x in inputs]
    lines = [f"if not ({' and '.join(checks)}): return return_none(plan)"] if checks else []
    return lines + [
        f"{x.name}_in = vector({x.name}, {x.shape[0]})" if x.shape else f"{x.name}_in = real({x.name})" for x in inputs
    ]


def make_answer(words: Sequence[str], first: str, rank: int) -> list[str]:
    """Statements that make the array ``answer``, whose axes are words from ``first`` on."""
    return [f"answer = new_array(plan, {rank}, {dims(words, first)})", "if answer == 0: return 0"]


def record(**sizes: str) -> list[str]:
    """Statements that copy inputs ``x_in`` of these sizes, one after the other, and then the gravity to ``memory``."""
    lines = [(f"copy({x}_in, at(memory, ({size},)))", f"memory += 8 * {size}") for x, size in sizes.items()]
    return [*chain.from_iterable(lines), f"copy(at(table + {GRAVITY}, (3,)), at(memory, (3,)))"]


@cache
def call_builtin(name: str) -> Builtin:
    """``(*inputs) -> result`` of a public call for one sample. Words: table, sizes, axes of the result."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    axes = [f"axis{k}" for k in range(len(numba_kernels.kernel_shape(spec.output)))]
    words = ["table", *SIZES, *axes]
    body = [
        *_check_arguments(spec.present),
        *make_answer(words, axes[0], len(axes)),
        f"out = at(word(answer, {DATA}), ({', '.join(axes)},))",
        f"if sample_kernel(table, {''.join(f'{x.name}_in, ' for x in spec.present)}out) != {numba_kernels.OK}:",
        "    return discard(plan, answer)",
        "return answer",
    ]
    scope = {"sample_kernel": numba_kernels.sample_kernel(spec)}
    return Builtin(f"call_{name}", [x.name for x in spec.present], words, body, scope)


@cache
def recorded_call(name: str, unused: tuple[str, ...] = (), new_result: bool = True, forces: bool = False) -> Builtin:
    """``(*inputs, *unused) -> result`` of a public call for one sample that records its inputs and result.

    unused      vectors (nv,) that are recorded only
    new_result  True: returns a new array and copies it; False: writes the recorded result in place, returns True
    forces      a last argument holds the external forces, one after the other, and is not recorded

    Returns None if not applicable. Words: table, sizes, axes of the result, memory for the inputs, result.
    """
    spec = numba_kernels.variant(SPECS[name], frozenset(["fext"] if forces else []))
    axes = [f"axis{k}" for k in range(len(numba_kernels.kernel_shape(spec.output)))]
    words = ["table", *SIZES, *axes, "memory", "result"]
    inputs = [*(x for x in spec.present if x.name != "fext"), *(Argument(x, ("nv",), "", "") for x in unused)]
    arguments = [x.name for x in inputs]
    shape, passed = f"({', '.join(axes)},)", "".join(f"{x.name}_in, " for x in spec.present)
    body = [*_check_arguments(inputs), f"count = {' * '.join(axes)}"]
    if forces:
        arguments.append("fext")
        body += [
            "if not is_vector(plan, fext, 6 * njoints): return return_none(plan)",
            f"fext_in = at(word(fext, {DATA}), (njoints, 6))",
        ]
    if new_result:
        body += [
            *make_answer(words, axes[0], len(axes)),
            f"if sample_kernel(table, {passed}at(word(answer, {DATA}), {shape})) != {numba_kernels.OK}:",
            "    return discard(plan, answer)",
        ]
    else:  # result is written while inputs are read
        body += [f"if not no_overlap({x.name}, {x.shape[0]}, result, count): return return_none(plan)" for x in inputs]
        run = f"sample_kernel(table, {passed}at(result, {shape}))"
        body.append(f"if {run} != {numba_kernels.OK}: return return_none(plan)")
    body += record(**{x.name: str(x.shape[0]) for x in inputs})  # before the result, which may share their memory
    if new_result:
        body.append(f"copy(at(word(answer, {DATA}), (count,)), at(result, (count,)))")
    body.append("return answer" if new_result else "return return_true(plan)")
    label = "_".join(["recorded", name, *unused, "new" if new_result else "in_place", *["forces"] * forces])
    return Builtin(label, arguments, words, body, {"sample_kernel": numba_kernels.sample_kernel(spec), "copy": copy})


@inline
def copy(x: Any, out: Any) -> None:
    """Copy a vector."""
    for i in range(len(x)):
        out[i] = x[i]


@cache
def recompute(name: str) -> Builtin:
    """``() -> True``: writes a public call's result at the recorded inputs in place. Words: table, sizes, addresses."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    arrays = [*spec.present, spec.output]
    words = ["table", *SIZES, *(f"{x.name}_address" for x in arrays)]
    passed = ", ".join(f"at({x.name}_address, {_shape_text(x)})" for x in arrays)
    body = [f"return return_true(plan) if sample_kernel(table, {passed}) == {numba_kernels.OK} else return_none(plan)"]
    return Builtin(f"recompute_{name}", [], words, body, {"sample_kernel": numba_kernels.sample_kernel(spec)})


# --- frames ----------------------------------------------------------------------------------------------

FRAMES = ("frames", "joints", "placements")  # words: number of frames; addresses
STACK = "(frames, 4, 4)"


@inline
def _place_all(poses: Any, joints: Any, placements: Any, out: Any) -> None:
    for k in range(len(joints)):
        X = spatial.compose(public_arrays.read_pose(poses[joints[k]]), public_arrays.read_pose(placements[k]))
        public_arrays.write_pose(out[k], X)


@cache
def place_frames(joints_too: bool) -> Builtin:
    """``() -> True``: poses of all frames from those of their joints; ``joints_too``: ``(q) -> True`` computes both.

    Words: table, sizes, memory for q, poses of the joints, result, frames.
    """
    words = ["table", *SIZES, "memory", "poses", "result", *FRAMES]
    spec = SPECS["forward_kinematics"]
    body = ["X = at(poses, (njoints, 4, 4))"]
    if joints_too:
        run = f"if sample_kernel(table, q_in, X) != {numba_kernels.OK}: return return_none(plan)"
        body = [*_check_arguments(spec.present), *body, run, *record(q="nq")]
    body.append(f"place_all(X, places(joints, frames), at(placements, {STACK}), at(result, {STACK}))")
    scope = {"sample_kernel": numba_kernels.sample_kernel(spec), "place_all": _place_all, "copy": copy}
    label = "place_joints_and_frames" if joints_too else "place_frames"
    return Builtin(label, ["q"] * joints_too, words, [*body, "return return_true(plan)"], scope)


@cache
def place_frame() -> Builtin:
    """``(frame) -> True``: pose of one frame from that of its joint. Words: poses, result, frames."""
    body = [
        "k = index(plan, frame, frames)",
        "if k < 0: return return_none(plan)",
        "X = at(poses + 128 * places(joints, frames)[k], (4, 4))",
        "write_pose(at(result + 128 * k, (4, 4)), compose(read_pose(X), read_pose(at(placements + 128 * k, (4, 4)))))",
        "return return_true(plan)",
    ]
    scope = {**vars(public_arrays), "compose": spatial.compose}
    return Builtin("place_frame", ["frame"], ["poses", "result", *FRAMES], body, scope)


@inline
def motion_in_reference(X: Pose, placement: Pose, m: Motion, reference: int) -> Motion:
    """Motion m of a body, in its joint's frame at X, expressed in a reference at a frame on the body."""
    if reference == WORLD:
        return spatial.motion_to_parent(X, m)
    return express_in(spatial.compose(X, placement), spatial.motion_to_child(placement, m), reference)


@inline
def _write_frame_motion(X: Any, placement: Any, v: Any, a: Any, classical: Any, reference: int, out: Any) -> None:
    """``motion_in_reference`` of a; ``classical``: acceleration of the frame's origin, with its velocity from v."""
    pose, there = public_arrays.read_pose(X), public_arrays.read_pose(placement)
    m = motion_in_reference(pose, there, public_arrays.read_motion(a), reference)
    if classical:
        m = classical_acceleration(m, motion_in_reference(pose, there, public_arrays.read_motion(v), reference))
    public_arrays.write_motion(out, m)


_PARAMETERS = ["X", "placement", "v", "a", "classical", "reference", "out"]
write_frame_motion = operator_kernels.compiled_text(
    "frame_motion", _PARAMETERS, [f"write({', '.join(_PARAMETERS)})"], write=_write_frame_motion
)


@inline
def _reference_code(x: int, in_frame: int, in_world: int, aligned: int) -> int:
    """Code of the ReferenceFrame with id x; -1 if none has it."""
    if x == in_frame:
        return LOCAL
    if x == in_world:
        return WORLD
    return LOCAL_WORLD_ALIGNED if x == aligned else -1


@cache
def frame_motion(classical: bool) -> Builtin:
    """``(frame[, reference]) -> Motion``: velocity or acceleration of a frame from that of its joint.

    Words: six (6), class and slot of the Motion, poses, velocities, motions of the joints, reference ids, frames.
    """
    words = ["six", "made", "slot", "poses", "velocities", "motions", *REFERENCES, *FRAMES]
    body = [
        "k, code = index(plan, frame, frames), 0",
        "if n > 1: code = coded(reference, in_frame, in_world, aligned)",
        "if k < 0 or code < 0: return return_none(plan)",
        *make_answer(words, "six", 1),
        "i, p = places(joints, frames)[k], at(placements + 128 * k, (4, 4))",
        "X, v, m = at(poses + 128 * i, (4, 4)), at(velocities + 48 * i, (6,)), at(motions + 48 * i, (6,))",
        f"write(X, p, v, m, {int(classical)}, code, at(word(answer, {DATA}), (6,)))",
        "return new_object(plan, made, slot, answer)",
    ]
    label = "frame_classical_motion" if classical else "frame_motion"
    scope = {"write": _write_frame_motion, "coded": _reference_code}
    return Builtin(label, ["frame", "reference"], words, body, scope, optional=1)


@cache
def frame_jacobian(name: str) -> Builtin:
    """``(frame, reference) -> (6, nv)``: ``frame_jacobian`` or ``frame_jacobian_dot`` at the recorded q, v.

    Words: table, six (6), sizes, addresses of the inputs, reference ids, frames; joints are rows of the table.
    """
    spec = SPECS[name]
    inputs = [x for x in spec.present if not x.static]
    words = ["table", *SIZES[::2], "six", "nv", *(f"{x.name}_address" for x in inputs), *REFERENCES, *FRAMES]
    passed = "".join(f"at({x.name}_address, {_shape_text(x)}), " for x in inputs)
    body = [
        "k, code = index(plan, frame, frames), coded(reference, in_frame, in_world, aligned)",
        "if k < 0 or code < 0: return return_none(plan)",
        *make_answer(words, "six", 2),
        "p, out = at(placements + 128 * k, (4, 4)), " + f"at(word(answer, {DATA}), (6, nv))",
        f"if sample_kernel(table, {passed}places(joints, frames)[k], p, code, out) != {numba_kernels.OK}:",
        "    return discard(plan, answer)",
        "return answer",
    ]
    scope = {"sample_kernel": numba_kernels.sample_kernel(spec), "coded": _reference_code}
    return Builtin(name, ["frame", "reference"], words, body, scope)


HELD = ("oMi", "liMi", "oMf")  # words: addresses of fields of Data that were read; 0 for the others


@inline
def _place_path(bodies: Any, work: Any, path: Any, row: int, poses: Any, local: Any, held: int) -> Pose:
    """Write the poses of the joints that carry a row, in the world (held 1, 3) and their parents (2, 3); the last.

    work holds the poses of the rows in their parents.
    """
    n, i = 0, row
    while i > 0:
        path[n] = i
        n += 1
        i = bodies[i].parent
    X, last = identity_pose(), identity_pose()
    for k in range(n - 1, -1, -1):
        i = path[k]
        last = spatial.compose(last, pose_of(work[i].X))
        joint = bodies[i].joint
        if joint > 0:  # the last row of the joint
            X = spatial.compose(X, last)
            if held & 1:
                public_arrays.write_pose(poses[joint], X)
            if held & 2:
                public_arrays.write_pose(local[joint], last)
            last = identity_pose()
    return X


@cache
def frame_jacobian_at() -> Builtin:
    """``(q, frame) -> (6, nv)``: ``frame_jacobian`` in one reference; records q.

    In the held fields it writes the poses of the joints that carry the frame, and that of the frame. Words: table, six
    (6), sizes, memory, code of the reference, addresses of held fields, frames; joints are rows of the table.
    """
    words = ["table", *SIZES[::2], "six", "nv", "memory", "code", *HELD, *FRAMES]
    body = [
        *_check_arguments(SPECS["frame_jacobian"].present[:1]),
        "k, bodies = index(plan, frame, frames), table_at(table)",
        "if k < 0 or not unit_norm(bodies, q_in): return return_none(plan)",
        *make_answer(words, "six", 2),
        f"p, out = at(placements + 128 * k, (4, 4)), at(word(answer, {DATA}), (6, nv))",
        "work = empty(len(bodies), WORK)",
        "jacobian(bodies, work, q_in, places(joints, frames)[k], p, code, out)",
        "if not all_finite(out): return discard(plan, answer)",
        "held = (1 if oMi != 0 else 0) + (2 if liMi != 0 else 0)",
        "if held != 0 or oMf != 0:",
        "    path, poses, local = empty(len(bodies), intp), at(oMi, (njoints, 4, 4)), at(liMi, (njoints, 4, 4))",
        "    X = place_path(bodies, work, path, places(joints, frames)[k], poses, local, held)",
        "    if oMf != 0: write_pose(at(oMf + 128 * k, (4, 4)), compose(X, read_pose(p)))",
        *record(q="nq"),
        "return answer",
    ]
    scope = {
        **vars(public_arrays), "jacobian": kinematics.frame_jacobian, "unit_norm": unit_norm, "copy": copy,
        "all_finite": all_finite, "place_path": _place_path, "compose": spatial.compose, "table_at": jit.table_at,
        "empty": np.empty, "intp": np.intp, "WORK": kinematics.WORK,
    }  # fmt: skip
    return Builtin("frame_jacobian_at", ["q", "frame"], words, body, scope)


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
