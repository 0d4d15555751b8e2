"""What an example takes as a newcomer runs it: in a new process, with an empty cache.

Some share a process, and what one has compiled the next ones have. All of them together take at least what any takes
alone, so where all are within the limit each is; where they are not, each runs alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from example_runs import compiled, robots
from slow import slow_but

import spatialdyn
from spatialdyn.examples import gallery

MOST_SECONDS = 20.0  # of CPU, most of it LLVM's
PROCESSES = 8  # for some 60 examples
SCRIPT = """
import json, resource, runpy, sys
import spatialdyn

names, sys.argv[1:] = sys.argv[1:], []
for name in names:
    end = 0
    try:
        runpy.run_module(f"spatialdyn.examples.{name}", run_name="__main__", alter_sys=True)
    except SystemExit as left:
        end = left.code
    print(json.dumps([name, end]), file=sys.stderr)
used = [resource.getrusage(x) for x in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps(["seconds", sum(x.ru_utime + x.ru_stime for x in used)]), file=sys.stderr)
"""
FIRST = ("first_steps",)
NAMES = [name for name in gallery.names() if name not in FIRST]


@robots
@compiled
@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not say what a process took")
@pytest.mark.parametrize(
    "names",
    slow_but([(FIRST,)], [(FIRST,), *((tuple(NAMES[k::PROCESSES]),) for k in range(PROCESSES))]),
    ids=lambda names: names[0],
)
def test_examples_take_seconds_in_a_cold_process(names: tuple[str, ...], tmp_path: Path) -> None:
    if seconds_of(names, tmp_path / "together") > MOST_SECONDS:
        alone = {name: seconds_of((name,), tmp_path / name) for name in names}
        assert max(alone.values()) <= MOST_SECONDS, alone


def seconds_of(names: tuple[str, ...], folder: Path) -> float:
    """CPU seconds of a process that runs these, children and the import of the package too."""
    folder.mkdir()
    path = os.pathsep.join([str(Path(spatialdyn.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "MPLBACKEND": "agg"}
    environment |= {"SPATIALDYN_CACHE_DIR": str(folder), "NUMBA_CACHE_DIR": str(folder)}
    command = [sys.executable, "-c", SCRIPT, *names]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd=folder)
    ends = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("[")]
    assert ends[:-1] == [[name, 0] for name in names], done.stderr
    return float(ends[-1][1])
