"""Velocity against velocity: the factor B of a moving body in the Coriolis matrix."""

from __future__ import annotations

from typing import NamedTuple

from .euclidean import Rot, Vec, add_rot, apply_sym, cross, minus, plus, rotate, second_moment, times, unrotate
from .scalars import inlined
from .spatial import Force, Inertia, Motion


class Coupling(NamedTuple):
    """What couples velocities in C for a moving body: B = [P 0; -p̃ 0], p its linear momentum (see ``coupling``)."""

    P: Rot
    p: Vec


@inlined
def coupling(I: Inertia, v: Motion) -> Coupling:
    """B(I, v) = ½ (v×* I + (I v)×̄* - I v×), with (f)×̄* m = m ×* f, of a body of inertia I moving with v.

    B v = v ×* I v, B + Bᵀ is the inertia's rate, and B(I, v) w - B(I, w) v = -I (v × w): of the many factors that
    give C v, the one of the Levi-Civita connection. With v = (ω, l) it is [P 0; -p̃ 0], p = m l + ω × h and
    P = (h·l) 1 - l hᵀ - ω̃ Σ. Source: Echeandia and Wensing, Numerical methods to compute the Coriolis matrix and
    Christoffel symbols for rigid-body systems (2021); the twelve numbers are a derivation of our own.
    """
    h, w, l = I.h, v.w, v.v
    M = second_moment(I.I)
    x = cross(w, Vec(M.xx, M.xy, M.xz))
    y = cross(w, Vec(M.xy, M.yy, M.yz))
    z = cross(w, Vec(M.xz, M.yz, M.zz))
    hx, hy, hz = h.x * l.x, h.y * l.y, h.z * l.z
    P = Rot(
        hy + hz - x.x, -(l.x * h.y) - y.x, -(l.x * h.z) - z.x,
        -(l.y * h.x) - x.y, hz + hx - y.y, -(l.y * h.z) - z.y,
        -(l.z * h.x) - x.z, -(l.z * h.y) - y.z, hx + hy - z.z,
    )  # fmt: skip
    return Coupling(P, plus(times(I.m, l), cross(w, h)))


@inlined
def add_coupling(A: Coupling, B: Coupling) -> Coupling:
    """A + B."""
    return Coupling(add_rot(A.P, B.P), plus(A.p, B.p))


@inlined
def unshift_coupling(p: Vec, B: Coupling) -> Coupling:
    """B about an origin that lies at p, about the origin that p starts from: XᵀB X = [P - p̃ b̃ 0; -b̃ 0], b = B.p."""
    P, b = B.P, B.p
    x, y, z = p.x * b.x, p.y * b.y, p.z * b.z
    return Coupling(
        Rot(
            P.xx + (y + z), P.xy - b.x * p.y, P.xz - b.x * p.z,
            P.yx - b.y * p.x, P.yy + (z + x), P.yz - b.y * p.z,
            P.zx - b.z * p.x, P.zy - b.z * p.y, P.zz + (x + y),
        ),
        b,
    )  # fmt: skip


@inlined
def coupled(B: Coupling, S: Motion) -> Force:
    """B S."""
    return Force(rotate(B.P, S.w), cross(S.w, B.p))


@inlined
def coupled_back(B: Coupling, S: Motion) -> Vec:
    """Bᵀ S, a couple: its moment, the same about every origin."""
    return plus(unrotate(B.P, S.w), cross(B.p, S.v))


@inlined
def coupled_force(I: Inertia, v: Motion, w: Motion) -> Force:
    """B(I, v) w without B: two thirds of the work where it is needed once."""
    p = plus(times(I.m, v.v), cross(v.w, I.h))
    moment = minus(cross(I.h, cross(w.w, v.v)), cross(v.w, apply_sym(second_moment(I.I), w.w)))
    return Force(moment, cross(w.w, p))
