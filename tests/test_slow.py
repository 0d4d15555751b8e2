"""Tests that wait for ``-m slow`` have a quick one of the same claim."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).parent
MARK = re.compile(r"^(?:@.*\n)*?@pytest\.mark\.slow(.*)\n(?:@.*\n|[ )].*\n)*def (test_\w+)", re.MULTILINE)


def test_each_slow_test_names_a_quick_one_that_is_there() -> None:
    seen = 0
    for path in TESTS.rglob("test_*.py"):
        text = path.read_text(encoding="utf-8")
        for given, name in MARK.findall(text):
            named = re.fullmatch(r'\(quick="(?:(.+)::)?(test_\w+)"\)', given)
            assert named, f"{path.name}: {name} names no quick test"
            folder, quick = named.groups()
            there = text if folder is None else (TESTS / folder).read_text(encoding="utf-8")
            assert f"\ndef {quick}(" in there, f"{path.name}: {name} names {quick}, which is not there"
            assert quick not in {name for _, name in MARK.findall(there)}, f"{path.name}: {quick} is slow itself"
            seen += 1
        assert text.count("pytest.mark.slow") == len(MARK.findall(text)) or path == Path(__file__), path.name
    assert seen


def test_only_files_that_say_slow_have_slow_tests() -> None:
    """``-m slow`` collects no others: a file of helpers that makes the mark has the word in its name."""
    helpers = [path for path in TESTS.rglob("*.py") if not path.name.startswith("test_")]
    assert [path.name for path in helpers if "mark.slow" in path.read_text(encoding="utf-8")] == ["slow.py"]
