"""The numbers of the examples of programs: bounds, bridges to other frameworks, many rollouts at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import scenes
from example_runs import compiled, robots, run

import spatialdyn as sd
from spatialdyn.engines import threads
from spatialdyn.examples import gallery


@compiled
def test_error_bars_are_above_all_errors_and_a_tolerance_is_met() -> None:
    found = run("error_bar_of_a_torque")
    for name, ratio in (("float64", 1e2), ("float32", 1e2)):
        error, bound = found[name]
        assert (error <= bound).all()
        assert np.median(bound[error > 0.0] / error[error > 0.0]) < ratio
    assert found["float32"][0].max() > 1e6 * found["float64"][0].max()
    for tolerance in ("0.0001", "5e-06", "1e-09", "1e-15"):
        ways, worst = found[tolerance]
        assert sum(ways.values()) == len(found["float64"][0])
        assert worst <= float(tolerance)
    assert found["1e-15"][0]["double-double"] > found["1e-09"][0]["double-double"] == 0
    assert min(found["5e-06"][0]["float32"], found["5e-06"][0]["float64"]) > 0


@pytest.fixture
def free_threads() -> Iterator[None]:
    yield
    threads.thread_pool.ask(None)


@robots
@compiled
def test_mppi_reaches_and_has_the_same_bits_on_any_number_of_threads(free_threads: None) -> None:
    found = run("mppi_on_lanes")
    assert found["distance"][-1] < 0.05 < 0.5 < found["distance"][0]
    module = gallery.module("mppi_on_lanes")
    model = sd.load_urdf("panda").reduced(["panda_finger_joint1", "panda_finger_joint2"])
    plans = []
    for count in (1, 2):
        sd.set_num_threads(count)
        rng = np.random.default_rng(3)
        plans.append(module.better(model, np.zeros((8, 7)), module.START, np.zeros(7), rng)[0])
    np.testing.assert_array_equal(*plans)
    # the cost on lanes is what a loop over steps sums up, in the step's own rule: of the speed before the step
    knots, gain = 0.3 * np.random.default_rng(4).normal(size=(8, 7)), np.full(7, 0.05)
    words = {
        "dt": module.DT, "steps": module.STEPS, "friction": False,
        "control": sd.Control(module.LAW, {"knots": knots, "share": module.SHARE, "gain": gain}),
        "cost": sd.Cost(module.COST, {"goal": module.GOAL, "row": model.nv}),
    }  # fmt: skip
    whole = scenes.rollout(model, module.START, np.zeros(7), **words)
    q, v, total = module.START, np.zeros(7), 0.0
    for k in range(module.STEPS):
        tau = gain * (module.SHARE[k] @ knots - v)
        off = sd.forward_kinematics(model, q)[-1, :3, 3] - module.GOAL
        total += 100.0 * off @ off + 0.1 * v @ v + 1e-3 * tau @ tau
        q, v = sd.step(model, q, v, tau, module.DT)
    np.testing.assert_allclose(whole.q, q, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(whole.cost, total, rtol=1e-9)


@compiled
def test_both_frameworks_find_the_design_with_the_gradient_of_differences() -> None:
    pytest.importorskip("jax")
    pytest.importorskip("torch")
    found = run("gradient_of_a_design")
    jax, torch = found["jax"], found["torch"]
    np.testing.assert_allclose(jax["gradient"], torch["gradient"], rtol=1e-12)
    np.testing.assert_allclose(jax["design"], torch["design"], rtol=1e-10)
    assert jax["losses"][-1] < 0.8 * jax["losses"][0]
    model, rng = gallery.module("gradient_of_a_design").crane(), np.random.default_rng(0)
    state = rng.uniform(-1.0, 1.0, (32, 2)), *rng.normal(size=(2, 32, 2))
    k = sd.specialize(model, sd.rnea, inputs=[f"mass:{model.names[1]}", f"com:{model.names[1]}"])

    def loss(mass: float, place: float) -> float:
        return float((k(*state, mass, [place, 0.0, 0.0])[:, 0] ** 2).mean())

    h = 1e-3  # the loss is quadratic in the mass, and of fourth order in the place
    by = (loss(3.0 + h, 0.4) - loss(3.0 - h, 0.4)) / (2 * h), (loss(3.0, 0.4 + h) - loss(3.0, 0.4 - h)) / (2 * h)
    np.testing.assert_allclose(jax["gradient"], by, rtol=1e-4)
    assert loss(3.0, 0.4) == pytest.approx(jax["losses"][0], rel=1e-12)


@compiled
def test_the_energy_of_a_learned_friction_only_falls() -> None:
    """Of the structure, after few steps of training too."""
    pytest.importorskip("torch")
    found = run("friction_network")
    assert np.diff(found["lagrangian"]).max() < 1e-3 < np.diff(found["plain"]).max()
    assert found["robot"][0] == found["lagrangian"][0] == found["plain"][0]


def test_casadi_swings_up_what_the_library_then_swings_up() -> None:
    pytest.importorskip("casadi")
    found = run("casadi_export")
    q, v = found["last"]
    np.testing.assert_allclose([*q, *v], [np.pi / 2, 0.0, 0.0, 0.0], rtol=0.0, atol=1e-8)
    assert found["own"] < found["theirs"]
    assert 10.0 < found["effort"] == pytest.approx(0.05 * (found["torque"] ** 2).sum())
