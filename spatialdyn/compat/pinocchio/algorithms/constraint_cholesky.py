"""``ConstraintCholeskyDecomposition``: the factors of the system of contacts, under Pinocchio's names."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from ..data.data import Data, library_of
from ..model.model import Model
from ..types.arguments import Array
from ..types.bases import Registered
from .rigid_constraints import getConstraintsJacobian, pairs_of, system_of

__all__ = ["ConstraintCholeskyDecomposition", "ContactCholeskyDecomposition"]


def _found(doc: str, find: Callable[[Any], Any]) -> Any:
    """A method without arguments."""

    def method(self: Any) -> Any:
        return find(self)

    method.__doc__ = doc
    return method


def _inverse(x: Array) -> Array:
    return np.asarray(np.linalg.inv(x))


class ConstraintCholeskyDecomposition(Registered):
    """K = U D Uᵀ of K = [-mu 1, J; Jᵀ, M], U upper triangular with unit diagonal: ``(model, data, contact_models,
    contact_datas)``, then ``compute`` with the M of ``data``.
    """

    def __init__(self, model: Any = None, data: Any = None, contact_models: Any = (), contact_datas: Any = ()) -> None:
        self._J, self._M, self._mu = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
        if model is not None:
            self.rebuild(model, data, contact_models, contact_datas)

    @classmethod
    def of(cls, data: Data) -> ConstraintCholeskyDecomposition:
        """The factors of the last constraintDynamics of a Data; zero before it, and empty without contacts."""
        made = cls()
        if data.contacts is None:
            return made
        pairs, settings = data.contacts
        made.rebuild(data.model, data, [x for x, _ in pairs], [own for _, own in pairs])
        run, every = data._runs.get("contacts"), data._runs.get("all")
        if run is not None and every is not None:
            made._J, _ = system_of(every, pairs, False)
            made._M = every.library.compute("crba", every.q, at=every.state)
            made.updateDamping(settings.mu)
        return made

    jacobian = staticmethod(getConstraintsJacobian)

    def rebuild(self, model: Model, data: Data, contact_models: Any, contact_datas: Any) -> None:
        """Take the sizes of other contacts."""
        library_of(model, data)
        size = sum(x.residualSize() for x, _ in pairs_of([*contact_models], [*contact_datas]))
        self._J, self._M, self._mu = np.zeros((size, model.nv)), np.zeros((model.nv,) * 2), np.zeros(size)

    def compute(self, model: Model, data: Data, contact_models: Any, contact_datas: Any, mu: Any = 0.0) -> None:
        """Take J at the q of ``data.oMi`` and the M of ``data``; mu is a number or one for each row."""
        self._J = getConstraintsJacobian(model, data, contact_models, contact_datas)
        self._M = np.array(data.array("M"))
        self.updateDamping(mu)

    def updateDamping(self, mu: Any) -> None:
        """Set mu, a number or one for each row."""
        self._mu = np.zeros(len(self._J)) + np.asarray(mu, float)

    def _factors(self) -> tuple[Array, Array]:
        K = self.matrix()
        n = len(K)
        U, D = np.eye(n), np.zeros(n)
        for k in range(n - 1, -1, -1):
            D[k] = K[k, k]
            U[:k, k] = K[:k, k] / D[k]
            K[:k, :k] -= np.outer(U[:k, k], K[:k, k])
        return U, D

    def solve(self, matrix: Any) -> Array:
        """K⁻¹ x."""
        return np.asarray(np.linalg.solve(self.matrix(), np.asarray(matrix, float)))

    def getInverseOperationalSpaceInertiaMatrix(self, enforce_symmetry: bool = False) -> Array:
        """J M⁻¹ Jᵀ + mu 1."""
        G = self._J @ np.linalg.solve(self._M, self._J.T) + self.getDamping()
        return np.asarray(0.5 * (G + G.T))

    U = property(lambda self: self._factors()[0], doc="U.")
    D = property(lambda self: self._factors()[1], doc="D (size,).")
    Dinv = property(lambda self: 1.0 / self.D, doc="1 / D.")
    matrix = _found("K.", lambda self: np.block([[np.diag(-self._mu), self._J], [self._J.T, self._M]]))
    inverse = _found("K⁻¹.", lambda self: _inverse(self.matrix()))
    size = _found("Rows of K.", lambda self: len(self._J) + len(self._M))
    constraintDim = _found("Rows of J.", lambda self: len(self._J))
    getDamping = _found("mu as a diagonal matrix.", lambda self: np.diag(self._mu))
    getInverseMassMatrix = _found("M⁻¹.", lambda self: _inverse(self._M))
    getOperationalSpaceInertiaMatrix = _found(
        "(J M⁻¹ Jᵀ + mu 1)⁻¹.", lambda self: _inverse(self.getInverseOperationalSpaceInertiaMatrix())
    )
    copy = _found("An independent copy.", copy.deepcopy)


ContactCholeskyDecomposition = ConstraintCholeskyDecomposition
