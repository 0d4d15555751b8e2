"""Programs on a GPU: samples a second, bits against the CPU's lanes, shares of bandwidth and of the multiply-add peak.

    python benchmarks/gpu.py [--quick] [--urdf FILE ...] [--save FILE]

Arrays lie on the device, of CuPy or PyTorch. Bits are compared on samples among which some are odd, before anything is
timed. The limits are measured on the card too: a copy of an array, and independent chains of multiply-adds. Without a
GPU it says so, and measures nothing.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.engines.programs.gpu.arrays import LIBRARIES, Library
from spatialdyn.engines.programs.gpu.cuda import Cuda
from spatialdyn.engines.programs.gpu.gpu_kernel import GpuKernel, Rows
from spatialdyn.engines.programs.llvm.llvm_vectors import COSINE, HALF_PI, SINE
from spatialdyn.engines.programs.record.kernel_layout import KernelLayout
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape

SAMPLES, ROUNDS = 1 << 22, 20  # a launch of some ms at 1 G samples/s
COMPARED = 4096  # samples whose bits are compared
CHAINS, DEEP = 8, 512  # of multiply-adds
STEPS = 200  # of a rollout
ROLLOUTS = 1 << 18
COPIED, CHAINED = 1 << 27, 1 << 22  # samples of the limits
CALLS = ("rnea", "aba", "crba")
SINCOS = {x: 15 + 2 * (len(HALF_PI[x, True]) + len(SINE[x]) + len(COSINE[x]) - 2) for x in ("double", "float")}


def library() -> Library:
    """PyTorch's or CuPy's arrays on the first GPU. Exits where there is none."""
    for name in ("cupy", "torch"):
        try:
            module = importlib.import_module(name)
            like = module.ones(1, device="cuda") if name == "torch" else module.ones(1)
        except Exception as error:
            print(f"{name}: {type(error).__name__}: {error}".splitlines()[0], file=sys.stderr)
            continue
        return LIBRARIES[name](like)
    print("no GPU with PyTorch or CuPy here: nothing is measured")
    raise SystemExit(0)


def seconds(device: Cuda, work: Callable[[], Any], rounds: int) -> float:
    """Time of a run of ``work``, in a row of so many; the best of three rows."""
    work()
    best = float("inf")
    for _ in range(3):
        device.wait(0, STREAM[0])
        began = time.perf_counter()
        for _ in range(rounds):
            work()
        device.wait(0, STREAM[0])
        best = min(best, (time.perf_counter() - began) / rounds)
    return best


STREAM = [0]


def address(device: Cuda, x: Any) -> int:
    """Where an array lies."""
    from spatialdyn.engines.programs.gpu.arrays import read

    return read("x", x, device.stream_for_dlpack(STREAM[0])).address


def bandwidth(device: Cuda, own: Library) -> float:
    """GB/s read and written by a program that copies rows of one number."""
    tape = Tape()
    kernel = GpuKernel(Program(tape, [tape.input(0)], 1), KernelLayout((1,), ((0,),)), np.float64)
    n = COPIED
    x, y = own.upload(np.ones(n)), own.empty((n,), np.float64)
    flags, count = own.empty((n,), np.uint8), own.zero()
    where = [address(device, a) for a in (x, y, flags, count)]
    spent = seconds(
        device, lambda: kernel.batch(device, 0, n, [Rows(where[0], 1)], where[1:2], *where[2:], STREAM[0]), 10
    )
    return 17 * n / spent / 1e9


def peak(device: Cuda, own: Library, dtype: Any) -> float:
    """TFLOP/s of independent chains of multiply-adds."""
    tape = Tape()
    x = [tape.input(k) for k in range(CHAINS + 1)]
    chains = x[1:]
    for _ in range(DEEP):
        chains = [c * x[0] + x[1 + k] for k, c in enumerate(chains)]
    kernel = GpuKernel(
        Program(tape, [sum(chains[1:], chains[0])], CHAINS + 1), KernelLayout((CHAINS + 1,), ((0,),)), dtype
    )
    n = CHAINED
    given, out = own.upload(np.full((1, CHAINS + 1), 0.5, dtype)), own.empty((n, 1), dtype)
    flags, count = own.empty((n,), np.uint8), own.zero()
    where = [address(device, a) for a in (given, out, flags, count)]
    spent = seconds(
        device, lambda: kernel.batch(device, 0, n, [Rows(where[0], 0)], where[1:2], *where[2:], STREAM[0]), 5
    )
    return 2.0 * CHAINS * DEEP * n / spent / 1e12


def flops(operations: dict[str, int], dtype: Any) -> int:
    """Operations of a sample, a multiply-add as two, with those of sines and cosines."""
    plain = sum(operations[word] for word in ("mul", "add", "div", "sqrt"))
    return plain + SINCOS["double" if dtype == np.float64 else "float"] * operations["sincos"]


def call_row(
    device: Cuda, own: Library, limits: dict[str, float], model: sd.Model, call: str, dtype: Any, n: int
) -> dict[str, Any]:
    """The figures of a call."""
    k: Any = sd.specialize(model, getattr(sd, call), dtype, device="cuda")
    lanes = sd.specialize(model, getattr(sd, call), dtype)
    rng = np.random.default_rng(0)
    shapes = [x.shape for x in k._inputs]
    few = [rng.standard_normal((COMPARED, *shape)).astype(dtype) for shape in shapes]
    few[0][7], few[0][11, 0] = np.nan, 3e5
    began = time.perf_counter()
    found = k(*map(own.upload, few))
    loading = time.perf_counter() - began
    same = np.array_equal(own.to_host(found), lanes(*few), equal_nan=True)
    block = [rng.standard_normal((1 << 16, *shape)).astype(dtype) for shape in shapes]
    inputs = [own.upload(np.tile(x, (-(-n // (1 << 16)),) + (1,) * (x.ndim - 1))[:n]) for x in block]
    out = k(*inputs, check=False)
    spent = seconds(device, lambda: k(*inputs, out=out, check=False), ROUNDS)
    loaded = k._on_device.loaded(device, 0)
    size = np.dtype(dtype).itemsize * (sum(int(np.prod(s)) for s in (*shapes, *k._shapes))) + 1
    rate = n / spent
    return {
        "robot": model.name, "call": call, "dtype": np.dtype(dtype).name, "bits equal": bool(same),
        "G samples/s": rate / 1e9, "bandwidth": size * rate / 1e9 / limits["bandwidth"],
        "multiply-add": flops(k.operations, dtype) * rate / 1e12 / limits[np.dtype(dtype).name],
        "registers": loaded.registers, "spilled": loaded.spilled, "load s": loading,
    }  # fmt: skip


def rollout_row(device: Cuda, own: Library, model: sd.Model, dtype: Any, n: int) -> dict[str, Any]:
    """The figures of rollouts."""
    rng = np.random.default_rng(0)

    def start(count: int) -> list[Any]:
        q = np.tile(sd.neutral(model), (count, 1)) + 0.1 * rng.standard_normal((count, model.nq))
        return [x.astype(dtype) for x in (q, 0.1 * rng.standard_normal((count, model.nv)))]

    q, v = start(COMPARED // 4)
    words: dict[str, Any] = {"dt": 1e-4, "steps": STEPS, "record": "last", "dtype": dtype}
    began = time.perf_counter()
    found = sd.rollout(model, own.upload(q), own.upload(v), device="cuda", **words)
    loading = time.perf_counter() - began
    wanted = sd.rollout(model, q, v, **words)
    same = np.array_equal(own.to_host(found.q), wanted.q) and np.array_equal(own.to_host(found.v), wanted.v)
    states = [own.upload(x) for x in start(n)]
    spent = seconds(device, lambda: sd.rollout(model, *states, device="cuda", **words), 3)
    return {
        "robot": model.name, "call": "rollout", "dtype": np.dtype(dtype).name, "bits equal": bool(same),
        "G steps/s": n * STEPS / spent / 1e9, "load s": loading,
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Rows as text, a column for each word."""
    words = list(dict.fromkeys(word for row in rows for word in row))
    cells = [words] + [
        [f"{x:.3g}" if isinstance(x := row.get(w, ""), float) else str(x) for w in words] for row in rows
    ]
    widths = [max(len(row[k]) for row in cells) for k in range(len(words))]
    return "\n".join("  ".join(x.rjust(w) for x, w in zip(row, widths, strict=True)) for row in cells)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one robot, a quarter of the samples: a few minutes")
    parser.add_argument(
        "--urdf", action="append", metavar="FILE", help="robots (default: panda, ur5_robot, talos_full_v2)"
    )
    parser.add_argument("--save", metavar="FILE", help="write the table to a JSON file")
    arguments = parser.parse_args()
    own, device = library(), Cuda()
    STREAM[0] = own.stream
    robots = arguments.urdf or ["panda", "ur5_robot", "talos_full_v2"]
    robots = robots[:1] if arguments.quick else robots
    n = SAMPLES // 4 if arguments.quick else SAMPLES
    limits = {"bandwidth": bandwidth(device, own)}
    limits |= {x.__name__: peak(device, own, x) for x in (np.float64, np.float32)}
    card = device.name(0)
    print(
        f"{card}: {limits['bandwidth']:.0f} GB/s, {limits['float64']:.1f} and {limits['float32']:.1f} TFLOP/s",
        flush=True,
    )
    rows: list[dict[str, Any]] = []
    failed = False

    def save() -> None:
        if arguments.save:
            kept = {"card": card, "limits": limits, "samples": n, "steps": STEPS, "rows": rows}
            Path(arguments.save).write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")

    for name in robots:
        model = sd.load_urdf(name)
        for dtype in (np.float32, np.float64):
            for call in CALLS:
                rows.append(call_row(device, own, limits, model, call, dtype, n // (8 if model.nv > 20 else 1)))
                print(table(rows[-1:]), flush=True)
                save()
            rows.append(rollout_row(device, own, model, dtype, ROLLOUTS // (4 if arguments.quick else 1)))
            print(table(rows[-1:]), flush=True)
            save()
    failed = not all(row["bits equal"] for row in rows)
    print(table(rows))
    if failed:
        raise SystemExit("bits differ from those of lanes")


if __name__ == "__main__":
    main()
