"""The test suite's fuzzing for a given time, with new cases in every run.

``python benchmarks/fuzz.py --minutes 30 [--only calls]`` repeats every test_fuzz_*.py until the time is up or a case
fails, which is then shrunk and printed. Needs hypothesis and pytest.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FACTOR = 4  # times the suite's number of cases, in one process


def main() -> int:
    """Run until a case fails or the time is up; returns the status of the last run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--only", default="", help="part of a file name: urdf or calls")
    chosen = parser.parse_args()
    files = [str(path) for path in sorted((ROOT / "tests").glob("**/test_fuzz_*.py")) if chosen.only in path.stem]
    environment = os.environ | {
        "SPATIALDYN_FUZZ": str(FACTOR),
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }
    end, rounds = time.monotonic() + 60.0 * chosen.minutes, 0
    while time.monotonic() < end:
        seed = random.SystemRandom().randrange(2**32)
        command = [sys.executable, "-m", "pytest", "-q", "-m", "", "--tb=short", f"--hypothesis-seed={seed}", *files]
        status = subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode
        rounds += 1
        print(f"round {rounds}, seed {seed}: {'nothing found' if status == 0 else 'failed'}", flush=True)
        if status:
            return status
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
