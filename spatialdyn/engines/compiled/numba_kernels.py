"""Numba over the table of bodies: any model, compiled once for all of them.

Each recursion becomes three small functions, made from its Spec:

single  one sample, for ``dynamics``: checks sizes and norms, allocates scratch, runs, looks at the answer, and
        returns a status. It has one explicit signature, so no input can make it compile again, and it takes the
        table by its address: 0.1 µs less a call than as an array.
batch   many samples, through ``single``; an input that does not vary advances by a step of 0.
open    one sample, for a user's own jitted code: raises instead of returning a status.

They are compiled when first called and kept on disk (``numba_cache``) under a name that holds their text and what they
capture: a hash of the sources of the rooms that compile anything (STAMP), so that an edited helper is a new name.
A user's own function in Numba's cache, which looks at its own file alone, has to capture ``STAMP`` too.
"""

from __future__ import annotations

import hashlib
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba import carray, config, njit, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic, overload

from ...algebra.scalars import inlined
from ...bodies.table import BODIES
from ...recursions import SPECS
from ...recursions.spec import Argument, Spec
from .checks import all_finite, apart, sound_pivots, unit_norm
from .numba_cache import Kept

OK, SHAPE, UNIT, PIVOT, NONFINITE = range(5)

FLAGS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True
}  # fmt: skip
_SIZES = {"nq": "bodies[0].at", "nv": "len(bodies) - 1", "njoints": "bodies[0].dofs"}
PLAIN = bool(getattr(config, "DISABLE_JIT", False))  # NUMBA_DISABLE_JIT: the recursions run as the Python they are
TABLE = "bodies" if PLAIN else "address"  # the attribute of a Model that single and batch take
COMPILED = (
    "algebra", "bodies", "recursions", "engines", "constraints", "simulation", "compat/native"
)  # fmt: skip  # the rooms that hold what is compiled: an edit elsewhere leaves compiled code as it is
_LOCK = threading.RLock()


def package_folder() -> Path:
    """The folder of the package, wherever in it this module lies: a stamp of one room alone would keep old physics."""
    return Path(str(sys.modules[__name__.partition(".")[0]].__file__)).resolve().parent


def _stamp() -> str:
    package = package_folder()
    digest = hashlib.sha256()
    for room in COMPILED:
        for source in sorted((package / room).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


STAMP = _stamp()


@cache
def variant(spec: Spec, present: frozenset[str]) -> Spec:
    """The spec of a call with just these of its optional inputs."""
    return replace(
        spec,
        inputs=tuple(
            x if x is None or not x.optional else replace(x, optional=False) if x.name in present else None
            for x in spec.inputs
        ),
    )


def kernel_shape(argument: Argument) -> tuple[str | int, ...]:
    """Shape of an array as kernels take it: a number is an array of one."""
    return argument.shape or (1,)


def _size_checks(argument: Argument) -> list[str]:
    return [
        f"{argument.name}.shape[{axis}] != {_SIZES.get(str(size), size)}"
        for axis, size in enumerate(kernel_shape(argument))
    ]


def _body(spec: Spec, fail: Callable[[int], str]) -> list[str]:
    """The statements around a recursion; ``fail`` is what to do with a status."""
    arrays = [x for x in spec.given if x.shape]
    wrong = " or ".join(c for x in (*arrays, spec.output) if not x.optional for c in _size_checks(x))
    lines = ["stamp", f"if {wrong}:", f"    {fail(SHAPE)}"]
    for x in arrays:
        if x.optional:
            lines += [f"if {x.name} is not None:", f"    if {' or '.join(_size_checks(x))}:", f"        {fail(SHAPE)}"]
    shared = [f"not apart({x.name}, {spec.output.name})" for x in arrays if not x.optional]
    if shared:
        lines += [f"if {' or '.join(shared)}:", f"    {fail(SHAPE)}"]
    for x in spec.given:
        if x.unit_norm:
            lines += [f"if not unit_norm(bodies, {x.name}):", f"    {fail(UNIT)}"]
    passed = ["bodies", *("None" if x is None else x.name for x in spec.inputs), spec.output.name]
    if spec.work is not None:
        lines.append("work = empty(len(bodies), WORK)")
        passed.insert(1, "work")
    if spec.pivots:
        lines.append("pivots = empty(len(bodies) - 1)")
        passed.append("pivots")
    for k, shape in enumerate(spec.spare):
        lines.append(f"spare{k} = empty(({', '.join(_SIZES[size] for size in shape)},))")
        passed.append(f"spare{k}")
    lines.append(f"recursion({', '.join(passed)})")
    if spec.pivots:
        lines += ["if not sound_pivots(bodies, q, pivots):", f"    {fail(PIVOT)}"]
    if spec.output.unit_norm:
        lines += [f"if not unit_norm(bodies, {spec.output.name}):", f"    {fail(UNIT)}"]
    return [*lines, f"if not all_finite({spec.output.name}):", f"    {fail(NONFINITE)}"]


def define(name: str, parameters: list[str], body: list[str], scope: dict[str, Any]) -> Callable[..., Any]:
    """A function made of text that holds argument names of a Spec and nothing else.

    What may change between versions of the package reaches it as the captured ``stamp``, so Numba's key sees it.
    """
    text = "\n".join(
        [
            "def make(stamp):",
            f"    def {name}({', '.join(parameters)}):",
            *(f"        {line}" for line in body),
            f"    return {name}",
        ]
    )
    exec(compile(text, "<spatialdyn>", "exec"), scope)  # no file: who looks its lines up finds nothing, not others
    made: Callable[..., Any] = scope["make"](STAMP)
    made.__qualname__ = name
    made.__module__ = __name__
    return made


def _scope(spec: Spec) -> dict[str, Any]:
    return {
        "table_at": (lambda table: table) if PLAIN else _table_at,
        "recursion": spec.recursion,
        "WORK": spec.work,
        "empty": np.empty,
        "unit_norm": unit_norm,
        "sound_pivots": sound_pivots,
        "all_finite": all_finite,
        "apart": apart,
    }


def _type(argument: Argument, extra: int, writable: bool = False, layout: str = "A") -> Any:
    if not argument.shape and not writable and not extra:
        return types.int64 if argument.static else types.float64
    rank = len(kernel_shape(argument)) + extra
    made: Any = types.Array
    return made(types.float64, rank, layout, readonly=not writable)


def _pointer_at(typing_context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(address), generate


_pointer: Any = intrinsic(_pointer_at)


@inlined
def _table_at(address: int) -> Any:
    """The table of bodies at an address; row 0 says in ``last`` how many rows follow it."""
    world = carray(_pointer(address), (1,), BODIES)
    return carray(_pointer(address), (world[0].last + 1,), BODIES)


def _label(spec: Spec) -> str:
    """A name no other variant of a call has: it names the file in Numba's cache."""
    return "_".join([spec.name, *(x.name for x in spec.given)])


def jitted(
    function: Callable[..., Any], nogil: bool = True, keep: bool = True, from_c: bool = False
) -> Callable[..., Any]:
    """A function made by ``define``, compiled for whatever it is called with, and kept on disk unless told not to.

    from_c  with a form that C can call
    """
    dispatcher: Any = njit(**{**FLAGS, "nogil": nogil, "no_cfunc_wrapper": not from_c})(function)
    if keep and not PLAIN:
        dispatcher._cache = Kept(function)
    made: Callable[..., Any] = dispatcher
    return made


def compiled(function: Callable[..., Any], signature: tuple[Any, ...], nogil: bool = True) -> Callable[..., Any]:
    """A function compiled for one signature and no other: what does not match raises TypeError at once."""
    if PLAIN:
        return _plain(function, signature)
    dispatcher: Any = jitted(function, nogil)
    dispatcher.compile(signature)
    dispatcher.disable_compile()
    for strided in (False, True):
        for writable in (False, True):
            dispatcher._search_new_conversions(*(_sample(t, strided, writable) for t in signature))
    # What still does not match is turned away at once; left to itself Numba spends 0.4 ms on looking for a way.
    dispatcher._search_new_conversions = _no_conversion
    dispatcher._explain_matching_error = _no_match
    made: Callable[..., Any] = dispatcher
    return made


def _plain(function: Callable[..., Any], signature: tuple[Any, ...]) -> Callable[..., Any]:
    """The function as it is, turning away what its compiled form would."""

    @np.errstate(all="ignore")
    def checked(table: Any, *arguments: Any) -> Any:
        for x, kind in zip(arguments, signature[1:], strict=True):
            if isinstance(kind, types.Array) and (
                type(x) is not np.ndarray
                or x.ndim != kind.ndim
                or x.dtype != (np.int8 if kind.dtype == types.int8 else np.float64)
                or (kind.mutable and not (x.flags.writeable and x.flags.c_contiguous))
            ):
                raise TypeError("no such signature")
            if kind == types.float64 and isinstance(x, np.ndarray):
                raise TypeError("no such signature")
        return function(table, *arguments)

    return checked


def _sample(kind: Any, strided: bool, writable: bool) -> Any:
    """A value for a parameter of that type, so that Numba learns to convert such a one."""
    if not isinstance(kind, types.Array):
        return 0.0 if kind == types.float64 else 0
    x = np.zeros((4,) * kind.ndim, str(kind.dtype))
    if strided and kind.layout == "A":
        x = x[(slice(None, None, 2),) * kind.ndim]
    x.flags.writeable = writable or kind.mutable
    return x


def _no_conversion(*arguments: Any, **named: Any) -> bool:
    return False


def _no_match(*arguments: Any, **named: Any) -> None:
    raise TypeError("no such signature")


@cache
def single(spec: Spec) -> Callable[..., int]:
    """``(table, *inputs, output) -> status`` of one sample; inputs of any layout, none modified."""
    with _LOCK:
        parameters = ["table", *(x.name for x in spec.given), spec.output.name]
        body = ["bodies = table_at(table)", *_body(spec, lambda status: f"return {status}"), f"return {OK}"]
        function = define(_label(spec), parameters, body, _scope(spec))
        return compiled(function, (types.intp, *(_type(x, 0) for x in spec.given), _type(spec.output, 0, True, "C")))


@cache
def batch(spec: Spec) -> Callable[..., int]:
    """``(table, n, *(input, step), *static inputs, output, status) -> number of samples whose status is not OK``.

    Arrays are C-ordered with the samples first; an input with step 0 has one sample for all.
    """
    with _LOCK:
        varying = [x for x in spec.given if not x.static]
        static = [x for x in spec.given if x.static]
        parameters = ["table", "n"]
        for x in varying:
            parameters += [x.name, f"{x.name}_step"]
        parameters += [x.name for x in static] + [spec.output.name, "status"]
        rows = {x.name: f"{x.name}[s * {x.name}_step{'' if x.shape else ', 0'}]" for x in varying}
        rows |= {x.name: x.name for x in static}
        passed = ", ".join([rows[x.name] for x in spec.given] + [f"{spec.output.name}[s]"])
        body = [
            "stamp",
            "bad = 0",
            "for s in range(n):",
            f"    status[s] = single(table, {passed})",
            f"    if status[s] != {OK}:",
            "        bad += 1",
            "return bad",
        ]
        function = define(_label(spec) + "_batch", parameters, body, {"single": single(spec)})
        signature: list[Any] = [types.intp, types.int64]
        for x in varying:
            signature += [_type(x, 1, layout="C"), types.int64]
        signature += [_type(x, 0) for x in static]
        signature += [_type(spec.output, 1, True, "C"), types.Array(types.int8, 1, "C")]
        return compiled(function, tuple(signature))


_MESSAGES = {
    SHAPE: "an array does not have the size the model asks for, or the output overlaps an input",
    UNIT: "a quaternion or (cos, sin) pair is not of unit norm, expected a norm within 1e-6 of 1",
    PIVOT: "a joint moves next to no inertia, or an input is not finite",
    NONFINITE: "the result is not finite",
}


def _number(x: Any) -> Any:
    """A float, of an array without axes its entry."""
    return x


@overload(_number)
def _number_of(x):  # type: ignore[no-untyped-def]
    return (lambda x: x[()]) if isinstance(x, types.Array) else (lambda x: x)


@cache
def opened(name: str) -> Callable[..., None]:
    """The kernel of a public call for use inside jitted code, optional inputs last; see ``kernels``."""
    spec = SPECS[name]
    required = [x for x in spec.given if not x.optional]
    optional = [x for x in spec.given if x.optional]
    parameters = ["bodies", *(x.name for x in required), spec.output.name, *(f"{x.name}=None" for x in optional)]
    body = [f"{x.name} = number({x.name})" for x in required if not (x.shape or x.static)]
    body += _body(spec, lambda status: f"raise ValueError({_MESSAGES[status]!r})")
    function = define(f"{name}_open", parameters, body, {**_scope(spec), "number": _number})
    function.__doc__ = f"``{name}({', '.join(parameters)})`` for jitted code. {spec.summary}"
    return jitted(function)


class Kernels:
    """The compiled kernels, for use inside your own ``@njit`` code; scratch is theirs, outputs are written in place.

    ``kernels.rnea(model.bodies, q, v, a, out)``, ``kernels.aba(model.bodies, q, v, tau, out)`` and so on: the
    inputs of the public call of that name, then the output, then optional inputs. Scalar outputs are arrays of
    one. They raise ValueError on wrong sizes, norms, joints without inertia and results that are not finite.
    A frame is its body's row and its pose there, ``model.joints[f.joint].row, f.placement`` for ``f =
    model.frame(name)``, a reference 0 local, 1 world, 2 local_world_aligned. Of a model with mimic joints they
    take q and v of the whole tree.

    A loop of your own with ``cache=True`` keeps the kernels it was compiled with, also after an upgrade. Capture
    ``STAMP`` in it (a closure variable, not a global) to have it compiled anew:

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
        return opened(name)

    def __dir__(self) -> list[str]:
        return [*SPECS, "STAMP"]


kernels = Kernels()
