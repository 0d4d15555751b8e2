"""Parameters of a table of bodies as inputs of a program: masses, loads and gravity that vary without a new program.

``withdraw`` removes from the rows the inertias that become inputs; ``put`` adds their values, which are floats or the
tracer's Numbers. Between the two calls the other inertias may be regrouped towards the root, because τ and M are linear
in an added inertia.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....algebra.euclidean import Mat3, Sym, Vec, add_sym, scale
from ....algebra.records import inertia_of, put_inertia, vec_of
from ....algebra.spatial import Inertia, Pose, add_inertia, inertia_to_parent
from .tracer import table

SHAPES: dict[str, tuple[str | int, ...]] = {
    "gravity": (3,),
    "armature": ("nv",),
    "mass": (),
    "com": (3,),
    "inertia": (6,),
    "payload": (10,),
}
UNITS = {
    "gravity": "m/s²",
    "armature": "kg m² | kg",
    "mass": "kg",
    "com": "m",
    "inertia": "kg m²: xx xy xz yy yz zz about the com",
    "payload": "kg, m, kg m²: mass, com x y z, xx xy xz yy yz zz about the com",
}
OF_BODY = ("mass", "com", "inertia")
NOTHING = Inertia(0.0, Vec(0.0, 0.0, 0.0), Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


class Parameter(NamedTuple):
    """One parameter that is an input.

    kind   a key of SHAPES
    row    row of the body with this mass, com, inertia or payload; 0 for gravity and armature
    frame  for a payload its pose in that body: R row by row, then p
    """

    kind: str
    row: int = 0
    frame: tuple[float, ...] = ()


def shape(parameter: Parameter, rows: int) -> tuple[int, ...]:
    """Shape of one sample of a parameter, for a table of ``rows`` rows, the world not counted."""
    return tuple(rows if isinstance(s, str) else s for s in SHAPES[parameter.kind])


def withdraw(rows: Any, parameters: Sequence[Parameter]) -> dict[int, dict[str, list[Any]]]:
    """Remove the inertias of bodies with a mass, com or inertia parameter, in place; returns them by row and kind."""
    taken: dict[int, dict[str, list[Any]]] = {}
    for p in parameters:
        if p.kind in OF_BODY and p.row not in taken:
            I = inertia_of(rows[p.row].inertia)
            c = scale(1.0 / I.m, I.h) if I.m else Vec(0.0, 0.0, 0.0)
            steiner = point(I.m, c)
            about = [a - b for a, b in zip(I.I, steiner.I, strict=True)]
            taken[p.row] = {"mass": [I.m], "com": list(c), "inertia": about}
            put_inertia(rows[p.row].inertia, NOTHING)
    return taken


def put(rows: Any, parameters: Sequence[Parameter], values: Sequence[Sequence[Any]], taken: Mapping[int, Any]) -> None:
    """Write flat values of the parameters into rows that ``withdraw`` changed; the inertia bounds grow with them."""
    bodies = {row: dict(own) for row, own in taken.items()}
    for p, given in zip(parameters, values, strict=True):
        if p.kind == "gravity":
            g = rows[0].gravity
            g.x, g.y, g.z = given
        elif p.kind == "armature":
            free = [row for row in rows[1:] if not row.leader]  # rows with freedoms of the model
            for row, value in zip(free, given, strict=True):
                row.armature = value
        elif p.kind == "payload":
            x = p.frame
            load = inertia_to_parent(Pose(Mat3(*x[:9]), Vec(*x[9:])), body(given[:1], given[1:4], given[4:]))
            _add(rows, p.row, load)
        else:
            bodies[p.row][p.kind] = given
    for row, own in bodies.items():
        _add(rows, row, body(own["mass"], own["com"], own["inertia"]))


def changed(bodies: NDArray[Any], parameters: Sequence[Parameter], values: Sequence[Sequence[float]]) -> NDArray[Any]:
    """A copy of the table with these values of the parameters."""
    rows = table(bodies)
    put(rows, parameters, values, withdraw(rows, parameters))
    made = bodies.copy()
    for record, row in zip(made, rows, strict=True):
        for name in ("gravity", "armature", "inertia", "inertia_bound"):
            _write(record, name, row)
    return made


def tables(
    bodies: NDArray[Any], parameters: Sequence[Parameter], values: Sequence[NDArray[np.float64]]
) -> NDArray[Any]:
    """Copies of the table (n, rows) with the values (n, ...) of the parameters of each sample, as of ``changed``."""
    rows, n = table(bodies), len(values[0])
    put(rows, parameters, [list(x.reshape(n, -1).T) for x in values], withdraw(rows, parameters))
    made = np.repeat(bodies[None], n, axis=0)
    for k, row in enumerate(rows):
        for name in ("gravity", "armature", "inertia", "inertia_bound"):
            _write(made[:, k], name, row)
    return made


def _write(record: Any, name: str, row: Any) -> None:
    value = getattr(row, name)
    if isinstance(value, (int, float, np.ndarray)):
        record[name] = value
        return
    for part in record.dtype[name].names:
        _write(record[name], part, value)


def point(m: Any, c: Vec) -> Inertia:
    """Inertia about the origin of a point mass at c."""
    h = scale(m, c)
    x, y, z = h.x * c.x, h.y * c.y, h.z * c.z
    return Inertia(m, h, Sym(y + z, -(h.x * c.y), -(h.x * c.z), x + z, -(h.y * c.z), x + y))


def body(mass: Sequence[Any], com: Sequence[Any], about: Sequence[Any]) -> Inertia:
    """Inertia about the origin of a body with mass (1), com (3) and rotational inertia about the com (6)."""
    I = point(mass[0], Vec(*com))
    return Inertia(I.m, I.h, add_sym(I.I, Sym(*about)))


def _add(rows: Any, at: int, I: Inertia) -> None:
    """Add an inertia to a body, and its share to the inertia bounds of the rows that move the body.

    Let s = p + t be the reach of a row (p at q = 0, t travelled). The share is at most tr I + 2 s |h| + s² m, and
    h² <= m tr I / 2, so 3/2 tr I + 4 p² m + 4 t² m is a bound on it.
    """
    put_inertia(rows[at].inertia, add_inertia(inertia_of(rows[at].inertia), I))
    trace = 1.5 * (I.I.xx + I.I.yy + I.I.zz)
    reach = 0.0
    while at > 0:
        row = rows[at]
        if any(vec_of(row.S.w)):
            pitch = math.hypot(*vec_of(row.S.v))
            row.inertia_bound.x = row.inertia_bound.x + (trace + (4.0 * reach * reach + pitch * pitch) * I.m)
            row.inertia_bound.z = row.inertia_bound.z + 4.0 * I.m
        else:
            row.inertia_bound.x = row.inertia_bound.x + I.m
        reach += math.hypot(*vec_of(row.X.p))
        at = row.parent


def text(parameters: Sequence[Parameter]) -> str:
    """The parameters as text, for digests."""
    return repr([tuple(p) for p in parameters])


def place(X: NDArray[np.float64]) -> tuple[float, ...]:
    """A pose (4, 4) as ``Parameter.frame``."""
    return (*X[:3, :3].ravel().tolist(), *X[:3, 3].tolist())
