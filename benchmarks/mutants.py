"""Whether the suite notices faults: those of benchmarks/mutants.txt, each put into a copy of the package and tested.

    python benchmarks/mutants.py [--only compat] [--jobs 2] [--slow] [--no-check] [--again]
    python benchmarks/mutants.py --report

The table says what a fault is, in four lines or more::

    model/mimic.py
    - offset + ratio
    + offset - ratio
    ? model/test_model.py -k mimic
    ? slow plain recursions/test_derivatives.py

After the file's name, below spatialdyn/, the text that is there exactly once, and what takes its place. ``?`` is what
pytest is to run, below tests/: the few tests that should notice; "plain" runs them without compiling, "slow" are those
that wait for -m slow. A line ``= reason`` in place of tests names a fault that changes no result: it is not run.

First the tests are run without faults, and must pass (--no-check leaves that out). A fault is noticed if a test fails.
Prints the counts of each room and the faults that were not noticed; the exit status is 1 if fewer are noticed than
PROMISED: a fault that was not run counts as not noticed. What is found is kept in mutants.json after each fault: what
is there is not run again, unless the fault or its tests are others or --again is given; --report prints what is there.

A fault in a room of compiled code is tried twice. First kernels compiled without it are read from the cache, as if the
sources were the same: a test that fails then has noticed what is no part of them, or what they were compiled anew for.
If none fails, all is compiled with the fault, in a cache of its own.
"""

from __future__ import annotations

import argparse
import compileall
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from tables import Bar, draw

from spatialdyn.engines.compiled.stamp import COMPILED, STAMP

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, TESTS, TABLE = ROOT / "spatialdyn", ROOT / "tests", Path(__file__).with_suffix(".txt")
KEPT = Path(__file__).with_suffix(".json")
LIMIT = 900.0  # seconds of one run of tests, which says nothing if it takes longer
PROMISED = {False: 0.95, True: 0.98}  # share of the faults noticed by quick tests, and by slow ones too
FAILED, PASSED = (1, 2), 0  # exit status of pytest: tests that fail, or cannot be collected


@dataclass(frozen=True)
class Run:
    """What pytest is to run: arguments, without compiling or not, slow tests or not."""

    arguments: tuple[str, ...]
    plain: bool
    slow: bool

    @property
    def files(self) -> list[str]:
        """The test files, below tests/."""
        return [x.partition("::")[0] for x in self.arguments if x.partition("::")[0].endswith(".py")]

    @property
    def names(self) -> list[str]:
        """The words by which tests are selected."""
        words = [x for x, before in zip(self.arguments[1:], self.arguments, strict=False) if before == "-k"]
        words += [x.partition("::")[2].partition("[")[0] for x in self.arguments if "::" in x]
        return [x for text in words for x in text.replace("(", " ").replace(")", " ").split() if x not in BETWEEN]


BETWEEN = ("and", "or", "not")


@dataclass(frozen=True)
class Fault:
    """A fault: the text of a file of the package and what takes its place, the tests that should notice, or none."""

    file: str
    old: str
    new: str
    runs: tuple[Run, ...]
    same: str
    line: int

    @property
    def room(self) -> str:
        """The folder of the package that the file is in."""
        return self.file.partition("/")[0] if "/" in self.file else "top"

    @property
    def compiled(self) -> bool:
        """Whether kernels on the disk are of another stamp with it."""
        return self.file.startswith(tuple(f"{x}/" for x in COMPILED))

    @property
    def key(self) -> str:
        """What names it in mutants.json: the fault and its tests."""
        return "; ".join([str(self), *(" ".join(("slow",) * x.slow + x.arguments) for x in self.runs)])

    def __str__(self) -> str:
        return f"{self.file}: {self.old}  ->  {self.new}"


def faults(path: Path = TABLE) -> list[Fault]:
    """The table. Raises ValueError naming the line for what cannot be read."""
    found: list[Fault] = []
    rows: list[tuple[int, str]] = []
    for number, text in enumerate([*path.read_text(encoding="utf-8").splitlines(), ""], 1):
        if text.strip() and not text.startswith("#"):
            rows.append((number, text))
        elif rows and not text.strip():
            found.append(_fault(rows))
            rows = []
    return found


def _fault(rows: Sequence[tuple[int, str]]) -> Fault:
    (line, file), *rest = rows
    parts: dict[str, list[str]] = {"- ": [], "+ ": [], "? ": [], "= ": []}
    for number, text in rest:
        if text[:2] not in parts:
            raise ValueError(f"line {number} is {text!r}, expected one that begins with - + ? or =")
        parts[text[:2]].append(text[2:])
    olds, news, runs, same = parts.values()
    if len(olds) != 1 or len(news) != 1 or bool(runs) == bool(same):
        raise ValueError(f"the fault of line {line} has {len(olds)} -, {len(news)} +, expected one each, and ? or =")
    return Fault(file.strip(), olds[0], news[0], tuple(map(_run, runs)), " ".join(same), line)


def _run(text: str) -> Run:
    words = shlex.split(text)
    flags = [x for x in words[:2] if x in ("plain", "slow")]
    return Run(tuple(words[len(flags) :]), "plain" in flags, "slow" in flags)


def check(table: Sequence[Fault]) -> list[str]:
    """What is wrong with the table: faults whose text is not there exactly once, tests that are not there."""
    wrong = []
    names = "".join(path.read_text(encoding="utf-8") for path in sorted(TESTS.rglob("*.py")))
    for x in table:
        at = f"line {x.line}, {x.file}"
        if not (PACKAGE / x.file).is_file():
            wrong.append(f"{at}: there is no such file")
            continue
        count = (PACKAGE / x.file).read_text(encoding="utf-8").count(x.old)
        if count != 1 or x.old == x.new:
            wrong.append(f"{at}: {x.old!r} is there {count} times, expected once, and another text in its place")
        for run in x.runs:
            missing = [name for name in run.files if not (TESTS / name).is_file()]
            missing += [name for name in run.names if name not in names]
            if missing or not run.files:
                wrong.append(f"{at}: {', '.join(missing) or 'no file'} is not in the tests")
    return wrong


# --- running ------------------------------------------------------------------------------------------------


def copied(to: Path) -> Path:
    """A copy of what tests need."""
    ignored = shutil.ignore_patterns("__pycache__", "*.svg", "*.png")
    for name in ("spatialdyn", "tests", "benchmarks", "urdf"):
        shutil.copytree(ROOT / name, to / name, ignore=ignored)
    for name in ("pyproject.toml", "README.md"):
        shutil.copy2(ROOT / name, to)
    compileall.compile_dir(to, quiet=1)  # no run of a fault writes Python's own cache
    return to


@contextmanager
def put(tree: Path, fault: Fault) -> Iterator[None]:
    """The fault in a copy, then the file as it was, with its times: compiled modules stay valid."""
    with replaced(tree / "spatialdyn" / fault.file, fault.old, fault.new):
        yield


@contextmanager
def replaced(path: Path, old: str, new: str) -> Iterator[None]:
    """Another text in a file, then the file as it was."""
    text, state = path.read_bytes(), path.stat()
    path.write_bytes(text.replace(old.encode(), new.encode()))
    try:
        yield
    finally:
        path.write_bytes(text)
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


def tested(tree: Path, run: Run, cache: Path, write: bool) -> tuple[int | None, str]:
    """Exit status of pytest, None if it took LIMIT seconds, and the end of what it printed."""
    given = [str(tree / "tests" / x) if x.partition("::")[0].endswith(".py") else x for x in run.arguments]
    chosen = ["-m", ""] if run.slow else []
    command = [sys.executable, "-m", "pytest", "-v", "-x", "-n", "0", "-p", "no:cacheprovider", "--tb=line"]
    own = {"PYTHONPATH": str(tree), "XDG_CACHE_HOME": str(cache), "MPLBACKEND": "Agg"}
    own |= {"NUMBA_DISABLE_JIT": "1"} if run.plain else {}
    own |= {} if write else {"PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [*command, *chosen, *given],
            cwd=tree,
            env=os.environ | own,
            timeout=LIMIT,
            capture_output=True,
            text=True,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None, ""
    return done.returncode, (done.stdout + done.stderr)[-1000:]


def noticed(tree: Path, fault: Fault, cache: Path, slow: bool) -> str:
    """By which tests a fault is noticed: "quick", "slow" or "". Raises RuntimeError if they cannot be run."""
    with put(tree, fault):
        if not fault.compiled or all(run.plain for run in fault.runs):
            return _noticed(tree, fault, cache, slow)
        if fault.file != STAMPED:
            with tempfile.TemporaryDirectory() as own, replaced(tree / "spatialdyn" / STAMPED, *HELD):
                if cache.exists():
                    shutil.copytree(cache, own, dirs_exist_ok=True, copy_function=_link)
                found = _noticed(tree, fault, Path(own), slow)
            if found:
                return found
        with tempfile.TemporaryDirectory() as own:
            return _noticed(tree, fault, Path(own), slow)


STAMPED = "engines/compiled/stamp.py"
HELD = "STAMP = _stamp()", f'STAMP = "{STAMP}"'  # as if the package were without the fault


def _link(source: str, target: str) -> None:
    """One more name for a file, which the library replaces and never writes to."""
    try:
        os.link(source, target)
    except OSError:  # on another disk
        shutil.copy2(source, target)


def _noticed(tree: Path, fault: Fault, cache: Path, slow: bool) -> str:
    for run in sorted(fault.runs, key=lambda x: x.slow):
        if run.slow and not slow:
            continue
        status, text = tested(tree, run, cache, False)
        if status is not None and (status in FAILED or status < 0):
            return "slow" if run.slow else "quick"
        if status != PASSED:
            raise RuntimeError(f"{fault}: pytest ends with status {status}, None after {LIMIT:g} s\n{text}")
    return ""


class Copies:
    """Copies of the package, one for each of the runs at a time."""

    def __init__(self, folder: Path, count: int) -> None:
        """So many copies in a folder, and a cache of compiled code, kept for the next time."""
        self.cache = folder / "cache"
        self._free: SimpleQueue[Path] = SimpleQueue()
        for k in range(count):
            shutil.rmtree(folder / f"copy{k}", ignore_errors=True)
            self._free.put(copied(folder / f"copy{k}"))

    @contextmanager
    def one(self) -> Iterator[Path]:
        """A copy that nothing else uses."""
        tree = self._free.get()
        try:
            yield tree
        finally:
            self._free.put(tree)


def passing(copies: Copies, runs: Sequence[Run], jobs: int) -> list[str]:
    """What does not pass without a fault."""
    bar = Bar(len(runs))

    def one(run: Run) -> str:
        with copies.one() as tree:
            status, text = tested(tree, run, copies.cache, True)
        bar.step(" ".join(run.arguments))
        good = status == PASSED and " passed" in text  # not all of them skipped
        return "" if good else f"{' '.join(run.arguments)}: status {status} without a fault\n{text}"

    with ThreadPoolExecutor(jobs) as pool:
        found = [x for x in pool.map(one, runs) if x]
    bar.end()
    return found


def main() -> int:
    """Check the table, run it, print what was noticed. Returns 1 if that is less than promised."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[""], help="parts of a file's name, or of the text of a fault")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time, each on a copy of its own")
    parser.add_argument("--slow", action="store_true", help="slow tests too, where quick ones notice nothing")
    parser.add_argument("--no-check", action="store_true", help="do not run the tests without faults first")
    parser.add_argument("--again", action="store_true", help="also what is in mutants.json")
    parser.add_argument("--report", action="store_true", help="run nothing, print what is in mutants.json")
    parser.add_argument("--folder", type=Path, help="of the copies, and of a cache that is kept; else a temporary one")
    asked = parser.parse_args()
    table = faults()
    wrong = check(table)
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 2
    chosen = [x for x in table if any(part in str(x) for part in asked.only)]
    kept = results()
    if asked.report:
        return report(chosen, {x: kept[x.key] for x in chosen if x.key in kept}, True)
    faulty = [x for x in chosen if not x.same and (asked.again or x.key not in kept)]
    with tempfile.TemporaryDirectory() as temporary:
        copies = Copies(asked.folder or Path(temporary), asked.jobs)
        if not asked.no_check:
            runs = dict.fromkeys(run for x in faulty for run in x.runs if asked.slow or not run.slow)
            wrong = passing(copies, list(runs), asked.jobs)
            if wrong:
                print("\n".join(wrong), file=sys.stderr)
                return 2
        bar = Bar(len(faulty))

        def one(fault: Fault) -> tuple[str, float]:
            began = time.monotonic()
            with copies.one() as tree:
                try:
                    by = noticed(tree, fault, copies.cache, asked.slow)
                except RuntimeError as error:
                    by = f"error: {error}"
            spent = time.monotonic() - began
            bar.step(f"{by or 'NOT NOTICED'} {spent:.0f} s  {fault}")
            return by, spent

        with ThreadPoolExecutor(asked.jobs) as pool:
            for x, found in zip(faulty, pool.map(one, faulty), strict=True):
                if not found[0].startswith("error"):
                    kept[x.key] = found
                    keep(kept, table)
        bar.end()
    return report(chosen, {x: kept[x.key] for x in chosen if x.key in kept}, asked.slow)


def results() -> dict[str, tuple[str, float]]:
    """By which tests each fault was noticed, and the seconds that it took; by its key."""
    if not KEPT.exists():
        return {}
    return {x: (y["by"], y["seconds"]) for x, y in json.loads(KEPT.read_text(encoding="utf-8")).items()}


def keep(found: dict[str, tuple[str, float]], table: Sequence[Fault]) -> None:
    """Write them, in the order of the table; those of faults that are no more are left out."""
    rows = {x.key: found[x.key] for x in table if x.key in found}
    text = json.dumps({x: {"by": by, "seconds": round(s, 1)} for x, (by, s) in rows.items()}, indent=1)
    KEPT.write_text(text + "\n", encoding="utf-8")


def report(chosen: Sequence[Fault], found: dict[Fault, tuple[str, float]], slow: bool) -> int:
    """Print the counts of each room and what was not noticed; 1 if that is more than promised, else 0."""
    rows = []
    for room in [*dict.fromkeys(x.room for x in chosen), ""]:
        here = [x for x in chosen if room in (x.room, "")]
        by = [found[x] for x in here if x in found]
        same = sum(bool(x.same) for x in here)
        counts = len(here), same, *(sum(y == word for y, _ in by) for word in ("quick", "slow", ""))
        counts += (len(here) - same - len(by),)
        rows.append([room or "all", *map(str, counts), f"{sum(s for _, s in by):.0f}"])
    heads = ["room", "faults", "of no effect", "noticed", "by slow tests", "not noticed", "not run", "seconds"]
    draw("faults", heads, rows)
    for x, (word, _) in found.items():
        if not word:
            print(f"not noticed: line {x.line}, {x}")
    for x in chosen:
        if x.same:
            print(f"of no effect: {x}: {x.same}")
        elif x not in found:
            print(f"not run: line {x.line}, {x}")
    count = max(1, sum(not x.same for x in chosen))  # what was not run was not noticed
    shares = {False: sum(by == "quick" for by, _ in found.values()) / count}
    if slow:
        shares[True] = sum(by in ("quick", "slow") for by, _ in found.values()) / count
    for also, share in shares.items():
        print(f"{share:.1%} noticed by quick {'and slow ' * also}tests, expected {PROMISED[also]:.0%}")
    return int(any(share < PROMISED[also] for also, share in shares.items()))


if __name__ == "__main__":
    raise SystemExit(main())
