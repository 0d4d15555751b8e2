"""The inverse M(q)⁻¹ of the mass matrix by the sweep of the articulated body algorithm, with unit torques.

All is in the root-aligned axes of ``coriolis``, each row about its own origin: a force or an acceleration that is taken
from row to row only moves to another origin, which a column of M⁻¹ does for every row.
"""

from __future__ import annotations

from ..algebra.articulated import (
    Articulated,
    add_articulated,
    articulated,
    articulated_at_parent,
    articulated_force,
    subtract_outer,
)
from ..algebra.euclidean import rotate
from ..algebra.records import (
    articulated_of,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_articulated,
    put_force,
    put_motion,
    table_dtype,
    vec_of,
)
from ..algebra.scalars import inline
from ..algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_motion,
    force_at_parent,
    motion_at_child,
    power,
    scale_force,
    scale_motion,
    zero_motion,
)
from ..bodies.kinds import CONTINUED
from .aba import coupled_to_partner
from .coriolis import to_root_aligned_axes
from .rotors import add_couple
from .signatures import Array, Bodies, Config, Matrix, Vector, Work
from .spec import TURNED_Q, Argument, MassMatrix, Spec

WORK = table_dtype(
    X=Pose,  # pose of the row relative to its parent's, in root-aligned axes; outward
    S=Motion,  # motion subspace in root-aligned axes; outward
    I=Inertia,  # inertia in root-aligned axes; outward
    IA=Articulated,  # articulated inertia; of the body alone, outward; of its subtree, inward
    U=Force,  # IA S, and n J e of a rotor; inward
    d=float,  # 1 / D = 1 / (S·IA S + armature); inward
    F=Force,  # force that a unit torque of this row leaves on the row reached; inward, column by column
    P=Motion,  # acceleration that the unit torque causes; outward, column by column
)


@inline
def minverse(bodies: Bodies, work: Work, q: Config, Minv: Matrix, pivots: Vector) -> None:
    """M⁻¹ column by column through one articulated sweep."""
    n = len(bodies) - 1
    to_root_aligned_axes(bodies, work, q)
    for i in range(1, n + 1):
        put_articulated(work[i].IA, articulated(inertia_of(work[i].I)))

    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        p, S, IA = vec_of(here.X.p), motion_of(here.S), articulated_of(here.IA)
        U = articulated_force(IA, S)
        D = power(S, U) + b.armature
        if b.partner > 0:
            k = work[b.partner]
            W = force_at_parent(vec_of(k.X.p), force_of(k.U))
            U, D = coupled_to_partner(bodies[b.partner].coupling, k.d, W, S, U, D)
        d = 1.0 / D
        if b.geared:
            U = add_couple(U, rotate(pose_of(parent.X).R, vec_of(b.rotor)))
        Ia = subtract_outer(IA, U, scale_force(d, U))
        if b.kind == CONTINUED:  # in the place of its parent
            put_articulated(parent.IA, add_articulated(articulated_of(parent.IA), Ia))
        elif b.parent > 0:
            put_articulated(parent.IA, add_articulated(articulated_of(parent.IA), articulated_at_parent(p, Ia)))
        put_force(here.U, U)
        here.d = d
        pivots[i - 1] = D
    inverse_columns(bodies, work, Minv)


@inline
def inverse_columns(bodies: Bodies, work: Work, Minv: Matrix) -> None:
    """M⁻¹ from the X, S, U and d = 1/D of an articulated sweep, in root-aligned axes.

    Inward, F_j is the force that a unit torque at row j leaves on the row it has reached; outward, P the
    acceleration it causes. Only rows i <= j are computed, the rest is symmetry.
    """
    n = len(bodies) - 1
    put_motion(work[0].P, zero_motion())
    for i in range(n, 0, -1):
        b, here = bodies[i], work[i]
        p, S, U, d = vec_of(here.X.p), motion_of(here.S), force_of(here.U), here.d
        for j in range(1, n + 1):
            Minv[i - 1, j - 1] = 0.0
        Minv[i - 1, i - 1] = d
        put_force(here.F, force_at_parent(p, scale_force(d, U)))
        for j in range(i + 1, b.last_row + 1):
            F = force_of(work[j].F)
            Mij = -d * power(S, F)
            if b.partner > 0:
                Mij = Mij - d * (bodies[b.partner].coupling * Minv[b.partner - 1, j - 1])
            Minv[i - 1, j - 1] = Mij
            F = add_force(F, scale_force(Mij, U))
            put_force(work[j].F, F if b.kind == CONTINUED else force_at_parent(p, F))

    for j in range(1, n + 1):
        root = j
        while bodies[root].parent > 0:
            root = bodies[root].parent
        for i in range(root, j + 1):  # zero for rows of another branch from the world
            here, parent = work[i], work[bodies[i].parent]
            P = motion_of(parent.P)
            if bodies[i].kind != CONTINUED:
                P = motion_at_child(vec_of(here.X.p), P)
            Mij = Minv[i - 1, j - 1] - here.d * power(P, force_of(here.U))
            if bodies[i].coupled:
                Mij = Mij - here.d * (bodies[i].coupling * Minv[bodies[i].parent - 1, j - 1])
            put_motion(here.P, add_motion(P, scale_motion(Mij, motion_of(here.S))))
            Minv[i - 1, j - 1] = Mij
            Minv[j - 1, i - 1] = Mij


def minverse_through_M(M: MassMatrix, q: Array) -> Array:
    """M⁻¹ itself."""
    return M.inverse


SPECS = (
    Spec(
        "minverse", minverse, WORK, (TURNED_Q,),
        Argument("Minv", ("nv", "nv"), "1/(kg m²) | 1/(kg m) | 1/kg", "inverse mass matrix, both triangles filled"),
        "Inverse M(q)⁻¹ of the mass matrix, without forming M.",
        "after Featherstone, RBDA (2008), table 7.1, with unit torques.", pivots=True, regroup=True,
        through_M=minverse_through_M, residual=("crba", "minverse"),
    ),
)  # fmt: skip
