"""The joint-space mass matrix M(q) by the composite rigid body algorithm."""

from __future__ import annotations

from ...algebra.records import inertia_of, motion_of, pose_of, put_inertia, table_dtype, vec_of
from ...algebra.scalars import inline_or_by_rows
from ...algebra.spatial import Inertia, Pose, add_inertia, force_to_parent, inertia_to_parent, momentum, power
from ...bodies.joints import place_joint
from ...bodies.kinds import CONTINUED
from ..signatures import Bodies, Config, Matrix, Work
from ..spec import TURNED_Q, Argument, Spec
from .rotors import add_couple

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    Ic=Inertia,  # inertia of the body, outward; of the subtree, inward
)


@inline_or_by_rows
def crba(bodies: Bodies, work: Work, q: Config, M: Matrix) -> None:
    """RBDA table 6.2 in body coordinates; both triangles of M are written."""
    n = len(bodies) - 1
    for i in range(1, n + 1):
        place_joint(bodies, i, q, work[i].X)
        put_inertia(work[i].Ic, inertia_of(bodies[i].inertia))
        for j in range(n):
            M[i - 1, j] = 0.0

    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        Ic = inertia_of(here.Ic)
        if b.kind == CONTINUED:  # in the place of its parent
            put_inertia(parent.Ic, add_inertia(inertia_of(parent.Ic), Ic))
        elif b.parent > 0:
            put_inertia(parent.Ic, add_inertia(inertia_of(parent.Ic), inertia_to_parent(pose_of(here.X), Ic)))

        F = momentum(Ic, motion_of(b.S))
        M[i - 1, i - 1] = power(motion_of(b.S), F) + b.armature
        j = i
        while bodies[j].parent > 0:
            if bodies[j].kind != CONTINUED:
                F = force_to_parent(pose_of(work[j].X), F)
            if j == i and b.geared:
                F = add_couple(F, vec_of(b.rotor))
            j = bodies[j].parent
            Mij = power(motion_of(bodies[j].S), F)
            if j == b.parent and b.coupled:
                Mij = Mij + b.coupling
            M[i - 1, j - 1] = Mij
            M[j - 1, i - 1] = Mij


SPECS = (
    Spec(
        "crba", crba, WORK, (TURNED_Q,),
        Argument("M", ("nv", "nv"), "kg m² | kg m | kg", "mass matrix, symmetric, both triangles filled"),
        "Joint-space mass matrix M(q) by the composite rigid body algorithm.",
        "Featherstone, RBDA (2008), table 6.2.", regroup=True, mirrored=True,
    ),
)  # fmt: skip
