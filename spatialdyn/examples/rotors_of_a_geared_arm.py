"""A heavily geared arm: where the rotors' reflected inertia is enough, and where it is not.

Learn    sd.Rotor is exact, its armature n² J leaves out the gyroscopic part, about 1/n of it; sd.requires says whether
         a motion at a tolerance can tell.
Look at  the two tolerances. An arm whose rotors outweigh its links moves by degrees without them. With armatures in
         their place it is right to 0.1 rad, and wrong at 1e-3: the rotors' momentum turns with the links.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start

GEAR, ROTOR = 50.0, 2e-4  # n² J is 0.5 kg m², five times what a link has about its joint
TOLERANCES, DURATION = (0.1, 1e-3), 0.5
TORQUE = np.array([6.0, -4.0, 2.0])


def arm() -> sd.Model:
    """Three rods of 1 kg and 0.5 m that turn about y, a motor with a gear in each joint."""
    rod = (1.0, (0.0, 0.0, -0.25), np.diag([0.02, 0.02, 1e-3]))
    builder, below = sd.ModelBuilder("geared"), None
    for k in range(3):
        placement = None if below is None else (0.0, 0.0, -0.5)
        builder.add_body(f"rod{k}", below, "revolute", (0, 1, 0), placement, rod, rotor=sd.Rotor(ROTOR, GEAR))
        below = f"rod{k}"
    return builder.build()


def main(quick: bool = False) -> dict[float, sd.Requirement]:
    """Ask at two tolerances and print both answers; returns them by tolerance."""
    scene = sd.Scene(arm())
    found = {}
    for tolerance in TOLERANCES:
        found[tolerance] = sd.requires(
            scene, np.array([0.3, 0.2, -0.4]), np.zeros(3), DURATION, tolerance, TORQUE,
            kinds=("rotors", "gravity", "precision", "methods"), samples=8 if quick else 32, spread=1e-2,
        )  # fmt: skip
        print(f"{found[tolerance]}\n")
    return found


if __name__ == "__main__":
    start(main)
