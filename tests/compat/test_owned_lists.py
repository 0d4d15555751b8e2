"""Lists of a Model: every method of ``list`` that writes is noticed by the next call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as pin
from spatialdyn.compat.pinocchio.types.bases import Owner
from spatialdyn.compat.pinocchio.types.tracked_list import OwnedList

READING = {
    "__class_getitem__", "__contains__", "__eq__", "__ge__", "__getattribute__", "__getitem__", "__getstate__",
    "__gt__", "__init__", "__iter__", "__le__", "__len__", "__lt__", "__mul__", "__add__", "__ne__", "__new__",
    "__repr__", "__reversed__", "__rmul__", "__sizeof__", "copy", "count", "index",
}  # fmt: skip
WRITING: dict[str, tuple[Any, ...]] = {
    "__delitem__": (1,), "__iadd__": (["d"],), "__imul__": (2,), "__setitem__": (0, "x"), "append": ("d",),
    "clear": (), "extend": (["d", "e"],), "insert": (1, "d"), "pop": (), "remove": ("b",), "reverse": (), "sort": (),
}  # fmt: skip


def owned(values: list[Any], kind: Any = str) -> tuple[Any, list[int]]:
    """An OwnedList, and a list that grows with each notice of its owner."""
    seen: list[int] = []
    return OwnedList(Owner(lambda: seen.append(1)), kind, values), seen


def test_every_method_of_list_either_reads_or_is_tried_below() -> None:
    methods = {name for name, x in vars(list).items() if callable(x)}
    assert methods - READING == WRITING.keys()


@pytest.mark.parametrize("name", WRITING)
def test_a_method_that_writes_notifies_the_owner_and_does_what_that_of_list_does(name: str) -> None:
    values = ["c", "b", "a"]
    made, seen = owned(values)
    found, wanted = getattr(made, name)(*WRITING[name]), getattr(values, name)(*WRITING[name])
    assert seen
    assert made == values != ["c", "b", "a"]
    assert found is made if name in ("__iadd__", "__imul__") else found == wanted


@pytest.mark.parametrize("times", [-1, 0, 1, 3])
def test_repeating_makes_independent_copies(times: int) -> None:
    made, _ = owned([pin.SE3.Identity(), pin.SE3.Random()], pin.SE3)
    made *= times
    assert len(made) == 2 * max(times, 0)
    assert len({id(x) for x in made}) == len(made)


@pytest.mark.parametrize("name", ["__iadd__", "append", "extend", "insert"])
def test_an_entry_of_another_type_is_refused_and_nothing_changes(name: str) -> None:
    made, seen = owned(["a", "b"])
    given = {"append": (3,), "insert": (0, 3)}.get(name, (["c", 3],))
    with pytest.raises(TypeError, match="a int was given, expected str"):
        getattr(made, name)(*given)
    assert made == ["a", "b"]
    assert not seen


def test_an_order_that_fails_on_its_way_is_noticed_too() -> None:
    made, seen = owned(["b", "a", "c"])
    with pytest.raises(ZeroDivisionError):
        made.sort(key=lambda x: 1 // (x != "c"))
    assert seen


EDITS: dict[str, Callable[[Any], Any]] = {
    "pop": lambda frames: frames.pop(1),
    "clear": lambda frames: frames.clear(),
    "sort": lambda frames: frames.sort(key=lambda x: x.name, reverse=True),
    "reverse": lambda frames: frames.reverse(),
    "__delitem__": lambda frames: frames.__delitem__(slice(1, 3)),
    "remove": lambda frames: frames.remove(frames[2]),
    "insert": lambda frames: frames.insert(1, pin.Frame("new", 2, 0, pin.SE3.Random(), pin.OP_FRAME)),
    "extend": lambda frames: frames.extend([pin.Frame("new", 2, 0, pin.SE3.Random(), pin.OP_FRAME)]),
    "__iadd__": lambda frames: frames.__iadd__([pin.Frame("new", 2, 0, pin.SE3.Random(), pin.OP_FRAME)]),
    "__imul__": lambda frames: frames.__imul__(2),
}


@pytest.mark.parametrize("edit", EDITS)
def test_the_next_call_sees_the_frames_as_they_are(edit: str) -> None:
    model = pin.buildSampleModelManipulator()
    q = np.linspace(-0.5, 0.5, model.nq)
    pin.framesForwardKinematics(model, model.createData(), q)  # what is kept of the frames before
    assert model.existFrame("shoulder1_joint")
    EDITS[edit](model.frames)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    assert len(data.oMf) == len(model.frames)
    for k, frame in enumerate(model.frames):
        assert data.oMf[k].isApprox(data.oMi[frame.parentJoint] * frame.placement)
        assert model.existFrame(frame.name)


def test_adding_in_place_to_a_list_of_a_model_keeps_the_list() -> None:
    model = pin.buildSampleModelManipulator()
    frames, count = model.frames, model.nframes
    model.frames += [pin.Frame("new", 2, 0, pin.SE3.Random(), pin.OP_FRAME)]
    assert model.frames is frames
    assert model.getFrameId("new") == count
    for names in (["universe"], model.names):
        with pytest.raises(AttributeError, match="names of a Model cannot be assigned"):
            model.names = names


def test_the_name_of_a_model_is_a_str() -> None:
    model = pin.Model()
    model.name = "arm"
    with pytest.raises(TypeError, match="name of a Model is a int, expected str"):
        model.name = 3
    assert model.name == "arm"
