"""The goals of tasks as arrays for a whole body's program, and the places of its answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..constraints.contact_points import Contacts
from ..errors import ShapeError
from ..model.model import Model
from .feet import Foot
from .tasks import Asked, PostureTask, Rows, Task, rows_of
from .terms import State, Terms

Array = NDArray[np.float64]


class Joints(NamedTuple):
    """The freedoms of a posture, as an index of arrays, and its rows without the desired accelerations."""

    at: Any
    rows: Rows


class Goals(NamedTuple):
    """The goals of some tasks.

    terms   the call; None until it is made
    inputs  goals, targets, goals of joints and rest, as the recursion takes them
    joints  for each task, its freedoms if the program has them
    others  indices of tasks that the program does not have: of other classes, and a second posture of a joint
    """

    tasks: Sequence[Any]
    terms: Terms
    inputs: tuple[Array, ...]
    joints: tuple[Joints | None, ...]
    others: tuple[int, ...]

    def rows(self, x: State, q: Array, v: Array) -> list[Rows]:
        """The equations of the tasks."""
        found = []
        J, drift, wanted, of_joints = x.J, x.drift, x.wanted, x.joints
        for task, place, joints in zip(self.tasks, self.terms.places, self.joints, strict=True):
            if place is not None:
                at = place.rows
                found.append(Rows(J[at], drift[at], wanted[at], place.turning))
            elif joints is not None:
                found.append(joints.rows._replace(wanted=of_joints[joints.at]))
            else:
                found.append(rows_of(task, self.terms.model, q, v))
        return found


def asked_of(tasks: Sequence[Any]) -> list[Asked | None]:
    """The rows of the program that each task has."""
    return [task._asked() if isinstance(task, Task) else None for task in tasks]


def goals_of(tasks: Sequence[Any], terms: Terms, known: dict[Any, Joints]) -> Goals:
    """The arrays of tasks. Raises ShapeError for a task with several targets.

    known  freedoms of postures by the joints that they name, written in place
    """
    model = terms.model
    rows, targets = np.zeros((4, terms.rows)), np.tile(np.eye(4), (terms.frames + 1, 1, 1))
    joints, rest, taken = np.zeros((4, model.nv)), np.asarray(calls["neutral"](model)), np.zeros(model.nv, bool)
    postures: list[Joints | None] = []
    others = []
    for k, (task, place) in enumerate(zip(tasks, terms.places, strict=True)):
        mine = None
        if place is not None:
            rows[:, place.rows] = goal_of(task)
            if task.target is not None:
                put_target(task, targets[place.frame], place.frame, place.axes)
        elif isinstance(task, PostureTask):
            mine = known.get(task.joints) or known.setdefault(task.joints, freedoms(task, model))
            if taken[mine.at].any():
                mine = None
        if mine is not None:
            taken[mine.at] = True
            joints[:, mine.at] = goal_of(task)
            if task.target is not None:
                put_rest(task, mine, model, rest)
        elif place is None:
            others.append(k)
        postures.append(mine)
    return Goals(tasks, terms, (rows, targets, joints, rest), tuple(postures), tuple(others))


def goal_of(task: Any) -> Array:
    """The goal of a task, (4, m) or (4, 1): weight, Kp, Kd and the feedforward a_d + Kd ẋ_d. Raises ShapeError."""
    for name in ("acceleration", "velocity", "Kp", "Kd"):
        x = getattr(task, name)
        if x is not None and x.ndim > 1:
            raise ShapeError(f'{name} of task "{task.name}" has shape {x.shape}, expected that of one state')
    feed = 0.0 if task.acceleration is None else task.acceleration
    if task.velocity is not None:
        feed = feed + task.Kd * task.velocity
    follows = 0.0 if task.target is None else task.Kp
    return np.stack([np.atleast_1d(x) for x in np.broadcast_arrays(task.weight, follows, task.Kd, feed)])


def put_target(task: Any, out: Array, frame: int, axes: tuple[int, ...]) -> None:
    """Write the target of a task to its pose in ``out``. Raises ShapeError."""
    target = np.asarray(task.target)
    if target.shape not in ((4, 4), (3,)):
        raise ShapeError(f'target of task "{task.name}" has shape {target.shape}, expected that of one state')
    if target.ndim == 2:
        out[...] = target
    elif frame:
        out[:3, 3] = target
    else:
        out[list(axes), 3] = target[list(axes)]  # another task may have the other axes of the centre of mass


def put_rest(task: Any, joints: Joints, model: Model, out: Array) -> None:
    """Write the target positions of the joints of a posture. Raises ShapeError."""
    target = np.asarray(task.target)
    if target.ndim != 1:
        raise ShapeError(f'target of task "{task.name}" has shape {target.shape}, expected that of one state')
    chosen = set(range(model.nv)[joints.at] if isinstance(joints.at, slice) else joints.at.tolist())
    for joint in model.joints[1:]:
        if joint.idx_v in chosen and joint.mimic is None:
            out[joint.idx_q : joint.idx_q + joint.nq] = target[joint.idx_q : joint.idx_q + joint.nq]


def freedoms(task: PostureTask, model: Model) -> Joints:
    """The freedoms of a posture."""
    at = task.at(model)
    rows = task._of_state(model, np.asarray(calls["neutral"](model)), np.zeros(model.nv))
    neighbours = at == list(range(at[0], at[-1] + 1))
    return Joints(slice(at[0], at[-1] + 1) if neighbours else np.array(at), rows)


def terms_of(
    model: Model, contacts: Contacts, feet: Sequence[Foot], tasks: Sequence[Any], known: dict[Any, Terms]
) -> Terms:
    """The call that computes the terms of these tasks.

    known  calls for other tasks, written in place
    """
    asked = asked_of(tasks)
    frames = [None if x is None or x.frame is None else model.frame(x.frame) for x in asked]
    key = tuple(
        None if x is None else (None if at is None else (at.kind, at.name), x.reference, x.rows)
        for x, at in zip(asked, frames, strict=True)
    )
    if key not in known:
        known[key] = Terms(model, contacts, feet, asked)
    return known[key]
