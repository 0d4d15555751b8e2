"""The numbers of the examples, against closed forms, conservation, exact arithmetic or Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest
from example_runs import G, compiled, robots, run
from operation_costs import count_operations
from wheel import pin

import spatialdyn as sd
from spatialdyn.examples import gallery
from spatialdyn.urdf.load import find_robot


def gravity_of_two_links(q: np.ndarray) -> np.ndarray:
    """Section 8.1 with l = m = 1."""
    both = np.cos(q[..., 0] + q[..., 1])
    return G * np.stack([2.0 * np.cos(q[..., 0]) + both, both], -1)


def energy_of_two_links(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """T + V of two point masses, from their positions and velocities."""
    angle, rate = np.stack([q[..., 0], q[..., 0] + q[..., 1]], -1), np.stack([v[..., 0], v[..., 0] + v[..., 1]], -1)
    x, y = np.cumsum(-np.sin(angle) * rate, -1), np.cumsum(np.cos(angle) * rate, -1)
    return np.sum(0.5 * (x**2 + y**2) + G * np.cumsum(np.sin(angle), -1), -1)


def test_first_steps_by_hand_and_by_library_differ_by_rounding() -> None:
    found = run("first_steps")
    assert set(found) == {"M", "C", "C v + g", "g", "tau", "a", "T", "V"}
    assert max(found.values()) < 2e-14


def test_arms_in_symbols_have_the_chapters_entries_and_the_rotation_it_leaves_out() -> None:
    sympy = pytest.importorskip("sympy")
    found = run("arms_in_symbols")
    l1, l2, m1, m2 = sympy.symbols("l_1 l_2", real=True) + sympy.symbols("m_1 m_2", positive=True)
    q2, planar = found["planar"].q[1], found["planar"]
    M11 = (m1 + m2) * l1**2 + m2 * l2**2 + 2 * m2 * l1 * l2 * sympy.cos(q2)
    assert sympy.expand(planar.M()[0, 0] - M11) == 0
    assert planar.C()[1, 0] == m2 * l1 * l2 * sympy.sin(q2) * planar.v[0]
    m, l = sympy.symbols("m_1:4", positive=True), sympy.symbols("l_1:4", positive=True)
    assert found["rods"].M()[2, 2] == m[2] * l[2] ** 2 / 3
    assert found["points"].M()[2, 2] == m[2] * l[2] ** 2 / 4
    assert found["missing"][1, 2] == m[2] * l[2] ** 2 / 12
    at = dict.fromkeys((*m, *l), 1) | dict(zip(found["rods"].q, (0.5, 0.3, -0.2), strict=True))
    thick = sd.load_urdf("three_link")
    thin = np.array(found["rods"].M().subs(at), dtype=float)
    # the file's rods are 5 cm thick: 0.00125 kg m² about their own axes, which the first row alone sees
    np.testing.assert_allclose(sd.crba(thick, [0.5, 0.3, -0.2])[1:, 1:], thin[1:, 1:], atol=1e-14)


def test_a_four_bar_and_a_slider_crank_move_as_their_one_freedom() -> None:
    """θ̈ by Lagrange's equation of one freedom; RATTLE's energy of order h² = 1.6e-5 s², rk4's by its small drift."""
    found = run("four_bar_and_slider_crank")
    assert found["a"] == pytest.approx(-24.563653911232, abs=1e-11)
    assert found["loop"] < 1e-9
    assert found["piston"] < 1e-9
    assert found["RATTLE"] < 1.3e-3
    assert found["rk4"] < 1e-3
    assert found["turns"] > 2 * np.pi


def test_a_sleigh_glides_on_and_a_disc_falls_over() -> None:
    found = run("sleigh_and_rolling_disc")
    assert (found["u"], found["w"]) == pytest.approx((1.2187797062, 0.1214964200), abs=1e-10)
    assert found["sleigh"] < 1e-9
    assert found["slow"] > 0.3
    assert found["fast"] < 0.0025


def test_a_blade_on_a_slope_stays_up_where_a_variation_lets_it_down() -> None:
    found = run("rolling_is_no_variation")
    assert found["off"] < 1e-8
    assert found["down"] == pytest.approx(G * np.sin(0.3) / 8.0, abs=1e-6)
    assert found["slid"] > 10 * found["down"]


@robots
@compiled
def test_gravity_compensation_holds_what_it_knows_and_equals_pinocchios() -> None:
    found = run("gravity_compensation")
    theirs = pin.buildModelFromUrdf(str(find_robot("panda")))
    data = theirs.createData()
    np.testing.assert_allclose(found["g"], pin.computeGeneralizedGravity(theirs, data, found["q"]), rtol=0, atol=1e-12)
    # virtual work of 2 kg at 10 cm from the flange: Jᵀ m g
    J = pin.computeFrameJacobian(theirs, data, found["q"], theirs.getFrameId("panda_link8"), pin.LOCAL_WORLD_ALIGNED)
    R = pin.updateFramePlacement(theirs, data, theirs.getFrameId("panda_link8")).rotation
    arm = R @ [0.0, 0.0, 0.1]
    lever = J[2] + arm[1] * J[3] - arm[0] * J[4]  # the z row at the load: v + ω × r
    np.testing.assert_allclose(found["loaded"] - found["g"], 2.0 * G * lever, rtol=0, atol=1e-12)
    known, unknown, nothing = found["fall"]
    assert abs(known) < 1e-9
    assert 0.1 < unknown < nothing


@robots
def test_inverse_kinematics_reaches_the_pose_or_the_nearest_one() -> None:
    found = run("inverse_kinematics")
    theirs = pin.buildModelFromUrdf(str(find_robot("panda")))
    frame = theirs.getFrameId("panda_link8")

    def pose(q: np.ndarray) -> np.ndarray:
        data = theirs.createData()
        pin.framesForwardKinematics(theirs, data, q)
        return np.array(data.oMf[frame].homogeneous)

    start = gallery.module("inverse_kinematics").START
    target = pose(start + 0.3)
    for damping in ("0", "0.05", "0.5"):
        assert abs(pose(found[f"within reach, λ = {damping}"][0]) - target).max() < 1e-11
    _, errors, largest, slope = found["1.5 m away, λ = 0.5"]
    assert abs(slope).max() < 1e-3
    assert 0.5 < errors[-1] < 0.8
    assert largest < 1.0
    assert found["1.5 m away, λ = 0"][2] > 10.0
    steps = [len(found[f"within reach, λ = {damping}"][1]) for damping in ("0", "0.05", "0.5")]
    assert steps == sorted(steps)


@compiled
def test_pd_rests_where_springs_and_gravity_balance() -> None:
    found, q_d = run("pd_with_gravity"), np.array([np.pi / 2, 0.3])
    q = found["PD"]
    np.testing.assert_allclose(60.0 * (q_d - q), gravity_of_two_links(q), atol=1e-8)
    assert abs(q - q_d).max() > 0.1
    for name in ("PD + g(q_d)", "PD + g(q), Kp 15"):
        np.testing.assert_allclose(found[name], q_d, rtol=0, atol=1e-8)
    q = found["PD + g(q_d), Kp 15"]
    np.testing.assert_allclose(15.0 * (q_d - q) + gravity_of_two_links(q_d), gravity_of_two_links(q), atol=1e-6)
    assert abs(q - q_d).max() > 1.0
    h = 1e-5  # the slope of g: a central difference of the closed form
    slope = [(gravity_of_two_links(q_d + h * e) - gravity_of_two_links(q_d - h * e)) / (2 * h) for e in np.eye(2)]
    assert found["slope"] == pytest.approx(np.linalg.norm(slope, 2), rel=1e-8)
    assert 15.0 < found["slope"] < 60.0


@pytest.mark.slow(quick="simulation/test_integrators.py::test_energy_of_symplectic_methods_stays_bounded")
@compiled
def test_double_pendulum_bounded_where_symplectic_and_growing_where_not() -> None:
    found = run("double_pendulum")
    for errors in found.values():
        assert list(errors) == [x for x in sd.integrators if x in gallery.module("double_pendulum").METHODS]
    smooth, violent = found.values()
    for method, off in smooth.items():
        if sd.integrators[method].symplectic:
            assert off[-1] < 1.2 * off[2] + 1e-12, method
    assert smooth["rk4"][-1] > 3.0 * smooth["rk4"][1]
    assert smooth["explicit_euler"][-1] > 10.0 * smooth["explicit_euler"][1]
    assert smooth["stormer_verlet"][-1] > 1000.0 * smooth["rk4"][-1]  # the chapter has it the other way round
    assert violent["velocity_verlet"][-1] > violent["stormer_verlet"][-1]
    (q0, _), model = gallery.module("double_pendulum").STARTS.values(), sd.load_urdf("two_link")
    motion = sd.simulate(model, q0, [0.0, 0.0], 10.0, 0.01, "rk4", record=1)
    energy = energy_of_two_links(motion.q, motion.v)
    assert abs(energy - energy[0]).max() == pytest.approx(smooth["rk4"][-1], rel=1e-4)


@robots
@compiled
def test_falling_quadruped_keeps_momentum_and_turns() -> None:
    found = run("falling_quadruped")
    t, h, com = found["t"], found["h"], found["com"]
    mass = pin.computeTotalMass(pin.buildModelFromUrdf(str(find_robot("solo12")), pin.JointModelFreeFlyer()))
    np.testing.assert_allclose(h[:, 2], -mass * G * t, rtol=0, atol=1e-5)
    assert abs(h[:, :2]).max() < 1e-5
    assert abs(h[:, 3:]).max() < 1e-5 * found["swapped"]
    np.testing.assert_allclose(com[:, 2] - com[0, 2], -0.5 * G * t**2, rtol=0, atol=1e-6)
    assert found["turn"][-1] > 10.0


@robots
@compiled
def test_standing_lqr_takes_a_push_that_held_torques_do_not() -> None:
    pytest.importorskip("scipy")
    found = run("standing_lqr")
    assert found["left"] < 1e-10  # motions that keep the feet in place stay among themselves
    assert found["A"].shape == (12, 12)
    assert found["before"][0] > 1.005
    assert found["after"][0] < 0.99
    off = {name: abs(x.q[:, :3] - found["q"][:3]) for name, x in found["runs"].items()}
    assert off["LQR"].max() < 0.03
    assert off["LQR"][-1].max() < 1e-4
    assert off["torques held"][-1].max() > 0.1


@compiled
def test_cart_pole_has_its_textbook_matrices_and_comes_up() -> None:
    pytest.importorskip("scipy")
    found, (M, m, l) = run("cart_pole_lqr"), (1.0, 0.2, 0.5)
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2, 1], A[3, 1] = -m * G / M, (M + m) * G / (M * l)
    np.testing.assert_allclose(found["A"], A, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["B"][:, 0], [0.0, 0.0, 1.0 / M, -1.0 / (M * l)], rtol=0, atol=1e-12)
    A, B, P = found["A"], found["B"], found["P"]
    riccati = A.T @ P + P @ A - P @ B @ B.T @ P / 0.1 + np.diag([1.0, 1.0, 0.1, 0.1])
    assert abs(riccati).max() < 1e-9 * abs(P).max()
    assert found["poles"].real.max() < -1.0
    for angle in (0.1, 0.4):
        assert abs(found["runs"][angle].q[-1]).max() < 1e-2
    assert abs(found["runs"][1.1].q[-1]).max() > 1.0


@robots
@compiled
def test_payload_is_found_within_its_deviations() -> None:
    found = run("payload_identification")
    true = found["true"]
    # by the parallel axis theorem, written out: Ixx + m (c_y² + c_z²), Ixy - m c_x c_y
    assert true[4] == pytest.approx(4e-3 + 1.7 * (0.02**2 + 0.08**2), rel=1e-14)
    assert true[5] == pytest.approx(1.7 * 0.03 * 0.02, rel=1e-14)
    assert (found["rank at rest"], found["rank moving"]) == (4, 10)
    assert (abs(found["moving"] - true) < 5.0 * found["deviation moving"]).all()
    assert (found["deviation moving"] < 1e-3).all()
    np.testing.assert_allclose(found["at rest"][:4], true[:4], rtol=0, atol=2e-3)
    assert abs(found["at rest"][4:]).max() < 1e-12  # the least-norm solution has none of what is not seen
    np.testing.assert_allclose(found["load"], true, rtol=0.05, atol=5e-3)
    assert found["carried"] - found["load"][0] == pytest.approx(sd.load_urdf("ur5").total_mass, rel=1e-12)


@robots
@compiled
def test_a_panda_is_found_from_an_exciting_path() -> None:
    pytest.importorskip("matplotlib")
    found = run("panda_identification")
    assert found["base"].rank == 43
    assert all(values[0] > 0.0 for values in found["log_cholesky"].eigenvalues.values())
    assert min(values[0] for values in found["wls"].eigenvalues.values()) < 0.0
    assert found["after"] < 0.1 * found["before"]
    assert "Another motion" in found["page"]


def test_friction_takes_a_slow_and_a_fast_motion() -> None:
    found = run("friction_of_a_joint")
    for name, fit in ((k, x) for k, x in found.items() if k != "scene"):
        assert (abs(fit.beta - [0.15, 0.8, 0.2]) < 2.0 * fit.half_width).all(), name
    assert found["slow"].half_width[0] > 10.0 * found["both"].half_width[0]
    assert found["fast"].half_width[1] > 2.0 * found["both"].half_width[1]
    assert found["scene"].friction.coulomb[0] == found["both"].parameters[1]


@robots
@compiled
def test_payloads_on_lanes_equal_pinocchios_one_by_one(capsys: pytest.CaptureFixture[str]) -> None:
    found = run("payloads_on_lanes")
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("panda_joint")]
    for size, row in zip(abs(found["tau"]).T, rows, strict=True):
        worst, limit, share = float(row[3]), float(row[4]), float(row[5].rstrip("%"))
        assert worst == pytest.approx(size.max(), abs=0.01)
        assert share == pytest.approx(100.0 * (size > limit).mean(), abs=0.01)
    (q, v, a), n = found["state"], 5
    whole = pin.buildModelFromUrdf(str(find_robot("panda")))
    fingers = [whole.getJointId(f"panda_finger_joint{k}") for k in (1, 2)]
    for load, tau in zip(found["loads"][:n], found["tau"][:n], strict=True):
        theirs = pin.buildReducedModel(whole, fingers, pin.neutral(whole))
        hand = theirs.frames[theirs.getFrameId("panda_hand")]
        xx, xy, xz, yy, yz, zz = load[4:]
        body = pin.Inertia(load[0], load[1:4], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        theirs.inertias[hand.parentJoint] += hand.placement.act(body)
        np.testing.assert_allclose(tau, pin.rnea(theirs, theirs.createData(), q, v, a), rtol=0, atol=1e-11)
    assert found["tau"].shape == (2000, 7)


def test_series_elastic_joint_has_the_frequency_and_the_blow_of_two_inertias_and_a_spring() -> None:
    found = run("series_elastic_joint")
    for k, x in found.items():
        assert x["rate"] == pytest.approx(np.sqrt(k * (1 / 0.2 + 1 / 0.25)), rel=1e-14)
        assert x["simulated rate"] == pytest.approx(x["rate"], rel=1e-5)
        assert x["simulated"] == pytest.approx(x["torque"], rel=1e-4)
        assert x["energy"] < 1e-8


@compiled
def test_rotor_on_a_leg_finds_the_diagonal_off_by_one_over_n() -> None:
    found = run("rotor_on_a_leg")
    assert [*found] == [6.0, 7.0, 8.0, 9.0, 10.0, 37.0]
    for n, x in found.items():
        assert x["bodies"] < 1e-13
        assert x["rotors"] * n == pytest.approx(found[37.0]["rotors"] * 37.0, rel=0.15)
    assert 0.1 < found[6.0]["rotors"] < 0.3
    assert found[37.0]["a"] < 0.03 < found[6.0]["a"]


@compiled
def verdicts(found: sd.Requirement) -> dict[tuple[str, str], str]:
    return {(x.part, x.form): x.verdict for x in found.rows}


@compiled
def test_rotors_of_a_geared_arm_are_armatures_at_a_coarse_tolerance_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    count_operations(monkeypatch)
    coarse, fine = run("rotors_of_a_geared_arm").values()
    assert verdicts(coarse)["rotors", "armatures"] == "left out"
    assert verdicts(fine)["rotors", "armatures"] == verdicts(fine)["rotors", "left out"] == "needed"
    assert fine.bound <= fine.tolerance


@robots
@compiled
def test_what_a_scene_requires_are_three_parts_of_nine(monkeypatch: pytest.MonkeyPatch) -> None:
    count_operations(monkeypatch)
    found = run("what_a_scene_requires")
    assert found.needed == ("friction", "rotors", "gravity")
    assert len({x.part for x in found.rows} - {"method"}) == 9
    assert found.scene.acts == ("friction",)
    assert found.bound <= found.tolerance


@robots
@compiled
def test_standing_does_without_the_damping_that_trotting_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    count_operations(monkeypatch)
    standing, trotting = run("standing_or_trotting").values()
    assert verdicts(standing)["friction", "left out"] == "left out"
    assert verdicts(trotting)["friction", "left out"] == "needed"
    for found in (standing, trotting):
        assert verdicts(found)["contacts", "left out"] == verdicts(found)["gravity", "left out"] == "needed"
    assert trotting.fine[1] < standing.fine[1]


def test_price_of_a_digit_keeps_its_promises_in_new_states() -> None:
    pytest.importorskip("mpmath")
    found = run("price_of_a_digit", robot="two_link")
    for tolerance in (1e-3, 1e-12):
        option, error = found[f"{tolerance:g}"]
        assert option.bound <= tolerance
        assert 0.0 < error <= tolerance
    assert found["table"].model == "two_link"


@compiled
def test_own_loop_flips_nothing_that_lacks_the_energy() -> None:
    found = run("own_loop")
    starts, flips = found["starts"], found["flips"]
    lacking = 2 * np.cos(starts[:, 0]) + np.cos(starts[:, 1]) > 1.0
    assert lacking.sum() > 100
    assert not np.isfinite(flips[lacking]).any()
    assert np.isfinite(flips[~lacking]).mean() > 0.5
    mirrored = flips.reshape(24, 24)[::-1, ::-1].ravel()  # θ -> -θ is a symmetry; late flips are chaotic
    early = flips < 2.0
    assert early.sum() > 50
    assert (abs(flips - mirrored)[early] < 0.03).all()


@compiled
def test_processes_and_cuts_change_no_bit() -> None:
    found = run("many_processes")
    assert found["here"] == found["there"]
    assert len(found["here"]) == 6
    assert 1 <= len(found["processes"]) <= 2
    assert max(abs(energy) for energy, _ in found["here"]) < 1e-8


@compiled
def test_c_export_gives_the_librarys_torques() -> None:
    found = run("c_export")
    assert "void torque(const double *q, const double *v, const double *a, double *tau)" in found["code"]
    if found["difference"] is None:
        pytest.skip("no C compiler")
    assert found["difference"] < 1e-13


def test_ported_script_gives_pinocchios_numbers() -> None:
    found = run("porting_a_pinocchio_script")
    for name in ("tau", "M", "h", "g"):
        np.testing.assert_allclose(found["spatialdyn"][name], found["Pinocchio"][name], rtol=0, atol=1e-12)
    assert {use.name for use in found["uses"]} >= {"buildModelFromUrdf", "rnea", "crba"}
    assert all(use.status.startswith("supported") for use in found["uses"])
    assert max(found["spatialdyn"]["residuals"].values()) < 1e-8  # a central difference of a step of 1e-6


@compiled
def test_vector_environment_steps_as_the_equations_say() -> None:
    assert run("vector_environment")["linear"] == 0 < run("vector_environment")["random"]
    environment = gallery.module("vector_environment").CartPoles(3, horizon=2)
    x, info = environment.reset(seed=3)
    assert x.shape == (3, 4)
    assert info == {}
    force = np.array([[0.5], [-1.0], [9.0]])  # the last is clipped to 1
    observed, reward, terminated, truncated, _ = environment.step(force)
    M, m, l = 1.0, 0.2, 0.5
    s, c, F = np.sin(x[:, 1]), np.cos(x[:, 1]), 10.0 * np.clip(force[:, 0], -1.0, 1.0)
    # cart and point mass: (M + m) ẍ + m l (c θ̈ - s θ̇²) = F, l θ̈ + c ẍ = G s
    cart = (F + m * l * s * x[:, 3] ** 2 - m * G * s * c) / (M + m * s**2)
    v = x[:, 2:] + 0.02 * np.stack([cart, (G * s - c * cart) / l], 1)
    np.testing.assert_allclose(observed, np.concatenate([x[:, :2] + 0.02 * v, v], 1), rtol=0, atol=1e-13)
    assert (reward == 1.0).all()
    assert not terminated.any()
    assert not truncated.any()
    observed, _, _, truncated, info = environment.step(force)
    assert truncated.all()
    assert abs(observed).max() <= 0.05 < abs(info["final_obs"]).max()


@compiled
def test_a_dry_oscillator_stops_beside_its_rest_and_a_belt_makes_it_stick() -> None:
    found = run("stick_slip")
    x, v = found["implicit"]
    assert x == pytest.approx(-0.01, abs=3e-8)
    assert v == 0.0
    assert found["smooth"][1] == pytest.approx(1e-3 * np.arctanh(-100.0 * found["smooth"][0] / 2.0), rel=1e-3)
    assert found["slip"] == pytest.approx(0.471239, abs=2e-4)
    assert found["stick"] == pytest.approx(0.2, abs=2e-4)


@compiled
def test_an_energy_ledger_closes_with_the_order_of_its_method() -> None:
    found = run("energy_ledger")
    for way, order in (("implicit", 1), ("smooth", 4)):
        errors = [abs(found[way, dt].error[-1]) for dt in (2e-3, 1e-3, 5e-4)]
        assert errors[1] / errors[2] == pytest.approx(2.0**order, rel=0.3)
        assert (found[way, 5e-4].work["friction"][-1] < 0.0).all()


@compiled
def test_a_free_top_is_jacobis_and_a_heavy_one_precesses() -> None:
    pytest.importorskip("scipy")
    found = run("spinning_top")
    for method, order in (("velocity_verlet", 2), ("rk4", 4)):
        assert found[method][0] / found[method][1] == pytest.approx(2.0**order, rel=0.1)
    assert found["gauss6"][1] < 1e-12
    assert found["swapped"] > 1.0
    assert abs(found["rate"]) < 1e-4
    assert found["lean"] < 1e-4


@compiled
def test_the_balls_impacts_are_the_geometric_series() -> None:
    found = run("bouncing_ball")
    fall = np.sqrt(2.0 / G)
    np.testing.assert_allclose(found["hits"][:3], fall * np.array([1.0, 2.0, 2.5]), atol=3e-4)
    np.testing.assert_allclose(found["impulse"][:3], 0.75 * np.sqrt(2.0 * G) * 0.5 ** np.arange(3), rtol=2e-3)
    assert found["rest"] == pytest.approx(3.0 * fall, abs=2e-3)


@compiled
def test_the_box_slides_by_coulombs_law_or_rests() -> None:
    found = run("box_on_an_incline")
    wanted = np.maximum(0.0, G * (np.sin(0.3) - found["mu"] * np.cos(0.3)))
    np.testing.assert_allclose(found["acceleration"], wanted, rtol=0.0, atol=1e-8)
    assert (found["creep"] <= 0.5 * np.array([1e-4, 1e-6, 1e-8])).all()  # within the tolerance of each
    assert (found["creep"][1:] < 1e-2 * found["creep"][:-1]).all()


@robots
@compiled
def test_the_trot_carries_its_weight_within_the_cone() -> None:
    found = run("trotting_quadruped")
    force = found["force"]  # (frictions, steps, feet, 3)
    for mu, one in zip(found["mu"], force, strict=True):
        assert (np.linalg.norm(one[..., :2], axis=-1) <= mu * one[..., 2] + 1e-9).all()
    strides = force[:, -640:, :, 2].sum(axis=2).mean(axis=1)
    np.testing.assert_allclose(strides / found["weight"], 1.0, atol=0.1)
    assert np.percentile(found["residual"], 95) <= 1e-4
    assert (found["z"] > 0.15).all()  # none falls
    assert found["x"][1, -1] > 1.5 * found["x"][3, -1] > 0.0


def test_principles_of_mechanics_hold_to_rounding() -> None:
    found = run("principles")
    assert len(found) == 5
    assert max(found.values()) < 1e-11


@pytest.mark.slow(quick="linearization/test_step_derivatives.py::test_a_batch_is_its_samples")
@compiled
def test_ilqr_reaches_the_cost_that_other_solvers_reach_and_keeps_its_limits() -> None:
    """3.5517082866 by DDP and by FDDP of Crocoddyl 3.1, from the same start."""
    found = run("ilqr")
    _, u, costs = found["swing-up"]
    assert costs[-1] == pytest.approx(3.5517082866, abs=5e-10)
    assert (np.diff(costs) <= 0.0).all()
    assert abs(u).max() == pytest.approx(31.79, abs=5e-3)
    x, u, costs = found["swing-up, 12 N"]
    assert abs(u).max() == 12.0
    assert abs(x[-1]).max() < 1e-3
    # Karush, Kuhn and Tucker: at a limit the cost would fall beyond it, elsewhere its slope is 0
    example = gallery.module("ilqr")
    p, slope = example.swing_up(12.0), np.empty(150)
    A, B = sd.step_derivatives(p.model, x[:-1, :2].copy(), x[:-1, 2:].copy(), u, p.h)
    value = p.final(x[-1])[1]
    for t in range(149, -1, -1):
        slope[t] = p.h * p.R[0, 0] * u[t, 0] + B[t, :, 0] @ value
        value = p.h * p.Q @ x[t] + A[t].T @ value
    free = abs(u[:, 0]) < 12.0
    assert abs(slope[free]).max() < 1e-5
    assert (slope[u[:, 0] == 12.0] < 0.0).all()
    assert (slope[u[:, 0] == -12.0] > 0.0).all()
    assert 20 < free.sum() < 150


@compiled
@robots
@pytest.mark.slow(quick="linearization/test_step_derivatives.py::test_a_batch_is_its_samples")
def test_ilqr_brings_a_panda_to_its_point() -> None:
    example = gallery.module("ilqr")
    p = example.reach(sd.load_urdf("panda"))
    x, u, costs, _ = example.ilqr(p, np.tile(p.force, (100, 1)), 1e-9)
    assert costs[-1] < 0.01 * costs[0]
    assert (u >= p.low).all()
    assert (u <= p.high).all()
    hand = sd.frame_placement(p.model, x[-1, :7], "panda_link8")[:3, 3]
    start = sd.frame_placement(p.model, p.q0, "panda_link8")[:3, 3]
    np.testing.assert_allclose(hand - start, [0.3, 0.0, -0.2], rtol=0, atol=0.02)


@pytest.mark.slow(quick="linearization/test_step_derivatives.py::test_a_batch_is_its_samples")
@compiled
def test_gains_along_a_swing_up_hold_it_and_end_as_those_of_the_standing_pole() -> None:
    found = run("swing_up_lqr")
    np.testing.assert_allclose(found["top"], [-8.489158, -53.227745, -8.896183, -11.431641], rtol=0, atol=5e-7)
    assert found["radius"] == pytest.approx(0.9592447, abs=5e-8)
    assert found["cost"] == pytest.approx(3.5517082866, abs=5e-10)
    up = {name: abs(path[-1, :, 1]) < 0.05 for name, path in found["runs"].items()}
    assert up["with gains"].all()
    assert not up["open loop"].any()
