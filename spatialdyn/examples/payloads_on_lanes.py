"""A hundred thousand payloads: how often a pick overloads a joint, when mass and centre of the load are uncertain.

Learn    specialize(..., inputs={"payload": frame}) compiles one program in which the load is an input, as q is; the
         batch runs on SIMD lanes. Without it each load would be a model of its own.
Look at  the time of a sample, and the quantiles: the limit of a joint is crossed long before the average says so.
Needs    pip install example-robot-data for the Panda
"""

from __future__ import annotations

import time

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(quick: bool = False, save: str | None = None) -> dict[str, np.ndarray]:
    """Print quantiles of the torques of a fast lift; returns loads (N, 10), torques (N, nv) and the state."""
    panda = sd.load_urdf("panda")
    model = panda.reduced(["panda_finger_joint1", "panda_finger_joint2"])  # seven joints, the fingers locked
    q, v = np.array([0.0, 0.3, 0.0, -1.4, 0.0, 1.7, 0.8]), np.array([0.3, -1.0, 0.0, 1.0, 0.0, 0.5, 0.0])
    a = np.array([1.0, -4.0, 0.0, 2.0, 0.0, 2.0, 0.0])
    program = sd.specialize(model, sd.rnea, inputs={"payload": "panda_hand"})
    print(program.signature, program.engine, f"compiled in {program.compile_seconds:.2f} s")

    rng, n = np.random.default_rng(0), 2000 if quick else 100_000
    loads = np.zeros((n, 10))  # mass, centre of mass x y z, inertia xx xy xz yy yz zz about it
    loads[:, 0] = rng.normal(3.0, 0.5, n).clip(0.0)
    loads[:, 1:4] = [0.0, 0.0, 0.12] + 0.03 * rng.normal(size=(n, 3))
    loads[:, [4, 7, 9]] = loads[:, :1] * 0.05**2 * 0.4  # balls of 5 cm: 2/5 m r²
    program(q, v, a, loads)  # once, so that the time below is not that of a cold start
    begin = time.perf_counter()
    tau = program(q, v, a, loads)
    spent = time.perf_counter() - begin
    print(f"{n} loads in {1e3 * spent:.2f} ms, {1e9 * spent / n:.0f} ns each\n")

    print(f"{'joint':14} {'median':>8} {'1 in 100':>9} {'worst':>8} {'limit':>7}  overloaded")
    for k, joint in enumerate(model.joints[1:]):
        size, limit = np.sort(abs(tau[:, k])), model.effort_limit[k]
        over = np.mean(size > limit)
        print(f"{joint.name:14} {size[n // 2]:8.2f} {size[-n // 100]:9.2f} {size[-1]:8.2f} {limit:7.1f}  {over:9.2%}")
    if save:
        figure, axes = picture()
        for k in (1, 3, 5):
            axes.hist(abs(tau[:, k]) / model.effort_limit[k], 100, alpha=0.6, density=True, label=model.names[k + 1])
        axes.axvline(1.0, color="k", linewidth=0.8)
        axes.set(xlabel="torque over its limit", ylabel="density", title="3 ± 0.5 kg in the hand of a Panda")
        axes.legend()
        write(figure, save)
    return {"loads": loads, "tau": tau, "state": np.stack([q, v, a])}


if __name__ == "__main__":
    start(main)
