"""Words: prose names the thing it is about, and code goes by the names it was given last.

Docstrings, comments, strings, function names and README are searched for pronouns that speak of code as of people, and
definitions for names that a clearer one has replaced.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
PEOPLE = re.compile(
    r"\b(who|whom|whoever|(some|no|any|every)body|someone|anyone|everyone"
    r"|(is|are|be|been|being|was|were) (told(?! apart)|said of)|asks)\b",
    re.IGNORECASE,
)
NAMES = re.compile(r"(^|_)(who|whom|whoever|(some|no|any|every)body|someone|anyone|everyone|told(?!_apart)|asks)(_|$)")

# In a file without these words, whole or between underscores, neither finds anything, and nothing is taken apart.
HINT = re.compile(
    r"(?<![a-z])(who|whom|whoever|(some|no|any|every)body|(some|any|every)one|told|said|asks)(?![a-z])", re.IGNORECASE
)

# Where such words are of people: (file, text) -> reason. One that is not needed any more is an error.
OF_PEOPLE: dict[tuple[str, str], str] = {
    ("spatialdyn/engines/compiled/disk_cache.py", "who may write"): "users of the operating system",
    ("tests/engines/compiled/test_disk_cache.py", "who may write"): "users of the operating system",
}

# Names of functions, classes and module variables, by the room where a clearer name has replaced them.
RENAMED: dict[str, dict[str, str]] = {
    "algebra": {
        "inlined": "inline", "woven": "inline_unoptimized", "called": "no_inline", "summed": "series_or_closed",
        "Rot": "Mat3", "plus": "add", "minus": "sub", "times": "scale", "negative": "neg", "shifted": "parallel_axis",
        "without": "subtract_outer", "coupled": "coriolis_times", "coupled_back": "coriolis_transpose_times",
        "Coupling": "CoriolisFactor", "rate_of_spin": "newton_euler_moment", "spin_matrix": "acceleration_matrix",
        "public_motion": "write_motion", "get_motion": "read_motion", "carried_back": "inverse_adjoint",
    },
    "bodies": {"FOLLOW": "CONTINUED"},
    "recursions": {
        "articulated_inward": "aba_inward", "articulated_again": "aba_resolve", "articulated_outward": "aba_outward",
        "in_branch_axes": "to_root_aligned_axes", "referred": "express_in", "of_point": "classical_acceleration",
    },
    "engines": {
        "Weaving": "InliningUnoptimized", "opened": "user_kernel", "Kept": "NumbaCache",
        "never_mind": "discard", "refused": "unavailable",
        "apart": "no_overlap", "sound_pivots": "pivots_regular", "Choice": "ProgramOptions", "Recorded": "Recording",
        "Layout": "KernelLayout", "Range": "Float32Range", "padded": "round_up", "team": "thread_pool",
        "Twofold": "DoubleDouble", "Ratio": "ExactRational",
        "_kept": "_programs", "_from_disk": "_from_disk_cache", "KEPT": "CACHE_SIZE",
        "_alive": "_eliminate_dead", "_fused": "_fuse_products", "doubled": "to_double_double", "Loaded": "LoadedCode",
        "assembled": "object_code", "FAR": "MAX_ANGLE", "LIGHT": "LEAST_MASS_RATIO", "quick_sum": "fast_two_sum",
        "unfused": "compile_unfused", "at_once": "compute_on_lanes", "by_table": "run_table_kernel",
        "Lanes": "CallProgram", "joined": "concatenate_failed", "_once": "_done",
    },
    "calls": {
        "rows_of": "flatten_batch", "frame_of": "frame_row_and_placement", "reference_of": "reference_code",
        "refuse_singular": "raise_if_singular", "Task": "SpecializeRequest",
        "words": "as_words", "shown": "shape_text",
        "task_of": "read_request", "KINDS": "EXTRA_INPUTS", "no_inertia": "zero_inertia_message",
        "general": "checked_call", "_public": "_public_function",
    },
    "model": {"numbers": "floats", "pose": "pose_from_matrix", "matrix": "matrix_from_pose"},
    "lagrangian": {
        "Exact": "ExactRobot", "exact": "exact_robot", "subspace": "motion_subspace", "Numbers": "NumberArray",
        "first_kind": "christoffel_from_gradient", "along": "coriolis_from_christoffel",
        "inverse": "adjugate_and_determinant", "KINDS": "PARAMETER_KINDS", "chosen": "chosen_values",
    },
    "interop": {"Names": "Aliases", "Change": "Conversion"},
    "simulation": {
        "note": "set_status", "trouble": "status", "hold": "hold_torque", "enter": "to_canonical",
        "leave": "from_canonical", "recentre": "recenter", "Driven": "StepInput", "driving": "forcing",
        "driven": "forced", "quicken": "anderson_step", "settled": "converged", "_half": "_solve_half",
        "along": "add_scaled", "Motion": "ReferenceMotion", "_enter_rotation": "_rotation_to_canonical",
    },
    "accuracy": {
        "Way": "Candidate", "ways": "candidates", "further": "confirm", "drawn": "is_count", "marked": "mark_pareto",
        "off": "motion_error", "bound": "error_bound",
    },
    "validate": {"size": "sort_key"},
    "commands": {"CALLS": "PROGRAM_CALLS", "numbers": "parse_numbers"},
    "compat": {
        "Made": "LibraryModel", "Given": "ModelNumbers", "Placed": "FramePlacements", "made": "library_model",
        "placed": "frame_placements", "prepared": "library_of", "perform": "compute",
        "quick": "fast_call", "live": "hold", "redo": "note_builtin_call", "refresh": "recompute_held",
        "_attach": "_bind_held", "kept": "recorded_call", "again": "recompute", "placing": "place_frames",
        "moving": "frame_motion", "Live": "TrackedArray", "Owned": "OwnedList", "owned": "owned_copy",
        "operation": "on_arrays",
    },
}  # fmt: skip


class Found(NamedTuple):
    """A word in a file: its line and the text around it."""

    line: int
    text: str


def files() -> list[Path]:
    """The sources and README, but this file."""
    found = [path for folder in ("spatialdyn", "benchmarks", "tests") for path in (ROOT / folder).rglob("*.py")]
    return sorted({*found, ROOT / "README.md"} - {Path(__file__).resolve(), Path(__file__)})


def room_of(path: Path) -> str:
    """The room of a file: a folder of spatialdyn/ or tests/, "benchmarks", or "root"."""
    parts = path.relative_to(ROOT).parts
    if parts[0] in ("spatialdyn", "tests"):
        return parts[1] if len(parts) > 2 else "root"
    return "benchmarks" if parts[0] == "benchmarks" else "root"


def prose(path: Path) -> Iterator[Found]:
    """Comments, docstrings and other strings, with line ends as spaces."""
    source = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield Found(1, " ".join(source.split()))
        return
    comments: list[Found] = []  # those on consecutive lines are one text
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            line, text = token.start[0], token.string.lstrip("# ")
            if comments and line == comments[-1].line + comments[-1].text.count("\n") + 1:
                comments[-1] = comments[-1]._replace(text=f"{comments[-1].text}\n{text}")
            else:
                comments.append(Found(line, text))
    strings = [
        Found(node.lineno, node.value)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    for found in (*comments, *strings):
        yield found._replace(text=" ".join(found.text.split()))


def defined(path: Path) -> Iterator[Found]:
    """Names of functions and classes, wherever they are, and of module variables."""
    if path.suffix == ".py":
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                yield Found(node.lineno, node.name)
        for statement in tree.body:
            if isinstance(statement, (ast.Assign, ast.AnnAssign)):
                targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                for name in (node for target in targets for node in ast.walk(target)):
                    if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store):
                        yield Found(statement.lineno, name.id)


def people(path: Path) -> list[Found]:
    """Words for people in a file's prose and names, the named exceptions left out."""
    if not HINT.search(path.read_text(encoding="utf-8")):
        return []
    name = path.relative_to(ROOT).as_posix()
    exceptions = [text for file, text in OF_PEOPLE if file == name]
    found = []
    for line, text in prose(path):
        for exception in exceptions:
            text = text.replace(exception, "")
        found += [Found(line, text[max(0, x.start() - 40) : x.end() + 40]) for x in PEOPLE.finditer(text)]
    return found + [x for x in defined(path) if NAMES.search(x.text)]


def old_names(path: Path) -> list[Found]:
    """Names that a file defines and that its room has renamed."""
    table = RENAMED.get(room_of(path), {}) if path.parts[len(ROOT.parts)] == "spatialdyn" else {}
    text = path.read_text(encoding="utf-8")
    if not any(name in text for name in table):
        return []
    return [Found(line, f"{name}, now {table[name]}") for line, name in defined(path) if name in table]


def test_code_is_not_spoken_of_as_people() -> None:
    assert {path: found for path in files() if (found := people(path))} == {}


def test_replaced_names_do_not_return() -> None:
    assert {path: found for path in files() if (found := old_names(path))} == {}


@pytest.mark.parametrize("room", sorted(RENAMED))
def test_names_of_the_table_are_in_use(room: str) -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "spatialdyn" / room).rglob("*.py"))
    missing = [name for name in RENAMED[room].values() if not re.search(rf"\b{name}\b", text)]
    assert missing == []


def test_exceptions_are_needed() -> None:
    for (name, text), reason in OF_PEOPLE.items():
        assert PEOPLE.search(text), name
        assert reason
        assert any(text in found.text for found in prose(ROOT / name)), (name, text)


def test_rooms_of_the_table_exist() -> None:
    assert {room_of(path) for path in files()} >= set(RENAMED)


def test_the_search_finds_what_it_is_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In each kind of text and name, over line ends, once each."""
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    path = tmp_path / "spatialdyn" / "compat" / "made.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        '"""Read by whoever asks."""\n\n\ndef made():\n    # what somebody\n    # else is\n    # told of\n'
        '    raise ValueError(f"{1} nobody")\n\n\nclass test_who:\n    again = 1\n\n\nquick = 2\n'
    )
    assert len(people(path)) == 6  # whoever, asks, somebody, is told, nobody, test_who
    assert [x.text for x in old_names(path)] == ["made, now library_model", "quick, now fast_call"]
    path.write_text('"""The caller, the wholesome body: told apart."""\n\n\ndef f():\n    made = 1\n    return made\n')
    assert people(path) == old_names(path) == []
