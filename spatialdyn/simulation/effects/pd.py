"""A PD law of the joints, held over a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...bodies.kinds import R1
from ...calls.arguments import as_array
from ...errors import ModelError, SimulationError
from ...model.model import Model
from ...recursions.spec import Argument
from ..arithmetic import Arithmetic
from .effect import Effect

Array = NDArray[Any]
GAINS = (
    Argument("kp", ("nv",), "N m/rad | N/m", "gains of position"),
    Argument("kd", ("nv",), "N m s/rad | N s/m", "gains of velocity"),
    Argument("q_ref", ("nq",), "rad | m", "positions to reach"),
    Argument("v_ref", ("nv",), "rad/s | m/s", "velocities to reach"),
)


class PD(NamedTuple):
    """A joint-space control law: tau = kp (q_ref - q) + kd (v_ref - v) + the argument tau of ``rollout``.

    kp, kd  (nv,), or (B, 1, nv) per sample  gains [N m/rad | N/m], [N m s/rad | N s/m]
    q_ref   (nq,), (T, nq) or (B, T, nq)  reference positions [rad | m]
    v_ref   (nv,), (T, nv) or (B, T, nv)  reference velocities [rad/s | m/s]; zero if left out

    It is evaluated at the beginning of a step and held over it, as by a digital controller. For joints whose position
    is not one number (quaternion, planar, (cos, sin)) q_ref - q is undefined: their kp must be 0.
    """

    kp: ArrayLike
    kd: ArrayLike
    q_ref: ArrayLike
    v_ref: ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class JointPD(Effect):
    """A PD law of a run; ``rows`` {name: (samples or 1, steps or 1, columns)}."""

    rows: dict[str, Array]
    name = "pd"
    inputs = GAINS

    @property
    def values(self) -> dict[str, Array]:
        """See ``Effect``."""
        return self.rows

    def structure(self) -> JointPD:
        """See ``Effect``."""
        return JointPD({})

    def held_torque(self, at: Arithmetic, q: Any, v: Any, tau: Any) -> Any:
        """See ``Effect``."""
        given, error = at.given, np.zeros(len(v), q.dtype)
        for i, row in enumerate(at.rows[1:]):
            if row.kind in R1:
                error[i] = given["q_ref"][row.q_index] - q[row.q_index]
        return tau + given["kp"] * error + given["kd"] * (given["v_ref"] - v)


def gains_of(model: Model, pd: PD) -> dict[str, tuple[Array, int]]:
    """The inputs of a law, and their columns. Raises SimulationError, ModelError."""
    if not isinstance(pd, PD):
        raise SimulationError(f"pd is a {type(pd).__name__}, expected a PD(kp, kd, q_ref)")
    kp = as_array("pd.kp", pd.kp)
    if kp.shape[-1:] == (model.nv,):
        for joint in model.joints[1:]:
            if joint.nq != joint.nv and kp[..., joint.idx_v : joint.idx_v + joint.nv].any():
                what = f'joint "{joint.name}" ({joint.kind})'
                raise ModelError(f"pd.kp is not 0 for {what}, expected 0: its position is not one number")
            if joint.nq == joint.nv > 1 and kp[..., joint.idx_v : joint.idx_v + joint.nv].any():
                raise ModelError(f'pd.kp is not 0 for joint "{joint.name}" ({joint.kind}), expected 0: it is planar')
    v_ref = np.zeros(model.nv) if pd.v_ref is None else as_array("pd.v_ref", pd.v_ref)
    return {
        "kp": (kp, model.nv),
        "kd": (as_array("pd.kd", pd.kd), model.nv),
        "q_ref": (as_array("pd.q_ref", pd.q_ref), model.nq),
        "v_ref": (v_ref, model.nv),
    }
