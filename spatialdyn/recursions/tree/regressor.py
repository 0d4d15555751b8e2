"""Regressors: torque, energies, the force on one body and the centre of mass as linear maps of inertial parameters.

A body's ten parameters are π = (m, h, Ī): mass, first moment m c and rotational inertia about its frame's origin.
Every result here is linear in π: a row of ten numbers that pair with (m, h, Ī), stored as an Inertia; one off-diagonal
entry stands for the two equal entries of Ī. To project a body's force on a joint far towards the root, the joint's S is
moved to the body: one motion, in place of ten forces moved to the joint.

Armatures and rotors are no parameters of a body: τ = Y π + armature a, T = Y π + ½ armature v²; ``rotors`` has the
terms of rotors.
"""

from __future__ import annotations

from ...algebra.euclidean import (
    Mat3,
    Sym,
    Vec,
    acceleration_matrix,
    add,
    add_sym,
    cross,
    dot,
    neg,
    scale,
    sub,
    unrotate,
    zero,
)
from ...algebra.public_arrays import write_parameters
from ...algebra.records import inertia_of, motion_of, pose_of, put_motion, put_pose, put_vec, table_dtype, vec_of
from ...algebra.scalars import inline
from ...algebra.spatial import (
    Inertia,
    Motion,
    Pose,
    add_motion,
    compose,
    cross_motion,
    identity_pose,
    motion_to_child,
    scale_motion,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import PLACEMENT, ROW, TURNED_Q, A, Argument, Spec, V
from ..steps import body_velocity, moved_by_joint
from .kinematics import frame_motion

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    a=Motion,  # spatial acceleration less gravity; outward
)
WORK_VELOCITY = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
)
WORK_GRAVITY = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    g=Vec,  # gravity in the axes of the row; outward
    V=float,  # potential of a unit mass at the row's origin; outward
)
WORK_POSE = table_dtype(
    X=Pose,  # pose of the row in the world; outward
)


# --- rows: ten numbers that pair with (m, h, Ī) -----------------------------------------------------------


@inline
def pairing(a: Vec, b: Vec) -> Sym:
    """Coefficients of the six numbers of Ī in a·Ī b."""
    return Sym(a.x * b.x, a.x * b.y + a.y * b.x, a.x * b.z + a.z * b.x, a.y * b.y, a.y * b.z + a.z * b.y, a.z * b.z)


@inline
def force_along(S: Motion, w: Vec, dw: Vec, a: Vec, U: Mat3) -> Inertia:
    """Coefficients of (m, h, Ī) in S·f, f the force m a + U h, Ī ω̇ + ω × Ī ω + h × a that moves a body.

    a is the classical acceleration of its origin, U = ω̇~ + ω̃². With s = S.w, s·(ω × Ī ω) is (s × ω)·Ī ω.
    """
    return Inertia(
        dot(S.v, a),
        add(unrotate(U, S.v), cross(a, S.w)),
        add_sym(pairing(S.w, dw), pairing(cross(S.w, w), w)),
    )


@inline
def body_force(v: Motion, a: Motion, out: Array) -> None:
    """The six rows (6, 10), linear first, of I a + v ×* I v for a velocity and a spatial acceleration of a body."""
    U = acceleration_matrix(v.w, a.w)
    classical = add(a.v, cross(v.w, v.v))
    x, y, z = Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0)
    write_parameters(out[0], force_along(Motion(zero(), x), v.w, a.w, classical, U))
    write_parameters(out[1], force_along(Motion(zero(), y), v.w, a.w, classical, U))
    write_parameters(out[2], force_along(Motion(zero(), z), v.w, a.w, classical, U))
    write_parameters(out[3], force_along(Motion(x, zero()), v.w, a.w, classical, U))
    write_parameters(out[4], force_along(Motion(y, zero()), v.w, a.w, classical, U))
    write_parameters(out[5], force_along(Motion(z, zero()), v.w, a.w, classical, U))


# --- recursions -----------------------------------------------------------------------------------------


@inline
def inertial_parameters(bodies: Bodies, out: Array) -> None:
    """The parameters themselves, row by row."""
    out[0, :] = 0.0
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            write_parameters(out[bodies[i].joint], inertia_of(bodies[i].inertia))


@inline
def joint_torque_regressor(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, Y: Array) -> None:
    """Velocities and accelerations outward; then each body's force along S of every row that carries it."""
    n = len(bodies) - 1
    Y[:] = 0.0
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].a, Motion(zero(), neg(vec_of(bodies[0].gravity))))
    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        vJ = joint_motion(bodies, i, v)
        vi = moved_by_joint(here, parent, vJ)
        ai = add_motion(motion_to_child(X, motion_of(parent.a)), cross_motion(vi, vJ))
        put_motion(here.v, vi)
        put_motion(here.a, add_motion(ai, scale_motion(a[i - 1], motion_of(b.S))))

    for i in range(1, n + 1):
        if bodies[i].joint > 0:
            vi, ai = motion_of(work[i].v), motion_of(work[i].a)
            U = acceleration_matrix(vi.w, ai.w)
            classical = add(ai.v, cross(vi.w, vi.v))
            X = identity_pose()
            j = i
            while j > 0:
                S = motion_to_child(X, motion_of(bodies[j].S))
                write_parameters(Y[j - 1, bodies[i].joint], force_along(S, vi.w, ai.w, classical, U))
                X = compose(pose_of(work[j].X), X)
                j = bodies[j].parent


@inline
def body_regressor(
    bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, row: int, placement: Matrix, out: Array
) -> None:
    """The force on a body attached to the frame, in the frame's coordinates; gravity counts as acceleration."""
    X, vf, af = frame_motion(bodies, work, q, v, a, row, placement)
    g = unrotate(X.R, vec_of(bodies[0].gravity))
    body_force(vf, Motion(af.w, sub(af.v, g)), out)


@inline
def kinetic_energy_regressor(bodies: Bodies, work: Work, q: Config, v: Vector, out: Array) -> None:
    """T of a body is ½ m v·v + h·(v × ω) + ½ ω·Ī ω."""
    put_motion(work[0].v, zero_motion())
    out[0, :] = 0.0
    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        vi = body_velocity(bodies, work, i, v)
        put_motion(here.v, vi)
        if b.joint > 0:
            half = scale(0.5, vi.w)
            row = Inertia(0.5 * dot(vi.v, vi.v), cross(vi.v, vi.w), pairing(half, vi.w))
            write_parameters(out[b.joint], row)


@inline
def potential_energy_regressor(bodies: Bodies, work: Work, q: Config, out: Array) -> None:
    """V of a body is -g·(m p + h): g in its axes, and -g·p summed from body to body."""
    put_vec(work[0].g, vec_of(bodies[0].gravity))
    work[0].V = 0.0
    out[0, :] = 0.0
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X, up = pose_of(here.X), vec_of(parent.g)
        g, V = unrotate(X.R, up), parent.V - dot(up, X.p)
        put_vec(here.g, g)
        here.V = V
        if b.joint > 0:
            write_parameters(out[b.joint], Inertia(V, neg(g), Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))


@inline
def static_regressor(bodies: Bodies, work: Work, q: Config, out: Array) -> None:
    """c = Σ (p m + R h) / Σ m over the bodies."""
    put_pose(work[0].X, identity_pose())
    m = bodies[0].inertia.m
    out[:, 0, :] = 0.0
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
        put_pose(work[i].X, compose(pose_of(work[bodies[i].parent].X), pose_of(work[i].X)))
        m = m + bodies[i].inertia.m
    for i in range(1, len(bodies)):
        joint = bodies[i].joint
        if joint > 0:
            d, X = 1.0 / m, pose_of(work[i].X)
            R, p = X.R, scale(d, X.p)
            out[0, joint, 0], out[1, joint, 0], out[2, joint, 0] = p.x, p.y, p.z
            out[0, joint, 1], out[0, joint, 2], out[0, joint, 3] = d * R.xx, d * R.xy, d * R.xz
            out[1, joint, 1], out[1, joint, 2], out[1, joint, 3] = d * R.yx, d * R.yy, d * R.yz
            out[2, joint, 1], out[2, joint, 2], out[2, joint, 3] = d * R.zx, d * R.zy, d * R.zz


_TEN = "mass, first moment x y z, Ixx Ixy Iyy Ixz Iyz Izz about the joint's origin"
_SOURCE = "after Featherstone, RBDA (2008), table 5.1: its terms sorted by parameter."
_DEFINITION = "the definition."
SPECS = (
    Spec(
        "inertial_parameters", inertial_parameters, None, (),
        Argument("pi", ("njoints", 10), "kg | kg m | kg m²", f"of each joint's body: {_TEN}; row 0, the world's, is 0"),
        "Inertial parameters π of each joint's body, in the order of the regressors' columns.", _DEFINITION,
    ),
    Spec(
        "joint_torque_regressor", joint_torque_regressor, WORK, (TURNED_Q, V, A),
        Argument(
            "Y", ("nv", "njoints", 10), "N m | N per kg, kg m, kg m²",
            f"torque per inertial parameter of each joint's body ({_TEN})",
        ),
        "Regressor Y of inverse dynamics: rnea is Σ Y π + armature a, with π of inertial_parameters; rotors add "
        "further terms.", _SOURCE,
    ),
    Spec(
        "body_regressor", body_regressor, WORK_POSE, (TURNED_Q, V, A, ROW, PLACEMENT),
        Argument("Y", (6, 10), "N | N m per kg, kg m, kg m²", "force per parameter, linear first, in the frame"),
        "Regressor of the force that moves a body fixed to a frame, gravity included; parameters and force are in "
        "the frame's coordinates.", _SOURCE,
    ),
    Spec(
        "kinetic_energy_regressor", kinetic_energy_regressor, WORK_VELOCITY, (TURNED_Q, V),
        Argument("Y", ("njoints", 10), "J per kg, kg m, kg m²", f"energy per parameter of each joint's body ({_TEN})"),
        "Regressor of kinetic energy: T is Σ Y π + ½ armature v².", _DEFINITION,
    ),
    Spec(
        "potential_energy_regressor", potential_energy_regressor, WORK_GRAVITY, (TURNED_Q,),
        Argument("Y", ("njoints", 10), "J per kg, kg m, kg m²", f"energy per parameter of each joint's body ({_TEN})"),
        "Regressor of potential energy: V is Σ Y π.", _DEFINITION,
    ),
    Spec(
        "static_regressor", static_regressor, WORK_POSE, (TURNED_Q,),
        Argument(
            "Y", (3, "njoints", 4), "m/kg | 1/kg", "centre of mass per mass and first moment x y z of each joint's body"
        ),
        "Regressor of the centre of mass for a known total mass: c is Σ Y π over the first four parameters.",
        _DEFINITION,
    ),
)  # fmt: skip
