"""Regrouped programs keep the digits of single calls: which inertias move, and the operations saved."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow import slow_but

import spatialdyn as sd
from spatialdyn.algebra.euclidean import Sym
from spatialdyn.algebra.records import inertia_of
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording, regroup
from spatialdyn.engines.programs.record.tracer import Row, table
from spatialdyn.recursions import SPECS
from spatialdyn.urdf.load import example_robots

pytest.importorskip("mpmath")
BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
if not (BENCHMARKS / "digits.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))

import digits  # noqa: E402

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing runs on lanes")
installed = pytest.mark.skipif(not example_robots(), reason="example-robot-data is not installed")

CALLS, AXES = list(digits.CALLS), np.eye(3)
SAMPLES = 12  # of each kind of pose
ROBOTS = [("icub_reduced", name) for name in ("crba", "aba", "aba_refined")] + [("double_pendulum", "aba_refined")]
ROBOTS += [(robot, name) for robot in ("ur5", "panda", "so101") for name in CALLS] + [("romeo_laas_small", "crba")]
FLOATING = ("double_pendulum", "romeo_laas_small")


def held(model: sd.Model, name: str, dtypes: tuple[Any, ...] = (np.float64, np.float32), few: int = SAMPLES) -> None:
    """Assert that a batch has the digits of single calls, in the random poses and in the straight ones."""
    state = digits.states(model, few)
    for part in (slice(0, few), slice(few, None)):
        for dtype in dtypes:
            seen = digits.judged(model, name, {letter: x[part] for letter, x in state.items()}, dtype)
            assert seen is not None
            assert seen.share <= 1.0, (model.name, name, dtype, seen)


# --- digits -----------------------------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("thin", digits.THIN)
@pytest.mark.parametrize("n", slow_but([6], [2, 6]))
def test_batches_of_thin_rods_keep_the_digits_of_single_calls(n: int, thin: float, name: str) -> None:
    held(digits.rods(n, thin), name)


def rod_tree(seed: int, n: int = 5) -> sd.Model:
    """Rods of any thinness along coordinate axes, on hinges and sliders along coordinate axes, some at right angles."""
    rng = np.random.default_rng(seed)
    made, ends = sd.ModelBuilder(f"rods{seed}"), [np.zeros(3)]
    for k in range(n):
        along, length, mass = AXES[rng.integers(3)], rng.uniform(0.3, 1.0), rng.uniform(0.5, 2.0)
        moment = mass * length**2 / 12.0
        inertia = moment * (np.eye(3) - np.outer(along, along)) + moment * 10.0 ** -rng.uniform(0, 12) * np.outer(
            along, along
        )
        placed = np.eye(4)
        if rng.random() < 0.4:
            placed[:3, :3] = AXES[rng.permutation(3)]
            placed[0, :3] *= np.linalg.det(placed[:3, :3])
        parent = int(rng.integers(max(1, k - 1), k + 1)) if k else 0
        placed[:3, 3] = ends[parent]
        kind = "prismatic" if rng.random() < 0.15 else "revolute"
        rod = (mass, 0.5 * length * rng.integers(0, 2) * along, inertia)
        made.add_body(f"l{k + 1}", f"l{parent}" if k else None, kind, AXES[rng.integers(3)], placed, rod)
        ends.append(length * rng.integers(0, 2) * along)
    return made.build()


@compiled
@pytest.mark.parametrize(
    "axis",
    slow_but(
        [((0.6, 0.8, 0.0),), ((8e-4, 0.0, 1.0),)],
        [((0.6, 0.8, 0.0),), ((0.8, 0.0, -0.6),), ((1e-6, 0.0, 1.0),), ((8e-4, 0.0, 1.0),)],
    ),
)
def test_a_thin_rod_hinged_about_no_coordinate_axis_keeps_its_digits_in_a_batch(axis: tuple[float, ...]) -> None:
    for thin in digits.THIN:
        made = sd.ModelBuilder("rods")
        rod = (1.0, (0.25, 0.0, 0.0), np.diag([thin, 1.0 / 48.0, 1.0 / 48.0]))
        made.add_body("l0", None, "revolute", (1.0, 0.0, 0.0), inertia=rod)
        made.add_body("l1", "l0", "revolute", axis, (0.5, 0.0, 0.0), rod)
        for name in CALLS:
            held(made.build(), name, few=4)


@compiled
@pytest.mark.parametrize("seed", slow_but(range(6), range(12)))
def test_batches_of_random_trees_of_rods_keep_the_digits_of_single_calls(seed: int) -> None:
    for name in ("rnea", "crba", "aba", "aba_refined"):
        held(rod_tree(seed), name, (np.float64,))


@compiled
@installed
@pytest.mark.parametrize(("robot", "name"), slow_but([x for x in ROBOTS if x[0] in ("ur5", "double_pendulum")], ROBOTS))
def test_batches_of_robots_keep_the_digits_of_single_calls(robot: str, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inertias that no body can have
        model = sd.load_urdf(robot, root="floating" if robot in FLOATING else "fixed")
    held(model, name, (np.float64,) if robot == "icub_reduced" else (np.float64, np.float32), 6)


def heavy_tip(tip: float, n: int = 7) -> sd.Model:
    """Links of any shape about axes along coordinates, the last so many times heavier."""
    rng, made = np.random.default_rng(4), sd.ModelBuilder("heavy tip")
    for k in range(n):
        com, mass = rng.uniform(-0.3, 0.3, 3), tip if k == n - 1 else 1.0
        inertia = mass * np.diag([0.03, 0.04, 0.05])
        placed = np.eye(4)
        placed[:3, 3] = rng.uniform(-0.5, 0.5, 3)
        made.add_body(f"l{k}", f"l{k - 1}" if k else None, "revolute", AXES[k % 3], placed, (mass, com, inertia))
    return made.build()


@compiled
@pytest.mark.parametrize("tip", [1e3, 1e6, 1e9])
def test_light_links_cost_a_refined_batch_no_digits(tip: float) -> None:
    """Mass moved to light links costs digits: without LEAST_MASS_RATIO a batch has those of aba, 1e-10 at 1e6."""
    held(heavy_tip(tip), "aba_refined", (np.float64,))


# --- moved inertias ---------------------------------------------------------------------------------------


def moved(axis: Any, inertia: Any, carrier: float = 1.0, solved: bool = True) -> tuple[Row, Row]:
    """Rows of a parent of that mass and of a body of mass 1 at its hinge, regrouped."""
    made = sd.ModelBuilder("two").add_body("a", None, "floating", inertia=(carrier, np.zeros(3), np.eye(3)))
    made = made.add_body("b", "a", "revolute", axis=axis, inertia=(1.0, np.zeros(3), inertia))
    rows = table(made.build().bodies)
    regroup.regroup(rows, solved)
    return rows[-2], rows[-1]


@pytest.mark.parametrize("long", range(3))
@pytest.mark.parametrize("axis", range(3))
def test_the_least_inertia_across_the_axis_is_moved(axis: int, long: int) -> None:
    """No diagonal entry becomes negative, and the parent gets at most the body's own inertia."""
    diagonal = np.where(np.arange(3) == long, 1e-3, 1.0)
    a, b = moved(AXES[axis], np.diag(diagonal))
    least = min(diagonal[k] for k in range(3) if k != axis)
    across = np.where(np.arange(3) == axis, 0.0, least)
    left, given = inertia_of(b.inertia).I, inertia_of(a.inertia).I
    np.testing.assert_array_equal([left.xx, left.yy, left.zz], diagonal - across)
    np.testing.assert_array_equal([given.xx, given.yy, given.zz], 1.0 + across)


@pytest.mark.parametrize("off", [1e-9, 0.0, -1e-12])
def test_an_axis_may_be_off_a_coordinate_by_an_entry_whose_square_is_below_eps(off: float) -> None:
    _, b = moved((1.0, 0.0, off), np.diag([1.0, 1.0, 1e-3]))
    assert (b.inertia.I.yy, b.inertia.I.zz) == (1.0 - 1e-3, 0.0)


def test_across_an_oblique_axis_no_inertia_is_moved() -> None:
    a, b = moved((0.48, 0.6, 0.64), np.diag([1.0, 2.0, 2.5]))
    assert inertia_of(b.inertia).I == Sym(1.0, 0.0, 0.0, 2.0, 0.0, 2.5)
    assert (a.inertia.m, b.inertia.m) == (2.0, 0.0)


@pytest.mark.parametrize(("solved", "carrier", "given"), [
    (True, 0.26, True), (True, 0.24, False), (True, 0.0, False), (False, 0.24, True), (False, 0.0, False),
])  # fmt: skip
def test_a_light_carrier_is_given_nothing_that_is_solved_for(solved: bool, carrier: float, given: bool) -> None:
    a, b = moved(AXES[2], np.eye(3), carrier, solved)
    assert (a.inertia.m, b.inertia.m) == ((carrier + 1.0, 0.0) if given else (carrier, 1.0))


@installed
@pytest.mark.parametrize(("name", "least"), [("rnea", 0.25), ("aba", 0.36)])
def test_regrouping_saves_a_third_of_the_operations_of_an_arm(
    monkeypatch: pytest.MonkeyPatch, name: str, least: float
) -> None:
    model, spec = sd.load_urdf("ur5"), numba_kernels.variant(SPECS[name], frozenset())

    def count() -> int:
        operations = recording.record((spec,), model.bodies).program.operations
        return operations["mul"] + operations["add"]

    few = count()
    monkeypatch.setattr(recording, "regroup", lambda rows, solved: None)
    assert few <= (1.0 - least) * count()
