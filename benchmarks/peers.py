"""Times of the libraries that people weigh this one against, each in an environment of its own, correct first.

    python benchmarks/peers.py
    python benchmarks/peers.py --folder environments --peers drake mjx --robots panda --rounds 5

For each peer it makes an environment in a folder, with what pip installs for the peer on top of the packages that are
here, and runs one process there, on one core. Each process computes a call of the same samples; results that are not
Pinocchio's to 1e-10 are not timed. Then the processes run by turns, round after round, one of them at a time. Figures
are medians of processor time, which others on the machine disturb less: µs of one call from Python, and µs a sample of
a batch. A peer that cannot be installed, lacks a call or answers otherwise has the reason instead.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import cases
import contestants
import jax_peers
from cases import Case, Contestant
from measure import per_call

HERE = Path(__file__).parent
ROBOTS, CALLS, WAYS = ("ur5", "panda", "anymal"), ("rnea", "crba", "aba"), ("single", "batch")
PATIENCE = 600.0  # seconds that a peer may take for an answer: some compile that long
FEW_ROUNDS = 3  # of a peer whose batch takes ten times the seconds of a round
INSTALLED = "installed"  # name of a file in an environment that is whole
ONE_THREAD = {
    "OMP_NUM_THREADS": "1", "JAX_ENABLE_X64": "1", "JAX_PLATFORMS": "cpu",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}  # fmt: skip


class Peer(NamedTuple):
    """A peer: what pip installs for it, distributions whose versions are kept, and what makes a contestant.

    packages  none for what is here
    versions  none for this library
    make      function of a case and a call, which returns None if the peer lacks it or cannot hold the robot
    """

    packages: tuple[str, ...]
    versions: tuple[str, ...]
    make: Callable[[Case, str], Contestant | None]


def on_arms(make: Callable[[Case, str], Contestant | None]) -> Callable[[Case, str], Contestant | None]:
    """A function for robots with a fixed base alone."""
    return lambda case, call: make(case, call) if case.root == "fixed" else None


def pinocchio(case: Case, call: str) -> Contestant:
    """Single calls, and a batch by Pinocchio's pool on one thread where it has one, else by a loop."""
    one, pool = contestants.pinocchio(case, call), contestants.pool(case, call, 1)
    return one if pool is None else one._replace(batch=pool.batch, bare=None, count=pool.count, how=pool.how)


def in_casadi(case: Case, call: str) -> Contestant | None:
    """Pinocchio on CasADi's numbers: wheels lack the module."""
    __import__("pinocchio.casadi")
    return None


def kinematics_only(case: Case, call: str) -> None:
    """pytorch_kinematics: an AssertionError if it has got dynamics meanwhile."""
    import pytorch_kinematics

    words = ("rnea", "crba", "aba", "dynamics", "mass")
    found = [x for x in dir(pytorch_kinematics.Chain) if any(word in x for word in words)]
    assert not found, f"{found} is not timed"


PEERS = {
    "spatialdyn": Peer((), (), cases.public),
    "spatialdyn, specialized": Peer((), (), lambda case, call: cases.specialized(case, call)[0]),
    "pinocchio": Peer(("pin",), ("pin",), pinocchio),
    "mujoco": Peer(("mujoco",), ("mujoco",), contestants.mujoco),
    "drake": Peer(("drake",), ("drake",), on_arms(contestants.drake)),
    "adam on casadi": Peer(("adam-robotics[casadi]",), ("adam-robotics", "casadi"), on_arms(contestants.adam)),
    "frax": Peer(("frax",), ("frax", "jax"), on_arms(contestants.frax)),
    "mjx": Peer(("mujoco-mjx",), ("mujoco-mjx", "jax"), jax_peers.mjx),
    "brax": Peer(("brax",), ("brax", "jax"), on_arms(jax_peers.brax)),
    "bard": Peer(("bard>=0.4",), ("bard",), lambda case, call: None),
    "pytorch_kinematics": Peer(("pytorch-kinematics",), ("pytorch-kinematics",), kinematics_only),
    "pinocchio.casadi": Peer(("pin", "casadi"), ("pin", "casadi"), in_casadi),
}


# --- in a peer's process ------------------------------------------------------------------------------------


def serve(name: str, batch: int) -> None:
    """Answer requests, one line of JSON each; what libraries print goes to stderr."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    peer, made, counts = PEERS[name], None, dict[str, int]()
    known: dict[str, Case] = {}
    for line in sys.stdin:
        asked = json.loads(line)
        if "way" in asked:
            answer: dict[str, Any] = {"us": timed(made, asked["way"], asked["seconds"], counts)}
        elif "call" in asked:
            made, counts = None, {}
            try:
                robot, call = asked["robot"], asked["call"]
                case = known.setdefault(robot, known.get(robot) or cases.case(robot, batch))
                made = peer.make(case, call)
                answer = {} if made is None else checked(case, call, name, made)
            except Exception as error:
                answer = {"refused": f"{type(error).__name__}: {str(error).strip().splitlines()[0][:160]}"}
        else:
            answer = {"version": ", ".join(version(x) for x in peer.versions)}
        answers.write(json.dumps(answer) + "\n")


def checked(case: Case, call: str, name: str, made: Contestant) -> dict[str, Any]:
    """The error, and the ways that there are; AssertionError for results that are not the oracle's."""
    error = cases.check(case, call, name, made, contestants.expected(case, call))
    return {"error": error, "how": made.how, "count": made.count, "ways": [x for x in WAYS if getattr(made, x)]}


def timed(made: Contestant | None, way: str, seconds: float, counts: dict[str, int]) -> float:
    """Microseconds of processor time of a call, or of a sample of a batch, over a loop of some seconds."""
    assert made is not None
    run = made.single if way == "single" else made.bare or made.batch
    assert run is not None
    once = per_call(run, 1, time.process_time) if way not in counts else 0.0
    if once < seconds and way not in counts:
        once = per_call(run, 3, time.process_time)
    counts.setdefault(way, max(1, int(seconds / max(once, 1e-7))))
    return 1e6 * per_call(run, counts[way], time.process_time) / (made.count if way == "batch" else 1)


# --- here ---------------------------------------------------------------------------------------------------


class Process:
    """A peer's process, or why there is none."""

    def __init__(self, name: str, python: str, batch: int, patience: float) -> None:
        """Start it."""
        self.patience, self.lost = patience, ""
        passed = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(HERE.parent)}
        command = [python, str(HERE / "peers.py"), "--serve", name, "--batch", str(batch)]
        self._child: Any = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=passed
        )

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a request; ``refused`` if the process is lost."""
        if not self.lost:
            try:
                self._child.stdin.write(json.dumps(request) + "\n")
                self._child.stdin.flush()
                ready = select.select([self._child.stdout], [], [], self.patience)[0]
                line = self._child.stdout.readline() if ready else ""
                self.lost = "" if line else "its process ended" if ready else f"no answer in {self.patience:.0f} s"
                if line:
                    return dict(json.loads(line))
            except OSError as error:
                self.lost = str(error)
            self._child.kill()
        return {"refused": self.lost}

    def end(self) -> None:
        """End it."""
        self._child.kill()
        with suppress(OSError):  # what was written to a process that has ended
            self._child.communicate()


def environment(name: str, folder: Path) -> str:
    """The Python of a peer's environment, made if it is not whole. Raises OSError with pip's reason."""
    packages, home = PEERS[name].packages, folder / name.replace(" ", "_")
    if not packages:
        return sys.executable
    python = home / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    if not (home / INSTALLED).exists():
        venv.create(home, clear=True, with_pip=True)
        ask = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
        own = subprocess.run(ask, capture_output=True, text=True, check=True).stdout.strip()
        (Path(own) / "here.pth").write_text("\n".join(x for x in sys.path if x.endswith("-packages")))
        command = [str(python), "-m", "pip", "install", "--quiet", *packages]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            told = [x for x in done.stderr.splitlines() if x.startswith("ERROR")] or ["pip failed"]
            raise OSError(told[-1].removeprefix("ERROR: "))
        (home / INSTALLED).touch()
    return str(python)


def started(names: Iterable[str], folder: Path, batch: int, patience: float) -> tuple[dict[str, Process], Any]:
    """The processes of the peers that can be installed, and of each peer its version or the reason."""
    running, told = {}, {}
    for name in names:
        print(name, flush=True)
        try:
            running[name] = Process(name, environment(name, folder), batch, patience)
            answer = running[name].ask()
            told[name] = answer.get("version", answer.get("refused"))
        except OSError as error:
            told[name] = str(error)
    return running, told


def of_call(running: dict[str, Process], robot: str, call: str, rounds: int, seconds: float) -> dict[str, Any]:
    """Of each peer its times, error and how it takes a batch, or the reason why there are none."""
    found: dict[str, Any] = {}
    for name, process in running.items():
        found[name] = process.ask(robot=robot, call=call) or {"refused": "has no such call"}
    taken: dict[tuple[str, str], list[float]] = {}
    for k in range(rounds):
        for name, process in running.items():
            for way in found[name].get("ways", ()):
                before = taken.get((name, way), [0.0])
                if k >= FEW_ROUNDS and 1e-6 * before[0] * found[name]["count"] > 10.0 * seconds:
                    continue  # one that takes long is disturbed less
                answer = process.ask(way=way, seconds=seconds)
                if "us" in answer:
                    taken.setdefault((name, way), []).append(answer["us"])
    for (name, way), us in taken.items():
        found[name][f"{way}_us"] = median(us)
    for name, entry in found.items():
        entry.pop("ways", None)
        print(f"{robot:8}{call:6}{name:24}", *(f"{k} {v}" for k, v in entry.items()), flush=True)
    return found


def main() -> None:
    """Read the arguments, measure, and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where environments are made and kept (a temporary folder)")
    parser.add_argument("--peers", nargs="*", default=list(PEERS), choices=PEERS, metavar="PEER", help="these alone")
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS), choices=cases.ROBOTS, metavar="ROBOT")
    parser.add_argument("--batch", type=int, default=4096, help="samples of a batch (4096)")
    parser.add_argument("--rounds", type=int, default=9, help="rounds of each measurement (9)")
    parser.add_argument("--seconds", type=float, default=0.01, help="of a peer in a round (0.01)")
    parser.add_argument("--patience", type=float, default=PATIENCE, help=f"seconds for an answer ({PATIENCE:.0f})")
    parser.add_argument("--json", type=Path, default=HERE / "peers.json", help="the file of figures (peers.json)")
    parser.add_argument("--serve", choices=PEERS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve(given.serve, given.batch)
        return
    from machine import machine

    with tempfile.TemporaryDirectory() as temporary:
        running, told = started(given.peers, given.folder or Path(temporary), given.batch, given.patience)
        figures: dict[str, Any] = {robot: {} for robot in given.robots}
        kept = {x: y for x, y in machine().items() if isinstance(y, (str, int))}
        found = {"machine": kept, "samples": given.batch, "rounds": given.rounds, "peers": told, "calls": figures}
        for robot, calls in figures.items():
            for call in CALLS:
                calls[call] = of_call(running, robot, call, given.rounds, given.seconds)
                given.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        for process in running.values():
            process.end()


if __name__ == "__main__":
    main()
