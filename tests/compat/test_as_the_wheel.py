"""Small things in which programs can tell the two packages apart, and edits between calls."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.model.library_model import library_model

from .test_again import tree
from .test_data import ORACLE, biped, close, state

theirs = pytest.importorskip("pinocchio")
BOTH = pytest.mark.parametrize("pin", [ours, theirs], ids=["compat", "wheel"])
EPS = np.finfo(float).eps


# --- indices and types -------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("field", ["com", "mass", "oMi", "v"])
def test_entries_that_are_not_there_raise_the_same(pin: Any, field: str) -> None:
    model = biped(pin)
    entries = getattr(model.createData(), field)
    for at, error in ((99, IndexError), (-99, IndexError), ("1", TypeError), (1.0, TypeError), (None, TypeError)):
        with pytest.raises(error):
            entries[at]
    value = pin.SE3.Identity() if field == "oMi" else pin.Motion.Zero() if field == "v" else np.ones(3)
    value = 2.0 if field == "mass" else value
    for at, error in ((99, IndexError), ("1", TypeError)):
        with pytest.raises(error):
            entries[at] = value
    with pytest.raises(TypeError):
        entries[1] = "a"
    entries[1] = value
    assert type(entries[-1]) is type(entries[len(entries) - 1])


@BOTH
def test_a_mass_is_a_float(pin: Any) -> None:
    model = biped(pin)
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    assert type(data.mass[1]) is float
    assert all(type(x) is float for x in data.mass)
    assert isinstance(data.mass[0:2], list) or len(data.mass[0:2]) == 2


@BOTH
def test_a_joint_in_a_model_is_of_no_kind(pin: Any) -> None:
    model = biped(pin)
    joint = model.joints[1]
    assert not isinstance(joint, pin.JointModelFreeFlyer)
    assert isinstance(joint, pin.JointModel)
    assert type(joint).__name__ == "JointModel"
    assert joint.shortname() == "JointModelFreeFlyer"
    own = joint.extract()
    assert isinstance(own, pin.JointModelFreeFlyer)
    assert (own.id, own.idx_v, own.nq) == (1, 0, 7)


@BOTH
def test_classes_have_the_attributes_of_their_objects(pin: Any) -> None:
    for name in ("frames", "joints", "inertias", "nq", "idx_vs", "referenceConfigurations", "jointPlacements", "names"):
        assert hasattr(pin.Model, name), name
    for name in ("M", "oMi", "com", "kinetic_energy", "ddq"):
        assert hasattr(pin.Data, name), name
    assert not hasattr(pin.Model, "frobnicate")
    assert not hasattr(pin.Data, "frobnicate")


def test_a_joint_that_is_assigned_says_what_to_do() -> None:
    model = biped(ours)
    with pytest.raises(sd.ModelError, match=r"joints\[2\] of a Model cannot be assigned.*addJoint on a new Model"):
        model.joints[2] = ours.JointModelRX()
    assert model.joints[2].shortname() == "JointModelRY"


def test_the_order_of_matrices_is_a_listed_difference() -> None:
    model = biped(ours)
    data = model.createData()
    assert data.M.flags.c_contiguous
    assert theirs.crba(biped(theirs), biped(theirs).createData(), state(model)[0]).shape == data.M.shape
    assert any("Fortran" in x.pinocchio for x in ours.differences())


# --- kinematic regressors --------------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", ["LOCAL", "WORLD", "LOCAL_WORLD_ALIGNED"])
def test_kinematic_regressors_are_the_wheels(reference: str) -> None:
    found = []
    for pin in (ours, theirs):
        model = tree(pin)
        data, at, X = model.createData(), getattr(pin, reference), pin.SE3(np.diag([1.0, -1.0, -1.0]), np.ones(3))
        q = ours.integrate(tree(ours), ours.neutral(tree(ours)), np.linspace(-0.5, 0.5, model.nv))
        pin.framesForwardKinematics(model, data, q)
        found.append(
            [pin.computeJointKinematicRegressor(model, data, k, at) for k in range(1, model.njoints)]
            + [pin.computeJointKinematicRegressor(model, data, 5, at, X)]
            + [
                pin.computeFrameKinematicRegressor(model, data, k, at) for k in range(1, model.nframes)
            ]  # Pinocchio refuses frame 0
        )
    for x, y in zip(*found, strict=True):
        close(x, y)


def test_kinematic_regressors_of_the_universe_are_refused_as_by_the_wheel() -> None:
    for pin in (ours, theirs):
        model = tree(pin)
        data = model.createData()
        for call in (pin.computeJointKinematicRegressor, pin.computeFrameKinematicRegressor):
            with pytest.raises(ValueError, match="_id"):
                call(model, data, 0, pin.LOCAL)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_an_inertia_that_is_not_finite_is_refused_as_by_the_wheel(number: float) -> None:
    for pin in (ours, theirs):
        I = pin.Inertia.Identity()
        for A in (np.full((3, 3), number), np.diag([1.0, number, 1.0])):
            with pytest.raises(RuntimeError, match="symmetric"):
                I.inertia = A
            with pytest.raises(RuntimeError, match="symmetric"):
                pin.Inertia(1.0, np.zeros(3), A)


def test_a_kinematic_regressor_is_a_difference_of_placements() -> None:
    model, step = tree(ours), 1e-6
    q = ours.integrate(model, ours.neutral(model), np.linspace(-0.5, 0.5, model.nv))
    data = model.createData()
    ours.forwardKinematics(model, data, q)
    here, K = data.oMi[5].copy(), ours.computeJointKinematicRegressor(model, data, 5, ours.LOCAL)
    for k in range(1, model.njoints):
        given = model.jointPlacements[k].copy()
        for i in range(6):
            model.jointPlacements[k] = given * ours.exp6(ours.Motion(step * np.eye(6)[i]))
            ours.forwardKinematics(model, data, q)
            moved = ours.log6(here.actInv(data.oMi[5])).vector / step
            assert abs(moved - K[:, 6 * (k - 1) + i]).max() <= 1e-5
        model.jointPlacements[k] = given


# --- edits between calls ---------------------------------------------------------------------------------------


def test_fields_read_after_gravity_changed_are_those_of_the_call() -> None:
    """Gravity is written in place to the table; a field that is computed later is of the gravity at the call."""
    found = []
    for pin in (ours, theirs):
        model = biped(pin)
        data, (q, v, a, _) = model.createData(), state(model)
        pin.rnea(model, data, q, v, a)
        pin.rnea(model, data, q, v, a)
        model.gravity.linear = np.array([1.0, 2.0, 3.0])
        first = np.array(data.f[1].vector), np.array(data.a_gf[3].vector), np.array(data.tau)
        tau = pin.rnea(model, data, q, v, a)
        second = (
            np.array(data.f[1].vector),
            np.array(data.a_gf[3].vector),
            pin.computeGeneralizedGravity(model, data, q),
        )
        model.gravity = pin.Motion(np.array([0.0, 0.0, -9.81, 0.0, 0.0, 0.0]))
        pin.computeAllTerms(model, data, q, v)
        model.gravity.linear[2] = 0.0
        third = np.array(data.g), np.array(data.nle), data.potential_energy
        found.append([*first, tau, *second, *third, pin.aba(model, data, q, v, a)])
    for x, y in zip(*found, strict=True):
        close(x, y)


def test_fields_read_after_inertias_changed_are_those_of_the_call() -> None:
    """Inertias are written in place to the table, and earlier ones forgotten but for what the last calls need."""
    found = []
    for pin in (ours, theirs):
        model = biped(pin)
        data, (q, v, a, _) = model.createData(), state(model)
        pin.rnea(model, data, q, v, a)
        for mass in np.linspace(2.0, 3.0, 80):
            model.inertias[3].mass = mass
            pin.crba(model, data, q)
        model.inertias[2] = pin.Inertia(1.5, np.array([0.1, -0.2, 0.3]), np.diag([0.3, 0.4, 0.5]))
        pin.computeCoriolisMatrix(model, data, q, v)
        model.inertias[1].mass = 7.0
        g = pin.computeGeneralizedGravity(model, data, q)
        parts = [np.array(data.h[3].vector), np.array(data.Ycrb[1].matrix()), np.array(data.oYcrb[2].matrix())]
        found.append([*parts, np.array(data.M), np.array(data.C), g, np.array(data.tau), pin.crba(model, data, q)])
    for x, y in zip(*found, strict=True):
        close(x, y)


def test_edited_inertias_give_the_table_of_a_model_made_anew() -> None:
    model = tree(ours)
    data, q = model.createData(), ours.neutral(model)
    for k in (2, 5, 7):
        ours.crba(model, data, q)
        model.inertias[k] = ours.Inertia(0.5 + k, np.array([0.1 * k, -0.2, 0.3]), np.diag([0.3, 0.4, 0.5]))
        ours.crba(model, data, q)
        library = library_model(model)
        mine = np.frombuffer(library.table.bytes, library.model.bodies.dtype)
        for name in ("m", "h", "I"):
            x, y = mine["inertia"][name], library.model.bodies["inertia"][name]
            for part in y.dtype.names or [()]:
                assert abs(x[part] - y[part]).max() <= 16 * EPS * max(1.0, abs(y[part]).max())
        for part in "xyz":
            x, y = mine["inertia_bound"][part], library.model.bodies["inertia_bound"][part]
            assert abs(x - y).max() <= 64 * EPS * max(1.0, abs(y).max())
        assert library_model(model.copy()).model == library.model


def test_several_inertias_edited_between_two_calls_count_from_the_next_call_on() -> None:
    model = tree(ours)
    data, q = model.createData(), ours.neutral(model)
    for k in range(3):
        ours.crba(model, data, q)
        for joint in (2, 5, 7):
            model.inertias[joint].mass = 1.0 + k + joint
        model.inertias[5].lever = np.array([0.1 * k, 0.2, 0.0])
        anew = model.copy()
        close(ours.crba(model, data, q), ours.crba(anew, anew.createData(), q))


def test_an_impossible_inertia_is_refused_at_the_next_call_as_before() -> None:
    model = tree(ours)
    data, q = model.createData(), ours.neutral(model)
    ours.crba(model, data, q)
    before = ours.crba(model, data, q)
    model.inertias[3] = ours.Inertia.over(np.array([-1.0, *np.zeros(9)]))
    with pytest.raises(sd.InertiaError, match="mass -1"):
        ours.crba(model, data, q)
    model.inertias[3] = tree(ours).inertias[3]
    assert (ours.crba(model, data, q) == before).all()


def test_what_calls_keep_between_them_follows_an_edit() -> None:
    """Builtins about a placement, masses of subtrees, factors of M and Jacobians of subtrees, of all joints in turn."""
    found = []
    for pin in (ours, theirs):
        model, parts = tree(pin), []
        data, at, v = (
            model.createData(),
            (pin.LOCAL, pin.LOCAL_WORLD_ALIGNED, pin.WORLD),
            np.linspace(-1.0, 1.0, model.nv),
        )
        q = ours.integrate(tree(ours), ours.neutral(tree(ours)), np.linspace(-0.5, 0.5, model.nv))
        for n in range(3):
            pin.forwardKinematics(model, data, q, v)
            pin.jacobianCenterOfMass(model, data, q)
            for k in range(1, model.njoints):
                X = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.1 * k, n, 0.3]))
                parts += [
                    pin.getFrameVelocity(model, data, k, X, at[n]).vector,
                    pin.getFrameVelocity(model, data, k, X).vector,
                ]
                parts += [
                    pin.getFrameJacobian(model, data, k, X, at[n]),
                    pin.getJacobianSubtreeCenterOfMass(model, data, k),
                ]
            pin.computeSubtreeMasses(model, data)
            pin.crba(model, data, q)
            U = np.array(pin.cholesky.decompose(model, data))
            parts += [
                [pin.computeTotalMass(model)],
                list(data.mass),
                U,
                np.array(data.D),
                pin.cholesky.solve(model, data, v),
            ]
            parts += [pin.cholesky.computeMinv(model, data)]
            model.inertias[3].mass = 5.0 + n
            before = pin.computeTotalMass(model)
            pin.crba(model, data, q)  # which takes the edit over
            parts += [[before, pin.computeTotalMass(model)]]
            model.jointPlacements[2] = pin.SE3(np.eye(3), np.array([0.0, 0.1 * n, 0.2]))
            model.armature = np.linspace(0.0, n, model.nv)
        with pytest.raises((ValueError, IndexError, TypeError)):
            pin.getFrameVelocity(model, data, "1", X)
        found.append(parts)
    for x, y in zip(*found, strict=True):
        close(x, y)


@pytest.mark.parametrize("index", [-1, 99])
def test_a_placement_on_no_joint_is_refused_after_one_on_a_joint(index: int) -> None:
    model = tree(ours)
    data, X = model.createData(), ours.SE3.Identity()
    ours.forwardKinematics(model, data, ours.neutral(model), np.ones(model.nv))
    ours.getFrameVelocity(model, data, 1, X)
    with pytest.raises(IndexError, match="joint index"):
        ours.getFrameVelocity(model, data, index, X)


# --- contacts --------------------------------------------------------------------------------------------------


@pytest.mark.slow(quick="compat/test_rigid_constraints.py::test_constraint_dynamics_is_pinocchios")
@pytest.mark.parametrize("kind", ["CONTACT_3D", "CONTACT_6D"])
def test_contacts_that_are_edited_take_effect_at_the_next_call(kind: str) -> None:
    """The third call is by the builtin that reads the contacts' own numbers, the first by Python."""
    found: list[list[Any]] = [[], []]
    for pin, out in zip((ours, theirs), found, strict=True):
        model = tree(pin)
        data, v, tau = model.createData(), 0.1 * np.ones(model.nv), np.linspace(0.1, 1.0, model.nv)
        q = ours.integrate(tree(ours), ours.neutral(tree(ours)), np.linspace(-0.4, 0.4, model.nv))
        contact = pin.RigidConstraintModel(
            getattr(pin.ContactType, kind), model, 5, pin.SE3.Identity(), pin.LOCAL_WORLD_ALIGNED
        )
        contacts, datas = [contact], [contact.createData()]
        settings = pin.ProximalSettings(1e-14, 1e-8, 10)
        pin.initConstraintDynamics(model, data, contacts, datas)
        for step in range(5):
            if step == 2:
                contact.m_baumgarte_parameters.Kp, contact.m_baumgarte_parameters.Kd = 20.0, 5.0
            if step == 3:
                contact.joint1_placement = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.1, 0.2, -0.1]))
            if step == 4:
                model.gravity.linear = np.array([0.0, 1.0, -3.0])
            a = pin.constraintDynamics(model, data, q, v, tau, contacts, datas, settings)
            out += [np.array(a), np.array(data.ddq), np.array(data.lambda_c), datas[0].contact_force.vector.copy()]
            out += [np.array(data.nle), datas[0].contact_placement_error.vector.copy()]
            out += [datas[0].oMc1.homogeneous.copy(), datas[0].contact1_velocity.vector.copy()]
    for x, y in zip(*found, strict=True):
        close(x, y, 1e-9)  # K has a condition of some 1e5


@pytest.mark.parametrize("way", ["forwardDynamics", "constraintDynamics"])
def test_fields_after_calls_under_constraints_are_of_the_latest(way: str) -> None:
    model, rng = tree(ours), np.random.default_rng(0)
    contact = ours.RigidConstraintModel(ours.ContactType.CONTACT_3D, model, 3, ours.SE3.Identity(), ours.LOCAL)
    data, datas, tau = model.createData(), [contact.createData()], np.ones(model.nv)
    J, gamma = rng.normal(size=(3, model.nv)), np.zeros(3)
    for _ in range(4):  # the first ones bind builtins
        q = ours.integrate(model, ours.neutral(model), 0.3 * rng.normal(size=model.nv))
        v = rng.normal(size=model.nv)
        if way == "forwardDynamics":
            ours.forwardDynamics(model, data, q, v, tau, J, gamma, 1e-6)
        else:
            ours.constraintDynamics(model, data, q, v, tau, [contact], datas, ours.ProximalSettings(1e-12, 1e-6, 5))
        other = model.createData()
        assert data.kinetic_energy == pytest.approx(ours.computeKineticEnergy(model, other, q, v), rel=1e-12)
        close(data.com[0], ours.centerOfMass(model, other, q), 1e-12)


@pytest.mark.slow(quick="compat/test_rigid_constraints.py::test_constraint_dynamics_is_pinocchios")
def test_the_builtin_of_contacts_gives_what_python_gives() -> None:
    model = tree(ours)
    q = ours.integrate(model, ours.neutral(model), np.linspace(-0.4, 0.4, model.nv))
    v, tau = 0.1 * np.ones(model.nv), np.linspace(0.1, 1.0, model.nv)
    made = [
        ours.RigidConstraintModel(kind, model, joint, ours.SE3.Identity(), at)
        for kind, joint, at in (
            (ours.ContactType.CONTACT_3D, 3, ours.LOCAL),
            (ours.ContactType.CONTACT_6D, 5, ours.LOCAL_WORLD_ALIGNED),
        )
    ]
    for one in made:
        one.setBaumgarteCorrectorParameters(ours.BaumgarteCorrectorParameters(3.0, 2.0))
    datas, data, found = [x.createData() for x in made], model.createData(), []
    for mu in (0.0, 1e-6):
        for _ in range(3):
            settings = ours.ProximalSettings(1e-12, mu, 5)
            a = ours.constraintDynamics(model, data, q, v, tau, made, datas, settings)
            found.append([a, data.lambda_c.copy(), np.array([settings.iter, settings.mu])])
        for other in found[-2:]:
            for x, y in zip(found[-3], other, strict=True):
                close(x, y, ORACLE)
    with pytest.raises(sd.ShapeError):
        ours.constraintDynamics(model, data, q[:-1], v, tau, made, datas)
    made[0].reference_frame = ours.WORLD
    with pytest.raises(sd.ConstraintError, match="is WORLD"):
        ours.constraintDynamics(model, data, q, v, tau, made, datas)
