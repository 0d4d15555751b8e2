"""Whatever the disk cache's folder is or holds, results are right, at worst slower. Files that another user may have
written are not run, with one warning; other faults give none.
"""

from __future__ import annotations

import errno
import os
import pickle
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from inputs import PACKAGE, empty_memory, run_python
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import disk_cache, numba_kernels
from spatialdyn.engines.compiled.numba_cache import InlinedCache
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")

SPEC = SPECS["potential_energy"]  # the shortest to compile
SAMPLES = 520


PARTS: dict[str, bytes] = {}  # the inlined functions that this process has compiled


@pytest.fixture(autouse=True)
def parts_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile a kernel from parts that are compiled once: a tenth of the time where the disk has none of them."""
    read, write = InlinedCache.read, InlinedCache.write

    def kept(cache: InlinedCache, digest: str) -> Any:
        found = read(cache, digest)
        return pickle.loads(PARTS[digest]) if found is None and digest in PARTS else found

    def keep(cache: InlinedCache, digest: str, content: Any) -> None:
        PARTS[digest] = pickle.dumps(content)
        write(cache, digest, content)

    monkeypatch.setattr(InlinedCache, "read", kept)
    monkeypatch.setattr(InlinedCache, "write", keep)


@pytest.fixture
def arm() -> sd.Model:
    return random_tree(2, 3, ["revolute", "prismatic"]).model


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty cache folder, and empty caches in memory."""
    monkeypatch.delenv(disk_cache.VARIABLE, raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    empty_memory(monkeypatch)
    monkeypatch.setattr(disk_cache, "_done", set())
    return tmp_path / "spatialdyn"


def columns(model: sd.Model, spec: Any) -> int:
    """Number of entries of one result."""
    return model.nv if spec.output.shape else 1


def by_kernel(model: sd.Model, spec: Any = SPEC) -> tuple[float, bool]:
    """The potential energy, or the gravity's work of another call, by a kernel as in a new process: from disk or
    compiled; and whether it was on disk.
    """
    kernel: Any = numba_kernels.sample_kernel.__wrapped__(spec)
    out = np.zeros(columns(model, spec))
    assert kernel(model.address, np.full(model.nq, 0.5), out) == numba_kernels.OK
    return float(out.sum()), sum(kernel.stats.cache_hits.values()) == 1


def by_program(model: sd.Model, spec: Any = SPEC) -> tuple[float, bool]:
    """As ``by_kernel``, by a program on lanes."""
    batch_kernels.forget()
    recorded, record = [], recording.record
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch_kernels, "record", lambda *arguments: recorded.append(1) or record(*arguments))
        program = batch_kernels.kernel((spec,), model.bodies, model.key)
    assert program is not None
    out = np.zeros((SAMPLES, columns(model, spec)))
    left = program([np.full((SAMPLES, model.nq), 0.5)], [out])
    assert left is not None
    assert len(left) == 0
    return float(out[0].sum()), not recorded


WAYS: dict[str, tuple[Callable[..., tuple[float, bool]], str]] = {
    "kernel": (by_kernel, disk_cache.KERNEL),
    "machine code of a program": (by_program, disk_cache.PROGRAM),
    "numbers of a program": (by_program, disk_cache.NUMBERS),
}
ways = pytest.mark.parametrize(("run", "kind"), WAYS.values(), ids=WAYS)


MADE: dict[Any, tuple[float, dict[str, bytes]]] = {}


def first_run(run: Any, arm: sd.Model, folder: Path) -> float:
    """The result of a first run, which leaves files in the folder: compiled once, copied for later tests."""
    if run not in MADE:
        wanted, found = run(arm)
        assert not found
        MADE[run] = wanted, {file.name: file.read_bytes() for file in folder.iterdir()}
    wanted, files = MADE[run]
    if not folder.exists():
        folder.mkdir(mode=0o700)
        for name, whole in files.items():
            (folder / name).write_bytes(whole)
            (folder / name).chmod(0o600)
    return wanted


def flipped(whole: bytes, at: int) -> bytes:
    """With one bit flipped."""
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
    wanted = first_run(run, arm, folder)
    (file,) = folder.glob("*" + kind)
    whole = file.read_bytes()
    file.write_bytes(DAMAGE[damage](whole))
    assert run(arm) == (wanted, False)
    assert run(arm) == (wanted, True)


@ways
def test_a_file_under_the_name_of_another_is_not_taken_for_it(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    """Files that a process on another machine, or a careless copy, may leave."""
    other = SPECS["generalized_gravity"]
    wanted = first_run(run, arm, folder)
    (file,) = folder.glob("*" + kind)
    assert run(arm, other)[0] != wanted
    (second,) = set(folder.glob("*" + kind)) - {file}
    shutil.copy(second, file)
    assert run(arm) == (wanted, False)


@ways
def test_a_folder_where_a_file_should_be_stays(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    wanted = first_run(run, arm, folder)
    (file,) = folder.glob("*" + kind)
    file.unlink()
    (file / "inside").mkdir(parents=True)
    for _ in range(2):
        assert run(arm) == (wanted, False)
    assert (file / "inside").is_dir()
    assert not list(folder.glob("*" + disk_cache.PART))


@ways
def test_a_folder_deleted_meanwhile_is_made_anew(arm: sd.Model, folder: Path, run: Any, kind: str) -> None:
    wanted, _ = run(arm)
    shutil.rmtree(folder)
    assert run(arm) == (wanted, False)
    assert run(arm) == (wanted, True)


def test_what_was_used_last_stays(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process prunes once, when it first writes."""
    monkeypatch.setattr(disk_cache, "MOST_FILES", 2)
    for kind in disk_cache.KINDS:
        for k in range(4):
            disk_cache.write(f"digest{k}", b"x", kind)
            os.utime(folder / f"digest{k}{kind}", (k, k))
    assert len(list(folder.iterdir())) == 4 * len(disk_cache.KINDS)
    assert disk_cache.read("digest0") == b"x"
    monkeypatch.setattr(disk_cache, "_done", set())  # another process
    disk_cache.write("digest4", b"x")
    kept = {kind: [disk_cache.read(f"digest{k}", kind) for k in range(5)] for kind in disk_cache.KINDS}
    others = [None, None, b"x", b"x", None]
    written = [b"x", None, None, None, b"x"]
    assert kept == dict.fromkeys(disk_cache.KINDS, others) | {disk_cache.PROGRAM: written}


def test_a_folder_is_looked_through_once_a_process(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked, listdir = [], os.listdir
    monkeypatch.setattr(disk_cache.os, "listdir", lambda *given: looked.append(1) or listdir(*given))
    for k in range(5):
        disk_cache.write(f"digest{k}", b"x")
    assert len(looked) == len(disk_cache.KINDS)
    assert len(list(folder.iterdir())) == 5


# --- where the folder is --------------------------------------------------------------------------------------


def refusing(code: int) -> Callable[..., Any]:
    """A function of the operating system that fails with this error."""

    def fail(*arguments: Any, **named: Any) -> Any:
        raise OSError(code, os.strerror(code))

    return fail


FAILING = [(what, code) for code in (errno.ENOSPC, errno.EROFS) for what in ("open", "replace", "fdopen", "utime")]
READ_ONLY = [("open", errno.EROFS), ("utime", errno.EROFS)]  # a full disk fails later


@ways
@pytest.mark.parametrize(
    ("what", "code"), slow_but([("replace", errno.ENOSPC), ("fdopen", errno.ENOSPC), *READ_ONLY], FAILING)
)
def test_a_folder_that_cannot_be_written_to_keeps_nothing(
    arm: sd.Model, folder: Path, monkeypatch: pytest.MonkeyPatch, run: Any, kind: str, what: str, code: int
) -> None:
    monkeypatch.setattr(disk_cache.os, what, refusing(code))
    wanted, _ = run(arm)
    assert run(arm) == (wanted, what == "utime")
    assert not list(folder.glob("*" + disk_cache.PART))


@ways
def test_a_user_without_a_home_keeps_nothing(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, run: Any, kind: str
) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", disk_cache.VARIABLE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(disk_cache.Path, "home", homeless)
    wanted, _ = run(arm)
    assert run(arm) == (wanted, False)


def test_our_variable_wins_and_names_the_folder_itself(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    own = tmp_path / "own" / "cache"
    monkeypatch.setenv(disk_cache.VARIABLE, str(own))
    assert disk_cache.folder() == own
    disk_cache.write("digest", b"x")
    assert os.listdir(own) == ["digest" + disk_cache.PROGRAM]
    assert disk_cache.read("digest") == b"x"
    assert not folder.exists()
    monkeypatch.delenv(disk_cache.VARIABLE)
    assert disk_cache.folder() == folder
    assert disk_cache.read("digest") is None


@ways
def test_an_empty_variable_is_for_no_folder(
    arm: sd.Model, folder: Path, monkeypatch: pytest.MonkeyPatch, run: Any, kind: str
) -> None:
    monkeypatch.setenv(disk_cache.VARIABLE, "")
    assert disk_cache.folder() is None
    wanted, _ = run(arm)
    assert run(arm) == (wanted, False)
    assert not folder.exists()


# --- whose the folder is --------------------------------------------------------------------------------------

STRANGER = 61234  # the number of no user
owned = pytest.mark.skipif(not disk_cache.OWNED, reason="files have no owner and mode that say who may write")
ROOT = disk_cache.OWNED and os.geteuid() == 0


def given_away(path: Path) -> None:
    """Make a file or folder another user's; if only root can, one that another user may write to."""
    if ROOT:
        os.chown(path, STRANGER, -1)
    else:
        path.chmod(0o777)


def linked(path: Path) -> None:
    """Move a file or folder, and put a link to it in its place."""
    there = path.with_name("moved")
    path.rename(there)
    path.symlink_to(there)


def dangling(path: Path) -> None:
    """A dangling link in place of a file or folder."""
    path.rename(path.with_name("moved"))
    path.symlink_to(path.with_name("nothing"))


# Faults of a file or folder, and the words of the warning.
PLANTED: dict[str, tuple[Callable[[Path], None], str]] = {
    "another user's": (given_away, "belongs to user|has mode 0777"),
    "its group may write": (
        lambda path: path.chmod(0o770),
        "mode 0770, expected one that only its owner may write",
    ),
    "others may write": (lambda path: path.chmod(0o702), "has mode 0702"),
    "sticky": (lambda path: path.chmod(0o1777), "has mode 1777"),
    "a link": (linked, "is a link, expected none; remove it"),
    "a link to nothing": (dangling, "is a link"),
}
CASES = {f"{way}-{fault}": (*WAYS[way], *PLANTED[fault]) for fault in PLANTED for way in WAYS}
planted = pytest.mark.parametrize(
    ("run", "kind", "plant", "fault"), slow_but([*CASES.values()][:: len(WAYS) + 1], CASES.values()), ids=CASES
)


def assert_one_warning(caught: Any, path: Path, fault: str) -> None:
    """One warning that names the path, the fault and the remedy."""
    (warning,) = caught
    text = str(warning.message)
    assert warning.category is RuntimeWarning
    assert f'"{path}" ' in text
    assert re.search(fault, text)
    assert text.count(disk_cache.VARIABLE) == 1


@owned
@planted
def test_code_in_a_folder_of_another_is_not_run(
    arm: sd.Model, folder: Path, run: Any, kind: str, plant: Any, fault: str
) -> None:
    wanted = first_run(run, arm, folder)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    plant(folder)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(2):
            assert run(arm) == (wanted, False)
    assert_one_warning(caught, folder, fault)
    moved = folder.with_name("moved")
    assert {file.name: file.read_bytes() for file in (moved if moved.exists() else folder).iterdir()} == before


@owned
@planted
def test_a_file_of_another_is_not_run(arm: sd.Model, folder: Path, run: Any, kind: str, plant: Any, fault: str) -> None:
    """Also where the folder is safe; the file is left for its owner."""
    wanted = first_run(run, arm, folder)
    (file,) = folder.glob("*" + kind)
    plant(file)
    others = set(disk_cache.KINDS) - {kind}  # read, or written anew
    before = {path.name: path.lstat() for path in folder.iterdir() if path.suffix not in others}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(2):
            assert run(arm) == (wanted, False)
    assert_one_warning(caught, file, fault)
    after = {path.name: path.lstat() for path in folder.iterdir() if path.suffix not in others}
    assert [(name, x.st_mode, x.st_mtime_ns, x.st_ino) for name, x in after.items()] == [
        (name, x.st_mode, x.st_mtime_ns, x.st_ino) for name, x in before.items()
    ]


@owned
@pytest.mark.parametrize("umask", [0o000, 0o002, 0o022, 0o077])
def test_what_is_made_is_its_owners_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, umask: int
) -> None:
    own = tmp_path / "a" / "b"
    monkeypatch.setenv(disk_cache.VARIABLE, str(own))
    before = os.umask(umask)
    try:
        disk_cache.write("digest", b"x")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (own.parent, own, own / ("digest" + disk_cache.PROGRAM))]
    assert modes == [0o700, 0o700, 0o600]
    assert disk_cache.read("digest") == b"x"


@owned
def test_folders_above_may_be_links_and_shared(folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Users link ~/.cache to another disk; a user's folder below a shared one is safe."""
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    (tmp_path / "link").symlink_to(shared)
    monkeypatch.setenv(disk_cache.VARIABLE, str(tmp_path / "link" / "own"))
    disk_cache.write("digest", b"x")
    assert disk_cache.read("digest") == b"x"
    assert os.listdir(shared / "own") == ["digest" + disk_cache.PROGRAM]


@pytest.mark.skipif(not ROOT, reason="only root can become another user")
def test_code_of_root_is_read_by_all_and_kept_in_silence_by_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container whose image holds a cache."""
    with tempfile.TemporaryDirectory() as place:
        os.chmod(place, 0o755)
        monkeypatch.setenv(disk_cache.VARIABLE, f"{place}/cache")
        disk_cache.write("digest", b"x")
        os.chmod(f"{place}/cache", 0o755)
        for mode, found in ((0o644, b"x"), (0o600, None)):
            os.chmod(f"{place}/cache/digest{disk_cache.PROGRAM}", mode)
            os.seteuid(STRANGER)
            try:
                assert disk_cache.read("digest") == found
                disk_cache.write("other", b"x")
                assert disk_cache.read("other") is None
            finally:
                os.seteuid(0)
        os.chown(f"{place}/cache", STRANGER, -1)  # root does not run what a user may have written
        with pytest.warns(RuntimeWarning, match=f"belongs to user {STRANGER}, expected 0 or root"):
            assert disk_cache.read("digest") is None


@owned
def test_a_file_exchanged_after_the_check_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The open descriptor is checked and read, in the open folder."""
    disk_cache.write("digest", b"x")
    other, fstat, done = folder.with_name("other"), os.fstat, []
    other.mkdir()
    (other / ("digest" + disk_cache.PROGRAM)).write_bytes(disk_cache._checksum("digest", b"planted") + b"planted")

    def exchange(handle: int) -> os.stat_result:
        state = fstat(handle)
        if not done:
            done.append(folder.rename(folder.with_name("away")))
            other.rename(folder)
        return state

    monkeypatch.setattr(disk_cache.os, "fstat", exchange)
    assert disk_cache.read("digest") == b"x"
    assert done
    assert disk_cache.read("digest") == b"planted"


@owned
@pytest.mark.parametrize("what", ["pipe", "folder"])
def test_what_is_no_file_is_passed_over(folder: Path, what: str) -> None:
    """To open a pipe would block."""
    disk_cache.write("other", b"x")
    path = folder / ("digest" + disk_cache.PROGRAM)
    os.mkfifo(path, 0o600) if what == "pipe" else path.mkdir(0o700)
    assert disk_cache.read("digest") is None


def test_where_names_cannot_be_looked_up_in_open_folders_links_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on Windows, which has neither owners nor modes."""
    monkeypatch.setattr(disk_cache, "BY_FOLDER", False)
    monkeypatch.setattr(disk_cache, "OWNED", False)
    monkeypatch.setattr(disk_cache, "_SURE", 0)
    monkeypatch.delattr(disk_cache.os, "O_NOFOLLOW", raising=False)
    disk_cache.write("digest", b"x")
    folder.chmod(0o777)
    assert disk_cache.read("digest") == b"x"
    file = folder / ("digest" + disk_cache.PROGRAM)
    for path in (file, folder):
        try:
            linked(path)
        except OSError:
            pytest.skip("links are for administrators")
        disk_cache._done.clear()
        with pytest.warns(RuntimeWarning, match="is a link, expected none; remove it"):
            assert disk_cache.read("digest") is None


SCRIPT = """
import sys
import numpy as np
import spatialdyn as sd
from spatialdyn.calls.dynamics import table_call
if len(sys.argv) > 1:
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
body = (1.0, (0.0, 0.1, 0.5), np.eye(3))
builder = sd.ModelBuilder("arm").add_body("a", None, inertia=body).add_body("b", "a", axis=(1, 0, 0), inertia=body)
model = builder.build()
single = sd.potential_energy(model, [0.1, 0.2])
assert abs(table_call("potential_energy", model, [0.1, 0.2]) - single) <= 1e-14 * abs(single)
sd.compile(model, "potential_energy")
batch = sd.potential_energy(model, np.tile([0.1, 0.2], (600, 1)))
assert (abs(batch - single) <= 1e-14 * abs(single)).all()
print(repr(single))
"""


@pytest.fixture(scope="module")
def energy() -> float:
    """The output that the script must print."""
    body = (1.0, (0.0, 0.1, 0.5), np.eye(3))
    builder = sd.ModelBuilder("arm").add_body("a", None, inertia=body).add_body("b", "a", axis=(1, 0, 0), inertia=body)
    return float(sd.potential_energy(builder.build(), [0.1, 0.2]))


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no folder that even root cannot write to")
@pytest.mark.slow(quick="test_a_folder_that_cannot_be_written_to_keeps_nothing")
@pytest.mark.parametrize("place", ["/proc/nowhere", "/dev/null/below"])
def test_a_process_runs_where_nothing_can_be_cached(place: str, energy: float) -> None:
    assert float(run_python(SCRIPT, NUMBA_CACHE_DIR=place)) == energy


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
@pytest.mark.slow(quick="test_a_folder_that_cannot_be_written_to_keeps_nothing")
def test_a_process_runs_where_files_can_only_be_begun(tmp_path: Path, energy: float) -> None:
    assert float(run_python(SCRIPT, "512", NUMBA_CACHE_DIR=str(tmp_path))) == energy
    files = (tmp_path / "spatialdyn").iterdir()
    assert {file.suffix for file in files} <= {disk_cache.NUMBERS}  # the others are longer


LOADED = """
import sys
import numpy as np
from spatialdyn.compat.native import operator_kernels
operator_kernels.compose(np.eye(4), np.eye(4), X := np.empty((4, 4)))
print((X == np.eye(4)).all(), "numba.np.arraymath" in sys.modules)
"""


def test_a_kernel_is_loaded_without_the_registries_of_the_compiler() -> None:
    run_python(LOADED)  # compiles it if no process did
    assert run_python(LOADED).split() == ["True", "False"]


@pytest.mark.slow(quick="test_a_damaged_file_is_made_anew")
def test_processes_that_compile_at_once_agree(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    running = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    answers = [process.communicate(timeout=300)[0] for process in running]
    assert [process.returncode for process in running] == [0, 0]
    files = set((tmp_path / "spatialdyn").iterdir())
    assert {file.suffix for file in files} == set(disk_cache.KINDS)
    answers.append(run_python(SCRIPT, NUMBA_CACHE_DIR=str(tmp_path)))
    assert answers[0] == answers[1] == answers[2]
    assert set((tmp_path / "spatialdyn").iterdir()) == files
