"""Code for a lesser processor than this one, as Numba's settings name it: the same bits wherever products are fused."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding

from spatialdyn.engines.compiled import numba_kernels, target

LEVELS = {  # name, features, bytes of a vector, whether products are fused
    "sse2": ("x86-64", "+sse2", 16, False),
    "avx2": ("x86-64-v3", "+avx2,+fma", 32, True),
    "avx512": ("x86-64-v4", "+avx512f,+avx2,+fma", 64, True),
}
HOST = binding.get_host_cpu_features()
HERE = [name for name, x in LEVELS.items() if all(HOST.get(f) for f in x[1].replace("+", "").split(","))]
pytestmark = [
    pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="no x86-64 processor"),
    pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled"),
]
ROUNDING = 1e-12  # of the largest entry: products rounded apart
CODE = """
import sys
import numpy as np
import spatialdyn as sd
from spatialdyn.engines.programs.llvm import host_cpu

model, rng = sd.load_urdf("three_link"), np.random.default_rng(3)
q, v, a = rng.normal(size=(3, 301, model.nv))
made = {"host": np.array(host_cpu.host()[2:], int)}
for name in ("rnea", "crba", "aba"):
    made[name] = sd.specialize(model, getattr(sd, name))(*(q, v, a)[: 1 if name == "crba" else 3])
made["float32"] = sd.specialize(model, sd.rnea, np.float32)(q, v, a)
made["rollout"] = sd.rollout(model, q, v, a[:, None], dt=1e-3, steps=5).q
if sys.argv[2] == "kernels":
    made["one"] = np.stack([sd.crba(model, x) for x in q])
    made["kernel"] = np.stack([sd.aba(model, *x) for x in zip(q[:9], v, a)])
    made["turn"] = sd.frame_placement(model, q, model.frames[-1])
np.savez(sys.argv[1], **made)
"""


def results(level: str, folder: Path, what: str) -> dict[str, np.ndarray]:
    """Of a process of its own whose code is for a level."""
    name, features, width, fused = LEVELS[level]
    env = {**os.environ, "NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features}
    subprocess.run([sys.executable, "-c", CODE, folder / f"{level}.npz", what], env=env, check=True)
    with np.load(folder / f"{level}.npz") as file:
        found = dict(file)
    assert found.pop("host").tolist() == [width, fused]
    return found


def compared(folder: Path, what: str) -> None:
    """Levels that fuse agree to the bit, the others to rounding."""
    found = {level: results(level, folder, what) for level in HERE}
    best = found[HERE[-1]]
    for level, each in found.items():
        for name, x in each.items():
            if LEVELS[level][3]:
                np.testing.assert_array_equal(x, best[name], err_msg=f"{level} {name}")
            else:
                close = ROUNDING if x.dtype == np.float64 else 1e-4
                np.testing.assert_allclose(x, best[name], rtol=0.0, atol=close * abs(best[name]).max())


@pytest.mark.skipif(len(HERE) < 2, reason="a processor of one level")
def test_lesser_processors_have_the_bits_of_this_one(tmp_path: Path) -> None:
    compared(tmp_path, "programs")


@pytest.mark.skipif(len(HERE) < 2, reason="a processor of one level")
@pytest.mark.slow(quick="test_lesser_processors_have_the_bits_of_this_one")
def test_kernels_of_lesser_processors_have_the_bits_of_this_one(tmp_path: Path) -> None:
    compared(tmp_path, "kernels")


def test_a_target_has_what_its_features_say() -> None:
    made = target.Target("x", "+avx2,-avx512f,+fma")
    assert made.has("avx2")
    assert not made.has("avx512f")
    assert not made.has("avx")
    assert made.fused
    assert not target.Target("x", "-fma").fused
