"""``spatialdyn port``: the names that a script uses, however it imports them, and their status."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

import spatialdyn.compat.pinocchio as face
from spatialdyn.commands import cli
from spatialdyn.compat.pinocchio import visualize
from spatialdyn.compat.pinocchio.coverage import stops as stopping
from spatialdyn.compat.pinocchio.coverage.coverage import DIFFERENT, OUT_OF_SCOPE, RAISES, SUPPORTED, UNKNOWN
from spatialdyn.compat.pinocchio.coverage.porting import Change, Use, changes, uses
from spatialdyn.compat.pinocchio.coverage.stops import FOREIGN, GEOMETRY, LIBRARY, NAME, OLD, VIEWER, stops

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
    used = uses("import pinocchio as pin\npin.rnea\npin.computeBodyRadius\npin.frobnicate")
    assert [use.name for use in used] == ["computeBodyRadius", "frobnicate", "rnea"]
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


def test_names_that_raise_on_usual_arguments_say_when() -> None:
    used = found("""import pinocchio as pin
from pinocchio.visualize import MeshcatVisualizer
viz = MeshcatVisualizer()
viz.viewer["box"]
viz.create_video_ctx("film")
pin.utils.mprint(1)
pin.forwardDynamics()
pin.Model().loadFromText("a.txt")
pin.rnea
""")
    assert used["visualize.MeshcatVisualizer.viewer"].works
    assert used["forwardDynamics"].raises.startswith("where constraints depend on each other")
    assert "files that Pinocchio wrote" in used["Model.loadFromText"].raises
    assert used["rnea"].raises == ""
    for name in ("utils.mprint", "visualize.MeshcatVisualizer.create_video_ctx"):
        assert used[name].status == OUT_OF_SCOPE
        assert used[name].note.startswith("always raises: ")


ALWAYS = {  # a call of each name that always raises
    "utils.mprint": lambda: face.utils.mprint(1),
    "Symmetric3.decomposeltI": lambda: face.Symmetric3.Identity().decomposeltI(),
    "RobotWrapper.BuildFromSDF": lambda: face.RobotWrapper.BuildFromSDF("a.sdf", []),
    "RobotWrapper.initFromSDF": lambda: face.RobotWrapper().initFromSDF("a.sdf", []),
    "*Visualizer.create_video_ctx": lambda: visualize.MeshcatVisualizer().create_video_ctx("film").__enter__(),
}


def test_names_that_always_raise_do() -> None:
    assert {name for names, when in RAISES if when.startswith("always") for name in names.split()} == set(ALWAYS)
    for call in ALWAYS.values():
        with pytest.raises(NotImplementedError):
            call()


def test_a_difference_is_noted_at_its_subject_and_once() -> None:
    used = found("import pinocchio as pin\npin.LOCAL\npin.forwardKinematics\npin.log6")
    assert used["LOCAL"].note == used["forwardKinematics"].note == ""
    assert used["log6"].note.count("near the identity") == 1


@pytest.mark.parametrize(
    ("line", "after"),
    [
        ("import pinocchio as pin", "import spatialdyn.compat.pinocchio as pin"),
        ("import pinocchio", "import spatialdyn.compat.pinocchio as pinocchio"),
        ("import sys, pinocchio as se3", "import sys, spatialdyn.compat.pinocchio as se3"),
        ("import pinocchio.visualize", "import spatialdyn.compat.pinocchio as pinocchio"),
        ("import pinocchio.rpy as rpy", "import spatialdyn.compat.pinocchio.rpy as rpy"),
        ("from pinocchio import SE3, rnea as id", "from spatialdyn.compat.pinocchio import SE3, rnea as id"),
        ("from pinocchio.utils import *", "from spatialdyn.compat.pinocchio.utils import *"),
    ],
)
def test_the_line_to_change_imports_the_same_names(line: str, after: str) -> None:
    assert changes(f"x = 1\n{line}\n") == [Change(2, line, after)]
    exec(after.replace("as id", "as inverse"), {})


def test_other_imports_stay() -> None:
    assert changes("import numpy, pinocchio_extra\nfrom . import pinocchio\nfrom .pinocchio import aba\n") == []


# --- the command ----------------------------------------------------------------------------------------


def test_a_script_that_ports_has_status_0_and_the_line_to_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "good.py"
    script.write_text(GOOD)
    assert cli.main(["port", str(script)]) == 0
    out = capsys.readouterr().out
    assert "change line 3: import pinocchio as pin  ->  import spatialdyn.compat.pinocchio as pin" in out
    assert "7 of 7 names work (100 %)" in out
    assert "rnea" in out


def test_a_script_that_does_not_has_status_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "bad.py"
    script.write_text(GOOD + "pin.computeBodyRadius(model)\n")
    assert cli.main(["port", str(script)]) == 1
    out = capsys.readouterr().out
    assert "1 missing" in out
    assert "7 of 8 names work (87 %), 1 missing" in out


def test_a_folder_has_a_table_by_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sub" / ".hidden").mkdir(parents=True)
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "sub" / "bad.py").write_text(GOOD + "pin.computeBodyRadius(model)\npin.forwardDynamics()\n")
    (tmp_path / "sub" / ".hidden" / "left.py").write_text("import pinocchio\npinocchio.frobnicate")
    (tmp_path / "plain.py").write_text("print(1)")
    (tmp_path / "broken.py").write_text("if:")
    assert cli.main(["port", str(tmp_path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    table = {line.split()[0]: line.split()[1:] for line in lines if line.strip()}
    assert table["good.py"] == ["7", "0", "0", "100", "%"]
    assert table["sub/bad.py"] == ["9", "1", "1", "88", "%", "geometry"]
    assert table["computeBodyRadius"][:4] == ["out", "of", "scope", "sub/bad.py:10"]
    assert any("forwardDynamics" in line and "raises where constraints depend" in line for line in lines)
    assert any("8 of 9 names work (88 %), 1 missing in 2 files; files without Pinocchio: 1" in line for line in lines)
    assert any(line.startswith("not read: ") and "broken.py" in line for line in lines)
    assert lines[-1] == "change everywhere: import pinocchio as pin  ->  import spatialdyn.compat.pinocchio as pin"
    assert "left.py" not in "".join(lines)
    (tmp_path / "sub" / "bad.py").unlink()
    assert cli.main(["port", str(tmp_path)]) == 0
    capsys.readouterr()
    (tmp_path / "sub" / "other.py").write_text("print(1)")
    assert cli.main(["port", str(tmp_path / "sub")]) == 0
    assert "none of 1 files uses Pinocchio" in capsys.readouterr().out


def test_notebooks_are_read_without_their_magic(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = [{"cell_type": "markdown", "source": ["pinocchio"]}]
    cells += [
        {"cell_type": "code", "source": x} for x in (["%matplotlib inline\n", "import pinocchio as pin"], "pin.nle")
    ]
    lesson = tmp_path / "lesson.ipynb"
    lesson.write_text(json.dumps({"cells": cells}))
    assert cli.main(["port", str(lesson)]) == 0
    assert "change line 2: import pinocchio as pin" in capsys.readouterr().out
    assert cli.main(["port", str(tmp_path)]) == 0
    assert "1 of 1 files run (100 %)" in capsys.readouterr().out
    lesson.write_text('{"worksheets": []}')
    assert cli.main(["port", str(lesson)]) == 2
    assert "no notebook of format 4" in capsys.readouterr().err


def test_folders_without_python_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "folder.py").mkdir()
    assert cli.main(["port", str(tmp_path)]) == 2
    assert "has no Python files or notebooks" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("source", "kinds"),
    [
        ("pin.rnea", []),
        ("import crocoddyl", [LIBRARY]),
        ("from tsid.robots import RobotWrapper\npin.frobnicate", [LIBRARY, OLD]),
        ("import example_robot_data as robots", [FOREIGN]),
        ("pin.computeBodyRadius", [GEOMETRY]),
        ("pin.lcaba", [NAME]),
        ("pin.visualize.MeshcatVisualizer().create_video_ctx()", [VIEWER]),
        ("m = pin.Model()\nm.own = 1\nm.own", []),
        ("m = pin.Model()\nm.own", [NAME]),
    ],
)
def test_what_stops_a_script_is_of_a_kind(source: str, kinds: list[str]) -> None:
    text = f"import pinocchio as pin\n{source}"
    found = stops(text, uses(text))
    assert [stop.kind for stop in found] == kinds
    assert all(stop.counts == (stop.kind not in (FOREIGN, OLD)) for stop in found)


def test_collisions_stop_where_coal_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "import pinocchio as pin, hppfcl\npin.computeCollisions"
    monkeypatch.setitem(sys.modules, "coal", ModuleType("coal"))
    monkeypatch.setattr(stopping, "has_coal", lambda: True)
    assert stops(text, uses(text)) == []
    monkeypatch.setattr(stopping, "has_coal", lambda: False)
    assert [(x.kind, x.what, x.lines) for x in stops(text, uses(text))] == [
        (GEOMETRY, "hppfcl", (1,)), (GEOMETRY, "computeCollisions", (2,)),
    ]  # fmt: skip


def test_data_of_others_models_are_not_pinocchios() -> None:
    assert "Data.cost" not in found("import pinocchio as pin\nproblem = f()\ndata = problem.createData()\ndata.cost")
    used = found("import pinocchio as pin\ng = pin.GeometryModel()\nd = g.createData()\nd.oMg\nd.tau")
    assert used["GeometryData.oMg"].status == SUPPORTED
    assert used["GeometryData.tau"].status == OUT_OF_SCOPE


def test_files_are_counted_by_what_stops_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, line in (("a", "pin.rnea"), ("b", "import pink"), ("c", "import tsid"), ("d", "pin.lcaba"),
                       ("e", "pin.frobnicate")):  # fmt: skip
        (tmp_path / f"{name}.py").write_text(f"import pinocchio as pin\n{line}")
    assert cli.main(["port", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert (
        "3 of 4 files run (75 %); 1 of them after spatialdyn.compat.pinocchio.install(), by spatialdyn run; "
        "stopped by a name: 1; with a name that Pinocchio 4.1 lacks too: 1; "
        "beside a C++ library that links Pinocchio: 1 more" in out
    )
    assert cli.main(["port", str(tmp_path / "c.py")]) == 1
    assert "stopped by a C++ library: tsid, line 2" in capsys.readouterr().out
    assert cli.main(["port", str(tmp_path / "b.py")]) == 0
    assert "pink imports pinocchio itself: spatialdyn run" in capsys.readouterr().out


def test_json_holds_every_use_and_stop_and_change(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "good.py"
    script.write_text(f"import tsid, pink{GOOD}")
    assert cli.main(["port", "--json", str(script)]) == 1
    (listed,) = json.loads(capsys.readouterr().out).values()
    assert {"name": "rnea", "lines": [8], "status": SUPPORTED, "note": "", "raises": ""} in listed["uses"]
    assert listed["stops"] == [
        {"kind": LIBRARY, "what": "tsid", "lines": [1]}, {"kind": FOREIGN, "what": "pink", "lines": [1]}
    ]  # fmt: skip
    assert [change["line"] for change in listed["changes"]] == [3]
    assert not listed["runs"]


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


UNREADABLE = {  # what a file holds, and part of the message about it
    "a syntax error": (b"if:", "line 1: "),
    "bytes": (b"x = '\xff\xfe'", "cannot be decoded"),
    "no codec": (b"# -*- coding: frobnicate -*-\n", "cannot be decoded"),
    "a null": (b"x = '\0'", "null bytes"),
    "a nest that Python's parser refuses": (b"-" * 200_000 + b"1", ""),
    "brackets": (b"(" * 5000 + b")" * 5000, ""),
    "a nest that the reader refuses": (b"import pinocchio as pin\npin" + b".a" * 5000, "nested too deep"),
    "a sum": (b"x = " + b"+".join([b"1"] * 20_000), "nested too deep"),
}


@pytest.mark.parametrize("what", UNREADABLE)
def test_a_folder_goes_on_after_a_file_that_cannot_be_parsed(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, reason = UNREADABLE[what]
    (tmp_path / "bad.py").write_bytes(content)
    (tmp_path / "good.py").write_text(GOOD)
    assert cli.main(["port", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    (said,) = [line for line in out.splitlines() if line.startswith("not read: ")]
    assert "bad.py" in said
    assert reason in said
    assert "7 of 7 names work (100 %) in 1 files" in out
    assert cli.main(["port", str(tmp_path), "--json"]) == 0
    out, err = capsys.readouterr()
    assert list(json.loads(out)) == [str(tmp_path / "good.py")]
    assert "bad.py" in err
    assert cli.main(["port", str(tmp_path / "bad.py")]) == 2
    assert reason in capsys.readouterr().err


def test_a_file_is_decoded_as_python_decodes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mark.py").write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    (tmp_path / "latin.py").write_bytes(b"# -*- coding: latin-1 -*-\n# \xe9\n" + GOOD.encode())
    (tmp_path / "odd.py").write_text(f"x = '\\d'\n{GOOD}")
    assert cli.main(["port", str(tmp_path)]) == 0
    assert "7 of 7 names work (100 %) in 3 files" in capsys.readouterr().out


def test_no_line_of_a_pipe_ends_in_blanks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "bad.py").write_text(GOOD + "pin.computeBodyRadius(model)\n")
    for given in (tmp_path, tmp_path / "bad.py"):
        cli.main(["port", str(given)])
        lines = capsys.readouterr().out.splitlines()
        assert len(lines) > 5
        assert [line for line in lines if line != line.rstrip()] == []
