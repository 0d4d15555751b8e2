"""Arrays and tables of lanes, and the tiles of W samples between them and the arrays of a batch."""

from __future__ import annotations

from functools import cache
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.extending import intrinsic
from numba.np import arrayobj

from .lanes import F8, I8, I32, Lanes, every, size, constant, vector

LINE = 64  # bytes that scratch is aligned to


class LanesRecord(types.Record):  # type: ignore[misc]
    """A row of a table whose floats are lanes."""

    @property
    def dtype(self) -> np.dtype:
        """Of NumPy, its size alone."""
        return np.dtype((np.void, self.size))


register_default(LanesRecord)(models.RecordModel)


@cache
def record(dtype: np.dtype, width: int) -> Any:
    """The type of a row, or a field, of a table of that dtype; each field has ``width`` times its bytes."""
    if dtype.names:
        fields = [
            (name, {"type": record(dtype[name], width), "offset": cast(Any, dtype.fields)[name][1] * width})
            for name in dtype.names
        ]
        return LanesRecord(fields, dtype.itemsize * width, True)
    return Lanes(width) if dtype == np.float64 else types.int64


@cache
def array_of(kind: Any, axes: int) -> Any:
    """An intrinsic (memory, shape) -> array in C order of such elements."""
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
    """An array of floats as one of lanes of one sample; a float as lanes."""
    if not isinstance(x, types.Array):
        kind: Any = Lanes(1)
        return kind(types.float64), lambda context, builder, signature, arguments: arguments[0]
    array: Any = types.Array(Lanes(1), x.ndim, x.layout, readonly=not x.mutable)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = context.make_array(x)(context, builder, arguments[0])
        made = context.make_array(array)(context, builder)
        put: Any = arrayobj.populate_array  # without its count of references: the caller holds it
        put(made, given.data, given.shape, given.strides, given.itemsize, meminfo=None)
        return made._getvalue()

    return array(x), generate


lanes_of: Any = intrinsic(_lanes_of)


def _aligned(typing_context: Any, memory: Any, skipped: Any) -> Any:
    """The first line of memory, and so many bytes on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = builder.ptrtoint(arguments[0], I8)
        line = builder.and_(builder.add(address, I8(LINE - 1)), I8(-LINE))
        return builder.inttoptr(builder.add(line, arguments[1]), cgutils.voidptr_t)

    return types.voidptr(types.voidptr, types.intp), generate


aligned: Any = intrinsic(_aligned)


# --- tiles --------------------------------------------------------------------------------------------------


def _rows(builder: Any, address: Any, columns: Any, first: Any, last: Any, width: int) -> list[Any]:
    """Pointers to the rows of W samples; beyond the last one the last."""
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


def _at(builder: Any, pointer: Any, index: Any, kind: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [index]), kind.as_pointer())


@cache
def fill(width: int) -> Any:
    """An intrinsic (address, columns, first, last, tile's address) that reads the rows of W samples into a tile.

    It returns whether all numbers are finite.
    """
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
                    x = builder.insert_element(x, builder.load(builder.gep(row, [at])), I32(lane))
                builder.store(x, _at(builder, to, builder.mul(at, I8(width)), kind), align=8 * width)
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, types.intp, types.intp, types.voidptr), generate

    return intrinsic(read)


@cache
def drain(width: int) -> Any:
    """An intrinsic (tile, address, columns, first, last) that writes a tile to the rows of W samples.

    It returns whether all numbers are finite.
    """
    kind = vector(F8, width)
    largest = 1.7976931348623157e308

    def write(typing_context: Any, tile: Any, address: Any, columns: Any, first: Any, last: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            tile, address, columns, first, last = arguments
            rows = _rows(builder, address, columns, first, last, width)
            of = builder.inttoptr(builder.ptrtoint(tile, I8), F8.as_pointer())
            finite = cgutils.alloca_once_value(builder, ir.IntType(1)(1))

            def tile_at(at: Any) -> Any:
                return builder.load(_at(builder, of, builder.mul(at, I8(width)), kind), align=8 * width)

            def note(xs: Any) -> None:
                good = None
                for x in xs:
                    one = builder.fcmp_ordered("<=", size(builder, x), constant(largest, width))
                    good = one if good is None else builder.and_(good, one)
                builder.store(builder.and_(builder.load(finite), every(builder, good)), finite)

            blocks = builder.sdiv(columns, I8(width))
            with cgutils.for_range(builder, blocks) as loop:
                at = builder.mul(loop.index, I8(width))
                found = [tile_at(builder.add(at, I8(k))) for k in range(width)]
                note(found)
                for row, x in zip(rows, _transposed(builder, found), strict=True):
                    builder.store(x, _at(builder, row, at, kind), align=8)
            done = builder.mul(blocks, I8(width))
            with cgutils.for_range(builder, builder.sub(columns, done)) as loop:
                at = builder.add(done, loop.index)
                x = tile_at(at)
                note([x])
                for lane, row in enumerate(rows):
                    builder.store(builder.extract_element(x, I32(lane)), builder.gep(row, [at]))
            return builder.load(finite)

        return types.boolean(types.voidptr, types.intp, types.intp, types.intp, types.intp), generate

    return intrinsic(write)
