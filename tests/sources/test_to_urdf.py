"""``sd.to_urdf``: read again the robot is the same to the bit, and what URDF cannot hold is refused by name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from robots import ROBOTS

import spatialdyn as sd
from spatialdyn.model.robot_checks import rpy_matrix
from spatialdyn.sources.to_urdf import angles_of

BOX = (1.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.2, 1.4]))
LEFT = "ignore:(robot |.*is ignored|.*mimic)"
FEW = ("panda", "ur5_robot", "icub", "so101", "alex_psyonic_hands", "pr2")  # with angles of every kind
EVERY_KIND = (
    sd.ModelBuilder("every <kind> & more")
    .set_inertia("base", BOX)
    .add_body("r", joint="revolute", axis=(1, 2, 3), placement=((1, 2, 3), (0.1, 0.2, 0.3)), inertia=BOX,
              limits=sd.JointLimits(-1, 2, velocity=3, effort=4), damping=0.1, friction=0.2)
    .add_body("c", "r", "continuous", (0, 1, 0), inertia=BOX, limits=sd.JointLimits(effort=3))
    .add_body("p", "c", "prismatic", (0, 0, 2), inertia=BOX, limits=(-math.inf, 1))
    .add_body("f", "p", "fixed", placement=(1, 0, 0), inertia=BOX)
    .add_body("q", "f", "planar", (0, 1, 1), inertia=BOX)
    .add_body("o", "q", "floating", inertia=BOX)
    .add_body('m"', "o", "revolute", (1, 0, 0), mimic={"leader": "r_joint", "multiplier": 2, "offset": 0.5})
)  # fmt: skip


def test_every_kind_of_joint_of_urdf_is_read_again() -> None:
    model = EVERY_KIND.build()
    back = sd.load_urdf(sd.to_urdf(model))
    assert back == model
    assert back.key == model.key
    assert [x.name for x in back.robot.joints] == [x.name for x in model.robot.joints]


@pytest.mark.filterwarnings(LEFT)
@pytest.mark.parametrize("name", [x for x in FEW if x in ROBOTS] or ["two_link"])
def test_robots_are_read_again_to_the_bit(name: str) -> None:
    model = sd.load_urdf(name)
    back = sd.load_urdf(sd.to_urdf(model))
    assert (back == model, back.key == model.key) == (True, True)


@pytest.mark.slow(quick="test_robots_are_read_again_to_the_bit")
@pytest.mark.filterwarnings(LEFT)
@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_read_again_to_the_bit(name: str) -> None:
    try:
        model = sd.load_urdf(str(ROBOTS[name]))
    except sd.UrdfError:
        pytest.skip("the file is refused")
    back = sd.load_urdf(sd.to_urdf(model))
    assert (back == model, back.key == model.key) == (True, True)


@pytest.mark.parametrize(
    "angles",
    [
        (0.1, -0.2, 0.3), (0.0, 0.0, 3.14159265359), (1.570796, 3.1415926, -0.314159), (0.0, 1.5708, 0.0),
        (-1.57079632679, -1.57079632679, 0.0), (3.14159265359, 0.0, 1.57079632679), (-1.5708, 1.11022e-16, -1.5708),
        (0.0, 0.0, -4.71238898038), (4.02456e-15, 8.67362e-16, -1.5708), (2.5, -1.1, 0.123456789012345),
    ],
)  # fmt: skip
def test_angles_have_the_bits_of_their_rotation(angles: tuple[float, ...]) -> None:
    R = rpy_matrix(*angles)
    assert (rpy_matrix(*angles_of(R)) == R).all()


def test_any_rotation_is_written_to_rounding() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        R *= np.sign(np.linalg.det(R))
        assert abs(rpy_matrix(*angles_of(R)) - R).max() < 4e-15  # some eps of products of two sines


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (lambda b: b.add_body("x", joint="spherical", inertia=BOX), 'joint "x_joint" is spherical, which URDF cannot'),
        (lambda b: b.add_body("x", joint="helical", pitch=0.1), 'joint "x_joint" is helical, which URDF cannot hold'),
        (lambda b: b.add_body("x", armature=0.5), 'joint "x_joint" has armature 0.5, which URDF cannot hold'),
        (lambda b: b.add_body("x", rotor=sd.Rotor(0.1, 2.0)), 'joint "x_joint" has a rotor, which URDF cannot hold'),
        (
            lambda b: b.add_series_elastic("a_joint", 100.0, rotor=0.1),
            'joint "a_joint_rotor" is a rotor behind the spring of "a_joint", which URDF cannot hold',
        ),
        (lambda b: b.add_body("x\x01"), r"'x\\x01' has a character that XML cannot hold"),
    ],
)
def test_what_urdf_cannot_hold_is_refused_by_name(changed: Any, message: str) -> None:
    builder = sd.ModelBuilder("r").add_body("a", inertia=BOX)
    with pytest.raises(sd.SpatialDynError, match=message):
        sd.to_urdf(changed(builder).build())


def test_shared_motors_are_refused() -> None:
    wrist = sd.Transmission(("joint1", "joint2"), [[0.5, 0.5], [0.5, -0.5]], rotor_inertia=[2e-4, 3e-4])
    with pytest.raises(sd.SpatialDynError, match='joint "joint1" has armature'):
        sd.to_urdf(sd.load_urdf("two_link").with_(transmissions=[wrist]))


def test_another_order_is_said() -> None:
    pytest.importorskip("mujoco")
    body = '<body><joint name="{}"/><geom size=".1"/></body>'
    model = sd.load(f"<mujoco><worldbody>{body.format('b')}{body.format('a')}</worldbody></mujoco>")
    with pytest.warns(UserWarning, match="come in another order when its URDF is read"):
        text = sd.to_urdf(model)
    assert (model.names, sd.load(text).names) == (("universe", "b", "a"), ("universe", "a", "b"))


def test_inertial_parameters_take_the_place_of_the_models() -> None:
    """The identified ones go into the joints' links; what is fixed to them has no mass then."""
    model = EVERY_KIND.build()
    pi = sd.inertial_parameters(model)
    same = model.with_(inertial_parameters=pi)
    assert abs(sd.inertial_parameters(same) - pi).max() < 1e-14
    q, v = sd.random_configuration(model, 0), np.arange(1.0, model.nv + 1)
    assert sd.rnea(same, q, v, v) == pytest.approx(sd.rnea(model, q, v, v), rel=1e-12)
    assert {x.name: x.mass for x in same.robot.links}["f"] == 0.0
    pi[1:, 0] *= 2.0
    twice = sd.load_urdf(sd.to_urdf(model.with_(inertial_parameters=pi)), inertia="strict")
    assert twice.total_mass == pytest.approx(2.0 * model.total_mass)
    for wrong, error, message in (
        (pi[1:], sd.ModelError, r"inertial_parameters have shape \(6, 10\), expected finite ones of shape \(7, 10\)"),
        (pi * np.nan, sd.ModelError, "inertial_parameters have numbers that are not finite"),
        (-pi, sd.InertiaError, 'joint "r_joint" has inertial parameters of mass -2'),
    ):
        with pytest.raises(error, match=message):
            model.with_(inertial_parameters=wrong)


def test_inertial_parameters_of_a_floating_root_are_its_links() -> None:
    model = sd.load_urdf("floating_body", root="floating")
    pi = 2.0 * sd.inertial_parameters(model)
    assert sd.inertial_parameters(model.with_(inertial_parameters=pi)) == pytest.approx(pi, rel=1e-14)
