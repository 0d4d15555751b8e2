"""The compat Model: attributes, edits, serialization, copies."""

from __future__ import annotations

import copy
import pickle
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import ROBOTS as ALL_ROBOTS
from slow import slow_but

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.model.library_model import frame_placements, library_model
from spatialdyn.urdf.load import find_robot

from .same import assert_close, assert_same_model

theirs = pytest.importorskip("pinocchio")

ORACLE = 1e-11  # relative to the largest entry, the bound of the library for robots
ROBOTS = {name: path for name, path in ALL_ROBOTS.items() if name != "ur3"}
MIMICS = ("panda", "baxter_simple", "pr2", "tiago_pro")
UNPHYSICAL = pytest.mark.filterwarnings("ignore:.*principal moments")  # some robots have such inertias


def both(build: Callable[[Any], Any]) -> tuple[Any, Any]:
    """The same model under both modules, built by the same code."""
    return build(ours), build(theirs)


def arm(pin: Any) -> Any:
    """A small arm built by addJoint and its like."""
    model = pin.Model()
    model.name = "arm"
    parent = 0
    for k, joint in enumerate(
        (pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelPZ(), pin.JointModelRUBY())
    ):
        placement = pin.SE3(np.eye(3), np.array([0.1, 0.2 * k, -0.3]))
        parent = model.addJoint(parent, joint, placement, f"j{k}")
        model.addJointFrame(parent, -1)
        model.appendBodyToJoint(
            parent, pin.Inertia(1.0 + k, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25])), placement
        )
        model.addBodyFrame(f"b{k}", parent, pin.SE3.Identity(), model.getFrameId(f"j{k}"))
    model.addFrame(pin.Frame("tool", parent, model.nframes - 1, placement, pin.FrameType.OP_FRAME))
    return model


def states(model: Any, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, a at random."""
    rng = np.random.default_rng(seed)
    q = theirs.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    return q, rng.normal(size=model.nv), rng.normal(size=model.nv)


def assert_same_torques(mine: Any, other: Any) -> None:
    """rnea of both after the same edits."""
    q, v, a = states(other)
    expected = theirs.rnea(other, other.createData(), q, v, a)
    compiled = library_model(mine)
    assert_close(sd.rnea(compiled.model, q, v, a), expected, "rnea", ORACLE)


# --- what a model holds --------------------------------------------------------------------------------------


@UNPHYSICAL
@pytest.mark.parametrize(
    ("name", "floating"),
    slow_but(
        [(name, k % 2 == 1) for k, name in enumerate(ROBOTS)][::3],
        [(name, floating) for name in ROBOTS for floating in (False, True)],
    ),
)
def test_a_robot_is_the_same_model(name: str, floating: bool) -> None:
    def build(pin: Any) -> Any:
        root = (pin.JointModelFreeFlyer(),) if floating else ()
        return pin.buildModelFromUrdf(str(ROBOTS[name]), *root)

    mine, other = both(build)
    assert_same_model(mine, other)
    assert (mine.lowerVelocityLimit == -other.upperVelocityLimit).all()  # the wheel has the upper ones there
    assert (library_model(mine).model.nq, library_model(mine).model.nv) == (other.nq, other.nv)


@UNPHYSICAL
@pytest.mark.parametrize("name", [name for name in MIMICS if name in ROBOTS])
def test_mimic_joints_are_the_same(name: str) -> None:
    mine, other = both(lambda pin: pin.buildModelFromUrdf(str(ROBOTS[name]), mimic=True))
    assert_same_model(mine, other)
    assert library_model(mine).model.nv == other.nv < other.nvExtended


def test_a_model_built_by_calls_is_the_same() -> None:
    mine, other = both(arm)
    assert_same_model(mine, other)
    assert_same_torques(mine, other)
    assert (ours.Model().nframes, ours.Model().nbodies, ours.Model().njoints) == (1, 1, 1)
    assert list(mine.getChildJoints()) == list(other.getChildJoints()) == [4]
    assert mine.hasConfigurationLimit() == list(other.hasConfigurationLimit())
    assert mine.hasConfigurationLimitInTangent() == list(other.hasConfigurationLimitInTangent())
    assert repr(mine) == repr(other)


@pytest.mark.parametrize("count", [0, 4, 9, 10])
def test_limits_given_to_add_joint_are_the_same(count: int) -> None:
    def build(pin: Any) -> Any:
        model = arm(pin)
        joint = pin.JointModelPlanar()
        sizes = {4: "vvqq", 9: "vvvvqqvvv", 10: "vvvvqqqvvv"}.get(count, "")
        limits = [np.full(joint.nq if size == "q" else joint.nv, 1.0 + k) for k, size in enumerate(sizes)]
        model.addJoint(4, joint, pin.SE3.Identity(), "last", *limits)
        return model

    mine, other = both(build)
    assert_same_model(mine, other)
    if count == 9:
        assert (mine.lowerVelocityLimit[-3:] == 3.0).all()


# --- names ---------------------------------------------------------------------------------------------------


def test_names_are_found_and_a_miss_is_an_error_in_strict_mode(strict_mode: None) -> None:
    mine, other = both(arm)
    for name in ("j2", "b1", "tool", "universe"):
        assert mine.getFrameId(name) == other.getFrameId(name)
        assert mine.existFrame(name, ours.FrameType.BODY) == other.existFrame(name, theirs.FrameType.BODY)
    assert mine.getJointId("j3") == other.getJointId("j3") == 4
    assert mine.getBodyId("b2") == other.getBodyId("b2")
    assert mine.existJointName("j1")
    assert not mine.existBodyName("j1")
    for call, what in ((mine.getFrameId, "frame"), (mine.getJointId, "joint"), (mine.getBodyId, "frame")):
        with pytest.raises(sd.ModelError, match=f'{what} "j9" is not in robot "arm"'):
            call("j9")
        with pytest.raises(TypeError, match="expected str"):
            call(9)


def test_a_name_of_several_frames_needs_its_type() -> None:
    mine, other = both(arm)
    for pin, model in ((ours, mine), (theirs, other)):
        for kind in (pin.FrameType.OP_FRAME, pin.FrameType.BODY, pin.FrameType.SENSOR):
            model.addFrame(pin.Frame("twice", 2, 0, pin.SE3.Identity(), kind))
        with pytest.raises(ValueError, match="twice"):
            model.getFrameId("twice")
        assert model.getFrameId("twice", pin.FrameType.OP_FRAME) == model.nframes - 3
        assert model.getBodyId("twice") == model.nframes - 2
        assert model.existFrame("twice")
        model.frames.append(model.frames[model.nframes - 2])
        assert model.existBodyName("twice")
        with pytest.raises(ValueError, match="twice"):
            model.getBodyId("twice")
    n = mine.nframes
    says = f'frame "twice" is frame {n - 3} of type BODY and {n - 1} of type BODY, expected a FrameType'
    with pytest.raises(sd.ModelError, match=says):
        mine.getBodyId("twice")


def test_a_frame_of_another_type_is_named_with_its_type(strict_mode: None) -> None:
    mine, _ = both(arm)
    with pytest.raises(sd.ModelError, match='frame "j1" is of type JOINT, expected type BODY'):
        mine.getBodyId("j1")
    with pytest.raises(sd.ModelError, match="did you mean b1"):
        mine.getBodyId("b11")


def test_a_miss_gives_the_numbers_pinocchio_gives() -> None:
    mine, other = both(arm)
    assert not ours.strict()
    assert mine.getFrameId("nope") == other.getFrameId("nope") == mine.nframes
    assert mine.getJointId("nope") == other.getJointId("nope") == mine.njoints
    assert mine.getBodyId("nope") == other.getBodyId("nope") == mine.nframes
    assert mine.getBodyId("j1") == other.getBodyId("j1") == mine.nframes
    with pytest.raises(TypeError, match="expected str"):
        mine.getFrameId(9)


def test_enumerations_have_the_members_and_numbers_of_the_wheel() -> None:
    for name in ("FrameType", "ReferenceFrame", "KinematicLevel", "Convention", "ArgumentPosition", "GeometryType"):
        mine, other = getattr(ours, name), getattr(theirs, name)
        assert {x: int(y) for x, y in mine.names.items()} == {x: int(y) for x, y in other.names.items()}
        assert {int(x): str(y) for x, y in mine.values.items()} == {x: str(y) for x, y in other.values.items()}
    assert ours.JOINT | ours.BODY == theirs.JOINT | theirs.BODY == 10
    assert str(ours.LOCAL) == str(theirs.LOCAL)


def test_differences_name_their_subject_once() -> None:
    subjects = [entry.what for entry in ours.differences()]
    assert len({*subjects}) == len(subjects) > 10
    assert all(entry.pinocchio != entry.here for entry in ours.differences())


@pytest.mark.parametrize("library", [ours, theirs])
def test_items_of_slices_and_forces_on_the_universe_differ_as_is_said(library: Any) -> None:
    is_ours, model = library is ours, library.buildSampleModelManipulator()
    mass, data = model.inertias[1].mass, model.createData()
    library.rnea(model, data, library.neutral(model), np.zeros(model.nv), np.zeros(model.nv))
    assert library.computeSupportedForceByFrame(model, data, 0).linear.any() == is_ours
    model.inertias[1:3][0].mass = mass + 1.0
    assert model.inertias[1].mass == mass + is_ours


def test_frames_are_equal_when_all_of_them_is() -> None:
    frame = ours.Frame("a", 1, 2, ours.SE3.Identity(), ours.BODY, ours.Inertia.Identity())
    assert frame == frame.copy() == ours.Frame(frame) == pickle.loads(pickle.dumps(frame)) == copy.copy(frame)
    assert (frame.parent, frame.previousFrame) == (1, 2)
    assert ours.Frame("a", 1, ours.SE3.Identity(), ours.BODY).parentFrame == 0
    other = frame.copy()
    other.inertia = ours.Inertia.Zero()
    assert other != frame
    assert repr(frame).startswith("Frame name: a paired to (parent joint/ parent frame)(1/2)\n")
    assert str(theirs.Frame("a", 1, 2, theirs.SE3.Identity(), theirs.BODY)).split("\n")[0] == repr(frame).split("\n")[0]
    for arguments in (("a", 1), (1, 1, 1, ours.SE3.Identity(), ours.BODY), ("a", 1, 1, 3, ours.BODY)):
        with pytest.raises(TypeError, match="Frame got"):
            ours.Frame(*arguments)
    with pytest.raises(TypeError, match="placement is a int, expected SE3"):
        frame.placement = 3
    frame.parent, frame.previousFrame = 3, 4
    assert (frame.parentJoint, frame.parentFrame) == (3, 4)


def test_a_joint_that_moves_no_inertia_is_named() -> None:
    mine, other = both(arm)
    for pin, model in ((ours, mine), (theirs, other)):
        model.addJoint(4, pin.JointModelRX(), pin.SE3.Identity(), "bare")
    q, v, tau = states(other)
    data = mine.createData()
    with pytest.raises(sd.InertiaError, match='joint "bare" has zero articulated inertia'):
        ours.aba(mine, data, q, v, tau)
    with pytest.raises(sd.InertiaError, match='joint "bare" has zero articulated inertia'):
        ours.computeMinverse(mine, data, q)
    assert not np.isfinite(theirs.aba(other, other.createData(), q, v, tau)).all()
    mine.appendBodyToJoint(5, ours.Inertia.Identity(), ours.SE3.Identity())
    assert np.isfinite(ours.aba(mine, data, q, v, tau)).all()


# --- edits take effect at the next call ----------------------------------------------------------------------

EDITS: dict[str, Callable[[Any, Any], Any]] = {
    "armature[:]": lambda m, pin: m.armature.__setitem__(slice(None), 0.5),
    "armature": lambda m, pin: setattr(m, "armature", np.linspace(0.1, 1.0, m.nv)),
    "armature +=": lambda m, pin: m.armature.__iadd__(0.25),
    "armature view": lambda m, pin: m.armature[2:4].__setitem__(0, 3.0),
    "copyto armature": lambda m, pin: np.copyto(m.armature, np.arange(m.nv, dtype=float)),
    "inertia": lambda m, pin: m.inertias.__setitem__(2, pin.Inertia(3.0, np.ones(3), np.eye(3))),
    "mass": lambda m, pin: setattr(m.inertias[2], "mass", 4.0),
    "lever": lambda m, pin: setattr(m.inertias[2], "lever", np.array([0.3, 0.2, 0.1])),
    "lever[0]": lambda m, pin: m.inertias[2].lever.__setitem__(0, 0.7),
    "rotational inertia": lambda m, pin: setattr(m.inertias[2], "inertia", np.eye(3)),
    "set to identity": lambda m, pin: m.inertias[2].setIdentity(),
    "placement": lambda m, pin: m.jointPlacements.__setitem__(3, pin.SE3(np.diag([1.0, -1.0, -1.0]), np.ones(3))),
    "translation": lambda m, pin: setattr(m.jointPlacements[3], "translation", np.ones(3)),
    "translation[0]": lambda m, pin: m.jointPlacements[3].translation.__setitem__(0, 2.0),
    "rotation": lambda m, pin: setattr(m.jointPlacements[3], "rotation", np.diag([-1.0, -1.0, 1.0])),
    "rotation[:]": lambda m, pin: m.jointPlacements[3].rotation.__setitem__(slice(None), np.diag([-1.0, -1.0, 1.0])),
    "identity": lambda m, pin: m.jointPlacements[3].setIdentity(),
    "gravity": lambda m, pin: setattr(m, "gravity", pin.Motion(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))),
    "gravity.linear": lambda m, pin: setattr(m.gravity, "linear", np.array([0.0, 1.0, 0.0])),
    "gravity.linear[2]": lambda m, pin: m.gravity.linear.__setitem__(2, -1.6),
    "add a joint": lambda m, pin: m.addJoint(4, pin.JointModelRZ(), pin.SE3.Identity(), "more"),
    "append a body": lambda m, pin: m.appendBodyToJoint(
        3, pin.Inertia(1.0, np.ones(3), np.eye(3)), pin.SE3(np.eye(3), np.ones(3))
    ),
    "a frame with a body": lambda m, pin: m.addFrame(
        pin.Frame("load", 2, 0, pin.SE3(np.eye(3), np.ones(3)), pin.BODY, pin.Inertia(1.0, np.ones(3), np.eye(3)))
    ),
}  # fmt: skip


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_takes_effect_at_the_next_call(edit: str) -> None:
    mine, other = both(arm)
    before, data = library_model(mine).model, mine.createData()
    q, v, a = states(other)
    old = ours.rnea(mine, data, q, v, a)
    EDITS[edit](mine, ours)
    EDITS[edit](other, theirs)
    if mine.nv == len(v):  # with the same Data
        found = ours.rnea(mine, data, q, v, a)
        assert_close(found, theirs.rnea(other, other.createData(), q, v, a), "rnea", ORACLE)
        assert (found != old).any()
    assert library_model(mine).model is not before
    if not edit.startswith("add a joint"):
        assert_same_model(mine, other)
    assert_same_torques(mine, other)


def test_an_unedited_model_is_made_once() -> None:
    model = arm(ours)
    found = library_model(model)
    model.upperPositionLimit[0] = 2.0
    model.damping = np.ones(model.nv)
    model.name = "other"
    model.referenceConfigurations["q"] = np.ones(model.nq)
    assert library_model(model) is found
    assert frame_placements(model) is frame_placements(model)


def test_what_cannot_be_assigned_says_so_and_the_rest_takes_effect() -> None:
    mine, other = both(arm)
    for name in (
        "nq",
        "nv",
        "nbodies",
        "njoints",
        "nframes",
        "names",
        "parents",
        "joints",
        "inertias",
        "idx_qs",
        "nqs",
    ):
        for model in (mine, other):
            with pytest.raises(AttributeError):
                setattr(model, name, getattr(model, name))
    before, where = library_model(mine).model, frame_placements(mine)
    mine.jointPlacements = [ours.SE3.Identity() for _ in range(5)]
    mine.frames = mine.frames[:3]
    assert library_model(mine).model != before
    assert frame_placements(mine) is not where
    before = library_model(mine).model
    mine.jointPlacements[2].translation[0] = 3.0
    assert library_model(mine).model != before
    mine.loadFromString(arm(ours).saveToString())
    assert mine == arm(ours)


@pytest.mark.parametrize("build", [arm, lambda pin: pin.buildSampleModelManipulator(True)])
def test_which_velocities_move_a_joint(build: Callable[[Any], Any]) -> None:
    mine, other = both(build)
    assert [list(x) for x in mine.span_indexes_vector] == [list(x) for x in other.span_indexes_vector]
    assert [x.tolist() for x in mine.sparsity_pattern_vector] == [x.tolist() for x in other.sparsity_pattern_vector]


def test_frames_are_placed_anew_after_an_edit() -> None:
    model = arm(ours)
    edits: dict[str, Callable[[], Any]] = {
        "placement": lambda: setattr(model.frames[3], "placement", ours.SE3(np.eye(3), np.ones(3))),
        "translation": lambda: model.frames[3].placement.translation.__setitem__(0, 5.0),
        "frame": lambda: model.frames.__setitem__(3, ours.Frame("new", 1, 0, ours.SE3.Identity(), ours.BODY)),
        "joint": lambda: setattr(model.frames[3], "parentJoint", 2),
        "more": lambda: model.addFrame(ours.Frame("last", 1, 0, ours.SE3.Identity(), ours.BODY)),
    }
    for edit in edits.values():
        frame_placements(model)
        edit()
        after = frame_placements(model)
        assert after.joints.tolist() == [frame.parentJoint for frame in model.frames]
        assert (after.placements == [frame.placement.homogeneous for frame in model.frames]).all()
        assert (after.rows == library_model(model).rows[after.joints]).all()


def test_entries_are_copies_of_what_was_put_in() -> None:
    model, X = arm(ours), ours.SE3.Identity()
    model.jointPlacements[1] = X
    X.translation[0] = 7.0
    assert model.jointPlacements[1].translation[0] == 0.0
    with pytest.raises(TypeError, match="value is a Force, expected SE3"):
        model.jointPlacements[1] = ours.Force.Zero()
    with pytest.raises(TypeError, match="expected an array of numbers"):
        model.armature = [0.0] * model.nv
    with pytest.raises(ValueError, match=re.escape("armature has shape (3,), expected (9,)")):
        model.armature = np.zeros(3)


# --- what is refused -----------------------------------------------------------------------------------------


def test_joints_that_are_not_depth_first_are_refused() -> None:
    model = arm(ours)
    model.addJoint(0, ours.JointModelRX(), ours.SE3.Identity(), "side")
    model.addJoint(2, ours.JointModelRX(), ours.SE3.Identity(), "late")
    with pytest.raises(sd.ModelError, match='joint "late" hangs on "j1" and follows "side"'):
        library_model(model)


def test_indices_that_are_not_there_are_refused() -> None:
    model, one = arm(ours), ours.SE3.Identity()
    for call in (
        lambda: model.addJoint(9, ours.JointModelRX(), one, "x"),
        lambda: model.appendBodyToJoint(9, ours.Inertia.Zero(), one),
        lambda: model.addFrame(ours.Frame("x", 9, 0, one, ours.BODY)),
        lambda: model.addJointFrame(-1),
    ):
        with pytest.raises(sd.ModelError, match=r"joint index is (9|-1), expected one from 0 to 4"):
            call()
    with pytest.raises(sd.ModelError, match='frame "x" has parent frame 99, expected 0 to 9'):
        model.addFrame(ours.Frame("x", 1, 99, one, ours.BODY))
    with pytest.raises(ValueError, match='max_effort of joint "x" has 2 numbers, expected 1'):
        model.addJoint(0, ours.JointModelRX(), one, "x", np.ones(2), np.ones(1), np.ones(1), np.ones(1))
    with pytest.raises(TypeError, match="addJoint got 3 limits, expected 0, 4, 9 or 10"):
        model.addJoint(0, ours.JointModelRX(), one, "x", np.ones(1), np.ones(1), np.ones(1))
    with pytest.raises(TypeError, match="joint_model is a int"):
        model.addJoint(0, 3, one, "x")
    assert model.njoints == 5
    model.gravity.angular[0] = 1.0
    with pytest.raises(sd.ModelError, match="gravity has angular part"):
        library_model(model)


def test_a_frame_is_added_once() -> None:
    def build(pin: Any) -> Any:
        model = arm(pin)
        frame = pin.Frame("load", 2, 0, pin.SE3.Identity(), pin.FrameType.BODY, pin.Inertia(1.0, np.ones(3), np.eye(3)))
        model.addFrame(frame)
        model.addFrame(frame)
        model.addFrame(pin.Frame("bare", 2, 0, pin.SE3.Identity(), pin.FrameType.BODY, frame.inertia), False)
        return model

    assert_same_model(*both(build))


# --- copies and files ----------------------------------------------------------------------------------------


def changed(model: Any) -> list[Any]:
    """Copies of a model with one thing changed in each."""
    copies = [model.copy() for _ in range(8)]
    copies[0].name = "other"
    copies[1].gravity.linear[2] = 0.0
    copies[2].armature[0] = 1.0
    copies[3].frames[2].name = "other"
    copies[4].inertias[1].mass += 1.0
    copies[5].jointPlacements[1].translation[0] += 1.0
    copies[6].referenceConfigurations["home"] = np.zeros(model.nq)
    copies[7].names[1] = "other"
    return copies


def test_copies_are_equal_and_their_own() -> None:
    model = arm(ours)
    for twin in (
        model.copy(), ours.Model(model), copy.copy(model), copy.deepcopy(model), pickle.loads(pickle.dumps(model))
    ):  # fmt: skip
        assert twin == model
        assert twin is not model
        assert_same_torques(twin, arm(theirs))
        assert (twin != model) is False
    for other in changed(model):
        assert other != model
    assert model == arm(ours)
    assert model != 3


@UNPHYSICAL
@pytest.mark.parametrize("robot", ["panda", "talos_full_v2", "built"])
def test_a_stored_model_comes_back_bit_for_bit(robot: str, tmp_path: Path) -> None:
    model = special() if robot == "built" else ours.buildModelFromUrdf(find_robot(robot), ours.JointModelFreeFlyer())
    model.referenceConfigurations["home"] = np.linspace(0.0, 1.0, model.nq)
    for suffix in ("Text", "Binary"):
        back = ours.Model()
        getattr(model, f"saveTo{suffix}")(str(tmp_path / "model"))
        getattr(back, f"loadFrom{suffix}")(str(tmp_path / "model"))
        assert back == model
    back = ours.Model()
    model.saveToXML(tmp_path / "model.xml", "model")
    back.loadFromXML(tmp_path / "model.xml", "model")
    assert back == model
    back = ours.Model()
    back.loadFromString(model.saveToString())
    assert back == model
    assert (library_model(back).model.bodies == library_model(model).model.bodies).all()
    assert list(back.joints) == list(model.joints)
    assert (np.array([frame.placement for frame in back.frames]) == [frame.placement for frame in model.frames]).all()
    assert pickle.loads(pickle.dumps(model)) == model


def special() -> Any:
    """A model with every joint that has parameters."""
    model = ours.Model()
    composite = ours.JointModelComposite(ours.JointModelRX(), ours.SE3.Random(), "a").addJoint(
        ours.JointModelSpherical()
    )
    for k, joint in enumerate(
        (
            ours.JointModelRevoluteUnaligned(1.0, 2.0, 3.0), ours.JointModelUniversal(np.eye(3)[0], np.eye(3)[2]),
            ours.JointModelPrismaticUnaligned(np.ones(3)), composite, ours.JointModelSphericalZYX(),
        )
    ):  # fmt: skip
        model.addJoint(k, joint, ours.SE3.Random(), f"<j&{k}>")
        model.appendBodyToJoint(k + 1, ours.Inertia.Random(), ours.SE3.Random())
    model.addJoint(5, ours.JointModelMimic(model.joints[1], 2.0, 0.1), ours.SE3.Random(), "mimic")
    return model


def test_what_is_no_stored_model_is_refused(tmp_path: Path) -> None:
    model = arm(ours)
    (tmp_path / "text").write_text("{}")
    (tmp_path / "list").write_text("[1]")
    for load, file, what in (
        (model.loadFromText, "text", "holds no model"),
        (model.loadFromText, "list", "holds no model"),
        (model.loadFromText, "missing", "cannot be read"),
        (model.loadFromBinary, "text", "not written by saveToBinary"),
    ):
        with pytest.raises(sd.SpatialDynError, match=what):
            load(str(tmp_path / file))
    with pytest.raises(sd.SpatialDynError, match="has no element <model>"):
        model.loadFromXML(tmp_path / "text", "model")
    with pytest.raises(NotImplementedError, match="give a path"):
        model.saveToBinary(3)
    assert model == arm(ours)


def test_a_model_takes_attributes_of_its_users() -> None:
    model = arm(ours)
    model.mine = 3
    assert model.mine == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert model.friction is model.upperDryFrictionLimit


@pytest.mark.parametrize("pin", [ours, pytest.param("pinocchio", id="wheel")])
def test_what_is_held_goes_on_being_the_models_when_it_is_assigned(pin: Any) -> None:
    pin = pytest.importorskip(pin) if isinstance(pin, str) else pin
    model = pin.buildSampleModelManipulator()
    q = pin.neutral(model)
    armature, placement, gravity = model.armature, model.jointPlacements[2], model.gravity
    limit, inertia = model.upperPositionLimit, model.inertias[2]
    model.armature = np.full(6, 2.0)
    model.upperPositionLimit = np.full(6, 3.0)
    model.jointPlacements[2] = pin.SE3(np.eye(3), np.array([1.0, 2.0, 3.0]))
    model.inertias[2] = pin.Inertia(4.0, np.zeros(3), np.eye(3))
    model.gravity = pin.Motion.Zero()
    assert (armature == 2.0).all()
    assert (limit == 3.0).all()
    assert placement.translation[1] == 2.0
    assert inertia.mass == 4.0
    assert gravity == pin.Motion.Zero()
    M = pin.crba(model, model.createData(), q).copy()
    armature[0] += 5.0
    inertia.mass = 40.0
    placement.translation[0] = 7.0
    gravity.linear[0] = 1.0
    limit[0] = 8.0
    data = model.createData()
    assert pin.crba(model, data, q)[0, 0] > M[0, 0] + 5.0
    assert pin.computeGeneralizedGravity(model, data, q).any()
    assert model.jointPlacements[2].translation[0] == 7.0
    assert model.upperPositionLimit[0] == 8.0


def test_what_was_read_before_a_joint_was_added_is_no_longer_the_models() -> None:
    model = ours.buildSampleModelManipulator()
    held = model.armature
    model.addJoint(6, ours.JointModelRX(), ours.SE3.Identity(), "more")
    held[0] = 5.0
    assert model.armature[0] == 0.0
    model.armature[0] = 5.0
    assert model.armature[0] == 5.0


def test_a_copy_that_others_wrote_to_is_assigned() -> None:
    model = ours.buildSampleModelManipulator()
    q = ours.neutral(model)
    M = ours.crba(model, model.createData(), q)
    x = model.armature.copy()
    np.asarray(x)[0] = 1.0
    model.armature = x
    assert ours.crba(model, model.createData(), q)[0, 0] == pytest.approx(M[0, 0] + 1.0, rel=1e-14, abs=0.0)


@pytest.mark.parametrize("joint", [0, 7, -1])
def test_a_joint_that_is_not_there_cannot_be_locked(joint: int) -> None:
    model = ours.buildSampleModelManipulator()
    with pytest.raises(sd.SpatialDynError, match=f"joint index (is )?{joint}"):
        ours.buildReducedModel(model, [joint], ours.neutral(model))


def test_a_frame_that_was_renamed_is_found_by_its_new_name_alone() -> None:
    model = ours.buildSampleModelManipulator()
    at = model.nframes - 1
    old = model.frames[at].name
    assert model.getFrameId(old) == at
    model.frames[at].name = "tool"
    assert model.getFrameId("tool") == at
    assert not model.existFrame(old)
    model.frames[at] = ours.Frame("other", 1, 0, ours.SE3.Identity(), ours.FrameType.OP_FRAME)
    assert model.existFrame("other")
    assert not model.existFrame("tool")


@pytest.mark.parametrize("called", [False, True])
def test_a_copy_of_a_model_that_was_called_or_not_is_its_own(called: bool) -> None:
    """A copy of one that was called takes over what its calls are made of, and neither sees an edit of the other."""
    model = arm(ours)
    q, v, a = states(both(arm)[1])
    before = ours.rnea(model, model.createData(), q, v, a) if called else None
    model.armature[2] = 0.3  # the copy takes over an edit that no call has seen
    if called:
        before = ours.rnea(model, model.createData(), q, v, a)
    copy = model.copy()
    assert copy == model
    for name in ("subtrees", "supports", "children", "idx_vs", "nqs", "mimicking_joints"):
        assert getattr(copy, name) == getattr(model, name)
        assert getattr(copy, name) is not getattr(model, name)
    assert (copy._library is not None) == called
    copied = ours.rnea(copy, copy.createData(), q, v, a)
    copy.inertias[2].mass = 9.0
    copy.armature[1] = 1.0
    copy.gravity.linear = np.zeros(3)
    copy.jointPlacements[2].translation[1] = 2.0
    copy.frames[3].placement.translation[1] = 2.0
    other = ours.rnea(copy, copy.createData(), q, v, a)
    assert (ours.rnea(model, model.createData(), q, v, a) == copied).all()
    assert before is None or (copied == before).all()
    model.inertias[2].mass = 5.0
    assert (ours.rnea(copy, copy.createData(), q, v, a) == other).all()
    assert library_model(copy).model == library_model(ours.Model(copy)).model


def test_armatures_and_placements_edited_between_calls_count_from_the_next_call_on() -> None:
    """A field that is read after an edit is that of the call before it; the library's Model follows when asked for."""
    found = []
    models = both(arm)
    q, v, a = states(models[1])
    for pin, model in zip((ours, theirs), models, strict=True):
        data, parts = model.createData(), []
        for k in range(3):
            pin.computeAllTerms(model, data, q, v)
            model.armature[k + 1] = 0.5 * k
            model.jointPlacements[2].translation[0] = 0.1 * k
            parts += [np.triu(data.M), np.triu(pin.crba(model, data, q)), pin.rnea(model, data, q, v, a)]
            model.inertias[2].mass = 2.0 + k
            model.gravity.linear = np.array([0.0, k, -9.0])
            model.armature = 0.1 * np.arange(model.nv)
            pin.framesForwardKinematics(model, data, q)
            parts += [pin.rnea(model, data, q, v, a), data.oMf[3].homogeneous]
        found.append(parts)
    for mine, other in zip(*found, strict=True):
        assert_close(mine, other, "after an edit", ORACLE)
    assert library_model(models[0]).model == library_model(models[0].copy()).model
    models[0].armature[1] = -1.0
    with pytest.raises(ValueError, match="armature"):
        ours.crba(models[0], models[0].createData(), q)


def test_what_is_read_of_a_call_before_joints_were_moved_is_of_where_they_were() -> None:
    """Fields and Jacobians, also if a call of another Data has seen the edit since."""
    found = []
    models = both(arm)
    q, v, a = states(models[1])
    for pin, model in zip((ours, theirs), models, strict=True):
        data, every, parts = model.createData(), model.createData(), []
        pin.computeAllTerms(model, every, q, v)
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        for k in range(3):
            parts += [pin.getFrameJacobianTimeVariation(model, data, 4, at) for at in (pin.WORLD, pin.LOCAL)]
            parts.append(pin.getJointJacobian(model, data, 3, pin.LOCAL))
            model.jointPlacements[2].translation[0] += 0.1 * k
            model.jointPlacements[3] = model.jointPlacements[1]
            model.inertias[2].mass, model.gravity.linear[0] = 2.0 + k, 1.0
            pin.rnea(model, model.createData(), q, v, a)
        found.append([*parts, every.g, np.triu(every.M), every.Jcom])
    for mine, other in zip(*found, strict=True):
        assert_close(mine, other, "before joints were moved", ORACLE)


def test_an_edited_model_computes_what_one_made_of_its_numbers_does() -> None:
    ours.seed(0)
    model = ours.buildSampleModelHumanoidRandom()
    rng, data = np.random.default_rng(0), model.createData()
    q, v = ours.neutral(model), rng.normal(size=model.nv)
    for edit in (
        lambda: model.inertias.__setitem__(3, ours.Inertia.Random()),
        lambda: model.jointPlacements[2].translation.__setitem__(0, 0.3),
        lambda: model.armature.__setitem__(7, 0.5),
        lambda: setattr(model.gravity, "linear", np.array([1.0, 2.0, 3.0])),
        lambda: model.names.__setitem__(2, "renamed"),
    ):
        ours.rnea(model, data, q, v, v)
        edit()
        anew = model.copy()
        for _ in range(2):  # the first call after an edit, and those that follow it
            tau = ours.rnea(model, data, q, v, v)
            expected = ours.rnea(anew, anew.createData(), q, v, v)
            # an edit moves an inertia to the joint's origin in compiled code, assembly in NumPy: they round apart
            np.testing.assert_allclose(tau, expected, rtol=0.0, atol=np.finfo(float).eps * abs(expected).max())
            np.testing.assert_array_equal(ours.integrate(model, q, v), ours.integrate(anew, q, v))
