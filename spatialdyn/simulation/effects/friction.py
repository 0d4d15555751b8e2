"""Friction of the joints: three kinds, each an effect.

DryFriction     solves for v⁺ and the friction torques together (``recursions.joints.friction``): a joint that sticks
                has v⁺ = 0
LuGreFriction   bristles between the surfaces deflect by z, a state that the run carries
SmoothFriction  a torque -F(v) tanh(v/ε) - b v in the equation of motion, by any method
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...actuation.friction import Friction, check_friction
from ...actuation.motors import Motor, check_motor
from ...algebra.scalars import select
from ...calls.arguments import as_word
from ...errors import SimulationError
from ...model.model import Model
from ...recursions.joints.friction import (
    BRISTLE_STEP,
    BRISTLES,
    DAMPING,
    FRICTION_STEP,
    FRICTION_TORQUE,
    LAW,
    SMOOTHING,
    STIFFNESS,
)
from ...recursions.spec import Argument
from ..arithmetic import Arithmetic
from . import work
from .constraints import Constrained
from .effect import Effect, Forces, find, torques_of
from .motor import CURRENT, DRIVES, Drive, Law, geared

IMPLICIT, LUGRE, SMOOTH = WAYS = ("implicit", "lugre", "smooth")
STEPPED = "semi_implicit_euler"  # the method for "implicit" and "lugre", and for all impulses
UNSOLVED = 1e-2  # [rad/s | m/s] violation of Coulomb's law that is an error

VIOLATION = Argument("violation", (1,), "rad/s | m/s", "largest violation of Coulomb's law so far", start=0.0)


@dataclass(frozen=True, eq=False)
class JointFriction(Effect):
    """Friction and damping of the joints."""

    friction: Friction
    name = "friction"
    drives = False
    way = ""
    inputs = tuple(LAW)
    work = work.FRICTION

    needs: ClassVar[dict[str, Argument]] = {}  # fields of ``Friction`` beside the law, which all kinds have

    @cached_property
    def values(self) -> dict[str, NDArray[Any]]:
        """Raises SimulationError for a coefficient that is missing."""
        more = [getattr(self.friction, name) for name in self.needs]
        for name, x in zip(self.needs, more, strict=True):
            if x is None:
                raise SimulationError(
                    f'friction has no {name}, expected some for friction_method="{self.way}": sd.Friction.of(model, '
                    f"{name}=...)"
                )
        return {x.name: y[None, None] for x, y in zip(self.inputs, (*self.friction.law, *more), strict=True)}


@dataclass(frozen=True, eq=False)
class SmoothFriction(JointFriction):
    """A smooth torque against the motion."""

    way = SMOOTH
    needs: ClassVar[dict[str, Argument]] = {"smoothing": SMOOTHING}
    inputs = (*LAW, *needs.values())

    def torque(self, at: Arithmetic, q: Any, v: Any) -> Any:
        (made,) = at.evaluate(FRICTION_TORQUE, v=v).values()
        return made


@dataclass(frozen=True, eq=False)
class DryFriction(JointFriction):
    """Coulomb's law and damping at the end of a step.

    coupled  whether contacts or constraints are solved for too: their effect then has the residual
    """

    coupled: bool = False
    way = IMPLICIT
    solves = True

    @cached_property
    def states(self) -> Any:
        return () if self.coupled else (VIOLATION,)

    def as_coupled(self) -> DryFriction:
        return DryFriction(self.friction, True)

    def solve(self, at: Arithmetic, acting: tuple[Effect, ...], tau: Any) -> tuple[Any, dict[str, Any], Forces]:
        given, v = at.given, at.given["v"]
        push, law = geared(given, v, tau, law_of(given))
        lost = push - tau if push is not tau else 0.0
        push, forces = with_torques(at, acting, push)
        (made,) = at.evaluate(FRICTION_STEP, tau=push, **named(law)).values()
        after, beyond, dry = made
        largest = given[VIOLATION.name][0]
        for x in beyond:
            largest = select(x - largest, x, largest)
        forces[work.FRICTION.name] = dry - law[1] * after + lost
        return after, {VIOLATION.name: np.array([largest], after.dtype)}, forces

    def failure(self, states: dict[str, NDArray[Any]], dt: float, t: float) -> str:
        if self.coupled or not states[VIOLATION.name][0] > UNSOLVED:
            return ""
        return (
            f"friction violates Coulomb's law by {states[VIOLATION.name][0]:.2g} rad/s or m/s at some time up to "
            f"t = {t:.9g} s, expected at most {UNSOLVED:g} of a solved step"
        )


@dataclass(frozen=True, eq=False)
class LuGreFriction(JointFriction):
    """Friction by bristles, whose deflection is a state."""

    way = LUGRE
    needs: ClassVar[dict[str, Argument]] = {"bristle_stiffness": STIFFNESS, "bristle_damping": DAMPING}
    inputs = (*LAW, *needs.values())
    states = (BRISTLES,)
    solves = True

    def solve(self, at: Arithmetic, acting: tuple[Effect, ...], tau: Any) -> tuple[Any, dict[str, Any], Forces]:
        push, forces = with_torques(at, acting, tau)
        constrained = find(acting, Constrained)
        if constrained is None:
            (made,) = at.evaluate(BRISTLE_STEP, tau=push).values()
            after, bristles = made
        else:
            after, bristles, force = constrained.after_bristles(at, push)
            forces[work.CONSTRAINTS.name] = lambda way: force * constrained.rates(at, at.given["q"], way)
        forces[work.FRICTION.name] = bent(at.given, law_of(at.given), after, bristles)
        return after, {BRISTLES.name: bristles}, forces


KINDS: dict[str, type[JointFriction]] = {IMPLICIT: DryFriction, LUGRE: LuGreFriction, SMOOTH: SmoothFriction}


def with_torques(at: Arithmetic, acting: tuple[Effect, ...], push: Any) -> tuple[Any, Forces]:
    """tau plus the torques of effects at the beginning of a step, and these torques by their states of work."""
    forces: Forces = {}
    for effect, made in torques_of(acting, at, at.given["q"], at.given["v"]):
        push = push + made
        forces |= {} if effect.work is None else {effect.work.name: made}
    return push, forces


def law_of(given: Mapping[str, Any]) -> Law:
    """The coefficients of the law, which all kinds have."""
    return given["coulomb"], given["viscous"], given["static"], given["stribeck"]


def named(law: Law) -> dict[str, Any]:
    """The coefficients of a law as inputs by name."""
    return dict(zip((x.name for x in LAW), law, strict=True))


def bent(given: Mapping[str, Any], law: Law, after: Any, bristles: Any) -> Any:
    """The torques of bristles and damping in a step, from the bristles' deflections after it."""
    z, each = given[BRISTLES.name], 1.0 / given["dt"]
    moved = np.array([each * x for x in bristles - z], bristles.dtype)
    return -(given["stiffness"] * bristles + given["damping"] * moved) - law[1] * after


# --- friction of a scene --------------------------------------------------------------------------------


def friction_effects(
    model: Model, friction: Friction | bool | None, way: str, motor: Motor | None = None, drive: str = CURRENT
) -> tuple[Effect, ...]:
    """The friction and the motor of a scene.

    Raises  SimulationError for an unknown method or drive, options that contradict each other, and a missing
            coefficient; ModelError naming the joint, ShapeError.
    """
    as_word("friction_method", way, WAYS, SimulationError)
    as_word("drive", drive, DRIVES, SimulationError)
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
        return ()
    made = KINDS[way](check_friction(model, friction))
    made.values  # raises SimulationError for a coefficient that is missing
    return (made,) if motor is None else (made, Drive(check_motor(model, motor), drive))


def dry(acting: tuple[Effect, ...], nv: int) -> NDArray[np.bool_]:
    """The freedoms (nv,) that dry friction or gears may hold."""
    friction, motor = find(acting, DryFriction), find(acting, Drive)
    if friction is None:
        return np.zeros(nv, np.bool_)
    coulomb, _, static, _ = friction.friction.law
    sticks: NDArray[np.bool_] = (coulomb > 0.0) | (static > 0.0)
    return sticks if motor is None else sticks | motor.rubs
