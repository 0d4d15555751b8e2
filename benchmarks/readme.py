"""Write what README.md and the pages of figures take from the code and the kept results of benchmarks.

python benchmarks/readme.py              README's table and counts, the pages of figures
python benchmarks/readme.py --measure    run the benchmarks behind them first, which wants a quiet machine
python benchmarks/readme.py --measure run.py studies.py    run these alone
python benchmarks/readme.py --check      write nothing; exit status 1 unless README is as it would be written
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

import mutants

from spatialdyn.examples import gallery

MEASURED = (  # what README's table and the pages of figures are made of
    "run.py", "lagrange.py", "integrators.py", "forward.py --json forward.json", "tradeoff.py",
    "studies.py --write", "chips.py", "peers.py",
)  # fmt: skip
PAGES = ("pages.py", "scale.py --write", "chips.py --page")
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


def counted(text: str) -> str:
    """A text with the numbers of faults and examples that there are."""
    text = re.sub(r"\b\d+ faults", f"{len(mutants.faults())} faults", text)
    return re.sub(r"\b\d+ short programs", f"{len(gallery.names())} short programs", text)


def written(text: str) -> str:
    """README with the measured table and the counts."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return counted(before + BEGIN + table() + END + after)


def scripts(names: tuple[str, ...]) -> None:
    """Run benchmarks of this folder, one after the other."""
    for name in names:
        print(name, flush=True)
        subprocess.run([sys.executable, *name.split()], cwd=HERE, check=True)


def main() -> int:
    """Write the table, the counts and the pages, or compare. Returns 1 if --check finds other text, else 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [x.split()[0] for x in MEASURED]
    parser.add_argument("--measure", nargs="*", choices=known, metavar="SCRIPT", help="run all of them first, or these")
    parser.add_argument("--check", action="store_true", help="write nothing; exit status 1 where README would change")
    given = parser.parse_args()
    text = README.read_text(encoding="utf-8")
    if given.check:
        return int(written(text) != text)
    if given.measure is not None:
        scripts(tuple(x for x in MEASURED if not given.measure or x.split()[0] in given.measure))
    README.write_text(written(text), encoding="utf-8")
    scripts(PAGES)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
