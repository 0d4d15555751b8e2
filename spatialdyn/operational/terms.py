"""The call of ``recursions.control.whole_body``: one table of feet and frames, one program, one call per state."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.euclidean import Vec
from ..algebra.public_arrays import read_pose
from ..algebra.records import put_force, put_pose
from ..algebra.spatial import Force
from ..bodies.static_table import StaticTable
from ..bodies.task_table import SIZES, TASKS
from ..calls.arguments import core_shape, frame_row_and_placement, reference_code
from ..calls.one_sample import of_model
from ..constraints.contact_points import Contacts
from ..model.model import Model
from ..recursions.control.whole_body import PARTS, WHOLE_BODY, WHOLE_BODY_OVER
from .feet import Foot
from .tasks import Asked

Array = NDArray[np.float64]


class State:
    """The results of the program at a state, parts of one array by name; see ``recursions.control.whole_body``."""

    __slots__ = ("_flat", "_parts")

    def __init__(self, flat: Array, parts: dict[str, tuple[int, int, tuple[int, ...]]]) -> None:
        """From the array and the places of its parts."""
        self._flat, self._parts = flat, parts

    def __getattr__(self, name: str) -> Array:
        begin, end, shape = self._parts[name]
        return self._flat[begin:end].reshape(shape)


class Place(NamedTuple):
    """The place of a task's rows among the rows of all tasks.

    rows     rows of J, J̇ v and a*
    frame    its frame's number, 0 for the centre of mass
    axes     axes of the frame
    turning  which rows are rotations
    """

    rows: slice
    frame: int
    axes: tuple[int, ...]
    turning: NDArray[np.bool_]


class Terms:
    """The call for some contacts and tasks.

    places  for each task the place of its rows; None for a task without rows in the program
    """

    def __init__(self, model: Model, contacts: Contacts, feet: Sequence[Foot], asked: Sequence[Asked | None]) -> None:
        """``asked`` has the rows of each task; the contacts may have no points."""
        frames: list[dict[str, Any]] = []
        equations: list[dict[str, Any]] = []
        rows: list[dict[str, Any]] = []
        self.places: list[Place | None] = []
        for task in asked:
            at = 0
            if task is not None and task.frame is not None:
                row, X = frame_row_and_placement(model, task.frame)
                frames.append({"row": row, "X": X, "reference": reference_code(task.reference)})
                at = len(frames)
            axes = () if task is None else task.rows
            span = slice(len(rows), len(rows) + len(axes))
            self.places.append(None if task is None else Place(span, at, axes, np.array(axes) >= 3))
            rows += [{"frame": at, "axis": k} for k in axes]
        for foot in feet:
            if len(foot.at) > 1:
                frames.append({"row": foot.row, "X": np.eye(4), "reference": reference_code("local")})
                equations += [{"frame": len(frames), "F": row} for row in foot.B.tolist()]
            else:
                equations += [{"point": foot.at[0], "axis": k} for k in range(3)]
        table = np.zeros(1 + len(frames) + len(equations) + len(rows), TASKS)
        head = table[0]
        head["last_row"], head["nf"], head["ns"], head["nt"] = len(table) - 1, len(frames), len(equations), len(rows)
        for record, values in zip(table[1:], [*frames, *equations, *rows], strict=True):
            for name, value in values.items():
                if name == "X":
                    put_pose(record.X, read_pose(value))
                elif name == "F":
                    put_force(record.F, Force(Vec(*value[3:]), Vec(*value[:3])))
                else:
                    record[name] = value
        tables = (*contacts.tables, StaticTable(table, SIZES))
        self._parts, end = {}, 0
        for name, part in PARTS._asdict().items():
            shape = core_shape(model, part, tables)
            self._parts[name] = end, end + math.prod(shape), shape
            end += math.prod(shape)
        head["total"] = end
        self.model, self.rows, self.frames = model, len(rows), len(frames)
        self.spec = WHOLE_BODY if contacts.ground is None else WHOLE_BODY_OVER
        self._static = (*contacts.tables, StaticTable(table, SIZES))

    def __call__(self, *inputs: Array) -> State:
        """The program and terms; inputs are in the order of the Spec."""
        return State(self._answer(*inputs), self._parts)

    @cached_property
    def _answer(self) -> Callable[..., Array]:
        varying = [x for x in self.spec.present if not x.static]
        return of_model(self.spec, self.model, self._static, (True,) * len(varying))

    def __getstate__(self) -> dict[str, Any]:
        """The state without the call, which another process makes itself."""
        return {name: x for name, x in self.__dict__.items() if name != "_answer"}
