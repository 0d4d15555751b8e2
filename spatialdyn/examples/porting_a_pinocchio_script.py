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
q, rng = pin.neutral(model), np.random.default_rng(0)
q = pin.integrate(model, q, rng.normal(size=model.nv))
v, a = rng.normal(size=(2, model.nv))
tau = pin.rnea(model, data, q, v, a)
M, h = pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)
C, g = pin.computeCoriolisMatrix(model, data, q, v), pin.computeGeneralizedGravity(model, data, q)
step = 1e-6
ahead = pin.crba(model, data, pin.integrate(model, q, step * v)).copy()
behind = pin.crba(model, data, pin.integrate(model, q, -step * v))
N = (ahead - behind) / (2 * step) - 2 * C
residuals = {"rnea - (M a + h)": abs(tau - M @ a - h).max(), "h - (C v + g)": abs(h - C @ v - g).max(),
             "aba - a": abs(pin.aba(model, data, q, v, tau) - a).max(), "N + N'": abs(N + N.T).max()}
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
        found[library] = {name: scope[name] for name in ("tau", "M", "h", "C", "g", "residuals")}
        print(f"{library:11}", ", ".join(f"{name} {x:.1e}" for name, x in scope["residuals"].items()))
    return found


if __name__ == "__main__":
    start(main)
