"""Exercise 3 of the first list: the pendulum, M = m l², C = 0, g = m g l cos θ. Why is C zero?

Learn    C is made of derivatives of M by q. M of a pendulum is a constant, so there is nothing to make it of.
Look at  the second table: as soon as the length can change, M depends on a coordinate and C appears: 2 m r ṙ θ̇ is
         Coriolis' force, -m r θ̇² the centrifugal one. The angle is counted from the horizontal here, hence the cosine;
         the chapter's section 15 counts it from below and has a sine. Both are right, and mixing them is a classic.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start

POINT = np.zeros((3, 3))  # a point mass has no inertia about itself


def main() -> dict[str, np.ndarray]:
    """Print both tables; returns M, C, g of the pendulum and of the pendulum whose length r is a coordinate."""
    m, l, theta, omega = 1.5, 0.8, 0.7, 2.0
    pendulum = sd.ModelBuilder("pendulum")  # axis -y: positive angles lift the mass, which starts along x
    pendulum.add_body("mass", axis=(0, -1, 0), inertia=(m, (l, 0, 0), POINT))
    model, q, v = pendulum.build(), [theta], [omega]
    found = {"M": sd.crba(model, q), "C": sd.coriolis_matrix(model, q, v), "g": sd.generalized_gravity(model, q)}
    print("pendulum          library    formula")
    print(f"M = m l²       {found['M'][0, 0]:10.6f} {m * l**2:10.6f}")
    print(f"C = 0          {found['C'][0, 0]:10.6f} {0:10.6f}")
    print(f"g = m g l cosθ {found['g'][0]:10.6f} {m * 9.81 * l * np.cos(theta):10.6f}\n")

    elastic = sd.ModelBuilder("pendulum of changing length")
    elastic.add_body("rail", axis=(0, -1, 0))
    elastic.add_body("mass", "rail", "prismatic", axis=(1, 0, 0), inertia=(m, (0, 0, 0), POINT))
    model, q, v = elastic.build(), [theta, l], [omega, 0.5]  # θ and r, their rates
    Cv = sd.coriolis_matrix(model, q, v) @ v
    print("length r, ṙ       library    formula")
    print(f"2 m r ṙ θ̇      {Cv[0]:10.6f} {2 * m * l * 0.5 * omega:10.6f}")
    print(f"-m r θ̇²        {Cv[1]:10.6f} {-m * l * omega**2:10.6f}")
    return found | {"Cv": Cv, "M elastic": sd.crba(model, q)}


if __name__ == "__main__":
    start(main)
