"""The kernels of the table of bodies whose bits builtins have: no product and sum is fused."""

from __future__ import annotations

from typing import Any

import numpy as np

from spatialdyn.calls.arguments import core_shape
from spatialdyn.engines.compiled.numba_kernels import OK, variant
from spatialdyn.engines.compiled.tiers import table_kernel
from spatialdyn.recursions import SPECS


def unfused(name: str, model: Any, *values: Any) -> Any:
    """A call of one sample, its optional inputs last."""
    spec = SPECS[name]
    required = sum(not x.optional for x in spec.present)
    spec = variant(spec, frozenset(["fext"] if len(values) > required else []))
    out = np.empty(core_shape(model, spec.output) or 1)
    assert table_kernel(spec)(model.address, *values, out) == OK
    return out
