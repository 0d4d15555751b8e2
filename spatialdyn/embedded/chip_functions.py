"""sin, cos, exp and atan2 in C, and other functions that a file calls: the polynomials of the lanes, line by line.

The constants are those of ``engines.polynomials`` and ``engines.programs.llvm.llvm_vectors``, as in the code of the
lanes: results are the same bits, with and without fused multiply-add.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..engines.polynomials import COSINE, HALF_PI, MAGIC, MAX_ANGLE, SINE
from ..engines.programs.llvm.llvm_vectors import ARCTANGENT, EXPONENT, EXPONENTIAL, LN2, PI_LOW, TAN_EIGHTH
from .chip_text import number

PRELUDE = """\
#include <stdint.h>
#ifndef __GNUC__
#include <math.h>
#endif

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) \\
    || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "compile without -ffast-math and what it holds: it deletes checks for NaN, and reorders sums"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

/* SD_FUSED: whether the processor rounds a * b + c once. Results are then those of a computer that does, to the bit. */
#ifndef SD_FUSED
#if defined(__FMA__) || defined(__aarch64__) || defined({fast}) \\
    || (defined(__ARM_FEATURE_FMA) && defined(__ARM_FP) && (__ARM_FP & {arm})) \\
    || (defined(__riscv_flen) && __riscv_flen >= {bits})
#define SD_FUSED 1
#else
#define SD_FUSED 0
#endif
#endif
#ifdef __GNUC__
#define SD_BUILTIN(name) __builtin_##name
#define SD_INFINITY SD_BUILTIN(inf{s})()
#define SD_NAN SD_BUILTIN(nan{s})("")
#else
#define SD_BUILTIN(name) name
#define SD_INFINITY (({kind})INFINITY)
#define SD_NAN (({kind})NAN)
#endif
#if SD_FUSED
#define SD_FMA(a, b, c) SD_BUILTIN(fma{s})(a, b, c)
#else
#define SD_FMA(a, b, c) ((a) * (b) + (c))
#endif
#define SD_SQRT(a) SD_BUILTIN(sqrt{s})(a)
#define SD_ABS(a) SD_BUILTIN(fabs{s})(a)

typedef char sd_size_of_{kind}[sizeof({kind}) == {bytes} ? 1 : -1];
typedef union {{
    {kind} number;
    uint{bits}_t bits;
}} sd_word;

/* whether numbers are not all finite */
static int sd_is_bad(const {kind} *x, int count)
{{
    int k, bad = 0;
    for (k = 0; k < count; ++k)
        bad |= !(x[k] - x[k] <= 0);
    return bad;
}}
"""
TURN = """
/* sine and cosine; adds to *bad whether |x| is above {most}, where the reduction loses digits */
static void sd_turn({kind} x, {kind} *sine, {kind} *cosine, int *bad)
{{
    const {kind} shifted = SD_FMA(x, {two_over_pi}, {magic});
    const {kind} n = shifted - {magic};
    {kind} r, low, z, p, c, s;
    sd_word quadrant, even, odd;
#if SD_FUSED
    const {kind} whole = SD_FMA(n, -{large}, x);
    r = SD_FMA(n, -{least}, SD_FMA(n, -{small}, whole));
    low = SD_FMA(n, -{small}, whole - r);
#else
    {{
        static const {kind} part[{count}] = {{{parts}}};
        {kind} rest = 0, whole = x;
        int k;
        for (k = 0; k < {count}; ++k) {{
            const {kind} taken = n * part[k], less = whole - taken, lost = whole - less - taken;
            whole = less;
            rest = k ? rest + lost : lost;
        }}
        rest = rest - n * {last};
        r = whole + rest;
        low = whole - r + rest;
    }}
#endif
    z = r * r;
    p = {sine_last};
{sine_rest}
    c = {cosine_last};
{cosine_rest}
    s = SD_FMA(z, SD_FMA(r, p, low), r);
    c = SD_FMA(z, c, {one});
    quadrant.number = shifted;
    even.number = quadrant.bits & 1 ? c : s;
    odd.number = quadrant.bits & 1 ? s : c;
    even.bits ^= (quadrant.bits << {top}) & {sign};
    odd.bits ^= ((quadrant.bits + 1) << {top}) & {sign};
    *sine = even.number;
    *cosine = odd.number;
    *bad |= !(x <= {most} && x >= -{most});
}}
"""
SIN = """
static {kind} sd_sin({kind} x, int *bad)
{{
    {kind} sine, cosine;
    sd_turn(x, &sine, &cosine, bad);
    return sine;
}}
"""
COS = SIN.replace("sd_sin", "sd_cos").replace("return sine", "return cosine")
EXP = """
/* exp within an ulp; gradual underflow */
static {kind} sd_exp({kind} x)
{{
    {kind} n, first, r, low, p;
    sd_word shifted, magic, power;
    int{bits}_t whole, half;
    x = x > {exp_most} ? {exp_most} : x;
    x = x < {exp_least} ? {exp_least} : x;
    magic.number = {magic};
    shifted.number = SD_FMA(x, {per_ln2}, {magic});
    n = shifted.number - {magic};
    first = x - n * {ln2_large};
    r = SD_FMA(n, -{ln2_small}, first);
    low = SD_FMA(n, -{ln2_small}, first - r);
    p = {exp_last};
{exp_rest}
    p = {one} + (r + SD_FMA(r * r, p, low));
    whole = (int{bits}_t)(shifted.bits - magic.bits);
    half = whole >> 1;
    power.bits = (uint{bits}_t)(half + {bias}) << {mantissa};
    p = p * power.number;
    power.bits = (uint{bits}_t)(whole - half + {bias}) << {mantissa};
    return p * power.number;
}}
"""
ATAN2 = """
/* the angle of the point (x, y) within 3 ulp; 0 or pi at the origin */
static {kind} sd_atan2({kind} y, {kind} x)
{{
    const {kind} wide = SD_ABS(x), tall = SD_ABS(y);
    const int steep = tall > wide;
    const {kind} less = steep ? wide : tall, more = steep ? tall : wide;
    const int middle = less > more * {tan_eighth};
    const {kind} above = middle ? less - more : less, below = middle ? less + more : more;
    const {kind} t = above / (below > 0 ? below : {one}), z = t * t;
    {kind} p = {atan_last}, angle;
    sd_word turned, side;
{atan_rest}
    angle = SD_FMA(t * z, p, middle ? {quarter_low} : 0);
    angle = t + angle + (middle ? {quarter} : 0);
    if (steep)
        angle = {half} - (angle - {half_low});
    side.number = x;
    if (x < 0 || (!(below > 0) && (side.bits & {sign})))
        angle = {whole} - (angle - {whole_low});
    turned.number = angle;
    side.number = y;
    turned.bits = (turned.bits & ~{sign}) | (side.bits & {sign});
    return turned.number;
}}
"""
FIRST_PLACE = """
/* the largest power of 2 up to |x| */
static {kind} sd_first_place({kind} x)
{{
    sd_word word;
    word.number = x;
    word.bits &= {exponent};
    return word.number;
}}
"""


def functions_text(needs: set[str], kind: str) -> str:
    """The beginning of a file whose functions need these: "turn", "sin", "cos", "exp", "atan2", "first_place"."""
    words = _words(kind)
    chosen = [PRELUDE]
    if needs & {"turn", "sin", "cos"}:
        chosen.append(TURN)
    for name, text in (("sin", SIN), ("cos", COS), ("exp", EXP), ("atan2", ATAN2), ("first_place", FIRST_PLACE)):
        if name in needs:
            chosen.append(text)
    return "".join(text.format(**words) for text in chosen)


def _words(kind: str) -> dict[str, str]:
    """The words to insert in the texts."""
    wide = kind == "double"
    bits, mantissa = (64, 52) if wide else (32, 23)

    def show(x: float) -> str:
        return number(x, kind)

    def horner(name: str, by: str, coefficients: Sequence[float]) -> str:
        return "\n".join(f"    {name} = SD_FMA({by}, {name}, {show(c)});" for c in reversed(coefficients))

    def angle(x: float) -> tuple[str, str]:
        """A multiple of pi, and the remainder that its float lacks."""
        large = float(np.float64(x) if wide else np.float32(x))
        return show(large), show(x - large + x / math.pi * PI_LOW)

    large, small, least = HALF_PI[kind, True]
    *parts, last = HALF_PI[kind, False]
    (quarter, quarter_low), (half, half_low), (whole, whole_low) = map(angle, (math.pi / 4, math.pi / 2, math.pi))
    unsigned = "ULL" if wide else "UL"
    cast = f"(uint{bits}_t)"
    return {
        "kind": kind, "s": "" if wide else "f", "bits": str(bits), "bytes": str(bits // 8), "arm": "8" if wide else "4",
        "fast": "__FP_FAST_FMA" if wide else "__FP_FAST_FMAF", "one": show(1.0), "most": show(MAX_ANGLE),
        "two_over_pi": show(2.0 / math.pi), "magic": show(MAGIC[kind]), "top": str(bits - 2),
        "sign": f"({cast}1 << {bits - 1})", "large": show(large), "small": _positive(show(small)),
        "least": _positive(show(least)),
        "count": str(len(parts)), "parts": ", ".join(map(show, parts)), "last": show(last),
        "sine_last": show(SINE[kind][-1]), "sine_rest": horner("p", "z", SINE[kind][:-1]),
        "cosine_last": show(COSINE[kind][-1]), "cosine_rest": horner("c", "z", (-0.5, *COSINE[kind][:-1])),
        "exp_least": show(EXPONENT[kind][0]), "exp_most": show(EXPONENT[kind][1]), "per_ln2": show(1 / math.log(2.0)),
        "ln2_large": show(LN2[kind][0]), "ln2_small": _positive(show(LN2[kind][1])), "bias": "1023" if wide else "127",
        "exp_last": show(EXPONENTIAL[kind][-1]), "exp_rest": horner("p", "r", EXPONENTIAL[kind][:-1]),
        "mantissa": str(mantissa), "tan_eighth": show(TAN_EIGHTH), "atan_last": show(ARCTANGENT[-1]),
        "atan_rest": horner("p", "z", ARCTANGENT[:-1]), "quarter": quarter, "quarter_low": quarter_low, "half": half,
        "half_low": _positive(half_low), "whole": whole, "whole_low": _positive(whole_low),
        "exponent": f"{cast}0x{((1 << (bits - 1 - mantissa)) - 1) << mantissa:X}{unsigned}",
    }  # fmt: skip


def _positive(text: str) -> str:
    """A number that a minus sign can precede."""
    return f"({text})" if text.startswith("-") else text
