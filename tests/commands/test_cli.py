"""The command line: output, JSON, exit status."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import warnings
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plain import compiled

import spatialdyn as sd
from spatialdyn import Trajectory, validate, waiting
from spatialdyn.calls import dynamics
from spatialdyn.commands import cli, compare
from spatialdyn.errors import InertiaError
from spatialdyn.urdf.load import example_robots, robot_names

pytest.importorskip("pinocchio")
RICH = ("rich", "rich.box", "rich.console", "rich.progress", "rich.table", "rich.text")


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that takes long on a loaded machine, or without compiled code, does not say so."""
    monkeypatch.setattr(waiting, "LONG", 600.0)


def run(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str, str]:
    """Exit status, stdout and stderr."""
    status = cli.main(list(argv))
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def hide(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    """Make modules fail to import."""
    for name in modules:
        monkeypatch.setitem(sys.modules, name, None)


@pytest.fixture
def wrong_crba(monkeypatch: pytest.MonkeyPatch) -> None:
    """A crba that is off by 1e-9."""
    right = dynamics.calls["crba"]

    def wrong(model: Any, q: Any) -> Any:
        return right(model, q) + 1e-9

    monkeypatch.setattr(dynamics, "crba", wrong)


# --- info ------------------------------------------------------------------------------------------------


def test_info_shows_the_tree(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "info", "tree")
    assert (status, err) == (0, "")
    assert "fixed root" in out
    assert "├ " in out
    assert "└ " in out
    assert "joints" in out


def test_info_of_a_floating_root_has_six_freedoms_more(capsys: pytest.CaptureFixture[str]) -> None:
    fixed = json.loads(run(capsys, "info", "two_link", "--json")[1])
    floating = json.loads(run(capsys, "info", "two_link", "--root", "floating", "--json")[1])
    assert (fixed["nv"], floating["nv"], floating["nq"]) == (2, 8, 9)
    assert "0-5" in run(capsys, "info", "two_link", "--root", "floating")[1]


def test_info_says_what_is_odd(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "odd.urdf"
    file.write_text(
        '<robot name="odd"><link name="a"/><link name="b"/><joint name="j" type="revolute">'
        '<parent link="a"/><child link="b"/></joint></robot>'
    )
    out = run(capsys, "info", str(file))[1]
    assert "joint has no <limit>, so it is unlimited" in out
    assert "link that moves has no <inertial>" in out
    record = json.loads(run(capsys, "info", str(file), "--json")[1])
    assert record["joints"][0]["upper"] is None
    assert len(record["notes"]) >= 2


def test_info_counts_the_meshes_and_names_those_that_are_missing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    names = ["package://arm/a.stl", "package://arm/b.stl", "package://arm/../c.stl", "package://arm/a.stl"]
    shape = '<{0}><geometry><mesh filename="{1}"/></geometry></{0}>'
    shapes = "".join(shape.format("visual", name) for name in names) + shape.format("collision", names[0])
    ball = "<visual><geometry><sphere radius='1'/></geometry></visual>"
    file = tmp_path / "arm.urdf"
    file.write_text(f'<robot name="arm"><link name="l">{shapes}{ball}</link></robot>')
    (tmp_path / "packages" / "arm").mkdir(parents=True)
    (tmp_path / "packages" / "arm" / "a.stl").write_text("")
    refused = f"{names[2]} holds .., expected a path below its package"
    for more, missing in (
        ([], [f"{names[0]} is not found", f"{names[1]} is not found", refused]),
        (["--package-dir", str(tmp_path / "packages")], [f"{names[1]} is not found", refused]),
    ):
        lost = ", ".join(f'"{line}"' for line in missing)
        shown = f"meshes  3 of 4 visual and 1 collision shapes, {len(missing)} missing: {lost}\n"
        assert shown in run(capsys, "info", str(file), *more)[1]
        record = json.loads(run(capsys, "info", str(file), "--json", *more)[1])
        assert record["meshes"] == {"names": names[:3], "visual": 4, "collision": 1, "missing": missing, "faulty": []}
    assert "meshes" not in run(capsys, "info", "two_link")[1]


def test_info_names_what_a_mesh_refers_to_and_is_not_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """As a foot of ANYmal, whose texture's surface has another name."""
    text = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><library_images><image id="i">
        <init_from>a%20b.png</init_from></image></library_images><library_effects><effect id="e"><profile_COMMON>
        <newparam sid="s"><surface><init_from>i</init_from></surface></newparam>
        <newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam></profile_COMMON></effect>
        </library_effects><instance_effect url="#e"/></COLLADA>"""
    file = tmp_path / "arm.urdf"
    mesh = '<visual><geometry><mesh filename="a.dae"/></geometry></visual>'
    file.write_text(f'<robot name="arm"><link name="l">{mesh}</link></robot>')
    (tmp_path / "a b.png").write_bytes(b"")
    for old, new, fault in (
        ("", "", ""),
        ("<source>s", "<source>z", 'no surface "z" of a texture'),
        ("<init_from>i", "<init_from>j", 'no image "j" of a texture'),
        ("a%20b.png", "c.png", 'no image file "c.png"'),
        ('url="#e"', 'url="#f"', 'no effect "f"'),
        ("</COLLADA>", "", "Premature end"),
    ):
        (tmp_path / "a.dae").write_text(text.replace(old, new) if old else text)
        (found,) = json.loads(run(capsys, "info", str(file), "--json")[1])["meshes"]["faulty"] or [""]
        assert found.startswith(f"a.dae: {fault}" if fault else "")
        assert bool(found) == bool(fault)
        shown = " ".join(run(capsys, "info", str(file))[1].split())
        assert ('none missing, 1 broken in part: "a.dae: ' in shown) == bool(fault)


def test_json_of_info_is_the_model(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Every number of the record is that of the model, none of them twice, so that a swap shows."""
    file = tmp_path / "chain.urdf"
    kinds = ("revolute", "prismatic", "continuous", "revolute")
    link = (
        '<link name="l{0}"><inertial><origin xyz="0.{0}1 0.{0}2 0.{0}3"/><mass value="{0}.5"/><inertia ixx="1" '
        'iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    parts = [link.format(k) for k in range(5)]
    for k, kind in enumerate(kinds, start=1):
        parts.append(
            f'<joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><axis xyz="0 {k % 2} {(k + 1) % 2}"/><limit lower="-0.{k}7" '
            f'upper="1.{k}3" velocity="{k}1" effort="{k}2"/>' + '<mimic joint="j1"/>' * (k == 4) + "</joint>"
        )
    file.write_text(f'<robot name="chain">{"".join(parts)}</robot>')
    for root in ("fixed", "floating"):
        record = json.loads(run(capsys, "info", str(file), "--root", root, "--json")[1])
        model = sd.load_urdf(file, root=root)
        assert [record[key] for key in ("name", "root", "nq", "nv", "frames", "root_link")] == [
            "chain", root, model.nq, model.nv, len(model.frames), "l0",
        ]  # fmt: skip
        assert (record["total_mass"], record["gravity"]) == (model.total_mass, [0.0, 0.0, -9.81])
        assert [(x["name"], x["mass"], x["com"]) for x in record["links"]] == [
            (f"l{k}", k + 0.5, [float(f"0.{k}{i}") for i in (1, 2, 3)]) for k in range(5)
        ]
        for k, x in enumerate(record["joints"], start=1):
            at = model.joint(f"j{k}")
            free = kinds[k - 1] == "continuous"
            assert [x["lower"], x["upper"]] == ([None, None] if free else [float(f"-0.{k}7"), float(f"1.{k}3")])
            assert [x["velocity"], x["effort"]] == [10.0 * k + 1.0, 10.0 * k + 2.0]
            assert free or [x["lower"], x["upper"]] == [model.lower[at.idx_q], model.upper[at.idx_q]]
            assert [x["velocity"], x["effort"]] == [model.velocity_limit[at.idx_v], model.effort_limit[at.idx_v]]
            assert [x[key] for key in ("name", "kind", "parent", "child", "idx_v", "mimic")] == [
                f"j{k}", kinds[k - 1], f"l{k - 1}", f"l{k}", at.idx_v, "j1" if k == 4 else None,
            ]  # fmt: skip
            assert x["axis"] == [0.0, float(k % 2), float((k + 1) % 2)]
        assert record["notes"] == list(model.robot.notes)


def test_info_without_a_robot_lists_those_that_have_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "info")
    assert (status, err) == (0, "")
    listed = json.loads(run(capsys, "info", "--json")[1])
    assert list(listed) == list(robot_names())
    assert {line.split()[0] for line in out.splitlines() if ".urdf" in line} == set(listed)
    assert sd.load_urdf(listed["two_link"]) == sd.load_urdf("two_link")


def test_version_is_the_library_s(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    assert capsys.readouterr().out == f"spatialdyn {sd.__version__}\n"


def test_info_says_where_neutral_is_outside_the_limits(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    joint = (
        '<joint name="{name}" type="{kind}"><parent link="base"/><child link="{name} link"/><axis xyz="0 0 1"/>'
        '<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint><link name="{name} link"/>'
    )
    ranges = (("low", "revolute", -3.0, -0.5), ("at", "revolute", 0.0, 1.0), ("high", "prismatic", 0.25, 1.0))
    parts = [joint.format(name=name, kind=kind, lower=a, upper=b) for name, kind, a, b in ranges]
    file.write_text(f'<robot name="odd"><link name="base"/>{"".join(parts)}</robot>')
    lines = ["high: 0 is outside 0.25 .. 1 m", "low: 0 is outside -3 .. -0.5 rad"]
    assert (
        "neutral is outside the limits:\n" + "".join(f"  - {x}\n" for x in lines) in run(capsys, "info", str(file))[1]
    )
    assert json.loads(run(capsys, "info", str(file), "--json")[1])["neutral_outside_limits"] == lines
    assert "neutral" not in run(capsys, "info", "two_link")[1]


def test_a_narrow_terminal_leaves_names_readable(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rich")
    for name, value in {"COLUMNS": "40", "FORCE_COLOR": "1", "NO_COLOR": "1", "TERM": "dumb"}.items():
        monkeypatch.setenv(name, value)
    for robot, words in (("two_link", ("continuous", "joint1")), ("tree", ("left_elbow", "prismatic"))):
        out = run(capsys, "info", robot)[1]
        assert [word for word in words if word not in out] == []


def test_a_table_wider_than_the_terminal_becomes_a_line_a_link(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("info", "printing"):
        monkeypatch.setattr(f"spatialdyn.commands.{module}.terminal_width", lambda: 50)
    out = run(capsys, "info", "tree")[1]
    assert max(map(len, out.splitlines())) <= 50
    model = sd.load_urdf("tree")
    for joint in model.robot.joints:
        assert f"{joint.name}: {joint.kind}" in out
    for link in model.robot.links:
        assert f"{link.name}  {link.mass:.4g} kg" in out


def test_info_without_a_stdout_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after ``>&-`` in a shell."""
    monkeypatch.setattr(sys, "stdout", None)
    for words in ([], ["tree"], ["tree", "--json"]):
        assert cli.main(["info", *words]) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no such status of a pipe")
@pytest.mark.parametrize("argv", [["info", "talos_full"], ["info", "tree", "--json"]])
def test_a_reader_that_closes_early_is_no_traceback(argv: list[str]) -> None:
    """The pipe is closed before anything is written, as by ``head -0``."""
    if "talos_full" in argv and "talos_full" not in robot_names():
        argv = ["info", "tree"]
    command = [sys.executable, "-m", "spatialdyn", *argv]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    err = process.stderr.read()
    process.stderr.close()
    assert (process.wait(), err) == (128 + signal.SIGPIPE, b"")


# --- compare ---------------------------------------------------------------------------------------------


@pytest.mark.slow(quick="test_compare_of_some_calls_has_their_rows_alone")
def test_compare_of_one_robot_has_a_row_per_call(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "compare", "two_link", "--samples", "3")
    assert status == 0
    assert out.splitlines()[-1].startswith("AGREES with Pinocchio: two_link")
    first = {line.split()[0] for line in out.splitlines() if line.strip()}
    assert {call.name for call in validate.CALLS} <= first
    assert "ratio" in out


def test_compare_of_some_calls_has_their_rows_alone(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "compare", "two_link", "--samples", "1", "--calls", "crba, rnea", "--json")
    assert status == 0
    rows = json.loads(out)[0]["comparisons"][0]["rows"]
    assert [row["call"] for row in rows] == ["joint order", "rnea", "rnea (fext)", "crba"]
    status, out, _ = run(capsys, "compare", "pendulum", "two_link", "--samples", "1", "--calls", "crba")
    assert (status, "crba: our time over Pinocchio's" in out) == (0, True)


def test_compare_refuses_what_is_no_call() -> None:
    with pytest.raises(sd.SpatialDynError, match="calls has 'rnae', expected some of rnea"):
        sd.compare_with_pinocchio("two_link", calls=["rnae"])
    with pytest.raises(sd.SpatialDynError, match=r'calls is "rnea", expected names of calls, \("rnea",\) for one'):
        sd.compare_with_pinocchio("two_link", calls="rnea")


def test_compare_covers_every_public_call_about_dynamics() -> None:
    assert {call.name for call in validate.CALLS} >= set(dynamics.SPECS)


@pytest.mark.slow(quick="test_compare_of_some_calls_has_their_rows_alone")
def test_compare_is_a_library_call_too() -> None:
    comparison = sd.compare_with_pinocchio("two_link", "floating", samples=2)
    assert comparison.ok
    assert {row.call.partition(" ")[0] for row in comparison.rows} >= set(dynamics.SPECS)


def test_compare_of_many_robots_has_a_row_per_robot(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(
        capsys, "compare", "pendulum", "two_link", "--samples", "2", "--no-timing", "--calls", "rnea,crba,aba"
    )
    assert status == 0
    assert [line.split()[0] for line in out.splitlines() if line.startswith(("pendulum", "two_link"))] == [
        "pendulum",
        "two_link",
    ]
    assert "2 robots" in out


@pytest.mark.slow(quick="test_compare_of_some_calls_has_their_rows_alone")
def test_compare_json_parses_and_holds_no_nan(capsys: pytest.CaptureFixture[str]) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    status, out, _ = run(capsys, "compare", "two_link", "--samples", "2", "--no-timing", "--json")
    (record,) = json.loads(out, parse_constant=refuse)
    assert status == 0
    assert record["ok"]
    assert [part["root"] for part in record["comparisons"]] == ["fixed", "floating"]
    row = record["comparisons"][0]["rows"][1]
    assert row["call"] == "rnea"
    assert row["error"] <= row["bound"]
    assert row["ours_us"] is None


def test_timing_is_in_json_too(capsys: pytest.CaptureFixture[str]) -> None:
    (record,) = json.loads(
        run(capsys, "compare", "pendulum", "--samples", "1", "--json", "--calls", "rnea,crba,aba")[1]
    )
    row = record["comparisons"][0]["rows"][1]
    assert row["ratio"] == pytest.approx(row["ours_us"] / row["pin_us"])


@pytest.mark.usefixtures("wrong_crba")
def test_disagreement_is_exit_1_and_named(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "compare", "tree", "--samples", "2", "--no-timing", "--calls", "rnea,crba,aba")
    assert status == 1
    said, _, named = out.splitlines()[-1].partition(": ")
    assert said == "DISAGREES with Pinocchio"
    # momentum has no peer and is compared with the wrong M
    assert {f"tree ({root}): crba" for root in ("fixed", "floating")} <= set(named.split("; "))
    assert {name.split(": ")[1] for name in named.split("; ")} <= {"crba", "momentum"}


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_result_that_is_not_finite_disagrees(
    wrong: float, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = dynamics.calls["potential_energy"]
    monkeypatch.setattr(dynamics, "potential_energy", lambda model, q: right(model, q) + wrong)
    status, out, _ = run(
        capsys, "compare", "pendulum", "--calls", "potential_energy", "--samples", "2", "--no-timing", "--json"
    )
    (record,) = json.loads(out)
    assert status == 1
    row = next(row for row in record["comparisons"][0]["rows"] if row["call"] == "potential_energy")
    assert (row["ok"], row["error"]) == (False, None)


def test_a_call_that_refuses_without_cause_disagrees(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(model: Any, *inputs: Any) -> None:
        raise InertiaError('joint "x" has zero articulated inertia')

    monkeypatch.setattr(dynamics, "aba", refuse)
    status, out, _ = run(capsys, "compare", "two_link", "--calls", "aba", "--samples", "2", "--no-timing")
    assert status == 1
    assert "refused, where Pinocchio gives numbers" in out


def test_a_batch_that_differs_from_single_calls_disagrees(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = dynamics.calls["rnea"]

    def wrong(model: Any, q: Any, *rest: Any) -> Any:
        return right(model, q, *rest) * (1.0 + 1e-15 * (np.ndim(q) == 2))

    monkeypatch.setattr(dynamics, "rnea", wrong)
    assert (
        "a single call and a batch of it differ"
        in run(capsys, "compare", "two_link", "--no-timing", "--calls", "rnea,crba,aba")[1]
    )


# --- bad input -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["info", "compare"])
def test_a_wrong_file_is_exit_2_and_one_line(command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "broken.urdf"
    file.write_text("<robot name='x'>")
    for source in (str(file), str(tmp_path / "missing.urdf"), "no_such_robot"):
        status, out, err = run(capsys, command, source)
        assert (status, out) == (2, "")
        assert err.startswith("spatialdyn: ")
        assert err.count("\n") == 1


@pytest.mark.parametrize(
    "argv", [["compare"], ["compare", "panda", "--all"], ["compare", "pendulum", "--samples", "0"]]
)
def test_arguments_that_make_no_sense_are_exit_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, *argv)[0] == 2


def test_without_pinocchio_compare_says_how_to_get_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hide(monkeypatch, "pinocchio")
    status, _, err = run(capsys, "compare", "pendulum")
    assert status == 2
    assert err == "spatialdyn: pinocchio is not installed; pip install pin example-robot-data\n"
    assert run(capsys, "info", "pendulum")[0] == 0


def test_without_rich_tables_are_aligned_text(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hide(monkeypatch, *RICH)
    status, out, _ = run(
        capsys, "compare", "pendulum", "two_link", "--samples", "2", "--no-timing", "--calls", "rnea,crba,aba"
    )
    assert status == 0
    header, rule, *rows = out.splitlines()[:4]
    assert set(rule) == {"-", " "}
    assert all(row.index("e-") < len(header) for row in rows if "e-" in row)
    assert run(capsys, "info", "tree")[0] == 0


def test_all_counts_what_both_refuse(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = {path.stem: path for path in example_robots() if path.stem in ("ur3", "TwoDofs")}
    if len(wanted) < 2:
        pytest.skip("example-robot-data is not installed")
    monkeypatch.setattr(compare, "example_robots", lambda: list(wanted.values()))
    status, out, _ = run(capsys, "compare", "--all", "--samples", "1", "--no-timing", "--calls", "rnea,crba,aba")
    assert status == 0
    assert "refused by both" in out
    assert out.splitlines()[-1].endswith("TwoDofs, every call asked for within its bound; 1 refused by both")


def test_python_m_spatialdyn_is_the_same_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "spatialdyn", "info", "pendulum"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert done.stdout.startswith("pendulum")


# --- simulate --------------------------------------------------------------------------------------------


def test_simulate_reports_saves_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    saved, drawn = tmp_path / "run.npz", tmp_path / "energy.png"
    options = ["--q0", "0.5,-0.3", "--duration", "0.1", "--dt", "0.01", "--save", str(saved), "--plot", str(drawn)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside matplotlib
        assert cli.main(["simulate", "two_link", "--method", "rk4", *options]) == 0
    out = capsys.readouterr().out
    assert out.startswith("two_link: 11 samples of 0.1 s by rk4, dt 0.01 s")
    assert "energy  " in out
    assert Trajectory.load(saved).q[0].tolist() == [0.5, -0.3]
    assert drawn.read_bytes()[:4] == b"\x89PNG"


def test_simulate_shows_what_there_is_at_ctrl_c(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(done: int, total: int) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("spatialdyn.commands.simulate.shown", lambda *words: nullcontext(stop))
    path = str(tmp_path / "run.npz")
    status, out, err = run(capsys, "simulate", "two_link", "--duration", "1e4", "--save", path)
    assert status == 130
    kept = Trajectory.load(path)
    assert kept.interrupted
    assert 2 <= len(kept) < 1000
    assert err == f"spatialdyn: interrupted at t = {kept.t[-1]:g} s of 10000 s\n"
    assert out.startswith(f"two_link: {len(kept)} samples of {kept.t[-1]:g} s by rk4")
    assert "energy  " in out


def test_ctrl_c_ends_every_command_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(arguments: Any, **more: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("spatialdyn.commands.simulate.load", stop)
    assert run(capsys, "simulate", "two_link") == (130, "", "spatialdyn: interrupted\n")


@pytest.mark.parametrize(("method", "warned"), [("explicit_euler", True), ("rk4", False)])
def test_simulate_says_how_far_energy_went(method: str, warned: bool, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--q0", "1.0", "--duration", "10", "--dt", "0.01", "--method", method]
    status, out, err = run(capsys, "simulate", "pendulum", *options)
    assert (status, err) == (0, "")
    motion = sd.simulate(sd.load_urdf("pendulum"), [1.0], [0.0], 10.0, 0.01, method)
    T = np.asarray(sd.kinetic_energy(motion.model, motion.q, motion.v))
    far, V = abs(motion.energy - motion.energy[0]).max(), motion.energy - T
    share = 100.0 * far / (abs(V - V[0]).max() + T[0])
    assert (share > 10.0) == warned
    assert f"at most {far:.3g} J, {share:.2g} % of its scale" in out
    assert (f"warning energy changes by {share:.2g} % of its scale though nothing drives the robot" in out) == warned


@pytest.mark.slow(quick="simulation/test_simulate.py::test_a_motion_that_diverges_is_not_blamed_on_the_robot")
def test_a_simulation_that_diverges_is_no_result(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "simulate", "panda", "--dt", "0.03", "--duration", "10")
    assert (status, out) == (2, "")
    said = [line for line in err.splitlines() if "takes more than 3 s" not in line]  # on a slow machine
    assert len(said) == 1
    assert said[0].startswith("spatialdyn: rk4 diverged at t = ")
    assert "reduce dt" in said[0]


@pytest.mark.parametrize("option", ["--q", "--q0", "--v0"])
def test_numbers_after_an_option_may_begin_with_a_minus(option: str) -> None:
    for numbers in ("-1,0.5", "-.5,2", "-1e-3"):
        assert cli._joined(["view", option, numbers]) == ["view", f"{option}={numbers}"]
    assert cli._joined([option, "--json", "-1"]) == [option, "--json", "-1"]


@pytest.mark.parametrize("how", ["--q0 -1,0.5", "--q0=-1,0.5", "--v0 -.5,-2", "--v0 -1e-3,2 --q0 -2,-1"])
def test_numbers_may_begin_with_a_minus(how: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "run.npz")
    options = [*how.split(), "--duration", "0.01", "--dt", "0.01", "--save", path]
    assert run(capsys, "simulate", "two_link", *options)[0] == 0
    kept = Trajectory.load(path)
    words = how.replace("=", " ").split()
    for name, text in zip(words[::2], words[1::2], strict=True):
        assert getattr(kept, name[2])[0].tolist() == [float(x) for x in text.split(",")]


def test_simulate_refuses_bad_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["simulate", "two_link", "--q0", "0.5"]) == 2
    assert capsys.readouterr().err == "spatialdyn: --q0 has 1 numbers, expected 2\n"
    assert cli.main(["simulate", "two_link", "--v0", "a,b"]) == 2
    assert "--v0 is 'a,b', expected numbers separated by commas" in capsys.readouterr().err
    assert cli.main(["simulate", "two_link", "--dt", "0"]) == 2
    assert "dt is 0.0, expected a finite number of seconds above 0" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["simulate", "trade"])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(f"spatialdyn.commands.{command}.load", None)
    assert cli.main([command, "two_link", "--plot", "energy.doc"]) == 2
    assert "--plot is 'energy.doc', expected a name that ends in one of .png, .svg, .pdf" in capsys.readouterr().err
    for path in ("energy", str(tmp_path / "nowhere" / "energy.png")):
        assert cli.main([command, "two_link", "--plot", path]) == 2
        assert f"--plot is {path!r}, expected a name" in capsys.readouterr().err
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *given, **options: [][0])
    assert cli.main([command, "two_link", "--plot", "energy.png"]) == 2
    assert "--plot is 'energy.png', which Matplotlib cannot write: list index" in capsys.readouterr().err
    (tmp_path / "run.png").mkdir()
    assert cli.main([command, "two_link", "--plot", str(tmp_path / "run.png")]) == 2
    assert "run.png', a directory, expected the name of a file" in capsys.readouterr().err
    hide(monkeypatch, "matplotlib", "matplotlib.backend_bases")
    assert cli.main([command, "two_link", "--plot", "energy.png"]) == 2
    assert capsys.readouterr().err == "spatialdyn: matplotlib is not installed; pip install matplotlib\n"


@pytest.mark.parametrize("name", ["run.txt", "run", "run.npy", "run.csv", "run.html.gz", ".npz"])
def test_simulate_saves_to_no_file_of_an_unknown_ending(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("spatialdyn.commands.simulate.simulate", None)  # it is refused before the work
    status, out, err = run(capsys, "simulate", "two_link", "--save", name)
    wanted = f"spatialdyn: --save is {name!r}, expected a name that ends in one of .npz, .html, .htm\n"
    assert (status, out, err) == (2, "", wanted)
    assert list(tmp_path.iterdir()) == []


def test_a_trajectory_that_cannot_be_saved_is_an_error_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "nowhere" / "run.npz")
    assert cli.main(["simulate", "two_link", "--save", path]) == 2
    assert f"--save is {path!r}, expected a name in a folder that is there" in capsys.readouterr().err

    def full(self: Trajectory, path: str) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Trajectory, "save", full)
    assert cli.main(["simulate", "two_link", "--duration", "0.01", "--dt", "0.01", "--save", "run.npz"]) == 2
    assert "--save is 'run.npz': No space left on device, expected" in capsys.readouterr().err


# --- friction and constraints of a simulation ---------------------------------------------------------------


def test_simulate_lets_friction_act_and_says_what_it_took(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, drawn = str(tmp_path / "run.npz"), tmp_path / "ledger.png"
    options = ["--q0", "0.5,-0.3", "--duration", "0.2", "--dt", "0.002", "--save", path]
    status, out, err = run(
        capsys, "simulate", "two_link", *options, "--friction", "coulomb=0.4,viscous=0.1", "--ledger", str(drawn)
    )
    assert (status, err) == (0, "")
    assert "by semi_implicit_euler" in out
    model, friction = sd.load_urdf("two_link"), sd.Friction([0.4, 0.4], [0.1, 0.1])
    wanted = sd.simulate(
        sd.Scene(model, friction=friction), [0.5, -0.3], [0.0, 0.0], 0.2, 0.002, "semi_implicit_euler", record="work"
    )
    kept = Trajectory.load(path)
    np.testing.assert_array_equal(kept.q, wanted.q)
    lost = sd.energy_ledger(wanted).work["friction"][-1].sum()
    assert f"work    friction {lost:.3g} J; the integrator's error" in out
    assert drawn.read_bytes()[:4] == b"\x89PNG"
    smooth = ["--friction", "coulomb=0.4,smoothing=1", "--friction-method", "smooth"]
    status, out, err = run(capsys, "simulate", "two_link", *options, *smooth)
    assert (status, err) == (0, "")
    assert "by rk4" in out


LIMITED = """<robot name="claw"><link name="base"/>
<link name="a"><inertial><mass value="1"/><origin xyz=".2 0 0"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>
</inertial></link><link name="b"><inertial><mass value="1"/><origin xyz=".2 0 0"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lead" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="1.0" effort="1" velocity="1"/><dynamics damping="0.1" friction="0.05"/></joint>
<joint name="then" type="revolute"><parent link="base"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="1.0" effort="1" velocity="1"/><mimic joint="lead" multiplier="0.5"/></joint></robot>"""


@pytest.fixture
def limited(tmp_path: Path) -> str:
    """A claw whose second joint mimics the first."""
    path = tmp_path / "claw.urdf"
    path.write_text(LIMITED)
    return str(path)


@compiled
def test_simulate_starts_at_rest_in_the_middle_of_the_limits(
    limited: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And joints that mimic others follow them."""
    path = str(tmp_path / "run.npz")
    options = [limited, "--duration", "0.5", "--dt", "1e-3", "--save", path]
    status, out, err = run(capsys, "simulate", *options)
    assert (status, err) == (0, "")
    kept = Trajectory.load(path)
    assert (kept.q[0].tolist(), kept.v[0].tolist(), kept.method) == ([0.25], [0.0], "rk4")
    assert "note    joints pass their limits, which --limits stops them at: lead" in out
    assert "which simulate ignores unless --friction\n" in out  # and no code that only Python's users can write
    random = []
    for seed in ("0", "0", "1"):
        assert run(capsys, "simulate", *options, "--seed", seed)[0] == 0
        random.append(Trajectory.load(path).q[0].tolist())
    assert random[0] == random[1] != random[2]
    model = sd.load_urdf(limited, mimic=True)
    assert random[2] == sd.random_configuration(model, np.random.default_rng(1)).tolist()


def test_simulate_stops_at_limits_with_friction_and_shows_their_work(
    limited: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / "run.npz")
    options = ["--duration", "1", "--dt", "1e-3", "--save", path, "--friction", "--limits"]
    status, out, err = run(capsys, "simulate", limited, *options)
    assert (status, err) == (0, "")
    assert "by semi_implicit_euler" in out
    assert "work    friction -" in out
    assert "contacts -" in out
    assert "note" not in out
    kept = Trajectory.load(path)
    assert 0.99 < kept.q.max() < 1.001
    model = sd.load_urdf(limited, mimic=True)
    wanted = sd.simulate(sd.Scene(model, friction=True, limits=True), [0.25], [0.0], 1.0, 1e-3)
    np.testing.assert_array_equal(kept.q, wanted.q)


def test_constraints_of_a_file_act_beside_joints_that_mimic_others(
    limited: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which are coupled to their leaders then."""
    loops, path = tmp_path / "loops.toml", str(tmp_path / "run.npz")
    loops.write_text('[[constraint]]\nkind = "coupler"\njoint = "then"\nto = "lead"\nratio = 0.5\n')
    options = ["--duration", "0.2", "--dt", "1e-3", "--constraints", str(loops), "--save", path]
    assert run(capsys, "simulate", limited, *options)[0] == 0
    kept, alone = Trajectory.load(path), sd.load_urdf(limited, mimic=True)
    wanted = sd.simulate(sd.Scene(alone, friction=False), [kept.q[0, 0]], [0.0], 0.2, 1e-3)
    np.testing.assert_allclose(kept.q[:, 0], wanted.q[:, 0], atol=1e-9)
    np.testing.assert_allclose(kept.q[:, 1], 0.5 * kept.q[:, 0], atol=1e-11)


def test_simulate_holds_the_constraints_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    loops, path = tmp_path / "loops.toml", str(tmp_path / "run.npz")
    loops.write_text('[[constraint]]\nkind = "coupler"\njoint = "joint2"\nto = "joint1"\nratio = -2\n')
    options = ["--duration", "0.2", "--dt", "0.01", "--constraints", str(loops), "--save", path]
    status, out, err = run(capsys, "simulate", "two_link", *options)
    assert (status, err) == (0, "")
    kept = Trajectory.load(path)
    np.testing.assert_allclose(kept.q[:, 1], -2.0 * kept.q[:, 0], rtol=0.0, atol=1e-11)
    assert "work    constraints " in out
    assert "projection " in out
    status, out, err = run(capsys, "simulate", "two_link", *options, "--stabilization", "0.1")
    assert (status, err) == (0, "")
    assert "projection" not in out


def test_simulate_takes_a_scene_of_a_file_beside_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, kept = tmp_path / "scene.toml", str(tmp_path / "run.npz")
    path.write_text(
        '[friction]\nviscous = 0.2\n[contacts]\npoints = {tip = 0.05}\nterrain = {kind = "plane", height = -2.5}'
    )
    options = ["--scene", str(path), "--limits", "--duration", "0.5", "--dt", "1e-3", "--q0", "1.2,0.3", "--save", kept]
    status, out, err = run(capsys, "simulate", "two_link", *options)
    assert (status, err) == (0, "")
    assert "work    friction -" in out
    model = sd.load_urdf("two_link", mimic=True)
    ground = sd.Contacts(model, {"tip": 0.05}, terrain=sd.Plane(height=-2.5))
    scene = sd.Scene(model, friction=sd.Friction(viscous=0.2), contacts=ground, limits=True)
    assert Trajectory.load(kept, model).scene == scene
    wanted = sd.simulate(scene, [1.2, 0.3], [0.0, 0.0], 0.5, 1e-3)
    np.testing.assert_array_equal(Trajectory.load(kept).q, wanted.q)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scene", "nowhere.toml"], "--scene is 'nowhere.toml', which cannot be read"),
        (["--friction", "coulomb"], "--friction has 'coulomb', expected NAME=NUMBER"),
        (["--friction", "dry=1"], "--friction has dry, expected some of coulomb, viscous"),
        (["--friction", "coulomb=-1"], 'friction of joint "joint1": coulomb is -1'),
        (["--friction", "--method", "rk4"], 'method is "rk4" and friction acts'),
        (["--constraints", "nowhere.toml"], "--constraints is 'nowhere.toml', which cannot be read"),
        (["--stabilization", "0.1"], "stabilization is 0.1, expected None: no constraints are given"),
        (["--ledger", "x.png"], "--ledger was given, expected --scene, --friction, --limits or --constraints"),
        (
            ["--limits", "--method", "rk4"],
            'method is "rk4" and limits act, expected semi_implicit_euler',
        ),
        (["--seed", "-1"], "--seed is -1, expected a whole number of 0 or more"),
        (["--seed", "1", "--q0", "1,2"], "--q0 and --seed were given, expected one of them"),
        (["--friction", "--ledger", "x.nope"], "--ledger is 'x.nope', expected a name that ends in one of"),
    ],
)
def test_simulate_refuses_what_cannot_act(options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "simulate", "two_link", "--duration", "0.1", *options)
    assert (status, out) == (2, "")
    assert message in err
