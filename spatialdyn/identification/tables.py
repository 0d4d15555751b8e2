"""Tables of a recording: columns t, q0 ..., tau0 ... by their names, from a mapping, a CSV file or a parquet file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import IdentificationError, SpatialDynError, literal
from ..model.model import Model
from .unknowns import own_joints

Array = NDArray[np.float64]
KINDS = ("q", "v", "a", "tau")
SEPARATORS = (",", ";", "\t")
WRENCH = re.compile(r"wrench_(.+)_([0-5])")


def arrays_of(columns: Mapping[str, ArrayLike], model: Model | None) -> dict[str, Any]:
    """t, q, v, a, tau and wrenches of named columns; other columns are ignored. Raises IdentificationError."""
    given = [str(name) for name in columns]
    refuse_twice(given)
    where = dict(zip(given, columns, strict=True))
    if "t" not in where:
        raise IdentificationError(f"columns are {', '.join(given[:8])}, expected t among them")
    joints = [] if model is None else [x.name for x in own_joints(model) if x.nv == 1]
    found: dict[str, Any] = {kind: _names_of(kind, where, joints) for kind in KINDS}
    for kind in ("q", "tau"):
        if not found[kind]:
            names = "" if model is None else f" or {kind}_JOINT of {', '.join(joints[:4])}"
            known = f"{kind}0, {kind}1, ...{names or f'; with a model, {kind}_JOINT'}"
            raise IdentificationError(f"columns have no {kind}0, expected {known}")
    frames = sorted({x[1] for name in given if (x := WRENCH.fullmatch(name))})
    wrenches = {frame: [f"wrench_{frame}_{k}" for k in range(6)] for frame in frames}
    for name in (x for names in wrenches.values() for x in names):
        if name not in where:
            raise IdentificationError(f"columns have no {name}, expected six of each wrench: force, then moment")

    def stack(names: Iterable[str]) -> Array | None:
        parts = [_numbers(name, columns[where[name]]) for name in names]
        return np.stack(parts, 1) if parts else None

    return {
        "t": _numbers("t", columns[where["t"]]), **{kind: stack(names) for kind, names in found.items()},
        "wrenches": {frame: stack(names) for frame, names in wrenches.items()},
    }  # fmt: skip


def _names_of(kind: str, given: Mapping[str, Any], joints: list[str]) -> list[str]:
    """Names of the columns kind0, kind1, ... or kind_JOINT that exist. Raises IdentificationError for a gap."""
    numbers = sorted(int(name[len(kind) :]) for name in given if re.fullmatch(kind + "(0|[1-9][0-9]*)", name))
    numbered = [f"{kind}{k}" for k in range(numbers[-1] + 1)] if numbers else []
    named = [f"{kind}_{joint}" for joint in joints]
    both = [name for name in named if name in given]
    if numbered and both:
        raise IdentificationError(f"columns have {kind}{numbers[0]} and {both[0]}, expected numbers or names of joints")
    wanted = numbered or (named if both else [])
    for name in wanted:
        if name not in given:
            raise IdentificationError(f"columns have no {name}, expected it among {', '.join(wanted[:8])}")
    return wanted


def _numbers(name: str, given: Any) -> Array:
    """One column (N,) of float64. Raises IdentificationError naming it."""
    x = np.asarray(given)
    if x.dtype.kind in "mM":
        raise IdentificationError(f"column {name} is of times ({x.dtype}), expected seconds as numbers")
    try:
        x = x.astype(float)
    except (TypeError, ValueError) as error:
        raise IdentificationError(f"column {name} cannot be read as numbers: {error}") from None
    if x.ndim != 1:
        raise IdentificationError(f"column {name} has shape {x.shape}, expected (N,)")
    return np.asarray(x, np.float64)


def refuse_twice(names: list[str]) -> None:
    """Raise IdentificationError if two columns have the same name."""
    for k, name in enumerate(names):
        if name in names[:k]:
            raise IdentificationError(f"columns have {name} {names.count(name)} times, expected each name once")


def from_csv(path: Any) -> dict[str, Any]:
    """Columns of a CSV file by the names in its first line: as numbers if all cells are numbers, otherwise as texts.

    The first line determines the separator: comma, semicolon or tab. Lines that begin with # are ignored, unless they
    hold the names, as NumPy writes them. Raises SpatialDynError.
    """
    try:
        with open(path, encoding="utf-8-sig") as file:  # a spreadsheet begins with a byte order mark
            lines = [(k, line.strip("\r\n")) for k, line in enumerate(file, 1) if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise SpatialDynError(f"{literal(path)} cannot be read: {error}") from error
    remarks = 0
    while remarks < len(lines) and lines[remarks][1].startswith("#"):
        remarks += 1
    head, rows = lines[:remarks], lines[remarks:]
    if rows and not (head and _cells(rows[0][1], _separator(rows[0][1]))[0].strip("+-.")[:1].isdigit()):
        head, rows = rows[:1], rows[1:]
    if not head or not rows:
        raise SpatialDynError(f"{literal(path)} is empty, expected a line of names and rows of numbers")
    first = head[-1][1].removeprefix("#").strip(" ")
    names = _cells(first, separator := _separator(first))
    if re.fullmatch(r"[+-]?[0-9.]+([eE][+-]?[0-9]+)?", names[0]):
        raise SpatialDynError(f"{literal(path)} begins with {names[0]}, expected a line of names: t, q0, ...")
    refuse_twice([name for name in names if name])
    try:
        table = np.loadtxt([line for _, line in rows], delimiter=separator, ndmin=2)
    except ValueError:
        table = np.zeros((0, 0))
    if table.shape[1:] == (len(names),):
        return dict(zip(names, table.T, strict=True))
    return _by_cells(path, names, rows, separator)


def _by_cells(path: Any, names: list[str], rows: list[tuple[int, str]], separator: str) -> dict[str, Any]:
    """Columns of lines in which some cells are not numbers; such columns become texts. Raises SpatialDynError."""
    cells = [_cells(line, separator) for _, line in rows]
    for (number, _), own in zip(rows, cells, strict=True):
        if len(own) != len(names):
            raise SpatialDynError(
                f"{literal(path)} has {len(own)} cells in line {number} under {len(names)} names, expected as many"
            )
    table: dict[str, Any] = {}
    for k, name in enumerate(names):
        own_column = [row[k] for row in cells]
        wanted = name == "t" or re.fullmatch(r"(q|v|a|tau)(\d+|_.*)", name) or WRENCH.fullmatch(name)
        try:
            table[name] = np.array([float(x) for x in own_column])
        except ValueError:
            if wanted:
                bad = next(i for i, x in enumerate(own_column) if not _is_number(x))
                raise SpatialDynError(
                    f"{path!r} has {literal(own_column[bad])} in line {rows[bad][0]}, column {name}, expected a number"
                ) from None
            table[name] = np.array(own_column)
    return table


def _separator(line: str) -> str:
    return max(SEPARATORS, key=line.count)


def _cells(line: str, separator: str) -> list[str]:
    return [x.strip().strip('"') for x in line.split(separator)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def from_parquet(path: Any) -> dict[str, Any]:
    """Columns of a parquet file, with its index if that has a name. Raises SpatialDynError."""
    try:
        import pandas
    except ImportError as error:
        raise SpatialDynError("pandas is not installed, expected it for parquet; pip install pandas pyarrow") from error
    try:
        frame = pandas.read_parquet(path)
    except Exception as error:  # the engine of pandas has its own errors
        raise SpatialDynError(f"{literal(path)} cannot be read: {error}") from error
    frame = frame.reset_index() if any(frame.index.names) else frame
    refuse_twice([str(name) for name in frame.columns])
    return {str(name): frame[name].to_numpy() for name in frame.columns}
