"""Cost of a study: a bare loop that draws and reduces the same chunks against it; files, memory, results counted apart.

    python benchmarks/studies.py [--quick] [--chunks N]

The study's results are asserted equal to the loop's before anything is printed. Chunks are sized to half a second or
more; loop and study take turns, chunk by chunk of a round, so that a busy machine slows both.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from tables import draw

import spatialdyn as sd

SECONDS = 0.5  # of a chunk, at least
FIRST = 20_000  # samples of the chunk that is timed to size the others
ROUNDS = 20  # of inverse dynamics of a state
REDUCE = {"tau": sd.Moments("tau"), "part": sd.Quantiles("tau"), "most": sd.Worst("most", 10, ("q",))}


def torques(model: sd.Model, rng: np.random.Generator, n: int) -> dict[str, Any]:
    """The largest torques of random states that slow down: work, and few numbers."""
    q = sd.random_configuration(model, rng, n)
    v, a = rng.standard_normal((2, n, model.nv))
    tau = sd.rnea(model, q, v, a)
    for _ in range(ROUNDS):
        v = 0.9 * v
        tau = np.maximum(tau, sd.rnea(model, q, v, a))
    return {"q": q, "tau": tau, "most": np.abs(tau).max(-1)}


def loop(model: sd.Model, chunk: int, seed: int, numbers: range) -> dict[str, Any]:
    """The same chunks, drawn and reduced in a loop."""
    whole: dict[str, Any] = {}
    for i in numbers:
        arrays = torques(model, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(i,))), chunk)
        for label, x in REDUCE.items():
            state = x.of(arrays, i * chunk)
            whole[label] = x.merge(whole[label], state) if label in whole else state
    return whole


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two chunks of a tenth of the size")
    parser.add_argument("--chunks", type=int, default=8, metavar="N", help="of a round (default: 8)")
    arguments = parser.parse_args()
    model = sd.load_urdf("ur5")
    began = time.perf_counter()
    loop(model, FIRST, 1, range(1))
    began = time.perf_counter()
    loop(model, FIRST, 1, range(1))
    chunk = int(FIRST * SECONDS / (time.perf_counter() - began) * 1.2)
    chunk, count = (chunk // 10, 2) if arguments.quick else (chunk, arguments.chunks)
    times: dict[str, list[float]] = {"loop": [], "study": []}
    with tempfile.TemporaryDirectory() as folder:
        study = sd.study(torques, model, chunk * count, chunk, 1, f"{folder}/study", reduce=REDUCE)
        memory = []
        for i in range(count):
            began = time.perf_counter()
            loop(model, chunk, 1, range(i, i + 1))
            times["loop"].append(time.perf_counter() - began)
            began = time.perf_counter()
            study.warm()  # the next chunk that is missing
            times["study"].append(time.perf_counter() - began)
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        expected = {label: REDUCE[label].finish(state) for label, state in loop(model, chunk, 1, range(count)).items()}
        found = study.result()
        for x, y in zip(found["tau"], expected["tau"], strict=True):
            np.testing.assert_array_equal(x, y)
        np.testing.assert_array_equal(found["part"], expected["part"])
        np.testing.assert_array_equal(found["most"].sample, expected["most"].sample)
        size = sum(x.stat().st_size for x in Path(study.folder).iterdir()) / count
    one, other = (statistics.median(times[name]) for name in ("loop", "study"))
    ratio = statistics.median(y / x for x, y in zip(times["loop"], times["study"], strict=True))
    grown = memory[-1] - memory[min(1, count - 1)]
    draw(
        f"{count} chunks of {chunk} samples of a UR5",
        ["loop [s]", "study [s]", "ratio", "files of a chunk [kB]", "memory grew [MB]"],
        [[f"{one:.3f}", f"{other:.3f}", f"{ratio:.3f}", f"{size / 1e3:.1f}", f"{grown:.0f}"]],
    )


if __name__ == "__main__":
    main()
