"""Motions to follow as functions of a clock: q = q_c ∘ exp(u(t)), with u piecewise polynomial or a Fourier series.

q_c, the centre, is a configuration and u a displacement, so a path works for joints of any kind. The velocity is that
of the body, v = J(u) u̇ with J the right Jacobian of exp, and a = J (ü - ∂(J⁻¹ v)/∂u u̇) is the rate of v, from
u̇ = J⁻¹(u) v. If u keeps its direction, as between two configurations, v is u̇ and a is ü. A derivation of our own.

Sources: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008), for the polynomials;
Swevers et al., Optimal robot excitation and identification (1997), for the series.
"""

from __future__ import annotations

from ...algebra.euclidean import neg
from ...algebra.lie import exp_jacobian, log_jacobian_times_derivative, times_twist
from ...algebra.scalars import Scalar, cos, inline, select, sin
from ...algebra.spatial import Motion, add_motion
from ...bodies.kinds import CONTINUED, NV
from ..coordinates.configuration import integrate, put_twist, twist
from ..signatures import Array, Bodies, Config, Matrix, Vector
from ..spec import A, Argument, Q, Spec, V, made_once

CLOCK = Argument("clock", (1,), "s", "time since the beginning", start=0.0)
CENTRE = Argument("centre", ("nq",), "rad | m", "configuration that displacements start from")
PARTS = (Q, V, A)
OUTPUT = Argument("path", ("nq+nv+nv",), "", "q, v and a")


@inline
def polynomial_path(
    bodies: Bodies, clock: Vector, centre: Config, times: Vector, coefficients: Array, q: Config, v: Vector, a: Vector,
    rows: Matrix,
) -> None:  # fmt: skip
    """Segment k, from times[k] to times[k + 1], has u_i = Σ_m coefficients[k, i, m] (t - times[k])^m.

    Before the first and after the last time the path rests there, with v = a = 0.
    """
    t, s, live = in_segment(clock[0], times)
    for i in range(len(bodies) - 1):
        u, du, ddu = polynomial(coefficients[:, i], times, t, s)
        rows[0, i], rows[1, i], rows[2, i] = u, live * du, live * ddu
    on_the_group(bodies, centre, rows, q, v, a)


@inline
def timed_path(
    bodies: Bodies, clock: Vector, centre: Config, way: Vector, times: Vector, scale: Matrix, q: Config, v: Vector,
    a: Vector, rows: Matrix,
) -> None:  # fmt: skip
    """u = s(t) way, with s the piecewise polynomial of ``scale`` (segments, powers): u keeps one direction."""
    t, s, live = in_segment(clock[0], times)
    x, dx, ddx = polynomial(scale, times, t, s)
    dx, ddx = live * dx, live * ddx
    for i in range(len(bodies) - 1):
        rows[0, i], rows[1, i], rows[2, i] = x * way[i], dx * way[i], ddx * way[i]
    on_the_group(bodies, centre, rows, q, v, a)


@inline
def in_segment(t: Scalar, times: Vector) -> tuple[Scalar, Scalar, Scalar]:
    """t clipped to the times, the time since its segment began, and 1 if t was within the times, else 0."""
    last = len(times) - 1
    over, under = t - times[last], times[0] - t
    live = select(over, 0.0, select(under, 0.0, 1.0))
    t = select(over, times[last], select(under, times[0], t))
    begun = times[0]
    for k in range(1, last):
        begun = select(t - times[k], times[k], begun)
    return t, t - begun, live


@inline
def polynomial(coefficients: Matrix, times: Vector, t: Scalar, s: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Σ_m c_m s^m with the coefficients of the segment of t, and its first two derivatives: Horner's scheme."""
    x, dx, ddx = 0.0, 0.0, 0.0
    for m in range(coefficients.shape[1] - 1, -1, -1):
        c = coefficients[0, m]
        for k in range(1, len(times) - 1):
            c = select(t - times[k], coefficients[k, m], c)
        ddx = ddx * s + 2.0 * dx
        dx = dx * s + x
        x = x * s + c
    return x, dx, ddx


@inline
def fourier_path(
    bodies: Bodies, clock: Vector, centre: Config, frequency: Vector, cosines: Matrix, sines: Matrix, q: Config,
    v: Vector, a: Vector, rows: Matrix,
) -> None:  # fmt: skip
    """u̇ = Σ_k cosines[k - 1] cos(k ω t) + sines[k - 1] sin(k ω t), u its integral of mean 0, ω = 2π frequency."""
    w = 6.283185307179586 * frequency[0]
    c1, s1 = cos(w * clock[0]), sin(w * clock[0])
    for i in range(len(bodies) - 1):
        c, s, u, du, ddu = c1, s1, 0.0, 0.0, 0.0
        for k in range(len(cosines)):
            x, y, kw = cosines[k, i], sines[k, i], (k + 1.0) * w
            u = u + (x * s - y * c) / kw
            du = du + (x * c + y * s)
            ddu = ddu + kw * (y * c - x * s)
            c, s = c * c1 - s * s1, s * c1 + c * s1
        rows[0, i], rows[1, i], rows[2, i] = u, du, ddu
    on_the_group(bodies, centre, rows, q, v, a)


@inline
def on_the_group(bodies: Bodies, centre: Config, rows: Matrix, q: Config, v: Vector, a: Vector) -> None:
    """q, v and a of the displacement u, rows[0], with its rates u̇ and ü, rows[1] and rows[2]."""
    integrate(bodies, centre, rows[0], q)
    for i in range(1, len(bodies)):
        b, r = bodies[i], i - 1
        if NV[b.kind] == 1:
            v[r], a[r] = rows[1, r], rows[2, r]
        elif b.kind != CONTINUED:
            m, rate = twist(b, r, rows[0]), twist(b, r, rows[1])
            J = exp_jacobian(m)
            moved = times_twist(J, rate)
            bent = times_twist(log_jacobian_times_derivative(m, moved), rate)
            put_twist(b, r, moved, v)
            put_twist(b, r, times_twist(J, add_motion(twist(b, r, rows[2]), minus(bent))), a)


@inline
def minus(m: Motion) -> Motion:
    """-m."""
    return Motion(neg(m.w), neg(m.v))


@made_once()
def polynomial_spec(segments: int, order: int) -> Spec:
    """The Spec of a path with this number of segments and of coefficients in each segment."""
    return Spec(
        f"polynomial_path_{segments}_{order}", polynomial_path, None,
        (
            CLOCK, CENTRE, Argument("times", (segments + 1,), "s", "ends of segments"),
            Argument("coefficients", (segments, "nv", order), "", "of powers of the time in each segment"),
        ),
        OUTPUT, "A path of piecewise polynomials.", "Biagiotti and Melchiorri (2008).", parts=PARTS,
        scratch=((3, "nv"),), composed=True, regroup=True,
    )  # fmt: skip


@made_once()
def timed_spec(segments: int, order: int) -> Spec:
    """The Spec of a path in one direction, with this number of segments and of coefficients in each segment."""
    return Spec(
        f"timed_path_{segments}_{order}", timed_path, None,
        (
            CLOCK, CENTRE, Argument("way", ("nv",), "rad | m", "displacement of the whole path"),
            Argument("times", (segments + 1,), "s", "ends of segments"),
            Argument("scale", (segments, order), "", "of powers of the time in each segment"),
        ),
        OUTPUT, "A path in one direction.", "Biagiotti and Melchiorri (2008).", parts=PARTS, scratch=((3, "nv"),),
        composed=True, regroup=True,
    )  # fmt: skip


@made_once()
def fourier_spec(harmonics: int) -> Spec:
    """The Spec of a path with this number of harmonics."""
    of_velocity = (harmonics, "nv"), "rad/s | m/s"
    return Spec(
        f"fourier_path_{harmonics}", fourier_path, None,
        (
            CLOCK, CENTRE, Argument("frequency", (1,), "1/s", "of the first harmonic"),
            Argument("cosines", *of_velocity, "of the velocity"), Argument("sines", *of_velocity, "of the velocity"),
        ),
        OUTPUT, "A path that is a Fourier series.", "Swevers et al. (1997).", parts=PARTS, scratch=((3, "nv"),),
        composed=True, regroup=True,
    )  # fmt: skip
