"""What a digit costs: forward dynamics by every way, motions by every integrator; and whether the advice holds.

    python benchmarks/tradeoff.py [--quick] [--only evaluations,motions,promise] [--models '2R;panda'] [--seconds 8]
                                  [--out DIRECTORY]

evaluations  ``sd.trade`` of forward dynamics on 2R, panda, anymal, talos and four extreme models
motions      1 s: largest error of the state against Gauss's collocation of order 32 in double-double; 1, 100 and
             2000 s: largest change of energy over the largest kinetic energy, and the cost of a simulated second. A
             state after 100 s of a chaotic motion is beyond any arithmetic, so no error is given for it. What floats
             does so without gravity. Runs that would take longer than --seconds are left out
promise      10 models, 3 tasks, 5 tolerances: whether what is recommended meets its tolerance on fresh states, and how
             much faster any other listed way is that meets it too: those whose bound says so, and those that would
             have got away with it; of these, in which share of 65536 others they do not

Writes tradeoff.json, tradeoff.png (for the README), tradeoff_evaluations.png, tradeoff_robots.png and
tradeoff_extremes.png; what is not run is kept from the file that is there.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.accuracy import call_errors, integrator_errors, references
from spatialdyn.accuracy.tradeoff import advice
from spatialdyn.simulation.reference_motion import exact_motion

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
SAMPLES = 400  # energies that are looked at
RTOL = (1e-6, 1e-9, 1e-12)
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-12)
FRESH = 1000


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
    """A robot, without what there is to say of its inertias."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sd.load_urdf(name, **options)


def panda() -> sd.Model:
    """Without its fingers: nothing holds them on their rails, and they would be off to infinity."""
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
# Seconds in which they move as far as the others in one: a light link under a heavy tip whips, small things are quick.
SECOND = {"7 rods, tip 1e6": 1e-3, "7 rods, tip 1e12": 1e-6, "6 rods of 1 mm, 1 mg": 0.03}
PROMISED: dict[str, Callable[[], sd.Model]] = {
    **{name: ROBOTS[name] for name in ("2R", "panda", "anymal")},
    "ur5": lambda: load("ur5"),
    "solo": lambda: load("solo12", root="floating"),
    **EXTREMES,
    "light and heavy": lambda: rods([1.0, 1e-4] * 3),
}


# --- what is measured ---------------------------------------------------------------------------------------


def of_evaluations(quick: bool) -> dict[str, Any]:
    """``trade`` of each model."""
    found = {}
    for name, make in {**ROBOTS, **EXTREMES}.items():
        model = make()
        made = sd.trade(model, states=128 if quick else None)
        found[name] = {"nv": model.nv, **made.to_dict()}
        print(f"\n{name}\n{made}", flush=True)
    return found


def of_motions(quick: bool, seconds: float, names: list[str], found: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Work and precision of integrators: a list of runs for each model, beside those that there are."""
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
    """Have compiled what a method needs."""
    with warnings.catch_warnings(), contextlib.suppress(sd.SpatialDynError):
        warnings.simplefilter("ignore")
        sd.simulate(model, q0, v0, 2e-9, 1e-9, method)


def _runs(
    model: sd.Model, q0: Any, v0: Any, duration: float, steps: int, method: str, truth: Any, seconds: float
) -> Iterator[dict[str, Any]]:
    """A method at steps, or tolerances, ever finer, as long as a run is to be expected within so many seconds."""
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
    """Seconds that a simulated second will take."""
    row = _run(model, q0, v0, 50 * words["dt"] if "rtol" not in words else duration / 100, method, words, None)
    return float(row["seconds"] / row["duration"])


def _run(
    model: sd.Model, q0: Any, v0: Any, duration: float, method: str, words: Any, truth: Any, limit: float = 10.0
) -> dict[str, Any]:  # fmt: skip
    """One run: its cost, errors of energy and state, and what went wrong."""
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
            row["state"] = None if truth is None else _finite(integrator_errors.off(model, run, truth, 0))
        except sd.NonFiniteError as error:  # of a state that is all but lost
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
    """What is recommended, held to its word."""
    rows: list[dict[str, Any]] = []
    broken = slower = luck = 0
    for name, make in list(PROMISED.items())[: 3 if quick else None]:
        model = make()
        for task in call_errors.TASKS:
            found = sd.trade(model, task)
            first = call_errors.TASKS[task][0]
            fresh = call_errors.random_states(model, task, FRESH, seed=1)
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


def _beyond(model: sd.Model, task: str, way: sd.Option, tolerance: float) -> float:
    """The share of MANY fresh states in which the error of a way is beyond a tolerance."""
    first, bad, many = call_errors.TASKS[task][0], 0, 0
    assert way.run is not None
    for k in range(references.MANY // 4096):
        fresh = call_errors.random_states(model, task, 4096, [2, k])
        truth, _ = references.truths(model, first, fresh, 0)
        bad += int((references.of_calls(first, np.asarray(way.run(*fresh)), truth) > tolerance).sum())
        many += len(truth)
    return bad / many


# --- figures ------------------------------------------------------------------------------------------------

CALLS = {"aba": "#1f5fa8", "crba_solve": "#d1782a", "aba_refined": "#7a9a3a", "aba_square_root": "#8a6bb0"}
MARKS = {"lanes float32": "v", "lanes float64": "o", "untraced float64": "s"}
COLOURS = dict(
    zip(METHODS, ("#999999", "#8fbce6", "#1f5fa8", "#c9b458", "#7a9a3a", "#e6a06a", "#d1782a", "#8a6bb0"), strict=True)
)
FLOOR = 1e-17


def ways_panel(axes: Any, found: dict[str, Any], title: str) -> None:
    """Error against the cost of a sample."""
    for x in found["options"]:
        engine, _, call = x["name"].rpartition(" ")
        if x["error"] is not None and x["ns"] is not None:
            axes.plot(
                x["ns"], max(x["error"], FLOOR), MARKS[engine], color=CALLS[call], mec="black" if x["best"] else "none"
            )
    front = [x for x in found["options"] if x["best"] and x["error"] is not None]
    axes.step(
        [x["ns"] for x in front], [max(x["error"], FLOOR) for x in front], color="0.6", where="post", ls=":", zorder=0
    )
    axes.set(xscale="log", yscale="log", title=title)
    axes.grid(alpha=0.3)


def runs_panel(axes: Any, rows: list[dict[str, Any]], key: str, title: str) -> None:
    """Error against the cost of a simulated second, a line for each method."""
    for method in METHODS:
        points = [
            (row["ns"], max(row[key], FLOOR)) for row in rows if row["method"] == method and row.get(key) is not None
        ]
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(x, y, "o-", ms=3.5, lw=1.0, color=COLOURS[method], label=method)
    axes.set(xscale="log", yscale="log", title=title, ylim=(1e-16, 10.0))
    axes.grid(alpha=0.3)


def legends(figure: Any, kind: str) -> None:
    """Beside the panels."""
    from matplotlib.lines import Line2D

    if kind == "ways":
        made = [Line2D([], [], marker=m, ls="", color="0.4", label=name) for name, m in MARKS.items()]
        made += [Line2D([], [], marker="o", ls="", color=c, label=name) for name, c in CALLS.items()]
        made += [Line2D([], [], marker="o", ls=":", color="0.6", mfc="none", mec="black", label="front")]
    else:
        made = [Line2D([], [], marker="o", ms=3.5, color=c, label=name) for name, c in COLOURS.items()]
    figure.legend(
        handles=made,
        loc="outside lower center",
        ncols=4 if figure.get_figwidth() < 13 else 8,
        fontsize="small",
        frameon=False,
    )


def draw(results: dict[str, Any], out: Path) -> list[Path]:
    """All figures that there are results for."""
    from matplotlib.figure import Figure

    written = []
    ways, runs = results.get("evaluations"), results.get("motions")
    if ways:
        figure = Figure(figsize=(15, 7.5), layout="constrained")
        panels = figure.subplots(2, 4)
        for axes, (name, found) in zip(panels.ravel(), ways.items(), strict=False):
            ways_panel(axes, found, f"{name}, {found['nv']} freedoms")
            axes.set_ylim(1e-16, 100.0)
        for axes in panels[-1]:
            axes.set_xlabel("ns a sample")
        for axes in panels[:, 0]:
            axes.set_ylabel("largest error / largest acceleration")
        figure.suptitle(f"Forward dynamics: error against cost, of {ways['panda']['states']} random states")
        legends(figure, "ways")
        written.append(_saved(figure, out / "tradeoff_evaluations.png"))
    if runs:
        for label, group in (("robots", ROBOTS), ("extremes", EXTREMES)):
            names = [name for name in group if name in runs]
            if not names:
                continue
            count = max(len({row["duration"] for row in runs[name]["runs"]}) for name in names)
            figure = Figure(figsize=(1.5 + 3.5 * len(names), 3.4 * (count + 1)), layout="constrained")
            panels = figure.subplots(count + 1, len(names), squeeze=False)
            for column, name in zip(panels.T, names, strict=True):
                rows = runs[name]["runs"]
                horizons = sorted({row["duration"] for row in rows})
                first = [r for r in rows if r["duration"] == horizons[0]]
                runs_panel(column[0], first, "state", f"{name}: state, {horizons[0]:g} s")
                for axes, duration in zip(column[1:], horizons, strict=False):
                    here = [r for r in rows if r["duration"] == duration]
                    runs_panel(axes, here, "energy", f"{name}: energy, {duration:g} s")
                column[-1].set_xlabel("ns a simulated second")
            for axes in panels.ravel():
                axes.set_visible(bool(axes.lines))
            for axes, what in zip(panels[:, 0], ["state"] + ["energy"] * count, strict=True):
                axes.set_ylabel(f"largest relative error of {what}")
            legends(figure, "runs")
            written.append(_saved(figure, out / f"tradeoff_{label}.png"))
    if ways and runs:
        figure = Figure(figsize=(12, 5.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        ways_panel(left, ways["panda"], "panda: forward dynamics of a batch")
        left.set(xlabel="ns a sample", ylabel="largest error / largest acceleration", ylim=(1e-16, 1e-3))
        for x in ways["panda"]["options"]:
            engine, _, call = x["name"].rpartition(" ")
            words = f"{call}{', float32' if '32' in engine else ', untraced' if engine.startswith('untraced') else ''}"
            left.annotate(
                words,
                (x["ns"], x["error"]),
                xytext=(6, -15 if "refined" in call else 6),
                textcoords="offset points",
                fontsize=8,
            )
        left.set_xlim(right=40 * max(x["ns"] for x in ways["panda"]["options"]))
        rows = [row for row in runs["panda"]["runs"] if row["duration"] == 1.0]
        runs_panel(right, rows, "state", "panda: a second of free motion")
        right.set(xlabel="ns a simulated second", ylabel="largest relative error of q and v")
        right.legend(fontsize="small")
        written.append(_saved(figure, out / "tradeoff.png"))
    return written


def _saved(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    return path


def main() -> None:
    """Run what is asked for and write it down."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer states, 1 and 10 s, 3 models of the promise")
    parser.add_argument("--only", default="evaluations,motions,promise", help="parts, separated by commas; or figures")
    parser.add_argument("--models", default="", help="of motions, by name, separated by semicolons; by default all")
    parser.add_argument("--seconds", type=float, default=8.0, help="that a long run may take (default: 8)")
    parser.add_argument("--out", type=Path, default=HERE, metavar="DIRECTORY", help="where to write (default: here)")
    arguments = parser.parse_args()
    path = arguments.out / "tradeoff.json"
    results: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    names = arguments.models.split(";") if arguments.models else [*ROBOTS, *EXTREMES]
    parts: dict[str, Callable[[], Iterator[Any]]] = {
        "evaluations": lambda: iter([of_evaluations(arguments.quick)]),
        "motions": lambda: of_motions(arguments.quick, arguments.seconds, names, results.get("motions", {})),
        "promise": lambda: iter([of_promises(arguments.quick)]),
    }
    sd.set_num_threads(1)
    for name in arguments.only.split(","):
        for found in parts[name]() if name in parts else ():
            results[name] = found
            path.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for written in draw(results, arguments.out):
        print(written)


if __name__ == "__main__":
    main()
