"""What stands beside the package: workflows and forms are valid, versions agree, the built files run README's lines."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

import spatialdyn as sd

ROOT = Path(__file__).parent.parent
GITHUB = ROOT / ".github"
FORMS = {
    "vendor.github-workflows": "workflows/*.yml",
    "custom.github-workflows-require-timeout": "workflows/*.yml",
    "vendor.github-issue-config": "ISSUE_TEMPLATE/config.yml",
    "vendor.github-issue-forms": "ISSUE_TEMPLATE/[!c]*.yml",
}
pytestmark = pytest.mark.skipif(not GITHUB.is_dir(), reason="an installed package has no .github")


def run(*words: object, **options: object) -> str:
    """What a program prints; an error has what it says."""
    done = subprocess.run([str(x) for x in words], capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stdout + done.stderr
    return str(done.stdout)


@pytest.mark.parametrize("schema", FORMS)
def test_workflows_and_forms_are_valid(schema: str) -> None:
    pytest.importorskip("check_jsonschema")
    files = sorted(GITHUB.glob(FORMS[schema]))
    assert files
    run(sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *files)


def test_the_citation_is_valid_and_of_this_version(tmp_path: Path) -> None:
    pytest.importorskip("check_jsonschema")
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    shutil.copy(ROOT / "CITATION.cff", tmp_path / "citation.yml")
    run(sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.citation-file-format",
        tmp_path / "citation.yml")  # fmt: skip
    assert re.findall(r"^version: (.*)$", text, re.MULTILINE) == [sd.__version__]


def test_workflows_run_what_this_project_has() -> None:
    """Each script, extra and program of a step is there; the tests' matrix starts at the oldest Python."""
    text = "\n".join(x.read_text(encoding="utf-8") for x in sorted((GITHUB / "workflows").glob("*.yml")))
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for extra in {x for found in re.findall(r'"\.\[([\w,]+)\]"', text) for x in found.split(",")}:
        assert re.search(rf"^{extra} = \[", project, re.MULTILINE), extra
    for script in re.findall(r"run: (\.\S+)", text):
        assert os.access(ROOT / script, os.X_OK), script
    (oldest,) = re.findall(r'^requires-python = ">=(.*)"$', project, re.MULTILINE)
    assert f'python: ["{oldest}",' in text
    for name in ("numpy", "numba", "yourdfpy"):
        (least,) = re.findall(rf'"{name}>=([\d.]+)', project)
        assert f'"{name}=={least}' in text, name


def test_commands_of_contributing_name_what_is_there() -> None:
    text = (GITHUB / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for path in re.findall(r"(?<![\w/])((?:tests|spatialdyn|benchmarks)/[\w./]*[\w/])", text):
        assert (ROOT / path).exists() or path == "tests/X/" or "/X/" in path, path
    for name in re.findall(r"`(test_\w+\.py)`", text):
        assert (ROOT / "tests" / name).exists(), name


def test_the_version_is_written_once() -> None:
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'dynamic = ["version"]' in project
    assert sd.__version__ not in re.sub(r"\[tool\..*", "", project, flags=re.DOTALL).replace("python", "")


@pytest.mark.slow(quick="test_the_version_is_written_once")
def test_wheel_and_sdist_run_readmes_lines(tmp_path: Path) -> None:
    """Built as for an index, installed without the sources; dependencies are those of this environment."""
    pytest.importorskip("build")
    run(sys.executable, "-m", "build", "--outdir", tmp_path / "dist", ROOT)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    (source,) = (tmp_path / "dist").glob("*.tar.gz")
    assert wheel.name == f"spatialdyn-{sd.__version__}-py3-none-any.whl"
    names = zipfile.ZipFile(wheel).namelist()
    assert {"spatialdyn/py.typed", "spatialdyn/urdf_files/two_link.urdf", "spatialdyn/sources/load.py"} <= {*names}
    assert {f"spatialdyn/docs/{x}" for x in ("pages/start.md", "gallery.json", "pictures/panda.png")} <= {*names}
    assert {x.partition("/")[0] for x in names} == {"spatialdyn", f"spatialdyn-{sd.__version__}.dist-info"}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code, shown = re.search(r"```python\n(import numpy.*?)```\n+```text\n(.*?)```", readme, re.DOTALL).groups()  # type: ignore[union-attr]
    for built in (wheel, source):
        folder = tmp_path / built.suffix[1:]
        venv.create(folder, system_site_packages=True, with_pip=False)
        python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
        site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
        run(sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", site, built)
        outside = {**os.environ, "PYTHONPATH": os.pathsep.join([site, *_packages()])}
        seen = run(python, "-c", "import spatialdyn; print(spatialdyn.__file__)", cwd=tmp_path, env=outside)
        assert Path(seen.strip()).is_relative_to(folder)
        assert run(python, "-c", code, cwd=tmp_path, env=outside) == shown


def _packages() -> list[str]:
    """The folders of this environment's packages."""
    return [x for x in sys.path if x.endswith("site-packages")]
