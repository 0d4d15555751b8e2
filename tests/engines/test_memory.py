"""Memory of results: blocks are used again when no view is left, never before, and few are kept."""

from __future__ import annotations

import threading
import weakref
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines import memory


@pytest.fixture
def pool(monkeypatch: pytest.MonkeyPatch) -> memory.Pool:
    """A pool of its own, for results of a page or more."""
    fresh = memory.Pool()
    monkeypatch.setattr(memory, "pool", fresh)
    monkeypatch.setattr(memory, "POOLED", memory.PAGE)
    return fresh


def address(x: np.ndarray) -> int:
    return int(x.ctypes.data)


def test_a_freed_result_leaves_its_memory_to_the_next(pool: memory.Pool) -> None:
    x = memory.empty((3, memory.PAGE // 8))
    at = address(x)
    x[:] = 1.0
    del x
    assert pool.kept == 3 * memory.PAGE
    y = memory.empty((2 * memory.PAGE // 8 + memory.PAGE // 8 - 1, 2), np.float32)
    assert address(y) == at
    assert pool.kept == 0
    assert y.dtype == np.float32


@pytest.mark.parametrize("kind", ["row", "transpose", "memoryview", "real", "reshaped view of a view"])
def test_memory_is_not_used_again_while_a_view_of_it_lives(pool: memory.Pool, kind: str) -> None:
    x = memory.empty((2, memory.PAGE // 8))
    x[:] = 7.0
    view: Any = {
        "row": x[1], "transpose": x.T, "memoryview": memoryview(x), "real": x.real,
        "reshaped view of a view": x[1:][0].reshape(4, -1),
    }[kind]  # fmt: skip
    del x
    assert pool.kept == 0
    other = memory.empty((2, memory.PAGE // 8))
    other[:] = 0.0
    assert (np.asarray(view) == 7.0).all()
    del view
    assert pool.kept == 2 * memory.PAGE


def test_a_result_is_a_plain_writable_aligned_array(pool: memory.Pool) -> None:
    for size in (10, 1 << 17, memory.PAGE // 8 + 3, 4 * memory.PAGE // 8):
        x = memory.empty((size,))
        assert type(x) is np.ndarray
        assert x.shape == (size,)
        assert x.flags.c_contiguous
        assert x.flags.writeable
        assert address(x) % (64 if x.nbytes >= memory.ALIGNED else 8) == 0
        x[:] = 2.0
        assert x.sum() == 2.0 * size


def test_no_more_is_kept_than_promised(pool: memory.Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last freed stay; a block larger than that is no block of the pool."""
    monkeypatch.setattr(memory, "MOST", 5 * memory.PAGE)
    made = [memory.empty((2 * memory.PAGE // 8,)) for _ in range(4)]
    last = address(made[-1])
    while made:
        del made[0]
        assert pool.kept <= memory.MOST
    assert pool.kept == 4 * memory.PAGE
    assert address(memory.empty((2 * memory.PAGE // 8,))) == last
    large = memory.empty((6 * memory.PAGE // 8,))
    del large
    assert pool.kept == 4 * memory.PAGE
    pool.clear()
    assert pool.kept == 0


def test_a_small_result_does_not_hold_a_large_block(pool: memory.Pool) -> None:
    large = memory.empty((10 * memory.PAGE // 8,))
    at = address(large)
    del large
    small = memory.empty((7 * memory.PAGE // 8,))
    assert pool.kept == 10 * memory.PAGE
    assert address(memory.empty((8 * memory.PAGE // 8,))) == at
    assert small.size == 7 * memory.PAGE // 8


def test_blocks_are_given_back_to_the_system(pool: memory.Pool) -> None:
    x = memory.empty((memory.PAGE // 8,))
    block = weakref.ref(x.base.base._block)
    del x
    assert block() is not None
    pool.clear()
    assert block() is None


def test_a_result_freed_within_the_pool_waits_for_no_lock(pool: memory.Pool) -> None:
    """As by the garbage collector: the block is kept at the next call."""
    x = memory.empty((memory.PAGE // 8,))
    at = address(x)
    with pool._lock:
        del x
        other = memory.empty((memory.PAGE // 8,))
        assert address(other) != at
    assert address(memory.empty((memory.PAGE // 8,))) == at


def test_a_lack_of_memory_empties_the_pool_first(pool: memory.Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    x = memory.empty((memory.PAGE // 8,))
    del x
    right, kept = memory.Block, []

    def scarce(size: int) -> memory.Block:
        kept.append(pool.kept)
        if pool.kept:
            raise MemoryError
        return right(size)

    monkeypatch.setattr(memory, "Block", scarce)
    assert memory.empty((4 * memory.PAGE // 8,)).size == 4 * memory.PAGE // 8
    assert kept == [memory.PAGE, 0]


def test_blocks_of_concurrent_callers_are_apart(pool: memory.Pool) -> None:
    wrong = []

    def work(number: int) -> None:
        for k in range(100):
            x = memory.empty((memory.PAGE // 8,))
            x[::512] = value = 1000.0 * number + k
            if not (x[::512] == value).all():
                wrong.append((number, k))

    workers = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert not wrong
    assert pool.kept <= 8 * memory.PAGE  # a thread has the last block while it takes the next


def test_results_of_calls_use_the_pool(pool: memory.Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their bits are those of an array given."""
    monkeypatch.setattr(memory, "ALIGNED", 1 << 10)
    monkeypatch.setattr(memory, "POOLED", 1 << 10)
    arm = sd.load_urdf("two_link")
    q = np.random.default_rng(0).standard_normal((700, 2))
    gravity = sd.specialize(arm, sd.generalized_gravity)
    for values in (q, q[:35, None]):
        wanted = sd.crba(arm, values, out=np.empty((*values.shape[:-1], 2, 2)))
        found = sd.crba(arm, values)
        np.testing.assert_array_equal(found, wanted)
        at = address(found)
        del found
        assert pool.kept == memory.PAGE
        assert address(sd.crba(arm, values)) == at
    found = gravity(q)
    at = address(found)
    del found
    assert address(gravity(q)) == at
