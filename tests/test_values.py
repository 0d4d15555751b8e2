"""Values of the public API, by field: equal and of one hash by content, different in each field, copied and pickled."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import itertools
import pickle
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from asymmetric import primes, roots

import spatialdyn as sd
from spatialdyn.model.robot import Link, Mimic, RobotJoint, Spring

BOX = (3.0, (0.2, 0.3, 0.5), np.diag([0.7, 1.1, 1.3]))
POSE = ((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))


def arm(**options: Any) -> sd.Model:
    """Two links whose joints stop, the second with a frame of its own."""
    builder = sd.ModelBuilder("arm").add_body("a", limits=(-1.0, 2.0), inertia=BOX)
    builder.add_body("b", "a", axis=(0, 1, 0), placement=(0.5, 0, 0), limits=(-3.0, 1.5), inertia=BOX)
    return builder.add_body("tip", "b", "fixed", placement=(0.2, 0, 0)).build(**options)


def body(**given: Any) -> sd.Model:
    """A model of one body, by what ``add_body`` takes, behind another one that it may hang on or mimic."""
    builder = sd.ModelBuilder("arm").add_body("a", joint_name="lead", inertia=BOX)
    return builder.add_body(**given).build()


def built(**given: Any) -> sd.Model:
    """A model by what the builder and ``build`` take."""
    names = {x: given.pop(x) for x in ("name", "root_link") if x in given}
    builder = sd.ModelBuilder(names.get("name", "arm"), names.get("root_link", "base"))
    return builder.add_body("a", joint="continuous", inertia=BOX).build(**given)


def with_(**given: Any) -> sd.Model:
    return arm().with_(**given)


JOINT: dict[str, Any] = {
    "name": "j", "kind": "revolute", "parent": "a", "child": "b", "placement": tuple(np.eye(4).ravel().tolist()),
}  # fmt: skip
PLACES = {"at_a": (0.1, 0.2, 0.3), "at_b": (0.5, 0.7, 1.1)}
# {what makes one: (what is given, {field: another value})}
CASES: dict[Callable[..., Any], tuple[dict[str, Any], dict[str, Any]]] = {
    sd.Friction: (
        {"coulomb": primes(2), "viscous": primes(2, after=3), "static": primes(2, after=7)},
        {
            "coulomb": [2.0, 3.5], "viscous": [5.5, 7.0], "static": [11.0, 14.0], "stribeck_velocity": 0.1,
            "smoothing": 0.1, "bristle_stiffness": 0.1, "bristle_damping": 0.1,
        },
    ),
    sd.Motor: (
        {"torque_constant": primes(2), "resistance": primes(2, after=3), "voltage": primes(2, after=7)},
        {
            "torque_constant": [2.0, 3.5], "resistance": [5.5, 7.0], "voltage": [11.0, 14.0], "ratio": 0.5,
            "back_emf": primes(2) + 1.0, "current": 20.0, "torque": 20.0, "efficiency": 0.5,
        },
    ),
    sd.Transmission: (
        {"joints": ("a", "b"), "matrix": roots(2, 2)},
        {
            "joints": ("a", "c"), "matrix": roots(2, 2).T, "rotor_inertia": [0.0, 1.0], "offset": [0.0, 1.0],
            "actuators": ("a", "m"),
        },
    ),
    sd.JointLimits: ({}, {"lower": -1.0, "upper": 2.0, "velocity": 3.0, "effort": 4.0}),
    sd.Rotor: ({"inertia": 0.1, "ratio": 2.0}, {"inertia": 0.2, "ratio": -2.0, "axis": (0.0, 1.0, 0.0)}),
    sd.Moments: ({"output": "tau"}, {"output": "q"}),
    sd.Quantiles: ({"output": "tau"}, {"output": "q", "at": (0.1, 0.9), "bits": 8}),
    sd.Worst: ({"output": "tau"}, {"output": "q", "count": 3, "beside": ("q",), "least": True}),
    sd.TallQR: ({"output": "tau"}, {"output": "q"}),
    sd.Plane: ({}, {"normal": (0.0, 0.6, 0.8), "height": 0.1}),
    sd.Heightfield: (
        {"z": roots(2, 2), "spacing": 0.5}, {"z": roots(2, 2).T, "spacing": 0.25, "origin": (0.0, 1.0)},
    ),
    sd.Contacts: (
        {"model": arm(), "points": {"b": 0.1, "tip": 0.2}},
        {
            "model": arm(gravity=(0, 0, -1)), "points": {"b": 0.1, "tip": 0.3}, "friction": {"b": 0.8, "tip": 0.9},
            "restitution": {"b": 0.0, "tip": 0.5}, "terrain": sd.Plane(height=0.1), "tolerance": 1e-7, "steps": 9,
            "rounds": 3,
        },
    ),
    sd.Constraints: (
        {"model": arm(), "items": (sd.PointConstraint("tip"), sd.CouplerConstraint("a_joint", "b_joint"))},
        {
            "model": arm(gravity=(0, 0, -1)),
            "items": (sd.CouplerConstraint("a_joint", "b_joint"), sd.PointConstraint("tip")),
        },
    ),
    sd.PointConstraint: ({"frame_a": "a"}, {"frame_a": "b", "frame_b": "c", "axes": "xz", **PLACES, "name": "n"}),
    sd.WeldConstraint: ({"frame_a": "a"}, {"frame_a": "b", "frame_b": "c", **PLACES, "name": "n"}),
    sd.HingeConstraint: ({"frame_a": "a"}, {"frame_a": "b", "frame_b": "c", "axis": (0, 1, 0), **PLACES, "name": "n"}),
    sd.DistanceConstraint: (
        {"frame_a": "a", "length": 1.0}, {"frame_a": "b", "frame_b": "c", "length": 2.0, **PLACES, "name": "n"},
    ),
    sd.CouplerConstraint: (
        {"joint": "a", "to": "b"}, {"joint": "c", "to": "d", "ratio": 2.0, "offset": 0.1, "name": "n"},
    ),
    sd.RollingConstraint: (
        {"frame": "a", "axis": (0, 1, 0), "radius": 0.3},
        {"frame": "b", "axis": None, "radius": 0.4, "normal": (0, 0.6, 0.8), "name": "n"},
    ),
    sd.VelocityConstraint: ({"A": roots(2, 3)}, {"A": roots(2, 3)[::-1], "name": "n"}),
    Link: ({"name": "a"}, {"name": "b", "mass": 1.0, "com": (0.0, 1.0, 0.0), "inertia": (1.0,) * 9}),
    Mimic: ({"leader": "a"}, {"leader": "b", "multiplier": 2.0, "offset": 0.1}),
    Spring: ({"joint": "a", "stiffness": 3.0}, {"joint": "b", "stiffness": 5.0, "damping": 0.1, "ratio": 2.0}),
    RobotJoint: (
        JOINT,
        {
            "name": "k", "kind": "helical", "parent": "c", "child": "d", "placement": (1.0,) * 16,
            "axis": (0.0, 1.0, 0.0), "lower": -1.0, "upper": 1.0, "velocity": 1.0, "effort": 1.0, "damping": 1.0,
            "friction": 1.0, "armature": 1.0, "mimic": Mimic("k"), "pitch": 1.0, "rotor": sd.Rotor(1.0, 2.0),
            "shared": ("k", 1.0), "spring": Spring("k", 1.0),
        },
    ),
    sd.Robot: (
        {"name": "r", "root": "a", "links": (Link("a"),), "joints": ()},
        {"name": "s", "root": "b", "links": (Link("a", 1.0),), "joints": (RobotJoint(**JOINT),), "ordered": True},
    ),
    body: (
        {"name": "b", "inertia": BOX},
        {
            "name": "c", "parent": "a", "joint": "prismatic", "axis": (0, 1, 0), "placement": POSE,
            "inertia": (3.0, (0.2, 0.5, 0.3), BOX[2]), "joint_name": "other",
            "limits": sd.JointLimits(-1.0, 2.0, 3.0, 4.0), "damping": 0.1, "friction": 0.1, "armature": 0.1,
            "mimic": {"leader": "lead"}, "rotor": sd.Rotor(0.1, 2.0),
        },
    ),
    built: (
        {},
        {
            "name": "other", "root_link": "ground", "root": "floating", "gravity": (0, 0, -1),
            "continuous": "cos_sin", "mimic": True,
        },
    ),
    with_: (
        {},
        {
            "gravity": (0, 0, -1), "armature": {"a_joint": 0.1}, "payload": {"tip": BOX},
            "rotors": {"a_joint": sd.Rotor(0.1, 2.0)},
            "transmissions": [sd.Transmission("b_joint", 2.0, rotor_inertia=[0.1])],
            "inertial_parameters": (2.0 * sd.inertial_parameters(arm())).tolist(),
        },
    ),
}  # fmt: skip
TAKEN = {body: sd.ModelBuilder.add_body, with_: sd.Model.with_}  # by a Model's: whose parameters are all there
APART = {
    body: {"self", "pitch"},
    with_: {"self"},
    sd.Robot: {"notes", "source", "declared"},
}  # a pitch is of a helical joint
RESULTS = {  # made by calls
    sd.Option: {"run"}, sd.Tradeoff: {"further", "subject"}, sd.Recommendation: set(), sd.Requirement: {"embedding"},
}  # fmt: skip
FIELDS = [(make, field) for make, (_, others) in CASES.items() for field in others]


def label(x: Any) -> str:
    return getattr(x, "__name__", str(x))


def of_content() -> set[type]:
    """Public classes that are compared by what they hold, but for named tuples."""
    public = [getattr(sd, name) for name in sd.__all__]
    classes = {x for x in public if isinstance(x, type) and not issubclass(x, tuple)}
    return {x for x in classes if "__eq__" in vars(x)} - {sd.Model, sd.Scene}  # scenes: simulation/test_scene.py


def test_every_value_of_the_api_and_every_parameter_of_it_is_here() -> None:
    assert of_content() <= {*CASES} | {*RESULTS}
    for make, (given, others) in CASES.items():
        known = {*given} | {*others}
        kept = inspect.signature(TAKEN.get(make, make)).parameters.values()
        parameters = {x.name for x in kept if x.kind != x.VAR_KEYWORD} if make is not built else known
        assert parameters - APART.get(make, set()) == known, label(make)
    assert {*inspect.signature(sd.assemble).parameters} - {"robot"} <= {*CASES[built][1]}


@pytest.mark.parametrize("make", RESULTS, ids=label)
def test_all_fields_of_a_result_count_but_what_it_runs(make: Any) -> None:
    assert {x.name for x in dataclasses.fields(make) if not x.compare} == RESULTS[make]


@pytest.mark.parametrize("make", CASES, ids=label)
def test_equal_content_is_equal_and_has_one_hash(make: Callable[..., Any]) -> None:
    given, others = CASES[make]
    for more in ({}, *({name: value} for name, value in others.items())):
        one, other = make(**given | more), make(**copy.deepcopy({**given, **more}))
        for twin in (other, pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
            assert one == twin
            assert hash(one) == hash(twin)
            assert repr(one) == repr(twin)


@pytest.mark.parametrize(("make", "field"), FIELDS, ids=label)
def test_what_differs_in_one_field_is_another(make: Callable[..., Any], field: str) -> None:
    given, others = CASES[make]
    one, other = make(**given), make(**{**given, field: others[field]})
    assert one != other
    assert len({one, other}) == 2


@pytest.mark.parametrize("make", CASES, ids=label)
def test_no_field_passes_for_another(make: Callable[..., Any]) -> None:
    given, others = CASES[make]
    for one, other in itertools.combinations(others, 2):
        assert make(**{**given, one: others[one]}) != make(**{**given, other: others[other]}), (one, other)


def _signed(x: Any) -> Any:
    """The same with -0.0 in place of 0."""
    if isinstance(x, Mapping):
        return {k: _signed(v) for k, v in x.items()}
    if isinstance(x, (list, tuple)) and x and all(isinstance(v, (int, float)) for v in x):
        return tuple(-0.0 if v == 0 else v for v in x)
    return -0.0 if isinstance(x, (int, float)) and not isinstance(x, bool) and x == 0 else x


def test_equal_places_of_constraints_have_one_hash() -> None:
    """Constraints are compared by their items and hashed by their table."""
    for field in ("at_a", "at_b"):
        made = [sd.Constraints(arm(), [sd.PointConstraint("tip", **{field: (zero, 0.1, 0.2)})]) for zero in (0.0, -0.0)]
        assert made[0] == made[1]
        assert len({*made}) == 1


@pytest.mark.parametrize(("make", "field"), FIELDS, ids=label)
def test_zeros_of_either_sign_are_equal(make: Callable[..., Any], field: str) -> None:
    given, others = CASES[make]
    value = others[field]
    one, other = (make(**{**given, field: x}) for x in (value, _signed(value)))
    assert one == other
    assert hash(one) == hash(other)


HOLDING = [
    (make, field)
    for make, (given, others) in CASES.items()
    for field, x in {**given, **others}.items()
    if isinstance(x, np.ndarray) or (make in (sd.Friction, sd.Motor, sd.Transmission) and not isinstance(x, tuple))
]


@pytest.mark.parametrize(("make", "field"), HOLDING, ids=label)
def test_arrays_are_copied_and_cannot_be_written_to(make: Callable[..., Any], field: str) -> None:
    given, others = CASES[make]
    mine = np.array(np.broadcast_to({**given, **others}[field], np.shape(given[field]) if field in given else (2,)))
    made, wanted = make(**{**given, field: mine}), make(**{**given, field: mine.copy()})
    mine += 1.0
    assert made == wanted
    kept = getattr(made, field)
    assert not isinstance(kept, np.ndarray) or not kept.flags.writeable
