"""The call of ``recursions.control.whole_body``: one table of feet and frames, one program, one call a state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.euclidean import Vec
from ..algebra.public_arrays import read_pose
from ..algebra.records import put_force, put_pose
from ..algebra.spatial import Force
from ..bodies.static_table import StaticTable
from ..bodies.task_table import SIZES, TASKS
from ..calls.arguments import frame_row_and_placement, reference_code
from ..constraints.calls import answer
from ..constraints.contact_points import Contacts
from ..model.model import Model
from ..recursions.control.whole_body import WHOLE_BODY, WHOLE_BODY_OVER
from .feet import Foot
from .tasks import Asked

Array = NDArray[np.float64]


class State(NamedTuple):
    """What the program gives at a state: views of one array.

    rows       (n + ns + 4 np, n + 3 np) of x = (a, f), see the recursion; low, high: bounds of x, then of the rows
    bias       (n,)
    J          (nt, n), drift (nt,), rate (nt,)  of all tasks
    X          (nf, 4, 4) poses of frames
    com        (3,)
    gap        (np,) of points, and tilt (np, 3, 3) of the ground there
    """

    rows: Array
    low: Array
    high: Array
    bias: Array
    J: Array
    drift: Array
    rate: Array
    X: Array
    com: Array
    gap: Array
    tilt: Array


class Terms:
    """The call for some contacts and tasks.

    places  for each task: its rows of J, the index of its frame's X (-1: the centre of mass), which rows are rotations;
            None for one that asked for nothing
    """

    def __init__(self, model: Model, contacts: Contacts, feet: Sequence[Foot], asked: Sequence[Asked | None]) -> None:
        """Of what tasks asked; the contacts may have no points."""
        frames: list[dict[str, Any]] = []
        equations: list[dict[str, Any]] = []
        rows: list[dict[str, Any]] = []
        self.places: list[tuple[slice, int, NDArray[np.bool_]] | None] = []
        for foot in feet:
            if len(foot.at) > 1:
                frames.append({"row": foot.row, "X": np.eye(4), "reference": reference_code("local")})
                equations += [{"frame": len(frames), "F": row} for row in foot.B.tolist()]
            else:
                equations += [{"point": foot.at[0], "axis": k} for k in range(3)]
        for task in asked:
            if task is None:
                self.places.append(None)
                continue
            at = 0
            if task.frame is not None:
                row, X = frame_row_and_placement(model, task.frame)
                frames.append({"row": row, "X": X, "reference": reference_code(task.reference)})
                at = len(frames)
            span = slice(len(rows), len(rows) + len(task.rows))
            self.places.append((span, at - 1, np.array(task.rows) >= 3))
            rows += [{"frame": at, "axis": k} for k in task.rows]
        n, points = model.nv, len(contacts)
        width, height = n + 3 * points, n + len(equations) + 4 * points
        shapes = (
            (height, width), (width + height,), (width + height,), (n,), (len(rows), n), (len(rows),), (len(rows),),
            (len(frames), 4, 4), (3,), (points,), (points, 3, 3),
        )  # fmt: skip
        ends = np.cumsum([int(np.prod(x)) for x in shapes]).tolist()
        self._parts = [(a, b, shape) for a, b, shape in zip([0, *ends[:-1]], ends, shapes, strict=True)]
        table = np.zeros(1 + len(frames) + len(equations) + len(rows), TASKS)
        head = table[0]
        head["last_row"], head["size"] = len(table) - 1, ends[-1]
        head["nf"], head["ns"], head["nt"] = len(frames), len(equations), len(rows)
        for record, values in zip(table[1:], [*frames, *equations, *rows], strict=True):
            for name, value in values.items():
                if name == "X":
                    put_pose(record.X, read_pose(value))
                elif name == "F":
                    put_force(record.F, Force(Vec(*value[3:]), Vec(*value[:3])))
                else:
                    record[name] = value
        self.model, self.equations = model, len(equations)
        self._plans: dict[Any, Any] = {}
        self._spec = WHOLE_BODY if contacts.ground is None else WHOLE_BODY_OVER
        self._static = (*contacts.tables, StaticTable(table, SIZES))

    def __call__(self, *inputs: Array) -> State:
        """The rows and terms; inputs in the order of the Spec's."""
        flat = answer(self._spec, self, self._static, inputs)
        return State(*[flat[a:b].reshape(shape) for a, b, shape in self._parts])

