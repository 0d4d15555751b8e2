"""The order of a program's lines in compiled code, how they are cut into functions, and the values spilled between."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from ..record.kernel_layout import KernelLayout
from ..record.operations import CONST, FORMS, INPUT, NEXT, arities, operands
from ..record.program import Program
from ..record.regions import Region
from .host_cpu import host

CHUNK_LENGTH = 500  # operations of one function of several: LLVM takes twice as long for 8000, to code no faster
MOST_REGION = 1000  # most lines of a region in one function; cut, a contact step compiles sooner and is 4 to 9 % faster
MOST_LATE = 3000  # most operations of a program whose values are computed near their readers
MOST_SOLVED = 2000  # most operations of one function of forward dynamics
MOST_HELD = 3050  # most operations of a program with bounds whose numbers are held in registers, see ``held``
MOST_WHOLE = 12000  # most operations of one function: rnea of talos, 3760, and derivatives of aba are faster whole
WIDE = 64  # bytes of vectors of which a longer program's values do not fit in the first-level cache
MOST_WIDE = 4500  # most operations of one function with such vectors; rnea_derivatives, 5050, take 15 % less time cut
MOST_ANEW = 7000  # the same of programs that load their numbers at each use: rnea of tiago, 5890, is faster whole
MOST_NUMBERS = 64  # least numbers wanted at once that are loaded at each use, with such vectors: twice the registers


class Schedule:
    """The lines of a program, divided into functions.

    whole       whether all lines are in one function
    chunks      lines of each function, in order, and of the caller's parts between them
    cut         long regions, whose bodies are several functions
    control     indices of the caller's parts: the lines that begin and end the regions that are cut
    slots       slot in the workspace of each line that another function reads
    slot_count  number of slots
    """

    def __init__(self, program: Program, layout: KernelLayout, whole: bool) -> None:
        """Of a program with its checks; ``whole``: in one function."""
        self.whole = whole
        self.chunks = _chunks(program, layout, whole)
        self.cut = () if whole else _cut(program)
        control = {k for region in self.cut for k in _frame(program, region)}
        self.control = {i for i, chunk in enumerate(self.chunks) if chunk and chunk[0] in control}
        self.slots, self.slot_count = ({}, 0) if self.whole else self._slots(program)

    def within(self, chunk: Sequence[int]) -> bool:
        """Whether a function is part of a region that is cut."""
        return any(region.head < k < region.end for region in self.cut for k in chunk[:1])

    def _slots(self, program: Program) -> tuple[dict[int, int], int]:
        """Slots of the spilled lines, reused when free, and the number of slots."""
        chunk_of = {k: i for i, chunk in enumerate(self.chunks) for k in chunk}
        wanted = {line for line, _ in program.outputs}
        end = len(self.chunks)  # results are written behind the last function
        last: dict[int, int] = {}
        for k, i in chunk_of.items():
            around = [region for region in self.cut if region.head < k <= region.end]
            for operand in operands(program.lines[k]):
                if program.lines[operand].code != CONST and chunk_of.get(operand, -1) != i:
                    again = [chunk_of[region.end] for region in around if operand < region.head]  # read in each run
                    last[operand] = max(last.get(operand, 0), i, *again)
        for k, op in enumerate(program.lines):
            if op.code == INPUT or (k in wanted and op.code != CONST):
                last[k] = end
        slots: dict[int, int] = {}
        free: list[int] = []
        ends: dict[int, list[int]] = {}
        count, here = 0, -1
        for k in sorted(last, key=lambda k: (chunk_of.get(k, -1), k)):
            if chunk_of.get(k, -1) > here:
                here = chunk_of.get(k, -1)
                for done in [c for c in ends if c < here]:
                    free += ends.pop(done)
            if free:
                slots[k] = free.pop()
            else:
                slots[k], count = count, count + 1
            ends.setdefault(last[k], []).append(slots[k])
        return slots, count


def is_whole(program: Program, layout: KernelLayout) -> bool:
    """Whether a program is one function.

    Forward dynamics, with a pivot for each result, has three sweeps over the robot, between which few values are used.
    What else has pivots is faster whole; without them, LLVM spills more vectors of a long function than it has values.
    """
    length = len(program.lines)
    if layout.pivots and sum(map(len, layout.outputs)) <= len(layout.pivots):
        return length <= MOST_SOLVED
    other = layout.pivots or layout.bounds or layout.common or program.regions
    if length <= min(MOST_WIDE, MOST_WHOLE) or other or host()[2] < WIDE:
        return length <= MOST_WHOLE
    return length <= min(MOST_ANEW, MOST_WHOLE) and not held(program, layout)


def late(program: Program, layout: KernelLayout) -> bool:
    """Whether a program's values are computed near their readers.

    With pivots there is a third sweep over the robot, and this order spills fewer values for it; without pivots it
    saves nothing. It makes longer programs slower: aba with bounds, the derivatives of a step, aba of talos.
    """
    return bool(layout.pivots) and len(program.lines) <= MOST_LATE and not program.regions


def held(program: Program, layout: KernelLayout) -> bool:
    """Whether a program's numbers are held in registers between uses; otherwise they are loaded at each use.

    LLVM spills numbers that it holds too long to the stack, as whole vectors. In a long program with bounds, which has
    three values for each line, the spilled vectors do not fit in the first-level cache, and loading the numbers again
    is faster. It makes shorter programs slower. Without bounds it is faster with AVX-512 where many numbers are wanted
    at once: rnea of long chains, whose sweeps share them. A program in several functions compiles sooner by it. With
    half the registers it is slower, as is hamilton_field of talos, which has pivots in one function.
    """
    if layout.bounds:
        return len(program.lines) <= MOST_HELD
    if program.regions or (layout.pivots and is_whole(program, layout)):
        return True
    return host()[2] < WIDE or _at_once(program) < MOST_NUMBERS


def _at_once(program: Program) -> int:
    """The most numbers that are between their first and last reader at a line."""
    table, arity_of = program.table, arities()
    arity = np.zeros(max(arity_of) + 1, np.int64)
    arity[list(arity_of)] = list(arity_of.values())
    operands = table[:, 1:]
    read = arity[table[:, 0], None] > np.arange(3)
    reader, line = np.nonzero(read)[0], operands[read]
    line = np.where(line < 0, -line - 1, line)
    number = table[line, 0] == CONST
    reader, line = reader[number], line[number]
    first, last = np.full(len(table), len(table)), np.full(len(table), -1)
    np.minimum.at(first, line, reader)
    np.maximum.at(last, line, reader)
    known = last >= 0
    begun, ended = (np.bincount(at[known], minlength=len(table)) for at in (first, last))
    return int((begun - ended).cumsum().max(initial=0))


def _chunks(program: Program, layout: KernelLayout, whole: bool) -> list[list[int]]:
    """The lines of each function, in order; ``whole`` as of Schedule."""
    lines = program.lines
    order = depth_first(program) if whole and late(program, layout) else range(len(lines))
    work = [k for k in order if lines[k].code not in (INPUT, CONST)]
    if whole or not work:
        return [work]
    cut = _cut(program)
    control = {k for region in cut for k in _frame(program, region)}
    outer = {
        region.start: region.end for region in program.regions if region not in cut
    }  # an outer region comes after those within it, if they begin at the same line
    chunks: list[list[int]] = [[]]
    end = -1
    for k in work:
        apart = chunks[-1] and (k in control) != (chunks[-1][0] in control)
        if k > end and (apart or len(chunks[-1]) >= CHUNK_LENGTH):
            chunks.append([])
        end = max(end, outer.get(k, -1))
        chunks[-1].append(k)
    return chunks


def _cut(program: Program) -> tuple[Region, ...]:
    """The regions that are cut into functions."""
    return tuple(region for region in program.regions if region.end - region.start > MOST_REGION)


def _frame(program: Program, region: Region) -> list[int]:
    """The lines that begin and end a region and its runs."""
    lines, own = program.lines, set(region.carried)
    following = [k for k in range(region.head, region.end) if lines[k].code == NEXT and lines[k].a in own]
    return [*region.carried, region.head, *following, region.end]


def angles(program: Program, layout: KernelLayout) -> list[list[int]]:
    """The angles of each function, in the order of their first readers; an angle is a line with a sine or cosine.

    Compiled code sums the squares of the angles in this order.
    """
    lines = program.lines
    readers = {code for code, form in FORMS.items() if form.angle}
    whole = is_whole(program, layout)
    if whole and late(program, layout):
        return [_angles_depth_first(program, readers)]
    within = {k for region in program.regions for k in range(region.head, region.end)}  # NaN if out of range
    chunks: Iterable[Iterable[int]] = [range(len(lines))] if whole else _chunks(program, layout, whole)
    return [
        list(dict.fromkeys(lines[k].a for k in chunk if lines[k].code in readers and k not in within))
        for chunk in chunks
    ]


def _angles_depth_first(program: Program, readers: Collection[int]) -> list[int]:
    """The angles in the order in which ``depth_first`` meets their readers.

    To save time the search does not enter lines of which all angles have been met.
    """
    lines, arity_of = program.lines, arities()
    bits: dict[int, int] = {}
    below: list[int] = []  # for each line a bit set of the angles on which it depends
    for code, a, b, c, _ in lines:
        arity = arity_of[code]
        found = 0
        if arity:
            found = below[a if a >= 0 else -a - 1]
            if arity > 1:
                found |= below[b if b >= 0 else -b - 1]
                if arity > 2:
                    found |= below[c if c >= 0 else -c - 1]
            if code in readers:
                found |= bits.setdefault(a, 1 << len(bits))
        below.append(found)
    order: dict[int, None] = {}
    met, seen = 0, set()
    for line, _ in program.outputs:
        waiting = [(line, False)]
        while waiting:
            k, ready = waiting.pop()
            if not below[k] & ~met:
                continue
            if ready:
                op = lines[k]
                if op.code in readers:
                    order[op.a] = None
                    met |= bits[op.a]
            elif k not in seen:
                seen.add(k)
                waiting.append((k, True))
                waiting += [(operand, False) for operand in sorted(set(operands(lines[k])))]
    return list(order)


def depth_first(program: Program, last: bool = False) -> list[int]:
    """The program's lines in depth-first order from its outputs, so that each line is near its readers.

    last  whether to begin with the last output
    """
    order: list[int] = []
    seen: set[int] = set()
    for line, _ in reversed(program.outputs) if last else program.outputs:
        waiting = [(line, False)]
        while waiting:
            k, ready = waiting.pop()
            if ready:
                order.append(k)
            elif k not in seen:
                seen.add(k)
                waiting.append((k, True))
                waiting += [(operand, False) for operand in sorted(set(operands(program.lines[k])))]
    return order
