"""Joint models: attributes, motion, and dynamics of each kind."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.calls.random_configurations import random_configuration
from spatialdyn.compat.pinocchio.model.library_model import library_model

from .same import PLACED, assert_close, assert_same_model

theirs = pytest.importorskip("pinocchio")

ORACLE = 1e-11  # relative to the largest entry, the bound of the library for robots
AXIS = np.array([1.0, -2.0, 2.0]) / 3.0
TURN = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])


def composite(pin: Any) -> Any:
    """A joint of four parts with a placement before two of them."""
    joint = pin.JointModelComposite(pin.JointModelRX(), pin.SE3(TURN, np.array([0.1, 0.2, 0.3])), "a")
    joint.addJoint(pin.JointModelRUBY())
    joint.addJoint(pin.JointModelPZ(), pin.SE3(TURN.T, np.array([0.3, 0.2, 0.1])), "c")
    joint.addJoint(pin.JointModelSpherical())
    return joint


KINDS: dict[str, Any] = {
    **{name: lambda pin, name=name: getattr(pin, f"JointModel{name}")() for name in (
        "RX", "RY", "RZ", "PX", "PY", "PZ", "RUBX", "RUBY", "RUBZ", "Spherical", "SphericalZYX", "Translation",
        "Planar", "FreeFlyer",
    )},
    "RevoluteUnaligned": lambda pin: pin.JointModelRevoluteUnaligned(AXIS),
    "PrismaticUnaligned": lambda pin: pin.JointModelPrismaticUnaligned(*AXIS),
    **{f"H{x}": lambda pin, x=x: getattr(pin, f"JointModelH{x}")(0.3) for x in "XYZ"},
    "HelicalUnaligned": lambda pin: pin.JointModelHelicalUnaligned(AXIS, -0.7),
    "Universal": lambda pin: pin.JointModelUniversal(AXIS, np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)),
    "Composite": composite,
}  # fmt: skip


def chain(pin: Any, *joints: Any) -> Any:
    """A chain of joints with rotated placements and a body each."""
    model = pin.Model()
    for k, joint in enumerate(joints):
        model.addJoint(k, joint, pin.SE3(TURN, np.array([0.1, 0.2 * k, -0.3])), f"j{k}")
        body = pin.Inertia(1.0 + k, np.array([0.1, -0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
        model.appendBodyToJoint(k + 1, body, pin.SE3(TURN.T, np.array([0.0, 0.1, 0.0])))
    return model


def assert_same_dynamics(mine: Any, other: Any) -> None:
    """rnea, crba, aba and the poses of all joints at two states."""
    compiled, data, rng = library_model(mine), other.createData(), np.random.default_rng(0)
    model = compiled.model
    assert (model.nq, model.nv) == (other.nq, other.nv)
    for _ in range(2):
        q = random_configuration(model, rng)
        v, a = rng.normal(size=(2, model.nv))
        tau = theirs.rnea(other, data, q, v, a)
        assert_close(sd.rnea(model, q, v, a), tau, "rnea", ORACLE)
        assert_close(sd.crba(model, q), theirs.crba(other, data, q), "crba", ORACLE)
        assert_close(sd.aba(model, q, v, tau), a, "aba", 1e-9)  # M has a condition of some 1e3
        theirs.forwardKinematics(other, data, q)
        poses = sd.forward_kinematics(model, q)
        if compiled.joints is not None:
            poses = poses[compiled.joints]
        assert_close(poses, [X.homogeneous for X in data.oMi], "poses", ORACLE)
    assert (model.bodies["joint"][compiled.rows[1:]] > 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_attributes_of_a_joint_equal_the_wheels(kind: str) -> None:
    mine, other = KINDS[kind](ours), KINDS[kind](theirs)
    for name in ("nq", "nv", "nvExtended", "id", "idx_q", "idx_v", "idx_vExtended"):
        assert getattr(mine, name) == getattr(other, name)
    assert mine.shortname() == mine.classname() == other.shortname()
    if kind != "Composite":
        assert repr(mine) == repr(other)
    for name in ("hasConfigurationLimit", "hasConfigurationLimitInTangent"):
        size = getattr(mine, "nq" if name.endswith("Limit") else "nv")  # the wheel's helical joints have one too many
        assert getattr(mine, name) == list(getattr(other, name))[:size]
    group, wanted = mine.lieGroup(), other.lieGroup()
    assert (group.name, group.nq, group.nv) == (wanted.name, wanted.nq, wanted.nv)
    twin = KINDS[kind](ours)
    for equal in (twin, copy.copy(mine), copy.deepcopy(mine), pickle.loads(pickle.dumps(mine)), ours.JointModel(mine)):
        assert equal == mine
        assert equal is not mine
    twin.setIndexes(1, 0, 0)
    assert twin != mine
    assert not twin.hasSameIndexes(mine)
    assert mine != ours.JointModelRX() or kind == "RX"


@pytest.mark.parametrize("kind", KINDS)
def test_calc_gives_the_same_data(kind: str) -> None:
    mine, other = (chain(pin, KINDS[kind](pin)) for pin in (ours, theirs))
    a, b = mine.joints[1], other.joints[1]
    data, wanted = a.createData(), b.createData()
    q = random_configuration(library_model(mine).model, np.random.default_rng(0))
    v = np.random.default_rng(1).normal(size=mine.nv)
    a.calc(data, q, v)
    b.calc(wanted, q, v)
    assert data.shortname() == repr(data) == wanted.shortname()
    assert_close(data.M.homogeneous, wanted.M.homogeneous, "M")
    assert_close(data.S, wanted.S, "S")
    assert_close(data.v.vector, wanted.v.vector, "v")
    assert_close(data.c.vector, wanted.c.vector, "c")
    assert_close(data.joint_q, q, "joint_q")
    assert_close(data.joint_v, v, "joint_v")
    assert [data.U.shape, data.Dinv.shape, data.UDinv.shape] == [wanted.U.shape, wanted.Dinv.shape, wanted.UDinv.shape]


@pytest.mark.parametrize("kind", KINDS)
def test_dynamics_behind_a_joint_are_the_same(kind: str) -> None:
    mine, other = (chain(pin, KINDS[kind](pin), KINDS[kind](pin), pin.JointModelRY()) for pin in (ours, theirs))
    assert_same_model(mine, other)
    for model in (mine, other):
        model.armature = np.linspace(0.1, 0.5, model.nv)
    assert_same_dynamics(mine, other)


def test_an_unbounded_unaligned_joint_is_what_a_urdf_makes_of_one() -> None:
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="2"/><origin xyz="0.1 0.2 0.3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="1 -2 2"/></joint></robot>"""
    mine, other = ours.buildModelFromXML(text), theirs.buildModelFromXML(text)
    assert_same_model(mine, other)
    assert_same_dynamics(mine, other)
    assert (mine.joints[1].axis == ours.JointModelRevoluteUnboundedUnaligned(1.0, -2.0, 2.0).axis).all()


def test_mimic_joints_follow_with_their_own_motion() -> None:
    def build(pin: Any) -> Any:
        model = chain(pin, pin.JointModelRX(), pin.JointModelPY())
        model.addJoint(2, pin.JointModelMimic(model.joints[1], 2.0, 0.1), pin.SE3(TURN, np.ones(3)), "follower")
        model.appendBodyToJoint(3, pin.Inertia(2.0, np.ones(3), 5.0 * np.eye(3)), pin.SE3.Identity())
        return model

    mine, other = build(ours), build(theirs)
    assert_same_model(mine, other)
    a, b = mine.joints[3], other.joints[3].extract()
    assert repr(a) == repr(b)
    assert (a.scaling, a.offset, a.leader) == (b.scaling, b.offset, 1)
    assert pickle.loads(pickle.dumps(a)) == a == a.copy()
    q, v = np.array([0.3, 0.2]), np.array([0.5, -0.1])
    acceleration = np.array([0.1, 0.7])
    data = other.createData()
    assert_close(
        sd.rnea(library_model(mine).model, q, v, acceleration),
        theirs.rnea(other, data, q, v, acceleration),
        "rnea",
        ORACLE,
    )
    assert_close(sd.crba(library_model(mine).model, q), theirs.crba(other, data, q), "crba", ORACLE)
    own = a.createData()
    a.calc(own, q, v)
    assert_close(own.joint_q, [0.7], "joint_q")
    assert_close(own.v.angular, [1.0, 0.0, 0.0], "v")
    a.scaling, a.offset = 3.0, 0.0
    assert library_model(mine).model.mimic_matrix is not None
    assert library_model(mine).model.mimic_matrix[2, 0] == 3.0
    assert a != b


def test_axes_can_be_changed_and_have_unit_length() -> None:
    model = chain(ours, ours.JointModelRevoluteUnaligned(0.0, 0.0, 2.0), ours.JointModelUniversal(1, 0, 0, 0, 3, 0))
    assert model.joints[1].axis.tolist() == [0.0, 0.0, 1.0]
    before = library_model(model)
    model.joints[1].axis = np.array([0.0, 3.0, 0.0])
    assert library_model(model) is not before
    assert library_model(model).model.joints[1].axis.tolist() == [0.0, 1.0, 0.0]
    before = library_model(model)
    model.joints[2].axis2 = np.array([0.0, 0.0, 2.0])
    assert library_model(model) is not before
    assert model.joints[2].axis1.tolist() == [1.0, 0.0, 0.0]
    assert library_model(model).model.joints[3].axis.tolist() == [0.0, 0.0, 1.0]
    assert ours.JointModelRX().getMotionAxis().tolist() == theirs.JointModelRX().getMotionAxis().tolist()
    for axis in (np.zeros(3), np.array([np.nan, 0.0, 1.0])):
        with pytest.raises(sd.ModelError, match="expected three finite numbers, not all 0"):
            ours.JointModelPrismaticUnaligned(axis)
    with pytest.raises(TypeError, match="expected an array or three numbers"):
        ours.JointModelRevoluteUnaligned([0.0, 0.0, 1.0])
    with pytest.raises(TypeError, match="JointModelHelicalUnaligned got 1 arguments, expected an axis"):
        ours.JointModelHelicalUnaligned(np.ones(3))
    with pytest.raises(TypeError, match="expected two axes or six numbers"):
        ours.JointModelUniversal(np.ones(3))


WITH_AXES = {
    "RevoluteUnaligned": lambda pin, axis: pin.JointModelRevoluteUnaligned(axis),
    "PrismaticUnaligned": lambda pin, axis: pin.JointModelPrismaticUnaligned(axis),
    "RevoluteUnboundedUnaligned": lambda pin, axis: pin.JointModelRevoluteUnboundedUnaligned(axis),
    "HelicalUnaligned": lambda pin, axis: pin.JointModelHelicalUnaligned(axis, 0.1),
    "Universal": lambda pin, axis: pin.JointModelUniversal(axis, np.array([0.0, 1.0, 0.0])),
    "the attribute": lambda pin, axis: setattr(pin.JointModelRevoluteUnaligned(1.0, 0.0, 0.0), "axis", axis),
}


@pytest.mark.parametrize("kind", WITH_AXES)
@pytest.mark.parametrize("axis", [np.ones(2), np.ones(4), np.ones((2, 3)), np.empty(0)], ids=lambda x: str(x.shape))
def test_an_axis_of_another_size_is_a_type_error_in_both(kind: str, axis: Any) -> None:
    with pytest.raises(TypeError):
        WITH_AXES[kind](theirs, axis)
    with pytest.raises(
        TypeError, match=rf"axis of JointModel\w+ is \[.*\], of {axis.size} numbers, expected three"
    ) as e:
        WITH_AXES[kind](ours, axis)
    assert isinstance(e.value, sd.SpatialDynError)


def test_pitches_can_be_given_and_changed() -> None:
    assert [ours.JointModelHX(pitch=0.3).pitch, ours.JointModelHY(1).pitch, ours.JointModelHZ().pitch] == [
        0.3,
        1.0,
        0.0,
    ]
    by_array, by_numbers = ours.JointModelHelicalUnaligned(AXIS, 0.2), ours.JointModelHelicalUnaligned(*AXIS, 0.2)
    assert by_array == by_numbers
    assert (by_array.pitch, theirs.JointModelHelicalUnaligned(*AXIS, 0.2).pitch) == (0.2, 0.2)
    assert (by_array.axis == AXIS).all()
    assert ours.JointModelHelicalUnaligned() == ours.JointModelHelicalUnaligned(1.0, 0.0, 0.0, 0.0)
    assert ours.JointModelHX(0.1) != ours.JointModelHX(0.2)
    assert ours.JointModelHX(0.1).getMotionAxis().tolist() == theirs.JointModelHX(0.1).getMotionAxis().tolist()
    model = chain(ours, ours.JointModelHX(0.5), by_array)
    before = library_model(model)
    model.joints[1].pitch, model.joints[2].pitch = -0.25, 3.0
    assert library_model(model) is not before
    assert [joint.pitch for joint in library_model(model).model.joints] == [0.0, -0.25, 3.0]
    other = chain(theirs, theirs.JointModelHX(-0.25), theirs.JointModelHelicalUnaligned(AXIS, 3.0))
    assert_same_dynamics(model, other)
    again = ours.Model()
    again.loadFromString(model.saveToString())
    assert [joint.pitch for joint in again.joints[1:]] == [-0.25, 3.0]
    for wrong in (np.ones(3), "1"):
        with pytest.raises(TypeError, match="pitch is"):
            ours.JointModelHX(wrong)


def test_parts_of_a_composite() -> None:
    mine, other = composite(ours), composite(theirs)
    assert [joint.shortname() for joint in mine.joints] == [joint.shortname() for joint in other.joints]
    for a, b in zip(mine.jointPlacements, other.jointPlacements, strict=True):
        assert_close(a.homogeneous, b.homogeneous, "placement", PLACED)
    assert mine.njoints == other.njoints == 4
    assert [mine.getJointId(name) for name in ("a", "c", "x")] == [0, 2, 4]
    assert "JointModelRUBY" in repr(mine)
    model = chain(ours, mine)
    with pytest.raises(sd.ModelError, match="the composite is joint 1 of a model"):
        model.joints[1].addJoint(ours.JointModelRX())
    assert [joint.idx_q for joint in model.joints[1].joints] == [0, 1, 3, 4]
    with pytest.raises(sd.ModelError, match='joint "j0" is an empty composite'):
        library_model(chain(ours, ours.JointModelComposite(2)))


def test_a_composite_may_hold_another() -> None:
    def build(pin: Any) -> Any:
        outer = pin.JointModelComposite(pin.JointModelRY(), pin.SE3(TURN, np.ones(3)))
        inner = pin.JointModelComposite(pin.JointModelPZ(), pin.SE3(TURN, np.array([0.1, 0.2, 0.3])))
        inner.addJoint(pin.JointModelRX(), pin.SE3(TURN.T, np.array([0.3, 0.2, 0.1])))
        outer.addJoint(inner, pin.SE3(TURN.T, np.ones(3)))
        return chain(pin, outer, pin.JointModelRX())

    mine, other = build(ours), build(theirs)
    assert_same_model(mine, other)
    assert_same_dynamics(mine, other)
    assert pickle.loads(pickle.dumps(mine)) == mine


def test_the_library_reads_the_faces_model_as_it_reads_pinocchios() -> None:
    def build(pin: Any) -> Any:
        model = chain(
            pin, *(KINDS[kind](pin) for kind in ("FreeFlyer", "RX", "RUBZ", "PrismaticUnaligned", "Spherical"))
        )
        model.addFrame(pin.Frame("tool", 5, 0, pin.SE3(TURN, np.ones(3)), pin.FrameType.OP_FRAME))
        return model

    mine, other = sd.from_pinocchio(build(ours)), sd.from_pinocchio(build(theirs))
    assert_close(mine.bodies["inertia"]["h"]["x"], other.bodies["inertia"]["h"]["x"], "first moments")
    assert [frame.name for frame in mine.frames] == [frame.name for frame in other.frames]
    assert (mine.joints[4].axis == library_model(build(ours)).model.joints[4].axis).all()


def test_arguments_that_are_no_joint_are_refused() -> None:
    with pytest.raises(TypeError, match="expected a joint model or nothing"):
        ours.JointModel(3)
    assert ours.JointModel() == ours.JointModelRX()
    assert ours.JointModelRX().extract() == ours.JointModelRX()
    with pytest.raises(TypeError, match="expected JointModel"):
        ours.JointModelMimic(3, 1.0, 0.0)
    with pytest.raises(sd.ModelError, match="a JointModelSpherical has 3 freedoms, expected a joint of one"):
        ours.JointModelMimic(ours.JointModelSpherical(), 1.0, 0.0)
    model = chain(ours, ours.JointModelRX())
    with pytest.raises(sd.ModelError, match="mimics joint 18446744073709551615, expected one from 1 to 1"):
        model.addJoint(1, ours.JointModelMimic(ours.JointModelRX(), 1.0, 0.0), ours.SE3.Identity(), "m")
    data = model.joints[1].createData()
    with pytest.raises(sd.ShapeError, match="q has 0 numbers, expected at least 1"):
        model.joints[1].calc(data, np.zeros(0))
    with pytest.raises(TypeError, match="q is a list"):
        model.joints[1].calc(data, [0.0])
