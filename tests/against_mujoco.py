"""A Model against the MjModel that it was made of: M, bias and forward dynamics, in the model's coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd

RELATIVE = 1e-12  # of what is compared; measured up to 4e-14 over 60 files, cond(M) eps of forward dynamics beside


def without_passive(m: Any) -> Any:
    """The MjModel, changed in place so that only inertia, gravity and applied torques act."""
    import mujoco

    bits = mujoco.mjtDisableBit
    off = (bits.mjDSBL_CONSTRAINT, bits.mjDSBL_SPRING, bits.mjDSBL_DAMPER, bits.mjDSBL_ACTUATION)
    m.opt.disableflags |= sum(int(x) for x in off)
    m.body_gravcomp[:] = 0.0
    m.opt.density = m.opt.viscosity = 0.0
    return m


def errors(m: Any, model: sd.Model, states: int = 3) -> dict[str, float]:
    """Largest errors of M, bias and accelerations at random states of an MjModel without passive forces.

    M and accelerations are relative to their largest entries; those, too, to 1 + 1e-3 cond(M), for a solution has no
    more digits. The bias is relative to its largest entry and the weight of all bodies: of a vehicle whose joints bear
    no weight, tidybot's base, it is the rounding of the weight, and has no digits of its own.
    """
    import mujoco

    data, rng = mujoco.MjData(m), np.random.default_rng(0)
    found = {"M": 0.0, "bias": 0.0, "acceleration": 0.0}
    for _ in range(states):
        qpos = m.qpos0.copy()
        mujoco.mj_integratePos(m, qpos, rng.uniform(-0.7, 0.7, m.nv), 1.0)
        data.qpos[:], data.qvel[:] = qpos, rng.normal(size=m.nv)
        data.qfrc_applied[:] = 10.0 * rng.normal(size=m.nv)
        mujoco.mj_forward(m, data)
        M = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, data, M)
        q, v = sd.from_mujoco(model, data.qpos, data.qvel)
        J, drift = velocities(model, q, v)
        ours = sd.crba(model, q)
        bias, theirs = sd.nonlinear_effects(model, q, v), J.T @ (data.qfrc_bias + M @ drift)
        a = J @ sd.aba(model, q, v, J.T @ data.qfrc_applied) + drift
        weight = model.total_mass * float(np.linalg.norm(model.gravity))
        solved = 1.0 + 1e-3 * np.linalg.cond(ours)
        for name, off, scale in (
            ("M", J.T @ M @ J - ours, abs(ours).max()),
            ("bias", theirs - bias, abs(bias).max() + weight),
            ("acceleration", a - data.qacc, abs(a).max() * solved),
        ):
            found[name] = max(found[name], float(abs(off).max() / scale))
    return found


def velocities(model: sd.Model, q: Any, v: Any) -> tuple[Any, Any]:
    """J and J̇v with qvel = J v: a free joint's linear velocity is along the world's axes in MuJoCo."""
    J, drift = np.eye(model.nv), np.zeros(model.nv)
    for joint in model.joints[1:]:
        if joint.kind == "floating":
            at = slice(joint.idx_v, joint.idx_v + 3)
            R = sd.forward_kinematics(model, q)[model.names.index(joint.name), :3, :3]
            turn = v[joint.idx_v + 3 : joint.idx_v + 6]
            J[at, at], drift[at] = R, R @ np.cross(turn, v[at])
    return J, drift
