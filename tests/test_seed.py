"""The numbers of the chapter that defines the subject: its closed forms, exercises and checks with Pinocchio."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from wheel import pin

import spatialdyn as sd
from spatialdyn.urdf.load import find_robot

G = 9.81


def closed_form(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Section 8.1 with both lengths and masses 1: M, C q̇ and g."""
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    h = -s2
    M = np.array([[3.0 + 2.0 * c2, 1.0 + c2], [1.0 + c2, 1.0]])
    C = np.array([[h * v[1], h * (v[0] + v[1])], [-h * v[0], 0.0]])
    g = G * np.array([2.0 * np.cos(q[0]) + np.cos(q[0] + q[1]), np.cos(q[0] + q[1])])
    return M, C @ v, g


def test_two_link_arm_equals_its_closed_form() -> None:
    model, rng = sd.load_urdf("two_link"), np.random.default_rng(0)
    for _ in range(50):
        q, v, a = rng.uniform(-np.pi, np.pi, 2), rng.normal(size=2), rng.normal(size=2)
        M, Cv, g = closed_form(q, v)
        scale = 1e-14 * max(1.0, abs(M).max(), abs(g).max())
        assert abs(sd.crba(model, q) - M).max() <= scale
        assert abs(sd.generalized_gravity(model, q) - g).max() <= scale
        assert abs(sd.nonlinear_effects(model, q, v) - Cv - g).max() <= scale
        assert abs(sd.rnea(model, q, v, a) - M @ a - Cv - g).max() <= 2 * scale
        V = G * (2.0 * np.sin(q[0]) + np.sin(q[0] + q[1]))
        assert sd.potential_energy(model, q) == pytest.approx(V, abs=1e-13)


def test_exercise_1_by_number() -> None:
    """q = (30°, 45°), q̇ = (1, -0.5), q̈ = (0.1, -0.2): worked out by hand from the closed form."""
    model = sd.load_urdf("two_link")
    q, v, a = np.radians([30.0, 45.0]), np.array([1.0, -0.5]), np.array([0.1, -0.2])
    root2 = np.sqrt(2.0)
    M = np.array([[3.0 + root2, 1.0 + root2 / 2], [1.0 + root2 / 2, 1.0]])
    cos75 = (np.sqrt(6.0) - root2) / 4
    Cv = np.array([3.0 * root2 / 8, root2 / 2])
    g = G * np.array([np.sqrt(3.0) + cos75, cos75])
    tau = np.array([0.1 + 3.0 * root2 / 8, -0.1 + 0.05 * root2 + root2 / 2]) + g
    np.testing.assert_allclose(sd.crba(model, q), M, rtol=0, atol=1e-14)
    eigenvalues = [1.0 - root2 / 2, 3.0 + 1.5 * root2]
    np.testing.assert_allclose(np.linalg.eigvalsh(sd.crba(model, q)), eigenvalues, rtol=0, atol=1e-14)
    np.testing.assert_allclose(sd.nonlinear_effects(model, q, v) - g, Cv, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sd.generalized_gravity(model, q), g, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sd.rnea(model, q, v, a), tau, rtol=0, atol=1e-13)


def panda() -> tuple[sd.Model, pin.Model]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sd.load_urdf("panda"), pin.buildModelFromUrdf(str(find_robot("panda")))


def test_section_7_3_on_the_panda() -> None:
    """RNEA = M a + nle; C v = nle - g = RNEA without gravity; Ṁ - 2C skew, with Pinocchio's C and our M."""
    ours, theirs = panda()
    data, rng = theirs.createData(), np.random.default_rng(42)
    q = sd.random_configuration(ours, rng)
    v, a = 0.5 * rng.normal(size=ours.nv), 0.1 * rng.normal(size=ours.nv)
    tau = sd.rnea(ours, q, v, a)
    M, nle = sd.crba(ours, q), sd.nonlinear_effects(ours, q, v)
    assert abs(tau - M @ a - nle).max() < 1e-12
    assert abs(tau - pin.rnea(theirs, data, q, v, a)).max() < 1e-12
    g = sd.generalized_gravity(ours, q)
    weightless = ours.with_(gravity=(0, 0, 0))
    assert abs(sd.rnea(weightless, q, v, 0 * a) - (nle - g)).max() < 1e-12

    C = pin.computeCoriolisMatrix(theirs, data, q, v)
    assert abs(C @ v - (nle - g)).max() < 1e-12
    h = 1e-4
    Ms = [sd.crba(ours, sd.integrate(ours, q, x * h * v)) for x in (-2, -1, 1, 2)]
    N = (8 * (Ms[2] - Ms[1]) - (Ms[3] - Ms[0])) / (12 * h) - 2 * C
    assert abs(N + N.T).max() < 1e-10
    for x in rng.normal(size=(10, ours.nv)):
        assert abs(x @ N @ x) < 1e-9


def test_section_16_4_as_written() -> None:
    """The 3R arm that section 16.4 builds with Pinocchio's calls, and its check; then the same arm by ours."""
    theirs = pin.Model()
    I1, I2 = np.diag([0.01, 0.01, 0.083]), np.diag([0.01, 0.083, 0.083])
    j1 = theirs.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "joint1")
    theirs.appendBodyToJoint(j1, pin.Inertia(1.0, np.array([0, 0, 0.5]), I1), pin.SE3.Identity())
    j2 = theirs.addJoint(j1, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0, 0, 1.0])), "joint2")
    theirs.appendBodyToJoint(j2, pin.Inertia(1.0, np.array([0.5, 0, 0]), I2), pin.SE3.Identity())
    j3 = theirs.addJoint(j2, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([1.0, 0, 0])), "joint3")
    theirs.appendBodyToJoint(j3, pin.Inertia(1.0, np.array([0.5, 0, 0]), I2), pin.SE3.Identity())
    builder = sd.ModelBuilder("arm")
    builder.add_body("link1", axis=(0, 0, 1), inertia=(1.0, (0, 0, 0.5), I1), joint_name="joint1")
    builder.add_body("link2", "link1", "revolute", (0, 1, 0), (0, 0, 1), (1.0, (0.5, 0, 0), I2), "joint2")
    builder.add_body("link3", "link2", "revolute", (0, 1, 0), (1, 0, 0), (1.0, (0.5, 0, 0), I2), "joint3")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its first inertia breaks the triangle inequality: no body is such
        ours = builder.build()
        from_theirs = sd.from_pinocchio(theirs)
    q, v, a = np.array([0.5, 0.3, -0.2]), np.array([1.0, -0.5, 0.3]), np.array([0.1, -0.2, 0.15])
    data = theirs.createData()
    tau = pin.rnea(theirs, data, q, v, a)
    for model in (ours, from_theirs):
        assert abs(sd.rnea(model, q, v, a) - tau).max() < 1e-14 * max(1.0, abs(tau).max())
        check = sd.crba(model, q) @ a + sd.nonlinear_effects(model, q, v)
        assert abs(check - tau).max() < 1e-13


def test_the_arm_of_section_16_4_is_no_physical_body() -> None:
    builder = sd.ModelBuilder("arm")
    builder.add_body("link1", inertia=(1.0, (0, 0, 0.5), np.diag([0.01, 0.01, 0.083])))
    with pytest.raises(sd.InertiaError, match="link1"):
        builder.build(inertia="strict")


def test_last_exercise_3_columns_of_m_are_kinetic_energies() -> None:
    """T(q, e_i) = ½ e_iᵀ M e_i, M positive definite, and Ṁ - 2C skew with Pinocchio's C, on our 3R arm."""
    ours = sd.load_urdf("three_link")
    theirs = pin.buildModelFromUrdf(str(find_robot("three_link")))
    data, rng = theirs.createData(), np.random.default_rng(3)
    q, v = rng.uniform(-np.pi, np.pi, 3), rng.normal(size=3)
    pairs = np.column_stack([np.cos(q), np.sin(q)]).ravel()  # its joints are continuous
    M = sd.crba(ours, q)
    assert abs(M - pin.crba(theirs, data, pairs)).max() < 1e-14
    for i, e in enumerate(np.eye(3)):
        T = sd.kinetic_energy(ours, q, e)
        assert T == pytest.approx(0.5 * M[i, i], abs=1e-15)
        assert T == pytest.approx(pin.computeKineticEnergy(theirs, data, pairs, e), abs=1e-15)
    assert np.linalg.eigvalsh(M).min() > 0
    C, h = pin.computeCoriolisMatrix(theirs, data, pairs, v), 1e-4
    Ms = [sd.crba(ours, sd.integrate(ours, q, x * h * v)) for x in (-2, -1, 1, 2)]
    N = (8 * (Ms[2] - Ms[1]) - (Ms[3] - Ms[0])) / (12 * h) - 2 * C
    assert abs(N + N.T).max() < 1e-10


def test_mass_matrix_is_not_always_positive_definite() -> None:
    """The chapter says it is; two masses on one axis, the first of none, say otherwise."""
    builder = sd.ModelBuilder("coaxial")
    builder.add_body("ghost")
    builder.add_body("mass", "ghost", inertia=(1.0, (0.3, 0, 0), np.diag([0.01, 0.01, 0.01])))
    model = builder.build()
    M = sd.crba(model, [0.1, 0.2])
    assert np.linalg.eigvalsh(M).min() == pytest.approx(0.0, abs=1e-16)
    with pytest.raises(sd.InertiaError, match="ghost_joint"):
        sd.aba(model, [0.1, 0.2], [0.0, 0.0], [1.0, 0.0])


def test_potential_energy_rises_with_height() -> None:
    """V = -Σ m gᵀ p: the chapter's + has the sign of gravity's vector turned round."""
    model = sd.load_urdf("floating_body", root="floating")
    low, high = sd.neutral(model), sd.neutral(model)
    high[2] = 1.0
    rise = sd.potential_energy(model, high) - sd.potential_energy(model, low)
    assert rise == pytest.approx(G * sd.total_mass(model), rel=1e-14, abs=0.0)


def test_pinocchio_crba_fills_both_triangles_from_python() -> None:
    """The chapter completes the upper triangle by hand; the wheel has done it already."""
    _, theirs = panda()
    M = pin.crba(theirs, theirs.createData(), pin.neutral(theirs))
    assert (M == M.T).all()
