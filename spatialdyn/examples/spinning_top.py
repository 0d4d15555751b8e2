"""The spinning top: a free body against Jacobi's elliptic functions, and a heavy one that precesses.

Learn    a ball joint alone is Euler's top: rnea of one body is the Euler-Poincaré equation I ω̇ + ω × I ω = τ. Its
         sign is the one thing to remember: the chapter's section 14.2 prints d/dt(I ω) = ω × I ω + τ.
Look at  the errors of the free top, which fall with the order of the method; with the printed sign ω runs backwards.
         The heavy top, started at the rate of steady precession, keeps its lean: gravity pulls, and it walks around.
Needs    pip install scipy for the elliptic functions
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write

I1, I2, I3 = INERTIA = (1.0, 2.0, 3.0)


def top(inertia: Any, height: float = 0.0) -> sd.Model:
    """A body of 1 kg on a ball joint, its centre of mass above the joint."""
    made = sd.ModelBuilder("top")
    made.add_body("body", None, "spherical", inertia=(1.0, (0.0, 0.0, height), np.diag(inertia)))
    return made.build()


def closed_form(t: Any, energy: float, L: float) -> Any:
    """ω (..., 3) of the free top with L² > 2 E I2, which starts at its largest ω1 and ω3 (Landau, Lifshitz, § 37)."""
    over, under = 2.0 * energy * I3 - L**2, L**2 - 2.0 * energy * I1
    rate, m = math.sqrt((I3 - I2) * under / (I1 * I2 * I3)), (I2 - I1) * over / ((I3 - I2) * under)
    sn, cn, dn, _ = need("scipy.special", "simulation").ellipj(rate * t, m)
    sizes = over / (I1 * (I3 - I1)), over / (I2 * (I3 - I2)), under / (I3 * (I3 - I1))
    return np.sqrt(sizes) * np.stack([cn, sn, dn], -1)


def main(save: str | None = None) -> dict[str, Any]:
    """Print errors of the free top, and the heavy top's lean; returns them."""
    need("scipy.special", "simulation")
    v0 = np.array([1.0, 0.0, 0.6])
    energy, L = float(0.5 * v0**2 @ INERTIA), float(np.linalg.norm(v0 * INERTIA))
    free, found = top(INERTIA), {}
    for method in ("velocity_verlet", "rk4", "gauss6"):
        errors = []
        for dt in (0.02, 0.01):
            run = sd.simulate(free, [0.0, 0.0, 0.0, 1.0], v0, 20.0, dt, method)
            errors.append(abs(run.v - closed_form(run.t, energy, L)).max())
        found[method] = errors
        print(f"free top, {method:16} largest error of ω in 20 s: {errors[0]:.1e}, at half of dt {errors[1]:.1e}")
    found["swapped"] = abs(run.v - closed_form(-run.t, energy, L)).max()  # ω × I ω on the wrong side turns time round
    print(f"free top, with the printed sign            {found['swapped']:.1e}")
    A, C, h, lean, spin = 0.2, 0.05, 0.3, 0.4, 120.0  # inertias about the com and the axis, height, angle, axial spin
    heavy, about = top((A, A, C), h), A + h**2  # about the joint
    roots = np.roots([about * math.cos(lean), -C * spin, 9.81 * h])  # of the rate of precession: the slow one
    slow = float(roots.real.min())
    q0 = [math.sin(lean / 2), 0.0, 0.0, math.cos(lean / 2)]
    run = sd.simulate(heavy, q0, [0.0, slow * math.sin(lean), spin], 10.0, 1e-3)
    axis = np.asarray(sd.frame_placement(heavy, run.q, "body"))[:, :3, 2]
    tilt = np.arccos(axis[:, 2])
    turned = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    found["lean"], found["rate"] = abs(tilt - lean).max(), (turned[-1] - turned[0]) / run.t[-1] - slow
    print(
        f"heavy top: precesses at {slow:.4f} rad/s, off by {found['rate']:.1e}; its lean varies by {found['lean']:.1e}"
    )
    if save:
        figure, axes = picture(width=5.0, height=5.0)
        axes.plot(axis[:, 0], axis[:, 1])
        axes.set(xlabel="x of the axis", ylabel="y", title="heavy top from above", aspect="equal")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
