"""A panda from an exciting path to a validated model: 43 base parameters, friction, inertias that bodies can have.

Learn    excitation, Recording, identify, Identified.validate and report: a path that tells much, a log, a model with
         intervals, and its torques on another motion.
Look at  the rank: torques depend on 43 combinations of 70 inertial parameters. Least squares gives those, and bodies of
         which some cannot exist; log-Cholesky gives bodies that do, as near to the data.
Needs    pip install example-robot-data for the panda
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write

FRICTION = sd.Friction(coulomb=[0.5, 0.5, 0.4, 0.4, 0.3, 0.3, 0.2], viscous=0.3)
NOISE = np.array([0.2, 0.2, 0.2, 0.15, 0.1, 0.05, 0.05])  # N m, of the torque sensors


def measured(robot: sd.Model, path: sd.Path, rng: np.random.Generator) -> sd.Recording:
    """A log of the robot on the path, as its sensors would have it."""
    t = np.arange(0.0, path.duration, 5e-3)
    q, v, a = path(t)
    tau = sd.rnea(robot, q, v, a) - sd.friction_torque(robot, v, FRICTION)
    return sd.Recording(t, q, tau + NOISE * rng.normal(size=tau.shape), v, a)


def draw(found: sd.Identified, true: np.ndarray, nominal: sd.Model, other: sd.Recording, save: str) -> None:
    """Errors of base parameters beside their intervals, and a joint's torque on another motion."""
    figure, (left, right) = picture(2, 10.0, 4.0)
    size = found.half_width
    left.errorbar(np.arange(len(true)), (found.beta - true) / size, yerr=1.0, fmt="o", markersize=3, linewidth=0.8)
    left.axhline(0.0, color="k", linewidth=0.8)
    left.set(xlabel="base parameter", ylabel="error, in half widths", title="95 % intervals and the truth, 0")
    judged, state = found.validate(other), [other.q, other.v, other.a]
    right.plot(judged.t, judged.tau[:, 4], linewidth=0.8, label="measured")
    right.plot(judged.t, judged.predicted[:, 4], label="identified")
    right.plot(other.t, sd.rnea(nominal, *map(np.asarray, state))[:, 4], "--", label="before, no friction")
    right.set(xlabel="t [s]", ylabel="torque of joint 5 [N m]", title="another motion")
    right.legend()
    write(figure, save)


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print rank, bodies and torques of another motion; returns what was found."""
    panda, rng = sd.load_urdf("panda"), np.random.default_rng(0)
    robot = panda.reduced([name for name in panda.names if "finger" in name])
    wrong = sd.inertial_parameters(robot) * rng.uniform(0.7, 1.3, size=(robot.njoints, 1))
    nominal = robot.with_(inertial_parameters=wrong)  # what the engineer has: masses up to 30 % off
    base = sd.base_parameters(robot)
    print(f"{base.rank} base parameters of {len(base.names)}; one is {base.text(9)}")

    starts, steps = (4, 10) if quick else (20, 60)
    paths = [sd.excitation(nominal, 10.0, starts=starts, steps=steps, seed=seed) for seed in (0, 1)]
    log, other = (measured(robot, path, rng) for path in paths)
    found = {method: sd.identify(log, nominal, method) for method in ("wls", "log_cholesky")}
    for method, fit in found.items():
        exist = sum(values[0] > 0.0 for values in fit.eigenvalues.values())
        ratio = fit.validate(other).ratio
        print(f"{method}: {exist} of 7 bodies exist; another motion within {ratio.max():.3f} times the noise")
    model = found["log_cholesky"].model()  # that of wls would raise InertiaError
    state: Any = (other.q, other.v, other.a)
    true = sd.rnea(robot, *state)
    before, after = (float(abs(sd.rnea(x, *state) - true).max()) for x in (nominal, model))
    print(f"torques of inertia and gravity are off by {before:.3g} N m before, {after:.3g} N m after")

    if save:
        friction = np.concatenate([FRICTION.viscous * np.ones(7), FRICTION.coulomb])
        pi = np.append(sd.inertial_parameters(robot)[1:], friction)
        draw(found["log_cholesky"], found["wls"].base.K @ pi, nominal, other, save)
    need("matplotlib", "plot")
    page = io.StringIO()
    found["log_cholesky"].report(page, other)  # or a name: report("panda.html", other)
    print(f"the report is a page of {len(page.getvalue()) // 1000} kB")
    return {"base": base, "robot": robot, "before": before, "after": after, "page": page.getvalue(), **found}


if __name__ == "__main__":
    start(main)
