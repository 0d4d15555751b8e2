"""Masked arrays are refused, as in the library: their mask would be lost."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as pin


def test_masked_arrays_are_refused_by_name_each_time() -> None:
    model = pin.buildSampleModelManipulator()
    data, q = model.createData(), np.zeros(model.nq)
    masked = np.ma.masked_array(q, np.ones(model.nq))
    for _ in range(2):
        for call in (lambda: pin.rnea(model, data, masked, q, q), lambda: pin.crba(model, data, masked)):
            with pytest.raises(TypeError, match="q is masked"):
                call()
        pin.rnea(model, data, q, q, q)
