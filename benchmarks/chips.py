"""Sizes of exported code on chips, and whether it finds the library's bits there; the page "Platforms".

    python benchmarks/chips.py             write chips.json, and the page from it
    python benchmarks/chips.py --page      write the page alone

Each call is exported alone, compiled by zig's clang with -O2 and measured in its object file; where an emulator is
installed (qemu-user), its check runs.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.docs import blocks

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "embedded"))
import chips

HERE, PAGE = Path(__file__).with_suffix(".json"), blocks.PAGES / "platforms.md"
ROBOTS = ("two_link", "ur5", "panda")
CALLS: dict[str, Any] = {"rnea": sd.rnea, "aba": sd.aba, "computed_torque": "computed_torque"}
OPTIONS = (
    "-O2",
    "-std=c99",
    "-Isrc",
    "-ffreestanding",
    "-fno-math-errno",
    "-fno-sanitize=all",
    "-Wframe-larger-than=1",
)
ALLOCATED, WRITTEN, NOBITS = 2, 1, 8  # of sections of an object file


def sizes(path: Path) -> dict[str, int]:
    """Bytes of text and constants, of data, and of bss, of an ELF object."""
    whole = path.read_bytes()
    wide = whole[4] == 2
    at = struct.unpack_from("<Q" if wide else "<I", whole, 40 if wide else 32)[0]
    step, count = struct.unpack_from("<HH", whole, 58 if wide else 46)
    found = {"text": 0, "data": 0, "bss": 0}
    for k in range(count):
        if wide:
            _, kind, flags, _, _, size = struct.unpack_from("<IIQQQQ", whole, at + k * step)
        else:
            _, kind, flags, _, _, size = struct.unpack_from("<IIIIII", whole, at + k * step)
        if flags & ALLOCATED:
            found["bss" if kind == NOBITS else "data" if flags & WRITTEN else "text"] += size
    return found


def measured(robot: str, call: str, chip: str, kind: str, folder: Path) -> dict[str, Any]:
    """Sizes of a call on a chip, its stack, and how its check ends."""
    cpu = chips.CHIPS[chip]
    sd.export(sd.load_urdf(robot), {call: CALLS[call]}, folder, dtype=np.dtype(kind))
    target = ("-target", cpu.target, f"-mcpu={cpu.cpu}")
    words = [sys.executable, "-m", "ziglang", "cc", *target, *OPTIONS, "-c", "src/robot.c", "-o", "robot.o"]
    said = subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True).stderr
    frames = re.findall(rf"stack frame size \((\d+)\) exceeds limit \(\d+\) in 'robot_{call}'", said)
    status = chips.compiled_for(cpu, folder)
    ran = {None: "not run", chips.RIGHT: "all bits"}.get(status, f"ended with {status}")
    return {**sizes(folder / "robot.o"), "stack": int(frames[0]) if frames else 0, "check": ran}


def page(found: list[dict[str, Any]]) -> str:
    """The page."""
    lines = [
        "# Platforms", "",
        "This page is written by `benchmarks/chips.py`. What is checked is checked by a test or a script of the "
        "repository, which is named; what is not is listed.", "",
        "## Python and NumPy", "",
        "* CI's matrix is Python 3.10 to 3.14 on Linux, macOS and Windows, 3.14 without the GIL on Linux, and the "
        "oldest NumPy (1.26), Numba and yourdfpy with Python 3.10.",
        "* `python benchmarks/versions.py` runs README's first answer and some tests on every interpreter that is on "
        "the machine, with the newest and the oldest dependencies, and names those that are not there.",
        "* Without the GIL the compiled builtins are not used: Python checks arguments, and answers are the same.",
        "", "## Processors", "",
        "* Programs use vectors of SSE2, AVX2 or AVX-512, or of NEON. `tests/engines/compiled/test_target.py` makes "
        "code for each that the processor has: AVX2 and AVX-512 agree to the bit, and so does any processor with fused "
        "multiply-add. SSE2 has none: it agrees to rounding, and a study's manifest refuses to mix the two.",
        "* Numba's settings choose for all code, as for machines that share a cache or that are to agree:", "",
    ]  # fmt: skip
    lines += ["  `NUMBA_CPU_NAME=x86-64-v3 NUMBA_CPU_FEATURES=+avx2,+fma python script.py`", ""]
    lines += [
        "## Chips", "",
        "Exported C ([C code for a controller](cookbook/c_code.md)), each call alone, by clang with -O2, in bytes of "
        "code and constants, and of stack. `data` and `bss` are 0 for all: nothing is kept between calls. \"All "
        "bits\": its check ran under QEMU and found every recorded answer to the bit.", "",
    ]  # fmt: skip
    head = ["robot", "call", "type", *(f"{c}: {what}" for c in chips.CHIPS for what in ("text", "stack", "check"))]
    rows = []
    for robot in ROBOTS:
        for call in CALLS:
            for kind in ("float64", "float32"):
                cells = [robot, f"`{call}`", "double" if kind == "float64" else "float"]
                for chip in chips.CHIPS:
                    (x,) = (
                        y
                        for y in found
                        if [y[z] for z in ("robot", "call", "chip", "kind")] == [robot, call, chip, kind]
                    )
                    assert x["data"] == x["bss"] == 0
                    cells += [str(x["text"]), str(x["stack"]), x["check"]]
                rows.append(cells)
    lines += ["| " + " | ".join(x) + " |" for x in [head, ["---"] * len(head), *rows]]
    lines += [
        "", "## Not checked", "",
        "* Exported code on a real board, by the compilers of Arduino and ESP-IDF, and by MSVC: the layouts follow "
        "their documents.",
        "* The times of exported code on a chip: QEMU counts none.",
        "* Processors without fused multiply-add other than by forcing SSE2; 32-bit hosts; big-endian machines.",
        "* Windows on ARM and macOS on Intel: wheels of the dependencies exist for the first, nothing ran.",
        "* A GPU: none has run what `device=\"cuda\"` makes; what is held without one is listed in "
        "[On a GPU](cookbook/gpu.md).", "",
    ]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Measure, and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", action="store_true", help="write the page alone")
    if not parser.parse_args().page:
        found = []
        for robot in ROBOTS:
            for call in CALLS:
                for chip, cpu in chips.CHIPS.items():
                    for kind in ("float64", "float32"):
                        with tempfile.TemporaryDirectory() as folder:
                            x = measured(robot, call, chip, kind, Path(folder))
                        found.append({"robot": robot, "call": call, "chip": chip, "kind": kind, **x})
                        print(found[-1], "" if shutil.which(cpu.runner) else f"no {cpu.runner}", flush=True)
        zig = subprocess.run([sys.executable, "-m", "ziglang", "version"], capture_output=True, text=True, check=True)
        HERE.write_text(json.dumps({"zig": zig.stdout.strip(), "sizes": found}, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(json.loads(HERE.read_text(encoding="utf-8"))["sizes"]), encoding="utf-8")


if __name__ == "__main__":
    main()
