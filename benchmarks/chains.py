"""Chains of rods: time of a call against the number of joints, one engine at a time, and the slopes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from cases import SCALED, aligned, random_state
from measure import interleaved

import spatialdyn as sd

LENGTHS = (10, 30, 100, 300, 1000)
FROM = 30  # joints from which on the slope is taken
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
    """Microseconds of one call, and of a sample of a batch; ``slope`` of log time over log n from FROM joints on.

    untraced   one public call from Python, by the kernel for any model
    lanes      a sample of a batch by the program of the chain; null above the longest that is compiled
    batch      a sample of a batch of the public call, whichever way that takes
    pinocchio  one call from Python
    """
    times: dict[str, dict[str, list[float | None]]] = {}
    for n in LENGTHS:
        found = _of_length(n, rounds)
        for call, ways in found.items():
            for way, value in ways.items():
                times.setdefault(call, {}).setdefault(way, []).append(value)
        tell()
    slope = {call: {way: _slope(values) for way, values in ways.items()} for call, ways in times.items()}
    return {"joints": list(LENGTHS), "us": times, "slope": slope}


def _of_length(n: int, rounds: int) -> dict[str, dict[str, float | None]]:
    model, other = ours(n), theirs(n)
    data = other.createData()
    samples = SAMPLES
    state = random_state(model, samples)
    found: dict[str, dict[str, float | None]] = {}
    for name, letters in ARGUMENTS.items():
        call, function = getattr(sd, name), getattr(pin, name)
        arguments = [state[letter] for letter in letters]
        one = [np.array(x[0]) for x in arguments]
        wanted = np.array(function(other, data, *one))
        error = abs(call(model, *one) - wanted).max() / max(1.0, abs(wanted).max())
        # a chain of n rods has an M of condition n⁴ or so
        assert error <= SCALED * max(1.0, (n / 10) ** 2), f"chain of {n}, {name}: scaled error {error:.1e}"
        runs = {
            "untraced": lambda call=call, one=one: call(model, *one),
            "pinocchio": lambda function=function, one=one: function(other, data, *one),
        }
        if name != "crba":
            out = aligned((samples, n))
            sd.set_num_threads(1)
            runs["batch"] = lambda call=call, x=arguments, out=out: call(model, *x, out=out)
        times = interleaved(runs, rounds, 0.01)
        found[name] = {way: 1e6 * t / (samples if way == "batch" else 1) for way, t in times.items()}
        if name != "crba":
            traced = sd.specialize(model, call).engine == "lanes"
            found[name]["lanes"] = found[name]["batch"] if traced else None
    return found


def _slope(values: list[float | None]) -> float | None:
    """Of the logarithms; None with fewer than three lengths."""
    known = [(n, t) for n, t in zip(LENGTHS, values, strict=True) if t is not None and n >= FROM]
    if len(known) < 3:
        return None
    x, y = np.log(known).T
    return float(np.polyfit(x, y, 1)[0])
