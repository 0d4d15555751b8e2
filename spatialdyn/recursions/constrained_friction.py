"""A step of the velocities under LuGre friction and a table of constraints.

Bristles share the load of a closed loop among its joints, which Coulomb's law leaves open: each joint's torque is a
function of its own deflection, linear in v⁺, so the step is ``constrained_motion`` with another M and τ.
"""

from __future__ import annotations

from ..algebra.scalars import inline
from .constrained import CHOSEN, FORCE, RANK, RATE, RESIDUAL, WORK, respond, stabilize
from .constraint_rows import CONSTRAINTS_ARGUMENT, turn_rows, write_drift, write_jacobian
from .crba import crba
from .friction import BRISTLES, DAMPING, DT, LAW, STIFFNESS, add_bristles
from .ltdl import factor_tree
from .rnea import rnea
from .signatures import Bodies, Config, Matrix, Number, Record, Vector, Work
from .spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V


@inline
def held_bristle_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number, coulomb: Vector,
    viscous: Vector, static: Vector, stribeck: Vector, stiffness: Vector, damping: Vector, constraints: Record,
    rate: Number, chosen: Vector, ahead: Vector, bristles: Vector, force: Vector, residual: Vector, rank: Vector,
    pivots: Vector, L: Matrix, Y: Matrix, G: Matrix, gamma: Vector, error: Vector, size: Vector, kept: Vector,
) -> None:  # fmt: skip
    """Velocities ahead (nv) and bristles (nv) after a step, λ = force (nc), residual (1) and rank (1).

    As ``bristle_step`` and ``constrained_motion``; what follows them is scratch.
    """
    n = len(bodies) - 1
    crba(bodies, work, q, L)
    rnea(bodies, work, q, v, None, fext, ahead)
    add_bristles(v, z, tau, dt, coulomb, viscous, static, stribeck, stiffness, damping, L, ahead, bristles)
    factor_tree(bodies, L)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, Y)
    write_drift(bodies, work, constraints, v, gamma)
    if rate is not None:
        stabilize(bodies, work, q, v, constraints, rate, Y, gamma, error)
    for i in range(n):
        pivots[i] = L[i, i]
    respond(bodies, constraints, chosen, L, Y, G, gamma, size, kept, ahead, force, residual, rank)
    for i in range(n):
        ahead[i] = v[i] + dt * ahead[i]
        bristles[i] = (z[i] + dt * ahead[i]) * bristles[i]


_DENSE = (("nv", "nv"), ("nc", "nv"), ("nc", "nc"))
HELD_BRISTLES = Spec(
    "held_bristle_step", held_bristle_step, WORK,
    (Q, V, BRISTLES, TAU, FEXT_OPTIONAL, DT, *LAW, STIFFNESS, DAMPING, CONSTRAINTS_ARGUMENT, RATE, CHOSEN),
    Argument("result", ("nv+nv+nc+2",), "", "velocities and bristles after a step, force, residual, rank"),
    "A step of the velocities under LuGre friction and constraints.", "see ``recursions.friction``",
    pivots=True, regroup=True, scratch=(*_DENSE, ("nc",), ("nc",), ("nc",), ("nc",)),
    parts=(
        Argument("ahead", ("nv",), "rad/s | m/s", "velocities after a step"),
        Argument("bristles", ("nv",), "rad | m", "deflection of the bristles after a step"), FORCE, RESIDUAL, RANK,
    ),
)  # fmt: skip
