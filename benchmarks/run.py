"""Ours against Pinocchio in one process: correctness asserted first, then times, ratios and what starting costs.

    python benchmarks/run.py [--quick]

Writes benchmarks/results.json and prints the tables; benchmarks/report.py puts one of them into the README.
Needs ``pip install "spatialdyn[validate,bench]"``.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import platform
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pinocchio as pin
from measure import interleaved
from rich.console import Console
from rich.progress import track
from rich.table import Table

import spatialdyn as sd
from spatialdyn.urdf import find_robot

RESULTS = Path(__file__).with_name("results.json")
ROBOTS = ("ur5", "panda", "talos_full")
BATCHES = (
    ("ur5", "fixed"),
    ("panda", "fixed"),
    ("talos_full", "fixed"),
    ("anymal_b_simple_description/robots/anymal", "floating"),
)
CALLS: dict[str, tuple[str, Callable[..., Any]]] = {  # name: arguments, Pinocchio's function
    "rnea": ("qva", pin.rnea),
    "crba": ("q", pin.crba),
    "aba": ("qvt", pin.aba),
    "nonlinear_effects": ("qv", pin.nonLinearEffects),
    "generalized_gravity": ("q", pin.computeGeneralizedGravity),
    "minverse": ("q", pin.computeMinverse),
}
INSIDE = 1000  # calls of a jitted loop
SCALED = 1e-10  # both are float64; M⁻¹ of an ill-conditioned M is no better in either


def jitted_loop(name: str) -> Callable[..., None]:
    """A user's own jitted loop over the public kernel."""
    kernel = getattr(sd.kernels, name)
    if CALLS[name][0] == "q":

        @numba.njit(nogil=True)
        def one(bodies, q, out, n):  # type: ignore[no-untyped-def]
            for _ in range(n):
                kernel(bodies, q, out)

        return one
    if CALLS[name][0] == "qv":

        @numba.njit(nogil=True)
        def two(bodies, q, v, out, n):  # type: ignore[no-untyped-def]
            for _ in range(n):
                kernel(bodies, q, v, out)

        return two

    @numba.njit(nogil=True)
    def three(bodies, q, v, a, out, n):  # type: ignore[no-untyped-def]
        for _ in range(n):
            kernel(bodies, q, v, a, out)

    return three


def single_calls(robot: str, rounds: int, seconds: float) -> dict[str, dict[str, float]]:
    """Microseconds of one 1-D call from Python with an allocated result, and of one inside jitted code."""
    path = str(find_robot(robot))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours = sd.load_urdf(path)
    theirs = pin.buildModelFromUrdf(path)
    data, rng = theirs.createData(), np.random.default_rng(0)
    state = {"q": sd.random_configuration(ours, rng), **{k: rng.normal(size=ours.nv) for k in "vat"}}
    table = {}
    for name, (letters, pin_call) in CALLS.items():
        arguments = [state[k] for k in letters]
        call, loop = getattr(sd, name), jitted_loop(name)
        expected = pin_call(theirs, data, *arguments)
        out = np.empty_like(expected, order="C")
        loop(ours.bodies, *arguments, out, 1)
        for result in (call(ours, *arguments), out):
            error = abs(result - expected).max() / max(1.0, abs(expected).max())
            assert error <= SCALED, f"{robot} {name}: scaled error {error:.1e} against Pinocchio"
        times = interleaved(
            {
                "ours": lambda call=call, arguments=arguments: call(ours, *arguments),
                "pin": lambda pin_call=pin_call, arguments=arguments: pin_call(theirs, data, *arguments),
                "jitted": lambda loop=loop, arguments=arguments, out=out: loop(ours.bodies, *arguments, out, INSIDE),
            },
            rounds,
            seconds,
        )
        table[name] = {
            "ours_us": 1e6 * times["ours"],
            "pin_us": 1e6 * times["pin"],
            "jitted_us": 1e6 * times["jitted"] / INSIDE,
            "ratio": times["ours"] / times["pin"],
            "jitted_ratio": times["jitted"] / INSIDE / times["pin"],
        }
    return table


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """A float64 array on a 64-byte boundary, as results that are streamed out want it."""
    raw = np.zeros(8 * int(np.prod(shape)) + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + 8 * int(np.prod(shape))].view(np.float64).reshape(shape)


def batch_calls(robot: str, root: str, samples: int, rounds: int) -> dict[str, dict[str, float]]:
    """Nanoseconds a sample of the public batched call into a given array, and of Pinocchio's pool (crba: its loop)."""
    path = str(find_robot(robot))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours = sd.load_urdf(path, root=root)
    theirs = pin.buildModelFromUrdf(path, *([pin.JointModelFreeFlyer()] if root == "floating" else []))
    data, rng = theirs.createData(), np.random.default_rng(0)
    q = sd.random_configuration(ours, rng, samples)
    v, a = rng.normal(size=(2, samples, ours.nv))
    columns = [np.asfortranarray(x.T) for x in (q, v, a)]
    pools = {n: pin.ModelPool(theirs, n) for n in (1, 2)}
    few = range(min(samples, 512))
    theirs_for = {
        "rnea": lambda n: pin.rneaInParallel(n, pools[n], *columns),
        "aba": lambda n: pin.abaInParallel(n, pools[n], *columns),
        "crba": lambda n: [pin.crba(theirs, data, q[i]) for i in few],
    }
    table = {}
    for name, run in theirs_for.items():
        arguments = (q,) if name == "crba" else (q, v, a)
        call = getattr(sd, name)
        out = aligned((samples, ours.nv, ours.nv) if name == "crba" else (samples, ours.nv))
        call(ours, *arguments, out=out)
        single = getattr(pin, name)
        for i in range(0, samples, max(1, samples // 100)):
            expected = single(theirs, data, *(x[i] for x in arguments))
            error = abs(out[i] - expected).max() / max(1.0, abs(expected).max())
            assert error <= SCALED, f"{robot} {name}: scaled error {error:.1e} of sample {i} against Pinocchio"

        def ours_on(threads: int, call=call, arguments=arguments, out=out) -> None:  # type: ignore[no-untyped-def]
            sd.set_num_threads(threads)
            call(ours, *arguments, out=out)

        times = interleaved(
            {
                "ours": lambda on=ours_on: on(1),
                "ours2": lambda on=ours_on: on(2),
                "pin": lambda run=run: run(1),
                **({} if name == "crba" else {"pin2": lambda run=run: run(2)}),
            },
            rounds,
            0.02,
        )
        sd.set_num_threads(1)
        count = len(few) if name == "crba" else samples
        table[name] = {
            "ours_ns": 1e9 * times["ours"] / samples,
            "pin_ns": 1e9 * times["pin"] / count,
            "ratio": times["pin"] / count / (times["ours"] / samples),
            "ours_2_threads_ns": 1e9 * times["ours2"] / samples,
        }
        if name != "crba":
            table[name]["pin_2_threads_ns"] = 1e9 * times["pin2"] / samples
    return table


def chain(n: int) -> sd.Model:
    """Rods end to end, joints about y and x in turn."""
    builder = sd.ModelBuilder(f"chain{n}")
    inertia = (1.0, (0.0, 0.0, 0.5), np.diag([1 / 12, 1 / 12, 1e-3]))
    for k in range(n):
        builder.add_body(
            f"b{k:04d}", f"b{k - 1:04d}" if k else None, "revolute", (0, 1, 0) if k % 2 else (1, 0, 0),
            (0, 0, 1.0) if k else None, inertia,
        )  # fmt: skip
    return builder.build()


def chain_times(rounds: int) -> dict[str, Any]:
    """Microseconds of one untraced call against the number of joints, and the slope of the logarithms from 30 on."""
    lengths = (10, 30, 100, 300, 1000)
    times: dict[str, list[float]] = {"rnea": [], "aba": []}
    rng = np.random.default_rng(0)
    for n in lengths:
        model = chain(n)
        q, v, a = rng.normal(size=(3, n))
        runs = {
            "rnea": lambda model=model, x=(q, v, a): sd.rnea(model, *x),
            "aba": lambda model=model, x=(q, v, a): sd.aba(model, *x),
        }
        for name, seconds in interleaved(runs, rounds, 0.01).items():
            times[name].append(1e6 * seconds)
    slope = {k: float(np.polyfit(np.log(lengths[1:]), np.log(v[1:]), 1)[0]) for k, v in times.items()}
    return {"joints": list(lengths), **{f"{k}_us": v for k, v in times.items()}, "slope": slope}


FIRST = """
import time; start = time.perf_counter()
import spatialdyn as sd; imported = time.perf_counter()
import pickle, sys, warnings, numpy as np; warnings.simplefilter("ignore")
model = pickle.load(open(sys.argv[2], "rb")) if sys.argv[1] == "pickle" else sd.load_urdf(sys.argv[2])
sd.rnea(model, sd.neutral(model), np.zeros(model.nv), np.zeros(model.nv))
print(imported - start, time.perf_counter() - start)
"""


def starting(rounds: int) -> dict[str, float]:
    """Seconds of a fresh process with a warm cache: the import, and from its start to the first torque."""
    path = str(find_robot("panda"))
    with tempfile.TemporaryDirectory() as folder:
        pickled = Path(folder) / "model.pickle"
        pickled.write_bytes(pickle.dumps(sd.load_urdf(path)))
        taken: dict[str, list[float]] = {"import_s": [], "first_rnea_from_pickle_s": [], "first_rnea_from_urdf_s": []}
        for _ in range(rounds + 1):
            for way, source in (("pickle", pickled), ("urdf", path)):
                command = [sys.executable, "-c", FIRST, way, str(source)]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                imported, first = map(float, done.stdout.split())
                taken["import_s"].append(imported)
                taken[f"first_rnea_from_{way}_s"].append(first)
    return {name: float(np.median(values[2:])) for name, values in taken.items()}


def machine() -> dict[str, Any]:
    """What the figures were taken on."""
    return {
        "processor": numba.core.config.CPU_NAME or _cpu(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "pinocchio": pin.__version__,
    }


def _cpu() -> str:
    import llvmlite.binding as llvm

    return str(llvm.get_host_cpu_name())


def show(console: Console, results: dict[str, Any]) -> None:
    """The tables, losses included."""
    table = Table(title="one call, ratio = ours / Pinocchio from Python", title_justify="left")
    for heading in ("robot", "call", "ours µs", "pin µs", "ratio", "in jitted code µs", "ratio"):
        table.add_column(heading, justify="left" if heading in ("robot", "call") else "right")
    for robot, calls in results["single"].items():
        for name, t in calls.items():
            table.add_row(
                robot, name, f"{t['ours_us']:.2f}", f"{t['pin_us']:.2f}", f"{t['ratio']:.2f}",
                f"{t['jitted_us']:.2f}", f"{t['jitted_ratio']:.2f}",
            )  # fmt: skip
        table.add_section()
    console.print(table)
    table = Table(title="batches, one thread, given array, ratio = Pinocchio's pool / ours", title_justify="left")
    for heading in ("robot", "call", "ours ns", "pin ns", "ratio", "ours 2 threads ns", "pin 2 threads ns"):
        table.add_column(heading, justify="left" if heading in ("robot", "call") else "right")
    for robot, calls in results["batch"].items():
        for name, t in calls.items():
            table.add_row(
                robot, name, f"{t['ours_ns']:.1f}", f"{t['pin_ns']:.0f}", f"{t['ratio']:.1f}",
                f"{t['ours_2_threads_ns']:.1f}", f"{t['pin_2_threads_ns']:.0f}" if "pin_2_threads_ns" in t else "",
            )  # fmt: skip
        table.add_section()
    console.print(table)
    slope = results["chain"]["slope"]
    grows = ", ".join(f"n^{x:.2f} ({name})" for name, x in slope.items())
    console.print(f"chains of 30 to 1000 joints: time grows as {grows}")
    console.print("fresh process, warm cache: " + ", ".join(f"{k[:-2]} {v:.2f} s" for k, v in results["start"].items()))


def main() -> None:
    """Measure, assert, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds, well under 2 minutes")
    options = parser.parse_args()
    rounds, seconds = (7, 0.005) if options.quick else (21, 0.02)
    samples = 8192
    results = {
        "machine": machine(),
        "single": {robot: single_calls(robot, rounds, seconds) for robot in track(ROBOTS, "single calls")},
        "samples": samples,
        "batch": {
            f"{robot}, {root}": batch_calls(robot, root, samples, rounds) for robot, root in track(BATCHES, "batches")
        },
        "chain": chain_times(rounds),
        "start": starting(3 if options.quick else 7),
    }
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    show(Console(), results)


if __name__ == "__main__":
    main()
