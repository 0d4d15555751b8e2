"""One step of time by hand, its order, energy and batches; of mimic joints against dense matrices."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import dense
import numpy as np
import pytest
from trees import every_joint, pendulum, random_state, random_tree

import spatialdyn as sd
from spatialdyn.calls.random_configurations import random_configuration
from spatialdyn.calls.time_step import step
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.model.robot import Mimic

EPS = np.finfo(float).eps
IDENTITY = 1e-12  # relative to the largest entry: sums of a few dozen products in trees of ten bodies


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
