"""Lie groups under both imports, and the definition of the tangent map."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn import SpatialDynError
from spatialdyn.compat.pinocchio import liegroups

EPS = float(np.finfo(float).eps)
TOLERANCE = 4500 * EPS  # 1e-12, the bound of compat's types
STEP = 1e-6
DIFFERENCES = 1e-8  # central differences of that step: its square, and rounding over it

GROUPS = ["R1()", "R2()", "R3()", "Rn(5)", "SO2()", "SO3()", "SE2()", "SE3()", "R3()*SO3()", "SE3()*R2()*SO2()"]
CALLS = [
    "nq", "nv", "name", "neutral", "integrate(q, v)", "difference(q, r)", "distance(q, r)", "squaredDistance(q, r)",
    "interpolate(q, r, 0.3)", "dIntegrate(q, v, pin.ARG0)", "dIntegrate(q, v, pin.ARG1)", "dIntegrate_dq(q, v)",
    "dIntegrate_dv(q, v)", "dIntegrate_dq(q, v, J.T, 1)", "dIntegrate_dq(q, v, 1, J)", "dIntegrate_dv(q, v, 1, J)",
    "dDifference(q, r, pin.ARG0)", "dDifference(q, r, pin.ARG1)", "dDifference(q, r, pin.ARG0, 1, J)",
    "dDifference(q, r, pin.ARG1, J.T, 1)", "dIntegrateTransport(q, v, J, pin.ARG0)",
    "dIntegrateTransport(q, v, J, pin.ARG1)", "tangentMap(q)", "tangentMapProduct(q, J)",
    "tangentMapTransposeProduct(q, K)",
]  # fmt: skip


def group(pin: Any, text: str) -> Any:
    """The group of an expression in the functions of ``liegroups``."""
    return eval(text, {name: getattr(pin.liegroups, name) for name in liegroups.__all__})


def values(G: Any, seed: int) -> dict[str, Any]:
    """Elements, a tangent vector and matrices, the same for the same seed."""
    ours.seed(seed)
    rng = np.random.default_rng(seed)
    v, J, K = rng.standard_normal(G.nv), rng.standard_normal((G.nv, 2)), rng.standard_normal((G.nq, 2))
    return {"q": G.random(), "r": G.random(), "v": v, "J": J, "K": K}


@pytest.mark.parametrize("text", GROUPS)
@pytest.mark.parametrize("call", CALLS)
def test_groups_are_the_wheels(text: str, call: str) -> None:
    pin = pytest.importorskip("pinocchio")
    mine, theirs = group(ours, text), group(pin, text)
    given = values(mine, 1)
    result = eval(f"G.{call}", {"G": mine, "pin": ours, **given})
    expected = eval(f"G.{call}", {"G": theirs, "pin": pin, **given})
    if isinstance(expected, (str, int)):
        assert result == expected
    else:
        shape = np.shape(expected) if np.ndim(result) == np.ndim(expected) else np.shape(result)
        assert np.shape(result) == shape
        size = max(1.0, np.abs(expected).max())
        assert np.abs(np.reshape(expected, shape) - result).max() <= TOLERANCE * size


@pytest.mark.parametrize("text", GROUPS)
def test_tangent_map_makes_rates_of_velocities(text: str) -> None:
    G = group(ours, text)
    q = values(G, 2)["q"]
    rates = [(G.integrate(q, STEP * e) - G.integrate(q, -STEP * e)) / (2.0 * STEP) for e in np.eye(G.nv)]
    assert np.allclose(np.stack(rates, axis=1), G.tangentMap(q), rtol=0.0, atol=DIFFERENCES)


@pytest.mark.parametrize("joint", ["RX", "RUBX", "Spherical", "SphericalZYX", "Translation", "Planar", "FreeFlyer"])
def test_group_of_a_model_is_the_wheels(joint: str) -> None:
    pin = pytest.importorskip("pinocchio")
    names = []
    for module in (ours, pin):
        model = module.Model()
        model.addJoint(0, getattr(module, f"JointModel{joint}")(), module.SE3.Identity(), "a")
        model.addJoint(1, module.JointModelRX(), module.SE3.Identity(), "b")
        names.append((module.lieGroup(model).name, module.lieGroup(model).nq))
    assert names[0] == names[1]


def test_normalize_works_in_place_and_products_compare_by_their_factors() -> None:
    G = liegroups.SE3()
    q = values(G, 3)["q"]
    scaled = q.copy()
    scaled[3:] *= 3.0
    assert G.normalize(scaled) is None
    assert np.allclose(scaled, q, rtol=0.0, atol=4 * EPS)
    assert liegroups.R3() == liegroups.Rn(3)
    assert liegroups.R1() * liegroups.R2() != liegroups.R3()
    assert ours.LieGroup() * liegroups.R1() == liegroups.R1()
    assert ours.LieGroup().nq == 0


def test_wrong_sizes_are_errors() -> None:
    """The wheel reads past the end of the array."""
    G = liegroups.SE3()
    given = values(G, 4)
    for call in ("integrate(q, v[:3])", "dIntegrate_dq(q, v, J, 0)", "dIntegrate_dq(q, v, 0, J.T)", "tangentMap(v)"):
        with pytest.raises(SpatialDynError):
            eval(f"G.{call}", {"G": G, **given})
    with pytest.raises(TypeError):
        G.dDifference(given["q"], given["r"], ours.ARG2)
