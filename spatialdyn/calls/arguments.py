"""The border between what people pass and what kernels take: dtypes, shapes, broadcasting, mimic joints."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelError, NonFiniteError, ShapeError, SpatialDynError
from ..model.model import Frame, Model
from ..model.robot import masked
from ..recursions.spec import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, Argument

Array = NDArray[np.float64]
REFERENCES = {"local": LOCAL, "world": WORLD, "local_world_aligned": LOCAL_WORLD_ALIGNED}


def check_model(model: Any) -> Model:
    """The model, if it is one. Raises ModelError."""
    if not isinstance(model, Model):
        raise ModelError(f"model is a {type(model).__name__}, expected a spatialdyn Model")
    return model


def as_array(name: str, value: ArrayLike) -> Array:
    """A float64 array of anything that reads as real numbers.

    Raises ShapeError naming the argument, NonFiniteError for finite numbers that are too large for float64.
    """
    if masked(value):
        raise ShapeError(f"{name} is masked, expected an array without a mask, which would be lost")
    try:
        x = np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name} is ragged, expected an array of numbers") from error
    if x.dtype.kind not in "fiu":
        raise ShapeError(f"{name} has dtype {x.dtype}, expected real numbers")
    if x.dtype.kind != "f" or x.dtype.itemsize <= 8:
        return x.astype(np.float64, copy=False)
    with np.errstate(over="ignore"):
        made = x.astype(np.float64)
    finite = np.isfinite(x)
    if not np.isfinite(made[finite]).all():
        raise NonFiniteError(f"{name} holds {abs(x[finite]).max()!s}, expected the range of float64")
    return made


def as_flag(name: str, value: Any) -> bool:
    """True or False, Python's or NumPy's. Raises SpatialDynError naming the argument."""
    if not isinstance(value, (bool, np.bool_)):
        raise SpatialDynError(f"{name} is {value!r}, expected True or False")
    return bool(value)


def as_number(value: Any) -> float:
    """A real number as a float, infinite where it is larger than floats; NaN for anything else, a bool too."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def as_count(value: Any, most: int) -> int:
    """A whole number of 1 to ``most``; 0 for anything else, a bool too."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= most:
        return 0
    return int(value)


def words(name: str, value: Any, known: Collection[str]) -> tuple[str, ...]:
    """One word or several, each of those that are known. Raises SpatialDynError naming the argument."""
    expected = f"expected some of {', '.join(known)}"
    try:
        given = (value,) if isinstance(value, str) else tuple(value)
    except TypeError:
        raise SpatialDynError(f"{name} is {value!r}, {expected}") from None
    for word in given:
        if not isinstance(word, str) or word not in known:
            raise SpatialDynError(f"{name} has {word!r}, {expected}")
    return given


def core_shape(model: Model, argument: Argument) -> tuple[int, ...]:
    """Shape of one sample of an argument."""
    return tuple([getattr(model, s) if isinstance(s, str) else s for s in argument.shape])


def batch_shape(model: Model, argument: Argument, x: Array) -> tuple[int, ...]:
    """What stands before one sample's shape. Raises ShapeError if the last axes are not that shape."""
    core = core_shape(model, argument)
    if x.ndim < len(core) or x.shape[x.ndim - len(core) :] != core:
        wanted = ", ".join(["...", *map(str, core)])
        raise ShapeError(f"{argument.name} has shape {x.shape}, expected ({wanted})")
    return x.shape[: x.ndim - len(core)]


def broadcast(names: list[str], shapes: list[tuple[int, ...]]) -> tuple[int, ...]:
    """The common batch shape. Raises ShapeError listing the shapes if there is none."""
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        listed = ", ".join(f"{n} {s}" for n, s in zip(names, shapes, strict=True))
        raise ShapeError(f"batch shapes do not broadcast: {listed}") from None


def empty(shape: tuple[int, ...]) -> Array:
    """An array for results; a large one begins on a cache line, so that it can be written past the caches."""
    size = 8 * math.prod(shape)
    if size < 1 << 20:
        return np.empty(shape)
    raw = np.empty(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(np.float64).reshape(shape)


def check_out(out: Any, shape: tuple[int, ...], inputs: Mapping[str, Array]) -> Array:
    """``out`` if results can be written to it.

    Raises ShapeError if it is not of that shape, float64, in C order and writable, or overlaps an input.
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


def rows_of(x: Array, batch: tuple[int, ...], core: tuple[int, ...]) -> tuple[Array, int]:
    """An input as (samples, *core) in C order with the step that walks it: 0 where one sample serves all."""
    lead = x.shape[: x.ndim - len(core)]
    count = math.prod(lead)
    if lead != batch and count != 1:
        x, count = np.broadcast_to(x, batch + core), math.prod(batch)
    flat = np.ascontiguousarray(x)
    if flat.ndim != 1 + len(core) or not core:
        flat = flat.reshape((count, *(core or (1,))))
    return flat, 0 if lead != batch and count == 1 else 1


def frame_of(model: Model, frame: str | Frame) -> tuple[int, Array]:
    """Row and placement of a frame given by name."""
    found = check_model(model).frame(frame)
    return model.joints[found.joint].row, found.placement


def reference_of(reference: str) -> int:
    """Code of a reference. Raises SpatialDynError for another word."""
    try:
        return REFERENCES[reference]
    except (KeyError, TypeError):
        raise SpatialDynError(f"reference is {reference!r}, expected one of {', '.join(REFERENCES)}") from None


# --- mimic joints: v_full = G v --------------------------------------------------------------------------


def mimic_matrix(model: Model) -> Array:
    """G (rows, nv) with v of the whole tree = G v."""
    return np.eye(model.nv) if model.mimic_matrix is None else model.mimic_matrix


def expanded(model: Model, argument: Argument, x: Array) -> Array:
    """An input of a model with mimic joints, for the whole tree."""
    if argument.shape == ("nq",):
        q: Array = x[..., model.mimic_index] * model.mimic_ratio + model.mimic_offset
        return q
    if argument.shape == ("nv",) and argument.dual:
        whole = np.zeros((*x.shape[:-1], len(model.bodies) - 1))
        whole[..., model.free_v] = x
        return whole
    if argument.shape == ("nv",):
        return x @ mimic_matrix(model).T
    return x


def full_shape(model: Model, argument: Argument) -> tuple[int, ...]:
    """Shape of one sample for the whole tree, mimic joints counted."""
    if model.mimic_matrix is None:
        return core_shape(model, argument)
    full = {"nq": int(model.bodies[0]["at"]), "nv": len(model.bodies) - 1, "njoints": model.njoints}
    return tuple(full[s] if isinstance(s, str) else s for s in argument.shape)


def contracted(model: Model, argument: Argument, x: Array) -> Array:
    """An output for the whole tree as one of the model: axes of velocities are summed with G, coordinates taken."""
    axes = len(argument.shape)
    for k, size in enumerate(argument.shape):
        axis = x.ndim - axes + k
        if size == "nq":
            x = np.take(x, model.free_q, axis)
        elif size == "nv" and argument.free:
            x = np.take(x, model.free_v, axis)
        elif size == "nv":
            x = np.moveaxis(np.moveaxis(x, axis, -1) @ mimic_matrix(model), -1, axis)
    return x
