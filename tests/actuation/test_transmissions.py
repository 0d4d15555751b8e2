"""Transmissions: maps of coordinates and their power; the matrix of inertias that motors behind a differential add."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from asymmetric import primes, roots
from plain import EXACT, by_table, close, plainly, states
from trees import random_inertia, random_placement, random_unit

import spatialdyn as sd
from spatialdyn.accuracy.call_errors import TASK_CALLS, calls_of
from spatialdyn.calls.dynamics import calls, table_call
from spatialdyn.engines.programs.record.recording import record
from spatialdyn.recursions import SPECS

A = np.array([[0.5, 0.5], [0.5, -0.5]]) / 20.0  # a differential behind gears of 20
J = np.array([2e-4, 7e-4])
WRIST = sd.Transmission(("pitch", "roll"), A, J)


def arm(floating: bool = False, square: bool = False) -> sd.Model:
    """An arm of five joints with a differential wrist, and another branch; ``square``: along the axes of frames."""
    rng = np.random.default_rng(3)
    b = sd.ModelBuilder("arm", root="base").set_inertia("base", random_inertia(rng))
    parent = "base"
    for k, name in enumerate(("shoulder", "elbow", "pitch", "roll", "finger")):
        axis = np.eye(3)[k % 3] if square else random_unit(rng, 3)
        placement = (0.1, 0.2, 0.3) if square else random_placement(rng)
        b.add_body(f"{name}_link", parent, "revolute", axis, placement, random_inertia(rng), name)
        parent = f"{name}_link"
    axis = np.eye(3)[0] if square else random_unit(rng, 3)
    b.add_body("side", "elbow_link", "prismatic", axis, (0, 0.1, 0), random_inertia(rng), "slide")
    return b.build(root="floating") if floating else b.build()


@pytest.fixture(scope="module", params=[False, True], ids=["fixed", "floating"])
def wrists(request: pytest.FixtureRequest) -> tuple[sd.Model, sd.Model, np.ndarray]:
    """The arm without and with the wrist's motors, and the matrix between their M."""
    plain = arm(request.param)
    at = [plain.joint(name).idx_v for name in WRIST.joints]
    B = np.zeros((plain.nv, plain.nv))
    B[np.ix_(at, at)] = np.linalg.inv(A).T @ np.diag(J) @ np.linalg.inv(A)
    return plain, plain.with_(transmissions=[WRIST]), B


# --- maps -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("A", [A, roots(2, 2)], ids=["differential", "any"])
def test_actuators_and_joints_exchange_the_same_power(A: np.ndarray) -> None:
    model, rng = arm(), np.random.default_rng(0)
    q, v, tau = (rng.normal(size=(5, 6)) for _ in range(3))
    t = sd.Transmission(WRIST.joints, A, offset=[0.3, -0.1])
    there = sd.to_actuators(model, t, q=q, v=v, tau=tau)
    np.testing.assert_allclose((there.v * there.tau).sum(-1), (v * tau).sum(-1), rtol=1e-13)
    back = sd.to_joints(model, t, q=there.q, v=there.v, tau=there.tau)
    for one, other in zip(back, (q, v, tau), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-14)
    at = [model.joint(name).idx_v for name in t.joints]
    np.testing.assert_allclose(q[:, at], there.q[:, at] @ A.T + [0.3, -0.1], rtol=1e-13)
    np.testing.assert_allclose(v[:, at], there.v[:, at] @ A.T, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(there.tau[:, at], tau[:, at] @ A, rtol=1e-12, atol=1e-14)
    others = [k for k in range(6) if k not in at]
    np.testing.assert_array_equal(there.q[:, others], q[:, others])
    assert sd.to_joints(model, [], v=v).tau is None


def test_the_two_motors_of_a_differential_turn_alike_to_pitch_and_apart_to_roll() -> None:
    model = arm()
    pitch, roll = (model.joint(name).idx_v for name in WRIST.joints)
    v = np.zeros(6)
    v[pitch] = 1.0
    np.testing.assert_allclose(sd.to_actuators(model, WRIST, v=v).v[[pitch, roll]], [20.0, 20.0], rtol=1e-14)
    tau = np.zeros(6)
    tau[[pitch, roll]] = 1.0, -1.0
    np.testing.assert_allclose(sd.to_joints(model, WRIST, tau=tau).tau[[pitch, roll]], [0.0, 40.0], atol=1e-14)


def test_a_gear_of_one_joint_is_an_armature() -> None:
    model = arm().with_(transmissions=[sd.Transmission("elbow", [[1.0 / 30.0]], 1e-3)])
    assert model.armature[model.joint("elbow").idx_v] == pytest.approx(0.9, rel=1e-14)
    assert not model.bodies["coupled"].any()


# --- the matrix in M ------------------------------------------------------------------------------------


def test_the_inertias_add_a_block_to_the_mass_matrix(wrists: tuple[sd.Model, sd.Model, np.ndarray]) -> None:
    plain, geared, B = wrists
    x = states(plain)
    v, a = x["v"][0], x["a"][0]
    M = plainly(plain, "crba", x) + B
    assert np.count_nonzero(B) == 4
    close(plainly(geared, "crba", x), M)
    close(plainly(geared, "rnea", x), plainly(plain, "rnea", x) + B @ a)
    close(plainly(geared, "nonlinear_effects", x), plainly(plain, "nonlinear_effects", x))
    close(plainly(geared, "kinetic_energy", x), plainly(plain, "kinetic_energy", x) + 0.5 * v @ B @ v)
    close(plainly(geared, "momentum", x), M @ v)
    close(plainly(geared, "modified_rnea", x), plainly(plain, "modified_rnea", x) + B @ x["a_r"][0])
    for name in ("coriolis_matrix", "mass_matrix_dot", "christoffel_symbols", "momentum_rate", "centroidal_map"):
        close(plainly(geared, name, x), plainly(plain, name, x))
    by, before = plainly(geared, "rnea_derivatives", x), plainly(plain, "rnea_derivatives", x)
    close(by, before + np.array([0 * B, 0 * B, B]))


def test_reflected_inertia_is_that_of_the_actuators_kinetic_energy() -> None:
    """½ θ̇ᵀ J θ̇ = ½ q̇ᵀ B q̇ of a matrix without symmetry."""
    A, J, v = roots(3, 3), primes(3), roots(3, after=30)
    B = sd.Transmission(("a", "b", "c"), A, J).reflected_inertia()
    turns = np.linalg.solve(A, v)
    assert v @ B @ v == pytest.approx(turns @ (J * turns), rel=1e-11)
    np.testing.assert_array_equal(B, B.T)


def test_calls_that_solve_invert_it(wrists: tuple[sd.Model, sd.Model, np.ndarray]) -> None:
    plain, geared, B = wrists
    x = states(plain)
    M, bias = plainly(plain, "crba", x) + B, plainly(plain, "nonlinear_effects", x)
    cond = EXACT + 30 * np.linalg.cond(M) * np.finfo(float).eps
    a = np.linalg.solve(M, x["tau"][0] - bias)
    for name in ("aba", "aba_refined", "crba_solve"):
        close(plainly(geared, name, x), a, cond)
    close(plainly(geared, "minverse", x), np.linalg.inv(M), cond)
    v = np.linalg.solve(M, x["p"][0])
    close(plainly(geared, "velocity_from_momentum", x), v, cond)
    close(plainly(geared, "hamilton_field", x)[0], v, cond)
    T = plainly(geared, "hamiltonian", x) - plainly(geared, "potential_energy", x)
    close(T, 0.5 * x["p"][0] @ v, 1e-11)
    by = plainly(geared, "rnea_derivatives", {**x, "a": a[None]})
    found = plainly(geared, "aba_derivatives", x)
    for k in (0, 1):
        close(found[k], -np.linalg.solve(M, by[k]), 10 * cond)


@pytest.mark.slow(quick="test_the_inertias_add_a_block_to_the_mass_matrix")
def test_programs_table_kernels_and_runs_have_it(wrists: tuple[sd.Model, sd.Model, np.ndarray]) -> None:
    _, geared, _ = wrists
    x = states(geared, count=9)
    for name in ("rnea", "crba", "aba", "minverse", "rnea_derivatives"):
        values = [x[i.name] for i in SPECS[name].present if not i.optional]
        truth = np.array([plainly(geared, name, x, k) for k in range(9)])
        close(calls[name](geared, *values), truth, 1e-11)
        close(table_call(name, geared, *values), truth, 1e-11)
    after = sd.rollout(geared, x["q"], x["v"], x["tau"][0], dt=1e-3, steps=1)
    rubbed = sd.rollout(
        sd.Scene(geared, friction=sd.Friction(np.zeros(geared.nv), 0.0)), x["q"], x["v"], x["tau"][0], dt=1e-3, steps=1
    )
    close(rubbed.v, after.v, 1e-11)


@pytest.mark.slow(quick="test_the_inertias_add_a_block_to_the_mass_matrix")
def test_energy_is_kept_with_it() -> None:
    geared = arm().with_(transmissions=[WRIST])
    x = states(geared, 2)
    run = sd.simulate(geared, x["q"][0], x["v"][0], 0.1, 1e-3, "variational")
    assert abs(run.energy - run.energy[0]).max() < 1e-4 * abs(run.energy).max()
    fine = sd.simulate(geared, x["q"][0], x["v"][0], 0.1, 1e-4, "rk4")
    np.testing.assert_allclose(run.v[-1], fine.v[-1], rtol=0.0, atol=1e-3 * abs(fine.v[-1]).max())


def test_the_exact_engine_has_it() -> None:
    pytest.importorskip("mpmath")
    geared = arm(square=True).with_(transmissions=[WRIST])  # no axis or rotation of it is rounded
    x = states(geared)
    q, v, tau = (x[k][0] for k in ("q", "v", "tau"))
    a = sd.exact(geared, sd.aba)(q, v, tau)
    again = sd.exact(geared, sd.rnea)(q, v, a)
    assert float(abs(again - tau).max()) < 1e-60


def test_symbols_have_it() -> None:
    pytest.importorskip("sympy")
    t = sd.Transmission(("joint1", "joint2"), [[0.5, 0.5], [0.5, -0.5]], [0.125, 0.5])
    model = sd.load_urdf("two_link").with_(transmissions=[t])
    s, q = sd.SymbolicManipulator(model), [0.3, -0.4]
    M = np.array(s.M().subs(dict(zip(s.q, q, strict=True))).evalf(17), float)
    close(M, plainly(model, "crba", {"q": np.array([q])}))
    assert M[0, 1] != plainly(sd.load_urdf("two_link"), "crba", {"q": np.array([q])})[0, 1]


@pytest.mark.parametrize("name", ["aba", "minverse", "rnea", "crba", "aba_derivatives", "momentum"])
def test_without_transmissions_their_numbers_are_not_read(name: str) -> None:
    model = sd.load_urdf("two_link")
    spoiled = model.bodies.copy()
    spoiled["coupling"] = np.nan
    one, other = (record([SPECS[name]], bodies).program.lines for bodies in (model.bodies, spoiled))
    assert [*map(tuple, one)] == [*map(tuple, other)]


# --- models -----------------------------------------------------------------------------------------------


def test_models_keep_their_transmissions() -> None:
    model = arm().with_(transmissions=[WRIST])
    assert pickle.loads(pickle.dumps(model)) == model
    assert model.key != arm().key
    assert model.with_(gravity=(0, 0, 0)).bodies["coupled"].sum() == 1
    locked = model.reduced({"pitch": 0.2})
    assert not locked.bodies["coupled"].any()
    x = states(locked)
    q = np.insert(x["q"], model.joint("pitch").idx_q, 0.2, axis=1)
    keep = [k for k in range(6) if k != model.joint("pitch").idx_v]
    close(plainly(locked, "crba", x), plainly(model, "crba", {"q": q})[np.ix_(keep, keep)])
    behind = model.subtree("pitch_link")
    assert behind.nv == 2
    assert not behind.bodies["coupled"].any()
    smaller, _ = sd.simplify(model, drop="armature")
    assert not smaller.armature.any()


def test_motors_of_joints_that_are_apart_are_refused_by_name() -> None:
    model = arm()
    apart = sd.Transmission(("elbow", "roll"), A, J)
    with pytest.raises(sd.ModelError, match='joints "elbow" and "roll" share motors and are apart'):
        model.with_(transmissions=[apart])
    equal = model.with_(transmissions=[sd.Transmission(("elbow", "roll"), A, [1e-4, 1e-4])])
    assert not equal.bodies["coupled"].any()  # equal motors have nothing off the diagonal
    with pytest.raises(sd.ModelError, match=r'joint "pitch" is driven by two|"pitch" and "elbow"|"elbow" and "pitch"'):
        model.with_(transmissions=[WRIST, sd.Transmission(("elbow", "pitch"), A, J)])
    with pytest.raises(sd.ModelError, match="expected none for aba_square_root"):
        sd.aba_square_root(model.with_(transmissions=[WRIST]), np.zeros(6), np.zeros(6), np.zeros(6))
    geared = model.with_(transmissions=[WRIST])
    a = by_table(geared, "aba_square_root", [np.zeros(6), np.zeros(6), np.ones(6)], (6,))
    every = TASK_CALLS["forward_dynamics"]
    assert [x for x in every if x not in calls_of(geared, "forward_dynamics", every)] == ["aba_square_root"]
    assert not np.isfinite(a).all()  # no wrong number either where a caller has the kernel itself
    for change in ({"armature": {"roll": 0.1}}, {"rotors": {"pitch": None}}):
        with pytest.raises(sd.ModelError, match="shares motors with another"):
            geared.with_(**change)
    with pytest.raises(sd.ModelError, match="transmissions has 3, expected a Transmission"):
        model.with_(transmissions=[3])  # type: ignore[list-item]


def test_transmissions_are_compared_by_content() -> None:
    again = sd.Transmission(["pitch", "roll"], A.tolist(), J)
    assert again == WRIST
    assert hash(again) == hash(WRIST)
    assert pickle.loads(pickle.dumps(WRIST)) == WRIST
    assert again != sd.Transmission(["pitch", "roll"], A, 2 * J)
    with pytest.raises(ValueError, match="read-only"):
        WRIST.matrix[0, 0] = 1.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"matrix": [[1.0, 1.0], [1.0, 1.0]]}, "expected one with an inverse"),
        ({"matrix": [1.0, 2.0]}, "expected 4 numbers"),
        ({"matrix": [[1.0, np.nan], [0.0, 1.0]]}, "expected finite numbers"),
        ({"rotor_inertia": [1.0, -1.0]}, "expected numbers of 0 or more"),
        ({"joints": ("a", "a")}, "expected names, each once"),
        ({"actuators": ("m",)}, "has 1 actuators, expected 2"),
    ],
)
def test_bad_transmissions_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(sd.ModelError, match=words):
        sd.Transmission(**{"joints": ("a", "b"), "matrix": np.eye(2), **given})


def test_coordinates_that_do_not_fit_are_refused() -> None:
    model = arm()
    with pytest.raises(sd.ShapeError, match=r"v has shape \(3,\), expected \(\.\.\., 6\)"):
        sd.to_actuators(model, WRIST, v=np.zeros(3))
    with pytest.raises(sd.ModelError, match='joint "pitch" is driven by two transmissions'):
        sd.to_joints(model, [WRIST, WRIST], v=np.zeros(6))
    with pytest.raises(sd.ModelError, match='joint "nosuch"'):
        sd.to_joints(model, sd.Transmission("nosuch", 1.0), v=np.zeros(6))
    with pytest.raises(sd.ModelError, match='"root_joint" is floating, expected an independent one of one coordinate'):
        sd.to_joints(arm(True), sd.Transmission("root_joint", 1.0), v=np.zeros(12))
