"""Quaternions and (cos, sin) pairs off their unit norm, moved by the formulas of Pinocchio 4.1, not the group's.

If the table accepts coordinates of ANY_NORM, ``configuration`` calls these. A product is scaled by (3 - |q|²)/2, which
is 1/|q| to first order, and a logarithm grows with |q|. At unit norm to rounding each is the group's own formula. If
Pinocchio returns NaN, these return a number.

Source: the results of Pinocchio 4.1; tests/compat/test_strictness.py compares the two.
"""

from __future__ import annotations

from ...algebra.euclidean import Vec, add, cross, dot, scale
from ...algebra.lie import Quat, log_factors, scale_quat
from ...algebra.rotations import NORM_ROUNDING
from ...algebra.scalars import Scalar, atan2, cos, inline, select, sin, sqrt
from ..signatures import Config


@inline
def _on(square: Scalar) -> Scalar:
    """Positive where a squared norm is 1 to rounding."""
    return NORM_ROUNDING - select(square - 1.0, square - 1.0, 1.0 - square)


@inline
def quat_norm(a: Quat) -> Scalar:
    """|a|; exactly 1 if |a| is 1 to rounding."""
    n = a.x * a.x + a.y * a.y + a.z * a.z + a.w * a.w
    return select(_on(n), 1.0, sqrt(n))


@inline
def free_travel(w: Vec, n: Scalar, p: Vec) -> Vec:
    """``log_travel`` for a quaternion of norm n and rotation vector w: with n w in place of w, n² u in place of u."""
    t = dot(w, w)
    u, beta = log_factors(t)
    turns = t - 1.5e-8  # Pinocchio's series for θ < 1.2e-4 ignores the norm
    u = select(turns, n * n * u, u)
    off = select(_on(n * n), -1.0, turns)
    beta = select(off, (1.0 - u) / select(off, n * n * t, 1.0), beta)
    w = scale(n, w)
    return add(add(scale(u, p), scale(-0.5, cross(w, p))), scale(beta * dot(w, p), w))


@inline
def pulled(a: Quat) -> Quat:
    """a (3 - |a|²)/2: on the unit sphere to first order."""
    return scale_quat(0.5 * (3.0 - (a.x * a.x + a.y * a.y + a.z * a.z + a.w * a.w)), a)


@inline
def pull_pair(q: Config, k: int, angle: Scalar, out: Config) -> None:
    """Turn the (cos, sin) pair q[k], q[k+1] by an angle and scale it as ``pulled`` does."""
    c, s = cos(angle), sin(angle)
    x, y = q[k] * c - q[k + 1] * s, q[k + 1] * c + q[k] * s
    factor = 0.5 * (3.0 - (x * x + y * y))
    out[k], out[k + 1] = factor * x, factor * y


@inline
def leave_pair(q: Config, k: int, angle: Scalar, out: Config) -> None:
    """Turn the pair q[k], q[k+1] by an angle; one off the unit circle keeps its norm."""
    c, s = cos(angle), sin(angle)
    x, y = q[k] * c - q[k + 1] * s, q[k + 1] * c + q[k] * s
    n = x * x + y * y
    on = _on(n)
    factor = 1.0 / sqrt(select(on, n, 1.0))
    out[k], out[k + 1] = factor * x, factor * y


@inline
def free_angle(q0: Config, q1: Config, k: int) -> Scalar:
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


@inline
def mix_pairs(q0: Config, q1: Config, k: int, t: Scalar, out: Config) -> None:
    """Interpolate pairs off the unit circle: their sum, weighted by sines of parts of the angle between them."""
    c0, s0, c1, s1 = q0[k], q0[k + 1], q1[k], q1[k + 1]
    c, s = c0 * c1 + s0 * s1, c0 * s1 - s0 * c1
    angle = atan2(s, c)
    size = select(angle, angle, -angle)
    apart = size - 1e-6
    safe = select(apart, s, 1.0)
    a, b = select(apart, sin((1.0 - t) * angle) / safe, 1.0 - t), select(apart, sin(t * angle) / safe, t)
    x, y = a * c0 + b * c1, a * s0 + b * s1
    back = size - (3.141592653589793 - 1e-6)  # half a turn: the pair is q0's
    x, y = select(back, c0, x), select(back, s0, y)
    on = _on(c * c + s * s)
    out[k], out[k + 1] = select(on, out[k], x), select(on, out[k + 1], y)
