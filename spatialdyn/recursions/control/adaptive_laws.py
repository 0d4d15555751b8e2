"""Adaptive laws: torques from estimated inertial parameters, which are updated by the tracking error.

With v_r = v_d + Λ e, a_r = a_d + Λ ė and s = v - v_r, the torque is M̂ a_r + Ĉ v_r + ĝ - K s with estimates π̂, and the
update follows y = Yᵀ s, Y the regressor of that torque. No regressor is formed: Y is linear in the axes S, so y uses
the velocity of a body due to s in place of the axes.

Euclidean (Slotine and Li, 1987)     π̂⁺ = π̂ - h Γ y
natural (Lee, Kwon, Park, 2018)      P̂⁺ = G exp(-h/γ Gᵀ L G) Gᵀ,  P̂ = G Gᵀ

P = [Σ h; hᵀ m], with Σ = ½ tr(Ī) 1 - Ī, is the pseudo-inertia, and tr(L P) = y·π. A body's inertia is physical exactly
if P is positive definite, which a factor G ensures for any step. The state is the difference from the first estimate of
π̂ or G, so that it begins at 0. For exp(A), A is scaled to a norm of at most 1, and exp(A/8) is a Taylor series,
squared twice to exp(A/2).

Friction F̂_c tanh(v/ε) + b̂ v is learnt with Γ_f as π̂ is, and stays >= 0.

Sources: Slotine and Li, On the adaptive control of robot manipulators (1987); Lee, Kwon and Park, A natural adaptive
control law for robot manipulators (2018); the discrete step, which needs no Cholesky factors, is a derivation of ours.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec
from ...algebra.public_arrays import write_parameters
from ...algebra.records import motion_of, pose_of, put_motion, table_dtype
from ...algebra.scalars import Scalar, inline, select, sqrt
from ...algebra.spatial import (
    Force,
    Motion,
    Pose,
    add_inertia,
    add_motion,
    cross_motion,
    motion_to_child,
    scale_motion,
    sub_motion,
    zero_motion,
)
from ...bodies.joints import joint_motion
from ..joints.friction import smooth_sign
from ..momenta.adaptive_regressors import along
from ..momenta.coriolis import modified_sweeps
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from .control_laws import errors, product

WORK = table_dtype(
    X=Pose,  # of modified_rnea, as are v, w, a and f
    v=Motion,
    w=Motion,
    a=Motion,
    f=Force,
    s=Motion,  # velocity of the body due to s; outward
    g=Vec,  # gravity with opposite sign, in the axes of the row; outward
)
TERMS = 8  # of the series of exp
TABLE = ("njoints", 10)


class Aim(NamedTuple):
    """The reference motion and the gains of a law."""

    rates: Array
    gain: Array
    q_ref: Config
    v_ref: Vector
    a_ref: Vector


class Euclidean(NamedTuple):
    """Parameters of the Euclidean law: tables (njoints, 10), except the last."""

    first: Array
    step: Array
    least: Array
    most: Array
    deadzone: Vector


class Natural(NamedTuple):
    """Parameters of the natural law: factors (njoints, 4, 4), and 1/γ (njoints)."""

    first: Array
    step: Vector
    deadzone: Vector


class Wear(NamedTuple):
    """Parameters of learning friction: tables (2, nv), except the first."""

    smoothing: Vector
    friction: Matrix
    friction_step: Matrix


class Scratch(NamedTuple):
    """Scratch of both laws."""

    v_r: Vector = ("nv",)
    a_r: Vector = ("nv",)
    s: Vector = ("nv",)
    pi: Array = TABLE
    y: Array = TABLE
    e: Vector = ("nv",)
    ten: Matrix = (3, 10)


class NaturalScratch(NamedTuple):
    """Scratch of the natural law."""

    G: Array = ("njoints", 4, 4)
    A: Matrix = (4, 4)
    E: Matrix = (4, 4)
    T: Matrix = (4, 4)


@inline
def follow(bodies: Bodies, q: Config, v: Vector, aim: Aim, x: Scratch) -> None:
    """v_r = v_d + Λ e, a_r = a_d + Λ ė and s = v - v_r; v_ref and a_ref may be None, for zero."""
    n = len(v)
    errors(bodies, q, v, aim.q_ref, aim.v_ref, x.v_r, x.a_r)
    for i in range(n):
        x.s[i] = product(aim.rates, x.v_r, i)
    for i in range(n):
        x.v_r[i] = x.s[i] if aim.v_ref is None else x.s[i] + aim.v_ref[i]
    for i in range(n):
        x.s[i] = product(aim.rates, x.a_r, i)
    for i in range(n):
        x.a_r[i] = x.s[i] if aim.a_ref is None else x.s[i] + aim.a_ref[i]
    for i in range(n):
        x.s[i] = v[i] - x.v_r[i]


@inline
def torques(bodies: Bodies, work: Work, q: Config, v: Vector, gain: Array, x: Scratch, tau: Vector) -> None:
    """τ = M̂ a_r + Ĉ v_r + ĝ - K s."""
    modified_sweeps(bodies, work, q, v, x.v_r, x.a_r, x.pi, tau)
    for i in range(len(v)):
        tau[i] = tau[i] - product(gain, x.s, i)


@inline
def beyond(s: Vector, deadzone: Vector) -> Scalar:
    """1 where |s| is larger than the deadzone, else 0."""
    size = 0.0
    for i in range(len(s)):
        size = size + s[i] * s[i]
    return select(size - deadzone[0] * deadzone[0], 1.0, 0.0)


@inline
def learn(bodies: Bodies, work: Work, s: Vector, deadzone: Vector, y: Array) -> None:
    """y = Yᵀ s (njoints, 10), 0 where |s| is at most the deadzone; the scratch is that of ``torques``."""
    on = beyond(s, deadzone)
    y[:] = 0.0
    put_motion(work[0].s, zero_motion())
    for i in range(1, len(bodies)):
        here, parent = work[i], work[bodies[i].parent]
        put_motion(
            here.s, add_motion(motion_to_child(pose_of(here.X), motion_of(parent.s)), joint_motion(bodies, i, s))
        )
        if bodies[i].joint > 0:
            v, w, T = motion_of(here.v), motion_of(here.w), scale_motion(on, motion_of(here.s))
            half_v, half_w = scale_motion(0.5, v), scale_motion(0.5, w)
            rate = sub_motion(motion_of(here.a), cross_motion(half_v, w))
            turned = add_inertia(along(cross_motion(T, half_v), w), along(cross_motion(T, half_w), v))
            write_parameters(y[bodies[i].joint], add_inertia(along(T, rate), turned))


@inline
def within(x: Scalar, least: Scalar, most: Scalar) -> Scalar:
    """x, not below the least and not above the most."""
    x = select(x - least, x, least)
    return select(most - x, x, most)


@inline
def add_friction(v: Vector, wear: Wear, worn: Array, tau: Vector) -> None:
    """τ += F̂_c tanh(v/ε) + b̂ v."""
    first = wear.friction
    for i in range(len(v)):
        sign = smooth_sign(v[i], wear.smoothing[i])
        tau[i] = tau[i] + (first[0, i] + worn[0, i]) * sign + (first[1, i] + worn[1, i]) * v[i]


@inline
def learn_friction(v: Vector, s: Vector, wear: Wear, worn: Array, dt: Scalar, after: Vector) -> None:
    """F̂_c and b̂, less the first estimates, after a step; the estimates stay >= 0."""
    n, first, step = len(v), wear.friction, wear.friction_step
    for i in range(n):
        sign = smooth_sign(v[i], wear.smoothing[i])
        dry = worn[0, i] - dt * step[0, i] * (sign * s[i]) + first[0, i]
        wet = worn[1, i] - dt * step[1, i] * (v[i] * s[i]) + first[1, i]
        after[i] = select(dry, dry, 0.0) - first[0, i]
        after[n + i] = select(wet, wet, 0.0) - first[1, i]


# --- the Euclidean law ----------------------------------------------------------------------------------


@inline
def euclidean(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Euclidean, learnt: Array, tau: Vector,
    after: Vector, x: Scratch,
) -> None:  # fmt: skip
    """τ from π̂ = first + learnt, and ``learnt`` at the end of the step."""
    act_euclidean(bodies, work, q, v, aim, by, learnt, tau, x)
    move_euclidean(dt, by, after, x)


@inline
def act_euclidean(
    bodies: Bodies, work: Work, q: Config, v: Vector, aim: Aim, by: Euclidean, learnt: Array, tau: Vector, x: Scratch
) -> None:  # fmt: skip
    """τ, and y."""
    follow(bodies, q, v, aim, x)
    for j in range(len(x.pi)):
        for k in range(10):
            x.pi[j, k] = by.first[j, k] + learnt[j, k]
    torques(bodies, work, q, v, aim.gain, x, tau)
    learn(bodies, work, x.s, by.deadzone, x.y)


@inline
def move_euclidean(dt: Scalar, by: Euclidean, after: Vector, x: Scratch) -> None:
    """``learnt`` at the end of the step, from y."""
    pi = x.pi
    for j in range(len(pi)):
        for k in range(10):
            moved = pi[j, k] - dt * (by.step[j, k] * x.y[j, k])
            after[10 * j + k] = within(moved, by.least[j, k], by.most[j, k]) - by.first[j, k]


@inline
def euclidean_with_friction(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Euclidean, wear: Wear, learnt: Array,
    worn: Array, tau: Vector, after: Vector, worn_after: Vector, x: Scratch,
) -> None:  # fmt: skip
    """``euclidean``, with friction."""
    euclidean(bodies, work, q, v, dt, aim, by, learnt, tau, after, x)
    add_friction(v, wear, worn, tau)
    learn_friction(v, x.s, wear, worn, dt, worn_after)


# --- the natural law ------------------------------------------------------------------------------------


@inline
def natural(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Natural, learnt: Array, tau: Vector,
    after: Vector, x: Scratch, own: NaturalScratch,
) -> None:  # fmt: skip
    """τ from P̂ = G Gᵀ with G = first + learnt (njoints, 4, 4), and ``learnt`` at the end of the step."""
    act_natural(bodies, work, q, v, aim, by, learnt, tau, x, own)
    move_natural(dt, by, after, x, own)


@inline
def act_natural(
    bodies: Bodies, work: Work, q: Config, v: Vector, aim: Aim, by: Natural, learnt: Array, tau: Vector, x: Scratch,
    own: NaturalScratch,
) -> None:  # fmt: skip
    """τ, and y."""
    G = own.G
    follow(bodies, q, v, aim, x)
    for j in range(len(G)):
        for k in range(4):
            for m in range(4):
                G[j, k, m] = by.first[j, k, m] + learnt[j, k, m]
        parameters_of_factor(G[j], x.pi[j])
    torques(bodies, work, q, v, aim.gain, x, tau)
    learn(bodies, work, x.s, by.deadzone, x.y)


@inline
def move_natural(dt: Scalar, by: Natural, after: Vector, x: Scratch, own: NaturalScratch) -> None:
    """``learnt`` at the end of the step, from y."""
    G, E = own.G, own.E
    for j in range(len(G)):
        conjugate(G[j], x.y[j], -(dt * by.step[j]), own.A, own.T)
        half_exponential(own.A, E, own.T)
        for k in range(4):
            for m in range(4):
                moved = G[j, k, 0] * E[0, m] + G[j, k, 1] * E[1, m] + G[j, k, 2] * E[2, m] + G[j, k, 3] * E[3, m]
                after[16 * j + 4 * k + m] = moved - by.first[j, k, m]


@inline
def natural_with_friction(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Natural, wear: Wear, learnt: Array,
    worn: Array, tau: Vector, after: Vector, worn_after: Vector, x: Scratch, own: NaturalScratch,
) -> None:  # fmt: skip
    """``natural``, with friction."""
    natural(bodies, work, q, v, dt, aim, by, learnt, tau, after, x, own)
    add_friction(v, wear, worn, tau)
    learn_friction(v, x.s, wear, worn, dt, worn_after)


@inline
def parameters_of_factor(G: Matrix, pi: Vector) -> None:
    """π of P = G Gᵀ."""
    xx, yy, zz = rows_product(G, 0, 0), rows_product(G, 1, 1), rows_product(G, 2, 2)
    pi[0] = rows_product(G, 3, 3)
    pi[1], pi[2], pi[3] = rows_product(G, 0, 3), rows_product(G, 1, 3), rows_product(G, 2, 3)
    pi[4], pi[6], pi[9] = yy + zz, zz + xx, xx + yy
    pi[5], pi[7], pi[8] = -rows_product(G, 0, 1), -rows_product(G, 0, 2), -rows_product(G, 1, 2)


@inline
def rows_product(G: Matrix, i: int, j: int) -> Scalar:
    """Entry i, j of G Gᵀ."""
    return G[i, 0] * G[j, 0] + G[i, 1] * G[j, 1] + G[i, 2] * G[j, 2] + G[i, 3] * G[j, 3]


@inline
def conjugate(G: Matrix, y: Vector, scale: Scalar, A: Matrix, T: Matrix) -> None:
    """A = scale Gᵀ L G with tr(L P) = y·π, scaled down to a Frobenius norm of at most 1."""
    T[0, 0], T[1, 1], T[2, 2], T[3, 3] = y[6] + y[9], y[9] + y[4], y[4] + y[6], y[0]
    T[0, 1], T[0, 2], T[1, 2] = -0.5 * y[5], -0.5 * y[7], -0.5 * y[8]
    T[0, 3], T[1, 3], T[2, 3] = 0.5 * y[1], 0.5 * y[2], 0.5 * y[3]
    for i in range(4):
        for j in range(i):
            T[i, j] = T[j, i]
    size = 0.0
    for i in range(4):
        for j in range(i, 4):
            x = 0.0
            for k in range(4):
                for m in range(4):
                    x = x + G[k, i] * (T[k, m] * G[m, j])
            A[i, j] = scale * x
            A[j, i] = A[i, j]
            size = size + (1.0 if i == j else 2.0) * (A[i, j] * A[i, j])
    size = sqrt(size)
    shrink = 1.0 / select(size - 1.0, size, 1.0)
    for i in range(4):
        for j in range(4):
            A[i, j] = shrink * A[i, j]


@inline
def half_exponential(A: Matrix, E: Matrix, T: Matrix) -> None:
    """E = exp(A/2) of a symmetric A whose norm is at most 1: the series of exp(A/8), squared twice."""
    for i in range(4):
        for j in range(4):
            E[i, j] = 1.0 if i == j else 0.0
    for term in range(TERMS, 0, -1):  # E = 1 + A/8 E / term
        multiply(A, E, 0.125 / term, T)
        for i in range(4):
            for j in range(4):
                E[i, j] = T[i, j] + 1.0 if i == j else T[i, j]
    multiply(E, E, 1.0, T)
    multiply(T, T, 1.0, E)


@inline
def multiply(A: Matrix, B: Matrix, scale: float, out: Matrix) -> None:
    """scale A B (4, 4), of symmetric matrices that commute: symmetric."""
    for i in range(4):
        for j in range(i, 4):
            x = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j] + A[i, 3] * B[3, j]
            out[i, j] = scale * x
            out[j, i] = out[i, j]
