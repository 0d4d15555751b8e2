"""The machine of the figures, and its limits: multiply-adds and stores per second of one core."""

from __future__ import annotations

import ctypes
import os
import platform
from functools import cache
from typing import Any

import numba
import numpy as np
import pinocchio as pin
from contestants import installed
from measure import per_call

from spatialdyn.engines.programs.llvm import host_cpu, llvm_vectors

CHAINS = 16  # independent ones hide the latency of a multiply-add, 4 cycles or so
DEEP = 8  # of each chain per turn of the loop
TURNS = 100_000
BYTES = 256 << 20  # far above the caches
SINCOS_FLOPS = {  # of the short sine and cosine of one angle: shift, reduction, polynomials (llvm_vectors.py)
    scalar: 15
    + 2
    * (len(llvm_vectors.HALF_PI[scalar, True]) + len(llvm_vectors.SINE[scalar]) + len(llvm_vectors.COSINE[scalar]) - 2)
    for scalar in ("double", "float")
}


def machine() -> dict[str, Any]:
    """Names and versions, and the two limits."""
    processor, _, width, _ = host_cpu.host()
    return {
        "processor": numba.core.config.CPU_NAME or processor,
        "cores": os.cpu_count(),
        "vector_bytes": width,
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "pinocchio": pin.__version__,
        "peers": installed(),
        "peak_flops_per_ns": peak("double"),
        "peak_flops_per_ns_float32": peak("float"),
        "store_bytes_per_ns": stores(),
        "sincos_flops": SINCOS_FLOPS["double"],
    }


def flops(operations: dict[str, int], scalar: str = "double") -> int:
    """Operations per sample: those of the program, a multiply-add as two, and those of sines and cosines."""
    plain = sum(operations[word] for word in ("mul", "add", "div", "sqrt"))
    return plain + SINCOS_FLOPS[scalar] * operations["sincos"]


@cache
def peak(scalar: str) -> float:
    """Flops per nanosecond of multiply-adds in independent chains of whole vectors, the best of some runs."""
    lanes_of = host_cpu.host()[2] // (8 if scalar == "double" else 4)
    v, suffix = f"<{lanes_of} x {scalar}>", f"v{lanes_of}f{64 if scalar == 'double' else 32}"
    half = "<" + ", ".join([f"{scalar} 0.5"] * lanes_of) + ">"
    names = [f"x{c}" for c in range(CHAINS)]
    body = []
    for turn in range(DEEP):
        for c, name in enumerate(names):
            before = f"%{name}" if turn == 0 else f"%{name}_{turn}"
            body.append(f"  %{name}_{turn + 1} = call {v} @llvm.fma.{suffix}({v} {before}, {v} {half}, {v} %start{c})")
    starts = [
        f"  %p{c} = getelementptr {v}, ptr %io, i64 {c}\n  %start{c} = load {v}, ptr %p{c}" for c in range(CHAINS)
    ]
    phis = [f"  %{x} = phi {v} [ %start{c}, %entry ], [ %{x}_{DEEP}, %loop ]" for c, x in enumerate(names)]
    ends = [f"  store {v} %{x}_{DEEP}, ptr %p{c}" for c, x in enumerate(names)]
    text = f"declare {v} @llvm.fma.{suffix}({v}, {v}, {v})\n" + _loop(starts, phis, body, ends)
    run = _Compiled(text)
    room = _aligned(CHAINS * host_cpu.host()[2])
    seconds = min(per_call(lambda: run(TURNS, room.ctypes.data), 1) for _ in range(20))
    return 2.0 * TURNS * DEEP * CHAINS * lanes_of / seconds * 1e-9


@cache
def stores() -> dict[str, float]:
    """Bytes per nanosecond written to mapped memory: by memset, by copying, and by streaming stores."""
    lanes_of = host_cpu.host()[2] // 8
    v, size = f"<{lanes_of} x double>", host_cpu.host()[2]
    body = [f"  %at = getelementptr {v}, ptr %io, i64 %k", f"  store {v} zeroinitializer, ptr %at, align {size}, "]
    body[-1] += "!nontemporal !0"
    run = _Compiled(_loop([], [], body, []) + "!0 = !{i32 1}\n")
    room, source = _aligned(BYTES), np.ones(BYTES // 8)
    numbers = room.view(np.float64)
    ways = {
        "memset": lambda: ctypes.memset(room.ctypes.data, 0, BYTES),
        "copy": lambda: np.copyto(numbers, source),
        "streamed": lambda: run(BYTES // size, room.ctypes.data),
    }
    return {name: BYTES / min(per_call(way, 1) for _ in range(7)) * 1e-9 for name, way in ways.items()}


def _aligned(size: int) -> np.ndarray:
    raw = np.ones(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size]


def _loop(before: list[str], phis: list[str], body: list[str], after: list[str]) -> str:
    """``kernel(turns, io)`` as LLVM text."""
    parts = ["\n".join(x) for x in (before, phis, body, after)]
    wide = 8 * host_cpu.host()[2]
    return f"""
define void @kernel(i64 %turns, ptr %io) #0 {{
entry:
{parts[0]}
  br label %loop
loop:
  %k = phi i64 [ 0, %entry ], [ %next, %loop ]
{parts[1]}
{parts[2]}
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %turns
  br i1 %more, label %loop, label %done
done:
{parts[3]}
  ret void
}}
attributes #0 = {{ "prefer-vector-width"="{wide}" "min-legal-vector-width"="{wide}" }}
"""


class _Compiled:
    """LLVM text as a function of (turns, address), for this processor."""

    def __init__(self, text: str) -> None:
        self._loaded = host_cpu.LoadedCode(host_cpu.object_code(text))
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p)(self._loaded.address("kernel"))

    def __call__(self, turns: int, address: int) -> None:
        self._call(turns, address)
