"""The one rule of when code is compiled: once the time spent without it reaches the expected time to compile it.

So a caller waits at most about twice as long as if compiling had been right, or wrong, from the start.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any


class CompileClock:
    """The seconds spent without some compiled code.

    compile_seconds  expected seconds to compile that code
    """

    compile_seconds: float

    def __init__(self) -> None:
        self._spent = 0.0

    @property
    def pays(self) -> bool:
        """Whether to compile now."""
        return self._spent >= self.compile_seconds

    def spend(self, seconds: float) -> None:
        """Count seconds spent, or expected to be spent, without the compiled code."""
        self._spent += seconds

    def timed(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in place of the compiled code; its time counts, also if it raises."""
        start = perf_counter()
        try:
            return function(*arguments)
        finally:
            self.spend(perf_counter() - start)
