"""What studies of 10⁹ and 10¹² samples take on 1 to 1000 machines, reckoned from what a chunk costs here.

    python benchmarks/scale.py             print the tables
    python benchmarks/scale.py --write     write the page "Internet scale, on paper" from studies.json

Figures of a chunk are those that ``studies.py --write`` measured. The rest are assumptions, which the page names. How
busy machines are is simulated: workers ask one scheduler for chunks, which serves one after the other.
"""

from __future__ import annotations

import argparse
import heapq
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

from spatialdyn.docs import blocks
from spatialdyn.studies.study import AHEAD

PAGE = blocks.PAGES / "scale.md"
CORES = 32  # of a machine
MEMORY = 64e9  # of it, in bytes
PRICE = 0.04  # of an hour of a core, in dollars
GPU_SAMPLES, GPU_PRICE = 1e9, 3.0  # of inverse dynamics a second, in dollars an hour: nothing of it ran
NODES = (1, 10, 1000)
SAMPLES = (1e9, 1e12)
LENGTHS = (0.5, 5.0, 60.0, 600.0)  # of chunks, in seconds of a core
ROUNDS = 6  # chunks of a worker in a simulation


class Cluster(NamedTuple):
    """Workers, each of some cores, and a scheduler that takes ``serve`` seconds for a chunk."""

    workers: int
    cores: int
    serve: float


def makespan(cluster: Cluster, chunks: int, length: float, ahead: int = AHEAD) -> float:
    """Seconds until all chunks are done: each is of ``length`` seconds of a core, at most ``ahead`` are given out."""
    busy = [0.0] * min(cluster.workers, ahead, chunks)  # when each worker is free
    heapq.heapify(busy)
    free, last = 0.0, 0.0  # the scheduler
    for _ in range(chunks):
        free = max(free, heapq.heappop(busy)) + cluster.serve
        end = free + length / cluster.cores
        heapq.heappush(busy, end)
        last = max(last, end)
    return last


def used(cluster: Cluster, length: float, ahead: int = AHEAD) -> float:
    """The part of all cores' time that computes, while each worker has ROUNDS chunks."""
    chunks = ROUNDS * cluster.workers
    return chunks * length / cluster.cores / (cluster.workers * makespan(cluster, chunks, length, ahead))


def table(head: list[str], body: list[list[str]]) -> list[str]:
    """A table in Markdown."""
    return ["| " + " | ".join(x) + " |" for x in [head, ["---"] * len(head), *body]] + [""]


def duration(seconds: float) -> str:
    """In the unit that shows it."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def amount(size: float) -> str:
    """Of bytes."""
    for unit, least in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= least:
            return f"{size / least:.3g} {unit}"
    return f"{size:.0f} B"


def longest(found: dict[str, Any]) -> float:
    """Seconds of a core of the longest chunk that fits in half of a machine's memory."""
    return MEMORY / 2.0 / found["sample_bytes"] / found["chunk"] * float(found["loop_s"])


def page(found: dict[str, Any]) -> str:
    """The page."""
    m, rate = found["machine"], found["chunk"] / found["loop_s"]  # samples a second of a core
    serve, length = found["dask_s"], longest(found)
    lines = [
        "# Internet scale, on paper", "",
        "This page is written by `benchmarks/scale.py` out of what `benchmarks/studies.py --write` measured. Nothing "
        "of it ran on more than one machine: times of many are reckoned and simulated.", "",
        "## What a chunk costs", "",
        f"Measured on {m['processor']} with {m['cores']} cores, {m['system']}, Python {m['python']}, NumPy "
        f"{m['numpy']}, in processor time. The study draws states of a UR5, computes 21 inverse dynamics of each, and "
        "keeps moments, quantiles and the ten worst.", "",
    ]  # fmt: skip
    lines += table(
        ["what", "measured"],
        [
            ["samples in all", f"{found['samples']:.3g}"],
            ["a sample, in a bare loop", f"{1e6 / rate:.2f} µs of a core"],
            ["memory of a sample, in its chunk", f"{found['sample_bytes']:.0f} B"],
            [f"a chunk of {found['chunk']} samples, in a bare loop", f"{found['loop_s']:.3f} s"],
            ["all chunks by the study over all by the loop, files included", f"{found['ratio']:.3f}"],
            ["memory that grew from the second chunk to the last", f"{found['memory_grew_MB']:.0f} MB"],
            ["files of a chunk", f"{amount(found['file_bytes'])}, at least {amount(found['least_file_bytes'])}"],
            ["a chunk of one sample: driver, worker and file", f"{1e3 * found['driver_s']:.2f} ms"],
            ["the same through Dask: its scheduler and client", f"{1e3 * serve:.1f} ms"],
            ["reading and merging a chunk's part for `result()`", f"{1e3 * found['result_s']:.2f} ms"],
            ["listing a part", f"{1e6 * found['list_s']:.1f} µs"],
        ],
    )
    lines += [
        "## Time and money", "",
        f"Assumed: machines of {CORES} cores as fast as one of these and {amount(MEMORY)} of memory, ${PRICE:.2f} an "
        f"hour of a core; one worker a machine, on all its cores. Chunks are the longest that half of the memory "
        f"holds, {duration(length)} of a core, or one a machine. For a GPU: {GPU_SAMPLES:.0e} samples a second and "
        f"${GPU_PRICE:.0f} an hour: an assumption, of which nothing ran. Studies draw and reduce on the host.", "",
    ]  # fmt: skip
    body = []
    for samples in SAMPLES:
        for nodes in NODES:
            work = samples / rate * found["ratio"]  # of a core
            own = min(length, work / nodes)
            chunks = max(nodes, round(work / own))
            share = used(Cluster(nodes, CORES, serve), own)
            body.append([
                f"{samples:.0e}", str(nodes), str(chunks), amount(chunks * found["file_bytes"]),
                duration(work / (nodes * CORES * share)), f"{share:.0%}", f"${work / 3600.0 * PRICE / share:.3g}",
                duration(chunks * found["result_s"]),
                f"{duration(samples / GPU_SAMPLES / nodes)}, ${samples / GPU_SAMPLES / 3600.0 * GPU_PRICE:.2g}",
            ])  # fmt: skip
    lines += table(
        ["samples", "machines", "chunks", "files", "time", "cores busy", "money", "`result()`", "a GPU each, assumed"],
        body,
    )
    lines += [
        "## What breaks first", "",
        f"Simulated: workers ask one scheduler, which takes {1e3 * serve:.1f} ms for a chunk, as Dask's did above; "
        f"`run` gives out at most {AHEAD} chunks at a time. The part of the cores' time that computes, for chunks of "
        "so many seconds of a core:", "",
    ]  # fmt: skip
    body = []
    for nodes in NODES:
        for workers, cores in ((nodes, CORES), (nodes * CORES // 4, 4)):
            shares = [used(Cluster(workers, cores, serve), x) for x in LENGTHS]
            body.append([str(nodes), f"{workers} of {cores} cores", *(f"{x:.0%}" for x in shares)])
    lines += table(["machines", "workers", *(f"{x:g} s" for x in LENGTHS)], body)
    machines = Cluster(1000, CORES, serve)
    files = SAMPLES[1] / rate / LENGTHS[0]
    lines += [
        f"1. **The scheduler.** One that serves {1.0 / serve:.0f} chunks a second keeps "
        f"{LENGTHS[0] / serve:.0f} cores busy with chunks of {LENGTHS[0]:g} s. A chunk should take its worker longer "
        "than the number of workers times the scheduler's time.",
        f"2. **Memory**, which limits that: a chunk of {LENGTHS[2]:g} s of a core holds "
        f"{amount(LENGTHS[2] * rate * found['sample_bytes'])}, one of {LENGTHS[3]:g} s "
        f"{amount(LENGTHS[3] * rate * found['sample_bytes'])}. A function that draws and reduces in blocks has longer "
        "chunks in the same memory; or split the study by seed, each part with a folder and a scheduler of its own: "
        f"{math.ceil(1000 * serve / (length / CORES))} of them feed 1000 machines. The driver holds one sum and "
        "one part, however many samples.",
        f"3. **Chunks given out.** With 256 at a time 1000 machines are busy for "
        f"{used(machines, LENGTHS[3], 256):.0%} of the time with chunks of {LENGTHS[3]:g} s; with {AHEAD} for "
        f"{used(machines, LENGTHS[3]):.0%}.",
        f"4. **Files.** 10¹² samples in chunks of {LENGTHS[0]:g} s are {files:.2g} files in one folder: a listing "
        f"takes {duration(files * found['list_s'])}, `result()`, which reads them one by one, "
        f"{duration(files * found['result_s'])}. Kept outputs are more: six joints of 10¹² samples are "
        f"{amount(1e12 * 6 * 8)}. Reduce, and draw the worst cases again by their numbers.",
        "", "On one machine none of this applies: `study.run()` without an executor uses all cores.", "",
    ]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Print or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the page")
    text = page(json.loads(Path(__file__).with_name("studies.json").read_text(encoding="utf-8")))
    if parser.parse_args().write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
