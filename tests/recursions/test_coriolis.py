"""C, the Christoffel symbols and the derivatives of M: by hand, by identities, on complex numbers, and at the limits.

The dense oracle is in test_dynamics.py, Pinocchio on every robot in test_corpus.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from complex_steps import CLOSE, JOINT, LINK, STEP, close, tangent
from dense import Array
from trees import RandomTree, State, random_state, random_tree, tree_case

import spatialdyn as sd
from spatialdyn.algebra.records import object_twin
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.recursions import SPECS

TREES = [*((seed, floating) for seed in range(3) for floating in (False, True)), (3, True)]


@pytest.fixture(params=TREES, ids=lambda p: f"{p[0]}-{'floating' if p[1] else 'fixed'}", scope="module")
def case(request: pytest.FixtureRequest) -> tuple[RandomTree, Any, State]:
    return tree_case(*request.param)


def two_link(m: tuple[float, float], l1: float, c: tuple[float, float], inertia: tuple[float, float]) -> Any:
    """A planar arm with two parallel axes."""
    builder = sd.ModelBuilder("arm")
    turning = [np.diag([0.0, 0.0, i]) + np.diag([1.0, 1.0, 0.0]) for i in inertia]
    builder.add_body("upper", None, "revolute", (0, 0, 1), (0, 0, 0), (m[0], (c[0], 0, 0), turning[0]))
    builder.add_body("lower", "upper", "revolute", (0, 0, 1), (l1, 0, 0), (m[1], (c[1], 0, 0), turning[1]))
    return builder.build(gravity=(0.0, -9.81, 0.0))


# --- by hand --------------------------------------------------------------------------------------------


def test_two_parallel_axes_have_the_textbooks_c_and_eight_symbols() -> None:
    """h = -m₂ l₁ c₂ sin q₂: C = [h q̇₂, h (q̇₁ + q̇₂); -h q̇₁, 0]."""
    model, q, v = two_link((2.0, 1.5), 0.7, (0.3, 0.4), (1.0, 1.2)), [0.4, -1.1], [0.8, -0.5]
    h = -1.5 * 0.7 * 0.4 * np.sin(q[1])
    close(sd.coriolis_matrix(model, q, v), [[h * v[1], h * (v[0] + v[1])], [-h * v[0], 0.0]])
    close(sd.christoffel_symbols(model, q), [[[0.0, h], [h, h]], [[-h, 0.0], [0.0, 0.0]]])
    close(sd.mass_matrix_derivatives(model, q)[..., 1], [[2 * h, h], [h, 0.0]])
    assert not sd.mass_matrix_derivatives(model, q)[..., 0].any()


def test_a_free_bodys_c_is_eulers_equation() -> None:
    """Of a body about its centre of mass, C v = (m ω × l, ω × J ω)."""
    J = np.diag([0.2, 0.3, 0.45])
    builder = sd.ModelBuilder("stone", root="stone")
    builder.set_inertia("stone", (2.0, (0, 0, 0), J))
    model = builder.build(root="floating")
    v = np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.7])
    l, w = v[:3], v[3:]
    forces = sd.coriolis_matrix(model, sd.neutral(model), v) @ v
    close(forces, np.r_[2.0 * np.cross(w, l), np.cross(w, J @ w)])


# --- identities -----------------------------------------------------------------------------------------


def test_c_v_is_the_bias_without_gravity(case: Any) -> None:
    _, model, s = case
    forces = sd.nonlinear_effects(model, s.q, s.v) - sd.generalized_gravity(model, s.q)
    close(sd.coriolis_matrix(model, s.q, s.v) @ s.v, forces)


def test_mdot_minus_2c_is_skew(case: Any) -> None:
    _, model, s = case
    C = sd.coriolis_matrix(model, s.q, s.v)
    dM = sd.mass_matrix_dot(model, s.q, s.v)
    assert (dM == dM.T).all()
    close(C + C.T, dM)


def test_symbols_contract_to_c_and_derivatives_to_mdot(case: Any) -> None:
    _, model, s = case
    close(sd.christoffel_symbols(model, s.q) @ s.v, sd.coriolis_matrix(model, s.q, s.v))
    close(sd.mass_matrix_derivatives(model, s.q) @ s.v, sd.mass_matrix_dot(model, s.q, s.v))


def test_derivatives_of_m_are_two_symbols_and_symmetric_to_the_bit(case: Any) -> None:
    _, model, s = case
    symbols, dM = sd.christoffel_symbols(model, s.q), sd.mass_matrix_derivatives(model, s.q)
    assert (dM == dM.transpose(1, 0, 2)).all()
    close(dM, symbols + symbols.transpose(1, 0, 2))


@pytest.mark.parametrize("seed", range(3))
def test_symbols_of_coordinates_are_christoffels_formula_and_symmetric(seed: int) -> None:
    made = random_tree(seed, 7, ("revolute", "continuous", "prismatic"))
    q = random_state(made.tree, np.random.default_rng(seed)).q
    symbols, d = sd.christoffel_symbols(made.model, q), sd.mass_matrix_derivatives(made.model, q)
    assert (symbols == symbols.transpose(0, 2, 1)).all()
    close(symbols, 0.5 * (d + d.transpose(0, 2, 1) - d.transpose(2, 0, 1)))


def test_c_transpose_v_is_the_rate_of_momentum_that_no_force_causes(case: Any) -> None:
    _, model, s = case
    forces = sd.coriolis_transpose_times_velocity(model, s.q, s.v)
    close(forces, sd.coriolis_matrix(model, s.q, s.v).T @ s.v)
    close(forces, sd.mass_matrix_dot(model, s.q, s.v) @ s.v - sd.coriolis_matrix(model, s.q, s.v) @ s.v)


def test_modified_rnea_is_rnea_where_the_velocities_are_one(case: Any) -> None:
    _, model, s = case
    close(sd.modified_rnea(model, s.q, s.v, s.v, s.a), sd.rnea(model, s.q, s.v, s.a))


def test_modified_rnea_is_linear_in_the_reference(case: Any) -> None:
    _, model, s = case
    w, b = np.random.default_rng(1).normal(size=(2, model.nv))
    g = sd.generalized_gravity(model, s.q)
    one = sd.modified_rnea(model, s.q, s.v, w, b) - g
    two = sd.modified_rnea(model, s.q, s.v, s.tau, s.a) - g
    close(sd.modified_rnea(model, s.q, s.v, 2 * w - 3 * s.tau, 2 * b - 3 * s.a) - g, 2 * one - 3 * two)
    close(one, sd.crba(model, s.q) @ b + sd.coriolis_matrix(model, s.q, s.v) @ w)


def test_armature_enters_the_reference_torque_and_no_c() -> None:
    models, body = [], (1.5, (0.1, 0.2, 0.3), np.diag([0.2, 0.3, 0.4]))
    for rotor in (0.0, 0.7):
        builder = sd.ModelBuilder("arm")
        builder.add_body("a", None, "revolute", (0, 0, 1), (0, 0, 0), body, armature=rotor)
        builder.add_body("b", "a", "spherical", (0, 0, 1), (0.3, 0, 0.1), body, armature=rotor)
        models.append(builder.build())
    bare, geared = models
    q = sd.random_configuration(bare, np.random.default_rng(0))
    v, w, a = np.random.default_rng(1).normal(size=(3, 4))
    assert off_diagonal(sd.crba(geared, q) - sd.crba(bare, q)) == 0.0
    for call in (sd.coriolis_matrix, sd.mass_matrix_dot, sd.coriolis_transpose_times_velocity):
        np.testing.assert_array_equal(call(geared, q, v), call(bare, q, v))
    np.testing.assert_array_equal(sd.christoffel_symbols(geared, q), sd.christoffel_symbols(bare, q))
    close(sd.modified_rnea(geared, q, v, w, a) - sd.modified_rnea(bare, q, v, w, a), 0.7 * a)


def off_diagonal(A: Array) -> float:
    return float(abs(A - np.diag(np.diag(A))).max())


# --- derivatives on complex numbers ---------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "floating"), [(0, True), (1, False)])
def test_derivatives_of_m_equal_complex_steps(seed: int, floating: bool) -> None:
    """∂M/∂q_k = Im M(q + i h ∂q) / h, exact to rounding: the recursion crba runs on complex numbers."""
    made = random_tree(seed, 5, floating=floating, continuous="cos_sin" if seed else "angle")
    model, s = made.model, random_state(made.tree, np.random.default_rng(seed))
    spec, dM = SPECS["crba"], np.empty((model.nv,) * 3)
    work = np.zeros(len(model.bodies), object_twin(spec.work)).view(np.recarray)  # type: ignore[arg-type]
    for k, along in enumerate(tangent(model, s.q)):
        M = np.zeros((model.nv, model.nv), complex)
        spec.recursion(model.bodies, work, [complex(x, STEP * y) for x, y in zip(s.q, along, strict=True)], M)
        dM[..., k] = M.imag / STEP
    close(sd.mass_matrix_derivatives(model, s.q), dM)


# --- limits ---------------------------------------------------------------------------------------------


def test_where_the_first_body_stands_does_not_matter_to_the_bit() -> None:
    made = random_tree(7, 5, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(7))
    far = s.q.copy()
    far[:7] = 1e6, -1e5, 3.0, 0.5, -0.5, 0.5, 0.5
    for call in (sd.coriolis_matrix, sd.mass_matrix_dot):
        np.testing.assert_array_equal(call(model, far, s.v), call(model, s.q, s.v))
    for call in (sd.christoffel_symbols, sd.mass_matrix_derivatives):
        np.testing.assert_array_equal(call(model, far), call(model, s.q))


def test_branches_from_the_world_do_not_couple() -> None:
    builder = sd.ModelBuilder("pair")
    body = (1.0, (0.1, 0.2, 0.3), 0.1 * np.eye(3))
    for side in "ab":
        builder.add_body(f"{side}1", None, "revolute", (0, 0, 1), (0.3, 0, 0), body)
        builder.add_body(f"{side}2", f"{side}1", "revolute", (0, 1, 0), (0.3, 0, 0), body)
    model = builder.build()
    symbols = sd.christoffel_symbols(model, [0.1, 0.2, 0.3, 0.4])
    assert not symbols[:2, 2:].any()
    assert not symbols[:2, :, 2:].any()
    assert not symbols[2:, :2].any()
    assert symbols[:2, :2, :2].any()


def test_sliders_alone_have_no_symbols_and_no_freedoms_an_empty_c() -> None:
    made = random_tree(3, 4, ("prismatic",))
    q, v = np.ones(4), np.ones(4)
    for found in (sd.coriolis_matrix(made.model, q, v), sd.christoffel_symbols(made.model, q)):
        assert abs(found).max() <= CLOSE
    none = sd.ModelBuilder("rock", root="rock").build()
    assert sd.coriolis_matrix(none, [], []).shape == (0, 0)
    assert sd.mass_matrix_derivatives(none, []).shape == (0, 0, 0)


MIMIC = """<robot name="gripper"><link name="base"/>{links}{joints}</robot>"""


@pytest.mark.parametrize("root", ["fixed", "floating"])
def test_mimic_joints_contract_every_axis_with_g(root: str) -> None:
    """G is constant, so M(q) = Gᵀ M_full G passes its derivatives on."""
    links = "".join(LINK.format(n, 0.1 * k, 1 + k) for k, n in enumerate("abcd"))
    mimic = '<mimic joint="j1" multiplier="{}" offset="{}"/>'
    joints = JOINT.format("j1", "base", "a", "0 0 1", "") + JOINT.format("j2", "a", "b", "0 1 0", "")
    joints += JOINT.format("j3", "b", "c", "1 0 0", mimic.format(-0.5, 0.2))
    joints += JOINT.format("j4", "a", "d", "0 1 0", mimic.format(2.0, 0.0))
    text = MIMIC.format(links=links, joints=joints)
    model, full = sd.load_urdf(text, root=root, mimic=True), sd.load_urdf(text, root=root)
    rng = np.random.default_rng(0)
    q, v, w, a = sd.random_configuration(model, rng), *rng.normal(size=(3, model.nv))
    G = np.zeros((full.nv, model.nv))
    G[: full.nv - 4, : model.nv - 2] = np.eye(full.nv - 4, model.nv - 2)
    G[-4:, -2:] = [[1, 0], [0, 1], [-0.5, 0], [2, 0]]
    angles = q[-2:]
    whole = np.r_[q[:-2], angles[0], angles[1], 0.2 - 0.5 * angles[0], 2.0 * angles[0]]
    u = G @ v
    close(sd.coriolis_matrix(model, q, v), G.T @ sd.coriolis_matrix(full, whole, u) @ G)
    close(sd.mass_matrix_dot(model, q, v), G.T @ sd.mass_matrix_dot(full, whole, u) @ G)
    for call in (sd.christoffel_symbols, sd.mass_matrix_derivatives):
        close(call(model, q), np.einsum("abc,ai,bj,ck->ijk", call(full, whole), G, G, G))
    bias = sd.nonlinear_effects(model, q, v) - sd.generalized_gravity(model, q)
    close(sd.coriolis_matrix(model, q, v) @ v, bias)
    close(sd.christoffel_symbols(model, q) @ v, sd.coriolis_matrix(model, q, v))
    close(
        sd.coriolis_transpose_times_velocity(model, q, v),
        G.T @ sd.coriolis_transpose_times_velocity(full, whole, u),
    )
    close(sd.modified_rnea(model, q, v, w, a), G.T @ sd.modified_rnea(full, whole, u, G @ w, G @ a))


# --- programs -------------------------------------------------------------------------------------------


def test_regrouped_inertias_change_nothing_on_any_kind_of_joint() -> None:
    """Programs are recorded with them; here the table itself has them."""
    from spatialdyn.engines.programs.record.regroup import regroup
    from spatialdyn.engines.programs.record.tracer import scratch, table

    made = random_tree(11, 7, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(11))
    given = {"q": s.q, "v": s.v, "v_r": s.tau, "a_r": s.a}
    for name in (
        "coriolis_matrix", "mass_matrix_dot", "coriolis_transpose_times_velocity", "modified_rnea",
        "christoffel_symbols", "mass_matrix_derivatives",
    ):  # fmt: skip
        spec, rows = SPECS[name], table(model.bodies)
        assert spec.regroup
        regroup(rows)
        out = np.zeros([model.nv] * len(spec.output.shape))
        inputs = [given[x.name] for x in spec.present]
        spec.recursion(rows, scratch(spec.work, rows), *inputs, out)
        close(out, getattr(sd, name)(model, *inputs))


def test_a_program_of_c_is_no_longer_than_it_was() -> None:
    """In operations, of a UR5-like arm of six right-angled axes; times are for benchmarks."""
    builder = sd.ModelBuilder("six")
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0)]
    for k, axis in enumerate(axes):
        body = (1.0 + k, (0.1, 0.2, 0.3), np.diag([0.2, 0.3, 0.4]))
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, (0.1, 0.0, 0.4), body)
    model = builder.build()
    counts = {name: sd.specialize(model, getattr(sd, name)).operations for name in ("coriolis_matrix", "crba")}
    total = {name: count["mul"] + count["add"] for name, count in counts.items()}
    assert total["coriolis_matrix"] <= 8 * total["crba"]
    assert counts["coriolis_matrix"]["sincos"] == 5  # the first angle does not enter


def test_tensors_too_large_for_a_program_go_untraced() -> None:
    made = random_tree(2, 30, ("revolute",), fixed=False)
    assert recording.fits((SPECS["coriolis_matrix"],), made.model.bodies)
    assert not recording.fits((SPECS["christoffel_symbols"],), made.model.bodies)
    assert recording.fits((SPECS["christoffel_symbols"],), made.model.bodies, 100)


@pytest.mark.slow(quick="calls/test_specialize.py::test_a_program_answers_as_the_plain_call_does")
@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is traced")
def test_specialized_calls_equal_public_ones() -> None:
    made = random_tree(5, 4, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(5))
    close(sd.specialize(model, sd.coriolis_matrix)(s.q, s.v), sd.coriolis_matrix(model, s.q, s.v))
    close(sd.specialize(model, sd.christoffel_symbols)(s.q), sd.christoffel_symbols(model, s.q))
