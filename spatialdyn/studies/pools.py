"""Adapter for pools of workers that are not executors, such as Ray's."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from ..errors import StudyError, literal


class PoolExecutor(Executor):
    """An executor on a pool that has ``apply_async`` like ``multiprocessing.pool.Pool``."""

    def __init__(self, pool: Any) -> None:
        """An executor on a pool. Raises StudyError for a process pool that waits for ever if a process is killed."""
        if (type(pool).__module__, type(pool).__name__) == ("multiprocessing.pool", "Pool"):
            raise StudyError(f"executor is {literal(pool)}, expected a ProcessPoolExecutor, which sees a killed worker")
        self._pool = pool

    def submit(self, fn: Callable[..., Any], /, *words: Any, **options: Any) -> Future[Any]:
        """A future of a call on the pool."""
        made: Future[Any] = Future()
        made.set_running_or_notify_cancel()  # a pool cannot cancel a submitted call
        self._pool.apply_async(fn, words, options, callback=made.set_result, error_callback=made.set_exception)
        return made
