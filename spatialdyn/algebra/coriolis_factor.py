"""The factor B of a moving body in the Coriolis matrix C(q, q̇)."""

from __future__ import annotations

from typing import NamedTuple

from .euclidean import Mat3, Vec, add, add_mat3, apply_sym, cross, rotate, scale, second_moment, sub, unrotate
from .scalars import inline
from .spatial import Force, Inertia, Motion


class CoriolisFactor(NamedTuple):
    """The factor B = [P 0; -p̃ 0] of a moving body in C, p its linear momentum (see ``coriolis_factor``)."""

    P: Mat3
    p: Vec


@inline
def coriolis_factor(I: Inertia, v: Motion) -> CoriolisFactor:
    """B(I, v) = ½ (v×* I + (I v)×̄* - I v×), with (f)×̄* m = m ×* f, of a body of inertia I moving with v.

    B v = v ×* I v, B + Bᵀ is the inertia's rate, and B(I, v) w - B(I, w) v = -I (v × w): of the many factors with
    the same B v, the one of the Levi-Civita connection. With v = (ω, l) it is [P 0; -p̃ 0], p = m l + ω × h and
    P = (h·l) 1 - l hᵀ - ω̃ Σ. Source: Echeandia and Wensing, Numerical methods to compute the Coriolis matrix and
    Christoffel symbols for rigid-body systems (2021); the twelve numbers are a derivation of our own.
    """
    h, w, l = I.h, v.w, v.v
    M = second_moment(I.I)
    x = cross(w, Vec(M.xx, M.xy, M.xz))
    y = cross(w, Vec(M.xy, M.yy, M.yz))
    z = cross(w, Vec(M.xz, M.yz, M.zz))
    hx, hy, hz = h.x * l.x, h.y * l.y, h.z * l.z
    P = Mat3(
        hy + hz - x.x, -(l.x * h.y) - y.x, -(l.x * h.z) - z.x,
        -(l.y * h.x) - x.y, hz + hx - y.y, -(l.y * h.z) - z.y,
        -(l.z * h.x) - x.z, -(l.z * h.y) - y.z, hx + hy - z.z,
    )  # fmt: skip
    return CoriolisFactor(P, add(scale(I.m, l), cross(w, h)))


@inline
def add_coriolis_factor(A: CoriolisFactor, B: CoriolisFactor) -> CoriolisFactor:
    """A + B."""
    return CoriolisFactor(add_mat3(A.P, B.P), add(A.p, B.p))


@inline
def coriolis_factor_at_parent(p: Vec, B: CoriolisFactor) -> CoriolisFactor:
    """B moved from an origin at p to the one that p is measured from: XᵀB X = [P - p̃ b̃ 0; -b̃ 0], b = B.p."""
    P, b = B.P, B.p
    x, y, z = p.x * b.x, p.y * b.y, p.z * b.z
    return CoriolisFactor(
        Mat3(
            P.xx + (y + z), P.xy - b.x * p.y, P.xz - b.x * p.z,
            P.yx - b.y * p.x, P.yy + (z + x), P.yz - b.y * p.z,
            P.zx - b.z * p.x, P.zy - b.z * p.y, P.zz + (x + y),
        ),
        b,
    )  # fmt: skip


@inline
def coriolis_times(B: CoriolisFactor, S: Motion) -> Force:
    """B S."""
    return Force(rotate(B.P, S.w), cross(S.w, B.p))


@inline
def coriolis_transpose_times(B: CoriolisFactor, S: Motion) -> Vec:
    """The moment of Bᵀ S, which is a pure couple: the same about every origin."""
    return add(unrotate(B.P, S.w), cross(B.p, S.v))


@inline
def coriolis_force(I: Inertia, v: Motion, w: Motion) -> Force:
    """B(I, v) w without forming B: two thirds of the work where one product is needed."""
    p = add(scale(I.m, v.v), cross(v.w, I.h))
    moment = sub(cross(I.h, cross(w.w, v.v)), cross(v.w, apply_sym(second_moment(I.I), w.w)))
    return Force(moment, cross(w.w, p))
