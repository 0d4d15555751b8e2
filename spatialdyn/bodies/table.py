"""The table of bodies that every recursion walks.

One row per degree of freedom; row 0 is the world, and a parent's row comes before its children's. A revolute,
prismatic or helical joint is one row. A joint of more freedoms is as many rows: the first has the pose and the joint's
whole velocity, the others (kind CONTINUED) follow at the identity pose, and the body is on the last.
S is constant in the body's frame for every kind, so the joint's bias acceleration is v × vJ (RBDA eq. 3.33).

column         meaning
parent         row of the parent
joint          index of the joint whose body is on this row, 0 if there is none (the world; rows before the last)
kind           how q moves the row, a code of ``kinds`` (row 0: ANY_NORM if q need not be of unit norm, else 0)
dofs           rows of the joint, on its first row; 0 on the others (row 0: the number of joints, the world counted)
q_index        index of the joint's first coordinate in q (row 0: nq)
last_row       last row of the subtree: rows i .. last_row are those that row i moves
X              pose of the joint in the parent's body, at q = 0
axial          R u uᵀ with R of X and u the axis of a revolute or helical joint, which turns by Rodrigues' formula,
transverse     R (1 - u uᵀ)      R(q) = axial + cos q transverse + sin q skewed;
skewed         R ũ               the three are zero for other kinds
S              motion subspace of the row, in body coordinates
inertia        rigid inertia of the body about its frame's origin (zero where ``joint`` is 0)
armature       reflected rotor inertia added to M_ii
geared         whether a rotor turns with the row on the parent's body: 0 (none), ACROSS or ALONG its axis
rotor          n J e of that rotor in the parent's axes: turns per q̇, axial inertia and axis
coupled        whether motors behind a differential drive the row and its parent's together
coupling       inertia of those motors off the diagonal of M, between the two
partner        of that parent's row, the row behind it; 0 for none
spring         of a rotor that drives a joint through a spring, the joint's row; 0 for none
stiffness      of that spring, at the joint
spring_damping of that spring, at the joint
gear           1/n, turns of that joint per turn of the rotor
leader         of a joint that mimics another, that joint's row; 0 for none
ratio, offset  q of that joint is ratio times its leader's plus offset
inertia_bound  (a, b, c): a + 2 b t + c t² is at least SᵀI꜀S when translating joints have moved by t in all
gravity        acceleration of gravity (row 0 only)

Row i belongs to velocity v[i - 1]. Where joints mimic others, q and v are those of the whole tree; ``independent`` is
the table of the joints with coordinates of their own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.euclidean import Mat3, Vec
from ..algebra.records import table_dtype
from ..algebra.spatial import Inertia, Motion, Pose

BODIES = table_dtype(
    parent=int,
    joint=int,
    kind=int,
    dofs=int,
    q_index=int,
    last_row=int,
    X=Pose,
    axial=Mat3,
    transverse=Mat3,
    skewed=Mat3,
    S=Motion,
    inertia=Inertia,
    armature=float,
    geared=int,
    rotor=Vec,
    coupled=int,
    coupling=float,
    partner=int,
    spring=int,
    stiffness=float,
    spring_damping=float,
    gear=float,
    leader=int,
    ratio=float,
    offset=float,
    inertia_bound=Vec,
    gravity=Vec,
)

ACROSS, ALONG = 1, 2  # column geared: an axis e along that of a turning joint is fixed in its body too
ANY_NORM = 1  # row 0: quaternions and (cos, sin) pairs of any norm are accepted


def independent(bodies: NDArray[Any]) -> NDArray[Any]:
    """The rows of joints that mimic none, with the indices of their coordinates in the model's own q; the world's too.

    Recursions on the joints' group (``configuration``) run on them as on any table. Those that walk the tree do not:
    the rows are a chain. Without mimic joints it is the table itself.
    """
    follows = bodies["leader"] > 0
    if not follows.any():
        return bodies
    own = bodies[~follows]
    own["parent"], own["last_row"] = np.maximum(np.arange(len(own)) - 1, 0), len(own) - 1  # a chain
    own["q_index"] -= np.searchsorted(np.sort(bodies["q_index"][follows]), own["q_index"])
    return own


class JointTable(NamedTuple):
    """The ``independent`` rows, as kernels that walk no tree take them. Keep it as long as kernels read it."""

    bodies: NDArray[Any]
    address: int


def joint_table(bodies: NDArray[Any]) -> JointTable:
    """The JointTable of a table; without mimic joints it is the table itself."""
    own = independent(bodies)
    return JointTable(own, own.ctypes.data)
