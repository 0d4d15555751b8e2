"""Contacts and loops under Pinocchio's names: the wheel's numbers, and the equations they solve."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from slow import slow_but

import spatialdyn as sd
import spatialdyn.compat.pinocchio as face
from spatialdyn.urdf.load import find_robot

pin = pytest.importorskip("pinocchio", minversion="4.1")

EPS = np.finfo(float).eps
GAINS = 3.0, 7.0
KINDS = ("CONTACT_3D", "CONTACT_6D")
REFERENCES = ("LOCAL", "LOCAL_WORLD_ALIGNED")
Array = np.ndarray


class Case:
    """A quadruped with a contact, and a loop between two legs if asked: ours and Pinocchio's; a state, Jv not 0."""

    def __init__(self, kind: str, reference: str, loop: bool = False, gains: tuple[float, float] = (0.0, 0.0)) -> None:
        path, self.made = str(find_robot("solo12")), []
        rng = np.random.default_rng(0)
        places = [pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(3)]
        for p in (face, pin):
            model = p.buildModelFromUrdf(path, p.JointModelFreeFlyer())
            made, at = getattr(p.ContactType, kind), getattr(p.ReferenceFrame, reference)
            X = [p.SE3(x.rotation, x.translation) for x in places]
            ids = [model.getJointId(name) for name in ("FL_KFE", "FR_KFE", "HL_KFE")]
            given = [p.RigidConstraintModel(made, model, ids[0], X[0], at)]
            if loop:
                given.append(p.RigidConstraintModel(made, model, ids[1], X[1], ids[2], X[2], at))
            models, datas = p.StdVec_RigidConstraintModel(), p.StdVec_RigidConstraintData()
            for one in given:
                one.setBaumgarteCorrectorParameters(p.BaumgarteCorrectorParameters(*gains))
                models.append(one)
                datas.append(one.createData())
            data = model.createData()
            p.initConstraintDynamics(model, data, models, datas)
            self.made.append((p, model, data, models, datas))
        theirs = self.made[1][1]
        self.q = pin.integrate(theirs, pin.neutral(theirs), 0.4 * rng.normal(size=theirs.nv))
        self.v, self.tau = rng.normal(size=(2, theirs.nv))

    def run(self) -> list[tuple[Any, ...]]:
        """``constraintDynamics`` of both: a, λ, J and the parts of ``made``."""
        found = []
        for p, model, data, models, datas in self.made:
            settings = p.ProximalSettings(1e-14, 1e-12, 10)
            a = p.constraintDynamics(model, data, self.q, self.v, self.tau, models, datas, settings)
            J = p.getConstraintsJacobian(model, data, models, datas)
            found.append((a, np.array(data.lambda_c), J, p, model, data, models, datas, settings))
        return found


def bound(data: Any, J: Array) -> float:
    """What a solution may be off by, relative, for the condition of its matrix."""
    K = np.block([[np.array(data.M), J.T], [J, np.zeros((len(J), len(J)))]])
    return 1e-12 + 100 * EPS * float(np.linalg.cond(K))


def close(x: Any, y: Any, least: float) -> None:
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= least * abs(y).max(initial=0.0)


@pytest.mark.parametrize("gains", [(0.0, 0.0), GAINS])
@pytest.mark.parametrize("loop", [False, True])
@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("kind", KINDS)
def test_constraint_dynamics_is_pinocchios(kind: str, reference: str, loop: bool, gains: tuple[float, float]) -> None:
    case = Case(kind, reference, loop, gains)
    (a, force, J, _, model, data, _, datas, _), theirs = case.run()
    least = bound(data, J)
    for ours, wanted in zip((a, force), theirs[:2], strict=True):
        close(ours, wanted, least)
    close(J, theirs[2], 100 * EPS)
    close(data.ddq, a, 0.0)
    for mine, other in zip(datas, theirs[7], strict=True):
        close(mine.contact_force.vector, other.contact_force.vector, least)
        for name in ("contact_placement_error", "contact_velocity_error", "contact1_velocity", "contact2_velocity"):
            close(getattr(mine, name).vector, getattr(other, name).vector, 1e3 * EPS)
        for name in ("oMc1", "oMc2", "c1Mc2"):
            close(getattr(mine, name).homogeneous, getattr(other, name).homogeneous, 1e2 * EPS)
    residual = face.rnea(model, data, case.q, case.v, a) - case.tau - J.T @ force
    assert abs(residual).max() <= least * abs(J.T @ force).max()


@pytest.mark.parametrize(
    ("kind", "reference", "loop", "gains"),
    [(k, r, loop, g) for k in KINDS for r in REFERENCES for loop in (False, True) for g in ((0.0, 0.0), GAINS)],
)
def test_derivatives_are_pinocchios(kind: str, reference: str, loop: bool, gains: tuple[float, float]) -> None:
    """All but those by q of a frame held in the world's axes with gains, where Pinocchio's own are 10 % off."""
    case = Case(kind, reference, loop, gains)
    ours, theirs = case.run()
    found, wanted = (
        p.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)
        for _, _, _, p, model, data, models, datas, settings in (ours, theirs)
    )
    known = kind == "CONTACT_6D" and reference == "LOCAL_WORLD_ALIGNED" and gains == GAINS
    least = 100 * bound(ours[5], ours[2])
    for name, x, y in zip("qvtqvt", found, wanted, strict=True):
        if not (known and name == "q"):
            close(x, y, least)
    close(ours[5].ddq_dq, found[0], 0.0)
    close(ours[5].dlambda_dv, found[4], 0.0)


@pytest.mark.parametrize("loop", slow_but([True], [False, True]))
def test_derivatives_are_those_of_the_own_dynamics(loop: bool) -> None:
    """Of a frame held in the world's axes with gains, by central differences; the loop is nearly singular."""
    case, h = Case("CONTACT_6D", "LOCAL_WORLD_ALIGNED", loop, GAINS), 1e-3
    _, _, _, p, model, data, models, datas, settings = case.run()[0]
    found = p.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)

    def at(q: Array, v: Array) -> Array:
        a = p.constraintDynamics(model, data, q, v, case.tau, models, datas, settings)
        return np.concatenate([a, np.array(data.lambda_c)])

    for k in (0, 4, 8, 13):
        e = h * np.eye(model.nv)[k]
        q = [at(p.integrate(model, case.q, x), case.v) for x in (e, -e)]
        v = [at(case.q, case.v + x) for x in (e, -e)]
        for got, (ahead, behind) in zip(((0, 3), (1, 4)), (q, v), strict=True):
            x = np.concatenate([found[got[0]][:, k], found[got[1]][:, k]])
            close(x, (ahead - behind) / (2 * h), 1e-3)


def test_a_frame_held_in_the_world_is_not_supported_as_by_pinocchio() -> None:
    case = Case("CONTACT_3D", "LOCAL")
    p, model, data, models, datas = case.made[0]
    models[0].reference_frame = p.ReferenceFrame.WORLD
    with pytest.raises(ValueError, match=r"reference_frame of .* is WORLD, expected LOCAL or"):
        p.initConstraintDynamics(model, data, models, datas)


@pytest.mark.parametrize("kind", KINDS)
def test_impacts_and_delassus_are_pinocchios(kind: str) -> None:
    case, found = Case(kind, "LOCAL"), []
    for p, model, data, models, datas in case.made:
        settings = p.ProximalSettings(1e-12, 1e-12, 10)
        after = p.impulseDynamics(model, data, case.q, case.v, models, datas, 0.3, settings)
        G = [p.computeDelassusMatrix(model, data, case.q, models, datas, mu) for mu in (0.0, 0.5)]
        force = datas[0].contact_force.vector
        found.append((after, np.array(data.impulse_c), np.array(data.dq_after), np.array(force), *G))
    for x, y in zip(*found, strict=True):
        close(x, y, 1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_later_impacts_are_pinocchios_too(kind: str) -> None:
    """The first call binds a builtin, which answers the next: at other states and restitutions, and after an edit."""
    case, found = Case(kind, "LOCAL"), []
    for p, model, data, models, datas in case.made:
        rows = []
        for k in range(4):
            settings, v = p.ProximalSettings(1e-12, 1e-12, 10), (1.0 + k) * case.v
            q = p.integrate(model, case.q, 0.1 * v)
            if k == 3:
                model.inertias[2].mass *= 2.0
            after = p.impulseDynamics(model, data, q, v, models, datas, [0, 0.3, 1.0, 0.5][k], settings)
            force = np.array(datas[0].contact_force.vector)
            rows.append((after, np.array(data.impulse_c), np.array(data.dq_after), force))
            J = p.getConstraintsJacobian(model, data, models, datas)
            assert abs(J @ after + [0, 0.3, 1.0, 0.5][k] * (J @ v)).max() <= 1e-6
        with pytest.raises((ValueError, TypeError)):
            p.impulseDynamics(model, data, case.q, case.v, models, datas, None, settings)
        found.append(rows)
    for mine, wheels in zip(*found, strict=True):
        for x, y in zip(mine, wheels, strict=True):
            close(x, y, 1e-10)
    p, model, data, models, datas = case.made[0]
    with pytest.raises(ValueError, match=r"r_coeff is 1\.5"):
        p.impulseDynamics(model, data, case.q, case.v, models, datas, 1.5)


def test_an_impact_of_a_loop_does_what_its_restitution_says() -> None:
    """Where Pinocchio's leaves J v at something else, and its Delassus matrix leaves out the second joint."""
    case = Case("CONTACT_3D", "LOCAL_WORLD_ALIGNED", True)
    p, model, data, models, datas = case.made[0]
    after = p.impulseDynamics(model, data, case.q, case.v, models, datas, 0.3)
    J = p.getConstraintsJacobian(model, data, models, datas)
    close(J @ after, -0.3 * J @ case.v, 1e-9)
    G = p.computeDelassusMatrix(model, data, case.q, models, datas)
    close(G, J @ np.linalg.solve(p.crba(model, data, case.q), J.T), 1e-12)
    close(p.getConstraintJacobian(model, data, models[1], datas[1]), J[3:], 0.0)


def test_contacts_that_depend_on_each_other_need_a_mu() -> None:
    """Of one contact given twice each force is half; with mu = 0 Pinocchio answers nan, or noise."""
    case = Case("CONTACT_3D", "LOCAL")
    p, model, data, models, datas = case.made[0]
    alone = p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas)
    force = np.array(data.lambda_c)
    models.append(models[0])
    datas.append(models[0].createData())
    with pytest.raises(ValueError, match="rank 3, expected its 6 rows"):
        p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas)
    settings = p.ProximalSettings(1e-12, 1e-4, 20)
    a = p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas, settings)
    close(a, alone, 1e-9)
    close(data.lambda_c, np.tile(0.5 * force, 2), 1e-8)
    assert 0 < settings.iter <= 20
    assert settings.absolute_residual <= 1e-9


def test_lists_of_contacts_do_too_and_their_values_are_copied() -> None:
    case = Case("CONTACT_6D", "LOCAL")
    p, model, data, models, datas = case.made[0]
    wanted = p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas)
    given, own = [models[0].copy()], [models[0].createData()]
    close(p.constraintDynamics(model, data, case.q, case.v, case.tau, given, own), wanted, 0.0)
    close(own[0].contact_force.vector, datas[0].contact_force.vector, 0.0)
    own[0].oMc2.translation = np.ones(3)
    assert not given[0].joint2_placement.translation.any()
    models[0].name = "mine"
    assert p.StdVec_RigidConstraintModel(given)[0].name == ""
    for x in (models, datas):
        assert len(copy.deepcopy(x)) == len(pickle.loads(pickle.dumps(x))) == 1
    none = p.constraintDynamics(model, data, case.q, case.v, case.tau, [], [])
    close(none, p.aba(model, data, case.q, case.v, case.tau), 1e-12)


def test_what_contacts_refuse() -> None:
    case = Case("CONTACT_3D", "LOCAL")
    p, model, data, models, datas = case.made[0]
    with pytest.raises(TypeError, match="expected a list of RigidConstraintModel"):
        p.constraintDynamics(model, data, case.q, case.v, case.tau, models[0], datas)
    with pytest.raises(TypeError, match=r"contacts\[1\] is .*RigidConstraintData.*, expected RigidConstraintModel"):
        p.constraintDynamics(model, data, case.q, case.v, case.tau, [models[0], datas[0]], datas)
    with pytest.raises(TypeError, match=r"fext\[1\] is .*, expected Force"):
        p.rnea(model, data, case.q, case.v, case.v, [p.Force.Zero(), *[1.0] * (model.njoints - 1)])
    with pytest.raises(ValueError, match="1 contacts have 0 data"):
        p.constraintDynamics(model, data, case.q, case.v, case.tau, models, [])
    with pytest.raises(TypeError, match="got 2 numbers, expected 0, 3 or 4"):
        p.ProximalSettings(1.0, 2)
    with pytest.raises(sd.SimulationError, match="expected constraintDynamics to be called before"):
        p.computeConstraintDynamicsDerivatives(model, model.createData(), models, datas)
    with pytest.raises(ValueError, match=r"r_coeff is 1\.5"):
        p.impulseDynamics(model, data, case.q, case.v, models, datas, 1.5)


def test_the_factors_are_pinocchios() -> None:
    case, found = Case("CONTACT_3D", "LOCAL", True), []
    for p, model, data, models, datas in case.made:
        p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas, p.ProximalSettings(1e-12, 1e-12, 5))
        factors = p.ContactCholeskyDecomposition(model, data, models, datas)
        p.crba(model, data, case.q)
        factors.compute(model, data, models, datas, 1e-3)
        assert (factors.size(), factors.constraintDim()) == (model.nv + 6, 6)
        K = factors.matrix()
        close(factors.U @ np.diag(factors.D) @ factors.U.T, K, 1e-11)
        close(factors.Dinv * factors.D, np.ones(len(K)), 1e-14)
        x = np.arange(float(len(K)))
        parts = K, factors.inverse(), factors.solve(np.stack([x, -x], axis=1)), factors.getDamping(), factors.U
        inertias = factors.getInverseOperationalSpaceInertiaMatrix(), factors.getOperationalSpaceInertiaMatrix()
        found.append((*parts, *inertias, factors.getInverseMassMatrix()))
    for x, y in zip(*found, strict=True):
        close(x, y, 1e-9)


def test_factors_hold_settings_of_their_own() -> None:
    p, model, data, models, datas = Case("CONTACT_3D", "LOCAL").made[0]
    factors = p.ConstraintCholeskyDecomposition(model, data, models, datas)
    other = factors.copy()
    other.updateDamping(1.0)
    assert not factors.getDamping().any()
    assert (np.diag(other.matrix())[:3] == -1.0).all()
    assert p.BaumgarteCorrectorParameters(1, 2) == p.BaumgarteCorrectorParameters(1.0, 2.0)
    assert models[0].m_baumgarte_parameters == p.BaumgarteCorrectorParameters(0, 0)


def test_factors_of_a_data_keep_what_was_computed_until_the_next_call() -> None:
    case, found = Case("CONTACT_3D", "LOCAL"), []
    for p, model, data, models, datas in case.made:
        p.computeJointJacobians(model, data, case.q)
        p.crba(model, data, case.q)
        for contact, own in zip(models, datas, strict=True):
            contact.calc(model, data, own)
        data.constraint_chol.compute(model, data, models, datas, 1e-8)
        first = data.constraint_chol.getInverseOperationalSpaceInertiaMatrix()
        p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas, p.ProximalSettings(1e-10, 0.5, 1))
        found.append((first, data.constraint_chol.getInverseOperationalSpaceInertiaMatrix()))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e4 * EPS * abs(other).max())


def test_a_contact_places_its_frames_and_the_factors_are_pinocchios() -> None:
    case = Case("CONTACT_6D", "LOCAL", loop=True)
    sizes, found = [], []
    for p, model, data, models, datas in case.made:
        sizes.append((model.createData().constraint_chol.size(), data.constraint_chol.size()))
        settings = p.ProximalSettings(1e-10, 1e-3, 1)
        for _ in range(2):  # in ours the second call is a builtin
            p.constraintDynamics(model, data, case.q, case.v, case.tau, models, datas, settings)
        factors = data.constraint_chol
        own = models[1].createData()
        models[1].calc(model, data, own)
        J = models[1].jacobian(model, data, own)
        places = [x.homogeneous for x in (own.oMc1, own.oMc2, own.c1Mc2)]
        found.append((factors.matrix(), factors.U, np.ravel(factors.D), J, *places))
    assert sizes[0] == sizes[1]
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e4 * EPS * max(1.0, abs(other).max()))
