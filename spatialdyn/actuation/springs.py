"""Series-elastic joints: the torque and the energy of the springs between rotors and the joints that they drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import check_model
from ..calls.dynamics import checked_call
from ..model.model import Model
from ..recursions.joints.springs import SPRING_ENERGY, SPRING_TORQUE

Array = NDArray[np.float64]


def spring_torque(model: Model, q: ArrayLike, v: ArrayLike | None = None, out: Any = None) -> Array:
    """Torques of the springs of series-elastic joints: τ = k (θ/n - q) + d (θ̇/n - q̇) on the joint, -τ/n on its rotor.

    Source: after Spong, Modeling and control of elastic joint robots (1987).

    model  Model with joints of ``ModelBuilder.add_series_elastic``
    q      (..., nq)  joint positions [rad | m]
    v      (..., nv)  joint velocities [rad/s | m/s]; zero if left out
    out    (..., nv)  written in place if given: float64, C order, the shape of the result

    Forward dynamics with springs is ``aba(model, q, v, tau + spring_torque(model, q, v))``; ``simulate`` and
    ``rollout`` add these torques.

    Returns tau (..., nv): torques to add to those of the motors [N m | N]; 0 for a model without springs.
    Raises
        ShapeError for shapes that do not match, or an out that overlaps an input
        NaN in a sample gives NaN in what depends on it, in no other sample.

    >>> import spatialdyn as sd
    >>> b = sd.ModelBuilder("arm").add_body("rod", inertia=(1.0, (0.5, 0, 0), [[0, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]))
    >>> model = b.add_series_elastic("rod_joint", stiffness=100.0, rotor=1e-4, ratio=50.0).build()
    >>> sd.spring_torque(model, [0.1, 50 * 0.13])
    array([ 3.  , -0.06])
    """
    check_model(model)
    made: Array = checked_call(SPRING_TORQUE, model, (q, v), (), out)
    return made


def spring_energy(model: Model, q: ArrayLike, out: Any = None) -> Any:
    """Energy Σ ½ k (θ/n - q)² of the springs of series-elastic joints, which is not in ``potential_energy``.

    model  Model
    q      (..., nq)  joint positions [rad | m]
    out    (...)      written in place if given: float64, C order, the shape of the result

    Returns V (...) [J].
    Raises  as ``spring_torque``.
    """
    check_model(model)
    return checked_call(SPRING_ENERGY, model, (q,), (), out)
