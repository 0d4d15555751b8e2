"""Reading URDF: broken files raise, odd ones get notes, valid ones give Pinocchio's numbers."""

from __future__ import annotations

import io
import math
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yourdfpy
from inputs import run_python
from wheel import pin

from spatialdyn.calls.dynamics import rnea
from spatialdyn.commands.cli import main
from spatialdyn.errors import InertiaError, SpatialDynError, UrdfError
from spatialdyn.model.model import Model
from spatialdyn.model.robot import Link, Robot, RobotJoint
from spatialdyn.urdf.load import load_urdf, read_urdf
from spatialdyn.urdf.robot_files import example_robots, find_robot, robot_names
from spatialdyn.urdf.strict_xml import SIZE_LIMIT

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="hand">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0"/>
      <mass value="2"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
    </inertial>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="base"/>
    <child link="hand"/>
    <origin xyz="0 0 1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="2" effort="3"/>
  </joint>
</robot>
"""
BILLION_LAUGHS = """<?xml version="1.0"?>
<!DOCTYPE robot [
 <!ENTITY a "ha">
 <!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
 <!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">
]>
<robot name="&c;"><link name="base"/></robot>
"""
EXTERNAL = """<!-- a comment -->
<!DOCTYPE robot [<!ENTITY secret SYSTEM "file:///etc/hostname">]>
<robot name="arm"><link name="&secret;"/></robot>
"""
TIP = '<link name="tip"/>\n</robot>'
BACK = '<joint name="back" type="fixed"><parent link="hand"/><child link="base"/></joint>\n</robot>'
AGAIN = '<joint name="again" type="fixed"><parent link="base"/><child link="hand"/></joint>\n</robot>'
RING = """<link name="x"/><link name="y"/>
  <joint name="xy" type="fixed"><parent link="x"/><child link="y"/></joint>
  <joint name="yx" type="fixed"><parent link="y"/><child link="x"/></joint>
</robot>"""
MIMIC = '<mimic joint="elbow"/>\n    <axis xyz="0 1 0"/>'
ROT = 1e-15  # a few eps: two formulas for a rotation from roll, pitch, yaw


def changed(old: str, new: str) -> str:
    """The arm with one thing about it changed."""
    assert ARM.count(old) == 1, old
    return ARM.replace(old, new)


def refusal(source: object, **options: object) -> str:
    """The message of the UrdfError that a source raises."""
    with pytest.raises(UrdfError) as caught:
        read_urdf(source, **options)  # type: ignore[arg-type]
    message = str(caught.value)
    assert not message.endswith(".")
    assert "\n" not in message
    return message


def quiet(source: object) -> Robot:
    """A robot whose inertias may be of no body."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return read_urdf(source)


def link_of(robot: Robot, name: str) -> Link:
    return next(link for link in robot.links if link.name == name)


def joint_of(robot: Robot, name: str) -> RobotJoint:
    return next(joint for joint in robot.joints if joint.name == name)


# --- valid files ------------------------------------------------------------------------------------------


def test_numbers_are_those_of_the_text() -> None:
    robot = read_urdf(ARM)
    assert (robot.name, robot.root, robot.notes) == ("arm", "base", ())
    hand, elbow = link_of(robot, "hand"), joint_of(robot, "elbow")
    assert hand == Link("hand", 2.0, (0.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    assert elbow.placement == (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    assert (elbow.kind, elbow.parent, elbow.child, elbow.axis) == ("revolute", "base", "hand", (0.0, 1.0, 0.0))
    assert (elbow.lower, elbow.upper, elbow.velocity, elbow.effort) == (-1.0, 1.0, 2.0, 3.0)


def test_every_kind_of_source_gives_one_robot(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    robot = read_urdf(ARM)
    assert read_urdf(path) == robot
    assert read_urdf(str(path)) == robot
    assert read_urdf(ARM.encode()) == robot
    assert read_urdf("\ufeff\n  " + ARM) == robot
    assert read_urdf(b"\xef\xbb\xbf" + ARM.encode()) == robot
    assert read_urdf(ARM.encode("utf-16")) == robot
    assert read_urdf(ARM.replace('"1.0"', '"1.0" encoding="latin-1"')) == robot
    assert read_urdf(io.StringIO(ARM)) == robot
    with path.open("rb") as file:
        assert read_urdf(file) == robot
        assert not file.closed
    assert read_urdf(yourdfpy.URDF.load(str(path), load_meshes=False)) == robot


def test_a_bare_name_finds_our_own_models_and_the_examples() -> None:
    assert read_urdf("pendulum").name == "pendulum"
    assert read_urdf("panda").name == "panda"


def test_load_urdf_gives_a_model() -> None:
    model = load_urdf("pendulum", root="floating", gravity=(0.0, 0.0, -1.62))
    assert isinstance(model, Model)
    assert (model.nq, model.nv) == (8, 7)


def test_defaults_of_a_sparse_joint_are_those_of_the_format() -> None:
    text = changed('<axis xyz="0 1 0"/>', '<mimic joint="other"/><dynamics/>').replace(
        '<limit lower="-1" upper="1" velocity="2" effort="3"/>', "<limit/>"
    )
    elbow = joint_of(read_urdf(text.replace('<origin xyz="0 0 1" rpy="0 0 0"/>', "")), "elbow")
    assert elbow.placement == tuple(np.eye(4).ravel())
    assert elbow.axis == (1.0, 0.0, 0.0)
    assert (elbow.lower, elbow.upper) == (0.0, 0.0)
    assert (elbow.velocity, elbow.effort, elbow.damping, elbow.friction) == (math.inf, math.inf, 0.0, 0.0)
    assert elbow.mimic is not None
    assert (elbow.mimic.multiplier, elbow.mimic.offset) == (1.0, 0.0)


@pytest.mark.parametrize("kind", ["continuous", "fixed", "floating", "planar"])
def test_position_limits_belong_to_revolute_and_prismatic_joints_only(kind: str) -> None:
    elbow = joint_of(read_urdf(changed('"revolute"', f'"{kind}"').replace('upper="1"', 'upper="-2"')), "elbow")
    assert (elbow.lower, elbow.upper, elbow.velocity) == (-math.inf, math.inf, 2.0)


def test_a_turned_inertia_is_given_in_the_frame_of_the_link() -> None:
    text = changed('rpy="0 0 0"/>\n      <mass', 'rpy="0 0 1.5707963267948966"/>\n      <mass').replace(
        'ixx="1"', 'ixx="0.5"'
    )
    I = np.reshape(link_of(read_urdf(text), "hand").inertia, (3, 3))
    np.testing.assert_allclose(I, np.diag([1.0, 0.5, 1.0]), rtol=0, atol=ROT)


def test_damping_friction_and_mimic_are_kept() -> None:
    robot = read_urdf("tree")
    assert (joint_of(robot, "turn").damping, joint_of(robot, "turn").friction) == (0.5, 0.1)
    finger = joint_of(robot, "finger2_slide")
    assert finger.mimic is not None
    assert (finger.mimic.leader, finger.mimic.multiplier) == ("finger1_slide", 1.0)


def test_meshes_and_other_peoples_elements_are_never_looked_at() -> None:
    mesh = '<visual><geometry><mesh filename="package://nowhere/x.dae" scale="0 a"/></geometry></visual>'
    text = changed('<link name="base"/>', f'<link name="base">{mesh}<collision/></link><gazebo/><transmission/>')
    text = text.replace('<robot name="arm">', '<robot name="arm" xmlns="http://ros.org" xmlns:g="urn:gazebo"><g:link/>')
    assert read_urdf(text) == read_urdf(ARM)


@pytest.mark.parametrize(("tag", "what"), [("sdf", "SDF"), ("mujoco", "MJCF"), ("COLLADA", "a mesh")])
def test_another_format_is_called_by_its_name(tag: str, what: str) -> None:
    assert refusal(f"<{tag}/>").endswith(f"<{tag}> is the outermost element, expected <robot>, for {what} is not read")


# --- errors -----------------------------------------------------------------------------------------------

BROKEN = {
    "no robot element": (ARM.replace("robot", "model"), ":2: <model> is the outermost element, expected <robot>"),
    "no robot name": (changed(' name="arm"', ""), ":2: <robot> has no attribute name, expected a name"),
    "empty robot name": (changed('"arm"', '" "'), ':2: <robot name=""> is empty, expected a name'),
    "no links": ('<robot name="arm"/>', ': robot "arm" has no links'),
    "no link name": (changed('<link name="base"/>', "<link/>"), ':3: <link> of robot "arm" has no attribute name'),
    "two roots": (changed("</robot>", TIP), ':18: robot "arm" has 2 root links ("base", "tip"), expected one'),
    "no root": (changed("</robot>", BACK), ': robot "arm" has no root link: its joints form a cycle'),
    "a cycle": (changed("</robot>", RING), ':18: link "x" hangs on a cycle of joints, expected a tree'),
    "two parents": (changed("</robot>", AGAIN), ':18: link "hand" is the child of joints "elbow" and "again"'),
    "unknown parent": (changed('parent link="base"', 'parent link="bse"'), ':11: joint "elbow" has parent link "bse"'),
    "unknown child": (changed('child link="hand"', 'child link="hnd"'), ':11: joint "elbow" has child link "hnd"'),
    "duplicate link": (
        changed("</robot>", '<link name="hand"/></robot>'),
        ':18: robot "arm" has two links named "hand"',
    ),
    "duplicate link beside one of mass 0": (
        changed('value="2"', 'value="0"').replace("</robot>", '<link name="hand"/></robot>'),
        ':18: robot "arm" has two links named "hand"',
    ),
    "duplicate joint": (
        changed("</robot>", TIP.replace("</robot>", AGAIN.replace("again", "elbow").replace('"hand"', '"tip"'))),
        ':19: robot "arm" has two joints named "elbow"',
    ),
    "no parent": (changed('<parent link="base"/>', ""), ':11: <joint> of joint "elbow" has no <parent>, expected one'),
    "no child link": (
        changed(' link="hand"', ""),
        ':13: <child> of joint "elbow" has no attribute link, expected a name',
    ),
    "no joint type": (changed(' type="revolute"', ""), ':11: <joint> of joint "elbow" has no attribute type'),
    "unknown joint type": (
        changed('"revolute"', '"ball"'),
        ':11: <joint type="ball"> of joint "elbow" is not a joint type of URDF, expected one of revolute,',
    ),
    "spherical, which URDF lacks": (changed('"revolute"', '"spherical"'), ':11: <joint type="spherical">'),
    "zero axis": (
        changed("0 1 0", "0 0 -0.0"),
        ':15: <axis xyz="0 0 -0.0"> of joint "elbow" has norm 0, expected a nonzero',
    ),
    "NaN axis": (
        changed("0 1 0", "0 nan 0"),
        ':15: <axis xyz="0 nan 0"> of joint "elbow" is not finite, expected 3 finite',
    ),
    "two numbers in an axis": (
        changed("0 1 0", "0 0"),
        ':15: <axis xyz="0 0"> of joint "elbow" has 2 numbers, expected 3',
    ),
    "one number in an axis": (changed("0 1 0", "0"), ':15: <axis xyz="0"> of joint "elbow" has 1 number, expected 3'),
    "four numbers in xyz": (
        changed('"0 0 0.1"', '"0 0 0.1 0"'),
        ':6: <origin xyz="0 0 0.1 0"> of link "hand" has 4 numbers',
    ),
    "two numbers in rpy": (
        changed('xyz="0 0 1" rpy="0 0 0"', 'xyz="0 0 1" rpy="0 0"'),
        ':14: <origin rpy="0 0"> of joint "elbow" has 2 numbers, expected 3 finite numbers',
    ),
    "an infinite position": (
        changed('"0 0 1"', '"0 0 1e999"'),
        ':14: <origin xyz="0 0 1e999"> of joint "elbow" is not finite',
    ),
    "a decimal comma": (
        changed('"0 0 0.1"', '"0 0 0,1"'),
        """:6: <origin xyz="0 0 0,1"> of link "hand" holds '0,1', which""",
    ),
    "a Python number": (changed('value="2"', 'value="2_0"'), ':7: <mass value="2_0"> of link "hand" holds'),
    "an axis without xyz": (changed(' xyz="0 1 0"', ""), ':15: <axis> of joint "elbow" has no attribute xyz'),
    "lower > upper": (
        changed('lower="-1"', 'lower="1.5"'),
        ':16: <limit lower="1.5" upper="1.0"> of joint "elbow", expected lower <= upper',
    ),
    "lower > the default upper": (changed('lower="-1" upper="1"', 'lower="1"'), ':16: <limit lower="1.0" upper="0.0">'),
    "NaN limit": (changed('upper="1"', 'upper="nan"'), ':16: <limit upper="nan"> of joint "elbow" is not a number'),
    "limits that leave nothing": (changed('lower="-1" upper="1"', 'lower="inf" upper="inf"'), ":16: <limit lower="),
    "negative mass": (
        changed('value="2"', 'value="-2"'),
        ':7: <mass value="-2"> of link "hand" is negative, expected a finite number >=',
    ),
    "NaN mass": (changed('value="2"', 'value="nan"'), ':7: <mass value="nan"> of link "hand" is not finite'),
    "no mass": (changed('<mass value="2"/>', ""), ':5: <inertial> of link "hand" has no <mass>, expected one'),
    "mass without value": (changed(' value="2"', ""), ':7: <mass> of link "hand" has no attribute value'),
    "NaN inertia": (
        changed('iyy="1"', 'iyy="nan"'),
        ':8: <inertia iyy="nan"> of link "hand" is not finite, expected a finite',
    ),
    "missing iyy": (
        changed('iyy="1" ', ""),
        ':8: <inertia> of link "hand" has no attribute iyy, expected a finite number',
    ),
    "missing ixz": (
        changed('ixz="0" ', ""),
        ':8: <inertia> of link "hand" has no attribute ixz, expected a finite number',
    ),
    "two numbers in ixx": (
        changed('ixx="1"', 'ixx="1 1"'),
        ':8: <inertia ixx="1 1"> of link "hand" has 2 numbers, expected',
    ),
    "no inertia": (
        changed('<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>', ""),
        ':5: <inertial> of link "hand" has no <inertia>, expected one',
    ),
    "two masses": (changed("<mass", '<mass value="1"/>\n<mass'), ':8: <inertial> of link "hand" has a second <mass>'),
    "two inertials": (
        changed("</inertial>", "</inertial><inertial/>"),
        ':9: <link> of link "hand" has a second <inertial>',
    ),
    "mimic of itself": (
        changed("<axis", MIMIC.split("\n")[0] + "<axis"),
        ':15: <mimic joint="elbow"> of joint "elbow" names',
    ),
    "mimic of no joint": (changed("<axis", "<mimic/><axis"), ':15: <mimic> of joint "elbow" has no attribute joint'),
    "NaN damping": (
        changed("<axis", '<dynamics damping="nan"/><axis'),
        ':15: <dynamics damping="nan"> of joint "elbow"',
    ),
    "an unexpanded macro": (
        changed('name="arm">', 'name="arm" xmlns:xacro="http://wiki.ros.org/xacro"><xacro:wheel/>'),
        ":2: <xacro:wheel> is left, expected a URDF in which xacro has expanded every macro",
    ),
    "an unexpanded expression": (changed('"0 1 0"', '"0 ${a} 0"'), ':15: <axis xyz="0 ${a} 0"> of joint "elbow" holds'),
    "a truncated file": (ARM[: len(ARM) // 2], ": is not well-formed XML ("),
    "an undeclared entity": (changed('"arm"', '"&x;"'), ":2: is not well-formed XML ("),
    "an unclosed element": (changed('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0">'), ": is not well-formed XML ("),
    "an entity bomb": (BILLION_LAUGHS, ":2: has the document type '<!DOCTYPE robot [', expected none"),
    "an external entity": (EXTERNAL, ":2: has the document type '<!DOCTYPE robot [<!ENTITY secret SYSTEM"),
    "a DOCTYPE": (changed("\n<robot", '\n<!DOCTYPE robot SYSTEM "robot.dtd">\n<robot'), ":2: has the document type"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_by_file_line_element_and_value(case: str, tmp_path: Path) -> None:
    text, expected = BROKEN[case]
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    message = refusal(path)
    assert message.startswith("arm.urdf:")
    assert expected in message, message
    assert refusal(text).removeprefix("<text>") == message.removeprefix("arm.urdf")


@pytest.mark.parametrize("cut", range(0, len(ARM.rstrip()), 37))
def test_every_truncation_is_refused(cut: int) -> None:
    refusal(io.StringIO(ARM[:cut]))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "arm.urdf: is empty, expected a <robot> element"),
        (b"\xef\xbb\xbf \n", "arm.urdf: is empty, expected a <robot> element"),
        (b"\x7fELF\x02\x01\0\0", "arm.urdf: starts with b'\\x7fELF"),
        (b"<robot\0 name='a'/>", "and is no XML text, expected a <robot> element"),
        (b"solid cube", "arm.urdf: starts with b'solid cube' and is no XML text"),
        (b"<robot name='\xff\xfe'/>", "arm.urdf:1: is not well-formed XML"),
    ],
    ids=["empty", "only a byte order mark", "binary", "a null byte", "a mesh", "not UTF-8"],
)
def test_what_is_no_text_is_refused(data: bytes, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(data)
    assert expected in refusal(path)
    with path.open("rb") as file:
        assert expected in refusal(file)


def test_a_missing_file_and_a_directory_are_refused(tmp_path: Path) -> None:
    assert refusal(tmp_path / "arm.urdf") == f"{tmp_path / 'arm.urdf'}: no such file, expected a URDF file"
    assert refusal("nowhere/arm.urdf") == f"{Path('nowhere/arm.urdf')}: no such file, expected a URDF file"
    for source in (tmp_path, str(tmp_path)):
        assert refusal(source) == f"{tmp_path} is a directory, expected a URDF file"


@pytest.mark.parametrize("source", ["x" * 300, "x" * 300 + ".urdf", "/" + "x" * 300, Path("x" * 300)])
def test_a_name_too_long_for_a_file_is_refused(source: str | Path) -> None:
    assert "xxx" in refusal(source)


def test_a_file_of_100_mb_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "big.urdf"
    with path.open("wb") as file:
        file.write(ARM.encode())
        file.truncate(100 * 2**20)
    assert refusal(path) == f"big.urdf: has {100 * 2**20} bytes, expected at most {SIZE_LIMIT}"
    with path.open("rb") as file:
        assert refusal(file) == f"big.urdf: has more than {SIZE_LIMIT} bytes, expected at most that"
        assert file.tell() == SIZE_LIMIT + 1


def test_elements_nested_beyond_reason_are_refused() -> None:
    assert "is not well-formed XML" in refusal(changed("</robot>", "<a>" * 10_000 + "</a>" * 10_000 + "</robot>"))


def test_a_source_of_another_type_is_refused() -> None:
    assert refusal(42).startswith("source is of type int, expected a path, URDF text,")
    assert refusal(None).startswith("source is of type NoneType")


def test_long_values_are_cut_in_messages() -> None:
    message = refusal(changed('"0 1 0"', '"' + "0 1 0\n" * 1000 + '"'))
    assert "... has 3000 numbers" not in message
    assert "has 3000 numbers" in message
    assert len(message) < 200


def test_every_refusal_is_a_value_error_of_ours() -> None:
    assert issubclass(UrdfError, SpatialDynError)
    assert issubclass(UrdfError, ValueError)


# --- a yourdfpy.URDF handed in ----------------------------------------------------------------------------


def described(change: Callable[[yourdfpy.URDF], object]) -> yourdfpy.URDF:
    """The arm as yourdfpy has it, with one thing changed."""
    urdf = yourdfpy.URDF.load(io.BytesIO(ARM.encode()), load_meshes=False)
    change(urdf)
    return urdf


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda u: setattr(u.robot.links[1].inertial, "mass", -1.0), 'link "hand" has mass -1.0'),
        (lambda u: setattr(u.robot.links[1].inertial, "mass", None), '<inertial> of link "hand" has no mass'),
        (
            lambda u: u.robot.links[1].inertial.inertia.fill(math.nan),
            'link "hand" has a com or inertia entry that is not',
        ),
        (lambda u: u.robot.joints[0].axis.fill(0.0), 'joint "elbow" has axis of norm 0'),
        (lambda u: setattr(u.robot.joints[0], "axis", np.ones(2)), 'joint "elbow" has axis (1.0, 1.0), expected three'),
        (
            lambda u: u.robot.joints[0].origin.fill(math.nan),
            '<origin> of joint "elbow" has an entry that is not finite',
        ),
        (lambda u: setattr(u.robot.joints[0], "type", "ball"), "joint \"elbow\" has type 'ball', expected one of"),
        (lambda u: setattr(u.robot.joints[0], "name", ""), "a joint has name '', expected a name"),
        (
            lambda u: setattr(u.robot.joints[0], "child", "x"),
            'joint "elbow" has child link "x", which robot "arm" does not',
        ),
        (
            lambda u: setattr(u.robot.joints[0].limit, "upper", -2.0),
            'joint "elbow" has lower limit -1.0 above upper limit',
        ),
    ],
)
def test_values_of_a_description_are_checked(change: Callable[[yourdfpy.URDF], object], expected: str) -> None:
    assert expected in refusal(described(change))


def test_a_manual_description_may_leave_out_what_has_a_default() -> None:
    links = [yourdfpy.Link("a"), yourdfpy.Link("b")]
    joint = yourdfpy.Joint("ab", type="continuous", parent="a", child="b", origin=None)
    urdf = yourdfpy.URDF(yourdfpy.Robot("manual", links, [joint]), build_scene_graph=False)
    assert read_urdf(urdf).joints[0].axis == (1.0, 0.0, 0.0)


# --- robots by name ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("two_link", "urdf/two_link.urdf"),
        ("panda", "panda_description/urdf/panda.urdf"),
        ("ur5", "ur_description/urdf/ur5_robot.urdf"),
        ("ur10_joint_limited", "ur_description/urdf/ur10_joint_limited_robot.urdf"),
        ("talos_full", "talos_data/robots/talos_full_v2.urdf"),
        ("tiago_dual", "tiago_description/robots/tiago_dual.urdf"),
        ("anymal_b_simple_description/anymal", "anymal_b_simple_description/robots/anymal.urdf"),
        ("anymal_c_simple_description/urdf/anymal", "anymal_c_simple_description/urdf/anymal.urdf"),
        ("anymal", "anymal_b_simple_description/robots/anymal.urdf"),
        ("anymal_b", "anymal_b_simple_description/robots/anymal.urdf"),
        ("talos", "talos_data/robots/talos_full_v2.urdf"),
        ("anymal_c", "anymal_c_simple_description/urdf/anymal.urdf"),
        ("hector", "hector_description/robots/quadrotor_base.urdf"),
    ],
)
def test_a_name_finds_its_file(name: str, file: str) -> None:
    assert find_robot(name).as_posix().endswith(file)


def test_an_ambiguous_name_lists_the_candidates() -> None:
    expected = '"allegro_left_hand", "allegro_right_hand"'
    assert refusal("allegro") == f'robot name "allegro" is ambiguous, expected one of {expected}'
    assert '"talos_reduced_box"' in refusal("talos_data/talos")


def test_an_unknown_name_suggests_close_ones() -> None:
    assert (
        "'pnada' is neither a file nor the name of a robot, expected one of them; close names are \"panda\""
        in refusal("pnada")
    )
    refusal("")


@pytest.mark.parametrize("name", ["pand", "talos_ful", "ur5_robo"])
def test_the_beginning_of_a_word_is_no_name(name: str) -> None:
    assert f"'{name}' is neither a file nor the name of a robot" in refusal(name)


@pytest.mark.parametrize("limits", ['lower="inf" upper="inf"', 'lower="-inf" upper="-inf"'])
def test_limits_that_leave_no_position_are_refused(limits: str) -> None:
    assert "leaves no position" in refusal(changed('lower="-1" upper="1"', limits))


def test_an_existing_file_comes_before_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "panda").write_text(ARM)
    (tmp_path / "pendulum").mkdir()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    assert read_urdf("panda").name == "arm"
    assert read_urdf("pendulum").name == "pendulum"
    assert refusal("elsewhere") == "elsewhere is a directory, expected a URDF file"


def test_every_listed_name_finds_its_own_file() -> None:
    names = robot_names()
    assert len(names) == len(set(names.values())) == len(example_robots()) + 5
    assert {name: find_robot(name) for name in names} == names


def test_without_the_examples_the_message_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.setattr(sys, "prefix", os.sep + "nowhere")
    monkeypatch.delenv("CONDA_PREFIX", raising=False)
    assert example_robots() == []
    assert refusal("panda").endswith("example-robot-data is not installed; pip install pin example-robot-data")
    assert read_urdf("pendulum").name == "pendulum"


# --- notes ------------------------------------------------------------------------------------------------

ODD = {
    "no limit": (
        changed('<limit lower="-1" upper="1" velocity="2" effort="3"/>', ""),
        'joint has no <limit>, so it is unlimited: "elbow"',
    ),
    "half a limit": (changed(' lower="-1"', ""), '<limit> lacks lower or upper, taken as 0: "elbow"'),
    "limits in degrees": (
        changed('lower="-1" upper="1"', 'lower="-90" upper="90"'),
        'joint has a limit beyond two turns, of degrees perhaps: "elbow"',
    ),
    "one limit in degrees": (
        changed('upper="1"', 'upper="45"'),
        'joint has a limit beyond two turns, of degrees perhaps: "elbow"',
    ),
    "a negative limit": (
        changed('velocity="2"', 'velocity="-1"'),
        'velocity or effort limit < 0 counts as none: "elbow"',
    ),
    "a negative effort": (changed('effort="3"', 'effort="-3"'), 'velocity or effort limit < 0 counts as none: "elbow"'),
    "a long axis": (changed("0 1 0", "0 2 0"), 'axis is not of unit length, normalised: "elbow"'),
    "a lost mimic": (changed("<axis", '<mimic joint="x"/><axis'), '<mimic> names no joint of the robot: "elbow"'),
    "no mass": (changed('value="2"', 'value="0"'), 'link has mass 0: "hand"'),
    "massless inertia": (changed('value="2"', 'value="0"'), 'link has mass 0 but a rotational inertia: "hand"'),
    "unknown element": (
        changed("<inertial>", "<inertal/><inertial>"),
        "ignored, as URDF does not define it: <inertal> in <link> (1x)",
    ),
    "unknown attribute": (
        changed('xyz="0 0 1" rpy', 'zyx="0 0 1" rpy'),
        "ignored, as URDF does not define it: attribute zyx of <origin> (1x)",
    ),
}


@pytest.mark.parametrize("case", ODD)
def test_what_is_odd_is_accepted_and_noted(case: str) -> None:
    text, expected = ODD[case]
    assert expected in read_urdf(text).notes


@pytest.mark.parametrize(
    ("limits", "kind"),
    [('lower="-12.5" upper="12.5"', "revolute"), ('lower="-inf" upper="inf"', "revolute"),
     ('lower="-90" upper="90"', "prismatic"), ('lower="-90" upper="90"', "continuous")],
)  # fmt: skip
def test_limits_that_are_no_degrees_are_not_odd(limits: str, kind: str) -> None:
    text = changed('lower="-1" upper="1"', limits).replace('type="revolute"', f'type="{kind}"')
    assert read_urdf(text).notes == ()


def test_a_revolute_joint_without_limit_is_unlimited() -> None:
    elbow = joint_of(read_urdf(ODD["no limit"][0]), "elbow")
    assert (elbow.lower, elbow.upper, elbow.velocity, elbow.effort) == (-math.inf, math.inf, math.inf, math.inf)


@pytest.mark.parametrize(
    ("case", "limits"), [("a negative limit", (math.inf, 3.0)), ("a negative effort", (2.0, math.inf))]
)
def test_a_negative_limit_is_none_and_the_other_stays(case: str, limits: tuple[float, float]) -> None:
    elbow = joint_of(read_urdf(ODD[case][0]), "elbow")
    assert (elbow.velocity, elbow.effort) == limits


def test_an_axis_is_normalised() -> None:
    elbow = joint_of(read_urdf(changed("0 1 0", "0 3e-200 4e-200")), "elbow")
    np.testing.assert_allclose(elbow.axis, (0.0, 0.6, 0.8), rtol=0, atol=ROT)


def test_a_moving_link_without_inertial_is_noted() -> None:
    text = changed("</robot>", TIP).replace(
        "</robot>", '<joint name="wrist" type="floating"><parent link="hand"/><child link="tip"/></joint></robot>'
    )
    assert read_urdf(text).notes == ('link that moves has no <inertial>: "tip"',)


def test_a_missing_leader_is_an_error_only_when_mimics_count() -> None:
    text = ODD["a lost mimic"][0]
    assert load_urdf(text).nv == 1
    with pytest.raises(UrdfError) as caught:
        load_urdf(text, mimic=True)
    expected = '<text>:11: <mimic joint="x"> of joint "elbow" names no joint of robot "arm", expected one'
    assert str(caught.value) == expected


# --- leftovers --------------------------------------------------------------------------------------------

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
PROPERTY = '<xacro:property name="length" value="0.5"/>'
ARGUMENT = '<xacro:arg name="prefix" default=""/>'
BLOCK = '<xacro:property name="at"><origin xyz="0 0 1"/></xacro:property>'
MACRO = '<xacro:macro name="unit" params="x"><xacro:property name="y" value="2"/><visual/></xacro:macro>'
NESTED = '<xacro:unless value="0"><xacro:if value="1"><gazebo/><!-- --></xacro:if></xacro:unless>'
CONDITIONS = '<xacro:if value="1"/>' + NESTED
GAZEBO = '<gazebo><a:plugin b:name="x"><a:link name="no"/></a:plugin></gazebo>'
WELD = """<link name="tip"><inertial><mass value="0.5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
</inertial></link><joint name="weld" type="{}"><parent link="hand"/><child link="tip"/><origin xyz="0.1 0.2 0.3"/>
<axis/></joint></robot>"""
HAND = '<link name="hand">'
LEFTOVERS = {
    "properties": (
        changed('name="arm">', f'name="arm" {XACRO}>{PROPERTY}{ARGUMENT}').replace(HAND, HAND + PROPERTY + BLOCK),
        [
            "ignored, as it holds no link or joint: <xacro:arg> (1x)",
            "ignored, as it holds no link or joint: <xacro:property> (3x)",
        ],
    ),
    "macros and conditions": (
        changed('name="arm">', f'name="arm" {XACRO}>{MACRO}{CONDITIONS}').replace(
            HAND, HAND + "<xacro:macro/>" + CONDITIONS + '<xacro:if value="1"><visual><origin/></visual></xacro:if>'
        ),
        [
            "ignored, as it holds no link or joint: <xacro:if> (3x)",
            "ignored, as it holds no link or joint: <xacro:macro> (2x)",
            "ignored, as it holds no link or joint: <xacro:unless> (2x)",
        ],
    ),
    "an undeclared xacro": (
        changed('name="arm">', f'name="arm">{PROPERTY}'),
        [
            "ignored, as it holds no link or joint: <xacro:property> (1x)",
            'no xmlns declares the prefix "xacro", under which nothing is read',
        ],
    ),
    "undeclared prefixes": (
        changed("</robot>", GAZEBO + "</robot>"),
        ['no xmlns declares the prefixes "a", "b", under which nothing is read'],
    ),
    "an undeclared attribute": (
        changed('xyz="0 1 0"', 'c:xyz="1 0 0" xyz="0 1 0"'),
        ['no xmlns declares the prefix "c", under which nothing is read'],
    ),
    "a fixed joint's axis": (
        changed("</robot>", WELD.format("fixed")),
        ['ignored, as the joint has no axis: <axis> without xyz of "weld"'],
    ),
    "two axes of a fixed joint": (
        changed("</robot>", WELD.format("fixed").replace("<axis/>", "<axis/><axis/>")),
        ['ignored, as the joint has no axis: <axis> without xyz of "weld"'],
    ),
    "a floating joint's axis": (
        changed("</robot>", WELD.format("floating")),
        ['ignored, as the joint has no axis: <axis> without xyz of "weld"'],
    ),
    "all of them": (
        changed('name="arm">', f'name="arm" {XACRO}>{PROPERTY}').replace("</robot>", GAZEBO + WELD.format("fixed")),
        [
            "ignored, as it holds no link or joint: <xacro:property> (1x)",
            'no xmlns declares the prefixes "a", "b", under which nothing is read',
            'ignored, as the joint has no axis: <axis> without xyz of "weld"',
        ],
    ),
}


@pytest.mark.parametrize("case", LEFTOVERS)
def test_leftovers_without_link_or_joint_are_noted_and_give_pinocchios_robot(case: str) -> None:
    text, notes = LEFTOVERS[case]
    with pytest.warns(UserWarning, match="robot") as caught:
        model = load_urdf(text)
    assert [(str(w.message), w.filename) for w in caught] == [('robot "arm": ' + "; ".join(notes), __file__)]
    assert list(model.robot.notes)[: len(notes)] == notes
    with pytest.warns(UserWarning, match="robot") as caught:
        assert read_urdf(text) == model.robot
    assert [w.filename for w in caught] == [__file__]
    theirs = pin.buildModelFromXML(text)
    assert list(theirs.names) == list(model.names)
    assert model.total_mass == pytest.approx(pin.computeTotalMass(theirs), rel=ROT, abs=0.0)
    rng = np.random.default_rng(0)
    v, a = rng.normal(size=(2, model.nv))
    q = pin.integrate(theirs, pin.neutral(theirs), rng.normal(size=model.nv))
    np.testing.assert_allclose(
        rnea(model, q, v, a), pin.rnea(theirs, theirs.createData(), q, v, a), rtol=0, atol=100 * ROT
    )


def test_info_shows_what_is_left_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, notes = LEFTOVERS["all of them"]
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    assert main(["info", str(path)]) == 0
    shown = capsys.readouterr().out
    assert all(note in shown for note in notes)


MAY_HOLD = {
    **{
        f"xacro:{tag}": (f"<xacro:{tag}/>", f"<xacro:{tag}> is left, expected a URDF in which xacro has expanded every")
        for tag in ("include", "insert_block", "call", "element", "wheel", "PROPERTY")
    },
    **{
        f"{inner} in {tag}": (f"<xacro:{tag}><x>{text}</x></xacro:{tag}>", f"<xacro:{tag}> is left, expected a URDF in")
        for tag in ("macro", "if", "unless")
        for inner, text in {
            "a link": '<link name="x"/>',
            "a joint": '<joint name="x"/>',
            "a call": "<xacro:wheel/>",
            "a link in a condition": '<xacro:if value="0"><link name="x"/></xacro:if>',
            "an undeclared link": '<a:link name="x"/>',
        }.items()
    },
    "a link in a property": (f'<xacro:property name="x">{HAND}</link></xacro:property>', "<xacro:property> is left"),
    "a call in a property": ('<xacro:property name="x"><xacro:hand/></xacro:property>', "<xacro:property> is left"),
    "an undeclared link": ('<a:link name="x"/>', "<a:link> has a prefix that no xmlns declares, expected one that is"),
    "an undeclared xacro": ("<xacro:wheel/>", "<xacro:wheel> is left"),
}


@pytest.mark.parametrize("case", MAY_HOLD)
@pytest.mark.parametrize("place", ["<robot", '<link name="hand"'])
def test_leftovers_that_may_hold_a_link_or_joint_are_refused(case: str, place: str) -> None:
    left, expected = MAY_HOLD[case]
    space = "" if "undeclared" in case else " " + XACRO
    text = ARM.replace("<robot", "<robot" + space)
    at = text.index(">", text.index(place)) + 1
    assert expected in refusal(text[:at] + "\n" + left + text[at:])


def test_the_prefix_xacro_is_xacros_whatever_namespace_it_names() -> None:
    """xacro itself looks at the prefix alone."""
    text = changed("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/macros"')
    for left in ("<xacro:wheel/>", '<xacro:macro name="m"><link name="x"/></xacro:macro>'):
        assert "is left, expected a URDF in which xacro" in refusal(text.replace("</robot>", left + "</robot>"))
    with pytest.warns(UserWarning, match="holds no link or joint: <xacro:property>"):
        read_urdf(text.replace("</robot>", PROPERTY + "</robot>"))


@pytest.mark.parametrize("place", ['<link name="hand"', '<joint name="elbow"', "<inertial"])
@pytest.mark.parametrize("condition", ["if", "unless"])
def test_a_condition_around_what_a_link_or_joint_is_read_from_is_refused(place: str, condition: str) -> None:
    """Ignored, it would take the inertia or the placement away in silence; around anything else it is ignored."""
    text = changed("<robot", f'<robot xmlns="http://ros.org/wiki/urdf" {XACRO}')
    at = text.index(">", text.index(place)) + 1
    held = {"<link": "<inertial/>", "<join": '<origin xyz="0 0 1"/>', "<iner": '<mass value="2"/>'}[place[:5]]
    for inner in (held, f'<xacro:if value="1">{held}</xacro:if>', f"<!-- -->{held}"):
        left = f'<xacro:{condition} value="1">{inner}</xacro:{condition}>'
        assert f"<xacro:{condition}> is left" in refusal(text[:at] + left + text[at:])
    left = f'<xacro:{condition} value="1"><visual>{held}</visual></xacro:{condition}>'
    with pytest.warns(UserWarning, match=f"holds no link or joint: <xacro:{condition}>"):
        robot = read_urdf(text[:at] + left + text[at:])
    assert (robot.links, robot.joints) == (read_urdf(ARM).links, read_urdf(ARM).joints)


def test_what_is_not_well_formed_stays_refused_among_undeclared_prefixes() -> None:
    many = "".join(f'<gazebo><p{k}:x p{k}:y="1"/></gazebo>' for k in range(300))
    with pytest.warns(UserWarning, match="no xmlns declares the prefixes"):
        assert read_urdf(changed("</robot>", many + "</robot>")) == read_urdf(ARM)
    for broken in ("</robo>", "<x></robot>", "&x;</robot>", "<b:x></b:y></robot>"):
        message = refusal(changed("</robot>", many + GAZEBO + broken))
        assert "is not well-formed XML" in message
        assert "Namespace" not in message
    endless = "".join(f"<gazebo><p{k}:x/></gazebo>" for k in range(3000))
    assert "is not well-formed XML (Namespace prefix p" in refusal(changed("</robot>", endless + "</robot>"))


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "planar"])
def test_an_axis_without_xyz_is_refused_where_it_counts(kind: str) -> None:
    expected = '<axis> of joint "weld" has no attribute xyz, expected 3 finite numbers'
    assert expected in refusal(changed("</robot>", WELD.format(kind)))


# --- angles near a right one ------------------------------------------------------------------------------

NEARLY = changed('xyz="0 0 1" rpy="0 0 0"', 'xyz="0 0 1" rpy="1.57079632679 0 3.14159265359"')
QUARTER = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # Rz(pi) Rx(pi/2)


def rotation(robot: Robot) -> np.ndarray:
    return np.reshape(joint_of(robot, "elbow").placement, (4, 4))[:3, :3]


def test_angles_near_a_right_one_are_kept_and_counted() -> None:
    robot = read_urdf(NEARLY)
    assert robot.notes == ("2 angles within 1e-09 of a right angle kept as written (snap=1e-09 rounds them)",)
    assert (rotation(robot) != QUARTER).any()
    assert rotation(robot)[1, 1] == pytest.approx(-math.cos(1.57079632679), abs=1e-16)
    assert read_urdf(changed('xyz="0 0 1" rpy="0 0 0"', 'xyz="0 0 1" rpy="1.5708 -1.5707963267948966 0"')).notes == ()


def test_snap_rounds_them_to_right_angles() -> None:
    urdf = yourdfpy.URDF.load(io.BytesIO(NEARLY.encode()), load_meshes=False)
    for source in (NEARLY, urdf):
        robot = read_urdf(source, snap=1e-9)
        assert robot.notes == ("2 angles within 1e-09 of a right angle rounded to it",)
        assert (rotation(robot) == QUARTER).all()
        assert (rotation(read_urdf(source, snap=1e-13)) == rotation(read_urdf(source))).all()


@pytest.mark.parametrize("pitch", ["1.57079632679", "-1.57079632679"])
def test_snap_of_a_description_holds_where_roll_and_yaw_merge(pitch: str) -> None:
    text = NEARLY.replace("1.57079632679 0 3.14159265359", f"0.3 {pitch} 0.4")
    urdf = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False)
    R = rotation(read_urdf(urdf, snap=1e-9))
    np.testing.assert_allclose(R, rotation(read_urdf(text, snap=1e-9)), rtol=0, atol=1e-11)
    assert R[2].tolist() == [-math.copysign(1.0, float(pitch)), 0.0, 0.0]


@pytest.mark.parametrize("snap", [-1e-9, 1.0, math.nan])
def test_a_snap_that_is_no_small_angle_is_refused(snap: float) -> None:
    assert refusal(ARM, snap=snap) == f"snap is {snap!r}, expected an angle from 0 to pi/4, or None"


# --- inertias no body can have ----------------------------------------------------------------------------

IMPOSSIBLE = changed('izz="1"', 'izz="3"')
DEFECT = 'link "hand" has principal moments [1 1 3]: the largest is 1.5 times the sum of the others, expected at most 1'


def test_warn_keeps_the_numbers_and_warns_once() -> None:
    with pytest.warns(UserWarning, match="link") as caught:
        robot = read_urdf(IMPOSSIBLE)
    assert [str(w.message) for w in caught] == [
        f'robot "arm": {DEFECT} (kept as they are; inertia="repair" projects them)'
    ]
    assert caught[0].filename == __file__
    assert robot.notes == (DEFECT,)
    assert link_of(robot, "hand").inertia[8] == 3.0
    with pytest.warns(UserWarning, match="link") as caught:
        load_urdf(IMPOSSIBLE)
    assert [w.filename for w in caught] == [__file__]


def test_strict_raises_naming_file_and_line() -> None:
    with pytest.raises(InertiaError) as caught:
        read_urdf(IMPOSSIBLE, inertia="strict")
    assert str(caught.value) == f"<text>:4: {DEFECT}"


def test_repair_projects_and_says_so() -> None:
    with pytest.warns(UserWarning, match="repaired to principal moments"):
        robot = read_urdf(IMPOSSIBLE, inertia="repair")
    assert robot.notes == (DEFECT + "; repaired to principal moments [1.5 1.5 3]",)
    np.testing.assert_allclose(np.reshape(link_of(robot, "hand").inertia, (3, 3)), np.diag([1.5, 1.5, 3.0]))


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(InertiaError, match="'ignore', expected"):
        read_urdf(ARM, inertia="ignore")


# --- the corpus -------------------------------------------------------------------------------------------


def test_all_examples_load_but_the_one_without_a_name() -> None:
    failed, odd = {}, set()
    for path in example_robots():
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                read_urdf(path)
        except UrdfError as error:
            failed[path.name] = str(error)
        if caught:
            odd.add(path)
            assert len(caught) == 1
    assert failed == {"ur3.urdf": "ur3.urdf:6: <robot> has no attribute name, expected a name"}
    assert len(example_robots()) == 69
    assert len(odd) == 18  # two of them are called anymal.urdf


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago_dual", "romeo_laas_small", "icub", "tree", "three_link"])
def test_inertias_placements_axes_and_limits_are_those_of_pinocchio(name: str) -> None:
    robot = quiet(name)
    model = pin.buildModelFromUrdf(str(find_robot(name)), pin.JointModelFreeFlyer())
    assert sum(link.mass for link in robot.links) == pytest.approx(pin.computeTotalMass(model), rel=1e-14, abs=0.0)
    data = model.createData()
    world = {robot.root: np.eye(4)}
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    pending = [robot.root]
    while pending:
        for joint in robot.children[pending.pop()]:
            world[joint.child] = world[joint.parent] @ np.reshape(joint.placement, (4, 4))
            pending.append(joint.child)
            frame = model.getFrameId(joint.name, pin.FIXED_JOINT if joint.kind == "fixed" else pin.JOINT)
            np.testing.assert_allclose(world[joint.child], data.oMf[frame].homogeneous, rtol=0, atol=1e-13)
            if joint.kind in ("revolute", "prismatic", "continuous"):
                index = model.getJointId(joint.name)
                S = np.ravel(data.joints[index].S)
                given = S[:3] if joint.kind == "prismatic" else S[3:]
                np.testing.assert_allclose(joint.axis, given, rtol=0, atol=ROT)
            if joint.kind in ("revolute", "prismatic"):
                k = model.idx_qs[model.getJointId(joint.name)]
                assert (joint.lower, joint.upper) == (model.lowerPositionLimit[k], model.upperPositionLimit[k])
    pin.crba(model, data, pin.neutral(model))
    moment, inertia = np.zeros(3), np.zeros((3, 3))
    for link in robot.links:
        X = world[link.name]
        c = X[:3, :3] @ link.com + X[:3, 3]
        moment += link.mass * c
        inertia += X[:3, :3] @ np.reshape(link.inertia, (3, 3)) @ X[:3, :3].T
        inertia += link.mass * (c @ c * np.eye(3) - np.outer(c, c))
    theirs = data.Ycrb[1].matrix()
    np.testing.assert_allclose(inertia, theirs[3:, 3:], rtol=0, atol=1e-13 * abs(theirs).max())
    np.testing.assert_allclose(pin.skew(moment), theirs[3:, :3], rtol=0, atol=1e-13 * abs(theirs).max())


def test_importing_the_module_imports_no_xml_library() -> None:
    code = "import spatialdyn.urdf, sys; print([m for m in ('lxml', 'yourdfpy', 'trimesh') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_loading_a_file_imports_no_numba_and_no_yourdfpy() -> None:
    code = """
import sys, spatialdyn as sd
sd.load_urdf("two_link")
print([m for m in ("numba", "llvmlite", "yourdfpy", "trimesh", "scipy", "concurrent.futures") if m in sys.modules])
print("lxml" in sys.modules)
"""
    assert run_python(code).split("\n")[:2] == ["[]", "True"]


def test_a_description_without_yourdfpys_repairs_is_the_files() -> None:
    """Negative zeros, angles, an <inertial> in a turned frame, limits, dynamics and a mimic, as yourdfpy has them."""
    text = """<robot name="r"><link name="a"><inertial><origin xyz="-0 0.1 1e-3" rpy="0.3 -1.1 2.7"/><mass value="2"/>
    <inertia ixx=".3" ixy="-0.01" ixz="0.02" iyy="0.2" iyz="-0" izz="0.25"/></inertial></link>
    <link name="b"/><link name="c"/>
    <joint name="ab" type="revolute"><parent link="a"/><child link="b"/><origin rpy="1.57079632679 0 -3.1"/>
    <axis xyz="0 -0 2"/><limit lower="-inf" upper="2" velocity="-1" effort="3"/><dynamics damping="0.5"/></joint>
    <joint name="bc" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 -0 .5"/>
    <limit upper="1"/><mimic joint="ab" multiplier="-2" offset="0.1"/></joint></robot>"""
    found = read_urdf(text)
    theirs = read_urdf(yourdfpy.URDF.load(io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False))
    assert repr((found.links, found.joints)) == repr((theirs.links, theirs.joints))
