"""Masses, centres of mass, centroidal momentum under Pinocchio's names."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...native import tree_kernels
from ..data.data import Data, library_of
from ..data.dispatch import frame_index, joint_index, last_call
from ..data.face import REFUSED
from ..model.library_model import subtree_masses
from ..model.model import Model
from ..types.arguments import ArgumentError, Array
from ..types.inertia import Inertia
from ..types.motion import Force
from .calls import jacobianCenterOfMass

__all__ = [
    "computeSubtreeMasses", "computeSupportedForceByFrame", "computeSupportedInertiaByFrame",
    "getJacobianSubtreeCenterOfMass", "jacobianSubtreeCenterOfMass",
]  # fmt: skip


def computeSubtreeMasses(model: Model, data: Data) -> None:
    """Mass of each joint's subtree: ``data.mass``."""
    library_of(model, data)
    data.put("mass", subtree_masses(model._numbers.inertias[:, 0].tolist(), model.parents))


def jacobianSubtreeCenterOfMass(model: Model, data: Data, *given: Any, **named: Any) -> Array:
    """Jacobian (3, nv) of the centre of mass of a joint's subtree, in the world.

    ``(model, data, q, subtree_root_joint_id)``, or ``(model, data, subtree_root_joint_id)`` at the last call's q.
    """
    try:
        run, call = data._bound["subtree"]
        if run.library is model._library and not named:
            found: Array | None = call(*given)
            if found is None and run.library.follow():  # numbers were edited
                found = call(*given)
            if found is not None:
                data.note_builtin_call(run)
                return found
    except REFUSED:
        pass
    values = [*given, *(named[name] for name in ("q", "subtree_root_joint_id") if name in named)]
    if len(values) not in (1, 2):
        raise ArgumentError(f"jacobianSubtreeCenterOfMass got {len(values)} arguments, expected q and a joint")
    q = values[0] if len(values) == 2 else last_call(model, data, "oMi").q.copy()
    jacobianCenterOfMass(model, data, q)
    made, library = getJacobianSubtreeCenterOfMass(model, data, values[-1]), library_of(model, data)
    if library.has_builtins:
        run = data.run_of("subtree_com_jacobian", library)
        words = {"rows": library.row_numbers, **library.words, "njoints": model.njoints}
        call = tree_kernels.subtree_com_jacobian_at.bind(words, library, run, record=run.recording(1))
        data._bound["subtree"] = run, call
    return made


def getJacobianSubtreeCenterOfMass(model: Model, data: Data, subtree_root_joint_id: int) -> Array:
    """Jacobian (3, nv) of the centre of mass of a joint's subtree, at the q of ``data.J``.

    A joint within the subtree moves its own subtree; one that carries the root joint moves the whole of it.
    """
    try:
        library, state, call = data._latest["J"].bound["subtree"]
        unedited = library is model._library and library.state is state
        if unedited and (found := call(subtree_root_joint_id)) is not None:
            return found  # type: ignore[no-any-return]
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    root, run = joint_index(model, subtree_root_joint_id), last_call(model, data, "J")
    library = run.library
    out, row = np.empty((3, library.tree_nv)), library.row_numbers[root : root + 1]
    tree_kernels.subtree_com_jacobian(run.kernel_table, library.tree_q(run.q), row, out)
    if library.has_builtins and run.state is library.state:
        words = {"q": run.q, "rows": library.row_numbers, **library.words, "njoints": model.njoints}
        call = tree_kernels.subtree_com_jacobian_at_recorded.bind(words, library, run)
        run.bound["subtree"] = library, library.state, call
    return library.of_joints(out)


# --- what a frame supports -------------------------------------------------------------------------------


def _supported(model: Model, frame: int) -> Inertia:
    """Inertia of a frame and of its child frames on the same joint, in the joint's frame."""
    joint, found = model.frames[frame].parentJoint, {frame}
    for k in range(frame + 1, len(model.frames)):
        if model.frames[k].parentJoint == joint and model.frames[k].parentFrame in found:
            found.add(k)
    total: Inertia = Inertia.Zero()
    for k in found:
        total += model.frames[k].placement.act(model.frames[k].inertia)
    return total


def computeSupportedInertiaByFrame(model: Model, data: Data, frame_id: int, with_subtree: bool) -> Inertia:
    """Inertia of a frame and its child frames on its joint, in the frame; with_subtree: and of the joint's subtree.

    with_subtree needs ``data.oMi``.
    """
    library_of(model, data)
    k = frame_index(model, frame_id)
    frame, total = model.frames[k], _supported(model, k)
    if with_subtree:
        here = data.oMi[frame.parentJoint]
        for i in model.subtrees[frame.parentJoint]:
            if i != frame.parentJoint:
                total = total + here.actInv(data.oMi[i].act(model.inertias[i]))
    found: Inertia = frame.placement.actInv(total)
    return found


def computeSupportedForceByFrame(model: Model, data: Data, frame_id: int) -> Force:
    """Force that supports a frame, its child frames and the joints on its joint, in the frame.

    From ``data.a_gf``, v, f and liMi, as rnea fills them.
    """
    library_of(model, data)
    k = frame_index(model, frame_id)
    frame, total = model.frames[k], _supported(model, k)
    a, v = data.a_gf[frame.parentJoint], data.v[frame.parentJoint]
    force = total * a + v.cross(total * v)
    for child in model.children[frame.parentJoint]:
        force = force + data.liMi[child].act(data.f[child])
    found: Force = frame.placement.actInv(force)
    return found
