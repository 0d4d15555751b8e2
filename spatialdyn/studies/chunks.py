"""A worker's computation of one chunk, which depends only on the job and the chunk's number."""

from __future__ import annotations

import hashlib
import inspect
import os
import pickle
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from types import CodeType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled.stamp import STAMP
from ..engines.programs.llvm import host_cpu
from ..engines.threads import set_num_threads
from ..errors import StudyError, literal
from ..simulation.scene import Scene
from .folder import Folder
from .reductions import Reduction, array_of

Array = NDArray[Any]
Function = Callable[[Any, np.random.Generator, int], Mapping[str, Any]]


@dataclass(frozen=True)
class Job:
    """The data that all chunks of a study share; can be pickled."""

    function: Function
    scene: Any
    samples: int
    chunk: int
    seed: int
    folder: str
    keep: tuple[str, ...]
    reductions: dict[str, Reduction]
    host: dict[str, Any]
    threads: int | None = None

    def length(self, i: int) -> int:
        """Number of samples of chunk i."""
        return min(self.chunk, self.samples - i * self.chunk)


class Outcome(NamedTuple):
    """The outcome of a chunk.

    failure  the error that its function raised, with chunk and seed; "" if it is done
    seconds  time in the worker, without writing
    """

    chunk: int
    failure: str
    seconds: float


def host_of() -> dict[str, Any]:
    """What a chunk's bits depend on beside the job: versions, and whether the processor fuses multiply and add."""
    return {"sources": STAMP, "numpy": np.__version__, "llvmlite": version("llvmlite"), "fma": host_cpu.host()[3]}


def run_chunk(job: Job, i: int) -> Outcome:
    """Compute a chunk and write its part, or the error that its function raises."""
    folder, began = Folder(job.folder), time.perf_counter()
    if job.threads is not None:
        set_num_threads(job.threads)
    try:
        here = host_of()
        if here != job.host:
            other = next(name for name, x in here.items() if x != job.host[name])
            raise StudyError(f"this worker has {other} {here[other]}, expected {job.host[other]} as the study's")
        generator = np.random.default_rng(np.random.SeedSequence(job.seed, spawn_key=(i,)))
        arrays = _checked(job.function(job.scene, generator, job.length(i)), job.length(i))
        kept = {name: array_of(arrays, name) for name in job.keep}
        states = {label: x.of(arrays, i * job.chunk) for label, x in job.reductions.items()}
        seconds = time.perf_counter() - began
        folder.write(i, kept, states)
    except Exception as error:
        text = f"chunk {i}, seed ({job.seed}, spawn_key=({i},)): {type(error).__name__}: {error}"
        folder.write_failure(i, f"{text}\n\n{traceback.format_exc()}")
        return Outcome(i, text, time.perf_counter() - began)
    return Outcome(i, "", seconds)


def _checked(found: Any, n: int) -> dict[str, Array]:
    """The results of the function as arrays. Raises StudyError."""
    if not isinstance(found, Mapping) or not found:
        raise StudyError(f"the function returned {type(found).__name__}, expected a dict of arrays (n, ...)")
    arrays = {str(name): np.asarray(x) for name, x in found.items()}
    for name, x in arrays.items():
        if not x.ndim or len(x) != n:
            raise StudyError(f"{name} has shape {x.shape}, expected ({n}, ...): a row for each sample")
        if x.dtype.hasobject:
            raise StudyError(f"{name} has dtype {x.dtype}, expected numbers")
    return arrays


# --- what a study is ------------------------------------------------------------------------------------


def digest_of_scene(scene: Any) -> str:
    """Digest of the content of a Scene or Model, the same in every process."""
    if not isinstance(scene, Scene):
        return str(scene.key)
    return hashlib.sha256(f"{scene.model.key} {scene.to_toml()}".encode()).hexdigest()


def digest_of_function(function: Any) -> str:
    """Digest of a function's source, and of the values that it refers to: its defaults, its closure, arguments of
    ``functools.partial``, the functions and plain values of its module that it names.

    Raises StudyError for a function with values that cannot be pickled.
    """
    held: list[Any] = []
    while isinstance(function, partial):
        held.append((function.args, sorted(function.keywords.items())))
        function = function.func
    if not inspect.isroutine(function):
        held.append(getattr(function, "__dict__", {}))
        function = type(function)
    known: dict[int, Any] = {}
    sources: list[bytes] = []
    _read(function, held, sources, known)
    try:
        values = pickle.dumps(held, 4)
    except Exception as error:
        raise StudyError(
            f"the function holds what cannot be pickled ({error}): hand it over by the scene or functools.partial"
        ) from error
    return hashlib.sha256(b"\0".join([*sources, values])).hexdigest()


def _read(thing: Any, held: list[Any], sources: list[bytes], known: dict[int, Any]) -> None:
    """Add a function's values and source, and those of the functions of its module that it names."""
    if id(thing) in known:
        return
    known[id(thing)] = thing
    sources.append(_source(thing))
    function = getattr(thing, "__func__", thing)
    if function is not thing:  # a method
        held.append(getattr(thing.__self__, "__dict__", {}))
    if not inspect.isfunction(function):
        return
    cells = [x.cell_contents for x in function.__closure__ or ()]
    held.append((function.__defaults__, function.__kwdefaults__, cells))
    for name in _names(function.__code__):
        value = function.__globals__.get(name)
        if inspect.isfunction(value) and value.__module__ == function.__module__:
            _read(value, held, sources, known)
        else:
            content = _plain(value)
            if content is not None:
                sources.append(name.encode() + b"=" + content)


def _names(code: CodeType) -> list[str]:
    """The names that a function and its inner functions read."""
    inner = (_names(x) for x in code.co_consts if isinstance(x, CodeType))
    return sorted({*code.co_names, *(name for names in inner for name in names)})


def _plain(value: Any) -> bytes | None:
    """A number, text, array or sequence of these as bytes that are the same in every process; None for other values."""
    if isinstance(value, (np.ndarray, np.generic)):
        head = f"{value.dtype.str}{value.shape}".encode()
        return None if value.dtype.hasobject else head + value.tobytes()
    if isinstance(value, (tuple, list)):
        parts = [_plain(x) for x in value]
        found = [x for x in parts if x is not None]
        return b"(" + b",".join(found) + b")" if len(found) == len(parts) else None
    return repr(value).encode() if isinstance(value, (bool, int, float, complex, str, bytes)) else None


def _source(thing: Any) -> bytes:
    """The source text; the code if there is no text."""
    try:
        return inspect.getsource(thing).encode()
    except (OSError, TypeError):
        code = getattr(thing, "__code__", None)
        return thing.__qualname__.encode() if code is None else _content(code)


def _content(code: CodeType) -> bytes:
    """The content of a function without source text: its code, and that of its inner functions."""
    constants = [_content(x) if isinstance(x, CodeType) else repr(x).encode() for x in code.co_consts]
    return b"\0".join([code.co_code, repr(code.co_names).encode(), *constants])


def manifest_of(job: Job) -> dict[str, Any]:
    """The values that must agree for parts to belong to one study."""
    made: dict[str, Any] = {
        "function": getattr(job.function, "__qualname__", type(job.function).__name__),
        "source": digest_of_function(job.function), "scene": digest_of_scene(job.scene), "samples": job.samples,
        "chunk": job.chunk, "seed": job.seed, "keep": list(job.keep),
        "reduce": {label: repr(x) for label, x in job.reductions.items()},
    }  # fmt: skip
    return {**made, **job.host}


def path_of(folder: Any) -> str:
    """A folder as its absolute path. Raises StudyError."""
    try:
        text = os.fspath(folder)
    except TypeError:
        text = b""
    if not isinstance(text, str) or not text or "\0" in text:
        raise StudyError(f"folder is {literal(folder)}, expected the path of a folder")
    return os.path.abspath(text)
