"""Inertia: a rigid body as mass, centre of mass and rotational inertia about it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InertiaError
from ...native import operator_kernels
from .arguments import ArgumentError, ValueRuntimeError, array, described, expected, near, number, row, rows
from .motion import Force, Motion
from .pseudo_inertia import LogCholeskyParameters, PseudoInertia, body_of, parameters_of
from .random import GENERATOR
from .rotations import skew
from .se3 import SE3
from .symmetric import PLACES
from .tracked_array import Value

__all__ = ["Inertia"]

Array = NDArray[np.float64]
UNIT = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0])

_empty = np.empty
_add, _sub, _momentum = operator_kernels.add_body, operator_kernels.sub_body, operator_kernels.momentum
_up, _down, _body = operator_kernels.body_to_parent, operator_kernels.body_to_child, operator_kernels.write_body


class Inertia(Value):
    """A rigid body: ``Inertia(mass [kg], lever (3,) [m], inertia (3, 3) [kg m²])``, lever the centre of mass and
    inertia the rotational inertia about it; ``Inertia(other)``.

    ``I + J`` is both bodies as one, ``I * v`` the momentum of a Motion, a Force. ``lever`` is a writable view,
    ``inertia`` a copy. ``Inertia()`` is zero.
    """

    __slots__ = ()

    def __init__(self, mass: Any = None, lever: Any = None, inertia: Any = None, *, clone: Any = None) -> None:
        if lever is not None and inertia is not None:
            self._x = x = _empty(10)
            try:
                status = _body()(x, mass, lever, inertia)
            except TypeError:  # not arrays of float64: check and convert below
                status = operator_kernels.SIZE
            if status:
                x[:] = _checked(number(mass, "mass"), array(lever, (3,), "lever"), array(inertia, (3, 3), "inertia"))
            return
        mass = clone if mass is None else mass
        if mass is None:
            self._x = np.zeros(10)
        elif isinstance(mass, Inertia) and lever is None:
            self._x = mass._x.copy()
        else:
            raise ArgumentError(f"Inertia got {described(mass)}, expected mass, lever and inertia, or an Inertia")

    @classmethod
    def Zero(cls) -> Inertia:
        """Zero: mass, lever and inertia."""
        return Inertia.over(np.zeros(10))

    @classmethod
    def Identity(cls) -> Inertia:
        """Mass 1 at the origin, with rotational inertia 1."""
        return Inertia.over(UNIT.copy())

    @classmethod
    def Random(cls) -> Inertia:
        """A random physical body: a box of 1 to 2 kg and up to 2 m a side, centred within ±1 m, in any orientation."""
        made = Inertia.FromBox(1.0 + GENERATOR.random(), *(0.1 + 1.9 * GENERATOR.random(3)))
        return made._to_parent(SE3.Random()._x)

    # --- shapes of even density ------------------------------------------------------------------------------

    @staticmethod
    def _at_centre(mass: float, xx: float, yy: float, zz: float) -> Inertia:
        return Inertia.over(np.array([mass, 0.0, 0.0, 0.0, xx, 0.0, yy, 0.0, 0.0, zz]))

    @staticmethod
    def FromSphere(mass: float, radius: float) -> Inertia:
        """A ball about the origin."""
        return Inertia.FromEllipsoid(mass, radius, radius, radius)

    @staticmethod
    def FromEllipsoid(mass: float, length_x: float, length_y: float, length_z: float) -> Inertia:
        """An ellipsoid about the origin, by its half axes."""
        xx, yy, zz = (0.2 * mass * length * length for length in (length_x, length_y, length_z))
        return Inertia._at_centre(mass, yy + zz, xx + zz, xx + yy)

    @staticmethod
    def FromBox(mass: float, length_x: float, length_y: float, length_z: float) -> Inertia:
        """A box about the origin, by its sides."""
        xx, yy, zz = (mass * length * length / 12.0 for length in (length_x, length_y, length_z))
        return Inertia._at_centre(mass, yy + zz, xx + zz, xx + yy)

    @staticmethod
    def FromCylinder(mass: float, radius: float, length: float) -> Inertia:
        """A cylinder along z about the origin."""
        across = mass * (3.0 * radius * radius + length * length) / 12.0
        return Inertia._at_centre(mass, across, across, 0.5 * mass * radius * radius)

    @staticmethod
    def FromCapsule(mass: float, radius: float, height: float) -> Inertia:
        """A cylinder of that height along z about the origin, with half a ball at each end."""
        r2 = radius * radius
        tube = mass * height / (height + 4.0 / 3.0 * radius)
        ends = mass - tube  # both half balls
        across = tube * (height * height / 12.0 + 0.25 * r2)
        across += ends * (0.4 * r2 + 0.25 * height * height + 0.375 * height * radius)
        return Inertia._at_centre(mass, across, across, r2 * (0.5 * tube + 0.4 * ends))

    # --- parts ---------------------------------------------------------------------------------------------

    @property
    def mass(self) -> float:
        """The mass [kg]."""
        return float(self._x[0])

    @mass.setter
    def mass(self, value: float) -> None:
        self._x[0] = number(value, "mass")
        self.changed()

    @property
    def lever(self) -> Array:
        """The centre of mass (3,) [m], a view."""
        return self._view(self._x[1:4])

    @lever.setter
    def lever(self, value: Any) -> None:
        self._x[1:4] = array(value, (3,), "lever")
        self.changed()

    @property
    def inertia(self) -> Array:
        """The rotational inertia about the centre of mass (3, 3) [kg m²], a copy."""
        made: Array = self._x[4:][PLACES]
        return made

    @inertia.setter
    def inertia(self, value: Any) -> None:
        self._x[4:] = _checked(0.0, np.zeros(3), array(value, (3, 3), "inertia"))[4:]
        self.changed()

    # --- sums and products ---------------------------------------------------------------------------------

    def __add__(self, other: Any) -> Any:
        if type(other) is not Inertia:
            return NotImplemented
        made = _new(Inertia)
        made._x = out = _empty(10)
        _add(self._x, other._x, out)
        return made

    def __sub__(self, other: Any) -> Any:
        if type(other) is not Inertia:
            return NotImplemented
        made = _new(Inertia)
        made._x = out = _empty(10)
        _sub(self._x, other._x, out)
        return made

    def __iadd__(self, other: Any) -> Any:
        if not isinstance(other, Inertia):
            return NotImplemented
        _add(self._x, other._x, self._x)
        self.changed()
        return self

    def __isub__(self, other: Any) -> Any:
        if not isinstance(other, Inertia):
            return NotImplemented
        _sub(self._x, other._x, self._x)
        self.changed()
        return self

    def __mul__(self, v: Any) -> Any:
        if type(v) is not Motion:
            return NotImplemented
        made = Force.__new__(Force)
        made._x = out = _empty(6)
        _momentum(self._x, v._x, out)
        return made

    def vxiv(self, v: Motion) -> Force:
        """v ×* I v: the bias force of a body."""
        out = _empty(6)
        operator_kernels.bias_force(self._x, expected(v, Motion, "v")._x, out)
        return Force.over(out)

    def vtiv(self, v: Motion) -> float:
        """vᵀ I v: twice the kinetic energy [J]."""
        return operator_kernels.twice_kinetic_energy(self._x, expected(v, Motion, "v")._x)  # type: ignore[no-any-return]

    def vxi(self, v: Motion) -> Array:
        """The matrix (6, 6) of v ×* I ·."""
        return expected(v, Motion, "v").dualAction @ self.matrix()  # type: ignore[no-any-return]

    def ivx(self, v: Motion) -> Array:
        """The matrix (6, 6) of I v × ·."""
        return self.matrix() @ expected(v, Motion, "v").action  # type: ignore[no-any-return]

    def variation(self, v: Motion) -> Array:
        """Rate of change (6, 6) of the matrix of a body that moves with v."""
        return self.vxi(v) - self.ivx(v)

    # --- frames --------------------------------------------------------------------------------------------

    def _to_parent(self, x: Array) -> Inertia:
        made = _new(Inertia)
        made._x = out = _empty(10)
        _up(x, self._x, out)
        return made

    def _to_child(self, x: Array) -> Inertia:
        made = _new(Inertia)
        made._x = out = _empty(10)
        _down(x, self._x, out)
        return made

    def se3Action(self, M: SE3) -> Inertia:
        """The inertia from the frame M in M's reference frame: ``M.act(self)``."""
        return self._to_parent(expected(M, SE3, "M")._x)

    def se3ActionInverse(self, M: SE3) -> Inertia:
        """The inertia from M's reference frame in the frame M: ``M.actInv(self)``."""
        return self._to_child(expected(M, SE3, "M")._x)

    # --- other forms ---------------------------------------------------------------------------------------

    def matrix(self) -> Array:
        """The matrix (6, 6) that maps motions to momenta, about the origin."""
        out = _empty((6, 6))
        operator_kernels.body_matrix(self._x, out)
        return out

    @property
    def np(self) -> Array:
        """As ``matrix()``."""
        return self.matrix()

    def __array__(self, dtype: Any = None, copy: Any = None) -> Array:
        return self.matrix() if dtype is None else self.matrix().astype(dtype)

    def inverse(self) -> Array:
        """The inverse (6, 6) of the matrix. Raises InertiaError if there is none."""
        try:
            c, J = skew(self._x[1:4]), np.linalg.inv(self.inertia)
        except np.linalg.LinAlgError:
            raise InertiaError("inertia is singular, expected one that can be inverted") from None
        if self.mass == 0.0:
            raise InertiaError("mass is 0, expected a body that can be moved")
        out = _empty((6, 6))
        out[:3, :3] = np.eye(3) / self.mass - c @ J @ c
        out[:3, 3:] = c @ J
        out[3:, :3] = out[:3, 3:].T
        out[3:, 3:] = J
        return out

    def toDynamicParameters(self) -> Array:
        """m, m c, and the rotational inertia about the origin xx xy yy xz yz zz: (10,)."""
        return parameters_of(self._x)

    @staticmethod
    def FromDynamicParameters(params: Any) -> Inertia:
        """The body of ten parameters as ``toDynamicParameters`` gives them."""
        return Inertia.over(body_of(params))

    def toPseudoInertia(self) -> PseudoInertia:
        """As a PseudoInertia."""
        return PseudoInertia.FromDynamicParameters(self.toDynamicParameters())

    @staticmethod
    def FromPseudoInertia(pseudo_inertia: PseudoInertia) -> Inertia:
        """The body of a PseudoInertia."""
        return Inertia.FromDynamicParameters(
            expected(pseudo_inertia, PseudoInertia, "pseudo_inertia").toDynamicParameters()
        )

    @staticmethod
    def FromLogCholeskyParameters(log_cholesky: LogCholeskyParameters) -> Inertia:
        """The body of LogCholeskyParameters."""
        given = expected(log_cholesky, LogCholeskyParameters, "log_cholesky")
        return Inertia.FromDynamicParameters(given.toDynamicParameters())

    # --- the whole -----------------------------------------------------------------------------------------

    def setZero(self) -> None:
        """Set it to zero."""
        self._write(0.0)

    def setIdentity(self) -> None:
        """Set it to mass 1 at the origin with rotational inertia 1."""
        self._write(UNIT)

    def setRandom(self) -> None:
        """Set it to a random body; see ``Random``."""
        self._write(Inertia.Random()._x)

    def isApprox(self, other: Inertia, prec: float = 1e-12) -> bool:
        """Whether masses, levers and inertias each agree to prec of their norms."""
        a, b = self._x, expected(other, Inertia, "other")._x
        parts = ((a[:1], b[:1]), (a[1:4], b[1:4]), (a[4:], b[4:]))
        return all(near(x, y, prec) for x, y in parts)

    def isZero(self, prec: float = 1e-12) -> bool:
        """Whether no entry exceeds prec."""
        return bool((abs(self._x) <= prec).all())

    def __getinitargs__(self) -> tuple[float, Array, Array]:
        return self.mass, self._x[1:4].copy(), self.inertia

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._x.copy(),)

    def __repr__(self) -> str:
        return f"  m = {self.mass:g}\n  c = {row(self._x[1:4])}\n  I = \n{rows(self.inertia)}"


_new = Inertia.__new__
PseudoInertia._body = LogCholeskyParameters._body = Inertia


def _restored(x: Array) -> Inertia:
    return Inertia.over(x)


def _checked(mass: float, lever: Array, inertia: Array) -> Array:
    """The ten numbers of a body. Raises ValueRuntimeError for an inertia not symmetric or negative."""
    x = _empty(10)
    status = _body()(x, mass, lever, inertia)
    if status == operator_kernels.SYMMETRY:
        raise ValueRuntimeError(f"inertia is {inertia.tolist()}, expected a symmetric matrix")
    if status == operator_kernels.SIGN:
        raise ValueRuntimeError(f"inertia has the eigenvalues {np.linalg.eigvalsh(inertia)}, expected none below 0")
    return x
