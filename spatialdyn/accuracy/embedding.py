"""States of a reduced robot as states of the whole robot, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array
from ..errors import ShapeError
from ..model.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Embedding:
    """q and v of a robot with locked joints or rigid springs, and their places in q and v of the whole robot.

    base  (nq,)  coordinates of the whole robot: only those of locked joints are used
    in_q  (nq of the smaller robot,)  places of its coordinates
    in_v  (nv of the smaller robot,)  places of its velocities
    turns  of rigid springs, θ = n q: (place in q of the rotor, of its joint, place in v of the rotor, of its joint, n)
    """

    base: Array
    in_q: NDArray[np.intp]
    in_v: NDArray[np.intp]
    turns: tuple[tuple[int, int, int, int, float], ...] = ()

    @classmethod
    def of(cls, model: Model, small: Model, locks: Mapping[str, Any], rigid: bool, q: Array) -> Embedding:
        """The Embedding of a smaller model of the same robot; q (nq,) is a configuration of the whole robot."""
        base = np.array(q, float)
        for name, value in locks.items():
            joint = model.joint(name)
            if joint.mimic is None:
                base[joint.idx_q : joint.idx_q + joint.nq] = value
        in_q: list[int] = []
        in_v: list[int] = []
        for joint in small.joints[1:]:
            if joint.mimic is None:
                whole = model.joint(joint.name)
                in_q += range(whole.idx_q, whole.idx_q + whole.nq)
                in_v += range(whole.idx_v, whole.idx_v + whole.nv)
        turns = []
        for x in model.robot.joints if rigid else ():
            if x.spring is not None and x.spring.joint not in locks:
                rotor, driven = model.joint(x.name), model.joint(x.spring.joint)
                turns.append((rotor.idx_q, driven.idx_q, rotor.idx_v, driven.idx_v, x.spring.ratio))
        return cls(base, np.array(in_q, np.intp), np.array(in_v, np.intp), tuple(turns))

    @property
    def whole(self) -> bool:
        """Whether nothing is locked or rigid."""
        return len(self.in_q) == len(self.base)

    def locked(self, nv: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places of the locked joints in q and in v."""
        free_q, free_v = [x[0] for x in self.turns], [x[2] for x in self.turns]
        q = np.setdiff1d(np.arange(len(self.base)), [*self.in_q, *free_q])
        return q, np.setdiff1d(np.arange(nv), [*self.in_v, *free_v])

    def matrix(self, nv: int) -> Array:
        """E (nv, nv of the smaller robot) with v = E v_smaller; torques τ of the whole robot become Eᵀ τ."""
        E = np.zeros((nv, len(self.in_v)))
        E[self.in_v, np.arange(len(self.in_v))] = 1.0
        for _, _, rotor, joint, n in self.turns:
            E[rotor] = n * E[joint]
        return E

    def to_full(self, q: ArrayLike, v: ArrayLike, nv: int) -> tuple[Array, Array]:
        """States of the whole robot. Raises ShapeError."""
        x, w = _of("q", q, len(self.in_q)), _of("v", v, len(self.in_v))
        full = np.array(np.broadcast_to(self.base, (*x.shape[:-1], len(self.base))))
        full[..., self.in_q] = x
        for rotor, joint, _, _, n in self.turns:
            full[..., rotor] = n * full[..., joint]
        fast = np.zeros((*w.shape[:-1], nv))
        fast[..., self.in_v] = w
        for _, _, rotor, joint, n in self.turns:
            fast[..., rotor] = n * fast[..., joint]
        return full, fast

    def to_reduced(self, q: ArrayLike, v: ArrayLike, nv: int) -> tuple[Array, Array]:
        """States of the smaller robot. Raises ShapeError."""
        x, w = _of("q", q, len(self.base)), _of("v", v, nv)
        return np.ascontiguousarray(x[..., self.in_q]), np.ascontiguousarray(w[..., self.in_v])


def _of(name: str, given: ArrayLike, size: int) -> Array:
    x = as_array(name, given)
    if not x.ndim or x.shape[-1] != size:
        raise ShapeError(f"{name} has shape {x.shape}, expected (..., {size})")
    return x
