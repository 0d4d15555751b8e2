"""The robot as a whole: masses, centres of mass, centroidal momentum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..data.data import prepared
from ..data.dispatch import perform, quick, returned
from ..data.field_recipes import com_in_world, subtree_masses
from ..data.frame_arguments import frame_index, joint_index
from ..data.last_call import Run
from ..types.arguments import ArgumentError, ValueRuntimeError, described
from ..types.frame import ACCELERATION, KinematicLevel
from ..types.inertia import Inertia
from ..types.motion import Force

Array = NDArray[np.float64]


def _last(model: Any, data: Any, field: str = "oMi") -> Run:
    """The last call that filled a field. Raises ValueRuntimeError if there was none."""
    prepared(model, data)
    run: Run | None = data.latest(field)
    if run is None:
        raise ValueRuntimeError("q is not given and data was not computed, expected forwardKinematics before")
    return run


# --- masses and their centre -----------------------------------------------------------------------------


def computeTotalMass(model: Any, data: Any = None) -> float:
    """Mass of all that moves [kg], also ``data.mass[0]``; what hangs on the universe does not count."""
    mass = _masses(model)
    if data is not None:
        prepared(model, data)
        data.mass[0] = mass[0]
    return float(mass[0])


def computeSubtreeMasses(model: Any, data: Any) -> None:
    """Masses of all that each joint carries: ``data.mass``."""
    prepared(model, data)
    data.put("mass", _masses(model))


def _masses(model: Any) -> Array:
    inertias = np.array([inertia._x for inertia in model.inertias]).reshape(-1, 10)
    return subtree_masses(inertias, np.array(model.parents, np.intp))


def centerOfMass(model: Any, data: Any, *given: Any, **named: Any) -> Array:
    """Centre of mass of what moves (3,), also ``data.com[0]``, with its velocity and acceleration in ``data``.

    ``(model, data, q[, v[, a]][, compute_subtree_coms])``; ``(model, data[, kinematic_level][, compute_subtree_coms])``
    for what forwardKinematics was given last. ``data.com[k]`` is the centre of what joint k carries, in its frame;
    vcom and acom likewise. They are at hand whether asked for or not.
    """
    if not named and len(given) < 4 and {*map(type, given)} == {np.ndarray}:
        return _center(model, data, given)
    values = [*given, *(named[name] for name in ("q", "v", "a", "kinematic_level") if name in named)]
    unknown = {*named} - {"q", "v", "a", "kinematic_level", "compute_subtree_coms"}
    if unknown:
        raise ArgumentError(f"centerOfMass got {', '.join(sorted(unknown))}, which it does not take")
    if values and isinstance(values[-1], (bool, np.bool_)):
        values.pop()
    if values and isinstance(values[0], np.ndarray):
        if len(values) > 3:
            raise ArgumentError(f"centerOfMass got {len(values)} arrays, expected q, v and a at most")
        return _center(model, data, values)
    level = values[0] if values else ACCELERATION
    if len(values) > 1 or not isinstance(level, (int, KinematicLevel)):
        raise ArgumentError(f"centerOfMass got {', '.join(map(described, values))}, expected arrays or a level")
    run = _last(model, data)
    inputs = [run.q.copy()]
    if level >= 1:
        moving = data.latest("v") or run
        inputs.append(moving.v.copy())
    if level >= 2:
        inputs.append((data.latest("a") or run).a.copy())
    return _center(model, data, inputs)


def _center(model: Any, data: Any, values: Sequence[Any]) -> Array:
    found: Array = _COM[len(values) - 1](model, data, *values)
    return found


def _com0(model: Any, data: Any, q: Any) -> Array:
    return returned(model, data, "com0", q)


def _com1(model: Any, data: Any, q: Any, v: Any) -> Array:
    return returned(model, data, "com1", q, v)


def _com2(model: Any, data: Any, q: Any, v: Any, a: Any) -> Array:
    return returned(model, data, "com2", q, v, a)


def jacobianCenterOfMass(model: Any, data: Any, q: Any = None, compute_subtree_coms: bool = True) -> Array:
    """Jacobian of the centre of mass (3, nv) in the world, also ``data.Jcom``; without q for the last one given."""
    if q is None or isinstance(q, (bool, np.bool_)):
        q = _last(model, data).q.copy()
    found: Array = _com_jacobian(model, data, q)
    return found


def _jacobianCenterOfMass(model: Any, data: Any, q: Any) -> Array:
    return returned(model, data, "com_jacobian", q)


def jacobianSubtreeCenterOfMass(model: Any, data: Any, *given: Any, **named: Any) -> Array:
    """Jacobian (3, nv) of the centre of mass of what a joint carries, in the world.

    ``(model, data, q, subtree_root_joint_id)``, or ``(model, data, subtree_root_joint_id)`` for the last q given.
    """
    values = [*given, *(named[name] for name in ("q", "subtree_root_joint_id") if name in named)]
    if len(values) not in (1, 2):
        raise ArgumentError(f"jacobianSubtreeCenterOfMass got {len(values)} arguments, expected q and a joint")
    q = values[0] if len(values) == 2 else _last(model, data).q.copy()
    perform(model, data, "com_jacobian", q)
    return getJacobianSubtreeCenterOfMass(model, data, values[-1])


def getJacobianSubtreeCenterOfMass(model: Any, data: Any, subtree_root_joint_id: int) -> Array:
    """The same, where ``data.J`` was computed last.

    A joint moves, of what the root joint carries, what it carries itself if it hangs on the root joint, and all of it
    if the root joint hangs on it.
    """
    root, run = joint_index(model, subtree_root_joint_id), _last(model, data, "J")
    if model.mimicking_joints:
        raise NotImplementedError("Jacobians of subtrees' centres of mass with mimic joints are not supported")
    m, c, J = subtree_masses(run.bodies, run.parents), com_in_world(run), data.array("J")
    out = np.zeros((3, model.nv))
    below, above = set(model.subtrees[root]) if root else set(range(1, model.njoints)), set(model.supports[root])
    for k in range(1, model.njoints):
        if k in below or k in above:
            moved = k if k in below else root
            own = slice(model.idx_vs[k], model.idx_vs[k] + model.nvs[k])
            out[:, own] = m[moved] / m[root] * (J[:3, own] + np.cross(J[3:, own].T, c[moved]).T)
    return out


# --- centroidal momentum ---------------------------------------------------------------------------------


def _ccrba(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Centroidal momentum matrix Ag (6, nv), also ``data.Ag``; the momentum is ``data.hg``."""
    return returned(model, data, "ccrba", q, v)


def _dccrba(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Time derivative of the centroidal momentum matrix (6, nv), also ``data.dAg``."""
    return returned(model, data, "dccrba", q, v)


def _computeCentroidalMap(model: Any, data: Any, q: Any) -> Array:
    """Centroidal momentum matrix Ag (6, nv), also ``data.Ag``."""
    return returned(model, data, "map", q)


def _computeCentroidalMapTimeVariation(model: Any, data: Any, q: Any, v: Any) -> Array:
    """Time derivative of the centroidal momentum matrix (6, nv), also ``data.dAg``."""
    return returned(model, data, "map_dot", q, v)


def computeCentroidalMomentum(model: Any, data: Any, q: Any = None, v: Any = None) -> Force:
    """Momentum about the centre of mass, also ``data.hg``; without q, v for the last ones given."""
    if q is None:
        run = _last(model, data, "v")
        q, v = run.q.copy(), run.v.copy()
    return Force.over(_momentum(model, data, q, v))


def computeCentroidalMomentumTimeVariation(model: Any, data: Any, q: Any = None, v: Any = None, a: Any = None) -> Force:
    """Rate of the momentum about the centre of mass, also ``data.dhg``; without q, v, a for the last ones given."""
    if q is None:
        run = _last(model, data, "a")
        q, v, a = run.q.copy(), run.v.copy(), run.a.copy()
    return Force.over(_momentum_dot(model, data, q, v, a))


def _momentum0(model: Any, data: Any, q: Any, v: Any) -> Array:
    return returned(model, data, "momentum", q, v)


def _momentum1(model: Any, data: Any, q: Any, v: Any, a: Any) -> Array:
    return returned(model, data, "momentum_dot", q, v, a)


# --- what a frame supports -------------------------------------------------------------------------------


def _supported(model: Any, frame: int) -> Inertia:
    """The bodies of a frame and of those behind it on its joint, in the joint's frame."""
    joint, found = model.frames[frame].parentJoint, {frame}
    for k in range(frame + 1, len(model.frames)):
        if model.frames[k].parentJoint == joint and model.frames[k].parentFrame in found:
            found.add(k)
    total = Inertia.Zero()
    for k in found:
        total = total + model.frames[k].placement.act(model.frames[k].inertia)
    return total


def computeSupportedInertiaByFrame(model: Any, data: Any, frame_id: int, with_subtree: bool) -> Inertia:
    """Inertia of the bodies behind a frame on its joint, in the frame; with the subtree all joints' on it as well.

    With the subtree it needs ``data.oMi``.
    """
    prepared(model, data)
    k = frame_index(model, frame_id)
    frame, total = model.frames[k], _supported(model, k)
    if with_subtree:
        here = data.oMi[frame.parentJoint]
        for i in model.subtrees[frame.parentJoint]:
            if i != frame.parentJoint:
                total = total + here.actInv(data.oMi[i].act(model.inertias[i]))
    found: Inertia = frame.placement.actInv(total)
    return found


def computeSupportedForceByFrame(model: Any, data: Any, frame_id: int) -> Force:
    """Force that holds the bodies behind a frame and all other joints on its joint, in the frame.

    It is of ``data.a_gf``, v, f and liMi, as rnea leaves them.
    """
    prepared(model, data)
    k = frame_index(model, frame_id)
    frame, total = model.frames[k], _supported(model, k)
    a, v = data.a_gf[frame.parentJoint], data.v[frame.parentJoint]
    force = total * a + v.cross(total * v)
    for child in model.children[frame.parentJoint]:
        force = force + data.liMi[child].act(data.f[child])
    found: Force = frame.placement.actInv(force)
    return found


_COM = quick(_com0, "com0"), quick(_com1, "com1"), quick(_com2, "com2")
_momentum, _momentum_dot = quick(_momentum0, "momentum"), quick(_momentum1, "momentum_dot")
_com_jacobian = quick(_jacobianCenterOfMass, "com_jacobian")
ccrba, dccrba = quick(_ccrba, "ccrba"), quick(_dccrba, "dccrba")
computeCentroidalMap = quick(_computeCentroidalMap, "map")
computeCentroidalMapTimeVariation = quick(_computeCentroidalMapTimeVariation, "map_dot")
