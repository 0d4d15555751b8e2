"""Units do not matter: masses times 2^a, lengths times 2^b and times times 2^c change every result by a power of two.

Exactly, bit for bit, because a power of two rounds nothing: any absolute tolerance, anywhere between the robot's
description and the result, would show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from inputs import MAIN_CALLS, random_input
from slow import slow_but
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Argument, Spec

Array = np.ndarray
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


class Scale(NamedTuple):
    """Powers of two by which mass, length and time are multiplied."""

    mass: int = 0
    length: int = 0
    time: int = 0


ONES = (Scale(1), Scale(0, 1), Scale(0, 0, 1))
FAR = (Scale(-300, -100, 0), Scale(200, 60, 30), Scale(-100, 60, -90), Scale(0, 0, 150), Scale(150, -150, 7))
FLOAT32 = (Scale(-12, -4, 0), Scale(8, 3, 2), Scale(0, 0, 6), Scale(-20, 2, -5))  # τ² stays in its range
# kg, m and s in an entry of a rotating freedom; of a translating one, or the linear half of a force
UNITS = {
    "rad | m": ((0, 0, 0), (0, 1, 0)),
    "rad/s | m/s": ((0, 0, -1), (0, 1, -1)),
    "rad/s² | m/s²": ((0, 0, -2), (0, 1, -2)),
    "N m | N": ((1, 2, -2), (1, 1, -2)),
    "N | N m": ((1, 2, -2), (1, 1, -2)),
    "kg m²/s | kg m/s": ((1, 2, -1), (1, 1, -1)),
    "1": ((0, 0, 0), (0, 0, 0)),
}


def power(unit: tuple[int, int, int], s: Scale) -> int:
    """The exponent of two of a quantity of that unit."""
    return unit[0] * s.mass + unit[1] * s.length + unit[2] * s.time


@lru_cache(maxsize=64)
def scaled(model: sd.Model, s: Scale) -> sd.Model:
    """The same robot in other units, built anew."""
    robot = model.robot
    mass, length, inertia = (np.ldexp(1.0, power(u, s)) for u in ((1, 0, 0), (0, 1, 0), (1, 2, 0)))
    links = tuple(
        replace(
            link,
            mass=link.mass * mass,
            com=tuple(x * length for x in link.com),
            inertia=tuple(x * inertia for x in link.inertia),
        )
        for link in robot.links
    )
    joints = tuple(
        replace(
            joint,
            placement=tuple(x * length if k in (3, 7, 11) else x for k, x in enumerate(joint.placement)),
            armature=joint.armature * (mass if joint.kind == "prismatic" else inertia),
        )
        for joint in robot.joints
    )
    made, options = replace(robot, links=links, joints=joints), model.options
    gravity = np.ldexp(model.gravity, power((0, 1, -2), s))
    return sd.assemble(made, root=options.root, gravity=gravity, continuous=options.continuous)


def travelling(model: sd.Model, shape: tuple[Any, ...]) -> Array:
    """Mask, over an input of that shape, of the entries of translating freedoms and of the linear half of forces."""
    if shape == ("njoints", 6):
        return np.tile([True] * 3 + [False] * 3, (model.njoints, 1))
    if all(isinstance(size, int) for size in shape):  # a number or a vector of one unit
        return np.zeros(shape, bool)
    which = np.zeros(getattr(model, shape[0]), bool)
    for joint in model.joints[1:]:
        first = joint.idx_q if shape == ("nq",) else joint.idx_v
        count = {"prismatic": 1, "floating": 3, "planar": 2}.get(joint.kind, 0)
        which[first : first + count] = True
    return which


def moved(model: sd.Model, argument: Argument, value: Array, s: Scale) -> Array:
    """An input in other units."""
    turning, linear = UNITS[argument.unit]
    return np.ldexp(value, np.where(travelling(model, argument.shape), power(linear, s), power(turning, s)))


def state(model: sd.Model, tree: Any, spec: Spec, rng: np.random.Generator) -> list[tuple[Argument, Array]]:
    """A random value of every input of a call that varies."""
    made = random_state(tree, rng)
    other = random_state(tree, rng)
    values = {"q0": made.q, "q1": other.q, "p": other.tau, "t": np.array(0.3), "fext": made.fext}
    given = []
    for x in spec.present:
        if not x.static:
            value = values.get(x.name, getattr(made, x.name, None))
            given.append((x, random_input(model, x, rng) if value is None else value))
    return given


def words(spec: Spec) -> dict[str, Any]:
    """Keyword arguments of a call that takes a frame."""
    static = {x.name for x in spec.present if x.static}
    made: dict[str, Any] = {"frame": "b0004"} if "row" in static else {}
    return made | ({"reference": "local_world_aligned"} if "reference" in static else {})


def results(model: sd.Model, spec: Spec, given: list[tuple[Argument, Array]], s: Scale) -> Array:
    """What a call returns for the robot and its inputs in those units."""
    named = {x.name: moved(model, x, value, s) for x, value in given}
    return np.asarray(calls[spec.name](scaled(model, s), **named, **words(spec)))


def hold(call: Callable[[Scale], Array], scales: tuple[Scale, ...]) -> None:
    """Mantissas never change, and exponents are linear in the three powers."""
    mantissa, exponent = np.frexp(call(Scale()))
    found = {s: np.frexp(call(s)) for s in (*ONES, *scales)}
    units = [np.where(mantissa, found[one][1] - exponent, 0) for one in ONES]
    for s, (m, e) in found.items():
        np.testing.assert_array_equal(m, mantissa)
        expected = exponent + sum(k * unit for k, unit in zip(s, units, strict=True))
        np.testing.assert_array_equal(np.where(m, e, 0), np.where(m, expected, 0))


ROBOTS: dict[str, dict[str, Any]] = {
    "arm": dict(kinds=("revolute", "prismatic", "spherical", "continuous"), continuous="cos_sin"),
    "free": dict(kinds=("revolute", "planar", "floating"), floating=True, armature=False),
}
CALLS_AT_ONCE = [(name, "free") for name in MAIN_CALLS[::2]]


def in_turn(at_once: list[tuple[str, str]], names: Iterable[str]) -> list[tuple[str, str]]:
    """Those at once, and each name on one of ROBOTS in turn."""
    kinds = list(ROBOTS)
    others = [(name, kinds[k % len(kinds)]) for k, name in enumerate(names)]
    return [*at_once, *(x for x in others if x not in at_once)]


@pytest.mark.parametrize(
    ("name", "kind"),
    slow_but(CALLS_AT_ONCE, in_turn(CALLS_AT_ONCE, SPECS)),
)
def test_every_call_is_covariant_to_the_bit(name: str, kind: str) -> None:
    made = random_tree(11, 6, **ROBOTS[kind])
    model, spec = made.model, SPECS[name]
    given = state(model, made.tree, spec, np.random.default_rng(3))
    whole = 2 if name == "aba_square_root" else 1  # its rows are square roots of masses: even powers of two alone
    hold(lambda s: results(model, spec, given, s._replace(mass=whole * s.mass)), FAR)


@compiled
@pytest.mark.parametrize(
    ("name", "kind"),
    slow_but(
        [("rnea", "arm"), ("crba", "free"), ("aba", "arm")],
        [("rnea", "arm"), ("crba", "free"), ("aba", "arm"), ("minverse", "free"), ("coriolis_matrix", "free")],
    ),
)
def test_lanes_are_covariant_to_the_bit(name: str, kind: str) -> None:
    """On a robot of which no mass, length or inertia is 1 in any of these units: a program absorbs such a factor."""
    made = random_tree(12, 5, **ROBOTS[kind])
    model, spec = made.model, SPECS[name]
    rng = np.random.default_rng(4)
    samples = [state(model, made.tree, spec, rng) for _ in range(515)]
    stacked = [(x, np.stack([sample[k][1] for sample in samples])) for k, (x, _) in enumerate(samples[0])]
    given = [(x, value) for x, value in stacked if not x.optional]
    spec = numba_kernels.variant(spec, frozenset())
    if batch_kernels.kernel((spec,), model.bodies, model.key, ()) is None:
        pytest.skip("no program")
    hold(lambda s: results(model, spec, given, s), FAR[:1])


@compiled
@pytest.mark.parametrize("name", ["rnea", "crba", "aba"])
def test_float32_programs_are_covariant_to_the_bit(name: str) -> None:
    made = random_tree(12, 5, **ROBOTS["arm"])
    model, spec = made.model, numba_kernels.variant(SPECS[name], frozenset())
    rng = np.random.default_rng(4)
    samples = [state(model, made.tree, spec, rng) for _ in range(20)]
    given = [(x, np.stack([sample[k][1] for sample in samples])) for k, (x, _) in enumerate(samples[0])]

    def call(s: Scale) -> Array:
        program = sd.specialize(scaled(model, s), calls[name], dtype=np.float32)
        return np.asarray(program(*(moved(model, x, value, s) for x, value in given)))

    hold(call, FLOAT32)


def test_the_inertia_that_counts_as_none_is_covariant() -> None:
    """A joint next to singular is refused, or not, in all units alike."""
    builder = sd.ModelBuilder("tips")
    builder.add_body("b0001", None, "revolute", (0, 1, 0), None, (1.0, (0, 0, 0.3), np.eye(3)))
    builder.add_body("b0002", "b0001", "revolute", (0, 1, 0), (0.1, 0, 1.3), (1e-17, (0, 0, 1e-3), np.zeros((3, 3))))
    builder.add_body("b0003", "b0002", "revolute", (0, 1, 0), (0.1, 0, 0), armature=1e-20)
    model = builder.build()
    for s in (Scale(), *FAR):
        robot = scaled(model, s)
        assert np.isfinite(sd.aba(robot, [0.1, 0.2, 0.3], np.zeros(3), np.zeros(3))).all()
    hollow = sd.ModelBuilder("hollow")
    hollow.add_body("b0001", None, "revolute", (0, 0, 1), None, None)
    hollow.add_body("b0002", "b0001", "revolute", (0, 0, 1), None, (1.0, (0.3, 0.7, 0), np.eye(3)))
    model = hollow.build()
    for s in (Scale(), *FAR):
        with pytest.raises(sd.InertiaError):
            sd.aba(scaled(model, s), [0.1, 0.2], np.zeros(2), np.zeros(2))


def motion(model: sd.Model, tree: Any, method: str, s: Scale) -> Array:
    """q and v (samples, nq + nv) of a short simulation in those units."""
    made = random_state(tree, np.random.default_rng(5))
    given = {x.name: x for x in SPECS["rnea"].present}
    q0, v0 = moved(model, given["q"], made.q, s), moved(model, given["v"], made.v, s)
    dt = np.ldexp(1.0, s.time - 8)
    run = sd.simulate(scaled(model, s), q0, v0, 12 * dt, dt, method)
    assert run.t[-1] == 12 * dt
    return np.concatenate([run.q, run.v], axis=1)


OWN = [x for x in sd.integrators if sd.integrators[x].family is not None]
AT_ONCE = [("semi_implicit_euler", "arm"), ("rk4", "free"), ("gauss4", "arm")]


@pytest.mark.parametrize(("method", "kind"), slow_but(AT_ONCE, in_turn(AT_ONCE, OWN)))
def test_motions_are_covariant_to_the_bit(method: str, kind: str) -> None:
    """Steps that are iterated end where they do in any units: their tolerance is relative to what they iterate.

    SciPy's methods have an absolute tolerance, which is the caller's to choose.
    """
    made = random_tree(11, 4, **ROBOTS[kind])
    hold(lambda s: motion(made.model, made.tree, method, s), FAR[:1])
