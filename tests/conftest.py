"""What holds for all tests."""

from __future__ import annotations

import gc
import os
import signal
from pathlib import Path

import pytest
from environment import VARIABLES

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # read at the imports of NumPy and PyTorch
    os.environ.setdefault(name, "1")  # with a worker on each core, threads spin: networks train 4 times as long


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out, of ``-m slow``, files without a test of that mark: saves half of collecting."""
    if config.getoption("markexpr") != "slow" or not collection_path.match("test_*.py"):
        return None
    return True if "slow" not in collection_path.read_text(encoding="utf-8") else None


def pytest_configure() -> None:
    """Forget what a person has set for the library; hear Ctrl-C also where the suite was started in the background,
    whose processes ignore it. Collecting leaves next to nothing to the garbage collector: without it, it takes a fifth
    less.
    """
    gc.disable()
    for name in VARIABLES:
        os.environ.pop(name, None)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Spare the garbage collector what lives to the end, and call it seldom: saves 9 % and 6 % of compiling."""
    gc.enable()
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
