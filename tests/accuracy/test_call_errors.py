"""Digits of each call against the exact engine: corpus, long chains, chains of unequal masses.

The chains have exact rotations (signed permutations). ``benchmarks/accuracy.py`` prints the whole
table.
"""

from __future__ import annotations

import json
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import ROBOTS
from slow import slow_but, thinned

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
if not (BENCHMARKS / "accuracy.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))

import accuracy  # noqa: E402
import forward  # noqa: E402
from accuracy import EPS, chain, measured, state  # noqa: E402

ROBOT = {"rnea": 8 * EPS, "crba": 10 * EPS}  # of some fifty bodies; measured 6 and 7
CHAIN = {"rnea": 20 * EPS, "crba": 50 * EPS}  # to 300 bodies, where roundings add up; measured 13 and 39
FORWARD = {10: 1e-14, 100: 1e-12, 1000: 1e-11}  # condition numbers of 4e4, 3e8, 6e11
TIP = {1e3: 2e-13, 1e6: 1e-10, 1e9: 2e-7, 1e12: 2e-4}  # the mass ratio is the condition number
RARE = 15.0  # times these, of a hundred states; measured 13
PEER = 1.25  # times Pinocchio's, nine states of ten; measured 1.15
REFINED = 1e-14  # to a tip of 1e9, where ABA keeps 7 digits; nine states of ten are below 3e-15
ROUNDED = 4.0  # times the change by an ulp of the inputs, where that is more: one state in thirty
RARELY = 20.0  # the same in one state of a hundred: of 600, 3.0 and 5.0 by two compilations of the same recursion
ROOTS = 1e-13  # whatever the tip, of a hundred states; measured 3e-14, where an ulp of the inputs moves 5e-14
LIGHTER = 1e-13  # the scaled condition number stays small
NAMES = [name for name in ROBOTS if name != accuracy.WRONG_NAME]


EPS32 = float(np.finfo(np.float32).eps)
SINGLE = {"rnea": 8 * EPS32, "crba": 16 * EPS32}  # of some fifty bodies, inputs rounded besides; measured 5 and 11
FEW, HUNDRED = 20, 100 if not numba_kernels.PLAIN else 20  # states of a quick test, and of a slow one
BATCH = 24  # not a multiple of the lanes
LONG = {  # programs that take a second and more to compile
    "alex_psyonic_hands", "alex_sake_hands", "baxter", "centauro", "g1_29dof_rev_1_0", "g1_29dof_with_hand_rev_1_0",
    "human", "icub", "icub_reduced", "pr2", "romeo_small", "simple_humanoid", "simple_humanoid_classical",
    "talos_full_v2", "talos_reduced", "tiago", "tiago_dual", "tiago_pro",
}  # fmt: skip
SHORT = {*NAMES[::15]} - LONG
TIPS = slow_but({(1e3, FEW)}, [(1e3, FEW), *((m, HUNDRED) for m in TIP)])  # an exact answer each
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs")


def worst(model: sd.Model, name: str, states: int = 1, seed: int = 0) -> float:
    rng = np.random.default_rng(seed)
    return max(measured(model, name, s) for s in [state(model, rng) for _ in range(states)])


@pytest.mark.parametrize("name", slow_but(NAMES[::12], thinned(NAMES[::12], NAMES, 2)))
def test_inverse_dynamics_and_mass_matrix_of_every_robot_are_next_to_exact(name: str) -> None:
    for _, model in accuracy.corpus([name]):
        assert worst(model, "rnea") <= ROBOT["rnea"]
        assert worst(model, "crba") <= ROBOT["crba"]


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("n", slow_but([30], [30, 300]))
def test_inverse_dynamics_and_mass_matrix_of_chains_are_next_to_exact(n: int, spatial: bool) -> None:
    model = chain(n, spatial)
    assert worst(model, "rnea") <= CHAIN["rnea"]
    if n < 300 or not spatial:  # M of 300 bodies takes 4 s
        assert worst(model, "crba") <= CHAIN["crba"]


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("n", slow_but([10, 100], FORWARD))
def test_forward_dynamics_of_chains(n: int, spatial: bool) -> None:
    assert worst(chain(n, spatial), "aba", states=3 if n == 10 else 1) <= FORWARD[n]


@cache
def heavy_tip(m: float, states: int, spatial: bool) -> list[forward.Measured]:
    return list(forward.measured(forward.Case(spatial, [1.0] * 6 + [m], states), ["pin.aba"]))


def errors(m: float, states: int, spatial: bool, way: str) -> Any:
    return np.array([x.errors[way] for x in heavy_tip(m, states, spatial)])


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize(("m", "states"), TIPS)
def test_forward_dynamics_with_a_heavy_tip(m: float, states: int, spatial: bool) -> None:
    """In a plane the median of states is within the bound, in space nine of ten; Pinocchio's are no better."""
    found, other = errors(m, states, spatial, "aba"), errors(m, states, spatial, "pin.aba")
    assert np.quantile(found, 0.9 if spatial else 0.5) <= TIP[m]
    assert found.max() <= RARE * TIP[m]
    assert len(found) < 100 or np.quantile(found, 0.9) <= PEER * np.quantile(other, 0.9)


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize(
    ("m", "states"), slow_but({(1e9, FEW)}, [(1e9, FEW), *((m, HUNDRED) for m in TIP if m <= 1e9)])
)
def test_refinement_keeps_every_digit_of_a_heavy_tip_that_the_inputs_have(m: float, states: int, spatial: bool) -> None:
    found = errors(m, states, spatial, "refined")
    assert np.quantile(found, 0.9) <= REFINED
    beyond = [(x, error) for x, error in zip(heavy_tip(m, states, spatial), found, strict=True) if error > REFINED]
    ulps = [error / forward.moved(x.model, x.state, x.truth) for x, error in beyond]
    assert sum(u > ROUNDED for u in ulps) <= len(found) / 100
    assert max(ulps, default=0.0) <= RARELY


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize(("m", "states"), TIPS)
def test_square_roots_keep_every_digit_of_any_heavy_tip(m: float, states: int, spatial: bool) -> None:
    assert errors(m, states, spatial, "square_root").max() <= ROOTS


def test_the_table_of_forward_dynamics_has_the_peers_beside_every_method() -> None:
    """The errors that ``benchmarks/forward.py --json`` measured, on the same states."""
    table = json.loads((BENCHMARKS / "forward.json").read_text(encoding="utf-8"))["errors"]
    cases = dict(forward.cases())
    assert set(table) == set(cases)
    for name, case in cases.items():
        found, n = table[name], len(case.masses)
        assert found["states"] == case.states
        assert {*forward.METHODS, *(["pin.aba"] if n <= forward.LARGEST else []), "mujoco"} <= set(found)
        if ", tip" in name and case.masses[-1] > 1.0:
            assert found["square_root"]["worst"] <= ROOTS
            if not case.shaped:
                assert found["aba"]["most" if case.spatial else "median"] <= TIP[case.masses[-1]]
        elif n > 7:
            assert found["aba"]["worst"] <= FORWARD[n]
        elif not case.shaped:
            assert found["aba"]["worst"] <= LIGHTER


OF_KEPT = 4.0  # times the kept error of the same states: another compilation rounds otherwise
AGAIN = ["7 links, spatial, tip 1e+12", "7 rods, planar, tip 1e+09", "7 rods, spatial, alternating 1e-06"]


@pytest.mark.parametrize("name", AGAIN)
def test_forward_dynamics_of_today_has_the_errors_of_the_table(name: str) -> None:
    """Two states of each kind of chain are measured again, by every method.

    The table is of compiled code, which fuses products and sums; plain Python rounds both, and has other errors.
    """
    table = json.loads((BENCHMARKS / "forward.json").read_text(encoding="utf-8"))["errors"][name]
    case = dict(forward.cases())[name]
    for x in forward.measured(case._replace(states=2), []):
        assert x.errors["square_root"] <= ROOTS
        for method in () if numba_kernels.PLAIN else forward.METHODS:
            assert x.errors[method] <= OF_KEPT * table[method]["worst"], method


@pytest.mark.parametrize("name", [name for name, _ in accuracy.lopsided() if not name.startswith("tip")])
def test_forward_dynamics_with_light_links(name: str) -> None:
    assert worst(dict(accuracy.lopsided())[name], "aba", states=3) <= LIGHTER


@compiled
@pytest.mark.parametrize("name", slow_but(SHORT, thinned(SHORT, NAMES, 1)))
def test_float32_on_lanes_answers_every_state_of_a_robot_or_says_which_joint_it_cannot(name: str) -> None:
    """A pivot that float32 loses is judged in float64: there is an acceleration, or an InertiaError, never NaN."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # inertias that no body has
        model = sd.load_urdf(ROBOTS[name])
    rng = np.random.default_rng(0)
    states = [state(model, rng) for _ in range(BATCH)]
    q, v, tau = (np.array([getattr(s, x) for s in states], np.float32) for x in ("q", "v", "tau"))
    try:
        wanted = sd.aba(model, q, v, tau)
    except sd.InertiaError:
        with pytest.raises(sd.InertiaError, match="has zero articulated inertia"):
            sd.specialize(model, sd.aba, dtype=np.float32)(q, v, tau)
        return
    found = sd.specialize(model, sd.aba, dtype=np.float32)(q, v, tau)
    assert found.dtype == np.float32
    assert found.shape == wanted.shape
    assert np.isfinite(found).all()


def test_the_table_of_errors_holds_every_robot_and_its_bounds() -> None:
    """The errors that ``benchmarks/accuracy.py --json`` measured."""
    table = json.loads((BENCHMARKS / "accuracy.json").read_text(encoding="utf-8"))
    assert set(table["corpus"]) >= {f"{name} {root}" for name in NAMES for root in ("fixed", "floating")}
    for found in table["corpus"].values():
        assert set(found) == {*accuracy.CALLS, *(f"{call} float32" for call in accuracy.CALLS)}
        for call, bound in SINGLE.items():
            assert found[f"{call} float32"] <= bound
            assert found[call] <= ROBOT[call]
        for call in ("aba", "aba float32"):
            assert found[call] == "singular" or found[call] < 1e-3


@compiled
@pytest.mark.parametrize("name", ["double_pendulum", "ur3_robot"])
def test_calls_of_today_have_the_errors_of_the_table(name: str) -> None:
    """A state of small robots, fixed and floating, is measured again, in float32 too."""
    table = json.loads((BENCHMARKS / "accuracy.json").read_text(encoding="utf-8"))["corpus"]
    for label, model in accuracy.corpus([name]):
        found = accuracy.worst(model, 1)
        assert set(found) == set(table[label])
        for call, error in found.items():
            eps = EPS32 if "float32" in call else EPS
            assert error <= max(OF_KEPT * table[label][call], 8 * eps), call


def test_a_wrong_digit_would_show() -> None:
    """The measures see an error of one part in 2⁴⁶."""
    model, s = chain(10, True), state(chain(10, True), np.random.default_rng(0))
    for name, bound in (*ROBOT.items(), ("aba", FORWARD[10])):
        wrong = measured(model, name, s, lambda m, *x, name=name: getattr(sd, name)(m, *x) * (1 + 2.0**-46))
        assert wrong > bound
