"""Exports compile without a warning and find what was recorded, to the bit; their texts hold no name of the robot."""

from __future__ import annotations

import ctypes
import math
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chips import CHIPS, FUSED, HAS_ZIG, RIGHT, STRICT, compiled_for, compiled_here
from combinations import options, robot
from inputs import options as words_of

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.embedded.chip_functions import functions_text
from spatialdyn.embedded.chip_text import number
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")
COMPILER = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
FMA = host_cpu.host()[3]
KINDS = {"double": np.float64, "float": np.float32}


def path_law() -> sd.Control:
    """Along a path, with gains."""
    return sd.PDPlus(60.0, 12.0, sd.quintic([0.0, 0.0], [1.0, 0.5], 2.0))


FUNCTIONS = {"torque": sd.rnea, "both": [sd.crba, sd.nonlinear_effects], "law": "computed_torque", "step": sd.step}


def summary(name: str, count: int) -> str:
    """What a check prints where all is found."""
    return f"{name}: {count} of {count} answers are right, {count} to the bit, products fused\n"


@COMPILER
@pytest.mark.skipif(not FMA, reason="a processor without fused multiply-add")
@pytest.mark.parametrize("kind", KINDS)
def test_an_export_finds_its_answers_to_the_bit(kind: str, tmp_path: Path) -> None:
    made = sd.export(sd.load_urdf("two_link"), {**FUNCTIONS, "follow": path_law()}, tmp_path, dtype=KINDS[kind])
    assert made[0] == tmp_path / "src" / "robot.h"
    assert compiled_here(tmp_path) == summary("robot", 15)


@COMPILER
def test_without_fused_products_the_answers_are_found_to_rounding(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"torque": sd.rnea, "accelerate": sd.aba}, tmp_path, name="arm")
    said = compiled_here(tmp_path, "arm", (*FUSED, "-DSD_FUSED=0"))
    assert re.fullmatch(r"arm: 6 of 6 answers are right, \d to the bit, products not fused\n", said)


@COMPILER
@pytest.mark.skipif(not FMA, reason="a processor without fused multiply-add")
def test_steps_in_contact_are_loops_and_branches(tmp_path: Path) -> None:
    model = robot("arm")
    scene = sd.Scene(model, friction=False, **options(model, "contacts"))
    sd.export(scene, {"step": sd.step}, tmp_path, name="scene")
    text = (tmp_path / "src" / "scene.c").read_text()
    assert re.search(r"\n    while \(x\d+ > 0\)", text)
    assert re.search(r"\n +if \(x\d+ > 0\) \{", text)
    assert compiled_here(tmp_path, "scene", level="-O0") == summary("scene", 3)


@COMPILER
def test_a_changed_digit_is_found_wrong(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"gravity": sd.generalized_gravity}, tmp_path)
    source = tmp_path / "src" / "robot.c"
    source.write_text(source.read_text().replace("9.81", "9.82"))
    with pytest.raises(subprocess.CalledProcessError):
        compiled_here(tmp_path)


# --- functions ------------------------------------------------------------------------------------------


def _functions(bodies: Any, q: Any, v: Any, tau: Any) -> None:
    tau[0] = scalars.sin(q[0]) + 0.0 * v[0]
    tau[1] = scalars.cos(q[1])
    tau[2] = scalars.exp(v[0])
    tau[3] = scalars.atan2(v[1], v[2])
    tau[4] = scalars.sqrt(abs(v[3]))
    tau[5] = scalars.select(v[1] - v[2], v[3], -v[0])


def _doubled(bodies: Any, x: Any, tau: Any) -> None:
    for i in range(len(tau)):
        tau[i] = x[i] + x[i]


CLASS = Argument("class", ("nv",), "", "")
SIX = Spec("six", _functions, None, (Q, V), TAU, "", "", parts=(TAU,))


def library(folder: Path, *options: str) -> ctypes.CDLL:
    """The source of an export as a library."""
    command = ["cc", "-O1", *STRICT, "-shared", "-fPIC", "-fno-math-errno", *options, "src/robot.c", "-o", "robot.so"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "robot.so"))


def call(function: Any, *arrays: np.ndarray) -> int:
    return int(function(*(ctypes.c_void_p(x.ctypes.data) for x in arrays)))


def six_links() -> sd.Model:
    """A chain of six hinges."""
    made = sd.ModelBuilder("six")
    for k in range(6):
        made.add_body(f"b{k}", f"b{k - 1}" if k else None, inertia=(1.0, (0, 0, 0.1), 0.1 * np.eye(3)))
    return made.build()


@COMPILER
@pytest.mark.skipif(not FMA, reason="a processor without fused multiply-add")
@pytest.mark.parametrize("kind", KINDS)
def test_sines_exponentials_and_arctangents_are_those_of_the_lanes(kind: str, tmp_path: Path) -> None:
    """To the bit, on 2000 states; without fused products within 3 ulp of the exact."""
    dtype, rng = KINDS[kind], np.random.default_rng(5)
    sd.export(six_links(), {"six": SIX}, tmp_path, dtype=dtype)
    lanes = sd.specialize(six_links(), sd.Control(SIX), dtype=dtype)
    q, v = rng.uniform(-2000.0, 2000.0, (2000, 6)).astype(dtype), rng.normal(0.0, 8.0, (2000, 6)).astype(dtype)
    expected = lanes(q, v)
    fused, apart = np.empty((2, 2000, 6), dtype)
    for given, found in ((FUSED, fused), (("-DSD_FUSED=0",), apart)):
        folder = tmp_path / "-".join(("lib", *given))  # a library is loaded once from a path
        shutil.copytree(tmp_path / "src", folder / "src")
        function = library(folder, *given).robot_six
        assert [call(function, x, y, z) for x, y, z in zip(q, v, found, strict=True)] == [0] * 2000
    np.testing.assert_array_equal(fused, expected)
    x, y = q.astype(float), v.astype(float)
    exact = np.stack([np.sin(x[:, 0]), np.cos(x[:, 1]), np.exp(y[:, 0]), np.arctan2(y[:, 1], y[:, 2])], 1)
    assert (abs(apart[:, :4] - exact) <= 4.0 * np.spacing(abs(exact).astype(dtype))).all()


@COMPILER
def test_what_is_no_answer_is_said(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"accelerate": sd.aba}, tmp_path)
    function, zero, out = library(tmp_path, *FUSED).robot_accelerate, np.zeros(2), np.zeros(2)
    assert call(function, zero, zero, zero, out) == 0
    for q, v in (([2e5, 0.0], [0.0, 0.0]), ([0.0, 0.0], [math.nan, 0.0]), ([math.inf, 0.0], [0.0, 0.0])):
        assert call(function, np.array(q), np.array(v), zero, out) == 1


@COMPILER
@pytest.mark.parametrize("option", ["-ffast-math", "-ffinite-math-only"])
def test_options_that_delete_checks_are_refused(option: str, tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"accelerate": sd.aba}, tmp_path)
    with pytest.raises(subprocess.CalledProcessError):
        library(tmp_path, option)


@COMPILER
def test_a_step_may_write_over_its_state(tmp_path: Path) -> None:
    model = robot("floating")
    sd.export(model, {"step": partial(sd.step, method="explicit_euler")}, tmp_path)
    header = (tmp_path / "src" / "robot.h").read_text()
    assert "const double v[9], const double tau[9], double dt, double q_after[10], double v_after[9]" in header
    function = library(tmp_path, *FUSED).robot_step
    rng = np.random.default_rng(1)
    q, v, tau = sd.random_configuration(model, rng), rng.normal(size=9), np.zeros(9)
    expected = sd.step(model, q, v, tau, 1e-3, "explicit_euler")
    pointers = [ctypes.c_void_p(x.ctypes.data) for x in (q, v, tau)]
    assert function(*pointers, ctypes.c_double(1e-3), *pointers[:2]) == 0
    for x, y in zip((q, v), expected, strict=True):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=1e-14)


def _swapped(bodies: Any, x: Any, tau: Any) -> None:
    tau[0], tau[1] = x[1], -x[0]


@COMPILER
def test_results_that_are_inputs_may_be_written_over_them(tmp_path: Path) -> None:
    turned = Spec("turned", _swapped, None, (Argument("x", ("nv",), "", ""),), TAU, "", "")
    sd.export(sd.load_urdf("two_link"), {"turned": turned}, tmp_path)
    x = np.array([3.0, 5.0])
    assert call(library(tmp_path).robot_turned, x, x) == 0
    assert x.tolist() == [5.0, -3.0]


@COMPILER
def test_a_laws_gains_and_paths_are_constants_and_its_clock_an_input(tmp_path: Path) -> None:
    model, law = sd.load_urdf("two_link"), path_law()
    sd.export(model, {"follow": law}, tmp_path)
    assert (
        "(const double q[2], const double v[2], const double clock[1], double tau[2])"
        in (tmp_path / "src" / "robot.h").read_text()
    )
    function, tau = library(tmp_path, *FUSED).robot_follow, np.zeros(2)
    q, v = np.array([0.3, -0.2]), np.array([0.5, 0.1])
    for t in (0.0, 0.7, 1.9, 5.0):
        assert call(function, q, v, np.array([t]), tau) == 0
        np.testing.assert_allclose(tau, law(model, t, q, v), rtol=0.0, atol=1e-12)


def test_laws_take_what_they_read(tmp_path: Path) -> None:
    """No torque nor time step but where the law has them; what is of the beginning of a step is what it is given."""
    model, hold = sd.load_urdf("two_link"), sd.PD([1.0, 1.0], [1.0, 1.0], [0.0, 0.0])
    laws = {
        "sum": hold + sd.Gravity(),
        "limited": path_law().limited_by([5.0, 5.0]),
        "sampled": sd.PD([1.0, 1.0], [1.0, 1.0], [0.0, 0.0], held=0.01),
    }
    header = sd.export(model, laws, tmp_path)[0].read_text()
    state = "(const double q[2], const double v[2], "
    assert f"int robot_sum{state}double tau[2]);" in header
    assert f"int robot_limited{state}const double clock[1], double tau[2]);" in header
    kept = "double dt, const double time_left[1], const double held_torque[2]"
    assert f"int robot_sampled{state}{kept}, double tau[2], double time_left_after[1]" in header


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_are_read_back_to_the_bit(kind: str) -> None:
    dtype: Any = KINDS[kind]
    for x in (*np.random.default_rng(0).normal(size=20), 0.0, -0.0, 1.0, 1e300 if kind == "double" else 1e30, 5e-324):
        text = number(float(x), kind)
        read = dtype(text.removesuffix("f"))
        assert read.tobytes() == dtype(x).tobytes()
        assert text.endswith("f") == (kind == "float")
    assert number(math.inf, kind) == "SD_INFINITY"


def test_only_functions_that_are_called_are_there() -> None:
    assert "sd_turn" not in functions_text(set(), "double")
    assert "sd_atan2" in functions_text({"atan2"}, "float")


# --- texts ----------------------------------------------------------------------------------------------


def evil() -> sd.Model:
    """A robot whose names would be code."""
    made = sd.ModelBuilder('*/ evil("robot")', root="evil_root")
    solid = (1.0, (0, 0, 0.1), 0.1 * np.eye(3))
    return made.add_body("evil_link", "evil_root", joint_name='evil*/ system("x");', inertia=solid).build()


def test_no_name_of_a_robot_is_in_a_file(tmp_path: Path) -> None:
    k = sd.specialize(evil(), sd.rnea, inputs='mass:evil*/ system("x");')
    for path in sd.export(evil(), {"torque": k, "step": sd.step, "law": sd.PD([1.0], [1.0], [0.2])}, tmp_path):
        assert "evil" not in path.read_text()
        assert "system" not in path.read_text()
    assert "mass_4" in (tmp_path / "src" / "robot.h").read_text()


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_cpp_has_arrays_by_size(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"torque": sd.rnea, "step": sd.step}, tmp_path)
    (tmp_path / "use.cpp").write_text(
        '#include "robot.hpp"\nint main() { std::array<double, 2> q{}, v{}, tau{};\n'
        "return robot::torque(q, v, v, tau) && robot::step(q, v, tau, 1e-3, q, v) ? 0 : 1; }\n"
    )
    words = ["c++", "-std=c++11", "-Wall", "-Wextra", "-pedantic", "-Werror", "-Isrc", "-fsyntax-only", "use.cpp"]
    subprocess.run(words, cwd=tmp_path, check=True)


@pytest.mark.skipif(shutil.which("rustc") is None, reason="no Rust compiler")
@pytest.mark.slow(quick="test_rust_has_arrays_by_size")
def test_rust_takes_the_declarations(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), FUNCTIONS, tmp_path)
    words = ["rustc", "--edition", "2021", "--crate-type", "lib", "-D", "warnings", "--emit", "metadata", "robot.rs"]
    subprocess.run(words, cwd=tmp_path / "rust", check=True)


def test_rust_has_arrays_by_size(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"step": sd.step}, tmp_path, dtype=np.float32)
    text = (tmp_path / "rust" / "robot.rs").read_text()
    assert "v: &[f32; 2], tau: &[f32; 2], dt: f32, q_after: &mut [f32; 2]" in text


@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake")
@pytest.mark.slow(quick="test_an_export_finds_its_answers_to_the_bit")
def test_cmake_builds_and_checks_it(tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), FUNCTIONS, tmp_path)
    for words in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"], ["ctest", "--test-dir", "build"]):
        said = subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert "100% tests passed" in said


# --- other chips ----------------------------------------------------------------------------------------


@pytest.mark.skipif(not HAS_ZIG, reason="no ziglang")
@pytest.mark.parametrize("chip", CHIPS)
def test_chips_compile_it_and_emulators_find_the_same_bits(chip: str, tmp_path: Path) -> None:
    sd.export(sd.load_urdf("two_link"), {"torque": sd.rnea, "law": "computed_torque"}, tmp_path)
    assert compiled_for(CHIPS[chip], tmp_path) in ((RIGHT, None) if FMA else (RIGHT, None, *range(7)))


# --- all of it ------------------------------------------------------------------------------------------

PAIR_ROBOTS = ("fixed", "floating", "groups", "mimic")


def pair_robot(name: str) -> sd.Model:
    if name == "groups":
        solid = (1.0, (0.1, 0.02, 0.1), 0.1 * np.eye(3))
        made = sd.ModelBuilder("groups").add_body("a", joint="spherical", inertia=solid)
        made.add_body("b", "a", "planar", placement=(0, 0, 0.2), inertia=solid)
        return made.add_body("c", "b", "continuous", placement=(0, 0, 0.2), inertia=solid).build(continuous="cos_sin")
    made_by_hand: sd.Model = robot({"fixed": "arm", "mimic": "gripper"}.get(name, name))
    return made_by_hand


def pairs(model: sd.Model, dtype: Any, folder: Path, names: Any) -> tuple[dict[str, Any], dict[str, str]]:
    """The calls and laws that are exported, and the errors of the others by name."""
    wanted, refused = {}, {}
    for name in names:
        try:
            what: Any = name
            if name in SPECS:
                what = sd.specialize(model, getattr(sd, name), dtype=dtype, **words_of(model, SPECS[name]))
            sd.export(model, {name: what}, folder / "one", dtype=dtype)
            wanted[name] = what
        except sd.SpatialDynError as error:
            refused[name] = str(error)
    return wanted, refused


@COMPILER
@pytest.mark.slow(quick="test_an_export_finds_its_answers_to_the_bit")
@pytest.mark.parametrize(("name", "kind"), [(name, [*KINDS][k % len(KINDS)]) for k, name in enumerate(PAIR_ROBOTS)])
def test_every_call_and_law_is_exported_or_refused_by_name(name: str, kind: str, tmp_path: Path) -> None:
    names = (*SPECS, "pd", "pd_gravity", "pd_plus", "computed_torque", "passivity_based", "cosine_shaping")
    model = pair_robot(name)
    wanted, refused = pairs(model, KINDS[kind], tmp_path, names)
    assert {"rnea", "aba", "crba", "pd"} <= set(wanted)
    for call_name, text in refused.items():
        assert call_name in text
    sd.export(model, wanted, tmp_path / "all", dtype=KINDS[kind])
    said = compiled_here(tmp_path / "all", level="-O0")
    if FMA:
        assert said == summary("robot", 3 * len(wanted))


# --- what is refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["for", "class", "fn", "sin", "1st", "a b", "", "x12", "_x", "sd_turn", "größe", 5])
def test_names_that_a_language_has_are_refused(name: Any, tmp_path: Path) -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.SpatialDynError, match="name of a function is "):
        sd.export(model, {name: sd.rnea}, tmp_path)
    with pytest.raises(sd.SpatialDynError, match="name is "):
        sd.export(model, {"torque": sd.rnea}, tmp_path, name=name)
    assert not list(tmp_path.iterdir())


def test_what_has_no_program_is_named(tmp_path: Path) -> None:
    model = sd.load_urdf("two_link")
    steps = sd.PD([1.0, 1.0], [1.0, 1.0], np.zeros((5, 2)))
    for what, said in (
        (sd.aba_square_root, "root: aba_square_root .* has no program"),
        ("lqr", 'root: "lqr" is no law, expected one of pd, '),
        (steps, r"root: q_ref has shape \(5, 2\), expected \(2,\): one value, for all steps and samples"),
        (sd.specialize(model, sd.rnea, np.float32), "root: a program in float32, expected one in float64"),
        (
            Spec("odd", _doubled, None, (Argument("class", ("nv",), "", ""),), TAU, "", ""),
            "root: an array is named 'class'",
        ),
        (sd.neutral, "root: the result is a constant"),
    ):
        with pytest.raises(sd.SpatialDynError, match=said):
            sd.export(model, {"root": what}, tmp_path)
    with pytest.raises(sd.SpatialDynError, match="functions have check or is_fused"):
        sd.export(model, {"check": sd.rnea}, tmp_path)
    with pytest.raises(sd.SpatialDynError, match=r"functions is \{\}, expected a dict"):
        sd.export(model, {}, tmp_path)
    held = robot("arm")
    scene = sd.Scene(held, friction=False, **options(held, "couplers"))
    with pytest.raises(sd.SpatialDynError, match="step: dtype is float32, expected float64 with constraints"):
        sd.export(scene, {"step": sd.step}, tmp_path, dtype=np.float32)
    assert not list(tmp_path.iterdir())


def test_other_files_are_not_replaced_and_an_earlier_export_is(tmp_path: Path) -> None:
    model = sd.load_urdf("two_link")
    sd.export(model, {"torque": sd.rnea}, tmp_path)
    sd.export(model, {"gravity": sd.generalized_gravity}, tmp_path)
    assert "robot_gravity" in (tmp_path / "src" / "robot.h").read_text()
    (tmp_path / "src" / "robot.c").write_text("mine")
    with pytest.raises(sd.SpatialDynError, match=r"robot.c is there, and no export has made it"):
        sd.export(model, {"torque": sd.rnea}, tmp_path)
    assert "robot_gravity" in (tmp_path / "src" / "robot.h").read_text()
