"""Forces at named frames as external forces of calls."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model.model import Frame, Model
from ..recursions.spec import LOCAL, WORLD, Argument, Q
from .arguments import as_array, batch_shape, broadcast, check_model, reference_code
from .dynamics import calls

Array = NDArray[np.float64]

FORCE = Argument("force", (6,), "N | N m", "force at a frame, linear first")


def wrench_at(model: Model, q: ArrayLike, frame: str | Frame, force: ArrayLike, reference: str = "local") -> Array:
    """A force at a named frame as ``fext``, the argument of rnea, aba and static_torque.

    q          (..., nq)  joint positions [rad | m]
    frame      name of a link or joint; link:NAME or joint:NAME if both have it
    force      (..., 6)   force and moment, linear first [N | N m]
    reference  local: at the frame's origin in its axes; local_world_aligned: there in the world's axes;
               world: at the world's origin in the world's axes

    A force on a link fixed to the world goes to row 0, which is ignored. Sum the fext of several forces.

    Returns fext (..., njoints, 6): zero except the row of the frame's joint, in that joint's frame.
    Raises  ModelError if there is no such frame; SpatialDynError for another reference; ShapeError.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> wrench_at(model, [0.5, -0.3], model.joints[2].name, [1, 0, 0, 0, 0, 0])[2].tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    check_model(model)
    place, code = model.frame(frame), reference_code(reference)
    q, force = as_array("q", q), as_array("force", force)
    batch = broadcast(["q", "force"], [batch_shape(model, Q, q), batch_shape(model, FORCE, force)])
    f, n = force[..., :3], force[..., 3:]
    if code != LOCAL:
        X = calls["frame_placement"](model, q, place)
        if code == WORLD:
            n = n - np.cross(X[..., :3, 3], f)
        f, n = (np.einsum("...ji,...j->...i", X[..., :3, :3], x) for x in (f, n))
    R, p = place.placement[:3, :3], place.placement[:3, 3]
    f = f @ R.T
    fext = np.zeros((*batch, model.njoints, 6))
    fext[..., place.joint, :3] = f
    fext[..., place.joint, 3:] = n @ R.T + np.cross(p, f)
    return fext
