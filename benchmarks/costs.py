"""Times to start, compile and load, and memory, measured in fresh processes with caches of their own."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from cases import CALLS, ROBOTS, deepest, load

from spatialdyn.urdf.load import find_robot

FIRST = """
import time; start = time.perf_counter()
import spatialdyn as sd; imported = time.perf_counter()
import pickle, sys, warnings, numpy as np; warnings.simplefilter("ignore")
model = pickle.load(open(sys.argv[2], "rb")) if sys.argv[1] == "pickle" else sd.load_urdf(sys.argv[2])
sd.rnea(model, sd.neutral(model), np.zeros(model.nv), np.zeros(model.nv))
print(imported - start, time.perf_counter() - start)
"""

COMPILE = """
import json, pickle, sys, spatialdyn as sd
model, names, options = pickle.load(open(sys.argv[1], "rb")), sys.argv[2].split("+"), json.loads(sys.argv[3])
calls = [getattr(sd, name) for name in names]
k = sd.specialize(model, calls if len(calls) > 1 else calls[0], **options)
print(json.dumps([k.compile_seconds, k.engine]))
"""

MEMORY = """
import json, pickle, sys, numpy as np, spatialdyn as sd
model, name, B = pickle.load(open(sys.argv[1], "rb")), sys.argv[2], int(sys.argv[3])
letters = {"crba": 1, "rnea": 3, "aba": 3}[name]
rng = np.random.default_rng(0)
inputs = [np.empty((B, n)) for n in (model.nq, model.nv, model.nv)[:letters]]
for x in inputs:
    rng.random(out=x)
out = np.zeros((B, model.nv, model.nv) if name == "crba" else (B, model.nv))
out[:] = 1.0  # its pages are there
call, few = getattr(sd, name), 1024
call(model, *(x[:few] for x in inputs), out=out[:few])  # compiled


def status(word):
    return next(int(s.split()[1]) << 10 for s in open("/proc/self/status") if s.startswith(word))


open("/proc/self/clear_refs", "w").write("5")  # the peak starts from what is held now
before = status("VmRSS:")
call(model, *inputs, out=out)
held = sum(x.nbytes for x in inputs) + out.nbytes
print(json.dumps([max(0, status("VmHWM:") - before), held]))
"""


def starting(rounds: int) -> dict[str, float]:
    """Seconds of a fresh process with a warm cache: of the import, and from start to the first torque."""
    path = str(find_robot("panda"))
    with tempfile.TemporaryDirectory() as folder:
        pickled = _pickled(folder, "panda", "fixed")
        taken: dict[str, list[float]] = {"import_s": [], "first_rnea_from_pickle_s": [], "first_rnea_from_urdf_s": []}
        for _ in range(rounds + 1):
            for way, source in (("pickle", pickled), ("urdf", path)):
                imported, first = map(float, _run(FIRST, way, source).split())
                taken["import_s"].append(imported)
                taken[f"first_rnea_from_{way}_s"].append(first)
    return {name: float(np.median(values[2:])) for name, values in taken.items()}


def compiling(robots: dict[str, Iterable[str]], tell: Any) -> dict[str, dict[str, dict[str, Any]]]:
    """Seconds of ``specialize`` with its program, each in a fresh process: compiled, then loaded from disk."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for robot, calls in robots.items():
        model = load(str(find_robot(ROBOTS[robot][0])), root=ROBOTS[robot][1])
        found[robot] = {}
        for call in calls:
            options = {"frame": f"joint:{deepest(model)}"} if call == "kinematics" else {}
            with tempfile.TemporaryDirectory() as folder:
                pickled = _pickled(folder, *ROBOTS[robot])
                names = "+".join(CALLS[call].ours)
                cold, disk = (
                    json.loads(_run(COMPILE, pickled, names, json.dumps(options), cache=folder)) for _ in range(2)
                )
            found[robot][call] = {"compile_s": cold[0], "from_disk_s": disk[0], "engine": cold[1]}
            tell()
    return found


def memory(samples: int) -> dict[str, dict[str, float]] | None:
    """Peak megabytes of a batched ur5 call beyond its inputs and result; None if not on Linux."""
    if not Path("/proc/self/clear_refs").exists():
        return None
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        pickled = _pickled(folder, "ur5", "fixed")
        for call in ("rnea", "aba", "crba"):
            extra, held = json.loads(_run(MEMORY, pickled, call, str(samples)))
            found[call] = {"samples": samples, "extra_mb": extra / 2**20, "arrays_mb": held / 2**20}
    return found


def _pickled(folder: str, robot: str, root: str) -> str:
    path = Path(folder) / "model.pickle"
    path.write_bytes(pickle.dumps(load(str(find_robot(robot)), root=root)))
    return str(path)


def _run(code: str, *arguments: str, cache: str = "") -> str:
    """The output of a fresh Python."""
    here = Path(__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(here), os.environ.get("PYTHONPATH", "")])}
    if cache:
        environment["NUMBA_CACHE_DIR"] = cache
    command = [sys.executable, "-W", "ignore", "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
