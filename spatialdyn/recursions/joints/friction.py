"""Joint friction: its torque, and one step of the velocities in which it acts.

Freedom by freedom, τ = -F(v) sgn v - b v, where F falls from the static level to Coulomb's as the joint begins to move
(Stribeck):

    F(v) = F_c + (F_s - F_c) exp(-(v/v_s)²)

At rest the dry part is the torque that keeps the joint at rest, up to F_s: no function of v. ``friction_step``
therefore finds v⁺ and the friction torques f together, from the equation of motion over a step h and Coulomb's law at
its end,

    (M + h b) (v⁺ - v)/h = τ - bias - b v + f,     f ∈ -F(v) Sgn v⁺,

so that a joint that sticks has v⁺ = 0 to the bit, and damping is stable at any h.

Sources: Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation methods for the
control of machines with friction (1994), for F(v); Canudas de Wit, Olsson, Åström, Lischinsky, A new model for control
of systems with friction (1995), for bristles; the steps are after Featherstone, RBDA (2008), chapters 6 and 9.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec
from ...algebra.records import table_dtype
from ...algebra.regions import repeat, settled
from ...algebra.scalars import exp, inline, select
from ...algebra.spatial import Force, Inertia, Pose
from ..signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V
from ..tree.crba import crba
from ..tree.ltdl import factor_tree, solve_tree
from ..tree.rnea import rnea

# Sweeps that choose which joints stick. The first BOLD sweeps correct every joint, the others only joints that violate
# Coulomb's law by at least half of the largest violation, which ends cycles (``tests/recursions/test_coulomb.py``).
SWEEPS, BOLD = 10, 6
AT_ONCE = 1e-30  # [rad/s | m/s] a Stribeck velocity below any velocity of a motion, in the range of float32

WORK = table_dtype(
    X=Pose,  # of crba, then of rnea
    Ic=Inertia,  # of crba
    w=Vec,  # of rnea, as are the fields that follow
    dw=Vec,
    dv=Vec,
    f=Force,
    need=float,  # τ - b v - bias, which M + h b accelerates
    level=float,  # F(v): the largest dry friction torque
    stuck=float,  # 1 if the joint is assumed to stick, at rest at the end of the step, else 0
    push=float,  # dry friction of a moving joint, against its motion: F(v) or -F(v); 0 for a sticking joint
    sticks=float,  # whether its torque would hold it, and its push if it moves
    against=float,
    s=float,  # need - push, less the terms of the rows behind; inward
    g=float,  # 1 / D of the partial factorization, 0 for a stuck row; inward
    y=float,  # g s, or the acceleration of a stuck row; inward
    x=float,  # acceleration (v⁺ - v) / h; outward
    friction=float,  # dry friction torque, with its sign; outward
    weight=float,  # 1 / (M⁻¹)_ii, the effective inertia for an impulse on this joint alone
    z=float,  # an entry of a row of L⁻¹
)


class Law(NamedTuple):
    """Coefficients (nv) of joint friction."""

    coulomb: Vector
    viscous: Vector
    static: Vector
    stribeck: Vector


class BristleLaw(NamedTuple):
    """Coefficients of LuGre friction."""

    coulomb: Vector
    viscous: Vector
    static: Vector
    stribeck: Vector
    stiffness: Vector
    damping: Vector


class SmoothLaw(NamedTuple):
    """Coefficients (nv) of smooth friction, whose sign changes gradually with velocity."""

    coulomb: Vector
    viscous: Vector
    static: Vector
    stribeck: Vector
    smoothing: Vector


class StepScratch(NamedTuple):
    """Scratch of ``friction_step``."""

    M: Matrix = ("nv", "nv")  # M + h b
    R: Matrix = ("nv", "nv")  # its factors, with some rows stuck
    guess: Matrix = (2, "nv")  # for the next sweep: which joints stick, and the dry friction of the others
    wrong: Vector = (1,)  # 1 if it differs from the guess before, else 0
    sweep: Vector = (1,)  # sweeps done


@inline
def magnitude(x: Number) -> Number:
    """|x|."""
    return select(x, x, -x)


@inline
def dry_level(v: Vector, law: Record, i: int) -> Number:
    """F(v) of a freedom; with the Stribeck velocity AT_ONCE it is F_s at rest and F_c in any motion.

    law  of any kind: Law, BristleLaw or SmoothLaw
    """
    return law.coulomb[i] + above_dry(v, law, i)


@inline
def above_dry(v: Vector, law: Record, i: int) -> Number:
    """F(v) - F_c of a freedom."""
    u = v[i] / law.stribeck[i]
    return (law.static[i] - law.coulomb[i]) * exp(-(u * u))


@inline
def smooth_sign(v: Number, smoothing: Number) -> Number:
    """tanh(v/ε)."""
    return 1.0 - 2.0 / (1.0 + exp(2.0 * v / smoothing))


@inline
def friction_torque(bodies: Bodies, v: Vector, law: Record, smoothing: Vector, friction: Vector) -> None:
    """-F(v) sgn v - b v, with tanh(v/ε) for sgn v if there are smoothing velocities ε; the dry part is 0 at rest."""
    for i in range(len(bodies) - 1):
        if smoothing is None:
            direction = select(v[i], 1.0, select(-v[i], -1.0, 0.0))
        else:
            direction = smooth_sign(v[i], smoothing[i])
        friction[i] = -(dry_level(v, law, i) * direction + law.viscous[i] * v[i])


@inline
def smooth_friction_slope(bodies: Bodies, v: Vector, law: Record, smoothing: Vector, slope: Vector) -> None:
    """Derivatives of the smooth torque by v: -(F' t + F (1 - t²)/ε + b) with t = tanh(v/ε)."""
    for i in range(len(bodies) - 1):
        t = smooth_sign(v[i], smoothing[i])
        falls = above_dry(v, law, i) * (-2.0 * (v[i] / law.stribeck[i])) / law.stribeck[i]
        level = dry_level(v, law, i)
        slope[i] = -(falls * t + level * (1.0 - t * t) / smoothing[i] + law.viscous[i])


@inline
def friction_regressor(bodies: Bodies, v: Vector, F: Array) -> None:
    """F (nv, 2, nv): sgn v, then v, on the diagonal; -F (F_c, b) is the friction torque of moving joints."""
    F[:] = 0.0
    for i in range(len(bodies) - 1):
        F[i, 0, i] = select(v[i], 1.0, select(-v[i], -1.0, 0.0))
        F[i, 1, i] = v[i]


@inline
def friction_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Number, law: Law, after: Matrix,
    pivots: Vector, s: StepScratch,
) -> None:  # fmt: skip
    """Velocities after a step, by a primal-dual active set: guess which joints stick, solve, correct the guess.

    f - (w/h) v⁺ is within ±F for a joint that sticks, and beyond it, against v⁺, for a joint that moves. With the
    weight w = 1/(M⁻¹)_ii the guess settles in a few sweeps; with M_ii or D it may cycle.

    after  (3, nv), written: v⁺; the violation of Coulomb's law [rad/s | m/s], 0 once the guess has settled; the dry
           friction torque [N m | N]
    """
    n, M, R = len(bodies) - 1, s.M, s.R
    crba(bodies, work, q, M)
    rnea(bodies, work, q, v, None, fext, after[0])
    for i in range(1, n + 1):
        here = work[i]
        M[i - 1, i - 1] = M[i - 1, i - 1] + dt * law.viscous[i - 1]
        here.need = tau[i - 1] - law.viscous[i - 1] * v[i - 1] - after[0, i - 1]
        here.level = dry_level(v, law, i - 1)
        here.stuck = 0.0
        here.push = 0.0

    solve_partly_stuck(bodies, work, v, dt, M, R)  # nothing sticks or rubs yet: R and g are the factors of M
    weigh(bodies, work, R)
    for i in range(1, n + 1):
        pivots[i - 1] = R[i - 1, i - 1]
    s.sweep[0] = 0.0
    correct_guess(bodies, work, v, dt, after, s)
    for _ in repeat(SWEEPS, s.wrong, s.guess, s.sweep, after):
        if settled(s.wrong[0]):
            break
        for i in range(1, n + 1):
            work[i].stuck = s.guess[0, i - 1]
            work[i].push = s.guess[1, i - 1]
        solve_partly_stuck(bodies, work, v, dt, M, R)
        correct_guess(bodies, work, v, dt, after, s)


@inline
def correct_guess(bodies: Bodies, work: Work, v: Vector, dt: Number, after: Matrix, s: StepScratch) -> None:
    """Write the results of a sweep, the guess for the next one, and whether it differs: if not, all sweeps agree."""
    n, least, careful = len(bodies) - 1, 0.0, s.sweep[0] - (BOLD - 1.0)
    for i in range(1, n + 1):
        here = work[i]
        after[0, i - 1] = select(here.stuck, 0.0, v[i - 1] + dt * here.x)
        beyond = here.friction - here.weight * after[0, i - 1] / dt
        here.sticks = select(here.level - magnitude(beyond), 1.0, 0.0)  # 0 for NaN, so that NaN reaches v⁺
        here.against = select(beyond, -here.level, here.level)
        allowed = select(here.sticks, beyond, -here.against)
        after[1, i - 1] = magnitude(here.friction - allowed) * dt / here.weight
        after[2, i - 1] = here.friction
        half = 0.5 * after[1, i - 1]
        least = select(half - least, half, least)
    wrong = 0.0
    for i in range(1, n + 1):
        here = work[i]
        far = select(careful, after[1, i - 1] - least, 1.0)
        stuck = select(far, here.sticks, here.stuck)
        push = select(far, select(here.sticks, 0.0, here.against), here.push)
        changed = magnitude(stuck - here.stuck) + magnitude(push - here.push)
        wrong = select(changed, 1.0, wrong)
        s.guess[0, i - 1] = stuck
        s.guess[1, i - 1] = push
    s.wrong[0] = wrong
    s.sweep[0] = s.sweep[0] + 1.0


@inline
def solve_partly_stuck(bodies: Bodies, work: Work, v: Vector, dt: Number, M: Matrix, R: Matrix) -> None:
    """Accelerations x and dry friction torques of a robot whose stuck joints come to rest in dt.

    LᵀD L of M as in ``ltdl``, but a stuck row is not eliminated: its acceleration -v/dt is known, and the residual of
    its equation is the friction torque.
    """
    for i in range(1, len(bodies)):
        work[i].s = work[i].need - work[i].push
        j = i
        while j > 0:
            R[i - 1, j - 1] = M[i - 1, j - 1]
            j = bodies[j].parent
    for k in range(len(bodies) - 1, 0, -1):
        here = work[k]
        here.g = select(here.stuck, 0.0, 1.0 / R[k - 1, k - 1])
        here.y = select(here.stuck, -v[k - 1] / dt, here.g * here.s)
        i = bodies[k].parent
        while i > 0:
            work[i].s = work[i].s - R[k - 1, i - 1] * here.y
            L = R[k - 1, i - 1] * here.g
            j = i
            while j > 0:
                R[i - 1, j - 1] = R[i - 1, j - 1] - L * R[k - 1, j - 1]
                j = bodies[j].parent
            i = bodies[i].parent
    for k in range(1, len(bodies)):
        here = work[k]
        ahead = 0.0
        i = bodies[k].parent
        while i > 0:
            ahead = ahead + R[k - 1, i - 1] * work[i].x
            i = bodies[i].parent
        here.x = here.y - here.g * ahead
        here.friction = select(here.stuck, R[k - 1, k - 1] * here.x + ahead - here.s, -here.push)


@inline
def weigh(bodies: Bodies, work: Work, R: Matrix) -> None:
    """The weights 1 / (M⁻¹)_ii from M⁻¹ = L⁻¹ D⁻¹ L⁻ᵀ, one row of L⁻¹ at a time: row i reaches from i to the root."""
    for i in range(1, len(bodies)):
        work[i].z = 1.0
        total = work[i].g
        j = bodies[i].parent
        while j > 0:
            z = 0.0
            k = i
            while k != j:
                z = z - work[k].z * (R[k - 1, j - 1] * work[k].g)
                k = bodies[k].parent
            work[j].z = z
            total = total + z * z * work[j].g
            j = bodies[j].parent
        work[i].weight = 1.0 / total


@inline
def bristle_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number,
    law: BristleLaw, after: Matrix, pivots: Vector, M: Matrix,
) -> None:  # fmt: skip
    """Velocities and bristles after a step of LuGre friction, ż = v - σ0 |v|/F(v) z and f = -(σ0 z + σ1 ż + b v).

    |v|/F is taken at the beginning of the step, all else at the end: linear in v⁺, and stable at any step.

    z      (nv,)  deflection of the bristles [rad | m]
    after  (2, nv), written: v⁺ and z⁺
    M      (nv, nv), written: scratch
    """
    n = len(bodies) - 1
    crba(bodies, work, q, M)
    rnea(bodies, work, q, v, None, fext, after[0])
    add_bristles(v, z, tau, dt, law, M, after[0], after[1])
    factor_tree(bodies, M)
    for i in range(n):
        pivots[i] = M[i, i]
    solve_tree(bodies, M, after[0])
    for i in range(n):
        after[0, i] = v[i] + dt * after[0, i]
        after[1, i] = (z[i] + dt * after[0, i]) * after[1, i]


@inline
def add_bristles(
    v: Vector, z: Vector, tau: Vector, dt: Number, law: BristleLaw, M: Matrix, r: Vector, kept: Vector
) -> None:  # fmt: skip
    """Add bristles to M x = r of a step, from M and the bias in r; kept (nv) is written: the share of z + h v⁺ kept."""
    for i in range(len(v)):
        level = dry_level(v, law, i)
        total = level + dt * law.stiffness[i] * magnitude(v[i])
        kept[i] = select(total, level, 0.0) / select(total, total, 1.0)  # 0 without friction
        slope = (law.stiffness[i] * dt + law.damping[i]) * kept[i] + law.viscous[i]
        given = law.stiffness[i] * z[i] * kept[i] + law.damping[i] * (z[i] * kept[i] - z[i]) / dt
        M[i, i] = M[i, i] + dt * slope
        r[i] = tau[i] - r[i] - given - slope * v[i]


DT = Argument("dt", (), "s", "step")
COULOMB = Argument("coulomb", ("nv",), "N m | N", "dry friction of a joint that moves")
VISCOUS = Argument("viscous", ("nv",), "N m s/rad | N s/m", "damping")
STATIC = Argument("static", ("nv",), "N m | N", "largest dry friction of a joint at rest")
STRIBECK = Argument("stribeck", ("nv",), "rad/s | m/s", "velocity of the fall between the two")
SMOOTHING = Argument("smoothing", ("nv",), "rad/s | m/s", "velocity over which the sign changes", optional=True)
STIFFNESS = Argument("stiffness", ("nv",), "N m/rad | N/m", "of the bristles")
DAMPING = Argument("damping", ("nv",), "N m s/rad | N s/m", "of the bristles")
BRISTLES = Argument("bristles", ("nv",), "rad | m", "deflection of the bristles", start=0.0)
LAW = Law(COULOMB, VISCOUS, STATIC, STRIBECK)
BRISTLE_LAW = BristleLaw(*LAW, STIFFNESS, DAMPING)

FRICTION_TORQUE = Spec(
    "friction_torque", friction_torque, None, (V, LAW, SMOOTHING),
    Argument("friction", ("nv",), "N m | N", "friction torques"),
    "Friction torques -F(v) sgn v - b v.", "see ``recursions.joints.friction``", composed=True,
)  # fmt: skip
FRICTION_REGRESSOR = Spec(
    "friction_regressor", friction_regressor, None, (V,),
    Argument("F", ("nv", 2, "nv"), "1 | rad/s | m/s", "torque per coefficient"),
    "Regressor of joint friction.", "see ``recursions.joints.friction``",
)  # fmt: skip
FRICTION_STEP = Spec(
    "friction_step", friction_step, WORK, (Q, V, TAU, FEXT_OPTIONAL, DT, LAW),
    Argument("after", (3, "nv"), "", "velocities after a step, violation of Coulomb's law, dry friction torque"),
    "A step of the velocities under dry friction and damping.", "see ``recursions.joints.friction``", pivots=True,
    regroup=True, scratch=(StepScratch(),), composed=True,
)  # fmt: skip
BRISTLE_STEP = Spec(
    "bristle_step", bristle_step, WORK, (Q, V, BRISTLES, TAU, FEXT_OPTIONAL, DT, BRISTLE_LAW),
    Argument("after", (2, "nv"), "rad/s | m/s", "velocities and bristles after a step"),
    "A step of the velocities under LuGre friction.", "see ``recursions.joints.friction``", pivots=True, regroup=True,
    scratch=(("nv", "nv"),), composed=True,
)  # fmt: skip
