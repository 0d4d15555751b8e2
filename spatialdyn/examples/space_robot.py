"""A space robot whose arm turns its base: no jet, no wheel, and an arm that ends where it began.

Learn    sd.base_velocity is E.3 of the chapter: without external forces, conservation of momentum gives the base's
         velocity from those of the joints. It is a constraint on velocities, not on positions.
Look at  the turn after a cycle. Joints that go round a loop leave the base turned, by the same angle whether they are
         slow or fast, and by the opposite one if they go round the other way; along a line and back they leave nothing.
         It is an area in the plane of the two joints that counts, as for a cat that lands on its feet.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
STEPS = 400


def satellite() -> sd.Model:
    """A box that floats, with an arm of two rods in one plane."""
    box = (20.0, (0.0, 0.0, 0.0), np.diag([2.0, 2.0, 2.0]))
    rod = (4.0, (0.5, 0.0, 0.0), np.diag([0.01, 0.35, 0.35]))
    builder = sd.ModelBuilder("satellite", "world").add_body("box", None, "floating", inertia=box)
    builder.add_body("upper", "box", axis=(0, 0, 1), placement=(0.5, 0.0, 0.0), inertia=rod)
    return builder.add_body("lower", "upper", axis=(0, 0, 1), placement=(1.0, 0.0, 0.0), inertia=rod).build()


def joints(kind: str, s: Array) -> tuple[Array, Array]:
    """Positions and slopes (n, 2) of the two joints along s from 0 to 1: a circle, or a line and back."""
    angle, rate = 2.0 * np.pi * s, 2.0 * np.pi
    x, dx = 1.0 - np.cos(angle), rate * np.sin(angle)
    y, dy = (np.sin(angle), rate * np.cos(angle)) if kind == "circle" else (x, dx)
    return np.stack([x, y], -1), np.stack([dx, dy], -1)


def turned(model: sd.Model, kind: str, time: float, sign: float = 1.0) -> Array:
    """Angles (STEPS + 1) of the base as the joints go round, at rest in all, by midpoint steps on its group."""
    h, q, angles = 1.0 / STEPS, sd.neutral(model), [0.0]
    for k in range(STEPS):
        at, slope = joints(kind, np.array(sign * (k + np.array([0.0, 0.5])) * h))
        rate = sign * slope / time  # of the time, not of s
        q[7:] = at[0]
        first = sd.base_velocity(model, q, rate[0], np.zeros(6))
        half = sd.integrate(model, q, 0.5 * h * time * np.concatenate([first, rate[0]]))
        half[7:] = at[1]
        v = np.concatenate([sd.base_velocity(model, half, rate[1], np.zeros(6)), rate[1]])
        q = sd.integrate(model, q, h * time * v)
        angles.append(2.0 * np.arctan2(q[5], q[6]))
    return np.array(angles)


def main(save: str | None = None) -> dict[str, Any]:
    """Print the turns of the base after cycles; returns its angles along each."""
    model, found = satellite(), {}
    for name, kind, time, sign in (
        ("once round in 10 s", "circle", 10.0, 1.0), ("once round in 1 s", "circle", 1.0, 1.0),
        ("the other way round", "circle", 10.0, -1.0), ("a line and back", "line", 10.0, 1.0),
    ):  # fmt: skip
        found[name] = turned(model, kind, time, sign)
        print(f"{name:20}: the base has turned by {np.degrees(found[name][-1]):8.4f} degrees")
    if save:
        figure, axes = picture()
        for name, y in found.items():
            axes.plot(
                np.linspace(0.0, 1.0, STEPS + 1), np.degrees(y), label=name, linestyle="--" if "1 s" in name else "-"
            )
        axes.set(xlabel="fraction of the cycle", ylabel="angle of the base [degrees]")
        axes.legend(fontsize="small")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
