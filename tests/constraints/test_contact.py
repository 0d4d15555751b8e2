"""Constrained dynamics and impacts: by hand, by what they solve, and at the limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dense import Array
from trees import random_state, random_tree

import spatialdyn as sd

EPS = np.finfo(float).eps
CLOSE = 1e5 * EPS  # of the largest number: M and the constraints' matrix have condition numbers of some 1e3 each
ROWS = 5


def case(seed: int, floating: bool) -> tuple[Any, Any, Array, Array]:
    """Model, state, a Jacobian (ROWS, nv) and drift."""
    made = random_tree(seed, 6, floating=floating)
    rng = np.random.default_rng(seed)
    return made.model, random_state(made.tree, rng), rng.normal(size=(ROWS, made.model.nv)), rng.normal(size=ROWS)


def close(x: Any, y: Any, scale: float = 1.0) -> None:
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= CLOSE * max(scale, abs(y).max(initial=0.0))


# --- by hand --------------------------------------------------------------------------------------------


def test_a_held_pendulum_hangs_on_its_constraint() -> None:
    """Two masses on one slider each, held together: both fall as one, and the force is what one lacks."""
    builder = sd.ModelBuilder("pair")
    for name, mass in (("a", 1.0), ("b", 3.0)):
        builder.add_body(name, None, "prismatic", (0, 0, 1), (0, 0, 0), (mass, (0, 0, 0), np.eye(3)))
    model = builder.build()
    a, force = sd.constrained_dynamics(model, [0, 0], [0, 0], [8.0, 0.0], [[1.0, -1.0]], [0.0])
    close(a, [2.0 - 9.81, 2.0 - 9.81])
    close(force, [-6.0])
    v, impulse = sd.impact(model, [0, 0], [4.0, 0.0], [[1.0, -1.0]])
    close(v, [1.0, 1.0])
    close(impulse, [-3.0])
    close(sd.impact(model, [0, 0], [4.0, 0.0], [[1.0, -1.0]], restitution=1.0).v, [-2.0, 2.0])


# --- identities -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize(("seed", "floating"), [(0, True), (1, False), (2, True)])
def test_it_solves_what_it_says(seed: int, floating: bool, damping: float) -> None:
    model, s, J, drift = case(seed, floating)
    a, force = sd.constrained_dynamics(model, s.q, s.v, s.tau, J, drift, damping)
    scale = abs(J.T @ force).max()
    close(sd.rnea(model, s.q, s.v, a), s.tau + J.T @ force, scale)
    close(J @ a + drift, -damping * force, abs(a).max())


def test_a_foot_at_rest_stays_at_rest() -> None:
    """With drift J̇ v the foot's acceleration is zero, and the force is that of the free robot pushed there by fext."""
    made = random_tree(4, 7, ("revolute", "spherical"), floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(4))
    foot, at = model.frames[-1], "local_world_aligned"
    J = sd.frame_jacobian(model, s.q, foot, at)[:3]
    drift = sd.jacobian_dot_times_v(model, s.q, s.v, foot, at)[:3]
    a, force = sd.constrained_dynamics(model, s.q, s.v, s.tau, J, drift)
    found = sd.frame_acceleration(model, s.q, s.v, a, foot, at, classical=True)[:3]
    close(found, np.zeros(3), abs(a).max())
    push = sd.wrench_at(model, s.q, foot, np.r_[force, np.zeros(3)], reference=at)
    close(sd.aba(model, s.q, s.v, s.tau, push), a)


def test_an_impact_never_gains_energy_and_an_elastic_one_keeps_it() -> None:
    model, s, J, _ = case(0, True)
    before = sd.kinetic_energy(model, s.q, s.v)
    energies = [sd.kinetic_energy(model, s.q, sd.impact(model, s.q, s.v, J, e).v) for e in (0.0, 0.5, 1.0)]
    assert energies[0] < energies[1] < energies[2]
    close(energies[2], before)
    v, impulse = sd.impact(model, s.q, s.v, J, 0.25)
    close(J @ v, -0.25 * J @ s.v)
    close(sd.crba(model, s.q) @ (v - s.v), J.T @ impulse)


def test_batches_broadcast_and_equal_single_samples() -> None:
    model, s, J, drift = case(1, True)
    rng = np.random.default_rng(0)
    taus, drifts = rng.normal(size=(3, 1, model.nv)), rng.normal(size=(2, ROWS))
    a, force = sd.constrained_dynamics(model, s.q, s.v, taus, J, drifts)
    assert (a.shape, force.shape) == ((3, 2, model.nv), (3, 2, ROWS))
    one = sd.constrained_dynamics(model, s.q, s.v, taus[2, 0], J, drifts[1])
    np.testing.assert_array_equal(a[2, 1], one.a)
    np.testing.assert_array_equal(force[2, 1], one.force)
    none = sd.constrained_dynamics(model, s.q, s.v, taus[:0], J, drift)
    assert (none.a.shape, none.force.shape) == ((0, 1, model.nv), (0, 1, ROWS))


# --- dependent constraints ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_dependent_rows_are_counted_whatever_their_units(seed: int) -> None:
    model, s, J, drift = case(seed, True)
    rng = np.random.default_rng(seed)
    mixed = np.vstack([J, rng.normal(size=(3, ROWS)) @ J]) * 10.0 ** rng.uniform(-6, 6, size=(ROWS + 3, 1))
    drift = np.r_[drift, np.zeros(3)]
    with pytest.raises(sd.ConstraintError, match=f"rank {ROWS}, expected its {ROWS + 3} rows"):
        sd.constrained_dynamics(model, s.q, s.v, s.tau, mixed, drift)


def test_damping_makes_dependent_rows_share_the_force() -> None:
    model, s, J, drift = case(0, True)
    one = sd.constrained_dynamics(model, s.q, s.v, s.tau, J, drift)
    twice = sd.constrained_dynamics(model, s.q, s.v, s.tau, np.vstack([J, J]), np.r_[drift, drift], 1e-9)
    assert abs(twice.a - one.a).max() <= 1e-5 * abs(one.a).max()  # the damping's part
    assert abs(twice.force[:ROWS] + twice.force[ROWS:] - one.force).max() <= 1e-5 * abs(one.force).max()


def test_more_rows_than_freedoms_cannot_be_independent() -> None:
    model = random_tree(1, 1, ("revolute",)).model
    with pytest.raises(sd.ConstraintError, match="rank 1, expected its 2 rows"):
        sd.constrained_dynamics(model, [0.1], [0.2], [0.3], [[1.0], [2.0]], [0.0, 0.0])


def test_a_bad_sample_is_named() -> None:
    model, s, J, drift = case(0, True)
    Js = np.stack([J, J])
    Js[1, 1] = Js[1, 0]
    with pytest.raises(sd.ConstraintError, match=r"sample \(1,\): J has rank 4"):
        sd.constrained_dynamics(model, s.q, s.v, s.tau, Js, drift)


# --- limits ---------------------------------------------------------------------------------------------


def test_no_constraint_is_forward_dynamics() -> None:
    model, s, J, drift = case(2, True)
    a, force = sd.constrained_dynamics(model, s.q, s.v, s.tau, J[:0], drift[:0])
    close(a, sd.aba(model, s.q, s.v, s.tau))
    assert force.shape == (0,)


def test_wrong_shapes_and_numbers_are_named() -> None:
    model, s, J, drift = case(0, False)
    for bad, what in (
        ((s.tau, J[:, :-1], drift), "J has shape"),
        ((s.tau, J, drift[:-1]), "drift has shape"),
        ((s.tau, J[0], drift), "J has shape"),
    ):
        with pytest.raises(sd.ShapeError, match=what):
            sd.constrained_dynamics(model, s.q, s.v, *bad)
    with pytest.raises(sd.SpatialDynError, match="damping is -1"):
        sd.constrained_dynamics(model, s.q, s.v, s.tau, J, drift, -1)
    for e in (-0.1, 1.5, float("nan")):
        with pytest.raises(sd.ConstraintError, match="restitution is"):
            sd.impact(model, s.q, s.v, J, e)
    with pytest.raises(sd.ShapeError, match="v has shape"):
        sd.impact(model, s.q, s.v[:-1], J)


def test_a_joint_of_zero_articulated_inertia_is_named() -> None:
    builder = sd.ModelBuilder("arm")
    builder.add_body("a", None, "revolute", (0, 0, 1), (0, 0, 0), (1.0, (0, 0, 0), np.eye(3)))
    builder.add_body("b", "a", "revolute", (0, 0, 1), joint_name="hinge")
    model = builder.build()
    with pytest.raises(sd.InertiaError, match='"hinge" has zero articulated inertia'):
        sd.constrained_dynamics(model, [0, 0], [0, 0], [0, 0], [[1.0, 0.0]], [0.0])
