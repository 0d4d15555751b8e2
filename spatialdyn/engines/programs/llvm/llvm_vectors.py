"""LLVM text of straight-line code on vectors: arithmetic, sin, cos, exp and atan2, transposition.

sin and cos: see ``polynomials``; the quadrant is selected. exp: n = rint(x / ln 2) by adding and subtracting, then
x - n ln 2 with ln 2 in two parts, a polynomial, and the product with 2ⁿ.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ...polynomials import COSINE, HALF_PI, MAGIC, SINE
from .llvm_text import Body

PI_LOW = 1.2246467991473532e-16  # π - math.pi

# coefficients of (atan(t) / t - 1) / t² in t², on |t| <= tan(π/8): interpolated at Chebyshev points in 60 digits
ARCTANGENT = (
    -0.3333333333333333,
    0.19999999999995516,
    -0.14285714284665682,
    0.11111111015187018,
    -0.0909090457530649,
    0.07692183125376892,
    -0.06664510525508936,
    0.05858140904866328,
    -0.050854078345894844,
    0.03923044778479309,
    -0.019175404711104935,
)
TAN_EIGHTH = 0.41421356237309503

LN2 = {  # in two parts: the product of n and the first is exact
    "double": (6.93147180369123816490e-01, 1.90821492927058770002e-10),
    "float": (0.693359375, -0.00021219444005469057),
}
EXPONENT = {"double": (-746.0, 710.0), "float": (-104.0, 89.0)}  # outside of this range exp is 0 or infinite
# coefficients of (exp(r) - 1 - r) / r² on |r| <= ln(2) / 2: interpolated at Chebyshev points in 60 digits
EXPONENTIAL = {
    "double": (
        0.5000000000000001,
        0.16666666666666669,
        0.041666666666623824,
        0.008333333333330039,
        0.0013888888917367081,
        0.00019841269863171557,
        2.4801521057868204e-05,
        2.7557268276905696e-06,
        2.7620201591031547e-07,
        2.5100472505694996e-08,
    ),
    "float": (0.5, 0.16666576666119928, 0.04166655421298415, 0.008363232883682618, 0.0013926250831497611),
}

ZERO = "zeroinitializer"


class Vectors(Body):
    """A function body on SIMD vectors of ``lanes`` numbers: the instructions that programs need."""

    def __init__(self, scalar: str, lanes: int, fma: bool) -> None:
        """A body on lanes of ``double`` or ``float``; ``fma``: the host has fused multiply-add."""
        super().__init__()
        self.scalar, self.lanes, self.fma = scalar, lanes, fma
        self.size = 8 if scalar == "double" else 4
        self.vector = self.kind(lanes)
        self.bits = f"<{lanes} x i{8 * self.size}>"
        self.truth = f"<{lanes} x i1>"
        self._turns: dict[str, tuple[str, str]] = {}

    def kind(self, count: int) -> str:
        """The type of a vector of ``count`` numbers."""
        return f"<{count} x {self.scalar}>"

    def number(self, base: str, count: int | str) -> str:
        """The address of number ``count`` behind ``base``."""
        return self.at(self.scalar, base, count)

    def load_vector(self, base: str, count: int) -> str:
        """Vector ``count`` of an aligned array."""
        return self.load(self.vector, self.at(self.vector, base, count), self.size * self.lanes)

    def store_vector(self, value: str, base: str, count: int) -> None:
        """Write vector ``count`` of an aligned array."""
        self.store(self.vector, value, self.at(self.vector, base, count), self.size * self.lanes)

    def spread(self, base: str, count: int, afresh: bool = False) -> str:
        """Number ``count`` behind ``base``, on all lanes; ``afresh``: load it here, even if it was loaded before."""
        v = self.vector
        one = self.put(f"insertelement {v} poison, {self.scalar} {self.load_number(base, count, afresh)}, i64 0")
        return self.put(f"shufflevector {v} {one}, {v} poison, <{self.lanes} x i32> zeroinitializer")

    def load_number(self, base: str, count: int, afresh: bool = False) -> str:
        """Number ``count`` behind ``base``; ``afresh`` as of ``spread``."""
        return self.load(("volatile " if afresh else "") + self.scalar, self.number(base, count), self.size)

    def constant(self, value: float) -> str:
        if self.scalar == "float":
            with np.errstate(over="ignore"):  # infinite constants are allowed: such samples are recomputed
                value = float(np.float32(value))
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return f"splat ({self.scalar} 0x{bits:016X})"

    def integer(self, value: int) -> str:
        return f"splat (i{8 * self.size} {value})"

    def binary(self, word: str, a: str, b: str) -> str:
        return self.put(f"{word} {self.vector} {a}, {b}")

    def negative(self, a: str) -> str:
        return self.put(f"fneg {self.vector} {a}")

    def suffix(self) -> str:
        return f"v{self.lanes}f{8 * self.size}"

    def fused(self, a: str, b: str, c: str) -> str:
        """a b + c, rounded once if the host has fused multiply-add."""
        v = self.vector
        if self.fma:
            return self.put(f"call {v} @llvm.fma.{self.suffix()}({v} {a}, {v} {b}, {v} {c})")
        return self.binary("fadd", self.binary("fmul", a, b), c)

    def unary(self, function: str, a: str) -> str:
        return self.put(f"call {self.vector} @llvm.{function}.{self.suffix()}({self.vector} {a})")

    def first_place(self, a: str) -> str:
        """The largest power of 2 up to |a|, by its exponent bits; 0 for 0 and for subnormal numbers."""
        mask = 0x7FF << 52 if self.scalar == "double" else 0xFF << 23
        exponent = self.put(f"and {self.bits} {self._bits(a)}, {self.integer(mask)}")
        return self.put(f"bitcast {self.bits} {exponent} to {self.vector}")

    def compare(self, word: str, a: str, b: str) -> str:
        """The mask of a comparison: ``ogt``, ``ole``, ..."""
        return self.put(f"fcmp {word} {self.vector} {a}, {b}")

    def above_zero(self, a: str) -> str:
        """The mask of a > 0."""
        return self.compare("ogt", a, ZERO)

    def select(self, condition: str, a: str, b: str) -> str:
        """a where the mask holds, else b."""
        return self.put(f"select {self.truth} {condition}, {self.vector} {a}, {self.vector} {b}")

    def shuffle(self, kind: str, a: str, b: str, places: Iterable[int]) -> str:
        """The numbers at ``places`` in the concatenation of two vectors of one type."""
        chosen = [f"i32 {k}" for k in places]
        return self.put(f"shufflevector {kind} {a}, {kind} {b}, <{len(chosen)} x i32> <{', '.join(chosen)}>")

    def poisoned_unless(self, condition: str, poison: str) -> str:
        """poison where the mask holds, else NaN."""
        return self.select(condition, poison, self.constant(math.nan))

    def sincos(self, x: str) -> tuple[str, str]:
        """(sin x, cos x), computed once for each x."""
        if x not in self._turns:
            self.turn([x])
        return self._turns[x]

    def turn(self, angles: Sequence[str]) -> None:
        """Compute the sines and cosines of several angles, in step.

        A sine is a chain of operations, each of which waits for the one before. A CPU looks ahead over few operations
        that wait, so it runs chains side by side only if their text alternates.
        """
        for _ in zip(*map(self._sincos, angles), strict=True):
            pass

    def _sincos(self, x: str) -> Iterator[None]:
        """The steps of one angle."""
        s, v, k = self.scalar, self.vector, self.constant
        shifted = self.fused(x, k(2.0 / math.pi), k(MAGIC[s]))
        yield
        n = self.binary("fsub", shifted, k(MAGIC[s]))
        yield
        r, low = self._reduced(x, n)
        yield
        z = self.binary("fmul", r, r)
        p, q = k(SINE[s][-1]), k(COSINE[s][-1])
        ps, qs = list(reversed(SINE[s][:-1])), [*reversed(COSINE[s][:-1]), -0.5]
        while ps or qs:
            yield
            if len(ps) >= len(qs):
                p = self.fused(z, p, k(ps.pop(0)))
            else:
                q = self.fused(z, q, k(qs.pop(0)))
        yield
        # r differs from the reduced angle by low, at most half an ulp of r; where |r| > 1/2 that is up to one ulp of
        # the sine. Adding z low keeps the sine within 1.5 ulp; it vanishes near 0, where low has no digits
        sine = self.fused(r, p, low)
        yield
        cosine = self.fused(z, q, k(1.0))  # one rounding: if 1 - z/2 were rounded too, the error would be 1.6 ulp
        yield
        sine = self.fused(z, sine, r)
        yield
        quadrant = self.put(f"bitcast {v} {shifted} to {self.bits}")
        one, top = self.integer(1), 62 if s == "double" else 30
        odd = self.put(f"icmp ne {self.bits} {self.put(f'and {self.bits} {quadrant}, {one}')}, zeroinitializer")
        flip = self.put(f"shl {self.bits} {quadrant}, {self.integer(top)}")
        flip = self.put(f"and {self.bits} {flip}, {self.integer(-(2 << top))}")
        yield
        results = []
        for swapped, straight in ((cosine, sine), (self.negative(sine), cosine)):
            bits = self._bits(self.select(odd, swapped, straight))
            results.append(self.put(f"bitcast {self.bits} {self.put(f'xor {self.bits} {bits}, {flip}')} to {v}"))
        self._turns[x] = results[0], results[1]
        yield

    def exp(self, x: str) -> str:
        """exp x within one ulp, with gradual underflow; infinite where it overflows.

        2ⁿ is the product of two powers of 2 whose exponents are in the range of the type.
        """
        s, v, k = self.scalar, self.vector, self.constant
        least, most = EXPONENT[s]
        x = self.select(self.compare("ogt", x, k(most)), k(most), x)
        x = self.select(self.compare("olt", x, k(least)), k(least), x)
        shifted = self.fused(x, k(1.0 / math.log(2.0)), k(MAGIC[s]))
        n = self.binary("fsub", shifted, k(MAGIC[s]))
        large, small = LN2[s]
        first = self.binary("fsub", x, self.binary("fmul", n, k(large)))  # exact
        r = self.fused(n, k(-small), first)
        low = self.fused(n, k(-small), self.binary("fsub", first, r))
        p = k(EXPONENTIAL[s][-1])
        for c in reversed(EXPONENTIAL[s][:-1]):
            p = self.fused(r, p, k(c))
        p = self.binary("fadd", k(1.0), self.binary("fadd", r, self.fused(self.binary("fmul", r, r), p, low)))
        whole = self.put(f"sub {self.bits} {self._bits(shifted)}, {self._bits(k(MAGIC[s]))}")
        half = self.put(f"ashr {self.bits} {whole}, {self.integer(1)}")
        mantissa, bias = (52, 1023) if s == "double" else (23, 127)
        for part in (half, self.put(f"sub {self.bits} {whole}, {half}")):
            biased = self.put(f"add {self.bits} {part}, {self.integer(bias)}")
            power = self.put(f"shl {self.bits} {biased}, {self.integer(mantissa)}")
            p = self.binary("fmul", p, self.put(f"bitcast {self.bits} {power} to {v}"))
        return p

    def _bits(self, x: str) -> str:
        return self.put(f"bitcast {self.vector} {x} to {self.bits}")

    def atan2(self, y: str, x: str) -> str:
        """The angle of the point (x, y) within 3 ulp; NaN at the origin, where the angle depends on the signs of zero.

        It is the arctangent of the smaller over the larger of |x| and |y|, rotated by π/4 if that quotient is above
        tan(π/8), then moved to the octant of the point.
        """
        k, v, choose = self.constant, self.vector, self.select

        def parts(angle: float) -> tuple[str, str]:
            """A multiple of π as a float, and the remainder."""
            kind = np.float64 if self.scalar == "double" else np.float32
            large = float(kind(angle))
            return k(large), k(angle - large + angle / math.pi * PI_LOW)

        wide, tall = self.unary("fabs", x), self.unary("fabs", y)
        steep = self.compare("ogt", tall, wide)
        small, large = choose(steep, wide, tall), choose(steep, tall, wide)
        middle = self.compare("ogt", small, self.binary("fmul", large, k(TAN_EIGHTH)))
        above = choose(middle, self.binary("fsub", small, large), small)
        below = choose(middle, self.binary("fadd", small, large), large)
        t = self.binary("fdiv", above, below)
        z = self.binary("fmul", t, t)
        p = k(ARCTANGENT[-1])
        for c in reversed(ARCTANGENT[:-1]):
            p = self.fused(z, p, k(c))
        zero, (turned, low) = k(0.0), parts(math.pi / 4)
        angle = self.fused(self.binary("fmul", t, z), p, choose(middle, low, zero))
        angle = self.binary("fadd", self.binary("fadd", t, angle), choose(middle, turned, zero))
        behind = self.compare("olt", x, ZERO)
        for where, whole in ((steep, math.pi / 2), (behind, math.pi)):
            turned, low = parts(whole)
            angle = choose(where, self.binary("fsub", turned, self.binary("fsub", angle, low)), angle)
        return self.put(f"call {v} @llvm.copysign.{self.suffix()}({v} {angle}, {v} {y})")

    def _reduced(self, x: str, n: str) -> tuple[str, str]:
        """r = x - n π/2 rounded, and its rounding error; where |r| > 1/2, half an ulp of r is an ulp of sin r."""
        k = self.constant
        *parts, least = HALF_PI[self.scalar, self.fma]
        if self.fma:
            large, small = parts
            whole = self.fused(n, k(-large), x)  # exact
            r = self.fused(n, k(-least), self.fused(n, k(-small), whole))
            return r, self.fused(n, k(-small), self.binary("fsub", whole, r))
        r, rest = x, ""
        for part in parts:
            taken = self.binary("fmul", n, k(part))  # exact; the rounding error of the difference is kept
            less = self.binary("fsub", r, taken)
            lost = self.binary("fsub", self.binary("fsub", r, less), taken)
            r, rest = less, self.binary("fadd", rest, lost) if rest else lost
        rest = self.binary("fsub", rest, self.binary("fmul", n, k(least)))
        whole = self.binary("fadd", r, rest)
        return whole, self.binary("fadd", self.binary("fsub", r, whole), rest)

    def transposed(self, vectors: list[str]) -> list[str]:
        """Transpose columns in groups of len(vectors) lanes by log2(len(vectors)) rounds of shuffles."""
        size, W = len(vectors), self.lanes
        d = 1
        while d < size:
            swapped = [lane ^ d for lane in range(W)]
            mask_low = [(lane if not lane & d else W + lane - d) for lane in range(W)]
            mask_high = [(lane + d if not lane & d else W + lane) for lane in range(W)]
            new = list(vectors)
            upper = self._lanes_with(d) if self._merges(d) else ""
            for i in range(size):
                if not i & d:
                    a, b = vectors[i], vectors[i | d]
                    if upper:
                        new[i] = self.select(upper, self.shuffle(self.vector, b, b, swapped), a)
                        new[i | d] = self.select(upper, b, self.shuffle(self.vector, a, a, swapped))
                    else:
                        new[i], new[i | d] = (self.shuffle(self.vector, a, b, mask) for mask in (mask_low, mask_high))
            vectors, d = new, 2 * d
        return vectors

    def _merges(self, d: int) -> bool:
        """Whether blocks of d lanes are exchanged by a shuffle of one vector into some lanes of the other.

        AVX-512 exchanges neighbouring 128-bit blocks, or neighbouring numbers of float32, of two vectors in one
        instruction only by indices in a third register. Among multiply-adds such a shuffle takes as long as 1.7 of them
        on Zen 4; a shuffle into the lanes of a mask takes no time there. It saves 2 % of rnea of a UR5.
        """
        return self.lanes * self.size == 64 and d * self.size in (4, 16)

    def _lanes_with(self, d: int) -> str:
        """The mask of lanes whose index has bit d. LLVM does not see its value, else it would choose indices again."""
        bits, kind = sum(1 << lane for lane in range(self.lanes) if lane & d), f"i{self.lanes}"
        hidden = self.put(f'call {kind} asm "", "=r,0"({kind} {bits})')
        return self.put(f"bitcast {kind} {hidden} to {self.truth}")
