"""Exercise 1 of the last list: Christoffel symbols, C and Ṁ - 2C of the 2R arm whose links have inertia.

Learn    parameters={"c_1x": "l_c1", ...} names what you like; christoffel() and C() come by recursion or, as on paper,
         by derivatives of M (route="derivatives"): the expressions are the same.
Look at  the symbols: of eight, four are h = -m_2 l_1 l_c2 sin q_2 or its opposite, four are 0. Neither the inertias nor
         l_c1 occur: what does not depend on q leaves no trace.
Needs    pip install sympy
"""

from __future__ import annotations

from typing import Any

import spatialdyn as sd
from spatialdyn.examples.gallery import need, start


def main() -> dict[str, Any]:
    """Print (a) to (d); returns the symbols, C, N = Ṁ - 2C and the number of (d)."""
    sympy = need("sympy", "symbolic")
    names = {"m_1": "m_1", "m_2": "m_2", "l_2x": "l_1", "c_1x": "l_c1", "c_2x": "l_c2", "I_1yy": "I_1", "I_2yy": "I_2"}
    arm = sd.SymbolicManipulator(sd.load_urdf("two_link"), names)
    symbols, C, M = arm.christoffel(), arm.C(), arm.M()
    for i in range(2):
        for j in range(2):
            for k in range(2):
                print(f"(a) c_{i + 1}{j + 1}{k + 1} = {symbols[i, j, k]}")
    print(f"    the same by derivatives of M: {symbols == arm.christoffel('derivatives')}")
    print(f"(b) C = {C.tolist()}")
    M_dot = sum((M.diff(x) * rate for x, rate in zip(arm.q, arm.v, strict=True)), sympy.zeros(2))
    N = arm.simplify(M_dot - 2 * C)
    print(f"(c) Ṁ - 2C = {N.tolist()}; plus its transpose: {arm.simplify(N + N.T).tolist()}")
    v = sympy.Matrix([1, 2])
    at = {arm.q[1]: sympy.pi / 4, arm.v[0]: 1, arm.v[1]: 2}
    number = sympy.expand((v.T * N.subs(at) * v)[0])
    print(f"(d) q̇ᵀ (Ṁ - 2C) q̇ at q_2 = π/4, q̇ = (1, 2): {number}")
    return {"symbols": symbols, "C": C, "N": N, "number": number, "arm": arm}


if __name__ == "__main__":
    start(main)
