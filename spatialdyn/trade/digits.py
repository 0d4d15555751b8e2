"""How many digits forward dynamics keeps on a model, by method and precision, from runs that round by chance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..engines import jit
from ..engines.rounded import DOUBLE, SINGLE, spread
from ..forward import METHODS
from ..model import Model
from ..recursions import SPECS

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]

EPS = {"float64": float(np.finfo(np.float64).eps), "float32": float(np.finfo(np.float32).eps)}
BITS = {"float64": DOUBLE, "float32": SINGLE}
RUNS = 3


def predicted_digits(model: Model, states: Sequence[State]) -> dict[str, dict[str, float]]:
    """Digits of the largest acceleration to expect of each method, the worst of some states.

    Nothing here knows the truth: each method runs a few times with operations rounded up or down by chance, and what
    the runs differ by is what rounding costs. float32 counts the rounding of the model's numbers as well, and is of
    float32 throughout, in its range of exponents too: samples whose pivots it loses (0 to 1 digits), or that leave its
    range, are computed in float64 by ``specialize``.

    states  (q, v, tau) each; the model has no mimic joints
    Returns {method: {"float64": digits, "float32": digits}}, -log10 of the error, 0 where none is right.
    """
    digits: dict[str, dict[str, float]] = {}
    for method, call in METHODS.items():
        spec = jit.variant(SPECS[call], frozenset(("q", "v", "tau")))
        digits[method] = {}
        for dtype, bits in BITS.items():
            worst = 0.0
            for k, (q, v, tau) in enumerate(states):
                given = {"q": q, "v": v, "tau": tau}
                worst = max(worst, spread(spec, model.bodies, given, (model.nv,), bits, RUNS, seed=RUNS * k))
            digits[method][dtype] = max(0.0, -math.log10(min(1.0, max(EPS[dtype], worst))))
    return digits
