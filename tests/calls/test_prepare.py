"""Calls compiled ahead: later ones do not compile; progress is reported."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from inputs import empty_memory, run_python

import spatialdyn as sd
from spatialdyn.calls.progress import Steps, check_progress, reporting
from spatialdyn.engines import run
from spatialdyn.engines.compiled import disk_cache, entries, lane_names, numba_kernels
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.recursions import SPECS

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing compiles")
FRAMES = [name for name, spec in SPECS.items() if any(x.name == "row" for x in spec.present)]


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Nothing compiles: the list takes the calls whose code would be."""
    asked: list[str] = []

    def label(spec: Any) -> str:
        return " ".join([spec.name, *(x.name for x in spec.present if x.optional or x.name == "fext")])

    def entry_of_one(spec: Any) -> Any:
        return SimpleNamespace(compile_now=lambda: asked.append(f"{label(spec)} sample"))

    monkeypatch.setattr(numba_kernels, "batch_kernel", lambda spec: asked.append(f"{label(spec)} batch"))
    monkeypatch.setattr(entries, "sample_entry", entry_of_one)
    monkeypatch.setattr(run, "compile_program", lambda spec, model, static: asked.append(label(spec)) or True)
    return asked


def test_finding_a_call_makes_no_other() -> None:
    """The first ``specialize`` and ``simulate`` made all public functions, 0.1 s, to find one Spec."""
    code = """
import spatialdyn as sd
from spatialdyn.calls import dynamics
model, rnea = sd.load_urdf("two_link"), sd.rnea
sd.specialize(model, rnea)
made = list(dict.keys(dynamics.calls))
sd.simulate(model, [0.1, 0.2], [0, 0], 0.01, 1e-3)
print(made, len(dict.keys(dynamics.calls)) < 12)
"""
    assert run_python(code).strip() == "['rnea'] True"


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


def test_all_calls_are_compiled_those_of_a_frame_where_one_is_given(arm: sd.Model, compiled: list[str]) -> None:
    assert list(sd.compile(arm)) == [name for name in SPECS if name not in FRAMES]
    assert compiled[0] == next(iter(SPECS))
    assert len(compiled) == len(SPECS) - len(FRAMES)
    found = sd.compile(arm, frame=arm.frames[-1].name, reference="world", classical=True)
    assert list(found) == list(SPECS)


def test_chosen_calls_are_compiled_once_each(arm: sd.Model, compiled: list[str]) -> None:
    assert list(sd.compile(arm, [sd.rnea, "aba", "rnea"])) == ["rnea", "aba"]
    assert list(sd.compile(arm, sd.crba)) == ["crba"]
    assert list(sd.compile(arm, "crba")) == ["crba"]
    compiled.clear()
    sd.compile(arm, ["rnea", "crba"], fext=True)
    assert compiled == ["rnea fext", "crba"]


def test_without_a_program_the_table_kernel_is_compiled(
    arm: sd.Model, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "compile_program", lambda spec, model, static: False)
    sd.compile(arm, "crba")
    alone = ["crba sample"] if lane_names.fits(SPECS["crba"]) else []  # beside lanes it has its own kernel
    assert list(dict.fromkeys(compiled)) == ["crba batch", *alone]  # on AVX-512 lanes of two widths


@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        ({"calls": "rneaa"}, sd.SpatialDynError, "calls has 'rneaa', expected some of"),
        ({"calls": [sd.rnea, np.sin]}, sd.SpatialDynError, "calls has sin, expected some of"),
        ({"calls": "frame_jacobian"}, sd.SpatialDynError, "frame_jacobian has a frame, expected its name"),
        ({"calls": "frame_jacobian", "frame": "nowhere"}, sd.ModelError, "nowhere"),
        ({"calls": "frame_jacobian", "frame": "link2", "reference": "x"}, sd.SpatialDynError, "reference is 'x'"),
        ({"calls": 5}, sd.SpatialDynError, "calls is 5, expected public calls such as spatialdyn.rnea, or their names"),
        ({"calls": "rnea", "frame": "nope"}, sd.SpatialDynError, "frame is 'nope', expected None: no call takes one"),
        ({"calls": "rnea", "reference": "world"}, sd.SpatialDynError, "reference is 'world', expected the default"),
        ({"calls": "rnea", "classical": 2}, sd.SpatialDynError, "classical is 2, expected True or False"),
        ({"fext": 1}, sd.SpatialDynError, "fext is 1, expected True or False"),
        ({"progress": "x"}, sd.SpatialDynError, "progress is 'x', expected True, False or a function"),
        ({"model": 3}, sd.ModelError, "model is a int"),
    ],
)
def test_bad_requests_are_named_before_anything_compiles(
    arm: sd.Model, compiled: list[str], words: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        sd.compile(**{"model": arm, **words})
    assert compiled == []


def test_each_call_is_reported(arm: sd.Model, compiled: list[str]) -> None:
    seen: list[tuple[int, int]] = []
    sd.compile(arm, ["rnea", "aba"], progress=lambda done, total: seen.append((done, total)))
    assert seen == [(0, 2), (1, 2), (2, 2)]


@COMPILED
def test_what_is_compiled_ahead_is_not_compiled_again(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Here and in a process with the same cache folder; the numbers are the same."""
    monkeypatch.setenv(disk_cache.VARIABLE, str(tmp_path))
    empty_memory(monkeypatch)
    run.forget_programs()
    q = np.random.default_rng(0).standard_normal((600, 2))
    try:
        assert set(sd.compile(arm, "potential_energy")) == {"potential_energy"}
        assert list(tmp_path.glob("*" + disk_cache.PROGRAM))
        monkeypatch.setattr(host_cpu, "object_code", None)
        found = sd.potential_energy(arm, q)
        empty_memory(monkeypatch)
        run.forget_programs()
        np.testing.assert_array_equal(sd.potential_energy(arm, q), found)
    finally:
        run.forget_programs()


# --- progress -------------------------------------------------------------------------------------------


def test_steps_are_counted_to_their_total() -> None:
    seen: list[tuple[int, int]] = []
    steps = Steps(lambda done, total: seen.append((done, total)), 3)
    for count in (1, 1, 5):
        steps.next(count)
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("value", ["x", 1, None])
def test_what_is_no_progress_is_named(value: Any) -> None:
    with pytest.raises(sd.SpatialDynError, match="expected True, False or a function of two numbers"):
        check_progress(value)


def test_no_progress_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with reporting(False, "compile") as report:
        report(1, 2)
    assert capsys.readouterr() == ("", "")


def test_the_bar_is_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rich")
    with reporting(True, "compile") as report:
        report(1, 2)
    found = capsys.readouterr()
    assert found.out == ""
    assert found.err


@pytest.mark.parametrize("what", ["diagnose", "trade", "compare"])
def test_long_calls_report_up_to_their_total(arm: sd.Model, what: str) -> None:
    seen: list[tuple[int, int]] = []

    def report(done: int, total: int) -> None:
        seen.append((done, total))

    if what == "diagnose":
        sd.diagnose(arm, progress=report)
    elif what == "trade":
        pytest.importorskip("mpmath")
        sd.trade(arm, "mass_matrix", states=4, batch=2, progress=report)
    else:
        pytest.importorskip("pinocchio")
        sd.compare_with_pinocchio("two_link", samples=1, progress=report)
    total = seen[0][1]
    wanted = [(k, total) for k in range(total + 1)]
    if what == "diagnose" and numba_kernels.PLAIN:  # examines no programs
        wanted = [*wanted[:2], wanted[-1]]
    assert seen == wanted
    assert total >= 3


def test_a_report_that_stops_ends_a_long_call(arm: sd.Model) -> None:
    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sd.diagnose(arm, progress=stop)
