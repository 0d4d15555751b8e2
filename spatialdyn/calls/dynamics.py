"""The public calls, one for each Spec of ``recursions.SPECS``: ``rnea(model, q, v, a, fext=None, out=None)``.

For one sample given as float64 arrays a call goes straight to the compiled kernel, which checks what it gets;
whatever the kernel turns away (batches, lists, other dtypes, bad input) is looked at by ``general``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels
from ..engines.programs.batch_kernels import set_num_threads
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .arguments import (
    Array,
    as_array,
    as_flag,
    batch_shape,
    broadcast,
    check_model,
    check_out,
    contracted,
    core_shape,
    empty,
    expanded,
    frame_of,
    full_shape,
    reference_of,
    rows_of,
)
from .failures import diagnose, refuse_lost, refuse_singular

F8 = np.dtype(np.float64)
SHARE = 10**9 if numba_kernels.PLAIN else 128  # samples before another thread is worth waking: some 100 µs

# --- the general way ------------------------------------------------------------------------------------


def general(spec: Spec, model: Model, values: tuple[Any, ...], static: tuple[Any, ...], out: Any) -> Any:
    """Run a call on anything it accepts; ``values`` follow the spec's varying inputs, None for one left out."""
    done = _at_once(spec, model, values, static, out)
    if done is not None:
        return done
    check_model(model)
    asked = [(x, value) for x, value in zip([x for x in spec.given if not x.static], values, strict=True)]
    given = [(x, value) for x, value in asked if value is not None or not x.optional]
    spec = numba_kernels.variant(spec, frozenset(x.name for x, _ in given))
    varying = [x for x in spec.given if not x.static]
    arrays = [as_array(x.name, value) for x, value in given]
    batch = broadcast(
        [x.name for x in varying], [batch_shape(model, x, a) for x, a in zip(varying, arrays, strict=True)]
    )
    shape = batch + core_shape(model, spec.output)
    result = (
        empty(shape)
        if out is None
        else check_out(out, shape, {x.name: a for x, a in zip(varying, arrays, strict=True)})
    )
    if model.mimic_matrix is None:
        run(spec, model, arrays, batch, static, result)
    else:
        with np.errstate(all="ignore"):
            _with_followers(spec, model, arrays, batch, static, result)
    return result if out is not None or shape else float(result)


def _at_once(spec: Spec, model: Any, values: tuple[Any, ...], static: tuple[Any, ...], out: Any) -> Any:
    """The result of a batch of float64 arrays (B, n) by its program; None where anything is not as simple as that.

    Checks nothing that the kernel checks: what ``general`` does besides took a third of the RNEA of 8192 arms.
    """
    first = values[0] if values else None
    if type(first) is not np.ndarray or first.ndim != 2 or len(first) < batch_kernels.FROM or type(model) is not Model:
        return None
    given = [x for x in values if x is not None]
    for x in given:
        if type(x) is not np.ndarray or not (x.dtype is F8 or x.dtype == F8):
            return None
    values_of = tuple(x.tobytes() if isinstance(x, np.ndarray) else x for x in static)
    n = len(first)
    plan = _plan(spec, model, tuple(x is not None for x in values), values_of)
    if plan is None:
        return None
    spec, shape, kernel = plan
    shape = (n, *shape)
    if out is None:
        out = empty(shape)
    elif (
        type(out) is not np.ndarray
        or not (out.dtype is F8 or out.dtype == F8)
        or out.shape != shape
        or not out.flags.c_contiguous
    ):
        return None
    if out.nbytes >= batch_kernels.STREAM:
        return None
    flat = out if out.ndim == 2 else out.reshape((n, -1))
    samples = kernel(given, (flat,))
    if samples is None:
        return None
    if len(samples):
        _untraced(spec, model, [(x, 1 if len(x) == n else 0) for x in given], (n,), static, flat, samples)
    return out


@lru_cache(maxsize=batch_kernels.KEPT)
def _plan(
    spec: Spec, model: Model, present: tuple[bool, ...], static: tuple[bytes | int, ...]
) -> tuple[Spec, tuple[int, ...], batch_kernels.Kernel] | None:
    """The call with the inputs that are there, the shape of one sample of its result, and its program; None if there
    is none, if an input is no vector, or one is lacking.
    """
    varying = [x for x in spec.given if not x.static]
    given = [x for x, there in zip(varying, present, strict=True) if there]
    spec = numba_kernels.variant(spec, frozenset(x.name for x in given))
    lacks = any(not (there or x.optional) for x, there in zip(varying, present, strict=True))
    if lacks or model.mimic_matrix is not None or numba_kernels.PLAIN or any(len(x.shape) != 1 for x in given):
        return None
    kernel = _program(spec, model, static, False)
    return None if kernel is None else (spec, core_shape(model, spec.output), kernel)


def run(
    spec: Spec, model: Model, arrays: list[Array], batch: tuple[int, ...], static: tuple[Any, ...], out: Array
) -> None:
    """Every sample of a batch, on arrays for the whole tree: by its program on SIMD lanes where one pays, else and for
    what that leaves by the kernel for any model. Raises what went wrong.
    """
    varying = [x for x in spec.given if not x.static]
    n = math.prod(batch)
    if n == 0:
        return
    stepped = [rows_of(a, batch, full_shape(model, x)) for x, a in zip(varying, arrays, strict=True)]
    flat = out.reshape((n, -1))
    samples = None
    if n >= batch_kernels.FROM and not numba_kernels.PLAIN:
        values = tuple(x.tobytes() if isinstance(x, np.ndarray) else x for x in static)
        kernel = _program(spec, model, values, flat.nbytes >= batch_kernels.STREAM and flat.ctypes.data % 64 == 0)
        if kernel is not None:
            samples = kernel([x.reshape((len(x), -1)) for x, _ in stepped], (flat,))
    _untraced(spec, model, stepped, batch, static, flat, np.arange(n) if samples is None else samples)


def _untraced(
    spec: Spec,
    model: Model,
    stepped: list[tuple[Array, int]],
    batch: tuple[int, ...],
    static: tuple[Any, ...],
    flat: Array,
    samples: NDArray[np.intp],
) -> None:
    """These samples by the kernel for any model, which knows more than a program. Raises what went wrong."""
    n, everything = len(samples), len(samples) == len(flat)
    if not n:
        return
    core = full_shape(model, spec.output) or (1,)
    if not everything:
        stepped = [(np.ascontiguousarray(x[samples]) if step else x, step) for x, step in stepped]
    rest = flat.reshape((n, *core)) if everything else np.empty((n, *core))
    status = np.empty(n, np.int8)
    kernel, table = numba_kernels.batch(spec), getattr(model, numba_kernels.TABLE)

    def part(first: int, end: int) -> int:
        passed = [y for x, step in stepped for y in (x[first:end] if step else x, step)]
        return kernel(table, end - first, *passed, *static, rest[first:end], status[first:end])

    bad = 0
    first = end = 0
    try:
        for first, end in batch_kernels.slices(n, len(model.bodies), math.prod(core)):
            bad += batch_kernels.team.share(first, end, SHARE, part)
            if not everything:
                flat[samples[first:end]] = rest[first:end].reshape((end - first, -1))
            first = end
    except KeyboardInterrupt:
        flat[slice(first, None) if everything else samples[first:]] = np.nan  # out holds what was done
        raise
    if bad:
        diagnose(spec, model, stepped, batch, static, rest, status, samples)


@lru_cache(maxsize=batch_kernels.KEPT)
def _program(spec: Spec, model: Model, static: tuple[bytes | int, ...], stream: bool) -> batch_kernels.Kernel | None:
    """The program of a call on SIMD lanes, if it can be one."""
    if not batch_kernels.fits((spec,), model.bodies):
        return None
    values = [np.frombuffer(x).reshape(4, 4) if isinstance(x, bytes) else x for x in static]
    return batch_kernels.kernel((spec,), model.bodies, model.key, values, stream=stream)


def _with_followers(
    spec: Spec, model: Model, arrays: list[Array], batch: tuple[int, ...], static: tuple[Any, ...], result: Array
) -> None:
    """A call on a model with mimic joints: on the whole tree, or through M. Raises what went wrong."""
    varying = [x for x in spec.given if not x.static]
    if spec.pivots:
        _through_mass_matrix(spec, model, dict(zip((x.name for x in varying), arrays, strict=True)), result)
    else:
        whole = [expanded(model, x, a) for x, a in zip(varying, arrays, strict=True)]
        target = empty(batch + full_shape(model, spec.output))
        try:
            run(spec, model, whole, batch, static, target)
        except KeyboardInterrupt:
            result[...] = np.nan  # of what was done nothing is in the coordinates of the result yet
            raise
        result[...] = contracted(model, spec.output, target)
    refuse_lost(spec, list(zip(varying, arrays, strict=True)), batch, result)


def _through_mass_matrix(spec: Spec, model: Model, given: dict[str, Array], result: Array) -> None:
    """What is solved for with M of a model with mimic joints, where no recursion over the tree does it."""
    q, zero = given["q"], np.zeros(model.nv)
    M = calls["crba"](model, q)
    refuse_singular(model, M)
    if spec.name == "minverse":
        result[...] = np.linalg.inv(M)
    elif spec.output.name == "a":
        bias = calls["rnea"](model, q, given["v"], zero, given.get("fext"))
        result[...] = np.linalg.solve(M, (given["tau"] - bias)[..., None])[..., 0]
    elif spec.name == "aba_derivatives":
        a = calls["aba"](model, q, given["v"], given["tau"], given.get("fext"))
        by = calls["rnea_derivatives"](model, q, given["v"], a, given.get("fext"))
        inverse = np.linalg.inv(M)
        result[..., :2, :, :] = -inverse[..., None, :, :] @ by[..., :2, :, :]
        result[..., 2, :, :] = inverse
    else:
        v = np.linalg.solve(M, given["p"][..., None])[..., 0]
        if spec.name == "velocity_from_momentum":
            result[...] = v
        elif spec.name == "hamiltonian":
            result[...] = 0.5 * np.einsum("...i,...i->...", given["p"], v) + calls["potential_energy"](model, q)
        else:
            result[..., 0, :] = v
            result[..., 1, :] = calls["momentum_rate"](model, q, v, given["tau"], given.get("fext"))


# --- the calls, one per spec -----------------------------------------------------------------------------


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
        statements.append('classical = 1 if classical is True or as_flag("classical", classical) else 0')
    return [*required, *words, *optional, "out=None"], statements


def _public(spec: Spec) -> Callable[..., Any]:
    """The public function of a spec, its quick way written out for one sample of the arrays it takes.

    What the kernel turns away, by a TypeError or by its status, goes the general way, which finds the reason.
    """
    parameters, statements = signature(spec)
    optional = [x.name for x in spec.given if x.optional]
    shape = ", ".join(f"model.{s}" if isinstance(s, str) else str(s) for s in numba_kernels.kernel_shape(spec.output))
    passed = {
        name: ", ".join([f"model.{numba_kernels.TABLE}", *(x.name for x in spec.given if x.name not in left), "result"])
        for name, left in (("bare", optional), ("whole", []))
    }
    status = f"bare({passed['bare']})"
    if optional:  # some but not all of several: the general way, which has a kernel for every choice
        none, some = (word.join(f"{name} is None" for name in optional) for word in (" and ", " or "))
        rest = f"1 if {some} else whole({passed['whole']})" if len(optional) > 1 else f"whole({passed['whole']})"
        status = f"{status} if {none} else {rest}"
    varying = "".join(f"{x.name}, " for x in spec.given if not x.static)
    static = "".join(f"{x.name}, " for x in spec.given if x.static)
    # Numba looks neither at the byte order of an array nor at its mask; equal dtypes may be two objects (0.03 µs each)
    checked = [x.name for x in spec.given if x.shape and not x.static and not x.optional]
    plain = "type({0}) is ndarray and ({0}.dtype is F8 or {0}.dtype == F8)"
    native = " and ".join(plain.format(name) for name in (*checked, "result"))
    native += "".join(f" and ({name} is None or {plain.format(name)})" for name in optional)
    native += "".join(f" and isinstance({x.name}, (float, int))" for x in spec.given if not (x.shape or x.static))
    text = [
        f"def {spec.name}(model, {', '.join(parameters)}):",
        *(f"    {line}" for line in statements),
        "    try:",
        f"        result = empty(({shape},)) if out is None else {'out' if spec.output.shape else 'None'}",
        f"        if {native} and not ({status}):",
        f"            return {'result' if spec.output.shape else 'float(result[0])'}",
        "    except (AttributeError, TypeError, ValueError):  # whatever Numba says of what it cannot take",
        "        pass",
        f"    return general(spec, model, ({varying}), ({static}), out)",
    ]
    scope: dict[str, Any] = {
        "F8": F8,
        "empty": np.empty,
        "ndarray": np.ndarray,
        "general": general,
        "spec": spec,
        "as_flag": as_flag,
        "frame_of": frame_of,
        "reference_of": reference_of,
    }

    rank = len(numba_kernels.kernel_shape((*spec.given, spec.output)[0]))

    def compiled_at_first_call(name: str, variant: Spec) -> Callable[..., int]:
        def first(*arguments: Any) -> int:
            if np.ndim(arguments[1]) > rank:  # a batch has no need of it
                raise TypeError("no such signature")
            scope[name] = numba_kernels.single(variant)
            status: int = scope[name](*arguments)
            return status

        return first

    scope["bare"] = compiled_at_first_call("bare", numba_kernels.variant(spec, frozenset()))
    scope["whole"] = compiled_at_first_call("whole", numba_kernels.variant(spec, frozenset(optional)))
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
            order = ", quaternions x y z w" if x.unit_norm else ""
            rest = "; zero if left out" if x.optional else ""
            entries.append((x.name, f"({shape})", f"{x.meaning}{order} [{x.unit}]{rest}"))
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
    raises = ["ShapeError for sizes that do not fit, or an out that overlaps an input"]
    if any(x.unit_norm for x in spec.given):
        raises.append("ConfigurationError for a quaternion or pair whose norm is not 1")
    if spec.pivots:
        raises.append("InertiaError naming a joint that moves no inertia; digits that are lost before: see diagnose")
    if "row" in static:
        raises.append("ModelError if there is no such frame, with names like it")
    if "reference" in static:
        raises.append("SpatialDynError for another reference")
    if "classical" in static:
        raises.append("SpatialDynError for a classical that is not True or False")
    raises.append("NonFiniteError if finite input gives none")
    raises.append("KeyboardInterrupt at Ctrl-C, soon also in a long batch: out holds what was done, NaN for the rest")
    lines += [
        "    Raises",
        *(f"        {r}" for r in raises),
        "    NaN in a sample gives NaN in what depends on it, and in no other sample.",
        "    ",
    ]
    return "\n".join(lines)


calls: dict[str, Callable[..., Any]] = {name: _public(spec) for name, spec in SPECS.items()}
globals().update(calls)


def total_mass(model: Model) -> float:
    """Mass of all that moves [kg]; what hangs on a fixed root does not count."""
    return check_model(model).total_mass


__all__ = [*calls, "set_num_threads", "total_mass"]
