"""The kinds of joint, one record each: every other module reads the facts of a kind here.

The coordinates of every kind have one order: lengths first, then the rotation, as nothing, an angle, a (cos, sin) pair
or a quaternion x y z w. Its freedoms have the same order, and each is a row of the table of bodies.

A new kind is a code, a record in KINDS and a word in CODES; its S, constant in the body's frame, in
``model.joint_rows.subspace``; and its pose X_J(q) in ``joints.place_joint``, or ``joints._general`` if it has more than
one row. In the group R it then moves and is simulated. A new group needs a tuple of its codes below and a branch
wherever the groups are told apart: ``_move``, ``_between``, ``twist``, ``put_twist`` and ``_put_tangent`` of
``recursions.coordinates.configuration``, ``recursions.coordinates.coordinate_rates.coordinate_rate``, and three
functions of ``recursions.momenta.canonical_coordinates``. None refuses an unknown group: a forgotten branch shows in
wrong results only, so compare the kind with a chain of simpler joints in every call and integrator. Conversions refuse
it until ``interop.states``, ``interop.pinocchio`` and ``validate.peer`` have it. ``tests/bodies/test_kinds.py`` lists
groups and kinds; ``ModelBuilder.add_body`` and ``Joint`` name them.

Compiled code reads the tuples at the end: ``NQ[kind]``, ``kind in R1``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

CONTINUED = 0  # a further row of the joint above
REVOLUTE = 1  # q: angle about S
PRISMATIC = 2  # q: displacement along S
REVOLUTE_CS = 3  # q: cos, sin of the angle about S
SPHERICAL = 4  # q: quaternion x y z w
FLOATING = 5  # q: x y z, quaternion x y z w
PLANAR = 6  # q: x, y along S of its first two rows, angle about S of the third
PLANAR_CS = 7  # q: x, y, cos, sin of the angle
HELICAL = 8  # q: angle about S, which slides along it by S.v per radian

ANGLE, PAIR, QUATERNION = 1, 2, 4  # form of the rotation: its number of coordinates


class Kind(NamedTuple):
    """A kind of joint.

    code     in the table's column ``kind``
    group    Lie group of its configurations: "R", "SO(2)", "SE(2)", "SO(3)", "SE(3)"; "" for further rows
    lengths  number of its coordinates that are lengths, which are the first [m]
    turn     form of the rotation after them: 0 (none), ANGLE, PAIR or QUATERNION
    nv       freedoms, which are rows of the table
    motion   of one row: "turn" about its axis, "slide" along it, "screw" for both; "" for all others
    axis     whether the joint has an axis
    """

    code: int
    group: str
    lengths: int
    turn: int
    nv: int
    motion: str = ""
    axis: bool = False

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return self.lengths + self.turn

    @property
    def unit(self) -> slice | None:
        """Its coordinates of unit norm; None if there are none."""
        return slice(self.lengths, self.nq) if self.turn > ANGLE else None

    @property
    def undisplaced(self) -> tuple[float, ...]:
        """Its coordinates at zero displacement."""
        at = self.one
        return tuple(float(k == at) for k in range(self.nq))

    @property
    def one(self) -> int:
        """Index of the coordinate that is 1 there, a cosine or the w of a quaternion; -1 if all are 0."""
        return {PAIR: self.lengths, QUATERNION: self.lengths + 3}.get(self.turn, -1)

    @property
    def angle(self) -> int | None:
        """Index of the coordinate that is an angle; None if none is."""
        return self.lengths if self.turn == ANGLE else None


KINDS = (
    Kind(CONTINUED, "", 0, 0, 0),
    Kind(REVOLUTE, "R", 0, ANGLE, 1, "turn", axis=True),
    Kind(PRISMATIC, "R", 1, 0, 1, "slide", axis=True),
    Kind(REVOLUTE_CS, "SO(2)", 0, PAIR, 1, "turn", axis=True),
    Kind(SPHERICAL, "SO(3)", 0, QUATERNION, 3),
    Kind(FLOATING, "SE(3)", 3, QUATERNION, 6),
    Kind(PLANAR, "SE(2)", 2, ANGLE, 3, axis=True),
    Kind(PLANAR_CS, "SE(2)", 2, PAIR, 3, axis=True),
    Kind(HELICAL, "R", 0, ANGLE, 1, "screw", axis=True),
)

# the word of ModelBuilder, of URDF where it has one, and of Joint.kind: the code in the layouts "angle" and "cos_sin"
CODES = {
    "revolute": (REVOLUTE, REVOLUTE),
    "continuous": (REVOLUTE, REVOLUTE_CS),
    "prismatic": (PRISMATIC, PRISMATIC),
    "spherical": (SPHERICAL, SPHERICAL),
    "floating": (FLOATING, FLOATING),
    "planar": (PLANAR, PLANAR_CS),
    "helical": (HELICAL, HELICAL),
}


def kind_of(word: str, continuous: str = "angle") -> Kind:
    """The kind of a word of CODES in the layout "angle" or "cos_sin"."""
    return KINDS[CODES[word][continuous == "cos_sin"]]


def unit_part(kind: int, at: int) -> slice | None:
    """Slice of q of unit norm, of a joint of that kind with first coordinate q[at]; None if there is none."""
    unit = KINDS[kind].unit
    return None if unit is None else slice(at + unit.start, at + unit.stop)


def unit_parts(bodies: Any) -> list[tuple[int, ...]]:
    """Indices in q of each quaternion and each (cos, sin) pair of a table of bodies."""
    parts = [unit_part(int(row["kind"]), int(row["q_index"])) for row in bodies[1:]]
    return [tuple(range(part.start, part.stop)) for part in parts if part is not None]


# --- by code, for compiled code ---------------------------------------------------------------------------

NQ = tuple(kind.nq for kind in KINDS)  # coordinates
NV = tuple(kind.nv for kind in KINDS)  # freedoms
LENGTHS = tuple(kind.lengths for kind in KINDS)  # coordinates that are lengths, the first ones
UNITS = tuple(kind.turn if kind.turn > ANGLE else 0 for kind in KINDS)  # coordinates of unit norm, after the lengths
ONE = tuple(kind.one for kind in KINDS)  # index of the coordinate that is 1 at zero displacement, -1 for none

R1 = tuple(kind.code for kind in KINDS if kind.group == "R")
SO2 = tuple(kind.code for kind in KINDS if kind.group == "SO(2)")
SE2 = tuple(kind.code for kind in KINDS if kind.group == "SE(2)")
SO3 = tuple(kind.code for kind in KINDS if kind.group == "SO(3)")
SE3 = tuple(kind.code for kind in KINDS if kind.group == "SE(3)")

TURNS = tuple(kind.code for kind in KINDS if kind.motion == "turn")
SLIDES = tuple(kind.code for kind in KINDS if kind.motion == "slide")
SCREWS = tuple(kind.code for kind in KINDS if kind.motion == "screw")
