"""Put the measured table of benchmarks/results.json between the marks in README.md.

python benchmarks/report.py [--check]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

BATCHES = {  # the robots of the table, with their headings
    "ur5, fixed": "ur5, fixed", "panda, fixed": "panda, fixed", "talos_full, fixed": "talos_full, fixed",
    "anymal, floating": "anymal, base floating",
}  # fmt: skip
SINGLES = ("ur5", "panda", "talos_full")

HERE = Path(__file__).parent
README = HERE.parent / "README.md"
BEGIN, END = "<!-- measured: benchmarks/run.py -->\n", "<!-- end -->\n"


def table() -> str:
    """Batches and single calls as Markdown."""
    results = json.loads((HERE / "results.json").read_text(encoding="utf-8"))
    machine = results["machine"]
    batches = {heading: results["batch"][robot] for robot, heading in BATCHES.items()}
    singles = [results["single"][robot] for robot in SINGLES]
    lines = ["| a batch, ns a sample | " + " | ".join(batches) + " |", "|---|" + "---|" * len(batches)]
    for call in ("rnea", "aba", "crba"):
        cells = [
            f"{t[call]['ours_ns']:.0f} / {t[call]['pin_ns']:.0f}, {t[call]['ratio']:.0f}x" for t in batches.values()
        ]
        lines.append(f"| `{call}` | " + " | ".join(cells) + " |")
    lines += ["", "| one call, µs | " + " | ".join(SINGLES) + " |", "|---|" + "---|" * len(SINGLES)]
    for call in ("rnea", "crba", "aba", "minverse"):
        cells = [f"{t[call]['ours_us']:.2f} / {t[call]['pin_us']:.2f} ({t[call]['jitted_us']:.2f})" for t in singles]
        lines.append(f"| `{call}` | " + " | ".join(cells) + " |")
    about = (
        f"spatialdyn / Pinocchio {machine['pinocchio']}. Batches of {results['samples']} on one thread, results into a "
        "given array, against `rneaInParallel` and `abaInParallel` on one thread; `crba`, which has no pool, "
        "against the barest Python loop. Single "
        "calls from Python (and of spatialdyn inside a jitted loop); "
        f"medians of interleaved rounds in one process, {machine['processor']}, Python {machine['python']}, "
        f"Numba {machine['numba']}. Starting a process, warm cache: import {results['start']['import_s']:.2f} s, first "
        f"`rnea` {results['start']['first_rnea_from_urdf_s']:.2f} s after start with a URDF to read."
    )
    return "\n".join([*lines, "", about]) + "\n"


def main() -> int:
    """Write the table, or compare. Returns 1 if --check finds another, else 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit status 1 unless the table is there")
    check = parser.parse_args().check
    text = README.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    new = before + BEGIN + table() + END + after
    if check:
        return int(new != text)
    README.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
