"""Derivatives of how frames move and of the robot's momentum, by configuration, velocity and acceleration.

By the configuration means along ``integrate(q, e_k)``. Seen from a frame, a joint that carries it and moves by S has
turned all that stands before it the other way: v_λ and a_λ, of the body that the joint stands on, change by v_λ × S and
a_λ × S there, and nothing between the joint and the frame changes but by them: a derivation of our own, as is what
becomes of the columns of ``derivatives`` about the centre of mass.
"""

from __future__ import annotations

from typing import Any

from ..algebra.coriolis_factor import Coupling, add_coupling, coupled, unshift_coupling
from ..algebra.euclidean import Vec, cross, minus, plus, rotate, times
from ..algebra.records import (
    coupling_of,
    force_of,
    inertia_of,
    motion_of,
    pose_from,
    pose_of,
    public_force,
    public_motion,
    put_coupling,
    put_force,
    put_inertia,
    put_motion,
    put_pose,
    table_dtype,
    vec_of,
)
from ..algebra.scalars import inlined
from ..algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_inertia,
    add_motion,
    compose,
    cross_force,
    cross_motion,
    momentum,
    motion_to_child,
    rotate_force,
    scale_motion,
    sub_motion,
    unshift_force,
    unshift_inertia,
    zero_force,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .derivatives import outward
from .kinematics import referred
from .spec import CLASSICAL, LOCAL, PLACEMENT, REFERENCE, ROW, WORLD, A, Argument, Q, Spec, V

WORK = table_dtype(X=Pose, S=Motion, vJ=Motion)
WORK_MOMENTUM = table_dtype(
    X=Pose, S=Motion, I=Inertia, v=Motion, a=Motion, dS=Motion, ddS=Motion, D=Motion, B=Coupling, f=Force,
    h=Force, world=Pose,
)  # fmt: skip


@inlined
def _clear(D: Any, count: int, n: int) -> None:
    for k in range(count):
        for m in range(6):
            for i in range(n):
                D[k, m, i] = 0.0


@inlined
def _walk(bodies: Any, work: Any, q: Any, v: Any, row: int, placement: Any) -> tuple[Pose, Motion]:
    """The frame in the world, and its velocity in its own coordinates, in which S and vJ of its rows are left."""
    X = pose_from(placement)
    total = zero_motion()
    i = row
    while i > 0:
        vJ = motion_to_child(X, joint_motion(bodies, i, v))
        put_motion(work[i].S, motion_to_child(X, motion_of(bodies[i].S)))
        put_motion(work[i].vJ, vJ)
        total = add_motion(total, vJ)
        place_joint(bodies, i, q, work[i].X)
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    return X, total


@inlined
def _turned(X: Pose, S: Motion, m: Motion, dm: Motion, reference: int) -> Motion:
    """What a motion of the frame, m, changes by in the reference where the frame moves by S, and m by dm in it."""
    if reference == LOCAL:
        return dm
    if reference == WORLD:
        return referred(X, add_motion(dm, cross_motion(S, m)), reference)
    return referred(X, add_motion(dm, Motion(cross(S.w, m.w), cross(S.w, m.v))), reference)


@inlined
def frame_velocity_derivatives(
    bodies: Any, work: Any, q: Any, v: Any, row: int, placement: Any, reference: int, D: Any
) -> None:
    """Column k: v_λ × S and S."""
    _clear(D, 2, len(bodies) - 1)
    X, V = _walk(bodies, work, q, v, row, placement)
    vp = V
    i = row
    while i > 0:
        vp = sub_motion(vp, motion_of(work[i].vJ))
        for k in range(i, i + bodies[i].dofs):
            S = motion_of(work[k].S)
            public_motion(D[0, :, k - 1], _turned(X, S, V, cross_motion(vp, S), reference))
            public_motion(D[1, :, k - 1], referred(X, S, reference))
        i = bodies[i].parent


@inlined
def _classical(dA: Motion, V: Motion, dV: Motion) -> Motion:
    """The change of the spatial acceleration and of ω × v."""
    return Motion(dA.w, plus(dA.v, plus(cross(dV.w, V.v), cross(V.w, dV.v))))


@inlined
def frame_acceleration_derivatives(
    bodies: Any, work: Any, q: Any, v: Any, a: Any, row: int, placement: Any, reference: int, classical: int, D: Any
) -> None:
    """Column k: a_λ × S + (v_λ × S) × (V - v_λ), v_λ × S + S × (V - v) and S, v that of the joint's own body."""
    _clear(D, 3, len(bodies) - 1)
    X, V = _walk(bodies, work, q, v, row, placement)
    vp, total = V, zero_motion()
    i = row
    while i > 0:
        vJ = motion_of(work[i].vJ)
        vp = sub_motion(vp, vJ)
        total = add_motion(total, cross_motion(vp, vJ))
        total = add_motion(total, scale_motion(a[i - 1], motion_of(work[i].S)))
        i = bodies[i].parent
    V_there = referred(X, V, reference)
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
            by_q = _turned(X, S, total, by_q, reference)
            by_v = referred(X, add_motion(dS, cross_motion(S, beyond)), reference)
            J = referred(X, S, reference)
            if classical == 1:
                by_q = _classical(by_q, V_there, _turned(X, S, V, dS, reference))
                by_v = _classical(by_v, V_there, J)
            public_motion(D[0, :, k - 1], by_q)
            public_motion(D[1, :, k - 1], by_v)
            public_motion(D[2, :, k - 1], J)
        i = bodies[i].parent


@inlined
def _about(X: Pose, c: Vec, F: Force) -> Force:
    """A force about the origin of the frame X, in its axes, in the world's about c."""
    there = rotate_force(X.R, F)
    return Force(plus(there.n, cross(minus(X.p, c), there.f)), there.f)


@inlined
def centroidal_dynamics_derivatives(bodies: Any, work: Any, q: Any, v: Any, a: Any, D: Any) -> None:
    """The columns of ∂τ before S_i is asked, about the centre of mass c; c moves by ∂c, and F about it by F × ∂c.

    What gravity does it does to the linear part, evenly, so that nothing of it is left.
    """
    n = len(bodies) - 1
    outward(bodies, work, q, v, a, None)
    m, first = bodies[0].inertia.m, vec_of(bodies[0].inertia.h)
    p, dp = zero_force().f, zero_force().f
    for i in range(1, n + 1):
        here, parent = work[i], work[bodies[i].parent]
        if bodies[i].parent == 0:
            place_joint(bodies, i, q, here.world)
        else:
            X = pose_of(parent.world)
            put_pose(here.world, Pose(X.R, plus(X.p, rotate(X.R, vec_of(here.X.p)))))
        put_force(here.h, momentum(inertia_of(here.I), motion_of(here.v)))
    for i in range(n, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        if bodies[i].parent > 0:
            x = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), unshift_inertia(x, inertia_of(here.I))))
            put_coupling(parent.B, add_coupling(coupling_of(parent.B), unshift_coupling(x, coupling_of(here.B))))
            put_force(parent.f, add_force(force_of(parent.f), unshift_force(x, force_of(here.f))))
            put_force(parent.h, add_force(force_of(parent.h), unshift_force(x, force_of(here.h))))
        else:
            X = pose_of(here.world)
            m = m + here.I.m
            first = plus(first, plus(rotate(X.R, vec_of(here.I.h)), times(here.I.m, X.p)))
            p, dp = plus(p, rotate(X.R, vec_of(here.h.f))), plus(dp, rotate(X.R, vec_of(here.f.f)))
    c = times(1.0 / m, first)
    for i in range(1, n + 1):
        here = work[i]
        S, I, B, X = motion_of(here.S), inertia_of(here.I), coupling_of(here.B), pose_of(here.world)
        dS = motion_of(here.dS)
        of_h = add_force(momentum(I, dS), cross_force(S, force_of(here.h)))
        of_f = add_force(add_force(momentum(I, motion_of(here.ddS)), coupled(B, dS)), cross_force(S, force_of(here.f)))
        moved = add_force(momentum(I, motion_of(here.D)), coupled(B, S))
        plain, dh, df = _about(X, c, momentum(I, S)), _about(X, c, of_h), _about(X, c, of_f)
        dc = times(1.0 / m, plain.f)
        public_force(D[0, :, i - 1], Force(plus(dh.n, cross(p, dc)), dh.f))
        public_force(D[1, :, i - 1], Force(plus(df.n, cross(dp, dc)), df.f))
        public_force(D[2, :, i - 1], _about(X, c, moved))
        public_force(D[3, :, i - 1], plain)


_BODY = "the definition, walked from the frame to the world."
_ALONG, _WHERE = "along integrate(q, e_k)", "linear first, in the reference"
SPECS = (
    Spec(
        "frame_velocity_derivatives", frame_velocity_derivatives, WORK, (Q, V, ROW, PLACEMENT, REFERENCE),
        Argument(
            "dV", (2, 6, "nv"), "m/(s rad) | 1/s; m/rad | 1", f"∂V/∂q {_ALONG} and ∂V/∂v = J, {_WHERE}",
        ),
        "Derivatives of the velocity of a frame: ``dV_dq, J = frame_velocity_derivatives(...)``.", _BODY,
    ),
    Spec(
        "frame_acceleration_derivatives", frame_acceleration_derivatives, WORK,
        (Q, V, A, ROW, PLACEMENT, REFERENCE, CLASSICAL),
        Argument(
            "dA", (3, 6, "nv"), "m/(s² rad) | 1/s²; m/(s rad) | 1/s; m/rad | 1",
            f"∂A/∂q {_ALONG}, ∂A/∂v and ∂A/∂a = J, {_WHERE}",
        ),
        "Derivatives of the acceleration of a frame, spatial or classical: ``dA_dq, dA_dv, J = "
        "frame_acceleration_derivatives(...)``.",
        _BODY,
    ),
    Spec(
        "centroidal_dynamics_derivatives", centroidal_dynamics_derivatives, WORK_MOMENTUM, (Q, V, A),
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
