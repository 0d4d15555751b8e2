"""Derivatives of a step of the explicit methods by the state before it and the torques, and of the equation of motion.

A step takes (q, v) to (q⁺, v⁺) under a torque held over it. With δq the displacement of a joint in its own body's frame
and δ = (δq, δv, δτ), each quantity of the step has a matrix of 3 nv columns, its derivative by δ. By ``dintegrate``
q ∘ exp(u) has P δq + R δu, by ``aba_derivatives`` the acceleration has D_q δq + D_v δv + M⁻¹ δτ, and in the method of
Runge and Kutta, on u̇ = T(u) w, the rate has ∂(T(u) w)/∂u δu + T(u) δw. The rest is the chain rule, stage by stage.

The result has 2 nv rows, those of δq⁺ and of δv⁺. Of robots with joints of several freedoms it has one more, whose
first entry is the square of the largest angle by which one of them turns in the step or a part of it: at 2π exp is
singular, and a step of more than π has no use.

Derived here from the steps as ``simulation.explicit`` has them, after Munthe-Kaas, High order Runge-Kutta methods on
manifolds (1999), for the derivative of exp in closed form.
"""

from __future__ import annotations

from dataclasses import replace

from ..algebra.euclidean import add, cross, neg, scale
from ..algebra.lie import Tangent, turned_diagonal
from ..algebra.scalars import inline, no_inline
from ..algebra.spatial import Motion
from ..bodies.kinds import NV
from .configuration import (
    dintegrate,
    displacement_rate_derivatives,
    integrate,
    put_tangent,
    put_twist,
    twist,
)
from .derivatives import WORK, aba_derivatives_by_factor
from .friction import LAW, SMOOTHING, friction_torque, smooth_friction_slope
from .signatures import Array, Bodies, Config, Matrix, Vector, Work
from .spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V
from .step_parts import (
    add_blocks,
    add_scaled,
    add_turned,
    add_unit,
    largest_turn,
    put_acceleration,
    put_moved,
    put_scaled,
    put_turn,
    travels,
)

Law = tuple[Vector, Vector, Vector, Vector]  # F_c, b, F_s and v_s of smooth friction, or None each

RK4_NODES, RK4_WEIGHTS = (0.0, 0.5, 0.5, 1.0), (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)

# Scratch: ``rows`` (9, nv) of vectors, ``squares`` (8, nv, nv), ``wide`` (7, nv, 3 nv) of derivatives by (q, v, τ)
_SCRATCH = (("nq",), (9, "nv"), (8, "nv", "nv"), (7, "nv", "nv+nv+nv"))


@inline
def explicit_euler_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, coulomb: Vector,
    viscous: Vector, static: Vector, stribeck: Vector, smoothing: Vector, out: Matrix, pivots: Vector, stage: Config,
    rows: Matrix, squares: Array, wide: Array,
) -> None:  # fmt: skip
    """q⁺ = q ∘ exp(h v), v⁺ = v + h a: Runge and Kutta's method of one stage."""
    law = coulomb, viscous, static, stribeck
    _runge_kutta(
        (0.0,), (1.0,), bodies, work, q, v, tau, fext, dt, law, smoothing, out, pivots, stage, rows, squares, wide
    )


@inline
def rk4_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, coulomb: Vector,
    viscous: Vector, static: Vector, stribeck: Vector, smoothing: Vector, out: Matrix, pivots: Vector, stage: Config,
    rows: Matrix, squares: Array, wide: Array,
) -> None:  # fmt: skip
    """The classical method of order 4 on (u, v), q(t) = q ∘ exp(u(t))."""
    law = coulomb, viscous, static, stribeck
    _runge_kutta(
        RK4_NODES, RK4_WEIGHTS, bodies, work, q, v, tau, fext, dt, law, smoothing, out, pivots, stage, rows, squares,
        wide,
    )  # fmt: skip


@inline
def _runge_kutta(
    nodes: tuple[float, ...], weights: tuple[float, ...], bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector,
    fext: Matrix, dt: Vector, law: Law, smoothing: Vector, out: Matrix, pivots: Vector, stage: Config, rows: Matrix,
    squares: Array, wide: Array,
) -> None:  # fmt: skip
    """A method each of whose stages starts from the one before it alone; fext may be None, for zero."""
    n = len(bodies) - 1
    rows[:] = 0.0
    wide[:] = 0.0
    u, w, a, rate, moved, spare, rubbed = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6:8]
    D, inverse, by_step, by_rate = squares[0:3], squares[3], squares[4:6], squares[6:8]
    U, W, Ku, Ka, moved_by, changed_by = wide[0], wide[1], wide[2], wide[3], wide[4], wide[5]
    turn = 0.0
    for s in range(len(nodes)):
        h = nodes[s] * dt[0]
        for i in range(n):
            u[i], w[i] = h * rate[i], v[i] + h * a[i]
        put_scaled(h, Ku, U)
        put_scaled(h, Ka, W)
        add_unit(1, W)
        turn = largest_turn(bodies, u, turn)
        for k in range(len(q)):
            stage[k] = q[k]
        if s > 0:
            integrate(bodies, q, u, stage)
        dintegrate(bodies, q, u, by_step)
        displacement_rate_derivatives(bodies, u, w, by_rate)
        # u̇ = T(u) w and the acceleration of the stage, with their derivatives
        for i in range(n):
            rate[i] = 0.0
        add_turned(bodies, by_rate[1], w, rate)
        Ku[:] = 0.0
        add_blocks(bodies, by_rate[0], U, Ku)
        add_blocks(bodies, by_rate[1], W, Ku)
        acceleration_derivatives(bodies, work, stage, w, tau, fext, law, smoothing, D, spare, a, inverse, rubbed)
        if s == 0:
            pivots[:] = spare
        by_q = wide[6]
        put_moved(bodies, by_step, U, by_q)
        put_acceleration(D, by_q, W, Ka)
        h = weights[s] * dt[0]
        for i in range(n):
            moved[i] = moved[i] + h * rate[i]
        add_scaled(h, Ku, moved_by)
        add_scaled(h, Ka, changed_by)
    turn = largest_turn(bodies, moved, turn)
    dintegrate(bodies, q, moved, by_step)
    put_moved(bodies, by_step, moved_by, out[:n])
    out[n : 2 * n] = changed_by
    add_unit(1, out[n : 2 * n])
    put_turn(turn, n, out)


@inline
def semi_implicit_euler_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, coulomb: Vector,
    viscous: Vector, static: Vector, stribeck: Vector, smoothing: Vector, out: Matrix, pivots: Vector, stage: Config,
    rows: Matrix, squares: Array, wide: Array,
) -> None:  # fmt: skip
    """v⁺ = v + h a, q⁺ = q ∘ exp(h v⁺), in joints that turn and travel as ``simulation.explicit.turn`` has it.

    There x = v + h (a + ω × v) is the linear velocity in the axes of the beginning, q⁺ = q ∘ exp(h x) ∘ exp(h ω⁺), and
    Rᵀ x the velocity after the step, R the rotation by h ω⁺.
    """
    n, h = len(bodies) - 1, dt[0]
    u, w, a, D, by_step, U = rows[0], rows[1], rows[2], squares[0:3], squares[4:6], wide[0]
    law = coulomb, viscous, static, stribeck
    acceleration_derivatives(bodies, work, q, v, tau, fext, law, smoothing, D, pivots, a, squares[3], rows[6:8])
    for i in range(n):
        u[i] = h * (v[i] + h * a[i])
        for j in range(n):
            for k in range(3):
                out[n + i, k * n + j] = h * D[k, i, j]
    add_unit(1, out[n : 2 * n])
    turns = 0
    for i in range(1, n + 1):
        turns += 1 if travels(bodies[i]) else 0
    if turns == 0:
        put_scaled(h, out[n : 2 * n], U)
        dintegrate(bodies, q, u, by_step)
        put_moved(bodies, by_step, U, out[:n])
        put_turn(largest_turn(bodies, u, 0.0), n, out)
        return
    for i in range(n):
        w[i] = v[i] + h * a[i]
    first, moved, x, by_turn = rows[3], wide[1], wide[2], squares[6:8]
    for i in range(n):
        first[i] = 0.0
    put_scaled(0.0, out[n : 2 * n], U)
    for i in range(1, n + 1):
        b, r = bodies[i], i - 1
        if travels(b):
            m = twist(b, r, v)
            put_twist(b, r, Motion(m.w, add(twist(b, r, w).v, scale(h, cross(m.w, m.v)))), D[0, 0])
            crossed = Tangent(turned_diagonal(0.0, scale(h, m.w)), turned_diagonal(0.0, scale(-h, m.v)))
            put_tangent(b, r, crossed, 0.0, D, 1)
            lengths = NV[b.kind] - (1 if NV[b.kind] == 3 else 3)
            for k in range(r, r + lengths):
                w[k] = D[0, 0, k]
                first[k], u[k] = h * w[k], 0.0
                for l in range(r, r + NV[b.kind]):
                    out[n + k, n + l] = out[n + k, n + l] + D[1, k, l]
                for l in range(3 * n):
                    U[k, l] = h * out[n + k, l]
    dintegrate(bodies, q, first, by_step)
    put_moved(bodies, by_step, U, moved)  # of q ∘ exp(h x)
    for i in range(n):
        for l in range(3 * n):
            x[i, l] = out[n + i, l]
            U[i, l] = h * x[i, l] - U[i, l]  # of the rest of the displacement
    dintegrate(bodies, q, u, by_turn)
    put_scaled(0.0, out[:n], out[:n])
    add_blocks(bodies, by_turn[0], moved, out[:n])
    add_blocks(bodies, by_turn[1], U, out[:n])
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
                    s = 0.0
                    for i in range(r, r + lengths):
                        s = s + by_turn[0, k, i] * x[i, l]
                    for i in range(r + lengths, r + NV[b.kind]):
                        for j in range(r + lengths, r + NV[b.kind]):
                            s = s + D[1, k, i] * by_turn[1, i, j] * (h * x[j, l])
                    out[n + k, l] = s
    put_turn(largest_turn(bodies, u, 0.0), n, out)


@inline
def velocity_verlet_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Vector, coulomb: Vector,
    viscous: Vector, static: Vector, stribeck: Vector, smoothing: Vector, out: Matrix, pivots: Vector, stage: Config,
    rows: Matrix, squares: Array, wide: Array,
) -> None:  # fmt: skip
    """q⁺ = q ∘ exp(h v + ½ h² a), v⁺ = v + ½ h (a + a⁺) with a⁺ = a(q⁺, v + h a)."""
    n, h = len(bodies) - 1, dt[0]
    u, w, a, spare, rubbed = rows[0], rows[1], rows[2], rows[5], rows[6:8]
    law = coulomb, viscous, static, stribeck
    D, inverse, by_step = squares[0:3], squares[3], squares[4:6]
    U, W, Ka, by_q = wide[0], wide[1], wide[2], wide[3]
    acceleration_derivatives(bodies, work, q, v, tau, fext, law, smoothing, D, pivots, a, inverse, rubbed)
    wide[:] = 0.0
    add_unit(0, by_q)
    add_unit(1, W)
    put_acceleration(D, by_q, W, Ka)
    put_scaled(0.5 * h * h, Ka, U)
    add_scaled(h, W, U)
    add_scaled(h, Ka, W)
    for i in range(n):
        u[i], w[i] = h * (v[i] + 0.5 * h * a[i]), v[i] + h * a[i]
    integrate(bodies, q, u, stage)
    dintegrate(bodies, q, u, by_step)
    put_moved(bodies, by_step, U, by_q)
    out[:n] = by_q
    put_scaled(0.5 * h, Ka, out[n : 2 * n])
    acceleration_derivatives(bodies, work, stage, w, tau, fext, law, smoothing, D, spare, a, inverse, rubbed)
    put_acceleration(D, by_q, W, Ka)
    add_scaled(0.5 * h, Ka, out[n : 2 * n])
    add_unit(1, out[n : 2 * n])
    put_turn(largest_turn(bodies, u, 0.0), n, out)


@inline
def motion_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, coulomb: Vector, viscous: Vector,
    static: Vector, stribeck: Vector, smoothing: Vector, out: Matrix, pivots: Vector, a: Vector, D: Array,
    inverse: Matrix, rubbed: Matrix,
) -> None:  # fmt: skip
    """Rates of δq and δv along the motion by (δq, δv, δτ): d/dt δq = δv - v × δq in each body's frame."""
    n = len(bodies) - 1
    law = coulomb, viscous, static, stribeck
    acceleration_derivatives(bodies, work, q, v, tau, fext, law, smoothing, D, pivots, a, inverse, rubbed)
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
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, law: Law,
    smoothing: Vector, D: Array, pivots: Vector, a: Vector, inverse: Matrix, rubbed: Matrix,
) -> None:  # fmt: skip
    """``aba_derivatives`` with smooth friction, compiled once for all steps: most of what compiling a kernel takes.

    law, smoothing  of ``friction_torque``; smoothing is None for no friction
    rubbed  (2, nv)  scratch: torques with friction, slopes of friction by v
    """
    coulomb, viscous, static, stribeck = law
    if smoothing is None:
        aba_derivatives_by_factor(bodies, work, q, v, tau, fext, D, pivots, a, inverse)
    else:
        n = len(bodies) - 1
        friction_torque(bodies, v, coulomb, viscous, static, stribeck, smoothing, rubbed[0])
        smooth_friction_slope(bodies, v, coulomb, viscous, static, stribeck, smoothing, rubbed[1])
        for i in range(n):
            rubbed[0, i] = tau[i] + rubbed[0, i]
        aba_derivatives_by_factor(bodies, work, q, v, rubbed[0], fext, D, pivots, a, inverse)
        for i in range(n):
            for j in range(n):
                D[1, i, j] = D[1, i, j] + inverse[i, j] * rubbed[1, j]


DT = Argument("dt", (1,), "s", "step")
RUBBING = (*(replace(x, optional=True) for x in LAW), SMOOTHING)
DERIVATIVES = Argument("D", ("nv+nv", "nv+nv+nv"), "", "derivatives of (q, v) after the step by q, v and tau")
_SOURCE = "see ``recursions.step_derivatives``"
_EXPLICIT = {
    "explicit_euler": explicit_euler_derivatives,
    "semi_implicit_euler": semi_implicit_euler_derivatives,
    "velocity_verlet": velocity_verlet_derivatives,
    "rk4": rk4_derivatives,
}
_SEVERAL = {"velocity_verlet": ("nv", "nv", "nv", 4), "rk4": ("nv", "nv", "nv", 12)}  # of one, aba_derivatives' terms
STEPS = {
    name: Spec(
        f"{name}_derivatives", recursion, WORK, (Q, V, TAU, FEXT_OPTIONAL, DT, *RUBBING), DERIVATIVES,
        f"Derivatives of a step by {name}.", _SOURCE, pivots=True, regroup=True,
        term_shape=_SEVERAL.get(name, ("nv",) * 3), scratch=_SCRATCH, composed=True,
    )
    for name, recursion in _EXPLICIT.items()
}  # fmt: skip
WITH_TURN = replace(DERIVATIVES, shape=("nv+nv+1", "nv+nv+nv"), meaning="the same, and the largest turn² below them")
TURNING_STEPS = {  # of robots with joints of several freedoms
    name: replace(spec, name=f"turning_{spec.name}", output=WITH_TURN) for name, spec in STEPS.items()
}
MOTION = Spec(
    "motion_derivatives", motion_derivatives, WORK, (Q, V, TAU, FEXT_OPTIONAL, *RUBBING),
    replace(DERIVATIVES, meaning="derivatives of the rates of q and v by q, v and tau"),
    "Derivatives of the equation of motion.", _SOURCE, pivots=True, regroup=True, term_shape=("nv",) * 3,
    scratch=(("nv",), (3, "nv", "nv"), ("nv", "nv"), (2, "nv")), composed=True,
)  # fmt: skip
