"""MJX and Brax on the same samples, under jax.jit and jax.vmap in float64, as contestants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import contestants
import numpy as np
from cases import Array, Case, Contestant

import spatialdyn as sd


def of_function(case: Case, function: Callable[..., Any], given: list[Array], read: Any) -> Contestant:
    """A function of one sample's arrays as a contestant."""
    import jax

    single, batch, count = jax.jit(function), jax.jit(jax.vmap(function)), min(case.samples, contestants.FEW)
    every = [jax.numpy.asarray(x[:count]) for x in given]
    one = [x[0] for x in every]
    return Contestant(
        lambda: single(*one).block_until_ready(),
        lambda: np.asarray(batch(*every).block_until_ready()),
        count,
        f"jax.vmap of {count}",
        read,
    )


def mjx(case: Case, call: str) -> Contestant | None:
    """MJX's functions of one sample, with the inputs and results of ``contestants.mujoco``."""
    from mujoco import mjx as mj

    model, base = mj.put_model(contestants.mujoco_model(case.theirs)), contestants.Base(case)
    data = mj.make_data(model)
    qpos, qvel = sd.to_mujoco(case.ours, case.state["q"], case.state["v"])

    def place(q: Any, v: Any) -> Any:
        return mj.com_pos(model, mj.kinematics(model, data.replace(qpos=q, qvel=v)))

    def inverse(q: Any, v: Any, a: Any) -> Any:
        moving = mj.com_vel(model, place(q, v)).replace(qacc=a)
        return mj.rne(model, moving, flg_acc=True).qfrc_bias

    def mass(q: Any) -> Any:
        return mj.full_m(model, mj.crb(model, place(q, qvel[0])))

    def forward(q: Any, v: Any, force: Any) -> Any:
        return mj.forward(model, data.replace(qpos=q, qvel=v, qfrc_applied=force)).qacc

    function, given, read = {
        "rnea": (inverse, [qpos, qvel, base.acceleration(case.state["a"])], base.forces),
        "crba": (mass, [qpos], base.matrices),
        "aba": (forward, [qpos, qvel, base.turned(case.state["t"])], base.accelerations),
    }[call]
    return of_function(case, function, given, read)


def brax(case: Case, call: str) -> Contestant | None:
    """Brax's generalized pipeline: its mass matrix, and accelerations by solving with it."""
    import jax
    from brax import kinematics
    from brax.generalized import dynamics, mass
    from brax.generalized.base import State
    from brax.io import mjcf

    if call == "rnea":  # its inverse dynamics has no acceleration
        return None
    system = mjcf.load_model(contestants.mujoco_model(case.theirs))

    def place(q: Any, v: Any) -> Any:
        state = State.init(q, v, *kinematics.forward(system, q, v))
        return dynamics.transform_com(system, state)

    def matrix(q: Any) -> Any:
        return mass.matrix(system, place(q, 0.0 * q))

    def forward(q: Any, v: Any, force: Any) -> Any:
        state = place(q, v)
        return jax.numpy.linalg.solve(mass.matrix(system, state), dynamics.forward(system, state, force))

    function = {"crba": matrix, "aba": forward}[call]
    return of_function(case, function, case.arguments(call), Contestant._field_defaults["read"])
