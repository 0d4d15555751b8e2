"""Energy ledgers: ε falls with the order; impulses are exact; ideal constraints do no work; friction takes energy."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

sys.path.append(str(Path(__file__).parents[1] / "constraints"))
from mechanisms import four_bar, four_bar_state, pin_of

EPS = float(np.finfo(float).eps)
STEPPED = "semi_implicit_euler"
ORDERS = {"explicit_euler": 1, "semi_implicit_euler": 1, "velocity_verlet": 2, "rk4": 4}
RUBBED = sd.Friction([0.6, 0.4, 0.2], [0.6, 0.4, 0.2], [0.8, 0.5, 0.3], 0.1, 0.4, 1e3, 10.0)
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("three_link")


def ledger(*arguments: Any, **options: Any) -> sd.EnergyLedger:
    return sd.energy_ledger(scenes.simulate(*arguments, record="work", **options))


def in_python(*arguments: Any, torque: Any = (0.0, 0.0, 0.0), **options: Any) -> sd.Trajectory:
    """``simulate`` whose steps run in Python, by a torque function."""
    return scenes.simulate(*arguments, torque=lambda t, q, v: np.array(torque), **options)


# --- the order of the error -----------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize(("method", "order"), ORDERS.items())
@pytest.mark.parametrize("way", [None, "smooth"])
def test_what_the_integrator_adds_falls_with_its_order(arm: sd.Model, method: str, order: int, way: str | None) -> None:
    kept: dict[str, Any] = {} if way is None else {"friction": RUBBED, "friction_method": way}
    dts = [2e-3, 1e-3] if order < 4 else [4e-3, 2e-3] if way is None else [2.4e-3, 1.2e-3]
    errors = [
        abs(ledger(arm, [0.4, 0.8, -0.5], [1.0, 0.0, 0.5], 0.48, dt, method, torque=[2.0, 1.0, 0.5], **kept).error[-1])
        for dt in dts
    ]
    assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.3)


def test_scipys_methods_keep_the_ledger_to_their_tolerance(arm: sd.Model) -> None:
    pytest.importorskip("scipy")
    kept = dict(friction=RUBBED, friction_method="smooth", rtol=1e-10, torque=[2.0, 1.0, 0.5])
    found = ledger(arm, [0.4, 0.8, -0.5], [1.0, 0.0, 0.5], 0.3, 0.01, "dop853", **kept)
    assert abs(found.error).max() < 1e-8 < abs(found.change).max()


def test_the_work_of_a_motor_by_hand() -> None:
    """A constant force F on a mass m: v = F t/m, W = F² t²/2m, all of which is kinetic energy."""
    made = sd.ModelBuilder("m").add_body("m", None, "prismatic", (1, 0, 0), inertia=(2.0, (0, 0, 0), np.eye(3)))
    found = ledger(made.build(gravity=(0.0, 0.0, 0.0)), [0.0], [0.0], 1.0, 0.1, torque=[3.0])
    np.testing.assert_allclose(found.work["torque"][:, 0], 9.0 * found.t**2 / 4.0, atol=100 * EPS)
    np.testing.assert_allclose(found.error, 0.0, atol=100 * EPS)
    assert found.labels == {"torque": ("m_joint",)}


@pytest.mark.parametrize("way", ["implicit", "lugre"])
def test_impulses_do_exactly_half_the_sum_of_both_velocities(way: str) -> None:
    """On masses with a constant M and no gravity nothing is left but rounding, at any step."""
    builder, rng = sd.ModelBuilder("slides"), np.random.default_rng(0)
    for k in range(4):
        at = f"mass{k - 1}" if k else None
        builder.add_body(f"mass{k}", at, "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), 0.1 * np.eye(3)))
    model = builder.build(gravity=(0.0, 0.0, 0.0))
    friction = sd.Friction(
        rng.uniform(0.0, 1.0, 4), rng.uniform(0.0, 0.3, 4), bristle_stiffness=1e3, bristle_damping=0.0
    )
    for run in (scenes.simulate, in_python):
        made = run(
            model, np.zeros(4), rng.normal(size=4), 1.0, 0.02, STEPPED, torque=(0.5, 0.0, 0.0, -0.3), friction=friction,
            friction_method=way, record="work",
        )  # fmt: skip
        found = sd.energy_ledger(made)
        assert abs(found.error).max() <= 1e3 * EPS * abs(found.work["friction"]).max()
        assert found.work["friction"][-1].sum() < -0.05


# --- friction takes energy ------------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize(("way", "method"), [("implicit", STEPPED), ("smooth", "rk4"), ("smooth", STEPPED)])
def test_friction_takes_energy_at_every_joint(arm: sd.Model, way: str, method: str) -> None:
    """Its work falls from sample to sample, but for a step that other forces turn round: h² a of it."""
    kept = dict(friction=RUBBED, friction_method=way, torque=[4.0, 1.0, 0.5])
    found = ledger(arm, [-1.0, 0.5, 0.3], [0.0] * 3, 2.0, 1e-3, method, **kept)
    friction = found.work["friction"]
    assert (friction[1:] <= 1e-5).all()
    assert np.diff(friction, axis=0).max() <= 1e-5
    assert (friction[-1] < -0.5).all()


@compiled
def test_bristles_hold_what_they_give_back(arm: sd.Model) -> None:
    """W_friction + ½ σ0 z², what they dissipate, falls where b >= σ1 (F_s - F_c)/F_c."""
    run = sd.simulate(
        sd.Scene(arm, friction=RUBBED, friction_method="lugre"),
        [-1.0, 0.5, 0.3],
        [0.0] * 3,
        1.0,
        1e-3,
        STEPPED,
        torque=[4.0, 1.0, 0.5],
        record="work",
    )
    assert run.bristles is not None
    lost = run.states["work_friction"] + 0.5 * RUBBED.bristle_stiffness * run.bristles**2
    assert lost.max() <= 1e-4
    assert (lost[-1] < -0.3).all()


# --- constraints ----------------------------------------------------------------------------------------


def bar(
    dt: float, stabilization: float | None = None, run: Callable[..., sd.Trajectory] = scenes.simulate
) -> sd.EnergyLedger:
    model = four_bar()
    held, (q, v) = pin_of(model), four_bar_state()
    made = run(
        model, q, v, 0.2, dt, constraints=held, stabilization=stabilization, torque=(0.1, 0.0, 0.0), record="work"
    )
    return sd.energy_ledger(made)


def test_ideal_constraints_do_no_work() -> None:
    """Stages of a step are off J v = 0 by the order of the method, RK4: both works fall by 16 with half a step."""
    errors = []
    for dt in (1e-2, 5e-3):
        found = bar(dt)
        assert found.labels["constraints"] == ("pin x", "pin y", "pin z")
        assert set(found.work) == {"torque", "constraints", "projection"}
        errors.append([abs(found.work[x].sum(axis=1)).max() for x in ("constraints", "projection")])
        assert abs(found.work["torque"]).max() > 1e-3
        assert abs(found.error).max() < 1e-6
    coarse, fine = np.array(errors)
    assert (coarse < 1e-5).all()
    assert (coarse > 12.0 * fine).all()


def test_the_work_of_a_projection_is_what_it_adds_to_the_energy() -> None:
    """By a step without one: a stabilization within 1e9 s does nothing in a step."""
    model = four_bar()
    held, (q, v) = pin_of(model), four_bar_state()
    args, kept = (model, q, v, 1e-2, 1e-2, STEPPED), dict(constraints=held, record="work")
    for run in (scenes.simulate, in_python):
        free, projected = run(*args, **kept, stabilization=1e9), run(*args, **kept)
        added = projected.states["work_projection"][-1, 0]
        assert added == pytest.approx(projected.energy[-1] - free.energy[-1], abs=1e-12)
        assert abs(added) > 1e-6


def test_stabilization_does_work_that_is_the_constraints() -> None:
    found = bar(5e-3, 0.1)
    assert set(found.work) == {"torque", "constraints"}
    assert abs(found.error).max() < 1e-5


@pytest.mark.parametrize("stabilization", [None, 0.1])
def test_steps_in_python_keep_the_same_ledger_of_constraints(stabilization: float | None) -> None:
    wanted, found = bar(1e-2, stabilization), bar(1e-2, stabilization, in_python)
    for kind, x in wanted.work.items():
        np.testing.assert_allclose(found.work[kind], x, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.error, wanted.error, rtol=0.0, atol=1e-12)


@compiled
def test_a_loop_that_rubs_dry_keeps_the_same_ledger_in_programs_and_in_python() -> None:
    """Constraints and dry joints are solved together: the force of each equation is its impulse over the step."""
    model = four_bar()
    held, (q, v) = pin_of(model), four_bar_state()
    dry = sd.Friction([0.3, 0.2, 0.1], [0.05, 0.03, 0.02])
    args, kept = (model, q, v, 0.02, 1e-3, STEPPED), dict(constraints=held, friction=dry, record="work")
    wanted, found = (sd.energy_ledger(run(*args, **kept)) for run in (scenes.simulate, in_python))
    assert abs(wanted.work["constraints"]).max() > 1e-7
    for kind, x in wanted.work.items():
        np.testing.assert_allclose(found.work[kind], x, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(found.error, wanted.error, rtol=0.0, atol=1e-10)


# --- however it runs ------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["implicit", "lugre", "smooth"])
def test_steps_in_python_keep_the_same_ledger(arm: sd.Model, way: str) -> None:
    args = (arm, [-1.0, 0.5, 0.3], [1.0, 0.0, -1.0], 0.03, 1e-3, STEPPED)
    kept = dict(friction=RUBBED, friction_method=way, torque=(4.0, 1.0, 0.5), record="work")
    wanted, found = (sd.energy_ledger(run(*args, **kept)) for run in (scenes.simulate, in_python))
    for kind, x in wanted.work.items():
        np.testing.assert_allclose(found.work[kind], x, rtol=0.0, atol=1e3 * EPS)


@compiled
@pytest.mark.parametrize(
    ("method", "kept"),
    [
        ("rk4", {}), ("dop853", dict(rtol=1e-10)), (STEPPED, dict(friction=RUBBED)),
        ("rk4", dict(friction=RUBBED, friction_method="smooth")),
    ],
)  # fmt: skip
def test_external_forces_have_their_work(arm: sd.Model, method: str, kept: Any) -> None:
    """A constant force in a body's frame; ε still falls with the order."""
    fext = np.zeros((arm.njoints, 6))
    fext[-1, :3] = [1.0, 2.0, -3.0]
    errors = []
    for dt in (2e-3, 1e-3):
        found = ledger(arm, [0.4, 0.8, -0.5], [1.0, 0.0, 0.5], 0.1, dt, method, fext=fext, **kept)
        assert abs(found.work["external"][-1].sum()) > 1e-2
        errors.append(abs(found.error[-1]))
    assert errors[1] < (1e-8 if method == "dop853" else 0.6 * errors[0] if method == STEPPED else 0.1 * errors[0])


def test_recording_work_changes_no_motion_and_goes_with_a_number(arm: sd.Model) -> None:
    args, kept = (arm, [0.4, 0.8, -0.5], [0.0] * 3, 0.1, 1e-2), dict(torque=[1.0, 0.5, 0.2])
    plain, work = scenes.simulate(*args, **kept), scenes.simulate(*args, **kept, record=(2, "work"))
    np.testing.assert_allclose(work.q, plain.q[::2], rtol=0.0, atol=1e2 * EPS)
    assert work.states["work_torque"].shape == (6, 3)
    assert plain.states == {}


def test_what_has_no_ledger_is_named(arm: sd.Model) -> None:
    args = (arm, [0.4, 0.8, -0.5], [0.0] * 3, 0.02, 1e-2)
    with pytest.raises(sd.SimulationError, match=r"no work, expected one of simulate\(..., record=\"work\"\)"):
        sd.energy_ledger(sd.simulate(*args))
    with pytest.raises(sd.SimulationError, match="trajectory is a dict"):
        sd.energy_ledger({})  # type: ignore[arg-type]
    with pytest.raises(sd.SpatialDynError, match="expected a number of steps, "):
        sd.simulate(*args, record=(1, 2, "work"))
    with pytest.raises(sd.SpatialDynError, match="record is 'works', expected a number of steps, "):
        sd.simulate(*args, record="works")
    run = sd.simulate(*args, record="work")
    assert "work of torque 0 J" in repr(sd.energy_ledger(run))
