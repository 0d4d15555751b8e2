"""Tables in programs: chains of selections among inputs that all samples share, compiled as the look-up of a row.

A path of many segments selects each of its coefficients segment by segment: select(t - t₂, c₂, select(t - t₁, c₁, c₀)).
If the c are common inputs at a constant stride, chains of the same conditions need one index (of the last condition
above 0) and one load for each chain. Results are the same to the bit, since a look-up computes nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from ..record.operations import SELECT, operands
from ..record.program import Program

LEAST = 3  # least conditions of a table: fewer selections cost no more than an index


class Chain(NamedTuple):
    """The look-up of the line ``end``: column + index · stride of an input array."""

    end: int
    array: int
    column: int
    stride: int


class Lookups(NamedTuple):
    """The tables of a program.

    tables  {conditions, as operands: the chains in which they select}
    of_end  {last line of a chain: its conditions}
    links   the other lines of the chains, which nothing else reads
    """

    tables: dict[tuple[int, ...], list[Chain]]
    of_end: dict[int, tuple[int, ...]]
    links: frozenset[int]


def find(program: Program, common: Mapping[int, tuple[int, int]]) -> Lookups:
    """The tables of a program; ``common`` has the array and column of each line that is an input for all samples."""
    chains: dict[int, tuple[tuple[int, ...], tuple[int, ...]]] = {}  # {line: conditions, lines they select from}
    if not common or program.regions:
        return Lookups({}, {}, frozenset())
    readers = Counter(line for op in program.lines for line in operands(op))
    readers.update(line for line, _ in program.outputs)
    for k, op in enumerate(program.lines):
        if op.code != SELECT or op.b not in common:
            continue
        if op.c in common:
            chains[k] = (op.a,), (op.c, op.b)
        elif op.c in chains and readers[op.c] == 1:
            conditions, chosen = chains[op.c]
            chains[k] = (*conditions, op.a), (*chosen, op.b)
    inner = {program.lines[k].c for k in chains}
    found = Lookups({}, {}, frozenset())
    links: set[int] = set()
    for k, (conditions, chosen) in chains.items():
        places = [common[line] for line in chosen]
        (array, column), (_, next_column) = places[:2]
        stride = next_column - column
        regular = all(place == (array, column + j * stride) for j, place in enumerate(places))
        if k in inner or len(conditions) < LEAST or not regular:
            continue
        found.tables.setdefault(conditions, []).append(Chain(k, array, column, stride))
        found.of_end[k] = conditions
        at = program.lines[k].c
        while at in chains:
            links.add(at)
            at = program.lines[at].c
    return found._replace(links=frozenset(links))
