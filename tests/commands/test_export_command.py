"""``spatialdyn export``: C of calls and laws from a shell."""

from __future__ import annotations

from pathlib import Path

import pytest

import spatialdyn as sd
from spatialdyn.commands import cli
from spatialdyn.engines.compiled import numba_kernels

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")


def test_calls_and_laws_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--calls", "rnea,frame_jacobian,pd", "--frame", "tip", "--to", str(tmp_path), "--name", "arm", "--float"]
    assert cli.main(["export", "two_link", *words, "--quiet"]) == 0
    said = capsys.readouterr().out.split()
    assert said[0] == "src/arm.h"
    assert all((tmp_path / x).is_file() for x in said)
    header = (tmp_path / "src" / "arm.h").read_text()
    for name in ("arm_rnea", "arm_frame_jacobian", "arm_pd"):
        assert f"int {name}(const float q[2]" in header


def test_a_step_has_what_acts_in_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = sd.Scene(sd.load_urdf("two_link"), friction=sd.Friction(0.5, 0.1))
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    words = ["--calls", "step", "--scene", str(tmp_path / "scene.toml"), "--to", str(tmp_path / "made"), "--quiet"]
    assert cli.main(["export", "two_link", *words]) == 0
    assert "robot_step(" in (tmp_path / "made" / "src" / "robot.h").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--calls", "fly"], 'calls have "fly", expected calls such as rnea'),
        (["--calls", "rnea,rnea"], "expected each call once"),
        (["--calls", "rnea", "--name", "for"], "name is 'for', expected a name"),
        (["--calls", "frame_jacobian"], "frame is None"),
    ],
)
def test_what_cannot_be_exported_is_said(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["export", "two_link", *words, "--to", str(tmp_path), "--quiet"]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
