"""Types of the arguments of a recursion, for readers of its signature; for a type checker all are Any.

One source runs on NumPy's arrays, under Numba and on rows and arrays of objects, which have no common type. An input
that the Spec leaves out is None.
"""

from __future__ import annotations

from typing import Any, TypeAlias

Bodies: TypeAlias = Any  # the table of bodies (``bodies.table``), row 0 the world
Work: TypeAlias = Any  # the recursion's scratch table, a row for each of the bodies'; WORK describes its fields
Record: TypeAlias = Any  # a row of either table, or a field of one
Config: TypeAlias = Any  # (nq)
Vector: TypeAlias = Any  # (nv) unless the docstring says otherwise
Matrix: TypeAlias = Any  # (nv, nv) unless the docstring or the Spec says otherwise; fext (njoints, 6), placement (4, 4)
Number: TypeAlias = Any  # one number
Array: TypeAlias = Any  # of the shape that the Spec gives
