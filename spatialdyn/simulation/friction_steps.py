"""Friction in simulations: which methods take which kind, its coefficients as inputs of a step, and the step itself.

"implicit"  v⁺ and the friction torques are found together (``recursions.friction``): a joint that sticks has v⁺ = 0
"lugre"     bristles deflect between the surfaces, a state of their own, z
"smooth"    a torque -F(v) tanh(v/ε) - b v in the equation of motion, by any method but ``variational``

Each step is written for rows of a table, which the tracer records, and for kernels, where the step runs in Python: for
torques that are functions, external forces, and robots too long for a program.

Motors are part of the implicit way: what their gears lose is dry friction in proportion to the load, what their own
voltage takes is viscous (``recursions.motors.driven``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction, check_friction
from ..actuation.motors import Motor, check_motor
from ..algebra.scalars import select
from ..calls.dynamics import calls
from ..calls.failures import joint_of_velocity
from ..constraints.dynamics import constraint_jacobian
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
from ..recursions.motors import EFFICIENCY, EMF, LIMIT, MOST, STALL, SUPPLY, driven
from ..recursions.spec import Argument
from . import works
from .constrained import Held, Rows, bristles_held
from .mimic_kernels import reduced_kernel
from .springs import spring_kernel
from .system import State, System, set_status

Array = NDArray[Any]
IMPLICIT, LUGRE, SMOOTH = WAYS = ("implicit", "lugre", "smooth")
STEPPED = "semi_implicit_euler"  # the method of "implicit" and "lugre"
CURRENT, VOLTAGE = DRIVES = ("current", "voltage")  # what a motor is given
# largest h λ at which v⁺ of v̇ = -λ v stays bounded
STABLE = {"explicit_euler": 2.0, "semi_implicit_euler": 2.0, "velocity_verlet": 2.0, "rk4": 2.785293563405282}
UNSOLVED = 1e-2  # [rad/s | m/s] violation of Coulomb's law that is an error

VIOLATION = Argument("violation", (1,), "rad/s | m/s", "largest violation of Coulomb's law so far", start=0.0)
OWN = {IMPLICIT: VIOLATION, LUGRE: BRISTLES}  # the state of its own that a kind of friction carries from step to step
COLUMNS = {
    "coulomb": COULOMB, "viscous": VISCOUS, "static": STATIC, "stribeck": STRIBECK, "smoothing": SMOOTHING,
    "stiffness": STIFFNESS, "damping": DAMPING, "stall": STALL, "supply": SUPPLY, "emf": EMF, "most": MOST,
    "efficiency": EFFICIENCY, "limit": LIMIT,
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
    def has_motor(self) -> bool:
        """Whether a motor's gear is part of it."""
        return "efficiency" in self.inputs

    @property
    def dry(self) -> NDArray[np.bool_]:
        """The freedoms (nv,) that may stick."""
        given = dict(zip(self.inputs, self.values, strict=True))
        sticks: NDArray[np.bool_] = (given["coulomb"] > 0.0) | (given["static"] > 0.0)
        return sticks | (given["efficiency"] < 1.0) if self.has_motor else sticks

    @property
    def own(self) -> Argument | None:
        """The state that it carries, None for none."""
        return OWN.get(self.way)


def rubbing(
    model: Model, friction: Friction | bool | None, way: str, motor: Motor | None = None, drive: str = CURRENT
) -> Rubbing | None:
    """The friction of a scene; None if none acts.

    Raises  SimulationError for an unknown way or drive, options that contradict each other, and a coefficient that the
            way needs; ModelError naming the joint, ShapeError.
    """
    if not isinstance(way, str) or way not in WAYS:
        raise SimulationError(f"friction_method is {way!r}, expected one of {', '.join(WAYS)}")
    if not isinstance(drive, str) or drive not in DRIVES:
        raise SimulationError(f"drive is {drive!r}, expected one of {', '.join(DRIVES)}")
    if motor is None and drive != CURRENT:
        raise SimulationError(f'drive is "{drive}" and no motor is given, expected motor=Motor(...) with it')
    if motor is None and friction is None and way != IMPLICIT:
        raise SimulationError(
            f'friction_method is "{way}" and no friction is given, expected friction=Friction(...), or True for that '
            "of the URDF"
        )
    if motor is not None:
        if way != IMPLICIT:
            raise SimulationError(
                f'motor is given and friction_method is "{way}", expected "{IMPLICIT}": gears rub, and motors brake, '
                "within its step"
            )
        if friction is None or friction is False:
            friction = Friction(np.zeros(model.nv), 0.0)
    if friction is None or (isinstance(friction, (bool, np.bool_)) and not friction):
        return None
    given = check_friction(model, friction)
    inputs = dict(zip(("coulomb", "viscous", "static", "stribeck"), given.law, strict=True))
    if way == SMOOTH:
        inputs["smoothing"] = _needed(given.smoothing, "smoothing", way)
    if way == LUGRE:
        inputs["stiffness"] = _needed(given.bristle_stiffness, "bristle_stiffness", way)
        inputs["damping"] = _needed(given.bristle_damping, "bristle_damping", way)
    if motor is not None:
        m = check_motor(model, motor)
        stall, emf, most, efficiency, limit = m.lines
        inputs |= {"supply" if drive == VOLTAGE else "stall": stall, "emf": emf, "most": most}
        inputs |= {"efficiency": efficiency, "limit": limit}
    return Rubbing(way, tuple(inputs), tuple(inputs.values()))


def check_rubbing(model: Model, found: Rubbing | None, method: str, dt: float) -> None:
    """Raise SimulationError for a step above the stability limit of smooth friction, with that limit."""
    if found is not None and found.way == SMOOTH:
        _check_stable(model, dict(zip(found.inputs, found.values, strict=True)), method, dt)


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
    friction_torque(rows, v, *law_of(given), given["smoothing"], made)
    return made


def geared(given: dict[str, Any], v: Any, tau: Any, law: tuple[Any, ...]) -> tuple[Any, tuple[Any, ...]]:
    """Torques and friction of a step with the motors of ``given``, their gears and brakes counted among friction."""
    if "emf" not in given:
        return tau, law
    coulomb, viscous, static, stribeck = law
    voltage = "supply" in given
    lines = (given["supply" if voltage else "stall"], *(given[x] for x in ("emf", "most", "efficiency", "limit")))
    found = np.array([driven(voltage, i, v, tau, *lines) for i in range(len(v))], np.asarray(tau).dtype)
    push, slope, level = found.reshape((-1, 3)).T
    return push, (coulomb + level, viscous + slope, static + level, stribeck)


def law_of(given: dict[str, Any]) -> tuple[Any, Any, Any, Any]:
    """The coefficients that all ways have."""
    return given["coulomb"], given["viscous"], given["static"], given["stribeck"]


def traced_step(
    way: str, rows: Any, given: dict[str, Any], tau: Any, under: Rows | None, pull: Any = None
) -> tuple[Any, dict[str, Any], dict[str, Any]]:
    """The velocities after a step, the state of its own by name, forces as ``carry_solved`` takes them.

    given  inputs of the step by name
    under  the constraints, None for none
    pull   torques beside tau, which pass no gear: of springs; None for none
    """
    q, v, dt = given["q"], given["v"], given["dt"]
    n = len(v)
    law, work, after = law_of(given), scratch(WORK, n + 1), np.zeros((3, n), object)
    pivots, M, R = (np.zeros(shape, object) for shape in ((n,), (n, n), (n, n)))
    push, law = geared(given, v, tau, law)
    lost = push - tau if push is not tau else 0.0
    push = push if pull is None else push + pull
    if way == LUGRE:
        z, stiffness, damping = given[BRISTLES.name], given["stiffness"], given["damping"]
        forces: dict[str, Any] = {}
        if under is None:
            bristle_step(rows, work, q, v, z, push, None, dt, *law, stiffness, damping, after, pivots, M)
            ahead, bristles = after[0], after[1]
        else:
            ahead, bristles = under.after_bristles(given, push)
            forces[works.CONSTRAINTS.name] = lambda way: under.force * under.rates(q, way)
        forces[works.FRICTION.name] = rubbed_by(LUGRE, given, law, ahead, bristles)
        return ahead, {BRISTLES.name: bristles}, forces
    friction_step(rows, work, q, v, push, None, dt, *law, after, pivots, M, R)
    largest = given[VIOLATION.name][0]
    for x in after[1]:
        largest = select(x - largest, x, largest)
    rubbed = rubbed_by(IMPLICIT, given, law, after[0], after[2]) + lost
    return after[0], {VIOLATION.name: np.array([largest], object)}, {works.FRICTION.name: rubbed}


def rubbed_by(way: str, given: dict[str, Any], law: tuple[Any, ...], after: Any, made: Any) -> Any:
    """The torques of friction and damping in a step; made are those of dry joints, or the bristles after it."""
    dry = made
    if way == LUGRE:
        z, each = given[BRISTLES.name], 1.0 / given["dt"]
        moved = np.array([each * x for x in made - z], made.dtype)
        dry = -(given["stiffness"] * made + given["damping"] * moved)
    return dry - law[1] * after


# --- a step by kernels ----------------------------------------------------------------------------------


def solver(
    found: Rubbing, fext: Array | None, model: Model, held: Held | None, springs: bool = False
) -> Callable[..., tuple[Array, dict[str, Any], dict[str, Any]]]:
    """``(system, t, h, state, own) -> v⁺, states after by name, forces``, as ``traced_step``."""
    pull = spring_kernel() if springs else None
    if held is not None:
        return _held_solver(found, fext, model, held, pull)
    loaded = [] if fext is None else [fext]
    implicit = found.way == IMPLICIT
    present = {*found.inputs, *(["fext"] if loaded else [])}
    spec = numba_kernels.variant(FRICTION_STEP if implicit else BRISTLE_STEP, present)
    kernel = numba_kernels.sample_kernel(spec) if model.mimic_matrix is None else reduced_kernel(model, spec)
    law = dict(zip(found.inputs, found.values, strict=True))

    def solve(system: System, t: float, h: float, state: State, own: Any) -> tuple[Array, dict[str, Any], Any]:
        given = {**law, **own, "dt": h}
        after = np.empty((3 if implicit else 2, len(state.w)))
        bristles = [] if implicit else [own[BRISTLES.name]]
        push, rubs = geared(given, state.w, system.tau, law_of(given))
        lost = push - system.tau
        push = push if pull is None else push + pull(system.table, state.q, state.w)
        rest = [] if implicit else [given["stiffness"], given["damping"]]
        inputs = (state.q, state.w, *bristles, push, *loaded, h, *rubs, *rest)
        set_status(system, kernel(system.table, *inputs, after), t)
        made = after[2 if implicit else 1]
        rubbed = rubbed_by(found.way, given, rubs, after[0], made) + lost
        if not implicit:
            return after[0], {BRISTLES.name: made}, {works.FRICTION.name: rubbed}
        worst = np.array([max(own[VIOLATION.name][0], after[1].max(initial=0.0))])
        return after[0], {VIOLATION.name: worst}, {works.FRICTION.name: rubbed}

    return solve


def _held_solver(
    found: Rubbing, fext: Array | None, model: Model, held: Held, pull: Callable[..., Array] | None
) -> Callable[..., tuple[Array, dict[str, Any], dict[str, Any]]]:
    """``solver`` of LuGre friction under constraints. It raises ConstraintError."""
    law = dict(zip(found.inputs, found.values, strict=True))
    step = bristles_held(held, model, law, fext)

    def solve(system: System, t: float, h: float, state: State, own: Any) -> tuple[Array, dict[str, Any], Any]:
        if pull is not None:
            system = system._replace(tau=system.tau + pull(system.table, state.q, state.w))
        given = {**law, **own, "dt": h}
        after, changed, force = step(system, h, state, own[BRISTLES.name])
        J = constraint_jacobian(model, held.constraints, state.q)
        forces = {
            works.FRICTION.name: rubbed_by(LUGRE, given, law_of(given), after, changed),
            works.CONSTRAINTS.name: lambda way: force * (J @ way),
        }
        return after, {BRISTLES.name: changed}, forces

    return solve


def smooth_kernel(found: Rubbing) -> Callable[..., Array]:
    """``(table, v) -> friction torques`` of smooth friction."""
    kernel = numba_kernels.sample_kernel(numba_kernels.variant(FRICTION_TORQUE, set(found.inputs)))

    def resist(table: Any, v: Array) -> Array:
        made = np.empty(len(v))
        kernel(table, v, *found.values, made)
        return made

    return resist


def rubbing_kernels(kernels: Any, resist: Callable[..., Array]) -> Any:
    """The kernels of a family whose acceleration, or ṗ, has the torques of smooth friction in it."""
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
