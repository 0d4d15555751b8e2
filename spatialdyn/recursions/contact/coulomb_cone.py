"""The impulse of one point in contact: Signorini's and Coulomb's law in its three unknowns, see ``contact``.

With B the point's own block of G and r its velocity without an impulse of its own, S = B_tt - B_tn B_nt / B_nn,
m = -r_n and a = r_t + B_tn m / B_nn. A point that is pushed into the ground, m > 0, has for each κ of 0 or more

    λ_t = -(S + κ)⁻¹ a,    λ_n = (m - B_nt λ_t) / B_nn,

which gives u_n = 0 and u_t = -κ λ_t. With κ = 0 the point sticks, if λ is in the cone. Else q(κ) = μ λ_n / |λ_t| is
below 1 at κ = 0 and grows without bound, so the point slides with the root of q = 1, where λ_n > 0 too. If several
impulses satisfy the law, sticking is one of them, and is chosen.

Source: the law as in ``contact``; the root is a derivation of our own.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec
from ...algebra.regions import repeat, settled, when
from ...algebra.scalars import EPS, Scalar, inline, select, sqrt
from ..constraints.constrained import DEPENDENT
from ..constraints.dense import factor_dropping, solve_backward, solve_forward
from ..joints.friction import magnitude
from ..signatures import Matrix, Number, Vector

STOPPED = 1e-18  # share of a point's squared velocity that rounding leaves when it stops
ROOT_STEPS = 12  # the most Newton steps on q; nearly all sliding points need half of them
ROOT = 1e-6  # |q - 1| before the last of these steps, each of which squares it
FAR = 1e30  # above any κ
BEGIN = 1e-3  # least κ to begin with, as a share of S's trace
REGULAR = 1e-9  # share of a block's trace, added if a direction may have no response


class Slide(NamedTuple):
    """The numbers that determine a sliding impulse."""

    s11: Scalar  # S
    s12: Scalar
    s22: Scalar
    a1: Scalar
    a2: Scalar
    m: Scalar
    n1: Scalar  # B_tn / B_nn
    n2: Scalar
    each: Scalar  # 1 / B_nn, 0 of a point that cannot move along its normal
    mu: Scalar


@inline
def factor_block(x: Matrix, total: Scalar, n: int, C: Matrix) -> None:
    """Write to rows 0 to 2 of C (5, 3) the factors of the block x; directions in which the point cannot move drop out.

    total  trace of the block
    """
    for i in range(3):
        C[3, i] = total
        for j in range(3):
            C[i, j] = x[i, j]
    factor_dropping(C[:3], C[3], DEPENDENT * (n + 3) * EPS, C[4])


@inline
def largest_eigenvalue(B: Matrix) -> Scalar:
    """The largest eigenvalue of the block of B across the normal."""
    half = 0.5 * (B[1, 1] - B[2, 2])
    return 0.5 * (B[1, 1] + B[2, 2]) + sqrt(half * half + B[1, 2] * B[1, 2])


@inline
def slide_of(B: Matrix, each: Scalar, r: Vec, mu: Number) -> Slide:
    """The Slide of a point."""
    n1, n2, m = B[0, 1] * each, B[0, 2] * each, -r.x
    return Slide(
        B[1, 1] - B[0, 1] * n1, B[1, 2] - B[0, 1] * n2, B[2, 2] - B[0, 2] * n2, r.y + m * n1, r.z + m * n2, m, n1, n2,
        each, mu,
    )  # fmt: skip


@inline
def across(s: Slide, kappa: Scalar, a1: Scalar, a2: Scalar) -> tuple[Scalar, Scalar]:
    """-(S + κ)⁻¹ a."""
    p1, p2 = s.s11 + kappa, s.s22 + kappa
    det = p1 * p2 - s.s12 * s.s12
    each = 1.0 / select(det, det, 1.0)
    return (s.s12 * a2 - p2 * a1) * each, (s.s12 * a1 - p1 * a2) * each


@inline
def find_root(s: Slide, slides: Scalar, root: Vector) -> None:
    """Write the κ of a sliding point to root[1], root (4), by Newton's steps on q between bounds.

    slides  above 0 if the point slides
    """
    square = s.a1 * s.a1 + s.a2 * s.a2
    safe = select(square, square, 1.0)
    m, mu, each = select(s.m, s.m, 1.0), select(s.mu, s.mu, 1.0), select(s.each, s.each, 1.0)
    trace = s.s11 + s.s22
    far = (sqrt(square) / mu - (s.n1 * s.a1 + s.n2 * s.a2)) / (each * m)
    far = far - (s.s11 * s.a1 * s.a1 + 2.0 * s.s12 * s.a1 * s.a2 + s.s22 * s.a2 * s.a2) / safe
    root[0] = slides
    root[1] = select(far - BEGIN * trace, far, BEGIN * trace)
    root[2], root[3] = 0.0, FAR
    for _ in repeat(ROOT_STEPS, root):
        if settled(root[0]):
            break
        k = root[1]
        x1, x2 = across(s, k, s.a1, s.a2)
        y1, y2 = across(s, k, x1, x2)
        square = x1 * x1 + x2 * x2
        size = sqrt(select(square, square, 1.0))
        normal = s.m * s.each - (s.n1 * x1 + s.n2 * x2)
        over = s.mu * normal / size - 1.0
        rise = -s.mu * ((s.n1 * y1 + s.n2 * y2) + normal * (x1 * y1 + x2 * y2) / (size * size)) / size
        low = select(over, root[2], select(k - root[2], k, root[2]))
        high = select(over, select(root[3] - k, k, root[3]), root[3])
        new = select(rise, k - over / select(rise, rise, 1.0), -1.0)
        wide = 4.0 * k + trace
        between = sqrt(low * select(high - wide, wide, high))
        new = select(low - new, select(low, between, 0.25 * k), new)
        least = select(low - 1e-3 * k, low, 1e-3 * k)
        root[1] = select(new - high, sqrt(least * high), new)
        root[0] = magnitude(over) - ROOT
        root[2], root[3] = low, high


@inline
def disc_impulse(B: Matrix, r: Vec, mu: Number, least: Scalar, root: Vector, disc: Vector) -> None:
    """Write u_n, λ_t, κ and whether it slides to disc (5), for a point whose λ_n is its least, with friction within μ
    times that. A least of 0 is a point without an impulse.
    """
    disc[0], disc[1], disc[2], disc[3], disc[4] = r.x, 0.0, 0.0, 0.0, 0.0
    for _ in when(least, disc):
        most, small = mu * least, REGULAR * (B[1, 1] + B[2, 2])
        s = Slide(
            B[1, 1], B[1, 2], B[2, 2], r.y + B[1, 0] * least, r.z + B[2, 0] * least, most, 0.0, 0.0, 1.0, 1.0
        )  # fmt: skip
        x1, x2 = across(s, small, s.a1, s.a2)
        disc[4] = select(x1 * x1 + x2 * x2 - most * most, 1.0, 0.0)
        find_root(s, disc[4] * most, root)
        disc[3] = select(disc[4], root[1], small)
        x1, x2 = across(s, disc[3], s.a1, s.a2)
        disc[1], disc[2] = select(most, x1, 0.0), select(most, x2, 0.0)
        disc[0] = r.x + (B[0, 0] * least + B[0, 1] * disc[1] + B[0, 2] * disc[2])


@inline
def point_impulse(
    B: Matrix, C: Matrix, r: Vec, mu: Number, least: Scalar, root: Vector, disc: Vector, solved: Vector, held: bool
) -> tuple[Vec, Scalar, Scalar]:
    """λ of one point whose velocity is r without an impulse of its own; 1 if it sticks, else 0; 1 if it slides, else 0.
    A point that does neither leaves the ground: its λ_n is its least.

    Whether a point sticks is simple to see; what is more is a region, of points that slide or have a least λ_n.

    B, C    its block of G, and the factors, of which rows 3 and 4 are scratch
    least   least λ_n, complementary to u_n: 0 but in the second phase of a hit
    root    (4), written: of ``find_root``
    disc    (5), written: of ``disc_impulse``
    solved  (5), written: the results
    held    whether constraints may prevent motion of the point in some directions: it then sticks only if the other
            points' impulses stop it in those too
    """
    C[3, 0], C[3, 1], C[3, 2] = -r.x, -r.y, -r.z
    solve_forward(C[:3], C[3])
    solve_backward(C[:3], C[3], C[4])
    stick = Vec(C[4, 0], C[4, 1], C[4, 2])
    pressed = mu * select(stick.x, stick.x, 0.0)
    inside = pressed * pressed - (stick.y * stick.y + stick.z * stick.z)
    if held:
        left1 = r.y + (B[1, 0] * stick.x + B[1, 1] * stick.y + B[1, 2] * stick.z)
        left2 = r.z + (B[2, 0] * stick.x + B[2, 1] * stick.y + B[2, 2] * stick.z)
        left = left1 * left1 + left2 * left2
        inside = select(left - STOPPED * (r.x * r.x + r.y * r.y + r.z * r.z), -1.0, inside)
    pushed = select(-r.x, 1.0, 0.0)
    sticks = select(inside, pushed, 0.0)
    rubs = mu * C[0, 0]
    solved[0] = select(pushed, select(sticks, stick.x, -r.x * C[0, 0]), 0.0)  # without friction, if it slides
    solved[1], solved[2], solved[3], solved[4] = sticks * stick.y, sticks * stick.z, sticks, pushed - sticks
    for k in range(4):
        root[k] = 0.0
    for k in range(5):
        disc[k] = 0.0
    for _ in when(select(least, 1.0, (pushed - sticks) * rubs), solved, root, disc):
        disc_impulse(B, r, mu, least, root, disc)
        pushed = select(-disc[0], pushed, 0.0)
        sticks = select(inside, pushed, 0.0)
        slides = pushed - sticks
        s = slide_of(B, C[0, 0], r, mu)
        find_root(s, slides * rubs, root)
        x1, x2 = across(s, root[1], s.a1, s.a2)
        x1, x2 = select(rubs, x1, 0.0), select(rubs, x2, 0.0)
        normal = s.m * s.each - (s.n1 * x1 + s.n2 * x2)
        solved[0] = select(pushed, select(sticks, stick.x, normal), least)
        solved[1] = select(pushed, select(sticks, stick.y, x1), disc[1])
        solved[2] = select(pushed, select(sticks, stick.z, x2), disc[2])
        solved[3], solved[4] = sticks, slides
    return Vec(solved[0], solved[1], solved[2]), solved[3], solved[4]


@inline
def point_slope(
    B: Matrix, C: Matrix, r: Vec, mu: Number, least: Scalar, solved: Vec, sticks: Scalar, slides: Scalar, root: Vector,
    disc: Vector, T: Matrix,
) -> None:  # fmt: skip
    """Write to T (3, 3) the derivative of ``point_impulse`` by r, on the side of the point's state.

    For a sliding point with d = λ_t / |λ_t| and w = d + μ B_tn / B_nn, from w·dλ_t = -μ dr_n / B_nn; for a point at its
    least λ_n, which is constant, from d·dλ_t = 0 if friction is at its limit.

    root, disc  of ``point_impulse``
    """
    full = slide_of(B, C[0, 0], r, mu)
    at_least = select(least, 1.0 - sticks - slides, 0.0)
    s = Slide(
        select(at_least, B[1, 1], full.s11), select(at_least, B[1, 2], full.s12), select(at_least, B[2, 2], full.s22),
        0.0, 0.0, full.m, select(at_least, 0.0, full.n1), select(at_least, 0.0, full.n2),
        select(at_least, 0.0, full.each), mu,
    )  # fmt: skip
    kappa, moves = select(at_least, disc[3], root[1]), select(at_least, disc[4], slides)
    rubs = (slides + at_least) * select(mu * full.each, 1.0, 0.0)
    square = solved.y * solved.y + solved.z * solved.z
    each = 1.0 / sqrt(select(square, square, 1.0))
    w1, w2 = solved.y * each + mu * s.n1, solved.z * each + mu * s.n2
    z1, z2 = across(s, kappa, -solved.y, -solved.z)
    v1, v2 = across(s, kappa, -w1, -w2)  # (S + κ)⁻¹ w
    pairs = w1 * z1 + w2 * z2
    share = moves / select(magnitude(pairs), pairs, 1.0)
    for j in range(3):
        for i in range(3):
            C[3, i] = -1.0 if i == j else 0.0
        solve_forward(C[:3], C[3])
        solve_backward(C[:3], C[3], C[4])
        da1 = -s.n1 if j == 0 else 1.0 if j == 1 else 0.0
        da2 = -s.n2 if j == 0 else 1.0 if j == 2 else 0.0
        if j == 0:  # at its least λ_n, which is constant, a changes with r_t alone
            da1, da2 = select(at_least, 0.0, da1), select(at_least, 0.0, da2)
        pressed = mu * s.each if j == 0 else 0.0
        dk = (pressed - (v1 * da1 + v2 * da2)) * share
        dx1, dx2 = across(s, kappa, da1, da2)
        dx1, dx2 = rubs * (dx1 - z1 * dk), rubs * (dx2 - z2 * dk)
        dn = -(s.n1 * dx1 + s.n2 * dx2)
        if j == 0:
            dn = dn - slides * s.each
        T[0, j] = sticks * C[4, 0] + dn
        T[1, j] = sticks * C[4, 1] + dx1
        T[2, j] = sticks * C[4, 2] + dx2


@inline
def squared_residual(
    along: Scalar, wide: Scalar, u: Vec, mu: Number, f: Vec, least: Scalar, share: Vector
) -> Scalar:  # fmt: skip
    """The square of the violation of the law by λ, in units of velocity: its distance from its projection.

    along  the block's entry of the normal
    wide   its largest response across that
    u      velocity after the step, along the normal with its target
    least  least λ_n, complementary to u_n
    share  (1), written
    """
    pushed = along * (f.x - least)
    normal = select(u.x - pushed, pushed, u.x)
    f1, f2, most = wide * f.y, wide * f.z, wide * (mu * f.x)
    square = (f1 - u.y) * (f1 - u.y) + (f2 - u.z) * (f2 - u.z)
    share[0] = select(most, 1.0, 0.0)
    for _ in when(select(most, square - most * most, 0.0), share):
        share[0] = most / sqrt(square)
    a, c = share[0] * u.y + (1.0 - share[0]) * f1, share[0] * u.z + (1.0 - share[0]) * f2
    across = a * a + c * c
    return select(normal * normal - across, normal * normal, across)
