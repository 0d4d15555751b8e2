"""The results as plots, each an SVG and a PNG: throughput of batches, and time against n of chains.

    python benchmarks/plots.py [--out FOLDER]

Draws them from results.json, as benchmarks/run.py does after it has measured.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spatialdyn.pictures.figures import COLOURS, log_ticks, new_figure, tidy

WAYS = {  # label, colour, marker
    "ours_ns": ("spatialdyn", COLOURS[0], "o"),
    "float32_ns": ("spatialdyn, float32", COLOURS[3], "^"),
    "pin_ns": ("Pinocchio", COLOURS[1], "s"),
    "mujoco": ("MuJoCo", COLOURS[2], "D"),
}
NOTE = "Pinocchio: rnea and aba by its pool, other calls, as MuJoCo's, by a loop in Python"


def draw(results: dict[str, Any], folder: Path) -> list[Path]:
    """Write all plots into a folder; returns their paths."""
    import matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with matplotlib.rc_context({"svg.hashsalt": "spatialdyn"}):
        for name, figure in (("throughput", throughput(results)), ("chains", chains(results))):
            for kind in ("svg", "png"):
                path = folder / f"{name}.{kind}"
                figure.savefig(path, dpi=110, metadata={"Date": None} if kind == "svg" else {})
                written.append(path)
    return written


def throughput(results: dict[str, Any]) -> Any:
    """Samples per second of batches on one thread: a panel per call, a dot for each robot and library."""
    from matplotlib.lines import Line2D

    calls = list(dict.fromkeys(call for t in results["batch"].values() for call in t))
    figure = new_figure(14.5, 8.0)
    above = (len(calls) + 1) // 2
    below = len(calls) - above
    cells = figure.add_gridspec(2, above * below)  # rows of as many panels as there are calls: none is empty
    first: Any = None
    for k, call in enumerate(calls):
        row, wide = (0, below) if k < above else (1, above)
        at = wide * (k if k < above else k - above)
        axis = first = figure.add_subplot(cells[row, at : at + wide], sharey=first)
        tidy(axis)
        robots = [robot for robot, t in results["batch"].items() if call in t]
        for way, (_, colour, marker) in WAYS.items():
            rates = [_rate(results["batch"][robot][call], way) for robot in robots]
            axis.plot(rates, marker, color=colour, markersize=6.5)
        axis.set(yscale="log", title=call.replace("_", " "), xlim=(-0.5, len(robots) - 0.5))
        log_ticks(axis.yaxis)
        axis.set_xticks(range(len(robots)), [r.removesuffix(", fixed") for r in robots], rotation=30, ha="right")
        if at == 0:
            axis.set_ylabel("samples a second")
        else:
            axis.tick_params(labelleft=False)
    keys = [Line2D([], [], marker=marker, color=colour, ls="", label=label) for label, colour, marker in WAYS.values()]
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), frameon=False, title=NOTE)
    machine = results["machine"]
    figure.suptitle(
        f"batches of {results['samples']} on one thread of {machine['processor']}, results into a given array"
    )
    return figure


def _rate(entry: dict[str, Any], way: str) -> float:
    ns = entry["peers"].get("mujoco", {}).get("ns") if way == "mujoco" else entry[way]
    return float("nan") if ns is None else 1e9 / ns


def chains(results: dict[str, Any]) -> Any:
    """Time of a call against the number of joints, both logarithmic, slopes in the legend: a panel per call."""
    from matplotlib.ticker import FuncFormatter

    found = results["chains"]
    n = found["joints"]
    figure = new_figure(14.5, 5.6)
    axes = np.ravel(figure.subplots(1, len(found["us"]), sharey=True))
    looks = {
        "untraced": ("spatialdyn, one call", COLOURS[0], "o-"),
        "pinocchio": ("Pinocchio, one call", COLOURS[1], "s--"),
        "batch": ("spatialdyn, a sample of a batch", COLOURS[3], "^-"),
    }
    for axis, (call, ways) in zip(axes, found["us"].items(), strict=True):
        tidy(axis)
        for way, values in ways.items():
            label, colour, line = looks[way]
            grows = f": $n^{{{found['slope'][call][way]:.2f}}}$" if way in found["slope"][call] else ""
            axis.loglog(n[: len(values)], values, line, color=colour, label=label + grows)
            if way == "batch":  # where the engine changes from the program to the table kernel
                bare = [k for k, engine in enumerate(found["batch_engine"]) if engine == "untraced"]
                axis.plot([n[k] for k in bare], [values[k] for k in bare], "^", mfc="white", color=colour, zorder=3)
        axis.set(title=call, xlabel="joints of the chain")
        log_ticks(axis.yaxis)
        axis.set_xticks(n)
        axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.xaxis.set_minor_locator(axis.xaxis.get_major_locator())
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), frameon=False, fontsize=10)
    axes[0].set_ylabel("µs for one call, or for one sample of a batch")
    notes = "slopes from 30 joints on; hollow: untraced, too long a program"
    figure.suptitle(f"chains of rods on {results['machine']['processor']}; {notes}")
    return figure


def main() -> None:
    """Draw the kept results again."""
    here = Path(__file__).parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=here / "plots", metavar="FOLDER", help="where to write")
    out = parser.parse_args().out
    for path in draw(json.loads((here / "results.json").read_text(encoding="utf-8")), out):
        print(path)


if __name__ == "__main__":
    main()
