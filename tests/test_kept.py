"""Kernels that keep what they were given, and operators on lists."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn import algebra, kept
from spatialdyn.engines import jit
from spatialdyn.engines.jit import OK, SHAPE


@pytest.fixture(scope="module")
def case() -> Any:
    made = random_tree(2, 7, floating=True)
    return made.model, random_state(made.tree, np.random.default_rng(0))


def table(model: sd.Model) -> Any:
    return getattr(model, jit.TABLE)


def test_memory_is_the_result_and_then_the_inputs(case: Any) -> None:
    model, s = case
    tau, memory = np.empty(model.nv), np.empty(model.nq + 3 * model.nv)
    assert kept.kept("rnea")(table(model), s.q, s.v, s.a, tau, memory) == OK
    np.testing.assert_array_equal(tau, sd.rnea(model, s.q, s.v, s.a))
    np.testing.assert_array_equal(memory, np.concatenate([tau, s.q, s.v, s.a]))


def test_matrices_are_kept_row_by_row(case: Any) -> None:
    model, s = case
    M, memory = np.empty((model.nv, model.nv)), np.empty(model.nq + model.nv**2)
    assert kept.kept("crba")(table(model), s.q, M, memory) == OK
    np.testing.assert_array_equal(memory, np.concatenate([M.ravel(), s.q]))


def test_a_result_may_be_in_memory_already_and_more_be_kept(case: Any) -> None:
    model, s = case
    size = 16 * model.njoints
    memory = np.empty(size + model.nq + 2 * model.nv)
    X = memory[:size].reshape(model.njoints, 4, 4)
    assert kept.kept("forward_kinematics", ("v", "a"), False)(table(model), s.q, s.v, s.a, X, memory) == OK
    np.testing.assert_array_equal(X, sd.forward_kinematics(model, s.q))
    np.testing.assert_array_equal(memory[size:], np.concatenate([s.q, s.v, s.a]))


def test_memory_of_another_size_or_a_failure_is_left_alone(case: Any) -> None:
    model, s = case
    tau = np.empty(model.nv)
    for memory in (np.zeros(3), np.zeros(model.nq + 3 * model.nv + 1)):
        assert kept.kept("rnea")(table(model), s.q, s.v, s.a, tau, memory) == SHAPE
        assert not memory.any()
    memory = np.zeros(model.nq + 3 * model.nv)
    assert kept.kept("rnea")(table(model), 2.0 * s.q, s.v, s.a, tau, memory) != OK
    assert not memory.any()


@pytest.mark.skipif(jit.PLAIN, reason="uncompiled kernels take no indices; callers go another way")
def test_frames_are_placed_with_the_joints(case: Any) -> None:
    model, s = case
    frames = [f for f in model.frames if f.joint > 0]
    joints, placements = np.array([f.joint for f in frames]), np.array([f.placement for f in frames])
    size, out = 16 * model.njoints, np.empty((len(frames), 4, 4))
    memory = np.empty(size + model.nq)
    X = memory[:size].reshape(model.njoints, 4, 4)
    assert kept.placing()(table(model), s.q, X, memory, joints, placements, out) == OK
    for frame, found in zip(frames, out, strict=True):
        np.testing.assert_allclose(found, sd.frame_placement(model, s.q, frame), atol=1e-14)


def test_a_listed_operator_is_the_operator_row_by_row() -> None:
    rng = np.random.default_rng(1)
    a, b = np.empty((3, 4, 4)), rng.normal(size=(5, 6))
    for X in a:
        algebra.exp6(rng.normal(size=6), X)
    places, out, one = np.array([2, 0, 0, 1, 2]), np.empty((5, 6)), np.empty(6)
    kept.motions_up(a, places, b, out)
    for k, place in enumerate(places):
        algebra.motion_to_parent(a[place], b[k], one)
        np.testing.assert_array_equal(out[k], one)
