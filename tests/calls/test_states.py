"""Random configurations, one time step, and forces at named frames."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import dense
import numpy as np
import pytest
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.calls.random_configurations import random_configuration
from spatialdyn.calls.time_step import step
from spatialdyn.calls.wrenches import wrench_at
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.model.robot import Mimic

EPS = np.finfo(float).eps
IDENTITY = 1e-12  # relative to the largest entry: sums of a few dozen products in trees of ten bodies
MANY = 20000  # samples; a mean of that many uniforms on [-1, 1] is off by 0.0041 at one sigma
SIX_SIGMA = 6.0 / math.sqrt(3.0 * MANY)
REFERENCES = ("local", "world", "local_world_aligned")


def pendulum(**options: Any) -> sd.Model:
    """A point mass of 1 kg on a rod of 1 m that turns about y."""
    builder = sd.ModelBuilder("pendulum")
    builder.add_body("rod", axis=(0, 1, 0), inertia=(1.0, (0.0, 0.0, -1.0), np.zeros((3, 3))), **options)
    return builder.build()


def every_joint(continuous: str = "angle") -> sd.Model:
    """One joint of every kind."""
    builder = sd.ModelBuilder("all")
    parent = None
    for k, kind in enumerate(("floating", "revolute", "continuous", "prismatic", "spherical", "planar")):
        name = f"b{k}"
        builder.add_body(
            name, parent, kind, (1, 2, 2), (0.1, 0.2, 0.3), (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3)), kind,
            limits=(-0.25, 0.75) if kind in ("revolute", "prismatic") else (-math.inf, math.inf),
        )  # fmt: skip
        parent = name
    return builder.build(continuous=continuous)


# --- random configurations -------------------------------------------------------------------------------


def test_same_seed_gives_same_configurations_whatever_the_batch() -> None:
    model = every_joint()
    q = random_configuration(model, np.random.default_rng(7), (3, 4))
    assert q.shape == (3, 4, model.nq)
    rng = np.random.default_rng(7)
    one_by_one = [random_configuration(model, rng) for _ in range(12)]
    np.testing.assert_array_equal(q.reshape(12, -1), one_by_one)
    assert random_configuration(model, rng, 5).shape == (5, model.nq)
    assert random_configuration(model, rng, (0, 2)).shape == (0, 2, model.nq)


@pytest.mark.parametrize("continuous", ["angle", "cos_sin"])
def test_configurations_are_within_limits_and_of_unit_norm(continuous: str) -> None:
    model = every_joint(continuous)
    q = random_configuration(model, np.random.default_rng(0), (1000,))
    assert (q >= model.lower).all()
    assert (q <= model.upper).all()
    np.testing.assert_allclose(sd.normalize(model, q), q, atol=4 * EPS)
    free = {"floating": (0, 3, 1.0), "planar": (0, 2, 1.0)}
    free |= {"planar angle": (2, 3, math.pi), "continuous": (0, 1, math.pi)} if continuous == "angle" else {}
    for what, (first, last, reach) in free.items():
        joint = model.joint(what.split()[0])
        drawn = q[:, joint.idx_q + first : joint.idx_q + last]
        assert abs(drawn).max() <= reach
        assert abs(drawn).max() > 0.99 * reach


def test_rotations_are_uniform() -> None:
    """Entries of a uniform rotation have mean 0 and variance 1/3, quaternions mean 0 and covariance 1/4."""
    model = sd.ModelBuilder().add_body("b", joint="spherical").build()
    q = random_configuration(model, np.random.default_rng(1), (MANY,))
    R = sd.frame_placement(model, q, "b")[:, :3, :3].reshape(MANY, 9)
    assert abs(R.mean(0)).max() < SIX_SIGMA
    assert abs(R.T @ R / MANY - np.eye(9) / 3.0).max() < SIX_SIGMA
    assert abs(q.mean(0)).max() < SIX_SIGMA
    assert abs(q.T @ q / MANY - np.eye(4) / 4.0).max() < SIX_SIGMA


@pytest.mark.parametrize(
    ("kind", "limits", "expected"),
    [
        ("revolute", (-math.inf, math.inf), (-math.pi, math.pi)),
        ("prismatic", (-math.inf, math.inf), (-1.0, 1.0)),
        ("revolute", (0.5, math.inf), (0.5, 0.5 + 2.0 * math.pi)),
        ("prismatic", (-math.inf, 0.5), (-1.5, 0.5)),
        ("revolute", (0.1, 0.4), (0.1, 0.4)),
        ("prismatic", (-1e308, 1e308), (-1e308, 1e308)),
    ],
)
def test_coordinates_fill_their_interval(kind: str, limits: Any, expected: tuple[float, float]) -> None:
    model = sd.ModelBuilder().add_body("b", joint=kind, limits=limits).build()
    u = random_configuration(model, np.random.default_rng(2), (MANY,)) / 2.0
    low, high = expected[0] / 2.0, expected[1] / 2.0
    assert low <= u.min() < low + 1e-3 * (high - low)
    assert high - 1e-3 * (high - low) < u.max() <= high
    assert abs(np.mean(u / (high - low)) - (high + low) / 2.0 / (high - low)) < SIX_SIGMA


def test_joint_of_no_range_stays() -> None:
    model = sd.ModelBuilder().add_body("b", limits=(0.3, 0.3)).build()
    assert (random_configuration(model, np.random.default_rng(0), (9,)) == 0.3).all()


def test_mimic_models_draw_their_own_coordinates() -> None:
    builder = sd.ModelBuilder()
    builder.add_body("a", joint_name="a", mimic={"leader": "c", "multiplier": 2.0})
    builder.add_body("b", joint_name="b", limits=(1.0, 2.0)).add_body("c", joint_name="c", limits=(3.0, 4.0))
    model = builder.build(mimic=True)
    q = random_configuration(model, np.random.default_rng(0), (50,))
    assert q.shape == (50, 2)
    assert ((q >= [1.0, 3.0]) & (q <= [2.0, 4.0])).all()


def test_model_without_joints_has_one_configuration() -> None:
    assert random_configuration(sd.ModelBuilder().build(), np.random.default_rng(0), (3,)).shape == (3, 0)


def test_bad_arguments_of_random_configuration_are_refused() -> None:
    model = pendulum()
    for rng in (-1, 0.5, True, (2, 3), np.random.RandomState(0)):
        with pytest.raises(sd.SpatialDynError, match=r"rng is (a \w+|-1), expected a numpy\.random\.Generator, a seed"):
            random_configuration(model, rng)  # type: ignore[arg-type]
    for shape in (-1, (2, -3), 1.5, "ab", None, True, [np.True_]):
        with pytest.raises(sd.ShapeError, match=r"shape is .*, expected a size"):
            random_configuration(model, np.random.default_rng(0), shape)  # type: ignore[arg-type]
    with pytest.raises(sd.ModelError, match="model is a str, expected a spatialdyn Model"):
        random_configuration("ur5", np.random.default_rng(0))  # type: ignore[arg-type]


def test_a_seed_or_nothing_stands_for_a_generator() -> None:
    model = pendulum()
    seeded = random_configuration(model, 7, (4,))
    assert (seeded == random_configuration(model, np.random.default_rng(7), (4,))).all()
    assert (seeded == random_configuration(model, np.int64(7), 4)).all()
    assert random_configuration(model) != random_configuration(model)
    assert random_configuration(model, shape=3).shape == (3, model.nq)


# --- one step of time ------------------------------------------------------------------------------------


def test_euler_steps_of_a_pendulum_by_hand() -> None:
    """q̈ = (τ - 9.81 sin q) / (1 kg m²)."""
    q, v, tau, h = [0.5], [2.0], [3.0], 0.01
    a = 3.0 - 9.81 * math.sin(0.5)
    q1, v1 = step(pendulum(), q, v, tau, h)
    np.testing.assert_allclose(v1, [2.0 + h * a], rtol=4 * EPS)
    np.testing.assert_allclose(q1, [0.5 + h * (2.0 + h * a)], rtol=4 * EPS)
    q1, v1 = step(pendulum(), q, v, tau, h, method="explicit_euler")
    np.testing.assert_allclose(v1, [2.0 + h * a], rtol=4 * EPS)
    np.testing.assert_allclose(q1, [0.5 + h * 2.0], rtol=4 * EPS)


def advanced(model: sd.Model, method: str, n: int, state: Any, time: float) -> tuple[np.ndarray, np.ndarray]:
    """The state after ``time`` in n steps."""
    q, v = state.q, state.v
    for _ in range(n):
        q, v = step(model, q, v, 0.1 * state.tau, time / n, method, 0.1 * state.fext)
    return q, v


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: minutes of plain Python")
@pytest.mark.parametrize(("method", "order"), [("explicit_euler", 1), ("semi_implicit_euler", 1), ("rk4", 4)])
@pytest.mark.parametrize("continuous", ["angle", "cos_sin"])
def test_steps_have_their_order_on_every_joint(method: str, order: int, continuous: str) -> None:
    """The error falls by 2^order when the step is halved."""
    made = random_tree(11, 5, ("spherical", "planar", "continuous", "prismatic"), True, continuous)
    model, state = made.model, random_state(made.tree, np.random.default_rng(3))
    q, v = advanced(model, "rk4", 160, state, 0.1)

    def error(n: int) -> float:
        q1, v1 = advanced(model, method, n, state, 0.1)
        return float(np.linalg.norm(sd.difference(model, q, q1)) + np.linalg.norm(v1 - v))

    n = 10 if order == 4 else 80
    assert 0.8 * 2**order < error(n) / error(2 * n) < 1.25 * 2**order


def test_rk4_returns_where_it_came_from_when_time_turns() -> None:
    """Forward and back: what is left is the local error, of fifth order."""
    made = random_tree(12, 4, floating=True)
    model, state = made.model, random_state(made.tree, np.random.default_rng(0))
    left = []
    for h in (2e-3, 1e-3):
        q, v = step(model, state.q, state.v, state.tau, h, "rk4")
        q, v = step(model, q, v, state.tau, -h, "rk4")
        left.append(np.linalg.norm(sd.difference(model, state.q, q)) + np.linalg.norm(v - state.v))
    assert left[0] < 1e-3
    assert left[1] < left[0] / 16.0


def test_semi_implicit_euler_keeps_the_energy_of_a_pendulum() -> None:
    model = pendulum()

    def drift(method: str) -> float:
        q, v = np.array([1.0]), np.array([0.0])
        energy = sd.potential_energy(model, q)
        for _ in range(2000):
            q, v = step(model, q, v, np.zeros(1), 0.01, method)
        return float(sd.kinetic_energy(model, q, v) + sd.potential_energy(model, q) - energy)

    assert abs(drift("semi_implicit_euler")) < 0.2  # bounded by about h T, T up to 4.5 J
    assert drift("explicit_euler") > 1.0
    assert abs(drift("rk4")) < 1e-5


@pytest.mark.parametrize("method", ["explicit_euler", "semi_implicit_euler", "rk4"])
def test_batches_of_steps_match_single_steps(method: str) -> None:
    model, rng = every_joint(), np.random.default_rng(0)
    q, v = random_configuration(model, rng, (3, 1)), rng.normal(size=(4, model.nv))
    dt, fext = np.array([1e-3, 2e-3, 3e-3, 4e-3]), rng.normal(size=(model.njoints, 6))
    q1, v1 = step(model, q, v, np.zeros(model.nv), dt, method, fext)
    assert q1.shape == (3, 4, model.nq)
    assert v1.shape == (3, 4, model.nv)
    one = step(model, q[2, 0], v[1], np.zeros(model.nv), dt[1], method, fext)
    np.testing.assert_allclose(q1[2, 1], one[0], rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(v1[2, 1], one[1], rtol=0, atol=1e3 * EPS)
    # a batch of torques alone moves one state to many
    many = step(model, q[0, 0], v[0], rng.normal(size=(5, model.nv)), 1e-3, method)
    assert many[0].shape == (5, model.nq)
    assert many[1].shape == (5, model.nv)


def test_steps_leave_their_input_alone() -> None:
    model, rng = every_joint(), np.random.default_rng(0)
    q, v = random_configuration(model, rng), rng.normal(size=model.nv)
    q0, v0 = q.copy(), v.copy()
    for method in ("explicit_euler", "semi_implicit_euler", "rk4"):
        for dt in (1e-3, 0.0):
            q1, v1 = step(model, q, v, np.zeros(model.nv), dt, method)
            assert not np.shares_memory(q1, q)
            assert not np.shares_memory(v1, v)
    assert (q == q0).all()
    assert (v == v0).all()


def test_nan_stays_in_its_sample() -> None:
    model = every_joint()
    q = random_configuration(model, np.random.default_rng(0), (3,))
    v, tau = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    tau[1, 2] = np.nan
    for method in ("explicit_euler", "semi_implicit_euler", "rk4"):
        q1, v1 = step(model, q, v, tau, 1e-3, method)
        assert np.isnan(v1[1]).any()
        assert np.isfinite(q1[[0, 2]]).all()
        assert np.isfinite(v1[[0, 2]]).all()


MIMICS = {"j0003": Mimic("j0001", -0.7, 0.3), "j0004": Mimic("j0003", 0.5, -0.2), "j0006": Mimic("j0005", 2.0, 0.1)}
# the same as q_whole = G q + offset; j0004 follows j0003 and so j0001
G = np.array([[1, 0, 0], [0, 1, 0], [-0.7, 0, 0], [-0.35, 0, 0], [0, 0, 1], [0, 0, 2.0]])
OFFSET = np.array([0, 0, 0.3, 0.5 * 0.3 - 0.2, 0, 0.1])


def test_mimic_models_step_as_the_dense_equation_of_motion_reduced_by_g() -> None:
    """Gᵀ M G a = tau - Gᵀ (M Ġ v + bias) with Ġ = 0: dense matrices of the full tree, each method by its formula."""
    h = 1e-3
    for seed in range(4):
        made, rng = random_tree(seed, 6, ("revolute", "prismatic", "continuous")), np.random.default_rng(seed)
        robot = made.builder.robot()
        joints = tuple(replace(joint, mimic=MIMICS.get(joint.name)) for joint in robot.joints)
        model = sd.model.assemble(replace(robot, joints=joints), mimic=True)
        q, v, tau = rng.normal(size=(3, 3))

        def acceleration(q: Any, v: Any, tree: Any = made.tree, tau: Any = tau) -> Any:
            whole = G @ q + OFFSET
            bias = dense.bias(tree, whole, G @ v)
            return np.linalg.solve(G.T @ dense.crba(tree, whole) @ G, tau - G.T @ bias)

        a = acceleration(q, v)
        expected = {"explicit_euler": (q + h * v, v + h * a), "semi_implicit_euler": (q + h * (v + h * a), v + h * a)}
        v2 = v + h / 2 * a
        a2 = acceleration(q + h / 2 * v, v2)
        v3 = v + h / 2 * a2
        a3 = acceleration(q + h / 2 * v2, v3)
        v4 = v + h * a3
        a4 = acceleration(q + h * v3, v4)
        expected["rk4"] = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a + 2 * a2 + 2 * a3 + a4)
        scale = max(1.0, abs(a).max(), abs(v).max())
        for method, (q1, v1) in expected.items():
            found = step(model, q, v, tau, h, method)
            np.testing.assert_allclose(found[0], q1, rtol=0, atol=IDENTITY * h * scale + 8 * EPS * scale)
            np.testing.assert_allclose(found[1], v1, rtol=0, atol=IDENTITY * h * scale + 8 * EPS * scale)
            assert abs(found[1] - v).max() > 1e6 * EPS * scale


def test_bad_arguments_of_step_are_refused() -> None:
    model = pendulum()
    for method in ("euler", None, ["rk4"]):
        with pytest.raises(sd.SpatialDynError, match=r"method is .*, expected one of explicit_euler, semi_"):
            step(model, [0.0], [0.0], [0.0], 0.1, method)  # type: ignore[arg-type]
    for dt in (math.nan, math.inf, [0.1, math.nan]):
        with pytest.raises(sd.SpatialDynError, match=r"dt is .*, expected finite numbers"):
            step(model, [0.0], [0.0], [0.0], dt)
    with pytest.raises(sd.ShapeError, match="dt has dtype"):
        step(model, [0.0], [0.0], [0.0], "fast")  # type: ignore[arg-type]
    with pytest.raises(sd.ShapeError, match=r"tau has shape \(2,\), expected \(\.\.\., 1\)"):
        step(model, [0.0], [0.0], [0.0, 0.0], 0.1)
    with pytest.raises(sd.ShapeError, match="batch shapes do not broadcast"):
        step(model, [[0.0]] * 3, [0.0], [0.0], [0.1, 0.2])
    with pytest.raises(sd.NonFiniteError, match="not finite in sample 1, the first of 1"):
        step(model, [0.0], [0.0], [[0.0], [1e300]], 1e300)
    with pytest.raises(sd.InertiaError, match='joint "b_joint" has zero articulated inertia'):
        step(sd.ModelBuilder().add_body("b").build(), [0.0], [0.0], [0.0], 0.1)


# --- forces at frames ------------------------------------------------------------------------------------


def test_force_at_the_tip_of_a_pendulum_by_hand() -> None:
    """At q = 90° about y the rod points along -x: 1 N along the world's z, at the tip, turns by +1 N m about y."""
    builder = sd.ModelBuilder()
    builder.add_body("rod", axis=(0, 1, 0), inertia=(1.0, (0, 0, -1), np.zeros((3, 3))))
    builder.add_body("tip", "rod", "fixed", placement=(0, 0, -1))
    model, q = builder.build(), [math.pi / 2]
    force = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    fext = wrench_at(model, q, "tip", force, "local_world_aligned")
    # in the rod's frame the world's z is -x, and the moment about its origin is (0, 0, -1) × (-1, 0, 0) = (0, 1, 0)
    np.testing.assert_allclose(fext, [[0] * 6, [-1, 0, 0, 0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(sd.static_torque(model, q, fext), sd.generalized_gravity(model, q) - 1.0, atol=1e-14)
    np.testing.assert_allclose(wrench_at(model, q, "tip", force)[1], [0, 0, 1, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(wrench_at(model, q, "tip", force, "world")[1], [-1, 0, 0, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("seed", range(3))
def test_static_torque_is_gravity_minus_jacobian_transposed_force(seed: int, reference: str) -> None:
    made = random_tree(seed, 6, floating=bool(seed % 2), continuous=("angle", "cos_sin")[seed % 2])
    model, rng = made.model, np.random.default_rng(seed)
    q = random_configuration(model, rng)
    for frame in model.frames:
        force = rng.normal(size=6)
        J = sd.frame_jacobian(model, q, frame, reference)
        expected = sd.generalized_gravity(model, q) - J.T @ force
        found = sd.static_torque(model, q, wrench_at(model, q, frame, force, reference))
        assert abs(found - expected).max() <= IDENTITY * max(1.0, abs(expected).max())


def test_forces_add_up_and_batches_broadcast() -> None:
    made = random_tree(4, 5)
    model, rng = made.model, np.random.default_rng(0)
    q, force = random_configuration(model, rng, (3, 1)), rng.normal(size=(2, 6))
    for reference in REFERENCES:
        fext = wrench_at(model, q, "b0005", force, reference)
        assert fext.shape == (3, 2, model.njoints, 6)
        one = wrench_at(model, q[1, 0], "b0005", force[1], reference)
        np.testing.assert_allclose(fext[1, 1], one, atol=1e-14)
    both = wrench_at(model, q, "b0005", force) + wrench_at(model, q, "b0002", force)
    assert (abs(both).max(axis=(0, 1, 3)) > 0).tolist() == [k in (2, 5) for k in range(model.njoints)]


def test_force_on_what_is_fixed_goes_to_row_0() -> None:
    model = pendulum()
    fext = wrench_at(model, [0.3], model.robot.root, np.arange(6.0))
    assert (fext == [np.arange(6.0), np.zeros(6)]).all()
    assert sd.static_torque(model, [0.3], fext) == sd.generalized_gravity(model, [0.3])


def test_nan_configuration_spoils_its_own_wrench_only() -> None:
    q = np.array([[0.1], [np.nan], [0.2]])
    fext = wrench_at(pendulum(), q, "rod", np.ones(6), "world")
    assert np.isnan(fext[1, 1]).any()
    assert np.isfinite(fext[[0, 2]]).all()


def test_bad_arguments_of_wrench_at_are_refused() -> None:
    model = pendulum()
    with pytest.raises(sd.ModelError, match='frame "tip" is not in robot "pendulum"'):
        wrench_at(model, [0.0], "tip", np.zeros(6))
    with pytest.raises(sd.SpatialDynError, match="reference is 'body', expected one of local, world"):
        wrench_at(model, [0.0], "rod", np.zeros(6), "body")
    with pytest.raises(sd.ShapeError, match=r"force has shape \(3,\), expected \(\.\.\., 6\)"):
        wrench_at(model, [0.0], "rod", np.zeros(3))
    with pytest.raises(sd.ShapeError, match=r"q has shape \(2,\), expected \(\.\.\., 1\)"):
        wrench_at(model, [0.0, 0.0], "rod", np.zeros(6))
    with pytest.raises(sd.ShapeError, match="batch shapes do not broadcast"):
        wrench_at(model, np.zeros((3, 1)), "rod", np.zeros((2, 6)))
