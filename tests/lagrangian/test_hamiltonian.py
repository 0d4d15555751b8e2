"""Hamilton's equations, the Poisson bracket and conserved quantities."""

from __future__ import annotations

import doctest
import itertools
import math
import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.lagrangian import check_conservation, conserved, hamiltonian, lie_brackets
from spatialdyn.lagrangian.conserved import ConservedQuantity
from spatialdyn.lagrangian.hamiltonian import STEP, WEIGHTS
from spatialdyn.lagrangian.lie_brackets import structure_constants

Array = NDArray[np.float64]
EPS = np.finfo(float).eps
ROUNDING = 1e-12  # of the largest entry: sums of a few dozen products in trees of ten bodies
SOLVED = 1e-9  # the same after solving with the M of a random tree, of condition up to 1e5
DIFFERENCE = 1e-9  # 6th-order differences with steps of 4e-3 of sums of sines: rounding 1e-13 of H, truncation below
NESTED = 1e-7  # differences of differences: rounding is divided by the step twice
FLOW = 1e-9  # DOP853 at rtol 1e-12 over a second, of the largest value
SOLID = np.diag([0.1, 0.2, 0.25])
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: a minute of plain Python")

TREES = {
    "chain": lambda: random_tree(1, 5, ("revolute", "prismatic"), branching=0.0),
    "rotors": lambda: random_tree(2, 6, ("revolute", "spherical", "prismatic")),
    "every joint": lambda: random_tree(108, 6, armature=False),
    "pairs": lambda: random_tree(108, 6, floating=True, continuous="cos_sin", gravity=(1.0, -2.0, 3.0), armature=False),
    "floating": lambda: random_tree(4, 3, ("revolute",), floating=True),
}


@pytest.fixture(scope="module", params=TREES)
def model(request: pytest.FixtureRequest) -> sd.Model:
    made: sd.Model = TREES[request.param]().model
    return made


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def pendulum(
    kind: str = "revolute",
    axis: Any = (0, 1, 0),
    gravity: Any = (0, 0, -9.81),
    inertia: Any = SOLID,
    com: Any = (0.0, 0.0, -0.5),
) -> sd.Model:
    """A body of 2 kg, 0.5 m below the joint that holds it."""
    builder = sd.ModelBuilder("pendulum").add_body(
        "bob", None, kind, axis, (0.0, 0.0, 1.0), (2.0, com, inertia), "pivot"
    )
    return builder.build(gravity=gravity)


def two_link(gravity: Any = (0.0, 0.0, -9.81)) -> sd.Model:
    """Two rods in a vertical plane."""
    builder = sd.ModelBuilder("two")
    for k, parent in enumerate((None, "b0")):
        builder.add_body(f"b{k}", parent, "revolute", (0, 1, 0), (0, 0, -k), (1.0 + k, (0, 0, -0.5), SOLID), f"j{k}")
    return builder.build(gravity=gravity)


def space_arm(gravity: Any = (0.0, 0.0, 0.0)) -> sd.Model:
    """A floating base with an arm of three joints."""
    builder = sd.ModelBuilder("arm").set_inertia("base", (5.0, (0.1, 0.0, 0.05), SOLID))
    parent = "base"
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0))):
        builder.add_body(f"b{k}", parent, "revolute", axis, (0.4, 0.1, 0), (1.0, (0.3, 0, 0.1), SOLID), f"j{k}")
        parent = f"b{k}"
    return builder.build(root="floating", gravity=gravity)


def state(model: sd.Model, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> tuple[Array, Array, Array, Array]:
    """Random q, v, p = M v and tau."""
    q = sd.random_configuration(model, rng, batch)
    v, tau = rng.normal(size=(2, *batch, model.nv))
    return q, v, sd.momentum(model, q, v), tau


def assert_close(x: Any, y: Any, tolerance: float) -> None:
    """|x - y| <= tolerance max(1, |y|), the largest entries."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= tolerance * max(1.0, abs(y).max(initial=0.0))


def energy_gradient(model: sd.Model, q: Array, p: Array) -> Array:
    """X_i H, by differences."""
    total = np.zeros(model.nv)
    for k, weight in WEIGHTS:
        ahead, behind = (sd.integrate(model, q, s * k * STEP * np.eye(model.nv)) for s in (1, -1))
        total += weight / STEP * (sd.hamiltonian(model, ahead, p) - sd.hamiltonian(model, behind, p))
    return total


def flow(model: sd.Model, q: Array, p: Array, duration: float, count: int = 21) -> SimpleNamespace:
    """A free motion by DOP853 in the coordinates u of q ∘ exp(u)."""
    from scipy.integrate import solve_ivp  # which takes a third of a second

    def rate(_: float, x: Array) -> Array:
        u, momenta = x[: model.nv], x[model.nv :]
        v, dp = sd.hamilton_equations(model, sd.integrate(model, q, u), momenta)
        return np.concatenate([np.linalg.solve(sd.dintegrate(model, q, u)[1], v), dp])

    t = np.linspace(0.0, duration, count)
    x = solve_ivp(rate, (0.0, duration), np.r_[np.zeros(model.nv), p], "DOP853", t, rtol=1e-12, atol=1e-12).y.T
    return SimpleNamespace(t=t, q=sd.integrate(model, q, x[:, : model.nv]), p=x[:, model.nv :], model=model)


# --- by hand --------------------------------------------------------------------------------------------


def test_pendulum_has_the_textbook_hamiltonian() -> None:
    """H = p² / 2(I + m l²) - m g l cos q, from the height of the pivot."""
    rod, q, p = pendulum(), 0.4, 1.7
    inertia = 0.2 + 2.0 * 0.25
    height = 1.0 - 0.5 * math.cos(q)
    assert_close(sd.hamiltonian(rod, [q], [p]), p * p / (2 * inertia) + 2.0 * 9.81 * height, 8 * EPS)
    v, dp = sd.hamilton_equations(rod, [q], [p])
    assert_close(v, [p / inertia], 8 * EPS)
    assert_close(dp, [-2.0 * 9.81 * 0.5 * math.sin(q)], 8 * EPS)


def test_free_body_turns_by_eulers_equations(rng: np.random.Generator) -> None:
    """ṅ = n × ω in the body's frame, with n = I ω."""
    top = pendulum("spherical", gravity=(0, 0, 0))
    q, w, p, _ = state(top, rng)
    about_pivot = SOLID + 2.0 * 0.25 * np.diag([1, 1, 0])
    assert_close(p, about_pivot @ w, ROUNDING)
    assert_close(sd.hamilton_equations(top, q, p)[1], np.cross(p, w), ROUNDING)


# --- identities -----------------------------------------------------------------------------------------


def test_momentum_is_the_mass_matrix_times_v_and_back(model: sd.Model, rng: np.random.Generator) -> None:
    q, v, p, _ = state(model, rng, (5,))
    assert_close(p, np.einsum("sij,sj->si", sd.crba(model, q), v), ROUNDING)
    assert_close(sd.velocity_from_momentum(model, q, p), v, SOLVED)


def test_hamiltonian_is_kinetic_and_potential_energy(model: sd.Model, rng: np.random.Generator) -> None:
    q, v, p, _ = state(model, rng, (5,))
    assert_close(sd.hamiltonian(model, q, p), sd.kinetic_energy(model, q, v) + sd.potential_energy(model, q), ROUNDING)


def test_momentum_rate_is_minus_the_gradient_of_h_and_the_bracket(model: sd.Model, rng: np.random.Generator) -> None:
    """ṗ_j = -X_j H - p_m c^m_jk v_k + τ_j; on coordinates c = 0."""
    q, v, p, tau = state(model, rng)
    c = structure_constants(model)
    assert c.any() == any(j.nv > 1 for j in model.joints)
    expected = tau - energy_gradient(model, q, p) - np.einsum("m,mjk,k->j", p, c, v)
    assert_close(sd.hamilton_equations(model, q, p, tau)[1], expected, DIFFERENCE)


def test_momentum_rate_is_the_derivative_of_m_v(model: sd.Model, rng: np.random.Generator) -> None:
    """d/dt M(q) v along a motion with the acceleration that torques and forces give."""
    q, v, _, tau = state(model, rng)
    fext = rng.normal(size=(model.njoints, 6))
    a = sd.aba(model, q, v, tau, fext)
    h = 1e-3
    total = np.zeros(model.nv)
    for k, weight in WEIGHTS:  # to second order in h the motion is q ∘ exp(h v), v + h a, up to an even term
        ahead, behind = (
            sd.momentum(model, sd.integrate(model, q, s * k * h * v), v + s * k * h * a) for s in (1.0, -1.0)
        )
        total += weight / h * (ahead - behind)
    assert_close(sd.momentum_rate(model, q, v, tau, fext), total, DIFFERENCE)


def test_hamilton_equations_are_the_field_in_two_parts(model: sd.Model, rng: np.random.Generator) -> None:
    q, v, p, tau = state(model, rng, (3, 2))
    fext = rng.normal(size=(model.njoints, 6))
    found, dp = sd.hamilton_equations(model, q, p, tau, fext)
    assert_close(found, v, SOLVED)
    assert_close(dp, sd.momentum_rate(model, q, v, tau, fext), SOLVED)
    rest = sd.hamilton_equations(model, q, p)
    assert_close(rest[0], found, SOLVED)
    assert_close(rest[1], sd.momentum_rate(model, q, v, 0.0 * tau), SOLVED)


def test_energy_changes_by_the_power_of_the_torques(model: sd.Model, rng: np.random.Generator) -> None:
    """dH/dt = X_i H v_i + v · ṗ = v · τ: the bracket's term does no work."""
    q, _, p, tau = state(model, rng)
    v, dp = sd.hamilton_equations(model, q, p, tau)
    scale = max(1.0, float(abs(v) @ abs(dp)))
    assert abs(energy_gradient(model, q, p) @ v + v @ dp - v @ tau) <= DIFFERENCE * scale


def test_rotor_inertia_of_a_planar_joint_is_not_in_the_hamiltonian_flow(rng: np.random.Generator) -> None:
    """M_ii + armature and no more, as in Pinocchio: the rate of M v is the equation of motion's, the energy is kept."""
    builder = sd.ModelBuilder("sled").add_body("sled", None, "planar", inertia=(2.0, (0.1, 0, 0), SOLID), armature=0.5)
    model = builder.build()
    q, v, p, _ = state(model, rng)
    rate = sd.momentum_rate(model, q, v, np.zeros(3))
    assert abs(v @ rate) <= ROUNDING  # M is constant and the plane level
    generated = -energy_gradient(model, q, p) - np.einsum("m,mjk,k->j", p, structure_constants(model), v)
    turning = 0.5 * v[2] * np.array([-v[1], v[0], 0.0])
    assert_close(rate, generated + turning, DIFFERENCE)


def test_phase_volume_is_kept(rng: np.random.Generator) -> None:
    """Liouville on coordinates: the divergence of (v, ṗ) is zero."""
    model = two_link()
    q, _, p, _ = state(model, rng)
    divergence = 0.0
    for k, weight in WEIGHTS:
        for s, i in itertools.product((1.0, -1.0), range(2)):
            e = s * k * STEP * np.eye(2)[i]
            divergence += s * weight / STEP * sd.hamilton_equations(model, q + e, p)[0][i]
            divergence += s * weight / STEP * sd.hamilton_equations(model, q, p + e)[1][i]
    assert abs(divergence) <= DIFFERENCE


def test_mimic_joints_have_the_momenta_of_their_leaders(rng: np.random.Generator) -> None:
    builder = sd.ModelBuilder("gripper").set_inertia("base", (1.0, (0.0, 0.0, 0.1), SOLID))
    for k, mimic in enumerate((None, {"leader": "f0_joint", "multiplier": -1.5, "offset": 0.1})):
        builder.add_body(f"f{k}", None, "revolute", (k, 1, 2), (0.1, k, 0.2), (0.5, (0.1, 0.2, k), SOLID), mimic=mimic)
    model = builder.build(root="floating", mimic=True)
    q, v, p, tau = state(model, rng)
    assert_close(p, sd.crba(model, q) @ v, ROUNDING)
    assert_close(sd.hamiltonian(model, q, p), sd.kinetic_energy(model, q, v) + sd.potential_energy(model, q), ROUNDING)
    found, dp = sd.hamilton_equations(model, q, p, tau)
    assert_close(found, v, SOLVED)
    gyroscopic = np.einsum("m,mjk,k->j", p, structure_constants(model), v)
    assert_close(dp, tau - energy_gradient(model, q, p) - gyroscopic, DIFFERENCE)


# --- oracle ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("robot", "root"), [("panda", "fixed"), ("solo12", "floating")])
def test_momentum_rate_is_pinocchios_c_transposed_times_v(robot: str, root: str, rng: np.random.Generator) -> None:
    pin = pytest.importorskip("pinocchio")
    from spatialdyn.urdf.load import find_robot
    from spatialdyn.validate import pinocchio_model

    path = find_robot(robot)
    model, peer = sd.load_urdf(path, root=root), pinocchio_model(path, root)
    data = peer.createData()
    q, v, _, tau = state(model, rng)
    C = pin.computeCoriolisMatrix(peer, data, q, v)
    assert_close(sd.momentum_rate(model, q, v, tau), C.T @ v + tau - sd.generalized_gravity(model, q), ROUNDING)


# --- the frame ------------------------------------------------------------------------------------------


def test_structure_constants_are_the_commutator_of_motions(rng: np.random.Generator) -> None:
    """integrate along j, k, -j, -k comes back up to h² [X_j, X_k] (and h³)."""
    model = random_tree(108, 6).model
    c, h = structure_constants(model), 1e-4
    np.testing.assert_array_equal(c, -c.transpose(0, 2, 1))
    q = sd.random_configuration(model, rng)
    for j, k in itertools.combinations(range(model.nv), 2):
        e = np.eye(model.nv) * h
        there = q
        for step in (e[j], e[k], -e[j], -e[k]):
            there = sd.integrate(model, there, step)
        assert_close(sd.difference(model, q, there) / h**2, c[:, j, k], 10 * h)


# --- the bracket ----------------------------------------------------------------------------------------


def observables(model: sd.Model, rng: np.random.Generator) -> list[Any]:
    """Three functions of (q, p): of a point's place, of the momenta, of both."""
    A, a, b = rng.normal(size=(model.nv, model.nv)), *rng.normal(size=(2, model.nv))
    first, last = model.frames[1], model.frames[-1]

    def place(q: Array, p: Array) -> float:
        return float(np.sin(sd.frame_placement(model, q, last)[0, 3]) + sd.frame_placement(model, q, first)[1, 2])

    return [
        lambda q, p: place(q, p) + float(a @ p),
        lambda q, p: float(p @ A @ p) / 4.0,
        lambda q, p: place(q, p) * float(b @ p),
    ]


SMALL = {
    "two_link": two_link,
    "body": lambda: pendulum("floating", inertia=SOLID),
    "ball": lambda: pendulum("spherical"),
}


@pytest.mark.parametrize("which", SMALL)
def test_bracket_is_antisymmetric_and_obeys_leibniz_and_jacobi(which: str, rng: np.random.Generator) -> None:
    """Jacobi on quasi-velocities holds by the Lie-Poisson term only."""
    model = SMALL[which]()
    q, _, p, _ = state(model, rng)
    F, G, K = observables(model, rng)

    def bracket(f: Any, g: Any) -> Any:
        return lambda q, p: sd.poisson_bracket(model, f, g, q, p)

    assert_close(bracket(F, G)(q, p), -bracket(G, F)(q, p), ROUNDING)
    product = bracket(F, lambda q, p: G(q, p) * K(q, p))(q, p)
    assert_close(product, bracket(F, G)(q, p) * K(q, p) + G(q, p) * bracket(F, K)(q, p), DIFFERENCE)
    if model.nv < 6:  # 12 nv evaluations, squared
        cycle = [bracket(bracket(f, g), k)(q, p) for f, g, k in ((F, G, K), (G, K, F), (K, F, G))]
        assert abs(sum(cycle)) <= NESTED * max(1.0, max(map(abs, cycle)))
        assert max(map(abs, cycle)) > 1e3 * NESTED


def test_fundamental_brackets(rng: np.random.Generator) -> None:
    """{q, p} = 1 on coordinates, {p_i, p_j} = -c^m_ij p_m in the frame of a body."""
    model = two_link()
    q, _, p, _ = state(model, rng)
    for i, j in itertools.product(range(2), repeat=2):
        pair = [(lambda q, p, k=k: q[k], lambda q, p, k=k: p[k]) for k in (i, j)]
        assert_close(sd.poisson_bracket(model, pair[0][0], pair[1][1], q, p), float(i == j), ROUNDING)
        assert_close(sd.poisson_bracket(model, pair[0][0], pair[1][0], q, p), 0.0, ROUNDING)
        assert_close(sd.poisson_bracket(model, pair[0][1], pair[1][1], q, p), 0.0, ROUNDING)
    body = SMALL["body"]()
    q, _, p, _ = state(body, rng)
    c = structure_constants(body)
    for i, j in itertools.product(range(6), repeat=2):
        found = sd.poisson_bracket(body, lambda q, p, i=i: p[i], lambda q, p, j=j: p[j], q, p)
        assert_close(found, -p @ c[:, i, j], ROUNDING * 10)


@pytest.mark.parametrize("which", [*SMALL, "space arm"])
def test_bracket_with_h_is_the_rate_along_the_flow(which: str, rng: np.random.Generator) -> None:
    model = space_arm((0.0, 0.0, -9.81)) if which == "space arm" else SMALL[which]()
    q, _, p, _ = state(model, rng)

    def H(q: Array, p: Array) -> float:
        return float(sd.hamiltonian(model, q, p))

    v, dp = sd.hamilton_equations(model, q, p)
    for F in observables(model, rng):
        rate, h = 0.0, STEP / max(1.0, abs(v).max())
        for k, weight in WEIGHTS:
            for s in (k * h, -k * h):
                rate += np.sign(s) * weight / h * F(sd.integrate(model, q, s * v), p + s * dp)
        assert_close(sd.poisson_bracket(model, F, H, q, p), rate, DIFFERENCE)
    assert abs(sd.poisson_bracket(model, H, H, q, p)) <= ROUNDING * abs(v @ dp)


# --- conserved quantities -------------------------------------------------------------------------------


def names(model: sd.Model) -> list[str]:
    """Of the conserved quantities beside the energy."""
    first, *rest = sd.conserved_quantities(model)
    assert first.name == "energy"
    return [x.name for x in rest]


def test_only_a_pendulum_about_the_vertical_conserves_its_momentum() -> None:
    assert names(pendulum()) == []
    assert names(pendulum(axis=(0, 0, 1))) == ["momentum of pivot"]
    assert names(pendulum(axis=(0, 1e-3, 1))) == []
    assert names(pendulum(gravity=(0, 0, 0))) == ["momentum of pivot"]
    assert names(pendulum(axis=(0.6, 0, 0.8), gravity=(3, 0, 4))) == ["momentum of pivot"]


def test_a_cart_conserves_its_momentum_on_the_level() -> None:
    def cart(axis: Any) -> sd.Model:
        builder = sd.ModelBuilder("cart").add_body("cart", None, "prismatic", axis, inertia=(1, (0, 0, 0), SOLID))
        builder.add_body("pole", "cart", "revolute", (0, 1, 0), inertia=(1, (0, 0, 0.5), SOLID))
        return builder.build()

    assert names(cart((1, 0, 0))) == ["momentum of cart_joint"]
    assert names(cart((1, 0, 0.01))) == []


def test_spherical_pendulum_conserves_its_momentum_about_the_vertical() -> None:
    assert names(pendulum("spherical")) == ["angular momentum of pivot about z"]
    assert names(pendulum("spherical", gravity=(0, 0, 0))) == [f"angular momentum of pivot about {x}" for x in "xyz"]
    top = np.diag([0.1, 0.1, 0.15])
    assert names(pendulum("spherical", inertia=top)) == ["angular momentum of pivot about z", "momentum of pivot [2]"]


def test_single_momenta_have_the_unit_of_their_freedom() -> None:
    """Of a top about the x axis of its joint; of a puck that slides on the level and turns about its middle."""
    top = pendulum("spherical", inertia=np.diag([0.15, 0.1, 0.1]), com=(0.5, 0, 0))
    units = {x.name: x.unit for x in sd.conserved_quantities(top)}
    assert units["momentum of pivot [0]"] == "kg m²/s"
    puck = {x.name: x.unit for x in sd.conserved_quantities(pendulum("planar", (0, 0, 1), com=(0, 0, 0)))}
    assert puck["momentum of pivot [2]"] == "kg m²/s"
    assert puck["linear momentum of pivot along y"] == "kg m/s"


@pytest.mark.parametrize("kind", ["revolute", "planar", "spherical"])
def test_a_joint_off_the_origin_turns_about_a_line_through_itself(kind: str, rng: np.random.Generator) -> None:
    """The value is the angular momentum about that line, from the robot's linear momentum and that about its com."""
    at = np.array([2.0, -3.0, 0.5])
    builder = sd.ModelBuilder("off")
    builder.add_body("table", None, kind, (0, 0, 1), at, (2.0, (0.3, 0.1, -0.5), SOLID), "pivot")
    builder.add_body("arm", "table", "revolute", (0, 1, 0), (0.4, 0, 0), (1.0, (0.2, 0, 0), SOLID), "elbow")
    model = builder.build()
    found = {x.name: x for x in sd.conserved_quantities(model)}
    turn = found["momentum of pivot" if kind == "revolute" else "angular momentum of pivot about z"]
    assert "(2, -3, 0.5)" in turn.description
    q, v, p, _ = state(model, rng, (5,))
    momentum = sd.centroidal_momentum(model, q, v)
    linear, angular = momentum[:, :3], momentum[:, 3:]
    about = angular + np.cross(sd.center_of_mass(model, q) - at, linear)
    assert_close(turn.value(q, p), about[:, 2], ROUNDING)


def test_two_links_without_gravity_conserve_the_momentum_of_the_first_only() -> None:
    assert names(two_link()) == []
    assert names(two_link((0.0, 0.0, 0.0))) == ["momentum of j0"]
    assert names(two_link((0.0, -9.81, 0.0))) == ["momentum of j0"]


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0.6, 0.8)])
def test_planar_joint_conserves_what_gravity_leaves(axis: Any) -> None:
    found = names(pendulum("planar", axis, com=(0.3, 0.1, -0.5)))
    if axis[1] == 0:
        assert [x.split(" of")[0] for x in found] == ["linear momentum", "linear momentum", "angular momentum"]
    else:
        assert len(found) == 1
        assert found[0].startswith("linear momentum")


def test_free_floating_arm_conserves_its_momenta_and_not_m_v(rng: np.random.Generator) -> None:
    """Of M(q) v it is the total momentum that stays, as seen from the world: no row of it is constant by itself."""
    model = space_arm()
    quantities = sd.conserved_quantities(model)
    kinds = ["linear", "angular"]
    assert [x.name.split()[0] for x in quantities] == ["energy", *np.repeat(kinds, 3)]
    q, v, p, _ = state(model, rng)
    motion = flow(model, q, p, 1.0)
    for x in quantities:
        values = x.value(motion.q, motion.p)
        assert_close(values, np.full(len(values), values[0]), FLOW)
    assert (abs(motion.p - motion.p[0]).max(axis=0) > 1e-3).all()
    total = sd.centroidal_momentum(model, q, v)
    linear = np.array([x.value(q, p) for x in quantities[1:4]])
    angular = np.array([x.value(q, p) for x in quantities[4:]])
    assert_close(linear, total[:3], ROUNDING)
    assert_close(angular, total[3:] + np.cross(sd.center_of_mass(model, q), total[:3]), ROUNDING)


@COMPILED
@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (1.0, 2.0, -2.0)])
def test_falling_arm_conserves_what_gravity_does_not_see(gravity: Any, rng: np.random.Generator) -> None:
    model = space_arm(gravity)
    found = sd.conserved_quantities(model)
    assert len(found) == 1 + 2 + 1 + 3
    q, _, p, _ = state(model, rng)
    report = sd.check_conservation(flow(model, q, p, 0.5), found)
    for line in report:
        assert line.drift <= FLOW * max(1.0, abs(line.initial)), line.name
    if gravity[0] == 0.0:
        assert {"x", "y", "z"} <= {x.name[-1] for x in found}


@COMPILED
def test_quantities_commute_with_h(model: sd.Model, rng: np.random.Generator) -> None:
    q, _, p, _ = state(model, rng)
    for x in sd.conserved_quantities(model)[1:]:
        found = sd.poisson_bracket(model, x.value, lambda q, p: sd.hamiltonian(model, q, p), q, p)
        assert abs(found) <= DIFFERENCE * max(1.0, abs(sd.hamiltonian(model, q, p)))


def test_quantities_take_batches_and_say_what_they_are(rng: np.random.Generator) -> None:
    for model in (space_arm(), pendulum("spherical", inertia=np.diag([0.1, 0.1, 0.15]))):
        q, _, p, _ = state(model, rng, (3, 2))
        for x in sd.conserved_quantities(model):
            values = x.value(q, p)
            assert values.shape == (3, 2)
            assert_close(x.value(q[1, 1], p[1, 1]), values[1, 1], ROUNDING)
            assert type(x.value(q[1, 1], p[1, 1])) is float
            assert x.name in repr(x)
            assert pickle.loads(pickle.dumps(x)).value(q[0, 0], p[0, 0]) == x.value(q[0, 0], p[0, 0])


def test_a_joint_whose_follower_changes_the_shape_conserves_no_momentum() -> None:
    """The symmetry is there for the joint alone: only the check at random states sees that another moves with it."""
    builder = sd.ModelBuilder("coupled")
    builder.add_body("turret", None, "revolute", (0, 0, 1), inertia=(1.0, (0.1, 0, 0), SOLID), joint_name="turn")
    mimic = {"leader": "turn", "multiplier": 0.5, "offset": 0.0}
    builder.add_body("arm", "turret", "revolute", (0, 1, 0), inertia=(1.0, (0.3, 0, 0), SOLID), mimic=mimic)
    assert names(builder.build(mimic=True)) == []
    assert names(builder.build(mimic=False)) == ["momentum of turn"]


def test_model_without_freedom_conserves_its_energy() -> None:
    model = sd.ModelBuilder("bench").add_body("leg", None, "fixed", inertia=(1.0, (0, 0, 0), SOLID)).build()
    assert names(model) == []
    assert sd.conserved_quantities(model)[0].value([], []) == 0.0


# --- along a motion -------------------------------------------------------------------------------------


def line_of(values: Array, t: Array) -> Any:
    """The report on a quantity with these values."""
    quantity = ConservedQuantity("it", "1", "made up", lambda q, p: q[..., 0])
    return sd.check_conservation(SimpleNamespace(t=t, q=values[:, None], p=values[:, None]), [quantity])[0]


def test_drift_is_distinguished_from_noise(rng: np.random.Generator) -> None:
    t = np.linspace(0.0, 10.0, 501)
    noise = rng.normal(size=t.size)
    found = line_of(3.0 + 0.25 * t, t)
    assert (found.initial, found.drift) == (3.0, 2.5)
    assert_close(found.slope, 0.25, 100 * EPS)
    assert found.slope_error <= 1e-12
    noisy = line_of(noise, t)
    assert_close(noisy.slope_error, 1.0 / math.sqrt(501) / 2.89, 0.01)  # sigma over √n and the spread of t
    assert abs(noisy.slope) <= 4.0 * noisy.slope_error
    drifting = line_of(noise + 0.25 * t, t)
    assert abs(drifting.slope - 0.25) <= 4.0 * drifting.slope_error
    assert drifting.slope >= 10.0 * drifting.slope_error


@pytest.mark.parametrize(
    ("values", "slope", "error"),
    [
        ((0.0, 1.0, 0.0), 0.0, math.sqrt(1 / 3)),  # squares left 2/3, over 3 - 2, over a spread of t of 2
        ((0.0, 1.0, 0.0, 1.0), 0.2, math.sqrt(0.08)),  # 0.8 over 4 - 2, over 5
        ((1.0, 0.0, 0.0, 0.0, 1.0), 0.0, math.sqrt(0.04)),  # 1.2 over 5 - 2, over 10
    ],
)
def test_few_points_leave_two_fewer_for_the_error_of_the_slope(
    values: tuple[float, ...], slope: float, error: float
) -> None:
    """By hand: the line takes two of the points, which of three leaves one."""
    found = line_of(np.array(values), np.arange(len(values), dtype=float))
    assert_close(found.slope, slope, 100 * EPS)
    assert_close(found.slope_error, error, 100 * EPS)
    doubled = line_of(np.array(values), 0.5 * np.arange(len(values)))
    assert_close(doubled.slope_error, 2.0 * error, 100 * EPS)


def test_three_times_that_increase_are_enough() -> None:
    assert line_of(np.zeros(3), np.arange(3.0)).drift == 0.0
    for t in ([0.0, 1.0, 1.0], [0.0, 1.0]):
        with pytest.raises(sd.ShapeError, match="at least 3 times that increase"):
            line_of(np.zeros(len(t)), np.array(t))
    assert line_of(np.zeros(3), np.array([0.0, 1.0, np.nextafter(1.0, 2.0)])).slope == 0.0


def test_drift_is_the_farthest_from_the_first_value_on_either_side() -> None:
    t = np.arange(4.0)
    assert line_of(np.array([2.0, 2.5, 1.0, 2.0]), t).drift == 1.0
    assert line_of(np.array([2.0, 1.5, 3.0, 2.0]), t).drift == 1.0


def test_explicit_euler_is_seen_to_gain_energy() -> None:
    model, dt = two_link(), 2e-3
    q, v = np.array([0.8, 0.6]), np.zeros(2)
    states = [(q, v)]
    for _ in range(500):
        states.append(sd.step(model, *states[-1], np.zeros(2), dt, "explicit_euler"))
    motion = SimpleNamespace(
        t=dt * np.arange(501), q=np.array([x[0] for x in states]), v=np.array([x[1] for x in states])
    )
    (energy,) = sd.check_conservation(motion, model=model)
    assert energy.slope > 10.0 * energy.slope_error
    motion.model = model
    report = sd.check_conservation(motion)
    assert report[0] == energy
    assert "energy" in repr(report)
    assert "slope" in repr(report)


@pytest.mark.parametrize("module", [lie_brackets, check_conservation, conserved, hamiltonian])
def test_examples_in_docstrings_are_true(module: Any) -> None:
    found = doctest.testmod(module)
    assert found.attempted > 0
    assert found.failed == 0


def test_what_is_no_motion_is_refused() -> None:
    model = two_link()
    good = SimpleNamespace(t=np.arange(4.0), q=np.zeros((4, 2)), v=np.zeros((4, 2)))
    with pytest.raises(sd.SpatialDynError, match="model is None, expected the model of a trajectory"):
        sd.check_conservation(good)
    with pytest.raises(sd.SpatialDynError, match="trajectory is None, expected an object with t, q, and p or v"):
        sd.check_conservation(None, model=model)
    with pytest.raises(sd.SpatialDynError, match="trajectory has neither p nor v"):
        sd.check_conservation(SimpleNamespace(t=good.t, q=good.q), model=model)
    for change, kind, words in (
        ({"t": np.arange(2.0)}, sd.ShapeError, "at least 3 times that increase"),
        ({"t": np.array([0.0, 2.0, 1.0, 3.0])}, sd.ShapeError, "at least 3 times that increase"),
        ({"q": np.zeros((3, 2))}, sd.ShapeError, r"q has shape \(3, 2\), expected \(4, \.\.\.\)"),
        ({"v": np.full((4, 2), np.nan)}, sd.NonFiniteError, "v is not finite at t = 0"),
    ):
        with pytest.raises(kind, match=words):
            sd.check_conservation(SimpleNamespace(**{**vars(good), **change}), model=model)


def test_bracket_of_what_is_no_function_of_one_state_is_refused() -> None:
    model = two_link()

    def one(q: Array, p: Array) -> float:
        return 1.0

    with pytest.raises(sd.ShapeError, match=r"q has shape \(3, 2\), expected \(2,\)"):
        sd.poisson_bracket(model, one, one, np.zeros((3, 2)), np.zeros(2))
    with pytest.raises(sd.SpatialDynError, match=r"G returned .*, expected a number"):
        sd.poisson_bracket(model, one, lambda q, p: q, np.zeros(2), np.zeros(2))
    with pytest.raises(sd.SpatialDynError, match="F is 3, expected a function of"):
        sd.poisson_bracket(model, 3, one, np.zeros(2), np.zeros(2))  # type: ignore[arg-type]
    with pytest.raises(sd.NonFiniteError, match="F returned nan, expected a finite number"):
        sd.poisson_bracket(model, lambda q, p: math.nan, one, np.zeros(2), np.zeros(2))
    for q, p, name in ((np.zeros(2), [math.inf, 0.0], "p"), ([0.0, math.nan], np.zeros(2), "q")):
        with pytest.raises(sd.NonFiniteError, match=rf"{name} is .*, expected finite numbers"):
            sd.poisson_bracket(model, one, one, q, p)
    for step in (0.0, -1.0, math.nan, "small"):
        with pytest.raises(sd.SpatialDynError, match="step is"):
            sd.poisson_bracket(model, one, one, np.zeros(2), np.zeros(2), step)  # type: ignore[arg-type]
