"""``sd.load``: the reader of each format, by what a source is; and what is refused, with the way to go."""

from __future__ import annotations

import doctest
import io
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import spatialdyn as sd
from spatialdyn.commands.cli import main
from spatialdyn.sources import descriptions, load, mjmodel, to_mjcf, to_urdf
from spatialdyn.urdf.load import find_robot

ROD = '<link name="a"/><link name="b"/><joint name="{}" type="revolute"><parent link="a"/><child link="b"/></joint>'
URDF = f'<?xml version="1.0"?>\n<!-- a robot --><robot name="r">{ROD.format("j")}</robot>'
MJCF = """<mujoco model="m"><option gravity="0 0 -3"/><worldbody><body name="rod"><joint name="pin"/>
  <geom size=".1"/></body></worldbody></mujoco>"""
XACRO = f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="prefix" default="left"/>
  <xacro:arg name="short" default="true"/><xacro:unless value="$(arg short)"><link name="long"/>
  <joint name="f" type="fixed"><parent link="b"/><child link="long"/></joint></xacro:unless>
  {ROD.format("$(arg prefix)_${1 + 1}")}</robot>"""


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for name, text in {"r.urdf": URDF, "u.xml": URDF, "m.xml": MJCF, "r.urdf.xacro": XACRO}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("given", ["r.urdf", "u.xml"])
def test_urdf_goes_to_load_urdf(files: Path, given: str) -> None:
    wanted = sd.load_urdf(URDF, root="floating", gravity=(0, 0, -1))
    for source in (
        URDF,
        URDF.encode(),
        io.StringIO(URDF),
        io.BytesIO(URDF.encode()),
        files / given,
        str(files / given),
    ):
        if hasattr(source, "seek"):
            source.seek(0)
        assert sd.load(source, root="floating", gravity=(0, 0, -1)) == wanted
    assert sd.load(files / given).robot.source == str(files / given)
    assert sd.load(URDF).gravity.tolist() == [0.0, 0.0, -9.81]
    assert sd.load("two_link") == sd.load_urdf("two_link")


def test_mjcf_goes_to_mujoco(files: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    m = mujoco.MjModel.from_xml_string(MJCF)
    mujoco.mj_saveModel(m, str(files / "m.mjb"))
    wanted = sd.from_mjmodel(m)
    for source in (MJCF, MJCF.encode(), io.StringIO(MJCF), files / "m.xml", str(files / "m.xml"), files / "m.mjb", m):
        assert sd.load(source) == wanted
    assert wanted.gravity.tolist() == [0.0, 0.0, -3.0]
    assert sd.load(MJCF, gravity=(0, 0, -1)).gravity.tolist() == [0.0, 0.0, -1.0]
    with pytest.raises(sd.SpatialDynError, match=r"<text>: MuJoCo refuses it: .*XML Error: Schema violation"):
        sd.load("<mujoco><worldbodies/></mujoco>")
    with pytest.raises(sd.SpatialDynError, match=r"snap is 1e-09, expected None: it is of URDF alone"):
        sd.load(MJCF, snap=1e-9)


def test_includes_of_an_mjcf_file_are_read(files: Path) -> None:
    pytest.importorskip("mujoco")
    (files / "scene.xml").write_text('<mujoco><include file="m.xml"/></mujoco>', encoding="utf-8")
    assert sd.load(files / "scene.xml").names == ("universe", "pin")


def test_xacro_is_by_suffix_or_argument_only(files: Path) -> None:
    pytest.importorskip("xacrodoc")
    assert sd.load(files / "r.urdf.xacro").names == ("universe", "left_2")
    right = {"prefix": "right", "short": False}
    for source in (files / "r.urdf.xacro", XACRO):
        model = sd.load(source, xacro=right)
        assert model.names == ("universe", "right_2")
        assert model.frame("long").kind == "link"
    (files / "hidden.urdf").write_text(XACRO, encoding="utf-8")
    with pytest.raises(sd.UrdfError, match="xacro"):
        sd.load(files / "hidden.urdf")
    assert sd.load(files / "hidden.urdf", xacro={}).names == ("universe", "left_2")
    with pytest.raises(sd.SpatialDynError, match=r"<text>: xacro refuses it: .*nothing"):
        sd.load('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="${nothing}"/>', xacro={})
    with pytest.raises(sd.SpatialDynError, match=r'xacro is given "side", expected those of "prefix", "short"'):
        sd.load(XACRO, xacro={"side": "left"})
    with pytest.raises(sd.SpatialDynError, match='xacro is given "side", expected none: it has no arguments'):
        sd.load(URDF, xacro={"side": "left"})
    with pytest.raises(sd.SpatialDynError, match="xacro is 'a:=1', expected a mapping"):
        sd.load(XACRO, xacro="a:=1")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ('<sdf version="1.7"/>', r"<text> is SDF, .* expected URDF or MJCF: the package sdformat-mjcf"),
        ("<html/>", "a web page is not read"),
        ("nothing_of_that_name", "neither a file nor the name of a robot"),
        ("gone.xml", r"gone\.xml: no such file, expected a robot's: MJCF, xacro or URDF"),
        (5, "source is of type int"),
        ("", "neither a file nor the name"),
        ("a\0b", "expected"),
    ],
)
def test_what_is_no_robot_is_refused(source: Any, message: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=message):
        sd.load(source)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for package, source, options in (("mujoco", MJCF, {}), ("xacrodoc", XACRO, {"xacro": {}})):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(sd.SpatialDynError, match=f"pip install {package}"):
            sd.load(source, **options)


def test_descriptions_are_cloned_at_first_use_and_said_to_be(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The module of a description clones when it is imported: here one that is imported has its place."""
    pytest.importorskip("robot_descriptions")
    name = "edo_description"
    assert name in descriptions.description_names()
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setitem(sys.modules, f"robot_descriptions.{name}", SimpleNamespace(URDF_PATH=str(files / "r.urdf")))
    said = rf'"{name}" is of robot_descriptions, which clones https://\S+ into {tmp_path / "cache"}'
    with pytest.warns(UserWarning, match=said) as warned:
        assert sd.load(name) == sd.load_urdf(URDF)
    assert warned[0].filename == __file__  # the line that calls sd.load
    (tmp_path / "cache" / "edo_sim").mkdir(parents=True)
    assert sd.load(name) == sd.load_urdf(URDF)  # a warning would be an error
    with pytest.raises(sd.UrdfError, match=r"of robot_descriptions: .*edo_description"):
        sd.load("edo_descriptions")


def test_a_description_that_cannot_be_cloned_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("robot_descriptions")

    def refuse(name: str) -> Any:
        raise OSError("no network")

    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))
    monkeypatch.setattr(descriptions, "import_module", refuse)
    with (
        pytest.warns(UserWarning, match="clones"),
        pytest.raises(sd.SpatialDynError, match=r"robot_descriptions cannot clone https://.*: no network"),
    ):
        sd.load("edo_description")


def test_names_of_robots_here_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spatialdyn.sources.load.description_names", lambda: frozenset({"two_link"}))
    assert sd.load("two_link").robot.source == str(find_robot("two_link"))


def test_a_description_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spatialdyn.sources.load.description_names", frozenset)
    with pytest.raises(sd.UrdfError, match=r"robot_descriptions is not installed; pip install robot_descriptions$"):
        sd.load("ur5_description")


def test_commands_take_what_load_takes(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    assert main(["info", str(files / "m.xml")]) == 0
    assert "1 freedoms (nq 1)" in capsys.readouterr().out


@pytest.mark.parametrize("module", [load, mjmodel, to_mjcf, to_urdf])
def test_examples_of_docstrings_hold(module: Any) -> None:
    pytest.importorskip("mujoco")
    tried = doctest.testmod(module)
    assert (tried.failed, tried.attempted > 0) == (0, True)
