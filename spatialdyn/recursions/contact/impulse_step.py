"""A step of the velocities under all that acts by impulses: contact, joint limits, dry friction, constraints.

The law of ``contact``, with three more laws at the end of a step h. A joint with dry friction has an impulse s,

    s ∈ -h F(v) Sgn v⁺,

so that it sticks or moves as in ``friction``, up to its limits; bristles and damping are part of M and of the torques,
as there. Constraints hold for velocities, J v⁺ + h J̇ v = 0, or with a rate 1/T as in ``constrained``: their rows are
eliminated from M⁻¹ first, so that sweeps cannot violate them.

The impulses of points and joints are solved for together (``impulses``). With dry joints, whose internal forces are not
part of the state, the solution begins from λ of the step before; contacts alone begin from 0.

Source: the law as in ``contact``; its solution is a derivation of our own.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

from ...algebra.euclidean import unrotate
from ...algebra.records import mat3_of
from ...algebra.regions import repeat, settled
from ...algebra.scalars import Scalar, inline, select, sqrt
from ..constraints.constrained import (
    CHOSEN,
    RATE,
    WORK,
    add_impulses,
    factor_kept,
    felt,
    hold_rows,
    write_equations,
)
from ..constraints.constraint_rows import CONSTRAINTS_ARGUMENT, place_rows, write_error, write_jacobian
from ..constraints.dense import add_product, solve_backward, solve_forward
from ..coordinates.configuration import integrate
from ..coordinates.coordinate_rates import add_begun, turn
from ..joints.friction import BRISTLE_LAW, BRISTLES, DT, LAW, BristleLaw, add_bristles, dry_level, magnitude
from ..signatures import Bodies, Config, Matrix, Number, Record, Vector, Work
from ..spec import FEXT, TAU, Argument, Q, Spec, V
from ..tree.crba import crba
from ..tree.ltdl import add_times_L, factor_tree, solve_inward, solve_outward
from ..tree.rnea import rnea
from .contact_rows import (
    CONTACTS_ARGUMENT,
    ENERGY,
    GAP,
    HEIGHTS_ARGUMENT,
    IMPULSE,
    MU,
    RESTITUTION,
    STOP,
    Contact,
    force_of_point,
    untilted,
    work_of_row,
)
from .impulse_rows import (
    ROWS,
    Impulses,
    entry,
    joint_state,
    keep_inertia,
    open_laws,
    residual,
    residual_of_joints,
    square_of_point,
    sweep,
    write_responses,
)
from .impulses import SWEEPS, SWEEPS_AGAIN, SWEEPS_DRY, solve_impulses

# Share of the velocity change of dry friction: a load that exceeds the friction by less leaves a joint at rest, because
# sweeps determine the shares of stiff legs no better.
SLOW = 1e-4


class ImpulseResult(NamedTuple):
    """The outputs of ``impulse_step``."""

    after: Vector
    impulse: Vector
    gap: Vector
    stop: Vector
    residual: Vector
    energy: Vector
    friction: Vector
    bristles: Vector
    reaction: Vector
    missed: Vector
    start: Vector


class Held(NamedTuple):
    """The constraints of a step, and their treatment."""

    constraints: Record  # the table
    rate: Number  # 1/T of the stabilization; None: steps end with a projection
    chosen: Vector  # (nc) 1 for equations to keep, of ``independent_rows``; None: in their order


class HeldScratch(NamedTuple):
    """Scratch of constraints in a step."""

    N: Matrix = ("nc", "nv")  # J, then J L⁻¹
    G: Matrix = ("nc", "nc")  # inverse inertia of the constraints, then its factors; the lower triangle
    gamma: Vector = ("nc",)  # h γ, then the residuals of the equations
    scale: Vector = ("nc",)  # the number that a pivot is compared with: response of an equation's constraint
    kept: Vector = ("nc",)  # 1 of an equation that is independent, else 0
    change: Vector = ("nc",)  # of impulses after the sweeps
    P: Matrix = (ROWS, "nc")  # reactions to unit impulses
    J: Matrix = ("nc", "nv")  # J; after the sweeps J at the end of the step
    ways: Matrix = (2, "nv")  # velocities at the end, and the displacement that closes the constraints
    turned: Matrix = (2, "nv")  # displacement of the step, and zeros
    ends: Matrix = (2, "nq")  # configurations


@inline
def impulse_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number,
    contact: Contact, law: BristleLaw, held: Held, out: ImpulseResult, pivots: Vector, s: Impulses, h: HeldScratch,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, residuals of the laws, friction, reactions.

    With M = LᵀD L, Y = J L⁻¹ and w = L (v⁺ - v), u = J v + Y w, and a change δλ changes w by D⁻¹ Yᵀ δλ: only the blocks
    of G for single points are needed.

    z      deflection of bristles, as in ``bristle_step``; None: dry friction
    law    of dry friction if z is None; it may be None: no friction
    fext   may be None; held and h are None without constraints
    out.after     (nv), written: v⁺; for floating and planar joints in the axes at the beginning, see ``turn``
    out.impulse   (3 np), written: on each point, in the world's axes
    out.gap       (np), written: distance of each sphere from the ground before the step, negative in it
    out.stop      (nl), written: impulse on each joint, positive from its lower limit
    out.residual  (np + nl + nd), written: the violation of each point's and joint's law [m/s | rad/s]
    out.energy    (np + nl), written: work of each impulse, ½ λᵀ (u⁻ + u⁺) of the velocities before and after it [J]
    out.friction  (nv), written: dry friction torque [N m | N], if friction is dry
    out.bristles  (nv), written: deflections after the step, if there are bristles
    out.reaction  (nc), written: impulse of each equation
    out.start     (rows), written: λ, if steps begin from the λ before
    out.missed    (2), written if there are constraints: residual and rank, as of ``constrained_motion``
    """
    contacts, n, after = contact.contacts, len(bodies) - 1, out.after
    rubs = law is not None and z is None
    move_freely(bodies, work, q, v, z, tau, fext, dt, law, out, pivots, s)
    add_begun(bodies, dt, v, s.begun)
    add_times_L(bodies, s.L, s.begun, after)
    write_responses(bodies, work, contact, v, out.gap, s)
    if held is not None:
        hold(bodies, work, q, v, dt, held, out, s, h)
    rub(v, z, dt, contact, law, s)
    open_laws(q, dt, contact, out.gap, after, s)
    for k in range(len(s.force)):
        s.force[k] = entry(contact.start, k)
    solve_impulses(contact, h, SWEEPS_DRY if rubs else SWEEPS, rubs, after, s)
    if held is not None and held.rate is None:
        meet(bodies, work, q, v, dt, held.constraints, out, s, h)
        settle(contact, after, s)
    for k in range(len(s.force)):
        s.total[k] = s.first[k] + s.force[k]
    write_laws(dt, contact, rubs, out, s)
    keep(contact.start, s.total, out.start)
    if held is not None:
        for k in range(len(out.reaction)):
            for l in range(len(s.force)):
                out.reaction[k] = out.reaction[k] + h.P[l, k] * s.total[l]
    solve_outward(bodies, s.L, after)
    for i in range(n):
        after[i] = v[i] + after[i]
    if rubs:
        for j in range(len(s.rests)):
            i = contacts[1 + contacts[0].np + j].row - 1
            after[i] = select(s.rests[j], 0.0, after[i])
    if z is not None:
        for i in range(n):
            out.bristles[i] = (z[i] + dt * after[i]) * out.bristles[i]


@inline
def keep(start: Vector, total: Vector, after: Vector) -> None:
    """Write λ for the next step, if steps begin from the λ before."""
    if start is not None:
        for k in range(len(total)):
            after[k] = total[k]


# --- before the sweeps ----------------------------------------------------------------------------------


@inline
def move_freely(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number, law: BristleLaw,
    out: ImpulseResult, pivots: Vector, s: Impulses,
) -> None:  # fmt: skip
    """M, with what friction adds, factored in L; in ``after`` w = L (v⁺ - v) without impulses."""
    n, after, L = len(bodies) - 1, out.after, s.L
    crba(bodies, work, q, L)
    rnea(bodies, work, q, v, None, fext, after)
    if z is None:
        for i in range(n):
            after[i] = tau[i] - after[i]
            if law is not None:
                L[i, i] = L[i, i] + dt * law.viscous[i]
                after[i] = after[i] - law.viscous[i] * v[i]
                out.friction[i] = 0.0
    else:
        add_bristles(v, z, tau, dt, law, L, after, out.bristles)
    keep_inertia(s)
    factor_tree(bodies, L)
    for i in range(n):
        pivots[i] = L[i, i]
        after[i] = dt * after[i]
    solve_inward(bodies, L, after)
    for i in range(n):
        after[i] = after[i] * (1.0 / L[i, i])


@inline
def rub(v: Vector, z: Vector, dt: Number, contact: Contact, law: BristleLaw, s: Impulses) -> None:
    """Write the most by which dry friction changes velocities."""
    contacts = contact.contacts
    points = contacts[0].np
    for j in range(len(s.level)):
        s.level[j] = 0.0
        if law is not None and z is None:
            s.level[j] = dt * dry_level(v, law, contacts[1 + points + j].row - 1)


@inline
def hold(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Number, held: Held, out: ImpulseResult, s: Impulses,
    h: HeldScratch,
) -> None:  # fmt: skip
    """Eliminate the constraints from w, and from Z = D⁻¹ Yᵀ, the change of w with impulses. Dependent rows are dropped:
    in the given order, or those that are not chosen.

    w, Z, reaction, missed and P, the reactions to unit impulses, are written.
    """
    n, constraints, rate, gamma = len(bodies) - 1, held.constraints, held.rate, h.gamma
    write_equations(bodies, work, q, v, constraints, rate, h.N, gamma, out.reaction)
    for k in range(len(gamma)):
        gamma[k] = dt * gamma[k]
        for i in range(n):
            h.J[k, i] = h.N[k, i]
            gamma[k] = gamma[k] + h.N[k, i] * (v[i] - s.begun[i] if rate is None else -s.begun[i])
    felt(bodies, s.L, h.N, h.G)
    factor_kept(bodies, constraints, held.chosen, h.G, h.scale, h.kept)
    out.missed[0], out.missed[1] = hold_rows(
        held.chosen, s.L, h.N, h.G, gamma, h.scale, h.kept, out.after, out.reaction
    )  # fmt: skip
    for l in range(len(s.Z)):
        for k in range(len(gamma)):
            gamma[k] = add_product(0.0, h.N, s.Z[l], k)
        push_back(s.L, h, s.Z[l], h.P[l])


@inline
def meet(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Number, constraints: Record, out: ImpulseResult,
    s: Impulses, h: HeldScratch,
) -> None:  # fmt: skip
    """Make v⁺ satisfy J v⁺ = 0 at the end of the step, with q projected, not only J v⁺ + h J̇ v = 0 at its beginning.

    The two differ by O(h²) in smooth motion and by O(h) in an impact; the remaining error is one order smaller. The
    last sweeps follow and adapt points and dry joints to the change. w, in ``after``, and reaction are written.
    """
    n, w, gamma, way, back = len(bodies) - 1, out.after, h.gamma, h.ways[0], h.ways[1]
    for i in range(n):
        way[i] = w[i]
    solve_outward(bodies, s.L, way)
    for i in range(n):
        h.turned[0, i], way[i], h.turned[1, i] = dt, v[i] + way[i], 0.0
    turn(bodies, h.turned[0], h.turned[1], way, h.turned[0])
    integrate(bodies, q, h.turned[0], h.ends[0])
    place_rows(bodies, work, h.ends[0])
    write_error(bodies, work, constraints, h.ends[0], gamma)
    for i in range(n):
        back[i] = 0.0
    push_back(s.L, h, back, h.change)
    solve_outward(bodies, s.L, back)
    integrate(bodies, h.ends[0], back, h.ends[1])
    place_rows(bodies, work, h.ends[1])
    write_jacobian(bodies, work, constraints, h.J)
    for k in range(len(gamma)):
        gamma[k] = add_product(0.0, h.J, way, k)
    push_back(s.L, h, w, h.change)
    for k in range(len(gamma)):
        out.reaction[k] = out.reaction[k] + h.change[k]


@inline
def push_back(L: Matrix, h: HeldScratch, w: Vector, force: Vector) -> None:
    """Subtract gamma (nc) from the constraints' velocities in w, by impulses, which are written to force."""
    for k in range(len(h.gamma)):
        h.gamma[k] = -h.gamma[k]
    solve_forward(h.G, h.gamma)
    solve_backward(h.G, h.gamma, force)
    add_impulses(L, h.N, force, w)


# --- after them -----------------------------------------------------------------------------------------


@inline
def settle(contact: Contact, w: Vector, s: Impulses) -> None:
    """Sweeps that adapt points and joints to the changes by ``meet``."""
    s.left[0] = residual(contact, w, s) - contact.contacts[0].tolerance
    for _ in repeat(SWEEPS_AGAIN, s.left, s.force, w):
        if settled(s.left[0]):
            break
        sweep(contact, True, w, s)
        s.left[0] = residual(contact, w, s) - contact.contacts[0].tolerance


@inline
def write_laws(dt: Number, contact: Contact, rubs: bool, out: ImpulseResult, s: Impulses) -> None:
    """Write the results of points and joints: impulses, stops, dry friction, residuals, energy, which joints rest."""
    contacts, w, force, level = contact.contacts, out.after, s.total, s.level
    points = contacts[0].np
    for p in range(points):
        out.residual[p] = sqrt(square_of_point(p, contact.mu[p], w, s))
        out.energy[p] = 0.0
        for k in range(3 * p, 3 * p + 3):
            out.energy[p] = out.energy[p] + work_of_row(s.Y, s.before, w, k, force[k])
        f = force_of_point(force, p)
        if contact.heights is not None:
            f = untilted(s.slopes[p], f)
        f = unrotate(mat3_of(contacts[0].axes), f)
        out.impulse[3 * p], out.impulse[3 * p + 1], out.impulse[3 * p + 2] = f.x, f.y, f.z
    residual_of_joints(w, s)
    for j in range(len(level)):
        k, dry = 3 * points + j, 0.0
        out.residual[points + j] = s.off[j]
        if rubs:
            x, least = joint_state(j, w, s), SLOW * s.own[k] * level[j]
            dry = select(x.u - least, -level[j], select(-least - x.u, level[j], within(force[k], level[j])))
            s.rests[j] = select(least - magnitude(x.u), 1.0, x.rests)
            out.friction[contacts[1 + points + j].row - 1] = dry / dt  # of a joint that moves, against that
        if j < contacts[0].nl:
            out.stop[j] = force[k] - dry
            out.energy[points + j] = work_of_row(s.Y, s.before, w, k, out.stop[j])


@inline
def within(x: Scalar, most: Scalar) -> Scalar:
    """x, or the nearer of ±most."""
    return select(x - most, most, select(-most - x, -most, x))


AFTER = Argument("v", ("nv",), "rad/s | m/s", "after the step, in the axes at its beginning")
RESIDUAL = Argument("residual", ("np+nl+nd",), "m/s | rad/s", "by how much each point and joint misses its law")
REACTION = Argument("reaction", ("nc",), "N s | N m s", "of each equation, on frame a, in b's axes")
START = Argument("impulses_before", (ROWS,), "", "impulses of rows in the step before", start=0.0)
MISSED = Argument("missed", (2,), "1", "of equations that depend on others, and how many are independent")
ALL = ("heights", "friction", "bristles", "constraints", "rate", "chosen", "fext", "start", "no_bounce")
OVER, RUBS, BENDS, HOLDS, STEADIES, CHOOSES, PUSHED, WARM, RESTS = ALL


@cache
def impulse_step_spec(has: frozenset[str]) -> Spec:
    """The Spec of a step with some of ALL; bristles beside friction, a rate and choice beside constraints.

    Of contacts and limits alone it is ``contact_step``.
    """

    def given(what: str, x: Record) -> Record:
        return x if what in has else None

    rubs = given(BENDS, BRISTLE_LAW) if BENDS in has else given(RUBS, LAW)
    bounces = None if RESTS in has else RESTITUTION
    ground = Contact(CONTACTS_ARGUMENT, given(OVER, HEIGHTS_ARGUMENT), MU, bounces, given(WARM, START))
    inputs = (
        Q, V, given(BENDS, BRISTLES), TAU, given(PUSHED, FEXT), DT, ground, rubs,
        Held(
            given(HOLDS, CONSTRAINTS_ARGUMENT), given(STEADIES, replace(RATE, optional=False)),
            given(CHOOSES, replace(CHOSEN, optional=False)),
        ),
    )  # fmt: skip
    parts = ImpulseResult(
        AFTER, IMPULSE, GAP, STOP, RESIDUAL, ENERGY,
        Argument("friction", ("nv" if RUBS in has and BENDS not in has else 0,), "N m | N", "dry friction torques"),
        Argument("bristles", ("nv" if BENDS in has else 0,), "rad | m", "after the step"),
        replace(REACTION, shape=("nc" if HOLDS in has else 0,)), replace(MISSED, shape=(2 if HOLDS in has else 0,)),
        Argument(f"{START.name}_after", (ROWS if WARM in has else 0,), "", "impulses of rows"),
    )  # fmt: skip
    width = "+".join(str(x) for part in parts for x in part.shape if x)
    name = "impulse_step" if has - {OVER, RESTS} else "contact_step"
    return Spec(
        "_".join([name, *(x for x in ALL if x in has)]), impulse_step, WORK, inputs,
        Argument("result", (width,), "", ", ".join(x.name for x in parts)),
        "A step of the velocities under contact, limits, dry friction and constraints.",
        "see ``recursions.contact.impulse_step``", pivots=True, regroup=True, composed=True,
        large=True, scratch=(Impulses(), HeldScratch() if HOLDS in has else None),
        parts=parts,
    )  # fmt: skip
