"""Models from URDF, SRDF and other models, and the sample models."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.calls.random_configurations import random_configuration
from spatialdyn.compat.pinocchio.model.library_model import library_model
from spatialdyn.urdf.load import example_robots, find_robot

from .same import assert_close, assert_same_model

theirs = pytest.importorskip("pinocchio")

ORACLE = 1e-11  # relative to the largest entry, the bound of the library for robots
UNPHYSICAL = pytest.mark.filterwarnings("ignore:.*principal moments")  # some robots have such inertias
SOLID = '<inertial><origin xyz="0 0.1 1" rpy="0.1 0.2 0.3"/><mass value="{}"/>' + (
    '<inertia ixx="1" iyy="1.5" izz="2" ixy="0.1" ixz="0" iyz="0"/></inertial>'
)


def link(name: str, mass: float = 0.0) -> str:
    return f'<link name="{name}">{SOLID.format(mass) if mass else ""}</link>'


def joint(name: str, kind: str, parent: str, child: str, axis: str = "0 0 1", rest: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="1 2 3" rpy="0.3 0.2 0.1"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>{rest}</joint>'
    )


LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/><dynamics damping="0.5" friction="0.25"/>'
EVERY_JOINT = "".join(
    [
        '<robot name="every">', link("base", 4.0), link("f", 2.0), joint("jf", "fixed", "base", "f"), link("b", 2.0),
        joint("j1", "revolute", "f", "b", "0 0 -1", LIMIT), link("g"), joint("jg", "fixed", "b", "g"), link("c", 1.0),
        joint("j2", "continuous", "g", "c", "1 0 0", '<limit effort="3" velocity="4"/>'), link("d", 1.0),
        joint("j3", "planar", "c", "d", "0 0 1", LIMIT), link("e", 1.0), joint("j4", "floating", "d", "e"),
        link("h", 1.0), joint("j5", "prismatic", "e", "h", "1 2 0", LIMIT), link("i", 1.0),
        joint("j6", "continuous", "h", "i", "0 1 1"), link("k", 1.0),
        joint("j7", "revolute", "i", "k", "0 1 0", LIMIT + '<mimic joint="j1" multiplier="2" offset="0.1"/>'),
        "</robot>",
    ]
)  # fmt: skip
TOOL = "".join(
    [
        '<robot name="tool">', link("tool_base", 2.0), link("tool_x"), joint("tool_f", "fixed", "tool_base", "tool_x"),
        link("finger", 0.5), joint("tool_j", "prismatic", "tool_x", "finger", "1 0 0", LIMIT), "</robot>",
    ]
)  # fmt: skip


def base_of(pin: Any) -> Any:
    """A model that already has a joint."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "first")
    model.appendBodyToJoint(1, pin.Inertia(1.0, np.ones(3), 9.0 * np.eye(3)), pin.SE3.Identity())
    KEPT.append(model)
    return model


KEPT: list[Any] = []  # the wheel returns a reference to the model that it appends to, and does not keep it alive
WAYS: dict[str, Callable[[Any], Any]] = {
    "fixed": lambda pin: pin.buildModelFromXML(EVERY_JOINT),
    "floating": lambda pin: pin.buildModelFromXML(EVERY_JOINT, pin.JointModelFreeFlyer()),
    "planar root": lambda pin: pin.buildModelFromXML(EVERY_JOINT, pin.JointModelPlanar(), "base_joint"),
    "mimic": lambda pin: pin.buildModelFromXML(EVERY_JOINT, mimic=True),
    "mimic by place": lambda pin: pin.buildModelFromXML(EVERY_JOINT, pin.JointModelFreeFlyer(), "r", True),
    "into a model": lambda pin: pin.buildModelFromXML(EVERY_JOINT, base_of(pin)),
    "floating into a model": lambda pin: pin.buildModelFromXML(EVERY_JOINT, pin.JointModelFreeFlyer(), base_of(pin)),
    "by name": lambda pin: pin.buildModelFromXML(
        EVERY_JOINT, root_joint=pin.JointModelFreeFlyer(), root_joint_name="r", model=base_of(pin), mimic=False
    ),
}


def assert_same_dynamics(mine: Any, other: Any) -> None:
    """rnea, crba and poses at a random state."""
    compiled, data, rng = library_model(mine), other.createData(), np.random.default_rng(0)
    q = random_configuration(compiled.model, rng)
    v, a = rng.normal(size=(2, compiled.model.nv))
    assert_close(sd.rnea(compiled.model, q, v, a), theirs.rnea(other, data, q, v, a), "rnea", ORACLE)
    zero = np.zeros_like(v)
    bias = theirs.rnea(other, data, q, v, zero)
    # the columns of rnea: the wheel's crba contradicts its rnea with this mimic joint
    M = np.array([theirs.rnea(other, data, q, v, e) - bias for e in np.eye(len(v))]).reshape(len(v), len(v)).T
    assert_close(sd.crba(compiled.model, q), M, "crba", ORACLE)


# --- URDF ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_read_a_urdf_gives_the_same_model(way: str) -> None:
    mine, other = WAYS[way](ours), WAYS[way](theirs)
    assert_same_model(mine, other)
    assert_same_dynamics(mine, other)


def test_a_model_to_append_to_is_returned() -> None:
    model = base_of(ours)
    assert ours.buildModelFromXML(TOOL, model) is model
    assert (model.name, model.nq) == ("tool", 2)


def test_a_path_may_be_a_path(tmp_path: Path) -> None:
    (tmp_path / "tool.urdf").write_text(TOOL)
    assert ours.buildModelFromUrdf(tmp_path / "tool.urdf") == ours.buildModelFromUrdf(str(tmp_path / "tool.urdf"))


def test_bad_arguments_are_refused(tmp_path: Path) -> None:
    for arguments in ((3,), (ours.Model(), ours.JointModelRX()), ("a", "b")):
        with pytest.raises(TypeError, match="expected joint, name, Model or bool, in this order"):
            ours.buildModelFromXML(TOOL, *arguments)
    with pytest.raises(TypeError, match="got root='r', expected it once"):
        ours.buildModelFromXML(TOOL, root="r")
    with pytest.raises(TypeError, match="urdf_filename is a int"):
        ours.buildModelFromUrdf(3)
    with pytest.raises(sd.UrdfError, match="no such file"):
        ours.buildModelFromUrdf(tmp_path / "missing.urdf")
    with pytest.raises(sd.ModelError, match="expected URDF text"):
        ours.buildModelFromXML("panda")
    with pytest.raises(sd.ModelError, match='joint "j7" of robot "every" mimics "j9", expected a joint before it'):
        ours.buildModelFromXML(EVERY_JOINT.replace('mimic joint="j1"', 'mimic joint="j9"'), mimic=True)


def test_the_axis_of_a_plane_is_z_and_a_warning_says_so() -> None:
    text = '<robot name="p"><link name="a"/><link name="b"/>' + joint("j", "planar", "a", "b", "1 0 0") + "</robot>"
    with pytest.warns(UserWarning, match='planar joint "j" has axis'):
        mine = ours.buildModelFromXML(text)
    assert_same_model(mine, theirs.buildModelFromXML(text))


def test_models_come_with_what_stands_for_their_geometry(tmp_path: Path) -> None:
    path = tmp_path / "tool.urdf"
    path.write_text(TOOL)
    for arguments, named in (
        ((str(tmp_path), ours.JointModelFreeFlyer()), {}),
        ((str(tmp_path), ours.JointModelFreeFlyer(), True, None, None), {}),
        ((), {"root_joint": ours.JointModelFreeFlyer(), "root_joint_name": "root_joint"}),
        (([], ours.JointModelFreeFlyer(), "root_joint", False), {"mimic": True}),
    ):
        model, collision, visual = ours.buildModelsFromUrdf(path, *arguments, **named)
        assert model == ours.buildModelFromUrdf(path, ours.JointModelFreeFlyer())
    assert len(ours.buildModelsFromUrdf(path, geometry_types=ours.VISUAL)) == 2
    data, nothing, _ = ours.createDatas(model, None, collision)
    assert model.check(data)
    assert nothing is None
    assert (visual.ngeoms, visual.geometryObjects, visual.collisionPairs) == (0, [], [])
    reduced_model, kept = ours.buildReducedModel(model, visual, [2], np.eye(8)[6])
    assert (reduced_model.nq, kept.ngeoms) == (7, 0)
    with pytest.raises(TypeError, match="got 2 arguments and package_dirs"):
        ours.buildModelsFromUrdf(path, None, None, package_dirs=None)


# --- models of models ----------------------------------------------------------------------------------------


def reduced(pin: Any, model: Any, names: tuple[str, ...]) -> Any:
    q = np.linspace(0.1, 1.0, model.nq)
    for k in range(1, model.njoints):  # unit parts
        j = model.joints[k]
        part = q[j.idx_q : j.idx_q + j.nq]
        if j.nq == 7:
            part[3:] /= np.linalg.norm(part[3:])
        if j.nq == 2:
            part /= np.linalg.norm(part)
        if j.nq == 4:
            part[2:] /= np.linalg.norm(part[2:])
    return pin.buildReducedModel(model, [model.getJointId(name) for name in names], q)


@pytest.mark.parametrize(
    "names", [(), ("j1",), ("j2", "j3"), ("j4",), ("root_joint", "j6"), ("j7", "j5", "j1", "j2"), ("root_joint",)]
)
def test_a_reduced_model_is_the_same(names: tuple[str, ...]) -> None:
    def build(pin: Any) -> Any:
        model = pin.buildModelFromXML(EVERY_JOINT, pin.JointModelFreeFlyer())
        model.armature = np.linspace(0.1, 1.0, model.nv)
        model.rotorGearRatio = np.linspace(0.1, 1.0, model.nv)
        model.gravity.linear = np.array([1.0, 2.0, 3.0])
        model.referenceConfigurations["home"] = np.linspace(0.0, 1.0, model.nq)
        model.addFrame(pin.Frame("sensor", 3, 4, pin.SE3(np.eye(3), np.ones(3)), pin.FrameType.SENSOR))
        return reduced(pin, model, names)

    mine, other = build(ours), build(theirs)
    assert_same_model(mine, other, but="parentFrame")
    assert_same_dynamics(mine, other)
    # the wheel makes the frame of a locked joint its own parent
    before = [(f.name, f.parentFrame) for f in ours.buildModelFromXML(EVERY_JOINT, ours.JointModelFreeFlyer()).frames]
    assert [(f.name, f.parentFrame) for f in mine.frames][:-1] == before


def test_a_reduction_that_makes_no_sense_is_refused() -> None:
    model = ours.buildModelFromXML(EVERY_JOINT, mimic=True)
    q = np.zeros(model.nq)
    for joints in ([0], [2, 2]):
        with pytest.raises(sd.ModelError, match="cannot be locked"):
            ours.buildReducedModel(model, joints, q)
    with pytest.raises(sd.ModelError, match="joint index is 99"):
        ours.buildReducedModel(model, [99], q)
    with pytest.raises(sd.ShapeError, match="reference_configuration has 3 numbers"):
        ours.buildReducedModel(model, [1], np.zeros(3))
    with pytest.raises(TypeError, match="joint index is a str"):
        ours.buildReducedModel(model, ["j1"], q)
    with pytest.raises(sd.ModelError, match='joint "j7" mimics "j1", expected both locked'):
        ours.buildReducedModel(model, [model.getJointId("j1")], q)
    both = [model.getJointId("j1"), model.getJointId("j7")]
    assert ours.buildReducedModel(model, both, q).mimicking_joints == []


def test_a_joint_made_mimic_is_the_same() -> None:
    def build(pin: Any) -> Any:
        model = pin.buildSampleModelManipulator()
        model.armature = np.linspace(0.1, 1.0, model.nv)
        return pin.transformJointIntoMimic(model, 2, 4, 2.0, 0.3)

    mine, other = build(ours), build(theirs)
    assert_same_model(mine, other, but="lowerEffortLimit")
    assert (mine.joints[4].scaling, mine.joints[4].offset) == (2.0, 0.3)
    assert library_model(mine).model.mimic_matrix is not None
    with pytest.raises(sd.ModelError, match="joint 2 cannot mimic joint 4"):
        ours.transformJointIntoMimic(ours.buildSampleModelManipulator(), 4, 2, 1.0, 0.0)


@pytest.mark.parametrize("frame", ["universe", "rleg_elbow_body", "larm_effector_body", "root_joint"])
def test_an_appended_model_is_the_same(frame: str) -> None:
    def build(pin: Any) -> Any:
        a, b = pin.buildSampleModelHumanoid(), pin.buildModelFromXML(TOOL)
        a.lowerEffortLimit = -a.upperEffortLimit
        a.referenceConfigurations["home"] = pin.neutral(a) if pin is theirs else np.eye(a.nq)[6]
        b.referenceConfigurations["home"] = np.ones(b.nq)
        placement = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.ones(3))
        return pin.appendModel(a, b, a.getFrameId(frame), placement)

    mine, other = build(ours), build(theirs)
    assert_same_model(mine, other, but="name")
    assert_same_dynamics(mine, other)


def test_a_name_in_place_of_an_index_or_a_joint_is_a_type_error() -> None:
    for pin in (ours, theirs):
        a, b = pin.buildSampleModelManipulator(), pin.buildModelFromXML(EVERY_JOINT)
        with pytest.raises(TypeError):
            pin.appendModel(a, b, "effector_body", pin.SE3.Identity())
        with pytest.raises(TypeError):
            pin.buildModelFromXML(EVERY_JOINT, "root_joint")


def test_an_appended_geometry_is_the_same() -> None:
    coal, found = pytest.importorskip("coal"), []
    for pin in (ours, theirs):
        a, b = pin.buildSampleModelManipulator(), pin.buildModelFromXML(TOOL)
        shapes = []
        for model in (a, b):
            shapes.append(pin.GeometryModel())
            for k in (0, 1, model.njoints - 1):
                place, at = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.arange(3.0) + k), model.getFrameId(model.names[k])
                name = f"{model.name} {shapes[-1].ngeoms}"
                shapes[-1].addGeometryObject(pin.GeometryObject(name, k, at, place, coal.Sphere(0.1)))
            shapes[-1].addCollisionPair(pin.CollisionPair(0, 2))
        whole, shape = pin.appendModel(a, b, *shapes, a.getFrameId("effector_body"), pin.SE3(np.eye(3), np.ones(3)))
        objects = [(x.name, x.parentJoint, x.parentFrame) for x in shape.geometryObjects]
        places = np.array([x.placement.homogeneous for x in shape.geometryObjects])
        found.append((objects, [(x.first, x.second) for x in shape.collisionPairs], whole.njoints, places))
    assert found[0][:3] == found[1][:3]
    np.testing.assert_allclose(found[0][3], found[1][3], rtol=0.0, atol=1e-12)


def test_appending_keeps_gravity_and_armature_and_refuses_two_of_a_name() -> None:
    a, b = ours.buildSampleModelManipulator(), ours.buildModelFromXML(TOOL)
    a.gravity.linear[2], a.name = -1.6, "arm"
    a.armature[:], b.armature[:] = 0.5, 0.25
    whole = ours.appendModel(a, b, a.getFrameId("effector_body"), ours.SE3.Identity())
    assert whole.gravity == a.gravity
    assert whole.name == "arm"
    assert whole.armature.tolist() == [0.5] * 6 + [0.25]
    at = whole.getFrameId("effector_body")
    assert whole.frames[whole.getFrameId("tool_base")].parentFrame == at
    with pytest.raises(sd.ModelError, match='both models have a joint "elbow_joint"'):
        ours.appendModel(a, a, 0, ours.SE3.Identity())
    b.frames[1].name = "elbow_body"
    with pytest.raises(sd.ModelError, match='both models have a frame "elbow_body"'):
        ours.appendModel(a, b, 0, ours.SE3.Identity())
    with pytest.raises(sd.ModelError, match="frame index is 99"):
        ours.appendModel(a, b, 99, ours.SE3.Identity())


# --- SRDF ----------------------------------------------------------------------------------------------------

SRDF = """<robot name="every"><group_state name="home" group="all"><joint name="j1" value="0.5"/>
<joint name="j2" value="0.25"/><joint name="root_joint" value="1 2 3 0 0 0 1"/><joint name="other" value="1"/>
</group_state>
<group_state name="rest" group="all"/>
<rotor_params><joint name="j1" mass="1e-3" gear_ratio="100"/><joint name="j5" mass="2" gear_ratio="3."/></rotor_params>
</robot>"""


def test_configurations_and_rotors_of_an_srdf_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "every.srdf").write_text(SRDF)

    def build(pin: Any) -> Any:
        model = pin.buildModelFromXML(EVERY_JOINT, pin.JointModelFreeFlyer())
        pin.loadReferenceConfigurations(model, str(tmp_path / "every.srdf"))
        model.armature = np.full(model.nv, 0.5)
        assert pin.loadRotorParameters(model, str(tmp_path / "every.srdf"))
        return model

    mine, other = build(ours), build(theirs)
    assert_same_model(mine, other)
    armature = mine.armature.copy()
    ours.loadRotorParameters(mine, tmp_path / "every.srdf")
    assert_close(mine.armature, armature, "armature")
    fresh = ours.buildModelFromXML(EVERY_JOINT, ours.JointModelFreeFlyer())
    ours.loadReferenceConfigurationsFromXML(fresh, SRDF)
    for name, q in fresh.referenceConfigurations:
        assert (q == mine.referenceConfigurations[name]).all()
    name, q = next(iter(fresh.referenceConfigurations))
    assert (name, q[0]) == ("home", 1.0)
    with pytest.raises(KeyError):
        fresh.referenceConfigurations["nope"]


@pytest.mark.parametrize("robot", ["panda", "talos_full_v2", "kinova"])
@UNPHYSICAL
def test_srdf_files_of_robots_are_the_same(robot: str) -> None:
    if not example_robots():
        pytest.skip("example-robot-data is not installed")
    urdf = find_robot(robot)
    (srdf, *_) = sorted((urdf.parents[1] / "srdf").glob("*.srdf"))

    def build(pin: Any) -> Any:
        model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        pin.loadReferenceConfigurations(model, str(srdf), False)
        return model

    assert_same_model(build(ours), build(theirs))


def test_a_broken_srdf_is_refused(tmp_path: Path) -> None:
    model = ours.buildModelFromXML(EVERY_JOINT)
    for text, what in (
        ("<robot>", "<text>:1: is not well-formed XML"),
        ("<robot><group_state/></robot>", "<text>:1: <group_state> has no attribute name"),
        (SRDF.replace('"0.5"', '"nan"'), '<joint value="nan"> of joint "j1", expected finite numbers'),
        (SRDF.replace('"0.5"', '"1 2 3"'), 'joint "j1" has 3 values, expected 1'),
    ):
        with pytest.raises(sd.UrdfError, match=what):
            ours.loadReferenceConfigurationsFromXML(model, text)
    with pytest.raises(sd.UrdfError, match="no such file"):
        ours.loadReferenceConfigurations(model, tmp_path / "missing.srdf")
    (tmp_path / "none.srdf").write_text("<robot/>")
    with pytest.raises(sd.UrdfError, match="has no <rotor_params>"):
        ours.loadRotorParameters(model, tmp_path / "none.srdf")
    with pytest.raises(TypeError, match="srdf_filename is a int"):
        ours.loadRotorParameters(model, 3)


# --- samples -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("arguments", [("Manipulator",), ("Manipulator", True), ("Humanoid",), ("Humanoid", False)])
def test_sample_models_are_the_same(arguments: tuple[Any, ...]) -> None:
    name, *rest = arguments
    mine, other = (getattr(pin, f"buildSampleModel{name}")(*rest) for pin in (ours, theirs))
    assert_same_model(mine, other, but="lowerEffortLimit")
    assert (mine.lowerEffortLimit == -other.upperEffortLimit).all()
    assert_same_dynamics(mine, other)


@pytest.mark.parametrize("arguments", [(), (False,), (True, True)])
def test_random_humanoids_have_the_same_tree(arguments: tuple[bool, ...]) -> None:
    mine, other = (pin.buildSampleModelHumanoidRandom(*arguments) for pin in (ours, theirs))
    for name in ("nq", "nv", "njoints", "nframes", "nbodies"):
        assert getattr(mine, name) == getattr(other, name)
    assert list(mine.names) == other.names.tolist()
    assert [j.shortname() for j in mine.joints] == [j.shortname() for j in other.joints]
    assert [(f.name, f.parentJoint, f.parentFrame) for f in mine.frames] == [
        (f.name, f.parentJoint, f.parentFrame) for f in other.frames
    ]
    assert (mine.lowerPositionLimit <= mine.upperPositionLimit).all()
    if arguments in ((), (True, True)):
        assert np.isfinite(mine.upperPositionLimit).all()
        assert np.abs(mine.upperPositionLimit).max() <= 2.0
    assert library_model(mine).model.total_mass > 0.0


def test_the_seed_repeats_a_random_humanoid() -> None:
    ours.seed(3)
    first = ours.buildSampleModelHumanoidRandom()
    ours.seed(3)
    assert ours.buildSampleModelHumanoidRandom() == first
    assert ours.buildSampleModelHumanoidRandom() != first


# --- what xacro has left ----------------------------------------------------------------------------------

LEFTOVERS = """<robot name="r" xmlns:xacro="http://ros.org/x">
<xacro:include filename="a.xacro"/><xacro:my_arm prefix="l"/><xacro:macro name="m"><link name="inner"/></xacro:macro>
<link name="a"/>{more}
<link name="b"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="revolute"><xacro:if value="1"><origin xyz="1 2 3"/></xacro:if><parent link="a"/><child link="b"/>
<axis xyz="0 1 0"/><xacro:insert_block name="o"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.mark.parametrize("more", ["", '<xacro:link name="c"/>', '<u:joint name="k" type="fixed"/>'])
def test_elements_of_xacro_are_left_out_as_in_the_wheel_with_a_warning(more: str) -> None:
    text = LEFTOVERS.format(more=more)
    said = r"not read, as Pinocchio does not, .*<xacro:if> \(1x\), <xacro:include> \(1x\), .*<xacro:my_arm> \(1x\)"
    with pytest.warns(UserWarning, match=said) as warned:
        mine = ours.buildModelFromXML(text)
    assert len(warned) == 1
    other = theirs.buildModelFromXML(text)
    assert list(mine.names) == list(other.names)
    assert [x.name for x in mine.frames] == [x.name for x in other.frames]
    assert mine.jointPlacements[1].translation.tolist() == other.jointPlacements[1].translation.tolist()
    assert mine.inertias[1].mass == other.inertias[1].mass == 2.0
    with pytest.raises(sd.UrdfError, match="<xacro:include> is left, expected"):
        sd.load_urdf(text)
