"""``spatialdyn derive``: output in each format, and exit status."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.commands import cli


def run(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str, str]:
    """Exit status, stdout and stderr."""
    status = cli.main(list(argv))
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_derive_prints_m_c_and_g(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "derive", "two_link")
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        "M[1, 1] = 2*cos(q_2) + 3",
        "M[1, 2] = cos(q_2) + 1",
        "M[2, 1] = cos(q_2) + 1",
        "M[2, 2] = 1",
        "",
        "C[1, 1] = -v_2*sin(q_2)",
        "C[1, 2] = (-v_1 - v_2)*sin(q_2)",
        "C[2, 1] = v_1*sin(q_2)",
        "",
        "g[1] = 981*cos(q_1)/50 + 981*cos(q_1 + q_2)/100",
        "g[2] = 981*cos(q_1 + q_2)/100",
        "",
    ]


def test_derive_says_what_symbols_stand_for(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "derive", "two_link", "--symbols", "--quantity", "V")[1]
    assert 'm_1 = 1: mass [kg] of what moves with joint "joint1"' in out
    assert "g = 981/100: gravity [m/s²]" in out
    assert "V = c_2x*g*m_2*sin(q_1 + q_2) + g*(c_1x*m_1 + l_2x*m_2)*sin(q_1)" in out


def test_derive_prints_code_that_runs(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "derive", "three_link", "--format", "python", "--quantity", "M, g")
    assert status == 0
    scope: dict[str, Any] = {}
    exec(out, scope)
    q, model = np.array([0.1, 0.5, -0.4]), sd.load_urdf("three_link")
    np.testing.assert_allclose(scope["M"](q), sd.crba(model, q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(scope["g"](q), sd.generalized_gravity(model, q), rtol=0, atol=1e-13)


def test_derive_prints_latex_and_c(capsys: pytest.CaptureFixture[str]) -> None:
    assert r"M = \left[\begin{matrix}" in run(capsys, "derive", "two_link", "--format", "latex")[1]
    out = run(capsys, "derive", "two_link", "--format", "c", "--quantity", "C")[1]
    assert "void C(const double *q, const double *v, double *out)" in out


def test_derive_names_a_bad_quantity_and_robot(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "derive", "two_link", "--quantity", "M,X")
    assert (status, out) == (2, "")
    assert 'quantity is "X", expected one of M, C, g' in err
    assert run(capsys, "derive", "no_such_robot")[0] == 2


def test_derive_prints_programs_of_robots_beyond_closed_forms(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "derive", "tree", "--format", "python", "--program", "--quantity", "C,g")
    assert (status, err) == (0, "")
    scope: dict[str, Any] = {}
    exec(out, scope)
    model = sd.load_urdf("tree")
    rng = np.random.default_rng(0)
    q, v = sd.random_configuration(model, rng, 3), rng.normal(size=(3, model.nv))
    np.testing.assert_allclose(scope["C"](q, v), sd.coriolis_matrix(model, q, v), rtol=0, atol=1e-13)
    np.testing.assert_allclose(scope["g"](q), sd.generalized_gravity(model, q), rtol=0, atol=1e-13)
    status, out, err = run(capsys, "derive", "tree", "--program")
    assert (status, out) == (2, "")
    assert "expected --format c or python" in err
    assert 'quantity is "L"' in run(capsys, "derive", "tree", "--format", "c", "--program", "--quantity", "L")[2]


def test_derive_keeps_names_of_a_file_in_their_comment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (Path(sd.__file__).parent.parent / "urdf" / "two_link.urdf").read_text()
    path = tmp_path / "robot.urdf"
    path.write_text(text.replace('"joint1"', '"a&#10;import os &#8232; \\"'))
    status, out, _ = run(capsys, "derive", str(path), "--symbols", "--format", "python", "--quantity", "M")
    assert status == 2 or "import os" not in [line[:9] for line in out.splitlines()]
    assert status == 2 or not any(line.endswith("\\") for line in out.split("\n"))


def test_derive_refuses_before_it_computes(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """What is expected to take too many products; without a limit, or with a higher one, it computes."""

    def fail(*arguments: Any) -> Any:
        raise AssertionError("computed")

    with monkeypatch.context() as patch:
        patch.setattr("spatialdyn.commands.derive.SymbolicManipulator", fail)
        status, out, err = run(capsys, "derive", "two_link", "--limit", "100")
        assert (status, out) == (2, "")
        assert err.startswith('spatialdyn: M of model "two_link" has some 10 terms in closed form, which take some 120')
        assert "--limit 0" in err
        assert run(capsys, "derive", "two_link", "--quantity", "g,M", "--limit", "100")[0] == 2
    assert run(capsys, "derive", "two_link", "--quantity", "g", "--limit", "100")[0] == 0
    assert run(capsys, "derive", "two_link", "--limit", "0")[0] == 0
    assert run(capsys, "derive", "two_link", "--limit", "-1")[0] == 2
