"""Vectors of three numbers and 3 x 3 matrices: what spatial quantities are made of.

===================  =====================================================================
Vec (x, y, z)        a vector of three numbers
Mat3 (xx .. zz)      a 3 x 3 matrix, row by row; in a Pose the rotation child -> parent
Sym (xx xy xz        a symmetric 3 x 3 matrix, upper triangle
yy yz zz)
===================  =====================================================================

The types are NamedTuples of plain scalars: under Numba they compile away, and in plain Python the scalars
may be anything with + - * /. Nothing in this module compares, allocates arrays or looks at a type.
"""

from __future__ import annotations

from typing import NamedTuple

from .scalars import Scalar, inline


class Vec(NamedTuple):
    """A vector of three numbers."""

    x: Scalar
    y: Scalar
    z: Scalar


class Mat3(NamedTuple):
    """A 3 x 3 matrix, row by row."""

    xx: Scalar
    xy: Scalar
    xz: Scalar
    yx: Scalar
    yy: Scalar
    yz: Scalar
    zx: Scalar
    zy: Scalar
    zz: Scalar


class Sym(NamedTuple):
    """A symmetric 3 x 3 matrix, upper triangle row by row."""

    xx: Scalar
    xy: Scalar
    xz: Scalar
    yy: Scalar
    yz: Scalar
    zz: Scalar


# --- vectors ------------------------------------------------------------------------------------------


@inline
def zero() -> Vec:
    """The null vector."""
    return Vec(0.0, 0.0, 0.0)


@inline
def add(a: Vec, b: Vec) -> Vec:
    """a + b."""
    return Vec(a.x + b.x, a.y + b.y, a.z + b.z)


@inline
def sub(a: Vec, b: Vec) -> Vec:
    """a - b."""
    return Vec(a.x - b.x, a.y - b.y, a.z - b.z)


@inline
def neg(a: Vec) -> Vec:
    """-a."""
    return Vec(-a.x, -a.y, -a.z)


@inline
def scale(s: Scalar, a: Vec) -> Vec:
    """s a."""
    return Vec(s * a.x, s * a.y, s * a.z)


@inline
def dot(a: Vec, b: Vec) -> Scalar:
    """a · b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@inline
def cross(a: Vec, b: Vec) -> Vec:
    """a × b."""
    return Vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


# --- matrices -----------------------------------------------------------------------------------------


@inline
def identity() -> Mat3:
    """The 3 x 3 identity."""
    return Mat3(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@inline
def matmul(A: Mat3, B: Mat3) -> Mat3:
    """A B."""
    return Mat3(
        A.xx * B.xx + A.xy * B.yx + A.xz * B.zx,
        A.xx * B.xy + A.xy * B.yy + A.xz * B.zy,
        A.xx * B.xz + A.xy * B.yz + A.xz * B.zz,
        A.yx * B.xx + A.yy * B.yx + A.yz * B.zx,
        A.yx * B.xy + A.yy * B.yy + A.yz * B.zy,
        A.yx * B.xz + A.yy * B.yz + A.yz * B.zz,
        A.zx * B.xx + A.zy * B.yx + A.zz * B.zx,
        A.zx * B.xy + A.zy * B.yy + A.zz * B.zy,
        A.zx * B.xz + A.zy * B.yz + A.zz * B.zz,
    )


@inline
def zero_mat3() -> Mat3:
    """The null matrix."""
    return Mat3(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inline
def zero_sym() -> Sym:
    """The null matrix, as a symmetric one."""
    return Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inline
def transpose(A: Mat3) -> Mat3:
    """Aᵀ."""
    return Mat3(A.xx, A.yx, A.zx, A.xy, A.yy, A.zy, A.xz, A.yz, A.zz)


@inline
def rotate(R: Mat3, a: Vec) -> Vec:
    """R a."""
    return Vec(
        R.xx * a.x + R.xy * a.y + R.xz * a.z,
        R.yx * a.x + R.yy * a.y + R.yz * a.z,
        R.zx * a.x + R.zy * a.y + R.zz * a.z,
    )


@inline
def unrotate(R: Mat3, a: Vec) -> Vec:
    """Rᵀ a."""
    return Vec(
        R.xx * a.x + R.yx * a.y + R.zx * a.z,
        R.xy * a.x + R.yy * a.y + R.zy * a.z,
        R.xz * a.x + R.yz * a.y + R.zz * a.z,
    )


@inline
def add_mat3(A: Mat3, B: Mat3) -> Mat3:
    """A + B."""
    return Mat3(
        A.xx + B.xx, A.xy + B.xy, A.xz + B.xz,
        A.yx + B.yx, A.yy + B.yy, A.yz + B.yz,
        A.zx + B.zx, A.zy + B.zy, A.zz + B.zz,
    )  # fmt: skip


@inline
def apply_sym(A: Sym, a: Vec) -> Vec:
    """A a for a symmetric A."""
    return Vec(
        A.xx * a.x + A.xy * a.y + A.xz * a.z,
        A.xy * a.x + A.yy * a.y + A.yz * a.z,
        A.xz * a.x + A.yz * a.y + A.zz * a.z,
    )


@inline
def add_sym(A: Sym, B: Sym) -> Sym:
    """A + B."""
    return Sym(A.xx + B.xx, A.xy + B.xy, A.xz + B.xz, A.yy + B.yy, A.yz + B.yz, A.zz + B.zz)


@inline
def sub_sym(A: Sym, B: Sym) -> Sym:
    """A - B."""
    return Sym(A.xx - B.xx, A.xy - B.xy, A.xz - B.xz, A.yy - B.yy, A.yz - B.yz, A.zz - B.zz)


@inline
def congruence(R: Mat3, A: Sym) -> Sym:
    """R A Rᵀ for a symmetric A; only its six numbers are computed."""
    x = apply_sym(A, Vec(R.xx, R.xy, R.xz))
    y = apply_sym(A, Vec(R.yx, R.yy, R.yz))
    z = apply_sym(A, Vec(R.zx, R.zy, R.zz))
    return Sym(
        R.xx * x.x + R.xy * x.y + R.xz * x.z,
        R.yx * x.x + R.yy * x.y + R.yz * x.z,
        R.zx * x.x + R.zy * x.y + R.zz * x.z,
        R.yx * y.x + R.yy * y.y + R.yz * y.z,
        R.zx * y.x + R.zy * y.y + R.zz * y.z,
        R.zx * z.x + R.zy * z.y + R.zz * z.z,
    )


# --- rotational inertias and rotating bodies ----------------------------------------------------------


@inline
def parallel_axis(I: Sym, p: Vec, a: Vec, b: Vec) -> Sym:
    """I + (p·a + p·b) 1 - a pᵀ - p bᵀ for b - a parallel to p, where the sum is symmetric.

    With a the first moment before and b after a shift of the origin by -p, this is the rotational
    inertia about the new origin: the parallel axis theorem in both its terms.
    """
    x, y, z = p.x * (a.x + b.x), p.y * (a.y + b.y), p.z * (a.z + b.z)
    return Sym(
        I.xx + (y + z),
        I.xy - (a.x * p.y + p.x * b.y),
        I.xz - (a.x * p.z + p.x * b.z),
        I.yy + (z + x),
        I.yz - (a.y * p.z + p.y * b.z),
        I.zz + (x + y),
    )


@inline
def second_moment(I: Sym) -> Sym:
    """Σ = ½ tr(Ī) 1 - Ī, the integral of r rᵀ over a body of rotational inertia Ī."""
    return Sym(
        0.5 * (I.yy + I.zz - I.xx), -I.xy, -I.xz,
        0.5 * (I.zz + I.xx - I.yy), -I.yz,
        0.5 * (I.xx + I.yy - I.zz),
    )  # fmt: skip


@inline
def acceleration_matrix(w: Vec, dw: Vec) -> Mat3:
    """U = ω̇~ + ω̃²: the point p of a rotating body accelerates by U p relative to the origin."""
    xx, yy, zz = w.x * w.x, w.y * w.y, w.z * w.z
    xy, xz, yz = w.x * w.y, w.x * w.z, w.y * w.z
    return Mat3(
        -(yy + zz), xy - dw.z, xz + dw.y,
        xy + dw.z, -(xx + zz), yz - dw.x,
        xz - dw.y, yz + dw.x, -(xx + yy),
    )  # fmt: skip


@inline
def newton_euler_moment(I: Sym, w: Vec, dw: Vec, U: Mat3) -> Vec:
    """Ī ω̇ + ω × Ī ω with U = acceleration_matrix(w, dw), in fifteen products (after Khalil and Kleinfinger 1987)."""
    xx, yy, zz = w.x * w.x, w.y * w.y, w.z * w.z
    return Vec(
        I.xx * dw.x + (I.zz - I.yy) * (w.y * w.z) + I.yz * (yy - zz) + (I.xz * U.yx - I.xy * U.zx),
        I.yy * dw.y + (I.xx - I.zz) * (w.x * w.z) + I.xz * (zz - xx) + (I.xy * U.zy - I.yz * U.xy),
        I.zz * dw.z + (I.yy - I.xx) * (w.x * w.y) + I.xy * (xx - yy) + (I.yz * U.xz - I.xz * U.yz),
    )
