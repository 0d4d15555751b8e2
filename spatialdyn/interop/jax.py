"""A Specialized as a function of JAX arrays, with gradients: its program runs on the host, from within jit and vmap."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..calls.differentiable import Differentiable
from ..errors import SpatialDynError
from .frameworks import framework


def to_jax(made: Differentiable) -> Callable[..., Any]:
    """``Specialized.to_jax``."""
    jax = framework("jax")

    def call(function: Callable[..., Any], shapes: Any, arrays: Any) -> Any:
        """The arrays that a function of arrays on the host gives; without a derivative."""

        def on_host(*given: Any) -> Any:
            return tuple(np.asarray(x, given[0].dtype) for x in function([np.asarray(x) for x in given]))

        def host(*given: Any) -> Any:
            wanted = tuple(jax.ShapeDtypeStruct(shape, given[0].dtype) for shape in shapes)
            return jax.pure_callback(on_host, wanted, *given, vmap_method="broadcast_all")

        def refuse(primals: Any, tangents: Any) -> Any:
            raise SpatialDynError("a second derivative is not available, expected first derivatives, backwards")

        once = jax.custom_jvp(host)
        once.defjvp(refuse)
        return once(*arrays)

    def values(*arrays: Any) -> Any:
        return call(made.values, made.shapes([x.shape for x in arrays]), arrays)

    def gradients(arrays: Any, weights: Any) -> Any:
        count = len(arrays)

        def on_host(given: Any) -> Any:
            return made.gradients(given[:count], given[count:])

        return call(on_host, [x.shape for x in arrays], (*arrays, *weights))

    results = jax.custom_vjp(values)
    results.defvjp(lambda *arrays: (values(*arrays), arrays), gradients)

    def function(*arrays: Any) -> Any:
        given = [jax.numpy.asarray(x) for x in arrays]
        single = all(x.dtype == np.float32 for x in given)
        dtype = np.float32 if single else jax.dtypes.canonicalize_dtype(np.float64)
        shapes = made.aligned([x.shape for x in given])
        try:
            found = results(*(x.astype(dtype).reshape(shape) for x, shape in zip(given, shapes, strict=True)))
        except TypeError as error:
            if "forward-mode" not in str(error):
                raise
            beside = 'sd.specialize(..., derivative="jvp") is a program along a direction, outside of JAX'
            raise TypeError(
                f"{made.name} has no forward mode (jvp, jacfwd), expected grad, vjp or jacrev; {beside}"
            ) from error
        return found if made.several else found[0]

    function.__name__ = function.__qualname__ = made.name
    function.__doc__ = f"{made.text} of JAX arrays."
    return function
