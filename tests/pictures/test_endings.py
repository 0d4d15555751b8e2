"""Every call that writes a file: an ending that says something else than what is written is refused first."""

from __future__ import annotations

import inspect
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import valid_calls

import spatialdyn as sd
from spatialdyn.accuracy.results import Option, Tradeoff, mark_pareto
from spatialdyn.calls.files import check_ending
from spatialdyn.errors import SpatialDynError
from spatialdyn.pictures.figures import ENDINGS
from spatialdyn.pictures.markup import PAGE_FILES
from spatialdyn.pictures.viewer import View
from spatialdyn.sources.run_files import ARRAY_FILES

pytest.importorskip("matplotlib")
pytest.importorskip("viser")


def run() -> sd.Trajectory:
    t, x = np.linspace(0.0, 0.1, 3), np.zeros((3, 2))
    return sd.Trajectory(t, x, x, x, x, t, "rk4", 0.05, "two_link", model=sd.load_urdf("two_link"))


def traded() -> Tradeoff:
    return Tradeoff("arm", "crba", mark_pareto([Option("a", "", 1e-9, 0.0, 1.0, 7.0)]), 4, 64, 0.0, 0.0, "truth")


def rolled() -> sd.Rollout:
    x = np.zeros((2, 3, 2))
    return sd.Rollout(x, x, np.linspace(0.1, 0.3, 3), sd.load_urdf("two_link"))


def account() -> sd.EnergyLedger:
    t = np.linspace(0.0, 1.0, 3)
    return sd.EnergyLedger(t, t, {"torque": t[:, None]}, {"torque": ("a",)}, t, "arm", "rk4")


def save_scene(path: Any) -> None:
    scene = sd.view(sd.load_urdf("two_link"), open=False)
    try:
        scene.save(path)
    finally:
        scene.close()


WRITERS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "Trajectory.save": (lambda path: run().save(path), ARRAY_FILES),
    "Trajectory.plot": (lambda path: run().plot(path=path), ENDINGS),
    "Trajectory.report": (lambda path: run().report(path), PAGE_FILES),
    "Rollout.plot": (lambda path: rolled().plot(path=path), ENDINGS),
    "EnergyLedger.plot": (lambda path: account().plot(path=path), ENDINGS),
    "Tradeoff.plot": (lambda path: traded().plot(path), ENDINGS),
    "Tradeoff.report": (lambda path: traded().report(path), PAGE_FILES),
    "Diagnosis.report": (lambda path: sd.Diagnosis("arm", (), {}, {}, None, {}, 4).report(path), PAGE_FILES),
    "Identified.report": (lambda path: valid_calls.identified().report(path), PAGE_FILES),
    "Recording.save": (lambda path: valid_calls.log().save(path), (".csv",)),
    "Requirement.plot": (lambda path: valid_calls.requirement().plot(path=path), ENDINGS),
    "Path.plot": (lambda path: sd.quintic([0.0], [1.0], 1.0).plot(path), ENDINGS),
    "PassivityRecord.plot": (lambda path: sd.passivity(valid_calls.run()).plot(path), ENDINGS),
    "LyapunovRecord.plot": (lambda path: sd.lyapunov(valid_calls.run(), valid_calls.run().energy).plot(path), ENDINGS),
    "View.save": (save_scene, PAGE_FILES),
    "plot": (lambda path: sd.plot([run()], path=path), ENDINGS),
}
READERS = {"Recording.load", "Trajectory.load"}
LARGE = {
    "Trajectory.save",
    "Trajectory.report",
    "Path.plot",
}  # that write a name in large letters too, one of each kind


def test_the_table_has_every_call_that_takes_a_path() -> None:
    public = {name: getattr(sd, name) for name in sd.__all__} | {"View": View}
    found = set()
    for name, thing in public.items():
        of = {name: thing}
        if inspect.isclass(thing):
            of = {f"{thing.__name__}.{part}": x for part, x in inspect.getmembers(thing) if part[0] != "_"}
        for what, x in of.items():
            if (inspect.isfunction(x) or inspect.ismethod(x)) and "path" in inspect.signature(x).parameters:
                found.add(what)
    assert found - READERS == set(WRITERS)


@pytest.mark.parametrize("name", ["x.txt", "x", "x.npz.bak", ".html", "x.gif", "x.json", Path("x.doc")])
@pytest.mark.parametrize("what", WRITERS)
def test_an_unknown_ending_is_refused_with_those_known(
    what: str, name: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write, known = WRITERS[what]
    with pytest.raises(SpatialDynError) as caught:
        write(name)
    message = str(caught.value)
    assert message.startswith(f"path is {str(name)!r}, expected a name that ends in ")
    assert all(ending in message for ending in (known if len(known) > 2 else known[:1]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("what", WRITERS)
def test_an_ending_that_is_known_is_written(what: str, tmp_path: Path) -> None:
    write, known = WRITERS[what]
    for ending in {known[0], *([known[0].upper()] if what in LARGE else [])}:
        path = tmp_path / f"x{ending}"
        write(path)
        start = path.read_bytes()[:15].lower()
        assert start.startswith({".npz": b"pk", ".html": b"<!doctype html", ".csv": b"t,q"}.get(known[0], b"\x89png"))


def test_an_open_file_has_no_ending() -> None:
    file = io.BytesIO()
    run().save(file)
    file.seek(0)
    assert np.load(file)["q"].shape == (3, 2)
    picture = io.BytesIO()
    run().plot("q", path=picture)
    assert picture.getvalue()[:4] == b"\x89PNG"
    page = io.StringIO()
    traded().report(page)
    assert page.getvalue().startswith("<!DOCTYPE html")


@pytest.mark.parametrize("path", [5, None, b"x.npz", ["x.npz"]])
def test_what_is_no_path_is_refused(path: Any) -> None:
    with pytest.raises(SpatialDynError, match=r"file is .*, expected the name of a file"):
        check_ending("file", path, ARRAY_FILES)
