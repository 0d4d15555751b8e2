"""Programs as text: C and Python that give the numbers of the call they were made of."""

from __future__ import annotations

import ctypes
import doctest
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra.scalars import select
from spatialdyn.calls.specialize import Specialized
from spatialdyn.engines.programs.source_code import c_code, python_code
from spatialdyn.engines.programs.tracer import Program, Tape

EPS = np.finfo(float).eps
CLOSE = 512 * EPS  # of the largest entry: the same operations, in which a compiler may fuse; solved for in aba
CALLS = ("rnea", "crba", "coriolis_matrix", "christoffel_symbols", "hamiltonian", "difference", "frame_jacobian")
COMPILER = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A floating tree with every kind of joint."""
    return random_tree(5, 6, floating=True, continuous="cos_sin").model


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


@pytest.mark.parametrize("name", CALLS)
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


def test_names_that_are_none_are_refused(model: sd.Model) -> None:
    k = sd.specialize(model, sd.generalized_gravity)
    for name in ("", "a b", "1st", "système", 3):
        with pytest.raises(sd.SpatialDynError, match=r"name is .*, expected letters, digits and _"):
            k.c_code(name)  # type: ignore[arg-type]


def test_words_of_the_language_and_of_the_arguments_are_refused(model: sd.Model) -> None:
    k = sd.specialize(model, sd.rnea)
    for name in ("for", "double", "bool", "main", "sin", "sqrtf", "atan2", "fma", "y1", "NAN"):
        with pytest.raises(sd.SpatialDynError, match=f"name is '{name}', expected a name that has no meaning in C yet"):
            k.c_code(name)
    for name in ("lambda", "None", "def", "np", "float", "sin", "atan2", "where"):
        with pytest.raises(sd.SpatialDynError, match=f"name is '{name}', .* has no meaning in Python yet"):
            k.python_code(name)
    for code in (k.c_code, k.python_code):
        for name in ("q", "v", "a"):
            with pytest.raises(sd.SpatialDynError, match=f"name is '{name}', expected another .* arguments, q, v, a"):
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


def test_the_example_is_true() -> None:
    runner = doctest.DocTestRunner()
    for test in doctest.DocTestFinder().find(Specialized.python_code, globs={}):
        runner.run(test)
    assert runner.tries > 0
    assert runner.failures == 0
