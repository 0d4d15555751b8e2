"""Argument checks of the public calls: dtypes, shapes, broadcasting, outputs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.static_table import StaticTable
from ..engines.memory import empty as empty
from ..errors import ModelError, NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..model.robot_checks import masked
from ..recursions.spec import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, Argument, shape_in

Array = NDArray[np.float64]
RIGID = 1e-6  # largest error of a pose's rotation and last row
MOST_AXES = 32  # the most axes of an array that NumPy broadcasts
REFERENCES = {"local": LOCAL, "world": WORLD, "local_world_aligned": LOCAL_WORLD_ALIGNED}


def check_model(model: Any) -> Model:
    """The model, if it is one. Raises ModelError."""
    if not isinstance(model, Model):
        raise ModelError(f"model is a {type(model).__name__}, expected a spatialdyn Model")
    return model


def as_array(name: str, value: ArrayLike) -> Array:
    """A float64 array of any array-like of real numbers.

    Raises ShapeError naming the argument, NonFiniteError for finite numbers that overflow float64.
    """
    if type(value) is not np.ndarray:
        if masked(value):
            raise ShapeError(f"{name} is masked, expected an array without a mask, which would be lost")
        _refuse_elsewhere(name, value)
    try:
        x = np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name} is ragged, expected an array of numbers") from error
    if x.dtype.kind not in "fiu":
        raise ShapeError(f"{name} has dtype {x.dtype}, expected real numbers")
    if x.ndim > MOST_AXES:
        raise ShapeError(f"{name} has {x.ndim} axes, expected at most {MOST_AXES}")
    if x.dtype.kind != "f" or x.dtype.itemsize <= 8:
        return x.astype(np.float64, copy=False)
    with np.errstate(over="ignore"):
        converted = x.astype(np.float64)
    finite = np.isfinite(x)
    if not np.isfinite(converted[finite]).all():
        raise NonFiniteError(f"{name} holds {abs(x[finite]).max()!s}, expected the range of float64")
    return converted


def _refuse_elsewhere(name: str, value: Any) -> None:
    """Raise ShapeError for a Dask array and for an array on a GPU, which NumPy would compute or fetch silently."""
    if hasattr(value, "__dask_graph__"):
        raise ShapeError(
            f"{name} is a Dask {type(value).__name__}, expected an array in memory: {name}.compute(), or block by "
            "block dask.array.map_blocks(lambda ...: sd.rnea(model, ...), ..., meta=numpy.empty((0, 0)))"
        )
    if hasattr(value, "__cuda_array_interface__"):
        raise ShapeError(
            f"{name} is a {type(value).__name__} on a GPU, expected an array in the memory of the CPU, or "
            'sd.specialize(model, ..., device="cuda") for arrays there'
        )


def as_finite(name: str, value: ArrayLike) -> Array:
    """``as_array`` of finite numbers. Raises NonFiniteError."""
    x = as_array(name, value)
    if not np.isfinite(x).all():
        raise NonFiniteError(f"{name} has numbers that are not finite, expected finite ones")
    return x


def within_range(name: str, *results: Array) -> None:
    """Raise NonFiniteError if results of finite numbers are not finite: they are beyond the range of float64."""
    if not all(np.isfinite(x).all() for x in results):
        raise NonFiniteError(f"{name} is beyond the range of float64, expected arguments that are less far from 1")


def pose_fault(X: Array) -> str:
    """The reason why matrices (..., 4, 4) are not poses, "" if they are."""
    R = X[..., :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0)
    if not off <= RIGID:
        return f"no rotation: R Rᵀ is off 1 by {off:.2g}"
    if (np.linalg.det(R) < 0.0).any():
        return "no rotation but a reflection, det R = -1"
    last = abs(X[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0])).max(initial=0.0)
    return f"a last row that is off [0, 0, 0, 1] by {last:.2g}" if last > RIGID else ""


def as_flag(name: str, value: Any) -> bool:
    """True or False, Python's or NumPy's. Raises SpatialDynError naming the argument."""
    if not isinstance(value, (bool, np.bool_)):
        raise SpatialDynError(f"{name} is {literal(value)}, expected True or False")
    return bool(value)


def as_number(value: Any) -> float:
    """A real number as a float, ±inf if it overflows; NaN for anything else, bools included."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def as_count(value: Any, most: int) -> int:
    """An integer of 1 to ``most``; 0 for anything else, bools included."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= most:
        return 0
    return int(value)


def as_word(name: str, value: Any, known: Collection[str], error: type[SpatialDynError] = SpatialDynError) -> str:
    """One of the strings ``known``. Raises the error, naming the argument."""
    if not isinstance(value, str) or value not in known:
        raise error(f"{name} is {literal(value)}, expected one of {', '.join(known)}")
    return value


def as_items(name: str, value: Any, kind: type | tuple[type, ...], expected: str) -> list[Any]:
    """An instance of ``kind``, or an iterable of instances, as a list. Raises SpatialDynError naming the argument."""
    try:
        given = [value] if isinstance(value, kind) else list(value)
    except TypeError:
        raise SpatialDynError(f"{name} is {literal(value)}, expected {expected}") from None
    for x in given:
        if not isinstance(x, kind):
            raise SpatialDynError(f"{name} has {literal(x)}, expected {expected}")
    return given


def as_words(name: str, value: Any, known: Collection[str]) -> tuple[str, ...]:
    """A string or several strings, as a tuple. Raises SpatialDynError naming the argument for one not in ``known``."""
    expected = f"some of {', '.join(known)}"
    given = as_items(name, value, str, expected)
    for word in given:
        if word not in known:
            raise SpatialDynError(f"{name} has {literal(word)}, expected {expected}")
    return tuple(given)


def core_shape(model: Model, argument: Argument, static: Sequence[Any] = ()) -> tuple[int, ...]:
    """Shape of one sample of an argument; the tables among the static inputs' values give some of the sizes."""
    tables = [x for x in static if isinstance(x, StaticTable)]
    if not tables and not any(isinstance(s, str) and "+" in s for s in argument.shape):
        return tuple([getattr(model, s) if isinstance(s, str) else s for s in argument.shape])
    sizes = {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}
    for x in tables:
        sizes |= x.sizes
    return shape_in(argument.shape, sizes)


def batch_shape(model: Model, argument: Argument, x: Array, static: Sequence[Any] = ()) -> tuple[int, ...]:
    """Leading axes of an input. Raises ShapeError if the last axes are not the shape of one sample."""
    core = core_shape(model, argument, static)
    if x.ndim < len(core) or x.shape[x.ndim - len(core) :] != core:
        wanted = ", ".join(["...", *map(str, core)])
        raise ShapeError(f"{argument.name} has shape {x.shape}, expected ({wanted})")
    return x.shape[: x.ndim - len(core)]


def broadcast(names: list[str], shapes: list[tuple[int, ...]]) -> tuple[int, ...]:
    """The common batch shape. Raises ShapeError listing the shapes if there is none."""
    try:
        return np.broadcast_shapes(*shapes)
    except TypeError:  # JAX exports functions of sizes that are symbols
        return _broadcast_symbols(names, shapes)
    except ValueError:
        listed = ", ".join(f"{n} {s}" for n, s in zip(names, shapes, strict=True))
        raise ShapeError(f"batch shapes do not broadcast: {listed}") from None


def _broadcast_symbols(names: list[str], shapes: list[tuple[Any, ...]]) -> tuple[Any, ...]:
    rank, common = max(map(len, shapes), default=0), []
    for sizes in zip(*((1,) * (rank - len(shape)) + shape for shape in shapes), strict=True):
        own = set(sizes) - {1} or {1}
        if len(own) > 1:
            listed = ", ".join(f"{n} ({', '.join(map(str, s))})" for n, s in zip(names, shapes, strict=True))
            raise ShapeError(f"batch shapes do not broadcast: {listed}")
        common.append(own.pop())
    return tuple(common)


def aligned(
    names: list[str], cores: Sequence[tuple[int, ...]], shapes: Sequence[tuple[int, ...]]
) -> list[tuple[int, ...]]:
    """Shapes of inputs, all with the same number of leading axes: missing ones have size 1 and come first.

    cores  shape of one sample of each input

    Raises TypeError for a wrong number of inputs, ShapeError for shapes that do not match the inputs or each other.
    """
    if len(shapes) != len(cores):
        raise TypeError(f"{len(shapes)} inputs were given, expected {len(cores)}: ({', '.join(names)})")
    leads = []
    for name, shape, core in zip(names, shapes, cores, strict=True):
        rank = len(shape) - len(core)
        if rank < 0 or tuple(shape[rank:]) != core:
            raise ShapeError(f"{name} has shape {tuple(shape)}, expected ({', '.join(['...', *map(str, core)])})")
        leads.append(tuple(shape[:rank]))
    rank = len(broadcast(names, leads))
    return [(1,) * (rank - len(lead)) + lead + core for lead, core in zip(leads, cores, strict=True)]


def check_out(out: Any, shape: tuple[int, ...], inputs: Mapping[str, Array]) -> Array:
    """``out``, checked.

    Raises ShapeError unless ``out`` has the shape, is float64, in C order and writable, and overlaps no input.
    """
    if not isinstance(out, np.ndarray) or masked(out):
        raise ShapeError(f"out is a {type(out).__name__}, expected a float64 array of shape {shape}")
    if out.shape != shape:
        raise ShapeError(f"out has shape {out.shape}, expected {shape}")
    if out.dtype != np.float64 or not out.dtype.isnative:
        raise ShapeError(f"out has dtype {out.dtype}, expected float64")
    if not (out.flags.c_contiguous and out.flags.writeable):
        raise ShapeError("out is not a writable array in C order")
    for name, x in inputs.items():
        if np.may_share_memory(out, x):
            raise ShapeError(f"out overlaps {name} in memory, expected an array of its own")
    return out


def flatten_batch(x: Array, batch: tuple[int, ...], core: tuple[int, ...]) -> Array:
    """An input as (samples, *core) in C order, or (1, *core) if all samples share one."""
    lead = x.shape[: x.ndim - len(core)]
    count = math.prod(lead)
    if lead != batch and count != 1:
        x, count = np.broadcast_to(x, batch + core), math.prod(batch)
    flat = np.ascontiguousarray(x)
    if flat.ndim != 1 + len(core) or not core:
        flat = flat.reshape((count, *(core or (1,))))
    return flat


def frame_row_and_placement(model: Model, frame: str | Frame) -> tuple[int, Array]:
    """Row of the table and placement (4, 4) of a frame given by name. Raises ModelError."""
    found = check_model(model).frame(frame)
    return model.joints[found.joint].row, found.placement


def reference_code(reference: str) -> int:
    """The code of "local", "world" or "local_world_aligned". Raises SpatialDynError for anything else."""
    try:
        return REFERENCES[reference]
    except (KeyError, TypeError):
        raise SpatialDynError(f"reference is {literal(reference)}, expected one of {', '.join(REFERENCES)}") from None
