"""LLVM text of kernels, which run a program in a grid of threads: over a batch, and through a time loop.

The text for a host differs only in how a thread gets its number: on a host ``grid`` runs the threads one after another,
so that launch, strides, remainder, checks and bits can be tested without a GPU.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from ..llvm.llvm_text import Body
from ..record.kernel_layout import KernelLayout
from ..record.program import Program
from ..record.structure import Numbers
from .thread_writer import CONSTANT, GLOBAL, Thread, ThreadWriter

BLOCK = 128  # threads of a block: any number of registers fits
CONSTANT_BYTES = 1 << 16  # bytes of a GPU's constant memory; if a program has more numbers, they go to global memory
TRIPLE = "nvptx64-nvidia-cuda"


class Target(NamedTuple):
    """The differences between the text for a GPU and for a host.

    head    lines before the functions
    kind    kind of function of a kernel
    thread  parameters before the others
    number  lines that define %thread, the number of the thread in the grid
    """

    head: str
    kind: str
    thread: tuple[str, ...]
    number: str


NVPTX = Target(
    f"""target triple = "{TRIPLE}"
declare i32 @llvm.nvvm.read.ptx.sreg.tid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
""",
    "ptx_kernel void",
    (),
    """  %tid = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %ntid = call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
  %ctaid = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %tid.wide = zext i32 %tid to i64
  %ntid.wide = zext i32 %ntid to i64
  %ctaid.wide = zext i32 %ctaid to i64
  %before = mul i64 %ctaid.wide, %ntid.wide
  %thread = add i64 %before, %tid.wide""",
)
HOST = Target("", "void", ("i64 %thread",), "")


def batch_text(
    program: Program, layout: KernelLayout, dtype: Any, order: Sequence[int] | None = None, target: Target = NVPTX
) -> str:
    """``kernel(n, *(in, step), *outs, flags, count)`` on arrays of a GPU.

    in, step  an input with adjacent columns, and its stride from one sample to the next in numbers (0 if shared)
    outs      (n, columns) in C order, NaN in samples that are rejected
    flags     (n,) bytes: 1, or 0 for a rejected sample
    count     an int32 to which the number of rejected samples is added
    """
    writer = ThreadWriter(program, layout, dtype, order)
    t = Thread(writer.scalar)
    parameters = ["i64 %n"]
    for a in range(len(layout.inputs)):
        parameters += [_pointer(t, f"%array{a}", "readonly"), f"i64 %step{a}"]
    parameters += [_pointer(t, f"%result{a}") for a in range(len(layout.outputs))]
    parameters += [_pointer(t, "%flags"), _pointer(t, "%count")]
    _start(t, writer, target)
    for a in range(len(layout.inputs)):
        row = f"%array{a}" if a in layout.common else t.number(f"%array{a}", t.times("%thread", f"%step{a}"))
        _name(t, f"%in{a}", row)
    for a, places in enumerate(layout.outputs):
        _name(t, f"%out{a}", t.number(f"%result{a}", t.times("%thread", len(places))))
    good, _ = writer.body(t)
    nan = t.constant(np.nan)
    _finish(t, good)
    for a, places in enumerate(layout.outputs):
        for c in range(len(places)):
            t.store(t.vector, nan, t.number(f"%out{a}", c), t.size)
    t.jump("done", then="done")
    t.do("ret void")
    return _module(t, parameters, target, program, layout, dtype)


def time_loop_text(
    program: Program, layout: KernelLayout, dtype: Any, states: int, kept: int,
    order: Sequence[int] | None = None, target: Target = NVPTX,
) -> str:  # fmt: skip
    """``kernel(n, steps, every, recorded, *(state, step), *(in, sample, time), *records, flags, count)``.

    state, step       a state with adjacent columns, and its stride from one sample to the next in numbers
    in, sample, time  another input, and its strides to the next sample and the next step in numbers
    records           (n, recorded, columns) of the first ``kept`` states after every ``every`` steps
    flags, count      as of ``batch_text``; a sample is rejected if one of its steps is
    """
    writer = ThreadWriter(program, layout, dtype, order, states)
    t = Thread(writer.scalar)
    others = range(states, len(layout.inputs))
    parameters = ["i64 %n", "i64 %steps", "i64 %every", "i64 %recorded"]
    for a in range(states):
        parameters += [_pointer(t, f"%array{a}", "readonly"), f"i64 %step{a}"]
    for a in others:
        parameters += [_pointer(t, f"%array{a}", "readonly"), f"i64 %sample{a}", f"i64 %time{a}"]
    parameters += [_pointer(t, f"%record{a}") for a in range(kept)]
    parameters += [_pointer(t, "%flags"), _pointer(t, "%count")]
    _start(t, writer, target)
    begun = []
    for a, width in enumerate(layout.inputs[:states]):
        row = t.number(f"%array{a}", t.times("%thread", f"%step{a}"))
        begun += [t.load(t.vector, t.number(row, c), t.size) for c in range(width)]
    rows = {a: t.number(f"%array{a}", t.times("%thread", f"%sample{a}")) for a in others}
    t.jump("step", then="step")
    place = len(t.lines)
    carried = [f"%state{c}" for c in range(len(begun))]
    for a in others:
        _name(t, f"%in{a}", t.number(rows[a], t.times("%t", f"%time{a}")))
    good, results = writer.body(t, carried)
    after = [x for those in results[:states] for x in those]
    t.do(f"%good.next = and i1 %good, {good}")
    t.do("%t.next = add i64 %t, 1")
    t.do("%record.next = sdiv i64 %t.next, %every")
    t.branch(t.put("icmp sgt i64 %record.next, %record"), "keep", "stepped", then="keep")
    ends = list(accumulate((len(x) for x in layout.outputs), initial=0))
    first = t.add(t.times("%thread", "%recorded"), "%record")
    for a, (start, end) in enumerate(list(pairwise(ends))[:kept]):
        row = t.number(f"%record{a}", t.times(first, end - start))
        for c in range(end - start):
            t.store(t.vector, after[start + c], t.number(row, c), t.size)
    t.jump("stepped", then="stepped")
    t.branch(t.put("icmp slt i64 %t.next, %steps"), "step", "stopped", then="stopped")
    _finish(t, "%good.next")
    t.jump("done", then="done")
    t.do("ret void")
    t.lines[place:place] = [
        "  %t = phi i64 [ 0, %run ], [ %t.next, %stepped ]",
        "  %good = phi i1 [ true, %run ], [ %good.next, %stepped ]",
        "  %record = phi i64 [ 0, %run ], [ %record.next, %stepped ]",
        *(
            f"  {x} = phi {t.vector} [ {a}, %run ], [ {b}, %stepped ]"
            for x, a, b in zip(carried, begun, after, strict=True)
        ),
    ]
    return _module(t, parameters, target, program, layout, dtype)


def _pointer(t: Thread, name: str, more: str = "") -> str:
    """A parameter that is the address of an array; no other array overlaps it."""
    t.spaces[name] = GLOBAL
    return f"ptr addrspace({GLOBAL}) noalias {more + ' ' if more else ''}{name}"


def _name(t: Thread, name: str, address: str) -> None:
    """Another name for an address."""
    t.do(f"{name} = getelementptr i8, {t.pointer(address)}, i64 0")
    t.spaces[name] = t.spaces[address]


def _start(t: Thread, writer: ThreadWriter, target: Target) -> None:
    """Write the entry, which returns in threads behind the last sample, and define %ws and %numbers."""
    t.label("entry")
    if target.number:
        t.lines.append(target.number)
    if writer.workspace:
        t.do(f"%ws = alloca [{writer.workspace // t.size} x {t.scalar}], align 16")
    t.branch(t.put("icmp slt i64 %thread, %n"), "run", "done", then="run")
    t.spaces["@numbers"] = _space(writer.program, writer.layout, t.size)
    _name(t, "%numbers", "@numbers")


def _space(program: Program, layout: KernelLayout, size: int) -> int:
    """The address space of a program's numbers."""
    return CONSTANT if Numbers(program, layout).values(np.float64).size * size <= CONSTANT_BYTES else GLOBAL


def _finish(t: Thread, good: str) -> None:
    """Write a sample's flag; a block of its own counts the sample if it is rejected."""
    t.store("i8", t.put(f"zext i1 {good} to i8"), t.at("i8", "%flags", "%thread"), 1)
    t.branch(good, "done", "reject", then="reject")
    t.put(f"atomicrmw add {t.pointer('%count')}, i32 1 monotonic")


def _module(
    t: Thread, parameters: Sequence[str], target: Target, program: Program, layout: KernelLayout, dtype: Any
) -> str:
    """The text of the module."""
    values = Numbers(program, layout).values(dtype)
    listed = ", ".join(f"{t.scalar} 0x{bits:016X}" for bits in values.astype(np.float64).view(np.uint64).tolist())
    space, v, suffix = t.spaces["@numbers"], t.vector, t.suffix()
    given = [*target.thread, *parameters]
    head = f"define {target.kind} @kernel({', '.join(given)})"
    made = t.function(head, f' "nvvm.maxntid"="{BLOCK}"' if target is NVPTX else "")
    text = f"""{target.head}
@numbers = internal addrspace({space}) externally_initialized global [{len(values)} x {t.scalar}] [{listed}], align 16
declare {v} @llvm.fma.{suffix}({v}, {v}, {v})
declare {v} @llvm.fabs.{suffix}({v})
declare {v} @llvm.sqrt.{suffix}({v})
declare {v} @llvm.copysign.{suffix}({v}, {v})
{made}"""
    return text if target is NVPTX else text + _grid(parameters)


def _grid(parameters: Sequence[str]) -> str:
    """``grid(threads, ...)``, which runs the kernel for each thread in turn."""
    names = [x.split("%")[-1] for x in parameters]
    kinds = [x.split(" ")[0] + (f" addrspace({GLOBAL})" if x.startswith("ptr") else "") for x in parameters]
    t = Body()
    t.label("entry")
    t.jump("loop", then="loop")
    t.do("%thread = phi i64 [ 0, %entry ], [ %next, %loop ]")
    passed = ", ".join(f"{kind} %{name}" for kind, name in zip(kinds, names, strict=True))
    t.do(f"call void @kernel(i64 %thread, {passed})")
    t.do("%next = add i64 %thread, 1")
    t.branch(t.put("icmp slt i64 %next, %threads"), "loop", "done", then="done")
    t.do("ret void")
    return t.function(f"define void @grid(i64 %threads, {', '.join(parameters)})")
