"""A robot without force sensors feels a push: the momentum observer, thresholds, and the force on the tool.

Learn    sd.MomentumObserver takes q, v and the motors' torque, no acceleration: its residual is the torque of contacts,
         through a filter of time constant 1/K. detection_thresholds takes residuals of free motion; contact_wrench
         turns a residual into a force.
Look at  the delay: a few ms, far below 1/K, because a threshold is crossed early. The force is right once the filter
         has settled. Errors of the model look like contact: a tool of 0.3 kg that is not in the model is a push without
         end.
Needs    pip install example-robot-data for the UR5
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
DT, GAIN, BEGIN, END, TIME = 2e-3, 40.0, 250, 400, 500  # of steps
HOME = np.array([0.1, -1.2, 1.4, -0.3, 0.5, 0.2])
PUSH = np.array([-15.0, 5.0, 10.0, 0.0, 0.0, 0.0])  # on the tool, in its axes [N]
NOISE = 0.3  # [N m] of the torques that are measured


def move(model: sd.Model, robot: sd.Model, pushed: bool, seed: int) -> tuple[Array, Array]:
    """Residuals (steps, 6), and q as the push ends, of a robot that follows a path by a model of it."""
    path, draws = sd.fourier(0.8 * np.eye(6)[:2], 0.3 * np.eye(6)[2:4], 0.4, HOME), np.random.default_rng(seed)
    observer, residual, (q, v, _) = sd.MomentumObserver(model, GAIN, DT), [], path(0.0)
    here = q
    for k, (q_d, v_d, a_d) in enumerate(zip(*path(DT * np.arange(TIME)), strict=True)):
        tau = sd.rnea(model, q, v, a_d + 100.0 * (q_d - q) + 20.0 * (v_d - v))
        residual.append(observer.update(q, v, tau + NOISE * draws.normal(size=6)))
        here = q if k == END else here
        force = sd.wrench_at(model, q, "tool0", PUSH) if pushed and BEGIN <= k < END else None
        q, v = sd.step(robot, q, v, tau, DT, fext=force)
    return np.array(residual), here


def main(save: str | None = None) -> dict[str, Any]:
    """Print when the push is felt and what it is found to be; returns residuals, thresholds and forces."""
    model = sd.load_urdf("ur5")
    tool = model.with_(payload={"tool0": (0.3, (0.0, 0.0, 0.05), 1e-3 * np.eye(3))})
    limits = sd.detection_thresholds(move(model, model, False, 0)[0][50:])
    residual, q = move(model, model, True, 1)
    felt = DT * (np.argmax((abs(residual) > limits).any(1)) - BEGIN)
    force = sd.contact_wrench(model, q, residual[END], "tool0").wrench
    unknown = abs(move(model, tool, False, 2)[0][-100:] / limits).max()
    print(f"thresholds {limits.round(2)} N m: felt {1e3 * felt:.0f} ms after it began, 1/K is {1e3 / GAIN:.0f} ms")
    print(f"force {PUSH[:3]} N, found {force[:3].round(1)} N; an unknown tool: {unknown:.1f} thresholds")
    if save:
        figure, axes = picture()
        for k, y in enumerate(residual.T[:3]):
            axes.plot(DT * np.arange(TIME), y, linewidth=0.9, label=f"residual of joint {k + 1}")
            axes.axhline(limits[k], color="0.7", linewidth=0.6)
            axes.axhline(-limits[k], color="0.7", linewidth=0.6)
        axes.axvspan(BEGIN * DT, END * DT, color="0.93")
        axes.set(xlabel="t [s]", ylabel="[N m], grey: thresholds, and the time of the push")
        axes.legend(fontsize="small")
        write(figure, save)
    return {"felt": felt, "limits": limits, "force": force, "residual": residual, "unknown": unknown}


if __name__ == "__main__":
    start(main)
