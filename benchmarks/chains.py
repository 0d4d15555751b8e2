"""Chains of rods: time of a call against the number of joints, one engine at a time, and the slopes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from cases import SCALED, aligned, random_state
from measure import interleaved

import spatialdyn as sd

LENGTHS = (10, 30, 100, 300, 1000)
FROM = 30  # joints: the slope is of chains this long or longer
HELD = 300  # joints: Pinocchio's longest chain, as its Data has several n³ tensors, 32 GB at 1000
SAMPLES = 512  # of a batch: the least that runs on lanes
ARGUMENTS = {"rnea": "qva", "aba": "qvt", "crba": "q"}
ROD = (1.0, (0.0, 0.0, 0.5), np.diag([1 / 12, 1 / 12, 1e-3]))


def ours(n: int) -> sd.Model:
    """Rods end to end, joints about x and y in turn."""
    builder = sd.ModelBuilder(f"chain{n}")
    for k in range(n):
        parent, placement = (f"b{k - 1:04d}", (0, 0, 1.0)) if k else (None, None)
        builder.add_body(f"b{k:04d}", parent, "revolute", (0, 1, 0) if k % 2 else (1, 0, 0), placement, ROD)
    return builder.build()


def theirs(n: int) -> Any:
    """The same in Pinocchio."""
    model, mass_of = pin.Model(), pin.Inertia(ROD[0], np.array(ROD[1]), ROD[2])
    joint = 0
    for k in range(n):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0 if k else 0.0]))
        joint = model.addJoint(joint, pin.JointModelRY() if k % 2 else pin.JointModelRX(), place, f"b{k:04d}")
        model.appendBodyToJoint(joint, mass_of, pin.SE3.Identity())
    return model


def measured(rounds: int, tell: Any) -> dict[str, Any]:
    """Microseconds of one call, and per sample of a batch; ``slope`` of log time over log n from FROM joints on.

    untraced   one public call from Python, in the table kernel
    batch      per sample of a batch of the public call, in the engine that ``batch_engine`` names for each length
    pinocchio  one call from Python, of chains whose Data fits into memory
    """
    times: dict[str, dict[str, list[float]]] = {}
    engines = []
    for n in LENGTHS:
        model = ours(n)
        for call, ways in _of_length(n, model, rounds).items():
            for way, value in ways.items():
                times.setdefault(call, {}).setdefault(way, []).append(value)
        engines.append(sd.specialize(model, sd.rnea).engine)
        tell()
    slope = {
        call: {way: _slope(values) for way, values in ways.items() if way != "batch"} for call, ways in times.items()
    }  # none of batches, whose engine changes with the length
    return {"joints": list(LENGTHS), "us": times, "slope": slope, "batch_engine": engines}


def _of_length(n: int, model: sd.Model, rounds: int) -> dict[str, dict[str, float]]:
    other = theirs(n) if n <= HELD else None
    data = None if other is None else other.createData()
    state = random_state(model, SAMPLES)
    found: dict[str, dict[str, float]] = {}
    for name, letters in ARGUMENTS.items():
        call, function = getattr(sd, name), getattr(pin, name)
        arguments = [state[letter] for letter in letters]
        one = [np.array(x[0]) for x in arguments]
        runs = {"untraced": lambda call=call, one=one: call(model, *one)}
        if other is not None:
            runs["pinocchio"] = lambda function=function, one=one: function(other, data, *one)
            wanted = np.array(runs["pinocchio"]())
            error = abs(runs["untraced"]() - wanted).max() / max(1.0, abs(wanted).max())
            assert error <= SCALED, f"chain of {n}, {name}: scaled error {error:.1e} against Pinocchio"
        if name != "crba":  # 4 GB of M at 1000 joints
            sd.set_num_threads(1)
            out = aligned((SAMPLES, n))
            sd.compile(model, call)  # once for all models where there is no program
            call(model, *arguments, out=out)
            error = abs(out[0] - runs["untraced"]()).max() / abs(out[0]).max()
            assert error <= SCALED, f"chain of {n}, {name}: a sample of a batch differs by {error:.1e} from it alone"
            runs["batch"] = lambda call=call, x=arguments, out=out: call(model, *x, out=out)
        times = interleaved(runs, rounds, 0.01)
        found[name] = {way: 1e6 * t / (SAMPLES if way == "batch" else 1) for way, t in times.items()}
    return found


def _slope(values: list[float]) -> float:
    """Slope of log time over log n from FROM joints on."""
    x, y = np.log([(n, t) for n, t in zip(LENGTHS, values, strict=False) if n >= FROM]).T
    return float(np.polyfit(x, y, 1)[0])
