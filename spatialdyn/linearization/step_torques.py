"""Torques and friction of a step by impulses, with derivatives: motors, bristles, springs and smooth friction.

A step takes torques τ, viscous friction b and levels F of dry friction from the state at its beginning. For a motor all
three are functions of v and of the command (``recursions.joints.motors.driven``). Bristles give a torque and viscous
friction, functions of their state z and of v (``recursions.joints.friction.add_bristles``). Springs and smooth friction
give torques, functions of q and v. Each function is differentiated on its present branch; where the branch changes, the
derivative is one-sided.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, batch_shape, broadcast
from ..calls.by_program import along, run
from ..calls.dynamics import calls, checked_call
from ..calls.failures import joint_of_velocity
from ..model.model import Model
from ..recursions.joints.friction import (
    BRISTLE_LAW,
    BRISTLES,
    DT,
    FRICTION_TORQUE,
    BristleLaw,
    add_bristles,
)
from ..recursions.joints.springs import SPRING_TORQUE
from ..recursions.spec import TAU, Argument, Q, Spec, V
from ..simulation.effects.effect import Effect, find
from ..simulation.effects.friction import DryFriction, LuGreFriction, SmoothFriction
from ..simulation.effects.motor import VOLTAGE, Drive, geared
from ..simulation.effects.springs import has_springs

Array = NDArray[Any]
COMMANDED, SATURATED, BENDS = "commanded", "saturated", "bends"


class Torques(NamedTuple):
    """Torques and friction in n steps, without impulses of points and limits; m derivatives, by q, v, z and τ.

    torque     (n, nv)
    law        coulomb, viscous, static, stribeck, each (n, nv); () without friction
    by_torque  (n, nv, m) derivatives of the torque
    by_viscous, by_level  (n, nv, m) derivatives of viscous friction and of the level of dry friction; 0 if constant
    kept       (n, nv) part of z + h v⁺ that bristles keep; ``by_kept`` its derivatives; None without bristles
    by_kept
    labels     names of motors and bristles
    active     (n, labels) states of motors and bristles
    margins    (n, labels) distance of each from its nearest other state [rad/s | m/s]
    """

    torque: Array
    law: tuple[Array, ...]
    by_torque: Array
    by_viscous: Any
    by_level: Any
    kept: Array | None
    by_kept: Array | None
    labels: tuple[str, ...]
    active: Array
    margins: Array

    def of(self, rows: slice) -> Torques:
        """The torques of some steps."""
        return Torques(*(_rows(x, rows) for x in self))


def _rows(x: Any, rows: slice) -> Any:
    """Some rows of an array, or of all arrays of a law; returns anything else unchanged."""
    if isinstance(x, tuple):
        return tuple(y[rows] if isinstance(y, np.ndarray) else y for y in x)
    return x[rows] if isinstance(x, np.ndarray) else x


def torques_of(
    model: Model, effects: tuple[Effect, ...], q: Array, v: Array, z: Array | None, tau: Array, h: Array
) -> Torques:
    """The Torques of the effects of a run, at states (n, ...).

    z  (n, nv) state of bristles; None without bristles
    """
    n, nv = v.shape
    motor, rubs = find(effects, Drive), find(effects, DryFriction)
    bristles = find(effects, LuGreFriction)
    m = 3 * nv if z is None else 4 * nv
    by = np.array(_all(np.eye(nv, m, m - nv), n))
    law = () if rubs is None else tuple(np.broadcast_to(x, (n, nv)) for x in rubs.friction.law)
    made = Torques(tau, law, by, 0.0, 0.0, None, None, *nothing_labelled(n))
    if motor is not None:
        made = _of_motor(model, motor, q, v, tau, h, law, made)
    if bristles is not None and z is not None:
        made = _of_bristles(model, bristles, v, z, tau, h, made)
    more = smooth_torques(model, effects, q, v, _all(np.eye(nv, m), n), _all(np.eye(nv, m, nv), n))
    if more is not None:
        made = made._replace(torque=made.torque + more[0], by_torque=made.by_torque + more[1])
    return made


def smooth_torques(
    model: Model, effects: tuple[Effect, ...], q: Array, v: Array, by_q: Array, by_v: Array
) -> tuple[Array, Array] | None:
    """Torques (n, nv) of springs and smooth friction, and derivatives (n, nv, m) along m directions; None if none act.

    by_q, by_v  (n, nv, m) parts of the directions in q and in v
    """
    n, nv = v.shape
    acting: list[tuple[Spec, list[Array]]] = [(SPRING_TORQUE, [q, v])] if has_springs(model) else []
    smooth = find(effects, SmoothFriction)
    if smooth is not None:
        values = [np.broadcast_to(x[0], (n, nv)) for x in smooth.values.values()]
        acting.append((FRICTION_TORQUE, [v, *values]))
    torque, by = np.zeros((n, nv)), np.zeros((n, nv, by_q.shape[2]))
    named = {"q": by_q, "v": by_v}
    for spec, given in acting:
        tangents: list[Any] = [named.get(x.name, nv) for x in spec.present]
        torque = torque + checked_call(spec, model, tuple(given), (), None)
        by = by + along(model, spec, [np.ascontiguousarray(x) for x in given], tangents)
    return (torque, by) if acting else None


def torques_near(model: Model, effects: tuple[Effect, ...], q: ArrayLike, v: ArrayLike) -> tuple[Array, Array] | None:
    """As ``smooth_torques``, of batches (..., nq) and (..., nv), with derivatives (..., nv, 2 nv) by (q, v)."""
    if not has_springs(model) and find(effects, SmoothFriction) is None:
        return None
    nv, given = model.nv, [as_array(x.name, y) for x, y in ((Q, q), (V, v))]
    batch = broadcast(["q", "v"], [batch_shape(model, x, y) for x, y in zip((Q, V), given, strict=True)])
    n = math.prod(batch)
    q, v = (np.broadcast_to(x, (*batch, x.shape[-1])).reshape((n, x.shape[-1])) for x in given)
    found = smooth_torques(model, effects, q, v, _all(np.eye(nv, 2 * nv), n), _all(np.eye(nv, 2 * nv, nv), n))
    assert found is not None
    return found[0].reshape((*batch, nv)), found[1].reshape((*batch, nv, 2 * nv))


def nothing_labelled(n: int) -> tuple[tuple[str, ...], Array, Array]:
    """Labels, states and margins of steps without motors and bristles."""
    return (), np.empty((n, 0), "<U11"), np.empty((n, 0))


def bent_labels(model: Model, bristles: LuGreFriction, v: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Labels, states and margins of bristles; their slip changes with the sign of v."""
    coulomb, _, static, _ = bristles.friction.law
    rows = np.flatnonzero((np.maximum(coulomb, static) > 0.0) & (bristles.friction.bristle_stiffness > 0.0))
    labels = tuple(f'bristles of joint "{joint_of_velocity(model, int(k)).name}"' for k in rows)
    return labels, np.full((len(v), len(rows)), BENDS, "<U11"), abs(v[:, rows])


def _all(x: Array, n: int) -> Array:
    return np.broadcast_to(x, (n, *x.shape))


# --- motors ---------------------------------------------------------------------------------------------


def _of_motor(
    model: Model, motor: Drive, q: Array, v: Array, tau: Array, h: Array, law: tuple[Array, ...], made: Torques
) -> Torques:  # fmt: skip
    (n, nv), m = v.shape, made.by_torque.shape[2]
    lines = [np.array(np.broadcast_to(x, (n, nv))) for x in motor.motor.lines]
    given, spec = [v, tau, *lines], _motor_spec(motor.inputs)
    tangents: list[Any] = [_all(np.eye(nv, m, nv), n), _all(np.eye(nv, m, m - nv), n), *(nv for _ in lines)]
    push, slope, level = np.moveaxis(run(model, spec, "", given).reshape((n, 3, nv)), 1, 0)
    driven = motor.motor.torque_constant > 0.0
    by = along(model, spec, given, tangents).reshape((n, 3, nv, m)) * driven[:, None]  # others have no torque to limit
    coulomb, viscous, static, stribeck = law
    saturated, margins = _sides(motor, v, tau, lines)
    answers = h[:, None] * np.diagonal(calls["minverse"](model, q), axis1=1, axis2=2)
    rows = np.flatnonzero(driven)
    return made._replace(
        torque=push, law=(coulomb + level, viscous + slope, static + level, stribeck),
        by_torque=by[:, 0], by_viscous=by[:, 1], by_level=by[:, 2],
        labels=tuple(f'motor of joint "{joint_of_velocity(model, int(k)).name}"' for k in rows),
        active=np.where(saturated, SATURATED, COMMANDED).astype("<U11")[:, rows],
        margins=np.minimum(answers * margins[0], margins[1])[:, rows],
    )  # fmt: skip


def _sides(motor: Drive, v: Array, tau: Array, lines: list[Array]) -> tuple[NDArray[np.bool_], tuple[Array, Array]]:
    """Whether motors are at a limit, and the distances, in torque and in velocity, to another branch of ``driven``."""
    stall, emf, most, efficiency, limit = lines
    if motor.given == VOLTAGE:
        over = abs(tau) - stall
        motor_torque = np.clip(tau, -stall, stall) - emf * v
    else:
        back = emf * v
        over = np.maximum(tau + back - stall, -stall - (tau + back))
        motor_torque = np.clip(tau, -stall - back, stall - back)
    size, lossy = abs(motor_torque), efficiency < 1.0
    cap = np.minimum(most, limit * np.where(motor_torque * v < 0.0, efficiency, 1.0 / efficiency))
    torque = np.minimum(abs(over), abs(size - cap))
    torque = np.where(lossy, np.minimum(torque, size), torque)  # losses change with the sign of the torque
    turns = lossy & (size >= np.minimum(most, limit * efficiency))  # the gear's limit differs with the sign of v
    return (over > 0.0) | (size > cap), (torque, np.where(turns, abs(v), np.inf))


@cache
def _motor_spec(lines: tuple[Argument, ...]) -> Spec:
    """The Spec of ``geared`` alone: torque, viscous friction and level of dry friction (3, nv)."""

    def recursion(rows: Any, v: Any, tau: Any, *rest: Any) -> None:
        zero = np.zeros(len(v), np.asarray(v).dtype)
        given = dict(zip((x.name for x in lines), rest[:-1], strict=True))
        push, (level, slope, *_) = geared(given, v, tau, (zero, zero, zero, zero))
        rest[-1][0], rest[-1][1], rest[-1][2] = push, slope, level

    return Spec(
        "motor_of_a_step", recursion, None, (V, TAU, *lines), Argument("driven", (3, "nv"), "", "torque, slope, level"),
        "Torque and friction of motors over a step.", "see ``recursions.joints.motors``", composed=True, stamped=False,
    )  # fmt: skip


# --- bristles -------------------------------------------------------------------------------------------


def _of_bristles(
    model: Model, bristles: LuGreFriction, v: Array, z: Array, tau: Array, h: Array, made: Torques
) -> Torques:  # fmt: skip
    (n, nv), m = v.shape, made.by_torque.shape[2]
    rows = [np.array(np.broadcast_to(x[0], (n, nv))) for x in bristles.values.values()]
    given = [v, z, tau, h[:, None], *rows]
    units = [_all(np.eye(nv, m, k * nv), n) for k in (1, 2, 3)]
    push, slope, kept = np.moveaxis(run(model, BENT, "", given).reshape((n, 3, nv)), 1, 0)
    by = along(model, BENT, given, [*units, 1, *(nv for _ in rows)]).reshape((n, 3, nv, m))
    zero = np.zeros((n, nv))
    labels, active, margins = bent_labels(model, bristles, v)
    return made._replace(
        torque=push, law=(zero, slope, zero, np.ones((n, nv))), by_torque=by[:, 0], by_viscous=by[:, 1],
        kept=kept, by_kept=by[:, 2], labels=labels, active=active, margins=margins,
    )  # fmt: skip


def _bent(rows: Any, v: Any, z: Any, tau: Any, dt: Any, *rest: Any) -> None:
    n, out = len(v), rest[-1]
    M, r, kept = np.zeros((n, n), object), np.zeros(n, object), np.zeros(n, object)
    add_bristles(v, z, tau, dt, BristleLaw(*rest[:-1]), M, r, kept)
    for i in range(n):
        slope = M[i, i] / dt
        out[0, i], out[1, i], out[2, i] = r[i] + slope * v[i], slope, kept[i]


BENT = Spec(
    "bristles_of_a_step", _bent, None, (V, BRISTLES, TAU, DT, *BRISTLE_LAW),
    Argument("bent", (3, "nv"), "", "torque, viscous friction, part of z + h v that is kept"),
    "Torque and friction of bristles over a step.", "see ``recursions.joints.friction``", composed=True, stamped=False,
)  # fmt: skip
