"""Values of an MjModel: names, numbers, poses, and the joints that equalities couple."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
KINDS = {FREE: "floating", BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}
XML_NAMES = {k: "_" for k in (*range(32), 127)}  # control characters, which no text of a robot can hold


def name_of(m: Any, kind: Any, k: int) -> str:
    """The name of an object of an MjModel; empty if it has none."""
    import mujoco

    return mujoco.mj_id2name(m, kind, k) or ""


def names_of(m: Any, kind: Any, count: int) -> list[str]:
    """The names of all objects of a kind, as links and joints are called."""
    return [name_of(m, kind, k).translate(XML_NAMES) for k in range(count)]


def floats_of(x: Iterable[Any]) -> tuple[float, ...]:
    """Numbers of an array as floats."""
    return tuple(float(y) for y in x)


def turned(quaternion: Any) -> Array:
    """The rotation (3, 3) of a quaternion w x y z, normalised."""
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def pose_of(position: Any, quaternion: Any) -> Array:
    """(4, 4) of a position and a quaternion w x y z."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = turned(quaternion), position
    return X


def couplers(m: Any) -> Iterator[tuple[int, int, int, float, float]]:
    """(equality, joint, leader, ratio, offset) of the active equalities that couple two joints by a line."""
    import mujoco

    for e in range(m.neq):
        if int(m.eq_type[e]) != int(mujoco.mjtEq.mjEQ_JOINT) or not m.eq_active0[e]:
            continue
        j, leader, data = int(m.eq_obj1id[e]), int(m.eq_obj2id[e]), np.asarray(m.eq_data[e])
        if leader >= 0 and not data[2:5].any():
            y, x = (float(m.qpos0[m.jnt_qposadr[k]]) for k in (j, leader))
            yield e, j, leader, float(data[1]), float(data[0]) + y - float(data[1]) * x


def active_couplers(m: Any) -> list[tuple[int, int, float, float]]:
    """(joint, leader, ratio, offset) of couplings that make mimic joints: named leaders, one per follower, no cycle."""
    import mujoco

    found: dict[int, tuple[int, float, float]] = {}
    for _, j, leader, ratio, offset in couplers(m):
        ahead = leader
        while ahead in found:
            ahead = found[ahead][0]
        named = name_of(m, mujoco.mjtObj.mjOBJ_JOINT, leader) and leader != j
        if j not in found and ahead != j and named:
            found[j] = leader, ratio, offset
    return [(j, *rest) for j, rest in found.items()]
