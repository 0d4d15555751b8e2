"""A Specialized as a function of PyTorch tensors on the CPU, with derivatives.

A program, and each of its derivatives, is an operator of ``torch.library``. A second kernel of the operator computes
only shapes, so that ``torch.compile`` and ``torch.export`` keep the operator as one node. An ``autograd.Function``
around the operator, whose derivatives are such functions too, is used only if a derivative may be needed: it takes
three times as long as a plain call.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from inspect import signature
from typing import Any

from ..calls.differentiable import Differentiable, Node
from ..errors import ShapeError, SpatialDynError
from .frameworks import framework


def to_torch(made: Differentiable) -> Callable[..., Any]:
    """``Specialized.to_torch``."""
    torch = framework("torch")
    compiling, needed = torch.compiler.is_compiling, derivative_needed()
    count, float32, float64, several = len(made.names), torch.float32, torch.float64, made.several
    call, differentiated, in_graph = operator(made.node()), function_of(made.node()).apply, graph_function(made).apply

    def function(*tensors: Any) -> Any:
        given: Any = tensors
        if not all(isinstance(x, torch.Tensor) and x.dtype is float64 and x.is_cpu for x in tensors):
            given = converted(tensors)
        if len(given) != count:
            made.aligned([tuple(x.shape) for x in given])  # raises TypeError
        if compiling():
            slopes = torch.is_grad_enabled() and any(x.requires_grad for x in given)
            found = in_graph(*given) if slopes else call(*given)
        else:
            found = differentiated(*given) if needed(given) else call(*given)
        return tuple(found) if several else found[0]

    def converted(tensors: Any) -> list[Any]:
        given = [torch.as_tensor(x) for x in tensors]
        for name, x in zip(made.names, given, strict=False):
            if x.device.type != "cpu":
                raise SpatialDynError(f'{name} is on "{x.device}", expected a tensor on the CPU: programs run there')
            if x.is_complex():
                raise SpatialDynError(f"{name} is {x.dtype}, expected real numbers")
        dtype = float32 if all(x.dtype == float32 for x in given) else float64
        return [x.to(dtype) for x in given]

    function.__name__ = function.__qualname__ = made.name
    function.__doc__ = f"{made.text} of tensors."
    return function


@cache
def _library() -> Any:
    """The namespace of the operators, which lasts as long as this object."""
    return framework("torch.library").Library("spatialdyn", "FRAGMENT")


@cache
def operator(node: Node) -> Any:
    """The operator of a node, for tensors of one dtype whose leading axes broadcast; nodes of equal keys share it."""
    torch = framework("torch")
    name = f"{node.name}_{hashlib.sha256(node.key.encode()).hexdigest()[:16]}"
    if name in _operators():
        return _operators()[name]

    def run(*tensors: Any) -> Any:
        given = [(x.detach() if x.requires_grad else x).numpy() for x in tensors]
        return [torch.from_numpy(x) for x in node.compute(given, given[0].dtype)]

    def shaped(*tensors: Any) -> Any:
        lead = torch.broadcast_shapes(*_leads(node, tensors))
        return [tensors[0].new_empty((*lead, *core)) for core in node.results]

    def mapped(_: Any, in_dims: Any, *tensors: Any) -> Any:
        return call(*_in_front(node, tensors, in_dims)), [0] * len(node.results)

    library, path = _library(), f"spatialdyn::{name}"
    library.define(f"{name}({', '.join(f'Tensor x{k}' for k in range(len(node.cores)))}) -> Tensor[]")
    library.impl(name, run, "CPU")
    torch.library.register_fake(path, shaped, lib=library)
    torch.library.register_vmap(path, mapped, lib=library)
    call = getattr(torch.ops.spatialdyn, name).default
    return _operators().setdefault(name, call)


@cache
def _operators() -> dict[str, Any]:
    """The operators made so far, by name."""
    return {}


def _leads(node: Node, tensors: Sequence[Any]) -> list[tuple[Any, ...]]:
    """The leading axes of a node's inputs. Raises ShapeError if shapes do not match."""
    leads = []
    for name, x, core in zip(node.inputs, tensors, node.cores, strict=True):
        rank = x.ndim - len(core)
        if rank < 0 or tuple(x.shape[rank:]) != core:
            raise ShapeError(f"{name} has shape {tuple(x.shape)}, expected ({', '.join(['...', *map(str, core)])})")
        leads.append(tuple(x.shape[:rank]))
    return leads


def _in_front(node: Node, tensors: Sequence[Any], in_dims: Sequence[Any]) -> list[Any]:
    """Tensors with the mapped axis first, all padded to the same number of leading axes."""
    moved = [x if d is None else x.movedim(d, 0) for x, d in zip(tensors, in_dims, strict=True)]
    ranks = [x.ndim - len(core) - (d is not None) for x, core, d in zip(moved, node.cores, in_dims, strict=True)]
    most = max(ranks)
    return [
        x if d is None else x.reshape(x.shape[0], *[1] * (most - rank), *x.shape[1:])
        for x, rank, d in zip(moved, ranks, in_dims, strict=True)
    ]


@cache
def derivative_needed() -> Callable[[Sequence[Any]], bool]:
    """A function of tensors: whether a derivative of what is computed from them may be needed.

    That is so by autograd, in either mode, and within torch.func, whose tensors have no memory of their own: PyTorch
    tells the tangents of the innermost transform alone.
    """
    torch, unpack_dual = framework("torch"), framework("torch.autograd.forward_ad").unpack_dual
    enabled = torch.is_grad_enabled

    def needed(tensors: Sequence[Any]) -> bool:
        if enabled() and any(x.requires_grad for x in tensors):
            return True
        try:
            for x in tensors:
                x.data_ptr()
        except RuntimeError:
            return True
        return any(unpack_dual(x).tangent is not None for x in tensors)

    return needed


def applied(node: Node, tensors: Sequence[Any]) -> Any:
    """A node of tensors: its operator alone, unless a derivative may be needed."""
    return (function_of(node).apply if derivative_needed()(tensors) else operator(node))(*tensors)


@cache
def function_of(node: Node) -> Any:
    """The ``autograd.Function`` of a node; its derivatives in both modes are such functions too."""
    torch, call = framework("torch"), operator(node)
    groups, count = node.groups, len(node.cores)
    groups = groups[: len(groups) - node.hinted]

    class Derivable(torch.autograd.Function):  # type: ignore[misc, name-defined]
        """The operator, differentiated."""

        @staticmethod
        def forward(*tensors: Any) -> Any:
            return tuple(call(*tensors))

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.set_materialize_grads(False)
            ctx.save_for_backward(*inputs, *output)
            ctx.save_for_forward(*inputs, *output)

        @staticmethod
        def backward(ctx: Any, *seeds: Any) -> Any:
            saved = ctx.saved_tensors  # each access makes the tensors anew
            arrays, results = saved[:count], saved[count:]
            answers: list[Any] = [None] * count
            for k, group in enumerate(groups):
                if any(ctx.needs_input_grad[group]) and any(x is not None for x in seeds):
                    further, given = node.back(k, arrays, results, _filled(seeds, results))
                    found = applied(further, given)
                    for at, x in zip(range(count)[group], found, strict=True):
                        shape = arrays[at].shape
                        answers[at] = x if x.shape == shape else x.sum_to_size(shape)
            return tuple(answers)

        @staticmethod
        def jvp(ctx: Any, *rates: Any) -> Any:
            arrays, results = ctx.saved_tensors[:count], ctx.saved_tensors[count:]
            terms = []
            for k, group in enumerate(groups):
                if any(x is not None for x in rates[group]):
                    further, given = node.along(k, arrays, results, _filled(rates[group], arrays[group]))
                    terms.append(applied(further, given))
            return tuple(sum(x[1:], x[0]) for x in zip(*terms, strict=True)) if terms else (None,) * len(results)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *tensors: Any) -> Any:
            return Derivable.apply(*_in_front(node, tensors, in_dims)), (0,) * len(node.results)

    vars(Derivable.forward)["__signature__"] = signature(Derivable.forward)  # PyTorch would determine it at each call
    return Derivable


def graph_function(made: Differentiable) -> Any:
    """The ``autograd.Function`` of a program within ``torch.compile``, which accepts no forward mode."""
    torch, node, weighted = framework("torch"), made.node(), made.node(0, True)
    call, slopes, count, hinted = operator(node), operator(weighted), len(made.names), weighted.hinted

    class InGraph(torch.autograd.Function):  # type: ignore[misc, name-defined]
        """The operator; its backward pass calls the operator of its derivative."""

        @staticmethod
        def forward(*tensors: Any) -> Any:
            return tuple(call(*tensors))

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.save_for_backward(*inputs, *output)

        @staticmethod
        def backward(ctx: Any, *seeds: Any) -> Any:
            arrays, results = ctx.saved_tensors[:count], ctx.saved_tensors[count:]
            found = slopes(*arrays, *seeds, *(results if hinted else ()))
            return tuple(x.sum_to_size(y.shape) for x, y in zip(found, arrays, strict=True))

    return InGraph


def _filled(given: Sequence[Any], like: Sequence[Any]) -> list[Any]:
    """The tensors, with zeros of the shapes of ``like`` in place of None."""
    return [y.new_zeros(y.shape) if x is None else x for x, y in zip(given, like, strict=True)]
