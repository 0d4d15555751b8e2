"""The library against its peers in one process: asserts equal results, then measures times, compilation and memory.

    python benchmarks/run.py [--quick] [--robots ur5,panda] [--output FOLDER]

Prints tables, writes results.json and plots/*.svg and *.png into the folder, by default this one; with
--quick or --robots, which leave figures out, it writes nothing without --output. benchmarks/readme.py puts a table into
README. Needs ``pip install ".[validate,bench]"``; adam, frax and drake are measured where installed.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import cases
import chains
import contestants
import costs
import machine
import numpy as np
import plots
from cases import CALLS, INSIDE, ROBOTS, Array, Case, Contestant
from measure import interleaved
from tables import Bar, show

import spatialdyn as sd
from spatialdyn.engines.programs.run import batch_kernels

HERE = Path(__file__).parent
FLOAT32 = 2e-2  # of the largest entry: shows that the results are of the same call; the error is reported
QUICK_CALLS = {"talos_full": ("rnea", "aba", "crba"), "tiago_dual": ()}  # all calls of the other robots
QUICK_COMPILED = {"ur5": ("rnea",), "talos_full": ("aba", "crba")}


class Effort(NamedTuple):
    """Amount of work: rounds, seconds per contestant and round, samples of batches and of the memory test."""

    rounds: int
    seconds: float
    samples: int
    starts: int
    held: int


FULL = Effort(rounds=21, seconds=0.02, samples=8192, starts=7, held=10_000_000)
QUICK = Effort(rounds=5, seconds=0.002, samples=2048, starts=3, held=500_000)


def optional(case: Case, call: str, build: Callable[[Case, str], Contestant | None], name: str, wanted: Array) -> Any:
    """A contestant of another library, None, or {"refused": why} if it fails or its results are wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = build(case, call)
            if made is not None:
                cases.check(case, call, name, made, wanted)
    except Exception as error:
        return {"refused": f"{type(error).__name__}: {str(error).splitlines()[0][:200]}"}
    return made


def of_robot(case: Case, calls: Iterable[str], present: list[str], effort: Effort, bar: Bar) -> tuple[Any, Any]:
    """Single and batched figures of some calls of one robot."""
    single, batch = {}, {}
    for call in calls:
        bar.step(f"{case.name} {call}")
        wanted = contestants.expected(case, call)
        plain, two, fresh = (
            cases.public(case, call, threads=threads, fresh=new) for threads, new in ((1, False), (2, False), (1, True))
        )
        own, k = cases.specialized(case, call)
        narrow, _ = cases.specialized(case, call, np.float32)
        pin, pools = contestants.pinocchio(case, call), [contestants.pool(case, call, threads) for threads in (1, 2)]
        jitted = cases.jitted(case, call)
        inside = Contestant(jitted, None, read=cases.rows)
        ours = {"sd": plain, "sd on 2 threads": two, "sd afresh": fresh, "k": own, "kernels": inside, "pin": pin}
        for name, one in {**ours, **{f"pool of {n + 1}": p for n, p in enumerate(pools) if p}}.items():
            cases.check(case, call, name, one, wanted)
        error = cases.check(case, call, "float32", narrow._replace(single=None), wanted, FLOAT32)
        others = {name: optional(case, call, contestants.MAKE[name], name, wanted) for name in present}
        refused = {name: x for name, x in others.items() if isinstance(x, dict)}
        others = {name: x for name, x in others.items() if isinstance(x, Contestant)}
        single[call] = times_of_one(plain, own, jitted, pin, others, effort)
        batch[call] = times_of_many(plain, two, fresh, own, narrow, pin, pools, others, effort)
        batch[call] |= {"float32_error": error, "engine": k.engine}
        batch[call] |= limits(case, call, k, batch[call]["k_ns" if call == "kinematics" else "ours_ns"])
        for name, why in refused.items():
            batch[call]["peers"][name] = why
    return single, batch


def times_of_one(
    plain: Contestant, own: Contestant, jitted: Any, pin: Contestant, others: dict[str, Contestant], effort: Effort
) -> dict[str, Any]:
    """Microseconds of one 1-D call from Python with an allocated result, and of one inside jitted code."""
    runs = {"ours": plain.single, "k": own.single, "pin": pin.single, "jitted": jitted}
    runs |= {f"peer {name}": x.single for name, x in others.items()}
    times = interleaved({name: run for name, run in runs.items() if run}, effort.rounds, effort.seconds)
    times["jitted"] /= INSIDE
    found: dict[str, Any] = {f"{name}_us": 1e6 * t for name, t in times.items() if not name.startswith("peer ")}
    found |= {"ratio": times["ours"] / times["pin"], "k_ratio": times["k"] / times["pin"]}
    found["jitted_ratio"] = times["jitted"] / times["pin"]
    found["peers"] = {name: {"us": 1e6 * times[f"peer {name}"]} for name in others}
    return found


def times_of_many(
    plain: Contestant, two: Contestant, fresh: Contestant, own: Contestant, narrow: Contestant, pin: Contestant,
    pools: list[Contestant | None], others: dict[str, Contestant], effort: Effort,
) -> dict[str, Any]:  # fmt: skip
    """Nanoseconds per sample; ``ratio``: Pinocchio's pool on one thread, or its Python loop, over the public call."""
    runs = {"ours": plain, "ours_2_threads": two, "fresh": fresh, "k": own, "float32": narrow, "pin": pools[0] or pin}
    if pools[1] is not None:
        runs["pin_2_threads"] = pools[1]
    runs |= {f"peer {name}": x for name, x in others.items()}
    calls = {name: x.bare or x.batch for name, x in runs.items() if x.batch}
    times = interleaved(calls, effort.rounds, effort.seconds)
    sd.set_num_threads(1)
    ns = {name: 1e9 * t / runs[name].count for name, t in times.items()}
    found: dict[str, Any] = {f"{name}_ns": t for name, t in ns.items() if not name.startswith("peer ")}
    found |= {"ratio": ns["pin"] / ns["ours"], "pin_how": runs["pin"].how}
    found["peers"] = {name: {"ns": ns[f"peer {name}"], "how": x.how} for name, x in others.items() if x.batch}
    return found


def limits(case: Case, call: str, k: sd.Specialized, ns: float) -> dict[str, Any]:
    """Operations of the program, and the share of the machine's limits that the public batch reaches.

    For gravity the program is rnea at rest; for kinematics it is k, as the public calls are two programs. Stores have a
    share only if the result exceeds the caches.
    """
    if k.engine != "lanes":
        return dict.fromkeys(("operations", "flops_per_ns", "peak_share", "bytes_per_ns", "store_share"))
    flops = machine.flops(k.operations) / ns
    written = 8 * sum(int(np.prod(shape)) for shape in cases.shapes(case, call))
    large = written * case.samples >= batch_kernels.STREAM_BYTES
    return {
        "operations": k.operations,
        "flops_per_ns": flops,
        "peak_share": flops / machine.peak("double"),
        "bytes_per_ns": written / ns,
        "store_share": written / ns / max(machine.stores().values()) if large else None,
    }


def measured(robots: list[str], quick: bool) -> dict[str, Any]:
    """All measurements."""
    effort = QUICK if quick else FULL
    calls = {robot: QUICK_CALLS.get(robot, tuple(CALLS)) if quick else tuple(CALLS) for robot in robots}
    compiled = {robot: QUICK_COMPILED.get(robot, ()) if quick else tuple(CALLS) for robot in robots}
    steps = sum(map(len, calls.values())) + sum(map(len, compiled.values())) + len(chains.LENGTHS) + 3
    bar = Bar(steps)
    bar.step("machine")
    results: dict[str, Any] = {"machine": machine.machine(), "samples": effort.samples, "single": {}, "batch": {}}
    installed = [name for name, version in results["machine"]["peers"].items() if version != "absent"]
    for robot in robots:
        if not calls[robot]:
            continue
        asked = contestants.FIXED_ARMS[: 1 if quick else None]
        present = [name for name in installed if name == "mujoco" or robot in asked]
        case = cases.case(robot, effort.samples)
        one, many = of_robot(case, calls[robot], present, effort, bar)
        results["single"][robot], results["batch"][f"{robot}, {case.root}"] = one, many
    results["chains"] = chains.measured(effort.rounds, lambda: bar.step("chains"))
    results["compile"] = costs.compiling({k: v for k, v in compiled.items() if v}, lambda: bar.step("compiling"))
    bar.step("memory")
    results["memory"] = costs.memory(effort.held)
    bar.step("starting")
    results["start"] = costs.starting(effort.starts)
    bar.end()
    return results


def main() -> None:
    """Measure, assert, print, write."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer robots, rounds and samples, under 2 minutes")
    parser.add_argument("--robots", default=",".join(ROBOTS), help="some of them, by default %(default)s")
    parser.add_argument("--output", type=Path, help="folder of results.json and plots")
    options = parser.parse_args()
    robots = options.robots.split(",")
    unknown = [robot for robot in robots if robot not in ROBOTS]
    if unknown:
        parser.error(f"no robot {unknown[0]!r}, expected some of {', '.join(ROBOTS)}")
    results = measured(robots, options.quick)
    show(results)
    folder = options.output or (HERE if not options.quick and robots == list(ROBOTS) else None)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        for path in plots.draw(results, folder / "plots"):
            print(path)


if __name__ == "__main__":
    main()
