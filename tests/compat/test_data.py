"""Fields of Data: held arrays, the latest call, edits of the model, errors; and where Pinocchio is wrong."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn.engines.programs.run import single_call
from spatialdyn.errors import ShapeError

from .test_matrix import zoo

theirs = pytest.importorskip("pinocchio")

ORACLE = 1e-11  # scaled, the bound of all of compat
STEP = 1e-6  # of central differences, off by its square and by eps over it
BY_DIFFERENCES = 1e-7


def biped(pin: Any) -> Any:
    """A floating body with an arm of a turning and a sliding joint, and a wheel without limits."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    parent = root
    for k, (joint, on) in enumerate(
        ((pin.JointModelRY(), root), (pin.JointModelPX(), None), (pin.JointModelRUBZ(), root))
    ):
        placement = pin.SE3(np.eye(3), np.array([0.1, 0.2 * k, -0.3]))
        parent = model.addJoint(parent if on is None else on, joint, placement, f"j{k}")
    for k in range(1, model.njoints):
        inertia = pin.Inertia(1.0 + k, np.array([0.1, 0.02 * k, 0.3]), np.diag([0.1, 0.2, 0.25]))
        model.appendBodyToJoint(k, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"tool{k}", k, 0, placement, pin.FrameType.OP_FRAME))
    return model


def state(model: Any) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    q = np.array(theirs.integrate(biped(theirs), theirs.neutral(biped(theirs)), rng.normal(size=model.nv)))
    return [q, *rng.normal(size=(3, model.nv))]


@pytest.fixture(params=[ours, theirs], ids=["compat", "wheel"])
def case(request: pytest.FixtureRequest) -> Any:
    """Every claim holds for Pinocchio as well."""
    pin = request.param
    model = biped(pin)
    return pin, model, model.createData(), state(model)


def close(x: Any, y: Any, bound: float = ORACLE) -> None:
    assert np.shape(x) == np.shape(y)
    assert np.max(abs(np.subtract(x, y)), initial=0.0) <= bound * np.max(abs(np.asarray(y)), initial=1.0)


@pytest.mark.slow(quick="compat/test_matrix.py::test_every_call_equals_the_wheel")
def test_centroidal_derivatives_leave_the_centre_and_torques_without_weight_and_rotors() -> None:
    left, right = [], []
    for pin, found in ((ours, left), (theirs, right)):
        model = biped(pin)
        model.armature = np.linspace(0.1, 0.9, model.nv)
        data = model.createData()
        pin.computeCentroidalDynamicsDerivatives(model, data, *state(model)[:3])
        found += [np.array(data.com[0]), np.array(data.mass[0]), np.array(data.tau)]
    for x, y in zip(left, right, strict=True):
        close(x, y)


def test_places_in_the_parents_are_composed_to_places_in_the_world(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    pin.rnea(model, data, q, v, a)
    data.liMi[3] = moved = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
    pin.updateGlobalPlacements(model, data)
    close(data.oMi[3].homogeneous, (data.oMi[2] * moved).homogeneous)
    fresh = model.createData()
    pin.updateGlobalPlacements(model, fresh)
    close(fresh.oMi[4].homogeneous, np.eye(4))


def test_a_frames_jacobian_leaves_the_places_its_reference_takes(case: Any) -> None:
    pin, model, _, (q, *_) = case
    k = model.nframes - 1
    joint, placed = model.frames[k].parentJoint, model.createData()
    pin.framesForwardKinematics(model, placed, q)
    lists = {"liMi": joint, "oMi": joint, "oMf": k}
    for reference, count in ((pin.LOCAL, 1), (pin.WORLD, 2), (pin.LOCAL_WORLD_ALIGNED, 3)):
        data = model.createData()
        pin.computeFrameJacobian(model, data, q, k, reference)
        for n, (name, at) in enumerate(lists.items()):
            expected = getattr(placed, name)[at].homogeneous if n < count else np.eye(4)
            close(getattr(data, name)[at].homogeneous, expected)


def test_a_frames_jacobian_places_its_frame_alone_as_it_was_at_the_call(case: Any) -> None:
    pin, model, data, (q, *_) = case
    model, k = model.copy(), model.nframes - 1
    placed = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    before = data.copy()
    pin.framesForwardKinematics(model, placed, q)
    for _ in range(2):  # by checked arguments, by a builtin
        pin.computeFrameJacobian(model, data, q, k, pin.LOCAL_WORLD_ALIGNED)
    model.frames[k].placement.translation[:] += 1.0
    close(data.oMf[k].homogeneous, placed.oMf[k].homogeneous)
    close(data.oMf[k - 1].homogeneous, before.oMf[k - 1].homogeneous)


def test_held_placements_follow_a_frames_jacobian(case: Any) -> None:
    pin, model, data, (q, *_) = case
    k = model.nframes - 1
    held, joints = data.oMf[k], data.oMi
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    pin.computeFrameJacobian(model, data, q, k, pin.LOCAL_WORLD_ALIGNED)
    fresh = model.createData()
    pin.framesForwardKinematics(model, fresh, q)
    close(held.homogeneous, fresh.oMf[k].homogeneous)
    close(joints[4].homogeneous, fresh.oMi[4].homogeneous)
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    pin.framesForwardKinematics(model, fresh, pin.neutral(model))
    close(held.homogeneous, fresh.oMf[k].homogeneous)


def test_a_frames_jacobian_is_at_the_last_q_however_it_was_given(case: Any) -> None:
    """A column is no argument of a builtin, which would keep the poses that the Jacobian follows from."""
    pin, model, data, (q, v, *_) = case
    k, other, joints = model.nframes - 1, pin.integrate(model, q, v), data.oMi
    for reference in (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED):
        wanted = {id(at): pin.computeFrameJacobian(model, model.createData(), at, k, reference) for at in (q, other)}
        for at, given in ((q, q), (other, other), (q, q), (other, other[:, None])):
            J = pin.computeJointJacobians(model, data, given)
            close(J, pin.computeJointJacobians(model, model.createData(), at))
            for _ in range(2):
                close(pin.getFrameJacobian(model, data, k, reference), wanted[id(at)])
            placed = model.createData()
            pin.forwardKinematics(model, placed, at)
            close(joints[4].homogeneous, placed.oMi[4].homogeneous)


@pytest.mark.parametrize("call", ["forwardKinematics", "computeRNEADerivatives", "centerOfMass"])
def test_held_motions_follow_the_calls(case: Any, call: str) -> None:
    """With one, two and three of the fields that one builtin computes."""
    pin, model, _, (q, *moved) = case
    names = ("oMi", "v", "a")
    for held in (names[1:2], names[:2], names):
        data = model.createData()
        for k in range(3):
            given = pin.integrate(model, q, 0.1 * k * moved[0]), moved[k], moved[k - 1]
            getattr(pin, call)(model, data, *given)
            fresh = model.createData()
            getattr(pin, call)(model, fresh, *given)
            for name in held:
                parts = "homogeneous" if name == "oMi" else "vector"
                for x, y in zip(getattr(data, name), getattr(fresh, name), strict=True):
                    close(getattr(x, parts), getattr(y, parts))


@pytest.mark.parametrize("read", [False, True])
def test_a_data_made_before_a_frame_was_added_is_refused(read: bool) -> None:
    model = biped(ours)
    data, (q, *_) = model.createData(), state(model)
    if read:
        ours.framesForwardKinematics(model, data, q)
        assert data.oMf
    count = model.nframes
    at = model.addFrame(ours.Frame("late", 3, 0, ours.SE3.Identity(), ours.FrameType.OP_FRAME))
    for call in (
        lambda: ours.framesForwardKinematics(model, data, q),
        lambda: ours.updateFramePlacements(model, data),
        lambda: ours.updateFramePlacement(model, data, at),
        lambda: ours.computeFrameJacobian(model, data, q, at, ours.LOCAL_WORLD_ALIGNED),
    ):
        with pytest.raises(ShapeError, match=f"data was made for a model of {count} frames, expected {count + 1}"):
            call()
    assert ours.computeFrameJacobian(model, data, q, at).shape == (6, model.nv)


def test_an_array_once_read_follows_the_calls(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    tau, M, X, v1 = data.tau, data.M, data.oMi[2], data.v[2]
    found = pin.rnea(model, data, q, v, a)
    close(tau, found)
    close(v1.vector, data.v[2].vector)
    close(M, np.zeros_like(M))
    close(pin.crba(model, data, q), M)
    pin.forwardKinematics(model, data, q)
    close(X.translation, data.oMi[2].translation)
    assert abs(X.translation).max() > 0.0
    before = X.copy()
    pin.forwardKinematics(model, data, pin.integrate(model, q, v))
    assert abs(X.translation - before.translation).max() > 1e-3


def test_a_result_is_the_callers_own(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    for call, field in (
        (lambda: pin.rnea(model, data, q, v, a), "tau"),
        (lambda: pin.crba(model, data, q), "M"),
        (lambda: pin.computeJointJacobians(model, data, q), "J"),
        (lambda: pin.centerOfMass(model, data, q), "com"),
    ):
        for _ in range(2):
            found = call()
            kept = np.array(found)
            found[:] = 7.0
            close(np.array(data.com[0]) if field == "com" else getattr(data, field), kept)


def test_what_is_written_stays_until_the_next_call(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    pin.forwardKinematics(model, data, q)
    data.oMi[4].translation[0] = 7.0
    pin.updateFramePlacements(model, data)
    expected = data.oMi[4].act(model.frames[model.nframes - 1].placement)
    close(data.oMf[model.nframes - 1].homogeneous, expected.homogeneous)
    data.M[0, 1] = 5.0
    assert data.M[0, 1] == 5.0
    data.tau = np.full(model.nv, 2.0)
    close(data.tau, np.full(model.nv, 2.0))
    tau = data.tau
    found = pin.rnea(model, data, q, v, a)
    close(data.tau, found)
    close(tau, found)


def test_inputs_may_change_before_fields_are_read(case: Any) -> None:
    pin, model, _, (q, v, a, _) = case
    for again in range(3):  # the first call of a kind takes the slow path
        data = model.createData()
        for _ in range(again + 1):
            x, u, w = q.copy(), v.copy(), a.copy()
            pin.rnea(model, data, x, u, w)
            x[:], u[:], w[:] = 0.0, 0.0, 0.0
        expected = biped(theirs).createData()
        theirs.rnea(biped(theirs), expected, q, v, a)
        for k in range(model.njoints):
            close(data.f[k].vector, expected.f[k].vector)
            close(data.a_gf[k].vector, expected.a_gf[k].vector)


def test_getters_look_at_what_was_computed_last(case: Any) -> None:
    pin, model, data, (q, v, a, tau) = case
    pin.forwardKinematics(model, data, q, v, a)
    moving = pin.getFrameVelocity(model, data, 2, pin.WORLD).vector
    pin.rnea(model, data, q, 2.0 * v, a)
    close(pin.getFrameVelocity(model, data, 2, pin.WORLD).vector, 2.0 * moving)
    pin.crba(model, data, q)
    close(pin.getFrameVelocity(model, data, 2, pin.WORLD).vector, 2.0 * moving)
    pin.computeGeneralizedGravity(model, data, q)
    pin.forwardKinematics(model, data, q, 3.0 * v)
    close(pin.getFrameVelocity(model, data, 2, pin.WORLD).vector, 3.0 * moving)
    pin.aba(model, data, q, v, tau)
    close(pin.getFrameVelocity(model, data, 2, pin.WORLD).vector, moving)


def test_old_places_stay_after_calls_that_do_not_place(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    pin.framesForwardKinematics(model, data, q)
    there = data.oMi[3].copy(), data.oMf[3].copy()
    other = pin.integrate(model, q, v)
    pin.rnea(model, data, other, v, a)
    pin.crba(model, data, other)
    close(data.oMi[3].homogeneous, there[0].homogeneous)
    pin.forwardKinematics(model, data, other)
    close(data.oMf[3].homogeneous, there[1].homogeneous)


def test_edits_of_the_model_take_effect_at_the_next_call(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    for _ in range(3):
        before = np.array(pin.rnea(model, data, q, v, a))
    model.armature[:] = 2.0
    close(pin.rnea(model, data, q, v, a), before + 2.0 * a)
    model.armature[:] = 0.0
    model.gravity.linear = np.zeros(3)
    close(pin.rnea(model, data, q, 0.0 * v, 0.0 * a), 0.0 * a)
    model.inertias[2] = pin.Inertia.Zero()
    assert abs(pin.rnea(model, data, q, v, a) - before).max() > 1e-3
    pin.framesForwardKinematics(model, data, q)
    model.frames[2].placement = pin.SE3.Identity()
    pin.updateFramePlacements(model, data)
    close(data.oMf[2].homogeneous, data.oMi[model.frames[2].parentJoint].homogeneous)


def test_columns_and_other_dtypes_are_taken(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    tau = np.array(pin.rnea(model, data, q, v, a))
    close(pin.rnea(model, data, q[:, None], v[:, None], a[:, None]), tau)
    close(pin.rnea(model, data, np.repeat(q, 2)[::2], v, a), tau)
    ones = np.ones(model.nv, int)
    close(pin.rnea(model, data, q, ones, ones), pin.rnea(model, data, q, 1.0 * ones, 1.0 * ones))
    close(pin.rnea(model=model, data=data, q=q, v=v, a=a), tau)


@pytest.mark.parametrize("wrong", [[0.0] * 9, (0.0,) * 9, 1.0, None, np.zeros((9, 2)), np.zeros(9, complex), "v"])
def test_what_is_no_vector_is_a_type_error(case: Any, wrong: Any) -> None:
    pin, model, data, (q, v, _, _) = case
    with pytest.raises(TypeError):
        pin.rnea(model, data, q, v, wrong)


def test_forces_are_a_list_of_as_many_as_joints(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    forces = [pin.Force.Random() for _ in range(model.njoints)]
    as_vector = pin.StdVec_Force()
    as_vector.extend(forces)
    close(pin.rnea(model, data, q, v, a, as_vector), pin.rnea(model, data, q, v, a, forces))
    with pytest.raises(ValueError, match=r"\S"):
        pin.rnea(model, data, q, v, a, forces[:-1])
    for wrong in (tuple(forces), np.zeros((model.njoints, 6)), [1] * model.njoints):
        with pytest.raises(TypeError):
            pin.rnea(model, data, q, v, a, wrong)
    pin.rnea(model, data, q, v, a, forces)
    with_forces = data.f[1].vector.copy()
    pin.rnea(model, data, q, v, a)
    assert abs(data.f[1].vector - with_forces).max() > 1e-3


def test_a_data_can_be_copied_and_pickled(case: Any) -> None:
    pin, model, data, (q, v, a, _) = case
    pin.rnea(model, data, q, v, a)
    pin.framesForwardKinematics(model, data, q)
    for other in (data.copy(), pickle.loads(pickle.dumps(data))):
        close(other.tau, data.tau)
        close(other.oMf[2].homogeneous, data.oMf[2].homogeneous)
        close(other.v[2].vector, data.v[2].vector)
        before = data.tau.copy()
        pin.rnea(model, other, q, v, 2.0 * a)
        close(data.tau, before)


def test_lists_of_a_data_are_lists_of_views(case: Any) -> None:
    pin, model, data, (q, v, *_) = case
    pin.forwardKinematics(model, data, q, v)
    assert len(data.oMi) == model.njoints == len(list(data.oMi))
    close(data.oMi[-1].homogeneous, data.oMi[model.njoints - 1].homogeneous)
    assert len(data.oMi[1:3]) == 2
    with pytest.raises(IndexError):
        data.oMi[model.njoints]
    data.oMi[2] = pin.SE3.Identity()
    close(data.oMi[2].homogeneous, np.eye(4))
    data.v[1].linear = np.ones(3)
    close(data.v[1].linear, np.ones(3))
    pin.centerOfMass(model, data, q)
    data.com[0][:] = 1.0
    close(data.com[0], np.ones(3))
    assert isinstance(data.mass[0], float)


def test_a_new_data_holds_zeros_and_identities(case: Any) -> None:
    _, model, data, _ = case
    for field in ("tau", "M", "J", "nle", "ddq", "Ag"):
        assert not np.any(getattr(data, field))
    close(data.oMi[2].homogeneous, np.eye(4))
    assert list(data.mass) == [-1.0] * model.njoints
    assert data.kinetic_energy == 0.0
    assert len(data.oMf) == model.nframes
    assert not np.any(data.hg.vector)


# --- compat alone ----------------------------------------------------------------------------------------


@pytest.mark.slow(quick="compat/test_matrix.py::test_every_call_equals_the_wheel")
def test_the_derivative_of_the_centroidal_map_is_one() -> None:
    """Pinocchio 4.1's computeCentroidalMapTimeVariation leaves out the motion of the centre of mass."""
    model, peer = biped(ours), biped(theirs)
    q, v, *_ = state(model)
    ahead, behind = (
        ours.computeCentroidalMap(model, model.createData(), ours.integrate(model, q, h * v)) for h in (STEP, -STEP)
    )
    slope = (ahead - behind) / (2.0 * STEP)
    close(ours.computeCentroidalMapTimeVariation(model, model.createData(), q, v), slope, BY_DIFFERENCES)
    close(theirs.dccrba(peer, peer.createData(), q, v), slope, BY_DIFFERENCES)
    assert abs(theirs.computeCentroidalMapTimeVariation(peer, peer.createData(), q, v) - slope).max() > 0.1


def test_the_jacobian_of_a_subtrees_centre_is_its_derivative() -> None:
    """Of each joint's subtree, in the world: the joints above it move it whole, those within it a part, others not."""
    model = biped(ours)
    data = model.createData()
    q, v, *_ = state(model)

    def centre(t: float, k: int) -> np.ndarray:
        ours.centerOfMass(model, data, ours.integrate(model, q, t * v))
        return np.array(data.oMi[k].act(np.array(data.com[k])))

    for k in range(1, model.njoints):
        by = (centre(1e-5, k) - centre(-1e-5, k)) / 2e-5
        close(ours.jacobianSubtreeCenterOfMass(model, data, q, k) @ v, by, 1e-8)


@pytest.mark.slow(quick="compat/test_matrix.py::test_every_call_equals_the_wheel")
def test_rates_are_right_where_a_joints_axes_move_in_its_body() -> None:
    """Composites, universal joints, ZYX angles: Pinocchio's dJ, dAg and C leave out the rate of S there."""
    model, peer = zoo(ours), zoo(theirs)
    rng = np.random.default_rng(2)
    v = rng.normal(size=model.nv)
    q = ours.integrate(model, ours.neutral(model), rng.normal(size=model.nv))
    ahead, behind = (ours.integrate(model, q, h * v) for h in (STEP, -STEP))

    def slope(call: Any) -> np.ndarray:
        found: np.ndarray = (call(model, model.createData(), ahead) - call(model, model.createData(), behind)) / (
            2 * STEP
        )
        return found

    data = model.createData()
    dJ, dM, dAg = (slope(call) for call in (ours.computeJointJacobians, ours.crba, ours.computeCentroidalMap))
    close(ours.computeJointJacobiansTimeVariation(model, data, q, v), dJ, BY_DIFFERENCES)
    close(ours.dccrba(model, data, q, v), dAg, BY_DIFFERENCES)
    C = ours.computeCoriolisMatrix(model, data, q, v)
    close(C + C.T, dM, BY_DIFFERENCES)
    close(C @ v, ours.nle(model, data, q, v) - ours.computeGeneralizedGravity(model, data, q))
    assert abs(theirs.computeJointJacobiansTimeVariation(peer, peer.createData(), q, v) - dJ).max() > 0.1


def test_kinetic_energy_counts_every_rotor() -> None:
    """Pinocchio 4.1 leaves out those of JointModelRevoluteUnaligned."""
    model, peer = (pin.Model() for pin in (ours, theirs))
    for pin, m in ((ours, model), (theirs, peer)):
        m.addJoint(0, pin.JointModelRevoluteUnaligned(np.array([0.0, 0.6, 0.8])), pin.SE3.Identity(), "j")
        m.armature = np.array([2.0])
    q, v = np.zeros(1), np.ones(1)
    assert ours.computeKineticEnergy(model, model.createData(), q, v) == 1.0
    assert theirs.computeKineticEnergy(peer, peer.createData(), q, v) == 0.0


def test_a_joint_of_many_velocities_has_no_compact_tangent_map() -> None:
    """Pinocchio overwrites memory."""
    composite = ours.JointModelComposite(ours.JointModelSpherical())
    composite.addJoint(ours.JointModelFreeFlyer())
    model = ours.Model()
    model.addJoint(0, composite, ours.SE3.Identity(), "many")
    q = ours.neutral(model)
    assert ours.tangentMap(model, q).shape == (11, 9)
    with pytest.raises(ShapeError, match='joint "many" has 9 velocities'):
        ours.compactTangentMap(model, q)
    with pytest.raises(ShapeError, match=r"expected \(9, n\)"):
        ours.tangentMapProduct(model, q, np.zeros((8, 2)))
    with pytest.raises(TypeError, match="expected a matrix"):
        ours.tangentMapTransposeProduct(model, q, [1.0] * 11)


def test_numbers_of_the_other_byte_order_are_read_as_what_they_are() -> None:
    """Pinocchio reads their bytes unswapped."""
    model = biped(ours)
    q, v, a, _ = state(model)
    for _ in range(2):
        found = ours.rnea(model, model.createData(), q.astype(">f8"), v, a)
        close(found, ours.rnea(model, model.createData(), q, v, a))


def test_scratch_is_named_as_such() -> None:
    data = biped(ours).createData()
    with pytest.raises(AttributeError, match="scratch of Pinocchio"):
        data.Yaba
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        data.nothing


def test_a_data_of_another_model_is_refused() -> None:
    model, other = biped(ours), ours.Model()
    other.addJoint(0, ours.JointModelRX(), ours.SE3.Identity(), "only")
    for _ in range(2):
        ours.neutral(other)
        with pytest.raises(ShapeError, match="data was made for a model of"):
            ours.crba(other, model.createData(), np.zeros(1))


@pytest.mark.parametrize("bound", [False, True])
def test_what_follows_a_call_refuses_a_data_of_another_model(bound: bool) -> None:
    """Its kernels would read and write behind arrays of the smaller model."""
    model, small = biped(ours), ours.Model()
    small.addJoint(0, ours.JointModelRX(), ours.SE3.Identity(), "only")
    small.appendBodyToJoint(1, ours.Inertia.Random(), ours.SE3.Identity())
    small.addJointFrame(1)
    calls: list[Any] = [
        lambda model, data: ours.cholesky.decompose(model, data),
        lambda model, data: ours.cholesky.solve(model, data, np.ones(model.nv)),
        lambda model, data: ours.getJacobianSubtreeCenterOfMass(model, data, model.njoints - 1),
        lambda model, data: ours.computeFrameKinematicRegressor(model, data, model.nframes - 1, ours.LOCAL),
        lambda model, data: ours.getFrameVelocityDerivatives(model, data, model.nframes - 1, ours.LOCAL),
    ]
    datas = []
    for made_for in (model, small):
        data, q = made_for.createData(), ours.neutral(made_for)
        ours.computeForwardKinematicsDerivatives(made_for, data, q, *np.zeros((2, made_for.nv)))
        ours.computeJointJacobians(made_for, data, q)
        ours.crba(made_for, data, q)
        ours.cholesky.decompose(made_for, data)
        for call in calls if bound else ():
            call(made_for, data)
        datas.append(data)
    for wrong, data in ((small, datas[0]), (model, datas[1])):
        for call in calls:
            with pytest.raises(ShapeError, match="data was made for a model of"):
                call(wrong, data)


def test_jacobians_have_to_be_computed_first() -> None:
    model = biped(ours)
    with pytest.raises(RuntimeError, match="computeJointJacobians to be called before"):
        ours.getFrameJacobian(model, model.createData(), 1, ours.LOCAL)


@pytest.mark.parametrize("index", [-1, 99])
def test_an_index_that_is_not_there_is_an_error(index: int) -> None:
    model = biped(ours)
    data = model.createData()
    ours.computeJointJacobians(model, data, state(model)[0])
    for call in (ours.getFrameVelocity, ours.getVelocity, ours.updateFramePlacement):
        with pytest.raises(IndexError, match="expected one from 0 to"):
            call(model, data, index)
    with pytest.raises(TypeError, match="expected a ReferenceFrame"):
        ours.getFrameVelocity(model, data, 1, 1)


def test_random_configurations_are_finite_and_can_be_seeded() -> None:
    model = biped(ours)
    ours.seed(3)
    q = ours.randomConfiguration(model)
    ours.seed(3)
    close(ours.randomConfiguration(model), q)
    assert np.isfinite(q).all()
    assert ours.isNormalized(model, q)
    low, high = np.full(model.nq, 0.25), np.full(model.nq, 0.5)
    q = ours.randomConfiguration(model, low, high)
    assert ((q[[0, 1, 2, 7, 8]] >= 0.25) & (q[[0, 1, 2, 7, 8]] <= 0.5)).all()


def test_random_rotations_are_uniform() -> None:
    """E[u uᵀ] = 1 / size, E[u_i⁴] = 3 / (size (size + 2)) of unit vectors: a quaternion and a (cos, sin) pair."""
    model = ours.Model()
    for joint in (ours.JointModelSpherical(), ours.JointModelRUBZ()):
        model.addJoint(model.njoints - 1, joint, ours.SE3.Identity(), joint.shortname())
    ours.seed(0)
    q = np.array([ours.randomConfiguration(model) for _ in range(20_000)])
    for u in (q[:, :4], q[:, 4:]):
        n = u.shape[1]
        assert abs((u * u).sum(1) - 1.0).max() < 1e-14
        assert abs(u.mean(0)).max() < 5.0 / np.sqrt(n * len(u))  # five standard deviations
        assert abs(u.T @ u / len(u) - np.eye(n) / n).max() < 0.015
        assert abs((u**4).mean(0) - 3.0 / (n * (n + 2))).max() < 0.015


def test_what_is_stored_is_read_again(tmp_path: Path) -> None:
    model = biped(ours)
    data = model.createData()
    q, v, a = state(model)[:3]
    ours.computeAllTerms(model, data, q, v)
    ours.rnea(model, data, q, v, a)
    data.tau[0] = 7.0
    data.saveToText(tmp_path / "text")
    data.saveToXML(tmp_path / "xml", "data")
    data.saveToBinary(str(tmp_path / "binary"))
    others = [model.createData() for _ in range(4)]
    others[0].loadFromText(tmp_path / "text")
    others[1].loadFromXML(tmp_path / "xml", "data")
    others[2].loadFromBinary(str(tmp_path / "binary"))
    others[3].loadFromString(data.saveToString())
    for other in others:
        assert other == data
        assert other.model is model
        assert other.tau[0] == 7.0
        assert (ours.rnea(model, other, q, v, 0 * a) == other.tau).all()


def test_data_of_another_model_are_read_with_it() -> None:
    model = biped(ours)
    data = model.createData()
    ours.crba(model, data, state(model)[0])
    other = ours.Data()
    other.loadFromString(data.saveToString())
    assert other == data
    assert other.model == model
    assert (ours.crba(other.model, other, state(model)[0]) == data.M).all()


def test_arrays_that_are_held_are_written_by_reading() -> None:
    model = biped(ours)
    data, fresh = model.createData(), model.createData()
    ours.crba(model, data, state(model)[0])
    held, poses = data.M, fresh.saveToString()
    data.loadFromString(poses)
    assert held is data.M
    assert not held.any()
    assert data == fresh


def test_what_a_call_reads_of_an_earlier_one_is_of_the_latest() -> None:
    """The factors of data.M, which is not read in between."""
    model = biped(ours)
    data = model.createData()
    q, step, *_ = state(model)
    for k in range(3):
        q, fresh = ours.integrate(model, q, k * step), model.createData()
        for x in (data, fresh):
            ours.crba(model, x, q)
        assert (ours.cholesky.decompose(model, data) == ours.cholesky.decompose(model, fresh)).all()


def test_poses_that_a_call_reads_of_an_earlier_one_are_of_the_latest() -> None:
    """Places in the world are composed of those in the parents, which are not read in between."""
    model = biped(ours)
    data = model.createData()
    q, step, *_ = state(model)
    for k in range(3):
        q, fresh = ours.integrate(model, q, k * step), model.createData()
        for x in (data, fresh):
            ours.forwardKinematics(model, x, q)
            ours.updateGlobalPlacements(model, x)
        for one, other in zip(data.oMi, fresh.oMi, strict=True):
            assert one == other


def test_fields_are_at_the_gravity_of_the_call_however_its_inputs_were_given() -> None:
    """A column is no vector that a builtin takes; the field is computed when it is read, after gravity has changed."""
    model = biped(ours)
    data = model.createData()
    q, v, a, _ = state(model)
    ours.rnea(model, data, q, v, a)
    gravity = np.array([1.0, 2.0, -3.0])
    model.gravity.linear = gravity
    ours.rnea(model, data, q[:, None], v, a)
    model.gravity.linear = np.zeros(3)
    fresh_model = biped(ours)
    fresh_model.gravity.linear = gravity
    fresh = fresh_model.createData()
    ours.rnea(fresh_model, fresh, q, v, a)
    for one, other in zip(data.a_gf, fresh.a_gf, strict=True):
        close(one.vector, other.vector)


def test_reading_leaves_nothing_of_what_was_computed_before() -> None:
    model = biped(ours)
    data = model.createData()
    ours.crba(model, data, state(model)[0])
    ours.cholesky.decompose(model, data)
    data.loadFromString(model.createData().saveToString())
    with pytest.raises(ValueError, match=r"data\.M is zero, expected crba to have been called"):
        ours.cholesky.decompose(model, data)


def test_data_that_are_none_are_refused_and_change_nothing(tmp_path: Path) -> None:
    model = biped(ours)
    data = model.createData()
    ours.crba(model, data, state(model)[0])
    M = data.M.copy()
    with pytest.raises(ValueError, match="holds no data written"):
        data.loadFromString(model.saveToString())
    with pytest.raises(ValueError, match="holds no model written"):
        model.loadFromString(data.saveToString())
    with pytest.raises(ValueError, match="cannot be read"):
        data.loadFromText(tmp_path / "none")
    assert (data.M == M).all()


@pytest.mark.parametrize("call", ["rnea", "nonLinearEffects"])
def test_a_call_may_be_given_the_field_that_it_fills(call: str) -> None:
    """The field is held, so it is written at once: the input is recorded before."""
    rng = np.random.default_rng(6)
    model = biped(ours)
    q, v, a = ours.neutral(model), *rng.normal(size=(2, model.nv))
    given = {"rnea": (q, v, a), "nonLinearEffects": (q, a)}[call]
    plain, data = model.createData(), model.createData()
    getattr(ours, call)(model, plain, *given)
    held = {"rnea": data.tau, "nonLinearEffects": data.nle}[call]
    for _ in range(3):
        held[:] = a
        found = getattr(ours, call)(model, data, *given[:-1], held)
        np.testing.assert_array_equal(held, found)
        for one, other in zip(
            data.f if call == "rnea" else data.v, plain.f if call == "rnea" else plain.v, strict=True
        ):
            np.testing.assert_array_equal(one.vector, other.vector)


def test_a_held_field_cannot_be_resized_under_the_calls_that_fill_it() -> None:
    model = biped(ours)
    data = model.createData()
    with pytest.raises(ValueError, match="own"):
        data.M.resize((1,), refcheck=False)


def test_a_call_follows_a_field_of_its_name_that_was_assigned_or_copied() -> None:
    """``nle`` is a field and a kind of call."""
    model = biped(ours)
    q, v = state(model)[:2]
    data = model.createData()
    data.nle = np.ones(model.nv)
    expected = ours.nonLinearEffects(model, data, q, v).copy()
    np.testing.assert_array_equal(data.nle, expected)
    again = data.copy()
    ours.nonLinearEffects(model, again, q, 2.0 * v)
    np.testing.assert_array_equal(ours.nonLinearEffects(model, again, q, v), expected)
    np.testing.assert_array_equal(again.nle, expected)


def test_a_field_assigned_before_it_is_read_stays_until_a_call_fills_it() -> None:
    """Getters compute from the inputs of calls, whatever was assigned since."""
    model = biped(ours)
    data, fresh = model.createData(), model.createData()
    q, v = state(model)[:2]
    C = ours.computeCoriolisMatrix(model, fresh, q, v)
    ours.computeCoriolisMatrix(model, data, q, v)
    data.dJ = np.ones((6, model.nv))
    assert (data.copy().dJ == 1.0).all()
    np.testing.assert_array_equal(ours.getCoriolisMatrix(model, data), C)
    ours.computeCoriolisMatrix(model, data, q, v)
    np.testing.assert_array_equal(data.dJ, fresh.dJ)


def test_jacobians_of_subtrees_fill_the_fields_of_that_of_the_robot() -> None:
    model = ours.buildSampleModelHumanoidRandom()
    data, other, rng = model.createData(), model.createData(), np.random.default_rng(4)
    for k in (1, 2, 2, 3, 4, 5):
        q = ours.integrate(model, ours.neutral(model), rng.standard_normal(model.nv))
        if k == 4:  # an edit between calls
            model.inertias[k].mass *= 1.5
        J = ours.jacobianSubtreeCenterOfMass(model, data, q, k)
        wanted = ours.jacobianCenterOfMass(model, other, q)
        assert (ours.getJacobianSubtreeCenterOfMass(model, other, k) == J).all()
        assert (ours.getJacobianSubtreeCenterOfMass(model, data, k) == J).all()
        assert (
            ours.getJointJacobian(model, data, k, ours.WORLD) == ours.getJointJacobian(model, other, k, ours.WORLD)
        ).all()
        for x, y in ((data.Jcom, wanted), (data.J, other.J), (data.com[0], other.com[0]), (data.oMi[k], other.oMi[k])):
            assert np.array_equal(np.asarray(x), np.asarray(y))
        assert np.isnan(ours.jacobianSubtreeCenterOfMass(model, data, np.full(model.nq, np.nan), k)).any()
        with pytest.raises(ShapeError, match="q has shape"):
            ours.jacobianSubtreeCenterOfMass(model, data, q[1:], k)


@pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")
def test_reading_a_field_keeps_the_builtins_of_frames_and_so_the_bits() -> None:
    model = ours.buildSampleModelHumanoidRandom()
    data, tip = model.createData(), model.nframes - 1
    q = ours.integrate(model, ours.neutral(model), np.random.default_rng(1).standard_normal(model.nv))
    for _ in range(3):
        ours.computeJointJacobians(model, data, q)
        before = ours.getFrameJacobian(model, data, tip, ours.WORLD)
    bound = data._bound["getFrameJacobian"]
    assert data.oMi is not None
    assert data._bound["getFrameJacobian"] is bound
    assert (ours.getFrameJacobian(model, data, tip, ours.WORLD) == before).all()
    ours.crba(model, data, q)  # a new kind of call
    assert data._bound["getFrameJacobian"] is bound
