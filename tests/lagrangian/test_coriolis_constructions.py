"""The constructions of C compared, and the check of skewness."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.lagrangian.lie_brackets import structure_constants

EPS = np.finfo(float).eps
CLOSE = 256 * EPS  # of the largest entry, as in test_coriolis.py
TORSION = 1e-12  # of the largest entry, of differences of values twice as large
DIFFERENCES = 1e-10  # of the largest entry: sixth-order differences at STEP lose four digits to rounding
FORMS = 1024 * EPS  # of the largest entry: three values of a quadratic form are subtracted
APART = 1e-2  # of the largest entry: well above rounding
COORDINATES = ("revolute", "continuous", "prismatic")


def case(seed: int, floating: bool = False, kinds: tuple[str, ...] | None = None) -> tuple[Any, Any]:
    made = random_tree(seed, 5, floating=floating, **({"kinds": kinds} if kinds else {}))
    return made.model, random_state(made.tree, np.random.default_rng(seed))


ALL = [case(0), case(1, floating=True), case(2, kinds=("spherical", "planar", "floating")), case(3, kinds=COORDINATES)]
ANGLES = [case(3, kinds=COORDINATES), case(4, kinds=("revolute",))]


def off(x: Any, y: Any) -> float:
    """The largest difference, of the largest entry of y or 1."""
    return float(abs(np.asarray(x) - np.asarray(y)).max() / max(1.0, abs(np.asarray(y)).max()))


@pytest.mark.parametrize(("model", "s"), ALL)
def test_analytic_constructions_give_one_c_on_all_joints(model: Any, s: Any) -> None:
    """Koszul's formula holds on quaternion joints."""
    construct = sd.ChristoffelC(model)
    C = construct.recursive(s.q, s.v)
    assert off(construct.from_derivatives(s.q, s.v), C) <= CLOSE
    assert off(construct.by_finite_differences(s.q, s.v), C) <= DIFFERENCES


@pytest.mark.parametrize(("model", "s"), ANGLES)
def test_rnea_columns_are_christoffel_with_coordinates(model: Any, s: Any) -> None:
    construct = sd.ChristoffelC(model)
    assert off(construct.by_rnea_columns(s.q, s.v), construct.recursive(s.q, s.v)) <= FORMS


@pytest.mark.parametrize(("model", "s"), ALL)
def test_rnea_columns_lack_half_a_bracket_elsewhere(model: Any, s: Any) -> None:
    construct = sd.ChristoffelC(model)
    C, columns = construct.recursive(s.q, s.v), construct.by_rnea_columns(s.q, s.v)
    rotors = np.zeros(model.nv)
    for joint in model.joints[1:]:
        if joint.nv > 1:
            rows = slice(joint.row - joint.nv + 1, joint.row + 1)
            rotors[joint.idx_v : joint.idx_v + joint.nv] = model.bodies["armature"][rows]
    bracket = np.einsum("im,mkj,k->ij", sd.crba(model, s.q) - np.diag(rotors), structure_constants(model), s.v)
    assert off(columns + 0.5 * bracket, C) <= FORMS


@pytest.mark.parametrize(("model", "s"), ALL)
def test_every_construction_gives_the_same_c_v(model: Any, s: Any) -> None:
    construct = sd.ChristoffelC(model)
    forces = construct.recursive(s.q, s.v) @ s.v
    for C in (
        construct.from_derivatives(s.q, s.v),
        construct.by_rnea_columns(s.q, s.v),
        construct.not_christoffel(s.q, s.v),
        construct.not_christoffel(s.q, s.v, skew=False),
    ):
        assert off(C @ s.v, forces) <= FORMS


@pytest.mark.parametrize(("model", "s"), ALL)
def test_the_check_tells_the_constructions_apart(model: Any, s: Any) -> None:
    construct = sd.ChristoffelC(model)
    christoffel = sd.verify_skew_symmetry(model, s.q, s.v)
    assert max(abs(christoffel.weak), christoffel.strong, christoffel.torsion) <= TORSION * christoffel.scale
    skew = sd.verify_skew_symmetry(model, s.q, s.v, lambda v: construct.not_christoffel(s.q, v))
    assert skew.strong <= TORSION * skew.scale
    assert skew.torsion > APART * skew.scale
    weak = sd.verify_skew_symmetry(model, s.q, s.v, lambda v: construct.not_christoffel(s.q, v, skew=False))
    assert abs(weak.weak) <= TORSION * weak.scale * np.linalg.norm(s.v) ** 2
    assert weak.strong > APART * weak.scale


def test_a_matrix_has_no_torsion_to_check_and_the_result_says_so() -> None:
    model, s = ALL[0]
    found = sd.verify_skew_symmetry(model, s.q, s.v, sd.coriolis_matrix(model, s.q, s.v))
    assert found.torsion is None
    assert found.strong <= TORSION * found.scale
    assert "not defined for a matrix" in repr(found)
    assert model.name in repr(found)


def test_structure_constants_are_those_of_so3_and_se3() -> None:
    model, _ = case(1, floating=True)
    c = structure_constants(model)
    assert (c == -c.transpose(0, 2, 1)).all()
    jacobi = np.einsum("mjl,lkn->mjkn", c, c)
    total = jacobi + jacobi.transpose(0, 2, 3, 1) + jacobi.transpose(0, 3, 1, 2)
    assert abs(total).max() <= CLOSE
    e = np.eye(3)
    for a in range(3):
        for b in range(3):
            np.testing.assert_array_equal(c[3:6, 3 + a, 3 + b], np.cross(e[a], e[b]))
            np.testing.assert_array_equal(c[:3, 3 + a, b], np.cross(e[a], e[b]))
    assert not structure_constants(case(3, kinds=COORDINATES)[0]).any()


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: a minute of differences")
def test_batches_and_single_samples_agree() -> None:
    model, s = ALL[1]
    construct = sd.ChristoffelC(model)
    v = np.stack([s.v, 2.0 * s.v, s.a])
    for name in ("recursive", "from_derivatives", "by_rnea_columns", "by_finite_differences", "not_christoffel"):
        found = getattr(construct, name)(s.q, v)
        assert found.shape == (3, model.nv, model.nv)
        for k in range(3):
            assert off(found[k], getattr(construct, name)(s.q, v[k])) <= FORMS


def test_bad_input_is_refused_by_name() -> None:
    model, s = ALL[3]
    with pytest.raises(sd.ModelError, match="model is a str"):
        sd.ChristoffelC("arm")
    with pytest.raises(sd.SpatialDynError, match=r"h is 0\.0, expected a positive number"):
        sd.ChristoffelC(model).by_finite_differences(s.q, s.v, h=0.0)
    with pytest.raises(sd.SpatialDynError, match="h is 'small', expected a positive number"):
        sd.ChristoffelC(model).by_finite_differences(s.q, s.v, h="small")  # type: ignore[arg-type]
    with pytest.raises(sd.ShapeError, match=r"C has shape \(2,\), expected \(5, 5\)"):
        sd.verify_skew_symmetry(model, s.q, s.v, [1.0, 2.0])
    with pytest.raises(sd.ShapeError, match=r"v has shape \(4,\), expected \(5,\)"):
        sd.verify_skew_symmetry(model, s.q, s.v[:4])
    with pytest.raises(sd.ShapeError, match=r"v has shape \(4,\)"):
        sd.ChristoffelC(model).from_derivatives(s.q, s.v[:4])


def test_the_object_is_the_cheapest_construction() -> None:
    model = sd.load_urdf("two_link")
    construct, q, v = sd.ChristoffelC(model), [0.5, -0.3], [1.0, 2.0]
    np.testing.assert_array_equal(construct(q, v), sd.coriolis_matrix(model, q, v))
