"""A UR5 presses on a wall like a spring, and a Panda moves its elbow while its hand stands still.

Learn    sd.Impedance makes a frame a spring and a damper: a target behind a wall, a force of K times what is missing.
         sd.cartesian_damping finds the damper for the frame's mass there, the Λ of sd.operational_space.
Look at  the force: it comes to rest at K d without a force sensor, and no gain is tuned for contact. With 2 ζ √K,
         which leaves Λ out, the modes have dampings all over. A Panda with one joint more than a pose needs keeps its
         hand still while sd.task_torque moves its elbow by a posture.
Needs    pip install example-robot-data for the UR5 and the Panda
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

START = np.array([0.0, -1.2, 1.8, -0.6, 1.5708, 0.0])
K, DEPTH, WALL = np.array([800.0] * 3 + [40.0] * 3), 0.03, 0.02
POSE = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8, 0.02, 0.02])


def ratios(Lambda: Any, D: Any) -> Any:
    """Damping of the modes of a mass Λ on springs K."""
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(Lambda, np.diag(K)), -np.linalg.solve(Lambda, D)]])
    w = np.linalg.eigvals(A)
    return np.sort(-w.real / abs(w))


def press(seconds: float) -> tuple[Any, Any, Any, Any]:
    """Times and forces of a hand that is sent DEPTH behind a wall, and the ratios of two dampings."""
    model = sd.load_urdf("ur5")
    X = sd.frame_placement(model, START, "tool0")
    x = sd.operational_space(model, START, np.zeros(6), "tool0", "local_world_aligned")
    D = sd.cartesian_damping(x.Lambda, K, 0.7)
    target = X.copy()
    target[0, 3] += WALL + DEPTH
    wall = sd.Plane(normal=(-1.0, 0.0, 0.0), height=-(X[0, 3] + WALL))
    scene = sd.Scene(model, contacts=sd.Contacts(model, {"tool0": 0.0}, friction=0.3, terrain=wall))
    law = sd.Impedance(model, "tool0", target, K, D)
    run = sd.simulate(scene, START, np.zeros(6), seconds, 2e-3, control=law, record="contacts")
    force = K[0] * (target[0, 3] - sd.frame_placement(model, run.q, "tool0")[:, 0, 3])
    return run.t, force, ratios(x.Lambda, D), ratios(x.Lambda, np.diag(2 * 0.7 * np.sqrt(K)))


def swing(seconds: float) -> tuple[float, float]:
    """How far the elbow of a Panda moves, and its hand [m]."""
    scene = sd.Scene(sd.load_urdf("panda"), friction=False)
    model = scene.model
    hold = sd.FrameTask("panda_hand", target=sd.frame_placement(model, POSE, "panda_hand"), Kp=400.0)
    aside = sd.PostureTask(POSE + np.r_[0.0, 0.0, 0.8, np.zeros(6)], Kp=25.0)

    def torque(t: float, q: Any, v: Any) -> Any:
        return sd.task_torque(model, q, v, hold, aside).tau

    run = sd.simulate(scene, POSE, np.zeros(9), seconds, 4e-3, torque=torque)
    elbow, hand = (sd.frame_placement(model, run.q, name)[:, :3, 3] for name in ("panda_link4", "panda_hand"))
    return float(np.linalg.norm(elbow - elbow[0], axis=1).max()), float(np.linalg.norm(hand - hand[0], axis=1).max())


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print the force at rest, the damping of both choices, and what elbow and hand move; returns them."""
    t, force, exact, root = press(1.0 if quick else 3.0)
    elbow, hand = swing(0.5 if quick else 2.0)
    print(f"pressing: {force[-1]:.2f} N at rest, K d is {K[0] * DEPTH:.2f} N")
    print(
        f"damping of the modes: {exact.min():.3f} to {exact.max():.3f}, by 2 ζ √K {root.min():.2f} to {root.max():.2f}"
    )
    print(f"null space: the elbow moves {elbow:.3f} m, the hand {hand:.1e} m")
    if save:
        figure, axes = picture()
        axes.plot(t, force)
        axes.axhline(K[0] * DEPTH, color="0.5", linestyle="--", label="K d")
        axes.set(xlabel="t [s]", ylabel="K (target - hand) across the wall [N]")
        axes.legend()
        write(figure, save)
    return {"force": force, "exact": exact, "root": root, "elbow": elbow, "hand": hand}


if __name__ == "__main__":
    start(main)
