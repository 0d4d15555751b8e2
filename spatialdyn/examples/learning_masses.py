"""A UR5 that learns three masses while it moves: Slotine and Li's law, the natural one, and one whose C is wrong.

Learn    sd.SlotineLi and sd.NaturalAdaptation follow a path with parameters that are wrong by a half, and learn. Their
         proof needs sᵀ(Ṁ - 2C)s = 0 for an s that is not q̇: of all C with the right C q̇ that of Christoffel's symbols.
Look at  the least eigenvalue of the pseudo-inertias: the Euclidean law tracks with bodies that no mass could have, the
         natural one never leaves those that exist. And V = ½ sᵀM s of a law whose parameters are right: it falls with
         Christoffel's C, and rises with another, whose C q̇ is the same. Only combinations of parameters that the
         motion shows converge, fewer than 30. The chapter's section 10.5 changes the sign of the parameters' error
         half-way; the law that it ends with is right: estimates change by -Γ Yᵀs, and τ = Y θ - K s.
Needs    pip install example-robot-data for the UR5
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.control.adaptive import pseudo_inertia
from spatialdyn.examples.gallery import picture, start, write

DT, RATES, GAIN, GAMMA = 2e-3, 5.0, 10.0, 0.3
WRONG = {"shoulder_pan_joint": 1.5, "shoulder_lift_joint": 0.6, "elbow_joint": 1.4}


def lyapunov(model: sd.Model, path: sd.Path, christoffel: bool, seconds: float) -> Any:
    """V = ½ sᵀM s of the law with right parameters: by Christoffel's C, or one of the same C q̇ and no skew Ṁ - 2C."""
    q, v, V, C_of = path(0.0).q + 0.2, path(0.0).v, [], sd.ChristoffelC(model)
    for k in range(round(seconds / DT)):
        at = path(k * DT)
        v_r, a_r = at.v + RATES * (at.q - q), at.a + RATES * (at.v - v)
        s = v - v_r
        V.append(0.5 * s @ sd.crba(model, q) @ s)
        tau = sd.modified_rnea(model, q, v, v_r, a_r) - 0.1 * GAIN * s
        if not christoffel:
            tau += (C_of.not_christoffel(q, v, skew=False) - sd.coriolis_matrix(model, q, v)) @ v_r
        q, v = sd.step(model, q, v, tau, DT, "rk4")
    return np.array(V)


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print errors and least eigenvalues of both laws, and how V rises; returns them."""
    model = sd.load_urdf("ur5").reduced(lock=["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"])
    true = sd.inertial_parameters(model)
    guess = true * np.array([1.0, *(WRONG[name] for name in model.names[1:])])[:, None]
    sines = np.array([[0.3, 0.2], [0.2, -0.2], [0.2, 0.3]]).T
    path = sd.fourier(0.0 * sines, sines, 0.5, np.array([0.0, -1.0, 1.0]))
    laws = {
        "Euclidean": sd.SlotineLi(model, RATES, GAIN, path, guess, GAMMA),
        "natural": sd.NaturalAdaptation(model, RATES, GAIN, path, guess, 3.0),
    }
    found: dict[str, Any] = {}
    for name, law in laws.items():
        run = sd.simulate(model, path(0.0).q + 0.2, np.zeros(3), 3.0 if quick else 8.0, DT, control=law)
        error = np.linalg.norm(run.q - path(run.t).q, axis=1)
        least = np.linalg.eigvalsh(pseudo_inertia(law.estimates(run))[:, 1:])[..., 0].min(1)
        found[name] = (run.t, error, least)
        first, last = error[:500].max(), error[-500:].max()
        print(f"{name:10} error {first:.3f} -> {last:.1e} rad, least eigenvalue {least.min():.1e}")
    seen = laws["natural"].excitation(run.q, run.v, np.gradient(run.v, DT, axis=0))
    fast = sd.fourier(0.0 * sines, 8.0 * sines, 1.5, np.array([0.0, -1.0, 1.0]))
    found["V"] = [lyapunov(model, fast, christoffel, 0.5 if quick else 2.0) for christoffel in (True, False)]
    rises = [(V[1:] / V[:-1]).max() for V in found["V"]]
    print(f"{seen.rank} of {seen.parameters} parameters are shown; V grows {rises[0]:.4f}, {rises[1]:.4f} a step")
    if save:
        figure, axes = picture(3, 11.0)
        for name in laws:
            axes[0].semilogy(found[name][0], found[name][1], label=name)
            axes[1].plot(found[name][0], found[name][2], label=name)
        axes[2].semilogy(
            DT * np.arange(len(found["V"][0])), np.transpose(found["V"]), label=["Christoffel's C", "another"]
        )
        for one, label in zip(axes, ("error [rad]", "least eigenvalue of P", "V [J]"), strict=True):
            one.set(xlabel="t [s]", ylabel=label)
            one.legend(fontsize="small")
        write(figure, save)
    return found | {"seen": seen}


if __name__ == "__main__":
    start(main)
