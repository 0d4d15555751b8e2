"""The benchmarks' own parts: what they compare is equal, what they print and draw is whole. No test asserts a time."""

from __future__ import annotations

import ast
import importlib.util
import json
import pickle
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_gpu
import numpy as np
import pytest
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.run.tiered_program import TieredProgram

pytest.importorskip("pinocchio")
pytest.importorskip("mpmath")
BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
if not (BENCHMARKS / "run.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))

import cases  # noqa: E402
import chains  # noqa: E402
import clients  # noqa: E402
import contestants  # noqa: E402
import corpus  # noqa: E402
import costs  # noqa: E402
import friction  # noqa: E402
import gpu  # noqa: E402
import machine  # noqa: E402
import measure  # noqa: E402
import mutants  # noqa: E402
import peers  # noqa: E402
import plots  # noqa: E402
import readme  # noqa: E402
import run  # noqa: E402
import tables  # noqa: E402
import tradeoff  # noqa: E402

_found = importlib.util.spec_from_file_location("benchmark_of_compat", BENCHMARKS / "compat.py")
assert _found is not None
assert _found.loader is not None
compat = importlib.util.module_from_spec(_found)  # ``import compat`` may be the tests of that name
_found.loader.exec_module(compat)

SAMPLES = 20
EPS = float(np.finfo(float).eps)
CONGRUENT = 1e3 * EPS  # M of a short chain of rods, added up in another order
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    """The figures that are kept."""
    found: dict[str, Any] = json.loads((BENCHMARKS / "results.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module", params=["2R", "ur5", "anymal"])
def case(request: pytest.FixtureRequest) -> cases.Case:
    """A robot with cos and sin for an angle, one without, one that floats."""
    return cases.case(request.param, SAMPLES)


# --- measuring ------------------------------------------------------------------------------------------


def test_contestants_run_in_turn_in_every_round() -> None:
    seen: list[str] = []
    found = measure.interleaved({name: lambda name=name: seen.append(name) for name in "ab"}, rounds=3, seconds=0.0)
    assert list(found) == ["a", "b"]
    assert seen[-6:] == ["a", "b"] * 3


@pytest.mark.parametrize("call", slow_but(["rnea", "crba", "aba"], cases.CALLS))
def test_pinocchio_and_our_single_and_batched_calls_agree(case: cases.Case, call: str) -> None:
    wanted = contestants.expected(case, call)
    assert len(wanted) == SAMPLES
    ours = [cases.public(case, call), cases.public(case, call, fresh=True), contestants.pinocchio(case, call)]
    ours += [made for made in [contestants.pool(case, call, 1)] if made]
    for made in ours:
        assert cases.check(case, call, "ours", made, wanted) <= cases.SCALED


@compiled
@pytest.mark.parametrize("call", slow_but(["rnea"], ["rnea", "gravity", "kinematics"]))
def test_programs_and_jitted_loops_answer_the_same(case: cases.Case, call: str) -> None:
    wanted = contestants.expected(case, call)
    own, k = cases.specialized(case, call)
    assert k.engine == "lanes"
    cases.check(case, call, "k", own, wanted)
    narrow, _ = cases.specialized(case, call, np.float32)
    error = cases.check(case, call, "float32", narrow._replace(single=None), wanted, run.FLOAT32)
    assert error > EPS
    cases.check(case, call, "kernels", cases.Contestant(cases.jitted(case, call), None, read=cases.rows), wanted)


@pytest.mark.parametrize("call", cases.CALLS)
def test_mujoco_answers_the_same(case: cases.Case, call: str) -> None:
    pytest.importorskip("mujoco")
    made = contestants.mujoco(case, call)
    assert made is not None
    cases.check(case, call, "MuJoCo", made, contestants.expected(case, call))


def test_a_wrong_answer_is_found() -> None:
    case = cases.case("2R", SAMPLES)
    wanted = contestants.expected(case, "rnea")
    right = cases.public(case, "rnea")
    assert right.single is not None
    assert right.batch is not None
    first, many = np.array(right.single()), np.array([right.batch()[i][0] for i in range(SAMPLES)])
    spoiled = many.copy()
    spoiled[7, 1] += 1e-8 * abs(many).max()
    for wrong in (
        cases.Contestant(lambda: first + 1e-6, None, read=cases.rows),
        cases.Contestant(None, lambda: spoiled, SAMPLES),
    ):
        with pytest.raises(AssertionError, match="scaled error"):
            cases.check(case, "rnea", "wrong", wrong, wanted)
    cases.check(case, "rnea", "right", cases.Contestant(lambda: first, lambda: many, SAMPLES), wanted)


def test_a_peer_that_fails_is_recorded_and_one_that_errs_too() -> None:
    case = cases.case("2R", SAMPLES)
    wanted = contestants.expected(case, "gravity")

    def fails(case: cases.Case, call: str) -> cases.Contestant:
        raise RuntimeError("cannot hold it\nat all")

    def errs(case: cases.Case, call: str) -> cases.Contestant:
        return cases.Contestant(lambda: np.zeros(2), None)

    assert run.optional(case, "gravity", fails, "peer", wanted) == {"refused": "RuntimeError: cannot hold it"}
    assert "scaled error" in run.optional(case, "gravity", errs, "peer", wanted)["refused"]
    assert run.optional(case, "gravity", lambda case, call: None, "peer", wanted) is None


def test_the_two_chains_are_one() -> None:
    ours, theirs = chains.ours(6), chains.theirs(6)
    q = np.linspace(-1.0, 2.0, 6)
    M = np.array(contestants.pin.crba(theirs, theirs.createData(), q))
    assert abs(sd.crba(ours, q) - M).max() <= CONGRUENT * abs(M).max()


# --- limits and costs -----------------------------------------------------------------------------------


def test_flops_count_a_sine_and_cosine_as_its_polynomials() -> None:
    counted = {"mul": 5, "add": 4, "div": 1, "sqrt": 1, "sincos": 0, "depth": 3}
    assert machine.flops(counted) == 11
    # shift and its undoing 3, three parts of π/2 6, what they leave 3, square 1, polynomials 22, sine 4, cosine 2
    assert machine.flops(counted | {"sincos": 2}) == 11 + 2 * 41


def test_the_limits_of_this_machine_are_positive() -> None:
    assert machine.peak("float") > 0
    assert machine.peak("double") > 0


@compiled
def test_a_program_is_compiled_once_and_then_read() -> None:
    told: list[int] = []
    found = costs.compiling({"2R": ["rnea"]}, lambda: told.append(1))["2R"]["rnea"]
    assert found["engine"] == "lanes"
    assert found["compile_s"] > 0
    assert found["from_disk_s"] > 0
    assert len(told) == 1


@compiled
@pytest.mark.parametrize("name", corpus.CALLS)
def test_the_corpus_script_holds_lanes_within_their_bounds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = sd.load_urdf("three_link")
    how, error, bound = corpus.compared(model, name, 11)
    assert how == "lanes"
    assert error <= bound
    monkeypatch.setattr(corpus, "scaled", lambda x, wanted: 1e-6)
    how, error, bound = corpus.compared(model, name, 11)
    assert (error > bound) == (name not in ("aba", "minverse"))  # there the untraced one is as far off


# --- what is shown --------------------------------------------------------------------------------------


def test_every_row_of_every_table_is_whole(results: dict[str, Any]) -> None:
    found = list(tables.tables(results))
    assert len(found) == 5
    for title, headings, rows in found:
        assert rows
        assert {len(row) for row in rows} == {len(headings)}, title
        text = tables.plain(title, headings, rows)
        assert len(text.splitlines()) == len(rows) + 2


def test_the_kept_figures_are_of_all_robots_and_calls(results: dict[str, Any]) -> None:
    assert list(results["single"]) == list(cases.ROBOTS)
    for robots in (results["single"], results["batch"], results["compile"]):
        assert all(list(calls) == list(cases.CALLS) for calls in robots.values())
    assert set(results["machine"]["peers"]) == set(contestants.MAKE)


# --- libraries in processes of their own -----------------------------------------------------------------


class Turns:
    """A peer's process that counts its turns."""

    def __init__(self, turns: list[str], name: str, lacks: bool = False) -> None:
        self.turns, self.name, self.lacks, self.us = turns, name, lacks, iter((3.0, 1.0, 2.0))

    def ask(self, **request: Any) -> dict[str, Any]:
        if "call" in request:
            return {} if self.lacks else {"error": 0.0, "count": 1, "ways": ["single"]}
        self.turns.append(self.name)
        return {"us": next(self.us)}


def test_processes_take_turns_and_figures_are_medians() -> None:
    turns: list[str] = []
    running: Any = {name: Turns(turns, name, name == "b") for name in "abc"}
    found = peers.of_call(running, "ur5", "rnea", 3, 0.0)
    assert turns == ["a", "c"] * 3
    assert found["a"] == found["c"] == {"error": 0.0, "count": 1, "single_us": 2.0}
    assert found["b"] == {"refused": "has no such call"}


def test_a_peer_is_checked_and_one_that_ends_is_lost(case: cases.Case, monkeypatch: pytest.MonkeyPatch) -> None:
    made = peers.pinocchio(case, "rnea")
    assert peers.checked(case, "rnea", "pinocchio", made)["ways"] == list(peers.WAYS)
    assert made.single is not None
    wrong = made._replace(single=lambda right=made.single: 1.001 * right())
    with pytest.raises(AssertionError, match=r"scaled error .* of pinocchio against Pinocchio"):
        peers.checked(case, "rnea", "pinocchio", wrong)
    monkeypatch.setattr(peers, "HERE", Path("nowhere"))
    process = peers.Process("pinocchio", sys.executable, 1, 60.0)
    assert process.ask()["refused"] == process.ask(robot="ur5", call="rnea")["refused"] != ""
    process.end()


def test_the_kept_figures_have_a_time_or_a_reason_for_every_peer() -> None:
    found = json.loads((BENCHMARKS / "peers.json").read_text(encoding="utf-8"))
    assert list(found["peers"]) == list(peers.PEERS)
    for calls in found["calls"].values():
        assert list(calls) == list(peers.CALLS)[: len(calls)]
        for t in calls.values():
            assert list(t) == [x for x in peers.PEERS if x in t]
            assert all("refused" in x or "single_us" in x or "batch_us" in x for x in t.values())


@pytest.fixture(scope="module")
def kept() -> dict[str, Any]:
    """What a digit costs, as it is kept."""
    found: dict[str, Any] = json.loads((BENCHMARKS / "tradeoff.json").read_text(encoding="utf-8"))
    return found


def test_every_robot_has_its_ways_and_motions_are_of_every_method(kept: dict[str, Any]) -> None:
    models = {**tradeoff.ROBOTS, **tradeoff.EXTREMES}
    assert list(kept["evaluations"]) == list(models)
    assert {"2R", "panda"} <= set(kept["motions"]) <= set(models)
    assert all(found["certainty"] < 1e-18 for found in kept["evaluations"].values())
    for found in kept["motions"].values():
        assert {row["method"] for row in found["runs"]} == set(tradeoff.METHODS)
        assert found["certainty"] <= 1e-12


def test_no_kept_recommendation_broke_its_promise(kept: dict[str, Any]) -> None:
    rows = kept["promise"]["rows"]
    assert len(rows) == len(tradeoff.PROMISED) * 3 * len(tradeoff.TOLERANCES)
    for row in rows:
        assert row["way"] is None or row["error"] <= row["tolerance"]


@compiled
def test_no_recommendation_of_today_breaks_its_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows of ``promise`` of one robot, measured now: of the kept ones alone a broken library would pass."""
    model = cases.load("two_link")
    monkeypatch.setattr(tradeoff, "PROMISED", {"2R": lambda: model})
    monkeypatch.setattr(tradeoff, "FRESH", 60)
    monkeypatch.setattr(tradeoff, "TOLERANCES", (1e-4, 1e-12))
    monkeypatch.setattr(tradeoff, "_beyond", lambda *_: 0.0)
    found = tradeoff.of_promises(False)
    assert found["recommended"] == len(found["rows"]) == 6
    assert found["broken"] == 0
    for row in found["rows"]:
        assert row["error"] <= row["bound"] <= row["tolerance"]


def test_work_precision_figures_of_one_robot_are_drawn(kept: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    written = tradeoff.draw({what: {"panda": kept[what]["panda"]} for what in ("evaluations", "motions")}, tmp_path)
    assert {path.name for path in written} == {"tradeoff_evaluations.png", "tradeoff_robots.png", "tradeoff.png"}
    assert all(path.stat().st_size > 10_000 for path in written)


@pytest.mark.slow(quick="test_work_precision_figures_of_one_robot_are_drawn")
def test_work_precision_figures_are_drawn(kept: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    written = tradeoff.draw(kept, tmp_path)
    assert {"tradeoff_evaluations.png", "tradeoff_robots.png", "tradeoff.png"} <= {path.name for path in written}
    assert all(path.stat().st_size > 10_000 for path in written)


def test_plots_are_written_in_both_forms(results: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    written = plots.draw(results, tmp_path)
    assert sorted(path.name for path in written) == ["chains.png", "chains.svg", "throughput.png", "throughput.svg"]
    assert all(path.stat().st_size > 1000 for path in written)


def test_readme_holds_the_kept_figures_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it does not, ``python benchmarks/readme.py`` writes them."""
    monkeypatch.setattr(sys, "argv", ["readme.py", "--check"])
    assert readme.main() == 0
    text = readme.README.read_text(encoding="utf-8")
    assert readme.counted(text.replace(f"{len(mutants.faults())} faults", "1 faults")) == text
    assert readme.counted(text.replace("short programs", "programs")) != text
    for name in (*readme.MEASURED, *readme.PAGES):
        assert (BENCHMARKS / name.split()[0]).exists(), name


def test_most_batches_are_tens_of_times_faster(results: dict[str, Any]) -> None:
    """As README's first paragraph says, of the kept figures."""
    ratios = [t["ratio"] for calls in results["batch"].values() for t in calls.values()]
    assert np.mean(np.array(ratios) >= 10.0) > 0.8
    assert np.median(ratios) >= 20.0


SCRIPTS = [path for path in sorted(BENCHMARKS.glob("*.py")) if "__main__" in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_every_script_says_what_it_does(script: Path) -> None:
    """``--help`` is argparse's, with the script's own words; it runs nothing."""
    tree = ast.parse(script.read_text(encoding="utf-8"))
    made = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("ArgumentParser")
    ]
    assert len(made) == 1
    described = {keyword.arg: ast.unparse(keyword.value) for keyword in made[0].keywords}["description"]
    assert "__doc__" in described
    assert ast.get_docstring(tree)


@pytest.mark.parametrize("main", [readme.main, lambda: compat.main(["--help"]), plots.main])
def test_help_runs_nothing(main: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["script", "--help"])
    before = (BENCHMARKS.parent / "README.md").read_bytes()
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert "usage:" in capsys.readouterr().out
    assert (BENCHMARKS.parent / "README.md").read_bytes() == before


def test_an_unknown_group_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        compat.main(["tipes"])
    assert "group is 'tipes', expected some of types, panda" in capsys.readouterr().err


class Scripted:
    """In place of ``compat.Checkout``: rounds of three rows, of which ours of the second and third are slower."""

    pairs = 0

    def __init__(self, path: Path, modules: list[str]) -> None:
        self.ours = len(modules) == 2
        Scripted.pairs += self.ours

    def round(self, group: str, expression: str) -> list[float]:
        slower = {"a": 1.05, "b": 1.5, "c": 1.5 if Scripted.pairs == 1 else 1.0}[expression]
        return [2.0, slower] if self.ours else [1.0]

    def close(self) -> None:
        pass


def test_a_row_that_is_slower_in_two_pairs_of_processes_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first is slower by less than the noise, the third in the first pair alone."""
    monkeypatch.setattr(compat, "Checkout", Scripted)
    monkeypatch.setattr(Scripted, "pairs", 0)
    monkeypatch.setattr(compat, "GROUPS", {"types": compat.Group(lambda pin: {}, ["a", "b", "c"])})
    root = str(BENCHMARKS.parent)
    assert compat.main(["types", "--against", root]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines[1:4]] == [
        ["a", "2.000", "1.000", "1.050", "0.53", "1.05"],
        ["b", "2.000", "1.000", "1.500", "0.75", "1.50", "slower"],
        ["c", "2.000", "1.000", "1.500", "0.75", "1.50", "slower"],
    ]
    assert lines[4:] == ["slower than before: types: b"]
    assert compat.main(["types", "--rows", "a", "--against", root]) == 0
    with pytest.raises(SystemExit):
        compat.main(["types", "--against", str(BENCHMARKS)])
    assert "expected a folder with spatialdyn in it" in capsys.readouterr().err


def test_a_process_of_a_checkout_measures_rows(capfd: pytest.CaptureFixture[str]) -> None:
    """Of the wheel's module, whose import is quick; the expressions before a row are called too."""
    measured = compat.Checkout(BENCHMARKS.parent, ["pinocchio"])
    (taken,) = measured.round("types", "M == M")
    assert np.isfinite(taken)
    with pytest.raises(SystemExit, match=r"types: no row: the process of .* ended"):
        measured.round("types", "no row")
    measured.close()
    assert "KeyError: 'no row'" in capfd.readouterr().err


def test_a_row_is_called_after_those_before_it() -> None:
    seen: list[str] = []
    group = compat.Group(lambda module: {"note": seen.append}, [f"note({name!r})" for name in "abc"])
    calls = compat.Calls(group, None)
    calls.prepared("note('b')")
    assert seen == ["a", "b"]
    calls.prepared("note('c')")()
    assert seen == ["a", "b", "c", "c"]


@compiled
def test_rows_of_the_face_time_compiled_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """With an empty cache as with a filled one: an interpreted program takes up to twice as long."""
    pin = importlib.import_module("spatialdyn.compat.pinocchio")
    path = str(sd.urdf.load.find_robot("two_link"))
    model = pin.buildModelFromUrdf(path)
    model.gravity.linear = np.array([0.0, 0.3, -9.6])  # of no other test
    data, q = model.createData(), pin.neutral(model)
    with monkeypatch.context() as patch:
        patch.setattr(TieredProgram, "_at_hand", lambda *given, **named: None)  # as with an empty cache
        pin.forwardKinematics(model, data, q)
        code = model._library.code("forward_kinematics")
        assert code._words[0] == code.program.interpreted.entry
        patch.setattr(compat, "gc", SimpleNamespace(get_objects=lambda: [code.program]))
        compat.compile_all()
    pin.forwardKinematics(model, data, q)
    assert code._words[0] == code.program.compiled(one=True).code.entry


def test_the_first_hour_times_twenty_calls(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """With the wheel's module for both: this package's calls take a minute of compiling."""
    path = str(sd.urdf.load.find_robot("two_link"))
    compat.main(["--first-calls", "pinocchio", path])
    found = json.loads(capsys.readouterr().out)
    assert len(found) == 21  # the import too
    assert min(found.values()) >= 0.0
    seconds = compat.first_seconds("pinocchio", "", "two_link")
    assert list(seconds) == list(found)
    monkeypatch.setattr(compat, "first_seconds", lambda module, cache: found)
    compat.print_first_hour()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 23
    assert lines[-1].split()[:2] == ["in", "all"]


# --- what pictures hold -----------------------------------------------------------------------------------


def test_no_panel_is_empty_and_no_colour_means_two_things(results: dict[str, Any], kept: dict[str, Any]) -> None:
    pytest.importorskip("matplotlib")
    drawn = [plots.throughput(results), plots.chains(results), tradeoff.all_ways(kept["evaluations"])]
    talos = {"talos": kept["motions"]["talos"]}
    drawn += [
        tradeoff.all_runs(talos),
        tradeoff.of_panda(kept["evaluations"]["panda"], kept["motions"]["panda"]["runs"]),
    ]
    for figure in drawn:
        for axes in figure.axes:
            assert axes.lines or axes.texts, axes.get_title()
            if axes.lines:
                assert axes.get_xlabel() or axes.get_xticklabels()
            for axis in (axes.xaxis, axes.yaxis):  # the ticks of a logarithmic axis are powers of ten, far apart
                assert axis.get_scale() == "linear" or len(axis.get_ticklabels(minor=True)) in (
                    0,
                    len(axis.get_ticklocs()),
                )
    assert len(set(tradeoff.COLOURS.values())) == len(tradeoff.COLOURS)


def test_the_front_is_what_nothing_beats() -> None:
    points = [(3.0, 0.1), (1.0, 1.0), (2.0, 2.0), (4.0, 0.1), (2.0, 0.5)]
    assert tradeoff.front_of(points) == [(1.0, 1.0), (2.0, 0.5), (3.0, 0.1)]


# --- faults -----------------------------------------------------------------------------------------------


def test_every_fault_of_the_table_is_still_one_and_rooms_have_theirs_by_their_size() -> None:
    """A fault is a text that is in its file exactly once; its tests are there. No test is run here."""
    table = mutants.faults()
    assert mutants.check(table) == []
    assert len(table) >= 120
    package = Path(sd.__file__).parent
    lines = {
        room.name: sum(len(path.read_text(encoding="utf-8").splitlines()) for path in room.rglob("*.py"))
        for room in package.iterdir()
        if (room / "__init__.py").exists()
    }
    whole = sum(lines.values())
    for room, size in lines.items():
        share = sum(x.room == room for x in table) / len(table)
        assert share >= size / whole / 3.0, f"{room} has {share:.1%} of the faults and {size / whole:.1%} of the lines"


def test_a_table_of_faults_that_cannot_be_read_is_named_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "table.txt"
    path.write_text("model/mimic.py\n- a\n+ b\n! model/test_model.py\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"line 4 is '! model/test_model.py', expected one that begins with"):
        mutants.faults(path)
    path.write_text("# faults\n\nmodel/mimic.py\n- a\n+ b\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"the fault of line 3 has 1 -, 1 \+, expected one each, and \? or ="):
        mutants.faults(path)
    path.write_text("model/mimic.py\n- offset\n+ b\n? plain model/test_model.py -k nowhere_at_all\n", encoding="utf-8")
    (wrong,) = mutants.check(mutants.faults(path))
    assert wrong.startswith("line 1, model/mimic.py: 'offset' is there ")


def test_a_fault_is_put_into_a_copy_and_taken_out_again(tmp_path: Path) -> None:
    file = tmp_path / "spatialdyn" / "errors.py"
    file.parent.mkdir()
    text = (Path(sd.__file__).parent / "errors.py").read_bytes()
    file.write_bytes(text)
    before = file.stat().st_mtime_ns
    fault = mutants.Fault(
        "errors.py", "class SpatialDynError(ValueError):", "class SpatialDynError(TypeError):", (), "", 1
    )
    with mutants.put(tmp_path, fault):
        assert b"class SpatialDynError(TypeError):" in file.read_bytes()
    assert file.read_bytes() == text
    assert file.stat().st_mtime_ns == before


@compiled
def test_the_gpu_script_compares_bits_and_names_the_card(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """By a driver that is none; without it the script says so."""
    kept = tmp_path / "gpu.json"
    monkeypatch.setattr(sys, "argv", ["gpu.py", "--quick", "--urdf", "two_link", "--save", str(kept)])
    fake_gpu.install(monkeypatch)
    small = {"SAMPLES": 512, "ROUNDS": 1, "COMPARED": 64, "STEPS": 3, "ROLLOUTS": 64, "COPIED": 64, "CHAINED": 64}
    for name, value in {**small, "DEEP": 2, "CALLS": ("rnea",)}.items():
        monkeypatch.setattr(gpu, name, value)
    gpu.main()
    found = json.loads(kept.read_text(encoding="utf-8"))
    assert found["card"] == "no GPU"
    assert [row["call"] for row in found["rows"]] == ["rnea", "rollout"] * 2
    assert all(row["bits equal"] for row in found["rows"])
    assert "G samples/s" in capsys.readouterr().out


def test_without_a_gpu_the_script_measures_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(SystemExit, match="0"):
        gpu.library()
    assert capsys.readouterr().out == "no GPU with PyTorch or CuPy here: nothing is measured\n"


def test_a_client_that_sleeps_and_reads_lines_runs_to_its_last_input(tmp_path: Path) -> None:
    """What a viewer prints of its address is no number of the client."""
    script = tmp_path / "examples" / "client.py"
    script.parent.mkdir()
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "beside.py").write_text("WAIT = 1e6\n", encoding="utf-8")
    lines = ["import time, pinocchio, beside", "asked = 0.0", "print('http://127.0.0.1:7000/static/ 2.5')"]
    lines += ["while True:", "    time.sleep(beside.WAIT)", "    asked += 1.0", "    answer = input('again?')"]
    script.write_text("\n".join(lines), encoding="utf-8")
    fault, report = clients.outcome("script", script, tmp_path, "wheel", 100.0)
    assert fault == ""
    found = pickle.loads(report)
    assert found[clients.PRINTED].tolist() == [2.5]
    assert float(found["asked"]) == clients.ANSWERS + 1


def test_friction_is_judged_by_the_law_of_the_step_with_a_floating_base_too() -> None:
    robot = cases.case("anymal", 4)
    model, q, v = robot.ours, robot.state["q"], 0.3 * robot.state["v"]
    tau = np.repeat(sd.generalized_gravity(model, q)[:, None], 6, axis=1)
    solved, worst = friction.coulomb("anymal", model, q, v, tau, friction.friction_of(model))
    assert solved == 1.0
    assert worst <= friction.SOLVED["anymal"]
