"""Kernels that keep: a call of the library that also notes what it was given, and operators on lists.

The caller of ``rnea`` may later ask for the forces that the torques came from, when q has long changed in place. So the
kernel copies inputs and result to memory of the caller's while it has them at hand: nothing there, 0.5 µs from Python.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit, types

from . import layouts, operators, spatial
from .engines import jit
from .recursions import SPECS


@cache
def kept(name: str, more: tuple[str, ...] = (), returned: bool = True) -> Callable[..., int]:
    """``(table, *inputs, *more, result, memory) -> status``: a public call for one sample, memory written if it is 0.

    more      vectors that are only kept
    returned  memory starts with the result; else the result is not kept: it is in memory already
    memory    result, inputs, more, one after the other: its size has to be the sum of theirs
    """
    spec = jit.variant(SPECS[name], frozenset())
    inputs = [x.name for x in spec.given]
    arrays = [*(["result"] if returned else []), *inputs, *more]
    size = " + ".join([*(f"{x}.size" for x in arrays), *([] if returned else ["result.size"])])
    body = [
        f"if memory.size != {size}:",
        f"    return {jit.SHAPE}",
        f"status = single(table, {', '.join([*inputs, 'result'])})",
        f"if status != {jit.OK}:",
        "    return status",
        f"k = {0 if returned else 'result.size'}",
    ]
    for x in arrays:
        flat = "result.reshape(-1)" if x == "result" and spec.output.shape[1:] else x
        body += [
            f"{x}_flat = {flat}",
            f"for i in range({x}.size):",
            f"    memory[k + i] = {x}_flat[i]",
            f"k += {x}.size",
        ]
    parameters = ["table", *inputs, *more, "result", "memory"]
    label = "_".join(["kept", name, *more, "returned" if returned else "there"])
    function = jit.define(label, parameters, ["stamp", *body, f"return {jit.OK}"], {"single": jit.single(spec)})
    made: Any = types.Array
    vector = made(types.float64, 1, "A", readonly=True)
    result = made(types.float64, len(spec.output.shape), "C")
    signature = (types.intp, *[vector] * (len(inputs) + len(more)), result, made(types.float64, 1, "C"))
    return jit.compiled(function, signature)


@cache
def placing() -> Callable[..., int]:
    """``(table, q, poses, memory, joints, placements, frames) -> status``: places of joints, kept, and of frames."""
    body = [
        "stamp",
        "status = places(table, q, poses, memory)",
        f"if status == {jit.OK}:",
        "    for k in range(len(joints)):",
        "        put_pose(frames[k], compose(get_pose(poses[joints[k]]), get_pose(placements[k])))",
        "return status",
    ]
    scope = {**vars(layouts), "compose": spatial.compose, "places": kept("forward_kinematics", (), False)}
    names = ["table", "q", "poses", "memory", "joints", "placements", "frames"]
    made: Any = types.Array
    vector = made(types.float64, 1, "A", readonly=True)
    stack = made(types.float64, 3, "C")
    signature = (types.intp, vector, stack, made(types.float64, 1, "C"), made(types.intp, 1, "C"), stack, stack)
    return jit.compiled(jit.define("placing", names, body, scope), signature)


def listed(name: str, operator: Callable[..., Any], kinds: str) -> Callable[..., None]:
    """``(a, places, b, out)``: out[k] = operator(a[places[k]], b[k]), for an operator of ``algebra``."""
    given, made = (part.split() for part in kinds.split("->"))
    body = [
        "stamp",
        "for k in range(len(places)):",
        f"    put_{made[0]}(out[k], operator(get_{given[0]}(a[places[k]]), get_{given[1]}(b[k])))",
    ]
    scope = {**vars(layouts), "operator": operator}
    function = jit.define(f"listed_{name}", ["a", "places", "b", "out"], body, scope)
    compiled: Callable[..., None] = njit(**{**jit.FLAGS, "nogil": False})(function)
    return compiled


compose_all = listed("compose", spatial.compose, "pose pose -> pose")
relative_all = listed("relative", operators.relative_pose, "pose pose -> pose")
motions_up = listed("motions_up", spatial.motion_to_parent, "pose motion -> motion")
motions_down = listed("motions_down", spatial.motion_to_child, "pose motion -> motion")
forces_up = listed("forces_up", spatial.force_to_parent, "pose force -> force")
bodies_up = listed("bodies_up", operators.moved_body, "pose body -> body")
momenta = listed("momenta", operators.momentum_of, "body motion -> force")
