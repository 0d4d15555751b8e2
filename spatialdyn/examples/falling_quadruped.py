"""A quadruped in free fall: legs turn the body, and momentum does not notice.

Learn    root="floating", torques on the legs alone (the base's six are 0), centroidal_momentum, center_of_mass.
Look at  the body: it starts at rest, kicks with its legs and ends turned, though the angular momentum about the centre
         of mass stays 0, up to the error of the integration: the legs swap it with the body, as a cat's do. The centre
         of mass falls by g t²/2, no matter what the legs do.
Needs    pip install example-robot-data for Solo12
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(save: str | None = None) -> dict[str, np.ndarray]:
    """Simulate 0.8 s of kicking legs and print what is kept; returns momenta, the centre of mass and the turn."""
    model = sd.load_urdf("solo12", root="floating")
    duration, dt = 0.8, 1e-3
    t = dt * np.arange(round(duration / dt))
    tau = np.zeros((len(t), model.nv))
    for joint in model.joints[2:]:  # joints[1] is the floating base
        front, left = joint.name[0] == "F", joint.name[1] == "L"
        phase = 2 * np.pi * t / duration + (np.pi / 2 if left else 0.0)  # left ahead of right
        if "KFE" not in joint.name:  # hips and thighs: front against hind
            tau[:, joint.idx_v] = (0.15 if front else -0.15) * np.sin(phase)
    q0 = sd.neutral(model)
    q0[2] = 5.0
    run = sd.simulate(model, q0, np.zeros(model.nv), duration, dt, torque=tau)

    h = sd.centroidal_momentum(model, run.q, run.v)  # (N, 6): linear, then angular about the centre of mass
    com = sd.center_of_mass(model, run.q)
    only_legs = run.v.copy()
    only_legs[:, :6] = 0.0  # as if the base stood still: the angular momentum that the legs swap with the body
    legs = sd.centroidal_momentum(model, run.q, only_legs)[:, 3:]
    swapped = abs(legs).max()
    turn = 2.0 * np.degrees(np.arccos(np.clip(abs(run.q[:, 6]), 0.0, 1.0)))  # of the base, from its quaternion
    mass, g = sd.total_mass(model), -model.gravity[2]

    print(f"total mass {mass:.3f} kg, {model.nv} freedoms, {len(run)} samples by {run.method}")
    rows = {
        "linear momentum across gravity": (h[:, :2], "kg m/s"),
        "linear momentum down, less m g t": (h[:, 2] + mass * g * run.t, f"kg m/s, of {mass * g * duration:.0f}"),
        "angular momentum": (h[:, 3:], f"kg m²/s, of {swapped:.2g} swapped"),
        "height of the centre of mass, less its parabola": (com[:, 2] - com[0, 2] + 0.5 * g * run.t**2, "m"),
    }
    for name, (values, unit) in rows.items():
        print(f"{name:48} at most {abs(values).max():.1e} {unit}")
    print(f"the body has turned by {turn[-1]:.1f} degrees")
    if save:
        figure, axes = picture(2, width=10.0)
        axes[0].plot(run.t, turn)
        axes[0].set(xlabel="t [s]", ylabel="turn of the body [degrees]", title="the body turns ...")
        axes[1].plot(run.t, legs, linewidth=1.0, label=["legs, x", "legs, y", "legs, z"])
        axes[1].plot(run.t, h[:, 3:], "k", linewidth=2.0, label=["all, x y z", None, None])
        axes[1].set(xlabel="t [s]", ylabel="angular momentum [kg m²/s]", title="... with no angular momentum")
        axes[1].legend()
        write(figure, save)
    return {"t": run.t, "h": h, "com": com, "turn": turn, "swapped": swapped}


if __name__ == "__main__":
    start(main)
