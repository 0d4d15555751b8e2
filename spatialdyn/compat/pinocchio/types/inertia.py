"""Inertia: a rigid body as mass, centre of mass and rotational inertia about it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....errors import InertiaError
from ...native import operators
from ..coverage.strictness import strict
from .arguments import (
    OMITTED,
    ArgumentError,
    Array,
    ValueRuntimeError,
    array,
    described,
    expected,
    number,
    of_pinocchio,
    only,
    row,
    rows,
)
from .motion import Motion
from .pseudo_inertia import LogCholeskyParameters, PseudoInertia, ten
from .random import GENERATOR
from .rotations import skew, skewSquare
from .se3 import SE3
from .symmetric import six
from .value import IN_PLACE, InFrames, Summable, as_array, on_values, part, preset

__all__ = ["Inertia"]

WANTED = "mass, lever and inertia, or an Inertia"
UNIT = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0])

_rotational = on_values("rotational", operators.rotational_inertia, "rot", I="Body")
_body_of = on_values("body_of", operators.body_of, "body", mass="number", lever="vec", inertia="rot")
_fault = on_values("fault", operators.fault_of_inertia, "number", inertia="rot")
_of_parameters = on_values("FromDynamicParameters", operators.body_of_parameters, "Body", dynamic_parameters="body")


def _numbers(**given: Any) -> list[float]:
    """The numbers themselves. Raises ArgumentError naming what is none."""
    return [number(x, name) for name, x in given.items()]


class Inertia(Summable, InFrames, kind="Body", near=operators.near_bodies):
    """A rigid body: ``Inertia(mass [kg], lever (3,) [m], inertia (3, 3) [kg m²])``, lever the centre of mass and
    inertia the rotational inertia about it; ``Inertia(other)``, also of Pinocchio's own class.

    ``I + J`` is both bodies as one, ``I * v`` the momentum of a Motion, a Force. ``lever`` is a writable view,
    ``inertia`` a copy. ``Inertia()`` is zero.
    """

    _arguments = ("mass", "lever", "inertia")

    def __init__(
        self, mass: Any = OMITTED, lever: Any = OMITTED, inertia: Any = OMITTED, *, clone: Any = OMITTED
    ) -> None:
        if mass is not OMITTED and lever is not OMITTED and inertia is not OMITTED:
            self._x = _body_of(mass, lever, inertia)
            if _fault(inertia):
                _refuse(inertia)
            return
        other = only((mass, lever, inertia, clone), "Inertia", WANTED)
        if other is OMITTED:
            self._x = np.zeros(10)
        elif isinstance(other, Inertia):
            self._x = other._x.copy()
        elif of_pinocchio(other, "Inertia"):
            self._x = np.array([other.mass, *other.lever, *six(other.inertia)])  # as it is, as from an Inertia
        else:
            raise ArgumentError(f"Inertia got {described(other)}, expected {WANTED}")

    Zero, setZero = preset(lambda: np.zeros(10), "zero: mass, lever and inertia")
    Identity, setIdentity = preset(lambda: UNIT, "mass 1 at the origin, with rotational inertia 1")
    Random, setRandom = preset(
        lambda: (SE3.Random() * Inertia.FromBox(1.0 + GENERATOR.random(), *(0.1 + 1.9 * GENERATOR.random(3))))._x,
        "a random physical body: a box of 1 to 2 kg and up to 2 m a side, centred within ±1 m, in any orientation",
    )

    # --- shapes of even density ------------------------------------------------------------------------------

    @staticmethod
    def _at_centre(mass: float, xx: float, yy: float, zz: float) -> Inertia:
        return Inertia.over(np.array([mass, 0.0, 0.0, 0.0, xx, 0.0, yy, 0.0, 0.0, zz]))

    @staticmethod
    def FromSphere(mass: float, radius: float) -> Inertia:
        """A ball about the origin."""
        radius = number(radius, "radius")
        return Inertia.FromEllipsoid(mass, radius, radius, radius)

    @staticmethod
    def FromEllipsoid(mass: float, length_x: float, length_y: float, length_z: float) -> Inertia:
        """An ellipsoid about the origin, by its half axes."""
        mass, *lengths = _numbers(mass=mass, length_x=length_x, length_y=length_y, length_z=length_z)
        xx, yy, zz = (0.2 * mass * length * length for length in lengths)
        return Inertia._at_centre(mass, yy + zz, xx + zz, xx + yy)

    @staticmethod
    def FromBox(mass: float, length_x: float, length_y: float, length_z: float) -> Inertia:
        """A box about the origin, by its sides."""
        mass, *lengths = _numbers(mass=mass, length_x=length_x, length_y=length_y, length_z=length_z)
        xx, yy, zz = (mass * length * length / 12.0 for length in lengths)
        return Inertia._at_centre(mass, yy + zz, xx + zz, xx + yy)

    @staticmethod
    def FromCylinder(mass: float, radius: float, length: float) -> Inertia:
        """A cylinder along z about the origin."""
        mass, radius, length = _numbers(mass=mass, radius=radius, length=length)
        across = mass * (3.0 * radius * radius + length * length) / 12.0
        return Inertia._at_centre(mass, across, across, 0.5 * mass * radius * radius)

    @staticmethod
    def FromCapsule(mass: float, radius: float, height: float) -> Inertia:
        """A cylinder of that height along z about the origin, with half a ball at each end."""
        mass, radius, height = _numbers(mass=mass, radius=radius, height=height)
        r2 = radius * radius
        tube = mass * height / (height + 4.0 / 3.0 * radius)
        ends = mass - tube  # both half balls
        across = tube * (height * height / 12.0 + 0.25 * r2)
        across += ends * (0.4 * r2 + 0.25 * height * height + 0.375 * height * radius)
        return Inertia._at_centre(mass, across, across, r2 * (0.5 * tube + 0.4 * ends))

    # --- parts ---------------------------------------------------------------------------------------------

    mass = part("mass", 0, "The mass [kg].")
    lever = part("lever", np.s_[1:4], "The centre of mass (3,) [m], a view.")

    @property
    def inertia(self) -> Array:
        """The rotational inertia about the centre of mass (3, 3) [kg m²], a copy.

        Any symmetric matrix can be set, in strict mode only one that a body can have.
        """
        return _rotational(self)  # type: ignore[no-any-return]

    @inertia.setter
    def inertia(self, value: Any) -> None:
        value = array(value, (3, 3), "inertia")
        if _fault(value) > (0.0 if strict() else operators.NEGATIVE):
            _refuse(value)
        self._x[4:] = six(value)

    # --- sums and products ---------------------------------------------------------------------------------

    __add__ = on_values("__add__", operators.add_bodies, "Body", self="Body", other="Body")
    __sub__ = on_values("__sub__", operators.without, "Body", self="Body", other="Body")
    __iadd__ = on_values("add", operators.add_bodies, "truth", form=IN_PLACE, self="Body", other="Body")
    __isub__ = on_values("sub", operators.without, "truth", form=IN_PLACE, self="Body", other="Body")
    __mul__ = on_values("__mul__", operators.body_momentum, "Force", self="Body", v="Motion")
    _to_parent = on_values("act", operators.body_to_parent, "Body", self="Pose", I="Body")
    _to_child = on_values("actInv", operators.body_to_child, "Body", self="Pose", I="Body")
    vxiv = on_values("vxiv", operators.bias_force,
        "Force", "v ×* I v: the bias force of a body.", self="Body", v="Motion")  # fmt: skip
    vtiv = on_values("vtiv", operators.twice_the_energy, "number",
        "vᵀ I v: twice the kinetic energy [J].", self="Body", v="Motion")  # fmt: skip
    matrix = on_values("matrix", operators.inertia_about_origin, "inertia",
        "The matrix (6, 6) that maps motions to momenta, about the origin.", self="Body")  # fmt: skip
    np = property(matrix)
    __array__ = as_array(matrix)

    def vxi(self, v: Motion) -> Array:
        """The matrix (6, 6) of v ×* I ·."""
        return expected(v, Motion, "v").dualAction @ self.matrix()  # type: ignore[no-any-return]

    def ivx(self, v: Motion) -> Array:
        """The matrix (6, 6) of I v × ·."""
        return self.matrix() @ expected(v, Motion, "v").action  # type: ignore[no-any-return]

    def variation(self, v: Motion) -> Array:
        """Rate of change (6, 6) of the matrix of a body that moves with v."""
        return self.vxi(v) - self.ivx(v)

    # --- other forms ---------------------------------------------------------------------------------------

    def inverse(self) -> Array:
        """The inverse (6, 6) of the matrix. Raises InertiaError if there is none."""
        try:
            c, J = skew(self._x[1:4]), np.linalg.inv(self.inertia)
        except np.linalg.LinAlgError:
            raise InertiaError("inertia is singular, expected one that can be inverted") from None
        if self.mass == 0.0:
            raise InertiaError("mass is 0, expected a body that can be moved")
        out = np.empty((6, 6))
        out[:3, :3] = np.eye(3) / self.mass - c @ J @ c
        out[:3, 3:] = c @ J
        out[3:, :3] = out[:3, 3:].T
        out[3:, 3:] = J
        return out

    def toDynamicParameters(self) -> Array:
        """m, m c, and the rotational inertia about the origin xx xy yy xz yz zz: (10,)."""
        m, c, J = self._x[:1], self._x[1:4], self._x[4:]
        return np.concatenate([m, m * c, J - m * six(skewSquare(c, c))])

    @staticmethod
    def FromDynamicParameters(dynamic_parameters: Any) -> Inertia:
        """The body of ten parameters as ``toDynamicParameters`` gives them. Raises InertiaError for zero mass."""
        try:
            made: Inertia = _of_parameters(dynamic_parameters)
        except ArgumentError:
            made = _of_parameters(ten(dynamic_parameters))  # raises what it lacks
        if not made._x.item(0):
            raise InertiaError("mass is 0, expected one that has a centre")
        return made

    def toPseudoInertia(self) -> PseudoInertia:
        """As a PseudoInertia."""
        return PseudoInertia.FromDynamicParameters(self.toDynamicParameters())

    @staticmethod
    def FromPseudoInertia(pseudo_inertia: PseudoInertia) -> Inertia:
        """The body of a PseudoInertia."""
        return expected(pseudo_inertia, PseudoInertia, "pseudo_inertia").toInertia()  # type: ignore[no-any-return]

    @staticmethod
    def FromLogCholeskyParameters(log_cholesky_parameters: LogCholeskyParameters) -> Inertia:
        """The body of LogCholeskyParameters."""
        return expected(log_cholesky_parameters, LogCholeskyParameters, "parameters").toInertia()  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        return f"  m = {self.mass:g}\n  c = {row(self._x[1:4])}\n  I = \n{rows(self.inertia)}"


def _refuse(inertia: Any) -> None:
    """Raise ValueRuntimeError for a matrix that is not symmetric, or has negative eigenvalues."""
    J = array(inertia, (3, 3), "inertia")
    if _fault(J) == operators.ASYMMETRIC:
        raise ValueRuntimeError(f"inertia is {J.tolist()}, expected a finite symmetric matrix")
    raise ValueRuntimeError(f"inertia has the eigenvalues {np.linalg.eigvalsh(J)}, expected none below 0")
