"""A step of a robot under a control law as a linear map of its errors, and whether it lets them grow."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_finite, as_number
from ..calls.dynamics import calls
from ..constraints.contact_points import Contacts
from ..constraints.dynamics import constraint_jacobian
from ..constraints.loops import project_configuration, project_velocity
from ..control.control import Control
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..recursions.control.paths import CLOCK
from ..simulation.rollouts import rollout
from ..simulation.scene import Scene, scene_of
from ..simulation.stiff_laws import MOST_STEPS, joint_of_mode, rough, steps_of_periods
from ..waiting import watch

Array = NDArray[np.float64]
DELTA = 1e-6  # of central differences of a step, whose errors are some 1e-10
SOLVED = 1e-13  # [m/s | rad/s] tolerance of contacts whose steps are differenced
BENDS = 1e-3  # relative to the motion of a step: allowed difference of its one-sided derivatives


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
