"""The configuration space: moving along it, differences in it, and the derivatives of both.

A configuration q moves by a velocity v held for unit time, q ∘ exp(v): each joint's twist in its own body's frame,
as v itself is. Coordinates that are numbers add; quaternions and (cos, sin) pairs multiply on the right and are
normalized, q/|q| to rounding, so they do not drift. A joint of one freedom is a group too: its displacement is w.z of a
twist, so that every kind shares ``twist``, ``_move`` and ``_between``. A planar joint's twist is in its own x, y and
normal.

Where the table takes coordinates of ANY_NORM, those off the unit sphere move as ``configuration_off_norm`` says.

The exponentials and their derivatives are in ``lie``.

Row i of the table belongs to v[i - 1]; no array may overlap ``out``, and all of ``out`` is written.
"""

from __future__ import annotations

from ...algebra.euclidean import Mat3, Vec, add, rotate, scale, sub, unrotate, zero
from ...algebra.lie import (
    Quat,
    Tangent,
    conjugate,
    exp_jacobian,
    exp_rotation,
    exp_travel,
    inverse_adjoint,
    log_jacobian,
    log_jacobian_times_derivative,
    log_rotation,
    log_travel,
    matrix,
    product,
    rescaled,
    scale_quat,
    unit,
)
from ...algebra.public_arrays import read_quat, read_vec, write_quat, write_vec
from ...algebra.scalars import Scalar, atan2, cos, inline, select, sin, sqrt
from ...algebra.spatial import Motion, scale_motion
from ...bodies.kinds import CONTINUED, LENGTHS, NQ, NV, ONE, PLANAR, R1, SE2, SE3, SO2, SO3, UNITS
from ...bodies.table import ANY_NORM
from ..signatures import Array, Bodies, Config, Record, Vector
from ..spec import Argument, Q, Spec
from .configuration_off_norm import free_angle, free_travel, leave_pair, mix_pairs, pull_pair, pulled, quat_norm


@inline
def neutral(bodies: Bodies, out: Config) -> None:
    """The configuration in which no joint is displaced, out (nq)."""
    for i in range(1, len(bodies)):
        kind, k = bodies[i].kind, bodies[i].q_index
        for m in range(NQ[kind]):
            out[k + m] = 1.0 if m == ONE[kind] else 0.0


@inline
def normalize(bodies: Bodies, q: Config, out: Config) -> None:
    """q with its quaternions and (cos, sin) pairs scaled to unit norm; zero ones stay zero.

    q    (nq)  [rad | m]
    out  (nq)  written
    """
    for i in range(1, len(bodies)):
        kind, first = bodies[i].kind, bodies[i].q_index
        k = first + LENGTHS[kind]
        for m in range(first, first + NQ[kind]):
            out[m] = q[m]
        if UNITS[kind] == 2:
            a = rescaled(Quat(0.0, 0.0, q[k], q[k + 1]))
            _put_pair(out, k, a.z, a.w)
        elif UNITS[kind] == 4:
            write_quat(out, rescaled(read_quat(q, k)), k)


@inline
def integrate(bodies: Bodies, q: Config, v: Vector, out: Config) -> None:
    """out = q ∘ exp(v).

    Of the two quaternions ±a of the result, a floating joint gets the one nearer to q's, a spherical joint the one
    that its motion reaches continuously (as in Pinocchio).

    q    (nq)  [rad | m]
    v    (nv)  velocity times duration [rad | m], twists in the body's frame
    out  (nq)  written
    """
    for i in range(1, len(bodies)):
        if bodies[i].kind != CONTINUED:
            _move(bodies[i], q, twist(bodies[i], i - 1, v), bodies[0].kind == ANY_NORM, out)


@inline
def difference(bodies: Bodies, q0: Config, q1: Config, out: Vector) -> None:
    """The v with q0 ∘ exp(v) = q1: the shortest, with angles in [-π, π], but q1 - q0 for the angle of a revolute joint.

    The angle of a planar joint counts modulo 2π: no twist both makes whole turns and travels.

    q0, q1  (nq)  [rad | m]
    out     (nv)  written [rad | m], twists in the body's frame
    """
    for i in range(1, len(bodies)):
        if bodies[i].kind != CONTINUED:
            put_twist(bodies[i], i - 1, _between(bodies[i], q0, q1, bodies[0].kind == ANY_NORM), out)


@inline
def interpolate(bodies: Bodies, q0: Config, q1: Config, t: Scalar, out: Config) -> None:
    """q0 ∘ exp(t v) with v the difference from q0 to q1: at t = 0 it is q0, at t = 1 q1 (a quaternion up to its sign).

    q0, q1  (nq)  [rad | m]
    t             any number; beyond [0, 1] the motion continues
    out     (nq)  written
    """
    for i in range(1, len(bodies)):
        if bodies[i].kind != CONTINUED:
            free = bodies[0].kind == ANY_NORM
            _move(bodies[i], q0, scale_motion(t, _between(bodies[i], q0, q1, free)), free, out)
            if free and bodies[i].kind in SO2:
                mix_pairs(q0, q1, bodies[i].q_index, t, out)


@inline
def dintegrate(bodies: Bodies, q: Config, v: Vector, out: Array) -> None:
    """Derivatives of q ∘ exp(v) by q, out[0], and by v, out[1], all as twists in the body's frame.

    q    (nq)          [rad | m], not used: the derivatives are the same at every q
    v    (nv)          velocity times duration [rad | m]
    out  (2, nv, nv)   written
    """
    _clear(out, len(bodies) - 1)
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if NV[b.kind] == 1:
            out[0, r, r] = 1.0
            out[1, r, r] = 1.0
        elif b.kind != CONTINUED:
            m = twist(b, r, v)
            put_tangent(b, r, inverse_adjoint(m), 1.0, out, 0)
            put_tangent(b, r, exp_jacobian(m), 1.0, out, 1)


@inline
def ddifference(bodies: Bodies, q0: Config, q1: Config, out: Array) -> None:
    """Derivatives of the difference from q0 to q1 by q0, out[0], and by q1, out[1], all as twists in the body's frame.

    q0, q1  (nq)         [rad | m]
    out     (2, nv, nv)  written
    """
    _clear(out, len(bodies) - 1)
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if NV[b.kind] == 1:
            out[0, r, r] = -1.0
            out[1, r, r] = 1.0
        elif b.kind != CONTINUED:
            m = _between(b, q0, q1, bodies[0].kind == ANY_NORM)
            put_tangent(b, r, log_jacobian(m, -1.0), -1.0, out, 0)
            put_tangent(b, r, log_jacobian(m, 1.0), 1.0, out, 1)


@inline
def displacement_rate_derivatives(bodies: Bodies, u: Vector, v: Vector, out: Array) -> None:
    """Derivatives of the rate u̇ = T(u) v of q(t) = q0 ∘ exp(u(t)) by u, out[0], and by v, out[1], which is T(u).

    T is the inverse of ``dintegrate``'s derivative by v, regular where no joint turns by 2π.

    u    (nv)          displacement [rad | m]
    v    (nv)          joint velocities [rad/s | m/s]
    out  (2, nv, nv)   written
    """
    _clear(out, len(bodies) - 1)
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if NV[b.kind] == 1:
            out[1, r, r] = 1.0
        elif b.kind != CONTINUED:
            m = twist(b, r, u)
            put_tangent(b, r, log_jacobian_times_derivative(m, twist(b, r, v)), 0.0, out, 0)
            put_tangent(b, r, log_jacobian(m, 1.0), 1.0, out, 1)


# --- one joint ------------------------------------------------------------------------------------------


@inline
def _move(b: Record, q: Config, m: Motion, free: bool, out: Config) -> None:
    """Write the coordinates of joint b after the twist m; ``free`` if they may have any norm."""
    k = b.q_index
    if b.kind in R1:
        out[k] = q[k] + m.w.z
    elif b.kind in SO2:
        if free:
            pull_pair(q, k, m.w.z, out)
        else:
            _turn_pair(q, k, m.w.z, out)
    elif b.kind in SO3:
        a = product(read_quat(q, k), exp_rotation(m.w))
        write_quat(out, pulled(a) if free else unit(a), k)
    elif b.kind in SE3:
        a, e = read_quat(q, k + 3), exp_rotation(m.w)
        write_vec(out, add(read_vec(q, k), rotate(matrix(a), exp_travel(m))), k)
        a = product(a, scale_quat(select(-e.w, -1.0, 1.0), e))
        write_quat(out, pulled(a) if free else unit(a), k + 3)
    elif b.kind in SE2:
        p = rotate(_heading(b, q), exp_travel(m))
        _put_pair(out, k, q[k] + p.x, q[k + 1] + p.y)
        if b.kind == PLANAR:
            out[k + 2] = q[k + 2] + m.w.z
        elif free:
            leave_pair(q, k + 2, m.w.z, out)
        else:
            _turn_pair(q, k + 2, m.w.z, out)


@inline
def _between(b: Record, q0: Config, q1: Config, free: bool) -> Motion:
    """The twist of joint b from q0 to q1; ``free`` if they may have any norm."""
    k = b.q_index
    if b.kind in SO2:
        return Motion(Vec(0.0, 0.0, free_angle(q0, q1, k) if free else _pair_angle(q0, q1, k)), zero())
    if b.kind in SO3:
        a = product(conjugate(read_quat(q0, k)), read_quat(q1, k))
        w = log_rotation(a)
        return Motion(scale(quat_norm(a), w) if free else w, zero())
    if b.kind in SE3:
        a = read_quat(q0, k + 3)
        p = unrotate(matrix(a), sub(read_vec(q1, k), read_vec(q0, k)))
        a = product(conjugate(a), read_quat(q1, k + 3))
        w = log_rotation(a)
        if free:
            return Motion(scale(quat_norm(a), w), free_travel(w, quat_norm(a), p))
        return Motion(w, log_travel(w, p))
    if b.kind in SE2:
        if b.kind == PLANAR:
            turned = q1[k + 2] - q0[k + 2]
            angle = atan2(sin(turned), cos(turned))
        else:
            angle = free_angle(q0, q1, k + 2) if free else _pair_angle(q0, q1, k + 2)
        w = Vec(0.0, 0.0, angle)
        return Motion(w, log_travel(w, unrotate(_heading(b, q0), Vec(q1[k] - q0[k], q1[k + 1] - q0[k + 1], 0.0))))
    return Motion(Vec(0.0, 0.0, q1[k] - q0[k]), zero())


@inline
def twist(b: Record, r: int, v: Vector) -> Motion:
    """The twist of the joint whose velocities start at v[r]."""
    if b.kind in SO3:
        return Motion(read_vec(v, r), zero())
    if b.kind in SE3:
        return Motion(read_vec(v, r + 3), read_vec(v, r))
    if b.kind in SE2:
        return Motion(Vec(0.0, 0.0, v[r + 2]), Vec(v[r], v[r + 1], 0.0))
    return Motion(Vec(0.0, 0.0, v[r]), zero())


@inline
def put_twist(b: Record, r: int, m: Motion, out: Vector) -> None:
    """Write the twist of the joint whose velocities start at out[r]."""
    if b.kind in SO3:
        write_vec(out, m.w, r)
    elif b.kind in SE3:
        write_vec(out, m.v, r)
        write_vec(out, m.w, r + 3)
    elif b.kind in SE2:
        _put_pair(out, r, m.v.x, m.v.y)
        out[r + 2] = m.w.z
    else:
        out[r] = m.w.z


@inline
def put_tangent(b: Record, r: int, T: Tangent, turn: float, out: Array, side: int) -> None:
    """Write the joint's part of [J K; 0 J]; ``turn`` is the exact J of an angle in the plane."""
    J, K = T.J, T.K
    if b.kind in SO3:
        _put_block(out, side, r, r, J)
    elif b.kind in SE3:
        _put_block(out, side, r, r, J)
        _put_block(out, side, r, r + 3, K)
        _put_block(out, side, r + 3, r + 3, J)
    else:
        out[side, r, r], out[side, r, r + 1], out[side, r, r + 2] = J.xx, J.xy, K.xz
        out[side, r + 1, r], out[side, r + 1, r + 1], out[side, r + 1, r + 2] = J.yx, J.yy, K.yz
        out[side, r + 2, r + 2] = turn


# --- pieces of arrays -----------------------------------------------------------------------------------


@inline
def _heading(b: Record, q: Config) -> Mat3:
    """The rotation of a planar joint, in its own x, y and normal."""
    k = b.q_index + 2
    if b.kind == PLANAR:
        c, s = cos(q[k]), sin(q[k])
    else:
        c, s = q[k], q[k + 1]
    return Mat3(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@inline
def _put_pair(out: Array, k: int, first: Scalar, second: Scalar) -> None:
    """Write out[k] and out[k+1]."""
    out[k], out[k + 1] = first, second


@inline
def _put_block(out: Array, side: int, r: int, c: int, A: Mat3) -> None:
    """Write out[side, r:r+3, c:c+3]."""
    out[side, r, c], out[side, r, c + 1], out[side, r, c + 2] = A.xx, A.xy, A.xz
    out[side, r + 1, c], out[side, r + 1, c + 1], out[side, r + 1, c + 2] = A.yx, A.yy, A.yz
    out[side, r + 2, c], out[side, r + 2, c + 1], out[side, r + 2, c + 2] = A.zx, A.zy, A.zz


@inline
def _clear(out: Array, n: int) -> None:
    """Zero out (2, n, n)."""
    for side in range(2):
        for r in range(n):
            for c in range(n):
                out[side, r, c] = 0.0


@inline
def _turn_pair(q: Config, k: int, angle: Scalar, out: Config) -> None:
    """Turn the (cos, sin) pair q[k], q[k+1] by an angle."""
    c, s = cos(angle), sin(angle)
    x, y = q[k] * c - q[k + 1] * s, q[k + 1] * c + q[k] * s
    factor = 1.0 / sqrt(x * x + y * y)
    _put_pair(out, k, factor * x, factor * y)


@inline
def _pair_angle(q0: Config, q1: Config, k: int) -> Scalar:
    """The angle from one (cos, sin) pair to another, in [-π, π]."""
    c0, s0, c1, s1 = q0[k], q0[k + 1], q1[k], q1[k + 1]
    return atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1)


_ANY_Q = Argument("q", ("nq",), "rad | m", "joint positions, of any norm but 0")
_STEP = Argument("v", ("nv",), "rad | m", "displacement: a velocity held for unit time, in each body's own frame")
_Q0 = Argument("q0", ("nq",), "rad | m", "joint positions to start from", unit_norm=True, moved_by="integrate")
_Q1 = Argument("q1", ("nq",), "rad | m", "joint positions to reach", unit_norm=True, moved_by="integrate")
_T = Argument("t", (), "1", "0 at q0, 1 at q1")
_Q_OUT = Argument("q", ("nq",), "rad | m", "joint positions", per_coordinate=True)
_NORMAL = Argument("unit", ("nq",), "rad | m", "joint positions of unit norm", unit_norm=True, per_coordinate=True)
_MOVED = Argument("moved", ("nq",), "rad | m", "joint positions", per_coordinate=True)
_LIE = "Sola, Deray, Atchuthan, A micro Lie theory for state estimation in robotics (2018), for the definitions."
SPECS = (
    Spec("neutral", neutral, None, (), _Q_OUT, "Configuration in which no joint is displaced.", "the definition."),
    Spec(
        "normalize", normalize, None, (_ANY_Q,), _NORMAL,
        "The configuration with its quaternions and (cos, sin) pairs scaled to unit norm.", "the definition.",
    ),
    Spec(
        "integrate", integrate, None, (Q, _STEP), _MOVED,
        "Configuration q ∘ exp(v) reached from q by the displacement v; for a velocity pass v dt.", _LIE,
    ),
    Spec(
        "difference", difference, None, (_Q0, _Q1),
        Argument("v", ("nv",), "rad | m", "the displacement", per_coordinate=True),
        "Displacement v from q0 to q1: integrate(q0, v) is q1; rotations take the shorter way.", _LIE,
    ),
    Spec(
        "interpolate", interpolate, None, (_Q0, _Q1, _T), _MOVED,
        "Configuration at the fraction t of the straight motion from q0 to q1.", _LIE,
    ),
    Spec(
        "dintegrate", dintegrate, None, (Q, _STEP),
        Argument("D", (2, "nv", "nv"), "1", "derivatives by q and by v, in the body frames", per_coordinate=True),
        "Derivatives of integrate(q, v) with respect to q and v: ``by_q, by_v = dintegrate(model, q, v)``.", _LIE,
    ),
    Spec(
        "ddifference", ddifference, None, (_Q0, _Q1),
        Argument("D", (2, "nv", "nv"), "1", "derivatives by q0 and by q1, in the body frames", per_coordinate=True),
        "Derivatives of difference(q0, q1) with respect to q0 and q1: ``by_q0, by_q1 = ddifference(model, q0, q1)``.",
        _LIE,
    ),
)  # fmt: skip
