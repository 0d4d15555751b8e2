"""The robot as a whole: centre of mass, centroidal momentum and the maps from joint velocities to them.

All quantities are in world axes, about the world's origin: poses and velocities are composed outward, inertias and
momenta are summed inward. Source: Orin, Goswami, Lee, Centroidal dynamics of a humanoid robot (2013), for the
definitions; the sweeps are a derivation of our own.
"""

from __future__ import annotations

from ...algebra.euclidean import Vec, add, cross, rotate, scale, sub
from ...algebra.public_arrays import write_force, write_vec
from ...algebra.records import (
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_force,
    put_inertia,
    put_motion,
    put_pose,
    table_dtype,
    vec_of,
)
from ...algebra.scalars import Scalar, inline, inline_or_by_rows
from ...algebra.spatial import (
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
    force_at_child,
    force_to_parent,
    identity_pose,
    inertia_rate,
    inertia_to_parent,
    momentum,
    motion_to_child,
    motion_to_parent,
    scale_motion,
    zero_force,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import TURNED_Q, A, Argument, Spec, V
from ..steps import body_velocity, moved_by_joint
from ..tree.rotors import add_couple, rotor_couple, rotor_in_root_axes
from .energy import WORK_MOMENT, mass_moment

WORK = table_dtype(
    X=Pose,  # pose of the row in the world; outward
    v=Motion,  # spatial velocity in the world; outward, if v is given
    a=Motion,  # spatial acceleration in the world; outward, if a is given
    I=Inertia,  # inertia in the world, outward; of the subtree, inward
    dI=Inertia,  # its rate, outward; of the subtree, inward
)
WORK_COMPOSITE = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    X0=Pose,  # pose of the row in the world; outward
    I=Inertia,  # inertia, outward; of the subtree, inward
)
WORK_TOTAL = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    a=Motion,  # spatial acceleration; outward, if a is given
    m=float,  # mass, outward; of the subtree, inward
    h=Vec,  # first moment of mass, outward; of the subtree, inward
    f=Force,  # momentum of the body, or force that moves it, outward; of the subtree, inward
)


@inline
def momentum_outward(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector) -> None:
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


@inline
def _inward(bodies: Bodies, work: Work, v: Vector) -> None:
    """Inertia (and its rate, if v is not None) of every subtree, in the world; row 0: of the robot."""
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_of(here.I)))
        if v is not None:
            put_inertia(parent.dI, add_inertia(inertia_of(parent.dI), inertia_of(here.dI)))


@inline
def _centre(work: Work) -> Vec:
    """Centre of mass of the robot in the world, after ``_inward``."""
    return scale(1.0 / work[0].I.m, vec_of(work[0].I.h))


@inline
def _momentum(bodies: Bodies, work: Work) -> Force:
    """Spatial momentum of the robot about the world's origin."""
    h = zero_force()
    for i in range(1, len(bodies)):
        h = add_force(h, momentum(inertia_of(work[i].I), motion_of(work[i].v)))
    return h


@inline
def _force(bodies: Bodies, work: Work) -> Force:
    """Rate of change of the robot's spatial momentum about the world's origin, Σ (I a + v ×* I v)."""
    f = zero_force()
    for i in range(1, len(bodies)):
        I, vi = inertia_of(work[i].I), motion_of(work[i].v)
        f = add_force(f, add_force(momentum(I, motion_of(work[i].a)), cross_force(vi, momentum(I, vi))))
    return f


@inline
def _mass(bodies: Bodies) -> Scalar:
    """Total mass of the moving bodies."""
    m = bodies[0].inertia.m
    for i in range(1, len(bodies)):
        m = m + bodies[i].inertia.m
    return m


@inline_or_by_rows
def center_of_mass(bodies: Bodies, work: Work, q: Config, c: Vector) -> None:
    """c = Σ m c / Σ m, from the first moments summed inward."""
    mass_moment(bodies, work, q)
    write_vec(c, scale(1.0 / work[0].m, vec_of(work[0].h)))


@inline
def center_of_mass_velocity(bodies: Bodies, work: Work, q: Config, v: Vector, out: Vector) -> None:
    """Linear momentum over mass."""
    momentum_outward(bodies, work, q, v, None)
    write_vec(out, scale(1.0 / _mass(bodies), _momentum(bodies, work).f))


@inline
def center_of_mass_velocity_derivatives(bodies: Bodies, work: Work, q: Config, v: Vector, D: Array) -> None:
    """By q: subtree i and its momentum rotate about S, and seen from the subtree the velocity of its parent body
    changes by v_λ × S. By v: the Jacobian.
    """
    momentum_outward(bodies, work, q, v, None)
    _inward(bodies, work, v)
    m = 1.0 / work[0].I.m
    for i in range(1, len(bodies)):
        vp = motion_of(work[bodies[i].parent].v)
        for k in range(i, i + bodies[i].dofs):
            S, I = motion_to_parent(pose_of(work[k].X), motion_of(bodies[k].S)), inertia_of(work[k].I)
            seen = add(momentum(I, cross_motion(vp, S)).f, cross(S.w, vec_of(work[k].dI.h)))
            write_vec(D[0, :, k - 1], scale(m, seen))
            write_vec(D[1, :, k - 1], scale(m, momentum(I, S).f))


@inline_or_by_rows
def center_of_mass_acceleration(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, out: Vector) -> None:
    """Net force over mass."""
    momentum_outward(bodies, work, q, v, a)
    write_vec(out, scale(1.0 / _mass(bodies), _force(bodies, work).f))


@inline_or_by_rows
def center_of_mass_jacobian(bodies: Bodies, work: Work, q: Config, J: Matrix) -> None:
    """Column i: linear momentum of the subtree under a unit velocity of row i, over the mass of the robot."""
    momentum_outward(bodies, work, q, None, None)
    _inward(bodies, work, None)
    for i in range(1, len(bodies)):
        Ji = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        write_vec(J[:, i - 1], scale(1.0 / work[0].I.m, momentum(inertia_of(work[i].I), Ji).f))


@inline
def centroidal_momentum(bodies: Bodies, work: Work, q: Config, v: Vector, h: Vector) -> None:
    """The robot's momentum Σ I v, its moment taken about the centre of mass."""
    mass_moment(bodies, work, q)
    put_motion(work[0].v, zero_motion())
    put_force(work[0].f, zero_force())
    for i in range(1, len(bodies)):
        b, here, parent, vi = bodies[i], work[i], work[bodies[i].parent], body_velocity(bodies, work, i, v)
        put_motion(here.v, vi)
        put_force(here.f, momentum(inertia_of(b.inertia), vi))
        if b.geared:
            put_force(parent.f, add_couple(force_of(parent.f), scale(v[i - 1], vec_of(b.rotor))))
    write_force(h, _about_centre(bodies, work))


@inline
def centroidal_momentum_rate(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, dh: Vector) -> None:
    """The net force Σ (I a + v ×* I v), with its moment about the centre of mass; the motion of that adds no term."""
    mass_moment(bodies, work, q)
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].a, zero_motion())
    put_force(work[0].f, zero_force())
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        vJ = joint_motion(bodies, i, v)
        vi = moved_by_joint(here, parent, vJ)
        aJ = add_motion(scale_motion(a[i - 1], motion_of(b.S)), cross_motion(vi, vJ))
        ai = add_motion(motion_to_child(pose_of(here.X), motion_of(parent.a)), aJ)
        I = inertia_of(b.inertia)
        put_motion(here.v, vi)
        put_motion(here.a, ai)
        put_force(here.f, add_force(momentum(I, ai), cross_force(vi, momentum(I, vi))))
        if b.geared:
            couple = rotor_couple(b, motion_of(parent.v).w, v[i - 1], a[i - 1])
            put_force(parent.f, add_couple(force_of(parent.f), couple))
    write_force(dh, _about_centre(bodies, work))


@inline
def _about_centre(bodies: Bodies, work: Work) -> Force:
    """The f of all bodies summed inward, in the world, the moment taken about the centre of mass."""
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        put_force(parent.f, add_force(force_of(parent.f), force_to_parent(pose_of(here.X), force_of(here.f))))
    return force_at_child(scale(1.0 / work[0].m, vec_of(work[0].h)), force_of(work[0].f))


@inline
def centroidal_map(bodies: Bodies, work: Work, q: Config, Ag: Matrix) -> None:
    """Column i: Ic S, its moment taken about the centre of mass; composite inertias Ic as in CRBA (RBDA table 6.2)."""
    n = len(bodies) - 1
    put_pose(work[0].X0, identity_pose())
    for i in range(n + 1):
        put_inertia(work[i].I, inertia_of(bodies[i].inertia))
        if i > 0:
            place_joint(bodies, i, q, work[i].X)
            put_pose(work[i].X0, compose(pose_of(work[bodies[i].parent].X0), pose_of(work[i].X)))
    for i in range(n, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_to_parent(pose_of(here.X), inertia_of(here.I))))
    c = _centre(work)
    for i in range(1, n + 1):
        F = force_to_parent(pose_of(work[i].X0), momentum(inertia_of(work[i].I), motion_of(bodies[i].S)))
        if bodies[i].geared:
            F = add_couple(F, rotate(pose_of(work[bodies[i].parent].X0).R, vec_of(bodies[i].rotor)))
        write_force(Ag[:, i - 1], force_at_child(c, F))


@inline
def centroidal_map_dot(bodies: Bodies, work: Work, q: Config, v: Vector, dAg: Matrix) -> None:
    """Column i: d/dt (Ic S) = İc S + Ic (v × S), about the centre of mass, which moves."""
    momentum_outward(bodies, work, q, v, None)
    _inward(bodies, work, v)
    total, rate = inertia_of(work[0].I), inertia_of(work[0].dI)
    c, dc = scale(1.0 / total.m, total.h), scale(1.0 / total.m, rate.h)
    for i in range(1, len(bodies)):
        Ji = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        I, dI = inertia_of(work[i].I), inertia_of(work[i].dI)
        F = momentum(I, Ji)
        dF = add_force(momentum(dI, Ji), momentum(I, cross_motion(motion_of(work[i].v), Ji)))
        if bodies[i].geared:
            _, de = rotor_in_root_axes(bodies, work, i)
            dF = add_couple(dF, de)
        about = force_at_child(c, dF)
        write_force(dAg[:, i - 1], Force(sub(about.n, cross(dc, F.f)), about.f))


_SOURCE = "after Orin, Goswami, Lee, Centroidal dynamics of a humanoid robot (2013)."
_ABOUT = "linear first, world axes, about the centre of mass"
SPECS = (
    Spec(
        "center_of_mass", center_of_mass, WORK_MOMENT, (TURNED_Q,),
        Argument("c", (3,), "m", "centre of mass of the moving bodies, in the world"),
        "Centre of mass of the moving bodies.", "the definition.",
    ),
    Spec(
        "center_of_mass_velocity", center_of_mass_velocity, WORK, (TURNED_Q, V),
        Argument("vc", (3,), "m/s", "velocity of the centre of mass, in the world"),
        "Velocity of the centre of mass.", "the definition.",
    ),
    Spec(
        "center_of_mass_velocity_derivatives", center_of_mass_velocity_derivatives, WORK, (TURNED_Q, V),
        Argument(
            "dvc", (2, 3, "nv"), "m/(s rad) | 1/s; m/rad | 1",
            "∂vc/∂q along integrate(q, e_k), and ∂vc/∂v = J, in the world",
        ),
        "Derivatives of the velocity of the centre of mass: ``dvc_dq, J = center_of_mass_velocity_derivatives(...)``.",
        "the definition.",
    ),
    Spec(
        "center_of_mass_acceleration", center_of_mass_acceleration, WORK, (TURNED_Q, V, A),
        Argument("ac", (3,), "m/s²", "acceleration of the centre of mass, in the world"),
        "Acceleration of the centre of mass, without gravity.", "the definition.",
    ),
    Spec(
        "com_jacobian", center_of_mass_jacobian, WORK, (TURNED_Q,),
        Argument("J", (3, "nv"), "m/rad | 1", "Jacobian of the centre of mass, in the world"),
        "Jacobian of the centre of mass: its velocity is J v.", _SOURCE,
    ),
    Spec(
        "centroidal_momentum", centroidal_momentum, WORK_TOTAL, (TURNED_Q, V),
        Argument("h", (6,), "kg m/s | kg m²/s", "momentum, " + _ABOUT),
        "Momentum of the robot about its centre of mass.", _SOURCE, regroup=True,
    ),
    Spec(
        "centroidal_momentum_rate", centroidal_momentum_rate, WORK_TOTAL, (TURNED_Q, V, A),
        Argument("dh", (6,), "N | N m", "rate of change of momentum, " + _ABOUT),
        "Rate of change of the centroidal momentum: the net force on the robot, its weight included.", _SOURCE,
        regroup=True,
    ),
    Spec(
        "centroidal_map", centroidal_map, WORK_COMPOSITE, (TURNED_Q,),
        Argument("Ag", (6, "nv"), "kg m | kg m² | kg", "momentum per joint velocity, " + _ABOUT),
        "Centroidal momentum matrix: the centroidal momentum is Ag v.", _SOURCE, regroup=True,
    ),
    Spec(
        "centroidal_map_dot", centroidal_map_dot, WORK, (TURNED_Q, V),
        Argument("dAg", (6, "nv"), "kg m/s | kg m²/s | kg/s", "time derivative of the map, " + _ABOUT),
        "Time derivative of the centroidal momentum matrix along v.", _SOURCE,
    ),
)  # fmt: skip
