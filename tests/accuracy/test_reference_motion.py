"""Reference motions against closed forms, conserved quantities, other integrators, and half the step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.accuracy import reference_motion
from spatialdyn.accuracy.reference_motion import GOAL, exact_motion
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.numbers.collocation import STAGES, tableau
from spatialdyn.errors import SimulationError

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: an interpreter in Python")
EPS = float(np.finfo(float).eps)
ROUNDED = 8 * EPS  # both sides are rounded to float64
KEPT = 64 * EPS  # energies of a few bodies, added up in float64
FOLLOWED = 1e-11  # gauss6 at dt 1e-3 in float64, over half a second


@pytest.mark.slow(quick="test_weights_integrate_polynomials_to_the_last_digit_of_a_pair")
def test_a_body_that_falls_falls_as_galileo_says() -> None:
    builder = sd.ModelBuilder("slide")
    builder.add_body("stone", None, "prismatic", (0, 0, 1), None, (2.0, (0.0, 0.0, 0.0), np.eye(3)))
    t = np.linspace(0.0, 3.0, 4)
    motion = exact_motion(builder.build(), np.array([[1.0]]), np.array([[2.0]]), t)
    assert abs(motion.q[:, 0, 0] - (1.0 + 2.0 * t - 0.5 * 9.81 * t**2)).max() <= ROUNDED * 60.0
    assert abs(motion.v[:, 0, 0] - (2.0 - 9.81 * t)).max() <= ROUNDED * 30.0
    assert motion.error.max() <= GOAL


def test_weights_integrate_polynomials_to_the_last_digit_of_a_pair() -> None:
    """A step's weights sum to 1 and a stage's to its node; Σ b c^k = 1/(k + 1) up to the order of the method."""
    A = tableau().astype(np.longdouble).sum(axis=2)
    c, b = A[:STAGES].sum(axis=1), A[STAGES]
    for k in range(2 * STAGES):
        assert abs(b @ c**k - np.longdouble(1) / (k + 1)) < 1e-17
    assert abs(A[:STAGES] @ c**5 - c**6 / 6).max() < 1e-17


@pytest.mark.slow(quick="test_weights_integrate_polynomials_to_the_last_digit_of_a_pair")
@pytest.mark.parametrize(("seed", "options"), [(0, {}), (1, {"floating": True, "continuous": "cos_sin"})])
def test_energy_and_unit_norms_are_kept_to_rounding(seed: int, options: dict[str, Any]) -> None:
    tree = random_tree(seed, 4, **options)
    model, state = tree.model, random_state(tree.tree, np.random.default_rng(seed))
    motion = exact_motion(model, state.q[None], state.v[None], np.linspace(0.0, 0.4, 5))
    q, v = motion.q[:, 0], motion.v[:, 0]
    kinetic, potential = (np.asarray(x) for x in (sd.kinetic_energy(model, q, v), sd.potential_energy(model, q)))
    assert abs(np.diff(kinetic + potential)).max() <= KEPT * (abs(kinetic) + abs(potential)).max()
    assert abs(sd.normalize(model, q) - q).max() <= ROUNDED


@pytest.mark.slow(quick="test_weights_integrate_polynomials_to_the_last_digit_of_a_pair")
def test_several_motions_at_once_are_the_same_as_one_by_one() -> None:
    model = sd.load_urdf("two_link")
    q0, v0 = np.random.default_rng(4).normal(size=(2, 6, 2))  # more stages in all than are worked on at once
    t = np.linspace(0.0, 0.5, 3)
    whole = exact_motion(model, q0, v0, t)
    for k in range(len(q0)):
        one = exact_motion(model, q0[k : k + 1], v0[k : k + 1], t)
        assert abs(one.q[:, 0] - whole.q[:, k]).max() <= ROUNDED * abs(one.q).max()


@pytest.mark.slow(quick="test_weights_integrate_polynomials_to_the_last_digit_of_a_pair")
def test_gauss6_follows_it_to_what_float64_can() -> None:
    model = sd.load_urdf("two_link")
    motion = exact_motion(model, np.array([[0.6, 1.0]]), np.zeros((1, 2)), np.array([0.0, 0.5]))
    run = sd.simulate(model, [0.6, 1.0], [0.0, 0.0], 0.5, 1e-3, "gauss6")
    assert abs(run.q[-1] - motion.q[-1, 0]).max() <= FOLLOWED
    assert abs(run.v[-1] - motion.v[-1, 0]).max() <= FOLLOWED


@pytest.mark.slow(quick="test_weights_integrate_polynomials_to_the_last_digit_of_a_pair")
def test_its_error_is_what_a_run_with_fewer_steps_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of a chaotic motion after two runs is large, not hidden."""
    monkeypatch.setattr(reference_motion, "HALVINGS", 1)
    model = sd.load_urdf("two_link")
    lost = exact_motion(model, np.array([[0.6, 1.0]]), np.zeros((1, 2)), np.array([0.0, 2.0]), steps=8)
    monkeypatch.undo()
    found = exact_motion(model, np.array([[0.6, 1.0]]), np.zeros((1, 2)), np.array([0.0, 2.0]))
    assert found.error.max() <= GOAL < lost.error.max()
    assert abs(lost.q - found.q).max() <= lost.error.max() * abs(found.q - found.q[0]).max()


@pytest.mark.slow(quick="test_weights_integrate_polynomials_to_the_last_digit_of_a_pair")
def test_a_motion_that_does_not_settle_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference_motion, "HALVINGS", 0)
    with pytest.raises(SimulationError, match="does not settle"):
        exact_motion(sd.load_urdf("two_link"), np.zeros((1, 2)), np.full((1, 2), 50.0), np.array([0.0, 9.0]))
