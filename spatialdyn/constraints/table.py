"""``Constraints``: some constraints on one robot, as the static table that recursions walk."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.constraint_table import ALIGN, CONSTRAINTS, DISTANCE, ORIENT, POINT, ROLLING, TERM
from ..bodies.kinds import R1
from ..bodies.static_table import StaticTable
from ..calls.arguments import check_model
from ..errors import ConstraintError, ModelError, SpatialDynError, literal
from ..model.model import Model
from . import kinds
from .kinds import (
    AXES,
    Constraint,
    CouplerConstraint,
    DistanceConstraint,
    HingeConstraint,
    PointConstraint,
    RollingConstraint,
    VelocityConstraint,
    WeldConstraint,
    across,
    placed,
)

Array = NDArray[np.float64]


class Equation(NamedTuple):
    """A scalar equation: its constraint, and which part of that constraint it is."""

    constraint: Constraint
    part: str

    @property
    def label(self) -> str:
        """The name of the equation in messages."""
        return f"{self.constraint.label}{self.part and ' '}{self.part}"


class Constraints:
    """Constraints on a robot: immutable, hashed by its content, checked against the robot's names when it is made.

    model  Model; a joint that mimics another is held where it follows to
    items  ``PointConstraint``, ``WeldConstraint``, ``HingeConstraint``, ``DistanceConstraint``, ``CouplerConstraint``,
           ``RollingConstraint`` and ``VelocityConstraint``

    equations  the scalar equations, each an Equation (constraint, part), in the order of forces and rows of J
    nc         their number; ``len`` is the number of constraints
    table      the StaticTable of recursions

    Raises
        ModelError for a name that is not in the robot, with similar names
        ConstraintError for two frames on one body, a coupled joint whose position is not one number, rows of another
            length, and an item that is not a constraint

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="xz", at_b=(0.5, 0.0, -0.5))])
    >>> held.nc, [x.part for x in held.equations]
    (2, ['x', 'z'])
    """

    __slots__ = ("_plans", "equations", "items", "model", "nc", "table")
    model: Model
    items: tuple[Constraint, ...]
    equations: tuple[Equation, ...]
    nc: int
    table: StaticTable
    _plans: dict[Any, Any]  # builtins of single calls: no part of the content

    def __init__(self, model: Model, items: Iterable[Constraint]) -> None:
        """See the class."""
        check_model(model)
        try:
            given = tuple(items)
        except TypeError:
            raise ConstraintError(f"constraints are {literal(items)}, expected a list of them") from None
        rows: list[dict[str, Any]] = []
        equations: list[Equation] = []
        for x in given:
            if not isinstance(x, kinds.KINDS):
                known = ", ".join(kind.__name__ for kind in kinds.KINDS)
                raise ConstraintError(f"constraints have a {type(x).__name__}, expected one of {known}")
            for row, parts in _rows(model, x):
                first = len(equations) - (row["kind"] == TERM and not parts)
                rows.append({"first": first, "count": len(parts), **row})
                equations += [Equation(x, part) for part in parts]
        table = np.zeros(len(rows) + 1, CONSTRAINTS)
        table[0]["last_row"], table[0]["nc"] = len(rows), len(equations)
        for record, row in zip(table[1:], rows, strict=True):
            for name in ("Xa", "Xb"):
                _put_pose(record[name], row.pop(name, np.eye(4)))
            _put_matrix(record["D"], row.pop("D", np.zeros((3, 3))))
            for name, value in row.items():
                record[name] = value
        values: tuple[Any, ...] = model, given, tuple(equations), len(equations), StaticTable(table, ("nc",)), {}
        for name, value in zip(("model", "items", "equations", "nc", "table", "_plans"), values, strict=True):
            object.__setattr__(self, name, value)

    @classmethod
    def of_toml(cls, model: Model, text: str) -> Constraints:
        """The constraints of a TOML text, such as a file beside a URDF, which cannot describe loops.

        Each is an entry ``[[constraint]]`` with its kind (point, weld, hinge, distance, coupler, rolling or velocity)
        and the arguments of that kind by name.

        Raises  ConstraintError naming the entry and its key for any other text; SpatialDynError before Python 3.11,
                which cannot read TOML; otherwise as the class

        >>> import spatialdyn as sd
        >>> text = '[[constraint]]\\nkind = "coupler"\\njoint = "joint2"\\nto = "joint1"\\nratio = -2'
        >>> sd.Constraints.of_toml(sd.load_urdf("two_link"), text).items[0].ratio
        -2.0
        """
        try:
            import tomllib
        except ImportError:
            raise SpatialDynError("constraints in TOML need Python 3.11, expected Constraints(model, [...])") from None
        if not isinstance(text, str):
            raise ConstraintError(f"TOML is a {type(text).__name__}, expected its text")
        try:
            given = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # integers of thousands of digits, deeply nested brackets
            raise ConstraintError(
                f"constraints are no TOML: {error}, expected a text and no {literal(text):.60}"
            ) from None
        entries = given.pop("constraint", [])
        if given or not isinstance(entries, list) or not all(isinstance(x, dict) for x in entries):
            found = ", ".join(given) or "one [constraint]"
            raise ConstraintError(f"constraints in TOML have {found}, expected entries [[constraint]] alone")
        return cls.of_entries(model, entries)

    @classmethod
    def of_entries(cls, model: Model, entries: Any) -> Constraints:
        """The constraints of parsed entries ``[[constraint]]``, as dicts; keys and errors are those of ``of_toml``.

        >>> import spatialdyn as sd
        >>> entry = {"kind": "point", "frame_a": "tip", "axes": "x"}
        >>> held = sd.Constraints.of_entries(sd.load_urdf("two_link"), [entry])
        >>> held.nc
        1
        """
        if not isinstance(entries, list) or not all(isinstance(x, dict) for x in entries):
            raise ConstraintError(f"entries are {literal(entries)}, expected a list of dicts, [[constraint]] in TOML")
        return cls(model, [_of_entry(k, x) for k, x in enumerate(entries)])

    @classmethod
    def of_mjcf(cls, model: Model, text: str, q: ArrayLike | None = None) -> Constraints:
        """The active equalities of an MJCF text, ``<mujoco>`` or its ``<equality>``, on a robot with the same names.

        text  with ``connect``, ``weld`` and ``joint``; a body, or a site, is the frame of that name
        q     (nq,)  the configuration in which loops are closed, if the text relies on MuJoCo's qpos0; the neutral
              configuration if left out [rad | m]

        Constraints are rigid: ``solref``, ``solimp`` and ``torquescale``, which make them soft, are ignored.
        Raises  ConstraintError naming element and line for other equalities, such as tendons, a nonlinear ``polycoef``,
                a joint held at a number, and any other text; otherwise as the class

        >>> import spatialdyn as sd
        >>> text = '<equality><joint joint1="joint2" joint2="joint1" polycoef="0.1 -2"/></equality>'
        >>> sd.Constraints.of_mjcf(sd.load_urdf("two_link"), text).items[0].ratio
        -2.0
        """
        from .mjcf import constraints_of_mjcf

        return cls(model, constraints_of_mjcf(check_model(model), text, q))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"Constraints are immutable, {name} cannot be set")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"Constraints are immutable, {name} cannot be deleted")

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Constraint]:
        return iter(self.items)

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, Constraints) and self.model == other.model and self.items == other.items
        )

    def __hash__(self) -> int:
        return hash((self.model, self.table))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.model, self.items)

    def __repr__(self) -> str:
        listed = ", ".join(x.label for x in self.items)
        return f"<Constraints of {self.model.name}: {self.nc} equations, {listed}>"


def _of_entry(k: int, entry: dict[str, Any]) -> Constraint:
    """The constraint of an entry of a TOML text."""
    known = {kind.__name__.removesuffix("Constraint").lower(): kind for kind in kinds.KINDS}
    what, arguments = f"constraint {k} of the TOML text", dict(entry)
    kind = known.get(str(arguments.pop("kind", None)))
    if kind is None:
        raise ConstraintError(f"{what} has kind {literal(entry.get('kind'))}, expected one of {', '.join(known)}")
    names = [x.name for x in fields(kind)]
    unknown = sorted({*arguments} - {*names})
    if unknown:
        raise ConstraintError(f"{what} has {unknown[0]}, expected some of {', '.join(names)}")
    lacks = [x.name for x in fields(kind) if x.default is MISSING and x.name not in arguments]
    if lacks:
        raise ConstraintError(f"{what} lacks {lacks[0]}, expected {', '.join(names)}")
    made: Constraint = kind(**arguments)
    return made


def check_constraints(model: Model, constraints: Any) -> Constraints:
    """The constraints, if they are of this model. Raises ConstraintError, ModelError."""
    if not isinstance(constraints, Constraints):
        raise ConstraintError(f"constraints are a {type(constraints).__name__}, expected Constraints(model, [...])")
    if constraints.model is not model and constraints.model != check_model(model):
        raise ModelError(f"constraints are of {other_model(constraints.model, model)}")
    return constraints


def other_model(other: Model, model: Model) -> str:
    """The message that another model was expected; both may have the same name."""
    same = "another" if other.name == model.name else "the"
    return f'{same} model "{other.name}", expected those made of the model "{model.name}" that is given'


# --- rows of the table -----------------------------------------------------------------------------------


def _rows(model: Model, x: Constraint) -> list[tuple[dict[str, Any], list[str]]]:
    """(columns, parts) of each row of a constraint; a row without parts is a TERM of the previous equation."""
    if isinstance(x, CouplerConstraint):
        joint = {"factor": 1.0, "value": -x.offset, **_coordinate(model, x, x.joint)}
        if x.joint == x.to:
            raise ConstraintError(f"{x.label} couples a joint to itself, expected another")
        return [
            ({**joint, "positions": 1}, [""]),
            ({"factor": -x.ratio, **_coordinate(model, x, x.to), "positions": 1}, []),
        ]
    if isinstance(x, VelocityConstraint):
        found, own = [], np.flatnonzero(model.bodies["leader"][1:] == 0)  # rows of the whole tree
        for k, row in enumerate(np.array(x.A)):
            if len(row) != model.nv:
                raise ConstraintError(
                    f"{x.label} has rows of {len(row)}, expected {model.nv}, the velocities of the robot"
                )
            terms = [{"kind": TERM, "row_a": int(own[i]) + 1, "factor": row[i]} for i in np.flatnonzero(row)]
            found += [(term, [str(k)] if n == 0 else []) for n, term in enumerate(terms)]
        return found
    if isinstance(x, RollingConstraint):
        row_a, Xa = _place(model, x, x.frame, None)
        axis = np.zeros(3) if x.axis is None else np.array(x.axis)
        D = np.array([axis, x.normal, np.zeros(3)])
        if row_a == 0:
            raise ConstraintError(f'{x.label}: frame "{x.frame}" does not move, expected one on a moving body')
        return [({"kind": ROLLING, "row_a": row_a, "Xa": Xa, "D": D, "value": x.radius}, list(AXES))]
    assert isinstance(x, (PointConstraint, WeldConstraint, HingeConstraint, DistanceConstraint))
    row_a, Xa = _place(model, x, x.frame_a, x.at_a)
    row_b, Xb = (0, placed(x.at_b)) if x.frame_b is None else _place(model, x, x.frame_b, x.at_b)
    if row_a == row_b:
        other = "the world" if x.frame_b is None else f'frame "{x.frame_b}"'
        raise ConstraintError(f'{x.label}: frame "{x.frame_a}" does not move from {other}, expected two bodies')
    pair = {"row_a": row_a, "row_b": row_b, "Xa": Xa, "Xb": Xb, "positions": 1}
    if isinstance(x, DistanceConstraint):
        return [({"kind": DISTANCE, "value": x.length, **pair}, [""])]
    axes = x.axes if isinstance(x, PointConstraint) else AXES
    D = np.zeros((3, 3))
    for k, letter in enumerate(axes):
        D[k, AXES.index(letter)] = 1.0
    point = ({"kind": POINT, "D": D, **pair}, list(axes))
    if isinstance(x, PointConstraint):
        return [point]
    if isinstance(x, WeldConstraint):
        return [point, ({"kind": ORIENT, **pair}, [f"turn about {letter}" for letter in AXES])]
    D = np.array([*across(np.array(x.axis)), x.axis])
    return [point, ({"kind": ALIGN, "D": D, **pair}, ["first tilt", "second tilt"])]


def _place(model: Model, x: Constraint, frame: str, at: Any) -> tuple[int, Array]:
    """Row of the body of a frame, and the pose of the constraint's frame in it."""
    found = model.frame(frame)
    return model.joints[found.joint].row, found.placement @ placed(at)


def _coordinate(model: Model, x: Constraint, name: str) -> dict[str, Any]:
    """Row and coordinate of a joint by name."""
    joint = next((j for j in model.joints[1:] if j.name == name), None)
    if joint is None:
        model.frame(f"joint:{name}")  # raises ModelError with similar names
        raise ModelError(f'joint "{name}" of {x.label} is fixed, expected one that moves')
    if int(model.bodies[joint.row]["kind"]) not in R1:
        raise ConstraintError(
            f'{x.label} couples joint "{name}" ({joint.kind}), expected a position that is one number'
        )
    return {"kind": TERM, "row_a": joint.row, "q_index": model.bodies[joint.row]["q_index"]}


def _put_matrix(record: Any, A: Array) -> None:
    for name, row in zip(AXES, A, strict=True):
        for column, value in zip(AXES, row, strict=True):
            record[name + column] = value


def _put_pose(record: Any, X: Array) -> None:
    _put_matrix(record["R"], X[:3, :3])
    for name, value in zip(AXES, X[:3, 3], strict=True):
        record["p"][name] = value
