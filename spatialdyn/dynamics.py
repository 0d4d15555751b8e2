"""The public calls: checks, broadcasting, and the way back from a status to an error that names its cause.

Every call of ``recursions.SPECS`` becomes a function here: ``rnea(model, q, v, a, fext=None, out=None)``. For
one sample given as float64 arrays it goes straight to the compiled kernel, which checks what it gets; whatever
the kernel turns away (batches, lists, other dtypes, bad input) is looked at by ``general``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import bodies as table
from .engines import jit
from .errors import ConfigurationError, InertiaError, ModelError, NonFiniteError, ShapeError, SpatialDynError
from .model import Frame, Joint, Model
from .recursions import SPECS
from .recursions.spec import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, Argument, Spec

Array = NDArray[np.float64]
F8 = np.dtype(np.float64)
REFERENCES = {"local": LOCAL, "world": WORLD, "local_world_aligned": LOCAL_WORLD_ALIGNED}


# --- what a public call takes ----------------------------------------------------------------------------


def as_array(name: str, value: ArrayLike) -> Array:
    """A float64 array of anything that reads as real numbers. Raises ShapeError naming the argument."""
    try:
        x = np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name} is ragged, expected an array of numbers") from error
    if x.dtype.kind not in "fiu":
        raise ShapeError(f"{name} has dtype {x.dtype}, expected real numbers")
    return x.astype(np.float64, copy=False)


def sizes(model: Model) -> dict[str, int]:
    """The numbers behind the symbols of a spec's shapes."""
    return {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}


def core_shape(model: Model, argument: Argument) -> tuple[int, ...]:
    """Shape of one sample of an argument."""
    known = sizes(model)
    return tuple(known[s] if isinstance(s, str) else s for s in argument.shape)


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


def check_out(out: Any, shape: tuple[int, ...]) -> Array:
    """``out`` if results can be written to it. Raises ShapeError if not of that shape, float64, C order, writable."""
    if not isinstance(out, np.ndarray):
        raise ShapeError(f"out is a {type(out).__name__}, expected a float64 array of shape {shape}")
    if out.shape != shape:
        raise ShapeError(f"out has shape {out.shape}, expected {shape}")
    if out.dtype != F8:
        raise ShapeError(f"out has dtype {out.dtype}, expected float64")
    if not (out.flags.c_contiguous and out.flags.writeable):
        raise ShapeError("out is not a writable array in C order")
    return out


def rows_of(x: Array, batch: tuple[int, ...], core: tuple[int, ...]) -> tuple[Array, int]:
    """An input as (samples, *core) in C order with the step that walks it: 0 where one sample serves all."""
    lead = x.shape[: x.ndim - len(core)]
    count = math.prod(lead)
    if lead != batch and count != 1:
        x, count = np.broadcast_to(x, batch + core), math.prod(batch)
    flat = np.ascontiguousarray(x).reshape((count, *(core or (1,))))
    return flat, 0 if lead != batch and count == 1 else 1


# --- mimic joints: v_full = G v --------------------------------------------------------------------------


def _expanded(model: Model, argument: Argument, x: Array) -> Array:
    """An input of a model with mimic joints, for the whole tree."""
    if argument.shape == ("nq",):
        return x[..., model.mimic_index] * model.mimic_ratio + model.mimic_offset
    if argument.shape == ("nv",):
        return x @ np.asarray(model.mimic_matrix).T
    return x


def _full_shape(model: Model, argument: Argument) -> tuple[int, ...]:
    """Shape of one sample for the whole tree, mimic joints counted."""
    full = {"nq": int(model.bodies[0]["at"]), "nv": len(model.bodies) - 1, "njoints": model.njoints}
    return tuple(full[s] if isinstance(s, str) else s for s in argument.shape)


def _contracted(model: Model, argument: Argument, x: Array) -> Array:
    """An output for the whole tree as one of the model: axes of velocities are summed with G, coordinates taken."""
    axes = len(argument.shape)
    for k, size in enumerate(argument.shape):
        axis = x.ndim - axes + k
        if size == "nq":
            x = np.take(x, model.free_q, axis)
        elif size == "nv" and argument.free:
            x = np.take(x, model.free_v, axis)
        elif size == "nv":
            x = np.moveaxis(np.moveaxis(x, axis, -1) @ model.mimic_matrix, -1, axis)
    return x


# --- the general path ------------------------------------------------------------------------------------


def general(spec: Spec, model: Model, values: tuple[Any, ...], static: tuple[Any, ...], out: Any) -> Any:
    """Run a call on anything it accepts; ``values`` follow the spec's varying inputs, None for one left out."""
    if not isinstance(model, Model):
        raise ModelError(f"model is a {type(model).__name__}, expected a spatialdyn Model")
    names = [x.name for x in spec.given if not x.static]
    present = frozenset(n for n, value in zip(names, values, strict=True) if value is not None)
    spec = jit.variant(spec, present)
    varying = [x for x in spec.given if not x.static]
    arrays = [
        as_array(x.name, value)
        for x, value in zip(varying, [value for value in values if value is not None], strict=True)
    ]
    batch = broadcast(
        [x.name for x in varying], [batch_shape(model, x, a) for x, a in zip(varying, arrays, strict=True)]
    )
    shape = batch + core_shape(model, spec.output)
    result = np.empty(shape) if out is None else check_out(out, shape)
    if model.mimic_matrix is not None:
        if spec.pivots:
            _through_mass_matrix(spec, model, dict(zip((x.name for x in varying), arrays, strict=True)), result)
            return result if out is not None or shape else float(result)
        arrays = [_expanded(model, x, a) for x, a in zip(varying, arrays, strict=True)]
    whole = batch + _full_shape(model, spec.output)
    target = result if whole == shape and model.mimic_matrix is None else np.empty(whole)
    run(spec, model, arrays, batch, static, target)
    if target is not result:
        result[...] = _contracted(model, spec.output, target)
    return result if out is not None or shape else float(result)


def run(
    spec: Spec, model: Model, arrays: list[Array], batch: tuple[int, ...], static: tuple[Any, ...], out: Array
) -> None:
    """Every sample of a batch through the kernel, on arrays for the whole tree; raises what went wrong."""
    varying = [x for x in spec.given if not x.static]
    n = math.prod(batch)
    if n == 0:
        return
    stepped = [rows_of(a, batch, _full_shape(model, x)) for x, a in zip(varying, arrays, strict=True)]
    flat = out.reshape((n, *_full_shape(model, spec.output))) if spec.output.shape else out.reshape((n, 1))
    status = np.empty(n, np.int8)
    passed = [part for pair in stepped for part in pair]
    if jit.batch(spec)(getattr(model, jit.TABLE), n, *passed, *static, flat, status):
        diagnose(spec, model, stepped, batch, static, flat, status)


def _through_mass_matrix(spec: Spec, model: Model, given: dict[str, Array], result: Array) -> None:
    """Forward dynamics and M⁻¹ of a model with mimic joints, where no recursion over the tree exists."""
    M = calls["crba"](model, given["q"])
    _refuse_singular(model, M)
    if spec.name == "minverse":
        result[...] = np.linalg.inv(M)
        return
    zero = np.zeros(model.nv)
    bias = calls["rnea"](model, given["q"], given["v"], zero, given.get("fext"))
    result[...] = np.linalg.solve(M, (given["tau"] - bias)[..., None])[..., 0]


def _refuse_singular(model: Model, M: Array) -> None:
    """Raise InertiaError if some M is not positive definite: if a pivot of its LᵀL is next to nothing."""
    if not np.isfinite(M).all():
        return
    scale = np.sqrt(np.einsum("...ii->...i", M))
    if (scale > 0.0).all():
        smallest = np.linalg.eigvalsh(M / (scale[..., :, None] * scale[..., None, :]))[..., 0]
        if (smallest > model.nv * np.finfo(float).eps).all():
            return
        joint = ""
    else:
        k = int(np.argwhere(scale <= 0.0)[0][-1])
        joint = f'joint "{joint_of_velocity(model, k).name}" moves no inertia: '
    raise InertiaError(joint + f'the mass matrix of "{model.name}" is singular, expected every joint to move inertia')


def joint_of_velocity(model: Model, k: int) -> Joint:
    """The joint whose velocity v[k] is."""
    return next(j for j in model.joints[1:] if j.idx_v <= k < j.idx_v + j.nv and j.mimic is None)


# --- from a status to an error ---------------------------------------------------------------------------


def diagnose(
    spec: Spec,
    model: Model,
    stepped: list[tuple[Array, int]],
    batch: tuple[int, ...],
    static: tuple[Any, ...],
    out: Array,
    status: NDArray[np.int8],
) -> None:
    """Raise what a status stands for, naming the first such sample and how many there are.

    A sample with an input that is not finite is no error: its answer is NaN. A pivot under the bound is looked at
    again, against the composite inertia itself.
    """
    varying = [x for x in spec.given if not x.static]
    unfit = np.flatnonzero(status == jit.UNIT)
    if len(unfit):
        at = int(unfit[0])
        for argument, (x, step) in zip(varying, stepped, strict=True):
            if argument.shape == ("nq",):
                _raise_unit_norm(model, argument.name, x[at * step], _where(at, len(unfit), batch))
    finite = np.ones(len(status), bool)
    for x, step in stepped:
        ok = np.isfinite(x).reshape(len(x), -1).all(axis=1)
        finite &= ok if step else bool(ok[0])
    pivots = np.flatnonzero((status == jit.PIVOT) & finite)
    for at in pivots:
        row = _singular_row(spec, model, [x[at * step] for x, step in stepped], static)
        if row is not None:
            raise InertiaError(
                f'joint "{_joint_of_row(model, row).name}" moves no inertia'
                f"{_where(int(at), len(pivots), batch)}: articulated inertia next to 0, expected a body with mass or "
                "armature behind it"
            )
    lost = np.flatnonzero((status != jit.OK) & finite & ~np.isfinite(out).reshape(len(out), -1).all(axis=1))
    if len(lost):
        raise NonFiniteError(
            f"{spec.name} of finite input is not finite{_where(int(lost[0]), len(lost), batch)}, expected numbers "
            "whose products stay in the range of float64"
        )


def _where(at: int, count: int, batch: tuple[int, ...]) -> str:
    if not batch:
        return ""
    index = tuple(int(k) for k in np.unravel_index(at, batch))
    place = str(index[0]) if len(index) == 1 else str(index)
    return f" in sample {place}, the first of {count}" if count > 1 else f" in sample {place}"


def _joint_of_row(model: Model, row: int) -> Joint:
    return next(j for j in model.joints[1:] if j.row - j.nv < row <= j.row)


def _raise_unit_norm(model: Model, name: str, q: Array, where: str) -> None:
    for joint in model.joints[1:]:
        first = model.bodies[joint.row - joint.nv + 1]
        part = unit_part(int(first["kind"]), int(first["at"]))
        if part is None:
            continue
        norm = float(np.linalg.norm(q[part]))
        if abs(norm * norm - 1.0) > 2e-6:
            what = "quaternion" if len(q[part]) == 4 else "(cos, sin) pair"
            raise ConfigurationError(
                f'{name} holds a {what} of norm {norm:.9g} for joint "{joint.name}"{where}, expected 1 within 1e-6; '
                "normalize(model, q) is the cure"
            )


def unit_part(kind: int, at: int) -> slice | None:
    """Where in q a joint of that kind has coordinates of unit norm."""
    if kind == table.REVOLUTE_CS:
        return slice(at, at + 2)
    if kind == table.SPHERICAL:
        return slice(at, at + 4)
    if kind == table.FLOATING:
        return slice(at + 3, at + 7)
    if kind == table.PLANAR_CS:
        return slice(at + 2, at + 4)
    return None


def _singular_row(spec: Spec, model: Model, sample: list[Array], static: tuple[Any, ...]) -> int | None:
    """The outermost row whose articulated inertia is <= n eps of its composite inertia, in one sample."""
    n = len(model.bodies) - 1
    values = dict(zip((x.name for x in spec.given if not x.static), sample, strict=True))
    inputs = [None if x is None else values[x.name] for x in spec.inputs]
    pivots, M = np.empty(n), np.empty((n, n))
    with np.errstate(all="ignore"):
        scratch = np.zeros(n + 1, spec.work)
        spec.recursion(model.bodies, scratch, *inputs, np.empty(_full_shape(model, spec.output)), pivots)
        crba = SPECS["crba"]
        crba.recursion(model.bodies, np.zeros(n + 1, crba.work), values["q"], M)
    singular = np.flatnonzero(~(pivots > n * np.finfo(float).eps * np.diag(M)))
    return int(singular[-1]) + 1 if len(singular) else None


# --- the calls, one per spec -----------------------------------------------------------------------------

_FRAME = ("row", "placement")


def frame_of(model: Model, frame: str | Frame) -> tuple[int, Array]:
    """Row and placement of a frame given by name."""
    if not isinstance(model, Model):
        raise ModelError(f"model is a {type(model).__name__}, expected a spatialdyn Model")
    found = model.frame(frame)
    return model.joints[found.joint].row, found.placement


def reference_of(reference: str) -> int:
    """Code of a reference. Raises SpatialDynError for another word."""
    try:
        return REFERENCES[reference]
    except (KeyError, TypeError):
        raise SpatialDynError(f"reference is {reference!r}, expected one of {', '.join(REFERENCES)}") from None


def signature(spec: Spec) -> tuple[list[str], list[str]]:
    """Parameters of the public call after ``model``, and the statements that make its static inputs."""
    required = [x.name for x in spec.given if not x.static and not x.optional]
    optional = [f"{x.name}=None" for x in spec.given if x.optional]
    static = [x.name for x in spec.given if x.static]
    words, statements = [], []
    if "row" in static:
        words.append("frame")
        statements.append("row, placement = frame_of(model, frame)")
    if "reference" in static:
        words.append('reference="local"')
        statements.append("reference = reference_of(reference)")
    if "classical" in static:
        words.append("classical=False")
        statements.append("classical = int(classical)")
    return [*required, *words, *optional, "out=None"], statements


def _public(spec: Spec) -> Callable[..., Any]:
    """The public function of a spec, its quick way written out for the arrays it takes."""
    parameters, statements = signature(spec)
    static = [x.name for x in spec.given if x.static]
    absent = [f"{x.name} is None" for x in spec.given if x.optional]
    shape = ", ".join(f"model.{s}" if isinstance(s, str) else str(s) for s in jit.kernel_shape(spec.output))
    passed = ", ".join([f"model.{jit.TABLE}", *(x.name for x in spec.given if not x.optional), "result"])
    varying = "".join(f"{x.name}, " for x in spec.given if not x.static)
    text = [
        f"def {spec.name}(model, {', '.join(parameters)}):",
        *(f"    {line}" for line in statements),
        f"    if {' and '.join(['out is None', *absent])}:",
        "        try:",
        f"            result = empty(({shape},))",
        f"            if not single({passed}):",
        f"                return {'result' if spec.output.shape else 'float(result[0])'}",
        "        except (AttributeError, TypeError):",
        "            pass",
        f"    return general(spec, model, ({varying}), ({''.join(f'{s}, ' for s in static)}), out)",
    ]
    scope: dict[str, Any] = {
        "empty": np.empty,
        "general": general,
        "spec": spec,
        "frame_of": frame_of,
        "reference_of": reference_of,
    }
    bare = jit.variant(spec, frozenset())

    def first(*args: Any) -> int:
        scope["single"] = jit.single(bare)
        status: int = scope["single"](*args)
        return status

    scope["single"] = first
    exec(compile("\n".join(text), __file__, "exec"), scope)
    function: Callable[..., Any] = scope[spec.name]
    function.__module__ = __name__
    function.__doc__ = docstring(spec)
    return function


def docstring(spec: Spec) -> str:
    """numpydoc text of a call, from its spec."""
    lines = [spec.summary, "", f"    Source: {spec.source}", "", "    model   Model"]
    entries: list[tuple[str, str, str]] = []
    for x in spec.given:
        if not x.static:
            shape = ", ".join(["...", *map(str, x.shape)])
            entries.append((x.name, f"({shape})", f"{x.meaning} [{x.unit}]" + ("; zero if left out" if x.optional else "")))
    static = {x.name for x in spec.given if x.static}
    if "row" in static:
        entries.append(("frame", "str | Frame", "a link's or joint's name; link:NAME or joint:NAME says which"))
    if "reference" in static:
        entries.append(("reference", "str", "local, world or local_world_aligned"))
    if "classical" in static:
        entries.append(("classical", "bool", "the acceleration of the point, not the spatial one"))
    shape = ", ".join(["...", *map(str, spec.output.shape)]) if spec.output.shape else "..."
    entries.append(("out", f"({shape})", "written if given: float64, C order, of the result's very shape"))
    lines += [f"    {name:<9} {what:<18} {text}" for name, what, text in entries]
    lines += ["", f"    Returns {spec.output.name} ({shape}): {spec.output.meaning} [{spec.output.unit}]."]
    raises = ["ShapeError for sizes that do not fit"]
    if any(x.unit_norm for x in spec.given):
        raises.append("ConfigurationError for a quaternion or pair whose norm is not 1")
    if spec.pivots:
        raises.append("InertiaError naming a joint that moves no inertia")
    raises.append("NonFiniteError if finite input gives none")
    lines += ["    Raises  " + "; ".join(raises) + ".", "    NaN in a sample gives NaN in that sample.", "    "]
    return "\n".join(lines)


calls: dict[str, Callable[..., Any]] = {name: _public(spec) for name, spec in SPECS.items()}
globals().update(calls)


def total_mass(model: Model) -> float:
    """Mass of all that moves [kg]; what hangs on a fixed root does not count."""
    return model.total_mass


__all__ = [*calls, "total_mass"]
