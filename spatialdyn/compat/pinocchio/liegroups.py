"""Lie groups R^n, SO(2), SO(3), SE(2), SE(3) and products: the configuration spaces of chains of joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from ...errors import ShapeError
from .algorithms import configuration
from .model.joint import JointModel
from .model.joints import JointModelFreeFlyer, JointModelPlanar, JointModelPX, JointModelRUBX, JointModelSpherical
from .model.model import Model
from .types.arguments import ArgumentError, Array, described, expected
from .types.bases import Registered
from .types.containers import StdVec_Index
from .types.frame import ARG0, ARG1, ArgumentPosition
from .types.se3 import SE3 as Placement

JOINTS: Mapping[str, type[JointModel]] = {
    "SO(2)": JointModelRUBX,
    "SO(3)": JointModelSpherical,
    "SE(2)": JointModelPlanar,
    "SE(3)": JointModelFreeFlyer,
}

__all__ = ["R1", "R2", "R3", "SE2", "SE3", "SO2", "SO3", "Rn"]


@cache
def _chain(parts: tuple[str, ...]) -> Model:
    """A chain of joints whose configuration space is the product of the groups."""
    model = Model()
    for part in parts:
        kinds = [JOINTS[part]] if part in JOINTS else [JointModelPX] * int(part[2:])
        for kind in kinds:
            model.addJoint(model.njoints - 1, kind(), Placement.Identity(), f"joint {model.njoints}")
    return model


def _forwarded(rows: str) -> Iterator[Callable[..., Any]]:
    """Methods that call functions of a Model with the group's own, from rows "name: docstring"."""
    for row in rows.strip().split("\n"):
        name, doc = row.split(": ", 1)
        function = vars(configuration)[name]

        def method(self: LieGroup, *arguments: Any, _function: Any = function, **named: Any) -> Any:
            return _function(self._model, *arguments, **named)

        method.__name__, method.__doc__ = name, doc
        yield method


class LieGroup(Registered):
    """A Lie group; ``G * H`` is their product. ``LieGroup()`` is the group of one element.

    name     such as "R^3 x SO(3)"
    nq, nv   number of coordinates, and of tangent directions
    neutral  its neutral element (nq,)
    """

    __slots__ = ("_parts", "_whole")

    def __init__(self, parts: Sequence[str] = (), model: Model | None = None) -> None:
        self._parts = tuple(parts)
        self._whole = model

    @property
    def _model(self) -> Model:
        return _chain(self._parts) if self._whole is None else self._whole

    name = property(lambda self: " x ".join(self._parts), doc="The names of the factors.")
    nq = property(lambda self: int(self._model.nq), doc="Number of coordinates.")
    nv = property(lambda self: int(self._model.nv), doc="Number of tangent directions.")
    (
        _neutral, integrate, difference, interpolate, randomConfiguration, dIntegrate, dIntegrateTransport, tangentMap,
        tangentMapProduct, tangentMapTransposeProduct,
    ) = _forwarded("""
neutral: The neutral element (nq,).
integrate: The element (nq,) reached from q (nq,) by v (nv,).
difference: The v (nv,) with integrate(q0, v) = q1.
interpolate: ``(q0, q1, u)``: the element (nq,) at the fraction u of the way from q0 to q1.
randomConfiguration: ``(lower, upper)``: a random element (nq,), positions between the bounds (nq,), rotations uniform.
dIntegrate: ``(q, v, position)``: derivative (nv, nv) of integrate by q (ARG0) or v (ARG1).
dIntegrateTransport: ``(q, v, J, position)``: derivative of integrate by q (ARG0) or v (ARG1), times J (nv, n).
tangentMap: ``(q)``: the matrix T (nq, nv) from velocities to coordinate rates: q̇ = T v.
tangentMapProduct: ``(q, mat)``: T times a matrix (nv, n).
tangentMapTransposeProduct: ``(q, mat)``: Tᵀ times a matrix (nq, n).
""")  # fmt: skip
    neutral = property(_neutral)

    def __mul__(self, other: Any) -> LieGroup:
        return LieGroup(self._parts + other._parts) if isinstance(other, LieGroup) else NotImplemented

    __imul__ = __mul__

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LieGroup) and self._parts == other._parts

    __hash__ = object.__hash__

    def __repr__(self) -> str:
        return f"LieGroup({self.name})"

    # --- elements ------------------------------------------------------------------------------------------

    def squaredDistance(self, q0: Any, q1: Any) -> float:
        """The square of the norm of the difference."""
        v = self.difference(q0, q1)
        return float(v @ v)

    def distance(self, q0: Any, q1: Any) -> float:
        """The norm of the difference."""
        return float(np.sqrt(self.squaredDistance(q0, q1)))

    def normalize(self, q: Array) -> None:
        """Normalize the quaternions and (cos, sin) pairs of q (nq,), in place."""
        q[...] = np.reshape(configuration.normalize(self._model, q), q.shape)

    def random(self) -> Array:
        """A random element (nq,): positions within ±1, rotations uniform."""
        bound = np.ones(self.nq)
        return configuration.randomConfiguration(self._model, -bound, bound)

    def dIntegrate_dq(self, q: Any, v: Any, *product: Any) -> Array:
        """The derivative D (nv, nv) of integrate by q; ``(q, v, J, self)`` gives J D, ``(q, v, self, J)`` D J."""
        return _product(self.dIntegrate(q, v, ARG0), product)

    def dIntegrate_dv(self, q: Any, v: Any, *product: Any) -> Array:
        """The derivative D (nv, nv) of integrate by v; ``(q, v, J, self)`` gives J D, ``(q, v, self, J)`` D J."""
        return _product(self.dIntegrate(q, v, ARG1), product)

    def dDifference(self, q0: Any, q1: Any, argument_position: ArgumentPosition, *product: Any) -> Array:
        """The derivative D (nv, nv) of difference by q0 (ARG0) or q1 (ARG1).

        ``(q0, q1, position, J, self)`` gives J D, ``(q0, q1, position, self, J)`` D J.
        """
        return _product(configuration.dDifference(self._model, q0, q1, argument_position), product)


def _product(D: Array, product: tuple[Any, ...]) -> Array:
    """D alone, J D for (J, number), D J for (number, J)."""
    if not product:
        return D
    place = [isinstance(x, np.ndarray) for x in product]
    if len(place) != 2 or not any(place):
        given = ", ".join(described(x) for x in product)
        raise ArgumentError(f"got {given}, expected a matrix and a number, or a number and a matrix")
    J, before = product[0 if place[0] else 1], place[0]
    if J.ndim not in (1, 2) or J.shape[-1 if before else 0] != len(D):
        raise ShapeError(f"matrix has shape {J.shape}, expected {len(D)} {'columns' if before else 'rows'}")
    J = np.asarray(J, dtype=float)
    return np.asarray(J @ D if before else D @ J)


def _group(name: str, what: str) -> Callable[[], LieGroup]:
    def make() -> LieGroup:
        return LieGroup([name])

    make.__doc__ = f"{what}."
    return make


R1, R2, R3 = _group("R^1", "The real numbers"), _group("R^2", "The plane"), _group("R^3", "Space")
SO2 = _group("SO(2)", "Rotations of the plane, as cos and sin")
SO3 = _group("SO(3)", "Rotations of space, as quaternions x y z w")
SE2 = _group("SE(2)", "Displacements of the plane, as x y cos sin")
SE3 = _group("SE(3)", "Displacements of space, as x y z and quaternion x y z w")


def Rn(n: int) -> LieGroup:
    """Vectors of n numbers."""
    return LieGroup([f"R^{int(n)}"])


# --- of models -------------------------------------------------------------------------------------------


def lieGroup(model: Model) -> LieGroup:
    """The configuration space of a model, the product of its joints' groups."""
    return LieGroup([part for joint in expected(model, Model, "model").joints[1:] for part in joint.groups()], model)


def getTangentToConfigurationSparsitySegment(model: Model) -> tuple[StdVec_Index, StdVec_Index]:
    """For each coordinate, the number of velocities of its joint and the index of the first."""
    joints = expected(model, Model, "model").joints[1:]
    starts, widths = StdVec_Index([0] * model.nq), StdVec_Index([0] * model.nq)
    for joint in joints:
        for k in range(joint.idx_q, joint.idx_q + joint.nq):
            starts[k], widths[k] = joint.idx_v, joint.nv
    return widths, starts


def findCommonAncestor(model: Model, joint1_id: int, joint2_id: int) -> tuple[int, int, int]:
    """The last joint that carries both joints, and its indices in ``supports`` of the first and the second."""
    first, second = (list(expected(model, Model, "model").supports[k]) for k in (joint1_id, joint2_id))
    shared = sum(a == b for a, b in zip(first, second, strict=False)) - 1
    return int(first[shared]), shared, shared
