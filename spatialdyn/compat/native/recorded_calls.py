"""Library calls that record their inputs and result in memory of the Data.

The caller of ``rnea`` may read the joint forces later, when q has changed in place: so inputs and result are copied. A
call is a builtin of its program or table kernel.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import inline
from ...engines.compiled import entries, numba_kernels
from ...engines.compiled.memory import places, word
from ...engines.object_layout import Words
from ...engines.programs.llvm.call_words import ARRAY as INPUT
from ...engines.programs.llvm.call_words import FIXED, NUMBER
from ...engines.programs.run import single_call
from ...engines.programs.run.call_code import CallCode
from ...engines.programs.run.single_call import Parameter, unavailable

ARRAY, PARTS, RESULT = range(3)  # what a recorded call returns
NOT_OWN = 0, 0, 0  # the code of a plan that reads that of a CallCode
Array = NDArray[np.float64]
Builtin = Callable[..., Any]
HEAD = 64  # bytes before a table


class Table:
    """A copy of a table of bodies, and two blocks of numbers: those of a Model, which edits write, and the table's own.

    bytes    of the table, before which stands the time when joints moved; ``address`` theirs
    """

    def __init__(self, bodies: Any, now: Array, then: Array) -> None:
        """Of a table as bytes."""
        memory = np.empty(HEAD + len(bodies), np.uint8)
        self.now, self.then, self.bytes = now, then, memory[HEAD:]
        self.bytes[:] = bodies
        self.address = memory.ctypes.data + HEAD
        self._moved = memory[HEAD - 8 : HEAD].view(np.int64)
        self._moved[0] = 0

    def note_move(self) -> None:
        """Note that joints were moved: places of calls before are no longer computed on this table."""
        self._moved[0] = clock.now[0] + 1


class Clock:
    """Stamps that order calls in time; builtins advance it too."""

    def __init__(self) -> None:
        self.now = array("q", [0])

    def __call__(self) -> int:
        """A new stamp."""
        self.now[0] += 1
        return self.now[0]


clock = Clock()


@inline
def write_stamp(clock: int, time: int) -> None:
    """Advance a clock and write its new stamp to an address."""
    places(clock, (1,))[0] += 1
    places(time, (1,))[0] = word(clock, 0)


def address(x: array[int]) -> int:
    """Of the numbers of an array."""
    return x.buffer_info()[0]


def record(count: int, memory: Array, result: Array | None, stamp: array[int], table: Table) -> Words:
    """The words of a builtin that records its first inputs, this many, in memory, its result, if given, and its stamp.

    stamp  array whose first word is written
    table  the Table of the call: if the numbers of the Model are other than its own, the call is not answered
    """
    places = {"memory": memory.ctypes.data, "result": 0 if result is None else result.ctypes.data}
    places |= {"now": table.now.ctypes.data, "then": table.then.ctypes.data, "bytes": table.now.nbytes}
    made = single_call.record(count=count, clock=address(clock.now), time=address(stamp), **places)
    made.alive = memory, result, stamp, table, clock
    return made


def recorded_call(
    code: CallCode,
    sizes: Mapping[str, int],
    recorded: Words | None = None,
    unused: int = 0,
    returns: int = ARRAY,
    result: Array | None = None,
    otherwise: Builtin = unavailable,
) -> Builtin:
    """``(*inputs, *unused) -> result`` of the code of a public call for one sample, a builtin that may record.

    sizes     nq, nv, njoints
    recorded  words of ``record``
    unused    number of vectors (nv,) that are recorded only
    returns   ARRAY, a new one; PARTS, a tuple of the parts of a result of three axes; RESULT: ``result`` is written in
              place, and True returned
    otherwise  called with the arguments where the builtin does not apply

    External forces are a last argument (6 njoints,).
    """
    given: list[single_call.Described] = []
    for x in code.spec.present:
        shape = tuple(int(sizes.get(str(n), n)) for n in x.shape)
        given.append((math.prod(shape),) if x.name == "fext" else shape)
    given += [(sizes["nv"],)] * unused
    shape = tuple(int(sizes.get(str(n), n)) for n in numba_kernels.kernel_shape(code.spec.output))
    place = np.empty(shape) if returns == PARTS else result if returns == RESULT else None
    output = single_call.array(shape) if place is None else single_call.placed(shape, place.ctypes.data)
    several = single_call.PARTS if returns == PARTS else single_call.ONE
    plan = single_call.plan(NOT_OWN, [output], given, several, (code, place), code.address, recorded)
    kinds = [Parameter(f"x{k}", NUMBER if x == () else INPUT) for k, x in enumerate(given)]
    return single_call.bound(otherwise, kinds, plan)


class Follower:
    """A number that follows from others, for a builtin that returns it, which does not apply where they were edited.

    plan  that of the builtin, of one parameter, which no caller passes
    """

    def __init__(self, numbers: Array) -> None:
        self._numbers = numbers
        self._value, self._then, stamps = np.empty(1), np.empty_like(numbers), array("q", [0, 0])
        places = {"now": numbers.ctypes.data, "then": self._then.ctypes.data, "memory": self._value.ctypes.data}
        noted = single_call.record(**places, clock=address(stamps), time=address(stamps) + 8, bytes=numbers.nbytes)
        program, given = (single_call.copy_entry(), 8, entries.NO_LIMIT.ctypes.data), self._value.ctypes.data
        alive = self._value, numbers, self._then, stamps
        self.plan = single_call.plan(program, [()], [single_call.placed((), given)], alive=alive, record=noted)

    def keep(self, x: float) -> None:
        """The number that follows from the others as they are now."""
        self._value[0], self._then[...] = x, self._numbers


def rerun(code: CallCode, inputs: Sequence[Array], out: Array) -> Builtin:
    """``() -> True``: a builtin that writes a call's result at the numbers that are in ``inputs`` to ``out``."""
    return _in_place(NOT_OWN, inputs, out, code.address, code)


def copier(x: Array, out: Array) -> Builtin:
    """``() -> True``: a builtin that copies numbers."""
    program = single_call.copy_entry(), x.nbytes, entries.NO_LIMIT.ctypes.data
    return _in_place(program, [x], out, 0, None)


def _in_place(program: tuple[int, int, int], inputs: Sequence[Array], out: Array, shared: int, alive: Any) -> Builtin:
    places = [single_call.placed(x.shape, x.ctypes.data) for x in inputs]
    plan = single_call.plan(
        program, [single_call.placed(out.shape, out.ctypes.data)], places, alive=(inputs, out, alive), shared=shared
    )
    return single_call.bound(unavailable, [Parameter(f"x{k}", FIXED) for k in range(len(places))], plan)
