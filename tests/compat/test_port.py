"""``spatialdyn port``: the names that a script uses, however it imports them, and their status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from spatialdyn.commands import cli
from spatialdyn.compat.pinocchio.coverage.coverage import DIFFERENT, OUT_OF_SCOPE, SUPPORTED, UNKNOWN
from spatialdyn.compat.pinocchio.coverage.porting import Use, uses

GOOD = """
import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf("arm.urdf")
data = model.createData()
q = pin.neutral(model)
tau = pin.rnea(model, data, q, np.zeros(model.nv), np.zeros(model.nv))
print(tau, data.tau, data.oMi[1])
"""


def found(source: str) -> dict[str, Use]:
    return {use.name: use for use in uses(source)}


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("import pinocchio\npinocchio.rnea", "rnea"),
        ("import pinocchio as se3\nse3.rnea", "rnea"),
        ("from pinocchio import rnea as inverse\ninverse(1)", "rnea"),
        ("from pinocchio import *\nrnea(1)", "rnea"),
        ("import pinocchio.rpy as r\nr.rpyToMatrix", "rpy.rpyToMatrix"),
        ("from pinocchio.robot_wrapper import RobotWrapper", "RobotWrapper"),
        ("from pinocchio import rpy\nrpy.rpyToMatrix(1)", "rpy.rpyToMatrix"),
        ("import pinocchio\npinocchio.SE3.Identity().act", "SE3.Identity"),
        ("import pinocchio as pin\npin.robot_wrapper.RobotWrapper.BuildFromURDF", "RobotWrapper.BuildFromURDF"),
        ("import pinocchio\npin = pinocchio\npin.rnea", "rnea"),
        ("import pinocchio\npin: object = pinocchio\npin.rnea", "rnea"),
        ("import pinocchio\nself.pin = pinocchio\nself.pin.SE3.Random", "SE3.Random"),
        ("import pinocchio\nmove = pinocchio.SE3\nmove.Random", "SE3.Random"),
        ("try:\n    import pinocchio as pin\nexcept ImportError:\n    pin = None\npin.rnea", "rnea"),
        ("import pinocchio as pin\nm, c, v = pin.buildModelsFromUrdf('a')\nm.nq", "Model.nq"),
        ("def f():\n    import pinocchio as pin\n    return pin.rnea", "rnea"),
    ],
)
def test_names_are_found_in_every_form_of_import(source: str, name: str) -> None:
    assert found(source)[name].status == SUPPORTED


def test_lines_are_named_and_each_name_stands_once() -> None:
    used = found("import pinocchio as pin\npin.rnea\npin.aba\npin.rnea(pin.rnea)")
    assert used["rnea"].lines == (2, 4)
    assert set(used) == {"rnea", "aba"}


def test_missing_names_come_first_and_say_why() -> None:
    used = uses("import pinocchio as pin\npin.rnea\npin.computeCollisions\npin.frobnicate")
    assert [use.name for use in used] == ["computeCollisions", "frobnicate", "rnea"]
    assert [use.status for use in used] == [OUT_OF_SCOPE, UNKNOWN, SUPPORTED]
    assert "coal" in used[0].note


def test_members_of_models_and_datas_are_found_where_their_making_is_plain() -> None:
    used = found(GOOD + "data.nonsense\nself = 1\nmodel.nq\nM = pin.SE3.Random()\nM.actInv(M)\nM.blah\n")
    assert used["Data.tau"].status == used["Model.nv"].status == used["SE3.actInv"].status == SUPPORTED
    assert used["Data.nonsense"].note == "a Data has no nonsense"
    assert used["SE3.blah"].status == OUT_OF_SCOPE


def test_members_of_attributes_are_found_too() -> None:
    source = """
import pinocchio as pin
class Arm:
    def __init__(self):
        self.robot = pin.RobotWrapper.BuildFromURDF("a.urdf")
    def f(self):
        return self.robot.model.nq, self.robot.data.wrong
"""
    used = found(source)
    assert used["Model.nq"].status == SUPPORTED
    assert used["Data.wrong"].status == OUT_OF_SCOPE


def test_a_name_given_anew_is_forgotten() -> None:
    assert "Data.wrong" not in found("import pinocchio as pin\nd = pin.Data()\nd = 3\nd.wrong")


def test_an_alias_given_anew_is_forgotten() -> None:
    assert "rnea" not in found("import pinocchio\npin = pinocchio\npin = other\npin.rnea")


@pytest.mark.parametrize(
    "source",
    [
        'robot = pin.RobotWrapper.BuildFromURDF("a.urdf")',
        'robot = pin.robot_wrapper.RobotWrapper.BuildFromURDF("a.urdf")',
        "robot = pin.robot_wrapper.RobotWrapper(model)",
    ],
)
def test_viewing_a_robot_is_listed_with_what_it_does(source: str) -> None:
    used = found(f"import pinocchio as pin\n{source}\nrobot.initViewer()\nrobot.nq")
    assert used["RobotWrapper.initViewer"].status == DIFFERENT
    assert "nothing, and one warning" in used["RobotWrapper.initViewer"].note
    assert used["RobotWrapper.nq"].status == SUPPORTED


def test_others_names_are_left_alone() -> None:
    assert uses("import numpy as pin\npin.rnea\nfrom .pinocchio import aba\naba()\nfrom pinocchio_extra import x") == []


def test_what_is_no_python_names_its_line() -> None:
    with pytest.raises(ValueError, match="line 2: "):
        uses("x = 1\nif:\n")
    with pytest.raises(ValueError, match="Python"):
        uses("x = '\0'")


def test_differences_of_members_are_reported() -> None:
    (use,) = [x for x in uses("import pinocchio as pin\nm = pin.Model()\nm.saveToText('x')") if "save" in x.name]
    assert use.status == DIFFERENT
    assert "files of this package" in use.note


# --- the command ----------------------------------------------------------------------------------------


def test_a_script_that_ports_has_status_0_and_the_line_to_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "good.py"
    script.write_text(GOOD)
    assert cli.main(["port", str(script)]) == 0
    out = capsys.readouterr().out
    assert "import spatialdyn.compat.pinocchio as pin" in out
    assert "rnea" in out


def test_a_script_that_does_not_has_status_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "bad.py"
    script.write_text(GOOD + "pin.computeCollisions(model)\n")
    assert cli.main(["port", str(script)]) == 1
    out = capsys.readouterr().out
    assert "1 missing" in out
    assert "change one line" not in out


def test_json_holds_every_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "good.py"
    script.write_text(GOOD)
    assert cli.main(["port", "--json", str(script)]) == 0
    (listed,) = json.loads(capsys.readouterr().out).values()
    assert {"name": "rnea", "lines": [8], "status": SUPPORTED, "note": "", "raises": ""} in listed


def test_files_that_cannot_be_read_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, content in (("none.py", None), ("bytes.py", b"\xff\xfe\x00"), ("broken.py", b"if:")):
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        assert cli.main(["port", str(path)]) == 2
        assert name in capsys.readouterr().err
    plain = tmp_path / "plain.py"
    plain.write_text("print(1)")
    assert cli.main(["port", str(plain)]) == 0
    assert "uses nothing of Pinocchio" in capsys.readouterr().out
