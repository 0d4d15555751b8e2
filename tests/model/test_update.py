"""A Model with other numbers in the same tree equals one assembled anew, to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd
from spatialdyn.model.robot_checks import make_link
from spatialdyn.model.update import edited


def assert_same(a: sd.Model, b: sd.Model) -> None:
    assert a == b
    assert a.key == b.key
    for name in sd.Model.__slots__:
        if name not in ("address", "bodies", "__weakref__"):
            assert repr(getattr(a, name)) == repr(getattr(b, name)), name
    assert a.bodies.tobytes() == b.bodies.tobytes()
    assert a.address == a.bodies.ctypes.data


@pytest.mark.parametrize("seed", range(4))
def test_an_edited_model_is_the_one_that_is_made_anew(seed: int) -> None:
    model = random_tree(seed, 6, fixed=False).model
    robot, rng = model.robot, np.random.default_rng(seed)
    links, joints, gravity = list(robot.links), list(robot.joints), (1.0, -2.0, 0.5)
    k, j = rng.integers(len(links)), rng.integers(len(joints))
    links[k] = make_link(links[k].name, (rng.random(), rng.random(3), np.diag([1.0, 1.5, 2.0])))
    at = tuple((np.reshape(joints[j].placement, (4, 4)) @ np.diag([1.0, -1.0, -1.0, 1.0])).ravel().tolist())
    joints[j] = replace(joints[j], placement=at)
    joints[0] = replace(joints[0], armature=0.25)
    anew = replace(robot, links=tuple(links), joints=tuple(joints))
    changed = {i: joint for i, joint in enumerate(joints) if joint != robot.joints[i]}
    options = replace(model.options, gravity=gravity)
    assert_same(edited(model, {int(k): links[k]}, changed, gravity), sd.Model(anew, options))


def test_what_is_not_edited_stays() -> None:
    model = random_tree(1, 6, fixed=False).model
    assert_same(edited(model, {}, {}), model)
    assert edited(model, {}, {}).mimic_matrix is None


def test_a_joint_that_carries_more_than_its_link_is_refused() -> None:
    for model in (random_tree(2, 6).model, random_tree(1, 6, fixed=False, floating=True).model):
        with pytest.raises(sd.ModelError, match="moving joint"):
            edited(model, {}, {})
