"""Public names and their parameters are those of ``public_names.txt``; what changes is named in the CHANGELOG.

``python tests/test_public_names.py`` writes the snapshot anew, once *Unreleased* in ``.github/CHANGELOG.md`` names each
public name that has changed, in backticks.
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import Any

import pytest

import spatialdyn as sd

ROOT = Path(__file__).parent.parent
SNAPSHOT, CHANGELOG = Path(__file__).parent / "public_names.txt", ROOT / ".github" / "CHANGELOG.md"


def parameters(thing: Any) -> str:
    """The parameters of a callable as text, without annotations; defaults by their values."""
    try:
        given = inspect.signature(thing).parameters.values()
    except (TypeError, ValueError):
        return "(...)"
    return str(inspect.Signature([x.replace(annotation=x.empty, default=_shown(x.default)) for x in given]))


def _shown(default: Any) -> Any:
    """A default as it is kept: none, its value, or ``...`` for one that prints differently on each machine."""
    return default if default is inspect.Parameter.empty or _plain(default) else ...


def _plain(x: Any) -> bool:
    """Whether a default prints as itself on every machine."""
    return x is None or isinstance(x, (bool, int, float, str)) or (isinstance(x, tuple) and all(map(_plain, x)))


def lines() -> list[str]:
    """A line for each public name, and one for each public method and property of a class."""
    found = []
    for name in sorted(sd.__all__):
        thing = getattr(sd, name)
        if not inspect.isclass(thing):
            found.append(name + parameters(thing) if callable(thing) else name)
            continue
        found.append(name if issubclass(thing, BaseException) else name + parameters(thing))
        for member, value in sorted(vars(thing).items()):
            if member.startswith("_"):
                continue
            called = isinstance(value, (classmethod, staticmethod)) or inspect.isfunction(value)
            found.append(f"{name}.{member}" + (parameters(getattr(thing, member)) if called else ""))
    return found


def public_name(line: str) -> str:
    """The public name that a line is of."""
    return line.partition("(")[0].partition(".")[0]


def changed(old: list[str], new: list[str]) -> list[str]:
    """Public names whose lines differ."""
    return sorted({public_name(x) for x in {*old} ^ {*new}})


def unreleased(text: str) -> str:
    """The part of a changelog on what is not released."""
    return text.partition("## Unreleased")[2].partition("\n## ")[0]


def unnamed(names: list[str], text: str) -> list[str]:
    """Those of the names that the changelog's newest part does not have in backticks."""
    said = set(re.findall(r"[A-Za-z_]\w*", " ".join(re.findall(r"`([^`]+)`", unreleased(text)))))
    return [x for x in names if x not in said]


def test_public_names_and_parameters_are_those_of_the_snapshot() -> None:
    old, new = SNAPSHOT.read_text(encoding="utf-8").splitlines(), lines()
    assert changed(old, new) == [], "name them in .github/CHANGELOG.md, then run python tests/test_public_names.py"
    assert old == new


def test_a_change_is_found_and_wants_a_line_in_the_changelog() -> None:
    new = lines()
    old = [x.replace("rnea(model, q, v, a", "rnea(model, q, v, a, old") for x in new]
    assert changed(old, new) == ["rnea"]
    assert changed(new, [*new, "Model.more(self)"]) == ["Model"]
    text = "## Unreleased\n* `rnea(fext=)` takes more.\n\n## 0.1.0\n* `Model`\n"
    assert unnamed(["Model", "rnea"], text) == ["Model"]


def test_the_changelog_has_the_version_that_is_released() -> None:
    if not CHANGELOG.exists():
        pytest.skip("an installed package has no changelog")
    text = CHANGELOG.read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE)[:2] == ["Unreleased", sd.__version__]
    assert unnamed(["load", "from_mjmodel", "to_urdf", "to_mjcf"], text) == []


if __name__ == "__main__":
    before = SNAPSHOT.read_text(encoding="utf-8").splitlines() if SNAPSHOT.exists() else []
    missing = unnamed(changed(before, lines()) if before else [], CHANGELOG.read_text(encoding="utf-8"))
    if missing:
        sys.exit(f"Unreleased in {CHANGELOG.name} does not name {', '.join(missing)}, expected a line on each")
    SNAPSHOT.write_text("\n".join(lines()) + "\n", encoding="utf-8")
