"""Regressors without accelerations, for adaptation and identification: of M a_r + C v_r + g, of p = M v and of Cᵀ v.

All are sums of T·(I y), the momentum along a motion T of a body that moves with y; ``along(T, y)`` gives its
coefficients of the body's ten parameters (``tree.regressor``). With v and w the velocities of a body due to the joint
velocities v and v_r, and ẇ the rate of w less gravity, the force that ``coriolis.modified_rnea`` sums is
I ẇ + B(I, v) w, with the Coriolis factor

    S·B(I, v) w = -½ S·I (v × w) - ½ (v × S)·I w - ½ (w × S)·I v,

S the axis of a row that carries the body, moved to the body. Momenta obey ṗ = Cᵀ v + τ - g, where Cᵀ v sums
(v_i × S_i)·I v, v_i the velocity of the row: p₂ - p₁ = ∫ (Cᵀ v + τ - g) dt has all parameters and no acceleration.
"""

from __future__ import annotations

from ...algebra.euclidean import add, cross, dot, neg, zero
from ...algebra.public_arrays import write_parameters
from ...algebra.records import motion_of, pose_of, put_motion, table_dtype, vec_of
from ...algebra.scalars import inline
from ...algebra.spatial import (
    Inertia,
    Motion,
    Pose,
    add_inertia,
    add_motion,
    compose,
    cross_motion,
    identity_pose,
    motion_to_child,
    scale_motion,
    sub_motion,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Array, Bodies, Config, Vector, Work
from ..spec import TURNED_Q, A, Argument, Spec, V
from ..steps import body_velocity
from ..tree.regressor import pairing

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    w=Motion,  # the same of the joint velocities v_r; outward
    a=Motion,  # rate of w less gravity; outward
)
WORK_VELOCITY = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    Z=Motion,  # S, or its rate v × S; outward
)


@inline
def along(T: Motion, y: Motion) -> Inertia:
    """Coefficients of (m, h, Ī) in T·(I y)."""
    return Inertia(dot(T.v, y.v), add(cross(T.v, y.w), cross(y.v, T.w)), pairing(T.w, y.w))


@inline
def modified_torque_regressor(
    bodies: Bodies, work: Work, q: Config, v: Vector, v_r: Vector, a_r: Vector, Y: Array
) -> None:
    """Outward v, w and ẇ; then each body's force along the S of every row that carries it."""
    n = len(bodies) - 1
    Y[:] = 0.0
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].w, zero_motion())
    put_motion(work[0].a, Motion(zero(), neg(vec_of(bodies[0].gravity))))
    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        wJ = joint_motion(bodies, i, v_r)
        vi = body_velocity(bodies, work, i, v)
        ai = add_motion(motion_to_child(X, motion_of(parent.a)), cross_motion(vi, wJ))
        put_motion(here.v, vi)
        put_motion(here.w, add_motion(motion_to_child(X, motion_of(parent.w)), wJ))
        put_motion(here.a, add_motion(ai, scale_motion(a_r[i - 1], motion_of(b.S))))

    for i in range(1, n + 1):
        if bodies[i].joint > 0:
            v_i, w = motion_of(work[i].v), motion_of(work[i].w)
            half_v, half_w = scale_motion(0.5, v_i), scale_motion(0.5, w)
            y = sub_motion(motion_of(work[i].a), cross_motion(half_v, w))
            X = identity_pose()
            j = i
            while j > 0:
                S = motion_to_child(X, motion_of(bodies[j].S))
                turned = add_inertia(along(cross_motion(S, half_v), w), along(cross_motion(S, half_w), v_i))
                write_parameters(Y[j - 1, bodies[i].joint], add_inertia(along(S, y), turned))
                X = compose(pose_of(work[j].X), X)
                j = bodies[j].parent


@inline
def momentum_regressor(bodies: Bodies, work: Work, q: Config, v: Vector, Y: Array) -> None:
    """S·I v: each body's momentum along the S of every row that carries it."""
    move(bodies, work, q, v)
    for i in range(1, len(bodies)):
        put_motion(work[i].Z, motion_of(bodies[i].S))
    momenta_along(bodies, work, Y)


@inline
def coriolis_transpose_regressor(bodies: Bodies, work: Work, q: Config, v: Vector, Y: Array) -> None:
    """(v_i × S_i)·I v: the same along the rate of S, by the velocity of the row's own body."""
    move(bodies, work, q, v)
    for i in range(1, len(bodies)):
        put_motion(work[i].Z, cross_motion(motion_of(work[i].v), motion_of(bodies[i].S)))
    momenta_along(bodies, work, Y)


@inline
def move(bodies: Bodies, work: Work, q: Config, v: Vector) -> None:
    """X and v of every row."""
    put_motion(work[0].v, zero_motion())
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
        put_motion(work[i].v, body_velocity(bodies, work, i, v))


@inline
def momenta_along(bodies: Bodies, work: Work, Y: Array) -> None:
    """Each body's momentum along the Z of every row that carries it."""
    Y[:] = 0.0
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            X = identity_pose()
            j = i
            while j > 0:
                T = motion_to_child(X, motion_of(work[j].Z))
                write_parameters(Y[j - 1, bodies[i].joint], along(T, motion_of(work[i].v)))
                X = compose(pose_of(work[j].X), X)
                j = bodies[j].parent


_TEN = "mass, first moment x y z, Ixx Ixy Iyy Ixz Iyz Izz about the joint's origin"
_LI = "after Slotine and Li, On the adaptive control of robot manipulators (1987): modified_rnea, sorted by parameter."
SPECS = (
    Spec(
        "modified_torque_regressor", modified_torque_regressor, WORK,
        (
            TURNED_Q, V,
            Argument("v_r", V.shape, V.unit, "reference velocities"),
            Argument("a_r", A.shape, A.unit, "reference accelerations"),
        ),
        Argument(
            "Y", ("nv", "njoints", 10), "N m | N per kg, kg m, kg m²",
            f"torque per inertial parameter of each joint's body ({_TEN})",
        ),
        "Regressor Y of modified_rnea for adaptive controllers: M a_r + C v_r + g = Σ Y π + armature a_r; rotors add "
        "further terms.", _LI,
    ),
    Spec(
        "momentum_regressor", momentum_regressor, WORK_VELOCITY, (TURNED_Q, V),
        Argument(
            "Y", ("nv", "njoints", 10), "kg m²/s | kg m/s per kg, kg m, kg m²",
            f"joint momentum per inertial parameter of each joint's body ({_TEN})",
        ),
        "Regressor of joint momenta: p = M v is Σ Y π + armature v; rotors add further terms.", "the definition.",
    ),
    Spec(
        "coriolis_transpose_regressor", coriolis_transpose_regressor, WORK_VELOCITY, (TURNED_Q, V),
        Argument(
            "Y", ("nv", "njoints", 10), "N m | N per kg, kg m, kg m²",
            f"torque per inertial parameter of each joint's body ({_TEN})",
        ),
        "Regressor of Cᵀ v = Σ Y π: with momentum_regressor, p₂ - p₁ = ∫ (Cᵀ v + tau - g) dt identifies a robot "
        "without accelerations; rotors add further terms.",
        "after Echeandia and Wensing, Coriolis matrix and Christoffel symbols (2021).",
    ),
)  # fmt: skip
