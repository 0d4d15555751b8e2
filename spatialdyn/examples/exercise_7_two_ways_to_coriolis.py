"""Exercise 7 of the first list: C(q, q̇) q̇ from Christoffel symbols and by RNEA: equal numbers, another price.

Learn    christoffel_symbols gives all n³ of them; nonlinear_effects of a weightless model is C q̇ at once.
Look at  the growth of the operations, counted in the programs that run: RNEA's little more than doubles when the joints
         do, that of the symbols grows by n³. For two joints the symbols are cheaper, as on paper; from four on they are
         not. The matrix C does not need them either: its recursion is in between.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start


def chain(n: int) -> sd.Model:
    """n equal links whose axes alternate, so that nothing cancels; without gravity."""
    builder, tip = sd.ModelBuilder(f"chain of {n}"), None
    for k in range(n):
        axis = [(0, 0, 1), (0, 1, 0), (1, 0, 0)][k % 3]
        builder.add_body(f"link{k:02}", tip, axis=axis, placement=(0.3, 0.1, 0.2), inertia=(
            1.0, (0.1, 0.02, 0.03), np.diag([0.02, 0.03, 0.04])))  # fmt: skip
        tip = f"link{k:02}"
    return builder.build(gravity=(0, 0, 0))


def main(quick: bool = False) -> dict[str, np.ndarray]:
    """Print differences and operations for chains of n joints; returns them, rows n, difference, operations."""
    calls, rng = (sd.nonlinear_effects, sd.coriolis_matrix, sd.christoffel_symbols), np.random.default_rng(0)
    rows = []
    print(f"{'n':>3} {'difference':>11} {'RNEA':>8} {'matrix C':>9} {'symbols':>8}   operations")
    for n in (2, 4) if quick else (2, 4, 8, 16):
        model = chain(n)
        q, v = rng.uniform(-3, 3, n), rng.normal(size=n)
        by_symbols = np.einsum("ijk,j,k->i", sd.christoffel_symbols(model, q), v, v)
        by_rnea = sd.nonlinear_effects(model, q, v)
        difference = abs(by_symbols - by_rnea).max() / abs(by_rnea).max()
        counts = []
        for call in calls:
            operations = sd.specialize(model, call).operations
            counts.append(sum(operations[name] for name in ("add", "mul", "div")))
        counts[1] += 2 * n**2  # C times v
        counts[2] += 2 * n**3 + 2 * n**2  # the symbols times v, twice
        rows.append([n, difference, *counts])
        print(f"{n:3} {difference:11.1e} {counts[0]:8} {counts[1]:9} {counts[2]:8}")
    return {"rows": np.array(rows)}


if __name__ == "__main__":
    start(main)
