"""The table of frames, feet and tasks of a whole body's program, beside the table of bodies and that of contacts.

Row 0 is the header. The first ``nf`` rows after it are frames, the next ``ns`` equations of feet that stand, the last
``nt`` rows of tasks.

column     meaning
last_row   row 0 only: the number of rows that follow
nf, ns, nt row 0 only: numbers of frames, equations of feet, rows of tasks
total      row 0 only: how many numbers the program writes
row        of a frame, the row of the body that carries it
X          of a frame, its pose in that body
reference  of a frame, LOCAL, WORLD or LOCAL_WORLD_ALIGNED: the axes of its Jacobian
frame      of an equation or a task's row, the number of its frame, from 1; 0: a point of the contacts, of an equation,
           or the centre of mass, of a task's row
point      of an equation of a point, its number, from 0
axis       of an equation of a point, 0 along the normal, 1 and 2 across it; of a task's row, that of its frame, linear
           first
F          of an equation of a frame, the wrench that is paired with its velocity
"""

from __future__ import annotations

from ..algebra.records import table_dtype
from ..algebra.spatial import Force, Pose

TASKS = table_dtype(
    last_row=int,
    nf=int,
    ns=int,
    nt=int,
    total=int,
    row=int,
    X=Pose,
    reference=int,
    frame=int,
    point=int,
    axis=int,
    F=Force,
)
SIZES = ("nf", "ns", "nt", "total")
