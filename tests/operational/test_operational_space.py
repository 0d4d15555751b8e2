"""Dynamics of a frame: the equation of motion, dΛ/dt, singular configurations, bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.operational.spectral import spectral_inverse

EPS = np.finfo(float).eps
CLOSE = 1e5 * EPS  # of the largest entry: M⁻¹ and Λ of arms whose M has a condition of some thousands
STEP, DIFFERENCE = 1e-6, 1e-8  # of a central difference, and what it leaves, relative
REFERENCES = ("local", "world", "local_world_aligned")


def close(x: Any, y: Any) -> None:
    assert abs(np.asarray(x) - y).max() <= CLOSE * max(1.0, abs(np.asarray(y)).max())


@pytest.fixture(scope="module")
def arm() -> Any:
    """A redundant arm and a state away from singularities."""
    model, rng = sd.load_urdf("panda"), np.random.default_rng(0)
    return model, sd.random_configuration(model, rng), rng.normal(size=model.nv), rng.normal(size=model.nv)


@pytest.mark.parametrize("reference", REFERENCES)
def test_force_moves_the_frame_as_its_equation_says(arm: Any, reference: str) -> None:
    model, q, v, tau = arm
    x = sd.operational_space(model, q, v, "panda_hand", reference, damping=1e-6)  # far from the world's origin
    a = sd.aba(model, q, v, tau)
    J = sd.frame_jacobian(model, q, "panda_hand", reference)
    moved = J @ a + sd.jacobian_dot_times_v(model, q, v, "panda_hand", reference)
    assert (x.rank, x.weak.any()) == (6, False)
    close(x.Lambda @ moved + x.mu + x.p, x.J_bar.T @ tau)
    close(J @ x.J_bar, np.eye(6))
    close(x.N @ x.N, x.N)
    M = sd.crba(model, q)
    close(M @ x.N, (M @ x.N).T)
    close(J @ sd.minverse(model, q) @ x.N.T, np.zeros((6, model.nv)))


def test_the_inertia_changes_by_c_and_its_transpose(arm: Any) -> None:
    """For one C of J̄ ẋ, with the C of Christoffel's symbols."""
    model, q, v, _ = arm
    for axes in ("xyz rxyz", "xz ry"):
        x = sd.operational_space(model, q, v, "panda_hand", "local_world_aligned", axes)
        ahead, behind = (
            sd.operational_space(model, sd.integrate(model, q, h * v), v, "panda_hand", "local_world_aligned", axes)
            for h in (STEP, -STEP)
        )
        rate = (ahead.Lambda - behind.Lambda) / (2 * STEP)
        assert abs(rate - x.C - x.C.T).max() <= DIFFERENCE * abs(rate).max() + DIFFERENCE


def test_a_batch_is_its_samples(arm: Any) -> None:
    model, _, _, _ = arm
    rng = np.random.default_rng(1)
    q, v = sd.random_configuration(model, rng, (3,)), rng.normal(size=(3, model.nv))
    found = sd.operational_space(model, q, v, "panda_hand", axes="xyz")
    for k in range(3):
        for whole, one in zip(found, sd.operational_space(model, q[k], v[k], "panda_hand", axes="xyz"), strict=True):
            close(whole[k], one)


def test_weak_directions_are_left_and_named() -> None:
    """A planar arm's frame moves in x, z and turns about y; stretched out it does not move along itself."""
    b = sd.ModelBuilder("2R")
    solid = (1.0, (0.5, 0, 0), np.diag([0.01, 0.1, 0.1]))
    b.add_body("a", None, "revolute", (0, 1, 0), None, solid)
    b.add_body("b", "a", "revolute", (0, 1, 0), (1, 0, 0), solid)
    model = b.add_body("tip", "b", "fixed", placement=(1, 0, 0)).build()
    x = sd.operational_space(model, [0.0, 0.0], [0.0, 0.0], "tip", "local_world_aligned", "xz")
    assert x.rank == 1
    np.testing.assert_allclose(abs(x.weak[0]), [1.0, 0.0], atol=CLOSE)
    assert np.isfinite(x.Lambda).all()
    assert sd.operational_space(model, [0.0, 0.7], [0.0, 0.0], "tip", axes="xz").rank == 2
    near = sd.operational_space(model, [0.0, 1e-6], [0.0, 0.0], "tip", axes="xz")
    away = sd.operational_space(model, [0.0, 1.0], [0.0, 0.0], "tip", axes="xz")
    assert near.rank == 1
    assert np.linalg.norm(near.Lambda, 2) < 1e2 * np.linalg.norm(away.Lambda, 2)


def test_the_bounded_inverse_is_smooth_and_never_above_its_bound() -> None:
    w = np.linspace(0.0, 2.0, 4001)[1:] * 1e-3
    A = np.zeros((len(w), 2, 2))
    A[:, 0, 0], A[:, 1, 1] = 1.0, w
    f = spectral_inverse(A, np.ones(2), 1e-3).matrix[:, 1, 1]
    assert f.max() <= 1.125e3 * (1 + CLOSE)
    np.testing.assert_allclose(f[w >= 1e-3], 1 / w[w >= 1e-3], rtol=1e-12)
    slopes = np.diff(f) / np.diff(w)
    assert abs(np.diff(slopes)).max() < 1e-2 * abs(slopes).max()  # no jump of the slope at the share


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"frame": "hand"}, sd.ModelError, "hand"),
        ({"axes": "xx"}, sd.SpatialDynError, "xx"),
        ({"axes": "q"}, sd.SpatialDynError, "letters of xyz"),
        ({"length": 0.0}, sd.SpatialDynError, "length is 0.0"),
        ({"damping": 0.0}, sd.SpatialDynError, "damping is 0.0"),
        ({"reference": "body"}, sd.SpatialDynError, "body"),
        ({"q": [np.nan] * 9}, sd.NonFiniteError, "q has"),
    ],
)
def test_bad_input_is_named(arm: Any, change: dict[str, Any], kind: type[Exception], message: str) -> None:
    model, q, v, _ = arm
    with pytest.raises(kind, match=message):
        sd.operational_space(**({"model": model, "q": q, "v": v, "frame": "panda_hand"} | change))
