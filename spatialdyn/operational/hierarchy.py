"""``task_torque``: joint torques that do tasks in strict order, and a posture in the remaining directions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_finite, broadcast, check_model, frame_row_and_placement
from ..calls.dynamics import calls
from ..errors import ModelError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..waiting import watch
from .space import times
from .spectral import DAMPING, LENGTH, axes_of, lengths_of, share_of, spectral_inverse
from .tasks import ComTask, FrameTask, PostureTask, Rows, Task, rows_of

Array = NDArray[np.float64]


class TaskTorque(NamedTuple):
    """Torques of tasks.

    tau     (..., nv)  joint torques [N m | N]
    a       (..., nv)  the joint accelerations that they cause
    missed  for each task (..., m): J a + J̇ v - a*, 0 if the task is met
    rank    for each task (...): number of its strong directions among those that earlier tasks leave
    weak    for each task (..., m, m): rows: its other directions, in the metric of lengths
    """

    tau: Array
    a: Array
    missed: tuple[Array, ...]
    rank: tuple[NDArray[np.intp], ...]
    weak: tuple[Array, ...]


@watch.call("task_torque")
def task_torque(
    model: Model, q: ArrayLike, v: ArrayLike, tasks: Task | Iterable[Task],
    posture: ArrayLike | PostureTask | None = None, *, damping: float = DAMPING, length: float = LENGTH,
) -> TaskTorque:  # fmt: skip
    """Joint torques that do tasks in strict order: no task disturbs an earlier one, and the posture disturbs no task.

    Each task acts in the null space N of earlier ones: with Jp = J N, Λp = (Jp M⁻¹ Jpᵀ)⁻¹ and τ̂ the torques so far,
    F = Λp (a* - J̇ v - J M⁻¹ τ̂), τ̂ += Jpᵀ F, N -= M⁻¹ Jpᵀ Λp Jp. At the end τ = τ̂ + Nᵀ τ₀ + C v + g.

    model    Model in which every freedom has a motor; for a floating robot use ``WholeBody``
    q        (..., nq)  joint positions [rad | m]
    v        (..., nv)  joint velocities [rad/s | m/s]
    tasks    in order; their ``priority`` and ``weight`` do not count
    posture  τ₀ (..., nv) [N m | N], or a PostureTask, whose accelerations times M are τ₀; zero if left out
    damping  share of a task's largest mobility below which a direction is weak, and faded out instead of inverted
    length   [m] by which rotations are compared with translations

    Returns TaskTorque (tau, a, missed, rank, weak): bounded in every configuration.
    Raises  ModelError for unknown frames or joints, and for a floating robot; SpatialDynError for two tasks on one axis
            of a frame or of the centre of mass; ShapeError, NonFiniteError
    Source  Khatib, A unified approach for motion and force control of robot manipulators (1987); Sentis and Khatib,
            Synthesis of whole-body behaviors through hierarchical control of behavioral primitives (2005). Only one of
            their projections is used, (I - Jᵀ J̄ᵀ): a second one would change the lower tasks.

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("panda")
    >>> q, v = sd.random_configuration(model, np.random.default_rng(0)), np.zeros(model.nv)
    >>> hold = sd.FrameTask("panda_hand", acceleration=[0.5, 0.0, 0.0], axes="xyz")
    >>> found = sd.task_torque(model, q, v, hold, posture=-2.0 * np.sin(q))
    >>> bool(abs(found.missed[0]).max() < 1e-10)
    True
    """
    check_model(model)
    share = share_of(damping)
    given = check_tasks(model, tasks)
    if any(joint.kind == "floating" and joint.parent == 0 for joint in model.joints[1:]):
        raise ModelError(
            f'robot "{model.name}" floats: its base has no motor, and contacts decide what torques do; expected a '
            "fixed base, or WholeBody(scene, tasks)"
        )
    q, v = as_finite("q", q), as_finite("v", v)
    inverse, n = np.asarray(calls["minverse"](model, q)), model.nv
    tau, N = np.zeros(n), np.eye(n)
    done: list[Rows] = []
    ranks, weaks = [], []
    for task in given:
        rows = rows_of(task, model, q, v)
        lengths = lengths_of([3 * int(x) for x in rows.turning], length)
        Jp = rows.J @ N
        back = inverse @ np.swapaxes(Jp, -1, -2)
        whole = rows.J @ inverse @ np.swapaxes(rows.J, -1, -2)
        Lambda, rank, weak = spectral_inverse(Jp @ back, lengths, share, whole)
        F = times(Lambda, rows.wanted - rows.drift - times(rows.J, times(inverse, tau)))
        tau = tau + times(np.swapaxes(Jp, -1, -2), F)
        N = N - back @ Lambda @ Jp
        done.append(rows)
        ranks.append(rank)
        weaks.append(weak)
    tau = tau + times(np.swapaxes(N, -1, -2), _posture(model, q, v, posture))
    a = times(inverse, tau)
    missed = tuple(times(x.J, a) + x.drift - x.wanted for x in done)
    total = tau + np.asarray(calls["nonlinear_effects"](model, q, v))
    return TaskTorque(total, np.broadcast_to(a, total.shape), missed, tuple(ranks), tuple(weaks))


def _posture(model: Model, q: Array, v: Array, posture: Any) -> Array:
    """τ₀."""
    if posture is None:
        return np.zeros(model.nv)
    if isinstance(posture, Task):
        posture.check(model)
        rows = rows_of(posture, model, q, v)
        return times(np.asarray(calls["crba"](model, q)), times(np.swapaxes(rows.J, -1, -2), rows.wanted))
    tau = as_finite("posture", posture)
    if tau.shape[-1:] != (model.nv,):
        raise ShapeError(f"posture has shape {tau.shape}, expected (..., {model.nv})")
    broadcast(["q", "v", "posture"], [q.shape[:-1], v.shape[:-1], tau.shape[:-1]])
    return tau


def check_tasks(model: Model, tasks: Any) -> list[Any]:
    """The tasks as a list, checked against the model. Raises SpatialDynError, ModelError, ShapeError."""
    expected = "a task such as FrameTask, or several"
    try:
        given = [tasks] if hasattr(tasks, "rows") else list(tasks)
    except TypeError:
        raise SpatialDynError(f"tasks is {literal(tasks)}, expected {expected}") from None
    for task in given:
        if not callable(getattr(task, "rows", None)):
            raise SpatialDynError(f"tasks has {literal(task)}, expected {expected}")
        for name in ("name", "weight", "priority", "check"):
            if not hasattr(task, name):
                raise SpatialDynError(f"tasks has {literal(task)} without {name}, expected it in a task")
        task.check(model)
    if not given:
        raise SpatialDynError(f"tasks is {literal(tasks)}, expected {expected}")
    seen: dict[Any, str] = {}
    for task in given:
        if not isinstance(task, (FrameTask, ComTask)):
            continue
        key: tuple[Any, ...] = ("centre of mass",)
        what = "the centre of mass"
        if isinstance(task, FrameTask):
            row, placement = frame_row_and_placement(model, task.frame)  # the same for a link and its joint
            key = row, np.asarray(placement).tobytes(), task.reference
            what = f'frame "{model.frame(task.frame).name}"'
        for axis in axes_of(task.axes):
            if (*key, axis) in seen:
                word = ("x", "y", "z", "rx", "ry", "rz")[axis]
                raise SpatialDynError(
                    f'tasks "{seen[(*key, axis)]}" and "{task.name}" both move {word} of {what}, expected one'
                )
            seen[(*key, axis)] = str(task.name)
    return given
