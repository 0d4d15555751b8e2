"""The table of constraints that recursions walk beside the table of bodies.

A constraint is one or more scalar equations φ(q) = 0, or J(q) v = 0 where there is no φ. A row of the table holds
``count`` equations from ``first`` on; row 0 is the header. A row about two frames, a and b, says how a sits in b, so
its equations are in b's axes and its force is the one on a; b is the world where none was named.

column    meaning
kind      what the row's equations are, a code below (row 0: 0)
first     index of the first equation (row 0: 0)
count     equations; 0 on a TERM that adds to the equation of the row before (row 0: 0)
positions 1 if there is a φ, 0 for equations of velocities alone (row 0: 0)
last_row  row 0 only: the number of rows that follow
nc        row 0 only: the number of equations
row_a     row of the body that carries frame a; a TERM's own row
row_b     row of the body that carries frame b, 0 for the world
Xa, Xb    pose of the frame in that body
D         of a POINT, its directions in b's axes, one a row; of an ALIGN, the two across the axis, then the axis; of a
          ROLLING, the wheel's axis in a (zero for a sphere), then the ground's normal
value     of a DISTANCE, the length; of a ROLLING, the radius; of a TERM, what is added to its equation's φ
factor    of a TERM, the coefficient of its velocity, and of its coordinate
q_index   of a TERM, its coordinate
"""

from __future__ import annotations

from ..algebra.euclidean import Mat3
from ..algebra.records import table_dtype
from ..algebra.spatial import Pose

CONSTRAINTS = table_dtype(
    kind=int,
    first=int,
    count=int,
    positions=int,
    last_row=int,
    nc=int,
    row_a=int,
    row_b=int,
    q_index=int,
    Xa=Pose,
    Xb=Pose,
    D=Mat3,
    value=float,
    factor=float,
)

POINT, ORIENT, ALIGN, DISTANCE, ROLLING, TERM = range(1, 7)
# POINT     the origin of a, less that of b, along D
# ORIENT    half of R - Rᵀ, R of a in b: the sine of the angle, times its axis
# ALIGN     the axis of a, across that of b
# DISTANCE  (|r|² - d²) / 2d of the origins' distance |r|
# ROLLING   the velocity of the body's point that touches the ground
# TERM      a coefficient times a joint's coordinate, or velocity
