"""Canonical coordinates (x, π) of a robot whose velocities v are not q̇.

The momenta p = M v belong to the velocities v, and if these are twists in a body's frame (spherical, floating and
planar joints) the symplectic form Ω in (q, p) is not the standard one: with θ the forms dual to v it is
Ω = Σ θ_i ∧ dp_i - p_i dθ_i, which pairs X_i with X_j to p_m c^m_ij, and {p_i, p_j} = -c^m_ij p_m with c the structure
constants of the joint's group, [X_i, X_j] = c^m_ij X_m. A method that is symplectic in linear coordinates is symplectic
for a robot only in coordinates with Ω = Σ dx_i ∧ dπ_i. Per joint

one freedom  x = q, or the angle of a (cos, sin) pair         π = p
rotation     R = centre exp(x),  ω = B(x) ẋ                    π = Bᵀ p,  π̇ = Bᵀ ṗ + Ḃᵀ p
floating     the position in the world and the rotation;       π = R p_lin and as above,  π̇ = R (ṗ_lin + ω × p_lin)
planar       the position in the plane's fixed axes and the angle; likewise

with B the right Jacobian of the exponential. ṗ = Cᵀ v + τ - g is the true rate of p; the rest is the chain rule.

The map from (q, p) to (x, π) must not depend on the state continuously: a new chart at every step, centred at the
beginning of the step, would not be symplectic. A centre is therefore one of the 24 Hurwitz quaternions, one of which is
within 90° of any rotation; a chart keeps its centre until the rotation is more than FAR from it.

A row of ``z`` holds x (nv), then π (nv). Derived here from the definitions.
"""

from __future__ import annotations

from ...algebra.euclidean import Mat3, Vec, add, cross, dot, rotate, scale, unrotate, zero
from ...algebra.lie import (
    Quat,
    conjugate,
    exp_jacobian,
    exp_rotation,
    larger,
    log_factors,
    log_rotation,
    matrix,
    mixed,
    product,
    unit,
)
from ...algebra.public_arrays import read_quat, read_vec, write_quat, write_vec
from ...algebra.scalars import Scalar, atan2, cos, inline, select, sin
from ...algebra.spatial import Motion
from ...bodies.kinds import CONTINUED, LENGTHS, PLANAR, SE2, SE3, SO2, SO3
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec
from .hamilton import WORK, P, hamilton_rows

FAR = 4.84  # 2.2² [rad²]: well beyond the 90° of a new chart, well before 2π, where exp is singular
OK = 0


@inline
def to_canonical(bodies: Bodies, centres: Matrix, q: Config, p: Vector, z: Vector) -> int:
    """z of the state (q, p) in the charts of the nearest centres, which are written too."""
    n = len(bodies) - 1
    for i in range(1, len(bodies)):
        b = bodies[i]
        r, k = i - 1, b.q_index
        if b.kind == CONTINUED:
            continue
        if b.kind in SO3:
            _rotation_to_canonical(centres, i, read_quat(q, k), p, r, z, r, n)
        elif b.kind in SE3:
            a = read_quat(q, k + 3)
            write_vec(z, read_vec(q, k), r)
            write_vec(z, rotate(matrix(a), read_vec(p, r)), n + r)
            _rotation_to_canonical(centres, i, a, p, r + 3, z, r + 3, n)
        elif b.kind in SE2:
            angle = q[k + 2] if b.kind == PLANAR else atan2(q[k + 3], q[k + 2])
            f = rotate(_about_normal(angle), Vec(p[r], p[r + 1], 0.0))
            z[r], z[r + 1], z[r + 2] = q[k], q[k + 1], angle
            z[n + r], z[n + r + 1], z[n + r + 2] = f.x, f.y, p[r + 2]
        else:
            z[r] = atan2(q[k + 1], q[k]) if b.kind in SO2 else q[k]
            z[n + r] = p[r]
    return OK


@inline
def from_canonical(bodies: Bodies, centres: Matrix, z: Vector, q: Config, p: Vector) -> int:
    """The state (q, p) of z."""
    n = len(bodies) - 1
    for i in range(1, len(bodies)):
        b = bodies[i]
        r, k = i - 1, b.q_index
        if b.kind == CONTINUED:
            continue
        if b.kind in SO3:
            write_quat(q, unit(product(read_quat(centres[i]), exp_rotation(read_vec(z, r)))), k)
            write_vec(p, unrotate(_inverse(read_vec(z, r)), read_vec(z, n + r)), r)
        elif b.kind in SE3:
            a = unit(product(read_quat(centres[i]), exp_rotation(read_vec(z, r + 3))))
            write_vec(q, read_vec(z, r), k)
            write_quat(q, a, k + 3)
            write_vec(p, unrotate(matrix(a), read_vec(z, n + r)), r)
            write_vec(p, unrotate(_inverse(read_vec(z, r + 3)), read_vec(z, n + r + 3)), r + 3)
        elif b.kind in SE2:
            angle = z[r + 2]
            f = unrotate(_about_normal(angle), Vec(z[n + r], z[n + r + 1], 0.0))
            q[k], q[k + 1] = z[r], z[r + 1]
            p[r], p[r + 1], p[r + 2] = f.x, f.y, z[n + r + 2]
            if b.kind == PLANAR:
                q[k + 2] = angle
            else:
                q[k + 2], q[k + 3] = cos(angle), sin(angle)
        else:
            if b.kind in SO2:
                q[k], q[k + 1] = cos(z[r]), sin(z[r])
            else:
                q[k] = z[r]
            p[r] = z[n + r]
    return OK


@inline
def chart_rate(bodies: Bodies, centres: Matrix, z: Vector, p: Vector, v: Vector, dp: Vector, dz: Vector) -> int:
    """ż of joint velocities v and momentum rates dp."""
    n = len(bodies) - 1
    for i in range(1, len(bodies)):
        b = bodies[i]
        r = i - 1
        if b.kind == CONTINUED:
            continue
        if b.kind in SO3:
            _rotation_rate(z, p, v, dp, r, dz, n)
        elif b.kind in SE3:
            R = matrix(product(read_quat(centres[i]), exp_rotation(read_vec(z, r + 3))))
            write_vec(dz, rotate(R, read_vec(v, r)), r)
            write_vec(dz, rotate(R, add(read_vec(dp, r), cross(read_vec(v, r + 3), read_vec(p, r)))), n + r)
            _rotation_rate(z, p, v, dp, r + 3, dz, n)
        elif b.kind in SE2:
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


@inline
def recenter(bodies: Bodies, centres: Matrix, z: Vector, p: Vector) -> Scalar:
    """Move each rotation that is FAR from its centre to the nearest one; returns 1 if any moved, else 0. p is scratch.

    z, centres  written in place
    """
    n = len(bodies) - 1
    moved = 0.0
    for i in range(1, len(bodies)):
        kind = bodies[i].kind
        if kind in SO3 or kind in SE3:
            r = i - 1 + LENGTHS[kind]
            x, pi, old = read_vec(z, r), read_vec(z, n + r), read_quat(centres[i])
            far = dot(x, x) - FAR
            a = unit(product(old, exp_rotation(x)))
            write_vec(p, unrotate(_inverse(x), pi), r)
            _rotation_to_canonical(centres, i, a, p, r, z, r, n)
            write_quat(centres[i], _chosen_quat(far, read_quat(centres[i]), old))
            write_vec(z, _chosen(far, read_vec(z, r), x), r)
            write_vec(z, _chosen(far, read_vec(z, n + r), pi), n + r)
            moved = select(far, 1.0, moved)
    return moved


# --- one rotation ---------------------------------------------------------------------------------------


@inline
def _rotation_to_canonical(centres: Matrix, i: int, a: Quat, p: Vector, at: int, z: Vector, r: int, n: int) -> None:
    """Chart of rotation a with momentum p[at:at+3] in the body's frame."""
    c = nearest(a)
    write_quat(centres[i], c)
    x = log_rotation(product(conjugate(c), a))
    write_vec(z, x, r)
    write_vec(z, unrotate(exp_jacobian(Motion(x, zero())).J, read_vec(p, at)), n + r)


@inline
def _rotation_rate(z: Vector, p: Vector, v: Vector, dp: Vector, r: int, dz: Vector, n: int) -> None:
    """ẋ = B⁻¹ ω and π̇ = Bᵀ ṗ + Ḃᵀ p."""
    x = read_vec(z, r)
    rate = rotate(_inverse(x), read_vec(v, r))
    B = exp_jacobian(Motion(x, rate))
    write_vec(dz, rate, r)
    write_vec(dz, add(unrotate(B.J, read_vec(dp, r)), unrotate(B.K, read_vec(p, r))), n + r)


@inline
def nearest(a: Quat) -> Quat:
    """The Hurwitz unit nearest to a unit quaternion: ±1, ±i, ±j, ±k or (±1 ±i ±j ±k)/2; if several, any of them."""
    x, y, z, w = select(-a.x, -a.x, a.x), select(-a.y, -a.y, a.y), select(-a.z, -a.z, a.z), select(-a.w, -a.w, a.w)
    most = larger(larger(x, y), larger(z, w))
    half = 0.5 * (x + y + z + w) - most  # above 0: (±1 ±i ±j ±k)/2 is nearest
    is_x = select(most - x, 0.0, 1.0)
    is_y = select(most - y, 0.0, 1.0 - is_x)
    is_z = select(most - z, 0.0, 1.0 - is_x - is_y)
    is_w = 1.0 - is_x - is_y - is_z
    return Quat(_part(half, is_x, a.x), _part(half, is_y, a.y), _part(half, is_z, a.z), _part(half, is_w, a.w))


@inline
def _part(half: Scalar, alone: Scalar, like: Scalar) -> Scalar:
    """An entry: ±1/2 if half > 0, else ±1 if alone > 0, else 0, with the sign of ``like``."""
    size = select(half, 0.5, alone)
    return select(-like, -size, size)


@inline
def _chosen(x: Scalar, a: Vec, b: Vec) -> Vec:
    """a where x is above 0, else b."""
    return Vec(select(x, a.x, b.x), select(x, a.y, b.y), select(x, a.z, b.z))


@inline
def _chosen_quat(x: Scalar, a: Quat, b: Quat) -> Quat:
    """a where x is above 0, else b."""
    return Quat(select(x, a.x, b.x), select(x, a.y, b.y), select(x, a.z, b.z), select(x, a.w, b.w))


@inline
def _inverse(x: Vec) -> Mat3:
    """B⁻¹ at x, |x| < 2π."""
    u, beta = log_factors(dot(x, x))
    return mixed(u, scale(0.5, x), x, scale(0.5 * beta, x))


@inline
def _about_normal(angle: float) -> Mat3:
    """The rotation of a planar joint."""
    c, s = cos(angle), sin(angle)
    return Mat3(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


# --- for derivatives ------------------------------------------------------------------------------------


@inline
def canonical_slope(
    bodies: Bodies, work: Work, z: Vector, tau: Vector, fext: Array, centres: Matrix, dz: Vector, q: Config, p: Vector,
    rates: Matrix, pivots: Vector,
) -> None:  # fmt: skip
    """ż at z; fext may be None, for zero."""
    from_canonical(bodies, centres, z, q, p)
    hamilton_rows(bodies, work, q, p, tau, fext, rates, pivots)
    chart_rate(bodies, centres, z, p, rates[0], rates[1], dz)


@inline
def chart_map(
    bodies: Bodies, z: Vector, v: Vector, dp: Vector, centres: Matrix, dz: Vector, q: Config, p: Vector
) -> None:
    """δz of (δq, δp) at z."""
    from_canonical(bodies, centres, z, q, p)
    chart_rate(bodies, centres, z, p, v, dp, dz)


@inline
def chart_z(bodies: Bodies, q: Config, p: Vector, z: Vector, centres: Matrix) -> None:
    """z of the state (q, p) in the charts of the nearest centres."""
    to_canonical(bodies, centres, q, p, z)


@inline
def chart_centres(bodies: Bodies, q: Config, p: Vector, centres: Matrix, z: Vector) -> None:
    """The nearest centres."""
    to_canonical(bodies, centres, q, p, z)


@inline
def chart_q(bodies: Bodies, z: Vector, centres: Matrix, q: Config, p: Vector) -> None:
    """q of z."""
    from_canonical(bodies, centres, z, q, p)


@inline
def chart_p(bodies: Bodies, z: Vector, centres: Matrix, p: Vector, q: Config) -> None:
    """p of z."""
    from_canonical(bodies, centres, z, q, p)


Z = Argument("z", ("nv+nv",), "", "canonical coordinates")
CENTRES = Argument("centres", ("nv+1", 6), "1", "centres of the charts")
SLOPE = Spec(
    "canonical_slope", canonical_slope, WORK, (Z, TAU, FEXT_OPTIONAL, CENTRES),
    Argument("dz", ("nv+nv",), "", "rates of canonical coordinates"), "Hamilton's equations in charts.",
    "see ``recursions.momenta.canonical_coordinates``", scratch=(("nq",), ("nv",), (2, "nv"), ("nv",)), composed=True,
)  # fmt: skip
CHARTS = Spec(
    "chart_map", chart_map, None, (Z, Argument("v", ("nv",), "", ""), Argument("dp", ("nv",), "", ""), CENTRES),
    Argument("dz", ("nv+nv",), "", "change of canonical coordinates"), "The tangent map of charts.",
    "see ``recursions.momenta.canonical_coordinates``", scratch=(("nq",), ("nv",)), composed=True,
)  # fmt: skip
START = (
    Spec(
        "chart_z", chart_z, None, (Q, P), Z, "Canonical coordinates in the charts of the nearest centres.",
        "see ``recursions.momenta.canonical_coordinates``", scratch=(("nv+1", 6),), composed=True,
    ),
    Spec(
        "chart_centres", chart_centres, None, (Q, P), CENTRES, "The nearest centres.",
        "see ``recursions.momenta.canonical_coordinates``", scratch=(("nv+nv",),), composed=True,
    ),
)  # fmt: skip
STATE = (
    Spec(
        "chart_q", chart_q, None, (Z, CENTRES), Q, "Coordinates of canonical ones.",
        "see ``recursions.momenta.canonical_coordinates``", scratch=(("nv",),), composed=True,
    ),
    Spec(
        "chart_p", chart_p, None, (Z, CENTRES), P, "Momenta of canonical coordinates.",
        "see ``recursions.momenta.canonical_coordinates``", scratch=(("nq",),), composed=True,
    ),
)  # fmt: skip
