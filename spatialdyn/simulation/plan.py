"""``Plan``: the parts of a run, made of its scene, method and control law.

The scene keeps what depends on scene and method alone: a run that is like an earlier one begins at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.table import JointTable, joint_table
from ..calls.arguments import core_shape
from ..calls.dynamics import python_calls
from ..calls.specialize import specialize
from ..calls.specialized import Specialized
from ..control.control import recorded
from ..engines.programs.record import recording
from ..engines.programs.record.recording import Recording
from ..engines.programs.run import batch_kernels
from ..model.model import Model
from ..recursions.spec import Argument, Spec
from .effects import of_run, work
from .effects.constraints import Constrained, constrained_of
from .effects.contacts import Contact, check_start
from .effects.control import Feedback
from .effects.effect import Effect, find
from .methods.methods import EXPLICIT_METHODS, SCIPY_METHODS, Method, integrators
from .momenta_steps import momenta_specs
from .scene import Scene, check_method
from .states import RunStates, run_states
from .steps import step_specs
from .system import units

Array = NDArray[Any]
Force = Callable[[float, Array, Array], Array]
KEPT = 64  # plans of a scene, at most
OBSERVED = {"v": ("momentum", "kinetic_energy", "potential_energy"), "p": ("velocity_from_momentum",)}  # of samples


def method_of(scene: Scene, method: Any) -> Method:
    """The method of a run, for None the scene's. Raises SpatialDynError, SimulationError."""
    kept = scene._plans.get(method) if method is None or isinstance(method, str) else None
    if kept is None:
        name = check_method(scene, scene.method if method is None else method, integrators)
        kept = scene._plans.setdefault(method, integrators[name])
    return kept  # type: ignore[no-any-return]


class Plan:
    """A run.

    scene, model  Scene and its Model
    method        name of the method, ``integrator``
    effects       the effects of this run, including its control law
    works         whether work is recorded
    force         external forces of a run that are a function of (t, q, v); their effect holds its last value
    feedback, constrained, contact  the control law, the constraints and what acts by impulses, among the effects
    judged       the effects that judge steps by the states after them
    structure    the effects without large values: keys of caches
    tables       the static inputs of a step, in order
    values       {name: (samples or 1, steps or 1, columns)} of its other inputs, in order, without dt and tau
    work         states of the work that is recorded; symplectic methods integrate none of constraints, which is 0
    states       the states that the run carries beside q and v
    bare         whether only torques and constant forces act, so that a loop may be compiled as it is
    """

    def __init__(
        self, scene: Scene, method: str, effects: tuple[Effect, ...], works: bool = False, force: Force | None = None
    ) -> None:
        """See the class."""
        self.scene, self.model, self.method, self.effects, self.force = scene, scene.model, method, effects, force
        self.integrator: Method = integrators[method]
        self.feedback, self.constrained = find(effects, Feedback), find(effects, Constrained)
        self.contact = find(effects, Contact)
        self.judged = tuple(x for x in effects if type(x).failure is not Effect.failure)
        self.structure = tuple(x.structure() for x in effects)
        self.tables = tuple(x for effect in effects for x in effect.tables)
        self.values = {name: x for effect in effects for name, x in effect.values.items()}
        self.works, self.work = works, self._work() if works else ()
        self.states = (*(x for effect in effects for x in effect.states), *self.work)
        self.bare = force is None and not works and all(x.work is work.EXTERNAL for x in effects)

    def _work(self) -> tuple[Argument, ...]:
        works = [x.work for x in self.effects if x.work is not None]
        if self.constrained is not None and self.method not in (*EXPLICIT_METHODS, *SCIPY_METHODS):
            works.remove(work.CONSTRAINTS)
        elif self.constrained is not None and self.constrained.projects:
            works.append(work.PROJECTION)
        return (work.TORQUE, *works)

    @cached_property
    def unstarted(self) -> RunStates:
        """The states with the starts of their arguments."""
        return run_states(self.model, self.states, self.tables, None)

    @cached_property
    def table(self) -> JointTable:
        """The table of joints for kernels."""
        return joint_table(self.model.bodies)

    @cached_property
    def units(self) -> Array:
        """The units of the model."""
        return units(self.model)

    @cached_property
    def _cores(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the inputs that are not tables."""
        tables = [x for x in self.tables if hasattr(x, "sizes")]
        inputs = (x for effect in self.effects for x in effect.inputs if x.name in self.values)
        return {x.name: core_shape(self.model, x, tables) for x in inputs}

    def given(self, sample: int, step: int) -> dict[str, Any]:
        """The inputs of one step of one sample, by name."""
        made: dict[str, Any] = {}
        for name, x in self.values.items():
            row = x[min(sample, len(x) - 1), min(step, x.shape[1] - 1)].reshape(self._cores[name])
            made[name] = row if self._cores[name] else float(row)
        static = (x for effect in self.effects for x in effect.inputs if x.static)
        return made | dict(zip((x.name for x in static), self.tables, strict=True))

    def failure(self, states: dict[str, Array], dt: float, t: float) -> str:
        """The error in the steps until t, found from the states (flat) after them; "" without one."""
        return next((reason for x in self.judged if (reason := x.failure(states, dt, t))), "")

    # --- programs ---------------------------------------------------------------------------------------

    @cached_property
    def is_program(self) -> bool:
        """Whether a step may be a program: it has no callables and few equations and points; in a method in momenta
        only torques and forces act.
        """
        if self.method not in EXPLICIT_METHODS:
            return self.integrator.family is not None and self.bare and self.constrained is None
        contact, constraints = self.contact, self.scene.constraints
        few = constraints is None or constraints.nc <= recording.MOST_EQUATIONS
        return few and self.force is None and not (contact and contact.too_long)

    @cached_property
    def step_values(self) -> list[Array]:
        """(samples or 1, steps or 1, columns) of the inputs of a program after dt and tau, in order."""
        momenta = () if self.method in EXPLICIT_METHODS else (self.units[None, None],)
        return [*self.values.values(), *momenta]

    @cached_property
    def single(self) -> Any:
        """The kernel of a step of one sample; None if not applicable."""
        return self.kernel(self.work) if self.is_program else None

    def kernel(
        self, works: tuple[Argument, ...] = (), forced: bool = True, dtype: Any = np.float64, one: bool = True,
        common: tuple[int, ...] = (),
    ) -> Any:  # fmt: skip
        """The kernel of a step; None if the robot is too long for a program. See ``step_specs``, ``batch_kernels``."""
        parts = self.method, self.structure, works, self.tables, forced, np.dtype(dtype), one, common
        return _kernel(self.model, *parts)

    def recorded(self, forced: bool = True) -> Recording | None:
        """The recording of a step; None if the robot is too long for a program, or a joint has zero inertia."""
        specs = specs_of_step(self.method, self.structure, (), forced)
        fits = recording.fits(specs, self.model.bodies, static=self.tables)
        return recorded(specs, self.model, self.tables, np.dtype(float)) if fits else None

    @cached_property
    def observed(self) -> dict[str, Specialized]:
        """Calls on samples of q and v or q and p: programs, so that no bit depends on the number of samples."""
        moves = ("v", "p") if self.integrator.family is not None and self.integrator.family.moves == "p" else ("v",)
        return {given: _specialized(self.model, OBSERVED[given]) for given in moves}


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _kernel(
    model: Model, method: str, effects: tuple[Effect, ...], works: tuple[Argument, ...], static: tuple[Any, ...],
    forced: bool, dtype: Any, one: bool, common: tuple[int, ...],
) -> Any:  # fmt: skip
    specs = specs_of_step(method, effects, works, forced)
    if not recording.fits(specs, model.bodies, static=static):
        return None
    made = None if specs[0].stamped else recorded(specs, model, static, dtype)  # which a check of the law has too
    if made is not None and common:
        made = Recording(made.program, replace(made.layout, common=common))
    return batch_kernels.kernel(specs, model.bodies, model.key, static, dtype=dtype, one=one, recorded=made)


def specs_of_step(
    method: str, effects: tuple[Effect, ...], works: tuple[Argument, ...], forced: bool
) -> tuple[Spec, ...]:
    """Specs of the states after a step of any method; see ``step_specs``."""
    if method in EXPLICIT_METHODS:
        return step_specs(method, effects, works, forced)
    return momenta_specs(method, effects, forced)


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _specialized(model: Model, names: tuple[str, ...]) -> Specialized:
    return specialize(model, [python_calls[name] for name in names])  # builtins would be made for their names alone


# --- of a run -------------------------------------------------------------------------------------------


class Inputs(NamedTuple):
    """The inputs of a run beside its scene and states.

    fext      (samples or 1, steps or 1, njoints, 6) external forces beside those of the scene; None without any
    force     external forces as a function of (t, q, v); None without any
    feedback  the control law; None without one
    """

    fext: Any = None
    force: Force | None = None
    feedback: Feedback | None = None


def plan_of(
    scene: Scene, method: str, start: tuple[Array, Array], dt: float, works: bool, records: bool, inputs: Inputs
) -> Plan:
    """The plan of a run from states q (..., nq), v (..., nv) in fixed steps of dt; 0 if steps are not fixed.

    works, records  whether work is recorded, and impulses of contacts

    Raises  for a start that violates the constraints, or is in the ground
    """
    constrained = None if scene.constraints is None else constrained_of(scene, *start, dt)
    if scene.contacts is not None or scene.limits:
        check_start(scene, start[0])
    own = all(x is None for x in inputs)  # nothing acts beyond the scene
    key = method, works, records, None if constrained is None else constrained.rank.tobytes()
    known = scene._plans.get(key) if own else None
    if known is None:
        called = np.zeros((1, 1, 6 * scene.model.njoints))  # a function's
        forces = forces_of(scene, inputs.fext) if inputs.force is None else called
        effects = of_run(scene, constrained, records, forces)
        effects = effects if inputs.feedback is None else (*effects, inputs.feedback)
        known = Plan(scene, method, effects, works, inputs.force)
        if own and len(scene._plans) < KEPT:
            scene._plans[key] = known
    return known


def forces_of(scene: Scene, fext: Any) -> Any:
    """Rows (samples or 1, steps or 1, 6 njoints) of the forces (..., njoints, 6) of scene and run; None without any."""
    if fext is None and scene.fext is None:
        return None
    if fext is None:
        return np.ascontiguousarray(scene.fext).reshape((1, 1, -1))
    rows = np.array(fext, float) if scene.fext is None else fext + scene.fext
    return rows.reshape((1,) * (4 - rows.ndim) + rows.shape[:-2] + (-1,))
