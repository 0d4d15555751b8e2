"""Friction in simulations: which methods take which kind, its coefficients as inputs of a step, and the step itself.

"implicit"  v⁺ and the friction torques are found together (``recursions.friction``): a joint that sticks has v⁺ = 0
"lugre"     bristles deflect between the surfaces, a state of their own, z
"smooth"    a torque -F(v) tanh(v/ε) - b v in the equation of motion, by any method but ``variational``

Each step is written for rows of a table, which the tracer records, and for kernels, where the step runs in Python: for
torques that are functions, external forces, and robots too long for a program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction, check_friction
from ..algebra.scalars import select
from ..calls.dynamics import calls
from ..calls.failures import joint_of_velocity
from ..engines.compiled import numba_kernels
from ..engines.programs.tracer import scratch
from ..errors import SimulationError
from ..model.model import Model
from ..recursions.friction import (
    BRISTLE_STEP,
    BRISTLES,
    COULOMB,
    DAMPING,
    FRICTION_STEP,
    FRICTION_TORQUE,
    SMOOTHING,
    STATIC,
    STIFFNESS,
    STRIBECK,
    VISCOUS,
    WORK,
    bristle_step,
    friction_step,
    friction_torque,
)
from ..recursions.spec import Argument
from . import explicit
from .system import State, System, set_status

Array = NDArray[Any]
IMPLICIT, LUGRE, SMOOTH = WAYS = ("implicit", "lugre", "smooth")
STEPPED = "semi_implicit_euler"  # the method of "implicit" and "lugre"
# largest h λ at which v⁺ of v̇ = -λ v stays bounded
STABLE = {"explicit_euler": 2.0, "semi_implicit_euler": 2.0, "velocity_verlet": 2.0, "rk4": 2.785293563405282}
UNSOLVED = 1e-2  # [rad/s | m/s] violation of Coulomb's law that is an error

VIOLATION = Argument("violation", (1,), "rad/s | m/s", "largest violation of Coulomb's law so far", start=0.0)
OWN = {IMPLICIT: VIOLATION, LUGRE: BRISTLES}  # the state of its own that a kind of friction carries from step to step
COLUMNS = {
    "coulomb": COULOMB, "viscous": VISCOUS, "static": STATIC, "stribeck": STRIBECK, "smoothing": SMOOTHING,
    "stiffness": STIFFNESS, "damping": DAMPING,
}  # fmt: skip


@dataclass(frozen=True)
class Rubbing:
    """The friction of a run.

    way     one of WAYS
    inputs  names of its coefficients, of COLUMNS
    values  (nv,) of each
    """

    way: str
    inputs: tuple[str, ...]
    values: tuple[Array, ...]

    @property
    def own(self) -> Argument | None:
        """The state that it carries, None for none."""
        return OWN.get(self.way)


def rubbing(model: Model, friction: Friction | bool | None, way: str, method: str, dt: float) -> Rubbing | None:
    """The friction of a run by the arguments of ``simulate`` and ``rollout``; None if none acts.

    Raises  SimulationError for an unknown way, one that the method cannot take, a coefficient that it needs, and a step
            above the stability limit of smooth friction, with that limit; ModelError naming the joint, ShapeError.
    """
    if not isinstance(way, str) or way not in WAYS:
        raise SimulationError(f"friction_method is {way!r}, expected one of {', '.join(WAYS)}")
    if friction is None or (isinstance(friction, (bool, np.bool_)) and not friction):
        return None
    given = check_friction(model, friction)
    if way != SMOOTH and method != STEPPED:
        raise SimulationError(
            f'friction_method is "{way}" and method "{method}", expected method="{STEPPED}", which alone solves for '
            'friction and velocity together; any method but variational takes friction_method="smooth"'
        )
    if way == SMOOTH and method == "variational":
        raise SimulationError('method is "variational", expected another with friction, such as gauss4')
    inputs = dict(zip(("coulomb", "viscous", "static", "stribeck"), given.law, strict=True))
    if way == SMOOTH:
        inputs["smoothing"] = _needed(given.smoothing, "smoothing", way)
        _check_stable(model, inputs, method, dt)
    if way == LUGRE:
        inputs["stiffness"] = _needed(given.bristle_stiffness, "bristle_stiffness", way)
        inputs["damping"] = _needed(given.bristle_damping, "bristle_damping", way)
    return Rubbing(way, tuple(inputs), tuple(inputs.values()))


def check_alone(found: Rubbing | None, constraints: Any) -> None:
    """Raises SimulationError where both friction and constraints are to act: their impulses would be one problem."""
    if found is not None and constraints is not None:
        raise SimulationError("friction and constraints are given, expected one of them")


def _needed(value: Array | None, name: str, way: str) -> Array:
    if value is None:
        raise SimulationError(
            f'friction has no {name}, expected some for friction_method="{way}": sd.Friction.of(model, {name}=...)'
        )
    return value


def _check_stable(model: Model, inputs: dict[str, Array], method: str, dt: float) -> None:
    """Refuse a step at which smooth friction grows near v = 0, where v̇ = -M⁻¹ K v, in the neutral configuration."""
    if method not in STABLE or not model.nv:
        return
    slope = inputs["static"] / inputs["smoothing"] + inputs["viscous"]
    root = np.sqrt(slope)
    rates, modes = np.linalg.eigh(root[:, None] * calls["minverse"](model, calls["neutral"](model)) * root)
    k = int(np.argmax(abs(modes[:, -1])))
    if dt * rates[-1] > STABLE[method]:
        raise SimulationError(
            f"dt is {dt:g} s, expected at most {STABLE[method] / rates[-1]:.3g} s, where {method} is stable with the "
            f'smooth friction of joint "{joint_of_velocity(model, k).name}", {slope[k]:.3g} N m s/rad at rest; a '
            'larger smoothing allows more, and friction_method="implicit" any'
        )


# --- a step, traced -------------------------------------------------------------------------------------


def smooth_torque(rows: Any, v: Any, given: dict[str, Any]) -> Any:
    """Friction torques (nv,) as recorded numbers; ``given`` are the coefficients by name."""
    made = np.zeros(len(v), object)
    friction_torque(rows, v, *_law(given), given["smoothing"], made)
    return made


def _law(given: dict[str, Any]) -> tuple[Any, Any, Any, Any]:
    """The coefficients that all ways have."""
    return given["coulomb"], given["viscous"], given["static"], given["stribeck"]


def traced_step(way: str, rows: Any, given: dict[str, Any], tau: Any) -> tuple[Any, dict[str, Any], Any]:
    """The velocities after a step, the state of its own by name, friction's torques; of ``given`` inputs by name."""
    q, v, dt = given["q"], given["v"], given["dt"]
    n = len(v)
    law, work, after = _law(given), scratch(WORK, n + 1), np.zeros((3, n), object)
    pivots, M, R = (np.zeros(shape, object) for shape in ((n,), (n, n), (n, n)))
    if way == LUGRE:
        z, stiffness, damping = given[BRISTLES.name], given["stiffness"], given["damping"]
        bristle_step(rows, work, q, v, z, tau, None, dt, *law, stiffness, damping, after, pivots, M)
        rubbed = _bristle_torque(z, after[1], 1.0 / dt, stiffness, damping) - given["viscous"] * after[0]
        return after[0], {BRISTLES.name: after[1]}, rubbed
    friction_step(rows, work, q, v, tau, None, dt, *law, after, pivots, M, R)
    largest = given[VIOLATION.name][0]
    for x in after[1]:
        largest = select(x - largest, x, largest)
    return after[0], {VIOLATION.name: np.array([largest], object)}, after[2] - given["viscous"] * after[0]


def _bristle_torque(z: Any, after: Any, rate: Any, stiffness: Any, damping: Any) -> Any:
    """What bristles exert in a step of 1/rate that takes their deflection from z to ``after``."""
    moved = np.array([rate * x for x in after - z], after.dtype)
    return -(stiffness * after + damping * moved)


# --- a step by kernels ----------------------------------------------------------------------------------


def by_kernels(
    found: Rubbing, kernels: Any, advance: Callable[..., None], own: Array, fext: Array | None
) -> tuple[Any, Callable[..., None]]:
    """The kernels and the step of a method with friction.

    own  the state that the friction carries, written in place
    """
    if found.way == SMOOTH:
        resist = smooth_kernel(found)
        return _smooth(kernels, resist), advance
    solve = solver(found, fext)

    def step(system: System, t: float, h: float, state: State) -> None:
        system.torque(system, t, state.q, state.w)
        after, changed, _ = solve(system, t, h, state, own)
        state.w[:], own[:] = after, changed
        displacement = state.work[1]
        displacement[:] = h * state.w
        explicit.move(system, t, displacement, state)

    return kernels, step


def solver(found: Rubbing, fext: Array | None) -> Callable[..., tuple[Array, Array, Array]]:
    """``(system, t, h, state, own) -> v⁺, own⁺, friction torques`` of a step whose velocities are solved for."""
    loaded = [] if fext is None else [fext]
    implicit = found.way == IMPLICIT
    present = {*found.inputs, *(["fext"] if loaded else [])}
    kernel = numba_kernels.sample_kernel(numba_kernels.variant(FRICTION_STEP if implicit else BRISTLE_STEP, present))
    given = dict(zip(found.inputs, found.values, strict=True))

    def solve(system: System, t: float, h: float, state: State, own: Array) -> tuple[Array, Array, Array]:
        after = np.empty((3 if implicit else 2, len(state.w)))
        bristles = [] if implicit else [own]
        inputs = (state.q, state.w, *bristles, system.tau, *loaded, h, *found.values)
        set_status(system, kernel(system.table, *inputs, after), t)
        if implicit:
            changed, rubbed = np.array([max(own[0], after[1].max(initial=0.0))]), after[2]
        else:
            changed, rubbed = after[1], _bristle_torque(own, after[1], 1.0 / h, given["stiffness"], given["damping"])
        return after[0], changed, rubbed - given["viscous"] * after[0]

    return solve


def smooth_kernel(found: Rubbing) -> Callable[..., Array]:
    """``(table, v) -> friction torques`` of smooth friction."""
    kernel = numba_kernels.sample_kernel(numba_kernels.variant(FRICTION_TORQUE, set(found.inputs)))

    def resist(table: Any, v: Array) -> Array:
        made = np.empty(len(v))
        kernel(table, v, *found.values, made)
        return made

    return resist


def _smooth(kernels: Any, resist: Callable[..., Array]) -> Any:
    """The kernels of a family whose acceleration, or ṗ, has the friction torques in it."""
    if hasattr(kernels, "accelerate"):

        def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
            tau = system.tau + resist(system.table, v)
            code: int = kernels.accelerate(system._replace(tau=tau, kernels=kernels), q, v, a)
            return code

        return kernels._replace(accelerate=accelerate)

    def field(system: System, q: Any, p: Any, rates: Any) -> int:
        code: int = kernels.field(system._replace(kernels=kernels), q, p, rates)
        rates[1] += resist(system.table, rates[0])
        return code

    return kernels._replace(field=field)
