"""Rollouts of a quadruped on its feet against MuJoCo's: one process, one thread, in turn.

``python benchmarks/contacts.py [--quick]`` prints nanoseconds of a step and ratios; on a busy machine read the ratios.
Both robots have the same inertias, joints, armature (none), joint PD, step (2 ms) and four spheres of 3 cm on a plane
with a friction of 0.8; MuJoCo has Newton's method with pyramidal cones, and no limits. Before anything is timed the
steps of the library are held to Coulomb's law (residual), the free motions of both are compared, and both robots have
to stand on their weight. With dry joints (MuJoCo's frictionloss) the torques that M, bias, PD and the feet's impulses
leave over have to be within the friction's level, and against the motion of joints that move. Needs
``pip install ".[validate,bench]"``.
"""

from __future__ import annotations

import argparse
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin
from contestants import mujoco_model
from measure import interleaved
from tables import draw

import spatialdyn as sd
from spatialdyn.urdf.load import find_robot

ROBOT, FEET = "anymal_b_simple_description/anymal", ("LF_FOOT", "LH_FOOT", "RF_FOOT", "RH_FOOT")
RADIUS, MU, DT, G = 0.03, 0.8, 2e-3, 9.81
KP, KD = 150.0, 4.0
STATES, STEPS = 256, 100
WALK = 1000  # steps whose residual is looked at
SOLVED, SHARE = 1e-6, 0.95  # [m/s], of all steps; share of steps for laws by other means
ASKED = 20.0  # times as fast as MuJoCo
DRY = 2.0  # [N m] of every leg's joint
SOLVED_DRY = 0.999  # of the steps on dry joints that reach SOLVED
OFF_DRY = 1e-3  # [rad/s] by M, bias and impulses, of SHARE of the steps

Array = np.ndarray


def robot() -> tuple[sd.Model, sd.Contacts]:
    """The robot here, and its feet."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a link of the file has an inertia of nothing
        model = sd.load_urdf(ROBOT, root="floating")
    return model, sd.Contacts(model, dict.fromkeys(FEET, RADIUS), friction=MU)


def mujoco_robot(model: sd.Model) -> Any:
    """The robot in MuJoCo: spheres at its feet on a plane, PD as actuators."""
    path, friction = str(find_robot(ROBOT)), f"{MU} 0.005 0.0001"
    theirs = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())

    def more(root: ET.Element, bodies: list[ET.Element]) -> None:
        ET.SubElement(bodies[0], "geom", type="plane", size="0 0 1", friction=friction)
        for foot in FEET:
            frame = theirs.frames[theirs.getFrameId(foot)]
            at = " ".join(map(repr, frame.placement.translation.tolist()))
            size = {"type": "sphere", "size": str(RADIUS), "pos": at, "mass": "0", "friction": friction}
            ET.SubElement(bodies[frame.parentJoint], "geom", size | {"contype": "2", "conaffinity": "1"})
        actuators = ET.SubElement(root, "actuator")
        for k in range(2, theirs.njoints):
            joint = bodies[k].find("joint")
            assert joint is not None
            joint.set("name", theirs.names[k])
            gains = {"gainprm": str(KP), "biastype": "affine", "biasprm": f"0 {-KP} {-KD}"}
            ET.SubElement(actuators, "general", {"joint": theirs.names[k], **gains})

    made = mujoco_model(theirs, more)
    made.opt.timestep, made.opt.solver = DT, mujoco.mjtSolver.mjSOL_NEWTON
    made.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    made.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    assert [theirs.names[k] for k in range(1, theirs.njoints)] == [x.name for x in model.joints[1:]]
    return made


def stance(model: sd.Model, contacts: sd.Contacts) -> Array:
    """The robot on its feet."""
    q = sd.neutral(model)
    for joint in model.joints[2:]:
        front = 1.0 if joint.name[1] == "F" else -1.0
        q[joint.idx_q] = front * {"HAA": 0.0, "HFE": 0.4, "KFE": -0.8}[joint.name[3:]]
    q[2] += 1.0
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    return q


def trot(model: sd.Model, q: Array, steps: int) -> Array:
    """References (steps, nq): diagonal legs lift in turn."""
    found, t = np.tile(q, (steps, 1)), DT * np.arange(steps)
    for joint in model.joints[2:]:
        front = 1.0 if joint.name[1] == "F" else -1.0
        phase = 2.0 * np.pi * t / 0.5 + (0.0 if joint.name[:2] in ("LF", "RH") else np.pi)
        lift = np.maximum(np.sin(phase), 0.0)
        swing = {"HAA": 0.0 * t, "HFE": 0.25 * front * lift + 0.1 * np.cos(phase), "KFE": -0.5 * front * lift}
        found[:, joint.idx_q] += swing[joint.name[3:]]
    return found


def law(model: sd.Model, reference: Array) -> sd.PD:
    """Joint PD of all joints but the base."""
    kp, kd = np.full(model.nv, KP), np.full(model.nv, KD)
    kp[:6] = kd[:6] = 0.0
    return sd.PD(kp, kd, reference)


class Peer:
    """MuJoCo's rollouts from the library's states, one thread."""

    def __init__(self, model: sd.Model) -> None:
        self.model, self.made = model, mujoco_robot(model)
        self.data = mujoco.MjData(self.made)

    def states(self, q: Array, v: Array) -> Array:
        """(n, 1 + nq + nv), the time first."""
        return np.hstack([np.zeros((len(q), 1)), *sd.to_mujoco(self.model, q, v)])

    def rollout(self, state: Array, reference: Array) -> Array:
        """States (n, steps, 1 + nq + nv) under references (steps, nq)."""
        control = np.broadcast_to(reference[:, 7:], (len(state), len(reference), self.model.nv - 6))
        made: Array = mujoco.rollout.rollout(self.made, self.data, state, control)[0]
        return made


def check(model: sd.Model, contacts: sd.Contacts, peer: Peer, q: Array) -> list[float]:
    """AssertionError unless all hold: residuals, free motion of both, both stand. Returns percentiles of residuals."""
    walk = sd.rollout(
        sd.Scene(model, contacts=contacts),
        q,
        np.zeros(model.nv),
        dt=DT,
        control=law(model, trot(model, q, WALK)),
        record="contacts",
    )
    assert walk.contacts is not None
    residual = walk.contacts.residual
    assert residual.max() <= SOLVED, np.percentile(residual, [50, 95, 100])
    assert walk.q[:, 2].min() > 0.3  # it walks and does not fall

    high, v = q.copy(), 0.3 * np.random.default_rng(1).standard_normal(model.nv)
    high[2] += 5.0
    ours = sd.rollout(sd.Scene(model, contacts=contacts), high, v, dt=DT, steps=50, control=law(model, q))
    theirs = peer.rollout(peer.states(high[None], v[None]), np.tile(q, (50, 1)))[0]
    wanted = peer.states(ours.q, ours.v)
    off = abs(theirs[-1, 1:] - wanted[-1, 1:]).max()
    assert off < 0.02, off  # MuJoCo integrates the base in the world and damping implicitly: equal to first order

    stand = sd.rollout(
        sd.Scene(model, contacts=contacts),
        q,
        np.zeros(model.nv),
        dt=DT,
        steps=1000,
        control=law(model, q),
        record="contacts",
    )
    assert stand.contacts is not None
    weight = sd.total_mass(model) * G
    assert abs(stand.contacts.impulse[-1, :, 2].sum() / DT / weight - 1.0) < 1e-3
    theirs = peer.rollout(peer.states(q[None], np.zeros((1, model.nv))), np.tile(q, (1000, 1)))[0]
    peer.data.qpos[:], peer.data.qvel[:] = theirs[-1, 1:20], theirs[-1, 20:]
    mujoco.mj_forward(peer.made, peer.data)
    assert peer.data.ncon == len(FEET)
    forces = np.zeros((peer.data.ncon, 6))
    for k in range(peer.data.ncon):
        mujoco.mj_contactForce(peer.made, peer.data, k, forces[k])
    assert abs(forces[:, 0].sum() / weight - 1.0) < 1e-2
    return [float(x) for x in np.percentile(residual, [50, 95, 100])]


def dry_joints(model: sd.Model) -> sd.Friction:
    """Coulomb's friction of all joints but the base."""
    return sd.Friction(np.r_[np.zeros(6), np.full(model.nv - 6, DRY)], 0.0)


def unturned(model: sd.Model, run: sd.Rollout, q: Array, v: Array) -> Array:
    """Velocities after each step as M, at the beginning, has them: the base's linear one turns with it in a step.

    A step finds x = v + h (a + ω × v), in the axes of the beginning, and ends with it in those of the end.
    """
    made = run.v.copy()
    before, after = (sd.forward_kinematics(model, x)[:, 1, :3, :3] for x in (q, run.q))
    made[:, :3] = np.einsum("tji,tjk,tk->ti", before, after, run.v[:, :3]) - DT * np.cross(v[:, 3:6], v[:, :3])
    return made


def left_to_friction(model: sd.Model, run: sd.Rollout, q0: Array, reference: Array) -> tuple[Array, Array]:
    """Torque that the equations of motion leave over in each step, and by how much velocities miss its law."""
    assert run.contacts is not None
    q, v = np.vstack([q0, run.q[:-1]]), np.vstack([np.zeros(model.nv), run.v[:-1]])
    tau = np.zeros_like(v)
    tau[:, 6:] = KP * (reference - q)[:, 7:] - KD * v[:, 6:]
    push = np.einsum("tij,tj->ti", sd.crba(model, q), unturned(model, run, q, v) - v)
    push += DT * (sd.nonlinear_effects(model, q, v) - tau)
    for k, foot in enumerate(FEET):
        J = sd.frame_jacobian(model, q, foot, "local_world_aligned")
        J[:, 0] -= RADIUS * J[:, 4]  # at the lowest point of the sphere
        J[:, 1] += RADIUS * J[:, 3]
        push -= np.einsum("tij,ti->tj", J[:, :3], run.contacts.impulse[:, k])
    weight = 1.0 / np.diagonal(np.linalg.inv(sd.crba(model, q)), axis1=1, axis2=2)
    level = DT * dry_joints(model).coulomb
    return push / DT, abs(push - np.clip(push - weight * run.v, -level, level)) / weight


def check_dry(model: sd.Model, contacts: sd.Contacts, peer: Peer, q: Array) -> list[float]:
    """AssertionError unless a trot on dry joints obeys its laws. Returns percentiles of residuals."""
    reference, friction = trot(model, q, WALK), dry_joints(model)
    kept: dict[str, Any] = dict(contacts=contacts, friction=friction)
    scene = sd.Scene(model, **kept)
    walk = sd.rollout(
        scene, q, np.zeros(model.nv), dt=DT, control=law(model, reference), check=False, record="contacts"
    )
    assert walk.contacts is not None
    residual = walk.contacts.residual
    assert (residual <= SOLVED).mean() >= SOLVED_DRY, np.percentile(residual, [50, 99, 100])
    assert walk.q[:, 2].min() > 0.3
    torque, off = left_to_friction(model, walk, q, reference)
    torque = abs(torque)
    assert (torque[:, 6:].max(axis=1) <= 1.01 * DRY).mean() >= SHARE
    assert (torque[:, :6].max(axis=1) <= 0.01 * DRY).mean() >= SHARE  # nothing rubs at the base
    assert (off.max(axis=1) <= OFF_DRY).mean() >= SHARE
    assert (walk.v == 0.0).any()

    high, v = q.copy(), 0.3 * np.random.default_rng(1).standard_normal(model.nv)
    high[2] += 5.0
    ours = sd.rollout(scene, high, v, dt=DT, steps=50, control=law(model, q))
    theirs = peer.rollout(peer.states(high[None], v[None]), np.tile(q, (50, 1)))[0]
    gap = abs(theirs[-1, 1:] - peer.states(ours.q, ours.v)[-1, 1:]).max()
    assert gap < 0.05, gap  # frictionloss is regularised: its joints creep
    return [float(x) for x in np.percentile(residual, [50, 95, 100])]


def main() -> None:
    """Check, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    rounds, seconds = (3, 0.1) if parser.parse_args().quick else (15, 0.3)
    sd.set_num_threads(1)
    model, contacts = robot()
    peer, q = Peer(model), stance(model, contacts)
    percentiles = check(model, contacts, peer, q)
    print("residual of a trot [m/s], 50, 95 and 100 %: {:.1e} {:.1e} {:.1e}".format(*percentiles))

    rough = Peer(model)
    rough.made.dof_frictionloss[6:] = DRY
    dry = check_dry(model, contacts, rough, q)
    print("residual on dry joints [m/s], 50, 95 and 100 %: {:.1e} {:.1e} {:.1e}".format(*dry))

    rng = np.random.default_rng(0)
    reference = trot(model, q, STEPS)
    starts = np.tile(q, (STATES, 1))
    v = 0.1 * rng.standard_normal((STATES, model.nv))
    pd, state = law(model, reference), peer.states(starts[: STATES // 8], v[: STATES // 8])

    def ours(dtype: Any = np.float64, **given: Any) -> Callable[[], object]:
        scene = sd.Scene(model, **given)
        return lambda: sd.rollout(scene, starts, v, dt=DT, control=pd, record=STEPS, dtype=dtype, check=False)

    contestants = {
        "no contact": ours(), "contact": ours(contacts=contacts),
        "contact, float32": ours(np.float32, contacts=contacts),
        "contact and limits": ours(contacts=contacts, limits=True), "mujoco": lambda: peer.rollout(state, reference),
        "contact and dry joints": ours(contacts=contacts, friction=dry_joints(model)),
        "mujoco, frictionloss": lambda: rough.rollout(state, reference),
    }  # fmt: skip
    times = interleaved(contestants, rounds, seconds)
    each = {name: 1e9 * x / (STEPS * (len(state) if "mujoco" in name else STATES)) for name, x in times.items()}
    theirs = {
        name: each["mujoco, frictionloss" if any(x in name for x in ("dry", "loss")) else "mujoco"] for name in each
    }
    rows = [[name, f"{x:.0f}", f"{1e3 / x:.2f}", f"{theirs[name] / x:.1f}"] for name, x in each.items()]
    draw("contacts", ["a step", "ns", "million/s", "times mujoco"], rows)
    print(f"asked for: {ASKED:g} times, of {each['mujoco'] / each['contact']:.1f}")


if __name__ == "__main__":
    main()
