"""Rows whose squares are inertias: those of one body, and what a reflection leaves as it was."""

from __future__ import annotations

import numpy as np
import pytest
from dense import Array, crf, spatial_inertia
from trees import random_inertia

from spatialdyn.algebra.euclidean import Sym, Vec
from spatialdyn.algebra.spatial import Inertia, Motion
from spatialdyn.recursions.tree.aba_square_root import ROWS
from spatialdyn.recursions.tree.square_root_inertia import body_rows
from spatialdyn.recursions.tree.square_root_rows import reflect, triangular

CLOSE = 64 * np.finfo(float).eps  # of the largest entry: sums of a dozen products
SEEDS = range(6)
ALL = np.ones(6)


def random_body(rng: np.random.Generator) -> tuple[Inertia, Array]:
    """A body, and its matrix (6, 6) about the origin."""
    I = spatial_inertia(*random_inertia(rng))
    return Inertia(I[5, 5], Vec(I[2, 4], I[0, 5], I[1, 3]), Sym(*I[:3, :3][np.triu_indices(3)])), I


def close(found: Array, wanted: Array) -> None:
    assert abs(found - wanted).max() <= CLOSE * abs(wanted).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_of_a_body_are_a_root_of_its_inertia_and_give_its_bias_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body, I = random_body(rng)
    v = rng.normal(size=6)
    stack = np.zeros((ROWS, 8))
    end = body_rows(stack, 0, body, Motion(Vec(*v[:3]), Vec(*v[3:])), ALL)
    R, z = stack[:end, 1:7], stack[:end, 7]
    close(R.T @ R, I)
    close(R.T @ z, crf(v) @ I @ v)
    assert (stack[:, 0] == 0.0).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_triangle_of_six_rows_keeps_all_that_many_say(seed: int) -> None:
    stack = np.random.default_rng(seed).normal(size=(ROWS, 8))
    before = stack[:, 1:].copy()
    end = triangular(stack, 0, ROWS, ALL)
    assert end == 6
    left = stack[:end, 1:]
    close((left.T @ left)[:, :6], (before.T @ before)[:, :6])  # zᵀz is the acceleration's no longer


@pytest.mark.parametrize("seed", SEEDS)
def test_a_reflection_keeps_squares_and_leaves_one_entry_in_its_column(seed: int) -> None:
    stack = np.random.default_rng(seed).normal(size=(ROWS, 8))
    before = stack.copy()
    reflect(stack, 2, ROWS, 0)
    assert (stack[:2] == before[:2]).all()
    assert (stack[3:, 0] == 0.0).all()
    close(stack.T @ stack, before.T @ before)
