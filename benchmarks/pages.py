"""Write what the pages of ``spatialdyn/docs`` show: the page of figures, what code blocks print, pictures they draw.

python benchmarks/pages.py             write the page of figures from the JSON of the benchmarks
python benchmarks/pages.py PAGE ...    run the code of pages and write what it prints and draws; ``--all`` for all

Text with ``...`` that agrees with what was printed stays. Read what changed before it is committed: the tests hold that
it is printed again, not that it is right.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

from spatialdyn.commands import cli
from spatialdyn.docs import blocks

HERE = Path(__file__).parent
PAGE = blocks.PAGES / "how_fast_how_right.md"
PICTURES = blocks.PAGES.parent / "pictures" / "pages"
CHAINS = (  # of the table of errors
    "10 rods, spatial", "100 rods, spatial", "1000 rods, spatial", "7 rods, spatial, tip 1000",
    "7 rods, spatial, tip 1e+06", "7 rods, spatial, tip 1e+12", "7 rods, spatial, light tip 1e-06",
    "7 rods, spatial, alternating 1e-06", "7 links, spatial, tip 1000",
)  # fmt: skip
COMPILED = ("rnea", "aba")


def read(name: str) -> dict[str, Any]:
    """The figures of a benchmark."""
    found: dict[str, Any] = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    return found


def rows(head: list[str], body: list[list[str]]) -> list[str]:
    """A table in Markdown."""
    return ["| " + " | ".join(x) + " |" for x in [head, ["---"] * len(head), *body]] + [""]


def machine(found: dict[str, Any]) -> str:
    """What figures are of, in words."""
    m = found["machine"]
    return (
        f"{m['processor']} with {m['cores']} cores, {m['system']}, Python {m['python']}, NumPy {m['numpy']}, Numba "
        f"{m['numba']}, Pinocchio {m['pinocchio']}"
    )


def figures() -> str:
    """The page "How fast, how right"."""
    results, lagrange, forward = read("results"), read("lagrange"), read("forward")
    lines = [
        "# How fast, how right", "",
        "This page is written by `benchmarks/pages.py` out of the figures that the benchmarks keep in the repository. "
        "Run `python benchmarks/run.py` for those of your machine: it asserts that results are equal before it times "
        "them.", "", f"Machine: {machine(results)}. One thread unless said; medians of interleaved rounds.", "",
        "## Batches", "",
        f"Nanoseconds a sample in a batch of {results['samples']}, results into a given array. Pinocchio's `rnea` and "
        "`aba` are its parallel calls on one thread, `crba` the barest Python loop. \"float32\" is "
        "`sd.specialize(..., dtype=np.float32)`, its error relative to the largest entry.", "",
    ]  # fmt: skip
    body = [
        [robot, f"`{call}`", f"{t['ours_ns']:.0f}", f"{t['ours_2_threads_ns']:.0f}", f"{t['float32_ns']:.0f}",
         f"{t['float32_error']:.0e}", f"{t['pin_ns']:.0f}", f"{t['ratio']:.1f}"]
        for robot, calls in results["batch"].items() for call, t in calls.items()
    ]  # fmt: skip
    lines += rows(["robot", "call", "spatialdyn", "2 threads", "float32", "its error", "Pinocchio", "ratio"], body)
    lines += ['"anymal, floating" is `sd.load_urdf("anymal", root="floating")`.', "", "## One call", ""]
    lines += ['Microseconds from Python; "in @njit" is `sd.kernels` in a loop of your own that Numba compiles.', ""]
    body = [
        [robot, f"`{call}`", *(f"{t[x]:.2f}" for x in ("ours_us", "jitted_us", "pin_us", "ratio"))]
        for robot, calls in results["single"].items() for call, t in calls.items()
    ]  # fmt: skip
    lines += rows(["robot", "call", "spatialdyn", "in @njit", "Pinocchio", "spatialdyn / Pinocchio"], body)
    lines += peers()
    lines += ["## Before the first answer", "", "Seconds in a new process.", ""]
    body = [[name[:-2].replace("_", " "), f"{t:.2f}"] for name, t in results["start"].items()]
    body += [
        [f"compile the program of {robot}'s `{call}`, then from disk", f"{t['compile_s']:.2f}, {t['from_disk_s']:.3f}"]
        for robot, calls in results["compile"].items() for call, t in calls.items() if call in COMPILED
    ]  # fmt: skip
    lines += rows(["what", "s"], body)
    lines += [
        "## Errors of forward dynamics", "",
        "Relative to the largest acceleration, over random states, against double-double arithmetic "
        "(`benchmarks/forward.py`). \"One ulp\" is what a change of the inputs in their last bit does to the exact "
        "answer: no method can be expected to do better. \"Tip 1000\": the last link has 1000 times the mass of the "
        "others; \"light\": so much less; \"alternating\": every other one. `aba_refined` and `aba_square_root` are "
        "calls for such robots.", "",
    ]  # fmt: skip
    names = list(next(iter(forward["errors"].values())))[1:]
    body = [
        [robot, *(f"{e[x]['worst']:.0e}" if x in e else "" for x in names)]
        for robot, e in forward["errors"].items() if robot in CHAINS
    ]  # fmt: skip
    lines += rows(["robot, worst of the states", *(f"`{x}`" if x != "one ulp" else x for x in names)], body)
    lines += [
        "## Energy of long runs", "",
        f"Machine: {machine(lagrange)}." if "machine" in lagrange else "", "",
        "Largest error of the energy [J] in the first and the second half of 100 s without friction "
        "(`benchmarks/integrators.py`). A symplectic method's error stays; another's grows.", "",
    ]  # fmt: skip
    body = [
        [x["robot"], f"`{x['method']}`", f"{x['dt']:g}", f"{x['first_half']:.1e}", f"{x['second_half']:.1e}"]
        for x in read("integrators")["textbook"]
    ]  # fmt: skip
    lines += rows(["robot", "method", "dt [s]", "first half", "second half"], body)
    lines += [
        "## Where the figures are not good", "",
        "Calls that are slower than Pinocchio's, in the tables above:", "",
    ]  # fmt: skip
    slower = [
        f"* one `{call}` of {robot}: {t['ours_us']:.2f} µs, Pinocchio {t['pin_us']:.2f} µs"
        for robot, calls in results["single"].items() for call, t in calls.items() if t["ratio"] > 1.0
    ]  # fmt: skip
    slower += [
        f"* a batch of `{call}` of {robot}: {t['ours_ns']:.0f} ns, Pinocchio {t['pin_ns']:.0f} ns"
        for robot, calls in results["batch"].items() for call, t in calls.items() if t["ratio"] < 1.0
    ]  # fmt: skip
    lines += [*(slower or ["* none"]), ""]
    batches = [t for calls in results["batch"].values() for t in calls.values()]
    alike = sum(t["ours_2_threads_ns"] > 0.9 * t["ours_ns"] for t in batches)
    lines += [
        f"A second thread saves less than a tenth of the time in {alike} of the {len(batches)} batches: those of small "
        "robots are too short at this size.", "",
    ]  # fmt: skip
    return "\n".join(lines)


def peers() -> list[str]:
    """The tables of ``benchmarks/peers.py``."""
    found = read("peers")
    every = [(robot, call, t) for robot, calls in found["calls"].items() for call, t in calls.items()]
    timed = [x for x in found["peers"] if any("error" in t.get(x, {}) for _, _, t in every)]
    lines = [
        "## Other libraries, each in its own environment", "",
        f"`benchmarks/peers.py` on {found['machine']['processor']}, on one core: one process a library, which take "
        f"turns; medians of processor time of {found['rounds']} rounds, after all results were found equal to 1e-10. "
        "Libraries without a batch of their own take one sample after the other in Python; of MJX and Brax a batch is "
        "of 512.", "",
    ]  # fmt: skip
    for way, what in {"single": "one call from Python", "batch": f"a sample of a batch of {found['samples']}"}.items():
        us = [[t.get(name, {}).get(f"{way}_us") for name in timed] for _, _, t in every]
        body = [
            [robot, f"`{call}`", *("" if x is None else f"{x:.3g}" for x in times)]
            for (robot, call, _), times in zip(every, us, strict=True)
        ]
        lines += rows([f"µs of {what}", "", *timed], body)
    lines += ["Versions, and what has no figures:", ""]
    for name, version in found["peers"].items():
        reasons = dict.fromkeys(t[name]["refused"] for _, _, t in every if "refused" in t.get(name, {}))
        lines.append(f"* {name}: " + "; ".join([version or "this version", *reasons]))
    return [*lines, ""]


def filled(page: str) -> str:
    """The text of a page with what its code prints; its pictures are kept."""
    names: dict[str, Any] = {"__name__": page}
    text, made, at = blocks.read(page), [], 0
    home = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for found in blocks.FENCE.finditer(text):
                made.append(text[at : found.start()])
                at = found.end()
                block = blocks.Block(found[1], found[2], found[3], text.count("\n", 0, found.start()) + 1)
                printed = blocks.printed(block, page, cli.main, names)
                if block.language not in blocks.RUN or blocks.agree(block.says or "", printed):
                    made.append(found[0])
                else:
                    clean = re.sub(r"[ \t]+$", "", printed, flags=re.MULTILINE).strip("\n")
                    made.append(f"```{block.language}\n{block.text}```\n\n```text\n{clean}\n```")
            PICTURES.mkdir(parents=True, exist_ok=True)
            for picture in Path(folder).glob("*.png"):
                shrink(picture, PICTURES / picture.name)
        finally:
            os.chdir(home)
    return "".join(made) + text[at:]


def shrink(path: Path, to: Path) -> None:
    """Write a picture again, by a palette."""
    from PIL import Image

    shutil.copy(path, to)
    Image.open(path).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(to, optimize=True)


def main() -> None:
    """Write the page of figures, or fill pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="pages to fill; the page of figures if none is named")
    parser.add_argument("--all", action="store_true", help="fill all pages")
    asked = parser.parse_args()
    names = blocks.pages() if asked.all else asked.pages
    if not names:
        PAGE.write_text(figures(), encoding="utf-8")
    for name in names:
        with contextlib.redirect_stderr(io.StringIO()):
            text = filled(name)
        (blocks.PAGES / f"{name}.md").write_text(text, encoding="utf-8")
        print(f"wrote {name}")


if __name__ == "__main__":
    main()
