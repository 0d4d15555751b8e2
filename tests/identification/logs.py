"""Logs of an arm that follows a path, by other simulators: held torques, friction, a delay, encoders' steps."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

import spatialdyn as sd

PERIOD = 2e-3  # s, of the controller and of the log
BITS = 21  # of an encoder: a turn has 2^BITS steps
NOISE = np.array([0.1, 0.1, 0.08, 0.03, 0.03, 0.02])  # N m


class Made(NamedTuple):
    """A log, and what it was made with."""

    log: sd.Recording
    friction: sd.Friction
    delay: float


@cache
def arm() -> sd.Model:
    """A UR5, with friction of its own in its joints."""
    return sd.load_urdf("ur5")


FRICTION = sd.Friction(coulomb=[1.0, 1.0, 0.8, 0.3, 0.3, 0.2], viscous=[1.0, 1.0, 0.8, 0.2, 0.2, 0.1])


@cache
def path(seed: int) -> sd.Path:
    """A path of 8 s that excites the arm, at rest at its start."""
    return sd.excitation(arm(), 8.0, 4, starts=6, steps=8, acceleration=6.0, seed=seed)


def followed(
    model: sd.Model, path: sd.Path, substeps: int, late: int, start: Callable[[Any, Any], None],
    step: Callable[[Any], None], state: Callable[[], Any],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """t, q and τ of a controller whose torques act ``late`` substeps after it gave them, and are held."""
    n = round(path.duration / PERIOD)
    t = np.arange(n) * PERIOD
    goal = path(t)
    feed = sd.rnea(model, *goal)
    start(goal.q[0], goal.v[0])
    at_rest = sd.rnea(model, goal.q[0], goal.v[0], goal.a[0])
    waiting = deque([at_rest] * late)
    M = np.diagonal(sd.crba(model, goal.q[0]))
    Q, T = np.empty((n, model.nq)), np.empty((n, model.nv))
    for k in range(n):
        q, v = state()
        tau = feed[k] + M * (100.0 * (goal.q[k] - q) + 20.0 * (goal.v[k] - v))
        Q[k], T[k] = q, tau
        for _ in range(substeps):
            waiting.append(tau)
            step(waiting.popleft())
    return t, Q, T


def made(t: np.ndarray, Q: np.ndarray, T: np.ndarray, seed: int) -> sd.Recording:
    """The log: positions in steps of the encoder, torques with white noise."""
    unit = 2.0 * np.pi / 2**BITS
    return sd.Recording(t, np.round(Q / unit) * unit, T + NOISE * np.random.default_rng(seed).normal(size=T.shape))


@cache
def mujoco_log(seed: int) -> Made:
    """By MuJoCo: implicit integration, dry friction of its own solver, torques 3.5 ms late."""
    import mujoco

    model = arm()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of velocity limits, which MJCF has not
        spec = mujoco.MjSpec.from_string(sd.to_mjcf(model))
    for joint, b, c in zip(spec.joints, FRICTION.viscous, FRICTION.coulomb, strict=True):
        joint.damping = [b, 0.0, 0.0] if np.ndim(joint.damping) else b
        joint.frictionloss = c
        joint.limited = False
    spec.option.timestep = 5e-4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    world = spec.compile()
    data = mujoco.MjData(world)

    def start(q: Any, v: Any) -> None:
        data.qpos, data.qvel = sd.to_mujoco(model, q, v)

    def step(tau: Any) -> None:
        data.qfrc_applied[:] = tau
        mujoco.mj_step(world, data)

    t, Q, T = followed(model, path(seed), 4, 7, start, step, lambda: (data.qpos.copy(), data.qvel.copy()))
    return Made(made(t, Q, T, seed), FRICTION, 7 * 5e-4)


@cache
def pinocchio_log(seed: int) -> Made:
    """By Pinocchio's aba and Heun's method, friction as a steep tanh, torques 1 ms late."""
    import pinocchio as pin

    from spatialdyn.urdf.load import robot_names

    model = arm()
    robot = pin.buildModelFromUrdf(str(robot_names()["ur5_robot"]))
    data = robot.createData()
    now: list[np.ndarray] = []
    h = 5e-4

    def start(q: Any, v: Any) -> None:
        now[:] = [np.array(q), np.array(v)]

    def rate(q: Any, v: Any, tau: Any) -> Any:
        return pin.aba(robot, data, q, v, tau - FRICTION.viscous * v - FRICTION.coulomb * np.tanh(v / 5e-3)).copy()

    def step(tau: Any) -> None:
        q, v = now
        a = rate(q, v, tau)
        b = rate(q + h * v, v + h * a, tau)
        now[:] = [q + h * v + 0.5 * h * h * a, v + 0.5 * h * (a + b)]

    t, Q, T = followed(model, path(seed), 4, 2, start, step, lambda: (now[0].copy(), now[1].copy()))
    return Made(made(t, Q, T, seed), FRICTION, 2 * h)
