"""README.md: what it shows is what comes out, and what it names is there."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import spatialdyn as sd
from spatialdyn.interop.names import suggestion

README = Path(sd.__file__).parents[1] / "README.md"
if not README.exists():
    pytest.skip("an installed package has no README.md", allow_module_level=True)
TEXT = README.read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


def printing() -> list[tuple[str, str]]:
    """Python blocks with the block of text right behind each: what it prints."""
    return re.findall(r"```python\n(.*?)```\n+```text\n(.*?)```", TEXT, re.DOTALL)


def test_the_first_answers_are_those_that_are_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shown = [(code.rpartition("```python\n")[2], text) for code, text in printing()]
    assert any("sd.crba" in code for code, _ in shown)
    for code, text in shown:
        if "sd.view(" in code:
            pytest.importorskip("viser")
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(code, {})
        assert printed.getvalue() == text


def test_what_the_scene_requires_is_gravity_alone() -> None:
    (code,) = [x for x in blocks("python") if "sd.requires(" in x]
    names: dict[str, Any] = {"sd": sd}
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(code, names)
    assert names["found"].scene.acts == ()
    assert re.search(r"^gravity .* needed", printed.getvalue(), re.MULTILINE)


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
    shown = set(re.findall(r"`sd\.(\w+)", TEXT)) - {
        "mass_matrix",
        "ik",
        "collision",
        "load_mjcf",
    }  # shown as names that are not there
    assert shown <= set(sd.__all__)


# --- the blocks that CI runs ------------------------------------------------------------------------------


def listed(root: Path) -> subprocess.CompletedProcess[str]:
    """What ``.ci/run --list`` says in a folder."""
    return subprocess.run(["bash", str(root / ".ci" / "run"), "--list"], capture_output=True, text=True, check=False)


@pytest.mark.skipif(os.name == "nt" or not (README.parent / ".ci" / "run").exists(), reason="no .ci/run")
def test_ci_runs_the_marked_blocks_and_no_other(tmp_path: Path) -> None:
    compare, test = marked = re.findall(r"^<!-- ci -->\n```bash\n(.*?)```$", TEXT, re.DOTALL | re.MULTILINE)
    assert "spatialdyn compare" in compare
    assert test.endswith("python -m pytest\n")
    assert listed(README.parent).stdout == "".join(marked)

    (tmp_path / ".ci").mkdir()
    shutil.copy(README.parent / ".ci" / "run", tmp_path / ".ci")
    more = "\n```bash\nfalse\n```\n\n<!-- ci -->\n```python\nfalse\n```\n"
    (tmp_path / "README.md").write_text(more + TEXT + more, encoding="utf-8")
    assert listed(tmp_path).stdout == "".join(marked)
    for text in (TEXT.replace("<!-- ci -->", "", 1), TEXT + "\n<!-- ci -->\n```bash\nfalse\n```\n"):
        (tmp_path / "README.md").write_text(text, encoding="utf-8")
        refused = listed(tmp_path)
        assert refused.returncode == 1
        assert refused.stderr == "README.md has not two blocks behind <!-- ci -->\n"
