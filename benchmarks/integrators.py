"""Energy errors of integrators: the textbook's experiment, and a long chaotic motion.

python benchmarks/integrators.py [--quick] [--out DIRECTORY]

1. Pendulum and 2R arm, 100 s: Runge-Kutta of order 4 against Störmer-Verlet, and against Verlet's method in (q, v). In
   the textbook Störmer-Verlet's energy error is bounded and RK4's grows. For the pendulum, whose M is constant, both
   Verlet methods show that. For the arm only the generalised method in (q, p) does: Verlet's method in (q, v), with
   Coriolis forces in its accelerations, is not symplectic when M depends on q, and its energy drifts more than RK4's.
   Bounded is not small: over 100 s at this dt RK4's error is still a hundredth of Störmer-Verlet's on both.
2. The 2R arm as a double pendulum, in chaotic motion: the slope of energy [J/s], its standard error, and the largest
   change, by every method of fixed step, over 2000 s (--quick: 100 s).

Writes integrators.json and integrators.png, prints the table.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.pictures import figures

HERE = Path(__file__).parent
SEED = ("rk4", "stormer_verlet", "velocity_verlet")
LABELS = {
    "rk4": "Runge-Kutta 4 in (q, v)",
    "stormer_verlet": "Störmer-Verlet in (q, p), symplectic",
    "velocity_verlet": "Verlet in (q, v)",
}
STYLES: dict[str, Any] = {"rk4": "-", "stormer_verlet": "-", "velocity_verlet": (0, (2, 2))}  # the curves coincide
HANGING = -math.pi / 2  # first angle of the 2R arm


def main() -> None:
    """Run both and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the long run over 100 s instead of 2000 s")
    parser.add_argument("--out", type=Path, default=HERE, metavar="DIRECTORY", help="where to write (default: here)")
    arguments = parser.parse_args()
    runs = textbook()
    rows = chaos(100.0 if arguments.quick else 2000.0)
    show(runs, rows)
    results = {
        "textbook": [
            {"robot": x.robot, "method": x.method, "dt": x.dt, "duration": x.t[-1], **errors(x)} for x in runs
        ],
        "chaos": rows,
    }
    (arguments.out / "integrators.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    draw(runs, arguments.out / "integrators.png")


def textbook() -> list[sd.Trajectory]:
    """100 s of free motion, dt 0.01 s, as in the textbook: the pendulum from 1 rad, the 2R arm swinging alike."""
    pendulum, arm = sd.load_urdf("pendulum"), sd.load_urdf("two_link")
    starts = ((pendulum, np.array([1.0])), (arm, np.array([HANGING + 1.0, 0.5])))
    return [
        sd.simulate(model, q0, np.zeros(model.nv), 100.0, 0.01, name, record=1) for model, q0 in starts for name in SEED
    ]


def errors(run: sd.Trajectory) -> dict[str, float]:
    """Largest change of energy in the first and in the second half [J]."""
    change, half = abs(run.energy - run.energy[0]), len(run) // 2
    return {"first_half": float(change[:half].max()), "second_half": float(change[half:].max())}


def chaos(duration: float) -> list[dict[str, Any]]:
    """Every method of fixed step on the double pendulum, from (2.2, 1.0) rad at rest, at two steps."""
    model, rows = sd.load_urdf("two_link"), []
    q0, v0 = np.array([HANGING + 2.2, 1.0]), np.zeros(2)
    for name, method in sd.integrators.items():
        if method.family is None:
            continue
        for dt in (0.01, 0.0025):
            row: dict[str, Any] = {"method": name, "order": method.order, "symplectic": method.symplectic, "dt": dt}
            began, stopped = time.perf_counter(), None
            try:
                run = sd.simulate(model, q0, v0, duration, dt, name)
            except sd.SimulationError as error:
                run, stopped = error.trajectory, str(error)
            row["seconds"] = time.perf_counter() - began
            slope, deviation = trend(run)
            row |= {"duration": float(run.t[-1]), "slope": slope, "deviation": deviation, "stopped": stopped}
            row["largest"] = float(abs(run.energy - run.energy[0]).max())
            rows.append(row)
    return rows


def trend(run: sd.Trajectory, blocks: int = 20) -> tuple[float, float]:
    """Slope of the energy [J/s] through the means of blocks, and its standard error."""
    if len(run) < 2 * blocks:
        return math.nan, math.nan
    cut = len(run) // blocks * blocks
    t, energy = (x[:cut].reshape(blocks, -1).mean(axis=1) for x in (run.t, run.energy - run.energy[0]))
    t = t - t.mean()
    slope = float(t @ energy / (t @ t))
    rest = energy - energy.mean() - slope * t
    return slope, float(np.sqrt(rest @ rest / (blocks - 2) / (t @ t)))


def show(runs: list[sd.Trajectory], rows: list[dict[str, Any]]) -> None:
    """The tables."""
    print("free motion, 100 s, dt 0.01 s: largest change of energy [J]")
    print(f"{'robot':<10}{'method':<18}{'first half':>12}{'second half':>13}")
    for run in runs:
        e = errors(run)
        print(f"{run.robot:<10}{run.method:<18}{e['first_half']:>12.2e}{e['second_half']:>13.2e}")
    print(f"\ndouble pendulum, chaotic, {max(row['duration'] for row in rows):g} s")
    print(f"{'method':<21}{'dt':>7}{'slope J/s':>12}{'± ':>9}{'largest J':>11}{'seconds':>9}")
    for row in rows:
        line = f"{row['method']:<21}{row['dt']:>7}{row['slope']:>12.1e}{row['deviation']:>9.0e}{row['largest']:>11.1e}"
        print(line + (f"{row['seconds']:>9.1f}" if row["stopped"] is None else f"  stopped at {row['duration']:g} s"))


def draw(runs: list[sd.Trajectory], path: Path) -> None:
    """The change of energy over time, a panel for each robot."""
    figure = figures.new_figure(11.0, 4.6)
    titles = {"pendulum": "pendulum: M constant", "two_link": "2R arm: M depends on q"}
    lines = []
    for axes, (name, title) in zip(figure.subplots(1, 2, sharey=True), titles.items(), strict=True):
        figures.tidy(axes)
        for run in (x for x in runs if x.robot == name):
            error = abs(run.energy - run.energy[0])
            block = error[1:].reshape(-1, 50).max(axis=1)  # envelope over half a second
            style, colour = STYLES[run.method], figures.COLOURS[SEED.index(run.method)]
            drawn = axes.semilogy(run.t[50::50], np.maximum(block, 1e-13), linewidth=1.2, linestyle=style, color=colour)
            lines += drawn if name == "pendulum" else []
        axes.set(title=title, xlabel="t [s]", xlim=(0.0, 100.0))
        figures.log_ticks(axes.yaxis)
    figure.axes[0].set_ylabel("|H(t) - H(0)| [J], largest of 0.5 s")
    figure.axes[0].annotate(
        "both Verlet methods are one here", (50.0, 8e-4), xytext=(0, 8), textcoords="offset points", ha="center",
        fontsize="small",
    )  # fmt: skip
    figure.legend(lines, [LABELS[name] for name in SEED], loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle("Free motion, dt = 0.01 s")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
