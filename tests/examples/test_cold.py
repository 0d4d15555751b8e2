"""What an example takes as a newcomer runs it: in a process of its own, with an empty cache."""

from __future__ import annotations

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
SCRIPT = """
import resource, subprocess, sys
command = [sys.executable, "-m", f"spatialdyn.examples.{sys.argv[1]}"]
done = subprocess.run(command, capture_output=True, text=True, check=False)
spent = resource.getrusage(resource.RUSAGE_CHILDREN)
print(done.returncode, spent.ru_utime + spent.ru_stime, done.stderr)
"""


@robots
@compiled
@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not say what a child took")
@pytest.mark.parametrize("name", slow_but(["first_steps"], gallery.names()))
def test_an_example_takes_seconds_in_a_cold_process(name: str, tmp_path: Path) -> None:
    path = os.pathsep.join([str(Path(spatialdyn.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "MPLBACKEND": "agg"}
    environment |= {"SPATIALDYN_CACHE_DIR": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", SCRIPT, name]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path)
    code, spent, said = done.stdout.split(" ", 2)
    assert code == "0", said
    assert float(spent) <= MOST_SECONDS
