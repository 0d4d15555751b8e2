"""ModelPool, rneaInParallel and abaInParallel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as face
from spatialdyn.urdf.load import find_robot

pin = pytest.importorskip("pinocchio")

BOUND = 1e-11  # scaled, the bound of all of compat
SAMPLES = 300  # enough for two threads


@pytest.fixture(scope="module")
def pools() -> tuple[Any, Any]:
    path = str(find_robot("panda"))
    return tuple(module.ModelPool(module.buildModelFromUrdf(path), 3) for module in (face, pin))  # type: ignore[return-value]


def states(n: int) -> list[Any]:
    return list(np.random.default_rng(0).normal(size=(3, 9, n)))


def close(x: Any, y: Any) -> None:
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= BOUND * max(1.0, abs(y).max(initial=0.0))


@pytest.mark.parametrize("name", ["rneaInParallel", "abaInParallel"])
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("n", [0, 1, 7, SAMPLES])
def test_columns_are_pinocchios(pools: tuple[Any, Any], name: str, threads: int, n: int) -> None:
    given = states(n)
    found = getattr(face, name)(threads, pools[0], *given)
    assert found.flags.c_contiguous
    close(found, getattr(pin, name)(threads, pools[1], *given))
    for order in ("C", "F"):
        out = np.zeros((9, n), order=order)  # type: ignore[call-overload]
        assert getattr(face, name)(threads, pools[0], *given, out) is None
        np.testing.assert_array_equal(out, found.reshape(9, n))


def test_threads_change_no_bit(pools: tuple[Any, Any]) -> None:
    given = states(SAMPLES)
    one = face.rneaInParallel(1, pools[0], *given)
    np.testing.assert_array_equal(face.rneaInParallel(3, pools[0], *given), one)


def test_one_sample_may_be_a_vector(pools: tuple[Any, Any]) -> None:
    given = [x[:, 0] for x in states(1)]
    close(face.rneaInParallel(1, pools[0], *given), pin.rneaInParallel(1, pools[1], *given))


def test_wrong_arguments_raise_pinocchios_classes(pools: tuple[Any, Any]) -> None:
    q, v, a = states(4)
    pool = pools[0]
    for wrong in (
        (4, pool, q, v, a),
        (1, pool, q[:-1], v, a),
        (1, pool, q, v[:, :-1], a),
        (1, pool, q, v, a, q[:, :2]),
    ):
        with pytest.raises(ValueError, match=r"expected|differ"):
            face.rneaInParallel(*wrong)
    with pytest.raises(TypeError):
        face.rneaInParallel(1, pool.getModel(0), q, v, a)
    with pytest.raises(TypeError):
        face.rneaInParallel(1, pool, q.tolist(), v, a)


def test_a_pool_holds_copies(pools: tuple[Any, Any]) -> None:
    model = face.buildModelFromUrdf(str(find_robot("two_link")))
    pool = face.ModelPool(model, 2)
    model.armature[:] = 1.0
    assert not pool.getModel(0).armature.any()
    assert pool.size() == len(pool.getModels()) == len(pool.getDatas()) == 2
    pool.resize(3)
    assert pool.size() == 3
    pool.resize(1)
    assert pool.copy().size() == 1
    for index in (-1, 1):
        with pytest.raises(ValueError, match="index"):
            pool.getModel(index)
        with pytest.raises(ValueError, match="index"):
            pool.getData(index)
    for size in (0, -1):
        with pytest.raises(ValueError, match="size"):
            face.ModelPool(model, size)


def test_edits_of_the_pools_model_count() -> None:
    pool = face.ModelPool(face.buildModelFromUrdf(str(find_robot("panda"))), 1)
    q = np.zeros((9, 4))
    before = face.rneaInParallel(1, pool, q, q, q + 1.0)
    pool.getModel(0).armature[:] = 0.5
    after = face.rneaInParallel(1, pool, q, q, q + 1.0)
    np.testing.assert_allclose(after - before, 0.5, rtol=0, atol=1e-12)
