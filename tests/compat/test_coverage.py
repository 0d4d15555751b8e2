"""Which of Pinocchio's names are here, what is said of the others, and what a script uses of them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.cli import main
from spatialdyn.compat.pinocchio.coverage import entry
from spatialdyn.compat.pinocchio.port import uses

STATUSES = ("supported", "different", "out of scope")
SCRIPT = """
import numpy as np
import pinocchio as pin
import pinocchio.visualize
from pinocchio import rpy as angles, SE3
from pinocchio.utils import zero
from pinocchio import *

model = pin.buildModelFromUrdf("a.urdf", pin.JointModelFreeFlyer())
R = angles.matrixToRpy(np.eye(3)) @ pin.rpy.rpyToMatrix(0, 0, 0)
frame = model.getFrameId("x", pin.FrameType.JOINT)
if pin.WITH_COLLISION:
    pin.computeCollisions(model, None)
pin.crba(model, pin.Data(model), zero(3))
pin.Motion.nonsense
other.rnea()
"""


def test_every_public_name_of_the_wheel_is_covered_once() -> None:
    theirs = pytest.importorskip("pinocchio")
    found = ours.coverage()
    assert [x.name for x in found] == sorted(name for name in dir(theirs) if not name.startswith("_"))
    assert {x.status for x in found} == {*STATUSES}
    for x in found:
        assert (x.status == "out of scope") == (not hasattr(ours, x.name)), x.name
        assert bool(x.note) == (x.status != "supported"), x.name
        assert x.note != "it is not in this face", x.name


def test_all_that_is_imported_is_exported() -> None:
    tree = ast.parse(Path(ours.__file__).read_text(encoding="utf-8"))
    imported = {
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.level
        for alias in node.names
    }
    assert imported - {*ours.__all__} == {"absent", "__version__"}
    assert len(ours.__all__) == len({*ours.__all__})
    assert all(hasattr(ours, name) for name in ours.__all__)


def test_the_core_is_supported() -> None:
    for name in (
        "buildModelFromUrdf", "rnea", "aba", "crba", "forwardKinematics", "framesForwardKinematics", "getFrameJacobian",
        "integrate", "difference", "centerOfMass", "SE3", "RobotWrapper", "Model", "Data",
    ):  # fmt: skip
        assert entry(name).status in ("supported", "different")
    assert entry("getFrameVelocity") == ("getFrameVelocity", "supported", "")
    assert "here InertiaError naming the joint" in entry("aba").note


def test_a_name_out_of_scope_says_what_to_use_instead() -> None:
    with pytest.raises(NotImplementedError, match=r"computeCollisions is not in .*: geometry and collisions"):
        ours.computeCollisions
    with pytest.raises(NotImplementedError, match="convert the file to URDF"):
        ours.buildModelFromMJCF
    assert not hasattr(ours, "GeometryObject")
    with pytest.raises(AttributeError, match="has no attribute 'nonsense', nor has pinocchio") as caught:
        ours.nonsense
    assert not isinstance(caught.value, NotImplementedError)


def test_what_a_script_uses_is_found_with_its_lines() -> None:
    found = {use.name: use for use in uses(SCRIPT)}
    lines = {name: use.lines for name, use in found.items()}
    assert lines == {
        "visualize": (4,),
        "rpy": (5,),
        "SE3": (5,),
        "utils.zero": (6,),
        "*": (7,),
        "buildModelFromUrdf": (9,),
        "JointModelFreeFlyer": (9,),
        "rpy.matrixToRpy": (10,),
        "rpy.rpyToMatrix": (10,),
        "FrameType.JOINT": (11,),
        "WITH_COLLISION": (12,),
        "computeCollisions": (13,),
        "crba": (14,),
        "Data": (14,),
        "Motion.nonsense": (15,),
    }
    missing = {name for name, use in found.items() if use.status == "out of scope"}
    assert missing == {"visualize", "computeCollisions", "Motion.nonsense"}
    assert found["rpy.rpyToMatrix"].status == "supported"
    assert found["rpy.matrixToRpy"].status == "different"
    assert uses("import numpy as pin\npin.rnea()") == ()
    with pytest.raises(sd.SpatialDynError, match=r"<script> is no Python \(invalid syntax"):
        uses("def (")


def test_the_command_tells_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    assert main(["port", str(path)]) == 1
    out = capsys.readouterr().out
    assert "computeCollisions" in out
    assert "3 out of scope" in out
    path.write_text("import pinocchio\npinocchio.rnea(a, b, c, d, e)")
    assert main(["port", str(path)]) == 0
    assert "change the import to: import spatialdyn.compat.pinocchio as pin" in capsys.readouterr().out
    path.write_text("print(1)")
    assert main(["port", str(path)]) == 0
    assert capsys.readouterr().out == "script.py uses nothing of pinocchio\n"
    assert main(["port", str(tmp_path / "none.py")]) == 2
    assert "cannot be read" in capsys.readouterr().err
