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
    Mat3,
    Sym,
    Vec,
    add,
    add_sym,
    apply_sym,
    congruence,
    cross,
    dot,
    identity,
    matmul,
    neg,
    parallel_axis,
    rotate,
    scale,
    sub,
    transpose,
    unrotate,
    zero,
)
from .scalars import Scalar, inline


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

    R: Mat3
    p: Vec


class Inertia(NamedTuple):
    """A rigid body: m mass, h = m c first moment, I rotational inertia about the origin."""

    m: Scalar
    h: Vec
    I: Sym


# --- motions and forces -------------------------------------------------------------------------------


@inline
def zero_motion() -> Motion:
    """The null motion."""
    return Motion(zero(), zero())


@inline
def zero_force() -> Force:
    """The null force."""
    return Force(zero(), zero())


@inline
def add_motion(a: Motion, b: Motion) -> Motion:
    """a + b."""
    return Motion(add(a.w, b.w), add(a.v, b.v))


@inline
def sub_motion(a: Motion, b: Motion) -> Motion:
    """a - b."""
    return Motion(sub(a.w, b.w), sub(a.v, b.v))


@inline
def scale_motion(s: Scalar, a: Motion) -> Motion:
    """s a."""
    return Motion(scale(s, a.w), scale(s, a.v))


@inline
def add_force(a: Force, b: Force) -> Force:
    """a + b."""
    return Force(add(a.n, b.n), add(a.f, b.f))


@inline
def sub_force(a: Force, b: Force) -> Force:
    """a - b."""
    return Force(sub(a.n, b.n), sub(a.f, b.f))


@inline
def scale_force(s: Scalar, a: Force) -> Force:
    """s a."""
    return Force(scale(s, a.n), scale(s, a.f))


@inline
def power(S: Motion, f: Force) -> Scalar:
    """S · f: the power of a force along a motion (RBDA eq. 2.6)."""
    return dot(S.w, f.n) + dot(S.v, f.f)


@inline
def cross_motion(v: Motion, m: Motion) -> Motion:
    """v × m (RBDA eq. 2.31)."""
    return Motion(cross(v.w, m.w), add(cross(v.w, m.v), cross(v.v, m.w)))


@inline
def cross_force(v: Motion, f: Force) -> Force:
    """v ×* f (RBDA eq. 2.32)."""
    return Force(add(cross(v.w, f.n), cross(v.v, f.f)), cross(v.w, f.f))


# --- poses: changes of frame (RBDA section 2.8) -------------------------------------------------------


@inline
def identity_pose() -> Pose:
    """The pose of a frame in itself."""
    return Pose(identity(), zero())


@inline
def compose(A: Pose, B: Pose) -> Pose:
    """A B: the frame B of the frame A, seen from A's parent."""
    return Pose(matmul(A.R, B.R), add(A.p, rotate(A.R, B.p)))


@inline
def inverse(X: Pose) -> Pose:
    """The parent seen from the child."""
    return Pose(transpose(X.R), neg(unrotate(X.R, X.p)))


@inline
def motion_to_child(X: Pose, m: Motion) -> Motion:
    """A motion from parent to child coordinates."""
    return Motion(unrotate(X.R, m.w), unrotate(X.R, add(m.v, cross(m.w, X.p))))


@inline
def motion_to_parent(X: Pose, m: Motion) -> Motion:
    """A motion from child to parent coordinates."""
    w = rotate(X.R, m.w)
    return Motion(w, add(rotate(X.R, m.v), cross(X.p, w)))


@inline
def force_to_parent(X: Pose, f: Force) -> Force:
    """A force from child to parent coordinates."""
    linear = rotate(X.R, f.f)
    return Force(add(rotate(X.R, f.n), cross(X.p, linear)), linear)


@inline
def force_to_child(X: Pose, f: Force) -> Force:
    """A force from parent to child coordinates."""
    return Force(unrotate(X.R, sub(f.n, cross(X.p, f.f))), unrotate(X.R, f.f))


# --- rigid bodies -------------------------------------------------------------------------------------


@inline
def add_inertia(A: Inertia, B: Inertia) -> Inertia:
    """The inertia of two bodies as one."""
    return Inertia(A.m + B.m, add(A.h, B.h), add_sym(A.I, B.I))


@inline
def momentum(I: Inertia, v: Motion) -> Force:
    """I v: the spatial momentum of a body of inertia I moving with v (RBDA eq. 2.63)."""
    return Force(
        add(apply_sym(I.I, v.w), cross(I.h, v.v)),
        sub(scale(I.m, v.v), cross(I.h, v.w)),
    )


@inline
def inertia_to_parent(X: Pose, I: Inertia) -> Inertia:
    """The inertia of a body from child to parent coordinates (RBDA eq. 2.66)."""
    a = rotate(X.R, I.h)
    b = add(a, scale(I.m, X.p))
    return Inertia(I.m, b, parallel_axis(congruence(X.R, I.I), X.p, a, b))


@inline
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


@inline
def rotate_motion(R: Mat3, m: Motion) -> Motion:
    """A motion from axes of orientation R to the axes that R is given in, about the same origin."""
    return Motion(rotate(R, m.w), rotate(R, m.v))


@inline
def rotate_force(R: Mat3, f: Force) -> Force:
    """A force from axes of orientation R to the axes that R is given in, about the same origin."""
    return Force(rotate(R, f.n), rotate(R, f.f))


@inline
def motion_at_child(p: Vec, m: Motion) -> Motion:
    """A motion moved from the origin that p is measured from to an origin at p."""
    return Motion(m.w, add(m.v, cross(m.w, p)))


@inline
def force_at_child(p: Vec, f: Force) -> Force:
    """A force moved from the origin that p is measured from to an origin at p."""
    return Force(sub(f.n, cross(p, f.f)), f.f)


@inline
def force_at_parent(p: Vec, f: Force) -> Force:
    """A force moved from an origin at p to the origin that p is measured from."""
    return Force(add(f.n, cross(p, f.f)), f.f)


@inline
def rotate_inertia(R: Mat3, I: Inertia) -> Inertia:
    """An inertia from axes of orientation R to the axes that R is given in, about the same origin."""
    return Inertia(I.m, rotate(R, I.h), congruence(R, I.I))


@inline
def inertia_at_parent(p: Vec, I: Inertia) -> Inertia:
    """An inertia moved from an origin at p to the one that p is measured from: the parallel axis theorem."""
    h = add(I.h, scale(I.m, p))
    return Inertia(I.m, h, parallel_axis(I.I, p, I.h, h))
