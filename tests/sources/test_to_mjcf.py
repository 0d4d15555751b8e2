"""``sd.to_mjcf``: MuJoCo compiles the text to the same equation of motion; what MJCF cannot hold is refused by name."""

from __future__ import annotations

from typing import Any

import against_mujoco
import numpy as np
import pytest

import spatialdyn as sd

mujoco = pytest.importorskip("mujoco")
BOX = (1.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.2, 1.4]) + 0.1)
EVERY_KIND = (
    sd.ModelBuilder("every <kind> & more")
    .set_inertia("base", BOX)
    .add_body("r", joint="revolute", axis=(1, 2, 3), placement=((1, 2, 3), (0.1, 0.2, 0.3)), inertia=BOX,
              limits=sd.JointLimits(-1, 2, effort=4), damping=0.1, friction=0.2, armature=0.3)
    .add_body("c", "r", "continuous", (0, 1, 0), inertia=BOX, limits=sd.JointLimits(effort=3))
    .add_body("p", "c", "prismatic", (0, 0, 2), ((0, 0, 1), (1, 2, 3)), inertia=BOX)
    .add_body("f", "p", "fixed", placement=((1, 0, 0), (3, 0, 0.1)), inertia=BOX)
    .add_body("s", "f", "spherical", inertia=BOX, armature=0.1)
    .add_body("u", "s", "revolute", (0, 1, 0), ((0, 0.1, 0), (0.1, 0, 0)))
    .add_body("w", "u", "revolute", (0, 0, 1), ((0.2, 0, 0), (0, 0.4, 0)))
    .add_body("x", "w", "prismatic", (1, 0, 0), ((0, 0, 0.3), (0, 0, 0.7)), inertia=BOX)
    .add_body("m", "x", "revolute", (1, 0, 0), inertia=BOX, mimic={"leader": "r_joint", "multiplier": 2, "offset": 0.5})
)  # fmt: skip


def again(model: sd.Model) -> tuple[Any, sd.Model]:
    m = mujoco.MjModel.from_xml_string(sd.to_mjcf(model))
    return m, sd.from_mjmodel(m)


@pytest.mark.parametrize("root", ["fixed", "floating"])
def test_mujoco_moves_it_as_this_library_does(root: str) -> None:
    """Every kind of joint, links without mass between joints, which become one body, and fixed links."""
    model = EVERY_KIND.build(root=root, gravity=(0.1, -2.0, -9.0))
    m, back = again(model)
    assert back.names == model.names
    found = against_mujoco.errors(against_mujoco.without_passive(m), model)
    assert max(found.values()) < against_mujoco.RELATIVE, found
    for name in ("damping", "friction", "armature", "effort_limit", "lower", "upper", "gravity"):
        assert getattr(back, name).tolist() == getattr(model, name).tolist(), name
    assert [x.mimic for x in back.robot.joints if x.mimic] == [x.mimic for x in model.robot.joints if x.mimic]


def test_point_masses_on_fixed_links_are_summed_up() -> None:
    """MuJoCo takes no inertia without positive moments: those of a rigid body become its moving link's."""
    points = sd.ModelBuilder("points").add_body("a", axis=(0, 1, 0))
    for k, place in enumerate(np.eye(3)):
        points.add_body(f"p{k}", "a", "fixed", placement=place, inertia=(1.0, (0, 0, 0.1), np.zeros((3, 3))))
    model = points.build()
    m, _ = again(model)
    found = against_mujoco.errors(against_mujoco.without_passive(m), model)
    assert max(found.values()) < against_mujoco.RELATIVE, found


def test_a_model_of_mjcf_is_the_same_after_a_round_trip() -> None:
    text = """<mujoco><worldbody><body name="b" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0" pos=".1 0 0"/>
      <joint name="y" axis="0 1 0" pos="0 .2 0" ref=".3"/><geom size=".1" pos=".2 0 0"/></body></worldbody></mujoco>"""
    model = sd.load(text)
    m, back = again(model)
    assert back.names == model.names
    found = against_mujoco.errors(against_mujoco.without_passive(m), model)
    assert max(found.values()) < against_mujoco.RELATIVE, found


@pytest.mark.filterwarnings("ignore:robot ", "ignore:velocity limits")
@pytest.mark.parametrize("name", ["panda", "talos", "anymal"])
def test_robots_are_mujocos(name: str) -> None:
    try:
        model = sd.load_urdf(name, root="floating" if name == "anymal" else "fixed")
    except sd.UrdfError:
        pytest.skip("example-robot-data is not installed")
    m, back = again(model)
    assert back.names == model.names
    found = against_mujoco.errors(against_mujoco.without_passive(m), model, states=2)
    assert max(found.values()) < against_mujoco.RELATIVE, found


@pytest.mark.parametrize(
    ("add", "message"),
    [
        ({"joint": "planar"}, 'joint "x_joint" is planar, which MJCF cannot hold'),
        ({"joint": "helical", "pitch": 0.1}, 'joint "x_joint" is helical, which MJCF cannot hold'),
        ({"rotor": sd.Rotor(0.1, 2.0)}, 'joint "x_joint" has a rotor, which MJCF cannot hold'),
        ({"joint": "floating"}, 'joint "x_joint" is floating and not at the identity of the root'),
        ({"joint": "floating", "parent": "base", "armature": 1.0}, 'joint "x_joint" is floating and has armature 1.0'),
    ],
)
def test_what_mjcf_cannot_hold_is_refused_by_name(add: dict[str, Any], message: str) -> None:
    builder = sd.ModelBuilder("r").add_body("a", inertia=BOX).add_body("x", **{"parent": "a", "inertia": BOX, **add})
    with pytest.raises(sd.SpatialDynError, match=message):
        sd.to_mjcf(builder.build())


def test_names_and_limits_that_mjcf_has_not() -> None:
    with pytest.raises(sd.SpatialDynError, match='link "world" is not a fixed root without mass'):
        sd.to_mjcf(sd.ModelBuilder("r").add_body("world", inertia=BOX).build())
    spring = sd.ModelBuilder("r").add_body("a", inertia=BOX).add_series_elastic("a_joint", 100.0, rotor=0.1).build()
    with pytest.raises(sd.SpatialDynError, match='is a rotor behind the spring of "a_joint", which MJCF cannot hold'):
        sd.to_mjcf(spring)
    fast = sd.ModelBuilder("r").add_body("a", inertia=BOX, limits=sd.JointLimits(velocity=2.0)).build()
    with pytest.warns(UserWarning, match='velocity limits of joints "a_joint" are left out: MJCF has none'):
        sd.to_mjcf(fast)
