"""The results as tables on the screen, losses included; in colour where rich is installed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any

Rows = list[list[str]]


def show(results: dict[str, Any]) -> None:
    """Print every table whose figures are in the results."""
    for title, headings, rows in tables(results):
        draw(title, headings, rows)


def tables(results: dict[str, Any]) -> Iterator[tuple[str, list[str], Rows]]:
    """(title, headings, rows) of each."""
    yield _single(results)
    yield _batch(results)
    yield _limits(results)
    yield _costs(results)
    yield _chains(results["chains"])


def number(value: float | None, digits: int = 1) -> str:
    """x to about three digits; empty for None."""
    if value is None:
        return ""
    return f"{value:.{digits}f}" if abs(value) < 1000 else f"{value:.0f}"


def _others(entries: Iterable[dict[str, Any]], unit: str) -> list[str]:
    """The libraries besides Pinocchio with a time in any row."""
    seen = dict.fromkeys(name for entry in entries for name, peer in entry["peers"].items() if unit in peer)
    return list(seen)


def _cell(entry: dict[str, Any], name: str, unit: str) -> str:
    return number(entry["peers"].get(name, {}).get(unit), 1)


def _single(results: dict[str, Any]) -> tuple[str, list[str], Rows]:
    entries = [t for calls in results["single"].values() for t in calls.values()]
    others = _others(entries, "us")
    rows = []
    for robot, calls in results["single"].items():
        for call, t in calls.items():
            own = [t["ours_us"], t["k_us"], t["jitted_us"], t["pin_us"]]
            ratios = [t["ratio"], t["k_ratio"], t["jitted_ratio"]]
            rows.append([robot, call, *(number(x, 2) for x in [*own, *ratios]), *(_cell(t, o, "us") for o in others)])
    headings = ["robot", "call", "sd", "k", "in @njit", "pinocchio", "sd /pin", "k /pin", "@njit /pin", *others]
    return "one call, µs; k = sd.specialize(model, call)", headings, rows


def _batch(results: dict[str, Any]) -> tuple[str, list[str], Rows]:
    entries = [t for calls in results["batch"].values() for t in calls.values()]
    others = _others(entries, "ns")
    rows = []
    for robot, calls in results["batch"].items():
        for call, t in calls.items():
            own = [t["ours_ns"], t["ours_2_threads_ns"], t["fresh_ns"], t["k_ns"], t["float32_ns"]]
            pins = [t["pin_ns"], t.get("pin_2_threads_ns")]
            rows.append([robot, call, *map(number, own), f"{t['float32_error']:.0e}", *(number(x, 0) for x in pins)])
            rows[-1] += [number(t["ratio"], 1), *(_cell(t, o, "ns") for o in others)]
    headings = ["robot", "call", "sd", "2 threads", "fresh", "k", "float32", "its error", "pin", "pin 2 threads"]
    title = f"a sample of a batch of {results['samples']}, ns; out= given, one thread unless said"
    return title, [*headings, "pin / sd", *others], rows


def _limits(results: dict[str, Any]) -> tuple[str, list[str], Rows]:
    machine = results["machine"]
    rows = []
    for robot, calls in results["batch"].items():
        for call, t in calls.items():
            o = t["operations"]
            counted = [f"{o[word]}" for word in ("mul", "add", "div", "sqrt", "sincos", "depth")] if o else [""] * 6
            shares = [f"{100 * t[s]:.0f} %" if t[s] is not None else "" for s in ("peak_share", "store_share")]
            rows.append([robot, call, *counted, number(t["flops_per_ns"]), shares[0], number(t["bytes_per_ns"])])
            rows[-1].append(shares[1])
    stores = ", ".join(f"{way} {value:.0f}" for way, value in machine["store_bytes_per_ns"].items())
    title = (
        f"limits: {machine['peak_flops_per_ns']:.0f} flops/ns of multiply-adds, stores of {stores} bytes/ns; "
        "a share of the stores where the result is larger than the caches"
    )
    headings = ["robot", "call", "mul", "add", "div", "sqrt", "sincos", "depth", "flops/ns", "of peak", "bytes/ns"]
    return title, [*headings, "of stores"], rows


def _costs(results: dict[str, Any]) -> tuple[str, list[str], Rows]:
    rows = []
    for robot, calls in results["compile"].items():
        for call, t in calls.items():
            rows.append([f"{robot} {call}, program", number(t["compile_s"], 2), number(t["from_disk_s"], 3)])
    rows += [[f"start: {name[:-2].replace('_', ' ')}", "", number(t, 2)] for name, t in results["start"].items()]
    for call, t in (results["memory"] or {}).items():
        what = f"ur5 {call}, {t['samples']:,} samples in {t['arrays_mb']:.0f} MB of arrays: MB more"
        rows.append([what, "", number(t["extra_mb"], 1)])
    return "before the first answer and beside it, seconds in a fresh process", ["what", "compiled", "warm"], rows


def _chains(chains: dict[str, Any]) -> tuple[str, list[str], Rows]:
    rows = []
    for call, ways in chains["us"].items():
        for way, values in ways.items():
            slope = number(chains["slope"][call].get(way), 2)
            rows.append([call, way, *_padded(values, len(chains["joints"])), slope])
    engines = ", ".join(chains["batch_engine"])
    title = f"chains, µs a sample; slope of log time over log n from 30 joints on; engines of batches: {engines}"
    return title, ["call", "way", *(f"n = {n}" for n in chains["joints"]), "slope"], rows


def _padded(values: list[float], count: int) -> list[str]:
    return [number(t, 2) for t in values] + [""] * (count - len(values))


# --- printing ----------------------------------------------------------------------------------------------


def draw(title: str, headings: list[str], rows: Rows) -> None:
    """One table on the screen."""
    try:
        from rich.console import Console
        from rich.table import Table
    except ImportError:
        print(plain(title, headings, rows))
        return
    table = Table(title=title, title_justify="left")
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="left" if k < 2 and not _is_number(rows, k) else "right")
    for before, row in zip([[""], *rows], rows, strict=False):
        if before[0] and before[0] != row[0] and len({r[0] for r in rows}) < len(rows):
            table.add_section()
        table.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(table)


def plain(title: str, headings: list[str], rows: Rows) -> str:
    """The same table as aligned text."""
    widths = [max(len(row[k]) for row in [headings, *rows]) for k in range(len(headings))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in [headings, *rows]]
    return "\n".join([title, *lines, ""])


def _is_number(rows: Rows, k: int) -> bool:
    return bool(rows) and all(not row[k] or row[k][0].isdigit() for row in rows)


class Bar:
    """A progress bar by rich; without rich or a terminal, lines on stderr."""

    def __init__(self, steps: int) -> None:
        """Start at 0 steps."""
        self._done: Callable[[str], None] = lambda text: print(text, file=sys.stderr, flush=True)
        self._end: Callable[[], None] = lambda: None
        if not sys.stdout.isatty():
            return
        try:
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
        except ImportError:
            return
        count, what = TextColumn("{task.completed}/{task.total}"), TextColumn("{task.description}")
        bar = Progress(BarColumn(), count, TimeElapsedColumn(), what)
        task = bar.add_task("", total=steps)
        bar.start()
        self._done = lambda text: bar.update(task, advance=1, description=text)
        self._end = bar.stop

    def step(self, text: str = "") -> None:
        """Count one step."""
        self._done(text)

    def end(self) -> None:
        """Remove the bar."""
        self._end()
