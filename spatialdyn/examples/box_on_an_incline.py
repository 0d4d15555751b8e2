"""A box on an incline: it slides at g (sin a - μ cos a), or sticks, and does not creep.

Learn    sd.Contacts of four corners, a tilted sd.Plane, sd.rollout(contacts=), contact_gaps, tolerance.
Look at  the creep: four corners are twelve equations for six freedoms, so no solution is unique, and each further sweep
         over them makes the box a hundred times quieter. A smoothed law of friction would creep for ever.
"""

from __future__ import annotations

import itertools

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

SIZE, DT = (0.4, 0.3, 0.2), 1e-3


def box() -> tuple[sd.Model, dict[str, float]]:
    """A box of 1 kg and its lower corners."""
    x, y, z = SIZE
    inertia = np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    builder = sd.ModelBuilder("box").add_body("box", None, "floating", inertia=(1.0, (0, 0, 0), inertia))
    corners = [(0.5 * a * x, 0.5 * b * y, -0.5 * z) for a, b in itertools.product((-1, 1), repeat=2)]
    for k, corner in enumerate(corners):
        builder.add_body(f"corner{k}", "box", "fixed", placement=corner)
    return builder.build(), {f"corner{k}": 0.0 for k in range(4)}


def main(save: str | None = None) -> dict[str, np.ndarray]:
    """Let a box slide and stick on 0.3 rad and print its acceleration and creep; returns both."""
    model, corners = box()
    angle = 0.3
    slope = sd.Plane(normal=(np.sin(angle), 0.0, np.cos(angle)))
    q0 = np.array([0.0, 0.0, 0.0, 0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)])  # turned as the slope is
    q0[:3] = 0.5 * SIZE[2] * np.array(slope.normal)
    mus = np.array([0.1, 0.2, 0.25, 0.3, 0.35, 0.5])
    found = []
    print("  μ   acceleration [m/s²]   g (sin a - μ cos a)")
    for mu in mus:
        contacts = sd.Contacts(model, corners, friction=float(mu), terrain=slope)
        run = sd.rollout(sd.Scene(model, contacts=contacts), q0, np.zeros(6), dt=DT, steps=500)
        found.append((run.v[-1, 0] - run.v[99, 0]) / (400 * DT))
        print(f"{mu:4.2f} {found[-1]:20.9f} {max(0.0, 9.81 * (np.sin(angle) - mu * np.cos(angle))):21.9f}")
    creep = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        contacts = sd.Contacts(model, corners, friction=0.5, terrain=slope, tolerance=tolerance)
        v = sd.rollout(sd.Scene(model, contacts=contacts), q0, np.zeros(6), dt=DT, steps=500).v
        creep.append(np.linalg.norm(v[250:, :3], axis=1).max())
        print(f"μ = 0.5, solved to {tolerance:g} m/s: the box moves at {1e6 * creep[-1]:.1e} µm/s")
    if save:
        figure, axes = picture()
        fine = np.linspace(0.0, 0.6, 200)
        axes.plot(
            fine, np.maximum(0.0, 9.81 * (np.sin(angle) - fine * np.cos(angle))), label="g (sin a - μ cos a), or 0"
        )
        axes.plot(mus, found, "o", label="box on four corners")
        axes.set(xlabel="μ", ylabel="acceleration [m/s²]", title="a box on a slope of 0.3 rad")
        axes.legend()
        write(figure, save)
    return {"mu": mus, "acceleration": np.array(found), "creep": np.array(creep)}


if __name__ == "__main__":
    start(main)
