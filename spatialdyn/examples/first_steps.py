"""First steps: the terms of M(q) q̈ + C(q, q̇) q̇ + g(q) = τ of a two-link arm, by hand and by the library.

Learn    which call gives which term: crba M, coriolis_matrix C, generalized_gravity g, rnea τ, aba q̈ back from τ.
Look at  the last column: formulas on paper and recursions over the tree differ by rounding alone, 1e-15 of the terms.

The arm is that of section 8.1 of the chapter: links of 1 m, masses of 1 kg at their ends, q1 from the horizontal. Its
section 5.5 has V = Σ m g0·p with g0 = (0, 0, -9.81), whose sign is turned: a body that is lifted would lose energy.
V = -Σ m g0·p gives the g of its section 8.1 and of the library.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start


def main() -> dict[str, float]:
    """Print each term twice and the largest difference; returns the differences."""
    model = sd.load_urdf("two_link")  # a path, the text of a URDF, or the name of a robot that is installed
    q, v, a = np.radians([30.0, 45.0]), np.array([1.0, -0.5]), np.array([0.1, -0.2])

    h = -np.sin(q[1])  # by hand, as the chapter has it with l = m = 1
    M = np.array([[3 + 2 * np.cos(q[1]), 1 + np.cos(q[1])], [1 + np.cos(q[1]), 1.0]])
    C = np.array([[h * v[1], h * (v[0] + v[1])], [-h * v[0], 0.0]])
    g = 9.81 * np.array([2 * np.cos(q[0]) + np.cos(q[0] + q[1]), np.cos(q[0] + q[1])])
    V = 9.81 * (2 * np.sin(q[0]) + np.sin(q[0] + q[1]))

    tau = sd.rnea(model, q, v, a)
    pairs = {
        "M": (M, sd.crba(model, q)),
        "C": (C, sd.coriolis_matrix(model, q, v)),
        "C v + g": (C @ v + g, sd.nonlinear_effects(model, q, v)),
        "g": (g, sd.generalized_gravity(model, q)),
        "tau": (M @ a + C @ v + g, tau),
        "a": (a, sd.aba(model, q, v, tau)),  # there and back
        "T": (0.5 * v @ M @ v, sd.kinetic_energy(model, q, v)),
        "V": (V, sd.potential_energy(model, q)),
    }
    print(f"{'':8} {'by hand':46} {'by the library':46} difference")
    differences = {}
    for name, (hand, library) in pairs.items():
        differences[name] = float(np.abs(hand - library).max())
        shown = [np.array2string(np.asarray(x), precision=6).replace("\n", "") for x in (hand, library)]
        print(f"{name:8} {shown[0]:46} {shown[1]:46} {differences[name]:.1e}")
    return differences


if __name__ == "__main__":
    start(main)
