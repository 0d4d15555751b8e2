"""Control laws, work, friction, springs and forces in methods that move momenta: to their order, in the ledger too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scenes
from combinations import LAW, PARTS, case, options, robot, start

import spatialdyn as sd

ORDER = {"symplectic_euler": 1, "stormer_verlet": 2, "implicit_midpoint": 2, "gauss4": 2, "gauss6": 2, "variational": 2}
STEP, SPAN = 4e-3, 0.12


def end(model: sd.Model, given: dict[str, Any], dt: float, method: str) -> sd.Trajectory:
    """A run from the start."""
    return scenes.simulate(model, *start(model), SPAN, dt, method=method, friction=False, **given)


@pytest.mark.parametrize("method", ORDER)
def test_a_law_with_states_acts_to_second_order(method: str) -> None:
    """Gauss's methods too, as its states move beside theirs."""
    model, given = case("arm", ("control",))
    wanted = end(model, given, 2e-4, "rk4")
    off = []
    for dt in (STEP, STEP / 2):
        run = end(model, given, dt, method)
        off.append([abs(run.q[-1] - wanted.q[-1]).max(), abs(run.states["past"][-1] - wanted.states["past"][-1]).max()])
    order = np.log2(np.divide(*off))
    assert (order > ORDER[method] - 0.25).all(), order
    assert max(off[1]) < (2e-3 if ORDER[method] == 1 else 2e-5)


def test_a_held_law_acts_by_the_torque_at_the_beginning_of_a_step() -> None:
    model, given = case("arm", ("held law",))
    run = end(model, given, STEP, "gauss6")
    wanted = scenes.simulate(model, *start(model), SPAN, STEP, "gauss6", torque=run.tau[:-1], friction=False)
    np.testing.assert_allclose(run.q, wanted.q, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("effect", ["control", "smooth", "fext", "springs"])
@pytest.mark.parametrize("method", ORDER)
def test_the_ledger_closes_to_the_order_of_the_work(method: str, effect: str) -> None:
    model = robot("arm", effect == "springs")
    given = {**options(model, effect), **options(model, "work")}
    if effect != "smooth":
        given["friction"] = False
    off = []
    for dt in (STEP, STEP / 2):
        run = scenes.simulate(model, *start(model), SPAN, dt, method=method, **given)
        off.append(abs(sd.energy_ledger(run).error).max())
    assert off[1] < (0.3 if ORDER[method] == 1 else 0.01) * abs(run.energy - run.energy[0]).max()
    if off[1] > 1e-12:
        assert np.log2(off[0] / off[1]) > ORDER[method] - 0.3


@pytest.mark.parametrize("method", [*ORDER, "dop853", "radau"])
@pytest.mark.parametrize("name", PARTS)
def test_samples_of_a_rollout_are_runs_of_their_own(name: str, method: str) -> None:
    """Coefficients, a law's values and forces that vary with sample and step are those of each."""
    model = robot(name)
    q, v = start(model)
    rng = np.random.default_rng(5)
    steps, B = 4, 3
    reach, push = rng.normal(size=(B, 1, model.nq)), rng.normal(size=(B, steps, model.njoints, 6))
    tau, starts = rng.normal(size=(B, steps, model.nv)), v + 0.1 * rng.normal(size=(B, model.nv))
    scene = sd.Scene(model, **options(model, "smooth"))
    law = sd.Control(LAW, {"reach": reach})
    runs = sd.rollout(scene, q, starts, tau, dt=1e-3, method=method, control=law, fext=push)
    for b in range(B):
        one = sd.Control(LAW, {"reach": reach[b, 0]})
        alone = sd.simulate(
            scene, q, starts[b], steps * 1e-3, 1e-3, method, torque=tau[b], control=one, fext=push[b]
        )  # fmt: skip
        np.testing.assert_array_equal(runs.q[b], alone.q[1:])
        np.testing.assert_array_equal(runs.v[b], alone.v[1:])
        np.testing.assert_array_equal(runs.states["past"][b], alone.states["past"][1:])


@pytest.mark.parametrize("method", ["semi_implicit_euler", "rk4", "stormer_verlet", "variational", "dop853"])
def test_forces_of_a_function_are_those_of_steps_where_they_are_constant(method: str) -> None:
    model = robot("floating")
    push = options(model, "fext")["fext"]
    scene, args = sd.Scene(model, friction=False), (*start(model), 0.02, 1e-3, method)
    constant = sd.simulate(scene.with_(fext=push), *args)
    varying = sd.simulate(scene, *args, fext=np.tile(push, (20, 1, 1)))
    asked = sd.simulate(scene, *args, fext=lambda t, q, v: push)
    both = sd.simulate(scene.with_(fext=0.25 * push), *args, fext=lambda t, q, v: 0.75 * push)
    for run in (varying, asked, both):
        np.testing.assert_allclose(run.q, constant.q, rtol=0.0, atol=1e-9 if method == "dop853" else 1e-13)


def test_a_force_of_the_velocity_is_a_damper() -> None:
    """A wrench -d v on the sliding mass takes the energy that a torque -d v takes."""
    builder = sd.ModelBuilder("mass").add_body("x", None, "prismatic", (1, 0, 0), inertia=(2.0, (0, 0, 0), np.eye(3)))
    model = builder.build()

    def drag(t: float, q: Any, v: Any) -> Any:
        return np.array([[0.0] * 6] * (model.njoints - 1) + [[-0.7 * v[0], 0, 0, 0, 0, 0]])

    run = sd.simulate(model, [0.0], [1.0], 1.0, 1e-2, fext=drag)
    assert run.v[-1, 0] == pytest.approx(np.exp(-0.35), rel=1e-9)


@pytest.mark.parametrize(
    ("fext", "error", "words"),
    [
        (np.zeros((3, 6)), sd.ShapeError, r"fext has shape \(3, 6\)"),
        (np.full((10, 4, 6), np.nan), sd.NonFiniteError, "fext has numbers that are not finite"),
        (lambda t, q, v: np.zeros(6), sd.ShapeError, r"fext has shape \(6,\) at t = 0 s, expected \(4, 6\)"),
        (lambda t, q, v: np.full((4, 6), np.inf), sd.SimulationError, "fext is .* at t = 0 s, expected finite numbers"),
    ],
)
def test_forces_that_are_none_are_named(fext: Any, error: type[Exception], words: str) -> None:
    model = robot("arm")
    assert model.njoints == 4
    with pytest.raises(error, match=words):
        sd.simulate(sd.Scene(model, friction=False), *start(model), 0.01, 1e-3, "rk4", fext=fext)


# --- side by side ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["implicit_midpoint", "stormer_verlet", "variational"])
def test_samples_side_by_side_have_the_bits_of_runs(method: str) -> None:
    """A sample whose start is not finite stays alone."""
    model, rng = sd.load_urdf("two_link"), np.random.default_rng(3)
    q, v = rng.uniform(-2.0, 2.0, (2, 11, 2))
    tau = rng.normal(size=(11, 6, 2))
    v[4, 0] = np.nan
    run = sd.rollout(model, q, v, tau, dt=0.02, method=method, record=2, check=False)
    assert np.isnan(run.q[4]).all()
    for k in (0, 3, 10):
        alone = sd.simulate(model, q[k], v[k], 0.12, 0.02, method, torque=tau[k], record=2)
        np.testing.assert_array_equal(run.q[k], alone.q[1:])
        np.testing.assert_array_equal(run.v[k], alone.v[1:])


@pytest.mark.parametrize("method", ["implicit_midpoint", "variational"])
def test_a_sample_that_does_not_settle_is_named_with_its_time_and_stays_alone(method: str) -> None:
    model = sd.load_urdf("two_link")
    q, v = np.full((9, 2), 0.3), np.zeros((9, 2))
    v[5] = 300.0, -700.0
    calm = sd.rollout(model, q[:5], v[:5], dt=0.02, steps=3, method=method)
    run = sd.rollout(model, q, v, dt=0.02, steps=3, method=method, check=False)
    assert np.isnan(run.q[5]).all()
    np.testing.assert_array_equal(run.q[:5], calm.q)
    with pytest.raises(sd.SimulationError, match=r"sample 5: .* at t = 0 s"):
        sd.rollout(model, q, v, dt=0.02, steps=3, method=method)
