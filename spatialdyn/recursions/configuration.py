"""The configuration space: moving along it, differences in it, and the derivatives of both.

A configuration q moves by a velocity v held for unit time, q ∘ exp(v): each joint's twist in its own body's frame,
as v itself is. Coordinates that are numbers add; quaternions and (cos, sin) pairs multiply on the right and come
back on the unit sphere, q/|q| to rounding, so no drift builds up. A joint of one freedom is a group too: its
displacement is carried as w.z of a twist, which lets every kind share ``twist``, ``_move`` and ``_between``, and
a planar joint's twist is written in its own x, y and normal.

Where the table takes coordinates of ANY_NORM, those off the unit sphere give what Pinocchio 4.1 makes of them: a
product is scaled by (3 - |q|²)/2, which is 1/|q| to first order, and a logarithm grows with |q|. Where Pinocchio has a
NaN there is a number here.

The exponentials and their derivatives are in ``lie``.

Row i of the table belongs to v[i - 1]; no array may overlap ``out``, and all of ``out`` is written.
"""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import Rot, Vec, cross, dot, minus, plus, rotate, times, unrotate, zero
from ..algebra.lie import (
    Quat,
    Tangent,
    carried_back,
    conjugate,
    exp_jacobian,
    exp_rotation,
    exp_travel,
    log_factors,
    log_jacobian,
    log_rotation,
    log_travel,
    matrix,
    product,
    rescaled,
    scale_quat,
    unit,
)
from ..algebra.scalars import Scalar, atan2, cos, inlined, select, sin, sqrt
from ..algebra.spatial import Motion, scale_motion
from ..bodies.table import ANY_NORM, FLOATING, FOLLOW, PLANAR, PLANAR_CS, PRISMATIC, REVOLUTE, REVOLUTE_CS, SPHERICAL
from .spec import Argument, Q, Spec


@inlined
def neutral(bodies: Any, out: Any) -> None:
    """The configuration in which no joint is displaced, out (nq)."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        k = b.at
        if b.kind == REVOLUTE or b.kind == PRISMATIC:
            out[k] = 0.0
        elif b.kind == REVOLUTE_CS:
            _put_pair(out, k, 1.0, 0.0)
        elif b.kind == SPHERICAL:
            _put_quat(out, k, Quat(0.0, 0.0, 0.0, 1.0))
        elif b.kind == FLOATING:
            _put_point(out, k, zero())
            _put_quat(out, k + 3, Quat(0.0, 0.0, 0.0, 1.0))
        elif b.kind == PLANAR:
            _put_point(out, k, zero())
        elif b.kind == PLANAR_CS:
            _put_pair(out, k, 0.0, 0.0)
            _put_pair(out, k + 2, 1.0, 0.0)


@inlined
def normalize(bodies: Any, q: Any, out: Any) -> None:
    """q with its quaternions and (cos, sin) pairs scaled to unit norm, whatever their size; null ones stay null.

    q    (nq)  [rad | m]
    out  (nq)  written
    """
    for i in range(1, len(bodies)):
        b = bodies[i]
        k = b.at
        if b.kind == REVOLUTE or b.kind == PRISMATIC:
            out[k] = q[k]
        elif b.kind == REVOLUTE_CS:
            a = rescaled(Quat(0.0, 0.0, q[k], q[k + 1]))
            _put_pair(out, k, a.z, a.w)
        elif b.kind == SPHERICAL:
            _put_quat(out, k, rescaled(_quat(q, k)))
        elif b.kind == FLOATING:
            _put_point(out, k, _point(q, k))
            _put_quat(out, k + 3, rescaled(_quat(q, k + 3)))
        elif b.kind == PLANAR:
            _put_point(out, k, _point(q, k))
        elif b.kind == PLANAR_CS:
            _put_pair(out, k, q[k], q[k + 1])
            a = rescaled(Quat(0.0, 0.0, q[k + 2], q[k + 3]))
            _put_pair(out, k + 2, a.z, a.w)


@inlined
def integrate(bodies: Any, q: Any, v: Any, out: Any) -> None:
    """out = q ∘ exp(v).

    Of the two quaternions ±a of the result a floating joint gets the one nearer to q's, a spherical joint the one
    that its motion leads to continuously (so does Pinocchio).

    q    (nq)  [rad | m]
    v    (nv)  velocity times duration [rad | m], twists in the body's frame
    out  (nq)  written
    """
    for i in range(1, len(bodies)):
        if bodies[i].kind != FOLLOW:
            _move(bodies[i], q, twist(bodies[i], i - 1, v), bodies[0].kind == ANY_NORM, out)


@inlined
def difference(bodies: Any, q0: Any, q1: Any, out: Any) -> None:
    """The v with q0 ∘ exp(v) = q1: the shortest, with angles in [-π, π], but q1 - q0 for the angle of a revolute joint.

    The angle of a planar joint counts modulo 2π: no twist turns by a whole number of turns and travels as well.

    q0, q1  (nq)  [rad | m]
    out     (nv)  written [rad | m], twists in the body's frame
    """
    for i in range(1, len(bodies)):
        if bodies[i].kind != FOLLOW:
            put_twist(bodies[i], i - 1, _between(bodies[i], q0, q1, bodies[0].kind == ANY_NORM), out)


@inlined
def interpolate(bodies: Any, q0: Any, q1: Any, t: Scalar, out: Any) -> None:
    """q0 ∘ exp(t v) with v the difference from q0 to q1: at t = 0 it is q0, at t = 1 q1 (a quaternion up to its sign).

    q0, q1  (nq)  [rad | m]
    t             a number, any; beyond [0, 1] the motion goes on
    out     (nq)  written
    """
    for i in range(1, len(bodies)):
        if bodies[i].kind != FOLLOW:
            free = bodies[0].kind == ANY_NORM
            _move(bodies[i], q0, scale_motion(t, _between(bodies[i], q0, q1, free)), free, out)
            if free and bodies[i].kind == REVOLUTE_CS:
                _mix_pairs(q0, q1, bodies[i].at, t, out)


@inlined
def dintegrate(bodies: Any, q: Any, v: Any, out: Any) -> None:
    """Derivatives of q ∘ exp(v) by q, out[0], and by v, out[1], all as twists in the body's frame.

    q    (nq)          [rad | m], without effect: the space looks the same everywhere
    v    (nv)          velocity times duration [rad | m]
    out  (2, nv, nv)   written
    """
    _clear(out, len(bodies) - 1)
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if _one_freedom(b):
            out[0, r, r] = 1.0
            out[1, r, r] = 1.0
        elif b.kind != FOLLOW:
            m = twist(b, r, v)
            _put_tangent(b, r, carried_back(m), 1.0, out, 0)
            _put_tangent(b, r, exp_jacobian(m), 1.0, out, 1)


@inlined
def ddifference(bodies: Any, q0: Any, q1: Any, out: Any) -> None:
    """Derivatives of the difference from q0 to q1 by q0, out[0], and by q1, out[1], all as twists in the body's frame.

    q0, q1  (nq)         [rad | m]
    out     (2, nv, nv)  written
    """
    _clear(out, len(bodies) - 1)
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if _one_freedom(b):
            out[0, r, r] = -1.0
            out[1, r, r] = 1.0
        elif b.kind != FOLLOW:
            m = _between(b, q0, q1, bodies[0].kind == ANY_NORM)
            _put_tangent(b, r, log_jacobian(m, -1.0), -1.0, out, 0)
            _put_tangent(b, r, log_jacobian(m, 1.0), 1.0, out, 1)


# --- one joint ------------------------------------------------------------------------------------------


@inlined
def _one_freedom(b: Any) -> bool:
    """Whether the joint that starts on row b has one freedom."""
    return b.kind in (REVOLUTE, PRISMATIC, REVOLUTE_CS)


@inlined
def _move(b: Any, q: Any, m: Motion, free: bool, out: Any) -> None:
    """The coordinates of joint b after the twist m; ``free`` of any norm."""
    k = b.at
    if b.kind == REVOLUTE or b.kind == PRISMATIC:
        out[k] = q[k] + m.w.z
    elif b.kind == REVOLUTE_CS:
        if free:
            _pull_pair(q, k, m.w.z, out)
        else:
            _turn_pair(q, k, m.w.z, out)
    elif b.kind == SPHERICAL:
        a = product(_quat(q, k), exp_rotation(m.w))
        _put_quat(out, k, _pulled(a) if free else unit(a))
    elif b.kind == FLOATING:
        a, e = _quat(q, k + 3), exp_rotation(m.w)
        _put_point(out, k, plus(_point(q, k), rotate(matrix(a), exp_travel(m))))
        a = product(a, scale_quat(select(-e.w, -1.0, 1.0), e))
        _put_quat(out, k + 3, _pulled(a) if free else unit(a))
    elif b.kind == PLANAR or b.kind == PLANAR_CS:
        p = rotate(_heading(b, q), exp_travel(m))
        _put_pair(out, k, q[k] + p.x, q[k + 1] + p.y)
        if b.kind == PLANAR:
            out[k + 2] = q[k + 2] + m.w.z
        elif free:
            _leave_pair(q, k + 2, m.w.z, out)
        else:
            _turn_pair(q, k + 2, m.w.z, out)


@inlined
def _between(b: Any, q0: Any, q1: Any, free: bool) -> Motion:
    """The twist of joint b from q0 to q1; ``free`` of any norm."""
    k = b.at
    if b.kind == REVOLUTE_CS:
        return Motion(Vec(0.0, 0.0, _free_angle(q0, q1, k) if free else _pair_angle(q0, q1, k)), zero())
    if b.kind == SPHERICAL:
        a = product(conjugate(_quat(q0, k)), _quat(q1, k))
        w = log_rotation(a)
        return Motion(times(_norm(a), w) if free else w, zero())
    if b.kind == FLOATING:
        a = _quat(q0, k + 3)
        p = unrotate(matrix(a), minus(_point(q1, k), _point(q0, k)))
        a = product(conjugate(a), _quat(q1, k + 3))
        w = log_rotation(a)
        if free:
            return Motion(times(_norm(a), w), _free_travel(w, _norm(a), p))
        return Motion(w, log_travel(w, p))
    if b.kind == PLANAR or b.kind == PLANAR_CS:
        if b.kind == PLANAR:
            turned = q1[k + 2] - q0[k + 2]
            angle = atan2(sin(turned), cos(turned))
        else:
            angle = _free_angle(q0, q1, k + 2) if free else _pair_angle(q0, q1, k + 2)
        w = Vec(0.0, 0.0, angle)
        return Motion(w, log_travel(w, unrotate(_heading(b, q0), Vec(q1[k] - q0[k], q1[k + 1] - q0[k + 1], 0.0))))
    return Motion(Vec(0.0, 0.0, q1[k] - q0[k]), zero())


@inlined
def twist(b: Any, r: int, v: Any) -> Motion:
    """The twist of the joint whose velocities start at v[r]."""
    if b.kind == SPHERICAL:
        return Motion(_point(v, r), zero())
    if b.kind == FLOATING:
        return Motion(_point(v, r + 3), _point(v, r))
    if b.kind == PLANAR or b.kind == PLANAR_CS:
        return Motion(Vec(0.0, 0.0, v[r + 2]), Vec(v[r], v[r + 1], 0.0))
    return Motion(Vec(0.0, 0.0, v[r]), zero())


@inlined
def put_twist(b: Any, r: int, m: Motion, out: Any) -> None:
    """Write the twist of the joint whose velocities start at out[r]."""
    if b.kind == SPHERICAL:
        _put_point(out, r, m.w)
    elif b.kind == FLOATING:
        _put_point(out, r, m.v)
        _put_point(out, r + 3, m.w)
    elif b.kind == PLANAR or b.kind == PLANAR_CS:
        _put_pair(out, r, m.v.x, m.v.y)
        out[r + 2] = m.w.z
    else:
        out[r] = m.w.z


@inlined
def _put_tangent(b: Any, r: int, T: Tangent, turn: float, out: Any, side: int) -> None:
    """Write what the joint has of [J K; 0 J]; ``turn`` is what J is for an angle in the plane, exactly."""
    J, K = T.J, T.K
    if b.kind == SPHERICAL:
        _put_block(out, side, r, r, J)
    elif b.kind == FLOATING:
        _put_block(out, side, r, r, J)
        _put_block(out, side, r, r + 3, K)
        _put_block(out, side, r + 3, r + 3, J)
    else:
        out[side, r, r], out[side, r, r + 1], out[side, r, r + 2] = J.xx, J.xy, K.xz
        out[side, r + 1, r], out[side, r + 1, r + 1], out[side, r + 1, r + 2] = J.yx, J.yy, K.yz
        out[side, r + 2, r + 2] = turn


# --- pieces of arrays -----------------------------------------------------------------------------------


@inlined
def _point(q: Any, k: int) -> Vec:
    """Three numbers from place k."""
    return Vec(q[k], q[k + 1], q[k + 2])


@inlined
def _quat(q: Any, k: int) -> Quat:
    """The quaternion at place k."""
    return Quat(q[k], q[k + 1], q[k + 2], q[k + 3])


@inlined
def _heading(b: Any, q: Any) -> Rot:
    """The rotation of a planar joint, in its own x, y and normal."""
    k = b.at + 2
    if b.kind == PLANAR:
        c, s = cos(q[k]), sin(q[k])
    else:
        c, s = q[k], q[k + 1]
    return Rot(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@inlined
def _put_point(out: Any, k: int, p: Vec) -> None:
    """Write three numbers from place k."""
    out[k], out[k + 1], out[k + 2] = p.x, p.y, p.z


@inlined
def _put_pair(out: Any, k: int, first: Scalar, second: Scalar) -> None:
    """Write two numbers from place k."""
    out[k], out[k + 1] = first, second


@inlined
def _put_quat(out: Any, k: int, a: Quat) -> None:
    """Write the quaternion at place k."""
    out[k], out[k + 1], out[k + 2], out[k + 3] = a.x, a.y, a.z, a.w


@inlined
def _put_block(out: Any, side: int, r: int, c: int, A: Rot) -> None:
    """Write out[side, r:r+3, c:c+3]."""
    out[side, r, c], out[side, r, c + 1], out[side, r, c + 2] = A.xx, A.xy, A.xz
    out[side, r + 1, c], out[side, r + 1, c + 1], out[side, r + 1, c + 2] = A.yx, A.yy, A.yz
    out[side, r + 2, c], out[side, r + 2, c + 1], out[side, r + 2, c + 2] = A.zx, A.zy, A.zz


@inlined
def _clear(out: Any, n: int) -> None:
    """Zero out (2, n, n)."""
    for side in range(2):
        for r in range(n):
            for c in range(n):
                out[side, r, c] = 0.0


@inlined
def _turn_pair(q: Any, k: int, angle: Scalar, out: Any) -> None:
    """Turn the (cos, sin) pair at place k by an angle."""
    c, s = cos(angle), sin(angle)
    x, y = q[k] * c - q[k + 1] * s, q[k + 1] * c + q[k] * s
    scale = 1.0 / sqrt(x * x + y * y)
    _put_pair(out, k, scale * x, scale * y)


@inlined
def _pair_angle(q0: Any, q1: Any, k: int) -> Scalar:
    """The angle from one (cos, sin) pair to another, in [-π, π]."""
    c0, s0, c1, s1 = q0[k], q0[k + 1], q1[k], q1[k + 1]
    return atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1)


# --- off the unit sphere, as Pinocchio 4.1 has it ---------------------------------------------------------

OFF = 1e-12  # squared norms that differ from 1 by less are rounding, and the exact formulas hold


@inlined
def _on(square: Scalar) -> Scalar:
    """Positive where a squared norm is 1 to rounding."""
    return OFF - select(square - 1.0, square - 1.0, 1.0 - square)


@inlined
def _norm(a: Quat) -> Scalar:
    """|a|; 1 where it is that to rounding."""
    n = a.x * a.x + a.y * a.y + a.z * a.z + a.w * a.w
    return select(_on(n), 1.0, sqrt(n))


@inlined
def _free_travel(w: Vec, n: Scalar, p: Vec) -> Vec:
    """``log_travel`` of the rotation vector w of a quaternion of norm n, which stands for n w and u for n² u."""
    t = dot(w, w)
    u, beta = log_factors(t)
    turns = t - 1.5e-8  # Pinocchio's series for θ < 1.2e-4 knows of no norm
    u = select(turns, n * n * u, u)
    off = select(_on(n * n), -1.0, turns)
    beta = select(off, (1.0 - u) / select(off, n * n * t, 1.0), beta)
    w = times(n, w)
    return plus(plus(times(u, p), times(-0.5, cross(w, p))), times(beta * dot(w, p), w))


@inlined
def _pulled(a: Quat) -> Quat:
    """a (3 - |a|²)/2: on the unit sphere to first order."""
    return scale_quat(0.5 * (3.0 - (a.x * a.x + a.y * a.y + a.z * a.z + a.w * a.w)), a)


@inlined
def _pull_pair(q: Any, k: int, angle: Scalar, out: Any) -> None:
    """Turn the (cos, sin) pair at place k by an angle, and scale it in that way."""
    c, s = cos(angle), sin(angle)
    x, y = q[k] * c - q[k + 1] * s, q[k + 1] * c + q[k] * s
    scale = 0.5 * (3.0 - (x * x + y * y))
    _put_pair(out, k, scale * x, scale * y)


@inlined
def _leave_pair(q: Any, k: int, angle: Scalar, out: Any) -> None:
    """Turn the pair at place k by an angle; one off the unit circle keeps its norm."""
    c, s = cos(angle), sin(angle)
    x, y = q[k] * c - q[k + 1] * s, q[k + 1] * c + q[k] * s
    n = x * x + y * y
    on = _on(n)
    scale = 1.0 / sqrt(select(on, n, 1.0))
    _put_pair(out, k, scale * x, scale * y)


@inlined
def _free_angle(q0: Any, q1: Any, k: int) -> Scalar:
    """The angle from one pair to another by their products c = q0 · q1 and s = q0 × q1.

    Off the unit circle 0 where c > 1, ±π where c < -1, the arc sine of s where c > 0.995, else the arc cosine of c.
    """
    c0, s0, c1, s1 = q0[k], q0[k + 1], q1[k], q1[k + 1]
    c, s = c0 * c1 + s0 * s1, c0 * s1 - s0 * c1
    sign, x, y = select(s, 1.0, -1.0), 1.0 - c * c, 1.0 - s * s
    sign = select(-s, sign, 1.0)
    by_cosine = sign * atan2(sqrt(select(x, x, 0.0)), c)  # 0 or π beyond [-1, 1]
    by_sine = atan2(s, sqrt(select(y, y, 0.0)))
    angle = select(select(c - 0.995, 1.0 - c, -1.0), by_sine, by_cosine)
    return select(_on(c * c + s * s), atan2(s, c), angle)


@inlined
def _mix_pairs(q0: Any, q1: Any, k: int, t: Scalar, out: Any) -> None:
    """Between pairs off the unit circle: their sum, weighted by sines of parts of the angle between them."""
    c0, s0, c1, s1 = q0[k], q0[k + 1], q1[k], q1[k + 1]
    c, s = c0 * c1 + s0 * s1, c0 * s1 - s0 * c1
    angle = atan2(s, c)
    size = select(angle, angle, -angle)
    apart = size - 1e-6
    safe = select(apart, s, 1.0)
    a, b = select(apart, sin((1.0 - t) * angle) / safe, 1.0 - t), select(apart, sin(t * angle) / safe, t)
    x, y = a * c0 + b * c1, a * s0 + b * s1
    back = size - (3.141592653589793 - 1e-6)  # half a turn: it stays where it was
    x, y = select(back, c0, x), select(back, s0, y)
    on = _on(c * c + s * s)
    _put_pair(out, k, select(on, out[k], x), select(on, out[k + 1], y))


_ANY_Q = Argument("q", ("nq",), "rad | m", "joint positions, of any norm but 0")
_STEP = Argument("v", ("nv",), "rad | m", "displacement: a velocity held for unit time, in each body's own frame")
_Q0 = Argument("q0", ("nq",), "rad | m", "joint positions to start from", unit_norm=True)
_Q1 = Argument("q1", ("nq",), "rad | m", "joint positions to reach", unit_norm=True)
_T = Argument("t", (), "1", "0 at q0, 1 at q1")
_Q_OUT = Argument("q", ("nq",), "rad | m", "joint positions", free=True)
_NORMAL = Argument("unit", ("nq",), "rad | m", "joint positions of unit norm", unit_norm=True, free=True)
_MOVED = Argument("moved", ("nq",), "rad | m", "joint positions", free=True)
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
        Argument("v", ("nv",), "rad | m", "the displacement", free=True),
        "Displacement v that takes q0 to q1: integrate(q0, v) is q1, by the shorter way round.", _LIE,
    ),
    Spec(
        "interpolate", interpolate, None, (_Q0, _Q1, _T), _MOVED,
        "Configuration a part t of the way from q0 to q1 along the straight motion between them.", _LIE,
    ),
    Spec(
        "dintegrate", dintegrate, None, (Q, _STEP),
        Argument("D", (2, "nv", "nv"), "1", "derivatives by q and by v, in the body frames", free=True),
        "Derivatives of integrate(q, v) by q and by v: ``by_q, by_v = dintegrate(model, q, v)``.", _LIE,
    ),
    Spec(
        "ddifference", ddifference, None, (_Q0, _Q1),
        Argument("D", (2, "nv", "nv"), "1", "derivatives by q0 and by q1, in the body frames", free=True),
        "Derivatives of difference(q0, q1) by q0 and by q1: ``by_q0, by_q1 = ddifference(model, q0, q1)``.", _LIE,
    ),
)  # fmt: skip
