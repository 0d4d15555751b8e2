"""What torques must a panda hold? Five million payloads and poses, of which a few numbers are kept.

Learn    sd.study runs a function on random samples, chunk by chunk, here or on any executor (a Dask client, MPI): what
         fits in no memory becomes moments, quantiles and the worst cases. A study that was killed goes on where it
         stopped; on other machines it gives the same bits. ``spatialdyn study payload_study.py --folder F`` runs this
         file's ``study``, of ten million.
Look at  the picture: the second joint carries the arm and its load, and comes near its motor's limit. The others use
         half of theirs at most in 99.9 % of samples; the first and the last, which are upright or short, hardly any.
Needs    pip install example-robot-data for the panda
"""

from __future__ import annotations

from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

MOST = 3.0  # kg
AT = (0.5, 0.9, 0.99, 0.999)
TIP = "panda_hand"


def holding(model: sd.Model, rng: np.random.Generator, n: int) -> dict[str, Any]:
    """Torques of n random poses with random payloads, as parts of the motors' limits."""
    q = sd.random_configuration(model, rng, n)
    mass = rng.uniform(0.0, MOST, n)
    J = sd.frame_jacobian(model, q, TIP, "local_world_aligned")
    weight = -mass[:, None] * np.linalg.norm(model.gravity) * J[:, 2]
    part = np.abs(sd.generalized_gravity(model, q) - weight) / model.effort_limit
    return {"q": q, "mass": mass, "part": part, "most": part.max(-1)}


def study(folder: str, samples: int = 10_000_000) -> sd.Study:
    """The study; its parts are written to a folder."""
    model = sd.load_urdf("panda").reduced(["panda_finger_joint1", "panda_finger_joint2"])
    wanted = {"part": sd.Quantiles("part", AT), "worst": sd.Worst("most", 1, ("q", "mass")), "mean": sd.Moments("part")}
    return sd.study(holding, model, samples, 50_000, 7, folder, reduce=wanted)


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print what the torques come to in 5 000 000 samples, or 200 000; returns the results."""
    with TemporaryDirectory() as folder:
        found = study(f"{folder}/study", 200_000 if quick else 5_000_000).run().result()
    worst, joint, mean = found["worst"], int(found["part"][-1].argmax()), found["mean"]
    print(f"{mean.samples} samples: joint {joint + 1} needs {mean.mean[joint]:.0%} of its motor's torque on average,")
    print(f"in one of a thousand samples more than {found['part'][-1, joint]:.0%}; at worst {worst.value[0]:.0%},")
    print(f"with {worst.beside['mass'][0]:.2f} kg, in sample {worst.sample[0]}")
    if save:
        figure, axes = picture(height=3.6)
        for x, at in zip(found["part"], AT, strict=True):
            axes.plot(np.arange(1, len(x) + 1), x, "o-", label=f"{at:.1%} of samples")
        axes.axhline(1.0, color="0.4", ls="--")
        axes.set(xlabel="joint", ylabel="torque / limit of the motor", title="what holds payloads up to 3 kg")
        axes.legend()
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
