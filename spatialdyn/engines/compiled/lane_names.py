"""The calls that run on lanes, the number of samples per vector, and the names in their kernels' texts."""

from __future__ import annotations

from functools import cache
from typing import Any

from ...bodies.table import BODIES
from ...recursions.spec import Spec
from .numba_settings import PLAIN
from .stamp import names
from .target import target


@cache
def fits(spec: Spec) -> bool:
    """Whether the kernels of a call run on lanes, of one sample or more.

    They do not if the processor has no fused multiply-add, which the polynomials of sines on lanes need.
    """
    return not PLAIN and spec.on_lanes and names(spec) and target().fused


def width() -> int:
    """The number of samples in a vector of this processor."""
    return 8 if target().has("avx512f") else 4 if target().has("avx2") else 2


def known(spec: Spec, width: int) -> dict[str, Any]:
    """The names in a kernel's text that have a meaning on lanes."""
    from . import lane_arrays, lanes
    from .lane_turn import turn_lanes

    kind = lanes.Lanes(width)
    found: dict[str, Any] = {f"lanes{axes}": lane_arrays.array_of(kind, axes) for axes in (1, 2, 3)}
    if spec.work is not None:
        found["works"] = lane_arrays.array_of(lane_arrays.record(spec.work, width), 1)
    of_width = ("fill", "drain", "lower", "mirror")
    found |= {name: getattr(lane_arrays, name)(width) for name in of_width}
    found["tables"] = lane_arrays.array_of(lane_arrays.record(BODIES, width), 1)
    return found | {"lanes_of": lane_arrays.lanes_of, "aligned": lane_arrays.aligned, "turn_lanes": turn_lanes}
