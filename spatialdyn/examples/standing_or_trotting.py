"""A quadruped that stands and one that trots: the same scene, and what each of them requires.

Learn    a scene requires nothing by itself, a motion does: sd.requires of two motions of one scene.
Look at  the joints' damping, and the step. Standing requires the ground and gravity alone, in steps of 8 ms. In a trot
         damping changes the motion by millimetres, and impacts need steps of a tenth of that or less.
Needs    pip install example-robot-data for Solo12
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start
from spatialdyn.examples.trotting_quadruped import DT, FEET, references
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

REACH, GAIN = Argument("reach", ("nq",), "rad", "reference"), Argument("gain", ("nv",), "N m/rad", "of each joint")
TOLERANCE, DURATION = 2e-3, 0.16


def hold(bodies: Any, q: Any, v: Any, reach: Any, gain: Any, tau: Any) -> None:
    """Springs and dampers of the legs; the base has none."""
    for i in range(6):
        tau[i] = 0.0
    for i in range(6, len(tau)):
        tau[i] = gain[i] * (reach[i + 1] - q[i + 1]) - 0.025 * gain[i] * v[i]


LAW = Spec("hold", hold, None, (Q, V, REACH, GAIN), TAU, "PD of the legs.", "")


def main(quick: bool = False) -> dict[str, sd.Requirement]:
    """Ask what standing and trotting require and print both; returns them."""
    model = sd.load_urdf("solo12", root="floating")
    contacts = sd.Contacts(model, dict.fromkeys(FEET, 0.016))
    damping = sd.Friction(viscous=np.r_[np.zeros(6), np.full(12, 0.01)])
    scene = sd.Scene(model, contacts=contacts, friction=damping)
    q = references(model, 1)[0]
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    gain, still = np.r_[np.zeros(6), np.full(12, 8.0)], np.zeros(model.nv)
    rest = sd.rollout(
        scene, q, still, dt=DT, steps=500, record="last", control=sd.Control(LAW, {"reach": q, "gain": gain})
    )
    steps = round(DURATION / DT)
    strides = references(model, 320 + steps)[320:]  # in full stride
    found = {}
    for name, reach in (("standing", q), ("trotting", strides)):
        law = sd.Control(LAW, {"reach": reach, "gain": gain})
        found[name] = sd.requires(
            scene, rest.q, np.zeros(model.nv), DURATION, TOLERANCE, control=law,
            kinds=("contacts", "friction", "gravity"), samples=8 if quick else 32, spread=0.0, spread_v=1e-3,
        )  # fmt: skip
        print(f"{name}\n{found[name]}\n")
    return found


if __name__ == "__main__":
    start(main)
