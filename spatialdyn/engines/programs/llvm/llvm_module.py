"""LLVM text of a module: the loop that runs a program over tiles, and the entry that Python calls."""

from __future__ import annotations

from collections.abc import Sequence

from ..record.kernel_layout import KernelLayout
from .llvm_entry import batch_entry, one_entry
from .llvm_vectors import Vectors

BLOCK_STORES = 128  # most stores of one block


def module(main: Vectors, functions: Sequence[str], layout: KernelLayout, workspace: int, stream: bool) -> str:
    """The module with ``kernel``, ``batch_entry`` and, on one lane, ``one_entry``.

    ``kernel(tiles, *(in, step), *outs, bits, ws, numbers)`` runs ``main`` for each tile.

    main       the body of a tile, on %tile, %first (its first sample), %in0, %step0, %out0, %bits, %ws and %numbers
    functions  functions that it calls
    stream     whether results bypass the CPU caches
    """
    v, suffix, size = main.vector, main.suffix(), main.size
    ins = "".join(f"ptr noalias %in{a}, i64 %step{a}, " for a in range(len(layout.inputs)))
    outs = "".join(f"ptr noalias %out{a}, " for a in range(len(layout.outputs)))
    body, last = _in_blocks(main.lines)
    wide = 8 * size * main.lanes
    # without alignstack, vectors spilled to the stack may straddle cache lines, which is slower
    copy = _COPY.format(v=v, align=size * main.lanes, to=size * (main.lanes if stream else 1), how=_PAST * stream)
    columns = tuple(map(len, layout.outputs))
    return f"""
declare {v} @llvm.fma.{suffix}({v}, {v}, {v})
declare {v} @llvm.fabs.{suffix}({v})
declare {v} @llvm.sqrt.{suffix}({v})
declare {v} @llvm.copysign.{suffix}({v}, {v})
{copy}
{"".join(functions)}
define void @kernel(i64 %tiles, {ins}{outs}ptr noalias %bits, ptr noalias %ws, ptr noalias %numbers) #0 {{
entry:
  %any = icmp sgt i64 %tiles, 0
  br i1 %any, label %loop, label %done
loop:
  %tile = phi i64 [ 0, %entry ], [ %next, %{last} ]
  %first = mul i64 %tile, {main.lanes}
{body}
  %next = add i64 %tile, 1
  %more = icmp slt i64 %next, %tiles
  br i1 %more, label %loop, label %done
done:
  ret void
}}
attributes #0 = {{ alignstack=64 "prefer-vector-width"="{wide}" "min-legal-vector-width"="{wide}" }}
{batch_entry(layout.inputs, columns, workspace, main.lanes, size)}
{one_entry(layout.inputs, columns, workspace) if main.lanes == 1 else ""}
"""


def _in_blocks(lines: Sequence[str]) -> tuple[str, str]:
    """The loop's text and the name of its last block; branches that are never taken cut it into blocks.

    A block has at most BLOCK_STORES stores: LLVM's time grows with the square of the stores in a block, and a mass
    matrix of 44 rows has a thousand stores.
    """
    text, stores, last = [], 0, "loop"
    for line in lines:
        text.append(line)
        if line.endswith(":"):
            last = line[:-1]
        elif line.startswith("  store"):
            stores += 1
            if stores % BLOCK_STORES == 0:
                last = f"block{stores // BLOCK_STORES}"
                text += [f"  br i1 %any, label %{last}, label %done", f"{last}:"]
    return "\n".join(text), last


_PAST = ", !nontemporal !0"
_COPY = """
!0 = !{{i32 1}}
define internal void @copy(ptr noalias %out, i64 %tile, i64 %columns, ptr noalias %from) noinline #0 {{
entry:
  %start = mul i64 %tile, %columns
  br label %loop
loop:
  %k = phi i64 [ 0, %entry ], [ %next, %loop ]
  %source = getelementptr {v}, ptr %from, i64 %k
  %x = load {v}, ptr %source, align {align}
  %at = add i64 %start, %k
  %target = getelementptr {v}, ptr %out, i64 %at
  store {v} %x, ptr %target, align {to}{how}
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %columns
  br i1 %more, label %loop, label %done
done:
  ret void
}}
"""
