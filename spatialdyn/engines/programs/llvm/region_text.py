"""LLVM text of regions: loops whose body runs as long as some lane of a tile needs it, or that no lane needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ..record.operations import AGAIN, CARRIED, NEXT, REPEAT, Operation
from ..record.program import Program
from ..record.regions import Region, runs_once
from .llvm_vectors import Vectors

Value = Callable[[int], str]  # the value of an operand


class Regions:
    """The regions of a program.

    carried  slot in the workspace of each carried value, except those of regions that run once in one function
    """

    def __init__(self, program: Program, cut: Iterable[Region], slot: int) -> None:
        """``cut``: regions whose bodies are several functions; ``slot``: the first free slot."""
        cut = list(cut)
        kept = [r for r in program.regions if r in cut or not runs_once(program.lines, r)]
        carried = dict.fromkeys(k for region in kept for k in region.carried)
        self.carried = {k: slot + at for at, k in enumerate(carried)}
        self._of_head = {region.head: region for region in program.regions}
        self._once = self._of_head.keys() - {region.head for region in kept}

    def not_kept(self, head: int) -> list[int]:
        """The carried values of a region that are not in the workspace."""
        return [k for k in self._of_head[head].carried if k not in self.carried]

    def write_around(self, t: Vectors, k: int, op: Operation, value: Value) -> None:
        """Write a first or last line of a region whose body is several functions."""
        if op.code == CARRIED:
            t.store_vector(value(op.a), "%ws", self.carried[k])
        elif op.code == NEXT:
            t.store_vector(value(op.b), "%ws", self.carried[op.a])
        elif op.code == REPEAT:
            self.enter(t, k, lambda: value(op.a))
        else:
            self.leave(t, op.a, {}, {})

    def enter(self, t: Vectors, head: int, running: Callable[[], str]) -> None:
        """Begin a run of a region if some lane needs it: where ``running``, which each run reads anew, is above 0."""
        t.jump(f"repeat{head}", then=f"repeat{head}")
        runs = t.put(f"bitcast {t.truth} {t.above_zero(running())} to i{t.lanes}")
        some = t.put(f"icmp ne i{t.lanes} {runs}, 0")
        t.branch(some, f"run{head}", f"behind{head}", then=f"run{head}")

    def leave(self, t: Vectors, head: int, values: dict[int, str], after: dict[int, str]) -> None:
        """End a region; ``values`` before it, and ``after``: carried values at its end, if it runs once."""
        if head not in self._once:
            t.jump(f"repeat{head}", then=f"behind{head}")
            return
        t.jump(f"again{head}", then=f"again{head}")
        t.jump(f"behind{head}", then=f"behind{head}")
        for k, x in after.items():
            values[k] = t.put(f"phi {t.vector} [ {values[k]}, %repeat{head} ], [ {x}, %again{head} ]")


class RegionWriter:
    """Writes the lines that begin and end regions in one function.

    values  the values that the function has computed, which are those before a region again behind it
    value   the value of an operand
    spill   spills the value of a line if another function reads it
    """

    def __init__(
        self, regions: Regions, t: Vectors, values: dict[int, str], value: Value, spill: Callable[[int], None]
    ) -> None:
        self._regions, self._t, self._values, self._value, self._spill = regions, t, values, value, spill
        self._before: list[dict[int, str]] = []  # for each region that is being written, the values before it
        self._after: list[dict[int, str]] = []  # and its carried values at its end that are not in the workspace

    @property
    def within(self) -> bool:
        """Whether a region is being written."""
        return bool(self._before)

    def write(self, k: int, op: Operation) -> bool:
        """Write line k if it begins or ends a region or a run; returns whether it does."""
        regions, t, values, value = self._regions, self._t, self._values, self._value
        if op.code == REPEAT:
            self._before.append(dict(values))
            self._after.append({})
            regions.enter(t, k, lambda: value(op.a))
        elif op.code == NEXT:
            if op.a in regions.carried:
                t.store_vector(value(op.b), "%ws", regions.carried[op.a])
            else:
                self._after[-1][op.a] = value(op.b)
        elif op.code == AGAIN:
            values.clear()
            values |= self._before.pop()
            regions.leave(t, op.a, values, self._after.pop())
            for held in regions.not_kept(op.a):
                self._spill(held)
        elif op.code == CARRIED:
            if k in regions.carried:
                t.store_vector(value(op.a), "%ws", regions.carried[k])
            else:
                values[k] = value(op.a)
                self._spill(k)
        else:
            return False
        return True
