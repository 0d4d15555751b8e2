"""Spatial vectors, inertias and poses: the vocabulary of every recursion.

Notation: R. Featherstone, Rigid Body Dynamics Algorithms (RBDA, 2008), chapter 2. Angular part first.

==================  =====================================================================
Vec (x, y, z)       a vector of three numbers
Rot (xx .. zz)      a 3 x 3 matrix, row by row; for a Pose the rotation child -> parent
Sym (xx xy xz       a symmetric 3 x 3 matrix, upper triangle
yy yz zz)
Motion (w, v)       a spatial motion vector: angular, linear (velocity of the point at the origin)
Force (n, f)        a spatial force vector: moment about the origin, linear
Pose (R, p)         a frame seen from its parent: orientation and origin
Inertia (m, h, I)   a rigid body: mass, first moment m c, rotational inertia about the origin
Articulated         an articulated body inertia [I H; Hᵀ M]
(I, H, M)
Coupling (P, p)     the factor B = [P 0; -p̃ 0] of a moving body in C
==================  =====================================================================

The types are NamedTuples of plain scalars: under Numba they compile away, and in plain Python the scalars
may be anything with + - * /. Nothing in this module compares, allocates arrays or looks at a type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from .scalars import inlined

Scalar = Any  # float, or a number of an engine: recorded, exact or symbolic


class Vec(NamedTuple):
    """A vector of three numbers."""

    x: Scalar
    y: Scalar
    z: Scalar


class Rot(NamedTuple):
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


class Articulated(NamedTuple):
    """An articulated body inertia [I H; Hᵀ M] (RBDA section 7.1)."""

    I: Sym
    H: Rot
    M: Sym


class Coupling(NamedTuple):
    """What couples velocities in C for a moving body: B = [P 0; -p̃ 0], p its linear momentum (see ``coupling``)."""

    P: Rot
    p: Vec


# --- three-vectors and 3 x 3 matrices -------------------------------------------------------------------


@inlined
def zero() -> Vec:
    """The null vector."""
    return Vec(0.0, 0.0, 0.0)


@inlined
def plus(a: Vec, b: Vec) -> Vec:
    """a + b."""
    return Vec(a.x + b.x, a.y + b.y, a.z + b.z)


@inlined
def minus(a: Vec, b: Vec) -> Vec:
    """a - b."""
    return Vec(a.x - b.x, a.y - b.y, a.z - b.z)


@inlined
def negative(a: Vec) -> Vec:
    """-a."""
    return Vec(-a.x, -a.y, -a.z)


@inlined
def times(s: Scalar, a: Vec) -> Vec:
    """s a."""
    return Vec(s * a.x, s * a.y, s * a.z)


@inlined
def dot(a: Vec, b: Vec) -> Scalar:
    """a · b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@inlined
def cross(a: Vec, b: Vec) -> Vec:
    """a × b."""
    return Vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@inlined
def rotate(R: Rot, a: Vec) -> Vec:
    """R a."""
    return Vec(
        R.xx * a.x + R.xy * a.y + R.xz * a.z,
        R.yx * a.x + R.yy * a.y + R.yz * a.z,
        R.zx * a.x + R.zy * a.y + R.zz * a.z,
    )


@inlined
def unrotate(R: Rot, a: Vec) -> Vec:
    """Rᵀ a."""
    return Vec(
        R.xx * a.x + R.yx * a.y + R.zx * a.z,
        R.xy * a.x + R.yy * a.y + R.zy * a.z,
        R.xz * a.x + R.yz * a.y + R.zz * a.z,
    )


@inlined
def identity() -> Rot:
    """The 3 x 3 identity."""
    return Rot(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@inlined
def matmul(A: Rot, B: Rot) -> Rot:
    """A B."""
    return Rot(
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


@inlined
def transpose(A: Rot) -> Rot:
    """Aᵀ."""
    return Rot(A.xx, A.yx, A.zx, A.xy, A.yy, A.zy, A.xz, A.yz, A.zz)


@inlined
def apply_sym(A: Sym, a: Vec) -> Vec:
    """A a for a symmetric A."""
    return Vec(
        A.xx * a.x + A.xy * a.y + A.xz * a.z,
        A.xy * a.x + A.yy * a.y + A.yz * a.z,
        A.xz * a.x + A.yz * a.y + A.zz * a.z,
    )


@inlined
def add_sym(A: Sym, B: Sym) -> Sym:
    """A + B."""
    return Sym(A.xx + B.xx, A.xy + B.xy, A.xz + B.xz, A.yy + B.yy, A.yz + B.yz, A.zz + B.zz)


@inlined
def add_rot(A: Rot, B: Rot) -> Rot:
    """A + B."""
    return Rot(
        A.xx + B.xx, A.xy + B.xy, A.xz + B.xz,
        A.yx + B.yx, A.yy + B.yy, A.yz + B.yz,
        A.zx + B.zx, A.zy + B.zy, A.zz + B.zz,
    )  # fmt: skip


@inlined
def congruence(R: Rot, A: Sym) -> Sym:
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


# --- motions and forces ---------------------------------------------------------------------------------


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


# --- poses: changes of frame (RBDA section 2.8) ---------------------------------------------------------


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


# --- rigid bodies ---------------------------------------------------------------------------------------


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
def shifted(I: Sym, p: Vec, a: Vec, b: Vec) -> Sym:
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


@inlined
def inertia_to_parent(X: Pose, I: Inertia) -> Inertia:
    """The inertia of a body in child coordinates, in parent coordinates (RBDA eq. 2.66)."""
    a = rotate(X.R, I.h)
    b = plus(a, times(I.m, X.p))
    return Inertia(I.m, b, shifted(congruence(X.R, I.I), X.p, a, b))


@inlined
def spin_matrix(w: Vec, dw: Vec) -> Rot:
    """U = ω̇~ + ω̃²: a point at p of a body that turns so accelerates by U p against its origin."""
    xx, yy, zz = w.x * w.x, w.y * w.y, w.z * w.z
    xy, xz, yz = w.x * w.y, w.x * w.z, w.y * w.z
    return Rot(
        -(yy + zz), xy - dw.z, xz + dw.y,
        xy + dw.z, -(xx + zz), yz - dw.x,
        xz - dw.y, yz + dw.x, -(xx + yy),
    )  # fmt: skip


@inlined
def rate_of_spin(I: Sym, w: Vec, dw: Vec, U: Rot) -> Vec:
    """Ī ω̇ + ω × Ī ω with U = spin_matrix(w, dw), in fifteen products (after Khalil and Kleinfinger 1987)."""
    xx, yy, zz = w.x * w.x, w.y * w.y, w.z * w.z
    return Vec(
        I.xx * dw.x + (I.zz - I.yy) * (w.y * w.z) + I.yz * (yy - zz) + (I.xz * U.yx - I.xy * U.zx),
        I.yy * dw.y + (I.xx - I.zz) * (w.x * w.z) + I.xz * (zz - xx) + (I.xy * U.zy - I.yz * U.xy),
        I.zz * dw.z + (I.yy - I.xx) * (w.x * w.y) + I.xy * (xx - yy) + (I.yz * U.xz - I.xz * U.yz),
    )


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


# --- parallel frames: the same axes, another origin --------------------------------------------------------


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


# --- velocity against velocity: the factor B of the Coriolis matrix -----------------------------------------


@inlined
def second_moment(I: Sym) -> Sym:
    """Σ = ½ tr(Ī) 1 - Ī, the integral of r rᵀ over a body of rotational inertia Ī."""
    return Sym(
        0.5 * (I.yy + I.zz - I.xx), -I.xy, -I.xz,
        0.5 * (I.zz + I.xx - I.yy), -I.yz,
        0.5 * (I.xx + I.yy - I.zz),
    )  # fmt: skip


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


# --- articulated bodies (RBDA chapter 7) ----------------------------------------------------------------


@inlined
def articulated(I: Inertia) -> Articulated:
    """A rigid body as an articulated one: [Ī h̃; h̃ᵀ m 1]."""
    h = I.h
    return Articulated(
        I.I,
        Rot(0.0, -h.z, h.y, h.z, 0.0, -h.x, -h.y, h.x, 0.0),
        Sym(I.m, 0.0, 0.0, I.m, 0.0, I.m),
    )


@inlined
def add_articulated(A: Articulated, B: Articulated) -> Articulated:
    """A + B."""
    return Articulated(add_sym(A.I, B.I), add_rot(A.H, B.H), add_sym(A.M, B.M))


@inlined
def articulated_force(A: Articulated, a: Motion) -> Force:
    """A a."""
    return Force(
        plus(apply_sym(A.I, a.w), rotate(A.H, a.v)),
        plus(unrotate(A.H, a.w), apply_sym(A.M, a.v)),
    )


@inlined
def without(A: Articulated, U: Force, W: Force) -> Articulated:
    """A - U Wᵀ for W parallel to U: what is left of A once a joint is free to move."""
    n, f, N, F = U.n, U.f, W.n, W.f
    I, H, M = A.I, A.H, A.M
    return Articulated(
        Sym(
            I.xx - n.x * N.x, I.xy - n.x * N.y, I.xz - n.x * N.z,
            I.yy - n.y * N.y, I.yz - n.y * N.z, I.zz - n.z * N.z,
        ),
        Rot(
            H.xx - n.x * F.x, H.xy - n.x * F.y, H.xz - n.x * F.z,
            H.yx - n.y * F.x, H.yy - n.y * F.y, H.yz - n.y * F.z,
            H.zx - n.z * F.x, H.zy - n.z * F.y, H.zz - n.z * F.z,
        ),
        Sym(
            M.xx - f.x * F.x, M.xy - f.x * F.y, M.xz - f.x * F.z,
            M.yy - f.y * F.y, M.yz - f.y * F.z, M.zz - f.z * F.z,
        ),
    )  # fmt: skip


@inlined
def articulated_to_parent(X: Pose, A: Articulated) -> Articulated:
    """The articulated inertia in child coordinates, in parent coordinates: Xᵀ A X, symmetric by construction.

    With everything rotated, H' = H + p̃ M and I' = I - H p̃ + p̃ H'ᵀ.
    """
    R, p = X.R, X.p
    M = congruence(R, A.M)
    H = matmul(matmul(R, A.H), transpose(R))
    I = congruence(R, A.I)
    G = Rot(
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
