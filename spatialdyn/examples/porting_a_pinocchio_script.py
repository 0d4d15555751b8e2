"""Porting a Pinocchio script: change one line, and see beforehand what is there.

Learn    ``import spatialdyn.compat.pinocchio as pin`` has Pinocchio's names and conventions; ``spatialdyn port FILE``
         lists the names that a script uses, and which of them are here.
Look at  the residuals, and at Pinocchio's own in the last line if it is installed. The script leaves out what the
         chapter's section 7.3 does to M, completing its upper triangle: from Python pin.crba returns both.
"""

from __future__ import annotations

from typing import Any

import spatialdyn as sd
from spatialdyn.compat.pinocchio.coverage.porting import uses
from spatialdyn.examples.gallery import need, start
from spatialdyn.urdf.load import find_robot

SCRIPT = """
import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(urdf)
data = model.createData()
angles, v, a = np.random.default_rng(0).normal(size=(3, model.nv))
zero, step = np.zeros(model.nv), 1e-6

def at(angles):  # cosine and sine of each continuous joint
    return np.stack([np.cos(angles), np.sin(angles)], 1).ravel()

q = at(angles)
tau, M = pin.rnea(model, data, q, v, a), pin.crba(model, data, q)
h, g = pin.rnea(model, data, q, v, zero), pin.rnea(model, data, q, zero, zero)
ahead = pin.crba(model, data, at(angles + step * v)).copy()
behind = pin.crba(model, data, at(angles - step * v))
rate = v @ (ahead - behind) @ v / (4 * step)  # v' M' v / 2, of the kinetic energy at zero acceleration
residuals = {"rnea - (M a + h)": abs(tau - M @ a - h).max(), "v' (M' v / 2 - (h - g))": abs(rate - v @ (h - g))}
"""
LINE, NEW = "import pinocchio as pin", "import spatialdyn.compat.pinocchio as pin"


def main() -> dict[str, Any]:
    """Print the report and both runs of the script; returns what the runs computed, Pinocchio's None without it."""
    for use in uses(SCRIPT):
        print(f"{use.name:28} {use.status}")
    found: dict[str, Any] = {"uses": uses(SCRIPT), "Pinocchio": None}
    for library, script in {"spatialdyn": SCRIPT.replace(LINE, NEW), "Pinocchio": SCRIPT}.items():
        try:
            if library == "Pinocchio":
                need("pinocchio", "validate")
        except sd.SpatialDynError:
            continue
        scope: dict[str, Any] = {"urdf": str(find_robot("three_link"))}
        exec(script, scope)  # in place of running the file
        found[library] = {name: scope[name] for name in ("tau", "M", "h", "g", "residuals")}
        print(f"{library:11}", ", ".join(f"{name} {x:.1e}" for name, x in scope["residuals"].items()))
    return found


if __name__ == "__main__":
    start(main)
