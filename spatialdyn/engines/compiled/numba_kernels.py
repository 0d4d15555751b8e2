"""Numba kernels over the table of bodies: compiled once, for all models.

Each recursion becomes three kernels, generated from its Spec:

sample_kernel  one sample: checks the arguments, allocates scratch, runs the recursion, checks the result, and
               returns a status. It has one explicit signature, so no input makes it compile again, and it takes the
               table by its address, which is cheaper to pass than an array.
batch_kernel   many samples, through ``sample_kernel``; an input that does not vary has a step of 0. ``lane_kernels``
               makes the batch kernels of calls that run on SIMD lanes.
user_kernel    one sample, for a user's own jitted code: raises instead of returning a status.

Kernels are compiled when first called and cached on disk (``numba_cache``). The digest is of their text and of STAMP,
which they capture: a hash of the sources of the packages that hold compiled code, so an edited helper changes the
digest. The stamp does not cover a recursion from elsewhere, so its kernels are compiled in each process.
A user's own function in Numba's cache must capture ``STAMP`` too, since the key of that cache is the user's file only.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ...recursions import SPECS
from ...recursions.spec import Argument, Spec, flat, gather, is_record, made_once
from ...waiting import watch
from .. import locks
from . import disk_cache, lane_names
from .checks import all_finite, no_overlap, pivots_regular, unit_norm
from .generated import function_from_text
from .numba_settings import PLAIN as PLAIN
from .stamp import STAMP, names

OK, SHAPE, UNIT, PIVOT, NONFINITE = range(5)

_SIZES = {"nq": "bodies[0].q_index", "nv": "len(bodies) - 1", "njoints": "bodies[0].dofs"}
FLOAT = np.dtype(np.float64)
TABLE = "bodies" if PLAIN else "address"  # the attribute of a Model that kernels take
_LOCK = locks.new()
_made: set[Spec] = set()  # calls whose ``batch_kernel`` is compiled


def variant(spec: Spec, present: Collection[str]) -> Spec:
    """The Spec of a call with only these of its optional inputs; the same object for the same choice."""
    return _variant(spec, frozenset(x.name for x in spec.present if x.optional and x.name in present))


@made_once()
def _variant(spec: Spec, present: frozenset[str]) -> Spec:
    return replace(
        spec,
        inputs=tuple(
            gather(
                spec.inputs,
                lambda x: x if not x.optional else replace(x, optional=False) if x.name in present else None,
            )
        ),
    )


def kernel_shape(argument: Argument) -> tuple[str | int, ...]:
    """Shape of an array as kernels take it: a scalar has the shape (1,)."""
    return argument.shape or (1,)


def extent(spec: Spec, *shape: str | int) -> str:
    """The number of entries of an array of this shape, as an expression in the kernel's names."""
    known = _SIZES | {size: f"{x.name}_rows[0].{size}" for x in spec.present for size in x.sizes}
    factors = [" + ".join(known.get(x, x) for x in str(size).split("+")) for size in shape or (1,)]
    return factors[0] if len(factors) == 1 else " * ".join(f"({x})" for x in factors)


def _size_checks(spec: Spec, argument: Argument) -> list[str]:
    return [
        f"{argument.name}.shape[{axis}] != {extent(spec, size)}" for axis, size in enumerate(kernel_shape(argument))
    ]


def scratch_of(spec: Spec) -> dict[str, tuple[list[str], str]]:
    """Shapes (expressions in the kernel's names) and dtypes of a recursion's scratch arrays, in its order."""
    found = {} if spec.work is None else {"work": (["len(bodies)"], "WORK")}
    if spec.pivots:
        found["pivots"] = ["len(bodies) - 1"], "FLOAT"
    shapes = zip(_scratch_names(spec), flat(spec.scratch), strict=True)
    return found | {name: ([extent(spec, x) for x in shape], "FLOAT") for name, shape in shapes}


def _scratch_names(spec: Spec) -> list[str]:
    """The names of the scratch arrays, with the arrays of records one by one."""
    return [f"scratch{k}" for k, _ in enumerate(flat(spec.scratch))]


def call_of(kind: type, values: list[str | None]) -> str:
    """The text of the expression that makes a record."""
    return f"{kind.__name__}({', '.join(x or 'None' for x in values)})"


def _records(spec: Spec) -> dict[str, type]:
    """The classes of the records that a recursion takes, by name."""
    return {type(x).__name__: type(x) for x in (*spec.inputs, spec.parts, *spec.scratch) if is_record(x)}


def statements(spec: Spec, fail: Callable[[int], str], on_lanes: bool = False) -> list[str]:
    """The statements around a recursion; ``fail(status)`` is the statement that ends the kernel.

    on_lanes  whether the recursion runs on lanes of one sample, which round as wider lanes do (``lane_kernels``)
    """

    def number(name: str) -> str:
        return f"lanes_of({name})" if on_lanes else name

    arrays = [x for x in spec.present if x.shape]
    mismatch = " or ".join(c for x in (*arrays, spec.output) if not x.optional for c in _size_checks(spec, x))
    lines = ["stamp", *(f"{x.name}_rows = rows_at({x.name}, {x.name}_dtype)" for x in spec.present if x.table)]
    lines += [f"if {mismatch}:", f"    {fail(SHAPE)}"]
    for x in arrays:
        if x.optional:
            lines += [
                f"if {x.name} is not None:",
                f"    if {' or '.join(_size_checks(spec, x))}:",
                f"        {fail(SHAPE)}",
            ]
    overlaps = [f"not no_overlap({x.name}, {spec.output.name})" for x in arrays if not x.optional]
    if overlaps:
        lines += [f"if {' or '.join(overlaps)}:", f"    {fail(SHAPE)}"]
    for x in spec.present:
        if x.unit_norm:
            lines += [f"if not unit_norm(bodies, {number(x.name)}):", f"    {fail(UNIT)}"]
    turned = {x.name for x in spec.present if x.turned and not PLAIN}
    scratch = {f"{name}_turned": (["3", extent(spec, "nq")], "FLOAT") for name in turned} | scratch_of(spec)
    for name, (shape, dtype) in scratch.items():
        lines.append(f"{name}_size = {' * '.join(f'({x})' for x in shape)} * {dtype}_SIZE")
        lines.append(f"{name}_memory = memory({name}_size)")
        made = f"array_at({name}_memory, ({', '.join(shape)},), {dtype})"
        if on_lanes and not name.endswith("_turned"):
            made = f"{'works' if dtype == 'WORK' else f'lanes{len(shape)}'}({name}_memory, ({', '.join(shape)},))"
        lines.append(f"{name} = {made}")
    lines += [f"turn({name}, {name}_turned)" for name in turned]
    passed: list[str | None] = ["bodies"] if spec.work is None else ["bodies", "work"]
    ends_of = dict.fromkeys(turned, "_turned") | {x.name: "_rows" for x in spec.present if x.table}
    passed += gather(
        spec.inputs,
        lambda x: x.name + ends_of.get(x.name, "") if x.static else number(x.name + ends_of.get(x.name, "")),
        call_of,
    )
    passed += [] if spec.parts else [number(spec.output.name)]
    parts: list[str | None] = []
    for k, part in enumerate(spec.parts):
        lines.append(f"end{k} = {f'end{k - 1} + ' if k else ''}{extent(spec, *part.shape)}")
        parts.append(number(f"{spec.output.name}[{f'end{k - 1}' if k else '0'}:end{k}]"))
    passed += [call_of(type(spec.parts), parts)] if is_record(spec.parts) else parts
    names = iter(_scratch_names(spec))
    passed += ["pivots"] * spec.pivots + gather(spec.scratch, lambda _: next(names), call_of)
    lines.append(f"recursion({', '.join(x or 'None' for x in passed)})")
    if spec.pivots:
        lines.append(f"regular = pivots_regular(bodies, {number('q')}, pivots)")
    lines += [f"release({name}_memory, {name}_size)" for name in scratch]
    if spec.pivots:
        lines += ["if not regular:", f"    {fail(PIVOT)}"]
    if spec.output.unit_norm:
        lines += [f"if not unit_norm(bodies, {number(spec.output.name)}):", f"    {fail(UNIT)}"]
    return [*lines, f"if not all_finite({spec.output.name}):", f"    {fail(NONFINITE)}"]


def kernel_from_text(name: str, parameters: list[str], body: list[str], scope: dict[str, Any]) -> Callable[..., Any]:
    """A function made from text; the only names from outside in the text are argument names of a Spec.

    The function captures ``stamp``, which is part of the cache's key, so after an edit of the package it is recompiled.
    """
    lines = [
        "def make(stamp):",
        f"    def {name}({', '.join(parameters)}):",
        *(f"        {line}" for line in body),
        f"    return {name}",
    ]
    made: Callable[..., Any] = function_from_text("make", lines, scope, name)(STAMP)
    made.__qualname__ = name
    made.__module__ = __name__
    return made


def native() -> dict[str, Any]:
    """The functions of ``jit`` that kernels call; where nothing is compiled, those that take the table itself."""
    if PLAIN:
        return {
            "table_at": lambda table: table,
            "rows_at": lambda rows, dtype: rows,
            "memory": lambda size: size,
            "array_at": lambda memory, shape, dtype: np.empty(shape, dtype),
            "release": lambda memory, size: None,
        }
    from . import jit

    own = "table_at", "rows_at", "memory", "array_at", "release", "turn"
    return {name: getattr(jit, name) for name in own}


def scope(spec: Spec) -> dict[str, Any]:
    """The values of the names in ``statements``."""
    return {
        **native(),
        **{f"{x.name}_dtype": x.table for x in spec.present if x.table},
        **_records(spec),
        "recursion": spec.recursion,
        "WORK": spec.work,
        "WORK_SIZE": 0 if spec.work is None else spec.work.itemsize,
        "FLOAT": FLOAT,
        "FLOAT_SIZE": FLOAT.itemsize,
        "unit_norm": unit_norm,
        "pivots_regular": pivots_regular,
        "all_finite": all_finite,
        "no_overlap": no_overlap,
    }


def _type(argument: Argument, extra: int, writable: bool = False, layout: str = "A") -> Any:
    from numba import types

    if argument.table:
        return types.intp
    if not argument.shape and not writable and not extra:
        return types.int64 if argument.static else types.float64
    rank = len(kernel_shape(argument)) + extra
    made: Any = types.Array
    return made(types.float64, rank, layout, readonly=not writable)


def label(spec: Spec) -> str:
    """A name that no other variant of a call has: the kernel's name in the cache."""
    return "_".join([spec.name, *(x.name for x in spec.present)])


@contextmanager
def compiling(spec: Spec) -> Iterator[None]:
    """Let one thread compile at a time; a message says so if that takes long."""
    with _LOCK, watch.work(f"compiling the table kernel of {spec.name}", disk_cache.kept):
        yield


@cache
def sample_kernel(spec: Spec) -> Callable[..., int]:
    """``(table, *inputs, output) -> status`` of one sample; inputs of any layout, none modified."""
    with compiling(spec):  # a fork waits for the import too
        from . import jit

        contract = not lane_names.fits(spec)
        return jit.compile_signature(sample_source(spec), signature(spec), keep=names(spec), contract=contract)


def sample_source(spec: Spec) -> Callable[..., int]:
    """The Python function of a ``sample_kernel``."""
    on_lanes = lane_names.fits(spec)
    parameters = ["table", *(x.name for x in spec.present), spec.output.name]
    inside = statements(spec, lambda status: f"return {status}", on_lanes=on_lanes)
    body = ["bodies = table_at(table)", *inside, f"return {OK}"]
    known = scope(spec) | (lane_names.known(spec, 1) if on_lanes else {})
    return kernel_from_text(label(spec), parameters, body, known)


def signature(spec: Spec) -> tuple[Any, ...]:
    """The types of the arguments of a ``sample_kernel``."""
    from numba import types

    return types.intp, *(_type(x, 0) for x in spec.present), _type(spec.output, 0, True, "C")


def is_made(spec: Spec) -> bool:
    """Whether the ``batch_kernel`` of a call is in memory."""
    return spec in _made


@cache
def batch_kernel(spec: Spec) -> Callable[..., int]:
    """``(table, n, *(input, step), *static inputs, output, status) -> number of samples whose status is not OK``.

    Arrays are C-ordered with the samples first; an input with step 0 has one row, which serves all samples.
    """
    with compiling(spec):  # a fork waits for the import too
        made = batches_of(spec, sample_kernel(spec), "batch")
        _made.add(spec)
        return made


def batches_of(spec: Spec, one: Callable[..., int], suffix: str) -> Callable[..., int]:
    """A ``batch_kernel`` around a compiled ``sample_kernel``; ``suffix`` ends its name."""
    from . import jit

    varying = [x for x in spec.present if not x.static]
    static = [x for x in spec.present if x.static]
    parameters = ["table", "n"]
    for x in varying:
        parameters += [x.name, f"{x.name}_step"]
    parameters += [x.name for x in static] + [spec.output.name, "status"]
    rows = {x.name: f"{x.name}[s * {x.name}_step{'' if x.shape else ', 0'}]" for x in varying}
    rows |= {x.name: x.name for x in static}
    passed = ", ".join([rows[x.name] for x in spec.present] + [f"{spec.output.name}[s]"])
    body = [
        "stamp",
        "failed = 0",
        "for s in range(n):",
        f"    status[s] = sample_kernel(table, {passed})",
        f"    if status[s] != {OK}:",
        "        failed += 1",
        "return failed",
    ]
    function = kernel_from_text(f"{label(spec)}_{suffix}", parameters, body, {"sample_kernel": one})
    return jit.compile_signature(function, batch_signature(spec), keep=names(spec))


def batch_signature(spec: Spec) -> tuple[Any, ...]:
    """The types of the arguments of a ``batch_kernel``."""
    from numba import types

    kinds: list[Any] = [types.intp, types.int64]
    for x in spec.present:
        if not x.static:
            kinds += [_type(x, 1, layout="C"), types.int64]
    kinds += [_type(x, 0) for x in spec.present if x.static]
    return *kinds, _type(spec.output, 1, True, "C"), types.Array(types.int8, 1, "C")


_MESSAGES = {
    SHAPE: "an array does not have the model's size, or the output overlaps an input",
    UNIT: "a quaternion or (cos, sin) pair is not of unit norm, expected a norm within 1e-6 of 1",
    PIVOT: "a joint has zero articulated inertia, or an input is not finite",
    NONFINITE: "the result is not finite",
}


@cache
def user_kernel(call: str | Spec) -> Callable[..., None]:
    """The kernel of a public call, or of a Spec, for use inside jitted code, optional inputs last; see ``kernels``."""
    from . import jit

    spec = call if isinstance(call, Spec) else SPECS[call]
    name = spec.name
    required = [x for x in spec.present if not x.optional]
    optional = [x for x in spec.present if x.optional]
    parameters = ["bodies", *(x.name for x in required), spec.output.name, *(f"{x.name}=None" for x in optional)]
    body = [f"{x.name} = number({x.name})" for x in required if not (x.shape or x.static)]
    body += statements(spec, lambda status: f"raise ValueError({_MESSAGES[status]!r})")
    function = kernel_from_text(f"{name}_user", parameters, body, {**scope(spec), "number": jit.number})
    function.__doc__ = f"``{name}({', '.join(parameters)})`` for jitted code. {spec.summary}"
    return jit.numba_jit(function, keep=names(spec))


class Kernels:
    """The compiled kernels, for your own ``@njit`` code. They allocate their scratch and write outputs in place.

    ``kernels.rnea(model.bodies, q, v, a, out)``, ``kernels.aba(model.bodies, q, v, tau, out)`` and so on: the
    inputs of the public call of that name, then the output, then optional inputs. A scalar output is an array of
    shape (1,). The kernels raise ValueError for wrong sizes, wrong norms, joints without inertia and results that are
    not finite. A frame is passed as its body's row and its pose in the body, ``model.joints[f.joint].row, f.placement``
    for ``f = model.frame(name)``; a reference as 0 local, 1 world, 2 local_world_aligned. For a model with mimic joints
    the kernels take q and v of the whole tree.

    A loop of your own with ``cache=True`` keeps the kernels with which it was compiled, also after an upgrade. Capture
    ``STAMP`` in the loop (a closure variable, not a global) so that it is recompiled after an upgrade:

    >>> import numpy as np, numba, spatialdyn as sd
    >>> aba = sd.kernels.aba
    >>> @numba.njit
    ... def swing(bodies, q, v, dt, steps):
    ...     tau, a = np.zeros(len(v)), np.empty(len(v))
    ...     for _ in range(steps):
    ...         aba(bodies, q, v, tau, a)
    ...         v += dt * a
    ...         q += dt * v
    >>> model = sd.load_urdf("two_link")
    >>> q, v = np.zeros(2), np.zeros(2)
    >>> swing(model.bodies, q, v, 1e-3, 100)
    >>> bool(q[0] < 0)
    True
    """

    STAMP = STAMP

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name not in SPECS:
            raise AttributeError(f"no kernel {name!r}, expected one of {', '.join(SPECS)}")
        return user_kernel(name)

    def __dir__(self) -> list[str]:
        return [*SPECS, "STAMP"]


kernels = Kernels()
