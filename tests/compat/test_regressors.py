"""Regressors: Pinocchio's numbers in Pinocchio's shapes, on robots from URDF and on built ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as face
from spatialdyn.urdf.load import find_robot

pin = pytest.importorskip("pinocchio")

BOUND = 1e-11  # scaled, the bound of all of compat
ROBOTS = [("panda", False), ("solo12", True), ("two_link", False)]


@pytest.fixture(params=ROBOTS, ids=lambda p: p[0], scope="module")
def pair(request: pytest.FixtureRequest) -> tuple[Any, Any, Any, Any]:
    """Our model and data, Pinocchio's model and data."""
    name, floating = request.param
    path = str(find_robot(name))
    made = []
    for module in (face, pin):
        model = module.buildModelFromUrdf(path, *([module.JointModelFreeFlyer()] if floating else []))
        made += [model, model.createData()]
    return tuple(made)  # type: ignore[return-value]


def state(model: Any, seed: int = 0) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    v, a = rng.normal(size=(2, model.nv))
    return pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)), v, a


def close(x: Any, y: Any) -> None:
    assert x.shape == y.shape
    assert x.flags.c_contiguous
    assert abs(x - y).max(initial=0.0) <= BOUND * max(1.0, abs(y).max(initial=0.0))


CALLS = {
    "computeJointTorqueRegressor": (3, "jointTorqueRegressor"),
    "computeStaticRegressor": (1, "staticRegressor"),
    "computeKineticEnergyRegressor": (2, "kineticEnergyRegressor"),
    "computePotentialEnergyRegressor": (1, "potentialEnergyRegressor"),
}


@pytest.mark.parametrize("name", CALLS)
def test_regressors_are_pinocchios(pair: tuple[Any, Any, Any, Any], name: str) -> None:
    ours, data, theirs, their_data = pair
    count, field = CALLS[name]
    given = state(theirs)[:count]
    found = getattr(face, name)(ours, data, *given)
    close(found, getattr(pin, name)(theirs, their_data, *given))
    np.testing.assert_array_equal(getattr(data, field), found)
    found[...] = 0.0  # a copy, as in Pinocchio
    assert getattr(data, field).any()


@pytest.mark.parametrize("name", CALLS)
def test_wrong_sizes_and_lists_raise_pinocchios_classes(pair: tuple[Any, Any, Any, Any], name: str) -> None:
    ours, data, theirs, _ = pair
    given = list(state(theirs)[: CALLS[name][0]])
    for k, value in enumerate(given):
        with pytest.raises(ValueError, match="shape"):
            getattr(face, name)(ours, data, *given[:k], np.append(value, 1.0), *given[k + 1 :])
        with pytest.raises(TypeError, match="list"):
            getattr(face, name)(ours, data, *given[:k], value.tolist(), *given[k + 1 :])


def test_columns_are_taken(pair: tuple[Any, Any, Any, Any]) -> None:
    ours, data, theirs, _ = pair
    q, v, a = state(theirs)
    column = face.computeJointTorqueRegressor(ours, data, q[:, None], v[:, None], a)
    np.testing.assert_array_equal(column, face.computeJointTorqueRegressor(ours, data, q, v, a))


def test_body_regressors_are_pinocchios(pair: tuple[Any, Any, Any, Any]) -> None:
    ours, data, theirs, their_data = pair
    given = state(theirs, 1)
    face.rnea(ours, data, *given)
    pin.rnea(theirs, their_data, *given)
    for k in range(1, theirs.njoints):
        close(face.jointBodyRegressor(ours, data, k), pin.jointBodyRegressor(theirs, their_data, k))
    for k in range(theirs.nframes):
        name, kind = theirs.frames[k].name, theirs.frames[k].type
        if theirs.frames[k].parentJoint:  # of frames on the universe Pinocchio reads a_gf[0], which rnea does not write
            at = ours.getFrameId(name, face.FrameType.values[int(kind)])
            close(face.frameBodyRegressor(ours, data, at), pin.frameBodyRegressor(theirs, their_data, k))
    v, a = np.arange(6.0), np.arange(6.0) ** 2 - 3.0
    close(face.bodyRegressor(face.Motion(v), face.Motion(a)), pin.bodyRegressor(pin.Motion(v), pin.Motion(a)))
    with pytest.raises(TypeError):
        face.bodyRegressor(v, a)
    for call, n in ((face.jointBodyRegressor, ours.njoints), (face.frameBodyRegressor, ours.nframes)):
        with pytest.raises(ValueError, match="expected 0 to"):
            call(ours, data, n)


def test_identification_finds_the_parameters_that_made_the_torques(pair: tuple[Any, Any, Any, Any]) -> None:
    """τ of many states, less the armatures', is Y π."""
    ours, data, theirs, _ = pair
    pi = np.concatenate([inertia.toDynamicParameters() for inertia in list(ours.inertias)[1:]])
    for seed in range(3):
        q, v, a = state(theirs, seed)
        tau = face.rnea(ours, data, q, v, a) - ours.armature * a
        found = face.computeJointTorqueRegressor(ours, data, q, v, a) @ pi
        assert abs(found - tau).max() <= BOUND * max(1.0, abs(tau).max())


def test_a_composite_joint_has_one_bodys_columns() -> None:
    made = []
    for module in (face, pin):
        composite = module.JointModelComposite()
        composite.addJoint(module.JointModelRX())
        composite.addJoint(module.JointModelPY())
        model = module.Model()
        joint = model.addJoint(0, composite, module.SE3.Identity(), "two")
        inertia = module.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.2, 0.3, 0.4]))
        model.appendBodyToJoint(joint, inertia, module.SE3.Identity())
        x = np.array([0.3, -0.4])
        made.append(module.computeJointTorqueRegressor(model, model.createData(), x, 2.0 * x, 3.0 * x))
    close(made[0], made[1])
    assert made[0].shape == (2, 10)
