"""Export to C: the inverse dynamics of a robot as one C99 function without branches, loops or libraries.

Learn    specialize(...).c_code() writes the program that the library itself runs, for a microcontroller or another
         language. fixed={"v": 0, "a": 0} would leave the gravity torque alone, in a tenth of the operations.
Look at  the number of operations, and the difference to the library: no digits are lost on the way.
Needs    a C compiler called cc, to try it; without one the code is printed only
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start


def main() -> dict[str, object]:
    """Print the beginning of the code and, with a compiler, its results; returns the code and the difference."""
    model = sd.load_urdf("three_link")
    program = sd.specialize(model, sd.rnea)
    code = program.c_code("torque")
    lines = code.splitlines()
    print(f"{len(lines)} lines, operations {program.operations}\n")
    print("\n".join([*lines[:12], "    ...", *lines[-4:]]), "\n")

    compiler = shutil.which("cc")
    found: dict[str, object] = {"code": code, "difference": None}
    if compiler is None:
        print("no C compiler called cc is installed: not tried")
        return found
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "torque.c"), Path(folder, "torque.so")
        source.write_text(code, encoding="utf-8")
        subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
        torque = ctypes.CDLL(str(library)).torque
        array = np.ctypeslib.ndpointer(dtype=np.float64, flags="C_CONTIGUOUS")
        torque.argtypes, torque.restype = [array] * 4, None
        worst, rng = 0.0, np.random.default_rng(0)
        for _ in range(1000):
            q, v, a = rng.uniform(-3.0, 3.0, (3, model.nv))
            tau = np.empty(model.nv)
            torque(q, v, a, tau)
            worst = max(worst, float(abs(tau - sd.rnea(model, q, v, a)).max()))
    print(f"1000 states in C and in the library: largest difference {worst:.1e} N m")
    return found | {"difference": worst}


if __name__ == "__main__":
    start(main)
