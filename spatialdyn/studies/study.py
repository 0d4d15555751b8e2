"""A study: a function of a scene on many random samples, run in chunks, here or on any executor, resumed at will."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..calls.arguments import as_flag, check_model
from ..calls.progress import Progress, Steps, check_progress, reporting
from ..errors import StudyError, literal
from ..simulation.scene import Scene
from .chunks import Function, Job, Outcome, host_of, manifest_of, path_of, run_chunk
from .folder import Folder, Stored
from .reductions import is_whole, merged, names_of, reductions_of

AHEAD = 4096  # chunks that an executor is given before they are done: twice as many as a cluster has workers
TRIES = 3  # of a chunk whose worker is lost
RESERVED = ("part", "failed", "manifest")  # names of other files


def study(
    fn: Function,
    scene: Any,
    samples: int,
    chunk: int,
    seed: int,
    folder: str | os.PathLike[str],
    keep: tuple[str, ...] = (),
    reduce: Any = None,
) -> Study:
    """A function of a scene on many random samples, in chunks: nothing runs before ``run``.

    fn       ``fn(scene, rng, n)``: a dict of arrays (n, ...), of n samples drawn from a numpy Generator
    scene    Scene or Model, handed to it
    samples  how many in all
    chunk    samples of a call of fn; half a second of work or more makes the rest cost little
    seed     chunk i draws from ``numpy.random.SeedSequence(seed, spawn_key=(i,))``
    folder   where parts are written; workers of other machines must see it by the same path
    keep     names of outputs that are written whole: ``study["q"]``
    reduce   what is kept of the others: ``{label: sd.Moments("tau"), ...}``, or one reduction; see ``sd.Moments``,
             ``sd.Quantiles``, ``sd.Worst``, ``sd.TallQR``

    A folder that holds parts of the same study is taken up where it ended. Results are the same bits on any executor
    and in any number of sittings, on processors that fuse multiplications and additions alike.

    Raises  StudyError for bad arguments, and for a folder of another study, naming what differs; ModelError

    >>> import tempfile
    >>> import spatialdyn as sd
    >>> def weights(model, rng, n):
    ...     return {"tau": sd.generalized_gravity(model, sd.random_configuration(model, rng, n))}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = sd.study(weights, sd.load_urdf("two_link"), 1000, 300, 7, folder, reduce=sd.Moments("tau"))
    ...     made.run().result()["tau"].samples, len(made.done), made.missing
    (1000, 4, ())
    """
    return Study(fn, scene, samples, chunk, seed, folder, keep, reduce)


class Study:
    """What ``study`` makes: see there.

    folder   its path
    done     the chunks that are there, a tuple of numbers
    missing  those that are not
    failed   what those raised that failed: {chunk: text with chunk, seed and traceback}
    """

    def __init__(
        self,
        fn: Function,
        scene: Any,
        samples: int,
        chunk: int,
        seed: int,
        folder: str | os.PathLike[str],
        keep: tuple[str, ...] = (),
        reduce: Any = None,
    ) -> None:
        """See ``study``."""
        if not callable(fn):
            raise StudyError(
                f"fn is {literal(fn)}, expected a function of a scene, a numpy Generator and a number of samples"
            )
        if not isinstance(scene, Scene):
            check_model(scene)
        for name, value, least in (("samples", samples, 1), ("chunk", chunk, 1), ("seed", seed, 0)):
            if not is_whole(value, least):
                raise StudyError(f"{name} is {literal(value)}, expected an integer, at least {least}")
        self._job = Job(
            fn, scene, int(samples), int(chunk), int(seed), path_of(folder), _names(keep), reductions_of(reduce),
            host_of(),
        )  # fmt: skip
        self._folder, self._manifest = Folder(self._job.folder), manifest_of(self._job)
        self._check()

    def _check(self) -> None:
        """Raise StudyError if the folder is of another study."""
        found = self._folder.manifest()
        if found is None:
            return
        for name, ours in self._manifest.items():
            theirs = found.get(name)
            if theirs != ours:
                raise StudyError(
                    f"{self.folder} holds a study whose {name} is {theirs}, expected {ours}: choose another folder"
                )

    def __repr__(self) -> str:
        return f"<Study of {self._job.samples} samples in {self.folder}: {len(self.done)} of {self._count} chunks done>"

    @property
    def folder(self) -> str:
        """Its path."""
        return self._job.folder

    @property
    def _count(self) -> int:
        return -(-self._job.samples // self._job.chunk)

    @property
    def done(self) -> tuple[int, ...]:
        """The chunks that are there."""
        return tuple(sorted(i for i in self._folder.done() if i < self._count))

    @property
    def missing(self) -> tuple[int, ...]:
        """The chunks that are not there."""
        done = set(self._folder.done())
        return tuple(i for i in range(self._count) if i not in done)

    @property
    def failed(self) -> dict[int, str]:
        """What chunks raised that are not there, by number: the error with its chunk and seed, and where it was."""
        return self._folder.failed()

    def warm(self, executor: Any = None, *, threads: int | None = None) -> Study:
        """Run one chunk that is missing, and wait: what it compiles is kept on disk for the workers that follow.

        executor, threads  as of ``run``

        Returns itself. Raises StudyError.
        """
        self._run(self.missing[:1], executor, False, threads)
        return self

    def run(self, executor: Any = None, *, progress: Progress = False, threads: int | None = None) -> Study:
        """Run the chunks that are missing, those that failed too.

        executor  where: any ``concurrent.futures.Executor``, such as ``client.get_executor()`` of Dask or the Client
                  itself, ``mpi4py.futures.MPIPoolExecutor()``, loky's; None here, one chunk after another, each on all
                  threads, which on one machine is fastest. A ``ProcessPoolExecutor`` should have the context "spawn"
                  (``multiprocessing.get_context``): a forked process may wait for a lock of a thread that it has not
        progress  True for a bar, or a function of the chunks that are done and their number
        threads   of each worker's batches; None leaves it to them

        What a chunk raises is kept (``failed``) and the others go on; a chunk whose worker is lost is given to another,
        twice. Ctrl-C ends the run; what is done stays. Returns itself.

        Raises  StudyError if chunks are lost again and again, or the executor takes no more; SpatialDynError
        """
        check_progress(progress)
        self._run(self.missing, executor, progress, threads)
        return self

    def _run(self, chunks: tuple[int, ...], executor: Any, progress: Progress, threads: int | None) -> None:
        if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
            raise StudyError(f"threads is {literal(threads)}, expected a number of threads or None")
        if threads is not None and executor is None:
            raise StudyError(
                f"threads is {literal(threads)} without an executor, expected None, or sd.set_num_threads here"
            )
        given = getattr(executor, "get_executor", None)
        executor = executor if given is None else given()
        if executor is not None and not callable(getattr(executor, "submit", None)):
            raise StudyError(
                f"executor is {literal(executor)}, expected one with submit, such as of concurrent.futures"
            )
        self._check()
        self._folder.begin(self._manifest)
        job = replace(self._job, threads=threads)
        with reporting(progress, "studying") as report:
            steps = Steps(report, self._count)
            steps.next(self._count - len(chunks))
            outcomes = map(lambda i: run_chunk(job, i), chunks) if executor is None else _spread(job, chunks, executor)
            for _ in outcomes:
                steps.next()

    def result(self, partial: bool = False) -> dict[str, Any]:
        """The results of the reductions, by label.

        partial  whether that of the chunks that are there is wanted; otherwise all have to be

        Raises  StudyError for chunks that are missing, with what the first of them raised
        """
        states = self._states(as_flag("partial", partial))
        return {label: x.finish(states[label]) for label, x in self._job.reductions.items()}

    def digest(self) -> str:
        """SHA-256 of all that was reduced: two runs with one digest have the same results to the bit."""
        found = hashlib.sha256()
        for label, state in sorted(self._states(False).items()):
            for name, x in sorted(state.items()):
                found.update(f"{label}/{name} {x.dtype.str} {x.shape} ".encode() + np.ascontiguousarray(x).tobytes())
        return found.hexdigest()

    def __getitem__(self, name: str) -> Stored:
        """A kept output of all samples, an array on disk. Raises StudyError if it is not kept or chunks are missing."""
        if name not in self._job.keep:
            raise StudyError(
                f"{literal(name)} is not kept, expected one of {', '.join(self._job.keep) or 'none: keep=()'}"
            )
        self._all()
        return Stored(self._folder, name, tuple(self._job.length(i) for i in range(self._count)))

    def _all(self) -> None:
        """Raise StudyError unless all chunks are there."""
        missing = self.missing
        if missing:
            failed = self.failed
            why = f"; {failed[min(failed)].splitlines()[0]}" if failed else ""
            raise StudyError(f"{len(missing)} of {self._count} chunks are missing, expected run() before{why}")

    def _states(self, partial: bool) -> dict[str, dict[str, Any]]:
        """The merged states of the reductions, chunk after chunk: no two in memory but the sum and the next."""
        if not partial:
            self._all()
        whole: dict[str, dict[str, Any]] = {}
        for i in self.done:
            states = self._folder.states(i)
            for label, x in self._job.reductions.items():
                if label not in states:
                    raise StudyError(f'part {i} in {self.folder} has no "{label}": remove it, and run the study again')
                whole[label] = merged(x, [whole[label], states[label]]) if label in whole else states[label]
        if not whole and self._job.reductions:
            raise StudyError(f"no chunk is done in {self.folder}, expected run() before")
        return whole


def _names(keep: Any) -> tuple[str, ...]:
    given = names_of("keep", keep)
    for name in given:
        if not name.isidentifier() or name in RESERVED:
            raise StudyError(f"keep holds {literal(name)}, expected names of outputs, no {', '.join(RESERVED)}")
    return given


def _spread(job: Job, chunks: tuple[int, ...], executor: Any) -> Iterator[Outcome]:
    """The outcomes of chunks on an executor, as they come."""
    from concurrent.futures import Future
    from queue import SimpleQueue

    lost: Counter[int] = Counter()
    waiting, pending = list(reversed(chunks)), dict[Future[Outcome], int]()
    ended: SimpleQueue[Future[Outcome]] = SimpleQueue()  # to wait for one of thousands costs as little as for one
    try:
        while waiting or pending:
            while waiting and len(pending) < AHEAD and ended.empty():
                try:
                    future = executor.submit(run_chunk, job, waiting[-1])
                except Exception as error:
                    done = len(Folder(job.folder).done())
                    raise StudyError(
                        f"the executor takes no chunk ({type(error).__name__}: {error}); {done} are done: run again"
                    ) from error
                pending[future] = waiting.pop()
                future.add_done_callback(ended.put)
            future = ended.get()
            i = pending.pop(future)
            fault = None if future.cancelled() else future.exception()
            if fault is None and not future.cancelled():
                yield future.result()
                continue
            lost[i] += 1
            if lost[i] == TRIES:
                why = f"{type(fault).__name__}: {fault}"
                raise StudyError(f"chunk {i} was lost {TRIES} times ({why}), expected workers that live") from fault
            waiting.append(i)
    finally:
        for future in pending:
            future.cancel()
