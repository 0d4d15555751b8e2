"""How many digits each call has, against the exact engine: corpus, long chains, lopsided robots.

The chains and lopsided robots have exact rotations (signed permutations). ``benchmarks/accuracy.py`` prints the whole
table.
"""

from __future__ import annotations

import json
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines import jit
from spatialdyn.urdf import example_robots, robot_names

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
if not (BENCHMARKS / "accuracy.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))

import accuracy  # noqa: E402
from accuracy import EPS, chain, measured, state  # noqa: E402

ROBOT = {"rnea": 8 * EPS, "crba": 10 * EPS}  # of some fifty bodies; measured 6 and 7
CHAIN = {"rnea": 20 * EPS, "crba": 50 * EPS}  # to 300 bodies, where roundings add up; measured 13 and 39
FORWARD = {10: 1e-14, 100: 1e-12, 1000: 1e-11}  # condition numbers of 4e4, 3e8, 6e11
TIP = {1e3: 2e-13, 1e6: 1e-10, 1e9: 2e-7, 1e12: 2e-4}  # the mass ratio is the condition number
RARE = 15.0  # times these, of a hundred states; measured 13
PEER = 1.25  # times Pinocchio's, nine states of ten; measured 1.15
REFINED = 1e-14  # to a tip of 1e9, where ABA keeps 7 digits; nine states of ten are below 3e-15
ROUNDED = 4.0  # times what an ulp of the inputs moves, where that is more: one state in thirty; measured 3.2
ROOTS = 1e-13  # whatever the tip, of a hundred states; measured 3e-14, where an ulp of the inputs moves 5e-14
LIGHTER = 1e-13  # the scaled condition number stays small
NAMES = [n for n, path in robot_names().items() if path in set(example_robots()) and n != accuracy.WRONG_NAME]


EPS32 = float(np.finfo(np.float32).eps)
SINGLE = {"rnea": 8 * EPS32, "crba": 16 * EPS32}  # of some fifty bodies, inputs rounded besides; measured 5 and 11
HUNDRED = 100 if not jit.PLAIN else 10
BATCH = 24  # not a multiple of the lanes
compiled = pytest.mark.skipif(jit.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs")


def worst(model: sd.Model, name: str, states: int = 1, seed: int = 0) -> float:
    rng = np.random.default_rng(seed)
    return max(measured(model, name, s) for s in [state(model, rng) for _ in range(states)])


@pytest.mark.parametrize("name", NAMES)
def test_inverse_dynamics_and_mass_matrix_of_every_robot_are_next_to_exact(name: str) -> None:
    for _, model in accuracy.corpus([name]):
        assert worst(model, "rnea") <= ROBOT["rnea"]
        assert worst(model, "crba") <= ROBOT["crba"]


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("n", [30, 300])
def test_inverse_dynamics_and_mass_matrix_of_chains_are_next_to_exact(n: int, spatial: bool) -> None:
    model = chain(n, spatial)
    assert worst(model, "rnea") <= CHAIN["rnea"]
    if n < 300 or not spatial:  # M of 300 bodies takes 4 s
        assert worst(model, "crba") <= CHAIN["crba"]


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("n", FORWARD)
def test_forward_dynamics_of_chains(n: int, spatial: bool) -> None:
    assert worst(chain(n, spatial), "aba", states=3 if n == 10 else 1) <= FORWARD[n]


class Cases(NamedTuple):
    """A robot, states of it, and the exact forward dynamics of each."""

    model: sd.Model
    states: list[accuracy.State]
    truth: list[Any]

    def errors(self, method: str) -> Any:
        """(states,) errors of a method."""
        found = (sd.forward_dynamics(self.model, s.q, s.v, s.tau, method=method) for s in self.states)
        return np.array([accuracy.error("aba", a, t) for a, t in zip(found, self.truth, strict=True)])


@cache
def heavy_tip(m: float, spatial: bool) -> Cases:
    model, rng = chain(7, spatial, [1.0] * 6 + [m]), np.random.default_rng(7)
    states = [state(model, rng) for _ in range(HUNDRED)]
    exact = sd.exact(model, sd.aba, accuracy.BITS)
    return Cases(model, states, [exact(s.q, s.v, s.tau) for s in states])


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("m", TIP)
def test_forward_dynamics_with_a_heavy_tip(m: float, spatial: bool) -> None:
    """In a plane the median of states is within the bound, in space nine of ten; Pinocchio's are no better."""
    cases = heavy_tip(m, spatial)
    found, masses = cases.errors("aba"), [1.0] * 6 + [m]
    other = [accuracy.peers(spatial, masses, s, t)["pin.aba"] for s, t in zip(cases.states, cases.truth, strict=True)]
    assert np.quantile(found, 0.9 if spatial else 0.5) <= TIP[m]
    assert found.max() <= RARE * TIP[m]
    assert len(found) < 100 or np.quantile(found, 0.9) <= PEER * np.quantile(other, 0.9)


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("m", [m for m in TIP if m <= 1e9])
def test_refinement_keeps_every_digit_of_a_heavy_tip_that_the_inputs_have(m: float, spatial: bool) -> None:
    cases = heavy_tip(m, spatial)
    found = cases.errors("refined")
    assert np.quantile(found, 0.9) <= REFINED
    for k in np.flatnonzero(found > REFINED):
        assert found[k] <= ROUNDED * accuracy.moved(cases.model, cases.states[k], cases.truth[k])


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("m", TIP)
def test_square_roots_keep_every_digit_of_any_heavy_tip(m: float, spatial: bool) -> None:
    assert heavy_tip(m, spatial).errors("square_root").max() <= ROOTS


def test_the_table_of_forward_dynamics_has_the_peers_beside_every_method() -> None:
    """What ``benchmarks/accuracy.py --json`` has measured, on the same states."""
    table = json.loads((BENCHMARKS / "accuracy.json").read_text(encoding="utf-8"))["forward"]
    assert set(table) == {name for name, *_ in accuracy.forward_cases()}
    for (name, _, masses, states), found in zip(accuracy.forward_cases(), table.values(), strict=True):
        assert found["states"] == states
        assert {*accuracy.METHODS, *(["pin.aba"] if len(masses) <= accuracy.LARGEST else [])} <= set(found)
        assert "mujoco" in found or "light" in name or "alternating" in name  # it takes 1e-15 kg m² for nothing
        if "tip 1e+" in name or "tip 1000" in name:
            assert found["aba"]["most" if "spatial" in name else "usual"] <= TIP[masses[-1]]
            assert found["square_root"]["worst"] <= ROOTS
            assert found["pin.aba"]["usual"] > found["square_root"]["worst"] or masses[-1] < 1e6
        elif "links, planar" in name or len(masses) > 7:
            assert found["aba"]["worst"] <= FORWARD[len(masses)]
        else:
            assert found["aba"]["worst"] <= LIGHTER


@pytest.mark.parametrize("name", [name for name, _ in accuracy.lopsided() if not name.startswith("tip")])
def test_forward_dynamics_with_light_links(name: str) -> None:
    assert worst(dict(accuracy.lopsided())[name], "aba", states=3) <= LIGHTER


@compiled
@pytest.mark.parametrize("name", NAMES)
def test_float32_on_lanes_answers_every_state_of_a_robot_or_says_which_joint_it_cannot(name: str) -> None:
    """A pivot that float32 loses is judged in float64: there is an acceleration, or an InertiaError, never NaN."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # inertias that no body has
        model = sd.load_urdf(robot_names()[name])
    rng = np.random.default_rng(0)
    states = [state(model, rng) for _ in range(BATCH)]
    q, v, tau = (np.array([getattr(s, x) for s in states], np.float32) for x in ("q", "v", "tau"))
    try:
        wanted = sd.aba(model, q, v, tau)
    except sd.InertiaError:
        with pytest.raises(sd.InertiaError, match="moves no inertia"):
            sd.specialize(model, sd.aba, dtype=np.float32)(q, v, tau)
        return
    found = sd.specialize(model, sd.aba, dtype=np.float32)(q, v, tau)
    assert found.dtype == np.float32
    assert found.shape == wanted.shape
    assert np.isfinite(found).all()


def test_the_table_of_errors_holds_every_robot_and_its_bounds() -> None:
    """What ``benchmarks/accuracy.py --json`` has measured."""
    table = json.loads((BENCHMARKS / "accuracy.json").read_text(encoding="utf-8"))
    assert set(table["corpus"]) >= {f"{name} {root}" for name in NAMES for root in ("fixed", "floating")}
    for found in table["corpus"].values():
        assert set(found) == {*accuracy.CALLS, *(f"{call} float32" for call in accuracy.CALLS)}
        for call, bound in SINGLE.items():
            assert found[f"{call} float32"] <= bound
            assert found[call] <= ROBOT[call]
        for call in ("aba", "aba float32"):
            assert found[call] == "singular" or found[call] < 1e-3


def test_a_wrong_digit_would_show() -> None:
    """The measures see an error of one part in 2⁴⁶."""
    model, s = chain(10, True), state(chain(10, True), np.random.default_rng(0))
    for name, bound in (*ROBOT.items(), ("aba", FORWARD[10])):
        wrong = measured(model, name, s, lambda m, *x, name=name: getattr(sd, name)(m, *x) * (1 + 2.0**-46))
        assert wrong > bound
