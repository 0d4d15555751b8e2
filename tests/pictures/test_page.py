"""Reports: one page, nothing fetched, nothing of a file's names run, and lines that compute it again."""

from __future__ import annotations

import io
import re
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_notebook import EVIL, Page, trajectory

import spatialdyn as sd
from spatialdyn.accuracy.findings import Finding
from spatialdyn.accuracy.results import Option, Tradeoff
from spatialdyn.commands import cli
from spatialdyn.errors import SpatialDynError
from spatialdyn.pictures import page as pages
from spatialdyn.pictures.figures import ENDINGS

pytest.importorskip("matplotlib")


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """Deprecations inside matplotlib are no errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        yield


@pytest.fixture
def no_viewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where viser is not installed."""
    monkeypatch.setitem(sys.modules, "viser", None)


@pytest.fixture(scope="module")
def evil() -> sd.Model:
    """A robot whose link and joint are called ``<script>``."""
    builder = sd.ModelBuilder(EVIL)
    rod = (1.0, (0.0, 0.0, 0.5), np.diag([0.1, 0.1, 0.01]))
    builder.add_body(
        EVIL, None, "revolute", (0, 1, 0), None, rod, joint_name=f"j{EVIL}", limits=sd.JointLimits(0.5, 1.0, effort=2.0)
    )
    return builder.build()


def written(result: Any) -> tuple[str, Page]:
    """The report of a result as text, and read."""
    file = io.StringIO()
    result.report(file)
    text = file.getvalue()
    return text, Page(text.partition("\n")[2])


def self_contained(page: Page) -> None:
    """Nothing in a page loads anything from elsewhere, or runs."""
    assert not {"script", "link", "object", "embed", "base"} & set(page.seen)
    for name, value in page.attributes:
        assert not name.startswith("on")
        if name in ("src", "href"):
            assert (value or "").startswith("data:")


@pytest.mark.usefixtures("no_viewer")
def test_a_run_is_one_page_with_all_its_parts(evil: sd.Model, tmp_path: Path) -> None:
    text, page = written(trajectory(evil))
    self_contained(page)
    headings = re.findall("<h2>(.*?)</h2>", text)
    assert headings == ["The run", "The robot", "The motion", "Plots", "Numbers", "Again"]
    assert page.seen.count("img") == 4
    for word in (EVIL, f"j{EVIL}", f"q j{EVIL}"):
        assert word in page.words
    for word in ("spatialdyn 0.1.0", "NumPy", "odd thing", "pip install viser pycollada"):
        assert word in page.text
    trajectory(evil).report(tmp_path / "run.html")
    assert (tmp_path / "run.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.usefixtures("no_viewer")
def test_the_lines_of_a_run_compute_it_again() -> None:
    model = sd.load_urdf("two_link").with_(gravity=(0.0, 0.0, -9.0))
    run = sd.simulate(model, [0.3, 0.1], [0.0, 1.0], 0.2, 0.01, "rk4", torque=[0.5, 0.0], record=2)
    code = pages.again_trajectory(run)
    found: dict[str, Any] = {}
    exec(code, found)
    again = found["run"]
    assert again.method == run.method
    for name in ("t", "q", "v", "tau", "energy"):
        assert np.array_equal(getattr(again, name), getattr(run, name)), name
    other = pages.again_trajectory(sd.simulate(sd.load_urdf("pendulum"), [0.3], [0.0], 0.1, 0.01))
    with pytest.raises(AssertionError):
        exec(other.replace("'pendulum')", "'pendulum', gravity=(0, 0, 1))"), {})


@pytest.mark.usefixtures("no_viewer")
def test_the_lines_of_a_run_have_its_scene() -> None:
    model = sd.load_urdf("two_link")
    contacts = sd.Contacts(model, {"tip": 0.02}, terrain=sd.Plane(height=-0.9))
    scene = sd.Scene(model, contacts=contacts, friction=sd.Friction(viscous=0.1))
    run = sd.simulate(scene, [0.3, 0.1], [0.0, 1.0], 0.2, 1e-3, record=(10, "contacts"))
    found: dict[str, Any] = {}
    exec(pages.again_trajectory(run), found)
    assert found["run"].scene == scene
    assert np.array_equal(found["run"].q, run.q)
    assert np.array_equal(found["run"].contacts.impulse, run.contacts.impulse)
    text, _ = written(run)
    assert 'alt="contacts"' in text


def test_a_robot_is_loaded_by_its_name_or_its_file(tmp_path: Path) -> None:
    assert "model = sd.load_urdf('pendulum')\n" in pages.again_trajectory(trajectory(sd.load_urdf("pendulum")))
    path = tmp_path / "own.urdf"
    path.write_text('<robot name="own"><link name="a"/></robot>')
    assert f"model = sd.load_urdf({str(path)!r})\n" in pages._load(sd.load_urdf(path), "own")
    text = sd.load_urdf('<robot name="own"><link name="a"/></robot>')
    assert "model = sd.load_urdf('own')  # by its name" in pages._load(text, "own")


def test_torques_that_change_are_said_to_be_missing() -> None:
    run = trajectory(sd.load_urdf("pendulum"))
    run.tau[3:] = 1.0
    assert "torque=torque" in pages.again_trajectory(run)
    assert "does not keep" in pages.again_trajectory(run)


def test_the_player_is_a_frame_of_its_own(evil: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "_plots", lambda run: [])
    closed: list[bool] = []
    scene = SimpleNamespace(
        html=lambda: f'<p title="{EVIL}">',
        close=lambda: closed.append(True),
        missing=[f"{EVIL}.stl"],
        faulty=[f"{EVIL}.dae: no such material"],
    )
    fake = ModuleType("spatialdyn.pictures.view")
    fake.view = lambda run: scene  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "viser", ModuleType("viser"))
    monkeypatch.setitem(sys.modules, "spatialdyn.pictures.view", fake)
    _, page = written(trajectory(evil))
    assert page.seen.count("iframe") == 1
    assert ("srcdoc", scene.html()) in page.attributes
    assert ("sandbox", "allow-scripts") in page.attributes
    assert "script" not in page.seen
    assert f"{EVIL}.stl" in page.words
    assert f"{EVIL}.dae: no such material" in page.words
    assert closed == [True]

    def fails(run: Any) -> Any:
        raise SpatialDynError(f"no {EVIL}")

    fake.view = fails  # type: ignore[attr-defined]
    _, page = written(trajectory(evil))
    assert f"There is no player: no {EVIL}" in page.words


def test_a_trade_is_a_page(evil: sd.Model) -> None:
    options = tuple(Option(f"{EVIL}{k}", f"sd.rnea({k})", 10.0**-k, 0.0, 1.0, 5.0 + k, best=True) for k in range(3))
    _, page = written(Tradeoff(EVIL, "inverse_dynamics", options, 4, 8, 0.0, 0.0, "truth", subject=evil))
    self_contained(page)
    assert page.seen.count("img") == 1
    assert f"{EVIL}2" in page.words
    assert "sd.trade(model, 'inverse_dynamics', batch=8)" in page.text
    assert evil.key in page.text


def test_a_diagnosis_is_a_page(evil: sd.Model) -> None:
    finding = Finding("warning", "mass ratio", EVIL, f"is {EVIL}", "remedy")
    _, page = written(sd.Diagnosis(EVIL, (finding,), {"neutral": 2.0}, {}, None, {}, 4, evil))
    self_contained(page)
    assert f"is {EVIL}" in page.words
    assert "sd.diagnose(model)" in page.text


def test_a_page_that_cannot_be_written_is_named(
    evil: sd.Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = trajectory(evil)
    monkeypatch.setattr(pages, "_plots", lambda run: [])
    with pytest.raises(SpatialDynError, match=r"report cannot be written to .*: No such file"):
        run.report(tmp_path / "nowhere" / "run.html")
    for path in (None, 5):
        with pytest.raises(SpatialDynError, match=f"path is {path}, expected the name of a file"):
            run.report(path)  # type: ignore[arg-type]


@pytest.mark.usefixtures("no_viewer")
def test_the_command_line_writes_reports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "run.html")
    words = ["--q0", "0.5,-0.3", "--duration", "0.1", "--dt", "0.01", "--report", path]
    assert cli.main(["simulate", "two_link", *words]) == 0
    assert f"written {path}" in capsys.readouterr().out
    self_contained(Page(Path(path).read_text(encoding="utf-8").partition("\n")[2]))
    found = sd.Diagnosis("two_link", (), {}, {}, None, {}, 4)
    monkeypatch.setattr("spatialdyn.commands.check.diagnose", lambda model, **options: found)
    assert cli.main(["check", "two_link", "--json", "--report", str(tmp_path / "check.html")]) == 0
    assert "diagnose" in (tmp_path / "check.html").read_text(encoding="utf-8")
    assert "written" not in capsys.readouterr().out


@pytest.mark.parametrize("command", ["simulate", "trade", "check"])
def test_a_report_that_cannot_be_written_is_refused_before_the_work(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(f"spatialdyn.commands.{command}.load", None)
    assert cli.main([command, "two_link", "--report", "run.pdf"]) == 2
    assert "--report is 'run.pdf', expected a name that ends in .html" in capsys.readouterr().err
    assert cli.main([command, "two_link", "--report", str(tmp_path / "nowhere" / "run.html")]) == 2
    assert "expected a name in a folder that is there" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["simulate", "trade"])
def test_an_animation_is_refused_before_the_work(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"spatialdyn.commands.{command}.load", None)
    assert cli.main([command, "two_link", "--plot", "x.gif"]) == 2
    wanted = f"--plot is 'x.gif', expected a name that ends in one of {', '.join(ENDINGS)}\n"
    assert capsys.readouterr().err.endswith(wanted)
