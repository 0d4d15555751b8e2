"""``trade`` measures errors that are errors and marks the front that is one; ``recommend`` keeps its promise."""

from __future__ import annotations

import importlib.util
import json
import math
import pickle
from collections import Counter
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from slow import slow_but
from trees import random_inertia, random_tree

import spatialdyn as sd
from spatialdyn.accuracy import call_errors, integrator_errors, references
from spatialdyn.accuracy.call_errors import costs
from spatialdyn.accuracy.reference_motion import exact_motion
from spatialdyn.accuracy.results import INPUTS, Option, Tradeoff, mark_pareto
from spatialdyn.accuracy.tradeoff import TASKS, advice
from spatialdyn.calls.dynamics import calls
from spatialdyn.commands import cli
from spatialdyn.engines.compiled import numba_kernels

pytest.importorskip("mpmath")
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="lanes are programs, and motions heavy")
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-12)
FRESH = 512  # states that nothing was measured in
CERTAIN = 1e-20  # of the reference of calls, on models whose M has a condition below 1e10
METHODS, DURATION = ("rk4", "gauss6"), 0.5
ALL = call_errors.TASK_CALLS["forward_dynamics"]


def chain(masses: tuple[float, ...], seed: int) -> sd.Model:
    """Bodies of these masses on hinges about coordinate axes, frames shifted and not turned."""
    rng, builder = np.random.default_rng(seed), sd.ModelBuilder("chain")
    for k, mass in enumerate(masses):
        whole, com, I = random_inertia(rng)
        axis, placement = np.eye(3)[rng.integers(3)], rng.uniform(-0.5, 0.5, size=3)
        builder.add_body(
            f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, placement, (mass, com, mass / whole * I)
        )
    return builder.build()


MODELS: dict[str, Callable[[], sd.Model]] = {
    "pendulum": lambda: sd.load_urdf("pendulum"),
    "two_link": lambda: sd.load_urdf("two_link"),
    "tree": lambda: random_tree(0, 4).model,
    "other tree": lambda: random_tree(1, 3, continuous="cos_sin").model,
    "floating": lambda: random_tree(2, 2, floating=True).model,
    "even": lambda: chain((1.0,) * 4, 3),
    "heavy tip 1e3": lambda: chain((1.0,) * 3 + (1e3,), 4),
    "heavy tip 1e6": lambda: chain((1.0,) * 3 + (1e6,), 5),
    "light tip": lambda: chain((1.0,) * 3 + (1e-9,), 6),
    "alternating": lambda: chain((1.0, 1e-4, 1.0, 1e-4), 7),
}


# --- the promise ------------------------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize("name", slow_but(["heavy tip 1e6"], MODELS))
def test_what_is_recommended_meets_its_tolerance_on_fresh_states(name: str) -> None:
    model = MODELS[name]()
    for task in call_errors.TASK_CALLS:
        found = sd.trade(model, task)
        assert found.certainty <= CERTAIN
        first = call_errors.TASK_CALLS[task][0]
        fresh = call_errors.random_call_states(model, task, FRESH, seed=1)
        truth, _ = references.truths(model, first, fresh)
        for tolerance in TOLERANCES:
            chosen = advice(found, tolerance)
            errors = references.of_calls(first, np.asarray(chosen(*fresh)), truth)
            assert errors.max() <= tolerance, (task, tolerance, chosen.option.name)


@compiled
def test_no_error_is_above_what_is_promised() -> None:
    found = sd.trade(MODELS["two_link"](), states=64, batch=8)
    lanes = [x for x in found.options if x.name.startswith("lanes")]
    assert len(lanes) == 6  # aba, crba_solve and aba_refined, each in float64 and float32
    for x in lanes:
        assert x.error < x.promised < 1e4 * x.error
        assert json.loads(found.to_json())["options"][found.options.index(x)]["promised"] == x.promised
    assert {x.promised for x in found.options if x not in lanes} == {math.inf}
    why = advice(found, 1e-9).why
    assert "its rounding is bounded by " in why
    assert "tolerance=...) holds each answer to its own bound" in why
    figure = found.plot() if _has_matplotlib() else None
    if figure is not None:
        (axes,) = figure.axes
        ends = sorted(tuple(path.vertices[:, 1]) for x in axes.collections for path in x.get_paths())
        assert ends == sorted((x.error, x.promised) for x in lanes)


@compiled
def test_the_bound_is_the_smaller_of_both_extrapolations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(call_errors, "_promised", lambda *given: dict.fromkeys(references.NORMS, np.full(64, 1e-30)))
    for x in sd.trade(MODELS["two_link"](), "inverse_dynamics", states=64, batch=8).options:
        assert x.bound == references.error_bound(np.full(64, 1e-30)) < x.error


def _has_matplotlib() -> bool:
    return importlib.util.find_spec("matplotlib") is not None


@compiled
def test_errors_are_the_same_whatever_the_batch() -> None:
    model = MODELS["two_link"]()
    few, many = ({x.name: x for x in sd.trade(model, batch=b).options} for b in (1, 4096))
    for name, option in few.items():
        if not name.endswith("extended"):  # on lanes in large batches
            assert option.error == many[name].error > 0.0
    assert set(few) ^ set(many) == {"untraced float64 extended", "lanes float64 extended"}


def test_a_plot_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    found = sd.trade(MODELS["two_link"](), "mass_matrix", states=4)
    wrong = {"none/t.png": "plot cannot be written to", "t.nope": "a name that ends in one of"}
    for name, what in wrong.items():
        with pytest.raises(sd.SpatialDynError, match=what):
            found.plot(tmp_path / name)


@compiled
@pytest.mark.slow(quick="test_what_is_recommended_meets_its_tolerance_on_fresh_states")
@pytest.mark.parametrize("tolerance", [1e-2, 1e-5, 1e-9])
def test_a_motion_that_is_recommended_meets_its_tolerance_from_fresh_states(tolerance: float) -> None:
    model = sd.load_urdf("two_link")
    found = motions_of_two_links()
    q0, v0 = integrator_errors.random_motion_states(model, 6, seed=1)
    t = np.linspace(0.0, DURATION, integrator_errors.SAMPLES + 1)
    truth = exact_motion(model, q0, v0, t)
    chosen = advice(found, tolerance)
    for k in range(len(q0)):
        run = chosen(q0[k], v0[k], DURATION)
        every = (len(run) - 1) // integrator_errors.SAMPLES
        last = [run.q[::every][1:], run.v[::every][1:]]
        assert abs(last[0] - truth.q[1:, k]).max() <= tolerance * max(abs(truth.q[:, k] - q0[k]).max(), 1e-300)
        assert abs(last[1] - truth.v[1:, k]).max() <= tolerance * abs(truth.v[:, k]).max()


@compiled
def test_a_tolerance_that_nothing_meets_is_refused_with_the_best_there_is() -> None:
    with pytest.raises(sd.SpatialDynError, match=r"tolerance is 1e-30 .* expected at least .* the bound of "):
        sd.recommend(sd.load_urdf("two_link"), "mass_matrix", 1e-30)


@compiled
def test_why_says_the_error_the_margin_and_what_was_passed_over() -> None:
    chosen = sd.recommend(chain((1.0,) * 3 + (1e6,), 5), tolerance=1e-12)
    assert figure_of(chosen.option.error) in chosen.why
    assert "within 1e-12" in chosen.why
    assert "cheaper is" in chosen.why
    assert chosen.code in str(chosen)
    assert chosen.option.error < chosen.option.bound <= 1e-12


@cache
def motions_of_two_links() -> Tradeoff:
    """Its trade, made once."""
    return sd.trade(sd.load_urdf("two_link"), "simulate", methods=METHODS, duration=DURATION)


def figure_of(x: float) -> str:
    return f"{x:.1e}"


def open_question(worst: float, asked: list[float]) -> Tradeoff:
    """An option with error below and bound above 1e-6, and one ten times dearer with a bound below."""
    options = [Option("quick", "", 7e-7, 1e-7, 2e-6, 10.0), Option("sound", "", 1e-9, 1e-9, 2e-9, 100.0)]

    def further(open_: Any, tolerance: float) -> dict[str, Any]:
        asked.append(tolerance)
        assert [x.name for x in open_] == ["quick"]
        return {"quick": np.full(references.MANY, worst)} if worst <= tolerance else {}

    return Tradeoff("m", "mass_matrix", mark_pareto(options), 4096, 4096, 0.0, 0.0, "", further)


def test_a_cheaper_option_is_taken_if_more_states_say_so_and_no_other() -> None:
    asked: list[float] = []
    taken = advice(open_question(7.5e-7, asked), 1e-6)
    assert taken.option.name == "quick"
    assert taken.option.error == 7.5e-7
    assert taken.option.bound == pytest.approx(1.25 * 7.5e-7, rel=1e-6, abs=0.0)
    assert f"{references.MANY} states" in taken.why
    for worst in (9e-7, 2e-6):  # within the tolerance by too little, and beyond it
        assert advice(open_question(worst, asked), 1e-6).option.name == "sound"
    assert asked == [1e-6] * 3
    for tolerance in (1e-7, 1e-5):  # the quick one is seen to fail, or to do
        advice(open_question(7.5e-7, asked), tolerance)
    assert len(asked) == 3


def test_the_error_of_an_option_in_more_states_is_no_less_than_in_those_before() -> None:
    taken = advice(open_question(5e-7, []), 1e-6).option
    assert (taken.error, taken.bound) == (7e-7, pytest.approx(1.25 * 7e-7))


@pytest.mark.parametrize(("ns", "asked"), [(89.0, True), (92.0, False)])
def test_only_an_option_that_is_a_tenth_faster_is_worth_more_states(ns: float, asked: bool) -> None:
    """Of one that costs 100: 100 / 1.1 is 90.9."""
    options = [Option("quick", "", 7e-7, 1e-7, 2e-6, ns), Option("sound", "", 1e-9, 1e-9, 2e-9, 100.0)]
    tried: list[Any] = []

    def further(open_: Any, tolerance: float) -> dict[str, Any]:
        tried.extend(open_)
        return {}

    found = Tradeoff("m", "mass_matrix", mark_pareto(options), 4096, 4096, 0.0, 0.0, "", further)
    assert advice(found, 1e-6).option.name == "sound"
    assert bool(tried) == asked


@pytest.mark.parametrize("tolerance", [2e-9, 1.99e-9])
def test_a_bound_that_is_the_tolerance_is_within_it(tolerance: float) -> None:
    found = Tradeoff(
        "m", "mass_matrix", mark_pareto([Option("x", "", 1e-9, 1e-9, 2e-9, 1.0)]), 4, 4, 0.0, 0.0, "", None
    )
    if tolerance < 2e-9:
        with pytest.raises(sd.SpatialDynError, match=r"expected at least 2.0e-09, the bound of x"):
            advice(found, tolerance)
    else:
        assert advice(found, tolerance).option.name == "x"


@pytest.mark.parametrize(("count", "margin"), [(references.MANY - 1, 2.0), (references.MANY, 1.25)])
def test_more_states_have_the_narrow_margin_from_65536_on(count: int, margin: float) -> None:
    options = [Option("quick", "", 7e-7, 1e-7, 2e-6, 10.0), Option("sound", "", 1e-9, 1e-9, 2e-9, 100.0)]
    for tolerance, name in ((0.99 * margin * 7e-7, "sound"), (1.01 * margin * 7e-7, "quick")):
        found = Tradeoff(
            "m",
            "mass_matrix",
            mark_pareto(options),
            4096,
            4096,
            0.0,
            0.0,
            "",
            lambda *x: {"quick": np.full(count, 7e-7)},
        )
        assert advice(found, tolerance).option.name == name


def test_what_judges_others_is_a_hundred_times_finer() -> None:
    names = (("judged", 1e-6, 2e-6, 1.0), ("dear", 1e-10, 1e-10, 9.0), ("fine", 0.9e-8, 0.9e-8, 5.0))
    options = [Option(n, "", error, 0.0, bound, ns) for n, error, bound, ns in names]
    open_ = options[:1]
    finer = integrator_errors._finer(options, open_, 1e-5)
    assert finer is not None
    assert finer.name == "fine"  # cheapest whose bound is below 1e-2 of the error
    beyond = [options[0], options[1], Option("near", "", 1.1e-8, 0.0, 1.1e-8, 5.0)]
    finer = integrator_errors._finer(beyond, open_, 1e-5)
    assert finer is not None
    assert finer.name == "dear"
    assert (
        integrator_errors._finer([options[0], beyond[2]], open_, 1.0e-6) is None
    )  # 1.1e-8 is above 1e-2 of the tolerance
    assert integrator_errors._finer([options[0], beyond[2]], open_, 1.2e-6) is beyond[2]


@compiled
def test_more_states_are_other_states_and_end_where_an_option_fails() -> None:
    model = MODELS["two_link"]()
    found = sd.trade(model, "mass_matrix", states=64)
    assert found.further is not None
    lanes = [x for x in found.options if x.name.startswith("lanes float")]
    errors = found.further(lanes, 1e-12)
    assert [*errors] == ["lanes float64 crba"]
    assert len(errors["lanes float64 crba"]) == references.MANY
    first = call_errors.random_call_states(model, "mass_matrix", 4096, [0, 1])
    assert not np.isin(first[0], call_errors.random_call_states(model, "mass_matrix", 4096, 0)[0]).any()
    assert found.further(lanes, 1e-17) == {}
    arrays = tuple(call_errors.random_call_states(model, "mass_matrix", 4, 0))
    assert sd.trade(model, "mass_matrix", states=arrays).further is None


@pytest.mark.slow(quick="test_an_option_to_simulate_is_taken_after_more_motions_unless_there_are_none")
@compiled
def test_more_motions_are_held_against_a_finer_one() -> None:
    found = motions_of_two_links()
    assert found.further is not None
    coarse = max((x for x in found.options if x.name.startswith("rk4")), key=lambda x: x.median)
    errors = found.further([coarse], 10.0 * coarse.bound)
    assert len(errors[coarse.name]) == integrator_errors.MORE
    assert 0.1 * coarse.median < np.median(errors[coarse.name]) < 10.0 * coarse.median
    assert found.further([coarse], 0.1 * coarse.median) == {}
    assert found.further([coarse], 1e-30) is None  # nothing is a hundred times finer
    finest, second = sorted(found.options, key=lambda x: x.bound)[:2]
    errors = found.further([finest], 101.0 * second.bound)
    assert len(set(errors[finest.name])) > 1  # against itself all were the same


def test_an_option_to_simulate_is_taken_after_more_motions_unless_there_are_none() -> None:
    options = mark_pareto([Option(n, "", e, e, 4 * e, ns) for n, e, ns in (("quick", 1e-7, 1.0), ("slow", 1e-9, 9.0))])

    def table(further: Any) -> Tradeoff:
        return Tradeoff("m", "simulate", options, 4, 0, 1.0, 0.0, "", further)

    worse = advice(table(lambda open_, _: {"slow": np.full(32, 1e-9)} if open_[0].name == "slow" else {}), 1e-6)
    assert worse.option.name == "slow"
    assert "quick" in worse.why
    assert "more states do not confirm" in worse.why
    assert advice(table(lambda open_, _: {"quick": np.full(32, 4e-7)}), 1e-6).option.bound == pytest.approx(
        8e-7, rel=1e-6, abs=0.0
    )
    for further in (None, lambda open_, _: None):
        assert advice(table(further), 1e-6).option.name == "quick"


# --- the code of options --------------------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize("batch", slow_but([600], [8, 600]))
def test_code_is_the_option_that_was_measured(batch: int) -> None:
    model = MODELS["other tree"]()
    for task in call_errors.TASK_CALLS:
        states = call_errors.random_call_states(model, task, batch, 7)
        for x in sd.trade(model, task, states=4, batch=batch).options:
            assert x.run is not None
            inputs = dict(zip(INPUTS[task], states, strict=True))
            written = eval(x.code, {"sd": sd, "np": np, "model": model, **inputs})
            assert np.array_equal(written, x.run(*states)), x.name


@pytest.mark.slow(quick="test_code_is_the_option_that_was_measured")
@compiled
def test_code_of_a_motion_is_the_very_step() -> None:
    model = sd.load_urdf("two_link")
    q0, v0, duration = np.array([0.3, 0.4]), np.zeros(2), 1.0 / 3.0
    for x in sd.trade(model, "simulate", states=1, methods=("rk4", "dop853"), duration=duration).options:
        assert x.run is not None
        written = eval(x.code, {"sd": sd, "model": model, "q0": q0, "v0": v0, "duration": duration})
        assert np.array_equal(written.q, x.run(q0, v0, duration).q), x.name


@compiled
def test_every_option_takes_what_its_call_takes() -> None:
    model = MODELS["two_link"]()
    found = sd.trade(model, states=4)
    tau = np.zeros((3, 1, 2))
    for x in found.options:
        chosen = sd.Recommendation(x, "", 1.0, found)
        assert np.shape(chosen([0.1, 0.2], (0.0, 0.0), np.zeros(2))) == (2,)
        assert chosen(np.zeros((400, 2)), [0.0, 0.0], tau).shape == (3, 400, 2)
        for wrong in ((), (tau,), (tau,) * 4):
            with pytest.raises(sd.ShapeError, match=r"inputs were given, expected 3: q, v, tau"):
                chosen(*wrong)
        with pytest.raises(sd.SpatialDynError):
            chosen(tau, "x", tau)


# --- measurements -----------------------------------------------------------------------------------------


def test_a_cost_is_of_the_fastest_round_per_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock on which two in three calls are held up."""
    now, calls_made = [0.0], Counter[str]()

    def run(name: str, seconds: float) -> None:
        calls_made[name] += 1
        now[0] += seconds * (1.0 if calls_made[name] % 3 == 0 else 5.0)

    monkeypatch.setattr(call_errors, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    measured = costs({name: partial(run, name, seconds) for name, seconds in (("fast", 1e-3), ("slow", 4e-3))}, 10)
    assert measured == pytest.approx({"fast": 1e5, "slow": 4e5}, rel=1e-9)


def test_a_slow_run_is_timed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the run that compiles: a call that factors M of 300 freedoms takes seconds."""
    now, calls_made = [0.0], Counter[str]()

    def run(name: str, seconds: float) -> None:
        calls_made[name] += 1
        now[0] += seconds

    monkeypatch.setattr(call_errors, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    limit = call_errors.SLOW
    measured = costs({name: partial(run, name, x * limit) for name, x in (("below", 0.9), ("above", 1.1))}, 10)
    assert measured == pytest.approx({"below": 9e7 * limit, "above": 1.1e8 * limit}, rel=1e-9)
    assert calls_made == {"below": 2 + (2 if numba_kernels.PLAIN else 3), "above": 2}


def test_large_robots_are_measured_in_fewer_states() -> None:
    """Their mass matrices would take gigabytes; arms and humanoids keep all states."""
    long = chain((1.0,) * 300, 1)
    for task in call_errors.TASK_CALLS:
        alone = task == "inverse_dynamics"
        assert call_errors.usual_count(long, task, 4096) == (4096 if alone else 186)
        assert call_errors.usual_count(chain((1.0,) * 64, 1), task, 4096) == 4096
    assert len(call_errors.call_states(long, "mass_matrix", 200)[0]) == 200
    assert len(call_errors.call_states(long, "mass_matrix", None)[0]) == min(call_errors.STATES, 186)


@compiled
def test_every_option_for_forward_dynamics_is_listed_and_float32_is_worse() -> None:
    """Those that ``trade`` takes by itself: of aba_square_root the kernel compiles for 20 s."""
    found = sd.trade(chain((1.0,) * 4, 3))
    by_name = {x.name: x for x in found.options}
    calls_ = ("aba", "crba_solve", "aba_refined")
    wanted = {f"lanes {dtype} {call}" for dtype in ("float32", "float64") for call in calls_}
    assert set(by_name) == wanted | {"lanes float64 extended"}
    for call in calls_:
        assert 1e3 * by_name[f"lanes float64 {call}"].error < by_name[f"lanes float32 {call}"].error
    assert all(x.median <= x.error <= x.bound for x in found.options)


@pytest.mark.slow(quick="test_what_is_recommended_meets_its_tolerance_on_fresh_states")
@compiled
def test_a_heavy_tip_costs_aba_its_digits_and_refined_none() -> None:
    found = {x.name: x.error for x in sd.trade(chain((1.0,) * 6 + (1e6,), 3), methods=ALL).options}
    assert found["lanes float64 aba"] > 1e3 * found["lanes float64 aba_refined"]
    assert found["lanes float64 crba_solve"] > 1e3 * found["untraced float64 aba_square_root"]


def oblique_chain(tip: float) -> sd.Model:
    """Links about parallel axes that lie along no axis of a frame, which are parallel to rounding only."""
    rng, builder = np.random.default_rng(0), sd.ModelBuilder("oblique")
    axis = rng.normal(size=3)
    for k in range(5):
        whole, com, I = random_inertia(rng)
        mass = tip if k == 4 else 1.0
        body = (mass, com, mass / whole * I)
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, rng.uniform(-0.5, 0.5, 3), body)
    return builder.build()


def test_calls_of_a_task_may_be_chosen() -> None:
    found = sd.trade(sd.load_urdf("two_link"), states=8, batch=8, methods=("crba_solve", "extended"))
    assert {x.name.split()[-1] for x in found.options} == {"crba_solve", "extended"}
    left_out = set(ALL) - set(call_errors.calls_of(sd.load_urdf("two_link"), "forward_dynamics"))
    assert left_out == set(call_errors.WHEN_NAMED) == {"aba_square_root"}
    assert call_errors.calls_of(sd.load_urdf("two_link"), "forward_dynamics", ALL) == [*ALL]


@compiled
@pytest.mark.parametrize(("batch", "engine"), slow_but([(600, "lanes")], [(600, "lanes"), (1, "untraced")]))
def test_extended_is_recommended_where_refined_is_not_enough(batch: int, engine: str) -> None:
    """Torques of the size of 1 move a heavy tip next to nothing: what refined rounds is more than that."""
    model = oblique_chain(1e6)
    q, v, tau = call_errors.random_call_states(model, "forward_dynamics", 600, 3)
    tau /= abs(tau).max()
    found = sd.trade(model, states=(q, v, tau), batch=batch)
    by_name = {x.name: x for x in found.options}
    assert by_name["lanes float64 aba_refined"].error > 1e-12
    chosen = advice(found, 1e-13)
    assert chosen.option.name == f"{engine} float64 extended"
    assert chosen.code == 'sd.forward_dynamics(model, q, v, tau, method="extended")'
    truth = sd.exact(model, sd.aba)(q[0], v[0], tau[0]).astype(float)
    assert references.of_calls("aba", chosen(q[0], v[0], tau[0])[None], truth[None]).max() <= 1e-13


@compiled
def test_what_rounds_the_truth_is_off_by_rounding() -> None:
    """Held against the truth, rounded, it would have no error at all, and meet any tolerance."""
    found = sd.trade(MODELS["two_link"](), states=64, batch=4)
    (extended,) = (x for x in found.options if x.name.endswith("extended"))
    assert extended.error == 2.0**-53
    assert extended.bound == 2.0**-52
    with pytest.raises(sd.SpatialDynError, match=r"expected at least 2\.2e-16, the bound of untraced float64 extended"):
        advice(found, 1e-16)
    assert found.further is not None
    assert found.further([extended], 1e-9)[extended.name].min() == 2.0**-53


@compiled
def test_a_call_that_is_wrong_by_a_part_in_1e9_is_seen() -> None:
    model = sd.load_urdf("two_link")
    states = call_errors.random_call_states(model, "mass_matrix", 5, 0)
    truth, certainty = references.truths(model, "crba", states)
    assert certainty <= CERTAIN
    wrong = truth * (1.0 + 1e-9)
    assert 0.5e-9 < references.of_calls("crba", wrong, truth).max() < 2e-9


def test_errors_of_m_are_scaled_by_its_diagonal_and_others_by_the_largest_entry() -> None:
    M = np.array([[[4.0, 1.0], [1.0, 9.0]]])
    assert references.of_calls("crba", M + np.array([[0.0, 0.6], [0.0, 0.0]]), M).tolist() == pytest.approx([0.1])
    a = np.array([[1.0, -10.0], [0.0, 0.0]])
    assert references.of_calls("aba", a + np.array([[1.0, 0.0], [0.0, 0.0]]), a).tolist() == [0.1, 0.0]
    assert references.of_calls("aba", np.full((2, 2), np.nan), a).tolist() == [math.inf, math.inf]


def test_each_joint_is_measured_by_its_own_scale() -> None:
    """Its own entry, or the median of its sizes where that is larger; of a motion its own largest change."""
    a = np.array([[1.0, -10.0], [3.0, 20.0], [0.5, 30.0]])
    off = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.6]])
    assert references.of_calls("aba", a + off, a, "each").tolist() == pytest.approx([0.0, 0.1, 0.3])
    M = np.array([[[4.0, 1.0], [1.0, 9.0]]])
    assert references.of_calls("crba", M + 0.6, M, "each").tolist() == references.of_calls("crba", M + 0.6, M).tolist()
    over = integrator_errors._over
    assert over(np.array([0.1, 0.1]), np.array([0.5, 10.0]), "largest") == pytest.approx(0.01)
    assert over(np.array([0.1, 0.1]), np.array([0.5, 10.0]), "each") == pytest.approx(0.1)  # a tenth of the largest
    assert over(np.array([0.1, 0.1]), np.array([2.0, 10.0]), "each") == pytest.approx(0.05)


@compiled
def test_what_is_recommended_for_each_joint_holds_for_each() -> None:
    """Light bodies among heavy ones accelerate most, and hide what the others lose."""
    model = MODELS["alternating"]()
    found = sd.trade(model, states=512, batch=64)
    by = {x.name: x for x in found.options}
    assert by["lanes float32 crba_solve"].each > 1.5 * by["lanes float32 crba_solve"].error
    for x in found.options:
        assert x.each <= x.each_bound
        assert figure_of(x.each) in str(found)
    fresh = call_errors.random_call_states(model, "forward_dynamics", FRESH, seed=1)
    truth, _ = references.truths(model, "aba", fresh)
    for tolerance in (1e-3, 1e-9):
        chosen = advice(found, tolerance, "each")
        assert references.of_calls("aba", np.asarray(chosen(*fresh)), truth, "each").max() <= tolerance
        assert chosen.option.error == by[chosen.option.name].each or chosen.option.states
    with pytest.raises(sd.SpatialDynError, match="norm is 'all', expected one of largest, each"):
        sd.recommend(model, norm="all")


def test_the_margin_is_2_at_least_and_grows_with_the_tail() -> None:
    even = np.full(1000, 1e-15)
    assert references.error_bound(even) == 2e-15
    tailed = np.append(even, 1e-11)
    assert references.error_bound(tailed) == pytest.approx(1e-9, rel=1e-6, abs=0.0)
    assert references.error_bound(np.array([1e-15, 1e-15])) == pytest.approx(4e-15, rel=1e-6, abs=0.0)
    assert references.error_bound(np.array([math.inf, 1.0])) == math.inf
    assert references.error_bound(np.zeros(4)) == 0.0


def test_few_errors_have_a_margin_of_four_and_of_how_they_scatter() -> None:
    """The root of the worst over the median, which of fewer than 32 is all that is known."""
    few = np.full(references.FEW - 1, 1e-15)
    assert references.error_bound(few) == pytest.approx(4e-15, rel=1e-6, abs=0.0)
    assert references.error_bound(np.append(few, 1e-15)) == pytest.approx(2e-15, rel=1e-6, abs=0.0)
    for worst, margin in ((9e-15, 4.0), (15.9e-15, 4.0), (25e-15, 5.0), (1e-11, 100.0)):
        few[-1] = worst
        assert references.error_bound(few) == pytest.approx(margin * worst, rel=1e-6, abs=0.0)
        assert references.error_bound(few[-2:]) == pytest.approx(
            max(4.0, math.sqrt(worst / few[-2:].mean())) * worst, rel=1e-6, abs=0.0
        )
    exact = np.zeros(references.FEW - 1)
    exact[-1] = 1e-15
    assert references.error_bound(exact) == pytest.approx(4e-15, rel=1e-6, abs=0.0)
    assert references.error_bound(few[-1:]) == pytest.approx(4e-11, rel=1e-6, abs=0.0)


def test_the_tail_of_more_errors_starts_at_the_worst_twentieth() -> None:
    errors = np.full(1000, 1e-15)
    errors[0] = 1e-11
    for count, tail in ((45, 1e-15), (55, 1e-13)):
        errors[1 : 1 + count] = 1e-13
        assert references.error_bound(errors) == pytest.approx(math.sqrt(1e-11 / tail) * 1e-11, rel=1e-6, abs=0.0)
    assert references.error_bound(np.append(np.ones(999), 3.9)) == pytest.approx(2.0 * 3.9, rel=1e-6, abs=0.0)
    assert references.error_bound(np.append(np.ones(999), 9.0)) == pytest.approx(3.0 * 9.0, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(("size", "measured_by"), [(0.11, 0.11), (0.09, 0.1)])
def test_a_sample_next_to_nothing_is_measured_by_a_tenth_of_the_median(size: float, measured_by: float) -> None:
    truth = np.array([[1.0], [1.0], [1.0], [size]])
    found = truth + np.array([[0.0], [0.0], [0.0], [1e-6]])
    assert references.of_calls("aba", found, truth)[3] == pytest.approx(1e-6 / measured_by, rel=1e-6, abs=0.0)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_samples_of_the_truth_that_are_checked(samples: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two, or as many as there are."""
    seen = []

    def counted(model: sd.Model, call: Any, bits: int) -> Any:
        return lambda *arrays: seen.append(arrays) or sd.exact(model, call, bits)(*arrays)

    monkeypatch.setattr(references, "exact", counted)
    model = sd.load_urdf("two_link")
    references.truths(model, "crba", call_errors.random_call_states(model, "mass_matrix", samples, 0))
    assert len(seen) == min(samples, references.CHECKED) == min(samples, 2)


def test_of_many_errors_the_margin_is_narrower() -> None:
    even = np.full(references.MANY, 1e-15)
    assert references.error_bound(even) == pytest.approx(1.25e-15, rel=1e-6, abs=0.0)
    assert references.error_bound(even[1:]) == 2e-15
    steep = np.arange(1.0, references.MANY + 1.0) ** -0.5  # a power law: four times as many bring twice the largest
    assert references.error_bound(steep) == pytest.approx(2.0, rel=0.05)


def test_the_front_is_what_nothing_cheaper_is_better_than() -> None:
    costs = ((3.0, 1e-9), (1.0, 1e-3), (2.0, 1e-2), (4.0, 1e-9), (5.0, 1e-12))
    made = mark_pareto([Option(f"{ns}", "", error, error, error, ns) for ns, error in costs])
    assert [x.ns for x in made] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert [x.ns for x in made if x.best] == [1.0, 3.0, 5.0]


@compiled
def test_states_of_ones_own_are_those_that_are_measured() -> None:
    model = chain((1.0,) * 3 + (1e6,), 5)
    q, v, tau = (x[:3] for x in call_errors.random_call_states(model, "forward_dynamics", 9, 5))
    found = {x.name: x.error for x in sd.trade(model, states=(q, v, tau)).options}
    truth = sd.exact(model, sd.aba)(q, v, tau).astype(float)
    wrong = abs(np.array([sd.aba(model, *s) for s in zip(q, v, tau, strict=True)]) - truth).max(axis=1)
    assert found["lanes float64 aba"] == (wrong / abs(truth).max(axis=1)).max()


@compiled
def test_single_calls_are_measured_too() -> None:
    found = sd.trade(sd.load_urdf("two_link"), "inverse_dynamics", states=4, batch=1)
    assert found.unit == "ns a call"
    assert {x.name for x in found.options} == {"lanes float32 rnea", "lanes float64 rnea"}


def test_without_programs_there_is_the_untraced_option() -> None:
    found = sd.trade(sd.load_urdf("two_link"), "inverse_dynamics", states=2, batch=2)
    assert ("untraced float64 rnea" in {x.name for x in found.options}) == numba_kernels.PLAIN
    assert all(x.error < 1e-6 for x in found.options)


@pytest.mark.slow(quick="simulation/test_integrators.py::test_order_of_convergence")
@compiled
def test_halving_the_step_of_rk4_shows_its_order() -> None:
    found = sd.trade(sd.load_urdf("two_link"), "simulate", methods="rk4", duration=0.5, states=2)
    coarse, fine = sorted(found.options, key=lambda x: float(x.name.split()[-1]))[:-3:-1]  # by their steps
    ratio = math.log2(coarse.error / fine.error) / math.log2(integrator_errors.FACTOR)
    assert 3.0 < ratio < 5.0
    assert found.certainty <= 1e-13


# --- output -------------------------------------------------------------------------------------------------


@compiled
def test_it_is_text_json_and_a_plot(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    found = sd.trade(sd.load_urdf("two_link"), "mass_matrix", states=32)
    assert found.subject == sd.load_urdf("two_link")
    read = json.loads(found.to_json())
    assert not {"subject", "further"} & set(read)
    assert read["options"][0]["name"] == found.options[0].name
    assert read["unit"] == "ns a sample"
    for x in found.options:
        assert x.name in str(found)
    found.plot(tmp_path / "trade.png")
    assert (tmp_path / "trade.png").stat().st_size > 1000


@compiled
def test_the_command_line_recommends_plots_and_prints_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    path = str(tmp_path / "trade.png")
    words = ["trade", "two_link", "--task", "mass_matrix", "--states", "32", "--tolerance", "1e-12"]
    assert cli.main([*words, "--plot", path]) == 0
    shown = capsys.readouterr().out
    assert "take    sd.crba(model, q)" in shown
    assert path in shown
    assert Path(path).exists()
    assert cli.main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recommended"]["name"] == "lanes float64 crba"
    assert cli.main([*words[:-1], "1e-40"]) == 2
    assert "expected at least" in capsys.readouterr().err


# --- errors ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"task": "dance"}, "task is 'dance', expected one of forward_dynamics"),
        ({"batch": 0}, "batch is 0"),
        ({"states": 0}, "states is 0"),
        ({"states": ([0.0, 0.0],)}, "states has 1 arrays, expected 3: q, v, tau"),
        ({"states": ([0.0, 0.0], [0.0, 0.0], [0.0])}, r"tau has shape \(1,\), expected \(n, 2\)"),
        ({"states": ([[0.0, 0.0]] * 2, [0.0, 0.0], [0.0, 0.0])}, "states has 2, 1, 1 samples"),
        ({"states": ([0.0, 0.0], [0.0, math.nan], [0.0, 0.0])}, "states holds numbers that are not finite"),
        ({"task": "simulate", "duration": 0.0}, "duration is 0.0"),
        ({"task": "simulate", "methods": "leap"}, "methods has 'leap', expected some of explicit_euler"),
        ({"methods": "rk4"}, "methods has 'rk4', expected some of aba, crba_solve"),
        ({"task": "simulate", "states": 0}, "states is 0"),
        ({"task": "simulate", "states": 1.5}, "states is no pair of arrays"),
        ({"task": "simulate", "states": ([0.0], [0.0])}, "states has shapes"),
        ({"task": "simulate", "states": ([0.0, math.inf], [0.0, 0.0])}, "states holds numbers that are not finite"),
    ],
)
def test_what_makes_no_sense_is_refused(words: dict[str, Any], message: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=message):
        sd.trade(sd.load_urdf("two_link"), **words)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan, True, "1e-6"])
def test_a_tolerance_that_is_none_is_refused(tolerance: Any) -> None:
    with pytest.raises(sd.SpatialDynError, match="tolerance is "):
        sd.recommend(sd.load_urdf("two_link"), tolerance=tolerance)


def test_models_that_cannot_be_traded_are_refused() -> None:
    with pytest.raises(sd.ModelError, match="no joint that moves"):
        sd.trade(sd.ModelBuilder("stone").build())


def test_every_task_is_a_call_or_simulations() -> None:
    assert set(TASKS) == {*call_errors.TASK_CALLS, "simulate"}
    assert {name for group in call_errors.TASK_CALLS.values() for name in group} <= {*calls, "extended"}


@pytest.mark.parametrize("task", slow_but(["forward_dynamics"], ["forward_dynamics", "simulate"]))
def test_a_tradeoff_is_pickled_with_the_functions_of_its_options(task: str) -> None:
    model = sd.load_urdf("pendulum")
    words = {"duration": 0.05} if task == "simulate" else {"batch": 64}
    found = sd.trade(model, task, states=2, **words)
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    given = [np.ones(1), np.ones(1), 0.05] if task == "simulate" else 3 * [np.ones((2, 1))]
    one, two = (x.options[0].run(*given) for x in (found, again))
    np.testing.assert_array_equal(getattr(one, "q", one), getattr(two, "q", two))
