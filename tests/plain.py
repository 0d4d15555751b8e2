"""Recursions in plain Python, without a kernel or a program: states to call them on, and a comparison to roundoff."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines import mimic_batches
from spatialdyn.engines.compiled import numba_kernels, tiers
from spatialdyn.engines.programs.record.mimic_rows import evaluate, rows_of
from spatialdyn.engines.programs.record.tracer import table
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import shape_in, sizes_of

Array = np.ndarray
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: minutes of plain Python")
EXACT = 1e-13  # relative: roundoff of a few bodies


def mimics_in_plain_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calls of models with mimic joints without a program run in plain Python, as they do if no table kernel fits.

    ``test_mimic_batches`` holds the compiled ones to these; the kernels of 45 calls take half a minute to compile.
    """
    monkeypatch.setattr(mimic_batches, "fits", lambda spec: False)


def states(model: sd.Model, seed: int = 0, count: int = 1) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    q = sd.random_configuration(model, rng, count)
    return {"q": q, **{name: rng.normal(size=(count, model.nv)) for name in ("v", "a", "tau", "p", "v_r", "a_r")}}


def plainly(model: sd.Model, name: str, x: dict[str, Array], k: int = 0) -> Array:
    """The recursion in plain Python; joint forces are left out."""
    spec, rows = SPECS[name], rows_of(table(model.bodies))
    inputs = {i.name: x[i.name][k] for i in spec.present if i.name in x}
    if "fext" in {i.name for i in spec.present if not i.optional}:
        inputs["fext"] = np.zeros((model.njoints, 6))
    sizes = sizes_of(rows)
    made = evaluate(spec, rows, shape_in(spec.output.shape, sizes), inputs, np.zeros(sizes["nv"], object))
    return made.astype(float).reshape(shape_in(spec.output.shape, sizes))


def by_table(model: sd.Model, name: str, given: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """A sample by the table kernel in plain Python: of the compiled one's bits, and without the seconds to compile it.

    given  the call's inputs, as ``inputs.kernel_inputs`` has them; optional ones are left out
    shape  of the result
    """
    spec, out = numba_kernels.variant(SPECS[name], ()), np.empty(shape or (1,))
    with np.errstate(all="ignore"):
        tiers.TableKernel(spec).plain(model.address, *given, out)
    return out.reshape(shape)


def close(one: Any, other: Any, tolerance: float = EXACT) -> None:
    one, other = np.asarray(one, float), np.asarray(other, float)
    assert one.shape == other.shape
    np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance * max(abs(other).max(), 1e-300))
