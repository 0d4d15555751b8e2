"""Cartesian impedance: its line by matrices, a Lyapunov function that falls, exact damping of modes, bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
CLOSE = 1e-10  # relative: J, M and C formed, against recursions
Q0, V0 = np.array([0.1, -1.0, 1.2, 0.3, 0.5, 0.2]), np.array([0.2, -0.1, 0.3, -0.2, 0.1, 0.4])
K, D = np.diag([400.0, 300.0, 500.0, 20.0, 20.0, 20.0]), np.diag([40.0, 40.0, 40.0, 3.0, 2.0, 3.0])
GOAL = np.array([0.15, -0.95, 1.1, 0.25, 0.6, 0.3])


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("ur5")


def error(model: sd.Model, q: Any, target: Any) -> Any:
    """e, by SciPy's rotations in place of ours."""
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    X = sd.frame_placement(model, q, "tool0")
    return np.r_[target[:3, 3] - X[:3, 3], rotation.from_matrix(target[:3, :3] @ X[:3, :3].T).as_rotvec()]


def test_the_law_is_its_line(arm: sd.Model) -> None:
    target = sd.frame_placement(arm, GOAL, "tool0")
    law = sd.Impedance(arm, "tool0", target, K, D, joint_damping=0.5)
    J = sd.frame_jacobian(arm, Q0, "tool0", "local_world_aligned")
    e = error(arm, Q0, target)
    wanted = sd.generalized_gravity(arm, Q0) + J.T @ (K @ e - D @ (J @ V0)) - 0.5 * V0
    np.testing.assert_allclose(law(arm, 0.0, Q0, V0), wanted, rtol=CLOSE, atol=CLOSE)
    rate, a = np.linspace(-0.3, 0.4, 6), np.linspace(0.5, -0.2, 6)
    moving = sd.Impedance(arm, "tool0", target, K, D, velocity=rate, acceleration=a)
    x = sd.operational_space(arm, Q0, V0, "tool0", "local_world_aligned", damping=1e-9)
    F = x.Lambda @ a + x.C @ rate + x.p - D @ (J @ V0 - rate) + K @ e
    np.testing.assert_allclose(moving(arm, 0.0, Q0, V0), J.T @ F, rtol=1e-8, atol=1e-8)


def test_its_lyapunov_function_falls(arm: sd.Model) -> None:
    """With Λ(q) as it changes: ½ vᵀM v + ½ eᵀK e of a robot that is held."""
    target = sd.frame_placement(arm, GOAL, "tool0")
    law = sd.Impedance(arm, "tool0", target, K, D)
    run = sd.simulate(arm, Q0, V0, 0.6, 2e-3, "rk4", control=law)
    V = sd.kinetic_energy(arm, run.q, run.v) + [0.5 * (e := error(arm, q, target)) @ K @ e for q in run.q]
    assert np.diff(V).max() < 1e-9 * V[0]
    assert V[-1] < 0.2 * V[0]


@compiled
def test_closed_loops_run_on_lanes_as_alone(arm: sd.Model) -> None:
    law = sd.Impedance(arm, "tool0", sd.frame_placement(arm, GOAL, "tool0"), K, D)
    rng = np.random.default_rng(0)
    q = Q0 + 0.1 * rng.normal(size=(16, 6))
    runs = sd.rollout(arm, q, np.zeros((16, 6)), dt=1e-3, steps=20, control=law)
    one = sd.rollout(arm, q[7:8], np.zeros((1, 6)), dt=1e-3, steps=20, control=law)
    np.testing.assert_array_equal(runs.q[7], one.q[0])


def test_all_modes_have_the_damping_that_was_asked_for(arm: sd.Model) -> None:
    """Exactly, where 2 ζ √K has ratios all over."""
    Lambda = sd.operational_space(arm, Q0, 0.0 * V0, "tool0", "local_world_aligned", damping=1e-9).Lambda
    for zeta in (0.7, 1.0, np.linspace(0.3, 0.8, 6)):
        made = sd.cartesian_damping(Lambda, K, zeta)
        np.testing.assert_allclose(made, made.T, atol=1e-9)
        A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(Lambda, K), -np.linalg.solve(Lambda, made)]])
        w = np.linalg.eigvals(A)
        found = np.sort(-w.real / abs(w))
        wanted = np.sort(np.repeat(np.broadcast_to(zeta, 6), 2))
        np.testing.assert_allclose(found, wanted, atol=1e-6)  # a double root splits by the root of rounding


BAD: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"frame": "hand"}, sd.ModelError, "hand"),
    ({"frame": "world"}, sd.ModelError, "does not move"),
    ({"K": 0.0}, sd.SimulationError, "K has the eigenvalue 0"),
    ({"K": np.diag([1.0, 1, 1, 1, 2, 1])}, sd.SimulationError, "rows of rotations"),
    ({"D": -1.0}, sd.SimulationError, "D has the eigenvalue -1"),
    ({"D": [1.0, 2.0]}, sd.ShapeError, "D has shape"),
    ({"target": np.zeros((4, 4))}, sd.SimulationError, "no rotation"),
    ({"target": np.eye(3)}, sd.ShapeError, "target has shape"),
    ({"velocity": [1.0]}, sd.ShapeError, "velocity has shape"),
    ({"joint_damping": np.eye(6)}, sd.ShapeError, "joint_damping has shape"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "kind", "message"), BAD)
def test_bad_input_is_named(arm: sd.Model, change: dict[str, Any], kind: type[Exception], message: str) -> None:
    given = {"model": arm, "frame": "tool0", "target": np.eye(4), "K": K, "D": D}
    with pytest.raises(kind, match=message):
        sd.Impedance(**(given | change))


def test_damping_of_what_is_no_mass_is_refused() -> None:
    with pytest.raises(sd.SimulationError, match="Lambda has the eigenvalue"):
        sd.cartesian_damping(np.diag([1.0, 0.0]), [1.0, 1.0])
    with pytest.raises(sd.SimulationError, match="K is not symmetric, by up to 3"):
        sd.cartesian_damping(np.eye(2), [[4.0, 3.0], [0.0, 4.0]])
    with pytest.raises(sd.ShapeError, match="K has shape"):
        sd.cartesian_damping(np.eye(2), np.eye(3))
    with pytest.raises(sd.SimulationError, match="zeta is"):
        sd.cartesian_damping(np.eye(2), np.eye(2), -1.0)


def test_the_law_holds_the_frame_of_its_own_robot(arm: sd.Model) -> None:
    law = sd.Impedance(arm, "tool0", np.eye(4), K, D)
    with pytest.raises(sd.ModelError, match="of which the law holds it"):
        sd.simulate(sd.load_urdf("ur10"), Q0, V0, 1e-3, 1e-3, control=law)


def test_the_law_of_a_robot_with_mimic_joints_is_its_line() -> None:
    """Held and moving, of Jacobians J G of joints that lead: seven hinges, of which the last follows the third."""
    b = sd.ModelBuilder("chain")
    for k in range(7):
        solid = (1.0, (0.05, 0.02, 0.1), np.diag([0.03, 0.02, 0.01]))
        axis, at = np.roll([0.0, 0.3, 1.0], k), (0.1, 0.05 * k, 0.2)
        follow = {"leader": "j2", "multiplier": -0.5} if k == 6 else None
        b.add_body(f"b{k}", f"b{k - 1}" if k else None, axis=axis, placement=at, inertia=solid, joint_name=f"j{k}",
                   mimic=follow)  # fmt: skip
    model = b.build(mimic=True)
    target = sd.frame_placement(model, GOAL, "b6")
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    J, M = sd.frame_jacobian(model, Q0, "b6", "local_world_aligned"), sd.crba(model, Q0)
    X = sd.frame_placement(model, Q0, "b6")
    e = np.r_[target[:3, 3] - X[:3, 3], rotation.from_matrix(target[:3, :3] @ X[:3, :3].T).as_rotvec()]
    held = sd.Impedance(model, "b6", target, K, D, joint_damping=0.5)
    wanted = sd.generalized_gravity(model, Q0) + J.T @ (K @ e - D @ (J @ V0)) - 0.5 * V0
    np.testing.assert_allclose(held(model, 0.0, Q0, V0), wanted, rtol=CLOSE, atol=CLOSE)
    rate, a = np.linspace(-0.3, 0.4, 6), np.linspace(0.5, -0.2, 6)
    step = 1e-6
    ahead, back = (sd.frame_jacobian(model, Q0 + x * V0, "b6", "local_world_aligned") for x in (step, -step))
    inverse = np.linalg.inv(M)
    J_bar = inverse @ J.T @ np.linalg.inv(J @ inverse @ J.T)
    v_r = J_bar @ rate
    a_r = J_bar @ (a - (ahead - back) @ v_r / (2.0 * step))
    C = sd.coriolis_matrix(model, Q0, V0)
    F = K @ e + D @ (rate - J @ V0)
    wanted = M @ a_r + C @ v_r + sd.generalized_gravity(model, Q0) + J.T @ F
    moving = sd.Impedance(model, "b6", target, K, D, velocity=rate, acceleration=a)
    np.testing.assert_allclose(moving(model, 0.0, Q0, V0), wanted, rtol=1e-6, atol=1e-6)
