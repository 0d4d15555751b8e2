"""Spatial vectors, poses and inertias: the vocabulary of every recursion.

Notation: R. Featherstone, Rigid Body Dynamics Algorithms (RBDA, 2008), chapter 2. Angular part first.

===================  =====================================================================
Motion (w, v)        a spatial motion vector: angular, linear (velocity of the point at the origin)
Force (n, f)         a spatial force vector: moment about the origin, linear
Pose (R, p)          a frame seen from its parent: orientation and origin
Inertia (m, h, I)    a rigid body: mass, first moment m c, rotational inertia about the origin
===================  =====================================================================

NamedTuples of plain scalars like those of ``euclidean``: nothing here compares, allocates arrays or looks at a type.
"""

from __future__ import annotations

from typing import NamedTuple

from .euclidean import (
    Rot,
    Sym,
    Vec,
    add_sym,
    apply_sym,
    congruence,
    cross,
    dot,
    identity,
    matmul,
    minus,
    negative,
    plus,
    rotate,
    shifted,
    times,
    transpose,
    unrotate,
    zero,
)
from .scalars import Scalar, inlined


class Motion(NamedTuple):
    """A spatial motion vector: w angular, v linear (of the point now at the origin)."""

    w: Vec
    v: Vec


class Force(NamedTuple):
    """A spatial force vector: n moment about the origin, f linear."""

    n: Vec
    f: Vec


class Pose(NamedTuple):
    """A frame seen from its parent: R takes child coordinates to parent ones, p is the child's origin."""

    R: Rot
    p: Vec


class Inertia(NamedTuple):
    """A rigid body: m mass, h = m c first moment, I rotational inertia about the origin."""

    m: Scalar
    h: Vec
    I: Sym


# --- motions and forces -------------------------------------------------------------------------------


@inlined
def zero_motion() -> Motion:
    """The null motion."""
    return Motion(zero(), zero())


@inlined
def zero_force() -> Force:
    """The null force."""
    return Force(zero(), zero())


@inlined
def add_motion(a: Motion, b: Motion) -> Motion:
    """a + b."""
    return Motion(plus(a.w, b.w), plus(a.v, b.v))


@inlined
def sub_motion(a: Motion, b: Motion) -> Motion:
    """a - b."""
    return Motion(minus(a.w, b.w), minus(a.v, b.v))


@inlined
def scale_motion(s: Scalar, a: Motion) -> Motion:
    """s a."""
    return Motion(times(s, a.w), times(s, a.v))


@inlined
def add_force(a: Force, b: Force) -> Force:
    """a + b."""
    return Force(plus(a.n, b.n), plus(a.f, b.f))


@inlined
def sub_force(a: Force, b: Force) -> Force:
    """a - b."""
    return Force(minus(a.n, b.n), minus(a.f, b.f))


@inlined
def scale_force(s: Scalar, a: Force) -> Force:
    """s a."""
    return Force(times(s, a.n), times(s, a.f))


@inlined
def power(S: Motion, f: Force) -> Scalar:
    """S · f: the power of a force along a motion (RBDA eq. 2.6)."""
    return dot(S.w, f.n) + dot(S.v, f.f)


@inlined
def cross_motion(v: Motion, m: Motion) -> Motion:
    """v × m (RBDA eq. 2.31)."""
    return Motion(cross(v.w, m.w), plus(cross(v.w, m.v), cross(v.v, m.w)))


@inlined
def cross_force(v: Motion, f: Force) -> Force:
    """v ×* f (RBDA eq. 2.32)."""
    return Force(plus(cross(v.w, f.n), cross(v.v, f.f)), cross(v.w, f.f))


# --- poses: changes of frame (RBDA section 2.8) -------------------------------------------------------


@inlined
def identity_pose() -> Pose:
    """The pose of a frame in itself."""
    return Pose(identity(), zero())


@inlined
def compose(A: Pose, B: Pose) -> Pose:
    """A B: the frame B of the frame A, seen from A's parent."""
    return Pose(matmul(A.R, B.R), plus(A.p, rotate(A.R, B.p)))


@inlined
def inverse(X: Pose) -> Pose:
    """The parent seen from the child."""
    return Pose(transpose(X.R), negative(unrotate(X.R, X.p)))


@inlined
def motion_to_child(X: Pose, m: Motion) -> Motion:
    """A motion in parent coordinates, in child coordinates."""
    return Motion(unrotate(X.R, m.w), unrotate(X.R, plus(m.v, cross(m.w, X.p))))


@inlined
def motion_to_parent(X: Pose, m: Motion) -> Motion:
    """A motion in child coordinates, in parent coordinates."""
    w = rotate(X.R, m.w)
    return Motion(w, plus(rotate(X.R, m.v), cross(X.p, w)))


@inlined
def force_to_parent(X: Pose, f: Force) -> Force:
    """A force in child coordinates, in parent coordinates."""
    linear = rotate(X.R, f.f)
    return Force(plus(rotate(X.R, f.n), cross(X.p, linear)), linear)


@inlined
def force_to_child(X: Pose, f: Force) -> Force:
    """A force in parent coordinates, in child coordinates."""
    return Force(unrotate(X.R, minus(f.n, cross(X.p, f.f))), unrotate(X.R, f.f))


# --- rigid bodies -------------------------------------------------------------------------------------


@inlined
def add_inertia(A: Inertia, B: Inertia) -> Inertia:
    """Two bodies made one."""
    return Inertia(A.m + B.m, plus(A.h, B.h), add_sym(A.I, B.I))


@inlined
def momentum(I: Inertia, v: Motion) -> Force:
    """I v: the spatial momentum of a body of inertia I moving with v (RBDA eq. 2.63)."""
    return Force(
        plus(apply_sym(I.I, v.w), cross(I.h, v.v)),
        minus(times(I.m, v.v), cross(I.h, v.w)),
    )


@inlined
def inertia_to_parent(X: Pose, I: Inertia) -> Inertia:
    """The inertia of a body in child coordinates, in parent coordinates (RBDA eq. 2.66)."""
    a = rotate(X.R, I.h)
    b = plus(a, times(I.m, X.p))
    return Inertia(I.m, b, shifted(congruence(X.R, I.I), X.p, a, b))


@inlined
def inertia_rate(I: Inertia, v: Motion) -> Inertia:
    """d/dt I of a body that moves with v, both in one fixed frame: v×* I - I v×, ten numbers again, the mass 0.

    The rotational part is ω̃ Ī + (ω̃ Ī)ᵀ + 2 (h·l) 1 - l hᵀ - h lᵀ with v = (ω, l).
    """
    J, h, l = I.I, I.h, v.v
    x = cross(v.w, Vec(J.xx, J.xy, J.xz))
    y = cross(v.w, Vec(J.xy, J.yy, J.yz))
    z = cross(v.w, Vec(J.xz, J.yz, J.zz))
    hx, hy, hz = h.x * l.x, h.y * l.y, h.z * l.z
    return Inertia(
        0.0,
        momentum(I, v).f,
        Sym(
            2.0 * (x.x + (hy + hz)),
            (y.x + x.y) - (l.x * h.y + h.x * l.y),
            (z.x + x.z) - (l.x * h.z + h.x * l.z),
            2.0 * (y.y + (hz + hx)),
            (z.y + y.z) - (l.y * h.z + h.y * l.z),
            2.0 * (z.z + (hx + hy)),
        ),
    )


# --- parallel frames: the same axes, another origin ---------------------------------------------------


@inlined
def rotate_motion(R: Rot, m: Motion) -> Motion:
    """A motion in axes of which R gives the orientation, in the axes R is seen from; the origin is the same."""
    return Motion(rotate(R, m.w), rotate(R, m.v))


@inlined
def rotate_force(R: Rot, f: Force) -> Force:
    """A force in axes of which R gives the orientation, in the axes R is seen from; the origin is the same."""
    return Force(rotate(R, f.n), rotate(R, f.f))


@inlined
def shift_motion(p: Vec, m: Motion) -> Motion:
    """A motion seen from an origin that lies at p."""
    return Motion(m.w, plus(m.v, cross(m.w, p)))


@inlined
def shift_force(p: Vec, f: Force) -> Force:
    """A force about the origin that p starts from, about an origin that lies at p."""
    return Force(minus(f.n, cross(p, f.f)), f.f)


@inlined
def unshift_force(p: Vec, f: Force) -> Force:
    """A force about an origin that lies at p, about the origin that p starts from."""
    return Force(plus(f.n, cross(p, f.f)), f.f)


@inlined
def rotate_inertia(R: Rot, I: Inertia) -> Inertia:
    """An inertia in axes of which R gives the orientation, in the axes R is seen from; the origin is the same."""
    return Inertia(I.m, rotate(R, I.h), congruence(R, I.I))


@inlined
def unshift_inertia(p: Vec, I: Inertia) -> Inertia:
    """An inertia about an origin that lies at p, about the origin that p starts from: the parallel axis theorem."""
    h = plus(I.h, times(I.m, p))
    return Inertia(I.m, h, shifted(I.I, p, I.h, h))
