"""Rates of coordinates and of displacements, and the displacement of a step in which a joint turns.

A step of a floating or planar joint is taken in the axes of its body at the beginning: there velocities change by
forces alone, and turn with the body afterwards. A free body, with no joint behind it, then keeps both its momenta to
O(h³) per step: its inertia and its centre of mass turn within the step too.

With L = I ω about the centre of mass c, ω changes by Δ = -h I⁻¹ (ω × L) in an explicit step. In the axes of the
beginning the momenta are constant to h³ if, in addition to Δ,

    δω = I⁻¹ (½ h² ω × (ω × L) - h Δ × L)
    δv = -h (Δ × (ω × c) + ω × (Δ × c)) - ½ h² ω × (ω × (ω × c)) - δω × c

are added to ω and to the velocity v of the origin. Both are cubic forms of ω: a derivation of our own.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec, add, apply_sym, cross, dot, rotate, scale, sub, unrotate
from ...algebra.lie import Quat, exp_rotation, log_jacobian, log_travel, matrix, product, times_twist
from ...algebra.records import inertia_of, motion_of
from ...algebra.scalars import Scalar, cos, inline, select, sin
from ...algebra.spatial import Inertia, Motion
from ...bodies.kinds import CONTINUED, LENGTHS, NV, PLANAR, SE2, SE3, SO2, SO3
from ..signatures import Bodies, Config, Vector
from ..spec import Argument, Q, Spec, V
from .configuration import put_twist, twist


class Displaced(NamedTuple):
    """The outputs of ``displacement_rate``."""

    rate: Vector
    turned: Vector


class Turned(NamedTuple):
    """The outputs of ``turn_by``."""

    after: Vector
    moved: Vector


@inline
def coordinate_rate(bodies: Bodies, q: Config, v: Vector, dq: Config) -> None:
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


@inline
def rate_of_displacement(bodies: Bodies, u: Vector, v: Vector, out: Vector) -> None:
    """u̇ of q(t) = q0 ∘ exp(u(t)) for joint velocities v: the inverse right Jacobian of exp at u, times v."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        if NV[b.kind] == 1:
            out[i - 1] = v[i - 1]
        elif b.kind != CONTINUED:
            m, rate = twist(b, i - 1, u), twist(b, i - 1, v)
            put_twist(b, i - 1, times_twist(log_jacobian(m, 1.0), rate), out)


@inline
def largest_turn(bodies: Bodies, u: Vector) -> Scalar:
    """The largest square of an angle by which a joint of several freedoms turns in a displacement u."""
    largest = 0.0
    for i in range(1, len(bodies)):
        b = bodies[i]
        if NV[b.kind] > 1:
            w = twist(b, i - 1, u).w
            square = dot(w, w)
            largest = select(square - largest, square, largest)
    return largest


@inline
def displacement_rate(bodies: Bodies, u: Vector, v: Vector, out: Displaced) -> None:
    """``rate_of_displacement`` and ``largest_turn``."""
    rate_of_displacement(bodies, u, v, out.rate)
    out.turned[0] = largest_turn(bodies, u)


@inline
def turn(bodies: Bodies, h: Vector, v: Vector, w: Vector, u: Vector) -> int:
    """u ← the displacement of a step h (nv, all alike) by velocities w = v + h a, and w ← the velocities after it.

    v  velocities by which -ω × v is in a; 0 where w is in the axes at the beginning: with ``add_begun``
    """
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if b.kind in SE3 or b.kind in SE2:
            more, after = begun(bodies, i, h[r], twist(b, r, v)), twist(b, r, w)
            x, angle = add(after.v, more.v), scale(h[r], add(after.w, more.w))
            back = unrotate(matrix(exp_rotation(angle)), x)
            put_twist(b, r, Motion(add(after.w, more.w), back), w)
            put_twist(b, r, Motion(angle, log_travel(angle, scale(h[r], x))), u)
        elif b.kind != CONTINUED:
            for k in range(r, r + NV[b.kind]):
                u[k] = h[k] * w[k]
    return 0


@inline
def turn_by(bodies: Bodies, v: Vector, x: Vector, dt: Vector, out: Turned) -> None:
    """``turn`` of a call: u and the velocities after a step dt (1)."""
    for i in range(len(x)):
        out.after[i], out.moved[i] = x[i], dt[0]
    turn(bodies, out.moved, v, out.after, out.moved)


@inline
def add_begun(bodies: Bodies, h: Scalar, v: Vector, d: Vector) -> None:
    """d (nv) = the change of velocities v over a step h that is not due to forces, in the axes of the beginning."""
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if b.kind in SE3 or b.kind in SE2:
            put_twist(b, r, begun(bodies, i, h, twist(b, r, v)), d)
        elif b.kind != CONTINUED:
            for k in range(r, r + NV[b.kind]):
                d[k] = 0.0


@inline
def begun(bodies: Bodies, i: int, h: Scalar, m: Motion) -> Motion:
    """``add_begun`` for a floating or planar joint of twist m, first row i: h ω × v, and for a free body ``kept``."""
    turned = scale(h, cross(m.w, m.v))
    if not is_free(bodies, i):
        return Motion(Vec(0.0, 0.0, 0.0), turned)
    more = kept(bodies, i, h, m.w, m.w, m.w)
    return Motion(more.w, add(turned, more.v))


@inline
def is_free(bodies: Bodies, i: int) -> bool:
    """Whether the joint of first row i carries a body that no other joint connects."""
    last = i + NV[bodies[i].kind] - 1
    for j in range(last + 1, len(bodies)):
        if bodies[j].parent == last:
            return False
    return bodies[i].parent == 0  # type: ignore[no-any-return]


@inline
def kept(bodies: Bodies, i: int, h: Scalar, a: Vec, b: Vec, e: Vec) -> Motion:
    """The trilinear form whose value at ω, ω, ω is (δω, δv) of a free body: see the module."""
    I = inertia_of(bodies[i + NV[bodies[i].kind] - 1].inertia)
    c = scale(1.0 / select(I.m, I.m, 1.0), I.h)
    half = 0.5 * h * h
    if bodies[i].kind in SE2:
        x, y = motion_of(bodies[i].S).v, motion_of(bodies[i + 1].S).v
        c = Vec(dot(x, c), dot(y, c), 0.0)
        return Motion(Vec(0.0, 0.0, 0.0), scale(-half, cross(a, cross(b, cross(e, c)))))
    L = about_centre(I, c, e)
    change = scale(-h, about_centre_inverse(I, c, cross(a, about_centre(I, c, b))))  # Δ
    w = about_centre_inverse(I, c, sub(scale(half, cross(a, cross(b, L))), scale(h, cross(change, L))))
    turned = scale(-h, add(cross(change, cross(e, c)), cross(e, cross(change, c))))
    v = sub(turned, scale(half, cross(a, cross(b, cross(e, c)))))
    return Motion(w, sub(v, cross(w, c)))


@inline
def about_centre(I: Inertia, c: Vec, w: Vec) -> Vec:
    """I ω about the centre of mass."""
    return add(apply_sym(I.I, w), cross(I.h, cross(c, w)))


@inline
def about_centre_inverse(I: Inertia, c: Vec, n: Vec) -> Vec:
    """ω from I ω = n about the centre of mass; 0 for a point mass."""
    S, h = I.I, I.h
    xx, yy, zz = S.xx - (h.y * c.y + h.z * c.z), S.yy - (h.x * c.x + h.z * c.z), S.zz - (h.x * c.x + h.y * c.y)
    xy, xz, yz = S.xy + h.x * c.y, S.xz + h.x * c.z, S.yz + h.y * c.z
    A, B, C = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * A + xy * B + xz * C
    each = select(det, 1.0, 0.0) / select(det, det, 1.0)
    x = A * n.x + B * n.y + C * n.z
    y = B * n.x + (xx * zz - xz * xz) * n.y + (xy * xz - xx * yz) * n.z
    z = C * n.x + (xy * xz - xx * yz) * n.y + (xx * yy - xy * xy) * n.z
    return scale(each, Vec(x, y, z))


AHEAD = Argument("x", ("nv",), "rad/s | m/s", "velocities after a step, as ``turn`` takes them")
TURN = Spec(
    "turn", turn_by, None, (V, AHEAD, Argument("dt", (1,), "s", "step")),
    Argument("result", ("nv+nv",), "", "velocities after a step, displacement"),
    "Velocities after a step, turned with floating and planar joints, and its displacement.",
    "see ``recursions.coordinates.coordinate_rates``", composed=True,
    parts=Turned(
        Argument("after", ("nv",), "rad/s | m/s", "after the step"),
        Argument("moved", ("nv",), "rad | m", "displacement of the step"),
    ),
)  # fmt: skip
DISPLACEMENT_RATE = Spec(
    "displacement_rate", displacement_rate, None,
    (Argument("u", ("nv",), "rad | m", "displacement"), V),
    Argument("result", ("nv+1",), "", "rate of the displacement, largest square of a turn"),
    "Rate of the displacement u of q ∘ exp(u), and the largest turn of a joint.",
    "see ``recursions.coordinates.coordinate_rates``", composed=True,
    parts=Displaced(
        Argument("rate", ("nv",), "rad/s | m/s", "of the displacement"),
        Argument("turned", (1,), "rad²", "largest square of an angle by which a joint of several freedoms turns"),
    ),
)  # fmt: skip
COORDINATE_RATE = Spec(
    "coordinate_rate", coordinate_rate, None, (Q, V), Argument("dq", ("nq",), "", "rates of coordinates"),
    "dq/dt of joints that move with v.", "see ``recursions.coordinates.coordinate_rates``", composed=True,
)  # fmt: skip
