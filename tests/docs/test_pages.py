"""Pages: their code runs and prints what they say, their pictures, names and tests are there, the site is whole."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from plain import compiled

import spatialdyn as sd
from spatialdyn.commands import cli
from spatialdyn.docs import algorithms, blocks, gallery_pages, public_names, site
from spatialdyn.errors import SpatialDynError
from spatialdyn.examples import gallery
from spatialdyn.recursions import SPECS
from spatialdyn.urdf.load import example_robots

TESTS, ROOT = Path(__file__).parent.parent, Path(sd.__file__).parents[1]
# seconds of compiling or of work on each; the others wait a second at most
LONG = ("choosing", "cookbook/follow_a_path", "cookbook/cart_pole", "cookbook/four_bar", "cookbook/float32",
        "cookbook/quadruped", "cookbook/damping", "cookbook/whole_body", "cookbook/adaptation")  # fmt: skip
# programs, or simulations
COMPILED = ("cookbook/c_code", "cookbook/gpu", "cookbook/gravity_torques", "cookbook/identify", "cookbook/study",
            "inside/law")  # fmt: skip
SHEETS = [x for x in blocks.pages() if x.startswith("coming_from/") and x != "coming_from/index"]  # test_coming_from.py
PAGES = [x for x in blocks.pages() if x not in SHEETS and "```python" in blocks.read(x)]
SHORT = [x for x in PAGES if x not in LONG]
PACKAGES = ("casadi", "matplotlib", "mujoco", "pinocchio")
OWN = ("two_link", "three_link", "pendulum", "tree", "floating_body")
OUTSIDE = ("https://www.sphinx-doc.org", "https://pradyunsg.me", "https://github.com", "data:")  # what the theme names
PICTURES = {"panda", "solo12", "tradeoff"}  # drawn by no page


def needs(page: str) -> None:
    """Skip a page whose packages or robots are not installed."""
    code = "\n".join(x.text for x in blocks.blocks(blocks.read(page)))
    for package in PACKAGES:
        if re.search(rf"import {package}\b", code) and importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
    if {*re.findall(r'load\("(\w+)"', code)} - {*OWN} and not example_robots():
        pytest.skip("robots of example-robot-data are not installed")
    if "sd.lqr" in code:
        pytest.importorskip("scipy")
    if "sd.WholeBody" in code:
        pytest.importorskip("daqp")
        pytest.importorskip("qpsolvers")
    if ".plot(" in code:
        pytest.importorskip("matplotlib")
    if "sd.view(" in code:
        pytest.importorskip("viser")
    if re.search(r"sd\.(exact|trade|recommend)\(", code):
        pytest.importorskip("mpmath")


def holds(page: str, folder: Path) -> None:
    """A page's code runs in a folder and prints what it says; the pictures that it shows are drawn by it."""
    needs(page)
    assert blocks.run(page, cli.main) == []
    shown = set(re.findall(r"_static/pages/(\w+)\.png", blocks.read(page)))
    assert shown == {x.stem for x in folder.glob("*.png")}


@pytest.mark.parametrize("page", [pytest.param(x, marks=compiled) if x in COMPILED else x for x in SHORT])
def test_what_a_page_prints_is_what_comes_out(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    holds(page, tmp_path)


@pytest.mark.slow(quick="test_what_a_page_prints_is_what_comes_out")
@pytest.mark.parametrize("page", LONG)
def test_what_a_longer_page_prints_is_what_comes_out(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    holds(page, tmp_path)


def test_every_page_is_run_and_a_wrong_one_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All blocks of code are in pages that a test runs, and no other language is there that none runs."""
    assert {*LONG} <= {*PAGES}
    for page in blocks.pages():
        languages = {x.language for x in blocks.blocks(blocks.read(page))}
        assert languages <= {"python", "bash"}, page
        assert page in (*PAGES, *SHEETS) or not languages, page
    monkeypatch.setattr(blocks, "PAGES", tmp_path)
    lines = ["```python", "print(1)", "```", "", "```text", "1", "```", "", "```python", "print(1 + 1)", "```"]
    (tmp_path / "made.md").write_text("\n".join([*lines, "", "```text", "3", "```", ""]), encoding="utf-8")
    assert blocks.run("made", cli.main) == [blocks.Difference(9, "3\n", "2\n")]
    (tmp_path / "made.md").write_text("\n".join([*lines, ""]), encoding="utf-8")
    assert blocks.run("made", cli.main) == [blocks.Difference(9, "", "2\n")]
    (tmp_path / "made.md").write_text("```bash\nspatialdyn info no_robot\n```\n", encoding="utf-8")
    with pytest.raises(RuntimeError, match="info no_robot ends with status 2"):
        blocks.run("made", cli.main)


def test_pictures_are_those_that_pages_show() -> None:
    texts = "\n".join(map(blocks.read, blocks.pages()))
    shown = set(re.findall(r"_static/([\w/]+)\.png", texts))
    folder = site.HOME / "pictures"
    kept = {x.relative_to(folder).with_suffix("").as_posix() for x in folder.rglob("*.png")}
    assert {x for x in kept if not x.startswith("gallery/")} == shown
    assert {x for x in shown if "/" not in x} == PICTURES


def test_the_gallery_has_times_of_examples_and_their_pictures() -> None:
    found = gallery_pages.times()
    assert {*found["machine"]} == {"processor", "cores", "system", "python", "numba"}
    timed = [*found["examples"]]
    assert timed == [x for x in gallery.names() if x in timed]
    assert len(timed) > 40  # python benchmarks/gallery.py NAME ... adds others
    for name, one in found["examples"].items():
        assert one["picture"] == (gallery_pages.picture(name) is not None), name
        assert gallery_pages.page(name).startswith("# "), name
    assert {x.stem for x in gallery_pages.PICTURES.glob("*.png")} <= {*gallery.names()}


def test_every_public_name_is_on_one_page_with_its_line() -> None:
    listed = [name for names in public_names.groups().values() for name in names]
    assert sorted(listed) == sorted(sd.__all__)
    given = [x for group in public_names.GROUPS.values() for x in group.names.split()]
    assert len(given) == len({*given})
    assert {*given} <= {*sd.__all__}
    index = public_names.index()
    for page, names in public_names.groups().items():
        text = public_names.page(page)
        for name in names:
            assert re.search(rf"^\.\. py:\w+:: {name}\b", text, re.MULTILINE), name
            assert f"<spatialdyn.{name}>`" in index, name


def test_every_algorithm_has_its_row_and_file() -> None:
    text = algorithms.page()
    assert {*re.findall(r"^\| `sd\.(\w+)`", text, re.MULTILINE)} == {*SPECS}
    for path in re.findall(r"`(recursions/[\w/]+\.py)`", text):
        assert (Path(sd.__file__).parent / path).exists(), path


def test_the_tests_that_hold_claims_are_there() -> None:
    claims = re.findall(r"^\| .+ \| `([\w/]+\.py)::(test_\w+)` \|$", blocks.read("inside/claims"), re.MULTILINE)
    assert len(claims) > 40
    for file, name in claims:
        assert f"\ndef {name}(" in (TESTS / file).read_text(encoding="utf-8"), (file, name)


def test_the_list_of_packages_is_whole() -> None:
    rows = re.findall(r"^\| (`.+`) \| ", blocks.read("inside/index"), re.MULTILINE)
    listed = [x for row in rows for x in re.findall(r"`(\w+)`", row)]
    assert sorted(listed) == sorted(x.parent.name for x in Path(sd.__file__).parent.glob("*/__init__.py"))


def test_files_that_pages_name_are_there() -> None:
    texts = "\n".join(map(blocks.read, blocks.pages()))
    named = set(re.findall(r"`(?:python )?((?:tests|benchmarks|spatialdyn)/[\w/]+\.py)", texts))
    assert len(named) > 5
    if (ROOT / "benchmarks").is_dir():
        assert [x for x in sorted(named) if not (ROOT / x).exists()] == []


def test_the_page_of_figures_is_that_of_the_kept_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    if not (ROOT / "benchmarks").is_dir():
        pytest.skip("an installed package has no benchmarks")
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import pages

    assert pages.figures() == blocks.read("how_fast_how_right"), "python benchmarks/pages.py writes it"


def test_a_missing_builder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(site, "NEEDED", ("no_such_builder",))
    with pytest.raises(SpatialDynError, match="no_such_builder is not installed; pip install sphinx"):
        site.build(tmp_path)


class Links(HTMLParser):
    """Addresses that a page leads to, and the places that it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.to: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if key in ("href", "src") and value:
                self.to.append(value)
            elif key in ("id", "name") and value:
                self.places.add(value)


@pytest.mark.slow(quick="test_every_public_name_is_on_one_page_with_its_line")
def test_the_site_is_built_without_a_warning_has_no_dead_link_and_needs_no_network(tmp_path: Path) -> None:
    for package in site.NEEDED:
        pytest.importorskip(package)
    # in a process of its own: Sphinx's packages warn, and warnings are errors here
    run = [sys.executable, "-m", "spatialdyn", "docs", "--output", str(tmp_path / "site")]
    outside = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    done = subprocess.run(run, capture_output=True, text=True, check=False, cwd=tmp_path, env=outside)
    assert done.returncode == 0, done.stderr
    made = {x.resolve(): Links(x.read_text(encoding="utf-8")) for x in (tmp_path / "site").rglob("*.html")}
    assert len(made) > len(blocks.pages()) + len(gallery.names()) + len(public_names.GROUPS)
    dead = []
    for page, links in made.items():
        for link in links.to:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                assert link.startswith(OUTSIDE), link
                continue
            to = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            here = to in made and parts.fragment and unquote(parts.fragment) not in made[to].places
            if not to.exists() or (here and to.name not in ("search.html", "genindex.html")):
                dead.append((page.name, link))
    assert dead == []
    scripts = [x for links in made.values() for x in links.to if x.endswith((".js", ".css")) and "//" in x]
    assert scripts == []
    index = (tmp_path / "site" / "searchindex.js").read_text(encoding="utf-8")
    assert "crba" in index
    assert "quadruped" in index


def test_the_command_says_where_the_site_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from spatialdyn.commands import docs

    monkeypatch.setattr(docs, "build", lambda output: Path(output) / "index.html")
    assert cli.main(["docs", "--output", "there"]) == 0
    assert capsys.readouterr().out == f"built   {Path('there') / 'index.html'}\n"
