"""``WholeBody``: joint torques of a robot on its feet, by a quadratic program of accelerations and contact forces.

    min  Σ w_k |J_k a + J̇_k v - a_k*|² + w_f |f|² + ε |a|²
    s.t. M_b a + h_b = J_bᵀ f                       the base, which has no motor
         J_c a + J̇_c v = -D J_c v                   feet that stand
         |f_t| <= μ/√2 f_n,  0 <= f_n               pyramids within the cones
         -τ_max <= M_a a + h_a - J_aᵀ f <= τ_max
         least(q, v) <= a <= most(q, v)             position and velocity limits (``viable``)

τ is what the third line has: it is no variable. Source: after Del Prete, Mansard, Ramos, Stasse and Nori, Implementing
torque control with high-ratio gear boxes and without joint-torque sensors (2016), the form that TSID has.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_finite, as_number, as_word, as_words, check_model
from ..calls.dynamics import calls
from ..constraints.contact_dynamics import contact_gaps
from ..errors import ConstraintError, ModelError, ShapeError, SpatialDynError, literal
from ..simulation.scene import Scene
from .feet import Stance, feet_of, ground_axes, stance
from .hierarchy import check_tasks
from .quadratic import Program, Relaxation, available, relax, residual, solve
from .standing import Standing
from .tasks import Rows, Task, rows_of
from .viable import upper

Array = NDArray[np.float64]
LIMITS = ("torque", "velocity", "position")
FORCES, MOTION = 1e-4, 1e-6  # weights of (f/weight)² and of a²
KEPT = 1e-8  # of the largest singular value: directions that higher tasks have


class WholeBodyMotion(NamedTuple):
    """What a whole body does at a state.

    tau       (nv,)   torques, 0 of a floating base [N m | N]
    a         (nv,)   joint accelerations
    forces    (k, 3)  forces of the ground on the points that stand, in the world [N]
    points    names of those
    missed    for each task (m,): J a + J̇ v - a*
    relaxed   limits that had to give way, the largest first; empty where all hold
    residual  by how much equations and limits are missed, relative to their terms
    """

    tau: Array
    a: Array
    forces: Array
    points: tuple[str, ...]
    missed: tuple[Array, ...]
    relaxed: tuple[Relaxation, ...]
    residual: float


class WholeBody:
    """Whole-body control: tasks of a robot that stands on the contacts of its scene.

    scene       Scene with Contacts on a Plane, whose points are the feet; or a Model, of a robot without feet
    tasks       FrameTask, ComTask, PostureTask, or any object with their methods: weighted within one ``priority``, and
                in strict order of priorities, 0 first
    limits      which of torque, velocity and position limits of the model hold; () for none
    dt          step over which torques are held [s]: velocity and position limits look ahead by it
    brake       acceleration with which joints can be stopped before their position limits [rad/s² | m/s²]
    standing    "all": every point stands. A distance [m]: those not farther than that from the ground
    damping     D, by which feet that slip are slowed [1/s]
    force_weight, motion_weight  weights of squared forces, in shares of the robot's weight, and of accelerations: they
                choose among what tasks leave, and move the forces by their share
    largest     normal force of a point [N]; none if left out
    solver      of qpsolvers: "daqp"; any that is installed
    infeasible  "raise", or "relax": take the smallest relaxation of limits, and report it

    ``solve(q, v)`` is a WholeBodyMotion; the object itself is a torque function of ``simulate``, held over a step:
    ``sd.simulate(scene, q, v, 5.0, 2e-3, torque=whole_body)``. Whatever the solver says, its answer is checked.
    Friction and motors of the scene's joints are not compensated.
    Raises  ModelError, ConstraintError and SpatialDynError naming what does not fit; ``solve`` ConstraintError with the
            smallest relaxation, by name, where the limits leave nothing

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
        if model.mimic_matrix is not None:
            raise ModelError(f'robot "{model.name}" has joints that mimic others, expected none for WholeBody')
        if self.scene.constraints is not None:
            raise ConstraintError("the scene has constraints, expected none beside contacts for WholeBody")
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
        self.solver = as_word("solver", solver, available())
        floats = [x for x in model.joints[1:] if x.kind == "floating" and x.parent == 0]
        self.base = 6 if floats else 0
        self.weight = max(float(np.linalg.norm(model.gravity)) * model.total_mass, 1e-300)
        self._names = [joint.name for joint in model.joints[1:] for _ in range(joint.nv)]
        self._far = np.full(model.nv, np.inf)
        stops = [(x.idx_v, x.idx_q) for x in model.joints[1:] if x.nq == x.nv == 1 and "position" in self.limits]
        self._stops = tuple(np.array(stops, np.intp).reshape(-1, 2).T)
        self._feet: dict[tuple[int, ...], Standing] = {}
        contacts = self.scene.contacts
        if contacts is not None and len(contacts):
            self._axes = ground_axes(contacts)
            for name in contacts.names:
                _carries(model, name)
            self._at(tuple(range(len(contacts))))

    def __call__(self, t: float, q: ArrayLike, v: ArrayLike) -> Array:
        """The torque (nv,) at a state: a torque function of ``simulate``."""
        return self.solve(q, v).tau

    def __repr__(self) -> str:
        tasks = ", ".join(f"{x.name}" for x in self.tasks)
        return f"<WholeBody of {self.model.name}: {tasks}; {', '.join(self.limits) or 'no'} limits; {self.solver}>"

    def solve(self, q: ArrayLike, v: ArrayLike, tasks: Task | Iterable[Task] | None = None) -> WholeBodyMotion:
        """The motion at q (nq,), v (nv,); ``tasks`` in place of those that it was made with. Raises as the class."""
        q, v = as_finite("q", q), as_finite("v", v)
        for name, x, size in (("q", q, self.model.nq), ("v", v, self.model.nv)):
            if x.shape != (size,):
                raise ShapeError(f"{name} has shape {x.shape}, expected ({size},): one state")
        given = self.tasks if tasks is None else check_tasks(self.model, tasks)
        rows = [rows_of(task, self.model, q, v) for task in given]
        program, made = self._program(q, v)
        levels = sorted({int(task.priority) for task in given})
        if len(levels) == 1:
            x, relaxed = self._settled(_with(program, list(zip(given, rows, strict=True)), self._weights(made)))
        else:
            x, relaxed = self._in_order(program, given, rows, levels, self._weights(made))
        return self._motion(x, made, rows, relaxed, residual(relaxed[0], x))

    # --- the program ----------------------------------------------------------------------------------------

    def _at(self, at: tuple[int, ...]) -> Standing:
        """What is constant of these points."""
        if at not in self._feet:
            contacts = self.scene.contacts
            feet = feet_of(self.model, contacts, at) if contacts is not None and at else []
            order = [k for foot in feet for k in foot.at]
            self._feet[at] = Standing.of(self, feet, order)
        return self._feet[at]

    def _standing(self, q: Array) -> tuple[int, ...]:
        contacts = self.scene.contacts
        if contacts is None:
            return ()
        if isinstance(self.standing, str):
            return tuple(range(len(contacts)))
        gaps = np.asarray(contact_gaps(self.model, contacts, q))
        return tuple(np.flatnonzero(gaps <= self.standing).tolist())

    def _program(self, q: Array, v: Array) -> tuple[Program, _State]:
        """The program without tasks, and what torques follow from."""
        model, n, nb = self.model, self.model.nv, self.base
        fixed = self._at(self._standing(q))
        k = 3 * len(fixed.order)
        M, h = np.asarray(calls["crba"](model, q)), np.asarray(calls["nonlinear_effects"](model, q, v))
        if k:
            feet = stance(model, fixed.feet, self._axes, q, v)
        else:
            feet = Stance(np.zeros((0, n)), np.zeros(0), np.zeros(0), np.zeros((n, 0)))
        r = len(feet.drift)
        A, b = np.zeros((nb + r, n + k)), np.empty(nb + r)
        A[:nb, :n], A[:nb, n:], b[:nb] = M[:nb] / self.weight, -feet.pull[:nb], -h[:nb] / self.weight
        A[nb:, :n], b[nb:] = feet.J / self.brake, -(feet.drift + self.damping * feet.rate) / self.brake
        G, limit = fixed.G.copy(), fixed.h.copy()
        for rows, sign in fixed.torque_rows:
            scale = sign / fixed.effort
            G[rows, :n] = scale[:, None] * M[fixed.driven]
            G[rows, n:] = (-self.weight * scale[:, None]) * feet.pull[fixed.driven]
            limit[rows] -= scale * h[fixed.driven]
        least, most = fixed.least.copy(), fixed.most.copy()
        if fixed.bounded:
            gap_up, gap_down = self._gaps(q)
            most[:n] = upper(gap_up, v, fixed.fastest, self.brake, self.dt)
            least[:n] = -upper(gap_down, -v, fixed.fastest, self.brake, self.dt)
        program = Program(
            np.zeros((0, 0)), np.zeros(0), A, b, G, limit, least, most, fixed.groups, fixed.size, fixed.bounds,
            fixed.scale,
        )  # fmt: skip
        return program, _State(M, h, feet, fixed)

    def _gaps(self, q: Array) -> tuple[Array, Array]:
        """What each freedom has left to its upper and its lower limit; infinite where there is none."""
        up, down, (at_v, at_q) = self._far.copy(), self._far.copy(), self._stops
        up[at_v], down[at_v] = self.model.upper[at_q] - q[at_q], q[at_q] - self.model.lower[at_q]
        return up, down

    def _weights(self, made: _State) -> Array:
        """The diagonal of what is small."""
        n, k = self.model.nv, made.feet.pull.shape[1]
        small: Array = np.r_[np.full(n, self.motion_weight), np.full(k, self.force_weight)]
        return small

    def _settled(self, program: Program) -> tuple[Array, tuple[Program, list[Relaxation]]]:
        """The answer, with limits relaxed if need be."""
        x, off = solve(self.solver, program)
        if x is not None:
            return x, (program, [])
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
        return x, (softer, listed)

    def _in_order(
        self, program: Program, tasks: list[Any], rows: list[Rows], levels: list[int], small: Array
    ) -> tuple[Array, tuple[Program, list[Relaxation]]]:
        """A program for each priority, in what those before it leave: x + Z y."""
        softer: tuple[Program, list[Relaxation]] | None = None
        for level in levels:
            chosen = [(task, row) for task, row in zip(tasks, rows, strict=True) if task.priority == level]
            if softer is None:
                x, softer = self._settled(_with(program, chosen, small))
                program, Z = softer[0], _null(program.A)
            else:
                x = x + Z @ self._within(program, chosen, small, x, Z)
            higher = np.concatenate([row.J for _, row in chosen])
            Z = Z @ _null(higher @ Z[: self.model.nv])
            if not Z.shape[1]:
                break
        assert softer is not None
        return x, softer

    def _within(self, program: Program, chosen: list[Any], small: Array, x: Array, Z: Array) -> Array:
        """The best y of x + Z y; 0 where the solver has none, which is feasible."""
        whole = _with(program, chosen, small)
        high, low = np.isfinite(program.most), np.isfinite(program.least)
        G = np.concatenate([program.G @ Z, Z[high], -Z[low]])
        h = np.concatenate([program.h - program.G @ x, (program.most - x)[high], (x - program.least)[low]])
        size = np.concatenate([program.size, program.scale[high], program.scale[low]])
        free = np.full(Z.shape[1], np.inf)
        inner = Program(
            Z.T @ whole.P @ Z, Z.T @ (whole.P @ x + whole.g), np.zeros((0, len(free))), np.zeros(0), G,
            np.maximum(h, 0.0), -free, free, (), size, (), np.ones(len(free)),
        )  # fmt: skip
        y, _ = solve(self.solver, inner)
        return np.zeros(len(free)) if y is None else y

    def _motion(
        self, x: Array, made: _State, rows: list[Rows], relaxed: tuple[Program, list[Relaxation]], off: float
    ) -> WholeBodyMotion:
        n, nb = self.model.nv, self.base
        a, f = x[:n], self.weight * x[n:]
        tau = made.M @ a + made.h - made.feet.pull @ f
        tau[:nb] = 0.0
        forces = f.reshape(-1, 3) @ self._axes.T if len(f) else np.zeros((0, 3))
        missed = tuple(row.J @ a + row.drift - row.wanted for row in rows)
        names = () if self.scene.contacts is None else tuple(self.scene.contacts.names[k] for k in made.fixed.order)
        return WholeBodyMotion(tau, a, forces, names, missed, tuple(relaxed[1]), off)


class _State(NamedTuple):
    """M, h and the feet at a state."""

    M: Array
    h: Array
    feet: Stance
    fixed: Standing


def _with(program: Program, tasks: list[tuple[Any, Rows]], small: Array) -> Program:
    """The program with these tasks as its cost."""
    n = program.A.shape[1]
    P, g = np.zeros((n, n)), np.zeros(n)
    nv = tasks[0][1].J.shape[1]
    J = np.concatenate([math.sqrt(task.weight) * row.J for task, row in tasks])
    aim = np.concatenate([math.sqrt(task.weight) * (row.wanted - row.drift) for task, row in tasks])
    P[:nv, :nv] = J.T @ J
    P[np.arange(n), np.arange(n)] += small
    g[:nv] = -(J.T @ aim)
    return program._replace(P=P, g=g)


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
