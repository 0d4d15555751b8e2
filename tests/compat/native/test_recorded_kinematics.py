"""Kinematics at what a call recorded."""

from __future__ import annotations

import numpy as np
import pytest
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.compat.native import recorded_kinematics
from spatialdyn.engines.programs.run import single_call


@pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")
def test_frames_are_placed_with_the_joints() -> None:
    made = random_tree(2, 7, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(0))
    frames = [f for f in model.frames if f.joint > 0]
    joints, placements = np.array([f.joint for f in frames]), np.array([f.placement for f in frames])
    X, out = np.empty((model.njoints, 4, 4)), np.zeros((len(frames), 4, 4))
    places = np.array([x.ctypes.data for x in placements])
    words = {"table": model.address, "nq": model.nq, "njoints": model.njoints, "frames": len(frames)}
    arrays = {"poses": X, "result": out, "joints": joints, "placements": places}
    arrays |= {name: np.zeros(1, np.int64) for name in ("clock", "time")}
    assert recorded_kinematics.place_joints_and_frames.bind(words | arrays, model)(s.q) is True
    for frame, found in zip(frames, out, strict=True):
        np.testing.assert_allclose(found, sd.frame_placement(model, s.q, frame), atol=1e-14)
    first = out.copy()
    out[:] = 0.0
    assert recorded_kinematics.place_frames.bind(words | arrays, model)() is True
    np.testing.assert_array_equal(out, first)
