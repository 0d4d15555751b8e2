"""Costs as an idle machine has them: measured ones depend on its load, and with them which option comes first."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import pytest

from spatialdyn.accuracy import call_errors, integrator_errors
from spatialdyn.simulation import integrators, simulate

WORK = {"rnea": 1.0, "crba": 1.0, "aba": 2.0, "crba_solve": 3.0, "aba_refined": 5.0, "aba_square_root": 9.0}
EXTENDED = 100.0  # the work of forward dynamics in double-double
ENGINES = {"lanes float32": 5.0, "lanes float64": 10.0, "untraced float64": 200.0}  # ns of a unit of work
EVALUATION = 1e-6  # seconds of forward dynamics in a simulation


def nominal_costs(runs: Mapping[str, Callable[[], Any]], batch: int) -> dict[str, float]:
    """In place of ``call_errors.costs``: nanoseconds per sample by name, of candidates that do run."""
    for run in runs.values():
        run()
    named = {name: name.rsplit(" ", 1) for name in runs}
    return {name: ENGINES[engine] * WORK.get(call, EXTENDED) for name, (engine, call) in named.items()}


@pytest.fixture(autouse=True)
def costs_of_an_idle_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulations take the time of their evaluations by a clock of their own, and patience is without end."""
    now = [0.0]

    def timed(model: Any, q0: Any, v0: Any, duration: float, *, dt: float, method: str, **words: Any) -> Any:
        finer = words["rtol"] ** -0.15 if "rtol" in words else 1.0
        now[0] += EVALUATION * integrators[method].evaluations * finer * duration / dt
        return simulate(model, q0, v0, duration, dt=dt, method=method, **words)

    clock = SimpleNamespace(perf_counter=lambda: now[0], thread_time=lambda: 0.0)
    monkeypatch.setattr(call_errors, "costs", nominal_costs)
    for module in (call_errors, integrator_errors):
        monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(integrator_errors, "simulate", timed)
