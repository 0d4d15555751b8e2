"""A four-bar and a slider-crank: mechanisms with a loop, closed by a constraint.

Learn    ModelBuilder, PointConstraint, close_loops, mobility, constrained_dynamics, simulate(constraints=...).
Look at  the crank's acceleration, which Lagrange's equation of the one freedom gives too; the energy, of which rk4
         loses little but ever more, and RATTLE more but never beyond a bound, both with the loop closed to rounding;
         and the piston, where r cos θ + √(l² - r² sin² θ) says it is, whatever has moved it there.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

BARS = {"crank": 0.2, "coupler": 0.5, "rocker": 0.4}  # lengths [m], rods of 1 kg/m; pivots 0.5 m apart


def rod(length: float) -> tuple[float, tuple[float, float, float], np.ndarray]:
    """Mass, centre of mass and inertia of a thin rod along x."""
    return length, (length / 2, 0, 0), np.diag([0.0, length**3 / 12, length**3 / 12])


def main(save: str | None = None) -> dict[str, float]:
    """Print what the mechanisms do; returns accelerations, errors of energy, of the loop and of the piston."""
    made = sd.ModelBuilder("four_bar")
    for name, parent, x in (("crank", None, 0.0), ("coupler", "crank", 0.2), ("rocker", None, 0.5)):
        made.add_body(name, parent, "revolute", (0, 0, 1), (x, 0, 0), rod(BARS[name]))
    model = made.build(gravity=(0, -9.81, 0))
    pin = sd.Constraints(model, [sd.PointConstraint("coupler", "rocker", at_a=(0.5, 0, 0), at_b=(0.4, 0, 0))])

    q = sd.close_loops(model, pin, [np.pi / 3, -0.5, 1.5], free=["coupler_joint", "rocker_joint"])
    J = sd.constraint_jacobian(model, pin, q)[:2]  # the third row is out of the plane, and always met
    v = 2.0 * np.append(1.0, np.linalg.solve(J[:, 1:], -J[:, 0]))
    free, rank, gruebler = sd.mobility(model, pin, q)
    found = sd.constrained_dynamics(model, pin, q, v, np.zeros(3))
    print(f"four-bar: {free} freedom; 3 joints less {pin.nc} equations are {gruebler}, of which {rank} are independent")
    print(f"the crank at 60° and 2 rad/s accelerates by {found.a[0]:.12f} rad/s², the pin holds {found.force[:2]} N")

    runs = {"rk4": sd.simulate(sd.Scene(model, constraints=pin), q, v, 4.0, 4e-3)}
    runs["RATTLE"] = sd.simulate(sd.Scene(model, constraints=pin), q, v, 4.0, 4e-3, "stormer_verlet")
    kept = {name: float(np.ptp(run.energy)) for name, run in runs.items()}
    loop = max(float(abs(sd.constraint_error(model, pin, run.q)).max()) for run in runs.values())
    print(f"4 s in steps of 4 ms: energy within {kept['rk4']:.1e} J by rk4, {kept['RATTLE']:.1e} J by RATTLE")
    print(f"the loop is open by at most {loop:.1e} m")

    r, l = 0.1, 0.3
    made = sd.ModelBuilder("slider_crank")
    made.add_body("crank", None, "revolute", (0, 0, 1), (0, 0, 0), rod(r))
    made.add_body("rod", "crank", "revolute", (0, 0, 1), (r, 0, 0), rod(l))
    made.add_body("piston", None, "prismatic", (1, 0, 0), (0, 0, 0), (0.5, (0, 0, 0), np.eye(3)))
    engine = made.build(gravity=(0, -9.81, 0))
    wrist = sd.Constraints(engine, [sd.PointConstraint("rod", "piston", at_a=(l, 0, 0))])
    push = sd.simulate(
        sd.Scene(engine, constraints=wrist), [0.0, 0.0, r + l], np.zeros(3), 1.0, 1e-3, torque=[0.5, 0, 0]
    )
    theta = push.q[:, 0]
    piston = float(abs(push.q[:, 2] - r * np.cos(theta) - np.sqrt(l * l - (r * np.sin(theta)) ** 2)).max())
    print(f"slider-crank: {theta[-1] / (2 * np.pi):.1f} turns, the piston is off its formula by at most {piston:.1e} m")
    if save:
        figure, axes = picture(2, width=10.0)
        for name, run in runs.items():
            axes[0].plot(run.t, 1e3 * (run.energy - run.energy[0]), label=name)
        axes[0].set(xlabel="t [s]", ylabel="energy error [mJ]", title="the four-bar's energy")
        axes[0].legend()
        axes[1].plot(push.t, push.q[:, 2])
        axes[1].set(xlabel="t [s]", ylabel="piston [m]", title="the slider-crank speeds up")
        write(figure, save)
    return {"a": float(found.a[0]), "loop": loop, "piston": piston, "turns": float(theta[-1]), **kept}


if __name__ == "__main__":
    start(main)
