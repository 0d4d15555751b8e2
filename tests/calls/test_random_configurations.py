"""Configurations that are drawn: their distribution, limits, seeds and shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from trees import every_joint, pendulum

import spatialdyn as sd
from spatialdyn.calls.random_configurations import random_configuration

EPS = np.finfo(float).eps
MANY = 20000  # samples; a mean of that many uniforms on [-1, 1] is off by 0.0041 at one sigma
SIX_SIGMA = 6.0 / math.sqrt(3.0 * MANY)


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
