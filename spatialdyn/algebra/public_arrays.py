"""How spatial objects lie in small float64 arrays, with the linear part first as in every public array.

==========  ======  ============================================================================================
pose        (4, 4)  homogeneous matrix
motion      (6,)    velocity of the origin, angular velocity
force       (6,)    force, moment about the origin
vec         (3,)    a vector
rot         (3, 3)  a matrix
quat        (4,)    a quaternion x y z w
seven       (7,)    a pose as origin x y z and quaternion x y z w
body        (10,)   mass, centre of mass, rotational inertia about it: xx xy yy xz yz zz
inertia     (6, 6)  the matrix [m 1 -h̃; h̃ Ī] that makes forces of motions
tangent     (6, 6)  a matrix [J K; 0 J] between motions
==========  ======  ============================================================================================
"""

from __future__ import annotations

from typing import Any, NamedTuple

from .euclidean import Rot, Sym, Vec
from .lie import Quat, Tangent
from .records import force_from, pose_from, public_force, public_motion, public_pose, public_vec
from .scalars import Scalar, inlined
from .spatial import Inertia, Motion


class Placed(NamedTuple):
    """A frame seen from its parent: origin and quaternion."""

    p: Vec
    q: Quat


class Body(NamedTuple):
    """A rigid body about its centre of mass: mass, the centre, the rotational inertia there."""

    m: Scalar
    c: Vec
    I: Sym


get_pose, get_force = pose_from, force_from
put_pose, put_motion, put_force, put_vec = public_pose, public_motion, public_force, public_vec


@inlined
def get_vec(x: Any) -> Vec:
    """A vector."""
    return Vec(x[0], x[1], x[2])


@inlined
def get_rot(x: Any) -> Rot:
    """A 3 x 3 matrix."""
    return Rot(x[0, 0], x[0, 1], x[0, 2], x[1, 0], x[1, 1], x[1, 2], x[2, 0], x[2, 1], x[2, 2])


@inlined
def get_quat(x: Any) -> Quat:
    """A quaternion."""
    return Quat(x[0], x[1], x[2], x[3])


@inlined
def get_seven(x: Any) -> Placed:
    """An origin and a quaternion."""
    return Placed(Vec(x[0], x[1], x[2]), Quat(x[3], x[4], x[5], x[6]))


@inlined
def get_motion(x: Any) -> Motion:
    """A motion."""
    return Motion(Vec(x[3], x[4], x[5]), Vec(x[0], x[1], x[2]))


@inlined
def get_body(x: Any) -> Body:
    """A body."""
    return Body(x[0], Vec(x[1], x[2], x[3]), Sym(x[4], x[5], x[7], x[6], x[8], x[9]))


@inlined
def put_rot(out: Any, A: Rot) -> None:
    """Write a 3 x 3 matrix."""
    out[0, 0], out[0, 1], out[0, 2] = A.xx, A.xy, A.xz
    out[1, 0], out[1, 1], out[1, 2] = A.yx, A.yy, A.yz
    out[2, 0], out[2, 1], out[2, 2] = A.zx, A.zy, A.zz


@inlined
def put_quat(out: Any, a: Quat) -> None:
    """Write a quaternion."""
    out[0], out[1], out[2], out[3] = a.x, a.y, a.z, a.w


@inlined
def put_seven(out: Any, X: Placed) -> None:
    """Write an origin and a quaternion."""
    out[0], out[1], out[2] = X.p.x, X.p.y, X.p.z
    out[3], out[4], out[5], out[6] = X.q.x, X.q.y, X.q.z, X.q.w


@inlined
def put_body(out: Any, B: Body) -> None:
    """Write a body."""
    out[0], out[1], out[2], out[3] = B.m, B.c.x, B.c.y, B.c.z
    out[4], out[5], out[6], out[7], out[8], out[9] = B.I.xx, B.I.xy, B.I.yy, B.I.xz, B.I.yz, B.I.zz


@inlined
def put_tangent(out: Any, A: Tangent) -> None:
    """Write [J K; 0 J]."""
    put_rot(out[:3, :3], A.J)
    put_rot(out[:3, 3:], A.K)
    put_rot(out[3:, 3:], A.J)
    for i in range(3, 6):
        for j in range(3):
            out[i, j] = 0.0


@inlined
def put_inertia(out: Any, B: Inertia) -> None:
    """Write [m 1 -h̃; h̃ Ī]."""
    m, h, J = B.m, B.h, B.I
    put_rot(out[:3, :3], Rot(m, 0.0, 0.0, 0.0, m, 0.0, 0.0, 0.0, m))
    put_rot(out[:3, 3:], Rot(0.0, h.z, -h.y, -h.z, 0.0, h.x, h.y, -h.x, 0.0))
    put_rot(out[3:, :3], Rot(0.0, -h.z, h.y, h.z, 0.0, -h.x, -h.y, h.x, 0.0))
    put_rot(out[3:, 3:], Rot(J.xx, J.xy, J.xz, J.xy, J.yy, J.yz, J.xz, J.yz, J.zz))
