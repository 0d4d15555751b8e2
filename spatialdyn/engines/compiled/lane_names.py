"""The calls that run on lanes, the number of samples per vector, and the names in their kernels' texts."""

from __future__ import annotations

from functools import cache
from typing import Any

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

    kind = lanes.Lanes(width)
    found: dict[str, Any] = {f"lanes{axes}": lane_arrays.array_of(kind, axes) for axes in (1, 2, 3)}
    if spec.work is not None:
        found["works"] = lane_arrays.array_of(lane_arrays.record(spec.work, width), 1)
    if width == 1:
        return found | {"lanes_of": lane_arrays.lanes_of}
    from .lane_turn import turn_lanes

    found |= {"fill": lane_arrays.fill(width), "drain": lane_arrays.drain(width), "aligned": lane_arrays.aligned}
    return found | {
        "lower": lane_arrays.lower(width), "mirror": lane_arrays.mirror(width), "turn_lanes": turn_lanes
    }  # fmt: skip
