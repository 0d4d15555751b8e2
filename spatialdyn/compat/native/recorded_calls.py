"""Calls of the library that also note what they were given, and operators on lists: all as builtins of Python's.

The caller of ``rnea`` may later ask for the forces that the torques came from, when q has long changed in place. So
inputs and result are copied to memory of the caller's while they are at hand. The functions here make builtins (see
``engines.compiled.cpython``), each compiled once, that a caller binds to a plan: where the table, the memory and the
result are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from numba import njit

from ...algebra import public_arrays, spatial
from ...algebra.scalars import inlined
from ...algebra.spatial import Motion, Pose
from ...engines.compiled import numba_kernels
from ...engines.compiled.cpython import DATA, Builtin, dims
from ...recursions import SPECS
from ...recursions.kinematics import of_point, referred
from ...recursions.spec import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, Argument
from . import operators

SIZES = ("nq", "nv", "njoints")  # words of a plan
REFERENCES = ("in_frame", "in_world", "aligned")  # words of a plan: the objects that stand for them


def _shape(argument: Argument) -> str:
    """The axes of an array, as text."""
    return f"({', '.join(map(str, numba_kernels.kernel_shape(argument)))},)"


def _given(inputs: Sequence[Argument]) -> list[str]:
    """Statements that check objects and make arrays and numbers ``x_in`` of them."""
    checks = [f"is_vector(plan, {x.name}, {x.shape[0]})" if x.shape else f"is_real(plan, {x.name})" for x in inputs]
    lines = [f"if not ({' and '.join(checks)}): return no(plan)"] if checks else []
    return lines + [
        f"{x.name}_in = vector({x.name}, {x.shape[0]})" if x.shape else f"{x.name}_in = real({x.name})" for x in inputs
    ]


@cache
def made(name: str) -> Builtin:
    """``(*inputs) -> result`` of a public call for one sample; words: table, sizes, the axes of the result."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    axes = [f"axis{k}" for k in range(len(numba_kernels.kernel_shape(spec.output)))]
    words = ["table", *SIZES, *axes]
    body = [
        *_given(spec.given),
        f"answer = fresh(plan, {len(axes)}, {dims(words, axes[0])})",
        "if answer == 0: return 0",
        f"out = at(word(answer, {DATA}), ({', '.join(axes)},))",
        f"if single(table, {''.join(f'{x.name}_in, ' for x in spec.given)}out) != {numba_kernels.OK}:",
        "    return never_mind(plan, answer)",
        "return answer",
    ]
    return Builtin(f"made_{name}", [x.name for x in spec.given], words, body, {"single": numba_kernels.single(spec)})


@cache
def kept(name: str, more: tuple[str, ...] = (), returned: bool = True, forces: bool = False) -> Builtin:
    """``(*inputs, *more) -> result`` of a public call for one sample, noted if it is all right.

    more      vectors (nv,) that are only noted
    returned  the result is a new array, and is copied; else it is left where it is noted, and True is returned
    forces    with a last argument, external forces one after the other in a vector, that is not noted

    Words: table, sizes, the axes of the result, memory for the inputs one after the other, result.
    """
    spec = numba_kernels.variant(SPECS[name], frozenset(["fext"] if forces else []))
    axes = [f"axis{k}" for k in range(len(numba_kernels.kernel_shape(spec.output)))]
    words = ["table", *SIZES, *axes, "memory", "result"]
    inputs = [*(x for x in spec.given if x.name != "fext"), *(Argument(x, ("nv",), "", "") for x in more)]
    arguments = [x.name for x in inputs]
    shape, passed = f"({', '.join(axes)},)", "".join(f"{x.name}_in, " for x in spec.given)
    body = [*_given(inputs), f"count = {' * '.join(axes)}"]
    if forces:
        arguments.append("fext")
        body += [
            "if not is_vector(plan, fext, 6 * njoints): return no(plan)",
            f"fext_in = at(word(fext, {DATA}), (njoints, 6))",
        ]
    if returned:
        body += [
            f"answer = fresh(plan, {len(axes)}, {dims(words, axes[0])})",
            "if answer == 0: return 0",
            f"if single(table, {passed}at(word(answer, {DATA}), {shape})) != {numba_kernels.OK}:",
            "    return never_mind(plan, answer)",
        ]
    else:  # written while inputs are read
        body += [f"if not apart({x.name}, {x.shape[0]}, result, count): return no(plan)" for x in inputs]
        body.append(f"if single(table, {passed}at(result, {shape})) != {numba_kernels.OK}: return no(plan)")
    for x in inputs:  # before the result, which may be one of them: somebody holds it
        body += [f"copy({x.name}_in, at(memory, ({x.shape[0]},)))", f"memory += 8 * {x.shape[0]}"]
    if returned:
        body.append(f"copy(at(word(answer, {DATA}), (count,)), at(result, (count,)))")
    body.append("return answer" if returned else "return yes(plan)")
    label = "_".join(["kept", name, *more, "returned" if returned else "there", *["forces"] * forces])
    return Builtin(label, arguments, words, body, {"single": numba_kernels.single(spec), "copy": copy})


@inlined
def copy(x: Any, out: Any) -> None:
    """Copy numbers."""
    for i in range(len(x)):
        out[i] = x[i]


@cache
def again(name: str) -> Builtin:
    """``() -> True`` of a public call on inputs that were noted; words: table, sizes, where inputs and result are."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    arrays = [*spec.given, spec.output]
    words = ["table", *SIZES, *(f"{x.name}_there" for x in arrays)]
    passed = ", ".join(f"at({x.name}_there, {_shape(x)})" for x in arrays)
    body = [f"return yes(plan) if single(table, {passed}) == {numba_kernels.OK} else no(plan)"]
    return Builtin(f"again_{name}", [], words, body, {"single": numba_kernels.single(spec)})


# --- frames ----------------------------------------------------------------------------------------------

FRAMES = ("frames", "joints", "placements")  # words: how many, of each its joint, and where it is on that
STACK = "(frames, 4, 4)"


@inlined
def _place_all(poses: Any, joints: Any, placements: Any, out: Any) -> None:
    for k in range(len(joints)):
        X = spatial.compose(public_arrays.get_pose(poses[joints[k]]), public_arrays.get_pose(placements[k]))
        public_arrays.put_pose(out[k], X)


@cache
def placing(first: bool) -> Builtin:
    """``() -> True``: places of frames by those of joints; ``first`` ``(q)``: places of the joints before, q noted.

    Words: table, sizes, memory, poses of the joints, result, frames.
    """
    words = ["table", *SIZES, "memory", "poses", "result", *FRAMES]
    spec = SPECS["forward_kinematics"]
    body = ["X = at(poses, (njoints, 4, 4))"]
    if first:
        body = [*_given(spec.given), *body, f"if single(table, q_in, X) != {numba_kernels.OK}: return no(plan)"]
        body.append("copy(q_in, at(memory, (nq,)))")
    body.append(f"place_all(X, places(joints, frames), at(placements, {STACK}), at(result, {STACK}))")
    scope = {"single": numba_kernels.single(spec), "place_all": _place_all, "copy": copy}
    return Builtin("placing" if first else "placed", ["q"] * first, words, [*body, "return yes(plan)"], scope)


@cache
def placed_one() -> Builtin:
    """``(frame) -> True``: the place of one frame by that of its joint. Words: poses, result, frames."""
    body = [
        "k = index(plan, frame, frames)",
        "if k < 0: return no(plan)",
        "X = at(poses + 128 * places(joints, frames)[k], (4, 4))",
        "put_pose(at(result + 128 * k, (4, 4)), compose(get_pose(X), get_pose(at(placements + 128 * k, (4, 4)))))",
        "return yes(plan)",
    ]
    scope = {**vars(public_arrays), "compose": spatial.compose}
    return Builtin("placed_one", ["frame"], ["poses", "result", *FRAMES], body, scope)


@inlined
def seen(X: Pose, placement: Pose, m: Motion, reference: int) -> Motion:
    """A motion of a joint's body, in the joint's frame at X, as that of a frame on it, in a reference."""
    if reference == WORLD:
        return spatial.motion_to_parent(X, m)
    return referred(spatial.compose(X, placement), spatial.motion_to_child(placement, m), reference)


@inlined
def _see(X: Any, placement: Any, v: Any, a: Any, classical: Any, reference: int, out: Any) -> None:
    """``seen`` of a, on arrays; with ``classical`` true, of the point, by its velocity v."""
    pose, there = public_arrays.get_pose(X), public_arrays.get_pose(placement)
    m = seen(pose, there, public_arrays.get_motion(a), reference)
    if classical:
        m = of_point(m, seen(pose, there, public_arrays.get_motion(v), reference))
    public_arrays.put_motion(out, m)


see = njit(**{**numba_kernels.FLAGS, "nogil": False})(_see)


@inlined
def _reference(x: int, in_frame: int, in_world: int, aligned: int) -> int:
    """What an object stands for; -1 for another."""
    if x == in_frame:
        return LOCAL
    if x == in_world:
        return WORLD
    return LOCAL_WORLD_ALIGNED if x == aligned else -1


@cache
def moving(classical: bool) -> Builtin:
    """``(frame[, reference]) -> (6,)``: a motion of a frame by that of its joint.

    Words: six (6), sizes, poses, velocities, motions of the joints, references, frames.
    """
    words = ["six", *SIZES, "poses", "velocities", "motions", *REFERENCES, *FRAMES]
    body = [
        "k, code = index(plan, frame, frames), 0",
        "if n > 1: code = coded(reference, in_frame, in_world, aligned)",
        "if k < 0 or code < 0: return no(plan)",
        f"answer = fresh(plan, 1, {dims(words, 'six')})",
        "if answer == 0: return 0",
        "i, p = places(joints, frames)[k], at(placements + 128 * k, (4, 4))",
        "X, v, m = at(poses + 128 * i, (4, 4)), at(velocities + 48 * i, (6,)), at(motions + 48 * i, (6,))",
        f"see(X, p, v, m, {int(classical)}, code, at(word(answer, {DATA}), (6,)))",
        "return answer",
    ]
    label = "classical" if classical else "moving"
    return Builtin(label, ["frame", "reference"], words, body, {"see": _see, "coded": _reference}, optional=1)


@cache
def jacobian(name: str) -> Builtin:
    """``(frame, reference) -> (6, nv)``: ``frame_jacobian`` or ``frame_jacobian_dot`` where q, v were noted.

    Words: table, six (6), sizes, where the inputs are, references, frames; joints are rows of the table.
    """
    spec = SPECS[name]
    inputs = [x for x in spec.given if not x.static]
    words = ["table", *SIZES[::2], "six", "nv", *(f"{x.name}_there" for x in inputs), *REFERENCES, *FRAMES]
    passed = "".join(f"at({x.name}_there, {_shape(x)}), " for x in inputs)
    body = [
        "k, code = index(plan, frame, frames), coded(reference, in_frame, in_world, aligned)",
        "if k < 0 or code < 0: return no(plan)",
        *_jacobian(words, passed),
        "return answer",
    ]
    return Builtin(
        name, ["frame", "reference"], words, body, {"single": numba_kernels.single(spec), "coded": _reference}
    )


def _jacobian(words: list[str], passed: str) -> list[str]:
    """Statements that make the Jacobian of frame k in the reference ``code``."""
    return [
        f"answer = fresh(plan, 2, {dims(words, 'six')})",
        "if answer == 0: return 0",
        "p, out = at(placements + 128 * k, (4, 4)), " + f"at(word(answer, {DATA}), (6, nv))",
        f"if single(table, {passed}places(joints, frames)[k], p, code, out) != {numba_kernels.OK}:",
        "    return never_mind(plan, answer)",
    ]


@cache
def jacobian_at() -> Builtin:
    """``(q, frame) -> (6, nv)``: ``frame_jacobian`` in one reference, q noted.

    Words: table, six (6), sizes, memory, code of the reference, frames; joints are rows of the table.
    """
    spec = SPECS["frame_jacobian"]
    words = ["table", *SIZES[::2], "six", "nv", "memory", "code", *FRAMES]
    body = [
        *_given(spec.given[:1]),
        "k = index(plan, frame, frames)",
        "if k < 0: return no(plan)",
        *_jacobian(words, "q_in, "),
        "copy(q_in, at(memory, (nq,)))",
        "return answer",
    ]
    return Builtin("jacobian_at", ["q", "frame"], words, body, {"single": numba_kernels.single(spec), "copy": copy})


# --- lists -----------------------------------------------------------------------------------------------


def listed(name: str, operator: Callable[..., Any], kinds: str) -> Callable[..., None]:
    """``(a, places, b, out)``: out[k] = operator(a[places[k]], b[k]), for one of the ``operators``."""
    given, made = (part.split() for part in kinds.split("->"))
    body = [
        "stamp",
        "for k in range(len(places)):",
        f"    put_{made[0]}(out[k], operator(get_{given[0]}(a[places[k]]), get_{given[1]}(b[k])))",
    ]
    scope = {**vars(public_arrays), "operator": operator}
    function = numba_kernels.define(f"listed_{name}", ["a", "places", "b", "out"], body, scope)
    compiled: Callable[..., None] = njit(**{**numba_kernels.FLAGS, "nogil": False})(function)
    return compiled


compose_all = listed("compose", spatial.compose, "pose pose -> pose")
relative_all = listed("relative", operators.relative_pose, "pose pose -> pose")
motions_up = listed("motions_up", spatial.motion_to_parent, "pose motion -> motion")
motions_down = listed("motions_down", spatial.motion_to_child, "pose motion -> motion")
forces_up = listed("forces_up", spatial.force_to_parent, "pose force -> force")
bodies_up = listed("bodies_up", operators.moved_body, "pose body -> body")
momenta = listed("momenta", operators.momentum_of, "body motion -> force")
