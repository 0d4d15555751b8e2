"""Logs of other simulators: friction, encoders, a delay and noise, from which an arm is found that predicts another."""

from __future__ import annotations

import logs
import numpy as np
import pytest
from example_runs import compiled, robots

import spatialdyn as sd


@robots
@compiled
@pytest.mark.parametrize("by", ["mujoco", "pinocchio"])
def test_an_arm_is_found_from_another_simulators_log(by: str) -> None:
    """Its torques of another motion are off by the noise, all bodies exist, the delay is within half a millisecond."""
    pytest.importorskip(by)
    make = {"mujoco": logs.mujoco_log, "pinocchio": logs.pinocchio_log}[by]
    one, other = make(0), make(1)
    wrong = sd.inertial_parameters(logs.arm()) * np.random.default_rng(0).uniform(0.7, 1.3, (7, 1))
    start = logs.arm().with_(inertial_parameters=wrong)
    found = sd.identify(one.log, start, "log_cholesky", hold="after", delay=True, cutoff=20.0, v_min=0.05)
    judged = found.validate(other.log)
    assert (judged.rms < 1.1 * logs.NOISE).all()
    assert all(values[0] > 0.0 for values in found.eigenvalues.values())
    assert found.delay == pytest.approx(one.delay, abs=5e-4)  # a semi-implicit step moves by a quarter of one
    assert found.friction is not None
    np.testing.assert_allclose(found.friction.coulomb, one.friction.coulomb, rtol=0.1)
    truth = found.base.K @ np.concatenate(
        [np.ravel(sd.inertial_parameters(logs.arm())[1:]), one.friction.viscous, one.friction.coulomb]
    )
    assert np.mean(abs(found.beta - truth) < found.half_width) > 0.85
