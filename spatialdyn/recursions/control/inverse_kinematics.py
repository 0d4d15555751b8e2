"""A step of inverse kinematics: damped Gauss-Newton on the joints' group, within limits.

δ = Jᵀ (J Jᵀ + λ 1)⁻¹ e with λ = ½ e·e: far from a solution the step is short and along the gradient, near a solution it
is Newton's, and J may lose rank. A joint at a limit that would pass it is held. Source: Sugihara, Solvability-
unconcerned inverse kinematics by the Levenberg-Marquardt method (2011), with Chan and Lawrence's λ (1988).
"""

from __future__ import annotations

from ...algebra.euclidean import Mat3, Vec, dot, matmul, scale, transpose
from ...algebra.public_arrays import read_pose
from ...algebra.scalars import Scalar, atan2, inline, select, sqrt
from ...bodies.kinds import R1
from ..coordinates.configuration import integrate
from ..signatures import Bodies, Config, Matrix, Vector

AT_LIMIT = 1e-12  # [rad | m] distance within which a joint is at its limit
LEAST = 1e-14  # the least λ, so that it is never 0
TINY = 1e-36


@inline
def turn_between(A: Mat3, B: Mat3) -> Vec:
    """The rotation vector from A to B, both in the world, in its axes: log(B Aᵀ)."""
    R = matmul(B, transpose(A))
    w = scale(0.5, Vec(R.zy - R.yz, R.xz - R.zx, R.yx - R.xy))
    s = sqrt(dot(w, w) + TINY)
    return scale(atan2(s, 0.5 * (R.xx + R.yy + R.zz - 1.0)) / s, w)


@inline
def put_error(pose: Matrix, target: Matrix, at: int, turns: bool, e: Vector) -> tuple[Scalar, Scalar]:
    """Write the displacement from a pose to its target to e[at:], in the world: translation, and rotation if ``turns``.

    Returns the squares of the distance and of the angle.
    """
    X, T = read_pose(pose), read_pose(target)
    p = Vec(T.p.x - X.p.x, T.p.y - X.p.y, T.p.z - X.p.z)
    e[at], e[at + 1], e[at + 2] = p.x, p.y, p.z
    if not turns:
        return dot(p, p), 0.0
    w = turn_between(X.R, T.R)
    e[at + 3], e[at + 4], e[at + 5] = w.x, w.y, w.z
    return dot(p, p), dot(w, w)


@inline
def damped_step(
    bodies: Bodies, q: Config, lower: Config, upper: Config, J: Matrix, e: Vector, G: Matrix, y: Vector, step: Vector,
    out: Config,
) -> None:  # fmt: skip
    """out = q ∘ exp(δ) within the limits; missing limits are infinite.

    J     (m, nv), whose columns of joints held at a limit are overwritten by 0
    e     (m)
    G, y  (m, m), (m) scratch
    step  (nv) written: δ
    """
    m, n = len(e), len(bodies) - 1
    for i in range(n):
        slope = 0.0
        for r in range(m):
            slope = slope + J[r, i] * e[r]
        b = bodies[i + 1]
        if b.kind in R1:
            k = b.q_index
            free = select(lower[k] + AT_LIMIT - q[k], select(slope, 1.0, 0.0), 1.0)
            free = select(q[k] - upper[k] + AT_LIMIT, select(-slope, 1.0, 0.0), free)
            for r in range(m):
                J[r, i] = free * J[r, i]
    damping = LEAST
    for r in range(m):
        damping = damping + 0.02 * e[r] * e[r]
        y[r] = e[r]
    for r in range(m):
        for c in range(r + 1):
            s = 0.0
            for i in range(n):
                s = s + J[r, i] * J[c, i]
            G[r, c] = s
        G[r, r] = G[r, r] + damping
    solve_definite(G, y)
    for i in range(n):
        s = 0.0
        for r in range(m):
            s = s + J[r, i] * y[r]
        step[i] = s
    integrate(bodies, q, step, out)
    for i in range(n):
        b = bodies[i + 1]
        if b.kind in R1:
            k = b.q_index
            x = select(lower[k] - out[k], lower[k], out[k])
            out[k] = select(x - upper[k], upper[k], x)


@inline
def solve_definite(G: Matrix, y: Vector) -> None:
    """y = G⁻¹ y in place by L D Lᵀ, for a positive definite G; its lower triangle is read and overwritten."""
    m = len(y)
    for c in range(m):
        for r in range(c + 1, m):
            part = G[r, c] / G[c, c]
            for k in range(c + 1, r + 1):
                G[r, k] = G[r, k] - part * G[k, c]
            y[r] = y[r] - part * y[c]
    for r in range(m - 1, -1, -1):
        s = y[r]
        for k in range(r + 1, m):
            s = s - G[k, r] * y[k]
        y[r] = s / G[r, r]
