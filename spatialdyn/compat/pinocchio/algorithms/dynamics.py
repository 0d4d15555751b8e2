"""Dynamics under Pinocchio's names: torques, accelerations, M, C, g, energies.

Every function takes the model, its data and arrays; results are new arrays and fields of the data.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..data.data import Data, library_of
from ..data.dispatch import fast_calls
from ..model.model import Model
from ..types.arguments import ArgumentError, Array, described
from ..types.frame import Convention

__all__ = [
    "aba", "computeAllTerms", "computeCoriolisMatrix", "computeGeneralizedGravity", "computeKineticEnergy",
    "computeMechanicalEnergy", "computeMinverse", "computePotentialEnergy", "computeStaticTorque", "crba",
    "getCoriolisMatrix", "nle", "nonLinearEffects", "rnea",
]  # fmt: skip


def _kind(kind: str, convention: Any) -> str:
    """The kind of call of a convention. Raises ArgumentError for what is none."""
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return kind if convention == Convention.LOCAL else f"{kind}_world"


def _aba_kind(fext: Any, convention: Any) -> tuple[str, Any]:
    """Kind and forces of ``aba``, whose convention may stand in place of the forces."""
    return (_kind("aba", fext), None) if isinstance(fext, Convention) else (_kind("aba", convention), fext)


def given_forces(fext: Any) -> None:
    """Raise ArgumentError if forces that have to be given are None."""
    if fext is None:
        raise ArgumentError("fext is None, expected a list of Force")


_CALLS = """
rnea = rnea; forces: fext=None
    Torques τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext (nv,), also ``data.tau``.

    q     (nq,)            joint positions
    v, a  (nv,)            joint velocities and accelerations
    fext  list of njoints  Force on each joint's body, in the joint's frame; the universe's is ignored

    Raises ArgumentError (a TypeError) for a wrong type, ShapeError (a ValueError) for a wrong size.
aba = aba; forces: fext=None; options: convention=LOCAL; when: convention is LOCAL;
  slow: kind, fext = aba_kind(fext, convention)
    Accelerations (nv,) under torques tau (nv,) and external forces, also ``data.ddq``.

    ``aba(model, data, q, v, tau[, fext][, convention])``, fext as in rnea. The convention only selects which fields of
    data are filled.

    Raises as rnea, and InertiaError naming a joint with zero articulated inertia, where Pinocchio returns nan.
crba = crba; options: convention=LOCAL; when: convention is LOCAL; slow: kind = by_convention(kind, convention)
    Mass matrix M(q) (nv, nv), both triangles filled, also ``data.M``; the convention selects the other fields.
nonLinearEffects = nle
    Bias torques C(q, v) v + g(q) (nv,), also ``data.nle``.
computeGeneralizedGravity = gravity
    Gravity torques g(q) (nv,), also ``data.g``.
computeStaticTorque = static; forces: fext; when: fext is not None; slow: given_forces(fext)
    Torques g(q) - Σ Jᵀ fext (nv,) that hold the robot still, also ``data.tau``; fext as in rnea.
computeCoriolisMatrix = coriolis
    Coriolis matrix C(q, v) (nv, nv) of the Christoffel symbols, also ``data.C``.
computeMinverse = minverse; last: ddq
    Inverse of the mass matrix (nv, nv), also ``data.Minv``; without q that of the last ``aba``.

    Raises InertiaError naming a joint with zero articulated inertia, where Pinocchio returns inf.
computeAllTerms = all; returns: None
    Fill ``data`` with M, nle, g, J, dJ, centroidal terms and energies; each is computed at its first read.
computeKineticEnergy = kinetic_energy; returns: run.result.item(); last: v
    Kinetic energy [J], rotor inertia counted, also ``data.kinetic_energy``; without q, v at the last call's.
computePotentialEnergy = potential_energy; returns: run.result.item(); last: oMi
    Potential energy of gravity [J], also ``data.potential_energy``; without q at the last call's.
computeMechanicalEnergy = mechanical_energy; returns: data.mechanical_energy; last: v
    Kinetic plus potential energy [J], all three also in ``data``; without q, v at the last call's.
"""
(
    rnea, aba, crba, nonLinearEffects, computeGeneralizedGravity, computeStaticTorque, computeCoriolisMatrix,
    computeMinverse, computeAllTerms, computeKineticEnergy, computePotentialEnergy, computeMechanicalEnergy,
) = fast_calls(
    _CALLS, LOCAL=Convention.LOCAL, by_convention=_kind, aba_kind=_aba_kind, given_forces=given_forces
)  # fmt: skip
nle = nonLinearEffects


def getCoriolisMatrix(model: Model, data: Data) -> Array:
    """Coriolis matrix (nv, nv) at the q, v of the last call that filled ``data.dJ``, such as computeCoriolisMatrix."""
    library_of(model, data)
    run = data.latest("dJ")
    if run is None:
        return np.array(data.array("C"))
    found: Array = run.library.compute("coriolis_matrix", run.q, run.v)
    data.put("C", found)
    return found
