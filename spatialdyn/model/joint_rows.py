"""A joint as rows of the table of bodies: its kind, axis and pose there, and its motion.

One row per freedom (see ``bodies.table``): the first has the kind, the others are of kind CONTINUED.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.euclidean import Mat3, Vec
from ..algebra.records import pose_of, put_mat3, put_motion, put_pose
from ..algebra.spatial import Motion, Pose, identity_pose
from ..bodies.joints import place_joint
from ..bodies.kinds import CONTINUED, SCREWS, TURNS, kind_of
from ..bodies.table import BODIES

Array = NDArray[np.float64]


class Joint(NamedTuple):
    """A joint of the Model; index 0 is the world.

    kind      world, revolute, continuous, prismatic, spherical, floating, planar or helical
    parent    index of the joint whose body carries it
    row       row of the table that has its body's inertia, the last of the joint's rows
    idx_q, nq index and number of its coordinates in q; idx_v, nv of its velocities in v (a mimic's are its leader's)
    placement (4, 4) pose in the parent joint's body at q = 0
    axis      (3,) unit vector in the joint's frame
    mimic     None, or (leader's index, multiplier, offset), chains resolved
    pitch     of a helical joint: travel along its axis per radian [m/rad]
    """

    name: str
    kind: str
    parent: int
    row: int
    idx_q: int
    nq: int
    idx_v: int
    nv: int
    placement: Array
    axis: Array
    mimic: tuple[int, float, float] | None = None
    pitch: float = 0.0


def blank(rows: int) -> NDArray[Any]:
    """A table of the world and ``rows`` rows, every pose the identity."""
    bodies = np.zeros(rows + 1, BODIES)
    for xx in ("xx", "yy", "zz"):
        bodies["X"]["R"][xx] = 1.0
    return bodies


def put_joint(bodies: NDArray[Any], row: int, kind: int, X: Pose, S: Array, at: int) -> None:
    """Write a joint into the rows from ``row`` on: its kind, pose, S (freedoms, 6) and index in q."""
    _write(bodies, row, "X", X, put_pose)
    if kind in TURNS or kind in SCREWS:
        R, u = np.reshape(X.R, (3, 3)), S[0, :3]
        along = np.outer(R @ u, u)
        _write(bodies, row, "axial", Mat3(*along.ravel().tolist()), put_mat3)
        _write(bodies, row, "transverse", Mat3(*(R - along).ravel().tolist()), put_mat3)
        x, y, z = u.tolist()
        skewed = [w for a, b, c in R.tolist() for w in (b * z - c * y, c * x - a * z, a * y - b * x)]  # rows of R × u
        _write(bodies, row, "skewed", Mat3(*skewed), put_mat3)
    for k, s in enumerate(S.tolist(), start=row):
        _write(bodies, k, "parent", k - 1)
        _write(bodies, k, "kind", kind if k == row else CONTINUED)
        _write(bodies, k, "dofs", len(S) if k == row else 0)
        _write(bodies, k, "q_index", at)
        _write(bodies, k, "S", Motion(Vec(*s[:3]), Vec(*s[3:])), put_motion)


def _write(
    bodies: NDArray[Any], row: int, name: str, value: Any, put: Callable[[Any, Any], None] | None = None
) -> None:
    """Write a field of a row; in an array by one assignment of nested tuples, which is faster than number by number."""
    if isinstance(bodies, np.ndarray):
        bodies[name][row] = value
    elif put is None:
        setattr(bodies[row], name, value)
    else:
        put(getattr(bodies[row], name), value)


def subspace(kind: str, axis: ArrayLike, pitch: Any = 0.0) -> Array:
    """Motion subspaces (freedoms, 6) of a joint's rows, angular first, in its frame.

    The two axes of a plane are x and y, rotated by the shortest rotation that takes z to the normal. An axis of exact
    numbers gives exact entries.
    """
    u = np.asarray(axis)
    u = u if u.dtype == object else u.astype(float)
    if kind in ("revolute", "continuous"):
        return np.array([[*u, 0.0, 0.0, 0.0]])
    if kind == "prismatic":
        return np.array([[0.0, 0.0, 0.0, *u]])
    if kind == "helical":
        return np.array([[*u, *(pitch * u)]])
    linear_first = np.roll(np.eye(6), 3, axis=1)
    if kind == "floating":
        return linear_first
    if kind == "spherical":
        return linear_first[3:]
    if float(u[2]) <= -1.0 + 1e-15:
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    else:
        k = 1.0 / (1.0 + u[2])
        x = np.array([1.0 - k * u[0] * u[0], -k * u[0] * u[1], -u[0]])
        y = np.array([-k * u[0] * u[1], 1.0 - k * u[1] * u[1], -u[1]])
    S = np.zeros((3, 6), dtype=u.dtype)
    S[0, 3:], S[1, 3:], S[2, :3] = x, y, u
    return S


def joint_transform(kind: str, axis: ArrayLike, q: ArrayLike, continuous: str = "angle", pitch: float = 0.0) -> Array:
    """X_J (4, 4) of a joint at coordinates q (nq,)."""
    S = subspace(kind, axis, pitch)
    bodies = blank(len(S))
    put_joint(bodies, 1, kind_of(kind, continuous).code, identity_pose(), S, 0)
    place_joint(bodies, 1, np.asarray(q, dtype=float), bodies[0].X)
    return matrix_from_pose(pose_of(bodies[0].X))


# --- matrices and the table's poses -----------------------------------------------------------------------


def pose_from_matrix(placement: ArrayLike) -> Pose:
    """A placement of 16 numbers, in row-major order, as a Pose."""
    X = np.reshape(placement, (4, 4)).tolist()
    return Pose(Mat3(*X[0][:3], *X[1][:3], *X[2][:3]), Vec(X[0][3], X[1][3], X[2][3]))


def matrix_from_pose(X: Pose) -> Array:
    """A Pose as a read-only matrix (4, 4)."""
    M = np.eye(4)
    M[:3, :3] = np.reshape(X.R, (3, 3))
    M[:3, 3] = X.p
    return frozen(M)


def frozen(values: ArrayLike, dtype: type = float) -> NDArray[Any]:
    """A read-only copy."""
    a: NDArray[Any] = np.array(values, dtype=dtype)
    a.flags.writeable = False
    return a
