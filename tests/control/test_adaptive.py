"""Adaptive laws: their lines by matrices, estimates that learn and stay physical, lanes, what a motion shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.control.adaptive import parameters_of, pseudo_inertia
from spatialdyn.engines.compiled import numba_kernels

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
CLOSE = 1e-11  # relative: M, C and g formed, against recursions
RATES, GAIN = 5.0, 10.0
Q0, V0 = np.array([0.2, -1.3]), np.array([0.3, -0.4])
DT = 2e-3


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    """Two links with volume, the axes at right angles."""
    b = sd.ModelBuilder("arm")
    b.add_body("a", None, "revolute", (0, 0, 1), None, (3.0, (0.02, 0.01, 0.1), np.diag([0.02, 0.03, 0.025])), "pan")
    b.add_body("b", "a", "revolute", (0, 1, 0), (0, 0, 0.3), (2.0, (0.3, 0.02, 0), np.diag([0.01, 0.1, 0.1])), "lift")
    return b.build()


@pytest.fixture(scope="module")
def path() -> sd.Path:
    """A motion that excites both joints."""
    return sd.fourier(np.zeros((2, 2)), np.array([[0.3, 0.3], [0.1, -0.1]]), 0.5, np.array([0.0, -1.0]))


def wrong(model: sd.Model) -> Any:
    """Parameters of masses that are wrong by a half."""
    guess = sd.inertial_parameters(model).copy()
    guess[1] *= 1.5
    guess[2] *= 0.5
    return guess


def step_of(model: sd.Model, path: sd.Path, guess: Any) -> tuple[Any, Any]:
    """(τ, Yᵀ s) of a law at Q0, V0 at the beginning of the path, by matrices."""
    at = path(0.0)
    e, de = at.q - Q0, at.v - V0
    v_r, a_r = at.v + RATES * e, at.a + RATES * de
    s = V0 - v_r
    Y = sd.modified_torque_regressor(model, Q0, V0, v_r, a_r)
    return np.einsum("ijk,jk->i", Y, guess) - GAIN * s, np.einsum("i,ijk->jk", s, Y)


def test_the_euclidean_law_is_its_lines(arm: sd.Model, path: sd.Path) -> None:
    guess = wrong(arm)
    tau, y = step_of(arm, path, guess)
    Gamma = np.linspace(0.1, 1.0, 30).reshape(3, 10)
    law = sd.SlotineLi(arm, RATES, GAIN, path, guess, Gamma)
    np.testing.assert_allclose(law(arm, 0.0, Q0, V0), tau, rtol=CLOSE)
    run = sd.simulate(arm, Q0, V0, DT, DT, control=law)
    np.testing.assert_allclose(law.estimates(run)[1], guess - DT * Gamma * y, rtol=CLOSE, atol=CLOSE)
    least, most = guess - 1e-4, guess + 1e-4
    bound = sd.SlotineLi(arm, RATES, GAIN, path, guess, Gamma, bounds=(least, most))
    found = bound.estimates(sd.simulate(arm, Q0, V0, DT, DT, control=bound))[1]
    np.testing.assert_allclose(found, (guess - DT * Gamma * y).clip(least, most), rtol=CLOSE, atol=CLOSE)
    still = sd.SlotineLi(arm, RATES, GAIN, path, guess, Gamma, deadzone=1e3)
    np.testing.assert_array_equal(still.estimates(sd.simulate(arm, Q0, V0, DT, DT, control=still))[1], guess)


def test_the_natural_law_is_its_lines(arm: sd.Model, path: sd.Path) -> None:
    guess = wrong(arm)
    tau, y = step_of(arm, path, guess)
    law = sd.NaturalAdaptation(arm, RATES, GAIN, path, guess, 10.0)
    np.testing.assert_allclose(law(arm, 0.0, Q0, V0), tau, rtol=CLOSE)
    found = law.estimates(sd.simulate(arm, Q0, V0, DT, DT, control=law))[1]
    P = pseudo_inertia(guess)
    np.testing.assert_allclose(parameters_of(P), guess, atol=1e-15)
    for j in (1, 2):
        L = np.zeros((4, 4))
        for a in range(4):
            for b in range(4):  # tr(L P) = y·π for any P
                one = np.zeros((4, 4))
                one[a, b] += 0.5
                one[b, a] += 0.5
                L[a, b] = y[j] @ parameters_of(one)
        U = np.linalg.cholesky(P[j])
        w, Q = np.linalg.eigh(-DT / 10.0 * U.T @ L @ U)
        assert abs(w).max() < 1.0
        np.testing.assert_allclose(found[j], parameters_of(U @ (Q * np.exp(w)) @ Q.T @ U.T), rtol=1e-9, atol=1e-12)


@compiled
def test_wrong_masses_are_tracked_and_estimates_stay_physical(arm: sd.Model, path: sd.Path) -> None:
    """Where the Euclidean law wanders off to negative inertias, and converges more slowly."""
    guess, left = wrong(arm), {}
    laws = {
        "natural": sd.NaturalAdaptation(arm, RATES, GAIN, path, guess, 1.0),
        "euclidean": sd.SlotineLi(arm, RATES, GAIN, path, guess, 0.1),
    }
    for name, law in laws.items():
        run = sd.simulate(arm, Q0, 0.0 * V0, 8.0, DT, control=law)
        e = run.q - path(run.t).q
        first, last = (np.sqrt((x**2).mean()) for x in (e[: len(e) // 4], e[-len(e) // 4 :]))
        least = np.linalg.eigvalsh(pseudo_inertia(law.estimates(run))[:, 1:])[..., 0]
        left[name] = last
        assert last < 0.1 * first
        assert (least.min() > 0.0) == (name == "natural")
    assert left["natural"] < 0.5 * left["euclidean"]


def test_any_step_leaves_the_natural_estimate_physical(arm: sd.Model, path: sd.Path) -> None:
    """A γ of 1e-9 makes steps 1e8 times as large as fit."""
    law = sd.NaturalAdaptation(arm, RATES, GAIN, path, wrong(arm), 1e-9)
    run = sd.simulate(arm, Q0, V0, 0.05, DT, control=law)
    assert (np.linalg.eigvalsh(law.pseudo_inertias(run)[:, 1:])[..., 0] > 0.0).all()


def test_friction_is_given_and_learnt_by_its_line(arm: sd.Model, path: sd.Path) -> None:
    pi, first = sd.inertial_parameters(arm), sd.Friction([0.8, 0.5], [0.3, 0.2], smoothing=0.05)
    bare = sd.SlotineLi(arm, RATES, GAIN, path, pi, 0.0)
    law = sd.SlotineLi(arm, RATES, GAIN, path, pi, 0.0, friction=first, friction_gain=20.0)
    sign, at = np.tanh(V0 / 0.05), path(0.0)
    given = law(arm, 0.0, Q0, V0) - bare(arm, 0.0, Q0, V0)
    np.testing.assert_allclose(given, [0.8, 0.5] * sign + [0.3, 0.2] * V0, rtol=1e-9)
    s = V0 - at.v - RATES * (at.q - Q0)
    found = law.frictions(sd.simulate(arm, Q0, V0, DT, DT, control=law))[1]
    wanted = np.array([[0.8, 0.5], [0.3, 0.2]]) - DT * 20.0 * np.array([sign, V0]) * s
    np.testing.assert_allclose(found, wanted.clip(0.0), rtol=1e-9)


@pytest.mark.slow(quick="test_friction_is_given_and_learnt_by_its_line")
def test_friction_is_learnt_beside_masses(arm: sd.Model, path: sd.Path) -> None:
    """Without its columns the law follows less well; with them the estimates go towards what acts."""
    friction = sd.Friction([0.8, 0.5], [0.3, 0.2], smoothing=0.05)
    scene = sd.Scene(arm, friction=friction)
    pi, nothing = sd.inertial_parameters(arm), sd.Friction([0.0, 0.0], [0.0, 0.0], smoothing=0.05)
    bare = sd.SlotineLi(arm, RATES, GAIN, path, pi, 0.0)
    law = sd.SlotineLi(arm, RATES, GAIN, path, pi, 0.0, friction=nothing, friction_gain=20.0)
    off = []
    for x in (bare, law):
        run = sd.simulate(scene, path(0.0).q, path(0.0).v, 8.0, DT, control=x)
        off.append(abs(run.q - path(run.t).q)[-1000:].max())
    assert off[1] < 0.3 * off[0]
    learnt = law.frictions(run)[-1]
    assert (law.frictions(run) >= 0.0).all()
    np.testing.assert_allclose(learnt, [friction.coulomb, friction.viscous], rtol=0.1, atol=0.15)
    with pytest.raises(sd.SimulationError, match="learns no friction"):
        bare.frictions(run)


@pytest.mark.parametrize("friction", [None, sd.Friction([0.0, 0.0], [0.0, 0.0], smoothing=0.05)])
def test_the_error_of_prediction_is_its_lines(arm: sd.Model, path: sd.Path, friction: Any) -> None:
    """Filters by regressors, step after step; what s and e teach; W of the true parameters predicts the torque."""
    guess, pi, c, width, n = wrong(arm), sd.inertial_parameters(arm), 3.0, 8.0, 40
    law = sd.SlotineLi(arm, RATES, GAIN, path, guess, 0.1, composite=c, bandwidth=width, friction=friction)
    run = sd.simulate(arm, Q0, V0, n * DT, DT, method="semi_implicit_euler", control=law)
    rise = width / (1.0 + DT * width)
    found, F, T, estimate = law.estimates(run), None, np.zeros(2), guess
    for k in range(n):
        q, v = run.q[k], run.v[k]
        Y, zero = sd.momentum_regressor(arm, q, v), 0.0 * v
        N = sd.modified_torque_regressor(arm, q, zero, zero, zero) - sd.coriolis_transpose_regressor(arm, q, v)
        F = -rise * Y if F is None else F
        W = rise * Y + F
        at = path(k * DT)
        v_r, a_r = at.v + RATES * (at.q - q), at.a + RATES * (at.v - v)
        s, of_law = v - v_r, sd.modified_torque_regressor(arm, q, v, v_r, a_r)
        np.testing.assert_allclose(found[k], estimate, rtol=1e-9, atol=1e-9)
        e = np.einsum("ijk,jk->i", W, estimate) - T
        truly = np.einsum("ijk,jk->i", W, pi) - T
        assert abs(truly).max() < 1e-2 * max(1.0, abs(e).max())  # of a step of first order
        tau = np.einsum("ijk,jk->i", of_law, estimate) - GAIN * s
        y = np.einsum("i,ijk->jk", s, of_law) + c * np.einsum("i,ijk->jk", e, W)
        F, T = F + DT * rise * (N - rise * Y - F), T + DT * rise * (tau - T)
        estimate = estimate - DT * 0.1 * y


@compiled
def test_composite_laws_learn_while_they_track(arm: sd.Model, path: sd.Path) -> None:
    """From a motion that starts on the path: the error of prediction goes on where s is small; both laws."""
    guess, pi, left = wrong(arm), sd.inertial_parameters(arm), {}
    Y = np.concatenate([
        sd.modified_torque_regressor(arm, x.q, x.v, x.v, x.a).reshape(2, -1) for x in map(path, np.linspace(0, 2, 40))
    ])  # fmt: skip
    for c in (0.0, 5.0):
        laws = (
            sd.SlotineLi(arm, RATES, GAIN, path, guess, 0.02, composite=c),
            sd.NaturalAdaptation(arm, RATES, GAIN, path, guess, 20.0, composite=c),
        )
        for k, law in enumerate(laws):
            run = sd.simulate(arm, path(0.0).q, path(0.0).v, 2.0, DT, control=law)
            off = (law.estimates(run)[-1] - pi).ravel()
            left[k, c] = np.linalg.norm(Y @ off)  # in torques: what the motion does not show does not count
    for k in (0, 1):
        assert left[k, 5.0] < 0.5 * left[k, 0.0]


@compiled
@pytest.mark.parametrize("natural", [False, True], ids=["euclidean", "natural, composite"])
def test_many_estimates_run_as_they_do_alone(arm: sd.Model, path: sd.Path, natural: bool) -> None:
    """Bit for bit, on lanes: each sample begins with other estimates."""
    law: Any = sd.SlotineLi(arm, RATES, GAIN, path, wrong(arm), 0.1)
    if natural:
        law = sd.NaturalAdaptation(arm, RATES, GAIN, path, wrong(arm), 20.0, composite=2.0)
    rng, many = np.random.default_rng(0), 1024
    learnt = 0.05 * rng.normal(size=(many, 3, 4, 4) if natural else (many, 3, 10))
    start = (np.tile(Q0, (many, 1)), np.tile(V0, (many, 1)))
    runs = sd.rollout(arm, *start, dt=DT, steps=20, control=law, states={"learnt": learnt})
    for k in (0, 511, 1023):
        one = sd.rollout(arm, Q0[None], V0[None], dt=DT, steps=20, control=law, states={"learnt": learnt[k : k + 1]})
        np.testing.assert_array_equal(one.q[0], runs.q[k])
        np.testing.assert_array_equal(law.estimates(one)[0], law.estimates(runs)[k])
    assert len(np.unique(runs.q[:, -1, 0])) == many


def test_what_a_motion_shows_is_counted(arm: sd.Model, path: sd.Path) -> None:
    """The first body turns about its axis alone: of its ten parameters one is seen, of both eight combinations."""
    law = sd.SlotineLi(arm, RATES, GAIN, path, wrong(arm), 0.1)
    at = path(np.linspace(0.0, 2.0, 400))
    found = law.excitation(at.q, at.v, at.a)
    assert (found.rank, found.parameters) == (8, 30)
    rest = law.excitation(at.q[:1], 0.0 * at.v[:1], 0.0 * at.a[:1])
    assert rest.rank < 3
    one = np.zeros((3, 10))
    one[2, 0] = 1.0  # a mass at the joint, whose height is constant
    assert sd.SlotineLi(arm, RATES, GAIN, path, wrong(arm), one).excitation(at.q, at.v, at.a).rank == 0


BAD: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"parameters": np.zeros((2, 10))}, sd.ShapeError, "parameters has shape"),
    ({"parameters": np.full((3, 10), np.nan)}, sd.NonFiniteError, "parameters has"),
    ({"Gamma": -1.0}, sd.SimulationError, "Gamma has -1"),
    ({"deadzone": -1.0}, sd.SimulationError, "deadzone is -1"),
    ({"gain": -1.0}, sd.SimulationError, "gain has the eigenvalue -1"),
    ({"composite": -1.0}, sd.SimulationError, "composite is -1"),
    ({"composite": 1.0, "bandwidth": 0.0}, sd.SimulationError, "bandwidth is 0"),
    ({"bounds": 1.0}, sd.SimulationError, "bounds is 1.0"),
    ({"bounds": (np.ones((3, 10)), 1e9)}, sd.SimulationError, "expected between bounds"),
    ({"friction": sd.Friction([0.1, 0.1])}, sd.ModelError, "no smoothing"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "kind", "message"), BAD)
def test_bad_input_is_named(arm: sd.Model, change: dict[str, Any], kind: type[Exception], message: str) -> None:
    given = {"model": arm, "rates": RATES, "gain": GAIN, "path": Q0, "parameters": wrong(arm), "Gamma": 0.1}
    with pytest.raises(kind, match=message):
        sd.SlotineLi(**(given | change))


def test_a_composite_law_has_to_be_all_that_acts(arm: sd.Model, path: sd.Path) -> None:
    """Clipped, or beside another, it would take the rest for wrong masses."""
    pi = sd.inertial_parameters(arm)
    law = sd.SlotineLi(arm, RATES, GAIN, path, pi, 0.1, composite=3.0)
    for make in (lambda: law.limited_by([5.0, 5.0]), lambda: law + sd.Gravity(), lambda: sd.Gravity() + law):
        with pytest.raises(sd.SimulationError, match="learns from what its torque does"):
            make()
    sd.SlotineLi(arm, RATES, GAIN, path, pi, 0.1).limited_by([5.0, 5.0])


def test_point_masses_have_no_natural_estimate() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.InertiaError, match="joint1"):
        sd.NaturalAdaptation(model, RATES, GAIN, Q0, sd.inertial_parameters(model), 1.0)
    with pytest.raises(sd.SimulationError, match="gamma is"):
        sd.NaturalAdaptation(model, RATES, GAIN, Q0, sd.inertial_parameters(model), 0.0)


def test_a_law_meets_the_joints_that_it_was_made_for(arm: sd.Model, path: sd.Path) -> None:
    law = sd.SlotineLi(arm, RATES, GAIN, path, wrong(arm), 0.1)
    with pytest.raises(sd.SpatialDynError, match="coordinates"):
        sd.simulate(sd.load_urdf("three_link"), [0, 0, 0], [0, 0, 0], DT, DT, control=law)
    b = sd.ModelBuilder("other").add_body("a", None, "planar", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.eye(3)))
    with pytest.raises(sd.ModelError, match="whose parameters the law learns"):
        law._check(b.build())


@compiled
@pytest.mark.parametrize("natural", [False, True])
def test_a_period_of_one_step_is_a_torque_held_over_steps(arm: sd.Model, path: sd.Path, natural: bool) -> None:
    """And estimates, tables of numbers for each body, move once in a longer one."""

    def run(held: bool | float) -> sd.Rollout:
        make: Any = sd.NaturalAdaptation if natural else sd.SlotineLi
        law = make(arm, RATES, GAIN, path, wrong(arm), 1.0, held=held)
        return sd.rollout(arm, Q0, V0, dt=DT, steps=4, control=law)

    every = run(True)
    np.testing.assert_allclose(run(DT).states["learnt"], every.states["learnt"], rtol=1e-12, atol=1e-15)
    slow = run(2.0 * DT).states["learnt"]
    assert (slow[0] == slow[1]).all()
    assert (slow[1] != slow[2]).any()
    assert (slow[2] == slow[3]).all()


def test_a_body_without_mass_is_kept_as_it_is() -> None:
    solid = (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3))
    b = sd.ModelBuilder("hollow").add_body("shell", None, axis=(0, 1, 0), armature=0.1)
    model = b.add_body("rod", "shell", axis=(0, 1, 0), inertia=solid).build()
    pi = sd.inertial_parameters(model)
    with pytest.raises(sd.InertiaError, match='body of joint "shell_joint" has a pseudo-inertia'):
        sd.NaturalAdaptation(model, RATES, GAIN, [0.1, 0.2], pi, 10.0)
    law = sd.NaturalAdaptation(model, RATES, GAIN, [0.1, 0.2], pi, [np.inf, np.inf, 10.0])
    np.testing.assert_allclose(law(model, 0.0, Q0, V0), sd.Passivity(RATES, GAIN, [0.1, 0.2])(model, 0.0, Q0, V0))
