"""Constrained dynamics, impacts and the Cholesky factors: Pinocchio's numbers, and the equations they solve."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as face
from spatialdyn.urdf.load import find_robot

pin = pytest.importorskip("pinocchio")

BOUND = 1e-11  # scaled, the bound of all of compat
LOOSE = 1e-9  # of results solved with the contacts' matrix: its condition number is 1e3 to 1e4
FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
MU = 1e-3


class Case:
    """A quadruped on its feet: ours and Pinocchio's, a state, its contacts' Jacobian J (12, nv) and γ (12,)."""

    def __init__(self) -> None:
        path = str(find_robot("solo12"))
        self.model = face.buildModelFromUrdf(path, face.JointModelFreeFlyer())
        self.theirs = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
        rng = np.random.default_rng(0)
        self.q = pin.integrate(self.theirs, pin.neutral(self.theirs), 0.4 * rng.normal(size=self.theirs.nv))
        self.v, self.tau = rng.normal(size=(2, self.theirs.nv))
        data = self.theirs.createData()
        local = pin.LOCAL_WORLD_ALIGNED
        feet = [self.theirs.getFrameId(name) for name in FEET]
        self.J = np.vstack([pin.computeFrameJacobian(self.theirs, data, self.q, k, local)[:3] for k in feet])
        self.gamma = rng.normal(size=12)
        self.data, self.their_data = self.model.createData(), self.theirs.createData()

    @property
    def long(self) -> tuple[Any, ...]:
        return self.q, self.v, self.tau, self.J, self.gamma

    @property
    def short(self) -> tuple[Any, ...]:
        return self.tau, self.J, self.gamma


@pytest.fixture
def case() -> Case:
    return Case()


def close(x: Any, y: Any, bound: float = LOOSE) -> None:
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= bound * max(1.0, abs(y).max(initial=0.0))


# --- constraints ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [(), (MU,)])
def test_forward_dynamics_is_pinocchios(case: Case, damping: tuple[float, ...]) -> None:
    a = face.forwardDynamics(case.model, case.data, *case.long, *damping)
    close(a, pin.forwardDynamics(case.theirs, case.their_data, *case.long, *damping))
    close(case.data.ddq, case.their_data.ddq)
    close(case.data.lambda_c, case.their_data.lambda_c)
    close(case.data.nle, case.their_data.nle, BOUND)
    again = face.forwardDynamics(case.model, case.data, *case.short, *damping)
    np.testing.assert_array_equal(again, a)


def test_forward_dynamics_solves_what_it_says(case: Case) -> None:
    for mu in (0.0, MU):
        a = face.forwardDynamics(case.model, case.data, *case.long, damping=mu)
        force = case.data.lambda_c
        M, b = face.crba(case.model, case.data, case.q), face.nle(case.model, case.data, case.q, case.v)
        close(M @ a + b, case.tau + case.J.T @ force)
        close(case.J @ a + case.gamma, -mu * force)


def test_no_constraint_is_forward_dynamics(case: Case) -> None:
    a = face.forwardDynamics(case.model, case.data, case.q, case.v, case.tau, np.zeros((0, case.model.nv)), np.zeros(0))
    close(a, face.aba(case.model, case.data, case.q, case.v, case.tau))


@pytest.mark.parametrize("numbers", [(), (0.4,), (0.4, MU)])
def test_impacts_are_pinocchios(case: Case, numbers: tuple[float, ...]) -> None:
    after = face.impulseDynamics(case.model, case.data, case.q, case.v, case.J, *numbers)
    close(after, pin.impulseDynamics(case.theirs, case.their_data, case.q, case.v, case.J, *numbers))
    close(case.data.dq_after, case.their_data.dq_after)
    close(case.data.impulse_c, case.their_data.impulse_c)
    again = face.impulseDynamics(case.model, case.data, case.v, case.J, *numbers)
    np.testing.assert_array_equal(again, after)


def test_an_elastic_impact_keeps_the_energy(case: Case) -> None:
    before = face.computeKineticEnergy(case.model, case.data, case.q, case.v)
    after = face.impulseDynamics(case.model, case.data, case.q, case.v, case.J, 1.0)
    assert abs(face.computeKineticEnergy(case.model, case.data, case.q, after) - before) <= LOOSE * before


@pytest.mark.parametrize("mu", [0.0, MU])
def test_kkt_inverse_is_pinocchios_and_an_inverse(case: Case, mu: float) -> None:
    found = face.computeKKTContactDynamicMatrixInverse(case.model, case.data, case.q, case.J, mu)
    close(found, pin.computeKKTContactDynamicMatrixInverse(case.theirs, case.their_data, case.q, case.J, mu))
    M = face.crba(case.model, case.data, case.q)
    K = np.block([[M, case.J.T], [case.J, -mu * np.eye(12)]])
    close(found @ K, np.eye(len(K)), LOOSE)
    np.testing.assert_array_equal(found, found.T)
    face.forwardDynamics(case.model, case.data, *case.long, mu)
    close(face.getKKTContactDynamicMatrixInverse(case.model, case.data, case.J), found)


def test_getting_the_kkt_inverse_of_nothing_is_refused(case: Case) -> None:
    with pytest.raises(ValueError, match="forwardDynamics or impulseDynamics"):
        face.getKKTContactDynamicMatrixInverse(case.model, case.data, case.J)


def test_dependent_constraints_name_the_rank_or_are_damped(case: Case) -> None:
    J, gamma = np.vstack([case.J, 2.0 * case.J[:3]]), np.r_[case.gamma, 2.0 * case.gamma[:3]]
    with pytest.raises(ValueError, match=r"rank 12, expected its 15 rows"):
        face.forwardDynamics(case.model, case.data, case.q, case.v, case.tau, J, gamma)
    with pytest.raises(ValueError, match="rank 12"):
        face.impulseDynamics(case.model, case.data, case.q, case.v, J)
    with pytest.raises(ValueError, match="rank 12"):
        face.forwardDynamics(case.model, case.data, *case.short[:1], np.vstack([case.J, 0.0 * J[:1]]), gamma[:13])
    a = face.forwardDynamics(case.model, case.data, case.q, case.v, case.tau, J, gamma, 1e-9)
    free = face.forwardDynamics(case.model, case.data, *case.long)
    assert abs(a - free).max() <= 1e-4 * abs(free).max()  # the damping's part


def test_rows_in_other_units_have_the_same_rank(case: Case) -> None:
    """The rank is judged by angles between rows: a constraint in millimetres is no worse."""
    a = face.forwardDynamics(case.model, case.data, *case.long)
    scale = 10.0 ** np.arange(-6, 6)
    scaled = case.J * scale[:, None]
    found = face.forwardDynamics(case.model, case.data, case.q, case.v, case.tau, scaled, case.gamma * scale)
    close(found, a)


@pytest.mark.parametrize("k", range(5))
def test_wrong_sizes_raise_value_errors(case: Case, k: int) -> None:
    given = list(case.long)
    given[k] = given[k][..., :-1]
    with pytest.raises(ValueError, match="shape"):
        face.forwardDynamics(case.model, case.data, *given)
    with pytest.raises(ValueError, match="shape"):
        face.impulseDynamics(case.model, case.data, *given[:2], case.J if k < 2 else case.J[:, :-1])
    given[k] = case.long[k].tolist()
    with pytest.raises(TypeError):
        face.forwardDynamics(case.model, case.data, *given)


def test_numbers_no_contact_has_are_refused(case: Case) -> None:
    with pytest.raises(ValueError, match="damping is -1"):
        face.forwardDynamics(case.model, case.data, *case.long, -1.0)
    with pytest.raises(ValueError, match=r"restitution_coefficient is 1\.5"):
        face.impulseDynamics(case.model, case.data, case.q, case.v, case.J, 1.5)
    with pytest.raises(TypeError, match="expected"):
        face.forwardDynamics(case.model, case.data, case.tau, case.J)
    with pytest.raises(TypeError, match="expected"):
        face.impulseDynamics(case.model, case.data, case.v)


def test_arguments_go_by_name_too(case: Case) -> None:
    a = face.forwardDynamics(case.model, case.data, *case.long)
    names = ("q", "v", "tau", "constraint_jacobian", "constraint_drift")
    named = dict(zip(names, case.long, strict=True))
    np.testing.assert_array_equal(face.forwardDynamics(case.model, case.data, **named), a)
    after = face.impulseDynamics(case.model, case.data, case.q, case.v, case.J, 0.5)
    rest = {"v_before": case.v, "constraint_jacobian": case.J, "restitution_coefficient": 0.5}
    np.testing.assert_array_equal(face.impulseDynamics(case.model, case.data, q=case.q, **rest), after)
    np.testing.assert_array_equal(face.impulseDynamics(case.model, case.data, **rest), after)


# --- Cholesky -------------------------------------------------------------------------------------------


def test_cholesky_is_pinocchios(case: Case) -> None:
    for module, model, data in ((face, case.model, case.data), (pin, case.theirs, case.their_data)):
        module.crba(model, data, case.q)
        module.cholesky.decompose(model, data)
    close(case.data.U, case.their_data.U, BOUND)
    close(case.data.D, case.their_data.D, BOUND)
    x = face.cholesky.solve(case.model, case.data, case.tau)
    close(x, pin.cholesky.solve(case.theirs, case.their_data, case.tau), LOOSE)
    Minv = face.cholesky.computeMinv(case.model, case.data)
    close(Minv, pin.cholesky.computeMinv(case.theirs, case.their_data), LOOSE)
    np.testing.assert_array_equal(case.data.Minv, Minv)
    np.testing.assert_array_equal(Minv, Minv.T)


def test_factors_multiply_to_m_and_keep_its_zeros(case: Case) -> None:
    M = face.crba(case.model, case.data, case.q)
    U = face.cholesky.decompose(case.model, case.data)
    close(U @ np.diag(case.data.D) @ U.T, M, BOUND)
    leg = np.r_[-np.ones(6), np.repeat(np.arange(4), 3)]
    apart = (leg[:, None] != leg) & (leg[:, None] >= 0) & (leg >= 0)
    assert not U[apart].any()
    np.testing.assert_array_equal(np.diag(U), 1.0)


def test_an_m_that_is_none_is_refused(case: Case) -> None:
    with pytest.raises(ValueError, match="crba"):
        face.cholesky.decompose(case.model, case.data)
    with pytest.raises(ValueError, match=r"cholesky\.decompose"):
        face.cholesky.solve(case.model, case.data, case.tau)


def test_a_joint_without_inertia_is_named() -> None:
    model = face.Model()
    arm = model.addJoint(0, face.JointModelRX(), face.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, face.Inertia(1.0, np.ones(3), np.eye(3)), face.SE3.Identity())
    model.addJoint(arm, face.JointModelRX(), face.SE3.Identity(), "hinge")
    data = model.createData()
    face.crba(model, data, np.zeros(2))
    with pytest.raises(ValueError, match='"hinge" has zero articulated inertia'):
        face.cholesky.decompose(model, data)
