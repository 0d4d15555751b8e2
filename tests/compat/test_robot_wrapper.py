"""RobotWrapper: every method gives what Pinocchio's gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn.urdf.load import find_robot

from .calls import BOUND
from .test_matrix import scaled

theirs = pytest.importorskip("pinocchio")

METHODS = """
com(q)  com(q, v)  com(q, v, a)  vcom(q, v)  acom(q, v, a)  Jcom(q)  centroidalMomentum(q, v)  centroidalMap(q)
centroidal(q, v)  centroidalMomentumVariation(q, v, a)  mass(q)  nle(q, v)  gravity(q)  forwardKinematics(q)
forwardKinematics(q, v, a)  com()  placement(q, 3)  placement(q, 3, False)  velocity(q, v, 3)
velocity(q, v, 3, True, pin.WORLD)  velocity(q, v, 3, False, pin.LOCAL_WORLD_ALIGNED)  acceleration(q, v, a, 4)
classicalAcceleration(q, v, a, 4)  framePlacement(q, 9)  framePlacement(q, 9, False)  frameVelocity(q, v, 9)
frameVelocity(q, v, 9, reference_frame=pin.WORLD)  frameAcceleration(q, v, a, 9)
frameClassicalAcceleration(q, v, a, 9, False, pin.LOCAL_WORLD_ALIGNED)  computeJointJacobian(q, 4)
computeJointJacobians(q)  getJointJacobian(4)  getJointJacobian(4, pin.WORLD)  framesForwardKinematics(q)
getFrameJacobian(9)  getFrameJacobian(9, pin.LOCAL_WORLD_ALIGNED)  computeFrameJacobian(q, 9)  index("FL_KFE")
q0  v0  nq  nv  data.oMf[7]  model.nframes
"""


def robot(pin: Any, **named: Any) -> Any:
    path = find_robot("solo12")
    return pin.RobotWrapper.BuildFromURDF(str(path), [str(path.parents[4])], pin.JointModelFreeFlyer(), **named)


def test_every_method_gives_what_the_wheels_gives() -> None:
    rng = np.random.default_rng(5)
    left, right = robot(ours), robot(theirs)
    q = ours.integrate(left.model, left.q0, rng.normal(size=left.nv))
    v, a = rng.normal(size=(2, left.nv))
    for line in METHODS.strip().split("\n"):
        for text in line.split("  "):
            found, expected = (
                eval(f"robot.{text}", {"robot": wrapper, "pin": pin, "q": q, "v": v, "a": a})
                for pin, wrapper in ((ours, left), (theirs, right))
            )
            if isinstance(expected, tuple):
                errors = [scaled(x, y) for x, y in zip(found, expected, strict=True)]
            else:
                errors = [scaled(found, expected)]
            assert max(errors) <= BOUND, text


def test_a_reduced_robot_is_that_of_the_wheel() -> None:
    left, right = robot(ours), robot(theirs)
    lock = ["FL_KFE", 7]
    found, expected = left.buildReducedRobot(lock, left.q0), right.buildReducedRobot(lock, right.q0)
    assert list(found.model.names) == list(expected.model.names)
    assert scaled(found.mass(found.q0), expected.mass(expected.q0)) <= BOUND


def test_data_are_made_anew_after_the_model_has_grown() -> None:
    wrapper = robot(ours)
    wrapper.model.addFrame(ours.Frame("tool", 3, 0, ours.SE3.Identity(), ours.FrameType.OP_FRAME))
    wrapper.rebuildData()
    assert len(wrapper.data.oMf) == wrapper.model.nframes
    assert (
        scaled(wrapper.framePlacement(wrapper.q0, wrapper.model.nframes - 1), wrapper.placement(wrapper.q0, 3)) == 0.0
    )


def test_what_is_out_of_scope_says_so() -> None:
    for call in (ours.RobotWrapper().initFromSDF, ours.RobotWrapper.BuildFromSDF):
        with pytest.raises(NotImplementedError, match=r"FromSDF .*SDF is not read, BuildFromURDF or BuildFromMJCF"):
            call("robot.sdf")


def test_a_centre_of_mass_without_a_configuration_needs_one_before() -> None:
    wrapper = robot(ours)
    with pytest.raises(RuntimeError, match="expected forwardKinematics to be called before"):
        wrapper.com()
    wrapper.forwardKinematics(wrapper.q0)
    assert (wrapper.com() == robot(ours).com(wrapper.q0)).all()
