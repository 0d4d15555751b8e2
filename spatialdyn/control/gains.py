"""Gains of control laws by pole placement and Riccati's equation, and a check of the stability of a closed step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_count, as_finite, as_flag, as_number, broadcast, check_model, within_range
from ..calls.dynamics import calls
from ..calls.states import random_configuration
from ..constraints.contact_points import Contacts
from ..constraints.dynamics import constraint_jacobian
from ..constraints.loops import project_configuration, project_velocity
from ..errors import NonFiniteError, ShapeError, SimulationError, SpatialDynError, literal, pip_install
from ..laws.control import Control
from ..model.model import Model
from ..recursions.control.paths import CLOCK
from ..simulation.rollouts import rollout
from ..simulation.scene import Scene, scene_of
from ..simulation.stiff_laws import MOST_STEPS, joint_of_mode, rough, steps_of_periods
from ..waiting import watch
from .laws import StateFeedback

Array = NDArray[np.float64]
MARGIN = 1e-12  # relative to the largest entry of A: a pole nearer to the border of stability counts as on it
DELTA = 1e-6  # of central differences of a step, whose errors are some 1e-10
SOLVED = 1e-13  # [m/s | rad/s] tolerance of contacts whose steps are differenced
BENDS = 1e-3  # relative to the motion of a step: allowed difference of its one-sided derivatives


class Gains(NamedTuple):
    """Kp and Kd, to unpack into a law."""

    Kp: Array
    Kd: Array


def critical_gains(omega: ArrayLike, zeta: ArrayLike = 1.0) -> Gains:
    """Kp = ω², Kd = 2 ζ ω for ``ComputedTorque``: errors have frequency ω and damping ratio ζ, critical at 1.

    omega  number or (nv,), above 0 [rad/s]
    zeta   number or (nv,), above 0

    For ``PD`` and similar laws multiply both by the largest diagonal of M. With a torque held over steps of
    semi_implicit_euler such a mode is stable below ``largest_step``.
    Raises SpatialDynError, ShapeError; NonFiniteError for numbers beyond the range of float64

    >>> import spatialdyn as sd
    >>> [float(x) for x in sd.critical_gains(10.0, 0.7)]
    [100.0, 14.0]
    """
    w, z = _modes(omega, zeta)
    with np.errstate(over="ignore"):
        found = Gains(w * w + 0.0 * z, 2.0 * z * w)
    within_range("a gain", *found)
    return found


def largest_step(omega: ArrayLike, zeta: ArrayLike) -> Array:
    """The step [s] below which a mode of frequency ω and damping ζ is stable under a torque held over steps of
    semi_implicit_euler: (2 √(1 + ζ²) - 2 ζ) / ω.

    Raises SpatialDynError, ShapeError; NonFiniteError for numbers beyond the range of float64

    >>> import spatialdyn as sd
    >>> round(float(sd.largest_step(1.0, 0.7)), 3)
    1.041
    """
    w, z = _modes(omega, zeta)
    with np.errstate(over="ignore", under="ignore"):
        found = np.asarray(2.0 / (np.hypot(1.0, z) + z) / w)
    within_range("a step", found)
    return found


def _modes(omega: ArrayLike, zeta: ArrayLike) -> tuple[Array, Array]:
    """Frequencies and dampings, which broadcast."""
    w, z = _positive("omega", omega), _positive("zeta", zeta)
    broadcast(["omega", "zeta"], [w.shape, z.shape])
    return w, z


def _positive(name: str, value: ArrayLike) -> Array:
    x = as_array(name, value)
    if not ((x > 0.0) & np.isfinite(x)).all():
        raise SpatialDynError(f"{name} is {x.tolist()}, expected finite numbers above 0")
    return x


@watch.call("gravity_stiffness_bound")
def gravity_stiffness_bound(model: Model, samples: int = 1000, seed: int = 0) -> float:
    """The largest slope of gravity, max ‖∂g/∂q‖₂ [N m/rad], over random configurations within the limits.

    With PD and the constant g(q_d), q_d is the only equilibrium if the least eigenvalue of Kp is above the true
    maximum; the sampled maximum is a little below it. With g(q) (``PDGravity``) any Kp above 0 is enough.

    Raises SpatialDynError

    >>> import spatialdyn as sd
    >>> round(sd.gravity_stiffness_bound(sd.load_urdf("pendulum")), 3)
    4.905
    """
    check_model(model)
    if not (n := as_count(samples, 10**7)):
        raise SpatialDynError(f"samples is {literal(samples)}, expected a whole number from 1 to 10000000")
    q = random_configuration(model, seed, (n,))
    slope = np.asarray(calls["generalized_gravity_derivatives"](model, q))
    return float(np.linalg.norm(slope, 2, axis=(-2, -1)).max(initial=0.0))


class LQR(NamedTuple):
    """K (m, n), P (n, n) and the poles (n,) of the closed loop; ``feedback(q, v, tau)`` is the law."""

    K: Array
    P: Array
    poles: NDArray[Any]
    discrete: bool = False

    def feedback(
        self, q: ArrayLike, v: ArrayLike | None = None, tau: ArrayLike | None = None, joints: ArrayLike | None = None
    ) -> StateFeedback:
        """The law tau = tau₀ - K (q ⊖ q₀, v - v₀); ``joints`` are the freedoms that K drives, if not all."""
        return StateFeedback(self.K, q, v, tau, joints, held=self.discrete)


@watch.call("lqr")
def lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, *, discrete: bool = False) -> LQR:
    """The gain K of u = -K x that minimizes ∫ xᵀQx + uᵀRu along ẋ = A x + B u, or the sum along x⁺ = A x + B u.

    A (n, n), B (n, m)  as ``linearize`` returns them; for a robot with fewer motors than freedoms B has the columns of
                        its motors, B[:, [0]]
    Q (n, n), R (m, m)  symmetric, Q positive semidefinite, R positive definite
    discrete            whether A and B are those of a step

    SciPy solves Riccati's equation. Raises  SpatialDynError naming the eigenvalue of Q or R, for a system that no
    feedback stabilizes, or if a mode that does not decay by itself has no weight in Q; ShapeError; ImportError without
    SciPy

    >>> import numpy as np, spatialdyn as sd
    >>> found = sd.lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), [[1.0]])
    >>> found.K.round(6).tolist()
    [[1.0, 1.732051]]
    """
    try:
        from scipy import linalg
    except ImportError as error:
        raise ImportError(f"lqr needs SciPy: {pip_install('simulation')}") from error
    discrete = as_flag("discrete", discrete)
    a, b = as_array("A", A), as_array("B", B)
    if a.ndim != 2 or a.shape[0] != a.shape[1] or not a.size:
        raise ShapeError(f"A has shape {a.shape}, expected (n, n), n of 1 or more")
    if b.ndim != 2 or len(b) != len(a) or not b.size:
        raise ShapeError(f"B has shape {b.shape}, expected ({len(a)}, m), m of 1 or more")
    weights = []
    for name, value, size, strict in (("Q", Q, len(a), False), ("R", R, b.shape[1], True)):
        x = as_array(name, value)
        if x.shape != (size, size):
            raise ShapeError(f"{name} has shape {x.shape}, expected {(size, size)}")
        if not np.isfinite(x).all() or abs(x - x.T).max() > 1e-9 * abs(x).max(initial=1e-300):
            raise SpatialDynError(f"{name} is {x.tolist()}, expected a symmetric matrix")
        least = float(np.linalg.eigvalsh(x).min())
        if least <= 0.0 if strict else least < -1e-12 * abs(x).max():
            raise SpatialDynError(
                f"{name} has the eigenvalue {least:.6g}, expected {'above 0' if strict else '0 or more'}"
            )
        weights.append(x)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise NonFiniteError("A or B has numbers that are not finite, expected finite ones")
    q, r = weights
    solve = linalg.solve_discrete_are if discrete else linalg.solve_continuous_are
    try:
        P = solve(a, b, q, r)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SpatialDynError(f"no feedback stabilizes A, B ({error}), expected a stabilizable system") from error
    K = np.linalg.solve(r + b.T @ P @ b, b.T @ P @ a) if discrete else np.linalg.solve(r, b.T @ P)
    poles = np.linalg.eigvals(a - b @ K)
    most = float(abs(poles).max() - 1.0 if discrete else poles.real.max())
    if most > -MARGIN * max(1.0, float(abs(a).max())):
        raise SpatialDynError(
            f"Q leaves a mode unweighted that does not decay: the closed loop has the pole "
            f"{poles[(abs(poles) if discrete else poles.real).argmax()]:.6g}, expected a Q that sees it"
        )
    return LQR(K, P, poles, discrete)


class ClosedStep(NamedTuple):
    """A step of a robot under a law, near a state; for laws held for a period all steps until the next evaluation.

    A       (2 nv + s, 2 nv + s)  δx⁺ = A δx, δx = (δq, δv, δz) with the s states of scene and law: bristles, integrals
    radius  the largest |eigenvalue|: above 1, errors grow by this factor in these steps
    joint   the name of the joint that takes most part in this mode
    steps   number of steps that A spans
    """

    A: Array
    radius: float
    joint: str
    steps: int = 1

    def check(self) -> None:
        """Raise SimulationError naming the joint if errors grow."""
        if self.radius > 1.0 + 1e-6:
            several = "a step" if self.steps == 1 else f"{self.steps} steps"
            shorter = "" if self.steps == 1 else ", or a shorter period"
            raise SimulationError(
                f'errors grow by {self.radius:.6g} in {several}, most in joint "{self.joint}", expected at most 1: '
                f"smaller gains there, or a smaller dt{shorter}"
            )


def _solved(scene: Scene) -> Scene:
    """The scene with contacts and limits that are solved to rounding, as differences need them."""
    if scene.contacts is None and not scene.limits:
        return scene
    x = Contacts(scene.model, {}) if scene.contacts is None else scene.contacts
    radii, mu, e = (dict(zip(x.names, y, strict=True)) for y in (x.radii, x.friction, x.restitution))
    solved = Contacts(x.model, radii, mu, e, x.terrain, SOLVED, x.steps, x.rounds)
    return scene.with_(contacts=solved)


@watch.call("closed_step")
def closed_step(
    scene: Scene | Model, law: Control, q: ArrayLike, v: ArrayLike, dt: float, method: str | None = None
) -> ClosedStep:
    """The map of errors over a step of a scene under a law, by central differences of the first step of a run.

    scene, method  as in ``rollout``; by default ``scene.method``. Contacts and limits are solved to rounding
    q (nq,), v (nv,)  the state; for a law that follows a path, the state at its beginning
    dt  [s]

    For laws held for periods it is the product of all steps until they are evaluated together again. The states of a
    law start as in a run; their errors evolve too, except that of its clock. Constraints restrict the errors.
    Raises SimulationError for a state at which contacts, limits, motors or dry joints are about to change state, where
    the step has two derivatives, and as ``rollout``; ShapeError

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("pendulum")
    >>> stiff = sd.PD([1e4], [10.0], [0.0])
    >>> sd.closed_step(model, stiff, [0.0], [0.0], 0.05, "semi_implicit_euler").radius > 1.0
    True
    """
    scene = scene_of(scene)
    model, n = scene.model, scene.model.nv
    if not isinstance(law, Control):
        raise SimulationError(f"law is {literal(law)}, expected a Control")
    if unsmooth := rough(scene):
        scene = _solved(scene)
    h = as_number(dt)
    if not 0.0 < h < math.inf:
        raise SimulationError(f"dt is {literal(dt)}, expected a finite number above 0")
    at, speed = as_finite("q", q), as_finite("v", v)
    for name, x, size in (("q", at, model.nq), ("v", speed, n)):
        if x.shape != (size,):
            raise ShapeError(f"{name} has shape {x.shape}, expected ({size},)")
    if not (steps := steps_of_periods(law, h)):
        raise SimulationError(
            f"periods of the law are taken anew together after more than {MOST_STEPS} steps of {h:g} s, expected fewer"
        )
    law_states = {x.name for x in law.spec.states}
    counted = {CLOCK.name, *(x for period in law.periods for x in period[1:])}
    begun = rollout(scene, at, speed, dt=h, steps=0, method=method, control=law, record="last", check=False)
    own = {name: x for name, x in begun.states.items() if name not in counted or name not in law_states}
    sizes = [x.size for x in own.values()]
    total = 2 * n + sum(sizes)
    ways = DELTA * np.concatenate([np.eye(total), -np.eye(total)])
    parts = np.split(ways, np.cumsum([n, n, *sizes])[:-1], axis=1)
    held = scene.constraints
    if held is not None:
        J = np.asarray(constraint_jacobian(model, held, at))
        free = np.eye(n) - np.linalg.pinv(J, rcond=1e-9) @ J
        parts[0], parts[1] = parts[0] @ free, parts[1] @ free
    q0, v0 = np.asarray(calls["integrate"](model, at, parts[0])), speed + parts[1]
    if held is not None:
        q0 = project_configuration(model, held, q0)
        v0 = project_velocity(model, held, q0, v0)
    given = {name: x + way.reshape(-1, *x.shape) for (name, x), way in zip(own.items(), parts[2:], strict=True)}
    if unsmooth:  # the state itself, between both sides
        q0, v0 = np.vstack([q0, at]), np.vstack([v0, speed])
        given = {name: np.concatenate([x, own[name].reshape(1, *x.shape[1:])]) for name, x in given.items()}
    run = rollout(
        scene, q0, v0, dt=h, steps=steps, method=method, control=law, states=given or None, record="last", check=False
    )  # a check would warn of the law
    q1 = np.asarray(run.q)
    ends = [np.asarray(run.v), *(np.asarray(run.states[name]).reshape(len(q1), -1) for name in own)]
    if not all(np.isfinite(x).all() for x in (q1, *ends)):
        many = "a step" if steps == 1 else f"{steps} steps"
        raise NonFiniteError(f"{many} of {h:g} s ends in a state that is not finite, expected a finite one")
    turned = np.asarray(calls["difference"](model, q1[total : 2 * total], q1[:total]))
    moved = np.concatenate([turned, *(x[:total] - x[total : 2 * total] for x in ends)], 1)
    if unsmooth:
        ahead = np.asarray(calls["difference"](model, np.broadcast_to(q1[-1], (total, model.nq)), q1[:total]))
        bend = 2.0 * np.concatenate([ahead, *(x[:total] - x[-1] for x in ends)], 1) - moved
        if abs(bend).max() > BENDS * abs(moved).max():
            raise SimulationError(
                f"scene of {', '.join(unsmooth)} has two derivatives of the step from this state, expected one at "
                "which none of them is about to change what it does"
            )
    A = moved.T / (2.0 * DELTA)
    values, vectors = np.linalg.eig(A)
    worst = int(abs(values).argmax())
    joint = joint_of_mode(model, A, values[worst], vectors[:, worst])
    return ClosedStep(A, float(abs(values[worst])), joint, steps)
