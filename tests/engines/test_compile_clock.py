"""The rule of when code is compiled."""

from __future__ import annotations

import pytest

from spatialdyn.engines.compile_clock import CompileClock
from spatialdyn.engines.compiled.lane_batches import LaneBatches
from spatialdyn.engines.compiled.tiers import Tier
from spatialdyn.engines.programs.run.tiered_program import TieredProgram


def test_compiling_pays_once_the_time_spent_reaches_the_time_it_takes() -> None:
    clock = CompileClock()
    clock.compile_seconds = 1.0
    clock.spend(0.75)
    assert not clock.pays
    clock.spend(0.25)
    assert clock.pays


def test_the_time_of_a_function_that_raises_counts() -> None:
    clock = CompileClock()
    clock.compile_seconds = 1e-9
    assert clock.timed(divmod, 7, 4) == (1, 3)
    assert clock.pays
    clock = CompileClock()
    clock.compile_seconds = 1e-9
    with pytest.raises(ZeroDivisionError):
        clock.timed(divmod, 7, 0)
    assert clock.pays


def test_all_tiers_have_the_rule() -> None:
    for kind in (Tier, LaneBatches, TieredProgram):
        assert kind.pays is CompileClock.pays
