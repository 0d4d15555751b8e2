"""Symmetric3: a symmetric 3 x 3 matrix."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..coverage.coverage import refused
from .arguments import ArgumentError, Array, array, expected, number, row
from .random import uniform
from .rotations import skew
from .value import Summable, part, preset

__all__ = ["Symmetric3"]

PLACES = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])  # of the matrix entries in the six numbers


def six(M: Array) -> Array:
    """The numbers xx xy yy xz yz zz of a symmetric matrix (3, 3): its lower triangle row by row."""
    return np.array([M[0, 0], M[1, 0], M[1, 1], M[2, 0], M[2, 1], M[2, 2]])


class Symmetric3(Summable):
    """A symmetric matrix: ``Symmetric3(matrix (3, 3))``, whose lower triangle is read, ``Symmetric3(data (6,))`` or
    ``Symmetric3(xx, xy, yy, xz, yz, zz)``. ``Symmetric3()`` is zero.
    """

    _arguments = ("_x",)

    def __init__(self, *arguments: Any) -> None:
        if len(arguments) == 6:
            self._x = np.array([number(x, "entry") for x in arguments])
        elif len(arguments) == 1:
            self._x = self._read(arguments[0])
        elif arguments:
            raise ArgumentError(f"Symmetric3 got {len(arguments)} arguments, expected 0, 1 or 6")
        else:
            self._x = np.zeros(6)

    @staticmethod
    def _read(x: Any) -> Array:
        if isinstance(x, Symmetric3):
            return x._x.copy()
        if isinstance(x, np.ndarray) and (x.ndim == 1 or x.shape == (6, 1)):
            return array(x, (6,), "data")
        return six(array(x, (3, 3), "matrix"))

    Zero, setZero = preset(lambda: np.zeros(6), "zero")
    Identity, setIdentity = preset(lambda: (1.0, 0.0, 1.0, 0.0, 0.0, 1.0), "the identity")
    Random, setRandom = preset(lambda: uniform(6), "six random numbers in ±1")

    data = part("data", np.s_[:], "The numbers xx xy yy xz yz zz (6,), a copy.", np.array)

    def matrix(self) -> Array:
        """The matrix (3, 3)."""
        made: Array = self._x[PLACES]
        return made

    def _plus(self, other: Any, sign: float) -> Any:
        if isinstance(other, np.ndarray) and other.shape == (3, 3):
            other = Symmetric3(other)
        return Symmetric3.over(self._x + sign * other._x) if isinstance(other, Symmetric3) else NotImplemented

    def __add__(self, other: Any) -> Any:
        return self._plus(other, 1.0)

    def __sub__(self, other: Any) -> Any:
        return self._plus(other, -1.0)

    def __imul__(self, scale: Any) -> Any:
        return self._write(self._x * scale) if isinstance(scale, (int, float)) else NotImplemented

    def __mul__(self, vector: Any) -> Any:
        if isinstance(vector, np.ndarray) and vector.shape in ((3,), (3, 1)):
            return self.matrix() @ array(vector, (3,), "vector")
        return NotImplemented

    @staticmethod
    def rhsMult(S3: Symmetric3, vin: Any, vout: Array) -> None:
        """S v, written in place to vout (3,)."""
        array(vout, (3,), "vout")  # raises what it is not
        vout[...] = np.reshape(S3 * array(vin, (3,), "vin"), vout.shape)

    def vtiv(self, v: Any) -> float:
        """vᵀ S v of a vector (3,)."""
        v = array(v, (3,), "v")
        return float(v @ (self * v))

    @staticmethod
    def vxs(v: Any, S3: Symmetric3) -> Any:
        """The matrix (3, 3) of v × S ·."""
        return skew(v) @ expected(S3, Symmetric3, "S3").matrix()

    @staticmethod
    def svx(v: Any, S3: Symmetric3) -> Any:
        """The matrix (3, 3) of S v × ·."""
        return expected(S3, Symmetric3, "S3").matrix() @ skew(v)

    def rotate(self, R: Any) -> Symmetric3:
        """R S Rᵀ for a rotation (3, 3)."""
        R = array(R, (3, 3), "R")
        return Symmetric3.over(six(R @ self.matrix() @ R.T))

    def inverse(self, res: Array) -> None:
        """The inverse matrix, written in place to res (3, 3)."""
        array(res, (3, 3), "res")  # raises what it is not
        res[...] = np.linalg.inv(self.matrix())

    decomposeltI = refused("Symmetric3.decomposeltI")

    def setDiagonal(self, diag: Any) -> None:
        """Set the diagonal (3,)."""
        self._x[[0, 2, 5]] = array(diag, (3,), "diag")

    def fill(self, value: float) -> None:
        """Set all entries to one number."""
        self._write(number(value, "value"))

    def __repr__(self) -> str:
        return f"m_data: {row(self._x)}\n"
