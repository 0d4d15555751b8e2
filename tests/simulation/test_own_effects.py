"""Effects that stand outside the package: a spring to the world, and another of the same name and inputs."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from dense import Array

import spatialdyn as sd
from spatialdyn.recursions.spec import Argument
from spatialdyn.simulation.effects import effect
from spatialdyn.simulation.effects.effect import Effect
from spatialdyn.simulation.effects.work import work_of

INERTIA, STIFFNESS = 1.0, 20.0
FOURTH = 1e-6  # of 0.5 rad in 20 steps of ω h = 0.045: some 20 (ω h)⁵ / 120 of it


def to_the_world(power: int) -> type[Effect]:
    """An effect whose torque is -k qⁿ; of any n under one name."""

    @dataclass(frozen=True, eq=False)
    class WorldSpring(Effect):
        stiffness: Array  # (nv,)
        name = "world spring"
        inputs = (Argument("world_stiffness", ("nv",), "N m/rad", "to the world"),)

        @property
        def values(self) -> dict[str, Array]:
            return {"world_stiffness": self.stiffness[None, None]}

        def torque(self, at: Any, q: Any, v: Any) -> Any:
            k = at.given["world_stiffness"]
            return np.array([-k[i] * math.prod([q[i]] * power) for i in range(len(v))], v.dtype)

    return WorldSpring


def wheel() -> sd.Model:
    solid = (1.0, (0.0, 0.0, 0.0), INERTIA * np.eye(3))
    return sd.ModelBuilder("wheel").add_body("wheel", None, axis=(0, 0, 1), inertia=solid).build()


def with_effect(model: sd.Model, acting: Effect, **others: Any) -> sd.Scene:
    scene = sd.Scene(model, **others)
    object.__setattr__(scene, "effects", (*scene.effects, acting))
    return scene


def test_the_example_of_the_protocol_acts_and_its_work_is_in_the_ledger() -> None:
    """The text of ``effect`` as it stands: a wheel on its spring swings, and the spring's work is -k (q² - q0²) / 2."""
    text = str(effect.__doc__).partition("whole:\n")[2].partition("\nIt acts")[0]
    names: dict[str, Any] = {
        "dataclass": dataclass, "Effect": Effect, "Argument": Argument, "work_of": work_of, "Array": Array, "np": np
    }  # fmt: skip
    exec(textwrap.dedent(text), names)
    model, k, dt = wheel(), STIFFNESS, 0.01
    run = sd.simulate(
        with_effect(model, names["WorldSpring"](np.array([k]))), [0.5], [0.0], 0.2, dt, "rk4", record="work"
    )
    angle = math.sqrt(k / INERTIA) * run.t
    assert abs(run.q[:, 0] - 0.5 * np.cos(angle)).max() < FOURTH
    ledger = sd.energy_ledger(run)
    assert list(ledger.work) == ["torque", "world_spring"]
    assert ledger.labels["world_spring"] == ("wheel_joint",)
    assert abs(ledger.work["world_spring"][:, 0] + 0.5 * k * (run.q[:, 0] ** 2 - 0.25)).max() < k * FOURTH
    assert abs(ledger.error).max() < k * FOURTH


def test_two_effects_of_one_name_are_two_programs() -> None:
    """Kept code is found by what it computes: the sources of an effect are no part of the package's."""
    model = wheel()
    for power in (1, 3, 1):
        scene = with_effect(model, to_the_world(power)(np.array([STIFFNESS])))  # type: ignore[call-arg]
        run = sd.rollout(scene, [0.5], [0.0], dt=1e-3, steps=1, method="semi_implicit_euler")
        assert abs(run.v[0, 0] + 1e-3 * STIFFNESS / INERTIA * 0.5**power) < 1e-15


MOMENTA = [name for name, x in sd.integrators.items() if x.family is not None and x.family.moves == "p"]


@pytest.mark.parametrize("method", MOMENTA)
def test_an_effect_acts_once_in_methods_that_move_momenta(method: str) -> None:
    """Beside a smooth damper: the wheel's damped oscillation."""
    model, k, b, dt = wheel(), STIFFNESS, 2.0, 2e-3
    spring: Any = to_the_world(1)
    damper = {"friction": sd.Friction(0.0, b, smoothing=1.0), "friction_method": "smooth"}
    scene = with_effect(model, spring(np.array([k])), **damper)
    run = sd.simulate(scene, [0.5], [0.0], 0.2, dt, method)
    rate, decay = math.sqrt(k / INERTIA - (b / (2 * INERTIA)) ** 2), b / (2 * INERTIA)
    wanted = 0.5 * np.exp(-decay * run.t) * (np.cos(rate * run.t) + decay / rate * np.sin(rate * run.t))
    assert abs(run.q[:, 0] - wanted).max() < (0.02 if sd.integrators[method].order == 1 else 1e-4)
    many = sd.rollout(scene, [[0.5]] * 2, [[0.0]] * 2, dt=dt, steps=10, method=method)
    np.testing.assert_array_equal(many.q[1], run.q[1:11])


def test_an_effect_acts_beside_dry_friction_and_contacts() -> None:
    """A block on a slide with a spring of stiffness k: dry friction holds it up to F / k, on the ground by μ m g."""
    block = (2.0, (0.0, 0.0, 0.0), 0.01 * np.eye(3))
    builder = sd.ModelBuilder("block").add_body("x", None, "prismatic", axis=(1, 0, 0), inertia=block, joint_name="x")
    builder.add_body("z", "x", "prismatic", axis=(0, 0, 1), inertia=block, joint_name="z")
    model, k, spring = builder.build(), 10.0, to_the_world(1)
    pull: Any = spring(np.array([k, 0.0]))  # type: ignore[call-arg]
    ground = sd.Contacts(model, {"z": 0.1}, friction=0.5)
    z, load = 0.1, 2.0 * 9.81 * 0.5
    for others in ({"friction": sd.Friction([load, 0.0], 0.0)}, {"contacts": ground}):
        for share, rests in ((0.9, True), (1.5, False)):
            scene = with_effect(model, pull, **others)
            start = [share * load / k, z]
            run = sd.simulate(scene, start, [0.0, 0.0], 0.02, 1e-3)
            assert (abs(run.q[-1, 0] - start[0]) < 1e-9) == rests
            if not rests:
                assert run.v[1, 0] == pytest.approx(-1e-3 * (share - 1.0) * load / 4.0, rel=1e-6)
