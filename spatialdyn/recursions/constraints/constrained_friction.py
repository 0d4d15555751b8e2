"""A step of the velocities under LuGre friction and a table of constraints.

Bristles determine how the joints of a closed loop share its load, which Coulomb's law does not: each joint's torque is
a function of its own deflection, linear in v⁺, so the step is ``constrained_motion`` with another M and τ.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.scalars import inline
from ..joints.friction import BRISTLE_LAW, BRISTLES, DT, BristleLaw, add_bristles
from ..signatures import Bodies, Config, Matrix, Number, Record, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V
from ..tree.crba import crba
from ..tree.rnea import rnea
from .constrained import CHOSEN, FORCE, RANK, RATE, RESIDUAL, WORK, ConstraintScratch, move_held
from .constraint_rows import CONSTRAINTS_ARGUMENT


class HeldBristles(NamedTuple):
    """The outputs of ``held_bristle_step``."""

    ahead: Vector
    bristles: Vector
    force: Vector
    residual: Vector
    rank: Vector


@inline
def held_bristle_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number,
    law: BristleLaw, constraints: Record, rate: Number, chosen: Vector, after: HeldBristles, pivots: Vector,
    s: ConstraintScratch,
) -> None:  # fmt: skip
    """Velocities and bristles after a step, as in ``bristle_step``, and the constraints' forces, as in
    ``constrained_motion``.
    """
    ahead, bristles = after.ahead, after.bristles
    crba(bodies, work, q, s.L)
    rnea(bodies, work, q, v, None, fext, ahead)
    add_bristles(v, z, tau, dt, law, s.L, ahead, bristles)
    move_held(bodies, work, q, v, constraints, rate, chosen, ahead, after.force, after.residual, after.rank, pivots, s)
    for i in range(len(bodies) - 1):
        ahead[i] = v[i] + dt * ahead[i]
        bristles[i] = (z[i] + dt * ahead[i]) * bristles[i]


HELD_BRISTLES = Spec(
    "held_bristle_step", held_bristle_step, WORK,
    (Q, V, BRISTLES, TAU, FEXT_OPTIONAL, DT, BRISTLE_LAW, CONSTRAINTS_ARGUMENT, RATE, CHOSEN),
    Argument("result", ("nv+nv+nc+2",), "", "velocities and bristles after a step, force, residual, rank"),
    "A step of the velocities under LuGre friction and constraints.", "see ``recursions.joints.friction``",
    pivots=True, regroup=True, composed=True, scratch=(ConstraintScratch(),),
    parts=HeldBristles(
        Argument("ahead", ("nv",), "rad/s | m/s", "velocities after a step"),
        Argument("bristles", ("nv",), "rad | m", "deflection of the bristles after a step"), FORCE, RESIDUAL, RANK,
    ),
)  # fmt: skip
