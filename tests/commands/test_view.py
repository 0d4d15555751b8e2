"""``spatialdyn view`` and ``spatialdyn simulate --view``: pages, the browser, Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from inputs import PACKAGE

import spatialdyn as sd
from spatialdyn.commands import cli
from spatialdyn.commands import view as command
from spatialdyn.pictures.viewer import View

pytest.importorskip("viser")
LOST = (
    '<robot name="r"><link name="a"><visual><geometry><mesh filename="package://gone/a.stl"/></geometry></visual>'
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
)
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


def run(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str, str]:
    """Exit status, stdout and stderr."""
    status = cli.main(list(argv))
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_view_saves_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "two.html"
    assert run(capsys, "view", "two_link", "--q", "-0.5,0.3", "--save", str(path)) == (0, f"saved   {path}\n", "")
    assert "__VISER_EMBED_DATA__" in path.read_text(encoding="utf-8")


def test_view_names_missing_meshes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "lost.urdf"
    path.write_text(LOST)
    status, out, err = run(capsys, "view", str(path), "--save", str(tmp_path / "x.html"))
    assert (status, err) == (0, "")
    assert out.startswith('note    robot "r": 1 mesh is missing')
    assert "package://gone/a.stl is not found" in out


@pytest.mark.parametrize(
    ("more", "match"),
    [
        (["--q", "1"], "--q has 1 numbers, expected 2"),
        (["--q", "1,a"], "--q is '1,a', expected numbers separated by commas"),
        (["--save", "x.png"], "--save is 'x.png', expected a name that ends in .html"),
        (["--save", "no/where/x.html"], "expected a name in a folder that is there"),
    ],
)
def test_view_refuses_bad_options_in_one_line(more: list[str], match: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "view", "two_link", *more)
    assert (status, out) == (2, "")
    assert match in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "argv", [["view", "two_link", "--save", "x.html"], ["simulate", "two_link", "--save", "x.html"]]
)
def test_without_viser_one_line_says_what_to_install(
    argv: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "viser", None)
    status, out, err = run(capsys, *argv)
    assert (status, out) == (2, "")
    assert err == "spatialdyn: viser is not installed; pip install viser pycollada\n"


def test_view_opens_a_tab_where_there_is_a_screen_and_closes_its_server(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: seen.append(url))
    monkeypatch.setattr(command, "has_screen", lambda: True)
    monkeypatch.setattr(View, "wait", lambda self: seen.append("waits"))
    monkeypatch.setattr(View, "close", lambda self, close=View.close: (seen.append("closes"), close(self)))
    status, out, err = run(capsys, "view", "two_link")
    assert (status, err) == (0, "")
    assert out == f"shown   {seen[0]} (Ctrl-C ends it)\n"
    assert seen[1:] == ["waits", "closes"]


def test_simulate_saves_and_shows_its_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    t = np.linspace(0.0, 0.1, 3)
    q = np.zeros((3, 2))
    made = sd.Trajectory(t, q, q, q, q, t, "rk4", 0.05, "two_link", model=sd.load_urdf("two_link"))
    monkeypatch.setattr("spatialdyn.commands.simulate.simulate", lambda *arguments, **named: made)
    kept: list[View] = []
    monkeypatch.setattr("spatialdyn.commands.simulate.keep_open", kept.append)
    path = tmp_path / "run.html"
    status, out, err = run(capsys, "simulate", "two_link", "--save", str(path), "--view")
    assert (status, err) == (0, "")
    assert f"saved   {path}" in out
    assert "__VISER_EMBED_DATA__" in path.read_text(encoding="utf-8")
    assert kept[0].motion is not None
    assert kept[0].motion.t.tolist() == t.tolist()
    kept[0].close()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other signals")
def test_ctrl_c_in_view_ends_with_one_line_and_status_130() -> None:
    quiet = {name: value for name, value in os.environ.items() if name not in SCREENS}
    with subprocess.Popen(
        [sys.executable, "-m", "spatialdyn", "view", "two_link"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=quiet, cwd=PACKAGE.parent,
    ) as running:  # fmt: skip
        assert running.stdout is not None
        line = running.stdout.readline()
        running.send_signal(signal.SIGINT)
        out, err = running.communicate()
    assert line.startswith("shown   http://localhost:")
    said = [x for x in err.splitlines() if not x.endswith("takes more than 3 s")]  # on a machine with other work
    assert (running.returncode, out, said) == (130, "", ["spatialdyn: interrupted"])
