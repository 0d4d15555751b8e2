"""The study of a panda's payloads, against the same samples at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.commands.study import read
from spatialdyn.examples import payload_study


def test_the_second_joint_comes_near_its_limit_and_no_sample_is_above(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pinocchio")
    found = payload_study.main(quick=True)
    assert "joint 2 needs 36% of its motor's torque on average" in capsys.readouterr().out
    model = sd.load_urdf("panda").reduced(["panda_finger_joint1", "panda_finger_joint2"])
    draws = (np.random.default_rng(np.random.SeedSequence(7, spawn_key=(i,))) for i in range(4))
    samples = [payload_study.holding(model, rng, 50_000) for rng in draws]
    part = np.concatenate([x["part"] for x in samples])
    np.testing.assert_allclose(found["mean"].mean, part.mean(0), rtol=1e-10)
    exact = np.quantile(part, payload_study.AT, axis=0, method="inverted_cdf")
    np.testing.assert_allclose(found["part"], exact, rtol=2.0**-11, atol=1e-300)
    assert found["worst"].sample[0] == part.max(-1).argmax()
    assert 0.85 < found["part"][-1, 1] < found["worst"].value[0] < 1.0
    assert (np.delete(found["part"][-1], 1) < 0.6).all()


def test_the_command_takes_the_file(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    made = read(payload_study.__file__, str(tmp_path / "new"))
    assert repr(made) == f"<Study of 10000000 samples in {tmp_path / 'new'}: 0 of 200 chunks done>"
