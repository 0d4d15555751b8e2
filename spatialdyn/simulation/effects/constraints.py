"""Constraints: accelerations under them, and the projection after each step.

A step ends with one Newton step of q towards φ = 0 and with the velocity nearest to v that keeps J v = 0, both in the
metric of M; or, where a time of stabilization is given, errors die away within it and nothing is projected. What a step
finds wrong (equations that contradict others, another rank than at the beginning) makes its state infinite where the
step is recorded, so that a program rejects the sample, and raises the reason where it is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import EPS, exceeds
from ...bodies.static_table import StaticTable
from ...calls.dynamics import calls
from ...constraints.calls import CONTRADICTION, call, raise_contradiction
from ...constraints.dynamics import constrained_motion, constraint_error, constraint_jacobian, response
from ...constraints.loops import raise_if_open
from ...constraints.table import Constraints
from ...errors import ConstraintError, SimulationError
from ...model.model import Model
from ...recursions import constrained
from ...recursions.configuration import integrate
from ...recursions.constrained_friction import HELD_BRISTLES
from ...recursions.constraint_rows import CONSTRAINTS_ARGUMENT, ERROR, JACOBIAN
from ...recursions.spec import Argument
from ..arithmetic import Arithmetic
from ..symplectic import SETTLED, SWEEPS
from ..system import OK, STALLED, System, set_status
from . import work
from .effect import Effect

Array = NDArray[np.float64]
RATE = Argument("rate", (), "1/s", "1/T of the stabilization")
RANK = Argument("rank", (), "1", "independent equations at the beginning")
START = 1e-6  # largest |φ| [m | rad], and |J v| of its terms, of a state to start from
START_SOLVED = 1e-3  # the same of |J v| where steps find velocities with impulses: see ``impulse_step.meet``
LEAST_STEPS = 3.0  # of a time of stabilization; at 1 explicit methods diverge


@dataclass(frozen=True, eq=False)
class Constrained(Effect):
    """Constraints of a run.

    rate  1/T of the stabilization [1/s], None for projection
    rank  (samples or 1,) independent equations at the beginning
    """

    constraints: Constraints
    rate: float | None
    rank: NDArray[np.intp]
    name = "constraints"
    work = work.CONSTRAINTS

    @property
    def inputs(self) -> Any:
        """See ``Effect``."""
        return (CONSTRAINTS_ARGUMENT, RANK, *(() if self.rate is None else (RATE,)))

    @property
    def tables(self) -> tuple[StaticTable, ...]:
        """See ``Effect``."""
        return (self.constraints.table,)

    @property
    def values(self) -> dict[str, Array]:
        """See ``Effect``."""
        made = {"rank": self.rank.reshape((-1, 1, 1)).astype(float)}
        return made if self.rate is None else {**made, "rate": np.full((1, 1, 1), self.rate)}

    @property
    def projects(self) -> bool:
        """Whether steps end with a projection."""
        return self.rate is None

    def accelerate(self, at: Arithmetic, q: Any, v: Any, tau: Any, a: Any) -> Any:
        """Write the acceleration under the constraints; returns their force. It may raise ConstraintError."""
        if not at.recorded:
            given = np.array(q), np.array(v), np.array(tau, float)
            time = None if self.rate is None else 1.0 / self.rate
            found = constrained_motion(self.constraints.model, self.constraints, *given, time, fext=_forces(at))
            self.check_rank(found.rank, at.given["rank"])
            a[:] = found.a
            return found.force
        made = at.evaluate(constrained.MOTION, q=q, v=v, tau=tau)
        self.judge(at, made["residual"][0], made["rank"][0])
        a[:] = made["a"]
        return made["force"]

    def after_bristles(self, at: Arithmetic, tau: Any) -> tuple[Any, Any, Any]:
        """Velocities and bristles after a step of LuGre friction, and the constraints' force."""
        if not at.recorded:
            known, n = {**at.given, "tau": tau, "fext": _forces(at), "rate": self.rate}, self.constraints.model.nv
            values = [known[x.name] for x in HELD_BRISTLES.present if not x.static]
            values = [np.array(x, float) if isinstance(x, np.ndarray) else x for x in values]
            out = call(HELD_BRISTLES, self.constraints.model, self.constraints, *values)
            raise_contradiction(HELD_BRISTLES, self.constraints, out, *values)
            self.check_rank(int(out[-1]), at.given["rank"])
            return out[:n], out[n : 2 * n], out[2 * n : -2]
        made = at.evaluate(HELD_BRISTLES, tau=tau)
        self.judge(at, made["residual"][0], made["rank"][0])
        return made["ahead"], made["bristles"], made["force"]

    def judge(self, at: Any, residual: Any, rank: Any, least: float | None = None) -> None:
        """Note a contradiction, or another rank than at the beginning, in recorded numbers."""
        n, m = len(at.rows) - 1, int(at.given[CONSTRAINTS_ARGUMENT.name][0].nc)
        off = rank - at.given["rank"]
        limit = CONTRADICTION * (n + m) * EPS if least is None else least
        at.wrong = at.wrong + exceeds(residual, limit) + exceeds(off * off, 0.5)

    def of_sample(self, k: int) -> Constrained:
        """These constraints of one sample."""
        return Constrained(self.constraints, self.rate, self.rank[k : k + 1] if len(self.rank) > 1 else self.rank)

    def check_rank(self, rank: int, known: float | None = None) -> None:
        """Raise ConstraintError if the rank is not ``known``, by default that of the first sample at the beginning."""
        known = int(self.rank[0] if known is None else known)
        if rank != known:
            raise ConstraintError(
                f"the rank of {', '.join(x.label for x in self.constraints)} is {rank}, at the beginning it was "
                f"{known}: a branch point, from which the mechanism may go several ways"
            )

    def rates(self, at: Arithmetic, q: Any, v: Any) -> Any:
        """J v."""
        if not at.recorded:
            return constraint_jacobian(self.constraints.model, self.constraints, np.array(q)) @ v
        return at.evaluate(JACOBIAN, q=q)["J"] @ v

    def project(self, at: Any, q: Any, v: Any, velocities: bool) -> None:
        """Write the projected state; of q alone where the step has found velocities with impulses.

        Those meet J v⁺ = 0 there to the order of h³, in an impact h² (``impulse_step.meet``); a projection would move
        joints and points that stick.
        """
        model, held = self.constraints.model, self.constraints
        if not at.recorded:
            if self.projects:
                phi = constraint_error(model, held, q)
                q[:] = calls["integrate"](model, q, response(model, held, q, -phi, check=False)[0])
                if velocities:
                    v += response(model, held, q, -(constraint_jacobian(model, held, q) @ v), check=False)[0]
            return
        if self.projects:
            phi = at.evaluate(ERROR, q=q)["phi"]
            moved = q.copy()
            integrate(at.rows, q, at.evaluate(constrained.RESPONSE, q=q, rhs=-phi)["change"], moved)
            q[:] = moved
        if self.projects and velocities:
            v[:] = v + at.evaluate(constrained.RESPONSE, q=q, rhs=-self.rates(at, q, v))["change"]
        lost = at.wrong / exceeds(1.0, at.wrong)
        for i in range(len(v)):
            v[i] = v[i] + lost


def _forces(at: Arithmetic) -> Array | None:
    """External forces of a step, None without any."""
    forces = at.given.get("fext")
    return None if forces is None else np.array(forces)


def constrained_of(scene: Any, q: Array, v: Array, dt: float) -> Constrained | None:
    """Constraints of a run from states q (..., nq), v (..., nv), None for none. Raises if they cannot hold there.

    Steps that find velocities with impulses miss J v = 0 by the order of dt³, or dt² in an impact.
    """
    model, constraints, rate = scene.model, scene.constraints, None
    if constraints is None:
        return None
    if scene.stabilization is not None:
        rate = 1.0 / scene.stabilization
        if rate * dt * LEAST_STEPS > 1.0:
            least = f"{LEAST_STEPS:g} dt = {LEAST_STEPS * dt:g} s: shorter times are unstable"
            raise SimulationError(f"stabilization is {scene.stabilization!r} s, expected at least {least}")
    solved = scene.contacts is not None or scene.limits or (scene.solves and scene.friction_method != "lugre")
    phi = constraint_error(model, constraints, q)
    raise_if_open(constraints, q, phi, START, " at the beginning; project_configuration or close_loops closes it")
    J = constraint_jacobian(model, constraints, q)
    Jv, terms = (J @ v[..., None])[..., 0], (abs(J) @ abs(v)[..., None])[..., 0]
    for first, count in owned(constraints):  # one equation of several may be nothing but rounding
        terms[..., first : first + count] = terms[..., first : first + count].max(axis=-1, keepdims=True)
    bad = np.argwhere(abs(Jv) > (START_SOLVED if solved else START) * terms)
    if len(bad):
        index, k = tuple(int(x) for x in bad[0, :-1]), int(bad[0, -1])
        where = "" if not index else f" of sample {index[0]}"
        raise ConstraintError(
            f"v0{where} moves {constraints.equations[k].label} at {Jv[(*index, k)]:.3g}, expected 0; "
            "project_velocity gives the nearest velocity that does not"
        )
    rank = np.asarray(response(model, constraints, q, np.zeros(phi.shape), check=False)[3], np.intp)
    return Constrained(constraints, rate, rank.reshape(-1))


def owned(constraints: Constraints) -> Iterator[tuple[int, int]]:
    """Of each constraint its first equation and how many it has."""
    first = 0
    for _, of_one in groupby(constraints.equations, key=lambda x: id(x.constraint)):
        count = len([*of_one])
        yield first, count
        first += count


# --- symplectic methods ----------------------------------------------------------------------------------


def closed(
    held: Constrained, model: Model, system: System, t: float, q: Array, settle: Callable[[], Array],
    add: Callable[[Array], None],
) -> Array:  # fmt: skip
    """The positions at the end of a step of a symplectic method, where φ = 0: Newton's steps on its multipliers.

    settle  positions at the end with the multipliers so far
    add     adds to them what changes those positions by -φ, an impulse over a time of 1

    Writes the status STALLED if φ stays. It raises ConstraintError.
    """
    constraints, before = held.constraints, np.inf
    for sweep in range(SWEEPS):
        ahead = settle()
        phi = constraint_error(model, constraints, ahead)
        size = float(abs(phi).max(initial=0.0))
        if system.status[0] != OK or size <= EPS or (size <= SETTLED and size >= 0.5 * before):
            break
        if sweep == SWEEPS - 1:
            set_status(system, STALLED, t, size)
        before = size
        _, impulse, _, rank = response(model, constraints, q, -phi, check=False)
        held.check_rank(rank)
        add(impulse)
    return ahead


def momentum_along(held: Constrained, model: Model, q: Array, p: Array) -> Array:
    """The momenta nearest to p whose velocities keep J v = 0."""
    v = calls["velocity_from_momentum"](model, q, p)
    Jv = constraint_jacobian(model, held.constraints, q) @ v
    made: Array = calls["momentum"](model, q, v + response(model, held.constraints, q, -Jv, check=False)[0])
    return made
