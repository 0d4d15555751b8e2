"""The ``torque`` argument as a Torque: rows held over steps, or a function that writes tau."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array
from ..engines.compiled import numba_kernels
from ..engines.compiled.numba_settings import is_jitted
from ..errors import ShapeError, SimulationError, literal
from .recorder import Steps

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Torque:
    """Torques of a simulation.

    held  (rows, nv) torques of the steps, the last row for all later steps too; one row of zeros with a function
    user  None, or ``user(t, q, v, tau)``, which writes tau
    """

    held: Array
    user: Callable[..., None] | None = None

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return not numba_kernels.PLAIN if self.user is None else is_jitted(self.user)

    def unasked(self, step: int) -> Array:
        """The held torque (nv,) at the beginning of a step; NaN if the torque is a function."""
        held = self.held[min(step, len(self.held) - 1)]
        return np.array(held) if self.user is None else np.full(len(held), np.nan)

    def at(self, step: int, t: float, q: Array, v: Array) -> Array:
        """The torque (nv,) at the beginning of a step. Raises SimulationError if it is not finite."""
        tau: Array = np.array(self.held[min(step, len(self.held) - 1)])
        if self.user is not None:
            self.user(t, q.copy(), v.copy(), tau)
            if not np.isfinite(tau).all():
                raise SimulationError(f"torque is {tau.tolist()} at t = {t:.9g} s, expected finite numbers")
        return tau


def torque_of(torque: Any, nv: int, steps: Steps) -> Torque:
    """The Torque for an argument of ``simulate``.

    Raises ShapeError for an array of another shape, SimulationError, with the time, for a torque that is not finite.
    """
    if not callable(torque):
        rows = as_array("torque", torque)
        if rows.shape not in ((nv,), (steps.total, nv)):
            raise ShapeError(
                f"torque has shape {rows.shape}, expected ({nv},) or ({steps.total}, {nv}), a row per step"
            )
        rows = np.array(rows.reshape(-1, nv) if rows.size else np.zeros((1, nv)), order="C")
        lost = ~np.isfinite(rows).all(axis=1)
        if lost.any():
            step = int(np.argmax(lost))
            raise SimulationError(
                f"torque is {rows[step].tolist()} at t = {steps.time(step):.9g} s (row {step}), expected finite numbers"
            )
        return Torque(rows)
    return Torque(np.zeros((1, nv)), torque if is_jitted(torque) else _writing(torque, nv))


def _writing(function: Callable[..., Any], nv: int) -> Callable[[float, Array, Array, Array], None]:
    """``f(t, q, v) -> tau`` or ``f(t, q, v, tau)`` in the second form; f gets copies of q and v, which it may keep."""
    writes = not _takes(function, 3)
    if isinstance(function, type) or (writes and not _takes(function, 4)):
        raise SimulationError(
            f"torque is {literal(function)}, expected a function f(t, q, v) -> tau or f(t, q, v, tau)"
        )

    def ask(t: float, q: Array, v: Array, tau: Array) -> None:
        if writes:
            function(t, q.copy(), v.copy(), tau)
            return
        made = function(t, q.copy(), v.copy())
        try:
            x = as_array("torque", made)
        except ShapeError as error:
            raise SimulationError(f"{error}, at t = {t:.9g} s") from error
        if x.shape != (nv,):
            raise SimulationError(f"torque has shape {x.shape} at t = {t:.9g} s, expected ({nv},)")
        tau[:] = x

    return ask


def _takes(function: Callable[..., Any], count: int) -> bool:
    """Whether a function takes this many arguments; one without a known signature is taken to have 3."""
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    except ValueError:
        return count == 3
    return True


def check_force(force: Callable[..., Any]) -> None:
    """Raise SimulationError for a function of external forces that does not take (t, q, v)."""
    if isinstance(force, type) or not _takes(force, 3):
        raise SimulationError(f"fext is {literal(force)}, expected a function f(t, q, v) -> (njoints, 6)")


def with_force(asks: Callable[..., None], force: Callable[[float, Array, Array], Any]) -> Callable[..., None]:
    """A torque function of a System that also writes the System's external forces, given by a function of (t, q, v)."""

    def ask(system: Any, t: float, q: Any, v: Any) -> None:
        asks(system, t, q, v)
        system.fext[:] = forces_at(force, t, q, v, system.fext.shape)

    return ask


def forces_at(force: Callable[[float, Array, Array], Any], t: float, q: Any, v: Any, shape: tuple[int, ...]) -> Array:
    """The external forces that a function returns at a time. Raises SimulationError, ShapeError with the time."""
    forces: Array = as_array("fext", force(t, np.array(q), np.array(v)))
    if forces.shape != shape:
        raise ShapeError(f"fext has shape {forces.shape} at t = {t:.9g} s, expected {shape}")
    if not np.isfinite(forces).all():
        raise SimulationError(f"fext is {forces.tolist()} at t = {t:.9g} s, expected finite numbers")
    return forces
