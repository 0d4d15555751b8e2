"""Drift of conserved quantities in a computed motion without torques."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_items, check_model
from ..calls.dynamics import calls
from ..errors import NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..waiting import watch
from .conserved import ConservedQuantity, conserved_quantities

Array = NDArray[np.float64]


class Conservation(NamedTuple):
    """Drift of one quantity.

    name, unit   name and unit of the quantity
    initial      its first value
    drift        largest |value - initial|
    slope        slope of the least-squares line through the values, per second
    slope_error  standard error of the slope, if deviations from the line are independent
    """

    name: str
    unit: str
    initial: float
    drift: float
    slope: float
    slope_error: float


class ConservationReport(tuple[Conservation, ...]):
    """A Conservation per quantity, printed as a table."""

    __slots__ = ()

    def __repr__(self) -> str:
        width = max([len(x.name) for x in self], default=8)
        lines = [f"{'quantity':<{width}}  {'initial':>13}  {'max drift':>9}  {'slope per s':>20}  unit"]
        for x in self:
            slope = f"{x.slope:.1e} ± {x.slope_error:.1e}"
            lines.append(f"{x.name:<{width}}  {x.initial:>13.6g}  {x.drift:>9.1e}  {slope:>20}  {x.unit}")
        return "\n".join(lines)


@watch.call("check_conservation")
def check_conservation(
    trajectory: Any, quantities: list[ConservedQuantity] | None = None, model: Model | None = None
) -> ConservationReport:
    """The drift of each conserved quantity in a motion without torques.

    trajectory  any object with t (n,) [s], q (n, nq), and p (n, nv) or v (n, nv)
    quantities  the quantities to check; conserved_quantities(model) if left out
    model       the Model that moved; the trajectory's own model if left out

    A straight line fitted to the values distinguishes drift from oscillation: for an integrator that loses energy the
    slope is many times its standard error. Oscillations correlate neighbouring values, so this standard error is too
    small.

    Returns a ConservationReport: per quantity name, unit, initial, drift, slope, slope_error.
    Raises  ShapeError for arrays that do not fit, fewer than 3 times or times that do not increase; NonFiniteError
            naming the first state that is not finite; SpatialDynError for an object without these arrays, or without a
            model if one is needed.

    >>> from types import SimpleNamespace
    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("ur5")
    >>> still = SimpleNamespace(t=np.arange(3.0), q=np.zeros((3, 6)), v=np.zeros((3, 6)))
    >>> check_conservation(still, model=model)[0].drift
    0.0
    """
    for name in ("t", "q"):
        if not hasattr(trajectory, name):
            raise SpatialDynError(f"trajectory is {literal(trajectory):.80}, expected an object with t, q, and p or v")
    model = getattr(trajectory, "model", None) if model is None else model
    if quantities is None:
        quantities = conserved_quantities(_needed(model))
    quantities = as_items("quantities", quantities, ConservedQuantity, "a list of ConservedQuantity")
    t, q = as_array("t", trajectory.t), as_array("q", trajectory.q)
    if t.ndim != 1 or len(t) < 3 or not (np.diff(t) > 0.0).all():
        raise ShapeError(f"t has shape {t.shape}, expected at least 3 times that increase")
    given = "v" if getattr(trajectory, "p", None) is None else "p"
    if getattr(trajectory, given, None) is None:
        raise SpatialDynError("trajectory has neither p nor v, expected one of them")
    p = as_array(given, getattr(trajectory, given))
    for name, x in (("q", q), (given, p)):
        if x.ndim != 2 or len(x) != len(t):
            raise ShapeError(f"{name} has shape {x.shape}, expected ({len(t)}, ...): a row for each time")
        lost = np.flatnonzero(~np.isfinite(x).all(-1))
        if len(lost):
            raise NonFiniteError(f"{name} is not finite at t = {t[lost[0]]:g}, expected a motion of finite numbers")
    if given == "v":
        p = calls["momentum"](_needed(model), q, p)
    return ConservationReport(_judged(quantity, t, q, p) for quantity in quantities)


def _needed(model: Model | None) -> Model:
    if model is None:
        raise SpatialDynError("model is None, expected the model of a trajectory that carries none")
    return check_model(model)


def _judged(quantity: ConservedQuantity, t: Array, q: Array, p: Array) -> Conservation:
    """Drift and fitted line of one quantity."""
    values = np.asarray(quantity.value(q, p))
    off, centred = values - values[0], t - t.mean()
    spread = float(centred @ centred)
    slope = float(centred @ off) / spread
    left = off - off.mean() - slope * centred
    error = float(np.sqrt(left @ left / (len(t) - 2) / spread))
    return Conservation(quantity.name, quantity.unit, float(values[0]), float(abs(off).max()), slope, error)
