"""A step of the velocities under contact with Coulomb friction, and with joints that stop at their limits.

Impulses λ act at the end of a step h, so that velocities of touching points jump and no contact needs shorter steps.
With u = J v⁺ of the points, G = J M⁻¹ Jᵀ and b = J (v + h M⁻¹ (τ - bias)),

    u = b + G λ,    0 ≤ λ_n ⊥ u_n + c ≥ 0,    |λ_t| ≤ μ λ_n,    u_t against λ_t where |λ_t| = μ λ_n, else 0

is Signorini's and Coulomb's law, with the exact cone, neither a pyramid nor smoothed. An open gap g has c = g/h: a
point that does not reach the ground within the step gets no impulse, and no point passes through it. A point in the
ground rises by a share of its depth in each step. A joint with limits has a row of its own, whose impulse keeps
q + h v⁺ within them.

One point alone is solved in its three unknowns together (``coulomb_cone``), since solving normal and friction impulses
by turns diverges if μ |G_nt| > G_nn, as for legs. The point leaves, sticks or slides. All points and joints are solved
together from these local solutions to a tolerance, in sweeps and by Newton's method (``impulses``), from λ = 0: a step
depends on its state alone. Points bounce by Poisson's law.

Source: after Le Lidec, Jallet, Montaut, Laptev, Schmid, Carpentier, Contact models in robotics: a comparative analysis
(arXiv 2304.06372), for the law; the step and its solution are our own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from ...algebra.euclidean import Mat3, Vec
from ...algebra.records import mat3_of, put_mat3, table_dtype
from ...algebra.scalars import inline
from ...algebra.spatial import Pose
from ...bodies.joints import place_joint
from ..constraints.constraint_rows import carry_axes
from ..coordinates.coordinate_rates import add_begun
from ..joints.friction import DT
from ..signatures import Array, Bodies, Config, Number, Record, Vector, Work
from ..spec import TAU, Argument, Q, Spec, V
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
    RESIDUAL,
    RESTITUTION,
    STOP,
    WORK,
    Contact,
    work_of_row,
    write_gaps,
    write_point,
)
from .impulse_rows import Impulses, keep_inertia, open_laws, residual, write_responses
from .impulses import SWEEPS, solve_impulses

PLACES = table_dtype(X=Pose, R=Mat3, o=Vec)


class ContactResult(NamedTuple):
    """The outputs of ``contact_step``."""

    after: Vector
    impulse: Vector
    gap: Vector
    stop: Vector
    residual: Vector
    energy: Vector


@inline
def contact_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, dt: Number, contact: Contact, out: ContactResult,
    pivots: Vector, s: Impulses,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, and residuals of the contact law.

    With M = LᵀD L, Y = J L⁻¹ and w = L (v⁺ - v), u = J v + Y w, and a change δλ changes w by D⁻¹ Yᵀ δλ: only the blocks
    of G for single points are needed.

    out.after     (nv), written: v⁺; for floating and planar joints in the axes at the beginning, see ``turn``
    out.impulse   (3 np), written: on each point, in the world's axes
    out.gap       (np), written: distance of each sphere from the ground before the step, negative in it
    out.stop      (nl), written: impulse on each joint, positive from its lower limit
    out.residual  (np + nl), written: the violation of each point's and joint's law [m/s | rad/s]
    out.energy    (np + nl), written: work of each impulse, ½ λᵀ (u⁻ + u⁺) of the velocities before and after it [J]
    """
    contacts, n, after, L = contact.contacts, len(bodies) - 1, out.after, s.L
    points = contacts[0].np
    crba(bodies, work, q, L)
    keep_inertia(s)
    factor_tree(bodies, L)
    rnea(bodies, work, q, v, None, None, after)
    for i in range(n):
        pivots[i] = L[i, i]
        after[i] = dt * (tau[i] - after[i])
    solve_inward(bodies, L, after)
    for i in range(n):
        after[i] = after[i] * (1.0 / L[i, i])  # w without impulses
    add_begun(bodies, dt, v, s.begun)
    add_times_L(bodies, L, s.begun, after)
    write_responses(bodies, work, contact, v, out.gap, s)
    for k in range(len(s.force)):
        s.force[k] = 0.0
    for j in range(len(s.level)):
        s.level[j] = 0.0
    open_laws(q, dt, contact, out.gap, after, s)
    solve_impulses(contact, None, SWEEPS, False, after, s)
    for p in range(points):
        write_point(contacts, contact.heights, contact.mu[p], s.B[p], after, p, out, s)
    residual(contact, after, s)
    for l in range(contacts[0].nl):
        k = 3 * points + l
        out.residual[points + l] = s.off[l]
        out.stop[l] = s.first[k] + s.force[k]
        out.energy[points + l] = work_of_row(s.Y, s.before, after, k, out.stop[l])
    solve_outward(bodies, L, after)
    for i in range(n):
        after[i] = v[i] + after[i]


@inline
def contact_gaps(
    bodies: Bodies, work: Work, q: Config, contacts: Record, heights: Record, gap: Vector, T: Array
) -> None:
    """Distance of each sphere from the ground, gap (np); T is scratch."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, heights, gap, T)


CONTACT_STEP = Spec(
    "contact_step", contact_step, WORK, (Q, V, TAU, DT, Contact(CONTACTS_ARGUMENT, None, MU, RESTITUTION)),
    Argument("result", ("nv+np+np+np+np+np+nl+nl+np+nl",), "", "v, impulse, gap, stop, residual, energy"),
    "A step of the velocities under contact with Coulomb friction.", "see ``recursions.contact.contact``",
    pivots=True, regroup=True, composed=True, large=True,
    scratch=(Impulses(),),
    parts=ContactResult(
        Argument("v", ("nv",), "rad/s | m/s", "after the step, in the axes at its beginning"), IMPULSE, GAP, STOP,
        RESIDUAL, ENERGY,
    ),
)  # fmt: skip
CONTACT_GAPS = Spec(
    "contact_gaps", contact_gaps, PLACES, (Q, CONTACTS_ARGUMENT, None),
    Argument("gap", ("np",), "m", "distance from the ground, negative in it"),
    "Distances of contact points from the ground.", "see ``recursions.contact.contact``", scratch=(("np", 3, 3),),
)  # fmt: skip
CONTACT_STEP_OVER = replace(  # over heights
    CONTACT_STEP, name="contact_step_over",
    inputs=(Q, V, TAU, DT, Contact(CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION)),
)  # fmt: skip
CONTACT_GAPS_OVER = replace(CONTACT_GAPS, name="contact_gaps_over", inputs=(Q, CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT))
