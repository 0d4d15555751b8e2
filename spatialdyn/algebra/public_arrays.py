"""Spatial quantities in small float64 arrays, the linear part first as in every public array.

==========  ======  ============================================================================================
pose        (4, 4)  homogeneous matrix
motion      (6,)    velocity of the origin, angular velocity
force       (6,)    force, moment about the origin
vec         (3,)    a vector
rot         (3, 3)  a matrix
quat        (4,)    a quaternion x y z w
seven       (7,)    a pose as origin x y z and quaternion x y z w
body        (10,)   mass, centre of mass, rotational inertia about it: xx xy yy xz yz zz
parameters  (10,)   of an inertia: m, h, and of Ī xx xy yy xz yz zz
inertia     (6, 6)  the matrix [m 1 -h̃; h̃ Ī] that maps motions to forces
tangent     (6, 6)  a matrix [J K; 0 J] between motions
==========  ======  ============================================================================================
"""

from __future__ import annotations

from typing import Any, NamedTuple

from .euclidean import Mat3, Sym, Vec
from .lie import Quat, Tangent
from .scalars import Scalar, inline
from .spatial import Force, Inertia, Motion, Pose


class Placed(NamedTuple):
    """A frame seen from its parent: origin and quaternion."""

    p: Vec
    q: Quat


class Body(NamedTuple):
    """A rigid body about its centre of mass: mass, the centre, the rotational inertia there."""

    m: Scalar
    c: Vec
    I: Sym


@inline
def read_vec(x: Any, k: int = 0) -> Vec:
    """Read the vector x[k:k+3]."""
    return Vec(x[k], x[k + 1], x[k + 2])


@inline
def write_vec(out: Any, a: Vec, k: int = 0) -> None:
    """Write the vector out[k:k+3]."""
    out[k], out[k + 1], out[k + 2] = a.x, a.y, a.z


@inline
def read_quat(x: Any, k: int = 0) -> Quat:
    """Read the quaternion x[k:k+4]."""
    return Quat(x[k], x[k + 1], x[k + 2], x[k + 3])


@inline
def write_quat(out: Any, a: Quat, k: int = 0) -> None:
    """Write the quaternion out[k:k+4]."""
    out[k], out[k + 1], out[k + 2], out[k + 3] = a.x, a.y, a.z, a.w


@inline
def read_motion(x: Any) -> Motion:
    """Read a motion (6,): linear first."""
    return Motion(read_vec(x, 3), read_vec(x))


@inline
def write_motion(out: Any, m: Motion) -> None:
    """Write a motion (6,): linear first."""
    write_vec(out, m.v)
    write_vec(out, m.w, 3)


@inline
def read_force(x: Any) -> Force:
    """Read a force (6,): linear first."""
    return Force(read_vec(x, 3), read_vec(x))


@inline
def write_force(out: Any, f: Force) -> None:
    """Write a force (6,): linear first."""
    write_vec(out, f.f)
    write_vec(out, f.n, 3)


@inline
def read_rot(x: Any) -> Mat3:
    """Read a matrix (3, 3)."""
    return Mat3(x[0, 0], x[0, 1], x[0, 2], x[1, 0], x[1, 1], x[1, 2], x[2, 0], x[2, 1], x[2, 2])


@inline
def write_rot(out: Any, A: Mat3) -> None:
    """Write a matrix (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = A.xx, A.xy, A.xz
    out[1, 0], out[1, 1], out[1, 2] = A.yx, A.yy, A.yz
    out[2, 0], out[2, 1], out[2, 2] = A.zx, A.zy, A.zz


@inline
def read_pose(x: Any) -> Pose:
    """Read a pose (4, 4)."""
    return Pose(read_rot(x), Vec(x[0, 3], x[1, 3], x[2, 3]))


@inline
def write_pose(out: Any, X: Pose) -> None:
    """Write a pose (4, 4)."""
    write_rot(out, X.R)
    out[0, 3], out[1, 3], out[2, 3] = X.p.x, X.p.y, X.p.z
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = 0.0, 0.0, 0.0, 1.0


@inline
def read_seven(x: Any) -> Placed:
    """Read an origin and a quaternion (7,)."""
    return Placed(read_vec(x), read_quat(x, 3))


@inline
def write_seven(out: Any, X: Placed) -> None:
    """Write an origin and a quaternion (7,)."""
    write_vec(out, X.p)
    write_quat(out, X.q, 3)


@inline
def read_body(x: Any) -> Body:
    """Read a body (10,)."""
    return Body(x[0], read_vec(x, 1), Sym(x[4], x[5], x[7], x[6], x[8], x[9]))


@inline
def write_body(out: Any, B: Body) -> None:
    """Write a body (10,)."""
    out[0] = B.m
    write_vec(out, B.c, 1)
    _write_sym(out, B.I)


@inline
def read_parameters(x: Any) -> Inertia:
    """Read ten numbers (10,): m, h, and of Ī xx xy yy xz yz zz."""
    return Inertia(x[0], read_vec(x, 1), Sym(x[4], x[5], x[7], x[6], x[8], x[9]))


@inline
def write_parameters(out: Any, I: Inertia) -> None:
    """Write ten numbers (10,): m, h, and of Ī xx xy yy xz yz zz."""
    out[0] = I.m
    write_vec(out, I.h, 1)
    _write_sym(out, I.I)


@inline
def _write_sym(out: Any, A: Sym) -> None:
    out[4], out[5], out[6], out[7], out[8], out[9] = A.xx, A.xy, A.yy, A.xz, A.yz, A.zz


@inline
def write_tangent(out: Any, A: Tangent) -> None:
    """Write [J K; 0 J] (6, 6)."""
    write_rot(out[:3, :3], A.J)
    write_rot(out[:3, 3:], A.K)
    write_rot(out[3:, 3:], A.J)
    for i in range(3, 6):
        for j in range(3):
            out[i, j] = 0.0


@inline
def write_inertia(out: Any, B: Inertia) -> None:
    """Write [m 1 -h̃; h̃ Ī] (6, 6)."""
    m, h, J = B.m, B.h, B.I
    write_rot(out[:3, :3], Mat3(m, 0.0, 0.0, 0.0, m, 0.0, 0.0, 0.0, m))
    write_rot(out[:3, 3:], Mat3(0.0, h.z, -h.y, -h.z, 0.0, h.x, h.y, -h.x, 0.0))
    write_rot(out[3:, :3], Mat3(0.0, -h.z, h.y, h.z, 0.0, -h.x, -h.y, h.x, 0.0))
    write_rot(out[3:, 3:], Mat3(J.xx, J.xy, J.xz, J.xy, J.yy, J.yz, J.xz, J.yz, J.zz))
