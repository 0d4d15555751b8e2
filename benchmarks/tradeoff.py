"""Errors and costs of forward dynamics by every option, of motions by every integrator; and a test of ``recommend``.

    python benchmarks/tradeoff.py [--quick] [--only evaluations,motions,promise,samples,requires] [--models '2R;panda']
                                  [--seconds 8] [--out DIRECTORY]

evaluations  ``sd.trade`` of forward dynamics on 2R, panda, anymal, talos and four extreme models
motions      1 s: largest error of the state against Gauss collocation of order 32 in double-double; 1, 100 and 2000 s:
             largest change of energy over the largest kinetic energy, and the cost of a simulated second. No arithmetic
             computes a state after 100 s of a chaotic motion, so it has no error. Floating bases move without gravity.
             Runs longer than --seconds are left out
promise      10 models, 3 tasks, 5 tolerances: whether the recommended option meets its tolerance on fresh states, and
             how much faster any other option is that meets it too: those whose bound is within the tolerance, and those
             whose error happens to be; of the latter, the share of 65536 other states in which they do not

samples      a million states of ur5 and panda, three calls, five tolerances: each answer of ``specialize(tolerance=)``
             against double-double, how many went which way, and what it costs beside float32 and float64 without bounds
requires     ``sd.requires`` of a panda that lifts a payload: the scene of the example ``what_a_scene_requires``

Writes tradeoff.json, tradeoff.png (for the README), tradeoff_evaluations.png, tradeoff_robots.png and
tradeoff_extremes.png; parts that are not run keep their results in the file.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measure import interleaved

import spatialdyn as sd
from spatialdyn.accuracy import call_errors, integrator_errors, references
from spatialdyn.accuracy.reference_motion import exact_motion
from spatialdyn.accuracy.requirement import Part
from spatialdyn.accuracy.tradeoff import advice
from spatialdyn.examples import what_a_scene_requires
from spatialdyn.pictures import figures
from spatialdyn.pictures.requirement_plots import draw_parts
from spatialdyn.pictures.tradeoff_plots import draw_front, outermost_first, real_time, short

HERE = Path(__file__).parent
ANYMAL = "anymal_b_simple_description/robots/anymal"
METHODS = (
    "semi_implicit_euler",
    "velocity_verlet",
    "rk4",
    "stormer_verlet",
    "variational",
    "gauss4",
    "gauss6",
    "dop853",
)
HORIZONS = {1.0: 80, 100.0: 2500, 2000.0: 50_000}  # seconds: steps of the coarsest run, 1/80 s, 1/25 s and again
FINER = 4
SAMPLES = 400  # recorded energies
RTOL = (1e-6, 1e-9, 1e-12)
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-12)
FRESH = 1000
MILLION = 1_000_000
PER_SAMPLE = {"inverse_dynamics": "rnea", "mass_matrix": "crba", "forward_dynamics": "aba"}


# --- models -------------------------------------------------------------------------------------------------


def rods(masses: list[float], size: float = 1.0) -> sd.Model:
    """Rods end to end, hinges about x and y in turn; size [m] of one."""
    builder = sd.ModelBuilder("rods")
    for k, m in enumerate(masses):
        parent, placement = (f"b{k - 1:03d}", (0.0, 0.0, size)) if k else (None, None)
        I = m * size**2 * np.diag([1 / 12, 1 / 12, 1e-3])
        axis = (0, 1, 0) if k % 2 else (1, 0, 0)
        builder.add_body(f"b{k:03d}", parent, "revolute", axis, placement, (m, (0.0, 0.0, 0.5 * size), I))
    return builder.build()


def load(name: str, **options: Any) -> sd.Model:
    """A robot, without warnings about its inertias."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sd.load_urdf(name, **options)


def panda() -> sd.Model:
    """panda without its fingers, which would slide off to infinity on their rails."""
    return load("panda").reduced(lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})


ROBOTS: dict[str, Callable[[], sd.Model]] = {
    "2R": lambda: load("two_link"),
    "panda": panda,
    "anymal": lambda: load(ANYMAL, root="floating"),
    "talos": lambda: load("talos_full"),
}
EXTREMES: dict[str, Callable[[], sd.Model]] = {
    "7 rods, tip 1e6": lambda: rods([1.0] * 6 + [1e6]),
    "7 rods, tip 1e12": lambda: rods([1.0] * 6 + [1e12]),
    "chain of 30": lambda: rods([1.0] * 30),
    "6 rods of 1 mm, 1 mg": lambda: rods([1e-6] * 6, 1e-3),
}
# Seconds in which these move as far as the others in 1 s: light links under a heavy tip, and small ones, are fast.
SECOND = {"7 rods, tip 1e6": 1e-3, "7 rods, tip 1e12": 1e-6, "6 rods of 1 mm, 1 mg": 0.03}
PROMISED: dict[str, Callable[[], sd.Model]] = {
    **{name: ROBOTS[name] for name in ("2R", "panda", "anymal")},
    "ur5": lambda: load("ur5"),
    "solo": lambda: load("solo12", root="floating"),
    **EXTREMES,
    "light and heavy": lambda: rods([1.0, 1e-4] * 3),
}


# --- measurements -------------------------------------------------------------------------------------------


def of_evaluations(quick: bool) -> dict[str, Any]:
    """``trade`` of each model."""
    found = {}
    for name, make in {**ROBOTS, **EXTREMES}.items():
        model = make()
        made = sd.trade(model, states=128 if quick else None, methods=WAYS)
        found[name] = {"nv": model.nv, **made.to_dict()}
        print(f"\n{name}\n{made}", flush=True)
    return found


def of_motions(quick: bool, seconds: float, names: list[str], found: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Cost and error of integrators: a list of runs per model, added to those found."""
    horizons = {1.0: 80, 10.0: 250} if quick else HORIZONS
    for name, make in {**ROBOTS, **EXTREMES}.items():
        if name not in names:
            continue
        model = make()
        floats = any(joint.nv == 6 for joint in model.joints[1:])
        if floats:
            model = model.with_(gravity=(0.0, 0.0, 0.0))
        rng = np.random.default_rng(0)
        q0 = sd.random_configuration(model, rng)
        v0 = rng.normal(size=model.nv) if floats else np.zeros(model.nv)
        began, second = time.perf_counter(), SECOND.get(name, 1.0)
        truth = exact_motion(model, q0[None], v0[None], np.linspace(0.0, second, integrator_errors.SAMPLES + 1))
        spent, certain = time.perf_counter() - began, truth.error.max()
        print(f"\n{name}: truth of {second:g} s in {spent:.1f} s, certain to {certain:.0e}")
        rows = []
        for duration, steps in horizons.items():
            for method in METHODS:
                _warm(model, q0, v0, method)
                wanted = truth if duration == 1.0 else None
                made = list(_runs(model, q0, v0, duration * second, steps, method, wanted, seconds))
                rows += made
                print(*(_line(row) for row in made[-1:]), flush=True)
        found[name] = {"certainty": float(truth.error.max()), "runs": rows}
        yield {name: found[name] for name in (*ROBOTS, *EXTREMES) if name in found}


def _warm(model: sd.Model, q0: Any, v0: Any, method: str) -> None:
    """Compile what a method needs."""
    with warnings.catch_warnings(), contextlib.suppress(sd.SpatialDynError):
        warnings.simplefilter("ignore")
        sd.simulate(model, q0, v0, 2e-9, 1e-9, method)


def _runs(
    model: sd.Model, q0: Any, v0: Any, duration: float, steps: int, method: str, truth: Any, seconds: float
) -> Iterator[dict[str, Any]]:
    """A method at finer and finer steps or tolerances, while the expected time of a run is within ``seconds``."""
    adaptive = sd.integrators[method].family is None
    last = 0.0
    for k in range(6):
        if adaptive and k == len(RTOL):
            return
        dt = duration / integrator_errors.SAMPLES if adaptive else duration / steps / FINER**k
        words = {"rtol": RTOL[k], "atol": 1e-3 * RTOL[k], "dt": duration / SAMPLES} if adaptive else {"dt": dt}
        if not k and truth is None and _expected(model, q0, v0, duration, method, words) * duration > seconds:
            return
        row = _run(model, q0, v0, duration, method, words, truth, 2.0 * seconds)
        yield row
        last = row["seconds"]
        if last * (2 if adaptive else FINER) > (seconds if truth is None else min(seconds, 1.0)):
            return


def _expected(model: sd.Model, q0: Any, v0: Any, duration: float, method: str, words: dict[str, Any]) -> float:
    """Expected seconds per simulated second."""
    row = _run(model, q0, v0, 50 * words["dt"] if "rtol" not in words else duration / 100, method, words, None)
    return float(row["seconds"] / row["duration"])


def _run(
    model: sd.Model, q0: Any, v0: Any, duration: float, method: str, words: Any, truth: Any, limit: float = 10.0
) -> dict[str, Any]:  # fmt: skip
    """One run: its cost, errors of energy and state, and its failure if any."""
    count = max(1, round(duration / words["dt"]))
    samples = integrator_errors.SAMPLES if truth is not None else SAMPLES
    words = {**words, "dt": duration / samples} if "rtol" in words else words
    record = max(1, (samples if "rtol" in words else count) // samples)
    row: dict[str, Any] = {"method": method, "duration": duration, **words, "note": ""}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        began = time.process_time()

        def watch(done: int, total: int) -> None:
            if time.process_time() - began > limit:
                raise TimeoutError

        try:
            run = sd.simulate(model, q0, v0, duration, method=method, record=record, progress=watch, **words)
        except TimeoutError:
            return {**row, "seconds": limit, "energy": None, "state": None, "note": f"stopped after {limit:g} s"}
        except sd.SimulationError as error:
            run, row["note"] = error.trajectory, str(error)
        except sd.SpatialDynError as error:
            return {**row, "seconds": time.process_time() - began, "energy": None, "state": None, "note": str(error)}
    row["seconds"] = time.process_time() - began
    row["ns"] = 1e9 * row["seconds"] / duration
    row["energy"] = row["state"] = None
    if not row["note"]:
        try:
            kinetic = np.asarray(sd.kinetic_energy(model, run.q, run.v))
            row["energy"] = _finite(float(abs(run.energy - run.energy[0]).max() / kinetic.max()))
            row["state"] = None if truth is None else _finite(integrator_errors.motion_error(model, run, truth, 0))
        except sd.NonFiniteError as error:  # the state is near overflow
            row["note"] = str(error)
    return row


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None


def _line(row: dict[str, Any]) -> str:
    words = f"rtol {row['rtol']:g}" if "rtol" in row else f"dt {row['dt']:.2g}"
    energy, state = (f"{row[k]:.1e}" if row.get(k) is not None else "-" for k in ("energy", "state"))
    line = f"{row['duration']:>6g} s  {row['method']:<20}{words:<12} energy {energy:<9} state {state:<9}"
    return f"{line}{row['seconds']:.2f} s"


def of_promises(quick: bool) -> dict[str, Any]:
    """Recommended options, tested on fresh states."""
    rows: list[dict[str, Any]] = []
    broken = slower = luck = 0
    for name, make in list(PROMISED.items())[: 3 if quick else None]:
        model = make()
        for task in call_errors.TASK_CALLS:
            found = sd.trade(model, task)
            first = call_errors.TASK_CALLS[task][0]
            fresh = call_errors.random_call_states(model, task, FRESH, seed=1)
            truth, _ = references.truths(model, first, fresh)
            wrong: dict[str, float] = {}
            for x in found.options:
                assert x.run is not None
                try:
                    wrong[x.name] = float(references.of_calls(first, np.asarray(x.run(*fresh)), truth).max())
                except sd.SpatialDynError:  # a pivot that float32 has lost
                    wrong[x.name] = math.inf
            again = {x.name: x.ns for x in sd.trade(model, task, states=32).options}
            for tolerance in TOLERANCES:
                try:
                    chosen = advice(found, tolerance).option
                except sd.SpatialDynError:
                    rows.append({"model": name, "task": task, "tolerance": tolerance, "way": None})
                    continue
                promised = {x.name: again[x.name] for x in found.options if x.bound <= tolerance}
                lucky = {x.name: again[x.name] for x in found.options if wrong[x.name] <= tolerance}
                row: dict[str, Any] = {
                    "model": name, "task": task, "tolerance": tolerance, "way": chosen.name, "bound": chosen.bound,
                    "error": wrong[chosen.name], "slower": again[chosen.name] / min(promised.values()),
                    "slower_than_lucky": again[chosen.name] / min(lucky.values(), default=math.nan),
                    "states": chosen.states or found.states, "chance": None,
                }  # fmt: skip
                if row["slower_than_lucky"] > 1.3:  # of the cheapest such way
                    luckiest = min(lucky, key=lambda x: lucky[x])
                    way = next(x for x in found.options if x.name == luckiest)
                    row["chance"] = _beyond(model, task, way, tolerance)
                    print(f"  {task} to {tolerance:g}: {luckiest} is beyond it in {row['chance']:.1e} of states")
                rows.append(row)
                broken += not row["error"] <= tolerance
                slower += row["slower"] > 1.3
                luck += row["slower_than_lucky"] > 1.3
        print(
            f"{name}: {broken} broken, {slower} slower than 1.3 times another so far, {luck} than a lucky one",
            flush=True,
        )
    kept = sum(row["way"] is not None for row in rows)
    print(
        f"{kept} recommendations of {len(rows)} asked for: {broken} broken, {slower} slower, {luck} slower than a lucky"
    )
    return {"rows": rows, "recommended": kept, "broken": broken, "slower": slower, "slower_than_lucky": luck}


def of_samples(quick: bool) -> dict[str, Any]:
    """Precision per sample: the promise, the ways and the costs. Ends the run if an error is above its tolerance."""
    rows: list[dict[str, Any]] = []
    robots = {"ur5": lambda: load("ur5"), "panda": panda}
    count = 500 if quick else -(-MILLION // (len(robots) * len(PER_SAMPLE) * len(TOLERANCES)))
    for name, make in robots.items():
        model = make()
        for task, call in PER_SAMPLE.items():
            given = call_errors.random_call_states(model, task, count, seed=3)
            program, _ = references.recorded_call(model, call)
            high, low = (x.T for x in program(np.ascontiguousarray(np.concatenate(given, axis=1).T)))
            largest = abs(high).max(axis=1)
            timed = [x[:4096] for x in given]
            function = getattr(sd, call)
            ways: dict[str, Callable[..., Any]] = {
                "float32": sd.specialize(model, function, dtype=np.float32),
                "float64": sd.specialize(model, function), "float64 bounded": sd.bounded(model, function),
                "from float64": sd.specialize(model, function, tolerance=1e-9),
            }  # fmt: skip
            promises = {f"{x:g}": sd.specialize(model, function, dtype=np.float32, tolerance=x) for x in TOLERANCES}
            for word, k in promises.items():
                found = k(*given).reshape(count, -1)
                worst = float((abs((found - high) - low).max(axis=1) / largest).max())
                if not worst <= float(word):
                    raise SystemExit(f"{call} of {name} within {word}: an error of {worst:.1e}")
                rows.append({"model": name, "call": call, "tolerance": float(word), "samples": count,
                             "ways": k.report, "error": worst})  # fmt: skip
            runs = {x: partial(k, *timed) for x, k in {**ways, **promises}.items()}
            narrow = [x.astype(np.float32) for x in timed]
            runs["float32"] = partial(ways["float32"], *narrow)
            ns = {x: 1e9 * y / len(timed[0]) for x, y in interleaved(runs, 3 if quick else 15, 0.02).items()}
            for row in rows[-len(TOLERANCES) :]:
                row["ns"] = ns[f"{row['tolerance']:g}"]
                row |= {x: ns[x] for x in ways}
                shares = ", ".join(f"{100 * n / count:.3g} % {way}" for way, n in row["ways"].items() if n)
                print(
                    f"{name} {call} within {row['tolerance']:g}: {shares}; true error up to {row['error']:.1e}; "
                    f"{row['ns']:.0f} ns (float32 {ns['float32']:.0f}, float64 {ns['float64']:.0f}, with its bound "
                    f"{ns['float64 bounded']:.0f}, judged {ns['from float64']:.0f})", flush=True,
                )  # fmt: skip
    print(f"{count * len(rows)} samples, each within its tolerance")
    return {"rows": rows, "samples": count * len(rows)}


def of_requirement(quick: bool) -> dict[str, Any]:
    """Which parts of its scene a panda that lifts a payload needs."""
    found = what_a_scene_requires.main(quick=quick)
    return found.to_dict()


def parts(rows: list[dict[str, Any]]) -> list[Part]:
    """Rows of a kept Requirement, with infinite changes and costs that were not measured."""
    absent: dict[str, Any] = {"change": math.inf, "ns": math.nan, "saved": math.nan}
    filled: list[dict[str, Any]] = [{name: absent.get(name) if x is None else x for name, x in y.items()} for y in rows]
    return [Part(**row) for row in filled]


def _beyond(model: sd.Model, task: str, way: sd.Option, tolerance: float) -> float:
    """The share of MANY fresh states in which the error of an option exceeds a tolerance."""
    first, bad, many = call_errors.TASK_CALLS[task][0], 0, 0
    assert way.run is not None
    for k in range(references.MANY // 4096):
        fresh = call_errors.random_call_states(model, task, 4096, [2, k])
        truth, _ = references.truths(model, first, fresh, 0)
        bad += int((references.of_calls(first, np.asarray(way.run(*fresh)), truth) > tolerance).sum())
        many += len(truth)
    return bad / many


# --- figures ------------------------------------------------------------------------------------------------

WAYS = ("aba", "crba_solve", "aba_refined", "aba_square_root", "extended")
COLOURS = {**dict(zip((*WAYS[:4], *METHODS), figures.COLOURS, strict=True)), "extended": "black"}
MARKS = {"lanes float32": "v", "lanes float64": "o", "untraced float64": "s"}
SYMBOLS = dict(zip(METHODS, "osD^vPX*", strict=True))
FLOOR = 1e-17
SPAN = 100.0  # the least ratio of the ends of an axis of costs


def ways_panel(axes: Any, found: dict[str, Any], title: str) -> None:
    """Error against the cost per sample, and the front."""
    figures.tidy(axes)
    for x in found["options"]:
        engine, _, call = x["name"].rpartition(" ")
        if x["error"] is not None and x["ns"] is not None:
            axes.plot(
                x["ns"], max(x["error"], FLOOR), MARKS[engine], color=COLOURS[call],
                mec="black" if x["best"] else "none",
            )  # fmt: skip
    draw_front(axes, [(x["ns"], x["error"]) for x in found["options"] if x["best"] and x["error"] is not None])
    axes.set(xscale="log", yscale="log", title=title)
    wide_enough(axes)


def runs_panel(axes: Any, rows: list[dict[str, Any]], key: str, title: str) -> list[tuple[float, float, str, Any]]:
    """Error against ms of computing for a second of motion, a line for each method; the labels of its steps."""
    figures.tidy(axes)
    labels = []
    for method in METHODS:
        here = [row for row in rows if row["method"] == method and row.get(key) is not None]
        if here:
            x, y = [1e-6 * row["ns"] for row in here], [max(row[key], FLOOR) for row in here]
            line = "-" if len(here) > 1 else ""
            axes.plot(x, y, marker=SYMBOLS[method], ms=4.5, lw=1.0, ls=line, color=COLOURS[method], label=method)
            steps = [short(row["rtol"] if "rtol" in row else row["dt"]) for row in here]
            labels += list(zip(x, y, steps, [COLOURS[method]] * len(here), strict=True))
    axes.set(xscale="log", yscale="log", title=title, ylim=(1e-16, 10.0))
    wide_enough(axes)
    return labels


def wide_enough(axes: Any) -> None:
    """Powers of ten at the ticks, two of them at least in costs."""
    low, high = axes.get_xlim()
    more = max(1.0, SPAN / (high / low)) ** 0.5
    axes.set_xlim(low / more, high * more)
    figures.log_ticks(axes.xaxis)
    figures.log_ticks(axes.yaxis)


def legends(figure: Any, kind: str) -> None:
    """A legend below the panels."""
    from matplotlib.lines import Line2D

    front = Line2D([], [], ls=(0, (1, 1.5)), lw=2, color=figures.FAINT, label="front")
    if kind == "ways":
        made = [Line2D([], [], marker=m, ls="", color="0.4", label=name) for name, m in MARKS.items()]
        made += [Line2D([], [], marker="o", ls="", color=COLOURS[name], label=name) for name in WAYS]
        made.append(front)
    else:
        made = [
            Line2D([], [], marker=SYMBOLS[name], ms=4.5, lw=1.0, color=COLOURS[name], label=name) for name in METHODS
        ]
    figure.legend(handles=made, loc="outside lower center", ncols=8, fontsize="small", frameon=False)


def draw(results: dict[str, Any], out: Path) -> list[Path]:
    """All figures with results."""
    written = []
    ways, runs = results.get("evaluations"), results.get("motions")
    if ways:
        written.append(_saved(all_ways(ways), out / "tradeoff_evaluations.png"))
    for label, group in (("robots", ROBOTS), ("extremes", EXTREMES)):
        chosen = {name: runs[name] for name in group if name in runs} if runs else {}
        if chosen:
            written.append(_saved(all_runs(chosen), out / f"tradeoff_{label}.png"))
    if ways and runs:
        whole = of_panda(ways["panda"], runs["panda"]["runs"], results.get("requires"))
        written.append(_saved(whole, out / "tradeoff.png"))
    return written


def all_ways(ways: dict[str, Any]) -> Any:
    """Forward dynamics of every model, four panels a row."""
    across = min(4, len(ways))
    down = -(-len(ways) // across)
    figure = figures.new_figure(15, 3.6 * down + 0.6)
    cells = figure.add_gridspec(down, across)
    for k, (name, found) in enumerate(ways.items()):
        axes = figure.add_subplot(cells[divmod(k, across)])
        ways_panel(axes, found, f"{name}, {found['nv']} freedoms")
        axes.set_ylim(1e-16, 100.0)
        if k + across >= len(ways):
            axes.set_xlabel("ns a sample")
        if k % across == 0:
            axes.set_ylabel("largest error / largest acceleration")
    states = next(iter(ways.values()))["states"]
    figure.suptitle(f"Forward dynamics: error against cost, of {states} random states")
    legends(figure, "ways")
    return figure


def all_runs(runs: dict[str, Any]) -> Any:
    """Motions, a column for each model, from short to long ones; words where no run of a length is left."""
    count = max(len({row["duration"] for row in found["runs"]}) for found in runs.values())
    figure = figures.new_figure(1.5 + 3.5 * len(runs), 3.2 * (count + 1) + 0.4)
    panels = figure.subplots(count + 1, len(runs), squeeze=False)
    for column, (name, found) in zip(panels.T, runs.items(), strict=True):
        rows = found["runs"]
        horizons = sorted({row["duration"] for row in rows})
        shown = [("state", horizons[0]), *(("energy", duration) for duration in horizons)]
        for axes, (key, duration) in zip(column, shown, strict=True):
            here = [row for row in rows if row["duration"] == duration]
            title = f"{name}: {key}, {duration:g} s"
            if any(row.get(key) is not None for row in here):
                runs_panel(axes, here, key, title)
                axes.set_xlabel("ms of computing for 1 s of motion", fontsize="small")
            else:
                axes.axis("off")
                words = f"{title}\n\nevery run diverges,\nor takes too long to be tried"
                axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, color="0.35")
    for axes, what in zip(panels[:, 0], ["state"] + ["energy"] * count, strict=True):
        axes.set_ylabel(f"largest relative error of {what}")
    legends(figure, "runs")
    return figure


def of_panda(ways: dict[str, Any], runs: list[dict[str, Any]], required: dict[str, Any] | None = None) -> Any:
    """Forward dynamics of a batch, and a second of motion, of one robot: the fronts, the steps, real time.

    required  what a scene requires, drawn below both if it is given
    """
    figure = figures.new_figure(13.5, 6.0 if required is None else 11.5)
    if required is None:
        left, right = figure.subplots(1, 2)
    else:
        (left, right), (below, free) = figure.subplots(2, 2)
        grid = below.get_gridspec()
        free.remove()
        below.remove()
        below = figure.add_subplot(grid[1, :])
        title = f"panda: what lifting 2 kg for {required['horizon']:g} s requires, within {required['tolerance']:g} rad"
        rows, path = parts(required["rows"]), parts(required["path"])
        draw_parts(below, rows, path, required["tolerance"], title, "q [rad | m]")
    ways_panel(left, ways, "panda: forward dynamics of a batch\n")
    left.set(xlabel="ns a sample", ylabel="largest error / largest acceleration", ylim=(1e-16, 1e-3))
    left.set_xlim(right=12 * max(x["ns"] for x in ways["options"]))
    words = []
    for x in ways["options"]:
        engine, _, call = x["name"].rpartition(" ")
        kind = ", float32" if "32" in engine else ", untraced" if engine.startswith("untraced") else ""
        if x["error"] is not None:
            words.append((x["ns"], x["error"], call + kind, COLOURS[call]))
    figures.place_labels(left, words, size=8.0)
    rows = [row for row in runs if row["duration"] == 1.0]
    steps = runs_panel(right, rows, "state", "panda: a second of free motion")
    right.set(xlabel="ms of computing for a second of motion", ylabel="largest relative error of q and v")
    real_time(right)
    draw_front(right, front_of([(1e-6 * row["ns"], row["state"]) for row in rows if row["state"] is not None]))
    right.legend(
        loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False,
        title="labels: step dt [s],\nrtol of dop853\ndotted: the front", title_fontsize="small",
    )  # fmt: skip
    figures.place_labels(right, outermost_first(steps, len(METHODS)), size=6.5)
    return figure


def front_of(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Points (cost, error) of which none is both cheaper and more accurate, by cost."""
    kept: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if not kept or error < kept[-1][1]:
            kept.append((cost, error))
    return kept


def _saved(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    return path


def main() -> None:
    """Run the chosen parts and write the results."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer states, 1 and 10 s, 3 models of the promise")
    parser.add_argument(
        "--only", default="evaluations,motions,promise,samples,requires", help="parts, separated by commas; or figures"
    )
    parser.add_argument("--models", default="", help="of motions, by name, separated by semicolons; by default all")
    parser.add_argument("--seconds", type=float, default=8.0, help="that a long run may take (default: 8)")
    parser.add_argument("--out", type=Path, default=HERE, metavar="DIRECTORY", help="where to write (default: here)")
    arguments = parser.parse_args()
    path = arguments.out / "tradeoff.json"
    results: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    names = arguments.models.split(";") if arguments.models else [*ROBOTS, *EXTREMES]
    measured: dict[str, Callable[[], Iterator[Any]]] = {
        "evaluations": lambda: iter([of_evaluations(arguments.quick)]),
        "motions": lambda: of_motions(arguments.quick, arguments.seconds, names, results.get("motions", {})),
        "promise": lambda: iter([of_promises(arguments.quick)]),
        "samples": lambda: iter([of_samples(arguments.quick)]),
        "requires": lambda: iter([of_requirement(arguments.quick)]),
    }
    sd.set_num_threads(1)
    for name in arguments.only.split(","):
        for found in measured[name]() if name in measured else ():
            results[name] = found
            path.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for written in draw(results, arguments.out):
        print(written)


if __name__ == "__main__":
    main()
