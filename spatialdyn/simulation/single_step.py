"""``step``: one step of a robot or of a scene, with all its effects."""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls import states as free
from ..calls.arguments import as_array, batch_shape, broadcast, core_shape
from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..recursions.spec import FEXT, TAU, Q, V
from .rollouts import rollout
from .scene import Scene
from .scene_program import step_request

Array = NDArray[Any]


@typing.overload
def step(
    scene: Model, q: ArrayLike, v: ArrayLike, tau: ArrayLike, dt: ArrayLike, method: str = ...,
    fext: ArrayLike | None = ...,
) -> tuple[Array, Array]: ...  # fmt: skip


@typing.overload
def step(
    scene: Scene, q: ArrayLike, v: ArrayLike, tau: ArrayLike, dt: ArrayLike, method: str = ...,
    fext: ArrayLike | None = ..., states: Mapping[str, ArrayLike] | None = ...,
) -> Any: ...  # fmt: skip


def step(
    scene: Scene | Model,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    method: str = "semi_implicit_euler",
    fext: ArrayLike | None = None,
    states: Mapping[str, ArrayLike] | None = None,
) -> Any:
    """The state a time dt later under constant torques and forces: ``q, v = step(scene, q, v, tau, dt)``.

    scene   Scene: the robot and what acts on it; a Model is a scene on which nothing else acts
    q       (..., nq)          joint positions [rad | m]
    v       (..., nv)          joint velocities [rad/s | m/s]
    tau     (..., nv)          joint torques [N m | N]
    dt      (...)              time [s]; for a Model a negative dt goes back in time; for a Scene one positive number
    method  for a Model explicit_euler: v + a dt and q moved by v dt, order 1, gains energy; semi_implicit_euler: q
            moved by the new v dt; or rk4, the classical Runge-Kutta method in the coordinates u of q ∘ exp(u), with u̇
            from v by the inverse of ``dintegrate``, order 4 for all joints, which must turn less than 2π a step. For a
            Scene one of ``scene.methods``, as in ``rollout``
    fext    (..., njoints, 6)  force on each joint's body, in the joint's frame [N | N m], beside those of the scene;
            zero if left out
    states  {name: (..., ...)}  states that the scene carries beside q and v, such as "bristles"; states left out start
            as in a run

    Returns (q, v), new arrays of the common batch shape; for a scene that carries states (q, v, states).
    Raises  SpatialDynError for another method or a dt that is not finite; NonFiniteError if the new state of a finite
            state is not finite; the errors of aba. For a Scene the errors of ``rollout``.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> q, v = sd.step(model, [0.5, -0.3], [0.0, 0.0], [0.0, 0.0], 1e-3)
    >>> bool((abs(q - [0.5, -0.3]) < 1e-4).all())
    True
    >>> stuck = sd.Scene(model, friction=sd.Friction(100.0))
    >>> sd.step(stuck, [0.5, -0.3], [0.0, 0.0], [1.0, 0.0], 1e-3)[1]
    array([0., 0.])
    """
    if not isinstance(scene, Scene):
        if states is not None:
            raise SpatialDynError(f"states are {literal(states)}, expected None: a Model carries none beside q and v")
        return free.step(scene, q, v, tau, dt, method, fext)
    model, h = scene.model, as_array("dt", dt)
    if h.ndim:
        raise SpatialDynError(f"dt has shape {h.shape}, expected one number for a scene")
    arguments, values = [Q, V, TAU], [as_array("q", q), as_array("v", v), as_array("tau", tau)]
    if fext is not None:
        arguments, values = [*arguments, FEXT], [*values, as_array("fext", fext)]
    shapes = [batch_shape(model, x, y) for x, y in zip(arguments, values, strict=True)]
    batch = broadcast([x.name for x in arguments], shapes)
    count = math.prod(batch)
    rows = []
    for x, y in zip(arguments, values, strict=True):
        core = core_shape(model, x)
        rows.append(np.ascontiguousarray(np.broadcast_to(y, batch + core)).reshape((count, *core)))
    own = {name: _rows(as_array(f"state {name}", x), batch, count) for name, x in (states or {}).items()}
    forces = rows[3][:, None] if fext is not None else None
    run = rollout(
        scene, rows[0], rows[1], rows[2][:, None], dt=float(h), method=method, record="last", states=own or None,
        fext=forces,
    )  # fmt: skip
    after = tuple(x.reshape(batch + x.shape[1:]) for x in (run.q, run.v))
    if not run.states:
        return after
    return (*after, {name: x.reshape(batch + x.shape[1:]) for name, x in run.states.items()})


setattr(step, "request", step_request)  # noqa: B010  of ``specialize``, whose room is below


def _rows(x: Array, batch: tuple[int, ...], count: int) -> Array:
    """A state as (samples, ...), or as it is without axes of samples."""
    if not batch or x.shape[: len(batch)] != batch:
        return x
    return x.reshape((count, *x.shape[len(batch) :]))
