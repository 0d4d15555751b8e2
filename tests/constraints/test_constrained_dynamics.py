"""Dynamics under a table of constraints: by hand, Lagrange's equations, Gauss's principle, Pinocchio, exact numbers."""

from __future__ import annotations

import math
import warnings
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from mechanisms import REDUNDANT, G, every_kind, four_bar, four_bar_state, pin_of, rod, turned_four_bar
from plain import compiled

import spatialdyn as sd
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.numbers.symbolic import Ring, run
from spatialdyn.engines.programs.record.tracer import table
from spatialdyn.recursions.constraints import constrained
from spatialdyn.urdf.load import find_robot

EPS = np.finfo(float).eps
SAME = 1e3 * EPS
LEGGED = (
    "anymal_b_simple_description/anymal", "anymal_c_simple_description/anymal", "solo12", "a1", "go1", "go2", "laikago",
    "hyq_no_sensors",
)  # fmt: skip


def rest(model: sd.Model) -> Any:
    """No torques."""
    return np.zeros(model.nv)


# --- by hand --------------------------------------------------------------------------------------------


def test_two_masses_coupled_fall_as_one() -> None:
    made = sd.ModelBuilder("pair")
    for name, mass in (("a", 1.0), ("b", 3.0)):
        made.add_body(name, None, "prismatic", (0, 0, 1), (0, 0, 0), (mass, (0, 0, 0), np.eye(3)))
    model = made.build()
    held = sd.Constraints(model, [sd.CouplerConstraint("a_joint", "b_joint")])
    a, force, residual, rank = sd.constrained_dynamics(model, held, [0.0, 0.0], [0.0, 0.0], [8.0, 0.0])
    assert a == pytest.approx([2.0 - G, 2.0 - G])
    assert force == pytest.approx([-6.0])
    assert (residual, rank) == (0.0, 1)
    v, impulse, _, _ = sd.impact(model, held, [0.0, 0.0], [4.0, 0.0])
    assert v == pytest.approx([1.0, 1.0])
    assert impulse == pytest.approx([-3.0])
    assert sd.impact(model, held, [0.0, 0.0], [4.0, 0.0], restitution=1.0).v == pytest.approx([-2.0, 2.0])


def test_the_force_on_a_held_foot_is_its_weight() -> None:
    """Force is what the world exerts on frame_a; between two bodies what frame_b's does, in frame_b's axes."""
    made = sd.ModelBuilder("weight")
    made.add_body("block", None, "floating", inertia=(2.0, (0, 0, 0), np.eye(3)))
    model = made.build()
    held = sd.Constraints(model, [sd.WeldConstraint("block")])
    found = sd.constrained_dynamics(model, held, [0, 0, 0, 0, 0, 0, 1.0], np.zeros(6), np.zeros(6))
    assert found.force == pytest.approx([0, 0, 2.0 * G, 0, 0, 0])
    assert abs(found.a).max() <= 1e-14
    assert found.rank == 6


def test_a_rod_pushes_with_a_positive_force() -> None:
    made = sd.ModelBuilder("strut")
    made.add_body("mass", None, "prismatic", (0, 0, 1), (0, 0, 0), (2.0, (0, 0, 0), np.eye(3)))
    model = made.build()
    held = sd.Constraints(model, [sd.DistanceConstraint("mass", None, 0.5)])
    found = sd.constrained_dynamics(model, held, [0.5], [0.0], [0.0])
    assert found.force == pytest.approx([2.0 * G])
    assert found.a == pytest.approx([0.0])


# --- Lagrange's equations -------------------------------------------------------------------------------


def reduced_acceleration(theta: Any, rate: Any) -> Any:
    """θ̈ of the default four-bar by Lagrange's equation of one freedom, I θ̈ + I' θ̇²/2 + V' = 0, in 30 digits."""
    from mpmath import cos, diff, findroot, lu_solve, matrix, mp, mpf, sin

    with mp.workdps(30):
        a, b, c, d, g = (mpf(x) for x in (0.2, 0.5, 0.4, 0.5, G))

        def angles(t: Any) -> Any:
            def closure(p: Any, r: Any) -> Any:
                return a * cos(t) + b * cos(p) - d - c * cos(r), a * sin(t) + b * sin(p) - c * sin(r)

            return findroot(closure, (mpf(0.4646), mpf(1.453)))

        def inertia(t: Any) -> Any:
            p, r = angles(t)
            J = matrix([[-b * sin(p), c * sin(r)], [b * cos(p), -c * cos(r)]])
            k, l = lu_solve(J, matrix([a * sin(t), -a * cos(t)]))
            x, y = -a * sin(t) - b / 2 * sin(p) * k, a * cos(t) + b / 2 * cos(p) * k
            return a**3 / 3 + c**3 / 3 * l * l + b * (x * x + y * y) + b**3 / 12 * k * k

        def height(t: Any) -> Any:
            p, r = angles(t)
            return g * (a * a / 2 * sin(t) + b * (a * sin(t) + b / 2 * sin(p)) + c * c / 2 * sin(r))

        t, w = mpf(theta), mpf(rate)
        return float(-(diff(inertia, t) * w * w / 2 + diff(height, t)) / inertia(t))


@pytest.mark.parametrize("kind", ["point", "hinge", "axes", "twice"])
def test_a_four_bar_accelerates_by_lagranges_equation(kind: str) -> None:
    """-24.563653911232 at 60° and 2 rad/s; spatial pins have 1, 3 or 6 equations that depend on others."""
    model, (q, v) = four_bar(), four_bar_state()
    held = {
        "point": pin_of(model),
        "hinge": pin_of(model, kind="hinge"),
        "axes": pin_of(model, axes="xy"),
        "twice": sd.Constraints(model, [*pin_of(model), *pin_of(model, kind="hinge")]),
    }[kind]
    found = sd.constrained_dynamics(model, held, q, v, rest(model))
    assert found.a[0] == pytest.approx(-24.563653911231757, abs=1e-12)
    assert found.a[0] == pytest.approx(reduced_acceleration(q[0], v[0]), abs=1e-12)
    assert found.a[1:] == pytest.approx([30.6465772, -6.16349057], abs=1e-7)
    assert found.rank == 2
    assert found.residual <= 1e-14


def test_a_four_bar_has_the_angles_rates_and_inertia_of_its_one_freedom() -> None:
    """Coupler at 26.6184°, rocker at 83.2514°; they turn by -0.189 and 0.329 of the crank."""
    model, (q, v) = four_bar(), four_bar_state()
    assert np.degrees([q[0] + q[1], q[2]]) == pytest.approx([26.61844771, 83.25143474], abs=1e-8)
    assert (v[0] + v[1], v[2]) == pytest.approx((-0.18907259 * v[0], 0.32940326 * v[0]), abs=2e-8)
    assert v @ sd.crba(model, q) @ v / v[0] ** 2 == pytest.approx(0.018576973, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_plane_askew_to_all_axes_changes_nothing(seed: int) -> None:
    """Out of plane J is rounding, not 0; one equation is kept that would be dropped by its own size alone."""
    model, held = turned_four_bar(seed)
    q, v = four_bar_state()
    found = sd.constrained_dynamics(model, held, q, v, rest(model))
    assert found.rank == 2
    assert found.a[0] == pytest.approx(-24.563653911231757, abs=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_axes_that_agree_to_rounding_are_parallel(seed: int) -> None:
    """Tilts of 1e-16 make the equation out of plane a row of rounding, independent of the others: it is dropped."""
    rng, made = np.random.default_rng(seed), sd.ModelBuilder("rounded")
    for name, parent, x, length in (
        ("crank", None, 0.0, 0.2),
        ("coupler", "crank", 0.2, 0.5),
        ("rocker", None, 0.5, 0.4),
    ):
        axis = np.append(1e-16 * rng.normal(size=2), 1.0)
        made.add_body(name, parent, "revolute", axis, (x, 0, 0), rod(length))
    model, (q, v) = made.build(gravity=(0, -G, 0)), four_bar_state()
    held = pin_of(model)
    J = sd.constraint_jacobian(model, held, q)
    assert 0.0 < abs(J[2]).max() < 1e-15
    found = sd.constrained_dynamics(model, held, q, v, rest(model))
    assert found.rank == 2
    assert found.a[0] == pytest.approx(-24.563653911231757, abs=1e-12)


def test_a_parallelogram_and_its_branch_point() -> None:
    """θ̈ = -1.2 g cos θ of four rods of 1 m and 1 kg; at θ = 0 the rank falls, near it it does not."""
    model = four_bar(1.0, 1.0, 1.0, 1.0)
    held = pin_of(model, 1.0, 1.0)
    for theta in (0.3, 1.2, -2.0):
        found = sd.constrained_dynamics(model, held, [theta, -theta, theta], [1.0, -1.0, 1.0], rest(model))
        assert found.a[0] == pytest.approx(-1.2 * G * math.cos(theta), abs=1e-12)
        assert found.rank == 2
    assert sd.constrained_dynamics(model, held, np.zeros(3), np.zeros(3), rest(model)).rank == 1
    assert sd.constrained_dynamics(model, held, [1e-4, -1e-4, 1e-4], np.zeros(3), rest(model)).rank == 2
    assert sd.mobility(model, held, np.zeros(3)) == (2, 1, 0)
    assert sd.mobility(model, held, [0.3, -0.3, 0.3]) == (1, 2, 0)


def test_a_slider_crank_moves_its_piston() -> None:
    """x = r cos θ + √(l² - r² sin² θ), and its second derivative; with l = r the rank falls at θ = 90°."""

    def crank(length: float) -> tuple[sd.Model, sd.Constraints]:
        made = sd.ModelBuilder("engine")
        made.add_body("crank", None, "revolute", (0, 0, 1), (0, 0, 0), rod(0.1, 1.0))
        made.add_body("rod", "crank", "revolute", (0, 0, 1), (0.1, 0, 0), rod(length, 1.0))
        made.add_body("slide", None, "prismatic", (1, 0, 0), (0, 0, 0), (0.5, (0, 0, 0), np.eye(3)))
        model = made.build(gravity=(0, -G, 0))
        return model, sd.Constraints(model, [sd.PointConstraint("rod", "slide", at_a=(length, 0, 0))])

    r, l, theta, w = 0.1, 0.3, 0.7, 5.0
    model, held = crank(l)
    side = math.asin(-r * math.sin(theta) / l)
    x = r * math.cos(theta) + math.sqrt(l * l - (r * math.sin(theta)) ** 2)
    q = sd.close_loops(model, held, [theta, side - theta + 0.1, x - 0.02], free=["rod_joint", "slide_joint"])
    assert q == pytest.approx([theta, side - theta, x], abs=1e-12)
    J = sd.constraint_jacobian(model, held, q)[:2]
    v = w * np.concatenate([[1.0], np.linalg.solve(J[:, 1:], -J[:, 0])])
    a = sd.constrained_dynamics(model, held, q, v, rest(model)).a

    s, c = math.sin(theta), math.cos(theta)
    root = math.sqrt(l * l - r * r * s * s)
    first = -r * s - r * r * s * c / root
    second = -r * c - r * r * (c * c - s * s) / root - r**4 * s * s * c * c / root**3
    assert v[2] == pytest.approx(first * w, abs=1e-12)
    assert a[2] == pytest.approx(second * w * w + first * a[0], abs=1e-11)
    short, of_short = crank(r)
    assert sd.mobility(short, of_short, [math.pi / 2, -math.pi, 0.0]).rank == 1
    assert sd.mobility(short, of_short, [1.0, -2.0, 2 * r * math.cos(1.0)]).rank == 2


# --- identities -----------------------------------------------------------------------------------------


def consistent(seed: int) -> Any:
    """A random tree under some constraints that do not contradict each other, J, drift, M and the free acceleration."""
    model, held, s = every_kind(seed)
    held = sd.Constraints(model, [held.items[k] for k in (0, 5, 6, 7)])
    M, a = sd.crba(model, s.q), sd.aba(model, s.q, s.v, s.tau)
    return model, held, s, sd.constraint_jacobian(model, held, s.q), sd.constraint_drift(model, held, s.q, s.v), M, a


@pytest.mark.parametrize("seed", [0, 2])
def test_it_solves_what_it_says(seed: int) -> None:
    model, held, s, J, drift, _, _ = consistent(seed)
    a, force, residual, rank = sd.constrained_dynamics(model, held, s.q, s.v, s.tau)
    scale = max(abs(J.T @ force).max(), abs(s.tau).max())
    assert abs(sd.rnea(model, s.q, s.v, a) - s.tau - J.T @ force).max() <= 1e4 * EPS * scale
    assert abs(J @ a + drift).max() <= 1e4 * EPS * max(abs(drift).max(), abs(J).max() * abs(a).max())
    assert residual <= 1e-14
    assert rank == np.linalg.matrix_rank(J) == held.nc
    same = sd.constrained_dynamics(model, s.q, s.v, s.tau, J, drift)
    assert abs(same.a - a).max() <= 1e5 * EPS * abs(a).max()
    assert abs(same.force - force).max() <= 1e5 * EPS * abs(force).max()


@pytest.mark.parametrize("seed", [0, 2])
def test_gausss_principle(seed: int) -> None:
    """a minimises |a - a₀|² in M under J a + γ = 0, and the least is (J a₀ + γ)ᵀ G⁻¹ (J a₀ + γ)."""
    model, held, s, J, drift, M, free = consistent(seed)
    a = sd.constrained_dynamics(model, held, s.q, s.v, s.tau).a
    least = (a - free) @ M @ (a - free)
    off = J @ free + drift
    assert least == pytest.approx(off @ np.linalg.solve(sd.delassus(model, held, s.q), off), rel=1e-9)
    rng = np.random.default_rng(seed)
    N = np.linalg.svd(J)[2][len(J) :]
    for _ in range(5):
        other = a + rng.normal(size=len(N)) @ N - free
        assert other @ M @ other > least


def test_delassus_is_what_an_impulse_does() -> None:
    model, held, s, J, _, M, _ = consistent(1)
    wanted = J @ np.linalg.solve(M, J.T)
    assert abs(sd.delassus(model, held, s.q) - wanted).max() <= 1e4 * EPS * abs(wanted).max()


def test_an_impact_that_lacks_an_argument_says_which() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(
        TypeError, match=r"impact of a Jacobian: missing a required argument: 'J', expected \(model, q, v"
    ):
        sd.impact(model, [0.0, 0.0], [0.0, 0.0])  # type: ignore[call-overload]


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_an_impact_loses_the_energy_of_its_own_velocities(e: float) -> None:
    """ΔT = -½ (1 - e²) (J v)ᵀ G⁻¹ J v = ½ λᵀ J (v⁺ + v⁻)."""
    model, held, s, J, _, _, _ = consistent(2)
    after, impulse, _, rank = sd.impact(model, held, s.q, s.v, restitution=e)
    lost = sd.kinetic_energy(model, s.q, after) - sd.kinetic_energy(model, s.q, s.v)
    Jv = J @ s.v
    wanted = -0.5 * (1 - e * e) * (Jv @ np.linalg.solve(sd.delassus(model, held, s.q), Jv))
    scale = sd.kinetic_energy(model, s.q, s.v)
    assert abs(lost - wanted) <= 1e4 * EPS * scale
    assert abs(0.5 * impulse @ J @ (after + s.v) - lost) <= 1e4 * EPS * scale
    assert J @ after == pytest.approx(-e * Jv, abs=1e4 * EPS * abs(J).max() * abs(s.v).max())
    assert rank == held.nc


def test_stabilization_is_a_time() -> None:
    """J a + J̇ v + 2 J v / T + φ / T² = 0; for equations of velocities there is no φ."""
    model, held, s, J, drift, _, _ = consistent(0)
    phi, T = sd.constraint_error(model, held, s.q), 0.1
    a = sd.constrained_dynamics(model, held, s.q, s.v, s.tau, stabilization=T).a
    wanted = -drift - 2.0 / T * (J @ s.v) - phi / T**2
    assert abs(J @ a - wanted).max() <= 1e4 * EPS * max(abs(wanted).max(), abs(J).max() * abs(a).max())


def test_the_least_force_is_shared_among_equations_that_depend_on_each_other() -> None:
    """Of two pins on one axis each holds half, whichever comes first; Jᵀ force is the same."""
    model, (q, v) = four_bar(), four_bar_state()
    one, both = pin_of(model), sd.Constraints(model, [*pin_of(model), *pin_of(model, kind="hinge")])
    alone = sd.constrained_dynamics(model, one, q, v, rest(model)).force
    basic = sd.constrained_dynamics(model, both, q, v, rest(model)).force
    least = sd.constrained_dynamics(model, both, q, v, rest(model), minimum_norm=True)
    assert basic == pytest.approx([*alone, 0, 0, 0, 0, 0], abs=1e-12)
    assert least.force == pytest.approx([*alone / 2, *alone / 2, 0, 0], abs=1e-12)
    J = sd.constraint_jacobian(model, both, q)
    assert J.T @ least.force == pytest.approx(J.T @ basic, abs=1e-13)
    several = sd.constrained_dynamics(model, both, np.tile(q, (9, 1)), v, rest(model), minimum_norm=True)
    assert several.force[4] == pytest.approx(least.force, abs=1e-13)


def test_external_forces_act_as_the_torques_they_are() -> None:
    """M a + h = τ + Σ Jᵀ fext + Jᵀ λ; of a batch too."""
    model, held, s, J, _, _, _ = consistent(0)
    fext = np.random.default_rng(0).normal(size=(model.njoints, 6))
    found = sd.constrained_dynamics(model, held, s.q, s.v, s.tau, fext=fext)
    left = sd.rnea(model, s.q, s.v, found.a, fext) - s.tau - J.T @ found.force
    assert abs(left).max() <= 1e5 * EPS * abs(J.T @ found.force).max()
    several = sd.constrained_dynamics(model, held, np.tile(s.q, (9, 1)), s.v, s.tau, fext=fext)
    assert (several.a == found.a).all()
    exact = sd.exact(model, sd.constrained_dynamics, constraints=held)(s.q, s.v, s.tau, fext=fext)[0].astype(float)
    assert abs(found.a - exact).max() <= 1e-9 * abs(exact).max()


# --- programs of one model ---------------------------------------------------------------------------------


def test_a_specialized_program_has_constraints_too() -> None:
    """With a load and the stabilization as inputs; a, force, residual and rank side by side."""
    model, (q, v) = four_bar(), four_bar_state()
    held, tau = pin_of(model), np.array([0.1, 0.2, 0.3])
    k = sd.specialize(model, sd.constrained_dynamics, constraints=held)
    assert k.signature == "(q (nq,), v (nv,), tau (nv,)) -> result (nv+nc+2,)"
    wanted = np.concatenate([np.atleast_1d(x) for x in sd.constrained_dynamics(model, held, q, v, tau)])
    assert k(q, v, tau) == pytest.approx(wanted, abs=1e-12)
    assert k(np.tile(q, (9, 1)), v, tau)[4] == pytest.approx(wanted, abs=1e-12)
    loaded = sd.specialize(model, sd.constrained_dynamics, inputs=["rate", "mass:rocker_joint"], constraints=held)
    wanted = sd.constrained_dynamics(model, held, q, v, tau, stabilization=0.1)
    assert loaded(q, v, tau, 10.0, 0.4)[:3] == pytest.approx(wanted.a, abs=1e-11)
    J = sd.specialize(model, sd.constraint_jacobian, constraints=held)
    assert J(q) == pytest.approx(sd.constraint_jacobian(model, held, q), abs=1e-15)
    with pytest.raises(sd.SpatialDynError, match="constraints are None, expected Constraints of this model"):
        sd.specialize(model, sd.constrained_dynamics)
    with pytest.raises(sd.SpatialDynError, match="expected None: no call takes them"):
        sd.specialize(model, sd.rnea, constraints=held)
    with pytest.raises(sd.SpatialDynError, match="dtype is float32, expected float64 with constraints"):
        sd.specialize(model, sd.constrained_dynamics, np.float32, constraints=held)


def test_calls_with_constraints_are_compiled_ahead() -> None:
    model = four_bar()
    held = pin_of(model)
    seconds = sd.compile(model, [sd.constraint_error, "generalized_gravity"], constraints=held)
    assert list(seconds) == ["constraint_error", "generalized_gravity"]
    with pytest.raises(sd.SpatialDynError, match="constraints are None, expected Constraints of this model"):
        sd.compile(model, sd.constraint_error)
    with pytest.raises(sd.SpatialDynError, match="calls has impact, expected some of"):
        sd.compile(model, sd.impact, constraints=held)


# --- exact numbers and symbols --------------------------------------------------------------------------


def test_it_agrees_with_exact_numbers() -> None:
    model, held, s, J, _, M, _ = consistent(0)
    truth = sd.exact(model, sd.constrained_dynamics, constraints=held)(s.q, s.v, s.tau)
    found = sd.constrained_dynamics(model, held, s.q, s.v, s.tau)
    kkt = np.block([[M, J.T], [J, np.zeros((held.nc, held.nc))]])
    least = 1e-12 + 100 * EPS * np.linalg.cond(kkt)
    for x, exact in zip(found[:2], truth[:2], strict=True):
        wanted = exact.astype(float)
        assert abs(x - wanted).max() <= least * abs(wanted).max()
    assert (float(truth[2]), float(truth[3])) == (0.0, held.nc)
    held_rate = sd.exact(model, sd.constrained_dynamics, constraints=held)(s.q, s.v, s.tau, rate=10)[0].astype(float)
    stable = sd.constrained_dynamics(model, held, s.q, s.v, s.tau, 0.1).a
    assert abs(stable - held_rate).max() <= least * abs(held_rate).max()


def test_rational_forces_meet_the_equations_without_any_error() -> None:
    model = four_bar()
    held = pin_of(model)
    q, v, tau = [Fraction(1, 2), Fraction(-1, 3), Fraction(3, 4)], [1, 2, 3], [0, 1, 0]

    def exact(call: Any, *inputs: Any, **options: Any) -> Any:
        return sd.exact(model, call, bits=None, **options)(*inputs)

    a, force, residual, rank = exact(sd.constrained_dynamics, q, v, tau, constraints=held)
    assert (residual, rank) == (0, 2)
    J, drift = exact(sd.constraint_jacobian, q, constraints=held), exact(sd.constraint_drift, q, v, constraints=held)
    assert (exact(sd.rnea, q, v, a) - J.T @ force).tolist() == tau
    assert (J @ a + drift).tolist() == [0, 0, 0]


def test_a_closed_chain_in_symbols() -> None:
    """A pendulum whose tip slides on a vertical wall: the force and a in closed form, against numbers."""
    sympy = pytest.importorskip("sympy")
    made = sd.ModelBuilder("wall")
    for name, parent, x in (("upper", None, 0.0), ("lower", "upper", 1.0)):
        made.add_body(name, parent, "revolute", (0, 0, 1), (x, 0, 0), (1.0, (1.0, 0, 0), np.zeros((3, 3))))
    model = made.build(gravity=(0, -10.0, 0))
    held = sd.Constraints(model, [sd.PointConstraint("lower", axes="x", at_a=(1, 0, 0))])
    q, v, tau = sympy.symbols("q1 q2"), sympy.symbols("v1 v2"), sympy.symbols("t1 t2")
    ring = Ring(q, [*q, *v, *tau])

    def number(x: float) -> Any:
        return x if x in (0.0, 1.0) else ring.number_or_none(x)

    inputs: dict[str, Any] = {}
    for name, symbols in {"q": q, "v": v, "tau": tau}.items():
        inputs[name] = np.array([ring.of(x) for x in symbols], object)
    inputs["constraints"] = table(held.table.rows, number)
    sizes = {"nq": 2, "nv": 2, "njoints": 3, "nc": 1}
    out = run(variant(constrained.MOTION, ()), ring, table(model.bodies, number), sizes, inputs)
    at = dict(zip((*q, *v, *tau), (0.3, 0.5, 1.0, -2.0, 0.1, 0.2), strict=True))
    numbers = [float(ring.expression(x).subs(at)) for x in out]
    found = sd.constrained_dynamics(model, held, [0.3, 0.5], [1.0, -2.0], [0.1, 0.2])
    assert numbers == pytest.approx([*found.a, *found.force, found.residual, found.rank], rel=1e-10)


# --- Pinocchio ------------------------------------------------------------------------------------------


def feet_of(model: sd.Model) -> list[str]:
    """Names of the links at the tips of four legs."""
    tips = [
        j for j in model.joints[1:] if not any(x.parent == k for x in model.joints for k in [model.joints.index(j)])
    ]
    last = {}
    for frame in model.frames:
        if model.joints[frame.joint] in tips and frame.name in {f.name for f in model.frames}:
            last[frame.joint] = frame.name
    return [last[k] for k in sorted(last)][:4]


class Peer:
    """Pinocchio's contacts in the world's axes, each of a frame on the world or on another frame."""

    def __init__(self, path: str, pairs: list[tuple[str, str | None]]) -> None:
        pin = pytest.importorskip("pinocchio")
        self.model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for pair in pairs:
            ends: list[Any] = []
            for name in pair:
                at = [f for f in self.model.frames if f.name == name and f.type == pin.FrameType.BODY]
                ends += [at[0].parentJoint, at[0].placement] if at else []
            kind = pin.ContactType.CONTACT_3D
            self.models.append(pin.RigidConstraintModel(kind, self.model, *ends, pin.LOCAL_WORLD_ALIGNED))
            self.datas.append(self.models[-1].createData())
        self.data, self.pin = self.model.createData(), pin
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)

    def solve(self, q: Any, v: Any, tau: Any) -> tuple[Any, Any]:
        settings = self.pin.ProximalSettings(1e-14, 1e-12, 10)
        a = self.pin.constraintDynamics(self.model, self.data, q, v, tau, self.models, self.datas, settings)
        return np.array(a), np.array(self.data.lambda_c)


def allowed(model: sd.Model, held: sd.Constraints, q: Any) -> float:
    """What a solution may be off by, relative, for the condition of its matrix."""
    J = sd.constraint_jacobian(model, held, q)
    kkt = np.block([[sd.crba(model, q), J.T], [J, np.zeros((held.nc, held.nc))]])
    return float(1e-12 + 100 * EPS * np.linalg.cond(kkt))


def off(x: Any, truth: Any) -> float:
    """The largest error, relative to the largest number."""
    return float(abs(x - truth).max() / abs(truth).max())


@pytest.mark.parametrize("robot", LEGGED)
def test_a_legged_robot_on_its_feet_agrees_with_pinocchio_and_exact_numbers(robot: str) -> None:
    """Of 8 robots errors are 5e-16 to 4e-15 here, 9e-16 to 1.2e-14 in Pinocchio, where 3e-11 or more are allowed."""
    path = str(find_robot(robot))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = sd.load_urdf(path, root="floating")
    feet = feet_of(model)
    assert len(feet) == 4
    peer = Peer(path, [(foot, None) for foot in feet])
    held = sd.Constraints(model, [sd.PointConstraint(foot) for foot in feet])
    rng = np.random.default_rng(0)
    q = sd.random_configuration(model, rng, (20,))
    v, tau = rng.normal(size=(20, model.nv)), 10 * rng.normal(size=(20, model.nv))
    found = sd.constrained_dynamics(model, held, q, v, tau)
    assert (found.rank == 12).all()
    for k in range(20):
        least = allowed(model, held, q[k])
        theirs = peer.solve(q[k], v[k], tau[k])
        assert off(found.a[k], theirs[0]) <= least
        assert off(found.force[k], theirs[1]) <= least
    truth = sd.exact(model, sd.constrained_dynamics, constraints=held)(q[-1], v[-1], tau[-1])
    for x, y, z in zip((found.a[-1], found.force[-1]), theirs, truth, strict=False):
        ours, others = off(x, z.astype(float)), off(y, z.astype(float))
        assert ours <= least
        assert ours <= 10 * max(others, 4 * EPS)


def test_a_loop_between_legs_agrees_with_pinocchio_and_exact_numbers() -> None:
    """Two feet on one point, the others on the ground: a closed chain on a floating base."""
    path = str(find_robot("solo12"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = sd.load_urdf(path, root="floating")
    peer = Peer(path, [("FL_FOOT", "FR_FOOT"), ("HL_FOOT", None), ("HR_FOOT", None)])
    loop, rng = sd.PointConstraint("FR_FOOT", "FL_FOOT"), np.random.default_rng(3)
    held = sd.Constraints(model, [loop, sd.PointConstraint("HL_FOOT"), sd.PointConstraint("HR_FOOT")])
    closing = sd.Constraints(model, [loop])
    q = sd.neutral(model)
    q[7:] = rng.uniform(0.2, 0.6, size=12) * np.sign(rng.normal(size=12))
    q = sd.close_loops(model, closing, q, free=[x.name for x in model.joints[2:]])
    v, tau = sd.project_velocity(model, closing, q, rng.normal(size=model.nv)), rng.normal(size=model.nv)
    found, theirs, least = (
        sd.constrained_dynamics(model, held, q, v, tau),
        peer.solve(q, v, tau),
        allowed(model, held, q),
    )
    truth = sd.exact(model, sd.constrained_dynamics, constraints=held)(q, v, tau)[0].astype(float)
    for a in (found.a, theirs[0]):
        assert off(a, truth) <= least
    R = sd.frame_placement(model, q, "FL_FOOT")[:3, :3]
    assert off(R @ found.force[:3], -theirs[1][:3]) <= least  # on FR_FOOT in FL_FOOT's axes; theirs on FL_FOOT


def test_the_four_bar_of_pinocchio() -> None:
    """With mu = 1e-12; its own error there is 1e-10, and its default of 0 answers NaN."""
    pin = pytest.importorskip("pinocchio")
    theirs, where = pin.Model(), pin.SE3.Identity()
    theirs.gravity.linear = np.array([0, -G, 0])
    ids = {}
    for name, parent, x, length in (("crank", "", 0.0, 0.2), ("coupler", "crank", 0.2, 0.5), ("rocker", "", 0.5, 0.4)):
        where.translation = np.array([x, 0, 0])
        ids[name] = theirs.addJoint(ids.get(parent, 0), pin.JointModelRZ(), pin.SE3(where), name)
        m, com, I = rod(length)
        theirs.appendBodyToJoint(ids[name], pin.Inertia(m, np.array(com), I), pin.SE3.Identity())
    ends = [pin.SE3(np.eye(3), np.array([x, 0, 0])) for x in (0.5, 0.4)]
    models, datas, data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData(), theirs.createData()
    models.append(
        pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, theirs, ids["coupler"], ends[0], ids["rocker"], ends[1], pin.LOCAL
        )
    )
    datas.append(models[0].createData())
    pin.initConstraintDynamics(theirs, data, models, datas)
    q, v = four_bar_state()
    a = pin.constraintDynamics(theirs, data, q, v, np.zeros(3), models, datas, pin.ProximalSettings(1e-14, 1e-12, 1))
    model = four_bar()
    found = sd.constrained_dynamics(model, pin_of(model), q, v, np.zeros(3)).a
    assert abs(found - a).max() <= 1e-9 * abs(found).max()


# --- limits and errors ----------------------------------------------------------------------------------


def test_batches_broadcast_and_have_the_bits_of_single_calls() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    one = sd.constrained_dynamics(model, held, q, v, np.zeros(3))
    several = sd.constrained_dynamics(model, held, np.tile(q, (2, 9, 1)), v, np.zeros(3))
    assert several.a.shape == (2, 9, 3)
    assert several.force.shape == (2, 9, 3)
    assert several.rank.shape == several.residual.shape == (2, 9)
    assert (several.a == one.a).all()
    assert (several.force == one.force).all()
    assert sd.constrained_dynamics(model, held, np.zeros((0, 3)), v, np.zeros(3)).a.shape == (0, 3)
    listed = sd.constrained_dynamics(model, held, q.tolist(), v.tolist(), [0, 0, 0])
    assert listed.a.tolist() == one.a.tolist()


def test_no_constraints_leave_forward_dynamics() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    found = sd.constrained_dynamics(model, sd.Constraints(model, []), q, v, [0.1, 0.2, 0.3])
    assert abs(found.a - sd.aba(model, q, v, [0.1, 0.2, 0.3])).max() <= 1e4 * EPS * abs(found.a).max()
    assert found.force.shape == (0,)
    assert found.rank == 0


@pytest.mark.slow(quick="test_batches_broadcast_and_have_the_bits_of_single_calls")
def test_nan_stays_in_its_sample() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    given = np.tile(q, (9, 1))
    given[4, 1] = np.nan
    found = sd.constrained_dynamics(model, pin_of(model), given, v, np.zeros(3))
    assert np.isnan(found.a[4]).all()
    assert np.isfinite(np.delete(found.a, 4, axis=0)).all()


def test_equations_that_contradict_others_are_named() -> None:
    """The rod wants the rocker's end to fall towards its centre as it turns, the stop wants no acceleration."""
    model, (q, v) = four_bar(), four_bar_state()
    stop = sd.VelocityConstraint([0, 0, 1.0], name="stop")
    held = sd.Constraints(
        model, [stop, sd.DistanceConstraint("rocker", None, 0.3, (0.5, 0, 0), (0, 0.7, 0), "the rod")]
    )
    at_rest = sd.constrained_dynamics(model, held, q, 0 * v, np.zeros(3))
    assert at_rest.rank == 1
    assert at_rest.residual <= 1e-15
    turning = np.tile(v, (9, 1)) * np.r_[0, 0, 0, 1, 1, 0, 0, 0, 0][:, None]
    text = (
        r"^the rod contradicts the other constraints in sample 3: 1 of 2 equations are independent, and these miss "
        r"what they imply by 0\.\d+ of the motion; expected fewer constraints, or a state that meets them$"
    )
    with pytest.raises(sd.ConstraintError, match=text):
        sd.constrained_dynamics(model, held, q, turning, np.zeros(3))
    with pytest.raises(sd.ConstraintError, match=r"^the rod contradicts the other constraints: 1 of 2"):
        sd.constrained_dynamics(model, held, q, v, np.zeros(3))


def test_what_is_refused() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held, other = pin_of(model), four_bar(0.3)
    with pytest.raises(sd.ModelError, match='constraints are of another model "four_bar", expected those made of'):
        sd.constrained_dynamics(other, held, q, v, np.zeros(3))
    assert sd.constrained_dynamics(four_bar(), held, q, v, np.zeros(3)).rank == 2  # an equal model is the same model
    with pytest.raises(sd.ConstraintError, match=r"constraints are a list, expected Constraints\(model"):
        sd.constraint_jacobian(model, [held], q)  # type: ignore[arg-type]
    for given in ([*held], held.items[0], "pin"):
        with pytest.raises(sd.ConstraintError, match=r"constraints are a \w+, expected Constraints\(model"):
            sd.constrained_dynamics(model, given, q, v, np.zeros(3))  # type: ignore[call-overload]
        with pytest.raises(sd.ConstraintError, match=r"constraints are a \w+, expected Constraints\(model"):
            sd.impact(model, constraints=given, q=q, v=v)  # type: ignore[call-overload]
    for bad in (0.0, -1.0, math.nan, "0.1"):
        with pytest.raises(sd.ConstraintError, match="expected a time in seconds above 0, or None"):
            sd.constrained_dynamics(model, held, q, v, np.zeros(3), bad)  # type: ignore[arg-type]
    with pytest.raises(sd.ConstraintError, match=r"restitution is 1\.5, expected 0 to 1"):
        sd.impact(model, held, q, v, 1.5)
    with pytest.raises(sd.ShapeError, match=r"tau has shape \(2,\), expected \(..., 3\)"):
        sd.constrained_dynamics(model, held, q, v, [0.0, 0.0])
    with pytest.raises(sd.ShapeError, match=r"v has shape \(2,\), expected \(..., 3\)"):
        sd.impact(model, held, q, [0.0, 0.0])
    massless = sd.ModelBuilder("massless")
    massless.add_body("link", None, "revolute", (0, 0, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        light = massless.build()
    with pytest.raises(sd.InertiaError, match='joint "link_joint" has zero articulated inertia'):
        sd.constrained_dynamics(light, sd.Constraints(light, []), [0.1], [0.0], [0.0])
    with pytest.raises(sd.SpatialDynError, match="constraints are None, expected Constraints of this model"):
        sd.exact(model, sd.constrained_dynamics)
    with pytest.raises(sd.SpatialDynError, match="expected None: no call takes them"):
        sd.exact(model, sd.rnea, constraints=held)


# --- more equations than independent ones ---------------------------------------------------------------


@compiled
@pytest.mark.parametrize("name", REDUNDANT)
def test_velocities_that_meet_redundant_equations_are_taken_as_they_are(name: str) -> None:
    """J v is rounding there, and says nothing of contradiction; the rank is that of J, along the whole motion."""
    model, held, q, v = REDUNDANT[name]()
    run = sd.simulate(sd.Scene(model, constraints=held), q, v, 1.0, 2e-3)
    for k in range(0, len(run.q), 10):
        q, v = run.q[k], run.v[k]
        assert abs(sd.project_velocity(model, held, q, v) - v).max() <= 1e-11 * abs(v).max()
        hit = sd.impact(model, held, q, v, restitution=1.0)
        assert abs(hit.v - v).max() <= 1e-11 * abs(v).max()
        assert hit.rank == np.linalg.matrix_rank(sd.constraint_jacobian(model, held, q), tol=1e-9)
    many = sd.project_velocity(model, held, run.q, run.v)
    assert (many[7] == sd.project_velocity(model, held, run.q[7], run.v[7])).all()


def test_an_unsure_sample_has_the_bits_it_has_alone() -> None:
    """Around θ = 0 three cranks have a small early pivot: rows are chosen there, and in no other sample."""
    model, held, *_ = REDUNDANT["three_cranks"]()
    theta = np.linspace(-1e-2, 1e-2, 41)
    signs = np.where(np.array([j.name for j in model.joints[1:]]) == "plate_joint", -1.0, 1.0)
    states, speeds = theta[:, None] * signs, np.tile(1.5 * signs, (41, 1))
    found = sd.constrained_dynamics(model, held, states, speeds, np.zeros(4))
    assert (found.rank == 3).all()
    for k in range(0, 41, 5):
        alone = sd.constrained_dynamics(model, held, states[k], speeds[k], np.zeros(4))
        assert alone.a.tolist() == found.a[k].tolist()
        J, M = sd.constraint_jacobian(model, held, states[k]), sd.minverse(model, states[k])
        free = sd.aba(model, states[k], speeds[k], np.zeros(4))
        missed = J @ free + sd.constraint_drift(model, held, states[k], speeds[k])
        wanted = free - M @ J.T @ np.linalg.pinv(J @ M @ J.T, rcond=1e-9) @ missed
        assert abs(alone.a - wanted).max() <= 1e-9 * abs(wanted).max()


def test_a_start_that_moves_by_rounding_is_a_start_at_rest() -> None:
    made = sd.ModelBuilder("disc")
    made.add_body("disc", None, "floating", inertia=(1.0, (0, 0, 0), np.diag([0.25, 0.5, 0.25])))
    model = made.build()
    scene = sd.Scene(model, constraints=sd.Constraints(model, [sd.RollingConstraint("disc", (0, 1, 0), 0.1)]))
    q = np.array([0, 0, 0.1, 0, 0, 0, 1.0])
    assert sd.simulate(scene, q, [6e-16, 0, 0, 0, 0, 0], 2e-3, 1e-3).q.shape == (3, 7)
    with pytest.raises(sd.ConstraintError, match="moves"):
        sd.simulate(scene, q, [1e-9, 0, 0, 0, 0, 0], 2e-3, 1e-3)
