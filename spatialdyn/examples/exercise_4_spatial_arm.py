"""Exercise 4 of the first list: the 3R arm by Lagrange's method in SymPy, by the library in symbols, and in numbers.

Learn    how to check a derivation of your own: entry by entry as an expression, then as a number at a random state.
Look at  the differences: the expressions are equal, and so are the numbers of the recursion, up to rounding. Note that
         the arm of the chapter's section 16.4 is not that of its 16.3: its links point along x instead of up, and the
         inertia of its first breaks the triangle inequality, as that of no body does.
Needs    pip install sympy
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, start


def lagrange(sympy: Any, q: tuple[Any, ...], v: tuple[Any, ...]) -> tuple[Any, Any, Any]:
    """M, C, g of rods of 1 m and 1 kg, axes z y y, thickness 0.05 m: from velocities, as a student would."""
    c, s, n = sympy.cos, sympy.sin, 3
    out = sympy.Matrix([c(q[0]), s(q[0]), 0])  # the horizontal direction in which the arm lies
    up = sympy.Matrix([0, 0, 1])

    def along(angle: Any) -> Any:
        return out * s(angle) + up * c(angle)

    ends = [up / 2, up + along(q[1]) / 2, up + along(q[1]) + along(q[1] + q[2]) / 2]
    tilt, rate = [0, q[1], q[1] + q[2]], [0, v[1], v[1] + v[2]]
    across, axial = sympy.Rational("0.08333333333333333"), sympy.Rational("0.00125")  # as the file has them
    T: Any = 0
    for k in range(n):
        speed = ends[k].jacobian(q) * sympy.Matrix(v)
        spin = [v[0] * s(tilt[k]), rate[k], v[0] * c(tilt[k])]  # across, across and along the rod
        T += speed.dot(speed) / 2 + (across * (spin[0] ** 2 + spin[1] ** 2) + axial * spin[2] ** 2) / 2
    V = sympy.Rational("9.81") * sum(end[2] for end in ends)
    M = sympy.Matrix(n, n, lambda i, j: sympy.diff(T, v[i], v[j]))
    d = sympy.diff
    C = sympy.Matrix(n, n, lambda i, j: sum(
        (d(M[i, j], q[k]) + d(M[i, k], q[j]) - d(M[j, k], q[i])) * v[k] / 2 for k in range(n)))  # fmt: skip
    return M, C, sympy.Matrix([d(V, x) for x in q])


def main() -> dict[str, Any]:
    """Print differences of expressions and of numbers; returns them."""
    sympy = need("sympy", "symbolic")
    model = sd.load_urdf("three_link")
    symbols = sd.SymbolicManipulator(model)
    hand = dict(zip("MCg", lagrange(sympy, symbols.q, symbols.v), strict=True))
    q, v = np.array([0.5, 0.3, -0.2]), np.array([1.0, -0.5, 0.3])
    numbers = {
        "M": sd.crba(model, q),
        "C": sd.coriolis_matrix(model, q, v),
        "g": sd.generalized_gravity(model, q)[:, None],
    }
    at, found = dict(zip(symbols.q + symbols.v, [*q, *v], strict=True)), {}
    for name, library in {"M": symbols.M(), "C": symbols.C(), "g": symbols.g()}.items():
        zero = symbols.simplify(hand[name] - library).is_zero_matrix
        value = np.array(hand[name].evalf(30, subs=at), dtype=float)
        found[name] = (zero, float(abs(value - numbers[name]).max()))
        print(f"{name}: expressions equal {zero}, numbers differ by {found[name][1]:.1e}")
    return found


if __name__ == "__main__":
    start(main)
