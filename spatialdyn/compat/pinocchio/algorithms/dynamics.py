"""Dynamics under Pinocchio's names: torques, accelerations, M, C, g, energies.

Every function takes the model, its data and arrays; results are new arrays and fields of the data. In regressors π are
toDynamicParameters of the inertias after the universe's, one after the other; columns of all joints lie side by side.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ....errors import ModelError
from ....recursions.tree.regressor import body_force
from ...native import recorded_kinematics, tree_kernels
from ...native.operator_kernels import on_motions
from ...native.recorded_calls import clock
from ..data.data import Data, library_of
from ..data.dispatch import IDENTITY, REFERENCES, frame_index, joint_index, reference_code
from ..model.library_model import frame_placements, library_model
from ..model.model import Model
from ..types.arguments import Array, expected
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = [
    "bodyRegressor", "computeFrameKinematicRegressor", "computeJointKinematicRegressor", "frameBodyRegressor",
    "getCoriolisMatrix", "jointBodyRegressor",
]  # fmt: skip


def getCoriolisMatrix(model: Model, data: Data) -> Array:
    """Coriolis matrix (nv, nv) at the q, v of the last call that filled ``data.dJ``, such as computeCoriolisMatrix."""
    library_of(model, data)
    run = data.latest("dJ", of_call=True)
    if run is None:
        return np.array(data.array("C"))
    found: Array = run.library.compute("coriolis_matrix", run.q, run.v, at=run.state)
    data.put("C", found)
    return found


# --- regressors ------------------------------------------------------------------------------------------


def bodyRegressor(velocity: Motion, acceleration: Motion) -> Array:
    """Y (6, 10), linear first: I a + v ×* I v is Y times toDynamicParameters of I."""
    v, a = expected(velocity, Motion, "velocity"), expected(acceleration, Motion, "acceleration")
    out = np.empty((6, 10))
    _body_force(v._x, a._x, out)
    return out


_body_force = on_motions(body_force)


def jointBodyRegressor(model: Model, data: Data, joint_id: int) -> Array:
    """Y (6, 10) of the body of a joint, from data.v and data.a_gf of rnea. Raises ModelError for no such joint."""
    try:
        library, time, arrays, call = data._bound["body regressor"]
        if library is model._library and time == clock.now[0] and (found := call(joint_id)) is not None:
            return found  # type: ignore[no-any-return]
    except (AttributeError, KeyError):  # the fast path does not apply
        arrays = {}
    library, at = library_of(model, data), _index("joint_id", joint_id, model.njoints)
    made = bodyRegressor(*_motions_of(data, at))
    if library.has_builtins:
        if not arrays:
            arrays = {x: data._held.get(x, np.empty((model.njoints, 6))) for x in ("v", "a_gf")}
            words = {"velocities": arrays["v"], "accelerations": arrays["a_gf"], "njoints": model.njoints}
            call = recorded_kinematics.joint_body_regressor.bind(words)
        for name, x in arrays.items():
            x[...] = data.array(name)
        data._bound["body regressor"] = library, clock.now[0], arrays, call
    return made


def frameBodyRegressor(model: Model, data: Data, frame_id: int) -> Array:
    """Y (6, 10) of a body on a frame, in the frame, from data.v and data.a_gf. Raises ModelError for no such frame."""
    library_of(model, data)
    frame = model.frames[_index("frame_id", frame_id, model.nframes)]
    joint, placement = frame.parentJoint, frame.placement
    return bodyRegressor(*map(placement.actInv, _motions_of(data, joint)))


def _motions_of(data: Data, joint: int) -> Iterator[Motion]:
    """Its v and a_gf; read as ``data.a_gf`` they would be recomputed at each call of rnea from then on."""
    return (Motion.over(data.array(name)[joint]) for name in ("v", "a_gf"))


def computeJointKinematicRegressor(
    model: Model, data: Data, joint_id: int, reference_frame: Any, placement: SE3 | None = None
) -> Array:
    """Y (6, 6 (njoints - 1)), from ``data.oMi``: what a joint's frame, or one placed on the joint, moves by where the
    placements of joints move, each by a motion in its own frame. Raises ModelError for the universe.
    """
    library_of(model, data)
    at = joint_index(model, joint_id)
    place = IDENTITY if placement is None else expected(placement, SE3, "placement")._x
    return _kinematic_regressor(model, data, ("joint_id", at), at, place, reference_frame)


def computeFrameKinematicRegressor(model: Model, data: Data, frame_id: int, reference_frame: Any) -> Array:
    """``computeJointKinematicRegressor`` of a frame of the model."""
    try:
        frames, call = data._bound["kinematic regressor"]
        known = frames is model._frame_placements and model._library is not None
        if known and (found := call(frame_id, reference_frame)) is not None:
            return found  # type: ignore[no-any-return]
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    library_of(model, data)
    at = frame_index(model, frame_id)
    frame = model.frames[at]
    given = ("frame_id", at), frame.parentJoint, frame.placement._x, reference_frame
    made = _kinematic_regressor(model, data, *given)
    frames, library = frame_placements(model), library_model(model)
    if library.has_builtins:
        places = {"in_parents": model._numbers.placements, "parents": library.parents, "poses": data.hold("oMi")}
        sizes = {"njoints": model.njoints, "columns": made.shape[1]}
        call = tree_kernels.frame_kinematic_regressor.bind({**places, **sizes, **REFERENCES, **frames.words()}, frames)
        data._bound["kinematic regressor"] = frames, call
    return made


def _kinematic_regressor(
    model: Model, data: Data, given: tuple[str, int], at: int, place: Array, reference_frame: Any
) -> Array:
    name, index = given
    if index == 0:
        raise ModelError(f"{name} is 0, the universe, which no joint moves, expected another")
    code, found, library = reference_code(reference_frame), np.zeros((6, 6 * (model.njoints - 1))), library_model(model)
    places = library.numbers.placements, library.parents, at, place
    tree_kernels.kinematic_regressor(data.array("oMi"), *places, code, found)
    return found


def _index(name: str, value: Any, n: int) -> int:
    if not 0 <= value < n:
        raise ModelError(f"{name} is {value}, expected 0 to {n - 1}")
    return int(value)
