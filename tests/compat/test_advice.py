"""Advice in messages of this package: what it names is there, and takes what it is advised for."""

from __future__ import annotations

import ast
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import spatialdyn as sd
import spatialdyn.compat.pinocchio as pin
from spatialdyn.compat.pinocchio.coverage import coverage
from spatialdyn.compat.pinocchio.coverage.pinocchio_names import INSTEAD

PACKAGE = Path(pin.__file__).parent


def model_and_state() -> tuple[Any, Any, Any]:
    model = pin.buildModelFromUrdf(str(sd.urdf.load.find_robot("two_link")))
    return model, model.createData(), pin.neutral(model)


def constrained() -> None:
    model, data, q = model_and_state()
    v = np.zeros(model.nv)
    contact = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, 2, pin.SE3.Identity(), pin.LOCAL)
    settings = pin.ProximalSettings(1e-12, 1e-6, 10)
    pin.constraintDynamics(model, data, q, v, v, [contact], [contact.createData()], settings)
    J, drift = np.array([[1.0, -1.0]]), np.zeros(1)
    pin.forwardDynamics(model, data, q, v, v, J, drift, 1e-6)
    pin.impulseDynamics(model, data, q, v, J, 0.0, 1e-6)
    assert callable(sd.Constraints)


def states_of_mujoco() -> None:
    """``from_mujoco`` takes a model of the library and a state, no MjModel: the state comes back."""
    model, q = sd.load_urdf("two_link"), np.array([0.1, 0.2])
    found = sd.from_mujoco(model, *sd.to_mujoco(model, q, q))
    assert all(np.array_equal(x, q) for x in found)
    model_and_state()  # by buildModelFromUrdf


def composite() -> None:
    pin.JointModelComposite(pin.JointModelRX()).addJoint(pin.JointModelRY())


def placed() -> None:
    model, data, q = model_and_state()
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)


def jacobians() -> None:
    model, data, q = model_and_state()
    pin.computeJointJacobians(model, data, q)
    pin.getJointJacobian(model, data, 1, pin.LOCAL)


def archives() -> None:
    model = model_and_state()[0]
    assert pickle.loads(pickle.dumps(model)) == model
    assert all(map(callable, (pin.Model.saveToText, pin.Model.saveToXML, pin.Model.saveToBinary)))


def building() -> None:
    pin.Model().addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "a")
    sd.ModelBuilder("robot")


TAKEN: dict[str, Callable[[], Any]] = {  # the beginning of a piece of advice, and how it is taken
    "other constraints": constrained,
    "several models": states_of_mujoco,
    "a joint that URDF": composite,
    "geometry and collisions": placed,
    "second derivatives": jacobians,
    "one class": lambda: pin.JointData(pin.JointModelRX()),
    "a container of C++": list,
    "archives": archives,
    "a switch": lambda: model_and_state()[1].M,
    "building models": building,
    "internals": lambda: pin.rnea,
    "a foreign module": lambda: np,
    "a detail": lambda: None,
}


def test_every_piece_of_advice_can_be_taken() -> None:
    advice = [text for _, text in INSTEAD]
    assert [sum(text.startswith(head) for text in advice) for head in TAKEN] == [1] * len(TAKEN)
    assert len(advice) == len(TAKEN)
    for take in TAKEN.values():
        take()


def test_names_of_the_library_in_messages_are_there() -> None:
    named: dict[str, set[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                for name in re.findall(r"\b(?:spatialdyn|sd)\.(\w+)", node.value):
                    named.setdefault(name, set()).add(path.name)
    assert {"from_mujoco", "load_urdf", "view"} <= named.keys()
    assert {name: files for name, files in named.items() if not hasattr(sd, name)} == {}


def test_names_of_this_package_in_advice_are_there() -> None:
    """Words in advice that look like its names: in capitals inside, or dotted."""
    texts = [text for _, text in INSTEAD] + [text for _, text in coverage.RAISES]
    words = {word.strip(".") for text in texts for word in re.findall(r"(?<![\w.])[\w.]*[a-z][A-Z][\w.]*", text)}
    words = {word.removeprefix("data.") for word in words if not word.startswith(("spatialdyn.", "numpy."))}
    beside = {"MeshCat", "StreamBuffer"}  # of Pinocchio, named as what is not there
    data = model_and_state()[1]
    missing = {
        word
        for word in words - beside
        if not (coverage.entry(word).status.startswith("supported") or hasattr(data, word))
        and not hasattr(pin.RobotWrapper, word)
    }
    assert missing == set()
    assert {"constraintDynamics", "getJointJacobian", "Model.addJoint", "BuildFromURDF"} <= words
