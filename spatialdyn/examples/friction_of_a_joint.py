"""Friction of a joint from one slow and one fast motion: which of them tells dry friction, which damping.

Learn    identify with several Recordings; parameters "friction" and "offset"; intervals as what a log knows.
Look at  the intervals. In the slow motion damping hardly acts, and its interval is wide; the fast one alone mixes it
         with dry friction, as both have the sign of v; both together tell them apart.
Needs    numpy
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

COULOMB, DAMPING, OFFSET, NOISE = 0.8, 0.15, 0.2, 0.1  # N m, N m s/rad, of the sensor, and its noise
SPEEDS = {"slow": 0.2, "fast": 4.0}  # rad/s


def rod() -> sd.Model:
    """A rod on a hinge, its mass and inertia known."""
    inertia = (2.0, (0.0, 0.0, 0.2), np.diag([0.03, 0.03, 1e-3]))
    return sd.ModelBuilder("rod").add_body("rod", None, "revolute", (0, 1, 0), inertia=inertia).build()


def main(save: str | None = None) -> dict[str, Any]:
    """Print what each motion tells, and both; returns the results."""
    model, rng, logs = rod(), np.random.default_rng(0), {}
    for name, speed in SPEEDS.items():
        path = sd.fourier([[speed]], [[0.0]], 0.5, [0.0], model)  # to and fro in 2 s
        t = np.arange(0.0, 4.0, 2e-3)
        q, v, a = path(t)
        tau = sd.rnea(model, q, v, a) + COULOMB * np.sign(v) + DAMPING * v + OFFSET
        logs[name] = sd.Recording(t, q, tau + NOISE * rng.normal(size=tau.shape), v, a)
    found = {}
    taken: dict[str, Any] = {**logs, "both": list(logs.values())}
    for name, log in taken.items():
        fit = found[name] = sd.identify(log, model, parameters="friction+offset", v_min=0.01)
        values = dict(zip(fit.base.labels, zip(fit.beta, fit.half_width, strict=True), strict=True))
        shown = [f"{kind.partition('.')[2]} {x:.3f} ± {half:.3f}" for kind, (x, half) in values.items()]
        print(f"{name:5} {', '.join(shown)}; noise {fit.noise[0]:.3f} N m")
    print(f"true  viscous {DAMPING}, coulomb {COULOMB}, offset {OFFSET}")
    scene = found["both"].scene()  # a Scene with this friction, to simulate in
    if save:
        figure, axes = picture(3, 10.0, 3.0)
        for k, (one, truth) in enumerate(zip(axes, (DAMPING, COULOMB, OFFSET), strict=True)):
            for y, fit in enumerate(found.values()):
                one.errorbar(fit.beta[k], y, xerr=fit.half_width[k], fmt="o", capsize=4)
            one.axvline(truth, color="k", linewidth=0.8)
            one.set_yticks(range(3), [*found] if not k else [])
            one.locator_params(axis="x", nbins=4)
            one.set(title=found["both"].base.labels[k].partition(".")[2], ylim=(-0.6, 2.6))
        axes[1].set_xlabel("value with its interval of 95 %; the line is the truth [N m s | N m]")
        write(figure, save)
    return {**found, "scene": scene}


if __name__ == "__main__":
    start(main)
