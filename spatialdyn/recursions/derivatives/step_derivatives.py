"""Derivatives of explicit steps with respect to the state before and the torques, and of the equation of motion.

A step takes (q, v) to (q⁺, v⁺) under a constant torque. With δq the displacement of a joint in its own body's frame
and δ = (δq, δv, δτ), each quantity of the step has a matrix of 3 nv columns, its derivative by δ. By ``dintegrate``
q ∘ exp(u) changes by P δq + R δu, by ``aba_derivatives`` the acceleration by D_q δq + D_v δv + M⁻¹ δτ, and in the
Runge-Kutta method, on u̇ = T(u) w, the rate by ∂(T(u) w)/∂u δu + T(u) δw. The rest is the chain rule, stage by stage.

The result has 2 nv rows, for δq⁺ and δv⁺. For robots with joints of several freedoms it has one more row, whose first
entry is the square of the largest angle by which such a joint turns in the step or a part of it: at 2π exp is singular,
and a step of more than π is useless.

Derived here from the steps as ``simulation.methods.explicit`` has them, after Munthe-Kaas, High order Runge-Kutta
methods on manifolds (1999), for the derivative of exp in closed form.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from ...algebra.euclidean import Vec, dot, neg, scale
from ...algebra.lie import Tangent, turned_diagonal
from ...algebra.scalars import Scalar, inline, no_inline, select
from ...algebra.spatial import Motion, add_motion
from ...bodies.kinds import NV, SE2, SE3
from ..coordinates.configuration import (
    dintegrate,
    displacement_rate_derivatives,
    integrate,
    put_tangent,
    put_twist,
    twist,
)
from ..coordinates.coordinate_rates import begun, is_free, kept
from ..joints.friction import LAW, SMOOTHING, SmoothLaw, friction_torque, smooth_friction_slope
from ..signatures import Array, Bodies, Config, Matrix, Record, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V
from .derivatives import WORK, aba_derivatives_by_factor

RK4_NODES, RK4_WEIGHTS = (0.0, 0.5, 0.5, 1.0), (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


_WIDE = "nv+nv+nv"  # columns of a derivative by (q, v, τ)


class DerivativeScratch(NamedTuple):
    """Scratch of the derivatives of a step."""

    stage: Vector = ("nq",)  # the configuration of a stage
    u: Vector = ("nv",)  # displacement of a stage from q
    w: Vector = ("nv",)  # velocity of a stage
    a: Vector = ("nv",)  # acceleration of a stage
    rate: Vector = ("nv",)  # u̇ of a stage
    moved: Vector = ("nv",)  # displacement of the step
    spare: Vector = ("nv",)  # pivots of later stages
    rubbed: Matrix = (2, "nv")  # torques with friction, slopes of friction by v
    D: Array = (3, "nv", "nv")  # of ``aba_derivatives``
    inverse: Matrix = ("nv", "nv")  # M⁻¹
    by_step: Array = (2, "nv", "nv")  # P and R of ``dintegrate``
    by_rate: Array = (2, "nv", "nv")  # ∂(T(u) w)/∂u and T(u)
    U: Matrix = ("nv", _WIDE)  # derivatives of u
    W: Matrix = ("nv", _WIDE)  # of w
    Ku: Matrix = ("nv", _WIDE)  # of the rate of u
    Ka: Matrix = ("nv", _WIDE)  # of a
    by_q: Matrix = ("nv", _WIDE)  # of the stage's configuration
    moved_by: Matrix = ("nv", _WIDE)  # of the displacement of the step
    changed_by: Matrix = ("nv", _WIDE)  # of the change of v


class MotionScratch(NamedTuple):
    """Scratch of ``motion_derivatives``, as of ``DerivativeScratch``."""

    a: Vector = ("nv",)
    D: Array = (3, "nv", "nv")
    inverse: Matrix = ("nv", "nv")
    rubbed: Matrix = (2, "nv")


@inline
def explicit_euler_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, law: SmoothLaw,
    out: Matrix, pivots: Vector, s: DerivativeScratch,
) -> None:  # fmt: skip
    """q⁺ = q ∘ exp(h v), v⁺ = v + h a: a Runge-Kutta method of one stage."""
    _runge_kutta((0.0,), (1.0,), bodies, work, q, v, tau, fext, dt, law, out, pivots, s)


@inline
def rk4_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, law: SmoothLaw,
    out: Matrix, pivots: Vector, s: DerivativeScratch,
) -> None:  # fmt: skip
    """The classical method of order 4 on (u, v), q(t) = q ∘ exp(u(t))."""
    _runge_kutta(RK4_NODES, RK4_WEIGHTS, bodies, work, q, v, tau, fext, dt, law, out, pivots, s)


@inline
def _runge_kutta(
    nodes: tuple[float, ...], weights: tuple[float, ...], bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector,
    fext: Matrix, dt: Vector, law: SmoothLaw, out: Matrix, pivots: Vector, s: DerivativeScratch,
) -> None:  # fmt: skip
    """A Runge-Kutta method in which each stage depends only on the stage before; fext may be None, for zero."""
    n, stage, u, w, a, rate, moved = len(bodies) - 1, s.stage, s.u, s.w, s.a, s.rate, s.moved
    by_step, by_rate, U, W, Ku, Ka, by_q = s.by_step, s.by_rate, s.U, s.W, s.Ku, s.Ka, s.by_q
    for x in (a, rate, moved):
        x[:] = 0.0
    for X in (Ku, Ka, s.moved_by, s.changed_by):
        X[:] = 0.0
    turn = 0.0
    for k in range(len(nodes)):
        h = nodes[k] * dt[0]
        for i in range(n):
            u[i], w[i] = h * rate[i], v[i] + h * a[i]
        _scaled(h, Ku, U)
        _scaled(h, Ka, W)
        _add_unit(1, W)
        turn = largest_turn(bodies, u, turn)
        for i in range(len(q)):
            stage[i] = q[i]
        if k > 0:
            integrate(bodies, q, u, stage)
        dintegrate(bodies, q, u, by_step)
        displacement_rate_derivatives(bodies, u, w, by_rate)
        # u̇ = T(u) w and the acceleration of the stage, with their derivatives
        for i in range(n):
            rate[i] = 0.0
        _add_turned(bodies, by_rate[1], w, rate)
        Ku[:] = 0.0
        _add_blocks(bodies, by_rate[0], U, Ku)
        _add_blocks(bodies, by_rate[1], W, Ku)
        acceleration_derivatives(bodies, work, stage, w, tau, fext, law, s.D, s.spare, a, s.inverse, s.rubbed)
        if k == 0:
            pivots[:] = s.spare
        _moved(bodies, by_step, U, by_q)
        _acceleration(s.D, by_q, W, Ka)
        h = weights[k] * dt[0]
        for i in range(n):
            moved[i] = moved[i] + h * rate[i]
        _add_scaled(h, Ku, s.moved_by)
        _add_scaled(h, Ka, s.changed_by)
    turn = largest_turn(bodies, moved, turn)
    dintegrate(bodies, q, moved, by_step)
    _moved(bodies, by_step, s.moved_by, out[:n])
    out[n : 2 * n] = s.changed_by
    _add_unit(1, out[n : 2 * n])
    _put_turn(turn, n, out)


@inline
def semi_implicit_euler_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, law: SmoothLaw,
    out: Matrix, pivots: Vector, s: DerivativeScratch,
) -> None:  # fmt: skip
    """v⁺ = v + h a, q⁺ = q ∘ exp(h v⁺); joints that turn and travel follow ``simulation.methods.explicit.turn``.

    For these x = v + h (a + ω × v) is the linear velocity in the axes of the beginning, q⁺ = q ∘ exp(h x) ∘ exp(h ω⁺),
    and Rᵀ x the velocity after the step, R the rotation by h ω⁺; the terms that keep the momenta of free bodies are
    added to both.
    """
    n, h, u, w, a, D, by_step, U = len(bodies) - 1, dt[0], s.u, s.w, s.a, s.D, s.by_step, s.U
    acceleration_derivatives(bodies, work, q, v, tau, fext, law, D, pivots, a, s.inverse, s.rubbed)
    for i in range(n):
        u[i] = h * (v[i] + h * a[i])
        for j in range(n):
            for k in range(3):
                out[n + i, k * n + j] = h * D[k, i, j]
    _add_unit(1, out[n : 2 * n])
    turns = 0
    for i in range(1, n + 1):
        turns += int(travels(bodies[i]))
    if turns == 0:
        _scaled(h, out[n : 2 * n], U)
        dintegrate(bodies, q, u, by_step)
        _moved(bodies, by_step, U, out[:n])
        _put_turn(largest_turn(bodies, u, 0.0), n, out)
        return
    for i in range(n):
        w[i] = v[i] + h * a[i]
    first, moved, x, by_turn = s.rate, s.W, s.Ka, s.by_rate
    for i in range(n):
        first[i] = 0.0
    _scaled(0.0, out[n : 2 * n], U)
    for i in range(1, n + 1):
        b, r = bodies[i], i - 1
        if travels(b):
            m = twist(b, r, v)
            put_twist(b, r, add_motion(twist(b, r, w), begun(bodies, i, h, m)), D[0, 0])
            crossed = Tangent(turned_diagonal(0.0, scale(h, m.w)), turned_diagonal(0.0, scale(-h, m.v)))
            put_tangent(b, r, crossed, 0.0, D, 1)
            lengths = NV[b.kind] - (1 if NV[b.kind] == 3 else 3)
            for k in range(r + lengths, r + NV[b.kind]):
                w[k] = D[0, 0, k]
                u[k] = h * w[k]
            _add_kept(bodies, i, lengths, h, m.w, first, out)
            for k in range(r, r + lengths):
                w[k] = D[0, 0, k]
                first[k], u[k] = h * w[k], 0.0
                for l in range(r, r + NV[b.kind]):
                    out[n + k, n + l] = out[n + k, n + l] + D[1, k, l]
                for l in range(3 * n):
                    U[k, l] = h * out[n + k, l]
    dintegrate(bodies, q, first, by_step)
    _moved(bodies, by_step, U, moved)  # of q ∘ exp(h x)
    for i in range(n):
        for l in range(3 * n):
            x[i, l] = out[n + i, l]
            U[i, l] = h * x[i, l] - U[i, l]  # of the rest of the displacement
    dintegrate(bodies, q, u, by_turn)
    _scaled(0.0, out[:n], out[:n])
    _add_blocks(bodies, by_turn[0], moved, out[:n])
    _add_blocks(bodies, by_turn[1], U, out[:n])
    for r in range(n):
        b = bodies[r + 1]
        if travels(b):
            lengths = NV[b.kind] - (1 if NV[b.kind] == 3 else 3)
            for k in range(r, r + NV[b.kind]):
                D[0, 0, k] = 0.0
                for l in range(r, r + lengths):
                    D[0, 0, k] = D[0, 0, k] + by_turn[0, k, l] * w[l] if k < r + lengths else 0.0
            after = turned_diagonal(0.0, twist(b, r, D[0, 0]).v)  # of Rᵀ x: by x, and by the angle
            put_tangent(b, r, Tangent(after, after), 0.0, D, 1)
            for k in range(r, r + lengths):
                for l in range(3 * n):
                    total = 0.0
                    for i in range(r, r + lengths):
                        total = total + by_turn[0, k, i] * x[i, l]
                    for i in range(r + lengths, r + NV[b.kind]):
                        for j in range(r + lengths, r + NV[b.kind]):
                            total = total + D[1, k, i] * by_turn[1, i, j] * (h * x[j, l])
                    out[n + k, l] = total
    _put_turn(largest_turn(bodies, u, 0.0), n, out)


@inline
def _add_kept(bodies: Bodies, i: int, lengths: int, h: Scalar, w: Vec, d: Vector, out: Matrix) -> None:
    """out += the derivative of the term that keeps momenta of a free body, first row i; d is scratch, 0 after it."""
    if not is_free(bodies, i):
        return
    b, r, n = bodies[i], i - 1, len(bodies) - 1
    for l in range(r + lengths, r + NV[b.kind]):
        for k in range(r, r + NV[b.kind]):
            d[k] = 1.0 if k == l else 0.0
        put_twist(b, r, kept_slope(bodies, i, h, w, twist(b, r, d).w), d)
        for k in range(r, r + NV[b.kind]):
            out[n + k, n + l] = out[n + k, n + l] + d[k]
            d[k] = 0.0


@inline
def kept_slope(bodies: Bodies, i: int, h: Scalar, w: Vec, d: Vec) -> Motion:
    """The derivative of ``kept`` at ω, ω, ω along d."""
    x = add_motion(kept(bodies, i, h, d, w, w), kept(bodies, i, h, w, d, w))
    return add_motion(x, kept(bodies, i, h, w, w, d))


@inline
def travels(b: Record) -> bool:
    """Whether a joint turns and travels: it is floating or planar."""
    return b.kind in SE3 or b.kind in SE2


@inline
def velocity_verlet_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, law: SmoothLaw,
    out: Matrix, pivots: Vector, s: DerivativeScratch,
) -> None:  # fmt: skip
    """q⁺ = q ∘ exp(h v + ½ h² a), v⁺ = v + ½ h (a + a⁺) with a⁺ = a(q⁺, v + h a)."""
    n, h, u, w, a, D, U, W, Ka, by_q = len(bodies) - 1, dt[0], s.u, s.w, s.a, s.D, s.U, s.W, s.Ka, s.by_q
    acceleration_derivatives(bodies, work, q, v, tau, fext, law, D, pivots, a, s.inverse, s.rubbed)
    by_q[:] = 0.0
    W[:] = 0.0
    _add_unit(0, by_q)
    _add_unit(1, W)
    _acceleration(D, by_q, W, Ka)
    _scaled(0.5 * h * h, Ka, U)
    _add_scaled(h, W, U)
    _add_scaled(h, Ka, W)
    for i in range(n):
        u[i], w[i] = h * (v[i] + 0.5 * h * a[i]), v[i] + h * a[i]
    integrate(bodies, q, u, s.stage)
    dintegrate(bodies, q, u, s.by_step)
    _moved(bodies, s.by_step, U, by_q)
    out[:n] = by_q
    _scaled(0.5 * h, Ka, out[n : 2 * n])
    acceleration_derivatives(bodies, work, s.stage, w, tau, fext, law, D, s.spare, a, s.inverse, s.rubbed)
    _acceleration(D, by_q, W, Ka)
    _add_scaled(0.5 * h, Ka, out[n : 2 * n])
    _add_unit(1, out[n : 2 * n])
    _put_turn(largest_turn(bodies, u, 0.0), n, out)


@inline
def motion_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, law: SmoothLaw, out: Matrix,
    pivots: Vector, s: MotionScratch,
) -> None:  # fmt: skip
    """Rates of δq and δv along the motion by (δq, δv, δτ): d/dt δq = δv - v × δq in each body's frame."""
    n, D = len(bodies) - 1, s.D
    acceleration_derivatives(bodies, work, q, v, tau, fext, law, D, pivots, s.a, s.inverse, s.rubbed)
    out[:n] = 0.0
    for i in range(n):
        for j in range(n):
            for k in range(3):
                out[n + i, k * n + j] = D[k, i, j]
        out[i, n + i] = 1.0
    D[0] = 0.0
    for i in range(1, n + 1):
        b = bodies[i]
        if NV[b.kind] > 1:
            m = twist(b, i - 1, v)
            put_tangent(b, i - 1, Tangent(turned_diagonal(0.0, neg(m.w)), turned_diagonal(0.0, neg(m.v))), 0.0, D, 0)
    for i in range(n):
        for j in range(n):
            out[i, j] = D[0, i, j]


@no_inline
def acceleration_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, law: SmoothLaw, D: Array,
    pivots: Vector, a: Vector, inverse: Matrix, rubbed: Matrix,
) -> None:  # fmt: skip
    """``aba_derivatives`` with smooth friction, compiled once for all steps, as it is most of a kernel's compilation.

    law     may be None, for no friction
    rubbed  (2, nv)  scratch: torques with friction, slopes of friction by v
    """
    if law is None:
        aba_derivatives_by_factor(bodies, work, q, v, tau, fext, D, pivots, a, inverse)
    else:
        n = len(bodies) - 1
        friction_torque(bodies, v, law, law.smoothing, rubbed[0])
        smooth_friction_slope(bodies, v, law, law.smoothing, rubbed[1])
        for i in range(n):
            rubbed[0, i] = tau[i] + rubbed[0, i]
        aba_derivatives_by_factor(bodies, work, q, v, rubbed[0], fext, D, pivots, a, inverse)
        for i in range(n):
            for j in range(n):
                D[1, i, j] = D[1, i, j] + inverse[i, j] * rubbed[1, j]


# --- parts ----------------------------------------------------------------------------------------------


@inline
def largest_turn(bodies: Bodies, u: Vector, most: Scalar) -> Scalar:
    """The larger of ``most`` and the squares of the angles by which u turns joints of several freedoms."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        if NV[b.kind] > 1:
            w = twist(b, i - 1, u).w
            square = dot(w, w)
            most = select(square - most, square, most)
    return most


@inline
def _put_turn(turn: Scalar, n: int, out: Matrix) -> None:
    """The last row, if there is one."""
    for i in range(2 * n, len(out)):
        for j in range(3 * n):
            out[i, j] = turn if j == 0 else 0.0


@inline
def _moved(bodies: Bodies, by_step: Array, U: Matrix, out: Matrix) -> None:
    """out = P [1 0 0] + R U of q ∘ exp(u)."""
    out[:] = 0.0
    for i in range(1, len(bodies)):
        d = NV[bodies[i].kind]
        for r in range(i - 1, i - 1 + d):
            for c in range(i - 1, i - 1 + d):
                out[r, c] = by_step[0, r, c]
    _add_blocks(bodies, by_step[1], U, out)


@inline
def _acceleration(D: Array, by_q: Matrix, W: Matrix, out: Matrix) -> None:
    """out = D_q Q + D_v W + M⁻¹ [0 0 1]."""
    n = len(W)
    for i in range(n):
        into = out[i]
        for j in range(2 * n):
            into[j] = 0.0
        for j in range(n):
            into[2 * n + j] = D[2, i, j]
        for k in range(n):
            x, y, first, second = D[0, i, k], D[1, i, k], by_q[k], W[k]
            for j in range(3 * n):
                into[j] = into[j] + x * first[j] + y * second[j]


@inline
def _add_blocks(bodies: Bodies, T: Matrix, X: Matrix, out: Matrix) -> None:
    """out += T X, T with a block for each joint."""
    for i in range(1, len(bodies)):
        d = NV[bodies[i].kind]
        for r in range(i - 1, i - 1 + d):
            into = out[r]
            for k in range(i - 1, i - 1 + d):
                x, row = T[r, k], X[k]
                for j in range(len(row)):
                    into[j] = into[j] + x * row[j]


@inline
def _add_turned(bodies: Bodies, T: Matrix, x: Vector, out: Vector) -> None:
    """out += T x, T with a block for each joint."""
    for i in range(1, len(bodies)):
        d = NV[bodies[i].kind]
        for r in range(i - 1, i - 1 + d):
            for k in range(i - 1, i - 1 + d):
                out[r] = out[r] + T[r, k] * x[k]


@inline
def _scaled(c: Scalar, X: Matrix, out: Matrix) -> None:
    """out = c X."""
    for i in range(len(X)):
        row, into = X[i], out[i]
        for j in range(len(row)):
            into[j] = c * row[j]


@inline
def _add_scaled(c: Scalar, X: Matrix, out: Matrix) -> None:
    """out += c X."""
    for i in range(len(X)):
        row, into = X[i], out[i]
        for j in range(len(row)):
            into[j] = into[j] + c * row[j]


@inline
def _add_unit(which: int, out: Matrix) -> None:
    """out += [1 0 0], [0 1 0] or [0 0 1]."""
    n = len(out)
    for i in range(n):
        out[i, which * n + i] = out[i, which * n + i] + 1.0


DT = Argument("dt", (1,), "s", "step")
SMOOTH_LAW = SmoothLaw(*(replace(x, optional=True) for x in (*LAW, SMOOTHING)))
DERIVATIVES = Argument("D", ("nv+nv", "nv+nv+nv"), "", "derivatives of (q, v) after the step by q, v and tau")
_SOURCE = "see ``recursions.derivatives.step_derivatives``"
_EXPLICIT = {
    "explicit_euler": explicit_euler_derivatives,
    "semi_implicit_euler": semi_implicit_euler_derivatives,
    "velocity_verlet": velocity_verlet_derivatives,
    "rk4": rk4_derivatives,
}
_SEVERAL = {"velocity_verlet": ("nv", "nv", "nv", 4), "rk4": ("nv", "nv", "nv", 12)}  # of one, aba_derivatives' terms
STEPS = {
    name: Spec(
        f"{name}_derivatives", recursion, WORK, (Q, V, TAU, FEXT_OPTIONAL, DT, SMOOTH_LAW), DERIVATIVES,
        f"Derivatives of a step by {name}.", _SOURCE, pivots=True, regroup=True,
        term_shape=_SEVERAL.get(name, ("nv",) * 3), scratch=(DerivativeScratch(),), composed=True,
    )
    for name, recursion in _EXPLICIT.items()
}  # fmt: skip
WITH_TURN = replace(DERIVATIVES, shape=("nv+nv+1", "nv+nv+nv"), meaning="the same, and the largest turn² below them")
TURNING_STEPS = {  # of robots with joints of several freedoms
    name: replace(spec, name=f"turning_{spec.name}", output=WITH_TURN) for name, spec in STEPS.items()
}
MOTION = Spec(
    "motion_derivatives", motion_derivatives, WORK, (Q, V, TAU, FEXT_OPTIONAL, SMOOTH_LAW),
    replace(DERIVATIVES, meaning="derivatives of the rates of q and v by q, v and tau"),
    "Derivatives of the equation of motion.", _SOURCE, pivots=True, regroup=True, term_shape=("nv",) * 3,
    scratch=(MotionScratch(),), composed=True,
)  # fmt: skip
