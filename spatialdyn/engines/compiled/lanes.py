"""Lanes: a Numba type that holds one number of each of W samples, on which the recursions compile unchanged.

Lanes are an LLVM vector, or a plain double for W = 1. A product that the source adds or subtracts at once is fused with
that sum when it is emitted, by the same rule for every W, and LLVM may not fuse others: so a sample has the same bits
in every width. A comparison gives a Mask, which has no truth value of its own: ``anywhere`` and ``everywhere`` of
``algebra.scalars`` compute one.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, overload

from ...algebra import scalars
from ..polynomials import COSINE, HALF_PI, MAGIC, MAX_ANGLE, SINE

F8, I8, I32, TRUTH = ir.DoubleType(), ir.IntType(64), ir.IntType(32), ir.IntType(1)


class Lanes(types.Type):
    """The type of lanes: one number of each of ``width`` samples."""

    def __init__(self, width: int) -> None:
        """Of so many samples, a power of 2."""
        self.width = width
        super().__init__(f"lanes{width}")

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """A number that all samples share converts to lanes."""
        return Conversion.safe if isinstance(other, (types.Float, types.Integer)) else None


class Mask(types.Type):
    """The type of a mask: one truth value of each of ``width`` samples."""

    def __init__(self, width: int) -> None:
        """Of so many samples."""
        self.width = width
        super().__init__(f"mask{width}")

    def unify(self, typing_context: Any, other: Any) -> Any:
        """The common type of a variable that is one truth value before a loop and a mask within it."""
        return self if isinstance(other, types.Boolean) else None

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """A truth value that all samples share converts to a mask."""
        return Conversion.safe if isinstance(other, types.Boolean) else None


def vector(element: Any, width: int) -> Any:
    """LLVM's type of a number, or of a truth value, of each sample."""
    return element if width == 1 else ir.VectorType(element, width)


@register_default(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, kind: Any) -> None:
        super().__init__(dmm, kind, vector(F8, kind.width))


@register_default(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, kind: Any) -> None:
        super().__init__(dmm, kind, vector(TRUTH, kind.width))


# --- emission -----------------------------------------------------------------------------------------------


def width_of(kind: Any) -> int:
    """The number of samples in an LLVM type."""
    return kind.count if isinstance(kind, ir.VectorType) else 1


def constant(x: Any, width: int, element: Any = F8) -> Any:
    """One number in all lanes."""
    return element(x) if width == 1 else ir.VectorType(element, width)([x] * width)


def spread(builder: Any, x: Any, width: int) -> Any:
    """An LLVM number in all lanes."""
    if width == 1:
        return x
    kind = ir.VectorType(x.type, width)
    one = builder.insert_element(kind(ir.Undefined), x, I32(0))
    return builder.shuffle_vector(one, kind(ir.Undefined), ir.VectorType(I32, width)([0] * width))


def call(builder: Any, name: str, *arguments: Any) -> Any:
    """Call an LLVM intrinsic whose arguments and result have one type."""
    kind, n = arguments[0].type, width_of(arguments[0].type)
    full = f"llvm.{name}.f64" if n == 1 else f"llvm.{name}.v{n}f64"
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind] * len(arguments)), full)
    return builder.call(function, arguments)


def fma(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    return call(builder, "fma", a, b, c)


def product(builder: Any, a: Any, b: Any) -> Any:
    """a b, which a later sum may fuse."""
    made = builder.fmul(a, b)
    made.of_lanes = True
    return made


def _fusible(x: Any) -> bool:
    return getattr(x, "of_lanes", False)


def add(builder: Any, x: Any, y: Any) -> Any:
    """x + y, fused if x is a product, or else if y is one."""
    for product, other in ((x, y), (y, x)):
        if _fusible(product):
            a, b = product.operands
            return fma(builder, a, b, other)
    return builder.fadd(x, y)


def subtract(builder: Any, x: Any, y: Any) -> Any:
    """x - y, fused if x is a product, or else if y is one."""
    if _fusible(x):
        a, b = x.operands
        return fma(builder, a, b, builder.fneg(y))
    if _fusible(y):
        return fma(builder, builder.fneg(y.operands[0]), y.operands[1], x)
    return builder.fsub(x, y)


def size(builder: Any, x: Any) -> Any:
    """|x|."""
    return call(builder, "fabs", x)


def bits(builder: Any, mask: Any) -> Any:
    """The truth values as the bits of one number."""
    n = width_of(mask.type)
    return mask if n == 1 else builder.bitcast(mask, ir.IntType(n))


def some(builder: Any, mask: Any) -> Any:
    """Whether at least one lane is true."""
    found = bits(builder, mask)
    return builder.icmp_unsigned("!=", found, found.type(0))


def every(builder: Any, mask: Any) -> Any:
    """Whether all lanes are true."""
    found = bits(builder, mask)
    return builder.icmp_unsigned("==", found, found.type(-1))


def lane_of(builder: Any, x: Any, lane: int) -> Any:
    """The number of one sample."""
    return x if width_of(x.type) == 1 else builder.extract_element(x, I32(lane))


def put_lane(builder: Any, x: Any, number: Any, lane: int) -> Any:
    """Lanes with another number of one sample."""
    return number if width_of(x.type) == 1 else builder.insert_element(x, number, I32(lane))


def of_each(context: Any, builder: Any, function: Any, arguments: Any) -> Any:
    """Apply a function of floats lane by lane."""
    n = width_of(arguments[0].type)
    kind = types.float64(*[types.float64] * len(arguments))
    emit = context.get_function(function, kind)
    found = arguments[0].type(ir.Undefined)
    for lane in range(n):
        found = put_lane(builder, found, emit(builder, [lane_of(builder, a, lane) for a in arguments]), lane)
    return found


# --- operators ----------------------------------------------------------------------------------------------


def lanes_in(kinds: Any) -> Lanes | None:
    """The type of lanes among these types; None if there is none, or if a type is neither lanes nor a number."""
    found = [x for x in kinds if isinstance(x, Lanes)]
    if found and all(isinstance(x, (Lanes, types.Float, types.Integer)) for x in kinds):
        return found[0]
    return None


def _operator(functions: Any, emit: Callable[..., Any], arity: int = 2, truth: bool = False) -> None:
    for function in functions:

        class Template(AbstractTemplate):
            key = function

            def generic(self, args: Any, kws: Any) -> Any:
                kind = lanes_in(args)
                if kind is None or len(args) != arity:
                    return None
                return signature(Mask(kind.width) if truth else kind, *[kind] * arity)

        infer_global(function)(Template)
        lower_builtin(function, *[Lanes] * arity)(lambda context, builder, sig, args: emit(builder, *args))


_operator((operator.add, operator.iadd), add)
_operator((operator.sub, operator.isub), subtract)
_operator((operator.mul, operator.imul), product)
_operator((operator.truediv, operator.itruediv), lambda builder, x, y: builder.fdiv(x, y))
_operator((operator.neg,), lambda builder, x: builder.fneg(x), 1)
_operator((abs,), size, 1)
for _function, _sign in ((operator.gt, ">"), (operator.ge, ">="), (operator.lt, "<"), (operator.le, "<=")):
    _operator((_function,), lambda builder, x, y, sign=_sign: builder.fcmp_ordered(sign, x, y), truth=True)


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _to_lanes(context: Any, builder: Any, given: Any, kind: Any, x: Any) -> Any:
    return spread(builder, context.cast(builder, x, given, types.float64), kind.width)


@lower_cast(types.Boolean, Mask)
def _to_mask(context: Any, builder: Any, given: Any, kind: Any, x: Any) -> Any:
    return spread(builder, builder.trunc(x, TRUTH) if x.type != TRUTH else x, kind.width)


# --- the functions of ``algebra.scalars`` -------------------------------------------------------------------


def _intrinsic_of(emit: Callable[..., Any]) -> Any:
    """An intrinsic (lanes or numbers) -> lanes."""

    def typed(typing_context: Any, *given: Any) -> Any:
        kind = lanes_in(given[0] if len(given) == 1 and isinstance(given[0], types.BaseTuple) else given)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            parts = cgutils.unpack_tuple(builder, arguments[0], len(given[0]))
            parts = [context.cast(builder, x, k, kind) for x, k in zip(parts, given[0], strict=True)]
            return emit(context, builder, *parts)

        return (kind(given[0]), generate) if kind is not None else None

    def one(typing_context: Any, given: Any) -> Any:
        return typed(typing_context, given)

    return intrinsic(one)


def _above_zero(builder: Any, x: Any) -> Any:
    return builder.fcmp_ordered(">", x, constant(0.0, width_of(x.type)))


_select = _intrinsic_of(lambda context, b, x, positive, otherwise: b.select(_above_zero(b, x), positive, otherwise))
_exceeds = _intrinsic_of(
    lambda context, b, x, floor: b.select(
        b.fcmp_ordered(">", x, floor), constant(1.0, width_of(x.type)), constant(0.0, width_of(x.type))
    )
)
_sqrt = _intrinsic_of(lambda context, b, x: call(b, "sqrt", x))
_sin = _intrinsic_of(lambda context, b, x: of_each(context, b, math.sin, [x]))
_cos = _intrinsic_of(lambda context, b, x: of_each(context, b, math.cos, [x]))
_exp = _intrinsic_of(lambda context, b, x: of_each(context, b, math.exp, [x]))
_atan2 = _intrinsic_of(lambda context, b, y, x: of_each(context, b, math.atan2, [y, x]))


@overload(scalars.select)
def _select_lanes(x, positive, otherwise):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    if lanes_in((x, positive, otherwise)):
        return lambda x, positive, otherwise: _select((x, positive, otherwise))
    return None


@overload(scalars.series_or_closed)
def _series_or_closed_lanes(x, series, closed):  # type: ignore[no-untyped-def]
    if lanes_in((x, series, closed)):
        return lambda x, series, closed: _select((x, series, closed))
    return None


@overload(scalars.exceeds)
def _exceeds_lanes(x, floor):  # type: ignore[no-untyped-def]
    if lanes_in((x, floor)):
        return lambda x, floor: _exceeds((x, floor))
    return None


@overload(scalars.sqrt)
def _sqrt_lanes(x):  # type: ignore[no-untyped-def]
    return (lambda x: _sqrt((x,))) if isinstance(x, Lanes) else None


@overload(scalars.sin)
def _sin_lanes(x):  # type: ignore[no-untyped-def]
    return (lambda x: _sin((x,))) if isinstance(x, Lanes) else None


@overload(scalars.cos)
def _cos_lanes(x):  # type: ignore[no-untyped-def]
    return (lambda x: _cos((x,))) if isinstance(x, Lanes) else None


@overload(scalars.exp)
def _exp_lanes(x):  # type: ignore[no-untyped-def]
    return (lambda x: _exp((x,))) if isinstance(x, Lanes) else None


@overload(scalars.atan2)
def _atan2_lanes(y, x):  # type: ignore[no-untyped-def]
    return (lambda y, x: _atan2((y, x))) if lanes_in((y, x)) else None


def _truth_of(reduce: Callable[..., Any]) -> Any:
    def typed(typing_context: Any, mask: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return reduce(builder, arguments[0])

        return (types.boolean(mask), generate) if isinstance(mask, Mask) else None

    return intrinsic(typed)


_some, _every = _truth_of(some), _truth_of(every)


@overload(scalars.anywhere)
def _anywhere_lanes(mask):  # type: ignore[no-untyped-def]
    return (lambda mask: _some(mask)) if isinstance(mask, Mask) else None


@overload(scalars.everywhere)
def _everywhere_lanes(mask):  # type: ignore[no-untyped-def]
    return (lambda mask: _every(mask)) if isinstance(mask, Mask) else None


# --- cosines and sines, by the steps of ``sines`` -----------------------------------------------------------


def _turned(typing_context: Any, x: Any) -> Any:
    """(cos x, sin x, whether a lane is beyond the range of the polynomials or NaN)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        (x,), n = arguments, signature.args[0].width

        def f(v: float) -> Any:
            return constant(v, n)

        def w(v: int) -> Any:
            return constant(v, n, I8)

        words = vector(I8, n)
        large, small, least = HALF_PI["double", True]
        shift = f(MAGIC["double"])
        shifted = fma(builder, x, f(2.0 / math.pi), shift)
        k = builder.fsub(shifted, shift)
        whole = fma(builder, k, f(-large), x)
        r = fma(builder, k, f(-least), fma(builder, k, f(-small), whole))
        low = fma(builder, k, f(-small), builder.fsub(whole, r))
        z = builder.fmul(r, r)

        def horner(coefficients: Any) -> Any:
            p = f(coefficients[-1])
            for c in reversed(coefficients[:-1]):
                p = fma(builder, z, p, f(c))
            return p

        s = fma(builder, z, fma(builder, r, horner(SINE["double"]), low), r)
        c = fma(builder, z, horner((-0.5, *COSINE["double"])), f(1.0))
        quadrant = builder.bitcast(shifted, words)
        odd = builder.icmp_unsigned("!=", builder.and_(quadrant, w(1)), w(0))

        def signed(v: Any, of: Any) -> Any:
            sign = builder.and_(builder.shl(of, w(62)), w(-(1 << 63)))
            return builder.bitcast(builder.xor(builder.bitcast(v, words), sign), v.type)

        cosine = signed(builder.select(odd, s, c), builder.add(quadrant, w(1)))
        sine = signed(builder.select(odd, c, s), quadrant)
        within = every(builder, builder.fcmp_ordered("<=", size(builder, x), f(MAX_ANGLE)))
        return context.make_tuple(builder, signature.return_type, (cosine, sine, builder.not_(within)))

    return types.Tuple((x, x, types.boolean))(x), generate


turned: Any = intrinsic(_turned)
