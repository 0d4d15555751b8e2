"""Tables in programs: chains of selections among inputs that all samples share, compiled as a look-up of a row.

A path of many segments selects each of its coefficients segment by segment: select(t - t₂, c₂, select(t - t₁, c₁, c₀)).
Where the c are common inputs, a stride apart, chains of the same conditions need one index, the last condition above 0,
and a load for each chain. Results are the same to the bit: nothing is computed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from ..record.operations import SELECT, operands
from ..record.program import Program

LEAST = 3  # conditions of a table: fewer cost no more than an index


class Chain(NamedTuple):
    """What is looked up for one value: column + index stride of an input array, for the line ``end``."""

    end: int
    array: int
    column: int
    stride: int


class Lookups(NamedTuple):
    """The tables of a program.

    tables  {conditions, as operands: the chains that they select}
    of_end  {line: conditions} of the chains' ends
    links   lines of the chains before their ends, which nothing else reads
    """

    tables: dict[tuple[int, ...], list[Chain]]
    of_end: dict[int, tuple[int, ...]]
    links: frozenset[int]


def find(program: Program, common: Mapping[int, tuple[int, int]]) -> Lookups:
    """The tables of a program; ``common`` are the array and column of each line that is an input for all samples."""
    chains: dict[int, tuple[tuple[int, ...], tuple[int, ...]]] = {}  # conditions, and lines that are chosen from
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
