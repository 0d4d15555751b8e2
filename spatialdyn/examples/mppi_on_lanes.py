"""Sampling-based control: a Panda reaches for a point by trying a thousand motions at every step (MPPI).

Learn    rollout(control=..., cost=...) records a law and a cost of your own into the step: here servos that follow 8
         knots of speed, and the distance to the goal, the speed and the effort. It brings back one number a sample, and
         1024 motions of 50 steps take milliseconds on SIMD lanes.
Look at  the time of a plan, and the distance that falls to millimetres. The plan moves by the mean of the noise,
         weighed by exp(-cost / λ). The noise is seeded, and no bit of a rollout depends on the number of threads.
Needs    pip install example-robot-data for the Panda

Source: Williams et al., Information theoretic MPC for model-based reinforcement learning (2017).
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.algebra.records import table_dtype
from spatialdyn.algebra.spatial import Pose, identity_pose
from spatialdyn.examples.gallery import picture, start, write
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V
from spatialdyn.recursions.steps import seen_from_parent

SAMPLES, STEPS, KNOTS, DT = 1024, 50, 8, 0.01  # a plan looks half a second ahead
NOISE, GAIN = 0.4, 15.0  # a knot's standard deviation [rad/s]; of the servo [1/s], times a joint's free inertia
START, GOAL = np.array([0.0, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]), np.array([0.35, 0.45, 0.55])  # [rad]; of the wrist [m]
SHARE = np.clip(1.0 - abs(np.linspace(0.0, KNOTS - 1.0, STEPS)[:, None] - np.arange(KNOTS)), 0.0, None)  # linear
LATER = SHARE[1, 0] * np.eye(KNOTS) + SHARE[1, 1] * np.eye(KNOTS, k=1)  # the same knots one step on; the last fades


def servos(bodies, v, knots, share, gain, tau):  # type: ignore[no-untyped-def]
    """Servos that follow speeds between knots."""
    for j in range(len(tau)):
        tau[j] = gain[j] * (sum(share[k] * knots[k, j] for k in range(len(share))) - v[j])


def reach(bodies, work, q, v, tau, goal, row, cost):  # type: ignore[no-untyped-def]
    """Distance to the goal, speed, effort."""
    X, i = identity_pose(), row
    while i > 0:
        X = seen_from_parent(bodies, work, i, q, X)
        i = bodies[i].parent
    cost[0] = sum(100.0 * (x - goal[j]) * (x - goal[j]) for j, x in enumerate(X.p))
    cost[0] = cost[0] + sum(0.1 * v[j] * v[j] + 1e-3 * tau[j] * tau[j] for j in range(len(v)))


KNOT = Argument("knots", (KNOTS, "nv"), "rad/s", "speeds"), Argument("share", (KNOTS,), "", "of each knot in a step")
SERVOS = (V, *KNOT, Argument("gain", ("nv",), "N m s", "of servos"))
AT = Argument("goal", (3,), "m", "where to go"), Argument("row", (), "", "of the body that goes there", static=True)
# regroup=True: neither law nor cost reads inertias
LAW = Spec("servos", servos, None, SERVOS, TAU, "Servos along knots.", "", regroup=True)
COST = Spec("reach", reach, table_dtype(X=Pose), (Q, V, TAU, *AT), Argument("cost", (1,), "", ""), "", "", regroup=True)


def better(model: sd.Model, plan: Any, q: Any, v: Any, rng: np.random.Generator) -> Any:
    """A better plan (KNOTS, nv), and its torque of now."""
    half = rng.standard_normal((SAMPLES // 2, *plan.shape), np.float32)
    noise = NOISE * np.concatenate([half, -half])  # motions and their mirror images: drawing takes time
    gain = GAIN / np.diagonal(sd.minverse(model, q))
    law = sd.Control(LAW, {"knots": (plan + noise)[:, None], "share": SHARE, "gain": gain})
    how: Any = {"cost": sd.Cost(COST, {"goal": GOAL, "row": model.nv}), "dtype": np.float32}
    found = sd.rollout(sd.Scene(model, friction=False), q, v, dt=DT, steps=STEPS, control=law, check=False, **how).cost
    cost = np.nan_to_num(found, nan=np.inf) - np.nanmin(found)
    plan = plan + np.average(noise, 0, np.exp(-cost / (0.1 * np.median(cost))))
    return plan, gain * (plan[0] - v)


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Reach, and print the time of a plan and the distance; returns both."""
    # seven joints, the fingers locked, whose servos compensate for their weight
    model = sd.load_urdf("panda").with_(gravity=(0, 0, 0)).reduced(["panda_finger_joint1", "panda_finger_joint2"])
    rng, plan, q, v = np.random.default_rng(0), np.zeros((KNOTS, model.nv)), START, 0.0 * START
    distance, seconds = [], []
    for _ in range(80 if quick else 250):
        seconds.append(-time.perf_counter())
        plan, torque = better(model, plan, q, v, rng)
        seconds[-1] += time.perf_counter()
        q, v, plan = *sd.step(model, q, v, torque, DT), LATER @ plan
        distance.append(float(np.linalg.norm(sd.forward_kinematics(model, q)[-1, :3, 3] - GOAL)))
    print(f"{SAMPLES} motions of {STEPS} steps, {KNOTS} knots, float32: {1e3 * np.median(seconds):.1f} ms a plan;")
    print(f"distance {distance[0]:.3f} m at first, {distance[-1]:.4f} m after {DT * len(distance):.1f} s")
    if save:
        figure, axes = picture()
        axes.semilogy(DT * np.arange(len(distance)), distance)
        axes.set(xlabel="time [s]", ylabel="distance to the goal [m]", title="Panda, MPPI on lanes")
        write(figure, save)
    return {"distance": distance, "seconds": seconds}


if __name__ == "__main__":
    start(main)
