"""Transmissions: actuators that drive one or several joints together, as the two motors of a differential wrist do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelError, literal
from .robot_checks import floats

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Transmission:
    """Joints driven together by as many actuators: q = A θ + offset and q̇ = A θ̇; compared and hashed by content.

    joints         names of k joints of one coordinate
    matrix         (k, k)  A: velocities of the joints per velocity of each actuator; 1/n of a gear of one joint
    rotor_inertia  (k,)  of each actuator about its axis [kg m²]; 0 if left out
    offset         (k,)  of the joints at θ = 0 [rad | m]; 0 if left out
    actuators      names of the actuators; those of the joints if left out

    Power is kept: τ_θ = Aᵀ τ_q. The actuators' inertias are A⁻ᵀ diag(J) A⁻¹ in M, an armature with entries off its
    diagonal (``Model.with_(transmissions=)``); ``to_actuators`` and ``to_joints`` take positions, velocities and
    torques from one side to the other.

    Raises  ModelError for names that are no text or twice there, numbers of another count or not finite, a matrix
            that has no inverse, a negative inertia.

    >>> import spatialdyn as sd
    >>> wrist = sd.Transmission(("pitch", "roll"), [[0.5, 0.5], [0.5, -0.5]], rotor_inertia=[2e-4, 3e-4])
    >>> wrist.reflected_inertia()
    array([[ 0.0005, -0.0001],
           [-0.0001,  0.0005]])
    """

    joints: tuple[str, ...]
    matrix: Array
    rotor_inertia: Array
    offset: Array
    actuators: tuple[str, ...]

    def __init__(
        self,
        joints: Sequence[str],
        matrix: ArrayLike,
        rotor_inertia: ArrayLike | None = None,
        offset: ArrayLike | None = None,
        actuators: Sequence[str] | None = None,
    ) -> None:
        """Keep copies of the numbers."""
        names = _names("joints", joints)
        k, what = len(names), f"transmission of {', '.join(names)}"
        motors = names if actuators is None else _names("actuators", actuators)
        if len(motors) != k:
            raise ModelError(f"{what} has {len(motors)} actuators, expected {k}")
        given = {"matrix": (matrix, k * k), "rotor_inertia": (rotor_inertia, k), "offset": (offset, k)}
        for name, (value, count) in given.items():
            x = np.zeros(count) if value is None else np.array(floats(value, count, f"{what} has {name}"))
            if not np.isfinite(x).all():
                raise ModelError(f"{what} has {name} {x.tolist()}, expected finite numbers")
            x = x.reshape(k, k) if name == "matrix" else x
            x.flags.writeable = False
            object.__setattr__(self, name, x)
        if (self.rotor_inertia < 0.0).any():
            raise ModelError(f"{what} has rotor_inertia {self.rotor_inertia.tolist()}, expected numbers of 0 or more")
        if not np.linalg.cond(self.matrix) < 1.0 / np.finfo(float).eps:
            raise ModelError(f"{what} has matrix {self.matrix.tolist()}, expected one with an inverse")
        object.__setattr__(self, "joints", names)
        object.__setattr__(self, "actuators", motors)

    @property
    def inverse(self) -> Array:
        """A⁻¹ (k, k): velocities of the actuators per velocity of each joint."""
        return np.asarray(np.linalg.inv(self.matrix))

    def reflected_inertia(self) -> Array:
        """A⁻ᵀ diag(J) A⁻¹ (k, k), symmetric: what the actuators add to M of the joints [kg m² | kg m | kg]."""
        turns = self.inverse
        B = turns.T @ (self.rotor_inertia[:, None] * turns)
        return np.asarray(0.5 * (B + B.T))

    def _content(self) -> tuple[Any, ...]:
        numbers = (self.matrix, self.rotor_inertia, self.offset)
        return (self.joints, self.actuators, *((x + 0.0).tobytes() for x in numbers))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transmission) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def __reduce__(self) -> tuple[Callable[..., Transmission], tuple[Any, ...]]:
        return Transmission, (self.joints, self.matrix, self.rotor_inertia, self.offset, self.actuators)

    def __repr__(self) -> str:
        return f"<Transmission of {', '.join(self.joints)}: q̇ = {self.matrix.tolist()} θ̇>"


def _names(what: str, value: Any) -> tuple[str, ...]:
    try:
        names = (value,) if isinstance(value, str) else tuple(value)
    except TypeError:
        names = ()
    if not names or not all(isinstance(x, str) for x in names) or len(set(names)) < len(names):
        raise ModelError(f"{what} of a transmission are {literal(value)}, expected names, each once")
    return names


def listed_transmissions(given: Any) -> list[Transmission]:
    """One Transmission, or several, as a list. Raises ModelError for anything else."""
    expected = "expected a Transmission or several"
    try:
        listed = [given] if isinstance(given, Transmission) else list(given)
    except TypeError:
        raise ModelError(f"transmissions is {literal(given)}, {expected}") from None
    for x in listed:
        if not isinstance(x, Transmission):
            raise ModelError(f"transmissions has {literal(x)}, {expected}")
    return listed
