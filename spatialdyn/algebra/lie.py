"""Exponential and logarithm of rotations and rigid motions, and their derivatives.

With θ = |w|, W = w× and V = v×, the twist m = (w, v), held constant in the moving frame, ends after unit time at

    rotation     the quaternion (w sin(θ/2)/θ, cos(θ/2))
    translation  p = (s 1 + b W + c w wᵀ) v     s = sin θ/θ,  b = (1 - cos θ)/θ²,  c = (1 - s)/θ²
    and back     v = (u 1 - ½ W + β w wᵀ) p     u = (θ/2) cot(θ/2),  β = (1 - u)/θ²

A twist is a rotation vector w + ε v with ε² = 0, so the derivative of a series in W, taken at w in the direction
v, is the block that couples rotation and translation in the same series of the spatial cross product m×.

No function compares values. θ stands for √(|w|² + 1e-36), which makes the quotients regular at 0 and changes none
of them by more than 1e-36; where a difference would cancel, its Taylor series is selected for θ < 1, summed to
float64 accuracy.

Derived here from the series exp(W) = Σ Wᵏ/k!, with W³ = -θ² W.
"""

from __future__ import annotations

from fractions import Fraction
from math import factorial
from typing import NamedTuple

from .euclidean import Mat3, Vec, add, add_mat3, cross, dot, matmul, rotate, scale, transpose
from .rotations import rotation
from .scalars import Scalar, atan2, cos, inline, select, series_or_closed, sin, sqrt
from .spatial import Motion

TINY = 1e-36  # its root is far below the resolution of θ, and both are normal numbers in float32

_EVEN = (1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510, 43867 / 798, 174611 / 330)
_BERNOULLI = (*_EVEN, 854513 / 138, 236364091 / 2730)  # |B₂|, |B₄| ... |B₂₄|
C = tuple(float(Fraction((-1) ** k, factorial(2 * k + 3))) for k in range(10))
B1 = tuple(float(Fraction(2 * k * (-1) ** k, factorial(2 * k + 2))) for k in range(1, 11))
C1 = tuple(float(Fraction(2 * k * (-1) ** k, factorial(2 * k + 3))) for k in range(1, 11))
BETA = tuple(x / factorial(2 * n + 2) for n, x in enumerate(_BERNOULLI))
BETA1 = tuple(2 * n * x for n, x in enumerate(BETA))[1:]
BETA2 = tuple(2 * n * x for n, x in enumerate(BETA1))[1:]


class Quat(NamedTuple):
    """A quaternion, scalar part last."""

    x: Scalar
    y: Scalar
    z: Scalar
    w: Scalar


class Tangent(NamedTuple):
    """The matrix [J K; 0 J] between twists, linear part first: K is what the angular part adds to the linear."""

    J: Mat3
    K: Mat3


# --- quaternions ----------------------------------------------------------------------------------------


@inline
def product(a: Quat, b: Quat) -> Quat:
    """a b: the rotation b of the frame a."""
    return Quat(
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y + a.y * b.w + a.z * b.x - a.x * b.z,
        a.w * b.z + a.z * b.w + a.x * b.y - a.y * b.x,
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
    )


@inline
def conjugate(a: Quat) -> Quat:
    """The inverse rotation."""
    return Quat(-a.x, -a.y, -a.z, a.w)


@inline
def scale_quat(s: Scalar, a: Quat) -> Quat:
    """s a."""
    return Quat(s * a.x, s * a.y, s * a.z, s * a.w)


@inline
def unit(a: Quat) -> Quat:
    """a / |a|, exact to rounding for any a near the unit sphere."""
    return scale_quat(1.0 / sqrt(a.x * a.x + a.y * a.y + a.z * a.z + a.w * a.w), a)


@inline
def rescaled(a: Quat) -> Quat:
    """a / |a|, divided by its largest entry first so that no square over- or underflows; a null a stays null."""
    size = larger(larger(a.x, a.y), larger(a.z, a.w))
    size = size + select(size, 0.0, 1.0)
    a = Quat(a.x / size, a.y / size, a.z / size, a.w / size)
    n = a.x * a.x + a.y * a.y + a.z * a.z + a.w * a.w
    return scale_quat(1.0 / sqrt(n + select(n, 0.0, 1.0)), a)


@inline
def larger(x: Scalar, y: Scalar) -> Scalar:
    """max(|x|, |y|)."""
    x, y = select(-x, -x, x), select(-y, -y, y)
    return select(x - y, x, y)


@inline
def matrix(a: Quat) -> Mat3:
    """The rotation matrix of a unit quaternion."""
    return rotation(a.x, a.y, a.z, a.w)


# --- exponential and logarithm --------------------------------------------------------------------------


@inline
def exp_rotation(w: Vec) -> Quat:
    """The rotation by |w| about w."""
    h = 0.5 * sqrt(dot(w, w) + TINY)
    s = 0.5 * (sin(h) / h)
    return Quat(s * w.x, s * w.y, s * w.z, cos(h))


@inline
def log_rotation(a: Quat) -> Vec:
    """The rotation vector of a, with |w| <= π; a and -a are one rotation, and |a| does not matter."""
    n = sqrt(a.x * a.x + a.y * a.y + a.z * a.z + TINY)
    w = select(-a.w, -a.w, a.w)
    s = 2.0 * atan2(n, w) / n * select(-a.w, -1.0, 1.0)
    return Vec(s * a.x, s * a.y, s * a.z)


@inline
def exp_travel(m: Motion) -> Vec:
    """p = (s 1 + b W + c w wᵀ) v: where the twist m takes the origin."""
    s, b, c = exp_factors(dot(m.w, m.w))
    return add(add(scale(s, m.v), scale(b, cross(m.w, m.v))), scale(c * dot(m.w, m.v), m.w))


@inline
def log_travel(w: Vec, p: Vec) -> Vec:
    """v = (u 1 - ½ W + β w wᵀ) p: the linear part of the twist that rotates by w, |w| < 2π, and translates by p."""
    u, beta = log_factors(dot(w, w))
    return add(add(scale(u, p), scale(-0.5, cross(w, p))), scale(beta * dot(w, p), w))


@inline
def exp_factors(t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """s, b, c at θ² = t."""
    h = 0.5 * sqrt(t + TINY)
    half = sin(h) / h
    s = half * cos(h)
    return s, 0.5 * half * half, near(t, C, (1.0 - s) / away(t))


@inline
def log_factors(t: Scalar) -> tuple[Scalar, Scalar]:
    """u, β at θ² = t < (2π)²."""
    h = 0.5 * sqrt(t + TINY)
    u = h * cos(h) / sin(h)
    return u, near(t, BETA, (1.0 - u) / away(t))


@inline
def near(t: Scalar, series: tuple[float, ...], closed: Scalar) -> Scalar:
    """The series in t where t < 1, the closed form elsewhere (and for a NaN)."""
    x = select(1.0 - t, t, 0.0)
    total = 0.0 * x
    for i in range(len(series) - 1, -1, -1):
        total = total * x + series[i]
    return series_or_closed(1.0 - t, total, closed)


@inline
def away(t: Scalar) -> Scalar:
    """The divisor of a closed form: t where that is taken, 1 where the series is; never small."""
    return series_or_closed(1.0 - t, 1.0, t + TINY)


# --- derivatives ----------------------------------------------------------------------------------------


@inline
def mixed(a: Scalar, u: Vec, w: Vec, g: Vec) -> Mat3:
    """a 1 + u× + w gᵀ + g wᵀ."""
    xy, xz, yz = w.x * g.y + g.x * w.y, w.x * g.z + g.x * w.z, w.y * g.z + g.y * w.z
    return Mat3(
        a + 2.0 * w.x * g.x, xy - u.z, xz + u.y,
        xy + u.z, a + 2.0 * w.y * g.y, yz - u.x,
        xz - u.y, yz + u.x, a + 2.0 * w.z * g.z,
    )  # fmt: skip


@inline
def dual(m: Motion, a: Scalar, k: Scalar, e: Scalar, da: Scalar, dk: Scalar, de: Scalar) -> Tangent:
    """J = a 1 + k W + e w wᵀ, and K its derivative at w along v; da, dk, de are (1/θ) d/dθ of a, k, e."""
    w, v = m.w, m.v
    d = dot(w, v)
    return Tangent(
        mixed(a, scale(k, w), w, scale(0.5 * e, w)),
        mixed(d * da, add(scale(k, v), scale(d * dk, w)), w, add(scale(e, v), scale(0.5 * d * de, w))),
    )


@inline
def exp_jacobian(m: Motion) -> Tangent:
    """Right Jacobian of the exponential: exp(m + δ) = exp(m) exp(J δ) to first order."""
    t = dot(m.w, m.w)
    s, b, c = exp_factors(t)
    b1 = near(t, B1, (s - 2.0 * b) / away(t))
    c1 = near(t, C1, (b - 3.0 * c) / away(t))
    return dual(m, s, -b, c, c - b, -b1, c1)


@inline
def log_jacobian(m: Motion, side: float) -> Tangent:
    """Derivative of m = log(A⁻¹ B), |w| <= π, by twists of B in its own frame (side = 1) or of A in its own (-1).

    For B it is the inverse of the right Jacobian, u 1 + ½ W + β w wᵀ; for A minus the same at -m.
    """
    t = dot(m.w, m.w)
    u, beta = log_factors(t)
    h = sin(0.5 * sqrt(t + TINY))
    beta1 = near(t, BETA1, (0.25 / (h * h) - 1.0 / away(t) - beta) / away(t))
    return dual(m, side * u, 0.5, side * beta, -side * (2.0 * beta + beta1 * t), 0.0, side * beta1)


@inline
def log_jacobian_times_derivative(m: Motion, x: Motion) -> Tangent:
    """Derivative by m of T(m) x, T the inverse right Jacobian of the exponential, ``log_jacobian(m, 1.0)``.

    Of a rotation w, and x an angular vector, it is L(w, x) = u₁ x wᵀ - ½ X + β₁ (w·x) w wᵀ + β ((w·x) 1 + w xᵀ), with
    u₁, β₁ = (1/θ) d/dθ of u, β. A twist is a rotation vector over dual numbers, so the block that couples rotation and
    translation is L(w, x_v) plus the derivative of L along v.
    """
    w, v, xw, xv = m.w, m.v, x.w, x.v
    t, wv, wx = dot(w, w), dot(w, v), dot(w, xw)
    beta = log_factors(t)[1]
    h, b = 0.5 * sqrt(t + TINY), away(t)
    s = sin(h)
    beta1 = near(t, BETA1, (0.25 / (s * s) - 1.0 / b - beta) / b)
    beta2 = near(t, BETA2, (2.0 / (b * b) - 0.125 * cos(h) / (h * s * s * s) - 3.0 * beta1) / b)
    u1, u2 = -(2.0 * beta + beta1 * t), -(4.0 * beta1 + beta2 * t)
    f, g = add(scale(u1, xw), scale(beta1 * wx, w)), scale(beta, w)
    J = add_mat3(add_mat3(outer(f, w), outer(g, xw)), turned_diagonal(beta * wx, scale(-0.5, xw)))
    # of f, g and w·x along (v, x_v)
    dwx = dot(v, xw) + dot(w, xv)
    df = add(scale(u2 * wv, xw), add(scale(u1, xv), scale(beta1 * wx, v)))
    df = add(df, scale(beta2 * wv * wx + beta1 * dwx, w))
    dg = add(scale(beta1 * wv, w), scale(beta, v))
    K = add_mat3(add_mat3(outer(df, w), outer(f, v)), add_mat3(outer(dg, xw), outer(g, xv)))
    K = add_mat3(K, turned_diagonal(beta1 * wv * wx + beta * dwx, scale(-0.5, xv)))
    return Tangent(J, K)


@inline
def outer(a: Vec, b: Vec) -> Mat3:
    """a bᵀ."""
    return Mat3(a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.x, a.y * b.y, a.y * b.z, a.z * b.x, a.z * b.y, a.z * b.z)


@inline
def turned_diagonal(a: Scalar, u: Vec) -> Mat3:
    """a 1 + u×."""
    return Mat3(a, -u.z, u.y, u.z, a, -u.x, -u.y, u.x, a)


@inline
def times_twist(T: Tangent, m: Motion) -> Motion:
    """[J K; 0 J] times a twist."""
    return Motion(rotate(T.J, m.w), add(rotate(T.J, m.v), rotate(T.K, m.w)))


@inline
def inverse_adjoint(m: Motion) -> Tangent:
    """Adjoint of exp(m)⁻¹: takes a twist from the frame before the motion exp(m) to the frame after it."""
    p = exp_travel(m)
    R = transpose(matrix(exp_rotation(m.w)))
    return Tangent(R, matmul(R, Mat3(0.0, p.z, -p.y, -p.z, 0.0, p.x, p.y, -p.x, 0.0)))
