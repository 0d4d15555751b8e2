"""cos and sin of a tile of configurations, on lanes: see ``sines``."""

from __future__ import annotations

from typing import Any

from ...algebra.scalars import inline
from .lanes import turned as turned_lanes


@inline
def turn_lanes(q: Any, turned: Any) -> bool:
    """Write q, cos q and sin q (3, nq); returns whether all angles are in the range of the polynomials."""
    within = True
    for k in range(len(q)):
        x = q[k]
        c, s, beyond = turned_lanes(x)
        turned[0, k] = x
        turned[1, k] = c
        turned[2, k] = s
        within = within and not beyond
    return within
