"""The Fourier terms of M and g, by hand for arms in a plane, and no fewer than a closed form has."""

from __future__ import annotations

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd
from spatialdyn.lagrangian import size
from spatialdyn.lagrangian.size import fourier_terms


@pytest.mark.parametrize(
    ("robot", "quantity", "terms"),
    [
        ("pendulum", "M", 1),  # a constant
        ("pendulum", "g", 2),  # exp(iq) and exp(-iq)
        ("two_link", "M", 10),  # 3 + 2 cos q2, twice 1 + cos q2, 1
        ("two_link", "C", 10),  # judged by M
        ("two_link", "g", 6),  # of q1 and q1 + q2, and of q1 + q2
        ("two_link", "V", 4),
        ("floating_body", "M", 0),
    ],
)
def test_terms_by_hand(robot: str, quantity: str, terms: int) -> None:
    assert fourier_terms(sd.load_urdf(robot), quantity) == terms


def test_the_longest_chain_counts_and_slices_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of joints beside it, and of its first ones where the grid is too large, one random position."""
    model = sd.load_urdf("tree")
    whole = fourier_terms(model, "M")
    monkeypatch.setattr(size, "SLICE", 7)
    assert fourier_terms(model, "M") == whole
    monkeypatch.setattr(size, "STATES", 25)
    assert 0 < fourier_terms(model, "M") < whole


def test_terms_grow_with_joints_about_different_axes() -> None:
    counts = [fourier_terms(random_tree(3, n, ["revolute"], branching=0.0).model, "M") for n in (2, 3, 4)]
    assert counts[0] < counts[1] < counts[2]
    assert np.diff(np.log(counts)).min() > np.log(2.0)
