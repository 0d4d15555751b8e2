"""Symmetric3: a symmetric 3 x 3 matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arguments import ArgumentError, ValueRuntimeError, array, described, expected, near, number, row
from .random import uniform
from .rotations import skew
from .tracked_array import Value

__all__ = ["Symmetric3"]

Array = NDArray[np.float64]
PLACES = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])  # of the matrix entries in the six numbers
ONE = (1.0, 0.0, 1.0, 0.0, 0.0, 1.0)


def six(M: Array) -> Array:
    """The numbers xx xy yy xz yz zz of a symmetric matrix (3, 3): its lower triangle row by row."""
    return np.array([M[0, 0], M[1, 0], M[1, 1], M[2, 0], M[2, 1], M[2, 2]])


class Symmetric3(Value):
    """A symmetric matrix: ``Symmetric3(matrix (3, 3))``, whose lower triangle is read, ``Symmetric3(data (6,))`` or
    ``Symmetric3(xx, xy, yy, xz, yz, zz)``. ``Symmetric3()`` is zero.
    """

    __slots__ = ()

    def __init__(self, *arguments: Any) -> None:
        self._x = np.zeros(6)
        if len(arguments) == 6:
            self._x[:] = [number(x, "entry") for x in arguments]
        elif len(arguments) == 1:
            self._x[:] = self._made(arguments[0])
        elif arguments:
            raise ArgumentError(f"Symmetric3 got {len(arguments)} arguments, expected 0, 1 or 6")

    @staticmethod
    def _made(given: Any) -> Array:
        if isinstance(given, Symmetric3):
            return given._x
        if isinstance(given, np.ndarray) and given.shape in ((6,), (6, 1)):
            return array(given, (6,), "data")
        if isinstance(given, np.ndarray) and given.ndim == 1:
            raise ValueRuntimeError(f"data is {described(given)}, expected shape (6,)")
        return six(array(given, (3, 3), "matrix"))

    @classmethod
    def Zero(cls) -> Symmetric3:
        """Zero."""
        return Symmetric3()

    @classmethod
    def Identity(cls) -> Symmetric3:
        """The identity."""
        return Symmetric3(*ONE)

    @classmethod
    def Random(cls) -> Symmetric3:
        """Six random numbers in ±1."""
        return Symmetric3(uniform(6))

    @property
    def data(self) -> Array:
        """The numbers xx xy yy xz yz zz (6,), a copy."""
        return self._x.copy()

    @data.setter
    def data(self, value: Any) -> None:
        self._write(array(value, (6,), "data"))

    def matrix(self) -> Array:
        """The matrix (3, 3)."""
        made: Array = self._x[PLACES]
        return made

    # --- sums and products ---------------------------------------------------------------------------------

    def _other(self, other: Any) -> Any:
        if isinstance(other, Symmetric3):
            return other._x
        if isinstance(other, np.ndarray) and other.shape == (3, 3):
            return six(array(other, (3, 3), "matrix"))
        return None

    def __add__(self, other: Any) -> Any:
        x = self._other(other)
        return NotImplemented if x is None else Symmetric3.over(self._x + x)

    def __sub__(self, other: Any) -> Any:
        x = self._other(other)
        return NotImplemented if x is None else Symmetric3.over(self._x - x)

    def __iadd__(self, other: Any) -> Any:
        x = self._other(other)
        if x is None:
            return NotImplemented
        self._write(self._x + x)
        return self

    def __isub__(self, other: Any) -> Any:
        x = self._other(other)
        if x is None:
            return NotImplemented
        self._write(self._x - x)
        return self

    def __imul__(self, scale: Any) -> Any:
        if not isinstance(scale, (int, float)):
            return NotImplemented
        self._write(self._x * scale)
        return self

    def __mul__(self, vector: Any) -> Any:
        if isinstance(vector, np.ndarray) and vector.shape in ((3,), (3, 1)):
            return self.matrix() @ array(vector, (3,), "vector")
        return NotImplemented

    @staticmethod
    def rhsMult(S3: Symmetric3, vin: Any, vout: Array) -> None:
        """S v, written in place to vout (3,)."""
        vout[...] = np.reshape(S3 * array(vin, (3,), "vin"), vout.shape)

    def vtiv(self, v: Any) -> float:
        """vᵀ S v of a vector (3,)."""
        v = array(v, (3,), "v")
        return float(v @ (self * v))

    @staticmethod
    def vxs(v: Any, S3: Symmetric3) -> Array:
        """The matrix (3, 3) of v × S ·."""
        matrix: Array = expected(S3, Symmetric3, "S3").matrix()
        return skew(v) @ matrix

    @staticmethod
    def svx(v: Any, S3: Symmetric3) -> Array:
        """The matrix (3, 3) of S v × ·."""
        matrix: Array = expected(S3, Symmetric3, "S3").matrix()
        return matrix @ skew(v)

    def rotate(self, R: Any) -> Symmetric3:
        """R S Rᵀ for a rotation (3, 3)."""
        R = array(R, (3, 3), "R")
        return Symmetric3.over(six(R @ self.matrix() @ R.T))

    def inverse(self, res: Array) -> None:
        """The inverse matrix, written in place to res (3, 3)."""
        res[...] = np.linalg.inv(self.matrix())

    def decomposeltI(self) -> Any:
        """Not offered; ``numpy.linalg.cholesky(S.matrix())`` is a factor."""
        raise NotImplementedError("Symmetric3.decomposeltI is not offered; use numpy.linalg.cholesky(S.matrix())")

    # --- the whole -----------------------------------------------------------------------------------------

    def setZero(self) -> None:
        """Set it to zero."""
        self._write(0.0)

    def setIdentity(self) -> None:
        """Set it to the identity."""
        self._write(ONE)

    def setRandom(self) -> None:
        """Set it to six random numbers in ±1."""
        self._write(uniform(6))

    def setDiagonal(self, diag: Any) -> None:
        """Set the diagonal (3,)."""
        self._x[[0, 2, 5]] = array(diag, (3,), "diag")
        self.changed()

    def fill(self, value: float) -> None:
        """Set all entries to one number."""
        self._write(number(value, "value"))

    def isApprox(self, other: Symmetric3, prec: float = 1e-12) -> bool:
        """Whether the six numbers agree to prec of their norms."""
        return near(self._x, expected(other, Symmetric3, "other")._x, prec)

    def isZero(self, prec: float = 1e-12) -> bool:
        """Whether no entry exceeds prec."""
        return bool((abs(self._x) <= prec).all())

    def __getinitargs__(self) -> tuple[Array]:
        return (self._x.copy(),)

    def __repr__(self) -> str:
        return f"m_data: {row(self._x)}\n"
