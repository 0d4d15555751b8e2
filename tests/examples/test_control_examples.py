"""The numbers of the examples of control, against closed forms, balances of forces and symbols."""

from __future__ import annotations

import numpy as np
import pytest
from example_runs import compiled, robots, run

import spatialdyn as sd
from spatialdyn.examples import gallery


@robots
@compiled
def test_computed_torque_and_pd_plus_rest_where_springs_and_payload_balance() -> None:
    found = run("computed_torque_and_pd_plus")
    example = gallery.module("computed_torque_and_pd_plus")
    model, inertia = found["robots"]["as modelled"], np.diagonal(sd.crba(found["robots"]["as modelled"], example.START))
    for load, robot in found["robots"].items():
        for name in ("computed torque", "PD+"):
            e = -found["errors"][name, load][-1]
            q = example.START + example.WAY - e
            springs = sd.crba(model, q) @ (example.KP * e) if name == "computed torque" else inertia * example.KP * e
            weight = sd.generalized_gravity(robot, q) - sd.generalized_gravity(model, q)
            assert abs(springs - weight).max() < 1e-2 * abs(weight).max() + 1e-3
            assert (abs(e[:7]).max() > 1e-2) == (robot is not model)


@compiled
def test_the_pendulum_has_its_energy_and_the_cart_pole_is_caught() -> None:
    """5.55 s is of the notes' own integration; the cart-pole's end is off by what its slowest pole leaves."""
    pytest.importorskip("scipy")
    found = run("swing_up_by_energy")
    assert found["reached"] == pytest.approx(5.55, abs=0.01)
    assert 1.0 < found["caught"] < 8.0
    assert abs(found["end"]).max() < 1e-3


@compiled
def test_lyapunovs_function_of_the_acrobot_never_rises_before_it_is_caught() -> None:
    pytest.importorskip("scipy")
    found = run("acrobot_by_energy")
    assert found["rise"] < 1e-6 * found["V"][0]  # of torques that are held over a step
    assert 1.0 < found["caught"] < 8.0
    off = found["q"][-1] - [np.pi * np.round(found["q"][-1, 0] / np.pi), 0.0]
    assert abs(off).max() < 1e-3
    assert abs(found["v"]).max() < 1e-3
    assert round(found["q"][-1, 0] / np.pi) % 2 == 1
    model, angle = gallery.module("acrobot_by_energy").acrobot(), np.linspace(-np.pi, np.pi, 181)
    q = np.stack(np.meshgrid(angle, angle, indexing="ij"), -1)
    M, lack = sd.crba(model, q), sd.potential_energy(model, [np.pi, 0.0]) - sd.potential_energy(model, q)
    assert (lack * np.linalg.det(M) / M[..., 0, 0]).max() == pytest.approx(35.74, abs=0.01)


@compiled
def test_an_inertia_wheel_is_raised_by_an_energy_that_matches() -> None:
    pytest.importorskip("scipy")
    found = run("inertia_wheel_pendulum")
    example = gallery.module("inertia_wheel_pendulum")
    np.testing.assert_allclose(sd.crba(found["model"], [0.3, 1.0]), [[0.3, 0.2], [0.2, 0.2]], atol=1e-14)
    assert np.diff(found["H_d"]).max() < 1e-9
    assert found["calm", "IDA-PBC", 3.0] == pytest.approx(18.37, abs=0.02)  # of the theory's own equations, integrated
    assert found["H_d"][-1] == pytest.approx(-example.I1 * example.M3 / 0.1, abs=1e-2)
    assert abs(found["IDA-PBC", 3.0][-1]).max() < 0.1
    assert abs(found["LQR", 3.0][-1]).max() < 1e-3
    assert found["poles"].real.max() < 0.0
    assert found["torque", "LQR", 3.0] > 2.0 * found["torque", "IDA-PBC", 3.0]


def test_ida_pbc_matches_in_symbols() -> None:
    """G⊥ (∇V - M_d M⁻¹ ∇V_d) = 0 with G⊥ = (1, 1), and the example's H_d and u are those of the theory."""
    sympy = pytest.importorskip("sympy")
    q1, q2, w1, w2, I1, I2, m3, a1, a2, a3, k, kv = sympy.symbols("q1 q2 w1 w2 I1 I2 m3 a1 a2 a3 k kv", real=True)
    M, M_d, G = sympy.diag(I1, I2), sympy.Matrix([[a1, a2], [a2, a3]]), sympy.Matrix([-1, 1])
    c = -I1 * (a2 + a3) / (I2 * (a1 + a2))
    V, V_d = m3 * sympy.cos(q1), I1 * m3 / (a1 + a2) * sympy.cos(q1) + k * (q2 + c * q1) ** 2 / 2
    q, p = sympy.Matrix([q1, q2]), sympy.Matrix([I1 * w1, I2 * w2])
    left = sympy.Matrix([V]).jacobian(q).T - M_d * M.inv() * sympy.Matrix([V_d]).jacobian(q).T
    assert sympy.simplify(left[0] + left[1]) == 0
    u = (G.T * left)[0] / 2 - kv * (G.T * M_d.inv() * p)[0]
    H = (p.T * M_d.inv() * p)[0] / 2 + V_d
    example = gallery.module("inertia_wheel_pendulum")
    numbers = dict(zip((I1, I2, m3, a1, a2, a3, k, kv), (0.1, 0.2, 10.0, 0.1, -0.2, 0.5, 0.1, 0.05), strict=True))
    x = np.array([0.7, -1.1, 0.4, 2.0])
    at = numbers | dict(zip((q1, q2, w1, w2), x, strict=True))
    assert example.assigned(x, example.NUMBERS, np.sin) == pytest.approx(float(u.subs(at)), rel=1e-12)
    assert example.shaped(x) == pytest.approx(float(H.subs(at)), rel=1e-12)


@robots
@compiled
def test_a_push_is_felt_at_once_and_is_what_it_was() -> None:
    found = run("feeling_a_push")
    assert 0.0 <= found["felt"] <= 0.01
    assert abs(found["force"][:3] - [-15.0, 5.0, 10.0]).max() < 1.0
    assert found["unknown"] > 2.0


@robots
@compiled
def test_poses_that_are_reached_are_a_ring() -> None:
    found = run("grid_of_poses")
    model, grid, result = sd.load_urdf("ur5"), found["poses"], found["found"]
    good, out = result.converged, np.linalg.norm(found["poses"][..., :2, 3], axis=-1)
    assert abs(sd.frame_placement(model, result.q[good], "tool0") - grid[good]).max() < 1e-7
    assert good[(out > 0.2) & (out < 0.85)].all()
    assert not good[out > 0.92].any()
    assert found["arms"] == 8


def test_the_base_of_a_space_robot_turns_by_an_area() -> None:
    """By the angular momentum of three bodies in a plane, written out."""
    found = run("space_robot")
    fast, slow, back = (found[x][-1] for x in ("once round in 1 s", "once round in 10 s", "the other way round"))
    assert fast == pytest.approx(slow, abs=1e-12)
    assert back == pytest.approx(-slow, rel=1e-3)
    assert abs(found["a line and back"][-1]) < 1e-4
    q, dq = gallery.module("space_robot").joints("circle", np.linspace(0.0, 1.0, 4001))
    angle, rate = np.cumsum(q, 1), np.cumsum(dq, 1)
    way, slope = np.exp(1j * angle), 1j * rate * np.exp(1j * angle)
    place = np.stack([0.0 * way[:, 0], 0.5 + 0.5 * way[:, 0], 0.5 + way[:, 0] + 0.5 * way[:, 1]], 1)
    speed = np.stack([0.0 * way[:, 0], 0.5 * slope[:, 0], slope[:, 0] + 0.5 * slope[:, 1]], 1)
    m = np.array([20.0, 4.0, 4.0])
    place, speed = (x - (x @ m / m.sum())[:, None] for x in (place, speed))
    spin = 0.35 * rate.sum(1) + (place.conj() * speed).imag @ m
    turn = -spin / (2.0 + 0.7 + abs(place) ** 2 @ m)
    assert slow == pytest.approx(np.mean(turn[:-1]), abs=1e-4)  # of a periodic function: its mean is its integral


@compiled
def test_what_a_law_leaves_out_costs_by_gear() -> None:
    found = run("what_a_law_leaves_out")
    for time in (2.0, 1.0, 0.5):
        assert found[1.0, time, "C v"] > 10.0 * found[1.0, time, "rotors"]
        assert found[50.0, time, "rotors"] > 50.0 * found[50.0, time, "C v"]
        assert found[50.0, time, "nothing"] < 2e-3
    assert found[1.0, 1.0, "C v"] > 2.0 * found[1.0, 2.0, "C v"]
    assert found[50.0, 0.0, "share"] > 5.0 * found[10.0, 0.0, "share"]


@robots
@compiled
def test_a_hand_presses_with_what_its_spring_is_short_of() -> None:
    found = run("pressing_on_a_wall")
    assert found["force"][-1] == pytest.approx(24.0, rel=1e-3)
    np.testing.assert_allclose(found["exact"], 0.7, rtol=1e-6)
    assert found["root"].max() - found["root"].min() > 0.5
    assert found["hand"] < 1e-6 < 1e-3 < found["elbow"]


@robots
@compiled
def test_masses_are_learnt_and_only_christoffels_c_has_a_proof() -> None:
    found = run("learning_masses")
    for name in ("Euclidean", "natural"):
        _, error, least = found[name]
        assert error[-200:].max() < 0.1 * error.max()
        assert (least.min() > 0.0) == (name == "natural")
    falls, rises = found["V"]
    assert (np.diff(falls) < 0.0).all()
    assert (np.diff(rises) > 0.0).any()
    assert 0 < found["seen"].rank < found["seen"].parameters


@robots
@compiled
def test_a_quadruped_stands_through_a_push() -> None:
    pytest.importorskip("qpsolvers")
    _, _, off, up = run("pushed_while_standing")["Solo12"]
    assert 5e-3 < off.max() < 0.06
    assert off[-1] < 0.2 * off.max()
    assert up


@robots
@compiled
@pytest.mark.slow(quick="test_a_quadruped_stands_through_a_push")
def test_what_robots_survive_and_what_not() -> None:
    """The impulses that the example finds, 10 s of both; a push of twice that of Talos throws it."""
    pytest.importorskip("qpsolvers")
    from spatialdyn.examples.pushed_while_standing import solo, stand, standing, talos

    humanoid = standing(talos(), "torso_2_link")
    for robot, impulse in ((standing(solo(), "base_link"), 3.0), (humanoid, 30.0)):
        _, off, up = stand(robot, impulse, 10.0)
        assert up
        assert off[-1] < 1e-3
    assert not stand(humanoid, 60.0, 2.1)[2]
