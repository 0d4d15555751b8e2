"""The dynamics of a model under Pinocchio's names: torques, accelerations, M, C, g, energies.

Every function takes the model, its data and arrays; results are new arrays, and stay in the data as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ..data.data import prepared
from ..data.dispatch import perform, quick, returned
from ..data.last_call import Run
from ..types.arguments import ArgumentError, described
from ..types.frame import Convention

Array = NDArray[np.float64]


def _rnea(model: Any, data: Any, q: Any, v: Any, a: Any, fext: Any = None) -> Array:
    """Torques τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext (nv,), also ``data.tau``.

    q     (nq,)            joint positions
    v, a  (nv,)            joint velocities and accelerations
    fext  list of njoints  Force on each joint's body, in the joint's frame; the universe's does nothing

    Raises ArgumentError (a TypeError) for what is no array, ShapeError (a ValueError) for wrong sizes.
    """
    return returned(model, data, "rnea", q, v, a, fext=fext)


def _aba(
    model: Any, data: Any, q: Any, v: Any, tau: Any, fext: Any = None, convention: Any = Convention.LOCAL
) -> Array:
    """Accelerations (nv,) under torques tau (nv,) and external forces, also ``data.ddq``.

    ``aba(model, data, q, v, tau[, fext][, convention])``, fext as in rnea. The convention decides only which fields of
    data are filled.

    Raises as rnea, and InertiaError naming a joint that moves no inertia, where Pinocchio returns nan.
    """
    if isinstance(fext, Convention):
        fext, convention = None, fext
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return returned(model, data, _in("aba", convention), q, v, tau, fext=fext)


def _crba(model: Any, data: Any, q: Any, convention: Any = Convention.LOCAL) -> Array:
    """Mass matrix M(q) (nv, nv), both triangles filled, also ``data.M``; the convention decides which fields are."""
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return returned(model, data, _in("crba", convention), q)


def _in(kind: str, convention: Convention) -> str:
    return kind if convention == Convention.LOCAL else f"{kind}_world"


def _nonLinearEffects(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Bias torques C(q, v) v + g(q) (nv,), also ``data.nle``."""
    return returned(model, data, "nle", q, v)


def _computeGeneralizedGravity(model: Any, data: Any, q: Any) -> Array:
    """Gravity torques g(q) (nv,), also ``data.g``."""
    return returned(model, data, "gravity", q)


def _computeStaticTorque(model: Any, data: Any, q: Any, fext: Any) -> Array:
    """Torques g(q) - Σ Jᵀ fext (nv,) that hold the robot still, also ``data.tau``; fext as in rnea."""
    if fext is None:
        raise ArgumentError("fext is None, expected a list of Force")
    return returned(model, data, "static", q, fext=fext)


def _computeCoriolisMatrix(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Coriolis matrix C(q, v) (nv, nv) of the Christoffel symbols, also ``data.C``."""
    return returned(model, data, "coriolis", q, v)


def getCoriolisMatrix(model: Any, data: Any) -> Array:
    """The same, of what was computed last: needs what computeCoriolisMatrix leaves in data."""
    compiled = prepared(model, data)
    run = data.latest("dJ")
    if run is None or not run.stamp:
        return np.array(data.array("C"))
    found: Array = dynamics.calls["coriolis_matrix"](compiled.model, run.q, run.v)
    data.put("C", found)
    return found


def computeMinverse(model: Any, data: Any, q: Any = None) -> Array:
    """Inverse of the mass matrix (nv, nv), also ``data.Minv``; without q for that of the last ``aba``.

    Raises InertiaError naming a joint that moves no inertia, where Pinocchio returns inf.
    """
    if q is None:
        prepared(model, data)
        runs = [run for kind in ("aba", "aba_world") if (run := data._runs.get(kind)) is not None and run.stamp]
        if not runs:
            raise ArgumentError("q is not given and aba was not called with this data, expected either")
        q = max(runs, key=lambda run: run.stamp).q.copy()
    found: Array = _minverse(model, data, q)
    return found


def _computeMinverse(model: Any, data: Any, q: Any) -> Array:
    return returned(model, data, "minverse", q)


def computeAllTerms(model: Any, data: Any, q: Any, v: Any) -> None:
    """Fill ``data`` with M, nle, g, J, dJ, centroidal terms and energies; each is computed when it is read."""
    _all(model, data, q, v)


def _all_terms(model: Any, data: Any, q: Any, v: Any) -> Run:
    return perform(model, data, "all", q, v)


def computeKineticEnergy(model: Any, data: Any, q: Any = None, v: Any = None) -> float:
    """Kinetic energy [J], rotor inertia counted, also ``data.kinetic_energy``; without q, v for the last ones given."""
    if q is None:
        run = _last(model, data, "v")
        q, v = run.q.copy(), run.v.copy()
    energy: float = _kinetic(model, data, q, v).result.item()
    return energy


def _kinetic_energy(model: Any, data: Any, q: Any, v: Any) -> Run:
    return perform(model, data, "kinetic_energy", q, v)


def computePotentialEnergy(model: Any, data: Any, q: Any = None) -> float:
    """Potential energy of gravity [J], also ``data.potential_energy``; without q for the last one given."""
    if q is None:
        q = _last(model, data, "oMi").q.copy()
    energy: float = _potential(model, data, q).result.item()
    return energy


def _potential_energy(model: Any, data: Any, q: Any) -> Run:
    return perform(model, data, "potential_energy", q)


def computeMechanicalEnergy(model: Any, data: Any, q: Any = None, v: Any = None) -> float:
    """Kinetic and potential energy [J], both left in data too; without q, v for the last ones given."""
    if q is None:
        run = _last(model, data, "v")
        q, v = run.q.copy(), run.v.copy()
    perform(model, data, "mechanical_energy", q, v)
    found: float = data.mechanical_energy
    return found


def _last(model: Any, data: Any, field: str) -> Any:
    """The last call that filled a field. Raises ArgumentError if there was none."""
    prepared(model, data)
    run = data.latest(field)
    if run is None:
        raise ArgumentError("q is not given and no kinematics were computed with this data, expected either")
    return run


rnea = quick(_rnea, "rnea", more=", fext=None")
aba = quick(
    _aba,
    "aba",
    condition="convention is LOCAL",
    more=", fext=None, convention=LOCAL",
)
crba = quick(_crba, "crba", condition="convention is LOCAL", more=", convention=LOCAL")
nonLinearEffects = nle = quick(_nonLinearEffects, "nle")
computeGeneralizedGravity = quick(_computeGeneralizedGravity, "gravity")
computeCoriolisMatrix = quick(_computeCoriolisMatrix, "coriolis")
computeStaticTorque = quick(_computeStaticTorque, "static", condition="fext is not None", more=", fext")
_all = quick(_all_terms, "all")
_kinetic = quick(_kinetic_energy, "kinetic_energy")
_potential = quick(_potential_energy, "potential_energy")
_minverse = quick(_computeMinverse, "minverse")
