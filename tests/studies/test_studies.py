"""Studies: chunks on executors, killed and resumed, with the bits of one process."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.studies import chunks, study

MODEL = sd.load_urdf("two_link")
# Forked processes would copy what other tests have made: JAX warns of its threads.
PROCESSES = partial(ProcessPoolExecutor, mp_context=multiprocessing.get_context("spawn"))
REDUCE = {
    "torque": sd.Moments("tau"), "part": sd.Quantiles("tau", (0.5, 0.99)), "worst": sd.Worst("most", 3, ("q",)),
}  # fmt: skip


def torques(model: Any, rng: np.random.Generator, n: int, mass: float = 1.0) -> dict[str, Any]:
    """Torques at rest in random configurations."""
    q = sd.random_configuration(model, rng, n)
    tau = mass * sd.generalized_gravity(model, q)
    return {"q": q, "tau": tau, "most": abs(tau).max(-1)}


def made(folder: Path, fn: Callable[..., Any] = torques, **changes: Any) -> sd.Study:
    """Ten chunks, the last one shorter."""
    given = {"scene": MODEL, "samples": 950, "chunk": 100, "seed": 3, "keep": ("q", "most"), "reduce": REDUCE}
    return sd.study(fn, folder=folder, **{**given, **changes})


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> sd.Study:
    """The study, run here."""
    return made(tmp_path_factory.mktemp("study") / "new").run()


def test_results_are_those_of_all_samples(whole: sd.Study) -> None:
    q = np.concatenate([
        sd.random_configuration(MODEL, np.random.default_rng(np.random.SeedSequence(3, spawn_key=(i,))), n)
        for i, n in enumerate([100] * 9 + [50])
    ])  # fmt: skip
    tau = sd.generalized_gravity(MODEL, q)
    found = whole.result()
    np.testing.assert_allclose(found["torque"].mean, tau.mean(0), rtol=1e-12)
    np.testing.assert_allclose(found["part"], np.quantile(tau, (0.5, 0.99), axis=0, method="inverted_cdf"), rtol=1e-3)
    order = np.argsort(-abs(tau).max(-1), kind="stable")[:3]
    np.testing.assert_array_equal(found["worst"].sample, order)
    np.testing.assert_array_equal(found["worst"].beside["q"], q[order])
    np.testing.assert_array_equal(np.asarray(whole["q"]), q)
    assert (len(whole.done), whole.missing, whole.failed) == (10, (), {})


def test_a_kept_output_is_an_array_on_disk(whole: sd.Study) -> None:
    q = whole["q"]
    assert (q.shape, q.ndim, q.dtype, len(q)) == ((950, 2), 2, np.dtype(float), 950)
    full = np.asarray(q)
    for key in (
        3, -1, slice(95, 210, 7), [940, 5, 99, 100], (slice(0, 300), 1), (7, 0), full[:, 0] > 0.0, ..., (..., 1),
        np.array([[0, 949], [100, 2]]), slice(5, 5),
    ):  # fmt: skip
        np.testing.assert_array_equal(q[key], full[key])
    assert isinstance(next(q.parts()), np.memmap)
    dask = pytest.importorskip("dask.array")
    np.testing.assert_array_equal(dask.from_array(q, chunks=q.chunks)[90:210].compute(), full[90:210])


@pytest.mark.parametrize("executor", [ThreadPoolExecutor, PROCESSES], ids=["threads", "processes"])
def test_any_executor_gives_the_same_bits(executor: Any, whole: sd.Study, tmp_path: Path) -> None:
    other = made(tmp_path / "new")
    with executor(2) as workers:
        seen: list[tuple[int, int]] = []
        other.warm(workers)
        assert len(other.done) == 1
        other.run(workers, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (10, 10)
    assert other.digest() == whole.digest()


def test_a_study_is_taken_up_where_it_ended(whole: sd.Study, tmp_path: Path) -> None:
    class EndedError(BaseException):
        """As Ctrl-C."""

    def end(done: int, total: int) -> None:
        if done == 4:
            raise EndedError

    with pytest.raises(EndedError):
        made(tmp_path / "new").run(progress=end)
    again = made(tmp_path / "new")
    assert again.missing == (4, 5, 6, 7, 8, 9)
    with pytest.raises(sd.StudyError, match="6 of 10 chunks are missing"):
        again.result()
    assert again.result(partial=True)["torque"].samples == 400
    stamps = {x: x.stat().st_mtime_ns for x in (tmp_path / "new").iterdir()}
    assert again.run().digest() == whole.digest()
    assert all(x.stat().st_mtime_ns == at for x, at in stamps.items())  # done once


def worse(model: Any, rng: np.random.Generator, n: int) -> dict[str, Any]:
    """Fails in some chunks."""
    found = torques(model, rng, n)
    if found["q"][0, 0] > 0.0:
        raise RuntimeError(f"q is {found['q'][0, 0]}")
    return found


def test_what_a_chunk_raises_is_kept_with_its_seed(tmp_path: Path) -> None:
    some = made(tmp_path / "new", worse)
    some.run()
    firsts = [np.random.default_rng(np.random.SeedSequence(3, spawn_key=(i,))).random() for i in range(10)]
    expected = {i for i, u in enumerate(firsts) if u > 0.5}
    assert set(some.failed) == set(some.missing) == expected
    first = min(expected)
    assert some.failed[first].startswith(f"chunk {first}, seed (3, spawn_key=({first},)): RuntimeError: q is ")
    assert "in worse" in some.failed[first]
    with pytest.raises(sd.StudyError, match=f"chunk {first}, seed"):
        some.result()
    kept, done = next((tmp_path / "new").glob("failed-*.txt")), min({*range(10)} - expected)
    shutil.copy(kept, kept.with_name(re.sub(r"\d+", lambda i: f"{done:0{len(i[0])}}", kept.name)))
    assert set(some.failed) == expected  # another process may write its failure of a chunk that is there late


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 4}, "seed is 3, expected 4"),
        ({"samples": 951}, "samples is 950, expected 951"),
        ({"chunk": 99}, "chunk is 100, expected 99"),
        ({"scene": sd.Scene(MODEL)}, "scene is"),
        ({"scene": sd.load_urdf("two_link", gravity=(0, 0, -1))}, "scene is"),
        ({"fn": worse}, "function is torques, expected worse"),
        ({"fn": partial(torques, mass=2.0)}, "function is torques, expected partial"),
        ({"keep": ("q",)}, "keep is"),
        ({"reduce": None}, "reduce is"),
    ],
)
def test_another_study_is_not_mixed_in(change: dict[str, Any], message: str, whole: sd.Study) -> None:
    with pytest.raises(sd.StudyError, match=message):
        made(Path(whole.folder), **change)


def test_neither_is_one_of_other_sources_or_of_a_processor_without_fma(
    whole: sd.Study, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    there = made(tmp_path / "new").warm()
    here = chunks.host_of()
    for name, other in (("sources", "0"), ("fma", not here["fma"]), ("numpy", "1.0"), ("llvmlite", "0")):
        monkeypatch.setattr(study, "host_of", lambda name=name, other=other: {**here, name: other})
        with pytest.raises(sd.StudyError, match=f"{name} is"):
            made(Path(whole.folder))
        monkeypatch.setattr(chunks, "host_of", lambda name=name, other=other: {**here, name: other})
        outcome = chunks.run_chunk(there._job, 0)  # on a worker of another kind
        assert f"this worker has {name} {other}" in outcome.failure


def test_what_a_function_holds_is_part_of_it() -> None:
    def of(x: float, y: float) -> Any:
        def f(model: Any, rng: Any, n: int, z: float = y) -> Any:
            return x + z

        return f

    digests = [chunks.digest_of_function(f) for f in (of(1, 2), of(1, 2), of(1, 3), of(2, 2), partial(of(1, 2), z=3))]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 4
    lock = time.perf_counter  # pickles; a generator does not
    chunks.digest_of_function(lambda model, rng, n: lock)
    held = iter(())
    stream = (x for x in held)
    with pytest.raises(sd.StudyError, match="cannot be pickled"):
        chunks.digest_of_function(lambda model, rng, n: stream)


def test_a_function_without_a_text_is_known_by_its_code() -> None:
    def of(text: str) -> Any:
        scope: dict[str, Any] = {}
        exec(f"def f(model, rng, n):\n    def g(x):\n        return {text}\n    return g(n)\n", scope)
        return scope["f"]

    digests = [chunks.digest_of_function(of(text)) for text in ("x + 1", "x + 1", "x + 2", "x.one", "x.two")]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 4


@pytest.mark.parametrize(
    ("fn", "message"),
    [
        (lambda model, rng, n: None, "returned NoneType"),
        (
            lambda model, rng, n: {"tau": np.ones(n + 1), "q": np.ones(n)},
            r"tau has shape \(101,\), expected \(100, ...\)",
        ),
        (lambda model, rng, n: {"q": np.ones(n)}, 'returns no "most"'),
        (lambda model, rng, n: {"q": np.ones(n), "most": [None] * n}, "dtype object"),
    ],
)
def test_what_is_no_result_is_refused(fn: Any, message: str, tmp_path: Path) -> None:
    some = made(tmp_path / "new", fn, samples=100).run()
    with pytest.raises(sd.StudyError, match=message):
        some.result()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fn": 5}, "fn is 5"),
        ({"samples": 0}, "samples is 0, expected an integer, at least 1"),
        ({"chunk": 1.5}, "chunk is 1.5"),
        ({"seed": -1}, "seed is -1"),
        ({"folder": 5}, "folder is 5"),
        ({"keep": ("part",)}, "keep holds 'part'"),
        ({"keep": ("a/b",)}, "keep holds 'a/b'"),
        ({"reduce": 5}, "reduce of"),
        ({"reduce": {"a/b": sd.Moments("tau")}}, "label 'a/b'"),
    ],
)
def test_bad_arguments_are_refused_before_a_file_is_written(change: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(sd.StudyError, match=message):
        made(**{"folder": tmp_path / "new", **change})
    with pytest.raises(sd.ModelError):
        made(tmp_path / "new", scene=5)
    assert not list(tmp_path.iterdir())


def test_bad_ways_to_run_are_refused(tmp_path: Path) -> None:
    some = made(tmp_path / "new")
    with pytest.raises(sd.StudyError, match="executor is 5"):
        some.run(5)
    with pytest.raises(sd.StudyError, match=r"expected sd\.set_num_threads"):
        some.run(threads=2)
    with ThreadPoolExecutor(1) as closed:
        pass
    with pytest.raises(sd.StudyError, match="the executor takes no chunk"):
        some.run(closed)
    with pytest.raises(sd.StudyError, match="'tau' is not kept"):
        some["tau"]


def test_other_files_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(sd.StudyError, match="holds other files"):
        made(tmp_path)
    some = made(tmp_path / "new").run()
    (tmp_path / "new" / "part-00000002.npz").write_bytes(b"PK\x03\x04spoilt")
    with pytest.raises(sd.StudyError, match=r"part-00000002.npz is damaged .*remove it"):
        some.result()
    (tmp_path / "new" / "q-00000001.npy").unlink()
    with pytest.raises(sd.StudyError, match=r"q-00000001\.npy is damaged or missing"):
        np.asarray(some["q"])
    (tmp_path / "new" / "manifest.json").write_text("{")
    with pytest.raises(sd.StudyError, match=r"manifest.json is damaged"):
        made(tmp_path / "new")
    (tmp_path / "new" / "manifest.json").write_text("[]")
    with pytest.raises(sd.StudyError, match="is no manifest"):
        made(tmp_path / "new")


def dies(folder: str, model: Any, rng: np.random.Generator, n: int) -> dict[str, Any]:
    """Ends its worker, once."""
    try:
        os.close(os.open(folder, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return torques(model, rng, n)
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_pool_whose_worker_is_killed_is_named_and_the_study_goes_on_with_another(
    whole: sd.Study, tmp_path: Path
) -> None:
    some = made(tmp_path / "new", partial(dies, str(tmp_path / "died")))
    with PROCESSES(1) as pool, pytest.raises(sd.StudyError, match=r"run again|was lost 3 times"):
        some.run(pool)
    with PROCESSES(1) as pool:
        assert some.run(pool).digest() == whole.digest()


SCRIPT = """
import os, signal, sys
sys.path.insert(0, {tests!r})
from test_studies import made, torques
from pathlib import Path
count = 0
def end(done, total):
    if done == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
study = made(Path(sys.argv[1])).run(progress=end)
print(study.digest())
"""


@pytest.mark.slow(quick="test_a_study_is_taken_up_where_it_ended")
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_study_killed_twice_has_the_digest_of_one_that_was_not(whole: sd.Study, tmp_path: Path) -> None:
    code = SCRIPT.format(tests=str(Path(__file__).parent))
    for at in (3, 7, 99):
        words = [sys.executable, "-c", code, str(tmp_path / "new"), str(at)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert (done.returncode == -signal.SIGKILL) == (at < 99), done.stderr
    assert done.stdout.strip() == whole.digest()
    assert not list((tmp_path / "new").glob("*.part"))


@pytest.mark.slow(quick="test_any_executor_gives_the_same_bits")
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_on_dask_with_a_worker_killed_the_bits_are_the_same(whole: sd.Study, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.run(sys.path.insert, 0, str(Path(__file__).parent))
        some = made(tmp_path / "new", partial(dies, str(tmp_path / "died")))
        some.run(client, threads=1)
        assert (tmp_path / "died").exists()
        assert some.digest() == whole.digest()


def test_a_manifest_says_what_the_study_is(whole: sd.Study) -> None:
    found = json.loads((Path(whole.folder) / "manifest.json").read_text())
    assert found["seed"] == 3
    assert found["function"] == "torques"
    assert repr(whole) == f"<Study of 950 samples in {whole.folder}: 10 of 10 chunks done>"
