"""The text of ``print(scene)``: its effects, the operations that they add to a step, the states, the methods.

Of a loop one pass is counted, of a part that is skipped at times all of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from ..engines.programs.record import recording
from .effects import of_structure
from .states import HIDDEN
from .steps import step_specs

STEP = "semi_implicit_euler"  # the method whose operations are counted: it takes every scene


@lru_cache(maxsize=64)
def operations(scene: Any) -> int | None:
    """Operations of a recorded step of semi_implicit_euler; None for a robot too long for a program."""
    acting = of_structure(scene)
    specs, tables = step_specs(STEP, acting), tuple(x for effect in acting for x in effect.tables)
    if not recording.fits(specs, scene.model.bodies, static=tables):
        return None
    counts = recording.record(specs, scene.model.bodies, tables).program.operations
    return int(sum(counts.values()))


def described(scene: Any, defaults: Mapping[str, Any]) -> str:
    """The text; ``defaults`` has the values, other than None, of options that do not act."""
    whole, model = operations(scene), scene.model
    rows = [("step of semi_implicit_euler", "-" if whole is None else f"{whole} operations", "")]
    for name in scene.acts:
        less = None if name == "springs" else operations(scene.with_(**{name: defaults.get(name)}))
        added = "" if whole is None or less is None else f"{whole - less:+d}"
        rows.append((f"  {name}", added, _options(scene, name)))
    widths = [max(len(row[k]) for row in rows) for k in range(2)]
    lines = [f"{row[0].ljust(widths[0])}  {row[1].rjust(widths[1])}  {row[2]}".rstrip() for row in rows]
    states = [x.name for effect in of_structure(scene) for x in effect.states if x.name not in HIDDEN]
    return "\n".join(
        [
            f"Scene of {model.name}: {', '.join(scene.acts) or 'nothing acts'}",
            *lines,
            f"states      q ({model.nq}), v ({model.nv}){''.join(f', {x}' for x in states)}",
            f"methods     {', '.join(scene.methods)}",
            f"by default  {scene.method}",
        ]
    )


def _options(scene: Any, name: str) -> str:
    """How an effect acts."""
    if name == "constraints" and scene.constraints is not None:
        way = "projection" if scene.stabilization is None else f"stabilization {scene.stabilization:g} s"
        count = scene.constraints.nc
        return f"{count} equation{'s' * (count != 1)}, by {way}"
    if name == "contacts" and scene.contacts is not None:
        count = len(scene.contacts)
        return f"{count} point{'s' * (count != 1)} on a {type(scene.contacts.terrain).__name__}"
    if name == "friction":
        return str(scene.friction_method)
    if name == "limits":
        count = int((np.isfinite(scene.model.lower) | np.isfinite(scene.model.upper)).sum())
        return f"of {count} coordinate{'s' * (count != 1)}"
    return f"given a {scene.drive}" if name == "motor" else ""
