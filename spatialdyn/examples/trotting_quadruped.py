"""A quadruped trots: joint references, a PD law and four feet, no controller of the body.

Learn    sd.Contacts on named feet, sd.PD in sd.rollout, many frictions at once, Rollout.contacts, contact_gaps.
Look at  the ground: diagonal legs carry the weight in turn, and over strides they carry no more. On ice the same
         references move the robot half as far, for its feet slip; each impulse stays in its cone, which is no pyramid.
Needs    pip install example-robot-data for Solo12
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

DT, PERIOD, FEET = 1e-3, 0.32, ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


def references(model: sd.Model, steps: int) -> np.ndarray:
    """(steps, nq): each thigh swings, and the knee bends while its leg comes forward; diagonal legs are in phase."""
    q, t = np.tile(sd.neutral(model), (steps, 1)), DT * np.arange(steps)
    grow = np.minimum(t / PERIOD, 1.0)  # the first stride
    for joint in model.joints[2:]:
        front = 1.0 if joint.name[0] == "F" else -1.0  # knees point inwards
        phase = 2.0 * np.pi * t / PERIOD + (0.0 if joint.name[:2] in ("FL", "HR") else np.pi)
        lift, swing = grow * np.maximum(np.sin(phase), 0.0), grow * np.cos(phase)
        if "HFE" in joint.name:
            q[:, joint.idx_q] = front * (0.8 + 0.3 * lift) + 0.15 * swing
        if "KFE" in joint.name:
            q[:, joint.idx_q] = -front * (1.6 + 0.6 * lift)
    return q


def main(save: str | None = None, quick: bool = False) -> dict[str, np.ndarray]:
    """Trot on grounds of four frictions and print how far; returns paths, forces and residuals."""
    model = sd.load_urdf("solo12", root="floating")
    steps = round((4 if quick else 12) * PERIOD / DT)
    q_ref = references(model, steps)
    kp, kd = np.r_[np.zeros(6), np.full(12, 8.0)], np.r_[np.zeros(6), np.full(12, 0.2)]
    mus, runs, records = (0.8, 0.4, 0.2, 0.05), [], []
    weight = sd.total_mass(model) * 9.81
    print("  μ   way in x [m]   mean load / weight   feet down   residual 95 % [m/s]")
    for mu in mus:
        contacts = sd.Contacts(model, dict.fromkeys(FEET, 0.016), friction=mu)
        q0 = q_ref[0].copy()
        q0[2] -= sd.contact_gaps(model, contacts, q0).min()
        scene, law = sd.Scene(model, contacts=contacts), sd.PD(kp, kd, q_ref)
        run = sd.rollout(scene, q0, np.zeros(model.nv), dt=DT, control=law, record="contacts")
        assert run.contacts is not None
        runs.append(run)
        records.append(run.contacts)
        force, last = run.contacts.impulse / DT, round(2 * PERIOD / DT)  # of two strides
        load, down = force[-last:, :, 2].sum(axis=1).mean() / weight, (force[-last:, :, 2] > 0.0).mean()
        residual = np.percentile(run.contacts.residual, 95)
        print(f"{mu:4.2f} {run.q[-1, 0]:14.3f} {load:20.4f} {4 * down:11.2f} {residual:21.1e}")
    forces = np.array([record.impulse / DT for record in records])
    if save:
        figure, axes = picture(2, width=11.0)
        seen = slice(-round(2 * PERIOD / DT), None)
        for k, foot in enumerate(FEET):
            axes[0].plot(runs[0].t[seen], forces[0, seen, k, 2], label=foot[:2], linewidth=1.2)
        axes[0].set(xlabel="t [s]", ylabel="normal force [N]", title="two strides, μ = 0.8")
        for mu, run in zip(mus, runs, strict=True):
            axes[1].plot(run.t, run.q[:, 0], label=f"μ = {mu}")
        axes[1].set(xlabel="t [s]", ylabel="x of the body [m]", title="the same steps on other ground")
        for one in axes:
            one.legend()
        write(figure, save)
    kept = {"x": np.array([r.q[:, 0] for r in runs]), "z": np.array([r.q[:, 2] for r in runs]), "force": forces}
    residuals = np.array([record.residual for record in records])
    return {**kept, "residual": residuals, "mu": np.array(mus), "weight": np.array(weight)}


if __name__ == "__main__":
    start(main)
