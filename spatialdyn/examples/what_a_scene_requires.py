"""A panda lifts a payload: which of the nine parts of its scene the motion needs.

Learn    sd.requires says which parts of a scene a motion needs, measured on the model, and gives the least scene.
Look at  the verdicts. Friction, rotors and gravity move the arm by far more than 1e-3 rad; the table below the hand,
         the limits, the motors, a draught and the fingers' own freedoms do not, and cost most of the time. That is so
         for this motion alone: another one meets the table.
Needs    pip install example-robot-data for the panda
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write
from spatialdyn.pictures.requirement_plots import draw_requirement

DURATION, STEPS, TOLERANCE = 0.4, 40, 1e-3
BRAKED = {"panda_joint1": 0.0, "panda_joint3": 0.0, "panda_joint5": 0.0, "panda_joint7": 0.785}
ARM = ("panda_joint2", "panda_joint4", "panda_joint6")  # which lift in a plane
GRASP = np.array([0.4, -2.0, 2.4, 0.02, 0.02])
LIFT = np.array([-0.25, 0.15, 0.1, 0.0, 0.0])  # [rad], in all of the duration


def lifting() -> tuple[sd.Scene, np.ndarray]:
    """A panda in a plane with 2 kg in its hand and all that acts on it, and torques (STEPS, nv) that lift it."""
    model = (
        sd.load_urdf("panda")
        .reduced(BRAKED)
        .with_(
            rotors={name: sd.Rotor(1e-5, 100.0) for name in ARM},
            payload={"panda_hand": (2.0, (0.0, 0.0, 0.1), 0.002 * np.eye(3))},
        )
    )
    s = (np.arange(STEPS)[:, None] + 0.5) / STEPS
    way, rate, rise = (x * LIFT for x in (s**2 * (3 - 2 * s), 6 * s * (1 - s) / DURATION, (6 - 12 * s) / DURATION**2))
    torque = np.asarray(sd.rnea(model, GRASP + way, rate, rise))
    draught = np.zeros((model.njoints, 6))
    draught[3, 1] = 0.01  # [N] on the hand
    friction = sd.Friction(coulomb=[0.3, 0.3, 0.3, 5.0, 5.0], viscous=[0.5, 0.5, 0.5, 5.0, 5.0])  # fingers hold by it
    motor = sd.Motor(np.full(5, 0.1), 0.2, 48.0, 100.0)
    table = sd.Contacts(model, {"panda_hand_tcp": 0.01}, terrain=sd.Plane(height=-0.3))
    scene = sd.Scene(model, contacts=table, friction=friction, limits=True, motor=motor, fext=draught)
    return scene, torque


def main(save: str | None = None, quick: bool = False) -> sd.Requirement:
    """Ask what lifting requires, print the answer and the code of the least scene; returns the Requirement."""
    scene, torque = lifting()
    kinds = ("effects", "links", "methods")
    found = sd.requires(
        scene, GRASP, np.zeros(5), DURATION, TOLERANCE, torque, samples=8 if quick else 32, spread=1e-3, kinds=kinds
    )
    print(found)
    print(f"\n{found.code}")
    if save:
        figure, axes = picture(width=9.5, height=5.2)
        draw_requirement(axes, found)
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
