"""Steps under constraints: the explicit methods with constrained accelerations, and the projection after each step.

A step ends with one Newton step of q towards φ = 0 and with the velocity nearest to v that keeps J v = 0, both in the
metric of M; or, where a time of stabilization is given, errors die away within it and nothing is projected. What a step
finds wrong (equations that contradict others, another rank than at the beginning) makes its state infinite, so that
a program rejects the sample, and the step done by calls raises the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import EPS, exceeds
from ..calls.dynamics import calls
from ..constraints.calls import CONTRADICTION, call, raise_contradiction
from ..constraints.dynamics import (
    ConstrainedMotion,
    constrained_motion,
    constraint_error,
    constraint_jacobian,
    response,
)
from ..constraints.loops import raise_if_open
from ..constraints.table import Constraints
from ..engines.programs.tracer import scratch
from ..errors import ConstraintError, SimulationError
from ..model.model import Model
from ..recursions import constrained, constraint_rows, energy
from ..recursions.configuration import integrate
from ..recursions.constrained_friction import HELD_BRISTLES
from ..recursions.constraint_rows import CONSTRAINTS_ARGUMENT
from ..recursions.spec import Argument, Spec, shape_in, sizes_of
from .symplectic import SETTLED, SWEEPS
from .system import OK, STALLED, State, System, set_status

Array = NDArray[np.float64]
RATE = Argument("rate", (), "1/s", "1/T of the stabilization")
RANK = Argument("rank", (), "1", "independent equations at the beginning")
START = 1e-6  # largest |φ| [m | rad], and |J v| of its terms, of a state to start from
START_SOLVED = 1e-3  # the same of |J v| where steps find velocities with impulses: see ``impulse_step.meet``
LEAST_STEPS = 3.0  # of a time of stabilization; at 1 explicit methods diverge


class Held(NamedTuple):
    """Constraints of a run: their rate of stabilization, None for projection, and rank (B,) of each start."""

    constraints: Constraints
    rate: float | None
    rank: NDArray[np.intp]

    @property
    def inputs(self) -> tuple[Argument, ...]:
        """The inputs that a step takes last."""
        return (CONSTRAINTS_ARGUMENT, RANK, *(() if self.rate is None else (RATE,)))

    @property
    def values(self) -> dict[str, Array]:
        """Values (samples, steps, 1) of those that are no table."""
        made = {"rank": self.rank.reshape((-1, 1, 1)).astype(float)}
        return made if self.rate is None else {**made, "rate": np.full((1, 1, 1), self.rate)}


def held_by(scene: Any, q: Array, v: Array, dt: float) -> Held | None:
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
    rubs = scene.rubs
    solved = scene.contacts is not None or scene.limits or (rubs is not None and rubs.way == "implicit")
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
    return Held(constraints, rate, rank.reshape(-1))


def owned(constraints: Constraints) -> Iterator[tuple[int, int]]:
    """Of each constraint its first equation and how many it has."""
    first = 0
    for _, of_one in groupby(constraints.equations, key=lambda x: id(x.constraint)):
        count = len([*of_one])
        yield first, count
        first += count


# --- steps by calls --------------------------------------------------------------------------------------


def motion_under(held: Held, model: Model, fext: Array | None = None) -> Callable[..., ConstrainedMotion]:
    """``(system, q, v) -> ConstrainedMotion`` by calls. It raises ConstraintError."""
    time, known = None if held.rate is None else 1.0 / held.rate, int(held.rank[0])

    def motion(system: System, q: Array, v: Array) -> ConstrainedMotion:
        given = np.array(q), np.array(v), system.tau.copy()
        found = constrained_motion(model, held.constraints, *given, time, fext=fext)
        check_rank(held, found.rank, known)
        return found

    return motion


def accelerate(held: Held, model: Model, fext: Array | None = None) -> Callable[..., int]:
    """``accelerate(system, q, v, a) -> OK`` by calls. It raises ConstraintError."""
    motion = motion_under(held, model, fext)

    def found(system: System, q: Array, v: Array, a: Array) -> int:
        a[:] = motion(system, q, v).a
        return OK

    return found


def check_rank(held: Held, rank: int, known: int) -> None:
    """Raise ConstraintError if the rank is not what it was at the beginning."""
    if rank != known:
        raise ConstraintError(
            f"the rank of {', '.join(x.label for x in held.constraints)} is {rank}, at the beginning it was {known}: a "
            "branch point, from which the mechanism may go several ways"
        )


def project(held: Held, model: Model, q: Array, v: Array, velocities: bool = True) -> None:
    """Write the projected state to q and v, by calls; to q alone where the step has found velocities with impulses.

    Those meet J v⁺ = 0 there to the order of h³, in an impact h² (``impulse_step.meet``); a projection would move
    joints and points that stick.
    """
    if held.rate is None:
        constraints = held.constraints
        phi = constraint_error(model, constraints, q)
        q[:] = calls["integrate"](model, q, response(model, constraints, q, -phi, check=False)[0])
        if not velocities:
            return
        Jv = constraint_jacobian(model, constraints, q) @ v
        v += response(model, constraints, q, -Jv, check=False)[0]


def projected(advance: Callable[..., None], held: Held, model: Model) -> Callable[..., None]:
    """A method's step, and the projection after it."""

    def step(system: System, t: float, h: float, state: State) -> None:
        advance(system, t, h, state)
        if system.status[0] == OK and np.isfinite(state.q).all() and np.isfinite(state.w).all():
            project(held, model, state.q, state.w)

    return step


def bristles_held(
    held: Held, model: Model, law: dict[str, Array], fext: Array | None
) -> Callable[[System, float, State, Array], tuple[Array, Array, Array]]:
    """``(system, h, state, z) -> v⁺, z⁺, the constraints' force`` of a step of LuGre friction, by calls.

    law  its coefficients by name. It raises ConstraintError.
    """
    known, constraints, n = int(held.rank[0]), held.constraints, model.nv

    def solve(system: System, h: float, state: State, z: Array) -> tuple[Array, Array, Array]:
        given = {"q": state.q, "v": state.w, "bristles": z, "tau": system.tau, "fext": fext, "dt": h, "rate": held.rate}
        values = [(law | given)[x.name] for x in HELD_BRISTLES.present if not x.static]
        values = [x.copy() if isinstance(x, np.ndarray) else x for x in values]
        out = call(HELD_BRISTLES, model, constraints, *values)
        raise_contradiction(HELD_BRISTLES, constraints, out, *values)
        check_rank(held, int(out[-1]), known)
        return out[:n], out[n : 2 * n], out[2 * n : -2]

    return solve


def closed(
    held: Held, model: Model, system: System, t: float, q: Array, settle: Callable[[], Array],
    add: Callable[[Array], None],
) -> Array:  # fmt: skip
    """The positions at the end of a step of a symplectic method, where φ = 0: Newton's steps on its multipliers.

    settle  positions at the end with the multipliers so far
    add     adds to them what changes those positions by -φ, an impulse over a time of 1

    Writes the status STALLED if φ stays. It raises ConstraintError.
    """
    constraints, known, before = held.constraints, int(held.rank[0]), np.inf
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
        check_rank(held, rank, known)
        add(impulse)
    return ahead


def momentum_along(held: Held, model: Model, q: Array, p: Array) -> Array:
    """The momenta nearest to p whose velocities keep J v = 0."""
    v = calls["velocity_from_momentum"](model, q, p)
    Jv = constraint_jacobian(model, held.constraints, q) @ v
    made: Array = calls["momentum"](model, q, v + response(model, held.constraints, q, -Jv, check=False)[0])
    return made


# --- steps on rows, which record -------------------------------------------------------------------------


class Rows:
    """The steps on a table of Rows: what ``accelerate`` and ``projected`` do by calls, and what is found wrong."""

    def __init__(self, rows: Any, inputs: dict[str, Any]) -> None:
        """The inputs of a step by name."""
        self.rows, self.constraints = rows, inputs["constraints"]
        self.rate, self.rank, self.wrong = inputs.get("rate"), inputs["rank"], 0.0
        self.n, self.m = len(rows) - 1, int(self.constraints[0].nc)
        self.least = CONTRADICTION * (self.n + self.m) * EPS
        self.force: Any = None  # of the equations, at the last acceleration

    def _run(self, spec: Spec, *inputs: Any) -> list[Any]:
        """The outputs of a Spec with parts, optional inputs None."""
        sizes = sizes_of(self.rows, [(CONSTRAINTS_ARGUMENT, self.constraints)])
        out = np.full(shape_in(spec.output.shape, sizes), 0.0, dtype=object)
        beside = [np.zeros(shape, object) for shape in spec.extra_outputs(sizes)]
        parts = spec.split(out, sizes)
        spec.recursion(self.rows, scratch(spec.work, self.n + 1), *inputs, *parts, *beside)
        return parts

    def accelerate(self, system: System, q: Any, v: Any, a: Any) -> int:
        """a under the constraints."""
        found, self.force, residual, rank = self._run(
            constrained.MOTION, q, v, system.tau, None, self.constraints, self.rate
        )
        self._judge(residual[0], rank[0])
        a[:] = found
        return OK

    def after_bristles(self, given: dict[str, Any], tau: Any) -> tuple[Any, Any]:
        """Velocities and bristles after a step of LuGre friction, of ``given`` inputs by name."""
        held = given | {"tau": tau, "fext": None, "constraints": self.constraints, "rate": self.rate}
        inputs = [held[x.name] for x in HELD_BRISTLES.present]
        ahead, bristles, self.force, residual, rank = self._run(HELD_BRISTLES, *inputs)
        self._judge(residual[0], rank[0])
        return ahead, bristles

    def _judge(self, residual: Any, rank: Any) -> None:
        """Note a contradiction, or another rank than at the beginning."""
        off = rank - self.rank
        self.wrong = self.wrong + exceeds(residual, self.least) + exceeds(off * off, 0.5)

    def rates(self, q: Any, v: Any) -> Any:
        """J v."""
        J = np.zeros((self.m, self.n), object)
        constraint_rows.constraint_jacobian(
            self.rows, scratch(constraint_rows.WORK, self.n + 1), q, self.constraints, J
        )
        return J @ v

    def energy(self, q: Any, v: Any) -> Any:
        """T + V, but for a constant."""
        T, V = np.zeros(1, object), np.zeros(1, object)
        energy.kinetic_energy(self.rows, scratch(energy.WORK_KINETIC, self.n + 1), q, v, T)
        energy.potential_energy(self.rows, scratch(energy.WORK_MOMENT, self.n + 1), q, V)
        return T + V

    def project(self, q: Any, w: Any, velocities: bool = True) -> None:
        """Write the projected state, as ``project`` by calls, infinite if something is wrong."""
        rows, n = self.rows, self.n
        if self.rate is None:
            work, phi = scratch(constraint_rows.WORK, n + 1), np.zeros(self.m, object)
            constraint_rows.constraint_error(rows, work, q, self.constraints, phi)
            change = self._run(constrained.RESPONSE, q, -phi, self.constraints)[0]
            moved = q.copy()
            integrate(rows, q, change, moved)
            q[:] = moved
        if self.rate is None and velocities:
            w[:] = w + self._run(constrained.RESPONSE, q, -self.rates(q, w), self.constraints)[0]
        lost = self.wrong / exceeds(1.0, self.wrong)
        for i in range(n):
            w[i] = w[i] + lost
