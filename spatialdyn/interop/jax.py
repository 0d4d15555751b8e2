"""A Specialized as a function of JAX arrays, with derivatives: XLA calls its program, also within jit, vmap and scan.

One JAX primitive represents a program and all its derivatives (``differentiable.Node``): the derivative of a node is
another node, so that forward mode, reverse mode and second derivatives are programs too. On the CPU, XLA calls compiled
code through its foreign function interface. On other devices, and if this library does not know the version of the
interface, XLA calls Python (``pure_callback``).
"""

from __future__ import annotations

import atexit
import math
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from typing import Any

import numpy as np

from ..calls.differentiable import Differentiable, Node
from ..engines.programs.run import xla_handler
from ..errors import SpatialDynError
from .frameworks import framework


def to_jax(made: Differentiable) -> Callable[..., Any]:
    """``Specialized.to_jax``."""
    jax, node = framework("jax"), made.node()

    def function(*arrays: Any) -> Any:
        given = [jax.numpy.asarray(x) for x in arrays]
        for name, x in zip(made.names, given, strict=False):
            if jax.numpy.iscomplexobj(x):
                raise SpatialDynError(f"{name} is {x.dtype}, expected real numbers")
        single = all(x.dtype == np.float32 for x in given)
        dtype = np.float32 if single else jax.dtypes.canonicalize_dtype(np.float64)
        shapes = made.aligned([x.shape for x in given])
        found = bound(node, [x.astype(dtype).reshape(shape) for x, shape in zip(given, shapes, strict=True)])
        return tuple(found) if made.several else found[0]

    function.__name__ = function.__qualname__ = made.name
    function.__doc__ = f"{made.text} of JAX arrays."
    compiled: Callable[..., Any] = jax.jit(function, inline=True)
    return compiled


def bound(node: Node, arrays: Sequence[Any]) -> list[Any]:
    """The primitive applied to arrays with the same number of leading axes, each of the batch's size or 1."""
    lead = node.lead([x.shape for x in arrays])
    whole = []
    for x, core in zip(arrays, node.cores, strict=True):
        own = x.shape[: len(x.shape) - len(core)]
        shared = own == lead or math.prod(own) == 1
        whole.append(x if shared else framework("jax").numpy.broadcast_to(x, (*lead, *core)))
    found: list[Any] = primitive().bind(*whole, node=node)
    return found


@cache
def primitive() -> Any:
    """The primitive ``spatialdyn``: from a node's inputs to its results."""
    jax = framework("jax")
    core, ad, batching, mlir = (
        framework(f"jax.{x}") for x in ("extend.core", "interpreters.ad", "interpreters.batching", "interpreters.mlir")
    )
    made = core.Primitive("spatialdyn")
    made.multiple_results = True
    made.def_impl(lambda *arrays, node: _alone(node)(*arrays))

    def shapes(*arrays: Any, node: Node) -> Any:
        return [arrays[0].update(shape=shape) for shape in node.shapes([x.shape for x in arrays])]

    def on_cpu(ctx: Any, *operands: Any, node: Node) -> Any:
        found = node.handler(ctx.avals_in[0].dtype)
        if found is None or not known_to_xla(found.name, found.address):
            return on_host(ctx, *operands, node=node)
        return jax.ffi.ffi_lowering(found.name)(ctx, *operands)

    on_host = mlir.lower_fun(_called_back, multiple_results=True)
    made.def_abstract_eval(shapes)
    mlir.register_lowering(made, on_host)
    mlir.register_lowering(made, on_cpu, platform="cpu")
    ad.primitive_jvps[made] = _jvp
    ad.primitive_transposes[made] = _transpose
    batching.primitive_batchers[made] = _batched
    atexit.register(end)  # registered after JAX's own hook, so it runs before that one
    return made


def end() -> None:
    """Wait for the arrays that are being computed, and let no sample be recomputed after that.

    At exit JAX waits for computations while it holds the GIL, which samples that Python recomputes need. Arrays that
    the process still holds are computed to their end; a result that it dropped is an error then, and nothing reads it.
    """
    for x in framework("jax").live_arrays():
        with suppress(Exception):  # the error of an array that nothing has read, or of an array deleted meanwhile
            x.block_until_ready()
    xla_handler.end()


@cache
def _alone(node: Node) -> Callable[..., Any]:
    """The primitive outside of any other computation."""
    compiled: Callable[..., Any] = framework("jax").jit(partial(primitive().bind, node=node))
    return compiled


@cache
def known_to_xla(name: str, address: int) -> bool:
    """Register a handler with XLA; returns False, with a warning of the reason, if XLA refuses it."""
    jax = framework("jax")
    try:
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), platform="cpu")
    except Exception as error:  # from a version of JAX that this library does not know
        _say(jax.__version__, " ".join(str(error).split()))
        return False
    return True


@cache
def _say(version: str, reason: str) -> None:
    """Warn that JAX calls programs through Python."""
    warnings.warn(
        f"JAX {version} calls programs through Python, some 0.3 ms a call: XLA does not take compiled ones: {reason}",
        stacklevel=3,
    )


def _called_back(*arrays: Any, node: Node) -> Any:
    """The results, computed by a call of Python."""
    jax = framework("jax")

    def on_host(*given: Any) -> Any:
        return tuple(node.compute([np.asarray(x) for x in given], given[0].dtype))

    shapes = node.shapes([x.shape for x in arrays])
    wanted = tuple(jax.ShapeDtypeStruct(shape, arrays[0].dtype) for shape in shapes)
    return list(jax.pure_callback(on_host, wanted, *arrays, vmap_method="sequential"))


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], *, node: Node) -> tuple[Any, Any]:
    """The derivative of a node along tangents: the same node for directions and weights, else another node."""
    ad = framework("jax.interpreters.ad")
    results, terms = bound(node, primals), []
    groups = node.groups
    for k, group in enumerate(groups[: len(groups) - node.hinted]):
        if not all(isinstance(x, ad.Zero) for x in tangents[group]):
            rates = [ad.instantiate_zeros(x) for x in tangents[group]]
            terms.append(bound(*node.along(k, primals, results, rates)))
    if not terms:
        return results, [ad.Zero.from_primal_value(x) for x in results]
    return results, [sum(x[1:], x[0]) for x in zip(*terms, strict=True)]


def _transpose(cotangents: Sequence[Any], *arrays: Any, node: Node) -> list[Any]:
    """The transpose of a node that is linear in a direction, or in the weights: a function of the results' weights."""
    ad = framework("jax.interpreters.ad")
    if all(isinstance(x, ad.Zero) for x in cotangents):
        return [ad.Zero(x.aval) if ad.is_undefined_primal(x) else None for x in arrays]
    groups = node.groups
    k = next(k for k, group in enumerate(groups) if any(map(ad.is_undefined_primal, arrays[group])))
    found = bound(*node.back(k, arrays, (), [ad.instantiate_zeros(x) for x in cotangents]))
    answers: list[Any] = [None] * len(arrays)
    for at, x in zip(range(len(arrays))[groups[k]], found, strict=True):
        if ad.is_undefined_primal(arrays[at]):
            answers[at] = _summed(x, arrays[at].aval.shape)
    return answers


def _summed(x: Any, shape: tuple[int, ...]) -> Any:
    """The sum of x over the samples that share an input of this shape."""
    shared = tuple(k for k, (n, own) in enumerate(zip(x.shape, shape, strict=True)) if n != own)
    return x.sum(axis=shared, keepdims=True) if shared else x


def _batched(arrays: Sequence[Any], axes: Sequence[Any], *, node: Node) -> tuple[Any, Any]:
    """A node of arrays with a further axis in front, which has size 1 for inputs without that axis."""
    numpy = framework("jax").numpy
    moved = [x[None] if at is None else numpy.moveaxis(x, at, 0) for x, at in zip(arrays, axes, strict=True)]
    found = bound(node, moved)
    return found, [0] * len(found)
