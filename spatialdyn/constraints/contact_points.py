"""``Contacts``: points of a robot that may touch the ground, as the static table that recursions walk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.contact_table import CONTACTS
from ..bodies.kinds import R1
from ..bodies.static_table import StaticTable
from ..calls.arguments import as_array, as_count, as_number, check_model
from ..calls.failures import joint_of_velocity
from ..errors import ConstraintError, ModelError, literal
from ..model.model import Model
from ..model.motion_limits import position_limits
from .dilated_ground import dilated, heights_table
from .kinds import across
from .table import other_model

Array = NDArray[np.float64]
MOST = 100  # steps and rounds
SIZES = ("np", "nl", "nd")


@dataclass(frozen=True)
class Plane:
    """Flat ground: the points x with normal·x = height; bodies are on the side to which the normal points.

    normal  (3,) in the world, of any length but 0
    height  [m] along the normal, from the world's origin

    A body at rest on a plane whose normal is an axis of the world, such as z = 0, has a velocity of exactly 0, also
    with inclined gravity; on an inclined plane its velocity has rounding errors of some 1e-18 m/s.
    Raises  ConstraintError for a normal that is 0 or not finite, or a height that is not finite

    >>> import spatialdyn as sd
    >>> sd.Plane(normal=(0.0, 0.0, 2.0)).normal
    (0.0, 0.0, 1.0)
    """

    normal: ArrayLike = (0.0, 0.0, 1.0)
    height: float = 0.0

    def __post_init__(self) -> None:
        n = as_array("normal", self.normal)
        size = float(np.linalg.norm(n)) if n.shape == (3,) else math.nan
        if not 0.0 < size < math.inf:
            raise ConstraintError(f"Plane has normal {literal(self.normal)}, expected three numbers that are not all 0")
        if not math.isfinite(as_number(self.height)):
            raise ConstraintError(f"Plane has height {literal(self.height)}, expected a finite number of metres")
        object.__setattr__(self, "normal", tuple((n / size).tolist()))
        object.__setattr__(self, "height", float(self.height))


class Heightfield:
    """Ground given by heights on a grid: bilinear in between, level beyond the edge. Immutable, hashed by content.

    z        (nx, ny)  heights [m] at x = origin[0] + i spacing, y = origin[1] + j spacing; nx and ny at least 2
    spacing  [m]
    origin   (2,) [m]

    A sphere touches at the nearest point of the ground. Its centre therefore moves over another surface, the ground
    dilated by its radius, whose heights are computed on the same grid, with differences of neighbouring heights as
    slopes of the ground. Slopes jump where cells meet; a point exactly there has the slope of the cell at larger x and
    y, in steps and in their derivatives.

    Programs contain each height once for each radius, at most 2048: compiling them takes longer the more there are.
    Over more heights runs and ``contact_step`` are in plain Python, much slower whatever their number; a
    message of the logger names them.
    Raises  ConstraintError for heights that are not finite or not a grid, a spacing not above 0, an invalid origin

    >>> import numpy as np, spatialdyn as sd
    >>> sd.Heightfield(np.zeros((3, 4)), 0.5)
    <Heightfield of 3 x 4 heights, 0.5 m apart>
    """

    __slots__ = ("origin", "spacing", "table", "z")
    z: Array
    spacing: float
    origin: tuple[float, float]
    table: StaticTable

    def __init__(self, z: ArrayLike, spacing: float, origin: ArrayLike = (0.0, 0.0)) -> None:
        """See the class."""
        heights, at = as_array("z", z), as_array("origin", origin)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ConstraintError(f"Heightfield has z of shape {heights.shape}, expected (nx, ny) of 2 or more each")
        if not np.isfinite(heights).all():
            raise ConstraintError("Heightfield has heights that are not finite, expected finite numbers of metres")
        if not 0.0 < as_number(spacing) < math.inf:
            raise ConstraintError(f"Heightfield has spacing {literal(spacing)}, expected a finite number above 0")
        if at.shape != (2,) or not np.isfinite(at).all():
            raise ConstraintError(f"Heightfield has origin {literal(origin)}, expected two finite numbers")
        kept, place = heights.copy(), (float(at[0]), float(at[1]))
        kept.flags.writeable = False
        given = (kept, float(spacing), place, heights_table([kept], float(spacing), place))
        for name, value in zip(("z", "spacing", "origin", "table"), given, strict=True):
            object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a Heightfield is immutable, {name} cannot be set")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Heightfield) and self.table == other.table

    def __hash__(self) -> int:
        return hash(self.table)

    def __reduce__(self) -> tuple[Any, ...]:
        return Heightfield, (self.z, self.spacing, self.origin)

    def __repr__(self) -> str:
        nx, ny = self.z.shape
        return f"<Heightfield of {nx} x {ny} heights, {self.spacing:g} m apart>"


class Contacts:
    """Points of a robot that may touch the ground, with friction: immutable, hashed by content.

    Bodies have no shapes here, so there is no collision detection: each point is the centre of a sphere at a frame that
    the caller names (a foot, a corner, a wheel's rim), and touches the ground only, no other body.

    model        Model
    points       {frame: radius of its sphere [m]}, 0 for the frame's origin itself
    friction     Coulomb's coefficient μ: a number, or {frame: number} for all points
    restitution  from 0 to 1, in the same form, by Poisson's law: a point that hits receives, in addition to the impulse
                 that brings it to rest, this share of that impulse, and so do points that this pushes down; a single
                 point without friction leaves at this share of its speed. No hit adds energy, and a hit with 1 and
                 without friction loses none. Below 0.01 m/s a point comes to rest if forces press it down by a tenth of
                 its speed in the step: steps do not resolve such short bounces, whose energy is lost also with 1.
                 Shorter steps resolve more of them, from 1e-5 m/s
    terrain      ``Plane``, by default z = 0, or ``Heightfield``
    tolerance    largest violation of their laws by points and joints in a step [m/s | rad/s]. A box that just sticks on
                 an incline creeps a thousand times slower at 1e-8 than at 1e-6. In float32 rounding allows 1e-4 at best
    steps        limit of Newton steps in a round, if sweeps over the points do not reach the tolerance
    rounds       limit of rounds, each of sweeps and Newton steps; a step that is not solved then has a larger residual

    names, radii              of the points (np)
    friction, restitution     (np,), as arrays
    table                     the StaticTable of recursions
    ground                    the StaticTable of heights, for each radius; None on a plane

    Raises
        ModelError for a name that is not in the robot, with similar names
        ConstraintError naming the point for a frame that does not move, a radius or friction below 0, a restitution
            outside 0 to 1; for another terrain, a tolerance that is not a positive number, and steps or rounds outside
            1 to 100

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> tip = sd.Contacts(model, {"tip": 0.02}, friction=0.6)
    >>> tip.names, tip.friction
    (('tip',), array([0.6]))
    """

    __slots__ = (
        "_plans", "friction", "ground", "limits", "model", "names", "radii", "restitution", "rounds", "steps", "table",
        "terrain", "tolerance",
    )  # fmt: skip
    model: Model
    names: tuple[str, ...]
    radii: tuple[float, ...]
    friction: Array
    restitution: Array
    terrain: Plane | Heightfield
    tolerance: float
    steps: int
    rounds: int
    limits: bool
    table: StaticTable
    ground: StaticTable | None
    _plans: dict[Any, Any]  # builtins of single calls: no part of the content

    def __init__(
        self,
        model: Model,
        points: Mapping[str, float],
        friction: float | Mapping[str, float] = 0.8,
        restitution: float | Mapping[str, float] = 0.0,
        terrain: Plane | Heightfield | None = None,
        tolerance: float = 1e-6,
        steps: int = 12,
        rounds: int = 8,
        **others: Any,
    ) -> None:
        """See the class."""
        if "sweeps" in others:
            raise ConstraintError(
                f"sweeps is {literal(others['sweeps'])}, expected a tolerance [m/s] in its place: steps are "
                "solved to that"
            )
        if others:
            raise TypeError(f"Contacts() got an unexpected keyword argument {literal(min(others))}")
        self._make(model, points, friction, restitution, terrain, tolerance, steps, rounds, False)

    def _make(
        self, model: Model, points: Any, friction: Any, restitution: Any, terrain: Any, tolerance: Any, steps: Any,
        rounds: Any, limits: bool,
    ) -> None:  # fmt: skip
        check_model(model)
        if not isinstance(points, Mapping):
            raise ConstraintError(f"points are {literal(points)}, expected {{frame: radius}}")
        ground = Plane() if terrain is None else terrain
        if not isinstance(ground, (Plane, Heightfield)):
            raise ConstraintError(f"terrain is {literal(terrain)}, expected a Plane or a Heightfield")
        if not 0.0 < as_number(tolerance) < math.inf:
            raise ConstraintError(f"tolerance is {literal(tolerance)}, expected a positive number [m/s | rad/s]")
        for what, most in (("steps", steps), ("rounds", rounds)):
            if not as_count(most, MOST):
                raise ConstraintError(f"{what} is {literal(most)}, expected a whole number of 1 to {MOST}")
        names = tuple(points)
        rows = [_point(model, name, points[name]) for name in names]
        held = {
            "model": model, "names": names, "radii": tuple(float(points[x]) for x in names),
            "friction": _of_points("friction", friction, names, math.inf),
            "restitution": _of_points("restitution", restitution, names, 1.0), "terrain": ground,
            "tolerance": float(tolerance), "steps": int(steps), "rounds": int(rounds), "limits": limits,
        }  # fmt: skip
        stops = _stops(model) if held["limits"] else []
        table = np.zeros(1 + len(rows) + len(stops), CONTACTS)
        head = table[0]
        head["last_row"], head["np"], head["nl"] = len(table) - 1, len(rows), len(stops)
        head["tolerance"], head["steps"], head["rounds"] = held["tolerance"], held["steps"], held["rounds"]
        flat = ground if isinstance(ground, Plane) else Plane()
        n = np.array(flat.normal)
        for letter, axis in zip("xyz", (n, *across(n)), strict=True):
            for column, value in zip("xyz", axis, strict=True):
                head["axes"][letter + column] = value
        head["height"] = flat.height
        levels = None
        for record, row in zip(table[1:], [*rows, *stops], strict=True):
            for column, value in row.items():
                record[column] = value
        if isinstance(ground, Heightfield):
            sizes = sorted({row["radius"] for row in rows})
            layers = [dilated(ground.z, ground.spacing, r) for r in sizes] or [ground.z]
            levels = heights_table(layers, ground.spacing, ground.origin)
            table["heights"][1 : 1 + len(rows)] = [1 + sizes.index(row["radius"]) * ground.z.size for row in rows]
        for name, value in {**held, "ground": levels, "table": StaticTable(table, SIZES), "_plans": {}}.items():
            object.__setattr__(self, name, value)

    def with_limits(self) -> Contacts:
        """These contacts with the position limits of joints of one coordinate, which do not bounce."""
        return _limited(*self._given())

    def with_dry(self, dry: NDArray[np.bool_]) -> StaticTable:
        """The table with a row added for each freedom that is True in ``dry`` (nv,) and has no row yet."""
        if not isinstance(dry, np.ndarray) or dry.dtype != bool or dry.shape != (self.model.nv,):
            raise ConstraintError(f"dry is {literal(dry)}, expected an array of {self.model.nv} of True and False")
        rows = self.table.rows
        more = np.setdiff1d(np.flatnonzero(dry) + 1, rows["row"][1 + len(self) :])
        if not len(more):
            return self.table
        table = np.zeros(len(rows) + len(more), CONTACTS)
        table[: len(rows)] = rows
        table[0]["last_row"], table[0]["nd"] = len(table) - 1, len(more)
        table["row"][len(rows) :], table["q_index"][len(rows) :] = more, -1
        return StaticTable(table, SIZES)

    @property
    def tables(self) -> tuple[StaticTable, ...]:
        """The StaticTables that recursions take: of contacts, and of heights if there are any."""
        return (self.table,) if self.ground is None else (self.table, self.ground)

    @property
    def stops(self) -> tuple[str, ...]:
        """Names of the joints that stop at their limits (nl)."""
        rows = self.table.rows[1 + len(self.names) :]
        return tuple(joint_of_velocity(self.model, row - 1).name for row in rows["row"])

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the points and joints in messages, (np + nl)."""
        return tuple([f'point "{x}"' for x in self.names] + [f'limits of joint "{x}"' for x in self.stops])

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"Contacts are immutable, {name} cannot be set")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"Contacts are immutable, {name} cannot be deleted")

    def __len__(self) -> int:
        return len(self.names)

    def _content(self) -> tuple[Any, ...]:
        return self.names, self.tables, self.friction.tobytes(), self.restitution.tobytes()

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, Contacts) and self.model == other.model and self._content() == other._content()
        )

    def __hash__(self) -> int:
        return hash((self.model, self._content()))

    def __reduce__(self) -> tuple[Any, ...]:
        return (_limited if self.limits else Contacts), self._given()

    def _given(self) -> tuple[Any, ...]:
        """Arguments of an equal Contacts, without limits."""
        radii, friction, restitution = (
            dict(zip(self.names, x, strict=True)) for x in (self.radii, self.friction, self.restitution)
        )
        return self.model, radii, friction, restitution, self.terrain, self.tolerance, self.steps, self.rounds

    def __repr__(self) -> str:
        stops = ", joint limits" if self.limits else ""
        return f"<Contacts of {self.model.name}: {len(self)} points, {', '.join(self.names)}{stops}>"


def _limited(*given: Any) -> Contacts:
    """Contacts with the position limits of joints."""
    made = Contacts.__new__(Contacts)
    made._make(*given, True)  # type: ignore[call-arg]
    return made


def check_contacts(model: Model, contacts: Any) -> Contacts:
    """The contacts, if they are of this model. Raises ConstraintError, ModelError."""
    if not isinstance(contacts, Contacts):
        raise ConstraintError(f"contacts are a {type(contacts).__name__}, expected Contacts(model, {{frame: radius}})")
    if contacts.model is not model and contacts.model != check_model(model):
        raise ModelError(f"contacts are of {other_model(contacts.model, model)}")
    return contacts


def _point(model: Model, name: Any, radius: Any) -> dict[str, Any]:
    """Columns of a point's row."""
    frame = model.frame(name)
    row = model.joints[frame.joint].row
    if row == 0:
        raise ConstraintError(f'point "{name}" does not move, expected a frame on a moving body')
    size = as_number(radius)
    if not 0.0 <= size < math.inf:
        raise ConstraintError(f'point "{name}" has radius {literal(radius)}, expected a finite number of 0 or more')
    return {"row": row, "p": tuple(frame.placement[:3, 3].tolist()), "radius": size}


def _of_points(what: str, given: Any, names: tuple[str, ...], most: float) -> Array:
    """A coefficient of each point (np,), from 0 to ``most``, read-only."""
    if isinstance(given, Mapping):
        if {*given} != {*names}:
            off = sorted({*given} ^ {*names}, key=str)[0]
            raise ConstraintError(
                f'{what} has points {", ".join(map(str, given))}, expected those of points; "{off}" is off'
            )
        values = [given[x] for x in names]
    else:
        values = [given] * max(1, len(names))
    for k, value in enumerate(values):
        if not 0.0 <= as_number(value) <= most or math.isinf(as_number(value)):
            of = f' of point "{names[k]}"' if isinstance(given, Mapping) else ""
            expected = "a finite number of 0 or more" if math.isinf(most) else f"0 to {most:g}"
            raise ConstraintError(f"{what}{of} is {literal(value)}, expected {expected}")
    made = np.array([float(x) for x in values[: len(names)]]) + 0.0
    made.flags.writeable = False
    return made


def _stops(model: Model) -> list[dict[str, Any]]:
    """Columns of the row of each joint of one coordinate that has a limit, or is led to one by a joint that mimics it.

    Raises ModelError as ``position_limits``.
    """
    least, most = position_limits(model)
    made = []
    for joint in model.joints[1:]:
        lower, upper = float(least[joint.idx_q]), float(most[joint.idx_q])
        own_row = joint.mimic is None and int(model.bodies[joint.row]["kind"]) in R1
        if own_row and np.isfinite([lower, upper]).any():
            made.append({"row": joint.idx_v + 1, "q_index": joint.idx_q, "lower": lower, "upper": upper})
    return made
