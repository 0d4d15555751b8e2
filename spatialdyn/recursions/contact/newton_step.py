"""A step of Newton's method on all impulses at once, of points and of joints.

It solves λ = T(u - B λ) for all rows, T the local solutions, with a proximal term ε:

    (1 + ε) δ_p = T - λ_p + T' (δu_p - B_p δ_p)    ⇒    δ_p = f_p - C_p δu_p,

so that (M + Σ J_pᵀ C_p J_p) δv = Σ J_pᵀ f_p, which has the zeros of the tree: a dry joint is one entry on the diagonal,
C = 1 / (ε G_jj) if it sticks or stops, with ε of its row (``stiffness``). After 4 steps, only the joints that violate
their law most change their state, which ends cycles.

Source: a derivation of our own, semi-smooth as by Alart and Curnier (1991).
"""

from __future__ import annotations

from ...algebra.scalars import Scalar, inline, select
from ..constraints.dense import add_product
from ..signatures import Matrix, Number, Record, Vector
from .contact_rows import Contact
from .coulomb_cone import point_slope
from .impulse_rows import COUNT, EPSILON, GRIP, Impulses, joint_state, residual_of_joints, respond, solve_point

BOLD = 4  # steps in which all joints may change their state
MISSES_MOST = 0.99  # share of the largest residual of all joints, above which a joint may change its state later
STIFF = 1e7  # stiffness of constraints in these steps, relative to their response


@inline
def newton_step(
    contact: Contact, held: Record, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """A step on all impulses at once; w is updated."""
    n, points, prox = len(w), contact.contacts[0].np, s.state[EPSILON]
    for i in range(n):
        s.x[i] = 0.0
        for j in range(n):
            s.K[i, j] = s.M[i, j]
    for p in range(points):
        add_point(p, s.state[GRIP] * contact.mu[p], prox / s.firm[p], held is not None, w, s)
    most, firm = residual_of_joints(w, s), 1.0 / prox
    for j in range(len(s.level)):
        add_joint(contact.contacts[1 + points + j].row - 1, 3 * points + j, j, most, firm, w, s)
    if held is not None:
        for l in range(len(held.N)):
            stiff = STIFF / select(held.scale[l], held.scale[l], 1.0)
            for i in range(n):
                for j in range(n):
                    s.K[i, j] = s.K[i, j] + held.J[l, i] * (stiff * held.J[l, j])
    solve_K(s.K, s.x)
    for p in range(points):
        k = 3 * p
        u0, u1 = add_product(0.0, s.J, s.x, k), add_product(0.0, s.J, s.x, k + 1)
        u2 = add_product(0.0, s.J, s.x, k + 2)
        for i in range(3):
            change = s.f[k + i] - (s.C[p, i, 0] * u0 + s.C[p, i, 1] * u1 + s.C[p, i, 2] * u2)
            s.force[k + i] = s.force[k + i] + change
    for j in range(len(s.level)):
        k = 3 * points + j
        s.force[k] = s.force[k] + (s.f[k] - stick_share(j, firm, s) * s.x[contact.contacts[1 + points + j].row - 1])
    respond(w, s)


@inline
def add_point(p: int, mu: Number, prox: Scalar, held: bool, w: Vector, s: Impulses) -> None:
    """C and f of a point, and its part of K and x."""
    n, k = len(w), 3 * p
    now, r, solved, sticks, slides = solve_point(p, mu, held, w, s)
    point_slope(s.B[p], s.factors[p], r, mu, s.lower[p], solved, sticks, slides, s.root, s.disc, s.T)
    T, N = s.T, s.N
    for i in range(3):  # N = ((1 + ε) 1 + T B)⁻¹
        for j in range(3):
            N[i, j] = T[i, 0] * s.B[p, 0, j] + T[i, 1] * s.B[p, 1, j] + T[i, 2] * s.B[p, 2, j]
        N[i, i] = N[i, i] + (1.0 + prox)
    invert(N)
    f0, f1, f2 = solved.x - now.x, solved.y - now.y, solved.z - now.z
    for i in range(3):
        s.f[k + i] = N[i, 0] * f0 + N[i, 1] * f1 + N[i, 2] * f2
        for j in range(3):
            s.C[p, i, j] = -(N[i, 0] * T[0, j] + N[i, 1] * T[1, j] + N[i, 2] * T[2, j])
    for j in range(n):
        for i in range(3):
            s.CJ[i, j] = s.C[p, i, 0] * s.J[k, j] + s.C[p, i, 1] * s.J[k + 1, j] + s.C[p, i, 2] * s.J[k + 2, j]
    for i in range(n):
        y0, y1, y2 = s.J[k, i], s.J[k + 1, i], s.J[k + 2, i]
        s.x[i] = s.x[i] + (y0 * s.f[k] + y1 * s.f[k + 1] + y2 * s.f[k + 2])
        for j in range(n):
            s.K[i, j] = s.K[i, j] + (y0 * s.CJ[0, j] + y1 * s.CJ[1, j] + y2 * s.CJ[2, j])


@inline
def add_joint(
    i: int, k: int, j: int, most: Scalar, firm: Scalar, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """The state of a joint, its f, and its part of K and x.

    i     its freedom
    most  the largest residual of a joint
    firm  1 / ε
    """
    now, x = s.force[k], joint_state(j, w, s)
    new = select(BOLD - s.state[COUNT], 1.0, select(MISSES_MOST * most - s.off[j], 0.0, 1.0))
    s.held[j] = select(new, x.stays, s.held[j])
    s.goal[j] = select(new, select(x.stays, x.wanted, now + (x.wanted - x.u) * s.each[j]), s.goal[j])
    share = stick_share(j, firm, s)
    s.f[k] = select(s.held[j], (s.goal[j] - x.u) * share, s.goal[j] - now)
    s.x[i] = s.x[i] + s.f[k]
    s.K[i, i] = s.K[i, i] + share


@inline
def stick_share(j: int, firm: Scalar, s: Impulses) -> Scalar:
    """C of a joint."""
    return s.held[j] * s.each[j] * (firm * s.firm[len(s.lower) + j])


@inline
def invert(N: Matrix) -> None:
    """N (3, 3) = N⁻¹."""
    a, b, c = N[0, 0], N[0, 1], N[0, 2]
    d, e, f = N[1, 0], N[1, 1], N[1, 2]
    g, h, i = N[2, 0], N[2, 1], N[2, 2]
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    each = 1.0 / (a * A + b * B + c * C)
    N[0, 0], N[0, 1], N[0, 2] = A * each, (c * h - b * i) * each, (b * f - c * e) * each
    N[1, 0], N[1, 1], N[1, 2] = B * each, (a * i - c * g) * each, (c * d - a * f) * each
    N[2, 0], N[2, 1], N[2, 2] = C * each, (b * g - a * h) * each, (a * e - b * d) * each


@inline
def solve_K(K: Matrix, x: Vector) -> None:
    """x = K⁻¹ x in place, from the tips inward: K has the zeros of the tree, and is overwritten."""
    n = len(x)
    for k in range(n - 1, -1, -1):
        each = 1.0 / K[k, k]
        for i in range(k):
            share = K[i, k] * each
            for j in range(k):
                K[i, j] = K[i, j] - share * K[k, j]
            x[i] = x[i] - share * x[k]
    for k in range(n):
        for j in range(k):
            x[k] = x[k] - K[k, j] * x[j]
        x[k] = x[k] * (1.0 / K[k, k])
