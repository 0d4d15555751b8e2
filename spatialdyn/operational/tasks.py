"""Tasks: linear equations J a + J̇ v = a* in joint accelerations, for a frame, the centre of mass or joints.

a* follows a target by a* = a_d + Kd (ẋ_d - ẋ) + Kp e, with e the displacement to the target. ``task_torque`` and
``WholeBody`` take any object with ``name``, ``weight``, ``priority``, ``check(model)`` and ``rows(model, q, v)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import (
    as_array,
    as_finite,
    as_items,
    as_number,
    as_word,
    broadcast,
    check_model,
    frame_row_and_placement,
    pose_fault,
)
from ..calls.dynamics import calls
from ..errors import ModelError, NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..model.robot_checks import quoted
from .spectral import ALL_AXES, axes_of
from .turning import turning

Array = NDArray[np.float64]
REFERENCES = ("local", "world", "local_world_aligned")


class Asked(NamedTuple):
    """The rows of a task's J and J̇ v: those of a frame in a reference, or of the centre of mass for frame None."""

    frame: str | Frame | None
    reference: str
    rows: tuple[int, ...]


class Rows(NamedTuple):
    """The equations of a task: J (..., m, nv), drift J̇ v (..., m) and the desired acceleration (..., m).

    turning  (m,)  which rows are rotations
    """

    J: Array
    drift: Array
    wanted: Array
    turning: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Task:
    """The base class of tasks: ``FrameTask``, ``ComTask``, ``PostureTask``."""

    def rows(self, model: Model, q: ArrayLike, v: ArrayLike) -> Rows:
        """The equations at a state q (..., nq), v (..., nv). Raises as ``check``, and NonFiniteError."""
        self.check(model)
        at, speed = as_finite("q", q), as_finite("v", v)
        for name, x, size in (("q", at, model.nq), ("v", speed, model.nv)):
            if x.shape[-1:] != (size,):
                raise ShapeError(f"{name} has shape {x.shape}, expected (..., {size})")
        given = {"q": at.shape[:-1], "v": speed.shape[:-1]}
        for name in ("target", "acceleration", "velocity"):
            x = getattr(self, name)
            if x is not None:
                given[name] = x.shape[: x.ndim - (2 if x.shape[-2:] == (4, 4) else 1)]
        broadcast([*given], [*given.values()])
        return self._of_state(model, at, speed)

    def _of_state(self, model: Model, q: Array, v: Array) -> Rows:
        """As ``rows``, for checked arrays."""
        raise NotImplementedError

    def _asked(self) -> Asked | None:
        """The rows of J and J̇ v that a program computes for this task. Returns None if not applicable."""
        return None

    def check(self, model: Model) -> None:
        """Raise ModelError or ShapeError if the task does not fit this model."""
        check_model(model)

    def with_(self, **changes: Any) -> Any:
        """The task with some of its fields changed, for example the target from step to step."""
        known = [x.name for x in fields(self)]
        for name in changes:
            if name not in known:
                raise SpatialDynError(f"{type(self).__name__} has no {name}, expected some of {', '.join(known)}")
        return replace(self, **changes)


def _numbers(task: Any, *names: str) -> None:
    """Replace fields, if given, by arrays of finite numbers."""
    for name in names:
        value = getattr(task, name)
        if value is not None:
            x = as_array(name, value)
            if not np.isfinite(x).all():
                raise NonFiniteError(f"{name} is {x.tolist()}, expected finite numbers")
            object.__setattr__(task, name, x)


def _gains(task: Any, follows: bool, moves: bool) -> None:
    """Set Kp and Kd, 0 or above; by default 100 1/s² if there is a target, and Kd critically damped."""
    _numbers(task, "Kp", "Kd")
    for name in ("Kp", "Kd"):
        if getattr(task, name) is not None and (getattr(task, name) < 0.0).any():
            raise SpatialDynError(f"{name} is {getattr(task, name).tolist()}, expected 0 or more")
    if task.Kp is None:
        object.__setattr__(task, "Kp", np.float64(100.0 if follows else 0.0))
    if task.Kd is None:
        object.__setattr__(task, "Kd", 2.0 * np.sqrt(task.Kp) if follows else np.float64(20.0 if moves else 0.0))


def _common(task: Any, name: str) -> None:
    if task.name is None:
        object.__setattr__(task, "name", name)
    if not isinstance(task.name, str) or not task.name:
        raise SpatialDynError(f"name is {literal(task.name)}, expected a word")
    weight = as_number(task.weight)
    if not 0.0 < weight < math.inf:
        raise SpatialDynError(f"weight is {literal(task.weight)}, expected a finite number above 0")
    object.__setattr__(task, "weight", weight)
    if isinstance(task.priority, bool) or not isinstance(task.priority, (int, np.integer)) or task.priority < 0:
        raise SpatialDynError(f"priority is {literal(task.priority)}, expected an integer of 0 or more")


def _fits(task: Any, shapes: dict[str, int]) -> None:
    """Raise ShapeError unless the last axes of these fields have these sizes; gains may be numbers."""
    for name, size in shapes.items():
        x = getattr(task, name)
        if x is not None and x.shape[-1:] != (size,) and not (name in ("Kp", "Kd") and x.ndim == 0):
            raise ShapeError(f'{name} of task "{task.name}" has shape {x.shape}, expected (..., {size})')


@dataclass(frozen=True, eq=False)
class FrameTask(Task):
    """A frame follows a pose, or has an acceleration.

    frame         a link's or joint's name
    target        (..., 4, 4) pose in the world, or (..., 3) a point for axes "xyz" alone [m]; without one no stiffness
    acceleration  (..., m)  feedforward a_d along the axes; zero if left out
    velocity      (..., m)  ẋ_d; zero if left out
    Kp, Kd        gains, 0 or more, numbers or (m,) [1/s², 1/s]; 100 and critically damped with a target
    reference     local_world_aligned, local or world: frame of the axes; a target needs one of the first two
    axes          letters of xyz, and for rotations after an r: "xyz rxyz", "xyz", "z rxy"
    weight        weight of the squared error in ``WholeBody``
    priority      order in ``WholeBody``, 0 first

    Raises  SpatialDynError, ShapeError, NonFiniteError

    >>> import spatialdyn as sd
    >>> sd.FrameTask("tool0", target=[0.4, 0.1, 0.5], axes="xyz").name
    'tool0'
    """

    frame: str | Frame
    target: ArrayLike | None = None
    acceleration: ArrayLike | None = None
    velocity: ArrayLike | None = None
    Kp: ArrayLike | None = None
    Kd: ArrayLike | None = None
    reference: str = "local_world_aligned"
    axes: str = ALL_AXES
    weight: float = 1.0
    priority: int = 0
    name: str | None = None

    def __post_init__(self) -> None:
        """Check the fields."""
        named = self.frame.name if isinstance(self.frame, Frame) else self.frame
        _common(self, named if isinstance(named, str) else literal(named))
        rows = axes_of(self.axes)
        as_word("reference", self.reference, REFERENCES)
        _numbers(self, "target", "acceleration", "velocity")
        _gains(self, self.target is not None, self.velocity is not None)
        m = len(rows)
        _fits(self, {"acceleration": m, "velocity": m, "Kp": m, "Kd": m})
        if self.target is None:
            return
        x = np.asarray(self.target)
        pose = x.shape[-2:] == (4, 4)
        if not pose and (x.shape[-1:] != (3,) or max(rows) >= 3):
            wanted = "(..., 4, 4)" if max(rows) >= 3 else "(..., 4, 4) or (..., 3)"
            raise ShapeError(f'target of task "{self.name}" has shape {x.shape}, expected {wanted}')
        if self.reference == "world":
            raise SpatialDynError(f'task "{self.name}" has a target and reference "world", expected an acceleration')
        if pose and (fault := pose_fault(x)):
            raise SpatialDynError(f'target of task "{self.name}" has {fault}')

    def check(self, model: Model) -> None:
        """Raise ModelError if the frame is unknown, or fixed to the world."""
        frame = check_model(model).frame(self.frame)
        if frame_row_and_placement(model, frame)[0] == 0:
            raise ModelError(f'frame "{frame.name}" of task "{self.name}" does not move, expected one of a body')

    def _of_state(self, model: Model, q: Array, v: Array) -> Rows:
        """See ``Task``."""
        rows = axes_of(self.axes)
        J = np.asarray(calls["frame_jacobian"](model, q, self.frame, self.reference))[..., rows, :]
        drift = np.asarray(calls["jacobian_dot_times_v"](model, q, v, self.frame, self.reference))[..., rows]
        wanted = feedback(self, (J @ v[..., None])[..., 0], self._error(model, q, rows))
        return Rows(J, drift, wanted, np.array(rows) >= 3)

    def _asked(self) -> Asked:
        """See ``Task``."""
        return Asked(self.frame, self.reference, tuple(axes_of(self.axes)))

    def _error(self, model: Model, q: Array, rows: list[int]) -> Array | None:
        """The displacement to the target, along the axes."""
        if self.target is None:
            return None
        target, X = np.asarray(self.target), np.asarray(calls["frame_placement"](model, q, self.frame))
        R, whole = X[..., :3, :3], target.shape[-2:] == (4, 4)
        far = (target[..., :3, 3] if whole else target) - X[..., :3, 3]
        turn = turning(target[..., :3, :3] @ np.swapaxes(R, -1, -2)) if whole else 0.0 * far
        if self.reference == "local":
            back = np.swapaxes(R, -1, -2)
            far, turn = (back @ far[..., None])[..., 0], (back @ turn[..., None])[..., 0]
        found: Array = np.concatenate(np.broadcast_arrays(far, turn), -1)[..., rows]
        return found


@dataclass(frozen=True, eq=False)
class ComTask(Task):
    """The centre of mass follows a point, or has an acceleration; the other fields are those of ``FrameTask``.

    target  (..., 3)  in the world [m]

    >>> import spatialdyn as sd
    >>> sd.ComTask([0.0, 0.0, 0.9], axes="xy", Kp=30.0).Kd.round(2).item()
    10.95
    """

    target: ArrayLike | None = None
    acceleration: ArrayLike | None = None
    velocity: ArrayLike | None = None
    Kp: ArrayLike | None = None
    Kd: ArrayLike | None = None
    axes: str = "xyz"
    weight: float = 1.0
    priority: int = 0
    name: str | None = None

    def __post_init__(self) -> None:
        """Check the fields."""
        _common(self, "centre of mass")
        rows = axes_of(self.axes)
        if max(rows) >= 3:
            raise SpatialDynError(f"axes is {literal(self.axes)}, expected letters of xyz: a point does not turn")
        _numbers(self, "target", "acceleration", "velocity")
        _gains(self, self.target is not None, self.velocity is not None)
        m = len(rows)
        _fits(self, {"target": 3, "acceleration": m, "velocity": m, "Kp": m, "Kd": m})

    def _of_state(self, model: Model, q: Array, v: Array) -> Rows:
        """See ``Task``."""
        rows = axes_of(self.axes)
        J = np.asarray(calls["com_jacobian"](model, q))[..., rows, :]
        drift = np.asarray(calls["center_of_mass_acceleration"](model, q, v, 0.0 * v))[..., rows]
        e = None
        if self.target is not None:
            e = (np.asarray(self.target) - np.asarray(calls["center_of_mass"](model, q)))[..., rows]
        return Rows(J, drift, feedback(self, (J @ v[..., None])[..., 0], e), np.zeros(len(rows), bool))

    def _asked(self) -> Asked:
        """See ``Task``."""
        return Asked(None, "world", tuple(axes_of(self.axes)))


@dataclass(frozen=True, eq=False)
class PostureTask(Task):
    """Joints follow positions, or have accelerations; the other fields are those of ``FrameTask``.

    target  (..., nq)  a configuration, of which only the named joints count
    joints  names of joints with coordinates of their own; all but a floating base if left out

    >>> import spatialdyn as sd
    >>> sd.PostureTask([0.5, -0.3], Kp=25.0, joints=["joint2"]).name
    'posture'
    """

    target: ArrayLike | None = None
    acceleration: ArrayLike | None = None
    velocity: ArrayLike | None = None
    Kp: ArrayLike | None = None
    Kd: ArrayLike | None = None
    joints: Sequence[str] | None = None
    weight: float = 1.0
    priority: int = 0
    name: str | None = None

    def __post_init__(self) -> None:
        """Check the fields."""
        _common(self, "posture")
        if self.joints is not None:
            given = as_items("joints", self.joints, str, "names of joints")
            if not given or len(set(given)) < len(given):
                raise SpatialDynError(f"joints is {literal(self.joints)}, expected names, each once")
            object.__setattr__(self, "joints", tuple(given))
        _numbers(self, "target", "acceleration", "velocity")
        _gains(self, self.target is not None, self.velocity is not None)

    def at(self, model: Model) -> list[int]:
        """The freedoms of the joints, by index in v. Raises ModelError."""
        check_model(model)
        if self.joints is None:
            named = [
                joint
                for joint in model.joints[1:]
                if joint.mimic is None and not (joint.kind == "floating" and joint.parent == 0)
            ]
        else:
            named = [model.joint(name) for name in self.joints]
            followers = [joint.name for joint in named if joint.mimic is not None]
            if followers:
                raise ModelError(
                    f'joints {quoted(followers)} of task "{self.name}" mimic others, expected those that they mimic'
                )
        found = [k for joint in named for k in range(joint.idx_v, joint.idx_v + joint.nv)]
        if not found:
            raise ModelError(f'task "{self.name}" has no joints of robot "{model.name}", expected one or more')
        return found

    def check(self, model: Model) -> None:
        """Raise ModelError for unknown joints, ShapeError for a target of another size."""
        m = len(self.at(model))
        _fits(self, {"target": model.nq, "acceleration": m, "velocity": m, "Kp": m, "Kd": m})

    def _of_state(self, model: Model, q: Array, v: Array) -> Rows:
        """See ``Task``."""
        at = self.at(model)
        J = np.eye(model.nv)[at]
        e = None if self.target is None else np.asarray(calls["difference"](model, q, self.target))[..., at]
        own = [joint for joint in model.joints[1:] if joint.mimic is None]
        kinds = {k: joint for joint in own for k in range(joint.idx_v, joint.idx_v + joint.nv)}
        turning = np.array([kinds[k].kind != "prismatic" for k in at])
        return Rows(J, 0.0 * v[..., at], feedback(self, v[..., at], e), turning)


def rows_of(task: Any, model: Model, q: Array, v: Array) -> Rows:
    """The equations of a task, or of an object with its methods, for checked arguments.

    Raises ShapeError, NonFiniteError for the rows of such an object
    """
    if isinstance(task, Task):
        return task._of_state(model, q, v)
    found = task.rows(model, q, v)
    J, drift, wanted = (as_finite(f'{name} of task "{task.name}"', getattr(found, name)) for name in Rows._fields[:3])
    m = J.shape[-2:-1]
    for name, x, core in (("J", J, (*m, model.nv)), ("drift", drift, m), ("wanted", wanted, m)):
        if not m or x.shape[x.ndim - len(core) :] != core:
            raise ShapeError(
                f'{name} of task "{task.name}" has shape {x.shape}, expected (..., m, {model.nv}) of J and (..., m) of '
                "drift and wanted"
            )
    return Rows(J, drift, wanted, np.asarray(found.turning))


def feedback(task: Any, rate: Array, e: Array | None) -> Array:
    """a* = a_d + Kd (ẋ_d - ẋ) + Kp e."""
    wanted = -np.asarray(task.Kd) * rate
    if task.velocity is not None:
        wanted = wanted + np.asarray(task.Kd) * task.velocity
    if task.acceleration is not None:
        wanted = wanted + task.acceleration
    found: Array = wanted if e is None else wanted + np.asarray(task.Kp) * e
    return found
