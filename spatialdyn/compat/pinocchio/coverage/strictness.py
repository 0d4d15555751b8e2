"""Strict mode: the switch of the rows of ``differences`` that are marked ``switched``."""

from __future__ import annotations

import os
import weakref
from typing import Any

from ....errors import SpatialDynError

VARIABLE = "SPATIALDYN_STRICT"
MODELS: weakref.WeakSet[Any] = weakref.WeakSet()  # models whose LibraryModel depends on the switch


class _Switch:
    """Whether strict mode is on. Raises SpatialDynError unless the environment variable is empty, 0 or 1."""

    def __init__(self) -> None:
        word = os.environ.get(VARIABLE, "")
        if word not in ("", "0", "1"):
            raise SpatialDynError(f"{VARIABLE} is {word!r}, expected 0 or 1")
        self.on = word == "1"

    def turn(self, on: bool) -> None:
        """Turn strict mode on or off; cached LibraryModels of the other mode are dropped."""
        if on is not self.on:
            self.on = on
            for model in list(MODELS):
                model._library = None
                model._forget()


_SWITCH = _Switch()


def strict(on: bool | None = None) -> bool:
    """Turn strict mode on or off, for all models of the process; returns whether it was on before.

    on  True, False, or None to change nothing

    In strict mode missing names, and quaternions and (cos, sin) pairs whose norm is not within 1e-6 of 1, are errors.
    It is off unless the environment variable SPATIALDYN_STRICT is 1.

    >>> import spatialdyn.compat.pinocchio as pin
    >>> pin.Model().getFrameId("hand")
    1
    >>> before = pin.strict(True)
    >>> pin.Model().getFrameId("hand")
    Traceback (most recent call last):
    spatialdyn.errors.ModelError: frame "hand" is not in robot ""
    >>> pin.strict(before)
    True
    """
    before = _SWITCH.on
    if on is not None:
        if not isinstance(on, bool):
            raise SpatialDynError(f"strict is {on!r}, expected True, False or None")
        _SWITCH.turn(on)
    return before
