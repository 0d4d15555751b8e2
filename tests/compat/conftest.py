"""Fixtures of the tests of compat."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import spatialdyn.compat.pinocchio as pin


@pytest.fixture
def strict_mode() -> Iterator[None]:
    """Strict mode, for one test."""
    before = pin.strict(True)
    yield
    pin.strict(before)
