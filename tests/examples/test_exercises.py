"""The chapter's exercises and its troubleshooting table: the numbers against closed forms, identities and Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest
from example_runs import G, compiled, run
from wheel import pin

import spatialdyn as sd
from spatialdyn.examples import gallery
from spatialdyn.urdf.load import find_robot


def test_exercise_1_has_the_numbers_in_surds() -> None:
    pytest.importorskip("mpmath")
    found, root2 = run("exercise_1_numbers"), np.sqrt(2.0)
    cos75 = (np.sqrt(6.0) - root2) / 4
    np.testing.assert_allclose(found["eigenvalues"], [1.0 - root2 / 2, 3.0 + 1.5 * root2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(found["(b) C q̇"], [3.0 * root2 / 8, root2 / 2], rtol=0, atol=1e-13)
    g = G * np.array([np.sqrt(3.0) + cos75, cos75])
    np.testing.assert_allclose(found["(b) g"], g, rtol=0, atol=1e-13)
    tau = np.array([0.1 + 3.0 * root2 / 8, -0.1 + 0.05 * root2 + root2 / 2]) + g
    np.testing.assert_allclose(found["(c) τ"], tau, rtol=0, atol=1e-13)


def test_exercise_3_c_is_zero_until_the_length_can_change() -> None:
    found, (m, l, theta, omega) = run("exercise_3_pendulum"), (1.5, 0.8, 0.7, 2.0)
    assert found["M"][0, 0] == pytest.approx(m * l**2, rel=1e-15)
    assert found["C"][0, 0] == 0.0
    assert found["g"][0] == pytest.approx(m * G * l * np.cos(theta), rel=1e-14)
    np.testing.assert_allclose(found["Cv"], [2 * m * l * 0.5 * omega, -m * l * omega**2], rtol=1e-14)
    np.testing.assert_allclose(found["M elastic"], np.diag([m * l**2, m]), rtol=0, atol=1e-15)


def test_exercise_4_equals_lagranges_method() -> None:
    pytest.importorskip("sympy")
    found = run("exercise_4_spatial_arm")
    assert set(found) == {"M", "C", "g"}
    for equal, difference in found.values():
        assert equal is True
        assert difference < 1e-14 * 100


@pytest.mark.slow(quick="simulation/test_integrators.py::test_energy_of_symplectic_methods_stays_bounded")
@compiled
def test_exercise_5_verlets_error_stays_and_rk4s_is_smaller_and_grows() -> None:
    found = run("exercise_5_hamilton")
    tenth = {name: off[: len(off) // 10].max() for name, off in found.items()}
    for system, verlet in {"arm": "arm, stormer_verlet", "pendulum": "pendulum, Verlet"}.items():
        rk4 = f"{system}, rk4"
        assert found[rk4].max() > 3.0 * tenth[rk4]
        assert found[verlet].max() < 1.2 * tenth[verlet]
        assert found[verlet].max() > 100.0 * found[rk4].max()
    explicit = "arm, Verlet of section 15.3"
    assert found[explicit].max() > 3.0 * tenth[explicit]
    # the pendulum's by a loop of its own: p' = p - h/2 sin, q' = q + h p, p' again
    q, p, h, worst = 1.0, 0.0, 0.01, 0.0
    for _ in range(20_000):
        p -= 0.5 * h * G * np.sin(q)
        q += h * p
        p -= 0.5 * h * G * np.sin(q)
        worst = max(worst, abs(0.5 * p * p - G * np.cos(q) + G * np.cos(1.0)))
    assert found["pendulum, Verlet"].max() == pytest.approx(worst, rel=1e-6)


@compiled
def test_exercise_7_both_ways_agree_and_symbols_cost_more() -> None:
    rows = run("exercise_7_two_ways_to_coriolis")["rows"]
    assert (rows[:, 1] < 1e-13).all()
    n, rnea, symbols = rows[:, 0], rows[:, 2], rows[:, 4]
    assert (symbols > 2 * n**3).all()
    assert rnea[1] < symbols[1]
    assert symbols[1] / symbols[0] > 2 * rnea[1] / rnea[0]


def test_last_exercise_1_has_the_chapters_symbols() -> None:
    sympy = pytest.importorskip("sympy")
    found = run("last_exercise_1_christoffel")
    arm, c = found["arm"], found["symbols"]
    m2, l1, lc2 = sympy.Symbol("m_2", positive=True), sympy.Symbol("l_1", real=True), sympy.Symbol("l_c2", real=True)
    h = -m2 * l1 * lc2 * sympy.sin(arm.q[1])
    expected = {(0, 0, 1): h, (0, 1, 0): h, (0, 1, 1): h, (1, 0, 0): -h}
    for index in np.ndindex(2, 2, 2):
        assert sympy.expand(c[index] - expected.get(index, 0)) == 0
    I1, I2, lc1 = sympy.symbols("I_1 I_2 l_c1", real=True)
    m1 = sympy.Symbol("m_1", positive=True)
    M11 = m1 * lc1**2 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * sympy.cos(arm.q[1])) + I1 + I2
    assert sympy.expand(arm.M()[0, 0] - M11) == 0
    v1, v2 = arm.v
    N12 = -h * (2 * v1 + v2)
    assert sympy.expand(found["N"][0, 1] - N12) == 0
    assert sympy.expand(found["N"][1, 0] + N12) == 0
    assert found["number"] == 0


def test_last_exercise_2_legendre_and_power_vanish_as_expressions() -> None:
    pytest.importorskip("sympy")
    found = run("last_exercise_2_legendre")
    assert found["legendre"] == 0
    assert found["power"] == 0
    assert found["difference"] < 1e-14 * 100
    q, p, tau = np.array([0.4, -1.1]), np.array([0.7, 0.2]), np.array([0.3, -0.5])
    c, s = np.cos(q[1]), np.sin(q[1])  # by hand, section 8.1 with l = m = 1
    v = np.linalg.solve([[3 + 2 * c, 1 + c], [1 + c, 1.0]], p)
    g = G * np.array([2 * np.cos(q[0]) + np.cos(q.sum()), np.cos(q.sum())])
    np.testing.assert_allclose(found["numbers"][0], v, rtol=1e-13)
    by_q2 = 0.5 * v @ (np.array([[-2 * s, -s], [-s, 0.0]]) @ v)
    np.testing.assert_allclose(found["numbers"][1], np.array([0.0, by_q2]) - g + tau, rtol=1e-12)


def test_last_exercise_3_the_diagonal_is_not_all_of_m() -> None:
    found = run("last_exercise_3_mass_matrix")
    M, q = found["M"], np.array([0.5, 0.3, -0.2])
    s2, s23 = np.sin(0.3), np.sin(0.1)  # three rods of 1 m and 1 kg, 5 cm thick
    M23 = 0.5 * np.cos(-0.2) + 1 / 3
    assert M[1, 2] == pytest.approx(M23, rel=1e-14)
    across, axial = 1 / 12, 0.00125
    M11 = (0.5 * s2) ** 2 + (s2 + 0.5 * s23) ** 2 + across * (s2**2 + s23**2) + axial * (1 + 2 - s2**2 - s23**2)
    assert M[0, 0] == pytest.approx(M11, rel=1e-13)
    np.testing.assert_allclose(found["T"], 0.5 * np.diag(M), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found["polarised"], M, rtol=0, atol=1e-14)
    assert abs(M - np.diag(np.diag(M))).max() > 0.5  # what the check of the diagonal does not see
    assert found["errors"].argmin() in (5, 6, 7)  # ε of 1e-9 to 1e-7
    assert found["errors"].min() > 1e-10
    assert abs(found["exact"] + found["exact"].T).max() < 1e-14
    theirs = pin.buildModelFromUrdf(str(find_robot("three_link")))
    pairs = np.column_stack([np.cos(q), np.sin(q)]).ravel()  # its joints are continuous
    np.testing.assert_allclose(M, pin.crba(theirs, theirs.createData(), pairs), rtol=0, atol=1e-14)


@pytest.mark.slow(quick="recursions/test_dynamics.py::test_call_equals_the_dense_oracle")
@compiled
def test_last_exercise_5_the_sign_that_keeps_angular_momentum() -> None:
    found = run("last_exercise_5_single_body")
    (x, y, z), I = (0.02, 3.0, 0.01), (1.0, 2.0, 3.0)
    euler = [(I[1] - I[2]) * y * z / I[0], (I[2] - I[0]) * z * x / I[1], (I[0] - I[1]) * x * y / I[2]]
    np.testing.assert_allclose(found["library"], euler, rtol=1e-13)
    np.testing.assert_allclose(found["euler"], euler, rtol=1e-13)
    np.testing.assert_allclose(found["chapter"], [-a for a in euler], rtol=1e-13)
    assert abs(found["L"] - found["L"][0]).max() < 1e-9
    omega = found["omega"]
    assert omega[:, 1].min() < -2.9
    assert omega[-1, 1] > 2.5  # and back
    T = 0.5 * (omega**2) @ I
    assert abs(T - T[0]).max() < 1e-4 * T[0]


# --- the troubleshooting table ----------------------------------------------------------------------------


def made(symptom: str) -> tuple[str, object]:
    text, found = getattr(gallery.module("troubleshooting"), symptom)()
    return text, found


def test_cholesky_fails_and_diagnose_names_the_link() -> None:
    text, finding = made("mass_matrix_is_not_positive_definite")
    assert finding.link == "forearm"
    assert finding.severity in ("warning", "error")
    assert "-0.02" in text


def test_what_is_left_of_the_terms_names_the_wrong_one() -> None:
    _, left = made("rnea_differs_from_its_terms")
    assert left["v = a = 0"] < 1e-14 * 50
    assert left["a = 0"] < 1e-14 * 50
    model = sd.load_urdf("three_link")
    M = sd.crba(model, [0.5, -0.3, 0.8])
    assert left["v = 0"] == pytest.approx(abs(np.tril(M, -1) @ [0.3, 0.1, -0.2]).max(), rel=1e-12)


def test_another_c_is_weak_and_not_strong() -> None:
    _, (found, difference) = made("coriolis_matrix_is_not_skew")
    assert abs(found.weak) < 1e-14 * 50
    assert found.strong > 0.1
    assert abs(difference).max() < 1e-14 * 10


def test_the_controller_gains_energy_with_the_other_c_alone() -> None:
    _, rates = made("controller_gains_energy")
    assert rates["Christoffel's C"] == pytest.approx(-0.02, abs=1e-12)
    assert rates["another C"] > 0.0


@pytest.mark.slow(quick="simulation/test_integrators.py::test_energy_of_the_others_drifts")
@compiled
def test_a_slope_of_energy_stands_out_of_its_error_unless_symplectic() -> None:
    _, reports = made("energy_drifts")
    assert abs(reports["rk4"].slope) > 10.0 * reports["rk4"].slope_error
    assert abs(reports["velocity_verlet"].slope) > 10.0 * reports["velocity_verlet"].slope_error
    assert abs(reports["stormer_verlet"].slope) < abs(reports["velocity_verlet"].slope) / 10.0


def test_terms_apart_show_another_zero_of_the_angle() -> None:
    _, found = made("formula_differs_from_the_library")
    assert found["M"] < 1e-14
    assert found["g"] > 1.0
    assert found["g at q1 - 90°"] < 1e-13


def test_motion_raises_the_rank_to_what_can_be_known() -> None:
    _, ranks = made("parameters_do_not_converge")
    # counted by hand: of 30, the first body's Izz; of the second and third, axes parallel, what Khalil's rules leave
    theirs = pin.buildModelFromUrdf(str(find_robot("three_link")))
    data, rng, rows = theirs.createData(), np.random.default_rng(5), []
    for _ in range(100):
        q = rng.uniform(-3, 3, 3)
        pairs = np.column_stack([np.cos(q), np.sin(q)]).ravel()
        rows.append(pin.computeJointTorqueRegressor(theirs, data, pairs, rng.normal(size=3), rng.normal(size=3)).copy())
    assert ranks["one pose"] < ranks["poses"] < ranks["motion"]
    assert ranks["motion"] == np.linalg.matrix_rank(np.concatenate(rows), tol=1e-9)


def test_what_rotors_leave_is_their_inertia() -> None:
    _, slope = made("rotors_spoil_identification")
    np.testing.assert_allclose(slope, 0.2, rtol=1e-12)


@pytest.mark.slow(quick="test_what_is_left_of_the_terms_names_the_wrong_one")
@compiled
def test_the_page_shows_every_symptom(capsys: pytest.CaptureFixture[str]) -> None:
    found = run("troubleshooting")
    assert len(found) == 8
    assert capsys.readouterr().out.count("found by  ") == 8
