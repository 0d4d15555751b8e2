"""Control laws: joint torques that follow a reference (q_d, v_d, a_d), with e = q_d ⊖ q the remaining displacement.

PD                τ = Kp e + Kd (v_d - v)
gravity           τ = g(q)
PD with gravity   τ = g(q) + Kp e - Kd v
PD+               τ = M a_d + C(q, v) v_d + g + Kp e + Kd (v_d - v)
computed torque   τ = M (a_d + Kp e + Kd (v_d - v)) + C v + g
passivity-based   τ = M a_r + C(q, v) v_r + g - K s,   v_r = v_d + Λ e,  a_r = a_d + Λ (v_d - v),  s = v - v_r
state feedback    τ = τ₀ - K (q ⊖ q_d, v - v_d)

Each law needs at most one Newton-Euler recursion: M, C and g are never formed. Gains are vectors, for a diagonal, or
matrices. e and v_d are twists in each joint's own body frame: the equations above are exact for joints whose
coordinates are numbers, and hold to first order in e on groups.

Sources: Paden and Panja, Globally asymptotically stable PD+ controller (1988); Slotine and Li, On the adaptive control
of robot manipulators (1987), without adaptation; Spong, Hutchinson, Vidyasagar, Robot Modeling and Control (2006).
"""

from __future__ import annotations

from typing import Any

from ...algebra.scalars import Scalar, inline, sin
from ..coordinates.configuration import difference
from ..momenta.coriolis import WORK_MODIFIED, modified_rnea
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import TAU, Argument, Q, Spec, V, made_once
from ..tree.rnea import WORK, rnea

Q_REF = Argument("q_ref", ("nq",), "rad | m", "positions to reach")
V_REF = Argument("v_ref", ("nv",), "rad/s | m/s", "velocities to reach", optional=True)
A_REF = Argument("a_ref", ("nv",), "rad/s² | m/s²", "accelerations to reach", optional=True)
MATRIX, DIAGONAL = ("nv", "nv"), ("nv",)


@inline
def product(K: Array, x: Vector, i: int) -> Scalar:
    """Entry i of K x, with K a matrix or its diagonal."""
    if K.ndim == 1:
        return K[i] * x[i]
    s = 0.0
    for j in range(len(x)):
        s = s + K[i, j] * x[j]
    return s


@inline
def errors(bodies: Bodies, q: Config, v: Vector, q_ref: Config, v_ref: Vector, e: Vector, de: Vector) -> None:
    """e = q_ref ⊖ q and ė = v_ref - v; v_ref may be None, for zero."""
    difference(bodies, q, q_ref, e)
    for i in range(len(v)):
        de[i] = -v[i] if v_ref is None else v_ref[i] - v[i]


@inline
def add_springs(kp: Array, kd: Array, e: Vector, de: Vector, tau: Vector) -> None:
    """τ += Kp e + Kd ė."""
    for i in range(len(tau)):
        tau[i] = tau[i] + product(kp, e, i) + product(kd, de, i)


@inline
def pd(
    bodies: Bodies, q: Config, v: Vector, kp: Array, kd: Array, q_ref: Config, v_ref: Vector, tau: Vector, e: Vector,
    de: Vector,
) -> None:  # fmt: skip
    """τ = Kp e + Kd ė."""
    errors(bodies, q, v, q_ref, v_ref, e, de)
    for i in range(len(v)):
        tau[i] = product(kp, e, i) + product(kd, de, i)


@inline
def gravity(bodies: Bodies, work: Work, q: Config, tau: Vector) -> None:
    """τ = g(q)."""
    rnea(bodies, work, q, None, None, None, tau)


@inline
def pd_gravity(
    bodies: Bodies, work: Work, q: Config, v: Vector, kp: Array, kd: Array, q_ref: Config, tau: Vector, e: Vector,
    de: Vector,
) -> None:  # fmt: skip
    """τ = g(q) + Kp e - Kd v."""
    gravity(bodies, work, q, tau)
    errors(bodies, q, v, q_ref, None, e, de)
    add_springs(kp, kd, e, de, tau)


@inline
def cosine_shaping(
    bodies: Bodies, work: Work, q: Config, v: Vector, kp: Vector, kd: Array, q_ref: Config, tau: Vector, e: Vector,
    de: Vector,
) -> None:  # fmt: skip
    """τ = g(q) + kp sin e - Kd v, from V_d = Σ kp (1 - cos e)."""
    gravity(bodies, work, q, tau)
    errors(bodies, q, v, q_ref, None, e, de)
    for i in range(len(v)):
        e[i] = sin(e[i])
    add_springs(kp, kd, e, de, tau)


@inline
def pd_plus(
    bodies: Bodies, work: Work, q: Config, v: Vector, kp: Array, kd: Array, q_ref: Config, v_ref: Vector, a_ref: Vector,
    tau: Vector, e: Vector, de: Vector, w: Vector, a: Vector,
) -> None:  # fmt: skip
    """τ = M a_d + C(q, v) v_d + g + Kp e + Kd ė."""
    errors(bodies, q, v, q_ref, v_ref, e, de)
    for i in range(len(v)):
        w[i] = 0.0 if v_ref is None else v_ref[i]
        a[i] = 0.0 if a_ref is None else a_ref[i]
    modified_rnea(bodies, work, q, v, w, a, tau)
    add_springs(kp, kd, e, de, tau)


@inline
def computed_torque(
    bodies: Bodies, work: Work, q: Config, v: Vector, kp: Array, kd: Array, q_ref: Config, v_ref: Vector, a_ref: Vector,
    tau: Vector, e: Vector, de: Vector, a: Vector,
) -> None:  # fmt: skip
    """τ = M (a_d + Kp e + Kd ė) + C v + g."""
    errors(bodies, q, v, q_ref, v_ref, e, de)
    for i in range(len(v)):
        a[i] = product(kp, e, i) + product(kd, de, i)
        if a_ref is not None:
            a[i] = a[i] + a_ref[i]
    rnea(bodies, work, q, v, a, None, tau)


@inline
def passivity_based(
    bodies: Bodies, work: Work, q: Config, v: Vector, rates: Array, gain: Array, q_ref: Config, v_ref: Vector,
    a_ref: Vector, tau: Vector, e: Vector, de: Vector, w: Vector, a: Vector, s: Vector,
) -> None:  # fmt: skip
    """τ = M a_r + C(q, v) v_r + g - K s, with Λ = rates and K = gain."""
    errors(bodies, q, v, q_ref, v_ref, e, de)
    for i in range(len(v)):
        w[i] = product(rates, e, i)
        a[i] = product(rates, de, i)
        if v_ref is not None:
            w[i] = w[i] + v_ref[i]
        if a_ref is not None:
            a[i] = a[i] + a_ref[i]
        s[i] = v[i] - w[i]
    modified_rnea(bodies, work, q, v, w, a, tau)
    for i in range(len(v)):
        tau[i] = tau[i] - product(gain, s, i)


@inline
def state_feedback(
    bodies: Bodies, q: Config, v: Vector, gain: Matrix, q_ref: Config, v_ref: Vector, hold: Vector, tau: Vector,
    e: Vector, de: Vector,
) -> None:  # fmt: skip
    """τ = τ₀ - K (q ⊖ q_d, v - v_d); v_ref and hold may be None, for zero."""
    n = len(v)
    difference(bodies, q_ref, q, e)
    for i in range(n):
        de[i] = v[i] if v_ref is None else v[i] - v_ref[i]
    for i in range(n):
        tau[i] = 0.0 if hold is None else hold[i]
        for j in range(n):
            tau[i] = tau[i] - gain[i, j] * e[j] - gain[i, n + j] * de[j]


@made_once()
def law_spec(name: str, position: bool = False, velocity: bool = False) -> Spec:
    """The Spec of a law; ``position`` and ``velocity``: whether the first and the second gain are matrices."""
    unit = "N m/rad | N/m", "N m s/rad | N s/m"
    if name == "computed_torque":
        unit = "1/s²", "1/s"
    first = Argument("kp", MATRIX if position else DIAGONAL, unit[0], "gains of position")
    second = Argument("kd", MATRIX if velocity else DIAGONAL, unit[1], "gains of velocity")
    rows = (("nv",),) * 5
    kinds: dict[str, tuple[Any, ...]] = {
        "pd": (pd, None, (first, second, Q_REF, V_REF), 2, "PD."),
        "pd_gravity": (pd_gravity, WORK, (first, second, Q_REF), 2, "PD with gravity."),
        "cosine_shaping": (cosine_shaping, WORK, (first, second, Q_REF), 2, "Energy shaping by cosines."),
        "pd_plus": (pd_plus, WORK_MODIFIED, (first, second, Q_REF, V_REF, A_REF), 4, "PD+."),
        "computed_torque": (computed_torque, WORK, (first, second, Q_REF, V_REF, A_REF), 3, "Computed torque."),
        "passivity_based": (
            passivity_based, WORK_MODIFIED,
            (
                Argument("rates", first.shape, "1/s", "Λ"), Argument("gain", second.shape, unit[1], "K"), Q_REF, V_REF,
                A_REF,
            ), 5, "Passivity-based control (Slotine and Li)."
        ),
    }  # fmt: skip
    recursion, work, inputs, count, summary = kinds[name]
    shapes = "".join("M" if x else "d" for x in (position, velocity))
    return Spec(
        f"{name}_{shapes}", recursion, work, (Q, V, *inputs), TAU, summary, "see control_laws", regroup=True,
        scratch=rows[:count], composed=True,
    )  # fmt: skip


GRAVITY = Spec(
    "gravity_law", gravity, WORK, (Q,), TAU, "Gravity compensation.", "see control_laws", regroup=True, composed=True
)
STATE_FEEDBACK = Spec(
    "state_feedback", state_feedback, None,
    (
        Q, V, Argument("gain", ("nv", "nv+nv"), "", "K"), Q_REF, V_REF,
        Argument("hold", ("nv",), "N m | N", "torque at the reference", optional=True),
    ),
    TAU, "State feedback.", "see control_laws", regroup=True, scratch=(("nv",), ("nv",)), composed=True,
)  # fmt: skip
