"""Scripts, notebooks and tests of Pinocchio's clients, under Pinocchio and under spatialdyn.compat.pinocchio.

    python benchmarks/clients.py pinocchio-tutorial/01_direct_kinematics supaero2025/tp1/a.ipynb
    python benchmarks/clients.py --tests pinocchio/unittest/python

Takes files, and folders of repositories that were cloned, whose scripts and notebooks import pinocchio. Each runs to
its end in a process of its own under either module, in its folder, with what that folder, its repository and that
one's folder src hold to import, without a screen, with hashes, and random numbers and configurations of NumPy's,
seeded. Sleeping takes no time, and the first three calls of ``input`` return an empty line; the next one ends the run.
Then all numbers that it prints, and leaves in global names and in those of its functions, are compared. Prints a
line for each: whether it ran, and the largest difference by the largest entry of its array. ``--tests`` counts the
tests that pass under each instead, and names those that pass under Pinocchio alone.
"""

from __future__ import annotations

import argparse
import builtins
import json
import os
import pickle
import re
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

MODULES = {"wheel": "pinocchio", "ours": "spatialdyn.compat.pinocchio"}
SECONDS = 300.0
RETURNS = 50  # of a function that are recorded
SAME = 1e-6  # relative to the largest entry: what an optimizer of a client stops at
TIMES = "time|l+apsed|duration"  # names of seconds that were measured
NOTHING = 1e-9  # largest entries below it are rounding errors, as of a difference that should be 0
PRINTED, NUMBER = "(printed)", r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])"
ANSWERS = 3  # empty lines that ``input`` returns
ADDRESS = r"\w+://\S*"  # a viewer's
SKIPPED = ("%", "!", "?")  # lines of notebooks that are not Python


def source(path: Path) -> str:
    """The Python text of a script or a notebook."""
    if path.suffix != ".ipynb":
        return path.read_text(encoding="utf-8", errors="replace")
    cells = json.loads(path.read_text(encoding="utf-8")).get("cells", [])
    lines = [
        line
        for cell in cells
        if cell.get("cell_type") == "code"
        for line in ["", *"".join(cell["source"]).splitlines()]
        if not line.lstrip().startswith(SKIPPED)
    ]
    return "\n".join(lines)


def clients(paths: Sequence[Path]) -> Iterator[tuple[Path, Path]]:
    """The files, and those in the folders that import pinocchio, each with the folder of its repository."""
    for path in paths:
        found = [path] if path.is_file() else sorted([*path.rglob("*.py"), *path.rglob("*.ipynb")])
        above = (x for x in path.parents if (x / ".git").exists())
        root = next(above, path.parent) if path.is_file() else path
        files = (x for x in found if x.is_file())
        yield from ((x, root) for x in files if x == path or re.search(r"(import|from) pinocchio", source(x)))


def numbers(scope: dict[str, Any]) -> dict[str, np.ndarray]:
    """The numbers of a scope by name: of arrays, floats and lists of them."""
    found = {}
    for name, x in scope.items():
        if name.startswith("_") or re.search(TIMES, name) or not isinstance(x, (np.ndarray, float, list, tuple)):
            continue
        try:
            array = np.asarray(x, float)
        except (TypeError, ValueError):
            continue
        if array.size:
            found[name] = array
    return found


def of_functions(path: Path, found: dict[str, np.ndarray]) -> Callable[..., None]:
    """A profile function that keeps the numbers of the local names of the file's functions as they return."""
    seen: dict[str, int] = {}

    def watch(frame: Any, event: str, argument: Any) -> None:
        code = frame.f_code
        if event != "return" or code.co_filename != str(path) or code.co_name[0] == "<":
            return
        seen[code.co_name] = seen.get(code.co_name, 0) + 1
        if seen[code.co_name] <= RETURNS:
            found.update({f"{code.co_name}.{name}": x for name, x in numbers(dict(frame.f_locals)).items()})

    return watch


def draw_from_numpy(pin: Any) -> None:
    """Let a module draw configurations and placements from NumPy: each library's own random numbers are others."""
    rng = np.random.default_rng(0)

    def configuration(model: Any, *limits: Any) -> Any:
        given = limits or (model.lowerPositionLimit, model.upperPositionLimit)
        low, high = (np.clip(np.nan_to_num(np.ravel(x), posinf=1.0, neginf=-1.0), -10.0, 10.0) for x in given)
        return pin.normalize(model, low + (high - low) * rng.random(model.nq))

    def placement() -> Any:
        return pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-1.0, 1.0, 3))

    pin.randomConfiguration, pin.SE3.Random = configuration, staticmethod(placement)


class LastInputError(Exception):
    """Raised by ``input`` after ANSWERS lines: the script may run until its user stops it."""


def answer_at_once() -> None:
    """Have a script not wait: sleeping takes no time, and ``input`` returns empty lines."""
    asked = iter(range(ANSWERS))

    def answer(*question: Any) -> str:
        if next(asked, None) is None:
            raise LastInputError
        return ""

    builtins.input, time.sleep = answer, lambda seconds: None


def run(path: Path, root: Path, module: str, report: Path) -> None:
    """Run a file in this process, and write its numbers."""
    if module == "ours":
        __import__(MODULES[module], fromlist=["install"]).install()
    import random

    random.seed(0)
    np.random.seed(0)
    draw_from_numpy(__import__("pinocchio"))
    answer_at_once()
    sys.argv, sys.path[:1] = [str(path)], [str(path.parent), str(root), str(root / "src")]
    scope: dict[str, Any] = {"__name__": "__main__", "__file__": str(path), "display": lambda *given: None}
    inside: dict[str, np.ndarray] = {}
    with redirect_stdout(StringIO()) as said:
        sys.setprofile(of_functions(path, inside))
        try:
            exec(compile(source(path), str(path), "exec"), scope)
        except LastInputError:
            pass
        finally:
            sys.setprofile(None)
    printed = np.array([float(x) for x in re.findall(NUMBER, re.sub(ADDRESS, "", said.getvalue()))])
    report.write_bytes(pickle.dumps(numbers(scope) | inside | ({PRINTED: printed} if printed.size else {})))


def test(folder: Path, module: str, report: Path) -> None:
    """Run pytest on the files of a folder in this process, and write its report."""
    import pytest

    if module == "ours":
        __import__(MODULES[module], fromlist=["install"]).install()
    sys.path.insert(0, str(folder))
    options = ["--continue-on-collection-errors", "-q", "-p", "no:cacheprovider"]
    options += [f"--rootdir={folder}", f"--junitxml={report}"]
    pytest.main([*options, *map(str, sorted(folder.glob("*.py")))])  # by name: of any pattern


def outcome(what: str, path: Path, root: Path, module: str, seconds: float) -> tuple[str, bytes]:
    """The last line of a run's errors, "" if it ended well, and what it wrote."""
    with TemporaryDirectory() as where:
        report = Path(where) / "report"
        command = [sys.executable, __file__, str(path), str(root), "--run", what, module, str(report)]
        place = path if path.is_dir() else path.parent
        environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONWARNINGS": "ignore", "PYTHONHASHSEED": "0"}
        try:
            done = subprocess.run(
                command, cwd=place, env=environment, capture_output=True, text=True, timeout=seconds, check=False
            )
        except subprocess.TimeoutExpired:
            return f"it took more than {seconds:g} s", b""
        said = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        wrote = report.read_bytes() if report.exists() else b""
        return "" if wrote else said[-1][:150], wrote


def difference(found: dict[str, np.ndarray], wanted: dict[str, np.ndarray]) -> tuple[float, str]:
    """The largest difference of numbers of the same name by the largest entry, and its name."""
    worst, where = 0.0, ""
    for name in wanted.keys() & found.keys():
        one, other = found[name], wanted[name]
        if one.shape != other.shape:
            return np.inf, name
        size = max(NOTHING, float(np.abs(other).max(initial=0.0, where=np.isfinite(other))))
        with np.errstate(invalid="ignore"):
            apart = np.where((one == other) | (np.isnan(one) & np.isnan(other)), 0.0, np.abs(one - other) / size)
        largest = float(np.nan_to_num(apart, nan=np.inf).max())
        if largest > worst:
            worst, where = largest, name
    return worst, where


def print_scripts(paths: Sequence[Path], seconds: float) -> None:
    """A line for each client."""
    ran = equal = total = 0
    for path, root in clients(paths):
        total += 1
        (fault, wanted), (ours, found) = (outcome("script", path, root, module, seconds) for module in MODULES)
        if fault or ours:
            print(f"{path}: wheel {fault or 'ran'}; ours {ours or 'ran'}", flush=True)
            continue
        numbers_of = pickle.loads(found), pickle.loads(wanted)
        worst, where = difference(*numbers_of)
        ran, equal = ran + 1, equal + (worst <= SAME)
        print(f"{path}: both ran; {len(numbers_of[1])} names, largest difference {worst:.1e} {where}", flush=True)
    print(f"{total} files, {ran} run under both, {equal} with equal numbers")


def outcomes(report: bytes) -> dict[str, str]:
    """{test: "" if it passed, else the first line of its failure}, of pytest's XML."""
    found = {}
    for case in ET.fromstring(report).iter("testcase"):
        failed = [part for part in case if part.tag in ("failure", "error", "skipped")]
        said = (failed[0].get("message") or failed[0].tag).strip().partition("\n")[0][:150] if failed else ""
        found[f"{case.get('classname')}.{case.get('name')}"] = said
    return found


def print_tests(folders: Sequence[Path], seconds: float) -> None:
    """How many tests pass under each, and those that pass under Pinocchio alone."""
    for folder in folders:
        done = {}
        for module in MODULES:
            fault, report = outcome("tests", folder, folder, module, seconds)
            if fault:
                print(f"{folder}: under {module} {fault}")
                break
            done[module] = outcomes(report)
            passed = sum(not said for said in done[module].values())
            print(f"{folder}: {passed} of {len(done[module])} pass under {module}", flush=True)
        else:
            for name, said in done["wheel"].items():
                if not said and done["ours"].get(name, "not run"):
                    print(f"  {name}: {done['ours'].get(name, 'not run')}")


def main() -> None:
    """Print a line for each client, or the counts of their tests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=Path, metavar="PATH", help="a script, a notebook or a folder of them")
    parser.add_argument("--tests", action="store_true", help="run the tests in the folders instead")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="most for one run (default %(default)s)")
    parser.add_argument("--run", nargs=3, metavar=("WHAT", "MODULE", "REPORT"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    paths = [path.resolve() for path in given.paths]
    for path in paths:
        if not path.exists():
            parser.error(f"there is no {path}")
    if given.run:
        what, module, report = given.run
        if what == "script":
            run(paths[0], paths[1], module, Path(report))
        else:
            test(paths[0], module, Path(report))
    else:
        (print_tests if given.tests else print_scripts)(paths, given.seconds)


if __name__ == "__main__":
    main()
