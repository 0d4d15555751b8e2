"""Compilers of exports: of this machine, of aarch64 and of a Cortex-M7, and programs that run what they make."""

from __future__ import annotations

import importlib.util
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror", "-Isrc")
BARE = ("-ffreestanding", "-nostdlib", "-static", "-fno-stack-protector", "-Wl,-e,_start")  # no C library is needed
HAS_ZIG = importlib.util.find_spec("ziglang") is not None
FUSED = ("-mfma",) if platform.machine() in ("x86_64", "AMD64") else ()
RIGHT = 42  # what a bare program ends with where every answer is found, to the bit


class Chip(NamedTuple):
    """A target of zig's compiler, and the program that runs what is made for it."""

    target: str
    cpu: str
    runner: str


CHIPS = {
    "aarch64": Chip("aarch64-linux-none", "generic", "qemu-aarch64"),
    "cortex_m7": Chip("thumb-freestanding-eabihf", "cortex_m7+fp_armv8d16", "qemu-arm"),  # its double-precision unit
}
START = """
#include "{name}.h"
void _start(void);
void _start(void)
{{
    int exact, count;
    const int wrong = {name}_check(&exact, &count);
    const long status = wrong ? 100 + wrong : exact == count ? {right} : exact;
#if defined(__aarch64__)
    __asm__ volatile("mov x0, %0\\n\\tmov x8, #93\\n\\tsvc #0" : : "r"(status) : "x0", "x8");
#else
    __asm__ volatile("mov r0, %0\\n\\tmov r7, #1\\n\\tsvc #0" : : "r"(status) : "r0");
#endif
    for (;;) {{
    }}
}}
"""


def compiled_here(folder: Path, name: str = "robot", options: tuple[str, ...] = FUSED, level: str = "-O1") -> str:
    """What the check of an export prints, compiled on this machine without a warning."""
    sources = [f"src/{name}.c", f"src/{name}_check.c", "check/main.c"]
    command = ["cc", level, *STRICT, *options, "-fno-math-errno", *sources, "-o", "main"]
    subprocess.run(command, cwd=folder, check=True)
    return subprocess.run([folder / "main"], check=True, capture_output=True, text=True).stdout


def zig(*words: str, folder: Path) -> None:
    """Run zig's C compiler."""
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *words], cwd=folder, check=True)


def compiled_for(chip: Chip, folder: Path, name: str = "robot") -> int | None:
    """The exit status of an export's check on a chip, compiled without a warning; None if nothing runs it here."""
    (folder / "start.c").write_text(START.format(name=name, right=RIGHT))
    target = ("-target", chip.target, f"-mcpu={chip.cpu}", "-O1", "-fno-math-errno", "-fno-sanitize=all")
    zig(*target, *STRICT, *BARE, f"src/{name}.c", f"src/{name}_check.c", "start.c", "-o", "bare", folder=folder)
    if shutil.which(chip.runner) is None:
        return None
    return subprocess.run([chip.runner, folder / "bare"], check=False).returncode
