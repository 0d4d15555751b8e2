"""The regions of a program, and which lines are needed: a carried value needs the values that replace it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ....errors import SpatialDynError
from .operations import AGAIN, CARRIED, CONST, INPUT, NEXT, REPEAT, SELECT, arities


class Region(NamedTuple):
    """A part of a program between two lines.

    start    the first line of its carried values
    head     the line REPEAT
    end      the line AGAIN
    carried  lines of its carried values
    """

    start: int
    head: int
    end: int
    carried: tuple[int, ...]


Lines = Sequence[tuple[int, int, int, int, float]]


def find(lines: Lines) -> list[Region]:
    """The regions; an inner region comes before the one around it."""
    found: list[Region] = []
    open_: list[tuple[int, list[int]]] = []
    for k, (code, a, _, _, _) in enumerate(lines):
        if code == REPEAT:
            open_.append((k, []))
        elif code == NEXT:
            open_[-1][1].append(a)
        elif code == AGAIN:
            head, carried = open_.pop()
            found.append(Region(min(carried, default=head), head, k, tuple(carried)))
    return found


def runs_once(lines: Lines, region: Region) -> bool:
    """Whether no sample needs a second run of a region: its number is 0 after one."""
    running = lines[region.head][1]
    after = next(op[2] for op in lines[region.head : region.end] if op[0] == NEXT and op[1] == running)
    code, _, chosen, _, _ = lines[after]
    return code == SELECT and lines[chosen][0] == CONST and lines[chosen][4] == 0.0


def uses(lines: Lines, roots: Sequence[int]) -> list[int]:
    """How often each line is read: by lines that the roots need, and as a root.

    A line that no other line reads counts 1 if it is part of a region that is needed.

    Raises SpatialDynError if a value that a region computes and does not carry is read behind the region.
    """
    region_of, arity_of = _regions_of(lines), arities()
    following = {a: k for k, (code, a, _, _, _) in enumerate(lines) if code == NEXT}
    ends = {region.head: region.end for region in find(lines)}
    found = [0] * len(lines)
    waiting = list(dict.fromkeys(roots))
    needed = set(waiting)
    for k in roots:
        found[k] += 1
        _check(lines, region_of, k, -1)
    while waiting:
        k = waiting.pop()
        code, a, b, c, _ = lines[k]
        read = [x if x >= 0 else -x - 1 for x in (a, b, c)[: arity_of[code]]]
        for x in read:
            found[x] += 1
            _check(lines, region_of, x, region_of[k])
        more = []
        if code == CARRIED and k in following:
            more = [following[k], region_of[following[k]]]
        elif code == REPEAT:
            more = [ends[k]]
        for x in more:
            found[x] = max(found[x], 1)
        for x in (*read, *more):
            if x not in needed:
                needed.add(x)
                waiting.append(x)
    return found


def _regions_of(lines: Lines) -> list[int]:
    """The head of the innermost region of each line, the region's own lines included; -1 outside of all regions."""
    found, inside = [], [-1]
    for k, (code, *_) in enumerate(lines):
        if code == REPEAT:
            inside.append(k)
        found.append(inside[-1])
        if code == AGAIN:
            inside.pop()
    return found


def _check(lines: Lines, region_of: Sequence[int], k: int, reader: int) -> None:
    """Raise SpatialDynError if line k is in a region that does not contain its reader, which is in ``reader``."""
    if lines[k][0] in (INPUT, CONST, REPEAT) or region_of[k] == -1:
        return
    while reader != region_of[k] and reader != -1:
        reader = region_of[reader - 1]
    if reader == -1:
        raise SpatialDynError("a recursion reads behind repeat or when what the body writes, expected it to be carried")
