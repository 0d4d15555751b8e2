"""Every call of the library against the dense oracle, and the identities that hold without one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import dense
import numpy as np
import pytest
from slow import slow_but
from trees import KINDS, SCREWS, RandomTree, State, random_state, random_tree

import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.recursions import SPECS

EPS = np.finfo(float).eps
CLOSE = 2e-12  # of the largest entry: 6x6 products over a dozen joints, each a few eps
SEEDS = [
    (seed, floating, continuous)
    for seed in range(2)
    for floating in (False, True)
    for continuous in ("angle", "cos_sin")
]
SEEDS += [(4, False, "angle"), (5, True, "cos_sin")]  # with helical joints
AT_ONCE = [(p,) for p in SEEDS if p[0] > 3 or p in ((0, False, "angle"), (1, True, "cos_sin"))]
REFERENCES = ("local", "world", "local_world_aligned")


@pytest.fixture(
    params=slow_but(AT_ONCE, [(p,) for p in SEEDS]),
    ids=lambda p: f"{p[0]}-{'floating' if p[1] else 'fixed'}-{p[2]}",
    scope="module",
)
def case(request: pytest.FixtureRequest) -> tuple[RandomTree, Any, State]:
    seed, floating, continuous = request.param
    made = random_tree(seed, 9, SCREWS if seed > 3 else KINDS, floating, continuous)
    return made, made.model, random_state(made.tree, np.random.default_rng(seed))


def close(x: Any, y: Any, bound: float = CLOSE) -> None:
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= bound * max(1.0, abs(y).max(initial=0.0))


ORACLE: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "rnea": (lambda m, s: sd.rnea(m, s.q, s.v, s.a), lambda t, s: dense.rnea(t, s.q, s.v, s.a)),
    "rnea with fext": (
        lambda m, s: sd.rnea(m, s.q, s.v, s.a, s.fext),
        lambda t, s: dense.rnea(t, s.q, s.v, s.a, s.fext),
    ),
    "nonlinear_effects": (lambda m, s: sd.nonlinear_effects(m, s.q, s.v), lambda t, s: dense.bias(t, s.q, s.v)),
    "generalized_gravity": (lambda m, s: sd.generalized_gravity(m, s.q), lambda t, s: dense.gravity_torque(t, s.q)),
    "static_torque": (
        lambda m, s: sd.static_torque(m, s.q, s.fext),
        lambda t, s: dense.rnea(t, s.q, 0 * s.v, 0 * s.v, s.fext),
    ),
    "crba": (lambda m, s: sd.crba(m, s.q), lambda t, s: dense.crba(t, s.q)),
    "crba by Jacobians": (lambda m, s: sd.crba(m, s.q), lambda t, s: dense.mass_matrix_by_jacobians(t, s.q)),
    "kinetic_energy": (lambda m, s: sd.kinetic_energy(m, s.q, s.v), lambda t, s: dense.kinetic_energy(t, s.q, s.v)),
    "potential_energy": (lambda m, s: sd.potential_energy(m, s.q), lambda t, s: dense.potential_energy(t, s.q)),
    "total_mass": (lambda m, s: sd.total_mass(m), lambda t, s: dense.total_mass(t)),
    "center_of_mass": (lambda m, s: sd.center_of_mass(m, s.q), lambda t, s: dense.com(t, s.q)),
    "center_of_mass_velocity": (
        lambda m, s: sd.center_of_mass_velocity(m, s.q, s.v),
        lambda t, s: dense.com_velocity(t, s.q, s.v),
    ),
    "center_of_mass_acceleration": (
        lambda m, s: sd.center_of_mass_acceleration(m, s.q, s.v, s.a),
        lambda t, s: dense.com_acceleration(t, s.q, s.v, s.a),
    ),
    "com_jacobian": (lambda m, s: sd.com_jacobian(m, s.q), lambda t, s: dense.com_jacobian(t, s.q)),
    "centroidal_momentum": (
        lambda m, s: sd.centroidal_momentum(m, s.q, s.v),
        lambda t, s: dense.centroidal_momentum(t, s.q, s.v),
    ),
    "centroidal_map": (lambda m, s: sd.centroidal_map(m, s.q), lambda t, s: dense.centroidal_map(t, s.q)),
    "centroidal_map_dot": (
        lambda m, s: sd.centroidal_map_dot(m, s.q, s.v),
        lambda t, s: dense.centroidal_map_dot(t, s.q, s.v),
    ),
    "coriolis_matrix": (
        lambda m, s: sd.coriolis_matrix(m, s.q, s.v),
        lambda t, s: dense.coriolis_matrix(t, s.q, s.v),
    ),
    "mass_matrix_dot": (
        lambda m, s: sd.mass_matrix_dot(m, s.q, s.v),
        lambda t, s: dense.mass_matrix_dot(t, s.q, s.v),
    ),
    "coriolis_transpose_times_velocity": (
        lambda m, s: sd.coriolis_transpose_times_velocity(m, s.q, s.v),
        lambda t, s: dense.coriolis_matrix(t, s.q, s.v).T @ s.v,
    ),
    "modified_rnea": (
        lambda m, s: sd.modified_rnea(m, s.q, s.v, s.tau, s.a),
        lambda t, s: dense.modified_rnea(t, s.q, s.v, s.tau, s.a),
    ),
    "christoffel_symbols": (
        lambda m, s: sd.christoffel_symbols(m, s.q),
        lambda t, s: dense.christoffel_symbols(t, s.q),
    ),
    "mass_matrix_derivatives": (
        lambda m, s: sd.mass_matrix_derivatives(m, s.q),
        lambda t, s: dense.mass_matrix_derivatives(t, s.q),
    ),
    "centroidal_momentum_rate": (
        lambda m, s: sd.centroidal_momentum_rate(m, s.q, s.v, s.a),
        lambda t, s: dense.centroidal_map(t, s.q) @ s.a + dense.centroidal_map_dot(t, s.q, s.v) @ s.v,
    ),
    "joint_velocities": (
        lambda m, s: sd.joint_velocities(m, s.q, s.v),
        lambda t, s: dense.velocities(t, s.q, s.v),
    ),
    "joint_accelerations": (
        lambda m, s: sd.joint_accelerations(m, s.q, s.v, s.a),
        lambda t, s: dense.accelerations(t, s.q, s.v, s.a),
    ),
    "forward_kinematics": (lambda m, s: sd.forward_kinematics(m, s.q), lambda t, s: dense.placements(t, s.q)),
    "integrate": (lambda m, s: sd.integrate(m, s.q, s.v), lambda t, s: dense.integrate(t, s.q, s.v)),
    "neutral": (lambda m, s: sd.neutral(m), lambda t, s: dense.neutral(t)),
    "difference": (
        lambda m, s: sd.difference(m, s.q, sd.integrate(m, s.q, 0.3 * s.v)),
        lambda t, s: dense.difference(t, s.q, dense.integrate(t, s.q, 0.3 * s.v)),
    ),
}


@pytest.mark.parametrize("name", ORACLE)
def test_call_equals_the_dense_oracle(case: Any, name: str) -> None:
    made, model, state = case
    ours, theirs = ORACLE[name]
    close(ours(model, state), theirs(made.tree, state))


@pytest.mark.parametrize("reference", slow_but(["local_world_aligned"], REFERENCES))
def test_frames_equal_the_dense_oracle(case: Any, reference: str) -> None:
    """Every frame in the last reference, and every second one in each of the others."""
    made, model, s = case
    tree = made.tree
    placed = dense.placements(tree, s.q)
    frames = model.frames if reference == REFERENCES[-1] else model.frames[REFERENCES.index(reference) :: 2]
    for frame in frames:
        X, body = frame.placement, frame.joint
        name = f"{frame.kind}:{frame.name}"
        close(sd.frame_placement(model, s.q, name), placed[body] @ X)
        J = dense.jacobian(tree, s.q, body, reference, X)
        drift = dense.jacobian_dot_times_v(tree, s.q, s.v, body, reference, X)
        close(sd.frame_jacobian(model, s.q, name, reference), J)
        dJ = dense.jacobian_dot(tree, s.q, s.v, body, reference, X)
        close(sd.frame_jacobian_dot(model, s.q, s.v, name, reference), dJ)
        close(sd.frame_velocity(model, s.q, s.v, name, reference), J @ s.v)
        close(sd.jacobian_dot_times_v(model, s.q, s.v, name, reference), drift)
        a = J @ s.a + drift
        classical = reference == "local_world_aligned"
        close(sd.frame_acceleration(model, s.q, s.v, s.a, name, reference, classical=classical), a)


def test_classical_acceleration_adds_omega_cross_v(case: Any) -> None:
    _, model, s = case
    frame = model.frames[-1]
    for reference in REFERENCES:
        V = sd.frame_velocity(model, s.q, s.v, frame, reference)
        spatial = sd.frame_acceleration(model, s.q, s.v, s.a, frame, reference)
        classical = sd.frame_acceleration(model, s.q, s.v, s.a, frame, reference, classical=True)
        close(classical - spatial, np.r_[np.cross(V[3:], V[:3]), 0, 0, 0])


def test_joint_jacobians_hold_every_joints_columns(case: Any) -> None:
    made, model, s = case
    J, dJ = sd.joint_jacobians(model, s.q), sd.joint_jacobians_dot(model, s.q, s.v)
    for k, joint in enumerate(model.joints[1:], 1):
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        close(J[:, own], dense.jacobian(made.tree, s.q, k, "world")[:, own])
        close(dJ[:, own], dense.jacobian_dot(made.tree, s.q, s.v, k, "world")[:, own])


def test_rnea_is_mass_matrix_times_a_plus_bias(case: Any) -> None:
    _, model, s = case
    close(sd.rnea(model, s.q, s.v, s.a), sd.crba(model, s.q) @ s.a + sd.nonlinear_effects(model, s.q, s.v))


def test_aba_inverts_rnea_with_forces(case: Any) -> None:
    _, model, s = case
    a = sd.aba(model, s.q, s.v, s.tau, s.fext)
    close(sd.rnea(model, s.q, s.v, a, s.fext), s.tau, 1e-11)
    close(sd.aba(model, s.q, s.v, sd.rnea(model, s.q, s.v, s.a)), s.a, 1e-11)


def test_minverse_inverts_the_mass_matrix(case: Any) -> None:
    _, model, s = case
    Minv = sd.minverse(model, s.q)
    assert (Minv == Minv.T).all()
    close(Minv @ sd.crba(model, s.q), np.eye(model.nv), 1e-11)


def test_mass_matrix_is_symmetric_to_the_bit_and_positive(case: Any) -> None:
    _, model, s = case
    M = sd.crba(model, s.q)
    assert (M == M.T).all()
    assert np.linalg.eigvalsh(M).min() > 0


def test_kinetic_energy_is_half_v_m_v(case: Any) -> None:
    _, model, s = case
    close(sd.kinetic_energy(model, s.q, s.v), 0.5 * s.v @ sd.crba(model, s.q) @ s.v)


def test_power_balance(case: Any) -> None:
    """dT/dt + dV/dt = vᵀτ along the motion that τ causes."""
    _, model, s = case
    a = sd.aba(model, s.q, s.v, s.tau)

    def energy(t: float) -> float:
        q = sd.integrate(model, s.q, t * s.v)  # without the term in t², which central differences cancel
        return sd.kinetic_energy(model, q, s.v + t * a) + sd.potential_energy(model, q)

    h = 1e-4
    rate = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    assert rate == pytest.approx(s.v @ s.tau, rel=1e-8, abs=1e-7 * abs(energy(0.0)))


def test_gravity_torque_is_the_gradient_of_the_potential(case: Any) -> None:
    _, model, s = case
    g, h = sd.generalized_gravity(model, s.q), 1e-4
    for k in range(model.nv):
        e = np.eye(model.nv)[k]
        V = [sd.potential_energy(model, sd.integrate(model, s.q, x * h * e)) for x in (-2, -1, 1, 2)]
        slope = (8 * (V[2] - V[1]) - (V[3] - V[0])) / (12 * h)
        assert slope == pytest.approx(g[k], rel=1e-7, abs=1e-8 * max(1.0, abs(V[0])))


def test_j_v_is_the_frames_velocity_by_difference(case: Any) -> None:
    _, model, s = case
    frame, h = model.frames[-1], 1e-6
    X = [sd.frame_placement(model, sd.integrate(model, s.q, x * h * s.v), frame) for x in (-1, 1)]
    J = sd.frame_jacobian(model, s.q, frame, "local_world_aligned")
    close((X[1][:3, 3] - X[0][:3, 3]) / (2 * h), (J @ s.v)[:3], 1e-8)


def test_centroidal_map_dot_is_the_maps_derivative(case: Any) -> None:
    _, model, s = case
    h = 1e-4
    A = [sd.centroidal_map(model, sd.integrate(model, s.q, x * h * s.v)) for x in (-2, -1, 1, 2)]
    close(sd.centroidal_map_dot(model, s.q, s.v), (8 * (A[2] - A[1]) - (A[3] - A[0])) / (12 * h), 1e-8)


def test_difference_undoes_integrate(case: Any) -> None:
    _, model, s = case
    dv = 0.7 * s.v
    close(sd.difference(model, s.q, sd.integrate(model, s.q, dv)), dv, 1e-13)


def test_static_torque_is_gravity_minus_jacobian_transpose_forces(case: Any) -> None:
    _, model, s = case
    expected = sd.generalized_gravity(model, s.q)
    for k in range(1, model.njoints):
        J = sd.frame_jacobian(model, s.q, f"joint:{model.names[k]}")
        expected = expected - J.T @ s.fext[k]
    close(sd.static_torque(model, s.q, s.fext), expected)


@pytest.mark.parametrize("seed", range(3))
def test_shifting_the_base_changes_nothing(seed: int) -> None:
    """A fixed base may stand anywhere; turned, it feels gravity from elsewhere and nothing more."""
    made = random_tree(20 + seed, 8)
    model, s = made.model, random_state(made.tree, np.random.default_rng(seed))
    R = dense.rotation_of([0.5, -0.5, 0.5, 0.5])
    base = tuple(dense.pose(R, (3.0, -2.0, 1.0)).ravel().tolist())
    moved = sd.Model(model.robot, replace(model.options, base=base))
    turned = model.with_(gravity=R.T @ model.gravity)
    close(sd.rnea(moved, s.q, s.v, s.a), sd.rnea(turned, s.q, s.v, s.a))
    close(sd.crba(moved, s.q), sd.crba(model, s.q))


@pytest.mark.parametrize("seed", range(3))
def test_shifting_a_floating_robot_changes_nothing(seed: int) -> None:
    made = random_tree(30 + seed, 8, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(seed))
    q = s.q.copy()
    q[:3] += (3.0, -2.0, 1.0)
    close(sd.rnea(model, q, s.v, s.a), sd.rnea(model, s.q, s.v, s.a))
    close(sd.crba(model, q), sd.crba(model, s.q))


def test_every_public_call_is_in_a_test_against_an_oracle() -> None:
    """A new recursion without an oracle fails here."""
    elsewhere = {
        "aba", "aba_refined", "aba_square_root", "crba_solve", "minverse",
        "joint_forces", "subtree_centers_of_mass", "subtree_com_velocities", "subtree_com_accelerations",
        "frame_placement", "frame_jacobian", "frame_jacobian_dot", "frame_velocity", "frame_acceleration",
        "jacobian_dot_times_v", "joint_jacobians", "joint_jacobians_dot", "normalize", "interpolate", "dintegrate",
        "ddifference", "momentum", "momentum_rate", "velocity_from_momentum", "hamiltonian", "hamilton_field",
        "inertial_parameters", "joint_torque_regressor", "body_regressor", "kinetic_energy_regressor",
        "potential_energy_regressor", "static_regressor", "operational_space_inertia_inverse",
        "modified_torque_regressor", "momentum_regressor", "coriolis_transpose_regressor",
        *(name for name in SPECS if name.endswith("_derivatives") and name != "mass_matrix_derivatives"),
    }  # fmt: skip
    assert set(SPECS) == elsewhere | {name for name in ORACLE if name in SPECS}


@pytest.mark.parametrize("batch", [(), (3,)])
def test_any_of_several_optional_inputs_may_be_left_out(batch: tuple[int, ...]) -> None:
    made = random_tree(3, 4)
    model, rng = made.model, np.random.default_rng(0)
    spec = SPECS["momentum_rate"]
    both = tuple(replace(x, optional=True) if x is not None and x.name == "tau" else x for x in spec.inputs)
    call = dynamics._python_function(replace(spec, inputs=both))
    q, v = sd.random_configuration(model, rng, batch), rng.normal(size=(*batch, model.nv))
    tau, fext = rng.normal(size=(*batch, model.nv)), rng.normal(size=(*batch, model.njoints, 6))
    for given in ({}, {"tau": tau}, {"fext": fext}, {"tau": tau, "fext": fext}, {"tau": tau.tolist()}):
        expected = sd.momentum_rate(model, q, v, given.get("tau", 0.0 * tau), given.get("fext"))
        close(call(model, q, v, **given), expected)
