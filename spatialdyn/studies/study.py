"""A study: a function of a scene on many random samples, run in chunks, here or on any executor, resumable any time."""

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

AHEAD = 4096  # chunks submitted to an executor at a time: twice the workers of a large cluster
TRIES = 3  # attempts at a chunk whose worker is lost
SOURCE = "source (of the function, with the values that it holds and names)"
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

    fn       ``fn(scene, rng, n)``: returns a dict of arrays (n, ...), for n samples drawn from a numpy Generator
    scene    Scene or Model, the first argument of fn
    samples  number of all samples
    chunk    samples per call of fn; with half a second of work or more the overhead is small
    seed     chunk i draws from ``numpy.random.SeedSequence(seed, spawn_key=(i,))``
    folder   where parts are written; workers on other machines must see it under the same path
    keep     names of outputs that are stored completely: ``study["q"]``
    reduce   summaries of outputs: ``{label: sd.Moments("tau"), ...}``, or one reduction; see ``sd.Moments``,
             ``sd.Quantiles``, ``sd.Worst``, ``sd.TallQR``

    If the folder holds parts of the same study, the study resumes. Results are the same bits on any executor and in any
    number of runs, on processors that fuse multiplications and additions alike.

    Raises  StudyError for bad arguments, and for a folder of another study, naming the differences; ModelError

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
    """The result of ``study``; see there.

    folder   path of its folder
    done     numbers of the chunks that are done, a tuple
    missing  numbers of the other chunks
    failed   errors of the chunks that failed: {chunk: text with chunk, seed and traceback}
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
        """Raise StudyError if the folder belongs to another study."""
        found = self._folder.manifest()
        if found is None:
            return
        for name, ours in self._manifest.items():
            theirs = found.get(name)
            if theirs != ours:
                what = SOURCE if name == "source" else name
                raise StudyError(
                    f"{self.folder} holds a study whose {what} is {theirs}, expected {ours}: choose another folder"
                )

    def __repr__(self) -> str:
        return f"<Study of {self._job.samples} samples in {self.folder}: {len(self.done)} of {self._count} chunks done>"

    @property
    def folder(self) -> str:
        """Path of its folder."""
        return self._job.folder

    @property
    def _count(self) -> int:
        return -(-self._job.samples // self._job.chunk)

    @property
    def done(self) -> tuple[int, ...]:
        """The chunks that are done."""
        return tuple(sorted(i for i in self._folder.done() if i < self._count))

    @property
    def missing(self) -> tuple[int, ...]:
        """The chunks that are not done."""
        done = set(self._folder.done())
        return tuple(i for i in range(self._count) if i not in done)

    @property
    def failed(self) -> dict[int, str]:
        """Errors of chunks that are not done, by number: the error with its chunk, seed and traceback."""
        return self._folder.failed()

    def warm(self, executor: Any = None, *, threads: int | None = None) -> Study:
        """Run one missing chunk and wait: the kernels that it compiles are cached on disk for later workers.

        executor, threads  as in ``run``

        Returns itself. Raises StudyError.
        """
        self._run(self.missing[:1], executor, False, threads)
        return self

    def run(self, executor: Any = None, *, progress: Progress = False, threads: int | None = None) -> Study:
        """Run the chunks that are missing, including those that failed.

        executor  any ``concurrent.futures.Executor``, such as ``client.get_executor()`` of Dask or the Client itself,
                  ``mpi4py.futures.MPIPoolExecutor()``, loky's; a ``ray.util.multiprocessing.Pool``; None runs one chunk
                  after another in this process, each on all threads, which is fastest on one machine. A
                  ``ProcessPoolExecutor`` should have the context "spawn" (``multiprocessing.get_context``): a forked
                  process may wait for a lock whose thread does not exist in it
        progress  True for a progress bar, or a function of the number of chunks that are done and of all chunks
        threads   threads for each worker's batches; None leaves the choice to the worker

        Errors of a chunk are kept (``failed``) and other chunks continue; a chunk whose worker is lost is submitted
        again, twice. Ctrl-C ends the run; finished chunks stay. Returns itself.

        Raises  StudyError if chunks are lost repeatedly, or the executor accepts no more; SpatialDynError
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
        if not hasattr(executor, "submit") and callable(getattr(executor, "apply_async", None)):
            from .pools import PoolExecutor

            executor = PoolExecutor(executor)
        if executor is not None and not callable(getattr(executor, "submit", None)):
            raise StudyError(
                f"executor is {literal(executor)}, expected one with submit, such as of concurrent.futures"
            )
        self._check()
        self._folder.begin(self._manifest)
        self._check()  # another study may have begun there meanwhile
        job = replace(self._job, threads=threads)
        with reporting(progress, "studying") as report:
            steps = Steps(report, self._count)
            steps.next(self._count - len(chunks))
            outcomes = map(lambda i: run_chunk(job, i), chunks) if executor is None else _spread(job, chunks, executor)
            for _ in outcomes:
                steps.next()

    def result(self, partial: bool = False) -> dict[str, Any]:
        """The results of the reductions, by label.

        partial  True for the results of the chunks that are done; otherwise all must be done

        Raises  StudyError for missing chunks, with the error of the first of them
        """
        states = self._states(as_flag("partial", partial))
        return {label: x.finish(states[label]) for label, x in self._job.reductions.items()}

    def digest(self) -> str:
        """SHA-256 of all reductions and kept outputs: two runs with the same digest have the same results to the bit.

        Reads the kept outputs, chunk by chunk.
        """
        found = hashlib.sha256()
        for label, state in sorted(self._states(False).items()):
            for name, x in sorted(state.items()):
                found.update(f"{label}/{name} {x.dtype.str} {x.shape} ".encode() + np.ascontiguousarray(x).tobytes())
        for name in sorted(self._job.keep):
            for x in self[name].parts():
                found.update(f"{name} {x.dtype.str} {x.shape} ".encode() + np.ascontiguousarray(x).tobytes())
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
        """Raise StudyError unless all chunks are done."""
        missing = self.missing
        if missing:
            failed = self.failed
            why = f"; {failed[min(failed)].splitlines()[0]}" if failed else ""
            raise StudyError(f"{len(missing)} of {self._count} chunks are missing, expected run() before{why}")

    def _states(self, partial: bool) -> dict[str, dict[str, Any]]:
        """The merged states of the reductions, chunk after chunk: only the sum and the next are in memory."""
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
    ended: SimpleQueue[Future[Outcome]] = SimpleQueue()  # waiting for any of thousands is as cheap as for one
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
                raise StudyError(
                    f"chunk {i} was lost {TRIES} times ({why}), expected workers that live and a function that pickles"
                ) from fault
            waiting.append(i)
    finally:
        for future in pending:
            future.cancel()
