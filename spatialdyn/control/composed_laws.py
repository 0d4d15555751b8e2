"""Control laws made of others: their sum, a law within limits, and a law that is evaluated once in a period."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..algebra.scalars import select
from ..recursions.control.paths import CLOCK as CLOCK
from ..recursions.joints.friction import DT
from ..recursions.spec import TAU, Argument, Q, Spec, V, made_once
from .law_specs import AFTER, BEGUN, begun, begun_of, given_by_step, in_step, law_on, own_name

LIMITS = Argument("limits", ("nv",), "N m | N", "largest torques")
PERIOD = Argument("period", (1,), "s", "from one sample to the next")
LEFT = Argument("time_left", (1,), "s", "until the next sample", start=0.0)
HELD = Argument("held_torque", ("nv",), "N m | N", "of the last sample", start=0.0)
STEP = tuple(replace(x, unit_norm=False) for x in (Q, V, TAU))
EARLY = tuple(begun(x) for x in (Q, V, TAU))  # inputs of a held torque


def ends_of(spec: Spec) -> tuple[Argument, ...]:
    """The parts of a law that are rates or ends of its states."""
    return spec.parts[1:]


def own_of(spec: Spec) -> tuple[Argument, ...]:
    """The inputs of a law that the step does not give, including its states."""
    return tuple(x for x in spec.present if x.name not in given_by_step(spec))


def called(spec: Spec, rows: Any, given: Mapping[str, Any], names: Mapping[str, str], early: bool) -> tuple[Any, Any]:
    """The torque of a law, and the rates or ends of its states by name.

    names  {name in the law: name in ``given``} of its inputs
    early  whether it is called with the inputs at the beginning of the step
    """
    states = {x.name for x in spec.states}

    def at(name: str) -> Any:
        return given[name + BEGUN if early else name]

    inputs: dict[str, Any] = {DT.name: given[DT.name]}
    for x in spec.present:
        if x.name in names:
            inputs[in_step(x.name)] = at(names[x.name]) if x.name in states else given[names[x.name]]
    inputs |= {name: given[names.get(of, of) + BEGUN] for name, of in begun_of(spec).items()}
    tau, made = law_on(spec, rows, inputs)(at(Q.name), at(V.name), at(TAU.name), {})
    return tau, {own_name(name): x for name, x in made.items()}


def _composed(
    name: str, recursion: Any, own: tuple[Argument, ...], ends: tuple[Argument, ...], parts: tuple[Spec, ...],
    early: bool = False,
) -> Spec:  # fmt: skip
    """The Spec of a law made of others; their own inputs, static ones last, follow q, v and tau.

    early  whether it reads inputs at the beginning of the step even if its parts do not
    """
    own = tuple(sorted((replace(x, unit_norm=False, optional=False) for x in own), key=lambda x: x.static))
    first = (*EARLY, *(begun(x) for x in own if x.start is not None))
    reads = early or any(begun_of(x) for x in parts)
    inputs = (*STEP, DT, *(first if reads else ()), *own)

    def on_rows(rows: Any, *arrays: Any) -> None:
        recursion(rows, dict(zip((x.name for x in inputs), arrays, strict=False)), *arrays[len(inputs) :])

    regroup = all(x.regroup for x in parts)
    return Spec(name, on_rows, None, inputs, TAU, "A law made of others.", "", parts=(TAU, *ends), regroup=regroup)


@lru_cache(maxsize=64)
def names_in_sum(specs: tuple[Spec, ...]) -> list[dict[str, str]]:
    """Names of the laws' own inputs in their sum: a name that several laws have gets the number of the law.

    All laws share one clock.
    """
    count: dict[str, int] = {}
    for spec in specs:
        for x in own_of(spec):
            count[x.name] = count.get(x.name, 0) + 1
    taken = {name for name, several in count.items() if several == 1 or name == CLOCK.name}
    names: list[dict[str, str]] = []
    for k, spec in enumerate(specs, 1):
        named = {x.name: x.name for x in own_of(spec)}
        for name in named.keys() - taken:
            while named[name] in taken or named[name] == name:  # a part may be a sum with numbered names
                named[name] += f"_{k}"
        names.append(named)
        taken |= {*named.values()}
    return names


@made_once(64)
def total(specs: tuple[Spec, ...], held: tuple[bool, ...]) -> Spec:
    """The sum of laws."""
    names = names_in_sum(specs)
    own: dict[str, Argument] = {}
    ends: dict[str, Argument] = {}
    for spec, named in zip(specs, names, strict=True):
        own |= {named[x.name]: replace(x, name=named[x.name]) for x in own_of(spec)}
        for x, end in zip(spec.states, ends_of(spec), strict=True):
            ends[named[x.name]] = replace(end, name=named[x.name] + end.name.removeprefix(x.name))

    def recursion(rows: Any, given: dict[str, Any], tau: Any, *parts: Any) -> None:
        places = dict(zip((x for x, y in own.items() if y.start is not None), parts, strict=True))
        for k, (spec, named, early) in enumerate(zip(specs, names, held, strict=True)):
            torque, made = called(spec, rows, given, named, early)
            if early and made:  # the torque is held, the states still change
                made = called(spec, rows, given, named, False)[1]
            tau[:] = torque if k == 0 else tau + torque
            for name, x in made.items():
                places[named[name]][:] = x

    ordered = tuple(ends[name] for name, x in own.items() if x.start is not None)
    name, inputs = "_and_".join(x.name for x in specs), tuple(own.values())
    return _composed(name, recursion, inputs, ordered, specs, any(held))


def unused(name: str, spec: Spec) -> str:
    """A name for an own input of a law made of another law, which has no input of this name."""
    taken = {x.name for x in own_of(spec)}
    while name in taken:
        name = f"outer_{name}"
    return name


@made_once(64)
def limited(spec: Spec) -> Spec:
    """A law clipped to -limits to limits; ``unused`` names this input."""
    names = {x.name: x.name for x in own_of(spec)}
    limits = unused(LIMITS.name, spec)

    def recursion(rows: Any, given: dict[str, Any], tau: Any, *parts: Any) -> None:
        torque, made = called(spec, rows, given, names, False)
        most = given[limits]
        for i, x in enumerate(torque):
            x = select(x - most[i], most[i], x)
            tau[i] = select(-most[i] - x, -most[i], x)
        for part, x in zip(parts, made.values(), strict=True):
            part[:] = x

    own = (*own_of(spec), replace(LIMITS, name=limits))
    return _composed(f"limited_{spec.name}", recursion, own, ends_of(spec), (spec,))


@made_once(64)
def sampled(spec: Spec) -> Spec:
    """A law evaluated once in a period and held in between; states that change at the end of a step change only then.

    ``unused`` names its period, the remaining time and the held torque.
    """
    names = {x.name: x.name for x in own_of(spec)}
    period, time_left, held = (replace(x, name=unused(x.name, spec)) for x in (PERIOD, LEFT, HELD))
    moved = [end.name.endswith(AFTER) for end in ends_of(spec)]

    def recursion(rows: Any, given: dict[str, Any], tau: Any, *parts: Any) -> None:
        left, h = given[time_left.name][0], given[DT.name]
        h = h[0] if np.ndim(h) else h
        due = 0.5 * h - left
        torque, early = called(spec, rows, given, names, True)
        now = called(spec, rows, given, names, False)[1] if early else {}
        for i, x in enumerate(torque):
            tau[i] = select(due, x, given[held.name][i])
        *own, left_after, held_after = parts
        for part, at_end, (name, x), y in zip(own, moved, early.items(), now.values(), strict=True):
            before = np.reshape(given[name], -1)
            for i in range(len(part)):
                part[i] = select(due, x[i], before[i]) if at_end else y[i]
        left_after[0] = select(due, left + given[period.name][0], left) - h
        held_after[:] = tau

    own = (*own_of(spec), period, time_left, held)
    ends = (*ends_of(spec), *(replace(x, name=x.name + AFTER, start=None) for x in (time_left, held)))
    return _composed(f"sampled_{spec.name}", recursion, own, ends, (spec,), early=True)
