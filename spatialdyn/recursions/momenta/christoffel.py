"""The Christoffel symbols Γ_ijk of M(q), C_ij = Σ_k Γ_ijk v_k, and the tensor ∂M_ij/∂q_k.

For coordinates, 2 Γ_ijk = ∂_k M_ij + ∂_j M_ik - ∂_i M_jk. The velocities of spherical, floating and planar joints
are no rates of coordinates: they belong to vector fields X_k with brackets [X_j, X_k] = Σ c^m_jk X_m, for which
Koszul's formula adds c^m_kj M_mi - c^m_ki M_mj - c^m_ji M_mk, and Γ_ijk - Γ_ikj = c^m_kj M_mi is not zero.

With I the inertia of the subtree of the deepest of the three rows, e the deeper of the rows j and k and o the other,
Γ_ijk = S_i·B(I, S_e) S_o; for rows of one joint e is j. a·B(I, v) b is antisymmetric in a and v, so for t below c below
a, two numbers, S_a·B_t S_c and S_c·B_t S_a with B_t = B(I, S_t), give all six orders. Source: after Echeandia and
Wensing, Numerical methods to compute the Coriolis matrix and Christoffel symbols for rigid-body systems (2021), section
on Christoffel symbols; the form is our own.
"""

from __future__ import annotations

from ...algebra.coriolis_factor import (
    CoriolisFactor,
    coriolis_factor,
    coriolis_factor_at_parent,
    coriolis_times,
    coriolis_transpose_times,
)
from ...algebra.euclidean import cross, dot, rotate
from ...algebra.records import inertia_of, motion_of, pose_of, put_inertia, table_dtype, vec_of
from ...algebra.scalars import inline
from ...algebra.spatial import Inertia, Motion, Pose, add_inertia, force_at_parent, inertia_at_parent, power
from ...bodies.kinds import CONTINUED
from ..signatures import Array, Bodies, Config, Matrix, Work
from ..spec import TURNED_Q, Argument, Spec
from .coriolis import to_root_aligned_axes

WORK = table_dtype(
    X=Pose,  # pose of the row relative to its parent's, in root-aligned axes; outward
    S=Motion,  # motion subspace in root-aligned axes; outward
    I=Inertia,  # inertia in root-aligned axes, outward; of the subtree, inward
)


@inline
def _first(bodies: Bodies, i: int) -> int:
    """First row of the joint that row i belongs to."""
    while bodies[i].kind == CONTINUED:
        i = i - 1
    return i


@inline
def christoffel_symbols(bodies: Bodies, work: Work, q: Config, G: Array) -> None:
    """For every row t: B at t's origin, moved from joint to joint to the root, paired with each row c on the way."""
    n = len(bodies) - 1
    G[:] = 0.0
    to_root_aligned_axes(bodies, work, q)
    for i in range(n, 0, -1):
        if bodies[i].parent > 0:
            here, parent = work[i], work[bodies[i].parent]
            moved = inertia_at_parent(vec_of(here.X.p), inertia_of(here.I))
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), moved))

    for t in range(1, n + 1):
        first = _first(bodies, t)
        B = coriolis_factor(inertia_of(work[t].I), motion_of(work[t].S))
        c = first + bodies[first].dofs - 1
        while c > 0:
            _with_rows_above(bodies, work, t, first, c, B, G)
            B = coriolis_factor_at_parent(vec_of(work[c].X.p), B)
            c = bodies[c].parent
    for t in range(1, n + 1):
        if bodies[t].geared:
            _of_rotor(bodies, work, t, G)


@inline
def _of_rotor(bodies: Bodies, work: Work, t: int, G: Array) -> None:
    """Add the symbols of the rotor of row t, whose n J e·S_j is M_tj for the rows j that carry it.

    With half = ½ n J e·(S_j × S_k) for two such rows, M_tj changes by 2 half along k if k is below j's joint, else not.
    """
    p = bodies[t].parent
    e = rotate(pose_of(work[p].X).R, vec_of(bodies[t].rotor))
    j = p
    while j > 0:
        last = j
        while last + 1 < len(bodies) and bodies[last + 1].kind == CONTINUED:
            last = last + 1
        k = p
        while k > 0:
            half = 0.5 * dot(e, cross(motion_of(work[j].S).w, motion_of(work[k].S).w))
            G[t - 1, j - 1, k - 1] = G[t - 1, j - 1, k - 1] + (half if k > last else -half)
            G[j - 1, t - 1, k - 1] = G[j - 1, t - 1, k - 1] + half
            G[j - 1, k - 1, t - 1] = G[j - 1, k - 1, t - 1] + half
            k = bodies[k].parent
        j = bodies[j].parent


@inline
def _with_rows_above(bodies: Bodies, work: Work, t: int, first: int, c: int, B: CoriolisFactor, G: Array) -> None:
    """The symbols of the rows t, c and each a from c to the root; ``first`` is the first row of the joint of t.

    up = S_a·B S_c and down = S_c·B S_a. Where a or c is t, one of them is t·B t = 0 by the antisymmetry of B.
    """
    S = motion_of(work[c].S)
    force, couple = coriolis_times(B, S), coriolis_transpose_times(B, S)
    joint = _first(bodies, c)
    a = c
    while a > 0:
        Sa = motion_of(work[a].S)
        up, down = 0.0, 0.0
        if a != t:
            up = power(Sa, force)
        if a == c:
            down = up
        elif c != t:
            down = dot(Sa.w, couple)
        G[a - 1, t - 1, c - 1] = up
        G[c - 1, t - 1, a - 1] = down
        if a < first:
            G[c - 1, a - 1, t - 1] = down
        if c < first:
            G[a - 1, c - 1, t - 1] = up
            G[t - 1, c - 1, a - 1] = -down
            G[t - 1, a - 1, c - 1] = -up if a >= joint else -down
        force = force_at_parent(vec_of(work[a].X.p), force)
        a = bodies[a].parent


@inline
def mass_matrix_derivatives(bodies: Bodies, work: Work, q: Config, dM: Matrix) -> None:
    """∂M_ij/∂q_k = Γ_ijk + Γ_jik: the connection is compatible with the metric."""
    christoffel_symbols(bodies, work, q, dM)
    n = len(bodies) - 1
    for i in range(n):
        for j in range(i + 1):
            for k in range(n):
                both = dM[i, j, k] + dM[j, i, k]
                dM[i, j, k] = both
                dM[j, i, k] = both


_UNIT = "kg m² | kg m | kg"
_SOURCE = "after Echeandia and Wensing, Coriolis matrix and Christoffel symbols (2021)."
SPECS = (
    Spec(
        "christoffel_symbols", christoffel_symbols, WORK, (TURNED_Q,),
        Argument("Gamma", ("nv", "nv", "nv"), _UNIT, "symbols Γ_ijk with C_ij = Σ_k Γ_ijk v_k"),
        "Christoffel symbols of the first kind of M(q); by Koszul's formula for the velocities of spherical, "
        "floating and planar joints.",
        _SOURCE, regroup=True,
    ),
    Spec(
        "mass_matrix_derivatives", mass_matrix_derivatives, WORK, (TURNED_Q,),
        Argument("dM", ("nv", "nv", "nv"), _UNIT, "∂M_ij/∂q_k along integrate(q, e_k)"),
        "Derivatives of the mass matrix M(q) with respect to the configuration.", _SOURCE, regroup=True,
    ),
)  # fmt: skip
