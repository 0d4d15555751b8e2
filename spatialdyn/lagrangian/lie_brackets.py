"""The frame of vector fields X_i along which joint velocities v_i move the robot, and its Lie brackets.

X_i moves q along q ∘ exp(s e_i), a twist in the body's frame. For a joint of one freedom X_i = ∂/∂q_i; the fields of a
spherical, floating or planar joint do not commute.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import check_model
from ..model.joint_rows import Joint
from ..model.model import Model

Array = NDArray[np.float64]


def motion_subspace(model: Model, joint: Joint) -> Array:
    """The motions S of a joint, a row per freedom, (nv, 6) in its body's frame, angular first.

    Rows are orthonormal, except for a helical joint, whose linear part has the length of its pitch.
    """
    rows = model.bodies[joint.row - joint.nv + 1 : joint.row + 1]["S"]
    return np.array([[float(s[part][axis]) for part in "wv" for axis in "xyz"] for s in rows]).reshape(-1, 6)


def structure_constants(model: Model) -> Array:
    """Structure constants c of the frame of joint velocities: [X_j, X_k] = Σ_m c[m, j, k] X_m.

    Source: RBDA eq. 2.31 for the bracket of two twists, S_j × S_k, written in the S of the same joint.

    They do not depend on q, and are zero except for joints of several freedoms.

    Returns c (nv, nv, nv) [1 | 1/m | m], antisymmetric in j and k.
    Raises  ModelError if model is not a Model.

    >>> import numpy as np, spatialdyn as sd
    >>> body = (1.0, (0, 0, 0), np.eye(3))
    >>> ball = sd.ModelBuilder("ball").add_body("ball", None, "spherical", inertia=body).build()
    >>> structure_constants(ball)[2, 0, 1].item()
    1.0
    """
    check_model(model)
    c = np.zeros((model.nv,) * 3)
    for joint in model.joints[1:]:
        if joint.nv < 2:
            continue
        S = motion_subspace(model, joint)
        w, v = S[:, :3], S[:, 3:]
        turned = np.cross(w[:, None], w[None])
        moved = np.cross(w[:, None], v[None]) + np.cross(v[:, None], w[None])
        here = slice(joint.idx_v, joint.idx_v + joint.nv)
        c[here, here, here] = np.einsum("ma,jka->mjk", S, np.concatenate([turned, moved], -1))
    return c
