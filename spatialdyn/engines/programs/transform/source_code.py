"""A Program as source code that does not need this package: C99 for one sample, or NumPy for any batch.

Lines keep their numbers, so x12 is line 12 of ``Program.listing()``; inputs and constants are written where they are
read. The text holds only numbers, indices and names that the caller gives, and no text from a robot's file.
"""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ..record.operations import AGAIN, CARRIED, CONST, FORMS, INPUT, NEXT, REPEAT, Operation
from ..record.program import Program

Shapes = Mapping[str, tuple[int, ...]]


class Language(NamedTuple):
    """The form of statements: a name and its value, a carried value and its replacement, loops."""

    value: str
    carried: str
    replaced: str
    loop: str
    end: str


C = Language("const double {};", "double {};", "{};", "while ({} > 0.0) {{", "}")
PYTHON = Language("{}", "{}", "{}", "while np.any({} > 0.0):", "")


def c_code(name: str, program: Program, inputs: Shapes, outputs: Shapes) -> str:
    """``void name(const double *q, ..., double *out)``: arrays of one sample in C order, outputs last."""
    text = SourceText(program, _entries(inputs, "{}[{}]"), {code: form.c for code, form in FORMS.items()}, "INFINITY")
    sizes = ", ".join(f"{x}{_shown(shape)}" for x, shape in inputs.items())
    made = ", ".join(f"{x}{_shown(shape)}" for x, shape in outputs.items())
    parameters = [*(f"const double *{x}" for x in inputs), *(f"double *{x}" for x in outputs)]
    return "\n".join(
        [
            "#include <math.h>",
            "",
            f"/* {sizes} -> {made} */",
            f"void {name}({', '.join(parameters)})",
            "{",
            *(f"    {line}" for line in text.lines(C)),
            *(f"    {line};" for line in text.results(_entries(outputs, "{}[{}]"))),
            "}",
            "",
        ]
    )


def python_code(name: str, program: Program, inputs: Shapes, outputs: Shapes) -> str:
    """``def name(q, ...)`` with NumPy: arrays of any leading batch shape, broadcast; returns the output or outputs."""
    text = SourceText(
        program, _entries(inputs, "{}[..., {}]"), {code: form.python for code, form in FORMS.items()}, "np.inf"
    )
    used = {FORMS[op.code].imports for op in program.lines if op.code in FORMS}
    functions = ", ".join(sorted(used - {""}))
    lines = ["import numpy as np"] + [f"from numpy import {functions}"] * bool(functions) + ["", ""]
    lines.append(f"def {name}({', '.join(inputs)}):")
    shapes = []
    for x, shape in inputs.items():
        rank = len(shape)
        lead = f"{x}.shape[:-{rank}]" if rank else f"{x}.shape"
        lines += [f"    {x} = np.asarray({x}, dtype=float)", f"    {x} = {x}.reshape({lead} + ({math.prod(shape)},))"]
        shapes.append(f"{x}.shape[:-1]")
    lines.append(f"    batch = np.broadcast_shapes({', '.join(shapes)})")
    lines += [f"    {line}" for line in text.lines(PYTHON)]
    lines += [f"    {x} = np.empty(batch + ({math.prod(shape)},))" for x, shape in outputs.items()]
    lines += [f"    {line}" for line in text.results(_entries(outputs, "{}[..., {}]"))]
    made = ", ".join(f"{x}.reshape(batch + {shape})" for x, shape in outputs.items())
    return "\n".join([*lines, f"    return {made}"]) + "\n"


def _entries(arrays: Shapes, form: str) -> list[str]:
    """Text of each entry of the arrays, in C order."""
    return [form.format(name, k) for name, shape in arrays.items() for k in range(math.prod(shape))]


def _shown(shape: Sequence[int]) -> str:
    return "".join(f"[{n}]" for n in shape or (1,))


class SourceText:
    """The statements of a program in one language."""

    def __init__(self, program: Program, inputs: Sequence[str], forms: Mapping[int, str], infinity: str) -> None:
        """``forms`` is the language's column of FORMS, ``infinity`` its word for infinity."""
        self._program, self._inputs, self._forms, self._infinity = program, inputs, forms, infinity

    def _at(self, k: int) -> str:
        """An operand with its sign: its name, its entry of an input, or its value."""
        op = self._program.lines[k if k >= 0 else -k - 1]
        if op.code == CONST:
            return repr(op.value if k >= 0 else -op.value).replace("inf", self._infinity)
        if k < 0:
            return f"-{self._at(-k - 1)}"
        return self._inputs[op.a] if op.code == INPUT else f"x{k}"

    def _line(self, op: Operation) -> str:
        return self._forms[op.code].format(a=self._at(op.a), b=self._at(op.b), c=self._at(op.c))

    def lines(self, language: Language) -> list[str]:
        """The statement ``x12 = x3 * x4`` of each line that computes, indented within loops."""
        made, depth = [], 0
        for k, op in enumerate(self._program.lines):
            if op.code in (INPUT, CONST):
                continue
            if op.code == AGAIN:
                depth -= 1
                statement = language.end
            elif op.code == REPEAT:
                statement = language.loop.format(self._at(op.a))
            elif op.code == NEXT:
                statement = language.replaced.format(f"x{op.a} = {self._at(op.b)}")
            elif op.code == CARRIED:
                statement = language.carried.format(f"x{k} = {self._at(op.a)}")
            else:
                statement = language.value.format(f"x{k} = {self._line(op)}")
            if statement:
                made.append("    " * depth + statement)
            depth += op.code == REPEAT
        return made

    def results(self, entries: Sequence[str], places: Sequence[int] | None = None) -> list[str]:
        """The statement ``out[0] = -x12`` of each output, or of the outputs at these places."""
        ends = self._program.outputs if places is None else [self._program.outputs[k] for k in places]
        return [
            f"{entry} = {self._at(-k - 1 if minus else k)}" for entry, (k, minus) in zip(entries, ends, strict=True)
        ]


C_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while alignas alignof bool
constexpr false nullptr static_assert thread_local true typeof typeof_unqual asm main linux unix i386 double_t float_t
HUGE_VAL HUGE_VALF HUGE_VALL INFINITY NAN MAXFLOAT MATH_ERRNO MATH_ERREXCEPT math_errhandling signgam fpclassify
iscanonical iseqsig isfinite isgreater isgreaterequal isinf isless islessequal islessgreater isnan isnormal issignaling
issubnormal isunordered iszero signbit
"""  # keywords up to C23, names that <math.h> declares, and macros of compilers
C_MATH = """
acos acosh acospi asin asinh asinpi atan atan2 atan2pi atanh atanpi canonicalize cbrt ceil compoundn copysign cos cosh
cospi drem erf erfc exp exp10 exp10m1 exp2 exp2m1 expm1 fabs fdim finite floor fma fmax fmaximum fmaximum_mag
fmaximum_mag_num fmaximum_num fmaxmag fmin fminimum fminimum_mag fminimum_mag_num fminimum_num fminmag fmod frexp fromfp
fromfpx gamma getpayload hypot ilogb isinf isnan j0 j1 jn ldexp lgamma llogb llrint llround log log10 log10p1 log1p log2
log2p1 logb logp1 lrint lround modf nan nearbyint nextafter nextdown nexttoward nextup pow pow10 pown powr remainder
remquo rint rootn round roundeven rsqrt scalb scalbln scalbn setpayload setpayloadsig significand sin sincos sinh sinpi
sqrt tan tanh tanpi tgamma totalorder totalordermag trunc ufromfp ufromfpx y0 y1 yn
cabs cacos cacosh carg casin casinh catan catanh ccos ccosh cexp cimag clog clog10 conj cpow cproj creal csin csinh
csqrt ctan ctanh
"""  # each also for float, long double, and re-entrant
C_LIBRARY = """
abort abs aligned_alloc asctime at_quick_exit atexit atof atoi atol atoll bsearch btowc calloc clearerr clock ctime
difftime div exit fclose feof ferror fflush fgetc fgetpos fgets fgetwc fgetws fopen fprintf fputc fputs fputwc fputws
fread free freopen fscanf fseek fsetpos ftell fwide fwprintf fwrite fwscanf getc getchar getenv gets getwc getwchar
gmtime isalnum isalpha isblank iscntrl isdigit isgraph islower isprint ispunct isspace isupper iswalnum iswalpha
iswblank iswcntrl iswctype iswdigit iswgraph iswlower iswprint iswpunct iswspace iswupper iswxdigit isxdigit labs ldiv
llabs lldiv localeconv localtime longjmp malloc mblen mbrlen mbrtowc mbsinit mbsrtowcs mbstowcs mbtowc memchr memcmp
memcpy memmove memset mktime perror printf putc putchar puts putwc putwchar qsort quick_exit raise rand realloc remove
rename rewind scanf setbuf setjmp setlocale setvbuf signal snprintf sprintf srand sscanf strcat strchr strcmp strcoll
strcpy strcspn strerror strftime strlen strncat strncmp strncpy strpbrk strrchr strspn strstr strtod strtof strtok
strtol strtold strtoll strtoul strtoull strxfrm swprintf swscanf system thrd_create time timespec_get tmpfile tmpnam
tolower toupper towctrans towlower towupper ungetc ungetwc vfprintf vfscanf vfwprintf vfwscanf vprintf vscanf vsnprintf
vsprintf vsscanf vswprintf vswscanf vwprintf vwscanf wcrtomb wcscat wcschr wcscmp wcscoll wcscpy wcscspn wcsftime wcslen
wcsncat wcsncmp wcsncpy wcspbrk wcsrchr wcsrtombs wcsspn wcsstr wcstod wcstof wcstok wcstol wcstold wcstoll wcstombs
wcstoul wcstoull wcsxfrm wctob wctomb wctrans wctype wmemchr wmemcmp wmemcpy wmemmove wmemset wprintf wscanf
feclearexcept fegetenv fegetexceptflag fegetround feholdexcept feraiseexcept fesetenv fesetexceptflag
fesetround fetestexcept feupdateenv imaxabs imaxdiv strtoimax strtoumax wcstoimax wcstoumax
alloca bcmp bcopy bzero dcgettext dgettext execl execle execlp execv execve execvp ffs fork gettext index isascii
mempcpy rindex stpcpy stpncpy strcasecmp strdup strfmon strncasecmp strndup strnlen toascii
fputc_unlocked fputs_unlocked fwrite_unlocked
NULL EOF assert errno offsetof size_t stderr stdin stdout
"""  # linked into every program, where a function of the same name would replace them; compilers know their types
C_NUMBERS = re.compile(r"(?:FP|M)_\w+|SNANF?\w*|HUGE_VAL_\w+")  # macros of <math.h>
RESERVED: Mapping[str, frozenset[str]] = {  # names that a generated function cannot have
    "c": frozenset(
        [*C_WORDS.split(), *C_LIBRARY.split(), *(f + kind for f in C_MATH.split() for kind in ("", "f", "l", "_r"))]
    ),
    "python": frozenset(
        [*keyword.kwlist, "np", "float", *(form.imports.split()[-1] for form in FORMS.values() if form.imports)]
    ),
}
Printer = Callable[[str, Program, Shapes, Shapes], str]
PRINTERS: Mapping[str, Printer] = {"c": c_code, "python": python_code}


def has_meaning(name: str, language: str) -> bool:
    """Whether a function cannot have a name: a keyword of the language, a name of its library, or a reserved name.

    C reserves names that begin with "_", Python names between "__". Python's soft keywords, and builtins that the text
    does not use, are allowed.
    """
    if language == "c":
        reserved = name.startswith("_") or C_NUMBERS.fullmatch(name) is not None
    else:
        reserved = name.startswith("__") and name.endswith("__")
    return reserved or name in RESERVED[language]
