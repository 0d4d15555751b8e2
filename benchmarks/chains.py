"""Chains of rods: time of a call against the number of joints, one engine at a time, and the slopes.

As a script: chains and trees of mixed joints. Prints nanoseconds of CPU time per row of a sample (crba: per entry of M
that is not zero) of the kernel of one sample, of the kernel on lanes, of the public call with its engine, of Pinocchio
from Python, and of a public call of one sample from Python; how many times faster than the kernel of one sample and
than Pinocchio the public call is, for a batch and for one sample; and the steps of both from the row before. Results
are compared with Pinocchio's before they are timed.

With --crossover: the kernel on lanes beside the program of the call, compiled for each length however long it is, with
the processor seconds of compiling it and the samples of batches after which it has saved them, with no disk cache
(``SPATIALDYN_CACHE_DIR=``). They set ``recording.most_rows``. The same of single calls: the kernel of one sample, the
program interpreted and compiled. With AVX2 alone: ``NUMBA_CPU_NAME=znver3 NUMBA_CPU_FEATURES=+avx2,+fma,+bmi,+bmi2``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import machine
import numpy as np
import pinocchio as pin
from cases import SCALED, Array, aligned, random_state
from measure import interleaved
from tables import number, plain

import spatialdyn as sd
from spatialdyn.engines import run
from spatialdyn.engines.compiled import entries, lane_kernels, lane_names, numba_kernels
from spatialdyn.engines.programs.llvm.call_words import ARRAY
from spatialdyn.engines.programs.run import single_call
from spatialdyn.engines.programs.run.tiered_program import TieredProgram
from spatialdyn.recursions import SPECS

LENGTHS = (10, 30, 100, 300, 1000)
FROM = 30  # joints: the slope is of chains this long or longer
HELD = 300  # joints: Pinocchio's longest chain, as its Data has several n³ tensors, 32 GB at 1000
SAMPLES = 512  # of a batch: the least that runs on lanes
ARGUMENTS = {"rnea": "qva", "aba": "qvt", "crba": "q"}
CROSSED = {**ARGUMENTS, "minverse": "q", "coriolis_matrix": "qv", "crba_solve": "qvt"}  # calls of --crossover
MIXED = (60, 100, 150, 300, 600, 1000)  # joints of chains and trees of mixed joints
KINDS = "revolute", "prismatic", "continuous", "spherical"
MIXED_SAMPLES, MOST_NUMBERS = 512, 1 << 24  # samples of a batch, but no more than so many results beyond 8 samples
SOLVED = 1e-6  # largest difference of lanes and programs, by the largest entry, of calls that solve: long chains' M
DIFFERENT = {"rnea": 1e-12, "crba": 1e-12, "coriolis_matrix": 1e-12} | dict.fromkeys(
    ("aba", "minverse", "crba_solve"), SOLVED
)
SQUARE = ("crba", "minverse", "coriolis_matrix")  # calls whose results are matrices
ALONE = ("pinocchio", "single")  # ways that compute one sample
ROD = (1.0, (0.0, 0.0, 0.5), np.diag([1 / 12, 1 / 12, 1e-3]))


def ours(n: int) -> sd.Model:
    """Rods end to end, joints about x and y in turn."""
    builder = sd.ModelBuilder(f"chain{n}")
    for k in range(n):
        parent, placement = (f"b{k - 1:04d}", (0, 0, 1.0)) if k else (None, None)
        builder.add_body(f"b{k:04d}", parent, "revolute", (0, 1, 0) if k % 2 else (1, 0, 0), placement, ROD)
    return builder.build()


def theirs(n: int) -> Any:
    """The same in Pinocchio."""
    model, mass_of = pin.Model(), pin.Inertia(ROD[0], np.array(ROD[1]), ROD[2])
    joint = 0
    for k in range(n):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0 if k else 0.0]))
        joint = model.addJoint(joint, pin.JointModelRY() if k % 2 else pin.JointModelRX(), place, f"b{k:04d}")
        model.appendBodyToJoint(joint, mass_of, pin.SE3.Identity())
    return model


def measured(rounds: int, tell: Any) -> dict[str, Any]:
    """Microseconds of one call, and per sample of a batch; ``slope`` of log time over log n from FROM joints on.

    untraced   one public call from Python, compiled: by the program or the table kernel
    batch      per sample of a batch of the public call, in the engine that ``batch_engine`` names for each length
    pinocchio  one call from Python, of chains whose Data fits into memory
    """
    times: dict[str, dict[str, list[float]]] = {}
    engines = []
    for n in LENGTHS:
        model = ours(n)
        for call, ways in _of_length(n, model, rounds).items():
            for way, value in ways.items():
                times.setdefault(call, {}).setdefault(way, []).append(value)
        engines.append(sd.specialize(model, sd.rnea).engine)
        tell()
    slope = {
        call: {way: _slope(values) for way, values in ways.items() if way != "batch"} for call, ways in times.items()
    }  # none of batches, whose engine changes with the length
    return {"joints": list(LENGTHS), "us": times, "slope": slope, "batch_engine": engines}


def _of_length(n: int, model: sd.Model, rounds: int) -> dict[str, dict[str, float]]:
    other = theirs(n) if n <= HELD else None
    data = None if other is None else other.createData()
    state = random_state(model, SAMPLES)
    found: dict[str, dict[str, float]] = {}
    for name, letters in ARGUMENTS.items():
        call, function = getattr(sd, name), getattr(pin, name)
        arguments = [state[letter] for letter in letters]
        one = [np.array(x[0]) for x in arguments]
        sd.compile(model, call)  # once for all models where there is no program
        runs = {"untraced": lambda call=call, one=one: call(model, *one)}
        if other is not None:
            runs["pinocchio"] = lambda function=function, one=one: function(other, data, *one)
            wanted = np.array(runs["pinocchio"]())
            error = abs(runs["untraced"]() - wanted).max() / max(1.0, abs(wanted).max())
            assert error <= SCALED, f"chain of {n}, {name}: scaled error {error:.1e} against Pinocchio"
        if name != "crba":  # 4 GB of M at 1000 joints
            sd.set_num_threads(1)
            out = aligned((SAMPLES, n))
            call(model, *arguments, out=out)
            error = abs(out[0] - runs["untraced"]()).max() / abs(out[0]).max()
            assert error <= SCALED, f"chain of {n}, {name}: a sample of a batch differs by {error:.1e} from it alone"
            runs["batch"] = lambda call=call, x=arguments, out=out: call(model, *x, out=out)
        times = interleaved(runs, rounds, 0.01)
        found[name] = {way: 1e6 * t / (SAMPLES if way == "batch" else 1) for way, t in times.items()}
    return found


def _slope(values: list[float]) -> float:
    """Slope of log time over log n from FROM joints on."""
    x, y = np.log([(n, t) for n, t in zip(LENGTHS, values, strict=False) if n >= FROM]).T
    return float(np.polyfit(x, y, 1)[0])


# --- chains and trees of mixed joints ---------------------------------------------------------------------


class Pair(NamedTuple):
    """A model here and in Pinocchio, if its Data fits into memory there."""

    ours: sd.Model
    theirs: Any


def mixed(n: int, branching: float) -> Pair:
    """So many bodies on seeded random joints, depth first; ``branching``: the chance to hang higher than the last."""
    rng = np.random.default_rng(n)
    builder, model, line = sd.ModelBuilder(f"mixed{n}"), pin.Model(), [-1]
    mass_of = pin.Inertia(ROD[0], np.array(ROD[1]), ROD[2])
    for k in range(n):
        while len(line) > 1 and rng.random() < branching:
            line.pop()
        kind, axis = KINDS[rng.integers(len(KINDS))], rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = turn * np.sign(np.linalg.det(turn)), (0.0, 0.0, 1.0)
        parent = f"b{line[-1]:04d}" if line[-1] >= 0 else None
        builder.add_body(f"b{k:04d}", parent, kind, (0, 0, 1) if kind == "spherical" else axis, X, ROD)
        joint = (
            pin.JointModelSpherical() if kind == "spherical"
            else pin.JointModelPrismaticUnaligned(axis) if kind == "prismatic"
            else pin.JointModelRevoluteUnaligned(axis)
        )  # fmt: skip
        at = model.addJoint(line[-1] + 1, joint, pin.SE3(X), f"b{k:04d}")
        model.appendBodyToJoint(at, mass_of, pin.SE3.Identity())
        line.append(k)
    return Pair(builder.build(), model if n <= HELD else None)


def ways_of(pair: Pair, call: str) -> tuple[dict[str, Callable[[], Any]], int, str]:
    """Functions that compute a batch, in ALONE a sample; the samples; and the engine of the public call."""
    model, other = pair
    wide = model.nv ** (1 + (call == "crba"))
    count = max(8, min(MIXED_SAMPLES, MOST_NUMBERS // wide))
    state = random_state(model, count)
    arguments = [state[letter] for letter in ARGUMENTS[call]]
    spec = numba_kernels.variant(SPECS[call], ())
    outs = {way: aligned((count, *[model.nv] * (1 + (call == "crba")))) for way in ("table", "lanes", "call")}
    kernels = {"table": numba_kernels.batch_kernel(spec), "lanes": lane_kernels.kernel(spec, lane_names.width())}
    known = [y for x in arguments for y in (x, 1)]
    status = np.empty(count, np.int8)
    found: dict[str, Callable[[], Any]] = {
        way: partial(kernel, model.address, count, *known, outs[way], status) for way, kernel in kernels.items()
    }
    public = getattr(sd, call)
    sd.compile(model, public)
    found["call"] = lambda: public(model, *arguments, out=outs["call"])
    first = [np.array(x[0]) for x in arguments]
    found["single"] = lambda: public(model, *first)
    if found["lanes"]() < 0:  # no room
        del found["lanes"], outs["lanes"]
    for compute in found.values():
        compute()
    np.testing.assert_array_equal(outs.get("lanes", outs["table"]), outs["table"])
    np.testing.assert_array_equal(found["single"](), outs["call"][0])
    if other is not None:
        data, function = other.createData(), getattr(pin, call)
        found["pinocchio"] = lambda: function(other, data, *first)
        for way, out in outs.items():
            error = _error(call, pair, first, out[0])
            assert error <= SCALED, f"{model.name}, {call}: scaled error {error:.1e} of {way} against Pinocchio"
    return found, count, "lanes" if run.program(spec, model, ()) is None else "program"


def _error(call: str, pair: Pair, one: list[Array], found: Array) -> float:
    """Scaled error of one sample against Pinocchio; of aba, whose M is badly conditioned, that of its torques."""
    model, data = pair.theirs, pair.theirs.createData()
    if call == "aba":
        q, v, tau = one
        M = pin.crba(model, data, q)
        scale = (abs(np.triu(M) + np.triu(M, 1).T) @ abs(found)).max()
        return float(abs(pin.rnea(model, data, q, v, found) - tau).max() / scale)
    wanted = np.array(getattr(pin, call)(model, data, *one))
    wanted = np.triu(wanted) + np.triu(wanted, 1).T if call == "crba" else wanted
    return float(abs(found - wanted).max() / abs(wanted).max())


def of_mixed(lengths: list[int], calls: list[str], rounds: int) -> list[list[str]]:
    """A row of the table for each shape, call and length."""
    rows = []
    for shape, branching in (("chain", 0.0), ("tree", 0.3)):
        last: dict[tuple[str, str], float] = {}
        for n in lengths:
            pair = mixed(n, branching)
            for call in calls:
                ways, count, engine = ways_of(pair, call)
                unit = np.count_nonzero(sd.crba(pair.ours, sd.neutral(pair.ours))) if call == "crba" else pair.ours.nv
                times = interleaved(ways, rounds, 0.02, time.thread_time)
                ns = {way: 1e9 * t / unit / (1 if way in ALONE else count) for way, t in times.items()}
                others = [ns["pinocchio"] / ns[way] if "pinocchio" in ns else None for way in ("call", "single")]
                steps = [ns[way] / last[call, way] if (call, way) in last else None for way in ("call", "single")]
                last |= {(call, way): ns[way] for way in ("call", "single")}
                cells = [ns.get(way) for way in ("table", "lanes", "call", "pinocchio", "single")]
                cells += [ns["table"] / ns["call"], *others, *steps]
                rows.append([f"{shape} {n}", str(pair.ours.nv), call, engine, *(number(x, 2) for x in cells)])
                print(*(x.ljust(10) for x in rows[-1]), flush=True)
    return rows


def crossover(lengths: list[int], calls: list[str], rounds: int) -> list[list[str]]:
    """A row of the table of programs beside lanes for each call and length of chains of mixed joints."""
    rows = []
    for call in calls:
        for n in lengths:
            model = mixed(n, 0.0).ours
            state = random_state(model, MIXED_SAMPLES)
            arguments = tuple(state[letter] for letter in CROSSED[call])
            spec, status = numba_kernels.variant(SPECS[call], ()), np.empty(MIXED_SAMPLES, np.int8)
            found = {
                way: aligned((MIXED_SAMPLES, *[model.nv] * (1 + (call in SQUARE)))) for way in ("lanes", "program")
            }
            known = [y for x in arguments for y in (x, 1)]
            lanes = lane_kernels.kernel(spec, lane_names.width())
            start = time.process_time()
            tiered = TieredProgram((spec,), model.bodies, model.key)
            tiered.compiled(one=False)
            seconds = time.process_time() - start
            alone = of_one(model, spec, [np.array(x[0]) for x in arguments], tiered)
            program = run.CallProgram(spec, model, (), tiered)
            ways: dict[str, Callable[[], Any]] = {
                "lanes": partial(lanes, model.address, MIXED_SAMPLES, *known, found["lanes"], status),
                "program": partial(program, arguments, found["program"].reshape(MIXED_SAMPLES, -1)),
            }
            for compute in ways.values():
                compute()
            scale = abs(found["lanes"]).max()
            assert abs(found["program"] - found["lanes"]).max() <= DIFFERENT[call] * scale, f"{model.name}, {call}"
            one = interleaved(alone, rounds, 0.02, time.thread_time)
            times = interleaved(ways, rounds, 0.02, time.thread_time)
            saved = (times["lanes"] - times["program"]) / MIXED_SAMPLES
            unit = 1e9 / MIXED_SAMPLES / model.nv
            cells = times["lanes"] * unit, times["program"] * unit, times["lanes"] / times["program"], seconds
            paid = number(seconds / saved / 1e6, 2) if saved > 0.0 else "never"
            row = [f"chain {n}", str(model.nv), call, str(tiered.interpreted.lines)]
            row += [*(number(x, 2) for x in cells), paid, *(number(1e9 * t / model.nv, 2) for t in one.values())]
            print(*(x.ljust(10) for x in row), flush=True)
            rows.append(row)
    return rows


def of_one(model: sd.Model, spec: Any, one: list[Array], tiered: TieredProgram) -> dict[str, Callable[[], Any]]:
    """Functions that compute one sample: the kernel of one sample, and the program, interpreted and compiled."""
    entry = entries.sample_entry(spec)
    entry.compile_now()
    context, code, counter = entries.context_of(model), tiered.interpreted, np.array([1 << 62])
    made = tiered.compiled(one=True)
    codes = {
        "single": (entry.words(context.ctypes.data), context),
        "interpreted": ((code.entry, code.context, counter.ctypes.data), (code, counter)),
        "compiled": ((made.code.entry, made.numbers.ctypes.data, single_call.NO_LIMIT.ctypes.data), made),
    }
    shapes, names = [x.shape for x in one], [x.name for x in spec.present]
    found: dict[str, Callable[[], Any]] = {}
    for way, (words, alive) in codes.items():
        plan = single_call.plan(words, [(model.nv,) * (1 + (spec.name in SQUARE))], shapes, alive=alive)
        call = single_call.bound(refused, [single_call.Parameter(name, ARRAY) for name in names], plan)
        found[way] = lambda call=call: call(*one)
    wanted = found["single"]()
    for way, compute in found.items():
        error = abs(compute() - wanted).max() / abs(wanted).max()
        assert error <= DIFFERENT[spec.name], f"{model.name}, {spec.name}: {way} differs by {error:.1e}"
    return found


def refused(*given: Any) -> None:
    """Raise: a timed call must not go on to Python."""
    raise AssertionError(f"the compiled code refused {len(given)} inputs")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", type=int, nargs="*", default=list(MIXED), help="numbers of bodies")
    parser.add_argument("--calls", nargs="*", default=list(ARGUMENTS), choices=tuple(CROSSED))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--crossover", action="store_true", help="programs of any length beside lanes")
    given = parser.parse_args()
    sd.set_num_threads(1)
    if given.crossover:
        headings = ["bodies", "rows", "call", "lines", "lanes", "program", "x lanes", "compile s", "paid by M samples"]
        headings += ["single", "interpreted", "compiled"]
        title = f"ns of CPU time a row of one sample; one thread of {machine.machine()['processor']}"
        print(plain(title, headings, crossover(given.lengths, given.calls, given.rounds)))
        return
    headings = [
        "bodies",
        "rows",
        "call",
        "engine",
        "table",
        "lanes",
        "call",
        "pinocchio",
        "single",
        "x table",
        "x pinocchio",
        "x single",
        "step",
        "step of one",
    ]
    title = f"ns of CPU time a row of one sample, crba: an entry; one thread of {machine.machine()['processor']}"
    print(plain(title, headings, of_mixed(given.lengths, given.calls, given.rounds)))


if __name__ == "__main__":
    main()
