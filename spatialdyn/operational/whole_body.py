"""``WholeBody``: joint torques of a robot on its feet, by a quadratic program of accelerations and contact forces.

    min  Σ w_k |J_k a + J̇_k v - a_k*|² + w_f |f|² + ε |a|²
    s.t. M_b a + h_b = J_bᵀ f                       freedoms without a motor, such as the base
         J_c a + J̇_c v = -D J_c v                   feet that stand
         |f_t| <= μ/√2 f_n,  0 <= f_n               pyramids within the cones
         -τ_max <= M_a a + h_a - J_aᵀ f <= τ_max
         least(q, v) <= a <= most(q, v)             position and velocity limits

The torque τ = M_a a + h_a - J_aᵀ f is not a variable. Source: after Del Prete, Mansard, Ramos, Stasse and Nori,
Implementing torque control with high-ratio gear boxes and without joint-torque sensors (2016), the form of TSID.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_finite, as_number, as_word, as_words, check_model
from ..calls.dynamics import calls
from ..constraints.contact_points import Contacts
from ..errors import ConstraintError, ModelError, ShapeError, SpatialDynError, literal
from ..model.motion_limits import position_limits, velocity_limits
from ..recursions.control.whole_body import FAR
from ..simulation.effects.motor import CURRENT
from ..simulation.scene import Scene
from .feet import feet_of
from .goals import Goals, Joints, goals_of, terms_of
from .hierarchy import check_tasks
from .quadratic import EQUAL, NONE, Program, Relaxation, check_solver, relax, residual, solve
from .standing import Standing
from .tasks import Rows, Task
from .terms import State, Terms

Array = NDArray[np.float64]
LIMITS = ("torque", "velocity", "position")
FORCES, MOTION = 1e-4, 1e-6  # weights of (f/weight)² and of a²
KEPT = 1e-8  # relative to the largest singular value: higher tasks have the directions above
MOST_TERMS = 64  # sets of frames whose programs a WholeBody caches


class WholeBodyMotion(NamedTuple):
    """The motion of a whole body at a state.

    tau       (nv,)   torques, 0 for a floating base [N m | N]
    a         (nv,)   joint accelerations
    forces    (k, 3)  forces of the ground on the points that stand, in the world [N]
    points    names of these points
    missed    for each task (m,): J a + J̇ v - a*
    relaxed   relaxed limits, the largest relaxation first; empty if all limits hold
    residual  violation of equations and limits, relative to their terms
    """

    tau: Array
    a: Array
    forces: Array
    points: tuple[str, ...]
    missed: tuple[Array, ...]
    relaxed: tuple[Relaxation, ...]
    residual: float


class WholeBody:
    """Whole-body control: tasks for a robot that stands on the contacts of its scene.

    scene       Scene with Contacts, whose points are the feet; or a Model for a robot without feet
    tasks       FrameTask, ComTask, PostureTask, or any object with their methods: weighted within one ``priority``, and
                in strict order of priorities, 0 first
    limits      which of torque, velocity and position limits of the model hold; () for none
    dt          step over which torques are held [s]: velocity and position limits look ahead by it
    brake       acceleration with which joints can be stopped before their position limits [rad/s² | m/s²]
    standing    "all": every point stands. A distance [m]: the points at most this far from the ground stand
    damping     D, by which slipping feet are slowed [1/s]
    force_weight, motion_weight  weights of squared forces, in shares of the robot's weight, and of squared
                accelerations: they select one of the solutions that tasks allow, and shift the forces slightly
    largest     largest normal force of a point [N]; no limit if left out
    solver      "daqp", or the name of another solver of qpsolvers that is installed
    infeasible  "raise", or "relax": take the smallest relaxation of limits, and report it

    ``solve(q, v)`` is a WholeBodyMotion; the object itself is a torque function of ``simulate``, held over a step of
    contacts: ``sd.simulate(scene, q, v, 5.0, 2e-3, torque=whole_body)``. Every answer of the solver is checked. Limits
    of joints that mimic others hold too. Freedoms without a motor have no torque; with the scene's Motor torques are at
    most those that it gives at rest. Losses of motors and friction of joints are not compensated. Over a Heightfield
    each point has the axes of the ground below it.
    Raises  ModelError, ConstraintError and SpatialDynError naming what does not fit; ``solve`` ConstraintError with the
            smallest relaxation, by name, if the limits allow no solution

    >>> import numpy as np, spatialdyn as sd
    >>> solid = (2.0, (0, 0, 0), 0.02 * np.eye(3))
    >>> b = sd.ModelBuilder("box", "world").add_body("box", None, "floating", inertia=solid)
    >>> for k, (x, y) in enumerate([(0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1)]):
    ...     b = b.add_body(f"corner{k}", "box", "fixed", placement=(x, y, -0.1))
    >>> model = b.build()
    >>> scene = sd.Scene(model, contacts=sd.Contacts(model, {f"corner{k}": 0.0 for k in range(4)}))
    >>> q = sd.neutral(model)
    >>> q[2] = 0.1
    >>> stand = sd.WholeBody(scene, sd.ComTask([0, 0, 0.1]))
    >>> float(stand.solve(q, np.zeros(6)).forces[:, 2].sum().round(3))
    19.62
    """

    def __init__(
        self, scene: Any, tasks: Task | Iterable[Task], limits: Any = LIMITS, *, dt: float = 1e-3, brake: float = 20.0,
        standing: Any = "all", damping: float = 20.0, force_weight: float = FORCES, motion_weight: float = MOTION,
        largest: float | None = None, solver: str = "daqp", infeasible: str = "raise",
    ) -> None:  # fmt: skip
        """See the class."""
        self.scene = scene if isinstance(scene, Scene) else Scene(check_model(scene))
        self.model = model = self.scene.model
        if self.scene.constraints is not None:
            raise ConstraintError("the scene has constraints, expected none beside contacts for WholeBody")
        if self.scene.motor is not None and self.scene.drive != CURRENT:
            raise ModelError(f"the scene's motors are driven by {self.scene.drive}, expected {CURRENT}: torques")
        self.tasks = check_tasks(model, tasks)
        self.limits = as_words("limits", [] if limits is None or limits is False else limits, LIMITS)
        self.dt, self.brake, self.damping = (
            _positive(name, x) for name, x in (("dt", dt), ("brake", brake), ("damping", damping))
        )
        self.force_weight, self.motion_weight = (
            _positive(name, x) for name, x in (("force_weight", force_weight), ("motion_weight", motion_weight))
        )
        whole = isinstance(standing, str) and standing == "all"
        self.standing = standing if whole else _positive("standing", standing)
        self.largest = math.inf if largest is None else _positive("largest", largest)
        self.infeasible = as_word("infeasible", infeasible, ("raise", "relax"))
        self.solver = check_solver(solver)
        floats = [x for x in model.joints[1:] if x.kind == "floating" and x.parent == 0]
        self.base = 6 if floats else 0
        self.weight = max(float(np.linalg.norm(model.gravity)) * model.total_mass, 1e-300)
        given = self.scene.contacts
        self.contacts = Contacts(model, {}) if given is None else given
        for name in self.contacts.names:
            _carries(model, name)
        self._feet = feet_of(model, self.contacts)
        self._settings, self._friction = self._constants(), np.array(self.contacts.friction, np.float64)
        axes = self.contacts.table.rows[0]["axes"]
        self._axes = np.array([[axes[letter + column] for column in "xyz"] for letter in "xyz"])
        self._standing: dict[tuple[int, ...], Standing] = {}
        self._terms: dict[Any, Terms] = {}
        self._postures: dict[Any, Joints] = {}
        self._called: tuple[Any, Array] = None, np.zeros(0)
        self._whole = self._at(tuple(range(len(self.contacts))))
        self._goals = self._asked(self.tasks)

    def _constants(self) -> tuple[Array, Array]:
        """The settings of the program that are the same at every state."""
        model, n = self.model, self.model.nv
        lower, upper, fastest, effort = np.full(n, -FAR), np.full(n, FAR), np.full(n, FAR), np.array(model.effort_limit)
        if "position" in self.limits:
            least, most = position_limits(model)
            stops = [(x.idx_v, x.idx_q) for x in model.joints[1:] if x.nq == x.nv == 1 and x.mimic is None]
            at_v, at_q = np.array(stops, np.intp).reshape(-1, 2).T
            lower[at_v], upper[at_v] = np.maximum(least[at_q], -FAR), np.minimum(most[at_q], FAR)
        if "velocity" in self.limits:
            fastest = np.minimum(velocity_limits(model), FAR)
        effort = np.where(effort > 0.0, effort, np.inf)
        passive = np.arange(n) < self.base
        if self.scene.motor is not None:
            stall = self.scene.motor.stall_torque
            passive = passive | (stall == 0.0)
            effort = np.minimum(np.minimum(effort, self.scene.motor.torque), np.where(stall > 0.0, stall, np.inf))
        driven = np.isfinite(effort) & ~passive & ("torque" in self.limits)
        self.unit = 1.0 / np.where(driven, effort, self.weight)
        self.limit = np.where(driven, 1.0, np.where(passive, 0.0, FAR))
        largest = min(self.largest / self.weight, FAR)
        numbers = self.weight, self.brake, self.damping, self.dt, largest, self.motion_weight, self.force_weight
        return np.array([lower, upper, fastest, self.unit, self.limit]), np.array(numbers)

    def __call__(self, t: float, q: ArrayLike, v: ArrayLike) -> Array:
        """The torque (nv,) at a state: a torque function of ``simulate``, which calls it again for each record."""
        q, v = self._one(q, v)
        key = t, q.tobytes(), v.tobytes()
        called = self._called  # of any thread
        if key != called[0]:
            called = self._called = key, self.solve(q, v).tau
        return called[1].copy()

    def __repr__(self) -> str:
        tasks = ", ".join(f"{x.name}" for x in self.tasks)
        return f"<WholeBody of {self.model.name}: {tasks}; {', '.join(self.limits) or 'no'} limits; {self.solver}>"

    def solve(self, q: ArrayLike, v: ArrayLike, tasks: Task | Iterable[Task] | None = None) -> WholeBodyMotion:
        """The motion at q (nq,), v (nv,); ``tasks`` replace those of the constructor. Raises as the class."""
        q, v = self._one(q, v)
        goals = self._goals if tasks is None else self._asked(check_tasks(self.model, tasks))
        state, fixed = self._state(goals, q, v)
        rows = goals.rows(state, q, v)
        program = self._program(goals, fixed, state, rows)
        levels = sorted({int(task.priority) for task in goals.tasks})
        if len(levels) == 1:
            x, relaxed, off = self._settled(program)
        else:
            x, relaxed = self._in_order(program, goals.tasks, rows, levels)
            off = residual(relaxed[0], x)
        return self._motion(x, state, fixed, rows, relaxed[1], off)

    def program(self, q: ArrayLike, v: ArrayLike) -> Program:
        """The quadratic program at q (nq,), v (nv,), of all tasks at once. Raises ShapeError, NonFiniteError."""
        q, v = self._one(q, v)
        state, fixed = self._state(self._goals, q, v)
        return self._program(self._goals, fixed, state, self._goals.rows(state, q, v) if self._goals.others else [])

    # --- the program ----------------------------------------------------------------------------------------

    def _one(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """One state. Raises ShapeError, NonFiniteError."""
        q, v = as_finite("q", q), as_finite("v", v)
        for name, x, size in (("q", q, self.model.nq), ("v", v, self.model.nv)):
            if x.shape != (size,):
                raise ShapeError(f"{name} has shape {x.shape}, expected ({size},): one state")
        return q, v

    def _asked(self, tasks: Sequence[Any]) -> Goals:
        """The goals of tasks, and the call that computes their terms."""
        if len(self._terms) >= MOST_TERMS:
            self._terms.clear()
        terms = terms_of(self.model, self.contacts, self._feet, tasks, self._terms)
        return goals_of(tasks, terms, self._postures)

    def _state(self, goals: Goals, q: Array, v: Array) -> tuple[State, Standing]:
        """The program of all points at a state, and the points that stand."""
        state = goals.terms(q, v, *self._settings, *goals.inputs, self._friction)
        if isinstance(self.standing, str):
            return state, self._whole
        return state, self._at(tuple(np.flatnonzero(state.gap <= self.standing).tolist()))

    def _at(self, at: tuple[int, ...]) -> Standing:
        """The constant parts for these points."""
        if at not in self._standing:
            self._standing[at] = Standing.of(self, self._feet, at)
        return self._standing[at]

    def _program(self, goals: Goals, fixed: Standing, x: State, rows: Sequence[Rows]) -> Program:
        """The program with all tasks."""
        P, g = x.P, x.g
        for k in goals.others:
            _add(P, g, goals.tasks[k], rows[k])
        if not fixed.whole:
            P, g = P[np.ix_(fixed.columns, fixed.columns)], g[fixed.columns]
        return Program(P, g, *fixed.program(x), fixed.sense, fixed.names, fixed.size)

    def _alone(self, p: Program, tasks: Sequence[Any], rows: Sequence[Rows]) -> Program:
        """The program with these tasks instead of its own."""
        n, size = self.model.nv, len(p.g)
        P, g = np.diag(np.r_[np.full(n, self.motion_weight), np.full(size - n, self.force_weight)]), np.zeros(size)
        for task, row in zip(tasks, rows, strict=True):
            _add(P, g, task, row)
        return p._replace(P=P, g=g)

    def _settled(self, program: Program) -> tuple[Array, tuple[Program, list[Relaxation]], float]:
        """The answer, with limits relaxed if need be, and its residual."""
        x, off = solve(self.solver, program)
        if x is not None:
            return x, (program, []), off
        softer, listed = relax(self.solver, program)
        if not listed:
            raise SpatialDynError(
                f"solver {self.solver} gives no answer to a feasible program, residual {off:.2g}; expected another"
            )
        if self.infeasible == "raise":
            raise ConstraintError(
                "no torques within the limits hold this state: the least to give way is " + ", ".join(map(str, listed))
            )
        x, off = solve(self.solver, softer)
        if x is None:
            raise SpatialDynError(f"solver {self.solver} gives no answer to the relaxed program, residual {off:.2g}")
        return x, (softer, listed), off

    def _in_order(
        self, program: Program, tasks: Sequence[Any], rows: list[Rows], levels: list[int]
    ) -> tuple[Array, tuple[Program, list[Relaxation]]]:
        """Solve a program for each priority in the null space of the earlier ones: x + Z y."""
        softer: tuple[Program, list[Relaxation]] | None = None
        for level in levels:
            chosen = [k for k, task in enumerate(tasks) if task.priority == level]
            whole = self._alone(program, [tasks[k] for k in chosen], [rows[k] for k in chosen])
            if softer is None:
                x, softer, _ = self._settled(whole)
                program, size = softer[0], program.rows.shape[1]
                Z = _null(program.rows[program.sense[size:] == EQUAL])
            else:
                x = x + Z @ self._within(whole, x, Z)
            higher = np.concatenate([rows[k].J for k in chosen])
            Z = Z @ _null(higher @ Z[: self.model.nv])
            if not Z.shape[1]:
                break
        assert softer is not None
        return x, softer

    def _within(self, p: Program, x: Array, Z: Array) -> Array:
        """The best y in x + Z y; 0, which is feasible, if the solver finds none."""
        bounded = (p.sense != EQUAL) & ((p.high < NONE) | (p.low > -NONE))
        y = np.concatenate([x, p.rows @ x])
        rows = np.concatenate([Z, p.rows @ Z])[bounded]
        free = np.full(Z.shape[1], FAR)
        inner = Program(
            Z.T @ p.P @ Z, Z.T @ (p.P @ x + p.g), rows, np.r_[-free, np.minimum((p.low - y)[bounded], 0.0)],
            np.r_[free, np.maximum((p.high - y)[bounded], 0.0)], np.zeros(len(free) + len(rows), np.int32), (), free,
        )  # fmt: skip
        found, _ = solve(self.solver, inner)
        return np.zeros(len(free)) if found is None else found

    def _motion(
        self, x: Array, state: State, fixed: Standing, rows: list[Rows], relaxed: list[Relaxation], off: float
    ) -> WholeBodyMotion:
        n = self.model.nv
        a, f = x[:n], self.weight * x[n:]
        bodies = state.rows[:n] if fixed.whole else state.rows[:n][:, fixed.columns]
        tau = (bodies @ x) / self.unit + state.bias
        tau[self.limit == 0.0] = 0.0
        at = list(fixed.at)
        names = tuple([self.contacts.names[k] for k in at])
        forces = f.reshape(-1, 3)
        if self.contacts.ground is not None:
            forces = np.einsum("kji,kj->ki", state.tilt[at], forces)
        forces = forces @ self._axes
        missed = tuple([row.J @ a + row.drift - row.wanted for row in rows])
        return WholeBodyMotion(tau, a, forces, names, missed, tuple(relaxed), off)


def _add(P: Array, g: Array, task: Any, row: Rows) -> None:
    """Add a task to P and g."""
    n = row.J.shape[1]
    P[:n, :n] += (task.weight * row.J.T) @ row.J
    g[:n] -= task.weight * ((row.wanted - row.drift) @ row.J)


def _null(A: Array) -> Array:
    """An orthonormal basis (n, k) of the null space of A."""
    if not len(A):
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    rank = int((s > KEPT * s[0]).sum()) if len(s) else 0
    return Vt[rank:].T


def _positive(name: str, value: Any) -> float:
    x = as_number(value)
    if not 0.0 < x < math.inf:
        raise SpatialDynError(f"{name} is {literal(value)}, expected a finite number above 0")
    return x


def _carries(model: Any, name: str) -> None:
    """Raise ConstraintError for a point with no inertia behind it."""
    inertia = calls["inertial_parameters"](model)
    joint = model.frame(name).joint
    while joint > 0:
        if inertia[joint, 0] > 0.0 or inertia[joint, 4:].any():
            return
        joint = model.joints[joint].parent
    raise ConstraintError(f'point "{name}" of the contacts has no inertia behind it, expected a body that it can push')
