"""Motion under constraints: closed loops and rolling against closed forms, simulate and rollout alike, errors."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from dense import Array
from plain import compiled
from slow import slow_but

import spatialdyn as sd
from spatialdyn.constraints.dynamics import constrained_motion
from spatialdyn.simulation import plan
from spatialdyn.simulation.effects import constraints

sys.path.append(str(Path(__file__).parents[1] / "constraints"))
from mechanisms import G, four_bar, four_bar_state, pin_of

pytestmark = compiled  # thousands of steps
EPS = np.finfo(float).eps
PACKAGE = str(Path(sd.__file__).parent)
MOST_FILES = 12  # of the package
METHODS = ("explicit_euler", "semi_implicit_euler", "velocity_verlet", "rk4")


def left_open(model: sd.Model, held: sd.Constraints, q: Array, v: Array) -> tuple[float, float]:
    """Largest |φ| and |J v| of samples."""
    J = sd.constraint_jacobian(model, held, q)
    return float(abs(sd.constraint_error(model, held, q)).max()), float(abs((J @ v[..., None])[..., 0]).max())


# --- closed loops ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", slow_but(["rk4", "semi_implicit_euler"], METHODS))
def test_a_loop_stays_closed_by_projection(method: str) -> None:
    """Drift is of rounding: the step opens the loop by h², Newton's step leaves its square."""
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    run = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.5, 1e-3, method)
    phi, Jv = left_open(model, held, run.q, run.v)
    assert phi <= (1e-14 if method == "rk4" else 1e-9)
    assert Jv <= 1e-13
    assert np.ptp(run.energy) <= {"rk4": 1e-8, "velocity_verlet": 1e-4}.get(method, 0.1)


def test_a_four_bar_moves_as_its_one_freedom() -> None:
    """θ̈ of the run's own (θ, θ̇), by differences; and the same motion in three times as many steps."""
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    coarse = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.6, 2e-3)
    fine = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.6, 1e-3)
    assert abs(coarse.q - fine.q[::2]).max() <= 1e-7
    assert abs(coarse.q - fine.q[::2]).max() >= 1e-12
    found = np.gradient(fine.v[:, 0], fine.t)[1:-1]
    a = sd.constrained_dynamics(model, held, fine.q, fine.v, np.zeros(3)).a[1:-1, 0]
    assert abs(found - a).max() <= 1e-3 * abs(a).max()


@pytest.mark.parametrize("method", slow_but(["semi_implicit_euler"], METHODS))
def test_a_rollout_is_so_many_constrained_simulations(method: str) -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held, tau = pin_of(model), np.random.default_rng(0).normal(size=(12, 3))
    for T in (None, 0.05):
        found = sd.rollout(
            sd.Scene(model, constraints=held, stabilization=T), np.tile(q, (9, 1)), v, tau, dt=1e-3, method=method
        )
        wanted = sd.simulate(sd.Scene(model, constraints=held, stabilization=T), q, v, 0.012, 1e-3, method, tau)
        assert abs(found.q - wanted.q[1:]).max() <= 1e-13
        assert abs(found.v - wanted.v[1:]).max() <= 1e-12


def test_the_program_and_the_calls_take_the_same_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A function of Python as torque runs by calls, a torque that is held in one program."""
    model, (q, v) = four_bar(), four_bar_state()
    held, tau = pin_of(model), np.array([0.1, 0.0, -0.1])
    at_once = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.05, 1e-3, torque=tau)
    assert plan._kernel.cache_info().currsize
    by_calls = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.05, 1e-3, torque=lambda t, q, v: tau)
    assert abs(at_once.q - by_calls.q).max() <= 1e-13
    pd = sd.PD(kp=[3.0, 0, 0], kd=[0.1, 0, 0], q_ref=[1.0, 0, 0])
    run = sd.rollout(sd.Scene(model, constraints=held), q, v, dt=1e-3, steps=2000, control=pd)
    assert abs(run.v[-1]).max() < abs(run.v).max()
    assert left_open(model, held, run.q, run.v)[0] <= 1e-9


def test_a_run_like_an_earlier_one_visits_a_dozen_files() -> None:
    """What is known from scene and method alone is kept with the scene."""
    model, (q, v) = four_bar(), four_bar_state()
    scene, files = sd.Scene(model, constraints=pin_of(model)), set()

    def note(frame: Any, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(PACKAGE):
            files.add(frame.f_code.co_filename)

    sd.simulate(scene, q, v, 0.05, 1e-3)
    sys.setprofile(note)
    try:
        sd.simulate(scene, q, v, 0.05, 1e-3)
    finally:
        sys.setprofile(None)
    assert len(files) <= MOST_FILES, sorted(files)


def test_stabilization_is_a_time_in_which_errors_die() -> None:
    """φ and J v stay of the order of a step's error; after a start that is open by 1e-7, they die like exp(-t/T)."""
    model, (q, v) = four_bar(), four_bar_state()
    held, T = pin_of(model), 0.02
    run = sd.simulate(sd.Scene(model, constraints=held, stabilization=T), q, v, 0.5, 1e-3)
    phi, _ = left_open(model, held, run.q, run.v)
    assert 1e-13 <= phi <= 1e-7
    off = q + np.array([3e-7, 0, 0])
    run = sd.simulate(sd.Scene(model, constraints=held, stabilization=T), off, 0 * v, 0.2, 1e-3)
    errors = abs(sd.constraint_error(model, held, run.q)).max(axis=1)
    wanted = errors[0] * (1 + run.t / T) * np.exp(-run.t / T)  # φ̈ + 2 φ̇/T + φ/T² = 0 from rest
    assert abs(errors - wanted).max() <= 0.05 * errors[0]


def test_gains_of_ten_over_the_step_explode() -> None:
    """α = β = 10/dt, which one finds recommended, is z = -118 a step of semi-implicit Euler; 3 dt as a time is calm."""
    model, (q, v) = four_bar(), four_bar_state()
    held, dt = pin_of(model), 1e-3

    def errors(T: float) -> Array:
        x, w, found = q + np.array([1e-9, 0, 0]), v.copy(), []
        for _ in range(4):
            w = w + dt * constrained_motion(model, held, x, w, np.zeros(3), T).a
            x = x + dt * w
            found.append(abs(sd.constraint_error(model, held, x)).max())
        return np.array(found)

    explodes = errors(dt / 10)
    assert (explodes[1:] > 50.0 * explodes[:-1]).all()
    assert errors(3 * dt).max() <= 1e-5
    with pytest.raises(sd.SimulationError, match=r"stabilization is 0\.0001 s, expected at least 3 dt = 0\.003 s"):
        sd.simulate(sd.Scene(model, constraints=held, stabilization=dt / 10), q, v, 0.1, dt)


@pytest.mark.parametrize(
    ("h", "steps", "wanted"),
    slow_but([(4e-3, 200, 6.277e-4)], [(4e-3, 200, 6.277e-4), (2e-3, 1000, 1.571e-4), (4e-3, 4000, 6.288e-4)]),
)
def test_rattle_keeps_energy_within_bounds(h: float, steps: int, wanted: float) -> None:
    """The error is of order h² and does not grow; loop and velocities are closed to rounding."""
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    run = sd.simulate(sd.Scene(model, constraints=held), q, v, steps * h, h, "stormer_verlet")
    assert abs(run.energy - run.energy[0]).max() == pytest.approx(wanted, rel=1e-3)
    phi, Jv = left_open(model, held, run.q, run.v)
    assert phi <= 1e-14
    assert Jv <= 1e-13


def bead() -> tuple[sd.Model, sd.Constraints, Array, float]:
    """A pendulum of 1 m as a particle on a rod, let go at 1 rad, and its period."""
    made = sd.ModelBuilder("bead").add_body("x", None, "prismatic", (1, 0, 0))
    made.add_body("bob", "x", "prismatic", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.zeros((3, 3))))
    model = made.build(gravity=(0, 0, -G))
    held = sd.Constraints(model, [sd.DistanceConstraint("bob", length=1.0)])
    return model, held, np.array([math.sin(1.0), -math.cos(1.0)]), 2.139137600558689


def test_a_pendulum_as_a_particle_swings_in_its_period() -> None:
    model, held, q, period = bead()
    end = sd.simulate(sd.Scene(model, constraints=held), q, np.zeros(2), period, period / 2000)
    assert abs(end.q[-1] - q).max() <= 1e-12
    assert abs(end.v[-1]).max() <= 1e-10


@pytest.mark.parametrize(("steps", "wanted"), [(1e6, 3.51e-3), (10, 8.70e-7), (5, 3.12e-6)])
def test_a_pendulum_drifts_least_where_errors_die_in_ten_steps(steps: float, wanted: float) -> None:
    """Largest |φ| of 20 periods in steps of a hundredth, by a time of so many steps; in 1e6 it is as without."""
    model, held, q, period = bead()
    dt = period / 100
    run = sd.simulate(sd.Scene(model, constraints=held, stabilization=steps * dt), q, np.zeros(2), 20 * period, dt)
    assert abs(sd.constraint_error(model, held, run.q)).max() == pytest.approx(wanted, rel=3e-3)


def test_a_pendulums_energy_errs_by_6e_3_joule_in_both_symplectic_methods() -> None:
    """6.2e-3 J in steps of a hundredth of the period, a quarter of it in half of them."""
    model, held, q, period = bead()
    for steps, method, wanted in (
        (100, "stormer_verlet", 6.2e-3),
        (100, "variational", 6.2e-3),
        (200, "variational", 1.56e-3),
    ):
        run = sd.simulate(sd.Scene(model, constraints=held), q, np.zeros(2), period, period / steps, method)
        assert np.ptp(run.energy) == pytest.approx(wanted, rel=5e-3)


def test_rattle_is_of_order_two_and_reversible() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    exact = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.2, 5e-4).q[-1]
    errors = []
    for h in (4e-3, 2e-3):
        run = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.2, h, "stormer_verlet")
        errors.append(abs(run.q[-1] - exact).max())
        back = sd.simulate(sd.Scene(model, constraints=held), run.q[-1], -run.v[-1], 0.2, h, "stormer_verlet")
        assert abs(back.q[-1] - q).max() <= 1e-11
    assert 3.5 <= errors[0] / errors[1] <= 4.5


def test_rattle_takes_torques() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    run = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, "stormer_verlet", [0.5, 0, 0])
    wanted = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, "rk4", [0.5, 0, 0])
    assert abs(run.q[-1] - wanted.q[-1]).max() <= 1e-5
    damped = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, "stormer_verlet", lambda t, q, v: -0.1 * v)
    assert damped.energy[-1] < damped.energy[0] - 1e-3


@pytest.mark.parametrize("method", ["stormer_verlet", "variational", "rk4"])
def test_external_forces_act_under_constraints(method: str) -> None:
    """A force on the rocker that is fixed in it does the work of its moment about the rocker's pivot."""
    model, (q, v) = four_bar(), four_bar_state()
    held, moment = pin_of(model), 0.3
    fext = np.zeros((model.njoints, 6))
    fext[3, 1] = 3.0  # at the pivot it has no moment
    fext[3, 5] = moment
    run = sd.simulate(sd.Scene(model, fext=fext, constraints=held), q, v, 0.05, 1e-3, method)
    wanted = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.05, 1e-3, method, [0, 0, moment])
    assert abs(run.q - wanted.q).max() <= 1e-12
    assert abs(run.v - wanted.v).max() <= 1e-11


def test_the_variational_integrator_keeps_a_loop_closed_and_energy_bounded() -> None:
    """|φ| of rounding; an error of order h², that does not grow; and the map back in time is its inverse."""
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    exact = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.2, 5e-4).q[-1]
    errors = []
    for h in (4e-3, 2e-3):
        run = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.2, h, "variational")
        errors.append(abs(run.q[-1] - exact).max())
        phi, Jv = left_open(model, held, run.q, run.v)
        assert phi <= 1e-14
        assert Jv <= 1e-13
        back = sd.simulate(sd.Scene(model, constraints=held), run.q[-1], -run.v[-1], 0.2, h, "variational")
        assert abs(back.q[-1] - q).max() <= 1e-12
    assert 3.5 <= errors[0] / errors[1] <= 4.5
    long = sd.simulate(sd.Scene(model, constraints=held), q, v, 6.0, 4e-3, "variational")
    off = abs(long.energy - long.energy[0])
    assert off.max() <= 1.01 * off[:500].max()
    assert off.max() <= 3e-3


@pytest.mark.parametrize("method", ["variational", "stormer_verlet"])
def test_symplectic_methods_under_constraints_have_the_armatures_of_forward_dynamics(method: str) -> None:
    """A planar body with an armature on a rod, for RATTLE a four-bar: the limit of two runs is rk4's."""
    made = sd.ModelBuilder("tied")
    made.add_body("sled", None, "planar", (0, 1, 0), inertia=(1.0, (0.1, 0, 0.2), np.diag([0.02, 0.03, 0.02])))
    model = made.build().with_(armature={"sled_joint": 0.3})
    held = sd.Constraints(model, [sd.DistanceConstraint("sled", length=0.5, at_a=(0.2, 0, 0.1))])
    q = sd.project_configuration(model, held, [0.2, 0.4, 0.3])
    v = sd.project_velocity(model, held, q, [1.0, -0.5, 2.0])
    if method == "stormer_verlet":
        model, (q, v) = four_bar().with_(armature={"crank_joint": 0.01, "rocker_joint": 0.02}), four_bar_state()
        held = pin_of(model)
    exact = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 5e-4)
    coarse, fine = (sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, h, method) for h in (4e-3, 2e-3))
    assert abs((4.0 * fine.q[-1] - coarse.q[-1]) / 3.0 - exact.q[-1]).max() <= 1e-8


def test_the_variational_integrator_takes_quaternions() -> None:
    """A pendulum of a floating body that a point holds: |φ| and the energy; momentum about the vertical is kept."""
    made = sd.ModelBuilder("hung")
    made.add_body("top", None, "floating", inertia=(1.5, (0.02, 0, 0.1), np.diag([0.05, 0.04, 0.02])))
    model = made.build()
    held = sd.Constraints(model, [sd.PointConstraint("top", at_a=(0, 0, 0.3))])
    q = sd.project_configuration(model, held, sd.normalize(model, [0, 0, -0.3, 0.1, 0.2, 0, 0.97]))
    v = sd.project_velocity(model, held, q, [0, 0, 0, 0.5, -0.3, 3.0])
    runs = [sd.simulate(sd.Scene(model, constraints=held), q, v, 1.0, h, "variational") for h in (4e-3, 2e-3)]
    exact = sd.simulate(sd.Scene(model, constraints=held), q, v, 1.0, 1e-3)
    errors = [abs(sd.difference(model, run.q[-1], exact.q[-1])).max() for run in runs]
    assert 3.5 <= errors[0] / errors[1] <= 4.5
    phi, Jv = left_open(model, held, runs[0].q, runs[0].v)
    assert phi <= 1e-14
    assert Jv <= 1e-12
    assert np.ptp(runs[0].energy) <= 1e-3

    def about_the_vertical(run: sd.Trajectory) -> Array:
        R, p = sd.frame_placement(model, run.q, "top")[:, :3, :3], run.q[:, :3]
        h = sd.crba(model, run.q) @ run.v[..., None]
        linear, angular = (R @ h[:, :3])[..., 0], (R @ h[:, 3:])[..., 0]
        return np.asarray((angular + np.cross(p, linear))[:, 2])

    assert np.ptp(about_the_vertical(runs[0])) <= 1e-12


def test_what_rattle_cannot_do() -> None:
    model, (q, v) = four_bar(), four_bar_state()

    def refused(model: sd.Model, items: Any, q: Any, v: Any, **options: Any) -> str:
        held = sd.Constraints(model, items)
        with pytest.raises(sd.SimulationError) as caught:
            scenes.simulate(model, q, v, 0.1, 1e-3, "stormer_verlet", constraints=held, **options)
        return str(caught.value)

    still = np.zeros(3)
    text = refused(model, [sd.VelocityConstraint([1.0, 0, 0])], q, still)
    assert text == (
        "stormer_verlet is given VelocityConstraint(), expected equations of positions; explicit methods take those of "
        "velocities"
    )
    assert "expected None for stormer_verlet: it keeps φ = 0" in refused(
        model, [*pin_of(model)], q, v, stabilization=0.1
    )
    free, _ = disc(0.1)
    hung = [sd.PointConstraint("disc")]
    wanted = 'is given joint "disc_joint" (floating), expected joints whose position is one number; method variational'
    assert wanted in refused(free, hung, sd.neutral(free), np.zeros(6))


def test_a_quadruped_holds_its_feet() -> None:
    """A floating trunk on four legs whose feet are held: they stay where they are, within rounding."""
    made = sd.ModelBuilder("stool")
    made.add_body("trunk", None, "floating", inertia=(5.0, (0, 0, 0), 0.1 * np.eye(3)))
    held = []
    for k, (x, y) in enumerate(((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2))):
        link = (0.5, (0, 0, -0.1), 0.002 * np.eye(3))
        made.add_body(f"hip{k}", "trunk", "revolute", (1, 0, 0), (x, y, 0), link)
        made.add_body(f"thigh{k}", f"hip{k}", "revolute", (0, 1, 0), (0, 0, 0), link)
        made.add_body(f"shank{k}", f"thigh{k}", "revolute", (0, 1, 0), (0, 0, -0.2), link)
        held.append(f"shank{k}")
    model = made.build()
    q = sd.neutral(model)
    q[7:] = np.tile([0.1, 0.5, -1.0], 4)
    foot = np.array([0, 0, -0.2])

    def places(x: Array) -> list[Array]:
        return [(sd.frame_placement(model, x, name) @ np.append(foot, 1.0))[..., :3] for name in held]

    feet = sd.Constraints(
        model, [sd.PointConstraint(name, at_a=foot, at_b=p) for name, p in zip(held, places(q), strict=True)]
    )
    v = sd.project_velocity(model, feet, q, np.random.default_rng(0).normal(size=model.nv))
    pd = sd.PD(np.r_[np.zeros(6), 80.0 * np.ones(12)], np.r_[np.zeros(6), 2.0 * np.ones(12)], q)
    run = sd.rollout(sd.Scene(model, constraints=feet), q, v, dt=2e-3, steps=200, control=pd)
    for name, at, start in zip(held, places(run.q), places(q), strict=True):
        assert abs(at - start).max() <= 1e-8, name
    assert abs(run.v[-1]).max() <= 0.05 * abs(run.v[0]).max()


# --- rolling, and other constraints on velocities -------------------------------------------------------


def test_chaplygins_sleigh() -> None:
    """u = V tanh(a V t / k² + c), ω = V/k sech(...), of a blade a behind the centre of mass."""
    m, I, a, u0, w0, t = 2.0, 0.3, 0.4, 0.5, 2.0, 2.0
    made = sd.ModelBuilder("sleigh")
    made.add_body("sleigh", None, "planar", (0, 0, 1), inertia=(m, (a, 0, 0), np.diag([0.1, 0.2, I])))
    model = made.build()
    blade = sd.Constraints(model, [sd.VelocityConstraint([0, 1, 0], name="blade")])
    run = sd.simulate(sd.Scene(model, constraints=blade), [0, 0, 0], [u0, 0, w0], t, 1e-3)
    k = math.sqrt((I + m * a * a) / m)
    V = math.hypot(u0, k * w0)
    phase = a * V * t / k**2 + math.atanh(u0 / V)
    u, w = V * math.tanh(phase), V / k / math.cosh(phase)
    assert (u, w) == pytest.approx((1.2187797062, 0.1214964200), abs=1e-10)
    assert run.v[-1] == pytest.approx([u, 0.0, w], abs=1e-10)
    assert np.ptp(run.energy) <= 1e-10


def test_a_knife_edge_on_an_incline_does_not_slide_down() -> None:
    """x = g sin β / (2 ω²) sin² ωt stays bounded, y drifts across: the mechanics of d'Alembert, not of a variation."""
    beta, w, t = 0.3, 2.0, 1.3
    made = sd.ModelBuilder("knife")
    made.add_body("blade", None, "planar", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.diag([0.1, 0.2, 0.3])))
    model = made.build(gravity=(G * math.sin(beta), 0, -G * math.cos(beta)))
    edge = sd.Constraints(model, [sd.VelocityConstraint([0, 1, 0])])
    run = sd.simulate(sd.Scene(model, constraints=edge), [0, 0, 0], [0, 0, w], t, 1e-3)
    c = G * math.sin(beta) / (2 * w * w)
    wanted = [c * math.sin(w * t) ** 2, c * (w * t - 0.5 * math.sin(2 * w * t)), w * t]
    assert wanted[1] == pytest.approx(1.1022661783, abs=1e-9)
    assert run.q[-1] == pytest.approx(wanted, abs=1e-9)


def disc(radius: float) -> tuple[sd.Model, sd.Constraints]:
    """A thin disc of 1 kg that rolls."""
    made, I = sd.ModelBuilder("disc"), 0.25 * radius**2
    made.add_body("disc", None, "floating", inertia=(1.0, (0, 0, 0), np.diag([I, 2 * I, I])))
    model = made.build()
    return model, sd.Constraints(model, [sd.RollingConstraint("disc", (0, 1, 0), radius)])


def test_a_thin_disc_stands_upright_when_it_rolls_fast() -> None:
    """It does above ω² = g / (3 r): from a lean of 1e-4 it falls over 5 % below that, and stays up 5 % above."""
    r, lean = 0.1, 1e-4
    model, held = disc(r)
    critical = math.sqrt(G / (3 * r))
    assert critical == pytest.approx(5.718391, abs=1e-6)
    leans = []
    for factor in (0.95, 1.05):
        q = np.array([0, 0, r * math.cos(lean), math.sin(lean / 2), 0, 0, math.cos(lean / 2)])
        v = np.array([0, 0, 0, 0, factor * critical, 0])
        J = sd.constraint_jacobian(model, held, q)
        v[:3] = np.linalg.solve(J[:, :3], -J[:, 3:] @ v[3:])
        run = sd.simulate(sd.Scene(model, constraints=held), q, v, 3.0, 1e-3)
        tilt = np.arcsin(sd.frame_placement(model, run.q, "disc")[:, 2, 1])
        leans.append(abs(tilt).max())
        assert abs(run.q[:, 2] - r * np.cos(tilt)).max() <= 1e-11  # it touches the ground
        assert np.ptp(run.energy) <= 1e-10
    assert leans[0] > 0.3
    assert leans[1] < 0.0025


def test_a_wheel_held_upright_rolls_in_a_circle() -> None:
    """The radius is r θ̇ / φ̇. Its vertical equation is always met: it drops out."""
    r, spin, turn = 0.1, 5.0, 1.5
    made = sd.ModelBuilder("unicycle")
    made.add_body("fork", None, "planar", (0, 0, 1), inertia=(1.0, (0, 0, 0), 0.01 * np.eye(3)))
    made.add_body("wheel", "fork", "continuous", (0, 1, 0), (0, 0, r), (0.5, (0, 0, 0), 0.002 * np.eye(3)))
    model = made.build()
    held = sd.Constraints(model, [sd.RollingConstraint("wheel", (0, 1, 0), r)])
    v = np.array([r * spin, 0.0, turn, spin])
    run = sd.simulate(sd.Scene(model, constraints=held), np.zeros(4), v, 2 * math.pi / turn, 1e-3)
    assert np.ptp(run.q[:, 1]) == pytest.approx(2 * r * spin / turn, rel=1e-4)
    assert run.q[-1, :2] == pytest.approx([0, 0], abs=1e-6)
    assert sd.constrained_dynamics(model, held, run.q[0], v, np.zeros(4)).rank == 2


def test_a_sphere_rolls_down_an_incline() -> None:
    """a = g sin β / (1 + 2/5), whichever way the sphere has turned."""
    beta, r = 0.3, 0.05
    made, I = sd.ModelBuilder("ball"), 0.4 * r**2
    made.add_body("ball", None, "floating", inertia=(1.0, (0, 0, 0), I * np.eye(3)))
    model = made.build(gravity=(G * math.sin(beta), 0, -G * math.cos(beta)))
    held = sd.Constraints(model, [sd.RollingConstraint("ball", None, r)])
    q = sd.normalize(model, [0, 0, r, 0.1, 0.2, 0.3, 0.9])
    run = sd.simulate(sd.Scene(model, constraints=held), q, np.zeros(6), 1.0, 1e-3)
    assert run.q[-1, :3] == pytest.approx([0.5 * G * math.sin(beta) / 1.4, 0, r], abs=1e-7)


# --- what is refused ------------------------------------------------------------------------------------


def test_starts_that_do_not_meet_the_constraints_are_refused() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    with pytest.raises(sd.ConstraintError, match=r"^pin x is open by 0\.914.* mm, .* at the beginning; project_config"):
        sd.simulate(sd.Scene(model, constraints=held), q + 1e-3, v, 0.1, 1e-3)
    with pytest.raises(sd.ConstraintError, match=r"^v0 moves pin x at 0\.00914, expected 0; project_velocity gives"):
        sd.simulate(sd.Scene(model, constraints=held), q, v + 1e-2, 0.1, 1e-3)
    starts, speeds = np.tile(q, (5, 1)), np.tile(v, (5, 1))
    speeds[3] += 1e-2
    with pytest.raises(sd.ConstraintError, match=r"^v0 of sample 3 moves pin x"):
        sd.rollout(sd.Scene(model, constraints=held), starts, speeds, dt=1e-3, steps=3)
    starts[2] += 1e-3
    with pytest.raises(sd.ConstraintError, match=r"^pin x is open by .* mm in sample 2"):
        sd.rollout(sd.Scene(model, constraints=held), starts, speeds, dt=1e-3, steps=3)


def test_what_runs_under_constraints_cannot_do() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    with pytest.raises(sd.SimulationError, match='method is "gauss4" and constraints act, expected one of explicit_'):
        sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, "gauss4")
    sliding, still = sd.Constraints(model, [sd.VelocityConstraint([1.0, 0, 0])]), np.zeros(3)
    with pytest.raises(sd.SimulationError, match=r"variational is given VelocityConstraint\(\), expected equations of"):
        sd.simulate(sd.Scene(model, constraints=sliding), q, still, 0.1, 1e-3, "variational")
    with pytest.raises(sd.SimulationError, match=r"stabilization is 0\.1, expected None: no constraints are given"):
        sd.simulate(sd.Scene(model, stabilization=0.1), q, v, 0.1, 1e-3)
    with pytest.raises(sd.SimulationError, match="dtype is float32, expected float64 with constraints"):
        sd.rollout(sd.Scene(model, constraints=held), q, v, dt=1e-3, steps=1, dtype=np.float32)
    with pytest.raises(sd.ModelError, match="constraints are of another model"):
        sd.simulate(sd.Scene(four_bar(0.3), constraints=held), q, v, 0.1, 1e-3)
    with pytest.raises(sd.SimulationError, match='method is "dop853" and constraints act, expected one of explicit_'):
        sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, "dop853")


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_scipys_methods_take_constraints_that_are_stabilized(method: str) -> None:
    """They end no step with a projection, and drift by their tolerance alone."""
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    run = sd.simulate(sd.Scene(model, constraints=held, stabilization=0.05), q, v, 0.3, 0.05, method, record="work")
    wanted = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.3, 1e-3)
    assert abs(sd.constraint_error(model, held, run.q)).max() < 1e-8
    assert abs(run.q[-1] - wanted.q[-1]).max() < 1e-7
    assert abs(sd.energy_ledger(run).error).max() < 1e-7


@pytest.mark.slow(quick="test_what_runs_under_constraints_cannot_do")
def test_many_equations_run_by_the_table_kernel() -> None:
    """39 equations, 37 of which depend on the others, have no program."""
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    many = sd.Constraints(model, [*held] * 13)
    assert sd.constrained_dynamics(model, many, q, v, np.zeros(3)).rank == 2
    run = sd.simulate(sd.Scene(model, constraints=many), q, v, 0.01, 1e-3)
    lanes = sd.rollout(sd.Scene(model, constraints=many), q, v, dt=1e-3, steps=10, method=run.method)
    np.testing.assert_array_equal(lanes.q, run.q[1:])
    assert abs(run.q - sd.simulate(sd.Scene(model, constraints=held), q, v, 0.01, 1e-3).q).max() <= 1e-12


def test_smooth_friction_acts_under_constraints() -> None:
    """-F tanh(v/ε) - b v as a torque: simulate's program, its calls, RATTLE and a rollout agree; energy goes down."""
    model, (q, v) = four_bar(), four_bar_state()
    held, how = pin_of(model), {"friction_method": "smooth"}
    rubbing = sd.Friction(np.full(3, 0.02), np.array([0.01, 0.02, 0.0]), smoothing=np.full(3, 0.05))

    def law(t: float, q: Array, v: Array) -> Array:
        return -(0.02 * np.tanh(v / 0.05) + np.array([0.01, 0.02, 0.0]) * v)

    wanted = sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, torque=law)
    at_once = scenes.simulate(model, q, v, 0.1, 1e-3, constraints=held, friction=rubbing, **how)
    by_calls = scenes.simulate(
        model, q, v, 0.1, 1e-3, torque=lambda t, q, v: 0 * v, constraints=held, friction=rubbing, **how
    )
    many = scenes.rollout(
        model, np.tile(q, (9, 1)), v, dt=1e-3, steps=100, method="rk4", constraints=held, friction=rubbing, **how
    )
    for found in (at_once.q, by_calls.q, np.vstack([q, many.q[4]])):
        assert abs(found - wanted.q).max() <= 1e-12
    rattle = scenes.simulate(model, q, v, 0.1, 1e-3, "stormer_verlet", constraints=held, friction=rubbing, **how)
    assert abs(rattle.q[-1] - wanted.q[-1]).max() <= 1e-5
    assert wanted.energy[-1] < wanted.energy[0] - 1e-3


def bristly(level: float) -> sd.Friction:
    """Friction of the four-bar's joints with bristles."""
    made = {"bristle_stiffness": np.full(3, 1e3), "bristle_damping": np.full(3, 5.0)}
    return sd.Friction(np.full(3, level), np.array([0.01, 0.0, 0.02]), **made)


def test_bristles_share_the_load_of_a_loop() -> None:
    """A four-bar that its joints hold: it comes to rest where σ z balances gravity in its one freedom."""
    model, (q, v) = four_bar(), four_bar_state()
    held, how = pin_of(model), {"method": "semi_implicit_euler", "friction_method": "lugre"}
    run = scenes.rollout(model, q, 0 * v, dt=1e-3, steps=3000, constraints=held, friction=bristly(2.0), **how)
    end, z = run.q[-1], run.states["bristles"][-1]
    assert abs(run.v[-1]).max() <= 1e-8
    assert abs(end - q).max() <= 0.01
    assert left_open(model, held, end, run.v[-1])[0] <= 1e-12
    J = sd.constraint_jacobian(model, held, end)[:2]
    N = np.append(1.0, np.linalg.solve(J[:, 1:], -J[:, 0]))
    load = sd.generalized_gravity(model, end)
    assert abs(N @ load) > 0.1
    assert abs(N @ (load + 1e3 * z)) <= 1e-6
    assert (abs(1e3 * z) < 2.0).all()


def test_bristles_under_constraints_are_the_same_on_lanes_in_a_program_and_by_calls() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held, friction, tau = pin_of(model), bristly(0.05), np.array([0.1, 0.0, -0.1])
    how = {"constraints": held, "friction": friction, "friction_method": "lugre", "method": "semi_implicit_euler"}
    at_once = scenes.simulate(model, q, v, 0.05, 1e-3, torque=tau, **how)
    by_calls = scenes.simulate(model, q, v, 0.05, 1e-3, torque=lambda t, q, v: tau, **how)
    many = scenes.rollout(model, np.tile(q, (9, 1)), v, tau, dt=1e-3, steps=50, **how)
    for found in (by_calls.q[1:], many.q[4]):
        assert abs(found - at_once.q[1:]).max() <= 1e-12
    assert (
        at_once.energy[-1]
        < sd.simulate(sd.Scene(model, constraints=held), q, v, 0.05, 1e-3, torque=tau).energy[-1] - 1e-3
    )
    unheld = scenes.simulate(model, q, v, 0.05, 1e-3, torque=tau, **(how | {"constraints": sd.Constraints(model, [])}))
    free = scenes.simulate(model, q, v, 0.05, 1e-3, torque=tau, **(how | {"constraints": None}))
    assert abs(unheld.q - free.q).max() <= 1e-12


@pytest.mark.parametrize("torque", [None, lambda t, q, v: 0.0 * v])
def test_the_ledger_of_bristles_under_constraints_closes(torque: Any) -> None:
    """Work of friction, of constraints (none of ideal ones but for h) and of projections, and an error of order h."""
    model, (q, v) = four_bar(), four_bar_state()
    held, errors = pin_of(model), []
    for h in (1e-3, 5e-4):
        run = sd.simulate(
            sd.Scene(model, constraints=held, friction=bristly(0.05), friction_method="lugre"),
            q,
            v,
            0.1,
            h,
            "semi_implicit_euler",
            torque,
            record="work",
        )
        found = sd.energy_ledger(run)
        assert found.work["friction"][-1].sum() < -1e-3
        assert abs(found.work["constraints"].sum(axis=1)).max() <= 0.02 * abs(found.change).max()
        errors.append(abs(found.error).max())
    assert errors[0] <= 0.05 * abs(found.change).max()
    assert 1.8 <= errors[0] / errors[1] <= 2.2


def test_a_branch_point_is_named_with_its_time() -> None:
    """All rods of a parallelogram on one line: it may open either way, and one equation is no longer independent."""
    model = four_bar(1.0, 1.0, 1.0, 1.0)
    held = pin_of(model, 1.0, 1.0)
    flat, rate = np.zeros(3), np.array([1.0, -1.0, 1.0])
    text = r"step from t = 0\S* s: the rank of pin is 2, at the beginning it was 1: a branch point"
    with pytest.raises(sd.SimulationError, match=text) as caught:
        sd.simulate(sd.Scene(model, constraints=held), flat, rate, 0.1, 1e-2)
    assert len(caught.value.trajectory.t) >= 1
    with pytest.raises(sd.SimulationError, match=r"sample 0: " + text):
        sd.rollout(sd.Scene(model, constraints=held), np.tile(flat, (3, 1)), rate, dt=1e-2, steps=5)
    lost = sd.rollout(sd.Scene(model, constraints=held), np.tile(flat, (3, 1)), rate, dt=1e-2, steps=5, check=False)
    assert not np.isfinite(lost.v[:, -1]).any()


def test_contradictions_are_named_with_their_time() -> None:
    """A rod to a rocker that a coupling drives: the rod is met at first, and no acceleration keeps both."""
    model, (q, v) = four_bar(), four_bar_state()
    end = sd.frame_placement(model, q, "rocker")[:3] @ [0.4, 0, 0, 1.0]
    rod = sd.DistanceConstraint("rocker", None, 0.3, (0.4, 0, 0), end + np.array([0.3, 0, 0]), name="rod")
    held = sd.Constraints(model, [sd.VelocityConstraint([0, 0, 1.0]), rod])
    still = sd.project_velocity(model, held, q, v)
    assert sd.simulate(sd.Scene(model, constraints=held), q, still, 0.01, 1e-3).q.shape == (11, 3)
    belt = sd.CouplerConstraint("rocker_joint", "crank_joint", 1.0, q[2] - q[0], name="belt")
    tied = sd.Constraints(model, [belt, rod, sd.VelocityConstraint([1.0, 0, 0], name="brake")])
    assert sd.constrained_dynamics(model, tied, q, [0, 1.0, 0], np.zeros(3)).rank == 2
    pushed = constraints.constrained_of(sd.Scene(model, constraints=tied), q, np.zeros(3), 1e-3)
    assert pushed is not None
    assert pushed.rank.tolist() == [2]
