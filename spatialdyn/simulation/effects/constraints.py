"""Constraints: accelerations under them, and the projection after each step.

A step ends with one Newton step of q towards φ = 0 and with the velocity nearest to v that keeps J v = 0, both in the
metric of M. With a stabilization time T, errors decay like exp(-t/T) instead and nothing is projected. A step refuses
equations that contradict others, and another rank than at the beginning.

If equations depend on others, each step first chooses the equations to keep: as many as were independent at the
beginning of the run. Its stages and its projection use these. The stages violate the constraints by the error of the
step, so rank and contradiction are judged at its beginning only. The violation that a projection leaves is judged
relative to the violation that it removed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import exceeds, select
from ...bodies.static_table import StaticTable
from ...constraints.calls import call
from ...constraints.dynamics import FLOOR, constrained_motion, rate_terms, rows_to_keep
from ...constraints.kinds import HingeConstraint, WeldConstraint
from ...constraints.loops import raise_if_open
from ...constraints.table import Constraints
from ...errors import ConstraintError, SimulationError, literal
from ...recursions.constraints import constrained
from ...recursions.constraints.constrained_friction import HELD_BRISTLES
from ...recursions.constraints.constraint_rows import CONSTRAINTS_ARGUMENT, ERROR, JACOBIAN
from ...recursions.spec import FEXT, Argument
from ..arithmetic import Arithmetic
from ..methods.iteration import largest
from ..system import System, set_status
from . import work
from .effect import Effect

Array = NDArray[np.float64]
RATE = Argument("rate", (), "1/s", "1/T of the stabilization")
RANK = Argument("rank", (), "1", "independent equations at the beginning")
CHOSEN, UNJUDGED = constrained.CHOSEN.name, "unjudged"  # given in a step
START = 1e-6  # largest |φ| [m | rad], and |J v| relative to its terms, of an initial state
START_SOLVED = 1e-3  # the same for |J v| where steps solve for velocities with impulses: see ``impulse_step.meet``
CONTRADICTS = 1e-4  # relative to the motion: residual of dependent equations at the beginning of a step
LEFT = 0.1  # largest part of the violation that may stay after a projection, which leaves about its square
LEAST_STEPS = 3.0  # in a stabilization time; at 1 explicit methods diverge


@dataclass(frozen=True, eq=False)
class Constrained(Effect):
    """Constraints of a run.

    rate  1/T of the stabilization [1/s]; None for projection
    rank  (samples or 1,) number of independent equations at the beginning
    """

    constraints: Constraints
    rate: float | None
    rank: NDArray[np.intp]
    name = "constraints"
    work = work.CONSTRAINTS

    @cached_property
    def inputs(self) -> Any:
        return (CONSTRAINTS_ARGUMENT, RANK, *(() if self.projects else (RATE,)))

    @cached_property
    def tables(self) -> tuple[StaticTable, ...]:
        return (self.constraints.table,)

    @cached_property
    def values(self) -> dict[str, Array]:
        made = {"rank": self.rank.reshape((-1, 1, 1)).astype(float)}
        return made if self.rate is None else {**made, "rate": np.full((1, 1, 1), self.rate)}

    @property
    def projects(self) -> bool:
        """Whether steps end with a projection."""
        return self.rate is None

    @cached_property
    def form(self) -> tuple[Any, ...]:
        return (self.chooses,)

    @cached_property
    def chooses(self) -> bool:
        """Whether equations of a sample depend on others, so that steps choose the equations to keep."""
        return bool((self.rank < self.constraints.nc).any())

    # --- in a step --------------------------------------------------------------------------------------

    def begin(self, at: Arithmetic, q: Any) -> None:
        """Choose the equations to keep through a step from q."""
        if self.chooses:
            made = at.evaluate(constrained.ROWS, q=q)
            at.given.update({CHOSEN: made[CHOSEN], UNJUDGED: True})
            self._judge_rank(at, made[RANK.name][0])

    def accelerate(self, at: Arithmetic, q: Any, v: Any, tau: Any, a: Any) -> Any:
        """Write the acceleration under the constraints; returns their force."""
        alone = self.chooses and CHOSEN not in at.given  # no step has begun: a method without steps of its own
        if alone:
            self.begin(at, q)
        made = at.evaluate(constrained.MOTION, q=q, v=v, tau=tau)
        self._judge_motion(at, (q, v, tau), made)
        if alone:
            del at.given[CHOSEN]
        a[:] = made["a"]
        return made["force"]

    def after_bristles(self, at: Arithmetic, tau: Any) -> tuple[Any, Any, Any]:
        """Velocities and bristles after a step of LuGre friction, and the constraints' force."""
        made = at.evaluate(HELD_BRISTLES, tau=tau)
        self._judge_motion(at, (at.given["q"], at.given["v"], tau), made)
        return made["ahead"], made["bristles"], made["force"]

    def rates(self, at: Arithmetic, q: Any, v: Any) -> Any:
        """J v."""
        return at.evaluate(JACOBIAN, q=q)["J"] @ v

    def project(self, at: Arithmetic, system: System, t: Any, q: Any, v: Any, velocities: bool) -> None:
        """Write the projected state; only q if the step has solved for velocities with impulses.

        Those velocities meet J v⁺ = 0 to the order of h³, in an impact h² (``impulse_step.meet``); projecting them
        would move joints and points that stick.
        """
        phi, ahead = at.evaluate(ERROR, q=q)["phi"], q.copy()
        change = at.evaluate(constrained.RESPONSE, q=q, rhs=-phi)["change"]
        set_status(system, system.kernels.integrate(system.table, q, change, ahead), t)
        q[:] = ahead
        if self.chooses:
            self.judge_closed(at, phi, at.evaluate(ERROR, q=q)["phi"])
        if velocities:
            v[:] = v + at.evaluate(constrained.RESPONSE, q=q, rhs=-self.rates(at, q, v))["change"]

    # --- judged -----------------------------------------------------------------------------------------

    def _judge_motion(self, at: Arithmetic, state: tuple[Any, Any, Any], made: dict[str, Any]) -> None:
        """Refuse a contradiction at the beginning of a step; if no equations are chosen, another rank."""
        if CHOSEN not in at.given:
            self._judge_rank(at, made["rank"][0])
        elif at.given.pop(UNJUDGED, False):
            self._judge_residual(at, state, made["residual"][0])

    def judge(self, at: Arithmetic, state: tuple[Any, Any, Any], residual: Any, rank: Any) -> None:
        """Refuse a contradiction in a step from q, v under tau, or another rank than at the beginning."""
        self._judge_residual(at, state, residual)
        self._judge_rank(at, rank)

    def _judge_residual(self, at: Arithmetic, state: tuple[Any, Any, Any], residual: Any) -> None:
        at.refuse(exceeds(residual, CONTRADICTS), lambda: self._raise_contradiction(at, state, residual))

    def _judge_rank(self, at: Arithmetic, rank: Any) -> None:
        known = at.given[RANK.name]
        off = rank - known
        at.refuse(exceeds(off * off, 0.5), lambda: self._raise_rank(rank, known))

    def judge_closed(self, at: Arithmetic, opened: Any, left: Any) -> None:
        """Refuse equations that stay violated after a projection; opened, left: φ before and after it."""
        most = LEFT * largest(abs(opened))
        least = select(most - START, most, START)
        bad = exceeds(largest(abs(left)), least)
        at.refuse(bad, lambda: self._raise_open(at.given[CHOSEN], left, abs(left) > least))

    def _raise_rank(self, rank: Any, known: Any) -> None:
        raise ConstraintError(
            f"the rank of {self._labels} is {int(rank)}, at the beginning it was {int(known)}: a branch point, from "
            "which the mechanism may go several ways"
        )

    def _raise_contradiction(self, at: Arithmetic, state: tuple[Any, Any, Any], residual: Any) -> None:
        """Raise ConstraintError, naming the equations that contradict others if a call finds them, or another rank."""
        time = None if self.rate is None else 1.0 / self.rate
        found = constrained_motion(self.constraints.model, self.constraints, *state, time, fext=at.given.get(FEXT.name))
        self._judge_rank(at, found.rank)
        raise ConstraintError(
            f"equations of {self._labels} contradict each other by {residual:.2g} of the motion, expected fewer "
            "constraints, or a state that meets them"
        )

    def _raise_open(self, chosen: Array, left: Array, open_: NDArray[np.bool_]) -> None:
        bad = dict.fromkeys(self.constraints.equations[k].label for k in np.flatnonzero(open_))
        raise ConstraintError(
            f"{', '.join(bad)} contradict{'s' * (len(bad) == 1)} the other constraints: {int(chosen.sum())} of "
            f"{len(chosen)} equations are independent, and with those closed these stay open by {abs(left).max():.2g} "
            "m or rad; expected fewer constraints, or a smaller dt"
        )

    @property
    def _labels(self) -> str:
        return ", ".join(x.label for x in self.constraints)

    # --- of methods in momenta --------------------------------------------------------------------------

    def rows(self, q: Array) -> Array:
        """The equations to keep at q of the first sample. Raises ConstraintError if the rank has changed."""
        chosen, rank = rows_to_keep(self.constraints.model, self.constraints, q, float(self.rank[0]))
        if int(rank) != self.rank[0]:
            self._raise_rank(rank, self.rank[0])
        return chosen

    def of_sample(self, k: int) -> Constrained:
        """These constraints of one sample."""
        return Constrained(self.constraints, self.rate, self.rank[k : k + 1] if len(self.rank) > 1 else self.rank)


def constrained_of(scene: Any, q: Array, v: Array, dt: float) -> Constrained:
    """Constraints of a run from states q (..., nq), v (..., nv). Raises if these states cannot meet the constraints.

    Steps that solve for velocities with impulses miss J v = 0 by the order of dt³, or dt² in an impact.
    """
    model, constraints, rate = scene.model, scene.constraints, None
    if scene.stabilization is not None:
        rate = 1.0 / scene.stabilization
        if rate * dt * LEAST_STEPS > 1.0:
            least = f"{LEAST_STEPS:g} dt = {LEAST_STEPS * dt:g} s: shorter times are unstable"
            raise SimulationError(f"stabilization is {literal(scene.stabilization)} s, expected at least {least}")
    solved = scene.contacts is not None or scene.limits or (scene.solves and scene.friction_method != "lugre")
    phi = call(ERROR, model, constraints, q)
    turns = any(isinstance(x, (HingeConstraint, WeldConstraint)) for x in constraints.items)  # by half, perhaps
    if turns or not (abs(phi) <= START).all():
        raise_if_open(constraints, q, phi, START, " at the beginning; project_configuration or close_loops closes it")
    J = call(JACOBIAN, model, constraints, q)
    Jv = (J @ v[..., None])[..., 0]
    if not (abs(Jv) <= FLOOR).all():
        _check_rates(constraints, Jv, (START_SOLVED if solved else START) * rate_terms(constraints, J, v) + FLOOR)
    rank = np.asarray(call(constrained.ROWS, model, constraints, q, None)[..., -1], np.intp).reshape(-1)
    return Constrained(constraints, rate, rank[:1] if (rank == rank[:1]).all() else rank)


def _check_rates(constraints: Constraints, rates: Array, most: Array) -> None:
    """Raise ConstraintError naming the first equation and sample whose |J v| is above ``most``."""
    bad = np.argwhere(abs(rates) > most)
    if len(bad):
        index, k = tuple(int(x) for x in bad[0, :-1]), int(bad[0, -1])
        where = "" if not index else f" of sample {index[0]}"
        raise ConstraintError(
            f"v0{where} moves {constraints.equations[k].label} at {rates[(*index, k)]:.3g}, expected 0; "
            "project_velocity gives the nearest velocity that does not"
        )
