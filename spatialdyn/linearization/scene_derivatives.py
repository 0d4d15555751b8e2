"""Derivatives of steps of scenes: of the step's program under constraints, of the impulses' laws with impulses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, batch_shape, broadcast, core_shape
from ..calls.by_program import along
from ..calls.dynamics import calls, checked_call
from ..constraints.derivatives import constrained_dynamics_derivatives
from ..errors import SimulationError
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.derivatives.step_derivatives import MOTION
from ..recursions.joints.friction import BRISTLES
from ..recursions.spec import FEXT, TAU, Argument, Q, V
from ..simulation.effects import of_run
from ..simulation.effects.constraints import constrained_of
from ..simulation.effects.contacts import Contact, check_start
from ..simulation.effects.effect import Effect, find
from ..simulation.effects.friction import LuGreFriction
from ..simulation.methods.methods import EXPLICIT_METHODS, integrators
from ..simulation.plan import Plan
from ..simulation.rollouts import rollout
from ..simulation.scene import Scene, check_method
from ..simulation.states import run_states
from ..simulation.steps import step_specs
from . import implicit_derivatives
from .implicit_derivatives import Beside, check_implicit
from .impulse_derivatives import SWITCH, Found, laws_of
from .impulse_derivatives import derivatives as by_impulses
from .step_torques import bent_labels, torques_near, torques_of

Array = NDArray[np.float64]


class _Pair(NamedTuple):
    A: Array
    B: Array


class StepDerivatives(_Pair):
    """A (..., 2 nv, 2 nv) and B (..., 2 nv, nv), to which it unpacks, and the states of what acts by impulses.

    With bristles, which are a state beside q and v, A (..., 3 nv, 3 nv) and B (..., 3 nv, nv) of (δq, δv, δz).

    labels     names of points, limits, dry joints, motors, bristles; () if none acts
    active     (..., len(labels))  their states in the step: "separates", "sticks", "slides", "bounces" for points;
               "free", "lower limit", "upper limit", "sticks", "slides" for joints; for motors "commanded", or
               "saturated" at the limit of a voltage, current or gear; "bends" for bristles
    switching  (..., len(labels))  whether a state is within 1e-6 m/s or rad/s of another state, or its gap of changing
               sign: the derivative is then that of one side. Creases of a Heightfield are not marked
    undetermined  (..., len(labels))  whether a point slides whose load others could take, as for a box on four corners:
               its friction depends on its share of the load, and the derivative is that of the impulses found
    """

    labels: tuple[str, ...] = ()
    active: NDArray[Any] = np.zeros(0, "<U11")
    switching: NDArray[Any] = np.zeros(0, np.bool_)
    undetermined: NDArray[Any] = np.zeros(0, np.bool_)


def scene_derivatives(
    scene: Scene, q: ArrayLike, v: ArrayLike, tau: ArrayLike, h: Array, method: Any, fext: ArrayLike | None,
    states: Any = None,
) -> StepDerivatives:  # fmt: skip
    """``step_derivatives`` of a scene with constraints, contacts, limits, friction or motors, by steps h (...)."""
    model = scene.model
    bends = find(scene.effects, LuGreFriction)
    own = () if bends is None else (BRISTLES,)
    if bends is None:
        run_states(model, (), (), states)  # raises for any state
    check_method(scene, method, integrators)
    check_implicit(method)
    names: list[Argument] = [Q, V, TAU, *own, *([] if fext is None else [FEXT])]
    values = [q, v, tau, *(_bristles(model, states) for _ in own), *([] if fext is None else [fext])]
    given = [as_array(x.name, y) for x, y in zip(names, values, strict=True)]
    shapes = [batch_shape(model, x, a) for x, a in zip(names, given, strict=True)]
    batch = broadcast([*(x.name for x in names), "dt"], [*shapes, h.shape])
    n, count = model.nv, math.prod(batch)
    whole = [np.broadcast_to(a, batch + core_shape(model, x)) for x, a in zip(names, given, strict=True)]
    rows = [x.reshape((count, *x.shape[len(batch) :])) for x in whole]
    steps = np.broadcast_to(h, batch).reshape(count)
    finite = np.logical_and.reduce([np.isfinite(x.reshape((count, math.prod(x.shape[1:])))).all(axis=1) for x in rows])
    sound = np.flatnonzero(finite)
    if len(sound) and not (steps > 0.0).all():
        raise SimulationError(f"dt is {steps.min():g}, expected more than 0 s in a scene")
    size = 2 * n if bends is None else 3 * n
    made, found = np.full((count, size, size + n), np.nan), None
    labels: tuple[str, ...] = ()
    if len(sound):
        q, v, tau, *forces = (np.ascontiguousarray(x[sound]) for x in rows)
        z = None if bends is None else forces.pop(0)
        steps = steps[sound]
        calls["minverse"](model, q)  # raises InertiaError at a singular M
        pushed = forces[0] if forces else None
        held = None if pushed is None else pushed.reshape((len(sound), 1, -1))
        constrained = None if scene.constraints is None else constrained_of(scene, q, v, float(steps.max()))
        if scene.contacts is not None or scene.limits:
            check_start(scene, q)
        effects = of_run(scene.with_(fext=None), constrained, False, held)
        if scene.solves and (bends is None or find(effects, Contact) is not None):
            laws = laws_of(model, effects, scene.unilateral, pushed is not None)
            acting = torques_of(model, effects, q, v, z, tau, steps)
            found = by_impulses(laws, q, v, z, acting, steps, pushed, batch, sound)
            made[sound], labels = found.derivatives, (*laws.labels, *acting.labels)
        else:
            plan, begun = Plan(scene, method, effects), Begun(q, v, z, tau, steps, pushed)
            if method in EXPLICIT_METHODS:
                made[sound] = _by_program(scene, method, plan, begun)
            else:
                made[sound] = _implicit(plan, begun, batch, sound)
            if bends is not None:
                labels, active, margins = bent_labels(model, bends, v)
                found = Found(made[sound], active, margins <= SWITCH, np.zeros(active.shape, np.bool_))
    made = made.reshape((*batch, size, size + n))
    pair = StepDerivatives(made[..., :size], made[..., size:])
    pair.labels = labels
    shape = count, len(labels)
    pair.active, pair.switching = np.full(shape, "", "<U11"), np.zeros(shape, np.bool_)
    pair.undetermined = np.zeros(shape, np.bool_)
    if found is not None and labels:
        pair.active[sound], pair.switching[sound] = found.active, found.switching
        pair.undetermined[sound] = found.undetermined
    full = *batch, len(labels)
    pair.active, pair.switching = pair.active.reshape(full), pair.switching.reshape(full)
    pair.undetermined = pair.undetermined.reshape(full)
    return pair


def _bristles(model: Model, states: Any) -> Array:
    """Deflections of bristles before the step; 0 by default. Raises as ``run_states``."""
    given = dict(states) if isinstance(states, Mapping) else states
    known = given.pop(BRISTLES.name, None) if isinstance(given, dict) else None
    run_states(model, (BRISTLES,), (), given)  # raises for another state
    return np.zeros(model.nv) if known is None else as_array(f"state {BRISTLES.name}", known)


class Begun(NamedTuple):
    """The beginnings of n steps; z and fext may be None."""

    q: Array
    v: Array
    z: Array | None
    tau: Array
    h: Array
    fext: Array | None


def constrained_linearization(
    scene: Scene, q: ArrayLike, v: ArrayLike, tau: ArrayLike, fext: ArrayLike | None
) -> StepDerivatives:
    """``linearize`` for a scene with constraints, springs and smooth friction, in continuous time."""
    model, n = scene.model, scene.model.nv
    assert scene.constraints is not None
    found = checked_call(MOTION, model, (q, v, tau, fext, *(None,) * 5), (), None)
    more = torques_near(model, scene.effects, q, v)
    if more is not None:
        tau = as_array("tau", tau) + more[0]
    by = constrained_dynamics_derivatives(model, scene.constraints, q, v, tau, scene.stabilization, fext)
    found[..., n:, :n], found[..., n:, n : 2 * n], found[..., n:, 2 * n :] = by.da_dq, by.da_dv, by.da_dtau
    if more is not None:
        found[..., n:, : 2 * n] += by.da_dtau @ more[1]
    return StepDerivatives(found[..., : 2 * n], found[..., 2 * n :])


def _implicit(plan: Plan, begun: Begun, batch: tuple[int, ...], samples: NDArray[np.intp]) -> Array:
    """Derivatives (n, 2 nv, 3 nv) of a method that solves equations."""
    model, (q, v, _, tau, h, fext) = plan.model, begun
    acting = tuple(x for x in plan.effects if type(x).torque is not Effect.torque)
    p = calls["momentum"](model, q, v)
    states = implicit_derivatives.Begun(q, v, p, tau, h, fext)
    beside = Beside(acting, plan.given(0, 0), plan.constrained)
    return implicit_derivatives.derivatives(model, plan.integrator, states, batch, samples, beside)


def _by_program(scene: Scene, method: str, plan: Plan, begun: Begun) -> Array:
    """Derivatives (n, 2 nv, 3 nv), with bristles (n, 3 nv, 4 nv), of the program of the step."""
    model, n = scene.model, scene.model.nv
    q, v, z, tau, h, fext = begun
    ends = np.empty_like(q)
    for dt in np.unique(h):  # raises the errors of a step
        at = np.flatnonzero(h == dt)
        forces = None if fext is None else fext[at][:, None]
        run = rollout(
            scene.with_(fext=None), q[at], v[at], tau[at][:, None], dt=float(dt), method=method, record="last",
            fext=forces, states=None if z is None else {BRISTLES.name: z[at]},
        )  # fmt: skip
        ends[at] = run.q
    own, m = [] if z is None else [z], 3 * n if z is None else 4 * n
    specs = step_specs(method, plan.structure, ())[: 2 + len(own)]
    beside = [np.broadcast_to(x[:, 0], (len(q), x.shape[2])) for x in plan.values.values()]
    of_q, of_v, *of_z, of_tau = (np.broadcast_to(x, (len(q), n, m)) for x in np.split(np.eye(m), m // n))
    tangents = [of_q, of_v, *of_z, 1, of_tau, *(x.shape[1] for x in beside)]
    by_q, *others = along(model, specs, [q, v, *own, h[:, None], tau, *beside], tangents, plan.tables, len(specs))
    return np.concatenate([displacements(model, ends, by_q), *others], axis=1)


def displacements(model: Any, q: Array, rates: Array) -> Array:
    """Displacements (n, nv, m) for changes (n, nq, m) of the coordinates q (n, nq)."""
    n = model.nv
    unit = np.broadcast_to(np.eye(n), (len(q), n, n))
    E = along(model, SPECS["integrate"], [q, np.zeros((len(q), n))], [n, unit])
    made: Array = np.linalg.solve(np.swapaxes(E, 1, 2) @ E, np.swapaxes(E, 1, 2) @ rates)
    return made
