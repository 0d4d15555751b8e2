"""The loop over fixed steps: one source, compiled for torques that need no Python, run by Python for those that do."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from numba.extending import is_jitted

from ..algebra.scalars import woven
from ..engines.compiled import numba_kernels
from .methods import Method
from .system import State, System, held_torque, hold, user_torque


@woven
def drive(
    advance: Callable[..., None], observe: Callable[..., None], system: System, state: State, first: int, count: int,
    total: int, every: int, dt: float, h: float, at: Any, out_q: Any, out_w: Any, out_tau: Any,
) -> None:  # fmt: skip
    """Steps ``first`` to ``first + count - 1`` of ``total``, step k from k dt by h, until there is trouble.

    Every so many steps and after the last of all the state is written to row at[1] of the outputs, and that is moved
    on; at[0] counts the steps that are done.
    """
    for k in range(first, first + count):
        hold(system, k)
        advance(system, k * dt, h, state)
        if system.trouble[0] != 0:
            break
        at[0] += 1
        if (k + 1) % every == 0 or k + 1 == total:
            t = k * dt + h
            hold(system, k + 1)
            observe(system, t, state)
            system.torque(system, t, state.q, state.v)
            if system.trouble[0] != 0:
                break
            row = at[1]
            for i in range(len(state.q)):
                out_q[row, i] = state.q[i]
            for i in range(len(state.w)):
                out_w[row, i] = state.w[i]
                out_tau[row, i] = system.tau[i]
            at[1] = row + 1


_SYSTEM = ("table", "held", "fext", "unit", "zero", "tau", "trouble")
_LOOP = ("first", "count", "total", "every", "dt", "h", "at", "out_q", "out_w", "out_tau")


def _called(kernel: Any) -> Any:
    """A compiled kernel as a function that is compiled into its caller; as a value it would keep that off the disk."""
    if not is_jitted(kernel):
        return kernel

    def call(*arguments: Any) -> Any:
        return kernel(*arguments)

    return woven(call)


@lru_cache(maxsize=64)
def compiled(method: Method, loaded: bool, user: Any = None) -> Callable[..., None]:
    """``(*system's data, *state, *drive's arguments from first on)`` in one compiled function, without the GIL.

    It is kept on disk unless there is a user's function in it.
    """
    family = method.family
    assert family is not None
    kernels = family.kernels(loaded)
    parts = {f"part{k}": _called(part) for k, part in enumerate(kernels)}
    torque = "held_torque" if user is None else "user_torque"
    body = [
        "stamp",
        f"kernels = Kernels({', '.join(parts)})",
        f"system = System(kernels, {torque}, {'None' if user is None else 'user'}, {', '.join(_SYSTEM)})",
        f"state = State({', '.join(State._fields)})",
        f"drive(advance, observe, system, state, {', '.join(_LOOP)})",
    ]
    scope = {
        **parts, "Kernels": type(kernels), "System": System, "State": State, "drive": drive, "advance": method.advance,
        "observe": family.observe, "held_torque": held_torque, "user_torque": user_torque, "user": user,
    }  # fmt: skip
    label = f"simulate_{method.name}_{'loaded' if loaded else 'free'}"
    function = numba_kernels.define(label, [*_SYSTEM, *State._fields, *_LOOP], body, scope)
    return numba_kernels.jitted(function, keep=user is None)
