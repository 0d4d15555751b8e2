"""The robot as a whole: centre of mass, centroidal momentum and the maps from joint velocities to them.

Everything here is seen from the world: poses and velocities are composed outward, inertias and momenta
summed inward at the world's origin. Source: Orin, Goswami, Lee, Centroidal dynamics of a humanoid robot
(2013), for the definitions; the sweeps are a derivation of our own.
"""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import cross, minus, plus, times
from ..algebra.records import (
    inertia_of,
    motion_of,
    pose_of,
    public_force,
    public_vec,
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
    identity_pose,
    inertia_rate,
    inertia_to_parent,
    momentum,
    motion_to_parent,
    scale_motion,
    shift_force,
    zero_force,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .energy import WORK_MOMENT, mass_moment
from .spec import A, Argument, Q, Spec, V

WORK = table_dtype(X=Pose, v=Motion, a=Motion, I=Inertia, dI=Inertia)


@inlined
def outward(bodies: Any, work: Any, q: Any, v: Any, a: Any) -> None:
    """Pose, velocity, acceleration and inertia of every body, in the world; gravity left out. v, a may be None."""
    put_pose(work[0].X, identity_pose())
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].a, zero_motion())
    put_inertia(work[0].I, inertia_of(bodies[0].inertia))
    put_inertia(work[0].dI, inertia_rate(inertia_of(bodies[0].inertia), zero_motion()))
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X = compose(pose_of(parent.X), pose_of(here.X))
        I = inertia_to_parent(X, inertia_of(b.inertia))
        put_pose(here.X, X)
        put_inertia(here.I, I)
        if v is not None:
            vJ = motion_to_parent(X, joint_motion(bodies, i, v))
            vi = add_motion(motion_of(parent.v), vJ)
            put_motion(here.v, vi)
            put_inertia(here.dI, inertia_rate(I, vi))
            if a is not None:
                aJ = motion_to_parent(X, scale_motion(a[i - 1], motion_of(b.S)))
                put_motion(here.a, add_motion(add_motion(motion_of(parent.a), cross_motion(vi, vJ)), aJ))


@inlined
def _inward(bodies: Any, work: Any, v: Any) -> None:
    """Inertia (and its rate, if v is not None) of every subtree, in the world; row 0: of the robot."""
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_of(here.I)))
        if v is not None:
            put_inertia(parent.dI, add_inertia(inertia_of(parent.dI), inertia_of(here.dI)))


@inlined
def _momentum(bodies: Any, work: Any) -> Force:
    """Spatial momentum of the robot about the world's origin."""
    h = zero_force()
    for i in range(1, len(bodies)):
        h = add_force(h, momentum(inertia_of(work[i].I), motion_of(work[i].v)))
    return h


@inlined
def _force(bodies: Any, work: Any) -> Force:
    """Rate of change of the robot's spatial momentum about the world's origin, Σ (I a + v ×* I v)."""
    f = zero_force()
    for i in range(1, len(bodies)):
        I, vi = inertia_of(work[i].I), motion_of(work[i].v)
        f = add_force(f, add_force(momentum(I, motion_of(work[i].a)), cross_force(vi, momentum(I, vi))))
    return f


@inlined
def _mass(bodies: Any) -> Any:
    """Total mass of the moving bodies."""
    m = bodies[0].inertia.m
    for i in range(1, len(bodies)):
        m = m + bodies[i].inertia.m
    return m


@inlined
def center_of_mass(bodies: Any, work: Any, q: Any, c: Any) -> None:
    """c = Σ m c / Σ m, from the first moments summed inward."""
    mass_moment(bodies, work, q)
    public_vec(c, times(1.0 / work[0].m, vec_of(work[0].h)))


@inlined
def center_of_mass_velocity(bodies: Any, work: Any, q: Any, v: Any, out: Any) -> None:
    """Linear momentum over mass."""
    outward(bodies, work, q, v, None)
    public_vec(out, times(1.0 / _mass(bodies), _momentum(bodies, work).f))


@inlined
def center_of_mass_velocity_derivatives(bodies: Any, work: Any, q: Any, v: Any, D: Any) -> None:
    """By q: subtree i turns about S, and its momentum with it, while what carries it seems to move by v_λ × S.

    By v it is the Jacobian.
    """
    outward(bodies, work, q, v, None)
    _inward(bodies, work, v)
    m = 1.0 / work[0].I.m
    for i in range(1, len(bodies)):
        vp = motion_of(work[bodies[i].parent].v)
        for k in range(i, i + bodies[i].dofs):
            S, I = motion_to_parent(pose_of(work[k].X), motion_of(bodies[k].S)), inertia_of(work[k].I)
            seen = plus(momentum(I, cross_motion(vp, S)).f, cross(S.w, vec_of(work[k].dI.h)))
            public_vec(D[0, :, k - 1], times(m, seen))
            public_vec(D[1, :, k - 1], times(m, momentum(I, S).f))


@inlined
def center_of_mass_acceleration(bodies: Any, work: Any, q: Any, v: Any, a: Any, out: Any) -> None:
    """Net force over mass."""
    outward(bodies, work, q, v, a)
    public_vec(out, times(1.0 / _mass(bodies), _force(bodies, work).f))


@inlined
def center_of_mass_jacobian(bodies: Any, work: Any, q: Any, J: Any) -> None:
    """Column i: linear momentum of the subtree under a unit velocity of row i, over the mass of the robot."""
    outward(bodies, work, q, None, None)
    _inward(bodies, work, None)
    for i in range(1, len(bodies)):
        Ji = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        public_vec(J[:, i - 1], times(1.0 / work[0].I.m, momentum(inertia_of(work[i].I), Ji).f))


@inlined
def centroidal_momentum(bodies: Any, work: Any, q: Any, v: Any, h: Any) -> None:
    """The robot's momentum, its moment taken about the centre of mass."""
    outward(bodies, work, q, v, None)
    p = _momentum(bodies, work)
    _inward(bodies, work, None)
    c = times(1.0 / work[0].I.m, vec_of(work[0].I.h))
    public_force(h, shift_force(c, p))


@inlined
def centroidal_momentum_rate(bodies: Any, work: Any, q: Any, v: Any, a: Any, dh: Any) -> None:
    """The net force on the robot, its moment taken about the centre of mass: that of its own motion drops out."""
    outward(bodies, work, q, v, a)
    f = _force(bodies, work)
    _inward(bodies, work, None)
    c = times(1.0 / work[0].I.m, vec_of(work[0].I.h))
    public_force(dh, shift_force(c, f))


@inlined
def centroidal_map(bodies: Any, work: Any, q: Any, Ag: Any) -> None:
    """Column i: Ic S, its moment taken about the centre of mass."""
    outward(bodies, work, q, None, None)
    _inward(bodies, work, None)
    c = times(1.0 / work[0].I.m, vec_of(work[0].I.h))
    for i in range(1, len(bodies)):
        Ji = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        F = momentum(inertia_of(work[i].I), Ji)
        public_force(Ag[:, i - 1], shift_force(c, F))


@inlined
def centroidal_map_dot(bodies: Any, work: Any, q: Any, v: Any, dAg: Any) -> None:
    """Column i: d/dt (Ic S) = İc S + Ic (v × S), and the centre of mass that its moment is taken about moves."""
    outward(bodies, work, q, v, None)
    _inward(bodies, work, v)
    total, rate = inertia_of(work[0].I), inertia_of(work[0].dI)
    c, dc = times(1.0 / total.m, total.h), times(1.0 / total.m, rate.h)
    for i in range(1, len(bodies)):
        Ji = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        I, dI = inertia_of(work[i].I), inertia_of(work[i].dI)
        F = momentum(I, Ji)
        dF = add_force(momentum(dI, Ji), momentum(I, cross_motion(motion_of(work[i].v), Ji)))
        about = shift_force(c, dF)
        public_force(dAg[:, i - 1], Force(minus(about.n, cross(dc, F.f)), about.f))


_SOURCE = "after Orin, Goswami, Lee, Centroidal dynamics of a humanoid robot (2013)."
_ABOUT = "linear first, world axes, about the centre of mass"
SPECS = (
    Spec(
        "center_of_mass", center_of_mass, WORK_MOMENT, (Q,),
        Argument("c", (3,), "m", "centre of mass of what moves, in the world"),
        "Centre of mass of the moving bodies.", "the definition.",
    ),
    Spec(
        "center_of_mass_velocity", center_of_mass_velocity, WORK, (Q, V),
        Argument("vc", (3,), "m/s", "velocity of the centre of mass, in the world"),
        "Velocity of the centre of mass.", "the definition.",
    ),
    Spec(
        "center_of_mass_velocity_derivatives", center_of_mass_velocity_derivatives, WORK, (Q, V),
        Argument(
            "dvc", (2, 3, "nv"), "m/(s rad) | 1/s; m/rad | 1",
            "∂vc/∂q along integrate(q, e_k), and ∂vc/∂v = J, in the world",
        ),
        "Derivatives of the velocity of the centre of mass: ``dvc_dq, J = center_of_mass_velocity_derivatives(...)``.",
        "the definition.",
    ),
    Spec(
        "center_of_mass_acceleration", center_of_mass_acceleration, WORK, (Q, V, A),
        Argument("ac", (3,), "m/s²", "acceleration of the centre of mass, in the world"),
        "Acceleration of the centre of mass; gravity plays no part in it.", "the definition.",
    ),
    Spec(
        "com_jacobian", center_of_mass_jacobian, WORK, (Q,),
        Argument("J", (3, "nv"), "m/rad | 1", "Jacobian of the centre of mass, in the world"),
        "Jacobian of the centre of mass: its velocity is J v.", _SOURCE,
    ),
    Spec(
        "centroidal_momentum", centroidal_momentum, WORK, (Q, V),
        Argument("h", (6,), "kg m/s | kg m²/s", "momentum, " + _ABOUT),
        "Momentum of the robot about its centre of mass.", _SOURCE,
    ),
    Spec(
        "centroidal_momentum_rate", centroidal_momentum_rate, WORK, (Q, V, A),
        Argument("dh", (6,), "N | N m", "rate of change of momentum, " + _ABOUT),
        "Rate of change of the centroidal momentum: the net force on the robot, its weight counted.", _SOURCE,
    ),
    Spec(
        "centroidal_map", centroidal_map, WORK, (Q,),
        Argument("Ag", (6, "nv"), "kg m | kg m² | kg", "momentum per joint velocity, " + _ABOUT),
        "Centroidal momentum matrix: the centroidal momentum is Ag v.", _SOURCE,
    ),
    Spec(
        "centroidal_map_dot", centroidal_map_dot, WORK, (Q, V),
        Argument("dAg", (6, "nv"), "kg m/s | kg m²/s | kg/s", "time derivative of the map, " + _ABOUT),
        "Time derivative of the centroidal momentum matrix along v.", _SOURCE,
    ),
)  # fmt: skip
