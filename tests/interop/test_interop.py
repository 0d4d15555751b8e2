"""Models of Pinocchio, and states as MuJoCo and Drake write them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls.random_configurations import random_configuration
from spatialdyn.interop.pinocchio import from_pinocchio
from spatialdyn.interop.states import from_drake, from_mujoco, to_drake, to_mujoco
from spatialdyn.urdf.load import find_robot

pin = pytest.importorskip("pinocchio")
EPS = np.finfo(float).eps
ORACLE = 1e-11  # relative to the largest entry, the bound the library promises for robots
UNPHYSICAL = pytest.mark.filterwarnings("ignore:.*principal moments")  # some of the models have such inertias
ROUNDING = 64 * EPS  # a few rotations of numbers of order one


def inertia(mass: float = 1.0) -> pin.Inertia:
    """A body whose com is off its frame."""
    return pin.Inertia(mass, np.array([0.1, -0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))


def chain(*joints: Any) -> pin.Model:
    """A chain of Pinocchio's joints j1, j2, ... with rotated placements and a body each."""
    model = pin.Model()
    for i, joint in enumerate(joints, start=1):
        placement = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2 * i, 0.5), np.array([0.1, 0.2 * i, -0.3]))
        model.addJoint(i - 1, joint, pin.SE3.Identity() if i == 1 else placement, f"j{i}")
        model.appendBodyToJoint(i, inertia(float(i)), pin.SE3.Identity())
    return model


def assert_equal(ours: np.ndarray, theirs: np.ndarray) -> None:
    assert np.shape(ours) == np.shape(theirs)
    assert np.max(np.abs(ours - theirs), initial=0.0) <= ORACLE * max(1.0, np.max(np.abs(theirs), initial=0.0))


def assert_same_model(theirs: pin.Model, seed: int = 0) -> sd.Model:
    """Everything that can be compared, at two random states."""
    model = from_pinocchio(theirs)
    data, rng = theirs.createData(), np.random.default_rng(seed)
    assert (model.nq, model.nv, model.njoints) == (theirs.nq, theirs.nv, theirs.njoints)
    assert list(model.names) == list(theirs.names)
    assert [j.idx_q for j in model.joints[1:]] == list(theirs.idx_qs)[1:]
    assert [j.idx_v for j in model.joints[1:]] == list(theirs.idx_vs)[1:]
    assert (model.gravity == theirs.gravity.linear).all()
    assert (model.armature == theirs.armature).all()
    for _ in range(2):
        q = random_configuration(model, rng)
        v, a = rng.normal(size=(2, model.nv))
        assert_equal(sd.rnea(model, q, v, a), pin.rnea(theirs, data, q, v, a))
        assert_equal(sd.crba(model, q), pin.crba(theirs, data, q))
        tau = sd.rnea(model, q, v, a)
        if model.nv:
            solved, condition = pin.aba(theirs, data, q, v, tau), np.linalg.cond(sd.crba(model, q))
            apart = np.max(np.abs(sd.aba(model, q, v, tau) - solved)) / max(1.0, np.max(np.abs(solved)))
            assert apart <= max(ORACLE, condition * np.finfo(float).eps)  # what rounding of the inputs moves either
        pin.framesForwardKinematics(theirs, data, q)
        for frame, X in zip(theirs.frames, data.oMf, strict=True):
            kind = frame.type.name
            name = f"{'joint' if kind in ('JOINT', 'FIXED_JOINT') else 'link'}:{frame.name}"
            if frame.name == "universe":
                name = "link:universe"
            assert_equal(sd.frame_placement(model, q, name), X.homogeneous)
    return model


# --- models of Pinocchio ---------------------------------------------------------------------------------


@UNPHYSICAL
@pytest.mark.parametrize(
    "make", [pin.buildSampleModelHumanoidRandom, pin.buildSampleModelManipulator, pin.buildSampleModelHumanoid]
)
def test_sample_models_compute_the_same(make: Callable[[], pin.Model]) -> None:
    assert_same_model(make())


@UNPHYSICAL
@pytest.mark.parametrize(
    "robot",
    slow_but(
        ["panda", "solo12", "quadrotor_base"],
        ["ur5_robot", "kinova", "panda", "solo12", "anymal_b_simple_description/anymal", "quadrotor_base", "pr2"],
    ),
)
@pytest.mark.parametrize("floating", [False, True])
def test_robots_compute_the_same(robot: str, floating: bool) -> None:
    path = str(find_robot(robot))
    theirs = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromUrdf(path)
    model = assert_same_model(theirs)
    one = [joint.idx_q for joint in model.joints[1:] if joint.nq == 1]
    assert (model.lower[one] == theirs.lowerPositionLimit[one]).all()
    assert (model.upper[one] == theirs.upperPositionLimit[one]).all()
    where = [joint.idx_v for joint in model.joints[1:] if joint.nq == 1]
    for ours, name in (("effort_limit", "effortLimit"), ("velocity_limit", "velocityLimit"), ("friction", "friction"),
                       ("damping", "damping")):  # fmt: skip
        assert (getattr(model, ours)[where] == getattr(theirs, name)[where]).all()


def test_links_joints_and_frames_are_those_of_the_urdf() -> None:
    path = str(find_robot("ur5_robot"))
    model, read = from_pinocchio(pin.buildModelFromUrdf(path)), sd.load_urdf(path)
    assert {(f.name, f.kind) for f in model.frames} - {(f.name, f.kind) for f in read.frames} == {
        ("universe", "link"),
        ("world_fixed", "joint"),
    }
    assert {(f.name, f.kind) for f in read.frames} <= {(f.name, f.kind) for f in model.frames}


def test_every_supported_joint_computes_the_same() -> None:
    axis = np.array([1.0, -2.0, 2.0]) / 3.0
    assert_same_model(
        chain(
            pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(),
            pin.JointModelRevoluteUnaligned(axis), pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ(),
            pin.JointModelPrismaticUnaligned(axis), pin.JointModelRUBX(), pin.JointModelRUBY(), pin.JointModelRUBZ(),
            pin.JointModelSpherical(), pin.JointModelPlanar(), pin.JointModelHX(0.3), pin.JointModelHY(-0.2),
            pin.JointModelHZ(0.0), pin.JointModelHelicalUnaligned(axis, 0.7),
        )
    )  # fmt: skip


def test_unaligned_unbounded_joint_computes_the_same() -> None:
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="2"/><origin xyz="0.1 0.2 0.3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="1 -2 2"/></joint></robot>"""
    assert assert_same_model(pin.buildModelFromXML(text)).nq == 2


def test_free_flyer_hangs_where_it_is_placed() -> None:
    assert_same_model(
        chain(pin.JointModelRY(), pin.JointModelFreeFlyer(), pin.JointModelRZ(), pin.JointModelFreeFlyer())
    )


def test_branches_keep_the_declared_order() -> None:
    theirs = chain(pin.JointModelRX(), pin.JointModelRY())
    theirs.addJoint(1, pin.JointModelPZ(), pin.SE3.Identity(), "a")
    theirs.appendBodyToJoint(3, inertia(), pin.SE3.Identity())
    theirs.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "A")
    theirs.appendBodyToJoint(4, inertia(), pin.SE3.Identity())
    assert assert_same_model(theirs).names == ("universe", "j1", "j2", "a", "A")


def test_gravity_and_armature_are_kept() -> None:
    theirs = chain(pin.JointModelFreeFlyer(), pin.JointModelSpherical(), pin.JointModelRX())
    theirs.gravity.linear = np.array([1.0, 2.0, -3.0])
    theirs.armature = np.array([0.5] * 6 + [0.25] * 3 + [0.125])
    assert_same_model(theirs)


def test_operational_and_repeated_frames_are_links() -> None:
    theirs = chain(pin.JointModelRX(), pin.JointModelRY())
    X = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.4, 0.5, 0.6]))
    theirs.addFrame(pin.Frame("tool", 2, 0, X, pin.FrameType.OP_FRAME))
    theirs.addFrame(pin.Frame("eye", 1, 0, X, pin.FrameType.SENSOR))
    theirs.addFrame(pin.Frame("stand", 0, 0, X, pin.FrameType.BODY))
    theirs.addFrame(pin.Frame("weld", 2, 0, X, pin.FrameType.FIXED_JOINT))
    assert_same_model(theirs)
    theirs.addFrame(pin.Frame("tool", 1, 0, X, pin.FrameType.BODY))
    model = from_pinocchio(theirs)
    assert [n for n in model.robot.notes if 'frame "tool"' in n]
    assert {"tool", "tool_"} <= {f.name for f in model.frames}


def test_a_joints_link_is_its_first_body_frame_at_the_identity() -> None:
    theirs, one = chain(pin.JointModelRX(), pin.JointModelRY()), pin.SE3.Identity()
    moved = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
    for name, placement in (("off", moved), ("first", one), ("second", one)):
        theirs.addFrame(pin.Frame(name, 1, 0, placement, pin.FrameType.BODY))
    model = assert_same_model(theirs)
    assert {j.name: j.child for j in model.robot.joints if j.kind != "fixed"} == {"j1": "first", "j2": "j2"}


def test_a_frames_own_joint_has_a_name_that_is_not_taken() -> None:
    theirs = pin.Model()
    theirs.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "tool_fixed")
    theirs.appendBodyToJoint(1, inertia(), pin.SE3.Identity())
    for name in ("tool", "tool_"):
        theirs.addFrame(pin.Frame(name, 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model = assert_same_model(theirs)
    assert sorted(j.name for j in model.robot.joints) == ["tool__fixed", "tool_fixed", "tool_fixed_"]


def test_what_a_model_cannot_hold_is_noted() -> None:
    theirs = chain(pin.JointModelFreeFlyer(), pin.JointModelRX())
    theirs.lowerPositionLimit[:3] = [-1.0, -2.0, -3.0]
    theirs.effortLimit[:3] = [1.0, 2.0, 3.0]
    notes = "\n".join(from_pinocchio(theirs).robot.notes)
    assert 'joint "j1" has position limits [-1.0, -2.0, -3.0]' in notes
    assert 'joint "j1" has effortLimit [1.0, 2.0, 3.0,' in notes
    assert "j2" not in notes


def test_root_body_counts_in_no_mass() -> None:
    theirs = chain(pin.JointModelRX())
    theirs.appendBodyToJoint(0, inertia(7.0), pin.SE3.Identity())
    model = assert_same_model(theirs)
    assert model.total_mass == pin.computeTotalMass(theirs) == 1.0
    assert model.robot.links[0].mass == 7.0


@pytest.mark.parametrize("name", ["SphericalZYX", "Translation", "Universal", "Composite", "Ellipsoid"])
def test_other_joints_are_refused_by_name(name: str) -> None:
    made = {
        "Universal": lambda: pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1]),
        "Composite": lambda: pin.JointModelComposite(pin.JointModelRX()),
    }.get(name, getattr(pin, f"JointModel{name}"))
    with pytest.raises(sd.ModelError, match=f'joint "j2" is a JointModel{name}, expected a revolute'):
        from_pinocchio(chain(pin.JointModelRX(), made()))


def test_mimic_joints_are_refused() -> None:
    with pytest.raises(sd.ModelError, match="is a JointModelMimic"):
        from_pinocchio(pin.buildSampleModelManipulator(True))


def test_joints_out_of_order_are_refused() -> None:
    theirs = chain(pin.JointModelRX(), pin.JointModelRY())
    theirs.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "b")
    theirs.addJoint(1, pin.JointModelRX(), pin.SE3.Identity(), "c")
    with pytest.raises(sd.ModelError, match='joint "c" hangs on "j1" and follows "b"'):
        from_pinocchio(theirs)


def test_unequal_armatures_are_kept() -> None:
    theirs = chain(pin.JointModelFreeFlyer(), pin.JointModelSpherical())
    theirs.armature = np.arange(9.0)
    assert_same_model(theirs)


def test_of_unequal_limits_of_a_joint_the_largest_is_kept_and_noted() -> None:
    theirs = chain(pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelFreeFlyer())
    theirs.velocityLimit = np.array([9.0, 1.0, 3.0, 2.0, 4.0, 5.0, 5.0, 5.0, 5.0, 8.0])
    theirs.effortLimit = np.full(10, 7.0)
    theirs.damping = np.array([0.1, 0.5, 0.3, 0.4, *[0.2] * 6])
    model = from_pinocchio(theirs)
    assert model.velocity_limit.tolist() == [9.0, *[3.0] * 3, *[8.0] * 6]
    assert model.effort_limit.tolist() == [7.0] * 10
    assert model.damping.tolist() == [0.1, *[0.5] * 3, *[0.2] * 6]
    kept = [
        note for note in model.robot.notes if note.endswith("expected one for all its freedoms; the largest is kept")
    ]
    assert [note.split("[")[0] for note in kept] == [
        'joint "j2" has velocityLimit ', 'joint "j2" has damping ', 'joint "j3" has velocityLimit ',
    ]  # fmt: skip


def test_other_objects_are_refused() -> None:
    with pytest.raises(sd.ModelError, match="pin_model is a str"):
        from_pinocchio("ur5.urdf")


# --- states of MuJoCo and Drake --------------------------------------------------------------------------


def falling_body() -> sd.Model:
    """A floating body that carries a hinge."""
    builder = sd.ModelBuilder("body", root="ground")
    builder.add_body("base", joint="floating", joint_name="free", inertia=(2.0, (0.1, 0.0, 0.0), np.eye(3)))
    builder.add_body("arm", "base", "revolute", (1, 0, 0), (0.0, 0.0, 0.5), (1.0, (0.0, 0.3, 0.0), np.eye(3)), "hinge")
    return builder.build()


def test_states_by_hand() -> None:
    """The base is turned by 90° about z: its x axis is the world's y axis, its y axis the world's -x axis."""
    model, s = falling_body(), math.sqrt(0.5)
    q = np.array([1.0, 2.0, 3.0, 0.0, 0.0, s, s, 0.7])
    v = np.array([4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 0.8])
    qpos, qvel = to_mujoco(model, q, v)
    np.testing.assert_array_equal(qpos, [1.0, 2.0, 3.0, s, 0.0, 0.0, s, 0.7])
    np.testing.assert_allclose(qvel, [-5.0, 4.0, 6.0, 7.0, 8.0, 9.0, 0.8], atol=1e-14)
    dq, dv = to_drake(model, q, v)
    np.testing.assert_array_equal(dq, [s, 0.0, 0.0, s, 1.0, 2.0, 3.0, 0.7])
    np.testing.assert_allclose(dv, [-8.0, 7.0, 9.0, -5.0, 4.0, 6.0, 0.8], atol=1e-14)


def test_order_of_joints_by_hand() -> None:
    model, s = falling_body(), math.sqrt(0.5)
    q, v = np.array([1.0, 2.0, 3.0, s, 0.0, 0.0, s, 0.7]), np.arange(7.0)
    qpos, qvel = to_mujoco(model, q, v, joints=["hinge", "free"])
    np.testing.assert_array_equal(qpos, [0.7, 1.0, 2.0, 3.0, s, s, 0.0, 0.0])
    assert qvel[0] == 6.0
    back = from_mujoco(model, qpos, qvel, joints=["hinge", "free"])
    np.testing.assert_allclose(back[0], q, atol=1e-15)
    np.testing.assert_allclose(back[1], v, atol=1e-14)


def test_pairs_become_angles() -> None:
    builder = sd.ModelBuilder()
    builder.add_body("wheel", joint="continuous").add_body("car", joint="planar")
    model = builder.build(continuous="cos_sin")
    # joints in byte order: car, wheel; the car is turned by 90°, so its x axis is the plane's y axis
    q, v = [1.0, 2.0, 0.0, 1.0, math.cos(-3.0), math.sin(-3.0)], [5.0, 6.0, 7.0, 8.0]
    for to in (to_mujoco, to_drake):
        x, w = to(model, q, v)
        np.testing.assert_allclose(x, [1.0, 2.0, math.pi / 2, -3.0], atol=1e-15)
        np.testing.assert_allclose(w, [-6.0, 5.0, 7.0, 8.0], atol=1e-14)


@pytest.mark.parametrize("continuous", ["angle", "cos_sin"])
@pytest.mark.parametrize(("to", "back"), [(to_mujoco, from_mujoco), (to_drake, from_drake)])
def test_there_and_back_is_the_identity(to: Any, back: Any, continuous: str) -> None:
    kinds = ["revolute", "continuous", "prismatic", "planar"] + ["spherical"] * (to is to_mujoco)
    kinds += ["floating", "helical"] if to is to_drake else []
    rng = np.random.default_rng(3)
    for seed in range(4):
        model = random_tree(seed, 7, kinds, floating=True, continuous=continuous).model
        q, v = random_configuration(model, rng, (2, 3)), rng.normal(size=(2, 3, model.nv))
        order = list(rng.permutation(model.names[1:]))
        there = to(model, q, v, joints=order)
        q1, v1 = back(model, *there, joints=order)
        assert abs(q1 - q).max() <= ROUNDING
        assert abs(v1 - v).max() <= ROUNDING
        again = to(model, q1, v1, joints=order)
        assert max(abs(x - y).max() for x, y in zip(again, there, strict=True)) <= ROUNDING


@pytest.mark.parametrize("to", [to_mujoco, to_drake])
def test_velocities_are_the_rates_of_their_positions(to: Any) -> None:
    """Along integrate(q, v h) their positions change by their velocities: ẋ = v for points, 2 q̇ q* = (0, ω)."""
    model = random_tree(5, 5, ["revolute", "continuous", "planar", "prismatic"], floating=True).model
    rng, h = np.random.default_rng(0), 1e-6
    q, v = random_configuration(model, rng), rng.normal(size=model.nv)
    x, w = to(model, q, v)
    after, before = (to(model, sd.integrate(model, q, s * v), v)[0] for s in (h, -h))
    rate = (after - before) / (2 * h)
    mujoco = to is to_mujoco
    quat, place, spin, speed = (
        (slice(3, 7), slice(0, 3), slice(3, 6), slice(0, 3))
        if mujoco
        else (slice(0, 4), slice(4, 7), slice(0, 3), slice(3, 6))
    )
    angular = (
        2.0 * hamilton(conjugate(x[quat]), rate[quat]) if mujoco else 2.0 * hamilton(rate[quat], conjugate(x[quat]))
    )
    tolerance = 1e-8  # h² and eps / h
    np.testing.assert_allclose(angular[1:], w[spin], atol=tolerance)
    np.testing.assert_allclose(rate[place], w[speed], atol=tolerance)
    np.testing.assert_allclose(rate[7:], w[6:], atol=tolerance)


def conjugate(a: np.ndarray) -> np.ndarray:
    """The conjugate of a quaternion w x y z."""
    return a * np.array([1.0, -1.0, -1.0, -1.0])


def hamilton(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product of quaternions w x y z."""
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def test_batches_broadcast_and_match_single_samples() -> None:
    model, rng = falling_body(), np.random.default_rng(1)
    q, v = random_configuration(model, rng, (4, 1)), rng.normal(size=(3, model.nv))
    for to, back in ((to_mujoco, from_mujoco), (to_drake, from_drake)):
        x, w = to(model, q, v)
        assert x.shape == (4, 3, 8)
        assert w.shape == (4, 3, 7)
        one = to(model, q[2, 0], v[1])
        assert (x[2, 1] == one[0]).all()
        assert (w[2, 1] == one[1]).all()
        assert back(model, x[:, :1], w)[0].shape == (4, 3, 8)


def test_nan_stays_in_its_sample() -> None:
    model, rng = falling_body(), np.random.default_rng(1)
    q, v = random_configuration(model, rng, (3,)), rng.normal(size=(3, model.nv))
    q[1, 4] = np.nan
    for to in (to_mujoco, to_drake):
        x, w = to(model, q, v)
        assert np.isnan(x[1]).any()
        assert np.isfinite(x[[0, 2]]).all()
        assert np.isfinite(w[[0, 2]]).all()


def test_states_that_do_not_fit_are_refused() -> None:
    model = falling_body()
    q, v = sd.neutral(model), np.zeros(7)
    with pytest.raises(sd.ShapeError, match=r"qpos has shape \(7,\), expected \(\.\.\., 8\)"):
        from_mujoco(model, q[:7], v)
    with pytest.raises(sd.ShapeError, match=r"v has shape \(6,\), expected \(\.\.\., 7\)"):
        to_drake(model, q, v[:6])
    with pytest.raises(sd.ConfigurationError, match='joint "free" has a quaternion of norm 2, expected 1'):
        to_mujoco(model, q * 2.0, v)
    with pytest.raises(sd.ConfigurationError, match=r"norm 0 in sample 1, the first of 1, expected 1"):
        from_drake(model, np.array([[1.0, *[0.0] * 7], [0.0] * 8]), v)
    with pytest.raises(sd.SpatialDynError, match='joints are "free", expected all'):
        to_mujoco(model, q, v, joints=["free"])
    with pytest.raises(sd.SpatialDynError, match='joints are "free", "hinge", "free"'):
        to_mujoco(model, q, v, joints=["free", "hinge", "free"])
    with pytest.raises(sd.ModelError, match='joint "elbow" is not in robot'):
        to_mujoco(model, q, v, joints=["free", "elbow"])
    with pytest.raises(sd.ModelError, match="model is a NoneType"):
        to_mujoco(None, q, v)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "changes", "part"),
    [
        ("floating", (to_mujoco, to_drake), slice(3, 7)),
        ("floating", (from_mujoco,), slice(3, 7)),
        ("floating", (from_drake,), slice(0, 4)),
        ("spherical", (to_mujoco, from_mujoco), slice(0, 4)),
        ("continuous", (to_mujoco, to_drake), slice(0, 2)),
        ("planar", (to_mujoco, to_drake), slice(2, 4)),
    ],
)
def test_a_norm_that_is_not_one_is_refused_both_ways(
    kind: str, changes: tuple[Callable[..., Any], ...], part: slice
) -> None:
    model = sd.ModelBuilder().add_body("b", joint=kind, joint_name="one").build(continuous="cos_sin")
    for change in changes:
        state = np.zeros((3, model.nq))
        state[:, part.start] = 1.0
        change(model, state, np.zeros(model.nv))
        state[2, part] *= 1.0 + 2e-6
        with pytest.raises(
            sd.ConfigurationError, match=r'joint "one" has a .* in sample 2, the first of 1, expected 1'
        ):
            change(model, state, np.zeros(model.nv))


def test_joints_that_others_lack_are_refused() -> None:
    ball = sd.ModelBuilder().add_body("b", joint="spherical").build()
    with pytest.raises(sd.SpatialDynError, match='joint "b_joint" is spherical'):
        to_drake(ball, [0, 0, 0, 1], [0, 0, 0])
    screw = sd.ModelBuilder().add_body("b", joint="helical", pitch=0.1).build()
    with pytest.raises(sd.SpatialDynError, match='joint "b_joint" is helical, expected a kind of joint that MuJoCo'):
        to_mujoco(screw, [0.0], [0.0])
    moved = sd.ModelBuilder().add_body("b", joint="floating", placement=(1, 0, 0)).build()
    with pytest.raises(sd.SpatialDynError, match='floating joint "b_joint" hangs on "universe"'):
        to_mujoco(moved, sd.neutral(moved), np.zeros(6))
    builder = sd.ModelBuilder().add_body("a").add_body("b", mimic={"leader": "a_joint"})
    with pytest.raises(sd.SpatialDynError, match=r'joints "b_joint" have no coordinates, expected .* mimic=False'):
        to_mujoco(builder.build(mimic=True), [0.0], [0.0])


def test_model_without_joints_has_empty_states() -> None:
    model = sd.ModelBuilder().build()
    for change in (to_mujoco, from_mujoco, to_drake, from_drake):
        q, v = change(model, np.empty((5, 0)), np.empty(0))
        assert q.shape == v.shape == (5, 0)
