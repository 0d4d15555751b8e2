"""Exercise 1 of the chapter's first list: M, C q̇, g and τ of the 2R arm at q = (30°, 45°), q̇ = (1, -0.5).

Learn    the numbers, and how many of their digits are right: exact computes each call with as many as one likes.
Look at  the last column: the error of the double precision result, in units of its last place.
Needs    pip install mpmath for the exact column
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, start


def main() -> dict[str, Any]:
    """Print the answers to (a), (b), (c); returns them."""
    need("mpmath", "exact")
    model = sd.load_urdf("two_link")
    q, v, a = np.radians([30.0, 45.0]), np.array([1.0, -0.5]), np.array([0.1, -0.2])
    answers = {
        "(a) M(q)": (sd.crba(model, q), sd.exact(model, sd.crba)(q)),
        "(b) C q̇ + g": (sd.nonlinear_effects(model, q, v), sd.exact(model, sd.nonlinear_effects)(q, v)),
        "(b) g": (sd.generalized_gravity(model, q), sd.exact(model, sd.generalized_gravity)(q)),
        "(c) τ": (sd.rnea(model, q, v, a), sd.exact(model, sd.rnea)(q, v, a)),
    }
    found: dict[str, Any] = {}
    for name, (x, exact) in answers.items():
        found[name] = x
        error = abs(exact - x).max() / np.spacing(abs(x).max())  # of many digits, so that the difference is exact
        print(f"{name:12} {x.round(9).tolist()!s:52} off by {float(error):.2f} units in the last place")
    found["eigenvalues"] = np.linalg.eigvalsh(found["(a) M(q)"])
    found["(b) C q̇"] = found["(b) C q̇ + g"] - found["(b) g"]
    print(f"(a) eigenvalues of M {found['eigenvalues']}: positive, so M is positive definite")
    print(f"(b) C q̇ = {found['(b) C q̇']}")
    return found


if __name__ == "__main__":
    start(main)
