"""Times of a call from Python, ours and Pinocchio's."""

from __future__ import annotations

import timeit
from statistics import median
from typing import Any

from ..calls import dynamics
from ..calls.specs import static_of
from ..engines import run
from ..engines.compiled.numba_kernels import variant
from ..engines.tables import hashable
from ..model.model import Model
from ..recursions import SPECS
from .calls import REFERENCES, Call
from .peer import Peer
from .states import States

ROUNDS, ROUND_SECONDS = 9, 1e-3


def _compile(call: Call, model: Model) -> None:
    """Compile what is timed: a call's program for one sample."""
    if model.mimic_matrix is None and call.name in SPECS:
        spec = variant(SPECS[call.name], call.inputs.split())
        static = {x.name for x in spec.present if x.static}
        frame = model.frames[-1] if call.frame else None
        values = static_of(model, static, frame, REFERENCES[0] if "reference" in static else "local", bool(call.static))
        found = run.program(spec, model, hashable(tuple(values.values())))
        if found is not None:
            found.program.compiled(one=True)


def times_of(call: Call, model: Model, peer: Peer, states: States) -> tuple[float, float]:
    """Time of one call, ours and Pinocchio's [µs]: medians of interleaved rounds, single samples, from Python.

    A call of a frame takes the last frame and the first reference; Pinocchio's time includes the pass over the joints
    that must precede it.
    """
    names = call.inputs.split()
    scope: dict[str, Any] = {"f": getattr(dynamics, call.name), "model": model}
    scope |= {name: getattr(states, name)[0] for name in names}
    given = ["model", *names]
    if call.frame:
        last = model.frames[-1]
        scope |= {"frame": f"{last.kind}:{last.name}", "reference": REFERENCES[0], "extra": True}
        given += ["frame", *["reference"] * bool(call.references), *["extra"] * bool(call.static)]
    ours = timeit.Timer(f"f({', '.join(given)})", globals=scope)
    _compile(call, model)

    there: dict[str, Any] = {"f": peer.function(call), "model": peer.model, "data": peer.data}
    there |= dict(zip(names, peer.inputs(call, states, 0), strict=True))
    text = f"f({', '.join(['model', *['data'] * call.data, *names])})"
    if call.frame:
        there |= {"g": getattr(peer.pin, call.frame), "frame": peer.frames[-1], "reference": peer.references[0]}
        text += f"; g(model, data, frame{', reference' * bool(call.references)})"
        if call.name == "jacobian_dot_times_v":
            text += " @ v" if model.nv > 1 else " * v"  # a matrix of one column comes as a vector
    theirs = timeit.Timer(text, globals=there)

    counts = [max(1, round(ROUND_SECONDS / max(1e-7, timer.timeit(10) / 10))) for timer in (ours, theirs)]
    rounds = [[timer.timeit(n) / n for timer, n in zip((ours, theirs), counts, strict=True)] for _ in range(ROUNDS)]
    first, second = (median(column) * 1e6 for column in zip(*rounds, strict=True))
    return first, second
