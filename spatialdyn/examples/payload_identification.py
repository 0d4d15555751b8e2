"""Identification of a payload: mass and centre of an unknown load from torques that were measured.

Learn    body_regressor and frame_jacobian: τ is linear in the load's ten parameters, τ = rnea + Jᵀ Y π. excitation
         and identify(payload=): the same of a log on a path, as a load that can exist.
Look at  what can be told apart. Poses at rest give the mass and the centre of mass and nothing about inertia (rank 4);
         motion gives all ten, the inertia with the fewest digits: its torques are the smallest.
Needs    pip install example-robot-data for the UR5
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
LOAD = (1.7, np.array([0.03, -0.02, 0.08]), np.diag([4e-3, 3e-3, 2e-3]))  # kg, m, kg m² about the centre of mass
NAMES = ("m", "m c_x", "m c_y", "m c_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


def parameters(load: tuple[float, Array, Array]) -> Array:
    """The ten of a load: mass, first moment, inertia about the frame's origin, in the regressors' order."""
    m, c, I = load
    I = I + m * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([m, *(m * c), I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def main(quick: bool = False, save: str | None = None) -> dict[str, Array]:
    """Print what the data of rest and of motion give; returns ranks, the parameters found and those that are true."""
    model, frame, noise = sd.load_urdf("ur5"), "tool0", 0.02  # N m, of the torque sensors
    loaded, rng = model.with_(payload={frame: LOAD}), np.random.default_rng(1)
    n = 400 if quick else 4000
    q, v, a = (rng.uniform(-s, s, (n, model.nv)) for s in (3.0, 2.0, 6.0))
    found = {"true": parameters(LOAD)}
    for motion, speed in {"at rest": 0.0, "moving": 1.0}.items():
        tau = sd.rnea(loaded, q, speed * v, speed * a) + noise * rng.normal(size=q.shape)  # "measured"
        Y = sd.body_regressor(model, q, speed * v, speed * a, frame)  # (n, 6, 10): force in the frame
        J = sd.frame_jacobian(model, q, frame)  # (n, 6, nv), in the frame too
        A = (np.swapaxes(J, 1, 2) @ Y).reshape(-1, 10)
        b = (tau - sd.rnea(model, q, speed * v, speed * a)).ravel()
        pi, _, rank, _ = np.linalg.lstsq(A, b, rcond=1e-10)
        deviation = noise * np.sqrt(np.diag(np.linalg.pinv(A.T @ A, rcond=1e-15)))
        found |= {motion: pi, f"rank {motion}": np.array(rank), f"deviation {motion}": deviation}
        print(f"{motion}: {n} states, rank {rank} of 10")
        for name, x, s, truth in zip(NAMES, pi, deviation, found["true"], strict=True):
            known = s > 0 and (rank == 10 or name[0] == "m")
            print(f"  {name:6} {x:9.5f} ± {s:7.5f}   true {truth:9.5f}" if known else f"  {name:6} not seen")
    t = np.linspace(0.0, 8.0, 8 * n // 40)
    q, v, a = sd.excitation(model, 8.0, 3, payload=frame, starts=4, steps=4)(t)  # a path that shows all ten
    tau = sd.rnea(loaded, q, v, a) + noise * rng.normal(size=q.shape)
    fit = sd.identify(sd.Recording(t, q, tau, v, a), model, "log_cholesky", "inertial", payload=frame)
    print(f"on a path, as a load that can exist: {fit.parameters[0]:.3f} kg, the rest in fit.model()")
    if save:
        figure, axes = picture(1, 8.0, 4.0)
        for shift, name in enumerate(("at rest", "moving")):
            off, deviation = found[name] - found["true"], found[f"deviation {name}"]
            seen = np.flatnonzero(deviation > 0.0)[: int(found[f"rank {name}"])]
            axes.errorbar(seen + 0.2 * shift, off[seen], 2.0 * deviation[seen], fmt="o", capsize=3, label=name)
        axes.axhline(0.0, color="k", linewidth=0.8)
        axes.set_xticks(range(10), NAMES)
        axes.set(
            ylabel="error, ± 2 deviations [kg | kg m | kg m²]", title="Of a load: at rest four numbers, moving ten"
        )
        axes.legend()
        write(figure, save)
    return found | {"load": fit.parameters, "carried": np.array(fit.model().total_mass)}


if __name__ == "__main__":
    start(main)
