"""Cost of identification: base parameters, a log of 7000 x 7 rows by each method, an exciting path; one thread.

    python benchmarks/identification.py [--quick]

Every result is asserted before it is measured: ranks, base parameters within 6 deviations of the robot's, both methods
of consistent bodies within a tenth of one of each other. CPU seconds, least of three. Needs
``pip install ".[validate,identification]"``; OPENBLAS_NUM_THREADS=1, or the like, keeps linear algebra on one core.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import spatialdyn as sd

ROWS = 7000  # times, of seven torques each
NOISE = np.array([0.2, 0.2, 0.2, 0.15, 0.1, 0.05, 0.02])  # N m
RANKS = {"panda": 43, "talos_reduced": 206, "talos": 290}


def seconds(run: Callable[[], Any]) -> float:
    """Least CPU seconds of three runs."""
    spent = []
    for _ in range(3):
        began = time.process_time()
        run()
        spent.append(time.process_time() - began)
    return min(spent)


def log_of(model: sd.Model) -> sd.Recording:
    """Seven thousand samples of a path that excites the arm, with viscous friction and noise."""
    path = sd.excitation(model, 10.0, starts=4, steps=10)
    t = np.linspace(0.0, path.duration, ROWS, endpoint=False)
    q, v, a = path(t)
    tau = sd.rnea(model, q, v, a) + 0.3 * v + 0.5 * np.sign(v)
    return sd.Recording(t, q, tau + NOISE * np.random.default_rng(0).normal(size=tau.shape), v, a)


def main() -> None:
    """Assert, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="without the humanoids")
    quick = parser.parse_args().quick
    warnings.simplefilter("ignore")
    panda = sd.load_urdf("panda")
    arm = panda.reduced([name for name in panda.names if "finger" in name])
    robots = {"panda": arm} | {name: sd.load_urdf(name) for name in RANKS if name != "panda" and not quick}
    for name, model in robots.items():
        assert sd.base_parameters(model).rank == RANKS[name]
        spent = seconds(lambda model=model: sd.base_parameters(model))
        print(f"base parameters of {name}, rank {RANKS[name]}: {spent:.2f} s")
    log = log_of(arm)
    start = arm.with_(inertial_parameters=1.2 * sd.inertial_parameters(arm))
    made = {}
    for method in ("ols", "wls", "log_cholesky", "sdp"):
        found = made[method] = sd.identify(log, start, method)
        truth = np.concatenate([np.ravel(sd.inertial_parameters(arm)[1:]), np.full(7, 0.3), np.full(7, 0.5)])
        assert abs((found.beta - found.base.K @ truth) / found.deviation).max() < 6.0
        spent = seconds(lambda method=method: sd.identify(log, start, method))
        print(f"{ROWS} x 7 rows by {method}: {spent:.2f} s, {found.steps} steps")
    off = (made["log_cholesky"].beta - made["sdp"].beta) / made["sdp"].deviation
    assert abs(off).max() < 0.1
    still = sd.Recording(log.t, log.q, log.tau, log.v)
    print(f"without accelerations, wls: {seconds(lambda: sd.identify(still, start)):.2f} s")
    print(f"with a delay that is fitted: {seconds(lambda: sd.identify(still, start, delay=True)):.2f} s")
    print(f"an exciting path of 20 starts and 60 steps: {seconds(lambda: sd.excitation(arm)):.2f} s")


if __name__ == "__main__":
    main()
