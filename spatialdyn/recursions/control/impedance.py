"""Cartesian impedance: a spring and a damper along the axes of the world hold a frame.

fixed    τ = g(q) + Jᵀ (K e - D ẋ)
moving   τ = M a_r + C v_r + g + Jᵀ (K e + D (ẋ_d - ẋ)),  v_r = J̄ ẋ_d,  a_r = J̄ (a_d - J̇ v_r),  J̄ = M⁻¹Jᵀ (J M⁻¹Jᵀ)⁻¹

and in both a damping of joints, -b v, for motions that do not move the frame. e holds the remaining displacement and
rotation vector. Since J̄ᵀ (M a_r + C v_r + g) is Λ a_d + C_x ẋ_d + p, with dΛ/dt = C_x + C_xᵀ,
V = ½ (ẋ - ẋ_d)ᵀΛ(ẋ - ẋ_d) + ½ eᵀK e falls where J has full rank and no other force acts.

Source: Hogan, Impedance control (1985); Ott, Cartesian impedance control of redundant and flexible-joint robots (2008).
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec
from ...algebra.records import table_dtype
from ...algebra.scalars import inline
from ...algebra.spatial import Force, Inertia, Motion, Pose
from ..momenta.coriolis import modified_rnea
from ..signatures import Bodies, Config, Matrix, Vector, Work
from ..spec import LOCAL_WORLD_ALIGNED, ROW, TAU, Argument, Q, Spec, V, made_once
from ..tree.crba import crba
from ..tree.kinematics import frame_jacobian, frame_jacobian_dot, frame_placement
from ..tree.ltdl import factor_tree, solve_tree
from ..tree.rnea import rnea
from .inverse_kinematics import put_error, solve_definite

WORK = table_dtype(
    X=Pose,  # of rnea, as are the fields to f, then of frames
    w=Vec,
    dw=Vec,
    dv=Vec,
    f=Force,
    v=Motion,  # of frames
)
WORK_MOVING = table_dtype(
    X=Pose,  # of modified_rnea, as are the fields to f, then of frames and crba
    v=Motion,
    w=Motion,
    a=Motion,
    f=Force,
    dS=Motion,  # of frames
    Ic=Inertia,  # of crba
)


class Spring(NamedTuple):
    """Spring and dampers: K and D (6, 6), linear first, in the axes of the world, and b (nv)."""

    stiffness: Matrix
    damping: Matrix
    joint_damping: Vector


class Scratch(NamedTuple):
    """Scratch of both laws."""

    X: Matrix = (4, 4)
    J: Matrix = (6, "nv")
    e: Vector = (6,)
    rate: Vector = (6,)


class MovingScratch(NamedTuple):
    """Scratch of a moving frame."""

    M: Matrix = ("nv", "nv")
    dJ: Matrix = (6, "nv")
    B: Matrix = (6, "nv")
    G: Matrix = (6, 6)
    y: Vector = (6,)
    v_r: Vector = ("nv",)
    a_r: Vector = ("nv",)


@inline
def place(
    bodies: Bodies, work: Work, q: Config, v: Vector, row: int, placement: Matrix, target: Matrix, x: Scratch
) -> None:
    """The frame's Jacobian, its error e and its velocity."""
    frame_placement(bodies, work, q, row, placement, x.X)
    frame_jacobian(bodies, work, q, row, placement, LOCAL_WORLD_ALIGNED, x.J)
    put_error(x.X, target, 0, True, x.e)
    for r in range(6):
        x.rate[r] = 0.0
        for i in range(len(v)):
            x.rate[r] = x.rate[r] + x.J[r, i] * v[i]


@inline
def add_spring(v: Vector, spring: Spring, x: Scratch, tau: Vector) -> None:
    """τ += Jᵀ (K e - D ẋ) - b v, with ẋ in ``rate``."""
    n = len(v)
    for i in range(n):
        tau[i] = tau[i] - spring.joint_damping[i] * v[i]
    for r in range(6):
        F = 0.0
        for c in range(6):
            F = F + spring.stiffness[r, c] * x.e[c] - spring.damping[r, c] * x.rate[c]
        for i in range(n):
            tau[i] = tau[i] + x.J[r, i] * F


@inline
def impedance(
    bodies: Bodies, work: Work, q: Config, v: Vector, spring: Spring, placement: Matrix, target: Matrix, row: int,
    tau: Vector, x: Scratch,
) -> None:  # fmt: skip
    """The law of a frame that is held."""
    rnea(bodies, work, q, None, None, None, tau)
    place(bodies, work, q, v, row, placement, target, x)
    add_spring(v, spring, x, tau)


@inline
def moving_impedance(
    bodies: Bodies, work: Work, q: Config, v: Vector, spring: Spring, placement: Matrix, target: Matrix, v_x: Vector,
    a_x: Vector, row: int, tau: Vector, x: Scratch, own: MovingScratch,
) -> None:  # fmt: skip
    """The law of a frame that follows a motion."""
    n, M, B, y = len(v), own.M, own.B, own.y
    place(bodies, work, q, v, row, placement, target, x)
    frame_jacobian_dot(bodies, work, q, v, row, placement, LOCAL_WORLD_ALIGNED, own.dJ)
    crba(bodies, work, q, M)
    factor_tree(bodies, M)
    for r in range(6):
        for i in range(n):
            B[r, i] = x.J[r, i]
        solve_tree(bodies, M, B[r])
        y[r] = v_x[r]
    reach(x.J, B, own.G, y, own.v_r)
    for r in range(6):
        y[r] = a_x[r]
        for i in range(n):
            y[r] = y[r] - own.dJ[r, i] * own.v_r[i]
        x.rate[r] = x.rate[r] - v_x[r]
    reach(x.J, B, own.G, y, own.a_r)
    modified_rnea(bodies, work, q, v, own.v_r, own.a_r, tau)
    add_spring(v, spring, x, tau)


@inline
def reach(J: Matrix, B: Matrix, G: Matrix, y: Vector, out: Vector) -> None:
    """out = J̄ y with B = J M⁻¹; G and y are overwritten."""
    n = len(out)
    for r in range(6):
        for c in range(r + 1):
            G[r, c] = 0.0
            for i in range(n):
                G[r, c] = G[r, c] + J[r, i] * B[c, i]
    solve_definite(G, y)
    for i in range(n):
        out[i] = 0.0
        for r in range(6):
            out[i] = out[i] + B[r, i] * y[r]


SPRING = Spring(
    Argument("stiffness", (6, 6), "N/m | N m/rad", "of the frame, linear first, in the axes of the world"),
    Argument("damping", (6, 6), "N s/m | N m s/rad", "the same"),
    Argument("joint_damping", ("nv",), "N m s/rad | N s/m", "of each joint"),
)
PLACE = Argument("frame_in_body", (4, 4), "m", "pose of the frame in the body that carries it")
TARGET = Argument("target", (4, 4), "m", "pose to reach, in the world")


@made_once()
def impedance_spec(moving: bool) -> Spec:
    """The Spec of the law, of a frame that is held or that moves."""
    if not moving:
        return Spec(
            "impedance", impedance, WORK, (Q, V, SPRING, PLACE, TARGET, ROW), TAU, "Cartesian impedance.",
            "see impedance", scratch=(Scratch(),), composed=True,
        )  # fmt: skip
    return Spec(
        "moving_impedance", moving_impedance, WORK_MOVING,
        (
            Q, V, SPRING, PLACE, TARGET, Argument("v_x", (6,), "m/s | rad/s", "velocity to reach"),
            Argument("a_x", (6,), "m/s² | rad/s²", "acceleration to reach"), ROW,
        ),
        TAU, "Cartesian impedance of a moving frame.", "see impedance", scratch=(Scratch(), MovingScratch()),
        composed=True,
    )  # fmt: skip
