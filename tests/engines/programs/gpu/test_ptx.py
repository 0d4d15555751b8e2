"""PTX without a GPU: only arithmetic that rounds to nearest, no calls, and registers by NVIDIA's assembler."""

from __future__ import annotations

import importlib.util
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import options
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.gpu import gpu_kernel, ptx
from spatialdyn.engines.programs.gpu.gpu_kernel import GpuKernel
from spatialdyn.engines.programs.gpu.kernel_text import NVPTX
from spatialdyn.engines.programs.gpu.thread_writer import most_live
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.errors import SpatialDynError
from spatialdyn.recursions import SPECS

TRACED = [name for name, spec in SPECS.items() if spec.traceable]
ROBOTS = ("two_link", "ur5", "panda", "kinova", "z1", "solo12")
ROUNDED = {"add", "sub", "mul", "fma", "div", "sqrt"}
EXACT = {"neg", "abs", "copysign", "selp", "setp", "mov", "ld", "st"}
ARCHITECTURE = "sm_90"
PROGRAMS = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs")


def kernel_of(model: sd.Model, call: str, dtype: Any = np.float64) -> GpuKernel:
    """The kernel of a call on a GPU."""
    made = sd.specialize(model, getattr(sd, call), dtype, device="cuda", **options(model, SPECS[call]))
    kernel: GpuKernel = made._on_device  # type: ignore[attr-defined]
    return kernel


def wrong(text: str) -> list[str]:
    """Instructions on floats of PTX that round otherwise, or that are calls."""
    found = []
    for line in text.splitlines():
        words = line.split(";")[0].split()
        words = words[1:] if words and words[0].startswith("@") else words
        word = words[0] if words else ""
        kind, *more = word.split(".")
        floats = {"f32", "f64"} & {*more}
        plain = kind in EXACT or (kind in ROUNDED and more[0] == "rn")
        if kind == "call" or {"ftz", "approx", "full"} & {*more} or (floats and not plain):
            found.append(word)
    return found + re.findall(r"\.local\b", text)


@PROGRAMS
@pytest.mark.parametrize("name", slow_but(["two_link"], ROBOTS))
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_call_is_of_instructions_that_round_to_nearest(name: str, dtype: Any) -> None:
    """A quarter of the calls of each robot in one of the types, another in the other, and the rest on the next ones."""
    model, bad = sd.load_urdf(name), {}
    turn = (ROBOTS.index(name) + 2 * (dtype == np.float32)) % 4
    for call in TRACED[turn::4]:
        if not recording.fits((SPECS[call],), model.bodies):
            continue
        text = kernel_of(model, call, dtype).ptx
        assert text.count(".entry kernel") == 1
        if wrong(text):
            bad[call] = sorted({*wrong(text)})
    assert bad == {}


def test_an_instruction_that_rounds_otherwise_is_found() -> None:
    lines = "mul.f64 %a;\n@%p1 bra L;\nadd.rn.f64 %a;\nfma.rn.ftz.f32 %a;\ndiv.full.f32 %a;\nsin.approx.f32 %a;\ncall f"
    assert wrong(lines) == ["mul.f64", "fma.rn.ftz.f32", "div.full.f32", "sin.approx.f32", "call"]


@PROGRAMS
def test_ptx_is_kept_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    k = sd.specialize(sd.load_urdf("two_link"), sd.crba, device="cuda")
    text = k.ptx
    monkeypatch.setattr(ptx, "_compiled", None)
    assert k.ptx == text


# --- orders of lines --------------------------------------------------------------------------------------


@PROGRAMS
def test_both_orders_are_tried_and_the_one_that_holds_fewer_values_first() -> None:
    kernels = [kernel_of(sd.load_urdf(name), call) for name, call in (("panda", "rnea"), ("panda", "crba"))]
    first = []
    for kernel in kernels:
        own, depth = ptx.orders(kernel.program)
        assert sorted(own) == sorted(depth) == list(range(len(own)))
        live = [most_live(kernel.program, x) for x in kernel.orders]
        assert live == sorted(live)
        first.append(kernel.orders[0] == own)
    assert first == [True, False]  # a chain's rnea by its own, its crba from the last result


def test_values_held_at_a_time_are_counted() -> None:
    tape = Tape()
    a, b, c, d = (tape.input(k) for k in range(4))
    program = Program(tape, [(a + b) * (c + d)], 4)
    assert most_live(program, range(len(program.lines))) == 4  # a + b, and at c + d its operands and the sum


@PROGRAMS
def test_a_program_too_long_for_a_thread_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_kernel, "MOST_WHOLE", 20)
    with pytest.raises(SpatialDynError, match=r'operations, expected at most 20 with device="cuda"'):
        sd.specialize(sd.load_urdf("two_link"), sd.rnea, device="cuda")


# --- by ptxas -----------------------------------------------------------------------------------------------

# registers of a thread and bytes of spills (stores and loads) as measured with ptxas 12.9 for sm_90
MEASURED = {
    ("ur5", "rnea"): ((96, 0), (56, 0)),
    ("ur5", "aba"): ((164, 0), (95, 0)),
    ("ur5", "crba"): ((58, 0), (32, 0)),
    ("panda", "rnea"): ((166, 0), (80, 0)),
    ("panda", "aba"): ((254, 0), (128, 0)),
    ("panda", "crba"): ((96, 0), (48, 0)),
    ("solo12", "rnea"): ((80, 0), (48, 0)),
    ("solo12", "aba"): ((236, 0), (147, 0)),
    ("solo12", "crba"): ((42, 0), (32, 0)),
    ("talos_full", "rnea"): ((254, 4448), (255, 136)),
    ("talos_full", "aba"): ((255, 19432), (255, 5456)),
    ("talos_full", "crba"): ((254, 0), (128, 0)),
}  # in float64, and in float32
MORE = 1.1  # another version of the assembler may need a little more
QUICK = ("ur5", "rnea")


def assembler() -> str:
    """The path of ptxas of the wheel."""
    found = importlib.util.find_spec("nvidia") and importlib.util.find_spec("nvidia.cuda_nvcc")
    for folder in found.submodule_search_locations or () if found else ():
        if (Path(folder) / "bin" / "ptxas").exists():
            return str(Path(folder) / "bin" / "ptxas")
    pytest.skip("no wheel of ptxas for this system")


def measured(text: str, folder: Path) -> tuple[int, int]:
    """Registers and bytes of spills of PTX."""
    (folder / "k.ptx").write_text(text)
    done = subprocess.run(
        [assembler(), f"-arch={ARCHITECTURE}", "-v", str(folder / "k.ptx"), "-o", str(folder / "k.cubin")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    stores, loads = map(int, re.findall(r"(\d+) bytes spill", done.stderr))
    return int(re.findall(r"Used (\d+) registers", done.stderr)[0]), stores + loads


@PROGRAMS
@pytest.mark.parametrize(("name", "call"), slow_but([QUICK], MEASURED))
def test_registers_and_spills_are_no_more_than_measured(name: str, call: str, tmp_path: Path) -> None:
    model = sd.load_urdf(name)
    for dtype, (registers, spilled) in zip((np.float64, np.float32), MEASURED[name, call], strict=True):
        found = measured(kernel_of(model, call, dtype).ptx, tmp_path)
        assert found[0] <= min(255, MORE * registers)
        assert found[1] <= MORE * spilled


@PROGRAMS
def test_of_both_orders_the_first_takes_fewer_registers(tmp_path: Path) -> None:
    kernel = kernel_of(sd.load_urdf("panda"), "rnea")
    first, second = (measured(ptx.ptx(kernel.text(NVPTX, order)), tmp_path) for order in (0, 1))
    assert first < second
