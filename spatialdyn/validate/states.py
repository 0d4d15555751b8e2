"""Random states of a robot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import kind_of
from ..calls import dynamics
from ..model.model import Joint, Model

Array = NDArray[np.float64]

ANGLES = (0.5, 2.5)  # rad: below, Pinocchio's derivatives of difference lose digits; at pi the shorter way is open


class States(NamedTuple):
    """Random states, samples first.

    q (n, nq), v, a, tau (n, nv), fext (n, njoints, 6); d (n, nv) a displacement with angles in ANGLES, q1 where it
    leads from q, t (n,) a part of the way, raw (n, nq) a configuration that is not of unit norm.
    """

    q: Array
    v: Array
    a: Array
    tau: Array
    fext: Array
    d: Array
    q1: Array
    t: Array
    raw: Array


def random_states(model: Model, samples: int, rng: np.random.Generator) -> States:
    """States around the neutral configuration, with standard normal entries."""
    step, v, a, tau, d = (rng.normal(size=(samples, model.nv)) for _ in range(5))
    for joint in model.joints[1:]:
        turning = _angular(joint)
        angle = np.linalg.norm(d[:, turning], axis=1, keepdims=True)
        if turning.stop > turning.start:
            d[:, turning] *= rng.uniform(*ANGLES, size=(samples, 1)) / angle
    q = dynamics.calls["integrate"](model, dynamics.calls["neutral"](model), step)
    q1 = dynamics.calls["integrate"](model, q, d)
    return States(q, v, a, tau, rng.normal(size=(samples, model.njoints, 6)), d, q1, rng.uniform(size=samples), 1.3 * q)


def _angular(joint: Joint) -> slice:
    """Where in v the angular velocity of a joint is."""
    first = kind_of(joint.kind).lengths
    return slice(joint.idx_v + first, joint.idx_v + joint.nv)
