"""The files of a study: a manifest, and for each chunk its kept arrays and, last, the states of its reductions.

Each file is written under a temporary name and renamed by ``os.replace``, so it is complete or absent, even if a
process is killed; files that a killed process leaves end in ".part" and may be removed. A chunk is done if its ``part``
exists.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import StudyError

Array = NDArray[Any]
MANIFEST = "manifest.json"
UNFINISHED = ".part"  # ending of files that a process is writing


class Folder:
    """The files of a study in a folder, which is created at the first write."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """A folder at a path; nothing is read or written yet."""
        self.path = Path(path).absolute()

    def manifest(self) -> dict[str, Any] | None:
        """The manifest of the study; None without one. Raises StudyError for an invalid manifest."""
        try:
            text = (self.path / MANIFEST).read_text(encoding="utf-8")
        except FileNotFoundError:
            if self.path.is_dir() and any(x.suffix != UNFINISHED for x in self.path.iterdir()):
                raise StudyError(f"{self.path} holds other files than a study's, expected an empty folder") from None
            return None
        except OSError as error:
            raise StudyError(f"{self.path} cannot be read: {error}") from error
        try:
            found = json.loads(text)
        except ValueError as error:
            raise StudyError(f"{self.path / MANIFEST} is damaged: {error}") from error
        if not isinstance(found, dict):
            raise StudyError(f"{self.path / MANIFEST} is no manifest")
        return found

    def begin(self, manifest: Mapping[str, Any]) -> None:
        """Write the manifest unless it exists. Raises StudyError."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if not (self.path / MANIFEST).exists():
                self._put(MANIFEST, json.dumps(manifest, indent=1).encode())
        except OSError as error:
            raise StudyError(f"{self.path} cannot be written: {error}") from error

    def done(self) -> set[int]:
        """The chunks that are done."""
        return self._numbers("part-", ".npz")

    def failed(self) -> dict[int, str]:
        """The errors of chunks that are not done."""
        missing = self._numbers("failed-", ".txt") - self.done()
        made = {}
        for i in sorted(missing):
            with suppress(FileNotFoundError):  # another driver has done it meanwhile
                made[i] = self._name("failed", i, ".txt").read_text(encoding="utf-8")
        return made

    def write(self, chunk: int, kept: Mapping[str, Array], states: Mapping[str, Mapping[str, Array]]) -> None:
        """The arrays of a chunk, then its part."""
        for name, x in kept.items():
            with _Replaced(self._name(name, chunk, ".npy")) as part:
                np.save(part, x)
        flat = {f"{label}/{name}": x for label, state in states.items() for name, x in state.items()}
        with _Replaced(self._name("part", chunk, ".npz")) as part:
            whole: dict[str, Any] = {"chunk": np.array(chunk), **flat}
            np.savez(part, **whole)
        self._name("failed", chunk, ".txt").unlink(missing_ok=True)

    def write_failure(self, chunk: int, text: str) -> None:
        """Write the error of a chunk."""
        self._put(self._name("failed", chunk, ".txt").name, text.encode("utf-8", "replace"))

    def states(self, chunk: int) -> dict[str, dict[str, Array]]:
        """The states of a chunk's reductions, by label. Raises StudyError."""
        place = self._name("part", chunk, ".npz")
        made: dict[str, dict[str, Array]] = {}
        try:
            with place.open("rb") as content, np.load(content) as file:
                for key in file.files:
                    label, _, name = key.partition("/")
                    if name:
                        made.setdefault(label, {})[name] = file[key]
        except Exception as error:  # zipfile's, zlib's, pickle's
            raise StudyError(f"{place} is damaged ({error}): remove it, and run the study again") from error
        return made

    def array(self, name: str, chunk: int) -> Array:
        """A kept array of a chunk, memory-mapped. Raises StudyError."""
        place = self._name(name, chunk, ".npy")
        try:
            made: Array = np.load(place, mmap_mode="r")
        except Exception as error:
            raise StudyError(
                f"{place} is damaged or missing ({error}): remove part-{chunk:08d}.npz, run again"
            ) from error
        return made

    def _name(self, what: str, chunk: int, ending: str) -> Path:
        return self.path / f"{what}-{chunk:08d}{ending}"

    def _numbers(self, start: str, end: str) -> set[int]:
        try:
            names = [x.name for x in self.path.iterdir()]
        except FileNotFoundError:
            return set()
        found = (x[len(start) : -len(end)] for x in names if x.startswith(start) and x.endswith(end))
        return {int(x) for x in found if x.isdigit()}

    def _put(self, name: str, content: bytes) -> None:
        with _Replaced(self.path / name) as part:
            part.write(content)


class _Replaced:
    """A file that gets its name when it is complete."""

    def __init__(self, place: Path) -> None:
        self._place, self._part = place, place.with_name(os.urandom(8).hex() + UNFINISHED)

    def __enter__(self) -> Any:
        self._file = self._part.open("wb")
        return self._file

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self._file.close()
        if kind is None:
            os.replace(self._part, self._place)
        else:
            self._part.unlink(missing_ok=True)


class Stored:
    """A kept output of all samples: an array on disk, of which only the indexed parts are read.

    ``x[3]``, ``x[10:20, 2]``, ``x[indices]``, ``np.asarray(x)``; ``for part in x.parts()`` iterates over the chunks,
    memory-mapped. ``dask.array.from_array(x, chunks=x.chunks)`` accepts it.

    shape, dtype, ndim  those of the whole array
    chunks              lengths of its blocks along each axis
    """

    def __init__(self, folder: Folder, name: str, lengths: tuple[int, ...]) -> None:
        """An output in a folder whose chunks are all done."""
        first = folder.array(name, 0)
        self._folder, self._name = folder, name
        self._ends = np.cumsum(lengths)
        self.shape: tuple[int, ...] = (int(self._ends[-1]), *first.shape[1:])
        self.dtype = first.dtype
        self.chunks = (lengths, *((k,) for k in first.shape[1:]))

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<Stored {self._name}: {self.shape} of {self.dtype} in {len(self._ends)} parts>"

    def parts(self) -> Iterator[Array]:
        """The chunks in order, memory-mapped."""
        for i in range(len(self._ends)):
            yield self._folder.array(self._name, i)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        made = np.concatenate(list(self.parts()))
        return made if dtype is None else made.astype(dtype)

    def __getitem__(self, key: Any) -> Any:
        whole = key if isinstance(key, tuple) else (key,)
        if not whole or whole[0] is None or whole[0] is Ellipsis:
            return np.asarray(self)[key]
        at, rest = whole[0], whole[1:]
        rows = np.arange(len(self))[at]
        taken = np.empty((*np.shape(rows), *self.shape[1:]), self.dtype)
        flat, numbers = taken.reshape((-1, *self.shape[1:])), np.ravel(rows)
        where = np.searchsorted(self._ends, numbers, side="right")
        for i in np.unique(where):
            here = where == i
            start = self._ends[i] - self.chunks[0][i]
            flat[here] = self._folder.array(self._name, int(i))[numbers[here] - start]
        return taken[(slice(None),) * np.ndim(rows) + rest] if rest else taken[()]
