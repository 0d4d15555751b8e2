"""Rates of coordinates and of displacements, and the displacement of a step in which a joint turns."""

from __future__ import annotations

from ...algebra.euclidean import add, cross, rotate, scale, unrotate
from ...algebra.lie import Quat, exp_rotation, log_jacobian, log_travel, matrix, product
from ...algebra.scalars import cos, inline, sin
from ...algebra.spatial import Motion
from ...bodies.kinds import CONTINUED, LENGTHS, NV, PLANAR, SE2, SE3, SO2, SO3
from ..signatures import Bodies, Config, Vector
from .configuration import put_twist, twist


@inline
def coordinate_rate(bodies: Bodies, q: Config, v: Vector, dq: Config) -> int:
    """dq (nq) = dq/dt of joints that move with v."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        k = b.q_index
        if b.kind == CONTINUED:
            continue
        m = twist(b, i - 1, v)
        if b.kind in SO2:
            dq[k], dq[k + 1] = -q[k + 1] * m.w.z, q[k] * m.w.z
        elif b.kind in SO3 or b.kind in SE3:
            k += LENGTHS[b.kind]
            a = Quat(q[k], q[k + 1], q[k + 2], q[k + 3])
            e = product(a, Quat(0.5 * m.w.x, 0.5 * m.w.y, 0.5 * m.w.z, 0.0))
            dq[k], dq[k + 1], dq[k + 2], dq[k + 3] = e.x, e.y, e.z, e.w
            if b.kind in SE3:
                u = rotate(matrix(a), m.v)
                dq[k - 3], dq[k - 2], dq[k - 1] = u.x, u.y, u.z
        elif b.kind in SE2:
            if b.kind == PLANAR:
                c, s = cos(q[k + 2]), sin(q[k + 2])
                dq[k + 2] = m.w.z
            else:
                c, s = q[k + 2], q[k + 3]
                dq[k + 2], dq[k + 3] = -s * m.w.z, c * m.w.z
            dq[k], dq[k + 1] = c * m.v.x - s * m.v.y, s * m.v.x + c * m.v.y
        else:
            dq[k] = m.w.z
    return 0


@inline
def rate_of_displacement(bodies: Bodies, u: Vector, v: Vector, out: Vector) -> None:
    """u̇ of q(t) = q0 ∘ exp(u(t)) for joint velocities v: the inverse right Jacobian of exp at u, times v."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        if NV[b.kind] == 1:
            out[i - 1] = v[i - 1]
        elif b.kind != CONTINUED:
            m, rate = twist(b, i - 1, u), twist(b, i - 1, v)
            T = log_jacobian(m, 1.0)
            put_twist(b, i - 1, Motion(rotate(T.J, rate.w), add(rotate(T.J, rate.v), rotate(T.K, rate.w))), out)


@inline
def turn(bodies: Bodies, h: Vector, v: Vector, w: Vector, u: Vector) -> int:
    """u ← the displacement of a step h (nv, all alike) by velocities w = v + h a, and w ← the velocities after it.

    v  velocities by which -ω × v is in a; 0 where a lacks it, and w is in the axes at the beginning
    """
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if b.kind in SE3 or b.kind in SE2:
            before, after = twist(b, r, v), twist(b, r, w)
            x = add(after.v, scale(h[r], cross(before.w, before.v)))
            angle = scale(h[r], after.w)
            put_twist(b, r, Motion(after.w, unrotate(matrix(exp_rotation(angle)), x)), w)
            put_twist(b, r, Motion(angle, log_travel(angle, scale(h[r], x))), u)
        elif b.kind != CONTINUED:
            for k in range(r, r + NV[b.kind]):
                u[k] = h[k] * w[k]
    return 0
