"""The terms of rotors that turn on the body before their joint: steps that the recursions share.

The rotor of joint i has the axial inertia J and turns at n q̇ about the axis e of the body p that the joint stands on.
Its mass, and its inertia at rest, are part of p's. Its rotation adds to the kinetic energy

    ½ n² J q̇² + n J q̇ e·ω

with ω of p. The first term is the armature of row i. The second gives p the momentum n J q̇ e, a couple, which is the
same about every origin, and gives row i the momentum n J e·ω. In the equation of motion they become

    n J (q̈ e + q̇ ω × e)  on p,    n J e·ω̇  on row i,

and in every recursion a unit of q̇ of row i has the couple n J e in p beside the momentum of the bodies that it moves.
The column ``rotor`` holds n J e; it is zero, and ``geared`` is 0, for a row that stands on the world, where ω = 0.

A derivation of our own: the rotor as a further body of each recursion, tied to its joint by θ̇ = n q̇.
"""

from __future__ import annotations

from ...algebra.coriolis_factor import CoriolisFactor
from ...algebra.euclidean import Mat3, Vec, add, cross, dot, rotate, scale, unrotate, zero
from ...algebra.records import force_of, mat3_of, motion_of, pose_of, put_force, vec_of
from ...algebra.scalars import Scalar, inline
from ...algebra.spatial import Force, Pose
from ...bodies.table import ALONG
from ..signatures import Bodies, Record, Vector, Work


@inline
def of_other(bodies: Bodies, i: int, x: Vector) -> Scalar:
    """Σ coupling x over the rows that share motors with row i: the part of M x beside the armatures' terms."""
    b = bodies[i]
    total = 0.0
    if b.coupled:
        total = total + b.coupling * x[b.parent - 1]
    if b.partner > 0:
        total = total + bodies[b.partner].coupling * x[b.partner - 1]
    return total


@inline
def add_motor_inertia(bodies: Bodies, i: int, a: Vector, t: Scalar) -> Scalar:
    """t plus the torque that accelerates the motors of row i: its own, and those shared with another row."""
    if a is not None:
        b = bodies[i]
        t = t + b.armature * a[i - 1]
        if b.coupled or b.partner > 0:
            t = t + of_other(bodies, i, a)
    return t


@inline
def add_rotor_forces(b: Record, parent: Record, i: int, v: Vector, a: Vector, t: Scalar) -> Scalar:
    """t + n J e·ω̇ for the rotor of row i in ``rnea``; its couple n J (q̈ e + q̇ ω × e) is added to the parent's f."""
    e = vec_of(b.rotor)
    if v is not None:
        t = t + dot(e, vec_of(parent.dw))
        put_force(parent.f, add_couple(force_of(parent.f), scale(v[i - 1], cross(vec_of(parent.w), e))))
    elif a is not None:
        t = t + dot(e, vec_of(parent.dw))
    if a is not None:
        put_force(parent.f, add_couple(force_of(parent.f), scale(a[i - 1], e)))
    return t


@inline
def add_couple(f: Force, n: Vec) -> Force:
    """The sum of a force and a couple."""
    return Force(add(f.n, n), f.f)


@inline
def in_row_axes(b: Record, X: Pose) -> Vec:
    """n J e of row b in its own axes, X its pose in its parent; constant where the joint turns about e."""
    if b.geared == ALONG:
        return unrotate(mat3_of(b.X.R), vec_of(b.rotor))
    return unrotate(X.R, vec_of(b.rotor))


@inline
def rotor_couple(b: Record, w: Vec, v: Scalar, a: Scalar) -> Vec:
    """n J (q̈ e + q̇ ω × e), in the axes of the body that carries the rotor."""
    e = vec_of(b.rotor)
    return add(scale(a, e), scale(v, cross(w, e)))


@inline
def rotor_in_root_axes(bodies: Bodies, work: Work, i: int) -> tuple[Vec, Vec]:
    """n J e of row i and its rate ω × n J e, in root-aligned or world axes: those of X and v in the scratch."""
    parent = work[bodies[i].parent]
    e = rotate(pose_of(parent.X).R, vec_of(bodies[i].rotor))
    return e, cross(motion_of(parent.v).w, e)


@inline
def rotor_factor(v: Scalar, e: Vec) -> CoriolisFactor:
    """-½ q̇ n J e~, the rotor's term in the factor B of the body that carries it."""
    x, y, z = 0.5 * v * e.x, 0.5 * v * e.y, 0.5 * v * e.z
    return CoriolisFactor(Mat3(0.0, z, -y, -z, 0.0, x, y, -x, 0.0), zero())


@inline
def add_rotor_momentum(bodies: Bodies, i: int, v: Vector, p: Force) -> Force:
    """p plus the momentum of the rotor of row i, both in the axes of the body that carries it."""
    if bodies[i].geared:
        return add_couple(p, scale(v[i - 1], vec_of(bodies[i].rotor)))
    return p
