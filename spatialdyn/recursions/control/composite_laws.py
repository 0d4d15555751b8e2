"""Composite adaptive laws, which learn from the prediction error as well as from the tracking error.

y = Yᵀ s + c Wᵀ e with the prediction error e = W π̂ - W π. From p = Y_p π, N = g - Cᵀ v = Y_N π and ṗ = τ - N, filtered
so that no acceleration is needed: with φ = ω h/(1 + ω h) and T⁺ = T + φ (τ - T),

    W = φ/h Y_p + F,   F⁺ = F + φ (Y_N - φ/h Y_p - F),   W π = T   if p⁺ = p + h (τ - N),

from F = -φ/h Y_p and T = 0 at the beginning; the terms of armatures, which are known, are part of T.

Source: after Slotine and Li, Composite adaptive control of robot manipulators (1989); the discrete filters, which
balance a step exactly, are a derivation of ours.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import neg, unrotate, zero
from ...algebra.public_arrays import write_parameters
from ...algebra.records import motion_of, pose_of, put_vec, vec_of
from ...algebra.scalars import Scalar, inline, select
from ...algebra.spatial import Motion, compose, cross_motion, identity_pose, motion_to_child
from ..momenta.adaptive_regressors import along
from ..signatures import Array, Bodies, Config, Vector, Work
from .adaptive_laws import (
    Aim,
    Euclidean,
    Natural,
    NaturalScratch,
    Scratch,
    Wear,
    act_euclidean,
    act_natural,
    add_friction,
    beyond,
    learn_friction,
    move_euclidean,
    move_natural,
)


class Prediction(NamedTuple):
    """Parameters of composite laws: c and ω, in arrays of one."""

    weight: Vector
    bandwidth: Vector


class Filters(NamedTuple):
    """The filters of composite laws: F (nv, njoints, 10), T (nv) and whether they have begun."""

    F: Array
    T: Vector
    begun: Vector


class Ends(NamedTuple):
    """The outputs of composite laws: τ, and ``learnt`` and the filters at the end of a step."""

    tau: Vector
    after: Vector
    F: Vector
    T: Vector
    begun: Vector


class WornEnds(NamedTuple):
    """The same, and friction."""

    tau: Vector
    after: Vector
    F: Vector
    T: Vector
    begun: Vector
    worn: Vector


@inline
def predict(
    bodies: Bodies, work: Work, v: Vector, dt: Scalar, deadzone: Vector, by: Prediction, old: Filters, out: Ends,
    x: Scratch, W: Array,
) -> None:  # fmt: skip
    """y += c Wᵀ e, and the filters at the end of the step; scratch as ``torques`` leaves it, tau without friction."""
    rise = by.bandwidth[0] / (1.0 + dt * by.bandwidth[0])  # φ/h
    share, begun, width = dt * rise, old.begun[0], 10 * len(x.pi)
    for k in range(len(out.F)):
        out.F[k] = 0.0
    put_vec(work[0].g, neg(vec_of(bodies[0].gravity)))
    for i in range(1, len(bodies)):
        put_vec(work[i].g, unrotate(pose_of(work[i].X).R, vec_of(work[bodies[i].parent].g)))
    for i in range(len(v)):
        known = rise * bodies[i + 1].armature * v[i]
        T = select(begun, old.T[i], known)
        x.e[i] = known - T
        out.T[i] = T + share * (out.tau[i] + known - T)
    for i in range(1, len(bodies)):
        body = bodies[i].joint
        X = identity_pose()
        j = i
        while j > 0 and body > 0:
            S = motion_to_child(X, motion_of(bodies[j].S))
            Z = motion_to_child(X, cross_motion(motion_of(work[j].v), motion_of(bodies[j].S)))
            vi, g = motion_of(work[i].v), Motion(zero(), vec_of(work[i].g))
            write_parameters(x.ten[0], along(S, vi))
            write_parameters(x.ten[1], along(S, g))
            write_parameters(x.ten[2], along(Z, vi))
            for k in range(10):
                p = rise * x.ten[0, k]
                F = select(begun, old.F[j - 1, body, k], -p)
                W[j - 1, body, k] = p + F
                out.F[(j - 1) * width + 10 * body + k] = F + share * (x.ten[1, k] - x.ten[2, k] - p - F)
                x.e[j - 1] = x.e[j - 1] + W[j - 1, body, k] * x.pi[body, k]
            X = compose(pose_of(work[j].X), X)
            j = bodies[j].parent
    weight = by.weight[0] * beyond(x.s, deadzone)
    for i in range(1, len(bodies)):
        body = bodies[i].joint
        j = i
        while j > 0 and body > 0:
            for k in range(10):
                x.y[body, k] = x.y[body, k] + weight * W[j - 1, body, k] * x.e[j - 1]
            j = bodies[j].parent
    out.begun[0] = 1.0


@inline
def composite(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Euclidean, predicted: Prediction,
    learnt: Array, old: Filters, out: Ends, x: Scratch, W: Array,
) -> None:  # fmt: skip
    """``euclidean``, with the error of prediction."""
    act_euclidean(bodies, work, q, v, aim, by, learnt, out.tau, x)
    predict(bodies, work, v, dt, by.deadzone, predicted, old, out, x, W)
    move_euclidean(dt, by, out.after, x)


@inline
def composite_with_friction(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Euclidean, predicted: Prediction,
    wear: Wear, learnt: Array, old: Filters, worn: Array, out: WornEnds, x: Scratch, W: Array,
) -> None:  # fmt: skip
    """``composite``, with friction."""
    ends = Ends(out.tau, out.after, out.F, out.T, out.begun)
    composite(bodies, work, q, v, dt, aim, by, predicted, learnt, old, ends, x, W)
    add_friction(v, wear, worn, out.tau)
    learn_friction(v, x.s, wear, worn, dt, out.worn)


@inline
def natural_composite(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Natural, predicted: Prediction,
    learnt: Array, old: Filters, out: Ends, x: Scratch, own: NaturalScratch, W: Array,
) -> None:  # fmt: skip
    """``natural``, with the error of prediction."""
    act_natural(bodies, work, q, v, aim, by, learnt, out.tau, x, own)
    predict(bodies, work, v, dt, by.deadzone, predicted, old, out, x, W)
    move_natural(dt, by, out.after, x, own)


@inline
def natural_composite_with_friction(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Scalar, aim: Aim, by: Natural, predicted: Prediction,
    wear: Wear, learnt: Array, old: Filters, worn: Array, out: WornEnds, x: Scratch, own: NaturalScratch, W: Array,
) -> None:  # fmt: skip
    """``natural_composite``, with friction."""
    ends = Ends(out.tau, out.after, out.F, out.T, out.begun)
    natural_composite(bodies, work, q, v, dt, aim, by, predicted, learnt, old, ends, x, own, W)
    add_friction(v, wear, worn, out.tau)
    learn_friction(v, x.s, wear, worn, dt, out.worn)
