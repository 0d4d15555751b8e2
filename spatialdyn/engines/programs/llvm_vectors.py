"""LLVM text of straight-line code on vectors: arithmetic, sin, cos and atan2, transposition.

sin and cos: n = rint(x 2/π) by adding and subtracting 1.5 · 2⁵², x - n π/2 in three parts (Cody, Waite), the
minimax polynomials of fdlibm, quadrants by selection.
"""

from __future__ import annotations

import math
import struct

import numpy as np

MAGIC = {"double": 6755399441055744.0, "float": 12582912.0}
HALF_PI: dict[tuple[str, bool], tuple[float, ...]] = {
    # with fma: parts of full precision; without: parts whose product with n is exact
    ("double", True): (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33),
    ("double", False): (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    ("float", True): (1.5707963705062866, -4.371138828673793e-08, -1.7151245100058819e-15),
    ("float", False): (
        1.5703125,
        0.0004825592041015625,
        1.2665987014770508e-06,
        9.89530235528946e-10,
        2.5579538487363607e-12,
        5.390302953474238e-15,
    ),
}
PI_LOW = 1.2246467991473532e-16  # π less math.pi
SINE = {
    "double": (
        -1.66666666666666324348e-01,
        8.33333333332248946124e-03,
        -1.98412698298579493134e-04,
        2.75573137070700676789e-06,
        -2.50507602534068634195e-08,
        1.58969099521155010221e-10,
    ),
    "float": (-1 / 6, 1 / 120, -1 / 5040, 1 / 362880),  # a term more than float32 has digits, or 1.6 ulp
}
COSINE = {
    "double": (
        4.16666666666666019037e-02,
        -1.38888888888741095749e-03,
        2.48015872894767294178e-05,
        -2.75573143513906633035e-07,
        2.08757232129817482790e-09,
        -1.13596475577881948265e-11,
    ),
    "float": (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
}

# of (atan(t) / t - 1) / t² in t², on |t| <= tan(π/8): interpolated at Chebyshev's points in 60 digits
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


class Text:
    """LLVM text of one function body: fresh names, and the few shapes of instruction that programs need."""

    def __init__(self, scalar: str, lanes: int, fma: bool) -> None:
        self.scalar, self.lanes, self.fma = scalar, lanes, fma
        self.vector = f"<{lanes} x {scalar}>"
        self.bits = f"<{lanes} x i{64 if scalar == 'double' else 32}>"
        self.out: list[str] = []
        self.count = 0

    def name(self) -> str:
        self.count += 1
        return f"%t{self.count}"

    def put(self, text: str) -> str:
        at = self.name()
        self.out.append(f"  {at} = {text}")
        return at

    def constant(self, value: float) -> str:
        if self.scalar == "float":
            with np.errstate(over="ignore"):  # an infinite constant: its samples are left to float64
                value = float(np.float32(value))
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return f"splat ({self.scalar} 0x{bits:016X})"

    def integer(self, value: int) -> str:
        return f"splat ({self.bits.split()[-1][:-1]} {value})"

    def binary(self, word: str, a: str, b: str) -> str:
        return self.put(f"{word} {self.vector} {a}, {b}")

    def negative(self, a: str) -> str:
        return self.put(f"fneg {self.vector} {a}")

    def suffix(self) -> str:
        return f"v{self.lanes}f{64 if self.scalar == 'double' else 32}"

    def fused(self, a: str, b: str, c: str) -> str:
        """a b + c, rounded once where the host can."""
        v = self.vector
        if self.fma:
            return self.put(f"call {v} @llvm.fma.{self.suffix()}({v} {a}, {v} {b}, {v} {c})")
        return self.binary("fadd", self.binary("fmul", a, b), c)

    def unary(self, function: str, a: str) -> str:
        return self.put(f"call {self.vector} @llvm.{function}.{self.suffix()}({self.vector} {a})")

    def poisoned_unless(self, condition: str, poison: str) -> str:
        """poison, or NaN where the condition does not hold."""
        v, nan = self.vector, self.constant(math.nan)
        return self.put(f"select <{self.lanes} x i1> {condition}, {v} {poison}, {v} {nan}")

    def sincos(self, x: str) -> tuple[str, str]:
        """(sin x, cos x)."""
        s, v, k = self.scalar, self.vector, self.constant
        shifted = self.fused(x, k(2.0 / math.pi), k(MAGIC[s]))
        n = self.binary("fsub", shifted, k(MAGIC[s]))
        r, low = self._reduced(x, n)
        z = self.binary("fmul", r, r)
        p, q = k(SINE[s][-1]), k(COSINE[s][-1])
        for c in reversed(SINE[s][:-1]):
            p = self.fused(z, p, k(c))
        for c in (*reversed(COSINE[s][:-1]), -0.5):
            q = self.fused(z, q, k(c))
        # r lacks low, half an ulp of it at most, which for 1/2 < |r| is up to one of the sine; a part z keeps that
        # within 1.5 ulp, and vanishes next to 0, where low itself is lost in what cancels
        sine = self.fused(z, self.fused(r, p, low), r)
        cosine = self.fused(z, q, k(1.0))  # one rounding: 1 - z/2 by itself would be a second, and 1.6 ulp in all
        quadrant = self.put(f"bitcast {v} {shifted} to {self.bits}")
        one, top = self.integer(1), 62 if s == "double" else 30
        sign = self.integer(-(2 << top))
        odd = self.put(f"icmp ne {self.bits} {self.put(f'and {self.bits} {quadrant}, {one}')}, zeroinitializer")
        i1 = f"<{self.lanes} x i1>"
        results = []
        for swapped, straight, turn in (
            (cosine, sine, quadrant),
            (sine, cosine, self.put(f"add {self.bits} {quadrant}, {one}")),
        ):
            value = self.put(f"select {i1} {odd}, {v} {swapped}, {v} {straight}")
            flip = self.put(f"and {self.bits} {self.put(f'shl {self.bits} {turn}, {self.integer(top)}')}, {sign}")
            bits = self.put(f"bitcast {v} {value} to {self.bits}")
            results.append(self.put(f"bitcast {self.bits} {self.put(f'xor {self.bits} {bits}, {flip}')} to {v}"))
        return results[0], results[1]

    def atan2(self, y: str, x: str) -> str:
        """The angle of the point (x, y) within 3 ulp; NaN at the origin, where the sign of zero would count.

        Of the smaller over the larger of |x| and |y|, less π/4 where that is above tan(π/8), then the octant undone.
        """
        k, v, i1 = self.constant, self.vector, f"<{self.lanes} x i1>"

        def choose(condition: str, a: str, b: str) -> str:
            return self.put(f"select {i1} {condition}, {v} {a}, {v} {b}")

        def parts(angle: float) -> tuple[str, str]:
            """Of a multiple of π, which math.pi is rounded to, and what it lacks."""
            kind = np.float64 if self.scalar == "double" else np.float32
            large = float(kind(angle))
            return k(large), k(angle - large + angle / math.pi * PI_LOW)

        wide, tall = self.unary("fabs", x), self.unary("fabs", y)
        steep = self.put(f"fcmp ogt {v} {tall}, {wide}")
        small, large = choose(steep, wide, tall), choose(steep, tall, wide)
        middle = self.put(f"fcmp ogt {v} {small}, {self.binary('fmul', large, k(TAN_EIGHTH))}")
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
        behind = self.put(f"fcmp olt {v} {x}, zeroinitializer")
        for where, whole in ((steep, math.pi / 2), (behind, math.pi)):
            turned, low = parts(whole)
            angle = choose(where, self.binary("fsub", turned, self.binary("fsub", angle, low)), angle)
        return self.put(f"call {v} @llvm.copysign.{self.suffix()}({v} {angle}, {v} {y})")

    def _reduced(self, x: str, n: str) -> tuple[str, str]:
        """x - n π/2, rounded, and what it lacks: where |r| > 1/2 half an ulp of r is a whole one of its sine."""
        k = self.constant
        *parts, least = HALF_PI[self.scalar, self.fma]
        if self.fma:
            large, small = parts
            whole = self.fused(n, k(-large), x)  # exact
            r = self.fused(n, k(-least), self.fused(n, k(-small), whole))
            return r, self.fused(n, k(-small), self.binary("fsub", whole, r))
        r, rest = x, ""
        for part in parts:
            taken = self.binary("fmul", n, k(part))  # exact; what the difference loses is kept
            less = self.binary("fsub", r, taken)
            lost = self.binary("fsub", self.binary("fsub", r, less), taken)
            r, rest = less, self.binary("fadd", rest, lost) if rest else lost
        rest = self.binary("fsub", rest, self.binary("fmul", n, k(least)))
        whole = self.binary("fadd", r, rest)
        return whole, self.binary("fadd", self.binary("fsub", r, whole), rest)

    def transposed(self, vectors: list[str]) -> list[str]:
        """The transpose of len(vectors) columns in groups of so many lanes, by log2 exchanges."""
        size, W, v = len(vectors), self.lanes, self.vector
        d = 1
        while d < size:
            mask_low = [(lane if not lane & d else W + lane - d) for lane in range(W)]
            mask_high = [(lane + d if not lane & d else W + lane) for lane in range(W)]
            new = list(vectors)
            for i in range(size):
                if not i & d:
                    a, b = vectors[i], vectors[i | d]
                    new[i], new[i | d] = (
                        self.put(f"shufflevector {v} {a}, {v} {b}, <{W} x i32> <{', '.join(f'i32 {m}' for m in mask)}>")
                        for mask in (mask_low, mask_high)
                    )
            vectors, d = new, 2 * d
        return vectors
