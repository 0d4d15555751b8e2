"""The tests of pink, a client of Pinocchio, under Pinocchio and under spatialdyn.compat.pinocchio.

    git clone https://github.com/stephane-caron/pink && python benchmarks/pink_suite.py pink

Prints how many tests pass under each, and the tests that pass under Pinocchio alone. The interpreter needs the
requirements of pink's tests: pin, qpsolvers and its solvers, robot_descriptions (which clones robots into
ROBOT_DESCRIPTIONS_CACHE; without a network each test of a robot that is not there waits some seconds for it under
both modules), xacrodoc, loop-rate-limiters, pytest.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

OURS = "spatialdyn.compat.pinocchio"
OPTIONS = ("-q", "-p", "no:cacheprovider", "--continue-on-collection-errors")  # of robots that are not there


def tests(folder: Path, ours: bool, arguments: list[str]) -> int:
    """Run pytest on a folder in this process."""
    import pytest

    if ours:
        import_module(OURS).install()
    sys.path.insert(0, str(folder))
    return int(pytest.main([*OPTIONS, "--rootdir", str(folder), *arguments]))


def outcomes(folder: Path, ours: bool) -> dict[str, str]:
    """{test: "" if it passed, else the first line of its failure}."""
    with TemporaryDirectory() as where:
        report = Path(where) / "report.xml"
        command = [sys.executable, __file__, str(folder), "--run", "ours" if ours else "wheel", "--report", str(report)]
        start = perf_counter()
        subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL, check=False)
        cases = [*ET.parse(report).getroot().iter("testcase")]
        unreachable = sum("GitCommandError" in _said(x) for x in cases)
        print(
            f"{command[4]}: {len(cases)} tests in {perf_counter() - start:.0f} s, {unreachable} without a robot",
            flush=True,
        )
        return {f"{x.get('classname')}.{x.get('name')}": _said(x) for x in cases}


def _said(case: ET.Element) -> str:
    found = [part for part in case if part.tag in ("failure", "error", "skipped")]
    return "" if not found else (found[0].get("message") or found[0].tag).strip().partition("\n")[0][:160]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="a checkout of pink, with its folder tests")
    parser.add_argument(
        "--run", choices=("wheel", "ours"), help="run the tests once under this module, in this process"
    )
    parser.add_argument("--report", type=Path, help="with --run, where pytest writes its XML")
    given = parser.parse_args()
    folder = given.folder.resolve()
    if not (folder / "tests").is_dir():
        parser.error(f"{folder} has no folder tests, expected a checkout of pink")
    if given.run:
        more = [] if given.report is None else [f"--junitxml={given.report}"]
        sys.exit(tests(folder, given.run == "ours", [str(folder / "tests"), *more]))
    wheel, ours = outcomes(folder, False), outcomes(folder, True)
    passed = [name for name, said in wheel.items() if not said]
    lost = {name: ours.get(name, "not collected") for name in passed if ours.get(name, "not collected")}
    print(f"{len(wheel)} tests: {len(passed)} pass under Pinocchio, {len(passed) - len(lost)} of those under {OURS}")
    for name, said in lost.items():
        print(f"  {name}: {said}")


if __name__ == "__main__":
    main()
