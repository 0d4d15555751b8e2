"""``Scene``: what acts on a robot is one object, checked when it is made, and simulations take it."""

from __future__ import annotations

import pickle
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import spatialdyn as sd
from spatialdyn.simulation.scene import EFFECTS, FIELDS

ARM = sd.load_urdf("two_link")
DRY = sd.Friction([0.3, 0.2], [0.1, 0.05], smoothing=[0.1, 0.1], bristle_stiffness=[90.0, 80.0])
MOTOR = sd.Motor([0.03, 0.03], 0.6, 24.0, 50.0)
TIP = sd.Contacts(
    ARM, {"tip": 0.02}, friction=0.6, restitution=0.1, terrain=sd.Plane((0.0, 0.1, 1.0), -2.0), tolerance=1e-7
)
GROUND = sd.Contacts(ARM, {"tip": 0.02}, terrain=sd.Heightfield([[-3.0, -3.0], [-3.0, -2.9]], 0.5, (1.0, 2.0)))
LOOP = sd.Constraints(ARM, [sd.CouplerConstraint("joint2", "joint1", ratio=-2.0)])
PUSH = np.zeros((ARM.njoints, 6))
PUSH[1, 2] = 3.0
CHANGES: dict[str, tuple[Any, ...]] = {
    "constraints": (LOOP,), "contacts": (TIP, GROUND), "friction": (DRY, False), "limits": (True,), "motor": (MOTOR,),
    "fext": (PUSH,),
}  # fmt: skip
HOW: tuple[dict[str, Any], ...] = (
    {"constraints": LOOP, "stabilization": 0.05}, {"friction": DRY, "friction_method": "lugre"},
    {"friction": DRY, "friction_method": "smooth"}, {"motor": MOTOR, "drive": "voltage"},
)  # fmt: skip
ALL = [{name: x} for name, values in CHANGES.items() for x in values] + [*HOW]


def equal(a: Any, b: Any) -> bool:
    return a == b and hash(a) == hash(b)


def test_a_scene_is_its_content() -> None:
    scenes = [sd.Scene(ARM, **x) for x in [{}, *ALL]]
    for i, scene in enumerate(scenes):
        assert equal(scene, sd.Scene(ARM, **[{}, *ALL][i]))
        assert equal(pickle.loads(pickle.dumps(scene)), scene)
        assert [scene == x for x in scenes].count(True) == 1
    assert sd.Scene(ARM) != sd.Scene(sd.load_urdf("pendulum"))
    assert sd.Scene(ARM) != ARM
    zero = sd.Scene(ARM, fext=0.0 * PUSH)
    assert equal(zero, sd.Scene(ARM, fext=-0.0 * PUSH))


def test_a_scene_cannot_be_changed() -> None:
    scene, push = sd.Scene(ARM, fext=PUSH), PUSH.copy()
    with pytest.raises(AttributeError, match="a Scene is immutable, limits cannot be set; with_"):
        scene.limits = True
    with pytest.raises(AttributeError, match="immutable"):
        del scene.limits
    assert scene.fext is not None
    with pytest.raises(ValueError, match="read-only"):
        scene.fext[0] = 1.0
    mine = PUSH.copy()
    kept = sd.Scene(ARM, fext=mine)
    mine[1, 2] = 99.0
    np.testing.assert_array_equal(kept.fext, push)


@pytest.mark.parametrize("options", ALL, ids=lambda x: "-".join(x))
def test_with_takes_an_effect_away_and_brings_it_back(options: dict[str, Any]) -> None:
    scene = sd.Scene(ARM, **options)
    bare = scene.with_(**{name: False if name == "limits" else None for name in options if name in EFFECTS})
    assert bare == sd.Scene(ARM)
    assert bare.with_(**options) == scene
    with pytest.raises(sd.SimulationError, match="a scene has no gravity, expected some of model, constraints"):
        scene.with_(gravity=3)


def test_a_scene_says_what_acts_and_which_methods_take_it() -> None:
    everything = tuple(sd.integrators)
    stepped, explicit = ("semi_implicit_euler",), everything[:4]
    wanted: list[tuple[dict[str, Any], tuple[str, ...], tuple[str, ...]]] = [
        ({}, (), everything), ({"fext": PUSH}, ("fext",), everything), ({"friction": False}, (), everything),
        ({"friction": DRY}, ("friction",), stepped), ({"motor": MOTOR}, ("motor",), stepped),
        ({"friction": DRY, "friction_method": "smooth"}, ("friction",), everything),
        ({"limits": True}, ("limits",), stepped), ({"contacts": TIP}, ("contacts",), stepped),
        ({"constraints": LOOP}, ("constraints",), (*explicit, "stormer_verlet", "variational")),
        ({"constraints": LOOP, "stabilization": 0.1}, ("constraints",), (*explicit, "dop853", "radau")),
        ({"constraints": LOOP, "limits": True, "fext": PUSH}, ("constraints", "limits", "fext"), stepped),
    ]  # fmt: skip
    for options, acts, methods in wanted:
        scene = sd.Scene(ARM, **options)
        assert (scene.acts, scene.methods) == (acts, methods)
        assert scene.method == ("semi_implicit_euler" if methods == stepped else "rk4")
        for name in acts:
            assert name in repr(scene)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"stabilization": 0.1}, sd.SimulationError, "stabilization is 0.1, expected None: no constraints"),
        ({"constraints": LOOP, "stabilization": -1.0}, sd.ConstraintError, "stabilization is -1.0"),
        ({"drive": "voltage"}, sd.SimulationError, 'drive is "voltage" and no motor is given'),
        ({"drive": "steam"}, sd.SimulationError, "drive is 'steam', expected one of current, voltage"),
        ({"friction_method": "lugre"}, sd.SimulationError, 'friction_method is "lugre" and no friction is given'),
        ({"friction": sd.Friction(1.0), "friction_method": "lugre"}, sd.SimulationError, "no bristle_stiffness"),
        ({"friction": sd.Friction(1.0), "friction_method": "smooth"}, sd.SimulationError, "friction has no smoothing"),
        ({"motor": MOTOR, "friction_method": "smooth"}, sd.SimulationError, 'friction_method is "smooth", expected'),
        ({"friction": sd.Friction([1.0] * 3)}, sd.ShapeError, "friction has 3 freedoms, expected the 2"),
        ({"motor": sd.Motor([1.0] * 3, 1.0, 1.0)}, sd.ShapeError, "motor has 3 freedoms, expected the 2"),
        ({"limits": "yes"}, sd.SpatialDynError, "limits is 'yes'"),
        ({"fext": np.zeros((2, 6))}, sd.ShapeError, r"fext has shape \(2, 6\), expected \(3, 6\)"),
        ({"fext": np.full((3, 6), np.nan)}, sd.NonFiniteError, "fext is .*, expected finite"),
        ({"contacts": {"tip": 0.1}}, sd.ConstraintError, "contacts are a dict, expected Contacts"),
        ({"constraints": [1]}, sd.ConstraintError, "constraints are a list, expected Constraints"),
    ],
)
def test_what_contradicts_is_refused_when_the_scene_is_made(options: Any, error: Any, words: str) -> None:
    with pytest.raises(error, match=words):
        sd.Scene(ARM, **options)


def test_parts_of_another_robot_are_refused() -> None:
    other = sd.load_urdf("pendulum")
    for name, x in (("constraints", LOOP), ("contacts", TIP)):
        with pytest.raises(sd.ModelError, match=f"{name} are of the model"):
            sd.Scene(other, **{name: x})
    with pytest.raises(sd.ModelError, match="model is a str, expected a spatialdyn Model"):
        sd.Scene("two_link")  # type: ignore[arg-type]
    with pytest.raises(sd.ModelError, match="model is a str, expected a spatialdyn Model"):
        sd.simulate("two_link", [0.0], [0.0], 1.0, 0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", [x for x in FIELDS if x not in ("model", "fext")])
def test_an_effect_as_an_argument_shows_the_line_to_write(name: str) -> None:
    value = {"friction": True, "limits": True}.get(name)
    for call in (sd.simulate, sd.rollout):
        words = rf"{name} is an option of the scene, expected sd.{call.__name__}\(sd.Scene\(model, {name}={name}\), ..."
        with pytest.raises(sd.SimulationError, match=words):
            call(ARM, [0.0, 0.0], [0.0, 0.0], dt=0.1, **{name: value})  # type: ignore[operator]
    with pytest.raises(sd.SimulationError, match=r'expected sd.rollout.*record="contacts"'):
        sd.rollout(ARM, [0.0, 0.0], [0.0, 0.0], dt=0.1, record_contacts=True)  # type: ignore[call-arg]


def test_constant_forces_are_of_the_scene_and_others_of_the_run() -> None:
    model, still = sd.load_urdf("two_link"), np.zeros(2)
    push = np.ones((model.njoints, 6))
    words = r"fext is constant, an option of the scene, expected sd.Scene\(model, fext=fext\)"
    with pytest.raises(sd.SimulationError, match=words):
        sd.simulate(model, still, still, 1.0, 0.1, fext=push)
    with pytest.raises(sd.SimulationError, match=words):
        sd.rollout(model, still, still, dt=0.1, steps=2, fext=push)


def test_limits_of_a_robot_that_has_none_are_nothing() -> None:
    """Not another step with other rounding; and there is nothing of them to record."""
    builder = sd.ModelBuilder("arm").add_body("rod", None, "revolute", (0, 1, 0), inertia=(1.0, (0.1, 0, 0), np.eye(3)))
    rubs = sd.Scene(builder.build(), friction=sd.Friction(0.1, 0.2))
    runs = [sd.simulate(x, [0.3], [1.0], 0.05, 1e-3) for x in (rubs, rubs.with_(limits=True))]
    assert runs[0].v.tobytes() == runs[1].v.tobytes()
    with pytest.raises(sd.SimulationError, match="expected contacts, or limits=True of joints that have limits"):
        sd.simulate(rubs.with_(limits=True), [0.3], [1.0], 0.05, 1e-3, record="contacts")


def test_the_scene_of_a_file_has_all_that_it_declares() -> None:
    panda = sd.load_urdf("panda")
    scene = sd.Scene.of(panda)
    assert scene.limits
    assert scene.friction == sd.Friction.of(panda)
    assert scene.constraints is not None
    (couple,) = scene.constraints
    assert isinstance(couple, sd.CouplerConstraint)
    assert (couple.joint, couple.to, couple.ratio) == ("panda_finger_joint2", "panda_finger_joint1", 1.0)
    alone = sd.Scene.of(sd.load_urdf("panda", mimic=True))
    assert alone.constraints is None
    assert alone.limits
    made = sd.ModelBuilder("bare").add_body("rod", None, "revolute", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.eye(3)))
    bare = made.build()
    assert sd.Scene.of(bare) == sd.Scene(bare)


def test_a_model_stands_for_the_scene_of_nothing_else() -> None:
    x = [0.3, -0.2], [0.1, 0.4]
    a, b = (sd.simulate(s, *x, 0.05, 1e-2) for s in (ARM, sd.Scene(ARM)))
    np.testing.assert_array_equal(a.q, b.q)
    assert a.scene == b.scene == sd.Scene(ARM)
    c, d = (sd.rollout(s, *x, dt=1e-2, steps=5) for s in (ARM, sd.Scene(ARM)))
    np.testing.assert_array_equal(c.q, d.q)
    assert c.scene == sd.Scene(ARM)
    assert (c.method, a.method) == ("semi_implicit_euler", "rk4")


# --- TOML ------------------------------------------------------------------------------------------------


TOML = pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 reads no TOML")


@TOML
@pytest.mark.parametrize("options", [{}, *ALL], ids=lambda x: "-".join(x) or "bare")
def test_a_scene_comes_back_from_toml(options: dict[str, Any]) -> None:
    scene = sd.Scene(ARM, **options)
    assert sd.Scene.from_toml(ARM, scene.to_toml()) == scene


@TOML
@given(st.text(min_size=1).filter(lambda x: x.isprintable()), st.floats(allow_nan=False, allow_infinity=False))
def test_names_and_numbers_come_back_from_toml(name: str, number: float) -> None:
    held = sd.Constraints(ARM, [sd.CouplerConstraint("joint2", "joint1", ratio=number, name=name)])
    scene = sd.Scene(ARM, constraints=held)
    found = sd.Scene.from_toml(ARM, scene.to_toml())
    assert found == scene
    assert found.constraints is not None
    assert found.constraints.items[0].label == name


@TOML
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = ", "the scene is no TOML"),
        ("wind = 3", "the scene in TOML has wind, expected some of stabilization"),
        ("contacts = 3", r"contacts of the scene is 3, expected a table \[contacts\]"),
        ("[contacts]\ntolerance = 1e-3", r"\[contacts\] of the scene lacks points"),
        ("[contacts]\npoints = {tip = 0.1}\nbounce = 1", r"\[contacts\] of the scene has bounce, expected some of"),
        ('[contacts]\npoints = {tip = 0.1}\nterrain = {kind = "sea"}', "has no kind of plane, heightfield"),
        ('[contacts]\npoints = {tip = 0.1}\nterrain = {kind = "heightfield"}', r"\[contacts.terrain\] of the scene: "),
        ("[friction]\nstiction = 1", r"\[friction\] of the scene has stiction, expected some of coulomb"),
        ("[motor]\nresistance = 1", r"\[motor\] of the scene: .*torque_constant"),
        ("friction = [1, 2]", r"friction of the scene is \[1, 2\], expected a table"),
        ("constraint = 3", "entries are 3, expected a list"),
    ],
)
def test_a_wrong_text_is_refused_by_its_key(text: str, words: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=words):
        sd.Scene.from_toml(ARM, text)
    with pytest.raises(sd.SimulationError, match="TOML is a int, expected its text"):
        sd.Scene.from_toml(ARM, 3)  # type: ignore[arg-type]


def test_a_printed_scene_says_what_acts_what_it_costs_and_what_takes_it() -> None:
    lines = str(sd.Scene(ARM, friction=DRY, limits=True, fext=PUSH)).splitlines()
    assert lines[0] == "Scene of two_link: friction, limits, fext"
    whole = int(lines[1].split()[-2])
    assert whole > 200  # a loop counts once
    without = int(str(sd.Scene(ARM, friction=DRY, fext=PUSH)).splitlines()[1].split()[-2])
    assert f"  limits {whole - without:+d}".split() == lines[3].split()[:2]
    assert lines[-3].split() == ["states", "q", "(2),", "v", "(2)"]
    assert lines[-2].split() == ["methods", "semi_implicit_euler"]
    bare = str(sd.Scene(ARM)).splitlines()
    assert bare[0] == "Scene of two_link: nothing acts"
    assert bare[-1].split() == ["by", "default", "rk4"]
    bent = sd.Friction(0.1, bristle_stiffness=100.0, bristle_damping=1.0)
    assert "v (2), bristles" in str(sd.Scene(ARM, friction=bent, friction_method="lugre"))
