"""The table of contacts that recursions walk beside the table of bodies: points that may touch, joints that may stop.

Row 0 is the header. The first ``np`` rows after it are points, the centres of spheres fixed to bodies (a radius of 0
is the point itself); the ``nl`` rows after those are joints of one coordinate with limits, and the last ``nd`` rows
freedoms with dry friction and no limits. In the order of impulses a point has three numbers (along the normal, then
across it) and a joint one.

column     meaning
last_row   row 0 only: the number of rows that follow
np, nl     row 0 only: numbers of points and of joints with limits
nd         row 0 only: the number of freedoms with dry friction and no limits
tolerance  row 0 only: residual of a solved step
steps      row 0 only: most of Newton's steps in a round
rounds     row 0 only: most rounds of sweeps and steps
axes       row 0 only, of a plane: its normal, then two directions across it, one a row
height     row 0 only, of a plane: how far along the normal it lies from the world's origin
row        row of the body that carries the point; the joint's own row
p          of a point, its centre in that body
radius     of a point, that of its sphere
heights    of a point over heights, the row of the first of them: those of its radius
q_index    of a joint, its coordinate
lower      of a joint, its limits; infinite where there is none
upper
"""

from __future__ import annotations

from ..algebra.euclidean import Mat3, Vec
from ..algebra.records import table_dtype

CONTACTS = table_dtype(
    last_row=int,
    np=int,
    nl=int,
    nd=int,
    tolerance=float,
    steps=int,
    rounds=int,
    axes=Mat3,
    height=float,
    row=int,
    p=Vec,
    radius=float,
    heights=int,
    q_index=int,
    lower=float,
    upper=float,
)

# The table of heights of a ground that is no plane: row 0 the header, then one row for each height, those of one x
# after another; where spheres touch it, for each of their radii the heights of a centre that touches.
#   last_row  row 0 only: the number of rows that follow
#   nx, ny    row 0 only: heights along x and along y
#   x, y      row 0 only: place of the first
#   spacing   row 0 only: between neighbours
#   z         height
HEIGHTS = table_dtype(last_row=int, nx=int, ny=int, x=float, y=float, spacing=float, z=float)
