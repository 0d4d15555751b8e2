"""A step of a scene as a request of ``specialize``: its coefficients become constants of the program."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..calls.arguments import core_shape
from ..calls.specialize_request import SpecializeRequest, constants_of, dtype_of
from ..constraints.dynamics import rows_to_keep
from ..constraints.loops import close_loops
from ..errors import SpatialDynError, literal
from ..recursions.spec import Argument
from .effects import of_structure
from .effects.constraints import Constrained
from .methods.methods import EXPLICIT_METHODS
from .plan import Plan
from .scene import Scene, check_method, scene_of
from .states import HIDDEN
from .steps import step_specs


def step_request(given: Any, calls: Any, dtype: Any, fixed: Any, derivative: str | None) -> SpecializeRequest:
    """The request of a step of a scene, or of a Model.

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
    free = [x for x in arguments if x.name not in constants]
    return SpecializeRequest(
        model=model, specs=shown, several=True, dtype=number, arguments=arguments,
        static=dict(zip((x.name for x in specs[0].present if x.static), plan.tables, strict=True)),
        constants={**constants, **constants_of(model, fixed, free)}, parameter_names=(), parameters=(),
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
