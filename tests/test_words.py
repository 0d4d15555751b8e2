"""Words: prose names the thing it is about.

Docstrings, comments, strings, function names and README are searched for pronouns that speak of code as of people.
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


class Found(NamedTuple):
    """A word in a file: its line and the text around it."""

    line: int
    text: str


def files() -> list[Path]:
    """The sources and README, but this file."""
    found = [path for folder in ("spatialdyn", "benchmarks", "tests") for path in (ROOT / folder).rglob("*.py")]
    return sorted({*found, ROOT / "README.md"} - {Path(__file__).resolve(), Path(__file__)})


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


def test_code_is_not_spoken_of_as_people() -> None:
    assert {path: found for path in files() if (found := people(path))} == {}


def test_exceptions_are_needed() -> None:
    for (name, text), reason in OF_PEOPLE.items():
        assert PEOPLE.search(text), name
        assert reason
        assert any(text in found.text for found in prose(ROOT / name)), (name, text)


def test_the_search_finds_what_it_is_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In each kind of text and name, over line ends, once each."""
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    path = tmp_path / "spatialdyn" / "compat" / "made.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        '"""Read by whoever asks."""\n\n\ndef made():\n    # what somebody\n    # else is\n    # told of\n'
        '    raise ValueError(f"{1} nobody")\n\n\nclass test_who:\n    again = 1\n'
    )
    assert len(people(path)) == 6  # whoever, asks, somebody, is told, nobody, test_who
    path.write_text('"""The caller, the wholesome body: told apart."""\n\n\ndef f():\n    made = 1\n    return made\n')
    assert people(path) == []
