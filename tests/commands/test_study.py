"""``spatialdyn study``: a file's study here, resumed, and on a Dask scheduler."""

from __future__ import annotations

from pathlib import Path

import pytest

from spatialdyn.commands import cli

FILE = """
import spatialdyn as sd

def weights(model, rng, n):
    q = sd.random_configuration(model, rng, n)
    if BAD:
        raise RuntimeError("bad luck")
    return {"tau": sd.generalized_gravity(model, q), "most": q[:, 0]}

BAD = False

def study(folder):
    wanted = {"torque": sd.Moments("tau"), "top": sd.Worst("most", 2), "part": sd.Quantiles("most", [0.5])}
    return sd.study(weights, sd.load_urdf("two_link"), 1000, 300, 7, folder, reduce=wanted)
"""


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit status, stdout and stderr."""
    status = cli.main(["study", *words])
    return status, *capsys.readouterr()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file that makes a study."""
    made = tmp_path / "weights.py"
    made.write_text(FILE)
    return made


def test_a_study_runs_and_is_taken_up(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = str(file), "--folder", str(tmp_path / "here"), "--quiet"
    status, out, _ = run(capsys, *words)
    assert status == 0
    assert "4 of 4 chunks done>: 4 now" in out
    assert "torque.samples 1000" in " ".join(out.split())
    for label in ("torque.mean", "torque.greatest", "top.value", "top.sample", "part", "digest"):
        assert label in out
    again = run(capsys, *words)[1]
    assert "0 now" in again
    assert again.splitlines()[-1] == out.splitlines()[-1]


def test_what_cannot_run_is_said(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "other.py").write_text("def study(folder):\n    return 5\n")
    for words, message in (
        ((str(file),), "takes a folder, expected --folder"),
        ((str(tmp_path / "none.py"),), "there is no file"),
        ((str(tmp_path / "other.py"), "--folder", "f"), "makes int, expected study(folder)"),
    ):
        status, _, said = run(capsys, *words)
        assert status == 2
        assert message in said
    file.write_text(FILE.replace("BAD = False", "BAD = True"))
    status, _, said = run(capsys, str(file), "--folder", str(tmp_path / "bad"), "--quiet")
    assert status == 1
    assert "chunk 0, seed (7, spawn_key=(0,)): RuntimeError: bad luck" in said
    assert "4 chunks failed" in said


@pytest.mark.slow(quick="test_a_study_runs_and_is_taken_up")
def test_a_scheduler_gives_the_same_digest(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed")
    here = run(capsys, str(file), "--folder", str(tmp_path / "here"), "--quiet")[1]
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        words = "--scheduler", cluster.scheduler_address, "--threads", "1"
        status, there, _ = run(capsys, str(file), "--folder", str(tmp_path / "there"), "--quiet", *words)
    assert status == 0
    assert there.splitlines()[-1] == here.splitlines()[-1]
