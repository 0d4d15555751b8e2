"""The folder of compiled code may hold or be anything: answers are right, at worst slower, and nobody is warned."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from test_engine import PACKAGE, run_python
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines import batches, jit, store
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(jit.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")

SPEC = SPECS["potential_energy"]  # the shortest to compile
SAMPLES = 520


@pytest.fixture
def arm() -> sd.Model:
    return random_tree(2, 3, ["revolute", "prismatic"]).model


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty folder for compiled code, and nothing in memory."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(batches, "_kept", type(batches._kept)())
    return tmp_path / "spatialdyn"


def columns(model: sd.Model, spec: Any) -> int:
    """Numbers in one result."""
    return model.nv if spec.output.shape else 1


def by_kernel(model: sd.Model, spec: Any = SPEC) -> tuple[float, bool]:
    """The potential energy, or the gravity's work of another call, by a kernel as a new process has it: from disk or
    compiled; and whether it was on disk.
    """
    kernel: Any = jit.single.__wrapped__(spec)
    out = np.zeros(columns(model, spec))
    assert kernel(model.address, np.full(model.nq, 0.5), out) == jit.OK
    return float(out.sum()), sum(kernel.stats.cache_hits.values()) == 1


def by_program(model: sd.Model, spec: Any = SPEC) -> tuple[float, bool]:
    """The same by a program on lanes."""
    batches._kept.clear()
    recorded, record = [], batches.record
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batches, "record", lambda *arguments: recorded.append(1) or record(*arguments))
        program = batches.kernel((spec,), model.bodies, model.key)
    assert program is not None
    out = np.zeros((SAMPLES, columns(model, spec)))
    left = program([np.full((SAMPLES, model.nq), 0.5)], [out])
    assert left is not None
    assert len(left) == 0
    return float(out[0].sum()), not recorded


WAYS: dict[str, tuple[Callable[..., tuple[float, bool]], str]] = {
    "kernel": (by_kernel, store.KERNEL),
    "program": (by_program, store.PROGRAM),
}
ways = pytest.mark.parametrize(("run", "kind"), WAYS.values(), ids=WAYS)


def flipped(whole: bytes, at: int) -> bytes:
    """One bit the other way."""
    return whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "bit in the middle": lambda whole: flipped(whole, len(whole) // 2),
    "bit at the end": lambda whole: flipped(whole, len(whole) - 1),
    "bit of the checksum": lambda whole: flipped(whole, 0),
    "cut": lambda whole: whole[: len(whole) // 2],
    "nothing but a checksum": lambda whole: whole[:32],
    "cut checksum": lambda whole: whole[:20],
    "empty": lambda whole: b"",
    "random": lambda whole: np.random.default_rng(0).bytes(len(whole)),
    "zeros": lambda whole: bytes(len(whole)),
    "longer": lambda whole: whole + b"\0",
    "text": lambda whole: b"<html>404</html>",
}


# --- what the folder holds ------------------------------------------------------------------------------------


@ways
def test_what_is_whole_is_read(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    assert run(arm)[1] is False
    assert run(arm)[1] is True
    assert len(list(folder.glob("*" + kind))) == 1


@ways
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_is_made_anew(arm: sd.Model, folder: Path, run: Any, kind: str, damage: str) -> None:
    wanted, _ = run(arm)
    (file,) = folder.glob("*" + kind)
    whole = file.read_bytes()
    file.write_bytes(DAMAGE[damage](whole))
    assert run(arm) == (wanted, False)
    assert run(arm) == (wanted, True)


@ways
def test_a_file_under_the_name_of_another_is_not_taken_for_it(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    """What a process on another machine, or a careless copy, may leave."""
    other = SPECS["generalized_gravity"]
    wanted, _ = run(arm)
    (file,) = folder.glob("*" + kind)
    assert run(arm, other)[0] != wanted
    (second,) = set(folder.glob("*" + kind)) - {file}
    shutil.copy(second, file)
    assert run(arm) == (wanted, False)


@ways
def test_a_folder_where_a_file_should_be_stays(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    wanted, _ = run(arm)
    (file,) = folder.glob("*" + kind)
    file.unlink()
    (file / "inside").mkdir(parents=True)
    for _ in range(2):
        assert run(arm) == (wanted, False)
    assert (file / "inside").is_dir()
    assert not list(folder.glob("*" + store.PART))


@ways
def test_a_folder_deleted_meanwhile_is_made_anew(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    wanted, _ = run(arm)
    shutil.rmtree(folder)
    assert run(arm) == (wanted, False)
    assert run(arm) == (wanted, True)


def test_what_was_used_last_stays(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "MOST", 2)
    for k in range(2):
        store.write(f"digest{k}", b"x")
        os.utime(folder / f"digest{k}{store.PROGRAM}", (k, k))
    assert store.read("digest0") == b"x"
    store.write("digest2", b"x")
    assert [store.read(f"digest{k}") for k in range(3)] == [b"x", None, b"x"]


# --- where the folder is --------------------------------------------------------------------------------------


def refusing(code: int) -> Callable[..., Any]:
    """A function of the system that fails so."""

    def fail(*arguments: Any, **named: Any) -> Any:
        raise OSError(code, os.strerror(code))

    return fail


@ways
@pytest.mark.parametrize("what", ["mkstemp", "replace", "fdopen", "utime"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_a_folder_that_cannot_be_written_to_keeps_nothing(
    arm: sd.Model, folder: Path, monkeypatch: pytest.MonkeyPatch, run: Any, kind: str, what: str, code: int
) -> None:
    monkeypatch.setattr(store.tempfile if what == "mkstemp" else store.os, what, refusing(code))
    wanted, _ = run(arm)
    assert run(arm) == (wanted, what == "utime")
    assert not list(folder.glob("*" + store.PART))


@ways
def test_a_user_without_a_home_keeps_nothing(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, run: Any, kind: str
) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(store.Path, "home", homeless)
    wanted, _ = run(arm)
    assert run(arm) == (wanted, False)


SCRIPT = """
import sys
import numpy as np
import spatialdyn as sd
if len(sys.argv) > 1:
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
model = sd.load_urdf("two_link")
single = sd.potential_energy(model, [0.1, 0.2])
batch = sd.potential_energy(model, np.tile([0.1, 0.2], (600, 1)))
assert (abs(batch - single) <= 1e-14 * abs(single)).all()
print(repr(single))
"""


@pytest.fixture(scope="module")
def energy() -> float:
    """What the script has to print."""
    return float(sd.potential_energy(sd.load_urdf("two_link"), [0.1, 0.2]))


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no folder that even root cannot write to")
@pytest.mark.parametrize("place", ["/proc/nowhere", "/dev/null", "/dev/null/below"])
def test_a_process_runs_where_nothing_can_be_kept(place: str, energy: float) -> None:
    assert float(run_python(SCRIPT, NUMBA_CACHE_DIR=place)) == energy


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
def test_a_process_runs_where_files_can_only_be_begun(tmp_path: Path, energy: float) -> None:
    assert float(run_python(SCRIPT, "4096", NUMBA_CACHE_DIR=str(tmp_path))) == energy
    assert not list((tmp_path / "spatialdyn").iterdir())


def test_processes_that_compile_at_once_agree(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    running = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    answers = [process.communicate(timeout=300)[0] for process in running]
    assert [process.returncode for process in running] == [0, 0]
    files = set((tmp_path / "spatialdyn").iterdir())
    assert {file.suffix for file in files} == {store.KERNEL, store.PROGRAM}
    answers.append(run_python(SCRIPT, NUMBA_CACHE_DIR=str(tmp_path)))
    assert answers[0] == answers[1] == answers[2]
    assert set((tmp_path / "spatialdyn").iterdir()) == files
