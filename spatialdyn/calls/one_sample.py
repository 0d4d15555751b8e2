"""A Spec on single samples of one model: by its program, first interpreted, compiled once that pays; or by the compiled
table kernel.

All else (a batch, a sample that fails or that the program rejects) goes through ``checked_call``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from ..engines import object_layout, run
from ..engines.compiled import numba_kernels
from ..engines.programs.llvm.call_words import ARRAY, MOST, NUMBER
from ..engines.programs.run import batch_kernels, single_call
from ..engines.programs.run.single_call import Parameter
from ..model.model import Model
from ..recursions.spec import Spec
from .arguments import core_shape
from .dynamics import checked_call


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def of_model(spec: Spec, model: Model, static: tuple[Any, ...], there: tuple[bool, ...]) -> Callable[..., Any]:
    """A function that computes a Spec for a model: a builtin for one sample, Python for all else; raises its errors.

    static  values of the static inputs
    there   whether each of the other inputs is given, in order
    """
    varying = [x for x in spec.present if not x.static]
    given = [x for x, has in zip(varying, there, strict=True) if has]
    lacks = any(not (has or x.optional) for x, has in zip(varying, there, strict=True))  # a required input

    def checked(*values: Any) -> Any:
        left = iter(values)
        return checked_call(spec, model, tuple(next(left) if has else None for has in there), static, None)

    if lacks or not object_layout.READY or numba_kernels.PLAIN or len(given) >= MOST:
        return checked
    known = numba_kernels.variant(spec, frozenset(x.name for x in given))
    program = run.program(known, model, static)
    code, alive = run.single(known, model, static, program) or (single_call.NO_CODE, None)
    shapes = [core_shape(model, x, static) for x in given]
    plan = single_call.plan(code, [core_shape(model, spec.output, static)], shapes, alive=alive)

    def python(*values: Any) -> Any:
        faster = run.single(known, model, static, program) if single_call.exhausted(plan) else None
        if faster is not None:
            single_call.change(plan, *faster)
        return checked(*values)

    parameters = [Parameter(x.name, ARRAY if x.shape else NUMBER) for x in given]
    return single_call.bound(python, parameters, plan)
