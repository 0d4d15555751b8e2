"""Centre of mass of each subtree, its velocity and its acceleration.

The subtree of the world is the robot. The centre of mass of a subtree without mass is at its joint's origin, at rest.
"""

from __future__ import annotations

from ..algebra.euclidean import Vec, scale, unrotate
from ..algebra.public_arrays import write_vec
from ..algebra.records import force_of, inertia_of, motion_of, pose_of, put_force, table_dtype, vec_of
from ..algebra.scalars import Scalar, inline, select
from ..algebra.spatial import Force, Inertia, Motion, Pose, add_force, cross_force, momentum, zero_force
from .momenta.centroidal import momentum_outward
from .momenta.energy import WORK_MOMENT, mass_moment
from .signatures import Bodies, Config, Matrix, Vector, Work
from .spec import TURNED_Q, A, Argument, Spec, V

WORK = table_dtype(
    X=Pose,  # of centroidal.momentum_outward, as are the fields to dI
    v=Motion,
    a=Motion,
    I=Inertia,  # its mass: of the subtree, inward
    dI=Inertia,
    h=Force,  # momentum or force in the world, outward; of the subtree, inward
)


@inline
def _per(m: Scalar, a: Vec) -> Vec:
    """a / m; zero if m is 0, because a is then 0 too."""
    return scale(1.0 / select(m, m, 1.0), a)


@inline
def subtree_centers_of_mass(bodies: Bodies, work: Work, q: Config, c: Matrix) -> None:
    """c = Σ m c / Σ m of each subtree, from the first moments summed inward."""
    mass_moment(bodies, work, q)
    write_vec(c[0], _per(work[0].m, vec_of(work[0].h)))
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0:
            write_vec(c[bodies[i].joint], _per(work[i].m, vec_of(work[i].h)))


@inline
def _summed(bodies: Bodies, work: Work, out: Matrix) -> None:
    """Sum h and the mass inward; write h.f over the mass of each subtree, in its joint's axes."""
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        h = force_of(here.h)
        parent.I.m = parent.I.m + here.I.m
        put_force(parent.h, add_force(force_of(parent.h), h))
        if bodies[i].joint > 0:
            write_vec(out[bodies[i].joint], unrotate(pose_of(here.X).R, _per(here.I.m, h.f)))
    write_vec(out[0], _per(work[0].I.m, vec_of(work[0].h.f)))


@inline
def subtree_com_velocities(bodies: Bodies, work: Work, q: Config, v: Vector, out: Matrix) -> None:
    """Linear momentum over mass."""
    momentum_outward(bodies, work, q, v, None)
    put_force(work[0].h, zero_force())
    for i in range(1, len(bodies)):
        put_force(work[i].h, momentum(inertia_of(work[i].I), motion_of(work[i].v)))
    _summed(bodies, work, out)


@inline
def subtree_com_accelerations(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, out: Matrix) -> None:
    """Net force over mass: Σ (I a + v ×* I v)."""
    momentum_outward(bodies, work, q, v, a)
    put_force(work[0].h, zero_force())
    for i in range(1, len(bodies)):
        I, vi = inertia_of(work[i].I), motion_of(work[i].v)
        put_force(work[i].h, add_force(momentum(I, motion_of(work[i].a)), cross_force(vi, momentum(I, vi))))
    _summed(bodies, work, out)


_SOURCE = "the definition."
_WHERE = "of each joint's subtree, in the axes of its body's frame; row 0: of the robot, in the world's"
SPECS = (
    Spec(
        "subtree_centers_of_mass", subtree_centers_of_mass, WORK_MOMENT, (TURNED_Q,),
        Argument("c", ("njoints", 3), "m", "of each joint's subtree, in its body's frame; row 0: in the world"),
        "Centres of mass of all subtrees.", _SOURCE,
    ),
    Spec(
        "subtree_com_velocities", subtree_com_velocities, WORK, (TURNED_Q, V),
        Argument("vc", ("njoints", 3), "m/s", _WHERE),
        "Velocities of the centres of mass of all subtrees.", _SOURCE,
    ),
    Spec(
        "subtree_com_accelerations", subtree_com_accelerations, WORK, (TURNED_Q, V, A),
        Argument("ac", ("njoints", 3), "m/s²", _WHERE),
        "Accelerations of the centres of mass of all subtrees, without gravity.", _SOURCE,
    ),
)  # fmt: skip
