"""The table of bodies that every recursion walks, and the kinds of joint it knows.

One row per degree of freedom; row 0 is the world, and a parent stands above its children. A revolute or
prismatic joint is one row. A joint of more freedoms is as many rows: the first carries the pose and the
joint's whole velocity, the others (kind FOLLOW) sit on it with the identity, and the body hangs on the last.
S is constant in the body's frame for every kind, so the joint's bias acceleration is v × vJ (RBDA eq. 3.33).

column      meaning
parent      row of the parent
joint       index of the joint whose body hangs on this row, 0 where none does (the world; rows before the last)
kind        how q moves the row: the constants below (row 0: ANY_NORM where q need not be of unit norm, else 0)
dofs        rows of the joint, on its first row; 0 on the others (row 0: the number of joints, the world counted)
at          place of the joint's first coordinate in q (row 0: nq)
last        last row of the subtree: rows i .. last are those that row i moves
X           pose of the joint in the parent's body, at q = 0
along       R u uᵀ with R of X and u the axis of a revolute joint, whose rotation is by Rodrigues' formula
across      R (1 - u uᵀ)      R(q) = along + cos q across + sin q turned,
turned      R ũ               three products made once; zero for other kinds
S           motion subspace of the row, in body coordinates
inertia     rigid inertia of the body about its frame's origin (zero where ``joint`` is 0)
armature    reflected rotor inertia added to M_ii
bound       (a, b, c): a + 2 b t + c t² is no less than SᵀI꜀S once the translating joints have moved by t in all
gravity     acceleration of gravity (row 0 only)

Row i belongs to velocity v[i - 1].
"""

from __future__ import annotations

from ..algebra.euclidean import Rot, Vec
from ..algebra.records import table_dtype
from ..algebra.spatial import Inertia, Motion, Pose

BODIES = table_dtype(
    parent=int,
    joint=int,
    kind=int,
    dofs=int,
    at=int,
    last=int,
    X=Pose,
    along=Rot,
    across=Rot,
    turned=Rot,
    S=Motion,
    inertia=Inertia,
    armature=float,
    bound=Vec,
    gravity=Vec,
)

FOLLOW = 0  # a further row of the joint above
REVOLUTE = 1  # q: angle about S
PRISMATIC = 2  # q: displacement along S
REVOLUTE_CS = 3  # q: cos, sin of the angle about S
SPHERICAL = 4  # q: quaternion x y z w
FLOATING = 5  # q: x y z, quaternion x y z w
PLANAR = 6  # q: x, y along S of its first two rows, angle about S of the third
PLANAR_CS = 7  # q: x, y, cos, sin of the angle
ANY_NORM = 1  # row 0: quaternions and (cos, sin) pairs are taken as they are
NQ = (0, 1, 1, 2, 4, 7, 3, 4)  # coordinates of each kind
NV = (0, 1, 1, 1, 3, 6, 3, 3)  # freedoms of each kind
