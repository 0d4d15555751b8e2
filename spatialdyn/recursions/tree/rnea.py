"""Inverse dynamics τ = M(q) q̈ + C(q, q̇) q̇ + g(q) by the recursive Newton-Euler algorithm."""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import (
    Vec,
    acceleration_matrix,
    add,
    cross,
    neg,
    newton_euler_moment,
    rotate,
    scale,
    unrotate,
    zero,
)
from ...algebra.public_arrays import read_force
from ...algebra.records import force_of, inertia_of, motion_of, pose_of, put_force, put_vec, table_dtype, vec_of
from ...algebra.scalars import inline, inline_or_by_rows
from ...algebra.spatial import Force, Inertia, Pose, add_force, force_to_parent, power, sub_force, zero_force
from ...bodies.joints import joint_motion, place_joint
from ...bodies.kinds import CONTINUED
from ..signatures import Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT, FEXT_OPTIONAL, TAU, TURNED_Q, A, Spec, V
from .rnea_off_norm import add_off_norm_forces
from .rotors import add_motor_inertia, add_rotor_forces

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    w=Vec,  # ω; outward
    dw=Vec,  # ω̇; outward
    dv=Vec,  # v̇ of the origin, the classical acceleration, less gravity; outward
    f=Force,  # force that moves the body, outward; that its joint transmits, inward
)


@inline_or_by_rows
def rnea(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, fext: Matrix, tau: Vector) -> None:
    """RBDA table 5.1 in body coordinates and classical accelerations; v, a, fext may be None, for zero.

    Each body has ω, ω̇ and the acceleration a of its origin, as in Luh, Walker and Paul: without linear velocities a
    fifth of the work is saved. The comment above each block is its line of table 5.1. What passes between a row and the
    row behind it stays in registers: through memory the sweeps would wait for each row.
    """
    m = put_world(work, vec_of(bodies[0].gravity))
    put_force(work[0].f, zero_force())

    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        # v_i = X v_λ + S q̇,   a_i = X a_λ + S q̈ + v_i × S q̇
        m = classical_motion(bodies, work, i, v, a, m)
        # f_i = I a_i + v_i ×* I v_i - f_ext, zero on rows before the body's
        f = zero_force()
        if b.joint > 0:
            f = newton_euler(inertia_of(b.inertia), m, v, a)
            if fext is not None:
                f = sub_force(f, read_force(fext[b.joint]))
        put_force(here.f, f)
    add_off_norm_forces(bodies, work, q, v)

    passed = zero_force()
    for i in range(len(bodies) - 1, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        f = add_force(force_of(here.f), passed)
        put_force(here.f, f)
        # τ_i = S·f_i
        t = add_motor_inertia(bodies, i, a, power(motion_of(b.S), f))
        # f_λ += X* f_i
        if b.kind != CONTINUED:
            f = force_to_parent(pose_of(here.X), f)
        passed = f
        if b.parent < i - 1 or b.geared:
            put_force(parent.f, add_force(force_of(parent.f), f))
            passed = zero_force()
        if b.geared:
            t = add_rotor_forces(b, parent, i, v, a, t)
        tau[i - 1] = t


class Accelerated(NamedTuple):
    """Motion of a body in its own frame: w its ω, dw ω̇, dv the classical acceleration of its origin, less gravity."""

    w: Vec
    dw: Vec
    dv: Vec


@inline
def put_world(work: Work, gravity: Vec) -> Accelerated:
    """Write the motion of the world, which accelerates upwards in place of gravity, and return it."""
    m = Accelerated(zero(), zero(), neg(gravity))
    put_vec(work[0].w, m.w)
    put_vec(work[0].dw, m.dw)
    put_vec(work[0].dv, m.dv)
    return m


@inline
def classical_motion(bodies: Bodies, work: Work, i: int, v: Vector, a: Vector, before: Accelerated) -> Accelerated:
    """Write and return the motion of row i, from that of the row before it or of its parent in the scratch.

    Its joint moves by S q̇ = (w, l) and lies at p in its parent λ:

        ω = Rᵀ ω_λ + w
        ω̇ = Rᵀ ω̇_λ + S_w q̈ + ω × w
        a = Rᵀ (a_λ + U_λ p) + S_l q̈ + (2 ω - w) × l,    U = ω̇~ + ω̃².

    A further row of a joint lies where its parent does, and q̇ is in the joint's first row: only q̈ is added there.
    Terms that are 0 because v or a is None are neither computed nor written.
    """
    b, here = bodies[i], work[i]
    X, S = pose_of(here.X), motion_of(b.S)
    w, dw, ai = before
    if b.parent < i - 1:
        parent = work[b.parent]
        w = w if v is None else vec_of(parent.w)
        dw = dw if v is None and a is None else vec_of(parent.dw)
        ai = vec_of(parent.dv)
    if b.kind != CONTINUED:
        if v is not None:
            ai = add(ai, rotate(acceleration_matrix(w, dw), X.p))
        elif a is not None:
            ai = add(ai, cross(dw, X.p))
        ai = unrotate(X.R, ai)
        if v is not None:
            vJ = joint_motion(bodies, i, v)
            w = add(unrotate(X.R, w), vJ.w)
            dw = add(unrotate(X.R, dw), cross(w, vJ.w))
            ai = add(ai, cross(add(w, add(w, neg(vJ.w))), vJ.v))
        elif a is not None:
            dw = unrotate(X.R, dw)
    if a is not None:
        dw = add(dw, scale(a[i - 1], S.w))
        ai = add(ai, scale(a[i - 1], S.v))
    if v is not None:
        put_vec(here.w, w)
    if v is not None or a is not None:
        put_vec(here.dw, dw)
    put_vec(here.dv, ai)
    return Accelerated(w, dw, ai)


@inline
def newton_euler(I: Inertia, m: Accelerated, v: Vector, a: Vector) -> Force:
    """Force that moves a body: linear m a + U h, moment about its origin Ī ω̇ + ω × Ī ω + h × a."""
    if v is None and a is None:
        return Force(cross(I.h, m.dv), scale(I.m, m.dv))
    U = acceleration_matrix(m.w, m.dw)
    moment = add(newton_euler_moment(I.I, m.w, m.dw, U), cross(I.h, m.dv))
    return Force(moment, add(scale(I.m, m.dv), rotate(U, I.h)))


_SOURCE = "Featherstone, RBDA (2008), table 5.1, in classical accelerations (Luh, Walker, Paul 1980)."
SPECS = (
    Spec(
        "rnea", rnea, WORK, (TURNED_Q, V, A, FEXT_OPTIONAL), TAU,
        "Inverse dynamics τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext by the recursive Newton-Euler algorithm.", _SOURCE,
        regroup=True,
    ),
    Spec(
        "nonlinear_effects", rnea, WORK, (TURNED_Q, V, None, None), TAU,
        "Bias torque C(q, v) v + g(q): the torque at zero acceleration.", _SOURCE, regroup=True,
    ),
    Spec(
        "generalized_gravity", rnea, WORK, (TURNED_Q, None, None, None), TAU,
        "Gravity torque g(q) = ∂V/∂q: the torque that holds the robot still.", _SOURCE, regroup=True,
    ),
    Spec(
        "static_torque", rnea, WORK, (TURNED_Q, None, None, FEXT), TAU,
        "Torque g(q) - Σ Jᵀ fext that holds the robot still under external forces.", _SOURCE,
        regroup=True,
    ),
)  # fmt: skip
