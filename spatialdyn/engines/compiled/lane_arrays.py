"""Arrays and tables of lanes, and tiles of W samples, which are copied from and to the arrays of a batch."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import cache
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin
from numba.np import arrayobj

from .checks import LARGEST
from .lanes import F8, I8, I32, TRUTH, Lanes, constant, every, lane_of, put_lane, size, vector

LINE = 64  # alignment of scratch in bytes


class LanesRecord(types.Record):
    """A row of a table whose floats are lanes."""

    @property
    def dtype(self) -> np.dtype:
        """A NumPy dtype of the same size."""
        return np.dtype((np.void, self.size))


register_default(LanesRecord)(models.RecordModel)


@cache
def record(dtype: np.dtype, width: int) -> Any:
    """The type of a row, or of a field, of a table of this dtype; each field takes ``width`` times its bytes."""
    if dtype.names:
        fields: Any = [
            (name, {"type": record(dtype[name], width), "offset": cast(Any, dtype.fields)[name][1] * width})
            for name in dtype.names
        ]
        return LanesRecord(fields, dtype.itemsize * width, True)
    return Lanes(width) if dtype == np.float64 else types.int64


@cache
def array_of(kind: Any, axes: int) -> Any:
    """An intrinsic (memory, shape) -> array in C order with elements of this type."""
    array: Any = types.Array(kind, axes, "C")
    step = kind.size if isinstance(kind, types.Record) else 8 * kind.width

    def at(typing_context: Any, memory: Any, shape: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            made = context.make_array(array)(context, builder)
            extents = [builder.extract_value(arguments[1], axis) for axis in range(axes)]
            strides = [context.get_constant(types.intp, step)]
            for extent in reversed(extents[1:]):
                strides.insert(0, builder.mul(strides[0], extent))
            put, data = cast(Any, arrayobj.populate_array), builder.bitcast(arguments[0], made.data.type)
            put(made, data, extents, strides, context.get_constant(types.intp, step), meminfo=None)
            return made._getvalue()

        return array(memory, shape), generate

    return intrinsic(at)


def _lanes_of(typing_context: Any, x: Any) -> Any:
    """An array of floats as an array of lanes of one sample; a float as lanes."""
    if not isinstance(x, types.Array):
        kind: Any = Lanes(1)
        return kind(types.float64), lambda context, builder, signature, arguments: arguments[0]
    array: Any = types.Array(Lanes(1), x.ndim, x.layout, readonly=not x.mutable)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = context.make_array(x)(context, builder, arguments[0])
        made = context.make_array(array)(context, builder)
        put: Any = arrayobj.populate_array  # without reference counting: the caller holds the array
        put(made, given.data, given.shape, given.strides, given.itemsize, meminfo=None)
        return made._getvalue()

    return array(x), generate


lanes_of: Any = intrinsic(_lanes_of)


def _aligned(typing_context: Any, memory: Any, skipped: Any) -> Any:
    """The first aligned line of the memory, moved on by ``skipped`` bytes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = builder.ptrtoint(arguments[0], I8)
        line = builder.and_(builder.add(address, I8(LINE - 1)), I8(-LINE))
        return builder.inttoptr(builder.add(line, arguments[1]), cgutils.voidptr_t)

    return types.voidptr(types.voidptr, types.intp), generate


aligned: Any = intrinsic(_aligned)


# --- symmetric matrices -------------------------------------------------------------------------------------


class Lower(types.Type):
    """A symmetric matrix of lanes; a recursion writes both triangles, but entries above the diagonal are not stored."""

    mutable = True

    def __init__(self, width: int) -> None:
        """Of so many samples."""
        self.width = width
        super().__init__(f"lower{width}")


@register_default(Lower)
class _LowerModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, kind: Any) -> None:
        super().__init__(dmm, kind, vector(F8, kind.width).as_pointer())


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        matrix, place, _ = args
        if isinstance(matrix, Lower) and isinstance(place, types.BaseTuple) and len(place) == 2:
            return signature(types.none, matrix, types.UniTuple(types.intp, 2), Lanes(matrix.width))
        return None


def _triangle(builder: Any, row: Any) -> Any:
    """How many numbers the rows before this row have."""
    return builder.lshr(builder.mul(row, builder.add(row, I8(1))), I8(1))


@lower_builtin(operator.setitem, Lower, types.BaseTuple, Lanes)
def _set_lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    data, place, x = args
    row, column = (builder.extract_value(place, k) for k in range(2))
    with builder.if_then(builder.icmp_signed("<=", column, row)):
        at = builder.add(_triangle(builder, row), column)
        builder.store(x, builder.gep(data, [at]), align=8 * sig.args[0].width)
    return context.get_dummy_value()


@cache
def lower(width: int) -> Any:
    """An intrinsic (memory) -> Lower."""

    def at(typing_context: Any, memory: Any) -> Any:
        kind: Any = Lower(width)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], vector(F8, width).as_pointer())

        return kind(memory), generate

    return intrinsic(at)


@cache
def mirror(width: int) -> Any:
    """As ``drain`` for a Lower: an intrinsic (bodies, tile, address, n, first, last) that writes matrices (n, n).

    They are written row by row. Right of a row's subtree they are zero, as M is: nothing is read there.
    """
    kind = vector(F8, width)

    def write(typing_context: Any, bodies: Any, tile: Any, address: Any, n: Any, first: Any, last: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            table, tile, address, n, first, last = arguments
            row_at = builder.bitcast(context.make_array(bodies)(context, builder, table).data, cgutils.voidptr_t)
            rows = _rows(builder, address, builder.mul(n, n), first, last, width)
            of = builder.bitcast(tile, kind.as_pointer())
            finite = _Finite(builder, width)

            def read(row: Any, column: Any) -> Any:
                at = builder.add(_triangle(builder, row), column)
                return builder.load(builder.gep(of, [at]), align=8 * width)

            def larger(x: Any, y: Any) -> tuple[Any, Any]:
                above = builder.icmp_signed(">", x, y)
                return builder.select(above, x, y), builder.select(above, y, x)

            def block(row: Any, column: Any, place: Callable[[Any], tuple[Any, Any]]) -> None:
                xs = [read(*place(builder.add(column, I8(k)))) for k in range(width)]
                finite.note(xs)
                at = builder.add(builder.mul(row, n), column)
                for sample, x in zip(rows, _transposed(builder, xs), strict=True):
                    builder.store(x, _at(builder, sample, at, kind), align=8)

            def zeros(row: Any, column: Any) -> None:
                at = builder.add(builder.mul(row, n), column)
                for sample in rows:
                    builder.store(constant(0.0, width), _at(builder, sample, at, kind), align=8)

            def end_of(row: Any) -> Any:
                """The last row of the subtree, the world not counted, plus one."""
                at = builder.add(builder.mul(builder.add(row, I8(1)), I8(bodies.dtype.size)), I8(end))
                return builder.load(builder.bitcast(builder.gep(row_at, [at]), I8.as_pointer()))

            count, end = I8(width), bodies.dtype.offset("last_row")
            blocks = builder.sdiv(n, count)
            done = builder.mul(blocks, count)
            with cgutils.for_range(builder, n) as down:
                row = down.index
                within = builder.sdiv(builder.add(end_of(row), I8(width - 1)), count)  # blocks up to the subtree's end
                within = builder.select(builder.icmp_signed("<", within, blocks), within, blocks)
                below = builder.sdiv(builder.add(row, I8(1)), count)  # blocks up to the diagonal
                below = builder.select(builder.icmp_signed("<", below, blocks), below, blocks)
                past = builder.sdiv(builder.add(row, I8(width - 1)), count)  # the first block from the diagonal on
                past = builder.select(builder.icmp_signed("<", past, blocks), past, blocks)
                first_zero = builder.select(builder.icmp_signed("<", past, within), within, past)
                for start, stop, place in (
                    (I8(0), below, lambda column: (row, column)),
                    (below, past, lambda column: larger(row, column)),
                    (past, first_zero, lambda column: (column, row)),
                ):
                    with cgutils.for_range(builder, builder.sub(stop, start)) as along:
                        block(row, builder.mul(builder.add(start, along.index), count), place)
                with cgutils.for_range(builder, builder.sub(blocks, first_zero)) as along:
                    zeros(row, builder.mul(builder.add(first_zero, along.index), count))
                with cgutils.for_range(builder, builder.sub(n, done)) as left:
                    column = builder.add(done, left.index)
                    x = read(*larger(row, column))
                    finite.note([x])
                    at = builder.add(builder.mul(row, n), column)
                    for lane, sample in enumerate(rows):
                        builder.store(lane_of(builder, x, lane), builder.gep(sample, [at]))
            return finite.all()

        return types.boolean(bodies, types.voidptr, types.intp, types.intp, types.intp, types.intp), generate

    return intrinsic(write)


# --- tiles --------------------------------------------------------------------------------------------------


def _rows(builder: Any, address: Any, columns: Any, first: Any, last: Any, width: int) -> list[Any]:
    """Pointers to the rows of W samples; samples beyond the last have the row of the last."""
    found = []
    for lane in range(width):
        s = builder.add(first, I8(lane))
        s = builder.select(builder.icmp_signed("<", s, last), s, last)
        byte = builder.mul(builder.mul(s, columns), I8(8))
        found.append(builder.inttoptr(builder.add(address, byte), F8.as_pointer()))
    return found


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """W vectors of W numbers, transposed by shuffles."""
    n = len(rows)
    step = 1
    while step < n:
        low = ir.VectorType(I32, n)([k if not k & step else n + (k ^ step) for k in range(n)])
        high = ir.VectorType(I32, n)([k | step if not k & step else n + k for k in range(n)])
        found = list(rows)
        for k in range(n):
            if not k & step:
                a, b = rows[k], rows[k | step]
                found[k], found[k | step] = builder.shuffle_vector(a, b, low), builder.shuffle_vector(a, b, high)
        rows, step = found, 2 * step
    return rows


class _Finite:
    """Whether all noted numbers are finite."""

    def __init__(self, builder: Any, width: int) -> None:
        self._builder, self._width = builder, width
        self._found = cgutils.alloca_once_value(builder, TRUTH(1))

    def note(self, xs: Any) -> None:
        """Note some vectors of numbers."""
        builder, good = self._builder, None
        for x in xs:
            one = builder.fcmp_ordered("<=", size(builder, x), constant(LARGEST, self._width))
            good = one if good is None else builder.and_(good, one)
        builder.store(builder.and_(builder.load(self._found), every(builder, good)), self._found)

    def all(self) -> Any:
        """Whether all noted numbers are finite, as an LLVM truth value."""
        return self._builder.load(self._found)


def _at(builder: Any, pointer: Any, index: Any, kind: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [index]), kind.as_pointer())


@cache
def fill(width: int) -> Any:
    """An intrinsic (address, columns, first, last, tile) that reads the rows of W samples into a tile."""
    kind = vector(F8, width)

    def read(typing_context: Any, address: Any, columns: Any, first: Any, last: Any, tile: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            address, columns, first, last, tile = arguments
            rows = _rows(builder, address, columns, first, last, width)
            to = builder.inttoptr(builder.ptrtoint(tile, I8), F8.as_pointer())
            blocks = builder.sdiv(columns, I8(width))
            with cgutils.for_range(builder, blocks) as loop:
                at = builder.mul(loop.index, I8(width))
                read = [builder.load(_at(builder, row, at, kind), align=8) for row in rows]
                for k, x in enumerate(_transposed(builder, read)):
                    place = builder.mul(builder.add(at, I8(k)), I8(width))
                    builder.store(x, _at(builder, to, place, kind), align=8 * width)
            done = builder.mul(blocks, I8(width))
            with cgutils.for_range(builder, builder.sub(columns, done)) as loop:
                at = builder.add(done, loop.index)
                x = kind(ir.Undefined)
                for lane, row in enumerate(rows):
                    x = put_lane(builder, x, builder.load(builder.gep(row, [at])), lane)
                builder.store(x, _at(builder, to, builder.mul(at, I8(width)), kind), align=8 * width)
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, types.intp, types.intp, types.voidptr), generate

    return intrinsic(read)


@cache
def drain(width: int) -> Any:
    """An intrinsic (tile, address, columns, first, last) that writes a tile to the rows of W samples.

    The intrinsic returns whether all numbers are finite.
    """
    kind = vector(F8, width)

    def write(typing_context: Any, tile: Any, address: Any, columns: Any, first: Any, last: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            tile, address, columns, first, last = arguments
            rows = _rows(builder, address, columns, first, last, width)
            of = builder.inttoptr(builder.ptrtoint(tile, I8), F8.as_pointer())
            finite = _Finite(builder, width)

            def tile_at(at: Any) -> Any:
                return builder.load(_at(builder, of, builder.mul(at, I8(width)), kind), align=8 * width)

            blocks = builder.sdiv(columns, I8(width))
            with cgutils.for_range(builder, blocks) as loop:
                at = builder.mul(loop.index, I8(width))
                found = [tile_at(builder.add(at, I8(k))) for k in range(width)]
                finite.note(found)
                for row, x in zip(rows, _transposed(builder, found), strict=True):
                    builder.store(x, _at(builder, row, at, kind), align=8)
            done = builder.mul(blocks, I8(width))
            with cgutils.for_range(builder, builder.sub(columns, done)) as loop:
                at = builder.add(done, loop.index)
                x = tile_at(at)
                finite.note([x])
                for lane, row in enumerate(rows):
                    builder.store(lane_of(builder, x, lane), builder.gep(row, [at]))
            return finite.all()

        return types.boolean(types.voidptr, types.intp, types.intp, types.intp, types.intp), generate

    return intrinsic(write)
