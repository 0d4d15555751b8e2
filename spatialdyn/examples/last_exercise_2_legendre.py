"""Exercise 2 of the last list: from the Lagrangian of the 2R arm to its Hamiltonian, and dH/dt = τᵀ q̇.

Learn    H(), hamilton_equations() and poisson_bracket() in closed form; hamilton_equations(model, q, p) in numbers.
Look at  (d): the rate of H along the equations is τᵀ q̇ as an expression, not at some states only. And the closed form
         and the recursion, which inverts no matrix, agree in a random state.
Needs    pip install sympy
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, start


def main() -> dict[str, Any]:
    """Print (a) to (d); returns what should vanish, and the numbers of both ways."""
    sympy = need("sympy", "symbolic")
    model = sd.load_urdf("two_link")
    arm = sd.SymbolicManipulator(model)
    H, (q_dot, p_dot) = arm.H(), arm.hamilton_equations()
    p, v, tau = (sympy.Matrix(x) for x in (arm.p, arm.v, arm.tau))
    legendre = (p.T * v)[0] - arm.L()  # p·q̇ - L, a function of q, q̇, p, at q̇ = M⁻¹ p
    legendre = arm.simplify(legendre.subs(dict(zip(arm.v, q_dot, strict=True)), simultaneous=True) - H)
    print(f"(a) q̇ = M⁻¹ p = {q_dot.tolist()}")
    print(f"(b) H = {H};  p·q̇ - L - H = {legendre}")
    print(f"(c) ṗ_2 = {p_dot[1]}")
    rate = sum(H.diff(x) * y for x, y in zip((*arm.q, *arm.p), (*q_dot, *p_dot), strict=True))
    power = arm.simplify(rate - (tau.T * q_dot)[0])
    print(f"(d) dH/dt - τᵀ q̇ = {power};  {{H, H}} = {arm.poisson_bracket(H, H)}")

    q, momentum, torque = np.array([0.4, -1.1]), np.array([0.7, 0.2]), np.array([0.3, -0.5])
    numbers = sd.hamilton_equations(model, q, momentum, torque)
    formulas = arm.lambdify("qdot")(q, momentum), arm.lambdify("pdot")(q, momentum, torque)
    difference = max(float(abs(np.ravel(x) - y).max()) for x, y in zip(formulas, numbers, strict=True))
    print(f"formulas and recursion differ by {difference:.1e} at a random state")
    return {"legendre": legendre, "power": power, "difference": difference, "numbers": numbers}


if __name__ == "__main__":
    start(main)
