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

from ...algebra.euclidean import Mat3, Vec
from ...algebra.records import table_dtype
from ...algebra.scalars import inline
from ...algebra.spatial import Pose
from ...bodies.joints import place_joint
from ..signatures import Array, Bodies, Config, Record, Vector, Work
from ..spec import Argument, Q, Spec
from .contact_rows import CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, place_points
from .impulse_step import OVER, impulse_step_spec

PLACES = table_dtype(X=Pose, R=Mat3, o=Vec)


@inline
def contact_gaps(
    bodies: Bodies, work: Work, q: Config, contacts: Record, heights: Record, gap: Vector, T: Array
) -> None:
    """Distance of each sphere from the ground, gap (np); T is scratch."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    place_points(bodies, work, contacts, heights, gap, T)


CONTACT_STEP, CONTACT_STEP_OVER = impulse_step_spec(frozenset()), impulse_step_spec(frozenset({OVER}))  # over heights
CONTACT_GAPS = Spec(
    "contact_gaps", contact_gaps, PLACES, (Q, CONTACTS_ARGUMENT, None),
    Argument("gap", ("np",), "m", "distance from the ground, negative in it"),
    "Distances of contact points from the ground.", "see ``recursions.contact.contact``", scratch=(("np", 3, 3),),
)  # fmt: skip
CONTACT_GAPS_OVER = replace(CONTACT_GAPS, name="contact_gaps_over", inputs=(Q, CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT))
