"""Canonical coordinates (x, π) of a robot whose velocities are no rates of coordinates.

The momenta p = M v belong to the velocities v, and where these are twists in a body's frame (spherical, floating and
planar joints) the symplectic form Ω in (q, p) is not the standard one: with θ the forms dual to the v it is
Ω = Σ θ_i ∧ dp_i - p_i dθ_i, which pairs X_i with X_j to p_m c^m_ij, and {p_i, p_j} = -c^m_ij p_m with c the structure
constants of the joint's group, [X_i, X_j] = c^m_ij X_m. A method that is symplectic in linear coordinates is so for a
robot only in coordinates in which Ω is Σ dx_i ∧ dπ_i. Per joint

one freedom  x = q, or the angle of a (cos, sin) pair         π = p
rotation     R = centre exp(x),  ω = B(x) ẋ                    π = Bᵀ p,  π̇ = Bᵀ ṗ + Ḃᵀ p
floating     the position in the world and the rotation;       π = R p_lin and as above,  π̇ = R (ṗ_lin + ω × p_lin)
planar       the position in the plane, not turned, and the angle, likewise

with B the right Jacobian of the exponential. ṗ = Cᵀ v + τ - g is the true rate of p, so the chain rule is all it takes.

The map from (q, p) to (x, π) must not depend on the state continuously: a new chart at every step, centred where the
step begins, breaks symplecticity. A centre is one of the 24 Hurwitz quaternions, which leave no rotation farther than
90° from the nearest, and it is kept until the rotation has come to more than FAR from it.

A row of ``z`` holds x (nv) and π (nv), one after the other. Derived here from the definitions.
"""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import Rot, Vec, cross, dot, plus, rotate, times, unrotate, zero
from ..algebra.lie import (
    Quat,
    conjugate,
    exp_jacobian,
    exp_rotation,
    log_factors,
    log_rotation,
    matrix,
    mixed,
    product,
    unit,
)
from ..algebra.scalars import atan2, cos, inlined, sin
from ..algebra.spatial import Motion
from ..bodies.table import FLOATING, FOLLOW, PLANAR, PLANAR_CS, REVOLUTE_CS, SPHERICAL

FAR = 4.84  # 2.2² [rad²]: well beyond the 90° of a fresh chart, well before the 2π where the exponential folds
OK, MOVED = 0, 1


@inlined
def enter(bodies: Any, centres: Any, q: Any, p: Any, z: Any) -> int:
    """z of the state (q, p), in the charts whose centres are nearest, which are written."""
    n = len(bodies) - 1
    for i in range(1, len(bodies)):
        b = bodies[i]
        r, k = i - 1, b.at
        if b.kind == FOLLOW:
            continue
        if b.kind == SPHERICAL:
            _enter_rotation(centres, i, _quat(q, k), p, r, z, r, n)
        elif b.kind == FLOATING:
            a = _quat(q, k + 3)
            _put(z, r, _vec(q, k))
            _put(z, n + r, rotate(matrix(a), _vec(p, r)))
            _enter_rotation(centres, i, a, p, r + 3, z, r + 3, n)
        elif b.kind == PLANAR or b.kind == PLANAR_CS:
            angle = q[k + 2] if b.kind == PLANAR else atan2(q[k + 3], q[k + 2])
            f = rotate(_about_normal(angle), Vec(p[r], p[r + 1], 0.0))
            z[r], z[r + 1], z[r + 2] = q[k], q[k + 1], angle
            z[n + r], z[n + r + 1], z[n + r + 2] = f.x, f.y, p[r + 2]
        else:
            z[r] = atan2(q[k + 1], q[k]) if b.kind == REVOLUTE_CS else q[k]
            z[n + r] = p[r]
    return OK


@inlined
def leave(bodies: Any, centres: Any, z: Any, q: Any, p: Any) -> int:
    """The state (q, p) of z."""
    n = len(bodies) - 1
    for i in range(1, len(bodies)):
        b = bodies[i]
        r, k = i - 1, b.at
        if b.kind == FOLLOW:
            continue
        if b.kind == SPHERICAL:
            _put_quat(q, k, unit(product(_quat(centres[i], 0), exp_rotation(_vec(z, r)))))
            _put(p, r, unrotate(_inverse(_vec(z, r)), _vec(z, n + r)))
        elif b.kind == FLOATING:
            a = unit(product(_quat(centres[i], 0), exp_rotation(_vec(z, r + 3))))
            _put(q, k, _vec(z, r))
            _put_quat(q, k + 3, a)
            _put(p, r, unrotate(matrix(a), _vec(z, n + r)))
            _put(p, r + 3, unrotate(_inverse(_vec(z, r + 3)), _vec(z, n + r + 3)))
        elif b.kind == PLANAR or b.kind == PLANAR_CS:
            angle = z[r + 2]
            f = unrotate(_about_normal(angle), Vec(z[n + r], z[n + r + 1], 0.0))
            q[k], q[k + 1] = z[r], z[r + 1]
            p[r], p[r + 1], p[r + 2] = f.x, f.y, z[n + r + 2]
            if b.kind == PLANAR:
                q[k + 2] = angle
            else:
                q[k + 2], q[k + 3] = cos(angle), sin(angle)
        else:
            if b.kind == REVOLUTE_CS:
                q[k], q[k + 1] = cos(z[r]), sin(z[r])
            else:
                q[k] = z[r]
            p[r] = z[n + r]
    return OK


@inlined
def chart_rate(bodies: Any, centres: Any, z: Any, p: Any, v: Any, dp: Any, dz: Any) -> int:
    """ż where the joints move with v and their momenta p change by dp."""
    n = len(bodies) - 1
    for i in range(1, len(bodies)):
        b = bodies[i]
        r = i - 1
        if b.kind == FOLLOW:
            continue
        if b.kind == SPHERICAL:
            _rotation_rate(z, p, v, dp, r, dz, n)
        elif b.kind == FLOATING:
            R = matrix(product(_quat(centres[i], 0), exp_rotation(_vec(z, r + 3))))
            _put(dz, r, rotate(R, _vec(v, r)))
            _put(dz, n + r, rotate(R, plus(_vec(dp, r), cross(_vec(v, r + 3), _vec(p, r)))))
            _rotation_rate(z, p, v, dp, r + 3, dz, n)
        elif b.kind == PLANAR or b.kind == PLANAR_CS:
            R = _about_normal(z[r + 2])
            w = v[r + 2]
            u = rotate(R, Vec(v[r], v[r + 1], 0.0))
            f = rotate(R, Vec(dp[r] - w * p[r + 1], dp[r + 1] + w * p[r], 0.0))
            dz[r], dz[r + 1], dz[r + 2] = u.x, u.y, w
            dz[n + r], dz[n + r + 1], dz[n + r + 2] = f.x, f.y, dp[r + 2]
        else:
            dz[r] = v[r]
            dz[n + r] = dp[r]
    return OK


@inlined
def recentre(bodies: Any, centres: Any, z: Any, p: Any) -> int:
    """Give rotations that have come far from their centre a nearer one; MOVED if any has. p is scratch."""
    n = len(bodies) - 1
    status = OK
    for i in range(1, len(bodies)):
        kind = bodies[i].kind
        if kind in (SPHERICAL, FLOATING):
            r = i - 1 if kind == SPHERICAL else i + 2
            x = _vec(z, r)
            if dot(x, x) > FAR:
                a = unit(product(_quat(centres[i], 0), exp_rotation(x)))
                _put(p, r, unrotate(_inverse(x), _vec(z, n + r)))
                _enter_rotation(centres, i, a, p, r, z, r, n)
                status = MOVED
    return status


# --- one rotation ---------------------------------------------------------------------------------------


@inlined
def _enter_rotation(centres: Any, i: int, a: Quat, p: Any, at: int, z: Any, r: int, n: int) -> None:
    """Chart of rotation a with momentum p[at:at+3] in the body's frame."""
    c = nearest(a)
    _put_quat(centres[i], 0, c)
    x = log_rotation(product(conjugate(c), a))
    _put(z, r, x)
    _put(z, n + r, unrotate(exp_jacobian(Motion(x, zero())).J, _vec(p, at)))


@inlined
def _rotation_rate(z: Any, p: Any, v: Any, dp: Any, r: int, dz: Any, n: int) -> None:
    """ẋ = B⁻¹ ω and π̇ = Bᵀ ṗ + Ḃᵀ p."""
    x = _vec(z, r)
    rate = rotate(_inverse(x), _vec(v, r))
    B = exp_jacobian(Motion(x, rate))
    _put(dz, r, rate)
    _put(dz, n + r, plus(unrotate(B.J, _vec(dp, r)), unrotate(B.K, _vec(p, r))))


@inlined
def nearest(a: Quat) -> Quat:
    """The Hurwitz unit nearest to a unit quaternion: ±1, ±i, ±j, ±k or (±1 ±i ±j ±k)/2; of equals any."""
    x, y, z, w = abs(a.x), abs(a.y), abs(a.z), abs(a.w)
    half = 0.5 * (x + y + z + w)
    if half > max(max(x, y), max(z, w)):
        return Quat(_signed(0.5, a.x), _signed(0.5, a.y), _signed(0.5, a.z), _signed(0.5, a.w))
    if x >= y and x >= z and x >= w:
        return Quat(_signed(1.0, a.x), 0.0, 0.0, 0.0)
    if y >= z and y >= w:
        return Quat(0.0, _signed(1.0, a.y), 0.0, 0.0)
    if z >= w:
        return Quat(0.0, 0.0, _signed(1.0, a.z), 0.0)
    return Quat(0.0, 0.0, 0.0, _signed(1.0, a.w))


@inlined
def _signed(size: float, like: float) -> float:
    return size if like >= 0.0 else -size


@inlined
def _inverse(x: Vec) -> Rot:
    """B⁻¹ at x, |x| < 2π."""
    u, beta = log_factors(dot(x, x))
    return mixed(u, times(0.5, x), x, times(0.5 * beta, x))


@inlined
def _about_normal(angle: float) -> Rot:
    """The rotation of a planar joint."""
    c, s = cos(angle), sin(angle)
    return Rot(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@inlined
def _vec(x: Any, k: int) -> Vec:
    return Vec(x[k], x[k + 1], x[k + 2])


@inlined
def _put(x: Any, k: int, a: Vec) -> None:
    x[k], x[k + 1], x[k + 2] = a.x, a.y, a.z


@inlined
def _quat(x: Any, k: int) -> Quat:
    return Quat(x[k], x[k + 1], x[k + 2], x[k + 3])


@inlined
def _put_quat(x: Any, k: int, a: Quat) -> None:
    x[k], x[k + 1], x[k + 2], x[k + 3] = a.x, a.y, a.z, a.w
