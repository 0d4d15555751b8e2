"""The package's namespace: listed names, and hints for names of other libraries."""

from __future__ import annotations

import re
from collections import Counter

import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as face
from spatialdyn.examples import gallery
from spatialdyn.interop.names import ABSENT, EXAMPLES, NAMES, Aliases


def test_only_public_names_are_listed() -> None:
    assert set(dir(sd)) == {*sd.__all__, "__version__"}
    assert not [name for name in dir(sd) if type(getattr(sd, name)).__name__ == "module"]


def test_suggested_names_exist_and_no_name_leads_two_ways() -> None:
    assert set(NAMES) <= set(sd.__all__)
    given = [*NAMES.values(), *((words,) for words in (*EXAMPLES.values(), *ABSENT.values()))]
    words = Counter(word for others in given for word in {w.lower() for f in others for w in f.split()})
    assert [word for word, n in words.items() if n > 1] == []
    assert {word for word in words if word in sd.__all__} <= set(NAMES)


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("mass_matrix", "crba"),
        ("computeGeneralizedGravity", "generalized_gravity"),
        ("mj_inverse", "rnea"),
        ("gravload", "generalized_gravity"),
        ("jacob0", "frame_jacobian"),
        ("inverse_dynamics", "rnea"),
        ("ik", "solve_ik"),
        ("dlqr", "lqr"),
        ("pid", "PD"),
        ("inverse_kinematics", "solve_ik"),
        ("trajectory", "spline"),
        ("jtraj", "quintic"),
        ("coriolis_matrx", "coriolis_matrix"),
    ],
)
def test_names_of_other_libraries_lead_to_ours(name: str, ours: str) -> None:
    with pytest.raises(AttributeError, match=rf"no attribute '{name}', did you mean {ours}$"):
        getattr(sd, name)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("mppi", "see `spatialdyn example mppi_on_lanes`"),
        ("collision", "no shapes are here to collide; Pinocchio with coal, or MuJoCo, finds collisions"),
        ("planner", "paths are not planned here; OMPL finds them, and spline joins their points"),
        ("load_mjcf", "sd.load reads MJCF, xacro and URDF, from_mjmodel a mujoco.MjModel"),
        ("SE3", "poses are arrays (4, 4); spatialdyn.compat.pinocchio.SE3 is a class of them"),
    ],
)
def test_what_no_call_does_leads_to_an_example_or_to_what_has_it(name: str, hint: str) -> None:
    with pytest.raises(AttributeError) as refused:
        getattr(sd, name)
    assert str(refused.value) == f"module 'spatialdyn' has no attribute '{name}', {hint}"


def test_hints_name_what_exists() -> None:
    assert set(EXAMPLES) <= set(gallery.names())
    assert {name for hint in ABSENT for name in re.findall(r"\b(load|load_urdf|from_\w+)\b", hint)} <= set(sd.__all__)
    named = [name for hint in ABSENT for name in re.findall(r"spatialdyn\.compat\.pinocchio\.(\w+)", hint)]
    assert named
    assert [name for name in named if not hasattr(face, name)] == []


def test_names_like_none_get_no_suggestion() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'zzz'$"):
        _ = sd.zzz
    assert not hasattr(sd, "_private")


def test_pinocchios_names_are_pinocchios() -> None:
    pin = pytest.importorskip("pinocchio")
    assert [w for others in NAMES.values() for w in others.pinocchio.split() if not hasattr(pin, w)] == []


def test_every_column_of_the_table_is_used() -> None:
    for column in Aliases._fields:
        assert any(getattr(others, column) for others in NAMES.values())
