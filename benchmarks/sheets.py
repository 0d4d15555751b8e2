"""Both columns of the cheat sheet "Coming from Drake", side by side; for a library that the tests do not install.

    pip install drake
    python benchmarks/sheets.py

Prints the largest difference of each row; the exit status is the number of rows that differ.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "docs"))
from test_coming_from import CLOSE, rows, value

from spatialdyn.commands import cli
from spatialdyn.docs import blocks

PLANT = """
from pydrake.all import FirstOrderTaylorApproximation, JacobianWrtVariable, MultibodyForces, MultibodyPlant, Parser
plant = MultibodyPlant(0.0)
Parser(plant).AddModelsFromString(sd.to_urdf(model), "urdf")
plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
for joint in model.joints[1:]:
    plant.AddJointActuator(joint.name, plant.GetJointByName(joint.name))
plant.Finalize()
context = plant.CreateDefaultContext()
plant.SetPositionsAndVelocities(context, [*q, *v])
plant.get_actuation_input_port().FixValue(context, tau)
forces = MultibodyForces(plant)
plant.CalcForceElementsContribution(context, forces)
world, tip, p, with_respect_to = plant.world_frame(), plant.GetFrameByName("tip"), [0, 0, 0], JacobianWrtVariable.kV
torques, states = plant.get_actuation_input_port().get_index(), plant.get_state_output_port().get_index()
"""


def plain(found: Any) -> Any:
    """An array of what either library returns."""
    if hasattr(found, "GetAsMatrix4"):
        return found.GetAsMatrix4()
    return np.hstack([found.A(), found.B()] if hasattr(found, "A") else found) if not np.ndim(found) else found


def main() -> int:
    """Compare the rows. Returns how many differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    names: dict[str, Any] = {"__name__": "drake"}
    assert blocks.run("coming_from/drake", cli.main, names) == []
    exec(PLANT, names)
    wrong = 0
    for task, theirs, ours in rows("drake"):
        one, other = plain(value(theirs, names)), value(ours, names)
        other = np.hstack(other) if isinstance(other, tuple) else other
        one = np.vstack([one[3:], one[:3]]) if task == "Jacobian" else one  # its rows are angular first
        wrong += not np.allclose(one, other, rtol=CLOSE, atol=CLOSE)
        print(f"{task:35} {np.abs(one - other).max():.1e}")
    return wrong


if __name__ == "__main__":
    raise SystemExit(main())
