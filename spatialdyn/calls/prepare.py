"""Calls of a model compiled ahead, so that no later call waits: for containers, robots and continuous integration."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from ..engines import by_table_kernel, run
from ..engines.compiled import numba_kernels
from ..errors import SpatialDynError, literal
from ..model.model import Frame, Model
from ..recursions import SPECS
from ..recursions.constraints import constrained, constraint_rows
from ..recursions.spec import Spec
from .arguments import check_model
from .progress import Progress, Steps, check_progress, reporting
from .specs import spec_of, static_of

FRAME = "row"  # the static input that only calls of a frame have
OF_CONSTRAINTS = (  # calls with a table of constraints
    constrained.MOTION, constrained.RESPONSE, constrained.ROWS, constrained.DELASSUS,
    constraint_rows.JACOBIAN, constraint_rows.ERROR, constraint_rows.DRIFT,
)  # fmt: skip


def compile_calls(
    model: Model,
    calls: Callable[..., Any] | str | Iterable[Callable[..., Any] | str] | None = None,
    frame: str | Frame | None = None,
    reference: str = "local",
    classical: bool = False,
    fext: bool = False,
    progress: Progress = False,
    constraints: Any = None,
) -> dict[str, float]:
    """Compile calls of a model, for single samples and for batches, and keep the code on disk.

    Later calls, in this process and in others with the same cache folder, processor type and library version, do not
    compile. The folder is ``SPATIALDYN_CACHE_DIR`` if set, else the user's.

    model      Model
    calls      public calls such as ``sd.rnea``, or their names; by default all, those of a frame only with ``frame``
    frame      for the calls that take one, as are ``reference`` and ``classical``: all three are constants of the
               program
    fext       whether calls that take external forces are compiled with them; with and without are two programs
    progress   True for a bar (needs rich), or a function of the number of calls compiled and their total
    constraints  Constraints of this model, for calls such as ``sd.constrained_dynamics``, which are then among the
                 default calls too

    Returns {name of a call: seconds it took}, near 0 for calls that were compiled before.
    Raises  SpatialDynError for an unknown call, or one of a frame without ``frame``; ModelError for an unknown frame.

    >>> import spatialdyn as sd
    >>> seconds = sd.compile(sd.load_urdf("two_link"), ["generalized_gravity", sd.potential_energy])
    >>> list(seconds)
    ['generalized_gravity', 'potential_energy']
    """
    check_model(model)
    check_progress(progress)
    specs = _specs(calls, frame is not None, constraints is not None)
    if not isinstance(fext, bool):
        raise SpatialDynError(f"fext is {literal(fext)}, expected True or False")
    static_of(model, {x.name for spec in specs for x in spec.present}, frame, reference, classical, constraints)
    tasks = []
    for spec in specs:  # all errors before the first long compilation
        chosen = frozenset(x.name for x in spec.present if x.optional and fext and x.name == "fext")
        spec = numba_kernels.variant(spec, chosen)
        tasks.append((spec.name, spec, _static(spec, model, frame, reference, classical, constraints)))
    seconds = {}
    with reporting(progress, "compile") as report:
        steps = Steps(report, len(tasks))
        for name, spec, values in tasks:
            began = time.perf_counter()
            _compile(spec, model, values)
            seconds[name] = time.perf_counter() - began
            steps.next()
    return seconds


def _specs(calls: Any, with_frame: bool, with_constraints: bool) -> list[Spec]:
    """Specs of the calls, each once. Raises SpatialDynError for an unknown one, or one that lacks what it needs."""
    if calls is None:
        found = [spec for spec in SPECS.values() if with_frame or not _of_frame(spec)]
        return found + (list(OF_CONSTRAINTS) if with_constraints else [])
    try:
        listed = [calls] if isinstance(calls, str) or callable(calls) else list(calls)
    except TypeError:
        raise SpatialDynError(
            f"calls is {literal(calls)}, expected public calls such as spatialdyn.rnea, or their names"
        ) from None
    found = []
    for call in listed:
        spec = SPECS.get(call) if isinstance(call, str) else spec_of(call)
        if spec is None:
            shown = literal(call) if isinstance(call, str) else getattr(call, "__name__", literal(call))
            raise SpatialDynError(f"calls has {shown}, expected some of {', '.join(SPECS)}")
        if _of_frame(spec) and not with_frame:
            raise SpatialDynError(f"call {spec.name} has a frame, expected its name, frame=")
        found.append(spec)
    return list(dict.fromkeys(found))


def _static(
    spec: Spec, model: Model, frame: str | Frame | None, reference: str, classical: bool, constraints: Any
) -> tuple[Any, ...]:
    """Values of the static inputs that a call takes, of those given for all calls."""
    names = {x.name for x in spec.present if x.static}
    if not names:
        return ()
    taken = reference if "reference" in names else "local"
    framed, held = frame if FRAME in names else None, constraints if "constraints" in names else None
    return tuple(static_of(model, names, framed, taken, classical and "classical" in names, held).values())


def _of_frame(spec: Spec) -> bool:
    return any(x.name == FRAME for x in spec.present)


def _compile(spec: Spec, model: Model, static: tuple[Any, ...]) -> None:
    """The code that a call runs: its program for one sample and for batches; the table kernel if it has none."""
    if not run.compile_program(spec, model, static):
        by_table_kernel.compile_table_kernel(spec, model, static)


compile = compile_calls  # as ``sd.compile``
