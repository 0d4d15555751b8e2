"""Hamilton's form: the momenta p = M(q) v, the energy H(q, p), and the rates of q and p, each in O(n).

p_i is the momentum conjugate to the joint velocity v_i, the momentum of all that row i carries along S_i. Where v
are the rates of coordinates it is the canonical momentum and ṗ = -∂H/∂q + τ; the v of a quaternion joint are twists
in its body's frame, and there the same sweep gives ṗ with the gyroscopic term that such a frame brings.
"""

from __future__ import annotations

from typing import Any

from ..algebra.articulated import Articulated
from ..algebra.euclidean import Vec, cross, times, unrotate, zero
from ..algebra.records import (
    force_from,
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
from ..algebra.scalars import inlined
from ..algebra.spatial import (
    Force,
    Motion,
    Pose,
    add_force,
    add_motion,
    cross_motion,
    force_to_parent,
    momentum,
    motion_to_child,
    power,
    zero_force,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .aba import articulated_inward, articulated_outward
from .energy import potential_energy
from .spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V

WORK_MOMENTUM = table_dtype(X=Pose, v=Motion, p=Force)
WORK_RATE = table_dtype(X=Pose, v=Motion, p=Force, g=Vec, f=Force)
WORK_VELOCITY = table_dtype(X=Pose, a=Motion, IA=Articulated, pA=Force, U=Force, d=float, u=float)
WORK_ENERGY = table_dtype(X=Pose, IA=Articulated, pA=Force, U=Force, d=float, u=float, m=float, h=Vec)
WORK = table_dtype(
    X=Pose, v=Motion, p=Force, g=Vec, f=Force, a=Motion, IA=Articulated, pA=Force, U=Force, d=float, u=float
)


@inlined
def generalized_momentum(bodies: Any, work: Any, q: Any, v: Any, p: Any) -> None:
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
        put_force(parent.p, add_force(force_of(parent.p), force_to_parent(pose_of(here.X), h)))


@inlined
def velocity_from_momentum(bodies: Any, work: Any, q: Any, p: Any, v: Any, pivots: Any) -> None:
    """v = M⁻¹ p: forward dynamics of a robot at rest, without gravity, whose torques are the momenta."""
    articulated_inward(bodies, work, q, None, p, None, pivots)
    articulated_outward(bodies, work, None, zero(), v)


@inlined
def momentum_rate(bodies: Any, work: Any, q: Any, v: Any, tau: Any, fext: Any, dp: Any) -> None:
    """ṗ = Cᵀ v + τ - g + Σ Jᵀ fext; tau, fext may be None, for zero. Poses are computed here."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    rate(bodies, work, v, tau, vec_of(bodies[0].gravity), fext, dp)


@inlined
def hamilton_field(bodies: Any, work: Any, q: Any, p: Any, tau: Any, fext: Any, v: Any, dp: Any, pivots: Any) -> None:
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


@inlined
def hamilton_rows(bodies: Any, work: Any, q: Any, p: Any, tau: Any, fext: Any, rates: Any, pivots: Any) -> None:
    """hamilton_field with its two outputs as the rows of one."""
    hamilton_field(bodies, work, q, p, tau, fext, rates[0], rates[1], pivots)


@inlined
def hamiltonian(bodies: Any, work: Any, q: Any, p: Any, H: Any, pivots: Any) -> None:
    """H = ½ pᵀ M⁻¹ p + V; the inward pass of ABA factors M⁻¹, so T = ½ Σ u²/D is a sum of squares."""
    potential_energy(bodies, work, q, H)
    articulated_inward(bodies, work, q, None, p, None, pivots)
    twice = 0.0
    for i in range(1, len(bodies)):
        twice = twice + work[i].d * work[i].u * work[i].u
    H[0] = H[0] + 0.5 * twice


@inlined
def _move(bodies: Any, work: Any, i: int, v: Any) -> None:
    """Velocity of body i and its own momentum, its parent's velocity and its pose being there."""
    here, parent = work[i], work[bodies[i].parent]
    vi = add_motion(motion_to_child(pose_of(here.X), motion_of(parent.v)), joint_motion(bodies, i, v))
    put_motion(here.v, vi)
    put_force(here.p, momentum(inertia_of(bodies[i].inertia), vi))


@inlined
def rate(bodies: Any, work: Any, v: Any, tau: Any, gravity: Any, fext: Any, dp: Any) -> None:
    """ṗ_i = (v × S)·p + S·f, with p the momentum of what row i carries, f its weight and the forces on it.

    Poses are there; tau, gravity (a Vec) and fext may be None, for zero: then ṗ is Cᵀ v alone.
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
            f = Force(cross(I.h, g), times(I.m, g))
            put_vec(here.g, g)
        if fext is not None and b.joint > 0:
            f = add_force(f, force_from(fext[b.joint]))
        put_force(here.f, f)

    for i in range(len(bodies) - 1, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        X, S, p = pose_of(here.X), motion_of(b.S), force_of(here.p)
        dp[i - 1] = power(cross_motion(motion_of(here.v), S), p)
        put_force(parent.p, add_force(force_of(parent.p), force_to_parent(X, p)))
        if gravity is not None or fext is not None:
            f = force_of(here.f)
            dp[i - 1] = dp[i - 1] + power(S, f)
            put_force(parent.f, add_force(force_of(parent.f), force_to_parent(X, f)))
        if tau is not None:
            dp[i - 1] = dp[i - 1] + tau[i - 1]


P = Argument("p", ("nv",), "kg m²/s | kg m/s", "joint momenta M(q) v", dual=True)
_RATE = Argument("dp", ("nv",), "N m | N", "rate of the joint momenta")
_ABA = "after Featherstone, RBDA (2008), table 7.1, with momenta in place of torques."
_SWEEP = "a derivation of our own from Hamilton's principle; momenta are summed inward as RBDA table 5.1 sums forces."
SPECS = (
    Spec(
        "momentum", generalized_momentum, WORK_MOMENTUM, (Q, V), P,
        "Joint momenta p = M(q) v, without forming M.",
        "after Featherstone, RBDA (2008), table 5.1, with velocities in place of accelerations.", regroup=True,
    ),
    Spec(
        "velocity_from_momentum", velocity_from_momentum, WORK_VELOCITY, (Q, P), V,
        "Joint velocities v = M(q)⁻¹ p of given joint momenta, without forming M.", _ABA, pivots=True, regroup=True,
    ),
    Spec(
        "hamiltonian", hamiltonian, WORK_ENERGY, (Q, P), Argument("H", (), "J", "energy"),
        "Hamiltonian H(q, p) = ½ pᵀ M(q)⁻¹ p + V(q): the energy as a function of positions and momenta.", _ABA,
        pivots=True,
    ),
    Spec(
        "momentum_rate", momentum_rate, WORK_RATE, (Q, V, TAU, FEXT_OPTIONAL), _RATE,
        "Rate ṗ = C(q, v)ᵀ v + tau - g(q) + Σ Jᵀ fext of the joint momenta p = M(q) v.", _SWEEP, regroup=True,
    ),
    Spec(
        "hamilton_field", hamilton_rows, WORK, (Q, P, TAU, FEXT_OPTIONAL),
        Argument("rates", (2, "nv"), "rad/s | m/s; N m | N", "joint velocities, and rates of the joint momenta"),
        "Hamilton's equations in one array: v = M(q)⁻¹ p and ṗ = C(q, v)ᵀ v + tau - g(q) + Σ Jᵀ fext, one above "
        "the other; ``hamilton_equations`` gives the pair.", _SWEEP, pivots=True, regroup=True,
    ),
)  # fmt: skip
