"""Programs as source code: C and Python agree with the call."""

from __future__ import annotations

import ctypes
import doctest
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra.scalars import select
from spatialdyn.calls.specialized import Specialized
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.engines.programs.transform.source_code import c_code, has_meaning, python_code

EPS = np.finfo(float).eps
CLOSE = 512 * EPS  # of the largest entry: the same operations, in which a compiler may fuse; solved for in aba
CALLS = ("rnea", "crba", "coriolis_matrix", "christoffel_symbols", "hamiltonian", "difference", "frame_jacobian")
COMPILER = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A tree with every kind of joint, one of which floats."""
    made = random_tree(108, 6, continuous="cos_sin").model
    assert len({j.kind for j in made.joints[1:]}) == 6
    return made


def given(model: sd.Model, k: Specialized, batch: tuple[int, ...]) -> list[Any]:
    """Random inputs in the order of the signature."""
    rng = np.random.default_rng(0)
    made = []
    for x in k._inputs:
        whole = x.name in ("q", "q0", "q1")
        made.append(sd.random_configuration(model, rng, batch) if whole else rng.normal(size=(*batch, *x.shape)))
    return made


def run_python(text: str, name: str) -> Any:
    scope: dict[str, Any] = {}
    exec(text, scope)
    return scope[name]


def assert_close(found: Any, expected: Any) -> None:
    assert np.shape(found) == np.shape(expected)
    assert abs(np.asarray(found) - expected).max() <= CLOSE * max(1.0, abs(np.asarray(expected)).max())


@pytest.mark.parametrize("name", slow_but(CALLS[::3], CALLS))
def test_python_code_equals_the_call_on_any_batch(model: sd.Model, name: str) -> None:
    frame = {"frame": model.frames[-1]} if name == "frame_jacobian" else {}
    k = sd.specialize(model, getattr(sd, name), **frame)
    function = run_python(k.python_code(), name)
    for batch in ((), (2, 3)):
        inputs = given(model, k, batch)
        assert_close(function(*inputs), k(*inputs))


def test_python_code_broadcasts_each_input_against_the_others(model: sd.Model) -> None:
    k = sd.specialize(model, sd.rnea)
    function = run_python(k.python_code(), "rnea")
    q, v, a = given(model, k, (3, 4))
    for some in ((q[0, 0], v, a), (q, v[1, 1], a[0]), (q[:, :1], v[0], a[2, 2]), (q[0, 1], v[0, 2], a)):
        assert_close(function(*some), k(*some))


def test_a_choice_at_zero_is_the_programs_own_in_both_languages() -> None:
    """select(x, b, c) is b above 0 and c at 0, below it and where it is NaN."""
    tape = Tape()
    x, b, c = (tape.input(k) for k in range(3))
    program = Program(tape, [select(x, b, c), select(-x, b, c)], 3)
    shapes: tuple[dict[str, tuple[int, ...]], ...] = ({"x": (3,)}, {"out": (2,)})
    function = run_python(python_code("choose", program, *shapes), "choose")
    for value, wanted in ((1.0, [5.0, 7.0]), (0.0, [7.0, 7.0]), (-1.0, [7.0, 5.0]), (np.nan, [7.0, 7.0])):
        assert [float(y) for y in program.run([value, 5.0, 7.0])] == wanted
        assert function([value, 5.0, 7.0]).tolist() == wanted
    text = c_code("choose", program, *shapes)
    assert "= x[0] > 0.0 ? x[1] : x[2];" in text
    assert "= -x[0] > 0.0 ? x[1] : x[2];" in text


def test_python_code_has_forces_parameters_and_several_results(model: sd.Model) -> None:
    mass = f"mass:{model.joints[-1].name}"
    k = sd.specialize(model, [sd.rnea, sd.crba, sd.nonlinear_effects], inputs=["fext", mass, "gravity"])
    text = k.python_code("all_of_it")
    assert "def all_of_it(q, v, a, fext, mass_5, gravity_6):" in text
    assert model.joints[-1].name not in text
    inputs = given(model, k, (4,))
    for found, expected in zip(run_python(text, "all_of_it")(*inputs), k(*inputs), strict=True):
        assert_close(found, expected)


def test_arrays_of_one_name_are_told_apart(model: sd.Model) -> None:
    k = sd.specialize(model, sd.crba)
    assert "(const double *q, double *M)" in k.c_code()
    assert "void M(const double *q, double *out_1)" in k.c_code("M")
    assert "double *out_1, double *out_2)" in sd.specialize(model, [sd.rnea, sd.generalized_gravity]).c_code()


def test_code_of_chosen_outputs_and_constants_is_shorter(model: sd.Model) -> None:
    whole = sd.specialize(model, sd.aba)
    part = sd.specialize(model, sd.aba, fixed={"v": 0}, outputs=[0])
    assert len(part.python_code()) < len(whole.python_code())
    inputs = given(model, part, ())
    assert_close(run_python(part.python_code(), "aba")(*inputs), part(*inputs))


@COMPILER
@pytest.mark.parametrize("names", [("coriolis_matrix",), ("aba",), ("crba", "difference")])
def test_c_code_compiles_and_equals_the_call(model: sd.Model, names: tuple[str, ...], tmp_path: Path) -> None:
    k = sd.specialize(model, [getattr(sd, name) for name in names])
    (tmp_path / "robot.c").write_text(k.c_code("robot"))
    command = [
        "cc",
        "-std=c99",
        "-Wall",
        "-Werror",
        "-pedantic",
        "-shared",
        "-fPIC",
        "robot.c",
        "-o",
        "robot.so",
        "-lm",
    ]
    subprocess.run(command, cwd=tmp_path, check=True)
    inputs = given(model, k, ())
    expected = k(*inputs)
    found = [np.full_like(x, np.nan) for x in expected]
    function = ctypes.CDLL(str(tmp_path / "robot.so")).robot
    function(*(ctypes.c_void_p(x.ctypes.data) for x in [*inputs, *found]))
    for x, y in zip(found, expected, strict=True):
        assert_close(x, y)


@COMPILER
@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")
def test_code_of_bounds_has_infinity_in_both_languages(model: sd.Model, tmp_path: Path) -> None:
    k = sd.bounded(model, sd.crba)
    assert "INFINITY" in k.c_code("f")
    (tmp_path / "f.c").write_text(k.c_code("f"))
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-c", "f.c"], cwd=tmp_path, check=True)
    q = given(model, k, ())
    for found, expected in zip(run_python(k.python_code("f"), "f")(*q), k(*q), strict=True):
        assert_close(found, expected)


def test_names_that_are_none_are_refused(model: sd.Model) -> None:
    k = sd.specialize(model, sd.generalized_gravity)
    for name in ("", "a b", "1st", "système", 3):
        with pytest.raises(sd.SpatialDynError, match=r"name is .*, expected letters, digits and _"):
            k.c_code(name)  # type: ignore[arg-type]


C_MEANS = (
    "_Bool", "_Generic", "_x", "_", "__func__", "__x", "M_PI", "M_SQRT1_2f64", "MAXFLOAT", "SNANF64", "HUGE_VAL_F32",
    "FP_INT_UPWARD", "signgam", "iszero", "lgamma_r", "roundeven", "exit", "abs", "memcpy", "cexp", "linux", "errno",
)  # fmt: skip
PYTHON_MEANS = ("__debug__", "__builtins__", "__getattr__", "__name__")


def test_words_of_the_language_and_of_the_arguments_are_refused(model: sd.Model) -> None:
    k = sd.specialize(model, sd.rnea)
    for name in ("for", "double", "bool", "main", "sin", "sqrtf", "atan2", "fma", "y1", "NAN", *C_MEANS):
        with pytest.raises(sd.SpatialDynError, match=f"name is '{name}', expected a name that C does not reserve"):
            k.c_code(name)
    for name in ("lambda", "None", "def", "np", "float", "sin", "atan2", "where", *PYTHON_MEANS):
        with pytest.raises(sd.SpatialDynError, match=f"name is '{name}', .* that Python does not reserve"):
            k.python_code(name)
    for code in (k.c_code, k.python_code):
        for name in ("q", "v", "a"):
            with pytest.raises(sd.SpatialDynError, match=f"name is '{name}', expected none of its arguments: q, v, a"):
                code(name)
        assert "fortran" in code("fortran")
        assert "lambda_" in code("lambda_")
    assert "def goto(" in k.python_code("goto")
    assert "void lambda(" in k.c_code("lambda")


@pytest.mark.parametrize("name", ["x1", "tau", "batch", "fext", "match", "FORCE"])
def test_other_names_make_code_that_runs(model: sd.Model, name: str, tmp_path: Path) -> None:
    k = sd.specialize(model, sd.generalized_gravity)
    (q,) = given(model, k, (3,))
    assert_close(run_python(k.python_code(name), name)(q), k(q))


PLAIN_NAMES = (
    "torque", "total_energy", "isometric", "memory", "strut", "q1", "x1", "a_1", "out_1", "M", "I", "MP_PI", "FPS",
    "sine", "sinff", "complex", "noreturn", "near", "lambda", "class", "this", "batch", "forces", "x_", "A__b", "Main",
)  # fmt: skip
HEADERS = [
    "assert", "complex", "ctype", "fenv", "inttypes", "locale", "math", "setjmp", "signal", "stdio", "stdlib", "string",
    "time", "wchar", "wctype",
]  # fmt: skip


@COMPILER
@pytest.mark.parametrize("standard", ["c99", "gnu17"])
def test_accepted_names_compile_without_a_warning(standard: str, tmp_path: Path) -> None:
    k = sd.specialize(sd.load_urdf("two_link"), sd.aba)
    text = "".join(k.c_code(name) for name in PLAIN_NAMES)
    (tmp_path / "robot.c").write_text(text)
    subprocess.run(
        ["cc", f"-std={standard}", "-Wall", "-Werror", "-pedantic", "-fsyntax-only", "robot.c"],
        cwd=tmp_path, check=True,
    )  # fmt: skip


def declared(tmp_path: Path, headers: list[str], *options: str) -> str:
    """The output of the preprocessor for some headers."""
    (tmp_path / "all.c").write_text("".join(f"#include <{name}.h>\n" for name in headers))
    command = ["cc", "-D_ANSI_SOURCE", *options, "-E", "all.c"]
    return subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout


@COMPILER
def test_every_function_of_the_standard_library_is_refused(tmp_path: Path) -> None:
    text = " ".join(x for x in declared(tmp_path, HEADERS, "-std=c99").splitlines() if not x.startswith("#"))
    found = {name for name in re.findall(r"\b([a-z]\w*) *\([^()]*\)[^();]*(?:\(\([^()]*\)\)[^();]*)*;", text)}
    assert {"sin", "atan2l", "exit", "cexp", "wcslen", "printf", "abs"} <= found
    assert {name for name in found if not has_meaning(name, "c")} == set()


@COMPILER
@pytest.mark.parametrize("standard", ["c99", "gnu17"])
def test_every_macro_of_math_is_refused(standard: str, tmp_path: Path) -> None:
    found = re.findall(r"(?m)^#define (\w+)", declared(tmp_path, ["math"], f"-std={standard}", "-dM"))
    assert {"NAN", "HUGE_VAL"} <= set(found)
    assert [name for name in found if not has_meaning(name, "c")] == []


def test_the_example_is_true() -> None:
    runner = doctest.DocTestRunner()
    for test in doctest.DocTestFinder().find(Specialized.python_code, globs={}):
        runner.run(test)
    assert runner.tries > 0
    assert runner.failures == 0
