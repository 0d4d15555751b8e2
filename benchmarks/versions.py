"""README's first answer and a few tests on every Python that is here, with the newest NumPy and Numba, or the oldest.

    python benchmarks/versions.py [PYTHON ...] [--tests PATH ...]

PYTHON is a program; without one, those of the workflow's matrix that are on PATH or among pyenv's. Each runs in an
environment and with a cache of its own, one after the other; the oldest of them runs with the oldest dependencies too.
A Python of the matrix that is not here is named, and whether wheels of all dependencies exist for it. The exit status
is the number of runs that failed.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
TESTS = ("tests/urdf/test_load.py", "tests/model", "tests/calls/test_arguments.py", "tests/recursions/test_rnea.py")
NEEDS = ("pytest", "pytest-xdist", "hypothesis", "mpmath")  # of those tests
WHEELS = ("--only-binary", "numpy,numba,llvmlite")
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
LEAST = [f"{x}=={least}.*" for x, least in re.findall(r'"(numpy|numba|yourdfpy)>=([\d.]+)', PROJECT)]


def matrix() -> list[str]:
    """The versions of Python on which the workflow tests, "3.14t" without the GIL."""
    text = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    (rows,) = re.findall(r"^ +python: \[(.*)\]$", text, re.MULTILINE)
    return [*re.findall(r'"([\d.]+)"', rows), *re.findall(r'python: "([\d.]+t)"', text)]


def program(version: str) -> str | None:
    """Where a version's interpreter is."""
    named = [shutil.which(f"python{version}"), *Path.home().glob(f".pyenv/versions/{version}.*/bin/python{version}")]
    for found in filter(None, named):
        if subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0:
            return str(found)
    return None


def wheels(version: str) -> str:
    """Whether pip finds wheels of all dependencies for a Python that is not here."""
    (needed,) = re.findall(r"^dependencies = \[(.*)\]$", PROJECT, re.MULTILINE)
    options = ["--python-version", version.rstrip("t"), "--only-binary", ":all:", "--dry-run"]
    if version.endswith("t"):
        options += ["--abi", f"cp{version.replace('.', '')}", "--abi", "none"]
    with TemporaryDirectory() as unused:
        options += ["--target", unused]
        done = said([sys.executable, "-m", "pip", "install", "-q", *options, *re.findall(r'"(.*?)"', needed)])
    return "wheels of all dependencies exist" if done is None else done


def said(words: list[str], expected: str | None = None, **options: object) -> str | None:
    """None if a program ends well (and prints what is expected), else its last line."""
    done = subprocess.run(words, capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    if done.returncode == 0 and expected in (None, done.stdout):
        return None
    lines = (done.stdout + done.stderr).strip().splitlines()
    return lines[-1] if lines else f"exit status {done.returncode}"


def outcome(python: str, pins: list[str], tests: list[str], folder: Path) -> tuple[str, str | None]:
    """The versions that a Python runs, and what went wrong; None if nothing did."""
    own = folder / "environment"
    wrong = said([python, "-m", "venv", str(own)])
    ours = str(own / ("Scripts" if os.name == "nt" else "bin") / "python")
    wrong = wrong or said([ours, "-m", "pip", "install", "-q", *WHEELS, str(ROOT), *NEEDS, *pins])
    if wrong is not None:
        return "", wrong
    asked = "import sys, numpy, numba; print(sys.version.split()[0], numpy.__version__, numba.__version__)"
    versions = subprocess.run([ours, "-c", asked], capture_output=True, text=True, check=True).stdout.split()
    for name in ("tests", "pyproject.toml", "README.md"):  # without the sources, which would be imported
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code, shown = re.search(r"```python\n(import numpy.*?)```\n+```text\n(.*?)```", readme, re.DOTALL).groups()  # type: ignore[union-attr]
    options = {"cwd": folder, "env": {**os.environ, "SPATIALDYN_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": ""}}
    wrong = said([ours, "-c", code], shown, **options)
    wrong = wrong or said([ours, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", *tests], **options)
    return "Python {}, NumPy {}, Numba {}".format(*versions), wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pythons", nargs="*", metavar="PYTHON", help="interpreters; by default all that are here")
    parser.add_argument("--tests", nargs="+", metavar="PATH", default=list(TESTS), help="what pytest runs")
    given = parser.parse_args()
    known = {version: program(version) for version in matrix()}
    failed = 0
    for k, python in enumerate(given.pythons or filter(None, known.values())):
        for pins in ([], LEAST)[: 1 if k else 2]:
            with TemporaryDirectory() as folder:
                versions, wrong = outcome(python, pins, given.tests, Path(folder))
            failed += wrong is not None
            print(f"{versions or python} ({'oldest' if pins else 'newest'}): {wrong or 'passed'}", flush=True)
    for version in [] if given.pythons else [x for x, found in known.items() if found is None]:
        print(f"Python {version} is not here; {wheels(version)}")
    sys.exit(failed)


if __name__ == "__main__":
    main()
