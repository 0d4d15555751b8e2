"""Whether a law is stable in its steps: of all scenes of smooth effects, over periods, with states of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

SOLID = (1.0, (0.0, 0.0, 0.5), 0.1 * np.eye(3))
CLOSE = 1e-8  # of central differences of linear systems, in steps of 1e-6
KP, KD = 400.0, 28.0  # ω = 20 rad/s, ζ = 0.7


@pytest.fixture(scope="module")
def rod() -> sd.Model:
    """One joint of inertia 0.1 kg m² without gravity."""
    return sd.ModelBuilder("rod").add_body("rod", None, axis=(0, 0, 1), inertia=SOLID).build()


def pd(held: bool | float = False, part: float = 1.0) -> sd.PD:
    return sd.PD([part * 0.1 * KP], [part * 0.1 * KD], [0.0], held=held)


def sampled(period: float, kp: float = KP, kd: float = KD) -> float:
    """The spectral radius of a mass under a torque held for a period, exactly."""
    A = np.array([[1.0, period], [0.0, 1.0]]) - np.outer([0.5 * period * period, period], [kp, kd])
    return float(abs(np.linalg.eigvals(A)).max())


@pytest.mark.parametrize("period", [0.02, 0.066, 0.075])
def test_a_law_held_for_a_period_is_judged_over_the_whole_of_it(period: float, rod: sd.Model) -> None:
    """rk4 is exact of a constant torque, so the product of steps is the textbook's map; one step alone is stable."""
    found = sd.closed_step(rod, pd(period), [0.0], [0.0], 1e-3, "rk4")
    assert found.steps == round(1e3 * period)
    assert found.radius == pytest.approx(sampled(period), abs=CLOSE)
    assert sd.closed_step(rod, pd(True), [0.0], [0.0], 1e-3, "rk4").radius < 1.0
    if sampled(period) > 1.0:
        with pytest.raises(sd.SimulationError, match=r"grow by 1.\d+ in 75 steps, most in joint .*shorter period"):
            found.check()
    else:
        found.check()


def test_laws_of_several_periods_are_judged_until_they_meet(rod: sd.Model) -> None:
    two = pd(0.04, 0.5) + pd(0.006, 0.5)
    assert sd.closed_step(rod, two.limited_by([50.0]) + sd.Gravity(), [0.0], [0.0], 2e-3).steps == 60
    uneven = sd.closed_step(rod, pd(0.025), [0.0], [0.0], 0.01, "rk4")  # which is taken anew after 3 and 2 steps
    assert uneven.steps == 5
    A = [np.array([[1.0, T], [0.0, 1.0]]) - np.outer([0.5 * T * T, T], [KP, KD]) for T in (0.03, 0.02)]
    either = [float(abs(np.linalg.eigvals(x @ y)).max()) for x, y in (A, A[::-1])]
    assert uneven.radius == pytest.approx(either[0], abs=CLOSE)
    with pytest.raises(sd.SimulationError, match="anew together after more than 100000 steps"):
        sd.closed_step(rod, pd(0.01 * np.sqrt(2.0)), [0.0], [0.0], 1e-3)


@pytest.mark.parametrize("call", ["simulate", "rollout", "cost"])
def test_a_period_that_is_too_long_is_warned_of(call: str, rod: sd.Model) -> None:
    def nothing(bodies: Any, q: Any, cost: Any) -> None:
        cost[0] = q[0] * q[0]

    cost = sd.Cost(Spec("square_of_q", nothing, None, (Q,), Argument("cost", (1,), "", ""), "", ""))

    dt = {"simulate": 5e-3, "rollout": 2.5e-3, "cost": 1e-3}[call]  # each of which is judged once

    def run(law: sd.Control) -> None:
        if call == "simulate":
            sd.simulate(rod, [0.0], [0.0], 0.01, dt, "rk4", control=law)
        else:
            more: Any = {"cost": cost} if call == "cost" else {}
            sd.rollout(rod, np.zeros((2, 1)), [0.0], dt=dt, steps=2, method="rk4", control=law, **more)

    run(pd(0.065))  # warnings are errors here
    with pytest.warns(UserWarning, match=r"too stiff for its period of 0.075 s: .* joint \"rod.*a period of 0.0375 s"):
        run(pd(0.075))
    run(pd(0.075))
    with pytest.warns(UserWarning, match=f"too stiff for steps of {dt:g} s"):
        run(pd(0.01, 400.0))


def test_a_period_through_which_a_pendulum_swings_is_no_fault() -> None:
    """Its own motion turns by half in a period: no sign of instability."""
    falling = sd.ModelBuilder("falling").add_body("rod", None, axis=(0, 1, 0), inertia=SOLID).build()
    for q in (np.pi, np.pi - 1.0, 0.0):
        for period in (0.2, 0.5, 0.8):
            sd.simulate(falling, [q], [0.5], 0.1, 0.01, control=sd.PD([1e-3], [1e-3], [q], held=period))


@pytest.mark.parametrize("way", ["implicit", "smooth"])
def test_scenes_of_viscous_friction_are_judged(way: str, rod: sd.Model) -> None:
    b, h, kp = 0.3, 0.02, 2e3
    law = sd.Friction(viscous=[b], smoothing=[1.0])
    scene = sd.Scene(rod, friction=law, friction_method=way)
    I = float(sd.crba(rod, [0.0])[0, 0])

    def by_hand(k: float) -> np.ndarray:
        bottom = np.array([-h * k / I, 1.0]) / (1.0 + h * b / I)  # implicit in the damping, explicit in the law
        if way == "smooth":
            bottom = np.array([-h * k / I, 1.0 - h * b / I])
        return np.array([[1.0, 0.0], [0.0, 0.0]]) + np.outer([h, 1.0], bottom)

    for k in (0.01 * kp, kp):
        found = sd.closed_step(scene, sd.PD([k], [0.0], [0.0]), [0.0], [0.0], h, "semi_implicit_euler")
        assert abs(found.A - by_hand(k)).max() < 1e-6 * k
        assert (found.radius > 1.0) == (k == kp)
    sd.rollout(scene, [0.0], [0.0], dt=h, steps=2, control=sd.PD([0.01 * kp], [0.0], [0.0]))
    with pytest.warns(UserWarning, match="too stiff for steps of 0.02 s"):
        sd.rollout(scene, [0.0], [0.0], dt=h, steps=2, control=sd.PD([kp], [0.0], [0.0]))


def test_errors_beside_what_acts_by_impulses_are_those_of_its_side() -> None:
    """A + B K of ``step_derivatives``, of joints that rub, stop and are driven and a tip that slides."""
    model, q, v, h = sd.load_urdf("two_link"), np.array([0.5, -0.3]), np.array([0.4, -0.2]), 1e-3
    law, K = sd.PD([20.0, 10.0], [2.0, 1.0], [0.1, 0.2]), -np.array([[20.0, 0.0, 2.0, 0.0], [0.0, 10.0, 0.0, 1.0]])
    tau = K @ np.r_[q - [0.1, 0.2], v]
    (gap,) = sd.contact_gaps(model, sd.Contacts(model, {"tip": 0.02}), q)
    ground = sd.Contacts(model, {"tip": 0.02}, terrain=sd.Plane((0.0, 0.0, 1.0), gap + 1e-4), tolerance=1e-13)
    for acts in (
        {"friction": sd.Friction(0.1, 0.05)}, {"limits": True, "contacts": ground},
        {"motor": sd.Motor(0.05, 1.0, 24.0, 20.0, efficiency=0.8)},
    ):  # fmt: skip
        scene = sd.Scene(model, **acts)
        A, B = sd.step_derivatives(scene, q, v, tau, h)
        found = sd.closed_step(scene, law, q, v, h)
        np.testing.assert_allclose(found.A, A + B @ K, rtol=0, atol=1e-6 * abs(A).max())
    rubs = sd.Scene(model, friction=sd.Friction(100.0))  # sticks
    assert (
        abs(sd.closed_step(rubs, sd.PD([1e-3] * 2, [0.0] * 2, [0.0] * 2), [0.0] * 2, [0.0] * 2, h).A[2:]).max() == 0.0
    )
    stopped = sd.ModelBuilder("rod").add_body("rod", None, "revolute", (0, 0, 1), inertia=SOLID, limits=(-1.0, 1.0))
    at_limit = sd.Scene(stopped.build(), limits=True)
    with pytest.raises(sd.SimulationError, match="scene of limits has two derivatives of the step from this state"):
        sd.closed_step(at_limit, sd.PD([0.0], [0.0], [0.0]), [1.0], [0.0], h)


def test_states_of_a_law_are_part_of_its_step(rod: sd.Model) -> None:
    """An integral whose gain is above kp kd / I makes errors grow; q and v alone would not show it."""

    def pid(bodies: Any, q: Any, v: Any, gain: Any, past: Any, tau: Any, past_rate: Any) -> None:
        for i in range(len(tau)):
            tau[i] = -40.0 * q[i] - 2.8 * v[i] - gain[i] * past[i]
            past_rate[i] = q[i]

    past = Argument("past", ("nv",), "rad s", "", start=0.0)
    spec = Spec(
        "pid_of_rod", pid, None, (Q, V, Argument("gain", ("nv",), "", ""), past), TAU, "", "",
        parts=(TAU, Argument("past_rate", ("nv",), "rad", "")),
    )  # fmt: skip
    h = 2e-3
    for gain, stable in ((0.5, True), (1.5, False)):
        k = gain * 40.0 * 2.8 / 0.1
        F = np.array([[0.0, 1.0, 0.0], [-400.0, -28.0, -10.0 * k], [1.0, 0.0, 0.0]])
        want, term = np.eye(3), np.eye(3)
        for order in range(1, 5):
            term = term @ (h * F) / order
            want = want + term
        found = sd.closed_step(rod, sd.Control(spec, {"gain": [k]}), [0.0], [0.0], h, "rk4")
        assert abs(found.A - want).max() < CLOSE * abs(want).max()
        assert (found.radius < 1.0) == stable


def test_under_constraints_errors_are_those_that_these_allow() -> None:
    """Two masses that slide as one: 3 kg on a spring."""
    b = sd.ModelBuilder("sliders").add_body("one", None, "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)))
    model = b.add_body("two", None, "prismatic", (1, 0, 0), inertia=(2.0, (0, 0, 0), np.eye(3))).build()
    held = sd.Constraints(model, [sd.CouplerConstraint("two_joint", "one_joint", 1.0)])
    h, k, d = 0.01, 300.0, 10.0
    law = sd.PD([k, 0.0], [d, 0.0], [0.0, 0.0])
    found = sd.closed_step(sd.Scene(model, constraints=held), law, [0.1, 0.1], [0.2, 0.2], h, "semi_implicit_euler")
    bottom = np.array([-h * k / 3.0, 1.0 - h * d / 3.0])
    want = np.linalg.eigvals(np.array([[1.0, 0.0], [0.0, 0.0]]) + np.outer([h, 1.0], bottom))
    values = np.linalg.eigvals(found.A)
    values = values[np.argsort(-abs(values))]
    assert abs(values[2:]).max() < 1e-6
    assert found.radius == pytest.approx(abs(want).max(), abs=1e-7)
