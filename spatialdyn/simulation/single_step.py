"""``step``: one step of a robot or of a scene, with all its effects; and the request of ``specialize`` for a step."""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls import time_step as free
from ..calls.arguments import as_array, batch_shape, broadcast, core_shape
from ..calls.specialize_request import SpecializeRequest, constants_of, dtype_of
from ..constraints.dynamics import rows_to_keep
from ..constraints.loops import close_loops
from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..recursions.spec import FEXT, TAU, Argument, Q, V
from .effects import of_structure
from .effects.constraints import Constrained
from .methods.methods import EXPLICIT_METHODS
from .plan import Plan
from .rollouts import rollout
from .scene import Scene, check_method, scene_of
from .states import HIDDEN
from .steps import step_specs

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


def _rows(x: Array, batch: tuple[int, ...], count: int) -> Array:
    """A state as (samples, ...), or as it is without axes of samples."""
    if not batch or x.shape[: len(batch)] != batch:
        return x
    return x.reshape((count, *x.shape[len(batch) :]))


# --- of specialize --------------------------------------------------------------------------------------


def step_request(given: Any, calls: Any, dtype: Any, fixed: Any, derivative: str | None) -> SpecializeRequest:
    """The request of a step of a scene, or of a Model, whose coefficients become constants of the program.

    calls  ``sd.step``, or ``functools.partial(sd.step, method="rk4")``

    Raises SpatialDynError for other arguments of ``step``, and for constraints in float32; otherwise as ``specialize``.
    """
    scene = scene_of(given)
    words, values = (calls.keywords, calls.args) if isinstance(calls, partial) else ({}, ())
    if values or {*words} - {"method"}:
        raise SpatialDynError(f'calls are {literal(calls)}, expected functools.partial(sd.step, method="rk4"), say')
    method = check_method(scene, words.get("method", "semi_implicit_euler"), EXPLICIT_METHODS)
    number = dtype_of(dtype)
    if scene.constraints is not None and number != np.float64:
        raise SpatialDynError("dtype is float32, expected float64 with constraints")
    model = scene.model
    effects = tuple(_at_a_closed_one(scene, x) if isinstance(x, Constrained) else x for x in of_structure(scene))
    plan = Plan(scene, method, effects)
    specs = step_specs(method, plan.structure, called=True)
    hidden = [x for x in plan.states if x.name in HIDDEN]
    constants = {name: x[0, 0] for name, x in plan.values.items()}
    constants |= {x.name: np.full(core_shape(model, x, plan.tables), float(x.start or 0.0)).ravel() for x in hidden}
    arguments: tuple[Argument, ...] = tuple(x for x in specs[0].present if not x.static)
    shown = tuple(x for x in specs if x.output.name not in {f"{y.name}_after" for y in hidden})
    varied = [x for x in arguments if x.name not in constants]
    return SpecializeRequest(
        model=model, specs=shown, several=True, dtype=number, arguments=arguments,
        static=dict(zip((x.name for x in specs[0].present if x.static), plan.tables, strict=True)),
        constants={**constants, **constants_of(model, fixed, varied)}, parameter_names=(), parameters=(),
        output_places=None, derivative=derivative or "",
    )  # fmt: skip


def _at_a_closed_one(scene: Scene, effect: Constrained) -> Constrained:
    """The constraints with their rank in a configuration that meets them."""
    model, constraints = scene.model, effect.constraints
    q = close_loops(model, constraints, 1e-2 * np.arange(1.0, model.nq + 1.0)) if model.nq == model.nv else None
    if q is None:
        raise SpatialDynError(f'robot "{model.name}" has joints of several freedoms, expected none beside constraints')
    rank = np.asarray(rows_to_keep(model, constraints, q)[1], np.intp)
    return Constrained(constraints, effect.rate, rank.reshape(-1))


setattr(step, "request", step_request)  # noqa: B010  of ``specialize``, whose room is below
