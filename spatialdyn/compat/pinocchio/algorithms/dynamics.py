"""Dynamics under Pinocchio's names: torques, accelerations, M, C, g, energies.

Every function takes the model, its data and arrays; results are new arrays and fields of the data.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ..data.data import Data, library_of
from ..data.dispatch import compute, compute_copy, fast_call
from ..data.last_call import Run
from ..model.model import Model
from ..types.arguments import ArgumentError, described
from ..types.frame import Convention

__all__ = [
    "aba", "computeAllTerms", "computeCoriolisMatrix", "computeGeneralizedGravity", "computeKineticEnergy",
    "computeMechanicalEnergy", "computeMinverse", "computePotentialEnergy", "computeStaticTorque", "crba",
    "getCoriolisMatrix", "nle", "nonLinearEffects", "rnea",
]  # fmt: skip

Array = NDArray[np.float64]


def _rnea(model: Model, data: Data, q: Any, v: Any, a: Any, fext: Any = None) -> Array:
    """Torques τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext (nv,), also ``data.tau``.

    q     (nq,)            joint positions
    v, a  (nv,)            joint velocities and accelerations
    fext  list of njoints  Force on each joint's body, in the joint's frame; the universe's is ignored

    Raises ArgumentError (a TypeError) for a wrong type, ShapeError (a ValueError) for a wrong size.
    """
    return compute_copy(model, data, "rnea", q, v, a, fext=fext)


def _aba(
    model: Model, data: Data, q: Any, v: Any, tau: Any, fext: Any = None, convention: Any = Convention.LOCAL
) -> Array:
    """Accelerations (nv,) under torques tau (nv,) and external forces, also ``data.ddq``.

    ``aba(model, data, q, v, tau[, fext][, convention])``, fext as in rnea. The convention only selects which fields of
    data are filled.

    Raises as rnea, and InertiaError naming a joint with zero articulated inertia, where Pinocchio returns nan.
    """
    if isinstance(fext, Convention):
        fext, convention = None, fext
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return compute_copy(model, data, _in("aba", convention), q, v, tau, fext=fext)


def _crba(model: Model, data: Data, q: Any, convention: Any = Convention.LOCAL) -> Array:
    """Mass matrix M(q) (nv, nv), both triangles filled, also ``data.M``; the convention selects the other fields."""
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return compute_copy(model, data, _in("crba", convention), q)


def _in(kind: str, convention: Convention) -> str:
    return kind if convention == Convention.LOCAL else f"{kind}_world"


def _nonLinearEffects(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Bias torques C(q, v) v + g(q) (nv,), also ``data.nle``."""
    return compute_copy(model, data, "nle", q, v)


def _computeGeneralizedGravity(model: Model, data: Data, q: Any) -> Array:
    """Gravity torques g(q) (nv,), also ``data.g``."""
    return compute_copy(model, data, "gravity", q)


def _computeStaticTorque(model: Model, data: Data, q: Any, fext: Any) -> Array:
    """Torques g(q) - Σ Jᵀ fext (nv,) that hold the robot still, also ``data.tau``; fext as in rnea."""
    if fext is None:
        raise ArgumentError("fext is None, expected a list of Force")
    return compute_copy(model, data, "static", q, fext=fext)


def _computeCoriolisMatrix(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Coriolis matrix C(q, v) (nv, nv) of the Christoffel symbols, also ``data.C``."""
    return compute_copy(model, data, "coriolis", q, v)


def getCoriolisMatrix(model: Model, data: Data) -> Array:
    """Coriolis matrix (nv, nv) at the q, v of the last call that filled ``data.dJ``, such as computeCoriolisMatrix."""
    library = library_of(model, data)
    run = data.latest("dJ")
    if run is None or not run.stamp:
        return np.array(data.array("C"))
    found: Array = dynamics.table_call("coriolis_matrix", library.model, run.q, run.v)
    data.put("C", found)
    return found


def computeMinverse(model: Model, data: Data, q: Any = None) -> Array:
    """Inverse of the mass matrix (nv, nv), also ``data.Minv``; without q that of the last ``aba``.

    Raises InertiaError naming a joint with zero articulated inertia, where Pinocchio returns inf.
    """
    if q is None:
        library_of(model, data)
        runs = [run for kind in ("aba", "aba_world") if (run := data._runs.get(kind)) is not None and run.stamp]
        if not runs:
            raise ArgumentError("q is not given and aba was not called with this data, expected either")
        q = max(runs, key=lambda run: run.stamp).q.copy()
    found: Array = _minverse(model, data, q)
    return found


def _computeMinverse(model: Model, data: Data, q: Any) -> Array:
    return compute_copy(model, data, "minverse", q)


def computeAllTerms(model: Model, data: Data, q: Any, v: Any) -> None:
    """Fill ``data`` with M, nle, g, J, dJ, centroidal terms and energies; each is computed at its first read."""
    _all(model, data, q, v)


def _all_terms(model: Model, data: Data, q: Any, v: Any) -> Run:
    return compute(model, data, "all", q, v)


def computeKineticEnergy(model: Model, data: Data, q: Any = None, v: Any = None) -> float:
    """Kinetic energy [J], rotor inertia counted, also ``data.kinetic_energy``; without q, v at the last call's."""
    if q is None:
        run = _last(model, data, "v")
        q, v = run.q.copy(), run.v.copy()
    energy: float = _kinetic(model, data, q, v).result.item()
    return energy


def _kinetic_energy(model: Model, data: Data, q: Any, v: Any) -> Run:
    return compute(model, data, "kinetic_energy", q, v)


def computePotentialEnergy(model: Model, data: Data, q: Any = None) -> float:
    """Potential energy of gravity [J], also ``data.potential_energy``; without q at the last call's."""
    if q is None:
        q = _last(model, data, "oMi").q.copy()
    energy: float = _potential(model, data, q).result.item()
    return energy


def _potential_energy(model: Model, data: Data, q: Any) -> Run:
    return compute(model, data, "potential_energy", q)


def computeMechanicalEnergy(model: Model, data: Data, q: Any = None, v: Any = None) -> float:
    """Kinetic plus potential energy [J], all three also in ``data``; without q, v at the last call's."""
    if q is None:
        run = _last(model, data, "v")
        q, v = run.q.copy(), run.v.copy()
    compute(model, data, "mechanical_energy", q, v)
    found: float = data.mechanical_energy
    return found


def _last(model: Model, data: Data, field: str) -> Any:
    """The last call that filled a field. Raises ArgumentError if there was none."""
    library_of(model, data)
    run = data.latest(field)
    if run is None:
        raise ArgumentError("q is not given and no kinematics were computed with this data, expected either")
    return run


rnea = fast_call(_rnea, "rnea", parameters=", fext=None")
aba = fast_call(
    _aba,
    "aba",
    condition="convention is LOCAL",
    parameters=", fext=None, convention=LOCAL",
)
crba = fast_call(_crba, "crba", condition="convention is LOCAL", parameters=", convention=LOCAL")
nonLinearEffects = nle = fast_call(_nonLinearEffects, "nle")
computeGeneralizedGravity = fast_call(_computeGeneralizedGravity, "gravity")
computeCoriolisMatrix = fast_call(_computeCoriolisMatrix, "coriolis")
computeStaticTorque = fast_call(_computeStaticTorque, "static", condition="fext is not None", parameters=", fext")
_all = fast_call(_all_terms, "all")
_kinetic = fast_call(_kinetic_energy, "kinetic_energy")
_potential = fast_call(_potential_energy, "potential_energy")
_minverse = fast_call(_computeMinverse, "minverse")
