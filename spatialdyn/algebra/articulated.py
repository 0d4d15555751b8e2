"""Articulated-body inertia: that of a body with the bodies that joints attach to it (RBDA chapter 7)."""

from __future__ import annotations

from typing import NamedTuple

from .euclidean import (
    Mat3,
    Sym,
    Vec,
    add,
    add_mat3,
    add_sym,
    apply_sym,
    congruence,
    matmul,
    rotate,
    transpose,
    unrotate,
    zero_mat3,
    zero_sym,
)
from .scalars import inline
from .spatial import Force, Inertia, Motion, Pose


class Articulated(NamedTuple):
    """An articulated body inertia [I H; Hᵀ M] (RBDA section 7.1)."""

    I: Sym
    H: Mat3
    M: Sym


@inline
def articulated(I: Inertia) -> Articulated:
    """A rigid body as an articulated one: [Ī h̃; h̃ᵀ m 1]."""
    h = I.h
    return Articulated(
        I.I,
        Mat3(0.0, -h.z, h.y, h.z, 0.0, -h.x, -h.y, h.x, 0.0),
        Sym(I.m, 0.0, 0.0, I.m, 0.0, I.m),
    )


@inline
def no_articulated() -> Articulated:
    """The articulated inertia of no body: zero."""
    return Articulated(zero_sym(), zero_mat3(), zero_sym())


@inline
def add_articulated(A: Articulated, B: Articulated) -> Articulated:
    """A + B."""
    return Articulated(add_sym(A.I, B.I), add_mat3(A.H, B.H), add_sym(A.M, B.M))


@inline
def articulated_force(A: Articulated, a: Motion) -> Force:
    """A a."""
    return Force(
        add(apply_sym(A.I, a.w), rotate(A.H, a.v)),
        add(unrotate(A.H, a.w), apply_sym(A.M, a.v)),
    )


@inline
def subtract_outer(A: Articulated, U: Force, W: Force) -> Articulated:
    """A - U Wᵀ for W parallel to U. With U = A S and W = U/D it is A across a joint that moves freely along S."""
    n, f, N, F = U.n, U.f, W.n, W.f
    I, H, M = A.I, A.H, A.M
    return Articulated(
        Sym(
            I.xx - n.x * N.x, I.xy - n.x * N.y, I.xz - n.x * N.z,
            I.yy - n.y * N.y, I.yz - n.y * N.z, I.zz - n.z * N.z,
        ),
        Mat3(
            H.xx - n.x * F.x, H.xy - n.x * F.y, H.xz - n.x * F.z,
            H.yx - n.y * F.x, H.yy - n.y * F.y, H.yz - n.y * F.z,
            H.zx - n.z * F.x, H.zy - n.z * F.y, H.zz - n.z * F.z,
        ),
        Sym(
            M.xx - f.x * F.x, M.xy - f.x * F.y, M.xz - f.x * F.z,
            M.yy - f.y * F.y, M.yz - f.y * F.z, M.zz - f.z * F.z,
        ),
    )  # fmt: skip


@inline
def articulated_to_parent(X: Pose, A: Articulated) -> Articulated:
    """An articulated inertia from child to parent coordinates: Xᵀ A X, symmetric by construction."""
    return articulated_at_parent(X.p, rotate_articulated(X.R, A))


@inline
def rotate_articulated(R: Mat3, A: Articulated) -> Articulated:
    """An articulated inertia from axes of orientation R to the axes that R is given in, about the same origin."""
    M = congruence(R, A.M)
    H = matmul(matmul(R, A.H), transpose(R))
    return Articulated(congruence(R, A.I), H, M)


@inline
def articulated_at_parent(p: Vec, A: Articulated) -> Articulated:
    """An articulated inertia moved from an origin at p to the origin that p is measured from.

    H' = H + p̃ M and I' = I - H p̃ + p̃ H'ᵀ.
    """
    I, H, M = A.I, A.H, A.M
    G = Mat3(
        H.xx + (p.y * M.xz - p.z * M.xy), H.xy + (p.y * M.yz - p.z * M.yy), H.xz + (p.y * M.zz - p.z * M.yz),
        H.yx + (p.z * M.xx - p.x * M.xz), H.yy + (p.z * M.xy - p.x * M.yz), H.yz + (p.z * M.xz - p.x * M.zz),
        H.zx + (p.x * M.xy - p.y * M.xx), H.zy + (p.x * M.yy - p.y * M.xy), H.zz + (p.x * M.yz - p.y * M.xz),
    )  # fmt: skip
    return Articulated(
        Sym(
            I.xx - (H.xy * p.z - H.xz * p.y) + (p.y * G.xz - p.z * G.xy),
            I.xy - (H.xz * p.x - H.xx * p.z) + (p.y * G.yz - p.z * G.yy),
            I.xz - (H.xx * p.y - H.xy * p.x) + (p.y * G.zz - p.z * G.zy),
            I.yy - (H.yz * p.x - H.yx * p.z) + (p.z * G.yx - p.x * G.yz),
            I.yz - (H.yx * p.y - H.yy * p.x) + (p.z * G.zx - p.x * G.zz),
            I.zz - (H.zx * p.y - H.zy * p.x) + (p.x * G.zy - p.y * G.zx),
        ),
        G,
        M,
    )
