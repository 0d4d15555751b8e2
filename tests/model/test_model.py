"""The Model: its parts, its notes, and models derived from it."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import dense
import numpy as np
import pytest
from asymmetric import primes
from inputs import no_programs
from numpy.typing import ArrayLike, NDArray
from slow import slow_but
from trees import KINDS, merged, random_inertia, random_placement, random_state, random_tree, random_unit

import spatialdyn as sd
from spatialdyn.engines import threads
from spatialdyn.errors import InertiaError, ModelError
from spatialdyn.model.builder import ModelBuilder
from spatialdyn.model.model import Frame, Joint, Model, Options, assemble
from spatialdyn.model.robot import Robot
from spatialdyn.model.robot_checks import rpy_matrix
from spatialdyn.urdf.robot_files import find_robot

Array = NDArray[np.float64]
BALL = (1.0, (0.1, 0.2, 0.3), np.diag([0.1, 0.1, 0.1]))
TOLERANCE = 1e-12  # times the largest entry: some thousand roundings


def close(x: Any, y: Any) -> None:
    """Equal up to rounding of the largest entry."""
    np.testing.assert_allclose(x, y, rtol=0, atol=TOLERANCE * max(1.0, float(np.abs(y).max(initial=0.0))))


def arm(**fields: Any) -> ModelBuilder:
    """Two joints and a tool on a fixed one."""
    b = ModelBuilder("arm").set_inertia("base", BALL)
    b.add_body("upper", joint="revolute", axis=(0, 1, 0), inertia=BALL, joint_name="shoulder", **fields)
    b.add_body("lower", "upper", "prismatic", (1, 0, 0), (0, 0, 1), BALL, "elbow", limits=(-1, 2), armature=0.25)
    return b.add_body("tool", "lower", "fixed", placement=((0, 0, 0.5), (0.1, 0.2, 0.3)), inertia=BALL)


def random_q(model: Model, rng: np.random.Generator) -> Array:
    """A random configuration: the neutral one, moved."""
    return np.asarray(sd.integrate(model, sd.neutral(model), rng.normal(size=model.nv)))


def message(call: Any, *arguments: Any, **options: Any) -> str:
    """The message of a ModelError."""
    with pytest.raises(ModelError) as caught:
        call(*arguments, **options)
    text = str(caught.value)
    assert not text.endswith(".")
    return text


MODELS: dict[str, Callable[[], Model]] = {
    "arm": lambda: arm().build(),
    "floating": lambda: arm().build(root="floating", gravity=(1, 2, 3)),
    "tree": lambda: sd.load_urdf("tree"),
    "mimic": lambda: sd.load_urdf("tree", mimic=True),
    "every kind": lambda: random_tree(1, 8, KINDS, continuous="cos_sin").model,
    "locked": lambda: sd.load_urdf("tree", root="floating").reduced(
        {"root_joint": [1, 2, 3, 0, 0, 0.6, 0.8], "lift": 0.2}
    ),
    "no joints": lambda: ModelBuilder("rock").build(),
}
models = pytest.mark.parametrize("name", MODELS)


# --- a Model is a value -----------------------------------------------------------------------------------


@models
def test_pickles_and_copies_are_equal_and_compute_the_same(name: str) -> None:
    model = MODELS[name]()
    for other in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model), copy.copy(model), MODELS[name]()):
        assert other == model
        assert hash(other) == hash(model)
        assert other.key == model.key
        assert other.bodies.tobytes() == model.bodies.tobytes()
        assert [f[:3] for f in other.frames] == [f[:3] for f in model.frames]
        assert (str(other), repr(other)) == (str(model), repr(model))
        for slot in ("lower", "upper", "armature", "gravity", "mimic_index", "mimic_offset", "free_q", "free_v"):
            np.testing.assert_array_equal(getattr(other, slot), getattr(model, slot))


def test_what_differs_is_not_equal() -> None:
    model = arm().build()
    others = [
        arm().build(root="floating"),
        arm().build(gravity=(0, 0, -9.8)),
        arm(armature=0.1).build(),
        model.with_(payload={"tool": BALL}),
        model.reduced({"elbow": 0.1}),
    ]
    assert len({model, *others}) == len({m.key for m in (model, *others)}) == 6
    assert all(model != other for other in others)  # a set looks at the keys first
    assert model != model.robot
    assert arm(limits=(0, 1)).build() != model  # but it computes the same
    assert arm(limits=(0, 1)).build().key == model.key


def test_notes_are_no_part_of_what_is_compared() -> None:
    robot = arm().robot()
    noted = assemble(Robot(robot.name, robot.root, robot.links, robot.joints, ("odd",)))
    assert noted == assemble(robot)
    assert noted.robot.notes == ("odd",)


def test_zeros_of_either_sign_are_one_model() -> None:
    def pendulum(zero: float) -> Model:
        b = ModelBuilder().set_inertia("base", BALL)
        b.add_body("rod", axis=(zero, 1.0, zero), placement=(zero, 1.0, zero), inertia=(1.0, (zero,) * 3, np.eye(3)))
        model: Model = b.build(gravity=(zero, zero, -9.81))
        return model

    assert pendulum(0.0) == pendulum(-0.0)
    assert hash(pendulum(0.0)) == hash(pendulum(-0.0))


def test_zeros_of_either_sign_are_one_mimic() -> None:
    def hand(ratio: float, offset: float) -> Model:
        made: Model = fingers(("a", None, 0.0, 0.0), ("b", "a", ratio, offset)).build(mimic=True)
        return made

    assert hand(0.0, 0.0) == hand(-0.0, -0.0)
    assert hash(hand(0.0, 0.0)) == hash(hand(-0.0, 0.0)) == hash(hand(0.0, -0.0))
    assert hand(0.0, 0.0).key == hand(-0.0, -0.0).key


def test_equal_limits_of_other_types_are_equal_models() -> None:
    assert arm(armature=1).build() == arm(armature=1.0).build()
    assert arm().build(mimic=0) == arm().build(mimic=False)
    assert arm().build(gravity=[0, 0, -9]) == arm().build(gravity=np.array([0.0, 0.0, -9.0]))


@models
def test_nothing_of_it_can_be_changed(name: str) -> None:
    model = MODELS[name]()
    for slot in ("bodies", "nq", "name", "anything"):
        with pytest.raises(AttributeError, match="immutable"):
            setattr(model, slot, 1)
        with pytest.raises(AttributeError):
            delattr(model, slot)
    arrays = [getattr(model, slot) for slot in Model.__slots__ if slot != "__weakref__"]
    arrays += [part for parts in (*model.joints, *model.frames) for part in parts]
    arrays = [x for x in arrays if isinstance(x, np.ndarray)]
    assert len(arrays) >= 11
    for x in arrays:
        assert not x.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            x[...] = 0


def test_it_prints_as_a_readable_tree() -> None:
    assert str(arm().build()) == (
        "arm: 2 freedoms, 3 kg moving, fixed root\n"
        "base  1 kg\n"
        "  upper <- shoulder (revolute)  1 kg\n"
        "    lower <- elbow (prismatic)  1 kg\n"
        "      tool <- tool_joint (fixed)  1 kg"
    )
    assert repr(arm().build(root="floating")) == "<Model arm: nq 9, nv 8, 4 links, 4 kg>"


# --- joints and frames by name ----------------------------------------------------------------------------


def test_joints_know_their_places() -> None:
    model = arm().build(root="floating")
    assert model.names == ("universe", "root_joint", "shoulder", "elbow")
    assert model.njoints == 4
    root, shoulder, elbow = model.joints[1:]
    assert [j.parent for j in model.joints] == [0, 0, 1, 2]
    assert (root.idx_q, root.nq, root.idx_v, root.nv, root.row) == (0, 7, 0, 6, 6)
    assert (shoulder.idx_q, shoulder.nq, shoulder.idx_v, shoulder.nv, shoulder.row) == (7, 1, 6, 1, 7)
    assert model.joint("elbow") is elbow
    assert isinstance(elbow, Joint)
    assert elbow.placement[:3, 3].tolist() == [0, 0, 1]
    assert (model.lower[-1], model.upper[-1], model.armature[-1]) == (-1.0, 2.0, 0.25)
    assert np.isinf(model.lower[:8]).all()


def test_a_frame_is_a_links_before_it_is_a_joints() -> None:
    b = ModelBuilder("twins")
    b.add_body("a", placement=(1, 0, 0), inertia=BALL, joint_name="b")
    b.add_body("b", "a", "fixed", placement=(0, 2, 0), inertia=BALL, joint_name="a")
    model = b.build()
    assert [model.frame(n).kind for n in ("a", "b", "link:a", "joint:a")] == ["link", "link", "link", "joint"]
    assert model.frame("joint:b").placement[:3, 3].tolist() == [0, 0, 0]
    assert model.frame("b").placement[:3, 3].tolist() == [0, 2, 0]
    assert model.frame("joint:a").joint == 1
    frame = model.frame("base")
    assert isinstance(frame, Frame)
    assert model.frame(frame) is frame
    assert arm().build().frame("elbow").kind == "joint"


def test_unknown_names_come_with_near_ones() -> None:
    model = arm().build()
    assert message(model.joint, "elbo") == 'joint "elbo" is not in robot "arm", did you mean elbow'
    assert message(model.frame, "tol") == 'frame "tol" is not in robot "arm", did you mean tool'
    assert message(model.frame, "joint:tool").startswith('frame "joint:tool" is not in robot "arm"')
    assert message(model.frame, "xyz") == 'frame "xyz" is not in robot "arm"'
    assert message(model.subtree, "uper") == 'link "uper" is not in robot "arm", did you mean upper'
    assert message(model.with_, armature={"sholder": 1}).endswith("did you mean shoulder")
    assert message(model.with_, payload={"tol": BALL}).endswith("did you mean tool")
    assert message(model.reduced, ["elbo"]).endswith("did you mean elbow")
    assert message(model.with_, payload=["tool"]) == "payload is a list, expected a mapping of names to values"
    assert message(model.with_, armature=[0.1]) == "armature is a list, expected a mapping of names to values"
    assert message(model.reduced, {"tool_joint": 0}).startswith('joint "tool_joint" is not in robot "arm"')


def test_names_of_the_world_and_of_a_floating_root_are_reserved() -> None:
    b = ModelBuilder("odd").add_body("a", inertia=BALL, joint_name="root_joint")
    assert b.build().names == ("universe", "root_joint")
    assert b.build().reduced({"root_joint": 0.1}).nv == 0
    assert 'has a joint "root_joint", expected another name' in message(b.build, root="floating")
    assert 'has a joint "universe"' in message(ModelBuilder().add_body("a", joint_name="universe").build)


def test_unknown_options_are_refused_by_value() -> None:
    assert message(arm().build, root="hanging") == 'root is \'hanging\', expected "fixed" or "floating"'
    assert message(arm().build, continuous="quaternion").startswith("continuous is 'quaternion'")
    for gravity in (9.81, (0, 0), (0, 0, np.nan), "down", None, (0, 0, 1j)):
        assert message(arm().build, gravity=gravity).endswith("expected three finite numbers")
    assert message(Options, root=None) == 'root is None, expected "fixed" or "floating"'


# --- order and merging ------------------------------------------------------------------------------------


def test_joints_are_in_the_byte_order_of_their_names_depth_first() -> None:
    b = ModelBuilder()
    for name in ("j2", "alpha", "é", "j10", "Alpha", "_"):
        b.add_body(f"link {name}", inertia=BALL, joint_name=name)
    b.add_body("tip", "link alpha", inertia=BALL, joint_name="0")
    assert b.build().names[1:] == ("Alpha", "_", "alpha", "0", "j10", "j2", "é")


def test_an_ordered_robot_keeps_the_order_of_its_joints() -> None:
    robot = (
        ModelBuilder().add_body("x", joint_name="b", inertia=BALL).add_body("y", joint_name="a", inertia=BALL).robot()
    )
    assert assemble(robot).names[1:] == ("a", "b")
    ordered = Robot(robot.name, robot.root, robot.links, robot.joints, ordered=True)
    assert assemble(ordered).names[1:] == ("b", "a")
    assert assemble(ordered).subtree("base").names[1:] == ("b", "a")


def test_a_fixed_joints_own_name_orders_what_hangs_on_it() -> None:
    b = ModelBuilder().add_body("shelf", joint="fixed", joint_name="m")
    b.add_body("on shelf", "shelf", inertia=BALL, joint_name="a")
    b.add_body("left", inertia=BALL, joint_name="l")
    b.add_body("right", inertia=BALL, joint_name="z")
    assert b.build().names[1:] == ("l", "a", "z")


def test_fixed_joints_merge_into_the_body_and_stay_as_frames() -> None:
    rng = np.random.default_rng(3)
    body, further, T, at = random_inertia(rng), random_inertia(rng), random_placement(rng), random_placement(rng)
    two = ModelBuilder().add_body("a", "base", "spherical", placement=at, inertia=body)
    two.add_body("b", "a", "fixed", placement=T, inertia=further)
    two.add_body("c", "b", placement=T, inertia=body)
    one = ModelBuilder().add_body("a", "base", "spherical", placement=at, inertia=merged(body, further, T))
    one.add_body("c", "a", placement=T @ T, inertia=body)
    model, whole = two.build(), one.build()
    assert (model.nv, model.names[1:]) == (4, ("a_joint", "c_joint"))
    q, v, a = random_q(model, rng), rng.normal(size=4), rng.normal(size=4)
    close(sd.rnea(model, q, v, a), sd.rnea(whole, q, v, a))
    assert [f.name for f in model.frames] == ["base", "a_joint", "a", "b_joint", "b", "c_joint", "c"]
    assert [f.joint for f in model.frames] == [0, 1, 1, 1, 1, 2, 2]
    close(model.frame("b").placement, T)
    np.testing.assert_array_equal(model.frame("joint:b_joint").placement, model.frame("b").placement)


def test_what_hangs_on_a_fixed_root_counts_in_no_mass() -> None:
    b = arm().add_body("box", "base", "fixed", inertia=(50.0, (0, 0, 0), np.eye(3)))
    assert b.build().total_mass == sd.total_mass(arm().build()) == 3.0
    assert b.build().key == arm().build().key
    assert b.build(root="floating").total_mass == 54.0
    assert ModelBuilder().set_inertia("base", BALL).build().total_mass == 0.0


def test_cos_sin_gives_continuous_and_planar_joints_a_pair() -> None:
    b = ModelBuilder().add_body("a", "base", "continuous", (0, 1, 0), inertia=BALL)
    b.add_body("b", "a", "planar", (0, 0.6, 0.8), (0, 0, 1), BALL).add_body("c", "b", inertia=BALL, placement=(1, 0, 0))
    angle, pair = b.build(), b.build(continuous="cos_sin")
    assert [(m.nq, m.nv) for m in (angle, pair)] == [(5, 5), (7, 5)]
    assert [j.idx_q for j in pair.joints] == [0, 0, 2, 6]
    q, v, a = np.array([0.3, 0.1, 0.2, 0.4, 0.5]), np.arange(5.0), np.ones(5)
    p = [np.cos(0.3), np.sin(0.3), 0.1, 0.2, np.cos(0.4), np.sin(0.4), 0.5]
    close(sd.rnea(pair, p, v, a), sd.rnea(angle, q, v, a))


def test_a_chain_of_a_thousand_joints_needs_no_recursion() -> None:
    b = ModelBuilder("chain")
    for k in range(1000):
        b.add_body(f"link{k}", f"link{k - 1}" if k else "base", axis=(0, 1, 0), placement=(0, 0, 0.1), inertia=BALL)
    model = b.build(root="floating")
    assert (model.nv, model.njoints) == (1006, 1002)
    assert model.bodies["last_row"].tolist() == [1006] * 1007
    assert pickle.loads(pickle.dumps(model)) == copy.deepcopy(model) == model
    assert model.subtree("link500").nv == 499
    assert model.reduced({f"link{k}_joint": 0.0 for k in range(999)}).nv == 7
    assert str(model).count("\n") == 1001


# --- reduced ----------------------------------------------------------------------------------------------


def held(full: Model, part: Model, lock: Mapping[str, ArrayLike], q: Array) -> tuple[Array, list[int]]:
    """q of the full model, from the reduced one's and the locked coordinates; indices of remaining velocities."""
    whole = np.zeros(full.nq)
    left: list[int] = []
    for joint in full.joints[1:]:
        if joint.name in lock:
            whole[joint.idx_q : joint.idx_q + joint.nq] = lock[joint.name]
        else:
            own = part.joint(joint.name)
            whole[joint.idx_q : joint.idx_q + joint.nq] = q[own.idx_q : own.idx_q + own.nq]
            left += range(joint.idx_v, joint.idx_v + joint.nv)
    return whole, left


def some_coordinates(model: Model, joint: Joint, rng: np.random.Generator) -> Array:
    return random_q(model, rng)[joint.idx_q : joint.idx_q + joint.nq]


@pytest.mark.parametrize("continuous", ["angle", "cos_sin"])
@pytest.mark.parametrize("seed", slow_but([0, 1], range(6)))
def test_reduced_is_the_whole_with_those_joints_held(seed: int, continuous: str) -> None:
    rng = np.random.default_rng(seed)
    full = random_tree(seed, 9, KINDS, floating=seed % 2 == 1, continuous=continuous).model
    locked = [joint for joint in full.joints[1:] if rng.random() < 0.5]
    lock = {joint.name: some_coordinates(full, joint, rng) for joint in locked}
    part = full.reduced(lock)
    assert part.names == tuple(n for n in full.names if n not in lock)
    q = random_q(part, rng)
    whole, left = held(full, part, lock, q)
    v, a = np.zeros((2, full.nv))
    v[left], a[left] = rng.normal(size=(2, part.nv))
    fext = rng.normal(size=(full.njoints, 6)) * np.array([n not in lock for n in full.names])[:, None]
    fext[0] = 0.0
    kept = [k for k, n in enumerate(full.names) if n not in lock]
    close(sd.rnea(part, q, v[left], a[left], fext[kept]), sd.rnea(full, whole, v, a, fext)[left])
    close(sd.crba(part, q), sd.crba(full, whole)[np.ix_(left, left)])
    names = [
        (f.kind, f.name)
        for f in full.frames
        if (f.kind, f.name) != ("joint", "root_joint") or "root_joint" in part.names
    ]
    assert [(f.kind, f.name) for f in part.frames] == names
    for frame in (f"{kind}:{name}" for kind, name in names):
        close(sd.frame_placement(part, q, frame), sd.frame_placement(full, whole, frame))


def test_a_floating_root_locked_is_a_fixed_one_standing_elsewhere() -> None:
    rng = np.random.default_rng(0)
    full = arm().build(root="floating")
    place = np.concatenate([rng.normal(size=3), random_unit(rng, 4)])
    part = full.reduced({"root_joint": place})
    assert (part.options.root, part.nv, part.total_mass) == ("fixed", 2, 3.0)
    q = rng.normal(size=2)
    close(sd.generalized_gravity(part, q), sd.generalized_gravity(full, np.concatenate([place, q]))[6:])
    close(sd.frame_placement(part, q, "base"), sd.frame_placement(full, np.concatenate([place, q]), "base"))
    assert pickle.loads(pickle.dumps(part)) == part
    assert part.reduced({"elbow": 0.1}).frame("base").placement.tolist() == part.frame("base").placement.tolist()
    assert part.subtree("base") == arm().build()


def test_a_floating_root_moves_from_where_its_base_stands() -> None:
    """And is locked there: the base's pose first, then that of the root in it."""
    rng = np.random.default_rng(3)
    robot, base = arm().robot(), np.eye(4)
    base[:3, :3], base[:3, 3] = rpy_matrix(0.3, -0.2, 1.1), (1.0, 2.0, 3.0)
    full = Model(robot, Options("floating", base=tuple(base.ravel().tolist())))
    place = np.concatenate([rng.normal(size=3), random_unit(rng, 4)])
    q = rng.normal(size=2)
    at_origin = assemble(robot, root="floating")
    part = full.reduced({"root_joint": place})
    for name in ("base", "upper", "tool"):
        whole = np.concatenate([place, q])
        expected = base @ sd.frame_placement(at_origin, whole, name)
        close(sd.frame_placement(full, whole, name), expected)
        close(sd.frame_placement(part, q, name), expected)


def test_locking_in_two_steps_is_locking_at_once() -> None:
    model = sd.load_urdf("tree")
    twice = model.reduced({"lift": 0.1}).reduced({"left_elbow": 0.5, "turn": 0.3})
    assert twice == model.reduced({"turn": 0.3, "left_elbow": 0.5, "lift": 0.1})
    assert model.reduced({}) == model


def test_a_continuous_joint_of_a_pair_may_be_locked_at_an_angle() -> None:
    model = ModelBuilder().add_body("a", "base", "continuous", (0, 1, 0), inertia=BALL).build(continuous="cos_sin")
    by_angle, by_pair = model.reduced({"a_joint": 0.3}), model.reduced({"a_joint": [np.cos(0.3), np.sin(0.3)]})
    np.testing.assert_array_equal(by_angle.frame("a").placement, by_pair.frame("a").placement)


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("revolute", [0.0, 1.0], "is locked at [0.0, 1.0], expected 1 finite numbers"),
        ("revolute", np.nan, "is locked at nan, expected 1 finite numbers"),
        ("revolute", "far", "is locked at 'far', expected 1 finite numbers"),
        ("continuous", np.inf, "is locked at inf, expected 1 finite numbers"),
        ("continuous", [1.0, 1.0], "is locked at [1.0, 1.0], expected a part of unit norm"),
        ("continuous", [1.0, 0.0, 0.0], "expected 2 finite numbers"),
        ("spherical", [0.0, 0.0, 0.0], "expected 4 finite numbers"),
        ("spherical", [0.0, 0.0, 0.0, 2.0], "expected a part of unit norm"),
        ("spherical", [0.0, 0.0, np.nan, 1.0], "expected 4 finite numbers"),
        ("floating", [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0], "expected a part of unit norm"),
        ("planar", [5.0, 5.0, 0.6, 0.7], "expected a part of unit norm"),
        ("planar", [5.0, 5.0, 0.6], "expected 4 finite numbers"),
    ],
)
def test_what_no_joint_can_be_locked_at_is_refused(kind: str, value: Any, expected: str) -> None:
    model = ModelBuilder().add_body("a", "base", kind, inertia=BALL).build(continuous="cos_sin")
    text = message(model.reduced, {"a_joint": value})
    assert text.startswith('joint "a_joint" is locked at ')
    assert expected in text


def test_unknown_joints_and_the_world_are_not_locked() -> None:
    model = arm().build()
    assert message(model.reduced, {"elbw": 0.0}).endswith("did you mean elbow")
    assert message(model.reduced, {"root_joint": 0.0}).startswith('joint "root_joint" is not in robot')
    assert message(model.reduced, {"universe": 0.0}) == "the world cannot be locked"
    assert message(model.reduced, ["universe"]) == "the world cannot be locked"
    assert message(model.reduced, 3) == "lock is 3, expected names of joints, or a mapping of them to coordinates"


def test_joints_locked_by_name_rest_at_neutral_or_at_their_nearest_limit() -> None:
    whole = ModelBuilder("arm")
    whole.add_body("a", "base", "revolute", (0, 1, 0), inertia=BALL, limits=(0.5, 2.0))
    whole.add_body("b", "a", "prismatic", (1, 0, 0), inertia=BALL, limits=(-2.0, -0.25))
    whole.add_body("c", "b", "spherical", inertia=BALL).add_body("d", "c", "planar", inertia=BALL)
    rest = {"a_joint": 0.5, "b_joint": -0.25, "c_joint": [0, 0, 0, 1], "d_joint": [0, 0, 1, 0]}
    model = whole.build(root="floating", continuous="cos_sin")
    assert model.reduced(rest.keys()) == model.reduced(lock=list(rest)) == model.reduced(rest)
    assert model.reduced("b_joint") == model.reduced({"b_joint": -0.25})
    assert model.reduced(["root_joint"]) == model.reduced({"root_joint": sd.neutral(model)[:7]})
    assert model.reduced(()) == model


def test_a_mimic_locked_by_name_rests_where_its_leader_takes_it() -> None:
    hand = ModelBuilder("hand").add_body("a", "base", inertia=BALL, joint_name="first", limits=(0.5, 2.0))
    hand.add_body(
        "b", "base", inertia=BALL, joint_name="second", mimic=dict(leader="first", multiplier=2.0, offset=0.1)
    )
    model = hand.build(mimic=True)
    assert model.reduced(["first", "second"]) == model.reduced({"first": 0.5, "second": 1.1})


# --- subtree ----------------------------------------------------------------------------------------------


def test_a_subtree_is_a_link_and_what_it_carries_fixed_in_the_world() -> None:
    model = sd.load_urdf("tree", root="floating", gravity=(1, 2, 3))
    part = model.subtree("left_upper_arm")
    assert part.options.root == "fixed"
    assert part.names[1:3] == ("left_elbow", "wrist")
    assert part.robot.root == "left_upper_arm"
    assert {f.name for f in part.frames} < {f.name for f in model.frames}
    np.testing.assert_array_equal(part.frame("left_upper_arm").placement, np.eye(4))
    q = np.zeros(part.nq)
    rest = [j for j in model.joints[1:] if j.name not in part.names]
    still = model.reduced({j.name: sd.neutral(model)[j.idx_q : j.idx_q + j.nq] for j in rest})
    close(sd.crba(part, q), sd.crba(still, q))
    assert model.subtree("base") == sd.load_urdf("tree", gravity=(1, 2, 3))


def test_a_subtree_of_one_link_has_no_freedom() -> None:
    part = arm().build().subtree("tool")
    assert (part.nq, part.nv, part.njoints, part.total_mass) == (0, 0, 1, 0.0)
    assert [f.name for f in part.frames] == ["tool"]


# --- with_ ------------------------------------------------------------------------------------------------


def test_with_gravity_is_assembling_with_it() -> None:
    assert arm().build().with_(gravity=(1, 0, 0)) == arm().build(gravity=(1, 0, 0))
    assert arm().build().with_() == arm().build()
    assert "expected three finite numbers" in message(arm().build().with_, gravity=(1, 0))


def test_with_armature_replaces_it() -> None:
    model = arm().build().with_(armature={"shoulder": 0.5, "elbow": 0})
    assert model.armature.tolist() == [0.5, 0.0]
    q = [0.1, 0.2]
    close(sd.crba(model, q) - sd.crba(arm().build(), q), np.diag([0.5, -0.25]))
    for value in (-1.0, np.nan, np.inf):
        assert f"has armature {value}, expected a finite number >= 0" in message(model.with_, armature={"elbow": value})
    assert 'joint "tool_joint" is fixed' in message(model.with_, armature={"tool_joint": 0.1})


def rpy_pose() -> Array:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rpy_matrix(0.4, 0.5, 0.6), (0.1, 0.2, 0.3)
    return X


@pytest.mark.parametrize("frame", ["tool", "tool_joint", "joint:tool_joint"])
def test_a_payload_adds_to_the_link_of_its_frame(frame: str) -> None:
    rng = np.random.default_rng(7)
    own, load = random_inertia(rng), random_inertia(rng)

    def with_tool(inertia: tuple[float, Array, Array]) -> Model:
        b = ModelBuilder("arm").add_body("upper", axis=(0, 1, 0), inertia=own, joint_name="shoulder")
        b.add_body("lower", "upper", "spherical", placement=(0, 0, 1), inertia=own)
        model: Model = b.add_body("tool", "lower", "fixed", placement=rpy_pose(), inertia=inertia).build()
        return model

    model = with_tool(own).with_(payload={frame: load})
    expected = with_tool(merged(own, load, np.eye(4)))
    q = random_q(model, rng)
    close(sd.crba(model, q), sd.crba(expected, q))
    close(sd.generalized_gravity(model, q), sd.generalized_gravity(expected, q))
    close(model.total_mass, 2 * own[0] + own[0] + load[0])
    twice = model.with_(payload={"tool": load})
    close(sd.total_mass(twice) - sd.total_mass(model), load[0])


def test_a_payload_on_a_floating_root_rides_on_the_root_link() -> None:
    model = arm().build(root="floating")
    assert model.with_(payload={"root_joint": BALL}) == model.with_(payload={"base": BALL})
    assert model.with_(payload={"base": BALL}).total_mass == 5.0


def test_inertia_without_mass_is_a_payload_too() -> None:
    b = (
        ModelBuilder()
        .add_body("a", axis=(0, 0, 1))
        .build()
        .with_(payload={"a": (0.0, (0, 0, 0), np.diag([1.0, 1.0, 2.0]))})
    )
    assert sd.crba(b, [0.0]).tolist() == [[2.0]]


def test_a_payload_that_is_no_inertia_is_refused_by_name() -> None:
    for load in ((-1.0, (0, 0, 0), np.eye(3)), (1.0, (0, 0), np.eye(3)), 3.0):
        with pytest.raises(InertiaError, match="tool"):
            arm().build().with_(payload={"tool": load})


# --- the table --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_parents_and_placements_are_those_of_the_tree_where_it_branches(seed: int) -> None:
    made = random_tree(seed, 12, KINDS, branching=0.6, floating=bool(seed % 2))
    model, tree = made.model, made.tree
    assert [joint.parent for joint in model.joints] == tree.parents
    apart = [k for k, joint in enumerate(model.joints) if k and joint.parent != k - 1]
    assert len(apart) > 2
    for joint, body in zip(model.joints[1:], tree.bodies, strict=True):
        close(joint.placement, body.placement)
        row = joint.row - joint.nv + 1
        assert model.bodies["parent"][row] == model.joints[joint.parent].row
        close([model.bodies["X"]["p"][x][row] for x in "xyz"], np.asarray(body.placement)[:3, 3])


@pytest.mark.parametrize("name", ["tiago_dual", "icub_reduced", "hector", "talos_reduced"])
def test_parents_and_placements_are_those_of_pinocchio(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    path = str(find_robot(name))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = sd.load_urdf(path, root="floating", continuous="cos_sin")
    theirs = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    assert list(model.names) == list(theirs.names)
    assert [joint.parent for joint in model.joints] == list(theirs.parents)
    for joint, placed in zip(model.joints[1:], list(theirs.jointPlacements)[1:], strict=True):
        close(joint.placement, placed.homogeneous)


def bound_of(model: Model, q: Array, k: int) -> Array:
    """The table's bound for the rows of joint k at q: a + 2 b t + c t² with t the travel below it."""
    below = [j for j in model.joints[k + 1 :] if j.row <= model.bodies["last_row"][model.joints[k].row]]
    moves = {"prismatic": 1, "planar": 2, "floating": 3}
    t = sum(abs(q[j.idx_q : j.idx_q + moves.get(j.kind, 0)]).sum() for j in below)
    rows = model.bodies["inertia_bound"][model.joints[k].row - model.joints[k].nv + 1 : model.joints[k].row + 1]
    return np.asarray(rows["x"] + t * (2.0 * rows["y"] + t * rows["z"]))


@pytest.mark.parametrize("continuous", ["angle", "cos_sin"])
@pytest.mark.parametrize("seed", range(8))
def test_no_composite_inertia_is_beyond_its_bound(seed: int, continuous: str) -> None:
    made = random_tree(seed, 8, KINDS, floating=bool(seed % 2), continuous=continuous, armature=False)
    model, rng = made.model, np.random.default_rng(seed)
    for size in (0.0, 1.0, 30.0):
        q = random_state(made.tree, rng).q
        for joint in model.joints:
            moves = {"prismatic": 1, "planar": 2, "floating": 3}.get(joint.kind, 0)
            q[joint.idx_q : joint.idx_q + moves] *= size
        M = np.diag(dense.crba(made.tree, q))
        for k, joint in enumerate(model.joints[1:], start=1):
            there = M[joint.idx_v : joint.idx_v + joint.nv]
            assert (there <= (1.0 + TOLERANCE) * bound_of(model, q, k)).all()


@pytest.mark.parametrize("lead", [0.0, 0.5])
def test_the_bound_is_nearly_reached_by_a_straight_arm(lead: float) -> None:
    """For point masses on a line, all beyond the slide, the bound is at most √2 too large: |diag(0, I, I)| is I √2."""
    b = ModelBuilder("straight")
    for k, (kind, at) in enumerate((("revolute", 0), ("prismatic", 1), ("revolute", 2), ("revolute", 0.5))):
        axis = (0, 0, 1) if kind == "revolute" else (1, 0, 0)
        body = (float(k), (lead, 0, 0), np.zeros((3, 3)))
        b.add_body(f"l{k}", f"l{k - 1}" if k else None, kind, axis, (at, 0, 0), body, f"j{k}")
    model = b.build()
    for slide in (0.0, 0.1, 1.0, 10.0):
        q = np.array([0.0, slide, 0.0, 0.0])
        M = np.diag(sd.crba(model, q))
        for k in range(1, 5):
            (most,) = bound_of(model, q, k)
            assert M[k - 1] * (1.0 - TOLERANCE) <= most <= 1.01 * np.sqrt(2.0) * M[k - 1]
            if not lead or model.joints[k].kind == "prismatic":
                close(most, M[k - 1])


# --- mimic ------------------------------------------------------------------------------------------------


def fingers(*mimics: tuple[str, str | None, float, float], kind: str = "revolute") -> ModelBuilder:
    """Bodies side by side, each (joint, leader or None, multiplier, offset)."""
    b = ModelBuilder("hand")
    for k, (name, leader, ratio, offset) in enumerate(mimics):
        mimic = None if leader is None else {"leader": leader, "multiplier": ratio, "offset": offset}
        b.add_body(f"link {name}", "base", kind, (0, 1, 0), (k, 0, 0), BALL, name, armature=0.1 * (k + 1), mimic=mimic)
    return b


CHAIN = (("c", "b", -3.0, 0.5), ("a", None, 0.0, 0.0), ("b", "a", 2.0, 0.1))


def test_chains_in_any_order_of_declaration_follow_the_first_leader() -> None:
    model = fingers(*CHAIN).build(mimic=True)
    assert (model.nq, model.nv, model.njoints) == (1, 1, 4)
    b, c = model.joint("b").mimic, model.joint("c").mimic
    leader = model.names.index("a")
    assert b == (leader, 2.0, 0.1)
    assert c is not None
    assert c[:2] == (leader, -6.0)
    assert c[2] == pytest.approx(0.5 - 3.0 * 0.1)
    q = np.array([0.4])
    whole = fingers(*CHAIN).build()
    for name, angle in {"a": 0.4, "b": 0.9, "c": 0.5 - 2.7}.items():
        held_at = whole.reduced({n: angle for n in whole.names if n == name})
        close(sd.frame_placement(model, q, f"link {name}"), held_at.frame(f"link {name}").placement)
    assert fingers(*reversed(CHAIN)).build(mimic=True).nv == 1
    assert whole.nv == 3


def test_a_follower_adds_its_inertia_and_armature_by_the_square_of_its_ratio() -> None:
    model, whole = fingers(*CHAIN).build(mimic=True), fingers(*CHAIN).build()
    assert model.armature.tolist() == [0.2]
    one = sd.crba(ModelBuilder().add_body("x", axis=(0, 1, 0), inertia=BALL).build(), [0.0])[0, 0]
    ratios = np.array([1.0, 2.0, -6.0])
    close(sd.crba(model, [0.4])[0, 0], ratios**2 @ (one + np.array([0.2, 0.3, 0.1])))
    np.testing.assert_array_equal(model.mimic_matrix, ratios[:, None])
    q = np.array([0.4]) * model.mimic_ratio + model.mimic_offset
    v, a = np.outer(ratios, [0.7, 0.2]).T
    close(sd.rnea(model, [0.4], [0.7], [0.2]), ratios @ sd.rnea(whole, q, v, a))


def test_each_number_of_a_mimic_is_in_the_key() -> None:
    """A cache keyed by it would give one model the program of another."""
    pairs = [
        fingers(("a", None, 0.0, 0.0), ("b", None, 0.0, 0.0), ("c", leader, ratio, offset)).build(mimic=True)
        for leader, ratio, offset in (("a", 2.0, 0.5), ("b", 2.0, 0.5), ("a", 3.0, 0.5), ("a", 2.0, 0.25))
    ]
    assert len({model.key for model in pairs}) == len(set(pairs)) == 4
    q, v = np.zeros(2), np.ones(2)
    given = [sd.rnea(model, q, v, v).tolist() for model in pairs]
    assert len(set(map(tuple, given))) == 4  # because each of them matters


def test_the_models_own_limits_are_those_of_its_own_coordinates() -> None:
    model, whole = sd.load_urdf("tree", mimic=True), sd.load_urdf("tree")
    own = [k for k, j in enumerate(model.joints) if k and j.mimic is None]
    assert 0 < model.nq < whole.nq
    at = [whole.joints[k].idx_q for k in own]
    for slot in ("lower", "upper", "velocity_limit", "effort_limit", "damping", "friction", "armature"):
        np.testing.assert_array_equal(getattr(model, slot), getattr(whole, slot)[at])
    assert [model.joints[k].idx_q for k in own] == list(range(model.nq))


def test_followers_of_a_fixed_joint_are_fixed_at_their_offset() -> None:
    b = ModelBuilder("hand").add_body("palm", joint="fixed", joint_name="mount")
    b.add_body("f", axis=(0, 1, 0), inertia=BALL, joint_name="first", mimic={"leader": "mount", "offset": 0.3})
    b.add_body("s", joint="prismatic", inertia=BALL, joint_name="second", mimic=dict(leader="first", multiplier=2.0))
    b.add_body("t", "f", inertia=BALL, joint_name="third", mimic={"leader": "free"})
    b.add_body("u", inertia=BALL, joint_name="free")
    model = b.build(mimic=True)
    assert model.names == ("universe", "third", "free")
    assert model.nv == 1
    close(model.frame("f").placement[:3, :3], rpy_matrix(0.0, 0.3, 0.0))
    close(model.frame("s").placement[:3, 3], (0.0, 0.0, 0.6))
    assert pickle.loads(pickle.dumps(model)) == model
    assert b.build().nv == 4


def test_leaders_that_are_missing_or_go_in_a_circle_are_refused_only_when_they_count() -> None:
    lost, circle = (
        fingers(("a", "x", 1.0, 0.0)),
        fingers(("a", "b", 1.0, 0.0), ("b", "c", 1.0, 0.0), ("c", "b", 1.0, 0.0)),
    )
    assert lost.build().nv == 1
    assert circle.build().nv == 3
    assert message(lost.build, mimic=True) == 'joint "a" mimics "x", which robot "hand" does not have'
    assert message(circle.build, mimic=True) == "joints a -> b -> c -> b mimic each other in a circle"


def test_only_joints_of_one_coordinate_mimic() -> None:
    pair = [("a", None, 0.0, 0.0), ("b", "a", 1.0, 0.0)]
    assert fingers(*pair, kind="continuous").build(mimic=True).nv == 1
    expected = 'joint "b" mimics "a", expected both to have one coordinate (continuous="angle")'
    assert message(fingers(*pair, kind="continuous").build, mimic=True, continuous="cos_sin") == expected
    assert message(fingers(*pair, kind="planar").build, mimic=True).endswith(expected)
    b = ModelBuilder().add_body("m", joint="fixed", joint_name="a")
    b.add_body("b", joint="planar", inertia=BALL, joint_name="b", mimic={"leader": "a"})
    assert message(b.build, mimic=True).endswith(expected)


def test_a_leader_is_locked_with_its_followers() -> None:
    model = fingers(*CHAIN).build(mimic=True)
    assert 'joint "b" mimics "a", which is to be locked; lock both' in message(model.reduced, {"a": 0.2})
    assert model.reduced({"a": 0.2, "b": 0.5, "c": -1.0}).nv == 0
    part = model.reduced({"c": 0.25})  # a follower may be taken off its leader
    assert (part.nv, part.names[1:]) == (1, ("a", "b"))
    close(part.frame("link c").placement[:3, :3], rpy_matrix(0.0, 0.25, 0.0))
    whole = fingers(*CHAIN).build().reduced({"c": 0.25})
    close(sd.crba(part, [0.4])[0, 0], [1.0, 2.0] @ sd.crba(whole, [0.4, 0.9]) @ [1.0, 2.0])


def test_a_subtree_without_the_leader_is_refused_by_name() -> None:
    b = fingers(("a", None, 0.0, 0.0)).add_body("t", "base", "fixed").add_body("s", "t", mimic={"leader": "a"})
    assert message(b.build(mimic=True).subtree, "t") == 'joint "s_joint" mimics "a", which robot "hand" does not have'
    assert b.build().subtree("t").nv == 1


def test_each_number_of_a_joint_is_in_its_own_array() -> None:
    """Of two joints, all numbers distinct."""
    builder = sd.ModelBuilder()
    numbers = primes(2, 7)
    for k, (lower, upper, velocity, effort, *rest) in enumerate(numbers.tolist()):
        named = dict(zip(("damping", "friction", "armature"), rest, strict=True))
        limits = sd.JointLimits(-lower, upper, velocity, effort)
        builder.add_body(f"b{k}", inertia=BALL, limits=limits, **named)
    model = builder.build()
    arrays = -model.lower, model.upper, model.velocity_limit, model.effort_limit, model.damping, model.friction
    np.testing.assert_array_equal(np.stack([*arrays, model.armature], 1), numbers)


def test_bounds_are_one_record_and_their_old_keywords_show_it() -> None:
    """The line that the error shows makes the joint."""
    builder: Any = sd.ModelBuilder()
    given = message(builder.add_body, "b", inertia=BALL, limits=(-1.0, 2), velocity=3.0, effort=4.0)
    line = "limits=sd.JointLimits(-1.0, 2, velocity=3.0, effort=4.0)"
    assert given == f"velocity=3.0, effort=4.0 is given, expected {line}"
    made = eval(f"builder.add_body('b', inertia=BALL, {line})").build()
    assert [made.lower[0], made.upper[0], made.velocity_limit[0], made.effort_limit[0]] == [-1.0, 2.0, 3.0, 4.0]
    assert message(builder.add_body, "c", effort=[4.0]).endswith("expected limits=sd.JointLimits(effort=[4.0])")
    for wrong, why in ((sd.JointLimits(effort="x"), "effort 'x', expected"), (2.0, "limits 2.0, expected 2 numbers")):
        assert why in message(builder.add_body, "c", limits=wrong)


# --- mimic joints by hand -----------------------------------------------------------------------------------


def follower(**options: Any) -> sd.Model:
    """A joint that leads, one that follows at -3 q + 0.7, and one that follows that at 5 q - 0.2."""
    box = (1.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.2, 1.4]))
    builder = sd.ModelBuilder("follower").set_inertia("base", box).add_body("a", inertia=box, joint_name="lead")
    builder.add_body("b", "a", axis=(0, 1, 0), inertia=box, mimic={"leader": "lead", "multiplier": -3.0, "offset": 0.7})
    chained = {"leader": "b_joint", "multiplier": 5.0, "offset": -0.2}
    return builder.add_body("c", "b", axis=(1, 0, 0), placement=(0.1, 0, 0.4), inertia=box, mimic=chained).build(
        **options
    )


def test_followers_stand_at_multiples_of_their_leader_and_an_offset() -> None:
    whole, model = follower(), follower(mimic=True)
    q, v = np.array([0.3]), np.array([1.1])
    full, rates = np.array([0.3, -3 * 0.3 + 0.7, 5 * (-3 * 0.3 + 0.7) - 0.2]), np.array([1.1, -3 * 1.1, -15 * 1.1])
    np.testing.assert_allclose(sd.frame_placement(model, q, "c"), sd.frame_placement(whole, full, "c"), atol=1e-14)
    np.testing.assert_allclose(
        sd.frame_velocity(model, q, v, "c"), sd.frame_velocity(whole, full, rates, "c"), atol=1e-13
    )
    tau = sd.nonlinear_effects(whole, full, rates) @ [1.0, -3.0, -15.0]
    np.testing.assert_allclose(sd.nonlinear_effects(model, q, v), [tau], rtol=1e-13)


def test_a_bad_sample_of_a_batch_with_mimic_joints_is_named_whatever_the_slice(monkeypatch: pytest.MonkeyPatch) -> None:
    no_programs(monkeypatch)
    model, rng = follower(mimic=True, root="floating"), np.random.default_rng(0)
    q = sd.random_configuration(model, rng, 20)
    q[17, 3:7] *= 1.1
    monkeypatch.setattr(threads, "slices", lambda n, *_: ((k, min(k + 7, n)) for k in range(0, n, 7)))
    with pytest.raises(sd.ConfigurationError, match=r'norm 1\.1 for joint "root_joint" in sample 17,'):
        sd.crba(model, q)
