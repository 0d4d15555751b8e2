"""What waits for ``python -m pytest -m slow``: tests that take long and whose claim a quick test holds in small.

``@pytest.mark.slow(quick="test_x")`` names that test, of the same file or of ``folder/test_y.py::test_x``;
``slow_but`` runs some parameters of a test at once and leaves the others, ``thinned`` leaves most of them out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def slow_but(quick: Collection[Any], values: Iterable[Any]) -> list[Any]:
    """The values, tuples of several parameters too, marked slow but for the quick ones; of both there are some."""
    values = list(values)
    marked = [
        pytest.param(*(v if isinstance(v, tuple) else (v,)), marks=[] if v in quick else pytest.mark.slow)
        for v in values
    ]
    assert not values or 0 < sum(not x.marks for x in marked) < len(marked), quick
    return marked


def thinned(keep: Collection[Any], values: Iterable[Any], at: int, every: int = 3) -> list[Any]:
    """The values to keep, and one in ``every`` of the others, from place ``at`` on.

    For tests that judge what all values go through alike: several tests of one list take another part of it each.
    """
    values = list(values)
    others = [v for v in values if v not in keep]
    chosen = {id(v) for v in others[at % every :: every]}
    return [v for v in values if v in keep or id(v) in chosen]
