"""Estimate of the length of a closed form from numerical values: the Fourier terms of M or g over the angles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..bodies import kinds
from ..calls.dynamics import calls
from ..calls.random_configurations import random_configuration
from ..model.model import Model

STATES = 100_000  # limit of states on the grid
SLICE = 4096  # states at a time
CALLS = {"g": ("generalized_gravity", 1), "V": ("potential_energy", 1)}  # call, and degree in each angle; otherwise M
NOISE = 1e-12  # relative to the largest amplitude: smaller ones are rounding


def fourier_terms(model: Model, quantity: str) -> int:
    """Number of Fourier terms, in the joints' angles, of g or V, or for other quantities of M, which they contain.

    The terms are counted in the entries of the chain with the most angles, on a grid over as many of its last angles as
    STATES allows, with all other joints in a random state. A closed form has hardly fewer terms.
    """
    name, degree = CALLS.get(quantity, ("crba", 2))
    points = 2 * degree + 1
    rows = model.bodies
    chains: list[list[int]] = [[]]
    for k in range(1, len(rows)):
        chains.append([*chains[rows[k]["parent"]], k])
    turns = [[k for k in chain if kinds.KINDS[rows[k]["kind"]].angle is not None] for chain in chains]
    turning, chain = max(zip(turns, chains, strict=True), key=lambda both: len(both[0]))
    angles = [int(rows[k]["q_index"]) for k in turning[-int(math.log(STATES, points)) :]]
    grid = np.indices((points,) * len(angles)).reshape(len(angles), points ** len(angles)) * (2.0 * np.pi / points)
    q = np.tile(random_configuration(model, np.random.default_rng(0)), (grid.shape[1], 1))
    q[:, angles] = grid.T
    entries: tuple[Any, ...] = np.ix_(*[np.array(chain, int) - 1] * {"V": 0, "g": 1}.get(quantity, 2))
    kept = []
    for first in range(0, len(q), SLICE):
        results = np.asarray(calls[name](model, q[first : first + SLICE]))
        kept.append(results[(slice(None), *entries)].reshape(len(results), -1))
    total = 0
    for column in np.concatenate(kept).T:
        amplitude = abs(np.fft.fftn(column.reshape((points,) * len(angles)))) if angles else abs(column)
        total += int((amplitude > max(NOISE * amplitude.max(initial=0.0), len(q) * NOISE)).sum())
    return total
