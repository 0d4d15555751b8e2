"""A Specialized as a function of PyTorch tensors on the CPU, with gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..calls.differentiable import Differentiable
from ..errors import SpatialDynError
from .frameworks import framework


def to_torch(made: Differentiable) -> Callable[..., Any]:
    """``Specialized.to_torch``."""
    torch, count = framework("torch"), len(made.names)

    def run(function: Callable[..., Any], *tensors: Any) -> Any:
        """The tensors that a function of arrays gives."""
        found = function([x.detach().numpy() for x in tensors])
        return tuple(torch.from_numpy(np.asarray(x)).to(tensors[0].dtype) for x in found)

    def once(*_: Any) -> Any:
        raise SpatialDynError("a second derivative is not available, expected first derivatives")

    def nothing(ctx: Any, inputs: Any, output: Any) -> None:
        """Nothing is kept for a second derivative."""

    def in_front(tensors: Any, in_dims: Any) -> list[Any]:
        """Tensors whose mapped axis is the first, of one entry where there is none."""
        return [x.unsqueeze(0) if d is None else x.movedim(d, 0) for x, d in zip(tensors, in_dims, strict=True)]

    class Gradients(torch.autograd.Function):  # type: ignore[misc, name-defined]
        """Of inputs and weights: the derivatives of Σ weight · result by each input."""

        setup_context, backward, jvp = staticmethod(nothing), staticmethod(once), staticmethod(once)

        @staticmethod
        def forward(*tensors: Any) -> Any:
            return run(lambda given: made.gradients(given[:count], given[count:]), *tensors)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *tensors: Any) -> Any:
            size = info.batch_size  # also of those that all samples share: their derivatives are one for each
            given = [x.expand(size, *x.shape[1:]) for x in in_front(tensors, in_dims)]
            return Gradients.apply(*given), (0,) * count

    class Tangents(torch.autograd.Function):  # type: ignore[misc, name-defined]
        """Of inputs and tangents of them: the derivatives of the results along those."""

        setup_context, backward, jvp = staticmethod(nothing), staticmethod(once), staticmethod(once)

        @staticmethod
        def forward(*tensors: Any) -> Any:
            return run(lambda given: made.tangents(given[:count], given[count:]), *tensors)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *tensors: Any) -> Any:
            return Tangents.apply(*in_front(tensors, in_dims)), (0,) * len(made.results)

    class Results(torch.autograd.Function):  # type: ignore[misc, name-defined]
        """Of inputs: the results."""

        @staticmethod
        def forward(*tensors: Any) -> Any:
            return run(made.values, *tensors)

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.save_for_backward(*inputs)
            ctx.save_for_forward(*inputs)

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> Any:
            return Gradients.apply(*ctx.saved_tensors, *weights)

        @staticmethod
        def jvp(ctx: Any, *along: Any) -> Any:
            return Tangents.apply(*ctx.saved_tensors, *along)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *tensors: Any) -> Any:
            return Results.apply(*in_front(tensors, in_dims)), (0,) * len(made.results)

    def function(*tensors: Any) -> Any:
        given = [torch.as_tensor(x) for x in tensors]
        for name, x in zip(made.names, given, strict=False):
            if x.device.type != "cpu":
                raise SpatialDynError(f'{name} is on "{x.device}", expected a tensor on the CPU: programs run there')
            if x.is_complex():
                raise SpatialDynError(f"{name} is {x.dtype}, expected real numbers")
        shapes = made.aligned([tuple(x.shape) for x in given])
        dtype = torch.float32 if all(x.dtype == torch.float32 for x in given) else torch.float64
        found = Results.apply(*(x.to(dtype).reshape(shape) for x, shape in zip(given, shapes, strict=True)))
        return found if made.several else found[0]

    function.__name__ = function.__qualname__ = made.name
    function.__doc__ = f"{made.text} of tensors."
    return function
