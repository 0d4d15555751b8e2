"""The impulse of one point in contact: Signorini's and Coulomb's law in its three unknowns, see ``contact``."""

from __future__ import annotations

from ..algebra.euclidean import Vec
from ..algebra.scalars import EPS, Scalar, inline, select, sqrt
from .constrained import DEPENDENT
from .dense import factor_dropping, quotient, solve_backward, solve_forward
from .signatures import Matrix, Number, Vector

STOPPED = 1e-18  # of a point's velocity, squared: what rounding leaves of it
LEAST = 0.1  # of G_nn: the least of what resists along a sliding point's impulse; beyond, friction jams the point


@inline
def magnitude(x: Scalar) -> Scalar:
    """|x|."""
    return select(x, x, -x)


@inline
def factor_block(x: Matrix, total: Scalar, n: int, C: Matrix) -> None:
    """C (3, 3), the factors of the block in x; directions in which the point cannot move drop out.

    total  trace of the block before joints were taken out of it
    """
    for i in range(3):
        C[3, i] = total
        for j in range(3):
            C[i, j] = x[i, j]
    factor_dropping(C[:3], C[3], DEPENDENT * (n + 3) * EPS, C[4])


@inline
def largest_eigenvalue(B: Matrix) -> Scalar:
    """Of the block of B across the normal."""
    half = 0.5 * (B[1, 1] - B[2, 2])
    return 0.5 * (B[1, 1] + B[2, 2]) + sqrt(half * half + B[1, 2] * B[1, 2])


@inline
def point_impulse(
    B: Matrix, C: Matrix, r: Vec, mu: Number, p: int, sigma: Vector, first: bool, held: bool
) -> tuple[Vec, Scalar]:
    """λ of one point under the velocity r that it has without an impulse of its own: it leaves, sticks or slides; and 1
    if it sticks, else 0.

    B, C   its block of G, and the factors, of which rows 3 and 4 are scratch
    sigma  (np), written: of ``sliding_impulse``, which starts from that of the sweep before if this is not the first
    held   whether constraints may leave a point fewer directions than its velocity has: it then sticks only if the
           impulse of the others stops it in those too
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
    slide = sliding_impulse(B, C[0, 0], r, mu, p, sigma, first)
    solved = Vec(
        select(-r.x, select(inside, stick.x, slide.x), 0.0),
        select(-r.x, select(inside, stick.y, slide.y), 0.0),
        select(-r.x, select(inside, stick.z, slide.z), 0.0),
    )
    return solved, select(-r.x, select(inside, 1.0, 0.0), 0.0)


@inline
def sliding_impulse(B: Matrix, each: Scalar, r: Vec, mu: Number, p: int, sigma: Vector, first: bool) -> Vec:
    """λ of a point that slides: λ_t = μ λ_n d with a unit vector d, u_n = 0 and u_t = -s d with s of 0 or more.

    Its speed s solves |(A + σ 1)⁻¹ a| = 1, where with m = -r_n, β = B_tn / B_nn and s = σ λ_n B_nn / m

        a = r_t + m β,    A = μ (r_t βᵀ + m B_tt / B_nn),    d = -(A + σ 1)⁻¹ a.

    A sweep takes one of Newton's steps on 1/|d|, which is nearly linear in σ; the first starts from the root that a
    large σ would have, on the left of the largest one. Of the feet of a walking quadruped, 5 sweeps find σ to rounding.

    each  1 / B_nn, 0 of a point that cannot move along its normal
    """
    m = select(-r.x, -r.x, 0.0)
    n1, n2 = B[0, 1] * each, B[0, 2] * each
    a1, a2 = r.y + m * n1, r.z + m * n2
    A11, A12 = mu * (r.y * n1 + m * (B[1, 1] * each)), mu * (r.y * n2 + m * (B[1, 2] * each))
    A21, A22 = mu * (r.z * n1 + m * (B[2, 1] * each)), mu * (r.z * n2 + m * (B[2, 2] * each))
    trace, det = A11 + A22, A11 * A22 - A12 * A21
    b1, b2 = A22 * a1 - A12 * a2, A11 * a2 - A21 * a1  # adj(A) a; adj(A + σ 1) a is b + σ a
    if first:
        square = a1 * a1 + a2 * a2
        far = sqrt(square) - trace + (a1 * b1 + a2 * b2) / select(square, square, 1.0)
        sigma[p] = select(far, far, 0.0)
    s = sigma[p]
    d1, d2 = b1 + s * a1, b2 + s * a2
    square, whole = d1 * d1 + d2 * d2, (s + trace) * s + det
    slope = (s + trace + s) * square - whole * (d1 * a1 + d2 * a2)
    change = (whole - sqrt(square)) * square
    s = s - select(slope, change, 0.0) / select(slope, slope, 1.0)
    sigma[p] = select(s, s, 0.0)
    d1, d2 = b1 + sigma[p] * a1, b2 + sigma[p] * a2
    size = sqrt(d1 * d1 + d2 * d2)
    resists, least = size - mu * (n1 * d1 + n2 * d2), LEAST * size
    resists = select(resists - least, resists, least)
    g = m * each / select(resists, resists, 1.0)
    return Vec(g * size, -mu * g * d1, -mu * g * d2)


@inline
def point_residual(B: Matrix, u: Vec, mu: Number, f: Vec) -> Scalar:
    """How far λ is from the projection onto the law of what it would be, in units of velocity: 0 if it is met.

    u  velocity after the step, along the normal with its target
    """
    pushed = B[0, 0] * f.x
    normal = magnitude(select(u.x - pushed, pushed, u.x))
    largest = largest_eigenvalue(B)
    a, c = f.y - quotient(u.y, largest), f.z - quotient(u.z, largest)
    s = sqrt(a * a + c * c)
    share = select(s - mu * f.x, mu * f.x / select(s, s, 1.0), 1.0)
    a, c = f.y - share * a, f.z - share * c
    across = largest * sqrt(a * a + c * c)
    return select(normal - across, normal, across)
