"""``ModelPool``, ``rneaInParallel``, ``abaInParallel``: batches, on the library's SIMD lanes and over threads.

Columns are samples, as in Pinocchio. The models and datas of a pool are copies for the caller; batches use neither.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from ....calls import dynamics as library
from ....engines.threads import slices
from ....errors import ShapeError, SpatialDynError
from ....waiting import watch
from ..model.library_model import library_model
from ..model.model import Model
from ..types.arguments import NUMBERS, ArgumentError, Array, described, expected

__all__ = ["ModelPool", "abaInParallel", "omp_get_max_threads", "rneaInParallel"]

LEAST = 128  # least samples of a thread: fewer take less time than waking it


class PoolError(SpatialDynError):
    """A number of threads or models out of a pool's range."""


class ModelPool:
    """Copies of a model with a Data each.

    model  Model, or another pool
    size   number of copies, 1 by default
    """

    def __init__(self, model: Model | ModelPool, size: int = 1) -> None:
        self._models: list[Model]
        self._datas: list[Any]
        if isinstance(model, ModelPool):
            self._models, self._datas = [x.copy() for x in model._models], [x.copy() for x in model._datas]
            return
        expected(model, Model, "model")
        if size < 1:
            raise PoolError(f"size is {size}, expected 1 or more")
        self._models = [model.copy() for _ in range(size)]
        self._datas = [x.createData() for x in self._models]

    def size(self) -> int:
        """Number of models."""
        return len(self._models)

    def resize(self, new_size: int) -> None:
        """Drop models from the end, or append copies of the first."""
        if new_size < 1:
            raise PoolError(f"new_size is {new_size}, expected 1 or more")
        del self._models[new_size:], self._datas[new_size:]
        while len(self._models) < new_size:
            self._models.append(self._models[0].copy())
            self._datas.append(self._models[-1].createData())

    def update(self, data: Any) -> None:
        """Replace every Data by a copy of this one."""
        self._datas = [data.copy() for _ in self._datas]

    def getModel(self, index: int) -> Model:
        """The model of that index. Raises PoolError if there is none."""
        return self._models[self._index(index)]

    def getData(self, index: int) -> Any:
        """The Data of that index. Raises PoolError if there is none."""
        return self._datas[self._index(index)]

    def getModels(self) -> list[Model]:
        """All models."""
        return list(self._models)

    def getDatas(self) -> list[Any]:
        """All Datas."""
        return list(self._datas)

    def copy(self) -> ModelPool:
        """A pool of copies."""
        return ModelPool(self)

    def _index(self, index: int) -> int:
        if not 0 <= index < len(self._models):
            raise PoolError(f"index is {index}, expected one below the pool's size {len(self._models)}")
        return index


def rneaInParallel(num_thread: int, pool: ModelPool, q: Any, v: Any, a: Any, tau: Any = None) -> Array | None:
    """Inverse dynamics (nv, B) of B samples, (nv,) of one.

    num_thread  up to the pool's size
    q           (nq, B), v and a (nv, B)
    tau         (nv, B), written in place if given, and None is returned

    Raises PoolError for more threads than models; ShapeError, ArgumentError
    """
    return _in_parallel(library.calls["rnea"], num_thread, pool, {"q": q, "v": v, "a": a}, "tau", tau)


def abaInParallel(num_thread: int, pool: ModelPool, q: Any, v: Any, tau: Any, a: Any = None) -> Array | None:
    """Forward dynamics (nv, B) of B samples; arguments and errors as those of ``rneaInParallel``, and InertiaError."""
    return _in_parallel(library.calls["aba"], num_thread, pool, {"q": q, "v": v, "tau": tau}, "a", a)


def omp_get_max_threads() -> int:
    """Default number of threads: 1."""
    return 1


def _in_parallel(
    call: Callable[..., Array], threads: int, pool: Any, given: dict[str, Any], result: str, out: Any
) -> Array | None:
    expected(pool, ModelPool, "pool")
    if not 0 <= threads <= pool.size():
        raise PoolError(f"num_thread is {threads}, expected at most the pool's size {pool.size()}")
    model = pool.getModel(0)
    rows = [_samples(name, x, model.nq if name == "q" else model.nv) for name, x in given.items()]
    n = len(rows[0])
    if any(len(x) != n for x in rows):
        shapes = ", ".join(f"{name} {x.shape}" for name, x in given.items())
        raise ShapeError(f"numbers of columns differ: {shapes}")
    if out is not None and (not isinstance(out, np.ndarray) or out.shape != (model.nv, n)):
        raise ShapeError(f"{result} is {described(out)}, expected an array of shape {(model.nv, n)}")
    sd_model, parts = library_model(model).model, max(1, min(threads, n // LEAST))
    if parts == 1:
        found = call(sd_model, *rows)
    else:
        found = np.empty((n, model.nv))
        long = watch.work(f"a batch of {n} samples")
        with long, ThreadPoolExecutor(parts) as workers:  # in slices, for Ctrl-C is handled when the threads have ended
            for first, end in slices(n, len(sd_model.bodies), model.nv, LEAST * parts):
                cuts = pairwise([first + (end - first) * k // parts for k in range(parts + 1)])
                jobs = [workers.submit(call, sd_model, *(x[i:j] for x in rows), out=found[i:j]) for i, j in cuts]
                for job in jobs:
                    job.result()
    if out is None:
        return found[0] if n == 1 else np.ascontiguousarray(found.T)  # Pinocchio's arrays of one column are vectors
    out[...] = found.T
    return None


def _samples(name: str, value: Any, n: int) -> Array:
    """An array (n, B) as samples (B, n); a vector is one sample."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
        raise ArgumentError(f"{name} is {described(value)}, expected an array of numbers")
    if value.ndim == 1:
        value = value[:, None]
    if value.ndim != 2 or value.shape[0] != n:
        raise ShapeError(f"{name} has shape {value.shape}, expected ({n}, B)")
    return np.ascontiguousarray(value.T, np.float64)
