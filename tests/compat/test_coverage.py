"""Coverage of Pinocchio: every name has a status, and a missing one an error."""

from __future__ import annotations

import pytest

import spatialdyn.compat.pinocchio as face
from spatialdyn.compat.pinocchio.coverage.coverage import (
    DIFFERENT,
    INSTEAD,
    OUT_OF_SCOPE,
    OWN,
    SUPPORTED,
    UNKNOWN,
    entry,
    names,
)

NAMES = names()

STATUSES = {SUPPORTED, DIFFERENT, OUT_OF_SCOPE}


def test_the_names_are_the_wheels() -> None:
    pin = pytest.importorskip("pinocchio", minversion="4.1")
    later = {"visualize", "deprecation"}  # modules that exist once they were imported
    assert {name for name in dir(pin) if not name.startswith("_")} - later == NAMES


def test_every_name_has_a_status_and_what_is_not_there_a_note() -> None:
    found = face.coverage()
    assert set(found) == NAMES
    assert {x.status for x in found.values()} <= STATUSES
    assert [x.name for x in found.values() if x.status != SUPPORTED and not x.note] == []


def test_nothing_is_left_to_be_written() -> None:
    assert [x.name for x in face.coverage().values() if x.note == "not implemented yet"] == []


def test_what_is_supported_is_there_and_what_is_out_of_scope_is_not() -> None:
    for name, x in face.coverage().items():
        assert (name in vars(face)) == (x.status != OUT_OF_SCOPE), name


def test_a_star_import_brings_every_supported_name() -> None:
    there = {x.name for x in face.coverage().values() if x.status != OUT_OF_SCOPE}
    assert {*face.__all__} - OWN == there


def test_a_name_out_of_scope_says_what_to_use_instead() -> None:
    for name in ("computeBodyRadius", "MeshLoader", "lcaba", "buildModelFromMJCFAndRootJoint"):
        with pytest.raises(NotImplementedError, match=rf"pinocchio\.{name} is not supported: .*: "):
            getattr(face, name)


def test_hasattr_of_a_name_out_of_scope_is_false() -> None:
    assert not hasattr(face, "MeshLoader")
    assert getattr(face, "serialization", None) is None
    with pytest.raises(ImportError):
        from spatialdyn.compat.pinocchio import serialization  # noqa: F401


@pytest.mark.parametrize(
    ("line", "advice"),
    [
        ("from spatialdyn.compat.pinocchio import computeBodyRadius", "computeBodyRadius is not supported: .*coal"),
        (
            "from spatialdyn.compat.pinocchio import rnea, MeshLoader as G",
            "MeshLoader is not supported: .*coal",
        ),
        ("import spatialdyn.compat.pinocchio.serialization", "serialization is not supported: .*pickle"),
    ],
)
def test_importing_what_is_out_of_scope_says_what_to_use_instead(line: str, advice: str) -> None:
    for kind in (NotImplementedError, ImportError):
        with pytest.raises(kind, match=advice):
            exec(line, {})
    assert not hasattr(face, "serialization")


def test_importing_an_unknown_name_is_an_import_error() -> None:
    with pytest.raises(ImportError, match="cannot import name 'frobnicate'") as raised:
        exec("from spatialdyn.compat.pinocchio import frobnicate", {})
    assert not isinstance(raised.value, NotImplementedError)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="did you mean rnea"):
        face.rnea_
    assert entry("rnea_").status == UNKNOWN
    assert not hasattr(face, "frobnicate")


def test_every_pattern_of_what_is_out_of_scope_is_needed() -> None:
    from fnmatch import fnmatchcase

    beside = {
        "coal",
        "romeo_wrapper",
        "windows_dll_manager",
        "derivative",
    }  # files of the wheel
    for patterns, _ in INSTEAD:
        for pattern in patterns:
            assert any(fnmatchcase(name, pattern) for name in NAMES | beside), pattern


def test_members_are_looked_up() -> None:
    assert entry("SE3.Identity").status == SUPPORTED
    assert entry("robot_wrapper.RobotWrapper.BuildFromURDF").status == SUPPORTED
    assert entry("SE3.nonsense").status == OUT_OF_SCOPE


@pytest.mark.parametrize(
    "name", ["Model.nq", "Model.frames", "Data.M", "RobotWrapper.model", "robot_wrapper.RobotWrapper.q0"]
)
def test_what_only_objects_have_is_looked_up_too(name: str) -> None:
    assert entry(name).status == SUPPORTED


@pytest.mark.parametrize("member", ["setCompliance", "retrieveCompliance"])
def test_members_out_of_scope_say_what_to_use_instead(member: str) -> None:
    found = entry(f"RigidConstraintModel.{member}")
    assert found.status == OUT_OF_SCOPE
    assert found.note == face.RigidConstraintModel._instead[member]


def test_differences_name_what_they_concern() -> None:
    for name in (
        "RobotWrapper.com",
        "RobotWrapper.initViewer",
        "visualize.MeshcatVisualizer",
        "GeometryModel",
        "Model.armature",
        "buildReducedModel",
        "computeMinverse",
        "Data.saveToText",
    ):
        assert entry(name).status == DIFFERENT, name
        assert entry(name).note
