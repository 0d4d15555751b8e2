"""Hamilton's form: the momenta p = M(q) v, the energy H(q, p), and the rates of q and p, each in O(n).

p_i is the momentum conjugate to the joint velocity v_i, the momentum of the subtree of row i along S_i. If v are rates
of coordinates, p is the canonical momentum and ṗ = -∂H/∂q + τ. The v of a quaternion joint are twists in its body's
frame; there the same sweep gives ṗ with the gyroscopic term of a rotating frame.
"""

from __future__ import annotations

from ...algebra.articulated import Articulated
from ...algebra.euclidean import Vec, cross, dot, scale, unrotate, zero
from ...algebra.public_arrays import read_force
from ...algebra.records import (
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_force,
    put_motion,
    put_vec,
    table_dtype,
    vec_of,
)
from ...algebra.scalars import inline, inline_or_by_rows
from ...algebra.spatial import (
    Force,
    Motion,
    Pose,
    add_force,
    cross_motion,
    force_to_parent,
    momentum,
    power,
    zero_force,
    zero_motion,
)
from ...bodies.joints import place_joint
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, TURNED_Q, Argument, MassMatrix, Spec, V
from ..steps import body_velocity
from ..tree.aba import aba_inward, aba_outward
from ..tree.rotors import add_rotor_momentum, of_other
from .energy import potential_energy

WORK_MOMENTUM = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    p=Force,  # momentum, outward; of the subtree, inward
)
WORK_RATE = table_dtype(
    X=Pose,  # as in WORK_MOMENTUM
    v=Motion,  # as in WORK_MOMENTUM
    p=Force,  # as in WORK_MOMENTUM
    g=Vec,  # gravity in the axes of the row; outward
    f=Force,  # weight and fext, outward; of the subtree, inward
)
WORK_VELOCITY = table_dtype(
    X=Pose,  # of aba without velocities, as are all fields
    a=Motion,
    IA=Articulated,
    pA=Force,
    U=Force,
    d=float,
    u=float,
)
WORK_ENERGY = table_dtype(
    X=Pose,  # of aba without velocities, as are the fields to u
    IA=Articulated,
    pA=Force,
    U=Force,
    d=float,
    u=float,
    m=float,  # of mass_moment
    h=Vec,  # of mass_moment
)
WORK = table_dtype(
    X=Pose,  # of aba, read by rate
    v=Motion,  # as in WORK_RATE, as are the fields to f
    p=Force,
    g=Vec,
    f=Force,
    a=Motion,  # of aba, as are those that follow
    IA=Articulated,
    pA=Force,
    U=Force,
    d=float,
    u=float,
)


@inline
def generalized_momentum(bodies: Bodies, work: Work, q: Config, v: Vector, p: Vector) -> None:
    """p = M v: Newton-Euler with momenta in place of forces."""
    put_motion(work[0].v, zero_motion())
    put_force(work[0].p, zero_force())
    for i in range(1, len(bodies)):
        here = work[i]
        place_joint(bodies, i, q, here.X)
        _move(bodies, work, i, v)
    for i in range(len(bodies) - 1, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        h = force_of(here.p)
        p[i - 1] = power(motion_of(b.S), h) + b.armature * v[i - 1]
        if b.coupled or b.partner > 0:
            p[i - 1] = p[i - 1] + of_other(bodies, i, v)
        if b.geared:
            p[i - 1] = p[i - 1] + dot(vec_of(b.rotor), motion_of(parent.v).w)
        h = add_rotor_momentum(bodies, i, v, force_to_parent(pose_of(here.X), h))
        put_force(parent.p, add_force(force_of(parent.p), h))


@inline
def velocity_from_momentum(bodies: Bodies, work: Work, q: Config, p: Vector, v: Vector, pivots: Vector) -> None:
    """v = M⁻¹ p: forward dynamics of a robot at rest, without gravity, whose torques are the momenta."""
    aba_inward(bodies, work, q, None, p, None, pivots)
    aba_outward(bodies, work, None, zero(), v)


@inline_or_by_rows
def momentum_rate(bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dp: Vector) -> None:
    """ṗ = Cᵀ v + τ - g + Σ Jᵀ fext; tau, fext may be None, for zero. The poses are computed first."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    rate(bodies, work, v, tau, vec_of(bodies[0].gravity), fext, dp)


@inline
def hamilton_field(
    bodies: Bodies, work: Work, q: Config, p: Vector, tau: Vector, fext: Matrix, v: Vector, dp: Vector, pivots: Vector
) -> None:
    """Hamilton's equations: v = M⁻¹ p, which moves q, and ṗ. tau, fext may be None, for zero.

    q       (nq)
    p       (nv)
    tau     (nv)
    fext    (njoints, 6)
    v, dp   (nv), written
    pivots  (nv), written: the articulated inertia D of each row
    """
    velocity_from_momentum(bodies, work, q, p, v, pivots)
    rate(bodies, work, v, tau, vec_of(bodies[0].gravity), fext, dp)


@inline_or_by_rows
def hamilton_rows(
    bodies: Bodies, work: Work, q: Config, p: Vector, tau: Vector, fext: Matrix, rates: Matrix, pivots: Vector
) -> None:
    """hamilton_field with its two outputs as the rows of one."""
    hamilton_field(bodies, work, q, p, tau, fext, rates[0], rates[1], pivots)


@inline
def hamiltonian(bodies: Bodies, work: Work, q: Config, p: Vector, H: Vector, pivots: Vector) -> None:
    """H = ½ pᵀ M⁻¹ p + V; the inward pass of ABA factors M⁻¹, so T = ½ Σ u²/D is a sum of squares."""
    potential_energy(bodies, work, q, H)
    aba_inward(bodies, work, q, None, p, None, pivots)
    twice = 0.0
    for i in range(1, len(bodies)):
        twice = twice + work[i].d * work[i].u * work[i].u
    H[0] = H[0] + 0.5 * twice


@inline
def _move(bodies: Bodies, work: Work, i: int, v: Vector) -> None:
    """Velocity and momentum of body i, from its pose and its parent's velocity in the scratch."""
    here = work[i]
    vi = body_velocity(bodies, work, i, v)
    put_motion(here.v, vi)
    put_force(here.p, momentum(inertia_of(bodies[i].inertia), vi))


@inline
def rate(bodies: Bodies, work: Work, v: Vector, tau: Vector, gravity: Vec | None, fext: Matrix, dp: Vector) -> None:
    """ṗ_i = (v × S)·p + S·f, with p the momentum of the subtree of row i, f its weight and the forces on it.

    The scratch has the poses; tau, gravity (a Vec) and fext may be None, for zero: then ṗ is Cᵀ v alone.
    """
    put_motion(work[0].v, zero_motion())
    put_force(work[0].p, zero_force())
    put_force(work[0].f, zero_force())
    if gravity is not None:
        put_vec(work[0].g, gravity)
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        _move(bodies, work, i, v)
        f = zero_force()
        if gravity is not None:
            I, g = inertia_of(b.inertia), unrotate(pose_of(here.X).R, vec_of(parent.g))
            f = Force(cross(I.h, g), scale(I.m, g))
            put_vec(here.g, g)
        if fext is not None and b.joint > 0:
            f = add_force(f, read_force(fext[b.joint]))
        put_force(here.f, f)

    for i in range(len(bodies) - 1, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        X, S, p = pose_of(here.X), motion_of(b.S), force_of(here.p)
        dp[i - 1] = power(cross_motion(motion_of(here.v), S), p)
        p = add_rotor_momentum(bodies, i, v, force_to_parent(X, p))
        put_force(parent.p, add_force(force_of(parent.p), p))
        if gravity is not None or fext is not None:
            f = force_of(here.f)
            dp[i - 1] = dp[i - 1] + power(S, f)
            put_force(parent.f, add_force(force_of(parent.f), force_to_parent(X, f)))
        if tau is not None:
            dp[i - 1] = dp[i - 1] + tau[i - 1]


def velocity_through_M(M: MassMatrix, q: Array, p: Array) -> Array:
    """v = M⁻¹ p."""
    return M.solve(p)


def hamiltonian_through_M(M: MassMatrix, q: Array, p: Array) -> Array:
    """H = ½ pᵀ M⁻¹ p + V."""
    return 0.5 * (p * M.solve(p)).sum(-1) + M.call("potential_energy", q)


def hamilton_through_M(M: MassMatrix, q: Array, p: Array, tau: Array, fext: Array) -> tuple[Array, Array]:
    """v = M⁻¹ p and ṗ."""
    v = M.solve(p)
    return v, M.call("momentum_rate", q, v, tau, fext)


P = Argument("p", ("nv",), "kg m²/s | kg m/s", "joint momenta M(q) v", is_force=True)
_RATE = Argument("dp", ("nv",), "N m | N", "rate of the joint momenta")
_ABA = "after Featherstone, RBDA (2008), table 7.1, with momenta in place of torques."
_SWEEP = "a derivation of our own from Hamilton's principle; momenta are summed inward as RBDA table 5.1 sums forces."
SPECS = (
    Spec(
        "momentum", generalized_momentum, WORK_MOMENTUM, (TURNED_Q, V), P,
        "Joint momenta p = M(q) v, without forming M.",
        "after Featherstone, RBDA (2008), table 5.1, with velocities in place of accelerations.", regroup=True,
    ),
    Spec(
        "velocity_from_momentum", velocity_from_momentum, WORK_VELOCITY, (TURNED_Q, P), V,
        "Joint velocities v = M(q)⁻¹ p of given joint momenta, without forming M.", _ABA, pivots=True, regroup=True,
        through_M=velocity_through_M,
    ),
    Spec(
        "hamiltonian", hamiltonian, WORK_ENERGY, (TURNED_Q, P), Argument("H", (), "J", "energy"),
        "Hamiltonian H(q, p) = ½ pᵀ M(q)⁻¹ p + V(q): the energy as a function of positions and momenta.", _ABA,
        pivots=True, through_M=hamiltonian_through_M,
    ),
    Spec(
        "momentum_rate", momentum_rate, WORK_RATE, (TURNED_Q, V, TAU, FEXT_OPTIONAL), _RATE,
        "Rate ṗ = C(q, v)ᵀ v + tau - g(q) + Σ Jᵀ fext of the joint momenta p = M(q) v.", _SWEEP, regroup=True,
    ),
    Spec(
        "hamilton_field", hamilton_rows, WORK, (TURNED_Q, P, TAU, FEXT_OPTIONAL),
        Argument("rates", (2, "nv"), "rad/s | m/s; N m | N", "joint velocities, and rates of the joint momenta"),
        "Hamilton's equations in one array: v = M(q)⁻¹ p and ṗ = C(q, v)ᵀ v + tau - g(q) + Σ Jᵀ fext, one above "
        "the other; ``hamilton_equations`` gives the pair.", _SWEEP, pivots=True, regroup=True,
        through_M=hamilton_through_M,
    ),
)  # fmt: skip
