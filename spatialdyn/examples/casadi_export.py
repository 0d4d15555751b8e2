"""Export to CasADi: the least effort that swings a two-link arm up, by IPOPT, with the library's own Jacobians.

Learn    specialize(...).to_casadi() is a casadi.Function with named inputs: one node in a graph, whose Jacobian is the
         recursion of aba_derivatives rather than CasADi's. specialize(...).c_code(derivatives=True) is the same as one
         C file that casadi.external loads and acados links.
Look at  the effort that IPOPT finds, that the motion, computed again by the library, ends upright, and how many
         instructions the Jacobian takes both ways.
Needs    pip install casadi
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write

KNOTS, DT = 40, 0.05
DOWN, UP = np.array([-np.pi / 2, 0.0]), np.array([np.pi / 2, 0.0])


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Swing up, print effort and instructions; returns the torques, the last state and both counts."""
    casadi = need("casadi", "casadi")
    model = sd.load_urdf("two_link")
    k, n = sd.specialize(model, sd.aba), 20 if quick else KNOTS
    forward = k.to_casadi("forward")
    print(forward)

    x = casadi.SX.sym("x", 3 * model.nv)  # in a graph of scalars CasADi differentiates each operation
    graph = casadi.Function("graph", [x], [forward(*casadi.vertsplit(x, model.nv))])
    own, theirs = forward.jacobian().n_instructions(), graph.jacobian().n_instructions()
    print(f"Jacobian: {own} instructions by the library's recursion, {theirs} by CasADi")

    opti, nv = casadi.Opti(), model.nv
    q, v, u = opti.variable(nv, n + 1), opti.variable(nv, n + 1), opti.variable(nv, n)
    for i in range(n):  # semi-implicit Euler, as simulate's
        opti.subject_to(v[:, i + 1] == v[:, i] + DT * forward(q[:, i], v[:, i], u[:, i]))
        opti.subject_to(q[:, i + 1] == q[:, i] + DT * v[:, i + 1])
    opti.subject_to([q[:, 0] == DOWN, v[:, 0] == 0, q[:, n] == UP, v[:, n] == 0])
    opti.minimize(DT * casadi.sumsqr(u))
    opti.set_initial(q, np.linspace(DOWN, UP, n + 1).T)
    opti.solver("ipopt", {"print_time": 0}, {"print_level": 0, "sb": "yes"})
    solved = opti.solve()
    torque = np.asarray(solved.value(u)).T
    effort = DT * float((torque**2).sum())
    print(f"{opti.stats()['iter_count']} iterations of IPOPT: effort {effort:.3f} N²m²s")

    at, speed, path = DOWN.copy(), np.zeros(nv), [DOWN.copy()]
    for one in torque:
        at, speed = sd.step(model, at, speed, one, DT)
        path.append(at)
    off = abs(at - UP).max(), abs(speed).max()
    print(f"computed again by the library it ends {off[0]:.1e} rad from upright, at {off[1]:.1e} rad/s")
    if save:
        figure, axes = picture(2, 10.0)
        axes[0].plot(np.arange(n + 1) * DT, path)
        axes[0].set(xlabel="time [s]", ylabel="angle [rad]", title="two-link arm, hanging to upright")
        axes[1].step(np.arange(n) * DT, torque, where="post", label=["first joint", "second joint"])
        axes[1].set(xlabel="time [s]", ylabel="torque [N m]", title=f"effort {effort:.1f} N²m²s")
        axes[1].legend(frameon=False)
        write(figure, save)
    return {"torque": torque, "effort": effort, "last": (at, speed), "own": own, "theirs": theirs}


if __name__ == "__main__":
    start(main)
