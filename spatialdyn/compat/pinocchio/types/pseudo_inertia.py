"""Other parameters of a rigid body: ten dynamic parameters, the pseudo inertia, and its log-Cholesky factor."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....identification.pseudo_inertia import parameters_of, pseudo_inertia
from .arguments import ArgumentError, Array, array, described, row, rows
from .value import Value, as_array, part

__all__ = ["LogCholeskyParameters", "PseudoInertia"]


def ten(parameters: Any) -> Array:
    """A new array (10,) of dynamic or log-Cholesky parameters."""
    return array(parameters, (10,), "parameters")


class Parameters(Value):
    """Base of the forms of a rigid body that have ``toDynamicParameters``."""

    def toInertia(self) -> Any:
        """The Inertia of these parameters."""
        inertia: Any = Value._classes["Body"]
        return inertia.FromDynamicParameters(self.toDynamicParameters())  # type: ignore[attr-defined]


class PseudoInertia(Parameters):
    """The 4 x 4 matrix [Σ h; hᵀ m] of a body, Σ the integral of r rᵀ: ``PseudoInertia(mass, h (3,), sigma (3, 3))``.

    Source: Wensing, Kim and Slotine, Linear matrix inequalities for physically consistent inertial parameter
    identification (2018): a body is physical if and only if the matrix is positive definite.
    """

    _arguments = ("mass", "h", "sigma")

    def __init__(self, mass: Any, h: Any = None, sigma: Any = None) -> None:
        self._x = mass._x.copy() if isinstance(mass, PseudoInertia) else np.empty((4, 4))
        if not isinstance(mass, PseudoInertia):
            self.mass, self.h, self.sigma = mass, h, sigma

    mass = part("mass", (3, 3), "The mass [kg].")
    sigma = part("sigma", np.s_[:3, :3], "The second moment Σ (3, 3) [kg m²], a copy.", np.array)

    @property
    def h(self) -> Array:
        """m c (3,) [kg m]."""
        return self._x[:3, 3].copy()

    @h.setter
    def h(self, value: Any) -> None:
        self._x[:3, 3] = self._x[3, :3] = array(value, (3,), "h")

    @staticmethod
    def FromMatrix(pseudo_inertia_matrix: Any) -> PseudoInertia:
        """The PseudoInertia of a matrix (4, 4)."""
        return PseudoInertia.over(array(pseudo_inertia_matrix, (4, 4), "pseudo_inertia_matrix"))

    @staticmethod
    def FromDynamicParameters(dynamic_parameters: Any) -> PseudoInertia:
        """The PseudoInertia of ten dynamic parameters, as of ``Inertia.toDynamicParameters``."""
        return PseudoInertia.over(pseudo_inertia(ten(dynamic_parameters)))

    @staticmethod
    def FromInertia(inertia: Any) -> PseudoInertia:
        """The PseudoInertia of an Inertia."""
        if not hasattr(inertia, "toDynamicParameters"):
            raise ArgumentError(f"inertia is {described(inertia)}, expected Inertia")
        return PseudoInertia.FromDynamicParameters(inertia.toDynamicParameters())

    def toMatrix(self) -> Array:
        """The matrix (4, 4)."""
        return self._x.copy()

    __array__ = as_array(toMatrix)

    def toDynamicParameters(self) -> Array:
        """The ten dynamic parameters, as of ``Inertia.toDynamicParameters``."""
        return parameters_of(self._x)

    def __repr__(self) -> str:
        return f"  m = {self.mass:g}\n  h = {row(self.h)}\n  sigma = \n{rows(self.sigma)}"


class LogCholeskyParameters(Parameters):
    """Ten unconstrained numbers of a physical body: α, d₁, d₂, d₃, s₁₂, s₂₃, s₁₃, t₁, t₂, t₃.

    The pseudo inertia is e^2α U Uᵀ with U = [e^d₁ s₁₂ s₁₃ t₁; 0 e^d₂ s₂₃ t₂; 0 0 e^d₃ t₃; 0 0 0 1].
    Source: Rucker and Wensing, Smooth parameterization of rigid-body inertia (2022).
    """

    _arguments = ("parameters",)
    _names = ("alpha", "d1", "d2", "d3", "s12", "s23", "s13", "t1", "t2", "t3")

    def __init__(self, log_cholesky_parameters: Any) -> None:
        if isinstance(log_cholesky_parameters, LogCholeskyParameters):
            self._x = log_cholesky_parameters._x.copy()
        else:
            self._x = ten(log_cholesky_parameters)

    parameters = part("parameters", np.s_[:], "The ten numbers (10,), a copy.", np.array)
    __array__ = as_array(lambda self: self._x.copy())

    def _factor(self) -> tuple[float, Array, Array]:
        """e^2α, U, and the derivatives of U by the other nine."""
        alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3 = self._x.tolist()
        e1, e2, e3 = np.exp([d1, d2, d3]).tolist()
        U = np.array([[e1, s12, s13, t1], [0.0, e2, s23, t2], [0.0, 0.0, e3, t3], [0.0, 0.0, 0.0, 1.0]])
        turned = np.zeros((9, 4, 4))
        turned[range(9), [0, 1, 2, 0, 1, 0, 0, 1, 2], [0, 1, 2, 1, 2, 2, 3, 3, 3]] = [e1, e2, e3, *[1.0] * 6]
        return float(np.exp(2.0 * alpha)), U, turned

    def toPseudoInertia(self) -> PseudoInertia:
        """The PseudoInertia of these parameters."""
        scale, U, _ = self._factor()
        return PseudoInertia.over(scale * (U @ U.T))

    def toDynamicParameters(self) -> Array:
        """The ten dynamic parameters, as of ``Inertia.toDynamicParameters``."""
        return self.toPseudoInertia().toDynamicParameters()

    def calculateJacobian(self) -> Array:
        """Derivatives (10, 10) of the dynamic parameters by the ten numbers."""
        scale, U, turned = self._factor()
        columns = [2.0 * U @ U.T, *(D @ U.T + U @ D.T for D in turned)]
        return parameters_of(scale * np.array(columns)).T

    def __repr__(self) -> str:
        return "\n".join(f"  {name}: {x:g}" for name, x in zip(self._names, self._x, strict=True))
