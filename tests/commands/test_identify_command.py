"""``spatialdyn excite`` and ``spatialdyn identify``: from a path to a log, a page and a URDF."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plain import compiled

import spatialdyn as sd
from spatialdyn.commands.cli import main


@compiled
def test_a_path_a_log_a_page_and_a_urdf(tmp_path: Path, capsys: Any) -> None:
    pytest.importorskip("matplotlib")
    where = {name: str(tmp_path / name) for name in ("path.csv", "log.csv", "page.html", "model.urdf")}
    assert main(["excite", "two_link", "--duration", "4", "--harmonics", "3", "--save", where["path.csv"]]) == 0
    table = np.genfromtxt(where["path.csv"], delimiter=",", names=True)
    q, v, a = (np.stack([table[f"{x}0"], table[f"{x}1"]], 1) for x in "qva")
    tau = sd.rnea(sd.load_urdf("two_link"), q, v, a) + 0.2 * v + 0.1 * np.sign(v)
    tau += 0.01 * np.random.default_rng(0).normal(size=tau.shape)
    sd.Recording(table["t"], q, tau, v, a).save(where["log.csv"])
    words = ["identify", "two_link", where["log.csv"]]
    assert main([*words, "--report", where["page.html"], "--save", where["model.urdf"], "--validate", words[2]]) == 0
    out = capsys.readouterr().out
    assert "joint2.Iyy" in out
    assert "name + n is a sum of n + 1 parameters" in out
    assert "times the noise" in out
    assert "<h2>Parameters</h2>" in Path(where["page.html"]).read_text(encoding="utf-8")
    np.testing.assert_allclose(sd.load_urdf(where["model.urdf"]).damping, 0.2, atol=0.01)
    geared, page = str(tmp_path / "geared.urdf"), tmp_path / "geared.html"
    sd.Recording(table["t"], q, tau + [0.0, 0.3] * a, v, a).save(tmp_path / "geared.csv")
    parameters = ["--parameters", "inertial+friction+armature", "--report", str(page), "--save", geared]
    assert main(["identify", "two_link", str(tmp_path / "geared.csv"), *parameters]) == 2  # URDF has no armature
    assert "has armature" in capsys.readouterr().err
    assert page.exists()
    lines = Path(where["log.csv"]).read_text(encoding="utf-8").splitlines(keepends=True)
    gap = tmp_path / "gap.csv"
    gap.write_text("".join(lines[:50] + lines[60:]), encoding="utf-8")
    judge = [*words, "--json", "--method", "wls", "--validate", str(gap)]
    assert main(judge) == 2
    assert "resample=True" in capsys.readouterr().err
    assert main([*judge, "--resample"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["consistent"] is False
    assert len(found["validation"]["ratio"]) == 2
    assert any("t has a gap" in x for x in found["validation"]["notes"])
    assert main([*words, "--rows", "base", "--prior", "0.5"]) == 2
    assert "no floating base" in capsys.readouterr().err
    assert main([*words, "--delay", "soon"]) == 2
    assert "delay is 'soon'" in capsys.readouterr().err
    assert main([*words, "--save", str(tmp_path / "model.txt")]) == 2
    assert "expected a name that ends in .urdf" in capsys.readouterr().err
    assert main(["excite", "two_link", "--payload", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err
    assert main(["excite", "two_link", "--rate", "0.9"]) == 2
    assert "--rate is 0.9, expected 1 or more, twice the highest harmonic" in capsys.readouterr().err
    assert main(["excite", "two_link", "--save", str(tmp_path / "path.txt")]) == 2
    assert "expected a name that ends in .csv" in capsys.readouterr().err


def test_joints_that_mimic_others_follow_them(tmp_path: Path) -> None:
    text = sd.to_urdf(sd.load_urdf("two_link"))
    coupled = text.replace('<child link="link2"/>', '<child link="link2"/><mimic joint="joint1" multiplier="-0.5"/>')
    assert coupled != text
    robot, path, log = (str(tmp_path / name) for name in ("robot.urdf", "path.csv", "log.csv"))
    Path(robot).write_text(coupled, encoding="utf-8")
    assert main(["excite", robot, "--duration", "4", "--harmonics", "3", "--save", path]) == 0
    table = np.genfromtxt(path, delimiter=",", names=True)
    assert table.dtype.names == ("t", "q0", "v0", "a0")
    q, v, a = (table[name][:, None] for name in ("q0", "v0", "a0"))
    tau = sd.rnea(sd.load_urdf(robot, mimic=True), q, v, a)
    sd.Recording(table["t"], q, tau + 0.01 * np.random.default_rng(0).normal(size=tau.shape), v, a).save(log)
    assert main(["identify", robot, log, "--save", str(tmp_path / "model.urdf")]) == 0
    assert sd.load_urdf(str(tmp_path / "model.urdf"), mimic=True).nq == 1
