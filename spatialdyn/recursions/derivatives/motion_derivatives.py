"""Derivatives of frame motions and of the robot's momentum with respect to configuration, velocity and acceleration.

Derivatives with respect to the configuration are along ``integrate(q, e_k)``. Seen from a frame, a joint that carries
it and moves by S moves all bodies before the joint the opposite way: v_λ and a_λ, of the body that the joint stands on,
change by v_λ × S and a_λ × S, and motions between the joint and the frame change by these alone. This is a derivation
of our own, as are the columns of ``derivatives`` about the centre of mass.
"""

from __future__ import annotations

from ...algebra.coriolis_factor import CoriolisFactor, add_coriolis_factor, coriolis_factor_at_parent, coriolis_times
from ...algebra.euclidean import Vec, add, cross, rotate, scale, sub
from ...algebra.public_arrays import read_pose, write_force, write_motion
from ...algebra.records import (
    coriolis_factor_of,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_coriolis_factor,
    put_force,
    put_inertia,
    put_motion,
    put_pose,
    table_dtype,
    vec_of,
)
from ...algebra.scalars import inline
from ...algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_inertia,
    add_motion,
    cross_force,
    cross_motion,
    force_at_parent,
    inertia_at_parent,
    momentum,
    motion_to_child,
    rotate_force,
    scale_motion,
    sub_motion,
    zero_force,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import CLASSICAL, LOCAL, PLACEMENT, REFERENCE, ROW, TURNED_Q, WORLD, A, Argument, Spec, V
from ..steps import seen_from_parent
from ..tree.kinematics import express_in
from ..tree.rotors import add_couple, rotor_in_root_axes
from .derivatives import add_rotor, motion_outward

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; on the walk
    S=Motion,  # motion subspace in the frame; on the walk
    vJ=Motion,  # joint's velocity in the frame; on the walk
)
WORK_MOMENTUM = table_dtype(
    X=Pose,  # of derivatives.motion_outward, as are the fields to f
    S=Motion,
    I=Inertia,  # of the subtree, inward
    v=Motion,
    a=Motion,
    dS=Motion,
    ddS=Motion,
    D=Motion,
    B=CoriolisFactor,  # of the subtree, inward
    f=Force,  # of the subtree, inward
    h=Force,  # momentum, outward; of the subtree, inward
    world=Pose,  # root-aligned axes at the row's origin, in the world; outward
)


@inline
def _walk(bodies: Bodies, work: Work, q: Config, v: Vector, row: int, placement: Matrix) -> tuple[Pose, Motion]:
    """Pose of the frame, and its velocity in its own coordinates; S and vJ of its rows are written in them."""
    X = read_pose(placement)
    total = zero_motion()
    i = row
    while i > 0:
        vJ = motion_to_child(X, joint_motion(bodies, i, v))
        put_motion(work[i].S, motion_to_child(X, motion_of(bodies[i].S)))
        put_motion(work[i].vJ, vJ)
        total = add_motion(total, vJ)
        X = seen_from_parent(bodies, work, i, q, X)
        i = bodies[i].parent
    return X, total


@inline
def _change_in_reference(X: Pose, S: Motion, m: Motion, dm: Motion, reference: int) -> Motion:
    """The change in the reference of a motion m of the frame, if the frame moves by S, and m in the frame by dm."""
    if reference == LOCAL:
        return dm
    if reference == WORLD:
        return express_in(X, add_motion(dm, cross_motion(S, m)), reference)
    return express_in(X, add_motion(dm, Motion(cross(S.w, m.w), cross(S.w, m.v))), reference)


@inline
def frame_velocity_derivatives(
    bodies: Bodies, work: Work, q: Config, v: Vector, row: int, placement: Matrix, reference: int, D: Array
) -> None:
    """Column k: v_λ × S and S."""
    D[:] = 0.0
    X, V = _walk(bodies, work, q, v, row, placement)
    vp = V
    i = row
    while i > 0:
        vp = sub_motion(vp, motion_of(work[i].vJ))
        for k in range(i, i + bodies[i].dofs):
            S = motion_of(work[k].S)
            write_motion(D[0, :, k - 1], _change_in_reference(X, S, V, cross_motion(vp, S), reference))
            write_motion(D[1, :, k - 1], express_in(X, S, reference))
        i = bodies[i].parent


@inline
def _classical(dA: Motion, V: Motion, dV: Motion) -> Motion:
    """The change of the spatial acceleration and of ω × v."""
    return Motion(dA.w, add(dA.v, add(cross(dV.w, V.v), cross(V.w, dV.v))))


@inline
def frame_acceleration_derivatives(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    a: Vector,
    row: int,
    placement: Matrix,
    reference: int,
    classical: int,
    D: Array,
) -> None:
    """Column k: a_λ × S + (v_λ × S) × (V - v_λ), v_λ × S + S × (V - v) and S, v that of the joint's own body."""
    D[:] = 0.0
    X, V = _walk(bodies, work, q, v, row, placement)
    vp, total = V, zero_motion()
    i = row
    while i > 0:
        vJ = motion_of(work[i].vJ)
        vp = sub_motion(vp, vJ)
        total = add_motion(total, cross_motion(vp, vJ))
        total = add_motion(total, scale_motion(a[i - 1], motion_of(work[i].S)))
        i = bodies[i].parent
    V_there = express_in(X, V, reference)
    vp, ap = V, total
    i = row
    while i > 0:
        vJ, beyond = motion_of(work[i].vJ), sub_motion(V, vp)
        vp = sub_motion(vp, vJ)
        ap = sub_motion(ap, cross_motion(vp, vJ))
        ap = sub_motion(ap, scale_motion(a[i - 1], motion_of(work[i].S)))
        for k in range(i, i + bodies[i].dofs):
            S = motion_of(work[k].S)
            dS = cross_motion(vp, S)
            by_q = add_motion(cross_motion(ap, S), cross_motion(dS, sub_motion(V, vp)))
            by_q = _change_in_reference(X, S, total, by_q, reference)
            by_v = express_in(X, add_motion(dS, cross_motion(S, beyond)), reference)
            J = express_in(X, S, reference)
            if classical == 1:
                by_q = _classical(by_q, V_there, _change_in_reference(X, S, V, dS, reference))
                by_v = _classical(by_v, V_there, J)
            write_motion(D[0, :, k - 1], by_q)
            write_motion(D[1, :, k - 1], by_v)
            write_motion(D[2, :, k - 1], J)
        i = bodies[i].parent


@inline
def _about(X: Pose, c: Vec, F: Force) -> Force:
    """A force about the origin of the frame X, in its axes, in the world's about c."""
    there = rotate_force(X.R, F)
    return Force(add(there.n, cross(sub(X.p, c), there.f)), there.f)


@inline
def centroidal_dynamics_derivatives(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, D: Array) -> None:
    """The columns of ∂τ before S_i projects them, about the centre of mass c, which moves by ∂c: F × ∂c is added.

    Gravity drops out: the weight is constant and has no moment about c.
    """
    n = len(bodies) - 1
    motion_outward(bodies, work, q, v, a, None)
    m, first = bodies[0].inertia.m, vec_of(bodies[0].inertia.h)
    p, dp = zero_force().f, zero_force().f
    for i in range(1, n + 1):
        here, parent = work[i], work[bodies[i].parent]
        if bodies[i].parent == 0:
            place_joint(bodies, i, q, here.world)
        else:
            X = pose_of(parent.world)
            put_pose(here.world, Pose(X.R, add(X.p, rotate(X.R, vec_of(here.X.p)))))
        put_force(here.h, momentum(inertia_of(here.I), motion_of(here.v)))
    for i in range(n, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        if bodies[i].parent > 0:
            x = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_at_parent(x, inertia_of(here.I))))
            put_coriolis_factor(
                parent.B,
                add_coriolis_factor(
                    coriolis_factor_of(parent.B), coriolis_factor_at_parent(x, coriolis_factor_of(here.B))
                ),
            )
            put_force(parent.f, add_force(force_of(parent.f), force_at_parent(x, force_of(here.f))))
            put_force(parent.h, add_force(force_of(parent.h), force_at_parent(x, force_of(here.h))))
            if bodies[i].geared:
                add_rotor(bodies, work, i, v, a)
                e, _ = rotor_in_root_axes(bodies, work, i)
                put_force(parent.h, add_couple(force_of(parent.h), scale(v[i - 1], e)))
        else:
            X = pose_of(here.world)
            m = m + here.I.m
            first = add(first, add(rotate(X.R, vec_of(here.I.h)), scale(here.I.m, X.p)))
            p, dp = add(p, rotate(X.R, vec_of(here.h.f))), add(dp, rotate(X.R, vec_of(here.f.f)))
    c = scale(1.0 / m, first)
    for i in range(1, n + 1):
        here = work[i]
        S, I, B, X = motion_of(here.S), inertia_of(here.I), coriolis_factor_of(here.B), pose_of(here.world)
        dS = motion_of(here.dS)
        h_dq = add_force(momentum(I, dS), cross_force(S, force_of(here.h)))
        F_dq = add_force(
            add_force(momentum(I, motion_of(here.ddS)), coriolis_times(B, dS)), cross_force(S, force_of(here.f))
        )
        F_dv, F_S = add_force(momentum(I, motion_of(here.D)), coriolis_times(B, S)), momentum(I, S)
        if bodies[i].geared:
            e, de = rotor_in_root_axes(bodies, work, i)
            F_dv, F_S = add_couple(F_dv, de), add_couple(F_S, e)
        F_S, dh, df = _about(X, c, F_S), _about(X, c, h_dq), _about(X, c, F_dq)
        dc = scale(1.0 / m, F_S.f)
        write_force(D[0, :, i - 1], Force(add(dh.n, cross(p, dc)), dh.f))
        write_force(D[1, :, i - 1], Force(add(df.n, cross(dp, dc)), df.f))
        write_force(D[2, :, i - 1], _about(X, c, F_dv))
        write_force(D[3, :, i - 1], F_S)


_BODY = "the definition, walked from the frame to the world."
_ALONG, _WHERE = "along integrate(q, e_k)", "linear first, in the reference"
SPECS = (
    Spec(
        "frame_velocity_derivatives", frame_velocity_derivatives, WORK, (TURNED_Q, V, ROW, PLACEMENT, REFERENCE),
        Argument(
            "dV", (2, 6, "nv"), "m/(s rad) | 1/s; m/rad | 1", f"∂V/∂q {_ALONG} and ∂V/∂v = J, {_WHERE}",
        ),
        "Derivatives of the velocity of a frame: ``dV_dq, J = frame_velocity_derivatives(...)``.", _BODY,
    ),
    Spec(
        "frame_acceleration_derivatives", frame_acceleration_derivatives, WORK,
        (TURNED_Q, V, A, ROW, PLACEMENT, REFERENCE, CLASSICAL),
        Argument(
            "dA", (3, 6, "nv"), "m/(s² rad) | 1/s²; m/(s rad) | 1/s; m/rad | 1",
            f"∂A/∂q {_ALONG}, ∂A/∂v and ∂A/∂a = J, {_WHERE}",
        ),
        "Derivatives of the acceleration of a frame, spatial or classical: ``dA_dq, dA_dv, J = "
        "frame_acceleration_derivatives(...)``.",
        _BODY,
    ),
    Spec(
        "centroidal_dynamics_derivatives", centroidal_dynamics_derivatives, WORK_MOMENTUM, (TURNED_Q, V, A),
        Argument(
            "dh", (4, 6, "nv"), "kg m/(s rad) | kg/s; kg m/(s² rad) | kg/s²; kg m/s | kg/s; kg m | kg",
            f"∂h/∂q {_ALONG}, ∂(dh/dt)/∂q, ∂(dh/dt)/∂v and ∂(dh/dt)/∂a = ∂h/∂v = Ag, linear first, world axes, about "
            "the centre of mass",
        ),
        "Derivatives of the centroidal momentum h and its rate dh/dt = Ag a + (dAg/dt) v: ``dh_dq, ddh_dq, ddh_dv, "
        "Ag = centroidal_dynamics_derivatives(...)``.",
        "after Singh, Russell, Wensing, Efficient analytical derivatives of rigid-body dynamics (2022).",
    ),
)  # fmt: skip
