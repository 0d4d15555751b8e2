"""Fixtures of the tests of compat."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import spatialdyn.compat.pinocchio as pin
from spatialdyn.engines.compiled import tiers

SECONDS = 0.1  # that a function runs in plain Python: the suite calls each often, and compiles it but once


@pytest.fixture(autouse=True, scope="session")
def _soon() -> Iterator[None]:
    """Compile sooner than a person's process would; ``test_tiers`` has both ways, whose bits are the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tiers, "COMPILE_SECONDS", SECONDS)
        patch.setattr(tiers.Tier, "compile_seconds", SECONDS)
        yield


@pytest.fixture
def strict_mode() -> Iterator[None]:
    """Strict mode, for one test."""
    before = pin.strict(True)
    yield
    pin.strict(before)
