"""The loop over fixed steps: one source, compiled unless the torque is a Python function."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from ..algebra.scalars import inline_unoptimized
from ..engines.compiled import numba_kernels
from ..engines.compiled.numba_settings import is_jitted
from .methods.methods import Method
from .system import State, System, held_torque, hold_torque, user_torque


@inline_unoptimized
def drive(
    advance: Callable[..., None], observe: Callable[..., None], system: System, state: State, first: int, count: int,
    total: int, every: int, dt: float, h: float, at: Any, out_q: Any, out_w: Any, out_tau: Any,
) -> None:  # fmt: skip
    """Take steps ``first`` to ``first + count - 1`` of ``total``, step k from k dt by h, while the status is OK.

    After every ``every``-th step and after the last one, the state is written to row at[1] of the outputs and at[1] is
    incremented; at[0] counts the steps done.
    """
    for k in range(first, first + count):
        hold_torque(system, k)
        advance(system, k * dt, h, state)
        if system.status[0] != 0:
            break
        at[0] += 1
        if (k + 1) % every == 0 or k + 1 == total:
            t = k * dt + h
            hold_torque(system, k + 1)
            observe(system, t, state)
            system.torque(system, t, state.q, state.v)
            if system.status[0] != 0:
                break
            row = at[1]
            for i in range(len(state.q)):
                out_q[row, i] = state.q[i]
            for i in range(len(state.w)):
                out_w[row, i] = state.w[i]
                out_tau[row, i] = system.tau[i]
            at[1] = row + 1


_SYSTEM = ("table", "held", "fext", "unit", "zero", "tau", "status")
_LOOP = ("first", "count", "total", "every", "dt", "h", "at", "out_q", "out_w", "out_tau")


def _called(kernel: Any) -> Any:
    """A compiled kernel as a function compiled into its caller; passed as a value it would prevent disk caching."""
    if not is_jitted(kernel):
        return kernel

    def call(*arguments: Any) -> Any:
        return kernel(*arguments)

    return inline_unoptimized(call)


@lru_cache(maxsize=64)
def compile_loop(method: Method, loaded: bool, user: Any = None) -> Callable[..., None]:
    """``drive`` as one compiled function of (*data of the system, *state, *drive's arguments from ``first`` on).

    It releases the GIL, and is cached on disk unless it calls a user's function.
    """
    from ..engines.compiled import jit

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
    function = numba_kernels.kernel_from_text(label, [*_SYSTEM, *State._fields, *_LOOP], body, scope)
    return jit.numba_jit(function, keep=user is None)
