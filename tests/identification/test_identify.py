"""Identification of two hinges and others: exact data to rounding, noise within its interval, what is refused."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_runs import compiled

import spatialdyn as sd
from spatialdyn.identification.equations import Equations
from spatialdyn.identification.log_cholesky import upper_factor
from spatialdyn.identification.motions import MEANS, held_weights, means_of_steps, shared_by_means
from spatialdyn.identification.pseudo_inertia import consistent, in_body, parameters_of, pseudo_inertia

EXACT = 1e-9  # of parameters of size 1: cond 30, eps, and of accelerations no differences
NOISE = 0.02  # N m


@cache
def model() -> sd.Model:
    return sd.load_urdf("two_link")


@cache
def path(seed: int = 0) -> sd.Path:
    rng = np.random.default_rng(seed)
    return sd.fourier(rng.normal(size=(4, 2)), rng.normal(size=(4, 2)), 0.25, [0.3, 0.1])


def truth(found: sd.Identified, robot: sd.Model, **joints: float) -> np.ndarray:
    """β of a robot, and of numbers for all joints by kind."""
    pi = np.ravel(sd.inertial_parameters(robot)[1:])[: 10 * len(found.settings.unknowns.bodies)]
    rest = [joints.get(kind, 0.0) for kind, _ in found.settings.unknowns.joints]
    return found.base.K @ np.concatenate([pi, rest])


def measured(robot: sd.Model, noise: float, seed: int = 0, n: int = 800, **joints: float) -> sd.Recording:
    """A log with accelerations."""
    t = np.linspace(0.0, 4.0, n, endpoint=False)
    q, v, a = path()(t)
    tau = sd.rnea(robot, q, v, a) + joints.get("viscous", 0.0) * v + joints.get("coulomb", 0.0) * np.sign(v)
    tau = tau + joints.get("armature", 0.0) * a + joints.get("offset", 0.0)
    return sd.Recording(t, q, tau + noise * np.random.default_rng(seed).normal(size=tau.shape), v, a)


@cache
def held(late: int = 0) -> tuple[sd.Recording, sd.Recording]:
    """A log of torques that are held over 4 ms, and one of them as if given ``late`` samples before."""
    h, n = 4e-3, 600
    q, v, a = path()(np.arange(n) * h)
    tau = sd.rnea(model(), q, v, a)
    run = sd.simulate(model(), q[0], v[0], n * h, h / 4, torque=np.repeat(tau, 4, axis=0), record=4)
    log = sd.Recording(run.t[:-1], run.q[:-1], tau, run.v[:-1])
    return log, sd.Recording(log.t[late:], log.q[late:], log.tau[: len(log) - late], log.v[late:])


# --- pseudo-inertias ----------------------------------------------------------------------------------------


def test_a_pseudo_inertia_is_that_of_point_masses() -> None:
    rng = np.random.default_rng(0)
    masses, places = rng.uniform(0.1, 1.0, 6), rng.normal(size=(6, 3))
    one = np.concatenate([places, np.ones((6, 1))], 1)
    P = np.einsum("k,ki,kj->ij", masses, one, one)
    Ī = sum(m * (c @ c * np.eye(3) - np.outer(c, c)) for m, c in zip(masses, places, strict=True))
    expected = [masses.sum(), *(masses @ places), Ī[0, 0], Ī[0, 1], Ī[1, 1], Ī[0, 2], Ī[1, 2], Ī[2, 2]]
    np.testing.assert_allclose(parameters_of(P), expected, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(pseudo_inertia(parameters_of(P)), P, atol=1e-14)
    U = upper_factor(P)
    np.testing.assert_allclose(U @ U.T, P, atol=1e-13)
    assert np.array_equal(np.tril(U, -1), np.zeros((4, 4)))
    X = np.array(model().frame("tip").placement)
    X[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    moved = np.einsum("k,ki,kj->ij", masses, one @ X.T, one @ X.T)
    np.testing.assert_allclose(in_body(X) @ parameters_of(P), parameters_of(moved), atol=1e-13)
    raised = consistent(np.array([1.0, 2.0, 0, 0, 1, 0, 1, 0, 0, 1]), 1e-6)
    assert np.linalg.eigvalsh(pseudo_inertia(raised))[0] > 0.0


# --- what is found ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["ols", "wls"])
def test_exact_data_give_exact_parameters(method: str) -> None:
    joints = {"viscous": 0.3, "coulomb": 0.5, "armature": 0.07, "offset": 0.2}
    log = measured(model(), 0.0, **joints)
    found = sd.identify(log, model(), method, "inertial+friction+armature+offset")
    assert abs(found.beta - truth(found, model(), **joints)).max() < EXACT
    np.testing.assert_allclose(found.offset, 0.2, atol=EXACT)
    assert found.friction is not None
    np.testing.assert_allclose(found.friction.coulomb, 0.5, atol=EXACT)


@pytest.mark.parametrize("late", [0, 3])
def test_held_torques_are_exact_without_accelerations_and_the_delay_is_found(late: int) -> None:
    log, other = held(late)
    exact = sd.identify(log, off(), parameters="inertial", hold="after")
    assert abs(exact.beta - truth(exact, model())).max() < 1e-8  # Simpson's rule and a cubic of 4 ms
    assert exact.settings.form == "momentum"
    found = sd.identify(other, off(), parameters="inertial", hold="after", delay=True)
    assert found.delay == pytest.approx(-4e-3 * late, abs=1e-6)
    assert abs(found.beta - truth(found, model())).max() < 1e-8
    if late:
        plain = sd.identify(other, model(), parameters="inertial", hold="after")
        assert any("delay=True" in x for x in plain.notes)


@cache
def held_between(eighths: int) -> sd.Recording:
    """A log of torques that act from between its samples on, that many eighths of one late."""
    h, n = 4e-3, 600
    tau = sd.rnea(model(), *path()(np.arange(n) * h))
    acting = np.concatenate([np.repeat(tau[:1], eighths, axis=0), np.repeat(tau, 8, axis=0)])[: 8 * n]
    start = path()(0.0)
    run = sd.simulate(model(), start.q, start.v, n * h, h / 8, torque=acting, record=8)
    return sd.Recording(run.t[:-1], run.q[:-1], tau, run.v[:-1])


def test_velocities_that_miss_the_jumps_of_held_torques_see_their_weighted_sums() -> None:
    """By hand: differences of order 4 are off by (2 J0 - J1/2 - J-1/2) h/12, a cubic's middle by J0 h/16."""
    by_differences = np.array([-0.5, 3.0, 7.0, 3.0, -0.5]) / 12.0
    np.testing.assert_allclose(held_weights("differences", 0.0)[2:-2], by_differences, atol=1e-15)
    np.testing.assert_allclose(held_weights("measured", 0.5)[3:-3], [1 / 16, 7 / 8, 1 / 16], atol=1e-15)
    assert np.array_equal(held_weights("measured", 0.0), [1.0])
    for known, given, delay in (((0, False), 0, 0.0), ((4, True), 4, True), ((6, True), 6, 3e-3)):
        log = held_between(known[0])
        noisy = log.tau + NOISE * np.random.default_rng(0).normal(size=log.tau.shape)
        v = log.v if known[1] else None
        exact, found = (
            sd.identify(sd.Recording(log.t, log.q, tau, v), off(), parameters="inertial", hold="after", delay=delay)
            for tau in (log.tau, noisy)
        )
        assert (abs(exact.beta - truth(exact, model())) < 0.1 * found.deviation).all()  # about one without weights
        assert exact.delay == pytest.approx(given * 4e-3 / 8, abs=1e-6)
        assert not found.notes


def test_a_held_torque_taken_as_that_of_its_time_is_noticed() -> None:
    log, _ = held()
    tau = log.tau + 1e-3 * np.random.default_rng(0).normal(size=log.tau.shape)
    found = sd.identify(sd.Recording(log.t, log.q, tau, log.v), off(), parameters="inertial")
    assert any("not white" in x and x.endswith("not tried: hold=, delay=True, cutoff=") for x in found.notes)
    assert abs(found.beta - truth(found, model())).max() > 100.0 * EXACT


def test_a_torque_held_before_its_sample_is_the_same_shifted_by_one() -> None:
    log, _ = held()
    before = sd.Recording(log.t[1:], log.q[1:], log.tau[:-1], log.v[1:])
    one, other = (
        sd.identify(x, model(), parameters="inertial", hold=hold) for x, hold in ((log, "after"), (before, "before"))
    )
    assert abs(one.beta - other.beta).max() < 1e-6


def test_positions_alone_are_enough_and_windows_average() -> None:
    log, _ = held()
    noisy = log.tau + NOISE * np.random.default_rng(0).normal(size=log.tau.shape)
    alone = sd.identify(sd.Recording(log.t, log.q, noisy), model(), parameters="inertial", hold="after", window=5)
    assert (abs(alone.beta - truth(alone, model())) < 4.0 * alone.deviation).all()
    np.testing.assert_allclose(alone.noise, NOISE / np.sqrt(5.0), rtol=0.3)


def test_noise_of_each_joint_weighs_and_is_found() -> None:
    log = measured(model(), 0.0)
    sigma = np.array([0.3, 0.01])
    tau = log.tau + sigma * np.random.default_rng(1).normal(size=log.tau.shape)
    log = sd.Recording(log.t, log.q, tau, log.v, log.a)
    ols, wls = (sd.identify(log, model(), method, "inertial") for method in ("ols", "wls"))
    np.testing.assert_allclose(wls.noise, sigma, rtol=0.1)
    assert (wls.deviation[3:] < 0.2 * ols.deviation[3:]).all()  # of the second body
    assert (wls.white > 0.001).all()


def test_a_generator_of_recordings_gives_what_all_of_them_give_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = [measured(model(), NOISE, seed) for seed in range(3)]
    whole = sd.identify(logs, model(), parameters="inertial")
    once = sd.identify((x for x in logs), model(), parameters="inertial")
    assert abs(whole.beta - once.beta).max() < EXACT
    np.testing.assert_array_equal(whole.rows, once.rows)
    assert np.isnan(once.white).all()
    still = [sd.Recording(x.t, x.q, x.tau, x.v) for x in logs]  # neighbouring means share samples in both
    one, other = (sd.identify(x, model(), parameters="inertial") for x in (still, iter(still)))
    np.testing.assert_allclose(one.deviation, other.deviation, rtol=1e-9)
    room = 2 * logs[0].tau.size * len(whole.names)  # of three logs each keeps the rows of a third of it: none
    monkeypatch.setattr("spatialdyn.identification.identify.KEPT", room)
    made: list[Equations] = []
    keep = Equations.__init__

    def noted(self: Equations, *given: Any) -> None:
        keep(self, *given)
        made.append(self)

    monkeypatch.setattr(Equations, "__init__", noted)
    assert np.array_equal(sd.identify(logs, model(), parameters="inertial").beta, whole.beta)
    assert len(made) == 3
    assert not any(x._made for x in made)
    with pytest.raises(sd.IdentificationError, match="several passes"):
        sd.identify((x for x in logs), model(), delay=True)


def test_steps_in_which_a_joint_turns_are_left_out_of_dry_friction() -> None:
    """A slider with c sgn v under held forces, step by step in closed form: v has a kink where it turns."""
    slider = sd.ModelBuilder("slider").add_body("b", None, "prismatic", (1, 0, 0), inertia=(2.0, (0, 0, 0), np.eye(3)))
    t, c, h = np.arange(400) * 0.01, 0.5, 0.01
    tau, q, v, states = 3.0 * np.cos(4.0 * t), 0.0, 0.1, []
    for force in tau:
        states.append((q, v))
        left = h
        while left > 0.0:
            a = (force - c * np.sign(v or force)) / 2.0
            some = min(left, -v / a) if v * a < 0.0 else left
            q, v = q + some * v + 0.5 * some * some * a, v + some * a if some == left else 0.0
            left -= some
    log = sd.Recording(t, [[x] for x, _ in states], tau[:, None], [[x] for _, x in states])
    found = sd.identify(log, slider.build(), hold="after")
    assert abs(found.beta - truth(found, slider.build(), coulomb=c)).max() < EXACT
    assert len(t) - 10 < found.rows[0] < len(t) - 1


# --- bodies that exist --------------------------------------------------------------------------------------


@cache
def off() -> sd.Model:
    """The hinges with masses 30 % wrong."""
    return model().with_(inertial_parameters=sd.inertial_parameters(model()) * np.array([1.0, 1.3, 0.7])[:, None])


def test_log_cholesky_finds_bodies_that_exist_and_predicts_as_well() -> None:
    log, other = measured(model(), NOISE), measured(model(), NOISE, seed=5)
    free = sd.identify(log, off(), "wls", "inertial")
    found = sd.identify(log, off(), "log_cholesky", "inertial")
    assert all(values[0] > 0.0 for values in found.eigenvalues.values())
    assert abs((found.beta - free.beta) / free.deviation).max() < 1.0
    assert found.validate(other).ratio.max() < 1.1
    np.testing.assert_allclose(found.base.K @ found.parameters, found.beta, atol=1e-12)
    made = found.model()
    np.testing.assert_allclose(np.ravel(sd.inertial_parameters(made)[1:]), found.parameters, atol=1e-12)


def test_both_methods_of_consistent_bodies_agree() -> None:
    pytest.importorskip("cvxpy")
    log = measured(model(), NOISE, viscous=0.3)
    one, other = (sd.identify(log, off(), method, "inertial+friction") for method in ("log_cholesky", "sdp"))
    assert abs((one.beta - other.beta) / one.deviation).max() < 0.1
    assert all(values[0] > 0.0 for values in other.eigenvalues.values())
    assert "joint1.coulomb" in one.bounds or (one.parameters[-2:] >= 0.0).all()


def test_an_inertia_that_no_body_has_becomes_no_model() -> None:
    found = sd.identify(measured(model(), 3.0), off(), "wls", "inertial")
    assert min(values[0] for values in found.eigenvalues.values()) < 0.0
    with pytest.raises(sd.InertiaError, match=r'body of "joint\d" has a pseudo-inertia'):
        found.model()
    negative = sd.identify(measured(model(), 0.0, viscous=-0.1), model(), "wls", "viscous")
    with pytest.raises(sd.IdentificationError, match=r'"joint1" has viscous -0\.1'):
        negative.model()


def test_friction_becomes_the_joints_own_and_the_scenes() -> None:
    log = measured(model(), 0.0, viscous=0.3, coulomb=0.5)
    found = sd.identify(log, model(), "log_cholesky")
    again = sd.load_urdf(sd.to_urdf(found.model()))
    np.testing.assert_allclose([again.damping, again.friction], [[0.3, 0.3], [0.5, 0.5]], rtol=1e-4)
    scene = found.scene()
    assert scene.friction == found.friction
    known = sd.identify(log, sd.Scene(model(), friction=sd.Friction(0.5, 0.3)), "wls", "inertial")
    assert abs(known.beta - truth(known, model())).max() < EXACT


def test_a_load_is_found_in_its_frame() -> None:
    load = (0.7, np.array([0.05, 0.02, 0.1]), np.diag([3e-3, 2e-3, 2.5e-3]))
    builder = sd.ModelBuilder("arm")
    solid = (1.0, (0.0, 0.1, 0.3), 0.1 * np.eye(3))
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 0))):
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, (0.1, 0.2, 0.3), solid)
    arm, t = builder.build(), np.linspace(0.0, 4.0, 300)
    q, v, a = sd.fourier(*np.random.default_rng(0).normal(size=(2, 4, 4)), 0.25, np.zeros(4))(t)
    tau = sd.rnea(arm.with_(payload={"b3": load}), q, v, a)
    for method, near in (("wls", 1e-8), ("log_cholesky", 1e-3)):
        noisy = tau + (1e-4 * np.random.default_rng(1).normal(size=tau.shape) if method != "wls" else 0.0)
        found = sd.identify(sd.Recording(t, q, noisy, v, a), arm, method, "inertial", payload="b3")
        expected = [0.7, *(0.7 * load[1])]
        np.testing.assert_allclose(found.parameters[:4], expected, atol=near)
    np.testing.assert_allclose(sd.rnea(found.model(), q, v, a), tau, atol=2e-2)


# --- floating bases -----------------------------------------------------------------------------------------


def floating() -> sd.Model:
    """A body that carries a hinge."""
    solid = (1.0, (0.1, 0.05, 0.2), np.diag([0.1, 0.12, 0.09]))
    builder = sd.ModelBuilder("body", "world").add_body("base", None, "floating", inertia=solid)
    return builder.add_body("arm", "base", "revolute", (0, 1, 0), (0.1, 0.0, 0.2), solid).build()


def flying(robot: sd.Model, with_wrench: bool) -> sd.Recording:
    t = np.linspace(0.0, 4.0, 400)
    at = sd.fourier(*0.5 * np.random.default_rng(2).normal(size=(2, 3, 7)), 0.25, sd.neutral(robot), robot, False)
    q, v, a = at(t)
    tau = sd.rnea(robot, q, v, a)
    J = sd.frame_jacobian(robot, q, "base")
    force = np.linalg.solve(np.swapaxes(J[:, :, :6], 1, 2), tau[:, :6, None])[..., 0]
    joints = tau - np.einsum("nij,ni->nj", J, force)
    return sd.Recording(t, q, joints[:, 6:], v, a, {"base": force} if with_wrench else None)


@pytest.mark.parametrize("form", ["torque", "momentum"])
def test_a_floating_base_is_found_from_its_measured_wrench(form: str) -> None:
    robot = floating()
    near = 1e-8 if form == "torque" else 2e-5  # the mean of a smooth wrench is that of a cubic
    for rows in ("base", "all"):
        found = sd.identify(flying(robot, True), robot, "wls", "inertial", rows=rows, form=form)
        assert abs(found.beta - truth(found, robot)).max() < near
        assert found.residuals.shape[1] == (6 if rows == "base" else 7)
        if rows == "base":  # of torques that are 0 there is no delay
            assert not [x for x in found.notes if "delay" in x]
            with pytest.raises(sd.IdentificationError, match=r"delay is True, expected .*: the torques of"):
                sd.identify(flying(robot, True), robot, "wls", "inertial", rows=rows, form=form, delay=True)
    with pytest.raises(sd.IdentificationError, match="no wrenches"):
        sd.identify(flying(robot, False), robot, "wls", "inertial", rows="base")


# --- what is refused, and removed ---------------------------------------------------------------------------


def test_what_a_motion_does_not_move_is_listed() -> None:
    t = np.linspace(0.0, 4.0, 400)
    q = np.stack([np.full(400, 0.3), np.sin(t)], 1)
    v, a = np.stack([np.zeros(400), np.cos(t)], 1), np.stack([np.zeros(400), -np.sin(t)], 1)
    tau = sd.rnea(model(), q, v, a) + NOISE * np.random.default_rng(0).normal(size=q.shape)
    log = sd.Recording(t, q, tau, v, a)
    with pytest.raises(sd.IdentificationError, match=r"tells \d of 6 base parameters(.|\n)*joint"):
        sd.identify(log, model(), "wls", "inertial")
    some = sd.identify(log, model(), "wls", "inertial", remove=0.3)
    assert some.removed
    assert not some.beta[~some.seen].any()
    whole = sd.identify(log, model(), "log_cholesky", "inertial")
    assert whole.poor
    assert np.isinf(whole.deviation[~whole.seen]).all()
    assert all(values[0] > 0.0 for values in whole.eigenvalues.values())


def test_parameters_that_are_not_seen_are_removed_the_worst_first() -> None:
    found = sd.identify(measured(model(), 0.3, offset=0.5), model(), "wls", "inertial+offset+friction", remove=0.3)
    assert {x for x in found.removed if "viscous" in x or "coulomb" in x}
    left = found.beta != 0.0
    assert (found.deviation[left] <= 0.3 * abs(found.beta[left])).all()
    assert "removed" in str(found)


def test_a_mimic_joint_has_its_leaders_friction_and_a_body_of_its_own() -> None:
    solid = (1.0, (0.1, 0.05, 0.2), np.diag([0.1, 0.12, 0.09]))
    builder = sd.ModelBuilder("pair").add_body("a", None, "revolute", (0, 1, 0), inertia=solid, joint_name="z")
    mimic = {"leader": "z", "multiplier": 0.7, "offset": 0.1}
    builder.add_body("b", "a", "revolute", (1, 0, 0), (0.0, 0.1, 0.3), solid, mimic=mimic, joint_name="follower")
    robot, t = builder.build(mimic=True), np.linspace(0.0, 4.0, 400)
    q, v, a = sd.fourier([[1.0], [0.8]], [[0.3], [-0.5]], 0.25, [0.0])(t)
    log = sd.Recording(t, q, sd.rnea(robot, q, v, a) + 0.3 * v + 0.5 * np.sign(v), v, a)
    found = sd.identify(log, robot, "log_cholesky")
    assert found.names[-2:] == ("z.viscous", "z.coulomb")
    assert abs(found.beta - truth(found, robot, viscous=0.3, coulomb=0.5)).max() < EXACT
    np.testing.assert_allclose(found.model().damping, [0.3])
    assert {joint.damping for joint in found.model().robot.joints if joint.name == "follower"} == {0.0}


def test_forces_that_no_equation_has_are_refused() -> None:
    log, hinge = measured(model(), 0.0), sd.ModelBuilder("arm").add_body("b", None, "revolute", (0, 1, 0))
    for name, force in (("fext", np.zeros((3, 6))), ("contacts", sd.Contacts(model(), {"tip": 0.0}))):
        with pytest.raises(sd.IdentificationError, match=f"scene has {name}, expected none"):
            sd.identify(log, sd.Scene(model(), **{name: force}))  # type: ignore[arg-type]
    with pytest.raises(sd.IdentificationError, match='joint "b_joint_rotor" has a spring, expected joints without'):
        sd.base_parameters(hinge.add_series_elastic("b_joint", 10.0, rotor=0.1).build())


def test_arguments_that_contradict_each_other_are_refused() -> None:
    log = measured(model(), 0.0)
    for options, said in (
        ({"form": "torque", "hold": "after"}, "held torque"),
        ({"prior": 1.0}, "has none"),
        ({"rows": "base"}, "no floating base"),
        ({"payload": "tip", "bodies": "joint1"}, "bodies is .*, expected None beside payload 'tip'"),
        ({"parameters": "friction", "bodies": ["joint1"]}, r"bodies is .*joint1.*no \"inertial\""),
        ({"delay": np.nan}, "delay is nan"),
        ({"window": 0}, "window is 0"),
        ({"cutoff": 1e6}, "cutoff is 1e"),
    ):
        given: dict[str, Any] = {"form": "momentum"} if "cutoff" in options else {}
        used = sd.Recording(log.t, log.q, log.tau) if "cutoff" in options else log
        with pytest.raises(sd.IdentificationError, match=said):
            sd.identify(used, model(), **{**given, **options})
    with pytest.raises(sd.IdentificationError, match="equations, expected"):
        sd.identify(sd.Recording(*(x[:6] for x in (log.t, log.q, log.tau, log.v, log.a))), model())


# --- intervals and pages ------------------------------------------------------------------------------------


def covered(seeds: range, delay: bool, noise: float = NOISE, **options: Any) -> float:
    """The share of base parameters that lie in their intervals, over seeds of white noise."""
    log, other = held(3 if delay else 0)
    log, share = other if delay else log, []
    for seed in seeds:
        tau = log.tau + noise * np.random.default_rng(seed).normal(size=log.tau.shape)
        noisy = sd.Recording(log.t, log.q, tau, log.v)
        found = sd.identify(noisy, off(), parameters="inertial", delay=delay, **options)
        share.append(abs(found.beta - truth(found, model())) < found.half_width)
    return float(np.mean(share))


def test_intervals_cover_in_some_seeds() -> None:
    assert covered(range(20), False, hold="after") > 0.85


def test_the_mean_of_a_step_is_that_of_a_cubic_and_its_intervals_cover() -> None:
    """Torques of their times, without accelerations: means by two samples are off by more than such noise."""
    t, c = np.arange(9.0), np.array([0.3, -0.2, 0.5, 0.7])
    whole = np.polynomial.Polynomial(c).integ()(t)
    np.testing.assert_allclose(means_of_steps(np.polynomial.Polynomial(c)(t)), np.diff(whole), rtol=1e-13)
    assert np.array_equal(means_of_steps(np.array([[1.0], [3.0]])), [[2.0]])
    log, share, noted = measured(model(), 0.0), [], 0
    for seed in range(20):
        tau = log.tau + NOISE * np.random.default_rng(seed).normal(size=log.tau.shape)
        found = sd.identify(sd.Recording(log.t, log.q, tau, log.v), off(), parameters="inertial")
        share.append(abs(found.beta - truth(found, model())) < found.half_width)
        noted += bool(found.notes)
    assert np.mean(share) > 0.85
    assert noted < 4  # neighbouring means share samples, which is no sign of a wrong model
    assert shared_by_means(1, np.array(MEANS)) == (3, pytest.approx(576.0 / 340.0))
    dry = measured(model(), 0.0, coulomb=0.5, viscous=0.3)  # which jumps where a joint turns: those steps do not count
    found = sd.identify(sd.Recording(dry.t, dry.q, dry.tau, dry.v), off())
    assert abs(found.beta - truth(found, model(), coulomb=0.5, viscous=0.3)).max() < 1e-4


@compiled
@pytest.mark.slow(quick="test_intervals_cover_in_some_seeds")
def test_intervals_cover_in_95_of_100() -> None:
    """600 numbers of six correlated parameters: a deviation of some 1.5 %."""
    for method in ("ols", "wls"):
        assert 0.93 <= covered(range(100), False, hold="after", method=method) <= 0.97
    assert covered(range(100), True, hold="after") >= 0.90


def test_the_table_and_the_page_have_every_parameter(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    log = measured(model(), NOISE, viscous=0.1)
    found = sd.identify(log, model(), "log_cholesky")
    assert all(label in str(found) for label in found.base.labels)
    found.report(tmp_path / "page.html", measured(model(), NOISE, seed=3, viscous=0.1))
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for words in (*found.base.labels, "Another motion", "Eigenvalues", "Residuals"):
        assert words in page, words
    assert page.count("<img") == 4
    assert '"method": "log_cholesky"' in found.to_json()
