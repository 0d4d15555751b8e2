"""The properties of each integration method in the table: order, Ω, time reversal, momenta of symmetries."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from slow import slow_but
from trees import SCREWS, random_state, random_tree

import spatialdyn as sd
from spatialdyn.algebra.lie import Quat
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.lagrangian.lie_brackets import structure_constants
from spatialdyn.recursions.coordinates.coordinate_rates import coordinate_rate
from spatialdyn.recursions.momenta.canonical_coordinates import nearest
from spatialdyn.simulation import integrators
from spatialdyn.simulation.recorder import Steps

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: thousands of steps in plain Python")

EPS = np.finfo(float).eps
FIXED = [name for name, method in integrators.items() if method.family is not None]
SYMPLECTIC = [name for name in FIXED if integrators[name].symplectic]
OTHERS = [name for name in FIXED if not integrators[name].symplectic]
SYMMETRIC = [name for name in SYMPLECTIC if "time reversal" in integrators[name].preserves]
SLOPE = 0.15  # of the measured order
CONSTANT_M = "semi_implicit_euler", "velocity_verlet"
STEP = 0.02  # of the tests of one step, a usual size
DEFECT = 1e-9  # of DΦᵀ Ω DΦ - Ω over |DΦ|²; iterated to rounding it is 1e-11, of 6th-order differences
OFF = 1e-8  # of the limit of two runs of order 2; it falls 16-fold when steps are halved
BROKEN = 1e-6  # least defect of the other methods at the same step, by a wide margin


def systems() -> dict[str, tuple[sd.Model, np.ndarray, np.ndarray]]:
    """Robots with states (q, v) that move fast enough to differ from rest."""
    pendulum, arm, spatial = (sd.load_urdf(name) for name in ("pendulum", "two_link", "three_link"))
    body = sd.load_urdf("floating_body", root="floating")
    q = np.array([0.1, -0.2, 0.3, 0.0, 0.0, 0.0, 1.0])
    return {
        "pendulum": (pendulum, np.array([2.0]), np.array([0.5])),
        "2R": (arm, np.array([0.8, 0.6]), np.array([0.3, -0.5])),
        "3R": (spatial, np.array([0.4, 0.9, -0.7]), np.array([1.0, 0.5, -0.3])),
        "floating body": (body, q, np.array([0.3, 0.2, 1.0, 0.4, 2.0, -0.3])),
    }


SYSTEMS = systems()


def ball_and_arm(floating: bool = True) -> sd.Model:
    """Every kind of joint on one tree, (cos, sin) pairs too."""
    kinds = ("spherical", "planar", "prismatic", "continuous")
    return random_tree(5, 3, kinds=kinds, floating=floating, continuous="cos_sin").model


def distance(model: sd.Model, a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> float:
    """Between two states (q, p)."""
    return float(max(abs(sd.difference(model, a[0], b[0])).max(), abs(a[1] - b[1]).max()))


def end(run: sd.Trajectory) -> tuple[np.ndarray, np.ndarray]:
    return run.q[-1], run.p[-1]


# --- order ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("name", FIXED)
def test_order_of_convergence(name: str, system: str) -> None:
    model, q, v = SYSTEMS[system]
    order, duration = integrators[name].order, 0.6
    exact = end(sd.simulate(model, q, v, duration, 2.5e-3, "gauss6"))
    dt = {1: 2e-4, 2: 4e-3, 4: 2e-2, 6: 2e-2 if system == "3R" else 4e-2}[order]
    errors = [distance(model, exact, end(sd.simulate(model, q, v, duration, h, name))) for h in (dt, dt / 2)]
    assert errors[1] > 1e3 * EPS  # an error of rounding has no order
    assert abs(math.log2(errors[0] / errors[1]) - order) <= SLOPE


@pytest.mark.parametrize(
    "name", ["velocity_verlet", "rk4", "implicit_midpoint", "gauss4", "variational", "stormer_verlet"]
)
def test_order_of_convergence_where_every_kind_of_joint_is(name: str) -> None:
    model = ball_and_arm()
    rng = np.random.default_rng(1)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    exact = end(sd.simulate(model, q, v, 0.3, 1e-3, "gauss6"))
    dt = {2: 2e-3, 4: 1e-2}[integrators[name].order]
    errors = [distance(model, exact, end(sd.simulate(model, q, v, 0.3, h, name))) for h in (dt, dt / 2)]
    assert abs(math.log2(errors[0] / errors[1]) - integrators[name].order) <= SLOPE


@pytest.mark.parametrize("name", ["dop853", "radau"])
@pytest.mark.parametrize("system", ["2R", "floating body"])
def test_adaptive_methods_follow_their_tolerance(name: str, system: str) -> None:
    pytest.importorskip("scipy")
    model, q, v = SYSTEMS[system]
    exact = end(sd.simulate(model, q, v, 0.6, 2.5e-3, "gauss6"))
    errors = [
        distance(model, exact, end(sd.simulate(model, q, v, 0.6, 0.1, name, rtol=rtol, atol=rtol)))
        for rtol in (1e-5, 1e-8, 1e-11)
    ]
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2]
    assert errors[2] < 1e-8


# --- Ω --------------------------------------------------------------------------------------------------


def omega(model: sd.Model, p: np.ndarray) -> np.ndarray:
    """Ω (2 nv, 2 nv) in the frame of the velocities and the momenta: Σ θ_i ∧ dp_i - p_i dθ_i."""
    n = model.nv
    W = np.zeros((2 * n, 2 * n))
    W[:n, :n] = np.einsum("m,mij->ij", p, structure_constants(model))
    W[:n, n:], W[n:, :n] = np.eye(n), -np.eye(n)
    return W


Map = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def derivative(model: sd.Model, leads: Map, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """D (2 nv, 2 nv) of a map of displacements to (q, p), by central differences of order 6, and where 0 leads."""
    n = model.nv
    q1, p1 = leads(np.zeros(2 * n))
    D = np.empty((2 * n, 2 * n))
    for k in range(2 * n):
        column = np.zeros(2 * n)
        for weight, far in ((3 / 4, 1), (-3 / 20, 2), (1 / 60, 3)):
            for side in (1, -1):
                d = np.zeros(2 * n)
                d[k] = side * far * size
                q, p = leads(d)
                column += side * weight / size * np.concatenate([sd.difference(model, q1, q), p - p1])
        D[:, k] = column
    return D, q1, p1


def jacobian(model: sd.Model, q: np.ndarray, p: np.ndarray, h: float, name: str, **given: object) -> tuple:
    """DΦ (2 nv, 2 nv) of one step, and where it leads."""
    n = model.nv

    def step(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return end(sd.hamilton_simulation(model, sd.integrate(model, q, d[:n]), p + d[n:], h, h, name, **given))

    return derivative(model, step, 4e-3)


def defect(model: sd.Model, q: np.ndarray, p: np.ndarray, h: float, name: str, **given: object) -> float:
    """|DΦᵀ Ω DΦ - Ω| relative to the terms of the difference."""
    D, _, p1 = jacobian(model, q, p, h, name, **given)
    pulled = D.T @ omega(model, p1) @ D
    return float(abs(pulled - omega(model, p)).max() / max(1.0, abs(D).max() ** 2))


CASES = ("2R", "3R", "floating body", "every joint")


def case(name: str) -> tuple[sd.Model, np.ndarray, np.ndarray]:
    if name != "every joint":
        return SYSTEMS[name]
    model, rng = ball_and_arm(floating=False), np.random.default_rng(3)
    return model, sd.random_configuration(model, rng), rng.normal(size=model.nv)


@pytest.mark.parametrize("system", CASES)
@pytest.mark.parametrize("name", SYMPLECTIC)
def test_symplectic_methods_keep_omega(name: str, system: str) -> None:
    model, q, v = case(system)
    assert defect(model, q, sd.momentum(model, q, v), STEP, name) <= DEFECT


@pytest.mark.parametrize("system", CASES)
@pytest.mark.parametrize("name", OTHERS)
def test_the_others_do_not_keep_omega(name: str, system: str) -> None:
    model, q, v = case(system)
    v = 4.0 * v  # the defect of RK4 is of order dt^5
    assert defect(model, q, sd.momentum(model, q, v), 2 * STEP, name) > BROKEN


@pytest.mark.parametrize("name", CONSTANT_M)
def test_verlet_in_q_and_v_is_symplectic_where_the_mass_matrix_is_constant(name: str) -> None:
    """The textbooks' claim for Verlet's method is about such systems; test_the_others has robots for which it fails."""
    model, q, v = SYSTEMS["pendulum"]
    assert defect(model, q, sd.momentum(model, q, v), STEP, name) <= DEFECT


@pytest.mark.parametrize("name", ["gauss4", "variational", "stormer_verlet"])
def test_symplectic_methods_keep_omega_where_charts_have_changed(name: str) -> None:
    """A tumbling body, several revolutions: the derivative of the next step is taken wherever that has led."""
    model, q, v = SYSTEMS["floating body"]
    model = model.with_(gravity=(0.0, 0.0, 0.0))
    run = sd.hamilton_simulation(model, q, sd.momentum(model, q, v), 8.0, STEP, name)
    centres = {tuple(nearest(Quat(*a))) for a in run.q[:, 3:]}
    assert len(centres) > 3
    assert abs(run.energy - run.energy[0]).max() < 1e-3 * run.energy[0]
    assert defect(model, run.q[-1], run.p[-1], STEP, name) <= DEFECT


def test_a_chart_is_left_only_when_far_from_its_centre() -> None:
    """One long map over several charts is symplectic as a whole: neighbours change charts at the same steps."""
    model, q, v = SYSTEMS["floating body"]
    model = model.with_(gravity=(0.0, 0.0, 0.0))
    p = sd.momentum(model, q, v)
    n = model.nv

    def far(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start = sd.integrate(model, q, d[:n]), p + d[n:]
        return end(sd.hamilton_simulation(model, *start, 3.0, STEP, "gauss6"))

    D, _, p1 = derivative(model, far, 1e-3)
    gap = abs(D.T @ omega(model, p1) @ D - omega(model, p)).max()
    assert gap <= DEFECT * abs(D).max() ** 2


@pytest.mark.parametrize("name", SYMMETRIC)
@pytest.mark.parametrize("system", CASES)
def test_symmetric_methods_go_back(name: str, system: str) -> None:
    """Φ with the velocity turned round undoes Φ: time reversal."""
    model, q, v = case(system)
    p = sd.momentum(model, q, v)
    q1, p1 = end(sd.hamilton_simulation(model, q, p, 20 * STEP, STEP, name))
    q2, p2 = end(sd.hamilton_simulation(model, q1, -p1, 20 * STEP, STEP, name))
    assert distance(model, (q, p), (q2, -p2)) <= 1e-11  # 40 steps of rounding, multiplied by how fast states part


@pytest.mark.parametrize("name", SYMPLECTIC)
def test_implicit_methods_settle_on_a_body_that_turns_as_it_flies(name: str) -> None:
    """The travel in a step couples to the turning so much that a plain iteration takes hundreds of sweeps, or diverges.

    Where only one half of the equations is implicit, they have no solution at all beyond some speed.
    """
    model, q, _ = SYSTEMS["floating body"]
    v = [0.0, 0.0, 20.0, 3.0, 1.0, 2.0] if name in ("symplectic_euler", "stormer_verlet") else [50.0, 0, 0, 5, 5, 5]
    p = sd.momentum(model, q, np.array(v))
    run = sd.hamilton_simulation(model, q, p, 20 * STEP, STEP, name)
    assert abs(run.energy - run.energy[0]).max() < 0.01 * run.energy[0]
    if name in SYMMETRIC:  # exact up to the residual of a step, within one chart
        q2, p2 = end(sd.hamilton_simulation(model, run.q[2], -run.p[2], 2 * STEP, STEP, name))
        assert distance(model, (q, p), (q2, -p2)) <= 1e-11 * abs(p).max()


def test_unsymmetric_methods_do_not_go_back() -> None:
    model, q, v = SYSTEMS["2R"]
    p = sd.momentum(model, q, v)
    for name in ("symplectic_euler", "rk4", "semi_implicit_euler"):
        q1, p1 = end(sd.hamilton_simulation(model, q, p, 20 * STEP, STEP, name))
        q2, p2 = end(sd.hamilton_simulation(model, q1, -p1, 20 * STEP, STEP, name))
        assert distance(model, (q, p), (q2, -p2)) > 1e-9


# --- momenta and energy ---------------------------------------------------------------------------------


def free_arm() -> sd.Model:
    """A free-floating base with an arm, no gravity."""
    return random_tree(8, 3, kinds=("revolute", "spherical"), floating=True, gravity=(0.0, 0.0, 0.0)).model


def world_momentum(model: sd.Model, run: sd.Trajectory) -> np.ndarray:
    """Linear and angular momentum of the whole robot about the world's origin (N, 6), from the momenta of its base."""
    out = np.empty((len(run), 6))
    for k, (q, p) in enumerate(zip(run.q, run.p, strict=True)):
        X = sd.frame_placement(model, q, "b0000")
        f, n = X[:3, :3] @ p[:3], X[:3, :3] @ p[3:6]
        out[k] = [*f, *(n + np.cross(X[:3, 3], f))]
    return out


def test_variational_keeps_momentum_while_joints_move_the_base() -> None:
    model = free_arm()
    q = sd.random_configuration(model, np.random.default_rng(0))
    p = np.zeros(model.nv)
    p[:6] = [0.1, 0.2, -0.1, 0.05, 0.1, -0.2]

    def internal(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(6), np.cos(3.0 * t + np.arange(model.nv - 6))])

    run = sd.hamilton_simulation(model, q, p, 2.0, 5e-3, "variational", torque=internal)
    momentum = world_momentum(model, run)
    size = abs(momentum).max()
    assert abs(momentum - momentum[0]).max() <= 400 * 64 * EPS * size  # a few units of rounding in each of 400 steps
    assert abs(sd.difference(model, run.q[0], run.q[-1])[3:6]).max() > 0.1  # the base has turned
    other = world_momentum(model, sd.hamilton_simulation(model, q, p, 2.0, 5e-3, "rk4", torque=internal))
    assert abs(other - other[0]).max() > 1e-10


@pytest.mark.parametrize("name", SYMPLECTIC)
def test_energy_of_symplectic_methods_stays_bounded(name: str) -> None:
    """A pendulum for 200 s: the largest error of the second half is no larger than that of the first."""
    model, q, v = SYSTEMS["pendulum"]
    run = sd.simulate(model, q, v, 200.0, 0.02, name)
    error = abs(run.energy - run.energy[0])
    half = len(run) // 2
    assert error[half:].max() <= 1.05 * error[:half].max() + 1e3 * EPS * abs(run.energy[0])


def test_energy_of_the_others_drifts() -> None:
    model, q, v = SYSTEMS["pendulum"]
    for name in ("explicit_euler", "rk4"):
        error = abs((run := sd.simulate(model, q, v, 200.0, 0.02, name)).energy - run.energy[0])
        assert error[len(run) // 2 :].max() > 1.5 * error[: len(run) // 2].max()


@pytest.mark.parametrize("name", ["rk4", "gauss4", "stormer_verlet", "variational"])
def test_energy_changes_by_the_work_of_torques(name: str) -> None:
    """dH/dt = vᵀ τ: the trapezoidal sum of the power is the change of the energy, to second order."""
    model, q, v = SYSTEMS["3R"]

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([math.sin(3.0 * t), 2.0, -0.5 * v[2]])

    def gap(dt: float) -> float:
        run = sd.simulate(model, q, v, 0.4, dt, name, torque=torque)
        power = np.einsum("ij,ij->i", run.v, run.tau)
        return float(abs(run.energy[-1] - run.energy[0] - dt * (power.sum() - 0.5 * (power[0] + power[-1]))))

    gaps = gap(0.02), gap(0.01)
    assert abs(math.log2(gaps[0] / gaps[1]) - 2.0) <= SLOPE


# --- one equation of motion -----------------------------------------------------------------------------


def with_armatures() -> tuple[sd.Model, np.ndarray, np.ndarray]:
    """A planar, a spherical, a floating and a revolute joint, each with an armature; and a state."""
    made, inertia = sd.ModelBuilder("geared"), (1.0, (0.1, 0.05, -0.08), np.diag([0.02, 0.03, 0.025]))
    kinds = ("planar", "spherical", "floating", "revolute")
    for k, (kind, parent) in enumerate(zip(kinds, (None, *kinds), strict=False)):
        made.add_body(kind, parent, kind, (0, 1, 0), (0.2, 0.1 * k, 0.1), inertia, armature=0.3)
    model, rng = made.build(), np.random.default_rng(3)
    return model, sd.random_configuration(model, rng), rng.normal(size=model.nv)


@pytest.mark.parametrize("name", ["gauss6", "stormer_verlet", "variational"])
def test_methods_in_momenta_have_the_armatures_of_forward_dynamics(name: str) -> None:
    """They solve (M + armature) a + C v + g = τ as aba has it, also on joints that turn their own axes.

    The Lagrangian ½ armature v² of a planar or floating joint gives further terms, which moved q by 2e-3 in this run.
    """
    model, q, v = with_armatures()
    exact = sd.simulate(model, q, v, 0.1, 2e-3)
    runs = [sd.simulate(model, q, v, 0.1, h, name) for h in ((5e-3,) if name == "gauss6" else (4e-3, 2e-3))]
    ends = [np.concatenate([sd.difference(model, exact.q[-1], x.q[-1]), x.v[-1] - exact.v[-1]]) for x in runs]
    assert abs(ends[0] if name == "gauss6" else (4.0 * ends[1] - ends[0]) / 3.0).max() <= OFF  # Richardson's limit
    if name == "gauss6":
        assert np.ptp(runs[0].energy) <= 1e-12 * abs(runs[0].energy).max()


def test_rates_of_momenta_and_what_is_conserved_are_of_forward_dynamics_with_armatures() -> None:
    """ṗ of Hamilton's form is the rate of M v along the motion of aba; energy is kept, momenta of symmetries not."""
    model, q, v = with_armatures()
    p, a, h = sd.momentum(model, q, v), sd.aba(model, q, v, np.zeros(model.nv)), 1e-4
    found, dp = sd.hamilton_equations(model, q, p)
    assert abs(found - v).max() <= 1e-12
    ahead, behind = (sd.momentum(model, sd.integrate(model, q, s * v + 0.5 * s * s * a), v + s * a) for s in (h, -h))
    assert abs((ahead - behind) / (2.0 * h) - dp).max() <= 1e-8 * abs(dp).max()  # differences of order h²
    assert [x.name for x in sd.conserved_quantities(model)] == ["energy"]
    bare = model.with_(armature=dict.fromkeys((x.name for x in model.joints[1:]), 0.0))
    assert len(sd.conserved_quantities(bare)) > 1


# --- the pieces -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but(["rk4"], ["rk4", "explicit_euler", "semi_implicit_euler"]))
def test_a_run_of_one_step_is_that_step(name: str) -> None:
    model, rng = ball_and_arm(), np.random.default_rng(0)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    tau, fext = rng.normal(size=model.nv), rng.normal(size=(model.njoints, 6))
    run = sd.simulate(sd.Scene(model, fext=fext), q, v, 0.01, 0.01, name, torque=tau)
    q1, v1 = sd.step(model, q, v, tau, 0.01, name, fext)
    np.testing.assert_allclose(run.q[-1], q1, rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(run.v[-1], v1, rtol=0, atol=1e3 * EPS)


def test_hurwitz_centres_leave_no_rotation_farther_than_90_degrees() -> None:
    rng, seen = np.random.default_rng(0), set()
    for a in rng.normal(size=(2000, 4)):
        a /= np.linalg.norm(a)
        c = np.array(nearest(Quat(*a)))
        seen.add(tuple(c))
        assert c @ c == 1.0
        assert c @ a >= math.cos(math.pi / 4) - 1e-12
    assert len(seen) == 24


def test_steps_end_at_the_duration() -> None:
    for duration, dt, whole, rest in (
        (1.0, 0.1, 10, 0.0),
        (1.0, 0.3, 3, 0.1),
        (0.0, 0.1, 0, 0.0),
        (0.05, 0.1, 0, 0.05),
    ):
        steps = Steps.of(duration, dt)
        assert steps.whole == whole
        assert steps.rest == pytest.approx(rest, abs=1e-12)
        assert steps.time(steps.total) == pytest.approx(duration, rel=1e-15, abs=0.0)


@pytest.mark.parametrize("name", ["implicit_midpoint", "gauss4", "gauss6"])
def test_sums_of_gauss_methods_are_compensated(name: str) -> None:
    """A mass that slides freely: each step rounds q alike, by 3000 times half an ulp unless it is carried over."""
    builder = sd.ModelBuilder().add_body("mass", joint="prismatic", axis=(1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)))
    model, (start, speed), h, steps = builder.build(gravity=(0, 0, 0)), (1000.0, 0.1), 1e-3, 3000
    run = sd.simulate(model, [start], [speed], steps * h, h, name)
    assert abs(run.q[-1, 0] - (start + steps * (h * speed))) <= 2.0 * np.spacing(start)


@pytest.mark.parametrize("options", [{}, {"floating": True, "continuous": "cos_sin"}, {"continuous": "cos_sin"}])
def test_coordinates_change_as_integrate_moves_them(options: dict[str, Any]) -> None:
    """Every kind of joint: dq/dt of the adaptive methods and of the reference, by differences of fourth order."""
    tree = random_tree(1, 12, SCREWS, **options)
    model, s, h = tree.model, random_state(tree.tree, np.random.default_rng(1)), 1e-3
    found = np.empty(model.nq)
    coordinate_rate(model.bodies, s.q, s.v, found)
    q = [sd.integrate(model, s.q, k * h * s.v) for k in (-2, -1, 1, 2)]
    np.testing.assert_allclose(found, (8.0 * (q[2] - q[1]) - (q[3] - q[0])) / (12.0 * h), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("method", ["implicit_midpoint", "stormer_verlet"])
def test_a_robot_that_comes_to_rest_is_solved_to_the_rounding_of_its_torques(method: str) -> None:
    """Its momenta vanish, and torques that balance its weight do not: they round to more than 1e-10 of the momenta."""
    model = sd.load_urdf("two_link")

    def law(t: float, q: Any, v: Any) -> Any:
        return sd.generalized_gravity(model, q) - 60.0 * (q - [0.5, -0.3]) - 12.0 * v

    scene = sd.Scene(model, friction=False)
    run = sd.simulate(scene, [0.5 + 2e-9, -0.3], np.zeros(2), 1.0, 1e-2, method=method, torque=law)
    assert abs(run.v[-1]).max() < 1e-8
