"""Forces at frames by hand and against Jacobians."""

from __future__ import annotations

import math

import numpy as np
import pytest
from trees import pendulum, random_tree

import spatialdyn as sd
from spatialdyn.calls.random_configurations import random_configuration
from spatialdyn.calls.wrenches import wrench_at

IDENTITY = 1e-12  # relative to the largest entry: sums of a few dozen products in trees of ten bodies
REFERENCES = ("local", "world", "local_world_aligned")


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
