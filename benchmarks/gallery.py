"""Pictures and times of the gallery, for the pages of ``spatialdyn docs``.

python benchmarks/gallery.py [NAME ...]

Each example runs twice in a process of its own, in its quick setting where it has one. The second run, whose code is
on disk by then, is the one that counts: its processor time, start of Python and imports included. Pictures go to
``spatialdyn/docs/pictures/gallery``, times to ``spatialdyn/docs/gallery.json``.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba

from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.examples import gallery

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "spatialdyn" / "docs"
PICTURES, TIMES = DOCS / "pictures" / "gallery", DOCS / "gallery.json"
COLOURS = 128  # of a picture's palette: a third of the bytes


def machine() -> dict[str, Any]:
    """What the times are of."""
    return {
        "processor": numba.core.config.CPU_NAME or host_cpu.host()[0],
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numba": numba.__version__,
    }


def measured(name: str) -> dict[str, Any]:
    """Draw an example's picture, if it has one; its processor time [s] and setting."""
    has = inspect.signature(gallery.module(name).main).parameters
    words = [sys.executable, "-m", f"spatialdyn.examples.{name}", *(["--quick"] if "quick" in has else [])]
    drawn = PICTURES / f"{name}.png"
    for more in (["--save", str(drawn)] if "save" in has else [], []):
        before = os.times()
        subprocess.run([*words, *more], check=True, stdout=subprocess.DEVNULL)
        after = os.times()
    if "save" in has:
        shrink(drawn)
    seconds = after.children_user - before.children_user + after.children_system - before.children_system
    return {"seconds": round(seconds, 2), "quick": "quick" in has, "picture": "save" in has}


def shrink(path: Path) -> None:
    """Write a picture again, by a palette."""
    from PIL import Image

    Image.open(path).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def main() -> None:
    """Measure the examples that are named, or all, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="examples; all if none is named")
    names = parser.parse_args().names
    PICTURES.mkdir(parents=True, exist_ok=True)
    found = json.loads(TIMES.read_text(encoding="utf-8")) if TIMES.exists() else {"examples": {}}
    for name in names or gallery.names():
        try:
            found["examples"][name] = measured(name)
            print(name, found["examples"][name], flush=True)
        except subprocess.CalledProcessError as error:
            print(f"{name}: exit status {error.returncode}", file=sys.stderr)
    found = {
        "machine": machine(),
        "examples": {x: found["examples"][x] for x in gallery.names() if x in found["examples"]},
    }
    TIMES.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
