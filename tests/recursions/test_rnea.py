"""rnea is table 5.1 of RBDA, spatial as it is printed; off the unit norm as well, where R is no rotation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from trees import random_state, random_tree

from spatialdyn.algebra.euclidean import neg, zero
from spatialdyn.algebra.public_arrays import read_force
from spatialdyn.algebra.records import inertia_of, motion_of, pose_of, vec_of
from spatialdyn.algebra.spatial import (
    Motion,
    add_force,
    add_motion,
    cross_force,
    cross_motion,
    force_to_parent,
    momentum,
    motion_to_child,
    power,
    scale_motion,
    sub_force,
    zero_motion,
)
from spatialdyn.bodies.joints import joint_motion, place_joint
from spatialdyn.bodies.table import ANY_NORM
from spatialdyn.recursions.tree.rnea import WORK, rnea

ROUNDING = 1e-12  # of the largest torque: products of a dozen numbers, R's up to 9 off the unit norm
CASES = {"all": "v a fext", "bias": "v", "gravity": "", "static": "fext", "from rest": "a", "forced": "v a"}


def table_5_1(bodies: Any, q: Any, v: Any, a: Any, fext: Any) -> Any:
    """The table line by line, in body coordinates."""
    n, work = len(bodies), np.zeros(len(bodies), WORK).view(np.recarray)
    V, A, f, tau = [zero_motion()] * n, [zero_motion()] * n, [None] * n, np.zeros(n - 1)
    A[0] = Motion(zero(), neg(vec_of(bodies[0].gravity)))
    for i in range(1, n):
        b = bodies[i]
        place_joint(bodies, i, q, work[i].X)
        X, I, vJ = pose_of(work[i].X), inertia_of(b.inertia), joint_motion(bodies, i, v)
        V[i] = add_motion(motion_to_child(X, V[b.parent]), vJ)
        aJ = add_motion(scale_motion(a[i - 1], motion_of(b.S)), cross_motion(V[i], vJ))
        A[i] = add_motion(motion_to_child(X, A[b.parent]), aJ)
        f[i] = add_force(momentum(I, A[i]), cross_force(V[i], momentum(I, V[i])))
        if b.joint > 0:
            f[i] = sub_force(f[i], read_force(fext[b.joint]))
    for i in range(n - 1, 0, -1):
        b = bodies[i]
        tau[i - 1] = power(motion_of(b.S), f[i]) + b.armature * a[i - 1]
        if b.parent > 0:
            f[b.parent] = add_force(f[b.parent], force_to_parent(pose_of(work[i].X), f[i]))
    return tau


def both(seed: int, given: str, any_norm: bool, scale: float) -> tuple[Any, Any, Any]:
    """The torques of rnea and of the table, and rnea's where q has to be of unit norm."""
    tree = random_tree(seed, 9, floating=True, continuous="cos_sin")
    rng = np.random.default_rng(seed)
    q = np.array(random_state(tree.tree, rng).q)
    q *= 1.0 + scale * rng.random(len(q))
    bodies = tree.model.bodies.copy()
    n = len(bodies) - 1
    x = {"v": rng.normal(size=n), "a": rng.normal(size=n), "fext": rng.normal(size=(int(bodies[0].dofs), 6))}
    passed = [x[name] if name in given.split() else None for name in ("v", "a", "fext")]
    full = [np.zeros_like(x[name]) if y is None else y for name, y in zip(x, passed, strict=True)]
    found = []
    for kind in (ANY_NORM if any_norm else 0, 0):
        bodies[0].kind = kind
        found.append(np.empty(n))
        rnea(bodies, np.zeros(n + 1, WORK).view(np.recarray), q, *passed, found[-1])
    return found[0], table_5_1(bodies, q, *full), found[1]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(3))
def test_rnea_is_table_5_1(case: str, seed: int) -> None:
    tau, wanted, _ = both(seed, CASES[case], False, 0.0)
    assert abs(tau - wanted).max() <= ROUNDING * abs(wanted).max()


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(3))
def test_rnea_is_table_5_1_off_the_unit_norm(case: str, seed: int) -> None:
    tau, wanted, rotations = both(seed, CASES[case], True, 1.0)
    assert abs(tau - wanted).max() <= ROUNDING * abs(wanted).max()
    if "v" in CASES[case].split():  # the classical form alone has another answer
        assert abs(rotations - wanted).max() > 1e-3 * abs(wanted).max()


@pytest.mark.parametrize("case", CASES)
def test_a_table_of_any_norm_changes_no_bit_of_a_q_of_unit_norm(case: str) -> None:
    tau, _, plain = both(1, CASES[case], True, 0.0)
    assert (tau == plain).all()
