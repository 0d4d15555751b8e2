"""Pinocchio's wheel for tests; a test that uses it where it is not installed (Windows has none) is skipped."""

from __future__ import annotations

from typing import Any

import pytest

try:
    import pinocchio as pin
except ImportError:

    class _Absent:
        """Skips the test that reads a name of it."""

        def __getattr__(self, name: str) -> Any:
            return pytest.importorskip("pinocchio")

    pin = _Absent()

__all__ = ["pin"]
