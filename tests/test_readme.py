"""README.md: what it shows is what comes out, and what it names is there."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

import spatialdyn as sd
from spatialdyn.interop.names import suggestion

README = Path(sd.__file__).parents[1] / "README.md"
if not README.exists():
    pytest.skip("an installed package has no README.md", allow_module_level=True)
TEXT = README.read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


def test_the_first_answer_is_the_one_that_is_printed() -> None:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(blocks("python")[0], {})
    assert printed.getvalue() == blocks("text")[0]


def test_names_of_the_table_lead_where_it_says() -> None:
    rows = [row.strip("|").split("|") for row in TEXT.splitlines() if re.match(r"\| [^`]+ \| `\w+` \|", row)]
    assert len(rows) >= 10
    for _, ours, *others in rows:
        assert callable(getattr(sd, ours.strip(" `")))
        for other in {cell.strip(" `") for cell in others} - {"", ours.strip(" `")}:
            assert suggestion(other, ()) == f"did you mean {ours.strip(' `')}"


def test_links_lead_to_files() -> None:
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXT) if "://" not in link]
    assert len(links) > 15
    assert [link for link in links if not (README.parent / link).exists()] == []


def test_every_public_name_that_is_shown_is_there() -> None:
    shown = set(re.findall(r"`sd\.(\w+)", TEXT)) - {"mass_matrix"}  # shown as a name that is not there
    assert shown <= set(sd.__all__)
