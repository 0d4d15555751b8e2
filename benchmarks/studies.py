"""Cost of a study: a bare loop that draws and reduces the same chunks against it; files, memory, results counted apart.

    python benchmarks/studies.py [--quick] [--chunks N] [--samples N] [--write]

The study's results are asserted equal to the loop's before anything is printed. Chunks are sized to half a second or
more; loop and study take turns, chunk by chunk of a round, and are judged by processor time, so that a busy machine
slows both alike. ``--write`` keeps the figures in studies.json, from which ``scale.py`` reckons.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import statistics
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
from tables import draw

import spatialdyn as sd
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.studies.folder import Folder

SECONDS = 0.5  # of a chunk, at least
FIRST = 20_000  # samples of the chunk that is timed to size the others
ROUNDS = 20  # of inverse dynamics of a state
MANY = 2000  # chunks of one sample, for what each costs the driver
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


def one(model: sd.Model, rng: np.random.Generator, n: int) -> dict[str, Any]:
    """Hardly any work."""
    return {"x": rng.random((n, 1))}


def loop(model: sd.Model, chunk: int, seed: int, numbers: range) -> dict[str, Any]:
    """The same chunks, drawn and reduced in a loop."""
    whole: dict[str, Any] = {}
    for i in numbers:
        arrays = torques(model, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(i,))), chunk)
        for label, x in REDUCE.items():
            state = x.of(arrays, i * chunk)
            whole[label] = x.merge(whole[label], state) if label in whole else state
    return whole


class AtOnce(Executor):
    """Runs what it is given when it is given."""

    def submit(self, fn: Callable[..., Any], /, *words: Any, **options: Any) -> Future[Any]:
        """The result, as a future."""
        made: Future[Any] = Future()
        made.set_result(fn(*words, **options))
        return made


def seconds(work: Callable[[], Any]) -> float:
    """Processor time of all threads."""
    began = time.process_time()
    work()
    return time.process_time() - began


def of_result(chunk: int, count: int = 4) -> float:
    """Processor seconds to read a chunk's part and to merge it."""
    with tempfile.TemporaryDirectory() as folder:
        study = sd.study(torques, sd.load_urdf("ur5"), chunk * count, chunk, 1, f"{folder}/study", reduce=REDUCE).run()
        return seconds(study.result) / count


def of_driver() -> dict[str, float]:
    """Processor seconds a chunk of what is not the chunk's own work, and its file."""
    model = sd.load_urdf("two_link")
    with tempfile.TemporaryDirectory() as folder:
        study = sd.study(one, model, MANY, 1, 1, f"{folder}/study", reduce=sd.Moments("x"))
        whole = seconds(lambda: study.run(AtOnce())) / MANY
        listed = seconds(lambda: Folder(study.folder).done()) / MANY
        size = sum(x.stat().st_size for x in Path(study.folder).iterdir()) / MANY
    return {"driver_s": whole, "list_s": listed, "least_file_bytes": size}


def of_memory() -> float:
    """Bytes a sample that a chunk holds at most."""
    model, generator = sd.load_urdf("ur5"), np.random.default_rng(0)
    tracemalloc.start()
    torques(model, generator, FIRST)
    most = tracemalloc.get_traced_memory()[1] / FIRST
    tracemalloc.stop()
    return most


def of_dask(chunks: int = 400) -> float | None:
    """Processor seconds a chunk of Dask's scheduler and its client, in one process; None without Dask."""
    try:
        import distributed
    except ImportError:
        return None
    model = sd.load_urdf("two_link")
    with (
        tempfile.TemporaryDirectory() as folder,
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        study = sd.study(one, model, chunks, 1, 1, f"{folder}/study", reduce=sd.Moments("x"))
        study.warm(client)
        return seconds(lambda: study.run(client)) / (chunks - 1)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two chunks of a tenth of the size")
    parser.add_argument("--chunks", type=int, default=8, metavar="N", help="of a round (default: 8)")
    parser.add_argument("--samples", type=int, metavar="N", help="in all, in place of --chunks")
    parser.add_argument("--write", action="store_true", help="write studies.json")
    arguments = parser.parse_args()
    model = sd.load_urdf("ur5")
    loop(model, FIRST, 1, range(1))
    chunk = int(FIRST * SECONDS / seconds(lambda: loop(model, FIRST, 1, range(1))) * 1.2)
    chunk, count = (chunk // 10, 2) if arguments.quick else (chunk, arguments.chunks)
    if arguments.samples:
        count = -(-arguments.samples // chunk)
    times: dict[str, list[float]] = {"loop": [], "study": []}
    with tempfile.TemporaryDirectory() as folder:
        study = sd.study(torques, model, chunk * count, chunk, 1, f"{folder}/study", reduce=REDUCE)
        memory = []
        expected: dict[str, Any] = {}
        for i in range(count):
            made: dict[str, Any] = {}
            times["loop"].append(seconds(lambda made=made, i=i: made.update(loop(model, chunk, 1, range(i, i + 1)))))
            for label, x in REDUCE.items():
                expected[label] = x.merge(expected[label], made[label]) if label in expected else made[label]
            times["study"].append(seconds(study.warm))  # the next chunk that is missing
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        wanted = {label: REDUCE[label].finish(state) for label, state in expected.items()}
        found = study.result()
        for x, y in zip(found["tau"], wanted["tau"], strict=True):
            np.testing.assert_array_equal(x, y)
        np.testing.assert_array_equal(found["part"], wanted["part"])
        np.testing.assert_array_equal(found["most"].sample, wanted["most"].sample)
        size = sum(x.stat().st_size for x in Path(study.folder).iterdir()) / count
    bare, other = (statistics.median(times[name]) for name in ("loop", "study"))
    ratio = sum(times["study"]) / sum(times["loop"])
    grown = memory[-1] - memory[min(1, count - 1)]
    draw(
        f"{count} chunks of {chunk} samples of a UR5, {chunk * count} in all; processor time",
        ["loop [s]", "study [s]", "all / all", "files of a chunk [kB]", "memory grew [MB]"],
        [[f"{bare:.3f}", f"{other:.3f}", f"{ratio:.3f}", f"{size / 1e3:.1f}", f"{grown:.0f}"]],
    )
    driver, dask, read = of_driver(), of_dask(), of_result(chunk)
    draw(
        "a chunk's cost beside its work",
        ["driver and file [ms]", "result [ms]", "listing [µs]", "least file [kB]", "Dask's scheduler [ms]"],
        [[f"{1e3 * driver['driver_s']:.2f}", f"{1e3 * read:.2f}", f"{1e6 * driver['list_s']:.1f}",
          f"{driver['least_file_bytes'] / 1e3:.1f}", "" if dask is None else f"{1e3 * dask:.1f}"]],
    )  # fmt: skip
    if arguments.write:
        kept = {
            "machine": {
                "processor": host_cpu.host()[0], "cores": os.cpu_count(), "system": platform.system(),
                "python": platform.python_version(), "numpy": np.__version__,
            },
            "samples": chunk * count, "chunk": chunk, "loop_s": bare, "study_s": other, "ratio": ratio,
            "sample_bytes": of_memory(), "file_bytes": size, "memory_grew_MB": grown, "dask_s": dask,
            "result_s": read, **driver,
        }  # fmt: skip
        Path(__file__).with_suffix(".json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
