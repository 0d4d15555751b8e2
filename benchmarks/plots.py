"""The results as plots, each an SVG and a PNG: throughput of batches, one call, and time against n of chains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

OURS, OURS32, PIN, MUJOCO, OTHER = "#1f5fa8", "#8fbce6", "#d1782a", "#7a9a3a", "#8a6bb0"
LABELS = {"ours_ns": "spatialdyn", "float32_ns": "spatialdyn, float32", "pin_ns": "Pinocchio", "mujoco": "MuJoCo"}
COLOURS = {"ours_ns": OURS, "float32_ns": OURS32, "pin_ns": PIN, "mujoco": MUJOCO}
MARKERS = {"rnea": "o", "aba": "s", "crba": "^"}


def draw(results: dict[str, Any], folder: Path) -> list[Path]:
    """Write all plots into a folder; returns their paths."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    style = {"font.size": 11, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "spatialdyn"}
    with pyplot.rc_context(style):
        for name, figure in (("throughput", throughput(results)), ("chains", chains(results))):
            for kind in ("svg", "png"):
                path = folder / f"{name}.{kind}"
                figure.savefig(path, dpi=110, metadata={"Date": None} if kind == "svg" else {})
                written.append(path)
            pyplot.close(figure)
    return written


def throughput(results: dict[str, Any]) -> Any:
    """Samples a second of batches on one thread: a panel a call, a group of bars a robot."""
    from matplotlib import pyplot

    calls = list(dict.fromkeys(call for t in results["batch"].values() for call in t))
    figure, axes = pyplot.subplots(2, (len(calls) + 2) // 2, figsize=(15, 8), layout="constrained", sharey=True)
    panels = axes.ravel()
    for axis, call in zip(panels, calls, strict=False):
        robots = [robot for robot, t in results["batch"].items() if call in t]
        for k, way in enumerate(LABELS):
            rates = [_rate(results["batch"][robot][call], way) for robot in robots]
            places = np.arange(len(robots)) + 0.21 * (k - 1.5)
            axis.bar(places, rates, 0.2, color=COLOURS[way], zorder=2)
        axis.set_yscale("log")
        axis.set_title(call.replace("_", " "))
        axis.set_xticks(range(len(robots)), [r.removesuffix(", fixed") for r in robots], rotation=30, ha="right")
        axis.grid(axis="y", color="0.9", zorder=0)
    for axis in axes[:, 0]:
        axis.set_ylabel("samples a second")
    for axis in panels[len(calls) :]:
        axis.axis("off")
    handles = [pyplot.Rectangle((0, 0), 1, 1, color=COLOURS[way]) for way in LABELS]
    notes = "rnea and aba of Pinocchio by its pool,\nits other calls and MuJoCo by a loop\nin Python"
    panels[-1].legend(handles, LABELS.values(), loc="upper left", frameon=False, fontsize=12)
    panels[-1].text(0.03, 0.3, notes, transform=panels[-1].transAxes, fontsize=10, color="0.3")
    machine = results["machine"]
    figure.suptitle(
        f"batches of {results['samples']} on one thread of {machine['processor']}, results into a given array"
    )
    return figure


def _rate(entry: dict[str, Any], way: str) -> float:
    ns = entry["peers"].get("mujoco", {}).get("ns") if way == "mujoco" else entry[way]
    return float("nan") if ns is None else 1e9 / ns


def chains(results: dict[str, Any]) -> Any:
    """Time of a call against the number of joints, both logarithmic, slopes in the legend: a panel a call."""
    from matplotlib import pyplot
    from matplotlib.ticker import FuncFormatter

    found = results["chains"]
    n = found["joints"]
    figure, axes = pyplot.subplots(1, len(found["us"]), figsize=(15, 5.4), layout="constrained", sharey=True)
    looks = {
        "untraced": ("spatialdyn, one call", OURS, "o-"),
        "pinocchio": ("Pinocchio, one call", PIN, "s-"),
        "batch": ("spatialdyn, a sample of a batch", OURS32, "^-"),
    }
    for axis, (call, ways) in zip(np.ravel(axes), found["us"].items(), strict=True):
        for way, values in ways.items():
            label, colour, line = looks[way]
            grows = f": $n^{{{found['slope'][call][way]:.2f}}}$" if way in found["slope"][call] else ""
            axis.loglog(n[: len(values)], values, line, color=colour, label=label + grows)
            if way == "batch":  # where the program ends and the kernel for any model begins
                bare = [k for k, engine in enumerate(found["batch_engine"]) if engine == "untraced"]
                axis.plot([n[k] for k in bare], [values[k] for k in bare], "^", mfc="white", color=colour, zorder=3)
        axis.set_title(call)
        axis.set_xlabel("joints")
        axis.set_xticks(n)
        axis.minorticks_off()
        axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.grid(color="0.9")
        axis.legend(loc="upper left", frameon=False, fontsize=10)
    np.ravel(axes)[0].set_ylabel("µs")
    low, high = np.ravel(axes)[0].get_ylim()
    np.ravel(axes)[0].set_ylim(low, 12 * high)  # room for the legends
    notes = "slopes from 30 joints on; hollow: untraced, too long a program"
    figure.suptitle(f"chains of rods on {results['machine']['processor']}; {notes}")
    return figure
