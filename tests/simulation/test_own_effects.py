"""Effects that stand outside the package: a spring to the world, and another of the same name and inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from dense import Array

import spatialdyn as sd
from spatialdyn.recursions.spec import Argument
from spatialdyn.simulation.effects.effect import Effect

INERTIA, STIFFNESS = 1.0, 20.0


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


def test_two_effects_of_one_name_are_two_programs() -> None:
    """Kept code is found by what it computes: the sources of an effect are no part of the package's."""
    solid = (1.0, (0.0, 0.0, 0.0), INERTIA * np.eye(3))
    model = sd.ModelBuilder("wheel").add_body("wheel", None, axis=(0, 0, 1), inertia=solid).build()
    for power in (1, 3, 1):
        scene = sd.Scene(model)
        object.__setattr__(scene, "effects", (to_the_world(power)(np.array([STIFFNESS])),))
        run = sd.rollout(scene, [0.5], [0.0], dt=1e-3, steps=1, method="semi_implicit_euler")
        assert abs(run.v[0, 0] + 1e-3 * STIFFNESS / INERTIA * 0.5**power) < 1e-15
