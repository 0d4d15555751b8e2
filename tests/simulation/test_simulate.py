"""``simulate``: arguments, records, interrupts and errors."""

from __future__ import annotations

import math
import signal
import warnings
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import scenes
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.simulation import fixed_steps, integrators, plan
from spatialdyn.simulation.compiled_loop import compile_loop
from spatialdyn.simulation.methods.methods import EXPLICIT_METHODS
from spatialdyn.simulation.recorder import exploded, scale_of

EPS = np.finfo(float).eps
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
OURS = [name for name, method in integrators.items() if method.family is not None]
METHODS = ("rk4", "stormer_verlet", "variational")  # one of each family
TINY = 64 * EPS  # ten steps of rounding


@pytest.fixture
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


Q0, V0 = [0.8, 0.6], [0.3, -0.5]


@numba.njit
def feedback(t, q, v, tau):  # type: ignore[no-untyped-def]
    """Infinite after a while: a loop is compiled once for each torque, so all tests share this one."""
    tau[0] = math.inf if t > 0.55 else 3.0 * math.cos(2.0 * t) - v[0]
    tau[1] = 1.0 - 2.0 * q[1] - 0.5 * v[1]


def feedback_writes(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
    tau[:] = [3.0 * math.cos(2.0 * t) - v[0], 1.0 - 2.0 * q[1] - 0.5 * v[1]]


def feedback_returns(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
    return [3.0 * math.cos(2.0 * t) - v[0], 1.0 - 2.0 * q[1] - 0.5 * v[1]]


# --- what a newcomer writes -----------------------------------------------------------------------------


def acting(arm: sd.Model) -> dict[str, dict[str, Any]]:
    """What may act in a run."""
    foot = sd.Contacts(arm, {"tip": 0.02}, terrain=sd.Plane(height=-3.0))
    smooth = sd.Friction(coulomb=0.1, smoothing=0.5)
    motor = sd.Motor(torque_constant=0.05, resistance=1.0, voltage=24.0, ratio=20.0)
    coupler = sd.Constraints(arm, [sd.CouplerConstraint("joint2", "joint1", 0.75)])
    return {
        "nothing": {}, "torque": {"torque": [0.1, 0.2]}, "friction": {"friction": True}, "limits": {"limits": True},
        "no friction": {"friction": False}, "no limits": {"limits": False}, "contacts": {"contacts": foot},
        "smooth": {"friction": smooth, "friction_method": "smooth"}, "motor": {"motor": motor},
        "constraints": {"constraints": coupler}, "all": {"friction": True, "limits": True, "contacts": foot},
        "lugre": {"friction": sd.Friction(0.1, 0.1, bristle_stiffness=100.0), "friction_method": "lugre"},
    }  # fmt: skip


SMOOTH_FORCES = ("nothing", "torque", "no friction", "no limits", "smooth", "constraints")


@pytest.mark.parametrize("what", [*SMOOTH_FORCES, "friction", "limits", "contacts", "motor", "all", "lugre"])
def test_the_default_method_takes_whatever_acts_and_is_named(arm: sd.Model, what: str) -> None:
    given = acting(arm)[what]
    run = scenes.simulate(arm, Q0, [0.3, 0.225], 0.02, 1e-3, **given)
    assert run.method == ("rk4" if what in SMOOTH_FORCES else "semi_implicit_euler")
    named = scenes.simulate(arm, Q0, [0.3, 0.225], 0.02, 1e-3, run.method, **given)
    np.testing.assert_array_equal(run.q, named.q)


@pytest.mark.parametrize("what", ["friction", "limits", "contacts", "motor", "lugre"])
@pytest.mark.parametrize("method", ["rk4", "gauss4", "dop853"])
def test_a_method_that_cannot_take_what_acts_is_refused_with_one_that_can(
    arm: sd.Model, what: str, method: str
) -> None:
    with pytest.raises(sd.SpatialDynError, match="semi_implicit_euler"):
        scenes.simulate(arm, Q0, V0, 0.02, 1e-3, method, **acting(arm)[what])


def test_the_variational_method_takes_smooth_friction_to_its_order(arm: sd.Model) -> None:
    given = acting(arm)["smooth"]
    wanted = scenes.simulate(arm, Q0, V0, 0.2, 1e-3, "gauss6", **given).q[-1]
    off = [
        abs(scenes.simulate(arm, Q0, V0, 0.2, dt, "variational", **given).q[-1] - wanted).max() for dt in (4e-3, 2e-3)
    ]
    assert off[0] < 1e-4
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)


# --- by hand --------------------------------------------------------------------------------------------


def test_a_thrown_point_falls_by_hand() -> None:
    builder = sd.ModelBuilder()
    builder.add_body("slide", joint="prismatic", axis=(0, 0, 1), inertia=(2.0, (0, 0, 0), np.eye(3)))
    model = builder.build(gravity=(0.0, 0.0, -10.0))
    for name in ("rk4", "gauss4", "stormer_verlet", "variational", "velocity_verlet"):
        run = sd.simulate(model, [1.0], [3.0], 0.5, 0.1, name)
        np.testing.assert_allclose(run.q[:, 0], 1.0 + 3.0 * run.t - 5.0 * run.t**2, atol=TINY)
        np.testing.assert_allclose(run.v[:, 0], 3.0 - 10.0 * run.t, atol=TINY)
        np.testing.assert_allclose(run.p, 2.0 * run.v, atol=TINY)
        np.testing.assert_allclose(run.energy, 20.0 + 9.0, atol=100 * TINY)


def test_a_held_torque_acts_during_its_step() -> None:
    builder = sd.ModelBuilder()
    builder.add_body("slide", joint="prismatic", axis=(1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)))
    model = builder.build()
    torque = np.array([[1.0], [0.0], [-2.0]])
    for name in ("rk4", "stormer_verlet", "gauss4", "variational"):
        run = sd.simulate(model, [0.0], [0.0], 3.0, 1.0, name, torque=torque)
        np.testing.assert_allclose(run.v[:, 0], [0.0, 1.0, 1.0, -1.0], atol=TINY)
        np.testing.assert_allclose(run.q[:, 0], [0.0, 0.5, 1.5, 1.5], atol=TINY)
        assert run.tau[:, 0].tolist() == [1.0, 0.0, -2.0, -2.0]
    run = sd.simulate(model, [0.0], [0.0], 3.0, 1.0, "dop853", torque=torque)
    np.testing.assert_allclose(run.q[:, 0], [0.0, 0.5, 1.5, 1.5], atol=1e-9)


@pytest.mark.parametrize("name", slow_but(["rk4", "dop853"], ["rk4", "stormer_verlet", "variational", "dop853"]))
def test_external_forces_act(name: str) -> None:
    builder = sd.ModelBuilder()
    builder.add_body("slide", joint="prismatic", axis=(1, 0, 0), inertia=(2.0, (0, 0, 0), np.eye(3)))
    model = builder.build()
    fext = np.zeros((2, 6))
    fext[1, 0] = 4.0
    run = sd.simulate(sd.Scene(model, fext=fext), [0.0], [0.0], 1.0, 0.5, name)
    np.testing.assert_allclose(run.q[-1], [1.0], atol=1e-9)


# --- torques ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but(["rk4"], METHODS))  # the others share its loop
def test_torques_of_every_kind_agree(arm: sd.Model, name: str) -> None:
    given = (feedback_returns, feedback_writes, feedback)
    made = [sd.simulate(arm, Q0, V0, 0.1, 0.01, name, torque=torque) for torque in given]
    for run in made[1:]:
        np.testing.assert_allclose(run.q, made[0].q, rtol=0, atol=TINY)
        np.testing.assert_allclose(run.p, made[0].p, rtol=0, atol=100 * TINY)
        np.testing.assert_allclose(run.tau, made[0].tau, rtol=0, atol=100 * TINY)
    states = zip(made[0].t, made[0].q, made[0].v, strict=True)
    assert abs(made[0].tau - [feedback_returns(t, q, v) for t, q, v in states]).max() <= TINY


@COMPILED
@pytest.mark.parametrize("name", METHODS)
def test_python_and_compiled_loop_are_one_source(arm: sd.Model, name: str) -> None:
    """A Python function that returns zero, and no torque at all."""
    plain = sd.simulate(arm, Q0, V0, 0.1, 0.01, name, torque=lambda t, q, v: [0.0, 0.0])
    fast = sd.simulate(arm, Q0, V0, 0.1, 0.01, name)
    np.testing.assert_allclose(plain.q, fast.q, rtol=0, atol=TINY)
    np.testing.assert_allclose(plain.p, fast.p, rtol=0, atol=100 * TINY)


@COMPILED
def test_compiled_loops_are_kept_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second one is read, of a run whose angles no program takes."""
    monkeypatch.setattr(fixed_steps, "PLAIN_ROWS", 0)
    for _ in range(2):
        compile_loop.cache_clear()
        sd.simulate(sd.load_urdf("two_link"), [2e5, 0.0], V0, 0.5, 0.01, "rk4")
    loop = compile_loop(integrators["rk4"], False, None)
    assert sum(loop.stats.cache_hits.values()) == 1  # type: ignore[attr-defined]


def test_functions_get_copies(arm: sd.Model) -> None:
    seen: list[np.ndarray] = []

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        seen.append(q)
        q += 100.0
        return np.zeros(2)

    run = sd.simulate(arm, Q0, V0, 0.02, 0.01, torque=torque)
    assert abs(run.q).max() < 2.0
    assert len({id(q) for q in seen}) == len(seen)


@COMPILED
def test_compiled_functions_that_write_to_their_arguments_move_no_state_of_scipys_methods(arm: sd.Model) -> None:
    @numba.njit
    def torque(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        tau[0], tau[1] = -q[0], -v[1]
        q += 100.0
        v -= 100.0

    run = sd.simulate(arm, Q0, V0, 0.02, 0.01, "dop853", torque=torque)
    wanted = sd.simulate(arm, Q0, V0, 0.02, 0.01, "dop853", torque=lambda t, q, v: [-q[0], -v[1]])
    np.testing.assert_array_equal(run.q, wanted.q)


# --- records --------------------------------------------------------------------------------------------


def test_samples_are_bounded_and_keep_both_ends(arm: sd.Model) -> None:
    every = sd.simulate(arm, Q0, V0, 0.1, 0.01)
    assert every.t.tolist() == [0.01 * k for k in range(10)] + [0.1]
    some = sd.simulate(arm, Q0, V0, 0.1, 0.01, record=4)
    assert some.t.tolist() == [every.t[k] for k in (0, 4, 8, 10)]
    assert (some.q == every.q[[0, 4, 8, 10]]).all()
    cut = sd.simulate(arm, Q0, V0, 0.095, 0.01, record=100)
    assert cut.t.tolist() == [0.0, 0.095]
    if not numba_kernels.PLAIN:
        long = sd.simulate(arm, Q0, V0, 30.0, 1e-3)
        assert len(long) == 10_001
        assert long.t[-1] == 30.0


def test_the_last_step_is_shorter_where_steps_do_not_fit(arm: sd.Model) -> None:
    for name in (*METHODS, "dop853"):
        run = sd.simulate(arm, Q0, V0, 0.035, 0.01, name)
        assert run.t.tolist() == [0.0, 0.01, 0.02, 0.03, 0.035]
        fine = sd.simulate(arm, Q0, V0, 0.035, 0.0005, name)
        np.testing.assert_allclose(run.q[-1], fine.q[-1], atol=1e-4)


def test_no_duration_gives_the_first_state(arm: sd.Model) -> None:
    for name in (*METHODS, "dop853"):
        run = sd.simulate(arm, Q0, V0, 0.0, 0.01, name)
        assert run.t.tolist() == [0.0]
        assert run.q.tolist() == [Q0]
        np.testing.assert_allclose(run.v, [V0], atol=TINY)


def test_momentum_and_energy_belong_to_the_states() -> None:
    model, rng = random_tree(3, 4, floating=True).model, np.random.default_rng(0)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    for name in METHODS:
        run = sd.simulate(model, q, v, 0.02, 0.005, name)
        np.testing.assert_allclose(run.p, sd.momentum(model, run.q, run.v), rtol=0, atol=1e4 * EPS * abs(run.p).max())
        H = sd.hamiltonian(model, run.q, run.p)
        np.testing.assert_allclose(run.energy, H, rtol=1e-11)
        assert (abs(np.linalg.norm(run.q[:, 3:7], axis=1) - 1.0) <= 4 * EPS).all()


def test_hamilton_simulation_starts_from_momenta(arm: sd.Model) -> None:
    p = sd.momentum(arm, Q0, V0)
    for name in METHODS:
        one = sd.hamilton_simulation(arm, Q0, p, 0.05, 0.01, name)
        for old in ("p", "p0"):
            again = sd.hamilton_simulation(arm, Q0, duration=0.05, dt=0.01, method=name, **{old: p})
            assert (again.q == one.q).all()
        two = sd.simulate(arm, Q0, V0, 0.05, 0.01, name)
        np.testing.assert_allclose(one.q, two.q, rtol=0, atol=TINY)
        np.testing.assert_allclose(one.v, two.v, rtol=0, atol=100 * TINY)
    assert sd.hamilton_simulation(arm, Q0, p, 0.05, 0.01).method == "stormer_verlet"


def test_conservation_is_checked_of_a_trajectory() -> None:
    model = sd.load_urdf("pendulum")
    run = sd.simulate(model, [1.0], [0.0], 1.0, 0.01, "gauss4")
    assert "energy" in repr(sd.check_conservation(run, sd.conserved_quantities(model)))


def test_npz_round_trip(arm: sd.Model, tmp_path: Path) -> None:
    run = sd.simulate(arm, Q0, V0, 0.05, 0.01, torque=[0.1, 0.2])
    run.save(tmp_path / "run.npz")
    again = sd.Trajectory.load(tmp_path / "run.npz")
    for name in ("t", "q", "v", "p", "tau", "energy"):
        assert (getattr(again, name) == getattr(run, name)).all()
    assert (again.method, again.dt, again.robot, again.interrupted) == ("rk4", 0.01, "two_link", False)
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(sd.SpatialDynError, match="holds no trajectory"):
        sd.Trajectory.load(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("name", "value"), [("rtol", -1.0), ("atol", 0.0), ("rtol", "1e-9"), ("rtol", np.nan), ("progress", "x")]
)
def test_bad_tolerances_and_progress_are_named(arm: sd.Model, name: str, value: Any) -> None:
    with pytest.raises(sd.SpatialDynError, match=f"{name} is {value!r}, expected"):
        scenes.simulate(arm, Q0, V0, 0.1, 0.01, "dop853", **{name: value})


@pytest.mark.parametrize("what", ["text", "half a file", "an array"])
def test_a_file_that_holds_no_trajectory_is_refused(arm: sd.Model, tmp_path: Path, what: str) -> None:
    path = tmp_path / "run.npz"
    sd.simulate(arm, Q0, V0, 0.0, 0.01).save(path)
    if what == "an array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    else:
        path.write_bytes(b"none" if what == "text" else path.read_bytes()[:900])
    with pytest.raises(sd.SpatialDynError, match="holds no trajectory"):
        sd.Trajectory.load(path)


def test_dataframe_and_plot(arm: sd.Model) -> None:
    run = sd.simulate(arm, Q0, V0, 0.05, 0.01)
    pytest.importorskip("pandas")
    frame = run.to_dataframe()
    assert frame.shape == (6, 9)
    assert frame["q1"].iloc[0] == 0.6
    pytest.importorskip("matplotlib")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside matplotlib
        figure = run.plot(("q", "energy"))
    assert [axes.get_ylabel() for axes in figure.axes] == ["q [rad]", "energy [J]", "|change of T + V| [J]"]
    with pytest.raises(sd.SpatialDynError, match=r"plot of .*, expected some of q, v, tau, p, energy"):
        run.plot(("x",))


def test_trajectory_says_what_it_is(arm: sd.Model) -> None:
    run = sd.simulate(arm, Q0, V0, 0.05, 0.01)
    assert repr(run).startswith("<Trajectory of two_link: rk4, dt 0.01 s, 6 samples of 0 .. 0.05 s, energy 23.")
    assert len(run) == 6


# --- errors ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*METHODS, "dop853"])
def test_a_torque_that_is_not_finite_stops_with_its_time(arm: sd.Model, name: str) -> None:
    def torque(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
        return [0.0, math.nan if t > 0.055 else 0.0]

    with pytest.raises(sd.SimulationError, match=r"torque is .* at t = 0\.\d+ s") as caught:
        sd.simulate(arm, Q0, V0, 0.1, 0.01, name, torque=torque)
    kept = caught.value.trajectory
    assert (1 if name == "dop853" else 5) <= len(kept) <= 6  # SciPy's steps are long
    assert np.isfinite(kept.q).all()


@pytest.mark.slow(quick="test_a_torque_that_is_not_finite_stops_with_its_time")
@COMPILED
def test_a_compiled_torque_that_is_not_finite_stops_with_its_time(arm: sd.Model) -> None:
    with pytest.raises(sd.SimulationError, match=r"torque is not finite at t = 0\.6 s") as caught:
        sd.simulate(arm, Q0, V0, 1.0, 0.1, torque=feedback)
    assert len(caught.value.trajectory) == 6


def test_torques_of_wrong_shape_are_refused(arm: sd.Model) -> None:
    for torque in (np.zeros(3), np.zeros((5, 2)), np.zeros((10, 3)), 1.0):
        with pytest.raises(sd.ShapeError, match=r"torque has shape .*, expected \(2,\) or \(10, 2\), a row per step"):
            sd.simulate(arm, Q0, V0, 0.1, 0.01, torque=torque)
    rows = np.zeros((10, 2))
    rows[7, 1] = math.nan
    with pytest.raises(sd.SimulationError, match=r"torque is \[0.0, nan\] at t = 0.07 s \(row 7\)"):
        sd.simulate(arm, Q0, V0, 0.1, 0.01, torque=rows)
    with pytest.raises(sd.SimulationError, match=r"torque has shape \(3,\) at t = 0 s, expected \(2,\)"):
        sd.simulate(arm, Q0, V0, 0.1, 0.01, torque=lambda t, q, v: [0.0] * 3)
    with pytest.raises(sd.SimulationError, match=r"torque has dtype .* at t = 0 s"):
        sd.simulate(arm, Q0, V0, 0.1, 0.01, torque=lambda t, q, v: None)


def test_what_makes_no_simulation_is_refused(arm: sd.Model) -> None:
    for dt in (0.0, -0.1, math.nan, math.inf, "fast", None, True):
        with pytest.raises(sd.SpatialDynError, match=r"dt is .*, expected a finite number of seconds above 0"):
            sd.simulate(arm, Q0, V0, 1.0, dt)  # type: ignore[arg-type]
    for duration in (-1.0, math.nan, math.inf):
        with pytest.raises(
            sd.SpatialDynError, match=r"duration is .*, expected a finite number of seconds of 0 or more"
        ):
            sd.simulate(arm, Q0, V0, duration, 0.1)
    with pytest.raises(sd.SpatialDynError, match=r"fewer than 2\^53 steps"):
        sd.simulate(arm, Q0, V0, 1e300, 1e-300)
    with pytest.raises(
        sd.SpatialDynError, match="method is 'euler', expected one of explicit_euler, semi_implicit_euler"
    ):
        sd.simulate(arm, Q0, V0, 1.0, 0.1, "euler")
    with pytest.raises(sd.SpatialDynError, match="record is 0, expected a whole number of steps"):
        sd.simulate(arm, Q0, V0, 1.0, 0.1, record=0)
    with pytest.raises(sd.ShapeError, match=r"q0 has shape \(3,\), expected \(2,\)"):
        sd.simulate(arm, [0.0] * 3, V0, 1.0, 0.1)
    with pytest.raises(sd.ShapeError, match=r"p has shape \(1, 2\), expected \(2,\)"):
        sd.hamilton_simulation(arm, Q0, [V0], 1.0, 0.1)
    for name in ("v0", "v"):
        with pytest.raises(sd.SpatialDynError, match=f"{name} is given, expected p, the momenta"):
            sd.hamilton_simulation(arm, Q0, duration=1.0, dt=0.1, **{name: V0})  # type: ignore[call-arg]
    with pytest.raises(sd.NonFiniteError, match=r"v0 is \[nan, 0.0\]"):
        sd.simulate(arm, Q0, [math.nan, 0.0], 1.0, 0.1)
    with pytest.raises(sd.ShapeError, match=r"fext has shape \(6,\), expected \(3, 6\)"):
        sd.simulate(sd.Scene(arm, fext=np.zeros(6)), Q0, V0, 1.0, 0.1)
    with pytest.raises(sd.ModelError, match="model is a str"):
        sd.simulate("panda", Q0, V0, 1.0, 0.1)  # type: ignore[arg-type]
    with pytest.raises(sd.InertiaError, match='joint "b_joint" has zero articulated inertia'):
        sd.simulate(sd.ModelBuilder().add_body("b").build(), [0.0], [0.0], 1.0, 0.1)


def test_quaternions_have_to_be_of_unit_norm() -> None:
    model = sd.load_urdf("floating_body", root="floating")
    with pytest.raises(sd.ConfigurationError):
        sd.simulate(model, [0, 0, 0, 0, 0, 0, 1.1], np.zeros(6), 1.0, 0.1)


def test_an_implicit_step_that_does_not_converge_says_so(arm: sd.Model) -> None:
    for name in ("stormer_verlet", "gauss4", "implicit_midpoint", "symplectic_euler"):
        with pytest.raises(
            sd.SimulationError, match=f"{name} does not converge at t = .* s: the residual is .*; try dt"
        ):
            sd.simulate(arm, Q0, [40.0, -80.0], 5.0, 0.25, name)


def test_a_stalled_step_names_time_residual_and_a_smaller_dt(arm: sd.Model) -> None:
    with pytest.raises(sd.SimulationError) as caught:
        sd.simulate(arm, Q0, V0, 10.0, 0.5, "gauss4")
    assert "gauss4 does not converge at t = " in str(caught.value)
    assert "the residual is" in str(caught.value)
    assert "try dt = 0.125 instead of 0.5" in str(caught.value)
    assert caught.value.trajectory.t[0] == 0.0


@pytest.mark.parametrize("name", ["explicit_euler", "rk4"])
def test_a_state_that_blows_up_stops_and_says_when(arm: sd.Model, name: str) -> None:
    with pytest.raises(
        sd.SimulationError, match=r"diverged at t = \S+ s: the state is not finite; reduce dt, to 0.125 s say"
    ) as caught:
        sd.simulate(arm, Q0, V0, 1e5, 0.5, name)
    kept = caught.value.trajectory
    assert np.isfinite(kept.q).all()
    assert len(kept) >= 1


def test_damping_that_acts_nowhere_is_said_once() -> None:
    model = sd.load_urdf("tree")
    with pytest.warns(
        UserWarning, match='robot "tree" has joint damping or friction, which simulate ignores unless friction=True'
    ) as caught:
        sd.simulate(model, np.zeros(model.nq), np.zeros(model.nv), 0.02, 0.01)
    assert len(caught) == 1
    assert caught[0].filename == __file__


# --- end and progress -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*METHODS, "velocity_verlet", "dop853"])
@pytest.mark.parametrize("record", [1, 4])
def test_ctrl_c_leaves_what_was_recorded_and_the_last_state(arm: sd.Model, name: str, record: int) -> None:
    def torque(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
        if t > 0.055:
            raise KeyboardInterrupt
        return [0.1, 0.0]

    with pytest.raises(sd.SimulationInterrupt, match=r"interrupted at t = 0\.0\d* s of 0.1 s") as caught:
        sd.simulate(arm, Q0, V0, 0.1, 0.01, name, torque=torque, record=record)
    assert isinstance(caught.value, KeyboardInterrupt)
    run = caught.value.trajectory
    assert run.interrupted
    assert "interrupted" in repr(run)
    if name == "dop853":  # whose steps are its own
        assert run.t[0] == 0.0
        return
    whole = sd.simulate(arm, Q0, V0, 0.1, 0.01, name, torque=lambda t, q, v: [0.1, 0.0])
    last = round(run.t[-1] / 0.01)
    assert last in (
        4,
        5,
    )  # the function has raised by then: methods call it within a step, and at its end for the sample
    at = sorted({*range(0, last + 1, record), last})
    np.testing.assert_array_equal(run.t, whole.t[at])
    for part in ("q", "v", "p"):
        np.testing.assert_allclose(getattr(run, part), getattr(whole, part)[at], rtol=0, atol=100 * TINY)


def test_ctrl_c_leaves_the_torque_that_was_held_when_it_came(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a torque for each step; the last state is no sample of the record."""
    torque = np.arange(20.0).reshape(10, 2) / 10.0
    monkeypatch.setattr(fixed_steps, "SLICE", 0.0)
    monkeypatch.setattr(fixed_steps, "program", lambda *_: None)  # which takes more steps at once

    def progress(done: int, total: int) -> None:
        if done >= 5:
            raise KeyboardInterrupt

    with pytest.raises(sd.SimulationInterrupt) as caught:
        sd.simulate(arm, Q0, V0, 0.1, 0.01, torque=torque, record=10, progress=progress)
    run = caught.value.trajectory
    assert run.t.tolist() == [0.0, 0.05]
    np.testing.assert_array_equal(run.tau, torque[[0, 5]])


@pytest.mark.parametrize("start", [sd.simulate, sd.hamilton_simulation])
@pytest.mark.parametrize("name", [*METHODS, "dop853"])
def test_ctrl_c_in_the_first_torque_leaves_the_first_state(arm: sd.Model, name: str, start: Any) -> None:
    def torque(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
        raise KeyboardInterrupt

    with pytest.raises(sd.SimulationInterrupt, match=r"interrupted at t = 0 s of 0.1 s") as caught:
        start(arm, Q0, V0, 0.1, 0.01, name, torque=torque)
    run = caught.value.trajectory
    assert run.t.tolist() == [0.0]
    assert run.q.tolist() == [Q0]
    assert np.isfinite(run.energy).all()
    assert np.isnan(run.tau).all()  # the function was not called


def test_a_loop_of_simulations_ends_at_ctrl_c(arm: sd.Model) -> None:
    begun = 0

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
        signal.raise_signal(signal.SIGINT)
        return [0.0, 0.0]

    def loop() -> None:
        nonlocal begun
        for _ in range(3):
            begun += 1
            sd.simulate(arm, Q0, V0, 0.1, 0.01, torque=torque)

    with pytest.raises(KeyboardInterrupt):
        loop()
    assert begun == 1


@COMPILED
@pytest.mark.parametrize("name", ["rk4", "stormer_verlet"])
def test_ctrl_c_is_heard_between_slices_of_the_compiled_loop(arm: sd.Model, name: str) -> None:
    """The state is one between two samples, that of a run that ends there."""

    def stop(done: int, total: int) -> None:
        if done > 1000:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(sd.SimulationInterrupt, match="interrupted at t = ") as caught:
        sd.simulate(arm, Q0, V0, 1e5, 1e-3, name, record=1 << 20, progress=stop)
    run = caught.value.trajectory
    assert run.interrupted
    assert 1 < len(run) < 100
    wanted = sd.simulate(arm, Q0, V0, run.t[-1], 1e-3, name, record=1 << 20)
    assert wanted.t[-1] == run.t[-1]
    np.testing.assert_array_equal(run.q[-1], wanted.q[-1])
    np.testing.assert_array_equal(run.v[-1], wanted.v[-1])
    assert fixed_steps.SLICE <= 0.1  # seconds until Ctrl-C takes effect


def test_progress_is_reported(arm: sd.Model) -> None:
    reports: list[tuple[int, int]] = []
    sd.simulate(arm, Q0, V0, 0.1, 0.01, progress=lambda done, total: reports.append((done, total)))
    assert reports[-1] == (10, 10)
    assert [done for done, _ in reports] == sorted(done for done, _ in reports)


def test_progress_of_true_is_richs_bar(arm: sd.Model, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rich")
    sd.simulate(arm, Q0, V0, 0.1, 0.01, progress=True)
    assert capsys.readouterr().out == ""


def test_the_table_of_methods_names_all() -> None:
    assert list(integrators) == [method.name for method in integrators.values()]
    for name in integrators:
        assert name in str(sd.simulate.__doc__)
    assert [name for name in OURS if integrators[name].symplectic] == [
        "symplectic_euler", "stormer_verlet", "implicit_midpoint", "gauss4", "gauss6", "variational",
    ]  # fmt: skip


# --- program or table kernel ------------------------------------------------------------------------------


def same_bits(run: sd.Trajectory, other: sd.Trajectory, samples: int) -> None:
    for name in ("t", "q", "v", "p", "tau", "energy"):
        np.testing.assert_array_equal(getattr(run, name)[:samples], getattr(other, name)[:samples], err_msg=name)


@pytest.mark.parametrize("name", OURS)
def test_the_first_steps_of_a_run_are_those_of_a_shorter_one(arm: sd.Model, name: str) -> None:
    """To the last bit, and so are momenta and energies, whatever the number of samples."""
    counts = (3, 20) if numba_kernels.PLAIN else (1, 10, 511, 1000, 4999)
    long = sd.simulate(arm, Q0, V0, (30 if numba_kernels.PLAIN else 5002) * 1e-3, 1e-3, name)
    for count in counts:
        same_bits(sd.simulate(arm, Q0, V0, count * 1e-3, 1e-3, name), long, count + 1)


@COMPILED
@pytest.mark.parametrize("slice_", [0.0, 1e-4])
def test_slices_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch, slice_: float) -> None:
    model, rng = random_tree(11, 5, floating=True).model, np.random.default_rng(4)
    q0, v0 = sd.random_configuration(model, rng), 0.1 * rng.standard_normal(model.nv)
    torque = 0.1 * rng.standard_normal((61, model.nv))
    for name in METHODS:
        wanted = sd.simulate(model, q0, v0, 0.0605, 1e-3, name, torque=torque, record=7)
        with monkeypatch.context() as patch:
            patch.setattr(fixed_steps, "SLICE", slice_)
            patch.setattr(fixed_steps, "STEPS", 3)
            same_bits(sd.simulate(model, q0, v0, 0.0605, 1e-3, name, torque=torque, record=7), wanted, len(wanted))


@COMPILED
@pytest.mark.parametrize(
    ("method", "record"),
    slow_but(
        [("rk4", 1), ("rk4", 40), ("semi_implicit_euler", 7)],
        [
            (method, record)
            for method in ("explicit_euler", "semi_implicit_euler", "velocity_verlet", "rk4")
            for record in (1, 7, 40, 1000)
        ],
    ),
)
def test_a_program_steps_as_the_compiled_table_does(monkeypatch: pytest.MonkeyPatch, method: str, record: int) -> None:
    model = random_tree(11, 5, floating=True).model
    rng = np.random.default_rng(4)
    q0, v0 = sd.random_configuration(model, rng), 0.1 * rng.standard_normal(model.nv)
    torque = 0.1 * rng.standard_normal((101, model.nv))
    given: dict[str, Any] = {"method": method, "torque": torque, "record": record}
    found = scenes.simulate(model, q0, v0, 0.1005, 1e-3, **given)
    monkeypatch.setattr(fixed_steps, "program", lambda *_: None)
    wanted = scenes.simulate(model, q0, v0, 0.1005, 1e-3, **given)
    for name in ("t", "tau"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    for name in ("q", "v", "p", "energy"):
        x, y = getattr(found, name), getattr(wanted, name)
        assert abs(x - y).max() <= 1e4 * EPS * max(1.0, abs(y).max())  # a hundred steps, rounded otherwise


@COMPILED
def test_a_step_is_one_program_for_each_robot_and_method(arm: sd.Model) -> None:
    made = plan.Plan(sd.Scene(arm), "rk4", ())
    assert made.kernel() is not None
    assert made.kernel() is plan.Plan(sd.Scene(arm), "rk4", ()).kernel()


@COMPILED
@pytest.mark.parametrize("method", EXPLICIT_METHODS)
def test_one_sample_has_the_bits_of_many(method: str) -> None:
    """Also of a sample in their midst whose angle passes the program's range."""
    model, rng = random_tree(11, 5, floating=True).model, np.random.default_rng(4)
    q0, v0 = sd.random_configuration(model, rng, shape=11), 0.1 * rng.standard_normal((11, model.nv))
    turning = next(j for j in model.joints[1:] if j.nq == 1 and j.kind == "revolute")
    q0[7, turning.idx_q], v0[7, turning.idx_v] = 1e5 - 0.005, 1.0
    many = sd.rollout(model, q0, v0, dt=1e-3, steps=20, method=method)
    for b in (0, 7, 10):
        one = sd.simulate(model, q0[b], v0[b], 0.02, 1e-3, method)
        np.testing.assert_array_equal(many.q[b], one.q[1:])
        np.testing.assert_array_equal(many.v[b], one.v[1:])


@COMPILED
@pytest.mark.parametrize(("method", "far"), [("semi_implicit_euler", 1e5), ("rk4", 5e4)])  # a sum over the stages
def test_from_the_first_step_without_an_answer_on_it_is_the_table(
    arm: sd.Model, method: str, far: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An angle that passes the program's range in the middle: bits are the same however the run is cut and sliced."""
    q0, v0 = [far - 5.0, 0.6], [100.0, 0.0]
    tables: list[int] = []
    right = fixed_steps.compile_loop

    def counted(*arguments: Any) -> Any:
        def loop(*passed: Any) -> None:
            tables.append(passed[-10])
            right(*arguments)(*passed)

        return loop

    monkeypatch.setattr(fixed_steps, "compile_loop", counted)
    monkeypatch.setattr(fixed_steps, "PLAIN_ROWS", 0)  # a compiled loop takes over sooner
    long = sd.simulate(arm, q0, v0, 0.4, 1e-3, method)
    first = min(tables)
    assert 5 < first < 350
    for count in (first - 1, first, first + 1, 300):
        same_bits(sd.simulate(arm, q0, v0, count * 1e-3, 1e-3, method), long, count + 1)
    monkeypatch.setattr(fixed_steps, "SLICE", 0.0)
    tables.clear()
    same_bits(sd.simulate(arm, q0, v0, 0.4, 1e-3, method), long, 401)
    assert min(tables) == first


@COMPILED
def test_states_beyond_the_programs_range_run_in_the_table_kernel() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.SimulationError, match=r"diverged at t = .* the state is not finite") as caught:
        sd.simulate(model, [0.1, 0.2], [1e120, 0.0], 1.0, 0.01, "explicit_euler")
    assert caught.value.trajectory is not None
    far = sd.simulate(model, [2e5 * np.pi, 0.2], [0.0, 0.0], 0.1, 0.01)  # beyond the short sine
    near = sd.simulate(model, [0.0, 0.2], [0.0, 0.0], 0.1, 0.01)
    assert abs(far.v - near.v).max() <= 1e-8


# --- motions that diverge ---------------------------------------------------------------------------------


def slider(gravity: float = -10.0) -> sd.Model:
    builder = sd.ModelBuilder()
    builder.add_body("slide", joint="prismatic", axis=(0, 0, 1), inertia=(2.0, (0, 0, 0), np.eye(3)))
    return builder.build(gravity=(0.0, 0.0, gravity))


IGNORED = "ignore:.* has joint damping or friction"


@pytest.mark.parametrize(
    ("method", "dt"), [pytest.param("rk4", 0.03, marks=COMPILED), ("rk4", 0.1), ("explicit_euler", 0.1)]
)
@pytest.mark.filterwarnings(IGNORED)
def test_a_motion_that_diverges_is_not_blamed_on_the_robot(method: str, dt: float) -> None:
    """Fingers of a Panda, a few grams beside an arm, that fly a million metres away."""
    model = sd.load_urdf("panda")
    q0 = sd.random_configuration(model, np.random.default_rng(0))
    with pytest.raises(sd.SimulationError, match=rf"{method} diverged at t = .*reduce dt, to {dt / 4:g} s say"):
        sd.simulate(model, q0, np.zeros(model.nv), 10.0, dt, method)


@COMPILED
@pytest.mark.filterwarnings(IGNORED)
def test_an_energy_that_explodes_is_an_error_with_its_time() -> None:
    """Finite all the way, and 3e7 J where gravity has 1e5."""
    model = sd.load_urdf("panda")
    q0 = sd.random_configuration(model, np.random.default_rng(0))
    with pytest.raises(sd.SimulationError, match=r"diverged at t = .*: the energy has risen by .* J, where") as caught:
        sd.simulate(model, q0, np.zeros(model.nv), 100.0, 0.01, "rk4")
    run = caught.value.trajectory
    assert run.t[-1] == 100.0
    assert np.isfinite(run.q).all()


def test_motions_that_gain_what_is_theirs_are_no_divergence(arm: sd.Model) -> None:
    """Free fall, a torque that goes on, a start from rest by explicit Euler, a robot that never moves."""
    fall = sd.simulate(slider(), [0.0], [0.0], 0.1, 0.01, "explicit_euler")
    assert fall.v[-1, 0] == pytest.approx(-1.0)
    pushed = sd.simulate(slider(0.0), [0.0], [0.0], 100.0, 10.0, torque=[1e6])
    assert pushed.energy[-1] == pytest.approx(0.5 * 2.0 * (5e5 * 100.0) ** 2)
    late = np.zeros((20, 1))
    late[3] = 1e6  # between two samples
    assert len(sd.simulate(slider(0.0), [0.0], [0.0], 0.2, 0.01, torque=late, record=10)) == 3
    asked = sd.simulate(slider(0.0), [0.0], [0.0], 1.0, 0.1, torque=lambda t, q, v: [1e6], record=10)
    assert asked.v[-1, 0] == pytest.approx(5e5)
    for steps in (1, 2, 3, 10):
        for method in ("explicit_euler", "semi_implicit_euler"):
            sd.simulate(arm, [0.5, 0.1], [0.0, 0.0], steps * 1e-2, 1e-2, method)
    still = sd.simulate(arm, [-np.pi / 2, 0.0], [0.0, 0.0], 0.1, 0.01)
    assert abs(still.v).max() <= 1e-12


@pytest.mark.parametrize(("factor", "found"), [(99.0, None), (101.0, 3)])
def test_the_threshold_of_an_explosion_is_a_hundred_times_the_scale(factor: float, found: int | None) -> None:
    T, V = np.array([1.0, 1.0, 1.5, 1.0]), np.array([0.0, -0.5, -1.0, -1.0])
    T[3] += 1.0 + factor * 2.0
    v, steps = np.zeros((4, 1)), np.arange(4)
    np.testing.assert_allclose(scale_of(T, V), [1.0, 1.5, 2.0, 2.0], rtol=1e-8)
    assert exploded(steps * 0.1, v, T, V, np.zeros(1), steps) == found
    assert exploded(steps * 0.1, v + 1e4, T, V, np.ones(1), steps) is None  # 3000 J of work
    T[2] = np.nan
    assert exploded(steps * 0.1, v, T, V, np.zeros(1), steps) == 2


def test_a_trajectory_says_how_well_it_was_conserved() -> None:
    model = sd.load_urdf("two_link")
    report = sd.check_conservation(sd.simulate(model, [1.0, 0.5], [0.0, 0.0], 2.0, 1e-2, "gauss6"))
    (energy,) = [line for line in report if "energy" in line.name]
    assert 0.0 < energy.drift <= 1e-4
