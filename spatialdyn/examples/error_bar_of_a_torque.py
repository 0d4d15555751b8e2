"""The error bar of a torque: each result with a bound that no rounding error exceeds, in float64 and in float32.

Learn    tau, bound = sd.bounded(model, sd.rnea)(q, v, a) says of each number how far it may be from the exact one: a
         proof line by line, no estimate. sd.specialize(model, sd.rnea, dtype=np.float32, tolerance=1e-5) uses it sample
         by sample: float32 where that is enough, float64 elsewhere, and says how many went where.
Look at  the true errors, measured against double-double: all under their bounds, thirty times below in the median.

Source: Higham, Accuracy and stability of numerical algorithms, 2nd ed. (2002), section 3.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.accuracy.references import recorded_call
from spatialdyn.examples.gallery import picture, start, write

DTYPES = {"float64": np.float64, "float32": np.float32}


def main(quick: bool = False, save: str | None = None, robot: str = "three_link") -> dict[str, Any]:
    """Print how near bounds are to errors, and the ways of a tolerance; returns errors and bounds of each dtype."""
    model, n = sd.load_urdf(robot), 200 if quick else 1000
    rng = np.random.default_rng(0)
    given = [rng.uniform(-np.pi, np.pi, (n, model.nq)), *rng.normal(size=(2, n, model.nv))]
    program, _ = recorded_call(model, "rnea")
    high, low = (x.T for x in program(np.ascontiguousarray(np.concatenate(given, axis=1).T)))  # 106 bits

    found: dict[str, Any] = {}
    for name, dtype in DTYPES.items():
        tau, bound = sd.bounded(model, sd.rnea, dtype=dtype)(*(x.astype(dtype) for x in given))
        error = abs((tau.astype(float) - high) - low)
        worst = (error / abs(high).max(1, keepdims=True)).max(), (bound / abs(high).max(1, keepdims=True)).max()
        ratio = np.median(bound[error > 0.0] / error[error > 0.0])
        found[name] = error, bound.astype(float)
        print(
            f"{name}: errors up to {worst[0]:.1e}, bounds up to {worst[1]:.1e} of the largest torque, bound over error"
        )
        print(
            f"    {ratio:.0f} in the median; {int((error > bound).sum())} of {error.size} errors are above their bound"
        )

    for tolerance in (1e-4, 5e-6, 1e-9, 1e-15):
        k = sd.specialize(model, sd.rnea, dtype=np.float32, tolerance=tolerance)
        off = abs((k(*given) - high) - low).max(1) / abs(high).max(1)
        found[f"{tolerance:g}"] = k.report, float(off.max())
        ways = ", ".join(f"{count} in {way}" for way, count in k.report.items() if count)
        print(f"within {tolerance:g}: {ways}; true error up to {off.max():.1e}")
    if save:
        figure, both = picture(2, 10.0, 4.2)
        for axes, name in zip(both, DTYPES, strict=True):
            error, bound = found[name]
            order = np.argsort(bound[:, 0])
            axes.semilogy(bound[order, 0], label="bound")
            axes.semilogy(np.where(error > 0.0, error, np.nan)[order, 0], ".", ms=3, label="true error")
            axes.set(xlabel="state, by bound", ylabel="torque of the first joint [N m]", title=f"{robot}, {name}")
            axes.legend(frameon=False)
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
