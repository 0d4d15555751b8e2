"""A study on several processes: the same bits as on one, however the work is cut.

Learn    a Model pickles, and a worker takes its compiled code from the disk cache: nothing is compiled twice.
Look at  the last line: results are equal to the last bit. For one batch threads are simpler: a call shares it among
         them (set_num_threads). Processes are for the code around calls: Python, files, other libraries.
"""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start


def landing(job: tuple[sd.Model, int]) -> tuple[int, float, float]:
    """One job: a random throw of the box, its process, its energy and its turn after one second."""
    model, seed = job
    rng = np.random.default_rng(seed)
    q0, v0 = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    run = sd.simulate(model, q0, v0, 1.0, 1e-3, "rk4")
    return os.getpid(), float(run.energy[-1] - run.energy[0]), float(run.q[-1, 3:7] @ run.q[0, 3:7])


def main(quick: bool = False) -> dict[str, object]:
    """Run the jobs here and in two processes; returns both results and the number of processes."""
    model = sd.load_urdf("floating_body", root="floating")
    jobs = [(model, seed) for seed in range(6 if quick else 64)]
    here = [landing(job)[1:] for job in jobs]
    # "spawn" starts clean processes: a fork copies locks that other threads hold. A script of your own that does so
    # needs `if __name__ == "__main__":`, for each process imports it
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        there = list(pool.map(landing, jobs, chunksize=2))
    processes = {process for process, _, _ in there}
    same = here == [result[1:] for result in there]
    worst = max(abs(energy) for energy, _ in here)
    print(f"{len(jobs)} jobs in {len(processes)} other processes; largest change of energy {worst:.1e} J")
    print(f"equal to the last bit: {same}")
    return {"here": here, "there": [result[1:] for result in there], "processes": processes}


if __name__ == "__main__":
    start(main)
