"""Objects of Pinocchio's own classes: what converts them, and the errors where they are passed as they are."""

from __future__ import annotations

import operator
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from robots import ROBOTS

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.model.from_pinocchio import pinocchio_state
from spatialdyn.compat.pinocchio.model.serialization_format import state

theirs = pytest.importorskip("pinocchio")

EPS = float(np.finfo(float).eps)
ROUNDING = 64 * EPS  # of entries of order 1: placements after fixed joints are products, taken in another order
SCALED = 1e4 * EPS  # of torques, by the largest


def leaves(x: Any, at: str = "") -> dict[str, Any]:
    """The numbers and names of a state by their place."""
    if isinstance(x, dict):
        return {name: y for key, part in x.items() for name, y in leaves(part, f"{at}.{key}").items()}
    if isinstance(x, (list, tuple)):
        return {name: y for key, part in enumerate(x) for name, y in leaves(part, f"{at}[{key}]").items()}
    return {at: x}


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("name", ["panda", "tiago", "solo12"])
def test_a_converted_model_is_the_one_that_the_file_makes(name: str, floating: bool) -> None:
    if not ROBOTS:
        pytest.skip("example-robot-data is not installed")
    file = str(ROBOTS[name])
    made = []
    for pin in (theirs, ours):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of inertias
            made.append(pin.buildModelFromUrdf(file, *([pin.JointModelFreeFlyer()] if floating else [])))
    given, built = made
    given.referenceConfigurations["home"] = built.referenceConfigurations["home"] = theirs.neutral(given)
    found, wanted = (leaves(state(x)) for x in (ours.Model(given), built))
    assert found.keys() == wanted.keys()
    words = {at: x for at, x in wanted.items() if isinstance(x, str)}
    assert {at: found[at] for at in words} == words
    for at in wanted.keys() - words.keys():
        assert found[at] == pytest.approx(wanted[at], rel=ROUNDING, abs=ROUNDING), at


def kinds(pin: Any) -> list[Any]:
    """A joint of every kind that both have."""
    axis = np.array([0.0, 0.6, 0.8])
    chain = pin.JointModelComposite(pin.JointModelRevoluteUnaligned(*axis), pin.SE3(np.eye(3), axis))
    chain.addJoint(pin.JointModelRUBZ(), pin.SE3(np.eye(3), -axis))
    aligned = [getattr(pin, f"JointModel{kind}{at}")() for kind in ("R", "P", "RUB") for at in "XYZ"]
    screws = [pin.JointModelHX(0.3), pin.JointModelHY(-0.2), pin.JointModelHelicalUnaligned(axis, 0.1)]
    unaligned = [pin.JointModelRevoluteUnaligned(axis), pin.JointModelPrismaticUnaligned(axis)]
    names = "Spherical SphericalZYX Translation Planar FreeFlyer"
    several = [getattr(pin, f"JointModel{name}")() for name in names.split()]
    return [*aligned, *screws, *unaligned, *several, pin.JointModelUniversal(1, 0, 0, 0, 1, 0), chain]


def tree(pin: Any) -> Any:
    """A chain of every kind of joint, and one that mimics, in other numbers than the defaults."""
    rng = np.random.default_rng(3)
    model = pin.Model()
    model.name, at = "all", 0
    for k, joint in enumerate(kinds(pin)):
        at = model.addJoint(at, joint, pin.SE3(np.eye(3), rng.standard_normal(3)), f"j{k}")
        model.appendBodyToJoint(at, pin.Inertia(1.0 + k, rng.standard_normal(3), np.eye(3)), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"f{k}", at, 0, pin.SE3(np.eye(3), rng.standard_normal(3)), pin.FrameType.SENSOR))
    model.gravity = pin.Motion(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    for name in ("armature", "rotorInertia", "rotorGearRatio", "damping", "upperEffortLimit", "lowerEffortLimit"):
        setattr(model, name, rng.random(model.nv))
    return model


def test_every_kind_of_joint_and_all_numbers_are_taken_over() -> None:
    given = tree(theirs)
    made = ours.Model(given)
    assert leaves(state(made)).keys() == leaves(state(tree(ours))).keys()
    assert [x.shortname() for x in made.joints] == [x.shortname() for x in given.joints]
    for name in ("armature", "rotorInertia", "rotorGearRatio", "damping", "upperEffortLimit", "lowerEffortLimit"):
        assert (getattr(made, name) == getattr(given, name)).all(), name
    rng = np.random.default_rng(0)
    q = ours.integrate(made, ours.neutral(made), rng.standard_normal(made.nv))
    v, a = rng.standard_normal((2, made.nv))
    found, wanted = ours.rnea(made, made.createData(), q, v, a), theirs.rnea(given, given.createData(), q, v, a)
    assert abs(found - wanted).max() <= SCALED * abs(wanted).max()
    assert [(x.name, x.type.name, x.parentJoint) for x in made.frames] == [
        (x.name, x.type.name, x.parentJoint) for x in given.frames
    ]
    made.armature[0] = 7.0
    assert given.armature[0] != 7.0


def test_a_joint_that_mimics_is_taken_over() -> None:
    given = theirs.buildSampleModelManipulator(True)
    made = ours.Model(given)
    assert [str(x.extract()) for x in made.joints[1:]] == [str(x.extract()) for x in list(given.joints)[1:]]
    assert list(made.mimicked_joints) == list(given.mimicked_joints)
    q, v = np.linspace(0.1, 0.5, made.nq), np.linspace(-1.0, 1.0, made.nv)
    found = ours.rnea(made, made.createData(), q, v, v)
    assert abs(found - theirs.rnea(given, given.createData(), q, v, v)).max() <= SCALED * abs(found).max()


def test_a_joint_of_a_kind_that_is_not_here_is_named() -> None:
    given = theirs.Model()
    given.addJoint(0, theirs.JointModelEllipsoid(), theirs.SE3.Identity(), "knee")
    with pytest.raises(sd.ModelError, match='joint "knee" is a JointModelEllipsoid of Pinocchio, expected a kind that'):
        ours.Model(given)


def test_limits_by_the_names_of_pinocchio_3_are_taken_over() -> None:
    given = theirs.buildSampleModelManipulator()
    given.effortLimit = np.arange(6.0)
    hidden = {f"{end}{x}Limit" for end in ("lower", "upper") for x in ("Effort", "Velocity", "DryFriction")}
    names = {name for name in dir(given) if name[0] != "_"} - hidden - {"positionLimitMargin"}
    made = pinocchio_state(SimpleNamespace(**{name: getattr(given, name) for name in names}))
    assert made["arrays"]["upperEffortLimit"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert made["arrays"]["lowerEffortLimit"].tolist() == [0.0, -1.0, -2.0, -3.0, -4.0, -5.0]
    assert made["arrays"]["positionLimitMargin"].tolist() == [0.0] * 6


def test_values_are_converted_and_independent() -> None:
    rng = np.random.default_rng(1)
    M, t, s = theirs.SE3.Random(), rng.standard_normal(3), rng.standard_normal(6)
    I = theirs.Inertia(2.0, t, np.diag([1.0, 2.0, 2.5]))
    place = ours.SE3(M)
    assert (place.homogeneous == M.homogeneous).all()
    place.translation[0] = 9.0
    assert M.translation[0] != 9.0
    assert (ours.Motion(theirs.Motion(s)).vector == s).all()
    assert (ours.Force(theirs.Force(s)).vector == s).all()
    body = ours.Inertia(I)
    assert (body.mass, body.lever.tolist(), body.inertia.tolist()) == (I.mass, I.lever.tolist(), I.inertia.tolist())
    frame = ours.Frame(theirs.Frame("tip", 3, 2, M, theirs.FrameType.OP_FRAME, I))
    assert (frame.name, frame.parentJoint, frame.parentFrame, frame.type) == ("tip", 3, 2, ours.OP_FRAME)
    assert frame.inertia == body
    assert (frame.placement.homogeneous == M.homogeneous).all()
    with pytest.raises(TypeError, match=r"Force is a pinocchio.*Motion, which"):
        ours.Force(theirs.Motion(s))


def test_a_robot_of_pinocchios_model_computes() -> None:
    given = theirs.buildSampleModelManipulator()
    robot = ours.RobotWrapper(given)
    assert type(robot.model) is ours.Model
    q = np.linspace(0.1, 0.6, 6)
    assert abs(robot.mass(q) - theirs.crba(given, given.createData(), q)).max() <= SCALED


# --- errors -----------------------------------------------------------------------------------------------

OF = r"a pinocchio\.pinocchio_pywrap_default\."
FACE = r"spatialdyn\.compat\.pinocchio\."


def test_errors_name_the_module_of_what_was_given_and_the_cure() -> None:
    given, q = theirs.buildSampleModelManipulator(), np.zeros(6)
    model, data = ours.buildSampleModelManipulator(), given.createData()
    cure = rf", which {FACE}Model\(\.\.\.\) converts and {FACE}install\(\) avoids, expected"
    for call in (
        lambda: ours.rnea(given, data, q, q, q),
        lambda: ours.neutral(given),
        lambda: ours.getFrameJacobian(given, data, 1, ours.LOCAL),
        lambda: ours.SE3(given),
    ):
        with pytest.raises(TypeError, match=rf"{OF}Model{cure}"):
            call()
    with pytest.raises(TypeError, match=rf"data is {OF}Data, which {FACE}install\(\) avoids, expected a Data"):
        ours.rnea(model, data, q, q, q)
    with pytest.raises(TypeError, match=rf"{OF}SE3, which {FACE}SE3\(\.\.\.\) converts"):
        model.addJoint(0, ours.JointModelRX(), theirs.SE3.Identity(), "a")
    with pytest.raises(TypeError, match=r"Frame got \(str, int, pinocchio.*SE3, which .* converts"):
        ours.Frame("f", 0, theirs.SE3.Identity(), ours.OP_FRAME)
    with pytest.raises(TypeError, match=rf"{OF}Inertia, which {FACE}Inertia\(\.\.\.\) converts"):
        model.inertias[0] = theirs.Inertia.Random()


def test_a_model_of_the_library_itself_is_named_by_its_module() -> None:
    with pytest.raises(
        TypeError, match=r"model is a spatialdyn\.model\.model\.Model, which the calls of spatialdyn itself take"
    ):
        ours.rnea(sd.load_urdf("two_link"), ours.Model().createData(), *[np.zeros(2)] * 3)
    model = ours.buildSampleModelManipulator()
    with pytest.raises(TypeError, match="q is a list, expected"):  # of no module that helps
        ours.crba(model, model.createData(), [0.0] * 6)


# --- operators of both ------------------------------------------------------------------------------------


def _values() -> dict[str, tuple[Any, Any]]:
    """An object of each class, Pinocchio's own and ours."""
    R = theirs.SE3.Random().rotation
    made = {name: getattr(theirs, name).Random() for name in ("SE3", "Motion", "Force", "Inertia")}
    made |= {"Quaternion": theirs.Quaternion(R), "AngleAxis": theirs.AngleAxis(R)}
    return {name: (x, getattr(ours, name)(x)) for name, x in made.items()}


def _numbers(x: Any) -> Any:
    found = next((getattr(x, name) for name in ("homogeneous", "vector", "coeffs", "matrix") if hasattr(x, name)), x)
    return np.asarray(found() if callable(found) else found, float)


OPERATORS = (operator.add, operator.sub, operator.mul, operator.xor)


@pytest.mark.parametrize("act", OPERATORS, ids=lambda x: x.__name__)
def test_operators_take_objects_of_both(act: Any) -> None:
    """Of all pairs of classes: with one operand of each library, on either side, what Pinocchio gives of its own."""
    values, answered = _values(), 0
    for left, a in values.items():
        for right, b in values.items():
            try:
                wanted = act(a[0], b[0])
            except TypeError:
                wanted = None
            for mixed in ((a[1], b[0]), (a[0], b[1])):
                if wanted is None:
                    with pytest.raises(TypeError):
                        act(*mixed)
                    continue
                np.testing.assert_allclose(_numbers(act(*mixed)), _numbers(wanted), rtol=0, atol=1e-12, err_msg=left)
                answered += 1
            assert right
    assert answered >= 4


@pytest.mark.parametrize("name", ["SE3", "Motion", "Force", "Inertia", "Quaternion", "AngleAxis"])
def test_equality_compares_with_pinocchios_own(name: str) -> None:
    (given, mine), (other, _) = _values()[name], _values()[name]
    assert mine == given
    assert given == mine
    assert mine != other
    assert mine.isApprox(given)
    assert not mine.isApprox(other)
    if name in ("SE3", "Motion", "Force", "Inertia"):
        M = ours.SE3.Random()
        assert M.act(given).isApprox(M.act(mine))
        assert M.actInv(given).isApprox(M.actInv(mine))


def test_a_model_of_the_library_is_named_with_what_takes_it() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(TypeError, match=r"spatialdyn\.model\.model\.Model, which the calls of spatialdyn itself take"):
        ours.rnea(model, None, np.zeros(2), np.zeros(2), np.zeros(2))
