"""The files of an export: C and its header, C++ and Rust wrappers, the check, and build files.

They contain the names that the caller gives, names of arrays, numbers and this library's own words, but no text from a
robot's file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .chip_functions import functions_text
from .chip_text import ChipText, entries_of, function_text, number, parameters_of
from .functions import Function

MARK = "made by spatialdyn export"  # marks a file that may be replaced
ROUGH = {"double": 2.0**-30, "float": 2.0**-10}  # tolerance, of the largest entry, without fused multiply-add
RUST = {"double": "f64", "float": "f32"}


def files_of(name: str, functions: Sequence[Function], kind: str, version: str) -> dict[str, str]:
    """{path in the folder: text} of the files of an export of this name."""
    return {
        f"src/{name}.h": header(name, functions, kind),
        f"src/{name}.c": source(name, functions, kind),
        f"src/{name}_check.c": check(name, functions, kind),
        f"src/{name}.hpp": cpp(name, functions, kind),
        f"rust/{name}.rs": rust(name, functions, kind),
        "check/main.c": MAIN.format(mark=MARK, name=name),
        f"examples/{name}_check/{name}_check.ino": SKETCH.format(mark=MARK, name=name),
        "CMakeLists.txt": CMAKE.format(mark=MARK, name=name, upper=name.upper()),
        "library.properties": ARDUINO.format(name=name, mark=MARK, version=version),
    }


def header(name: str, functions: Sequence[Function], kind: str) -> str:
    """The declarations, with the units of arrays."""
    lines = [
        f"/* {MARK}: rigid-body dynamics in {kind}, without allocation. */",
        "/* Each function returns 0, or 1 where its results are no answer: an angle above 1e5 rad, a result that */",
        "/* is not finite, as of a joint without inertia. Arrays are in C order, coordinates in the order of the */",
        "/* model's joints; an output may be an input's array. */",
        f"#ifndef {name.upper()}_H", f"#define {name.upper()}_H", "#ifdef __cplusplus", 'extern "C" {', "#endif", "",
    ]  # fmt: skip
    for x in functions:
        lines += [*(f"/* {line} */" for line in _about(x)), f"int {_declared(name, x, kind)};", ""]
    lines += [
        "/* 1 where a * b + c is rounded once: the results are then those of a computer that does, to the bit */",
        f"int {name}_is_fused(void);", "",
        "/* the number of recorded answers that are not found again; *exact: of those that are, to the bit */",
        f"int {name}_check(int *exact, int *count);", "", "#ifdef __cplusplus", "}", "#endif", "#endif", "",
    ]  # fmt: skip
    return "\n".join(lines)


def _about(x: Function) -> list[str]:
    """A line on each array of a function: its shape and its unit."""
    made = []
    for sign, arrays in (("", x.inputs), ("-> ", x.outputs)):
        for array, shape in arrays.items():
            unit = x.units.get(array.removesuffix("_next"), "")
            size = "".join(f"[{n}]" for n in shape)
            made.append(f"{x.name}: {sign}{array}{size} {_ascii(unit)}".rstrip())
    return made


def _ascii(text: str) -> str:
    """A unit without characters that would end a comment."""
    plain = text.replace("²", "^2").replace("³", "^3").replace("·", " ")
    return "".join(c for c in plain if c.isascii() and (c.isalnum() or c in " |/^.-()"))


def _declared(name: str, x: Function, kind: str) -> str:
    return f"{name}_{x.name}({parameters_of(x.inputs, x.outputs, kind)})"


def source(name: str, functions: Sequence[Function], kind: str) -> str:
    """The functions, and the functions that they call."""
    needs = set().union(*(ChipText(x.program, entries_of(x.inputs), kind).needs for x in functions))
    whole = [
        f'/* {MARK} */\n#include "{name}.h"\n', functions_text(needs, kind),
        f"\nint {name}_is_fused(void)\n{{\n    return SD_FUSED;\n}}\n",
    ]  # fmt: skip
    whole += ["\n" + function_text(f"{name}_{x.name}", x.program, x.inputs, x.outputs, kind) for x in functions]
    return "".join(whole)


def check(name: str, functions: Sequence[Function], kind: str) -> str:
    """The recorded states, and the code that compares answers."""
    bits = 64 if kind == "double" else 32
    lines = [
        f"/* {MARK}: states and answers that were recorded where it was made */", "#include <stdint.h>",
        f'#include "{name}.h"', "",
        COMPARE.format(kind=kind, bits=bits, rough=number(ROUGH[kind], kind)),
    ]  # fmt: skip
    for x in functions:
        lines += [
            f"static int check_{x.name}(int *exact, int *count)", "{",
            _table("given", x.given, kind), _table("answer", x.answers, kind),
            f"    {kind} found[{len(x.answers[0])}];", "    int k, wrong = 0;",
            f"    for (k = 0; k < {len(x.given)}; ++k) {{",
            f"        wrong += {name}_{x.name}({', '.join(_passed(x))})",
            f"            || compared(found, answer[k], {len(x.answers[0])}, exact);",
            "        ++*count;", "    }", "    return wrong;", "}", "",
        ]  # fmt: skip
    lines += [f"int {name}_check(int *exact, int *count)", "{", "    int wrong = 0;", "    *exact = *count = 0;"]
    lines += [f"    wrong += check_{x.name}(exact, count);" for x in functions]
    return "\n".join([*lines, "    return wrong;", "}", ""])


def _passed(x: Function) -> list[str]:
    made, first = [], 0
    for shape in x.inputs.values():
        made.append(f"given[k] + {first}" if shape else f"given[k][{first}]")
        first += math.prod(shape)
    first = 0
    for shape in x.outputs.values():
        made.append(f"found + {first}")
        first += math.prod(shape)
    return made


def _table(name: str, rows: np.ndarray, kind: str) -> str:
    width = max(1, rows.shape[1])
    lines = [f"    static const {kind} {name}[{len(rows)}][{width}] = {{"]
    for row in rows.tolist():
        lines.append("        {" + ", ".join(number(x, kind) for x in row or [0.0]) + "},")
    return "\n".join([*lines, "    };"])


COMPARE = """\
static int compared(const {kind} *found, const {kind} *answer, int n, int *exact)
{{
    int k, same = 1, wrong = 0;
    {kind} most = 0;
    for (k = 0; k < n; ++k) {{
        const {kind} size = answer[k] < 0 ? -answer[k] : answer[k];
        most = size > most ? size : most;
    }}
    for (k = 0; k < n; ++k) {{
        union {{ {kind} number; uint{bits}_t bits; }} x, y;
        const {kind} off = found[k] - answer[k];
        x.number = found[k];
        y.number = answer[k];
        same &= x.bits == y.bits;
        wrong |= !((off < 0 ? -off : off) <= {rough} * most);
    }}
    *exact += same;
    return wrong;
}}
"""
MAIN = """\
/* {mark} */
#include <stdio.h>
#include "{name}.h"

int main(void)
{{
    int exact, count;
    const int wrong = {name}_check(&exact, &count);
    printf("{name}: %d of %d answers are right, %d to the bit, products %s\\n", count - wrong, count, exact,
           {name}_is_fused() ? "fused" : "not fused");
    return wrong != 0;
}}
"""
SKETCH = """\
// {mark}
#include <{name}.h>

void setup() {{
  int exact, count;
  Serial.begin(115200);
  const int wrong = {name}_check(&exact, &count);
  Serial.print(count - wrong);
  Serial.print(" of ");
  Serial.print(count);
  Serial.println(" answers are right");
}}

void loop() {{}}
"""
CMAKE = """\
# {mark}: a library and its check; as a folder of an ESP-IDF project's components, a component
if(ESP_PLATFORM)
  idf_component_register(SRCS "src/{name}.c" "src/{name}_check.c" INCLUDE_DIRS "src")
  target_compile_options(${{COMPONENT_LIB}} PRIVATE -ffp-contract=off -fno-math-errno)
  return()
endif()
cmake_minimum_required(VERSION 3.13)
project({name} C)
option({upper}_FUSED "fused multiply-add on x86-64: the same bits as the library's" ON)
add_library({name} STATIC src/{name}.c src/{name}_check.c)
target_include_directories({name} PUBLIC src)
set_target_properties({name} PROPERTIES C_STANDARD 99)
if(NOT MSVC)
  target_compile_options({name} PRIVATE -ffp-contract=off -fno-math-errno)
  if({upper}_FUSED AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    target_compile_options({name} PRIVATE -mfma)
  endif()
endif()
add_executable({name}_main check/main.c)
target_link_libraries({name}_main {name})
enable_testing()
add_test(NAME {name}_check COMMAND {name}_main)
"""
ARDUINO = """\
name={name}
version={version}
author=spatialdyn
maintainer=spatialdyn
sentence=Rigid-body dynamics of one robot.
paragraph=C99 without allocation, {mark}.
category=Device Control
url=https://pypi.org/project/spatialdyn
architectures=*
includes={name}.h
"""


def cpp(name: str, functions: Sequence[Function], kind: str) -> str:
    """The same functions on std::array, in a namespace; they return true for a valid result."""
    lines = [
        f"// {MARK}", "#pragma once", "#include <array>", f'#include "{name}.h"', "", f"namespace {name} {{", "",
    ]  # fmt: skip
    for x in functions:

        def array(shape: tuple[int, ...]) -> str:
            return f"std::array<{kind}, {math.prod(shape)}>"

        given = [f"const {array(shape)} &{a}" if shape else f"{kind} {a}" for a, shape in x.inputs.items()]
        made = [f"{array(shape)} &{a}" for a, shape in x.outputs.items()]
        passed = [f"{a}.data()" if shape else a for a, shape in x.inputs.items()]
        passed += [f"{a}.data()" for a in x.outputs]
        lines += [
            f"inline bool {x.name}({', '.join([*given, *made])}) noexcept", "{",
            f"    return {name}_{x.name}({', '.join(passed)}) == 0;", "}", "",
        ]  # fmt: skip
    return "\n".join([*lines, f"}}  // namespace {name}", ""])


def rust(name: str, functions: Sequence[Function], kind: str) -> str:
    """The declarations for Rust; functions return 0 for a valid result."""
    real = RUST[kind]
    lines = [f"// {MARK}", "#[allow(non_snake_case)]", 'unsafe extern "C" {']
    for x in functions:
        given = [f"{a}: &[{real}; {math.prod(shape)}]" if shape else f"{a}: {real}" for a, shape in x.inputs.items()]
        given += [f"{a}: &mut [{real}; {math.prod(shape)}]" for a, shape in x.outputs.items()]
        lines.append(f"    pub fn {name}_{x.name}({', '.join(given)}) -> core::ffi::c_int;")
    lines.append(f"    pub fn {name}_is_fused() -> core::ffi::c_int;")
    lines.append(f"    pub fn {name}_check(exact: &mut core::ffi::c_int, count: &mut core::ffi::c_int)")
    return "\n".join([*lines, "        -> core::ffi::c_int;", "}", ""])
