"""Timing on a noisy machine: contestants take turns, round after round; medians over the rounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from statistics import median


def per_call(run: Callable[[], object], calls: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Seconds per call over a loop of ``calls``."""
    start = clock()
    for _ in range(calls):
        run()
    return (clock() - start) / calls


def calls_within(run: Callable[[], object], seconds: float, clock: Callable[[], float] = time.perf_counter) -> int:
    """How many calls take about so long, 1 at least; the first call is not counted."""
    run()
    once = per_call(run, 1, clock)
    return max(1, int(seconds / (once if once > seconds else max(per_call(run, 3, clock), 1e-9))))


def interleaved(
    contestants: Mapping[str, Callable[[], object]], rounds: int, seconds: float,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:  # fmt: skip
    """Median seconds per call of each contestant; in a round each runs for about ``seconds``."""
    calls = {name: calls_within(run, seconds, clock) for name, run in contestants.items()}
    taken: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            taken[name].append(per_call(run, calls[name], clock))
    return {name: median(values) for name, values in taken.items()}
