"""Versions, small matrix helpers, and index lists of joints, under both imports."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn import SpatialDynError

EPS = float(np.finfo(float).eps)
TOLERANCE = 4500 * EPS  # 1e-12, the bound of compat's types


def test_version_is_the_one_whose_names_these_are() -> None:
    pin = pytest.importorskip("pinocchio")
    if not pin.__version__.startswith("4.1"):
        pytest.skip(f"pinocchio is {pin.__version__}")
    assert ours.__version__ == pin.__version__
    assert ours.printVersion("-") == pin.printVersion("-")
    for wanted in ((4, 2, 0), (4, 1, 0), (3, 9, 9), (5, 0, 0)):
        assert ours.checkVersionAtLeast(*wanted) == pin.checkVersionAtLeast(*wanted)
    assert (find_spec("coal") is not None) == ours.WITH_COLLISION
    assert ours.ScalarType is float


def test_helpers_of_linalg_are_the_wheels() -> None:
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(0)
    M = rng.standard_normal((4, 4))
    S = M @ M.T
    assert np.allclose(ours.linalg.inv(M), pin.linalg.inv(M), rtol=TOLERANCE, atol=TOLERANCE)
    mine = ours.linalg.computeLargestEigenvector(S, 200, 1e-14)
    assert np.allclose(S @ mine / np.linalg.norm(mine), mine, rtol=0.0, atol=1e-6)
    assert ours.linalg.retrieveLargestEigenvalue(mine) == pytest.approx(np.linalg.eigvalsh(S)[-1])
    x = np.array([1.0, 2.0, 3.0])
    y = x.copy()
    ours.orthogonalization(np.eye(3)[:, :2], x)
    pin.orthogonalization(np.eye(3)[:, :2], y)
    assert np.array_equal(x, y)


def test_orthonormalization_spans_the_same_columns() -> None:
    rng = np.random.default_rng(1)
    A = rng.standard_normal((4, 3))
    B = A.copy()
    ours.orthonormalization(B)
    assert ours.isOrthonormal(B)
    assert not ours.isOrthonormal(A)
    assert np.allclose(B @ (B.T @ A), A, rtol=0.0, atol=64 * EPS)
    with pytest.raises(SpatialDynError, match="column 1"):
        ours.orthonormalization(np.ones((3, 2)))
    for wrong in (lambda: ours.linalg.inv(np.zeros((2, 3))), lambda: ours.isOrthonormal([1.0])):
        with pytest.raises(SpatialDynError):
            wrong()


def humanoid(pin: Any) -> Any:
    """A model with a free flyer, a pair of cos and sin, and a branch."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    arm = model.addJoint(root, pin.JointModelRUBX(), pin.SE3.Identity(), "arm")
    model.addJoint(arm, pin.JointModelRY(), pin.SE3.Identity(), "hand")
    model.addJoint(root, pin.JointModelSpherical(), pin.SE3.Identity(), "neck")
    return model


def test_compact_tangent_map_and_its_places_are_the_wheels() -> None:
    pin = pytest.importorskip("pinocchio")
    mine, theirs = humanoid(ours), humanoid(pin)
    rng = np.random.default_rng(2)
    q = ours.integrate(mine, ours.neutral(mine), rng.standard_normal(mine.nv))
    assert np.allclose(ours.compactTangentMap(mine, q), pin.compactTangentMap(theirs, q), rtol=0.0, atol=TOLERANCE)
    assert np.allclose(ours.tangentMap(mine, q), pin.tangentMap(theirs, q), rtol=0.0, atol=TOLERANCE)
    for a, b in zip(
        ours.getTangentToConfigurationSparsitySegment(mine),
        pin.getTangentToConfigurationSparsitySegment(theirs),
        strict=True,
    ):
        assert list(a) == list(b)


def test_common_ancestors_are_the_wheels() -> None:
    pin = pytest.importorskip("pinocchio")
    mine, theirs = humanoid(ours), humanoid(pin)
    for a in range(mine.njoints):
        for b in range(mine.njoints):
            assert ours.findCommonAncestor(mine, a, b) == tuple(pin.findCommonAncestor(theirs, a, b))


def test_columns_may_be_matrices() -> None:
    """np.matrix keeps two axes in every slice."""
    model = ours.buildSampleModelManipulator()
    data, other = model.createData(), model.createData()
    q, p = np.linspace(0.1, 0.6, 6), np.array([1.0, 2.0, 3.0])

    def column(x: np.ndarray) -> Any:
        return np.ones((x.size, 1)).view(np.matrix) * 0.0 + x.reshape(-1, 1)

    Q, X = column(q), column(p)
    assert isinstance(Q, np.matrix)
    assert (ours.rnea(model, data, Q, Q, Q) == ours.rnea(model, other, q, q, q)).all()
    assert (ours.crba(model, data, Q) == ours.crba(model, other, q)).all()
    assert (ours.integrate(model, Q, Q) == ours.integrate(model, q, q)).all()
    assert (ours.centerOfMass(model, data, Q) == ours.centerOfMass(model, other, q)).all()
    assert ours.SE3(np.eye(3).view(np.matrix), X) == ours.SE3(np.eye(3), p)
    assert (ours.exp3(X) == ours.exp3(p)).all()
    assert ours.Motion(X, X) == ours.Motion(p, p)
    with pytest.raises(TypeError, match=r"q is an array of shape \(1, 6\)"):
        ours.crba(model, data, Q.T)


@pytest.mark.parametrize("prec", [float("nan"), -1.0, -1e-300])
def test_a_precision_that_is_none_is_refused_as_in_the_wheel(prec: float) -> None:
    for pin in (ours, pytest.importorskip("pinocchio")):
        model = humanoid(pin)
        q = pin.neutral(model)
        with pytest.raises(ValueError, match=r"prec is |should be positive"):
            pin.isNormalized(model, q, prec)
        with pytest.raises(ValueError, match=r"prec is |should be positive"):
            pin.isSameConfiguration(model, q, q, prec)
        assert not pin.isNormalized(model, q, 0.0)
        assert pin.isSameConfiguration(model, q, q, 0.0)


def test_same_configurations_and_kept_derivatives_differ_as_is_listed() -> None:
    for pin in (ours, pytest.importorskip("pinocchio")):
        is_ours, model = pin is ours, pin.buildSampleModelManipulator()
        data, q, v = model.createData(), pin.neutral(model), np.ones(model.nv)
        assert pin.isSameConfiguration(model, q, q + 1e-14, 1e-12) == is_ours
        kept = pin.computeRNEADerivatives(model, data, q, v, v)[0]
        before = np.array(kept)
        pin.computeRNEADerivatives(model, data, q + 1.0, v, v)
        assert (kept == before).all() == is_ours
        inertia = pin.computeSupportedInertiaByFrame(model, data, 0, True)
        assert (inertia.mass >= pin.computeTotalMass(model)) == is_ours


def test_jacobians_of_one_freedom_have_two_axes_and_that_is_listed() -> None:
    shapes = []
    for pin in (ours, pytest.importorskip("pinocchio")):
        model, q = pin.Model(), np.zeros(1)
        model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "a")
        model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
        frame, data = model.addJointFrame(1), model.createData()
        shapes.append([
            x.shape
            for x in (
                pin.computeJointJacobians(model, data, q), data.J, pin.getJointJacobian(model, data, 1, pin.LOCAL),
                pin.computeFrameJacobian(model, data, q, frame), pin.getFrameJacobian(model, data, frame, pin.WORLD),
                pin.computeJointJacobiansTimeVariation(model, data, q, q), data.dJ,
                pin.jacobianCenterOfMass(model, data, q), data.Jcom, pin.ccrba(model, data, q, q), data.Ag,
            )
        ])  # fmt: skip
    here, there = shapes
    assert here == [(*shape, 1) for shape in there]
    assert {len(shape) for shape in there} == {1}
    assert [x for x in ours.differences() if "nv = 1" in x.what]


def test_utils_have_skew() -> None:
    """Pinocchio 2 had it there, and scripts use it."""
    assert ours.utils.skew is ours.skew


def test_an_attribute_error_names_the_package() -> None:
    with pytest.raises(AttributeError, match=r"^module 'spatialdyn\.compat\.pinocchio' has no attribute 'frobnicate'"):
        ours.frobnicate
    with pytest.raises(ImportError, match=r"cannot import name 'frobnicate' from 'spatialdyn\.compat\.pinocchio'"):
        exec("from spatialdyn.compat.pinocchio import frobnicate", {})
