"""Conversion of positions, velocities and torques between joints and the actuators that drive them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, check_model
from ..errors import ModelError, ShapeError
from ..model.model import Model
from ..model.transmission import Transmission, listed_transmissions

Array = NDArray[np.float64]


class Coordinates(NamedTuple):
    """Positions (..., nq), velocities (..., nv) and torques (..., nv) of one side; None where not given."""

    q: Array | None
    v: Array | None
    tau: Array | None


def to_actuators(
    model: Model,
    transmissions: Transmission | Iterable[Transmission],
    *,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    tau: ArrayLike | None = None,
) -> Coordinates:
    """Coordinates of the actuators: θ = A⁻¹ (q - offset), θ̇ = A⁻¹ v, and torques Aᵀ τ, with the same power.

    model          Model
    transmissions  Transmission, or several of different joints; entries of other joints are unchanged
    q              (..., nq)  positions of the joints [rad | m]
    v              (..., nv)  velocities of the joints [rad/s | m/s]
    tau            (..., nv)  torques at the joints [N m | N]

    Returns Coordinates: new arrays, with actuator k of a transmission in the place of joint k of the transmission.
    Raises
        ModelError naming a joint that is unknown, has several coordinates, or is driven twice
        ShapeError for arrays of another size

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> wrist = sd.Transmission(("joint1", "joint2"), [[0.5, 0.5], [0.5, -0.5]])
    >>> sd.to_actuators(model, wrist, v=[1.0, 0.2], tau=[3.0, 1.0])
    Coordinates(q=None, v=array([1.2, 0.8]), tau=array([2., 1.]))
    """
    return _through(model, transmissions, (q, v, tau), back=False)


def to_joints(
    model: Model,
    transmissions: Transmission | Iterable[Transmission],
    *,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    tau: ArrayLike | None = None,
) -> Coordinates:
    """Coordinates of the joints: q = A θ + offset, q̇ = A θ̇, and torques A⁻ᵀ τ: the inverse of ``to_actuators``.

    Arguments and errors are those of ``to_actuators``, q, v and tau those of the actuators.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> wrist = sd.Transmission(("joint1", "joint2"), [[0.5, 0.5], [0.5, -0.5]])
    >>> sd.to_joints(model, wrist, v=[1.2, 0.8]).v
    array([1. , 0.2])
    """
    return _through(model, transmissions, (q, v, tau), back=True)


def _through(
    model: Model,
    transmissions: Transmission | Iterable[Transmission],
    values: Sequence[ArrayLike | None],
    back: bool,
) -> Coordinates:
    check_model(model)
    listed = listed_transmissions(transmissions)
    found: list[Array | None] = []
    for name, x, size in zip(("q", "v", "tau"), values, (model.nq, model.nv, model.nv), strict=True):
        found.append(None if x is None else np.array(as_array(name, x)))
        made = found[-1]
        if made is not None and made.shape[-1:] != (size,):
            raise ShapeError(f"{name} has shape {made.shape}, expected (..., {size})")
    driven: set[str] = set()
    for t in listed:
        joints = [model.joint(name) for name in t.joints]
        for joint in joints:
            if joint.nq != 1 or joint.mimic is not None:
                raise ModelError(
                    f'joint "{joint.name}" is {joint.kind}, expected an independent one of one coordinate to drive'
                )
            if joint.name in driven:
                raise ModelError(f'joint "{joint.name}" is driven by two transmissions, expected one')
            driven.add(joint.name)
        at = [j.idx_q for j in joints], [j.idx_v for j in joints]
        A, inverse = t.matrix, t.inverse
        q, v, tau = found
        if q is not None:
            q[..., at[0]] = q[..., at[0]] @ A.T + t.offset if back else (q[..., at[0]] - t.offset) @ inverse.T
        if v is not None:
            v[..., at[1]] = v[..., at[1]] @ (A if back else inverse).T
        if tau is not None:
            tau[..., at[1]] = tau[..., at[1]] @ (inverse if back else A)
    return Coordinates(*found)
