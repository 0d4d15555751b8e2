"""Calls of a model compiled ahead, so that no later call waits: for containers, robots and continuous integration."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from ..engines import run
from ..engines.compiled import numba_kernels
from ..errors import SpatialDynError
from ..model.model import Frame, Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .arguments import check_model
from .dynamics import calls as public_calls
from .progress import Progress, Steps, check_progress, reporting
from .specs import static_of

FRAME = "row"  # the static input that only calls of a frame have


def compile_calls(
    model: Model,
    calls: Callable[..., Any] | str | Iterable[Callable[..., Any] | str] | None = None,
    frame: str | Frame | None = None,
    reference: str = "local",
    classical: bool = False,
    fext: bool = False,
    progress: Progress = False,
) -> dict[str, float]:
    """Compile calls of a model, for single samples and for batches, and keep the code on disk.

    Later calls, in this process and in others that have the same cache folder, the same kind of processor and the same
    version, do not compile. The folder is ``SPATIALDYN_CACHE_DIR`` if set, else the user's.

    model      Model
    calls      public calls such as ``sd.rnea``, or their names; by default all, those of a frame only if one is given
    frame      of the calls that have one, in whose program it is a constant; as are ``reference`` and ``classical``
    fext       with external forces, where a call takes them; without them is another program
    progress   True for a bar (needs rich), or a function of the number of calls compiled and their total

    Returns {name of a call: seconds it took}, next to nothing for calls that were compiled already.
    Raises  SpatialDynError for an unknown call, or one of a frame without a frame; ModelError for an unknown frame.

    >>> import spatialdyn as sd
    >>> seconds = sd.compile(sd.load_urdf("two_link"), ["generalized_gravity", sd.potential_energy])
    >>> list(seconds)
    ['generalized_gravity', 'potential_energy']
    """
    check_model(model)
    check_progress(progress)
    names = _names(calls, frame is not None)
    if not isinstance(fext, bool):
        raise SpatialDynError(f"fext is {fext!r}, expected True or False")
    tasks = []
    for name in names:  # before the first takes long
        spec = SPECS[name]
        chosen = frozenset(x.name for x in spec.present if x.optional and fext and x.name == "fext")
        spec = numba_kernels.variant(spec, chosen)
        tasks.append((name, spec, _static(spec, model, frame, reference, classical)))
    seconds = {}
    with reporting(progress, "compile") as report:
        steps = Steps(report, len(tasks))
        for name, spec, values in tasks:
            began = time.perf_counter()
            _compile(spec, model, values)
            seconds[name] = time.perf_counter() - began
            steps.next()
    return seconds


def _names(calls: Any, with_frame: bool) -> list[str]:
    """Names of the calls, each once. Raises SpatialDynError for an unknown one, or one that lacks its frame."""
    if calls is None:
        return [name for name in SPECS if with_frame or not _of_frame(SPECS[name])]
    listed = [calls] if isinstance(calls, str) or callable(calls) else list(calls)
    by_call = {id(call): name for name, call in public_calls.items()}
    names = []
    for call in listed:
        name = call if isinstance(call, str) else by_call.get(id(call))
        if name not in SPECS:
            shown = repr(call) if isinstance(call, str) else getattr(call, "__name__", repr(call))
            raise SpatialDynError(f"calls has {shown}, expected some of {', '.join(SPECS)}")
        if _of_frame(SPECS[name]) and not with_frame:
            raise SpatialDynError(f"call {name} has a frame, expected its name, frame=")
        names.append(name)
    return list(dict.fromkeys(names))


def _static(spec: Spec, model: Model, frame: str | Frame | None, reference: str, classical: bool) -> tuple[Any, ...]:
    """Values of a call's static inputs: of those that were given for all calls, the ones that it takes."""
    names = {x.name for x in spec.present if x.static}
    if not names:
        return ()
    taken = reference if "reference" in names else "local"
    return tuple(static_of(model, names, frame, taken, classical and "classical" in names).values())


def _of_frame(spec: Spec) -> bool:
    return any(x.name == FRAME for x in spec.present)


def _compile(spec: Spec, model: Model, static: tuple[Any, ...]) -> None:
    """The code that a call runs: its program for one sample and for batches; the table kernel if it has none."""
    if model.mimic_matrix is not None or not run.compile_program(spec, model, static):
        numba_kernels.batch_kernel(spec)


compile = compile_calls  # as ``sd.compile``
