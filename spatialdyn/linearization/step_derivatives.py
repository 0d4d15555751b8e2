"""Derivatives of a step of an integration method, and of the equation of motion, for LQR, iLQR and filters.

A displacement of a state is δx = (δq, δv), with δq in the frame of each joint's own body, as ``integrate`` takes it and
``difference`` returns it: quaternions have three freedoms here too. For a step under a held torque

    δx⁺ = A δx + B δτ

is exact. ``recursions.derivatives.step_derivatives`` has the explicit methods, each one recursion and so one program on
SIMD lanes; ``implicit_derivatives`` has the others. Under constraints, explicit methods use the derivative of the
program of their step, and ``constrained_methods`` has the symplectic ones; ``impulse_derivatives`` has steps with
impulses of contacts, limits and dry friction.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..actuation.friction import Friction
from ..bodies.kinds import LENGTHS, NV
from ..bodies.table import independent
from ..calls.arguments import as_array, batch_shape, broadcast, core_shape
from ..calls.dynamics import calls, checked_call
from ..errors import SimulationError, SpatialDynError, literal
from ..model.model import Model
from ..recursions.derivatives.step_derivatives import MOTION, STEPS, TURNING_STEPS
from ..recursions.spec import FEXT, TAU, Q, V
from ..simulation.effects.friction import IMPLICIT, LUGRE, SMOOTH
from ..simulation.effects.springs import has_springs
from ..simulation.methods.explicit import HALF_TURN
from ..simulation.methods.methods import integrators
from ..simulation.scene import Scene, scene_of
from ..simulation.states import run_states
from . import implicit_derivatives
from .implicit_derivatives import Begun, check_implicit
from .scene_derivatives import StepDerivatives, constrained_linearization, scene_derivatives
from .step_torques import torques_near

Array = NDArray[np.float64]
NO_LAW: tuple[Array | None, ...] = (None,) * 5


def step_derivatives(
    scene: Scene | Model,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    method: str = "semi_implicit_euler",
    fext: ArrayLike | None = None,
    states: Mapping[str, ArrayLike] | None = None,
) -> StepDerivatives:
    """Derivatives of a step by the state before it and the torque held over it: ``A, B = step_derivatives(...)``.

    Source: see ``recursions.derivatives.step_derivatives`` and ``linearization.implicit_derivatives``.

    scene   Scene or Model. Friction by the method "smooth" is a torque; any other one, motors, contacts and limits act
            by impulses, whose laws have a derivative on each side of a switch
    q       (..., nq)          joint positions [rad | m]
    v       (..., nv)          joint velocities [rad/s | m/s]
    tau     (..., nv)          joint torques [N m | N]
    dt      (...)              step [s]; negative goes back in time
    method  a name in ``integrators``, except "dop853" and "radau", whose steps adapt to a tolerance. The step is that
            of ``simulate`` from this state, without data of an earlier run (compensated sums, chart centres)
    fext    (..., njoints, 6)  force on each joint's body, in the joint's frame, held too [N | N m], beside those of the
            scene; zero if left out
    states  {name: (..., nv)}  states that the scene carries beside q and v, "bristles"; 0 if left out

    The displacement is δx = (δq, δv), with δq (nv) in the frame of each joint's own body, as ``integrate`` takes it and
    ``difference`` returns it. δx⁺ = A δx + B δτ is exact to rounding for any dt: neither 1 + dt A_c nor exp(dt A_c) is.

    Steps with impulses are differentiated at their solution, by the implicit function theorem: points and joints keep
    their states there, and the result names these states and those that are about to change. A robot that stands still
    is often at a switch: its points are neither above the ground nor in it. A point bounces at the end of the step, as
    in ``step``: no step resolves the time of a hit. With bristles the state is (δq, δv, δz), A (..., 3 nv, 3 nv) and
    B (..., 3 nv, nv).

    Batches of any size with explicit methods run on SIMD lanes; models of 26 freedoms or more, 17 with velocity_verlet
    and 12 with rk4, use the table kernel. Implicit methods are solved and differentiated on lanes; with springs, smooth
    friction or constraints they are solved sample by sample.

    Returns StepDerivatives: A (..., 2 nv, 2 nv) and B (..., 2 nv, nv), views of one array, with ``labels``, ``active``,
            ``switching`` and ``undetermined`` of what acts by impulses. NaN or infinity in a sample's state, torque or
            forces gives NaN in the results of that sample that depend on it, and in no other sample.
    Raises  SpatialDynError for another method or a dt that is not finite; SimulationError for points that bounce at
            once and share their load, a step that does not converge, and a joint of several freedoms that turns by π or
            more in a step, each naming the first sample and the number of such samples; the errors of ``aba``, and of
            ``step`` under constraints.

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> q, v, tau = np.array([0.5, -0.3]), np.array([1.0, 2.0]), np.array([0.1, 0.2])
    >>> A, B = sd.step_derivatives(model, q, v, tau, 0.01, "rk4")
    >>> A.shape, B.shape
    ((4, 4), (4, 2))
    >>> dq, dv = 1e-6 * np.array([1.0, 2.0]), 1e-6 * np.array([-1.0, 0.5])
    >>> before, after = (sd.step(model, q + s * dq, v + s * dv, tau, 0.01, "rk4") for s in (-1, 1))
    >>> moved = np.concatenate([sd.difference(model, before[0], after[0]), after[1] - before[1]]) / 2
    >>> bool(abs(moved - A @ np.concatenate([dq, dv])).max() < 1e-14)
    True
    >>> rubs = sd.Scene(model, friction=sd.Friction([50.0, 0.0]))
    >>> found = sd.step_derivatives(rubs, q, np.zeros(2), tau, 0.01)
    >>> found.labels, found.active.tolist(), bool(abs(found.A[2]).max() < 1e-9)
    (('friction of joint "joint1"',), ['sticks'], True)
    """
    scene, fext = _scene(scene, fext)
    model = scene.model
    others = scene.constraints is not None or has_springs(model)
    smooth = _is_smooth(scene) and isinstance(method, str) and method in STEPS
    if others or ((scene.solves or isinstance(scene.friction, Friction)) and not smooth):
        return scene_derivatives(scene, q, v, tau, _steps(dt), method, fext, states)
    run_states(model, (), (), states)  # raises for any state
    turns, law = _checked(scene)
    spec = (TURNING_STEPS if turns else STEPS).get(method) if isinstance(method, str) else None
    if spec is None:
        return StepDerivatives(*_implicit(model, q, v, tau, dt, method, fext))
    h = _steps(dt)[..., None]
    if h.ndim == 1 and type(q) is np.ndarray and q.ndim == 2:
        h, law = h[None], tuple(x if x is None else x[None] for x in law)  # rows for the fastest call of the program
    found = checked_call(spec, model, (q, v, tau, fext, h, *law), (), None)
    n = model.nv
    if turns:
        _check_turns(found[..., 2 * n, 0], method)
    return StepDerivatives(found[..., : 2 * n, : 2 * n], found[..., : 2 * n, 2 * n :])


def linearize(
    scene: Scene | Model,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike | None = None,
    method: str | None = None,
    fext: ArrayLike | None = None,
    states: Mapping[str, ArrayLike] | None = None,
) -> StepDerivatives:
    """The linear system of a robot near a state: continuous, d/dt δx = A δx + B δτ, or of a step with dt and method.

    Arguments are those of ``step_derivatives``; in continuous time a scene may have constraints, springs and friction
    that is viscous or has a ``smoothing``, which acts here, but nothing that acts by impulses. About a moving state δx
    is the difference from that motion, in the frames of its bodies, which turn: for a body with velocity v, d/dt δq =
    δv - v × δq, the commutator of twists.

    Returns A (..., 2 nv, 2 nv) and B (..., 2 nv, nv), views of one array; with dt and method as ``step_derivatives``.
    Raises  SpatialDynError for one of dt and method without the other; the errors of ``step_derivatives``.

    >>> import spatialdyn as sd
    >>> A, B = sd.linearize(sd.load_urdf("pendulum"), [0.0], [0.0], [0.0])
    >>> A.round(9).tolist(), B.round(9).tolist()
    ([[0.0, 1.0], [-14.715, 0.0]], [[0.0], [3.0]])
    """
    if dt is not None and method is not None:
        return step_derivatives(scene, q, v, tau, dt, method, fext, states)
    if dt is not None or method is not None:
        given, lacking = ("dt", "method") if method is None else ("method", "dt")
        raise SpatialDynError(
            f"{given} is given and no {lacking}, expected both for a step or none for continuous time"
        )
    scene, fext = _scene(scene, fext)
    model = scene.model
    run_states(model, (), (), states)  # raises for any state
    n, scene = model.nv, _damped(scene)
    _, law = _checked(scene)
    if scene.constraints is not None:
        return constrained_linearization(scene, q, v, tau, fext)
    springs = torques_near(model, (), q, v)
    if springs is not None:
        tau = as_array("tau", tau) + springs[0]
    found = checked_call(MOTION, model, (q, v, tau, fext, *law), (), None)
    if springs is not None:
        found[..., n:, : 2 * n] += found[..., n:, 2 * n :] @ springs[1]
    return StepDerivatives(found[..., : 2 * n], found[..., 2 * n :])


def _is_smooth(scene: Scene) -> bool:
    """Whether only friction acts, by its smooth law."""
    alone = scene.contacts is None and not scene.limits and scene.motor is None
    return isinstance(scene.friction, Friction) and scene.friction_method == SMOOTH and alone


def _damped(scene: Scene) -> Scene:
    """The scene with friction as the torque that it is in continuous time: smooth, or viscous alone."""
    law, alone = scene.friction, scene.contacts is None and not scene.limits and scene.motor is None
    if not isinstance(law, Friction) or scene.friction_method != IMPLICIT or not alone:
        return scene
    if law.smoothing is None:
        if law.coulomb.any() or law.static.any():
            return scene
        law = Friction(viscous=law.viscous, smoothing=1.0)
    return scene.with_(friction=law, friction_method=SMOOTH)


def _scene(given: Scene | Model, fext: ArrayLike | None) -> tuple[Scene, ArrayLike | None]:
    """The scene, and its forces added to those of a call."""
    scene = scene_of(given)
    if scene.fext is not None:
        fext = scene.fext if fext is None else as_array("fext", fext) + scene.fext
    return scene, fext


def _checked(scene: Scene) -> tuple[tuple[slice, ...], tuple[Array | None, ...]]:
    """The angular velocities of joints of several freedoms; coefficients of smooth friction, NO_LAW without friction.

    Raises for what acts and is no smooth force.
    """
    turns, rubs = _facts(scene.model)
    rough = [x for x in scene.acts if x not in ("constraints", "friction", "fext", "springs")]
    friction, way = scene.friction, scene.friction_method
    if isinstance(friction, Friction) and way != SMOOTH:
        rough.append(f"{friction!r} by {way} steps")
    if rough:
        why = "Coulomb's law has no derivative where a joint begins to stick, and impulses act in steps"
        if way == LUGRE and len(rough) == 1:
            why = "bristles are a state beside q and v, which steps carry"
        raise SimulationError(
            f"{', '.join(rough)} acts in the scene, expected constant forces, constraints, springs, viscous friction "
            f"and a Friction with smoothing: {why}: dt and method give the derivatives of one; a torque of your own "
            "has some by the chain rule with B"
        )
    if isinstance(friction, Friction):
        return turns, (*friction.law, friction.smoothing)
    if rubs and scene.friction is None:
        _warn(scene.model)
    return turns, NO_LAW


@lru_cache(maxsize=64)
def _warn(model: Model) -> None:
    """Warn once of friction that is left out."""
    text = f'robot "{model.name}" has joint damping or friction, which derivatives of steps leave out; friction=False'
    warnings.warn(f"{text} says that this is meant", stacklevel=4)


@lru_cache(maxsize=64)
def _facts(model: Model) -> tuple[tuple[slice, ...], bool]:
    """The angular velocities of joints of several freedoms; whether the URDF has friction."""
    turns = []
    for i, row in enumerate(independent(model.bodies)[1:]):
        if NV[row["kind"]] > 1:
            turns.append(slice(i + LENGTHS[row["kind"]], i + NV[row["kind"]]))
    return tuple(turns), bool(model.damping.any() or model.friction.any())


def _steps(dt: ArrayLike) -> Array:
    """dt as an array. Raises SpatialDynError if it is not finite."""
    if type(dt) is float and math.isfinite(dt):
        return np.array(dt)
    h = as_array("dt", dt)
    if not np.isfinite(h).all():
        raise SpatialDynError(f"dt is {literal(dt)}, expected finite numbers")
    return h


def _check_turns(square: Array, method: str) -> None:
    """Raise SimulationError naming the first sample in which a joint turns by π or more; squares [rad²]."""
    beyond = np.argwhere(square >= HALF_TURN)
    if len(beyond):
        at, where = beyond[0].tolist(), ""
        if at:
            where = f" in sample {at[0] if len(at) == 1 else tuple(at)}, the first of {len(beyond)}"
        angle = math.sqrt(square[tuple(at)])
        raise SimulationError(
            f"a joint turns by {angle:.3g} rad in a step of {method}{where}, expected less than π; reduce dt"
        )


def _implicit(
    model: Model, q: ArrayLike, v: ArrayLike, tau: ArrayLike, dt: ArrayLike, method: Any, fext: ArrayLike | None
) -> tuple[Array, Array]:
    """``step_derivatives`` of a method that solves equations."""
    check_implicit(method)
    specs, values = [Q, V, TAU], [q, v, tau]
    if fext is not None:
        specs, values = [*specs, FEXT], [*values, fext]
    given = [as_array(x.name, value) for x, value in zip(specs, values, strict=True)]
    h = _steps(dt)
    shapes = [batch_shape(model, x, a) for x, a in zip(specs, given, strict=True)]
    batch = broadcast([*(x.name for x in specs), "dt"], [*shapes, h.shape])
    n, count = model.nv, math.prod(batch)
    made = np.full((count, 2 * n, 3 * n), np.nan)
    if made.size:
        whole = [np.broadcast_to(a, batch + core_shape(model, x)) for x, a in zip(specs, given, strict=True)]
        p = calls["momentum"](model, *whole[:2])
        calls["velocity_from_momentum"](model, whole[0], p)  # raises InertiaError at a singular M
        steps = np.broadcast_to(h, batch)
        for part in _facts(model)[0]:
            turned = steps[..., None] * whole[1][..., part]
            _check_turns((turned * turned).sum(axis=-1), method)
        flat = [np.ascontiguousarray(x.reshape((count, *x.shape[len(batch) :]))) for x in (*whole, p)]
        sound = np.flatnonzero(np.logical_and.reduce([np.isfinite(x.reshape(count, -1)).all(axis=1) for x in flat]))
        q, v, tau, *forces, p = (x[sound] for x in flat)
        if len(sound):
            begun = Begun(q, v, p, tau, steps.reshape(count)[sound], forces[0] if forces else None)
            made[sound] = implicit_derivatives.derivatives(model, integrators[method], begun, batch, sound)
    found = made.reshape((*batch, 2 * n, 3 * n))
    return found[..., : 2 * n], found[..., 2 * n :]
